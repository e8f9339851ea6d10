//! EnergyPlus weather files (`.epw`): the hours of a year and where they were measured.
//!
//! The format is that of D. Crawley, J. Hand and L. Lawrie, "Improving the weather information available to simulation
//! programs", Building Simulation (1999), and of EnergyPlus, "Auxiliary Programs". A file is lines of fields between
//! commas: headers, of which `LOCATION` (the first) and `DATA PERIODS` (the last) are read, then 8760 or 8784 lines, an
//! hour each. Fields beyond those of [`Hour`] are left alone.
//!
//! Hour *h* of 1 to 24 is what passed between *h* − 1 and *h* o'clock of the location's standard time, all year: there
//! is no daylight saving time. Irradiances are means over the hour; the sun is therefore taken at its middle
//! ([`Hour::middle`]). In the hours of sunrise and sunset the sun may be below the horizon at the middle while its
//! irradiance is not 0.
//!
//! A value that is missing, by its code (99.9, 999, 9999, 999999 or more) or as the field is empty, is `None`.
//!
//! No reader of CSV, because the format has no quotes, and a comment with one quotation mark would swallow the file.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::sun::{self, Place, Sun, Time, shown};

/// How many bytes a file may have; those of a year have 1.6 MB.
pub const MAX_BYTES: usize = 64 << 20;

/// How many lines may come before the hours; there are eight by the format.
const MAX_HEADERS: usize = 64;

/// The Stefan–Boltzmann constant in W/(m² K⁴) (CODATA 2018).
pub const STEFAN_BOLTZMANN: f64 = 5.670_374_419e-8;

/// Why a weather file could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("`{}` cannot be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// More than [`MAX_BYTES`].
    #[error("the file has more than {MAX_BYTES} bytes, and a weather file of a year has 1.6 million; is it one?")]
    TooLarge,
    /// Something is wrong with a line.
    #[error("line {line}: {problem}")]
    Line {
        /// Which line, from 1.
        line: usize,
        /// What is wrong.
        problem: Problem,
    },
}

/// What is wrong with a line of a weather file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// Bytes that are no UTF-8, in a line that is read.
    #[error("is not UTF-8; convert the file to it")]
    NotText,
    /// A header is not where it should be.
    #[error("a line that begins with `{0}` is expected; is this a weather file of EnergyPlus?")]
    Header(&'static str),
    /// Too few fields.
    #[error("has {found} fields and needs {needed}; the line was cut short")]
    Fields {
        /// How many there are.
        found: usize,
        /// How many are read.
        needed: usize,
    },
    /// Text where a number should be.
    #[error("the {field} is `{text}`, which is no number")]
    Number {
        /// Which field.
        field: &'static str,
        /// What is there.
        text: String,
    },
    /// A number that cannot be.
    #[error("the {field} is {value}, outside {low} to {high}")]
    Range {
        /// Which field.
        field: &'static str,
        /// What is there.
        value: f64,
        /// The least that is believed.
        low: f64,
        /// The greatest that is believed.
        high: f64,
    },
    /// A day that no calendar has.
    #[error("there is no day {year}-{month}-{day}")]
    Date {
        /// The year.
        year: i32,
        /// The month.
        month: u32,
        /// The day.
        day: u32,
    },
    /// Hours are not 1, 2, …, 24, 1, ….
    #[error("has the hour {found} where {expected} is next; hours must follow each other, none left out")]
    Order {
        /// The hour there.
        found: u32,
        /// The hour that is next.
        expected: u32,
    },
    /// Several periods, or several records an hour.
    #[error("has {periods} data periods of {records} records an hour; only one period of one record is read")]
    Periods {
        /// How many periods.
        periods: u32,
        /// How many records an hour.
        records: u32,
    },
    /// Neither 8760 nor 8784 hours.
    #[error("the file ends after {0} hours, and a year has 8760 or 8784")]
    Hours(usize),
    /// More than 8784 hours.
    #[error("a year ends before this line; nothing may follow its 8784 hours")]
    TooManyHours,
}

