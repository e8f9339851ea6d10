//! Analyses of a stored matrix: checked, compared, added up by zones, balanced. Exchange factors of surfaces.

pub mod balance;
pub mod check;
pub mod compare;
pub mod exchange;
pub mod surfaces;
pub mod zones;
