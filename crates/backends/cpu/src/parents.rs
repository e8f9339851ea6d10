//! Parent triangles: the triangles of a scene before they were cut into patches. Their visible pixels are the same
//! however finely they are cut, so engines draw them, and then distribute the visible weight over the patches, none of
//! which hides another. The work of culling, and of contests for pixels, is that of the uncut scene.
//!
//! The tree is over the parents, each drawn with the id of its first patch on the visible side. Corners of patches are
//! not stored: they follow from the parent's corners and the number of pieces.
//!
//! Pixel sums are those of the patches, to the bit, unless an eye lies on the edge of a triangle and in its plane.
//! Sub-pixel patches of a parent that covers pixels and shows none are not asked for, so engines report another version
//! with parents. The emitter's parent is left out as a whole, as its patches all lie below the horizon; a hemicube that
//! does not stand on it, or looks along it, as only a caller's own does, is drawn patch by patch
//! ([`ParentTriangles::is_stood_on`]). Engine `order` draws parents, too, but for weights of the finest hemicubes
//! (N = 1024), where drawing all pixels twice takes longer than culling the patches themselves.
//!
//! Corrections use weights as fractions only, and load a backend for those (`load_for_fractions`, by default `load`).
//! Then a parent with all covered pixels visible has its patches listed without drawing, and of another only patches
//! are drawn with a box of pixels not wholly visible; fully visible patches share the rest of the parent's weight
//! evenly. So rows still sum to 2³¹, and fractions are those of weights, to the bit (`promises::fractions`);
//! sub-pixel patches at the rim of a visible parent are added. Culling must not decide if a patch is asked for: unknown
//! covered pixels of a parent are counted.
//!
//! Triangles that the run cut are handed over ([`Geometry::cuts`]). Among the others, pieces of triangles that the file
//! holds cut already are searched for (`parents/search.rs`): rows do not depend on who cut them.

mod lattice;
mod search;

use crate::kernel::{Frame, SceneBox};
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Geometry, Hemicube, Surface};
use hemicube_contract::bvh::{Block, LANES, Tree};
use hemicube_contract::face::Face;
use lattice::Lattice;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Largest distance of a corner from its place in the parent, in units of the tolerance of coplanar patches: rounding
/// of coordinates.
const OFF: f64 = 1.0 / 16.0;

/// The parent triangles of a scene, some of which are patches themselves. Each is drawn with the id of its first patch
/// on the visible side.
#[derive(Debug)]
pub(crate) struct ParentTriangles {
    /// Tree over the parents.
    pub(crate) tree: Arc<Tree>,
    /// In the order of their patches.
    parents: Vec<ParentTriangle>,
    /// For each block of the tree.
    lanes: Vec<ParentLanes>,
    /// One for each number of pieces of an edge.
    lattices: Vec<Lattice>,
}

/// A parent triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ParentTriangle {
    /// Corners of the front, counter-clockwise.
    corners: [DVec3; 3],
    /// The first patch, on the front.
    front: u32,
    /// Increment of the id to the next patch on the same side: 2 if both sides are patches.
    step: u32,
    /// Number of patches on a side.
    count: u32,
    lattice: u32,
}

/// The lanes of a block of parents.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ParentLanes {
    /// Lanes with more than one patch.
    pub(crate) subdivided: u16,
    /// Numbers of the parents.
    pub(crate) parent: [u32; LANES],
}

