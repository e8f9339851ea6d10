//! Form-factor matrices by the hemicube method.

pub mod store;
pub mod export;
pub mod check;
pub mod compare;
