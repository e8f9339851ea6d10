//! Skies have the radiances of their formulas, and bring the irradiance that they are to bring.

use hemicube_weather::sky::{
    Cie, Error, Model, Patch, Perez, air_mass, extraterrestrial_normal, perez_parameters, radiances,
};
use proptest::prelude::*;
use std::f64::consts::PI;

/// A direction by azimuth and altitude in degrees.
fn direction(azimuth: f64, altitude: f64) -> [f64; 3] {
    let (sin_azimuth, cos_azimuth) = azimuth.to_radians().sin_cos();
    let (sin_altitude, cos_altitude) = altitude.to_radians().sin_cos();
    [cos_altitude * sin_azimuth, cos_altitude * cos_azimuth, sin_altitude]
}

fn cie(number: u8) -> Model {
    Model::Cie(Cie::new(number).unwrap_or_else(|error| panic!("{error}")))
}

fn perez(direct: f64, diffuse: f64, extraterrestrial: f64) -> Model {
    Model::Perez(Perez::new(direct, diffuse, extraterrestrial).unwrap_or_else(|error| panic!("{error}")))
}

/// A patch with its bounds in degrees: azimuths, then altitudes.
type Bounded = (Patch, [f64; 4]);

/// A patch between two azimuths and two altitudes, in degrees.
fn bounded(bounds: [f64; 4]) -> Bounded {
    let [west, east, low, high] = bounds;
    let width = (east - west).to_radians();
    let [sin_low, sin_high] = [low, high].map(|angle| angle.to_radians().sin());
    // The top patch is a cap round the zenith.
    let middle = if high == 90.0 { 90.0 } else { (low + high) / 2.0 };
    let patch = Patch {
        direction: direction((west + east) / 2.0, middle),
        solid_angle: width * (sin_high - sin_low),
        projected: width * (sin_high * sin_high - sin_low * sin_low) / 2.0,
    };
    (patch, bounds)
}

/// The 145 patches of P. Tregenza, "Subdivision of the sky hemisphere for luminance measurements" (1987).
fn tregenza() -> Vec<Bounded> {
    let mut patches = Vec::new();
    for (row, count) in [30, 30, 24, 24, 18, 12, 6].into_iter().enumerate() {
        let low = 12.0 * row as f64;
        let width = 360.0 / f64::from(count);
        for place in 0..count {
            let west = width * f64::from(place);
            patches.push(bounded([west, west + width, low, low + 12.0]));
        }
    }
    patches.push(bounded([0.0, 360.0, 84.0, 90.0]));
    patches
}

/// Patches of a grid of equal steps.
fn grid(columns: u32, rows: u32) -> Vec<Patch> {
    let (width, height) = (360.0 / f64::from(columns), 90.0 / f64::from(rows));
    let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| (f64::from(row), f64::from(column))));
    cells
        .map(|(row, column)| {
            let bounds = [
                column * width,
                (column + 1.0) * width,
                row * height,
                (row + 1.0) * height,
            ];
            let (mut patch, [west, east, low, high]) = bounded(bounds);
            patch.direction = direction((west + east) / 2.0, (low + high) / 2.0);
            patch
        })
        .collect()
}

/// What patches of some radiances bring to a horizontal plane.
fn irradiance(patches: &[Patch], radiances: &[f64]) -> f64 {
    patches
        .iter()
        .zip(radiances)
        .map(|(patch, radiance)| patch.projected * radiance)
        .sum()
}

fn all_models() -> Vec<Model> {
    let mut models: Vec<Model> = (1..=16).map(cie).collect();
    models.push(Model::Uniform);
    let skies = [
        (0.0, 100.0),
        (60.0, 200.0),
        (150.0, 250.0),
        (300.0, 250.0),
        (450.0, 200.0),
        (600.0, 150.0),
        (850.0, 60.0),
    ];
    models.extend(skies.map(|(direct, diffuse)| perez(direct, diffuse, 1366.0)));
    models
}

