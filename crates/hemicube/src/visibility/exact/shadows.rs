//! The factor from eight points at once to the part of a polygon in the shadows of its occluders.
//!
//! An occluder's shadow is a convex cone over its outline. The boundary of the union of all shadows on the polygon is
//! made of arcs: parts of the polygon's edges inside a shadow, and parts of the shadows' edges inside the polygon and
//! outside of all other shadows. On an edge a + s (b − a), 0 ≤ s ≤ 1, each plane of a cone leaves an interval of s. So
//! shadows take intervals and their differences, no polygons, and eight points take the same way through the code.
//! Lambert's term of an arc, with ν the normal of its plane towards the inside and n that of the element, is
//!
//! ```text
//! 1/(2π)  n · ν / |ν|  angle(p, q)
//! ```
//!
//! An edge in a plane of another cone, but for rounding: where both have their insides on the same side, it belongs to
//! the cone with the smaller number; where on opposite sides, as of two walls with a common edge, it belongs to both,
//! and their terms cancel. The polygon's own edges go before all cones'.

use crate::factor::{LANES, angle_portable as angle};
use crate::simd::{InstructionSet, dispatch};
use crate::visibility::bodies::{Body, BodyEdge};
use glam::DVec3;
use std::ops::Range;

type Lane = [f64; LANES];
type Vector = [Lane; 3];

/// Bound of the pieces that other shadows leave of an edge.
const MOST_PIECES: usize = 16;
/// Bound of the polygon's corners.
const MOST_CORNERS: usize = 4;
/// Height of a point in a plane but for rounding, in sizes of the pair; rounding of a volume in their cubes; and the
/// area of an edge and a point, in their squares, below which both are no plane: two corners are one.
const IN_PLANE: f64 = 1e-12;
const ROUNDING: f64 = 2e-15;
const NO_PLANE: f64 = 1e-11;
/// Parameters of an interval without points.
const NOTHING: (f64, f64) = (2.0, -1.0);

/// Side of a plane n · x > `offset`, on which an occluder's edge is or is not one of its outline.
#[derive(Clone, Copy, Debug)]
struct Gate {
    normal: DVec3,
    offset: f64,
    /// The side of the whole cell, if it is on one.
    always: Option<bool>,
}

/// An edge of an occluder from `a` to `b`: of its outline from points in front of one of its gates alone. In front of
/// the first, its shadow is on the left of the edge as seen from there, in front of the second on the right.
#[derive(Clone, Copy, Debug)]
struct OutlineEdge {
    a: DVec3,
    b: DVec3,
    /// Indices in [`Shadows::gates`].
    gates: [usize; 2],
}

/// An edge as seen from eight points.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct SeenEdge {
    a: Vector,
    b: Vector,
    /// Normal of the plane through it, towards the inside; 0 where it is no edge of the outline.
    inwards: Vector,
    /// Length of the normal.
    length: Lane,
    /// Heights above the plane below which points are in it; negative where it is no plane.
    slack: Lane,
}

/// Parts of an edge from eight points.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Interval {
    low: Lane,
    high: Lane,
}

/// The occluders of a cell, and room for what is seen of them.
#[derive(Debug, Default)]
pub(super) struct Shadows {
    /// The polygon, counter-clockwise as seen from the points.
    pub(super) target: Vec<DVec3>,
    gates: Vec<Gate>,
    edges: Vec<OutlineEdge>,
    /// The edges of each occluder.
    pub(super) cones: Vec<Range<usize>>,
    /// Unit normal of the elements.
    pub(super) normal: DVec3,
    /// The greatest distance of the pair's corners from the origin.
    pub(super) size: f64,
    seen: Vec<SeenEdge>,
    is_front: Vec<Lane>,
    /// 1 from points from which a cone has an outline.
    is_cone: Vec<Lane>,
}

impl Shadows {
    /// Forgets the occluders.
    pub(super) fn clear(&mut self) {
        self.gates.clear();
        self.edges.clear();
        self.cones.clear();
    }

    /// Adds the outline of a convex body as seen from a cell.
    pub(super) fn add_body(&mut self, cell: &[DVec3; 3], body: &Body, origin: DVec3) {
        let (first, gate) = (self.edges.len(), self.gates.len());
        for face in &body.faces {
            self.push_gate(cell, face.normal, face.offset - face.normal.dot(origin));
        }
        for &BodyEdge { ends, left, right } in &body.edges {
            self.push_edge(ends.map(|p| p - origin), [gate + left, gate + right]);
        }
        self.cones.push(first..self.edges.len());
    }

