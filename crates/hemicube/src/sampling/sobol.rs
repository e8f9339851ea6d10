//! Points of four dimensions for rays: Sobol's sequence, scrambled.
//!
//! No crate for it, because the hot loop wants sixteen points of four dimensions at once, a structure of arrays for
//! SIMD, the same bits on every machine, and no allocation.

use super::splitmix;

/// Number of points made at once.
pub(crate) const BATCH: usize = 16;

/// Points that fill the four-dimensional unit cube evenly at any number: Sobol's sequence (1967; direction numbers of
/// Joe & Kuo 2008), each dimension's digits permuted in nested order (Owen 1995) by a hash of the seed (Laine & Karras
/// 2011, Burley 2020).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sequence([u32; 4]);

impl Sequence {
    pub(crate) fn new(seed: u64) -> Self {
        let mut state = seed;
        Self(std::array::from_fn(|_| (splitmix::next(&mut state) >> 32) as u32))
    }

    /// The points `at..at + 16`, where `at` is a multiple of 16; each dimension by itself.
    #[inline(always)]
    pub(crate) fn points(&self, at: usize) -> [[f64; BATCH]; 4] {
        let mut out = [[0.0; BATCH]; 4];
        for d in 0..4 {
            let mut first = 0;
            for bit in FIRST_BITS..u32::BITS as usize {
                if at >> bit & 1 != 0 {
                    first ^= DIRECTIONS[d][bit];
                }
            }
            for l in 0..BATCH {
                // The last digit first: carries of products move on to less significant digits.
                let mut x = (first ^ FIRST[d][l]).wrapping_add(self.0[d]);
                x ^= x.wrapping_mul(0x6c50_b47c);
                x ^= x.wrapping_mul(0xb82f_1e52);
                x ^= x.wrapping_mul(0xc7af_e638);
                x ^= x.wrapping_mul(0x8d22_f6e6);
                out[d][l] = (f64::from(x.reverse_bits()) + 0.5) * (1.0 / 4_294_967_296.0);
            }
        }
        out
    }
}

/// The direction numbers of each bit of a point's index, the least significant digit first.
const DIRECTIONS: [[u32; 32]; 4] = directions();

/// Combined direction numbers of each value of an index's last four bits.
const FIRST: [[u32; BATCH]; 4] = {
    let mut first = [[0; BATCH]; 4];
    let mut d = 0;
    while d < 4 {
        let mut index = 0;
        while index < BATCH {
            let mut bit = 0;
            while bit < FIRST_BITS {
                if index >> bit & 1 != 0 {
                    first[d][index] ^= DIRECTIONS[d][bit];
                }
                bit += 1;
            }
            index += 1;
        }
        d += 1;
    }
    first
};
const FIRST_BITS: usize = BATCH.trailing_zeros() as usize;

/// From primitive polynomials of degree 0 to 3 and their first numbers (Joe & Kuo 2008, table of the first dimensions).
const fn directions() -> [[u32; 32]; 4] {
    // The polynomial's inner coefficients, and as many numbers as its degree.
    const INNER: [u32; 4] = [0, 0, 1, 1];
    const NUMBERS: [&[u32]; 4] = [&[], &[1], &[1, 3], &[1, 3, 1]];
    let mut directions = [[0u32; 32]; 4];
    let mut d = 0;
    while d < 4 {
        let degree = NUMBERS[d].len();
        let mut found = [0u32; 32];
        let mut bit = 0;
        while bit < 32 {
            found[bit] = if degree == 0 {
                1 << (31 - bit)
            } else if bit < degree {
                NUMBERS[d][bit] << (31 - bit)
            } else {
                let mut next = found[bit - degree] ^ (found[bit - degree] >> degree);
                let mut k = 1;
                while k < degree {
                    if INNER[d] >> (degree - 1 - k) & 1 != 0 {
                        next ^= found[bit - k];
                    }
                    k += 1;
                }
                next
            };
            directions[d][bit] = found[bit].reverse_bits();
            bit += 1;
        }
        d += 1;
    }
    directions
}

/// Folds the unit square along its diagonal into a triangle. Neighbouring points stay neighbours.
#[inline(always)]
pub(crate) fn fold(u: f64, v: f64) -> (f64, f64) {
    let outside = u + v > 1.0;
    (if outside { 1.0 - v } else { u }, if outside { 1.0 - u } else { v })
}
