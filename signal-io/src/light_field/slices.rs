use inr_core::{Domain, Field, Samples, Spline};

use super::LightField;
use crate::Image;
use crate::strip::adopt;

/// Pictures made of all views.
impl LightField {
    /// The picture that a large lens would take: the mean over all views, each read at
    /// `x + slope * (u - u0)`, `y + slope * (v - v0)`, where `(u0, v0)` is the middle of the grid.
    ///
    /// `slope` is in pixels per view. Sharp is what moves by `slope` from a view to the next one, in
    /// the direction of increasing `u` and `v`; 0 is the plain mean. Between pixels views are cubic
    /// splines, beyond their border their own mirror images. Alpha is treated like a colour; values
    /// that are not finite spread. Cost: 16 products for every value of the light field.
    ///
    /// Source: Ng et al. 2005, "Light field photography with a hand-held plenoptic camera" (shift and
    /// add), with equal weights.
    ///
    /// # Panics
    /// If `slope` is not finite.
    pub fn refocused(&self, slope: f32) -> Image {
        assert!(slope.is_finite(), "slope {slope}");
        let [width, height, columns, rows] = self.shape();
        let domain = Domain::unit([width, height]).expect("as large as a view");
        let n = width * height;
        let mut data = Vec::with_capacity(n * self.channels().len());
        let (mut points, mut values) = (vec![[0.0; 2]; width], vec![[0.0; 1]; width]);
        for c in 0..self.channels().len() {
            // In f64, so that the mean of equal views is what they are.
            let mut sum = vec![0.0f64; n];
            for (k, view) in self.plane(c).chunks_exact(n).enumerate() {
                let [dx, dy] = [(k % columns, columns), (k / columns, rows)]
                    .map(|(at, count)| slope * (at as f32 - (count - 1) as f32 / 2.0));
                let samples = Samples::<2, 1>::from_planar(domain, view.to_vec());
                let spline = Spline::interpolate_owned(samples.expect("one value per pixel"));
                for (y, line) in sum.chunks_exact_mut(width).enumerate() {
                    for (x, point) in points.iter_mut().enumerate() {
                        *point = [x as f32 + dx, y as f32 + dy];
                    }
                    spline.eval(&points, &mut values);
                    line.iter_mut().zip(&values).for_each(|(sum, [v])| *sum += f64::from(*v));
                }
            }
            let views = (columns * rows) as f64;
            data.extend(sum.into_iter().map(|sum| (sum / views) as f32));
        }
        self.picture(width, height, data)
    }

    /// Row `y` of all views in row `v` of the grid, one below the other: `X` columns and `U` rows.
    ///
    /// A point of the scene is a straight line in it, whose slope tells its distance.
    ///
    /// # Panics
    /// If `y >= shape()[1]` or `v >= shape()[3]`.
    pub fn epipolar(&self, y: usize, v: usize) -> Image {
        let [width, height, columns, rows] = self.shape();
        assert!(y < height && v < rows, "row {y} of {height} in views {v} of {rows}");
        let mut data = Vec::with_capacity(width * columns * self.channels().len());
        for c in 0..self.channels().len() {
            for u in 0..columns {
                let start = ((v * columns + u) * height + y) * width;
                data.extend_from_slice(&self.plane(c)[start..start + width]);
            }
        }
        self.picture(width, columns, data)
    }

    fn picture(&self, width: usize, height: usize, data: Vec<f32>) -> Image {
        let mut image = Image::new(width, height, self.channels(), data).expect("a whole picture");
        adopt(&mut image, self.as_strip());
        image
    }
}
