//! Closed spaces: the parts of a scene that closed surfaces keep apart.
//!
//! No straight line joins two patches in different spaces, whatever rays, pixels or rounding say. So a pair of them has
//! no form factor. The spaces follow from how the mesh is connected, in four steps:
//!
//! 1. *Sheets.* Every surface has two sides. Around an edge, sort the surfaces that end there by angle: two neighbours
//!    face the same wedge of space, so the sides that bound the wedge are joined. At the free edge of a surface its two
//!    sides are joined. A set of joined sides is a *sheet*: a closed oriented surface.
//! 2. *Sight.* Sides that see each other by a ray are joined. Where surfaces cross each other, all their sides are.
//! 3. *Proof.* Two sets that are still apart must differ in the winding number of some sheet about their patches. It is
//!    an integer and the same along any path that does not cross the sheet (Jacobson, Kavan & Sorkine-Hornung 2013,
//!    eq. 1 to 5; solid angles by Van Oosterom & Strackee 1983, eq. 8). Sets without a difference are joined.
//! 4. The sets that are left are the spaces.
//!
//! Surfaces of two spaces may lie on each other, as a cabinet's bottom on a floor. What a row sees there is the surface
//! of its own space, though pixels and rays cannot tell which of the two is in front ([`Spaces::own_at`]).
//!
//! Each step joins rather than separates where it is in doubt: what is lost then is a proof, never a form factor. Corners
//! are shared if their coordinates are equal; along free edges, if they are within the scene's tolerance, and a corner
//! on another surface's free edge divides that edge (a T-junction).
//!
//! Cost: O(n log n) for n surfaces, and only where step 2 leaves more than one space are crossings and winding numbers
//! looked for, within [`MOST_BLOCKS`] blocks of the tree and [`MOST_ANGLES`] solid angles a surface. A scene that meets a
//! bound has one space. Surfaces that lie on each other are looked for within as many blocks again.

use crate::Model;
use crate::backend::{Geometry, Surface};
use crate::bvh::{Bounds, LANES, Tree, UNUSED, overlap};
use crate::geometry::{Plane, centroid, cross, within};
use crate::sampling::splitmix;
use crate::visibility::coplanar::number_corners;
use crate::visibility::nearest::nearest;
use crate::visibility::segments::crossing;
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;

/// Rays that leave each sheet to see others. A choice: with fewer, more sheets are left for step 3.
const RAYS: usize = 16;
/// Length of a ray: longer than any way through the scene, which fits a cube of side 2.
const FAR: f64 = 4.0;
/// Bound of the blocks of the tree that crossings and divided edges are looked for in, a surface. A choice: beyond it the
/// scene counts as one space.
const MOST_BLOCKS: usize = 256;
/// Bound of the solid angles of winding numbers, a surface. A choice, as above.
const MOST_ANGLES: usize = 4_096;
/// Bound of the pairs of patches that lie on each other, a surface: some 200 bytes each. A choice: a mesh on another has
/// about ten.
const MOST_ON_EACH_OTHER: usize = 64;
/// Patches of a sheet about which winding numbers are taken. A choice: all must agree.
const SAMPLES: usize = 3;
/// Patches of a set that are looked at for [`SAMPLES`] that no other surface lies on. A choice: with fewer, a shell
/// with much laid on it counts as open; with more, such shells take longer.
const LOOKED_AT: usize = 64;
/// Cosine between the normals of surfaces that lie on each other, at least. A choice: with less, surfaces that meet at
/// an edge count as laid on each other; with more, a rough copy of a wall does not.
const PARALLEL: f64 = 0.999;
/// Difference of a winding number from an integer, at most: a sheet with a hole has a larger one.
const INTEGER: f64 = 1e-6;
/// Distance before a patch from which winding numbers are taken, in tolerances.
const BEFORE: f64 = 16.0;
/// Tolerances within which surfaces at an edge lie in one plane, or a corner on an edge.
const TOLERANCES: f64 = 4.0;

/// The closed spaces of a scene.
#[derive(Debug, Default)]
pub(crate) struct Spaces {
    /// The space that each patch faces; empty if there is one only.
    of_patch: Vec<u32>,
    /// Whether each space is closed: nothing that leaves a patch in it leaves the scene.
    is_closed: Vec<bool>,
    /// Pairs of patches in two spaces that lie on each other and face the same way, in both orders, ascending.
    on_each_other: Vec<OnEachOther>,
}

/// Two patches that lie on each other, and what they have in common.
#[derive(Clone, Debug)]
struct OnEachOther {
    patches: (u32, u32),
    /// A convex polygon, counter-clockwise as seen from their side.
    common: Vec<DVec3>,
}

impl Spaces {
    /// The spaces of a model, found at the first call and shared from then on.
    pub(crate) fn of(model: &Model) -> Arc<Self> {
        Self::of_geometry(model.geometry())
    }

    /// [`Self::of`] a model of this geometry.
    pub(crate) fn of_geometry(geometry: &Geometry) -> Arc<Self> {
        geometry.kept(|geometry| Sheets::of(geometry).spaces().unwrap_or_default())
    }

