//! Cuts planar, possibly concave polygons into triangles by ear clipping (Meisters, *Polygons have ears*, American
//! Mathematical Monthly 82, 1975), with the `earcut` crate.
//!
//! The plane is that of Newell's normal (Sutherland, Sproull & Schumacker 1974),
//!
//! ```text
//! n = Σ (pᵢ − p₀) × (pᵢ₊₁ − p₀)        |n| = twice the area
//! ```
//!
//! and the projection drops the coordinate of the largest component of n. Unlike a rotation into the plane, this keeps
//! coordinates exact, and points on a line stay on it. Everything is relative to the first corner, so that coordinates
//! in the millions cost no digits, and in units of a power of two near the extent.

#[cfg(any(
    feature = "obj",
    feature = "stl",
    feature = "ply",
    feature = "cityjson",
    feature = "_meshes"
))]
use crate::Triangle;
use crate::repair::{Shape, half_difference, power_of_two, relative};
use crate::{Fate, Kind, Ledger};
use earcut::Earcut;
use glam::{DVec2, DVec3};

/// The outcome of cutting a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Triangulation {
    /// It was cut into triangles.
    Done,
    /// It has fewer than three corners: no triangles.
    TooFewCorners,
    /// Its corners lie on a line or a point, or its crossing loops cancel: no triangles.
    NoArea,
}

/// Twice the vector area of a polygon (Newell).
pub(crate) fn vector_area(corners: &[DVec3]) -> DVec3 {
    let Some(&first) = corners.first() else {
        return DVec3::ZERO;
    };
    let cross = |edge: &[DVec3]| (edge[0] - first).cross(edge[1] - first);
    corners.windows(2).map(cross).sum()
}

/// Appends the triangles of a polygon to `out`, as indices into `corners` and with the polygon's winding.
///
/// Passes a triangle on unchanged. Splits a quadrilateral at its first corner, where both triangles get its winding.
/// Leaves out corners repeating the one before. Makes a fan of a polygon with a non-finite corner, for
/// [`crate::repair`] to drop and count.
pub(crate) fn triangulate(corners: &[DVec3], out: &mut Vec<[u32; 3]>) -> Triangulation {
    match corners {
        [] | [_] | [_, _] => return Triangulation::TooFewCorners,
        [_, _, _] => {
            out.push([0, 1, 2]);
            return Triangulation::Done;
        }
        _ => {}
    }
    if !corners.iter().all(|corner| corner.is_finite()) {
        out.extend((1..).zip(2..).take(corners.len() - 2).map(|(i, j)| [0, i, j]));
        return Triangulation::Done;
    }
    if let &[a, b, c, d] = corners
        && let Some(triangles) = split([a, b, c, d])
    {
        out.extend(triangles);
        return Triangulation::Done;
    }

    let kept: Vec<(u32, DVec3)> = distinct(corners);
    match kept.as_slice() {
        [] | [_] | [_, _] => Triangulation::NoArea,
        [(a, p), (b, q), (c, r)] => {
            if Shape::of(&[*p, *q, *r]).is_degenerate() {
                return Triangulation::NoArea;
            }
            out.push([*a, *b, *c]);
            Triangulation::Done
        }
        [(a, p), (b, q), (c, r), (d, s)] => match split([*p, *q, *r, *s]) {
            Some(triangles) => {
                let index = [*a, *b, *c, *d];
                out.extend(triangles.map(|t| t.map(|i| index[i as usize % 4])));
                Triangulation::Done
            }
            None => clip(&kept, &[], out),
        },
        _ => clip(&kept, &[], out),
    }
}

