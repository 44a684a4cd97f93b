use rayon::prelude::*;

use crate::Domain;

/// Rows that one task transposes and transforms: 16 f32 are one cache line of the source.
const BLOCK: usize = 16;

/// Distance from every sample to the nearest target sample, centre to centre, in physical units.
///
/// `target` says for a flat index (axis 0 contiguous) whether the sample is a target; targets have
/// distance 0. Without any target every distance is infinite. Pitches may differ per axis.
///
/// Exact up to rounding: the relative error is below `D + 1` f32 roundings. Linear time, two
/// buffers of `domain.len()` values; the result is the same for any number of threads.
///
/// Source: Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled Functions", Theory of
/// Computing 8, 2012, section 2: one lower envelope of parabolas per line and axis.
pub fn distance_to<const D: usize>(
    domain: &Domain<D>,
    target: impl Fn(usize) -> bool + Sync,
) -> Vec<f32> {
    transform(domain, target, Reach::Centre)
}

/// Distance from every sample centre to the nearest target *cell*, in physical units.
///
/// A sample owns the cell half a pitch around it, so that between a target and its neighbour the
/// boundary is half-way: a face neighbour of a target is half a pitch away. Everything else is as
/// in [`distance_to`].
pub fn distance_to_cells<const D: usize>(
    domain: &Domain<D>,
    target: impl Fn(usize) -> bool + Sync,
) -> Vec<f32> {
    transform(domain, target, Reach::Cell)
}

/// What the distance to a target sample is measured to.
#[derive(Clone, Copy, PartialEq)]
enum Reach {
    Centre,
    Cell,
}

fn transform<const D: usize>(
    domain: &Domain<D>,
    target: impl Fn(usize) -> bool + Sync,
    reach: Reach,
) -> Vec<f32> {
    let shape = domain.shape();
    // In units of the largest pitch no square overflows or becomes subnormal in f32.
    let unit = domain.pitch().into_iter().fold(0.0, f32::max);
    let step = domain.pitch().map(|h| f64::from(h) / f64::from(unit));
    let to_length = |line: &mut [f32]| line.iter_mut().for_each(|v| *v = v.sqrt() * unit);

    let mut data = vec![f32::INFINITY; domain.len()];
    data.par_chunks_mut(shape[0]).enumerate().for_each(|(k, line)| {
        first_axis(line, step[0], reach, |i| target(k * shape[0] + i));
    });
    if D == 1 {
        to_length(&mut data);
        return data;
    }
    // Every pass brings the next axis to the front, where its lines are contiguous; after D
    // passes the axes are back in their order.
    let mut other = vec![0.0; data.len()];
    for axis in 1..D {
        rotate(&data, shape[axis - 1], &mut other, |rows, scratch| {
            for line in rows.chunks_exact_mut(shape[axis]) {
                next_axis(line, step[axis], reach, scratch);
            }
        });
        std::mem::swap(&mut data, &mut other);
    }
    rotate(&data, shape[D - 1], &mut other, |rows, _| to_length(rows));
    other
}

/// Squared distance along one line, by a sweep in each direction.
fn first_axis(line: &mut [f32], step: f64, reach: Reach, target: impl Fn(usize) -> bool) {
    let mut last = None;
    for (i, v) in line.iter_mut().enumerate() {
        last = if target(i) { Some(i) } else { last };
        *v = last.map_or(f32::INFINITY, |last| (i - last) as f32);
    }
    let (mut next, margin) = (None, if reach == Reach::Cell { 0.5 } else { 0.0 });
    for (i, v) in line.iter_mut().enumerate().rev() {
        next = if *v == 0.0 { Some(i) } else { next };
        let steps = next.map_or(*v, |next| v.min((next - i) as f32));
        let distance = (f64::from(steps) - margin).max(0.0) * step;
        *v = (distance * distance) as f32;
    }
}

/// A parabola of the lower envelope, in units of the pitch along the line.
#[derive(Clone, Copy)]
struct Parabola {
    /// Position of the minimum.
    at: f64,
    /// Value at the minimum.
    height: f64,
}

