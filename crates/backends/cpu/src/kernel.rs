//! Kernels: the arithmetic of the engines, written once and compiled for each instruction set.
//!
//! ```text
//! transform   triangles in a hemicube's frame, sixteen at a time
//! projection  bounding boxes of triangles on a face
//! bounds      bounding boxes of nodes on the five faces, and their test against the coverage
//! spans       edges as lines; the pixels of a triangle, eight rows at a time
//! depth       depth buffer, depth test, reduction                       engines `depth`
//! coverage    one bit a pixel                                           engines `order` and `claims`
//! ordered     drawing front to back into coverage                       engine `order`
//! ownership   coverage with an owner for each pixel                     engine `claims`
//! sums        weights by patch
//! isa         instruction sets
//! ```
//!
//! Homogeneous rasterisation (Olano & Greer 1997): a pixel's direction d is inside a triangle with corners v0, v1, v2
//! seen from the origin iff d · (v_i × v_j) has one sign for the three edges. No near plane and no clipping. The edge
//! vectors are computed once for all five faces, in f64 and without fused multiply-add, so that two triangles compute
//! the same bits for a shared edge, with opposite signs: every pixel centre belongs to exactly one of them. 1/w is
//! affine in the pixel and serves as depth: greater is nearer, 0 is nothing.
//!
//! No f32 spans, because f32 knows a pixel position near 256 to some 1e-5, enough to lose a pixel at a corner once in a
//! while, and the rows of a closed room must sum to 1 exactly.

mod bounds;
mod coverage;
mod depth;
mod isa;
mod ordered;
mod ownership;
mod projection;
mod spans;
mod sums;
mod transform;

pub(crate) use bounds::{BOXES, BoxGroup, GroupOnFaces, OnFaces, SceneBox};
pub(crate) use coverage::{Coverage, OrderedCoverage, Recorded};
pub(crate) use depth::{DepthBuffer, Drawn, is_small, subpixel_slack};
pub(crate) use isa::InstructionSet;
pub(crate) use ordered::{Cut, Pass, Shown, Turns};
pub(crate) use ownership::OwnershipBuffer;
pub(crate) use sums::{PatchSet, RunIndex, Sums};
pub(crate) use transform::{Centroids, Transformed};

use depth::Chunk;
use hemicube_contract::bvh::Block;
use hemicube_contract::bvh::LANES;
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::Face;
#[cfg(target_arch = "x86_64")]
use isa::{Avx2, Avx512};
use isa::{Flags, Lanes};

/// Pixel rows that are rasterised together: the height of a tile.
pub(crate) const GROUP: usize = 8;

/// Number of pixels and their weight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Count {
    pub(crate) pixels: u32,
    pub(crate) weight: u32,
}

/// A box of the atlas in pixels: x0, x1, y0, y1, inclusive.
pub(crate) type AtlasBox = [usize; 4];

/// A hemicube's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) origin: [f64; 3],
    /// Tangent, bitangent, normal.
    pub(crate) axes: [[f64; 3]; 3],
    /// The transposed axes, a fourth component of 0 added.
    pub(crate) columns: [[f64; 4]; 3],
    /// Heights above the emitter's plane up to this count as 0.
    pub(crate) tolerance: f64,
    /// The emitting patch, or `UNUSED`.
    pub(crate) emitter: u32,
    /// Pixels along the edge of the top face, at most 1024.
    pub(crate) resolution: usize,
}

impl Frame {
    pub(crate) fn new(origin: [f64; 3], axes: [[f64; 3]; 3], tolerance: f64, emitter: u32, resolution: usize) -> Self {
        Self {
            origin,
            axes,
            columns: three(|c| [axes[0][c], axes[1][c], axes[2][c], 0.0]),
            tolerance,
            emitter,
            resolution,
        }
    }
}

/// The pixels of a face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FaceGrid {
    pub(crate) face: Face,
    pub(crate) resolution: usize,
}

