//! Rays for the device, and its answers: [`stage::CAST_RAYS`](crate::stage::CAST_RAYS).
//!
//! Corners, starts and directions are rounded to f32, and a device may round each operation either way and put them in
//! another order. Every decision therefore has a bound on its error, and is a certain one only beyond it, as in a filter
//! of geometric predicates (Shewchuk 1997). A ray with a decision that is not certain and may matter is left to the host.
//!
//! Coordinates are at most 1, but for rounding. A triangle's corners, relative to the start, are sheared along the ray so
//! that it passes through (0, 0) (Woop, Benthin & Wald 2013). With m for the largest coordinate of a relative corner:
//!
//! - A sheared coordinate is off by 2⁻²⁴ (2 + 2) for rounded corners and starts, and for its five operations, each off by
//!   2⁻²³ of a number up to 2m, or up to 1 where they are put in another order: by less than η = 2⁻²⁰ (1 + m).
//! - The product of two of them, x y' − y x', is off by η Σ |x| and two roundings of products; 2 η Σ |x| + 10⁻⁹ is more.
//!   10⁻⁹ is also more than the rounding of the host's test in f64, with its own margin.
//! - Depth is that of corners weighted by these products, so that it is off by their errors, relative to their sum, times
//!   the range of the corners' depths, and by 2 η. A height above the emitter's plane is off by 2 η.
//!
//! A surface that lies on the emitter would make all its rays doubtful, as f32 cannot tell it from one a hair above the
//! emitter's plane. The host can, and names up to eight that it is certain of.
//!
//! No corners in pairs of f32, which would make η relative to m alone, because they take twice the memory, and few rays
//! are doubtful without ([docs/dev/gpu.md](../../../../docs/dev/gpu.md)).

use glam::DVec3;
use hemicube_contract::backend::{BackendError, Geometry, Rays};
use hemicube_contract::bvh::{Bounds, INNER, LANES, Tree, UNUSED, overlap};
use hemicube_contract::face::Items;
use std::sync::Arc;

/// Rays of a dispatch at most. A choice: buffers for more mostly stay empty, as few rungs of a ladder add more; fewer
/// make more dispatches, each waited for.
pub const MOST_RAYS: usize = 1 << 17;
/// Threads of a work group.
pub const GROUP: u32 = 64;
/// Words before the rays, and of each.
const HEADER_WORDS: usize = 16;
const RAY_WORDS: usize = 8;
/// Surfaces on the emitter that are named. A choice: of more the rays are doubtful, and each is one more comparison at
/// every triangle.
const MOST_BELOW: usize = 8;
/// Blocks of triangles that are looked at for them: a tenth of a millisecond.
const MOST_BLOCKS: usize = 256;
/// Depth below the emitter's plane down to which f32 may see a surface on it: above η.
const ON: f64 = 1e-5;
/// Words of the largest dispatch.
pub const MOST_WORDS: usize = HEADER_WORDS + RAY_WORDS * MOST_RAYS;

/// The contract's tree in the device's words: some 60 bytes a triangle of the scene, and again on the device for each
/// session, where rays take 5 MB besides.
#[derive(Debug)]
pub struct RayTree {
    /// Eight a node: middle and half sides of its box, with the first child or triangle, and the number of triangles, 0
    /// for an inner node.
    pub nodes: Vec<u32>,
    /// Twelve a triangle: its corners, with the id seen from either side; see [`hemicube_contract::bvh::Block`].
    pub triangles: Vec<u32>,
    tree: Arc<Tree>,
    /// First triangle of each block, and their number.
    runs: Vec<(u32, u32)>,
}

/// Rounds to nearest.
#[allow(clippy::cast_possible_truncation, reason = "the bounds know of it")]
fn rounded(x: f64) -> u32 {
    (x as f32).to_bits()
}

/// Rounds a positive number up.
#[allow(clippy::cast_possible_truncation, reason = "raised by more than it loses")]
fn raised(x: f64) -> u32 {
    ((x * (1.0 + 1e-6)) as f32).to_bits()
}

impl RayTree {
    /// The tree of a scene, made when first asked for.
    pub fn of(geometry: &Geometry) -> Arc<Self> {
        geometry.kept(|geometry| Self::new(Tree::of(geometry)))
    }

    /// Refuses a scene whose tree, or rays, no buffer of a device holds: `most` bytes each.
    ///
    /// # Errors
    /// [`BackendError::Unsupported`], naming what is too large.
    pub fn require_range(&self, most: u64) -> Result<(), BackendError> {
        let buffers = [
            ("the tree of rays", self.nodes.len()),
            ("triangles for rays", self.triangles.len()),
            ("rays", MOST_WORDS),
        ];
        for (what, words) in buffers {
            let bytes = 4 * words as u64;
            if bytes > most {
                return Err(BackendError::Unsupported(format!(
                    "{what} take {bytes} bytes where the device has at most {most}; take `rays=off`"
                )));
            }
        }
        Ok(())
    }

