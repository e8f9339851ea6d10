//! Windows: the nearest surfaces in a rectangle of a hemicube's pixels, seen through a portal.
//!
//! A window is drawn into the pixels that saw the portal, its *open* ones. The tree is walked front to back, within the
//! pyramid of the window's pixels and beyond the portal's plane, up to the farthest depth still open.
//!
//! Triangles are drawn in homogeneous coordinates (Olano & Greer 1997, "Triangle scan conversion using 2D homogeneous
//! coordinates"): no corner is clipped. Edges are products of two corners, so that two triangles with a common edge
//! compute it with opposite signs, to the bit, and every pixel centre belongs to one of them at least.
//!
//! No second hemicube of the backend for each portal, because most portals fill a few of its pixels: what a window
//! costs goes with its pixels, and any backend that hands out item buffers will do for the first pass.

use crate::bvh::{Block, INNER, LANES, Tree, UNUSED};
use crate::geometry::Plane;
use crate::simd::{InstructionSet, cross, dispatch, dot, least, minus, most};
use glam::DVec3;

/// Pixels along the edge of a window at most. A choice: larger ones leave the cache; of smaller ones there are more,
/// each with the geometry in its sight.
pub(super) const EDGE: u32 = 32;
/// Pixels drawn at a time.
const CHUNK: usize = 8;
const CHUNKS: usize = EDGE as usize / CHUNK;
/// The depth of an open pixel: no surface is as far.
const OPEN: f64 = f64::MIN_POSITIVE;
/// The id of a pixel that shows nothing.
pub(super) const NOTHING: u32 = u32::MAX;
/// Bits of a depth that count: surfaces of one plane are equally near, and the smaller id is seen.
const DEPTH_BITS: u64 = !0xF_FFFF;
/// Planes that bound what a window shows: its sides, the portal, the farthest open depth, and two that bound nothing.
const PLANES: usize = 8;
const FARTHEST: usize = 5;

/// A face of a hemicube in the scene behind a portal.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceView {
    pub(super) eye: DVec3,
    /// To the right, up, forward.
    pub(super) axes: [DVec3; 3],
    /// True for left-handed axes.
    pub(super) is_mirrored: bool,
    /// The portal's plane, looking where the view goes on.
    pub(super) horizon: Plane,
    /// The edge of a pixel at distance 1.
    pub(super) step: f64,
    /// Distance of the face's lower edge below its axis at distance 1.
    pub(super) below: f64,
}

impl FaceView {
    /// The direction of a pixel's centre, 1 long along the face's axis.
    pub(super) fn towards(&self, x: f64, y: f64) -> DVec3 {
        let (a, b) = ((x + 0.5) * self.step - 1.0, (y + 0.5) * self.step - self.below);
        self.axes[2] + self.axes[0] * a + self.axes[1] * b
    }
}

/// A window's pixels.
#[derive(Debug)]
pub(super) struct Window {
    /// 1/w of the nearest surface; infinite for closed pixels.
    depth: Vec<[f64; CHUNK]>,
    item: Vec<[u64; CHUNK]>,
    /// a of each column's centre.
    columns: [[f64; CHUNK]; CHUNKS],
    /// The first column and row, then the number of columns and rows.
    at: [u32; 2],
    size: [usize; 2],
    pending: Vec<u32>,
}

/// Triangles of a block in a window.
#[derive(Debug)]
struct Lanes {
    /// Edges, as functions of a, b, 1; inside where no one is negative.
    edges: [[f64; LANES]; 9],
    /// 1/w.
    depth: [[f64; LANES]; 3],
    /// Twice the area times the distance; its sign tells the side.
    determinant: [f64; LANES],
    /// First and last column and row that it may touch.
    range: [[f64; LANES]; 4],
    lowest: [f64; LANES],
    highest: [f64; LANES],
    /// Along the face's axis.
    nearest: [f64; LANES],
}

impl Window {
    pub(super) fn new() -> Self {
        Self {
            depth: vec![[f64::INFINITY; CHUNK]; CHUNKS * EDGE as usize],
            item: vec![[u64::from(NOTHING); CHUNK]; CHUNKS * EDGE as usize],
            columns: [[0.0; CHUNK]; CHUNKS],
            at: [0; 2],
            size: [0; 2],
            pending: Vec::new(),
        }
    }

