//! UTCI is that of another program, and radiation on people is that of the standards.

use hemicube_weather::comfort::{self, CELSIUS_ZERO, Input, Posture, projected_area, utci};
use hemicube_weather::epw::sky_temperature;

/// Air and mean radiant temperature (°C), wind (m/s), relative humidity (%) and UTCI (°C) by pythermalcomfort 4.8.1:
/// `pythermalcomfort.models.utci(AIR, RADIANT, WIND, HUMIDITY, round_output=False).utci`
const PYTHERMALCOMFORT: [(f64, f64, f64, f64, f64); 24] = [
    (25.0, 25.0, 1.0, 50.0, 24.612126),
    (40.0, 60.0, 2.0, 30.0, 45.288455),
    (-20.0, -20.0, 5.0, 70.0, -38.322840),
    (0.0, 10.0, 0.5, 90.0, 5.336562),
    (35.0, 35.0, 0.5, 60.0, 37.982959),
    (30.0, 70.0, 3.0, 40.0, 37.841532),
    (10.0, 0.0, 8.0, 80.0, -8.363639),
    (-40.0, -30.0, 10.0, 60.0, -66.269055),
    (45.0, 45.0, 1.5, 10.0, 44.461382),
    (20.0, 50.0, 4.0, 55.0, 23.560716),
    (5.0, 5.0, 17.0, 95.0, -30.290331),
    (-50.0, -50.0, 0.5, 100.0, -49.787478),
    (50.0, 60.0, 1.0, 5.0, 52.059099),
    (15.0, -10.0, 2.5, 65.0, 3.647340),
    (28.0, 98.0, 0.7, 35.0, 44.872621),
    (33.0, 40.0, 6.0, 70.0, 34.922546),
    (-10.0, 25.0, 3.0, 50.0, -8.034616),
    (22.0, 22.0, 12.0, 20.0, 9.249034),
    (38.0, 65.0, 1.2, 25.0, 44.463318),
    (-30.0, 0.0, 0.9, 80.0, -22.119816),
    (18.0, 30.0, 15.0, 45.0, 2.305444),
    (0.0, 0.0, 1.0, 0.0, -2.256261),
    (26.5, 41.3, 2.2, 58.7, 29.630957),
    (12.25, 33.5, 0.8, 100.0, 21.228702),
];

#[test]
fn utci_is_that_of_pythermalcomfort() {
    for (air, radiant, wind, humidity, expected) in PYTHERMALCOMFORT {
        let found = utci(air, radiant, wind, humidity).unwrap_or_else(|error| panic!("{error}"));
        assert!(
            (found - expected).abs() < 2e-6,
            "{air} {radiant} {wind} {humidity}: {found} for {expected}"
        );
    }
}

#[test]
fn utci_names_what_is_out_of_range() {
    for (air, radiant, wind, humidity, input) in [
        (50.1, 50.0, 1.0, 10.0, Input::AirTemperature),
        (-50.1, -50.0, 1.0, 10.0, Input::AirTemperature),
        (f64::NAN, 20.0, 1.0, 50.0, Input::AirTemperature),
        (20.0, 90.1, 1.0, 50.0, Input::RadiantExcess),
        (20.0, -10.1, 1.0, 50.0, Input::RadiantExcess),
        (20.0, f64::NAN, 1.0, 50.0, Input::RadiantExcess),
        (20.0, 20.0, 0.49, 50.0, Input::WindSpeed),
        (20.0, 20.0, 17.1, 50.0, Input::WindSpeed),
        (20.0, 20.0, 1.0, 100.1, Input::RelativeHumidity),
        (20.0, 20.0, 1.0, -0.1, Input::RelativeHumidity),
        (40.0, 40.0, 1.0, 100.0, Input::VapourPressure),
    ] {
        let found = utci(air, radiant, wind, humidity);
        assert_eq!(found.map_err(|error| error.input), Err(input));
    }
    let message = utci(20.0, 20.0, 0.2, 50.0).err().map(|error| error.to_string());
    let expected = "the wind speed of 0.2 m/s is outside 0.5 to 17, where the formula holds";
    assert_eq!(message.as_deref(), Some(expected));
}

#[test]
fn saturated_vapour_has_the_pressures_of_tables() {
    // Pa, by Hardy's formula evaluated in Python with the published coefficients; steam tables have 611.2, 2339, 12352.
    for (temperature, expected) in [
        (-50.0, 6.437948773),
        (0.0, 611.2129107),
        (20.0, 2339.262396),
        (50.0, 12352.69),
    ] {
        let found = comfort::saturation_vapour_pressure(temperature);
        assert!(
            (found / expected - 1.0).abs() < 1e-8,
            "{temperature}: {found} for {expected}"
        );
    }
}

