//! Openings in surfaces: windows, doors and subsurfaces lie in the plane of their wall and are cut out of it, so that
//! no two faces coincide.
//!
//! A wall with openings inside it is cut into triangles with holes, which share the openings' corners to the bit. Where
//! openings touch the wall's edge or each other, reach over it or overlap, the areas do not add up; the wall is then
//! cut into convex pieces beyond the lines of the openings' edges.

#[cfg(feature = "_buildings")]
use crate::bounds::Bounds;
#[cfg(feature = "_buildings")]
pub(crate) use crate::polygon::vector_area;
#[cfg(feature = "_buildings")]
use crate::polygon::{TOO_FEW_CORNERS, judge_cut, judge_lost};
#[cfg(feature = "_buildings")]
use crate::polygon::{Triangulation, triangulate, triangulate_with_holes};
#[cfg(feature = "_buildings")]
use crate::{Error, Fate, Kind, Ledger};
use glam::DVec3;

/// Relative difference of areas that is rounding.
#[cfg(feature = "_buildings")]
const AREA: f64 = 1e-9;
/// Steps of cutting a piece, for each pair of corners.
#[cfg(feature = "_buildings")]
const CUT_STEPS: usize = 16;

/// Turns an opening that is wound against its wall, and records it.
#[cfg(feature = "_buildings")]
pub(crate) fn turn_with(wall: &[DVec3], opening: &mut [DVec3], ledger: &mut Ledger, place: impl FnOnce() -> String) {
    let own = vector_area(opening);
    if own.dot(vector_area(wall)) < 0.0 {
        let kind = Kind {
            fate: Fate::Turned,
            what: "opening wound against its wall, turned with it",
            next: "",
        };
        ledger.lose(kind, 1, Some(0.5 * own.length()), place);
        // The first corner stays the first.
        if let Some(others) = opening.get_mut(1..) {
            others.reverse();
        }
    }
}

/// Cuts a wall with openings into triangles that have its winding.
///
/// # Errors
/// When it has too many corners, alone or with the walls before it.
#[cfg(feature = "_buildings")]
pub(crate) fn cut(
    wall: &[DVec3],
    openings: &[&[DVec3]],
    bounds: &mut Bounds,
    ledger: &mut Ledger,
    place: impl FnOnce() -> String,
) -> Result<Vec<[DVec3; 3]>, Error> {
    let mut corners = wall.to_vec();
    let mut holes = Vec::with_capacity(openings.len());
    for opening in openings {
        holes.push(corners.len());
        corners.extend_from_slice(opening);
    }
    bounds.polygon_with_holes(corners.len(), holes.len())?;
    let mut indices = Vec::new();
    match triangulate_with_holes(&corners, &holes, &mut indices) {
        Triangulation::Done if openings.is_empty() => judge_cut(wall, &indices, ledger, place),
        Triangulation::Done => {}
        // An opening may take all of its wall.
        _ if !openings.is_empty() && wall.len() >= 3 => {}
        Triangulation::TooFewCorners => ledger.lose(TOO_FEW_CORNERS, 1, None, place),
        Triangulation::NoArea => judge_lost(wall, ledger, place),
    }
    let corner = |&index: &u32| corners.get(index as usize).copied().unwrap_or(DVec3::NAN);
    let triangles: Vec<[DVec3; 3]> = indices
        .iter()
        .map(|t| [corner(&t[0]), corner(&t[1]), corner(&t[2])])
        .collect();
    if openings.is_empty() || !corners.iter().all(|corner| corner.is_finite()) {
        return Ok(triangles);
    }
    let area = |polygon: &[DVec3]| vector_area(polygon).length();
    let due = area(wall) - openings.iter().map(|opening| area(opening)).sum::<f64>();
    let found: f64 = triangles.iter().map(|triangle| area(triangle)).sum();
    if (found - due).abs() <= AREA * area(wall) {
        return Ok(triangles);
    }
    ledger.note("wall with an opening at or over its edge, cut into convex pieces");
    convex_pieces(wall, openings, bounds)
}

/// A convex polygon with its bounds.
#[cfg(feature = "_buildings")]
struct Piece {
    corners: Vec<DVec3>,
    least: DVec3,
    most: DVec3,
}

