//! `hemicube inspect`: what a scene is, what in it looks like a mistake, and what its matrix would cost.
//!
//! The forecast and the statistics come from the hemicubes of a random sample of patches; the forecast's time is the
//! only figure that a clock enters.

use crate::args::{
    ConfigFiles, RenderSettings as RenderArguments, Report as ReportArguments, SceneSettings, Switch, Talk,
};
use crate::enclosure;
use crate::exit::Exit;
use crate::forecast;
use crate::help::{examples, scene_help};
use crate::outputs::Paths;
use crate::prepare::{Prepared, RepairCounts, axis_name, prepare};
use crate::report::{
    self, BackendReport, Input, JsonReport, Listing, SCHEMA, about, count, counted, duration, figures, percent, size,
};
use anyhow::{Result, bail};
use clap::Args;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::diagnose::{
    DiagnoseOptions, Diagnosis, Enclosure, Finding, FindingKind, SceneStatistics, Unit, diagnose,
};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::driver::storage_policy::StoragePolicy;
use hemicube::factor::FactorRule;
use hemicube::row::RowBlock;
use hemicube::store::{Form, Part};
use hemicube::{InputPatch, Model};
use hemicube_scene::survey::{Edges, Survey, survey};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Patches whose hemicubes the forecast is made from.
const SAMPLE: u32 = 64;
/// Rows that the forecast of entries and time is made from: some see a hundred times as much as others.
const FORECAST_ROWS: u32 = 256;

/// Places that the terminal shows of each finding; the JSON report has them all.
const EXAMPLES_SHOWN: usize = 3;

/// Where long sentences are broken.
const WIDTH: usize = 100;

/// Bytes of a store: an entry's column and value; a row's ends, patch, weights and hemicubes; a patch in the table.
const ENTRY_BYTES: f64 = 8.0;
const COMPACT_ENTRY_BYTES: f64 = 2.6;
const ROW_BYTES: f64 = 48.0;
const PATCH_BYTES: f64 = 101.0;

/// Describe a scene: size, area, sides, defects, and what its matrix would cost
#[derive(Args, Debug)]
#[command(override_usage = "hemicube inspect [OPTIONS] SCENE", after_long_help = examples("  hemicube inspect city.obj\n  hemicube inspect city.obj --split 4 --json", true))]
pub(crate) struct Arguments {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) render: RenderArguments,
    /// Which hemicubes the forecast is made from
    #[arg(
        long,
        value_name = "S",
        default_value = "1",
        help_heading = "Hemicubes",
        hide_short_help = true
    )]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths that the command reads and writes.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .reads(&self.scene)
            .reads(&self.config.config)
            .reports(&self.report)
    }
}

/// The report of `--json`.
#[derive(Serialize)]
struct Report {
    schema: u32,
    program: &'static str,
    version: &'static str,
    inputs: Vec<Input>,
    scene: SceneReport,
    repair: RepairCounts,
    findings: std::collections::BTreeMap<String, u64>,
    warnings: Vec<String>,
    patches: PatchReport,
    octree: OctreeReport,
    diagnosis: DiagnosisReport,
    enclosure: EnclosureReport,
    backend: BackendReport,
    statistics: SceneStatistics,
    forecast: Forecast,
    #[serde(skip_serializing_if = "Option::is_none")]
    timings: Option<Timings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory_bytes: Option<u64>,
}

#[derive(Serialize)]
struct SceneReport {
    triangles: u64,
    triangles_used: usize,
    two_sided: usize,
    objects: usize,
    closed_objects: usize,
    materials: usize,
    bounds: Option<[[f64; 3]; 2]>,
    diagonal: f64,
    area: f64,
    area_min: f64,
    area_max: f64,
    edges: EdgeReport,
    welded_edges: EdgeReport,
    closed: bool,
    up: &'static str,
    up_reason: String,
    up_guessed: bool,
    metres_per_unit: Option<f64>,
    hints: Vec<String>,
    worst: Vec<WorstReport>,
}

