//! Weather files are read as they are meant, and what is none is refused with its line.

use hemicube_weather::epw::{Epw, Error, MAX_BYTES, Problem};

/// Days of the months of a year.
fn months(is_leap: bool) -> [u32; 12] {
    [
        31,
        if is_leap { 29 } else { 28 },
        31,
        30,
        31,
        30,
        31,
        31,
        30,
        31,
        30,
        31,
    ]
}

/// A weather file of invented weather, each number by a rule that the tests know.
fn invented(is_leap: bool) -> String {
    let mut text = String::from(
        "LOCATION,Nowhere,Region,XXX,Invented,000000,52.5,13.4,1.0,34.0\n\
         DESIGN CONDITIONS,0\n\
         TYPICAL/EXTREME PERIODS,0\n\
         GROUND TEMPERATURES,0\n\
         HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0\n\
         COMMENTS 1,\"one quotation mark\n\
         COMMENTS 2,\n\
         DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\n",
    );
    let year = if is_leap { 2024 } else { 2023 };
    let mut at = 0;
    for (days, month) in months(is_leap).into_iter().zip(1..) {
        for day in 1..=days {
            for hour in 1..=24 {
                text.push_str(&line(year, month, day, hour, at));
                at += 1;
            }
        }
    }
    text
}

fn line(year: i32, month: u32, day: u32, hour: u32, at: u32) -> String {
    let dry = f64::from(at % 400) / 10.0 - 10.0;
    let dew = dry - 5.0;
    let (humidity, pressure, infrared) = (at % 101, 100_000 + at % 1000, 250 + at % 200);
    let is_day = (9..17).contains(&hour);
    let (outside, direct, diffuse) = if is_day { (1366, at % 900, at % 300) } else { (0, 0, 0) };
    let wind = f64::from(at % 150) / 10.0;
    format!(
        "{year},{month},{day},{hour},60,?9?9?9,{dry:.1},{dew:.1},{humidity},{pressure},0,{outside},{infrared},0,\
         {direct},{diffuse},0,0,0,0,180,{wind:.1},5,5,9999,99999,9,999999999,0,0.1,0,88,0.2,0.0,0.0\n"
    )
}

fn read(text: &str) -> Epw {
    Epw::parse(text.as_bytes()).unwrap_or_else(|error| panic!("{error}"))
}

/// The line and the problem of a file that is refused.
fn refused(bytes: &[u8]) -> (usize, Problem) {
    match Epw::parse(bytes) {
        Err(Error::Line { line, problem }) => (line, problem),
        other => panic!("{:?}", other.map(|epw| epw.hours.len())),
    }
}

/// The file with one line replaced, from 1.
fn with_line(text: &str, number: usize, line: &str) -> String {
    let lines = text
        .lines()
        .zip(1..)
        .map(|(old, at)| if at == number { line } else { old });
    lines.collect::<Vec<_>>().join("\n")
}

/// The file with one field of line 9, the first hour, replaced.
fn with_field(text: &str, place: usize, field: &str) -> String {
    let first = text.lines().nth(8).unwrap_or_default();
    let mut fields: Vec<&str> = first.split(',').collect();
    fields[place] = field;
    with_line(text, 9, &fields.join(","))
}

#[test]
fn hours_are_those_of_the_file() {
    for (is_leap, count) in [(false, 8760), (true, 8784)] {
        let epw = read(&invented(is_leap));
        assert_eq!(epw.hours.len(), count);
        let location = &epw.location;
        assert_eq!(
            (location.name.as_str(), location.station.as_str()),
            ("Nowhere", "000000")
        );
        assert_eq!((location.region.as_str(), location.country.as_str()), ("Region", "XXX"));
        assert_eq!((location.source.as_str(), location.utc_offset), ("Invented", 1.0));
        assert_eq!((location.place.latitude, location.place.longitude), (52.5, 13.4));
        assert_eq!(location.place.elevation, 34.0);
        // The 4001st hour: at = 4000.
        let hour = epw.hours[4000];
        assert_eq!((hour.dry_bulb, hour.dew_point), (Some(-10.0), Some(-15.0)));
        assert_eq!((hour.relative_humidity, hour.pressure), (Some(61.0), Some(100_000.0)));
        assert_eq!((hour.horizontal_infrared, hour.wind_speed), (Some(250.0), Some(10.0)));
        assert_eq!(hour.hour, 4000 % 24 + 1);
        let noon = epw.hours[24 * 100 + 11];
        assert_eq!((noon.hour, noon.extraterrestrial_normal), (12, Some(1366.0)));
        assert_eq!((noon.direct_normal, noon.diffuse_horizontal), (Some(611.0), Some(11.0)));
        let last = epw.hours[count - 1];
        assert_eq!((last.month, last.day, last.hour), (12, 31, 24));
    }
}

