//! Positions of the sun are those of pvlib, and times are those of ISO 8601.

use hemicube_weather::sun::{self, Error, MAX_TIMES, Place, Sun, Time, times};

/// Time, latitude, longitude, elevation; azimuth and altitude by pvlib 0.16.1, whose `nrel_numpy` is another program of
/// the same algorithm, for each row:
/// `pvlib.solarposition.get_solarposition(pandas.DatetimeIndex([pandas.Timestamp(TIME)]), LATITUDE, LONGITUDE,
/// altitude=ELEVATION, method="nrel_numpy", delta_t=None)[["azimuth", "elevation"]]`
const PVLIB: [(&str, f64, f64, f64, f64, f64); 16] = [
    ("2026-03-20T09:00+01:00", 52.52, 13.405, 34.0, 125.1645, 23.6959),
    ("2026-06-21T12:00+02:00", 52.52, 13.405, 34.0, 149.3633, 58.1455),
    ("2026-09-23T17:30+02:00", 52.52, 13.405, 34.0, 251.9277, 13.0713),
    ("2026-12-21T12:00+01:00", 52.52, 13.405, 34.0, 178.9540, 14.0347),
    ("2026-03-20T13:00+08:00", 1.352, 103.82, 15.0, 116.2805, 86.5860),
    ("2026-06-21T08:30+08:00", 1.352, 103.82, 15.0, 65.5397, 19.6600),
    ("2026-10-05T16:00+08:00", 1.352, 103.82, 15.0, 262.1889, 42.9359),
    ("2026-12-21T19:30+08:00", 1.352, 103.82, 15.0, 246.5564, -6.7844),
    ("2026-01-10T13:40-03:00", -33.45, -70.66, 570.0, 11.6902, 78.2138),
    ("2026-04-15T08:45-04:00", -33.45, -70.66, 570.0, 63.6778, 18.8848),
    ("2026-07-01T12:00-04:00", -33.45, -70.66, 570.0, 12.7013, 32.3969),
    ("2026-11-11T18:20-03:00", -33.45, -70.66, 570.0, 263.6517, 23.2602),
    ("2026-06-21T00:00+02:00", 69.65, 18.956, 10.0, 349.4714, 3.4504),
    ("2026-08-01T12:00+02:00", 69.65, 18.956, 10.0, 164.7474, 37.7220),
    ("2026-12-21T12:00+01:00", 69.65, 18.956, 10.0, 184.0837, -3.1443),
    ("2026-03-01T10:00+01:00", 69.65, 18.956, 10.0, 150.6352, 10.2754),
];

const BERLIN: Place = Place {
    latitude: 52.52,
    longitude: 13.405,
    elevation: 34.0,
};

