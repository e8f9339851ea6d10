//! Form factors between rectangles with plates between them, by quadrature with every jump and kink cut out: the
//! reference for random pairs, independent of all code of `hemicube`.
//!
//! At a point of the emitter the factor is exact: from the receiver the shadow of each plate is cut away, which from
//! there is the part of a cone that lies beyond the plate, and what is left is summed by its outline
//! ([`point_to_polygon`]). As the point moves, that factor is smooth but where a corner of one shape passes an edge of
//! another. Such places lie in planes, so that the emitter is cut along all of them first; each piece is then
//! integrated by Radon's rule of degree 5 (1948), and what changes most when cut into four is cut until all of it
//! together changes less than what is asked for.

use crate::geometry::{point_to_polygon, polygon_area};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// The points with n · x = d.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: DVec3,
    distance: f64,
}

impl Plane {
    /// Through three points; none for points in a line.
    fn through(a: DVec3, b: DVec3, c: DVec3) -> Option<Self> {
        let cross = (b - a).cross(c - a);
        let scale = (b - a).length() * (c - a).length();
        (cross.length() > 1e-12 * scale).then(|| {
            let normal = cross.normalize();
            Self {
                normal,
                distance: normal.dot(a),
            }
        })
    }

    /// The upper side of a polygon: its corners run counter-clockwise there.
    fn of(polygon: &[DVec3]) -> Self {
        let cross = |k: usize| (polygon[k] - polygon[0]).cross(polygon[(k + 1) % polygon.len()] - polygon[0]);
        let normal = (0..polygon.len()).map(cross).sum::<DVec3>().normalize();
        Self {
            normal,
            distance: normal.dot(polygon[0]),
        }
    }

    fn height(self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }

    fn flipped(self) -> Self {
        Self {
            normal: -self.normal,
            distance: -self.distance,
        }
    }
}

/// The parts of a convex polygon above and below a plane; either may have no corners.
fn cut(polygon: &[DVec3], plane: Plane) -> [Vec<DVec3>; 2] {
    let mut parts = [Vec::new(), Vec::new()];
    for (k, &p) in polygon.iter().enumerate() {
        let q = polygon[(k + 1) % polygon.len()];
        let (hp, hq) = (plane.height(p), plane.height(q));
        if hp >= 0.0 {
            parts[0].push(p);
        }
        if hp <= 0.0 {
            parts[1].push(p);
        }
        if hp * hq < 0.0 {
            let at = p + (q - p) * (hp / (hp - hq));
            parts.iter_mut().for_each(|part| part.push(at));
        }
    }
    parts.map(|part| if part.len() < 3 { Vec::new() } else { part })
}

/// The half-spaces hidden by a plate from a point off its plane, together.
fn shadow(point: DVec3, plate: &[DVec3]) -> Vec<Plane> {
    let middle = plate.iter().sum::<DVec3>() / plate.len() as f64;
    let towards = |plane: Plane| {
        if plane.height(middle) < 0.0 {
            plane.flipped()
        } else {
            plane
        }
    };
    let sides = (0..plate.len()).filter_map(|k| Plane::through(point, plate[k], plate[(k + 1) % plate.len()]));
    let mut shadow: Vec<Plane> = sides.map(towards).collect();
    let beyond = Plane::of(plate);
    shadow.push(if beyond.height(point) > 0.0 {
        beyond.flipped()
    } else {
        beyond
    });
    shadow
}

/// An emitter, a receiver facing it and opaque plates; all planar and convex.
#[derive(Debug)]
pub struct Obstructed<'a> {
    /// Corners, counter-clockwise seen from the emitting side.
    pub emitter: &'a [DVec3],
    /// Corners, counter-clockwise seen from the receiving side.
    pub receiver: &'a [DVec3],
    /// Corners of each plate.
    pub plates: &'a [Vec<DVec3>],
}

