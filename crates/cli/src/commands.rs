//! The subcommands, one file each.

pub(crate) mod backends;
pub(crate) mod balance;
pub(crate) mod check;
pub(crate) mod compare;
pub(crate) mod compute;
pub(crate) mod exchange;
pub(crate) mod export;
pub(crate) mod generate;
pub(crate) mod inspect;
pub(crate) mod interactive;
pub(crate) mod manual;
pub(crate) mod merge;
pub(crate) mod points;
pub(crate) mod report;
pub(crate) mod sky;
pub(crate) mod solve;
pub(crate) mod suns;
pub(crate) mod tradeoff;
pub(crate) mod view;
pub(crate) mod view3d;