/// Appends the triangles of a polygon with holes, like [`triangulate`]: `corners` has the outline's, then each hole's;
/// `holes` has the index of each hole's first corner. A hole may wind either way.
///
/// A hole without area, or with a non-finite corner, is left out.
#[cfg(any(feature = "cityjson", feature = "_buildings"))]
pub(crate) fn triangulate_with_holes(corners: &[DVec3], holes: &[usize], out: &mut Vec<[u32; 3]>) -> Triangulation {
    let outline = &corners[..holes.first().copied().unwrap_or(corners.len())];
    let mut kept = distinct(outline);
    let mut begins = Vec::new();
    for (at, &begin) in holes.iter().enumerate() {
        let end = holes.get(at + 1).copied().unwrap_or(corners.len());
        let Some(ring) = corners.get(begin..end) else { continue };
        let mut hole = distinct(ring);
        if hole.len() < 3 || !ring.iter().all(|corner| corner.is_finite()) {
            continue;
        }
        #[allow(
            clippy::cast_possible_truncation,
            reason = "`bounds` has polygons of more than 2¹⁶ corners refused"
        )]
        hole.iter_mut().for_each(|corner| corner.0 += begin as u32);
        begins.push(kept.len());
        kept.extend(hole);
    }
    if begins.is_empty() || !outline.iter().all(|corner| corner.is_finite()) {
        return triangulate(outline, out);
    }
    if begins[0] < 3 {
        return Triangulation::NoArea;
    }
    clip(&kept, &begins, out)
}

/// Indices of a face's object and material, and its own.
#[cfg(any(
    feature = "obj",
    feature = "stl",
    feature = "ply",
    feature = "cityjson",
    feature = "_meshes"
))]
#[derive(Clone, Copy, Default)]
pub(crate) struct Labels {
    pub(crate) object: u32,
    pub(crate) material: u32,
    pub(crate) face: u32,
}

/// Relative difference in area between the triangles of a polygon and its outline from which it crosses itself or is
/// far from plane: a corner an eighth of the width off the plane of a square. Smaller ones come of modelling, and
/// their triangles are what the file says; a larger bound would leave out crossings at the edge.
const AREA_EXCESS_MAX: f64 = 1e-2;

/// Area, by the extent squared, up to which a polygon without a front has none.
const NO_AREA: f64 = 1e-6;

/// A polygon whose corners lie on a line, or nearly: one corner far off makes such a needle of a face with area.
const WITHOUT_AREA: Kind<'static> = Kind {
    fate: Fate::LeftOut,
    what: "face without area",
    next: "",
};

/// A face of one corner or two: what was to be a surface is none.
pub(crate) const TOO_FEW_CORNERS: Kind<'static> = Kind {
    fate: Fate::LeftOut,
    what: "face with fewer than 3 corners",
    next: "",
};

/// Judges the triangles of a polygon of more than three corners by their area.
pub(crate) fn judge_cut(corners: &[DVec3], cut: &[[u32; 3]], ledger: &mut Ledger, place: impl FnOnce() -> String) {
    if corners.len() < 4 || !corners.iter().all(|corner| corner.is_finite()) {
        return;
    }
    if area_excess(corners, cut).abs() > AREA_EXCESS_MAX {
        let kind = Kind {
            fate: Fate::Approximated,
            what: "face that crosses itself or is far from plane, cut into triangles",
            next: "cut it into triangles in the modeller",
        };
        ledger.lose(kind, 1, Some(0.5 * vector_area(corners).length()), place);
    }
}

/// Records a polygon without area: on a line or a point, or with crossing loops that cancel.
pub(crate) fn judge_lost(corners: &[DVec3], ledger: &mut Ledger, place: impl FnOnce() -> String) {
    let origin = corners.first().copied().unwrap_or_default();
    let extent = corners.iter().map(|corner| corner.distance(origin)).fold(0.0, f64::max);
    let twice = |edge: &[DVec3]| (edge[0] - origin).cross(edge[1] - origin).length();
    let area = 0.5 * corners.windows(2).map(twice).sum::<f64>();
    if area > NO_AREA * extent * extent {
        let kind = Kind {
            fate: Fate::LeftOut,
            what: "face that crosses itself and has no front",
            next: "mend the order of its corners",
        };
        ledger.lose(kind, 1, Some(area), place);
    } else {
        ledger.lose(WITHOUT_AREA, 1, Some(area), place);
    }
}

