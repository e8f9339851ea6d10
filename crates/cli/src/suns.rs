//! Tables of suns, for `solve` and `points`; `hemicube suns` makes them.
//!
//! ```text
//! time,x,y,z,direct (W/m2),diffuse (W/m2),sky
//! 09:00,0.5,-0.7,0.5,700,90,perez
//! 12:00,0,-0.5,0.87,850,110,perez
//! ```
//!
//! A line is a moment: the direction towards the sun, its irradiance across the beam and, where there is one, the sky's
//! on a level plane that sees all of it. The direction is `x,y,z` in the scene's axes, or `azimuth,altitude` in
//! degrees: clockwise from north, and above the horizon (`elevation` is `altitude`). The first column that is called
//! `time`, `moment`, `hour` or `name` names the moments. Further columns: `sky` says how the sky's radiance is spread
//! (`uniform` without it), `extraterrestrial` the sun's irradiance above the atmosphere, and `sky_temperature` (K),
//! `air_temperature` (°C), `humidity` (%) and `wind` (m/s) what else people and surfaces feel. `ground` is the
//! reflectance of a level ground without end, in the open sun and sky, which is seen below the horizon where the scene
//! leaves off; without it that is dark. A column that nothing reads is warned of, and one that is misspelt refused.
//!
//! A planet below a satellite has `planet_x`, `planet_y`, `planet_z` (the direction towards its middle), `half_angle`
//! (degrees, of its disc), and `albedo` and `infrared`: the sunlight that it reflects and the heat that it sends, W/m² of
//! its surface.

use crate::exit::hinted;
use crate::report::{count, counted};
use crate::table::{Head, Unit, head, short, told};
use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use hemicube::frame::Horizon;
use hemicube::sky::SkyDivision;
use hemicube_weather::sky::{Cie, Model, Patch, Perez, radiances};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use strsim::levenshtein;

/// The sun's irradiance above the atmosphere where a table does not say it, W/m² (ASTM E490-00).
const EXTRATERRESTRIAL: f64 = 1366.1;

/// How the radiance of the sky is spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SkyModel {
    /// The same from everywhere.
    Uniform,
    /// A standard sky of the CIE, 1 to 16.
    Cie(u8),
    /// By Perez, Seals and Michalsky (1993).
    Perez,
}

impl FromStr for SkyModel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match &*text.to_ascii_lowercase() {
            "uniform" => Ok(Self::Uniform),
            "perez" => Ok(Self::Perez),
            "overcast" => Ok(Self::Cie(16)),
            "clear" => Ok(Self::Cie(12)),
            name => name
                .strip_prefix("cie")
                .and_then(|number| number.parse().ok())
                .filter(|number| (1..=16).contains(number))
                .map(Self::Cie)
                .ok_or_else(|| {
                    "uniform, overcast, clear, perez, or a standard sky, cie1 to cie16, is needed".to_owned()
                }),
        }
    }
}

impl fmt::Display for SkyModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uniform => f.write_str("uniform"),
            Self::Cie(16) => f.write_str("overcast"),
            Self::Cie(12) => f.write_str("clear"),
            Self::Cie(number) => write!(f, "cie{number}"),
            Self::Perez => f.write_str("perez"),
        }
    }
}

/// The air at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Air {
    /// °C.
    pub(crate) temperature: f64,
    /// Relative humidity, %.
    pub(crate) humidity: f64,
    /// Speed of the wind 10 m above the ground, m/s.
    pub(crate) wind: f64,
}

/// A planet: a disc of even radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Planet {
    /// Towards its middle, of length 1.
    pub(crate) direction: DVec3,
    /// Half of the angle that it spans, radians: above 0, up to π / 2.
    pub(crate) half_angle: f64,
    /// Sunlight that it sends, W/m² of its surface.
    pub(crate) albedo: f64,
    /// Heat that it sends, W/m² of its surface.
    pub(crate) infrared: f64,
}

impl Planet {
    /// The bits of its direction and half angle: planets that have the same are one disc.
    pub(crate) fn place(&self) -> [u64; 4] {
        let [x, y, z] = self.direction.to_array();
        [x, y, z, self.half_angle].map(f64::to_bits)
    }
}