impl FaceGrid {
    #[inline(always)]
    pub(crate) fn new(face: Face, resolution: usize) -> Self {
        Self { face, resolution }
    }

    /// Rows of pixels.
    #[inline(always)]
    pub(crate) fn height(self) -> usize {
        if self.face.is_top() {
            self.resolution
        } else {
            self.resolution / 2
        }
    }

    /// The face's first row in the atlas.
    #[inline(always)]
    pub(crate) fn first_row(self) -> usize {
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024")]
        let row = self.face.first_row(self.resolution as u32);
        row as usize
    }
}

/// Iterates over the places of the set bits, ascending.
#[inline(always)]
pub(crate) fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let place = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            place
        })
    })
}

/// Lanes of a block to be drawn on a face.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LanesOnFace<'a> {
    pub(crate) triangles: &'a Transformed,
    pub(crate) face: Face,
    pub(crate) lanes: u16,
}

/// Mask of the face that an atlas row belongs to.
pub(crate) fn face_of_row(row: usize, resolution: usize) -> u8 {
    let sides = 2 * row.saturating_sub(resolution) / resolution;
    if row < resolution { 1 } else { 2 << sides }
}

/// Prefetches a value into the first-level cache.
#[inline(always)]
pub(crate) fn prefetch<T>(of: &T) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..size_of::<T>().div_ceil(64) {
        // SAFETY: a hint, with an address inside the value.
        unsafe {
            std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(
                std::ptr::from_ref(of).cast::<i8>().add(line * 64),
            );
        }
    }
}

