//! Triangles that were cut into patches, put together again: what hides what is the same however finely a triangle is
//! cut.
//!
//! Engines draw the whole triangles, and what is seen of one is then shared out among its patches, none of which hides
//! another. So the work for what is hidden, and for contending for pixels, is that of the scene before it was cut.
//!
//! A whole triangle is found by its patches: one after the other, as `hemicube_scene::Subdivision` cuts them, row by
//! row from the first edge, with corners that are the same to the bit where they are shared. Their corners are not
//! kept: they are where the whole's are and the number of pieces say.
//!
//! All draw triangles that were cut into patches as they were before (`whole.rs`). What was cut is found by its
//! patches, which come one after the other in the rows of a lattice and share corners to the bit: no scene need say so,
//! and geometry that a caller hands over gains likewise. The tree is over the whole triangles, each drawn with the id
//! of its first patch on the side that is seen; then the pixels that show one are opened in a coverage that is
//! otherwise full, and its patches, made from the lattice as they are needed, are drawn into them by the kernel of
//! *order*. Pixels that rounding leaves over are given to the patch that shows most, or the nearest to the eye where
//! none does, so that no weight is lost. Pixel sums are those of the patches, to the bit, unless an eye lies on the
//! edge of a triangle and in its plane; of tiny patches, those of a triangle that covers pixels and shows none are not
//! asked whether they are seen, so engines say another version where they draw whole. The emitter's triangle is left
//! out as a whole, as its patches are all below the horizon; a hemicube that does not stand on it, or looks along it,
//! as only a caller's own does, is drawn patch by patch (`Wholes::is_stood_on`). *Order* draws whole, too, but for
//! weights of the finest hemicubes (N = 1024), where drawing all pixels twice takes longer than looking for what is
//! hidden of the patches themselves.
//!
//! Corrections make nothing of weights but fractions, and load a backend for those (`load_for_fractions`, by default
//! the same as `load`; `compute::load` is how a run does it, so that a backend says beforehand what it will be). Then a
//! whole of which all covered pixels are seen has its patches listed without looking at them, and of another only
//! patches are rasterised whose box of pixels is not wholly in what is seen of it; patches that show all that they
//! cover share evenly what the rest leave of the whole's weight. So rows still sum to 2³¹, and fractions are those of
//! weights, to the bit (`tests/tests/fractions.rs`); what is added are patches without a pixel at the rim of a whole
//! that is seen. Whether a patch is asked must not hang on what culling left unknown: covered pixels of a whole are
//! counted where they are not known.
//!
//! Triangles that were cut are found, not handed down, because a field for it in `Geometry` would be one more thing
//! that backends and embedders must keep true; finding them takes less time than the larger tree does that they save.

use crate::kernel::Frame;
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Geometry, Hemicube, Surface};
use hemicube_contract::bvh::{Block, LANES, Tree};
use hemicube_contract::face::Face;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Wholes of fewer patches than this each, on average, are not worth the second step.
const LEAST_PATCHES: usize = 4;
/// The finest cut that is looked for: pieces of an edge.
const MOST_PIECES: usize = 256;
/// How far a corner may be off the place that it has in the whole triangle, as a part of the tolerance by which patches
/// count as in one plane: rounding of coordinates.
const OFF: f64 = 1.0 / 16.0;

/// The whole triangles of a scene, some of which may be patches themselves. Each is drawn with the id of its first
/// patch on the side that is seen.
#[derive(Debug)]
pub(crate) struct Wholes {
    /// Over the whole triangles.
    pub(crate) tree: Arc<Tree>,
    /// In the order of their patches.
    wholes: Vec<Whole>,
    /// For each block of the tree.
    lanes: Vec<WholeLanes>,
    /// One for each number of pieces that edges are cut into.
    lattices: Vec<Lattice>,
}

/// A whole triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whole {
    /// Corners of the front, counter-clockwise.
    corners: [DVec3; 3],
    /// The first patch, on the front.
    front: u32,
    /// Step in numbers to the next patch on the same side is: 2 where both sides are patches.
    step: u32,
    /// Number of patches that a side has.
    count: u32,
    lattice: u32,
}

/// What the lanes of a block of whole triangles are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WholeLanes {
    /// Lanes that are triangles that were cut.
    pub(crate) cut: u16,
    /// Their wholes.
    pub(crate) whole: [u32; LANES],
}