    /// Returns whether a closed surface keeps two patches apart.
    #[inline]
    pub(crate) fn separate(&self, i: u32, j: u32) -> bool {
        !self.of_patch.is_empty() && self.of_patch[i as usize] != self.of_patch[j as usize]
    }

    /// Returns whether a patch faces a closed space that is not the whole scene's only one.
    pub(crate) fn is_closed(&self, patch: u32) -> bool {
        !self.of_patch.is_empty() && self.is_closed[self.of_patch[patch as usize] as usize]
    }
}

impl Spaces {
    /// Returns whether patches of two spaces lie on each other and face the same way.
    pub(crate) fn overlap(&self) -> bool {
        !self.on_each_other.is_empty()
    }

    /// The patches in the space that `emitter` faces that lie on a patch of another space and face the same way, each
    /// with what the two have in common: a convex polygon.
    pub(crate) fn own_at(&self, emitter: u32, patch: u32) -> impl Iterator<Item = (u32, &[DVec3])> {
        let from = self.on_each_other.partition_point(|pair| pair.patches.0 < patch);
        let of_patch = self.on_each_other[from..]
            .iter()
            .take_while(move |pair| pair.patches.0 == patch);
        of_patch
            .filter(move |pair| !self.separate(emitter, pair.patches.1))
            .map(|pair| (pair.patches.1, &*pair.common))
    }
}

/// Disjoint sets of numbers.
#[derive(Debug)]
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..u32::try_from(count).unwrap_or(u32::MAX)).collect())
    }

    /// The set of a number: one of its members.
    fn find(&mut self, mut of: u32) -> u32 {
        while self.0[of as usize] != of {
            let next = self.0[self.0[of as usize] as usize];
            self.0[of as usize] = next;
            of = next;
        }
        of
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        // The smaller number leads, so that sets do not depend on the order of joining.
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// A surface that ends at an edge.
#[derive(Clone, Copy, Debug)]
struct Sheet {
    angle: f64,
    /// From the edge to the opposite corner, at right angles to the edge.
    height: f64,
    /// The side that faces smaller angles, and the one that faces larger ones.
    before: u32,
    after: u32,
    /// True if a patch lies on the side that faces smaller, or larger, angles.
    seen: [bool; 2],
}

/// One edge of a surface, by its corners' numbers, the smaller first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct EdgeOf {
    low: u32,
    high: u32,
    surface: u32,
    /// The corner at which it begins in the surface's own order, 0 to 2.
    corner: u8,
}

/// The sides of a scene's surfaces: 2s is the front of surface s, 2s + 1 its back.
struct Sheets<'g> {
    geometry: &'g Geometry,
    tolerance: f64,
    /// The number of each corner's place.
    corners: Vec<[u32; 3]>,
    places: Vec<DVec3>,
    /// Joined by edges alone: sheets.
    sheets: Sets,
    /// Joined by all steps; the last number stands for what lies outside of the scene.
    sets: Sets,
    /// The surface in each slot of the tree, once it was asked for.
    surface_of_slot: Vec<u32>,
    /// Blocks of the tree looked at so far.
    blocks: usize,
}

impl<'g> Sheets<'g> {
    fn of(geometry: &'g Geometry) -> Self {
        let count = geometry.surfaces.len();
        let (corners, places) = number_corners(&geometry.surfaces, 0..count);
        let mut sheets = Self {
            geometry,
            tolerance: TOLERANCES * geometry.plane_tolerance,
            corners,
            places,
            sheets: Sets::new(2 * count),
            sets: Sets::new(0),
            surface_of_slot: Vec::new(),
            blocks: 0,
        };
        sheets.join_edges();
        let mut sets = Sets::new(2 * count + 1);
        for side in 0..sheets.outside() {
            let sheet = sheets.sheets.find(side);
            sets.join(side, sheet);
        }
        sheets.sets = sets;
        sheets
    }

    /// The scene's tree, with the surface in each of its slots.
    fn tree(&mut self) -> Arc<Tree> {
        let tree = Tree::of(self.geometry);
        if self.surface_of_slot.is_empty() {
            self.surface_of_slot = vec![u32::MAX; tree.blocks.len() * LANES];
            for (s, surface) in (0u32..).zip(&self.geometry.surfaces) {
                self.surface_of_slot[tree.slot_of_patch[surface.front.0 as usize] as usize] = s;
            }
        }
        tree
    }

    /// The number that stands for what lies outside of the scene.
    fn outside(&self) -> u32 {
        u32::try_from(2 * self.geometry.surfaces.len()).unwrap_or(u32::MAX)
    }

