//! Light and heat from a form-factor matrix: (I − R F) B = E + R H, for any number of bands and right-hand sides at
//! once.
//!
//! ```text
//! B  radiosity, what leaves a patch                    F  form factors, F[i, j] from i to j
//! E  emission, what it leaves with of itself           R  reflectance, diagonal, one a band
//! H  irradiance from outside the matrix (the sky)      G  irradiance in all, G = F B + S B + H, and so B = E + R G
//! S  what returns to its patch, diagonal
//! ```
//!
//! A row may lack information on a part of the view: backs of one-sided patches, patches without a column, and 1 minus
//! Σ F + escaped + blocked + unselected. Taken as black and cold, that part would cool surfaces as warm as all around
//! them. Instead it exchanges nothing: the patch gets [`RowTable::returned`], Sᵢ = 1 − Σⱼ Fᵢⱼ − escapedᵢ, of its own
//! radiosity back. Then, of any row,
//!
//! ```text
//! Bᵢ − Gᵢ = Σⱼ Fᵢⱼ (Bᵢ − Bⱼ) + escapedᵢ (Bᵢ − outside)
//! ```
//!
//! This is Oppenheim's network, a conductance Aᵢ Fᵢⱼ between each two radiosities: at one temperature no net flux is
//! left, and in a white furnace no contrast, however large the rows' own errors are.
//!
//! Thermal exchange is the same with reflectance 1 − ε, emission ε σ T⁴ and a net flux q = B − G, in W/m² for kelvin
//! (Modest 2013, chapter 5; Oppenheim 1956). A given flux is reflectance 1 and emission q; a surface of one unknown
//! temperature couples its patches (`solve/heat.rs`).
//!
//! Mirrors and panes hand on ρs + τ of what arrives; F is then of arrivals, through portals too
//! (`hemicube::portal`), and what a patch keeps, 1 − ρs − τ, is absorbed or diffusely reflected:
//!
//! ```text
//! B = E + ρd G        G = F B + S B + H        absorbed (1 − ρs − τ − ρd) G        net flux B − (1 − ρs − τ) G
//! ```
//!
//! With B / (1 − ρs − τ), F (1 − ρs − τ)ⱼ and A (1 − ρs − τ) in place of B, F and A these are the equations above: rows
//! close, A F is symmetric, and at one temperature no net flux is left.
//!
//! The two readings of a pair are Aᵢ Fᵢⱼ and Aⱼ Fⱼᵢ; [`Pairs`] makes one of them, so that what is given off is taken up.
//!
//! The matrix is gone through in runs of rows and is never whole in memory ([`Factors`]). Each method needs F times
//! some vectors, once an iteration, for all right-hand sides together:
//!
//! - *Jacobi*: B ← E + R (F B + H). The residual falls by the largest ρᵢ Σⱼ Fᵢⱼ or better.
//! - *Gauss–Seidel*: the same with the newest values, row by row in the processing order; one thread computes, another
//!   reads.
//! - *GMRES* (Saad & Schultz 1986), restarted, each right-hand side with a Krylov space of its own and products in
//!   common. ‖I − (I − R F)‖ < 1, so it needs no preconditioner. It holds `restart` + 2 vectors a right-hand side.
//!
//! GMRES is written here, because an operator read from a disk can fail and be interrupted. `faer`'s, the crate that
//! fits best, asks for a product that cannot fail (`LinOp::apply`), and its BiCGSTAB couples right-hand sides by small
//! systems that become singular when two of them coincide or one is done before the others.
//!
//! The residual of a solution is ‖E + R H − (I − R F) B‖ / ‖E + R H‖, of each right-hand side by itself, computed from
//! B anew when an iteration ends. Each right-hand side is solved scaled by a power of two, with its largest number near
//! 1: no norm leaves the range of f64, and no bit of a solution depends on the unit. A NaN residual is an error.
//!
//! Solutions lie beside the matrix and name it by a checksum (`solve/files.rs`). Rows are summed in the order of their
//! entries, so threads change no bit.

mod block;
mod enclosures;
mod factors;
mod files;
mod gmres;
mod heat;
mod pairs;
mod properties;
mod stationary;

