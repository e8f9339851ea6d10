//! What is known of patches, on the model, in the files that other programs read; and the matrix as Parquet.
//!
//! | | |
//! |---|---|
//! | `.vtp`, `.vtu` | ParaView, VTK: polygons or cells with an array for each result |
//! | `.glb` | viewers, Blender, the web: glTF 2.0, one mesh an object, the colours of one result |
//! | `.ply` | mesh tools: every result a property of its face, the colours of one at faces and vertices |
//! | `.csv`, `.npz` | tables: a line or an element a patch |
//! | `.parquet` | the matrix as triplets (feature `parquet`) |
//!
//! Patches have the ids, the order and the orientation that they have in the matrix. Equal stores give equal bytes: no
//! file holds a clock. Files appear whole or not at all, and nothing is left of one that was cancelled.
//!
//! The writers are our own: crates for VTK and PLY want all of a file in memory as their own values, and both formats
//! are a header before plain arrays. What they write is opened by VTK, meshio, trimesh and Khronos's validator in the
//! tests.
//!
//! ```
//! use hemicube_export::{PatchFormat, PatchResults, WriteOptions, write_patches};
//! use hemicube_scene::{Axis, Patches, Subdivision, generate};
//! use std::sync::atomic::AtomicBool;
//! # use hemicube::accuracy::correct::Correction;
//! # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../hemicube/doc/room.rs")); }
//! # let folder = tempfile::tempdir()?;
//! # let store = room::stored(&folder.path().join("room.hemicube"), Correction::Pixel)?;
//! # let path = folder.path().join("room.vtp");
//!
//! // What a store knows of its patches, a result of your own, and where the patches are.
//! let mut results = PatchResults::read(&store, &[])?;
//! results.push("temperature", vec![293.15; results.patch_count()])?;
//! results.place(&Patches::new(&generate::cornell_box(), Subdivision::Split(2))?, Axis::Y)?;
//!
//! let format = PatchFormat::of(&path).ok_or("no format of patches")?;
//! let options = WriteOptions { overwrite: false, cancel: &AtomicBool::new(false) };
//! let bytes = write_patches(&results, &path, format, options)?;
//! assert_eq!(std::fs::metadata(&path)?.len(), bytes);
//! assert!(write_patches(&results, &path, format, options).is_err(), "what is there stays");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! No vtkio, no PLY crate to write with, because vtkio's last release that is none of a candidate is of March 2021, and
//! both want a file in memory as values of their own; the formats are a header before plain arrays. No `.mat`, because
//! the crates that write sparse ones (`mat5`, `matrw`) are first releases; MATLAB reads the triplets.
//!
//! No Arrow, no compression in Parquet, because two packed columns of indices are hardly more than a byte an entry,
//! mantissas do not compress, and both would cost more of the build than everything else of `export`.

mod ascii;
mod gltf;
#[cfg(feature = "parquet")]
mod parquet;
mod patches;
mod ply;
mod table;
mod vtk;
mod write;

#[cfg(feature = "parquet")]
pub use crate::parquet::write_parquet;
pub use patches::{Colors, Column, Legend, PatchResults, Values};
pub use write::{Error, PatchFormat, Result, WriteOptions, write_patches};
