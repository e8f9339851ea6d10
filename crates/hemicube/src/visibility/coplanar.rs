//! Coplanar regions: surfaces of one plane that make up a convex polygon together, as one occluder.
//!
//! Patches are cut fine for radiation; for occlusion the cuts do not matter. Between two patches of a finely cut city
//! lie dozens of pieces of the same few façades. A shaft of façades lists fewer triangles to test and to cast rays at,
//! and a façade proves a pair occluded where none of its pieces does.
//!
//! A file with nine digits holds the pieces of a turned wall some 10⁻⁹ of the scene off its plane. Such pieces are one
//! region, too, if they are within [`ROUGH`] of one plane and of the polygon's sides; the region knows by how much
//! ([`CoplanarRegions::unevenness`]), and exact visibility counts it as error. Where another surface all but coincides
//! with such a wall, as the party wall of the house next door, the pieces stay as they are: which of the two is in front
//! of the other is a matter of less than the unevenness.

use crate::Model;
use crate::backend::{Geometry, Surface};
use crate::bvh::{Tree, overlap};
use crate::geometry::cross;
use crate::visibility::spaces::Spaces;
use crate::visibility::wide::WideTree;
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_spatial::Aabb;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Distance of corners from the region's plane, at most, in parts of the tolerance by which patches are in one plane.
const FLAT: f64 = 0.25;
/// The same where pieces have no plane to that: 3·10⁻⁹ of the scene.
pub(crate) const ROUGH: f64 = 32.0;
/// Bound of the surfaces looked at for rough regions, for each surface of the scene.
const MOST_LOOKED_AT: usize = 8;
/// Bound of the surfaces held against rough regions, for each surface of the scene.
const MOST_HELD_AGAINST: usize = 64;
/// Bound of a region's corners: regions of more are left in pieces.
const MOST_CORNERS: usize = 8;
/// Difference of a region's area from the sum of its pieces', at most, in parts of it.
const SAME_AREA: f64 = 1e-9;

/// The coplanar regions of a scene.
#[derive(Debug)]
pub(crate) struct CoplanarRegions {
    /// Over the triangles that regions fall into. The ids in its blocks are those of regions, not of patches.
    pub(crate) tree: Tree,
    /// The same boxes and blocks, for segments.
    pub(crate) wide: WideTree,
    /// The region of each patch.
    pub(crate) of_patch: Vec<u32>,
    /// Each region's corners, counter-clockwise, from `corner_start[region]` on.
    corners: Vec<DVec3>,
    corner_start: Vec<u32>,
    /// Each region's distance from its pieces' corners, at most; 0 within [`FLAT`].
    unevenness: Vec<f64>,
    /// Each region's pieces, as indices into the scene's surfaces, from `piece_start[region]` on.
    pieces: Vec<u32>,
    piece_start: Vec<u32>,
    spaces: Arc<Spaces>,
}

impl CoplanarRegions {
    /// The regions of a model, made at the first call and shared from then on.
    pub(crate) fn of(model: &Model) -> Arc<Self> {
        let patches = model.patches();
        model
            .geometry()
            .kept(|geometry| Self::new(geometry, |surface| patches.triangle(surface.front)))
    }

