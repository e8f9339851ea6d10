//! `hemicube suns`: where the sun stands at a place, and what it, the sky and the air bring, as a table.

use crate::args::{Talk, UpAxis};
use crate::exit::{Exit, hinted};
use crate::help::examples;
use crate::outputs::Paths;
use crate::report::{PendingFile, counted, print};
use crate::suns::SkyModel;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hemicube::frame::Horizon;
use hemicube_scene::Axis;
use hemicube_weather::clear;
use hemicube_weather::epw::{self, Epw, Hour};
use hemicube_weather::sky::extraterrestrial_normal;
use hemicube_weather::sun::{Place, Sun, Time, position, times};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Linke turbidity of a clear day where none is given: a temperate summer. A choice: less is clearer air.
const TURBIDITY: f64 = 3.0;

/// Hours between the sun's noon and the middle of a year's light from which on it is said. A choice: of five real files
/// three are 0.43 to 0.67 h off, as if their values were of another end of the hour; clouds of afternoons shift a climate
/// by less.
const OFF_NOON: f64 = 0.35;

const EXAMPLES: &str = "  \
  hemicube suns berlin.epw --times 06-21 -o day.csv
  hemicube suns --location 52.52,13.40 --times 2026-06-21T04:00+02:00/2026-06-21T22:00+02:00/1h -o day.csv
  hemicube suns berlin.epw --up z --north 15 --sky uniform -o year.csv";

/// Make a table of suns for a place and its hours: direction, direct and diffuse light, sky, air
///
/// From a weather file, or for clear days at a place. `solve`, `points` and `sky` take the table by `--suns`.
#[derive(Args, Debug)]
#[command(after_long_help = examples(EXAMPLES, false))]
#[command(group = clap::ArgGroup::new("origin").args(["weather", "location"]).required(true))]
pub(crate) struct Arguments {
    /// A weather file of EnergyPlus (.epw): the sun stands where it does in the middle of each hour
    #[arg(value_name = "WEATHER.epw")]
    pub(crate) weather: Option<PathBuf>,
    /// The place of clear days: degrees north and east, and metres above the sea
    #[arg(long, value_name = "LAT,LON[,METRES]", value_parser = place, allow_hyphen_values = true)]
    pub(crate) location: Option<Place>,
    /// With `--location` times as 2026-06-21T12:00+02:00, or START/END/STEP with a step such as 1h or 30m (repeatable);
    /// of a weather file days as 06-21, or 06-21/06-23 [default: its year]
    #[arg(long, value_name = "TIMES", required_unless_present = "weather")]
    pub(crate) times: Vec<String>,
    /// How the sky's light is spread: uniform, perez, overcast, clear, or a standard sky of the CIE, cie1 to cie16
    #[arg(long, value_name = "SKY", default_value = "perez")]
    pub(crate) sky: SkyModel,
    /// Linke turbidity of the air on a clear day: 2 in mountains, 3 to 4 in temperate summers, 5 and more in haze
    /// [default: 3]
    #[arg(long, value_name = "L", value_parser = turbidity, conflicts_with = "weather")]
    pub(crate) turbidity: Option<f64>,
    /// The axis of the scene that points up
    #[arg(long, value_name = "x|y|z", default_value = "z", hide_possible_values = true)]
    pub(crate) up: UpAxis,
    /// Turn north clockwise, seen from above; 0: +y where z is up, −z where y is up, +z where x is up
    #[arg(long, value_name = "DEGREES", default_value = "0", value_parser = crate::args::degrees, allow_hyphen_values = true)]
    pub(crate) north: f64,
    /// Write the table to FILE.csv [default: `-`, standard output]
    #[arg(short, long, value_name = "FILE.csv")]
    pub(crate) output: Option<PathBuf>,
    /// Replace what is there
    #[arg(long, requires = "output")]
    pub(crate) overwrite: bool,
}

impl Arguments {
    /// The file to write; `None` for standard output.
    fn file(&self) -> Option<PathBuf> {
        self.output.clone().filter(|output| output.as_os_str() != "-")
    }

    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .reads(&self.weather)
            .writes("-o", &self.file(), self.overwrite)
    }
}

