//! Proof of the pairs of a row that no ray measured: an empty shaft is full visibility, a region in front of all of the
//! receiver full occlusion.
//!
//! A hemicube's fraction of a pair that nothing hides is 1 but for pixels on its edges. A store in f64 keeps the digits
//! of such pairs, so their fractions are proved: a shaft a pair, within the row's bound of steps.

use super::{Refined, Refiner};
use crate::accuracy::row::Emitter;
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::segments::Obstacles;
use crate::visibility::shaft::PatchTriangle;

impl Refiner<'_> {
    /// Sets the fractions of seen, unmeasured pairs that a shaft proves; others stay. Rows that meet the bound are cut
    /// short.
    pub(super) fn prove_seen(&mut self, emitter: &Emitter<'_>, most_steps: u64, refined: &mut Refined) {
        let regions = CoplanarRegions::of(emitter.model);
        let obstacles = Obstacles::new(emitter.model, &regions);
        for place in 0..self.pairs.len() {
            if self.is_measured[place] || self.pairs[place].fraction <= 0.0 {
                continue;
            }
            if refined.steps >= most_steps || self.is_cancelled() {
                refined.cut_short = true;
                break;
            }
            let patch = self.pairs[place].patch;
            let corners = emitter.model.normalised_corners(patch);
            self.shaft.clear();
            let triangles = self
                .shaft
                .pair(obstacles, emitter.triangle(), PatchTriangle::new(patch, &corners));
            refined.shafts += 1;
            refined.steps += triangles.steps;
            if let Some(fraction) = triangles.proved_fraction() {
                self.pairs[place].fraction = fraction;
            }
        }
    }
}
