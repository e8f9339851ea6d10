//! The blocked part of a pair's exchange area to a bound of its error, however small: cells cut along critical lines.
//!
//! ```text
//! A_i F_ij = E − ∫_outer B(x) dx,   B(x) = −1/(2π) Σ_edges n · (p × q) / |p × q| · angle(p, q)
//! ```
//!
//! E is the unoccluded exchange area, in closed form, B(x) the factor from x of the part of the inner triangle in the
//! shadows of its occluders (Lambert 1760). So what is singular where the two triangles touch is in E, not in the
//! integral.
//!
//! B is analytic but on critical lines: there a corner of one shape passes an edge of another, seen from x, in a plane
//! through both (EV events; Heckbert 1992, Drettakis & Fiume 1994). Across such a line B has a kink in its second
//! derivative, in its first one where edges are parallel, and a step where an occluder stands on the outer triangle.
//! Cells are integrated by Radon's seven points of degree 5, and by nineteen of degree 8 that hold these seven (Laurie
//! 1982). A cell's error is the difference of the two, more where they agree and three other null rules do not, and
//! more where a critical line crosses it. The cell with the largest error is cut along the critical line that divides
//! it most evenly, or in halves where none does, until all errors together are small enough.
//!
//! Places where three edges pass each other (EEE events) are curved; they are left to the halving. Where one cuts off a
//! corner of a cell, none of the nineteen points may lie beyond it. So B is taken near the corners, too, and held
//! against the polynomial through the nineteen.
//!
//! No arrangement of all critical lines from the start, because a pair between two boxes has a hundred of them, and
//! thousands of cells, of which a few hold all of the error.

use super::shadows::Shadows;
use super::{Effect, MOST_OCCLUDERS, Occluder, Polygon, ROUNDING, Sides};
use crate::factor::{
    EdgeTerms, Fitted, LANES, RULES, contour, corner_points, corner_rules, nineteen, null_rules, point_to_polygon,
};
use crate::geometry::{self, crossing, in_front};
use crate::visibility::bodies::{Bodies, BodyEdge};
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::shaft::{Shaft, TrianglePair};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;
use std::sync::OnceLock;

/// Bound of the shadows' pieces from one point.
const MOST_PIECES: usize = 200;
/// Bound of a piece's corners: eight, and one more for each plane of a cone.
const MOST_CORNERS: usize = 20;
/// Pieces with more corners are cut in two.
const MANY: usize = 8;
/// Bound of the occluders among which lines of an edge of one and a corner of another are sought: in a room of 300
/// triangles 0.3 % of the pairs have more than twelve, and none more than 24.
const MOST_CROSSED: usize = 24;
/// Bound of the critical lines of a pair.
const MOST_LINES: usize = 8_000;
/// Share of a cell beyond a line that was not sought, where two occluders or more matter to it.
const UNSOUGHT: f64 = LEAST_SHARE;
/// Distance in the outer plane, in parts of the pair's extent, up to which a line passes beside a cell.
const BESIDE: f64 = 1e-10;
/// Share of a cell's area below which the part beyond a line is not worth a cut.
const LEAST_SHARE: f64 = 0.02;
/// Mean distance from a line over a part of a cell beyond it, in parts of the greatest one: 1/3 over a triangle, 1/2
/// over a strip.
const MEAN_DEPTH: f64 = 0.5;
/// Error of a pair's fraction by an occluder's unevenness, in parts of the smaller triangle's size. A choice: with
/// less, bounds are kept by fewer pairs; with more, more pairs are cut finer than they need.
const UNEVEN: f64 = 4.0;
/// Part of the length of all four null rules that is the least difference of the two rules. Chosen by the same rooms,
/// of which 0.3 left a factor 8 bounds off.
const BY_CHANCE: f64 = 1.0;
/// Points of a cell: nineteen, and one near each corner.
const POINTS: usize = 22;
/// Part of a cell's area that is near a corner and beyond all of the nineteen points: 0.0035 on one side of a line past
/// the corner's nearest point, up to 0.05 along an edge, and there what a function has that grows from 0 in a line is a
/// third to a half.
const AT_CORNER: f64 = 0.01;
/// Distance of an edge from a cell, in parts of the cell's extent beside it, below which points may all be too far
/// away to see what is next to it. A choice: the nearest points are some 0.03 away.
const NEXT_TO: f64 = 0.02;
/// Distance of an edge from a cell, in parts of the cell's extent beside it, below which B is taken next to the edge,
/// too. A choice: with less, what lies next to an edge is missed between points; with more, cells take points in vain.
const LOOKED_AT: f64 = 0.1;
/// Part of a cell's extent next to an edge that no point of a rule lies in.
const UNSEEN_DEPTH: f64 = 0.03;
/// Slope of an edge up to which it runs along the outer plane. Steeper ones pass it at one place.
const LEVEL: f64 = 0.1;
/// Bound of the faces of a body whose shadow is one polygon: such a shadow has eight corners at most.
const MOST_FACES: usize = 6;
/// In place of a body.
const NO_BODY: u32 = u32::MAX;
/// Bound of the occluders whose shadows are taken of eight points at a time: all are held against each other.
const MOST_CONES: usize = 12;
/// Bound of the divisions of the outer triangle down to a cell.
const MOST_DEPTH: u32 = 60;

type Shape = geometry::Polygon<MOST_CORNERS>;

/// A straight line in the outer plane: n · x − `offset` is the distance from it.
#[derive(Clone, Copy, Debug)]
struct Straight {
    normal: DVec3,
    offset: f64,
}

/// An edge that runs along the outer plane at a small height, of an occluder or of the target.
///
/// At a distance s beside it, the edge at a height z covers or bares a band of elevations up to z / s, of the factor
/// r / 2 (z / s)², r that for each radian of a band's width: all of F° next to the edge, and next to nothing where
/// points are, if these are farther away.
#[derive(Clone, Copy, Debug)]
struct NearEdge {
    ends: [DVec3; 2],
    /// The occluder; `None` for an edge of the target.
    of: Option<u32>,
}

/// What a cell has beside an edge that runs along it.
struct Beside {
    /// What its points may miss, and the line to cut it along; `None` where they lie near enough.
    missed: Option<(f64, Straight)>,
    strip: Strip,
}

/// The part of a cell next to an edge.
#[derive(Clone, Copy, Debug)]
struct Strip {
    /// Unit vector of the outer plane across the edge.
    across: DVec3,
    /// Where the cell begins, along `across`, and how far it goes from there, with its sign.
    start: f64,
    depth: f64,
    /// True if the edge runs over the cell.
    is_both: bool,
    /// Distance of the edge from the cell, in parts of the cell's extent beside it.
    distance: f64,
}

/// A place in a strip.
#[derive(Clone, Copy, Debug)]
struct Place {
    barycentric: [f64; 3],
    /// Distance from where the cell begins, with its sign.
    depth: f64,
    /// The area that it stands for.
    area: f64,
}

/// A line on which the blocked factor is not analytic.
#[derive(Clone, Copy, Debug)]
struct Line {
    straight: Straight,
    /// `None` for the plane of an occluder.
    event: Option<Event>,
    /// The occluders that it is of; the same twice if it is of one.
    of: [u32; 2],
    /// True if an occluder stands on the outer triangle there: B has a step.
    is_contact: bool,
}

/// How much of ∫ B over a cell may lie beyond its lines, seen by none of its points.
///
/// At a depth h beyond a line, an edge or a corner at a distance d has turned by h / d at most, as seen from there. It
/// has swept a band of the target of that width.
struct Missed {
    /// The greatest unoccluded factor from a corner of the cell, times its area.
    whole: f64,
    /// The greatest factor of a band for each radian of its width, times the area of the cell.
    of_band: f64,
    /// The most beyond one of the lines so far.
    most: f64,
}

impl Missed {
    fn of(cell: &[DVec3; 3], normal: DVec3, view: &View<'_>) -> Self {
        let area = geometry::area(cell);
        let from_corners = cell.map(|x| point_to_polygon(x, normal, view.target));
        Self {
            whole: area * from_corners.into_iter().fold(0.0, f64::max),
            of_band: area * view.reach(cell),
            most: 0.0,
        }
    }

    /// The most beyond a line of an edge at a distance, in a share of the cell that goes so deep.
    fn beyond(&self, share: f64, depth: f64, distance: f64) -> f64 {
        let width = MEAN_DEPTH * depth / distance.max(f64::MIN_POSITIVE);
        share * self.whole.min(width * self.of_band)
    }
}

/// An edge and a corner that pass each other.
#[derive(Clone, Copy, Debug)]
struct Event {
    edge: [DVec3; 2],
    corner: DVec3,
    /// Index in [`CriticalCells::spokes_of`]; `None` for a corner of the target.
    of_corner: Option<u32>,
}

/// An edge from an occluder's corner, with a point of the occluder on either side.
#[derive(Clone, Copy, Debug)]
struct Spoke {
    to: DVec3,
    sides: [DVec3; 2],
}

/// A cell of the outer triangle.
#[derive(Clone, Debug)]
struct Cell {
    corners: [DVec3; 3],
    relevant: Range<usize>,
    lines: Range<usize>,
    /// ∫ B by degree 8.
    value: f64,
    /// |difference from degree 5|, at least [`BY_CHANCE`] of what null rules say.
    difference: f64,
    /// What the corners of the cell, where no point of a rule lies, may have other than its points say.
    at_corners: f64,
    /// What may have been missed beside an edge so near that no point of a rule lies next to it.
    at_edges: f64,
    /// Error bound of `value`.
    error: f64,
    depth: u32,
    /// The line beyond which most may have been missed.
    worst: Option<Straight>,
    /// Order of creation: between equal errors it decides.
    number: u32,
}

