//! The program as a user meets it: commands, exit codes, terminals, what interrupts it, and who attacks it.

mod cli;
mod compact;
mod distribution;
mod durability;
mod interactive;
mod missing_rows;
mod options;
mod security;
mod side_by_side;
mod store_mutants;
mod study;
mod update;
mod verdicts;