fn place(text: &str) -> Result<Place, String> {
    let needed =
        || "degrees north, −90 to 90, and east, −180 to 180, are needed: `52.52,13.40`, or with metres".to_owned();
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let (latitude, longitude, elevation) = match numbers.as_deref() {
        Some(&[latitude, longitude]) => (latitude, longitude, 0.0),
        Some(&[latitude, longitude, elevation]) => (latitude, longitude, elevation),
        _ => return Err(needed()),
    };
    let is_place = latitude.abs() <= 90.0 && longitude.abs() <= 180.0 && (-1000.0..=9000.0).contains(&elevation);
    let place = Place {
        latitude,
        longitude,
        elevation,
    };
    is_place.then_some(place).ok_or_else(needed)
}

fn turbidity(text: &str) -> Result<f64, String> {
    let [least, most] = clear::TURBIDITY;
    match text.parse::<f64>() {
        Ok(turbidity) if (least..=most).contains(&turbidity) => Ok(turbidity),
        _ => Err(format!("a turbidity from {least} to {most} is needed")),
    }
}

/// A moment of the table.
struct Line {
    time: Time,
    sun: Sun,
    /// W/m²: across the beam, of the sky on a level plane, and above the atmosphere.
    direct: f64,
    diffuse: f64,
    extraterrestrial: f64,
    /// Temperature of the sky (K), temperature (°C) and humidity (%) of the air, and wind (m/s), of a weather file.
    weather: Option<[f64; 4]>,
}

/// Days of a year without its number: from the first to the second, month and day each. The second may come before the
/// first: the turn of the year lies between them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Days([(u32, u32); 2]);

impl FromStr for Days {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let day = |text: &str| {
            let (month, day) = text.split_once('-')?;
            let two = |text: &str| (text.len() == 2).then(|| text.parse().ok()).flatten();
            let (month, day): (u32, u32) = (two(month)?, two(day)?);
            // A leap year has all days.
            Time::from_local(2024, month, day, 0, 0).map(|_| (month, day))
        };
        let (first, last) = text.split_once('/').unwrap_or((text, text));
        match (day(first), day(last)) {
            (Some(first), Some(last)) => Ok(Self([first, last])),
            _ => Err(hinted(
                anyhow!("`{text}` is no day of a weather file"),
                "its hours are of several years: give month and day, `06-21`, or the first and last of several, \
                 `06-21/06-23`",
            )),
        }
    }
}

impl Days {
    fn holds(self, hour: &Hour) -> bool {
        let (Self([first, last]), at) = (self, (hour.month, hour.day));
        if first <= last {
            (first..=last).contains(&at)
        } else {
            at >= first || at <= last
        }
    }
}

pub(crate) fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let horizon = Horizon::new(Axis::from(arguments.up), arguments.north);
    let lines = match (&arguments.weather, &arguments.location) {
        (Some(path), _) => of_weather(path, &arguments.times, talk)?,
        (None, Some(place)) => of_clear_days(arguments, place)?,
        (None, None) => bail!("a weather file or `--location LAT,LON` is needed"),
    };
    let text = table(&lines, arguments.sky, horizon);
    let Some(output) = &arguments.file() else {
        print(&text)?;
        return Ok(Exit::Done);
    };
    let mut file = PendingFile::create(output)?;
    let cannot = || format!("`{}` cannot be written", output.display());
    file.write_all(text.as_bytes()).with_context(cannot)?;
    file.commit()?;
    let up = lines.iter().filter(|line| line.sun.is_up()).count();
    talk.say(&format!(
        "written: `{}`, {}; the sun is up at {up}",
        output.display(),
        counted(lines.len() as u64, "moment")
    ));
    Ok(Exit::Done)
}

