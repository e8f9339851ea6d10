//! Balancing of a stored matrix: reciprocity, closure, and leaving out small entries. An explicit step after the
//! computation, recorded in the result's manifest.
//!
//! ```text
//! symmetrise  Sᵢⱼ = Aᵢ Aⱼ (Fᵢⱼ + Fⱼᵢ) / (Aᵢ + Aⱼ), at most min(Aᵢ, Aⱼ)     the mean of Aᵢ Fᵢⱼ and Aⱼ Fⱼᵢ, each row
//!                                                                         weighted by the other patch's area
//! drop        the pair (i, j) where both Sᵢⱼ / Aᵢ and Sᵢⱼ / Aⱼ are below the least factor
//! scale       Fᵢⱼ = dᵢ Sᵢⱼ dⱼ / Aᵢ with Σⱼ dᵢ Sᵢⱼ dⱼ = Aᵢ tᵢ for every row
//!             tᵢ = 1 − escapedᵢ − blockedᵢ for closure; otherwise what row i summed to before the drop
//! ```
//!
//! A small patch sees a large one better from its one hemicube than the large one sees it: hence the weights. A pair in
//! one row only is averaged with the other row's 0: both rows are observations of the pair, and one of them saw
//! nothing.
//!
//! The scaling is that of Sinkhorn & Knopp (1967) in its symmetric form, S' = D S D (Csima & Datta 1972); van Leersum
//! (1989) and Lawson (1995) scale or smooth view factors for the same purpose. It minimises ½ Σ dᵢ Sᵢⱼ dⱼ − Σ Aᵢ tᵢ ln
//! dᵢ, convex in ln d, one dᵢ = Aᵢ tᵢ / Σⱼ Sᵢⱼ dⱼ after the other, in the order of work. No scaling reaches sums that
//! contradict the entries: a patch sees one other only, and that one sees less of it; or, far more often, tᵢ is wrong,
//! because one hemicube at a centroid lost most of the patch's view. Unbounded d would spoil all entries around such a
//! row. Every dᵢ therefore stays within a bound, and rows at the bound are counted.
//!
//! **Use.** For solvers that need energy to balance. It adds nothing unseen by the hemicubes: sums of pixels come
//! nearer to the reference by it. The shares of a corrected row are refined with it
//! ([`RowShares`](hemicube_store::RowShares)): in the open tᵢ is the row's sum already, and exact factors stay unchanged;
//! where nothing is lost, tᵢ = 1 moves all of the row alike, usually away from the reference.
//! `what_balancing_does_to_the_error` in promises::balance measures it.
//!
//! Where mirrors and panes hand on p = ρs + τ of what arrives, rows close by what is kept:
//!
//! ```text
//! Σⱼ dᵢ Sᵢⱼ dⱼ (1 − pⱼ) = Aᵢ tᵢ        tᵢ = 1 − escapedᵢ − blockedᵢ − cut offᵢ        passedᵢ = Σⱼ pⱼ Fᵢⱼ, anew
//! ```
//!
//! With Aᵢ (1 − pᵢ) and Sᵢⱼ (1 − pᵢ) (1 − pⱼ) that is the scaling above; a patch that keeps nothing is scaled by its
//! own row alone. More than min(Aᵢ, Aⱼ) may arrive there, and small entries stay.
//!
//! Without reciprocity and closure, rows stay on their own: entries below the least factor are left out, and the others
//! of the row share their sum in proportion. A row that would grow beyond the bound keeps all.
//!
//! The result is in the plain form, whatever the source's: equalities made here would not survive 16 bits.
//!
//! **Out of core.** In memory are some vectors of one number a patch, and one part. A row needs its column: entries are
//! sorted into a file beside the result, one run for each part with the column's row (`exchange`), at the cost of one
//! write and one read of 12 bytes an entry. Passes over the store for one block of columns each would need no disk, but
//! size / memory reads of the whole matrix. The symmetric matrix is a second such file of 8 bytes an entry, read once a
//! sweep (`symmetric`). Everything runs in one thread and one order: equal input gives equal bytes.

mod exchange;
mod residual;
mod symmetric;

pub use hemicube_store::{BalanceEntry, BalanceSource, Residuals};

