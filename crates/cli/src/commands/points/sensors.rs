//! The sensors of a run: read from a table or laid out on a grid, and where they are.

use super::grid::Raster;
use super::{Arguments, BodyName};
use crate::args::Talk;
use crate::exit::hinted;
use crate::prepare::Prepared;
use crate::table::{self, Either};
use anyhow::{Result, anyhow};
use glam::DVec3;
use hemicube::diagnose::{Place, places};
use hemicube::frame::Horizon;
use hemicube::points::Sensor;
use hemicube::portal::Portals;
use hemicube::sky::SensorPoint;
use std::path::Path;

/// Points and, where they have them, normals, names and the names of their zones.
pub(super) struct Listed {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Option<Vec<DVec3>>,
    pub(super) lines: Vec<u64>,
    pub(super) names: Option<Vec<String>>,
    pub(super) zones: Option<Vec<String>>,
}

/// Origin of the sensors.
pub(super) enum Source {
    Listed(Listed),
    Grid(super::grid::Grid),
}

/// Reads `x y z` or `x y z nx ny nz` a line, and the columns `name` and `zone` where the table has them.
///
/// # Errors
/// When the file cannot be read, or a line is malformed: the error names it.
pub(super) fn read(path: &Path) -> Result<Listed> {
    let (names, zones) = (table::words(path, "name")?, table::words(path, "zone")?);
    match table::read_either(path, ["x", "y", "z"], ["x", "y", "z", "nx", "ny", "nz"])? {
        Either::First(rows) => Ok(Listed {
            positions: rows.iter().map(|row| DVec3::from_array(row.values)).collect(),
            normals: None,
            lines: rows.iter().map(|row| row.line).collect(),
            names,
            zones,
        }),
        Either::Second(rows) => {
            let points: Result<Vec<_>> = rows.iter().map(|row| row.looking(path)).collect();
            let (positions, normals) = points?.into_iter().unzip();
            Ok(Listed {
                positions,
                normals: Some(normals),
                lines: rows.iter().map(|row| row.line).collect(),
                names,
                zones,
            })
        }
    }
}

/// The sensors of a run.
pub(super) struct Sensors {
    pub(super) items: Vec<Sensor>,
    pub(super) body: BodyName,
    pub(super) normals: Option<Vec<DVec3>>,
    pub(super) places: Vec<Place>,
    lines: Vec<u64>,
    /// Names of points and of their zones, of a table that has them.
    pub(super) names: Option<Vec<String>>,
    pub(super) zones: Option<Vec<String>>,
    pub(super) raster: Option<Raster>,
    pub(super) horizon: Horizon,
    /// A grid at a height above the ground: its planes look up.
    is_level: bool,
}