/// Where the corners of patches are in a triangle whose edges are cut into so many pieces, sixteen patches at a time.
#[derive(Debug)]
struct Lattice {
    blocks: Vec<LatticeBlock>,
}

/// How far along the first edge and along the last, from the first corner, each corner is. Lanes without a patch have
/// no area.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct LatticeBlock {
    along: [[f64; LANES]; 3],
    across: [[f64; LANES]; 3],
}

impl Lattice {
    fn new(pieces: usize) -> Self {
        let empty = LatticeBlock {
            along: [[0.0; LANES]; 3],
            across: [[0.0; LANES]; 3],
        };
        let mut blocks = vec![empty; (pieces * pieces).div_ceil(LANES)];
        let mut patch = 0;
        let mut push = |corners: [(usize, usize); 3]| {
            let (block, lane) = (&mut blocks[patch / LANES], patch % LANES);
            for (k, (i, j)) in corners.into_iter().enumerate() {
                block.along[k][lane] = i as f64 / pieces as f64;
                block.across[k][lane] = j as f64 / pieces as f64;
            }
            patch += 1;
        };
        for j in 0..pieces {
            for i in 0..pieces - j {
                push([(i, j), (i + 1, j), (i, j + 1)]);
                if i + j + 1 < pieces {
                    push([(i + 1, j), (i + 1, j + 1), (i, j + 1)]);
                }
            }
        }
        Self { blocks }
    }
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
            found.push((whole(&surfaces[at..], pieces), pieces));
            at += pieces * pieces;
        }
        (found.len() * LEAST_PATCHES <= surfaces.len()).then(|| Self::of(geometry, &found))
    }

    /// Of triangles by their first patches, and the number of pieces that their edges are cut into.
    fn of(geometry: &Geometry, found: &[(Surface, usize)]) -> Self {
        let mut of_pieces = BTreeMap::new();
        let mut lattices = Vec::new();
        let mut wholes = Vec::with_capacity(found.len());
        #[allow(
            clippy::cast_possible_truncation,
            reason = "fewer than patches, of which there are < 2³¹"
        )]
        for &(Surface { corners, front, back }, pieces) in found {
            let lattice = *of_pieces.entry(pieces).or_insert_with(|| {
                lattices.push(Lattice::new(pieces));
                lattices.len() - 1
            });
            wholes.push(Whole {
                corners,
                front: front.0,
                step: 1 + u32::from(back.is_some()),
                count: (pieces * pieces) as u32,
                lattice: lattice as u32,
            });
        }
        let surfaces: Vec<Surface> = found.iter().map(|&(surface, _)| surface).collect();
        let tree = Tree::of_surfaces(&surfaces, geometry.patch_count, geometry.plane_tolerance);
        let none = WholeLanes {
            cut: 0,
            whole: [u32::MAX; LANES],
        };
        let mut lanes = vec![none; tree.blocks.len()];
        for (of, whole) in (0u32..).zip(&wholes) {
            let slot = tree.slot_of_patch[whole.front as usize] as usize;
            let lanes = &mut lanes[slot / LANES];
            lanes.whole[slot % LANES] = of;
            lanes.cut |= u16::from(whole.count > 1) << (slot % LANES);
        }
        Self {
            tree: Arc::new(tree),
            wholes,
            lanes,
            lattices,
        }
    }

    /// The whole triangles, as surfaces that are the first of their patches.
    pub(crate) fn surfaces(&self) -> Vec<Surface> {
        let surface = |whole: &Whole| Surface {
            corners: whole.corners,
            front: InputPatch(whole.front),
            back: (whole.step == 2).then_some(InputPatch(whole.front + 1)),
        };
        self.wholes.iter().map(surface).collect()
    }

    /// What the lanes of a block of the tree are.
    pub(crate) fn lanes(&self, block: usize) -> &WholeLanes {
        &self.lanes[block]
    }

    /// The number that there are.
    pub(crate) fn len(&self) -> usize {
        self.wholes.len()
    }

    pub(crate) fn get(&self, whole: u32) -> &Whole {
        &self.wholes[whole as usize]
    }

    /// Whether a hemicube stands on the whole triangle of its emitter and looks away from it, so that none of the
    /// triangle's other patches is seen either; so does one that has no emitter.
    pub(crate) fn is_stood_on(&self, hemicube: &Hemicube, tolerance: f64) -> bool {
        /// A thousandth of a radian: of slivers, normals are not known better.
        const ALONG: f64 = 1.0 - 0.5e-6;
        let Some(emitter) = hemicube.emitter else {
            return true;
        };
        let whole = self.of_patch(emitter.0);
        let [a, b, c] = whole.corners;
        let normal = (b - a).cross(c - a);
        let (size, to_eye) = (normal.length(), hemicube.origin - a);
        let extent = (b - a).length().max((c - a).length()).max(to_eye.length());
        let rounding = 64.0 * f64::EPSILON * extent * extent;
        whole.count == 1
            || normal.dot(to_eye).abs() <= tolerance * size + rounding * extent
                && normal.dot(hemicube.axes[2]).abs() >= ALONG * size - rounding
    }

    /// The ids that triangles that were cut are drawn with.
    pub(crate) fn ids_of_cut(&self) -> impl Iterator<Item = u32> + use<'_> {
        let cut = self.wholes.iter().filter(|whole| whole.count > 1);
        cut.flat_map(|whole| whole.front..whole.front + whole.step)
    }

    /// The whole that is drawn with an id, if it is a triangle that was cut.
    pub(crate) fn cut(&self, id: u32) -> Option<u32> {
        let slot = self.tree.slot_of_patch[id as usize] as usize;
        let (lanes, lane) = (&self.lanes[slot / LANES], slot % LANES);
        (lanes.cut >> lane & 1 != 0).then(|| lanes.whole[lane])
    }

    fn of_patch(&self, patch: u32) -> &Whole {
        &self.wholes[self.wholes.partition_point(|whole| whole.front <= patch) - 1]
    }

    /// The id that the whole of a patch is drawn with, from the patch's side.
    pub(crate) fn drawn_as(&self, patch: u32) -> u32 {
        let whole = self.of_patch(patch);
        whole.front + (patch - whole.front) % whole.step
    }

    /// Number of blocks that the patches of a whole take.
    pub(crate) fn block_count(&self, whole: &Whole) -> usize {
        self.lattices[whole.lattice as usize].blocks.len()
    }

    /// The patches of a whole that is drawn with an id, sixteen of them. Which side of one is seen is not told: see
    /// [`Whole::sign`].
    #[inline(always)]
    pub(crate) fn patches(&self, whole: &Whole, id: u32, block: usize, out: &mut Block) {
        let lattice = &self.lattices[whole.lattice as usize].blocks[block];
        let [a, b, c] = whole.corners.map(|p| p.to_array());
        for k in 0..3 {
            for x in 0..3 {
                let (first, last) = (b[x] - a[x], c[x] - a[x]);
                for l in 0..LANES {
                    out.corners[3 * k + x][l] = a[x] + first * lattice.along[k][l] + last * lattice.across[k][l];
                }
            }
        }
        let mut patch = 0;
        for l in 0..LANES {
            #[allow(clippy::cast_possible_truncation, reason = "fewer than patches")]
            let place = (block * LANES + l) as u32;
            patch = if place < whole.count {
                id + place * whole.step
            } else {
                patch
            };
            out.negative[l] = patch;
            out.positive[l] = patch;
        }
    }

    /// The patch of a whole, drawn with an id, whose middle is nearest to the eye.
    pub(crate) fn nearest(&self, whole: &Whole, id: u32, frame: &Frame) -> u32 {
        let eye = DVec3::from_array(frame.origin);
        let distance = |patch: u32| {
            let mut block = Block::empty();
            self.put(patch, 0, &mut block);
            (block.triangle(0).into_iter().sum::<DVec3>() / 3.0).distance_squared(eye)
        };
        (0..whole.count)
            .map(|place| id + place * whole.step)
            .map(|patch| (patch, distance(patch)))
            .fold(
                (id, f64::INFINITY),
                |best, next| if next.1 < best.1 { next } else { best },
            )
            .0
    }

    /// Puts a patch into a lane of a block.
    pub(crate) fn put(&self, patch: u32, lane: usize, out: &mut Block) {
        let whole = self.of_patch(patch);
        let place = ((patch - whole.front) / whole.step) as usize;
        let (lattice, from) = (
            &self.lattices[whole.lattice as usize].blocks[place / LANES],
            place % LANES,
        );
        let [a, b, c] = whole.corners.map(|p| p.to_array());
        for k in 0..3 {
            for x in 0..3 {
                let (first, last) = (b[x] - a[x], c[x] - a[x]);
                out.corners[3 * k + x][lane] = a[x] + first * lattice.along[k][from] + last * lattice.across[k][from];
            }
        }
        (out.negative[lane], out.positive[lane]) = (patch, patch);
    }
}