    /// Adds a convex polygon as seen from a cell, of one side or of both.
    pub(super) fn add_polygon(&mut self, cell: &[DVec3; 3], corners: &[DVec3], normal: DVec3, of_one_side: bool) {
        let (first, gate) = (self.edges.len(), self.gates.len());
        let offset = normal.dot(corners[0]);
        self.push_gate(cell, normal, offset);
        // Nothing is in front of no normal.
        let sign = if of_one_side { 0.0 } else { -1.0 };
        self.push_gate(cell, normal * sign, offset * sign);
        let mut before = corners[corners.len() - 1];
        for &corner in corners {
            self.push_edge([before, corner], [gate, gate + 1]);
            before = corner;
        }
        self.cones.push(first..self.edges.len());
    }

    fn push_gate(&mut self, cell: &[DVec3; 3], normal: DVec3, offset: f64) {
        let is_front = cell.map(|x| normal.dot(x) > offset);
        let is_one = is_front[0] == is_front[1] && is_front[0] == is_front[2];
        self.gates.push(Gate {
            normal,
            offset,
            always: is_one.then_some(is_front[0]),
        });
    }

    /// Appends an edge unless it is in no outline from anywhere in the cell.
    fn push_edge(&mut self, [a, b]: [DVec3; 2], gates: [usize; 2]) {
        let [left, right] = gates.map(|gate| self.gates[gate].always);
        if left.is_none() || left != right {
            self.edges.push(OutlineEdge { a, b, gates });
        }
    }

    /// The factors from eight points, by coordinate. `None` where shadows leave too many pieces of an edge.
    pub(super) fn factors(&mut self, points: &Vector) -> Option<Lane> {
        let mut out = [0.0; LANES];
        factors_by(InstructionSet::widest(), self, points, &mut out).then_some(out)
    }
}

dispatch! {
    fn factors_by = factors_portable(shadows: &mut Shadows, points: &Vector, out: &mut Lane) -> bool
}

#[inline(always)]
fn select(condition: bool, a: f64, b: f64) -> f64 {
    if condition { a } else { b }
}

#[inline(always)]
fn splat(p: DVec3) -> Vector {
    [[p.x; LANES], [p.y; LANES], [p.z; LANES]]
}

#[inline(always)]
fn minus(p: &Vector, q: &Vector) -> Vector {
    let mut out = *p;
    for k in 0..3 {
        for l in 0..LANES {
            out[k][l] = p[k][l] - q[k][l];
        }
    }
    out
}

#[inline(always)]
fn cross(p: &Vector, q: &Vector) -> Vector {
    let mut out = [[0.0; LANES]; 3];
    for l in 0..LANES {
        out[0][l] = p[1][l] * q[2][l] - p[2][l] * q[1][l];
        out[1][l] = p[2][l] * q[0][l] - p[0][l] * q[2][l];
        out[2][l] = p[0][l] * q[1][l] - p[1][l] * q[0][l];
    }
    out
}

#[inline(always)]
fn dot(p: &Vector, q: &Vector) -> Lane {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] = p[0][l] * q[0][l] + p[1][l] * q[1][l] + p[2][l] * q[2][l];
    }
    out
}

impl Interval {
    const WHOLE: Self = Self {
        low: [0.0; LANES],
        high: [1.0; LANES],
    };

    /// Leaves the part of non-negative height, of heights at both ends.
    #[inline(always)]
    fn narrow(&mut self, at_a: &Lane, at_b: &Lane) {
        for l in 0..LANES {
            let (p, q) = (at_a[l], at_b[l]);
            let difference = p - q;
            let at = p / select(difference != 0.0, difference, 1.0);
            let enters = select(p < 0.0, select(q > 0.0, at, NOTHING.0), 0.0);
            let leaves = select(q < 0.0, select(p > 0.0, at, NOTHING.1), 1.0);
            self.low[l] = select(enters > self.low[l], enters, self.low[l]);
            self.high[l] = select(leaves < self.high[l], leaves, self.high[l]);
        }
    }

    #[inline(always)]
    fn is_empty(&self) -> bool {
        let mut any = false;
        for l in 0..LANES {
            any |= self.high[l] > self.low[l];
        }
        !any
    }
}

/// Which of an edge's coincidences with a cone's plane belong to the cone.
#[derive(Clone, Copy)]
enum Ties {
    /// Those with the inside on the same side.
    Taken,
    /// None.
    Left,
}

