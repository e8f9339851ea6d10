//! Weights of mirrors and panes: constant, by a table of angles, or by Fresnel's equations.
//!
//! Of unpolarised light from air (index 1) to an index n, at the angles θ and θ' with sin θ = n sin θ':
//!
//! ```text
//! r⊥ = ((cos θ − n cos θ') / (cos θ + n cos θ'))²        r∥ = ((n cos θ − cos θ') / (n cos θ + cos θ'))²
//! one face      ρs = (r⊥ + r∥) / 2,  τ = 0
//! a pane        a = exp(−K d / cos θ'), of either polarisation
//!               τ = a (1 − r)² / (1 − r² a²),  ρs = r (1 + a τ);  of both the means
//! ```
//!
//! (Fresnel 1823 in Born & Wolf 1999, *Principles of Optics*, § 1.5.2; Stokes 1862, "On the intensity of the light
//! reflected from or transmitted through a pile of plates"; Duffie & Beckman 2013, *Solar Engineering of Thermal
//! Processes*, § 5.1 to 5.3.) A pane has two faces and all reflections between them, added up as powers: its thickness
//! d is many wavelengths. K is its extinction coefficient, one over the unit of d. It bends nothing and shifts nothing.

use super::Optics;
use serde::Serialize;
use serde_json::Value;

/// Angles from which hemispherical means are taken.
const MEAN_OF: u32 = 4096;
/// The largest index of refraction: beyond any transparent solid.
pub const INDEX_MAX: f64 = 10.0;
/// Most angles in a table.
pub const ANGLES_MAX: usize = 1000;

/// Division of arriving light by the angle from the normal.
#[derive(Clone, Debug, PartialEq)]
pub enum Law {
    /// At all angles.
    Constant(Optics),
    /// The face of a dielectric that lets nothing through.
    Face {
        /// Index of refraction, from 1 to 10.
        index: f64,
    },
    /// A plane-parallel pane in air.
    Pane {
        /// Index of refraction, from 1 to 10.
        index: f64,
        /// K d, thickness times extinction coefficient, from 0 on.
        depth: f64,
    },
    /// Degrees from the normal, ascending from 0 to 90, and the optics there; linear between them, constant beyond.
    Table(Vec<(f64, Optics)>),
}

impl From<Optics> for Law {
    fn from(optics: Optics) -> Self {
        Self::Constant(optics)
    }
}

/// Why there is no such law.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LawError {
    /// ρs or τ or both out of range.
    #[error("ρs {} and τ {}, and each and both together are from 0 to 1", .0.specular, .0.transmittance)]
    Range(Optics),
    /// An index of refraction out of range.
    #[error("the index {0}, and an index of refraction is from 1 to {INDEX_MAX}")]
    Index(f64),
    /// A thickness or an extinction coefficient below 0.
    #[error("{0} for thickness times extinction, which is a number from 0 on")]
    Depth(f64),
    /// Angles that do not ascend from 0 to 90.
    #[error("a table of angles that do not ascend within 0 to 90 degrees, or of more than {ANGLES_MAX}")]
    Angles,
}

impl Law {
    /// Returns whether all values are in range.
    ///
    /// # Errors
    /// When one is not.
    pub fn check(&self) -> Result<(), LawError> {
        let index = |index: f64| {
            let is_index = (1.0..=INDEX_MAX).contains(&index);
            if is_index { Ok(()) } else { Err(LawError::Index(index)) }
        };
        let optics = |optics: &Optics| {
            let is_valid = optics.is_valid();
            if is_valid {
                Ok(())
            } else {
                Err(LawError::Range(*optics))
            }
        };
        match self {
            Self::Constant(constant) => optics(constant),
            Self::Face { index: n } => index(*n),
            Self::Pane { index: n, depth } => {
                let is_depth = *depth >= 0.0 && depth.is_finite();
                if is_depth {
                    index(*n)
                } else {
                    Err(LawError::Depth(*depth))
                }
            }
            Self::Table(rows) => {
                let ascend = rows.windows(2).all(|pair| pair[0].0 < pair[1].0);
                let within = rows.iter().all(|(degrees, _)| (0.0..=90.0).contains(degrees));
                if rows.is_empty() || rows.len() > ANGLES_MAX || !ascend || !within {
                    return Err(LawError::Angles);
                }
                rows.iter().try_for_each(|(_, at)| optics(at))
            }
        }
    }

