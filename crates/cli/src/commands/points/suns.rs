//! Light, mean radiant temperature and UTCI at points, over the moments of a table of suns.
//!
//! On a body with the kernel k(ω) ([`hemicube::points`]) arrive, in W/m² of its surface on average:
//!
//! ```text
//! direct     π k(sun) E across the beam, if nothing stands before the sun; f_p E of a person, by the sun's altitude, and
//!            of a seated one, who faces somewhere, its azimuth
//! diffuse    F_sky π L, with L the mean of k L over the open sky, by rays to 9,217 parts of it; sun and sky through
//!            panes and off mirrors, too
//! reflected  Σ F_j B_j, of the radiosities B of a solution of light, and F_ground times what the ground below the
//!            horizon sends, by its reflectance in the table
//! ```
//!
//! The mean radiant temperature is that of black surroundings that would be absorbed as much of (VDI 3787 part 2, 2008),
//! and UTCI follows from it by the polynomial of Bröde et al. (2012).

use super::heat::Heat;
use super::sensors::Sensors;
use super::{Arguments, BodyName};
use crate::args::Talk;
use crate::exit::hinted;
use crate::forecast;
use crate::prepare::Prepared;
use crate::report::{PendingFile, count, counted};
use crate::suns::{Suns, first_difference};
use crate::table::field;
use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use hemicube::Model;
use hemicube::frame::Horizon;
use hemicube::points::{Body, Sensor, SensorRow, Table, level};
use hemicube::portal::Portals;
use hemicube::portal::sight::ThroughPortals;
use hemicube::reference::{RayEnd, Reference, ReferenceSettings};
use hemicube::sky::SkyDivision;
use hemicube::solve::{STEFAN_BOLTZMANN, StoredSolution};
use hemicube::store::Store;
use hemicube_weather::comfort::{CELSIUS_ZERO, Posture, absorbed, mean_radiant_temperature, projected_area, utci};
use std::f64::consts::PI;
use std::io::Write;
use std::path::Path;
use std::thread;

/// How finely the sky is divided: 9,217 parts, a ray to each. A choice: with fewer, more of the sky that a small opening
/// shows is missed (`light_and_heat::yardsticks`, the sixteen skies); with more, points take longer.
const PARTS: u32 = 8;
/// What takes less memory.
const FEWER: &str = "take fewer moments or points at a time";
/// Moments in the table on the terminal.
const SHOWN: usize = 24;
/// Least wind that UTCI is defined for, m/s; calmer air counts as that (Bröde et al. 2012).
const LEAST_WIND: f64 = 0.5;

/// The moments, and the radiosities at each.
pub(super) struct Hours {
    suns: Suns,
    /// Of light, by triangle, W/m²: one a moment, or none.
    light: Vec<Vec<f64>>,
    /// Of heat: one a moment, one for all, or none.
    heats: Vec<Heat>,
    /// True if `--sky-temperature` takes the place of the table's.
    is_sky_given: bool,
    /// What the ground below the horizon sends at each moment, W/m².
    ground: Vec<f64>,
}

/// What a row brings at a moment without its shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Brought {
    /// W/m².
    reflected: f64,
    /// Mean radiant temperature without light, K; NaN without heat.
    longwave: f64,
}

/// Results of a row at a moment: irradiances in W/m², the mean radiant temperature in K and UTCI in °C; NaN where they
/// are not known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Felt {
    direct: f64,
    diffuse: f64,
    reflected: f64,
    radiant: f64,
    utci: f64,
}