use exchange::{Exchange, Survey};
use hemicube_store::closure::{share_of, target_of};
use hemicube_store::small_entries::{MAX_SCALE, SmallEntryRule, sums};
use hemicube_store::{Error, FactorVec, Form, Header, Manifest, Part, PatchTable, Result, Store, StoreWriter};
use residual::{Tally, merge};
use serde::Serialize;
use std::path::{Path, PathBuf};
use symmetric::{Scaling, Symmetric};

/// The least tolerance of the sweeps: form factors are stored as f32, and a row's rounding adds up.
pub const TOLERANCE_MIN: f64 = 1e-7;

/// The largest [`BalanceOptions::max_scale`]: beyond it nothing is left of the computed matrix.
pub const MAX_SCALE_MAX: f64 = 16.0;

/// Options of balancing.
#[derive(Clone, Debug, PartialEq)]
pub struct BalanceOptions {
    /// Scale rows and columns alike until every row sums to 1 minus its shares. Implies `reciprocity`.
    pub closure: bool,
    /// Make Aᵢ Fᵢⱼ and Aⱼ Fⱼᵢ equal.
    pub reciprocity: bool,
    /// Leave out form factors below this, and give their sum to the other entries of the row; 0: leave out none.
    pub min_factor: f64,
    /// Bound on the scaling of a row, up or down; an entry is scaled by its square at most. A row that needs more has a
    /// wrong sum or lacks entries, and would spoil the other rows: it stays at the bound, and is counted.
    pub max_scale: f64,
    /// The sweeps end when no dᵢ changes by more than this share: no row is then off by more.
    pub tolerance: f64,
    /// When they end anyway.
    pub max_sweeps: u32,
    /// Replace an existing store.
    pub overwrite: bool,
}

impl Default for BalanceOptions {
    fn default() -> Self {
        Self {
            closure: false,
            reciprocity: false,
            min_factor: 0.0,
            max_scale: MAX_SCALE,
            tolerance: 1e-6,
            max_sweeps: 1000,
            overwrite: false,
        }
    }
}

impl BalanceOptions {
    fn is_symmetric(&self) -> bool {
        self.closure || self.reciprocity
    }

    /// Why these options make no sense, if they do not.
    fn reason_against(&self) -> Option<String> {
        if !self.is_symmetric() && self.min_factor == 0.0 {
            return Some("nothing is to be done: ask for closure, reciprocity or a least factor".to_owned());
        }
        if !(0.0..1.0).contains(&self.min_factor) {
            return Some(format!(
                "the least factor {} is not from 0 up to 1; no form factor is larger",
                self.min_factor
            ));
        }
        if !(TOLERANCE_MIN..1.0).contains(&self.tolerance) {
            return Some(format!(
                "the tolerance {} is not from {TOLERANCE_MIN:e} up to 1; form factors are stored with seven digits",
                self.tolerance
            ));
        }
        if !(self.max_scale > 1.0 && self.max_scale <= MAX_SCALE_MAX) {
            return Some(format!(
                "the largest scale {} is not above 1 and up to {MAX_SCALE_MAX}",
                self.max_scale
            ));
        }
        if self.max_sweeps == 0 {
            return Some("no sweep is allowed; allow at least 1".to_owned());
        }
        None
    }
}

/// Result of balancing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BalanceReport {
    /// The matrix balanced.
    pub source: PathBuf,
    /// The balanced matrix.
    pub output: PathBuf,
    /// Rows and columns of the scene.
    pub patch_count: u32,
    /// Rows of the matrix.
    pub rows: u64,
    /// Size of the source on the disk.
    pub bytes_before: u64,
    /// Size of the result on the disk.
    pub bytes_after: u64,
    /// The record in the manifest.
    pub balance: BalanceEntry,
}

