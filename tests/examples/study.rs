//! The study of algorithms on this machine: `cargo run --release -p hemicube-tests --example study -- --quick`.

use std::process::ExitCode;

fn main() -> ExitCode {
    hemicube_cli::study()
}
