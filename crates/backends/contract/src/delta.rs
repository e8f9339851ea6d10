//! Delta form factors: the contribution of each pixel of a hemicube, integrated over the pixel in closed form, in
//! integers.
//!
//! A pixel of the top face covers ∬ dx dy / (π (x²+y²+1)²), one of a side face ∬ z dy dz / (π (y²+z²+1)²) (Cohen &
//! Greenberg 1985, eq. 6 and 7, before their midpoint rule). Over the rectangle from the axis to (a, b) these are
//!
//! ```text
//! top:  (1/2π) [ a/√(1+a²) atan(b/√(1+a²)) + b/√(1+b²) atan(a/√(1+b²)) ]
//! side: (1/2π) [ atan a − 1/√(1+b²) atan(a/√(1+b²)) ]
//! ```
//!
//! (Howell's catalogue, B-3 and B-4): a pixel is a difference of four values. Weights are differences of the rounded
//! running sum over a face. Rounding cannot pile up along a span, and the total is exact: the top and four equal sides
//! sum to 2³¹.
//!
//! No running sum over the whole atlas, because with one sum a face the four sides share a table of half the size. The
//! total stays exactly 2³¹.

use crate::backend::{RESOLUTIONS, WHOLE};
use crate::face::Face;

/// The weights of a hemicube's pixels, as running sums: the weight of pixels `x0..x1` of a row is a difference.
///
/// ```
/// use hemicube_contract::backend::WHOLE;
/// use hemicube_contract::delta::DeltaTable;
/// use hemicube_contract::face::Face;
///
/// let table = DeltaTable::new(64);
/// assert_eq!(table.weights().iter().sum::<u32>(), WHOLE, "a hemicube's form factors sum to 1, exactly");
///
/// // The top has (4 / π√2) atan(1/√2) of it, and its middle more than its corner.
/// let top = f64::from(table.running(Face::Top)[64 * 64]) / f64::from(WHOLE);
/// assert!((top - 0.554_126).abs() < 1e-6, "{top}");
/// assert!(table.weight(Face::Top, 32, 32) > 2 * table.weight(Face::Top, 0, 0));
/// assert_eq!(table.span(Face::NegY, 9, 0, 64), (0..64).map(|x| table.weight(Face::NegY, x, 9)).sum::<u32>());
/// ```
#[derive(Clone, Debug)]
pub struct DeltaTable {
    resolution: u32,
    /// Running sum over the top face, row by row; N² + 1 entries.
    top: Vec<u32>,
    /// Running sum over one side face, row by row; N²/2 + 1 entries. The four sides are alike.
    side: Vec<u32>,
}

impl DeltaTable {
    /// The table for a resolution.
    ///
    /// # Panics
    /// When the resolution is not a multiple of 16 in [`RESOLUTIONS`].
    pub fn new(resolution: u32) -> Self {
        assert!(
            is_resolution(resolution),
            "resolution {resolution} is not a multiple of 16 in {RESOLUTIONS:?}"
        );
        let side_share = side_corner(1.0, 1.0) * 2.0;
        let side_weight = round_weight(side_share * f64::from(WHOLE));
        let top_weight = WHOLE - 4 * side_weight;
        let step = 2.0 / f64::from(resolution);
        let at = |k: u32| f64::from(k) * step;
        let across: Vec<f64> = (0..resolution).map(|x| at(x) - 1.0).collect();
        let up: Vec<f64> = (0..resolution / 2).map(at).collect();
        Self {
            resolution,
            top: scaled(&sums_of_rectangles(top_corner, &across, &across, step), top_weight),
            side: scaled(&sums_of_rectangles(side_corner, &across, &up, step), side_weight),
        }
    }

    /// The table of other weights than form factors: `share` is the integral of their density over a pixel, of the top
    /// (true) or of a side, from its lower left corner (u₀, v₀) with edges of `step` on a face at distance 1. Shares
    /// need not sum to 1: they are scaled, and rounded as running sums, so that the whole is 2³¹ exactly.
    ///
    /// ```
    /// use hemicube_contract::backend::WHOLE;
    /// use hemicube_contract::delta::DeltaTable;
    /// use hemicube_contract::face::Face;
    ///
    /// // Solid angles: the top of half a cube has a third of the half sphere.
    /// let solid = DeltaTable::of(64, |_top, [u, v], step| {
    ///     let r = 1.0 + (u + 0.5 * step).powi(2) + (v + 0.5 * step).powi(2);
    ///     step * step / (r * r.sqrt())
    /// });
    /// assert_eq!(solid.weights().iter().sum::<u32>(), WHOLE);
    /// let top = f64::from(solid.running(Face::Top)[64 * 64]) / f64::from(WHOLE);
    /// assert!((top - 1.0 / 3.0).abs() < 1e-4, "{top}");
    /// ```
    ///
    /// # Panics
    /// When the resolution is not a multiple of 16 in [`RESOLUTIONS`].
    pub fn of(resolution: u32, share: impl Fn(bool, [f64; 2], f64) -> f64) -> Self {
        assert!(
            is_resolution(resolution),
            "resolution {resolution} is not a multiple of 16 in {RESOLUTIONS:?}"
        );
        let step = 2.0 / f64::from(resolution);
        let at = |k: u32| f64::from(k) * step;
        let top = sums(resolution, resolution, |x, y| {
            share(true, [at(x) - 1.0, at(y) - 1.0], step)
        });
        let side = sums(resolution, resolution / 2, |x, y| {
            share(false, [at(x) - 1.0, at(y)], step)
        });
        let whole = last(&top) + 4.0 * last(&side);
        let side_weight = round_weight(last(&side) / whole * f64::from(WHOLE));
        Self {
            resolution,
            top: scaled(&top, WHOLE - 4 * side_weight),
            side: scaled(&side, side_weight),
        }
    }