    fn new(tree: Arc<Tree>) -> Self {
        let mut triangles = Vec::new();
        let mut runs = Vec::with_capacity(tree.blocks.len());
        let mut first = 0;
        for block in &tree.blocks {
            let mut count = 0;
            for lane in (0..LANES).filter(|&lane| block.negative[lane] != UNUSED) {
                let id = |id: u32| if id == tree.patch_count { Items::BLOCKED } else { id };
                let besides = [id(block.negative[lane]), id(block.positive[lane]), 0];
                for (corner, besides) in block.triangle(lane).into_iter().zip(besides) {
                    triangles.extend(corner.to_array().map(rounded));
                    triangles.push(besides);
                }
                count += 1;
            }
            runs.push((first, count));
            first += count;
        }
        let nodes = tree.nodes.iter().flat_map(|node| {
            let (place, count) = if node.block == INNER {
                (node.child, 0)
            } else {
                runs[node.block as usize]
            };
            let center = node.center.to_array().map(rounded);
            let moved = DVec3::from_array(center.map(|word| f64::from(f32::from_bits(word)))) - node.center;
            let half = (node.half + moved.abs()).to_array().map(raised);
            [center[0], center[1], center[2], place, half[0], half[1], half[2], count]
        });
        Self {
            nodes: nodes.collect(),
            triangles,
            tree,
            runs,
        }
    }

    /// Triangles on the emitter that certainly do not rise above its plane; `u32::MAX` for the others of eight.
    fn below(&self, rays: &Rays<'_>) -> [u32; MOST_BELOW] {
        let (mut found, mut count) = ([u32::MAX; MOST_BELOW], 0);
        let tree = &self.tree;
        let slot = tree.slot_of_patch[rays.emitter.0 as usize] as usize;
        let Some(block) = tree.blocks.get(slot / LANES) else {
            return found;
        };
        let corners = block.triangle(slot % LANES);
        let mut pending = Vec::new();
        let near = tree.blocks_in(Bounds::of(corners).widened(ON), &mut pending);
        for block in near.take(MOST_BLOCKS).map(|block| block as usize) {
            let (first, lanes) = self.runs[block];
            for (triangle, lane) in (first..first + lanes).zip(0..) {
                if block * LANES + lane == slot {
                    continue;
                }
                let other = tree.blocks[block].triangle(lane);
                let heights = other.map(|corner| rays.normal.dot(corner) - rays.offset);
                // Half the tolerance is far beyond the rounding of whoever asks again.
                let is_on = heights.iter().all(|&h| h <= 0.5 * tree.plane_tolerance && h >= -ON);
                if count < MOST_BELOW && is_on && overlap(&corners, &other, rays.normal, tree.plane_tolerance) {
                    found[count] = triangle;
                    count += 1;
                }
            }
            if count >= MOST_BELOW {
                break;
            }
        }
        found
    }

    /// The words of at most [`MOST_RAYS`] rays of a patch, with those of all before them.
    pub fn words(&self, rays: &Rays<'_>, ends: &[[DVec3; 2]]) -> Vec<u32> {
        let [x, y, z] = rays.normal.to_array().map(rounded);
        let count = u32::try_from(ends.len()).unwrap_or(u32::MAX);
        let header = [
            x,
            y,
            z,
            rounded(self.tree.plane_tolerance),
            rays.emitter.0,
            count,
            raised(Rays::TIE * self.tree.plane_tolerance),
            0,
        ];
        let mut words = Vec::with_capacity(HEADER_WORDS + RAY_WORDS * ends.len());
        words.extend(header);
        words.extend(self.below(rays));
        for &[start, end] in ends {
            let along = end - start;
            let axis = (0..3).fold(0, |best, k| if along[k].abs() > along[best].abs() { k } else { best });
            let depth = along[axis].abs();
            // Left to the host: without length, so long that f32 has no place on it, or from where the bounds do not hold.
            let is_left = !(1e-30..=1e6).contains(&depth) || start.abs().max_element() > 1.0 + 1e-6;
            let depth = if is_left { -1.0 } else { depth };
            let shear = [(axis + 1) % 3, (axis + 2) % 3].map(|k| rounded(along[k] / along[axis]));
            let bits = [0, 1, 2][axis] | u32::from(along[axis] < 0.0) << 2;
            let height = rays.normal.dot(start) - rays.offset;
            let [x, y, z] = start.to_array().map(rounded);
            words.extend([x, y, z, rounded(depth), shear[0], shear[1], bits, rounded(height)]);
        }
        words
    }
}

