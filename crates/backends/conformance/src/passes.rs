//! Passes through portals against rays: one through each open pixel, to every triangle, in f64.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, Geometry, HEIGHT_SLACK, Hemicube, HemicubeBackend, Pass, Surface};
use hemicube::face::{Face, Items, pixel_count};

/// Distance in pixels by which a driver may move what it draws. Drivers snap corners to 1/256 of a pixel, and the cut
/// by a portal's plane is where an f32 changes its sign.
const EDGE: f64 = 1.0 / 64.0;
/// Depths that differ by less of themselves may be taken for equal: blocking backs are lowered by 2⁻¹⁹.
const DEPTH_SLACK: f64 = 1.0 / 262_144.0;
/// Open pixels that may show another side because of that, in parts of all; two may in any case.
const MOST_BESIDE: f64 = 0.01;
/// Pixels along an edge of which each has its ray, at resolutions beside the first.
const FEW: u32 = 48;

/// A pass with a mask of its own.
struct Masked {
    what: &'static str,
    origin: DVec3,
    axes: [DVec3; 3],
    normal: DVec3,
    offset: f64,
    open: Vec<u32>,
}

impl Masked {
    /// Returns whether few pixels are open.
    fn is_stray(&self) -> bool {
        let open: usize = self.open.iter().map(|word| word.count_ones() as usize).sum();
        open * 16 < self.open.len() * 32
    }

    fn pass(&self) -> Pass<'_> {
        Pass {
            origin: self.origin,
            axes: self.axes,
            normal: self.normal,
            offset: self.offset,
            open: &self.open,
        }
    }
}

/// Every pixel, or some, far apart.
fn mask(resolution: u32, is_stray: bool) -> Vec<u32> {
    let mut open = vec![0u32; pixel_count(resolution) / 32];
    for pixel in (0..pixel_count(resolution)).filter(|pixel| !is_stray || pixel * 7919 % 37 == 5) {
        open[pixel / 32] |= 1 << (pixel % 32);
    }
    open
}

/// What a hemicube sees behind a plane, as through a pane or in a mirror.
fn behind(
    what: &'static str,
    hemicube: &Hemicube,
    (normal, offset): (DVec3, f64),
    is_mirror: bool,
    open: &[u32],
) -> Masked {
    let turned = |v: DVec3| {
        if is_mirror { v - 2.0 * normal.dot(v) * normal } else { v }
    };
    let moved = if is_mirror {
        2.0 * (normal.dot(hemicube.origin) - offset) * normal
    } else {
        DVec3::ZERO
    };
    Masked {
        what,
        origin: hemicube.origin - moved,
        axes: hemicube.axes.map(turned),
        normal,
        offset,
        open: open.to_vec(),
    }
}

/// A mirror and a pane across the scene, tilted, in all pixels and in stray ones, and a mirror in a triangle's plane.
fn passes(model: &Model, hemicube: &Hemicube, resolution: u32) -> Vec<Masked> {
    let [x, y, z] = hemicube.axes;
    let ahead = (z + 0.37 * x - 0.21 * y).normalize();
    let at = ahead.dot(hemicube.origin) + 0.2;
    let (all, stray) = (mask(resolution, false), mask(resolution, true));
    let mut found = vec![
        behind("a mirror", hemicube, (-ahead, -at), true, &all),
        behind("a pane", hemicube, (ahead, at), false, &all),
        behind("a mirror in stray pixels", hemicube, (-ahead, -at), true, &stray),
        behind("a pane in stray pixels", hemicube, (ahead, at), false, &stray),
    ];
    let planes = model.geometry().surfaces.iter().map(|surface| {
        let [a, b, c] = surface.corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        (normal, normal.dot(a))
    });
    let mut seen = planes.filter(|(normal, offset)| normal.dot(hemicube.origin) - offset > 0.05);
    if let Some(plane) = seen.next() {
        found.push(behind("a mirror of the scene", hemicube, plane, true, &all));
    }
    found
}

/// What a ray meets beyond the plane.
fn met(geometry: &Geometry, pass: &Pass<'_>, towards: DVec3) -> u32 {
    let mut nearest = (f64::INFINITY, Items::ESCAPED);
    for surface in &geometry.surfaces {
        let Some(side) = Side::new(surface, geometry, pass).filter(|side| side.contains(towards)) else {
            continue;
        };
        let distance = 1.0 / side.nearness(towards);
        let height = pass.normal.dot(pass.origin + towards * distance) - pass.offset;
        if !(distance.is_finite() && distance > 0.0 && height > 0.0) {
            continue;
        }
        let is_same = (distance - nearest.0).abs() <= 1e-9 * distance;
        if (is_same && side.id < nearest.1) || (!is_same && distance < nearest.0) {
            nearest = (distance, side.id);
        }
    }
    nearest.1
}