/// A quantity: its name with its unit, and how to take it.
type Column = (&'static str, fn(&Felt) -> f64);

impl Felt {
    fn irradiance(&self) -> f64 {
        self.direct + self.diffuse + self.reflected
    }
}

impl Hours {
    /// The moments of a table with the solutions given for them.
    ///
    /// # Errors
    /// When a solution has other moments, two are of one kind, or the body has no radiant temperature.
    pub(super) fn new(
        arguments: &Arguments,
        suns: Suns,
        solutions: &[(Store, StoredSolution)],
        prepared: &Prepared,
        (sensors, portals): (&Sensors, &Portals),
    ) -> Result<Self> {
        if suns.moments.iter().any(|moment| moment.planet.is_some()) {
            return Err(hinted(
                anyhow!(
                    "`{}` has a planet, and points see sun and sky alone",
                    suns.path.display()
                ),
                "`hemicube solve --suns` takes its light and its infrared; for points leave its columns out",
            ));
        }
        let (mut light, mut heats) = (Vec::new(), Vec::new());
        for (store, solution) in solutions {
            let is_of_heat = solution.report()["quantity"] == "heat";
            let radiosity = solution.quantity("radiosity")?;
            let rows = usize::try_from(radiosity.rows()).unwrap_or(usize::MAX);
            let what = if is_of_heat { "heat" } else { "light" };
            if rows != suns.len() && !(is_of_heat && rows == 1) {
                let hint = if !is_of_heat && rows.is_multiple_of(suns.len()) && rows > 0 {
                    "its bands are several; `bands = [\"all\"]` in the file of materials makes them one".to_owned()
                } else {
                    format!(
                        "`hemicube solve {} --suns {}` makes one",
                        crate::shell::word(store.directory()),
                        crate::shell::word(&suns.path)
                    )
                };
                return Err(hinted(
                    anyhow!(
                        "the solution of {what} in `{}` has {}, and `{}` {}",
                        store.directory().display(),
                        counted(rows as u64, "right-hand side"),
                        suns.path.display(),
                        counted(suns.len() as u64, "moment")
                    ),
                    hint,
                ));
            }
            if !(is_of_heat && rows == 1) {
                require_same_moments(&suns, store, solution)?;
            }
            // The radiosities of each right-hand side, by triangle.
            let bytes = 8 * radiosity.rows() * prepared.patches.len() as u64;
            let what = format!("a solution of {what}, {}", counted(rows as u64, "right-hand side"));
            forecast::require(prepared.budget, bytes, &what, FEWER)?;
            if is_of_heat {
                for row in 0..radiosity.rows() {
                    heats.push(Heat::new(arguments, solution, prepared, row)?);
                }
            } else {
                let read = |row: usize| {
                    let radiosity = radiosity.row(row as u64)?;
                    Ok(match &prepared.grouping {
                        Some(grouping) => grouping.spread(&radiosity),
                        None => radiosity,
                    })
                };
                light = (0..rows).map(read).collect::<Result<_>>()?;
            }
        }
        if !heats.is_empty() && matches!(sensors.body, BodyName::Plane | BodyName::Cube) {
            bail!("a mean radiant temperature with the sun is of `--as person`, `seated`, `sphere` or `cylinder`");
        }
        if !heats.is_empty() && !portals.is_empty() {
            return Err(hinted(
                anyhow!("panes let light through and little heat, and the rows of points are one for both"),
                "give the solution of light alone; a mean radiant temperature with the sun is of a scene without mirrors, \
                 panes, symmetry and periods",
            ));
        }
        let is_sky_given = arguments.sky_temperature.is_some();
        let up = sensors.horizon.up;
        Ok(Self {
            ground: suns.moments.iter().map(|moment| moment.ground_radiosity(up)).collect(),
            suns,
            light,
            heats,
            is_sky_given,
        })
    }

    /// Refuses what rays to sun and sky do not go through.
    ///
    /// # Errors
    /// For a scene with symmetry or a period, which a sun would have to have, too.
    pub(super) fn require_one_cell(portals: &Portals) -> Result<()> {
        if portals.images.is_none() {
            return Ok(());
        }
        bail!(
            "this scene has symmetry or a period, and a sun shines on all of its cells differently; give the whole scene"
        )
    }

    /// True if there is light of a solution.
    pub(super) fn has_light(&self) -> bool {
        !self.light.is_empty()
    }

    /// True if surfaces or the ground reflect light.
    fn has_reflected(&self) -> bool {
        self.has_light() || self.ground.iter().any(|&sent| sent > 0.0)
    }

    /// What a row brings at each moment.
    pub(super) fn of_row(&self, row: &SensorRow) -> Vec<Brought> {
        let heat = |moment: usize| self.heats.get(if self.heats.len() == 1 { 0 } else { moment });
        let of = |moment: usize| Brought {
            reflected: row.ground * self.ground[moment]
                + self.light.get(moment).map_or(0.0, |radiosity| {
                    let of_patch =
                        |&(patch, factor): &(hemicube::InputPatch, f64)| factor * radiosity[patch.0 as usize];
                    row.patches.iter().map(of_patch).sum::<f64>()
                }),
            longwave: heat(moment).map_or(f64::NAN, |heat| {
                let sky = self.suns.moments[moment].sky_temperature.filter(|_| !self.is_sky_given);
                heat.temperature_under(row, sky)
            }),
        };
        (0..self.suns.len()).map(of).collect()
    }

    /// Results of all rows at all moments, a moment after the other in each row. `rows` are the share of sky of each row
    /// and what it brings.
    ///
    /// # Errors
    /// When the scene is too large for rays, or a sky has no radiance.
    pub(super) fn felt(
        &self,
        prepared: &Prepared,
        (sensors, portals): (&Sensors, &Portals),
        rows: &[(f64, &[Brought])],
        threads: usize,
    ) -> Result<Vec<Felt>> {
        let results = rows.len() as u64 * self.suns.len() as u64;
        let what = format!("results of {} points and moments", count(results));
        forecast::require(prepared.budget, results * size_of::<Felt>() as u64, &what, FEWER)?;
        let reference = Reference::new(&prepared.model, ReferenceSettings::default())?;
        let skies = self.skies(prepared, sensors, portals)?;
        let each = sensors.items.first().map_or(1, |sensor| sensor.body.rows());
        let share = sensors.items.len().div_ceil(threads.max(1)).max(1);
        let found: Vec<Vec<Felt>> = thread::scope(|scope| {
            let workers: Vec<_> = (0..sensors.items.len())
                .step_by(share)
                .map(|first| {
                    let (reference, skies) = (&reference, &skies);
                    let model = &prepared.model;
                    scope.spawn(move || {
                        let mut found = Vec::new();
                        let specular = portals.specular.as_ref();
                        let mut open = Open {
                            reference,
                            through: specular.map(|specular| ThroughPortals::new(specular, None, model)),
                            model,
                        };
                        for sensor in first..(first + share).min(sensors.items.len()) {
                            let rows = &rows[sensor * each..(sensor + 1) * each];
                            self.at(&mut open, sensors, sensor, rows, skies, &mut found);
                        }
                        found
                    })
                })
                .collect();
            let join = |worker: thread::ScopedJoinHandle<'_, Vec<Felt>>| {
                worker
                    .join()
                    .unwrap_or_else(|payload| std::panic::resume_unwind(payload))
            };
            workers.into_iter().map(join).collect()
        });
        Ok(found.into_iter().flatten().collect())
    }

    fn skies(&self, prepared: &Prepared, sensors: &Sensors, portals: &Portals) -> Result<Option<Skies>> {
        if self.suns.uneven().is_none() {
            return Ok(None);
        }
        let division = SkyDivision::new(PARTS).context("a division of the sky")?;
        let numbers = self.suns.len() as u64 * u64::from(division.columns());
        let what = format!("skies of {}", counted(self.suns.len() as u64, "moment"));
        forecast::require(prepared.budget, 8 * numbers, &what, FEWER)?;
        let horizon = sensors.horizon;
        // A mirror below shows the sky, too.
        let ways = if portals.specular.is_some() {
            [1.0, -1.0].as_slice()
        } else {
            &[1.0]
        };
        let radiances: Vec<Vec<f64>> = (0..self.suns.len())
            .map(|at| self.suns.radiances(at, &division, horizon))
            .collect::<Result<_>>()?;
        let rays: Vec<SkyRay> = (1..division.columns())
            .flat_map(|column| ways.iter().map(move |way| (column, way)))
            .map(|(column, way)| {
                let middle = division.middle(column);
                SkyRay {
                    direction: horizon.direction([middle.x, middle.y, way * middle.z]),
                    solid_angle: division.solid_angle(column),
                    column: column as usize,
                }
            })
            .collect();
        Ok(Some(Skies {
            rays,
            division,
            radiances,
        }))
    }

    /// Results of a sensor, row after row.
    fn at(
        &self,
        open: &mut Open<'_>,
        sensors: &Sensors,
        sensor: usize,
        rows: &[(f64, &[Brought])],
        skies: &Option<Skies>,
        found: &mut Vec<Felt>,
    ) {
        let (item, horizon) = (&sensors.items[sensor], &sensors.horizon);
        // The weight of each column of the sky in each row, as far as it is open.
        let weights: Option<Vec<Vec<f64>>> = skies.as_ref().map(|skies| {
            let columns = skies.radiances.first().map_or(0, Vec::len);
            let mut weights = vec![vec![0.0; columns]; rows.len()];
            for ray in &skies.rays {
                let kernel = item.body.kernel(horizon, ray.direction);
                if !kernel.iter().any(|&kernel| kernel > 0.0) {
                    continue;
                }
                for (towards, share) in open.leaving(item.position, ray.direction) {
                    // What leaves downwards goes to the ground.
                    if towards.dot(horizon.up) < 0.0 {
                        continue;
                    }
                    let column = if towards == ray.direction {
                        ray.column
                    } else {
                        let [east, north, up] = [horizon.east, horizon.north, horizon.up].map(|axis| axis.dot(towards));
                        skies.division.column(DVec3::new(east, north, up)) as usize
                    };
                    for (weights, kernel) in weights.iter_mut().zip(&kernel) {
                        weights[column] += kernel * ray.solid_angle * share;
                    }
                }
            }
            weights
        });
        let direct: Vec<Vec<f64>> = self
            .suns
            .moments
            .iter()
            .map(|moment| {
                let mut sums = vec![0.0; rows.len()];
                if moment.direct == 0.0 || horizon.is_below(moment.direction) {
                    return sums;
                }
                for (sun, share) in open.suns(item.position, moment.direction) {
                    let direct = share * moment.direct;
                    for (sum, factor) in sums.iter_mut().zip(of_beam(item, horizon, sun)) {
                        *sum += factor * direct;
                    }
                }
                sums
            })
            .collect();
        for (side, &(sky, brought)) in rows.iter().enumerate() {
            for (at, (moment, brought)) in self.suns.moments.iter().zip(brought).enumerate() {
                let diffuse = match (skies, &weights) {
                    (Some(skies), Some(weights)) => {
                        sky * PI * mean(&weights[side], &skies.radiances[at], moment.diffuse)
                    }
                    _ => sky * moment.diffuse,
                };
                let mut felt = Felt {
                    direct: direct[at][side],
                    diffuse,
                    reflected: brought.reflected,
                    radiant: f64::NAN,
                    utci: f64::NAN,
                };
                if brought.longwave.is_finite() {
                    let longwave = STEFAN_BOLTZMANN * brought.longwave.powi(4);
                    let radiant = mean_radiant_temperature(absorbed(felt.irradiance(), longwave));
                    felt.radiant = radiant.unwrap_or(f64::NAN);
                    if let Some(air) = moment.air {
                        let radiant = felt.radiant - CELSIUS_ZERO;
                        let wind = air.wind.max(LEAST_WIND);
                        felt.utci = utci(air.temperature, radiant, wind, air.humidity).unwrap_or(f64::NAN);
                    }
                }
                found.push(felt);
            }
        }
    }

    /// Names of the quantities that there are, with their units, and how to take them.
    fn columns(&self) -> Vec<Column> {
        let mut columns: Vec<Column> = vec![
            ("direct (W/m2)", |felt| felt.direct),
            ("diffuse (W/m2)", |felt| felt.diffuse),
        ];
        if self.has_reflected() {
            columns.push(("reflected (W/m2)", |felt| felt.reflected));
        }
        columns.push(("irradiance (W/m2)", Felt::irradiance));
        if !self.heats.is_empty() {
            columns.push(("mean_radiant_temperature (K)", |felt| felt.radiant));
            if self.suns.moments.iter().any(|moment| moment.air.is_some()) {
                columns.push(("utci (degC)", |felt| felt.utci));
            }
        }
        columns
    }

    /// Means over all rows, a line a moment.
    pub(super) fn text(&self, felt: &[Felt]) -> String {
        let columns = self.columns();
        let moments = self.suns.len();
        let lines = self.suns.names.iter().take(SHOWN).enumerate().map(|(at, name)| {
            let mut line = vec![name.clone()];
            for (_, of) in &columns {
                let known = felt
                    .iter()
                    .skip(at)
                    .step_by(moments)
                    .map(of)
                    .filter(|value| value.is_finite());
                let (sum, count) = known.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
                line.push(match count {
                    0 => "–".to_owned(),
                    _ => format!("{:.1}", sum / f64::from(count)),
                });
            }
            line
        });
        let mut head = vec!["moment, mean of all points"];
        head.extend(columns.iter().map(|(name, _)| *name));
        let mut text = crate::report::table_of(&head, lines);
        if moments > SHOWN {
            text.push_str(&format!("{} more are not shown\n", count((moments - SHOWN) as u64)));
        }
        text
    }

    /// Says what the results lack: reflected light, and UTCI where its polynomial is not defined.
    pub(super) fn tell(&self, felt: &[Felt], talk: Talk) {
        if !self.has_light() {
            talk.warn(&format!(
                "light that surfaces reflect is left out; `hemicube solve DIR --suns {}` makes a solution of it for \
                 `--solution DIR:radiosity`",
                crate::shell::word(&self.suns.path)
            ));
        }
        if let Some(lacks) = self.suns.lacks_air.as_ref().filter(|_| !self.heats.is_empty()) {
            talk.warn(&format!(
                "no UTCI: `{}` has {lacks}; all of `air_temperature`, `humidity` and `wind` are needed for it",
                self.suns.path.display()
            ));
        }
        let moments = self.suns.moments.iter().cycle();
        let undefined = felt
            .iter()
            .zip(moments)
            .filter(|(felt, moment)| moment.air.is_some() && felt.radiant.is_finite() && felt.utci.is_nan())
            .count() as u64;
        if undefined > 0 {
            talk.warn(&format!(
                "no UTCI in {}: it is defined for air of -50 to 50 °C, a mean radiant temperature from 30 K below to 70 K \
                 above that, wind to 17 m/s and a vapour pressure to 5 kPa",
                counted(undefined, "result")
            ));
        }
    }

    /// Writes a line a moment and row.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn csv(&self, path: &Path, sensors: &Sensors, felt: &[Felt]) -> Result<()> {
        let cannot = || format!("`{}` cannot be written", path.display());
        let each = sensors.items.first().map_or(1, |sensor| sensor.body.rows());
        let (columns, moments) = (self.columns(), self.suns.len());
        let mut file = PendingFile::create(path)?;
        let mut out = std::io::BufWriter::new(&mut file);
        let side = if each > 1 { ",side" } else { "" };
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        writeln!(out, "moment,point,x,y,z{side},{}", names.join(",")).with_context(cannot)?;
        for (at, name) in self.suns.names.iter().enumerate() {
            for (row, felt) in felt.iter().skip(at).step_by(moments).enumerate() {
                let [x, y, z] = sensors.items[row / each].position.to_array();
                write!(out, "{},{},{x},{y},{z}", field(name), row / each).with_context(cannot)?;
                if each > 1 {
                    write!(out, ",{}", super::output::SIDES[row % each].0).with_context(cannot)?;
                }
                for (_, of) in &columns {
                    match of(felt) {
                        value if value.is_finite() => write!(out, ",{value:.3}"),
                        _ => write!(out, ","),
                    }
                    .with_context(cannot)?;
                }
                writeln!(out).with_context(cannot)?;
            }
        }
        out.flush().with_context(cannot)?;
        drop(out);
        file.commit()
    }

    /// The results as arrays: a row a moment, a column a row of the sensors.
    pub(super) fn arrays(&self, felt: &[Felt]) -> Vec<(&'static str, Table)> {
        let moments = self.suns.len();
        let shape = vec![moments as u64, (felt.len() / moments) as u64];
        let columns = self.columns().into_iter().map(|(name, of)| {
            let name = name.split(' ').next().unwrap_or(name);
            let values = (0..moments)
                .flat_map(|at| felt.iter().skip(at).step_by(moments).map(of))
                .collect();
            (name, Table::Real(shape.clone(), values))
        });
        columns.collect()
    }

    /// The mean radiant temperature of each row on average over the moments; `None` without heat.
    pub(super) fn radiant_means(&self, felt: &[Felt]) -> Option<Vec<f64>> {
        let mean = |row: &[Felt]| row.iter().map(|felt| felt.radiant).sum::<f64>() / row.len() as f64;
        (!self.heats.is_empty()).then(|| felt.chunks(self.suns.len()).map(mean).collect())
    }
}

