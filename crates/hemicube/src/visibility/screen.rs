//! Patches from which nothing can be seen of given triangles.
//!
//! A polygon that each segment between the corners of two triangles passes hides all of one from all of the other
//! ([`super::shaft::hides`]). Where no polygon of a scene does so alone, the longer of the two triangles is halved: then
//! one wall may hide one half, and another wall the other. A segment between two centroids that nothing stops ends the
//! search: something can be seen. So does the bound of [`MOST_TESTS`] segments, in doubt for what can be seen.
//!
//! Most patches are hidden from the whole change by one wall, and most often by that of the patch before: a box round all
//! targets is tried first, and the last occluders before any segment.
//!
//! No one bound for all targets, searched side by side, because at like rows it takes longer (the tallest tower of
//! `denhaag-8897` goes: 7.4 s of the processor for 7.1 s); by 256 segments 42 % of the rows are left in place of 45 %, and
//! the search takes more than they would (8.3 s).
//!
//! The search is that of Teller & Séquin 1991 ("Visibility preprocessing for interactive walkthroughs") in its question,
//! with single occluders and halving in place of portals.

use crate::Model;
use crate::bvh::UNUSED;
use crate::geometry::{Plane, area, bounds, centroid, cross};
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::segments::{Segment, lanes_crossed};
use crate::visibility::shaft::hides;
use crate::visibility::wide::{Pending, WideTree};
use glam::{BVec3, DVec3};
use std::collections::VecDeque;
use std::sync::Arc;

/// Bound of the segments tested between one patch and one triangle: a tenth of a millisecond. A choice: with fewer,
/// patches count as seeing what they do not see; with more, the search takes longer than their rows.
const MOST_TESTS: usize = 32;
/// Bound of the regions on a segment that are tried as occluders. A choice, as above.
const MOST_TRIED: usize = 16;
/// Number of occluders kept for the next search.
const RECENT: usize = 4;
/// Height above its plane, in tolerances, at which a patch looks out: above surfaces that lie in its plane.
const ABOVE: f64 = 4.0;
/// Triangles up to which each is looked for by itself; of more, boxes are.
const MOST_BY_THEMSELVES: usize = 64;
/// Number of boxes, at most.
const BOXES: usize = 8;

/// The surfaces of a scene, as what may hide something.
#[derive(Debug)]
pub(crate) struct Screen {
    model: Model,
    regions: Arc<CoplanarRegions>,
}

/// What is looked for.
#[derive(Debug)]
pub(crate) struct Targets {
    triangles: Vec<[DVec3; 3]>,
    /// The corners of a box round all, and the smallest of the triangles.
    hull: [DVec3; 8],
    smallest: [DVec3; 3],
    /// Where `triangles` are the faces of boxes, the boxes. A patch outside sees something in a box only through a face.
    boxes: Vec<[DVec3; 2]>,
}

/// Storage of the search from one patch after the other. What was found may depend on the patches before, so where
/// searches begin must not depend on threads.
#[derive(Debug, Default)]
pub(crate) struct Search {
    pending: Pending,
    crossed: Vec<u32>,
    /// Regions that hid something, the last one first.
    recent: VecDeque<u32>,
    /// The target that was seen last.
    seen: usize,
    halves: VecDeque<[[DVec3; 3]; 2]>,
}

impl Screen {
    /// The surfaces of a model.
    pub(crate) fn of(model: Model) -> Self {
        let regions = CoplanarRegions::of(&model);
        Self { model, regions }
    }

