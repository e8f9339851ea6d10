//! Further passes of a hemicube: what is seen through its portals, in the pixels in which they were seen.
//!
//! A pass is the view through one plane: the hemicube reflected in it, or as it was behind a pane. Portals of one plane
//! are one pass, whatever their weights, because a weight belongs to a pixel. Its pixels are drawn window by window
//! ([`super::window`]), few of them by rays, and those that meet a portal are the pixels of the next passes.
//!
//! Weights are whole numbers: what a pixel has is kept by a surface, lost, cut off, or handed on.
//!
//! Panes double passes, and a curved mirror is a plane a facet: after [`MERGE`] pixels light ones are no longer
//! followed each for itself. Neighbours of a pass, together of a least weight T, are one pixel with the weight of all:
//! the one that a draw in proportion to their weights takes, so that the expectation of every pixel stays what it was.

use super::gather::{Column, Ledger};
use super::motion::OTHER;
use super::specular::Optics;
use super::trace::{PASSES_MAX, Surfaces, divide};
use super::window::{EDGE, FaceView, NOTHING, Window};
use crate::accuracy::ray_shares::nearest;
use crate::backend::{self, BackendError, Hemicube, HemicubeBackend, RESOLUTIONS, WHOLE};
use crate::bvh::{LANES, Tree};
use crate::delta::DeltaTable;
use crate::face::{Face, Items, pixel_count};
use crate::geometry::{self, Plane};
use crate::sampling::splitmix;
use crate::simd::InstructionSet;
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pixels of a window up to which rays are cast instead. Measured: a window costs as much as some of them.
const FEW: usize = 4;
/// Windows along the edge of the largest hemicube's top.
const MOST_WINDOWS: usize = (*RESOLUTIONS.end() / EDGE) as usize;
/// Length of a ray: longer than any way through the scene, which fits a cube of side 2.
const FAR: f64 = 4.0;
/// Part of a hemicube's pixels from which on a pass is drawn by the backend, where it can. A choice, not a measurement:
/// a mask is uploaded and an atlas read back however small the pass, while windows cost what its pixels do. It depends
/// on nothing but the pass, so that rows do not depend on how fast a device is.
const DEVICE_PART: usize = 16;
/// Parts of the bound on pixels drawn after which light ones merge, and T then, in parts of the hemicube. Choices: at
/// T = 2⁻¹⁷ of it, draws vary a share F by √F · 0.3 % at most.
const MERGE: [(u64, u64); 4] = [(16, 1 << 18), (8, 1 << 17), (4, 1 << 16), (2, 1 << 14)];

/// A pixel on its way.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    face: u8,
    x: u16,
    y: u16,
    weight: u64,
    /// It is cut off where no more than this is left.
    least: u64,
}

impl Pixel {
    /// Its place in the atlas.
    fn place(&self, resolution: u32) -> usize {
        let row = Face::ALL[usize::from(self.face)].first_row(resolution) + u32::from(self.y);
        (row * resolution + u32::from(self.x)) as usize
    }

    /// The window that it belongs to.
    fn window(&self) -> [u32; 3] {
        [u32::from(self.face), u32::from(self.y) / EDGE, u32::from(self.x) / EDGE]
    }
}

/// Draws a pass on a backend's device, where that is made to and the pass is large.
fn by_device(pass: &Pass, resolution: u32, session: &mut dyn HemicubeBackend) -> Result<Option<Items>, BackendError> {
    if !session.info().capabilities.passes || pass.pixels.len() * DEVICE_PART < pixel_count(resolution) {
        return Ok(None);
    }
    let mut open = vec![0u32; pixel_count(resolution) / 32];
    for pixel in &pass.pixels {
        let place = pixel.place(resolution);
        open[place / 32] |= 1 << (place % 32);
    }
    let drawn = session.pass(&backend::Pass {
        origin: pass.eye,
        axes: pass.axes,
        normal: pass.horizon.normal,
        offset: pass.horizon.offset,
        open: &open,
    })?;
    Ok(Some(drawn))
}

/// A hemicube behind a portal, and its open pixels, window by window.
#[derive(Debug)]
struct Pass {
    eye: DVec3,
    axes: [DVec3; 3],
    horizon: Plane,
    /// Portals on the way.
    depth: u32,
    pixels: Vec<Pixel>,
}

