//! What a tolerance takes on a given scene: the rung, the resolution and the effort, from a seeded sample of its rows.
//!
//! A few hundred rows from one hemicube each tell the norm that the tolerance is a share of; some dozens of them, held
//! against rays, how far visible fractions from one hemicube are off in this scene ([`Doubts`]). Then the settings, from the
//! cheapest on, are tried on some rows against the same rows with a quarter of the tolerance and twice the reach: the first
//! that keeps the tolerance with a margin is taken. Everything depends on the scene, the settings and the seed: never on a
//! clock.

use crate::Model;
use crate::backend::{Culling, HemicubeBackend, RenderSettings};
use crate::compute::{ComputeError, sample};
use crate::correct::{Correction, fraction};
use crate::factor::FactorRule;
use crate::refine::{Doubts, DoubtSums, Pair, Refined, Refinement, Refiner};
use crate::row::{RowBlock, RowView};
use hemicube_scene::InputPatch;

/// What to compute with so that a tolerance is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// The rung: area, or tolerance with what was learnt of the scene.
    pub correction: Correction,
    /// Pixels along an edge of the hemicube.
    pub resolution: u32,
    /// The relative Frobenius error that the rows tried had.
    pub expected: f64,
    /// The same with one standard error more for the rows not tried.
    pub at_most: f64,
    /// Rows that were tried.
    pub rows: usize,
    /// The same in words.
    pub reason: String,
}

impl Settled {
    /// Whether the tolerance is expected to be kept.
    pub fn keeps(&self, tolerance: f64) -> bool {
        self.at_most <= tolerance
    }
}

const NORM_ROWS: usize = 256;
const TRIED_ROWS: usize = 48;
const SEED: u64 = 0x7E57_0F_70;

/// A rung to try.
#[derive(Clone, Copy)]
struct Rung {
    /// Effort; `None`: nothing is refined.
    effort: Option<f64>,
    resolution: u32,
}

/// From the cheapest to the dearest.
const RUNGS: [Rung; 8] = [
    Rung { effort: None, resolution: 64 },
    Rung { effort: None, resolution: 128 },
    Rung { effort: Some(2.5), resolution: 64 },
    Rung { effort: Some(1.6), resolution: 128 },
    Rung { effort: Some(1.0), resolution: 128 },
    Rung { effort: Some(0.6), resolution: 128 },
    Rung { effort: Some(0.35), resolution: 128 },
    Rung { effort: Some(0.2), resolution: 128 },
];

/// One row as a rung has it.
type Row = Vec<(u32, f64)>;

