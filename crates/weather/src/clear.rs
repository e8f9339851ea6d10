//! What sun and sky send on a clear day, where there is no weather file.
//!
//! P. Ineichen and R. Perez, "A new airmass independent formulation for the Linke turbidity coefficient", Solar Energy 73
//! (2002) 151–157, eqs. 4 to 8, without the enhancement factor exp(0.01 m^1.8), as pvlib's `clearsky.ineichen` has it by
//! default.

use crate::sky::air_mass;

/// Irradiances in W/m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clear {
    /// Of the sun, across its rays.
    pub direct_normal: f64,
    /// Of the sky, on a horizontal plane.
    pub diffuse_horizontal: f64,
}

/// The least and the greatest Linke turbidity: clean dry air is 1, mountains are about 2, temperate summers 3 to 4,
/// industrial haze 5 to 8.
pub const TURBIDITY: [f64; 2] = [1.0, 10.0];

/// A clear sky under a sun `altitude` degrees high, seen from `elevation` metres, through air of a Linke turbidity (see
/// [`TURBIDITY`]). `extraterrestrial` is the sun's irradiance above the atmosphere across its rays, W/m². Nothing comes
/// from a sun at or below the horizon.
///
/// ```
/// let clear = hemicube_weather::clear::sky(30.0, 100.0, 3.0, 1361.0);
/// assert!((clear.direct_normal - 791.37).abs() < 0.01 && (clear.diffuse_horizontal - 72.61).abs() < 0.01);
/// ```
pub fn sky(altitude: f64, elevation: f64, turbidity: f64, extraterrestrial: f64) -> Clear {
    if altitude.is_nan() || altitude <= 0.0 {
        return Clear {
            direct_normal: 0.0,
            diffuse_horizontal: 0.0,
        };
    }
    let sine = altitude.to_radians().sin();
    // Pressure of the standard atmosphere over that at sea level (ISO 2533).
    let pressure = (1.0 - 2.255_77e-5 * elevation).powf(5.255_88);
    let mass = air_mass(90.0 - altitude) * pressure;
    let [f1, f2] = [8000.0, 1250.0].map(|height: f64| (-elevation / height).exp());
    let [a1, a2] = [5.09e-5 * elevation + 0.868, 3.92e-5 * elevation + 0.0387];
    let global = a1 * extraterrestrial * sine * (-a2 * mass * (f1 + f2 * (turbidity - 1.0))).exp();
    let by_turbidity = (0.664 + 0.163 / f1) * extraterrestrial * (-0.09 * mass * (turbidity - 1.0)).exp();
    let by_global = global * (1.0 - (0.1 - 0.2 * (-turbidity).exp()) / (0.1 + 0.882 / f1)) / sine;
    let direct_normal = by_turbidity.min(by_global).max(0.0);
    Clear {
        direct_normal,
        diffuse_horizontal: (global - direct_normal * sine).max(0.0),
    }
}
