//! Faces in one place: polygons with the same outline, whatever corner they begin at and wherever they are cut.
//!
//! The outline is the edges that one triangle of the face has, in loops, without corners on straight edges. Two faces
//! with equal loops, to the bit of each corner, lie in one place; the sense of the loops says whether they face alike.

use crate::Triangle;
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

/// Sine of the turn at a corner up to which it lies on a straight edge.
const STRAIGHT: f64 = 1e-9;

type Key = [u64; 3];

/// Loops of corners, each from its least corner towards the lesser of its neighbours.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Outline(Vec<Vec<Key>>);

/// A face of two triangles and more, and whether it runs through its outline as that is written.
pub(super) struct Face {
    pub(super) triangles: Range<usize>,
    pub(super) is_along: bool,
}

fn key(point: DVec3) -> Key {
    // Adding 0 turns −0 into 0 and leaves all else.
    (point + 0.0).to_array().map(f64::to_bits)
}

/// Triangles of one face each, one after the other.
fn faces(triangles: &[Triangle]) -> impl Iterator<Item = Range<usize>> {
    let mut begin = 0;
    triangles
        .chunk_by(|a, b| (a.face, a.object) == (b.face, b.object))
        .map(move |face| {
            let range = begin..begin + face.len();
            begin = range.end;
            range
        })
}

/// The corners of the loops of a face's outline, and whether it runs along them; `None` where loops touch.
fn outline(face: &[Triangle]) -> Option<(Outline, bool)> {
    let mut next: HashMap<Key, (DVec3, DVec3)> = HashMap::new();
    let mut edges: HashMap<[Key; 2], [DVec3; 2]> = HashMap::new();
    for triangle in face {
        let [a, b, c] = triangle.corners;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            // An edge within the face has its opposite in the neighbour.
            if edges.remove(&[key(to), key(from)]).is_none() && edges.insert([key(from), key(to)], [from, to]).is_some()
            {
                return None;
            }
        }
    }
    for [from, to] in edges.into_values() {
        if next.insert(key(from), (from, to)).is_some() {
            return None;
        }
    }
    let mut loops = Vec::new();
    let mut is_along = true;
    let starts: BTreeMap<Key, ()> = next.keys().map(|&key| (key, ())).collect();
    for start in starts.into_keys() {
        let mut points: Vec<DVec3> = Vec::new();
        let mut at = start;
        while let Some((from, to)) = next.remove(&at) {
            points.push(from);
            at = key(to);
        }
        if points.is_empty() {
            continue;
        }
        let count = points.len();
        let turns = |at: &usize| {
            let (before, here, after) = (points[(at + count - 1) % count], points[*at], points[(at + 1) % count]);
            let (p, q) = (here - before, after - here);
            p.cross(q).length() > STRAIGHT * p.length() * q.length() || p.dot(q) < 0.0
        };
        let mut corners: Vec<Key> = (0..count).filter(turns).map(|at| key(points[at])).collect();
        let least = (0..corners.len()).min_by_key(|&at| corners[at])?;
        corners.rotate_left(least);
        if corners.len() < 3 {
            return None;
        }
        if corners.last() < corners.get(1) {
            corners[1..].reverse();
            // The sense of the loop with the least corner says it of all.
            is_along &= !loops.is_empty();
        }
        loops.push(corners);
    }
    loops.sort_unstable();
    (!loops.is_empty()).then_some((Outline(loops), is_along))
}

/// A number equal for equal outlines.
fn digest(outline: &Outline) -> u64 {
    let corners = outline.0.iter().flatten().flatten();
    corners.fold(0, |hash: u64, &bits| {
        let mixed = (hash ^ bits).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        mixed ^ (mixed >> 29)
    })
}

/// Groups of faces in one place, of two faces and more, each in the order of the scene. Faces of one triangle are not
/// among them: triangles in one place are found by their corners.
pub(super) fn coincident(triangles: &[Triangle]) -> Vec<Vec<Face>> {
    let found = |range: &Range<usize>| outline(&triangles[range.clone()]);
    let mut digests: Vec<(u64, Range<usize>)> = faces(triangles)
        .filter(|face| face.len() > 1)
        .filter_map(|face| Some((digest(&found(&face)?.0), face)))
        .collect();
    digests.sort_unstable_by_key(|(digest, face)| (*digest, face.start));
    let mut groups = Vec::new();
    for same in digests.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        let mut by_outline: BTreeMap<Outline, Vec<Face>> = BTreeMap::new();
        for (_, range) in same {
            if let Some((outline, is_along)) = found(range) {
                let triangles = range.clone();
                by_outline
                    .entry(outline)
                    .or_default()
                    .push(Face { triangles, is_along });
            }
        }
        groups.extend(by_outline.into_values().filter(|group| group.len() > 1));
    }
    groups
}