/// A pixel's ray, by an offset in pixels.
struct Rays {
    /// Right, up and ahead on the face.
    frame: [DVec3; 3],
    /// The pixel's centre on the face, at distance 1.
    center: [f64; 2],
    /// The edge of a pixel there.
    step: f64,
}

impl Rays {
    fn at(&self, offset: [f64; 2]) -> DVec3 {
        let [u, v, w] = self.frame;
        w + u * (self.center[0] + offset[0] * self.step) + v * (self.center[1] + offset[1] * self.step)
    }

    /// The corners of the square around the centre in which a driver may see it: [`EDGE`] to each side.
    fn corners(&self) -> [DVec3; 4] {
        [[-EDGE, -EDGE], [EDGE, -EDGE], [EDGE, EDGE], [-EDGE, EDGE]].map(|offset| self.at(offset))
    }

    /// Whether a part of a surface beyond the plane, within its slack, is in the square.
    fn may_meet(&self, surface: &Surface, geometry: &Geometry, pass: &Pass<'_>) -> bool {
        let [u, v, w] = self.frame;
        let reach = EDGE * self.step;
        let [x, y] = [(u, 0), (v, 1)].map(|(axis, k)| axis - w * self.center[k]);
        let above = pass.normal.dot(pass.origin) - pass.offset;
        let mut part: Vec<DVec3> = surface.corners.iter().map(|&corner| corner - pass.origin).collect();
        for side in [Some(x), Some(-x), Some(y), Some(-y), None] {
            let height = |&corner: &DVec3| match side {
                Some(side) => (side + w * reach).dot(corner),
                None => pass.normal.dot(corner) + above + slack(geometry, corner),
            };
            let heights: Vec<f64> = part.iter().map(height).collect();
            let mut kept = Vec::with_capacity(part.len() + 1);
            for k in 0..part.len() {
                let next = (k + 1) % part.len();
                if heights[k] >= 0.0 {
                    kept.push(part[k]);
                }
                if (heights[k] < 0.0) != (heights[next] < 0.0) {
                    kept.push(part[k].lerp(part[next], heights[k] / (heights[k] - heights[next])));
                }
            }
            part = kept;
        }
        !part.is_empty()
    }
}

/// Height over a portal's plane that a backend may take for none, at a place relative to the eye.
fn slack(geometry: &Geometry, place: DVec3) -> f64 {
    geometry.plane_tolerance + HEIGHT_SLACK * place.length()
}

/// A surface as the eye of a pass sees it.
struct Side<'s> {
    surface: &'s Surface,
    /// Of its edges: a ray on the inner side of each meets it. Each has the volume's sign there.
    edges: [DVec3; 3],
    volume: f64,
    id: u32,
}

impl<'s> Side<'s> {
    /// None where nothing of the surface is beyond the plane.
    fn new(surface: &'s Surface, geometry: &Geometry, pass: &Pass<'_>) -> Option<Self> {
        let heights = surface.corners.map(|corner| pass.normal.dot(corner) - pass.offset);
        if heights.iter().all(|&height| height <= geometry.plane_tolerance) {
            return None;
        }
        let [a, b, c] = surface.corners.map(|corner| corner - pass.origin);
        let volume = a.dot(b.cross(c));
        let back = surface.back.map_or(Items::BLOCKED, |patch| patch.0);
        Some(Self {
            surface,
            edges: [b.cross(c), c.cross(a), a.cross(b)],
            volume,
            // Corners turn counter-clockwise seen from the front: the volume is negative there.
            id: if volume < 0.0 { surface.front.0 } else { back },
        })
    }

    fn contains(&self, towards: DVec3) -> bool {
        let sides = self.edges.map(|edge| edge.dot(towards));
        sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0)
    }

    /// 1 / distance at which a ray meets its plane, in lengths of `towards`.
    fn nearness(&self, towards: DVec3) -> f64 {
        self.edges.iter().map(|edge| edge.dot(towards)).sum::<f64>() / self.volume
    }
}

