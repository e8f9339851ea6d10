//! Covered weights counted on the processor, for backends without them.
//!
//! A pixel with its centre inside a patch's outline is the patch's, but drivers snap corners to a grid and choose
//! pixels along an edge freely. A patch showing every pixel certainly inside its outline is therefore wholly visible,
//! and its covered weight is its visible weight; the outlines of others are counted. Without occluders, every visible
//! fraction is then exactly 1 on any driver.
//!
//! No visible fraction from two rasterisers to the pixel, because they do not agree along edges: a patch counts as
//! hidden only if a pixel certainly inside its outline is hidden.

use crate::backend::{Geometry, Hemicube};
use crate::delta::DeltaTable;
use crate::face::Face;
use crate::row::RowBlock;
use glam::DVec3;
use std::sync::Arc;

/// The distance of a pixel's centre from an edge of the outline, in pixels, at which it may be drawn on the wrong side.
/// Drivers keep at least four bits of a pixel (Vulkan 1.3, `subPixelPrecisionBits`): half of this at each corner.
const SNAPPED: f64 = 1.0 / 16.0;

/// The corners of every patch of a scene; `None` for a patch without a surface.
struct PatchCorners(Vec<Option<[DVec3; 3]>>);

/// Counts covered weights.
///
/// ```
/// use hemicube_contract::InputPatch;
/// use hemicube_contract::backend::{Geometry, Hemicube, Surface, WHOLE};
/// use hemicube_contract::outline::Outlines;
/// use hemicube_contract::row::RowBlock;
/// # use hemicube_spatial::{Aabb, Octree, OctreeOptions, glam::DVec3};
/// # let corners = [DVec3::new(-1.0, -1.0, 1.0), DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0)];
/// # let octree = Octree::build(&[Aabb::from_points(corners)], OctreeOptions { max_level: 4, min_items: 4 })?;
/// # let surface = Surface { corners, front: InputPatch(0), back: None };
/// # let geometry = Geometry::new(vec![surface], octree, 1, 1e-10);
/// # let hemicube = Hemicube { emitter: None, origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };
///
/// // The scene's one patch is half of the top of the hemicube, 0.277; a third of that is seen.
/// let mut rows = RowBlock::default();
/// let seen = WHOLE / 11;
/// rows.push(InputPatch(0), seen, 0);
/// rows.end_row(WHOLE - seen, 0);
/// let rows = Outlines::new(&geometry, 256).complete(&[hemicube], &rows);
/// let covered = f64::from(rows.covered[0]) / f64::from(WHOLE);
/// assert!((covered - 0.277).abs() < 0.003, "{covered}");
/// assert_eq!(rows.visible[0], seen);
/// assert_eq!(rows.check(1, 1, true), Ok(()));
/// # Ok::<(), hemicube_spatial::OctreeError>(())
/// ```
#[derive(Debug)]
pub struct Outlines {
    corners: Arc<PatchCorners>,
    table: DeltaTable,
}

impl std::fmt::Debug for PatchCorners {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the corners of {} patches", self.0.len())
    }
}

impl Outlines {
    /// For hemicubes of a resolution in a scene.
    pub fn new(geometry: &Geometry, resolution: u32) -> Self {
        let corners = geometry.kept(|geometry| {
            let mut corners = vec![None; geometry.patch_count as usize];
            for surface in &geometry.surfaces {
                for patch in [Some(surface.front), surface.back].into_iter().flatten() {
                    corners[patch.0 as usize] = Some(surface.corners);
                }
            }
            PatchCorners(corners)
        });
        Self {
            corners,
            table: DeltaTable::new(resolution),
        }
    }

    /// Adds covered weights to the rows of these hemicubes, which are sums of pixels. Drops entries without visible
    /// weight: with covered weights they would be sub-pixel patches.
    ///
    /// # Panics
    /// When the numbers of rows and hemicubes differ, or a row names a patch beyond the scene.
    pub fn complete(&self, hemicubes: &[Hemicube], rows: &RowBlock) -> RowBlock {
        assert_eq!(hemicubes.len(), rows.len(), "a row of each hemicube");
        let mut complete = RowBlock::default();
        for (k, hemicube) in hemicubes.iter().enumerate() {
            let row = rows.row(k);
            for (&patch, &visible) in row.patches.iter().zip(row.visible).filter(|(_, visible)| **visible > 0) {
                let covered = match self.corners.0[patch as usize] {
                    Some(corners) => self.covered(hemicube, corners, visible),
                    None => visible,
                };
                complete.push(hemicube_scene::InputPatch(patch), visible, covered);
            }
            complete.end_row(row.escaped, row.blocked);
        }
        complete
    }

