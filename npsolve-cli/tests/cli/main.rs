//! The command line as its users meet it.

mod bad_input;
mod blend;
mod compare;
mod compare_signals;
mod demo;
mod field_errors;
mod fit;
mod fit_signals;
mod inspect;
mod large;
mod layers;
mod neural;
mod render;
mod reproduce;
mod signals;
mod support;
mod volumes;
