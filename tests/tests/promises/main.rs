//! What is promised of rows: closed forms and the reference at each tolerance, extremes, the same bits whatever computes
//! them, and the source's own order.

mod balance;
mod closed_room;
mod covered;
mod culling;
mod dependencies;
mod determinism;
mod double;
mod exact_extremes;
mod extremes;
mod fractions;
mod golden_bits;
mod large_patches;
mod layers;
mod layout;
mod patches;
mod random_pairs;
mod reference;
mod reference_cases;
mod scoreboard;
mod sealed;
mod shares;
mod tolerance;
mod tradeoff;