#[test]
fn line_ends_marks_and_comments_do_not_matter() {
    let text = invented(false);
    let epw = read(&text);
    assert_eq!(read(&text.replace('\n', "\r\n")), epw);
    assert_eq!(read(&format!("\u{feff}{text}")), epw);
    assert_eq!(read(text.trim_end()), epw);
    assert_eq!(read(&format!("{text}\n\n")), epw);
    // Comments in Latin-1, as older files have them.
    let mut bytes = text.clone().into_bytes();
    let comment = text.find("COMMENTS 2,").unwrap_or_default() + 10;
    bytes[comment] = 0xfc;
    assert_eq!(Epw::parse(&bytes).ok(), Some(epw));
}

#[test]
fn missing_values_are_none() {
    let text = invented(false);
    let first = |place: usize, field: &str| read(&with_field(&text, place, field)).hours[0];
    for code in ["99.9", "999", "99.90", ""] {
        assert_eq!(first(6, code).dry_bulb, None);
        assert_eq!(first(7, code).dew_point, None);
    }
    assert_eq!(first(8, "999").relative_humidity, None);
    assert_eq!(first(9, "999999").pressure, None);
    assert_eq!(first(11, "9999").extraterrestrial_normal, None);
    assert_eq!(first(12, "9999").horizontal_infrared, None);
    assert_eq!(first(12, "9999").sky_temperature(), None);
    assert_eq!(first(14, "9999.").direct_normal, None);
    assert_eq!(first(15, "99999").diffuse_horizontal, None);
    assert_eq!(first(21, "999.0").wind_speed, None);
    assert_eq!(first(6, " 12.5 ").dry_bulb, Some(12.5));
}

#[test]
fn the_sun_is_that_of_the_middle_of_the_hour() {
    let epw = read(&invented(false));
    let location = &epw.location;
    let first = epw.hours[0].middle(location).map(|time| time.name());
    assert_eq!(first.as_deref(), Ok("2023-01-01T00:30+01:00"));
    let last = epw.hours[8759].middle(location).map(|time| time.name());
    assert_eq!(last.as_deref(), Ok("2023-12-31T23:30+01:00"));
    // 21 June, the hours to 12 and to 13; solar noon is at 12:08, as 13.4° E is 1.6° from the meridian of the time
    // zone.
    let day = (31 + 28 + 31 + 30 + 31 + 20) * 24;
    let altitudes: Vec<f64> = (day..day + 24)
        .map(|at| epw.hours[at].sun(location).map_or(f64::NAN, |sun| sun.altitude))
        .collect();
    let highest = altitudes.iter().copied().fold(f64::MIN, f64::max);
    assert!(
        highest == altitudes[12] && altitudes[11] > altitudes[13],
        "{altitudes:?}"
    );
    assert!((highest - (90.0 - 52.5 + 23.44)).abs() < 0.5, "{highest}");
    // Half an hour from UTC, as in India.
    let india = with_line(&invented(false), 1, "LOCATION,Nowhere,,,,,28.6,77.2,5.5,216");
    let epw = read(&india);
    let name = epw.hours[0].middle(&epw.location).map(|time| time.name());
    assert_eq!(name.as_deref(), Ok("2023-01-01T00:30+05:30"));
    // Hours that were made, not read.
    let mut made = epw.hours[0];
    for hour in [0, 25, u32::MAX] {
        made.hour = hour;
        assert!(made.sun(&epw.location).is_err());
    }
}

#[test]
fn sky_temperatures_follow_from_the_infrared() {
    let epw = read(&invented(false));
    let found = epw.hours[50].sky_temperature().unwrap_or(f64::NAN);
    // 300 W/m² over σ, to the power ¼.
    assert!((found - 269.7).abs() < 0.05, "{found}");
}

