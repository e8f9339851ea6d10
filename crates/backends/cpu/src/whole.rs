//! Triangles that were cut into patches, put together again: what hides what is the same however finely a triangle is cut.
//!
//! Engines 1 and 3 draw the whole triangles, and what is seen of one is then shared out among its patches, none of which hides
//! another. So the work for what is hidden, and for contending for pixels, is that of the scene before it was cut.
//!
//! A whole triangle is found by its patches: one after the other, as [`hemicube_scene::Subdivision`] cuts them, row by row from the
//! first edge, with corners that are the same to the bit where they are shared.

use glam::DVec3;
use hemicube::backend::{Geometry, Surface};
use hemicube::tree::{Block, LANES, Tree};
use std::sync::Arc;

/// Wholes of fewer patches than this each, on average, are not worth the second step.
const LEAST_PATCHES: usize = 4;
/// The finest cut that is looked for: pieces of an edge.
const MOST_PIECES: usize = 256;
/// How far a corner may be off the place that it has in the whole triangle, as a part of the tolerance by which patches count as
/// in one plane: rounding of coordinates.
const OFF: f64 = 1.0 / 16.0;

/// The whole triangles of a scene. Each is known by the ids of its first patch, on the front and on the back.
#[derive(Debug)]
pub(crate) struct Wholes {
    /// Over the whole triangles.
    pub(crate) tree: Arc<Tree>,
    /// The patches of each whole, one whole after the other; those of two share no block, unless they are wholes of one patch.
    pub(crate) blocks: Vec<Block>,
    /// block × 16 + lane of each patch's surface in these.
    pub(crate) slot_of_patch: Vec<u32>,
    /// The whole of each patch.
    of_patch: Vec<u32>,
    wholes: Vec<Whole>,
    /// For each block of the tree.
    lanes: Vec<WholeLanes>,
}

/// What the lanes of a block of whole triangles are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WholeLanes {
    /// Lanes that are triangles that were cut.
    pub(crate) cut: u16,
    /// Their wholes.
    pub(crate) whole: [u32; LANES],
}

/// A whole triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole {
    /// The first patch, on the front.
    pub(crate) front: u32,
    /// How many numbers further the next patch on the same side is: 2 where both sides are patches.
    pub(crate) step: u32,
    /// How many surfaces it was cut into.
    pub(crate) count: u32,
    /// Its first block.
    block: u32,
    /// The box around it.
    pub(crate) center: DVec3,
    pub(crate) half: DVec3,
}

impl Wholes {
    /// The whole triangles of a scene; `None` where too little of it was cut.
    pub(crate) fn new(geometry: &Geometry) -> Option<Self> {
        let surfaces = in_order(geometry)?;
        let off = OFF * geometry.plane_tolerance;
        let mut found = Vec::new();
        let mut at = 0;
        while at < surfaces.len() {
            let pieces = pieces_from(&surfaces[at..], off);
            found.push((at, pieces));
            at += pieces * pieces;
        }
        (found.len() * LEAST_PATCHES <= surfaces.len()).then(|| Self::of(geometry, &surfaces, &found))
    }

