//! One axis of a multigrid level: node positions, the 1-D Laplacian on them, and the transfer to
//! the next coarser axis. Everything the multigrid knows about borders and odd sizes is here.

/// What lies beyond a side of the solved box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The change vanishes one step beyond the last node.
    Zero,
    /// The signal ends here: whole-sample mirror extension, the natural boundary condition.
    Mirror,
}

/// Where index `i` of an axis with `n` nodes lives inside it, or `None` where the value is zero.
#[inline(always)]
pub fn ghost(i: isize, n: usize, ends: [End; 2]) -> Option<usize> {
    let n = n as isize;
    let mut i = i;
    loop {
        if i >= 0 && i < n {
            return Some(i as usize);
        }
        if n == 1 {
            let end = if i < 0 { ends[0] } else { ends[1] };
            return (end == End::Mirror).then_some(0);
        }
        i = match (i < 0, ends) {
            (true, [End::Mirror, _]) => -i,
            (false, [_, End::Mirror]) => 2 * (n - 1) - i,
            _ => return None,
        };
    }
}

/// Nodes of one axis, possibly unevenly spaced, and the second difference on them.
///
/// The operator along the axis is `minus[i] (u[i] - u[i-1]) + plus[i] (u[i] - u[i+1])`. It is
/// self-adjoint under the weights `volume`.
#[derive(Debug, Clone)]
pub struct Axis {
    pub ends: [End; 2],
    pub minus: Vec<f32>,
    pub plus: Vec<f32>,
    pub volume: Vec<f32>,
    /// Positions of nodes and of the fixed points beyond `Zero` ends.
    points: Vec<f64>,
    stiffness: f64,
}

/// Linear interpolation from a coarser axis, and its adjoint under the volumes.
#[derive(Debug, Clone)]
pub struct Transfer {
    /// Per fine node: coarse node, weight of it and of the next one.
    pub prolong: Vec<(usize, f32, f32)>,
    /// First fine node and number of pairs of them from where on nodes take turns being a coarse
    /// node and the mean of two.
    pub regular: (usize, usize),
    /// Per coarse node: first fine node and the weights from there on.
    pub restrict: Vec<(usize, Vec<f32>)>,
}

impl Transfer {
    fn new(prolong: Vec<(usize, f32, f32)>, restrict: Vec<(usize, Vec<f32>)>) -> Self {
        let copy = |i: usize| prolong[i].1 == 1.0 && prolong[i].2 == 0.0;
        let pair =
            |i: usize| copy(i) && prolong.get(i + 1).is_some_and(|p| p.1 == 0.5 && p.2 == 0.5);
        let first = (0..prolong.len()).find(|i| pair(*i)).unwrap_or(prolong.len());
        let pairs = (first..prolong.len()).step_by(2).take_while(|i| pair(*i)).count();
        Self { prolong, regular: (first, pairs), restrict }
    }
}

impl Axis {
    /// `n` nodes at unit distance; `stiffness` multiplies the second difference.
    pub fn uniform(n: usize, ends: [End; 2], stiffness: f32) -> Self {
        let extra = ends.iter().filter(|e| **e == End::Zero).count();
        Self::at((0..n + extra).map(|i| i as f64).collect(), ends, f64::from(stiffness))
    }

    fn at(points: Vec<f64>, ends: [End; 2], stiffness: f64) -> Self {
        let skip = usize::from(ends[0] == End::Zero);
        let n = points.len() - skip - usize::from(ends[1] == End::Zero);
        let gap = |i: isize| {
            let i = i + skip as isize;
            (i >= 1 && (i as usize) < points.len())
                .then(|| points[i as usize] - points[i as usize - 1])
        };
        let (mut minus, mut plus, mut volume) = (vec![0.0; n], vec![0.0; n], vec![1.0; n]);
        for i in 0..n {
            let (lo, hi) = (gap(i as isize), gap(i as isize + 1));
            let v = 0.5 * (lo.unwrap_or(0.0) + hi.unwrap_or(0.0));
            if v > 0.0 {
                volume[i] = v as f32;
                minus[i] = lo.map_or(0.0, |g| stiffness / (g * v)) as f32;
                plus[i] = hi.map_or(0.0, |g| stiffness / (g * v)) as f32;
            }
        }
        Self { ends, minus, plus, volume, points, stiffness }
    }

    pub fn len(&self) -> usize {
        self.minus.len()
    }

    /// The strongest coupling along the axis.
    pub fn strength(&self) -> f32 {
        self.minus.iter().chain(&self.plus).fold(0.0, |a, b| a.max(*b))
    }