    /// Begins a window from `low` to `high`, both within, less than [`EDGE`] apart. All its pixels are closed.
    pub(super) fn begin(&mut self, low: [u32; 2], high: [u32; 2]) {
        self.at = low;
        self.size = [0, 1].map(|k| (high[k] - low[k] + 1) as usize);
        let chunks = self.size[0].div_ceil(CHUNK);
        for y in 0..self.size[1] {
            self.depth[y * CHUNKS..][..chunks].fill([f64::INFINITY; CHUNK]);
        }
    }

    fn place(&self, x: u32, y: u32) -> (usize, usize) {
        let (column, row) = ((x - self.at[0]) as usize, (y - self.at[1]) as usize);
        (row * CHUNKS + column / CHUNK, column % CHUNK)
    }

    pub(super) fn open(&mut self, x: u32, y: u32) {
        let (chunk, place) = self.place(x, y);
        self.depth[chunk][place] = OPEN;
        self.item[chunk][place] = u64::from(NOTHING);
    }

    /// The side seen at an open pixel: a patch, the tree's patch count for the back of a one-sided one, or [`NOTHING`].
    pub(super) fn seen(&self, x: u32, y: u32) -> u32 {
        let (chunk, place) = self.place(x, y);
        #[allow(clippy::cast_possible_truncation, reason = "an id")]
        let id = self.item[chunk][place] as u32;
        id
    }

    pub(super) fn draw(&mut self, set: InstructionSet, tree: &Tree, view: &FaceView) {
        draw_by(set, tree, view, self);
    }
}

/// Sides of half spaces that a window looks into: n · p ≥ `offset`.
struct Pyramid {
    normals: [[f64; PLANES]; 3],
    extents: [[f64; PLANES]; 3],
    offsets: [f64; PLANES],
    /// The eye's place along the face's axis.
    eye: f64,
    slack: f64,
}

impl Pyramid {
    fn new(view: &FaceView, window: &Window, tolerance: f64) -> Self {
        let [u, v, w] = view.axes;
        let edge = |pixel: u32, below: f64| f64::from(pixel) * view.step - below;
        let [x, y] = window.at;
        #[allow(clippy::cast_possible_truncation, reason = "at most 64")]
        let [right, top] = [x + window.size[0] as u32, y + window.size[1] as u32];
        let slack = 1e-12 * (1.0 + view.eye.length());
        let mut pyramid = Self {
            normals: [[0.0; PLANES]; 3],
            extents: [[0.0; PLANES]; 3],
            offsets: [-1.0; PLANES],
            eye: w.dot(view.eye),
            slack,
        };
        let sides = [
            u - w * edge(x, 1.0),
            w * edge(right, 1.0) - u,
            v - w * edge(y, view.below),
            w * edge(top, view.below) - v,
        ];
        let planes = sides.map(|normal| (normal, normal.dot(view.eye) - slack));
        let portal = (view.horizon.normal, view.horizon.offset + 0.5 * tolerance);
        for (k, (normal, offset)) in planes.into_iter().chain([portal, (-w, f64::NEG_INFINITY)]).enumerate() {
            for (axis, &n) in normal.to_array().iter().enumerate() {
                pyramid.normals[axis][k] = n;
                pyramid.extents[axis][k] = n.abs();
            }
            pyramid.offsets[k] = offset;
        }
        pyramid
    }

    /// Ends it at a depth, 1/w.
    fn end_at(&mut self, depth: f64) {
        self.offsets[FARTHEST] = -self.eye - (1.0 + 1e-9) / depth - self.slack;
    }

    #[inline(always)]
    fn misses(&self, center: [f64; 3], half: [f64; 3]) -> bool {
        let mut outside = 0;
        for k in 0..PLANES {
            let mut height = 0.0;
            for axis in 0..3 {
                height += self.normals[axis][k] * center[axis] + self.extents[axis][k] * half[axis];
            }
            outside |= u32::from(height < self.offsets[k]);
        }
        outside != 0
    }
}

