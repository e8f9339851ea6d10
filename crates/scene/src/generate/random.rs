//! SplitMix64: Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (OOPSLA 2014), figure 14, with
//! the mixing constants of Stafford's variant 13. Integer arithmetic only, so that a seed means the same everywhere.

use glam::{DMat3, DVec3};

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub(super) struct Random {
    state: u64,
}

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    #[allow(clippy::cast_precision_loss, reason = "53 bits fit exactly")]
    pub(super) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [`low`, `high`).
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A number below `end` (0 if `end` is 0): the high half of a 128-bit product, uneven by less than `end`/2⁶⁴.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "the high half of a product with a u32 is below it"
    )]
    pub(super) fn below(&mut self, end: u32) -> u32 {
        ((u128::from(self.next()) * u128::from(end)) >> 64) as u32
    }

    /// About standard normal: the sum of twelve uniforms less 6 (Irwin–Hall), without a logarithm.
    pub(super) fn normal(&mut self) -> f64 {
        (0..12).fold(-6.0, |sum, _| sum + self.unit())
    }

    /// Uniform in the cube from −½ to ½.
    pub(super) fn in_cube(&mut self) -> DVec3 {
        let (x, y, z) = (self.unit(), self.unit(), self.unit());
        DVec3::new(x - 0.5, y - 0.5, z - 0.5)
    }

    /// A uniform rotation: a quaternion drawn from the 4-ball by rejection, without a sine.
    pub(super) fn rotation(&mut self) -> DMat3 {
        loop {
            let [w, x, y, z] = std::array::from_fn(|_| self.between(-1.0, 1.0));
            let square = w * w + x * x + y * y + z * z;
            if !(0.01..=1.0).contains(&square) {
                continue;
            }
            let s = 2.0 / square;
            return DMat3::from_cols(
                DVec3::new(1.0 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)),
                DVec3::new(s * (x * y - w * z), 1.0 - s * (x * x + z * z), s * (y * z + w * x)),
                DVec3::new(s * (x * z + w * y), s * (y * z - w * x), 1.0 - s * (x * x + y * y)),
            );
        }
    }
}

/// eˣ for |x| ≤ 20 to about 13 digits, from + × ÷ alone: the Taylor series at x/1024, squared ten times.
pub(super) fn exp(x: f64) -> f64 {
    let small = x / 1024.0;
    let mut power = (1..=10).rev().fold(1.0, |sum, n| 1.0 + sum * small / f64::from(n));
    for _ in 0..10 {
        power *= power;
    }
    power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_stream() {
        let mut random = Random::new(1_234_567);
        let stream = [(); 3].map(|()| random.next());
        assert_eq!(
            stream,
            [
                6_457_827_717_110_365_317,
                3_203_168_211_198_807_973,
                9_817_491_932_198_370_423
            ]
        );
    }

    #[test]
    fn exp_is_the_exponential() {
        for i in -200..=200 {
            let x = f64::from(i) / 10.0;
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-12, "{x}");
        }
    }

    #[test]
    fn deviates_have_their_moments() {
        let mut random = Random::new(1);
        let count = 100_000;
        let (mut mean, mut square, mut low) = (0.0, 0.0, [0u32; 7]);
        for _ in 0..count {
            let z = random.normal();
            mean += z / f64::from(count);
            square += z * z / f64::from(count);
            low[random.below(7) as usize] += 1;
        }
        assert!(mean.abs() < 0.015 && (square - 1.0).abs() < 0.02, "{mean} {square}");
        assert!(low.iter().all(|&n| n.abs_diff(count / 7) < 500), "{low:?}");
    }

    #[test]
    fn rotations_keep_lengths_angles_and_handedness() {
        let mut random = Random::new(2);
        for _ in 0..100 {
            let r = random.rotation();
            let error = r.transpose() * r - DMat3::IDENTITY;
            assert!(error.to_cols_array().iter().all(|e| e.abs() < 1e-14));
            assert!((r.determinant() - 1.0).abs() < 1e-14);
        }
    }
}