impl PartialEq for Cell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Cell {}
impl PartialOrd for Cell {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Cell {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then(other.number.cmp(&self.number))
    }
}

/// The blocked part of an exchange area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BlockedExchange {
    /// ∫ B dx, in squared units.
    pub(crate) exchange: f64,
    /// Error bound of `exchange`: the sum over cells of the differences of two orders.
    pub(crate) error: f64,
    /// Number of points.
    pub(crate) points: usize,
}

/// Precision of a measurement.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bound {
    /// Unoccluded exchange area.
    pub(crate) unoccluded: f64,
    /// Error at which the measurement ends, in parts of the visible exchange area.
    pub(crate) share: f64,
    /// Exchange area below which the error is in parts of this instead.
    pub(crate) least: f64,
    /// Number of points at which it ends, about, times the square of the number of occluders and one.
    pub(crate) most_points: usize,
}

impl Bound {
    /// The error at which a measurement ends that found so much blocked.
    pub(crate) fn enough(&self, blocked: f64) -> f64 {
        self.share * (self.unoccluded - blocked).max(self.least)
    }
}

/// Measures blocked exchange areas, one pair after the other.
#[derive(Debug, Default)]
pub(crate) struct CriticalCells {
    occluders: Vec<Occluder>,
    /// True for faces of convex bodies round which the outer triangle lies: they matter from their front only.
    is_face: Vec<bool>,
    regions: Vec<u32>,
    /// The convex body of each occluder; [`NO_BODY`] of others.
    convex: Vec<u32>,
    /// The body of each occluder that is a face of one which is taken as a whole; [`NO_BODY`] of others.
    whole: Vec<u32>,
    /// Bodies whose shadows a point has.
    shadowed: Vec<u32>,
    /// The middle of each occluder.
    middles: Vec<DVec3>,
    /// The occluders on the other side of edges, a run for each edge.
    mates: Vec<u32>,
    mates_of: Vec<Range<usize>>,
    /// The edges at corners, a run for each corner: none where an edge has an occluder on one side only.
    spokes: Vec<Spoke>,
    spokes_of: Vec<Range<usize>>,
    /// The number of each occluder's first edge, and of its first corner.
    first_edge: Vec<usize>,
    lines: Vec<Line>,
    /// Edges close to the outer plane.
    near_edges: Vec<NearEdge>,
    /// True if lines were left out, by [`MOST_CROSSED`] or [`MOST_LINES`].
    is_incomplete: bool,
    /// Indices of occluders and of lines: each cell has a run of either.
    relevant: Vec<u32>,
    crossing: Vec<u32>,
    /// Planes of the cones of one point's shadows, and the end of each shadow's.
    cones: Vec<DVec3>,
    cone_ends: Vec<usize>,
    /// The pieces of one point's shadows; of one shadow; and of that less another.
    pieces: Vec<Shape>,
    own: Vec<Shape>,
    next: Vec<Shape>,
    terms: EdgeTerms,
    shadows: Shadows,
    /// B at the points of the last cell, where they were taken eight at a time.
    values: Vec<f64>,
    #[cfg(test)]
    by_pieces_alone: bool,
    points: usize,
    created: u32,
    slack: f64,
    beside: f64,
    /// The greatest unevenness of an occluder.
    unevenness: f64,
}

/// What a pair's cells have in common.
struct View<'a> {
    target: &'a [DVec3],
    inner: &'a [DVec3; 3],
    /// Middle of the target's corners.
    middle: DVec3,
    bodies: &'a Bodies,
    /// Origin of the pair's coordinates.
    origin: DVec3,
    /// Error at which a hidden cell is evaluated in closed form.
    enough: f64,
}

impl CriticalCells {
    /// Measures the blocked exchange area of a pair to `bound.enough`. `None` if the pair has too many occluders, its
    /// shadows fall in too many pieces, or nothing of one triangle is in front of the other.
    pub(crate) fn measure(
        &mut self,
        shaft: &Shaft,
        regions: &CoplanarRegions,
        bodies: &Bodies,
        pair: &TrianglePair,
        bound: Bound,
    ) -> Option<BlockedExchange> {
        (self.points, self.created) = (0, 0);
        if pair.is_crowded {
            return None;
        }
        let sides = Sides::of(pair)?;
        let tolerance = regions.tree.plane_tolerance;
        (self.slack, self.beside) = (ROUNDING * sides.size.powi(3), BESIDE * sides.size);
        let normals = [sides.emitter_normal, sides.receiver_normal];
        self.list_occluders(shaft, regions, bodies, pair, normals)?;
        if !pair.receiver_is_smaller {
            for triangle in &pair.coplanar {
                self.push_occluder(Polygon::of(triangle), false, NO_BODY, NO_BODY);
            }
        }
        let target = in_front(sides.inner, sides.outer[0], sides.outer_normal, 0.0)?;
        self.leave_out(sides.outer, target.corners());
        if self.occluders.len() > MOST_OCCLUDERS {
            return None;
        }
        self.find_joints();
        self.find_lines(target.corners(), sides.outer, sides.outer_normal, tolerance);
        self.find_near_edges(target.corners(), sides.outer, sides.outer_normal, tolerance);
        let view = View {
            target: target.corners(),
            middle: target.corners().iter().sum::<DVec3>() / target.len() as f64,
            bodies,
            origin: pair.origin,
            inner: sides.inner,
            enough: 1e-3 * bound.share * bound.least.min(bound.unoccluded),
        };
        self.relevant.clear();
        self.crossing.clear();
        #[allow(clippy::cast_possible_truncation, reason = "bounded numbers")]
        {
            self.relevant.extend(0..self.occluders.len() as u32);
            self.crossing.extend(0..self.lines.len() as u32);
        }
        let root = (0..self.relevant.len(), 0..self.crossing.len());
        let (seen, covered) = sides.parts(pair)?;
        let mut fixed = 0.0;
        for fan in covered.as_slice().iter().map(Polygon::corners) {
            for k in 1..fan.len().saturating_sub(1) {
                fixed += hidden(&[fan[0], fan[k], fan[k + 1]], &view);
            }
        }
        self.terms.begin(sides.outer_normal);
        self.shadows.normal = sides.outer_normal;
        self.shadows.size = sides.size;
        self.shadows.target.clear();
        self.shadows.target.extend_from_slice(target.corners());
        let mut cells = BinaryHeap::new();
        for fan in seen.as_slice().iter().map(Polygon::corners) {
            for k in 1..fan.len().saturating_sub(1) {
                self.add([fan[0], fan[k], fan[k + 1]], (&root.0, &root.1), 0, &view, &mut cells)?;
            }
        }
        let found = self.refine(cells, fixed, &view, bound)?;
        // Shadows' edges are off by as much, of a triangle so large.
        let size = geometry::area(sides.outer).min(geometry::area(sides.inner)).sqrt();
        Some(BlockedExchange {
            exchange: found.exchange,
            error: found.error + (UNEVEN * self.unevenness / size).min(1.0) * bound.unoccluded,
            points: found.points,
        })
    }

    /// Cuts the worst cells until the sum of all errors is small enough.
    fn refine(
        &mut self,
        mut cells: BinaryHeap<Cell>,
        fixed: f64,
        view: &View<'_>,
        bound: Bound,
    ) -> Option<BlockedExchange> {
        let mut error: f64 = cells.iter().map(|cell| cell.error).sum();
        let mut blocked: f64 = cells.iter().map(|cell| cell.value).sum::<f64>() + fixed;
        let most_points = bound.most_points / (self.occluders.len() + 1).pow(2);
        while error > bound.enough(blocked) && self.points < most_points {
            let Some(worst) = cells.pop() else { break };
            if worst.error <= 0.0 || worst.depth >= MOST_DEPTH {
                cells.push(worst);
                break;
            }
            let mut parts = BinaryHeap::new();
            self.divide(&worst, view, &mut parts)?;
            // Where differences fall by their order, degree 8 is far better than its difference from degree 5. Where a
            // line was cut away they fall as well, which says nothing of the order.
            let differences: f64 = parts.iter().map(|part| part.difference).sum();
            let fall = if worst.difference > 0.0 && worst.lines.is_empty() {
                (2.0 * differences / worst.difference).clamp(0.02, 1.0)
            } else {
                1.0
            };
            error -= worst.error;
            blocked -= worst.value;
            for mut part in parts {
                if part.lines.is_empty() {
                    part.error = (part.error * fall).max(part.at_corners).max(part.at_edges);
                }
                error += part.error;
                blocked += part.value;
                cells.push(part);
            }
            if error <= bound.enough(blocked) {
                // Without the rounding of sums and differences.
                error = cells.iter().map(|cell| cell.error).sum();
                blocked = cells.iter().map(|cell| cell.value).sum::<f64>() + fixed;
            }
        }
        Some(BlockedExchange {
            exchange: cells.iter().map(|cell| cell.value).sum::<f64>() + fixed,
            error: cells.iter().map(|cell| cell.error).sum(),
            points: self.points,
        })
    }

