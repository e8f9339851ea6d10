//! Heat for `hemicube solve`: conditions, surroundings, and what is asked about them.

use super::moments::{Moments, Surroundings};
use super::surfaces::{EnclosuresOfHeat, Results};
use super::{Arguments, Sunlight, Surfaces, Work, in_parallel};
use crate::args::{By, Talk};
use crate::exit::hinted;
use crate::materials;
use crate::report::{counted, figures, percent};
use crate::stored;
use anyhow::{Result, anyhow, bail};
use hemicube::PatchKind;
use hemicube::analysis::exchange::Network;
use hemicube::analysis::surfaces::{MatrixTables, heat_by_surface, heat_errors, row_errors};
use hemicube::analysis::zones::require_kind;
use hemicube::sky::StoredSky;
use hemicube::solve::{
    Block, Condition, Enclosures, Factors, Heat, HeatSolution, Named, OPEN, Problem, Properties, Reading, Solution,
    SolveError, SolveOptions, Step, Temperature, Thermal, Undetermined, disagreement, enclosures, open_share,
    question_of_cold, solve, solve_heats,
};
use hemicube::store::{Manifest, PatchTable, RowTable, Store};
use serde::Serialize;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// Surfaces named of a solution that did not converge.
const UNSETTLED_SHOWN: usize = 3;
/// A surface in the report: a material, or an object's patches of one material.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Recorded {
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    object: Option<String>,
    emissivity: f64,
    /// In kelvin; `None` where it is found.
    temperature: Option<f64>,
    /// In W/m².
    #[serde(skip_serializing_if = "Option::is_none")]
    flux: Option<f64>,
    /// In W.
    #[serde(skip_serializing_if = "Option::is_none")]
    heat: Option<f64>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    isothermal: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    body: Option<String>,
}

/// Extent in metres from which a scene of machines or rooms is taken to be in millimetres, and the least where a name
/// says so. A city of this size is asked about for nothing, a smaller bound would ask about more of them.
const EXTENT_ASKED: [f64; 2] = [1000.0, 10.0];

/// Asks once whether lengths are millimetres, where heat in watts depends on it.
fn question_of_unit(manifest: &Manifest, table: &PatchTable) -> Option<String> {
    let scale = manifest.settings["scale"].as_f64().unwrap_or(1.0);
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for centroid in &table.centroid {
        for axis in 0..3 {
            low[axis] = low[axis].min(centroid[axis]);
            high[axis] = high[axis].max(centroid[axis]);
        }
    }
    let extent = low.iter().zip(high).map(|(low, high)| high - low).fold(0.0, f64::max);
    let says_so = |name: &str| {
        let name = name.to_ascii_lowercase();
        name.split(|c: char| !c.is_ascii_alphabetic())
            .any(|word| matches!(word, "mm" | "millimetre" | "millimeter"))
    };
    let named = says_so(&manifest.scene.file) || manifest.objects.iter().take(100).any(|name| says_so(name));
    let due = if named { EXTENT_ASKED[1] } else { EXTENT_ASKED[0] };
    (scale == 1.0 && extent >= due).then(|| {
        format!(
            "the scene is {} across, taken for metres; if they are millimetres, compute it with `--scale 0.001`: heat in \
             watts goes with the area",
            crate::report::figures(extent)
        )
    })
}

impl Recorded {
    fn of(kind: &Thermal) -> Self {
        let mut recorded = Self {
            name: kind.material.clone(),
            object: kind.object.clone(),
            emissivity: kind.emissivity.unwrap_or(0.0),
            temperature: None,
            flux: None,
            heat: None,
            isothermal: false,
            body: kind.body.clone(),
        };
        match kind.condition {
            Condition::Temperature(given) => recorded.temperature = Some(given.kelvin()),
            // An adiabatic surface reflects all, whatever its emissivity.
            Condition::Flux(0.0) => recorded.emissivity = 0.0,
            Condition::Flux(flux) => recorded.flux = Some(flux),
            Condition::Heat(heat) => recorded.heat = Some(heat),
            Condition::IsothermalFlux(flux) => (recorded.flux, recorded.isothermal) = (Some(flux), true),
            Condition::IsothermalHeat(heat) => (recorded.heat, recorded.isothermal) = (Some(heat), true),
        }
        recorded
    }
}

