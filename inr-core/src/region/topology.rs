use crate::{Domain, RasterMask};

impl<const D: usize> RasterMask<D> {
    /// Number of pieces of the inside; samples that share a face belong together.
    pub fn components(&self) -> usize {
        count_pieces(self.domain(), |k| self.is_inside(k), Connectivity::Face).total
    }

    /// Number of pieces of the outside that the mask encloses, which do not touch the border:
    /// holes of an image's mask, cavities of a volume's (tunnels are not counted).
    ///
    /// Outside samples belong together also across edges and corners, the dual of the inside's
    /// faces: two inside samples that touch at a corner leave the outside a way between them.
    pub fn holes(&self) -> usize {
        let pieces = count_pieces(self.domain(), |k| !self.is_inside(k), Connectivity::Full);
        pieces.total - pieces.at_border
    }

    /// Whether an inside sample is the first or last of an axis.
    pub fn touches_border(&self) -> bool {
        let shape = self.domain().shape();
        (0..self.domain().len()).any(|k| {
            let index = self.domain().unflatten(k);
            self.is_inside(k) && (0..D).any(|d| index[d] == 0 || index[d] + 1 == shape[d])
        })
    }
}

/// Which samples are neighbours.
#[derive(Clone, Copy, PartialEq)]
enum Connectivity {
    /// Those that share a face: one index differs by one.
    Face,
    /// Those that share a face, an edge or a corner: indices differ by at most one.
    Full,
}

/// How many connected pieces a set of samples has.
#[derive(Debug, PartialEq)]
struct Pieces {
    total: usize,
    /// Those with a sample that is the first or last of an axis.
    at_border: usize,
}

/// Member samples `begin..end` of one line along axis 0, with no member next to either end.
#[derive(Clone, Copy)]
struct Run {
    begin: usize,
    end: usize,
}

/// Counts the pieces of the set of member samples.
///
/// Joins the runs of every line with those of the neighbour lines before it by union-find: time
/// linear in the samples (times the inverse Ackermann function), memory linear in the runs.
fn count_pieces<const D: usize>(
    domain: &Domain<D>,
    is_member: impl Fn(usize) -> bool,
    connectivity: Connectivity,
) -> Pieces {
    let (shape, strides, width) = (domain.shape(), domain.strides(), domain.shape()[0]);
    let lines = domain.len() / width;
    let (mut runs, mut first) = (Vec::new(), vec![0]);
    for line in 0..lines {
        push_runs(width, |i| is_member(line * width + i), &mut runs);
        first.push(runs.len());
    }

    let mut parent: Vec<usize> = (0..runs.len()).collect();
    let mut at_border = vec![false; runs.len()];
    let neighbours = neighbours_before::<D>(connectivity);
    for line in 0..lines {
        let index = domain.unflatten(line * width);
        for step in &neighbours {
            // Wrapping: index 0 with step -1 becomes larger than any shape.
            let there: [usize; D] = std::array::from_fn(|d| index[d].wrapping_add_signed(step[d]));
            if (0..D).all(|d| there[d] < shape[d]) {
                let other = (0..D).map(|d| there[d] * strides[d]).sum::<usize>() / width;
                let (a, b) = (first[line]..first[line + 1], first[other]..first[other + 1]);
                join_overlapping(&runs, a, b, connectivity, &mut parent);
            }
        }
        let line_at_border = (1..D).any(|d| index[d] == 0 || index[d] + 1 == shape[d]);
        for run in first[line]..first[line + 1] {
            at_border[run] = line_at_border || runs[run].begin == 0 || runs[run].end == width;
        }
    }

    let roots: Vec<usize> = (0..runs.len()).map(|run| root(&mut parent, run)).collect();
    let mut root_at_border = vec![false; runs.len()];
    for (run, &root) in roots.iter().enumerate() {
        root_at_border[root] |= at_border[run];
    }
    Pieces {
        total: roots.iter().enumerate().filter(|(run, root)| run == *root).count(),
        at_border: root_at_border.into_iter().filter(|b| *b).count(),
    }
}

/// Appends the runs of one line.
fn push_runs(width: usize, is_member: impl Fn(usize) -> bool, runs: &mut Vec<Run>) {
    let mut begin = None;
    for i in 0..width {
        match (is_member(i), begin) {
            (true, None) => begin = Some(i),
            (false, Some(b)) => {
                runs.push(Run { begin: b, end: i });
                begin = None;
            }
            _ => {}
        }
    }
    runs.extend(begin.map(|begin| Run { begin, end: width }));
}

/// Index steps to the neighbour lines with a smaller flat index; the step along axis 0 is 0.
fn neighbours_before<const D: usize>(connectivity: Connectivity) -> Vec<[isize; D]> {
    let steps = (0..3_usize.pow(D as u32 - 1)).map(|code| {
        let digit = |d: usize| (code / 3_usize.pow(d as u32 - 1) % 3) as isize - 1;
        std::array::from_fn(|d| if d == 0 { 0 } else { digit(d) })
    });
    let is_before = |s: &[isize; D]| s.iter().rev().find(|v| **v != 0) == Some(&-1);
    let is_face = |s: &[isize; D]| s.iter().filter(|v| **v != 0).count() == 1;
    steps.filter(|s| is_before(s) && (connectivity == Connectivity::Full || is_face(s))).collect()
}

