//! Error of computed rows against reference rows by rays, and the verdict on a tolerance.

use crate::args::{EngineSettings, Talk, Tolerance};
use crate::exit::{self, Exit};
use crate::level::asked as asked_for;
use crate::progress::Bar;
use crate::report::{Listing, count, counted, figures, percent};
use anyhow::{Context, Result};
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Groups, Plan, Progress, RowChoice, Selection, compute};
use hemicube::reference::{
    EstimatedRow, Interval, Measured, Reference, ReferenceRow, ReferenceSettings, draw_elements, errors_against,
    row_of_sample, rows_of_patches,
};
use hemicube::store::{Part, RowTable, Store};
use hemicube::{Grouping, InputPatch, Model};
use hemicube_spatial::whole;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};

/// Fewest rows with a spread that bounds the error of undrawn rows.
const ROWS_FOR_THE_MATRIX: u64 = 8;

/// Error target of a reference that judges a tolerance: a third of it. Below the least, rays are too slow; without a
/// tolerance, the most is precise enough for the default rung.
const SHARE_OF_TOLERANCE: f64 = 1.0 / 3.0;
const LEAST_TARGET: f64 = 1e-4;
const MOST_TARGET: f64 = 3e-3;

/// Settings of a reference that judges `tolerance`.
pub(crate) fn reference_settings(tolerance: Option<Tolerance>, seed: u64) -> ReferenceSettings {
    let target = tolerance.map_or(MOST_TARGET, |tolerance| {
        (SHARE_OF_TOLERANCE * tolerance.0).clamp(LEAST_TARGET, MOST_TARGET)
    });
    let suits = ReferenceSettings::default();
    let times = whole::to_u64(MOST_TARGET / target);
    ReferenceSettings {
        target,
        max_rays: suits.max_rays * times.clamp(1, 8),
        seed,
    }
}

