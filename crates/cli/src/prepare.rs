//! From a scene's file to a model: read, scale, repair, cut, order. What `compute`, `inspect` and `tradeoff` have in
//! common.

use crate::args::{AutoSwitch, Engine, EngineSettings, RenderSettings as RenderArguments, SceneSettings, Switch, Talk};
use crate::exit::hinted;
use crate::report::{Input, counted};
use anyhow::{Context, Result, anyhow};
use hemicube::backend::HemicubeBackend;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_scene::repair::{RepairOptions, RepairReport, repair};
use hemicube_scene::{Axis, Patches, ReadOptions, Scene, Subdivision};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// A scene ready for hemicubes.
pub(crate) struct Prepared {
    pub(crate) scene: Scene,
    pub(crate) repaired: RepairReport,
    /// Triangles in the file, dropped ones included.
    pub(crate) triangles_read: u64,
    pub(crate) patches: Arc<Patches>,
    pub(crate) model: Model,
    pub(crate) input: Input,
    pub(crate) load_seconds: f64,
    pub(crate) build_seconds: f64,
}

/// What was dropped or noted of a scene's triangles, in reports.
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
    /// Says what of the file is not in the matrix.
    pub(crate) fn tell(&self, talk: Talk) {
        let Self { scene, repaired, .. } = self;
        for warning in &scene.findings.warnings {
            talk.warn(warning);
        }
        let dropped = [
            (repaired.non_finite, "without finite coordinates"),
            (repaired.degenerate, "without area"),
            (repaired.duplicates_dropped, "that lie exactly on others"),
        ];
        let parts: Vec<String> = dropped
            .iter()
            .filter(|(number, _)| *number > 0)
            .map(|(number, what)| format!("{} {what}", crate::report::count(*number)))
            .collect();
        if !parts.is_empty() {
            talk.warn(&format!("triangles dropped: {}", parts.join(", ")));
        }
        for (reason, number) in &scene.findings.counts {
            talk.detail(&format!("in the file: {} × {reason}", crate::report::count(*number)));
        }
        if repaired.reversed_duplicates > 0 {
            let number = counted(repaired.reversed_duplicates, "triangle");
            talk.detail(&format!("in the scene: {number} back to back with others, kept"));
        }
    }
}

impl SceneSettings {
    /// How triangles are cut. Which of the three settings holds was decided when the layers were gathered.
    pub(crate) fn subdivision(&self) -> Subdivision {
        match (self.subdivide, self.split, self.patch_size) {
            (Some(levels), _, _) => Subdivision::Levels(levels),
            (_, Some(pieces), _) => Subdivision::Split(pieces),
            (_, _, Some(length)) => Subdivision::PatchSize(length),
            _ => Subdivision::None,
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
    /// How many threads work.
    pub(crate) fn thread_count(&self) -> usize {
        self.engine.thread_count()
    }

    /// The backend that was asked for.
    ///
    /// # Errors
    /// When there is none of that name.
    pub(crate) fn open_backend(&self) -> Result<Box<dyn HemicubeBackend>> {
        self.engine.open_backend()
    }
}

impl EngineSettings {
    /// How the octree is cut.
    pub(crate) fn hierarchy(&self) -> HierarchyOptions {
        let suits = HierarchyOptions::default();
        HierarchyOptions {
            max_level: self.octree_levels.or(suits.max_level),
            min_patches: self.min_patches.or(suits.min_patches),
        }
    }

    /// How many threads work.
    pub(crate) fn thread_count(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads as usize,
        }
    }

    /// The backend that was asked for. A named one never becomes another.
    ///
    /// # Errors
    /// When there is none of that name.
    pub(crate) fn open_backend(&self) -> Result<Box<dyn HemicubeBackend>> {
        let engine = match self.engine {
            Engine::Auto => EngineChoice::Auto,
            Engine::Depth => EngineChoice::Depth,
            Engine::Order => EngineChoice::Order,
        };
        match self.backend.as_str() {
            "auto" | "cpu" => Ok(Box::new(CpuBackend::new().with_engine(engine))),
            other => Err(hinted(
                anyhow!("there is no backend `{other}`; there is `cpu`, and `auto`, which takes it"),
                "`hemicube backends list` shows what each can do",
            )),
        }
    }
}

/// Reads the scene at `path` and makes it ready.
///
/// # Errors
/// When it cannot be read, nothing of it can be used, or there are too many patches.
pub(crate) fn prepare(path: &Path, settings: &SceneSettings, engine: &impl AsRef<EngineSettings>) -> Result<Prepared> {
    let started = Instant::now();
    if path.is_dir() {
        return Err(anyhow!(
            "`{}` is a directory; give the file of a scene in it",
            path.display()
        ));
    }
    let mut scene = hemicube_scene::load(path, ReadOptions::default())?;
    let input = Input::of(path)?;
    let triangles_read = scene.triangles.len() as u64;
    if let Some(axis) = settings.up {
        scene.up = Some(axis.into());
    }
    if settings.scale != 1.0 {
        for corner in scene.triangles.iter_mut().flat_map(|triangle| &mut triangle.corners) {
            *corner *= settings.scale;
        }
        scene.metres_per_unit = scene.metres_per_unit.map(|metres| metres / settings.scale);
    }
    if settings.two_sided != AutoSwitch::Auto {
        for triangle in &mut scene.triangles {
            triangle.two_sided = settings.two_sided == AutoSwitch::On;
        }
    }
    let repaired = repair(
        &mut scene,
        RepairOptions {
            keep_duplicates: settings.keep_duplicates == Switch::On,
        },
    );
    let load_seconds = started.elapsed().as_secs_f64();
    if scene.triangles.is_empty() {
        return Err(anyhow!(
            "`{}` holds no triangle that can be used: of {}, {} not finite and {} without area",
            path.display(),
            counted(triangles_read, "triangle"),
            are(repaired.non_finite),
            are(repaired.degenerate),
        ));
    }

    let started = Instant::now();
    let patches = Patches::new(&scene, settings.subdivision()).map_err(|error| error.in_file(path))?;
    let patches = Arc::new(patches);
    let model = Model::new(Arc::clone(&patches), engine.as_ref().hierarchy())
        .with_context(|| format!("`{}` cannot be computed", path.display()))?;
    let build_seconds = started.elapsed().as_secs_f64();
    Ok(Prepared {
        scene,
        repaired,
        triangles_read,
        patches,
        model,
        input,
        load_seconds,
        build_seconds,
    })
}

fn are(count: u64) -> String {
    if count == 1 {
        "1 is".to_owned()
    } else {
        format!("{} are", crate::report::count(count))
    }
}

/// An axis' name in manifests and reports.
pub(crate) fn axis_name(axis: Axis) -> &'static str {
    match axis {
        Axis::X => "x",
        Axis::Y => "y",
        Axis::Z => "z",
    }
}