/// Joins the runs of two neighbour lines that touch, walking along both once.
fn join_overlapping(
    runs: &[Run],
    mut a: std::ops::Range<usize>,
    mut b: std::ops::Range<usize>,
    connectivity: Connectivity,
    parent: &mut [usize],
) {
    let slack = if connectivity == Connectivity::Full { 1 } else { 0 };
    while !a.is_empty() && !b.is_empty() {
        let (p, q) = (runs[a.start], runs[b.start]);
        if p.begin < q.end + slack && q.begin < p.end + slack {
            let (p, q) = (root(parent, a.start), root(parent, b.start));
            // The smaller index becomes the root: trees stay shallow with the path halving.
            parent[p.max(q)] = p.min(q);
        }
        // The run that ends first touches nothing further: runs have gaps between them.
        if p.end < q.end {
            a.start += 1;
        } else {
            b.start += 1;
        }
    }
}

/// The representative of a run's piece, halving the path to it.
fn root(parent: &mut [usize], mut run: usize) -> usize {
    while parent[run] != run {
        parent[run] = parent[parent[run]];
        run = parent[run];
    }
    run
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Flood fill, sample by sample.
    fn flood_fill<const D: usize>(
        domain: &Domain<D>,
        member: &[bool],
        connectivity: Connectivity,
    ) -> Pieces {
        let shape = domain.shape();
        let distance = |a: usize, b: usize| {
            let (a, b) = (domain.unflatten(a), domain.unflatten(b));
            let gaps: Vec<usize> = (0..D).map(|d| a[d].abs_diff(b[d])).collect();
            match connectivity {
                Connectivity::Face => gaps.iter().sum::<usize>(),
                Connectivity::Full => *gaps.iter().max().unwrap(),
            }
        };
        let (mut seen, mut pieces) = (vec![false; domain.len()], Pieces { total: 0, at_border: 0 });
        for start in 0..domain.len() {
            if !member[start] || seen[start] {
                continue;
            }
            let (mut stack, mut at_border) = (vec![start], false);
            seen[start] = true;
            while let Some(k) = stack.pop() {
                let index = domain.unflatten(k);
                at_border |= (0..D).any(|d| index[d] == 0 || index[d] == shape[d] - 1);
                for other in 0..domain.len() {
                    if member[other] && !seen[other] && distance(k, other) == 1 {
                        seen[other] = true;
                        stack.push(other);
                    }
                }
            }
            pieces.total += 1;
            pieces.at_border += usize::from(at_border);
        }
        pieces
    }

    fn check<const D: usize>(shape: [usize; D], bits: &[bool]) {
        let domain = Domain::unit(shape).unwrap();
        for connectivity in [Connectivity::Face, Connectivity::Full] {
            let got = count_pieces(&domain, |k| bits[k], connectivity);
            assert_eq!(got, flood_fill(&domain, bits, connectivity), "{shape:?}");
        }
    }

    proptest! {
        #[test]
        fn pieces_match_flood_fill(
            n in prop::array::uniform4(1..13_usize),
            bits in (0.1..0.9_f64).prop_flat_map(|p| prop::collection::vec(prop::bool::weighted(p), 1024)),
        ) {
            check([n[0]], &bits);
            check([n[0], n[1]], &bits);
            check([n[0], 1 + n[1] / 2, 1 + n[2] / 2], &bits);
            check([1 + n[0] / 3, 1 + n[1] / 4, 1 + n[2] / 4, 1 + n[3] / 4], &bits);
        }
    }

    fn image(rows: &[&str]) -> RasterMask<2> {
        let domain = Domain::unit([rows[0].len(), rows.len()]).unwrap();
        let weights = rows.concat().bytes().map(|b| if b == b'#' { 1.0 } else { 0.0 }).collect();
        RasterMask::new(domain, weights).unwrap()
    }

    #[test]
    fn ring_has_one_piece_and_one_hole() {
        let ring = image(&[".....", ".###.", ".#.#.", ".###.", "....."]);
        assert_eq!((ring.components(), ring.holes(), ring.touches_border()), (1, 1, false));
    }

    #[test]
    fn diagonal_ring_encloses_nothing() {
        let ring = image(&[".....", "..#..", ".#.#.", "..#..", "....."]);
        assert_eq!((ring.components(), ring.holes()), (4, 0));
    }

    #[test]
    fn bay_at_the_border_is_no_hole() {
        let bay = image(&["#.#", "###"]);
        assert_eq!((bay.components(), bay.holes(), bay.touches_border()), (1, 0, true));
    }

    #[test]
    fn hollow_cube_has_a_cavity() {
        let domain = Domain::unit([5, 5, 5]).unwrap();
        let shell = |k| {
            let far = domain.unflatten(k).map(|i| i.abs_diff(2)).into_iter().max();
            if far == Some(1) { 1.0 } else { 0.0 }
        };
        let mask = RasterMask::new(domain, (0..125).map(shell).collect()).unwrap();
        assert_eq!((mask.components(), mask.holes()), (1, 1));
    }

    #[test]
    fn empty_and_full_masks() {
        let (empty, full) = (image(&["...", "..."]), image(&["###", "###"]));
        assert_eq!((empty.components(), empty.holes(), empty.touches_border()), (0, 0, false));
        assert_eq!((full.components(), full.holes(), full.touches_border()), (1, 0, true));
    }
}