/// Computes the reference rows of `emitters` in order, on several threads; only the finished ones if cancelled.
pub(crate) fn reference_rows(
    reference: &Reference<'_>,
    emitters: &[InputPatch],
    threads: usize,
    cancel: &AtomicBool,
    progress: &mut dyn FnMut(u64),
) -> Result<Vec<ReferenceRow>> {
    let next = AtomicUsize::new(0);
    let mut rows: Vec<Option<ReferenceRow>> = vec![None; emitters.len()];
    std::thread::scope(|scope| -> Result<()> {
        let (sender, receiver) = mpsc::channel();
        for _ in 0..threads.clamp(1, emitters.len().max(1)) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                while !cancel.load(Ordering::Relaxed) {
                    let place = next.fetch_add(1, Ordering::Relaxed);
                    let Some(&emitter) = emitters.get(place) else { break };
                    let row = reference.row(emitter);
                    // A row that the interrupt ended means nothing.
                    if cancel.load(Ordering::Relaxed) || sender.send((place, row)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        progress(0);
        for (done, (place, row)) in (1..).zip(receiver) {
            if let Some(slot) = rows.get_mut(place) {
                *slot = Some(row?);
            }
            progress(done);
        }
        Ok(())
    })?;
    Ok(rows.into_iter().flatten().collect())
}

/// Most elements of a patch with a reference row; of patches with more, so many are drawn.
const MOST_ELEMENTS: usize = 32;

/// Settings of a reference for the drawn rows, of `elements` elements a patch. The errors of n elements average out in
/// the row of their patch: each may be √n times as large.
fn settings_of(verify: Verify<'_>, elements: f64) -> ReferenceSettings {
    let settings = reference_settings(verify.tolerance, verify.seed);
    ReferenceSettings {
        target: (settings.target * elements.max(1.0).sqrt()).min(settings.target.max(MOST_OF_ELEMENT)),
        ..settings
    }
}

/// Largest error target of an element's reference row.
const MOST_OF_ELEMENT: f64 = 0.03;

/// Drops rows of patches some of whose elements have none, after an interrupt.
fn keep_whole(rows: &mut Vec<ReferenceRow>, groups: &Groups, drawn: &[InputPatch]) {
    let mut missing = vec![0_i64; groups.grouping.len()];
    let patch_of = |element: InputPatch| groups.grouping.patch_of(element).0 as usize;
    drawn.iter().for_each(|&element| missing[patch_of(element)] += 1);
    rows.iter()
        .for_each(|row| missing[patch_of(InputPatch(row.emitter))] -= 1);
    rows.retain(|row| missing[patch_of(InputPatch(row.emitter))] == 0);
}

/// Keeps the columns of receivers in reference rows.
fn keep_receivers(rows: &mut [ReferenceRow], receivers: &[bool]) {
    for row in rows {
        let before: f64 = row.values.iter().sum();
        let kept: Vec<usize> = (0..row.columns.len())
            .filter(|&place| {
                let patch = row.columns.get(place).and_then(|&column| usize::try_from(column).ok());
                patch.and_then(|patch| receivers.get(patch)).copied().unwrap_or(false)
            })
            .collect();
        row.columns = kept.iter().map(|&place| row.columns[place]).collect();
        row.values = kept.iter().map(|&place| row.values[place]).collect();
        row.errors = kept.iter().map(|&place| row.errors[place]).collect();
        // For all that is known, the mass that rays missed is spread like the mass that they found.
        let share = if before > 0.0 {
            row.values.iter().sum::<f64>() / before
        } else {
            0.0
        };
        row.missed *= share;
        row.missed_squared *= share;
        row.error_of_missed *= share;
    }
}

/// Distances of Σ F plus the row's losses from 1, over the rows, and the reference's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Closure {
    /// Rows with known shares.
    rows: u64,
    /// Rows farther from 1 than the tolerance, if one was asked for.
    beyond: Option<u64>,
    mean: f64,
    max: f64,
    reference_mean: f64,
    reference_max: f64,
    /// The standard error of Σ F + escaped + blocked of the reference, on average.
    reference_noise: f64,
    /// Upper bound of the reference's likely deficit of Σ F.
    reference_missed: f64,
}

/// |Σ F − passed + escaped + blocked + unselected − 1| of a stored row; `None` without known shares.
fn closure_of(sum: f64, patch: InputPatch, table: &RowTable) -> Option<f64> {
    let of = |column: &[f64]| {
        usize::try_from(patch.0)
            .ok()
            .and_then(|patch| column.get(patch))
            .copied()
    };
    let lost = of(&table.escaped)? + of(&table.blocked)? + of(&table.unselected)?;
    let lost = lost - table.passed_of(usize::try_from(patch.0).ok()?);
    (!lost.is_nan()).then(|| (sum + lost - 1.0).abs())
}

impl Closure {
    /// From the rows of the reference with all their columns, and the stored ones.
    fn of(
        reference: &[ReferenceRow],
        estimated: &[EstimatedRow],
        table: &RowTable,
        tolerance: Option<Tolerance>,
    ) -> Self {
        let found: Vec<f64> = estimated
            .iter()
            .filter_map(|row| closure_of(row.values.iter().sum(), row.emitter, table))
            .collect();
        let own: Vec<f64> = reference.iter().map(|row| (row.closure() - 1.0).abs()).collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
        // NaN must show.
        let max = |values: &[f64]| values.iter().copied().fold(0.0, |a: f64, b| if b <= a { a } else { b });
        let noise: Vec<f64> = reference.iter().map(ReferenceRow::closure_noise).collect();
        let missed: Vec<f64> = reference.iter().map(|row| row.missed).collect();
        Self {
            rows: found.len() as u64,
            // NaN is within nothing.
            beyond: tolerance.map(|tolerance| found.iter().filter(|&&f| f.is_nan() || f > tolerance.0).count() as u64),
            mean: mean(&found),
            max: max(&found),
            reference_mean: mean(&own),
            reference_max: max(&own),
            reference_noise: mean(&noise),
            reference_missed: max(&missed),
        }
    }
}

/// The request of `--verify`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Verify<'a> {
    pub(crate) rows: u32,
    pub(crate) seed: u64,
    pub(crate) tolerance: Option<Tolerance>,
    pub(crate) threads: usize,
    pub(crate) cancel: &'a AtomicBool,
    /// Computes the rows of elements again, where a patch has too many to trace each.
    pub(crate) engine: &'a EngineSettings,
}