/// Whether a driver that moves each triangle by at most [`EDGE`] may show `id`: one of its surfaces is in the pixel's
/// square, and its plane is not behind a surface that fills the square.
fn is_beside(geometry: &Geometry, pass: &Pass<'_>, rays: &Rays, id: u32) -> bool {
    let corners = rays.corners();
    let sides = || {
        geometry
            .surfaces
            .iter()
            .filter_map(|surface| Side::new(surface, geometry, pass))
    };
    let fills = |side: &Side<'_>| {
        corners.iter().all(|&ray| {
            let place = ray / side.nearness(ray);
            let height = pass.normal.dot(pass.origin + place) - pass.offset;
            // Not a number for a surface that is seen edge-on: none is filled by it.
            side.contains(ray) && side.nearness(ray) > 0.0 && height > slack(geometry, place)
        })
    };
    let farthest = |side: Side<'_>| {
        corners
            .map(|ray| side.nearness(ray))
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    };
    let filled = sides().filter(fills).map(farthest).fold(0.0, f64::max);
    if id == Items::ESCAPED {
        return filled == 0.0;
    }
    sides().filter(|side| side.id == id).any(|side| {
        let nearest = corners
            .map(|ray| side.nearness(ray))
            .into_iter()
            .fold(f64::NEG_INFINITY, f64::max);
        let is_behind = nearest * (1.0 + DEPTH_SLACK) < filled;
        !is_behind && rays.may_meet(side.surface, geometry, pass)
    })
}

/// The share of open pixels that are on an edge and show its other side; an error if it is more than drivers differ
/// by, or if another pixel is wrong.
fn edge_share(found: &Items, geometry: &Geometry, pass: &Pass<'_>, resolution: u32) -> Result<f64, String> {
    let (mut open, mut beside) = (0usize, 0usize);
    let n = f64::from(resolution);
    for face in Face::ALL {
        let (places, signs) = face.axes();
        let frame = std::array::from_fn(|k| pass.axes[places[k]] * signs[k]);
        let below = if face.is_top() { 1.0 } else { 0.0 };
        for y in 0..face.rows(resolution) {
            for x in 0..resolution {
                let pixel = ((face.first_row(resolution) + y) * resolution + x) as usize;
                let shown = found.seen[pixel];
                if !pass.is_open(pixel) {
                    if shown != Items::ESCAPED {
                        return Err(format!("closed pixel {pixel} shows {shown}"));
                    }
                    continue;
                }
                open += 1;
                let rays = Rays {
                    frame,
                    center: [
                        2.0 * (f64::from(x) + 0.5) / n - 1.0,
                        2.0 * (f64::from(y) + 0.5) / n - below,
                    ],
                    step: 2.0 / n,
                };
                let wanted = met(geometry, pass, rays.at([0.0; 2]));
                if shown == wanted {
                    continue;
                }
                if !is_beside(geometry, pass, &rays, shown) {
                    return Err(format!(
                        "pixel {pixel} shows {shown} where its ray meets {wanted}, and no edge within {EDGE} pixels of \
                         it tells these apart"
                    ));
                }
                beside += 1;
            }
        }
    }
    let share = beside as f64 / open.max(1) as f64;
    if beside > 2 && share > MOST_BESIDE {
        return Err(format!("{beside} of {open} open pixels show the other side of an edge"));
    }
    Ok(share)
}

/// Compares passes of one hemicube with rays: those of stray pixels, and where there are few pixels all. Returns their
/// number. The scene is loaded at `resolution`.
///
/// # Errors
/// The first pass that is off.
pub(crate) fn some_near_rays(
    backend: &mut dyn HemicubeBackend,
    model: &Model,
    hemicube: &Hemicube,
    resolution: u32,
) -> Result<usize, String> {
    let mut found = passes(model, hemicube, resolution);
    found.retain(|masked| resolution <= FEW || masked.is_stray());
    for masked in &found {
        let pass = masked.pass();
        let items = backend.pass(&pass);
        let items = items.map_err(|error| format!("{}: `pass` failed: {error}", masked.what))?;
        edge_share(&items, model.geometry(), &pass, resolution).map_err(|wrong| format!("{}: {wrong}", masked.what))?;
    }
    Ok(found.len())
}

