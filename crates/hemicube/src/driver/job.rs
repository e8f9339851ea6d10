//! The conductor of a run, used by the program, by Python and by embedders.
//!
//! ```text
//! Job::prepare        selection ▶ storage policy ▶ accuracy level ▶ plan ▶ culling ▶ backend loaded    Run
//! Run::compute        rows ▶ parts ▶ a sink of the caller                                              Summary
//! Run::open           store made, or resumed with the parts that it has                                StoreRun
//! StoreRun::compute   missing rows ▶ parts ▶ store ▶ manifest                                          Finished
//! ```
//!
//! Whoever opens a store decides between the steps: how many threads the memory allows, whether the disk has room.
//! [`Job::rows`] and [`Job::store`] take all steps at once.

use crate::backend::{Culling, HemicubeBackend, RenderSettings};
use crate::driver::compute::{
    self, Band, ComputeError, Execution, PartSink, Plan, Progress, RowChoice, Selection, Summary, compute_bands,
};
use crate::driver::input::SceneInput;
use crate::driver::level::{Asked, Level, LevelError, Rows};
use crate::driver::probe::Probe;
use crate::driver::selection::{Names, NoMatch};
use crate::driver::settings::{ReadingRecord, RowSettings};
use crate::driver::storage_policy::StoragePolicy;
use crate::driver::update::{Update, UpdateError};
use crate::portal::{Images, Portals};
use crate::store::{
    Error as StoreError, Form, Header, Manifest, Part, PatchTable, Resumed, Shard, Store, StoreWriter, optics_of,
};
use crate::{Grouping, Model, PatchKind};
use hemicube_scene::{InputPatch, Patches};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A request for rows of a scene's matrix. The default asks for all rows, to the default tolerance ([`Asked::default`]).
///
/// ```
/// use hemicube::driver::input::SceneInput;
/// use hemicube::driver::job::{Job, Sessions};
/// use hemicube_backend_cpu::CpuBackend;
/// use hemicube_scene::{Subdivision, generate};
///
/// let scene = SceneInput::new(generate::cornell_box(), "room.obj", Subdivision::Split(2).into())?;
/// let model = scene.model(Default::default())?;
/// let job = Job { emitters: vec!["light".to_owned()], ..Job::default() };
/// let parts = job.rows(&scene, &model, Sessions::new(CpuBackend::new))?;
/// assert_eq!(parts.iter().map(|part| part.rows.len()).sum::<usize>(), 8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// The accuracy level, by its settings or by a tolerance.
    pub accuracy: Asked,
    /// True to turn each hemicube about its normal.
    pub rotate: bool,
    /// Rows to compute, among the emitting patches'.
    pub rows: RowChoice,
    /// Globs for patches with rows; empty: all.
    pub emitters: Vec<String>,
    /// Globs for patches with columns; empty: all.
    pub receivers: Vec<String>,
    /// Globs for patches with neither, which only occlude.
    pub occluders: Vec<String>,
    /// Kind of the patches: rows and columns.
    pub patches: PatchKind,
    /// The store's form; `None`: by the scene's size.
    pub form: Option<Form>,
    /// Smaller form factors are left out, from 0 up to 1; `None`: by the scene's size.
    pub min_factor: Option<f64>,
    /// Culling; `None`: on if it pays in a few trial hemicubes. Changes no bit of a row.
    pub culling: Option<Culling>,
    /// True to render trial hemicubes even if `culling` is given, for [`Run::probe`].
    pub forecasts: bool,
    /// Worker threads; 0: one a core.
    pub threads: usize,
    /// Hemicubes a call of the backend; 0: its preference.
    pub batch: usize,
    /// Mirrors, panes, and images of the cell. With images, the model has them, too ([`Images::model`]).
    pub portals: Arc<Portals>,
    /// The matrix of an earlier state of the scene: rows of patches that see nothing of what changed are taken over.
    /// The model has its numbers ([`Update::number`]).
    pub update: Option<Arc<Update>>,
}

impl Default for Job {
    fn default() -> Self {
        Self {
            accuracy: Asked::default(),
            rotate: true,
            rows: RowChoice::All,
            emitters: Vec::new(),
            receivers: Vec::new(),
            occluders: Vec::new(),
            patches: PatchKind::Triangle,
            form: None,
            min_factor: None,
            culling: None,
            forecasts: false,
            threads: 0,
            batch: 0,
            portals: Arc::default(),
            update: None,
        }
    }
}

