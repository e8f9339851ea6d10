//! Where the time of a run goes, stage by stage: `stages SCENE SPLIT ROWS FORM [DIRECTORY]`.
//!
//! ```sh
//! cargo run --release -p hemicube-tests --example stages -- city.obj 1 2000 compact
//! ```
//!
//! SPLIT is as for `compute --split`, ROWS how many rows are sampled (0: all), FORM `plain` or `compact`. Times are
//! seconds of the clock and of the processor, all threads together; on a machine that does something else the second is
//! the one to go by.
#![allow(clippy::print_stdout, reason = "an example talks")]

use hemicube::accuracy::correct::{Correction, Refinement};
use hemicube::analysis::check::{CheckOptions, check};
use hemicube::backend::{Culling, RenderSettings};
use hemicube::bvh::{Hierarchy, Tree};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::store::{BackendEntry, Form, Header, PatchTable, SceneEntry, Store, StoreWriter, scene_hash};
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_export::{ExportFormat, ExportOptions, export};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Patches, ReadOptions, Subdivision, load};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene_path, split, rows, form, place @ ..] = arguments.as_slice() else {
        return Err("give SCENE SPLIT ROWS FORM [DIRECTORY]".into());
    };
    let (split, rows): (u32, u32) = (split.parse()?, rows.parse()?);
    let form = match form.as_str() {
        "plain" => Form::Plain,
        "compact" => Form::Compact,
        _ => return Err("FORM is `plain` or `compact`".into()),
    };
    let temporary = tempfile::tempdir()?;
    let place = place.first().map_or(temporary.path(), |place| Path::new(place));
    println!("{:28} {:>9} {:>9}", "stage", "clock", "processor");

    let mut scene = stage("load", || load(scene_path.as_ref(), ReadOptions::default()))??;
    stage("repair", || repair(&mut scene, RepairOptions::default()))?;
    let patches = Arc::new(stage("subdivide", || Patches::new(&scene, Subdivision::Split(split)))??);
    let model = stage("order, octree", || {
        Model::new(Arc::clone(&patches), HierarchyOptions::default())
    })??;
    // The backend builds its own below, within the rows.
    stage("surface area tree", || {
        Tree::new(model.geometry(), Hierarchy::SurfaceArea)
    })?;

    let choice = match rows {
        0 => RowChoice::All,
        count => RowChoice::Sample { count, seed: 1 },
    };
    let plan = stage("plan", || {
        Plan::new(&model, choice, Selection::default(), 1, true)
            .with_correction(Correction::Tolerance(Refinement::for_tolerance(0.02)))
            .with_form(form)
    })?;
    let hash = stage("scene hash", || scene_hash(&scene, &patches))?;
    let table = stage("patch table", || PatchTable::new(&scene, &patches))?;
    let header = Header {
        program: "stages".to_owned(),
        scene: SceneEntry {
            file: scene_path.clone(),
            blake3: hash,
        },
        settings: serde_json::json!({}),
        correction: "tolerance".to_owned(),
        patch_count: u32::try_from(patches.len())?,
        row_count: u32::try_from(plan.rows.len())?,
        rows_per_part: plan.rows_per_part,
        form,
        min_factor: 0.0,
        backend: BackendEntry {
            name: "cpu".to_owned(),
            version: "1".to_owned(),
        },
        objects: scene.objects.clone(),
        materials: scene.materials.iter().map(|m| m.name.clone()).collect(),
    };
    let directory = place.join("F");
    let mut writer = stage("store made, patches written", || {
        StoreWriter::create(&directory, header, &table, true)
    })??;
    drop(table);
    drop(scene);
    let settings = RenderSettings {
        resolution: 128,
        culling: Culling::On,
        covered: false,
    };
    let summary = stage("tree, rows, parts written", || {
        let backend = Box::new(CpuBackend::new());
        compute(
            &model,
            &plan,
            settings,
            backend,
            Execution::default(),
            &mut writer,
            &mut |_| {},
        )
    })??;
    println!(
        "{:28} {:9.2}           of it rows; {:.2} in the writer; {} rows, {} entries",
        "",
        summary.elapsed.as_secs_f64(),
        summary.sink.as_secs_f64(),
        summary.rows,
        summary.entries
    );
    stage("patches written again", || writer.finish())??;
    drop(model);
    let store = stage("open", || Store::open(&directory))??;
    let report = stage("check", || check(&store, &CheckOptions::default()))??;
    if !report.ok {
        return Err(format!("{:?}", report.failures).into());
    }
    let exported = place.join("F.npz");
    stage("export .npz", || {
        let options = ExportOptions {
            overwrite: true,
            ..ExportOptions::default()
        };
        export(&store, &exported, ExportFormat::Npz, options)
    })??;
    std::fs::remove_file(exported)?;
    let peak = std::fs::read_to_string("/proc/self/status")?;
    let peak = peak.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    println!("{peak}");
    Ok(())
}

/// Does something, and says what it took.
fn stage<T>(name: &str, run: impl FnOnce() -> T) -> Result<T, Box<dyn Error>> {
    let (clock, processor) = (Instant::now(), processor_seconds()?);
    let result = run();
    println!(
        "{name:28} {:9.2} {:9.2}",
        clock.elapsed().as_secs_f64(),
        processor_seconds()? - processor
    );
    Ok(result)
}

/// Processor time of this process, ended threads included, as Linux counts it in hundredths.
fn processor_seconds() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/self/stat")?;
    let fields: Vec<&str> = text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |at: usize| {
        fields
            .get(at)
            .ok_or("a short stat")?
            .parse::<f64>()
            .map_err(Box::<dyn Error>::from)
    };
    Ok((ticks(11)? + ticks(12)?) / 100.0)
}