/// Compares passes with rays, and asks for some against the contract. The scene is loaded at `resolution`.
///
/// # Errors
/// The first pass that is off.
pub(crate) fn near_rays(
    backend: &mut dyn HemicubeBackend,
    model: &Model,
    hemicubes: &[Hemicube],
    resolution: u32,
) -> Result<String, String> {
    let mut worst = 0f64;
    let mut count = 0;
    for hemicube in hemicubes.iter().step_by(5) {
        for masked in passes(model, hemicube, resolution) {
            let pass = masked.pass();
            let draw = |backend: &mut dyn HemicubeBackend| {
                backend
                    .pass(&pass)
                    .map_err(|error| format!("{}: `pass` failed: {error}", masked.what))
            };
            let found = draw(backend)?;
            let share = edge_share(&found, model.geometry(), &pass, resolution)
                .map_err(|wrong| format!("{}: {wrong}", masked.what))?;
            // What was drawn between leaves nothing behind.
            backend.items(hemicube).map_err(|error| error.to_string())?;
            if draw(backend)? != found {
                return Err(format!("{}: drawn again, other pixels are seen", masked.what));
            }
            worst = worst.max(share);
            count += 1;
        }
    }
    let masked = behind("", &hemicubes[0], (DVec3::X, 0.0), false, &mask(resolution, false));
    let pass = masked.pass();
    for (what, wrong) in [
        (
            "a mask that is cut short",
            Pass {
                open: &masked.open[1..],
                ..pass
            },
        ),
        (
            "an eye that is not finite",
            Pass {
                origin: DVec3::NAN,
                ..pass
            },
        ),
        (
            "a normal without length",
            Pass {
                normal: DVec3::ZERO,
                ..pass
            },
        ),
        (
            "axes that are not at right angles",
            Pass {
                axes: [DVec3::X; 3],
                ..pass
            },
        ),
    ] {
        match backend.pass(&wrong) {
            Err(BackendError::InvalidArgument(_)) => {}
            Err(other) => return Err(format!("{what}: refused, but as another error: {other}")),
            Ok(_) => return Err(format!("{what} was not refused")),
        }
    }
    Ok(format!(
        "{count} passes as rays are, but for pixels on edges: at most {worst:.1e} of the open ones"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::TestScene;

    const N: u32 = 32;

    /// What `met` says of each open pixel, by rays moved by `offset` pixels to the right.
    fn by_rays(geometry: &Geometry, pass: &Pass<'_>, offset: f64) -> Items {
        let mut seen = vec![Items::ESCAPED; pixel_count(N)];
        let n = f64::from(N);
        for face in Face::ALL {
            let (places, signs) = face.axes();
            let [u, v, w]: [DVec3; 3] = std::array::from_fn(|k| pass.axes[places[k]] * signs[k]);
            let below = if face.is_top() { 1.0 } else { 0.0 };
            for (y, x) in (0..face.rows(N)).flat_map(|y| (0..N).map(move |x| (y, x))) {
                let pixel = ((face.first_row(N) + y) * N + x) as usize;
                if pass.is_open(pixel) {
                    let a = 2.0 * (f64::from(x) + 0.5 + offset) / n - 1.0;
                    let b = 2.0 * (f64::from(y) + 0.5) / n - below;
                    seen[pixel] = met(geometry, pass, w + u * a + v * b);
                }
            }
        }
        Items { resolution: N, seen }
    }

    #[test]
    fn one_wrong_pixel_is_found_and_one_on_an_edge_is_not_wrong() {
        let model = TestScene::Room.model();
        let hemicubes = TestScene::Room.hemicubes(&model);
        let geometry = model.geometry();
        for masked in passes(&model, &hemicubes[0], N) {
            let pass = masked.pass();
            let right = by_rays(geometry, &pass, 0.0);
            assert_eq!(edge_share(&right, geometry, &pass, N), Ok(0.0), "{}", masked.what);
            let near = by_rays(geometry, &pass, 0.9 * EDGE);
            let share = edge_share(&near, geometry, &pass, N).expect("within the width of an edge");
            assert!(share < 0.1, "{}: {share}", masked.what);
            let far = by_rays(geometry, &pass, 0.5);
            edge_share(&far, geometry, &pass, N).expect_err("half a pixel off");
            let open = (0..pixel_count(N))
                .find(|&pixel| pass.is_open(pixel))
                .expect("an open pixel");
            let closed = (0..pixel_count(N)).find(|&pixel| !pass.is_open(pixel));
            for pixel in [Some(open), closed].into_iter().flatten() {
                let mut wrong = right.clone();
                wrong.seen[pixel] = Items::BLOCKED - 1;
                edge_share(&wrong, geometry, &pass, N).expect_err("a pixel of no patch");
            }
        }
    }
}
