//! Where the sun is, and times.
//!
//! Positions are by the Solar Position Algorithm: I. Reda and A. Andreas, "Solar position algorithm for solar radiation
//! applications", Solar Energy 76 (2004) 577–589, whose own uncertainty is 0.0003° for the years −2000 to 6000. ΔT (TT
//! − UT1) is estimated from the year and month; an error of 10 s in it moves the sun by less than 0.0005°.
//!
//! Times are ISO 8601 with a UTC offset. No names of time zones, because they would need a database and a rule for the
//! hour that occurs twice.

use std::fmt;
use std::str::FromStr;

use chrono::{DateTime, Datelike, FixedOffset, NaiveDate, SecondsFormat, TimeDelta, TimeZone, Timelike};
use solar_positioning::{RefractionCorrection, SolarPositions, delta_t};

/// How many times a range may have: a minute's steps over nearly two years.
pub const MAX_TIMES: usize = 1_000_000;

/// Why there is no time or no position of the sun.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Not a date and time of ISO 8601.
    #[error("`{0}` is no time; write it as 2026-06-21T12:00+02:00")]
    Time(String),
    /// A time without its UTC offset.
    #[error("`{0}` has no UTC offset; end it with one, such as +02:00, or with Z for UTC")]
    NoOffset(String),
    /// Not a time and not a range of times.
    #[error("`{0}` is no range of times; write it as START/END/STEP, with a step such as 1h or 30m")]
    Range(String),
    /// Not a step of a range.
    #[error("`{0}` is no step; write a whole number above 0 and its unit, s, m, h or d: 30m")]
    Step(String),
    /// A range that ends before it starts.
    #[error("`{0}` ends before it starts; exchange the two times")]
    Reversed(String),
    /// A range of more than [`MAX_TIMES`].
    #[error("`{range}` has {count} times, and {MAX_TIMES} is the limit; take a longer step")]
    TooMany {
        /// The range as written.
        range: String,
        /// How many times it would have.
        count: u64,
    },
    /// A place or an atmosphere outside its range.
    #[error("the {what} of {value} is outside {low} to {high} {unit}")]
    OutOfRange {
        /// Latitude, longitude, elevation, pressure or temperature.
        what: &'static str,
        /// What was given.
        value: f64,
        /// The least value allowed.
        low: f64,
        /// The greatest value allowed.
        high: f64,
        /// The unit of the three.
        unit: &'static str,
    },
    /// A time at which the algorithm gives no position.
    #[error("no position of the sun at {time}: {reason}")]
    Position {
        /// The time asked for.
        time: String,
        /// What the algorithm said.
        reason: String,
    },
}

/// A place on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Degrees, north positive, −90 to 90.
    pub latitude: f64,
    /// Degrees, east positive, −180 to 180.
    pub longitude: f64,
    /// Metres above sea level, −1000 to 20000.
    pub elevation: f64,
}

/// A moment to the second, with the UTC offset that it is written in. Times are equal, and ordered, as moments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time(DateTime<FixedOffset>);

impl Time {
    /// A moment of the calendar (Gregorian) and clock of a place whose clocks are `utc_offset` seconds ahead of UTC
    /// (less than a day either way); `second_of_day` is 0 to 86399. `None` where there is no such moment.
    pub fn from_local(year: i32, month: u32, day: u32, second_of_day: u32, utc_offset: i32) -> Option<Self> {
        let local = NaiveDate::from_ymd_opt(year, month, day)?.and_hms_opt(0, 0, 0)?;
        if second_of_day >= 86_400 {
            return None;
        }
        let local = local.checked_add_signed(TimeDelta::seconds(second_of_day.into()))?;
        let offset = FixedOffset::east_opt(utc_offset)?;
        offset.from_local_datetime(&local).single().map(Self)
    }

    /// The ISO text: `2026-06-21T12:00+02:00`, with seconds where they are not 0, and `Z` for an offset of 0.
    pub fn name(&self) -> String {
        if self.0.second() != 0 {
            return self.0.to_rfc3339_opts(SecondsFormat::Secs, true);
        }
        match self.0.offset().local_minus_utc() {
            0 => self.0.format("%Y-%m-%dT%H:%MZ").to_string(),
            _ => self.0.format("%Y-%m-%dT%H:%M%:z").to_string(),
        }
    }

