//! What is made of a stored matrix: checked, compared, added up by object, balanced.

pub mod balance;
pub mod check;
pub mod compare;
pub mod zones;
