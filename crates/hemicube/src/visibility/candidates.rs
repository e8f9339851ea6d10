//! Patches with a form factor that could be large, whether the hemicube saw them or not.
//!
//! A hemicube at one point misses pairs visible from other points of the emitter: walls of neighbouring buildings a
//! hair apart, surfaces behind a corner. However large a part of the row they are, no pixel tells. So they are looked
//! for in the tree, by bounds of the form factor: with d the least distance of the spheres round the two,
//!
//! ```text
//! F_ij ≤ 1,   F_ij ≤ A_j / A_i,   F_ij ≤ A_j cos φ_i / (π d²),   cos φ_i ≤ (height of j above i) / d
//! ```
//!
//! No corner hemicubes for candidates, because three of them cost three hemicubes a row and still miss pairs invisible
//! from all four points (walls of neighbouring houses 0.1 mm apart have F = 0.36). Bounds in the tree find all pairs
//! above them.

use crate::bvh::{Block, INNER, LANES, Tree, UNUSED};
use crate::factor::far::{Own, shape};
use crate::geometry::{self, Sphere};
use crate::simd::{InstructionSet, dispatch, dot, lanes, mask, minus, most};
use glam::DVec3;

/// The emitter, prepared for bounds.
#[derive(Clone, Copy, Debug)]
struct Emitter {
    corners: [[f64; 3]; 3],
    center: [f64; 3],
    normal: [f64; 3],
    /// n · p of its plane.
    offset: f64,
    radius: f64,
    area: f64,
    tolerance: f64,
}

/// The form factors from which on patches are listed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Least {
    /// For patches that all but touch the emitter: centroids nearer than 2 √(r_i² + r_j²).
    pub(crate) near: f64,
    /// For other patches.
    pub(crate) far: f64,
}

/// Squared distance of centroids that separates the two, in r_i² + r_j²: between nearness 0 and 1 of the error model.
const NEAR: f64 = 4.0;

/// Lists patches by bounds of their form factor, for one row after the other.
#[derive(Debug, Default)]
pub(crate) struct Candidates {
    pending: Vec<u32>,
    /// The patches found, ascending.
    pub(crate) patches: Vec<u32>,
}

impl Candidates {
    /// Finds the patches with a form factor from `patch` that may be `least` or more.
    pub(crate) fn find(&mut self, tree: &Tree, patch: u32, corners: &[DVec3; 3], least: Least) {
        self.patches.clear();
        let cross = geometry::cross(corners);
        let Some(normal) = cross.try_normalize() else { return };
        let sphere = Sphere::of(corners);
        let center = sphere.center;
        let emitter = Emitter {
            corners: corners.map(|p| p.to_array()),
            center: center.to_array(),
            normal: normal.to_array(),
            offset: normal.dot(corners[0]),
            radius: sphere.radius(),
            area: 0.5 * cross.length(),
            tolerance: tree.plane_tolerance,
        };
        let own_slot = tree.slot_of_patch[patch as usize];
        self.pending.clear();
        self.pending.push(0);
        while let Some(index) = self.pending.pop() {
            let node = &tree.nodes[index as usize];
            let h = node.half;
            let highest = normal.dot(node.center) - emitter.offset + normal.abs().dot(h);
            if highest <= emitter.tolerance {
                continue;
            }
            let outside = ((center - node.center).abs() - h).max(DVec3::ZERO);
            let distance = (outside.length() - emitter.radius).max(0.0);
            let largest = f64::from(node.largest);
            let square = distance * distance;
            let facing = (highest / distance).min(1.0);
            // Corners of a triangle in the box are at most two thirds of the box's diagonal from its centroid.
            let radii = emitter.radius * emitter.radius + h.length_squared() * (16.0 / 9.0);
            let is_far = outside.length_squared() >= NEAR * radii;
            let least_here = if is_far { least.far } else { least.near.min(least.far) };
            if largest < least_here * emitter.area || largest * facing < least_here * std::f64::consts::PI * square {
                continue;
            }
            if node.block == INNER {
                self.pending.extend([node.child, node.child + 1]);
                continue;
            }
            let block = &tree.blocks[node.block as usize];
            let (front, back) = dispatch_bounds(InstructionSet::widest(), block, &emitter, least);
            for (mask, ids) in [(front, &block.negative), (back, &block.positive)] {
                for l in lanes(mask) {
                    let id = ids[l];
                    #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
                    let slot = (node.block as usize * LANES + l) as u32;
                    if block.negative[l] != UNUSED && id < tree.patch_count && slot != own_slot {
                        self.patches.push(id);
                    }
                }
            }
        }
        self.patches.sort_unstable();
    }
}

