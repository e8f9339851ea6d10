//! The visible fraction of a pair without rays: from points of one triangle, cut the other by its occluders and
//! evaluate the rest in closed form.
//!
//! From a point x, an occluder hides the part of a polygon inside the cone of x over it. Taking the cones of all
//! occluders away leaves convex pieces, whose factors from x are Lambert's contour sums: exact at x, however thin the
//! pieces. Over the points the visible factor is continuous, with kinks where an edge comes into view. So few points
//! do, and more only where neighbouring ones disagree: cells of the outer triangle are divided into four until that
//! changes little. Rays would have to resolve a step in four dimensions instead.
//!
//! The sign of det (a − x, b − x, p − x) tells the side of a point p of the plane through x and an edge a, b. The
//! determinant is affine in x: its sign at the three corners of a cell holds all over the cell. So whole cells are
//! proved to see all, or nothing, and occluders that cannot matter are left out of their parts.
//!
//! Two measurers, because two errors are asked for. [`ExactVisibility`] takes the place of 10⁵ rays and more at a pair
//! whose error is one of many in a row's: 10⁻³ of a fraction, six points a cell, estimates whose squares add up,
//! triangles of walls as occluders. [`critical::CriticalCells`] keeps a bound on one pair's exchange area, 10⁻⁵ and
//! less: it knows the lines where the integrand is not smooth, which costs more than all of the six points where 10⁻³
//! is enough.

pub(crate) mod critical;
mod shadows;

use crate::factor::contour;
use crate::factor::{SIX, point_to_polygon};
use crate::geometry::{self, in_front, quarters};
use crate::steps;
use crate::visibility::coplanar::CoplanarRegions;
use crate::visibility::shaft::{Shaft, TrianglePair};
use glam::DVec3;

/// Bound of the pieces that a polygon is cut into from one point: beyond, rays are cheaper.
const MOST_PIECES: usize = 200;

/// Part of a cell that may see other than its points do, if nothing is proved of it, by the number of its divisions:
/// few points miss much more than many. A choice, checked by `cells_end_where_an_obstruction_sticks_through`.
const UNPROVED: [f64; 4] = [0.1, 0.015, 0.006, 0.002];

/// Bound of the pieces of the outer triangle after cuts along occluders standing on it.
const MOST_CUT: usize = 64;

/// Greatest volume, in cubes of the pair's extent, of a point on a plane.
const ROUNDING: f64 = 1e-12;

/// Bound of the corners of a polygon: [`MANY`], and one more for each of the five planes of a cone over a pentagon that
/// cut it.
const MOST_CORNERS: usize = 13;
/// Pieces with more corners are cut in two.
const MANY: usize = 8;

type Polygon = geometry::Polygon<MOST_CORNERS>;

/// A list of polygons that reuses its room.
#[derive(Debug, Default)]
struct Pieces {
    polygons: Vec<Polygon>,
    count: usize,
}

impl Pieces {
    fn clear(&mut self) {
        self.count = 0;
    }

    fn as_slice(&self) -> &[Polygon] {
        &self.polygons[..self.count]
    }

    /// Appends the polygon with these corners, copying nothing else.
    fn push(&mut self, corners: impl Iterator<Item = DVec3>) {
        if self.count == self.polygons.len() {
            self.polygons.push(Polygon::EMPTY);
        }
        let polygon = &mut self.polygons[self.count];
        polygon.clear();
        corners.for_each(|corner| polygon.push(corner));
        self.count += 1;
    }

    /// Appends a polygon, in two if it has more than [`MANY`] corners.
    fn keep(&mut self, polygon: &Polygon) {
        let corners = polygon.corners();
        if corners.len() <= MANY {
            self.push(corners.iter().copied());
            return;
        }
        let middle = corners.len() / 2;
        self.push(corners[..=middle].iter().copied());
        self.push(corners[middle..].iter().chain(&corners[..1]).copied());
    }
}

/// An occluder: a convex polygon between the two planes.
#[derive(Clone, Copy, Debug)]
struct Occluder {
    outline: Polygon,
    normal: DVec3,
}