/// Says which surfaces absorb what they do not reflect, for want of an absorptance.
fn tell_of_absorptances(absorptances: &[(f64, bool)], kind_of_patch: &[u32], talk: Talk) {
    let mut is_used = vec![false; absorptances.len()];
    kind_of_patch.iter().for_each(|&kind| is_used[kind as usize] = true);
    let guessed: Vec<f64> = absorptances
        .iter()
        .zip(is_used)
        .filter(|((_, is_guessed), is_used)| *is_guessed && *is_used)
        .map(|((absorptance, _), _)| *absorptance)
        .collect();
    if guessed.is_empty() {
        return;
    }
    let (least, most) = guessed
        .iter()
        .fold((1.0f64, 0.0f64), |(least, most), &a| (least.min(a), most.max(a)));
    talk.warn(&format!(
        "{} without an `absorptance`: 1 less the reflectance is taken, {least:.2} to {most:.2}",
        counted(guessed.len() as u64, "surface")
    ));
}

/// Sunlight that each patch absorbs after all reflections, in W/m²: a vector a moment. `arriving` is what arrives from
/// outside, and `of` the absorptance of a patch.
fn absorbed(
    arguments: &Arguments,
    factors: &dyn Factors,
    (table, rows): (&PatchTable, &RowTable),
    arriving: &Block,
    of: &dyn Fn(usize) -> f64,
    work: &Work<'_>,
) -> Result<Vec<Vec<f64>>> {
    let (patches, moments) = (table.len(), arriving.columns());
    let absorptance: Vec<f64> = (0..patches).map(|patch| of(patch).min(rows.kept(patch))).collect();
    let mut found = Vec::with_capacity(moments);
    let at_once = usize::try_from(work.at_once).unwrap_or(usize::MAX);
    while found.len() < moments {
        let first = found.len();
        let count = at_once.min(moments - first);
        let problem = Problem {
            reflectance: Block::from_fn(patches, 1, |patch, _| rows.kept(patch) - absorptance[patch]),
            bands: vec![0; count],
            emission: Block::from_fn(patches, count, |_, _| 0.0),
            outside: Some(Block::from_fn(patches, count, |patch, column| {
                arriving.of(patch)[first + column]
            })),
            returned: Some(rows.returned()),
        };
        let mut progress = |_: Step| !work.cancel.load(Ordering::SeqCst);
        let solution = solve(factors, &problem, arguments.options(), &mut progress)?;
        if !solution.converged {
            bail!(
                "the residual of reflected sunlight did not reach {}; allow more with `--max-iterations`, or give what \
                 reflects nearly all an absorptance",
                figures(arguments.residual)
            );
        }
        found.extend((0..count).map(|column| {
            let of = |patch: usize| absorptance[patch] * solution.irradiance.of(patch)[column];
            (0..patches).map(of).collect::<Vec<f64>>()
        }));
    }
    Ok(found)
}

/// An exchange of heat between the patches of a matrix.
pub(super) struct Exchange {
    thermal: Vec<Thermal>,
    kind_of_patch: Vec<u32>,
    heat: Heat,
    surroundings: Surroundings,
    moments: Moments,
    pub(super) sunlight: Vec<Sunlight>,
    /// Grouping of the results by surface.
    by: By,
    /// Surfaces of one radiosity in place of patches.
    network: Option<Network>,
    manifest: Manifest,
    enclosures: Enclosures,
    reading: Reading,
    store: PathBuf,
    undetermined: Undetermined,
    /// Number of surfaces with emissivities of the scene, and the least and greatest of these.
    of_scene: Option<(usize, f64, f64)>,
}