/// The hours of a weather file, all or of some days.
fn of_weather(path: &Path, days: &[String], talk: Talk) -> Result<Vec<Line>> {
    let asked: Vec<(&String, Days)> = days
        .iter()
        .map(|text| text.parse::<Days>().map(|days| (text, days)))
        .collect::<Result<_>>()?;
    let epw = Epw::read(path).map_err(|error| match error {
        epw::Error::Line { line, problem } => anyhow!("{}:{line}: {problem}", path.display()),
        epw::Error::TooLarge => anyhow!("`{}`: {error}", path.display()),
        error => anyhow::Error::new(error),
    })?;
    require_days(path, &epw.hours, &asked)?;
    if let Some(late) = from_noon(&epw).filter(|late| late.abs() > OFF_NOON) {
        talk.warn(&format!(
            "the year's light of `{}` is centred {:.2} h {} the sun's noon: its hours may not be those that end at their \
             numbers, and sun and light of a line are then of different times",
            path.display(),
            late.abs(),
            if late > 0.0 { "after" } else { "before" }
        ));
    }
    let (mut lines, mut lost) = (Vec::new(), (0u64, 0.0));
    let mut unknown = 0u64;
    for hour in &epw.hours {
        if !(asked.is_empty() || asked.iter().any(|(_, days)| days.holds(hour))) {
            continue;
        }
        let time = hour.middle(&epw.location)?;
        let needed = |value: Option<f64>, what: &str| {
            value.ok_or_else(|| {
                hinted(
                    anyhow!("`{}` has no {what} for the hour of {time}", path.display()),
                    "choose days that are whole by `--times`",
                )
            })
        };
        let sun = position(&epw.location.place, &time)?;
        let mut direct = needed(hour.direct_normal, "direct normal irradiance")?;
        let diffuse = needed(hour.diffuse_horizontal, "diffuse horizontal irradiance")?;
        if !sun.is_up() && direct > 0.0 {
            lost = (lost.0 + 1, lost.1 + direct);
            direct = 0.0;
        }
        let above = hour.extraterrestrial_normal.filter(|&above| above > 0.0);
        let weather = [
            hour.sky_temperature(),
            hour.dry_bulb,
            hour.relative_humidity,
            hour.wind_speed,
        ];
        let weather = match weather {
            [Some(sky), Some(air), Some(humidity), Some(wind)] => [sky, air, humidity, wind],
            _ => {
                unknown += 1;
                continue;
            }
        };
        lines.push(Line {
            time,
            sun,
            direct,
            diffuse,
            extraterrestrial: above.unwrap_or_else(|| extraterrestrial_normal(time.day_of_year())),
            weather: Some(weather),
        });
    }
    if unknown > 0 {
        return Err(hinted(
            anyhow!(
                "`{}` lacks the sky's infrared, temperature, humidity or wind for {}",
                path.display(),
                counted(unknown, "hour")
            ),
            "choose days that are whole by `--times`",
        ));
    }
    if lost.0 > 0 {
        talk.warn(&format!(
            "{} with direct light whose sun is down in the middle of the hour: {:.0} Wh/m² across the beam left out",
            counted(lost.0, "hour"),
            lost.1
        ));
    }
    Ok(lines)
}

/// Requires that a file has an hour of each of the days asked for.
fn require_days(path: &Path, hours: &[Hour], asked: &[(&String, Days)]) -> Result<()> {
    let lacks = |days: Days| !hours.iter().any(|hour| days.holds(hour));
    let (Some((text, _)), Some(first), Some(last)) =
        (asked.iter().find(|(_, days)| lacks(*days)), hours.first(), hours.last())
    else {
        return Ok(());
    };
    Err(hinted(
        anyhow!(
            "`{}` has no day of `{text}`: its days go from {:02}-{:02} to {:02}-{:02}",
            path.display(),
            first.month,
            first.day,
            last.month,
            last.day
        ),
        "give days of the file by `--times`; 02-29 is in files of a leap year alone",
    ))
}

/// Hours from the sun's mean noon to the middle of all light of a file; `None` without light.
fn from_noon(epw: &Epw) -> Option<f64> {
    let noon = 12.0 + epw.location.utc_offset - epw.location.place.longitude / 15.0;
    let (mut sum, mut whole) = (0.0, 0.0);
    for hour in &epw.hours {
        let light = hour.direct_normal.unwrap_or(0.0) + hour.diffuse_horizontal.unwrap_or(0.0);
        let late = f64::from(hour.hour) - 0.5 - noon;
        // A zone's clock may be half a day off its place.
        sum += light * ((late + 12.0).rem_euclid(24.0) - 12.0);
        whole += light;
    }
    (whole > 0.0).then(|| sum / whole)
}

/// Clear days at a place.
fn of_clear_days(arguments: &Arguments, place: &Place) -> Result<Vec<Line>> {
    let mut lines = Vec::new();
    for text in &arguments.times {
        for time in times(text)? {
            let sun = position(place, &time)?;
            let extraterrestrial = extraterrestrial_normal(time.day_of_year());
            let turbidity = arguments.turbidity.unwrap_or(TURBIDITY);
            let sky = clear::sky(sun.altitude, place.elevation, turbidity, extraterrestrial);
            lines.push(Line {
                time,
                sun,
                direct: sky.direct_normal,
                diffuse: sky.diffuse_horizontal,
                extraterrestrial,
                weather: None,
            });
        }
    }
    Ok(lines)
}

