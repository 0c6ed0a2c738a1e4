//! The graph of keyframes: which places are certain relative to each other.

mod certainty;

pub use certainty::{CertaintyGraph, Gate, Reached, Uncertainty};