    /// Lists the occluders, whole regions, each cut at both planes.
    fn list_occluders(
        &mut self,
        shaft: &Shaft,
        regions: &CoplanarRegions,
        bodies: &Bodies,
        pair: &TrianglePair,
        normals: [DVec3; 2],
    ) -> Option<()> {
        let tolerance = regions.tree.plane_tolerance;
        self.occluders.clear();
        self.regions.clear();
        self.is_face.clear();
        self.whole.clear();
        self.convex.clear();
        self.unevenness = 0.0;
        let outer = if pair.receiver_is_smaller {
            &pair.receiver
        } else {
            &pair.emitter
        };
        let outer = outer.map(|p| p + pair.origin);
        for region in shaft.regions(regions, pair) {
            if self.regions.contains(&region) {
                continue;
            }
            if self.regions.len() > MOST_OCCLUDERS {
                return None;
            }
            self.regions.push(region);
            self.unevenness = self.unevenness.max(regions.unevenness(region));
            let mut outline = Polygon::EMPTY;
            for &corner in regions.corners(region) {
                outline.push(corner - pair.origin);
            }
            for (normal, on) in normals.into_iter().zip([pair.emitter[0], pair.receiver[0]]) {
                outline = outline.split(normal, normal.dot(on), tolerance).0;
            }
            let is_face = bodies.is_outside(region, &outer);
            let whole = bodies.of(region).filter(|&body| {
                let body = bodies.get(body);
                let is_before = |p: DVec3| {
                    let on = [pair.emitter[0], pair.receiver[0]];
                    let mut heights = normals.into_iter().zip(on).map(|(n, on)| n.dot(p - pair.origin - on));
                    heights.all(|h| h >= -tolerance)
                };
                is_face
                    && body.faces.len() <= MOST_FACES
                    && body.edges.iter().all(|edge| edge.ends.into_iter().all(is_before))
            });
            let convex = bodies.of(region).unwrap_or(NO_BODY);
            self.push_occluder(outline, is_face, convex, whole.unwrap_or(NO_BODY));
        }
        Some(())
    }

    fn push_occluder(&mut self, outline: Polygon, is_face: bool, convex: u32, whole: u32) {
        let corners = outline.corners();
        if corners.len() < 3 {
            return;
        }
        let sum = |k: usize| (corners[k] - corners[0]).cross(corners[k + 1] - corners[0]);
        let normal: DVec3 = (1..corners.len() - 1).map(sum).sum();
        if normal != DVec3::ZERO {
            self.occluders.push(Occluder { outline, normal });
            self.is_face.push(is_face);
            self.convex.push(convex);
            self.whole.push(whole);
        }
    }

    /// Leaves out the occluders that hide nothing of the target from anywhere on the outer triangle.
    fn leave_out(&mut self, outer: &[DVec3; 3], target: &[DVec3]) {
        let mut kept = 0;
        for k in 0..self.occluders.len() {
            let index = u32::try_from(k).unwrap_or(u32::MAX);
            let is_idle = self.is_turned_away(index, outer)
                || self.occluders[k].effect(outer, target, self.slack) == Effect::Nothing;
            if !is_idle {
                self.occluders[kept] = self.occluders[k];
                self.is_face[kept] = self.is_face[k];
                self.convex[kept] = self.convex[k];
                self.whole[kept] = self.whole[k];
                kept += 1;
            }
        }
        self.occluders.truncate(kept);
        self.is_face.truncate(kept);
        self.convex.truncate(kept);
        self.whole.truncate(kept);
    }

    /// Returns whether an occluder is a face whose front no point of a cell sees.
    fn is_turned_away(&self, occluder: u32, cell: &[DVec3; 3]) -> bool {
        let Occluder { outline, normal } = &self.occluders[occluder as usize];
        let on = outline.corners()[0];
        self.is_face[occluder as usize] && cell.iter().all(|&x| normal.dot(x - on) <= 0.0)
    }

    /// Finds the critical lines of the outer plane.
    fn find_lines(&mut self, target: &[DVec3], outer: &[DVec3; 3], normal: DVec3, tolerance: f64) {
        self.lines.clear();
        let mut lines = std::mem::take(&mut self.lines);
        let plane = OuterPlane {
            normal,
            outer,
            beside: self.beside,
        };
        for (k, occluder) in (0u32..).zip(&self.occluders) {
            let outline = occluder.outline.corners();
            let stands = outline
                .iter()
                .filter(|&&p| normal.dot(p - outer[0]).abs() <= 4.0 * tolerance)
                .count();
            plane.push(&mut lines, occluder.normal, outline[0], None, [k; 2]);
            if let Some(line) = lines
                .last_mut()
                .filter(|line| line.event.is_none() && line.of == [k; 2])
            {
                line.is_contact = stands >= 2;
            }
            let first = self.first_edge[k as usize];
            for (e, (a, b)) in occluder.outline.edges().enumerate() {
                for &corner in target {
                    let event = Event {
                        edge: [a, b],
                        corner,
                        of_corner: None,
                    };
                    let across = event.across();
                    if !self.is_inside(k, first + e, a, across) {
                        plane.push(&mut lines, across, a, Some(event), [k; 2]);
                    }
                }
            }
            for (t, &a) in target.iter().enumerate() {
                let b = target[(t + 1) % target.len()];
                for (number, &corner) in (first..).zip(outline) {
                    let event = Event {
                        edge: [a, b],
                        corner,
                        of_corner: u32::try_from(number).ok(),
                    };
                    plane.push(&mut lines, event.across(), a, Some(event), [k; 2]);
                }
            }
        }
        self.is_incomplete = self.occluders.len() > MOST_CROSSED || !self.find_crossings(&plane, &mut lines);
        self.lines = lines;
    }

    /// Finds the edges that run along the outer plane at a small height.
    fn find_near_edges(&mut self, target: &[DVec3], outer: &[DVec3; 3], normal: DVec3, tolerance: f64) {
        self.near_edges.clear();
        let longest = (0..3)
            .map(|k| outer[k].distance(outer[(k + 1) % 3]))
            .fold(0.0, f64::max);
        let of_target = (0..target.len()).map(|k| (None, target[k], target[(k + 1) % target.len()]));
        let of_occluders = (0u32..)
            .zip(&self.occluders)
            .flat_map(|(k, occluder)| occluder.outline.edges().map(move |(a, b)| (Some(k), a, b)));
        for (of, a, b) in of_target.chain(of_occluders) {
            let [low, high] = [a, b].map(|p| normal.dot(p - outer[0]));
            let is_level = (high - low).abs() <= LEVEL * a.distance(b);
            let is_above = low.abs().max(high.abs()) > 4.0 * tolerance;
            if is_level && is_above && low.abs().min(high.abs()) < LOOKED_AT * longest {
                self.near_edges.push(NearEdge { ends: [a, b], of });
            }
        }
    }

    /// Finds the lines of an edge of one occluder and a corner of another. Returns whether they are all.
    ///
    /// A convex body's edges and corners pass each other only where a face turns away, which has a line of its own.
    fn find_crossings(&self, plane: &OuterPlane<'_>, lines: &mut Vec<Line>) -> bool {
        for (k, one) in (0u32..).zip(&self.occluders) {
            for (m, other) in (0u32..).zip(&self.occluders) {
                let [body, of_other] = [k, m].map(|k| self.convex[k as usize]);
                if k == m || (body == of_other && body != NO_BODY) {
                    continue;
                }
                let corners = (self.first_edge[m as usize]..).zip(other.outline.corners());
                for (e, (a, b)) in (self.first_edge[k as usize]..).zip(one.outline.edges()) {
                    for (number, &corner) in corners.clone() {
                        if lines.len() >= MOST_LINES {
                            return false;
                        }
                        let event = Event {
                            edge: [a, b],
                            corner,
                            of_corner: u32::try_from(number).ok(),
                        };
                        let across = event.across();
                        if !self.is_inside(k, e, a, across) {
                            plane.push(lines, across, a, Some(event), [k, m]);
                        }
                    }
                }
            }
        }
        true
    }

    /// Finds the occluders that share an edge or a corner.
    fn find_joints(&mut self) {
        let beside = self.beside * self.beside;
        let near = move |p: DVec3, q: DVec3| p.distance_squared(q) <= beside;
        self.middles.clear();
        self.mates.clear();
        self.mates_of.clear();
        self.spokes.clear();
        self.spokes_of.clear();
        self.first_edge.clear();
        for occluder in &self.occluders {
            let corners = occluder.outline.corners();
            self.middles.push(corners.iter().sum::<DVec3>() / corners.len() as f64);
        }
        for (k, occluder) in (0u32..).zip(&self.occluders) {
            self.first_edge.push(self.mates_of.len());
            for (a, b) in occluder.outline.edges() {
                let start = self.mates.len();
                for (m, other) in (0u32..).zip(&self.occluders) {
                    let is_same = |(c, d)| (near(a, d) && near(b, c)) || (near(a, c) && near(b, d));
                    if m != k && other.outline.edges().any(is_same) {
                        self.mates.push(m);
                    }
                }
                self.mates_of.push(start..self.mates.len());
            }
        }
        for k in 0..self.occluders.len() {
            for e in 0..self.occluders[k].outline.len() {
                let start = self.spokes.len();
                if !self.push_spokes(self.occluders[k].outline.corners()[e], near) {
                    self.spokes.truncate(start);
                }
                self.spokes_of.push(start..self.spokes.len());
            }
        }
    }