#[cfg(feature = "_buildings")]
impl Piece {
    /// Its bounds are those along the wall: `across` is the axis nearest to the wall's normal, along which an opening
    /// may lie off.
    fn new(corners: Vec<DVec3>, across: usize) -> Self {
        let mut least = corners.iter().fold(DVec3::INFINITY, |least, &corner| least.min(corner));
        let mut most = corners
            .iter()
            .fold(DVec3::NEG_INFINITY, |most, &corner| most.max(corner));
        (least[across], most[across]) = (f64::NEG_INFINITY, f64::INFINITY);
        Self { corners, least, most }
    }

    /// The two may overlap in no part of a plane, if an extent of one ends where the other's begins.
    fn is_apart(&self, other: &Self) -> bool {
        self.least.cmpgt(other.most).any() || other.least.cmpgt(self.most).any()
    }
}

/// The wall less its openings by the lines of their edges.
#[cfg(feature = "_buildings")]
fn convex_pieces(wall: &[DVec3], openings: &[&[DVec3]], bounds: &mut Bounds) -> Result<Vec<[DVec3; 3]>, Error> {
    let triangles = |polygon: &[DVec3]| {
        let mut indices = Vec::new();
        triangulate(polygon, &mut indices);
        let corner = |index: u32| polygon.get(index as usize).copied().unwrap_or(DVec3::NAN);
        indices
            .into_iter()
            .map(move |t: [u32; 3]| t.map(corner).to_vec())
            .collect::<Vec<_>>()
    };
    let convex = |polygon: &[DVec3]| {
        if is_convex(polygon) {
            vec![polygon.to_vec()]
        } else {
            triangles(polygon)
        }
    };
    let normal = vector_area(wall).abs();
    let across = (0..3).fold(0, |most, axis| if normal[axis] > normal[most] { axis } else { most });
    let piece = |corners| Piece::new(corners, across);
    let mut count = 0_u64;
    let mut pieces: Vec<Piece> = convex(wall).into_iter().map(piece).collect();
    let mut next = Vec::new();
    for opening in openings.iter().flat_map(|opening| convex(opening)) {
        let opening = piece(opening);
        let before = pieces.len();
        let mut steps = before as u64;
        for part in pieces.drain(..) {
            if part.is_apart(&opening) {
                next.push(part);
                continue;
            }
            // A corner of either costs some allocations.
            steps += (CUT_STEPS * part.corners.len() * opening.corners.len()) as u64;
            next.extend(outside(&part.corners, &opening.corners).into_iter().map(piece));
        }
        std::mem::swap(&mut pieces, &mut next);
        count += pieces.len().saturating_sub(before) as u64;
        bounds.steps(steps)?;
        bounds.triangles(count, 0)?;
    }
    let fan = |piece: &Piece| {
        let corners = piece.corners.clone();
        (2..corners.len()).map(move |at| [corners[0], corners[at - 1], corners[at]])
    };
    Ok(pieces.iter().flat_map(fan).collect())
}

/// Returns whether no corner of a polygon turns the other way.
#[cfg(feature = "_buildings")]
fn is_convex(polygon: &[DVec3]) -> bool {
    let normal = vector_area(polygon);
    let count = polygon.len();
    (0..count).all(|at| {
        let [a, b, c] = [at, at + 1, at + 2].map(|at| polygon[at % count]);
        (b - a).cross(c - b).dot(normal) >= -AREA * normal.length_squared()
    })
}

/// The part of a convex polygon outside another in its plane, in convex pieces: the lines of the other's edges cut it
/// in turn, and the part beyond each line is a piece.
pub(crate) fn outside(polygon: &[DVec3], hole: &[DVec3]) -> Vec<Vec<DVec3>> {
    let Some(normal) = hole.first().map(|&a| {
        let relative: Vec<DVec3> = hole.iter().map(|&p| p - a).collect();
        relative
            .windows(2)
            .fold(DVec3::ZERO, |sum, edge| sum + edge[0].cross(edge[1]))
    }) else {
        return vec![polygon.to_vec()];
    };
    // Lengths below this are rounding.
    let touch = 1e-12
        * polygon
            .iter()
            .chain(hole)
            .fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
    let mut pieces = Vec::new();
    let mut rest = polygon.to_vec();
    for (at, &a) in hole.iter().enumerate() {
        let b = hole[(at + 1) % hole.len()];
        let Some(outward) = (b - a).cross(normal).try_normalize() else {
            continue;
        };
        let side = |p: DVec3| (p - a).dot(outward);
        let beyond = clip(&rest, side, touch);
        if beyond.len() >= 3 {
            pieces.push(beyond);
        }
        rest = clip(&rest, |p| -side(p), touch);
        if rest.len() < 3 {
            // The two do not overlap.
            return vec![polygon.to_vec()];
        }
    }
    pieces
}