/// Cuts a face into triangles, as `cut`; records faces that have none, or another area than their outline.
#[cfg(any(
    feature = "obj",
    feature = "stl",
    feature = "ply",
    feature = "ac3d",
    feature = "_meshes"
))]
pub(crate) fn cut_face(
    corners: &[DVec3],
    cut: &mut Vec<[u32; 3]>,
    ledger: &mut Ledger,
    place: impl FnOnce() -> String,
) {
    cut.clear();
    match triangulate(corners, cut) {
        Triangulation::Done => judge_cut(corners, cut, ledger, place),
        Triangulation::TooFewCorners => ledger.lose(TOO_FEW_CORNERS, 1, None, place),
        Triangulation::NoArea => judge_lost(corners, ledger, place),
    }
}

/// Appends the triangles of a face to a scene's.
#[cfg(any(
    feature = "obj",
    feature = "stl",
    feature = "ply",
    feature = "cityjson",
    feature = "_meshes"
))]
pub(crate) fn push_triangles(corners: &[DVec3], cut: &[[u32; 3]], labels: Labels, out: &mut Vec<Triangle>) {
    out.extend(cut.iter().map(|triangle| Triangle {
        corners: triangle.map(|i| corners.get(i as usize).copied().unwrap_or(DVec3::NAN)),
        object: labels.object,
        material: labels.material,
        face: labels.face,
        two_sided: false,
    }));
}

/// The corners without repetitions of the one before; the first follows the last.
fn distinct(corners: &[DVec3]) -> Vec<(u32, DVec3)> {
    let mut kept: Vec<(u32, DVec3)> = (0..).zip(corners.iter().copied()).collect();
    kept.dedup_by(|next, before| next.1 == before.1);
    while let [first, _, .., last] = kept.as_slice()
        && first.1 == last.1
    {
        kept.pop();
    }
    kept
}

/// Splits a quadrilateral along the diagonal from its first corner, or else along the other: the first to give two
/// triangles that are not degenerate and have its winding. Gives none where the quadrilateral crosses itself.
fn split(corners: [DVec3; 4]) -> Option<[[u32; 3]; 2]> {
    let [a, b, c, d] = corners;
    let (_, [u, v, w]) = relative(a, [b, c, d]);
    let normal = u.cross(v) + v.cross(w);
    let sound =
        |i: [usize; 3], cross: DVec3| cross.dot(normal) > 0.0 && !Shape::of(&i.map(|i| corners[i])).is_degenerate();
    if sound([0, 1, 2], u.cross(v)) && sound([0, 2, 3], v.cross(w)) {
        return Some([[0, 1, 2], [0, 2, 3]]);
    }
    if sound([1, 2, 3], (v - u).cross(w - u)) && sound([1, 3, 0], (w - u).cross(-u)) {
        return Some([[1, 2, 3], [1, 3, 0]]);
    }
    None
}

/// Twice the vector area of a polygon given relative to its first corner.
fn newell(points: &[DVec3]) -> DVec3 {
    points.windows(2).fold(DVec3::ZERO, |sum, edge| match edge {
        &[p, q] => sum + p.cross(q),
        _ => sum,
    })
}