/// Two sessions of one backend without a shared scene.
pub struct Sessions {
    /// Renders the rows.
    pub rows: Box<dyn HemicubeBackend>,
    /// Renders the sample for the calibration of a tolerance.
    pub calibration: Box<dyn HemicubeBackend>,
}

impl Sessions {
    /// Two sessions by `open`.
    pub fn new<B: HemicubeBackend + 'static>(mut open: impl FnMut() -> B) -> Self {
        Self {
            rows: Box::new(open()),
            calibration: Box::new(open()),
        }
    }
}

impl std::fmt::Debug for Sessions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sessions").field("backend", self.rows.info()).finish()
    }
}

/// A stage of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// The accuracy level is chosen; a tolerance is calibrated.
    Calibrate,
    /// Rows are planned, trial hemicubes rendered, the scene loaded into the backend.
    Build,
    /// The store is made or resumed.
    Store,
    /// Rows are computed.
    Rows {
        /// Rows of elements in all, resumed ones included.
        row_count: u64,
        /// Rows of elements resumed from the store.
        resumed: u64,
    },
    /// The manifest is written.
    Finish,
}

/// A choice made by a run, for its log.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Note<'a> {
    /// The reason of the accuracy level.
    Level(&'a str),
    /// The storage that was chosen because the scene is large.
    Storage(&'a StoragePolicy),
    /// The trial hemicubes behind the choice of culling.
    Culling(&'a Probe),
}

/// Follows a run, on the thread that called. Every method does nothing by default; `()` follows nothing.
pub trait Observer {
    /// A stage begins.
    fn begin(&self, stage: Stage) {
        let _ = stage;
    }

    /// A stage is over, or has failed.
    fn end(&self, stage: Stage) {
        let _ = stage;
    }

    /// A choice was made.
    fn note(&self, note: Note<'_>) {
        let _ = note;
    }

    /// Rows were computed, resumed ones not counted. Called some times a second in [`Stage::Rows`].
    fn progress(&self, progress: Progress) {
        let _ = progress;
    }

    /// Ends the run when it becomes true; see [`Execution::cancel`].
    fn cancel(&self) -> Option<&AtomicBool> {
        None
    }
}

impl Observer for () {}

/// Ends its stage when it is dropped.
struct InStage<'a>(&'a dyn Observer, Stage);

impl<'a> InStage<'a> {
    fn begin(observer: &'a dyn Observer, stage: Stage) -> Self {
        observer.begin(stage);
        Self(observer, stage)
    }
}

impl Drop for InStage<'_> {
    fn drop(&mut self) {
        self.0.end(self.1);
    }
}

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// A glob matches no patch.
    #[error(transparent)]
    NoMatch(#[from] NoMatch),
    /// Portals that rows cannot go through as asked.
    #[error("{reason}")]
    Portals {
        /// Why not.
        reason: &'static str,
    },
    /// A patch has triangles with different mirrors or panes.
    #[error(
        "the {} `{name}` has triangles with different optics, and a patch has one ρs and one τ",
        kind.name()
    )]
    MixedOptics {
        /// The kind of the patches.
        kind: PatchKind,
        /// The patch.
        name: String,
        /// A kind by which no patch is mixed.
        by: &'static str,
    },
    /// No accuracy level keeps the tolerance, or calibration failed.
    #[error(transparent)]
    Level(#[from] LevelError),
    /// A glob takes some elements of a patch, and not others.
    #[error(transparent)]
    Partly(#[from] PartlySelected),
    /// No row can be taken over.
    #[error(transparent)]
    Update(#[from] UpdateError),
    /// The selection leaves no row.
    #[error("no row is left to compute: the rows, emitters and occluders asked for exclude every patch")]
    NoRows,
    /// The backend failed before the first row, or rows without a store failed.
    #[error(transparent)]
    Compute(#[from] ComputeError),
    /// Rows of a store failed.
    #[error(transparent)]
    Rows(#[from] Box<RowsFailed>),
    /// The store cannot be made, resumed, finished or read.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// A selection takes a patch in part.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{list}` leaves {selected} of the {elements} triangles of the {} `{name}`, and a patch has its row and its column \
     whole or not at all",
    kind.name()
)]
pub struct PartlySelected {
    /// The list: `emitters`, `receivers` or `occluders`.
    pub list: &'static str,
    /// The kind of the patches.
    pub kind: PatchKind,
    /// The patch.
    pub name: String,
    /// Number of its elements selected.
    pub selected: u64,
    /// Number of its elements.
    pub elements: u64,
}

/// Rows failed, and the store has the parts before them.
#[derive(Debug, thiserror::Error)]
#[error("rows failed when `{}` had {parts} of {part_count} parts", directory.display())]
pub struct RowsFailed {
    /// The failure.
    pub source: ComputeError,
    /// The store.
    pub directory: PathBuf,
    /// Parts in the store.
    pub parts: u64,
    /// Parts of the run.
    pub part_count: u64,
    /// True if the manifest names the parts. They are resumed even if it does not.
    pub are_named: bool,
}

/// The place of a store.
#[derive(Clone, Copy, Debug)]
pub struct StorePlace<'a> {
    /// The store's directory; made if it is missing.
    pub directory: &'a Path,
    /// True to replace a store that is there, false to resume it.
    pub overwrite: bool,
    /// The share of the parts to compute; `None`: all.
    pub shard: Option<Shard>,
}

impl<'a> From<&'a Path> for StorePlace<'a> {
    fn from(directory: &'a Path) -> Self {
        Self {
            directory,
            overwrite: false,
            shard: None,
        }
    }
}

/// Receives the parts of a store, resumed ones first, on the thread that writes them.
pub type PartListener<'a> = &'a mut (dyn FnMut(&Part) + Send);

impl Job {
    /// Asks for a relative Frobenius error in place of an accuracy level's settings.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f64) -> Self {
        self.accuracy = Asked::Tolerance(tolerance);
        self
    }

    /// Makes every choice that rows depend on, and loads the scene into the backend.
    ///
    /// # Errors
    /// When a glob matches no patch, no row is left, a tolerance cannot be kept, or the backend fails.
    pub fn prepare<'m>(
        &self,
        scene: &SceneInput,
        model: &'m Model,
        sessions: Sessions,
        observer: &dyn Observer,
    ) -> Result<Run<'m>, JobError> {
        let patches = self.cell(model);
        let (selection, grouping) = self.selection(scene, model)?;
        let selection = self.with_images(selection, model);
        let patch_count = grouping.as_ref().map_or(patches.len(), |grouping| grouping.len());
        let patch_count = u32::try_from(patch_count).unwrap_or(u32::MAX);
        let policy = StoragePolicy::choose(self.form, self.min_factor, patch_count, self.accuracy.tolerance());
        let stage = InStage::begin(observer, Stage::Calibrate);
        let Sessions {
            rows: mut backend,
            mut calibration,
        } = sessions;
        let threads = match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let execution = Execution {
            threads,
            batch: self.batch,
            cancel: observer.cancel(),
        };
        let images = self.portals.images.as_ref();
        let of_images = grouping.as_deref().zip(images);
        let of_images = of_images.map(|(of_cell, images)| images.grouping(of_cell, model.geometry().patch_count));
        let level = match (&self.update, self.accuracy) {
            (Some(update), Asked::Tolerance(tolerance)) => Level::of_update(tolerance, policy.form, update)?,
            _ => Level::resolve(
                self.accuracy,
                model,
                Rows {
                    selection: &selection,
                    grouping: of_images.as_ref().or(grouping.as_deref()),
                },
                self.rotate,
                policy.form,
                calibration.as_mut(),
                execution,
            )?,
        };
        drop(calibration);
        drop(stage);

        let _stage = InStage::begin(observer, Stage::Build);
        let plan = Plan::grouped(
            model,
            self.rows,
            selection,
            level.samples_per_edge,
            self.rotate,
            grouping,
        )
        .with_correction(level.correction)
        .with_min_factor(policy.min_factor)
        .with_form(policy.form)
        .with_portals(Arc::clone(&self.portals));
        if plan.rows.is_empty() {
            return Err(JobError::NoRows);
        }
        if let Some(reason) = &level.reason {
            observer.note(Note::Level(reason));
        }
        if policy.is_form_chosen || policy.is_min_factor_chosen {
            observer.note(Note::Storage(&policy));
        }
        let mut render = RenderSettings {
            resolution: level.resolution,
            culling: self.culling.unwrap_or(Culling::On),
            covered: false,
        };
        let probe = self.probe(model, &plan, &mut render, backend.as_mut(), observer)?;
        // Choices of a backend by the scene are part of the store's header.
        compute::load(model, &plan.correction, render, backend.as_mut())?;
        // Rows would build it, and memory is asked for before them.
        plan.correction.prepare(model);
        let mut run = Run {
            settings: self.row_settings(scene, &plan, &level),
            threads,
            batch: self.batch,
            plan,
            bands: Vec::new(),
            render,
            probe,
            model,
            backend,
        };
        if let Some(update) = &self.update {
            update.require_same(&run.settings, &run.header(&run.settings, &run.plan, scene)?)?;
            run.plan.taken = Some(Arc::new(Arc::clone(update).taken(model, execution)));
            if execution.is_cancelled() {
                return Err(ComputeError::Cancelled.into());
            }
        }
        Ok(run)
    }

    /// The patches of the scene given, without images.
    fn cell<'p>(&'p self, model: &'p Model) -> &'p Patches {
        let images = self.portals.images.as_ref();
        images.map_or_else(|| model.patches(), Images::cell)
    }

    /// The patches chosen and their grouping. Refuses what rows through portals do not have.
    fn selection(&self, scene: &SceneInput, model: &Model) -> Result<(Selection, Option<Arc<Grouping>>), JobError> {
        let names = Names {
            emitters: &self.emitters,
            receivers: &self.receivers,
            occluders: &self.occluders,
        };
        let patches = self.cell(model);
        let selection = Selection::by_name(scene, patches, names)?;
        self.check_portals(&selection)?;
        let grouping = Grouping::new(scene, patches, self.patches).map(Arc::new);
        if let Some(grouping) = &grouping {
            self.require_whole(&selection, grouping, scene, patches)?;
            self.require_one_kind_of_optics(grouping, scene, patches)?;
        }
        Ok((selection, grouping))
    }

    /// Renders trial hemicubes where a forecast or the choice of culling needs them, and makes that choice.
    fn probe(
        &self,
        model: &Model,
        plan: &Plan,
        render: &mut RenderSettings,
        backend: &mut dyn HemicubeBackend,
        observer: &dyn Observer,
    ) -> Result<Option<Probe>, JobError> {
        if !self.forecasts && self.culling.is_some() {
            return Ok(None);
        }
        let found = Probe::render(model, plan, *render, backend, observer.cancel())?;
        if self.culling.is_none() {
            render.culling = found.culling();
            observer.note(Note::Culling(&found));
        }
        Ok(Some(found))
    }

    /// Refuses what rows through portals do not have.
    fn check_portals(&self, selection: &Selection) -> Result<(), JobError> {
        let refused = |reason: &'static str| Err(JobError::Portals { reason });
        let receives = |patch: u32| selection.receives(patch);
        let Some(specular) = &self.portals.specular else {
            return Ok(());
        };
        if !specular.portals().all(receives) {
            return refused("mirrors and panes need columns: what arrives there is a part of what they hand on");
        }
        Ok(())
    }

    /// The selection of a model with images: rows of the cell alone, columns of all images of a patch.
    fn with_images(&self, selection: Selection, model: &Model) -> Selection {
        let Some(images) = &self.portals.images else {
            return selection;
        };
        let (count, cell) = (model.geometry().patch_count, images.cell().len());
        let emits = |patch: u32| (patch as usize) < cell && selection.emits(InputPatch(patch));
        // Curtains have columns until they are taken out as what was cut off.
        let receives = |patch: u32| images.fold(patch).is_none_or(|patch| selection.receives(patch));
        Selection {
            emitters: Some((0..count).map(emits).collect()),
            receivers: Some((0..count).map(receives).collect()),
        }
    }

    /// Settings of the rows, for the store's header and for reports.
    fn row_settings(&self, scene: &SceneInput, plan: &Plan, level: &Level) -> RowSettings {
        let given = &scene.settings;
        RowSettings {
            resolution: level.resolution,
            samples: u32::try_from(plan.hemicubes_per_row()).unwrap_or(u32::MAX),
            correction: level.correction.name(),
            tolerance: self.accuracy.tolerance(),
            reason: level.reason.clone(),
            price: level.correction.price(),
            update: self.update.as_ref().map(|update| update.id()),
            rotation: self.rotate,
            subdivision: given.subdivision.into(),
            two_sided: given.two_sided_name(),
            flip: given.flip.clone(),
            exclude: given.exclude.clone(),
            keep_duplicates: given.keep_duplicates,
            scale: given.scale,
            up: scene.up_name(),
            rows: self.rows.into(),
            emitters: self.emitters.clone(),
            receivers: self.receivers.clone(),
            occluders: self.occluders.clone(),
            min_factor: (plan.min_factor > 0.0).then_some(plan.min_factor),
            patches: self.patches,
            elements: plan.groups.as_ref().map(|groups| groups.grouping.elements() as u64),
            portals: (!self.portals.is_empty()).then(|| self.portals.record()),
            reading: ReadingRecord::of(scene),
        }
    }

    /// Refuses a selection that takes patches in part: their area is that of all their elements.
    fn require_whole(
        &self,
        selection: &Selection,
        grouping: &Grouping,
        scene: &SceneInput,
        patches: &Patches,
    ) -> Result<(), PartlySelected> {
        for (list, globs, chosen) in [
            ("emitters", &self.emitters, &selection.emitters),
            ("receivers", &self.receivers, &selection.receivers),
        ] {
            if let Some((patch, selected, elements)) = chosen.as_ref().and_then(|chosen| grouping.partly(chosen)) {
                let list = if globs.is_empty() { "occluders" } else { list };
                return Err(PartlySelected {
                    list,
                    kind: self.patches,
                    name: grouping.name_of(patch, scene, patches),
                    selected,
                    elements,
                });
            }
        }
        Ok(())
    }

    /// Refuses patches whose elements are different mirrors or panes than the patch is by its names.
    fn require_one_kind_of_optics(
        &self,
        grouping: &Grouping,
        scene: &SceneInput,
        patches: &Patches,
    ) -> Result<(), JobError> {
        let Some(specular) = &self.portals.specular else {
            return Ok(());
        };
        let table = PatchTable::grouped(scene, patches, grouping);
        let settings = serde_json::json!({ "portals": self.portals.record() });
        let materials: Vec<String> = scene.materials.iter().map(|material| material.name.clone()).collect();
        let of_patches = optics_of(&settings, [&scene.objects, &materials], &table).unwrap_or_default();
        let is_other = |element: &InputPatch| {
            let own = specular.of(element.0);
            let of_patch = of_patches
                .get(grouping.patch_of(*element).0 as usize)
                .copied()
                .flatten();
            let of_patch = of_patch.map_or([0.0; 2], |optics| [optics.specular, optics.transmittance]);
            [own.specular, own.transmittance] != of_patch
        };
        match patches.iter().find(is_other) {
            None => Ok(()),
            Some(element) => Err(JobError::MixedOptics {
                kind: self.patches,
                name: grouping.name_of(grouping.patch_of(element), scene, patches),
                by: PatchKind::Face.name(),
            }),
        }
    }

    /// Computes the rows into memory.
    ///
    /// # Errors
    /// Those of [`Self::prepare`], and a failing row.
    pub fn rows(&self, scene: &SceneInput, model: &Model, sessions: Sessions) -> Result<Vec<Part>, JobError> {
        let mut parts = Vec::new();
        self.prepare(scene, model, sessions, &())?.compute(&mut parts, &())?;
        Ok(parts)
    }

    /// Computes the rows into a store, or the missing ones of an existing store, and opens it.
    ///
    /// # Errors
    /// Those of [`Self::prepare`], [`Run::open`] and [`StoreRun::compute`].
    pub fn store(
        &self,
        scene: &SceneInput,
        model: &Model,
        sessions: Sessions,
        directory: &Path,
    ) -> Result<Store, JobError> {
        let listener: PartListener<'_> = &mut |_| {};
        let run = self.prepare(scene, model, sessions, &())?;
        run.open(scene, directory.into(), listener, &())?
            .compute(listener, &())?;
        Ok(Store::open(directory)?)
    }
}

