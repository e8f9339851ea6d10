//! Heat by surface: what each object, material or face of a scene gives off, and how warm it is.
//!
//! ```text
//! Q = Σ A (B − G)          of mirrors and panes Σ A (B − (1 − ρs − τ) G); the mean of x over a surface: Σ A x / Σ A
//! ```
//!
//! Over all surfaces Q adds up to what the surroundings receive, plus the matrix's error Σᵢⱼ (AᵢFᵢⱼ − AⱼFⱼᵢ) Bᵢ: with
//! B − G = Σⱼ Fᵢⱼ (Bᵢ − Bⱼ) + escapedᵢ (Bᵢ − H) nothing else is left, not even the residual of the iteration
//! (`solve.rs`). [`HeatBalance::error`] is that sum: 0 to rounding where pairs are read once
//! ([`Pairs`](crate::solve::Pairs)).
//!
//! A row that then sums to 1 − δ lacks δ of its view, or has it too much. Spread as the rest of the view, that is δ / s
//! of the patch's heat, s being the share that it exchanges:
//!
//! ```text
//! eᵢ = Aᵢ qᵢ δᵢ / sᵢ        δᵢ = 1 − Σⱼ F'ᵢⱼ − escapedᵢ − blockedᵢ − unselectedᵢ        sᵢ = Σⱼ F'ᵢⱼ + escapedᵢ
//! ```
//!
//! Of a body (the patches of one name and condition) the error is |Σ e|, of an enclosure the part that its bodies' errors
//! are of all that they give off and take up: errors of two bodies do not cancel, and each is a part of the heat of that
//! body or enclosure alone ([`heat_errors`]). As stored, what the two readings of pairs disagree by
//! ([`disagreement`](crate::solve::disagreement)) adds to e.

use super::zones::{GroupBy, zones_of};
use crate::solve::{Enclosures, Solution};
use hemicube_store::{PatchTable, RowTable};
use serde::Serialize;
use std::collections::BTreeMap;

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
    /// Remainder of all heat, in W: rounding, or what A F lacks of symmetry as it is stored.
    pub error: f64,
}

/// Heat, and what is not known of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct HeatError {
    /// Heat that flows, in W: given off, or taken up where that is more; of a body what its patches give off and take up.
    pub heat: f64,
    /// In W, from 0 on.
    pub error: f64,
}

impl HeatError {
    /// The error as a part of the heat; 0 where there is none.
    pub fn share(&self) -> f64 {
        if self.heat > 0.0 { self.error / self.heat } else { 0.0 }
    }
}

/// The error of an enclosure's heat, and of the body in it of which least is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EnclosureError {
    /// Of the whole.
    pub whole: HeatError,
    /// The number of the body with the largest share, and its error.
    pub worst: Option<(u32, HeatError)>,
}

impl EnclosureError {
    /// The larger share of both.
    pub fn share(&self) -> f64 {
        self.whole.share().max(self.worst.map_or(0.0, |(_, body)| body.share()))
    }
}

/// Share of the heat above which its error is to be told.
pub const ERROR_TOLD: f64 = 0.01;
/// Share above which no result is.
pub const ERROR_MOST: f64 = 0.1;
/// Heat of a body below this part of its enclosure's is rounding.
const HEAT_LEAST: f64 = 1e-6;
/// Heat below this part of all that is sent is rounding, or below the residual of the iteration.
const RESIDUAL_LEAST: f64 = 1e-13;

/// δ / s of each row: what it lacks of 1, or has too much, as a part of what it exchanges.
pub fn row_errors(rows: &RowTable) -> Vec<f64> {
    let known = |share: f64| if share.is_nan() { 0.0 } else { share };
    let of = |patch: usize| {
        let [escaped, blocked, unselected] = rows.shares(patch).to_array().map(known);
        let exchanged = known(rows.row_sum[patch]) - rows.passed_of(patch) + escaped;
        let lacks = 1.0 - exchanged - blocked - unselected;
        if exchanged > 0.0 { lacks / exchanged } else { 0.0 }
    };
    (0..rows.row_sum.len()).map(of).collect()
}

