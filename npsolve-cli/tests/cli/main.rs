//! The command line as its users meet it.

mod bad_input;
mod blend;
mod compare;
mod inspect;
mod support;