/// Elements drawn from the patches that have too many.
struct Samples<'a> {
    grouping: &'a Grouping,
    /// By patch, several of one element included.
    drawn: BTreeMap<u32, Vec<InputPatch>>,
}

impl<'a> Samples<'a> {
    /// Takes from `rows` those of patches with too many, and leaves the elements drawn. Seeded.
    fn draw(rows: &mut Vec<InputPatch>, grouping: &'a Grouping, model: &Model, seed: u64) -> Self {
        let mut of_patch: BTreeMap<u32, Vec<InputPatch>> = BTreeMap::new();
        for &element in rows.iter() {
            of_patch.entry(grouping.patch_of(element).0).or_default().push(element);
        }
        of_patch.retain(|_, elements| elements.len() > MOST_ELEMENTS);
        for elements in of_patch.values_mut() {
            let area = |element| model.patches().area(element);
            *elements = draw_elements(elements, MOST_ELEMENTS, area, seed);
        }
        let wanted: BTreeSet<InputPatch> = of_patch.values().flatten().copied().collect();
        rows.retain(|element| !of_patch.contains_key(&grouping.patch_of(*element).0) || wanted.contains(element));
        Self {
            grouping,
            drawn: of_patch,
        }
    }

    /// The elements drawn, each once, in the order of `rows`.
    fn elements(&self, rows: &[InputPatch]) -> Vec<InputPatch> {
        let is_drawn = |element: &&InputPatch| self.drawn.contains_key(&self.grouping.patch_of(**element).0);
        rows.iter().filter(is_drawn).copied().collect()
    }

    /// Splits rows into those of patches drawn from, by element, and the others.
    fn split(&self, rows: Vec<ReferenceRow>) -> (BTreeMap<u32, ReferenceRow>, Vec<ReferenceRow>) {
        let (own, others): (Vec<_>, Vec<_>) = rows.into_iter().partition(|row| {
            let patch = self.grouping.patch_of(InputPatch(row.emitter));
            self.drawn.contains_key(&patch.0)
        });
        (own.into_iter().map(|row| (row.emitter, row)).collect(), others)
    }

    /// The reference rows of the patches drawn from, all of whose elements have come.
    fn rows(
        &self,
        traced: &BTreeMap<u32, ReferenceRow>,
        computed: &BTreeMap<u32, EstimatedRow>,
        stored: impl Fn(InputPatch) -> Result<Option<EstimatedRow>>,
    ) -> Result<Vec<ReferenceRow>> {
        let mut found = Vec::new();
        for (&patch, elements) in &self.drawn {
            let pairs = elements.iter().map(|element| {
                let pair = (computed.get(&element.0)?.clone(), traced.get(&element.0)?.clone());
                Some(pair)
            });
            if let (Some(pairs), Some(stored)) = (pairs.collect::<Option<Vec<_>>>(), stored(InputPatch(patch))?) {
                found.push(row_of_sample(&stored, &pairs, self.grouping));
            }
        }
        Ok(found)
    }
}

/// Verdict on a tolerance, within the confidence that the rows and the reference allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// The whole interval is within it.
    Kept,
    /// The whole interval is beyond it.
    Broken,
    /// The reference's own noise is too large to say.
    UnsureForNoise,
    /// Too few rows were drawn to say.
    UnsureForRows,
}

