//! Exports: the matrix, and the results of its patches on the model, as files for other programs.
//!
//! [`export`] writes the matrix, in an [`ExportFormat`]; [`export_for`] writes it for a radiation solver, a
//! [`SolverFormat`], with what that needs or not at all; [`write_patches`] writes [`PatchResults`], in a
//! [`PatchFormat`]. All formats come from one table, `formats.rs`.
//!
//! | matrix | |
//! |---|---|
//! | `.npz`, `.npy` | SciPy: CSR; NumPy: dense |
//! | `.mtx`, `.txt` | Matrix Market; MATLAB and Octave |
//! | `.parquet` | DuckDB, pyarrow, Spark: triplets (feature `parquet`) |
//!
//! | solver | |
//! |---|---|
//! | `petsc` | `MatLoad` |
//! | `view3d`, `view3d-binary`, `energyplus` | surfaces by name |
//! | `elmer`, `udales`, `openfoam`, `calculix` | faces of the mesh in its order |
//!
//! | patches | |
//! |---|---|
//! | `.vtp`, `.vtu` | ParaView, VTK: polygons or cells with an array for each result |
//! | `.glb` | viewers, Blender, the web: glTF 2.0, one mesh an object, the colours of one result |
//! | `.ply` | mesh tools: every result a property of its face, the colours of one at faces and vertices |
//! | `.csv`, `.npz` | tables: a line or an element a patch |
//!
//! [`parquet_table`] makes a Parquet file of any table of names and numbers.
//!
//! Patches keep the ids, the order and the orientation of the matrix. Equal stores give equal bytes: no file holds a
//! clock. Files appear whole or not at all, and a cancelled one leaves nothing. The tests open them with SciPy, VTK,
//! meshio, trimesh, DuckDB and Khronos's validator.
//!
//! ```
//! use hemicube_export::{PatchFormat, PatchResults, WriteOptions, write_patches};
//! use hemicube_scene::{Axis, Patches, Subdivision, generate};
//! use std::sync::atomic::AtomicBool;
//! # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
//! # let folder = tempfile::tempdir()?;
//! # let store = room::stored(&folder.path().join("room.hemicube"), 0.0)?;
//! # let path = folder.path().join("room.vtp");
//! # let mut scene = generate::cornell_box();
//! # scene.triangles.truncate(6); // as many as the store has patches
//!
//! // What a store knows of its patches, a result of your own, and where the patches are.
//! let mut results = PatchResults::read(&store, &[])?;
//! results.push("temperature", vec![293.15; results.patch_count()])?;
//! results.place(&Patches::new(&scene, Subdivision::None)?, Axis::Y)?;
//!
//! let format = PatchFormat::of(&path)?;
//! let options = WriteOptions { overwrite: false, cancel: &AtomicBool::new(false) };
//! let bytes = write_patches(&results, &path, format, options)?;
//! assert_eq!(std::fs::metadata(&path)?.len(), bytes);
//! assert!(write_patches(&results, &path, format, options).is_err(), "what is there stays");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! No vtkio and no PLY crate for writing, because vtkio's last full release is of March 2021, and both hold a file in
//! memory as values of their own; the formats are a header before plain arrays. No `.mat`, because the crates that
//! write sparse matrices (`mat5`, `matrw`) are first releases; MATLAB reads the triplets.
//!
//! No Arrow and no compression in Parquet, because two packed columns of indices take hardly more than a byte an entry,
//! mantissas do not compress, and both would cost more build time than the rest of this crate.

mod ascii;
mod faces;
mod formats;
mod matrix;
mod patches;
mod solvers;
mod table;
mod write;

pub use faces::{Found, Grouping, Needs, PROBES, RECIPROCITY_ERROR, SUM_ERROR, Sums};
pub use formats::{ExportFormat, Named, PatchFormat, SolverFormat, listed};
pub use matrix::{ExportOptions, ExportReport, export, export_with_sky, export_zones};
pub use patches::{Colors, Column, Legend, PatchResults, Values, scale_color};
pub use solvers::view3d::{View3dForm, View3dHead, write_view3d};
pub use solvers::{SolverOptions, SolverReport, Written, export_for};
pub use table::{TableColumn, parquet_table};
pub use write::{Error, Result, UnfitStep, WriteOptions, write_patches};