    /// Triangles in the scene's unit as [`Self::hides_all`] takes them, at least one: themselves, or the faces of boxes
    /// round them where they are more than [`MOST_BY_THEMSELVES`].
    pub(crate) fn targets(&self, mut triangles: Vec<[DVec3; 3]>) -> Targets {
        for corner in triangles.as_flattened_mut() {
            *corner = self.model.normalise(*corner);
        }
        let mut boxes = Vec::new();
        if triangles.len() > MOST_BY_THEMSELVES {
            enclose(&mut triangles, BOXES, &mut boxes);
            triangles = boxes.iter().copied().flat_map(faces).collect();
        }
        let mut hull = Vec::new();
        enclose(&mut triangles, 1, &mut hull);
        let [low, high] = hull[0];
        let corner = |k: usize| DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low);
        let smallest = triangles.iter().copied().min_by(|a, b| area(a).total_cmp(&area(b)));
        Targets {
            hull: std::array::from_fn(corner),
            smallest: smallest.unwrap_or_default(),
            triangles,
            boxes,
        }
    }

    /// Returns whether a patch, in the scene's unit, sees nothing of the targets. False in doubt.
    pub(crate) fn hides_all(&self, patch: [DVec3; 3], targets: &Targets, search: &mut Search) -> bool {
        let from = patch.map(|corner| self.model.normalise(corner));
        let Some(normal) = cross(&from).try_normalize() else {
            return false;
        };
        let plane = Plane {
            normal,
            offset: normal.dot(from[0]),
        };
        let (low, high) = bounds(&from);
        let reaches_into = |[least, most]: &[DVec3; 2]| low.cmple(*most).all() && least.cmple(high).all();
        if targets.boxes.iter().any(reaches_into) {
            return false;
        }
        if self.hides_hull(from, &plane, targets, search) {
            return true;
        }
        // What the patch before saw, this one sees, too, most often.
        let (before, after) = targets.triangles.split_at(search.seen.min(targets.triangles.len()));
        let mut from_seen = after.iter().chain(before);
        let seen = from_seen.position(|target| !self.hides(from, &plane, *target, search));
        if let Some(place) = seen {
            search.seen = (search.seen + place) % targets.triangles.len();
        }
        seen.is_none()
    }

    /// Returns whether a patch sees nothing of a box round all targets. False in doubt.
    fn hides_hull(&self, from: [DVec3; 3], plane: &Plane, targets: &Targets, search: &mut Search) -> bool {
        let tolerance = self.regions.tree.plane_tolerance;
        if targets.hull.iter().all(|&corner| plane.height(corner) <= tolerance) {
            return true;
        }
        let small = if area(&from) < area(&targets.smallest) {
            &from
        } else {
            &targets.smallest
        };
        let hides = self.occluder(from, targets.hull, small);
        if search.was_hidden(&hides) {
            return true;
        }
        let end = targets.hull.iter().sum::<DVec3>() / 8.0;
        let start = centroid(&from) + plane.normal * (ABOVE * tolerance);
        self.cross(start, end, search);
        search.is_hidden(&hides)
    }

    /// A test of regions: whether one hides all of a triangle from all of a body. A body with a face on the region, as
    /// of two surfaces in one place, may be seen in its stead.
    fn occluder<const N: usize>(
        &self,
        from: [DVec3; 3],
        to: [DVec3; N],
        small: &[DVec3; 3],
    ) -> impl Fn(u32) -> bool + use<'_, N> {
        let origin = from[0];
        let [from, small] = [&from, small].map(|triangle| triangle.map(|corner| corner - origin));
        let to = to.map(|corner| corner - origin);
        let tolerance = self.regions.tree.plane_tolerance;
        move |region| {
            let polygon = self.regions.corners(region);
            hides(polygon, origin, &from, &to, &small, tolerance) && !has_face_in(polygon, origin, &to, tolerance)
        }
    }

    fn hides(&self, from: [DVec3; 3], plane: &Plane, target: [DVec3; 3], search: &mut Search) -> bool {
        let tolerance = self.regions.tree.plane_tolerance;
        let mut tests = 0;
        search.halves.clear();
        search.halves.push_back([from, target]);
        while let Some([from, to]) = search.halves.pop_front() {
            if to.iter().all(|&corner| plane.height(corner) <= tolerance) {
                continue;
            }
            let hides = self.occluder(from, to, if area(&from) < area(&to) { &from } else { &to });
            if search.was_hidden(&hides) {
                continue;
            }
            tests += 1;
            if tests > MOST_TESTS {
                return false;
            }
            let (start, end) = (centroid(&from) + plane.normal * (ABOVE * tolerance), centroid(&to));
            // Below the horizon the patch itself is in the way.
            if plane.height(end) > ABOVE * tolerance {
                self.cross(start, end, search);
                if search.crossed.is_empty() {
                    return false;
                }
                if search.is_hidden(&hides) {
                    continue;
                }
            }
            let (of_from, of_to) = (longest_edge(&from), longest_edge(&to));
            search.halves.extend(if of_from.1 >= of_to.1 {
                halves(&from, of_from.0).map(|half| [half, to])
            } else {
                halves(&to, of_to.0).map(|half| [from, half])
            });
        }
        true
    }

    /// Finds regions that a segment crosses, up to [`MOST_TRIED`].
    fn cross(&self, start: DVec3, end: DVec3, search: &mut Search) {
        let segment = Segment::new(start, end, self.regions.tree.plane_tolerance);
        search.crossed.clear();
        WideTree::begin(&mut search.pending);
        while let Some(index) = self.regions.wide.next(&segment, 1.0, &mut search.pending) {
            let block = &self.regions.tree.blocks[index as usize];
            for region in lanes_crossed(block, &segment).map(|l| block.negative[l]) {
                if region != UNUSED && !search.crossed.contains(&region) {
                    search.crossed.push(region);
                }
            }
            if search.crossed.len() >= MOST_TRIED {
                break;
            }
        }
    }
}

