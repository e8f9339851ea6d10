//! Exchange of radiation between surfaces: Gebhart factors, total exchange areas, conductances and resistances.
//!
//! Surfaces are zones of a stored matrix, or its own patches. Each is grey in a band, diffuse, and of one radiosity, as
//! the surfaces of textbooks' enclosures are (Siegel & Howell 2002, chapter 7): cut them where that is too coarse.
//!
//! ```text
//! G_ij = F'_ij ε_j + Σ_k F'_ik ρ_k G_kj    Gebhart factor: part of i's emission that j absorbs (Gebhart 1961)
//! A_i 𝓕_ij = A_i ε_i G_ij                  total exchange area, script F; Q_ij = A_i 𝓕_ij σ (T_i⁴ − T_j⁴)
//! C_ij = σ A_i 𝓕_ij                        radiative conductance, W/K⁴
//! (1 − ε_i) / (A_i ε_i)                    resistance of a surface, per unit of area (Oppenheim 1956)
//! 1 / (A_i F_ij)                           resistance between two radiosities
//! ```
//!
//! Mirrors and panes hand on ρs + τ of what arrives, and reflect ρ = 1 − ρs − τ − ε diffusely; F is then of arrivals
//! through them, too.
//!
//! F' is F with, on its diagonal, what a surface's view neither meets nor loses ([`RowTable::returned`]). The
//! surroundings, the last column, absorb all that leaves the scene. Then Σ_j G_ij + G_i,surroundings = 1 by
//! construction, and A_i 𝓕_ij = A_j 𝓕_ji as far as A_i F_ij = A_j F_ji, which [`Reading::Pairs`] makes so:
//! [`Exchange::conservation`] and [`Exchange::reciprocity`] measure both.
//!
//! A column of G is the irradiance where surface j alone emits ε_j: [`solve`] finds some tens of them at once, by
//! products with F'. No elimination, because that takes N³ operations where scenes of many surfaces have sparse F.
//!
//! [`Conductors`] has A_i 𝓕_ij as the conductors of a thermal network, each pair once.
//!
//! [`RowTable::returned`]: hemicube_store::RowTable::returned
//! [`solve`]: crate::solve::solve

mod bodies;
mod conductors;

pub use bodies::joined;
pub use conductors::Conductors;

use super::zones::{DENSE_MAX as SURFACES_MAX, GroupBy, zones};
use crate::solve::{
    Block, Factors, Heat, InMemory, Method, OutOfCore, Pairs, Problem, Reading, STEFAN_BOLTZMANN, SolveError,
    SolveOptions, solve,
};
use hemicube_store::{Form, Part, RowTable, Store};
use std::collections::HashMap;

/// Columns solved together.
const AT_ONCE: usize = 64;
/// Relative residual of a column.
const TOLERANCE: f64 = 1e-10;
/// A surface that keeps less than this part of what arrives exchanges nothing.
const KEPT_LEAST: f64 = 1e-9;
/// Rounding of shares that sum to 1.
const SHARES_ROUNDED: f64 = 1e-9;
/// Products with F for a column.
const PRODUCTS_MAX: u32 = 2000;

/// Surfaces of one radiosity each, and the form factors between them.
#[derive(Clone, Debug)]
pub struct Network {
    /// Names of objects or materials, or numbers of faces or patches from 0.
    pub names: Vec<String>,
    /// Areas, in the square of the scene's unit.
    pub area: Vec<f64>,
    /// Number of patches of each.
    pub patches: Vec<u32>,
    /// The surface of each patch of the matrix.
    pub of_patch: Vec<u32>,
    /// Part of each surface's view that leaves the scene.
    pub escaped: Vec<f64>,
    /// Part that exchanges nothing: 1 − Σ F − escaped ([`RowTable::returned`]).
    pub returned: Vec<f64>,
    /// What rows lack of 1, or have too much: `returned` less backs and patches without a column.
    pub error: Vec<f64>,
    /// ρs + τ of each surface; empty without mirrors and panes.
    pub handed_on: Vec<f64>,
    /// The form factors.
    pub factors: InMemory,
}