/// Measures visible fractions, one pair after the other.
#[derive(Debug, Default)]
pub(crate) struct ExactVisibility {
    occluders: Vec<Occluder>,
    /// Indices of the occluders that matter to cells; each cell has a run of them.
    relevant: Vec<u32>,
    pieces: Pieces,
    next: Pieces,
    points: usize,
    /// Work on pieces beyond the first of a point, in steps.
    more_steps: u64,
    /// Volumes below this are rounding.
    slack: f64,
}

/// A measured fraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExactFraction {
    /// The visible fraction.
    pub(crate) fraction: f64,
    /// Error bound of `fraction`.
    pub(crate) error: f64,
    /// Number of points.
    pub(crate) points: usize,
}

/// Precision of a measurement.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Precision {
    /// Error of the fraction at which the measurement ends.
    pub(crate) enough: f64,
    /// Number of points at which it ends, about.
    pub(crate) most_points: usize,
    /// Steps at which it ends, whatever the error is then.
    pub(crate) most_steps: u64,
    /// True to cut cells along the lines on which occluders stand on them.
    ///
    /// From one side of such a line to the other the visible factor jumps. Where cells lie along the line, their
    /// points' errors add up with one sign, and error estimates are too small.
    pub(crate) along_contacts: bool,
}

/// Steps (`shaft.rs`) of a point, for each occluder of the pair. Measured.
const STEPS_A_POINT: u64 = 30;
/// Steps of holding a further piece against an occluder, and of cutting it. Where triangles pierce each other, a target
/// is in a hundred pieces from each point. Measured.
const STEPS_A_PIECE: u64 = 20;
const STEPS_A_CUT: u64 = 250;
/// Bound of the occluders of a pair that is measured from points.
const MOST_OCCLUDERS: usize = 128;

/// A part of the outer triangle, with the integrals of the factor from its points.
#[derive(Clone, Debug)]
struct Cell {
    corners: [DVec3; 3],
    relevant: std::ops::Range<usize>,
    /// ∫ of the visible factor.
    visible: f64,
    /// ∫ of the unoccluded factor.
    unoccluded: f64,
    /// Difference of the six points' value from `unoccluded`.
    strayed: f64,
    /// Error bound of `visible`.
    estimate: f64,
    /// Number of divisions of the triangle down to it.
    depth: usize,
}

/// The target of a pair's cells.
struct View<'a> {
    target: &'a [DVec3],
    /// The triangle of which the target is a part.
    inner: &'a [DVec3; 3],
    /// True if the two are so near that six points do not integrate the factor over a cell.
    is_near: bool,
    normal: DVec3,
}

/// The two triangles of a pair, by normals and by place: points lie on the outer one.
struct Sides<'a> {
    emitter_normal: DVec3,
    receiver_normal: DVec3,
    outer: &'a [DVec3; 3],
    outer_normal: DVec3,
    inner: &'a [DVec3; 3],
    inner_normal: DVec3,
    /// The greatest distance of a corner from the origin.
    size: f64,
}

impl<'a> Sides<'a> {
    /// `None` if a triangle has no normal.
    fn of(pair: &'a TrianglePair) -> Option<Self> {
        let (emitter, receiver) = (&pair.emitter, &pair.receiver);
        let unit = |t: &[DVec3; 3]| geometry::cross(t).try_normalize();
        let (emitter_normal, receiver_normal) = (unit(emitter)?, unit(receiver)?);
        let corners = emitter.iter().chain(receiver);
        let (outer, outer_normal, inner, inner_normal) = if pair.receiver_is_smaller {
            (receiver, receiver_normal, emitter, emitter_normal)
        } else {
            (emitter, emitter_normal, receiver, receiver_normal)
        };
        Some(Self {
            emitter_normal,
            receiver_normal,
            outer,
            outer_normal,
            inner,
            inner_normal,
            size: corners.map(|p| p.length_squared()).fold(0.0, f64::max).sqrt(),
        })
    }

    /// The parts of the outer triangle in front of the inner one that see it, and those that do not: if the receiver is
    /// the outer one, its part under a coplanar patch is seen from nowhere. `None` if none is in front.
    fn parts(&self, pair: &TrianglePair) -> Option<(Pieces, Pieces)> {
        let from = in_front(self.outer, self.inner[0], self.inner_normal, 0.0)?;
        let (mut seen, mut covered) = (Pieces::default(), Pieces::default());
        seen.push(from.corners().iter().copied());
        if pair.receiver_is_smaller {
            for triangle in &pair.coplanar {
                seen = without(&seen, triangle, self.receiver_normal, &mut covered);
            }
        }
        Some((seen, covered))
    }
}