impl Exchange {
    pub(super) fn new(
        arguments: &Arguments,
        (store, factors): (&Store, &dyn Factors),
        table: &PatchTable,
        rows: &RowTable,
        properties: &Properties,
        work: Work<'_>,
    ) -> Result<Self> {
        let thermal = properties.thermal().map_err(materials::told)?;
        let mut heat = Heat::new(&thermal, properties.kind_of_patch(), &table.area, rows)?;
        let ambient = arguments
            .sky_temperature
            .map_or(0.0, hemicube::solve::Temperature::kelvin);
        let ground = arguments.ground_temperature.map(hemicube::solve::Temperature::kelvin);
        let surroundings = match ground {
            None => Surroundings {
                above: rows.escaped.clone(),
                ambient,
                ground: None,
            },
            Some(ground) => {
                let below = below_horizon(arguments, store, &rows.escaped)?;
                let above = rows.escaped.iter().zip(&below).map(|(escaped, below)| escaped - below);
                Surroundings {
                    above: above.collect(),
                    ambient,
                    ground: Some((ground, below)),
                }
            }
        };
        surroundings.surround(&mut heat, ambient);
        let (load, kelvin) = (arguments.load.as_deref(), arguments.schedule.as_deref());
        let suns = work.sun.as_ref().map(|(suns, _)| *suns);
        let mut moments = Moments::read(load, kelvin, suns, store.manifest(), table)?;
        if let (None, Some(suns)) = (arguments.sky_temperature, suns) {
            moments.take_skies(suns);
        }
        if let (Some(planets), Some(suns)) = (&work.planets, suns) {
            moments.take_planets(planets, suns);
        }
        let sunlight = match &work.sun {
            None => Vec::new(),
            Some((_, arriving)) => {
                let absorptances = properties.absorptances().map_err(materials::told)?;
                tell_of_absorptances(&absorptances, properties.kind_of_patch(), work.talk);
                let of = |patch: usize| absorptances[properties.kind_of_patch()[patch] as usize].0;
                let absorbed = absorbed(arguments, factors, (table, rows), arriving, &of, &work)?;
                let watts =
                    |of: &dyn Fn(usize) -> f64| (0..table.len()).map(|patch| table.area[patch] * of(patch)).sum();
                let sunlight = absorbed.iter().enumerate().map(|(moment, absorbed)| Sunlight {
                    arriving: watts(&|patch| arriving.of(patch)[moment]),
                    absorbed: watts(&|patch| absorbed[patch]),
                });
                let sunlight = sunlight.collect();
                moments.absorb(absorbed);
                sunlight
            }
        };
        let of_scene = properties.emissivities_of_scene();
        let is_asked = arguments.by.is_some()
            || arguments.network
            || arguments.output.iter().any(|output| arguments.is_by_surface(output));
        let by = match (arguments.by, store.manifest().patch_kind()) {
            (None, PatchKind::Material) => By::Material,
            (None, PatchKind::Triangle | PatchKind::Face) if !is_asked && properties.are_of_materials() => By::Material,
            (given, _) => given.unwrap_or(By::Object),
        };
        require_kind(store, by.group())?;
        let manifest = store.manifest().clone();
        let network = match arguments.network {
            false => None,
            true => Some(Network::new(store, Some(by.group()), arguments.reading())?),
        };
        let found = enclosures(factors)?;
        let named = Named {
            objects: &manifest.objects,
            materials: &manifest.materials,
            object: &table.object,
            material: &table.material,
        };
        let mut exchange = Self {
            by,
            network,
            manifest: manifest.clone(),
            heat,
            surroundings,
            moments,
            sunlight,
            enclosures: found,
            undetermined: Undetermined::default(),
            reading: arguments.reading(),
            store: store.directory().to_owned(),
            of_scene,
            kind_of_patch: properties.kind_of_patch().to_vec(),
            thermal,
        };
        let all: Vec<usize> = (0..exchange.moments.len()).collect();
        let threads = arguments.options().threads();
        let check = |&moment: &usize| -> Result<Undetermined> {
            let (heat, load) = exchange.of_patches(moment)?;
            if let Some(network) = &exchange.network {
                of_surfaces(network, &heat, load.as_deref())?;
            }
            let heat = match load {
                Some(load) => heat.with_load(&load)?,
                None => heat,
            };
            let undetermined = heat.require_temperatures(&exchange.enclosures, &rows.escaped, named);
            undetermined.map_err(|error| exchange.told_at(moment, error))
        };
        let mut undetermined = Undetermined::default();
        for found in in_parallel(&all, threads, &check) {
            undetermined = found?;
        }
        exchange.undetermined = undetermined;
        Ok(exchange)
    }