impl Verdict {
    /// Judges the error of `measured.rows` rows out of `row_count`.
    fn of(measured: &Measured, row_count: u64, tolerance: Tolerance) -> Self {
        let all = measured.rows >= row_count;
        let matrix = if all {
            measured.interval_of_rows
        } else {
            measured.interval_of_matrix
        };
        let side = |interval: Interval| match interval {
            // NaN is within nothing.
            Interval { low, high } if low.is_nan() || high.is_nan() || low > tolerance.0 => Self::Broken,
            Interval { high, .. } if high <= tolerance.0 => Self::Kept,
            _ => Self::UnsureForNoise,
        };
        let of_rows = side(measured.interval_of_rows);
        let enough = all || measured.rows >= ROWS_FOR_THE_MATRIX;
        match side(matrix) {
            verdict @ (Self::Kept | Self::Broken) if enough => verdict,
            _ if of_rows == Self::UnsureForNoise => Self::UnsureForNoise,
            _ => Self::UnsureForRows,
        }
    }
}

/// The measured error of a run.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Verification {
    rows: u64,
    rows_asked: u64,
    rows_computed: u64,
    seed: u64,
    reference_target: f64,
    /// Reference rows that the bound on their rays ended off that target; their errors hold what was left.
    #[serde(skip_serializing_if = "is_zero")]
    reference_cut_short: u64,
    tolerance: Option<f64>,
    verdict: Option<Verdict>,
    interrupted: bool,
    measured: Measured,
    closure: Closure,
    /// Only of patches that are several triangles.
    #[serde(skip_serializing_if = "Option::is_none")]
    elements: Option<Elements>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Triangles traced for rows of patches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Elements {
    /// Reference rows of triangles.
    rows: u64,
    /// Patches of which some triangles were drawn.
    patches: u64,
    /// Numbers of each.
    most: u64,
}

/// A row of the store.
fn of_store(store: &Store, patch: InputPatch) -> Result<Option<EstimatedRow>> {
    let stored = store.row(patch)?;
    Ok(stored.map(|stored| EstimatedRow {
        emitter: patch,
        columns: stored.indices,
        values: stored.data.into_f64(),
    }))
}