/// Masks of 16 triangles that may reach `least`: by their front, seen with a negative determinant, and by their back.
#[inline(always)]
fn bounds(block: &Block, emitter: &Emitter, least: Least) -> (u16, u16) {
    let mut front = [0u64; LANES];
    let mut back = [0u64; LANES];
    let at = |l: usize, k: usize| {
        [
            block.corners[3 * k][l],
            block.corners[3 * k + 1][l],
            block.corners[3 * k + 2][l],
        ]
    };
    for l in 0..LANES {
        let (a, b, c) = (at(l, 0), at(l, 1), at(l, 2));
        let Own {
            center,
            cross,
            squared_radius,
            ..
        } = shape(a, b, c);
        let double_area = dot(cross, cross).sqrt();
        let radius = squared_radius.sqrt();
        let between = minus(center, emitter.center);
        let square = dot(between, between);
        let distance = most(square.sqrt() - radius - emitter.radius, 0.0);
        let is_far = square >= NEAR * (squared_radius + emitter.radius * emitter.radius);
        let least = if is_far { least.far } else { least.near };
        let height = |p: [f64; 3]| dot(emitter.normal, p) - emitter.offset;
        let highest = most(height(a), most(height(b), height(c)));
        let area = 0.5 * double_area;
        let limit = least * std::f64::consts::PI * distance * distance;
        let reaches = (area >= least * emitter.area) & (highest > emitter.tolerance);
        // Heights of the emitter's corners above the other's plane, times its double area.
        let above = |p: [f64; 3]| dot(cross, minus(p, a));
        let (p, q, r) = (
            above(emitter.corners[0]),
            above(emitter.corners[1]),
            above(emitter.corners[2]),
        );
        let enough = emitter.tolerance * double_area;
        // Either cosine is at most its height over the distance, and at most 1.
        let side = |height: f64| {
            (height > enough)
                & (area >= limit)
                & (area * highest >= limit * distance)
                & (0.5 * height >= limit * distance)
                & (0.5 * height * highest >= limit * distance * distance)
        };
        front[l] = u64::from(reaches & side(most(p, most(q, r))));
        back[l] = u64::from(reaches & side(most(-p, most(-q, -r))));
    }
    (mask(&front), mask(&back))
}

dispatch! {
    fn dispatch_bounds = bounds(block: &Block, emitter: &Emitter, least: Least) -> (u16, u16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HierarchyOptions, Model};
    use hemicube_scene::generate::BlockCityParameters;
    use hemicube_scene::{InputPatch, Patches, Subdivision};

    #[test]
    fn none_is_lost_that_touches_or_is_above_the_threshold_of_far_ones() {
        let city = BlockCityParameters::for_target(2_000, 1);
        let patches = Patches::new(&city.generate().expect("a city"), Subdivision::None).expect("patches");
        let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
        let tree = Tree::of(model.geometry());
        let round = |patch: u32| {
            let sphere = Sphere::of(&model.normalised_corners(patch));
            (sphere.center, sphere.squared_radius)
        };
        let (mut touching, mut others) = (0, 0);
        for InputPatch(patch) in model.order().step_by(17) {
            let found = |near, far| {
                let mut candidates = Candidates::default();
                candidates.find(&tree, patch, &model.normalised_corners(patch), Least { near, far });
                candidates.patches
            };
            let (center, radius) = round(patch);
            // In the grid of a city, many are just as near as that.
            let touches = |other: u32| {
                let (c, r) = round(other);
                c.distance_squared(center) < NEAR * (radius + r) * (1.0 - 1e-9)
            };
            let (near, far) = (found(1e-4, 1e-4), found(5e-3, 5e-3));
            let both = found(1e-4, 5e-3);
            for other in near.iter().copied() {
                if far.contains(&other) || touches(other) {
                    assert!(both.contains(&other), "{patch} to {other}");
                }
            }
            assert!(both.iter().all(|other| near.contains(other)), "{patch}");
            touching += both.iter().filter(|&&other| touches(other)).count();
            others += near.len() - both.len();
        }
        assert!(touching > 100 && others > 1_000, "{touching} near, {others} not listed");
    }
}