fn time(text: &str) -> Time {
    text.parse().unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn positions_are_those_of_pvlib() {
    let mut worst: f64 = 0.0;
    for (text, latitude, longitude, elevation, azimuth, altitude) in PVLIB {
        let place = Place {
            latitude,
            longitude,
            elevation,
        };
        let sun = sun::position(&place, &time(text)).unwrap_or_else(|error| panic!("{error}"));
        worst = worst
            .max((sun.altitude - altitude).abs())
            .max((sun.azimuth - azimuth).abs());
    }
    assert!(worst < 0.001, "{worst}");
}

#[test]
fn directions_are_east_north_up() {
    let near = |sun: Sun, [e, n, u]: [f64; 3]| {
        let [x, y, z] = sun.direction();
        (x - e).abs() < 1e-12 && (y - n).abs() < 1e-12 && (z - u).abs() < 1e-12
    };
    let half = 0.5_f64.sqrt();
    assert!(near(
        Sun {
            azimuth: 90.0,
            altitude: 0.0
        },
        [1.0, 0.0, 0.0]
    ));
    assert!(near(
        Sun {
            azimuth: 0.0,
            altitude: 45.0
        },
        [0.0, half, half]
    ));
    assert!(near(
        Sun {
            azimuth: 180.0,
            altitude: -45.0
        },
        [0.0, -half, -half]
    ));
    assert!(near(
        Sun {
            azimuth: 17.0,
            altitude: 90.0
        },
        [0.0, 0.0, 1.0]
    ));
    assert!(
        Sun {
            azimuth: 0.0,
            altitude: 1.0
        }
        .is_up()
            && !Sun {
                azimuth: 0.0,
                altitude: 0.0
            }
            .is_up()
    );
}

#[test]
fn refraction_lifts_a_low_sun() {
    // At sunset over Berlin; half a degree at the horizon, a hundredth at 60°.
    let sunset = time("2026-06-21T21:30+02:00");
    let low = sun::position(&BERLIN, &sunset).unwrap_or_else(|error| panic!("{error}"));
    let lifted = sun::apparent_position(&BERLIN, &sunset, 101_325.0, 15.0).unwrap_or_else(|error| panic!("{error}"));
    let lift = lifted.altitude - low.altitude;
    assert!(low.altitude.abs() < 0.6 && (0.3..0.7).contains(&lift), "{low:?} {lift}");
    assert_eq!(low.azimuth, lifted.azimuth);
    let noon = time("2026-06-21T13:10+02:00");
    let lift = sun::apparent_position(&BERLIN, &noon, 101_325.0, 15.0)
        .unwrap_or_else(|error| panic!("{error}"))
        .altitude
        - sun::position(&BERLIN, &noon)
            .unwrap_or_else(|error| panic!("{error}"))
            .altitude;
    assert!((0.005..0.015).contains(&lift), "{lift}");
    for (pressure, temperature) in [
        (0.0, 15.0),
        (f64::NAN, 15.0),
        (101_325.0, -300.0),
        (101_325.0, f64::INFINITY),
    ] {
        assert!(matches!(
            sun::apparent_position(&BERLIN, &noon, pressure, temperature),
            Err(Error::OutOfRange { .. })
        ));
    }
}

#[test]
fn places_out_of_range_are_refused() {
    let noon = time("2026-06-21T12:00Z");
    for place in [
        Place {
            latitude: 90.1,
            ..BERLIN
        },
        Place {
            latitude: f64::NAN,
            ..BERLIN
        },
        Place {
            longitude: -180.5,
            ..BERLIN
        },
        Place {
            elevation: f64::INFINITY,
            ..BERLIN
        },
    ] {
        let refused = sun::position(&place, &noon);
        assert!(
            matches!(refused, Err(Error::OutOfRange { .. })),
            "{place:?}: {refused:?}"
        );
    }
    // The estimate of ΔT ends in the year 3000.
    let late = sun::position(&BERLIN, &time("9999-12-31T23:59Z"));
    assert!(matches!(late, Err(Error::Position { .. })), "{late:?}");
}

#[test]
fn the_poles_and_the_date_line_have_suns() {
    for (latitude, longitude) in [(90.0, 0.0), (-90.0, 180.0), (0.0, -180.0), (0.0, 180.0)] {
        let place = Place {
            latitude,
            longitude,
            elevation: 0.0,
        };
        let sun = sun::position(&place, &time("2026-06-21T12:00Z")).unwrap_or_else(|error| panic!("{error}"));
        assert!(
            sun.altitude.is_finite() && (0.0..=360.0).contains(&sun.azimuth),
            "{sun:?}"
        );
    }
    let pole = Place {
        latitude: 90.0,
        longitude: 0.0,
        elevation: 0.0,
    };
    let sun = sun::position(&pole, &time("2026-06-21T12:00Z")).unwrap_or_else(|error| panic!("{error}"));
    assert!(
        (sun.altitude - 23.436).abs() < 0.01,
        "the declination is {}",
        sun.altitude
    );
}

#[test]
fn times_have_the_names_that_they_are_read_from() {
    for (text, name, seconds) in [
        ("2026-06-21T12:00+02:00", "2026-06-21T12:00+02:00", 1_782_036_000),
        ("2026-06-21T12:00+0200", "2026-06-21T12:00+02:00", 1_782_036_000),
        ("2026-06-21T10:00Z", "2026-06-21T10:00Z", 1_782_036_000),
        ("2026-06-21T10:00:00Z", "2026-06-21T10:00Z", 1_782_036_000),
        ("2026-06-21T10:00+00:00", "2026-06-21T10:00Z", 1_782_036_000),
        ("2026-06-21T06:30:05-03:30", "2026-06-21T06:30:05-03:30", 1_782_036_005),
        ("2024-02-29T00:00Z", "2024-02-29T00:00Z", 1_709_164_800),
    ] {
        let read = time(text);
        assert_eq!((read.name().as_str(), read.unix_seconds()), (name, seconds), "{text}");
        assert_eq!(time(name), read);
        assert_eq!(read.to_string(), name);
    }
    assert_eq!(time("2026-12-31T23:00-05:00").day_of_year(), 365);
}

#[test]
fn what_is_no_time_is_refused() {
    for text in ["2026-06-21T12:00", "2026-06-21T12:00:30"] {
        assert_eq!(text.parse::<Time>(), Err(Error::NoOffset(text.into())));
    }
    for text in [
        "",
        "now",
        "2026-06-21",
        "2026-6-21T12:00Z",
        "2026-06-21 12:00Z",
        "26-06-21T12:00Z",
        "2026-02-29T12:00Z",
        "2026-13-01T12:00Z",
        "2026-06-21T24:00Z",
        "2026-06-21T12:60Z",
        "2026-06-21T12:00:60Z",
        "2026-06-21T12:00:61Z",
        "2026-06-21T12:00 +02:00",
        "2026-06-21T12:00+2:00",
        "2026-06-21T12:00+25:00",
        "2026-06-21T12:00+02:00 ",
        "2026-06-21T12:00z",
        "2026-06-21T12:00Zulu",
        "2026-06-21T12:00:00.5Z",
        "+026-06-21T12:00Z",
        "2026-06-21T12:00−02:00",
        "２026-06-21T12:00Z",
        "2026-02-30T12:00",
        "2026-06-21T12:00+02:99",
    ] {
        assert_eq!(text.parse::<Time>(), Err(Error::Time(text.into())));
    }
    let long = "9".repeat(10_000);
    let message = long
        .parse::<Time>()
        .err()
        .map(|error| error.to_string())
        .unwrap_or_default();
    assert!(message.len() < 200, "{message}");
}

#[test]
fn a_range_is_a_list_of_times() {
    let names = |text: &str| -> Vec<String> {
        let found = times(text).unwrap_or_else(|error| panic!("{error}"));
        found.iter().map(Time::name).collect()
    };
    let hours = [
        "2026-06-21T23:00+02:00",
        "2026-06-22T00:00+02:00",
        "2026-06-22T01:00+02:00",
    ];
    assert_eq!(names("2026-06-21T23:00+02:00/2026-06-22T01:00+02:00/1h"), hours);
    // The end's offset is its own; what does not fall on the end stops before it.
    assert_eq!(names("2026-06-21T23:00+02:00/2026-06-21T23:59Z/60m"), hours);
    assert_eq!(names("2026-06-21T12:00Z/2026-06-21T12:00Z/1d"), ["2026-06-21T12:00Z"]);
    assert_eq!(
        names("2026-06-21T12:00Z/2026-06-21T12:00:45Z/30s"),
        ["2026-06-21T12:00Z", "2026-06-21T12:00:30Z"]
    );
    assert_eq!(names("2026-06-21T12:00Z"), ["2026-06-21T12:00Z"]);
    assert_eq!(names("2024-01-01T00:00Z/2024-12-31T23:30Z/30m").len(), 2 * 8784);
    assert_eq!(names("0000-01-01T00:00Z/9999-12-31T00:00Z/4294967295d").len(), 1);
}

#[test]
fn what_is_no_range_is_refused() {
    let range = |step: &str| times(&format!("2026-06-21T12:00Z/2026-06-21T13:00Z/{step}"));
    for step in [
        "",
        "1",
        "h",
        "0h",
        "-1h",
        "+1h",
        "1.5h",
        "1 h",
        "1H",
        "1w",
        "99999999999s",
        "1й",
    ] {
        assert_eq!(range(step), Err(Error::Step(step.into())));
    }
    for text in [
        "2026-06-21T12:00Z/2026-06-21T13:00Z",
        "2026-06-21T12:00Z/2026-06-21T13:00Z/1h/1h",
    ] {
        assert_eq!(times(text), Err(Error::Range(text.into())));
    }
    let reversed = times("2026-06-21T12:00Z/2026-06-21T11:00Z/1h");
    assert!(matches!(reversed, Err(Error::Reversed(_))), "{reversed:?}");
    let many = times("0001-01-01T00:00Z/9999-12-31T00:00Z/1s");
    assert!(
        matches!(many, Err(Error::TooMany { count, .. }) if count > MAX_TIMES as u64),
        "{many:?}"
    );
}

#[test]
fn clocks_of_no_calendar_have_no_time() {
    let known = Time::from_local(2026, 6, 21, 43_200, 7200);
    assert_eq!(known.map(|time| time.name()).as_deref(), Some("2026-06-21T12:00+02:00"));
    for (month, day, second, offset) in [
        (2, 29, 0, 0),
        (13, 1, 0, 0),
        (1, 0, 0, 0),
        (1, 1, 86_400, 0),
        (1, 1, 0, 86_400),
    ] {
        assert_eq!(Time::from_local(2026, month, day, second, offset), None);
    }
    assert_eq!(Time::from_local(i32::MAX, 1, 1, 0, 0), None);
    assert_eq!(Time::from_local(262_142, 12, 31, 86_399, i32::MIN), None);
    // The first and last moments of the calendar's own range, moved out of it by an offset.
    for (year, month, day, offset) in [(262_142, 12, 31, -86_399), (-262_143, 1, 1, 86_399)] {
        if let Some(time) = Time::from_local(year, month, day, 0, offset) {
            assert!(!time.name().is_empty() && sun::position(&BERLIN, &time).is_err());
        }
    }
}
