//! Kernels over the half sphere about a hemicube's normal: their weights on pixels and their closed forms over
//! triangles.
//!
//! The mantle of an upright cylinder, sin θ over the solid angle, over a spherical polygon of arcs about the pole:
//!
//! ```text
//! ∫∫ sin²θ dθ dφ = ∮ G dφ,   G = (θ − sin θ cos θ) / 2,   dφ/ds = n_z / sin²θ along an arc with the normal n
//! ```
//!
//! The integrand G / sin²θ · n_z is smooth, θ/3 · n_z at the pole: Gauss–Legendre's eight points on pieces of an arc
//! do, cut where the arc is nearest to the pole.

use crate::delta::DeltaTable;
use crate::factor::{angle, point_to_polygon};
use crate::points::{PERSON_END, PERSON_SIDE};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_8, TAU};
use std::sync::OnceLock;

/// Share of a cylinder's mantle in its area.
const MANTLE: f64 = 4.0 * PERSON_SIDE;
/// Each hemisphere's share is a half: densities over one are doubled.
const HALF: f64 = 2.0;

/// A density over the half sphere about an axis, integrating to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kernel {
    /// cos θ / π.
    Cosine,
    /// 1 / 2π.
    Solid,
    /// The upright cylinder.
    Upright,
}

impl Kernel {
    /// Density at an angle of this cosine to the axis; 0 behind.
    pub(super) fn density(self, cosine: f64) -> f64 {
        let cosine = cosine.min(1.0);
        if cosine < 0.0 {
            return 0.0;
        }
        match self {
            Self::Cosine => cosine * FRAC_1_PI,
            Self::Solid => 1.0 / TAU,
            Self::Upright => {
                let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
                HALF * FRAC_1_PI * (MANTLE * sine * FRAC_1_PI + PERSON_END * cosine)
            }
        }
    }

    fn table(self, resolution: u32) -> DeltaTable {
        match self {
            Self::Cosine => DeltaTable::new(resolution),
            Self::Solid => DeltaTable::of(resolution, |_, [u, v], step| {
                let corner = |u: f64, v: f64| {
                    let (y, x) = (u * v, (1.0 + u * u + v * v).sqrt());
                    angle(y.abs(), x).copysign(y)
                };
                corner(u + step, v + step) - corner(u, v + step) - corner(u + step, v) + corner(u, v)
            }),
            Self::Upright => DeltaTable::of(resolution, |is_top, [u, v], step| {
                // Two points of Gauss in either direction: a pixel's density is nearly linear.
                let at = [0.5 - 0.5 / 3.0f64.sqrt(), 0.5 + 0.5 / 3.0f64.sqrt()];
                let mut sum = 0.0;
                for (s, t) in at.iter().flat_map(|&s| at.map(|t| (s, t))) {
                    let (u, v) = (u + s * step, v + t * step);
                    let squared = 1.0 + u * u + v * v;
                    let r = squared.sqrt();
                    let cosine = if is_top { 1.0 / r } else { v / r };
                    sum += self.density(cosine) / (squared * r);
                }
                0.25 * step * step * sum
            }),
        }
    }

    /// The integral over a convex polygon above the horizon, seen from the origin; corners in any order of winding.
    /// `normal` is the axis.
    pub(crate) fn over(self, normal: DVec3, polygon: &[DVec3]) -> f64 {
        // The contour sum is of corners counter-clockwise seen from the front.
        let cosine = || point_to_polygon(DVec3::ZERO, normal, polygon);
        match self {
            Self::Cosine => cosine(),
            Self::Solid => solid_angle(polygon) / TAU,
            Self::Upright => HALF * (MANTLE * FRAC_1_PI * FRAC_1_PI * mantle(normal, polygon) + PERSON_END * cosine()),
        }
    }
}

/// The solid angle of a convex polygon from the origin: tan(Ω/2) = a·(b×c) / (abc + a·b c + b·c a + c·a b) of each
/// triangle (van Oosterom & Strackee 1983).
pub(super) fn solid_angle(polygon: &[DVec3]) -> f64 {
    let Some((&a, rest)) = polygon.split_first() else {
        return 0.0;
    };
    let a = a.normalize_or_zero();
    rest.windows(2)
        .map(|side| {
            let (b, c) = (side[0].normalize_or_zero(), side[1].normalize_or_zero());
            2.0 * angle(a.dot(b.cross(c)).abs(), 1.0 + a.dot(b) + b.dot(c) + c.dot(a))
        })
        .sum()
}