impl Network {
    /// The surfaces of a stored matrix; its own patches without `by`. `reading` says what of the matrix stands for a pair.
    ///
    /// # Errors
    /// [`SolveError::Problem`] for more than [`DENSE_MAX`](super::zones::DENSE_MAX) surfaces, and errors of reading; a patch without a row is
    /// one, because what it sends is not known.
    pub fn new(store: &Store, by: Option<GroupBy>, reading: Reading) -> Result<Self, SolveError> {
        let factors = OutOfCore::new(store, 0)?;
        let too_many = |count: usize| {
            Err(SolveError::Problem(format!(
                "{count} surfaces are more than {SURFACES_MAX}, and a factor between each two would take {} GB; take \
                 larger ones: by object or material",
                count.saturating_mul(count) / 125_000_000
            )))
        };
        let table = store.patches()?;
        let Some(by) = by else {
            if table.len() > SURFACES_MAX {
                return too_many(table.len());
            }
            return Self::of_patches(&factors, store, reading);
        };
        let zones = zones(store, by)?;
        if zones.len() > SURFACES_MAX {
            return too_many(zones.len());
        }
        let (_, of_patch) = super::zones::zones_of(&table, super::zones::names_of(store.manifest()), by);
        let lost = store.row_table()?;
        let (rows, form) = match reading {
            Reading::AsStored => (
                zones.iter().map(|zone| zone.factors.clone()).collect(),
                store.manifest().form,
            ),
            Reading::Pairs => {
                let pairs = Pairs::new(&factors, &table.area, &lost, 0)?;
                let areas: Vec<f64> = zones.iter().map(|zone| zone.area).collect();
                (rows_of_pairs(&pairs, &of_patch, &areas)?, Form::Double)
            }
        };
        Self::built(
            zones.iter().map(|zone| zone.name.clone()).collect(),
            zones
                .iter()
                .map(|zone| (zone.area, zone.patches, [zone.escaped, zone.blocked + zone.unselected]))
                .collect(),
            of_patch,
            &rows,
            form,
        )
        .handing_on(&lost)
    }

    fn of_patches(factors: &OutOfCore<'_>, store: &Store, reading: Reading) -> Result<Self, SolveError> {
        let (table, lost) = (store.patches()?, store.row_table()?);
        let all: Vec<u32> = (0..).take(table.len()).collect();
        let (rows, form) = match reading {
            Reading::Pairs => {
                let pairs = Pairs::new(factors, &table.area, &lost, 0)?;
                (rows_of_pairs(&pairs, &all, &table.area)?, Form::Double)
            }
            Reading::AsStored => {
                let mut rows = vec![Vec::new(); table.len()];
                for row in store.rows()? {
                    let (patch, row) = row?;
                    let entries = row.indices.iter().zip(&row.data);
                    rows[patch.0 as usize] = entries.map(|(&column, factor)| (column, factor)).collect();
                }
                (rows, store.manifest().form)
            }
        };
        let known = |share: f64| if share.is_nan() { 0.0 } else { share };
        let measures = table.area.iter().enumerate().map(|(patch, &area)| {
            let [escaped, blocked, unselected] = lost.shares(patch).to_array().map(known);
            (area, 1, [escaped, blocked + unselected])
        });
        Self::built(
            (0..table.len()).map(|patch| patch.to_string()).collect(),
            measures.collect(),
            all,
            &rows,
            form,
        )
        .handing_on(&lost)
    }

