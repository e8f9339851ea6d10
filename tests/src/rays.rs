//! The view of a hemicube's pixels by rays alone: f64, one ray through each pixel's centre, sharing with backends only
//! the layout of the atlas. Slow and plain on purpose.
//!
//! Ray and triangle: Möller & Trumbore 1997. The hierarchy halves the longest side of the centroids' box at the median;
//! its boxes are widened, so that it can only ever cost time.

use glam::DVec3;
use hemicube::backend::{Geometry, Hemicube};
use hemicube::face::{Face, Items, pixel_count};
use hemicube_scene::InputPatch;

const LEAF: usize = 4;
/// Margin of widened boxes, in normalised units: far above rounding.
const WIDEN: f64 = 1e-9;

/// Triangles with a hierarchy over them.
#[derive(Debug)]
pub struct RayScene {
    surfaces: Vec<hemicube::backend::Surface>,
    nodes: Vec<Node>,
    tolerance: f64,
}

#[derive(Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// The range of a leaf's surfaces. Otherwise the first of two children, and 0.
    first: usize,
    count: usize,
}

/// A ray's hit on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The patch, or [`Items::BLOCKED`].
    pub seen: u32,
    /// Distance, in lengths of the ray's direction.
    pub distance: f64,
}

impl RayScene {
    /// Prepares the surfaces given to a backend.
    pub fn new(geometry: &Geometry) -> Self {
        let mut scene = Self {
            surfaces: geometry.surfaces.clone(),
            nodes: Vec::new(),
            tolerance: geometry.plane_tolerance,
        };
        let count = scene.surfaces.len();
        scene.nodes.push(Node {
            low: DVec3::ZERO,
            high: DVec3::ZERO,
            first: 0,
            count: 0,
        });
        scene.build(0, 0, count);
        scene
    }

    fn build(&mut self, node: usize, start: usize, end: usize) {
        let range = &mut self.surfaces[start..end];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut least, mut most) = (low, high);
        for surface in range.iter() {
            let [a, b, c] = surface.corners;
            low = low.min(a).min(b).min(c);
            high = high.max(a).max(b).max(c);
            least = least.min(a + b + c);
            most = most.max(a + b + c);
        }
        self.nodes[node].low = low - WIDEN;
        self.nodes[node].high = high + WIDEN;
        if range.len() <= LEAF {
            (self.nodes[node].first, self.nodes[node].count) = (start, range.len());
            return;
        }
        let extent = most - least;
        let axis = (0..3)
            .max_by(|&i, &j| extent[i].total_cmp(&extent[j]))
            .expect("three axes");
        let middle = range.len() / 2;
        range.select_nth_unstable_by(middle, |p, q| {
            let place = |corners: &[DVec3; 3]| corners.iter().map(|c| c[axis]).sum::<f64>();
            place(&p.corners).total_cmp(&place(&q.corners))
        });
        let child = self.nodes.len();
        self.nodes[node].first = child;
        for _ in 0..2 {
            self.nodes.push(Node {
                low,
                high,
                first: 0,
                count: 0,
            });
        }
        self.build(child, start, start + middle);
        self.build(child + 1, start + middle, end);
    }

    /// Calls `each` with every hit of a hemicube's ray up to the distance last returned by `each`.
    fn hits(&self, hemicube: &Hemicube, direction: DVec3, mut each: impl FnMut(Hit) -> f64) {
        let origin = hemicube.origin;
        let normal = hemicube.axes[2];
        let inverse = direction.recip();
        let mut limit = f64::INFINITY;
        let mut pending = vec![0];
        while let Some(node) = pending.pop() {
            let node = &self.nodes[node];
            let (p, q) = ((node.low - origin) * inverse, (node.high - origin) * inverse);
            // A ray within a slab's plane gives NaN, which `min` and `max` pass over: the slab then does not bound it.
            let (enter, leave) = (p.min(q), p.max(q));
            let enter = enter.x.max(enter.y).max(enter.z).max(0.0);
            let leave = leave.x.min(leave.y).min(leave.z);
            if enter > leave || enter > limit {
                continue;
            }
            if node.count == 0 {
                pending.extend([node.first, node.first + 1]);
                continue;
            }
            for surface in &self.surfaces[node.first..node.first + node.count] {
                let own = |patch: InputPatch| hemicube.emitter == Some(patch);
                // The emitter's own plane is its horizon: nothing in it is seen.
                let flat = surface
                    .corners
                    .iter()
                    .all(|&c| normal.dot(c - origin) <= self.tolerance);
                if own(surface.front) || surface.back.is_some_and(own) || flat {
                    continue;
                }
                let [a, b, c] = surface.corners;
                let (e, f) = (b - a, c - a);
                let p = direction.cross(f);
                let determinant = e.dot(p);
                if determinant == 0.0 {
                    continue;
                }
                let s = (origin - a) / determinant;
                let u = s.dot(p);
                let q = s.cross(e);
                let (v, distance) = (direction.dot(q), f.dot(q));
                if u < 0.0 || v < 0.0 || u + v > 1.0 || distance <= 0.0 {
                    continue;
                }
                let seen = if determinant > 0.0 {
                    surface.front.0
                } else {
                    surface.back.map_or(Items::BLOCKED, |patch| patch.0)
                };
                if distance <= limit {
                    limit = each(Hit { seen, distance });
                }
            }
        }
    }

    /// The first hit of a hemicube's ray; of surfaces at the same distance the smallest id.
    pub fn cast(&self, hemicube: &Hemicube, direction: DVec3) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.hits(hemicube, direction, |hit| {
            let nearer = best.is_none_or(|b| (hit.distance, hit.seen) < (b.distance, b.seen));
            let kept = if nearer { hit } else { best.unwrap_or(hit) };
            best = Some(kept);
            kept.distance
        });
        best
    }

    /// Returns whether a ray meets `seen` at this distance, to a relative tolerance.
    pub fn meets_at(&self, hemicube: &Hemicube, direction: DVec3, seen: u32, distance: f64, tolerance: f64) -> bool {
        let mut met = false;
        let limit = distance * (1.0 + tolerance);
        self.hits(hemicube, direction, |hit| {
            met |= hit.seen == seen && (hit.distance - distance).abs() <= tolerance * distance;
            limit
        });
        met
    }

    /// The item buffer of a hemicube.
    pub fn items(&self, hemicube: &Hemicube, resolution: u32) -> Items {
        let seen = pixels(resolution)
            .map(|(face, x, y)| {
                self.cast(hemicube, direction(hemicube, resolution, face, x, y))
                    .map_or(Items::ESCAPED, |hit| hit.seen)
            })
            .collect();
        Items { resolution, seen }
    }
}