/// Ear clipping of an outline and, from each of `holes` on, its holes.
fn clip(kept: &[(u32, DVec3)], holes: &[usize], out: &mut Vec<[u32; 3]>) -> Triangulation {
    let Some(&(_, origin)) = kept.first() else {
        return Triangulation::NoArea;
    };
    let mut points: Vec<DVec3> = kept.iter().map(|&(_, p)| half_difference(p, origin)).collect();
    let extent = points.iter().fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
    let unit = power_of_two(extent);
    for p in &mut points {
        *p /= unit;
    }
    let normal = newell(&points[..holes.first().copied().unwrap_or(points.len())]);
    let largest = kept.iter().fold(0.0_f64, |m, (_, p)| m.max(p.abs().max_element()));
    let reach = points.iter().fold(0.0_f64, |m, p| m.max(p.length()));
    // `repair`'s rule for degenerate triangles, with the reach from the first corner as the longest edge.
    if normal.length() <= reach * (1e-12 * reach).max(4.0 * f64::EPSILON * (0.5 * largest / unit)) {
        return Triangulation::NoArea;
    }

    let project = projection(normal);
    let flat: Vec<[f64; 2]> = points.iter().map(|&p| project(p).to_array()).collect();
    let mut ears: Vec<u32> = Vec::new();
    #[allow(
        clippy::cast_possible_truncation,
        reason = "`bounds` has polygons of more than 2¹⁶ corners refused"
    )]
    let holes: Vec<u32> = holes.iter().map(|&at| at as u32).collect();
    Earcut::new().earcut_slice(&flat, &holes, &mut ears);
    let before = out.len();
    for ear in ears.as_chunks().0 {
        if let [Some(&(a, _)), Some(&(b, _)), Some(&(c, _))] = ear.map(|i: u32| kept.get(i as usize)) {
            out.push([a, b, c]);
        }
    }
    if out.len() == before {
        Triangulation::NoArea
    } else {
        Triangulation::Done
    }
}

/// The projection along an axis that keeps the winding for `earcut`.
fn projection(normal: DVec3) -> fn(DVec3) -> DVec2 {
    let size = normal.abs();
    if size.z >= size.x && size.z >= size.y {
        if normal.z > 0.0 {
            |p| DVec2::new(p.x, p.y)
        } else {
            |p| DVec2::new(p.y, p.x)
        }
    } else if size.x >= size.y {
        if normal.x > 0.0 {
            |p| DVec2::new(p.y, p.z)
        } else {
            |p| DVec2::new(p.z, p.y)
        }
    } else if normal.y > 0.0 {
        |p| DVec2::new(p.z, p.x)
    } else {
        |p| DVec2::new(p.x, p.z)
    }
}

