//! Stores, their balance and checks, what is solved on them, and the reference.

mod balance;
mod diagnose;
mod heat;
mod reference;
mod solve;
mod store;
