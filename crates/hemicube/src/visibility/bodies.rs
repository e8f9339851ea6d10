//! Convex closed bodies: what they hide is what their faces towards the viewer hide.
//!
//! A ray from outside enters such a body through a face that it sees the front of. So from there the other faces need
//! not be looked at, nor the edges between them.

use crate::geometry::{Plane, cross};
use crate::visibility::coplanar::CoplanarRegions;
use glam::DVec3;
use std::collections::HashMap;

/// In place of a body.
const NONE: u32 = u32::MAX;
/// Bound of the faces of a body: whether it is convex takes the faces times the corners.
const MOST_FACES: usize = 64;

/// The convex closed bodies of a scene.
#[derive(Debug)]
pub(crate) struct Bodies {
    of_region: Vec<u32>,
    bodies: Vec<Body>,
    /// Distance up to which a point is in a plane.
    tolerance: f64,
}

/// A convex closed body.
#[derive(Debug)]
pub(crate) struct Body {
    /// The planes of its faces.
    pub(crate) faces: Vec<Plane>,
    pub(crate) edges: Vec<BodyEdge>,
}

/// An edge of a body, counter-clockwise about one face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BodyEdge {
    pub(crate) ends: [DVec3; 2],
    /// Indices of that face and of the other one.
    pub(crate) left: usize,
    pub(crate) right: usize,
}

impl Bodies {
    /// Finds regions that share each edge with one other, the other way round, and lie behind each other's planes.
    pub(crate) fn new(regions: &CoplanarRegions) -> Self {
        let tolerance = regions.tree.plane_tolerance;
        let bits = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
        let mut along: HashMap<[[u64; 3]; 2], Option<u32>> = HashMap::new();
        for region in 0..regions.len() {
            for (a, b) in edges(regions.corners(region)) {
                along
                    .entry([bits(a), bits(b)])
                    .and_modify(|of| *of = None)
                    .or_insert(Some(region));
            }
        }
        let mut found = Self {
            of_region: vec![NONE; regions.len() as usize],
            bodies: Vec::new(),
            tolerance,
        };
        let mut taken = vec![false; regions.len() as usize];
        for seed in 0..regions.len() {
            if std::mem::replace(&mut taken[seed as usize], true) {
                continue;
            }
            let (mut body, mut at, mut is_closed) = (vec![seed], 0, true);
            while at < body.len() {
                for (a, b) in edges(regions.corners(body[at])) {
                    let is_single = along.get(&[bits(a), bits(b)]).is_some_and(Option::is_some);
                    let Some(&Some(next)) = along.get(&[bits(b), bits(a)]).filter(|_| is_single) else {
                        is_closed = false;
                        continue;
                    };
                    if !std::mem::replace(&mut taken[next as usize], true) {
                        body.push(next);
                    }
                }
                at += 1;
            }
            if !is_closed || body.len() < 4 || body.len() > MOST_FACES {
                continue;
            }
            let planes: Vec<Plane> = body
                .iter()
                .map(|&region| {
                    let corners = regions.corners(region);
                    let normal = cross(&[corners[0], corners[1], corners[2]]).normalize_or_zero();
                    let offset = normal.dot(corners[0]);
                    Plane { normal, offset }
                })
                .collect();
            let uneven = body
                .iter()
                .map(|&region| regions.unevenness(region))
                .fold(0.0, f64::max);
            let tolerance = tolerance + 2.0 * uneven;
            let mut corners = body.iter().flat_map(|&region| regions.corners(region));
            if corners.all(|&p| planes.iter().all(|plane| plane.height(p) <= tolerance)) {
                let number = u32::try_from(found.bodies.len()).unwrap_or(NONE);
                body.iter()
                    .for_each(|&region| found.of_region[region as usize] = number);
                let mut edges_of_body = Vec::new();
                for (left, &region) in body.iter().enumerate() {
                    for (a, b) in edges(regions.corners(region)) {
                        let other = along.get(&[bits(b), bits(a)]).copied().flatten();
                        let right = body.iter().position(|&face| Some(face) == other);
                        edges_of_body.extend(right.filter(|&right| left < right).map(|right| BodyEdge {
                            ends: [a, b],
                            left,
                            right,
                        }));
                    }
                }
                found.bodies.push(Body {
                    faces: planes,
                    edges: edges_of_body,
                });
            }
        }
        found
    }

    /// Returns whether a region is a face of a body that a triangle lies outside of, in front of another face's plane.
    /// In that plane it may lie under the body.
    pub(crate) fn is_outside(&self, region: u32, triangle: &[DVec3; 3]) -> bool {
        self.of(region).is_some_and(|body| {
            self.get(body).faces.iter().any(|plane| {
                let heights = triangle.map(|p| plane.height(p));
                heights.iter().all(|&h| h >= 0.0) && heights.iter().any(|&h| h > self.tolerance)
            })
        })
    }

    /// The number of the body that a region is a face of.
    pub(crate) fn of(&self, region: u32) -> Option<u32> {
        Some(self.of_region[region as usize]).filter(|&body| body != NONE)
    }

    pub(crate) fn get(&self, body: u32) -> &Body {
        &self.bodies[body as usize]
    }
}

fn edges(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    (0..corners.len()).map(|k| (corners[k], corners[(k + 1) % corners.len()]))
}