impl ExactVisibility {
    /// Measures the visible fraction of a pair until its cells' error estimates add up to `precision.enough`. `None` if
    /// the pair has too many occluders, a polygon falls in too many pieces, or nothing of one triangle is in front of
    /// the other.
    pub(crate) fn measure(
        &mut self,
        shaft: &Shaft,
        regions: &CoplanarRegions,
        pair: &TrianglePair,
        precision: Precision,
    ) -> Option<ExactFraction> {
        (self.points, self.more_steps) = (0, 0);
        self.occluders.clear();
        if pair.is_crowded {
            return None;
        }
        let sides = Sides::of(pair)?;
        let tolerance = regions.tree.plane_tolerance;
        self.relevant.clear();
        self.slack = ROUNDING * sides.size.powi(3);
        for triangle in shaft.triangles(regions, pair) {
            let Some(above) = in_front(&triangle, pair.emitter[0], sides.emitter_normal, tolerance) else {
                continue;
            };
            let offset = sides.receiver_normal.dot(pair.receiver[0]);
            let (between, _) = Polygon::of(above.corners()).split(sides.receiver_normal, offset, tolerance);
            self.push_occluder(between, &triangle);
        }
        if self.occluders.len() > MOST_OCCLUDERS {
            return None;
        }
        if !pair.receiver_is_smaller {
            for triangle in &pair.coplanar {
                self.push_occluder(Polygon::of(triangle), triangle);
            }
        }
        let target = in_front(sides.inner, sides.outer[0], sides.outer_normal, 0.0)?;
        let view = View {
            target: target.corners(),
            inner: sides.inner,
            is_near: pair.is_near,
            normal: sides.outer_normal,
        };
        #[allow(clippy::cast_possible_truncation, reason = "fewer occluders than surfaces")]
        self.relevant.extend(0..self.occluders.len() as u32);
        let all = 0..self.relevant.len();
        let (mut seen, covered) = sides.parts(pair)?;
        if precision.along_contacts {
            let plane = PlaneAt {
                origin: sides.outer[0],
                normal: sides.outer_normal,
                tolerance,
            };
            for occluder in &self.occluders {
                seen = cut_along(&seen, &occluder.outline, &plane);
            }
        }
        let mut cells = Vec::new();
        for (pieces, is_covered) in [(&seen, false), (&covered, true)] {
            for fan in pieces.as_slice().iter().map(Polygon::corners) {
                for k in 1..fan.len().saturating_sub(1) {
                    let mut cell = self.cell([fan[0], fan[k], fan[k + 1]], all.clone(), &view)?;
                    if is_covered {
                        (cell.visible, cell.estimate) = (0.0, 0.0);
                    }
                    cells.push(cell);
                }
            }
        }
        let found = self.refine(cells, &view, precision);
        steps::add(self.steps());
        found
    }

    /// Divides cells until their error estimates are small enough.
    fn refine(&mut self, mut cells: Vec<Cell>, view: &View<'_>, precision: Precision) -> Option<ExactFraction> {
        let enough = precision.enough;
        loop {
            // Error estimates of different cells are independent: squares add up.
            let (mut visible, mut unoccluded, mut squared) = (0.0, 0.0, 0.0);
            for cell in &cells {
                visible += cell.visible;
                unoccluded += cell.unoccluded;
                squared += cell.estimate * cell.estimate;
            }
            let estimate = squared.sqrt();
            if unoccluded <= 0.0 {
                return None;
            }
            let is_at_end = self.points > precision.most_points || self.steps() >= precision.most_steps;
            if estimate <= enough * unoccluded || is_at_end {
                return Some(ExactFraction {
                    fraction: visible / unoccluded,
                    error: estimate / unoccluded,
                    points: self.points,
                });
            }
            // Divide all cells with more than their part in the error at once.
            let least = 0.7 * enough * unoccluded / (cells.len() as f64).sqrt();
            let mut next = Vec::with_capacity(4 * cells.len());
            for cell in cells {
                if cell.estimate <= least || self.steps() >= precision.most_steps {
                    next.push(cell);
                } else {
                    self.divide(&cell, view, &mut next)?;
                }
            }
            cells = next;
        }
    }