    /// The exchange of the patches at the temperatures of a moment, and what these take up.
    fn of_patches(&self, moment: usize) -> Result<(Heat, Option<Vec<f64>>)> {
        let heat = self.moments.at(moment, &self.heat, &self.surroundings)?;
        Ok((heat, self.moments.load_at(moment)?))
    }

    /// Number of moments.
    pub(super) fn moments(&self) -> usize {
        self.moments.len()
    }

    /// Names of the moments; none where there are no tables over moments.
    pub(super) fn names_of_moments(&self) -> &[String] {
        self.moments.names()
    }

    /// An error with the moment that it is of.
    fn told_at(&self, moment: usize, error: SolveError) -> anyhow::Error {
        let error = match &error {
            SolveError::Impossible { patch, .. } => {
                let surface = self.shown(*patch);
                anyhow::Error::new(error).context(format!("{surface} cannot be"))
            }
            _ => anyhow::Error::new(error),
        };
        match self.moments.names().get(moment) {
            Some(name) if self.moments.len() > 1 => error.context(format!("at `{name}`")),
            _ => error,
        }
    }

    /// Asks once whether temperatures are in kelvin, and about the surroundings of an open scene.
    pub(super) fn question(&self, arguments: &Arguments, table: &PatchTable, rows: &RowTable, talk: Talk) {
        let mut cold: Vec<String> = Vec::new();
        for kind in self.thermal.iter().filter(|kind| kind.is_used) {
            if let Condition::Temperature(given) = kind.condition
                && given.kelvin() < Temperature::COLD
                && !given.is_celsius()
            {
                cold.push(format!("{} K of {}", given.kelvin(), kind.shown()));
            }
        }
        for (given, name) in [
            (arguments.sky_temperature, "--sky-temperature"),
            (arguments.ground_temperature, "--ground-temperature"),
        ] {
            if let Some(given) = given.filter(|given| !given.is_celsius())
                && given.kelvin() > 0.0
                && given.kelvin() < Temperature::COLD
            {
                cold.push(format!("{} K of `{name}`", given.kelvin()));
            }
        }
        cold.extend(self.moments.cold());
        if let Some(question) = question_of_cold(&cold) {
            talk.warn(&question);
        }
        if let Some(question) = question_of_unit(&self.manifest, table) {
            talk.warn(&question);
        }
        let share = open_share(rows, &table.area);
        let is_said = arguments.sky_temperature.is_some() || self.moments.has_surroundings();
        if let Some(share) = share.filter(|_| !is_said) {
            talk.warn(&format!(
                "{} of the view leaves the scene, and what lies outside is taken to be at 0 K; `--sky-temperature \
                 KELVIN` says how warm it is (0: cold space)",
                percent(share)
            ));
        }
        let lost = self.undetermined.patches.iter().filter(|&&is| is).count();
        if lost > 0 {
            talk.warn(&format!(
                "nothing determines the temperature of {}, of {}: they are adiabatic, and see nothing that has one; \
                 the solution has 0 K there",
                counted(lost as u64, "patch"),
                self.undetermined.names
            ));
        }
    }