/// The part of an edge inside a plane.
#[inline(always)]
fn narrow_by(of: &mut Interval, edge: &SeenEdge, plane: &SeenEdge, ties: Ties) {
    let (mut at_a, mut at_b) = (dot(&plane.inwards, &edge.a), dot(&plane.inwards, &edge.b));
    let same = dot(&plane.inwards, &edge.inwards);
    let taken = match ties {
        Ties::Taken => 1.0,
        Ties::Left => -1.0,
    };
    for l in 0..LANES {
        let slack = plane.slack[l];
        let bias = select(same[l] > 0.0, taken, -1.0) * slack;
        at_a[l] = select(slack > 0.0, at_a[l] + bias, 1.0);
        at_b[l] = select(slack > 0.0, at_b[l] + bias, 1.0);
    }
    of.narrow(&at_a, &at_b);
}

/// The part of an edge inside a cone.
#[inline(always)]
fn inside(edge: &SeenEdge, cone: &[SeenEdge], is_cone: &Lane, ties: Ties) -> Interval {
    let mut part = Interval::WHOLE;
    for l in 0..LANES {
        part.high[l] = select(is_cone[l] > 0.0, 1.0, NOTHING.1);
    }
    for plane in cone {
        narrow_by(&mut part, edge, plane, ties);
        if part.is_empty() {
            break;
        }
    }
    part
}

/// Takes an interval away from pieces of an edge. `None` if they become too many.
#[inline(always)]
fn take_away(pieces: &mut [Interval; MOST_PIECES], count: &mut usize, gone: &Interval) -> bool {
    if gone.is_empty() {
        return true;
    }
    let before = *count;
    let mut kept = 0;
    let mut added = before;
    for k in 0..before {
        let piece = pieces[k];
        let (mut left, mut right) = (piece, piece);
        for l in 0..LANES {
            let is_gone = gone.high[l] > gone.low[l];
            let end = select(gone.low[l] < piece.high[l], gone.low[l], piece.high[l]);
            let start = select(gone.high[l] > piece.low[l], gone.high[l], piece.low[l]);
            left.high[l] = select(is_gone, end, piece.high[l]);
            right.low[l] = select(is_gone, start, NOTHING.0);
        }
        if !left.is_empty() {
            pieces[kept] = left;
            kept += 1;
        }
        if !right.is_empty() {
            if added == MOST_PIECES {
                return false;
            }
            pieces[added] = right;
            added += 1;
        }
    }
    // The right parts move down to the left ones.
    for k in before..added {
        pieces[kept] = pieces[k];
        kept += 1;
    }
    *count = kept;
    true
}

/// Adds the angles of pieces of an edge.
#[inline(always)]
fn add_angles(edge: &SeenEdge, pieces: &[Interval], sum: &mut Lane) {
    let along = minus(&edge.b, &edge.a);
    let (aa, ad, dd) = (dot(&edge.a, &edge.a), dot(&edge.a, &along), dot(&along, &along));
    for piece in pieces {
        for l in 0..LANES {
            let (s, t) = (piece.low[l], piece.high[l]);
            let cosine = aa[l] + (s + t) * ad[l] + s * t * dd[l];
            let found = angle(select(t > s, (t - s) * edge.length[l], 0.0), cosine);
            sum[l] += select(t > s, found, 0.0);
        }
    }
}

/// Adds an edge's angles times n · ν / |ν|.
#[inline(always)]
fn add_term(normal: DVec3, edge: &SeenEdge, angles: &Lane, out: &mut Lane) {
    let along = dot(&splat(normal), &edge.inwards);
    for l in 0..LANES {
        out[l] += angles[l] * along[l] / select(edge.length[l] > 0.0, edge.length[l], 1.0);
    }
}

#[inline(always)]
fn length_of(p: &Vector) -> Lane {
    let mut length = dot(p, p);
    for l in 0..LANES {
        length[l] = length[l].sqrt();
    }
    length
}

/// An edge with the plane through it.
#[inline(always)]
fn seen_edge(a: Vector, b: Vector, inwards: Vector, size: f64) -> SeenEdge {
    let length = length_of(&inwards);
    let mut slack = length;
    for l in 0..LANES {
        let bias = ROUNDING * size * size * size + IN_PLANE * size * length[l];
        slack[l] = select(length[l] > NO_PLANE * size * size, bias, -1.0);
    }
    SeenEdge {
        a,
        b,
        inwards,
        length,
        slack,
    }
}