/// Requires that a solution has the moments of a table of suns in its order, where both name them.
fn require_same_moments(suns: &Suns, store: &Store, solution: &StoredSolution) -> Result<()> {
    let named = solution.report()["moments"].as_array();
    let names: Vec<String> = named
        .into_iter()
        .flatten()
        .map(|name| name.as_str().unwrap_or_default().to_owned())
        .collect();
    // A solution by a `.npy` numbers its moments.
    if names.iter().enumerate().all(|(at, name)| *name == at.to_string()) {
        return Ok(());
    }
    let Some(at) = first_difference(&suns.names, &names) else {
        return Ok(());
    };
    let what = solution.report()["quantity"].as_str().unwrap_or_default();
    Err(hinted(
        anyhow!(
            "moment {} is `{}` in `{}` and `{}` in the solution of {what} in `{}`",
            at + 1,
            suns.names[at],
            suns.path.display(),
            names[at],
            store.directory().display()
        ),
        format!(
            "`hemicube solve {} --suns {}` makes a solution of these moments",
            crate::shell::word(store.directory()),
            crate::shell::word(&suns.path)
        ),
    ))
}

/// Radiances of the skies, and rays to them.
struct Skies {
    rays: Vec<SkyRay>,
    division: SkyDivision,
    /// W/(m² sr), by moment and column.
    radiances: Vec<Vec<f64>>,
}

