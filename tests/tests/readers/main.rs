//! Scenes as they come: every format and real file, wrong ones, hostile ones, and what is said of each.

mod inspect;
mod losses;
mod mutants;
mod rasters;
mod real_scenes;
mod same_room;
mod up;
mod wrong_scenes;
mod zones;
