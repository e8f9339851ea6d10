//! Engine `depth`: a buffer of depths and ids, the depth test, and the reduction of a row.

use super::isa::Lanes;
use super::projection::{LaneBox, PixelBox, at, lane_box, project};
use super::spans::{EdgeLines, affine, edge_lines, walk};
use super::sums::{RunIndex, Sums};
use super::{AtlasBox, FaceGrid, GROUP, LanesOnFace, Transformed, smaller};
use hemicube_contract::bvh::LANES;
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::Face;

/// Sixteen neighbouring pixels of a row: one cache line, the width of a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Chunk<T>(pub(crate) [T; LANES]);

/// The nearest surface at each pixel of a hemicube's atlas.
#[derive(Debug)]
pub(crate) struct DepthBuffer {
    pub(crate) resolution: usize,
    /// 1/w of the nearest surface, by atlas row and chunk.
    pub(crate) depth: Vec<Chunk<f32>>,
    /// Its id, likewise.
    pub(crate) items: Vec<Chunk<u32>>,
    /// True if a tile of 16 × 8 pixels changed after its `tile_depth` was computed.
    pub(crate) dirty: Vec<bool>,
    /// The farthest depth in each tile.
    pub(crate) tile_depth: Vec<f32>,
    /// The id of pixels that hit nothing.
    pub(crate) nothing: u32,
    /// True if hidden triangles are left out.
    culling: bool,
    beyond_subpixel: f32,
    /// Runs of equal pixels in a row, of indexed ids.
    pub(crate) runs: Vec<Run>,
    /// Index of `runs` by id.
    pub(crate) index: RunIndex,
}

/// Pixels `start..end` of an atlas row, all with one id.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) row: u32,
    pub(crate) start: u16,
    pub(crate) end: u16,
}

impl DepthBuffer {
    pub(crate) fn new(resolution: u32, nothing: u32, culling: bool, index: RunIndex) -> Self {
        let resolution = resolution as usize;
        let chunks = 3 * resolution * resolution / LANES;
        Self {
            resolution,
            depth: vec![Chunk([0.0; LANES]); chunks],
            items: vec![Chunk([nothing; LANES]); chunks],
            dirty: vec![false; chunks / GROUP],
            tile_depth: vec![0.0; chunks / GROUP],
            nothing,
            culling,
            beyond_subpixel: beyond_subpixel(resolution),
            runs: Vec::new(),
            index,
        }
    }

    pub(crate) fn chunks_per_row(&self) -> usize {
        self.resolution / LANES
    }

    /// Clears all but the pixels.
    fn clear_tiles(&mut self) {
        self.dirty.fill(false);
        self.tile_depth.fill(0.0);
    }

    /// Clears the buffer for the next hemicube.
    pub(crate) fn clear_all(&mut self) {
        self.items.fill(Chunk([self.nothing; LANES]));
        self.depth.fill(Chunk([0.0; LANES]));
        self.clear_tiles();
        self.runs.clear();
        self.index.clear();
    }
}

/// Relative depth by which a sub-pixel patch may lie behind its pixel's centre and still be visible: about the
/// variation of depth over a few pixels of a surface not seen edge-on.
pub(crate) fn subpixel_slack(resolution: u32) -> f64 {
    16.0 / f64::from(resolution)
}

/// Factor by which 1/w at a pixel must exceed that of a sub-pixel patch to hide it, rounded up.
#[allow(clippy::cast_possible_truncation, reason = "rounding is covered by the factor")]
pub(super) fn beyond_subpixel(resolution: usize) -> f32 {
    ((1.0 + subpixel_slack(resolution as u32)) * (1.0 + 4e-6)) as f32
}

/// Lanes of a block after it was drawn on a face.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Drawn {
    /// Lanes that may have pixels on the face.
    pub(crate) on: u16,
    /// Rasterised lanes.
    pub(crate) drawn: u16,
    /// Hidden lanes with `COUNT`, even if surfaces about as near as the visible ones count as visible.
    pub(crate) behind: u16,
    /// Lanes left out: everything in their box is nearer.
    pub(crate) hidden: u16,
}