/// Where a weather file is from.
#[derive(Debug, Clone, PartialEq)]
pub struct Location {
    /// The city or station.
    pub name: String,
    /// The state, province or region; may be empty or `-`.
    pub region: String,
    /// The country, a code of three letters as a rule.
    pub country: String,
    /// Where the data are from: `TMY3`, `IWEC`…
    pub source: String,
    /// The number of the World Meteorological Organization, as text: it may begin with 0.
    pub station: String,
    /// Latitude, longitude (degrees) and elevation (m).
    pub place: Place,
    /// Hours that standard time is ahead of UTC, −12 to 14; not always whole.
    pub utc_offset: f64,
}

/// What passed in an hour. Values are `None` where the file has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hour {
    /// The year that the hour was measured in: months of a typical year are of different ones.
    pub year: i32,
    /// The month, 1 to 12.
    pub month: u32,
    /// The day, 1 to 31.
    pub day: u32,
    /// The hour, 1 to 24: its end, by standard time.
    pub hour: u32,
    /// The temperature of the air in °C, −90 to 70.
    pub dry_bulb: Option<f64>,
    /// The dew point in °C, −100 to 70.
    pub dew_point: Option<f64>,
    /// The relative humidity in %, 0 to 110.
    pub relative_humidity: Option<f64>,
    /// The pressure of the air at the station in Pa, 31000 to 120000.
    pub pressure: Option<f64>,
    /// The sun's irradiance above the atmosphere, normal to its rays, in W/m², 0 to 1500; 0 at night.
    pub extraterrestrial_normal: Option<f64>,
    /// The longwave irradiance from the sky on a horizontal plane in W/m², 0 to 1000.
    pub horizontal_infrared: Option<f64>,
    /// The sun's irradiance normal to its rays in W/m², 0 to 1500.
    pub direct_normal: Option<f64>,
    /// The sky's shortwave irradiance on a horizontal plane in W/m², 0 to 1500.
    pub diffuse_horizontal: Option<f64>,
    /// The speed of the wind in m/s, 10 m above ground as a rule, 0 to 100.
    pub wind_speed: Option<f64>,
}

/// A field of an hour that is read: its place in the line, from 0, the code from which on it is missing, and its range.
struct Field {
    name: &'static str,
    place: usize,
    missing: f64,
    range: [f64; 2],
}

const fn field(name: &'static str, place: usize, missing: f64, range: [f64; 2]) -> Field {
    Field {
        name,
        place,
        missing,
        range,
    }
}

const DRY_BULB: Field = field("dry bulb temperature", 6, 99.9, [-90.0, 70.0]);
const DEW_POINT: Field = field("dew point", 7, 99.9, [-100.0, 70.0]);
const RELATIVE_HUMIDITY: Field = field("relative humidity", 8, 999.0, [0.0, 110.0]);
const PRESSURE: Field = field("pressure", 9, 999_999.0, [31_000.0, 120_000.0]);
const EXTRATERRESTRIAL_NORMAL: Field = field("extraterrestrial normal irradiance", 11, 9999.0, [0.0, 1500.0]);
const HORIZONTAL_INFRARED: Field = field("horizontal infrared irradiance", 12, 9999.0, [0.0, 1000.0]);
const DIRECT_NORMAL: Field = field("direct normal irradiance", 14, 9999.0, [0.0, 1500.0]);
const DIFFUSE_HORIZONTAL: Field = field("diffuse horizontal irradiance", 15, 9999.0, [0.0, 1500.0]);
const WIND_SPEED: Field = field("wind speed", 21, 999.0, [0.0, 100.0]);

/// Fields of an hour up to the last that is read.
const FIELDS: usize = 22;

/// A weather file.
#[derive(Debug, Clone, PartialEq)]
pub struct Epw {
    /// Where it is from.
    pub location: Location,
    /// The 8760 or 8784 hours, in the order of the file.
    pub hours: Vec<Hour>,
}

/// A finite number, which a field must hold.
fn number(field: &'static str, text: &str, [low, high]: [f64; 2]) -> Result<f64, Problem> {
    let parsed: Option<f64> = text.parse().ok().filter(|value: &f64| value.is_finite());
    let value = parsed.ok_or_else(|| Problem::Number {
        field,
        text: shown(text),
    })?;
    match (low..=high).contains(&value) {
        true => Ok(value),
        false => Err(Problem::Range {
            field,
            value,
            low,
            high,
        }),
    }
}