    /// The spaces, where patches face more than one.
    fn spaces(mut self) -> Option<Spaces> {
        if !self.join_by_sight() || self.fronts().len() < 2 {
            return None;
        }
        self.join_crossing()?;
        if self.fronts().len() < 2 {
            return None;
        }
        self.join_unproved()?;
        let fronts = self.fronts();
        if fronts.len() < 2 {
            return None;
        }
        let geometry = self.geometry;
        let mut of_patch = vec![0; geometry.patch_count as usize];
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            for (side, patch) in sides_with_patches(s, surface) {
                let set = self.sets.find(side);
                of_patch[patch as usize] = u32::try_from(fronts.partition_point(|&of| of < set)).unwrap_or(0);
            }
        }
        let outside = self.outside();
        let outside = self.sets.find(outside);
        let is_closed = fronts.iter().map(|&set| set != outside).collect();
        let on_each_other = self.on_each_other(&of_patch);
        Some(Spaces {
            of_patch,
            is_closed,
            on_each_other,
        })
    }

    /// The sets with a patch, ascending.
    fn fronts(&mut self) -> Vec<u32> {
        let geometry = self.geometry;
        let mut found = Vec::new();
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            for (side, _) in sides_with_patches(s, surface) {
                let set = self.sets.find(side);
                if found.last() != Some(&set) {
                    found.push(set);
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Joins the sides that face the same wedge at an edge.
    fn join_edges(&mut self) {
        let mut edges = self.edges();
        let free = self.free_corners(&edges);
        if !free.is_empty() {
            self.weld(&free);
            self.divide(&free, &mut edges);
        }
        let mut at_edge = Vec::new();
        for edge in at_edges(&edges) {
            self.sheets_at(edge, &mut at_edge);
            self.join_wedges(&mut at_edge);
        }
    }

    /// The edges of all surfaces, sorted.
    fn edges(&self) -> Vec<EdgeOf> {
        let mut edges = Vec::with_capacity(3 * self.corners.len());
        for (surface, corners) in (0u32..).zip(&self.corners) {
            for corner in 0..3u8 {
                let (from, to) = (corners[usize::from(corner)], corners[usize::from((corner + 1) % 3)]);
                edges.push(EdgeOf {
                    low: from.min(to),
                    high: from.max(to),
                    surface,
                    corner,
                });
            }
        }
        edges.sort_unstable();
        edges
    }

    /// The corners at the ends of free edges, ascending: those where all surfaces lie in one plane on one side.
    fn free_corners(&self, edges: &[EdgeOf]) -> Vec<u32> {
        let mut free = Vec::new();
        let mut at_edge = Vec::new();
        for edge in at_edges(edges) {
            self.sheets_at(edge, &mut at_edge);
            let is_free = at_edge.iter().all(|sheet| self.is_in_plane(&at_edge[0], sheet));
            if is_free {
                free.extend([edge[0].low, edge[0].high]);
            }
        }
        free.sort_unstable();
        free.dedup();
        free
    }

    /// Gives free corners within the tolerance of each other one number.
    fn weld(&mut self, free: &[u32]) {
        let mut leader: HashMap<u32, u32> = HashMap::new();
        let mut known: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        let size = 4.0 * self.tolerance;
        #[allow(clippy::cast_possible_truncation, reason = "a scene fits a cube of side 2")]
        let cell = |place: DVec3| (place / size).floor().to_array().map(|x| x as i64);
        for &corner in free {
            let place = self.places[corner as usize];
            let (low, high) = (cell(place - self.tolerance), cell(place + self.tolerance));
            let near = (low[0]..=high[0])
                .flat_map(|x| (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z])))
                .filter_map(|cell| known.get(&cell))
                .flatten()
                .copied()
                .filter(|&other| self.places[other as usize].distance(place) <= self.tolerance)
                .min();
            match near {
                Some(other) => {
                    leader.insert(corner, other);
                }
                None => known.entry(cell(place)).or_default().push(corner),
            }
        }
        if leader.is_empty() {
            return;
        }
        for corners in &mut self.corners {
            for corner in corners {
                *corner = leader.get(corner).copied().unwrap_or(*corner);
            }
        }
    }

    /// Divides edges at the free corners on them.
    fn divide(&mut self, free: &[u32], edges: &mut Vec<EdgeOf>) {
        let mut dividing: Vec<(u32, u8, u32)> = Vec::new();
        let mut pending = Vec::new();
        for &corner in free {
            let place = self.places[corner as usize];
            let reach = DVec3::splat(self.tolerance);
            let bounds = Bounds {
                low: place - reach,
                high: place + reach,
            };
            let is_within = self.blocks_in(&bounds, &mut pending, |sheets, surface| {
                let corners = sheets.corners[surface as usize];
                if corners.contains(&corner) {
                    return;
                }
                for k in 0..3u8 {
                    let [from, to] = [k, (k + 1) % 3].map(|k| sheets.places[corners[usize::from(k)] as usize]);
                    let along = to - from;
                    let share = (place - from).dot(along) / along.length_squared();
                    if share > 0.0 && share < 1.0 && (from + along * share).distance(place) <= sheets.tolerance {
                        dividing.push((surface, k, corner));
                    }
                }
            });
            if !is_within {
                return;
            }
        }
        *edges = self.edges();
        if dividing.is_empty() {
            return;
        }
        dividing.sort_unstable();
        dividing.dedup();
        edges.retain(|edge| {
            dividing
                .binary_search_by_key(&(edge.surface, edge.corner), |&(s, k, _)| (s, k))
                .is_err()
        });
        for of_edge in dividing.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (surface, corner, _) = of_edge[0];
            let corners = self.corners[surface as usize];
            let (from, to) = (corners[usize::from(corner)], corners[usize::from((corner + 1) % 3)]);
            let start = self.places[from as usize];
            let along = self.places[to as usize] - start;
            let mut between: Vec<u32> = of_edge.iter().map(|&(_, _, at)| at).collect();
            let share = |at: u32| (self.places[at as usize] - start).dot(along);
            between.sort_unstable_by(|&a, &b| share(a).total_cmp(&share(b)).then(a.cmp(&b)));
            let chain: Vec<u32> = std::iter::once(from).chain(between).chain([to]).collect();
            for pair in chain.windows(2) {
                edges.push(EdgeOf {
                    low: pair[0].min(pair[1]),
                    high: pair[0].max(pair[1]),
                    surface,
                    corner,
                });
            }
        }
        edges.sort_unstable();
    }

    /// The surfaces at an edge, by angle about it.
    fn sheets_at(&self, edge: &[EdgeOf], out: &mut Vec<Sheet>) {
        out.clear();
        let (low, high) = (self.places[edge[0].low as usize], self.places[edge[0].high as usize]);
        let axis = (high - low).normalize_or_zero();
        let mut frame = None;
        for of in edge {
            let surface = &self.geometry.surfaces[of.surface as usize];
            let corners = self.corners[of.surface as usize];
            let opposite = self.places[corners[usize::from((of.corner + 2) % 3)] as usize];
            let away = opposite - low;
            let away = away - axis * axis.dot(away);
            let height = away.length();
            let (x, y) = *frame.get_or_insert_with(|| {
                let x = away.normalize_or_zero();
                (x, axis.cross(x))
            });
            // In the surface's own order the edge runs from `corner` on: the front then faces larger angles.
            let from = self.places[corners[usize::from(of.corner)] as usize];
            let to = self.places[corners[usize::from((of.corner + 1) % 3)] as usize];
            let runs_up = (to - from).dot(axis) > 0.0;
            let (front, back) = (2 * of.surface, 2 * of.surface + 1);
            let sides = [true, surface.back.is_some()];
            out.push(Sheet {
                angle: away.dot(y).atan2(away.dot(x)),
                height,
                before: if runs_up { back } else { front },
                after: if runs_up { front } else { back },
                seen: if runs_up { [sides[1], sides[0]] } else { sides },
            });
        }
    }

    /// Returns whether two surfaces at an edge lie in one plane, on the same side of the edge.
    fn is_in_plane(&self, a: &Sheet, b: &Sheet) -> bool {
        let between = b.angle - a.angle;
        between.cos() > 0.0 && a.height.min(b.height) * between.sin().abs() <= self.tolerance
    }

    fn join_wedges(&mut self, at_edge: &mut [Sheet]) {
        if at_edge.iter().any(|sheet| sheet.height <= self.tolerance) {
            // Of a needle no angle is known.
            for sheet in &*at_edge {
                self.sheets.join(at_edge[0].before, sheet.before);
                self.sheets.join(at_edge[0].before, sheet.after);
            }
            return;
        }
        at_edge.sort_unstable_by(|a, b| a.angle.total_cmp(&b.angle).then(a.before.cmp(&b.before)));
        // Begin at the widest wedge, so that no surfaces of one plane are parted by where angles begin.
        let count = at_edge.len();
        let gap = |k: usize| {
            let next = at_edge[(k + 1) % count].angle + if k + 1 == count { std::f64::consts::TAU } else { 0.0 };
            next - at_edge[k].angle
        };
        let widest = (0..count).max_by(|&a, &b| gap(a).total_cmp(&gap(b)).then(b.cmp(&a)));
        at_edge.rotate_left((widest.unwrap_or(0) + 1) % count);
        // Surfaces of one plane count as one: its outer sides.
        let mut outer: Vec<(u32, u32)> = Vec::with_capacity(count);
        let mut start = 0;
        while start < count {
            let mut end = start + 1;
            while end < count && self.is_in_plane(&at_edge[end - 1], &at_edge[end]) {
                end += 1;
            }
            outer.push(self.join_plane(&at_edge[start..end]));
            start = end;
        }
        for k in 0..outer.len() {
            self.sheets.join(outer[k].1, outer[(k + 1) % outer.len()].0);
        }
    }

    /// Joins the sides of surfaces in one plane; returns its outer sides.
    ///
    /// One-sided surfaces back to back part what each of them faces, and their backs face each other. Others show a patch
    /// to both sides at once, and which of two is in front of the other, nobody knows.
    fn join_plane(&mut self, plane: &[Sheet]) -> (u32, u32) {
        let is_one_sided = plane.iter().all(|sheet| sheet.seen != [true, true]);
        let facing = |side: usize| plane.iter().find(|sheet| sheet.seen[side]);
        if let (true, Some(down), Some(up)) = (is_one_sided, facing(0), facing(1)) {
            for sheet in plane {
                let like = if sheet.seen[0] { down } else { up };
                self.sheets.join(like.before, sheet.before);
                self.sheets.join(like.after, sheet.after);
            }
            self.sheets.join(down.after, up.before);
            return (down.before, up.after);
        }
        for sheet in plane {
            self.sheets.join(plane[0].before, sheet.before);
            self.sheets.join(plane[0].after, sheet.after);
        }
        (plane[0].before, plane[0].after)
    }

    /// Joins sides that see each other, and those that see what lies outside. Returns false where no sheet is closed.
    fn join_by_sight(&mut self) -> bool {
        let geometry = self.geometry;
        let outside = self.outside();
        // Of each sheet, its patches and their sides.
        let mut of_sheet: HashMap<u32, Vec<(u32, u32)>> = HashMap::new();
        let mut is_any_closed = false;
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            is_any_closed |= self.sheets.find(2 * s) != self.sheets.find(2 * s + 1);
            for (side, patch) in sides_with_patches(s, surface) {
                of_sheet.entry(self.sheets.find(side)).or_default().push((patch, side));
            }
        }
        if of_sheet.len() < 2 || !is_any_closed {
            return is_any_closed;
        }
        // By patch: what is found does not depend on the octree.
        for sides in of_sheet.values_mut() {
            sides.sort_unstable();
        }
        let mut of_sheet: Vec<_> = of_sheet.into_values().collect();
        of_sheet.sort_unstable_by_key(|sides| sides[0]);
        let tree = self.tree();
        let mut pending = Vec::new();
        for sides in of_sheet {
            // A closed surface has four triangles and more: rays are fewer than half the sides.
            let rays = (sides.len() / 2).clamp(1, RAYS);
            for ray in 0..rays {
                let (_, side) = sides[(ray * sides.len() + sides.len() / 2) / rays];
                let patch = sides[0].0;
                let [a, b, c] = corners_of_side(geometry, side);
                let Some(normal) = cross(&[a, b, c]).try_normalize() else {
                    continue;
                };
                let horizon = Plane {
                    normal,
                    offset: normal.dot(a),
                };
                let mut state = u64::from(patch) << 8 | ray as u64;
                let mut random = || splitmix::unit(splitmix::next(&mut state));
                let (s, t) = crate::sampling::sobol::fold(random(), random());
                let from = a + (b - a) * s + (c - a) * t;
                if self.is_covered(side, from, &mut pending) {
                    continue;
                }
                let (x, y) = normal.any_orthonormal_pair();
                let squared = random();
                let (sin, cos) = (std::f64::consts::TAU * random()).sin_cos();
                let towards = (x * cos + y * sin) * squared.sqrt() + normal * (1.0 - squared).sqrt();
                let ends = [from, from + towards * FAR];
                match nearest(&tree, ends, &horizon, |_| false, &mut pending) {
                    None => self.sets.join(side, outside),
                    Some(met) => {
                        let seen = self.surface_of_slot[met.slot as usize];
                        if seen == u32::MAX {
                            continue;
                        }
                        let normal = cross(&geometry.surfaces[seen as usize].corners);
                        let is_front = normal.dot(towards) < 0.0;
                        let seen = 2 * seen + u32::from(!is_front);
                        // Of surfaces that lie on each other, nobody knows there which one was met.
                        let at = from + (ends[1] - from) * met.place;
                        if !self.is_covered(seen, at, &mut pending) {
                            self.sets.join(side, seen);
                        }
                    }
                }
            }
        }
        true
    }

    /// Joins all sides of surfaces that cross each other; `None` where the bound is met.
    fn join_crossing(&mut self) -> Option<()> {
        let geometry = self.geometry;
        let tolerance = geometry.plane_tolerance;
        let (mut pending, mut crossing) = (Vec::new(), Vec::new());
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            crossing.clear();
            let bounds = Bounds::of(surface.corners);
            let is_within = self.blocks_in(&bounds, &mut pending, |sheets, other| {
                if other > s
                    && cross_each_other(
                        &surface.corners,
                        &sheets.geometry.surfaces[other as usize].corners,
                        tolerance,
                    )
                {
                    crossing.push(other);
                }
            });
            if !is_within {
                return None;
            }
            for &other in &crossing {
                // A surface that others cross has parts in several spaces.
                for side in [2 * s + 1, 2 * other, 2 * other + 1] {
                    self.sets.join(2 * s, side);
                }
            }
        }
        Some(())
    }

    /// Calls `each` with the surfaces in blocks that a box meets; returns whether the bound of blocks is kept.
    fn blocks_in(&mut self, bounds: &Bounds, pending: &mut Vec<u32>, mut each: impl FnMut(&Self, u32)) -> bool {
        let tree = self.tree();
        let most = MOST_BLOCKS * self.geometry.surfaces.len().max(64);
        for at in tree.blocks_in(*bounds, pending) {
            self.blocks += 1;
            if self.blocks > most {
                return false;
            }
            let block = &tree.blocks[at as usize];
            for l in (0..LANES).filter(|&l| block.negative[l] != UNUSED) {
                let surface = self.surface_of_slot[at as usize * LANES + l];
                if surface != u32::MAX {
                    each(self, surface);
                }
            }
        }
        true
    }

    /// Pairs of patches in two spaces that lie on each other and face the same way, in both orders, ascending. None where
    /// the bound of blocks, or [`MOST_ON_EACH_OTHER`], is met: spaces stay apart, and what rows see there is blocked.
    fn on_each_other(&mut self, of_patch: &[u32]) -> Vec<OnEachOther> {
        let geometry = self.geometry;
        let most = MOST_ON_EACH_OTHER * geometry.surfaces.len();
        self.blocks = 0;
        let reach = DVec3::splat(self.tolerance);
        let (mut pending, mut found) = (Vec::new(), Vec::new());
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            let normal = cross(&surface.corners).normalize_or_zero();
            let mut bounds = Bounds::of(surface.corners);
            (bounds.low, bounds.high) = (bounds.low - reach, bounds.high + reach);
            let is_within = self.blocks_in(&bounds, &mut pending, |sheets, other| {
                if other <= s {
                    return;
                }
                let other = &geometry.surfaces[other as usize];
                let along = cross(&other.corners).normalize_or_zero().dot(normal);
                let is_in_plane = |corner: &DVec3| normal.dot(*corner - surface.corners[0]).abs() <= sheets.tolerance;
                if along.abs() <= PARALLEL
                    || !other.corners.iter().all(is_in_plane)
                    || !overlap(&surface.corners, &other.corners, normal, sheets.tolerance)
                {
                    return;
                }
                let patches = |surface: &Surface| [Some(surface.front.0), surface.back.map(|back| back.0)];
                let (own, mut others) = (patches(surface), patches(other));
                if along < 0.0 {
                    others.reverse();
                }
                for (side, (p, q)) in own.into_iter().zip(others).enumerate() {
                    if let (Some(p), Some(q)) = (p, q)
                        && of_patch[p as usize] != of_patch[q as usize]
                    {
                        let mut common = within(surface.corners.to_vec(), &other.corners);
                        if side == 1 {
                            common.reverse();
                        }
                        found.push(OnEachOther {
                            patches: (p, q),
                            common: common.clone(),
                        });
                        found.push(OnEachOther {
                            patches: (q, p),
                            common,
                        });
                    }
                }
            });
            if !is_within || found.len() > most {
                return Vec::new();
            }
        }
        found.sort_unstable_by_key(|pair| pair.patches);
        found
    }

    /// Joins sets about which all closed sheets have the same winding numbers; `None` where the bound is met.
    fn join_unproved(&mut self) -> Option<()> {
        let fronts = self.fronts();
        let samples = self.samples(&fronts);
        let mut most = MOST_ANGLES * self.geometry.surfaces.len().max(64);
        // Of each set, the sheets with a winding number other than 0, and that number.
        let mut windings: Vec<Vec<(u32, i64)>> = vec![Vec::new(); fronts.len()];
        for (sheet, closed) in (0u32..).zip(self.closed_sheets()) {
            let mut found = Vec::new();
            let mut is_closed = true;
            for (set, samples) in samples.iter().enumerate() {
                let mut of_set = None;
                for &sample in samples {
                    let about = closed.winding(self.geometry, sample, &mut most)?;
                    is_closed &= about.is_some() && (of_set.is_none() || of_set == about);
                    of_set = about;
                }
                found.extend(of_set.filter(|&winding| winding != 0).map(|winding| (set, winding)));
            }
            // A sheet with a hole, or one that a set lies on both sides of, proves nothing.
            if is_closed {
                found
                    .into_iter()
                    .for_each(|(set, winding)| windings[set].push((sheet, winding)));
            }
        }
        // What lies outside of the scene has none.
        let outside = self.outside();
        let mut alike: HashMap<&[(u32, i64)], u32> = HashMap::from([(&[] as &[_], outside)]);
        for (&set, windings) in fronts.iter().zip(&windings) {
            let first = *alike.entry(windings).or_insert(set);
            self.sets.join(first, set);
        }
        Some(())
    }

    /// The sheets with a patch that could be closed.
    fn closed_sheets(&mut self) -> Vec<Closed> {
        let geometry = self.geometry;
        let mut found: HashMap<u32, Closed> = HashMap::new();
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            let [front, back] = [2 * s, 2 * s + 1].map(|side| self.sheets.find(side));
            if front == back {
                continue;
            }
            for (side, sheet, has_patch) in [(2 * s, front, true), (2 * s + 1, back, surface.back.is_some())] {
                let closed = found.entry(sheet).or_insert_with(|| Closed {
                    sides: Vec::new(),
                    bounds: Bounds::of(surface.corners),
                    has_patch: false,
                });
                closed.sides.push(side);
                closed.bounds.low = surface.corners.iter().fold(closed.bounds.low, |low, p| low.min(*p));
                closed.bounds.high = surface.corners.iter().fold(closed.bounds.high, |high, p| high.max(*p));
                closed.has_patch |= has_patch;
            }
        }
        let mut found: Vec<Closed> = found.into_values().filter(|closed| closed.has_patch).collect();
        found.sort_unstable_by_key(|closed| closed.sides[0]);
        found
    }

    /// Some sides with a patch of each set.
    fn samples(&mut self, fronts: &[u32]) -> Vec<Vec<u32>> {
        let geometry = self.geometry;
        let mut all = vec![Vec::new(); fronts.len()];
        for (s, surface) in (0u32..).zip(&geometry.surfaces) {
            for (side, _) in sides_with_patches(s, surface) {
                let set = self.sets.find(side);
                if let Ok(at) = fronts.binary_search(&set) {
                    all[at].push(side);
                }
            }
        }
        let mut pending = Vec::new();
        all.into_iter()
            .map(|sides| {
                let spread = |sides: &[u32], count: usize| -> Vec<u32> {
                    let step = (sides.len() / count).max(1);
                    sides.iter().copied().step_by(step).take(count).collect()
                };
                let mut uncovered = spread(&sides, LOOKED_AT);
                uncovered
                    .retain(|&side| !self.is_covered(side, centroid(&corners_of_side(geometry, side)), &mut pending));
                // Where all are covered, as in a shell of no thickness, a sheet is all that tells their side.
                spread(if uncovered.is_empty() { &sides } else { &uncovered }, SAMPLES)
            })
            .collect()
    }

    /// Returns whether another surface lies on a side's own at a point, face to face or back to back: which of the two,
    /// nobody knows there. A cabinet's bottom on a floor faces what lies under it, and stands in the room all the same.
    /// True once the bound of blocks is met.
    fn is_covered(&mut self, side: u32, at: DVec3, pending: &mut Vec<u32>) -> bool {
        let reach = DVec3::splat(self.tolerance);
        let bounds = Bounds {
            low: at - reach,
            high: at + reach,
        };
        let own = side / 2;
        let normal = cross(&self.geometry.surfaces[own as usize].corners).normalize_or_zero();
        let mut is_covered = false;
        let is_within = self.blocks_in(&bounds, pending, |sheets, surface| {
            let corners = &sheets.geometry.surfaces[surface as usize].corners;
            let across = cross(corners).normalize_or_zero();
            let is_on = |k: usize| {
                let edge = corners[(k + 1) % 3] - corners[k];
                across.dot(edge.cross(at - corners[k])) >= -sheets.tolerance * edge.length()
            };
            is_covered |= surface != own
                && across.dot(normal).abs() > PARALLEL
                && across.dot(at - corners[0]).abs() <= sheets.tolerance
                && (0..3).all(is_on);
        });
        is_covered || !is_within
    }
}