#[test]
fn patches_bring_the_irradiance() {
    let patches: Vec<Patch> = tregenza().into_iter().map(|(patch, _)| patch).collect();
    let whole: f64 = patches.iter().map(|patch| patch.projected).sum();
    assert!((whole - PI).abs() < 1e-12, "{whole}");
    for model in all_models() {
        for sun in [
            None,
            Some(direction(200.0, 35.0)),
            Some(direction(10.0, -5.0)),
            Some(direction(90.0, 0.5)),
        ] {
            let found = radiances(&model, sun, 123.0, &patches).unwrap_or_else(|error| panic!("{error}"));
            assert!((irradiance(&patches, &found) - 123.0).abs() < 1e-10, "{model:?}");
            assert!(found.iter().all(|&radiance| radiance >= 0.0), "{model:?}");
            // Half of the patches are to bring it all, too.
            let half = radiances(&model, sun, 123.0, &patches[..72]).unwrap_or_else(|error| panic!("{error}"));
            assert!((irradiance(&patches[..72], &half) - 123.0).abs() < 1e-10, "{model:?}");
        }
    }
    let none = radiances(&cie(12), None, 0.0, &patches);
    assert_eq!(none, Ok(vec![0.0; patches.len()]));
}

#[test]
fn uniform_skies_are_uniform() {
    let patches = grid(16, 8);
    for model in [Model::Uniform, cie(5)] {
        let found =
            radiances(&model, Some(direction(0.0, 40.0)), PI, &patches).unwrap_or_else(|error| panic!("{error}"));
        assert!(found.iter().all(|radiance| (radiance - 1.0).abs() < 1e-12));
        assert_eq!(model.relative(direction(77.0, 3.0), None), 1.0);
    }
}

#[test]
fn traditional_overcast_sky_is_three_times_as_bright_at_the_zenith() {
    let model = cie(16);
    assert!(!model.needs_sun());
    assert_eq!(
        model.relative([0.0, 0.0, 1.0], None) / model.relative([0.0, 1.0, 0.0], None),
        3.0
    );
    assert!((model.relative(direction(5.0, 30.0), None) - 2.0 / 3.0).abs() < 1e-15);
    // Its horizontal irradiance is 7π/9 of the radiance at the zenith (Moon and Spencer 1942).
    let patches = grid(8, 90);
    let found = radiances(&model, None, 7.0 * PI / 9.0, &patches).unwrap_or_else(|error| panic!("{error}"));
    let top = found.last().copied().unwrap_or(f64::NAN);
    assert!((top - 1.0).abs() < 1e-3, "{top}");
}

#[test]
fn standard_skies_are_those_of_the_formula() {
    // Under a sun at a zenith angle of 40°: at the sun; at 70° from the zenith and 30° from the sun; at 70° and 110°.
    // Evaluated in Python: f(χ) φ(Z) / (f(Zs) φ(0)) of the module's head, with the table's parameters typed anew.
    let expected = [
        (1, [0.87197472, 0.50786588, 0.50786588]),
        (4, [1.71728333, 0.8486781, 0.43491786]),
        (11, [5.7180112, 2.61394109, 0.78134745]),
        (12, [5.88805395, 3.06822883, 0.91714109]),
        (15, [7.57110548, 3.86621005, 0.50686615]),
    ];
    let sun = direction(150.0, 50.0);
    let places = [sun, direction(150.0, 20.0), direction(330.0, 20.0)];
    for (number, ratios) in expected {
        for (place, ratio) in places.into_iter().zip(ratios) {
            let found = cie(number).relative(place, Some(sun));
            assert!((found - ratio).abs() < 1e-8, "type {number}: {found} for {ratio}");
        }
    }
    for number in 1..=16 {
        let zenith = cie(number).relative([0.0, 0.0, 5.0], Some(sun));
        assert!((zenith - 1.0).abs() < 1e-12, "type {number}: {zenith}");
    }
    // Type 1 at the horizon, where b / cos Z is −∞: 1 / (1 + 4 exp(−0.7)) = 0.33485, the 1:3 of overcast skies.
    assert!((cie(1).relative([1.0, 0.0, 0.0], None) - 0.33485).abs() < 1e-5);
    // Type 12 has a gradation of 1 there: the exponential is 0.
    assert!(cie(12).relative([1.0, 0.0, 0.0], Some(sun)) > 0.0);
}

