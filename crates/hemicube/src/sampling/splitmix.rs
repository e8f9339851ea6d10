//! SplitMix64 (Steele, Lea & Flood 2014): the hash behind all seeded random numbers.

/// Increment of a stream's state.
pub(crate) const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

/// The finaliser: numbers differing in one bit get unrelated hashes.
#[inline]
pub(crate) fn hash(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The next number of a stream.
#[inline]
pub(crate) fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(STEP);
    hash(*state)
}

/// A number in [0, 1) from the upper 32 bits, exact in f64.
#[inline]
pub(crate) fn unit(bits: u64) -> f64 {
    f64::from((bits >> 32) as u32) / 4_294_967_296.0
}