    /// Pixels along the edge of the top face.
    pub fn resolution(&self) -> u32 {
        self.resolution
    }

    /// The running sum of a face, row by row: rows × N + 1 entries.
    pub fn running(&self, face: Face) -> &[u32] {
        if face.is_top() { &self.top } else { &self.side }
    }

    /// Lists the weight of every pixel of the atlas, row by row: 3N², for devices.
    pub fn weights(&self) -> Vec<u32> {
        let of_face = |face| self.running(face).windows(2).map(|sums| sums[1] - sums[0]);
        Face::ALL.into_iter().flat_map(of_face).collect()
    }

    /// The weight of one pixel; `x` to the right, `y` up, from 0.
    pub fn weight(&self, face: Face, x: u32, y: u32) -> u32 {
        self.span(face, y, x, x + 1)
    }

    /// The weight of the pixels `x0..x1` of row `y`.
    pub fn span(&self, face: Face, y: u32, x0: u32, x1: u32) -> u32 {
        let running = self.running(face);
        let row = y as usize * self.resolution as usize;
        running[row + x1 as usize] - running[row + x0 as usize]
    }
}

/// Returns whether hemicubes can be rendered at this resolution.
pub fn is_resolution(resolution: u32) -> bool {
    RESOLUTIONS.contains(&resolution) && resolution.is_multiple_of(16)
}

fn round_weight(weight: f64) -> u32 {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "weights lie in 0..=2³¹"
    )]
    let rounded = weight.round() as u32;
    rounded
}

/// The running sum of the pixels' shares, row by row, from 0.
fn sums(width: u32, height: u32, share: impl Fn(u32, u32) -> f64) -> Vec<f64> {
    let mut sums = Vec::with_capacity(width as usize * height as usize + 1);
    let mut sum = 0.0;
    sums.push(sum);
    for y in 0..height {
        for x in 0..width {
            sum += share(x, y);
            sums.push(sum);
        }
    }
    sums
}

/// A running sum scaled to end at `total`, and rounded.
fn scaled(sums: &[f64], total: u32) -> Vec<u32> {
    let scale = f64::from(total) / last(sums);
    sums.iter().map(|s| round_weight(s * scale)).collect()
}

fn last(sums: &[f64]) -> f64 {
    sums.last().copied().unwrap_or(0.0)
}

/// The running sum over pixels that begin at `lefts` and `lows`, from the integral from the axis to a corner. A corner
/// is evaluated once where the pixels that meet there have it at the same coordinates to the bit.
fn sums_of_rectangles(corner: impl Fn(f64, f64) -> f64, lefts: &[f64], lows: &[f64], step: f64) -> Vec<f64> {
    // Of each pixel of a row, the integrals to its left and to its right corner.
    let along = |b: f64, found: &mut Vec<[f64; 2]>| {
        found.clear();
        let mut before = None;
        for &left in lefts {
            let right = left + step;
            let to_left = match before {
                Some((at, integral)) if at == left => integral,
                _ => corner(left, b),
            };
            let to_right = corner(right, b);
            found.push([to_left, to_right]);
            before = Some((right, to_right));
        }
    };
    let (mut below, mut above) = (Vec::new(), Vec::new());
    let mut highest = None;
    let mut sums = Vec::with_capacity(lefts.len() * lows.len() + 1);
    let mut sum = 0.0;
    sums.push(sum);
    for &low in lows {
        if highest == Some(low) {
            std::mem::swap(&mut below, &mut above);
        } else {
            along(low, &mut below);
        }
        let high = low + step;
        along(high, &mut above);
        for ([a0b0, a1b0], [a0b1, a1b1]) in below.iter().zip(&above) {
            sum += (a1b1 - a0b1) - (a1b0 - a0b0);
            sums.push(sum);
        }
        highest = Some(high);
    }
    sums
}

fn top_corner(a: f64, b: f64) -> f64 {
    let (p, q) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
    (a / p * atan(b / p) + b / q * atan(a / q)) / std::f64::consts::TAU
}

fn side_corner(a: f64, b: f64) -> f64 {
    let q = (1.0 + b * b).sqrt();
    (atan(a) - atan(a / q) / q) / std::f64::consts::TAU
}

