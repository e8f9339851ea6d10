//! What a patch loses, by rays: to the outside, to backs of one-sided patches, to patches without a column.
//!
//! Hemicubes know it from a point. Where a patch reaches out of a solid, or is large, no point stands for it, and form
//! factors of the whole patch do not say which of the three their sum lacks. Rays from all over the patch do: n of
//! them, cosine distributed (Malley's method) at points of a scrambled Sobol sequence, leave X (1 − X) n^(−5/4) of a
//! share X's variance.

use crate::Model;
use crate::bvh::{Block, LANES, Tree, UNUSED};
use crate::geometry;
use crate::sampling::sobol::{BATCH, Sequence, fold};
use crate::sampling::splitmix;
use crate::simd::{InstructionSet, dispatch, dot, minus, most};
use crate::store::shares::RowShares;
use crate::visibility::segments::{Segment, crossing, next_block};
use glam::DVec3;
use hemicube_scene::InputPatch;

/// Rays from a patch, at least and at most.
const LEAST: usize = 256;
const MOST: usize = 1 << 14;
/// The part of a permitted error that rays may leave.
const PART: f64 = 0.8;
/// Longer than any way through the scene, which fits a cube of side 2.
const FAR: f64 = 4.0;

/// The standard error of a share from so many rays, where `variance` is share · (1 − share).
pub(crate) fn error(variance: f64, count: usize) -> f64 {
    // n^(5/8), in roots: these have the same bits everywhere.
    let root = (count as f64).sqrt();
    let eighth = root.sqrt().sqrt();
    // A few rays that agree do not prove that all would.
    variance.max(0.25 / count as f64).sqrt() / (root * eighth)
}

/// Shares that rays found.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lost {
    pub(crate) shares: RowShares,
    /// Number of rays.
    pub(crate) rays: usize,
}

impl Lost {
    /// The standard errors of the shares.
    pub(crate) fn errors(&self) -> [f64; 3] {
        self.shares
            .to_array()
            .map(|share| error(share * (1.0 - share), self.rays))
    }

    /// The standard error of all three together.
    pub(crate) fn error(&self) -> f64 {
        let lost = self.shares.lost().min(1.0);
        error(lost * (1.0 - lost), self.rays)
    }
}

/// Measures what a patch loses: by 256 rays, and by twice as many until no share has a standard error much above
/// `permitted`, or 16,384 were cast. `receives` says whether a patch has a column. Nothing for a patch without area.
pub(crate) fn measure(
    model: &Model,
    emitter: InputPatch,
    permitted: f64,
    receives: impl Fn(u32) -> bool,
) -> Option<Lost> {
    let tree = Tree::of(model.geometry());
    let corners = model.normalised_corners(emitter.0);
    let normal = geometry::cross(&corners).try_normalize()?;
    let [a, b, c] = corners;
    let (x, y) = normal.any_orthonormal_pair();
    let plane = (normal.to_array(), normal.dot(a));
    let sequence = Sequence::new(u64::from(emitter.0).wrapping_mul(splitmix::STEP));
    let (mut escaped, mut blocked, mut unselected) = (0u32, 0u32, 0u32);
    let mut pending = Vec::new();
    let mut count = 0;
    loop {
        let wanted = (2 * count).max(LEAST);
        for at in (count..wanted).step_by(BATCH) {
            let u = sequence.points(at);
            for l in 0..BATCH {
                let (s, t) = fold(u[0][l], u[1][l]);
                let from = a + (b - a) * s + (c - a) * t;
                let (sin, cos) = (std::f64::consts::TAU * u[3][l]).sin_cos();
                let radius = u[2][l].sqrt();
                let towards = (x * cos + y * sin) * radius + normal * (1.0 - u[2][l]).sqrt();
                match first_met(&tree, from, from + towards * FAR, plane, &mut pending) {
                    None => escaped += 1,
                    Some(id) if id >= tree.patch_count => blocked += 1,
                    Some(id) => unselected += u32::from(!receives(id)),
                }
            }
        }
        count = wanted;
        let share = |met: u32| f64::from(met) / count as f64;
        let found = Lost {
            shares: RowShares {
                escaped: share(escaped),
                blocked: share(blocked),
                unselected: share(unselected),
            },
            rays: count,
        };
        if count >= MOST || found.errors().iter().all(|&error| error <= PART * permitted) {
            return Some(found);
        }
    }
}

/// What a segment meets.
#[derive(Clone, Copy)]
struct Met {
    /// As a share of the segment.
    place: f64,
    id: u32,
    corners: [DVec3; 3],
}