#[test]
fn gradations_and_indicatrices_are_monotone() {
    let along = |model: &Model, sun, azimuth: f64| -> Vec<f64> {
        (0..=90)
            .map(|altitude| model.relative(direction(azimuth, altitude.into()), sun))
            .collect()
    };
    for number in [1, 3, 16] {
        let found = along(&cie(number), None, 0.0);
        assert!(
            found.windows(2).all(|pair| pair[0] <= pair[1]),
            "type {number}: darker towards the zenith"
        );
    }
    for number in 9..=15 {
        let found = along(&cie(number), None, 0.0);
        assert!(
            found.windows(2).all(|pair| pair[0] >= pair[1]),
            "type {number}: brighter towards the zenith"
        );
    }
    // Round the horizon away from the sun, up to 90° from it, where cos² rises again.
    for number in [2, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15] {
        assert!(cie(number).needs_sun());
        let sun = direction(0.0, 10.0);
        let round = |angle: i32| cie(number).relative(direction(angle.into(), 10.0), Some(sun));
        assert!((0..90).all(|angle| round(angle) > round(angle + 1)), "type {number}");
    }
}

#[test]
fn perez_parameters_are_those_of_gendaylit() {
    // The altitude of the sun, ε and Δ; a to e by Radiance's gendaylit 2.5, the coefficients of its `skyfunc`:
    // `gendaylit -ang ALTITUDE 0 -P EPSILON DELTA -O 1`. One for each bin.
    let expected = [
        (60.0, 1.03, 0.25, [0.962320, -0.464423, 1.082694, -0.690576, -0.042502]),
        (20.0, 1.15, 0.30, [-1.338100, -0.998818, 9.080633, -2.695337, 0.121747]),
        (45.0, 1.40, 0.45, [-0.889174, -1.473269, 9.797766, -2.965602, 0.102206]),
        (30.0, 1.70, 0.35, [-1.077874, -0.952437, 11.475307, -3.057705, 0.078025]),
        (55.0, 2.30, 0.28, [-1.120161, -0.951763, 13.283412, -3.132981, 0.009491]),
        (35.0, 3.50, 0.20, [-0.896575, -0.345998, 13.060946, -3.417024, 0.285650]),
        (25.0, 5.30, 0.12, [-0.985451, -0.219813, 13.216998, -3.889353, 0.522382]),
        (70.0, 8.00, 0.08, [-0.995807, -0.222330, 23.858223, -6.004420, 1.439941]),
    ];
    for (altitude, clearness, brightness, parameters) in expected {
        let found = perez_parameters(clearness, brightness, (90.0_f64 - altitude).to_radians());
        for (found, expected) in found.into_iter().zip(parameters) {
            // gendaylit keeps its coefficients in f32.
            assert!((found - expected).abs() < 1e-5, "ε {clearness}: {found} for {expected}");
        }
    }
}

#[test]
fn perez_skies_are_those_of_the_formula() {
    // By hand, and in Python: a direct normal of 700, a diffuse horizontal of 120 and an extraterrestrial irradiance of
    // 1350 W/m² with the sun 30° from the zenith give ε = ((120 + 700)/120 + 1.041 · 0.523599³)/(1 + 1.041 · 0.523599³)
    // = 6.07497, the seventh bin; an air mass of 1.153992 gives Δ = 0.102577.
    let sky = Perez::new(700.0, 120.0, 1350.0).unwrap_or_else(|error| panic!("{error}"));
    let zenith = 30.0_f64.to_radians();
    assert!((sky.clearness(zenith) - 6.0749658238).abs() < 1e-9);
    assert!((sky.brightness(zenith) - 0.1025770874).abs() < 1e-9);
    let parameters = [-0.9649008380, -0.2149617895, 16.4070390855, -3.9332142248, 0.6756887969];
    for (found, expected) in sky.parameters(zenith).into_iter().zip(parameters) {
        assert!((found - expected).abs() < 1e-8, "{found} for {expected}");
    }
    // Zenith angle, angle from the sun, l; in the vertical plane of the sun.
    let sun = direction(90.0, 60.0);
    let model = Model::Perez(sky);
    for (place, expected) in [
        ([0.0, 0.0, 1.0], 0.798058381518),
        (direction(90.0, 30.0), 1.339859314313),
        (direction(270.0, 30.0), 0.384943087462),
        (direction(270.0, 5.0), 1.034503196459),
    ] {
        let found = model.relative(place, Some(sun));
        assert!((found - expected).abs() < 1e-8, "{found} for {expected}");
    }
    // No direct irradiance is the first bin's ε = 1.
    let overcast = Perez::new(0.0, 100.0, 1366.0).map(|sky| sky.clearness(0.7));
    assert_eq!(overcast, Ok(1.0));
}