/// Writes a balanced copy of `store` to the directory `output`.
///
/// # Errors
/// [`Error::Unsupported`] for an incomplete matrix or, for closure and reciprocity, one without a row or a column for
/// every patch, or with patches without area. [`Error::Refused`] for options out of range. [`Error::DiskTooSmall`]
/// before anything is written, [`Error::NoSpace`] after; otherwise errors of reading and writing. After an error the
/// result is not there or, by its manifest, not complete.
///
/// ```
/// use hemicube_solve::analysis::balance::{BalanceOptions, balance};
/// use hemicube_store::Store;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let output = folder.path().join("balanced.hemicube");
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
///
/// // Two hemicubes see each other's patches from two points: Aᵢ Fᵢⱼ and Aⱼ Fⱼᵢ differ until they are made equal.
/// let options = BalanceOptions { reciprocity: true, ..BalanceOptions::default() };
/// let done = balance(&store, &output, &options)?.balance;
/// assert!(done.before.reciprocity > 0.01 && done.after.reciprocity < 1e-6);
///
/// // The copy says what it is; the original is as it was.
/// assert_eq!(Store::open(&output)?.manifest().balance, Some(done));
/// assert_eq!(store.manifest().balance, None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn balance(store: &Store, output: &Path, options: &BalanceOptions) -> Result<BalanceReport> {
    if let Some(reason) = options.reason_against() {
        return Err(Error::refused(output, reason));
    }
    if store.manifest().has_specular() && options.min_factor > 0.0 {
        let reason = "a matrix without small entries of one with mirrors or panes: what its rows hand on rests on all \
                      of them; ask for closure or reciprocity alone";
        return Err(Error::refused(output, reason.to_owned()));
    }
    if store.manifest().passes_by_angle() {
        let reason = "a balanced matrix of one with mirrors or panes whose optics depend on the angle: its rows keep \
                      parts of arrivals that no single number has; balance one with constants";
        return Err(Error::refused(output, reason.to_owned()));
    }
    require_another(store, output)?;
    require_whole(store)?;
    if options.is_symmetric() {
        require_square(store)?;
    }
    let table = store.verify_patches().and_then(|()| store.patches())?;
    let areas = Areas::new(store, &table, options.is_symmetric())?;
    let survey = Survey::new(store, &table)?;
    require_room(store, output, options)?;
    let mut writer = StoreWriter::create(output, header(store, options)?, &table, options.overwrite)?;
    drop(table);
    let entry = if options.is_symmetric() {
        balance_pairs(store, &mut writer, &areas, &survey, options)?
    } else {
        balance_rows(store, &mut writer, &areas, &survey, options)?
    };
    writer.record_balance(entry.clone());
    let manifest = writer.finish()?;
    Ok(BalanceReport {
        source: store.directory().to_owned(),
        output: output.to_owned(),
        patch_count: store.patch_count(),
        rows: manifest.rows_present(),
        bytes_before: size_of(store.directory(), store.manifest()),
        bytes_after: size_of(output, &manifest),
        balance: entry,
    })
}

/// Areas as shares of the largest one, with their roots: no product of them leaves the range of f64.
#[derive(Debug)]
pub(crate) struct Areas {
    pub(crate) share: Vec<f64>,
    pub(crate) root: Vec<f64>,
}

impl Areas {
    fn new(store: &Store, table: &PatchTable, is_symmetric: bool) -> Result<Self> {
        let path = store.directory().join("patches.npz");
        for (patch, &area) in table.area.iter().enumerate() {
            if !(area >= 0.0 && area.is_finite()) {
                return Err(Error::malformed(
                    &path,
                    format!("has patch {patch} with the area {area}: it is damaged; compute the matrix again"),
                ));
            }
            if is_symmetric && area == 0.0 {
                return Err(Error::unsupported(
                    &path,
                    format!(
                        "has patch {patch} without area, whose row reciprocity leaves open; take it out of the scene \
                         and compute again"
                    ),
                ));
            }
        }
        let largest = table.area.iter().copied().fold(0.0, f64::max);
        let whole = if largest > 0.0 { largest } else { 1.0 };
        let share: Vec<f64> = table.area.iter().map(|area| area / whole).collect();
        let smallest = share.iter().copied().fold(1.0, f64::min);
        // Products of two shares must be normal numbers, or nothing is symmetric to the last bit.
        if is_symmetric && smallest < 1e-150 {
            return Err(Error::unsupported(
                &path,
                "has patches of which one is 10¹⁵⁰ times as large as another: they cannot be balanced against each \
                 other",
            ));
        }
        let root = share.iter().map(|share| share.sqrt()).collect();
        Ok(Self { share, root })
    }
}