/// The id seen where a segment first meets a triangle that rises above the plane n · p = d; of triangles that lie in
/// one plane at one place, as the walls of neighbouring buildings do, the smallest: ids of patches are smaller than
/// that of backs.
fn first_met(tree: &Tree, start: DVec3, end: DVec3, plane: ([f64; 3], f64), pending: &mut Vec<u32>) -> Option<u32> {
    let along = end - start;
    let mut segment = Segment::new(start, end, tree.plane_tolerance);
    let mut first: Option<Met> = None;
    pending.clear();
    pending.push(0);
    while let Some(leaf) = next_block(tree, &segment, pending) {
        let block = &tree.blocks[leaf as usize];
        let mut places = [f64::INFINITY; LANES];
        let ends = (start.to_array(), end.to_array());
        dispatch_places(
            InstructionSet::widest(),
            block,
            ends,
            plane,
            tree.plane_tolerance,
            &mut places,
        );
        for (l, &place) in places.iter().enumerate() {
            if place.abs() > 1.0 || block.negative[l] == UNUSED {
                continue;
            }
            let ids = if place.is_sign_negative() {
                &block.positive
            } else {
                &block.negative
            };
            let found = Met {
                place: place.abs(),
                id: ids[l],
                corners: block.triangle(l),
            };
            let tie = found.tie(along, tree.plane_tolerance);
            let wins = first.is_none_or(|first| {
                if (found.place - first.place).abs() <= tie && found.is_in_plane_with(&first, tree.plane_tolerance) {
                    found.id < first.id
                } else {
                    found.place < first.place
                }
            });
            if wins {
                first = Some(found);
                // What lies at the same place is still looked at.
                let place = (found.place + tie).min(1.0);
                segment = Segment::new(start, start + along * place, tree.plane_tolerance);
            }
        }
    }
    first.map(|met| met.id)
}

impl Met {
    /// Distance along the segment, as a share of it, within which surfaces of one plane may appear.
    fn tie(&self, along: DVec3, tolerance: f64) -> f64 {
        let across = self.normal().dot(along).abs();
        4.0 * tolerance / across.max(1e-4 * along.length())
    }

    fn normal(&self) -> DVec3 {
        geometry::cross(&self.corners).normalize_or_zero()
    }

    /// Returns whether one of two triangles lies in the plane of the other.
    fn is_in_plane_with(&self, other: &Self, tolerance: f64) -> bool {
        let lies_in = |p: &Self, q: &Self| {
            let normal = q.normal();
            p.corners
                .iter()
                .all(|&corner| normal.dot(corner - q.corners[0]).abs() <= tolerance)
        };
        lies_in(self, other) || lies_in(other, self)
    }
}

/// Where the segment crosses each of 16 triangles, as a share of its length: negative where it comes from the side on
/// which determinants are positive; infinite where it does not.
#[inline(always)]
fn places(
    block: &Block,
    (x, y): ([f64; 3], [f64; 3]),
    (normal, offset): ([f64; 3], f64),
    tolerance: f64,
    out: &mut [f64; LANES],
) {
    let d = minus(y, x);
    for l in 0..LANES {
        let [a, b, c] = block.corners_of(l);
        let highest = most(dot(normal, a), most(dot(normal, b), dot(normal, c))) - offset;
        let crossing = crossing([a, b, c], x, y, d);
        let place = crossing.at_start / crossing.determinant;
        out[l] = if crossing.hits & (highest > tolerance) {
            if crossing.at_start < 0.0 { -place } else { place }
        } else {
            f64::INFINITY
        };
    }
}