/// Finds what keeps `tolerance` over the rows of `emitters`.
///
/// # Errors
/// When the backend fails or breaks the contract.
pub fn settle(
    model: &Model,
    emitters: &[InputPatch],
    receives: &dyn Fn(u32) -> bool,
    rotate: bool,
    tolerance: f64,
    backend: &mut dyn HemicubeBackend,
) -> Result<Settled, ComputeError> {
    let rows = sample(emitters, NORM_ROWS, SEED);
    let tried: Vec<usize> = {
        let stride = rows.len().div_ceil(TRIED_ROWS).max(1);
        (0..rows.len()).step_by(stride).collect()
    };
    let coarse = hemicubes(model, &rows, rotate, 64, backend)?;
    let fine = hemicubes(model, &rows, rotate, 128, backend)?;
    let plain = Refinement {
        effort: f64::INFINITY,
        ..Refinement::for_tolerance(tolerance)
    };
    let mut refiner = Refiner::new(plain);
    let mut norm = 0.0;
    for (k, &row) in rows.iter().enumerate() {
        norm += refiner.row(model, row, seen(fine.row(k)), receives).squared_norm;
    }
    let mean_squared_norm = norm / rows.len().max(1) as f64;
    let known = Refinement {
        mean_squared_norm,
        ..Refinement::for_tolerance(tolerance)
    };
    let mut sums = DoubtSums::default();
    let mut refiner = Refiner::new(known);
    for &k in &tried {
        refiner.survey(model, rows[k], seen(fine.row(k)), receives, &mut sums);
    }
    let known = Refinement {
        doubts: sums.doubts(),
        ..known
    };
    let exact = {
        let mut refiner = Refiner::new(Refinement {
            effort: 0.2,
            rule: FactorRule::for_tolerance(tolerance * 0.1),
            ..known
        });
        tried
            .iter()
            .map(|&k| {
                refiner.row(model, rows[k], seen(fine.row(k)), receives);
                values(&refiner.pairs)
            })
            .collect::<Vec<Row>>()
    };
    let norm = mean_squared_norm.max(f64::MIN_POSITIVE);
    let mut best: Option<Settled> = None;
    for rung in RUNGS {
        let refinement = Refinement {
            effort: rung.effort.unwrap_or(f64::INFINITY),
            ..known
        };
        let block = if rung.resolution == 64 { &coarse } else { &fine };
        let mut refiner = Refiner::new(refinement);
        let errors: Vec<f64> = tried
            .iter()
            .zip(&exact)
            .map(|(&k, exact)| {
                refiner.row(model, rows[k], seen(block.row(k)), receives);
                let v = values(&refiner.pairs);
                let e = squared_difference(&v, exact);
                if std::env::var_os("DBGS").is_some() && e > 0.1 * tolerance * tolerance * norm * tried.len() as f64 {
                    eprintln!("rung {:?} row {} share {}", rung.effort, rows[k].0, e / norm / tried.len() as f64);
                    let a: std::collections::BTreeMap<u32, f64> = v.iter().copied().collect();
                    let b: std::collections::BTreeMap<u32, f64> = exact.iter().copied().collect();
                    let mut d: Vec<_> = a.keys().chain(b.keys()).map(|p| (a.get(p).unwrap_or(&0.0) - b.get(p).unwrap_or(&0.0), *p)).collect();
                    d.sort_by(|p, q| q.0.abs().total_cmp(&p.0.abs()));
                    d.dedup();
                    for (x, p) in d.iter().take(3) { let pair = refiner.pairs.iter().find(|q| q.patch == *p); eprintln!("   {p}: off {x}, exact {:?} pair {pair:?}", b.get(p)); }
                }
                e
            })
            .collect();
        let count = errors.len().max(1) as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (count * (count - 1.0).max(1.0));
        let settled = Settled {
            correction: match rung.effort {
                None => Correction::Area(refinement.rule),
                Some(_) => Correction::Tolerance(refinement),
            },
            resolution: rung.resolution,
            expected: (mean / norm).sqrt(),
            at_most: ((mean + variance.sqrt()) / norm).sqrt(),
            rows: errors.len(),
            reason: String::new(),
        };
        let keeps = settled.keeps(tolerance);
        best = Some(settled);
        if keeps {
            break;
        }
    }
    let mut settled = best.unwrap_or_else(|| unreachable!("there are rungs"));
    settled.reason = format!("{:?} {:?}", settled.correction, known.doubts);
    Ok(settled)
}

fn values(pairs: &[Pair]) -> Row {
    pairs
        .iter()
        .filter(|pair| pair.open * pair.fraction > 0.0)
        .map(|pair| (pair.patch, pair.open * pair.fraction))
        .collect()
}

/// Σ (a − b)² of two rows with ascending patches.
fn squared_difference(a: &Row, b: &Row) -> f64 {
    let (mut at, mut sum) = (0, 0.0);
    for &(patch, value) in a {
        while at < b.len() && b[at].0 < patch {
            sum += b[at].1.powi(2);
            at += 1;
        }
        if at < b.len() && b[at].0 == patch {
            sum += (value - b[at].1).powi(2);
            at += 1;
        } else {
            sum += value * value;
        }
    }
    sum + b[at..].iter().map(|e| e.1.powi(2)).sum::<f64>()
}

fn seen(row: RowView<'_>) -> impl Iterator<Item = (u32, f64)> + '_ {
    row.patches
        .iter()
        .zip(row.visible)
        .zip(row.covered)
        .map(|((&patch, &visible), &covered)| (patch, fraction(visible, covered)))
}

/// One hemicube for each row.
fn hemicubes(
    model: &Model,
    rows: &[InputPatch],
    rotate: bool,
    resolution: u32,
    backend: &mut dyn HemicubeBackend,
) -> Result<RowBlock, ComputeError> {
    let settings = RenderSettings {
        resolution,
        culling: Culling::On,
        covered: true,
    };
    let name = backend.info().name.clone();
    let failed = |source| ComputeError::Backend {
        backend: name.clone(),
        source,
    };
    backend.load(model.geometry(), settings).map_err(failed)?;
    let mut block = RowBlock::default();
    let asked: Vec<_> = rows.iter().flat_map(|&row| model.hemicubes(row, 1, rotate)).collect();
    backend.rows(&asked, &mut block).map_err(failed)?;
    block
        .check(asked.len(), model.geometry().patch_count, true)
        .map_err(|source| ComputeError::Row {
            backend: name.clone(),
            patch: rows.first().map_or(0, |p| p.0),
            source,
        })?;
    Ok(block)
}