/// A whole number; some files write `1.0`, or blanks before it.
fn whole(field: &'static str, text: &str, low: u32, high: u32) -> Result<u32, Problem> {
    let value = number(field, text, [low.into(), high.into()])?;
    let wanted = || Problem::Number {
        field,
        text: shown(text),
    };
    // Searched by the text, as a cast of f64 would truncate.
    let digits = text.split('.').next().unwrap_or_default();
    let parsed: u32 = digits.parse().map_err(|_| wanted())?;
    if f64::from(parsed) == value {
        Ok(parsed)
    } else {
        Err(wanted())
    }
}

/// The fields of a line, blanks round each left out.
fn fields(line: &[u8]) -> Result<Vec<&str>, Problem> {
    let text = std::str::from_utf8(line).map_err(|_| Problem::NotText)?;
    Ok(text.split(',').map(str::trim).collect())
}

/// Refuses a line of too few fields.
fn at_least(fields: &[&str], needed: usize) -> Result<(), Problem> {
    match fields.len() {
        found if found < needed => Err(Problem::Fields { found, needed }),
        _ => Ok(()),
    }
}

/// Whether a header's first field is `name`.
fn is_header(line: &[u8], name: &str) -> bool {
    let first = line.split(|&byte| byte == b',').next().unwrap_or_default();
    first.trim_ascii().eq_ignore_ascii_case(name.as_bytes())
}

fn location(line: &[u8]) -> Result<Location, Problem> {
    if !is_header(line, "LOCATION") {
        return Err(Problem::Header("LOCATION"));
    }
    let fields = fields(line)?;
    at_least(&fields, 10)?;
    let text = |place: usize| fields[place].to_owned();
    Ok(Location {
        name: text(1),
        region: text(2),
        country: text(3),
        source: text(4),
        station: text(5),
        place: Place {
            latitude: number("latitude", fields[6], [-90.0, 90.0])?,
            longitude: number("longitude", fields[7], [-180.0, 180.0])?,
            elevation: number("elevation", fields[9], [-1000.0, 9999.9])?,
        },
        utc_offset: number("time zone", fields[8], [-12.0, 14.0])?,
    })
}

/// Refuses files of several periods or of several records an hour.
fn periods(line: &[u8]) -> Result<(), Problem> {
    let fields = fields(line)?;
    at_least(&fields, 3)?;
    let periods = whole("number of data periods", fields[1], 0, 1000)?;
    let records = whole("number of records an hour", fields[2], 0, 1000)?;
    match (periods, records) {
        (1, 1) => Ok(()),
        _ => Err(Problem::Periods { periods, records }),
    }
}

fn hour(line: &[u8], expected: u32) -> Result<Hour, Problem> {
    let fields = fields(line)?;
    at_least(&fields, FIELDS)?;
    let year = whole("year", fields[0], 1, 9999)?;
    let year = i32::try_from(year).unwrap_or(i32::MAX);
    let month = whole("month", fields[1], 1, 12)?;
    let day = whole("day", fields[2], 1, 31)?;
    let hour = whole("hour", fields[3], 1, 24)?;
    if Time::from_local(year, month, day, 0, 0).is_none() {
        return Err(Problem::Date { year, month, day });
    }
    if hour != expected {
        return Err(Problem::Order { found: hour, expected });
    }
    let value = |field: &Field| -> Result<Option<f64>, Problem> {
        let text = fields[field.place];
        if text.is_empty() {
            return Ok(None);
        }
        match number(field.name, text, [f64::MIN, f64::MAX])? {
            value if value >= field.missing => Ok(None),
            _ => number(field.name, text, field.range).map(Some),
        }
    };
    Ok(Hour {
        year,
        month,
        day,
        hour,
        dry_bulb: value(&DRY_BULB)?,
        dew_point: value(&DEW_POINT)?,
        relative_humidity: value(&RELATIVE_HUMIDITY)?,
        pressure: value(&PRESSURE)?,
        extraterrestrial_normal: value(&EXTRATERRESTRIAL_NORMAL)?,
        horizontal_infrared: value(&HORIZONTAL_INFRARED)?,
        direct_normal: value(&DIRECT_NORMAL)?,
        diffuse_horizontal: value(&DIFFUSE_HORIZONTAL)?,
        wind_speed: value(&WIND_SPEED)?,
    })
}