/// A prepared run: every choice is made, and the scene is loaded into the backend.
pub struct Run<'m> {
    /// Settings of the rows.
    pub settings: RowSettings,
    /// The rows to compute.
    pub plan: Plan,
    /// Settings loaded into the backend.
    pub render: RenderSettings,
    /// Findings of the trial hemicubes, if any were rendered.
    pub probe: Option<Probe>,
    /// Worker threads, 1 or more; may be lowered before rows are computed.
    pub threads: usize,
    batch: usize,
    /// Settings and plans of further bands.
    bands: Vec<(RowSettings, Plan)>,
    model: &'m Model,
    backend: Box<dyn HemicubeBackend>,
}

impl std::fmt::Debug for Run<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut shown = f.debug_struct("Run");
        shown.field("settings", &self.settings).field("render", &self.render);
        shown.field("threads", &self.threads).finish_non_exhaustive()
    }
}

impl<'m> Run<'m> {
    /// The backend, with the scene loaded.
    pub fn backend(&self) -> &dyn HemicubeBackend {
        self.backend.as_ref()
    }

    /// Adds a band: a matrix for other values of the same scene's mirrors and panes, which shares what rows see
    /// directly with that of `job`. [`Self::open_bands`] takes a place for each.
    ///
    /// # Errors
    /// Those of [`Job::prepare`] for a job of these portals.
    pub fn with_band(mut self, job: &Job, scene: &SceneInput, portals: Arc<Portals>) -> Result<Self, JobError> {
        let of_band = Job {
            portals: Arc::clone(&portals),
            ..job.clone()
        };
        of_band.selection(scene, self.model)?;
        let settings = RowSettings {
            portals: Some(portals.record()),
            ..self.settings.clone()
        };
        let plan = self.plan.clone().with_portals(portals);
        self.bands.push((settings, plan));
        Ok(self)
    }

