//! Heat with mixed conditions: given temperatures, given fluxes, and surfaces of one unknown temperature.
//!
//! With the black radiosity e = σ T⁴ and the irradiance G = F B + S B + H, a grey, diffuse patch of emissivity ε sends
//! B = ε e + (1 − ε) G and has the net flux q = B − G = ε (e − G) (Siegel & Howell 2002, chapter 7; Modest 2013, eq.
//! 5.26). All of it is linear in e:
//!
//! ```text
//! temperature given       B = ε e + (1 − ε) G
//! flux given              B = q + G                                          e = G + q / ε
//! one unknown e, heat Q   Σ A ε (e − G) = Q over the surface, and so         e = (Q + Σ A ε G) / Σ A ε
//!                         B = (1 − ε) G + ε (Q + Σ A ε G) / Σ A ε
//! ```
//!
//! Each row of the last operator sums to 1 at most, as the others' do: GMRES and Jacobi solve it by products with F
//! alone.
//!
//! Where mirrors and panes hand on p = ρs + τ of what arrives, 1 − p stands for 1: B = ε e + (1 − p − ε) G, the net
//! flux is B − (1 − p) G, and ε is at most 1 − p (Kirchhoff: ε = 1 − ρs − ρd − τ).
//!
//! An enclosure in which nothing has a temperature, neither a surface nor what lies outside, has none itself: heat that
//! does not add up to 0 heats it for ever, and heat that does leaves its level open. Both are refused.

use super::{
    Block, Condition, Coupling, Enclosures, Factors, Method, Named, Node, Problem, SHARES_ROUNDED, STEFAN_BOLTZMANN,
    Solution, SolveError, SolveOptions, Step, Thermal, solve_coupled,
};
use hemicube_store::RowTable;

/// An enclosure that loses less than this part of its view is closed: rounding.
pub const OPEN_LEAST: f64 = 1e-6;
/// Share of the view above which a scene is open. A choice: with less, closed rooms with a seam ask for a temperature
/// outside; with more, a window's loss is taken for none.
pub const OPEN: f64 = 0.01;

/// The share of the view that leaves a scene, over its area, where it is more than [`OPEN`]: how warm it is outside
/// matters then. `area` has the areas of the table's rows; rows not computed do not count.
pub fn open_share(rows: &RowTable, area: &[f64]) -> Option<f64> {
    let computed = rows.escaped.iter().zip(area).filter(|(share, _)| !share.is_nan());
    let (escaped, whole) = computed.fold((0.0, 0.0), |(escaped, whole), (share, area)| {
        (escaped + share * area, whole + area)
    });
    (escaped > OPEN * whole).then(|| escaped / whole)
}
/// Heat that adds up to less than this part of its terms adds up to 0.
const SUM_LEAST: f64 = 1e-9;
/// A black radiosity below 0 by less than this part of the greatest is 0: the residual of the iteration.
const NEGATIVE_LEAST: f64 = 1e-4;
/// Former corrections that GMRES goes along where a level is to be found.
const CORRECTIONS_KEPT: usize = 3;
/// Names in an error.
const NAMES_SHOWN: usize = 4;

/// The condition of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Given {
    /// Its temperature, in kelvin.
    Temperature(f64),
    /// Its net flux, in W/m².
    Flux(f64),
    /// It is of this surface of one unknown temperature: an index into [`Heat::nodes`].
    Node(u32),
}

/// An exchange of heat. Vectors have a number a patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Heat {
    /// In the square of the scene's unit: of metres, for heat in W.
    pub area: Vec<f64>,
    /// From 0 to 1; above 0 for patches of nodes and of fluxes other than 0.
    pub emissivity: Vec<f64>,
    /// The conditions.
    pub given: Vec<Given>,
    /// Net heat of each surface of one unknown temperature, in W.
    pub nodes: Vec<f64>,
    /// Irradiance from outside the matrix, in W/m²; `None`: nothing comes from there.
    pub outside: Option<Vec<f64>>,
    /// The share of its own radiosity that each patch gets back ([`RowTable::returned`]).
    pub returned: Vec<f64>,
    /// ρs + τ of each patch ([`RowTable::handed_on`]); empty without mirrors and panes.
    pub handed_on: Vec<f64>,
}

/// A solved exchange of heat.
#[derive(Clone, Debug)]
pub struct HeatSolution {
    /// Radiosity and irradiance.
    pub solution: Solution,
    /// Kelvin, patch by patch.
    pub temperature: Vec<f64>,
    /// The problem with the temperatures found, for [`super::energy_balance`].
    pub problem: Problem,
}