    /// The network with what mirrors and panes hand on: it exchanges nothing where it arrives.
    fn handing_on(mut self, rows: &RowTable) -> Result<Self, SolveError> {
        if rows.handed_on.is_empty() {
            return Ok(self);
        }
        let handed_on = self.of_surfaces(|patch| rows.handed_on[patch]).map_err(|name| {
            SolveError::Problem(format!(
                "the patches of `{name}` hand on several parts of what arrives, and a surface one; take smaller \
                 surfaces: by face, or by patch"
            ))
        })?;
        let part = self.factors.run(0)?;
        for (row, &surface) in part.rows.iter().enumerate() {
            let (columns, data) = part.row(row);
            let of = columns.iter().zip(data);
            let passed = of.map(|(&to, factor)| handed_on[to.cast_unsigned() as usize] * factor);
            let surface = surface as usize;
            let kept = 1.0 - handed_on[surface];
            let passed = passed.sum::<f64>();
            let lost = self.returned[surface] + passed;
            self.error[surface] += passed;
            self.returned[surface] = if kept > KEPT_LEAST { lost / kept } else { 0.0 };
        }
        self.handed_on = handed_on;
        Ok(self)
    }

    /// What each row lacks of 1, or has too much, as a part of what it exchanges.
    pub fn row_errors(&self) -> Vec<f64> {
        let of = |surface: usize| {
            let exchanged = 1.0 - self.kept(surface) * self.returned[surface];
            if exchanged > 0.0 {
                self.error[surface] / exchanged
            } else {
                0.0
            }
        };
        (0..self.len()).map(of).collect()
    }

    /// 1 − ρs − τ of a surface.
    pub fn kept(&self, surface: usize) -> f64 {
        1.0 - self.handed_on.get(surface).copied().unwrap_or(0.0)
    }

    /// A network of area, number of patches, and share of the view that leaves the scene and that ends on backs or
    /// patches without a column, of each surface, and its rows.
    fn built(
        names: Vec<String>,
        measures: Vec<(f64, u32, [f64; 2])>,
        of_patch: Vec<u32>,
        rows: &[Vec<(u32, f64)>],
        form: Form,
    ) -> Self {
        let mut part = Part {
            indptr: vec![0],
            ..Part::new(form)
        };
        let (mut returned, mut error) = (Vec::new(), Vec::new());
        for ((surface, row), &(_, _, [escaped, ended])) in (0u32..).zip(rows).zip(&measures) {
            let mut sum = 0.0;
            for &(to, factor) in row.iter().filter(|(_, factor)| *factor != 0.0) {
                part.indices.push(to.cast_signed());
                part.data.push(factor);
                sum += form.precision().round(factor);
            }
            part.rows.push(surface);
            part.indptr.push(i64::try_from(part.data.len()).unwrap_or(i64::MAX));
            returned.push(1.0 - sum - escaped);
            error.push(1.0 - sum - escaped - ended);
        }
        Self {
            names,
            area: measures.iter().map(|&(area, ..)| area).collect(),
            patches: measures.iter().map(|&(_, patches, _)| patches).collect(),
            escaped: measures.iter().map(|&(.., [escaped, _])| escaped).collect(),
            of_patch,
            returned,
            error,
            handed_on: Vec::new(),
            factors: InMemory::new(rows.len(), vec![part]),
        }
    }

    /// Number of surfaces.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// True without surfaces.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// The value of each surface, from one of each patch.
    ///
    /// # Errors
    /// The surface that has two different ones.
    pub fn of_surfaces<T: Clone + PartialEq>(&self, of_patch: impl Fn(usize) -> T) -> Result<Vec<T>, String> {
        let mut found: Vec<Option<T>> = vec![None; self.len()];
        for (patch, &surface) in self.of_patch.iter().enumerate() {
            let value = of_patch(patch);
            match &found[surface as usize] {
                Some(known) if *known != value => return Err(self.names[surface as usize].clone()),
                Some(_) => {}
                None => found[surface as usize] = Some(value),
            }
        }
        Ok(found.into_iter().flatten().collect())
    }