impl Sensors {
    pub(super) fn new(arguments: &Arguments, source: Source, prepared: &Prepared, horizon: &Horizon) -> Result<Self> {
        let threads = arguments.engine.thread_count();
        let (listed, mut raster) = match source {
            Source::Listed(listed) => (listed, None),
            Source::Grid(grid) => (
                Listed {
                    positions: grid.positions,
                    normals: Some(grid.normals),
                    lines: Vec::new(),
                    names: None,
                    zones: None,
                },
                Some(grid.raster),
            ),
        };
        let Listed {
            positions,
            normals,
            lines,
            names,
            zones,
        } = listed;
        // A map of views is of what looks up; a radiant temperature is of a body in the open.
        let is_level = arguments.height.is_some();
        let has_heat = !arguments.solution.is_empty() || arguments.temperatures.is_some();
        let default = if normals.is_some() && !(is_level && has_heat) {
            BodyName::Plane
        } else {
            BodyName::Sphere
        };
        let body = arguments.body.unwrap_or(default);
        if body == BodyName::Plane && normals.is_none() {
            return Err(hinted(
                anyhow!("`--as plane` needs the direction of each point, its normal"),
                "give `x y z nx ny nz` a line, or `--as sphere`",
            ));
        }
        // A grid's normals are its surfaces', and nobody faces along them.
        let is_grid = raster.is_some();
        let used = normals.filter(|_| body == BodyName::Plane || body == BodyName::Seated && !is_grid);
        let normal = |at: usize| used.as_ref().map_or(horizon.up, |normals| normals[at]);
        let looks: Vec<SensorPoint> = (0..)
            .zip(&positions)
            .map(|(at, &position)| SensorPoint {
                position,
                normal: normal(at),
            })
            .collect();
        // A grid above the ground has left out what is in solids.
        let mut places = if is_level {
            vec![Place::Open; looks.len()]
        } else {
            places_of(prepared, &looks, horizon, threads, body)
        };
        let mut items: Vec<Sensor> = looks
            .iter()
            .map(|look| Sensor {
                position: look.position,
                body: body.with(look.normal, used.as_ref().map(|_| look.normal)),
            })
            .collect();
        let mut normals = used;
        if let Some(raster) = &mut raster {
            // A grid leaves out what is in solids or below the ground.
            let stays: Vec<bool> = places
                .iter()
                .map(|place| !matches!(place, Place::InSolid | Place::BelowGround))
                .collect();
            raster.keep(&stays);
            let mut stay = stays.iter();
            items.retain(|_| stay.next().copied().unwrap_or(false));
            let mut stay = stays.iter();
            places.retain(|_| stay.next().copied().unwrap_or(false));
            if let Some(normals) = &mut normals {
                let mut stay = stays.iter();
                normals.retain(|_| stay.next().copied().unwrap_or(false));
            }
        }
        if items.is_empty() {
            return Err(hinted(
                anyhow!("no point of the grid is in the open"),
                "look at `--height`, `--on` and `--up`, and whether surfaces face outwards (`hemicube inspect`)",
            ));
        }
        Ok(Self {
            items,
            body,
            normals,
            places,
            lines,
            names,
            zones,
            raster,
            horizon: *horizon,
            is_level,
        })
    }

    /// The form of a sensor in words, by which its view factors are told from those of another form.
    pub(super) fn form(&self) -> &'static str {
        match self.body {
            BodyName::Plane if self.is_level => "horizontal plane",
            BodyName::Plane => "plane",
            BodyName::Sphere => "sphere",
            BodyName::Cube => "side of a cube",
            BodyName::Person => "standing person",
            BodyName::Seated => "seated person",
            BodyName::Cylinder => "upright cylinder",
        }
    }

    /// Refuses points beyond a period.
    ///
    /// # Errors
    /// Names the first of them.
    pub(super) fn require_within(&self, portals: &Portals) -> Result<()> {
        let Some(images) = &portals.images else { return Ok(()) };
        let Some(at) = self.items.iter().position(|sensor| !images.holds(sensor.position)) else {
            return Ok(());
        };
        let place = match self.lines.get(at) {
            Some(line) => format!("the point of line {line}"),
            None => format!("point {at}"),
        };
        Err(hinted(
            anyhow!("{place}, at {}, lies outside the period", self.items[at].position),
            "what it sees is what the point sees that lies a period further in: give that one",
        ))
    }

    /// Warns of points that are not in the open, by place.
    pub(super) fn tell(&self, arguments: &Arguments, talk: Talk) {
        if let Some(path) = &arguments.points {
            let places = self.places.iter().copied().zip(self.lines.iter().copied());
            crate::report::tell_of_places(path, self.items.len(), places, talk);
        }
    }
}

/// The place of each point, on several threads. Without a normal, a point is behind nothing.
fn places_of(
    prepared: &Prepared,
    looks: &[SensorPoint],
    horizon: &Horizon,
    threads: usize,
    body: BodyName,
) -> Vec<Place> {
    let share = looks.len().div_ceil(threads.max(1)).max(1);
    let mut found: Vec<Place> = std::thread::scope(|scope| {
        let workers: Vec<_> = looks
            .chunks(share)
            .map(|looks| scope.spawn(|| places(&prepared.model, looks, horizon.up)))
            .collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, Vec<Place>>| {
            worker
                .join()
                .unwrap_or_else(|payload| std::panic::resume_unwind(payload))
        };
        workers.into_iter().flat_map(join).collect()
    });
    if body != BodyName::Plane {
        for place in &mut found {
            *place = if *place == Place::BehindSheet {
                Place::Open
            } else {
                *place
            };
        }
    }
    found
}