    /// Finds the regions of a scene. `triangle` gives the file's triangle that a surface was cut from.
    pub(crate) fn new(geometry: &Geometry, triangle: impl Fn(&Surface) -> usize) -> Self {
        let surfaces = &geometry.surfaces;
        // By patch, not by the octree's order: regions do not depend on the octree.
        let mut order: Vec<usize> = (0..surfaces.len()).collect();
        order.sort_unstable_by_key(|&s| surfaces[s].front);
        let mesh = Mesh::of(surfaces, &order);
        let mut found = Self::none(geometry);
        let flat = FLAT * geometry.plane_tolerance;
        let mut growth = Growth {
            mesh: &mesh,
            surfaces,
            taken: vec![false; surfaces.len()],
        };
        let (mut region, mut rough) = (Vec::new(), Vec::new());
        let mut most_looked_at = MOST_LOOKED_AT * surfaces.len();
        let mut most_held_against = MOST_HELD_AGAINST * surfaces.len();
        let mut is_covered = vec![false; surfaces.len()];
        for seed in order {
            growth.grow(seed, flat, &mut region);
            if region.is_empty() {
                continue;
            }
            let polygon = mesh.polygon(surfaces, &region, flat);
            if most_looked_at > 0 && !is_covered[seed] {
                growth.grow_roughly(seed, ROUGH * geometry.plane_tolerance, &region, &mut rough);
                most_looked_at = most_looked_at.saturating_sub(rough.len());
                let wall = (rough.len() > region.len())
                    .then(|| mesh.uneven_polygon(surfaces, &rough, ROUGH * geometry.plane_tolerance));
                if let Some(wall) = wall.flatten() {
                    if !wall.is_covered(geometry, &rough, &mut most_held_against) {
                        growth.take(&rough);
                        found.push(surfaces, &rough, &wall);
                        continue;
                    }
                    rough.iter().for_each(|&piece| is_covered[piece as usize] = true);
                }
            }
            if let Some(polygon) = polygon {
                found.push(surfaces, &region, &polygon);
                continue;
            }
            // The pieces of one triangle of the file are convex together.
            region.sort_by_key(|&s| triangle(&surfaces[s as usize]));
            for pieces in region.chunk_by(|&a, &b| triangle(&surfaces[a as usize]) == triangle(&surfaces[b as usize])) {
                match mesh.polygon(surfaces, pieces, flat) {
                    Some(polygon) => found.push(surfaces, pieces, &polygon),
                    None => {
                        for &piece in pieces {
                            found.push(surfaces, &[piece], &Wall::of(&surfaces[piece as usize]));
                        }
                    }
                }
            }
        }
        found.plant(surfaces);
        found
    }

    fn none(geometry: &Geometry) -> Self {
        Self {
            tree: Tree::empty(0, 0, geometry.plane_tolerance),
            wide: WideTree::default(),
            of_patch: vec![u32::MAX; geometry.patch_count as usize],
            corners: Vec::new(),
            corner_start: vec![0],
            unevenness: Vec::new(),
            pieces: Vec::with_capacity(geometry.surfaces.len()),
            piece_start: vec![0],
            spaces: Spaces::of_geometry(geometry),
        }
    }

    /// Returns whether a patch is seen in place of `receiver` where the two lie on each other: of one space, the smaller
    /// id is seen. Of two spaces, each sees its own.
    pub(crate) fn is_seen_before(&self, patch: InputPatch, receiver: u32) -> bool {
        patch.0 < receiver && !self.spaces.separate(patch.0, receiver)
    }

    /// Builds the tree over the triangles that the regions fall into.
    fn plant(&mut self, surfaces: &[Surface]) {
        let mut triangles = Vec::new();
        for region in 0..self.len() {
            let fan = match *self.pieces(region) {
                // Corners keep their order.
                [piece] => vec![surfaces[piece as usize].corners],
                _ => {
                    let corners = self.corners(region);
                    let sides = corners[1..].windows(2);
                    sides.map(|side| [corners[0], side[0], side[1]]).collect()
                }
            };
            triangles.extend(fan.into_iter().map(|corners| Surface {
                corners,
                front: InputPatch(region),
                back: Some(InputPatch(region)),
            }));
        }
        self.tree = Tree::of_surfaces(&triangles, self.len(), self.tree.plane_tolerance);
        self.wide = WideTree::of(&self.tree);
    }

    fn push(&mut self, surfaces: &[Surface], pieces: &[u32], wall: &Wall) {
        let region = self.len();
        for &piece in pieces {
            let surface = &surfaces[piece as usize];
            for patch in std::iter::once(surface.front).chain(surface.back) {
                self.of_patch[patch.0 as usize] = region;
            }
        }
        self.pieces.extend_from_slice(pieces);
        self.corners.extend_from_slice(&wall.corners);
        self.unevenness.push(wall.unevenness);
        let end = |len: usize| u32::try_from(len).unwrap_or(u32::MAX);
        self.piece_start.push(end(self.pieces.len()));
        self.corner_start.push(end(self.corners.len()));
    }

    /// Number of regions.
    pub(crate) fn len(&self) -> u32 {
        u32::try_from(self.piece_start.len() - 1).unwrap_or(u32::MAX)
    }