    /// The optics at an angle from the normal, by its cosine from 0 to 1.
    ///
    /// ```
    /// use hemicube::portal::Law;
    ///
    /// // Glass reflects ((n − 1) / (n + 1))² = 4 % at normal incidence, a face of it; a clear pane 2 r / (1 + r).
    /// let face = Law::Face { index: 1.5 }.at(1.0);
    /// assert!((face.specular - 0.04).abs() < 1e-12 && face.transmittance == 0.0);
    /// let pane = Law::Pane { index: 1.5, depth: 0.0 }.at(1.0);
    /// assert!((pane.specular - 0.08 / 1.04).abs() < 1e-12 && (pane.passed() - 1.0).abs() < 1e-12);
    /// ```
    pub fn at(&self, cosine: f64) -> Optics {
        let cosine = cosine.clamp(0.0, 1.0);
        match self {
            Self::Constant(optics) => *optics,
            Self::Face { index } => {
                let (r, _) = faces(*index, cosine);
                Optics {
                    specular: 0.5 * (r[0] + r[1]),
                    transmittance: 0.0,
                }
            }
            Self::Pane { index, depth } => {
                let (r, refracted) = faces(*index, cosine);
                // A ray within the glass is never along it: cos θ' ≥ √(1 − 1/n²); n = 1 is no pane at all.
                let a = if *depth == 0.0 { 1.0 } else { (-depth / refracted).exp() };
                let of = r.map(|r| {
                    let left = 1.0 - r * r * a * a;
                    // Along the pane both faces reflect all.
                    let through = if left > 0.0 { a * (1.0 - r).powi(2) / left } else { 0.0 };
                    [r * (1.0 + a * through), through]
                });
                Optics {
                    specular: (0.5 * (of[0][0] + of[1][0])).min(1.0),
                    transmittance: 0.5 * (of[0][1] + of[1][1]),
                }
                .within()
            }
            Self::Table(rows) => {
                let degrees = cosine.acos().to_degrees();
                let above = rows.partition_point(|(at, _)| *at <= degrees);
                match (above.checked_sub(1).and_then(|below| rows.get(below)), rows.get(above)) {
                    (Some((from, a)), Some((to, b))) => {
                        let t = (degrees - from) / (to - from);
                        Optics {
                            specular: a.specular + (b.specular - a.specular) * t,
                            transmittance: a.transmittance + (b.transmittance - a.transmittance) * t,
                        }
                    }
                    (Some((_, only)), None) | (None, Some((_, only))) => *only,
                    (None, None) => Optics::default(),
                }
            }
        }
    }

    /// The hemispherical mean, of light that arrives from everywhere alike: ∫ ρ(θ) 2 cos θ d(cos θ).
    pub fn mean(&self) -> Optics {
        if let Self::Constant(optics) = self {
            return *optics;
        }
        let mut sum = Optics::default();
        // Evenly by cos² θ, at the middles of the strata.
        for stratum in 0..MEAN_OF {
            let cosine = ((f64::from(stratum) + 0.5) / f64::from(MEAN_OF)).sqrt();
            let at = self.at(cosine);
            sum.specular += at.specular;
            sum.transmittance += at.transmittance;
        }
        let count = f64::from(MEAN_OF);
        Optics {
            specular: sum.specular / count,
            transmittance: sum.transmittance / count,
        }
        .within()
    }

    /// Returns whether it hands on anything at some angle.
    pub fn is_portal(&self) -> bool {
        match self {
            Self::Constant(optics) => optics.is_portal(),
            Self::Face { index } => *index > 1.0,
            Self::Pane { .. } => true,
            Self::Table(rows) => rows.iter().any(|(_, optics)| optics.is_portal()),
        }
    }