impl Verify<'_> {
    /// Draws rows from `plan`, computes their references, and compares the rows of `store`.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub(crate) fn run(self, model: &Model, plan: &Plan, store: &Store, talk: Talk) -> Result<Verification> {
        let mut computed = vec![false; model.patches().len()];
        for row in &plan.rows {
            if let Some(mark) = computed.get_mut(row.0 as usize) {
                *mark = true;
            }
        }
        let among = Selection {
            emitters: Some(computed),
            receivers: None,
        };
        let choice = RowChoice::Sample {
            count: self.rows,
            seed: self.seed,
        };
        let grouping = plan.groups.as_ref().map(|groups| Arc::clone(&groups.grouping));
        let drawn = Plan::grouped(model, choice, among, 1, plan.rotate, grouping);
        let groups = drawn.groups.as_ref();
        let mut drawn_rows = drawn.rows.clone();
        let samples = groups.map(|groups| Samples::draw(&mut drawn_rows, &groups.grouping, model, self.seed));
        let settings = settings_of(self, drawn_rows.len() as f64 / drawn.row_count().max(1) as f64);
        let reference = Reference::new(model, settings).context("there is no reference to verify against")?;
        let reference = reference.with_portals(&plan.portals).cancelled_by(self.cancel);
        // An interrupt ends the reference; the errors of the rows before it are reported.
        let guard = exit::InterruptGuard::new();
        let bar = Bar::rows(talk, drawn_rows.len() as u64, 0);
        let row_count = drawn_rows.len() as u64;
        let mut rows = reference_rows(&reference, &drawn_rows, self.threads, self.cancel, &mut |done| {
            bar.show(Progress {
                rows: done,
                row_count,
                entries: 0,
            });
        })?;
        drop(bar);
        let all = rows.len() == drawn_rows.len();
        if let Some(groups) = groups {
            keep_whole(&mut rows, groups, &drawn_rows);
        }
        let again = samples.as_ref().map(|samples| samples.elements(&drawn_rows));
        let computed = again
            .map(|again| self.computed(again, model, plan, store))
            .transpose()?;
        drop(guard);
        let stored = |patch| of_store(store, patch);
        let of_patches = |rows: Vec<ReferenceRow>| -> Result<Vec<ReferenceRow>> {
            let (Some(groups), Some(samples), Some(computed)) = (groups, &samples, &computed) else {
                return Ok(rows);
            };
            let (traced, others) = samples.split(rows);
            let mut found = rows_of_patches(&others, &groups.grouping, |element| model.patches().area(element));
            found.extend(samples.rows(&traced, computed, stored)?);
            Ok(found)
        };
        let with_all_columns = of_patches(rows.clone())?;
        let mut estimated = Vec::with_capacity(with_all_columns.len());
        for row in &with_all_columns {
            estimated.extend(stored(InputPatch(row.emitter))?);
        }
        let closure = Closure::of(&with_all_columns, &estimated, &store.row_table()?, self.tolerance);
        let judged = match &plan.selection.receivers {
            Some(receivers) => {
                keep_receivers(&mut rows, receivers);
                of_patches(rows)?
            }
            None => with_all_columns,
        };
        Ok(Verification {
            interrupted: !all,
            closure,
            elements: samples.map(|samples| Elements {
                rows: row_count,
                patches: samples.drawn.len() as u64,
                most: MOST_ELEMENTS as u64,
            }),
            ..self.judge(&judged, &estimated, plan.row_count() as u64, settings.target)
        })
    }

    /// Computes the rows of elements as for the store, by their numbers.
    fn computed(
        self,
        elements: Vec<InputPatch>,
        model: &Model,
        plan: &Plan,
        store: &Store,
    ) -> Result<BTreeMap<u32, EstimatedRow>> {
        if elements.is_empty() {
            return Ok(BTreeMap::new());
        }
        let mut emitters = vec![false; model.patches().len()];
        for element in &elements {
            if let Some(mark) = emitters.get_mut(element.0 as usize) {
                *mark = true;
            }
        }
        let selection = Selection {
            emitters: Some(emitters),
            receivers: plan.selection.receivers.clone(),
        };
        let rows = Plan::new(model, RowChoice::All, selection, plan.samples_per_edge, plan.rotate)
            .with_correction(plan.correction)
            .with_portals(Arc::clone(&plan.portals));
        let resolution = store.manifest().settings["resolution"].as_u64();
        let render = RenderSettings {
            resolution: resolution
                .and_then(|n| u32::try_from(n).ok())
                .context("the store does not say its resolution")?,
            culling: Culling::On,
            covered: false,
        };
        let execution = Execution {
            threads: self.threads,
            batch: 0,
            cancel: None,
        };
        let (backend, mut parts) = (self.engine.open_backend(Talk::SILENT)?, Vec::<Part>::new());
        compute(model, &rows, render, backend, execution, &mut parts, &mut |_| {})?;
        let rows = parts.iter().flat_map(EstimatedRow::of_part);
        Ok(rows.map(|row| (row.emitter.0, row)).collect())
    }

    /// Holds rows against their references, out of `rows_computed`.
    fn judge(
        self,
        rows: &[ReferenceRow],
        estimated: &[EstimatedRow],
        rows_computed: u64,
        reference_target: f64,
    ) -> Verification {
        let measured = errors_against(rows, estimated);
        let judged = self.tolerance.filter(|_| measured.rows > 0);
        Verification {
            rows: measured.rows,
            rows_asked: self.rows.into(),
            rows_computed,
            seed: self.seed,
            reference_target,
            reference_cut_short: rows.iter().filter(|row| row.cut_short).count() as u64,
            tolerance: self.tolerance.map(|tolerance| tolerance.0),
            verdict: judged.map(|tolerance| Verdict::of(&measured, rows_computed, tolerance)),
            interrupted: false,
            measured,
            closure: Closure::default(),
            elements: None,
        }
    }
}

impl Verification {
    /// Exit of the program.
    pub(crate) fn exit(&self) -> Exit {
        if self.interrupted {
            Exit::Interrupted
        } else if self.verdict == Some(Verdict::Broken) {
            Exit::NotHeld
        } else {
            Exit::Done
        }
    }

