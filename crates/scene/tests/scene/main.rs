//! Readers, generators and repairs of scenes.

mod ac3d;
mod buildings;
mod formats;
mod fuzz_corpus;
mod generate;
mod gltf;
mod meshes;
mod obj;
mod repair;
mod watertight;