impl Whole {
    /// The sign that edges of its patches are multiplied by where the side is seen that is drawn with an id. Of a patch
    /// that is all but in line with the eye, rounding may have the other.
    pub(crate) fn sign(&self, id: u32) -> f64 {
        if id == self.front { -1.0 } else { 1.0 }
    }

    /// Returns whether all of its patches reach above a frame's horizon.
    pub(crate) fn is_above(&self, frame: &Frame) -> bool {
        let [normal, origin] = [frame.axes[2], frame.origin].map(DVec3::from_array);
        let [a, b, c] = self.corners.map(|corner| normal.dot(corner - origin));
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        // Each is as high as the whole, but smaller, and none begins lower.
        least + (most - least) / f64::from(self.count).sqrt() > frame.tolerance * 1.001
    }

    /// Faces that it may be on: those whose pyramid it does not lie beyond a side of.
    pub(crate) fn faces(&self, frame: &Frame) -> u8 {
        let [x_axis, y_axis, z_axis] = frame.axes.map(DVec3::from_array);
        let origin = DVec3::from_array(frame.origin);
        // What the planes between faces are made of: x, y, z, x - y, x + y and z - x, z + x, z - y, z + y; the least
        // and the most.
        let (mut least, mut most) = ([f64::INFINITY; 9], [f64::NEG_INFINITY; 9]);
        for corner in &self.corners {
            let d = *corner - origin;
            let (x, y, z) = (x_axis.dot(d), y_axis.dot(d), z_axis.dot(d));
            let heights = [x, y, z, x - y, x + y, z - x, z + x, z - y, z + y];
            for (k, &height) in heights.iter().enumerate() {
                least[k] = if height < least[k] { height } else { least[k] };
                most[k] = if height > most[k] { height } else { most[k] };
            }
        }
        let (above, below) = (|k: usize| most[k] >= 0.0, |k: usize| least[k] <= 0.0);
        let on = |face: Face, is: bool| u8::from(is) << face as u8;
        let up = above(2);
        on(Face::Top, up & above(5) & above(6) & above(7) & above(8))
            | on(Face::PosX, up & above(0) & above(3) & above(4) & below(5))
            | on(Face::NegX, up & below(0) & below(3) & below(4) & below(6))
            | on(Face::PosY, up & above(1) & below(3) & above(4) & below(7))
            | on(Face::NegY, up & below(1) & above(3) & below(4) & below(8))
    }

