//! Close hemicubes, and the rungs of the accuracy ladder, over the CPU backend.

mod close;
mod ladder;
