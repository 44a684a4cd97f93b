//! npsolve.