/// A sheet that may be closed.
#[derive(Debug)]
struct Closed {
    /// Its sides; a surface with both sides in the sheet adds nothing to a winding number, and is left out.
    sides: Vec<u32>,
    bounds: Bounds,
    has_patch: bool,
}

impl Closed {
    /// The winding number about a point just in front of a side; the inner `None` if it is no integer, the
    /// outer one where the bound of solid angles is met.
    fn winding(&self, geometry: &Geometry, of: u32, most: &mut usize) -> Option<Option<i64>> {
        let corners = corners_of_side(geometry, of);
        // Another surface may lie in its plane, back to back: the point must lie before that one, too.
        let before = cross(&corners).normalize_or_zero() * (BEFORE * geometry.plane_tolerance);
        let at = centroid(&corners) + before;
        let is_outside = at.cmplt(self.bounds.low).any() || at.cmpgt(self.bounds.high).any();
        if is_outside {
            *most = most.checked_sub(1)?;
            return Some(Some(0));
        }
        *most = most.checked_sub(self.sides.len())?;
        let mut sum = 0.0;
        for &side in &self.sides {
            sum += solid_angle(corners_of_side(geometry, side), at);
        }
        let sum = sum / (4.0 * std::f64::consts::PI);
        let integer = sum.round();
        #[allow(
            clippy::cast_possible_truncation,
            reason = "an integer, at most the number of surfaces"
        )]
        let winding = ((sum - integer).abs() <= INTEGER).then_some(integer as i64);
        Some(winding)
    }
}