    /// The day of the year by its own offset, 1 to 366.
    pub fn day_of_year(&self) -> u32 {
        self.0.ordinal()
    }

    /// Seconds since 1970-01-01T00:00Z, leap seconds left out.
    pub fn unix_seconds(&self) -> i64 {
        self.0.timestamp()
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name())
    }
}

/// Whether `text` begins as `pattern` does, where `d` stands for any digit. Needed as chrono also takes `2026-6-1`.
fn has_shape(text: &[u8], pattern: &[u8]) -> bool {
    text.len() >= pattern.len()
        && pattern.iter().zip(text).all(|(&expected, &found)| match expected {
            b'd' => found.is_ascii_digit(),
            _ => found == expected,
        })
}

/// At most 60 characters of a text, for messages.
pub(crate) fn shown(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

impl FromStr for Time {
    type Err = Error;

    /// Reads `YYYY-MM-DDTHH:MM`, optionally `:SS`, then `Z`, `±HH:MM` or `±HHMM`.
    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = || Error::Time(shown(text));
        let bytes = text.as_bytes();
        if !has_shape(bytes, b"dddd-dd-ddTdd:dd") {
            return Err(wrong());
        }
        let (clock, format) = match has_shape(&bytes[16..], b":dd") {
            true => (19, "%Y-%m-%dT%H:%M:%S%z"),
            false => (16, "%Y-%m-%dT%H:%M%z"),
        };
        let offset = &bytes[clock..];
        let is_offset = |sign| {
            let forms: [&[u8]; 2] = [b"dd:dd", b"dddd"];
            let digits = offset.strip_prefix(&[sign]);
            digits.is_some_and(|digits| forms.iter().any(|f| f.len() == digits.len() && has_shape(digits, f)))
        };
        let moment = match offset {
            [] => {
                let moment = format!("{text}+0000");
                // What is no time at all is not called a time without an offset.
                let known = DateTime::parse_from_str(&moment, format).is_ok();
                return Err(if known { Error::NoOffset(shown(text)) } else { wrong() });
            }
            b"Z" => DateTime::parse_from_str(&format!("{}+0000", &text[..clock]), format),
            _ if is_offset(b'+') || is_offset(b'-') => DateTime::parse_from_str(text, format),
            _ => return Err(wrong()),
        };
        // A leap second is a second in chrono with more than 10⁹ nanoseconds; the sun's algorithm has none.
        let moment = moment.ok().filter(|moment| moment.nanosecond() == 0);
        moment.map(Self).ok_or_else(wrong)
    }
}

/// Seconds of a step: `30m`, `1h`, `15s`, `1d`.
fn step(text: &str) -> Result<i64, Error> {
    let wrong = || Error::Step(shown(text));
    let unit = match text.as_bytes().last() {
        Some(b's') => 1,
        Some(b'm') => 60,
        Some(b'h') => 3600,
        Some(b'd') => 86_400,
        _ => return Err(wrong()),
    };
    let digits = &text[..text.len() - 1];
    // `parse` would take a sign.
    if digits.is_empty() || !digits.bytes().all(|digit| digit.is_ascii_digit()) {
        return Err(wrong());
    }
    let count: u32 = digits.parse().map_err(|_| wrong())?;
    match count {
        0 => Err(wrong()),
        _ => Ok(i64::from(count) * unit),
    }
}