    /// The exchange areas A_i F_ij of surfaces that see each other, each pair once (i ≤ j): the mean of both
    /// directions.
    pub fn pairs(&self) -> Result<Vec<(u32, u32, f64)>, SolveError> {
        let mut areas: std::collections::BTreeMap<(u32, u32), f64> = std::collections::BTreeMap::new();
        let part = self.factors.run(0)?;
        for (row, &surface) in part.rows.iter().enumerate() {
            let (columns, data) = part.row(row);
            for (&column, factor) in columns.iter().zip(data) {
                let to = column.cast_unsigned();
                let whole = self.area[surface as usize] * factor;
                let share = if to == surface { whole } else { whole / 2.0 };
                *areas.entry((surface.min(to), surface.max(to))).or_insert(0.0) += share;
            }
        }
        Ok(areas.into_iter().map(|((a, b), area)| (a, b, area)).collect())
    }

    /// The heat exchanged by the network: the conditions of its surfaces take the places of patches'.
    ///
    /// # Errors
    /// The surface whose patches differ in a condition or an emissivity.
    pub fn heat(&self, of_patches: &Heat) -> Result<Heat, String> {
        let outside = of_patches.outside.as_ref();
        let sums = outside.map(|outside| {
            let mut sums = vec![0.0; self.len()];
            for (patch, &surface) in self.of_patch.iter().enumerate() {
                sums[surface as usize] += of_patches.area[patch] * outside[patch];
            }
            let mean = |(sum, area): (f64, &f64)| if *area > 0.0 { sum / area } else { 0.0 };
            sums.into_iter().zip(&self.area).map(mean).collect()
        });
        Ok(Heat {
            area: self.area.clone(),
            emissivity: self.of_surfaces(|patch| of_patches.emissivity[patch])?,
            given: self.of_surfaces(|patch| of_patches.given[patch])?,
            nodes: of_patches.nodes.clone(),
            outside: sums,
            returned: self.returned.clone(),
            handed_on: self.handed_on.clone(),
        })
    }
}

/// The rows of surfaces whose pairs are read once: F'ᵢⱼ = Gᵢⱼ / Aᵢ, ascending by surface.
fn rows_of_pairs(pairs: &Pairs<'_>, of_patch: &[u32], areas: &[f64]) -> Result<Vec<Vec<(u32, f64)>>, SolveError> {
    let mut sums: Vec<HashMap<u32, f64>> = vec![HashMap::new(); areas.len()];
    let mut of_row: HashMap<u32, f64> = HashMap::new();
    for run in 0..pairs.run_count() {
        let part = pairs.run(run)?;
        for (row, &patch) in part.rows.iter().enumerate() {
            let patch = patch as usize;
            let from = of_patch[patch];
            of_row.clear();
            let (columns, data) = part.row(row);
            for (&column, factor) in columns.iter().zip(data) {
                let column = column.cast_unsigned() as usize;
                *of_row.entry(of_patch[column]).or_insert(0.0) += pairs.reading(patch, column, factor);
            }
            // The same numbers in the same order both ways: G is symmetric to the last bit.
            for (&to, &reading) in &of_row {
                *sums[from as usize].entry(to).or_insert(0.0) += reading;
                *sums[to as usize].entry(from).or_insert(0.0) += reading;
            }
        }
    }
    let row = |(sums, &area): (HashMap<u32, f64>, &f64)| {
        let scale = if area > 0.0 { 1.0 / area } else { 0.0 };
        let mut row: Vec<(u32, f64)> = sums.into_iter().map(|(to, sum)| (to, sum * scale)).collect();
        row.sort_unstable_by_key(|&(to, _)| to);
        row
    };
    Ok(sums.into_iter().zip(areas).map(row).collect())
}