    /// Work of the last measurement, in steps.
    pub(crate) fn steps(&self) -> u64 {
        self.points as u64 * STEPS_A_POINT * (1 + self.occluders.len() as u64) + self.more_steps
    }

    /// Evaluates a cell from its six points. `parent` are the occluders that matter to the cell it is part of.
    fn cell(&mut self, corners: [DVec3; 3], parent: std::ops::Range<usize>, view: &View<'_>) -> Option<Cell> {
        let start = self.relevant.len();
        let mut hidden = false;
        for k in parent {
            let index = self.relevant[k];
            match self.occluders[index as usize].effect(&corners, view.target, self.slack) {
                Effect::Nothing => {}
                Effect::All => {
                    hidden = true;
                    break;
                }
                Effect::Part => self.relevant.push(index),
            }
        }
        if hidden {
            self.relevant.truncate(start);
        }
        let relevant = start..self.relevant.len();
        let area = geometry::area(&corners);
        let (mut visible, mut unoccluded) = (0.0, 0.0);
        for (large, small, weight) in SIX {
            for k in 0..3 {
                let mut at = [small; 3];
                at[k] = large;
                let x = corners[0] * at[0] + corners[1] * at[1] + corners[2] * at[2];
                let whole = point_to_polygon(x, view.normal, view.target);
                self.points += 1;
                if whole <= 0.0 {
                    continue;
                }
                unoccluded += weight * whole;
                if hidden {
                    continue;
                }
                visible += weight * self.visible(x, view, relevant.clone(), whole)?;
            }
        }
        let proved = hidden || relevant.is_empty();
        let fraction = if unoccluded > 0.0 {
            visible / unoccluded
        } else {
            f64::from(u8::from(!hidden))
        };
        let points = unoccluded * area;
        let whole = if view.is_near {
            contour::exchange(&corners, view.inner, contour::Precision::of_area(1e-5))
        } else {
            points
        };
        Some(Cell {
            corners,
            relevant,
            visible: whole * fraction,
            unoccluded: whole,
            strayed: (points - whole).abs(),
            // Six points do not tell how much they miss.
            estimate: if proved {
                0.0
            } else {
                UNPROVED[0] * whole + (points - whole).abs()
            },
            depth: 0,
        })
    }

    /// Divides a cell into four; the difference of the parts' sum from the cell is their error estimate.
    fn divide(&mut self, cell: &Cell, view: &View<'_>, out: &mut Vec<Cell>) -> Option<()> {
        let first = out.len();
        for part in quarters(&cell.corners) {
            let part = self.cell(part, cell.relevant.clone(), view)?;
            out.push(part);
        }
        let parts = &mut out[first..];
        let visible: f64 = parts.iter().map(|part| part.visible).sum();
        let unoccluded: f64 = parts.iter().map(|part| part.unoccluded).sum();
        if unoccluded <= 0.0 || cell.unoccluded <= 0.0 {
            return Some(());
        }
        // Error of the fraction, times the unoccluded factor: that factor itself is the closed form's business.
        let change = (visible / unoccluded - cell.visible / cell.unoccluded).abs() * unoccluded;
        let missed = UNPROVED[(cell.depth + 1).min(UNPROVED.len() - 1)];
        parts.iter_mut().for_each(|part| part.depth = cell.depth + 1);
        let unproved = parts.iter().filter(|part| part.estimate > 0.0).count().max(1);
        for part in parts.iter_mut().filter(|part| part.estimate > 0.0) {
            // The smooth error falls with the square of a cell's size, that of a kink nearly so. As long as nothing is
            // proved, occluders that no point has met count for a little.
            part.estimate = (0.3 * change / unproved as f64).max(missed * part.unoccluded) + 0.5 * part.strayed;
        }
        Some(())
    }

    fn push_occluder(&mut self, outline: Polygon, triangle: &[DVec3; 3]) {
        // The triangle's own normal: three corners of its outline may lie on one line but for rounding.
        let normal = geometry::cross(triangle);
        if outline.len() >= 3 && normal != DVec3::ZERO {
            self.occluders.push(Occluder { outline, normal });
        }
    }