    /// Headers of the matrices, this run's and those of further bands.
    ///
    /// # Errors
    /// Those of [`RowSettings::header`].
    pub fn headers(&self, scene: &SceneInput) -> Result<Vec<Header>, StoreError> {
        let first = (&self.settings, &self.plan);
        let further = self.bands.iter().map(|(settings, plan)| (settings, plan));
        let all = std::iter::once(first).chain(further);
        all.map(|(settings, plan)| self.header(settings, plan, scene)).collect()
    }

    fn header(&self, settings: &RowSettings, plan: &Plan, scene: &SceneInput) -> Result<Header, StoreError> {
        settings.header(scene, self.patches(plan), &scene.file, plan, self.backend.info())
    }

    /// The patches of the scene given, without images.
    fn patches<'p>(&'p self, plan: &'p Plan) -> &'p Patches {
        let images = plan.portals.images.as_ref();
        images.map_or_else(|| self.model.patches(), Images::cell)
    }

    /// Computes the rows of the plan, without further bands, and hands their parts to `sink`.
    ///
    /// # Errors
    /// Those of [`compute`](compute::compute).
    pub fn compute(mut self, sink: &mut dyn PartSink, observer: &dyn Observer) -> Result<Summary, ComputeError> {
        self.bands.clear();
        let summaries = self.compute_bands(&mut [sink], observer)?;
        summaries.into_iter().next().ok_or(ComputeError::Cancelled)
    }