impl Epw {
    /// Reads a file.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let failed = |source| Error::Io {
            path: path.to_owned(),
            source,
        };
        let mut bytes = Vec::new();
        // Bounded, as a path may be of something without an end.
        let limit = u64::try_from(MAX_BYTES).unwrap_or(u64::MAX).saturating_add(1);
        let file = File::open(path).map_err(failed)?;
        file.take(limit).read_to_end(&mut bytes).map_err(failed)?;
        Self::parse(&bytes)
    }

    /// Reads the bytes of a file: lines end with LF or CR LF, and a mark of byte order may come first. Comments may be
    /// in any encoding, the lines that are read must be UTF-8.
    pub fn parse(bytes: &[u8]) -> Result<Self, Error> {
        if bytes.len() > MAX_BYTES {
            return Err(Error::TooLarge);
        }
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        let at = |line: usize| move |problem| Error::Line { line, problem };
        let mut lines = bytes.split(|&byte| byte == b'\n').zip(1..);
        let location = lines
            .next()
            .map_or(Err(Problem::Header("LOCATION")), |(line, _)| location(line));
        let location = location.map_err(at(1))?;

        let mut last = 1;
        let headers = lines.by_ref().take(MAX_HEADERS);
        let found = headers
            .inspect(|&(_, line)| last = line)
            .find(|(line, _)| is_header(line, "DATA PERIODS"));
        let Some((header, line)) = found else {
            return Err(at(last)(Problem::Header("DATA PERIODS")));
        };
        periods(header).map_err(at(line))?;

        let mut hours = Vec::with_capacity(8784);
        let mut expected = 1;
        for (text, line) in lines {
            last = line;
            if text.trim_ascii().is_empty() {
                continue;
            }
            if hours.len() == 8784 {
                return Err(at(line)(Problem::TooManyHours));
            }
            hours.push(hour(text, expected).map_err(at(line))?);
            expected = expected % 24 + 1;
        }
        match hours.len() {
            8760 | 8784 => Ok(Self { location, hours }),
            found => Err(at(last)(Problem::Hours(found))),
        }
    }
}

impl Hour {
    /// The middle of the hour, half an hour before its end, in the location's standard time.
    pub fn middle(&self, location: &Location) -> Result<Time, sun::Error> {
        let offset = seconds(location.utc_offset);
        let second = self
            .hour
            .checked_sub(1)
            .map(|start| start.saturating_mul(3600).saturating_add(1800));
        let time = second
            .zip(offset)
            .and_then(|(second, offset)| Time::from_local(self.year, self.month, self.day, second, offset));
        // Only for hours that were not read but made.
        time.ok_or_else(|| {
            let Self {
                year, month, day, hour, ..
            } = self;
            sun::Error::Time(format!("{year}-{month}-{day} hour {hour}"))
        })
    }

    /// Where the sun is at the middle of the hour, without refraction.
    pub fn sun(&self, location: &Location) -> Result<Sun, sun::Error> {
        sun::position(&location.place, &self.middle(location)?)
    }

    /// The temperature in K of a black sky of the hour's horizontal infrared irradiance.
    pub fn sky_temperature(&self) -> Option<f64> {
        self.horizontal_infrared.and_then(sky_temperature)
    }
}

/// Whole seconds of an offset in hours, −24 to 24.
fn seconds(hours: f64) -> Option<i32> {
    let seconds = (hours * 3600.0).round();
    #[allow(clippy::cast_possible_truncation, reason = "a whole number of at most 86400")]
    (seconds.abs() <= 86_400.0).then_some(seconds as i32)
}

/// The temperature in K of a black hemisphere that irradiates a plane with so many W/m² of longwave radiation:
/// (irradiance / σ)^¼ (EnergyPlus, "Engineering Reference", sky radiation). `None` for what is negative or not finite.
pub fn sky_temperature(irradiance: f64) -> Option<f64> {
    let is_irradiance = irradiance.is_finite() && irradiance >= 0.0;
    is_irradiance.then(|| (irradiance / STEFAN_BOLTZMANN).sqrt().sqrt())
}