    /// The factor from an element at `x` to the visible part of the target; `whole` is the unoccluded one. `None` if
    /// there are too many pieces.
    fn visible(&mut self, x: DVec3, view: &View<'_>, relevant: std::ops::Range<usize>, whole: f64) -> Option<f64> {
        self.pieces.clear();
        self.pieces.push(view.target.iter().map(|&p| p - x));
        let mut cut = false;
        let slack = self.slack;
        // The rest of the piece being cut, and its parts inside and outside of a plane.
        let (mut inside, mut within, mut without) = (Polygon::EMPTY, Polygon::EMPTY, Polygon::EMPTY);
        for &index in &self.relevant[relevant] {
            let occluder = &self.occluders[index as usize];
            let outline = occluder.outline.corners();
            let side = occluder.normal.dot(x - outline[0]);
            if side == 0.0 {
                continue;
            }
            // Planes of the cone over the occluder, positive inside.
            let mut cone = [DVec3::ZERO; MOST_CORNERS];
            for (k, &p) in outline.iter().enumerate() {
                let q = outline[(k + 1) % outline.len()];
                let n = (p - x).cross(q - x);
                cone[k] = if side < 0.0 { n } else { -n };
            }
            let cone = &cone[..outline.len()];
            let is_beside = |piece: &Polygon| cone.iter().any(|n| piece.corners().iter().all(|p| n.dot(*p) <= slack));
            self.more_steps += STEPS_A_PIECE * (self.pieces.count as u64).saturating_sub(1);
            if self.pieces.as_slice().iter().all(is_beside) {
                continue;
            }
            cut = true;
            self.next.clear();
            for piece in self.pieces.as_slice() {
                if is_beside(piece) {
                    self.next.push(piece.corners().iter().copied());
                    continue;
                }
                self.more_steps += if self.pieces.count > 1 { STEPS_A_CUT } else { 0 };
                for (k, n) in cone.iter().enumerate() {
                    let whole = if k == 0 { piece } else { &inside };
                    whole.split_into(*n, 0.0, slack, &mut within, &mut without);
                    if without.len() >= 3 {
                        self.next.keep(&without);
                    }
                    std::mem::swap(&mut inside, &mut within);
                    if inside.len() < 3 {
                        break;
                    }
                }
            }
            std::mem::swap(&mut self.pieces, &mut self.next);
            if self.pieces.count == 0 {
                return Some(0.0);
            }
            if self.pieces.count > MOST_PIECES {
                return None;
            }
        }
        if !cut {
            return Some(whole);
        }
        let sum: f64 = self
            .pieces
            .as_slice()
            .iter()
            .map(|piece| point_to_polygon(DVec3::ZERO, view.normal, piece.corners()))
            .sum();
        Some(sum.min(whole))
    }
}

/// Effect of an occluder on a cell's view.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Effect {
    /// Proved: it hides nothing of the target from anywhere in the cell.
    Nothing,
    /// Proved: it hides all of the target from everywhere in the cell.
    All,
    /// Neither is proved.
    Part,
}

impl Occluder {
    fn effect(&self, cell: &[DVec3; 3], target: &[DVec3], slack: f64) -> Effect {
        let outline = self.outline.corners();
        let sides = cell.map(|x| self.normal.dot(x - outline[0]));
        let (front, back) = (sides.iter().all(|&s| s >= -slack), sides.iter().all(|&s| s <= slack));
        if !front && !back {
            return Effect::Part;
        }
        let sign = if front { -1.0 } else { 1.0 };
        let mut all = sides.iter().all(|&s| s != 0.0);
        for (k, &a) in outline.iter().enumerate() {
            let b = outline[(k + 1) % outline.len()];
            let mut heights = cell.iter().flat_map(|&x| {
                let n = (a - x).cross(b - x) * sign;
                target.iter().map(move |&p| n.dot(p - x))
            });
            // The first height tells which of the two is still possible.
            if heights.next().is_some_and(|h| h > slack) {
                all = all && heights.all(|h| h > 0.0);
            } else if heights.all(|h| h <= slack) {
                return Effect::Nothing;
            } else {
                all = false;
            }
        }
        if all { Effect::All } else { Effect::Part }
    }
}

/// A plane through a point, and the distance from it within which points lie on it.
struct PlaneAt {
    origin: DVec3,
    normal: DVec3,
    tolerance: f64,
}