/// Patches whose temperature nothing determines: adiabatic enclosures beside others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Undetermined {
    /// True for each of them.
    pub patches: Vec<bool>,
    /// Names of their objects or materials, the first few.
    pub names: String,
}

/// σ T⁴, in W/m².
fn black(kelvin: f64) -> f64 {
    STEFAN_BOLTZMANN * kelvin.powi(4)
}

impl Heat {
    /// The exchange of a matrix's patches: `thermal` by the kind of each patch, as
    /// [`super::Properties::thermal`] gives them. Heat of a surface is spread over its patches by area.
    ///
    /// # Errors
    /// For heat of a surface without area or emissivity, and a flux from a surface with an emissivity of 0.
    pub fn new(thermal: &[Thermal], kind_of_patch: &[u32], area: &[f64], rows: &RowTable) -> Result<Self, SolveError> {
        let surfaces = thermal.iter().map(|kind| kind.surface as usize + 1).max().unwrap_or(0);
        let of = |patch: usize| &thermal[kind_of_patch[patch] as usize];
        let mut area_of = vec![0.0; surfaces];
        let mut absorbing_of = vec![0.0; surfaces];
        for (patch, area) in area.iter().enumerate() {
            let kind = of(patch);
            area_of[kind.surface as usize] += area;
            absorbing_of[kind.surface as usize] += area * kind.emissivity.unwrap_or(0.0);
        }
        let mut nodes = Vec::new();
        let mut node_of: Vec<Option<u32>> = vec![None; surfaces];
        for kind in thermal.iter().filter(|kind| kind.is_used) {
            let surface = kind.surface as usize;
            let wrong = |reason: &str| Err(SolveError::Problem(format!("{}: {reason}", kind.shown())));
            let has_flux = matches!(kind.condition, Condition::Flux(flux) | Condition::Heat(flux) if flux != 0.0);
            if has_flux && kind.emissivity == Some(0.0) {
                return wrong("a surface with an emissivity of 0 gives off no heat, and has a flux");
            }
            if matches!(kind.condition, Condition::Heat(_)) && area_of[surface] <= 0.0 {
                return wrong("has heat, and no area to give it off");
            }
            let heat = match kind.condition {
                Condition::IsothermalFlux(flux) => flux * area_of[surface],
                Condition::IsothermalHeat(heat) => heat,
                _ => continue,
            };
            if absorbing_of[surface] <= 0.0 {
                return wrong("is isothermal, and with an emissivity or an area of 0 it exchanges nothing");
            }
            if node_of[surface].is_none() {
                node_of[surface] = u32::try_from(nodes.len()).ok();
                nodes.push(heat);
            }
        }
        super::require_shares(
            rows,
            "emissivity",
            |patch| of(patch).shown(),
            |patch| of(patch).emissivity.unwrap_or(0.0),
        )?;
        let given = |patch: usize| {
            let kind = of(patch);
            let surface = kind.surface as usize;
            match (kind.condition, node_of[surface]) {
                (Condition::Temperature(given), _) => Given::Temperature(given.kelvin()),
                (Condition::Heat(heat), _) => Given::Flux(heat / area_of[surface]),
                (Condition::IsothermalFlux(_) | Condition::IsothermalHeat(_), Some(node)) => Given::Node(node),
                (Condition::Flux(flux), _) => Given::Flux(flux),
                _ => Given::Flux(0.0),
            }
        };
        Ok(Self {
            area: area.to_vec(),
            emissivity: (0..area.len())
                .map(|patch| of(patch).emissivity.unwrap_or(0.0))
                .collect(),
            given: (0..area.len()).map(given).collect(),
            nodes,
            outside: None,
            returned: rows.returned(),
            handed_on: rows.handed_on.clone(),
        })
    }

    /// Surroundings at temperatures in kelvin: `shares` are, for each of them, the share of each patch's view that ends
    /// there. Shares that are not known (NaN) count as 0.
    pub fn surround(&mut self, surroundings: &[(f64, &[f64])]) {
        let known = |share: f64| if share.is_nan() { 0.0 } else { share };
        let warm = surroundings.iter().filter(|(kelvin, _)| *kelvin > 0.0);
        let warm: Vec<(f64, &[f64])> = warm.map(|&(kelvin, shares)| (black(kelvin), shares)).collect();
        self.outside = (!warm.is_empty()).then(|| {
            (0..self.area.len())
                .map(|patch| warm.iter().map(|(black, shares)| known(shares[patch]) * black).sum())
                .collect()
        });
    }

