//! Pictures: a canvas of pixels, scales and letters; triangles as a camera sees them; the model and the matrix drawn so;
//! and the sheet on which diagrams are laid out.

pub(crate) mod canvas;
pub(crate) mod model;
pub(crate) mod raster;
pub(crate) mod sheet;
pub(crate) mod sparsity;
