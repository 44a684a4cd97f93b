//! Laws, oracles and real scenes: what blends of every kind must fulfil, in one program, because each
//! program that uses the solver has to compile it for every dimension.

/// A module per law, named as the law is, with one test per dimension.
macro_rules! in_dimensions {
    ($($law:ident: $($kind:ident<$($size:literal),+>),+;)+) => {$(
        mod $law {
            $(#[test]
            fn $kind() {
                super::$law::<$($size),+>();
            })+
        }
    )+};
}

/// The same with coordinates and channels of every kind of signal.
macro_rules! in_every_dimension {
    ($($law:ident;)+) => {
        in_dimensions! {
            $($law: audio<1, 2>, image<2, 3>, volume<3, 1>, light_field<4, 1>, radiance<5, 1>;)+
        }
    };
}

mod exact_matches_reference;
mod jets;
mod laws;
mod laws_of_the_minimum;
mod laws_under_refinement;
mod metrics;
mod neural;
mod radiance;
mod scenes;
