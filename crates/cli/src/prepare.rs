//! From a scene's file to a model: read, scale, repair, cut, order. Shared by all commands that read scenes.

use crate::again;
use crate::args::{
    AutoSwitch, Correction, Engine, EngineSettings, RenderSettings as RenderArguments, SceneSettings, Switch, Talk,
    UpAxis,
};
use crate::exit::hinted;
use crate::report::{Input, counted, size};
use anyhow::{Context, Result, anyhow};
use hemicube::backend::{BackendError, HemicubeBackend};
use hemicube::driver::input::{SceneInput, SceneSettings as GivenSettings};
use hemicube::driver::room::{self, Work};
pub(crate) use hemicube::driver::settings::axis_name;
use hemicube::store::Store;
use hemicube::{Grouping, HierarchyOptions, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice, with_close};
use hemicube_host::{Environment, LoadedBackend, OPENS_LIBRARIES, OpenError, Options, Registry, Search};
use hemicube_scene::repair::RepairReport;
use hemicube_scene::{Axis, Budget, Patches, ReadOptions, Scene, Subdivision, Triangle};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// A scene ready for hemicubes.
pub(crate) struct Prepared {
    pub(crate) scene: SceneInput,
    pub(crate) patches: Arc<Patches>,
    pub(crate) model: Model,
    /// The patches of a matrix that are several of the scene's triangles; `None`: each is one.
    pub(crate) grouping: Option<Grouping>,
    pub(crate) input: Input,
    /// What is taken for it, here and later.
    pub(crate) budget: Budget,
    pub(crate) load_seconds: f64,
    pub(crate) build_seconds: f64,
}

/// Numbers of triangles dropped or noted by the repair, in reports.
#[derive(Debug, Serialize)]
pub(crate) struct RepairCounts {
    pub(crate) non_finite: u64,
    pub(crate) degenerate: u64,
    pub(crate) duplicates: u64,
    pub(crate) duplicates_dropped: u64,
    pub(crate) reversed_duplicates: u64,
}

impl From<&RepairReport> for RepairCounts {
    fn from(report: &RepairReport) -> Self {
        Self {
            non_finite: report.non_finite,
            degenerate: report.degenerate,
            duplicates: report.duplicates,
            duplicates_dropped: report.duplicates_dropped,
            reversed_duplicates: report.reversed_duplicates,
        }
    }
}

impl Prepared {
    /// The axis that points up, for every command: `--up`, else the file's or the matrix's, else what names and normals
    /// leave no doubt of.
    ///
    /// # Errors
    /// When nothing tells.
    pub(crate) fn up(&self, given: Option<UpAxis>) -> Result<Axis> {
        if let Some(axis) = given {
            return Ok(axis.into());
        }
        let found = hemicube_scene::up::up(&self.scene);
        found.known().ok_or_else(|| {
            hinted(
                anyhow!("`{}` does not say which axis points up", self.input.path),
                format!(
                    "`--up x`, `--up y` or `--up z` does; {} is {}",
                    axis_name(found.axis),
                    found.reason
                ),
            )
        })
    }

    /// The axis that points up, guessed where neither a user nor the file says it.
    pub(crate) fn up_or_guess(&self, given: Option<UpAxis>, talk: Talk) -> Axis {
        let found = hemicube_scene::up::up(&self.scene);
        match given {
            Some(axis) => axis.into(),
            None => {
                talk.say(&format!("up is {} ({})", axis_name(found.axis), found.reason));
                found.axis
            }
        }
    }

    /// Tells where [`Self::up`] comes from, unless a user or the file said it.
    pub(crate) fn tell_up(&self, given: Option<UpAxis>, talk: Talk) {
        let found = hemicube_scene::up::up(&self.scene);
        if given.is_none() && found.source == hemicube_scene::up::Source::Found {
            talk.say(&format!("up is {} ({})", axis_name(found.axis), found.reason));
        }
    }

    /// Tells what was not taken as the file says, and, to those who ask for more, what is only noted.
    pub(crate) fn tell(&self, talk: Talk) {
        let Self { scene, .. } = self;
        let repaired = &scene.repaired;
        for sentence in scene.ledger.sentences() {
            talk.warn(&sentence);
        }
        // A scale that was given is the user's own.
        let unit = scene.metres_per_unit.filter(|_| scene.settings.scale == 1.0);
        if let Some(metres) = unit.filter(|metres| (metres - 1.0).abs() > 1e-9) {
            talk.warn(&format!(
                "the file's unit is {metres} m, and its lengths are taken as they stand; heat in watts needs metres: \
                 `--scale {metres}`"
            ));
        }
        for (what, number) in scene.ledger.notes() {
            talk.detail(&format!("in the file: {} × {what}", crate::report::count(number)));
        }
        if let Some(crs) = &scene.crs {
            talk.detail(&format!("coordinates are in `{}`", crate::escape::shown(crs)));
        }
        if repaired.reversed_duplicates > 0 {
            let number = counted(repaired.reversed_duplicates, "triangle");
            talk.detail(&format!("in the scene: {number} back to back with others, kept"));
        }
    }
}