#[derive(Serialize)]
struct EdgeReport {
    count: usize,
    boundary: usize,
    non_manifold: usize,
    inconsistent: usize,
}

impl From<&Edges> for EdgeReport {
    fn from(edges: &Edges) -> Self {
        Self {
            count: edges.count,
            boundary: edges.boundary,
            non_manifold: edges.non_manifold,
            inconsistent: edges.inconsistent,
        }
    }
}

#[derive(Serialize)]
struct WorstReport {
    face: u32,
    object: String,
    aspect: f64,
    area: f64,
}

#[derive(Serialize)]
struct PatchReport {
    count: usize,
    surfaces: usize,
    area_min: f64,
    area_median: f64,
    area_max: f64,
}

#[derive(Serialize)]
struct OctreeReport {
    nodes: usize,
    leaves: usize,
    levels: u32,
    surfaces_per_leaf: f64,
}

/// What would spoil form factors, each place with the names of what is there.
#[derive(Serialize)]
struct DiagnosisReport {
    seed: u64,
    precision: hemicube::diagnose::Precision,
    findings: Vec<FindingReport>,
}

/// How the scene encloses, with a sentence for each object that faces the wrong way and each leak.
#[derive(Serialize)]
struct EnclosureReport {
    #[serde(flatten)]
    enclosure: Enclosure,
    sentences: Vec<String>,
    #[serde(skip)]
    leaks_said: Vec<String>,
}

#[derive(Serialize)]
struct FindingReport {
    #[serde(flatten)]
    finding: Finding,
    meaning: &'static str,
    measure: &'static str,
    unit: Unit,
    /// For each example the objects that its patches belong to.
    objects: Vec<Vec<Place>>,
}

/// Where a patch comes from.
#[derive(Serialize)]
struct Place {
    face: u32,
    object: String,
}

/// What the sampled rows say of all.
#[derive(Serialize)]
struct Forecast {
    sampled_rows: usize,
    seed: u64,
    resolution: u32,
    samples: u32,
    visible_median: u64,
    visible_percentile_90: u64,
    culled: f64,
    entries: f64,
    bytes: f64,
    /// With `--store compact`.
    bytes_compact: f64,
    threads: usize,
    /// What a run of all rows takes at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    memory_bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
}

#[derive(Serialize)]
struct Timings {
    load: f64,
    build: f64,
    diagnose: f64,
}

pub(crate) fn run(arguments: Arguments, talk: Talk) -> Result<Exit> {
    // clap requires it; only `--print-config` goes without.
    let Some(path) = arguments.scene.as_deref() else {
        bail!("a scene is needed")
    };
    let json = JsonReport::open(&arguments.report)?;
    let mut backend = arguments.render.open_backend(talk)?;
    let prepared = prepare(path, &arguments.patches, &arguments.render, None)?;
    let reading = report::peak_memory_bytes();
    let mut surveyed = survey(&prepared.scene, &prepared.repaired);
    if arguments.patches.up.is_some() {
        "`--up` says so".clone_into(&mut surveyed.up_reason);
    }
    let started = Instant::now();
    let options = DiagnoseOptions {
        seed: arguments.seed,
        threads: arguments.render.thread_count(),
        ..DiagnoseOptions::default()
    };
    let diagnosis = diagnosis_report(&prepared, diagnose(&prepared.model, options));
    let enclosure = enclosure::of(&prepared, &enclosure::objects(&prepared), options);
    let enclosure = EnclosureReport {
        sentences: enclosure
            .winding
            .iter()
            .map(|of| enclosure::of_winding(&prepared, of))
            .collect(),
        leaks_said: enclosure
            .leaks
            .iter()
            .map(|of| enclosure::of_leak(&prepared, of))
            .collect(),
        enclosure,
    };
    let diagnose_seconds = started.elapsed().as_secs_f64();
    let statistics = SceneStatistics::measure(
        &prepared.model,
        backend.as_mut(),
        arguments.render.resolution,
        arguments.seed,
    )?;
    let mut forecast = forecast(&prepared.model, &arguments, backend.as_mut())?;
    // In vast scenes, reading and cutting them takes more than the rows do.
    forecast.memory_bytes = forecast.memory_bytes.max(reading);
    if arguments.report.no_timings {
        forecast.seconds = None;
        forecast.memory_bytes = None;
    }
    let device = backend.info().clone();
    let timed = !arguments.report.no_timings;
    let report = Report {
        schema: SCHEMA,
        program: "hemicube",
        version: env!("CARGO_PKG_VERSION"),
        scene: scene_report(&prepared, surveyed),
        repair: RepairCounts::from(&prepared.repaired),
        findings: prepared.scene.findings.counts.clone(),
        warnings: prepared.scene.findings.warnings.clone(),
        patches: patch_report(&prepared),
        octree: octree_report(&prepared.model),
        diagnosis,
        enclosure,
        backend: BackendReport {
            name: device.name,
            version: device.version,
            device: device.device,
        },
        statistics,
        forecast,
        timings: timed.then_some(Timings {
            load: prepared.load_seconds,
            build: prepared.build_seconds,
            diagnose: diagnose_seconds,
        }),
        peak_memory_bytes: report::peak_memory_bytes().filter(|_| timed),
        inputs: vec![prepared.input],
    };
    if !arguments.report.is_to_stdout() {
        report::print(&text(&report))?;
    }
    for warning in &report.warnings {
        talk.warn(warning);
    }
    if let Some(json) = json {
        json.write(&report)?;
    }
    Ok(Exit::Done)
}