/// Entries left out row by row.
fn balance_rows(
    store: &Store,
    writer: &mut StoreWriter,
    areas: &Areas,
    survey: &Survey,
    options: &BalanceOptions,
) -> Result<BalanceEntry> {
    let mut entry = new_entry(store, options)?;
    let (mut before, mut after) = (Tally::default(), Tally::default());
    let (mut mass, mut dropped) = (0.0, 0.0);
    let precision = store.manifest().form.precision();
    let mut cuts = vec![SmallEntryRule::default(); areas.share.len()];
    for place in 0..store.manifest().parts.len() {
        let source = require_part(store, place)?;
        let mut part = Part {
            indptr: vec![0],
            indices: Vec::new(),
            data: FactorVec::new(precision),
            thinning: None,
            ..source.clone()
        };
        for (row, &patch) in source.rows.iter().enumerate() {
            let (columns, factors) = source.row(row);
            let (whole, kept) = sums(factors, options.min_factor);
            let cut = SmallEntryRule::new(whole, kept, options.min_factor, options.max_scale);
            let start = part.data.len();
            for (&column, factor) in columns.iter().zip(factors).filter(|&(_, factor)| cut.keeps(factor)) {
                part.indices.push(column);
                part.data.push(cut.of(factor));
            }
            part.indptr.push(length(part.data.len()));
            before.row(&source, row);
            let error = after.row(&part, row);
            entry.closure_max_of_others = entry.closure_max_of_others.max(error);
            let area = areas.share.get(patch as usize).copied().unwrap_or(0.0);
            mass += area * whole;
            entry.entries_dropped += (factors.len() - (part.data.len() - start)) as u64;
            if cut.least > 0.0 {
                dropped += area * (whole - kept);
            } else {
                entry.rows_kept_whole += 1;
            }
            entry.scale_max = entry.scale_max.max(cut.scale);
            if let Some(slot) = cuts.get_mut(patch as usize) {
                *slot = cut;
            }
        }
        entry.entries_after += part.data.len() as u64;
        writer.write_part(&part)?;
    }
    entry.mass_dropped = share_of(dropped, mass);
    entry.converged = true;
    // Each row was cut by itself; how far the two rows of a pair are apart needs both.
    let mut exchange = Exchange::new(store, survey, writer.directory())?;
    let cut_of = |patch: u32| cuts.get(patch as usize).copied().unwrap_or_default();
    for place in 0..store.manifest().parts.len() {
        let part = require_part(store, place)?;
        let records = exchange.part(place)?;
        let mut backward = records.as_slice();
        for (row, &patch) in part.rows.iter().enumerate() {
            let (of_row, rest) = exchange::split_row(backward, row);
            backward = rest;
            for (column, forward, back) in merge(part.row(row), of_row) {
                // A row that was not computed does not contradict the other one.
                if survey.position_of(column).is_none() {
                    continue;
                }
                let (forward, back) = (forward.unwrap_or(0.0), back.unwrap_or(0.0));
                before.pair(areas, patch, column, forward, back);
                let cut = |of: u32, factor| precision.round(cut_of(of).of(factor));
                after.pair(areas, patch, column, cut(patch, forward), cut(column, back));
                entry.pairs += u64::from(patch < column);
            }
        }
    }
    (entry.before, entry.after) = (before.finish(), after.finish());
    Ok(entry)
}