impl SceneSettings {
    /// Refuses two ways of cutting at once, where no layers of settings decide between them.
    ///
    /// # Errors
    /// When both are given.
    pub(crate) fn require_one_cut(&self) -> Result<()> {
        if self.split.is_some() && self.patch_size.is_some() {
            return Err(anyhow!(
                "`--split` and `--patch-size` are two ways to cut triangles; give one of them"
            ));
        }
        Ok(())
    }

    /// Subdivision of triangles. At most one of the two settings is left when the layers are gathered.
    pub(crate) fn subdivision(&self) -> Subdivision {
        match (self.split, self.patch_size) {
            (Some(pieces), _) => Subdivision::Split(pieces),
            (_, Some(length)) => Subdivision::PatchSize(length),
            _ => Subdivision::None,
        }
    }

    /// Takes the memory limit of the environment where the command line has none: a command without settings in files.
    ///
    /// # Errors
    /// When the variable is no size.
    pub(crate) fn settle_memory(&mut self) -> Result<()> {
        let Some(text) = std::env::var_os("HEMICUBE_MEMORY").filter(|_| self.memory.is_none()) else {
            return Ok(());
        };
        let size = crate::args::bytes(&text.to_string_lossy()).map_err(|reason| anyhow!("`HEMICUBE_MEMORY`: {reason}"));
        self.memory = Some(size?);
        Ok(())
    }

    /// The memory that the scene and what comes of it may take.
    pub(crate) fn budget(&self) -> Budget {
        Budget::new(self.memory)
    }

    /// The settings of the scene by the library's names.
    pub(crate) fn given(&self) -> GivenSettings {
        GivenSettings {
            subdivision: self.subdivision(),
            two_sided: match self.two_sided {
                AutoSwitch::Auto => None,
                AutoSwitch::On => Some(true),
                AutoSwitch::Off => Some(false),
            },
            flip: self.flip.clone(),
            exclude: self.exclude.clone(),
            keep_duplicates: self.keep_duplicates == Switch::On,
            scale: self.scale,
            up: self.up.map(Into::into),
        }
    }
}

impl AsRef<EngineSettings> for EngineSettings {
    fn as_ref(&self) -> &EngineSettings {
        self
    }
}

impl AsRef<EngineSettings> for RenderArguments {
    fn as_ref(&self) -> &EngineSettings {
        &self.engine
    }
}

impl RenderArguments {
    /// Number of worker threads.
    pub(crate) fn thread_count(&self) -> usize {
        self.engine.thread_count()
    }

    /// The work that memory is asked for.
    pub(crate) fn work(&self) -> Work {
        match self.correction {
            Correction::Tolerance => Work::Fractions,
            Correction::Pixel => Work::Pixels,
        }
    }

    /// Opens the backend asked for. Where memory is limited, its sessions share a quarter on devices that have no memory
    /// of their own: [`of_devices`].
    ///
    /// # Errors
    /// When there is none of that name, or it does not open.
    pub(crate) fn open_backend(&self, memory: Option<u64>, talk: Talk) -> Result<Box<dyn HemicubeBackend>> {
        let options = Options::parse(&self.engine.backend_option)?;
        let options = match memory {
            Some(limit) => options.within(of_devices(limit) / self.thread_count().max(1) as u64),
            None => options,
        };
        self.engine.open_with(&options, talk)
    }
}

/// The share of a limit of memory that devices without memory of their own may take. A choice: with less, large scenes
/// are refused there; with more, fewer threads are left.
pub(crate) fn of_devices(limit: u64) -> u64 {
    limit / 4
}

impl EngineSettings {
    /// Subdivision of the octree.
    pub(crate) fn hierarchy(&self) -> HierarchyOptions {
        HierarchyOptions::default()
    }