    /// This exchange with heat that patches take up from elsewhere, as of the sun or a lamp: W/m², a number a patch. A
    /// patch of an unknown temperature has to radiate it; of a given temperature nothing changes.
    ///
    /// # Errors
    /// When it is not of the exchange's patches, or a number of it is not finite.
    pub fn with_load(&self, load: &[f64]) -> Result<Self, SolveError> {
        self.require_numbers("heat taken up", load, |load| load.is_finite())?;
        let mut loaded = self.clone();
        for (patch, (given, &load)) in loaded.given.iter_mut().zip(load).enumerate() {
            match given {
                Given::Temperature(_) => {}
                Given::Flux(flux) => *flux += load,
                Given::Node(node) => {
                    if let Some(heat) = loaded.nodes.get_mut(*node as usize) {
                        *heat += self.area[patch] * load;
                    }
                }
            }
        }
        Ok(loaded)
    }

    /// This exchange with other temperatures of the patches that have given ones: kelvin, a number a patch; NaN leaves
    /// a patch as it is.
    ///
    /// # Errors
    /// When they are not of the exchange's patches, or one is of a patch whose temperature is to be found.
    pub fn with_temperatures(&self, kelvin: &[f64]) -> Result<Self, SolveError> {
        self.require_numbers("temperatures", kelvin, |kelvin| {
            kelvin.is_nan() || kelvin >= 0.0 && kelvin.is_finite()
        })?;
        let mut other = self.clone();
        for (patch, (given, &kelvin)) in other.given.iter_mut().zip(kelvin).enumerate() {
            match given {
                _ if kelvin.is_nan() => {}
                Given::Temperature(given) => *given = kelvin,
                _ => {
                    return Err(SolveError::Problem(format!(
                        "patch {patch} is given {kelvin} K, and its temperature is to be found"
                    )));
                }
            }
        }
        Ok(other)
    }

    fn require_numbers(&self, what: &str, values: &[f64], is_sound: impl Fn(f64) -> bool) -> Result<(), SolveError> {
        if values.len() != self.area.len() {
            return Err(SolveError::Problem(format!(
                "{what} of {} patches are given, and the exchange is of {}",
                values.len(),
                self.area.len()
            )));
        }
        match values.iter().position(|&value| !is_sound(value)) {
            Some(patch) => Err(SolveError::Problem(format!(
                "{what} of patch {patch} are {}, which they cannot be",
                values[patch]
            ))),
            None => Ok(()),
        }
    }

    /// Returns whether another exchange is of the same patches under conditions of the same kinds.
    fn is_alike(&self, other: &Self) -> bool {
        let kind = |given: &Given| match *given {
            Given::Temperature(_) => None,
            Given::Flux(_) => Some(u32::MAX),
            Given::Node(node) => Some(node),
        };
        self.area == other.area
            && self.emissivity == other.emissivity
            && self.returned == other.returned
            && self.handed_on == other.handed_on
            && self.nodes.len() == other.nodes.len()
            && self.given.iter().map(kind).eq(other.given.iter().map(kind))
    }

    /// True if some temperature is to be found from a flux other than 0, or for a whole surface.
    pub fn is_mixed(&self) -> bool {
        let is_mixed = |given: &Given| match *given {
            Given::Temperature(_) => false,
            Given::Flux(flux) => flux != 0.0,
            Given::Node(_) => true,
        };
        self.given.iter().any(is_mixed)
    }

    /// 1 − ρs − τ of a patch.
    fn kept(&self, patch: usize) -> f64 {
        1.0 - self.handed_on.get(patch).copied().unwrap_or(0.0)
    }

    /// Patches of each node.
    fn members(&self) -> Vec<Vec<u32>> {
        let mut members = vec![Vec::new(); self.nodes.len()];
        for (patch, given) in (0..).zip(&self.given) {
            if let Given::Node(node) = given {
                members[*node as usize].push(patch);
            }
        }
        members
    }