/// The surfaces that end at each edge, by edge; none of an edge without length.
fn at_edges(sorted: &[EdgeOf]) -> impl Iterator<Item = &[EdgeOf]> {
    let by_edge = sorted.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high));
    by_edge.filter(|edge| edge[0].low != edge[0].high)
}

/// The solid angle of a triangle from a point, positive if its front is seen (Van Oosterom & Strackee 1983, eq. 8).
fn solid_angle(triangle: [DVec3; 3], at: DVec3) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner - at);
    let (x, y, z) = (a.length(), b.length(), c.length());
    let above = -a.dot(b.cross(c));
    let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
    2.0 * above.atan2(below)
}

/// The corners of a side, in the order in which they are seen counter-clockwise.
fn corners_of_side(geometry: &Geometry, side: u32) -> [DVec3; 3] {
    let [a, b, c] = geometry.surfaces[side as usize / 2].corners;
    if side.is_multiple_of(2) { [a, b, c] } else { [a, c, b] }
}

/// The sides of a surface with a patch, and the patches.
fn sides_with_patches(s: u32, surface: &Surface) -> impl Iterator<Item = (u32, u32)> + use<> {
    let back = surface.back.map(|back| (2 * s + 1, back.0));
    std::iter::once((2 * s, surface.front.0)).chain(back)
}