pub use block::Block;
pub use enclosures::{Enclosures, LEAST_EXCHANGE, enclosures};
pub use factors::{Factors, InMemory, OutOfCore, multiply};
pub use files::{ArrayFile, SolutionWriter, StoredSolution};
pub use heat::{Given, Heat, HeatSolution, OPEN, OPEN_LEAST, Undetermined, open_share, solve_heat, solve_heats};
pub use pairs::{Pairs, Reading, SUMS, Weights, disagreement};
pub use properties::{
    Condition, Entry, Named, Optics, PrintedTable, Properties, PropertyError, PropertyStep, RGB, Spectrum, Tables,
    Temperature, Thermal, question_of_cold,
};

use hemicube_store::{Error as StoreError, RowTable};
use serde::Serialize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

/// Stefan–Boltzmann constant, W m⁻² K⁻⁴ (exact since 2019: CODATA).
pub const STEFAN_BOLTZMANN: f64 = 5.670_374_419e-8;

/// Method of solving the system.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Each iteration from the values of the one before.
    Jacobi,
    /// Each row with the newest values.
    GaussSeidel,
    /// GMRES, begun anew after this many iterations.
    Gmres {
        /// Iterations between restarts.
        restart: u32,
    },
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveOptions {
    /// Options of a solution.
    pub method: Method,
    /// The relative residual of every right-hand side.
    pub tolerance: f64,
    /// Products with the matrix before it gives up.
    pub max_iterations: u32,
    /// Threads of products; 0: one a core.
    pub threads: usize,
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self {
            method: Method::Gmres { restart: 20 },
            tolerance: 1e-6,
            max_iterations: 500,
            threads: 0,
        }
    }
}

impl SolveOptions {
    /// The number of threads meant.
    pub fn threads(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        }
    }
}

/// A patch with less than this left of its equation keeps its own reflection unsolved.
const OWN_LEAST: f64 = 1e-9;

/// The system. Blocks have a row a patch; emission and the irradiance from outside have a column a right-hand side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Problem {
    /// R: a column a band, each value from 0 to 1.
    pub reflectance: Block,
    /// The band of each right-hand side.
    pub bands: Vec<usize>,
    /// E.
    pub emission: Block,
    /// H; `None`: nothing comes from outside.
    pub outside: Option<Block>,
    /// S, the share of its own radiosity that each patch gets back ([`RowTable::returned`]); `None`: 0.
    pub returned: Option<Vec<f64>>,
}

/// Progress of a solution: after every product with the matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Products with the matrix so far.
    pub iteration: u32,
    /// The largest relative residual of a right-hand side.
    pub residual: f64,
}

/// A solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// B.
    pub radiosity: Block,
    /// G, the irradiance.
    pub irradiance: Block,
    /// Relative residual of each right-hand side, from B and F anew.
    pub residuals: Vec<f64>,
    /// Products with the matrix, the one for the residuals included.
    pub iterations: u32,
    /// True if every residual is at most the tolerance.
    pub converged: bool,
}

/// Why nothing was solved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The problem has no solution.
    #[error("{0}")]
    Problem(String),
    /// The matrix cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The iteration left the range of numbers.
    #[error(
        "the residual is {residual} after {iteration} products with the matrix: its rows sum to more than 1 where \
         surfaces reflect all, or its numbers are none; a check of the matrix tells; lower reflectances help the \
         first"
    )]
    Diverged {
        /// Products with the matrix so far.
        iteration: u32,
        /// The residual.
        residual: f64,
    },
    /// An enclosure that emits, absorbs nothing and lets nothing out: its light adds up for ever.
    #[error(
        "{count} patches, patch {patch} among them, emit, reflect all of it and let none out: that adds up for ever, \
         and no radiosity is finite; give one of them a reflectance below 1, or none of them an emission"
    )]
    Endless {
        /// The first of them.
        patch: usize,
        /// Their number.
        count: usize,
    },
    /// Surfaces are to lose more heat than reaches them.
    #[error(
        "{count} patches, from patch {patch} on, are to lose more heat than reaches them, even at 0 K: a flux or heat \
         below 0 takes too much"
    )]
    Impossible {
        /// The first of them.
        patch: usize,
        /// Their number.
        count: usize,
    },
    /// Whoever watches the progress asked to stop.
    #[error("the solution was interrupted")]
    Interrupted,
}