/// Work groups for so many rays.
pub fn groups(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX).div_ceil(GROUP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_contract::InputPatch;

    #[test]
    fn boxes_of_f32_hold_those_of_f64() {
        let p = |k: u32| DVec3::new(0.1, 0.3, 0.7) * (f64::from(k).sin() / 3.0);
        let surfaces: Vec<_> = (0..200)
            .map(|k| hemicube_contract::backend::Surface {
                corners: [p(k), p(k + 1) + DVec3::X * 0.1, p(k + 2) + DVec3::Y * 0.1],
                front: InputPatch(k),
                back: None,
            })
            .collect();
        let tree = Arc::new(Tree::of_surfaces(&surfaces, 200, 1e-10));
        let made = RayTree::new(Arc::clone(&tree));
        let value = |word: u32| f64::from(f32::from_bits(word));
        for (node, words) in tree.nodes.iter().zip(made.nodes.chunks_exact(8)) {
            for k in 0..3 {
                let (center, half) = (value(words[k]), value(words[4 + k]));
                assert!(
                    center - half <= node.center[k] - node.half[k] && node.center[k] + node.half[k] <= center + half
                );
            }
        }
        assert_eq!(made.triangles.len(), 12 * 200);
        let counted: u32 = made.nodes.chunks_exact(8).map(|node| node[7]).sum();
        assert_eq!(counted, 200, "each triangle in one leaf");
    }

    #[test]
    fn what_lies_on_the_emitter_is_named_and_nothing_else() {
        let p = DVec3::new;
        let tolerance = 1e-10;
        let at = |x: f64, z: f64| [p(x, 0.0, z), p(x + 1.0, 0.0, z), p(x, 1.0, z)];
        let tilted = [p(0.0, 0.0, 0.0), p(1.0, 0.0, 0.0), p(0.0, 1.0, 2.0 * tolerance)];
        // The emitter; on it; a hair below; a tolerance above; far below; beside; with one corner above.
        let places = [
            at(0.0, 0.0),
            at(0.1, 0.0),
            at(0.2, -1e-7),
            at(0.0, tolerance),
            at(0.0, -2.0 * ON),
            at(5.0, 0.0),
            tilted,
        ];
        let surfaces: Vec<_> = (0..)
            .zip(places)
            .map(|(k, corners)| hemicube_contract::backend::Surface {
                corners,
                front: InputPatch(k),
                back: None,
            })
            .collect();
        let count = u32::try_from(surfaces.len()).expect("seven");
        let tree = RayTree::new(Arc::new(Tree::of_surfaces(&surfaces, count, tolerance)));
        let rays = Rays {
            emitter: InputPatch(0),
            normal: DVec3::Z,
            offset: 0.0,
            ends: &[],
        };
        let named = tree.below(&rays);
        // A triangle's patch is on either side of it, next to a back.
        let patch = |triangle: &u32| {
            let words = &tree.triangles[12 * *triangle as usize..][..12];
            words[3].min(words[7])
        };
        let mut patches: Vec<u32> = named
            .iter()
            .filter(|&&triangle| triangle != u32::MAX)
            .map(patch)
            .collect();
        patches.sort_unstable();
        assert_eq!(patches, [1, 2]);
    }

    #[test]
    fn rays_that_f32_cannot_hold_are_left() {
        let surface = hemicube_contract::backend::Surface {
            corners: [DVec3::ZERO, DVec3::X, DVec3::Y],
            front: InputPatch(0),
            back: None,
        };
        let tree = RayTree::new(Arc::new(Tree::of_surfaces(&[surface], 1, 1e-10)));
        let ends = [
            [DVec3::ZERO, DVec3::Z],
            [DVec3::ZERO, DVec3::ZERO],
            [DVec3::ZERO, DVec3::Z * 1e7],
            [DVec3::X * 1.1, DVec3::Z],
        ];
        let rays = Rays {
            emitter: InputPatch(0),
            normal: DVec3::Z,
            offset: 0.0,
            ends: &ends,
        };
        let words = tree.words(&rays, &ends);
        let depths: Vec<f32> = words[HEADER_WORDS..]
            .chunks_exact(RAY_WORDS)
            .map(|ray| f32::from_bits(ray[3]))
            .collect();
        assert_eq!(depths, [1.0, -1.0, -1.0, -1.0]);
        let most = 4 * MOST_WORDS as u64;
        assert!(tree.require_range(most).is_ok());
        let refused = tree
            .require_range(most - 1)
            .expect_err("too small for the rays")
            .to_string();
        assert!(refused.starts_with("rays take "), "{refused}");
    }
}