#[test]
fn wrong_lines_are_refused_by_number() {
    let text = invented(false);
    assert_eq!(refused(b"").1, Problem::Header("LOCATION"));
    assert_eq!(refused(b"\n\n"), (1, Problem::Header("LOCATION")));
    assert_eq!(refused(b"solid cube\nfacet"), (1, Problem::Header("LOCATION")));
    assert_eq!(refused(b"LOCATION,a,b").0, 1);
    assert_eq!(
        refused(with_line(&text, 8, "DATA,1,1").as_bytes()).1,
        Problem::Header("DATA PERIODS")
    );
    assert_eq!(
        refused(with_line(&text, 8, "DATA PERIODS,1,4,Data").as_bytes()),
        (8, Problem::Periods { periods: 1, records: 4 })
    );
    assert_eq!(
        refused(with_line(&text, 8, "DATA PERIODS").as_bytes()),
        (8, Problem::Fields { found: 1, needed: 3 })
    );
    for location in [
        "LOCATION,a,b,c,d,e,91,0,0,0",
        "LOCATION,a,b,c,d,e,1,0,15,0",
        "LOCATION,a,b,c,d,e,nan,0,0,0",
    ] {
        assert_eq!(refused(with_line(&text, 1, location).as_bytes()).0, 1, "{location}");
    }
    for (place, field) in [
        (0, "abc"),
        (0, "-5"),
        (0, "1e3"),
        (1, "13"),
        (1, "0"),
        (2, "32"),
        (2, "1.5"),
        (3, "2"),
        (3, "25"),
        (3, "0"),
        (6, "warm"),
        (6, "NaN"),
        (6, "inf"),
        (6, "-1e999"),
        (6, "-91"),
        (6, "80"),
        (8, "-1"),
        (8, "500"),
        (9, "0"),
        (9, "200000"),
        (12, "-1"),
        (12, "5000"),
        (14, "-0.1"),
        (15, "1e4x"),
        (21, "-3"),
        (21, "0x10"),
        (21, "1,5,"),
    ] {
        let wrong = with_field(&text, place, field);
        if field == "1,5," {
            // A decimal comma moves fields that are not read.
            assert!(Epw::parse(wrong.as_bytes()).is_ok());
            continue;
        }
        let (line, problem) = refused(wrong.as_bytes());
        assert_eq!(line, 9, "{field}: {problem}");
        assert!(problem.to_string().len() < 200, "{problem}");
    }
    let february = with_line(&text, 9 + 31 * 24, &line(2023, 2, 30, 1, 0));
    assert_eq!(
        refused(february.as_bytes()),
        (
            9 + 31 * 24,
            Problem::Date {
                year: 2023,
                month: 2,
                day: 30
            }
        )
    );
    assert_eq!(
        refused(with_line(&text, 100, "1,2,3").as_bytes()),
        (100, Problem::Fields { found: 3, needed: 22 })
    );
    let cut = &text[..text.len() / 2];
    let (line, _) = refused(cut.as_bytes());
    assert_eq!(line, cut.lines().count());
    let whole: Vec<&str> = text.lines().collect();
    assert_eq!(
        refused(whole[..1000].join("\n").as_bytes()),
        (1000, Problem::Hours(992))
    );
    let twice = format!("{text}{}", whole[8..].join("\n"));
    assert_eq!(refused(twice.as_bytes()), (8 + 8784 + 1, Problem::TooManyHours));
    let mut bytes = text.clone().into_bytes();
    bytes[12] = 0xff;
    assert_eq!(refused(&bytes), (1, Problem::NotText));
}

#[test]
fn absurd_sizes_are_refused() {
    assert!(matches!(Epw::parse(&vec![b'x'; MAX_BYTES + 1]), Err(Error::TooLarge)));
    let lines = "x\n".repeat(100_000);
    let (line, problem) = refused(format!("LOCATION,a,b,c,d,e,1,1,1,1\n{lines}").as_bytes());
    assert_eq!((line, problem), (65, Problem::Header("DATA PERIODS")));
    let long = "9".repeat(1 << 20);
    let (_, problem) = refused(with_field(&invented(false), 6, &long).as_bytes());
    assert!(problem.to_string().len() < 300, "{}", problem.to_string().len());
    let commas = ",".repeat(1 << 20);
    assert_eq!(refused(with_line(&invented(false), 9, &commas).as_bytes()).0, 9);
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let error = Epw::read("no/such/file.epw").err().map(|error| error.to_string());
    assert_eq!(error.as_deref(), Some("`no/such/file.epw` cannot be read"));
    let path = std::env::temp_dir().join(format!("hemicube-weather-{}.epw", std::process::id()));
    let text = invented(true);
    std::fs::write(&path, &text).unwrap_or_else(|error| panic!("{error}"));
    let found = Epw::read(&path);
    let _ = std::fs::remove_file(&path);
    assert_eq!(found.ok(), Some(read(&text)));
}

#[test]
fn mutants_are_refused_or_are_weather() {
    // Splits mix64: the same mutants in every run.
    let mut state = 1_u64;
    let mut next = |below: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        usize::try_from((mixed ^ (mixed >> 31)) % below as u64).unwrap_or_default()
    };
    let text = invented(false).into_bytes();
    let (mut read, mut refused) = (0, 0);
    for _ in 0..150 {
        let mut bytes = text.clone();
        for _ in 0..=next(4) {
            // Half of the mutations fall on the headers and the first day.
            let within = if next(2) == 0 {
                2000.min(bytes.len())
            } else {
                bytes.len()
            };
            let at = next(within.max(1));
            match next(5) {
                0 => bytes[at] = u8::try_from(next(256)).unwrap_or_default(),
                1 => bytes.truncate(at),
                2 => drop(bytes.drain(at..(at + next(300)).min(text.len()).min(at.max(bytes.len())))),
                3 => bytes[at] = b",\n-.9e\0"[next(7)],
                _ => {
                    let piece = bytes[at..(at + next(300)).min(bytes.len())].to_vec();
                    bytes.splice(at..at, piece);
                }
            }
            if bytes.is_empty() {
                break;
            }
        }
        match Epw::parse(&bytes) {
            Ok(epw) => {
                read += 1;
                assert!(epw.hours.len() == 8760 || epw.hours.len() == 8784);
                let values = epw
                    .hours
                    .iter()
                    .flat_map(|hour| [hour.dry_bulb, hour.direct_normal, hour.wind_speed]);
                assert!(values.flatten().all(f64::is_finite));
                assert!(epw.hours[..30].iter().all(|hour| hour.sun(&epw.location).is_ok()));
            }
            Err(error) => {
                refused += 1;
                assert!(error.to_string().len() < 400, "{error}");
            }
        }
    }
    assert!(read > 10 && refused > 50, "{read} read, {refused} refused");
}
