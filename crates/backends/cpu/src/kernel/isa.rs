//! Instruction sets, chosen once by a capability token.
//!
//! [`InstructionSet`] says what kernels are compiled for and holds a token of it: [`Portable`], `Avx2` or `Avx512`.
//! Only [`InstructionSet::of`] makes one, after asking the processor, so that no call of a kernel is unsafe. The
//! generic bodies of the kernels take a token as [`Lanes`]: the few operations with a version of their own in each set.
//! The macro `compiled!` (`kernel.rs`) compiles each body three times and makes it a method of the enum; a call costs
//! one predictable branch.
//!
//! All versions perform the same operations in the same order and give the same bits: no fused multiply-add, no other
//! order of a sum. The portable version defines them; the tests compare.
//!
//! No vector types between kernels, because a caller without the feature would pass them in memory: signatures have
//! arrays, and bodies are inlined into one function with the feature.
//!
//! No macro shared with crate `hemicube`, because it compiles one body for each set, while these bodies pick versions
//! by the type of their token; shared, both would be public in the contract, for every author of a plugin.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
mod portable;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub(crate) use portable::Portable;

use super::bounds::{self, BoxGroup, GroupOnFaces, OnFaces, SceneBox};
use super::coverage::{Canvas, OrderedCoverage, Rows, lacking, mark};
use super::depth::{Chunk, DepthPlane};
use super::ordered::{BlockOnFace, DrawnLane, draw_lane};
use super::ownership::cells_of;
use super::spans::{BlockLines, EdgeLines, Spans};
use super::{FaceGrid, Frame, GROUP, Transformed};
use crate::Isa;
use hemicube_contract::bvh::LANES;
use std::ops::Range;

/// A set of instructions that this processor has.
#[derive(Clone, Copy, Debug)]
pub(crate) enum InstructionSet {
    Portable(Portable),
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
}

impl InstructionSet {
    /// Asks the processor; `None` if it lacks the set.
    pub(crate) fn of(isa: Isa) -> Option<Self> {
        match isa {
            Isa::Portable => Some(Self::Portable(Portable)),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => Avx2::detect().map(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => Avx512::detect().map(Self::Avx512),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx2 | Isa::Avx512 => None,
        }
    }
}

/// Operations with a version of their own in each instruction set, as methods of its token.
///
/// Rows are eight words of coverage bits, one a pixel row; masks have a bit for each row, lane or cell.
pub(crate) trait Lanes: Copy {
    /// Intersects eight pixel rows from `y` on with a triangle: the first column and one past the last, within
    /// `x0..x1`. Sets `out.rows` to the rows with pixels.
    fn spans(self, lines: &EdgeLines, y: f64, x0: f64, x1: f64, out: &mut Spans);

    /// Tests the pixels of `mask` in a chunk at depth `base + steps[i]`, clamped to the plane's range, and replaces the
    /// farther ones; at equal depth the smaller id wins. Returns true if any pixel was replaced.
    fn test(self, depth: &mut Chunk<f32>, items: &mut Chunk<u32>, mask: u16, base: f64, plane: &DepthPlane) -> bool;

    /// Returns true if all pixels of `mask` in a chunk are nearer than `bound`.
    fn nearer(self, depth: &Chunk<f32>, mask: u16, bound: f32) -> bool;

    /// Mask of the flags other than 0.
    fn mask(self, flags: &Flags) -> u16;

    /// Mask of the items of a chunk that differ from their left neighbour; `before` is that of the first.
    fn changes(self, items: &Chunk<u32>, before: u32) -> u16;

    /// Tests boxes against the coverage: [`bounds::test_group`].
    #[inline(always)]
    fn test_group<const COVERED: bool>(
        self,
        group: &BoxGroup,
        used: u8,
        frame: &Frame,
        canvas: &mut OrderedCoverage,
        faces: u8,
    ) -> GroupOnFaces {
        bounds::test_group::<Self, COVERED>(self, group, used, frame, canvas, faces)
    }

    /// Projects a box onto faces: [`bounds::on_faces`].
    #[inline(always)]
    fn on_faces(self, of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) {
        bounds::on_faces(of, frame, faces, touched, out);
    }

