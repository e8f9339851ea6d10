//! The emitter of a row, and the row while its visible fractions still change.

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

    /// For [`crate::visibility::shaft::Shaft::pair`].
    pub(crate) fn triangle(&self) -> PatchTriangle<'_> {
        PatchTriangle::new(self.patch.0, &self.corners)
    }
}

/// One pair of a row, emitter to patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) patch: u32,
    /// The unoccluded form factor.
    pub(crate) unoccluded: f64,
    /// The visible fraction, 0 to 1.
    pub(crate) fraction: f64,
}

/// A row that is not finished: entries in ascending order of patches.
///
/// Two forms implement it: [`RowLists`] of the level *area*, three lists filled sixteen pairs at a time, and the pairs
/// of [`super::refine::Refiner`] of the level *tolerance*, with their nearness and their cell of prior variances.
pub(crate) trait UnfinishedRow {
    /// Σ F.
    fn sum(&self) -> f64;

    /// Returns whether something of a patch is visible.
    fn sees(&self, patch: u32) -> bool;

    /// Inserts pairs, or replaces the entries of their patches.
    fn insert(&mut self, pairs: &[super::refine::Pair]);

    fn entries(&self) -> impl Iterator<Item = Entry>;

    /// The visible fractions, in the order of [`Self::entries`].
    fn fractions(&mut self) -> impl Iterator<Item = &mut f64>;

    /// Number of hemicubes whose visible fractions the row averages, at least 1.
    fn samples(&self) -> usize;
}

/// A row of one or more hemicubes, as three lists.
pub(crate) struct RowLists<'r> {
    /// Ascending.
    pub(crate) patches: &'r mut Vec<u32>,
    pub(crate) fractions: &'r mut Vec<f64>,
    /// Unoccluded A_i F_ij.
    pub(crate) exchange_areas: &'r mut Vec<f64>,
    /// 1 / A_i.
    pub(crate) per_area: f64,
    pub(crate) samples: usize,
    /// True if the patch is so large that it has several hemicubes in any case ([`super::grain`]).
    pub(crate) is_large: bool,
}

impl RowLists<'_> {
    /// Bound of a row's work in units of that of one hemicube: the hemicubes along an edge, or a quarter of all n² of
    /// them, max(n, n²/4).
    pub(crate) fn work_units(&self) -> u64 {
        self.samples.isqrt().max(self.samples / 4) as u64
    }
}

impl UnfinishedRow for RowLists<'_> {
    fn sum(&self) -> f64 {
        let pairs = self.fractions.iter().zip(&*self.exchange_areas);
        self.per_area
            * pairs
                .map(|(fraction, exchange_area)| fraction * exchange_area)
                .sum::<f64>()
    }

    fn sees(&self, patch: u32) -> bool {
        let place = self.patches.binary_search(&patch);
        place.is_ok_and(|place| self.fractions[place] > 0.0)
    }

    fn insert(&mut self, pairs: &[super::refine::Pair]) {
        for pair in pairs.iter().filter(|pair| pair.fraction > 0.0) {
            match self.patches.binary_search(&pair.patch) {
                Ok(place) => self.fractions[place] = pair.fraction,
                Err(place) => {
                    self.patches.insert(place, pair.patch);
                    self.fractions.insert(place, pair.fraction);
                    self.exchange_areas.insert(place, pair.exchange_area);
                }
            }
        }
    }

    fn entries(&self) -> impl Iterator<Item = Entry> {
        let pairs = self.patches.iter().zip(&*self.fractions).zip(&*self.exchange_areas);
        pairs.map(|((&patch, &fraction), &exchange_area)| Entry {
            patch,
            unoccluded: exchange_area * self.per_area,
            fraction,
        })
    }

    fn fractions(&mut self) -> impl Iterator<Item = &mut f64> {
        self.fractions.iter_mut()
    }

    fn samples(&self) -> usize {
        self.samples.max(1)
    }
}
