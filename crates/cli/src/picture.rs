//! Pictures: a canvas of pixels, scales and letters; triangles through a camera; the model and the matrix drawn on it;
//! and the sheet for diagrams.

pub(crate) mod canvas;
pub(crate) mod model;
pub(crate) mod raster;
pub(crate) mod sheet;
pub(crate) mod sparsity;
