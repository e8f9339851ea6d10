//! Parent triangles by [`Geometry::cuts`], and of other surfaces by their patches: consecutive ones in the rows of a
//! lattice, as `hemicube_scene::Subdivision` cuts them, with shared corners equal to the bit.

use super::{OFF, ParentTriangles};
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{Geometry, Surface};

/// Least number of patches a parent, on average: with fewer, the second step is not worth it.
const LEAST_PATCHES: usize = 4;
/// The finest subdivision drawn by parents: pieces of an edge.
const MOST_PIECES: usize = 256;

impl ParentTriangles {
    /// Finds the parent triangles of a scene; `None` if too little of it was subdivided.
    pub(crate) fn find(geometry: &Geometry) -> Option<Self> {
        let surfaces = in_order(geometry)?;
        let off = OFF * geometry.plane_tolerance;
        let mut cuts = (geometry.cuts().iter())
            .map(|cut| (cut.first, cut.pieces as usize))
            .filter(|&(_, pieces)| pieces <= MOST_PIECES)
            .peekable();
        let mut found = Vec::new();
        let mut at = 0;
        while at < surfaces.len() {
            let is_here = |&(first, pieces): &(InputPatch, usize)| {
                first == surfaces[at].front && pieces * pieces <= surfaces.len() - at
            };
            let pieces = match cuts.next_if(is_here) {
                Some((_, pieces)) => pieces,
                None => pieces_from(&surfaces[at..], off),
            };
            found.push((parent(&surfaces[at..], pieces), pieces));
            at += pieces * pieces;
        }
        (found.len() * LEAST_PATCHES <= surfaces.len()).then(|| Self::new(geometry, &found))
    }
}

/// Sorts a scene's surfaces by their patches; `None` if patches are not numbered surface by surface.
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

/// The parent of the first `pieces`² surfaces.
fn parent(surfaces: &[&Surface], pieces: usize) -> Surface {
    // The end of the first row, and the last piece of all.
    let (end, last) = (surfaces[2 * (pieces - 1)], surfaces[pieces * pieces - 1]);
    Surface {
        corners: [surfaces[0].corners[0], end.corners[1], last.corners[2]],
        ..*surfaces[0]
    }
}

/// Number of pieces that the edges of the first surface's parent are cut into; 1 if it was not subdivided.
fn pieces_from(surfaces: &[&Surface], off: f64) -> usize {
    let pieces = first_row(surfaces);
    if pieces > 1 && surfaces.len() >= pieces * pieces && is_subdivision(&surfaces[..pieces * pieces], pieces, off) {
        pieces
    } else {
        1
    }
}

/// Number of patches in the first row with the parent's orientation. Between two of them lies one turned over.
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

/// Returns true if surfaces are the patches of one triangle.
fn is_subdivision(surfaces: &[&Surface], pieces: usize, off: f64) -> bool {
    let Surface {
        corners: [a, b, c],
        back,
        ..
    } = parent(surfaces, pieces);
    let step = 1.0 / pieces as f64;
    // Check the corners of the row's lower side: each at its place in the parent, and the same in all patches that
    // share it.
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