#[test]
fn a_person_is_as_wide_as_was_measured() {
    let area = |altitude, azimuth, posture| {
        projected_area(altitude, azimuth, posture).unwrap_or_else(|error| panic!("{error}"))
    };
    // VDI 3787 by hand: 0.308 at the horizon; at 30° the argument is 30° (1 − 900/48402) = 29.442°.
    assert!((area(0.0, None, Posture::Standing) - 0.308).abs() < 1e-12);
    assert!((area(30.0, None, Posture::Standing) - 0.308 * 29.442_171_8_f64.to_radians().cos()).abs() < 1e-8);
    assert!((area(90.0, None, Posture::Standing) - 0.0800).abs() < 1e-4);
    // At and between points of the table; symmetrical, and the same after a turn.
    assert_eq!(area(45.0, Some(90.0), Posture::Standing), 0.180);
    assert_eq!(area(90.0, Some(180.0), Posture::Seated), 0.177);
    assert_eq!(area(0.0, Some(0.0), Posture::Seated), 0.290);
    assert!((area(7.5, Some(7.5), Posture::Seated) - (0.290 + 0.324 + 0.292 + 0.328) / 4.0).abs() < 1e-12);
    for azimuth in [-30.0, 330.0, -330.0] {
        assert_eq!(
            area(20.0, Some(azimuth), Posture::Seated),
            area(20.0, Some(30.0), Posture::Seated)
        );
    }
    for step in 0..=90 {
        let altitude = f64::from(step);
        let mean = |posture| {
            (0..360)
                .map(|azimuth| area(altitude, Some(azimuth.into()), posture))
                .sum::<f64>()
                / 360.0
        };
        assert!(
            (mean(Posture::Standing) - area(altitude, None, Posture::Standing)).abs() < 0.02,
            "{altitude}"
        );
        assert!(
            (mean(Posture::Seated) - area(altitude, None, Posture::Seated)).abs() < 1e-4,
            "{altitude}"
        );
    }
    for (altitude, azimuth) in [
        (-0.1, None),
        (90.1, None),
        (f64::NAN, None),
        (10.0, Some(f64::NAN)),
        (10.0, Some(361.0)),
    ] {
        assert!(projected_area(altitude, azimuth, Posture::Seated).is_err());
    }
}

#[test]
fn the_mean_over_all_directions_is_a_quarter_of_the_surface() {
    // By Cauchy, a convex body shows a quarter of its surface on average; a person's effective radiation area has few
    // dents, so that the mean of f_p over the sphere is close to it. Here over the upper half, the lower being as the
    // upper.
    let mean = |posture| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for step in 0..900 {
            let altitude = (f64::from(step) + 0.5) / 10.0;
            let cosine = altitude.to_radians().cos();
            sum += cosine * projected_area(altitude, None, posture).unwrap_or(f64::NAN);
            weight += cosine;
        }
        sum / weight
    };
    let standing = mean(Posture::Standing);
    let seated = mean(Posture::Seated);
    assert!(
        (standing - 0.25).abs() < 0.02 && (seated - 0.25).abs() < 0.02,
        "{standing} {seated}"
    );
}

#[test]
fn weights_of_six_directions_sum_to_one() {
    for weights in [comfort::STANDING, comfort::SEATED, comfort::STANDING_ANYWHERE] {
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        assert!((comfort::from_six_directions(&[7.0; 6], &weights) - 7.0).abs() < 1e-12);
    }
    let up = comfort::from_six_directions(&[132.0, 0.0, 0.0, 0.0, 0.0, 0.0], &comfort::STANDING);
    assert!((up - 8.0).abs() < 1e-12);
    let sides = comfort::STANDING_ANYWHERE.map(|weight| (100.0 * weight).round());
    assert_eq!(sides, [6.0, 6.0, 22.0, 22.0, 22.0, 22.0]);
}

#[test]
fn black_surroundings_have_their_own_temperature() {
    for kelvin in [200.0_f64, 293.15, 330.0] {
        let longwave = 5.670_374_419e-8 * kelvin.powi(4);
        let absorbed = comfort::absorbed(0.0, longwave);
        let found = comfort::mean_radiant_temperature(absorbed).unwrap_or(f64::NAN);
        assert!((found - kelvin).abs() < 1e-9);
        assert!((sky_temperature(longwave).unwrap_or(f64::NAN) - kelvin).abs() < 1e-9);
    }
    // By hand: (0.7 · 100 + 0.97 · 400)/(0.97 · 5.670374419e−8) = 8.32687e9, to the power ¼: 302.079 K.
    let found = comfort::mean_radiant_temperature(comfort::absorbed(100.0, 400.0)).unwrap_or(f64::NAN);
    assert!((found - 302.079).abs() < 0.002, "{found}");
    assert_eq!(comfort::mean_radiant_temperature(0.0), Ok(0.0));
    for absorbed in [-1.0, f64::NAN, f64::INFINITY] {
        let refused = comfort::mean_radiant_temperature(absorbed).map_err(|error| error.input);
        assert_eq!(refused, Err(Input::Absorbed));
    }
    assert_eq!(CELSIUS_ZERO, 273.15);
    assert!(sky_temperature(-1.0).is_none() && sky_temperature(f64::NAN).is_none());
}
