//! Shaders are those that their sources make, and get the data that they want.

mod generated;
mod recording;
mod upload;