    /// Returns whether it depends on the angle.
    pub fn varies(&self) -> bool {
        !matches!(self, Self::Constant(_))
    }

    /// The law of a manifest's record.
    pub(super) fn of_record(record: &Value) -> Option<Self> {
        if let Some(rows) = record.get("angles") {
            let row = |row: &Value| {
                let number = |at: usize| row.get(at).and_then(Value::as_f64);
                let optics = Optics {
                    transmittance: number(1)?,
                    specular: number(2)?,
                };
                Some((number(0)?, optics))
            };
            return rows.as_array()?.iter().map(row).collect::<Option<_>>().map(Self::Table);
        }
        let number = |name: &str| record.get(name).and_then(Value::as_f64);
        Some(match (number("index"), number("depth")) {
            (Some(index), Some(depth)) => Self::Pane { index, depth },
            (Some(index), None) => Self::Face { index },
            (None, _) => Self::Constant(Optics {
                specular: number("specular")?,
                transmittance: number("transmittance")?,
            }),
        })
    }

    /// For manifests.
    pub(super) fn record(&self) -> LawRecord {
        let mut record = LawRecord {
            optics: self.mean(),
            index: None,
            depth: None,
            angles: Vec::new(),
        };
        match self {
            Self::Constant(_) => {}
            Self::Face { index } => record.index = Some(*index),
            Self::Pane { index, depth } => (record.index, record.depth) = (Some(*index), Some(*depth)),
            Self::Table(rows) => {
                let row = |(degrees, at): &(f64, Optics)| [*degrees, at.transmittance, at.specular];
                record.angles = rows.iter().map(row).collect();
            }
        }
        record
    }
}

/// A law in a manifest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LawRecord {
    /// ρs and τ, hemispherical means where they depend on the angle.
    #[serde(flatten)]
    pub optics: Optics,
    /// Index of refraction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index: Option<f64>,
    /// Of a pane: thickness times extinction coefficient.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<f64>,
    /// Degrees, τ, ρs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub angles: Vec<[f64; 3]>,
}