#[inline(always)]
fn draw(tree: &Tree, view: &FaceView, window: &mut Window) {
    let mut pyramid = Pyramid::new(view, window, tree.plane_tolerance);
    for (at, column) in window.columns.iter_mut().flatten().enumerate() {
        *column = (f64::from(window.at[0]) + at as f64 + 0.5) * view.step - 1.0;
    }
    let mut farthest = OPEN;
    let mut pending = std::mem::take(&mut window.pending);
    let mut lanes = Lanes::none();
    pending.clear();
    pending.push(0);
    #[allow(clippy::cast_possible_truncation, reason = "at most 64")]
    let [across, up] = window.size.map(|size| f64::from(size as u32) * 0.5 - 0.5);
    let ahead = view
        .towards(f64::from(window.at[0]) + across, f64::from(window.at[1]) + up)
        .to_array();
    while let Some(index) = pending.pop() {
        let node = &tree.nodes[index as usize];
        if pyramid.misses(node.center.to_array(), node.half.to_array()) {
            continue;
        }
        if node.block != INNER {
            let block = &tree.blocks[node.block as usize];
            transform(block, view, window.at, &mut lanes);
            if draw_lanes(block, &lanes, view, tree.plane_tolerance, farthest, window) {
                farthest = window.farthest();
                pyramid.end_at(farthest);
            }
            continue;
        }
        if node.child == 0 {
            continue;
        }
        let [first, second] = [0, 1].map(|k| tree.nodes[node.child as usize + k].center.to_array());
        // The nearer child is popped first.
        let nearer = u32::from(dot(minus(second, first), ahead) < 0.0);
        pending.extend([node.child + (1 - nearer), node.child + nearer]);
    }
    window.pending = pending;
}

/// Edges and depths of a block's triangles, with the columns and rows that they may touch, counted from `at`.
#[inline(always)]
fn transform(block: &Block, view: &FaceView, at: [u32; 2], out: &mut Lanes) {
    let eye = view.eye.to_array();
    let [u, v, w] = view.axes.map(|axis| axis.to_array());
    let (normal, offset) = (view.horizon.normal.to_array(), view.horizon.offset);
    let first = [
        (1.0 / view.step) - 0.5 - f64::from(at[0]),
        (view.below / view.step) - 0.5 - f64::from(at[1]),
    ];
    let scale = 1.0 / view.step;
    // Without closures: a function of a library that is not inlined leaves the instruction set.
    for l in 0..LANES {
        let [a, b, c] = block.corners_of(l);
        let (ha, hb, hc) = (dot(normal, a), dot(normal, b), dot(normal, c));
        out.highest[l] = most(ha, most(hb, hc)) - offset;
        out.lowest[l] = least(ha, least(hb, hc)) - offset;
        let (a, b, c) = (minus(a, eye), minus(b, eye), minus(c, eye));
        let p = [dot(u, a), dot(v, a), dot(w, a)];
        let q = [dot(u, b), dot(v, b), dot(w, b)];
        let r = [dot(u, c), dot(v, c), dot(w, c)];
        let (e, f, g) = (cross(q, r), cross(r, p), cross(p, q));
        let determinant = dot(p, e);
        let sign = if determinant < 0.0 { -1.0 } else { 1.0 };
        for k in 0..3 {
            out.edges[k][l] = e[k] * sign;
            out.edges[3 + k][l] = f[k] * sign;
            out.edges[6 + k][l] = g[k] * sign;
            out.depth[k][l] = (e[k] + f[k] + g[k]) / determinant;
        }
        out.determinant[l] = determinant;
        let nearest = least(p[2], least(q[2], r[2]));
        out.nearest[l] = nearest;
        let is_ahead = nearest > 1e-9;
        let ahead = [1.0 / p[2], 1.0 / q[2], 1.0 / r[2]];
        for k in 0..2 {
            let (p, q, r) = (p[k] * ahead[0], q[k] * ahead[1], r[k] * ahead[2]);
            let low = least(p, least(q, r)) * scale + first[k] - 1e-6;
            let high = most(p, most(q, r)) * scale + first[k] + 1e-6;
            out.range[2 * k][l] = if is_ahead { low } else { -1.0 };
            out.range[2 * k + 1][l] = if is_ahead { high } else { f64::from(EDGE) };
        }
    }
}

