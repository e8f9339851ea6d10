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
    /// The planes of each body's faces.
    faces: Vec<Vec<Plane>>,
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
            faces: Vec::new(),
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
            let mut corners = body.iter().flat_map(|&region| regions.corners(region));
            if corners.all(|&p| planes.iter().all(|plane| plane.height(p) <= tolerance)) {
                let number = u32::try_from(found.faces.len()).unwrap_or(NONE);
                body.iter()
                    .for_each(|&region| found.of_region[region as usize] = number);
                found.faces.push(planes);
            }
        }
        found
    }

    /// Returns whether a region is a face of a body that a triangle lies outside of, in front of another face's plane.
    pub(crate) fn is_outside(&self, region: u32, triangle: &[DVec3; 3]) -> bool {
        let body = self.of_region[region as usize];
        body != NONE
            && self.faces[body as usize]
                .iter()
                .any(|plane| triangle.iter().all(|&p| plane.height(p) >= 0.0))
    }
}

fn edges(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    (0..corners.len()).map(|k| (corners[k], corners[(k + 1) % corners.len()]))
}
