//! Rays through the tree of a scene's surfaces, all in f64: the first hit from a point of a patch.
//!
//! Ray and triangle: Möller & Trumbore 1997. Directions: the R₂ sequence (Roberts 2018, "The unreasonable effectiveness
//! of quasirandom sequences"), evenly spread from its beginning on, lifted to the hemisphere by Malley's method.

use crate::Model;
use crate::bvh::{Block, INNER, LANES, Tree};
use crate::frame;
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::f64::consts::TAU;

/// A patch with rays from it, in normalised coordinates.
pub(super) struct Emitter {
    pub(super) patch: InputPatch,
    pub(super) corners: [DVec3; 3],
    pub(super) axes: [DVec3; 3],
    slot: usize,
}

impl Emitter {
    /// `None` for a patch without area.
    pub(super) fn new(model: &Model, tree: &Tree, patch: InputPatch) -> Option<Self> {
        let corners = model.patches().corners(patch).map(|p| model.normalise(p));
        Some(Self {
            patch,
            corners,
            axes: frame::axes(corners, frame::turn(patch))?,
            slot: *tree.slot_of_patch.get(patch.0 as usize)? as usize,
        })
    }

    pub(super) fn normal(&self) -> DVec3 {
        self.axes[2]
    }

    pub(super) fn centroid(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / 3.0
    }

    /// A direction of [`directions`] in the patch's own frame.
    pub(super) fn turned(&self, direction: DVec3) -> DVec3 {
        let [tangent, bitangent, normal] = self.axes;
        tangent * direction.x + bitangent * direction.y + normal * direction.z
    }
}

/// Cosine-distributed directions about z.
pub(super) fn directions(count: u32) -> Vec<DVec3> {
    // The real root of x³ = x + 1.
    const G: f64 = 1.324_717_957_244_746;
    (0..count)
        .map(|k| {
            let at = |step: f64| (0.5 + f64::from(k + 1) * step).fract();
            let (u, v) = (at(1.0 / G), at(1.0 / (G * G)));
            let (sine, cosine) = (TAU * v).sin_cos();
            DVec3::new(u.sqrt() * cosine, u.sqrt() * sine, (1.0 - u).sqrt())
        })
        .collect()
}

/// Most surfaces back to back that a ray passes: storeys of a stack.
const BACK_TO_BACK_MAX: u32 = 64;

/// The first hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hit {
    Nothing,
    /// The back of a one-sided surface, by its front's patch.
    Back(u32),
    Patch(u32),
}

/// Casts rays; one a thread.
pub(super) struct Caster<'t> {
    tree: &'t Tree,
    pending: Vec<(f64, u32)>,
    /// Nodes and blocks looked at, in units of about a node.
    pub(super) work: u64,
}

impl<'t> Caster<'t> {
    pub(super) fn new(tree: &'t Tree) -> Self {
        Self {
            tree,
            pending: Vec::new(),
            work: 0,
        }
    }

    /// The first hit of a ray from a point of `emitter`, among surfaces that rise above its plane. Of surfaces in one
    /// plane the patch with the smaller id, and any patch before a back.
    pub(super) fn first(&mut self, emitter: &Emitter, origin: DVec3, direction: DVec3) -> Hit {
        self.first_of_side(emitter, 1.0, origin, direction)
    }

    /// Likewise from the emitter's front (`side` 1) or its back (−1).
    pub(super) fn first_of_side(&mut self, emitter: &Emitter, side: f64, origin: DVec3, direction: DVec3) -> Hit {
        let normal = side * emitter.normal();
        let tolerance = self.tree.plane_tolerance;
        let height = |p: DVec3| normal.dot(p - emitter.corners[0]);
        // A box that ends well below the tolerance has only surfaces to skip: most of a wall, seen from a piece of it.
        let is_below = |center, half| height(center) + normal.abs().dot(half) <= 0.5 * tolerance;
        let met = self.nearest(origin, direction, is_below, |slot, corners| {
            slot == emitter.slot || corners.iter().all(|p| height(*p) <= tolerance)
        });
        met.hit
    }

