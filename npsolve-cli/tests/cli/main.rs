//! The command line as its users meet it.

mod bad_input;
mod blend;
mod compare;
mod demo;
mod field_errors;
mod fit;
mod inspect;
mod neural;
mod render;
mod reproduce;
mod signals;
mod support;