fn scene_report(prepared: &Prepared, survey: Survey) -> SceneReport {
    SceneReport {
        triangles: prepared.triangles_read,
        triangles_used: survey.triangle_count,
        two_sided: survey.two_sided_count,
        objects: survey.object_count,
        closed_objects: survey.closed_object_count,
        materials: survey.material_count,
        bounds: survey.bounds.map(|bounds| bounds.map(|corner| corner.to_array())),
        diagonal: survey.diagonal,
        area: survey.area,
        area_min: survey.area_min,
        area_max: survey.area_max,
        closed: survey.edges.are_closed(),
        edges: EdgeReport::from(&survey.edges),
        welded_edges: EdgeReport::from(&survey.welded_edges),
        up: axis_name(survey.up),
        up_reason: survey.up_reason,
        up_guessed: survey.up_guessed,
        metres_per_unit: prepared.scene.metres_per_unit,
        hints: survey.unit_hints,
        worst: survey
            .worst
            .into_iter()
            .map(|worst| WorstReport {
                face: worst.face,
                object: worst.object,
                aspect: worst.aspect,
                area: worst.area,
            })
            .collect(),
    }
}

fn patch_report(prepared: &Prepared) -> PatchReport {
    let patches = &prepared.patches;
    let mut areas: Vec<f64> = patches.iter().map(|patch| patches.area(patch)).collect();
    areas.sort_unstable_by(f64::total_cmp);
    let at = |place: usize| areas.get(place).copied().unwrap_or(0.0);
    PatchReport {
        count: patches.len(),
        surfaces: patches.surfaces().len(),
        area_min: at(0),
        area_median: at(areas.len() / 2),
        area_max: at(areas.len().saturating_sub(1)),
    }
}

fn octree_report(model: &Model) -> OctreeReport {
    let nodes = model.geometry().octree.nodes();
    let leaves = nodes.iter().filter(|node| node.is_leaf()).count();
    OctreeReport {
        nodes: nodes.len(),
        leaves,
        levels: nodes.iter().map(|node| node.level).max().unwrap_or(0),
        surfaces_per_leaf: model.geometry().surfaces.len() as f64 / leaves.max(1) as f64,
    }
}