/// Refuses what patches reflect or emit beside what they hand on: `share` + ρs + τ is at most 1. `what` is the share's
/// name, `shown` that of a patch's surface.
///
/// # Errors
/// [`SolveError::Problem`] with the first patch beyond that.
pub fn require_shares(
    rows: &RowTable,
    what: &str,
    shown: impl Fn(usize) -> String,
    share: impl Fn(usize) -> f64,
) -> Result<(), SolveError> {
    for (patch, handed_on) in rows.handed_on.iter().enumerate() {
        let share = share(patch);
        if share > rows.kept(patch) + SHARES_ROUNDED {
            return Err(SolveError::Problem(format!(
                "{} has the {what} {share}, and ρs + τ of {handed_on} in the matrix: together they are at most 1; give \
                 it a {what} of {} at most",
                shown(patch),
                (rows.kept(patch) * 1e9).round() / 1e9
            )));
        }
    }
    Ok(())
}

/// Rounding of shares that sum to 1.
const SHARES_ROUNDED: f64 = 1e-9;

/// Range of the largest magnitude of a right-hand side, for its squares times areas to be numbers.
const MAGNITUDES: std::ops::RangeInclusive<f64> = 1e-200..=1e200;

impl Problem {
    fn check(&self, patches: usize) -> Result<(), SolveError> {
        let wrong = |reason: String| Err(SolveError::Problem(reason));
        let columns = self.emission.columns();
        let of = |block: &Block| block.patches() == patches && block.columns() > 0;
        if !of(&self.reflectance) || !of(&self.emission) {
            return wrong(format!(
                "reflectance and emission are not of the matrix's {patches} patches"
            ));
        }
        if self
            .outside
            .as_ref()
            .is_some_and(|outside| !of(outside) || outside.columns() != columns)
        {
            return wrong("the irradiance from outside is not of the emission's patches and right-hand sides".into());
        }
        if let Some(bad) = self.reflectance.values().iter().find(|r| !(0.0..=1.0).contains(*r)) {
            return wrong(format!("a reflectance is {bad}; it is from 0 to 1"));
        }
        if let Some(returned) = &self.returned {
            if returned.len() != patches {
                return wrong(format!(
                    "what returns is of {} patches, not of {patches}",
                    returned.len()
                ));
            }
            if let Some(bad) = returned
                .iter()
                .zip(0..)
                .find(|&(share, patch)| !(share.is_finite() && share * self.rho_most(patch).max(0.0) <= 1.0 + 1e-6))
            {
                return wrong(format!(
                    "{} of a view returns; what is reflected of it is at most 1",
                    bad.0
                ));
            }
        }
        if self.bands.len() != columns || self.bands.iter().any(|&band| band >= self.reflectance.columns()) {
            return wrong("a right-hand side is of a band that has no reflectance".into());
        }
        let outside = self.outside.iter().flat_map(|outside| outside.values());
        if let Some(bad) = self.emission.values().iter().chain(outside).find(|e| !e.is_finite()) {
            return wrong(format!("an emission is {bad}; it is a finite number"));
        }
        for block in std::iter::once(&self.emission).chain(&self.outside) {
            for column in 0..columns {
                let largest = block.largest(column);
                if largest != 0.0 && !MAGNITUDES.contains(&largest) {
                    return wrong(format!(
                        "the largest emission of a right-hand side is {largest:e}, and from {:e} to {:e} it can be \
                         solved for; give it in another unit",
                        MAGNITUDES.start(),
                        MAGNITUDES.end()
                    ));
                }
            }
        }
        Ok(())
    }

    /// ρ of a patch and a right-hand side.
    #[inline]
    fn rho(&self, patch: usize, column: usize) -> f64 {
        self.reflectance.of(patch)[self.bands[column]]
    }

    /// The largest ρ of a patch.
    fn rho_most(&self, patch: usize) -> f64 {
        self.reflectance.of(patch).iter().copied().fold(0.0, f64::max)
    }