/// The part of a convex polygon where `side` is above 0 (Sutherland & Hodgman 1974); nothing if it is no wider than
/// `touch`.
fn clip(polygon: &[DVec3], side: impl Fn(DVec3) -> f64, touch: f64) -> Vec<DVec3> {
    if !polygon.iter().any(|&p| side(p) > touch) {
        return Vec::new();
    }
    let mut kept = Vec::new();
    for (at, &p) in polygon.iter().enumerate() {
        let q = polygon[(at + 1) % polygon.len()];
        let (d, e) = (side(p), side(q));
        if d >= -touch {
            kept.push(p);
        }
        if (d > touch && e < -touch) || (d < -touch && e > touch) {
            kept.push(p + (q - p) * (d / (d - e)));
        }
    }
    kept
}

#[cfg(all(test, feature = "_buildings"))]
mod tests {
    use super::*;
    use crate::ReadOptions;

    fn rectangle(x: [f64; 2], y: [f64; 2]) -> Vec<DVec3> {
        [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]]
            .map(|[x, y]| DVec3::new(x, 7.0, y))
            .to_vec()
    }

    #[test]
    fn walls_keep_the_area_that_openings_leave() {
        let wall = rectangle([0.0, 4.0], [0.0, 3.0]);
        let mut l_shape = wall.clone();
        l_shape.splice(
            2..3,
            [
                DVec3::new(4.0, 7.0, 1.0),
                DVec3::new(2.0, 7.0, 1.0),
                DVec3::new(2.0, 7.0, 3.0),
            ],
        );
        // A door that is not quite in the plane.
        let mut off = rectangle([1.0, 2.0], [0.0, 2.0]);
        off.iter_mut().for_each(|corner| corner.y += 1e-9);
        let window = |x: [f64; 2], y: [f64; 2]| rectangle(x, y);
        let two = |a, b| vec![a, b];
        for (wall, openings, area, pieces) in [
            (&wall, vec![window([1.0, 2.0], [1.0, 2.0])], 11.0, Some(0)),
            (
                &wall,
                two(window([1.0, 2.0], [1.0, 2.0]), window([2.5, 3.5], [0.5, 2.5])),
                9.0,
                Some(0),
            ),
            (&l_shape, vec![window([0.5, 1.5], [0.5, 2.5])], 6.0, Some(0)),
            // A door, two windows that touch, the whole wall.
            (&wall, vec![window([1.0, 2.0], [0.0, 2.0])], 10.0, None),
            (&wall, vec![off.clone()], 10.0, None),
            (&l_shape, vec![window([0.5, 3.0], [0.0, 0.5])], 6.75, None),
            (
                &wall,
                two(window([1.0, 2.0], [1.0, 2.0]), window([2.0, 3.0], [1.0, 2.0])),
                10.0,
                None,
            ),
            (&wall, vec![wall.clone()], 0.0, None),
            // One over the edge, one over another.
            (&wall, vec![window([3.0, 5.0], [1.0, 2.0])], 11.0, Some(1)),
            (
                &wall,
                two(window([1.0, 3.0], [1.0, 2.0]), window([2.0, 3.0], [1.0, 2.5])),
                9.5,
                Some(1),
            ),
        ] {
            for turned in [false, true] {
                let mut openings = openings.clone();
                if turned {
                    openings.iter_mut().for_each(|opening| opening.reverse());
                }
                let openings: Vec<&[DVec3]> = openings.iter().map(Vec::as_slice).collect();
                let mut bounds = Bounds::new(100, ReadOptions::default());
                let mut ledger = Ledger::default();
                let triangles = cut(wall, &openings, &mut bounds, &mut ledger, String::new).unwrap();
                let vectors = triangles.iter().map(|triangle| 0.5 * vector_area(triangle));
                let normal = vector_area(wall).normalize();
                assert!(
                    (vectors.clone().sum::<DVec3>() - area * normal).length() < 1e-8,
                    "{openings:?}"
                );
                assert!(
                    (vectors.map(DVec3::length).sum::<f64>() - area).abs() < 1e-12,
                    "{openings:?}"
                );
                let cut = ledger.get("wall with an opening at or over its edge, cut into convex pieces");
                assert_eq!(cut, pieces.unwrap_or(cut), "{openings:?}");
            }
        }
    }
}