    /// Its patches, where it is drawn with an id.
    pub(crate) fn patches(&self, id: u32) -> impl Iterator<Item = u32> + use<> {
        let step = self.step;
        (0..self.count).map(move |place| id + place * step)
    }

    /// The middle of the box around it, and half its sides.
    pub(crate) fn bounds(&self) -> (DVec3, DVec3) {
        let [a, b, c] = self.corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        // A hair wider than the corners, as the middle and the half side are rounded.
        (
            (low + high) * 0.5,
            (high - low) * (0.5 * (1.0 + 1e-12)) + DVec3::splat(1e-15),
        )
    }
}

/// A scene's surfaces in the order of their patches; `None` where patches are numbered otherwise than surface by
/// surface.
fn in_order(geometry: &Geometry) -> Option<Vec<&Surface>> {
    let mut surfaces: Vec<&Surface> = geometry.surfaces.iter().collect();
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
fn whole(surfaces: &[&Surface], pieces: usize) -> Surface {
    // The end of the first row, and the last piece of all.
    let (end, last) = (surfaces[2 * (pieces - 1)], surfaces[pieces * pieces - 1]);
    Surface {
        corners: [surfaces[0].corners[0], end.corners[1], last.corners[2]],
        ..*surfaces[0]
    }
}

/// Into how many pieces the edges of the triangle are cut that begins with the first of these surfaces; 1 where it was
/// not cut.
fn pieces_from(surfaces: &[&Surface], off: f64) -> usize {
    let pieces = first_row(surfaces);
    if pieces > 1 && surfaces.len() >= pieces * pieces && is_cut(&surfaces[..pieces * pieces], pieces, off) {
        pieces
    } else {
        1
    }
}

/// The pieces in the first row that look the same way as the whole: between two of them lies one that looks the other
/// way.
fn first_row(surfaces: &[&Surface]) -> usize {
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

/// Returns whether surfaces are what a triangle is cut into.
fn is_cut(surfaces: &[&Surface], pieces: usize, off: f64) -> bool {
    let Surface {
        corners: [a, b, c],
        back,
        ..
    } = whole(surfaces, pieces);
    let step = 1.0 / pieces as f64;
    // The corners of the row's lower side; each must be where it is in the triangle, and be the same in all that share
    // it.
    let place = |i: usize, j: usize| a + (b - a) * (i as f64 * step) + (c - a) * (j as f64 * step);
    let is_there = |p: DVec3, i: usize, j: usize| (p - place(i, j)).abs().max_element() <= off;
    let mut rest = surfaces.iter();
    let mut lower: Vec<DVec3> = Vec::new();
    for j in 0..pieces {
        let mut upper = Vec::with_capacity(pieces - j);
        for i in 0..pieces - j {
            let Some(&&Surface {
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
                let Some(&&Surface {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::order::Draw;
    use hemicube::{HierarchyOptions, Model};
    use hemicube_scene::generate::{Generate, Kind, cornell_box, generate};
    use hemicube_scene::{Patches, Scene, Subdivision};

    fn model(scene: &Scene, subdivision: Subdivision) -> Model {
        let patches = Patches::new(scene, subdivision).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    fn geometry(scene: &Scene, subdivision: Subdivision) -> Arc<Geometry> {
        Arc::clone(model(scene, subdivision).geometry())
    }

    /// Or they would be drawn patch by patch.
    #[test]
    fn a_model_s_hemicubes_stand_on_their_triangles() {
        let of = |kind, target_patches| {
            let spec = Generate {
                kind,
                target_patches,
                seed: 1,
            };
            generate(spec).expect("a scene")
        };
        // A wall a thousand times as long as it is high, and one that is ten million times as long, far from the middle
        // and turned.
        let mut slivers = of(Kind::Soup, 400);
        let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.7, 0.4, 0.2);
        for (k, height) in [1e-3, 1e-7].into_iter().enumerate() {
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.3, height)];
            slivers.triangles[k].corners = corners.map(|(x, y)| turn * DVec3::new(x + 40.0, y, 3.0));
        }
        let mut stood_on = 0;
        for (scene, subdivision) in [
            (cornell_box(), Subdivision::Levels(4)),
            (of(Kind::City, 500), Subdivision::Split(5)),
            (of(Kind::Spheres, 500), Subdivision::Split(2)),
            (slivers, Subdivision::Split(7)),
        ] {
            let model = model(&scene, subdivision);
            let geometry = model.geometry();
            let wholes = Wholes::new(geometry).expect("it was cut");
            for hemicube in model.order().flat_map(|patch| model.hemicubes(patch, 2, true)) {
                assert!(wholes.is_stood_on(&hemicube, geometry.plane_tolerance), "{hemicube:?}");
                stood_on += 1;
                let mut off = hemicube;
                off.origin += off.axes[2] * 1e-4;
                let is_cut = wholes.of_patch(hemicube.emitter.expect("its own").0).count > 1;
                assert!(!is_cut || !wholes.is_stood_on(&off, geometry.plane_tolerance));
                off = hemicube;
                off.axes[2] = (off.axes[2] + 0.01 * off.axes[0]).normalize();
                assert!(!is_cut || !wholes.is_stood_on(&off, geometry.plane_tolerance));
            }
        }
        assert!(stood_on > 50_000, "{stood_on}");
    }

    fn of_kind(kind: Kind) -> Scene {
        let spec = Generate {
            kind,
            target_patches: 2_000,
            seed: 3,
        };
        generate(spec).expect("a target in range")
    }

    /// Every patch is where its whole has it, and is on the side that the whole is drawn as.
    fn assert_made_up_of(wholes: &Wholes, geometry: &Geometry) {
        let off = OFF * geometry.plane_tolerance;
        for surface in &geometry.surfaces {
            for (side, patch) in [Some(surface.front), surface.back].into_iter().flatten().enumerate() {
                let mut block = Block::empty();
                wholes.put(patch.0, 5, &mut block);
                for (found, wanted) in block.triangle(5).into_iter().zip(surface.corners) {
                    assert!((found - wanted).abs().max_element() <= off, "patch {patch:?}");
                }
                let whole = wholes.of_patch(patch.0);
                let id = wholes.drawn_as(patch.0);
                assert_eq!(
                    id,
                    whole.front + u32::try_from(side).expect("0 or 1"),
                    "patch {patch:?}"
                );
                assert_eq!(wholes.cut(id).is_some(), whole.count > 1, "patch {patch:?}");
                // The same patch, the same corners, among all of its whole.
                let place = ((patch.0 - whole.front) / whole.step) as usize;
                let mut all = Block::empty();
                wholes.patches(whole, id, place / LANES, &mut all);
                assert_eq!(all.positive[place % LANES], patch.0);
                assert_eq!(all.triangle(place % LANES), block.triangle(5), "patch {patch:?}");
            }
        }
    }

    #[test]
    fn what_was_cut_is_found() {
        for sides in [0, 1, 2] {
            let mut scene = cornell_box();
            for triangle in scene.triangles.iter_mut().step_by(3 - sides).take(40 * sides) {
                triangle.two_sided = true;
            }
            for pieces in 2..=9 {
                let geometry = geometry(&scene, Subdivision::Split(pieces));
                let wholes = Wholes::new(&geometry).expect("all of it was cut");
                assert_eq!(wholes.len(), scene.triangles.len(), "{pieces} pieces");
                let count = pieces * pieces;
                assert!(
                    wholes.wholes.iter().all(|whole| whole.count == count),
                    "{pieces} pieces"
                );
                assert_made_up_of(&wholes, &geometry);
            }
        }
    }

    #[test]
    fn each_triangle_has_pieces_of_its_own() {
        let scene = of_kind(Kind::City);
        let sides = |[a, b, c]: [DVec3; 3]| a.distance(b).max(b.distance(c)).max(c.distance(a));
        let longest = scene.triangles.iter().map(|t| sides(t.corners)).fold(0.0, f64::max);
        let subdivision = Subdivision::PatchSize(longest / 25.0);
        let geometry = geometry(&scene, subdivision);
        let wholes = Wholes::new(&geometry).expect("much of it was cut");
        assert_eq!(wholes.len(), scene.triangles.len());
        assert!(wholes.lattices.len() > 5, "{} numbers of pieces", wholes.lattices.len());
        assert_made_up_of(&wholes, &geometry);
    }

    #[test]
    fn what_was_not_cut_is_not_taken_for_it() {
        for kind in [Kind::City, Kind::Spheres, Kind::Soup, Kind::Maze, Kind::Field] {
            assert!(
                Wholes::new(&geometry(&of_kind(kind), Subdivision::None)).is_none(),
                "{kind}"
            );
        }
        // Too little of it.
        let mut scene = cornell_box();
        let geometry_of = |scene: &Scene| geometry(scene, Subdivision::PatchSize(600.0));
        assert!(Wholes::new(&geometry_of(&scene)).is_none());
        scene.triangles.truncate(1);
        assert!(Wholes::new(&geometry(&scene, Subdivision::None)).is_none());
    }

    #[test]
    fn a_corner_out_of_place_keeps_a_triangle_in_pieces() {
        let model = geometry(&cornell_box(), Subdivision::Split(5));
        let off = OFF * model.plane_tolerance;
        let wholes_with = |by: f64, together: bool| {
            let mut moved = Geometry::clone(&model);
            // An inner corner of the third triangle: six patches have it.
            let corner = moved
                .surfaces
                .iter()
                .find(|s| s.front.0 == 2 * 25 + 3)
                .expect("it has 25 patches")
                .corners[2];
            let mut left = if together { usize::MAX } else { 1 };
            for surface in &mut moved.surfaces {
                if surface.front.0 / 25 == 2 {
                    for p in surface.corners.iter_mut().filter(|p| **p == corner) {
                        if left > 0 {
                            left -= 1;
                            p.x += by;
                        }
                    }
                }
            }
            Wholes::new(&moved).expect("most of it was cut").len()
        };
        let triangles = cornell_box().triangles.len();
        assert_eq!(wholes_with(0.0, true), triangles);
        assert_eq!(wholes_with(0.5 * off, true), triangles);
        // The corner is between the first row, of nine patches, and the second, of seven. The nine in the other rows
        // are still what a triangle is cut into.
        assert_eq!(wholes_with(2.0 * off, true), triangles - 1 + 9 + 7 + 1);
        assert_eq!(wholes_with(0.5 * off, false), triangles - 1 + 9 + 7 + 1, "a gap");
    }

    #[test]
    fn faces_are_those_that_some_of_it_may_be_on() {
        // Corners on a coarse grid, so that many lie on the planes between faces.
        let mut draw = Draw(7);
        let mut coordinate = || draw.below(7) as f64 - 3.0;
        let frame = Frame::new(
            [0.5, -1.0, 0.25],
            [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            1e-9,
            0,
        );
        let (mut on, mut off) = (0, 0);
        for _ in 0..2000 {
            let corners = [0, 1, 2].map(|_| DVec3::from_array([0, 1, 2].map(|_| coordinate())));
            let whole = Whole {
                corners,
                front: 0,
                step: 1,
                count: 4,
                lattice: 0,
            };
            let seen = corners.map(|p| {
                let d = p - DVec3::from_array(frame.origin);
                frame.axes.map(|axis| DVec3::from_array(axis).dot(d))
            });
            for face in Face::ALL {
                let (axis, sign) = face.axes();
                let bottom = if face.is_top() { -1.0 } else { 0.0 };
                let of = |p: &[f64; 3]| [0, 1, 2].map(|c| sign[c] * p[axis[c]]);
                let planes: [fn([f64; 3], f64) -> f64; 5] = [
                    |[_, _, w], _| w,
                    |[u, _, w], _| w - u,
                    |[u, _, w], _| w + u,
                    |[_, v, w], _| w - v,
                    |[_, v, w], bottom| v - bottom * w,
                ];
                let is_on = planes
                    .iter()
                    .all(|plane| seen.iter().any(|p| plane(of(p), bottom) >= 0.0));
                assert_eq!(
                    whole.faces(&frame) >> face as u8 & 1 != 0,
                    is_on,
                    "{face:?} of {seen:?}"
                );
                *(if is_on { &mut on } else { &mut off }) += 1;
            }
        }
        assert!(on > 1000 && off > 1000, "{on} on, {off} off");
    }

    #[test]
    fn what_is_above_has_all_its_patches_above() {
        let model = geometry(&cornell_box(), Subdivision::Split(3));
        let wholes = Wholes::new(&model).expect("all of it was cut");
        let (mut above, mut touching) = (0, 0);
        for surface in model.surfaces.iter().step_by(5) {
            let [a, b, c] = surface.corners;
            let (Some(normal), Some(tangent)) = ((b - a).cross(c - a).try_normalize(), (b - a).try_normalize()) else {
                continue;
            };
            let axes = [tangent, normal.cross(tangent), normal].map(|axis| axis.to_array());
            let tolerance = model.plane_tolerance;
            let frame = Frame::new(((a + b + c) / 3.0).to_array(), axes, tolerance, 0);
            let height = |p: DVec3| normal.dot(p - DVec3::from_array(frame.origin));
            for whole in &wholes.wholes {
                if !whole.is_above(&frame) {
                    continue;
                }
                above += 1;
                touching += usize::from(whole.corners.iter().any(|&p| height(p).abs() <= tolerance));
                for patch in whole.patches(whole.front) {
                    let mut block = Block::empty();
                    wholes.put(patch, 0, &mut block);
                    let most = block.triangle(0).into_iter().map(height).fold(f64::MIN, f64::max);
                    assert!(most > tolerance, "patch {patch} reaches {most}");
                }
            }
        }
        assert!(
            above > 100 && touching > 10,
            "{above} above, {touching} of them touching"
        );
    }
}