/// Cuts polygons of a plane in two along the line on which `outline` stands on it.
fn cut_along(polygons: &Pieces, outline: &Polygon, plane: &PlaneAt) -> Pieces {
    let &PlaneAt {
        origin,
        normal,
        tolerance,
    } = plane;
    let mut parts = Pieces::default();
    // Outlines end at the plane, but for rounding.
    let mut contact = outline
        .corners()
        .iter()
        .copied()
        .filter(|&p| normal.dot(p - origin).abs() <= 4.0 * tolerance);
    let line = match (contact.next(), contact.next()) {
        (Some(a), Some(b)) => (b - a).try_normalize().map(|along| (a, b, normal.cross(along))),
        _ => None,
    };
    for polygon in polygons.as_slice() {
        let cut = line.and_then(|(a, b, across)| {
            let (left, right) = polygon.split(across, across.dot(a), tolerance);
            let is_cut = left.len() >= 3 && right.len() >= 3 && polygons.count < MOST_CUT;
            (is_cut && meets(polygon, [a, b], plane)).then_some([left, right])
        });
        match cut {
            Some(halves) => halves.iter().for_each(|half| parts.keep(half)),
            None => parts.push(polygon.corners().iter().copied()),
        }
    }
    parts
}

/// Returns whether part of a segment lies inside a convex polygon of the same plane, of either sense of rotation.
fn meets(polygon: &Polygon, [a, b]: [DVec3; 2], plane: &PlaneAt) -> bool {
    let corners = polygon.corners();
    let middle = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (k, &p) in corners.iter().enumerate() {
        let inwards = plane.normal.cross(corners[(k + 1) % corners.len()] - p);
        let inwards = inwards * inwards.dot(middle - p).signum();
        let (ha, hb) = (inwards.dot(a - p), inwards.dot(b - p));
        if ha < 0.0 && hb < 0.0 {
            return false;
        }
        if ha < 0.0 {
            from = from.max(ha / (ha - hb));
        } else if hb < 0.0 {
            to = to.min(ha / (ha - hb));
        }
    }
    (to - from) * (b - a).length() > plane.tolerance
}

