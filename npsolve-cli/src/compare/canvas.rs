//! A small RGB picture to draw results and labels on.

use anyhow::Result;
use inr_core::{Domain, Samples, Spline};
use signal_io::{Image, SampleType, Transfer};

use super::font;

/// Display values, 0 to 1.
#[derive(Clone)]
pub struct Canvas {
    samples: Samples<2, 3>,
}

impl Canvas {
    /// One colour everywhere.
    pub fn new(width: usize, height: usize, color: [f32; 3]) -> Result<Self> {
        let domain = Domain::unit([width, height])?;
        Ok(Self { samples: Samples::from_fn(domain, |_| color) })
    }

    /// What a screen shows of a picture: sRGB, the first three channels, clamped.
    pub fn from_image(image: &Image) -> Result<Self> {
        let shown = image.to_transfer(Transfer::Srgb);
        let n = image.pixel_count();
        let planes = [0, 1, 2].map(|c| match shown.channels().len() {
            1 | 2 => shown.plane(0),
            _ => shown.plane(c),
        });
        let data: Vec<f32> = planes.concat().iter().map(|v| v.clamp(0.0, 1.0)).collect();
        debug_assert_eq!(data.len(), 3 * n);
        Ok(Self { samples: Samples::from_planar(image.domain(), data)? })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.samples.domain().shape()
    }

    /// The difference to another canvas of the same size, times `gain`.
    pub fn difference(mut self, other: &Self, gain: f32) -> Self {
        for (v, o) in self.samples.as_planar_mut().iter_mut().zip(other.samples.as_planar()) {
            *v = ((*v - o).abs() * gain).min(1.0);
        }
        self
    }

    /// A rectangle of it.
    pub fn cropped(&self, start: [usize; 2], size: [usize; 2]) -> Result<Self> {
        let mut out = Self::new(size[0], size[1], [0.0; 3])?;
        for y in 0..size[1] {
            for x in 0..size[0] {
                out.set([x, y], self.get([start[0] + x, start[1] + y]));
            }
        }
        Ok(out)
    }

    /// The same picture `width` columns wide: averaged when it becomes smaller, with visible pixels
    /// when it becomes larger.
    pub fn scaled_to(&self, width: usize) -> Result<Self> {
        let [w, h] = self.size();
        let height = (h * width).div_ceil(w).max(1);
        if width < w {
            let lattice = self.samples.domain().resized([width, height])?;
            let mut samples = Spline::interpolate(&self.samples).resample(&lattice)?;
            samples.as_planar_mut().iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
            let domain = Domain::unit([width, height])?;
            return Ok(Self {
                samples: Samples::from_planar(domain, samples.as_planar().to_vec())?,
            });
        }
        let mut out = Self::new(width, height, [0.0; 3])?;
        for y in 0..height {
            for x in 0..width {
                out.set([x, y], self.get([x * w / width, (y * w / width).min(h - 1)]));
            }
        }
        Ok(out)
    }

    /// Puts a picture on this one; what does not fit is cut off.
    pub fn put(&mut self, picture: &Self, at: [usize; 2]) {
        let ([w, h], [pw, ph]) = (self.size(), picture.size());
        for y in 0..ph.min(h.saturating_sub(at[1])) {
            for x in 0..pw.min(w.saturating_sub(at[0])) {
                self.set([at[0] + x, at[1] + y], picture.get([x, y]));
            }
        }
    }

    /// Writes a line of text, each font pixel `scale` pixels wide; what does not fit is cut off.
    pub fn write(&mut self, text: &str, at: [usize; 2], scale: usize, color: [f32; 3]) {
        let [w, h] = self.size();
        for (k, c) in text.chars().enumerate() {
            let rows = font::glyph(c);
            for (dx, dy) in
                (0..5 * scale).flat_map(|x| (0..font::HEIGHT * scale).map(move |y| (x, y)))
            {
                let [x, y] = [at[0] + k * font::ADVANCE * scale + dx, at[1] + dy];
                if rows[dy / scale] >> (4 - dx / scale) & 1 == 1 && x < w && y < h {
                    self.set([x, y], color);
                }
            }
        }
    }

    /// An 8-bit sRGB picture.
    pub fn to_image(&self) -> Result<Image> {
        let [w, h] = self.size();
        let mut image = Image::new(w, h, &["R", "G", "B"], self.samples.as_planar().to_vec())?;
        (image.sample, image.transfer) = (SampleType::U8, Transfer::Srgb);
        Ok(image)
    }

    fn get(&self, [x, y]: [usize; 2]) -> [f32; 3] {
        let k = y * self.size()[0] + x;
        [0, 1, 2].map(|c| self.samples.plane(c)[k])
    }

    fn set(&mut self, [x, y]: [usize; 2], color: [f32; 3]) {
        let k = y * self.size()[0] + x;
        (0..3).for_each(|c| self.samples.plane_mut(c)[k] = color[c]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaling_keeps_flat_colours_and_proportions() {
        let flat = Canvas::new(10, 4, [0.25, 0.5, 0.75]).unwrap();
        for width in [1, 5, 10, 35] {
            let scaled = flat.scaled_to(width).unwrap();
            assert_eq!(scaled.size(), [width, (4 * width).div_ceil(10)]);
            let worst = (0..3)
                .flat_map(|c| {
                    scaled.samples.plane(c).iter().map(move |v| (v - 0.25 * (c + 1) as f32).abs())
                })
                .fold(0.0, f32::max);
            assert!(worst < 1e-5, "{width}: {worst}");
        }
    }

    #[test]
    fn drawing_beyond_the_edge_is_cut_off() {
        let mut canvas = Canvas::new(8, 8, [0.0; 3]).unwrap();
        canvas.write("MM", [4, 4], 2, [1.0; 3]);
        canvas.put(&Canvas::new(5, 5, [0.5; 3]).unwrap(), [6, 20]);
        assert_eq!(canvas.get([4, 4]), [1.0; 3]);
        assert_eq!(canvas.get([0, 0]), [0.0; 3]);
    }
}