/// The times of `TIME`, or of `START/END/STEP`: START, START + STEP, … up to END inclusive, in START's UTC offset.
///
/// STEP is a whole number above 0 and `s`, `m`, `h` or `d`. At most [`MAX_TIMES`]. Each time's [`Time::name`] is its
/// ISO text. A range keeps START's offset where clocks change: a day is 24 hours.
pub fn times(text: &str) -> Result<Vec<Time>, Error> {
    let parts: Vec<&str> = text.splitn(4, '/').collect();
    let (start, end, seconds) = match parts[..] {
        [one] => return Ok(vec![one.parse()?]),
        [start, end, step_text] => (start.parse::<Time>()?, end.parse::<Time>()?, step(step_text)?),
        _ => return Err(Error::Range(shown(text))),
    };
    let length = end.unix_seconds() - start.unix_seconds();
    if length < 0 {
        return Err(Error::Reversed(shown(text)));
    }
    let steps = length / seconds;
    let limit = i64::try_from(MAX_TIMES).unwrap_or(i64::MAX);
    if steps >= limit {
        let count = steps.unsigned_abs() + 1;
        return Err(Error::TooMany {
            range: shown(text),
            count,
        });
    }
    // No sum overflows: every time lies between two that exist.
    let at = |i: i64| {
        start
            .0
            .checked_add_signed(TimeDelta::try_seconds(i * seconds)?)
            .map(Time)
    };
    Ok((0..=steps).filter_map(at).collect())
}

/// Where the sun is in the sky of a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Degrees clockwise from north, 0 to 360.
    pub azimuth: f64,
    /// Degrees above the horizon, −90 to 90, of the centre of the disc.
    pub altitude: f64,
}

impl Sun {
    /// The unit vector to the sun: (east, north, up).
    pub fn direction(&self) -> [f64; 3] {
        let (sin_altitude, cos_altitude) = self.altitude.to_radians().sin_cos();
        let (sin_azimuth, cos_azimuth) = self.azimuth.to_radians().sin_cos();
        [cos_altitude * sin_azimuth, cos_altitude * cos_azimuth, sin_altitude]
    }

    /// Whether the centre of the disc is above the horizon.
    pub fn is_up(&self) -> bool {
        self.altitude > 0.0
    }
}

/// Refuses a value that is not within a range, NaN included.
fn within(what: &'static str, value: f64, [low, high]: [f64; 2], unit: &'static str) -> Result<(), Error> {
    match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(Error::OutOfRange {
            what,
            value,
            low,
            high,
            unit,
        }),
    }
}

/// Where the sun is, refracted by an atmosphere or not.
fn locate(place: &Place, time: &Time, refraction: Option<RefractionCorrection>) -> Result<Sun, Error> {
    within("latitude", place.latitude, [-90.0, 90.0], "degrees")?;
    within("longitude", place.longitude, [-180.0, 180.0], "degrees")?;
    within("elevation", place.elevation, [-1000.0, 20_000.0], "m")?;
    let location = solar_positioning::Location {
        latitude: place.latitude,
        longitude: place.longitude,
    };
    let utc = time.0.to_utc();
    let position = delta_t::estimate_from_date_like(&utc)
        .and_then(|delta_t| SolarPositions::new().at(&utc, location, place.elevation, delta_t, refraction))
        .map_err(|error| Error::Position {
            time: time.name(),
            reason: error.to_string(),
        })?;
    Ok(Sun {
        azimuth: position.azimuth(),
        altitude: position.elevation_angle(),
    })
}

/// Where the sun is, geometrically: as seen from the place (parallax included) and not lifted by refraction.
///
/// Agrees with pvlib's `nrel_numpy` to 0.001°. Years −500 to 3000, by the estimate of ΔT.
pub fn position(place: &Place, time: &Time) -> Result<Sun, Error> {
    locate(place, time, None)
}

/// Where the sun appears to be: lifted by the refraction of air at a pressure in Pa (1 to 200000) and a temperature in
/// °C (−100 to 100), by about 0.5° at the horizon (Reda and Andreas 2004, eq. 42).
pub fn apparent_position(place: &Place, time: &Time, pressure: f64, temperature: f64) -> Result<Sun, Error> {
    within("pressure", pressure, [1.0, 200_000.0], "Pa")?;
    within("temperature", temperature, [-100.0, 100.0], "°C")?;
    // The algorithm takes hPa.
    let refraction = RefractionCorrection::new(pressure / 100.0, temperature);
    let refraction = refraction.map_err(|error| Error::Position {
        time: time.name(),
        reason: error.to_string(),
    })?;
    locate(place, time, Some(refraction))
}