fn diagnosis_report(prepared: &Prepared, diagnosis: Diagnosis) -> DiagnosisReport {
    let place = |patch: InputPatch| {
        let triangle = prepared.scene.triangles.get(prepared.patches.triangle(patch))?;
        let object = prepared.scene.objects.get(triangle.object as usize);
        Some(Place {
            face: triangle.face,
            object: object.cloned().unwrap_or_default(),
        })
    };
    let report = |finding: Finding| FindingReport {
        meaning: finding.kind.meaning(),
        measure: finding.kind.measure().name,
        unit: finding.kind.measure().unit,
        objects: finding
            .examples
            .iter()
            .map(|example| {
                [Some(example.patch), example.other]
                    .into_iter()
                    .flatten()
                    .filter_map(place)
                    .collect()
            })
            .collect(),
        finding,
    };
    DiagnosisReport {
        seed: diagnosis.seed,
        precision: diagnosis.precision,
        findings: diagnosis.findings.into_iter().map(report).collect(),
    }
}

fn forecast(model: &Model, arguments: &Arguments, backend: &mut dyn HemicubeBackend) -> Result<Forecast> {
    let render = &arguments.render;
    let choice = RowChoice::Sample {
        count: SAMPLE,
        seed: arguments.seed,
    };
    let rotate = render.rotation == Switch::On;
    let plan = Plan::new(model, choice, Selection::default(), render.samples.per_edge, rotate);
    let settings = RenderSettings {
        resolution: render.resolution,
        culling: Culling::On,
        covered: false,
    };
    backend.load(model.geometry(), settings)?;

    let mut visible = Vec::new();
    let (mut hemicube_count, mut transformed) = (0u64, 0);
    let mut block = RowBlock::default();
    for &patch in &plan.rows {
        let hemicubes = model.hemicubes(patch, render.samples.per_edge, rotate);
        if hemicubes.is_empty() {
            continue;
        }
        block.clear();
        let counters = backend.rows(&hemicubes, &mut block)?;
        hemicube_count += counters.hemicubes;
        transformed += counters.triangles_transformed;
        let mut seen: Vec<u32> = block
            .patches
            .iter()
            .zip(&block.visible)
            .filter(|&(_, &weight)| weight > 0)
            .map(|(&p, _)| p)
            .collect();
        seen.sort_unstable();
        seen.dedup();
        visible.push(seen.len() as u64);
    }
    let patch_count = model.patches().len() as f64;
    // The rows as `compute` makes them when nothing else is asked for. The first time fetches the scene into the
    // caches, where a full run has it; the second is measured.
    let choice = RowChoice::Sample {
        count: FORECAST_ROWS,
        seed: arguments.seed,
    };
    let plan = Plan::new(model, choice, Selection::default(), render.samples.per_edge, rotate)
        .with_correction(Correction::Area(FactorRule::for_tolerance(1e-2)));
    let mut summary = None;
    for _ in 0..2 {
        let mut parts: Vec<Part> = Vec::new();
        summary = Some(compute(
            model,
            &plan,
            settings,
            render.open_backend(Talk::SILENT)?,
            Execution {
                threads: 1,
                ..Execution::default()
            },
            &mut parts,
            &mut |_| {},
        )?);
    }
    let (entries, seconds) = summary.map_or((0.0, 0.0), |s| {
        let share = patch_count / (s.rows.max(1)) as f64;
        (s.entries as f64 * share, s.elapsed.as_secs_f64() * share)
    });
    visible.sort_unstable();
    let at = |percent: usize| {
        visible
            .get((visible.len() * percent).div_ceil(100).saturating_sub(1))
            .copied()
            .unwrap_or(0)
    };
    let threads = render.thread_count();
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most 2³¹ patches"
    )]
    let rows_per_part = Plan::rows_per_part_of(patch_count as usize);
    let rows = forecast::Rows {
        entries_per_row: entries / patch_count.max(1.0),
        rows_per_part,
        rows_per_batch: u32::try_from(backend.info().preferred_rows).unwrap_or(u32::MAX),
    };
    // What the survey and the diagnosis took of memory is in here, too: a run takes no more.
    let memory_bytes = report::resident_memory_bytes().map(|resident| forecast::memory(resident, threads, rows));
    let samples = render.samples.per_edge * render.samples.per_edge;
    let all = hemicube_count as f64 * model.geometry().surfaces.len() as f64;
    Ok(Forecast {
        sampled_rows: visible.len(),
        seed: arguments.seed,
        resolution: render.resolution,
        samples,
        visible_median: at(50),
        visible_percentile_90: at(90),
        culled: if all > 0.0 {
            (1.0 - transformed as f64 / all).max(0.0)
        } else {
            0.0
        },
        entries,
        bytes: entries * ENTRY_BYTES + patch_count * (ROW_BYTES + PATCH_BYTES),
        bytes_compact: entries * COMPACT_ENTRY_BYTES + patch_count * (ROW_BYTES + PATCH_BYTES),
        memory_bytes,
        threads,
        seconds: Some(seconds / threads as f64),
    })
}