/// The planes of portals, each once for each of its sides.
#[derive(Debug, Default)]
struct Planes {
    planes: Vec<Plane>,
    /// The plane of each patch; meaningless without optics.
    of_patch: Vec<u32>,
}

impl Planes {
    fn new(tree: &Tree, optics: &[Optics]) -> Self {
        let mut found = Self {
            planes: Vec::new(),
            of_patch: vec![u32::MAX; optics.len()],
        };
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (patch, optics) in (0u32..).zip(optics) {
            let Some(corners) = corners(tree, patch).filter(|_| optics.is_portal()) else {
                continue;
            };
            let Some(plane) = front(&corners, tree, patch) else {
                continue;
            };
            // Of a place of its own, so that near planes are in near cells.
            let at = plane.normal * (plane.offset + 3.0) / 1e-6;
            #[allow(clippy::cast_possible_truncation, reason = "below 2⁶³")]
            let cell = at.floor().to_array().map(|x| x as i64);
            let is_same = |&known: &u32| {
                let known: &Plane = &found.planes[known as usize];
                known.normal.dot(plane.normal) > 0.0
                    && corners
                        .iter()
                        .all(|&p| known.height(p).abs() <= 0.5 * tree.plane_tolerance)
            };
            let near = (0..27).map(|step| {
                let steps = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                [0, 1, 2].map(|k| cell[k] + steps[k])
            });
            let known = near
                .filter_map(|cell| cells.get(&cell))
                .flatten()
                .copied()
                .find(|known| is_same(known));
            found.of_patch[patch as usize] = known.unwrap_or_else(|| {
                #[allow(clippy::cast_possible_truncation, reason = "no more than patches")]
                let next = found.planes.len() as u32;
                found.planes.push(plane);
                cells.entry(cell).or_default().push(next);
                next
            });
        }
        found
    }
}

/// The corners of a patch's surface.
fn corners(tree: &Tree, patch: u32) -> Option<[DVec3; 3]> {
    let slot = *tree.slot_of_patch.get(patch as usize)?;
    let block = tree.blocks.get(slot as usize / LANES)?;
    Some(block.triangle(slot as usize % LANES))
}

/// The plane of a patch, looking where its front does.
fn front(corners: &[DVec3; 3], tree: &Tree, patch: u32) -> Option<Plane> {
    let slot = *tree.slot_of_patch.get(patch as usize)? as usize;
    let normal = geometry::cross(corners).try_normalize()?;
    // An eye on the side that a normal looks to sees a negative determinant.
    let is_turned = tree.blocks[slot / LANES].negative[slot % LANES] != patch;
    let normal = if is_turned { -normal } else { normal };
    Some(Plane {
        normal,
        offset: normal.dot(corners[0]),
    })
}

/// Weight of a patch in a hemicube's passes: arrived, and handed on.
type Sums = [u64; 2];

/// Makes further passes; one a thread.
#[derive(Debug)]
pub(super) struct Passes {
    tree: Arc<Tree>,
    set: InstructionSet,
    planes: Planes,
    /// Of each patch, and of what is none.
    is_portal: Vec<bool>,
    window: Window,
    /// Face, first row and column.
    windows: Vec<(u8, u32, u32)>,
    rays: Vec<u32>,
    /// The passes to come.
    pending: Vec<Pass>,
    /// Pixels of a pass's children: through panes, then off mirrors, of each plane.
    children: Vec<Vec<Pixel>>,
    used: Vec<u32>,
    /// Emptied, to be used again.
    spare: Vec<Vec<Pixel>>,
    seen: Vec<u32>,
    sums: Vec<Sums>,
    touched: Vec<u32>,
    /// Pixels drawn, and their bound: beyond it all is cut off at its next portal.
    pub(super) legs: u64,
    pub(super) legs_max: u64,
    /// Weight of the hemicube that is followed.
    whole: u64,
}