/// `[f(0), f(1), f(2)]`: the library's `map` is left as a call in these kernels.
#[inline(always)]
pub(crate) fn three<T>(mut f: impl FnMut(usize) -> T) -> [T; 3] {
    [f(0), f(1), f(2)]
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Makes each function a method of [`InstructionSet`]: its `#[inline(always)]` body, compiled once for every set.
macro_rules! compiled {
    ($(
        $(#[$doc:meta])*
        fn $name:ident $([$flag:ident])? ($($arg:ident: $type:ty),* $(,)?) $(-> $out:ty)? = $($body:ident)::+;
    )*) => {
        impl InstructionSet {
            $(
                $(#[$doc])*
                #[inline]
                pub(crate) fn $name$(<const $flag: bool>)?(self, $($arg: $type),*) $(-> $out)? {
                    #[cfg(target_arch = "x86_64")]
                    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,bmi1,bmi2,lzcnt,popcnt")]
                    fn avx512$(<const $flag: bool>)?(isa: Avx512, $($arg: $type),*) $(-> $out)? {
                        $($body)::+::<_ $(, $flag)?>(isa, $($arg),*)
                    }
                    #[cfg(target_arch = "x86_64")]
                    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
                    fn avx2$(<const $flag: bool>)?(isa: Avx2, $($arg: $type),*) $(-> $out)? {
                        $($body)::+::<_ $(, $flag)?>(isa, $($arg),*)
                    }
                    match self {
                        Self::Portable(isa) => $($body)::+::<_ $(, $flag)?>(isa, $($arg),*),
                        // SAFETY: the token proves that the processor has the features.
                        #[cfg(target_arch = "x86_64")]
                        Self::Avx2(isa) => unsafe { avx2$(::<$flag>)?(isa, $($arg),*) },
                        // SAFETY: the token proves that the processor has the features.
                        #[cfg(target_arch = "x86_64")]
                        Self::Avx512(isa) => unsafe { avx512$(::<$flag>)?(isa, $($arg),*) },
                    }
                }
            )*
        }
    };
}

compiled! {
    /// Transforms a block into a frame.
    fn transform(block: &Block, frame: &Frame, out: &mut Transformed) = transform::transform;

    /// Projects the centroids of sixteen triangles.
    fn centroids(triangles: &Transformed, frame: &Frame, out: &mut Centroids) = transform::centroids;

    /// Projects a box onto `faces`: with `touched` the pixels that it touches, otherwise those with a centre that it
    /// may cover.
    fn on_faces(of: &SceneBox, frame: &Frame, faces: u8, touched: bool, out: &mut OnFaces) = bounds::project;

    /// Tests the boxes in `used` against the coverage. With `COVERED`, a box stands for all pixels that it touches, and
    /// the coverage of leaves that may be seen is added to the snapshot.
    fn test_group[COVERED](
        group: &BoxGroup, used: u8, frame: &Frame, canvas: &mut OrderedCoverage, faces: u8,
    ) -> GroupOnFaces = bounds::test;

    /// Draws lanes of a block on a face into the depth buffer. With `COUNT`, adds each lane's covered pixels to
    /// `pixels`.
    fn draw_depth[COUNT](
        lanes: LanesOnFace<'_>, target: &mut DepthBuffer, pixels: &mut [u32; LANES],
    ) -> Drawn = depth::draw;

    /// Returns true if every pixel of a box is nearer than `bound`.
    fn all_nearer(depth: &[Chunk<f32>], chunks_per_row: usize, pixels: AtlasBox, bound: f32) -> bool
        = depth::all_nearer;

    /// The farthest depth in a tile; `first` is its first chunk.
    fn tile_depth(depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32 = depth::tile_depth;

    /// Adds up the weights of each id, and clears the buffer for the next hemicube while each chunk is in cache. With
    /// indexed ids, clears nothing and lists their runs of pixels.
    fn reduce(target: &mut DepthBuffer, table: &DeltaTable, sums: &mut Sums) = depth::reduce;

    /// Draws lanes of a block on a face with ownership of pixels. With `COUNT`, adds each lane's covered pixels to
    /// `pixels`.
    fn draw_owned[COUNT](
        lanes: LanesOnFace<'_>, buffer: &mut OwnershipBuffer, running: &[u32], pixels: &mut [u32; LANES],
    ) -> Drawn = ownership::draw;

    /// Returns true if every pixel of a box on a face is owned by a triangle nearer than `bound`.
    fn is_hidden(buffer: &OwnershipBuffer, face: Face, pixels: AtlasBox, bound: f32) -> bool = ownership::is_hidden;

    /// Adds the pixels and the weight of each of some lanes alone, over some faces.
    fn cover_lanes(
        triangles: &Transformed, lanes: u16, faces: u8, table: &DeltaTable, out: &mut [Count; LANES],
    ) = ordered::cover_lanes;

    /// Draws a block front to back.
    fn draw_ordered[COVERED](
        triangles: &mut Transformed, pass: Pass<'_>, canvas: &mut OrderedCoverage, table: &DeltaTable,
    ) -> Shown = ordered::draw;

    /// Draws patches into the uncovered pixels of their parent triangle.
    fn draw_patches[COVERED](
        triangles: &mut Transformed, pass: Pass<'_>, canvas: &mut Coverage, table: &DeltaTable,
    ) -> Shown = ordered::draw;

    /// Lanes with a centroid above the horizon, on `faces`, at an uncovered pixel.
    fn uncovered_centroids(triangles: &Transformed, lanes: u16, faces: u8, coverage: &Coverage) -> u16
        = ordered::uncovered_centroids;

    /// Conservative mask of the lanes that may touch, on `faces`, a pixel uncovered at the last snapshot.
    fn may_touch_uncovered(triangles: &Transformed, lanes: u16, faces: u8, snapshot: &Coverage) -> u16
        = ordered::may_touch_uncovered;

    /// Lanes with a box of pixels on exactly one of `faces`, all of them uncovered.
    fn wholly_uncovered(triangles: &Transformed, faces: u8, coverage: &Coverage) -> u16 = ordered::wholly_uncovered;

    /// Returns true if every pixel of a box is covered.
    fn all_covered(coverage: &Coverage, pixels: AtlasBox) -> bool = coverage::all_covered;
}

#[cfg(test)]
mod tests;