    /// Looks for enclosures without a temperature: `found` are the matrix's, `escaped` is what leaves of each patch's
    /// view, `named` what they are called. A surface of one temperature joins the enclosures that it reaches into.
    ///
    /// Adiabatic enclosures beside others have no temperature of their own, and no heat; they are returned.
    ///
    /// # Errors
    /// [`SolveError::Problem`] where heat is given and nothing has a temperature, or nowhere anything has.
    pub fn require_temperatures(
        &self,
        found: &Enclosures,
        escaped: &[f64],
        named: Named<'_>,
    ) -> Result<Undetermined, SolveError> {
        let found = &found.joined(&self.members());
        let count = found.len();
        let (mut held, mut area, mut open) = (vec![false; count], vec![0.0; count], vec![0.0; count]);
        let (mut heat, mut terms) = (vec![0.0; count], vec![0.0; count]);
        let mut node_enclosure = vec![None; self.nodes.len()];
        for (patch, &enclosure) in found.of_patch().iter().enumerate() {
            let enclosure = enclosure as usize;
            area[enclosure] += self.area[patch];
            if escaped[patch] > 0.0 {
                open[enclosure] += escaped[patch] * self.area[patch];
            }
            match self.given[patch] {
                Given::Temperature(_) => held[enclosure] |= self.emissivity[patch] > 0.0,
                Given::Flux(flux) => {
                    heat[enclosure] += flux * self.area[patch];
                    terms[enclosure] += (flux * self.area[patch]).abs();
                }
                Given::Node(node) => node_enclosure[node as usize] = Some(enclosure),
            }
        }
        for (given, enclosure) in self.nodes.iter().zip(node_enclosure) {
            if let Some(enclosure) = enclosure {
                heat[enclosure] += given;
                terms[enclosure] += given.abs();
            }
        }
        let is_held = |enclosure: usize| held[enclosure] || open[enclosure] > OPEN_LEAST * area[enclosure];
        let nowhere = !(0..count).any(is_held);
        let mut undetermined = vec![false; count];
        for enclosure in (0..count).filter(|&enclosure| !is_held(enclosure)) {
            let is_balanced = heat[enclosure].abs() <= SUM_LEAST * terms[enclosure];
            if terms[enclosure] == 0.0 && !nowhere {
                undetermined[enclosure] = true;
                continue;
            }
            let names = names_in(found, |other| other as usize == enclosure, named);
            let reason = if is_balanced {
                format!(
                    "the enclosure of {names} is closed, and no surface of it that emits has a temperature: its \
                     given heat adds up to 0, and leaves the level of all its temperatures open"
                )
            } else {
                format!(
                    "the enclosure of {names} is closed, no surface of it that emits has a temperature, and its \
                     given heat adds up to {:.4e} W, not to 0: it would grow warmer, or colder, for ever",
                    heat[enclosure]
                )
            };
            return Err(SolveError::Problem(format!(
                "{reason}; give one surface a `temperature`"
            )));
        }
        let names = names_in(found, |enclosure| undetermined[enclosure as usize], named);
        let patches = found
            .of_patch()
            .iter()
            .map(|&enclosure| undetermined[enclosure as usize]);
        Ok(Undetermined {
            patches: patches.collect(),
            names,
        })
    }

    /// The system for [`super::solve`], a column an exchange of `moments`, which are like this one, and what couples its
    /// patches.
    fn system(&self, moments: &[Self]) -> (Problem, Vec<Node>) {
        let mut nodes = Vec::new();
        let mut wholes = Vec::new();
        for patches in self.members() {
            let emissivity: Vec<f64> = patches.iter().map(|&patch| self.emissivity[patch as usize]).collect();
            let absorbing = |at: usize| self.area[patches[at] as usize] * emissivity[at];
            let whole: f64 = (0..patches.len()).map(absorbing).sum();
            wholes.push(whole);
            nodes.push(Node {
                weight: (0..patches.len()).map(|at| absorbing(at) / whole).collect(),
                patches,
                emissivity,
            });
        }
        let (patches, columns) = (self.area.len(), moments.len());
        let outside = |moment: &Self, patch: usize| moment.outside.as_ref().map_or(0.0, |outside| outside[patch]);
        let problem = Problem {
            reflectance: Block::from_fn(patches, 1, |patch, _| match self.given[patch] {
                Given::Flux(_) => self.kept(patch).max(0.0),
                _ => (self.kept(patch) - self.emissivity[patch]).max(0.0),
            }),
            bands: vec![0; columns],
            emission: Block::from_fn(patches, columns, |patch, column| match moments[column].given[patch] {
                Given::Temperature(kelvin) => self.emissivity[patch] * black(kelvin),
                Given::Flux(flux) => flux,
                Given::Node(node) => {
                    self.emissivity[patch] * (moments[column].nodes[node as usize] / wholes[node as usize])
                }
            }),
            outside: (moments.iter().any(|moment| moment.outside.is_some()))
                .then(|| Block::from_fn(patches, columns, |patch, column| outside(&moments[column], patch))),
            returned: Some(self.returned.clone()),
        };
        (problem, nodes)
    }