/// The pixels of a hemicube, each with its weight times `fine`; a path is cut off at `bound` of its weight.
pub(super) struct PixelView<'a> {
    /// Set where nobody wants the row any more: its weights need not say anything then.
    pub(super) cancel: Option<&'a AtomicBool>,
    pub(super) hemicube: &'a Hemicube,
    pub(super) items: &'a Items,
    pub(super) table: &'a DeltaTable,
    pub(super) fine: u64,
    pub(super) bound: f64,
}

impl Passes {
    pub(super) fn new(tree: &Arc<Tree>, optics: &[Optics]) -> Self {
        let planes = Planes::new(tree, optics);
        Self {
            children: vec![Vec::new(); 2 * planes.planes.len()],
            planes,
            is_portal: optics.iter().map(Optics::is_portal).chain([false]).collect(),
            tree: Arc::clone(tree),
            set: InstructionSet::widest(),
            window: Window::new(),
            windows: Vec::new(),
            rays: Vec::new(),
            pending: Vec::new(),
            used: Vec::new(),
            spare: Vec::new(),
            seen: Vec::new(),
            sums: vec![[0; 2]; optics.len()],
            touched: Vec::new(),
            legs: 0,
            legs_max: u64::MAX,
            whole: 0,
        }
    }

    /// Follows a hemicube's pixels. `portals` are those that the hemicube may see; large passes are drawn by `session`,
    /// where it can.
    ///
    /// # Errors
    /// The session's.
    pub(super) fn follow(
        &mut self,
        view: &PixelView<'_>,
        portals: &[u32],
        surfaces: Surfaces<'_>,
        taker: &mut Taker<'_, impl Fn(u32) -> Column>,
        mut session: Option<&mut dyn HemicubeBackend>,
    ) -> Result<(), BackendError> {
        let PixelView {
            hemicube,
            items,
            table,
            fine,
            bound,
            cancel,
        } = *view;
        self.whole = u64::from(WHOLE) * fine;
        let resolution = items.resolution;
        let edge = EDGE;
        let mut windows = std::mem::take(&mut self.windows);
        self.list_windows(hemicube, resolution, portals, &mut windows);
        for &(face, y0, x0) in &windows {
            let face = Face::ALL[usize::from(face)];
            let (rows, first) = (face.rows(resolution), face.first_row(resolution));
            let horizon = Plane {
                normal: hemicube.axes[2],
                offset: hemicube.axes[2].dot(hemicube.origin),
            };
            let view = view_of(face, resolution, hemicube.origin, &hemicube.axes, horizon);
            for y in y0..rows.min(y0 + edge) {
                let row = ((first + y) * resolution) as usize;
                let columns = x0..resolution.min(x0 + edge);
                let seen = &items.seen[row + x0 as usize..row + columns.end as usize];
                for (x, &patch) in columns.zip(seen) {
                    if !self.is_portal[(patch as usize).min(surfaces.optics.len())] {
                        continue;
                    }
                    let weight = u64::from(table.weight(face, x, y)) * fine;
                    #[allow(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "a share; below 2¹⁶"
                    )]
                    let pixel = Pixel {
                        face: face as u8,
                        x: x as u16,
                        y: y as u16,
                        weight,
                        least: (weight as f64 * bound) as u64,
                    };
                    let passed = self.hand_on(&pixel, patch, 0, &view, surfaces, taker.ledger);
                    taker.ledger.sent += passed;
                    if surfaces.laws.varies(patch) {
                        let [met, handed_on] = taker.ledger.first.entry(patch).or_default();
                        *met += weight;
                        *handed_on += passed;
                    }
                }
            }
        }
        self.windows = windows;
        self.begin_children(hemicube.origin, hemicube.axes, 0);
        while let Some(pass) = self.pending.pop() {
            let drawn = match &mut session {
                Some(session) => by_device(&pass, resolution, &mut **session),
                None => Ok(None),
            };
            let drawn = drawn.inspect_err(|_| self.pending.clear())?;
            self.draw(&pass, resolution, drawn.as_ref(), surfaces, taker);
            self.begin_children(pass.eye, pass.axes, pass.depth);
            let mut pixels = pass.pixels;
            pixels.clear();
            self.spare.push(pixels);
            if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
                self.pending.clear();
            }
        }
        for patch in self.touched.drain(..) {
            let [weight, passed] = std::mem::take(&mut self.sums[patch as usize]);
            let found = taker.ledger.entries.entry((OTHER, patch)).or_default();
            found.weight += weight;
            found.passed += passed;
        }
        Ok(())
    }

    /// Lists the windows that portals may be in, in the order of faces, rows and columns.
    fn list_windows(&self, hemicube: &Hemicube, resolution: u32, portals: &[u32], out: &mut Vec<(u8, u32, u32)>) {
        out.clear();
        let edge = EDGE;
        let step = 2.0 / f64::from(resolution);
        for (number, face) in (0u8..).zip(Face::ALL) {
            let (places, signs) = face.axes();
            let axes: [DVec3; 3] = std::array::from_fn(|k| hemicube.axes[places[k]] * signs[k]);
            let (rows, below) = (face.rows(resolution), if face.is_top() { 1.0 } else { 0.0 });
            let last = [(resolution - 1) / edge, (rows - 1) / edge];
            let mut marked = [[false; MOST_WINDOWS]; MOST_WINDOWS];
            for corners in portals.iter().filter_map(|&patch| corners(&self.tree, patch)) {
                let seen = corners.map(|corner| axes.map(|axis| axis.dot(corner - hemicube.origin)));
                let ahead = seen.iter().filter(|p| p[2] > 1e-9).count();
                // A window more on each side, for rounding.
                let range = |axis: usize, below: f64| {
                    let places = seen.iter().map(|p| (p[axis] / p[2] + below) / (step * f64::from(edge)));
                    let low = places.clone().fold(f64::INFINITY, f64::min) - 0.1;
                    let high = places.fold(f64::NEG_INFINITY, f64::max) + 0.1;
                    let most = f64::from(last[axis]);
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
                    let range = (low.clamp(0.0, most + 1.0) as usize, high.clamp(-1.0, most) as usize);
                    (high >= 0.0 && low <= most + 1.0).then_some(range.0..=range.1)
                };
                let all = |axis: usize| 0..=last[axis] as usize;
                let (columns, rows) = match ahead {
                    0 => continue,
                    3 => (range(0, 1.0), range(1, below)),
                    _ => (Some(all(0)), Some(all(1))),
                };
                let (Some(columns), Some(rows)) = (columns, rows) else {
                    continue;
                };
                for row in rows {
                    for column in columns.clone() {
                        if let Some(mark) = marked[row].get_mut(column) {
                            *mark = true;
                        }
                    }
                }
            }
            let windows = (0..=last[1]).flat_map(|row| (0..=last[0]).map(move |column| (row, column)));
            let marked = windows.filter(|&(row, column)| marked[row as usize][column as usize]);
            out.extend(marked.map(|(row, column)| (number, row * edge, column * edge)));
        }
    }

    /// Gives what a portal hands on of a pixel to the passes to come. Returns it.
    fn hand_on(
        &mut self,
        pixel: &Pixel,
        patch: u32,
        depth: u32,
        view: &FaceView,
        surfaces: Surfaces<'_>,
        ledger: &mut Ledger,
    ) -> u64 {
        let plane = self.planes.of_patch.get(patch as usize).copied().unwrap_or(u32::MAX);
        let optics = surfaces.at(patch, || {
            let towards = view.towards(pixel.x.into(), pixel.y.into()).normalize_or_zero();
            let plane = self.planes.planes.get(plane as usize);
            plane.map_or(1.0, |plane| plane.normal.dot(towards))
        });
        let [reflected, through] = divide(Some(&optics), pixel.weight);
        let is_over = depth >= PASSES_MAX || self.legs >= self.legs_max;
        for (weight, side) in [(through, 0), (reflected, 1)] {
            if weight == 0 {
                continue;
            }
            if is_over || weight <= pixel.least || plane == u32::MAX {
                ledger.cut_off += weight;
                continue;
            }
            let place = 2 * plane + side;
            let pixels = &mut self.children[place as usize];
            if pixels.is_empty() {
                self.used.push(place);
                if pixels.capacity() == 0 {
                    *pixels = self.spare.pop().unwrap_or_default();
                }
            }
            pixels.push(Pixel { weight, ..*pixel });
        }
        reflected + through
    }

    /// Makes passes of the pixels handed on, as seen by a hemicube.
    fn begin_children(&mut self, eye: DVec3, axes: [DVec3; 3], depth: u32) {
        for place in self.used.drain(..) {
            let Plane { normal, offset } = self.planes.planes[place as usize / 2];
            let mirrored = |v: DVec3| v - 2.0 * normal.dot(v) * normal;
            let is_mirror = place % 2 == 1;
            let (horizon, eye, axes) = if is_mirror {
                let moved = eye - 2.0 * (normal.dot(eye) - offset) * normal;
                (Plane { normal, offset }, moved, axes.map(mirrored))
            } else {
                let behind = Plane {
                    normal: -normal,
                    offset: -offset,
                };
                (behind, eye, axes)
            };
            let mut pixels = std::mem::take(&mut self.children[place as usize]);
            if let Some(least) = least_weight(self.legs, self.legs_max, self.whole) {
                merge(&mut pixels, least, self.legs);
            }
            self.pending.push(Pass {
                eye,
                axes,
                horizon,
                depth: depth + 1,
                pixels,
            });
        }
    }

    /// Draws a pass, window by window unless a device has, and hands on what meets portals.
    fn draw(
        &mut self,
        pass: &Pass,
        resolution: u32,
        drawn: Option<&Items>,
        surfaces: Surfaces<'_>,
        taker: &mut Taker<'_, impl Fn(u32) -> Column>,
    ) {
        let mut seen = std::mem::take(&mut self.seen);
        for pixels in pass.pixels.chunk_by(|p, q| p.window() == q.window()) {
            let face = Face::ALL[usize::from(pixels[0].face)];
            let view = view_of(face, resolution, pass.eye, &pass.axes, pass.horizon);
            seen.clear();
            if let Some(items) = drawn {
                // Its numbers for what is no patch are those of windows: none is a patch, and `ESCAPED` is `NOTHING`.
                seen.extend(pixels.iter().map(|pixel| items.seen[pixel.place(resolution)]));
            } else if pixels.len() <= FEW {
                seen.extend(pixels.iter().map(|pixel| self.cast(&view, pixel)));
            } else {
                let (x, y) = (
                    pixels.iter().map(|p| u32::from(p.x)),
                    pixels.iter().map(|p| u32::from(p.y)),
                );
                let low = [x.clone().min(), y.clone().min()].map(Option::unwrap_or_default);
                let high = [x.max(), y.max()].map(Option::unwrap_or_default);
                self.window.begin(low, high);
                for pixel in pixels {
                    self.window.open(pixel.x.into(), pixel.y.into());
                }
                self.window.draw(self.set, &self.tree, &view);
                seen.extend(
                    pixels
                        .iter()
                        .map(|pixel| self.window.seen(pixel.x.into(), pixel.y.into())),
                );
            }
            self.legs += pixels.len() as u64;
            for (pixel, &id) in pixels.iter().zip(&seen) {
                if id == NOTHING {
                    taker.ledger.escaped += pixel.weight;
                    let is_below = |up: DVec3| view.towards(pixel.x.into(), pixel.y.into()).dot(up) < 0.0;
                    if taker.up.is_some_and(is_below) {
                        taker.ledger.ground += pixel.weight;
                    }
                    continue;
                }
                let passed = if self.is_portal[(id as usize).min(surfaces.optics.len())] {
                    self.hand_on(pixel, id, pass.depth, &view, surfaces, taker.ledger)
                } else {
                    0
                };
                if id >= self.tree.patch_count {
                    taker.ledger.blocked += pixel.weight;
                } else if taker.arrive(id, pixel.weight - passed) {
                    let sums = &mut self.sums[id as usize];
                    if sums[0] == 0 {
                        self.touched.push(id);
                    }
                    sums[0] += pixel.weight;
                    sums[1] += passed;
                }
            }
        }
        self.seen = seen;
    }

    /// What a pixel sees, by a ray.
    fn cast(&mut self, view: &FaceView, pixel: &Pixel) -> u32 {
        let towards = view.towards(pixel.x.into(), pixel.y.into()).normalize();
        let distance = -view.horizon.height(view.eye) / view.horizon.normal.dot(towards);
        if !distance.is_finite() {
            return NOTHING;
        }
        let from = view.eye + towards * distance;
        let met = nearest(&self.tree, from, from + towards * FAR, &view.horizon, &mut self.rays);
        met.map_or(NOTHING, |met| met.id)
    }
}