impl Parabola {
    fn value(self, x: f64) -> f64 {
        (x - self.at) * (x - self.at) + self.height
    }
}

/// Takes the other axes' squared distances along one line and adds this axis.
///
/// Measured to cells, a target's reach begins at its two faces: the parabolas then stand on the
/// `n + 1` faces of the line, each with the lower of its two neighbours.
fn next_axis(line: &mut [f32], step: f64, reach: Reach, hull: &mut Vec<Parabola>) {
    hull.clear();
    let (square, per_square) = (step * step, 1.0 / (step * step));
    let mut before = f32::INFINITY;
    for (i, &v) in line.iter().enumerate() {
        let (at, v_here) = match reach {
            Reach::Centre => (i as f64, v),
            Reach::Cell => (i as f64 - 0.5, v.min(before)),
        };
        // Only the ends of a run of targets are ever the nearest.
        let inside_run = before == 0.0 && v == 0.0 && line.get(i + 1) == Some(&0.0);
        if v_here < f32::INFINITY && !inside_run {
            add_parabola(hull, Parabola { at, height: f64::from(v_here) * per_square });
        }
        before = v;
    }
    if reach == Reach::Cell && before < f32::INFINITY {
        let (at, height) = (line.len() as f64 - 0.5, f64::from(before) * per_square);
        add_parabola(hull, Parabola { at, height });
    }
    evaluate(hull, square, line);
}

/// Appends a parabola to the envelope; it stands to the right of all others.
fn add_parabola(hull: &mut Vec<Parabola>, new: Parabola) {
    while let [.., a, b] = hull[..] {
        // `a` meets `b` at (a.at + b.at + rise / run) / 2, likewise `b` and `new`. Where the
        // second point is not to the right of the first, `b` is nowhere the lowest. Written
        // without divisions, which would take half of the whole time.
        let (run, new_run) = (b.at - a.at, new.at - b.at);
        let (rise, new_rise) = (b.height - a.height, new.height - b.height);
        if (new.at - a.at) * run * new_run + new_rise * run > rise * new_run {
            break;
        }
        hull.pop();
    }
    hull.push(new);
}

/// Writes the envelope, times `square`, over the line where it is lower.
fn evaluate(hull: &[Parabola], square: f64, line: &mut [f32]) {
    let Some((&first, mut rest)) = hull.split_first() else { return };
    let mut lowest = first;
    for (i, v) in line.iter_mut().enumerate() {
        let x = i as f64;
        let mut value = lowest.value(x);
        while let Some((&next, after)) = rest.split_first() {
            let next_value = next.value(x);
            if next_value > value {
                break;
            }
            (lowest, value, rest) = (next, next_value, after);
        }
        *v = v.min((value * square) as f32);
    }
}