    /// The corners of a region.
    pub(crate) fn corners(&self, region: u32) -> &[DVec3] {
        let region = region as usize;
        &self.corners[self.corner_start[region] as usize..self.corner_start[region + 1] as usize]
    }

    /// The distance of a region from the corners of its pieces, at most: 0 where they lie in it, but for rounding.
    pub(crate) fn unevenness(&self, region: u32) -> f64 {
        self.unevenness[region as usize]
    }

    /// The surfaces of a region.
    pub(crate) fn pieces(&self, region: u32) -> &[u32] {
        let region = region as usize;
        &self.pieces[self.piece_start[region] as usize..self.piece_start[region + 1] as usize]
    }
}

/// A convex polygon of several surfaces.
#[derive(Debug)]
struct Wall {
    corners: Vec<DVec3>,
    unevenness: f64,
}

impl Wall {
    fn of(surface: &Surface) -> Self {
        Self {
            corners: surface.corners.to_vec(),
            unevenness: 0.0,
        }
    }

    /// Returns whether a surface that is none of `pieces` all but coincides with part of it: one of the two lies within
    /// twice the unevenness of the other's plane. Takes the surfaces held against it from `most`; where they are used up,
    /// the wall counts as covered.
    fn is_covered(&self, geometry: &Geometry, pieces: &[u32], most: &mut usize) -> bool {
        let corners = &self.corners;
        let fan: Vec<[DVec3; 3]> = (1..corners.len() - 1)
            .map(|k| [corners[0], corners[k], corners[k + 1]])
            .collect();
        let across: DVec3 = fan.iter().map(cross).sum();
        let normal = across.normalize_or_zero();
        let slack = 2.0 * self.unevenness + geometry.plane_tolerance;
        let lies_in =
            |points: &[DVec3], at: DVec3, normal: DVec3| points.iter().all(|&p| normal.dot(p - at).abs() <= slack);
        let pieces: HashSet<u32> = pieces.iter().copied().collect();
        let reach = Aabb::from_points(corners.iter().copied());
        let (low, high) = (reach.min - slack, reach.max + slack);
        let reaches = |bounds: &Aabb| bounds.min.cmple(high).all() && bounds.max.cmpge(low).all();
        let mut pending = vec![0];
        while let Some(node) = pending.pop() {
            let Some(node) = geometry.octree.nodes().get(node as usize) else {
                continue;
            };
            if !reaches(&node.bounds) {
                continue;
            }
            pending.extend(node.children());
            for item in node.own() {
                if *most == 0 {
                    return true;
                }
                *most -= 1;
                let other = &geometry.surfaces[item as usize].corners;
                if !reaches(&Aabb::from_points(*other)) || pieces.contains(&item) {
                    continue;
                }
                let is_close =
                    lies_in(other, corners[0], normal) || lies_in(corners, other[0], cross(other).normalize_or_zero());
                if is_close && fan.iter().any(|part| overlap(part, other, normal, slack)) {
                    return true;
                }
            }
        }
        false
    }
}

/// In place of a surface: several run along an edge the same way. They overlap, or one is another's back.
const SEVERAL: u32 = u32::MAX;

/// Surfaces by the corners they share.
struct Mesh {
    /// Indices into `places`, by surface.
    corners: Vec<[u32; 3]>,
    places: Vec<DVec3>,
    /// The surface along each edge, from one corner to the other.
    along: HashMap<Edge, u32>,
    /// The surfaces along edges with [`SEVERAL`].
    several: HashMap<Edge, Vec<u32>>,
}

/// Numbers the places of the corners of surfaces, visited in `order`: equal coordinates have one number.
pub(super) fn number_corners(
    surfaces: &[Surface],
    order: impl IntoIterator<Item = usize>,
) -> (Vec<[u32; 3]>, Vec<DVec3>) {
    let mut known: HashMap<[u64; 3], u32> = HashMap::with_capacity(surfaces.len());
    let mut places = Vec::new();
    let mut corners = vec![[0; 3]; surfaces.len()];
    for index in order {
        corners[index] = surfaces[index].corners.map(|place| {
            // 0 and −0 are one place.
            let bits = (place + DVec3::ZERO).to_array().map(f64::to_bits);
            *known.entry(bits).or_insert_with(|| {
                places.push(place);
                u32::try_from(places.len() - 1).unwrap_or(u32::MAX)
            })
        });
    }
    (corners, places)
}