    /// [`Self::compute`] for this run and its further bands, a sink each.
    ///
    /// # Errors
    /// As for [`Self::compute`].
    ///
    /// # Panics
    /// When sinks are not as many as bands, the first included.
    pub fn compute_bands(
        self,
        sinks: &mut [&mut dyn PartSink],
        observer: &dyn Observer,
    ) -> Result<Vec<Summary>, ComputeError> {
        assert_eq!(sinks.len(), self.bands.len() + 1, "a sink for each band");
        let stage = Stage::Rows {
            row_count: self.plan.elements_of(self.plan.wanted()),
            resumed: 0,
        };
        let _stage = InStage::begin(observer, stage);
        let execution = Execution {
            threads: self.threads,
            batch: self.batch,
            cancel: observer.cancel(),
        };
        let progress = &mut |progress| observer.progress(progress);
        let plans = std::iter::once(&self.plan).chain(self.bands.iter().map(|(_, plan)| plan));
        let mut bands: Vec<Band<'_>> = plans
            .zip(sinks)
            .map(|(plan, sink)| Band {
                plan,
                sink: &mut **sink,
            })
            .collect();
        compute_bands(self.model, &mut bands, self.render, self.backend, execution, progress)
    }

    /// Makes a store for the rows, or resumes the one at `place`: its parts go to `listener`, and are not computed
    /// again.
    ///
    /// # Errors
    /// Those of [`StoreWriter::create`] and [`StoreWriter::resume`].
    pub fn open(
        self,
        scene: &SceneInput,
        place: StorePlace<'_>,
        listener: PartListener<'_>,
        observer: &dyn Observer,
    ) -> Result<StoreRun<'m>, StoreError> {
        self.open_bands(scene, &[place], &mut [listener], observer)
    }

    /// [`Self::open`] for this run and its further bands, a place and a listener each. Parts that any of the stores
    /// lacks are computed for all.
    ///
    /// # Errors
    /// As for [`Self::open`].
    ///
    /// # Panics
    /// When places or listeners are not as many as bands, the first included.
    pub fn open_bands(
        mut self,
        scene: &SceneInput,
        places: &[StorePlace<'_>],
        listeners: &mut [PartListener<'_>],
        observer: &dyn Observer,
    ) -> Result<StoreRun<'m>, StoreError> {
        let _stage = InStage::begin(observer, Stage::Store);
        let further = std::mem::take(&mut self.bands);
        assert_eq!(places.len(), further.len() + 1, "a place for each band");
        assert_eq!(listeners.len(), places.len(), "a listener for each band");
        let first = (self.settings.clone(), self.plan.clone());
        let mut stores = Vec::with_capacity(places.len());
        for (((settings, plan), place), listener) in std::iter::once(first).chain(further).zip(places).zip(listeners) {
            stores.push(self.open_store(&settings, plan, scene, *place, &mut **listener)?);
        }
        let mut missing: Vec<u32> = stores.iter().flat_map(|store| store.missing.iter().copied()).collect();
        missing.sort_unstable();
        missing.dedup();
        Ok(StoreRun {
            run: self,
            stores,
            missing,
        })
    }

    fn open_store(
        &self,
        settings: &RowSettings,
        plan: Plan,
        scene: &SceneInput,
        place: StorePlace<'_>,
        listener: PartListener<'_>,
    ) -> Result<OpenStore, StoreError> {
        let StorePlace {
            directory,
            overwrite,
            shard,
        } = place;
        if let Some(taken) = &plan.taken
            && taken.is_from(directory)
        {
            return Err(StoreError::unsupported(
                directory,
                "is the matrix that rows are taken over from; write to another place",
            ));
        }
        let header = self.header(settings, &plan, scene)?;
        let grouping = plan.groups.as_ref().map(|groups| groups.grouping.as_ref());
        let mut table = PatchTable::of(scene, self.patches(&plan), grouping);
        if let Some(taken) = &plan.taken {
            table.drawn_by = taken.numbers().to_vec();
        }
        let (writer, resumed) = if overwrite {
            (
                StoreWriter::create(directory, header, &table, true)?,
                Resumed::default(),
            )
        } else {
            StoreWriter::resume(directory, header, &table, shard, self.threads, listener)?
        };
        Ok(OpenStore {
            missing: writer.missing_parts(),
            plan,
            writer,
            resumed,
        })
    }
}