/// Exchange factors of a network in one band or more.
#[derive(Clone, Debug)]
pub struct Exchange {
    /// Emissivity of each surface, band by band.
    pub emissivity: Vec<Vec<f64>>,
    /// G_ij, row by row, with the surroundings as the last column: N × (N + 1) a band.
    pub gebhart: Vec<Vec<f64>>,
    /// True of a surface that hands on all that arrives: it emits nothing, and its row is of no emission.
    hands_on_all: Vec<bool>,
    /// Products with F.
    pub products: u32,
}

impl Exchange {
    /// Finds the factors of a network; `emissivity` is from 0 to 1, one vector a band. `progress` is told the columns
    /// done and their number, and says whether to go on.
    ///
    /// # Errors
    /// [`SolveError::Problem`] for emissivities of other surfaces or out of range, and for a column that does not
    /// converge: a closed enclosure that absorbs nothing; [`SolveError::Interrupted`] when `progress` returned false.
    ///
    /// ```
    /// use hemicube_solve::analysis::exchange::{Exchange, Network};
    /// use hemicube_solve::analysis::zones::GroupBy;
    /// use hemicube_solve::solve::Reading;
    /// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
    /// # let folder = tempfile::tempdir()?;
    /// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
    ///
    /// let network = Network::new(&store, Some(GroupBy::Object), Reading::Pairs)?;
    /// let exchange = Exchange::new(&network, &[vec![0.8; network.len()]], 0, &mut |_, _| true)?;
    /// assert!(exchange.conservation(0) < 1e-8, "each row adds up to 1");
    /// let (floor, light) = (0, 1);
    /// let (there, back) = (exchange.area(&network, 0, floor, light), exchange.area(&network, 0, light, floor));
    /// assert!((there / back - 1.0).abs() < 1e-6, "one exchange area for both directions: {there} and {back}");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn new(
        network: &Network,
        emissivity: &[Vec<f64>],
        threads: usize,
        progress: &mut dyn FnMut(usize, usize) -> bool,
    ) -> Result<Self, SolveError> {
        let count = network.len();
        if emissivity.iter().any(|band| band.len() != count) {
            return Err(SolveError::Problem(format!("emissivities are not of {count} surfaces")));
        }
        if let Some(bad) = emissivity.iter().flatten().find(|value| !(0.0..=1.0).contains(*value)) {
            return Err(SolveError::Problem(format!(
                "an emissivity is {bad}; it is from 0 to 1"
            )));
        }
        for (surface, name) in network.names.iter().enumerate() {
            let most = emissivity.iter().map(|band| band[surface]).fold(0.0, f64::max);
            if most > network.kept(surface) + SHARES_ROUNDED {
                return Err(SolveError::Problem(format!(
                    "`{name}` has an emissivity of {most}, and hands on {} of what arrives: together they are at most \
                     1",
                    network.handed_on[surface]
                )));
            }
        }
        let mut exchange = Self {
            emissivity: emissivity.to_vec(),
            gebhart: Vec::new(),
            hands_on_all: (0..count).map(|surface| network.kept(surface) <= KEPT_LEAST).collect(),
            products: 0,
        };
        let whole = emissivity.len() * (count + 1);
        for (band, emissivity) in emissivity.iter().enumerate() {
            let mut gebhart = vec![0.0; count * (count + 1)];
            for first in (0..=count).step_by(AT_ONCE) {
                let end = (first + AT_ONCE).min(count + 1);
                if !progress(band * (count + 1) + first, whole) {
                    return Err(SolveError::Interrupted);
                }
                let found = columns(network, emissivity, first..end, threads, &mut || {
                    progress(band * (count + 1) + first, whole)
                })?;
                exchange.products += found.1;
                for row in 0..count {
                    gebhart[row * (count + 1) + first..row * (count + 1) + end].copy_from_slice(found.0.of(row));
                }
            }
            exchange.gebhart.push(gebhart);
        }
        progress(whole, whole);
        Ok(exchange)
    }

    /// Number of surfaces.
    fn len(&self, band: usize) -> usize {
        self.emissivity[band].len()
    }

    /// G_ij; `to` = N: the surroundings.
    pub fn gebhart(&self, band: usize, from: usize, to: usize) -> f64 {
        self.gebhart[band][from * (self.len(band) + 1) + to]
    }

    /// A_i 𝓕_ij, the total exchange area; `to` = N: with the surroundings.
    pub fn area(&self, network: &Network, band: usize, from: usize, to: usize) -> f64 {
        network.area[from] * self.emissivity[band][from] * self.gebhart(band, from, to)
    }

    /// σ A_i 𝓕_ij, in W/K⁴ where the scene's unit is the metre.
    pub fn conductance(&self, network: &Network, band: usize, from: usize, to: usize) -> f64 {
        STEFAN_BOLTZMANN * self.area(network, band, from, to)
    }

    /// The largest |Σ_j G_ij − 1| of a row; of surfaces that can emit.
    pub fn conservation(&self, band: usize) -> f64 {
        let width = self.len(band) + 1;
        let off = |row: &[f64]| (row.iter().sum::<f64>() - 1.0).abs();
        let rows = self.gebhart[band].chunks_exact(width).zip(&self.hands_on_all);
        rows.filter(|(_, hands_on_all)| !**hands_on_all)
            .map(|(row, _)| off(row))
            .fold(0.0, f64::max)
    }

    /// √Σ (A_i 𝓕_ij − A_j 𝓕_ji)² / √Σ (A_i 𝓕_ij)², over all pairs.
    pub fn reciprocity(&self, network: &Network, band: usize) -> f64 {
        let (mut off, mut whole) = (0.0, 0.0);
        for i in 0..network.len() {
            for j in 0..network.len() {
                let there = self.area(network, band, i, j);
                off += (there - self.area(network, band, j, i)).powi(2);
                whole += there * there;
            }
        }
        if whole > 0.0 { (off / whole).sqrt() } else { 0.0 }
    }
}