impl Search {
    /// Returns whether one of the last occluders hides something, and puts it first.
    fn was_hidden(&mut self, hides: impl Fn(u32) -> bool) -> bool {
        let found = self.recent.iter().position(|&region| hides(region));
        if let Some(place) = found {
            self.recent.swap(0, place);
        }
        found.is_some()
    }

    /// Returns whether one of the regions crossed hides something, and keeps it.
    fn is_hidden(&mut self, hides: impl Fn(u32) -> bool) -> bool {
        let found = self.crossed.iter().copied().find(|&region| hides(region));
        if let Some(region) = found {
            self.recent.push_front(region);
            self.recent.truncate(RECENT);
        }
        found.is_some()
    }
}

/// Returns whether three corners of a body or more lie in a polygon's plane.
fn has_face_in<const N: usize>(polygon: &[DVec3], origin: DVec3, body: &[DVec3; N], tolerance: f64) -> bool {
    let normal = (polygon[1] - polygon[0]).cross(polygon[2] - polygon[0]);
    let slack = tolerance * normal.length();
    let first = polygon[0] - origin;
    body.iter()
        .filter(|&&corner| normal.dot(corner - first).abs() <= slack)
        .count()
        >= 3
}

/// The longest edge of a triangle: the corner that it begins at, and its squared length.
fn longest_edge(triangle: &[DVec3; 3]) -> (usize, f64) {
    let length = |k: usize| triangle[k].distance_squared(triangle[(k + 1) % 3]);
    let longest = |a: usize, b: usize| if length(b) > length(a) { b } else { a };
    let edge = longest(longest(0, 1), 2);
    (edge, length(edge))
}

/// A triangle cut in two at the middle of one edge.
fn halves(triangle: &[DVec3; 3], edge: usize) -> [[DVec3; 3]; 2] {
    let [a, b, c] = [0, 1, 2].map(|k| triangle[(edge + k) % 3]);
    let middle = 0.5 * (a + b);
    [[a, middle, c], [middle, b, c]]
}

/// Boxes round triangles: up to `count`, halved by number across the longest side.
fn enclose(triangles: &mut [[DVec3; 3]], count: usize, boxes: &mut Vec<[DVec3; 2]>) {
    let corners = || triangles.as_flattened().iter();
    let low = corners().fold(DVec3::INFINITY, |low, &corner| low.min(corner));
    let high = corners().fold(DVec3::NEG_INFINITY, |high, &corner| high.max(corner));
    if count <= 1 || triangles.len() <= 1 {
        boxes.push([low, high]);
        return;
    }
    let sides = (high - low).to_array();
    let axis = if sides[0] >= sides[1] && sides[0] >= sides[2] {
        0
    } else {
        1 + usize::from(sides[2] > sides[1])
    };
    let middle = triangles.len() / 2;
    let (first, ..) = triangles.select_nth_unstable_by(middle, |a, b| centroid(a)[axis].total_cmp(&centroid(b)[axis]));
    let first = first.len();
    let (first, second) = triangles.split_at_mut(first);
    enclose(first, count / 2, boxes);
    enclose(second, count / 2, boxes);
}

