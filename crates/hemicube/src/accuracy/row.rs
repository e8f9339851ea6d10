//! The emitter of a row.

use crate::Model;
use crate::geometry;
use crate::visibility::shaft::PatchTriangle;
use glam::DVec3;
use hemicube_scene::InputPatch;

/// An emitting patch of a scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Emitter<'m> {
    pub(crate) model: &'m Model,
    pub(crate) patch: InputPatch,
    /// In normalised coordinates.
    pub(crate) corners: [DVec3; 3],
    /// In squared normalised units.
    pub(crate) area: f64,
}

impl<'m> Emitter<'m> {
    pub(crate) fn new(model: &'m Model, patch: InputPatch) -> Self {
        let corners = model.normalised_corners(patch.0);
        Self {
            model,
            patch,
            corners,
            area: geometry::area(&corners),
        }
    }

    /// The number by which random numbers are drawn for it.
    pub(crate) fn number(&self) -> u32 {
        self.model.number_of(self.patch.0)
    }

    /// For [`crate::visibility::shaft::Shaft::pair`].
    pub(crate) fn triangle(&self) -> PatchTriangle<'_> {
        PatchTriangle::new(self.patch.0, &self.corners)
    }
}