    /// The first hit of a ray from a free point. Where one-sided surfaces lie back to back, as solids that stand on one
    /// another do, nothing tells which side the point is on: what comes next does, if that is a back.
    pub(super) fn first_of_point(&mut self, origin: DVec3, direction: DVec3) -> Hit {
        let first = self.nearest(origin, direction, |_, _| false, |_, _| false);
        let (mut met, mut along) = (first, 0.0);
        for _ in 0..BACK_TO_BACK_MAX {
            if !met.is_back_to_back() {
                break;
            }
            along += met.distance + 2.0 * self.tie();
            met = self.nearest(origin + along * direction, direction, |_, _| false, |_, _| false);
        }
        match met.hit {
            Hit::Back(_) => met.hit,
            Hit::Patch(_) | Hit::Nothing => first.hit,
        }
    }

    /// Distances along a ray within this are one.
    fn tie(&self) -> f64 {
        1e-12 + 4.0 * self.tree.plane_tolerance
    }

    /// The first hit of a ray among the surfaces not skipped, by the centre and half of a box of them, or by its slot
    /// and corners.
    fn nearest(
        &mut self,
        origin: DVec3,
        direction: DVec3,
        skips: impl Fn(DVec3, DVec3) -> bool,
        passes: impl Fn(usize, &[DVec3; 3]) -> bool,
    ) -> Met {
        let tree = self.tree;
        let inverse = direction.recip();
        let enter = |index: u32| {
            let node = &tree.nodes[index as usize];
            let low = (node.center - node.half - origin) * inverse;
            let high = (node.center + node.half - origin) * inverse;
            // A coordinate of 0 × ∞ bounds nothing: `f64::min` and `max` pass over NaN.
            let (mut from, mut to) = (0.0_f64, f64::INFINITY);
            for axis in 0..3 {
                from = from.max(low[axis].min(high[axis]));
                to = to.min(low[axis].max(high[axis]));
            }
            (from <= to && !skips(node.center, node.half)).then_some(from)
        };
        // Surfaces in one plane must be told by their ids, not by how their depths are rounded.
        let tie = self.tie();
        let mut nearest = f64::INFINITY;
        let mut met = Hit::Nothing;
        let mut sides = [false; 3];
        self.pending.clear();
        self.pending.extend(enter(0).map(|t| (t, 0)));
        while let Some((t, index)) = self.pending.pop() {
            if t > nearest + tie {
                continue;
            }
            self.work += 1;
            let node = &tree.nodes[index as usize];
            if node.block == INNER {
                let mut children = [node.child, node.child + 1].map(|child| enter(child).map(|t| (t, child)));
                if let [Some(a), Some(b)] = children
                    && a.0 < b.0
                {
                    children.swap(0, 1);
                }
                self.pending.extend(children.into_iter().flatten());
                continue;
            }
            self.work += 6;
            let block = &tree.blocks[node.block as usize];
            let (distances, determinants) = meet(block, origin, direction);
            for lane in 0..LANES {
                let (t, determinant) = (distances[lane], determinants[lane]);
                if !(t > 0.0 && t <= nearest + tie) || passes(node.block as usize * LANES + lane, &block.triangle(lane))
                {
                    continue;
                }
                let (id, other) = if determinant > 0.0 {
                    (block.negative[lane], block.positive[lane])
                } else {
                    (block.positive[lane], block.negative[lane])
                };
                let found = if id < tree.patch_count {
                    Hit::Patch(id)
                } else {
                    Hit::Back(other)
                };
                let wins = match (met, found) {
                    _ if t < nearest - tie => true,
                    (Hit::Nothing, _) | (Hit::Back(_), Hit::Patch(_)) => true,
                    (Hit::Patch(old), Hit::Patch(new)) => new < old,
                    _ => false,
                };
                if wins {
                    met = found;
                }
                if t < nearest - tie {
                    sides = [false; 3];
                }
                sides[match found {
                    Hit::Patch(_) if other < tree.patch_count => Met::BOTH,
                    Hit::Patch(_) => Met::FRONT,
                    _ => Met::BACK,
                }] = true;
                nearest = nearest.min(t);
            }
        }
        Met {
            hit: met,
            distance: nearest,
            sides,
        }
    }
}

