//! What the sky and the weather bring to a scene: where the sun is, how the diffuse sky's radiance is spread, hours of
//! a weather file, and what people outdoors feel of it.
//!
//! 1. [`sun`]: azimuth and altitude of the sun at a place and time (SPA, Reda and Andreas 2004), times of ISO 8601.
//! 2. [`sky`]: relative radiance by the CIE standard general skies and by Perez, Seals and Michalsky (1993), and
//!    radiances of patches in W/(m² sr) that sum to a given diffuse horizontal irradiance.
//! 3. [`epw`]: the hours of an EnergyPlus weather file (`.epw`), with `None` where a value is missing.
//! 4. [`clear`]: direct and diffuse irradiance of a clear day by its turbidity (Ineichen and Perez 2002).
//! 5. [`comfort`]: UTCI, mean radiant temperature, projected area factors.
//!
//! Directions are (east, north, up). Azimuths are degrees clockwise from north, altitudes degrees above the horizon.
//! Every function is pure but [`epw::Epw::read`], which reads one file. Nothing panics on bad input: errors are values.
//!
//! ```
//! use hemicube_weather::sky::{self, Cie, Model, Patch};
//! use hemicube_weather::sun::{self, Place, Time};
//!
//! let berlin = Place { latitude: 52.52, longitude: 13.405, elevation: 34.0 };
//! let noon: Time = "2026-06-21T12:00+02:00".parse()?;
//! let sun = sun::position(&berlin, &noon)?;
//! assert!((sun.altitude - 58.15).abs() < 0.01 && (sun.azimuth - 149.36).abs() < 0.01);
//!
//! // One patch: the whole hemisphere, with π sr of projected solid angle.
//! let dome = Patch {
//!     direction: [0.0, 0.0, 1.0],
//!     solid_angle: std::f64::consts::TAU,
//!     projected: std::f64::consts::PI,
//! };
//! let clear = Model::Cie(Cie::new(12)?);
//! let radiances = sky::radiances(&clear, Some(sun.direction()), 100.0, &[dome])?;
//! assert!((radiances[0] * std::f64::consts::PI - 100.0).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

pub mod clear;
pub mod comfort;
pub mod epw;
pub mod sky;
pub mod sun;
