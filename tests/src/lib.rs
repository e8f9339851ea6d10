//! Shared parts of the workspace's tests: real scenes and when to skip, the public cases, geometry with closed forms,
//! scenes at the extremes, requirements on backends on devices, rays in f64 to check item buffers, rows in memory,
//! plugins to load, and other programs that read our files.
//!
//! | variable | meaning |
//! | --- | --- |
//! | `HEMICUBE_SCENES` | the folder of real scenes; otherwise `../shared/scenes` beside the workspace |
//! | `HEMICUBE_BOARD=all` | the scoreboard computes every cell anew, not those of a minute |
//! | `HEMICUBE_REQUIRE_SCENES=1` | a test that would skip for want of a scene, or of what unpacks it, fails |
//! | `HEMICUBE_TEST_BACKEND` | the backend that tests of form factors run over, in place of the built-in one |
//! | `HEMICUBE_REQUIRE_BACKENDS` | names of backends, with commas: a test that would skip for want of a device fails |
//! | `HEMICUBE_PYTHON` | a Python with NumPy, SciPy, and better with meshio, trimesh, DuckDB, rasterio and xarray; otherwise `python3` |
//! | `HEMICUBE_REQUIRE_PYTHON=1` | a test that would skip for want of one fails |
//! | `HEMICUBE_NODE_MODULES` | where npm installed gltf-validator |
//! | `HEMICUBE_REQUIRE_NODE=1` | a test that would skip for want of it or of Node fails |
//! | `HEMICUBE_REQUIRE_OCTAVE=1` | a test of `./test --full` that would skip for want of GNU Octave fails |
//! | `HEMICUBE_REQUIRE_SOLVERS=1` | a test that would skip for want of CalculiX, OpenFOAM or petsc4py fails |
//! | `HEMICUBE_MDBOOK` | mdbook, which makes web pages of `docs` |
//! | `HEMICUBE_REQUIRE_MDBOOK=1` | a test that would skip for want of it fails |
//! | `HEMICUBE_REQUIRE_BROWSER=1` | a test that would skip for want of Chromium and its driver fails |
//! | `HEMICUBE_REQUIRE_DISPLAY=1` | a test that would skip for want of Xvfb and xwd fails |
//! | `HEMICUBE_REQUIRE_BITS=1` | a test that would skip off Linux on x86-64 fails |
//! | `HEMICUBE_REQUIRE_CLUSTER=1` | a test that would skip for want of Slurm, MPI or root fails |

/// The page's backend in Rust compiles.
#[cfg(doctest)]
#[doc = include_str!("../../docs/plugins.md")]
struct PluginsPage;

/// The page's programs run.
#[cfg(doctest)]
#[doc = include_str!("../../docs/embedding.md")]
struct EmbeddingPage;

pub mod bits;
pub mod board;
pub mod browser;
pub mod cases;
pub mod devices;
pub mod extremes;
pub mod geometry;
pub mod golden;
pub mod matrices;
pub mod plugins;
pub mod promise;
pub mod quadrature;
pub mod random;
pub mod rays;
pub mod readers;
pub mod rooms;
pub mod rows;
pub mod runs;
pub mod scenes;
pub mod weather;
