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
//!
//! N bands may be followed together, a pixel with a weight for each. A window is drawn once for the open pixels of
//! all, because what a pixel sees does not depend on which others are open. Legs, bounds, and whether a window has few
//! pixels are counted for each band by itself, and its pixels merge by its own weights, so that each has the weights
//! that it has alone, to the bit. Merging depends on the order of passes. Where a band would have had another order by
//! itself and gets to merging, all are followed again, each alone, which bounds the cost at twice.

use super::gather::{Column, Ledger};
use super::motion::OTHER;
use super::specular::Optics;
use super::trace::{PASSES_MAX, Surfaces, divide};
use super::window::{EDGE, FaceView, NOTHING, Window};
use crate::backend::{self, BackendError, Hemicube, HemicubeBackend, RESOLUTIONS, WHOLE};
use crate::bvh::{LANES, Tree};
use crate::close::CLOSE;
use crate::delta::DeltaTable;
use crate::face::{Face, Items, pixel_count};
use crate::geometry::{self, Plane};
use crate::sampling::splitmix;
use crate::simd::InstructionSet;
use crate::visibility::nearest::nearest;
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
struct Pixel<const N: usize> {
    face: u8,
    x: u16,
    y: u16,
    /// Of each band; 0 where its path has ended.
    weights: [u64; N],
    /// They are cut off where no more than this is left.
    least: [u64; N],
}