/// Pairs made equal, small ones left out, and the rows scaled to their sums.
fn balance_pairs(
    store: &Store,
    writer: &mut StoreWriter,
    areas: &Areas,
    survey: &Survey,
    options: &BalanceOptions,
) -> Result<BalanceEntry> {
    let mut entry = new_entry(store, options)?;
    let directory = writer.directory().to_owned();
    let handed_on = store.row_table()?.handed_on;
    let weights: Vec<f64> = handed_on.iter().map(|handed_on| 1.0 - handed_on).collect();
    let precision = store.manifest().form.precision();
    let symmetric = Symmetric::create(&directory, &survey.order, store.manifest().rows_per_part, precision)?;
    let mut symmetric = symmetric.keeping(weights);
    let exchange = Exchange::new(store, survey, &directory)?;
    let mut targets = pair_rows(store, exchange, &mut symmetric, areas, &handed_on, &mut entry)?;
    symmetric.finish()?;

    let kept = if options.min_factor > 0.0 {
        Some(symmetric.keep_from(areas, options.min_factor)?)
    } else {
        None
    };
    if !options.closure {
        // The row's sum after pairing is its target.
        targets = match &kept {
            Some(dropped) => dropped.sums.iter().map(|&sum| Some(sum)).collect(),
            None => vec![None; areas.share.len()],
        };
    }
    if let Some(dropped) = &kept {
        entry.entries_dropped = dropped.entries;
        entry.mass_dropped = dropped.share;
        entry.rows_kept_whole = dropped.rows_kept;
    }
    let scaling = symmetric.scale(areas, &targets, options)?;
    entry.sweeps = scaling.sweeps;
    entry.converged = scaling.converged;
    entry.rows_empty = scaling.rows_empty;
    entry.rows_without_target = scaling.rows_without_target;
    entry.rows_at_bound = scaling.rows_at_bound;

    write_scaled(store, writer, areas, &mut symmetric, &scaling, &handed_on, &mut entry)?;
    Ok(entry)
}

/// Gives the mean of each pair's two entries to `symmetric`, and counts the pairs. Returns the sum that each row is to
/// have.
fn pair_rows(
    store: &Store,
    mut exchange: Exchange,
    symmetric: &mut Symmetric<'_>,
    areas: &Areas,
    handed_on: &[f64],
    entry: &mut BalanceEntry,
) -> Result<Vec<Option<f64>>> {
    let precision = store.manifest().form.precision();
    let mut targets = vec![None; areas.share.len()];
    let mut before = Tally::default();
    for place in 0..store.manifest().parts.len() {
        let part = require_part(store, place)?;
        let records = exchange.part(place)?;
        let mut backward = records.as_slice();
        for (row, &patch) in part.rows.iter().enumerate() {
            if let Some(target) = targets.get_mut(patch as usize) {
                let passed = part.passages.get(row).map_or(0.0, |passage| passage.passed);
                *target = target_of(&part, row).map(|target| target - passed);
            }
            before.row(&part, row);
            let (of_row, rest) = exchange::split_row(backward, row);
            backward = rest;
            for (column, forward, back) in merge(part.row(row), of_row) {
                let seen = (forward.is_some(), back.is_some());
                let (forward, back) = (forward.unwrap_or(0.0), back.unwrap_or(0.0));
                before.pair(areas, patch, column, forward, back);
                if patch < column {
                    entry.pairs += 1;
                    entry.pairs_one_sided += u64::from(seen != (true, true));
                }
                let pair = mean(areas, (patch, forward), (column, back), handed_on.is_empty());
                symmetric.push(column, precision.round(pair));
            }
            symmetric.end_row()?;
        }
    }
    entry.before = before.finish();
    Ok(targets)
}

/// Writes the parts of the scaled pairs.
fn write_scaled(
    store: &Store,
    writer: &mut StoreWriter,
    areas: &Areas,
    symmetric: &mut Symmetric<'_>,
    scaling: &Scaling,
    handed_on: &[f64],
    entry: &mut BalanceEntry,
) -> Result<()> {
    let precision = store.manifest().form.precision();
    let mut after = Tally::default();
    for place in 0..store.manifest().parts.len() {
        let source = require_part(store, place)?;
        let block = symmetric.block(place)?;
        let mut part = Part {
            indptr: vec![0],
            indices: Vec::new(),
            data: FactorVec::new(precision),
            thinning: None,
            ..source
        };
        for (row, entries) in block.rows().enumerate() {
            let patch = part.rows.get(row).copied().unwrap_or(0);
            for (column, value) in entries {
                let factor = scaling.factor(areas, patch, column, value);
                after.pair(
                    areas,
                    patch,
                    column,
                    factor,
                    scaling.factor(areas, column, patch, value),
                );
                let scale = scaling.of_entry(areas, patch, column);
                entry.scale_min = entry.scale_min.min(scale);
                entry.scale_max = entry.scale_max.max(scale);
                part.indices.push(column.cast_signed());
                part.data.push(factor);
            }
            part.indptr.push(length(part.data.len()));
            hand_on(&mut part, row, handed_on);
            let error = after.row(&part, row);
            if !scaling.unmatched.get(patch as usize).copied().unwrap_or(false) {
                entry.closure_max_of_others = entry.closure_max_of_others.max(error);
            }
        }
        entry.entries_after += part.data.len() as u64;
        writer.write_part(&part)?;
    }
    entry.after = after.finish();
    Ok(())
}