    /// Appends the edges at a corner. Returns whether each has just one occluder on the other side.
    fn push_spokes(&mut self, corner: DVec3, near: impl Fn(DVec3, DVec3) -> bool) -> bool {
        for (m, other) in self.occluders.iter().enumerate() {
            for (edge, (a, b)) in (self.first_edge[m]..).zip(other.outline.edges()) {
                let to = match (near(a, corner), near(b, corner)) {
                    (true, false) => b,
                    (false, true) => a,
                    _ => continue,
                };
                let [mate] = self.mates[self.mates_of[edge].clone()] else {
                    return false;
                };
                // Once for both.
                if m < mate as usize {
                    self.spokes.push(Spoke {
                        to,
                        sides: [self.middles[m], self.middles[mate as usize]],
                    });
                }
            }
        }
        true
    }

    /// Returns whether an edge of occluder `k` is no outline of what it is part of: another one with the same edge lies
    /// on the other side of the plane through it with this normal.
    fn is_inside(&self, k: u32, edge: usize, on: DVec3, across: DVec3) -> bool {
        let side = |k: u32| across.dot(self.middles[k as usize] - on);
        let own = side(k);
        let mut mates = self.mates[self.mates_of[edge].clone()].iter();
        mates.any(|&m| self.are_apart(own, side(m)))
    }

    /// Returns whether two heights are on both sides of a plane, and neither in it but for rounding.
    fn are_apart(&self, one: f64, other: f64) -> bool {
        one.abs() > self.slack && other.abs() > self.slack && (one < 0.0) != (other < 0.0)
    }

    /// Returns whether the event of a line does nothing to the shadows on the target, proved for all points between two
    /// of the line: it lies beside the target, in another occluder's shadow, or inside of a body's outline.
    ///
    /// The sign of det (a − x, b − x, p − x) is affine in x, so that it holds between its ends.
    fn is_unseen(&self, line: &Line, ends: [DVec3; 2], relevant: &Range<usize>, view: &View<'_>) -> bool {
        let single;
        let points = match &line.event {
            Some(event) => {
                single = [event.corner];
                &single[..]
            }
            None => self.occluders[line.of[0] as usize].outline.corners(),
        };
        let count = view.target.len();
        for (t, &a) in view.target.iter().enumerate() {
            let b = view.target[(t + 1) % count];
            let is_beside = |x: DVec3| {
                let across = (a - x).cross(b - x);
                let sign = across.dot(view.middle - x).signum();
                points.iter().all(|&p| sign * across.dot(p - x) < -self.slack)
            };
            if ends.into_iter().all(is_beside) {
                return true;
            }
        }
        if let Some(of_corner) = line.event.and_then(|event| event.of_corner) {
            let spokes = &self.spokes[self.spokes_of[of_corner as usize].clone()];
            let corner = points[0];
            let is_between = |spoke: &Spoke| {
                let [[a, b], [c, d]] = ends.map(|x| {
                    let across = (corner - x).cross(spoke.to - x);
                    spoke.sides.map(|p| across.dot(p - x))
                });
                // On the same sides at both ends, and so between them.
                self.are_apart(a, b) && self.are_apart(c, d) && (a < 0.0) == (c < 0.0)
            };
            if !spokes.is_empty() && spokes.iter().all(is_between) {
                return true;
            }
        }
        let mut others = self.relevant[relevant.clone()].iter().filter(|m| !line.of.contains(m));
        others.any(|&m| {
            let Occluder { outline, normal } = &self.occluders[m as usize];
            let heights = ends.map(|x| normal.dot(x - outline.corners()[0]));
            if heights[0] * heights[1] <= 0.0 || (self.is_face[m as usize] && heights[0] < 0.0) {
                return false;
            }
            let sign = -heights[0].signum();
            outline.edges().all(|(a, b)| {
                ends.iter().all(|&x| {
                    let across = (a - x).cross(b - x) * sign;
                    points.iter().all(|&p| across.dot(p - x) > self.slack)
                })
            })
        })
    }

    /// Appends the occluders of a cell that may hide something of the target. Returns whether one hides all of it.
    fn push_relevant(&mut self, corners: &[DVec3; 3], parent: Range<usize>, view: &View<'_>) -> bool {
        for at in parent {
            let index = self.relevant[at];
            if self.is_turned_away(index, corners) {
                continue;
            }
            match self.occluders[index as usize].effect(corners, view.target, self.slack) {
                Effect::Nothing => {}
                Effect::All => return true,
                Effect::Part => self.relevant.push(index),
            }
        }
        false
    }

    /// Adds a cell: cut where occluders stand on it, then evaluated.
    fn add(
        &mut self,
        corners: [DVec3; 3],
        parent: (&Range<usize>, &Range<usize>),
        depth: u32,
        view: &View<'_>,
        out: &mut BinaryHeap<Cell>,
    ) -> Option<()> {
        if geometry::area(&corners) <= 0.0 {
            return Some(());
        }
        let start = self.relevant.len();
        let is_hidden = self.push_relevant(&corners, parent.0.clone(), view);
        let number = self.created;
        self.created += 1;
        let mut cell = Cell {
            corners,
            relevant: start..start,
            lines: self.crossing.len()..self.crossing.len(),
            value: 0.0,
            difference: 0.0,
            at_corners: 0.0,
            at_edges: 0.0,
            error: 0.0,
            depth,
            worst: None,
            number,
        };
        if is_hidden {
            self.relevant.truncate(start);
            cell.value = hidden(&corners, view);
            out.push(cell);
            return Some(());
        }
        if self.relevant.len() == start {
            return Some(());
        }
        cell.relevant = start..self.relevant.len();
        let first = self.crossing.len();
        let mut contact = None;
        let mut missed = Missed::of(&corners, self.shadows.normal, view);
        if self.is_incomplete && cell.relevant.len() > 1 {
            missed.most = UNSOUGHT * missed.whole;
        }
        for at in parent.1.clone() {
            let index = self.crossing[at];
            let line = &self.lines[index as usize];
            if !line.of.iter().all(|k| self.relevant[cell.relevant.clone()].contains(k)) {
                continue;
            }
            let heights = line.straight.heights(&corners, self.beside);
            let Some((share, depth)) = beyond(heights) else {
                continue;
            };
            let Some(ends) = line.ends(&corners, heights) else {
                continue;
            };
            if !line.is_active(ends) {
                continue;
            }
            if !line.is_contact && self.is_unseen(line, ends, &cell.relevant, view) {
                continue;
            }
            if line.is_contact && contact.is_none() {
                contact = Some(heights);
            }
            if share * missed.whole > missed.most {
                let most = missed.beyond(share, depth, self.distance_to(line, ends));
                if most > missed.most {
                    (missed.most, cell.worst) = (most, Some(line.straight));
                }
            }
            self.crossing.push(index);
        }
        cell.lines = first..self.crossing.len();
        // The part next to the nearest edge.
        let mut strip = None;
        for edge in &self.near_edges {
            let matters = |k: u32| self.relevant[cell.relevant.clone()].contains(&k);
            if !edge.of.is_none_or(matters) {
                continue;
            }
            let Some(beside) = edge.beside(&corners, self.shadows.normal, &missed) else {
                continue;
            };
            if let Some((most, cut)) = beside.missed
                && most > cell.at_edges
            {
                cell.at_edges = most;
                if most > missed.most {
                    (missed.most, cell.worst) = (most, Some(cut));
                }
            }
            if strip.is_none_or(|strip: Strip| beside.strip.distance < strip.distance) {
                strip = Some(beside.strip);
            }
        }
        if let Some(heights) = contact
            && depth < MOST_DEPTH
        {
            for part in cut(&corners, heights).into_iter().flatten() {
                self.add(part, (&cell.relevant, &cell.lines), depth + 1, view, out)?;
            }
            return Some(());
        }
        self.evaluate(&mut cell, view)?;
        if let Some(strip) = strip
            && let Some((most, cut)) = self.off_beside(&cell.corners, &strip)
            && most > cell.at_edges
        {
            cell.at_edges = most;
            if most > missed.most {
                (missed.most, cell.worst) = (most, Some(cut));
            }
        }
        // What begins beyond a line may have been missed, and both rules may agree on it by chance.
        cell.error = cell.difference.max(cell.at_corners).max(missed.most);
        out.push(cell);
        Some(())
    }

    /// A lower bound of the distance from a line, between two of its points, to what it is of.
    fn distance_to(&self, line: &Line, ends: [DVec3; 2]) -> f64 {
        let from = |x: DVec3| match &line.event {
            Some(Event {
                edge,
                corner,
                of_corner,
            }) => {
                let (edge, corner) = (distance_to_segment(x, *edge), x.distance(*corner));
                match of_corner {
                    None => edge,
                    Some(_) if line.of[0] == line.of[1] => corner,
                    Some(_) => edge.min(corner),
                }
            }
            None => {
                let edges = self.occluders[line.of[0] as usize].outline.edges();
                edges
                    .map(|(a, b)| distance_to_segment(x, [a, b]))
                    .fold(f64::INFINITY, f64::min)
            }
        };
        // A distance changes by no more than the way along the line.
        let middle = (ends[0] + ends[1]) * 0.5;
        let half = 0.5 * ends[0].distance(ends[1]);
        let of_ends = ends.map(from);
        (0.5 * (of_ends[0].min(of_ends[1]) + from(middle) - half)).max(0.0)
    }