/// Points and weights of Gauss and Legendre over −1 to 1, the positive half.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_2, 0.101_228_536_290_376_3),
];

/// ∫ sin θ dω over a convex polygon above the horizon, θ from `pole`, seen from the origin.
fn mantle(pole: DVec3, polygon: &[DVec3]) -> f64 {
    let mut sum = 0.0;
    for (k, &p) in polygon.iter().enumerate() {
        let q = polygon[(k + 1) % polygon.len()];
        let (a, b) = (p.normalize_or_zero(), q.normalize_or_zero());
        let cross = a.cross(b);
        let length = cross.length();
        if length <= 0.0 {
            continue;
        }
        let normal = cross / length;
        let turning = normal.dot(pole);
        let tangent = normal.cross(a);
        let end = angle(length, a.dot(b));
        // Nearest to the pole where the height a·pole cos s + t·pole sin s has its maximum.
        let (rise, height) = (tangent.dot(pole), a.dot(pole));
        let nearest = if rise > 0.0 { angle(rise, height) } else { 0.0 };
        let cut = nearest.clamp(0.0, end);
        for (from, to) in [(0.0, cut), (cut, end)] {
            sum += turning * along(|s| a * cosine_of(s) + tangent * sine_of(s), pole, from, to);
        }
    }
    sum.abs()
}

/// Sine and cosine by + − × only, so that rows are the same bits on every platform: Taylor's series up to π, error
/// below 1e-15.
fn sine_of(s: f64) -> f64 {
    let x = s * 0.125;
    let square = x * x;
    let mut sine = 0.0;
    let mut cosine = 0.0;
    for k in (0..9).rev() {
        let k = f64::from(k);
        sine = 1.0 - square / ((2.0 * k + 2.0) * (2.0 * k + 3.0)) * sine;
        cosine = 1.0 - square / ((2.0 * k + 1.0) * (2.0 * k + 2.0)) * cosine;
    }
    sine *= x;
    for _ in 0..3 {
        (sine, cosine) = (2.0 * sine * cosine, 1.0 - 2.0 * sine * sine);
    }
    sine
}

fn cosine_of(s: f64) -> f64 {
    let half = sine_of(0.5 * s);
    1.0 - 2.0 * half * half
}

/// ∫ G / sin²θ ds over a piece of an arc.
fn along(point: impl Fn(f64) -> DVec3, pole: DVec3, from: f64, to: f64) -> f64 {
    if to <= from {
        return 0.0;
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an arc is at most π long"
    )]
    let pieces = ((to - from) / FRAC_PI_8).ceil().max(1.0) as u32;
    let half = 0.5 * (to - from) / f64::from(pieces);
    let mut sum = 0.0;
    for piece in 0..pieces {
        let middle = from + half * f64::from(2 * piece + 1);
        for (node, weight) in GAUSS.into_iter().flat_map(|(g, w)| [(-g, w), (g, w)]) {
            let p = point(middle + half * node);
            let height = p.dot(pole);
            let flat = (p - pole * height).length();
            let theta = angle(flat, height);
            sum += half
                * weight
                * if flat < 1e-3 {
                    theta / 3.0
                } else {
                    (theta - flat * height) / (2.0 * flat * flat)
                };
        }
    }
    sum
}

/// The tables of one resolution, each made when first needed.
#[derive(Debug)]
pub(super) struct Tables {
    resolution: u32,
    tables: [OnceLock<DeltaTable>; 3],
}

impl Tables {
    pub(super) fn new(resolution: u32) -> Self {
        Self {
            resolution,
            tables: Default::default(),
        }
    }