/// T, once pixels merge.
fn least_weight(legs: u64, legs_max: u64, whole: u64) -> Option<u64> {
    let begun = MERGE.iter().rev().find(|(part, _)| legs >= legs_max / part);
    begun.map(|(_, pixels)| whole / pixels)
}

/// Merges pixels lighter than `least` with their successors, until they are as heavy together. `seed` is for the draws.
fn merge(pixels: &mut Vec<Pixel>, least: u64, seed: u64) {
    let mut kept = 0;
    let mut group: Option<Pixel> = None;
    for at in 0..pixels.len() {
        let pixel = pixels[at];
        let before = group.take();
        let merged = match before {
            None => pixel,
            Some(before) => {
                let weight = before.weight + pixel.weight;
                let draw = splitmix::unit(splitmix::hash(seed << 24 ^ at as u64));
                let one = if draw * (weight as f64) < pixel.weight as f64 {
                    pixel
                } else {
                    before
                };
                Pixel {
                    weight,
                    least: before.least + pixel.least,
                    ..one
                }
            }
        };
        if merged.weight >= least || at + 1 == pixels.len() {
            pixels[kept] = merged;
            kept += 1;
        } else {
            group = Some(merged);
        }
    }
    pixels.truncate(kept);
}

/// A face of a hemicube behind a portal, or before it.
fn view_of(face: Face, resolution: u32, eye: DVec3, of: &[DVec3; 3], horizon: Plane) -> FaceView {
    let (places, signs) = face.axes();
    FaceView {
        eye,
        axes: std::array::from_fn(|k| of[places[k]] * signs[k]),
        is_mirrored: of[0].cross(of[1]).dot(of[2]) < 0.0,
        horizon,
        step: 2.0 / f64::from(resolution),
        below: if face.is_top() { 1.0 } else { 0.0 },
    }
}