/// One moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moment {
    /// Towards the sun, of length 1; 0 where the table has none.
    pub(crate) direction: DVec3,
    /// W/m² across the beam.
    pub(crate) direct: f64,
    /// W/m² on a level plane that sees the whole sky.
    pub(crate) diffuse: f64,
    /// How that is spread over the sky.
    pub(crate) sky: SkyModel,
    extraterrestrial: f64,
    /// Reflectance of the ground below the horizon.
    ground: f64,
    /// Temperature of the sky, K: all moments of a table have one, or none has.
    pub(crate) sky_temperature: Option<f64>,
    /// The air, where the table has all of it.
    pub(crate) air: Option<Air>,
    /// A planet nearby.
    pub(crate) planet: Option<Planet>,
}

impl Moment {
    /// What the ground below the horizon sends, W/m² of it: all that arrives on it in the open, times its reflectance.
    pub(crate) fn ground_radiosity(&self, up: DVec3) -> f64 {
        self.ground * (self.direct * self.direction.dot(up).max(0.0) + self.diffuse)
    }
}

/// Names of the column of altitudes.
pub(crate) const ALTITUDE: [&str; 2] = ["altitude", "elevation"];

/// Returns the sine and the cosine of an angle in degrees: exactly 0 and ±1 at its quarters, so that a sun along a wall
/// does not graze it.
fn sine_and_cosine(degrees: f64) -> [f64; 2] {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    if degrees % 90.0 == 0.0 {
        [sine.round(), cosine.round()]
    } else {
        [sine, cosine]
    }
}

/// The direction with an azimuth (degrees clockwise from north) and an altitude (degrees), along east, north and up.
///
/// # Errors
/// For angles beyond a circle and beyond ±90°.
pub(crate) fn direction_of(azimuth: f64, altitude: f64) -> Result<DVec3> {
    if azimuth.abs() > 360.0 {
        bail!("the azimuth is {azimuth}°, beyond 360°; it is counted clockwise from north");
    }
    if altitude.abs() > 90.0 {
        bail!("the altitude is {altitude}°, beyond 90°; it is counted from the horizon");
    }
    let ([sine, cosine], [height, across]) = (sine_and_cosine(azimuth), sine_and_cosine(altitude));
    Ok(DVec3::new(across * sine, across * cosine, height))
}

/// The moments of a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Suns {
    pub(crate) path: PathBuf,
    /// True while directions are along east, north and up, as of a table of angles.
    is_of_angles: bool,
    /// A name a moment.
    pub(crate) names: Vec<String>,
    pub(crate) moments: Vec<Moment>,
    /// What of the air the table has, and what not, where it has some of it.
    pub(crate) lacks_air: Option<String>,
    /// Columns that nothing reads.
    unread: Vec<String>,
}

/// Columns of the air.
const AIR: [&str; 3] = ["air_temperature", "humidity", "wind"];

/// Columns that name the moments: the first of them does.
const NAMES: [&str; 4] = ["time", "moment", "hour", "name"];

/// Columns of numbers, and what they are in.
const NUMBERS: [(&str, Unit); 20] = [
    ("x", Unit::Length),
    ("y", Unit::Length),
    ("z", Unit::Length),
    ("azimuth", Unit::Degrees),
    ("altitude", Unit::Degrees),
    ("elevation", Unit::Degrees),
    ("direct", Unit::Irradiance),
    ("diffuse", Unit::Irradiance),
    ("extraterrestrial", Unit::Irradiance),
    ("ground", Unit::Share),
    ("sky_temperature", Unit::Kelvin),
    ("air_temperature", Unit::Celsius),
    ("humidity", Unit::Percent),
    ("wind", Unit::Speed),
    ("planet_x", Unit::Length),
    ("planet_y", Unit::Length),
    ("planet_z", Unit::Length),
    ("half_angle", Unit::Degrees),
    ("albedo", Unit::Irradiance),
    ("infrared", Unit::Irradiance),
];

/// Letters of a name from which on one that differs in a single letter is taken for it. A choice: short words are close
/// to others.
const LETTERS: usize = 5;

