//! What is computed from a stored form-factor matrix: light and heat ([`solve`]), and analyses ([`analysis`]). Nothing
//! here knows how rows were made.

pub mod analysis;
pub mod groups;
pub mod solve;