impl Mesh {
    /// Numbers corners in the order of `order`.
    fn of(surfaces: &[Surface], order: &[usize]) -> Self {
        let (corners, places) = number_corners(surfaces, order.iter().copied());
        let mut along = HashMap::with_capacity(3 * surfaces.len());
        let mut several: HashMap<Edge, Vec<u32>> = HashMap::new();
        for (surface, triangle) in (0u32..).zip(&corners) {
            for edge in edges(*triangle) {
                let first = *along.entry(edge).or_insert(surface);
                if first != surface {
                    let of_edge = several.entry(edge).or_default();
                    if first != SEVERAL {
                        of_edge.push(first);
                        along.insert(edge, SEVERAL);
                    }
                    of_edge.push(surface);
                }
            }
        }
        Self {
            corners,
            places,
            along,
            several,
        }
    }

    /// The surfaces along an edge.
    fn along(&self, edge: Edge) -> &[u32] {
        match self.along.get(&edge) {
            None => &[],
            Some(&SEVERAL) => self.several.get(&edge).map_or(&[], Vec::as_slice),
            Some(one) => std::slice::from_ref(one),
        }
    }

    /// The surface on the other side of an edge, of those that `is_alike` accepts, if just one of them is on either
    /// side. Others may be there: in a shell of no thickness, the outer surfaces share the edges of the inner ones.
    fn across(&self, edge: Edge, is_alike: impl Fn(u32) -> bool) -> Option<u32> {
        let mut beyond = self.along(edge.reversed()).iter().copied().filter(|&of| is_alike(of));
        let found = beyond.next().filter(|_| beyond.next().is_none())?;
        let on_this_side = self.along(edge);
        let is_single = on_this_side.len() == 1 || on_this_side.iter().filter(|&&of| is_alike(of)).count() == 1;
        is_single.then_some(found)
    }

    /// The convex polygon that surfaces of one plane make up, without corners on its sides; `None` if they make up
    /// none.
    fn polygon(&self, surfaces: &[Surface], region: &[u32], flat: f64) -> Option<Wall> {
        let corners = self.convex(surfaces, region, flat, 0.0)?.0;
        Some(Wall {
            corners,
            unevenness: 0.0,
        })
    }

    /// The convex polygon that surfaces within `rough` of its plane and of its sides make up.
    fn uneven_polygon(&self, surfaces: &[Surface], region: &[u32], rough: f64) -> Option<Wall> {
        let (corners, beside) = self.convex(surfaces, region, rough, 4.0 * rough)?;
        let sum = |k: usize| (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]);
        let normal = (1..corners.len() - 1).map(sum).sum::<DVec3>().try_normalize()?;
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let heights = region.iter().flat_map(|&s| surfaces[s as usize].corners);
        let above = heights.map(|p| normal.dot(p - middle).abs()).fold(0.0, f64::max);
        (above <= rough).then_some(Wall {
            unevenness: above + beside,
            corners,
        })
    }

    /// [`Self::polygon`]'s corners, and the greatest distance of a corner left out from its side. `seam`: the width
    /// along the outline by which the polygon's area may differ from its pieces'.
    fn convex(&self, surfaces: &[Surface], region: &[u32], flat: f64, seam: f64) -> Option<(Vec<DVec3>, f64)> {
        if region.len() < 2 {
            return None;
        }
        let mut edges_of_region: HashMap<u32, u32> = HashMap::new();
        let inside: HashMap<Edge, ()> = region
            .iter()
            .flat_map(|&s| edges(self.corners[s as usize]))
            .map(|edge| (edge, ()))
            .collect();
        let mut first = u32::MAX;
        for edge in inside.keys() {
            let Edge { from, to } = *edge;
            if inside.contains_key(&edge.reversed()) {
                continue;
            }
            if edges_of_region.insert(from, to).is_some() {
                return None;
            }
            first = first.min(from);
        }
        let mut outline = Vec::with_capacity(edges_of_region.len());
        let mut at = first;
        loop {
            outline.push(self.places[at as usize]);
            at = edges_of_region.remove(&at)?;
            if at == first {
                break;
            }
        }
        // Another outline is a hole, or an island.
        if !edges_of_region.is_empty() {
            return None;
        }
        let normals = region.iter().map(|&s| cross(&surfaces[s as usize].corners));
        let (sum, area) = normals.fold((DVec3::ZERO, 0.0), |(sum, area), n| (sum + n, area + n.length()));
        let normal = sum.try_normalize()?;
        let count = outline.len();
        let mut corners = Vec::new();
        let (mut beside, mut rim) = (0.0_f64, 0.0);
        for k in 0..count {
            let before = corners.last().copied().unwrap_or(outline[(k + count - 1) % count]);
            let (p, after) = (outline[k], outline[(k + 1) % count]);
            let turn = normal.dot((p - before).cross(after - p));
            let lengths = (p - before).length() + (after - p).length();
            // turn / lengths is about the corner's distance from the side without it.
            if turn > flat * lengths {
                corners.push(p);
            } else if turn < -flat * lengths {
                return None;
            } else if lengths > 0.0 {
                beside = beside.max(turn.abs() / lengths);
            }
            rim += (after - p).length();
        }
        if !(3..=MOST_CORNERS).contains(&corners.len()) {
            return None;
        }
        let fan: f64 = (1..corners.len() - 1)
            .map(|k| normal.dot((corners[k] - corners[0]).cross(corners[k + 1] - corners[0])))
            .sum();
        ((fan - area).abs() <= SAME_AREA * area + seam * rim).then_some((corners, beside))
    }
}