    /// Number of worker threads.
    pub(crate) fn thread_count(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads as usize,
        }
    }

    /// Where no engine is asked for, takes that of an earlier matrix by the built-in backend: rows are taken over from
    /// one with the same alone, and a change of the scene may make another suit it. A matrix that cannot be read is
    /// told later.
    pub(crate) fn follow(&mut self, earlier: &Path) {
        if self.engine == Engine::Auto
            && [BUILT_IN, "auto"].contains(&self.backend.as_str())
            && let Ok(store) = Store::open(earlier)
            && store.manifest().backend.name == BUILT_IN
        {
            self.engine = match EngineChoice::of_version(&store.manifest().backend.version) {
                EngineChoice::Order => Engine::Order,
                _ => Engine::Depth,
            };
        }
    }

    /// Opens the backend asked for. A named one never becomes another; `auto` tells its choice and the reason.
    ///
    /// # Errors
    /// When there is none of that name, or it does not open.
    pub(crate) fn open_backend(&self, talk: Talk) -> Result<Box<dyn HemicubeBackend>> {
        self.open_with(&Options::parse(&self.backend_option)?, talk)
    }

    fn open_with(&self, options: &Options, talk: Talk) -> Result<Box<dyn HemicubeBackend>> {
        // Engines are the built-in backend's: choosing one chooses it.
        if self.backend == BUILT_IN || (self.backend == "auto" && self.engine != Engine::Auto) {
            return self.built_in(options);
        }
        let registry = registry();
        if self.backend != "auto" {
            let backend = registry.open(&self.backend, options).map_err(|error| {
                let hint = match &error {
                    OpenError::Backend {
                        source: BackendError::InvalidArgument(_),
                        ..
                    } => "`device`, `passes` and `rays` are options of every backend",
                    _ => BACKENDS_HINT,
                };
                hinted(error.into(), hint)
            })?;
            return self.loaded(backend);
        }
        // Not those of this run: a store must not depend on how many compute it. Where another part of a store was
        // computed with other processors to hand, the two backends are told apart, and naming one settles it.
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let auto = registry.auto(options, threads);
        let taken = auto.taken.as_ref().map_or(BUILT_IN, |backend| backend.library().name());
        let reasons: Vec<String> = auto
            .passed_over
            .iter()
            .map(|other| format!("; {}: {}", other.name, other.reason))
            .collect();
        let text = format!("backend auto takes `{taken}`{}", reasons.concat());
        // With nothing else installed there was no choice.
        if auto.passed_over.iter().all(|other| !other.installed) && auto.taken.is_none() {
            talk.detail(&text);
        } else {
            talk.say(&text);
        }
        match auto.taken {
            Some(backend) => self.loaded(backend),
            None => self.built_in(options),
        }
    }

    fn built_in(&self, options: &Options) -> Result<Box<dyn HemicubeBackend>> {
        if !options.is_empty() {
            return Err(hinted(
                anyhow!("backend `{BUILT_IN}` has no options, and `--backend-option` is given"),
                "name the backend that the option is for with `--backend`",
            ));
        }
        let engine = match self.engine {
            Engine::Auto => EngineChoice::Auto,
            Engine::Depth => EngineChoice::Depth,
            Engine::Order => EngineChoice::Order,
            Engine::Claims => EngineChoice::Claims,
        };
        Ok(Box::new(CpuBackend::new().with_engine(engine)))
    }

    fn loaded(&self, backend: LoadedBackend) -> Result<Box<dyn HemicubeBackend>> {
        if self.engine != Engine::Auto {
            return Err(anyhow!(
                "`--engine` is a setting of backend `{BUILT_IN}`, and `{}` is used",
                backend.library().name()
            ));
        }
        Ok(with_close(Box::new(backend)))
    }
}

/// The program's own backend.
pub(crate) const BUILT_IN: &str = "cpu";

/// The next step where a backend is not to be had.
pub(crate) const BACKENDS_HINT: &str = if OPENS_LIBRARIES {
    "`hemicube backends list` shows what is installed"
} else {
    "`--backend cpu` is built in; the package of hemicube that is linked with glibc has the others"
};

/// The places searched for backends.
pub(crate) fn registry() -> Registry {
    let mut environment = Environment::of_process();
    if again::is_guest() {
        // Files beside Python are not hemicube's.
        environment.program = None;
    }
    Registry::new(Search::new(&[], &environment), &[BUILT_IN])
}

/// Reads the scene at `path` and makes a model of it for `work`, within `--memory` or the machine's memory.
///
/// # Errors
/// When it cannot be read, no triangle of it can be used, or there would be too many patches.
pub(crate) fn prepare(
    path: &Path,
    settings: &SceneSettings,
    engine: &impl AsRef<EngineSettings>,
    work: Work,
) -> Result<Prepared> {
    prepare_of(path, settings, engine, work, None)?.with_context(|| format!("`{}` cannot be computed", path.display()))
}

