//! Which patches an emitter could see, by a bound of the form factor over all patches of the scene.
//!
//! With d the least distance of the spheres round the two, h_j and h_i the greatest heights of each above the other's plane:
//!
//! ```text
//! F_ij ≤ min(1, A_j / A_i, A_j / (π d²) · min(1, h_j / d) · min(1, h_i / d))
//! ```

use super::visibility::Sight;
use crate::Model;
use glam::DVec3;
use std::f64::consts::PI;

/// Bounds of one emitter's form factors. Used for one row after the other.
#[derive(Debug, Default)]
pub(super) struct Facing {
    /// By patch; 0 where neither faces the other.
    bounds: Vec<f64>,
    /// The patches with a bound, the largest bound first.
    patches: Vec<u32>,
}

impl Facing {
    pub(super) fn find(&mut self, model: &Model, emitter: &Sight) {
        let tolerance = model.geometry().plane_tolerance;
        let center = emitter.centroid();
        let radius = emitter
            .corners
            .map(|p| p.distance(center))
            .into_iter()
            .fold(0.0, f64::max);
        self.bounds.clear();
        self.patches.clear();
        for patch in 0..model.geometry().patch_count {
            let bound = bound(emitter, (center, radius), &model.normalised_corners(patch), tolerance);
            self.bounds.push(bound);
            if bound > 0.0 {
                self.patches.push(patch);
            }
        }
        let bounds = &self.bounds;
        self.patches
            .sort_unstable_by(|&p, &q| bounds[q as usize].total_cmp(&bounds[p as usize]).then(p.cmp(&q)));
    }

    pub(super) fn bound(&self, patch: u32) -> f64 {
        self.bounds[patch as usize]
    }

    /// The patches whose bound is `least` or more.
    pub(super) fn from(&self, least: f64) -> &[u32] {
        let count = self.patches.partition_point(|&patch| self.bound(patch) >= least);
        &self.patches[..count]
    }

    /// Whether every patch that faces the emitter has a bound of `least` or more.
    pub(super) fn are_all_from(&self, least: f64) -> bool {
        self.from(least).len() == self.patches.len()
    }

    /// A bound that at most `count` patches have.
    pub(super) fn least_of(&self, count: usize) -> f64 {
        match self.patches.get(count) {
            // Just above that of the first patch too many.
            Some(&patch) => self.bound(patch).next_up(),
            None => 0.0,
        }
    }
}

fn bound(emitter: &Sight, (center, radius): (DVec3, f64), corners: &[DVec3; 3], tolerance: f64) -> f64 {
    let [a, b, c] = *corners;
    let height = corners.map(|p| emitter.height(p)).into_iter().fold(0.0, f64::max);
    if height <= tolerance {
        return 0.0;
    }
    let cross = (b - a).cross(c - a);
    let twice_area = cross.length();
    // A patch without area has no plane: not a number, which is not above it.
    let above = emitter
        .corners
        .map(|p| cross.dot(p - a) / twice_area)
        .into_iter()
        .fold(0.0, f64::max);
    if above <= tolerance {
        return 0.0;
    }
    let area = 0.5 * twice_area;
    let by_area = (area / emitter.area).min(1.0);
    let own = (a + b + c) / 3.0;
    let reach = radius + corners.map(|p| p.distance(own)).into_iter().fold(0.0, f64::max);
    let distance = own.distance(center) - reach;
    if distance <= 0.0 {
        return by_area;
    }
    let cosines = (height / distance).min(1.0) * (above / distance).min(1.0);
    by_area.min(area * cosines / (PI * distance * distance))
}