    fn add_closure(&self, list: &mut Listing) {
        let c = &self.closure;
        if c.rows > 0 {
            let beyond = match (c.beyond, self.tolerance) {
                (Some(beyond), Some(tolerance)) => format!(
                    "; {} of {} farther than {}",
                    count(beyond),
                    counted(c.rows, "row"),
                    asked_for(tolerance)
                ),
                _ => String::new(),
            };
            list.add(
                "closure",
                format!(
                    "|sum of F + escaped + blocked - 1| is {} on average, {} at most{beyond}",
                    figures(c.mean),
                    figures(c.max)
                ),
            );
        }
        list.add(
            "",
            format!(
                "the reference's rows up to {} on average, {} at most; its own noise is {}",
                figures(c.reference_mean),
                figures(c.reference_max),
                figures(c.reference_noise)
            ),
        );
        if c.reference_missed > self.reference_target {
            list.add(
                "",
                format!(
                    "its rows may lack {} in patches that it had no rays left to look at",
                    figures(c.reference_missed)
                ),
            );
        }
    }

    fn add_rows(&self, list: &mut Listing) {
        let rows = if self.rows >= self.rows_computed {
            format!("all {}", counted(self.rows, "row"))
        } else {
            format!(
                "{} of {} (seed {})",
                count(self.rows),
                counted(self.rows_computed, "row"),
                self.seed
            )
        };
        let interrupted = if self.interrupted { "; interrupted" } else { "" };
        list.add("verified", format!("{rows} against rays{interrupted}"));
        if let Some(elements) = self.elements.filter(|_| self.rows > 0) {
            let drawn = if elements.patches > 0 {
                format!(
                    ": {} drawn of each of {}, and the rest in full; intervals and noise hold what the draw leaves \
                     open",
                    elements.most,
                    counted(elements.patches, "large patch")
                )
            } else {
                String::new()
            };
            list.add(
                "",
                format!(
                    "by {} of triangles{drawn}",
                    counted(elements.rows, "row").replace("row", "reference row")
                ),
            );
        }
    }

    /// The measured error and the verdict, in a line.
    pub(crate) fn line(&self) -> String {
        if self.rows == 0 {
            return format!("no row{}", if self.interrupted { "; interrupted" } else { "" });
        }
        let m = &self.measured;
        let is_whole = self.rows >= self.rows_computed;
        let (rows, of, interval) = if is_whole {
            (format!("all {}", counted(self.rows, "row")), "them", m.interval_of_rows)
        } else {
            (counted(self.rows, "row"), "the whole matrix", m.interval_of_matrix)
        };
        let verdict = match (self.tolerance, self.verdict) {
            (Some(tolerance), Some(verdict)) => format!(": {}", self.says(verdict, tolerance)),
            _ => String::new(),
        };
        format!(
            "{} by rays in {rows}, {} to {} in {of} (95 %){verdict}{}",
            percent(m.relative_frobenius),
            percent(interval.low),
            percent(interval.high),
            if self.interrupted { "; interrupted" } else { "" },
        )
    }

    /// A verdict on the tolerance, in words.
    fn says(&self, verdict: Verdict, tolerance: f64) -> String {
        match verdict {
            Verdict::Kept => format!("{} kept", asked_for(tolerance)),
            Verdict::Broken => {
                format!(
                    "FAILED, {} is not kept; a smaller `--tolerance` leaves a margin",
                    asked_for(tolerance)
                )
            }
            Verdict::UnsureForNoise => "the reference is too noisy to judge".to_owned(),
            Verdict::UnsureForRows => format!("too few rows to judge; try `--verify {}`", 4 * self.rows_asked),
        }
    }