/// Checks that a header has each column once, in its unit, and the sun's direction by angles or by axes; returns the
/// columns that nothing reads.
fn unread(names: &[String]) -> Result<Vec<String>> {
    let shorts: Vec<String> = names.iter().map(|name| short(name)).collect();
    let at = |wanted: &str| shorts.iter().position(|name| name == wanted);
    if let (Some(azimuth), Some(axis)) = (at("azimuth"), ["x", "y", "z"].into_iter().find_map(at)) {
        bail!(
            "the columns `{}` and `{}` both say where the sun stands; leave the angles or `x,y,z` out",
            names[azimuth],
            names[axis]
        );
    }
    let mut unread = Vec::new();
    for (place, (name, of)) in names.iter().zip(&shorts).enumerate() {
        let is_altitude = ALTITUDE.contains(&&**of);
        let number = NUMBERS.iter().find(|(known, _)| known == of);
        let is_read = number.is_some() || of == "sky" || NAMES.contains(&&**of);
        if !is_read || (is_altitude && at("azimuth").is_none()) {
            unread.extend((!of.is_empty()).then(|| name.clone()));
            continue;
        }
        if let Some((_, unit)) = number {
            unit.require(name)?;
        }
        let is_same = |other: &String| other == of || (is_altitude && ALTITUDE.contains(&&**other));
        if let Some(other) = shorts[..place].iter().position(is_same) {
            bail!(
                "the columns `{}` and `{name}` are the same; leave one of them out",
                names[other]
            );
        }
    }
    require_spelt(&unread, &shorts)?;
    Ok(unread)
}

/// Refuses a header with a column twice, in another unit or misspelt, and one with the sun's angles beside its axes.
/// Returns the warning of columns that nothing reads.
pub(crate) fn require_columns(names: &[String], path: &Path) -> Result<Option<String>> {
    let unread = unread(names).map_err(|error| anyhow!("{}: {error}", path.display()))?;
    Ok(unread_of(&unread, path))
}

fn unread_of(unread: &[String], path: &Path) -> Option<String> {
    let names: Vec<String> = unread.iter().map(|name| format!("`{name}`")).collect();
    (!names.is_empty()).then(|| format!("nothing reads {} of `{}`", names.join(", "), path.display()))
}

/// Refuses a column that nothing reads whose name is nearly one that the header lacks.
fn require_spelt(unread: &[String], shorts: &[String]) -> Result<()> {
    let has = |known: &str| shorts.iter().any(|name| name == known);
    let has_names = NAMES.into_iter().any(has);
    let names = NAMES.into_iter().filter(|_| !has_names);
    // The sun's direction is by angles or by axes.
    let is_angle = |name: &str| name == "azimuth" || ALTITUDE.contains(&name);
    let has_angles = has("x") || ALTITUDE.into_iter().any(has);
    let numbers = NUMBERS.iter().map(|(name, _)| *name);
    let known = numbers.filter(|name| !(has_angles && is_angle(name))).chain(names);
    let lacking: Vec<&str> = known.filter(|name| name.len() >= LETTERS && !has(name)).collect();
    for name in unread {
        let given = short(name);
        if let Some(known) = lacking.iter().find(|known| levenshtein(&given, known) == 1) {
            bail!("there is no column `{name}`; did you mean `{known}`?");
        }
    }
    Ok(())
}

/// The name of a moment that a table gives none.
fn made_name(at: usize) -> String {
    format!("sun {at}")
}

/// The first moment that two tables name differently. Names that the program made, and empty ones, are those of any.
pub(crate) fn first_difference(names: &[String], others: &[String]) -> Option<usize> {
    let is_given = |at: usize, name: &str| !name.is_empty() && name != made_name(at);
    let mut pairs = names.iter().zip(others).enumerate();
    pairs
        .find(|&(at, (name, other))| name != other && is_given(at, name) && is_given(at, other))
        .map(|(at, _)| at)
}