/// Transposes `src`, rows of length `n`, into `dst`, and hands each task's finished rows (of length
/// `src.len() / n`) to `then` while they are in the cache.
fn rotate(
    src: &[f32],
    n: usize,
    dst: &mut [f32],
    then: impl Fn(&mut [f32], &mut Vec<Parabola>) + Sync,
) {
    let rows = src.len() / n;
    dst.par_chunks_mut(rows * BLOCK).enumerate().for_each_init(Vec::new, |scratch, (k, chunk)| {
        let (left, width) = (k * BLOCK, chunk.len() / rows);
        for top in (0..rows).step_by(BLOCK) {
            let height = BLOCK.min(rows - top);
            let mut tile = [[0.0; BLOCK]; BLOCK];
            for i in 0..height {
                let from = &src[(top + i) * n + left..][..width];
                for j in 0..width {
                    tile[j][i] = from[j];
                }
            }
            for j in 0..width {
                chunk[j * rows + top..][..height].copy_from_slice(&tile[j][..height]);
            }
        }
        then(chunk, scratch);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Unit;
    use proptest::prelude::*;

    /// `D + 1` roundings of half a unit in the last place, D = 4.
    const RELATIVE_TOLERANCE: f64 = 5.0 * 6e-8;

    /// The definition: the nearest target over all pairs. `margin` is the part of a pitch, 0 or a
    /// half, by which a target reaches beyond its centre.
    fn brute_force<const D: usize>(domain: &Domain<D>, mask: &[bool], margin: f64) -> Vec<f64> {
        let pitch = domain.pitch().map(f64::from);
        let squared = |a: usize, b: usize| -> f64 {
            let (a, b) = (domain.unflatten(a), domain.unflatten(b));
            let gap = |d: usize| (a[d].abs_diff(b[d]) as f64 - margin).max(0.0) * pitch[d];
            (0..D).map(|d| gap(d).powi(2)).sum()
        };
        let targets: Vec<usize> = (0..mask.len()).filter(|k| mask[*k]).collect();
        (0..mask.len())
            .map(|k| targets.iter().map(|t| squared(k, *t)).fold(f64::INFINITY, f64::min).sqrt())
            .collect()
    }

    fn check<const D: usize>(shape: [usize; D], pitch: [f32; D], mask: &[bool]) {
        let domain = Domain::new(shape, pitch, [3.0; D], Unit::Millimetre).unwrap();
        let mask = &mask[..domain.len()];
        let centres = distance_to(&domain, |k| mask[k]);
        let cells = distance_to_cells(&domain, |k| mask[k]);
        for (got, margin) in [(centres, 0.0), (cells, 0.5)] {
            for (got, want) in got.into_iter().zip(brute_force(&domain, mask, margin)) {
                let same = f64::from(got) == want;
                let error = (f64::from(got) - want).abs();
                assert!(same || error <= RELATIVE_TOLERANCE * want, "{shape:?}: {got} {want}");
            }
        }
    }

    fn sparse_mask(len: usize) -> impl Strategy<Value = Vec<bool>> {
        (0.02..0.9_f64).prop_flat_map(move |p| prop::collection::vec(prop::bool::weighted(p), len))
    }

    proptest! {
        #[test]
        fn matches_brute_force_1d(n in 1..60_usize, h in 0.1..9.0_f32, mask in sparse_mask(60)) {
            check([n], [h], &mask);
        }

        #[test]
        fn matches_brute_force_2d(
            shape in prop::array::uniform2(1..23_usize),
            pitch in prop::array::uniform2(0.1..9.0_f32),
            mask in sparse_mask(23 * 23),
        ) {
            check(shape, pitch, &mask);
        }

        #[test]
        fn matches_brute_force_3d(
            shape in prop::array::uniform3(1..8_usize),
            pitch in prop::array::uniform3(0.1..9.0_f32),
            mask in sparse_mask(512),
        ) {
            check(shape, pitch, &mask);
        }

        #[test]
        fn matches_brute_force_4d(
            shape in prop::array::uniform4(1..5_usize),
            mask in sparse_mask(256),
        ) {
            check(shape, [1.0, 0.25, 3.0, 0.5], &mask);
        }
    }

    #[test]
    fn no_target_is_infinitely_far() {
        let domain = Domain::unit([5, 4, 3]).unwrap();
        assert!(distance_to(&domain, |_| false).iter().all(|v| *v == f32::INFINITY));
        assert!(distance_to_cells(&domain, |_| false).iter().all(|v| *v == f32::INFINITY));
        assert!(distance_to(&domain, |_| true).iter().all(|v| *v == 0.0));
    }

    #[test]
    fn extreme_pitches_neither_overflow_nor_vanish() {
        for h in [1e-30_f32, 1e30] {
            check([7, 6], [h, 1.5 * h], &[[false; 20].as_slice(), &[true], &[false; 30]].concat());
        }
    }

    #[test]
    fn same_bits_for_any_thread_count() {
        let domain = Domain::new([37, 53, 5], [1.0, 0.7, 2.5], [0.0; 3], Unit::Sample).unwrap();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| distance_to(&domain, |k| k * 7919 % 1009 < 3))
        };
        assert_eq!(run(1), run(3));
    }
}