/// 1/w over a face's pixels: x · column + y · row + constant, clamped to `low..=high`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) constant: f64,
    /// Least and greatest value at the triangle's corners.
    pub(super) low: f32,
    pub(super) high: f32,
}

/// 1/w of a triangle over the pixels of a chunk, and the triangle's id.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct DepthPlane {
    /// i · x, for i in 0..16. Rounded to f32 only after the base is added: on a steep plane the base is far from the
    /// depths in the chunk, and their last digits would be lost.
    pub(super) steps: [f64; LANES],
    pub(super) plane: Plane,
    pub(super) id: u32,
}

/// Factor on the depth of a blocking back: two to four units in the last place of f32, above the rounding of two
/// depths.
const BACK: f64 = 1.0 - 1.0 / 4_194_304.0;
#[allow(clippy::cast_possible_truncation, reason = "exact in f32")]
const BACK_F32: f32 = BACK as f32;

/// Depth plane of a lane, from the sum of its edge vectors. The id before `nothing` is that of blocked pixels.
#[inline(always)]
pub(super) fn plane(
    t: &Transformed,
    grid: FaceGrid,
    lane: usize,
    sum: [f64; 3],
    nothing: u32,
    LaneBox { low, high, .. }: LaneBox,
) -> Plane {
    let inverse = 1.0 / t.determinant[lane];
    let [a, b, c] = affine(sum, grid);
    // At every silhouette edge of a solid a back meets a front. Their depths differ by less than f32 resolves, and the
    // front must win.
    let (inverse, low, high) = if t.seen[lane] + 1 == nothing {
        (inverse * BACK, low * BACK_F32, high * BACK_F32)
    } else {
        (inverse, low, high)
    };
    Plane {
        x: a * inverse,
        y: b * inverse,
        constant: c * inverse,
        low,
        high,
    }
}

/// Largest height in rows of a box that is tested pixel by pixel, if it is at most two chunks wide.
const FEW_ROWS: usize = 2 * GROUP;

/// Returns true if a box is small enough to be tested pixel by pixel; larger ones are tested by tiles.
#[inline(always)]
pub(crate) fn is_small([x0, x1, y0, y1]: AtlasBox) -> bool {
    x1 / LANES - x0 / LANES < 2 && y1 - y0 < FEW_ROWS
}

/// Returns true if every pixel of a box is nearer than `bound`.
#[inline(always)]
pub(super) fn all_nearer<L: Lanes>(
    isa: L,
    depth: &[Chunk<f32>],
    chunks_per_row: usize,
    [x0, x1, y0, y1]: AtlasBox,
    bound: f32,
) -> bool {
    let (first, last) = (x0 / LANES, x1 / LANES);
    for row in y0..=y1 {
        let mut mask = u16::MAX << (x0 % LANES);
        for chunk in first..=last {
            if chunk == last {
                mask &= u16::MAX >> (LANES - 1 - x1 % LANES);
            }
            if !isa.nearer(&depth[row * chunks_per_row + chunk], mask, bound) {
                return false;
            }
            mask = u16::MAX;
        }
    }
    true
}

/// Returns true if every pixel of a triangle's box is nearer than `high`: by pixels in a small box, by tiles in a large
/// one. Depths only grow, so that an old tile depth remains a bound.
#[inline(always)]
fn is_hidden<L: Lanes>(isa: L, target: &DepthBuffer, first_row: usize, pixels: PixelBox, high: f32) -> bool {
    if !target.culling {
        return false;
    }
    let [x0, x1, y0, y1] = [pixels.x0, pixels.x1 - 1, pixels.y0, pixels.y1 - 1].map(at);
    let (y0, y1) = (first_row + y0, first_row + y1);
    let chunks_per_row = target.chunks_per_row();
    if is_small([x0, x1, y0, y1]) {
        return all_nearer(isa, &target.depth, chunks_per_row, [x0, x1, y0, y1], high);
    }
    for tile_row in y0 / GROUP..=y1 / GROUP {
        let row = &target.tile_depth[tile_row * chunks_per_row..][x0 / LANES..=x1 / LANES];
        if row.iter().any(|&depth| depth <= high) {
            return false;
        }
    }
    true
}

