//! Laws, oracles and real scenes: what blends of every kind must fulfil, in one program, because each
//! program that uses the solver has to compile it for every dimension.

mod exact_matches_reference;
mod laws;
mod laws_of_the_minimum;
mod laws_under_refinement;
mod metrics;
mod neural;
mod scenes;
