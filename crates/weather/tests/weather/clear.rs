//! Clear skies are those of pvlib.

use hemicube_weather::clear::sky;

/// Altitude (degrees), turbidity, elevation (m), then direct normal and diffuse horizontal irradiance (W/m²) by pvlib
/// 0.13: `clearsky.ineichen(90 - altitude, absolute_airmass, turbidity, elevation, dni_extra=1361)`.
const PVLIB: [[f64; 5]; 6] = [
    [5.0, 3.0, 0.0, 176.087_671_16, 15.772_940_97],
    [15.0, 2.0, 0.0, 798.601_725_04, 20.924_015_18],
    [30.0, 3.0, 100.0, 791.368_223_43, 72.606_213_61],
    [45.0, 4.5, 500.0, 749.525_621_47, 136.357_366_44],
    [60.0, 3.0, 1500.0, 984.885_400_43, 120.152_099_10],
    [80.0, 6.0, 0.0, 712.829_600_66, 217.107_379_08],
];

#[test]
fn clear_skies_are_those_of_pvlib() {
    for [altitude, turbidity, elevation, direct, diffuse] in PVLIB {
        let found = sky(altitude, elevation, turbidity, 1361.0);
        assert!(
            (found.direct_normal - direct).abs() < 1e-3 * direct,
            "{altitude}: {found:?}"
        );
        assert!(
            (found.diffuse_horizontal - diffuse).abs() < 2e-3 * diffuse,
            "{altitude}: {found:?}"
        );
    }
    for altitude in [0.0, -10.0, f64::NAN] {
        let found = sky(altitude, 0.0, 3.0, 1361.0);
        assert_eq!((found.direct_normal, found.diffuse_horizontal), (0.0, 0.0));
    }
}