/// Grows regions of the surfaces not yet taken.
struct Growth<'a> {
    mesh: &'a Mesh,
    surfaces: &'a [Surface],
    taken: Vec<bool>,
}

impl Growth<'_> {
    /// Takes the surfaces connected to `seed` in its plane; none if `seed` is taken.
    fn grow(&mut self, seed: usize, flat: f64, region: &mut Vec<u32>) {
        region.clear();
        if self.taken[seed] {
            return;
        }
        let of_seed = &self.surfaces[seed];
        let normal = cross(&of_seed.corners).normalize_or_zero();
        let is_within = |p: DVec3| normal.dot(p - of_seed.corners[0]).abs() <= flat;
        self.reach(seed, normal, is_within, region);
        self.take(region);
    }

    /// Finds the surfaces connected to `seed`, and not taken but those of `own`, that are in its plane to `rough`, more
    /// beyond the seed's own size, over which its plane is known.
    fn grow_roughly(&mut self, seed: usize, rough: f64, own: &[u32], region: &mut Vec<u32>) {
        region.clear();
        let of_seed = &self.surfaces[seed];
        let [a, b, c] = of_seed.corners;
        let across = cross(&of_seed.corners);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        let height = across.length() / longest;
        if height <= 0.0 || height.is_nan() {
            return;
        }
        let normal = across.normalize_or_zero();
        let is_within = |p: DVec3| normal.dot(p - a).abs() <= rough * (1.0 + (p - a).length() / height);
        own.iter().for_each(|&s| self.taken[s as usize] = false);
        self.reach(seed, normal, is_within, region);
        self.take(own);
    }

    /// Lists the surfaces connected to `seed`, and not taken, that face as it does and of which all corners are within.
    fn reach(&self, seed: usize, normal: DVec3, is_within: impl Fn(DVec3) -> bool, region: &mut Vec<u32>) {
        region.push(u32::try_from(seed).unwrap_or(u32::MAX));
        if normal == DVec3::ZERO {
            return;
        }
        let is_two_sided = self.surfaces[seed].back.is_some();
        let is_alike = |next: u32| {
            let s = &self.surfaces[next as usize];
            s.back.is_some() == is_two_sided
                && cross(&s.corners).dot(normal) > 0.0
                && s.corners.iter().all(|&p| is_within(p))
        };
        let mut listed: HashSet<u32> = region.iter().copied().collect();
        let mut at = 0;
        while at < region.len() {
            for edge in edges(self.mesh.corners[region[at] as usize]) {
                let Some(next) = self.mesh.across(edge, is_alike) else {
                    continue;
                };
                if !self.taken[next as usize] && !listed.contains(&next) {
                    listed.insert(next);
                    region.push(next);
                }
            }
            at += 1;
        }
    }

    fn take(&mut self, region: &[u32]) {
        region.iter().for_each(|&s| self.taken[s as usize] = true);
    }
}