impl Suns {
    /// Reads a table.
    ///
    /// # Errors
    /// When it cannot be read, has no moment, or a line is malformed: the error names it.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes =
            hemicube_scene::read_regular(path).with_context(|| format!("`{}` cannot be read", path.display()))?;
        Self::of(&bytes, path)
    }

    fn of(bytes: &[u8], path: &Path) -> Result<Self> {
        let at = |line: Option<u64>, error: anyhow::Error| match line {
            Some(line) => anyhow!("{}:{line}: {error}", path.display()),
            None => anyhow!("`{}` {error}", path.display()),
        };
        let Head {
            mut reader,
            names,
            line: first,
        } = head(bytes).map_err(|(line, error)| at(line, error))?;
        let first = Some(first);
        let unread = unread(&names).map_err(|error| at(first, error))?;
        let column = |wanted: &[&str]| names.iter().position(|name| wanted.contains(&&*short(name)));
        let needed = |wanted: &str| {
            column(&[wanted]).ok_or_else(|| {
                hinted(
                    at(first, anyhow!("there is no column `{wanted}`")),
                    "a header such as `time,x,y,z,direct,diffuse` names the columns: the direction towards the sun (or \
                     `azimuth,altitude` in degrees), and W/m² across its beam and from the sky on a level plane; \
                     `hemicube suns` makes such a table",
                )
            })
        };
        let angles = match column(&["azimuth"]) {
            None => None,
            Some(azimuth) => Some([azimuth, column(&ALTITUDE).map_or_else(|| needed("altitude"), Ok)?]),
        };
        let axes = match angles {
            None => Some([needed("x")?, needed("y")?, needed("z")?]),
            Some(_) => None,
        };
        let direct = needed("direct")?;
        let (diffuse, name) = (column(&["diffuse"]), column(&NAMES));
        let [sky, extraterrestrial, ground] = ["sky", "extraterrestrial", "ground"].map(|name| column(&[name]));
        let sky_temperature = column(&["sky_temperature"]);
        let air = AIR.map(|name| column(&[name]));
        let of_air = |is_there: bool| -> Vec<String> {
            let columns = AIR.iter().zip(air).filter(|(_, column)| column.is_some() == is_there);
            columns.map(|(name, _)| format!("`{name}`")).collect()
        };
        let (has, lacks) = (of_air(true), of_air(false));
        let planet = match column(&["half_angle"]) {
            None => None,
            Some(half_angle) => Some((
                [needed("planet_x")?, needed("planet_y")?, needed("planet_z")?],
                half_angle,
                [column(&["albedo"]), column(&["infrared"])],
            )),
        };
        if let Some((_, _, [None, None])) = planet {
            return Err(hinted(
                at(first, anyhow!("there is a planet that sends nothing")),
                "give it the column `albedo` or `infrared`, in W/m² of its surface",
            ));
        }
        if planet.is_none()
            && let Some(lone) = ["planet_x", "albedo", "infrared"]
                .iter()
                .find(|name| column(&[name]).is_some())
        {
            return Err(hinted(
                at(first, anyhow!("there is `{lone}`, and no `half_angle`")),
                "a planet has the columns `planet_x,planet_y,planet_z,half_angle,albedo,infrared`: the direction \
                 towards its middle, degrees, and W/m² of its surface",
            ));
        }
        let mut found = Self {
            path: path.to_owned(),
            is_of_angles: angles.is_some(),
            names: Vec::new(),
            moments: Vec::new(),
            lacks_air: (!has.is_empty() && !lacks.is_empty())
                .then(|| format!("{}, and no {}", has.join(" and "), lacks.join(" and no "))),
            unread,
        };
        let mut lines = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|error| {
                let (line, error) = told(&error);
                at(line, error)
            })?;
            let line = record.position().map(csv::Position::line);
            let number = |column: usize| {
                let text = record.get(column).unwrap_or_default();
                let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
                number.ok_or_else(|| at(line, anyhow!("`{text}` of `{}` is no number", names[column])))
            };
            let power = |column: usize| match number(column)? {
                power if power >= 0.0 => Ok(power),
                power => Err(at(line, anyhow!("`{}` is {power}, below 0", names[column]))),
            };
            let given = |column: usize| {
                record
                    .get(column)
                    .filter(|text| !text.is_empty())
                    .map(|_| power(column))
            };
            let towards = match (angles, axes) {
                (Some([azimuth, altitude]), _) => {
                    direction_of(number(azimuth)?, number(altitude)?).map_err(|error| at(line, error))?
                }
                (None, Some([x, y, z])) => DVec3::new(number(x)?, number(y)?, number(z)?),
                (None, None) => DVec3::ZERO,
            };
            let model = match sky
                .and_then(|column| record.get(column))
                .filter(|text| !text.is_empty())
            {
                None => SkyModel::Uniform,
                Some(text) => text
                    .parse()
                    .map_err(|error: String| at(line, anyhow!("the sky `{text}` is not known: {error}")))?,
            };
            let air = match air {
                [Some(temperature), Some(humidity), Some(wind)] => Some(Air {
                    temperature: number(temperature)?,
                    humidity: power(humidity)?,
                    wind: power(wind)?,
                }),
                _ => None,
            };
            let degrees = planet.and_then(|(_, half_angle, _)| given(half_angle)).transpose()?;
            let planet = match (planet, degrees) {
                (Some((towards, _, [albedo, infrared])), Some(degrees)) if degrees > 0.0 => {
                    if degrees > 90.0 {
                        return Err(at(line, anyhow!("the `half_angle` is {degrees}°, above 90°")));
                    }
                    let [x, y, z] = towards;
                    let direction = DVec3::new(number(x)?, number(y)?, number(z)?).try_normalize();
                    let sent = |column: Option<usize>| column.and_then(given).unwrap_or(Ok(0.0));
                    Some(Planet {
                        direction: direction
                            .ok_or_else(|| at(line, anyhow!("the direction towards the planet has no length")))?,
                        half_angle: degrees.to_radians(),
                        albedo: sent(albedo)?,
                        infrared: sent(infrared)?,
                    })
                }
                _ => None,
            };
            let ground = ground.and_then(given).unwrap_or(Ok(0.0))?;
            if ground > 1.0 {
                return Err(hinted(
                    at(line, anyhow!("the ground's reflectance is {ground}, above 1")),
                    "`ground` is the share of light that the ground below the horizon reflects, such as 0.2",
                ));
            }
            let moment = Moment {
                planet,
                ground,
                direct: power(direct)?,
                diffuse: diffuse.map_or(Ok(0.0), power)?,
                direction: towards.try_normalize().unwrap_or(DVec3::ZERO),
                sky: model,
                extraterrestrial: extraterrestrial.and_then(given).unwrap_or(Ok(EXTRATERRESTRIAL))?,
                sky_temperature: sky_temperature.and_then(given).transpose()?,
                air,
            };
            if moment.direct > 0.0 && moment.direction == DVec3::ZERO {
                return Err(at(line, anyhow!("the direction towards the sun has no length")));
            }
            let given = name.and_then(|name| record.get(name)).filter(|name| !name.is_empty());
            found
                .names
                .push(given.map_or_else(|| made_name(found.moments.len()), str::to_owned));
            found.moments.push(moment);
            lines.push(line);
        }
        if found.moments.is_empty() {
            bail!(
                "`{}` has no sun: a line each below the header is needed",
                path.display()
            );
        }
        if let Some(dark) = found.without_sky_temperature() {
            return Err(hinted(
                at(
                    lines[dark],
                    anyhow!(
                        "`{}` has no `sky_temperature`, and other moments have one",
                        found.names[dark]
                    ),
                ),
                "give it one, in K, or leave the column out",
            ));
        }
        Ok(found)
    }

    /// The first moment without a temperature of the sky, where another has one.
    fn without_sky_temperature(&self) -> Option<usize> {
        let has = |moment: &Moment| moment.sky_temperature.is_some();
        let without = self.moments.iter().position(|moment| !has(moment));
        without.filter(|_| self.moments.iter().any(has))
    }

    /// The warning of columns that nothing reads, once.
    fn warning_of_unread(&mut self) -> Option<String> {
        unread_of(&std::mem::take(&mut self.unread), &self.path)
    }

    /// Turns directions of a table of angles into the scene's axes. Their suns below the horizon send nothing; returns
    /// the warning of it where the table says otherwise, and of columns that nothing reads.
    ///
    /// # Errors
    /// When there are such, and the scene has no horizon.
    pub(crate) fn turn(&mut self, horizon: impl FnOnce() -> Result<Horizon>) -> Result<Option<String>> {
        let unread = self.warning_of_unread();
        if !self.is_of_angles {
            return Ok(unread);
        }
        let horizon = horizon().with_context(|| format!("`{}` has an azimuth", self.path.display()))?;
        let mut below = 0;
        for moment in &mut self.moments {
            let is_below = moment.direction.z < 0.0;
            moment.direction = horizon.direction(moment.direction.to_array());
            if is_below && moment.direct > 0.0 {
                moment.direct = 0.0;
                below += 1;
            }
        }
        self.is_of_angles = false;
        let below = (below > 0).then(|| {
            format!(
                "{} of {} in `{}` with direct light from below the horizon: it is left out; directions by `x,y,z` are taken \
                 from anywhere",
                count(below),
                counted(self.moments.len() as u64, "moment"),
                self.path.display()
            )
        });
        let all: Vec<String> = below.into_iter().chain(unread).collect();
        Ok((!all.is_empty()).then(|| all.join("; ")))
    }

    /// Number of moments.
    pub(crate) fn len(&self) -> usize {
        self.moments.len()
    }

    /// True if light comes from the sky at a moment.
    pub(crate) fn has_sky(&self) -> bool {
        self.moments.iter().any(|moment| moment.diffuse > 0.0)
    }

    /// True if a planet sends heat at a moment.
    pub(crate) fn has_infrared(&self) -> bool {
        let sends = |moment: &Moment| moment.planet.is_some_and(|planet| planet.infrared > 0.0);
        self.moments.iter().any(sends)
    }

    /// True if a moment has a ground that reflects.
    pub(crate) fn names_ground(&self) -> bool {
        self.moments.iter().any(|moment| moment.ground > 0.0)
    }

    /// The first moment whose sky is not the same from everywhere, and brings light.
    pub(crate) fn uneven(&self) -> Option<SkyModel> {
        let mut with_light = self.moments.iter().filter(|moment| moment.diffuse > 0.0);
        with_light
            .find(|moment| moment.sky != SkyModel::Uniform)
            .map(|moment| moment.sky)
    }

    /// The sky's radiances at a moment, W/(m² sr), by the columns of a division: that of the ground below the horizon
    /// comes first.
    ///
    /// # Errors
    /// When the sky's model has no radiance at this moment.
    pub(crate) fn radiances(&self, at: usize, division: &SkyDivision, horizon: Horizon) -> Result<Vec<f64>> {
        let moment = &self.moments[at];
        let mut found = vec![0.0; division.columns() as usize];
        found[0] = moment.ground_radiosity(horizon.up) / std::f64::consts::PI;
        if moment.diffuse == 0.0 {
            return Ok(found);
        }
        let told = |error: hemicube_weather::sky::Error| {
            anyhow!("the sky of `{}` in `{}`: {error}", self.names[at], self.path.display())
        };
        let model = match moment.sky {
            SkyModel::Uniform => Model::Uniform,
            SkyModel::Cie(number) => Model::Cie(Cie::new(number).map_err(told)?),
            SkyModel::Perez => {
                Model::Perez(Perez::new(moment.direct, moment.diffuse, moment.extraterrestrial).map_err(told)?)
            }
        };
        let patches: Vec<Patch> = (1..division.columns())
            .map(|column| Patch {
                direction: division.middle(column).to_array(),
                solid_angle: division.solid_angle(column),
                projected: std::f64::consts::PI * division.share_of_a_level_plane(column),
            })
            .collect();
        let sun = moment.direction;
        let sun = (sun != DVec3::ZERO).then(|| [sun.dot(horizon.east), sun.dot(horizon.north), sun.dot(horizon.up)]);
        found[1..].copy_from_slice(&radiances(&model, sun, moment.diffuse, &patches).map_err(told)?);
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::Axis;

    #[test]
    fn columns_are_found_by_name_and_faults_by_line() {
        let read = |text: &str| Suns::of(text.as_bytes(), "s.csv".as_ref());
        let found =
            read("# a day\ntime;direct (W/m2);x;y;z;sky_temperature (K)\n09:00;700;0;0;2;280\nnight;0;0;0;0;270\n")
                .expect("suns");
        assert_eq!(found.names, ["09:00", "night"]);
        let [noon, night] = &found.moments[..] else {
            panic!("{found:?}")
        };
        assert_eq!(
            (noon.direction, noon.direct, noon.sky_temperature),
            (DVec3::Z, 700.0, Some(280.0))
        );
        assert!(found.lacks_air.is_none() && !found.has_infrared());
        let some = read("x,y,z,direct,air_temperature,wind\n0,0,1,5,20,1\n").expect("a sun");
        assert_eq!(
            some.lacks_air.as_deref(),
            Some("`air_temperature` and `wind`, and no `humidity`")
        );
        assert!(!found.has_sky() && night.direction == DVec3::ZERO && some.moments[0].sky_temperature.is_none());
        for (text, words) in [
            ("x,y,z\n0,0,1\n", "s.csv:1: there is no column `direct`"),
            ("x,y,z,direct\n0,0,one,5\n", "s.csv:2: `one` of `z` is no number"),
            ("x,y,z,direct\n0,0,1,-5\n", "`direct` is -5, below 0"),
            (
                "x,y,z,direct\n0,0,0,5\n",
                "s.csv:2: the direction towards the sun has no length",
            ),
            (
                "x,y,z,direct,sky\n0,0,1,5,cie17\n",
                "s.csv:2: the sky `cie17` is not known",
            ),
            (
                "x,y,z,direct,ground\n0,0,1,5,1.5\n",
                "s.csv:2: the ground's reflectance is 1.5, above 1",
            ),
            ("x,y,z,direct\n", "has no sun"),
            (
                "# a day\ntime,x,y,z,direct,sky_temperature (degC)\nnoon,0,0,1,5,10\n",
                "s.csv:2: column `sky_temperature (degC)` is in degC, and K is needed",
            ),
            (
                "x,y,z,direct (kW/m2)\n0,0,1,5\n",
                "s.csv:1: column `direct (kW/m2)` is in kW/m2, and W/m2 is needed",
            ),
            (
                "time,x,y,z,direct,sky_temperature\nnoon,0,0,1,5,280\nnight,0,0,1,5,\n",
                "s.csv:3: `night` has no `sky_temperature`, and other moments have one",
            ),
            (
                "time,x,y,z,direct,Direct (W/m2)\nnoon,0,0,1,5,6\n",
                "s.csv:1: the columns `direct` and `Direct (W/m2)` are the same",
            ),
            (
                "azimuth,altitude,elevation,direct\n0,0,1,5\n",
                "s.csv:1: the columns `altitude` and `elevation` are the same",
            ),
            (
                "x,y,z,azimuth (deg),altitude,direct\n0,0,2,90,0,1\n",
                "s.csv:1: the columns `azimuth (deg)` and `x` both say where the sun stands",
            ),
            (
                "x,y,z,direct,difuse\n0,0,1,5,6\n",
                "s.csv:1: there is no column `difuse`; did you mean `diffuse`?",
            ),
            (
                "x,y,z,direct,albedo\n0,0,1,5,3\n",
                "s.csv:1: there is `albedo`, and no `half_angle`",
            ),
            ("x,y,z,direct,half_angle\n0,0,1,5,3\n", "there is no column `planet_x`"),
            (
                "x,y,z,direct,half_angle,planet_x,planet_y,planet_z\n0,0,1,5,9,0,0,1\n",
                "s.csv:1: there is a planet that sends nothing",
            ),
            (
                "x,y,z,direct,half_angle,planet_x,planet_y,planet_z,albedo\n0,0,1,5,93,0,0,1,1\n",
                "s.csv:2: the `half_angle` is 93°, above 90°",
            ),
            ("x,y,z,direct\n0,0,1\n", "has 3 fields where the header has 4"),
            ("azimuth,direct\n0,5\n", "s.csv:1: there is no column `altitude`"),
            (
                "azimuth,altitude,direct\n180,91,5\n",
                "s.csv:2: the altitude is 91°, beyond 90°",
            ),
            (
                "azimuth,altitude,direct\n-361,1,5\n",
                "s.csv:2: the azimuth is -361°, beyond 360°",
            ),
        ] {
            let error = read(text).expect_err(text).to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn an_azimuth_is_clockwise_from_north_in_any_axes() {
        let read = |text: &str| Suns::of(text.as_bytes(), "s.csv".as_ref()).expect("suns");
        let table = read("Azimuth (deg),elevation,direct\n90,0,1\n180,30,1\n-90,90,1\n");
        for (up, [east, south]) in [
            (Axis::Z, [DVec3::X, DVec3::NEG_Y]),
            (Axis::Y, [DVec3::X, DVec3::Z]),
            (Axis::X, [DVec3::Y, DVec3::NEG_Z]),
        ] {
            let (mut suns, horizon) = (table.clone(), Horizon::new(up, 0.0));
            suns.turn(|| Ok(horizon)).expect("a horizon");
            let expected = [east, south * 0.75_f64.sqrt() + horizon.up * 0.5, horizon.up];
            // A sun along an axis is that axis.
            assert_eq!(
                [suns.moments[0].direction, suns.moments[2].direction],
                [east, horizon.up]
            );
            for (moment, expected) in suns.moments.iter().zip(expected) {
                assert!((moment.direction - expected).length() < 1e-15, "{up:?}: {moment:?}");
            }
            // What is turned stays.
            let turned = suns.clone();
            suns.turn(|| Ok(Horizon::new(up, 90.0))).expect("a horizon");
            assert_eq!(suns, turned);
        }
        let mut night = read("azimuth,altitude,direct\n0,-1,700\n0,-0,700\n");
        let warning = night.turn(|| Ok(Horizon::new(Axis::Z, 0.0))).expect("a horizon");
        assert!(warning.is_some_and(|said| said.starts_with("1 of 2 moments in `s.csv` with direct light from below")));
        assert_eq!([night.moments[0].direct, night.moments[1].direct], [0.0, 700.0]);
        let refused = read("azimuth,altitude,direct\n0,9,1\n").turn(|| bail!("no horizon"));
        assert_eq!(
            format!("{:#}", refused.expect_err("no horizon")),
            "`s.csv` has an azimuth: no horizon"
        );
    }

    #[test]
    fn a_column_that_nothing_reads_is_warned_of_once() {
        let table = "time,x,y,z,altitude,direct,pressure (kPa),name,diffuse,diffuse_2\nnoon,0,0,1,3,5,101,a,7,8\n";
        let mut suns = Suns::of(table.as_bytes(), "s.csv".as_ref()).expect("a sun");
        assert_eq!((&*suns.names[0], suns.moments[0].diffuse), ("noon", 7.0));
        let mut told = || suns.turn(|| bail!("no horizon")).expect("axes");
        assert_eq!(
            told().as_deref(),
            Some("nothing reads `altitude`, `pressure (kPa)`, `diffuse_2` of `s.csv`")
        );
        assert_eq!(told(), None);
    }

    #[test]
    fn moments_differ_where_both_tables_name_them() {
        let of = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<String>>();
        let names = of(&["06:00", "12:00", "18:00"]);
        assert_eq!(first_difference(&names, &names), None);
        assert_eq!(first_difference(&names, &of(&["06:00", "18:00", "12:00"])), Some(1));
        assert_eq!(first_difference(&of(&["sun 0", "", "night"]), &names), Some(2));
        assert_eq!(first_difference(&of(&["sun 1", "12:00", "18:00"]), &names), Some(0));
    }

    #[test]
    fn the_ground_sends_its_part_of_what_arrives_on_a_level_plane() {
        let table = "x,y,z,direct,diffuse,ground\n0,0.6,0.8,500,100,0.2\n0,0.6,-0.8,500,100,0.2\n0,1,0,500,100,\n";
        let suns = Suns::of(table.as_bytes(), "s.csv".as_ref()).expect("suns");
        let sent: Vec<f64> = suns.moments.iter().map(|of| of.ground_radiosity(DVec3::Z)).collect();
        assert_eq!(
            sent.iter().map(|sent| sent.round()).collect::<Vec<_>>(),
            [100.0, 20.0, 0.0]
        );
        assert!(suns.names_ground());
        let division = SkyDivision::new(1).expect("a division");
        let radiances = suns
            .radiances(0, &division, Horizon::new(Axis::Z, 0.0))
            .expect("radiances");
        assert!((std::f64::consts::PI * radiances[0] - sent[0]).abs() < 1e-12);
    }

    #[test]
    fn a_sky_brings_its_irradiance_to_a_level_plane_and_is_brighter_towards_the_sun() {
        let division = SkyDivision::new(2).expect("a division");
        let horizon = Horizon::new(Axis::Y, 30.0);
        for sky in ["uniform", "overcast", "clear", "cie7", "perez"] {
            let table = format!("x,y,z,direct,diffuse,sky\n1,0.5,0.2,600,120,{sky}\n");
            let suns = Suns::of(table.as_bytes(), "s.csv".as_ref()).expect("a sun");
            let found = suns.radiances(0, &division, horizon).expect("radiances");
            let level: f64 = (1..division.columns())
                .map(|column| std::f64::consts::PI * division.share_of_a_level_plane(column) * found[column as usize])
                .sum();
            assert!((level - 120.0).abs() < 1e-9, "{sky}: {level}");
            assert_eq!(found[0], 0.0);
            let towards = |direction: DVec3| {
                let local = [horizon.east, horizon.north, horizon.up].map(|axis| axis.dot(direction));
                found[division.column(DVec3::from_array(local)) as usize]
            };
            let sun = suns.moments[0].direction;
            let away = DVec3::new(-sun.x, sun.y, -sun.z);
            let is_even = matches!(sky, "uniform" | "overcast");
            assert_eq!(towards(sun) > 1.5 * towards(away), !is_even, "{sky}");
        }
    }
}