    /// Divides a cell: along a critical line, or through its longest side.
    fn divide(&mut self, cell: &Cell, view: &View<'_>, out: &mut BinaryHeap<Cell>) -> Option<()> {
        let mut best: Option<([f64; 3], f64)> = None;
        for at in cell.lines.clone() {
            let heights = self.lines[self.crossing[at] as usize]
                .straight
                .heights(&cell.corners, self.beside);
            if let Some(share) = share_beyond(heights)
                && best.is_none_or(|(_, most)| share > most)
            {
                best = Some((heights, share));
            }
        }
        let is_missed = cell.error > cell.difference.max(cell.at_corners);
        if let Some(worst) = cell.worst.filter(|_| is_missed) {
            let heights = worst.heights(&cell.corners, self.beside);
            best = share_beyond(heights).map(|share| (heights, share));
        }
        if let Some((heights, share)) = best
            && (share >= LEAST_SHARE || is_missed)
        {
            for part in cut(&cell.corners, heights).into_iter().flatten() {
                self.add(part, (&cell.relevant, &cell.lines), cell.depth + 1, view, out)?;
            }
            return Some(());
        }
        let lengths = [0, 1, 2].map(|k| cell.corners[k].distance_squared(cell.corners[(k + 1) % 3]));
        let longest = (0..3).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best });
        let [a, b, c] = [0, 1, 2].map(|k| cell.corners[(longest + k) % 3]);
        let middle = (a + b) * 0.5;
        for part in [[a, middle, c], [middle, b, c]] {
            self.add(part, (&cell.relevant, &cell.lines), cell.depth + 1, view, out)?;
        }
        Some(())
    }

    /// Integrates B over a cell by both rules.
    fn evaluate(&mut self, cell: &mut Cell, view: &View<'_>) -> Option<()> {
        let area = geometry::area(&cell.corners);
        self.values.clear();
        let sums = match self.sums_by_eights(cell, view) {
            Some(sums) => sums,
            None => self.sums_by_pieces(cell, view)?,
        };
        self.points += 19;
        let [fifth, eighth, one, two, three, at_corners @ ..] = sums.map(|sum| sum * area);
        let nulls = [one, two, three];
        let difference = (eighth - fifth).abs();
        let all = nulls
            .iter()
            .fold(difference * difference, |sum, null| sum + null * null)
            .sqrt();
        cell.value = eighth;
        cell.difference = difference.max(BY_CHANCE * all);
        cell.at_corners = AT_CORNER * at_corners.iter().map(|off| off.abs()).sum::<f64>();
        Some(())
    }

    /// The sums of a cell's rules, eight points at a time; `None` with too many occluders.
    fn sums_by_eights(&mut self, cell: &Cell, view: &View<'_>) -> Option<[f64; RULES]> {
        self.list_shadows(&cell.corners, cell.relevant.clone(), view);
        #[cfg(test)]
        if self.by_pieces_alone {
            return None;
        }
        if self.shadows.cones.len() > MOST_CONES {
            return None;
        }
        let (points, weights) = (points(&cell.corners), weights());
        let mut sums = [0.0; RULES];
        for (some, weights) in points.chunks(LANES).zip(weights.chunks(LANES)) {
            let mut at = [[0.0; LANES]; 3];
            for l in 0..LANES {
                let x = some[l.min(some.len() - 1)];
                for (of_axis, x) in at.iter_mut().zip(x.to_array()) {
                    of_axis[l] = x;
                }
            }
            let factors = self.shadows.factors(&at)?;
            self.values.extend_from_slice(&factors[..some.len()]);
            for (weights, factor) in weights.iter().zip(factors) {
                for (sum, weight) in sums.iter_mut().zip(weights) {
                    *sum += factor * weight;
                }
            }
        }
        Some(sums)
    }

    /// What B next to an edge is off the polynomial through the nineteen points, over the part of the last cell there,
    /// and the line to cut it along. `None` where shadows are taken by pieces.
    ///
    /// At a height z, all that the edge hides turns within z of it. What it passes there may be places where two other
    /// edges meet in sight, on curves which no line knows of.
    #[inline(never)]
    fn off_beside(&mut self, corners: &[DVec3; 3], strip: &Strip) -> Option<(f64, Straight)> {
        let values: [f64; 19] = self.values.get(..19)?.try_into().ok()?;
        let places = strip.places(corners);
        let mut at = [[0.0; LANES]; 3];
        for l in 0..LANES {
            let x = places[l].at(corners);
            for (of_axis, x) in at.iter_mut().zip(x.to_array()) {
                of_axis[l] = x;
            }
        }
        let factors = self.shadows.factors(&at)?;
        self.points += LANES;
        let fitted = Fitted::of(&values);
        let mut off = [0.0; LANES];
        for l in 0..LANES {
            off[l] = places[l].area * (factors[l] - fitted.at(places[l].barycentric)).abs();
        }
        let all: f64 = off.iter().sum();
        // From there on to the edge lie three quarters of it.
        let mut so_far = 0.0;
        let from = (0..LANES).find(|&l| {
            so_far += off[l];
            so_far >= 0.25 * all
        })?;
        Some((all, strip.straight(places[from].depth)))
    }

    /// The sums of a cell's rules, by pieces of polygons; `None` with too many pieces.
    fn sums_by_pieces(&mut self, cell: &Cell, view: &View<'_>) -> Option<[f64; RULES]> {
        for (x, weights) in points(&cell.corners).into_iter().zip(weights()) {
            self.point(x, *weights, &cell.relevant, view)?;
        }
        Some(self.terms.finish())
    }

    /// Lists the outlines of a cell's occluders.
    fn list_shadows(&mut self, corners: &[DVec3; 3], relevant: Range<usize>, view: &View<'_>) {
        self.shadows.clear();
        self.shadowed.clear();
        for at in relevant {
            let index = self.relevant[at] as usize;
            let whole = self.whole[index];
            if whole == NO_BODY {
                // From behind, a face of a body hides nothing that its other faces do not.
                let Occluder { outline, normal } = &self.occluders[index];
                let (outline, of_one_side) = (outline.corners(), self.is_face[index]);
                self.shadows.add_polygon(corners, outline, *normal, of_one_side);
            } else if !self.shadowed.contains(&whole) {
                self.shadowed.push(whole);
                self.shadows.add_body(corners, view.bodies.get(whole), view.origin);
            }
        }
    }

    /// Adds the edges of the shadows seen from `x`. `None` if there are too many pieces.
    fn point(&mut self, x: DVec3, weights: [f64; RULES], relevant: &Range<usize>, view: &View<'_>) -> Option<()> {
        let mut target = Shape::EMPTY;
        for &corner in view.target {
            target.push(corner - x);
        }
        self.cones.clear();
        self.cone_ends.clear();
        self.shadowed.clear();
        self.pieces.clear();
        let (mut part, mut rest) = (Shape::EMPTY, Shape::EMPTY);
        for at in relevant.clone() {
            let start = self.cones.len();
            if !self.push_cone(self.relevant[at] as usize, x, view) {
                continue;
            }
            let is_beside = |n: &DVec3| target.corners().iter().all(|p| n.dot(*p) <= 0.0);
            if self.cones[start..].iter().any(is_beside) {
                self.cones.truncate(start);
                continue;
            }
            let mut inside = target;
            let mut is_whole = true;
            for n in &self.cones[start..] {
                if inside.corners().iter().all(|p| n.dot(*p) >= 0.0) {
                    continue;
                }
                is_whole = false;
                inside.split_into(*n, 0.0, 0.0, &mut part, &mut rest);
                std::mem::swap(&mut inside, &mut part);
                if inside.len() < 3 {
                    break;
                }
            }
            if is_whole {
                self.pieces.clear();
                self.pieces.push(target);
                break;
            }
            if inside.len() < 3 {
                self.cones.truncate(start);
                continue;
            }
            self.own.clear();
            keep(&mut self.own, &inside);
            self.take_earlier(start);
            self.pieces.append(&mut self.own);
            self.cone_ends.push(self.cones.len());
            if self.pieces.len() > MOST_PIECES {
                return None;
            }
        }
        for piece in &self.pieces {
            let corners = piece.corners();
            let mut before = corners[corners.len() - 1];
            for &corner in corners {
                self.terms.push(before, corner, weights);
                before = corner;
            }
        }
        Some(())
    }

    /// Appends the planes of the cone from `x` over an occluder, positive inside; for a face of a whole body those over
    /// the body, once. Returns whether there is such a cone.
    fn push_cone(&mut self, index: usize, x: DVec3, view: &View<'_>) -> bool {
        let whole = self.whole[index];
        if whole != NO_BODY {
            if self.shadowed.contains(&whole) {
                return false;
            }
            self.shadowed.push(whole);
            let (body, start) = (view.bodies.get(whole), self.cones.len());
            let at = x + view.origin;
            let mut is_front = [false; MOST_FACES];
            for (is_front, face) in is_front.iter_mut().zip(&body.faces) {
                *is_front = face.height(at) > 0.0;
            }
            for BodyEdge { ends, left, right } in &body.edges {
                if is_front[*left] != is_front[*right] {
                    let [a, b] = ends.map(|p| p - at);
                    let n = a.cross(b);
                    self.cones.push(if is_front[*left] { -n } else { n });
                }
            }
            return self.cones.len() >= start + 3;
        }
        let occluder = &self.occluders[index];
        let outline = occluder.outline.corners();
        let side = occluder.normal.dot(x - outline[0]);
        if side == 0.0 || (side < 0.0 && self.is_face[index]) {
            return false;
        }
        let mut before = outline[outline.len() - 1] - x;
        for &corner in outline {
            let corner = corner - x;
            let n = before.cross(corner);
            self.cones.push(if side < 0.0 { n } else { -n });
            before = corner;
        }
        true
    }

    /// Takes the shadows before this one away from its pieces; `end` is the end of their planes.
    fn take_earlier(&mut self, end: usize) {
        let (mut within, mut outside) = (Shape::EMPTY, Shape::EMPTY);
        let mut from = 0;
        for &to in &self.cone_ends {
            if to > end {
                break;
            }
            let cone = &self.cones[from..to];
            from = to;
            self.next.clear();
            for piece in &self.own {
                let is_beside = |n: &DVec3| piece.corners().iter().all(|p| n.dot(*p) <= self.slack);
                if cone.iter().any(is_beside) {
                    self.next.push(*piece);
                    continue;
                }
                let mut inside = *piece;
                for n in cone {
                    inside.split_into(*n, 0.0, self.slack, &mut within, &mut outside);
                    if outside.len() >= 3 {
                        keep(&mut self.next, &outside);
                    }
                    std::mem::swap(&mut inside, &mut within);
                    if inside.len() < 3 {
                        break;
                    }
                }
            }
            std::mem::swap(&mut self.own, &mut self.next);
            if self.own.is_empty() {
                return;
            }
        }
    }
}