/// An edge between numbered corners.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Edge {
    from: u32,
    to: u32,
}

impl Edge {
    fn reversed(self) -> Self {
        Self {
            from: self.to,
            to: self.from,
        }
    }
}

fn edges([a, b, c]: [u32; 3]) -> [Edge; 3] {
    [(a, b), (b, c), (c, a)].map(|(from, to)| Edge { from, to })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HierarchyOptions;
    use crate::geometry::area;
    use hemicube_scene::generate::{BlockCityParameters, cornell_box};
    use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

    impl CoplanarRegions {
        /// Each surface by itself.
        pub(crate) fn pieces_of(model: &Model) -> Self {
            let surfaces = &model.geometry().surfaces;
            let mut regions = Self::none(model.geometry());
            for (piece, surface) in (0u32..).zip(surfaces) {
                regions.push(surfaces, &[piece], &Wall::of(surface));
            }
            regions.plant(surfaces);
            regions
        }
    }

    fn model(scene: &Scene, subdivision: Subdivision) -> Model {
        let patches = Patches::new(scene, subdivision).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    fn scene(triangles: &[[[f64; 3]; 3]]) -> Scene {
        Scene {
            triangles: (0u32..)
                .zip(triangles)
                .map(|(face, corners)| Triangle {
                    corners: corners.map(DVec3::from_array),
                    object: 0,
                    material: 0,
                    face,
                    two_sided: false,
                })
                .collect(),
            ..Scene::default()
        }
    }

    /// Every surface is a piece of one region, lies in it, and regions have the area of their pieces. Returns how many
    /// corners each region has.
    fn sound(model: &Model) -> Vec<usize> {
        let regions = CoplanarRegions::of(model);
        let surfaces = &model.geometry().surfaces;
        let mut seen = vec![0; surfaces.len()];
        let counts = (0..regions.len()).map(|region| {
            let corners = regions.corners(region);
            let normal = cross(&[corners[0], corners[1], corners[2]]).normalize();
            let mut sum = 0.0;
            for &piece in regions.pieces(region) {
                seen[piece as usize] += 1;
                let surface = &surfaces[piece as usize];
                sum += area(&surface.corners);
                assert_eq!(regions.of_patch[surface.front.0 as usize], region);
                for p in surface.corners {
                    assert!(
                        normal.dot(p - corners[0]).abs() < 1e-9,
                        "region {region}: off its plane"
                    );
                    for k in 0..corners.len() {
                        let side = corners[(k + 1) % corners.len()] - corners[k];
                        let inside = normal.cross(side.normalize()).dot(p - corners[k]);
                        assert!(inside > -1e-9, "region {region}: {inside} outside");
                    }
                }
            }
            let fan: f64 = (1..corners.len() - 1)
                .map(|k| area(&[corners[0], corners[k], corners[k + 1]]))
                .sum();
            assert!((fan - sum).abs() <= 1e-9 * sum, "region {region}: {fan} of {sum}");
            corners.len()
        });
        let counts: Vec<usize> = counts.collect();
        assert!(seen.iter().all(|&times| times == 1));
        counts
    }

    #[test]
    fn a_finely_cut_box_is_its_walls() {
        for subdivision in [Subdivision::None, Subdivision::Split(5), Subdivision::Levels(2)] {
            // Five walls of a room and six sides of two blocks less the two they stand on: the light is a part of the
            // ceiling that leaves it a frame, which is not convex.
            let corners = sound(&model(&cornell_box(), subdivision));
            let quadrangles = corners.iter().filter(|&&count| count == 4).count();
            assert!(quadrangles >= 14, "{subdivision:?}: {corners:?}");
            assert!(corners.len() <= 32, "{subdivision:?}: {corners:?}");
        }
    }

    #[test]
    fn a_city_has_far_fewer_walls_than_patches() {
        let city = BlockCityParameters {
            blocks: 6,
            split: 6,
            ..BlockCityParameters::for_target(1000, 1)
        };
        let model = model(&city.generate().expect("a city"), Subdivision::None);
        let (regions, patches) = (sound(&model).len(), model.patches().len());
        assert!(regions * 2 < patches, "{regions} regions of {patches} patches");
    }

    /// A turned square in 32 pieces, with nine digits: no two pieces are in one plane to the tolerance.
    #[test]
    fn a_wall_with_nine_digits_is_one() {
        let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.1);
        let wall = |digits: f64| {
            let at = |x: u32, y: u32| {
                let place = turn * DVec3::new(f64::from(x) * 0.97, f64::from(y) * 1.03, 0.3);
                (place * digits).round().to_array().map(|x| x / digits)
            };
            let squares = (0..4).flat_map(|x| (0..4).map(move |y| (x, y)));
            let pieces = squares.flat_map(|(x, y)| {
                let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1));
                [[a, b, c], [a, c, d]]
            });
            model(&scene(&pieces.collect::<Vec<_>>()), Subdivision::None)
        };
        let regions = CoplanarRegions::of(&wall(1e9));
        assert_eq!((regions.len(), regions.corners(0).len()), (1, 4));
        let uneven = regions.unevenness(0);
        assert!(uneven > 1e-11 && uneven < 3e-9, "{uneven}");
        // With more digits it is even; with fewer it is none.
        let regions = CoplanarRegions::of(&wall(1e14));
        assert_eq!((regions.len(), regions.unevenness(0)), (1, 0.0));
        assert!(CoplanarRegions::of(&wall(1e6)).len() > 8);
    }

    /// A wall whose pieces are not in one plane is held against what stands in it by its pieces: by its plane, the
    /// wall of the house behind it would be in front of it.
    #[test]
    fn a_rough_wall_with_a_party_wall_stays_in_pieces() {
        // Bent by 3·10⁻⁹ along its diagonal.
        let wall = |x: f64, turned: bool| {
            let (a, b, c, d) = ([x, 0., 0.], [x, 1., 0.], [x - 3e-9, 1., 1.], [x, 0., 1.]);
            if turned {
                [[a, c, b], [a, d, c]]
            } else {
                [[a, b, c], [a, c, d]]
            }
        };
        let regions = |others: &[[[f64; 3]; 3]]| {
            let triangles: Vec<_> = wall(0.0, false).iter().chain(others).copied().collect();
            CoplanarRegions::of(&model(&scene(&triangles), Subdivision::None))
                .of_patch
                .iter()
                .take(2)
                .copied()
                .collect::<Vec<_>>()
        };
        assert_eq!(regions(&[]), [0, 0]);
        // Far behind it, and beside it in its plane.
        assert_eq!(regions(&wall(-1e-3, true)), [0, 0]);
        let beside = [[0., 1., 0.], [0., 2., 0.], [0., 1., 1.]];
        assert_eq!(regions(&[beside]), [0, 0]);
        // On it, behind it by less than it is bent, and on a part of it, whichever way it faces.
        for others in [wall(0.0, true), wall(-5e-10, true), wall(-5e-10, false)] {
            assert_eq!(regions(&others), [0, 1], "{others:?}");
            assert_eq!(regions(&others[..1]), [0, 1], "{others:?}");
        }
    }

    #[test]
    fn what_is_not_one_convex_wall_stays_in_pieces() {
        let (a, b, c, d) = ([0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]);
        // A square is one region; bent by a hair it is two.
        assert_eq!(sound(&model(&scene(&[[a, b, c], [a, c, d]]), Subdivision::None)), [4]);
        let bent = [0., 1., 1e-6];
        assert_eq!(
            sound(&model(&scene(&[[a, b, c], [a, c, bent]]), Subdivision::None)),
            [3, 3]
        );
        // Given twice, each triangle is by itself.
        let twice = [[a, b, c], [a, c, d], [a, b, c], [a, c, d]];
        assert_eq!(sound(&model(&scene(&twice), Subdivision::None)), [3; 4]);
        // Three squares round a corner are not convex: cut, each triangle is a region again.
        let (e, f, g, h) = ([2., 0., 0.], [2., 1., 0.], [0., 2., 0.], [1., 2., 0.]);
        let angle = [[a, b, c], [a, c, d], [b, e, f], [b, f, c], [d, c, h], [d, h, g]];
        assert_eq!(sound(&model(&scene(&angle), Subdivision::None)), [3; 6]);
        assert_eq!(sound(&model(&scene(&angle), Subdivision::Levels(2))), [3; 6]);
    }
}