fn text(report: &Report) -> String {
    let scene = &report.scene;
    let mut list = Listing::default();
    if let Some(input) = report.inputs.first() {
        list.add("scene", format!("`{}`, {}", input.path, size(input.bytes)));
    }
    list.add(
        "triangles",
        format!(
            "{}, {} two-sided; {}, {}",
            count(scene.triangles_used as u64),
            if scene.two_sided == 0 {
                "none".to_owned()
            } else {
                count(scene.two_sided as u64)
            },
            counted(scene.objects as u64, "object"),
            counted(scene.materials as u64, "material")
        ),
    );
    let dropped = [
        (report.repair.non_finite, "not finite"),
        (report.repair.degenerate, "without area"),
        (report.repair.duplicates_dropped, "exactly on others"),
    ];
    for (number, what) in dropped.into_iter().filter(|(number, _)| *number > 0) {
        list.add("dropped", format!("{} {what}", count(number)));
    }
    if report.repair.reversed_duplicates > 0 {
        list.add(
            "back to back",
            format!("{}, kept", counted(report.repair.reversed_duplicates, "triangle")),
        );
    }
    for (reason, number) in &report.findings {
        list.add("in the file", format!("{} × {reason}", count(*number)));
    }
    if let Some([low, high]) = scene.bounds {
        let extent: Vec<String> = low.iter().zip(high).map(|(low, high)| figures(high - low)).collect();
        let shown = |corner: [f64; 3]| {
            corner
                .map(|c| format!("{c:.6}").trim_end_matches('0').trim_end_matches('.').to_owned())
                .join(" ")
        };
        list.add("size", extent.join(" × "));
        list.add("box", format!("({}) to ({})", shown(low), shown(high)));
    }
    list.add("up", format!("{} ({})", scene.up, scene.up_reason));
    list.add(
        "unit",
        match scene.metres_per_unit {
            Some(metres) => format!("{} m", figures(metres)),
            None => "not given".to_owned(),
        },
    );
    list.add(
        "area",
        format!(
            "{}, triangles from {} to {}",
            figures(scene.area),
            figures(scene.area_min),
            figures(scene.area_max)
        ),
    );
    list.add("edges", edges(&scene.edges, scene.closed));
    if scene.welded_edges.boundary < scene.edges.boundary {
        let cracks = scene.edges.boundary - scene.welded_edges.boundary;
        list.add(
            "",
            format!(
                "{} of the boundary edges are cracks narrower than 1e-7 of the scene",
                count(cracks as u64)
            ),
        );
    }
    list.add(
        "closed objects",
        format!(
            "{} of {}",
            count(scene.closed_objects as u64),
            count(scene.objects as u64)
        ),
    );
    for hint in &scene.hints {
        list.add("note", hint.clone());
    }
    let patches = &report.patches;
    list.add(
        "patches",
        format!(
            "{}, area {} in the median, from {} to {}",
            count(patches.count as u64),
            figures(patches.area_median),
            figures(patches.area_min),
            figures(patches.area_max)
        ),
    );
    let octree = &report.octree;
    list.add(
        "octree",
        format!(
            "{}, {} deep, {} patches a leaf",
            counted(octree.nodes as u64, "node"),
            counted(octree.levels.into(), "level"),
            figures(octree.surfaces_per_leaf)
        ),
    );
    let mut text = list.text();
    text.push_str(&enclosure_text(&report.enclosure));
    text.push_str(&findings_text(&report.diagnosis));

    let (forecast, statistics) = (&report.forecast, &report.statistics);
    text.push_str(&format!(
        "\nFrom the hemicubes of {} (resolution {}, {} a patch):\n",
        counted(forecast.sampled_rows as u64, "random patch"),
        forecast.resolution,
        forecast.samples
    ));
    let mut list = Listing::default();
    list.add(
        "a patch sees",
        format!(
            "{} in the median, {} in the 90th percentile",
            counted(forecast.visible_median, "patch"),
            count(forecast.visible_percentile_90)
        ),
    );
    list.add(
        "occlusion",
        format!(
            "{} of the {} that face it on average are hidden",
            percent(statistics.occlusion),
            about(statistics.facing)
        ),
    );
    list.add(
        "escaped",
        format!("{} of the view leaves the scene", percent(statistics.escaped)),
    );
    list.add(
        "blocked",
        format!(
            "{} of the view is backs of one-sided surfaces",
            percent(statistics.blocked)
        ),
    );
    list.add(
        "nearness",
        format!(
            "half of its view is nearer than {} of its radii; {} patches nearer than 1.5 on average",
            if statistics.nearness > 0.0 {
                figures(statistics.nearness.recip())
            } else {
                "any number".to_owned()
            },
            figures(statistics.near)
        ),
    );
    list.add(
        "culling",
        format!("spares {} of the triangles", percent(forecast.culled)),
    );
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturation is wanted"
    )]
    let (bytes, compact) = (forecast.bytes as u64, forecast.bytes_compact as u64);
    let keep = StoragePolicy::choose(
        None,
        None,
        u32::try_from(report.patches.count).unwrap_or(u32::MAX),
        None,
    );
    let on_disk = match keep.form {
        Form::Plain => format!("{} on disk ({} with `--store compact`)", size(bytes), size(compact)),
        Form::Compact => format!(
            "less than {} on disk without form factors below {:e} ({} with `--store plain --min-factor 0`)",
            size(compact),
            keep.min_factor,
            size(bytes)
        ),
    };
    list.add(
        "all rows",
        format!("about {} entries, {on_disk}", about(forecast.entries)),
    );
    if let Some(seconds) = forecast.seconds {
        let device = format!(
            "{} with {}",
            report.backend.name,
            counted(forecast.threads as u64, "thread")
        );
        let memory = forecast
            .memory_bytes
            .map_or_else(String::new, |bytes| format!(", in at most {} of memory", size(bytes)));
        list.add("", format!("about {} on {device}{memory}", duration(seconds)));
    }
    text.push_str(&list.text());

    let told = |report: &FindingReport| report.finding.kind == FindingKind::Sliver;
    if scene.worst.iter().any(|worst| worst.aspect > 20.0) && !report.diagnosis.findings.iter().any(told) {
        text.push_str("\nThe slimmest triangles:\n");
        text.push_str(&report::table(
            ["face", "longest edge / height", "area", "object"],
            scene.worst.iter().map(|worst| {
                [
                    worst.face.to_string(),
                    figures(worst.aspect),
                    figures(worst.area),
                    worst.object.clone(),
                ]
            }),
        ));
    }
    text
}

