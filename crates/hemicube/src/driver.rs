//! Runs: from a scene to rows of its matrix. [`job`] conducts a run; the others are its steps.

mod aggregate;
pub mod calibrate;
pub mod compute;
pub mod glazing;
pub mod input;
pub mod job;
pub mod level;
mod plan;
pub mod probe;
mod queue;
pub mod room;
pub mod selection;
pub mod settings;
pub mod storage_policy;
pub mod update;