    /// All that was measured, for `-v`.
    pub(crate) fn text(&self) -> String {
        let m = &self.measured;
        let mut list = Listing::default();
        self.add_rows(&mut list);
        if self.rows == 0 {
            return list.text();
        }
        let range = |interval: Interval| format!("{} to {}", percent(interval.low), percent(interval.high));
        list.add(
            "error",
            format!("{} relative Frobenius, in these rows", percent(m.relative_frobenius)),
        );
        list.add("", format!("95 %: {} in these rows", range(m.interval_of_rows)));
        if self.rows < self.rows_computed {
            list.add("", format!("95 %: {} in the whole matrix", range(m.interval_of_matrix)));
        }
        list.add(
            "row errors",
            format!(
                "{} in the median, {} in the 90th percentile",
                percent(m.row_error.median),
                percent(m.row_error.percentile_90)
            ),
        );
        list.add(
            "L1",
            format!(
                "{} in the median, {} in the 90th percentile",
                percent(m.row_l1.median),
                percent(m.row_l1.percentile_90)
            ),
        );
        list.add(
            "missed mass",
            format!(
                "{}; {} where the reference has nothing",
                percent(m.missed_mass),
                percent(m.spurious_mass)
            ),
        );
        list.add(
            "sum of F",
            format!(
                "off by {} on average, {} at most; the reference's own noise is {}",
                figures(m.row_sum_error.mean),
                figures(m.row_sum_error.max),
                figures(m.row_sum_noise.mean)
            ),
        );
        self.add_closure(&mut list);
        if let Some(worst) = m.worst_entry {
            list.add(
                "worst entry",
                format!(
                    "F[{}, {}] is {}, by the reference {}",
                    worst.i,
                    worst.j,
                    figures(worst.a),
                    figures(worst.b)
                ),
            );
        }
        let noise = format!("its own noise is {}", percent(m.reference_noise));
        let short = match self.reference_cut_short {
            0 => String::new(),
            short => format!("; the bound on rays ended {} of its rows early", count(short)),
        };
        list.add("reference", noise + &short);
        if let (Some(tolerance), Some(verdict)) = (self.tolerance, self.verdict) {
            list.add("tolerance", self.says(verdict, tolerance));
        }
        list.text()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(rows: u64, of_rows: [f64; 2], of_matrix: [f64; 2]) -> Measured {
        let interval = |[low, high]: [f64; 2]| Interval { low, high };
        Measured {
            rows,
            interval_of_rows: interval(of_rows),
            interval_of_matrix: interval(of_matrix),
            ..Measured::default()
        }
    }

    #[test]
    fn verdicts() {
        let of = |measured: &Measured, row_count| Verdict::of(measured, row_count, Tolerance(0.01));
        let within = measured(20, [0.004, 0.005], [0.003, 0.007]);
        assert_eq!(of(&within, 1000), Verdict::Kept);
        let beyond = measured(20, [0.02, 0.021], [0.011, 0.03]);
        assert_eq!(of(&beyond, 1000), Verdict::Broken);
        // Rows that break it do not prove that the matrix breaks it.
        let wide = measured(20, [0.02, 0.021], [0.008, 0.03]);
        assert_eq!(of(&wide, 1000), Verdict::UnsureForRows);
        assert_eq!(of(&wide, 20), Verdict::Broken);
        let noisy = measured(20, [0.004, 0.014], [0.003, 0.015]);
        assert_eq!(of(&noisy, 1000), Verdict::UnsureForNoise);
        // A handful of rows says nothing of the others, however well they agree.
        let few = measured(3, [0.004, 0.005], [0.004, 0.005]);
        assert_eq!(of(&few, 1000), Verdict::UnsureForRows);
        assert_eq!(of(&few, 3), Verdict::Kept);
        let nan = measured(20, [f64::NAN; 2], [f64::NAN; 2]);
        assert_eq!(of(&nan, 1000), Verdict::Broken);
    }

    #[test]
    fn a_wrong_row_ends_in_one() {
        let reference = ReferenceRow {
            emitter: 4,
            columns: vec![1, 2],
            values: vec![0.3, 0.4],
            errors: vec![1e-5, 1e-5],
            ..ReferenceRow::default()
        };
        let verify = |tolerance: Option<f64>| {
            Verify {
                rows: 1,
                seed: 1,
                tolerance: tolerance.map(Tolerance),
                threads: 1,
                cancel: &AtomicBool::new(false),
                engine: &EngineSettings::default(),
            }
            .judge(
                std::slice::from_ref(&reference),
                &[EstimatedRow {
                    emitter: InputPatch(4),
                    columns: vec![1, 2],
                    // Off by 0.02 of a norm of 0.5.
                    values: vec![0.3, 0.42],
                }],
                1,
                1e-3,
            )
        };
        for (tolerance, exit, says) in [
            (Some(0.03), Exit::NotHeld, "FAILED, 3 % is not kept"),
            (Some(0.05), Exit::Done, "5 % kept"),
            (None, Exit::Done, "4.0 % relative Frobenius"),
        ] {
            let verification = verify(tolerance);
            assert_eq!(verification.exit(), exit);
            assert!(verification.text().contains(says), "{}", verification.text());
        }
    }

    #[test]
    fn rows_that_do_not_add_up_are_told_so() {
        let reference = [ReferenceRow {
            emitter: 1,
            columns: vec![0, 2],
            values: vec![0.3, 0.4],
            errors: vec![3e-4, 4e-4],
            escaped: 0.2999,
            error_of_shares: 1.2e-3,
            ..ReferenceRow::default()
        }];
        let row = |values: &[f64]| {
            let columns: Vec<u32> = if values.len() == 2 { vec![0, 2] } else { vec![2] };
            [EstimatedRow {
                emitter: InputPatch(1),
                columns,
                values: values.to_vec(),
            }]
        };
        let table = RowTable {
            escaped: vec![f64::NAN, 0.3, f64::NAN],
            blocked: vec![f64::NAN, 0.0, f64::NAN],
            unselected: vec![f64::NAN, 0.0, f64::NAN],
            ..RowTable::default()
        };
        let of = |estimated: &[EstimatedRow], table: &RowTable| {
            Closure::of(&reference, estimated, table, Some(Tolerance(0.01)))
        };
        let right = of(&row(&[0.3, 0.4]), &table);
        assert!(right.max < 1e-12 && right.beyond == Some(0), "{right:?}");
        assert!((right.reference_max - 1e-4).abs() < 1e-12 && (right.reference_noise - 1.3e-3).abs() < 1e-12);
        // A pair is left out.
        let wrong = of(&row(&[0.4]), &table);
        assert!((wrong.max - 0.3).abs() < 1e-12 && wrong.beyond == Some(1), "{wrong:?}");
        // Unknown shares prove nothing.
        assert_eq!(of(&row(&[0.4]), &RowTable::unknown(3)).rows, 0);
        assert!(closure_of(f64::NAN, InputPatch(1), &table).is_some_and(f64::is_nan));
        assert_eq!(of(&row(&[f64::NAN, 0.4]), &table).beyond, Some(1));
    }

    #[test]
    fn references_are_finer_than_the_tolerance() {
        let target = |tolerance: Option<f64>| reference_settings(tolerance.map(Tolerance), 1).target;
        assert_eq!(target(None), MOST_TARGET);
        assert_eq!(target(Some(0.5)), MOST_TARGET);
        assert!((target(Some(0.003)) - 0.001).abs() < 1e-12);
        assert_eq!(target(Some(1e-5)), LEAST_TARGET);
        assert!(reference_settings(Some(Tolerance(1e-5)), 1).max_rays > reference_settings(None, 1).max_rays);
    }

    #[test]
    fn columns_that_nobody_asked_for_are_no_error() {
        let mut rows = [ReferenceRow {
            columns: vec![0, 2, 3],
            values: vec![0.1, 0.2, 0.3],
            errors: vec![0.01, 0.02, 0.03],
            missed: 0.06,
            ..ReferenceRow::default()
        }];
        keep_receivers(&mut rows, &[true, true, false, true]);
        assert_eq!(
            (rows[0].columns.as_slice(), rows[0].values.as_slice()),
            (&[0, 3][..], &[0.1, 0.3][..])
        );
        assert_eq!(rows[0].errors, [0.01, 0.03]);
        assert!((rows[0].missed - 0.04).abs() < 1e-12);
    }
}