    pub(super) fn recorded(&self) -> Surfaces {
        Surfaces::Heat {
            materials: self.thermal.iter().map(Recorded::of).collect(),
            ambient: self.surroundings.ambient,
            ambients: self.ambients(),
            ground: self.surroundings.ground.as_ref().map(|(kelvin, _)| *kelvin),
        }
    }

    /// The temperature of what lies above at each moment, in kelvin, where tables give it.
    fn ambients(&self) -> Vec<f64> {
        if !self.moments.has_surroundings() {
            return Vec::new();
        }
        let of = |moment| self.moments.ambient(moment, self.surroundings.ambient);
        (0..self.moments.len()).map(of).collect()
    }

    /// The surface of a patch, in words.
    pub(super) fn shown(&self, patch: usize) -> String {
        self.thermal[self.kind_of_patch[patch] as usize].shown()
    }

    /// Solves some moments together; `None` where interrupted.
    pub(super) fn solve(
        &self,
        factors: &dyn Factors,
        moments: Range<usize>,
        options: SolveOptions,
        progress: &mut dyn FnMut(Step) -> bool,
    ) -> Result<Option<Vec<HeatSolution>>> {
        let first = moments.start;
        let at = |moment: usize| {
            let (heat, load) = self.of_patches(moment)?;
            match (&self.network, load) {
                (Some(network), load) => of_surfaces(network, &heat, load.as_deref()),
                (None, Some(load)) => Ok(heat.with_load(&load)?),
                (None, None) => Ok(heat),
            }
        };
        let heats = moments.map(at).collect::<Result<Vec<Heat>>>()?;
        let found = match &self.network {
            None => solve_heats(factors, &heats, options, progress),
            Some(network) => solve_heats(&network.factors, &heats, options, progress)
                .map(|found| found.into_iter().map(|found| spread(network, found)).collect()),
        };
        match (found, &self.network) {
            (Ok(found), _) => Ok(Some(found)),
            (Err(SolveError::Interrupted), _) => Ok(None),
            (Err(SolveError::Impossible { patch, count }), Some(network)) => {
                let is_of = |&of: &u32| of as usize == patch;
                let patch = network.of_patch.iter().position(is_of).unwrap_or(0);
                Err(self.told_at(first, SolveError::Impossible { patch, count }))
            }
            (Err(error), _) => Err(self.told_at(first, error)),
        }
    }

    /// The surfaces with most of the residual of a solution that did not converge, as the end of a sentence.
    pub(super) fn unsettled(&self, found: &HeatSolution) -> Option<String> {
        if found.solution.converged {
            return None;
        }
        let mut left: Vec<(f64, usize)> = (0..self.thermal.len()).map(|kind| (0.0, kind)).collect();
        for (patch, &kind) in self.kind_of_patch.iter().enumerate() {
            let (sent, received) = (
                found.solution.radiosity.of(patch)[0],
                found.solution.irradiance.of(patch)[0],
            );
            let reflected = found.problem.reflectance.of(patch)[0] * received;
            let off = found.problem.emission.of(patch)[0] + reflected - sent;
            left[kind as usize].0 += self.heat.area[patch] * off.abs();
        }
        left.sort_by(|a, b| b.0.total_cmp(&a.0));
        let worst = left.iter().take(UNSETTLED_SHOWN).filter(|(off, _)| *off > 0.0);
        let worst: Vec<String> = worst
            .map(|&(off, kind)| format!("{} ({} W)", self.thermal[kind].shown(), figures(off)))
            .collect();
        Some(format!("; most is left of {}", worst.join(", ")))
    }