/// Sets the share of a changed row that mirrors and panes hand on.
fn hand_on(part: &mut Part, row: usize, handed_on: &[f64]) {
    let (columns, factors) = part.row(row);
    let of = |column: i32| handed_on.get(column.cast_unsigned() as usize).copied().unwrap_or(0.0);
    let passed = columns
        .iter()
        .zip(factors)
        .map(|(&column, factor)| of(column) * factor)
        .sum();
    if let Some(passage) = part.passages.get_mut(row) {
        passage.passed = passed;
    }
}

/// The mean of both rows' exchange area of a pair, over √(Aᵢ Aⱼ): the same number in either order. `is_bounded`: at
/// most min(Aᵢ, Aⱼ), without mirrors.
fn mean(areas: &Areas, one: (u32, f64), other: (u32, f64), is_bounded: bool) -> f64 {
    let ((i, forward), (j, backward)) = if one.0 <= other.0 { (one, other) } else { (other, one) };
    let of = |values: &[f64], patch: u32| values.get(patch as usize).copied().unwrap_or(1.0);
    let (area_i, area_j) = (of(&areas.share, i), of(&areas.share, j));
    let exchange = area_i * area_j * (forward + backward) / (area_i + area_j);
    // No more goes from one patch to another than leaves the smaller one.
    let most = if is_bounded { area_i.min(area_j) } else { f64::INFINITY };
    exchange.min(most) / (of(&areas.root, i) * of(&areas.root, j))
}

/// The entry before anything is done.
fn new_entry(store: &Store, options: &BalanceOptions) -> Result<BalanceEntry> {
    let manifest = store.manifest();
    let text = manifest
        .to_json()
        .map_err(|error| Error::malformed(store.directory(), format!("has a manifest that is no JSON: {error}")))?;
    Ok(BalanceEntry {
        closure: options.closure,
        reciprocity: options.is_symmetric(),
        min_factor: options.min_factor,
        max_scale: options.max_scale,
        tolerance: options.tolerance,
        max_sweeps: options.max_sweeps,
        source: BalanceSource {
            settings_hash: manifest.settings_hash.clone(),
            manifest_blake3: blake3::hash(text.as_bytes()).to_hex().to_string(),
            correction: manifest.correction.clone(),
        },
        sweeps: 0,
        converged: false,
        rows_empty: 0,
        rows_without_target: 0,
        rows_at_bound: 0,
        closure_max_of_others: 0.0,
        rows_kept_whole: 0,
        scale_min: 1.0,
        scale_max: 1.0,
        pairs: 0,
        pairs_one_sided: 0,
        entries_before: manifest.entries,
        entries_after: 0,
        entries_dropped: 0,
        mass_dropped: 0.0,
        before: Residuals::default(),
        after: Residuals::default(),
    })
}

/// The header of the result: the source's, with the balancing among the settings. Their hash differs, and nothing
/// resumes the computation there.
fn header(store: &Store, options: &BalanceOptions) -> Result<Header> {
    let manifest = store.manifest();
    let mut settings = manifest.settings.clone();
    let Some(fields) = settings.as_object_mut() else {
        return Err(Error::malformed(store.directory(), "has settings that are no table"));
    };
    let mut of_balance = serde_json::json!({
        "closure": options.closure,
        "reciprocity": options.is_symmetric(),
        "min_factor": options.min_factor,
        "max_scale": options.max_scale,
        "tolerance": options.tolerance,
        "max_sweeps": options.max_sweeps,
        "source_settings_hash": manifest.settings_hash,
    });
    if manifest.value_error > 0.0
        && let Some(of_balance) = of_balance.as_object_mut()
    {
        of_balance.insert("source_value_error".to_owned(), manifest.value_error.into());
    }
    fields.insert("balance".to_owned(), of_balance);
    Ok(Header {
        program: hemicube_store::PROGRAM.to_owned(),
        scene: manifest.scene.clone(),
        settings,
        // `pixel` stands for sums of visible weights, and these are none any more.
        correction: format!("{}, balanced", manifest.correction.trim_end_matches(", balanced")),
        patch_count: manifest.patch_count,
        row_count: manifest.row_count,
        rows_per_part: manifest.rows_per_part,
        // Plain for a compact source: sums and pairs that agree to seven digits would not survive 16-bit form factors.
        form: match manifest.form {
            Form::Plain | Form::Compact => Form::Plain,
            Form::Double => Form::Double,
        },
        min_factor: manifest.min_factor,
        backend: manifest.backend.clone(),
        objects: manifest.objects.clone(),
        materials: manifest.materials.clone(),
    })
}