/// Draws lanes of a block on a face.
#[inline(always)]
pub(super) fn draw<L: Lanes, const COUNT: bool>(
    isa: L,
    on: LanesOnFace<'_>,
    target: &mut DepthBuffer,
    pixels: &mut [u32; LANES],
) -> Drawn {
    let t = on.triangles;
    let grid = FaceGrid::new(on.face, target.resolution);
    let boxes = project(isa, t, grid);
    let mut pending = (boxes.in_front | boxes.straddling) & on.lanes;
    let mut drawn = Drawn {
        on: pending,
        ..Drawn::default()
    };
    let first_row = grid.first_row();
    while pending != 0 {
        let lane = pending.trailing_zeros() as usize;
        pending &= pending - 1;
        let Some(lane_box) = lane_box(t, &boxes, grid, lane) else {
            continue;
        };
        if is_hidden(isa, target, first_row, lane_box.pixels, lane_box.high) {
            drawn.hidden |= 1 << lane;
            let touched = lane_box.pixels.wider(grid);
            if COUNT && is_hidden(isa, target, first_row, touched, lane_box.high * target.beyond_subpixel) {
                drawn.behind |= 1 << lane;
            }
            continue;
        }
        drawn.drawn |= 1 << lane;
        let (lines, sum) = edge_lines(t, grid, lane);
        let plane = plane(t, grid, lane, sum, target.nothing, lane_box);
        let mut steps = [0.0; LANES];
        for (i, s) in steps.iter_mut().enumerate() {
            *s = plane.x * i as f64;
        }
        let triangle = DepthPlane {
            steps,
            plane,
            id: t.seen[lane],
        };
        let covered = draw_pixels::<L, COUNT>(isa, &lines, lane_box.pixels, &triangle, first_row, target);
        if COUNT {
            #[allow(clippy::cast_possible_truncation, reason = "at most 3·2²⁰ pixels")]
            {
                pixels[lane] += covered as u32;
            }
        }
    }
    drawn
}

/// Tests the pixels of a triangle's spans; returns their number with `COUNT`, else 0.
#[inline(always)]
fn draw_pixels<L: Lanes, const COUNT: bool>(
    isa: L,
    lines: &EdgeLines,
    pixels: PixelBox,
    triangle: &DepthPlane,
    first_row: usize,
    target: &mut DepthBuffer,
) -> usize {
    let (plane, chunks_per_row) = (&triangle.plane, target.chunks_per_row());
    let mut covered = 0;
    let first = at(pixels.x0) / LANES;
    let columns = (at(pixels.x1) - 1) / LANES - first;
    if columns < 2 {
        // Most triangles of a fine scene. Test both chunks: a branch on a row's chunks would be random.
        let left = first * LANES;
        let across = [0, 1].map(|column| plane.x * ((first + column) * LANES) as f64);
        walk(isa, lines, pixels, |row, start, end| {
            if COUNT {
                covered += end - start;
            }
            let mask = (u64::MAX << (start - left)) & !(u64::MAX << (end - left));
            let row_depth = plane.constant + plane.y * row as f64;
            let atlas_row = first_row + row;
            let tile = atlas_row / GROUP * chunks_per_row + first;
            for column in 0..=columns {
                let at = atlas_row * chunks_per_row + first + column;
                #[allow(clippy::cast_possible_truncation, reason = "sixteen of them")]
                let mask = (mask >> (column * LANES)) as u16;
                let base = row_depth + across[column];
                target.dirty[tile + column] |=
                    isa.test(&mut target.depth[at], &mut target.items[at], mask, base, triangle);
            }
        });
    } else {
        walk(isa, lines, pixels, |row, start, end| {
            if COUNT {
                covered += end - start;
            }
            let row_depth = plane.constant + plane.y * row as f64;
            let atlas_row = first_row + row;
            let row_chunk = atlas_row * chunks_per_row;
            let tile_row = atlas_row / GROUP * chunks_per_row;
            let mut chunk = start / LANES;
            let last = (end - 1) / LANES;
            let mut mask = u16::MAX << (start % LANES);
            loop {
                if chunk == last {
                    mask &= u16::MAX >> (LANES - 1 - (end - 1) % LANES);
                }
                let base = row_depth + plane.x * (chunk * LANES) as f64;
                let at = row_chunk + chunk;
                target.dirty[tile_row + chunk] |=
                    isa.test(&mut target.depth[at], &mut target.items[at], mask, base, triangle);
                if chunk == last {
                    break;
                }
                chunk += 1;
                mask = u16::MAX;
            }
        });
    }
    covered
}

