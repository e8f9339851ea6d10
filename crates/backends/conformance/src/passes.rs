//! Passes through portals against rays: one through each open pixel, to every triangle, in f64.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, Geometry, Hemicube, HemicubeBackend, Pass};
use hemicube::face::{Face, Items, pixel_count};

/// Share of the open pixels that may differ, and one pixel more: drivers snap corners to 1/256 of a pixel.
const PIXELS: f64 = 1.5e-3;

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
        let heights = surface.corners.map(|corner| pass.normal.dot(corner) - pass.offset);
        if heights.iter().all(|&height| height <= geometry.plane_tolerance) {
            continue;
        }
        let [a, b, c] = surface.corners.map(|corner| corner - pass.origin);
        let sides = [b.cross(c), c.cross(a), a.cross(b)].map(|normal| normal.dot(towards));
        let volume = a.dot(b.cross(c));
        let is_within = sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0);
        let sum: f64 = sides.iter().sum();
        if !is_within || volume == 0.0 || sum == 0.0 {
            continue;
        }
        let distance = volume / sum;
        let height = pass.normal.dot(pass.origin + towards * distance) - pass.offset;
        if distance <= 0.0 || height <= 0.0 {
            continue;
        }
        let back = surface.back.map_or(Items::BLOCKED, |patch| patch.0);
        // Corners turn counter-clockwise seen from the front: the volume is negative there.
        let id = if volume < 0.0 { surface.front.0 } else { back };
        let is_same = (distance - nearest.0).abs() <= 1e-9 * distance;
        if (is_same && id < nearest.1) || (!is_same && distance < nearest.0) {
            nearest = (distance, id);
        }
    }
    nearest.1
}

/// The share of open pixels that differ from rays, without the first; an error if a closed one shows anything.
fn share(found: &Items, model: &Model, pass: &Pass<'_>, resolution: u32) -> Result<f64, String> {
    let (mut open, mut different) = (0usize, 0usize);
    let n = f64::from(resolution);
    for face in Face::ALL {
        let (places, signs) = face.axes();
        let [u, v, w]: [DVec3; 3] = std::array::from_fn(|k| pass.axes[places[k]] * signs[k]);
        let below = if face.is_top() { 1.0 } else { 0.0 };
        for y in 0..face.rows(resolution) {
            for x in 0..resolution {
                let pixel = ((face.first_row(resolution) + y) * resolution + x) as usize;
                if !pass.is_open(pixel) {
                    if found.seen[pixel] != Items::ESCAPED {
                        return Err(format!("closed pixel {pixel} shows {}", found.seen[pixel]));
                    }
                    continue;
                }
                open += 1;
                let [a, b] = [
                    2.0 * (f64::from(x) + 0.5) / n - 1.0,
                    2.0 * (f64::from(y) + 0.5) / n - below,
                ];
                let wanted = met(model.geometry(), pass, w + u * a + v * b);
                different += usize::from(found.seen[pixel] != wanted);
            }
        }
    }
    // Of few open pixels one on an edge is a large share.
    Ok(different.saturating_sub(1) as f64 / open.max(1) as f64)
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
            let share = share(&found, model, &pass, resolution).map_err(|wrong| format!("{}: {wrong}", masked.what))?;
            if share > PIXELS {
                return Err(format!(
                    "{}: {share:.1e} of the open pixels differ from rays; {PIXELS:.0e} may",
                    masked.what
                ));
            }
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
        "{count} passes, at most {worst:.1e} of the open pixels differ from rays"
    ))
}
