use crate::Region;

/// The points of any of several regions; empty without children.
///
/// The signed distance is the smallest one: exact outside, an upper bound inside (a child's
/// boundary that another child covers is still counted). The weight is the largest.
#[derive(Default)]
pub struct Union<const D: usize> {
    /// The regions joined.
    pub children: Vec<Box<dyn Region<D>>>,
}

impl<const D: usize> Union<D> {
    /// Joins regions.
    pub fn new(children: Vec<Box<dyn Region<D>>>) -> Self {
        Self { children }
    }
}

impl<const D: usize> Region<D> for Union<D> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        self.children.iter().map(|r| r.signed_distance(x)).fold(f32::INFINITY, f32::min)
    }

    fn weight(&self, x: &[f32; D]) -> f32 {
        self.children.iter().map(|r| r.weight(x)).fold(0.0, f32::max)
    }
}

/// The points that several regions have in common; all of space without children.
///
/// The signed distance is the largest one: exact inside, a lower bound outside. The weight is the
/// smallest.
#[derive(Default)]
pub struct Intersection<const D: usize> {
    /// The regions intersected.
    pub children: Vec<Box<dyn Region<D>>>,
}

impl<const D: usize> Intersection<D> {
    /// Intersects regions.
    pub fn new(children: Vec<Box<dyn Region<D>>>) -> Self {
        Self { children }
    }
}

impl<const D: usize> Region<D> for Intersection<D> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        self.children.iter().map(|r| r.signed_distance(x)).fold(f32::NEG_INFINITY, f32::max)
    }

    fn weight(&self, x: &[f32; D]) -> f32 {
        self.children.iter().map(|r| r.weight(x)).fold(1.0, f32::min)
    }
}

/// The points outside a region. The distance is as exact as the region's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Complement<R>(
    /// The region left out.
    pub R,
);

impl<const D: usize, R: Region<D>> Region<D> for Complement<R> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        -self.0.signed_distance(x)
    }

    fn weight(&self, x: &[f32; D]) -> f32 {
        1.0 - self.0.weight(x)
    }
}

/// A region moved by an offset. The distance is as exact as the region's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Translated<R, const D: usize> {
    /// The region in its own coordinates.
    pub region: R,
    /// Where its coordinate origin goes, in physical units.
    pub offset: [f32; D],
}

impl<const D: usize, R: Region<D>> Translated<R, D> {
    fn to_own_coordinates(&self, x: &[f32; D]) -> [f32; D] {
        std::array::from_fn(|d| x[d] - self.offset[d])
    }
}

impl<const D: usize, R: Region<D>> Region<D> for Translated<R, D> {
    fn signed_distance(&self, x: &[f32; D]) -> f32 {
        self.region.signed_distance(&self.to_own_coordinates(x))
    }

    fn weight(&self, x: &[f32; D]) -> f32 {
        self.region.weight(&self.to_own_coordinates(x))
    }

    fn weights_along(&self, x: &[f32; D], step: f32, weights: &mut [f32]) {
        self.region.weights_along(&self.to_own_coordinates(x), step, weights);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoxRegion, Ellipsoid};
    use proptest::prelude::*;

    fn ball() -> Ellipsoid<2> {
        Ellipsoid::ball([0.0, 0.0], 2.0).unwrap()
    }

    fn slab() -> BoxRegion<2> {
        BoxRegion::new([-1.0, -3.0], [4.0, 0.5]).unwrap()
    }

    fn point() -> impl Strategy<Value = [f32; 2]> {
        prop::array::uniform2(-5.0..5.0_f32)
    }

    proptest! {
        #[test]
        fn membership_is_boolean_algebra(x in point()) {
            let inside = |r: &dyn Region<2>| (r.signed_distance(&x) < 0.0, r.weight(&x) == 1.0);
            let (a, b) = (inside(&ball()).0, inside(&slab()).0);
            let union = Union::new(vec![Box::new(ball()), Box::new(slab())]);
            let both = Intersection::new(vec![Box::new(ball()), Box::new(slab())]);
            let outside = Complement(ball());
            let difference = Intersection::new(vec![Box::new(ball()), Box::new(Complement(slab()))]);
            prop_assert_eq!(inside(&union), (a || b, a || b));
            prop_assert_eq!(inside(&both), (a && b, a && b));
            prop_assert_eq!(inside(&outside), (!a, !a));
            prop_assert_eq!(inside(&difference), (a && !b, a && !b));
        }

        /// De Morgan: the complement of a union is the intersection of the complements.
        #[test]
        fn complement_of_a_union(x in point()) {
            let union = Complement(Union::new(vec![Box::new(ball()), Box::new(slab())]));
            let parts: Vec<Box<dyn Region<2>>> =
                vec![Box::new(Complement(ball())), Box::new(Complement(slab()))];
            let intersection = Intersection::new(parts);
            prop_assert_eq!(union.signed_distance(&x), intersection.signed_distance(&x));
            prop_assert_eq!(union.weight(&x), intersection.weight(&x));
        }

        #[test]
        fn union_is_exact_outside(x in point()) {
            let union = Union::new(vec![Box::new(ball()), Box::new(slab())]);
            prop_assume!(union.weight(&x) == 0.0);
            let want = ball().signed_distance(&x).min(slab().signed_distance(&x));
            prop_assert_eq!(union.signed_distance(&x), want);
        }

        /// Quarter steps: sums and differences are exact in f32.
        #[test]
        fn translation_moves_the_region(x in prop::array::uniform2(-20..20_i32)) {
            let x = x.map(|v| v as f32 * 0.25);
            let moved = Translated { region: ball(), offset: [1.5, -0.25] };
            let ball_there = Ellipsoid::ball([1.5, -0.25], 2.0).unwrap();
            prop_assert_eq!(moved.signed_distance(&x), ball_there.signed_distance(&x));
            prop_assert_eq!(moved.weight(&x), ball_there.weight(&x));
        }
    }

    #[test]
    fn without_children_nothing_and_everything() {
        let (nothing, everything) = (Union::<1>::default(), Intersection::<1>::default());
        assert_eq!((nothing.signed_distance(&[0.0]), nothing.weight(&[0.0])), (f32::INFINITY, 0.0));
        assert_eq!(everything.signed_distance(&[0.0]), f32::NEG_INFINITY);
        assert_eq!(everything.weight(&[0.0]), 1.0);
    }
}