/// What a ray meets first, and which sides of surfaces in that place.
#[derive(Clone, Copy)]
struct Met {
    hit: Hit,
    distance: f64,
    sides: [bool; 3],
}

impl Met {
    const FRONT: usize = 0;
    const BACK: usize = 1;
    const BOTH: usize = 2;

    /// Returns whether one-sided surfaces lie back to back there, and none of both sides.
    fn is_back_to_back(&self) -> bool {
        self.sides[Self::FRONT] && self.sides[Self::BACK] && !self.sides[Self::BOTH]
    }
}

/// [`crossed`] of each lane.
fn meet(block: &Block, origin: DVec3, direction: DVec3) -> ([f64; LANES], [f64; LANES]) {
    let (mut distances, mut determinants) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        (distances[lane], determinants[lane]) = crossed(block.triangle(lane), origin, direction);
    }
    (distances, determinants)
}

/// Distance along the ray to a triangle (negative: no hit), and the determinant, whose sign is the side.
pub(super) fn crossed([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> (f64, f64) {
    let (e, f, s) = (b - a, c - a, origin - a);
    let p = direction.cross(f);
    let determinant = e.dot(p);
    let inverse = 1.0 / determinant;
    let q = s.cross(e);
    let (u, v) = (s.dot(p) * inverse, direction.dot(q) * inverse);
    // Unused lanes have no area: their determinant is 0, and comparisons with a quotient by it are false.
    let hit = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    (if hit { f.dot(q) * inverse } else { -1.0 }, determinant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HierarchyOptions;
    use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

    /// A wall in strips with windows in it, as a polygon with holes is cut: everything in one plane.
    fn wall(windows: u32) -> Model {
        let mut triangles = Vec::new();
        let mut quad = |low: [f64; 2], high: [f64; 2]| {
            let corner = |x: f64, z: f64| DVec3::new(x, 0.0, z);
            let [a, b, c, d] = [
                corner(low[0], low[1]),
                corner(high[0], low[1]),
                corner(high[0], high[1]),
                corner(low[0], high[1]),
            ];
            for corners in [[a, b, c], [a, c, d]] {
                triangles.push(Triangle {
                    corners,
                    object: 0,
                    material: 0,
                    face: 0,
                    two_sided: false,
                });
            }
        };
        // Slivers over the whole length, and a window every ten metres.
        let length = 10.0 * f64::from(windows);
        for strip in 0..windows {
            let z = 10.0 + f64::from(strip) / f64::from(windows);
            quad([0.0, z], [length, z + 1.0 / f64::from(windows)]);
            quad([10.0 * f64::from(strip), 2.0], [10.0 * f64::from(strip) + 2.0, 4.0]);
        }
        let scene = Scene {
            triangles,
            ..Scene::default()
        };
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    #[test]
    fn a_ray_from_a_wall_passes_over_the_wall() {
        let steps = |windows| {
            let model = wall(windows);
            let tree = Tree::of(model.geometry());
            let emitter = Emitter::new(&model, &tree, InputPatch(0)).expect("a patch with area");
            let mut caster = Caster::new(&tree);
            for direction in directions(64) {
                let direction = emitter.turned(direction);
                assert_eq!(caster.first(&emitter, emitter.centroid(), direction), Hit::Nothing);
            }
            caster.work
        };
        // Whatever lies in the plane of the emitter is skipped with its box.
        assert_eq!((steps(30), steps(1000)), (0, 0));
    }

    #[test]
    fn directions_are_spread_by_the_cosine_in_every_beginning() {
        for count in [32, 128, 1000] {
            let all = directions(count);
            let mean = all.iter().sum::<DVec3>() / f64::from(count);
            // ∫ cos² over the hemisphere / π.
            assert!(
                (mean - DVec3::new(0.0, 0.0, 2.0 / 3.0)).length() < 2.0 / f64::from(count).powf(0.8),
                "{mean}"
            );
            assert!(all.iter().all(|d| (d.length() - 1.0).abs() < 1e-14 && d.z > 0.0));
        }
    }
}