    /// S of a patch.
    #[inline]
    fn back(&self, patch: usize) -> f64 {
        self.returned.as_ref().map_or(0.0, |returned| returned[patch])
    }

    /// A step of an iteration: from B to the solution of (1 − ρ S) B = E + ρ (F B + H), with `next` = E + ρ (F B + S B
    /// + H).
    #[inline]
    fn step(&self, patch: usize, column: usize, b: f64, next: f64) -> f64 {
        let own = 1.0 - self.rho(patch, column) * self.back(patch);
        // A patch that reflects everything and sees only itself stays unchanged.
        if own > OWN_LEAST { b + (next - b) / own } else { next }
    }

    /// E + R H.
    fn source(&self) -> Block {
        let mut source = self.emission.clone();
        if let Some(outside) = &self.outside {
            for patch in 0..source.patches() {
                for column in 0..source.columns() {
                    source.of_mut(patch)[column] += self.rho(patch, column) * outside.of(patch)[column];
                }
            }
        }
        source
    }

    /// R X.
    fn reflect(&self, mut x: Block) -> Block {
        for patch in 0..x.patches() {
            for (column, value) in x.of_mut(patch).iter_mut().enumerate() {
                *value *= self.rho(patch, column);
            }
        }
        x
    }
}

/// Patches that share what they absorb, so that their emission is one black radiosity e times εᵢ: R has the further
/// block εᵢ wⱼ, with wⱼ = Aⱼ εⱼ / Σ A ε. Its rows still sum to 1 at most.
#[derive(Clone, Debug, Default, PartialEq)]
struct Node {
    patches: Vec<u32>,
    /// εᵢ.
    emissivity: Vec<f64>,
    /// wᵢ.
    weight: Vec<f64>,
}

impl Node {
    /// Σⱼ wⱼ xⱼ, a number a column.
    fn shared(&self, x: &Block) -> Vec<f64> {
        let mut sums = vec![0.0; x.columns()];
        for (&patch, weight) in self.patches.iter().zip(&self.weight) {
            for (sum, x) in sums.iter_mut().zip(x.of(patch as usize)) {
                *sum += weight * x;
            }
        }
        sums
    }

    /// Adds εᵢ `shared`.
    fn share(&self, shared: &[f64], to: &mut Block) {
        for (&patch, emissivity) in self.patches.iter().zip(&self.emissivity) {
            for (value, shared) in to.of_mut(patch as usize).iter_mut().zip(shared) {
                *value += emissivity * shared;
            }
        }
    }
}

/// R X, with the nodes' blocks.
fn reflect(problem: &Problem, nodes: &[Node], x: Block) -> Block {
    let shared: Vec<Vec<f64>> = nodes.iter().map(|node| node.shared(&x)).collect();
    let mut reflected = problem.reflect(x);
    for (node, shared) in nodes.iter().zip(&shared) {
        node.share(shared, &mut reflected);
    }
    reflected
}

/// State shared by the methods: the problem, the matrix, the progress.
struct Work<'a> {
    factors: &'a dyn Factors,
    problem: &'a Problem,
    nodes: &'a [Node],
    source: Block,
    /// ‖E + R H‖, or 1 where that and the solution are 0.
    norms: Vec<f64>,
    options: SolveOptions,
    iterations: u32,
    /// Former corrections that GMRES goes along.
    corrections_kept: usize,
    progress: &'a mut dyn FnMut(Step) -> bool,
}