impl ParentTriangles {
    /// Makes parents from triangles with the ids of their first patches, and the number of pieces of their edges.
    fn new(geometry: &Geometry, found: &[(Surface, usize)]) -> Self {
        let mut of_pieces = BTreeMap::new();
        let mut lattices = Vec::new();
        let mut parents = Vec::with_capacity(found.len());
        #[allow(
            clippy::cast_possible_truncation,
            reason = "fewer than patches, of which there are < 2³¹"
        )]
        for &(Surface { corners, front, back }, pieces) in found {
            let lattice = *of_pieces.entry(pieces).or_insert_with(|| {
                lattices.push(Lattice::new(pieces));
                lattices.len() - 1
            });
            parents.push(ParentTriangle {
                corners,
                front: front.0,
                step: 1 + u32::from(back.is_some()),
                count: (pieces * pieces) as u32,
                lattice: lattice as u32,
            });
        }
        let surfaces: Vec<Surface> = found.iter().map(|&(surface, _)| surface).collect();
        let tree = Tree::of_surfaces(&surfaces, geometry.patch_count, geometry.plane_tolerance);
        let none = ParentLanes {
            subdivided: 0,
            parent: [u32::MAX; LANES],
        };
        let mut lanes = vec![none; tree.blocks.len()];
        for (of, parent) in (0u32..).zip(&parents) {
            let slot = tree.slot_of_patch[parent.front as usize] as usize;
            let lanes = &mut lanes[slot / LANES];
            lanes.parent[slot % LANES] = of;
            lanes.subdivided |= u16::from(parent.count > 1) << (slot % LANES);
        }
        Self {
            tree: Arc::new(tree),
            parents,
            lanes,
            lattices,
        }
    }

    /// The parents as surfaces with the ids of their first patches.
    pub(crate) fn surfaces(&self) -> Vec<Surface> {
        let surface = |parent: &ParentTriangle| Surface {
            corners: parent.corners,
            front: InputPatch(parent.front),
            back: (parent.step == 2).then_some(InputPatch(parent.front + 1)),
        };
        self.parents.iter().map(surface).collect()
    }

    /// The lanes of a block of the tree.
    pub(crate) fn lanes(&self, block: usize) -> &ParentLanes {
        &self.lanes[block]
    }

    /// Number of parents.
    pub(crate) fn len(&self) -> usize {
        self.parents.len()
    }

    pub(crate) fn get(&self, parent: u32) -> &ParentTriangle {
        &self.parents[parent as usize]
    }

    /// Returns true if a hemicube stands on its emitter's parent and looks away from it, so that it sees none of the
    /// parent's other patches; true also without an emitter.
    pub(crate) fn is_stood_on(&self, hemicube: &Hemicube, tolerance: f64) -> bool {
        // A thousandth of a radian: normals of slivers are not known better.
        const ALONG: f64 = 1.0 - 0.5e-6;
        let Some(emitter) = hemicube.emitter else {
            return true;
        };
        let parent = self.of_patch(emitter.0);
        let [a, b, c] = parent.corners;
        let normal = (b - a).cross(c - a);
        let (size, to_eye) = (normal.length(), hemicube.origin - a);
        let extent = (b - a).length().max((c - a).length()).max(to_eye.length());
        let rounding = 64.0 * f64::EPSILON * extent * extent;
        parent.count == 1
            || normal.dot(to_eye).abs() <= tolerance * size + rounding * extent
                && normal.dot(hemicube.axes[2]).abs() >= ALONG * size - rounding
    }

    /// Ids that subdivided parents are drawn with.
    pub(crate) fn subdivided_ids(&self) -> impl Iterator<Item = u32> + use<'_> {
        let subdivided = self.parents.iter().filter(|parent| parent.count > 1);
        subdivided.flat_map(|parent| parent.front..parent.front + parent.step)
    }

    /// The parent drawn with an id, if it is subdivided.
    pub(crate) fn subdivided(&self, id: u32) -> Option<u32> {
        let slot = self.tree.slot_of_patch[id as usize] as usize;
        let (lanes, lane) = (&self.lanes[slot / LANES], slot % LANES);
        (lanes.subdivided >> lane & 1 != 0).then(|| lanes.parent[lane])
    }

    fn of_patch(&self, patch: u32) -> &ParentTriangle {
        &self.parents[self.parents.partition_point(|parent| parent.front <= patch) - 1]
    }

    /// The id that a patch's parent is drawn with, seen from the patch's side.
    pub(crate) fn drawn_as(&self, patch: u32) -> u32 {
        let parent = self.of_patch(patch);
        parent.front + (patch - parent.front) % parent.step
    }

    /// Number of blocks of a parent's patches.
    pub(crate) fn block_count(&self, parent: &ParentTriangle) -> usize {
        self.lattices[parent.lattice as usize].blocks.len()
    }

    /// Computes sixteen patches of a parent drawn with `id`. Both sides get the patch's id: [`ParentTriangle::sign`]
    /// tells the visible side.
    #[inline(always)]
    pub(crate) fn patches(&self, parent: &ParentTriangle, id: u32, block: usize, out: &mut Block) {
        let lattice = &self.lattices[parent.lattice as usize].blocks[block];
        let [a, b, c] = parent.corners.map(|p| p.to_array());
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
            patch = if place < parent.count {
                id + place * parent.step
            } else {
                patch
            };
            out.negative[l] = patch;
            out.positive[l] = patch;
        }
    }

    /// The patch of a parent drawn with `id` that has the centroid nearest to the eye.
    pub(crate) fn nearest(&self, parent: &ParentTriangle, id: u32, frame: &Frame) -> u32 {
        let eye = DVec3::from_array(frame.origin);
        let distance = |patch: u32| {
            let mut block = Block::empty();
            self.put(patch, 0, &mut block);
            (block.triangle(0).into_iter().sum::<DVec3>() / 3.0).distance_squared(eye)
        };
        (0..parent.count)
            .map(|place| id + place * parent.step)
            .map(|patch| (patch, distance(patch)))
            .fold(
                (id, f64::INFINITY),
                |best, next| if next.1 < best.1 { next } else { best },
            )
            .0
    }

    /// Puts a patch into a lane of a block.
    pub(crate) fn put(&self, patch: u32, lane: usize, out: &mut Block) {
        let parent = self.of_patch(patch);
        let place = ((patch - parent.front) / parent.step) as usize;
        let (lattice, from) = (
            &self.lattices[parent.lattice as usize].blocks[place / LANES],
            place % LANES,
        );
        let [a, b, c] = parent.corners.map(|p| p.to_array());
        for k in 0..3 {
            for x in 0..3 {
                let (first, last) = (b[x] - a[x], c[x] - a[x]);
                out.corners[3 * k + x][lane] = a[x] + first * lattice.along[k][from] + last * lattice.across[k][from];
            }
        }
        (out.negative[lane], out.positive[lane]) = (patch, patch);
    }
}