/// Heat that a solution leaves unsure, by enclosure. Of each patch are `heat`, what it gives off, `error` and `sent`, all
/// in W, and the number of its body. `residual` is the iteration's.
///
/// # Panics
/// When the arrays are not of the enclosures' patches.
pub fn heat_errors(
    [heat, error, sent]: [&[f64]; 3],
    enclosures: &Enclosures,
    body: &[u32],
    residual: f64,
) -> Vec<EnclosureError> {
    let mut bodies: BTreeMap<(u32, u32), [f64; 2]> = BTreeMap::new();
    let mut flows = vec![[0.0; 3]; enclosures.len()];
    for (patch, &enclosure) in enclosures.of_patch().iter().enumerate() {
        let [given_off, taken_up, all] = &mut flows[enclosure as usize];
        *given_off += heat[patch].max(0.0);
        *taken_up -= heat[patch].min(0.0);
        *all += sent[patch].abs();
        let [flow, off] = bodies.entry((enclosure, body[patch])).or_default();
        *flow += heat[patch].abs();
        *off += error[patch];
    }
    let mut found = vec![EnclosureError::default(); enclosures.len()];
    // What one body gives off another takes up: the errors of both are of both.
    for ((enclosure, body), [flow, off]) in bodies {
        let [given_off, taken_up, all] = flows[enclosure as usize];
        let heat = given_off.max(taken_up);
        let left = residual.max(RESIDUAL_LEAST) * all;
        if heat <= left {
            continue;
        }
        let of = &mut found[enclosure as usize];
        of.whole.heat = heat;
        of.whole.error += off.abs() * heat / (given_off + taken_up);
        let own = HeatError {
            heat: flow,
            error: off.abs(),
        };
        if flow > left.max(HEAT_LEAST * heat) && of.worst.is_none_or(|(_, worst)| worst.share() < own.share()) {
            of.worst = Some((body, own));
        }
    }
    found
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::{InMemory, enclosures};

    #[test]
    fn an_error_is_neither_diluted_by_a_neighbour_nor_cancelled_by_sign() {
        // A small enclosure 0, 1 and a large one 2, 3, 4.
        let mut rows = vec![vec![0.0; 5]; 5];
        (rows[0][1], rows[1][0], rows[2][3], rows[3][4], rows[4][2]) = (1.0, 1.0, 1.0, 1.0, 1.0);
        let found = enclosures(&InMemory::dense(&rows)).expect("a matrix");
        let heat = [10.0, -10.0, 1e6, -5e5, -5e5];
        let error = [0.5, -0.5, 0.0, 10.0, -10.0];
        let errors = heat_errors([&heat, &error, &heat], &found, &[0, 1, 2, 3, 3], 1e-9);
        assert_eq!(errors[0].whole, HeatError { heat: 10.0, error: 0.5 });
        assert_eq!(
            errors[0].worst.map(|(body, error)| (body, error.share())),
            Some((0, 0.05))
        );
        // Patches of one body at one temperature do: it is one sum.
        assert_eq!(errors[1].whole, HeatError { heat: 1e6, error: 0.0 });
        // What the iteration leaves is no heat.
        let errors = heat_errors([&heat, &error, &[1e6; 5]], &found, &[0; 5], 1e-4);
        assert_eq!((errors[0].share(), errors[0].worst), (0.0, None));
    }

    #[test]
    fn a_rows_error_is_what_neither_it_nor_its_shares_account_for() {
        let mut rows = RowTable::unknown(3);
        rows.row_sum = vec![0.75, 1.25, 0.0];
        (rows.escaped[0], rows.blocked[0]) = (0.05, 0.2);
        assert!(row_errors(&rows)[0].abs() < 1e-12);
        assert!((row_errors(&rows)[1] + 0.2).abs() < 1e-12);
        assert_eq!(row_errors(&rows)[2], 0.0);
    }
}