/// Likewise for a scene of `patch_count` patches; `None`, before it is cut, where it has another number.
///
/// # Errors
/// As [`prepare`].
pub(crate) fn prepare_of(
    path: &Path,
    settings: &SceneSettings,
    engine: &impl AsRef<EngineSettings>,
    work: Work,
    patch_count: Option<u32>,
) -> Result<Option<Prepared>> {
    let started = Instant::now();
    let options = ReadOptions {
        optics: false,
        allow_large: settings.allow_large,
        budget: settings.budget(),
    };
    let scene = hemicube_scene::load(path, options)?;
    let input = Input::of(path)?;
    let scene = SceneInput::new(scene, path, settings.given()).map_err(|error| {
        let what = match error.list {
            "exclude" => "no object and no material",
            _ => "no object with one-sided triangles",
        };
        hinted(anyhow!("`--{} {}` matches {what}", error.list, error.glob), error.there)
    })?;
    let load_seconds = started.elapsed().as_secs_f64();
    let useless = scene.repaired.non_finite + scene.repaired.degenerate;
    if scene.triangles.is_empty() && useless < scene.triangles_read && !settings.exclude.is_empty() {
        return Err(hinted(
            anyhow!(
                "`--exclude` leaves none of the {} of `{}`",
                counted(scene.triangles_read, "triangle"),
                path.display()
            ),
            "name fewer objects or materials",
        ));
    }
    if scene.triangles.is_empty() {
        return Err(anyhow!(
            "`{}` holds no triangle that can be used: of {}, {} not finite and {} without area",
            path.display(),
            counted(scene.triangles_read, "triangle"),
            are(scene.repaired.non_finite),
            are(scene.repaired.degenerate),
        ));
    }

    if let Some(patch_count) = patch_count {
        let cut = settings.subdivision();
        let of_triangle = |triangle: &Triangle| {
            cut.count(&triangle.corners)
                .saturating_mul(if triangle.two_sided { 2 } else { 1 })
        };
        let found = scene.triangles.iter().map(of_triangle).fold(0, u64::saturating_add);
        if found != u64::from(patch_count) {
            return Ok(None);
        }
    }
    let started = Instant::now();
    require_room(path, &scene, settings, work)?;
    let patches = Patches::new(&scene, settings.subdivision()).map_err(|error| error.in_file(path))?;
    let patches = Arc::new(patches);
    let model = Model::new(Arc::clone(&patches), engine.as_ref().hierarchy())
        .with_context(|| format!("`{}` cannot be computed", path.display()))?;
    let build_seconds = started.elapsed().as_secs_f64();
    Ok(Some(Prepared {
        scene,
        patches,
        model,
        grouping: None,
        input,
        budget: settings.budget(),
        load_seconds,
        build_seconds,
    }))
}

/// Refuses to cut a scene into more patches than fit the memory, and names the finest subdivision that fits.
fn require_room(path: &Path, scene: &Scene, settings: &SceneSettings, work: Work) -> Result<()> {
    let cut = settings.subdivision();
    // More than a matrix can have: refused with another message.
    if Patches::count(scene, cut) > u64::from(hemicube::store::PATCH_COUNT_MAX) {
        return Ok(());
    }
    let Err(refused) = room::require(scene, cut, work, settings.budget()) else {
        return Ok(());
    };
    let room = &refused.room;
    let of = match room.allowed {
        Some(allowed) => format!("`--memory` of {}", size(allowed)),
        None => format!("this machine has {} of memory", size(room.left)),
    };
    let error = anyhow!(
        "{of}: `{}` would be {}, which may take {}",
        path.display(),
        counted(refused.patch_count, "patch"),
        size(room.bytes)
    );
    let finest = match refused.finest {
        Some(Subdivision::Levels(levels)) => Some(format!("--split {}", 1u64 << levels.min(32))),
        Some(Subdivision::Split(pieces)) => Some(format!("--split {pieces}")),
        Some(Subdivision::PatchSize(length)) => Some(format!("--patch-size {length}")),
        Some(Subdivision::None) | None => None,
    };
    // In whole megabytes, so that it does suffice.
    let allows = format!("`--memory {}M` allows it", room.megabytes());
    Err(hinted(
        error,
        match finest {
            Some(setting) => format!("`{setting}` is the finest that surely fits; {allows}"),
            None => format!("{allows}; otherwise cut the scene into several"),
        },
    ))
}

fn are(count: u64) -> String {
    if count == 1 {
        "1 is".to_owned()
    } else {
        format!("{} are", crate::report::count(count))
    }
}