#[test]
fn air_masses_and_extraterrestrial_irradiances_are_those_of_pvlib() {
    // `pvlib.atmosphere.get_relative_airmass(ZENITH, "kastenyoung1989")`, pvlib 0.16.1.
    for (zenith, expected) in [
        (0.0, 0.99971199186),
        (30.0, 1.15399223336),
        (80.0, 5.58603587985),
        (88.0, 19.4332451076),
    ] {
        assert!((air_mass(zenith) - expected).abs() < 1e-9, "{zenith}");
    }
    assert!(air_mass(90.0) > 37.0 && air_mass(120.0) == air_mass(90.0));
    // `pvlib.irradiance.get_extra_radiation(DAY, method="spencer")`.
    for (day, expected) in [
        (1, 1413.981805),
        (80, 1376.892361),
        (172, 1321.623593),
        (355, 1412.708564),
    ] {
        assert!((extraterrestrial_normal(day) - expected).abs() < 1e-5, "{day}");
    }
}

#[test]
fn a_sun_below_the_horizon_leaves_the_gradation() {
    let down = [
        None,
        Some(direction(30.0, -0.1)),
        Some([1.0, 0.0, 0.0]),
        Some([0.0; 3]),
        Some([f64::NAN; 3]),
    ];
    for model in all_models() {
        for azimuth in [0.0, 90.0, 200.0] {
            let place = direction(azimuth, 33.0);
            let found = down.map(|sun| model.relative(place, sun));
            assert!(
                found.iter().all(|&radiance| radiance == found[0] && radiance > 0.0),
                "{model:?}: {found:?}"
            );
            if matches!(model, Model::Perez(_)) {
                assert_eq!(found[0], 1.0);
            }
        }
    }
    // Below the horizon is no sky, and what is no direction has no radiance.
    assert_eq!(cie(12).relative([1.0, 0.0, -0.1], None), 0.0);
    assert!(cie(12).relative([0.0; 3], None).is_nan() && cie(12).relative([f64::INFINITY, 0.0, 1.0], None).is_nan());
}

#[test]
fn wrong_input_is_refused() {
    assert_eq!(Cie::new(0), Err(Error::Type(0)));
    assert_eq!(Cie::new(17), Err(Error::Type(17)));
    for (direct, diffuse, outside) in [
        (-1.0, 100.0, 1366.0),
        (f64::NAN, 100.0, 1366.0),
        (100.0, 0.0, 1366.0),
        (100.0, f64::INFINITY, 1366.0),
        (100.0, 100.0, 0.0),
    ] {
        assert!(matches!(
            Perez::new(direct, diffuse, outside),
            Err(Error::Irradiance { .. })
        ));
    }
    let good = grid(4, 2);
    assert!(matches!(
        radiances(&Model::Uniform, None, -1.0, &good),
        Err(Error::Irradiance { .. })
    ));
    assert!(matches!(
        radiances(&Model::Uniform, None, f64::NAN, &good),
        Err(Error::Irradiance { .. })
    ));
    assert_eq!(
        radiances(&cie(12), Some([0.0; 3]), 1.0, &good),
        Err(Error::Sun([0.0; 3]))
    );
    for (direction, solid_angle, projected) in [
        ([0.0; 3], 1.0, 0.5),
        ([f64::NAN, 0.0, 1.0], 1.0, 0.5),
        ([0.0, 0.0, 1.0], 0.0, 0.0),
        ([0.0, 0.0, 1.0], 7.0, 0.5),
        ([0.0, 0.0, 1.0], 1.0, 1.1),
        ([0.0, 0.0, 1.0], 1.0, f64::NAN),
    ] {
        let patch = Patch {
            direction,
            solid_angle,
            projected,
        };
        let refused = radiances(&Model::Uniform, None, 1.0, &[good[0], patch]);
        assert!(
            matches!(refused, Err(Error::Patch { index: 1, .. })),
            "{patch:?}: {refused:?}"
        );
    }
    let below = Patch {
        direction: [0.0, 0.0, -1.0],
        solid_angle: 0.1,
        projected: 0.05,
    };
    assert_eq!(radiances(&Model::Uniform, None, 1.0, &[below]), Err(Error::Dark));
    assert_eq!(radiances(&Model::Uniform, None, 1.0, &[]), Err(Error::Dark));
    assert_eq!(radiances(&Model::Uniform, None, 0.0, &[]), Ok(Vec::new()));
}

