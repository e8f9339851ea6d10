//! Runs: which rows, with what settings, in which order, on how many threads, to where.

pub mod compute;
pub mod probe;
pub mod selection;
pub mod settings;
pub mod storage_policy;
