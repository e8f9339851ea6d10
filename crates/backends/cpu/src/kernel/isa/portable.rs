//! The portable version: the definition of the arithmetic that the others must reproduce.

use super::{Flags, Lanes};
use crate::kernel::GROUP;
use crate::kernel::depth::{Chunk, DepthPlane};
use crate::kernel::spans::{EdgeLines, Spans};
use hemicube_contract::bvh::LANES;

/// Token of the instructions that the target guarantees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Lanes for Portable {
    #[inline(always)]
    fn spans(self, lines: &EdgeLines, y: f64, x0: f64, x1: f64, out: &mut Spans) {
        let mut low = [x0; GROUP];
        let mut high = [x1; GROUP];
        for k in 0..3 {
            let (slope, offset) = (lines.slope[k], lines.offset[k]);
            if lines.left[k] != 0 {
                for (r, low) in low.iter_mut().enumerate() {
                    let x = slope * (y + r as f64) + offset;
                    *low = if x > *low { x } else { *low };
                }
            } else if lines.right[k] != 0 {
                for (r, high) in high.iter_mut().enumerate() {
                    let x = slope * (y + r as f64) + offset;
                    *high = if x < *high { x } else { *high };
                }
            }
        }
        out.rows = 0;
        for r in 0..GROUP {
            let low = if low[r] < x1 { low[r] } else { x1 };
            let high = if high[r] > x0 { high[r] } else { x0 };
            out.starts[r] = ceil(low);
            out.ends[r] = ceil(high);
            out.rows |= u8::from(out.starts[r] < out.ends[r]) << r;
        }
    }

    #[inline(always)]
    fn test(self, depth: &mut Chunk<f32>, items: &mut Chunk<u32>, mask: u16, base: f64, plane: &DepthPlane) -> bool {
        let mut any = false;
        let mut left = mask;
        while left != 0 {
            let l = left.trailing_zeros() as usize;
            left &= left - 1;
            #[allow(clippy::cast_possible_truncation, reason = "rounding is wanted")]
            let z = (base + plane.steps[l]) as f32;
            let z = if z > plane.plane.low { z } else { plane.plane.low };
            let z = if z < plane.plane.high { z } else { plane.plane.high };
            let old = depth.0[l];
            if z > old || (z == old && plane.id < items.0[l]) {
                depth.0[l] = z;
                items.0[l] = plane.id;
                any = true;
            }
        }
        any
    }

    #[inline(always)]
    fn nearer(self, depth: &Chunk<f32>, mask: u16, bound: f32) -> bool {
        let mut nearer = 0;
        for l in 0..LANES {
            nearer |= u16::from(depth.0[l] > bound) << l;
        }
        nearer & mask == mask
    }

    #[inline(always)]
    fn mask(self, flags: &Flags) -> u16 {
        flags
            .0
            .iter()
            .enumerate()
            .fold(0, |mask, (l, &flag)| mask | u16::from(flag != 0) << l)
    }

    #[inline(always)]
    fn changes(self, items: &Chunk<u32>, before: u32) -> u16 {
        let mut mask = u16::from(items.0[0] != before);
        for l in 1..LANES {
            mask |= u16::from(items.0[l] != items.0[l - 1]) << l;
        }
        mask
    }
}

/// ⌈x⌉ of a pixel position.
#[inline(always)]
fn ceil(x: f64) -> i32 {
    // SAFETY: spans are clamped to their pixel box, by comparisons that NaN fails.
    let i: i32 = unsafe { x.to_int_unchecked() };
    i + i32::from(f64::from(i) < x)
}