    /// Of surfaces in the order of their patches: where each whole begins, and into how many pieces its edges are cut.
    fn of(geometry: &Geometry, surfaces: &[Surface], found: &[(usize, usize)]) -> Self {
        let patch_count = geometry.patch_count;
        let mut made = Self {
            tree: Arc::new(Tree::of_surfaces(
                &found
                    .iter()
                    .map(|&(at, pieces)| whole(&surfaces[at..], pieces))
                    .collect::<Vec<_>>(),
                patch_count,
                geometry.plane_tolerance,
            )),
            blocks: Vec::with_capacity(surfaces.len() / LANES + found.len()),
            slot_of_patch: vec![u32::MAX; patch_count as usize],
            of_patch: vec![u32::MAX; patch_count as usize],
            wholes: Vec::with_capacity(found.len()),
            lanes: Vec::new(),
        };
        // Surfaces that were not cut fill blocks together.
        let mut alone: Vec<u32> = Vec::new();
        for &(at, pieces) in found {
            let count = pieces * pieces;
            let Surface { corners, front, back } = whole(&surfaces[at..], pieces);
            let (low, high) = (
                corners[0].min(corners[1]).min(corners[2]),
                corners[0].max(corners[1]).max(corners[2]),
            );
            #[allow(
                clippy::cast_possible_truncation,
                reason = "fewer than surfaces, of which there are < 2³¹"
            )]
            let (of, block) = (made.wholes.len() as u32, made.blocks.len() as u32);
            #[allow(clippy::cast_possible_truncation, reason = "likewise")]
            made.wholes.push(Whole {
                front: front.0,
                step: 1 + u32::from(back.is_some()),
                count: count as u32,
                block,
                center: (low + high) * 0.5,
                // A hair wider than the corners, as the middle and the half side are rounded.
                half: (high - low) * (0.5 * (1.0 + 1e-12)) + DVec3::splat(1e-15),
            });
            for surface in &surfaces[at..at + count] {
                for patch in [Some(surface.front), surface.back].into_iter().flatten() {
                    made.of_patch[patch.0 as usize] = of;
                }
            }
            #[allow(clippy::cast_possible_truncation, reason = "likewise")]
            let indices = at as u32..(at + count) as u32;
            if count == 1 {
                alone.extend(indices);
            } else {
                let indices: Vec<u32> = indices.collect();
                indices
                    .chunks(LANES)
                    .for_each(|lanes| made.push(surfaces, lanes, patch_count));
            }
        }
        alone
            .chunks(LANES)
            .for_each(|lanes| made.push(surfaces, lanes, patch_count));
        let none = WholeLanes {
            cut: 0,
            whole: [u32::MAX; LANES],
        };
        made.lanes = vec![none; made.tree.blocks.len()];
        for (of, whole) in (0u32..).zip(&made.wholes) {
            let slot = made.tree.slot_of_patch[whole.front as usize] as usize;
            let lanes = &mut made.lanes[slot / LANES];
            lanes.whole[slot % LANES] = of;
            lanes.cut |= u16::from(whole.count > 1) << (slot % LANES);
        }
        made
    }

    /// What the lanes of a block of the tree are.
    pub(crate) fn lanes(&self, block: usize) -> &WholeLanes {
        &self.lanes[block]
    }

    fn push(&mut self, surfaces: &[Surface], lanes: &[u32], patch_count: u32) {
        for (lane, &surface) in lanes.iter().enumerate() {
            let surface = &surfaces[surface as usize];
            #[allow(clippy::cast_possible_truncation, reason = "slots are u32")]
            let slot = (self.blocks.len() * LANES + lane) as u32;
            for patch in [Some(surface.front), surface.back].into_iter().flatten() {
                self.slot_of_patch[patch.0 as usize] = slot;
            }
        }
        self.blocks.push(Block::of(surfaces, lanes, patch_count));
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.wholes.len()
    }

    pub(crate) fn get(&self, whole: u32) -> &Whole {
        &self.wholes[whole as usize]
    }

    /// The ids that triangles that were cut are drawn with.
    pub(crate) fn ids_of_cut(&self) -> impl Iterator<Item = u32> + use<'_> {
        let cut = self.wholes.iter().filter(|whole| whole.count > 1);
        cut.flat_map(|whole| whole.front..whole.front + whole.step)
    }

    /// What is known of what was drawn with an id, if that is a triangle that was cut.
    pub(crate) fn cut(&self, id: u32) -> Option<u32> {
        let whole = *self.of_patch.get(id as usize)?;
        (self.get(whole).count > 1).then_some(whole)
    }

    /// The id that the whole of a patch is drawn with, from the patch's side.
    pub(crate) fn drawn_as(&self, patch: u32) -> u32 {
        let whole = self.get(self.of_patch[patch as usize]);
        whole.front + (patch - whole.front) % whole.step
    }

    /// The blocks of the patches of a whole that was cut.
    pub(crate) fn blocks_of(&self, whole: &Whole) -> std::ops::Range<usize> {
        let first = whole.block as usize;
        first..first + (whole.count as usize).div_ceil(LANES)
    }
}

impl Whole {
    /// Of lanes of a block of its patches, those that show the side that is drawn with this id: of a patch that is all but in line
    /// with the eye, rounding may have the other.
    #[inline(always)]
    pub(crate) fn live(&self, id: u32, seen: &[u32; LANES]) -> u16 {
        seen.iter().enumerate().fold(0, |live, (lane, &patch)| {
            live | u16::from(self.shows(id, patch)) << lane
        })
    }

