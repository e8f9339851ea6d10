//! Analyses of a stored matrix: checked, compared, added up by zones, balanced. Interchange factors of surfaces.

pub mod balance;
pub mod check;
pub mod compare;
pub mod exchange;
pub mod interchange;
pub mod surfaces;
pub mod zones;