/// Which objects face the wrong way, and where the scene leaks; nothing when none does and it does not.
fn enclosure_text(report: &EnclosureReport) -> String {
    let mut text = String::new();
    if !report.sentences.is_empty() {
        text.push_str("\nWound the wrong way:\n");
        for sentence in &report.sentences {
            let lines = wrapped(sentence, WIDTH - 2);
            text.push_str(&format!("  {}\n", lines.join("\n    ")));
        }
    }
    let found = &report.enclosure;
    if let Some(sentence) = enclosure::of_groups(found) {
        text.push_str(&format!(
            "\nApart:\n  {}\n",
            wrapped(&sentence, WIDTH - 2).join("\n    ")
        ));
    }
    if !report.leaks_said.is_empty() {
        text.push_str(&format!(
            "\nLeaks: {} of what escapes leaves through {}:\n",
            percent(found.leaking),
            counted(found.leaks.len() as u64 + found.leaks_more, "hole")
        ));
        for leak in &report.leaks_said {
            text.push_str(&format!("  {leak}\n"));
        }
        if found.leaks_more > 0 {
            text.push_str(&format!("  and {}\n", counted(found.leaks_more, "smaller hole")));
        }
    }
    text
}

/// What would spoil form factors; nothing when nothing would.
fn findings_text(diagnosis: &DiagnosisReport) -> String {
    if diagnosis.findings.is_empty() {
        return String::new();
    }
    let mut text = "\nWhat would spoil form factors:\n".to_owned();
    for report in &diagnosis.findings {
        let finding = &report.finding;
        let kind = finding.kind;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
        let number = finding.estimate.round() as u64;
        text.push_str(&format!(
            "\n  {}: {}{} {}\n",
            kind.name(),
            if finding.is_estimate() { "about " } else { "" },
            pairs(kind, number, finding.is_estimate()),
            report.meaning
        ));
        let mut list = Listing::default();
        if finding.is_estimate() {
            list.add(
                "    from",
                format!(
                    "{} found at {} of {} {}, sampled",
                    count(finding.count),
                    count(finding.examined),
                    count(finding.population),
                    kind.population()
                ),
            );
        }
        if let (Some(total), Some(measure)) = (finding.total, kind.total()) {
            let total = match measure.unit {
                Unit::Fraction => percent(total),
                _ => figures(total),
            };
            list.add("    in all", format!("{total} {}", measure.name));
        }
        for (number, (example, places)) in finding
            .examples
            .iter()
            .zip(&report.objects)
            .enumerate()
            .take(EXAMPLES_SHOWN)
        {
            let mut who = format!("patch {}", example.patch.0);
            if let Some(other) = example.other {
                who.push_str(&format!(" with {}", other.0));
            }
            let mut names: Vec<&str> = places.iter().map(|place| place.object.as_str()).collect();
            names.dedup();
            names.retain(|name| !name.is_empty());
            if !names.is_empty() {
                who.push_str(&format!(" (`{}`)", names.join("`, `")));
            }
            let at: Vec<String> = example.at.to_array().iter().map(|&c| coordinate(c)).collect();
            list.add(
                if number == 0 { "    worst" } else { "" },
                format!("{who} at ({}): {}", at.join(" "), measured(example.value, report)),
            );
        }
        for (number, line) in wrapped(&finding.next, WIDTH - 11).into_iter().enumerate() {
            list.add(if number == 0 { "    try" } else { "" }, line);
        }
        text.push_str(&list.text());
    }
    text
}

