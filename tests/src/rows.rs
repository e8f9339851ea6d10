//! Rows in memory: straight from a backend, or through the driver.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{Counters, Culling, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::compute::{ComputeError, Execution, Plan, RowChoice, Selection, Summary, compute};
use hemicube::row::RowBlock;
use hemicube::store::Part;
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::InputPatch;

/// Settings with culling on and no covered weights.
pub fn settings(resolution: u32) -> RenderSettings {
    RenderSettings {
        resolution,
        culling: Culling::On,
        covered: false,
    }
}

/// About `count` patches, evenly through the order of work; all of them if there are no more.
pub fn spread(model: &Model, count: usize) -> Vec<InputPatch> {
    let order: Vec<InputPatch> = model.order().collect();
    let count = count.min(order.len()).max(1);
    (0..count).map(|k| order[k * order.len() / count]).collect()
}

/// The hemicubes at the centroids of patches, as the driver makes them; none for a patch without area.
pub fn hemicubes(model: &Model, patches: &[InputPatch]) -> Vec<Hemicube> {
    patches
        .iter()
        .flat_map(|&patch| model.hemicubes(patch, 1, true))
        .collect()
}

/// A hemicube turned about its normal by an angle in radians.
pub fn rolled(mut hemicube: Hemicube, angle: f64) -> Hemicube {
    let [tangent, bitangent, normal] = hemicube.axes;
    let (sine, cosine) = angle.sin_cos();
    let turned: [DVec3; 2] = [tangent * cosine + bitangent * sine, bitangent * cosine - tangent * sine];
    hemicube.axes = [turned[0], turned[1], normal];
    hemicube
}

/// Rows of `hemicubes` by a new session, checked as the driver checks them.
///
/// # Panics
/// When the backend refuses, or a row breaks the contract.
pub fn render(model: &Model, hemicubes: &[Hemicube], settings: RenderSettings) -> (RowBlock, Counters) {
    render_with(&mut CpuBackend::new(), model, hemicubes, settings)
}

/// Rows of `hemicubes` by a given session.
///
/// # Panics
/// As [`render`].
pub fn render_with(
    backend: &mut dyn HemicubeBackend,
    model: &Model,
    hemicubes: &[Hemicube],
    settings: RenderSettings,
) -> (RowBlock, Counters) {
    backend.load(model.geometry(), settings).expect("legal settings");
    let mut rows = RowBlock::default();
    let counters = backend.rows(hemicubes, &mut rows).expect("legal hemicubes");
    rows.check(hemicubes.len(), model.geometry().patch_count, settings.covered)
        .expect("rows that keep the contract");
    (rows, counters)
}

/// A plan of all rows, one hemicube each.
pub fn plan(model: &Model) -> Plan {
    Plan::new(model, RowChoice::All, Selection::default(), 1, true)
}

/// The parts of `plan` and what was done for them.
///
/// # Errors
/// What the driver says.
pub fn parts(
    model: &Model,
    plan: &Plan,
    settings: RenderSettings,
    backend: Box<dyn HemicubeBackend>,
    execution: Execution<'_>,
) -> Result<(Vec<Part>, Summary), ComputeError> {
    let mut sink = Vec::new();
    let summary = compute(model, plan, settings, backend, execution, &mut sink, &mut |_| {})?;
    Ok((sink, summary))
}

/// Whether the counters show that much of the scene was never touched: nodes found hidden, and no more than `share` of
/// the surfaces transformed. Returns the share that was.
///
/// # Errors
/// What shows that nothing, or too little, was culled.
pub fn culled(counters: &Counters, surfaces: usize, share: f64) -> Result<f64, String> {
    let brute = counters.hemicubes as f64 * surfaces as f64;
    let transformed = counters.triangles_transformed as f64 / brute;
    if counters.nodes_tested == 0 {
        return Err("no node was tested".to_owned());
    }
    if counters.nodes_hidden == 0 {
        return Err("no node was found hidden".to_owned());
    }
    if transformed > share {
        return Err(format!("{:.1} % of the surfaces were transformed", 100.0 * transformed));
    }
    Ok(transformed)
}