/// Some columns of G, the last being that of the surroundings, and the products that it took.
fn columns(
    network: &Network,
    emissivity: &[f64],
    range: std::ops::Range<usize>,
    threads: usize,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<(Block, u32), SolveError> {
    let (count, width) = (network.len(), range.len());
    let column = |at: usize| range.start + at;
    let problem = Problem {
        reflectance: Block::from_fn(count, 1, |surface, _| {
            (network.kept(surface) - emissivity[surface]).max(0.0)
        }),
        bands: vec![0; width],
        emission: Block::from_fn(count, width, |surface, at| {
            if column(at) == surface {
                emissivity[surface]
            } else {
                0.0
            }
        }),
        outside: Some(Block::from_fn(count, width, |surface, at| {
            if column(at) == count {
                network.escaped[surface]
            } else {
                0.0
            }
        })),
        returned: Some(network.returned.clone()),
    };
    let options = SolveOptions {
        method: Method::Gmres { restart: 40 },
        tolerance: TOLERANCE,
        max_iterations: PRODUCTS_MAX,
        threads,
    };
    let solved = solve(&network.factors, &problem, options, &mut |_| go_on())?;
    if let Some(at) = solved.residuals.iter().position(|residual| *residual > TOLERANCE) {
        let name = network.names.get(column(at)).map_or("the surroundings", String::as_str);
        return Err(SolveError::Problem(format!(
            "what `{name}` absorbs did not settle: the residual is {:.1e} after {PRODUCTS_MAX} products; its enclosure \
             absorbs next to nothing",
            solved.residuals[at]
        )));
    }
    Ok((solved.irradiance, solved.iterations))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A network of areas, escaped shares and dense rows.
    pub(super) fn network(area: &[f64], escaped: &[f64], rows: &[Vec<f64>]) -> Network {
        let rows: Vec<Vec<(u32, f64)>> = rows
            .iter()
            .map(|row| (0..).zip(row).map(|(to, &factor)| (to, factor)).collect())
            .collect();
        let measures = area
            .iter()
            .zip(escaped)
            .map(|(&area, &escaped)| (area, 1, [escaped, 0.0]))
            .collect();
        let names = (0..area.len()).map(|surface| format!("s{surface}")).collect();
        Network::built(names, measures, (0..).take(area.len()).collect(), &rows, Form::Plain)
    }

    pub(super) fn exchange(network: &Network, emissivity: &[f64]) -> Exchange {
        Exchange::new(network, &[emissivity.to_vec()], 1, &mut |_, _| true).expect("a network")
    }

    /// Concentric spheres: A₁𝓕₁₂ = A₁ / (1/ε₁ + (A₁/A₂)(1/ε₂ − 1)) (Siegel & Howell 2002, chapter 7).
    #[test]
    fn concentric_spheres_are_the_textbooks() {
        let spheres = network(&[1.0, 4.0], &[0.0; 2], &[vec![0.0, 1.0], vec![0.25, 0.75]]);
        let found = exchange(&spheres, &[0.3, 0.7]);
        let wanted = 1.0 / (1.0 / 0.3 + 0.25 * (1.0 / 0.7 - 1.0));
        assert!((found.area(&spheres, 0, 0, 1) / wanted - 1.0).abs() < 1e-7);
        assert!(found.conservation(0) < 1e-8 && found.reciprocity(&spheres, 0) < 1e-7);
        // Black surfaces absorb what they see.
        let black = exchange(&spheres, &[1.0, 1.0]);
        assert!((black.gebhart(0, 1, 1) - 0.75).abs() < 1e-9 && black.gebhart(0, 1, 0) == 0.25);
    }

    /// Two plates that lose half of their view: the surroundings are a black surface, and take part in conservation.
    #[test]
    fn what_escapes_is_absorbed_by_the_surroundings() {
        let plates = network(&[2.0, 2.0], &[0.5; 2], &[vec![0.0, 0.5], vec![0.5, 0.0]]);
        let found = exchange(&plates, &[0.8, 0.4]);
        // By series: G₀ₛ = ½ + ½ ρ₁ (½ + ½ ρ₀ G₀ₛ…).
        let (r0, r1) = (0.2, 0.6);
        let out = (0.5 + 0.25 * r1) / (1.0 - 0.25 * r0 * r1);
        assert!((found.gebhart(0, 0, 2) - out).abs() < 1e-9);
        assert!(found.conservation(0) < 1e-9);
    }

    #[test]
    fn unsound_networks_are_refused_and_an_error_of_reciprocity_is_measured() {
        let room = network(&[1.0, 1.0], &[0.0; 2], &[vec![0.0, 1.0], vec![1.0, 0.0]]);
        let refused = |emissivity: &[f64]| {
            let found = Exchange::new(&room, &[emissivity.to_vec()], 1, &mut |_, _| true);
            found.expect_err("unsound").to_string()
        };
        assert!(refused(&[0.5]).contains("2 surfaces"));
        assert!(refused(&[0.5, 1.5]).contains("1.5"));
        let stopped = Exchange::new(&room, &[vec![0.5; 2]], 1, &mut |_, _| false);
        assert!(matches!(stopped, Err(SolveError::Interrupted)));
        // Areas that do not fit the factors: rows still add up, directions do not agree.
        let uneven = network(&[1.0, 2.0], &[0.0; 2], &[vec![0.0, 1.0], vec![1.0, 0.0]]);
        let found = exchange(&uneven, &[0.5, 0.5]);
        assert!(found.conservation(0) < 1e-9 && found.reciprocity(&uneven, 0) > 0.3);
    }

    #[test]
    fn pairs_are_reciprocal_once_each() {
        let spheres = network(&[1.0, 4.0], &[0.0; 2], &[vec![0.0, 1.0], vec![0.25, 0.75]]);
        assert_eq!(spheres.pairs().expect("a network"), [(0, 1, 1.0), (1, 1, 3.0)]);
    }
}