/// The table: directions to 10⁻⁷, irradiances to 0.01 W/m².
fn table(lines: &[Line], sky: SkyModel, horizon: Horizon) -> String {
    let mut text = "time,x,y,z,direct (W/m2),diffuse (W/m2),sky,extraterrestrial (W/m2)".to_owned();
    let has_weather = lines.iter().any(|line| line.weather.is_some());
    if has_weather {
        text.push_str(",sky_temperature (K),air_temperature (degC),humidity (%),wind (m/s)");
    }
    text.push('\n');
    for line in lines {
        let [east, north, up] = line.sun.direction();
        let direction = horizon.east * east + horizon.north * north + horizon.up * up;
        let [x, y, z] = direction.to_array().map(|part| {
            // No −0.
            let part = (part * 1e7).round() / 1e7;
            part + 0.0
        });
        // Text always has room.
        let _ = write!(
            text,
            "{},{x},{y},{z},{:.2},{:.2},{sky},{:.2}",
            line.time, line.direct, line.diffuse, line.extraterrestrial
        );
        if let Some([sky, air, humidity, wind]) = line.weather {
            let _ = write!(text, ",{sky:.2},{air},{humidity},{wind}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_of_any_year_and_may_cross_its_turn() {
        let read = |text: &str| text.parse::<Days>();
        assert_eq!(read("06-21").expect("a day"), Days([(6, 21), (6, 21)]));
        assert_eq!(read("12-30/01-02").expect("days"), Days([(12, 30), (1, 2)]));
        for text in ["6-21", "06-31", "2026-06-21", "06-21/", "06", "13-01"] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn days_that_a_file_lacks_are_refused() {
        // Twelve months of 28 days, the last one again.
        let mut text = String::from("LOCATION,a,b,c,d,1,52,15,1,30\nDATA PERIODS,1,1,Data,Sunday,1/1,12/31\n");
        for day in 0..365u32 {
            for hour in 1..=24u32 {
                let (month, day) = ((1 + day / 28).min(12), 1 + day % 28);
                let _ = writeln!(
                    text,
                    "2023,{month},{day},{hour},0,-,10,5,50,101325,0,0,300,0,0,0,0,0,0,0,0,3"
                );
            }
        }
        let hours = Epw::parse(text.as_bytes()).expect("a file").hours;
        let of = |text: &str| {
            let text = text.to_owned();
            let days = text.parse::<Days>().expect("days");
            require_days("y.epw".as_ref(), &hours, &[(&text, days)]).map_err(|error| error.to_string())
        };
        assert!(of("02-28/03-01").is_ok() && of("02-29/03-01").is_ok());
        let said = "`y.epw` has no day of `02-29`: its days go from 01-01 to 12-01";
        assert_eq!(of("02-29"), Err(said.to_owned()));
    }

    #[test]
    fn light_that_is_of_another_hour_is_found() {
        let year = |shift: u32| {
            let mut text = String::from("LOCATION,a,b,c,d,1,52,15,1,30\nDATA PERIODS,1,1,Data,Sunday,1/1,12/31\n");
            // Which days they are does not matter.
            for day in 0..365u32 {
                for hour in 1..=24u32 {
                    // Evenly about noon, of the hours 7 to 18.
                    let light = if (7..=18).contains(&((hour + 24 - shift) % 24)) {
                        100
                    } else {
                        0
                    };
                    let _ = writeln!(
                        text,
                        "2023,1,{},{hour},0,-,10,5,50,101325,0,0,300,0,{light},50,0,0,0,0,0,3",
                        1 + day % 31
                    );
                }
            }
            from_noon(&Epw::parse(text.as_bytes()).expect("a file")).expect("light")
        };
        assert!(year(0).abs() < 1e-9, "{}", year(0));
        let late = year(2);
        assert!(late > OFF_NOON && late < 2.0, "{late}");
    }

    #[test]
    fn a_place_has_two_or_three_numbers_in_their_ranges() {
        let berlin = place("52.52, 13.4,34").expect("a place");
        assert_eq!(
            (berlin.latitude, berlin.longitude, berlin.elevation),
            (52.52, 13.4, 34.0)
        );
        for text in ["52.52", "91,0", "0,181", "north,0", "1,2,3,4", "1,2,1e9", "nan,0"] {
            assert!(place(text).is_err(), "{text}");
        }
    }
}