dispatch! {
    fn dispatch_places = places(block: &Block, segment: ([f64; 3], [f64; 3]), plane: ([f64; 3], f64), tolerance: f64, out: &mut [f64; LANES])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HierarchyOptions;
    use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

    const PERMITTED: f64 = 0.01;

    fn model(triangles: &[([DVec3; 3], bool)]) -> Model {
        let scene = Scene {
            triangles: triangles
                .iter()
                .map(|&(corners, two_sided)| Triangle {
                    corners,
                    object: 0,
                    material: 0,
                    face: 0,
                    two_sided,
                })
                .collect(),
            ..Scene::default()
        };
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    /// Two unit squares face each other at distance 1: F = 0.199825 (Howell C-11).
    const PLATES: f64 = 0.199_824_895_698_387;

    fn plates(above: [bool; 2], two_sided: bool) -> Model {
        let p = DVec3::new;
        let low = [
            [p(0., 0., 0.), p(1., 0., 0.), p(1., 1., 0.)],
            [p(0., 0., 0.), p(1., 1., 0.), p(0., 1., 0.)],
        ];
        let high = low.map(|corners| corners.map(|corner| corner + DVec3::Z));
        let faces = |[a, b, c]: [DVec3; 3], down: bool| if down { [a, c, b] } else { [a, b, c] };
        let high = [0, 1].map(|k| (faces(high[k], above[k]), two_sided));
        model(&[(low[0], false), (low[1], false), high[0], high[1]])
    }

    /// Both halves of the lower square together.
    fn of_lower(model: &Model, receives: impl Fn(u32) -> bool + Copy) -> RowShares {
        let [a, b] = [0, 1].map(|patch| {
            measure(model, InputPatch(patch), PERMITTED, receives)
                .expect("it has area")
                .shares
                .to_array()
        });
        RowShares::from_array([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])))
    }

    #[test]
    fn what_no_plate_takes_escapes() {
        let shares = of_lower(&plates([true, true], false), |_| true);
        let most = 4.0 * error(PLATES * (1.0 - PLATES), 1024);
        assert!((shares.escaped + PLATES - 1.0).abs() < most, "{shares:?}, {most}");
        assert_eq!((shares.blocked, shares.unselected), (0.0, 0.0));
        assert!(most < 0.03, "{most}");
    }

    #[test]
    fn backs_block_and_two_sided_patches_do_not() {
        let shares = of_lower(&plates([false, false], false), |_| true);
        assert!((shares.blocked - PLATES).abs() < 0.02, "{shares:?}");
        let shares = of_lower(&plates([false, false], true), |_| true);
        assert_eq!(shares.blocked, 0.0);
        let shares = of_lower(&plates([true, false], false), |_| true);
        assert!((shares.blocked - 0.5 * PLATES).abs() < 0.02, "{shares:?}");
    }

    #[test]
    fn patches_without_a_column_are_unselected() {
        let shares = of_lower(&plates([true, true], false), |patch| patch != 3);
        assert!((shares.unselected - 0.5 * PLATES).abs() < 0.02, "{shares:?}");
        assert_eq!(shares.blocked, 0.0);
    }

    #[test]
    fn the_nearest_counts() {
        let p = DVec3::new;
        let wide = |z: f64, down: bool| {
            let corners = [p(-99., -99., z), p(99., -99., z), p(0., 150., z)];
            (
                if down {
                    [corners[0], corners[2], corners[1]]
                } else {
                    corners
                },
                false,
            )
        };
        let small = ([p(-1., -1., 0.), p(1., -1., 0.), p(0., 1., 0.)], false);
        let seen = model(&[small, wide(1.0, true), wide(2.0, false)]);
        let shares = measure(&seen, InputPatch(0), PERMITTED, |_| true)
            .expect("it has area")
            .shares;
        assert!(shares.lost() < 0.01, "{shares:?}");
        let hidden = model(&[small, wide(2.0, true), wide(1.0, false)]);
        let shares = measure(&hidden, InputPatch(0), PERMITTED, |_| true)
            .expect("it has area")
            .shares;
        assert!(shares.blocked > 0.99, "{shares:?}");
    }

    #[test]
    fn finer_errors_take_more_rays_and_certainty_takes_few() {
        let model = plates([true, true], false);
        let rays = |permitted| {
            measure(&model, InputPatch(0), permitted, |_| true)
                .expect("it has area")
                .rays
        };
        assert_eq!((rays(1.0), rays(1e-6)), (256, 16_384));
        assert!(rays(0.01) > 256 && rays(0.01) <= 1024);
        // Nothing is lost below a plane without end.
        let p = DVec3::new;
        let small = ([p(-1., -1., 0.), p(1., -1., 0.), p(0., 1., 0.)], false);
        let wide = ([p(-999., -999., 1.), p(0., 1500., 1.), p(999., -999., 1.)], false);
        let found = measure(&self::model(&[small, wide]), InputPatch(0), 0.001, |_| true).expect("it has area");
        assert!(found.rays <= 1024, "{found:?}");
    }

    /// CoplanarRegions of neighbouring buildings, a rounding apart: each is seen from its own side, whichever is the
    /// nearer by rounding.
    #[test]
    fn of_coincident_walls_the_front_is_seen() {
        let p = DVec3::new;
        for gap in [-1e-12, 0.0, 1e-12] {
            let wall = |z: f64| [p(-99., -99., z), p(99., -99., z), p(0., 150., z)];
            let [a, b, c] = wall(1.0 + gap);
            let small = ([p(-1., -1., 0.), p(1., -1., 0.), p(0., 1., 0.)], false);
            let seen = model(&[small, (wall(1.0), false), ([a, c, b], false)]);
            let shares = measure(&seen, InputPatch(0), PERMITTED, |_| true)
                .expect("it has area")
                .shares;
            assert!(shares.lost() < 0.01, "{gap}: {shares:?}");
        }
    }
}