/// Fills in what the points see of the occluders' edges.
#[inline(always)]
fn see(shadows: &mut Shadows, points: &Vector) {
    shadows.is_front.clear();
    for gate in &shadows.gates {
        let mut height = dot(&splat(gate.normal), points);
        for l in 0..LANES {
            height[l] = select(height[l] > gate.offset, 1.0, 0.0);
        }
        // In a plane but for rounding, all points are on the side that edges were left out by.
        let known = gate.always.map(|is_front| [f64::from(u8::from(is_front)); LANES]);
        shadows.is_front.push(known.unwrap_or(height));
    }
    shadows.seen.clear();
    shadows.is_cone.clear();
    for cone in &shadows.cones {
        let mut count = [0.0; LANES];
        for edge in &shadows.edges[cone.clone()] {
            let (a, b) = (minus(&splat(edge.a), points), minus(&splat(edge.b), points));
            let mut inwards = cross(&a, &b);
            let [left, right] = edge.gates.map(|gate| &shadows.is_front[gate]);
            for l in 0..LANES {
                let sign = right[l] - left[l];
                count[l] += sign * sign;
                for x in &mut inwards {
                    x[l] *= sign;
                }
            }
            shadows.seen.push(seen_edge(a, b, inwards, shadows.size));
        }
        for count in &mut count {
            *count = select(*count >= 3.0, 1.0, 0.0);
        }
        shadows.is_cone.push(count);
    }
}

