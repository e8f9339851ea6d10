//! Rows in memory: straight from a backend, or through the driver.

use glam::DVec3;
use hemicube::Model;
use hemicube::accuracy::correct::{Correction, Refinement};
use hemicube::backend::{Counters, Culling, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::driver::calibrate::{Calibration, calibrate};
use hemicube::driver::compute::{ComputeError, Execution, Plan, RowChoice, Selection, Summary, compute};
use hemicube::driver::level::DEFAULT_TOLERANCE;
use hemicube::row::RowBlock;
use hemicube::store::{HEMICUBE_WEIGHT, Part};
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

/// The hemicubes at the centroids of patches, like the driver's; none for a patch without area.
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

/// A session of the backend named by `HEMICUBE_TEST_BACKEND`, or of the built-in one: tests of form factors must hold
/// over every backend.
///
/// # Panics
/// When it does not open.
pub fn backend() -> Box<dyn HemicubeBackend> {
    match std::env::var("HEMICUBE_TEST_BACKEND") {
        Ok(name) if !name.is_empty() && name != "cpu" => {
            Box::new(crate::plugins::session(&crate::plugins::rust(&name), &[]))
        }
        _ => Box::new(CpuBackend::new()),
    }
}

/// Rows of `hemicubes` by a new session, checked like the driver's.
///
/// # Panics
/// When the backend refuses, or a row breaks the contract.
pub fn render(model: &Model, hemicubes: &[Hemicube], settings: RenderSettings) -> (RowBlock, Counters) {
    render_with(backend().as_mut(), model, hemicubes, settings)
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

/// The parts of `plan`, and the driver's summary.
///
/// # Errors
/// The driver's error.
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

/// A correction and its resolution.
#[derive(Clone, Copy, Debug)]
pub struct Rung {
    /// The correction of weights to form factors.
    pub correction: Correction,
    /// Pixels along an edge of the hemicube.
    pub resolution: u32,
}

impl Rung {
    /// Sums of pixels.
    pub const PIXEL: Self = Self {
        correction: Correction::Pixel,
        resolution: 256,
    };

    /// The default tolerance.
    ///
    /// # Panics
    /// When the backend fails.
    pub fn usual(model: &Model) -> Self {
        Self::settled(model, DEFAULT_TOLERANCE)
    }

    /// A tolerance without calibration, for any scene.
    pub fn tolerance(tolerance: f64) -> Self {
        Self {
            correction: Correction::Tolerance(Refinement::for_tolerance(tolerance)),
            resolution: 128,
        }
    }

    /// The calibration of a tolerance from a sample of the scene's rows.
    ///
    /// # Panics
    /// When the backend fails.
    pub fn settled(model: &Model, tolerance: f64) -> Self {
        let settled = settled(model, tolerance, backend().as_mut()).expect("a backend that keeps its contract");
        Self {
            correction: Correction::Tolerance(settled.refinement),
            resolution: settled.resolution,
        }
    }
}

/// The calibrated level of a tolerance for all rows of a scene, over a backend.
///
/// # Errors
/// As [`calibrate`].
pub fn settled(model: &Model, tolerance: f64, backend: &mut dyn HemicubeBackend) -> Result<Calibration, ComputeError> {
    let emitters: Vec<InputPatch> = model.order().collect();
    let execution = Execution::default();
    calibrate(model, &emitters, &|_| true, true, tolerance, backend, execution)
}

/// A whole matrix in memory, by input patches.
#[derive(Debug)]
pub struct Factors {
    /// (patch, F) of each patch, ascending; none if no row was computed.
    pub rows: Vec<Vec<(u32, f64)>>,
    /// Escaped share of each patch's hemicubes.
    pub escaped: Vec<f64>,
    /// Blocked share of each patch's hemicubes.
    pub blocked: Vec<f64>,
}

impl Factors {
    /// F, 0 without an entry.
    pub fn get(&self, from: InputPatch, to: InputPatch) -> f64 {
        let row = &self.rows[from.0 as usize];
        row.binary_search_by_key(&to.0, |e| e.0).map_or(0.0, |at| row[at].1)
    }

    /// Σ F of a row.
    pub fn sum(&self, from: InputPatch) -> f64 {
        self.rows[from.0 as usize].iter().map(|e| e.1).sum()
    }

    /// Σ F over the patches with `wanted`.
    pub fn sum_to(&self, from: InputPatch, wanted: impl Fn(InputPatch) -> bool) -> f64 {
        let row = self.rows[from.0 as usize].iter();
        row.filter(|e| wanted(InputPatch(e.0))).map(|e| e.1).sum()
    }
}

/// The matrix of all rows, one hemicube each.
///
/// # Errors
/// The driver's error.
pub fn factors(model: &Model, rung: Rung) -> Result<Factors, ComputeError> {
    factors_with(model, rung, backend())
}

/// The matrix of all rows by a given backend.
///
/// # Errors
/// The driver's error.
pub fn factors_with(model: &Model, rung: Rung, backend: Box<dyn HemicubeBackend>) -> Result<Factors, ComputeError> {
    let plan = plan(model).with_correction(rung.correction);
    let (parts, _) = parts(model, &plan, settings(rung.resolution), backend, Execution::default())?;
    let count = model.patches().len();
    let mut factors = Factors {
        rows: vec![Vec::new(); count],
        escaped: vec![0.0; count],
        blocked: vec![0.0; count],
    };
    for part in &parts {
        for (place, (&row, sums)) in part.rows.iter().zip(&part.sums).enumerate() {
            let (columns, values) = part.row(place);
            let entries = columns.iter().zip(values);
            let row = row as usize;
            factors.rows[row] = entries.map(|(&c, v)| (c.cast_unsigned(), v)).collect();
            let share = |weight: u64| weight as f64 / HEMICUBE_WEIGHT as f64;
            (factors.escaped[row], factors.blocked[row]) = (share(sums.escaped), share(sums.blocked));
        }
    }
    Ok(factors)
}

/// Checks that the counters show untouched parts of the scene: nodes found hidden, and no more than `share` of the
/// surfaces transformed. Returns the transformed share.
///
/// # Errors
/// A sign that nothing, or too little, was culled.
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