    /// The axis with every second point, if at least two intervals remain. Both end points stay;
    /// with an odd number of intervals the last coarse one spans three. A shorter axis between two
    /// mirrors becomes a single node: its coupling would outgrow that of longer axes, on which a
    /// point smoother then does nothing.
    pub fn coarsen(&self) -> Option<(Axis, Transfer)> {
        let intervals = self.points.len() - 1;
        if intervals < 4 {
            return self.collapse();
        }
        let mut kept: Vec<usize> = (0..=intervals).step_by(2).collect();
        if intervals % 2 == 1 {
            *kept.last_mut().expect("two points at least") = intervals;
        }
        let coarse =
            Self::at(kept.iter().map(|k| self.points[*k]).collect(), self.ends, self.stiffness);
        let skip = usize::from(self.ends[0] == End::Zero);
        let mut prolong = Vec::with_capacity(self.len());
        let mut restrict = vec![(usize::MAX, Vec::new()); coarse.len()];
        for i in 0..self.len() {
            let j = i + skip;
            let k = (kept.partition_point(|p| *p <= j) - 1).min(kept.len() - 2);
            let (a, b) = (self.points[kept[k]], self.points[kept[k + 1]]);
            let t = (self.points[j] - a) / (b - a);
            let mut entry = (0, 0.0, 0.0);
            for (point, weight) in [(k, 1.0 - t), (k + 1, t)] {
                let Some(node) = point.checked_sub(skip).filter(|node| *node < coarse.len()) else {
                    continue;
                };
                if weight == 0.0 {
                    continue;
                }
                match () {
                    _ if point == k => entry = (node, weight as f32, entry.2),
                    _ if entry.1 != 0.0 => entry.2 = weight as f32,
                    _ => entry = (node, weight as f32, 0.0),
                }
                let row = &mut restrict[node];
                row.0 = row.0.min(i);
                row.1.resize(i - row.0, 0.0);
                row.1.push(weight as f32 * self.volume[i] / coarse.volume[node]);
            }
            prolong.push(entry);
        }
        Some((coarse, Transfer::new(prolong, restrict)))
    }

    /// The axis as a single node, its mean.
    fn collapse(&self) -> Option<(Axis, Transfer)> {
        if self.len() == 1 || self.ends != [End::Mirror; 2] {
            return None;
        }
        let mut coarse = Self::at(vec![self.points[0]], self.ends, self.stiffness);
        coarse.volume[0] = self.volume.iter().sum();
        let share = self.volume.iter().map(|v| v / coarse.volume[0]).collect();
        let transfer = Transfer::new(vec![(0, 1.0, 0.0); self.len()], vec![(0, share)]);
        Some((coarse, transfer))
    }

    /// The transfer of an axis that is not coarsened.
    pub fn identity(&self) -> Transfer {
        Transfer::new(
            (0..self.len()).map(|i| (i, 1.0, 0.0)).collect(),
            (0..self.len()).map(|i| (i, vec![1.0])).collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_axis(check: impl Fn(&Axis)) {
        for n in 3..20 {
            for lo in [End::Zero, End::Mirror] {
                for hi in [End::Zero, End::Mirror] {
                    check(&Axis::uniform(n, [lo, hi], 1.5));
                }
            }
        }
    }

    #[test]
    fn restriction_is_the_adjoint_of_prolongation() {
        every_axis(|fine| {
            let Some((coarse, t)) = fine.coarsen() else { return };
            let mut p = vec![vec![0.0f32; coarse.len()]; fine.len()];
            for (i, (k, a, b)) in t.prolong.iter().enumerate() {
                p[i][*k] += a;
                if *b != 0.0 {
                    p[i][k + 1] += b;
                }
            }
            for (k, (start, weights)) in t.restrict.iter().enumerate() {
                for i in 0..fine.len() {
                    let r =
                        i.checked_sub(*start).and_then(|j| weights.get(j)).copied().unwrap_or(0.0);
                    let want = p[i][k] * fine.volume[i] / coarse.volume[k];
                    assert!((r - want).abs() < 1e-6, "{} nodes {:?}", fine.len(), fine.ends);
                }
            }
        });
    }

    #[test]
    fn the_operator_is_self_adjoint_on_every_level() {
        every_axis(|fine| {
            let mut axis = fine.clone();
            while let Some((coarse, _)) = axis.coarsen() {
                for i in 1..coarse.len() {
                    let a = coarse.volume[i] * coarse.minus[i];
                    let b = coarse.volume[i - 1] * coarse.plus[i - 1];
                    assert!((a - b).abs() < 1e-5 * a);
                }
                axis = coarse;
            }
            assert!(axis.len() <= 4);
        });
    }

    #[test]
    fn ghosts_follow_the_ends() {
        use End::{Mirror, Zero};
        assert_eq!(ghost(-2, 4, [Mirror, Zero]), Some(2));
        assert_eq!(ghost(-4, 4, [Mirror, Zero]), None);
        assert_eq!(ghost(5, 4, [Zero, Mirror]), Some(1));
        assert_eq!(ghost(-1, 4, [Zero, Mirror]), None);
        assert_eq!(ghost(-3, 1, [Mirror, Zero]), Some(0));
        assert_eq!(ghost(-5, 3, [Mirror, Mirror]), Some(1));
    }
}