/// The faces of a box, two triangles each.
fn faces([low, high]: [DVec3; 2]) -> impl Iterator<Item = [DVec3; 3]> {
    (0..3).flat_map(move |axis| {
        [low, high].into_iter().flat_map(move |at| {
            let corner = |first: bool, second: bool| {
                let mut corner = [0.0; 3];
                corner[axis] = at[axis];
                let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
                corner[u] = if first { high[u] } else { low[u] };
                corner[v] = if second { high[v] } else { low[v] };
                DVec3::from_array(corner)
            };
            let [a, b, c, d] = [(false, false), (true, false), (true, true), (false, true)].map(|(u, v)| corner(u, v));
            [[a, b, c], [a, c, d]]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::one_sided;

    fn p(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    /// A wall at x, of this breadth about y and from the ground up to a height.
    fn wall(x: f64, y: f64, breadth: f64, height: f64) -> [[DVec3; 3]; 2] {
        let [a, b] = [y - 0.5 * breadth, y + 0.5 * breadth];
        [
            [p(x, a, 0.0), p(x, b, 0.0), p(x, b, height)],
            [p(x, a, 0.0), p(x, b, height), p(x, a, height)],
        ]
    }

    fn is_hidden(walls: &[[[DVec3; 3]; 2]], from: [DVec3; 3], what: [[DVec3; 3]; 2]) -> bool {
        let mut triangles = vec![from];
        triangles.extend(walls.iter().flatten());
        let screen = Screen::of(one_sided(&triangles));
        let targets = screen.targets(what.to_vec());
        screen.hides_all(from, &targets, &mut Search::default())
    }

    /// A patch on the ground that looks up.
    const GROUND: [DVec3; 3] = [DVec3::new(0., -1., 0.), DVec3::new(1., 0., 0.), DVec3::new(0., 1., 0.)];

    #[test]
    fn a_wall_hides_what_is_lower_behind_it_and_nothing_that_looks_over_or_round_it() {
        let target = wall(6.0, 0.0, 2.0, 1.0);
        assert!(is_hidden(&[wall(3.0, 0.0, 8.0, 2.0)], GROUND, target));
        assert!(!is_hidden(&[], GROUND, target));
        assert!(!is_hidden(
            &[wall(3.0, 0.0, 8.0, 2.0)],
            GROUND,
            wall(6.0, 0.0, 2.0, 9.0)
        ));
        assert!(!is_hidden(&[wall(3.0, 0.0, 1.5, 2.0)], GROUND, target));
        // A slit of a thousandth.
        let halves = [wall(3.0, 2.0005, 4.0, 2.0), wall(3.0, -2.0005, 4.0, 2.0)];
        assert!(!is_hidden(&halves, GROUND, target));
    }

    #[test]
    fn walls_hide_together_what_none_of_them_hides_alone() {
        let target = wall(6.0, 0.0, 2.0, 1.0);
        let walls = [wall(3.0, 2.0, 4.0, 2.0), wall(3.2, -1.8, 5.2, 2.0)];
        assert!(walls.iter().all(|wall| !is_hidden(&[*wall], GROUND, target)));
        assert!(is_hidden(&walls, GROUND, target));
    }

    /// The faces of a box 1 m deep, as high and broad as a wall at x.
    fn block(x: f64, breadth: f64, height: f64) -> Vec<[DVec3; 3]> {
        faces([p(x, -0.5 * breadth, 0.0), p(x + 1.0, 0.5 * breadth, height)]).collect()
    }

    #[test]
    fn what_stands_in_the_place_of_a_wall_may_be_seen_in_its_stead() {
        for (x, hidden) in [(3.0, false), (3.1, true)] {
            let mut triangles = vec![GROUND];
            triangles.extend(wall(3.0, 0.0, 8.0, 2.0));
            let screen = Screen::of(one_sided(&triangles));
            let targets = screen.targets(block(x, 2.0, 1.0));
            assert_eq!(
                screen.hides_all(GROUND, &targets, &mut Search::default()),
                hidden,
                "at {x}"
            );
        }
    }

    #[test]
    fn what_is_behind_a_patch_or_in_its_plane_is_not_seen() {
        let flat = [[p(5.0, 0.0, 0.0), p(6.0, 0.0, 0.0), p(5.0, 1.0, 0.0)]; 2];
        assert!(is_hidden(&[], GROUND, flat));
        assert!(is_hidden(&[], GROUND, wall(6.0, 0.0, 1.0, -3.0)));
        let [a, b, c] = GROUND;
        assert!(!is_hidden(&[], [a, c, b], wall(6.0, 0.0, 1.0, -3.0)));
    }

    #[test]
    fn boxes_hold_what_they_stand_for() {
        let screen = Screen::of(one_sided(&[GROUND]));
        let many: Vec<[DVec3; 3]> = (0..100).map(|k| wall(f64::from(k), 0.0, 1.0, 1.0)[0]).collect();
        let targets = screen.targets(many.clone());
        assert_eq!((targets.boxes.len(), targets.triangles.len()), (BOXES, BOXES * 12));
        for corner in many.as_flattened().iter().map(|&corner| screen.model.normalise(corner)) {
            let holds = |[low, high]: &[DVec3; 2]| low.cmple(corner).all() && corner.cmple(*high).all();
            assert!(targets.boxes.iter().any(holds), "{corner}");
        }
        let inside = many[50].map(|corner| corner + p(0.5, 0.0, 0.0));
        assert!(!screen.hides_all(inside, &targets, &mut Search::default()));
    }
}
