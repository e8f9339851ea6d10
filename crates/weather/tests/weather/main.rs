//! What the weather crate promises, a module a subject.

mod clear;
mod comfort;
mod epw;
mod sky;
mod sun;