/// Draws the triangles of a block. Returns whether a pixel changed.
#[inline(always)]
fn draw_lanes(
    block: &Block,
    lanes: &Lanes,
    view: &FaceView,
    tolerance: f64,
    farthest: f64,
    window: &mut Window,
) -> bool {
    let last = [window.size[0] as f64 - 1.0, window.size[1] as f64 - 1.0];
    let horizon = &view.horizon;
    let behind = horizon.offset - horizon.normal.dot(view.eye);
    let beyond = [
        horizon.normal.dot(view.axes[0]) / behind,
        horizon.normal.dot(view.axes[1]) / behind,
        horizon.normal.dot(view.axes[2]) / behind,
    ];
    let mut changed = 0;
    for l in 0..LANES {
        let range = [
            lanes.range[0][l],
            lanes.range[1][l],
            lanes.range[2][l],
            lanes.range[3][l],
        ];
        let touches = range[0] <= last[0] && range[1] >= 0.0 && range[2] <= last[1] && range[3] >= 0.0;
        let determinant = lanes.determinant[l];
        let is_hidden = lanes.nearest[l] > 0.0 && 1.0 + 1e-9 < lanes.nearest[l] * farthest;
        if !touches || is_hidden || block.negative[l] == UNUSED || lanes.highest[l] <= tolerance {
            continue;
        }
        let depth = [lanes.depth[0][l], lanes.depth[1][l], lanes.depth[2][l]];
        if determinant == 0.0 || !depth[2].is_finite() {
            continue;
        }
        // What lies before the portal's plane is cut away.
        let limit = if lanes.lowest[l] < -tolerance {
            beyond
        } else {
            [0.0, 0.0, f64::INFINITY]
        };
        let id = if (determinant < 0.0) != view.is_mirrored {
            u64::from(block.negative[l])
        } else {
            u64::from(block.positive[l])
        };
        let e = &lanes.edges;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the window"
        )]
        let (x0, x1, y0, y1) = (
            range[0].max(0.0).ceil() as usize,
            range[1].min(last[0]) as usize,
            range[2].max(0.0).ceil() as usize,
            range[3].min(last[1]) as usize,
        );
        for y in y0..=y1 {
            let b = (f64::from(window.at[1]) + y as f64 + 0.5) * view.step - view.below;
            let (p0, q0, r0) = (e[1][l] * b + e[2][l], e[4][l] * b + e[5][l], e[7][l] * b + e[8][l]);
            let (p1, q1, r1) = (e[0][l], e[3][l], e[6][l]);
            let (depth_at, limit_at) = (depth[1] * b + depth[2], limit[1] * b + limit[2]);
            for chunk in x0 / CHUNK..=x1 / CHUNK {
                let place = y * CHUNKS + chunk;
                let columns = &window.columns[chunk];
                // Copies, so that the compiler sees that they are apart.
                let (mut depths, mut items) = (window.depth[place], window.item[place]);
                let mut any = [0u64; CHUNK];
                for i in 0..CHUNK {
                    let a = columns[i];
                    let at = f64::from_bits((depth[0] * a + depth_at).to_bits() & DEPTH_BITS);
                    let lowest = least(p1 * a + p0, least(q1 * a + q0, r1 * a + r0));
                    let inside = (lowest >= 0.0) & (at < limit[0] * a + limit_at);
                    let nearer = (at > depths[i]) | ((at == depths[i]) & (id < items[i]));
                    let wins = inside & nearer;
                    depths[i] = if wins { at } else { depths[i] };
                    items[i] = if wins { id } else { items[i] };
                    any[i] = u64::from(wins);
                }
                window.depth[place] = depths;
                window.item[place] = items;
                changed |= any.iter().fold(0, |all, any| all | any);
            }
        }
    }
    changed != 0
}

impl Lanes {
    const fn none() -> Self {
        Self {
            edges: [[0.0; LANES]; 9],
            depth: [[0.0; LANES]; 3],
            determinant: [0.0; LANES],
            range: [[0.0; LANES]; 4],
            lowest: [0.0; LANES],
            highest: [0.0; LANES],
            nearest: [0.0; LANES],
        }
    }
}

impl Window {
    /// The least 1/w of open pixels.
    #[inline(always)]
    fn farthest(&self) -> f64 {
        let chunks = self.size[0].div_ceil(CHUNK);
        let mut least_of = [f64::INFINITY; CHUNK];
        for y in 0..self.size[1] {
            for depths in &self.depth[y * CHUNKS..][..chunks] {
                for i in 0..CHUNK {
                    least_of[i] = least(depths[i], least_of[i]);
                }
            }
        }
        least_of.iter().fold(f64::INFINITY, |low, &depth| low.min(depth))
    }
}

dispatch! {
    fn draw_by = draw(tree: &Tree, view: &FaceView, window: &mut Window)
}