impl<const N: usize> Pixel<N> {
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

/// Ways to find what a pixel sees: a window, a ray, the backend's device.
const WAYS: usize = 3;
const DRAWN: usize = 0;
const CAST: usize = 1;
const DEVICE: usize = 2;

/// A pass as a backend's device draws it.
struct DeviceItems<const N: usize> {
    items: Items,
    /// The bands that it is drawn for: the others have few pixels in it.
    bands: [bool; N],
}

/// Draws a pass on a backend's device, where that is made to, for the bands that have many pixels in it. Not where the
/// eye is [`CLOSE`] to the portal: a device clips in f32.
fn by_device<const N: usize>(
    pass: &Pass<N>,
    resolution: u32,
    session: &mut dyn HemicubeBackend,
) -> Result<Option<DeviceItems<N>>, BackendError> {
    let height = pass.horizon.normal.dot(pass.eye) - pass.horizon.offset;
    if !session.info().capabilities.passes || height.abs() < CLOSE {
        return Ok(None);
    }
    let is_large = |&count: &usize| count * DEVICE_PART >= pixel_count(resolution);
    let bands = pixels_of_bands(&pass.pixels).map(|count| is_large(&count));
    if !bands.contains(&true) {
        return Ok(None);
    }
    let mut open = vec![0u32; pixel_count(resolution) / 32];
    for pixel in &pass.pixels {
        if bands
            .iter()
            .zip(pixel.weights)
            .any(|(&is_drawn, weight)| is_drawn && (N == 1 || weight > 0))
        {
            let place = pixel.place(resolution);
            open[place / 32] |= 1 << (place % 32);
        }
    }
    let items = session.pass(&backend::Pass {
        origin: pass.eye,
        axes: pass.axes,
        normal: pass.horizon.normal,
        offset: pass.horizon.offset,
        open: &open,
    })?;
    Ok(Some(DeviceItems { items, bands }))
}

/// The number of pixels in which each band has a weight.
fn pixels_of_bands<const N: usize>(pixels: &[Pixel<N>]) -> [usize; N] {
    if N == 1 {
        return [pixels.len(); N];
    }
    std::array::from_fn(|band| pixels.iter().filter(|pixel| pixel.weights[band] > 0).count())
}

/// A hemicube behind a portal, and its open pixels, window by window.
#[derive(Debug)]
struct Pass<const N: usize> {
    eye: DVec3,
    axes: [DVec3; 3],
    horizon: Plane,
    /// Portals on the way.
    depth: u32,
    pixels: Vec<Pixel<N>>,
}

/// The planes of a band's portals, each once for each of its sides.
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

/// The planes of several bands, and the plane of each patch in each. Those of a band are what they are alone: of one
/// plane within the tolerance, the first portal's is taken, and portals differ.
#[derive(Debug)]
struct PlanesOf<const N: usize> {
    planes: Vec<Plane>,
    of_patch: Vec<[u32; N]>,
}

impl<const N: usize> PlanesOf<N> {
    fn new(tree: &Tree, optics: [&[Optics]; N]) -> Self {
        let mut all = Self {
            planes: Vec::new(),
            of_patch: vec![[u32::MAX; N]; optics.map(<[Optics]>::len).into_iter().max().unwrap_or(0)],
        };
        let mut places: HashMap<[u64; 4], u32> = HashMap::new();
        for (band, optics) in optics.into_iter().enumerate() {
            let Planes { planes, of_patch } = Planes::new(tree, optics);
            for (patch, plane) in of_patch.into_iter().enumerate() {
                let Some(&plane) = planes.get(plane as usize) else {
                    continue;
                };
                let [x, y, z] = plane.normal.to_array().map(f64::to_bits);
                let place = places.entry([x, y, z, plane.offset.to_bits()]).or_insert_with(|| {
                    all.planes.push(plane);
                    #[allow(clippy::cast_possible_truncation, reason = "no more than patches of all bands")]
                    let last = (all.planes.len() - 1) as u32;
                    last
                });
                all.of_patch[patch][band] = *place;
            }
        }
        all
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

/// Makes further passes of N bands; one a thread.
#[derive(Debug)]
pub(super) struct Passes<const N: usize> {
    tree: Arc<Tree>,
    set: InstructionSet,
    planes: PlanesOf<N>,
    /// Of each patch in any band, and of what is none.
    is_portal: Vec<bool>,
    window: Window,
    /// Face, first row and column.
    windows: Vec<(u8, u32, u32)>,
    rays: Vec<u32>,
    /// The passes to come.
    pending: Vec<Pass<N>>,
    /// Pixels of a pass's children: through panes, then off mirrors, of each plane.
    children: Vec<Vec<Pixel<N>>>,
    used: Vec<u32>,
    /// Of each of those, the bands that use it; and those of each band, in its own order.
    users: Vec<[bool; N]>,
    used_by: [Vec<u32>; N],
    /// Bands that would have had another order of passes by themselves.
    is_disordered: [bool; N],
    /// Emptied, to be used again.
    spare: Vec<Vec<Pixel<N>>>,
    /// What pixels of a window show, by each way.
    seen: Vec<[u32; WAYS]>,
    sums: Vec<[Sums; N]>,
    touched: Vec<u32>,
    /// Pixels drawn of each band, and their bound: beyond it all is cut off at its next portal.
    pub(super) legs: [u64; N],
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

impl<const N: usize> Passes<N> {
    pub(super) fn new(tree: &Arc<Tree>, optics: [&[Optics]; N]) -> Self {
        let planes = PlanesOf::new(tree, optics);
        let count = planes.of_patch.len();
        let is_portal = |patch: usize| optics.iter().any(|band| band.get(patch).is_some_and(Optics::is_portal));
        Self {
            children: vec![Vec::new(); 2 * planes.planes.len()],
            users: vec![[false; N]; 2 * planes.planes.len()],
            planes,
            is_portal: (0..count).map(is_portal).chain([false]).collect(),
            tree: Arc::clone(tree),
            set: InstructionSet::widest(),
            window: Window::new(),
            windows: Vec::new(),
            rays: Vec::new(),
            pending: Vec::new(),
            used: Vec::new(),
            used_by: std::array::from_fn(|_| Vec::new()),
            is_disordered: [false; N],
            spare: Vec::new(),
            seen: Vec::new(),
            sums: vec![[[0; 2]; N]; count],
            touched: Vec::new(),
            legs: [0; N],
            legs_max: u64::MAX,
            whole: 0,
        }
    }

    /// Begins a row, whose hemicubes are followed one after the other.
    pub(super) fn begin_row(&mut self) {
        self.legs = [0; N];
        self.is_disordered = [false; N];
    }

    /// Returns whether a patch is a portal in any of the bands.
    pub(super) fn is_portal(&self, patch: u32) -> bool {
        self.is_portal.get(patch as usize) == Some(&true)
    }

    /// Follows a hemicube's pixels. `portals` are those that the hemicube may see; large passes are drawn by `session`,
    /// where it can. Returns false, with ledgers that say nothing, where one of several bands gets to merging out of
    /// its order: each is to be followed alone.
    ///
    /// # Errors
    /// The session's.
    pub(super) fn follow(
        &mut self,
        view: &PixelView<'_>,
        portals: &[u32],
        surfaces: [Surfaces<'_>; N],
        taker: &mut Taker<'_, N, impl Fn(u32) -> Column>,
        mut session: Option<&mut dyn HemicubeBackend>,
    ) -> Result<bool, BackendError> {
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
                    if !self.is_portal[(patch as usize).min(self.is_portal.len() - 1)] {
                        continue;
                    }
                    let weight = u64::from(table.weight(face, x, y)) * fine;
                    // In some of the bands, it may be.
                    let sees = surfaces.map(|band| band.optics.get(patch as usize).is_some_and(Optics::is_portal));
                    #[allow(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "a share; below 2¹⁶"
                    )]
                    let pixel = Pixel {
                        face: face as u8,
                        x: x as u16,
                        y: y as u16,
                        weights: sees.map(|sees| if sees { weight } else { 0 }),
                        least: [(weight as f64 * bound) as u64; N],
                    };
                    let passed = self.hand_on(&pixel, patch, 0, &view, &surfaces, taker.ledgers);
                    for (band, ledger) in taker.ledgers.iter_mut().enumerate() {
                        ledger.sent += passed[band];
                        if sees[band] && surfaces[band].laws.varies(patch) {
                            let [met, handed_on] = ledger.first.entry(patch).or_default();
                            *met += weight;
                            *handed_on += passed[band];
                        }
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
            let drawn = drawn.inspect_err(|_| self.forget())?;
            self.draw(&pass, resolution, drawn.as_ref(), &surfaces, taker);
            let mut bands = self.legs.iter().zip(self.is_disordered);
            if bands.any(|(&legs, is_disordered)| is_disordered && legs >= self.legs_max / MERGE[0].0) {
                self.forget();
                return Ok(false);
            }
            self.begin_children(pass.eye, pass.axes, pass.depth);
            let mut pixels = pass.pixels;
            pixels.clear();
            self.spare.push(pixels);
            if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
                self.pending.clear();
            }
        }
        for patch in self.touched.drain(..) {
            let sums = std::mem::replace(&mut self.sums[patch as usize], [[0; 2]; N]);
            for (ledger, [weight, passed]) in taker.ledgers.iter_mut().zip(sums) {
                if weight > 0 {
                    let found = ledger.entries.entry((OTHER, patch)).or_default();
                    found.weight += weight;
                    found.passed += passed;
                }
            }
        }
        Ok(true)
    }

    /// Forgets a hemicube that is not followed to its end.
    fn forget(&mut self) {
        self.pending.clear();
        for patch in self.touched.drain(..) {
            self.sums[patch as usize] = [[0; 2]; N];
        }
        self.used_by.iter_mut().for_each(Vec::clear);
        for place in self.used.drain(..) {
            self.children[place as usize].clear();
            self.users[place as usize] = [false; N];
        }
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
        pixel: &Pixel<N>,
        patch: u32,
        depth: u32,
        view: &FaceView,
        surfaces: &[Surfaces<'_>; N],
        ledgers: &mut [Ledger; N],
    ) -> [u64; N] {
        let planes = self.planes.of_patch.get(patch as usize).copied();
        let planes = planes.unwrap_or([u32::MAX; N]);
        let mut passed = [0; N];
        // Through, and reflected.
        let mut on = [[0; N]; 2];
        for band in 0..N {
            if pixel.weights[band] == 0 {
                continue;
            }
            let optics = surfaces[band].at(patch, || {
                let towards = view.towards(pixel.x.into(), pixel.y.into()).normalize_or_zero();
                let plane = self.planes.planes.get(planes[band] as usize);
                plane.map_or(1.0, |plane| plane.normal.dot(towards))
            });
            let [reflected, through] = divide(Some(&optics), pixel.weights[band]);
            passed[band] = reflected + through;
            let is_over = depth >= PASSES_MAX || self.legs[band] >= self.legs_max;
            for (weight, side) in [(through, 0), (reflected, 1)] {
                if is_over || weight <= pixel.least[band] || planes[band] == u32::MAX {
                    ledgers[band].cut_off += weight;
                } else {
                    on[side][band] = weight;
                }
            }
        }
        for (side, mut on) in (0u32..).zip(on) {
            for band in 0..N {
                if on[band] == 0 {
                    continue;
                }
                let is_alike = |other: usize| planes[other] == planes[band];
                let weights = std::array::from_fn(|other| if is_alike(other) { on[other] } else { 0 });
                on = std::array::from_fn(|other| if is_alike(other) { 0 } else { on[other] });
                let place = 2 * planes[band] + side;
                let pixels = &mut self.children[place as usize];
                if pixels.is_empty() {
                    self.used.push(place);
                    if pixels.capacity() == 0 {
                        *pixels = self.spare.pop().unwrap_or_default();
                    }
                }
                pixels.push(Pixel { weights, ..*pixel });
                if N > 1 {
                    let users = &mut self.users[place as usize];
                    for (other, used) in self.used_by.iter_mut().enumerate() {
                        if weights[other] > 0 && !std::mem::replace(&mut users[other], true) {
                            used.push(place);
                        }
                    }
                }
            }
        }
        passed
    }

    /// Makes passes of the pixels handed on, as seen by a hemicube.
    fn begin_children(&mut self, eye: DVec3, axes: [DVec3; 3], depth: u32) {
        for (band, used) in self.used_by.iter_mut().enumerate() {
            let own = self.used.iter().filter(|&&place| self.users[place as usize][band]);
            self.is_disordered[band] |= !own.eq(used.iter());
            used.clear();
        }
        for place in self.used.drain(..) {
            self.users[place as usize] = [false; N];
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
            let mut merges = false;
            for (band, &legs) in self.legs.iter().enumerate() {
                if let Some(least) = least_weight(legs, self.legs_max, self.whole) {
                    merge(&mut pixels, band, least, legs);
                    merges = true;
                }
            }
            if merges {
                pixels.retain(|pixel| pixel.weights != [0; N]);
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
        pass: &Pass<N>,
        resolution: u32,
        drawn: Option<&DeviceItems<N>>,
        surfaces: &[Surfaces<'_>; N],
        taker: &mut Taker<'_, N, impl Fn(u32) -> Column>,
    ) {
        let mut seen = std::mem::take(&mut self.seen);
        for pixels in pass.pixels.chunk_by(|p, q| p.window() == q.window()) {
            let face = Face::ALL[usize::from(pixels[0].face)];
            let view = view_of(face, resolution, pass.eye, &pass.axes, pass.horizon);
            let counts = pixels_of_bands(pixels);
            // A band with none goes with the others.
            let way = |band: usize| match drawn {
                _ if counts[band] == 0 => None,
                Some(drawn) if drawn.bands[band] => Some(DEVICE),
                _ => Some(if counts[band] > FEW { DRAWN } else { CAST }),
            };
            let ways: [Option<usize>; N] = std::array::from_fn(way);
            let other = ways.iter().flatten().copied().next().unwrap_or(CAST);
            let ways = ways.map(|way| way.unwrap_or(other));
            self.look(pixels, ways, &view, &mut seen);
            if let Some(drawn) = drawn {
                // Its numbers for what is no patch are those of windows: none is a patch, and `ESCAPED` is `NOTHING`.
                for (pixel, seen) in pixels.iter().zip(&mut seen) {
                    seen[DEVICE] = drawn.items.seen[pixel.place(resolution)];
                }
            }
            for (legs, count) in self.legs.iter_mut().zip(counts) {
                *legs += count as u64;
            }
            for (pixel, seen) in pixels.iter().zip(&seen) {
                let met = seen[ways[0]];
                if ways.iter().all(|&way| seen[way] == met) {
                    self.meet(pixel, met, pass.depth, &view, surfaces, taker);
                    continue;
                }
                for way in [CAST, DRAWN, DEVICE] {
                    let weight = |band: usize| if ways[band] == way { pixel.weights[band] } else { 0 };
                    let weights = std::array::from_fn(weight);
                    if weights != [0; N] {
                        let part = Pixel { weights, ..*pixel };
                        self.meet(&part, seen[way], pass.depth, &view, surfaces, taker);
                    }
                }
            }
        }
        self.seen = seen;
    }

    /// What a window's pixels see, by the ways of the bands that have them open; a device has drawn before.
    fn look(&mut self, pixels: &[Pixel<N>], ways: [usize; N], view: &FaceView, seen: &mut Vec<[u32; WAYS]>) {
        let has = |pixel: &Pixel<N>, way: usize| {
            let mut bands = pixel.weights.iter().zip(ways);
            bands.any(|(&weight, of)| weight > 0 && of == way)
        };
        seen.clear();
        seen.resize(pixels.len(), [NOTHING; WAYS]);
        if ways.contains(&CAST) {
            for (pixel, seen) in pixels.iter().zip(&mut *seen) {
                if has(pixel, CAST) {
                    seen[CAST] = self.cast(view, pixel);
                }
            }
        }
        if !ways.contains(&DRAWN) {
            return;
        }
        let (x, y) = (
            pixels.iter().map(|p| u32::from(p.x)),
            pixels.iter().map(|p| u32::from(p.y)),
        );
        let low = [x.clone().min(), y.clone().min()].map(Option::unwrap_or_default);
        let high = [x.max(), y.max()].map(Option::unwrap_or_default);
        self.window.begin(low, high);
        for pixel in pixels.iter().filter(|pixel| has(pixel, DRAWN)) {
            self.window.open(pixel.x.into(), pixel.y.into());
        }
        self.window.draw(self.set, &self.tree, view);
        for (pixel, seen) in pixels.iter().zip(seen).filter(|(pixel, _)| has(pixel, DRAWN)) {
            seen[DRAWN] = self.window.seen(pixel.x.into(), pixel.y.into());
        }
    }

    /// Enters what a pixel sees, and hands on what a portal there does.
    fn meet(
        &mut self,
        pixel: &Pixel<N>,
        id: u32,
        depth: u32,
        view: &FaceView,
        surfaces: &[Surfaces<'_>; N],
        taker: &mut Taker<'_, N, impl Fn(u32) -> Column>,
    ) {
        if id == NOTHING {
            let is_below = |up: DVec3| view.towards(pixel.x.into(), pixel.y.into()).dot(up) < 0.0;
            let is_ground = taker.up.is_some_and(is_below);
            for (ledger, weight) in taker.ledgers.iter_mut().zip(pixel.weights) {
                ledger.escaped += weight;
                ledger.ground += if is_ground { weight } else { 0 };
            }
            return;
        }
        let passed = if self.is_portal[(id as usize).min(self.is_portal.len() - 1)] {
            self.hand_on(pixel, id, depth, view, surfaces, taker.ledgers)
        } else {
            [0; N]
        };
        if id >= self.tree.patch_count {
            for (ledger, weight) in taker.ledgers.iter_mut().zip(pixel.weights) {
                ledger.blocked += weight;
            }
            return;
        }
        let kept = std::array::from_fn(|band| pixel.weights[band] - passed[band]);
        if taker.arrive(id, kept) {
            let sums = &mut self.sums[id as usize];
            if sums.iter().all(|sum| sum[0] == 0) {
                self.touched.push(id);
            }
            for (band, sum) in sums.iter_mut().enumerate() {
                sum[0] += pixel.weights[band];
                sum[1] += passed[band];
            }
        }
    }

    /// What a pixel sees, by a ray.
    fn cast(&mut self, view: &FaceView, pixel: &Pixel<N>) -> u32 {
        let towards = view.towards(pixel.x.into(), pixel.y.into()).normalize();
        let distance = -view.horizon.height(view.eye) / view.horizon.normal.dot(towards);
        if !distance.is_finite() {
            return NOTHING;
        }
        let from = view.eye + towards * distance;
        let met = nearest(
            &self.tree,
            [from, from + towards * FAR],
            &view.horizon,
            |_| false,
            &mut self.rays,
        );
        met.map_or(NOTHING, |met| met.id)
    }
}

/// T, once pixels merge.
fn least_weight(legs: u64, legs_max: u64, whole: u64) -> Option<u64> {
    let begun = MERGE.iter().rev().find(|(part, _)| legs >= legs_max / part);
    begun.map(|(_, pixels)| whole / pixels)
}

/// Merges pixels of a band lighter than `least` with their successors, until they are as heavy together: one gets the
/// weight of all, and the others keep none. `seed` is for the draws.
fn merge<const N: usize>(pixels: &mut [Pixel<N>], band: usize, least: u64, seed: u64) {
    // The place of a pixel that is not yet heavy enough.
    let mut group: Option<usize> = None;
    let mut number = 0;
    for at in 0..pixels.len() {
        if pixels[at].weights[band] == 0 {
            continue;
        }
        let mut one = at;
        if let Some(before) = group.take() {
            let weights = [before, at].map(|place| std::mem::take(&mut pixels[place].weights[band]));
            let bounds = [before, at].map(|place| std::mem::take(&mut pixels[place].least[band]));
            let weight = weights[0] + weights[1];
            let draw = splitmix::unit(splitmix::hash(seed << 24 ^ number));
            if draw * (weight as f64) >= weights[1] as f64 {
                one = before;
            }
            pixels[one].weights[band] = weight;
            pixels[one].least[band] = bounds[0] + bounds[1];
        }
        number += 1;
        if pixels[one].weights[band] < least {
            group = Some(one);
        }
    }
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
pub(super) struct Taker<'a, const N: usize, C> {
    /// Of each band.
    pub(super) ledgers: &'a mut [Ledger; N],
    pub(super) column: C,
    /// The way up, where what escapes below the horizon is told apart.
    pub(super) up: Option<DVec3>,
}

impl<const N: usize, C: Fn(u32) -> Column> Taker<'_, N, C> {
    /// Enters the weights that a patch keeps. Returns whether it has a column.
    fn arrive(&mut self, patch: u32, kept: [u64; N]) -> bool {
        let column = (self.column)(patch);
        for (ledger, kept) in self.ledgers.iter_mut().zip(kept) {
            match column {
                Column::None => ledger.unselected += kept,
                Column::CutOff => ledger.cut_off += kept,
                Column::Of => ledger.kept += kept,
            }
        }
        column == Column::Of
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_pixels_keep_their_weight_and_each_its_expectation() {
        let pixels: Vec<Pixel<1>> = (0..40u16)
            .map(|x| Pixel {
                face: 0,
                x,
                y: 0,
                weights: [if x == 7 { 1000 } else { 10 + u64::from(x % 3) * 20 }],
                least: [1],
            })
            .collect();
        let sum = |of: &[Pixel<1>]| of.iter().map(|pixel| pixel.weights[0]).sum::<u64>();
        let mut means = [0.0; 40];
        let draws = 4000u32;
        for seed in 0..u64::from(draws) {
            let mut merged = pixels.clone();
            merge(&mut merged, 0, 100, seed);
            merged.retain(|pixel| pixel.weights[0] > 0);
            assert_eq!(sum(&merged), sum(&pixels));
            assert_eq!(merged.iter().map(|pixel| pixel.least[0]).sum::<u64>(), 40);
            assert!(merged.len() < 20 && merged.is_sorted_by_key(|pixel| pixel.x));
            assert!(merged.iter().rev().skip(1).all(|pixel| pixel.weights[0] >= 100));
            for pixel in merged {
                means[usize::from(pixel.x)] += pixel.weights[0] as f64 / f64::from(draws);
            }
        }
        for (pixel, mean) in pixels.iter().zip(means) {
            // A draw of at most 150 with that mean: within five standard errors.
            let weight = pixel.weights[0] as f64;
            let error = (weight * 1150.0 / f64::from(draws)).sqrt();
            assert!((mean - weight).abs() < 5.0 * error, "{mean} {weight}");
        }
    }
}
