//! What a device draws faster, by its rasteriser or by compute shaders: the option `draw=auto`.
//!
//! Hemicubes of a room of some 10,000 triangles are drawn both ways and timed. The room is no user's scene, so that a
//! device is judged alike in every run, and the version that a session reports says what was taken. Once a device and
//! process: all sessions of a run draw alike.
//!
//! The two ways differ in bits of rows, so that an interrupted matrix goes on only if the next run takes the same. Hence
//! compute has to be clearly faster (`CLEARLY`) in the least of `TURNS` turns. Counts of instructions would be
//! repeatable, but tell nothing of a rasteriser made of hardware; on drivers that run on the processor, compute takes 5
//! to 6 times the instructions and 6 to 12 times as long (docs/dev/gpu.md).
//!
//! Cost: 8 to 1,024 hemicubes either way, the next turn twice the one before, until one takes 50 ms; then two turns more.

use crate::limits::Draw;
use glam::DVec3;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{BackendError, Culling, Geometry, Hemicube, HemicubeBackend, RenderSettings, Surface};
use hemicube_contract::row::RowBlock;
use hemicube_spatial::{Aabb, Octree, OctreeOptions};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Squares along an edge of the room: 12 · 29² = 10,092 triangles, as many as the rates in docs/dev/gpu.md are of.
const SQUARES: u32 = 29;
/// Pixels along the edge of the top face, as for those rates.
const RESOLUTION: u32 = 128;
/// Hemicubes of the first turn, and of the largest. A choice: fewer do not fill a GPU (128 a submission by compute, some
/// of them); more take longer to open.
const FEWEST: usize = 8;
const MOST: usize = 1024;
/// The time from which on a turn is long enough. A choice: a shorter turn is decided by the clock's noise, a longer one
/// is waited for at each opening.
const ENOUGH: Duration = Duration::from_millis(50);
/// Turns of the number that was long enough. A choice: one alone may be slowed by what else runs; more are waited for.
const TURNS: u32 = 3;
/// The share of the rasteriser's time that compute takes at most to be chosen. A choice: closer to 1, runs may choose
/// differently; further away, a GPU that gains less is not used.
const CLEARLY: f64 = 0.8;

/// The way of drawing that a device is faster by, with seconds a hemicube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// The way to take.
    pub draw: Draw,
    /// Seconds a hemicube by the rasteriser.
    pub raster: f64,
    /// Seconds a hemicube by compute shaders; `None` where the device cannot, or fails to.
    pub compute: Option<f64>,
}

impl Probe {
    /// Compute where it is clearly faster. The rasteriser otherwise, which any device has.
    fn of(raster: f64, compute: Option<f64>) -> Self {
        let draw = match compute {
            Some(compute) if compute <= CLEARLY * raster => Draw::Compute,
            _ => Draw::Raster,
        };
        Self { draw, raster, compute }
    }

    /// Its line among a session's choices.
    pub fn line(&self) -> String {
        let took = |seconds: f64| format!("{:.3} ms", 1e3 * seconds);
        let word = match self.draw {
            Draw::Raster => "raster",
            Draw::Compute => "compute",
        };
        let compute = self.compute.map_or_else(|| "not at all".to_owned(), took);
        format!(
            "draw=auto takes {word}: {} a hemicube of a room by the rasteriser, {compute} by compute",
            took(self.raster)
        )
    }
}

/// Probes a device by sessions that `open` opens on it, or repeats what this process found.
///
/// # Errors
/// Those of `open` and of drawing by the rasteriser. A device that cannot draw by compute has the rasteriser alone.
pub fn probe<S: HemicubeBackend>(
    device: u32,
    mut open: impl FnMut(Draw) -> Result<S, BackendError>,
) -> Result<Probe, BackendError> {
    static FOUND: Mutex<BTreeMap<u32, Probe>> = Mutex::new(BTreeMap::new());
    let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(probe) = found.get(&device) {
        return Ok(*probe);
    }
    let room = Arc::new(room()?);
    let mut time = |draw| seconds_a_hemicube(&mut open(draw)?, &room);
    let probe = Probe::of(time(Draw::Raster)?, time(Draw::Compute).ok());
    found.insert(device, probe);
    Ok(probe)
}