    /// Whether a patch is a part of it on that side.
    #[inline(always)]
    pub(crate) fn shows(&self, id: u32, patch: u32) -> bool {
        let place = patch.wrapping_sub(id);
        // Steps are 1 or 2.
        place < self.count * self.step && place & (self.step - 1) == 0
    }
}

/// A scene's surfaces in the order of their patches; `None` where patches are numbered otherwise than surface by surface.
fn in_order(geometry: &Geometry) -> Option<Vec<Surface>> {
    let mut surfaces = geometry.surfaces.clone();
    surfaces.sort_unstable_by_key(|s| s.front.0);
    let mut next = 0;
    for surface in &surfaces {
        let back = surface.back.map(|back| back.0);
        if surface.front.0 != next || back.is_some_and(|back| back != next + 1) {
            return None;
        }
        next += 1 + u32::from(back.is_some());
    }
    (next == geometry.patch_count).then_some(surfaces)
}

/// The triangle that the first of these surfaces were cut from.
fn whole(surfaces: &[Surface], pieces: usize) -> Surface {
    // The end of the first row, and the last piece of all.
    let (end, last) = (&surfaces[2 * (pieces - 1)], &surfaces[pieces * pieces - 1]);
    Surface {
        corners: [surfaces[0].corners[0], end.corners[1], last.corners[2]],
        ..surfaces[0]
    }
}

/// Into how many pieces the edges of the triangle are cut that begins with the first of these surfaces; 1 where it was not cut.
fn pieces_from(surfaces: &[Surface], off: f64) -> usize {
    let pieces = first_row(surfaces);
    if pieces > 1 && surfaces.len() >= pieces * pieces && is_cut(&surfaces[..pieces * pieces], pieces, off) {
        pieces
    } else {
        1
    }
}

/// The pieces in the first row that look the same way as the whole: between two of them lies one that looks the other way.
fn first_row(surfaces: &[Surface]) -> usize {
    let mut pieces = 1;
    while pieces < MOST_PIECES
        && let [_, b, c] = surfaces[2 * pieces - 2].corners
        && let Some([turned, next]) = surfaces.get(2 * pieces - 1..=2 * pieces)
        && turned.corners[0] == b
        && turned.corners[2] == c
        && next.corners[0] == b
        && next.corners[2] == turned.corners[1]
    {
        pieces += 1;
    }
    pieces
}

/// Whether surfaces are what a triangle is cut into.
fn is_cut(surfaces: &[Surface], pieces: usize, off: f64) -> bool {
    let Surface {
        corners: [a, b, c],
        back,
        ..
    } = whole(surfaces, pieces);
    let step = 1.0 / pieces as f64;
    // The corners of the row's lower side; each must be where it is in the triangle, and be the same in all that share it.
    let place = |i: usize, j: usize| a + (b - a) * (i as f64 * step) + (c - a) * (j as f64 * step);
    let is_there = |p: DVec3, i: usize, j: usize| (p - place(i, j)).abs().max_element() <= off;
    let mut rest = surfaces.iter();
    let mut lower: Vec<DVec3> = Vec::new();
    for j in 0..pieces {
        let mut upper = Vec::with_capacity(pieces - j);
        for i in 0..pieces - j {
            let Some(&Surface {
                corners: [p, q, r],
                back: of_piece,
                ..
            }) = rest.next()
            else {
                return false;
            };
            if j == 0 {
                if i == 0 {
                    lower.push(p);
                }
                lower.push(q);
            }
            if p != lower[i] || q != lower[i + 1] || of_piece.is_some() != back.is_some() {
                return false;
            }
            if upper.last().is_some_and(|&last| last != r) {
                return false;
            }
            if upper.is_empty() {
                upper.push(r);
            }
            if !is_there(q, i + 1, j) || !is_there(r, i, j + 1) {
                return false;
            }
            if i + j + 1 < pieces {
                let Some(&Surface {
                    corners: [s, t, u],
                    back: of_piece,
                    ..
                }) = rest.next()
                else {
                    return false;
                };
                if s != q || u != r || of_piece.is_some() != back.is_some() {
                    return false;
                }
                upper.push(t);
            }
        }
        lower = upper;
    }
    rest.next().is_none()
}