/// A run with open stores: one, or one a band.
#[derive(Debug)]
pub struct StoreRun<'m> {
    run: Run<'m>,
    stores: Vec<OpenStore>,
    /// Parts that any of them lacks.
    missing: Vec<u32>,
}

/// An open store of a run.
#[derive(Debug)]
pub struct OpenStore {
    /// The store's writer.
    pub writer: StoreWriter,
    /// Parts of an earlier run.
    pub resumed: Resumed,
    plan: Plan,
    missing: Vec<u32>,
}

impl StoreRun<'_> {
    /// The stores: the run's own, then those of further bands.
    pub fn stores(&self) -> &[OpenStore] {
        &self.stores
    }

    /// The plan of all rows, resumed ones included.
    pub fn plan(&self) -> &Plan {
        &self.run.plan
    }

    /// Number of rows still to be computed.
    pub fn missing_rows(&self) -> u64 {
        let Some(first) = self.stores.first() else { return 0 };
        let rows = |&part: &u32| u64::from(first.writer.manifest().rows_of_part(part));
        self.missing.iter().map(rows).sum()
    }

    /// Computes the missing rows, writes their parts, hands each to `listener`, and finishes the store. A cancelled run
    /// leaves a manifest that names the parts present.
    ///
    /// # Errors
    /// [`JobError::Rows`] when rows fail or a part cannot be written; [`JobError::Store`] when the manifest cannot.
    ///
    /// # Panics
    /// With further bands, which [`Self::compute_bands`] has listeners for.
    pub fn compute(self, listener: PartListener<'_>, observer: &dyn Observer) -> Result<Finished, JobError> {
        let finished = self.compute_bands(&mut [listener], observer)?;
        Ok(finished.into_iter().next().expect("a store"))
    }

    /// [`Self::compute`] for each of the stores, a listener each.
    ///
    /// # Errors
    /// As for [`Self::compute`]; of the first store that fails.
    ///
    /// # Panics
    /// When listeners are not as many as stores.
    pub fn compute_bands(
        self,
        listeners: &mut [PartListener<'_>],
        observer: &dyn Observer,
    ) -> Result<Vec<Finished>, JobError> {
        let Self { run, stores, missing } = self;
        assert_eq!(listeners.len(), stores.len(), "a listener for each store");
        let plan = &run.plan;
        let resumed = stores.iter().map(|store| {
            let parts = store.writer.manifest().parts.iter().map(|part| part.index);
            plan.elements_of(parts.filter(|part| missing.binary_search(part).is_err()))
        });
        let resumed = resumed.min().unwrap_or(0);
        let row_count = plan.elements_of(missing.iter().copied()) + resumed;
        let stage = InStage::begin(observer, Stage::Rows { row_count, resumed });
        let mut sinks = Vec::with_capacity(stores.len());
        let mut plans = Vec::with_capacity(stores.len());
        for (store, listener) in stores.into_iter().zip(listeners) {
            plans.push(store.plan.with_parts(|part| missing.binary_search(&part).is_ok()));
            sinks.push(Written {
                writer: store.writer,
                resumed: store.resumed,
                missing: store.missing,
                listener: &mut **listener,
            });
        }
        let mut bands: Vec<Band<'_>> = plans
            .iter()
            .zip(&mut sinks)
            .map(|(plan, sink)| Band { plan, sink })
            .collect();
        let execution = Execution {
            threads: run.threads,
            batch: run.batch,
            cancel: observer.cancel(),
        };
        let progress = &mut |progress| observer.progress(progress);
        let computed = compute_bands(run.model, &mut bands, run.render, run.backend, execution, progress);
        drop(bands);
        drop(stage);
        let summaries = match computed {
            Ok(summaries) => summaries,
            Err(source) => {
                let mut writers = sinks.into_iter().map(|sink| sink.writer);
                let first = writers.next().expect("a store");
                // The others name what they have, too.
                for writer in writers.filter(|writer| !writer.manifest().parts.is_empty()) {
                    drop(writer.interrupt());
                }
                return Err(Box::new(RowsFailed::new(source, first)).into());
            }
        };
        let _stage = InStage::begin(observer, Stage::Finish);
        let mut finished = Vec::with_capacity(plans.len());
        for ((plan, sink), summary) in plans.into_iter().zip(sinks).zip(summaries) {
            let Written { writer, resumed, .. } = sink;
            let directory = writer.directory().to_owned();
            let manifest = if summary.cancelled {
                writer.interrupt()?
            } else {
                writer.finish()?
            };
            finished.push(Finished {
                plan,
                summary,
                manifest,
                directory,
                resumed,
            });
        }
        Ok(finished)
    }
}