    /// The covered weight of a patch with so much visible weight: at least that.
    fn covered(&self, hemicube: &Hemicube, corners: [DVec3; 3], visible: u32) -> u32 {
        let corners = corners.map(|corner| {
            let from = corner - hemicube.origin;
            hemicube.axes.map(|axis| axis.dot(from))
        });
        let (certain, within) = weights_within(&corners, &self.table);
        if visible >= certain {
            visible
        } else {
            within.max(visible)
        }
    }
}

/// The weight of a hemicube's pixels certainly inside the outline of a triangle, whatever the driver, and of those
/// inside. Corners are in the frame of the hemicube (tangent, bitangent, normal).
///
/// ```
/// use hemicube_contract::delta::DeltaTable;
/// use hemicube_contract::outline::weights_within;
///
/// // Half of the top face.
/// let table = DeltaTable::new(64);
/// let (certain, within) = weights_within(&[[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0]], &table);
/// assert!(certain < within && f64::from(within) / f64::from(1u32 << 31) > 0.26);
/// ```
pub fn weights_within(corners: &[[f64; 3]; 3], table: &DeltaTable) -> (u32, u32) {
    let mut sums = (0, 0);
    for face in Face::ALL {
        let (certain, within) = on_face(face, corners, table);
        sums.0 += certain;
        sums.1 += within;
    }
    sums
}

/// Returns the weight of a face's pixels certainly inside the outline of a triangle, and of those inside. Corners are
/// in the patch frame.
///
/// A ray through a pixel meets the triangle if it is on the inner side of the three planes through the eye and an edge;
/// this holds for triangles reaching behind the eye, too.
fn on_face(face: Face, corners: &[[f64; 3]; 3], table: &DeltaTable) -> (u32, u32) {
    let (from, sign) = face.axes();
    let [a, b, c] = corners.map(|corner| {
        DVec3::new(
            sign[0] * corner[from[0]],
            sign[1] * corner[from[1]],
            sign[2] * corner[from[2]],
        )
    });
    let front = [a, b, c].map(|corner| corner.z > 0.0);
    if front == [false; 3] {
        return (0, 0);
    }
    let resolution = table.resolution();
    let (n, rows) = (f64::from(resolution), face.rows(resolution));
    // Rows of pixels go from −1 on the top face, and from 0 on the sides.
    let lowest = if face.is_top() { -1.0 } else { 0.0 };
    let center = |k: u32| (2.0 * f64::from(k) + 1.0) / n;
    let mut between = 0..rows;
    if front == [true; 3] {
        let heights = [a, b, c].map(|corner| (corner.y / corner.z - lowest) * 0.5 * n);
        let low = heights.into_iter().fold(f64::INFINITY, f64::min).floor();
        let high = heights.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil();
        between = pixel(low, rows)..pixel(high, rows);
    }
    // A triangle seen from behind has its edges the other way round.
    let turn = a.dot(b.cross(c)).signum();
    let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| turn * p.cross(q));
    let within = |y: f64, margin: f64| {
        let (mut low, mut high) = (-1.0f64, 1.0f64);
        for edge in edges {
            let rest = edge.y * y + edge.z - margin * edge.x.hypot(edge.y);
            if edge.x > 0.0 {
                low = low.max(-rest / edge.x);
            } else if edge.x < 0.0 {
                high = high.min(-rest / edge.x);
            } else if rest <= 0.0 {
                return 0..0;
            }
        }
        // The first centre at or after `low`, and the first after `high`.
        let place = |x: f64| ((x + 1.0) * 0.5 * n - 0.5).ceil();
        pixel(place(low), resolution)..pixel(place(high), resolution)
    };
    let (mut certain, mut all) = (0, 0);
    for row in between {
        let y = lowest + center(row);
        let sum = |x: std::ops::Range<u32>| {
            if x.is_empty() {
                0
            } else {
                table.span(face, row, x.start, x.end)
            }
        };
        all += sum(within(y, 0.0));
        certain += sum(within(y, SNAPPED * 2.0 / n));
    }
    (certain, all)
}

/// A place along a row or column, of so many pixels.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped before; NaN becomes 0"
)]
fn pixel(place: f64, count: u32) -> u32 {
    place.clamp(0.0, f64::from(count)) as u32
}