/// Excess of the summed area of a polygon's triangles over that of its outline, relative to the latter. Above rounding
/// for a polygon that is not planar or crosses itself.
pub(crate) fn area_excess(corners: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let Some(&origin) = corners.first() else { return 0.0 };
    let halves = corners.iter().map(|&p| half_difference(p, origin));
    let unit = power_of_two(halves.fold(0.0_f64, |m, p| m.max(p.abs().max_element())));
    let at = |p: &DVec3| half_difference(*p, origin) / unit;
    let outline = corners.windows(2).fold(DVec3::ZERO, |sum, edge| match edge {
        [p, q] => sum + at(p).cross(at(q)),
        _ => sum,
    });
    let sum: f64 = triangles
        .iter()
        .filter_map(|t| match t.map(|i| corners.get(i as usize)) {
            [Some(a), Some(b), Some(c)] => Some((at(b) - at(a)).cross(at(c) - at(a)).length()),
            _ => None,
        })
        .sum();
    sum / outline.length() - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cut(corners: &[DVec3]) -> (Triangulation, Vec<[u32; 3]>) {
        let mut out = Vec::new();
        let outcome = triangulate(corners, &mut out);
        (outcome, out)
    }

    fn flat(corners: &[[f64; 2]]) -> Vec<DVec3> {
        corners.iter().map(|&[x, y]| DVec3::new(x, y, 0.0)).collect()
    }

    /// Summed area of the triangles, and twice their summed vector area.
    fn sums(corners: &[DVec3], triangles: &[[u32; 3]]) -> (f64, DVec3) {
        triangles.iter().fold((0.0, DVec3::ZERO), |(area, sum), t| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            let normal = (b - a).cross(c - a);
            (area + 0.5 * normal.length(), sum + normal)
        })
    }

    fn fan(count: usize) -> Vec<[u32; 3]> {
        (1..).take(count - 2).map(|i| [0, i, i + 1]).collect()
    }

    /// An L of area 3, a U of area 5, and a comb that is concave many times.
    fn concave() -> Vec<(Vec<DVec3>, f64)> {
        let teeth = 40;
        let mut comb = vec![[0.0, 0.0], [f64::from(teeth), 0.0]];
        for i in (0..teeth).rev() {
            comb.extend([
                [f64::from(i) + 1.0, 2.0],
                [f64::from(i) + 0.5, 0.5],
                [f64::from(i), 2.0],
            ]);
        }
        comb.dedup();
        vec![
            (flat(&[[2., 1.], [1., 1.], [1., 2.], [0., 2.], [0., 0.], [2., 0.]]), 3.0),
            (
                flat(&[
                    [0., 0.],
                    [3., 0.],
                    [3., 2.],
                    [2., 2.],
                    [2., 1.],
                    [1., 1.],
                    [1., 2.],
                    [0., 2.],
                ]),
                5.0,
            ),
            (flat(&comb), f64::from(teeth) * 1.25),
        ]
    }

    #[test]
    fn concave_polygons_keep_area_and_winding_in_every_coordinate_plane() {
        type Turn = fn(DVec3) -> DVec3;
        let turns: [Turn; 6] = [
            |p| p,
            |p| DVec3::new(p.y, p.x, 0.0),
            |p| DVec3::new(0.0, p.x, p.y),
            |p| DVec3::new(0.0, p.y, p.x),
            |p| DVec3::new(p.y, 0.0, p.x),
            |p| DVec3::new(p.x, 0.0, p.y),
        ];
        for (polygon, area) in concave() {
            for turn in turns {
                let mut corners: Vec<DVec3> = polygon.iter().map(|&p| turn(p)).collect();
                for _ in 0..2 {
                    let (outcome, triangles) = cut(&corners);
                    assert_eq!(outcome, Triangulation::Done);
                    let normal = newell(&corners.iter().map(|&p| p - corners[0]).collect::<Vec<_>>());
                    let (sum, vector) = sums(&corners, &triangles);
                    assert!((sum - area).abs() < 1e-12 * area, "{sum} for {area}");
                    assert!((vector - normal).length() < 1e-12 * area);
                    assert!(area_excess(&corners, &triangles).abs() < 1e-12);
                    // The fan that this replaces is told apart.
                    assert!(area_excess(&corners, &fan(corners.len())) > 0.01);
                    corners.reverse();
                }
            }
        }
    }

    #[test]
    fn quadrilaterals() {
        let square = flat(&[[0., 0.], [1., 0.], [1., 1.], [0., 1.]]);
        assert_eq!(cut(&square), (Triangulation::Done, vec![[0, 1, 2], [0, 2, 3]]));
        // Concave at each corner in turn: always along the diagonal that lies inside.
        let mut dart = flat(&[[0., 0.], [2., -1.], [0., 2.], [-2., -1.]]);
        for reflex in [0, 3, 2, 1] {
            let (outcome, triangles) = cut(&dart);
            assert_eq!(outcome, Triangulation::Done);
            assert_eq!(triangles.len(), 2);
            assert!(triangles.iter().all(|t| t.contains(&reflex)), "{triangles:?}");
            assert!((sums(&dart, &triangles).0 - 4.0).abs() < 1e-12);
            dart.rotate_left(1);
        }
        // A corner on the diagonal from the first: split along the other.
        let pointless = flat(&[[0., 0.], [1., 0.], [2., 0.], [0., 1.]]);
        assert_eq!(cut(&pointless).1, [[1, 2, 3], [1, 3, 0]]);
        // Not planar, as a wall of the measured Cornell box: split at the first corner, counted as not planar.
        let wall = [
            DVec3::new(552.8, 0.0, 0.0),
            DVec3::new(549.6, 0.0, 559.2),
            DVec3::new(556.0, 548.8, 559.2),
            DVec3::new(556.0, 548.8, 0.0),
        ];
        let (_, triangles) = cut(&wall);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
        assert!(area_excess(&wall, &triangles) > 1e-6);
    }

    #[test]
    fn repeated_corners_are_left_out() {
        let [a, b, c, d] = [[0., 0.], [1., 0.], [1., 1.], [0., 1.]];
        for corners in [
            vec![a, b, b, c, d],
            vec![a, a, a, b, c, d],
            vec![a, b, c, d, a],
            vec![a, b, c, c, d, d, a, a],
        ] {
            let corners = flat(&corners);
            let (outcome, triangles) = cut(&corners);
            assert_eq!((outcome, triangles.len()), (Triangulation::Done, 2), "{corners:?}");
            assert_eq!(sums(&corners, &triangles).0, 1.0);
        }
        assert_eq!(cut(&flat(&[a, b, c, c])), (Triangulation::Done, vec![[0, 1, 2]]));
        // A hole that a seam joins to the outline: corners repeat, but not one after the other.
        let ring = flat(&[
            [0., 0.],
            [4., 0.],
            [4., 4.],
            [0., 4.],
            [0., 0.],
            [1., 1.],
            [1., 3.],
            [3., 3.],
            [3., 1.],
            [1., 1.],
        ]);
        let (outcome, triangles) = cut(&ring);
        assert_eq!(outcome, Triangulation::Done);
        assert_eq!(sums(&ring, &triangles).0, 12.0);
    }

    #[test]
    fn polygons_without_area_give_nothing() {
        let point = [1.0, 2.0];
        for corners in [
            vec![point; 4],
            vec![[0., 0.], [1., 0.], [2., 0.], [3., 0.]],
            vec![[0., 0.], [1., 0.], [0., 0.], [1., 0.]],
            vec![[0., 0.], [1., 1.], [2., 2.], [1., 1.], [0., 0.]],
            // A bow tie whose loops cancel has no front.
            vec![[0., 0.], [1., 1.], [1., 0.], [0., 1.]],
        ] {
            assert_eq!(cut(&flat(&corners)), (Triangulation::NoArea, vec![]), "{corners:?}");
        }
        // Level to within the rounding of its coordinates.
        let line: Vec<DVec3> = (0..5)
            .map(|i| DVec3::new(1e7 + f64::from(i), 1e-9 * f64::from(i % 2), 0.0))
            .collect();
        assert_eq!(cut(&line), (Triangulation::NoArea, vec![]));
        assert_eq!(cut(&[]), (Triangulation::TooFewCorners, vec![]));
        assert_eq!(cut(&flat(&[point, [0., 0.]])), (Triangulation::TooFewCorners, vec![]));
        // A triangle is for `repair` to judge.
        assert_eq!(cut(&flat(&[point; 3])), (Triangulation::Done, vec![[0, 1, 2]]));
    }

    #[test]
    fn corners_that_are_not_finite_give_a_fan() {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let corners = flat(&[[0., 0.], [1., 0.], [1., x], [0., 1.], [0., 0.5]]);
            assert_eq!(cut(&corners), (Triangulation::Done, fan(5)));
        }
    }

    #[test]
    fn extremes_of_scale() {
        for (polygon, area) in concave() {
            let expected = cut(&polygon).1;
            // Powers of two change no digit, so the triangles are the same ones.
            for exponent in [-1000, -600, -300, 300, 600, 1000] {
                let scale = 2.0_f64.powi(exponent);
                let corners: Vec<DVec3> = polygon.iter().map(|&p| p * scale).collect();
                let (outcome, triangles) = cut(&corners);
                assert_eq!((outcome, &triangles), (Triangulation::Done, &expected), "2^{exponent}");
                assert!(area_excess(&corners, &triangles).abs() < 1e-12);
            }
            let far: Vec<DVec3> = polygon
                .iter()
                .map(|&p| p + DVec3::splat((1_u64 << 33) as f64))
                .collect();
            assert_eq!(cut(&far).1, expected);
            assert!((sums(&far, &expected).0 - area).abs() < 1e-9);
        }
        let huge = flat(&[
            [-f64::MAX, -f64::MAX],
            [f64::MAX, -f64::MAX],
            [f64::MAX, f64::MAX],
            [0., 0.],
            [-1., f64::MAX],
        ]);
        assert_eq!(cut(&huge).0, Triangulation::Done);
    }

    #[test]
    fn a_polygon_of_many_corners_takes_no_minutes() {
        // Two rings of corners in turn: half of them reflex.
        let count = 20_000;
        let corners: Vec<DVec3> = (0..count)
            .map(|i| {
                let (sin, cos) = (f64::from(i) / f64::from(count) * std::f64::consts::TAU).sin_cos();
                let radius = 1.0 + 0.3 * f64::from(i % 2);
                DVec3::new(radius * cos, radius * sin, 0.0)
            })
            .collect();
        let start = std::time::Instant::now();
        let (outcome, triangles) = cut(&corners);
        assert_eq!((outcome, triangles.len()), (Triangulation::Done, count as usize - 2));
        assert!(area_excess(&corners, &triangles).abs() < 1e-9);
        assert!(
            start.elapsed() < std::time::Duration::from_secs(20),
            "{:?}",
            start.elapsed()
        );
    }

    /// A star-shaped polygon in a plane of any tilt, far from the origin.
    fn star() -> impl Strategy<Value = Vec<DVec3>> {
        let axis = prop::array::uniform3(-1.0..1.0_f64).prop_map(DVec3::from_array);
        let axis = axis.prop_filter("a direction", |v| v.length() > 0.1);
        let offset = prop::array::uniform3(-1e7..1e7_f64).prop_map(DVec3::from_array);
        (axis, offset, prop::collection::vec(0.2..5.0_f64, 5..150)).prop_map(|(axis, offset, radii)| {
            let (u, v) = axis.normalize().any_orthonormal_pair();
            let count = radii.len() as f64;
            (0..)
                .zip(radii)
                .map(|(i, radius)| {
                    let (sin, cos) = (f64::from(i) / count * std::f64::consts::TAU).sin_cos();
                    offset + u * (radius * cos) + v * (radius * sin)
                })
                .collect()
        })
    }

    proptest! {
        #[test]
        fn stars_keep_area_and_winding(corners in star()) {
            let (outcome, triangles) = cut(&corners);
            prop_assert_eq!(outcome, Triangulation::Done);
            prop_assert_eq!(triangles.len(), corners.len() - 2);
            let normal = newell(&corners.iter().map(|&p| p - corners[0]).collect::<Vec<_>>());
            let (area, vector) = sums(&corners, &triangles);
            // Coordinates of 10⁷ are known to 2⁻³⁰; an outline of up to 1,500 units long sweeps that.
            prop_assert!((area - 0.5 * normal.length()).abs() < 2e-5, "{} for {}", area, 0.5 * normal.length());
            prop_assert!((vector - normal).length() < 1e-6 * normal.length());
            // Each corner is used: none was taken for one on a line.
            let mut used: Vec<u32> = triangles.into_flattened();
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), corners.len());
        }

        #[test]
        fn any_corners_at_all(corners in prop::collection::vec(prop::array::uniform3(any::<f64>()), 0..30)) {
            let corners: Vec<DVec3> = corners.into_iter().map(DVec3::from_array).collect();
            check_indices(&corners)?;
        }

        #[test]
        fn corners_on_a_coarse_grid(corners in prop::collection::vec(prop::array::uniform3(0..3_i8), 0..30)) {
            let corners: Vec<DVec3> = corners.into_iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
            check_indices(&corners)?;
        }
    }

    fn check_indices(corners: &[DVec3]) -> Result<(), TestCaseError> {
        let (outcome, triangles) = cut(corners);
        prop_assert_eq!(outcome == Triangulation::Done, !triangles.is_empty());
        prop_assert!(triangles.as_flattened().iter().all(|&i| (i as usize) < corners.len()));
        prop_assert!(triangles.len() <= corners.len());
        Ok(())
    }
}