impl Work<'_> {
    fn columns(&self) -> usize {
        self.source.columns()
    }

    /// R X.
    fn reflect(&self, x: Block) -> Block {
        reflect(self.problem, self.nodes, x)
    }

    /// F X + S X.
    fn product(&mut self, x: &Block) -> Result<Block, SolveError> {
        self.iterations += 1;
        let mut product = multiply(self.factors, x, self.options.threads())?;
        if let Some(returned) = &self.problem.returned {
            for (patch, share) in returned.iter().enumerate() {
                for (sum, x) in product.of_mut(patch).iter_mut().zip(x.of(patch)) {
                    *sum += share * x;
                }
            }
        }
        Ok(product)
    }

    /// Tells how far it is; whether all are within the tolerance.
    fn tell(&mut self, relative: &[f64]) -> Result<bool, SolveError> {
        // `max` would pass over NaN.
        let residual = relative.iter().copied().fold(0.0, |most: f64, residual| {
            if most.is_nan() || residual.is_nan() {
                f64::NAN
            } else {
                most.max(residual)
            }
        });
        if !residual.is_finite() {
            return Err(SolveError::Diverged {
                iteration: self.iterations,
                residual,
            });
        }
        let step = Step {
            iteration: self.iterations,
            residual,
        };
        if !(self.progress)(step) {
            return Err(SolveError::Interrupted);
        }
        Ok(residual <= self.options.tolerance)
    }

    fn relative(&self, norms: Vec<f64>) -> Vec<f64> {
        norms
            .into_iter()
            .zip(&self.norms)
            .map(|(norm, whole)| norm / whole)
            .collect()
    }

    fn is_out_of_iterations(&self) -> bool {
        self.iterations >= self.options.max_iterations
    }
}

/// Solves `problem`. `progress` is told of every product with the matrix, and says whether to go on.
///
/// A solution above the tolerance is returned as well, with [`Solution::converged`] false.
///
/// # Errors
/// [`SolveError::Problem`] for a problem of another matrix or out of range (the largest number of a right-hand side
/// must be 0, or from 10⁻²⁰⁰ to 10²⁰⁰), [`SolveError::Store`] when the matrix cannot be read, or has two rows of a
/// patch, [`SolveError::Diverged`] for a NaN residual, [`SolveError::Endless`] for emission in an enclosure that
/// reflects all and lets nothing out, [`SolveError::Interrupted`] when `progress` returned false.
///
/// ```
/// use hemicube_solve::solve::{Block, InMemory, Problem, STEFAN_BOLTZMANN, SolveOptions, solve};
///
/// // Two endless plates at 400 K and 300 K, of emissivity 0.8 and 0.5, see nothing but each other.
/// let (emissivity, kelvin) = ([0.8, 0.5], [400.0_f64, 300.0]);
/// let plates = InMemory::dense(&[vec![0.0, 1.0], vec![1.0, 0.0]]);
/// let problem = Problem {
///     reflectance: Block::from_fn(2, 1, |plate, _| 1.0 - emissivity[plate]),
///     bands: vec![0],
///     emission: Block::from_fn(2, 1, |plate, _| emissivity[plate] * STEFAN_BOLTZMANN * kelvin[plate].powi(4)),
///     outside: None,
///     returned: None,
/// };
/// let options = SolveOptions { tolerance: 1e-12, ..SolveOptions::default() };
/// let solution = solve(&plates, &problem, options, &mut |_| true)?;
///
/// let net = solution.radiosity.of(0)[0] - solution.irradiance.of(0)[0];
/// let textbook = STEFAN_BOLTZMANN * (400.0_f64.powi(4) - 300.0_f64.powi(4)) / (1.0 / 0.8 + 1.0 / 0.5 - 1.0);
/// assert!(solution.converged && (net / textbook - 1.0).abs() < 1e-9, "{net} W/m²");
/// # Ok::<(), hemicube_solve::solve::SolveError>(())
/// ```
pub fn solve(
    factors: &dyn Factors,
    problem: &Problem,
    options: SolveOptions,
    progress: &mut dyn FnMut(Step) -> bool,
) -> Result<Solution, SolveError> {
    problem.check(factors.patch_count())?;
    enclosures::require_an_end(factors, problem, options.threads())?;
    let coupling = Coupling::default();
    solve_coupled(factors, problem, coupling, options, progress)
}

/// Nodes and settings that only a problem of heat has.
#[derive(Clone, Copy, Debug, Default)]
struct Coupling<'a> {
    nodes: &'a [Node],
    /// Former corrections that GMRES goes along.
    corrections_kept: usize,
}

/// E + R H, with the nodes' blocks.
fn source(problem: &Problem, nodes: &[Node]) -> Block {
    let mut source = problem.source();
    if let Some(outside) = &problem.outside {
        for node in nodes {
            node.share(&node.shared(outside), &mut source);
        }
    }
    source
}