    fn check(&self, patches: usize) -> Result<(), SolveError> {
        let wrong = |reason: String| Err(SolveError::Problem(reason));
        let lengths = [
            self.area.len(),
            self.emissivity.len(),
            self.given.len(),
            self.returned.len(),
        ];
        let outside = self.outside.as_ref().map_or(patches, Vec::len);
        let handed_on = if self.handed_on.is_empty() {
            patches
        } else {
            self.handed_on.len()
        };
        if lengths
            .iter()
            .chain([&outside, &handed_on])
            .any(|&length| length != patches)
        {
            return wrong(format!(
                "areas, emissivities and conditions are not of the matrix's {patches} patches"
            ));
        }
        if let Some(bad) = self.emissivity.iter().find(|value| !(0.0..=1.0).contains(*value)) {
            return wrong(format!("an emissivity is {bad}; it is from 0 to 1"));
        }
        if let Some(bad) = self.area.iter().find(|area| !(area.is_finite() && **area >= 0.0)) {
            return wrong(format!("an area is {bad}; it is from 0 on"));
        }
        let too_many = |&patch: &usize| self.emissivity[patch] > self.kept(patch) + SHARES_ROUNDED;
        if let Some(patch) = (0..patches).find(too_many) {
            return wrong(format!(
                "patch {patch} has an emissivity of {}, and ρs + τ of {}: together they are at most 1, for what is \
                 neither emitted by Kirchhoff's law nor handed on is reflected diffusely",
                self.emissivity[patch], self.handed_on[patch]
            ));
        }
        for (patch, given) in self.given.iter().enumerate() {
            match *given {
                Given::Temperature(kelvin) if !(kelvin.is_finite() && kelvin >= 0.0) => {
                    return wrong(format!("a temperature is {kelvin}; it is in kelvin, from 0 on"));
                }
                Given::Flux(flux) if flux != 0.0 && self.emissivity[patch] == 0.0 => {
                    return wrong(format!(
                        "patch {patch} has a flux of {flux} W/m² and an emissivity of 0"
                    ));
                }
                Given::Node(node) if node as usize >= self.nodes.len() => {
                    return wrong(format!("patch {patch} is of surface {node}, which has no heat"));
                }
                _ => {}
            }
        }
        let members = self.members();
        for (node, (patches, heat)) in members.iter().zip(&self.nodes).enumerate() {
            let absorbing = |&patch: &u32| self.area[patch as usize] * self.emissivity[patch as usize];
            if !heat.is_finite() || patches.iter().map(absorbing).sum::<f64>() <= 0.0 {
                return wrong(format!(
                    "surface {node} of one temperature has a heat of {heat} W, and no patch that gives it off"
                ));
            }
        }
        Ok(())
    }

    /// Temperatures of a solution, and its problem with the emissions found.
    fn temperatures(&self, mut problem: Problem, solution: &Solution) -> Result<(Vec<f64>, Problem), SolveError> {
        let irradiance = |patch: usize| solution.irradiance.of(patch)[0];
        let mut of_node: Vec<f64> = Vec::new();
        for (patches, heat) in self.members().iter().zip(&self.nodes) {
            let (mut received, mut absorbing) = (0.0, 0.0);
            for &patch in patches {
                let weight = self.area[patch as usize] * self.emissivity[patch as usize];
                received += weight * irradiance(patch as usize);
                absorbing += weight;
            }
            of_node.push((heat + received) / absorbing);
        }
        let mut blacks = Vec::with_capacity(self.area.len());
        for (patch, given) in self.given.iter().enumerate() {
            blacks.push(match *given {
                Given::Temperature(kelvin) => black(kelvin),
                // An adiabatic surface sends as much as a black one of its temperature; a mirror would.
                Given::Flux(0.0) if self.kept(patch) < 1.0 => irradiance(patch),
                Given::Flux(0.0) => solution.radiosity.of(patch)[0],
                Given::Flux(flux) => irradiance(patch) + flux / self.emissivity[patch],
                Given::Node(node) => {
                    let black = of_node[node as usize];
                    problem.emission.of_mut(patch)[0] = self.emissivity[patch] * black;
                    black
                }
            });
        }
        let greatest = blacks.iter().copied().fold(0.0, f64::max);
        let cold = |black: &f64| *black < -NEGATIVE_LEAST * greatest;
        if solution.converged
            && let Some(patch) = blacks.iter().position(cold)
        {
            return Err(SolveError::Impossible {
                patch,
                count: blacks.iter().filter(|black| cold(black)).count(),
            });
        }
        let kelvin = |(black, given): (f64, &Given)| match *given {
            Given::Temperature(kelvin) => kelvin,
            _ => (black / STEFAN_BOLTZMANN).max(0.0).powf(0.25),
        };
        let temperature = blacks.into_iter().zip(&self.given).map(kelvin).collect();
        Ok((temperature, problem))
    }
}

