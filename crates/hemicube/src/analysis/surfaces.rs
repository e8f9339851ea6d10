//! Heat by surface: what each object, material or face of a scene gives off, and how warm it is.
//!
//! ```text
//! Q = Σ A (B − G)          of mirrors and panes Σ A (B − (1 − ρs − τ) G); the mean of x over a surface: Σ A x / Σ A
//! ```
//!
//! Over all surfaces Q adds up to what the surroundings receive, plus the matrix's error Σᵢⱼ (AᵢFᵢⱼ − AⱼFⱼᵢ) Bᵢ: with
//! B − G = Σⱼ Fᵢⱼ (Bᵢ − Bⱼ) + escapedᵢ (Bᵢ − H) nothing else is left, not even the residual of the iteration
//! (`solve.rs`). [`HeatBalance::error`] is that sum.

use super::zones::{GroupBy, zones_of};
use crate::solve::Solution;
use crate::store::{PatchTable, RowTable};
use serde::Serialize;

/// Heat of a surface, in W where the scene's unit is the metre.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SurfaceHeat {
    /// The name of its object or material, or the number of its face from 0.
    pub name: String,
    /// Number of its patches.
    pub patches: u32,
    /// In the square of the scene's unit.
    pub area: f64,
    /// Net heat in W, positive where the surface gives it off.
    pub heat: f64,
    /// Mean net flux in W/m².
    pub flux: f64,
    /// Mean, least and greatest temperature in kelvin; `None` where nothing determines one. The mean is that of T⁴, the
    /// temperature at which the surface would emit what it emits: (Σ A T⁴ / Σ A)^¼.
    pub temperature: Option<[f64; 3]>,
    /// Mean of T by area, in kelvin.
    pub mean_of_kelvin: Option<f64>,
    /// Mean radiosity in W/m².
    pub radiosity: f64,
    /// Mean irradiance in W/m².
    pub irradiance: f64,
}

/// The sum of all heat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct HeatBalance {
    /// Net heat of all surfaces that give it off, in W.
    pub given_off: f64,
    /// Net heat of all surfaces that take it up, below 0, in W.
    pub taken_up: f64,
    /// Net heat that leaves to the surroundings, in W.
    pub surroundings: f64,
    /// Remainder of all heat, in W: A F lacks it of symmetry.
    pub error: f64,
}

impl HeatBalance {
    /// The error as a part of the heat given off, or taken up where that is more; 0 where there is none.
    pub fn relative_error(&self) -> f64 {
        let whole = self.given_off.max(-self.taken_up).max(self.surroundings.abs());
        if whole > 0.0 { self.error.abs() / whole } else { 0.0 }
    }
}

/// Patches of a matrix with what their rows hold.
#[derive(Debug, Clone, Copy)]
pub struct MatrixTables<'a> {
    /// Areas and surfaces of patches.
    pub patches: &'a PatchTable,
    /// Sums and shares of their rows.
    pub rows: &'a RowTable,
    /// Names of objects and of materials, by the numbers of `patches`.
    pub names: [&'a [String]; 2],
}

/// Heat by surface, in order of their first patch, and its sum. `outside` is the irradiance from the surroundings,
/// `temperature` in kelvin, NaN where nothing determines it.
///
/// # Panics
/// When the arrays are not of the table's patches.
pub fn heat_by_surface(
    tables: MatrixTables<'_>,
    by: GroupBy,
    solution: &Solution,
    outside: Option<&[f64]>,
    temperature: &[f64],
) -> (Vec<SurfaceHeat>, HeatBalance) {
    let MatrixTables {
        patches: table,
        rows,
        names,
    } = tables;
    let (zones, zone_of) = zones_of(table, names, by);
    let mut surfaces: Vec<SurfaceHeat> = zones
        .into_iter()
        .map(|zone| SurfaceHeat {
            name: zone.name,
            patches: zone.patches,
            area: zone.area,
            heat: 0.0,
            flux: 0.0,
            temperature: Some([0.0, f64::INFINITY, f64::NEG_INFINITY]),
            mean_of_kelvin: Some(0.0),
            radiosity: 0.0,
            irradiance: 0.0,
        })
        .collect();
    let mut lost = 0.0;
    for (patch, &zone) in zone_of.iter().enumerate() {
        let surface = &mut surfaces[zone as usize];
        let area = table.area[patch];
        let (sent, received) = (solution.radiosity.of(patch)[0], solution.irradiance.of(patch)[0]);
        let kept = rows.kept(patch);
        surface.heat += area * (sent - kept * received);
        surface.radiosity += area * sent;
        surface.irradiance += area * received;
        match (&mut surface.temperature, temperature[patch]) {
            (Some([mean, least, most]), kelvin) if !kelvin.is_nan() => {
                *mean += area * kelvin.powi(4);
                surface.mean_of_kelvin = surface.mean_of_kelvin.map(|sum| sum + area * kelvin);
                (*least, *most) = (least.min(kelvin), most.max(kelvin));
            }
            (known, _) => *known = None,
        }
        let escaped = Some(rows.escaped[patch]).filter(|share| !share.is_nan());
        lost += area * (escaped.unwrap_or(0.0) * sent - outside.map_or(0.0, |outside| kept * outside[patch]));
    }
    let mut balance = HeatBalance {
        surroundings: lost,
        ..HeatBalance::default()
    };
    for surface in &mut surfaces {
        let mean = |sum: f64| if surface.area > 0.0 { sum / surface.area } else { 0.0 };
        surface.flux = mean(surface.heat);
        surface.radiosity = mean(surface.radiosity);
        surface.irradiance = mean(surface.irradiance);
        // Without area there is no mean; rounding does not leave what is between the ends.
        surface.temperature = surface
            .temperature
            .filter(|_| surface.area > 0.0)
            .map(|[sum, least, most]| {
                let mean = mean(sum).powf(0.25).clamp(least, most);
                [mean, least, most]
            });
        surface.mean_of_kelvin = (surface.mean_of_kelvin.zip(surface.temperature))
            .map(|(sum, [_, least, most])| mean(sum).clamp(least, most));
        if surface.heat > 0.0 {
            balance.given_off += surface.heat;
        } else {
            balance.taken_up += surface.heat;
        }
    }
    balance.error = balance.given_off + balance.taken_up - balance.surroundings;
    (surfaces, balance)
}