fn seconds_a_hemicube(session: &mut dyn HemicubeBackend, room: &Arc<Geometry>) -> Result<f64, BackendError> {
    let settings = RenderSettings {
        resolution: RESOLUTION,
        culling: Culling::On,
        covered: false,
    };
    session.load(room, settings)?;
    let hemicubes: Vec<Hemicube> = (0..MOST).map(|k| on_floor(k, MOST)).collect();
    let mut rows = RowBlock::default();
    // Pipelines and memory are made by the first.
    session.rows(&hemicubes[..1], &mut rows)?;
    let mut turn = |count: usize| {
        rows.clear();
        let began = Instant::now();
        session.rows(&hemicubes[..count], &mut rows).map(|_| began.elapsed())
    };
    let mut count = FEWEST;
    let mut least = turn(count)?;
    while least < ENOUGH && count < MOST {
        count *= 2;
        least = turn(count)?;
    }
    for _ in 1..TURNS {
        least = least.min(turn(count)?);
    }
    Ok(least.as_secs_f64() / count as f64)
}

/// One of so many hemicubes along a line over the floor, looking up.
fn on_floor(k: usize, of: usize) -> Hemicube {
    let along = (k as f64 + 0.5) / of as f64;
    Hemicube {
        emitter: None,
        origin: DVec3::new(1.6 * along - 0.8, 0.31 - 0.17 * along, -0.97),
        axes: [DVec3::X, DVec3::Y, DVec3::Z],
    }
}

/// The inside of a cube of ±1, each face cut into squares of two triangles.
fn room() -> Result<Geometry, BackendError> {
    let step = 2.0 / f64::from(SQUARES);
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let place = |i: u32, j: u32| {
                let mut p = DVec3::splat(side);
                p[(axis + 1) % 3] = f64::from(i) * step - 1.0;
                p[(axis + 2) % 3] = f64::from(j) * step - 1.0;
                p
            };
            for j in 0..SQUARES {
                for i in 0..SQUARES {
                    let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| place(i + x, j + y));
                    let facing_in = if side < 0.0 {
                        [[a, b, c], [a, c, d]]
                    } else {
                        [[a, c, b], [a, d, c]]
                    };
                    triangles.extend(facing_in);
                }
            }
        }
    }
    let boxes: Vec<Aabb> = triangles.iter().map(|&corners| Aabb::from_points(corners)).collect();
    let octree = Octree::build_loose(&boxes, OctreeOptions::default())
        .map_err(|error| BackendError::Unsupported(format!("a room to probe a device by: {error}")))?;
    let surfaces: Vec<Surface> = (0u32..)
        .zip(octree.order())
        .map(|(patch, &triangle)| Surface {
            corners: triangles[triangle as usize],
            front: InputPatch(patch),
            back: None,
        })
        .collect();
    let patch_count = 12 * SQUARES * SQUARES;
    Ok(Geometry::new(surfaces, octree, patch_count, 1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clearly_faster_way_is_taken_and_said() {
        let probe = Probe::of(1e-3, Some(2e-3));
        assert_eq!(probe.draw, Draw::Raster);
        assert_eq!(
            probe.line(),
            "draw=auto takes raster: 1.000 ms a hemicube of a room by the rasteriser, 2.000 ms by compute"
        );
        assert_eq!(Probe::of(2e-3, Some(1e-3)).draw, Draw::Compute);
        assert_eq!(
            Probe::of(2e-3, Some(1.9e-3)).draw,
            Draw::Raster,
            "a hair faster is noise"
        );
        let without = Probe::of(2e-3, None);
        assert_eq!(without.draw, Draw::Raster);
        assert!(without.line().ends_with("not at all by compute"));
    }

    #[test]
    fn the_room_closes_around_its_hemicubes() {
        let room = room().expect("a cube");
        assert_eq!(room.surfaces.len(), 10_092);
        let area: f64 = room
            .surfaces
            .iter()
            .map(|s| {
                let [a, b, c] = s.corners;
                let normal = (b - a).cross(c - a);
                assert!(normal.dot(a) < 0.0, "it faces the middle");
                0.5 * normal.length()
            })
            .sum();
        assert!((area - 24.0).abs() < 1e-9);
        for k in [0, MOST - 1] {
            assert!(on_floor(k, MOST).origin.abs().max_element() < 1.0);
        }
    }
}