impl ParentTriangle {
    /// Sign of its patches' determinants where the side drawn with `id` is visible. Rounding may give a patch all but
    /// in line with the eye the other.
    pub(crate) fn sign(&self, id: u32) -> f64 {
        if id == self.front { -1.0 } else { 1.0 }
    }

    /// Returns true if all its patches reach above a frame's horizon.
    pub(crate) fn is_above(&self, frame: &Frame) -> bool {
        let [normal, origin] = [frame.axes[2], frame.origin].map(DVec3::from_array);
        let [a, b, c] = self.corners.map(|corner| normal.dot(corner - origin));
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        // Each patch is as high as the parent divided by the number of pieces, and none begins lower.
        least + (most - least) / f64::from(self.count).sqrt() > frame.tolerance * 1.001
    }

    /// Faces that it may be on: it does not lie beyond a side of their pyramid.
    pub(crate) fn faces(&self, frame: &Frame) -> u8 {
        let [x_axis, y_axis, z_axis] = frame.axes.map(DVec3::from_array);
        let origin = DVec3::from_array(frame.origin);
        // Least and greatest of x, y, z, x − y, x + y, z − x, z + x, z − y, z + y: the planes between faces.
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

    /// Its patches, drawn with `id`.
    pub(crate) fn patches(&self, id: u32) -> impl Iterator<Item = u32> + use<> {
        let step = self.step;
        (0..self.count).map(move |place| id + place * step)
    }

    /// The box around it, a hair wider than the corners, as the middle and the half sides are rounded.
    pub(crate) fn bounds(&self) -> SceneBox {
        let [a, b, c] = self.corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let half = (high - low) * (0.5 * (1.0 + 1e-12)) + DVec3::splat(1e-15);
        SceneBox {
            center: ((low + high) * 0.5).to_array(),
            half: half.to_array(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsp::Lcg;
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
            let parents = ParentTriangles::find(geometry).expect("it was cut");
            for hemicube in model.order().flat_map(|patch| model.hemicubes(patch, 2, true)) {
                assert!(parents.is_stood_on(&hemicube, geometry.plane_tolerance), "{hemicube:?}");
                stood_on += 1;
                let mut off = hemicube;
                off.origin += off.axes[2] * 1e-4;
                let is_cut = parents.of_patch(hemicube.emitter.expect("its own").0).count > 1;
                assert!(!is_cut || !parents.is_stood_on(&off, geometry.plane_tolerance));
                off = hemicube;
                off.axes[2] = (off.axes[2] + 0.01 * off.axes[0]).normalize();
                assert!(!is_cut || !parents.is_stood_on(&off, geometry.plane_tolerance));
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

    /// Every patch is where its parent has it, and is on the side that the parent is drawn as.
    fn assert_made_up_of(parents: &ParentTriangles, geometry: &Geometry) {
        let off = OFF * geometry.plane_tolerance;
        for surface in &geometry.surfaces {
            for (side, patch) in [Some(surface.front), surface.back].into_iter().flatten().enumerate() {
                let mut block = Block::empty();
                parents.put(patch.0, 5, &mut block);
                for (found, wanted) in block.triangle(5).into_iter().zip(surface.corners) {
                    assert!((found - wanted).abs().max_element() <= off, "patch {patch:?}");
                }
                let parent = parents.of_patch(patch.0);
                let id = parents.drawn_as(patch.0);
                assert_eq!(
                    id,
                    parent.front + u32::try_from(side).expect("0 or 1"),
                    "patch {patch:?}"
                );
                assert_eq!(parents.subdivided(id).is_some(), parent.count > 1, "patch {patch:?}");
                // The same patch, the same corners, among all of its parent.
                let place = ((patch.0 - parent.front) / parent.step) as usize;
                let mut all = Block::empty();
                parents.patches(parent, id, place / LANES, &mut all);
                assert_eq!(all.positive[place % LANES], patch.0);
                assert_eq!(all.triangle(place % LANES), block.triangle(5), "patch {patch:?}");
            }
        }
    }

    /// A scene that does not say how it was cut has the parents of one that does.
    fn assert_searched_likewise(parents: &ParentTriangles, geometry: &Geometry) {
        let untold = Geometry::clone(geometry);
        assert!(untold.cuts().is_empty() && !geometry.cuts().is_empty());
        let searched = ParentTriangles::find(&untold).expect("found as well");
        assert_eq!(parents.parents, searched.parents);
    }

    #[test]
    fn pieces_of_the_file_are_found_beside_those_of_the_run() {
        // A floor cut in 36 by the file, and walls that the run cuts to the length of its pieces.
        let mut scene = cornell_box();
        let mut pieces = Vec::new();
        Subdivision::Split(6).cut(&scene.triangles[0].corners, &mut pieces);
        let floor = scene.triangles.remove(0);
        let cut = pieces
            .iter()
            .map(|&corners| hemicube_scene::Triangle { corners, ..floor });
        scene.triangles.splice(0..0, cut);
        let longest = |[a, b, c]: [DVec3; 3]| a.distance(b).max(b.distance(c)).max(c.distance(a));
        let length = pieces.iter().map(|&piece| longest(piece)).fold(0.0, f64::max) * 1.001;
        let geometry = geometry(&scene, Subdivision::PatchSize(length));
        assert!(geometry.cuts().iter().all(|cut| cut.first.0 >= 36));
        let parents = ParentTriangles::find(&geometry).expect("much of it was cut");
        assert_searched_likewise(&parents, &geometry);
        assert_eq!((parents.parents[0].front, parents.parents[0].count), (0, 36));
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
                let parents = ParentTriangles::find(&geometry).expect("all of it was cut");
                assert_searched_likewise(&parents, &geometry);
                assert_eq!(parents.len(), scene.triangles.len(), "{pieces} pieces");
                let count = pieces * pieces;
                assert!(
                    parents.parents.iter().all(|parent| parent.count == count),
                    "{pieces} pieces"
                );
                assert_made_up_of(&parents, &geometry);
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
        let parents = ParentTriangles::find(&geometry).expect("much of it was cut");
        assert_searched_likewise(&parents, &geometry);
        assert_eq!(parents.len(), scene.triangles.len());
        assert!(
            parents.lattices.len() > 5,
            "{} numbers of pieces",
            parents.lattices.len()
        );
        assert_made_up_of(&parents, &geometry);
    }

    #[test]
    fn what_was_not_cut_is_not_taken_for_it() {
        for kind in [Kind::City, Kind::Spheres, Kind::Soup, Kind::Maze, Kind::Field] {
            assert!(
                ParentTriangles::find(&geometry(&of_kind(kind), Subdivision::None)).is_none(),
                "{kind}"
            );
        }
        // Too little of it.
        let mut scene = cornell_box();
        let geometry_of = |scene: &Scene| geometry(scene, Subdivision::PatchSize(600.0));
        assert!(ParentTriangles::find(&geometry_of(&scene)).is_none());
        scene.triangles.truncate(1);
        assert!(ParentTriangles::find(&geometry(&scene, Subdivision::None)).is_none());
    }

    #[test]
    fn a_corner_out_of_place_keeps_a_triangle_in_pieces() {
        let model = geometry(&cornell_box(), Subdivision::Split(5));
        let off = OFF * model.plane_tolerance;
        let parents_with = |by: f64, together: bool| {
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
            ParentTriangles::find(&moved).expect("most of it was cut").len()
        };
        let triangles = cornell_box().triangles.len();
        assert_eq!(parents_with(0.0, true), triangles);
        assert_eq!(parents_with(0.5 * off, true), triangles);
        // The corner is between the first row, of nine patches, and the second, of seven. The nine in the other rows
        // are still the patches of a triangle.
        assert_eq!(parents_with(2.0 * off, true), triangles - 1 + 9 + 7 + 1);
        assert_eq!(parents_with(0.5 * off, false), triangles - 1 + 9 + 7 + 1, "a gap");
    }

    #[test]
    fn faces_are_those_that_some_of_it_may_be_on() {
        // Corners on a coarse grid, so that many lie on the planes between faces.
        let mut draw = Lcg(7);
        let mut coordinate = || draw.below(7) as f64 - 3.0;
        let frame = Frame::new(
            [0.5, -1.0, 0.25],
            [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            1e-9,
            0,
            64,
        );
        let (mut on, mut off) = (0, 0);
        for _ in 0..2000 {
            let corners = [0, 1, 2].map(|_| DVec3::from_array([0, 1, 2].map(|_| coordinate())));
            let parent = ParentTriangle {
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
                    parent.faces(&frame) >> face as u8 & 1 != 0,
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
        let parents = ParentTriangles::find(&model).expect("all of it was cut");
        let (mut above, mut touching) = (0, 0);
        for surface in model.surfaces.iter().step_by(5) {
            let [a, b, c] = surface.corners;
            let (Some(normal), Some(tangent)) = ((b - a).cross(c - a).try_normalize(), (b - a).try_normalize()) else {
                continue;
            };
            let axes = [tangent, normal.cross(tangent), normal].map(|axis| axis.to_array());
            let tolerance = model.plane_tolerance;
            let frame = Frame::new(((a + b + c) / 3.0).to_array(), axes, tolerance, 0, 64);
            let height = |p: DVec3| normal.dot(p - DVec3::from_array(frame.origin));
            for parent in &parents.parents {
                if !parent.is_above(&frame) {
                    continue;
                }
                above += 1;
                touching += usize::from(parent.corners.iter().any(|&p| height(p).abs() <= tolerance));
                for patch in parent.patches(parent.front) {
                    let mut block = Block::empty();
                    parents.put(patch, 0, &mut block);
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