/// The weights of a cell's points: in the rules of degree 5 and 8, in three null rules, and in what each of the corner
/// points is off the polynomial through the nineteen others.
fn weights() -> &'static [[f64; RULES]; POINTS] {
    static WEIGHTS: OnceLock<[[f64; RULES]; POINTS]> = OnceLock::new();
    WEIGHTS.get_or_init(|| {
        let (nulls, corners) = (null_rules(), corner_rules());
        let mut weights = [[0.0; RULES]; POINTS];
        for (k, (_, [fifth, eighth])) in nineteen(&[DVec3::ZERO; 3]).into_iter().enumerate() {
            let [one, two, three] = nulls.map(|rule| rule[k]);
            let [p, q, r] = corners.map(|rule| -rule[k]);
            weights[k] = [fifth, eighth, one, two, three, p, q, r];
        }
        for k in 0..3 {
            weights[POINTS - 3 + k][RULES - 3 + k] = 1.0;
        }
        weights
    })
}

/// Points of a cell: the nineteen, and one near each corner.
fn points(cell: &[DVec3; 3]) -> [DVec3; POINTS] {
    let mut points = [DVec3::ZERO; POINTS];
    for (point, (x, _)) in points.iter_mut().zip(nineteen(cell)) {
        *point = x;
    }
    points[POINTS - 3..].copy_from_slice(&corner_points(cell));
    points
}

/// Appends a polygon, in two if it has more than [`MANY`] corners.
fn keep(pieces: &mut Vec<Shape>, polygon: &Shape) {
    let corners = polygon.corners();
    if corners.len() <= MANY {
        pieces.push(*polygon);
        return;
    }
    let middle = corners.len() / 2;
    pieces.push(Shape::of(&corners[..=middle]));
    let mut second = Shape::of(&corners[middle..]);
    second.push(corners[0]);
    pieces.push(second);
}

/// The exchange area of a cell from which nothing is seen, all of it blocked.
fn hidden(cell: &[DVec3; 3], view: &View<'_>) -> f64 {
    let share = view.enough / geometry::area(cell);
    contour::exchange(cell, view.inner, contour::Precision::of_area(share.clamp(1e-14, 1e-5)))
}

impl View<'_> {
    /// Bound of the factor from points of a cell to a band across the target, for each radian of its width: 1/2, of a
    /// band across all of the hemisphere; ψ / π of one of the angle ψ along it.
    fn reach(&self, cell: &[DVec3; 3]) -> f64 {
        let middle = (cell[0] + cell[1] + cell[2]) / 3.0;
        let radius = |corners: &[DVec3], middle: DVec3| corners.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let of_target = radius(self.target, self.middle);
        let distance = middle.distance(self.middle) - radius(cell, middle) - of_target;
        if distance <= 0.0 {
            return 0.5;
        }
        (2.0 * of_target / (distance * std::f64::consts::PI)).min(0.5)
    }
}

/// Distance of a point from a segment.
fn distance_to_segment(x: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let along = b - a;
    let squared = along.length_squared();
    let at = if squared > 0.0 {
        ((x - a).dot(along) / squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    x.distance(a + along * at)
}

/// The plane in which lines are found.
struct OuterPlane<'a> {
    normal: DVec3,
    outer: &'a [DVec3; 3],
    beside: f64,
}

impl OuterPlane<'_> {
    /// Appends the line in which the plane through `on` with normal `across` meets the outer triangle, if it does.
    fn push(&self, lines: &mut Vec<Line>, across: DVec3, on: DVec3, event: Option<Event>, of: [u32; 2]) {
        let within = across - self.normal * across.dot(self.normal);
        let length = within.length();
        if length <= 1e-9 * across.length() || length == 0.0 {
            return;
        }
        let line = Line {
            straight: Straight {
                normal: across / length,
                offset: across.dot(on) / length,
            },
            event,
            of,
            is_contact: false,
        };
        if share_beyond(line.straight.heights(self.outer, self.beside)).is_some() {
            lines.push(line);
        }
    }
}

impl NearEdge {
    /// What a cell has beside the edge; `None` where points lie near enough.
    fn beside(&self, cell: &[DVec3; 3], normal: DVec3, missed: &Missed) -> Option<Beside> {
        let [a, b] = self.ends;
        let height = |p: DVec3| normal.dot(p - cell[0]).abs();
        let along = (b - a) - normal * normal.dot(b - a);
        let length = along.length();
        let along = along.try_normalize()?;
        let across = normal.cross(along);
        let least = |values: [f64; 3]| values.into_iter().fold(f64::INFINITY, f64::min);
        let most = |values: [f64; 3]| values.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let (places, sides) = (cell.map(|p| along.dot(p - a)), cell.map(|p| across.dot(p - a)));
        let (from, to) = (least(places).max(0.0), most(places).min(length));
        let (low, high) = (least(sides), most(sides));
        let far = if high > -low { high } else { low };
        if from >= to || missed.whole <= 0.0 {
            return None;
        }
        let gap = low.max(-high).max(0.0);
        let at = |l: f64| height(a) + (height(b) - height(a)) * l / length;
        let z = at(from).max(at(to));
        // At s, F° is as much as the band below the edge.
        let s = z * (0.5 * missed.of_band / missed.whole).sqrt();
        let strip = Strip {
            across,
            start: across.dot(a) + far.signum() * gap,
            depth: far - far.signum() * gap,
            is_both: low < 0.0 && high > 0.0,
            distance: gap.hypot(z) / far.abs(),
        };
        if strip.distance >= LOOKED_AT {
            return None;
        }
        let distance = gap.hypot(z.max(s));
        if distance >= NEXT_TO * far.abs() {
            return Some(Beside { missed: None, strip });
        }
        let of_strip = if gap < s {
            missed.whole * (2.0 * s - gap)
        } else {
            0.5 * missed.of_band * z * z / gap
        };
        let sides = if low < 0.0 && high > 0.0 { 2.0 } else { 1.0 };
        let share = (sides * (to - from) * of_strip / geometry::area(cell)).min(missed.whole);
        let cut = Straight {
            normal: across,
            offset: across.dot(a) + far.signum() * (distance * far.abs()).sqrt(),
        };
        Some(Beside {
            missed: Some((share, cut)),
            strip,
        })
    }
}

impl Strip {
    /// Eight places in the middle of the cell's width there, each half as deep as the one before; on both sides of the
    /// edge four, each a quarter as deep as the last one on its side.
    fn places(&self, cell: &[DVec3; 3]) -> [Place; LANES] {
        let area = geometry::area(cell);
        let sides = cell.map(|p| self.across.dot(p) - self.start);
        let mut depth = UNSEEN_DEPTH * self.depth;
        std::array::from_fn(|k| {
            let at = depth;
            let thickness = if k + 1 == LANES || (self.is_both && k + 2 == LANES) {
                at
            } else if self.is_both {
                0.75 * at
            } else {
                0.5 * at
            };
            depth *= match (self.is_both, k % 2 == 0) {
                (false, _) => 0.5,
                (true, true) => -1.0,
                (true, false) => -0.25,
            };
            // The ends of the cell's part at this depth, in barycentric coordinates.
            let mut ends = [[1.0, 0.0, 0.0]; 2];
            let mut count = 0;
            for p in 0..3 {
                let q = (p + 1) % 3;
                let (hp, hq) = (sides[p] - at, sides[q] - at);
                if (hp < 0.0) != (hq < 0.0) && count < 2 {
                    let share = hp / (hp - hq);
                    let mut end = [0.0; 3];
                    (end[p], end[q]) = (1.0 - share, share);
                    ends[count] = end;
                    count += 1;
                }
            }
            let [p, q] = ends.map(|end| cell[0] * end[0] + cell[1] * end[1] + cell[2] * end[2]);
            Place {
                barycentric: [0, 1, 2].map(|k| 0.5 * (ends[0][k] + ends[1][k])),
                depth: at,
                area: (p.distance(q) * thickness.abs()).min(area),
            }
        })
    }

    /// The line at a depth.
    fn straight(&self, depth: f64) -> Straight {
        Straight {
            normal: self.across,
            offset: self.start + depth,
        }
    }
}

impl Place {
    fn at(&self, [a, b, c]: &[DVec3; 3]) -> DVec3 {
        let [x, y, z] = self.barycentric;
        *a * x + *b * y + *c * z
    }
}