/// Returns whether two triangles have points on either side of each other, farther than `tolerance`, and meet.
pub(crate) fn cross_each_other(p: &[DVec3; 3], q: &[DVec3; 3], tolerance: f64) -> bool {
    let is_cut = |p: &[DVec3; 3], q: &[DVec3; 3]| {
        let normal = cross(q).normalize_or_zero();
        let heights = p.map(|corner| normal.dot(corner - q[0]));
        heights.iter().any(|&h| h > tolerance) && heights.iter().any(|&h| h < -tolerance)
    };
    let has_edge_through = |p: &[DVec3; 3], q: &[DVec3; 3]| {
        let through = q.map(|corner| corner.to_array());
        [(p[0], p[1]), (p[1], p[2]), (p[2], p[0])]
            .into_iter()
            .any(|(from, to)| {
                let along = (to - from).to_array();
                crossing(through, from.to_array(), to.to_array(), along).hits
            })
    };
    is_cut(p, q) && is_cut(q, p) && (has_edge_through(p, q) || has_edge_through(q, p))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::one_sided;

    /// The twelve triangles of a box, facing its inside, turned off all axes.
    fn room(low: [f64; 3], high: [f64; 3]) -> Vec<[DVec3; 3]> {
        let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 2f64.sqrt());
        let corner = |k: usize| {
            let at = |axis: usize| if k >> axis & 1 == 1 { high[axis] } else { low[axis] };
            turn * DVec3::new(at(0), at(1), at(2))
        };
        let quads = [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ];
        let triangles = quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        triangles.map(|triangle| triangle.map(corner)).collect()
    }

    fn solid(low: [f64; 3], high: [f64; 3]) -> Vec<[DVec3; 3]> {
        room(low, high).into_iter().map(|[a, b, c]| [a, c, b]).collect()
    }

    fn of(parts: &[Vec<[DVec3; 3]>]) -> Arc<Spaces> {
        Spaces::of(&one_sided(&parts.concat()))
    }

    const LOW: [f64; 3] = [0.0; 3];
    const HIGH: [f64; 3] = [1.0; 3];

    #[test]
    fn rooms_that_share_a_wall_are_two_spaces_and_a_door_joins_them() {
        let next = || room([1.0, 0.0, 0.0], [2.5, 1.0, 1.0]);
        let spaces = of(&[room(LOW, HIGH), next()]);
        assert!(spaces.separate(0, 12) && !spaces.separate(0, 11) && !spaces.separate(12, 23));
        assert!(spaces.is_closed(0) && spaces.is_closed(12));
        // One of two triangles gone from either side of the wall.
        let (mut first, mut second) = (room(LOW, HIGH), next());
        first.remove(10);
        second.remove(9);
        let spaces = of(&[first, second]);
        assert!(!spaces.separate(0, 12), "{spaces:?}");
    }

    #[test]
    fn what_is_inside_of_what_is_told_by_winding_numbers() {
        let nested = [
            solid([-1.0; 3], [2.0; 3]),
            room(LOW, HIGH),
            solid([0.3; 3], [0.6; 3]),
            room([0.4; 3], [0.5; 3]),
        ];
        let spaces = of(&nested);
        let of_patch = [0, 12, 24, 36].map(|patch| spaces.of_patch[patch]);
        assert_eq!(of_patch[1], of_patch[2], "the room and the box in it: {of_patch:?}");
        assert!(of_patch[0] != of_patch[1] && of_patch[3] != of_patch[1] && of_patch[0] != of_patch[3]);
        assert!(!spaces.is_closed(0) && spaces.is_closed(12) && spaces.is_closed(36));
    }

    #[test]
    fn what_touches_or_crosses_a_wall_is_not_kept_from_its_room() {
        let far = || room([5.0; 3], [6.0; 3]);
        // Corner to corner with the room's walls.
        let spaces = of(&[room(LOW, HIGH), solid(LOW, [0.4, 1.0, 1.0]), far()]);
        assert!(!spaces.separate(0, 22) && spaces.separate(0, 24), "{spaces:?}");
        // Through the wall, half in and half out.
        let spaces = of(&[
            room(LOW, HIGH),
            solid([0.5, 0.4, 0.4], [1.5, 0.6, 0.6]),
            solid([3.0; 3], [4.0; 3]),
        ]);
        assert!(!spaces.separate(0, 12) && !spaces.separate(12, 24), "{spaces:?}");
    }

    #[test]
    fn a_corner_on_an_edge_divides_it() {
        let mut divided = room(LOW, HIGH);
        let [a, b, c] = divided[0];
        let middle = (a + b) * 0.5;
        divided.splice(0..1, [[a, middle, c], [middle, b, c]]);
        let spaces = of(&[divided, room([2.0; 3], [3.0; 3])]);
        assert!(spaces.separate(0, 13) && spaces.is_closed(0), "{spaces:?}");
    }

    #[test]
    fn solid_angles_of_an_octant() {
        let octant = [DVec3::X, DVec3::Y, DVec3::Z];
        let found = solid_angle(octant, DVec3::ZERO);
        assert!((found.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-15, "{found}");
        assert_eq!(solid_angle([octant[0], octant[2], octant[1]], DVec3::ZERO), -found);
    }
}