    /// Computes the edge lines of all lanes, in a set with a `draw_lane` that uses them, and marks them ready.
    #[inline(always)]
    fn block_lines(self, _triangles: &Transformed, _grid: FaceGrid, _out: &mut BlockLines) {}

    /// Covers the pixels of a lane in `columns` by `rows` of its face, and weighs the covered and the newly covered
    /// ones.
    ///
    /// Two ranges, no box, because a box stored in parts and loaded whole would wait for all of them.
    #[inline(always)]
    fn draw_lane<const COVERED: bool, C: Canvas>(
        self,
        on: &BlockOnFace<'_>,
        lane: usize,
        columns: Range<i32>,
        rows: Range<i32>,
        canvas: &mut C,
    ) -> DrawnLane {
        draw_lane::<Self, COVERED, C>(self, on, lane, columns, rows, canvas)
    }

    /// Mask of the words that lack a bit of `mask`.
    #[inline(always)]
    fn lacking(self, rows: &[u64; GROUP], mask: u64) -> u8 {
        lacking(rows, mask)
    }

    /// Covers the part of eight spans in one column of words. Writes the newly covered bits to `shows` and the others
    /// to `over`; returns the rows with any of the first, and with any of the second.
    #[inline(always)]
    fn mark(self, spans: &Spans, column: usize, covered: &mut Rows, shows: &mut Rows, over: &mut Rows) -> (u8, u8) {
        mark(spans, column, covered, shows, Some(over))
    }

    /// Mask of the 64 bytes of eight words that are not 0, from the lowest byte of the first word on.
    #[inline(always)]
    fn occupied(self, rows: &[u64; GROUP]) -> u64 {
        (0..GROUP).fold(0, |any, r| any | u64::from(cells_of(rows[r])) << (8 * r))
    }

    /// Mask of the words with a bit of `with`.
    #[inline(always)]
    fn any_of(self, words: &[u64; GROUP], with: u64) -> u8 {
        (0..GROUP).fold(0, |any, k| any | u8::from(words[k] & with != 0) << k)
    }

    /// Moves the bits of `left` in `shows` to `common`. Returns the rows with any of them, and the bytes with bits
    /// left, like [`Self::occupied`].
    #[inline(always)]
    fn common(self, shows: &[u64; GROUP], left: &mut [u64; GROUP], common: &mut [u64; GROUP]) -> (u8, u64) {
        let mut rows = 0;
        for r in 0..GROUP {
            common[r] = shows[r] & left[r];
            left[r] &= !shows[r];
            rows |= u8::from(common[r] != 0) << r;
        }
        (rows, self.occupied(left))
    }

    /// Number of pixels of the non-empty spans.
    #[inline(always)]
    fn pixels_of(self, spans: &Spans) -> u32 {
        let mut pixels = 0;
        for r in 0..GROUP {
            if spans.rows >> r & 1 != 0 {
                pixels += spans.ends[r].wrapping_sub(spans.starts[r]).cast_unsigned();
            }
        }
        pixels
    }

    /// Mask of the words with a bit beyond those of `others`.
    #[inline(always)]
    fn beyond(self, rows: &[u64; GROUP], others: &[u64; GROUP]) -> u8 {
        let mut any = 0;
        for r in 0..GROUP {
            any |= u8::from(rows[r] & !others[r] != 0) << r;
        }
        any
    }

    /// Writes the bits of eight words in `mask` to `out`; returns the words with any.
    #[inline(always)]
    fn restrict(self, rows: &[u64; GROUP], mask: u64, out: &mut [u64; GROUP]) -> u8 {
        let mut any = 0;
        for r in 0..GROUP {
            out[r] = rows[r] & mask;
            any |= u8::from(out[r] != 0) << r;
        }
        any
    }

    /// Union of eight words.
    #[inline(always)]
    fn columns(self, rows: &[u64; GROUP]) -> u64 {
        rows.iter().fold(0, |all, &bits| all | bits)
    }

    /// Mask of the places with a[k] ≤ b[k].
    #[inline(always)]
    fn up_to(self, a: &[f32; GROUP], b: &[f32; GROUP]) -> u8 {
        let mut cells = 0;
        for k in 0..GROUP {
            cells |= u8::from(a[k] <= b[k]) << k;
        }
        cells
    }
}

/// A flag for each lane, 0 or 1.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Flags(pub(crate) [u32; LANES]);