/// Takes a triangle away from polygons in its plane; appends the parts it covers to `covered`.
fn without(polygons: &Pieces, triangle: &[DVec3; 3], normal: DVec3, covered: &mut Pieces) -> Pieces {
    let mut rest = Pieces::default();
    for polygon in polygons.as_slice() {
        let mut inside = *polygon;
        for k in 0..3 {
            let (a, b, c) = (triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]);
            let mut inwards = normal.cross(b - a).normalize_or_zero();
            if inwards.dot(c - a) < 0.0 {
                inwards = -inwards;
            }
            let (within, outside) = inside.split(inwards, inwards.dot(a), 0.0);
            if outside.len() >= 3 {
                rest.keep(&outside);
            }
            inside = within;
        }
        if inside.len() >= 3 {
            covered.keep(&inside);
        }
    }
    rest
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::visibility::segments::Obstacles;
    use crate::visibility::shaft::PatchTriangle;
    use crate::{HierarchyOptions, Model};
    use glam::DQuat;
    use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

    pub(crate) fn quad([a, b, c, d]: [DVec3; 4]) -> [[DVec3; 3]; 2] {
        [[a, b, c], [a, c, d]]
    }

    /// Corners of a box's faces, counter-clockwise as seen from outside. Bits 0, 1 and 2 of a corner's number tell the far
    /// end in x, y and z.
    pub(crate) const BOX_FACES: [[usize; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];

    /// A corner of a box by its number in [`BOX_FACES`].
    pub(crate) fn box_corner(low: DVec3, size: DVec3, number: usize) -> DVec3 {
        let end = |bit: usize| f64::from(u8::from(number >> bit & 1 == 1));
        low + size * DVec3::new(end(0), end(1), end(2))
    }

    fn precision(enough: f64, along_contacts: bool) -> Precision {
        Precision {
            enough,
            most_points: 20_000,
            most_steps: u64::MAX,
            along_contacts,
        }
    }

    /// Quads as patches, two triangles each; what comes after the first two quads has two sides.
    pub(crate) fn model_of(quads: &[[[DVec3; 3]; 2]], turn: DQuat) -> Model {
        model_with_sides(&quads.concat(), turn, |k| k >= 4)
    }

    /// Triangles, turned; `is_two_sided` tells by their place.
    pub(crate) fn model_with_sides(triangles: &[[DVec3; 3]], turn: DQuat, is_two_sided: fn(usize) -> bool) -> Model {
        let triangles = triangles.iter().enumerate().map(|(k, t)| Triangle {
            corners: t.map(|q| turn * q),
            object: 0,
            material: 0,
            face: 0,
            two_sided: is_two_sided(k),
        });
        let scene = Scene {
            triangles: triangles.collect(),
            ..Scene::default()
        };
        let patches = Patches::new(&scene, Subdivision::None).expect("patches");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a model")
    }

    /// From quad to quad: the factor, and the most by which a pair's fraction may be off by its own account.
    fn factor_of(model: &Model, [from, to]: [[u32; 2]; 2], along_contacts: bool, enough: f64) -> (f64, f64) {
        let regions = &*CoplanarRegions::of(model);
        let obstacles = Obstacles::new(model, regions);
        let (mut exchange, mut whole, mut change) = (0.0, 0.0, 0.0_f64);
        for i in from {
            let own = model.normalised_corners(i);
            whole += crate::geometry::area(&own);
            for j in to {
                let other = model.normalised_corners(j);
                let mut shaft = Shaft::default();
                let pair = shaft.pair(obstacles, PatchTriangle::new(i, &own), PatchTriangle::new(j, &other));
                let rule = crate::factor::FactorRule::for_tolerance(1e-5);
                let clipped = ExactVisibility::default()
                    .measure(&shaft, regions, &pair, precision(enough, along_contacts))
                    .expect("a fraction");
                exchange += crate::factor::exchange(&own, &other, &rule) * clipped.fraction;
                change = change.max(clipped.error);
            }
        }
        (exchange / whole, change)
    }

    /// Triangles that pierce each other between two squares: a target is in dozens of pieces from each point. The work
    /// ends at its bound, and the fraction is as far off as it says, or less.
    #[test]
    fn a_measurement_ends_at_its_steps() {
        use crate::sampling::splitmix;
        let p = DVec3::new;
        let below = quad([p(0., 0., 0.), p(1., 0., 0.), p(1., 1., 0.), p(0., 1., 0.)]);
        let above = quad([p(0., 0., 1.), p(0., 1., 1.), p(1., 1., 1.), p(1., 0., 1.)]);
        let mut number = 0;
        let mut unit = || {
            number += 1;
            splitmix::unit(splitmix::hash(number))
        };
        let mut corner = |around: DVec3| around + (p(unit(), unit(), unit()) - 0.5) * 0.25;
        let mut triangles = [below, above].concat();
        for k in 0..40 {
            let place = f64::from(k) / 40.0;
            let around = p((7.3 * place).fract(), (11.7 * place).fract(), 0.3 + 0.4 * place);
            triangles.push([corner(around), corner(around), corner(around)]);
        }
        let model = model_with_sides(&triangles, DQuat::IDENTITY, |k| k >= 4);
        let regions = &*CoplanarRegions::of(&model);
        let obstacles = Obstacles::new(&model, regions);
        let (own, other) = (model.normalised_corners(0), model.normalised_corners(2));
        let mut shaft = Shaft::default();
        let pair = shaft.pair(obstacles, PatchTriangle::new(0, &own), PatchTriangle::new(2, &other));
        let mut exact = ExactVisibility::default();
        let mut measured = |most_steps| {
            let precision = Precision {
                most_steps,
                ..precision(1e-4, false)
            };
            let found = exact.measure(&shaft, regions, &pair, precision).expect("a fraction");
            (found, exact.steps())
        };
        let (whole, all) = measured(u64::MAX);
        let by_points = whole.points as u64 * STEPS_A_POINT * 41;
        assert!(all > 2 * by_points, "{all} steps, {by_points} without pieces");
        let bound = all / 20;
        let (part, steps) = measured(bound);
        assert!(steps >= bound && steps < bound + bound / 4, "{steps} of {bound}");
        let off = (part.fraction - whole.fraction).abs();
        assert!(
            part.error > whole.error && off <= 3.0 * part.error,
            "{part:?}, {whole:?}"
        );
    }

    /// A plate sticks through a leaning wall along a line that cells of the wall lie along, too. The factor is by
    /// adaptive quadrature over points of the floor, from which all is cut exactly (to 2·10⁻⁷ by its own account).
    #[test]
    fn cells_end_where_an_obstruction_sticks_through() {
        let p = DVec3::new;
        let (far, wide, top, high) = (2.854, 1.452, 1.108_888_878, 1.619_794_572);
        let floor = quad([p(0., 0., 0.), p(far, 0., 0.), p(far, wide, 0.), p(0., wide, 0.)]);
        let wall = quad([p(0., 0., 0.), p(0., wide, 0.), p(top, wide, high), p(top, 0., high)]);
        let plate = |[x, u]: [f64; 2], [y, v]: [f64; 2], z| quad([p(x, y, z), p(u, y, z), p(u, v, z), p(x, v, z)]);
        let through = plate([0.2731, 1.2191], [0.5547, 1.0327], 0.5508);
        let above = plate([0.8544, 1.5454], [0.4203, 1.3843], 0.6887);
        let exact = 0.203_167_01;
        for turn in [
            DQuat::IDENTITY,
            DQuat::from_axis_angle(p(1., 2., 3.).normalize(), 2f64.sqrt()),
        ] {
            let model = model_of(&[floor, wall, through, above], turn);
            let off = |along_contacts| {
                let (factor, change) = factor_of(&model, [[0, 1], [2, 3]], along_contacts, 3e-4);
                assert!(change <= 3e-4, "{turn}: {change}");
                (factor / exact - 1.0).abs()
            };
            let (cut, whole) = (off(true), off(false));
            assert!(cut < 3e-4, "{turn}: {cut}");
            assert!(
                whole > 3.0 * cut && whole > 6e-4,
                "without, estimates are as small and wrong: {whole}, {cut}"
            );
        }
    }

    /// A low wall between a floor and a wall, as is and turned: its foot lies in the floor's plane but for rounding.
    /// The factor was computed by 40-point Gauss–Legendre quadrature over each smooth piece.
    #[test]
    fn an_obstruction_that_stands_on_the_receiver() {
        let p = DVec3::new;
        let floor = quad([p(1., 0., 0.), p(2., 0., 0.), p(2., 1., 0.), p(1., 1., 0.)]);
        let wall = quad([p(0., 0., 0.), p(0., 1., 0.), p(0., 1., 1.), p(0., 0., 1.)]);
        let low = quad([p(0.5, 0., 0.), p(0.5, 1., 0.), p(0.5, 1., 0.4), p(0.5, 0., 0.4)]);
        let exact = 0.015_437_573_315_816;
        for turn in [
            DQuat::IDENTITY,
            DQuat::from_axis_angle(p(1., 2., 3.).normalize(), 2f64.sqrt()),
            DQuat::from_axis_angle(p(-2., 1., 0.5).normalize(), 0.7),
        ] {
            let model = model_of(&[floor, wall, low], turn);
            let regions = &*CoplanarRegions::of(&model);
            let obstacles = Obstacles::new(&model, regions);
            for (from, to) in [([0, 1], [2, 3]), ([2, 3], [0, 1])] {
                let mut sum = 0.0;
                for i in from {
                    for j in to {
                        let (own, other) = (model.normalised_corners(i), model.normalised_corners(j));
                        let mut shaft = Shaft::default();
                        let pair = shaft.pair(obstacles, PatchTriangle::new(i, &own), PatchTriangle::new(j, &other));
                        let rule = crate::factor::FactorRule::for_tolerance(1e-4);
                        let open = 2.0 * crate::factor::exchange(&own, &other, &rule)
                            / (own[1] - own[0]).cross(own[2] - own[0]).length();
                        let clipped = ExactVisibility::default()
                            .measure(&shaft, regions, &pair, precision(1e-3, false))
                            .expect("a fraction");
                        sum += 0.5 * open * clipped.fraction;
                        let mut cast = crate::visibility::shaft::Cast::default();
                        shaft.cast_segments(obstacles, &pair, 1 << 16, 1, &mut cast);
                        let by_rays = cast.fraction().expect("a fraction");
                        assert!(
                            (clipped.fraction - by_rays).abs() < 5e-3,
                            "{turn} {i} to {j}: {clipped:?}, {by_rays} by rays"
                        );
                    }
                }
                assert!((sum / exact - 1.0).abs() < 1e-3, "{turn}: {sum}");
            }
        }
    }
}