/// Arc tangent by + − × ÷ √ only, so that tables are the same bits on every platform: three half-angle steps (tan(θ/2)
/// = t / (1 + √(1+t²))), then the Taylor series. Error below 4e-16.
fn atan(t: f64) -> f64 {
    let mut x = t;
    for _ in 0..3 {
        x /= 1.0 + (1.0 + x * x).sqrt();
    }
    // |x| ≤ tan(π/16) < 0.2: 0.2²⁵/25 < 1e-19.
    let y = x * x;
    let mut sum = 0.0;
    for k in (0..12).rev() {
        let coefficient = 1.0 / f64::from(2 * k + 1);
        sum = coefficient - y * sum;
    }
    8.0 * x * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arc_tangent_is_the_library_s() {
        for k in -4000..4000 {
            let t = f64::from(k) * 0.001;
            assert!(
                (atan(t) - t.atan()).abs() <= 5e-16 * (1.0 + t.atan().abs()),
                "{t}: {} {}",
                atan(t),
                t.atan()
            );
        }
    }

    #[test]
    fn the_weights_of_the_atlas_are_those_of_its_pixels_and_sum_to_the_whole() {
        let table = DeltaTable::new(32);
        let weights = table.weights();
        assert_eq!(weights.len(), 3 * 32 * 32);
        assert_eq!(weights.iter().sum::<u32>(), WHOLE);
        let row = Face::NegX.first_row(32) + 5;
        assert_eq!(weights[(row * 32 + 7) as usize], table.weight(Face::NegX, 7, 5));
    }

    #[test]
    fn the_whole_is_exact_at_every_resolution() {
        for resolution in (16..=256).step_by(16).chain([512, 1024]) {
            let table = DeltaTable::new(resolution);
            let face_total = |face: Face| table.running(face).last().copied().expect("never empty");
            assert_eq!(
                face_total(Face::Top) + 4 * face_total(Face::PosX),
                WHOLE,
                "N = {resolution}"
            );
            for face in [Face::Top, Face::PosX] {
                assert!(table.running(face).is_sorted(), "a negative weight at N = {resolution}");
                assert_eq!(
                    table.running(face).len(),
                    (resolution * face.rows(resolution) + 1) as usize
                );
            }
        }
    }

    #[test]
    fn pixels_agree_with_numerical_integration() {
        // 8-point Gauss–Legendre in each direction is exact to rounding on a pixel this small.
        let resolution = 32;
        let table = DeltaTable::new(resolution);
        let nodes = [
            (0.183_434_642_495_649_8, 0.362_683_783_378_362),
            (0.525_532_409_916_329, 0.313_706_645_877_887_3),
            (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
            (0.960_289_856_497_536_2, 0.101_228_536_290_376_3),
        ];
        let step = 2.0 / f64::from(resolution);
        for face in [Face::Top, Face::PosX] {
            for y in 0..face.rows(resolution) {
                for x in 0..resolution {
                    let (u0, v0) = (
                        f64::from(x) * step - 1.0,
                        f64::from(y) * step - if face.is_top() { 1.0 } else { 0.0 },
                    );
                    let mut sum = 0.0;
                    for (gu, wu) in nodes.iter().flat_map(|&(g, w)| [(g, w), (-g, w)]) {
                        for (gv, wv) in nodes.iter().flat_map(|&(g, w)| [(g, w), (-g, w)]) {
                            let (u, v) = (u0 + step * 0.5 * (1.0 + gu), v0 + step * 0.5 * (1.0 + gv));
                            let r = u * u + v * v + 1.0;
                            let cosine = if face.is_top() { 1.0 } else { v };
                            sum += wu * wv * cosine / (std::f64::consts::PI * r * r);
                        }
                    }
                    let exact = sum * step * step / 4.0 * f64::from(WHOLE);
                    // Two roundings of the running sum, and the scaling of each face to its whole weight.
                    assert!(
                        (f64::from(table.weight(face, x, y)) - exact).abs() < 1.6,
                        "{face:?} {x} {y}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_wrong_table_would_be_noticed() {
        // The midpoint rule overshoots the unit sum by 5.3e-4 at N = 32: the closed form must not.
        let step = 2.0 / 32.0;
        let mut sum = 0.0;
        for y in 0..32 {
            for x in 0..32 {
                let (u, v) = ((f64::from(x) + 0.5) * step - 1.0, (f64::from(y) + 0.5) * step - 1.0);
                let r = u * u + v * v + 1.0;
                sum += step * step / (std::f64::consts::PI * r * r);
            }
        }
        let table = DeltaTable::new(32);
        let closed = f64::from(*table.running(Face::Top).last().expect("never empty")) / f64::from(WHOLE);
        let exact = 4.0 * top_corner(1.0, 1.0);
        assert!((closed - exact).abs() < 1e-9);
        assert!((sum - exact).abs() > 1e-5, "the midpoint rule is not exact");
    }
}