/// The farthest depth in a tile, whose first chunk is `first`.
#[inline(always)]
pub(super) fn tile_depth<L: Lanes>(_isa: L, depth: &[Chunk<f32>], first: usize, chunks_per_row: usize) -> f32 {
    let mut lanes = depth[first].0;
    for row in 1..GROUP {
        let chunk = &depth[first + row * chunks_per_row].0;
        for l in 0..LANES {
            lanes[l] = smaller(lanes[l], chunk[l]);
        }
    }
    let mut width = LANES;
    while width > 1 {
        width /= 2;
        for l in 0..width {
            lanes[l] = smaller(lanes[l], lanes[l + width]);
        }
    }
    lanes[0]
}

/// Adds up the weights of a row.
#[inline(always)]
pub(super) fn reduce<L: Lanes>(isa: L, target: &mut DepthBuffer, table: &DeltaTable, sums: &mut Sums) {
    if target.index.is_used() {
        reduce_rows::<L, true>(isa, target, table, sums);
    } else {
        reduce_rows::<L, false>(isa, target, table, sums);
        target.clear_tiles();
    }
}

/// Adds up the weights of runs of equal pixels, row by row. With `INDEX`, lists the runs of indexed ids; without,
/// clears each chunk.
#[inline(always)]
fn reduce_rows<L: Lanes, const INDEX: bool>(isa: L, target: &mut DepthBuffer, table: &DeltaTable, sums: &mut Sums) {
    let (top, side) = (table.running(Face::Top), table.running(Face::PosX));
    let resolution = target.resolution;
    let chunks_per_row = target.chunks_per_row();
    let rows = target.items.len() / chunks_per_row;
    let cleared = Chunk([target.nothing; LANES]);
    for row in 0..rows {
        // The top, then four sides that share one table.
        let (running, face_row) = if row < resolution {
            (top, row)
        } else {
            (side, (row - resolution) % (resolution / 2))
        };
        let running = &running[face_row * resolution..][..=resolution];
        let items = &mut target.items[row * chunks_per_row..][..chunks_per_row];
        let depth = &mut target.depth[row * chunks_per_row..][..chunks_per_row];
        let mut id = items[0].0[0];
        let (mut start, mut sum) = (0usize, running[0]);
        let mut before = id;
        #[allow(clippy::cast_possible_truncation, reason = "at most 1024 pixels")]
        let mut add = |id: u32, start: usize, end: usize, weight: u32| {
            sums.add(id, (end - start) as u32, weight);
            if INDEX && target.index.has(id) {
                target.index.add(id);
                target.runs.push(Run {
                    row: row as u32,
                    start: start as u16,
                    end: end as u16,
                });
            }
        };
        for (c, (chunk, chunk_depth)) in items.iter_mut().zip(depth).enumerate() {
            let mut changes = isa.changes(chunk, before);
            before = chunk.0[LANES - 1];
            while changes != 0 {
                let l = changes.trailing_zeros() as usize;
                changes &= changes - 1;
                let x = c * LANES + l;
                let upto = running[x];
                add(id, start, x, upto - sum);
                (id, start, sum) = (chunk.0[l], x, upto);
            }
            if !INDEX {
                *chunk = cleared;
                *chunk_depth = Chunk([0.0; LANES]);
            }
        }
        add(id, start, resolution, running[resolution] - sum);
    }
}