#[inline(always)]
fn factors_portable(shadows: &mut Shadows, points: &Vector, out: &mut Lane) -> bool {
    see(shadows, points);
    let corners = shadows.target.len().min(MOST_CORNERS);
    let normal = shadows.normal;
    let target: [SeenEdge; MOST_CORNERS] = std::array::from_fn(|k| {
        let (p, q) = (shadows.target[k % corners], shadows.target[(k + 1) % corners]);
        let (a, b) = (minus(&splat(p), points), minus(&splat(q), points));
        seen_edge(a, b, cross(&b, &a), shadows.size)
    });
    let target = &target[..corners];
    let mut pieces = [Interval::WHOLE; MOST_PIECES];
    // The polygon's edges in any of the shadows.
    for edge in target {
        let mut angles = [0.0; LANES];
        let mut before = [Interval::WHOLE; MOST_PIECES];
        let mut found = 0;
        for (cone, is_cone) in shadows.cones.iter().zip(&shadows.is_cone) {
            let part = inside(edge, &shadows.seen[cone.clone()], is_cone, Ties::Taken);
            if part.is_empty() {
                continue;
            }
            pieces[0] = part;
            let mut count = 1;
            for gone in &before[..found] {
                if !take_away(&mut pieces, &mut count, gone) {
                    return false;
                }
            }
            add_angles(edge, &pieces[..count], &mut angles);
            if found == MOST_PIECES {
                return false;
            }
            before[found] = part;
            found += 1;
        }
        if found > 0 {
            add_term(normal, edge, &angles, out);
        }
    }
    // The shadows' edges on the polygon, outside of other shadows.
    for (c, cone) in shadows.cones.iter().enumerate() {
        for edge in &shadows.seen[cone.clone()] {
            let mut part = inside(edge, target, &shadows.is_cone[c], Ties::Left);
            for l in 0..LANES {
                part.high[l] = select(edge.slack[l] > 0.0, part.high[l], NOTHING.1);
            }
            if part.is_empty() {
                continue;
            }
            pieces[0] = part;
            let mut count = 1;
            for (d, other) in shadows.cones.iter().enumerate() {
                if d == c {
                    continue;
                }
                let ties = if d < c { Ties::Taken } else { Ties::Left };
                let gone = inside(edge, &shadows.seen[other.clone()], &shadows.is_cone[d], ties);
                if !take_away(&mut pieces, &mut count, &gone) {
                    return false;
                }
                if count == 0 {
                    break;
                }
            }
            if count > 0 {
                let mut angles = [0.0; LANES];
                add_angles(edge, &pieces[..count], &mut angles);
                add_term(normal, edge, &angles, out);
            }
        }
    }
    for factor in out.iter_mut() {
        let whole = *factor * (0.5 * std::f64::consts::FRAC_1_PI);
        *factor = select(whole > 0.0, whole, 0.0);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Plane, cross};
    use crate::sampling::splitmix;
    use crate::visibility::exact::tests::{BOX_FACES, box_corner};
    use glam::DQuat;

    /// A box: the body, and its faces, counter-clockwise as seen from outside.
    fn solid(low: DVec3, size: DVec3, turn: DQuat) -> (Body, Vec<[DVec3; 4]>) {
        let at = |number: usize| turn * box_corner(low, size, number);
        let quads = BOX_FACES.map(|face| face.map(at)).to_vec();
        let faces = quads.iter().map(|&[a, b, c, _]| {
            let normal = cross(&[a, b, c]).normalize();
            Plane {
                normal,
                offset: normal.dot(a),
            }
        });
        let mut edges = Vec::new();
        for (left, face) in BOX_FACES.iter().enumerate() {
            for k in 0..4 {
                let (a, b) = (face[k], face[(k + 1) % 4]);
                let other = BOX_FACES
                    .iter()
                    .position(|other| (0..4).any(|m| other[m] == b && other[(m + 1) % 4] == a));
                edges.extend(other.filter(|&right| left < right).map(|right| BodyEdge {
                    ends: [at(a), at(b)],
                    left,
                    right,
                }));
            }
        }
        let body = Body {
            faces: faces.collect(),
            edges,
        };
        (body, quads)
    }

    /// From points of a floor on which two boxes stand, apart, side by side, one raised, one moved along: two
    /// silhouettes hide of a wall what all twelve faces do, of one side or of two, whose edges all coincide with
    /// others.
    #[test]
    fn a_body_hides_what_its_faces_do() {
        let p = DVec3::new;
        let mut dice = 1u64;
        let mut draw = |low: f64, high: f64| low + (high - low) * splitmix::unit(splitmix::next(&mut dice));
        let (mut compared, mut hiding) = (0, 0);
        for trial in 0..2000 {
            let turn = if trial % 2 == 0 {
                DQuat::IDENTITY
            } else {
                DQuat::from_axis_angle(p(1., 2., 3.).normalize(), 1.4)
            };
            let from = p(draw(0.0, 5.0), draw(0.0, 1.0), 0.0);
            let cell = [from, from + p(0.5, 0., 0.), from + p(0., 0.5, 0.)].map(|x| turn * x);
            let (left, right, top) = (draw(0.0, 4.0), draw(4.5, 6.0), draw(1.0, 3.0));
            let wall = [p(left, 5., 0.), p(left, 5., top), p(right, 5., top), p(right, 5., 0.)];
            let (width, place) = (draw(0.4, 1.0), draw(0.5, 3.0));
            let kind = trial / 2 % 4;
            let gap = if kind == 0 { draw(0.1, 1.0) } else { 0.0 };
            let (raised, moved) = (f64::from(u8::from(kind == 2)), f64::from(u8::from(kind == 3)));
            let boxes = [
                solid(p(place, 2., 0.), p(width, width, draw(0.5, 2.0)), turn),
                solid(
                    p(place + width + gap, 2. + 0.3 * moved, 0.5 * raised),
                    p(width, width, draw(0.5, 2.0)),
                    turn,
                ),
            ];
            let mut shadows = Shadows {
                target: wall.map(|x| turn * x).to_vec(),
                normal: turn * DVec3::Z,
                size: 5.0,
                ..Shadows::default()
            };
            let mut points = [[0.0; LANES]; 3];
            for l in 0..LANES {
                let (s, t) = (draw(0.0, 0.5), draw(0.0, 0.5));
                let x = cell[0] + (cell[1] - cell[0]) * s + (cell[2] - cell[0]) * t;
                (points[0][l], points[1][l], points[2][l]) = (x.x, x.y, x.z);
            }
            for (body, _) in &boxes {
                shadows.add_body(&cell, body, DVec3::ZERO);
            }
            let bodies = shadows.factors(&points).expect("few pieces");
            for of_one_side in [true, false] {
                shadows.clear();
                for (body, quads) in &boxes {
                    for (quad, face) in quads.iter().zip(&body.faces) {
                        shadows.add_polygon(&cell, quad, face.normal, of_one_side);
                    }
                }
                let faces = shadows.factors(&points).expect("few pieces");
                for (one, other) in bodies.into_iter().zip(faces) {
                    assert!(
                        (one - other).abs() < 1e-12,
                        "trial {trial}: {one} by bodies, {other} by faces"
                    );
                    compared += 1;
                    hiding += usize::from(one > 0.01);
                }
            }
        }
        assert!(hiding > compared / 10, "{hiding} of {compared} hide something");
    }
}