    pub(super) fn get(&self, kernel: Kernel) -> &DeltaTable {
        self.tables[kernel as usize].get_or_init(|| kernel.table(self.resolution))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::WHOLE;
    use crate::face::Face;

    const ALL: [Kernel; 3] = [Kernel::Cosine, Kernel::Solid, Kernel::Upright];

    #[test]
    fn sines_are_the_library_s() {
        for k in 0..=1000 {
            let s = f64::from(k) * 1e-3 * std::f64::consts::PI;
            assert!(
                (sine_of(s) - s.sin()).abs() < 2e-15 && (cosine_of(s) - s.cos()).abs() < 2e-15,
                "{s}"
            );
        }
    }

    /// A triangle's integral by quadrature over its pieces.
    fn by_quadrature(kernel: Kernel, [a, b, c]: [DVec3; 3], n: u32) -> f64 {
        let across = (b - a).cross(c - a);
        let area = 0.5 * across.length() / f64::from(n * n);
        let normal = across.normalize();
        crate::frame::sample_points([a, b, c], n)
            .into_iter()
            .map(|p| {
                let r = p.length();
                area * kernel.density(p.z / r) * normal.dot(p / r).abs() / (r * r)
            })
            .sum()
    }

    #[test]
    fn closed_forms_are_what_quadrature_finds() {
        for (triangle, place) in [
            // Off the pole, round the pole, with an edge through the pole, and down to the horizon.
            ([[1.0, 0.2, 0.3], [0.4, 1.0, 0.9], [-0.1, 0.5, 1.4]], "off"),
            ([[1.0, -1.0, 0.8], [1.0, 2.0, 0.8], [-2.0, 0.0, 1.1]], "round"),
            ([[-1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, -2.0, 1.0]], "through"),
            ([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 2.0]], "down"),
        ] {
            // Counter-clockwise seen from the origin.
            let [a, b, c] = triangle.map(DVec3::from_array);
            let corners = if a.dot(b.cross(c)) < 0.0 { [a, b, c] } else { [a, c, b] };
            for kernel in ALL {
                let (closed, found) = (kernel.over(DVec3::Z, &corners), by_quadrature(kernel, corners, 1500));
                assert!((closed - found).abs() < 2e-6, "{place} {kernel:?}: {closed} {found}");
            }
        }
    }

    #[test]
    fn weights_are_the_closed_form_of_a_pixel_and_sum_to_the_whole() {
        let n = 32;
        let step = 2.0 / f64::from(n);
        for kernel in ALL {
            let table = kernel.table(n);
            assert_eq!(table.weights().iter().sum::<u32>(), WHOLE);
            for face in Face::ALL {
                let ([u, v, w], [su, sv, sw]) = face.axes();
                for y in 0..face.rows(n) {
                    for x in [0, 7, 16, 31] {
                        let low = if face.is_top() { -1.0 } else { 0.0 };
                        let (left, bottom) = (f64::from(x) * step - 1.0, f64::from(y) * step + low);
                        let corner = |dx: f64, dy: f64| {
                            let mut p = [0.0; 3];
                            p[u] = su * (left + dx);
                            p[v] = sv * (bottom + dy);
                            p[w] = sw;
                            DVec3::from_array(p)
                        };
                        let mut pixel = [
                            corner(0.0, 0.0),
                            corner(step, 0.0),
                            corner(step, step),
                            corner(0.0, step),
                        ];
                        if pixel[0].dot(pixel[1].cross(pixel[2])) > 0.0 {
                            pixel.reverse();
                        }
                        let closed = kernel.over(DVec3::Z, &pixel) * f64::from(WHOLE);
                        let weight = f64::from(table.weight(face, x, y));
                        // Two roundings, and two points of quadrature; at the zenith the mantle's density has a kink.
                        let slack = 2.0 + if kernel == Kernel::Upright { 6e-3 * closed } else { 0.0 };
                        assert!(
                            (weight - closed).abs() < slack,
                            "{kernel:?} {face:?} {x} {y}: {weight} {closed}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn densities_integrate_to_one() {
        for kernel in ALL {
            let n = 20_000;
            let sum: f64 = (0..n)
                .map(|k| TAU * kernel.density((f64::from(k) + 0.5) / f64::from(n)) / f64::from(n))
                .sum();
            assert!((sum - 1.0).abs() < 1e-5, "{kernel:?}: {sum}");
        }
    }
}