    fn tables<'t>(&'t self, table: &'t PatchTable, rows: &'t RowTable) -> MatrixTables<'t> {
        MatrixTables {
            patches: table,
            rows,
            names: [&self.manifest.objects, &self.manifest.materials],
        }
    }

    /// The enclosures, and what is not known of their heat.
    pub(super) fn enclosures(
        &self,
        factors: &dyn Factors,
        table: &PatchTable,
        rows: &RowTable,
        found: &HeatSolution,
    ) -> Result<EnclosuresOfHeat, SolveError> {
        let patches = table.len();
        let radiosity = |patch: usize| found.solution.radiosity.of(patch)[0];
        let flux = |patch: usize| radiosity(patch) - rows.kept(patch) * found.solution.irradiance.of(patch)[0];
        let heat: Vec<f64> = (0..patches).map(|patch| table.area[patch] * flux(patch)).collect();
        let sent: Vec<f64> = (0..patches).map(|patch| table.area[patch] * radiosity(patch)).collect();
        let black = |kept: f64, radiosity: f64| if kept > 0.0 { radiosity / kept } else { 0.0 };
        let mut error = match &self.network {
            None => row_errors(rows),
            Some(network) => {
                let of = network.row_errors();
                network.of_patch.iter().map(|&surface| of[surface as usize]).collect()
            }
        };
        error.iter_mut().zip(&heat).for_each(|(error, heat)| *error *= heat);
        if self.reading == Reading::AsStored {
            let differ = match &self.network {
                None => {
                    let kept: Vec<f64> = (0..patches).map(|patch| rows.kept(patch)).collect();
                    let blacks: Vec<f64> = (0..patches).map(|patch| black(kept[patch], radiosity(patch))).collect();
                    disagreement(factors, &table.area, &kept, &blacks)?
                }
                Some(network) => {
                    let kept: Vec<f64> = (0..network.len()).map(|surface| network.kept(surface)).collect();
                    let mut blacks = vec![0.0; network.len()];
                    for (patch, &surface) in network.of_patch.iter().enumerate() {
                        blacks[surface as usize] = black(kept[surface as usize], radiosity(patch));
                    }
                    let of = disagreement(&network.factors, &network.area, &kept, &blacks)?;
                    let share = |(patch, &surface): (usize, &u32)| {
                        of[surface as usize] * table.area[patch] / network.area[surface as usize]
                    };
                    network.of_patch.iter().enumerate().map(share).collect()
                }
            };
            error
                .iter_mut()
                .zip(differ)
                .for_each(|(error, differs)| *error += differs);
        }
        let residual = found.solution.residuals.iter().copied().fold(0.0, f64::max);
        let errors = heat_errors([&heat, &error, &sent], &self.enclosures, &self.kind_of_patch, residual);
        let shown = |body: u32| self.thermal[body as usize].shown();
        Ok(EnclosuresOfHeat::new(
            &self.enclosures,
            self.tables(table, rows),
            &errors,
            &shown,
        ))
    }

    /// What is to be told of heat of which too little is known.
    pub(super) fn warnings(&self, enclosures: &EnclosuresOfHeat) -> Vec<String> {
        let why = match self.reading {
            Reading::Pairs => "rows of the matrix do not close",
            Reading::AsStored => "A[i] F[i, j] is not A[j] F[j, i] in the matrix as it is stored",
        };
        let told = enclosures.unsure().map(|(what, error)| {
            format!(
                "the heat of {what} is known within {} only, {} W of {}: {why}; `hemicube balance {} -o OUT` \
                 closes it, and a smaller `--tolerance` of `compute` measures it",
                percent(error.share()),
                figures(error.error),
                figures(error.heat),
                self.store.display()
            )
        });
        told.collect()
    }

    /// Results by surface.
    pub(super) fn by_surface(
        &self,
        table: &PatchTable,
        rows: &RowTable,
        found: &HeatSolution,
        enclosures: EnclosuresOfHeat,
    ) -> Results {
        let by = self.by;
        let temperature: Vec<f64> = (found.temperature.iter().enumerate())
            .map(|(patch, &kelvin)| {
                let is_open = self.undetermined.patches.get(patch).copied().unwrap_or(false);
                if is_open { f64::NAN } else { kelvin }
            })
            .collect();
        // Of this moment, whose surroundings may be others than those of the scene.
        let outside: Option<Vec<f64>> = found
            .problem
            .outside
            .as_ref()
            .map(|outside| outside.column(0).collect());
        let of = self.tables(table, rows);
        let (surfaces, balance) = heat_by_surface(of, by.group(), &found.solution, outside.as_deref(), &temperature);
        let residual = found.solution.residuals.iter().copied().fold(0.0, f64::max);
        Results::new(by, self.reading, surfaces, balance, enclosures)
            .with_residual(residual)
            .with_emissivities(self.of_scene)
    }
}