/// The mean of a model over a patch by 16 × 16 points of equal solid angle.
fn fine_mean(model: &Model, sun: [f64; 3], [west, east, low, high]: [f64; 4]) -> f64 {
    let [sin_low, sin_high] = [low, high].map(|angle: f64| angle.to_radians().sin());
    let mut sum = 0.0;
    for i in 0..16 {
        for j in 0..16 {
            let sine = sin_low + (sin_high - sin_low) * (f64::from(i) + 0.5) / 16.0;
            let azimuth = west + (east - west) * (f64::from(j) + 0.5) / 16.0;
            sum += model.relative(direction(azimuth, sine.asin().to_degrees()), Some(sun));
        }
    }
    sum / 256.0
}

#[test]
fn means_over_patches_are_as_near_as_the_documentation_says() {
    let patches = tregenza();
    let bare: Vec<Patch> = patches.iter().map(|&(patch, _)| patch).collect();
    let (mut by_samples, mut by_centre): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    for model in [
        cie(1),
        cie(12),
        cie(13),
        cie(15),
        perez(850.0, 60.0, 1366.0),
        perez(450.0, 200.0, 1366.0),
    ] {
        for sun in [
            direction(186.0, 6.0),
            direction(183.0, 31.0),
            direction(100.0, 55.0),
            direction(0.0, 88.0),
        ] {
            let found = radiances(&model, Some(sun), 100.0, &bare).unwrap_or_else(|error| panic!("{error}"));
            let fine: Vec<f64> = patches
                .iter()
                .map(|&(_, bounds)| fine_mean(&model, sun, bounds))
                .collect();
            let scale = 100.0 / irradiance(&bare, &fine);
            let centre: Vec<f64> = bare
                .iter()
                .map(|patch| model.relative(patch.direction, Some(sun)))
                .collect();
            let centre_scale = 100.0 / irradiance(&bare, &centre);
            for i in 0..bare.len() {
                by_samples.push((found[i] / (fine[i] * scale) - 1.0).abs());
                by_centre.push((centre[i] * centre_scale / (fine[i] * scale) - 1.0).abs());
            }
        }
    }
    let worst = |errors: &mut Vec<f64>| {
        errors.sort_by(f64::total_cmp);
        [
            errors[errors.len() / 2],
            errors[errors.len() * 99 / 100],
            errors[errors.len() - 1],
        ]
    };
    let (samples, centres) = (worst(&mut by_samples), worst(&mut by_centre));
    assert!(
        samples[0] < 0.002 && samples[1] < 0.016 && samples[2] < 0.034,
        "{samples:?}"
    );
    assert!(
        centres[0] > 0.007 && centres[1] > 0.03 && centres[2] > 0.25,
        "{samples:?} {centres:?}"
    );
}

proptest! {
    #[test]
    fn relative_radiances_are_finite_and_not_negative(
        azimuth in 0.0..360.0, altitude in 0.0..90.0,
        sun_azimuth in 0.0..360.0, sun_altitude in -10.0..90.0,
        direct in 0.0..1400.0, diffuse in 1e-3..1400.0, number in 1_u8..=16,
    ) {
        let sun = Some(direction(sun_azimuth, sun_altitude));
        for model in [cie(number), perez(direct, diffuse, 1366.0)] {
            let found = model.relative(direction(azimuth, altitude), sun);
            prop_assert!(found.is_finite() && found >= 0.0, "{model:?}: {found}");
        }
    }
}