/// Takes what arrives.
pub(super) struct Taker<'a, C> {
    pub(super) ledger: &'a mut Ledger,
    pub(super) column: C,
    /// The way up, where what escapes below the horizon is told apart.
    pub(super) up: Option<DVec3>,
}

impl<C: Fn(u32) -> Column> Taker<'_, C> {
    /// Enters the weight that a patch keeps. Returns whether it has a column.
    fn arrive(&mut self, patch: u32, kept: u64) -> bool {
        match (self.column)(patch) {
            Column::None => self.ledger.unselected += kept,
            Column::CutOff => self.ledger.cut_off += kept,
            Column::Of => {
                self.ledger.kept += kept;
                return true;
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_pixels_keep_their_weight_and_each_its_expectation() {
        let pixels: Vec<Pixel> = (0..40u16)
            .map(|x| Pixel {
                face: 0,
                x,
                y: 0,
                weight: if x == 7 { 1000 } else { 10 + u64::from(x % 3) * 20 },
                least: 1,
            })
            .collect();
        let sum = |of: &[Pixel]| of.iter().map(|pixel| pixel.weight).sum::<u64>();
        let mut means = [0.0; 40];
        let draws = 4000u32;
        for seed in 0..u64::from(draws) {
            let mut merged = pixels.clone();
            merge(&mut merged, 100, seed);
            assert_eq!(sum(&merged), sum(&pixels));
            assert_eq!(merged.iter().map(|pixel| pixel.least).sum::<u64>(), 40);
            assert!(merged.len() < 20 && merged.is_sorted_by_key(|pixel| pixel.x));
            assert!(merged.iter().rev().skip(1).all(|pixel| pixel.weight >= 100));
            for pixel in merged {
                means[usize::from(pixel.x)] += pixel.weight as f64 / f64::from(draws);
            }
        }
        for (pixel, mean) in pixels.iter().zip(means) {
            // A draw of at most 150 with that mean: within five standard errors.
            let weight = pixel.weight as f64;
            let error = (weight * 1150.0 / f64::from(draws)).sqrt();
            assert!((mean - weight).abs() < 5.0 * error, "{mean} {weight}");
        }
    }
}