impl Straight {
    /// Distances of a cell's corners from the line; 0 for corners on it.
    fn heights(&self, cell: &[DVec3; 3], beside: f64) -> [f64; 3] {
        cell.map(|p| {
            let height = self.normal.dot(p) - self.offset;
            if height.abs() <= beside { 0.0 } else { height }
        })
    }
}

impl Line {
    /// The ends of the line's part in a cell that it divides.
    fn ends(&self, cell: &[DVec3; 3], heights: [f64; 3]) -> Option<[DVec3; 2]> {
        let mut ends = (0..3).filter_map(|k| {
            let next = (k + 1) % 3;
            let (hp, hq) = (heights[k], heights[next]);
            if hp == 0.0 {
                Some(cell[k])
            } else {
                (hp * hq < 0.0).then(|| crossing(cell[k], cell[next], hp, hq))
            }
        });
        Some([ends.next()?, ends.next()?])
    }

    /// Returns whether the corner passes the edge, seen from between two points of the line, and not its extension.
    fn is_active(&self, ends: [DVec3; 2]) -> bool {
        let Some(Event {
            edge: [a, b], corner, ..
        }) = self.event
        else {
            return true;
        };
        let (mut below, mut above) = (true, true);
        for x in ends {
            let across = self.straight.normal.cross(corner - x);
            let (at, length) = (across.dot(x - a), across.dot(b - a));
            if length == 0.0 {
                return true;
            }
            let along = at / length;
            below &= along < -1e-9;
            above &= along > 1.0 + 1e-9;
        }
        !below && !above
    }
}

impl Event {
    /// Normal of the plane through the edge and the corner.
    fn across(&self) -> DVec3 {
        let [a, b] = self.edge;
        (b - a).cross(self.corner - a)
    }
}

/// The share of a cell's area on the smaller side of a line; `None` if the line passes beside it.
fn share_beyond(heights: [f64; 3]) -> Option<f64> {
    beyond(heights).map(|(share, _)| share)
}

/// The share of a cell's area on the smaller side of a line, and the greatest distance from the line there; `None` if
/// the line passes beside it.
fn beyond(heights: [f64; 3]) -> Option<(f64, f64)> {
    let positive = heights.iter().filter(|&&h| h > 0.0).count();
    let negative = heights.iter().filter(|&&h| h < 0.0).count();
    if positive == 0 || negative == 0 {
        return None;
    }
    // The corner that is alone on its side.
    let sign = if positive == 1 { 1.0 } else { -1.0 };
    let k = (0..3).find(|&k| heights[k] * sign > 0.0)?;
    let (h, p, q) = (heights[k], heights[(k + 1) % 3], heights[(k + 2) % 3]);
    let share = (h / (h - p)) * (h / (h - q));
    Some(if share <= 0.5 {
        (share, h.abs())
    } else {
        (1.0 - share, p.abs().max(q.abs()))
    })
}

