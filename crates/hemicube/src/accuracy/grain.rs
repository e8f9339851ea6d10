//! Number of hemicubes by the size of a patch.
//!
//! One hemicube at the centroid stands for a patch no larger than the surfaces around it. On a ground of square
//! kilometres with a city on it, the centroid may lie within a building, and other points of the ground see something
//! else. Such a patch gets n² hemicubes, one in each of n² equal parts of it: n² in proportion to the surfaces that
//! stand on it.

use crate::Model;
use crate::backend::Geometry;
use crate::bvh::{INNER, LANES, Tree, UNUSED};
use crate::geometry::{self, area};
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::sync::Arc;

/// Number of surfaces on a patch for each hemicube. A choice: with fewer, large patches take more time; with more, one
/// hemicube stands for places that see different surfaces.
const SURFACES_PER_HEMICUBE: usize = 16;
/// Area of a surface that counts as standing on a patch, at most, in areas of the patch: as many cover it.
const SMALLER: f64 = 1.0 / SURFACES_PER_HEMICUBE as f64;
/// Area of a large patch, in the scene's median areas: it has room for the surfaces of four hemicubes.
const LARGE: f64 = 4.0 * SURFACES_PER_HEMICUBE as f64;
/// Bound of the hemicubes along an edge.
pub(crate) const MOST_PER_EDGE: u32 = 16;
/// Number of surfaces at which counting ends: more would change nothing.
const ENOUGH: usize = SURFACES_PER_HEMICUBE * (MOST_PER_EDGE * MOST_PER_EDGE) as usize;
/// Bound of the blocks of the tree that are looked at for one patch: surfaces found up to there count.
const MOST_BLOCKS: usize = 1024;

/// The area from which on a patch is large.
#[derive(Debug)]
pub(crate) struct Grain {
    large: f64,
}

impl Grain {
    /// The scene's, found at the first call: O(surfaces).
    pub(crate) fn of(geometry: &Geometry) -> Arc<Self> {
        geometry.kept(|geometry| {
            let mut areas: Vec<f64> = geometry.surfaces.iter().map(|surface| area(&surface.corners)).collect();
            let middle = areas.len() / 2;
            let median = if areas.is_empty() {
                0.0
            } else {
                *areas.select_nth_unstable_by(middle, f64::total_cmp).1
            };
            Self { large: LARGE * median }
        })
    }

    /// Hemicubes along an edge of a patch, 1 to [`MOST_PER_EDGE`]: 1 unless the patch is large and much stands on it.
    /// Depends on the scene alone.
    pub(crate) fn per_edge(&self, model: &Model, patch: InputPatch) -> u32 {
        let corners = model.normalised_corners(patch.0);
        let own = area(&corners);
        if own < self.large || own <= 0.0 {
            return 1;
        }
        let count = standing_on(&Tree::of(model.geometry()), patch, &corners) / SURFACES_PER_HEMICUBE;
        #[allow(clippy::cast_possible_truncation, reason = "at most 256")]
        let count = count as u32;
        count.isqrt().clamp(1, MOST_PER_EDGE)
    }
}

/// Number of surfaces, small beside the patch, with the centroid above it and at most √area from it; at most
/// [`ENOUGH`].
fn standing_on(tree: &Tree, patch: InputPatch, corners: &[DVec3; 3]) -> usize {
    let [a, b, c] = *corners;
    let cross = geometry::cross(corners);
    let own = 0.5 * cross.length();
    let Some(normal) = cross.try_normalize() else { return 0 };
    let reach = own.sqrt();
    let (low, high) = geometry::bounds(corners);
    let (low, high) = (low.min(low + normal * reach), high.max(high + normal * reach));
    let inwards = [(a, b), (b, c), (c, a)].map(|(p, q)| (normal.cross(q - p), p));
    let own_slot = tree.slot_of_patch[patch.0 as usize];
    let (mut count, mut blocks) = (0, 0);
    let mut pending = vec![0u32];
    while let Some(index) = pending.pop() {
        let node = &tree.nodes[index as usize];
        let (least, most) = (node.center - node.half, node.center + node.half);
        if least.cmpgt(high).any() || most.cmplt(low).any() {
            continue;
        }
        if node.block == INNER {
            if node.child != 0 {
                pending.extend([node.child + 1, node.child]);
            }
            continue;
        }
        let block = &tree.blocks[node.block as usize];
        for l in (0..LANES).filter(|&l| block.negative[l] != UNUSED) {
            let triangle = block.triangle(l);
            let middle = geometry::centroid(&triangle);
            let height = normal.dot(middle - a);
            let is_above = height > tree.plane_tolerance && height <= reach;
            let is_over = inwards.iter().all(|&(inward, from)| inward.dot(middle - from) >= 0.0);
            #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
            let slot = (node.block as usize * LANES + l) as u32;
            if is_above && is_over && slot != own_slot && area(&triangle) <= SMALLER * own {
                count += 1;
            }
        }
        blocks += 1;
        if count >= ENOUGH || blocks >= MOST_BLOCKS {
            break;
        }
    }
    count.min(ENOUGH)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HierarchyOptions;
    use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

    /// A ground of two triangles, 100 by 100, with so many boxes' walls on it along each side.
    fn ground_with(boxes: u32) -> Model {
        let p = DVec3::new;
        let mut scene = Scene::default();
        let mut push = |corners: [DVec3; 3]| {
            scene.triangles.push(Triangle {
                corners,
                object: 0,
                material: 0,
                face: 0,
                two_sided: false,
            });
        };
        push([p(0., 0., 0.), p(100., 0., 0.), p(100., 100., 0.)]);
        push([p(0., 0., 0.), p(100., 100., 0.), p(0., 100., 0.)]);
        for k in 0..boxes * boxes {
            let step = 100.0 / f64::from(boxes.max(1));
            let (x, y) = (f64::from(k % boxes) * step + 0.3, f64::from(k / boxes) * step + 0.3);
            push([p(x, y, 0.), p(x + 1., y, 0.), p(x, y, 1.)]);
            push([p(x + 1., y, 0.), p(x + 1., y, 1.), p(x, y, 1.)]);
        }
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    #[test]
    fn what_much_stands_on_gets_many_hemicubes_and_nothing_else_does() {
        for (boxes, least, most) in [(0, 1, 1), (3, 1, 1), (12, 2, 4), (60, 15, 16)] {
            let model = ground_with(boxes);
            let grain = Grain::of(model.geometry());
            let n = grain.per_edge(&model, InputPatch(0));
            assert!((least..=most).contains(&n), "{boxes} along each side: {n}");
            if boxes > 0 {
                assert_eq!(grain.per_edge(&model, InputPatch(2)), 1, "a wall");
            }
        }
    }

    #[test]
    fn patches_of_one_size_have_one_hemicube_each() {
        let scene = hemicube_scene::generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::Levels(3)).expect("patches");
        let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
        let grain = Grain::of(model.geometry());
        assert!(model.order().all(|patch| grain.per_edge(&model, patch) == 1));
    }
}