impl Obstructed<'_> {
    /// The form factor from a point of the emitter.
    fn factor_at(&self, point: DVec3) -> f64 {
        if Plane::of(self.receiver).height(point) <= 0.0 {
            return 0.0;
        }
        let emitter = Plane::of(self.emitter);
        let mut seen = vec![cut(self.receiver, emitter)[0].clone()];
        for plate in self.plates {
            if Plane::of(plate).height(point) == 0.0 {
                continue;
            }
            let shadow = shadow(point, plate);
            let mut left = Vec::new();
            for mut part in seen {
                for &side in &shadow {
                    let [inside, outside] = cut(&part, side);
                    left.push(outside);
                    part = inside;
                }
            }
            left.retain(|part| !part.is_empty());
            seen = left;
        }
        seen.iter()
            .map(|part| point_to_polygon(point, emitter.normal, part))
            .sum()
    }

    /// The planes in which corners pass edges, and the planes of the shapes.
    fn events(&self) -> Vec<Plane> {
        let (emitter, receiver) = (Plane::of(self.emitter), Plane::of(self.receiver));
        let mut shapes = vec![cut(self.receiver, emitter)[0].clone()];
        shapes.extend(self.plates.iter().cloned());
        // A plate's shadow begins at its line through the receiver.
        for plate in self.plates {
            let contact = cut(plate, receiver)[0].clone();
            if contact.len() >= 3 {
                shapes.push(contact);
            }
        }
        shapes.retain(|shape| shape.len() >= 3);
        let mut planes: Vec<Plane> = shapes.iter().map(|shape| Plane::of(shape)).collect();
        for (i, one) in shapes.iter().enumerate() {
            for other in shapes
                .iter()
                .enumerate()
                .filter(|&(j, _)| j != i)
                .map(|(_, shape)| shape)
            {
                for (k, &a) in one.iter().enumerate() {
                    let b = one[(k + 1) % one.len()];
                    planes.extend(other.iter().filter_map(|&corner| Plane::through(a, b, corner)));
                }
            }
        }
        // Shapes standing on the emitter have edges and corners in its plane.
        planes.retain(|plane| plane.normal.cross(emitter.normal).length() > 1e-9);
        planes
    }

    /// The form factor from emitter to receiver, and its error bound: at most `accuracy` of itself, or of a hundredth
    /// if it is less than that.
    ///
    /// # Panics
    /// When half a million triangles are not enough.
    pub fn factor(&self, accuracy: f64) -> (f64, f64) {
        let area = polygon_area(self.emitter);
        let mut pieces = vec![self.emitter.to_vec()];
        for plane in self.events() {
            pieces = pieces
                .iter()
                .flat_map(|piece| cut(piece, plane))
                .filter(|piece| piece.len() >= 3 && polygon_area(piece) > 1e-16 * area)
                .collect();
        }
        let fans = pieces
            .iter()
            .flat_map(|piece| (1..piece.len() - 1).map(|k| [piece[0], piece[k], piece[k + 1]]));
        let mut parts: BinaryHeap<Part> = fans.map(|fan| Part::new(self, fan)).collect();
        loop {
            // In the heap's order, which is the same each time.
            let sum = parts.iter().map(|p| p.value).sum::<f64>() / area;
            let off = parts.iter().map(|p| p.change).sum::<f64>() / area;
            if off <= accuracy * sum.max(1e-2) {
                return (sum, off);
            }
            assert!(parts.len() < 500_000, "{sum} is still {off} off");
            for _ in 0..parts.len().div_ceil(8) {
                let Some(worst) = parts.pop() else { break };
                parts.extend(quarters(worst.corners).map(|quarter| Part::new(self, quarter)));
            }
        }
    }
}

/// A triangle of the emitter with the integral of the points' form factors over it, and the change of that by cutting
/// it into four.
#[derive(Debug)]
struct Part {
    corners: [DVec3; 3],
    value: f64,
    change: f64,
}

fn quarters([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let (ab, bc, ca) = ((a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0);
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

impl Part {
    fn new(pair: &Obstructed<'_>, corners: [DVec3; 3]) -> Self {
        let coarse = Self::radon(pair, corners);
        let value = quarters(corners)
            .map(|part| Self::radon(pair, part))
            .iter()
            .sum::<f64>();
        Self {
            corners,
            value,
            change: (value - coarse).abs(),
        }
    }

    /// Radon's seven points (1948; Stroud 1971, T2: 5-1).
    fn radon(pair: &Obstructed<'_>, [a, b, c]: [DVec3; 3]) -> f64 {
        let root = 15_f64.sqrt();
        let middle = (a + b + c) / 3.0;
        let mut sum = 9.0 / 40.0 * pair.factor_at(middle);
        for (weight, near) in [
            ((155.0 - root) / 1200.0, (6.0 - root) / 21.0),
            ((155.0 + root) / 1200.0, (6.0 + root) / 21.0),
        ] {
            let far = 1.0 - 2.0 * near;
            for (p, q, r) in [(a, b, c), (b, c, a), (c, a, b)] {
                sum += weight * pair.factor_at(p * far + (q + r) * near);
            }
        }
        sum * 0.5 * (b - a).cross(c - a).length()
    }
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Part {}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Part {
    fn cmp(&self, other: &Self) -> Ordering {
        self.change.total_cmp(&other.change)
    }
}