/// Right-hand sides solved together where the matrix stays in memory. A choice: with more, their vectors leave a
/// processor's cache, and fewer threads have a group; with fewer, the matrix is gone through more often.
const TOGETHER: usize = 32;
/// Groups from which on a matrix of pairs is made once for all. A choice: making it takes as long as some products.
const MERGED_FROM: usize = 8;

/// [`solve`], with patches coupled by nodes.
///
/// Many right-hand sides of a matrix that stays in memory are solved in groups, by several threads, and those of 0 not
/// at all. Groups do not depend on the threads, nor does what they are solved with.
fn solve_coupled(
    factors: &dyn Factors,
    problem: &Problem,
    coupling: Coupling<'_>,
    options: SolveOptions,
    progress: &mut dyn FnMut(Step) -> bool,
) -> Result<Solution, SolveError> {
    let patches = factors.patch_count();
    problem.check(patches)?;
    let columns = problem.emission.columns();
    if columns <= TOGETHER || !factors.is_in_memory() {
        return solve_together(factors, problem, coupling, options, progress);
    }
    let source = source(problem, coupling.nodes);
    let is_dark = |&column: &usize| {
        let outside = problem.outside.as_ref().map_or(0.0, |outside| outside.largest(column));
        source.largest(column) == 0.0 && outside == 0.0
    };
    let lit: Vec<usize> = (0..columns).filter(|column| !is_dark(column)).collect();
    let groups: Vec<&[usize]> = lit.chunks(TOGETHER).collect();
    let merged = match factors.weights() {
        Some(weights) if groups.len() >= MERGED_FROM => pairs::merged(factors, weights)?,
        _ => None,
    };
    let factors = match &merged {
        Some(merged) => merged,
        None => factors,
    };
    let of_group = |group: &[usize]| {
        let some = |block: &Block| Block::from_fn(patches, group.len(), |patch, at| block.of(patch)[group[at]]);
        Problem {
            reflectance: problem.reflectance.clone(),
            bands: group.iter().map(|&column| problem.bands[column]).collect(),
            emission: some(&problem.emission),
            outside: problem.outside.as_ref().map(some),
            returned: problem.returned.clone(),
        }
    };
    let mut whole = Solution {
        radiosity: Block::zeros(patches, columns),
        irradiance: Block::zeros(patches, columns),
        residuals: vec![0.0; columns],
        iterations: 0,
        converged: true,
    };
    let mut failed: Option<(usize, SolveError)> = None;
    let (next, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
    let workers = options.threads().clamp(1, groups.len().max(1));
    let of_worker = SolveOptions {
        threads: options.threads() / workers,
        ..options
    };
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel(64);
        for _ in 0..workers {
            let sender = sender.clone();
            let (groups, next, is_over, of_group) = (&groups, &next, &is_over, &of_group);
            scope.spawn(move || {
                loop {
                    let place = next.fetch_add(1, Ordering::Relaxed);
                    let Some(group) = groups.get(place) else { break };
                    let mut tell = |step: Step| {
                        let told = sender.send(Told::Step(step));
                        told.is_ok() && !is_over.load(Ordering::Relaxed)
                    };
                    let found = solve_together(factors, &of_group(group), coupling, of_worker, &mut tell);
                    let has_failed = found.is_err();
                    let told = sender.send(Told::Group(place, found));
                    if has_failed || told.is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        for told in receiver {
            match told {
                Told::Step(step) => {
                    if !is_over.load(Ordering::Relaxed) && !progress(step) {
                        is_over.store(true, Ordering::Relaxed);
                    }
                }
                Told::Group(place, Ok(found)) => whole.take(groups[place], &found),
                // The first group's error, whichever thread was faster; after one, others are told to stop.
                Told::Group(place, Err(error)) => {
                    is_over.store(true, Ordering::Relaxed);
                    let is_interruption = |error: &SolveError| matches!(error, SolveError::Interrupted);
                    let is_before = failed.as_ref().is_none_or(|(other, of_other)| {
                        is_interruption(of_other) || !is_interruption(&error) && place < *other
                    });
                    if is_before {
                        failed = Some((place, error));
                    }
                }
            }
        }
    });
    failed.map_or(Ok(whole), |(_, error)| Err(error))
}

/// What a thread tells of its group of right-hand sides, by the group's place.
enum Told {
    Step(Step),
    Group(usize, Result<Solution, SolveError>),
}

impl Solution {
    /// Takes the columns of a group.
    fn take(&mut self, group: &[usize], found: &Self) {
        for (mine, theirs) in [
            (&mut self.radiosity, &found.radiosity),
            (&mut self.irradiance, &found.irradiance),
        ] {
            for patch in 0..theirs.patches() {
                for (&column, value) in group.iter().zip(theirs.of(patch)) {
                    mine.of_mut(patch)[column] = *value;
                }
            }
        }
        for (&column, residual) in group.iter().zip(&found.residuals) {
            self.residuals[column] = *residual;
        }
        self.iterations = self.iterations.max(found.iterations);
        self.converged &= found.converged;
    }
}

/// [`solve_coupled`], of all right-hand sides together.
fn solve_together(
    factors: &dyn Factors,
    problem: &Problem,
    coupling: Coupling<'_>,
    options: SolveOptions,
    progress: &mut dyn FnMut(Step) -> bool,
) -> Result<Solution, SolveError> {
    let nodes = coupling.nodes;
    let source_of = |problem: &Problem| source(problem, nodes);
    let source = source_of(problem);
    let exponents: Vec<i32> = (0..source.columns())
        .map(|column| exponent(source.largest(column)))
        .collect();
    let (down, up): (Vec<i32>, Vec<i32>) = exponents.iter().map(|&e| (-e, e)).unzip();
    let mut scaled = problem.clone();
    scaled.emission.scale_by_powers(&down);
    if let Some(outside) = &mut scaled.outside {
        outside.scale_by_powers(&down);
    }
    let problem = &scaled;
    let source = source_of(problem);
    let norms = source
        .norms()
        .into_iter()
        .map(|norm| if norm > 0.0 { norm } else { 1.0 })
        .collect();
    let mut work = Work {
        factors,
        problem,
        nodes,
        source,
        norms,
        options,
        iterations: 0,
        corrections_kept: coupling.corrections_kept,
        progress,
    };
    let mut radiosity = work.source.clone();
    loop {
        radiosity = match options.method {
            Method::Jacobi => stationary::jacobi(&mut work, radiosity)?,
            Method::GaussSeidel => stationary::gauss_seidel(&mut work, radiosity)?,
            Method::Gmres { restart } => gmres::gmres(&mut work, radiosity, restart)?,
        };
        let mut irradiance = work.product(&radiosity)?;
        if let Some(outside) = &problem.outside {
            irradiance.add_scaled(&vec![1.0; outside.columns()], outside);
        }
        // E + R G − B = E + R H − (I − R F) B.
        let mut residual = work.reflect(irradiance.clone());
        let columns = work.columns();
        residual.add_scaled(&vec![1.0; columns], &problem.emission);
        residual.add_scaled(&vec![-1.0; columns], &radiosity);
        let residuals = work.relative(residual.norms());
        let converged = work.tell(&residuals)?;
        if converged || work.is_out_of_iterations() {
            radiosity.scale_by_powers(&up);
            irradiance.scale_by_powers(&up);
            return Ok(Solution {
                radiosity,
                irradiance,
                residuals,
                iterations: work.iterations,
                converged,
            });
        }
    }
}

/// The exponent of two of a magnitude: 0 for 0, infinities and NaN.
fn exponent(magnitude: f64) -> i32 {
    if magnitude == 0.0 || !magnitude.is_finite() {
        return 0;
    }
    #[allow(clippy::cast_possible_truncation, reason = "within ±1075")]
    let exponent = magnitude.log2().floor() as i32;
    exponent
}

/// Balance of one right-hand side's power, in units of the emission times area.
///
/// emitted + from_outside = absorbed + escaped + blocked + unselected + closure + reciprocity + residual, to rounding.
/// The last three are errors of the matrix and the iteration, 0 for a perfect one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct EnergyBalance {
    /// Σ A E.
    pub emitted: f64,
    /// Σ A H; of mirrors and panes Σ A (1 − ρs − τ) H, the rest being in the H of others.
    pub from_outside: f64,
    /// Σ A (1 − ρ) G; Σ A (1 − ρs − τ − ρ) G.
    pub absorbed: f64,
    /// Left the scene.
    pub escaped: f64,
    /// Ended on backs of one-sided patches; 0 where S returns it.
    pub blocked: f64,
    /// Ended on patches without columns; 0 where S returns it.
    pub unselected: f64,
    /// Lost by rows that do not sum to 1, or made up where negative; 0 where S returns it.
    pub closure: f64,
    /// Returned to the patches themselves (S). Not lost, and in none of the sums.
    pub returned: f64,
    /// Sent to patches without arriving, by Aᵢ Fᵢⱼ ≠ Aⱼ Fⱼᵢ.
    pub reciprocity: f64,
    /// Left by the iteration.
    pub residual: f64,
}

impl EnergyBalance {
    /// Power put in.
    pub fn input(&self) -> f64 {
        self.emitted + self.from_outside
    }

    /// The share of the input that is unaccounted for.
    pub fn unaccounted(&self) -> f64 {
        let input = self.input();
        if input == 0.0 {
            return 0.0;
        }
        (self.closure + self.reciprocity + self.residual) / input
    }
}

/// The balance of each right-hand side. `areas` and `rows` are of the matrix; a row without known hemicubes (NaN)
/// counts as losing nothing.
///
/// ```
/// use hemicube_solve::solve::{Block, OutOfCore, Problem, SolveOptions, energy_balance, solve};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
///
/// // The first patch alone shines, in a grey room whose matrix stays on the disk.
/// let count = store.patch_count() as usize;
/// let problem = Problem {
///     reflectance: Block::from_fn(count, 1, |_, _| 0.5),
///     bands: vec![0],
///     emission: Block::from_fn(count, 1, |patch, _| if patch == 0 { 1.0 } else { 0.0 }),
///     outside: None,
///     returned: Some(store.row_table()?.returned()),
/// };
/// let solution = solve(&OutOfCore::new(&store, 0)?, &problem, SolveOptions::default(), &mut |_| true)?;
/// let areas = store.patches()?.area;
/// let power = energy_balance(&problem, &solution, &areas, &store.row_table()?)[0];
/// assert!((power.emitted / areas[0] - 1.0).abs() < 1e-12);
/// let gone = power.absorbed + power.escaped + power.blocked + power.closure + power.reciprocity + power.residual;
/// assert!((gone / power.emitted - 1.0).abs() < 1e-9, "each watt is in one of these");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn energy_balance(problem: &Problem, solution: &Solution, areas: &[f64], rows: &RowTable) -> Vec<EnergyBalance> {
    let known = |share: f64| if share.is_nan() { 0.0 } else { share };
    let mut balances = vec![EnergyBalance::default(); problem.emission.columns()];
    for (patch, &area) in areas.iter().enumerate() {
        let shares = [rows.escaped[patch], rows.blocked[patch], rows.unselected[patch]].map(known);
        let kept = rows.kept(patch);
        let sum = known(rows.row_sum[patch]) - rows.passed_of(patch);
        for (column, balance) in balances.iter_mut().enumerate() {
            let radiosity = solution.radiosity.of(patch)[column];
            let irradiance = solution.irradiance.of(patch)[column];
            let emission = problem.emission.of(patch)[column];
            let outside = problem
                .outside
                .as_ref()
                .map_or(0.0, |outside| outside.of(patch)[column]);
            let rho = problem.rho(patch, column);
            let leaving = area * radiosity;
            balance.emitted += area * emission;
            balance.from_outside += area * kept * outside;
            balance.absorbed += area * (kept - rho) * irradiance;
            let returned = leaving * kept * problem.back(patch);
            balance.returned += returned;
            balance.escaped += leaving * shares[0];
            if problem.returned.is_none() {
                balance.blocked += leaving * shares[1];
                balance.unselected += leaving * shares[2];
                balance.closure += leaving * (1.0 - sum - shares.iter().sum::<f64>());
            } else {
                balance.closure += leaving * (1.0 - sum - shares[0]) - returned;
            }
            balance.reciprocity += leaving * sum - (area * kept * (irradiance - outside) - returned);
            balance.residual += area * (emission + rho * irradiance - radiosity);
        }
    }
    balances
}
