//! The hemicube program.
fn main() {}