/// r⊥ and r∥ of a face from air to `index`, and cos θ'.
fn faces(index: f64, cosine: f64) -> ([f64; 2], f64) {
    let refracted = (1.0 - (1.0 - cosine * cosine) / (index * index)).max(0.0).sqrt();
    let ratio = |a: f64, b: f64| {
        let sum = a + b;
        // Without an index nothing is reflected, not even along the face.
        if sum > 0.0 { ((a - b) / sum).powi(2) } else { 0.0 }
    };
    (
        [ratio(cosine, index * refracted), ratio(index * cosine, refracted)],
        refracted,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const GLASS: Law = Law::Face { index: 1.5 };

    #[test]
    fn a_face_follows_fresnel() {
        for index in [1.0, 1.33, 1.5, 2.4f64] {
            let face = Law::Face { index };
            let normal = ((index - 1.0) / (index + 1.0)).powi(2);
            assert!((face.at(1.0).specular - normal).abs() < 1e-14);
            // At Brewster's angle, tan θ = n, only the perpendicular polarisation is left: ((n² − 1) / (n² + 1))².
            let brewster = (1.0 / (1.0 + index * index)).sqrt();
            let half = 0.5 * ((index * index - 1.0) / (index * index + 1.0)).powi(2);
            assert!((face.at(brewster).specular - half).abs() < 1e-14);
        }
        assert!((GLASS.at(0.0).specular - 1.0).abs() < 1e-14);
    }

    #[test]
    fn a_pane_has_its_limits() {
        let clear = Law::Pane { index: 1.5, depth: 0.0 };
        let (face, pane) = (GLASS.at(1.0).specular, clear.at(1.0));
        // Both faces and all between: 2 r / (1 + r) and (1 − r) / (1 + r).
        assert!((pane.specular - 2.0 * face / (1.0 + face)).abs() < 1e-14);
        assert!((pane.transmittance - (1.0 - face) / (1.0 + face)).abs() < 1e-14);
        for step in 0..=90 {
            let at = clear.at(f64::from(step).to_radians().cos());
            assert!(
                (at.passed() - 1.0).abs() < 1e-12,
                "clear glass absorbs nothing at {step}°: {at:?}"
            );
        }
        // So thick that nothing gets through, it is one face.
        let black = Law::Pane { index: 1.5, depth: 1e3 };
        for cosine in [0.1, 0.5, 1.0] {
            let at = black.at(cosine);
            assert!(at.transmittance == 0.0 && (at.specular - GLASS.at(cosine).specular).abs() < 1e-14);
        }
        // No index: Beer's law alone.
        let air = Law::Pane { index: 1.0, depth: 0.3 };
        assert!((air.at(0.5).transmittance - (-0.6f64).exp()).abs() < 1e-14 && air.at(0.5).specular == 0.0);
        assert!(Law::Pane { index: 1.0, depth: 0.0 }.at(0.0).transmittance == 1.0);
    }

    /// ∫ ρ 2 cos θ d(cos θ) by Simpson's rule over the cosine.
    fn quadrature(law: &Law, of: fn(&Optics) -> f64) -> f64 {
        let steps = 200_000;
        let h = 1.0 / f64::from(steps);
        let value = |step: i32| {
            let cosine = f64::from(step) * h;
            2.0 * cosine * of(&law.at(cosine))
        };
        let weight = |step: i32| match step {
            0 => 1.0,
            step if step == steps => 1.0,
            step if step % 2 == 1 => 4.0,
            _ => 2.0,
        };
        (0..=steps).map(|step| weight(step) * value(step)).sum::<f64>() * h / 3.0
    }

    #[test]
    fn means_are_of_the_hemisphere() {
        // Of an index of 1.5: 0.0918 (Walsh 1926, in Judd 1942, "Fresnel reflection of diffusely incident light").
        assert!((GLASS.mean().specular - 0.0918).abs() < 1e-4, "{:?}", GLASS.mean());
        let table = Law::Table(vec![
            (
                0.0,
                Optics {
                    specular: 0.1,
                    transmittance: 0.7,
                },
            ),
            (
                60.0,
                Optics {
                    specular: 0.2,
                    transmittance: 0.6,
                },
            ),
            (
                90.0,
                Optics {
                    specular: 1.0,
                    transmittance: 0.0,
                },
            ),
        ]);
        for law in [
            GLASS,
            Law::Pane {
                index: 1.52,
                depth: 0.1,
            },
            table,
        ] {
            let mean = law.mean();
            for (found, of) in [
                (mean.specular, (|o| o.specular) as fn(&Optics) -> f64),
                (mean.transmittance, |o| o.transmittance),
            ] {
                let exact = quadrature(&law, of);
                assert!((found - exact).abs() < 1e-5, "{law:?}: {found} and {exact}");
            }
        }
    }

    #[test]
    fn tables_are_linear_and_wrong_ones_refused() {
        let row = |degrees, transmittance| {
            let optics = Optics {
                specular: 0.1,
                transmittance,
            };
            (degrees, optics)
        };
        let table = Law::Table(vec![row(0.0, 0.7), row(60.0, 0.5)]);
        assert!((table.at(30f64.to_radians().cos()).transmittance - 0.6).abs() < 1e-12);
        assert!((table.at(0.0).transmittance - 0.5).abs() < 1e-12 && table.check().is_ok());
        for wrong in [
            Law::Table(Vec::new()),
            Law::Table(vec![row(10.0, 0.5), row(10.0, 0.4)]),
            Law::Table(vec![row(0.0, 0.95)]),
            Law::Table(vec![row(0.0, 0.5), row(91.0, 0.4)]),
            Law::Face { index: 0.9 },
            Law::Face { index: f64::NAN },
            Law::Pane {
                index: 1.5,
                depth: -1.0,
            },
        ] {
            assert!(wrong.check().is_err(), "{wrong:?}");
        }
    }
}