/// A sentence in lines of at most `width` characters, but for words that are longer.
fn wrapped(sentence: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in sentence.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Number of what was found, the number rounded where it is an estimate.
fn pairs(kind: FindingKind, number: u64, is_estimate: bool) -> String {
    let shown = if is_estimate {
        about(number as f64)
    } else {
        count(number)
    };
    // `counted` knows the plurals of single words.
    let (first, rest) = kind.counted().split_once(' ').unwrap_or((kind.counted(), ""));
    let plural = counted(number, first);
    let word = plural.rsplit(' ').next().unwrap_or(first);
    format!("{shown} {word} {rest}").trim_end().to_owned()
}

fn measured(value: f64, report: &FindingReport) -> String {
    match report.unit {
        Unit::Fraction => format!("{} {}", percent(value), report.measure),
        Unit::Degrees => format!("{} by {}°", report.measure, figures(value)),
        _ => format!("{} {}", report.measure, figures(value)),
    }
}

fn coordinate(value: f64) -> String {
    let text = format!("{value:.3}");
    if value != 0.0 && value.abs() < 0.1 {
        figures(value)
    } else {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}

fn edges(edges: &EdgeReport, closed: bool) -> String {
    if closed {
        return format!("{}: the surface is closed", count(edges.count as u64));
    }
    format!(
        "{}: {} boundary, {} non-manifold, {} inconsistently wound",
        count(edges.count as u64),
        count(edges.boundary as u64),
        count(edges.non_manifold as u64),
        count(edges.inconsistent as u64)
    )
}