fn require_another(store: &Store, output: &Path) -> Result<()> {
    let same = match (store.directory().canonicalize(), output.canonicalize()) {
        (Ok(source), Ok(output)) => source == output,
        // A missing directory is not the source.
        _ => false,
    };
    if same {
        return Err(Error::InTheWay {
            path: output.to_owned(),
            reason: "is the matrix that is to be balanced; choose another name for the result",
        });
    }
    Ok(())
}

fn require_whole(store: &Store) -> Result<()> {
    let manifest = store.manifest();
    if manifest.complete {
        return Ok(());
    }
    Err(Error::unsupported(
        store.directory(),
        format!(
            "is incomplete and cannot be balanced: {} of {} parts are there; compute it to the end first",
            manifest.parts.len(),
            manifest.part_count
        ),
    ))
}

/// Refuses matrices without a row and a column for every patch.
fn require_square(store: &Store) -> Result<()> {
    let manifest = store.manifest();
    if manifest.row_count != manifest.patch_count {
        return Err(Error::unsupported(
            store.directory(),
            format!(
                "has rows for {} of {} patches, and closure and reciprocity need all: compute it with all rows \
                 (leaving out small form factors balances each row by itself)",
                manifest.row_count, manifest.patch_count
            ),
        ));
    }
    let is_given = |name: &str| {
        let list = manifest.settings.get(name).and_then(serde_json::Value::as_array);
        list.is_some_and(|list| !list.is_empty())
    };
    // Without a choice of columns, portals cut off what is unselected.
    let is_selected = !manifest.has_portals() || is_given("receivers") || is_given("occluders");
    if is_selected && manifest.parts.iter().any(|part| part.sums.unselected > 0) {
        return Err(Error::unsupported(
            store.directory(),
            "has columns for selected receivers only, and closure and reciprocity need all: compute it with all \
             columns (leaving out small form factors balances each row by itself)",
        ));
    }
    Ok(())
}

/// Refuses a result larger than the free disk even if every entry has its counterpart.
fn require_room(store: &Store, output: &Path, options: &BalanceOptions) -> Result<()> {
    let existing = output.ancestors().find(|place| place.is_dir());
    let (entries, precision) = (store.manifest().entries, store.manifest().form.precision());
    // The exchange goes before the result is written; of the result nothing is certain if entries are left out.
    let per_entry = match (options.is_symmetric(), options.min_factor > 0.0) {
        (true, _) => exchange::record_size(precision) + symmetric::record_size(precision),
        (false, _) => exchange::record_size(precision),
    };
    let wanted = entries.saturating_mul(per_entry as u64);
    let place = match existing {
        Some(place) if !place.as_os_str().is_empty() => place,
        _ => Path::new("."),
    };
    // Without the disk's free space, a full disk is an error of writing.
    match fs4::available_space(place) {
        Ok(available) if available < wanted => Err(Error::DiskTooSmall {
            path: output.to_owned(),
            wanted,
            available,
        }),
        _ => Ok(()),
    }
}

fn require_part(store: &Store, place: usize) -> Result<Part> {
    store
        .part(place)?
        .ok_or_else(|| Error::malformed(store.directory(), format!("has no part at place {place}")))
}

/// Size of a store on the disk, by the files of its manifest.
fn size_of(directory: &Path, manifest: &Manifest) -> u64 {
    let parts = manifest.parts.iter().map(|part| part.file.as_str());
    parts
        .chain(manifest.patches.iter().map(|table| table.file.as_str()))
        .chain(["manifest.json"])
        .filter_map(|file| std::fs::metadata(directory.join(file)).ok())
        .map(|metadata| metadata.len())
        .sum()
}

fn length(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}