/// The first few names of objects, or materials where objects have none, of the patches of some enclosures.
fn names_in(found: &Enclosures, is_meant: impl Fn(u32) -> bool, named: Named<'_>) -> String {
    let mut names: Vec<&str> = Vec::new();
    let mut more = 0;
    let mut seen = std::collections::HashSet::new();
    for (patch, &enclosure) in found.of_patch().iter().enumerate() {
        if !is_meant(enclosure) {
            continue;
        }
        let name = |names: &'_ [String], of: &[u32]| {
            let index = of.get(patch).copied().unwrap_or(u32::MAX);
            names.get(index as usize).cloned().filter(|name| !name.is_empty())
        };
        let key = (named.object.get(patch), named.material.get(patch));
        if !seen.insert(key) {
            continue;
        }
        let of_object = name(named.objects, named.object).is_some();
        let index = if of_object { key.0 } else { key.1 };
        let list = if of_object { named.objects } else { named.materials };
        let name = index
            .and_then(|&index| list.get(index as usize))
            .map_or("", String::as_str);
        if names.contains(&name) {
            continue;
        }
        if names.len() < NAMES_SHOWN {
            names.push(name);
        } else {
            more += 1;
        }
    }
    let listed: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    match more {
        0 => listed.join(", "),
        more => format!("{} and {more} more", listed.join(", ")),
    }
}

/// Solves an exchange of heat. `progress` is told of every product with the matrix, and says whether to go on.
///
/// A solution above the tolerance is returned as well, with [`Solution::converged`] false.
///
/// # Errors
/// As [`super::solve`]; [`SolveError::Problem`] for a problem of another matrix or out of range, and for nodes by
/// Gauss–Seidel, which needs each value as its row is due; [`SolveError::Impossible`] where a surface is to lose more
/// than it could at 0 K.
///
/// ```
/// use hemicube_solve::solve::{Given, Heat, InMemory, STEFAN_BOLTZMANN, SolveOptions, solve_heat};
///
/// // A plate at 300 K faces one of the same area that gives off 500 W/m².
/// let plates = InMemory::dense(&[vec![0.0, 1.0], vec![1.0, 0.0]]);
/// let heat = Heat {
///     area: vec![2.0; 2],
///     emissivity: vec![0.8, 0.5],
///     given: vec![Given::Temperature(300.0), Given::Flux(500.0)],
///     nodes: Vec::new(),
///     outside: None,
///     returned: vec![0.0; 2],
///     handed_on: Vec::new(),
/// };
/// let options = SolveOptions { tolerance: 1e-12, ..SolveOptions::default() };
/// let found = solve_heat(&plates, &heat, options, &mut |_| true)?;
/// let black = STEFAN_BOLTZMANN * 300.0_f64.powi(4) + 500.0 * (1.0 / 0.8 + 1.0 / 0.5 - 1.0);
/// let kelvin = (black / STEFAN_BOLTZMANN).powf(0.25);
/// assert!((found.temperature[1] / kelvin - 1.0).abs() < 1e-9);
///
/// // As one surface of one temperature that gives off 1000 W it is the same.
/// let node = Heat { given: vec![Given::Temperature(300.0), Given::Node(0)], nodes: vec![1000.0], ..heat };
/// let found = solve_heat(&plates, &node, options, &mut |_| true)?;
/// assert!((found.temperature[1] / kelvin - 1.0).abs() < 1e-9);
/// # Ok::<(), hemicube_solve::solve::SolveError>(())
/// ```
pub fn solve_heat(
    factors: &dyn Factors,
    heat: &Heat,
    options: SolveOptions,
    progress: &mut dyn FnMut(Step) -> bool,
) -> Result<HeatSolution, SolveError> {
    let found = solve_heats(factors, std::slice::from_ref(heat), options, progress)?;
    found.into_iter().next().ok_or(SolveError::Interrupted)
}