/// The two or three triangles on both sides of a line.
fn cut(cell: &[DVec3; 3], heights: [f64; 3]) -> [Option<[DVec3; 3]>; 3] {
    // A corner on the line: two triangles.
    if let Some(k) = (0..3).find(|&k| heights[k] == 0.0) {
        let [a, b, c] = [0, 1, 2].map(|m| cell[(k + m) % 3]);
        let at = crossing(b, c, heights[(k + 1) % 3], heights[(k + 2) % 3]);
        return [Some([a, b, at]), Some([a, at, c]), None];
    }
    let alone = (0..3).find(|&k| heights[k] * heights[(k + 1) % 3] < 0.0 && heights[k] * heights[(k + 2) % 3] < 0.0);
    let Some(k) = alone else {
        return [Some(*cell), None, None];
    };
    let [a, b, c] = [0, 1, 2].map(|m| cell[(k + m) % 3]);
    let [ha, hb, hc] = [0, 1, 2].map(|m| heights[(k + m) % 3]);
    let (p, q) = (crossing(a, b, ha, hb), crossing(a, c, ha, hc));
    // The quadrangle p, b, c, q along its shorter diagonal.
    if p.distance_squared(c) < b.distance_squared(q) {
        [Some([a, p, q]), Some([p, b, c]), Some([p, c, q])]
    } else {
        [Some([a, p, q]), Some([p, b, q]), Some([b, c, q])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Model;
    use crate::factor::{FactorRule, exchange};
    use crate::visibility::exact::tests::{BOX_FACES, box_corner, model_of, model_with_sides, quad};
    use crate::visibility::segments::Obstacles;
    use crate::visibility::shaft::PatchTriangle;
    use glam::DQuat;

    /// From quad to quad, to a share of the unoccluded factor: the factor, its error bound, and the points.
    fn factor_of(model: &Model, [from, to]: [[u32; 2]; 2], share: f64) -> (f64, f64, usize) {
        let regions = &*CoplanarRegions::of(model);
        let bodies = Bodies::new(regions);
        let obstacles = Obstacles::new(model, regions);
        let mut cells = CriticalCells::default();
        let (mut visible, mut error, mut area, mut points) = (0.0, 0.0, 0.0, 0);
        for i in from {
            let own = model.normalised_corners(i);
            area += geometry::area(&own);
            for j in to {
                let other = model.normalised_corners(j);
                let mut shaft = Shaft::default();
                let pair = shaft.pair(obstacles, PatchTriangle::new(i, &own), PatchTriangle::new(j, &other));
                let unoccluded = exchange(&own, &other, &FactorRule::exact());
                let bound = Bound {
                    unoccluded,
                    share,
                    least: unoccluded,
                    most_points: 1_000_000,
                };
                let found = cells
                    .measure(&shaft, regions, &bodies, &pair, bound)
                    .expect("a measurement");
                visible += unoccluded - found.exchange;
                error += found.error;
                points += found.points;
            }
        }
        (visible / area, error / area, points)
    }

    const TURNS: [(DVec3, f64); 3] = [
        (DVec3::X, 0.0),
        (DVec3::new(1.0, 2.0, 3.0), 1.4),
        (DVec3::new(-2.0, 1.0, 0.5), 0.7),
    ];

    /// Emitter, receiver and obstructions, quads of two triangles each; the factor, and how well it is known.
    struct Case {
        quads: Vec<[[DVec3; 3]; 2]>,
        exact: f64,
        known: f64,
    }

    /// Walton's square obstruction (NISTIR 6925), a slat, and what stands before a wall, by Gauss–Legendre quadrature
    /// over each smooth piece; plates through a leaning wall, by adaptive quadrature over points.
    fn cases() -> Vec<Case> {
        let p = DVec3::new;
        let level = |[x, u]: [f64; 2], [y, v]: [f64; 2], z| quad([p(x, y, z), p(u, y, z), p(u, v, z), p(x, v, z)]);
        let facing_down = |side: f64, z| {
            let (a, b) = (p(0., 0., z), p(0., side, z));
            quad([a, b, p(side, side, z), p(side, 0., z)])
        };
        let standing = |x: f64, [y, v]: [f64; 2], z| quad([p(x, y, 0.), p(x, v, 0.), p(x, v, z), p(x, y, z)]);
        let (far, wide, top, high) = (2.854, 1.452, 1.108_888_878, 1.619_794_572);
        let exactly = |quads, exact| Case {
            quads,
            exact,
            known: 1e-13,
        };
        let both = [0.0, 1.0];
        vec![
            exactly(
                vec![
                    level(both, both, 0.0),
                    facing_down(1.0, 1.0),
                    level([0.0, 0.5], [0.0, 0.5], 0.5),
                ],
                0.149_868_671_773_8,
            ),
            exactly(
                vec![
                    level([0.0, 2.0], [0.0, 2.0], 0.0),
                    facing_down(2.0, 2.0),
                    level([0.5, 1.5], [0.0, 2.0], 1.0),
                ],
                0.058_326_845_901_811,
            ),
            exactly(
                vec![
                    level([1.0, 2.0], both, 0.0),
                    standing(0.0, both, 1.0),
                    standing(0.5, both, 0.4),
                ],
                0.015_437_573_315_816,
            ),
            exactly(
                vec![
                    level([0.5, 1.5], both, 0.0),
                    standing(0.0, both, 2.0),
                    standing(0.25, [0.4, 0.6], 3.0),
                ],
                0.084_696_651_445_0,
            ),
            Case {
                quads: vec![
                    level([0.0, far], [0.0, wide], 0.0),
                    quad([p(0., 0., 0.), p(0., wide, 0.), p(top, wide, high), p(top, 0., high)]),
                    level([0.2731, 1.2191], [0.5547, 1.0327], 0.5508),
                    level([0.8544, 1.5454], [0.4203, 1.3843], 0.6887),
                ],
                exact: 0.203_167_01,
                known: 5e-7,
            },
            // A pair of `promises::random_pairs`: two rules agreed by chance on some of its cells.
            Case {
                quads: vec![
                    level([0.0, 2.657], [0.0, 0.508], 0.0),
                    quad([p(0., 0., 0.), p(0., 0.508, 0.), p(0., 0.508, 2.626), p(0., 0., 2.626)]),
                    quad([
                        p(
                            0.663_464_035_419_685_2,
                            -0.071_534_136_383_583_19,
                            0.279_311_900_698_443_8,
                        ),
                        p(
                            -0.038_144_788_193_087_09,
                            0.300_258_573_565_065_4,
                            0.838_200_296_943_831_7,
                        ),
                        p(
                            0.069_035_964_580_314_83,
                            1.083_534_136_383_583,
                            0.451_688_099_301_556_23,
                        ),
                        p(
                            0.770_644_788_193_087_1,
                            0.711_741_426_434_934_5,
                            -0.107_200_296_943_831_63,
                        ),
                    ]),
                    standing(0.48625, [-0.396, 0.654], 0.586),
                ],
                exact: 0.058_709_337_282_10,
                known: 1e-8,
            },
        ]
    }

    #[test]
    fn a_factor_is_within_its_bound_in_every_position() {
        for (number, Case { quads, exact, known }) in cases().into_iter().enumerate() {
            for (axis, angle) in TURNS {
                let model = model_of(&quads, DQuat::from_axis_angle(axis.normalize(), angle));
                // Normalised lengths differ from the case's by a factor, areas of the two quads do not.
                for share in [1e-4, 1e-6, 1e-8] {
                    let (found, error, points) = factor_of(&model, [[0, 1], [2, 3]], share);
                    let off = (found - exact).abs();
                    assert!(
                        off <= error + known,
                        "case {number}, turned {angle}: {found} is not {exact}, bound {error:e}, {points} points"
                    );
                    assert!(
                        error <= share * 0.3,
                        "case {number}: {error:e} is not {share:e} of the unoccluded"
                    );
                }
            }
        }
    }

    /// The six faces of a box, seen from outside.
    fn faces(low: DVec3, size: DVec3) -> [[[DVec3; 3]; 2]; 6] {
        BOX_FACES.map(|face| quad(face.map(|number| box_corner(low, size, number))))
    }

    /// A closed room with two boxes, afloat or on the floor: what leaves a wall reaches something, whatever the turn.
    #[test]
    fn rows_of_a_room_with_boxes_sum_to_one() {
        let p = DVec3::new;
        let walls = faces(p(0., 0., 0.), p(6., 5., 9.)).map(|face| face.map(|[a, b, c]| [a, c, b]));
        let far = faces(p(0.3, 1.9, 0.28), p(0.91, 0.81, 0.63));
        for low in [p(3.1, 0.3, 0.66), p(3.1, 0.3, 0.0)] {
            let near = faces(low, p(0.61, 0.95, 1.13));
            let triangles = [walls, far, near].concat().concat();
            for (axis, angle) in TURNS {
                let turn = DQuat::from_axis_angle(axis.normalize(), angle);
                let model = model_with_sides(&triangles, turn, |_| false);
                let (sums, points) = sums(&model, 1e-6);
                // Triangles 0 and 1 are the floor; 24 and 25 what may lie on it.
                let free = (0..36).filter(|k| low.z > 0.0 || ![0, 1, 24, 25].contains(k));
                for k in free {
                    let off = (sums[k] - 1.0).abs();
                    assert!(
                        off < 1e-6,
                        "at {low}, turned {angle}: row {k} is {off:e} off, {points} points"
                    );
                }
                let floor = 0.5 * (sums[0] + sums[1]);
                let covered = if low.z > 0.0 { 0.0 } else { 0.61 * 0.95 / 30.0 };
                assert!(
                    (floor + covered - 1.0).abs() < 1e-6,
                    "at {low}, turned {angle}: {floor}"
                );
            }
        }
    }

    /// Row sums to a tolerance of each pair, and the points of all pairs.
    fn sums(model: &Model, tolerance: f64) -> (Vec<f64>, usize) {
        let regions = &*CoplanarRegions::of(model);
        let bodies = Bodies::new(regions);
        let obstacles = Obstacles::new(model, regions);
        let (mut cells, mut points) = (CriticalCells::default(), 0);
        let count = u32::try_from(model.patches().len()).expect("a small scene");
        let mut sums = vec![0.0; count as usize];
        for (i, j) in (0..count).flat_map(|j| (0..j).map(move |i| (i, j))) {
            let (own, other) = (model.normalised_corners(i), model.normalised_corners(j));
            let mut shaft = Shaft::default();
            let pair = shaft.pair(obstacles, PatchTriangle::new(i, &own), PatchTriangle::new(j, &other));
            let unoccluded = exchange(&own, &other, &FactorRule::exact());
            if pair.is_occluded || unoccluded <= 0.0 {
                continue;
            }
            let mut seen = unoccluded;
            if !pair.is_unoccluded() {
                let least = 1e-2 * geometry::area(&own).min(geometry::area(&other));
                let bound = Bound {
                    unoccluded,
                    share: 0.3 * tolerance,
                    least,
                    most_points: 20_000_000,
                };
                let found = cells
                    .measure(&shaft, regions, &bodies, &pair, bound)
                    .expect("a measurement");
                points += found.points;
                seen -= found.exchange;
            }
            sums[i as usize] += seen / geometry::area(&own);
            sums[j as usize] += seen / geometry::area(&other);
        }
        (sums, points)
    }

    /// Eight points at a time and pieces of polygons are two ways to the same sums: between boxes that float, stand on
    /// the floor, touch each other and stand in one plane, and plates that cross them.
    #[test]
    fn intervals_of_edges_are_worth_what_pieces_of_polygons_are() {
        let p = DVec3::new;
        let walls = faces(p(0., 0., 0.), p(6., 5., 4.)).map(|face| face.map(|[a, b, c]| [a, c, b]));
        let boxes = [
            (p(1., 1., 0.), p(1., 1., 2.)),
            (p(2., 1., 0.), p(1., 1., 1.5)),
            (p(3.5, 1., 0.), p(1., 1., 2.)),
            (p(1.5, 3., 1.), p(0.7, 0.9, 1.1)),
        ];
        let plate = quad([p(0.5, 0.7, 1.2), p(4.9, 0.9, 1.2), p(4.8, 1.6, 1.3), p(0.4, 1.5, 1.25)]);
        let solid = boxes.map(|(low, size)| faces(low, size)).concat();
        let triangles = [walls.to_vec(), solid, vec![plate]].concat().concat();
        for (axis, angle) in TURNS {
            let model = model_with_sides(&triangles, DQuat::from_axis_angle(axis.normalize(), angle), |k| k >= 60);
            let regions = &*CoplanarRegions::of(&model);
            let bodies = Bodies::new(regions);
            let obstacles = Obstacles::new(&model, regions);
            let [mut eights, mut pieces] = [false, true].map(|by_pieces_alone| CriticalCells {
                by_pieces_alone,
                ..CriticalCells::default()
            });
            let count = u32::try_from(model.patches().len()).expect("a small scene");
            let mut compared = 0;
            for (i, j) in (0..count).flat_map(|j| (0..j).map(move |i| (i, j))) {
                let (own, other) = (model.normalised_corners(i), model.normalised_corners(j));
                let mut shaft = Shaft::default();
                let pair = shaft.pair(obstacles, PatchTriangle::new(i, &own), PatchTriangle::new(j, &other));
                let bound = Bound {
                    unoccluded: exchange(&own, &other, &FactorRule::exact()),
                    share: 0.0,
                    least: 0.0,
                    most_points: 0,
                };
                if pair.is_occluded || pair.is_unoccluded() || bound.unoccluded <= 0.0 {
                    continue;
                }
                let [one, two] = [&mut eights, &mut pieces].map(|cells| {
                    let found = cells.measure(&shaft, regions, &bodies, &pair, bound);
                    found.map_or(f64::NAN, |found| found.exchange)
                });
                let off = (one - two).abs() / one.max(two).max(bound.unoccluded);
                assert!(
                    off <= 1e-6,
                    "turned {angle}, {i} and {j}: {one} by intervals, {two} by pieces"
                );
                compared += 1;
            }
            assert!(compared > 200, "{compared} compared");
        }
    }

    /// Points grow slowly with what is asked for: rays would take 10⁴ times as many for a hundredth of the error.
    #[test]
    fn a_hundredth_of_the_error_takes_a_few_times_the_points() {
        for Case { quads, .. } in &cases()[..4] {
            let model = model_of(quads, DQuat::IDENTITY);
            let [rough, fine] = [1e-5, 1e-7].map(|share| factor_of(&model, [[0, 1], [2, 3]], share).2);
            assert!(fine <= 20 * rough, "{rough} and {fine} points");
        }
    }

    /// Where what is blocked is asked for with too few points, the error bound says that it is not known.
    #[test]
    fn a_measurement_that_is_cut_short_says_so() {
        let model = model_of(&cases()[0].quads, DQuat::IDENTITY);
        let regions = &*CoplanarRegions::of(&model);
        let bodies = Bodies::new(regions);
        let (own, other) = (model.normalised_corners(0), model.normalised_corners(2));
        let mut shaft = Shaft::default();
        let obstacles = Obstacles::new(&model, regions);
        let pair = shaft.pair(obstacles, PatchTriangle::new(0, &own), PatchTriangle::new(2, &other));
        let unoccluded = exchange(&own, &other, &FactorRule::exact());
        let measured = [100, 1_000_000].map(|most_points| {
            let bound = Bound {
                unoccluded,
                share: 1e-9,
                least: unoccluded,
                most_points,
            };
            CriticalCells::default()
                .measure(&shaft, regions, &bodies, &pair, bound)
                .expect("a measurement")
        });
        let [short, whole] = measured;
        assert!(short.error > 1e-9 * unoccluded && whole.error <= 1e-9 * unoccluded);
        assert!((short.exchange - whole.exchange).abs() <= short.error + whole.error);
    }
}
