//! Patches that an emitter could see, by a bound of the form factor over all patches of the scene.
//!
//! With d the least distance of the spheres round the two, h_j and h_i the greatest heights of each above the other's
//! plane:
//!
//! ```text
//! F_ij ≤ min(1, A_j / A_i, A_j / (π d²) · min(1, h_j / d) · min(1, h_i / d))
//! ```

use super::visibility::Sight;
use crate::Model;
use crate::geometry::{self, Sphere};
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
    /// `is_apart` tells patches that a closed surface keeps from the emitter: they have no bound.
    pub(super) fn find(&mut self, model: &Model, emitter: &Sight, is_apart: impl Fn(u32) -> bool) {
        let tolerance = model.geometry().plane_tolerance;
        let sphere = Sphere::of(&emitter.corners);
        self.bounds.clear();
        self.patches.clear();
        for patch in 0..model.geometry().patch_count {
            let bound = if is_apart(patch) {
                0.0
            } else {
                bound(emitter, &sphere, &model.normalised_corners(patch), tolerance)
            };
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

    /// The patches with a bound of `least` or more.
    pub(super) fn from(&self, least: f64) -> &[u32] {
        let count = self.patches.partition_point(|&patch| self.bound(patch) >= least);
        &self.patches[..count]
    }

    /// Returns whether every patch facing the emitter has a bound of `least` or more.
    pub(super) fn are_all_from(&self, least: f64) -> bool {
        self.from(least).len() == self.patches.len()
    }

    /// A bound reached by at most `count` patches.
    pub(super) fn least_of(&self, count: usize) -> f64 {
        match self.patches.get(count) {
            // Just above the bound of the first patch too many.
            Some(&patch) => self.bound(patch).next_up(),
            None => 0.0,
        }
    }
}

fn bound(emitter: &Sight, sphere: &Sphere, corners: &[DVec3; 3], tolerance: f64) -> f64 {
    let height = corners.map(|p| emitter.height(p)).into_iter().fold(0.0, f64::max);
    if height <= tolerance {
        return 0.0;
    }
    let cross = geometry::cross(corners);
    let twice_area = cross.length();
    // A patch without area has no plane: NaN, never above it.
    let above = emitter
        .corners
        .map(|p| cross.dot(p - corners[0]) / twice_area)
        .into_iter()
        .fold(0.0, f64::max);
    if above <= tolerance {
        return 0.0;
    }
    let area = 0.5 * twice_area;
    let by_area = (area / emitter.area).min(1.0);
    let own = Sphere::of(corners);
    let reach = sphere.radius() + own.radius();
    let distance = own.center.distance(sphere.center) - reach;
    if distance <= 0.0 {
        return by_area;
    }
    let cosines = (height / distance).min(1.0) * (above / distance).min(1.0);
    by_area.min(area * cosines / (PI * distance * distance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HierarchyOptions;
    use crate::factor::{FactorRule, exchange};
    use hemicube_scene::generate::BlockCityParameters;
    use hemicube_scene::{InputPatch, Patches, Subdivision};

    #[test]
    fn no_form_factor_is_above_its_bound() {
        let city = BlockCityParameters::for_target(600, 1);
        let patches = Patches::new(&city.generate().expect("a city"), Subdivision::None).expect("patches");
        let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
        let rule = FactorRule::for_tolerance(1e-3);
        let mut facing = Facing::default();
        let (mut seen, mut tight) = (0, 0);
        for patch in (0..model.geometry().patch_count).step_by(23) {
            let emitter = Sight::new(&model, InputPatch(patch)).expect("an area");
            facing.find(&model, &emitter, |_| false);
            for other in 0..model.geometry().patch_count {
                let (bound, corners) = (facing.bound(other), model.normalised_corners(other));
                let factor = exchange(&emitter.corners, &corners, &rule) / emitter.area;
                assert!(
                    factor <= 1.01 * bound + 1e-9,
                    "{patch} to {other}: {factor:e}, bound {bound:e}"
                );
                seen += usize::from(factor > 0.0);
                tight += usize::from(factor > 0.1 * bound && factor > 0.0);
            }
            let most = facing.patches.len() / 3;
            let least = facing.least_of(most);
            assert!(facing.from(least).len() <= most);
            assert!(facing.patches.is_empty() || !facing.are_all_from(least));
            assert!(facing.from(least).iter().all(|&other| facing.bound(other) >= least));
            assert!(facing.are_all_from(facing.least_of(facing.patches.len())));
        }
        assert!(
            seen > 1_000 && 5 * tight > seen,
            "{seen} face, {tight} bounds are tight"
        );
    }
}