/// The exchange of a network's surfaces, of that of their patches: loads are spread over each surface.
fn of_surfaces(network: &Network, heat: &Heat, load: Option<&[f64]>) -> Result<Heat> {
    let surfaces = network.heat(heat).map_err(|name| {
        hinted(
            anyhow!("the patches of `{name}` have several conditions or emissivities, and a surface has one"),
            "give its object one in a table `[object.\"…\"]`, or take smaller surfaces: `--by face`",
        )
    })?;
    let Some(load) = load else { return Ok(surfaces) };
    let mut mean = vec![0.0; network.len()];
    for ((&surface, area), load) in network.of_patch.iter().zip(&heat.area).zip(load) {
        let surface = surface as usize;
        if network.area[surface] > 0.0 {
            mean[surface] += area * load / network.area[surface];
        }
    }
    Ok(surfaces.with_load(&mean)?)
}

/// The solution of a network, given to the patches of its surfaces.
fn spread(network: &Network, found: HeatSolution) -> HeatSolution {
    let patches = network.of_patch.len();
    let of = |block: &Block| {
        Block::from_fn(patches, block.columns(), |patch, column| {
            block.of(network.of_patch[patch] as usize)[column]
        })
    };
    let vector = |values: &[f64]| -> Vec<f64> {
        let surfaces = network.of_patch.iter();
        surfaces.map(|&surface| values[surface as usize]).collect()
    };
    HeatSolution {
        temperature: vector(&found.temperature),
        problem: Problem {
            reflectance: of(&found.problem.reflectance),
            bands: found.problem.bands,
            emission: of(&found.problem.emission),
            outside: found.problem.outside.as_ref().map(of),
            returned: found.problem.returned.as_deref().map(vector),
        },
        solution: Solution {
            radiosity: of(&found.solution.radiosity),
            irradiance: of(&found.solution.irradiance),
            ..found.solution
        },
    }
}

/// The share of each patch's view that leaves the scene below the horizon, by its sky rows.
pub(super) fn below_horizon(arguments: &Arguments, store: &Store, escaped: &[f64]) -> Result<Vec<f64>> {
    let path = match &arguments.sky {
        Some(path) => path.clone(),
        None => stored::sky(store).map_err(|error| {
            hinted(
                error.context("`--ground-temperature` needs to know what leaves the scene below the horizon"),
                format!(
                    "`hemicube sky SCENE --matrix {}` computes it, with `--up` where the scene does not say",
                    store.directory().display()
                ),
            )
        })?,
    };
    let sky = StoredSky::open(&path)?;
    if sky.rows() != escaped.len() {
        bail!(
            "`{}` is of {}, and the matrix of {}",
            path.display(),
            counted(sky.rows() as u64, "patch"),
            escaped.len()
        );
    }
    let share = |row: usize| {
        let (columns, shares) = sky.row(row);
        // Column 0 is the ground.
        let ground = columns
            .iter()
            .position(|&column| column == 0)
            .map_or(0.0, |at| shares[at]);
        let whole: f64 = shares.iter().sum();
        let escaped = escaped[row];
        // A sky of a resolution of its own loses another share: the part of it below the horizon is what counts.
        if whole > 0.0 && escaped > 0.0 {
            Ok(escaped * (ground / whole).min(1.0))
        } else if escaped > OPEN {
            Err(anyhow!(
                "`{}` says nothing of where {} of the view of patch {row} leaves the scene",
                path.display(),
                percent(escaped)
            ))
        } else {
            Ok(0.0)
        }
    };
    (0..escaped.len()).map(share).collect()
}