impl RowsFailed {
    /// Names the parts present in the manifest.
    fn new(source: ComputeError, writer: StoreWriter) -> Self {
        let parts = writer.manifest().parts.len() as u64;
        Self {
            source,
            directory: writer.directory().to_owned(),
            parts,
            part_count: parts + writer.missing_parts().len() as u64,
            are_named: parts > 0 && writer.interrupt().is_ok(),
        }
    }
}

/// Writes parts to a store that lacks them and hands them to a listener.
struct Written<'a> {
    writer: StoreWriter,
    resumed: Resumed,
    missing: Vec<u32>,
    listener: PartListener<'a>,
}

impl PartSink for Written<'_> {
    fn take(&mut self, part: Part) -> Result<(), StoreError> {
        if self.missing.binary_search(&part.index).is_err() {
            return Ok(());
        }
        self.writer.write_part(&part)?;
        (self.listener)(&part);
        Ok(())
    }
}

/// A run with a finished or interrupted store.
#[derive(Debug)]
pub struct Finished {
    /// The rows computed.
    pub plan: Plan,
    /// Figures of the rows computed; [`Summary::cancelled`] where the run was interrupted.
    pub summary: Summary,
    /// The store's manifest as written.
    pub manifest: Manifest,
    /// The store.
    pub directory: PathBuf,
    /// Parts of an earlier run.
    pub resumed: Resumed,
}