struct SkyRay {
    direction: DVec3,
    solid_angle: f64,
    column: usize,
}

/// What is seen of sun and sky from a point.
struct Open<'a> {
    reference: &'a Reference<'a>,
    /// Where there are mirrors or panes.
    through: Option<ThroughPortals>,
    model: &'a Model,
}

impl Open<'_> {
    /// The directions in which a ray leaves the scene in the end, and the parts of it that do.
    fn leaving(&mut self, from: DVec3, direction: DVec3) -> Vec<(DVec3, f64)> {
        match &mut self.through {
            Some(through) => through.leaving(self.model.normalise(from), direction),
            None if self.reference.first(from, direction) == RayEnd::Nothing => vec![(direction, 1.0)],
            None => Vec::new(),
        }
    }

    /// The directions in which a sun is seen, and the shares of its light that come from them.
    fn suns(&mut self, from: DVec3, sun: DVec3) -> Vec<(DVec3, f64)> {
        match &mut self.through {
            Some(through) => through.suns(self.model.normalise(from), sun),
            None => self.leaving(from, sun),
        }
    }
}

/// Returns the irradiance of each side of a body by a beam of 1 W/m²: π k, or the projected area factor of a person.
fn of_beam(item: &Sensor, horizon: &Horizon, sun: DVec3) -> Vec<f64> {
    let altitude = sun.dot(horizon.up).clamp(-1.0, 1.0).asin().to_degrees().abs();
    let factor = match item.body {
        Body::Person => projected_area(altitude, None, Posture::Standing),
        Body::Seated(facing) => {
            let facing = facing
                .and_then(|facing| level(horizon, facing))
                .zip(level(horizon, sun));
            let azimuth = facing.map(|(facing, sun)| facing.dot(sun).clamp(-1.0, 1.0).acos().to_degrees());
            projected_area(altitude, azimuth, Posture::Seated)
        }
        _ => {
            let kernel = item.body.kernel(horizon, sun);
            return kernel.into_iter().map(|kernel| PI * kernel).collect();
        }
    };
    vec![factor.unwrap_or(f64::NAN)]
}

/// The mean radiance by weights; of an even sky of this irradiance where no ray reached it.
fn mean(weights: &[f64], radiances: &[f64], diffuse: f64) -> f64 {
    let sums = weights
        .iter()
        .zip(radiances)
        .fold((0.0, 0.0), |(sum, whole), (weight, radiance)| {
            (sum + weight * radiance, whole + weight)
        });
    if sums.1 > 0.0 { sums.0 / sums.1 } else { diffuse / PI }
}
