//! Readers, generators and repairs of scenes. Not `meshes.rs`, which counts all that is allocated, and is a program by itself.

mod ac3d;
mod buildings;
mod formats;
mod fuzz_corpus;
mod generate;
mod gltf;
mod losses;
mod obj;
mod repair;
mod watertight;