/// Face, column and row of every pixel, in the atlas's order.
pub fn pixels(resolution: u32) -> impl Iterator<Item = (Face, u32, u32)> {
    Face::ALL
        .into_iter()
        .flat_map(move |face| (0..face.rows(resolution)).flat_map(move |y| (0..resolution).map(move |x| (face, x, y))))
}

/// Through the centre of a pixel, from the hemicube's own.
pub fn direction(hemicube: &Hemicube, resolution: u32, face: Face, x: u32, y: u32) -> DVec3 {
    let step = 2.0 / f64::from(resolution);
    let u = (f64::from(x) + 0.5) * step - 1.0;
    let v = (f64::from(y) + 0.5) * step - if face.is_top() { 1.0 } else { 0.0 };
    let (axis, sign) = face.axes();
    hemicube.axes[axis[0]] * (sign[0] * u) + hemicube.axes[axis[1]] * (sign[1] * v) + hemicube.axes[axis[2]] * sign[2]
}

/// Agreement of two item buffers of one hemicube.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agreement {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels that differ on a silhouette: in neither buffer do the pixel and its eight neighbours show one thing.
    pub silhouette: usize,
    /// Pixels that differ elsewhere, with both things at one depth to the precision of an f32.
    pub tied: usize,
    /// Pixels that differ without such a reason.
    pub wrong: usize,
}

impl std::ops::AddAssign for Agreement {
    fn add_assign(&mut self, other: Self) {
        self.pixels += other.pixels;
        self.silhouette += other.silhouette;
        self.tied += other.tied;
        self.wrong += other.wrong;
    }
}

/// Relative difference of depths lost in an f32: some units in its last place.
const DEPTH_TOLERANCE: f64 = 4e-6;

/// Compares a backend's item buffer with rays.
pub fn compare(scene: &RayScene, hemicube: &Hemicube, backend: &Items, rays: &Items) -> Agreement {
    let resolution = backend.resolution;
    assert_eq!(resolution, rays.resolution, "buffers of different resolutions");
    assert_eq!(
        [backend.seen.len(), rays.seen.len()],
        [pixel_count(resolution); 2],
        "a buffer is not of 3N² pixels"
    );
    let mut agreement = Agreement {
        pixels: backend.seen.len(),
        ..Agreement::default()
    };
    for (index, (face, x, y)) in pixels(resolution).enumerate() {
        if backend.seen[index] == rays.seen[index] {
            continue;
        }
        let uniform = |items: &Items| {
            let first = face.first_row(resolution);
            let rows = y.saturating_sub(1)..(y + 2).min(face.rows(resolution));
            rows.into_iter().all(|row| {
                (x.saturating_sub(1)..(x + 2).min(resolution))
                    .all(|column| items.seen[((first + row) * resolution + column) as usize] == items.seen[index])
            })
        };
        if !uniform(backend) && !uniform(rays) {
            agreement.silhouette += 1;
            continue;
        }
        let direction = direction(hemicube, resolution, face, x, y);
        let tied = scene
            .cast(hemicube, direction)
            .is_some_and(|hit| scene.meets_at(hemicube, direction, backend.seen[index], hit.distance, DEPTH_TOLERANCE));
        if tied {
            agreement.tied += 1;
        } else {
            agreement.wrong += 1;
        }
    }
    agreement
}