/// Solves exchanges of heat between the same patches at several moments together: conditions are of the same kinds, and
/// temperatures, fluxes, heats and what comes from outside may differ. Products with the matrix are in common.
///
/// # Errors
/// As [`solve_heat`]; and where an exchange is unlike the first.
///
/// ```
/// use hemicube_solve::solve::{Given, Heat, InMemory, SolveOptions, solve_heats};
///
/// // A black plate above one at 300 K takes up 0, 100 and 200 W/m² of sun on its other side.
/// let plates = InMemory::dense(&[vec![0.0, 1.0], vec![1.0, 0.0]]);
/// let night = Heat {
///     area: vec![1.0; 2],
///     emissivity: vec![1.0; 2],
///     given: vec![Given::Flux(0.0), Given::Temperature(300.0)],
///     nodes: Vec::new(),
///     outside: None,
///     returned: vec![0.0; 2],
///     handed_on: Vec::new(),
/// };
/// let moments: Vec<Heat> = [0.0, 100.0, 200.0]
///     .iter()
///     .map(|&sun| night.with_load(&[sun, sun]))
///     .collect::<Result<_, _>>()?;
/// let found = solve_heats(&plates, &moments, SolveOptions::default(), &mut |_| true)?;
/// let kelvin: Vec<f64> = found.iter().map(|found| found.temperature[0]).collect();
/// assert!((kelvin[0] - 300.0).abs() < 1e-3 && (kelvin[2] - 328.373).abs() < 0.01, "{kelvin:?}");
/// # Ok::<(), hemicube_solve::solve::SolveError>(())
/// ```
pub fn solve_heats(
    factors: &dyn Factors,
    moments: &[Heat],
    options: SolveOptions,
    progress: &mut dyn FnMut(Step) -> bool,
) -> Result<Vec<HeatSolution>, SolveError> {
    let Some(heat) = moments.first() else {
        return Ok(Vec::new());
    };
    if !moments.iter().all(|moment| moment.is_alike(heat)) {
        return Err(SolveError::Problem(
            "the conditions of two moments are of other kinds, patches or emissivities".to_owned(),
        ));
    }
    for moment in moments {
        moment.check(factors.patch_count())?;
    }
    let (problem, nodes) = heat.system(moments);
    if !nodes.is_empty() && options.method == Method::GaussSeidel {
        return Err(SolveError::Problem(
            "isothermal surfaces are solved by GMRES or Jacobi's method: their patches change together".to_owned(),
        ));
    }
    let coupling = Coupling {
        nodes: &nodes,
        // Without an unknown level there is no slow direction, and results stay what they were.
        corrections_kept: if moments.iter().any(Heat::is_mixed) {
            CORRECTIONS_KEPT
        } else {
            0
        },
    };
    let solution = solve_coupled(factors, &problem, coupling, options, progress)?;
    let column = |block: &Block, column: usize| Block::from_fn(block.patches(), 1, |patch, _| block.of(patch)[column]);
    let of_moment = |(at, moment): (usize, &Heat)| {
        let own = Problem {
            reflectance: problem.reflectance.clone(),
            bands: vec![0],
            emission: column(&problem.emission, at),
            outside: problem.outside.as_ref().map(|outside| column(outside, at)),
            returned: problem.returned.clone(),
        };
        let solution = Solution {
            radiosity: column(&solution.radiosity, at),
            irradiance: column(&solution.irradiance, at),
            residuals: vec![solution.residuals[at]],
            ..solution
        };
        let (temperature, problem) = moment.temperatures(own, &solution)?;
        Ok(HeatSolution {
            solution,
            temperature,
            problem,
        })
    };
    moments.iter().enumerate().map(of_moment).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::{InMemory, enclosures};

    fn named() -> (Vec<String>, Vec<String>) {
        (
            ["hot", "cold", "far"].map(str::to_owned).to_vec(),
            vec!["stuff".to_owned()],
        )
    }

    fn judged(given: [Given; 3], nodes: &[f64], escaped: [f64; 3]) -> Result<Undetermined, SolveError> {
        // `hot` and `cold` see each other, `far` nothing.
        let plates = InMemory::dense(&[vec![0.0, 1.0, 0.0], vec![1.0, 0.0, 0.0], vec![0.0; 3]]);
        let (objects, materials) = named();
        let named = Named {
            objects: &objects,
            materials: &materials,
            object: &[0, 1, 2],
            material: &[0; 3],
        };
        let heat = Heat {
            area: vec![2.0; 3],
            emissivity: vec![0.5; 3],
            given: given.to_vec(),
            nodes: nodes.to_vec(),
            outside: None,
            returned: vec![0.0; 3],
            handed_on: Vec::new(),
        };
        heat.require_temperatures(&enclosures(&plates)?, &escaped, named)
    }

    #[test]
    fn an_enclosure_without_a_temperature_is_refused() {
        let refused = |given, nodes: &[f64], escaped| match judged(given, nodes, escaped) {
            Err(SolveError::Problem(reason)) => reason,
            other => panic!("{other:?}"),
        };
        let (flux, far) = (Given::Flux, Given::Temperature(300.0));
        let reason = refused([flux(5.0), flux(-4.0), far], &[], [0.0; 3]);
        assert!(
            reason.contains("`hot`, `cold`") && reason.contains("2.0000e0 W, not to 0"),
            "{reason}"
        );
        let reason = refused([flux(5.0), flux(-5.0), far], &[], [0.0; 3]);
        assert!(reason.contains("open"), "{reason}");
        let reason = refused([Given::Node(0), flux(0.0), far], &[7.0], [0.0; 3]);
        assert!(reason.contains("7.0000e0 W"), "{reason}");
        assert!(refused([flux(0.0); 3], &[], [0.0; 3]).contains("open"));
        // A temperature, a way out, or a body of one temperature that reaches to another enclosure hold it.
        assert!(judged([flux(5.0), far, far], &[], [0.0; 3]).is_ok());
        assert!(judged([flux(5.0), flux(0.0), far], &[], [0.1, 0.0, 0.0]).is_ok());
        assert!(judged([Given::Node(0), flux(1.0), Given::Node(0)], &[7.0], [0.0, 0.0, 1.0]).is_ok());
        // Adiabatic beside others: said, not refused.
        let found = judged([far, far, flux(0.0)], &[], [0.0; 3]).expect("others have temperatures");
        assert_eq!(
            (found.patches, found.names.as_str()),
            (vec![false, false, true], "`far`")
        );
    }

    /// A body of one temperature, a sunlit plate and one of a given temperature, at three moments.
    #[test]
    fn moments_solved_together_are_those_solved_alone() {
        // Exact in f32, so that rows sum to 1 to the last digit.
        let factors = InMemory::dense(&[
            vec![0.0, 0.25, 0.25, 0.5],
            vec![0.25, 0.0, 0.5, 0.25],
            vec![0.25, 0.5, 0.0, 0.25],
            vec![0.5, 0.25, 0.25, 0.0],
        ]);
        let night = Heat {
            area: vec![1.0; 4],
            emissivity: vec![0.5, 0.7, 0.9, 0.6],
            given: vec![
                Given::Node(0),
                Given::Node(0),
                Given::Flux(0.0),
                Given::Temperature(290.0),
            ],
            nodes: vec![20.0],
            outside: None,
            returned: vec![0.0; 4],
            handed_on: Vec::new(),
        };
        let noon = night.with_load(&[100.0, 0.0, 400.0, 900.0]).expect("four numbers");
        assert_eq!(noon.nodes, [120.0]);
        assert_eq!(noon.given[2..], [Given::Flux(400.0), Given::Temperature(290.0)]);
        let dusk = night.with_temperatures(&[f64::NAN, f64::NAN, f64::NAN, 280.0]);
        let moments = [night, noon, dusk.expect("one temperature is given")];
        let options = SolveOptions {
            tolerance: 1e-12,
            ..SolveOptions::default()
        };
        let together = solve_heats(&factors, &moments, options, &mut |_| true).expect("solved");
        for (moment, together) in moments.iter().zip(&together) {
            let alone = solve_heat(&factors, moment, options, &mut |_| true).expect("solved");
            for (a, b) in alone.temperature.iter().zip(&together.temperature) {
                assert!((a - b).abs() < 1e-8, "{a} {b}");
            }
        }
        let [night, noon, dusk] = [0, 1, 2].map(|at| together[at].temperature[2]);
        assert!(noon > night + 10.0 && dusk < night - 5.0, "{night} {noon} {dusk}");
        // Nothing is lost: what the body and the plate take up, the plate at 290 K does.
        let q = |at: usize| together[1].solution.radiosity.of(at)[0] - together[1].solution.irradiance.of(at)[0];
        assert!((q(3) + 520.0).abs() < 1e-6, "{}", q(3));

        let wrong = moments[0].with_temperatures(&[280.0, f64::NAN, f64::NAN, f64::NAN]);
        assert!(matches!(wrong, Err(SolveError::Problem(reason)) if reason.contains("patch 0")));
        assert!(moments[0].with_load(&[1.0]).is_err() && moments[0].with_load(&[f64::NAN; 4]).is_err());
        let other = Heat {
            given: vec![Given::Flux(0.0); 4],
            nodes: Vec::new(),
            ..moments[0].clone()
        };
        let unlike = solve_heats(&factors, &[moments[0].clone(), other], options, &mut |_| true);
        assert!(matches!(unlike, Err(SolveError::Problem(_))), "{unlike:?}");
    }

    #[test]
    fn what_would_be_colder_than_nothing_is_refused() {
        let plates = InMemory::dense(&[vec![0.0, 1.0], vec![1.0, 0.0]]);
        let heat = Heat {
            area: vec![1.0; 2],
            emissivity: vec![0.5; 2],
            given: vec![Given::Temperature(300.0), Given::Flux(-1e4)],
            nodes: Vec::new(),
            outside: None,
            returned: vec![0.0; 2],
            handed_on: Vec::new(),
        };
        let refused = solve_heat(&plates, &heat, SolveOptions::default(), &mut |_| true);
        assert!(
            matches!(refused, Err(SolveError::Impossible { patch: 1, count: 1 })),
            "{refused:?}"
        );
    }
}
