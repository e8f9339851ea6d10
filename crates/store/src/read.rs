//! Reading a store of either form: the manifest at once, a part's head when a row of it is first wanted, a row by two
//! or three reads at its offset.
//!
//! A part is checked as a whole before anything of it is handed on (`validate.rs`): its checksum, its run, that no
//! other part has its rows, and, at the latest when they are read, its columns and form factors.
//!
//! Memory: 16 bytes a patch for its row's place, 20 or 28 bytes a row for the heads of the parts. Entries are not
//! cached.

use super::csr::CsrFile;
use super::durable::file_checksum;
use super::npz::Npz;
use super::{
    Error, FactorVec, Form, Manifest, Part, PartThinning, Passage, PatchTable, Result, RowErrors, RowShares, RowSums,
    validate,
};
use hemicube_scene::InputPatch;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Files kept open. Rows in input order jump from part to part, and the system allows about a thousand open files.
const OPEN_FILES_MAX: usize = 128;

/// The array of a part with the effect of leaving out small form factors.
pub(super) const THINNING: &str = "thinning";

/// The array of a part with the rows' refined shares.
pub(super) const SHARES: &str = "shares";

/// Arrays of a part, and of the patch table, with what portals handed on and what was cut off after them.
pub(super) const PASSED: &str = "passed";
pub(super) const CUT_OFF: &str = "cut_off";
/// Optional arrays of the patch table.
pub(super) const CORNERS: &str = "corners";
pub(super) const DRAWN_BY: &str = "drawn_by";

/// The array of a part, and of the patch table, with the id of its run.
pub(super) const RUN: &str = "run";

/// Least bytes of the patch table for a patch.
pub(super) const PATCH_SIZE: u64 = 149;

/// Checks that a file has passed, a bit each.
mod found {
    /// The checksum of its bytes.
    pub(super) const CHECKSUM: u8 = 1;
    /// The CRC of its arrays.
    pub(super) const CRC: u8 = 2;
    /// It is of the store's run.
    pub(super) const RUN: u8 = 4;
    /// Its rows are of patches without another row.
    pub(super) const ROWS: u8 = 8;
    /// Its columns and form factors.
    pub(super) const ENTRIES: u8 = 16;
}

/// A row of the matrix.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// The input patch of each entry's column, ascending.
    pub indices: Vec<u32>,
    /// The form factor of each entry.
    pub data: FactorVec,
}

/// Sum, shares and error of each row, in input order; NaN for rows not computed. Fractions of the hemicube are also NaN
/// for rows made without hemicubes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RowTable {
    /// Share that leaves the scene, refined with the form factors ([`RowShares`]).
    pub escaped: Vec<f64>,
    /// Share that ends on backs of one-sided patches.
    pub blocked: Vec<f64>,
    /// Share that ends on patches without a column.
    pub unselected: Vec<f64>,
    /// Sum of the form factors.
    pub row_sum: Vec<f64>,
    /// Expected √Σ (F − true F)², at accuracy levels that estimate it.
    pub error: Vec<f64>,
    /// Standard error of `row_sum`, likewise.
    pub sum_error: Vec<f64>,
    /// Standard error of `escaped`, likewise.
    pub escaped_error: Vec<f64>,
    /// Fraction of the hemicubes' weight that escaped.
    pub hemicube_escaped: Vec<f64>,
    /// Fraction on backs of one-sided patches.
    pub hemicube_blocked: Vec<f64>,
    /// Fraction on patches without a column.
    pub hemicube_unselected: Vec<f64>,
    /// Share that portals handed on after it had arrived ([`Passage`](super::Passage)); empty without portals.
    pub passed: Vec<f64>,
    /// Share cut off after the last portal followed, a part of `unselected`; empty without portals.
    pub cut_off: Vec<f64>,
    /// ρs + τ of each patch, from 0 to 1: the part handed on of what arrives there; empty without mirrors and panes.
    pub handed_on: Vec<f64>,
}

/// A patch that keeps less than this part of what arrives exchanges nothing.
const KEPT_LEAST: f64 = 1e-9;

impl RowTable {
    /// A table of `patch_count` patches without rows.
    pub fn unknown(patch_count: usize) -> Self {
        let unknown = || vec![f64::NAN; patch_count];
        Self {
            escaped: unknown(),
            blocked: unknown(),
            unselected: unknown(),
            row_sum: unknown(),
            error: unknown(),
            sum_error: unknown(),
            escaped_error: unknown(),
            hemicube_escaped: unknown(),
            hemicube_blocked: unknown(),
            hemicube_unselected: unknown(),
            passed: Vec::new(),
            cut_off: Vec::new(),
            handed_on: Vec::new(),
        }
    }

    /// The table with columns for what portals did, if there are any.
    pub(super) fn with_passages(mut self, has_portals: bool) -> Self {
        if has_portals {
            let count = self.row_sum.len();
            (self.passed, self.cut_off) = (vec![f64::NAN; count], vec![f64::NAN; count]);
        }
        self
    }

    /// Adds the rows of a part, rounded as in a store of `form`.
    ///
    /// # Panics
    /// When the part has rows of other patches, or arrays that do not fit together.
    pub fn add(&mut self, part: &Part, form: Form) {
        for (row, &patch) in part.rows.iter().enumerate() {
            let patch = patch as usize;
            let factors = part.row(row).1.iter();
            self.row_sum[patch] = factors.map(|factor| form.round(factor)).sum();
            let errors = part.errors[row];
            self.error[patch] = errors.norm.into();
            (self.sum_error[patch], self.escaped_error[patch]) = (errors.sum.into(), errors.escaped.into());
            let seen = RowShares::of_hemicubes(&part.sums[row], part.hemicubes[row]);
            (self.hemicube_escaped[patch], self.hemicube_blocked[patch]) = (seen.escaped, seen.blocked);
            self.hemicube_unselected[patch] = seen.unselected;
            if let Some(passage) = part.passages.get(row) {
                let count = self.row_sum.len();
                for column in [&mut self.passed, &mut self.cut_off] {
                    column.resize(count, f64::NAN);
                }
                (self.passed[patch], self.cut_off[patch]) = (passage.passed, passage.cut_off);
            }
            let shares = part.shares[row];
            (self.escaped[patch], self.blocked[patch]) = (shares.escaped, shares.blocked);
            self.unselected[patch] = shares.unselected;
        }
    }

    /// The share of each patch's view that exchanges nothing with others, 1 − Σ F − escaped; `solve` returns it to the
    /// patch. It holds backs, patches without a column, and the closure error (below 0 where the row sums to more than
    /// 1). 0 for a patch without a row.
    ///
    /// With mirrors and panes it is (1 − Σ F + passed − escaped) / (1 − ρs − τ), the irradiance per radiosity of which
    /// the patch keeps what its row lost; 0 for a patch that keeps nothing.
    pub fn returned(&self) -> Vec<f64> {
        self.returned_beside(&self.escaped)
    }

    /// [`Self::returned`] with `outside`, from 0 to 1 a patch, in place of escaped: the rest of the sky exchanges
    /// nothing.
    pub fn returned_beside(&self, outside: &[f64]) -> Vec<f64> {
        let known = |share: f64| if share.is_nan() { 0.0 } else { share };
        let rows = self.row_sum.iter().zip(outside).enumerate();
        let lost = |(patch, (sum, &outside)): (usize, (&f64, &f64))| {
            let lost = known(1.0 - sum - known(outside) + self.passed_of(patch));
            match self.kept(patch) {
                1.0 => lost,
                kept if kept > KEPT_LEAST => lost / kept,
                _ => 0.0,
            }
        };
        rows.map(lost).collect()
    }

    /// 1 − ρs − τ of a patch: the part of what arrives there that it absorbs or reflects diffusely; 1 without mirrors
    /// and panes.
    pub fn kept(&self, patch: usize) -> f64 {
        (1.0 - self.handed_on.get(patch).copied().unwrap_or(0.0)).max(0.0)
    }

    /// Share of a patch's row that mirrors and panes handed on ([`Passage`]); 0 without any.
    pub fn passed_of(&self, patch: usize) -> f64 {
        self.passed
            .get(patch)
            .copied()
            .filter(|passed| !passed.is_nan())
            .unwrap_or(0.0)
    }

    /// The shares of a patch's view that are no form factors; NaN where they are not known.
    ///
    /// # Panics
    /// When there is no such patch.
    pub fn shares(&self, patch: usize) -> RowShares {
        RowShares::from_array([self.escaped[patch], self.blocked[patch], self.unselected[patch]])
    }
}

/// A part without its entries.
#[derive(Debug)]
struct PartHead {
    path: PathBuf,
    csr: CsrFile,
}

/// Place of a patch's row: the part among those present, and the row in it.
type Location = Option<(u32, u32)>;

/// A store open for reading. All methods may be called from several threads.
///
/// ```
/// use hemicube_scene::InputPatch;
/// use hemicube_store::Store;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let directory = folder.path().join("room.hemicube");
/// # room::stored(&directory, 0.05)?;
///
/// let store = Store::open(&directory)?;
/// let row = store.row(InputPatch(2))?.ok_or("row 2 was not computed")?;
/// assert!(row.indices.is_sorted() && row.indices.len() == row.data.len());
/// assert_eq!(store.row(InputPatch(6))?, None, "the room has patches 0 to 5");
///
/// // All rows, one at a time in memory.
/// let mut entries = 0;
/// for row in store.rows()? {
///     let (_patch, row) = row?;
///     entries += row.data.len() as u64;
/// }
/// assert_eq!(entries, store.manifest().entries);
///
/// // F·x without the matrix in memory: ones give the row sums.
/// let sums = store.multiply(&vec![1.0; store.patch_count() as usize], 0)?;
/// let table = store.row_table()?;
/// assert!(sums.iter().zip(&table.row_sum).all(|(sum, kept)| (sum - kept).abs() < 1e-6));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Store {
    directory: PathBuf,
    manifest: Manifest,
    heads: Mutex<Vec<Option<Arc<PartHead>>>>,
    /// By place of the part, least recently opened first.
    files: Mutex<Vec<(usize, Arc<File>)>>,
    locations: Mutex<Option<Arc<Vec<Location>>>>,
    /// Checks passed ([`found`]), by place of the part, and last of the patch table.
    found: Vec<AtomicU8>,
    /// The part with the row of each patch, from 1 on; 0: no checked part has one.
    owners: Mutex<Vec<u32>>,
    /// The run of the first part; all files must be of it.
    run: OnceLock<Option<[u8; 32]>>,
}

impl Store {
    /// Opens a store, complete or not. Reads the manifest only; a part is opened when it is needed, and read whole and
    /// verified the first time.
    ///
    /// # Errors
    /// [`Error::Malformed`] when the directory is no store, or its manifest has changed since it was written.
    pub fn open(directory: &Path) -> Result<Self> {
        Self::open_as(directory, false)
    }

    /// Opens without verifying checksums, for readers of a few rows of a large store, or of a store checked before.
    /// [`Self::verify_part`] and [`Self::verify_patches`] still verify them. Flipped bits within the entries of a row
    /// may go unnoticed, and nothing worse.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_trusting(directory: &Path) -> Result<Self> {
        Self::open_as(directory, true)
    }

    fn open_as(directory: &Path, trusts: bool) -> Result<Self> {
        let manifest = Manifest::read(directory)?;
        let count = manifest.parts.len();
        // Until there is a table of that length, the patch count is only a claim.
        if manifest.patches.is_none() {
            return Err(Error::malformed(
                directory,
                "has no patch table: its run was ended before it had written one; computing the scene again \
                 goes on with it",
            ));
        }
        require_backed(&directory.join(super::manifest::PATCHES_FILE), manifest.patch_count)?;
        let known = if trusts { found::CHECKSUM } else { 0 };
        Ok(Self {
            directory: directory.to_owned(),
            manifest,
            heads: Mutex::new(vec![None; count]),
            files: Mutex::default(),
            locations: Mutex::default(),
            found: (0..=count).map(|_| AtomicU8::new(known)).collect(),
            owners: Mutex::default(),
            run: OnceLock::new(),
        })
    }

    /// The store's directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The store's manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Patches of the scene: the matrix is square, of this size.
    pub fn patch_count(&self) -> u32 {
        self.manifest.patch_count
    }

    /// Refuses a store with missing parts.
    ///
    /// # Errors
    /// [`Error::Incomplete`].
    pub fn require_complete(&self) -> Result<()> {
        if self.manifest.complete {
            return Ok(());
        }
        Err(Error::Incomplete {
            path: self.directory.clone(),
            present: u32::try_from(self.manifest.parts.len()).unwrap_or(u32::MAX),
            expected: self.manifest.part_count,
        })
    }

    /// The row of a patch; `None` when it was not computed.
    ///
    /// # Errors
    /// When its part is damaged.
    pub fn row(&self, patch: InputPatch) -> Result<Option<Row>> {
        let locations = self.locations()?;
        match locations.get(patch.0 as usize).copied().flatten() {
            Some((place, row)) => self.row_at(place as usize, row).map(Some),
            None => Ok(None),
        }
    }

    /// Number of entries of a patch's row, without reading it; `None` when it was not computed.
    ///
    /// # Errors
    /// When its part is damaged.
    pub fn entries_of_row(&self, patch: InputPatch) -> Result<Option<u64>> {
        let locations = self.locations()?;
        match locations.get(patch.0 as usize).copied().flatten() {
            Some((place, row)) => Ok(Some(self.head(place as usize)?.csr.bounds(row.into()).1)),
            None => Ok(None),
        }
    }

    /// The patches of the computed rows, in input order.
    ///
    /// # Errors
    /// When the head of a part is damaged.
    pub fn computed_patches(&self) -> Result<Vec<InputPatch>> {
        let locations = self.locations()?;
        Ok((0..)
            .zip(locations.iter())
            .filter_map(|(patch, location)| location.map(|_| InputPatch(patch)))
            .collect())
    }

    /// All computed rows, in input order. Reads jump between the parts.
    ///
    /// # Errors
    /// When the head of a part is damaged.
    pub fn rows(&self) -> Result<Rows<'_>> {
        Ok(Rows {
            store: self,
            order: self.computed_patches()?,
            next: 0,
        })
    }

    /// The patches of the computed rows, part by part, in the order of work.
    ///
    /// # Errors
    /// When the head of a part is damaged.
    pub fn processing_order(&self) -> Result<Vec<InputPatch>> {
        let mut order = Vec::new();
        for place in 0..self.manifest.parts.len() {
            order.extend(self.rows_of_part(place)?.into_iter().map(InputPatch));
        }
        Ok(order)
    }

    /// All computed rows, part by part, in the order of work. Reads run through the parts.
    ///
    /// # Errors
    /// When the head of a part is damaged.
    pub fn rows_in_processing_order(&self) -> Result<Rows<'_>> {
        Ok(Rows {
            store: self,
            order: self.processing_order()?,
            next: 0,
        })
    }

    /// A part, by its place among those present ([`Manifest::parts`]); `None` beyond the last. Reads the whole part
    /// into memory and checks all that a reader relies on: rows of patches without another row, ascending columns
    /// within the matrix, form factors from 0 to below 2, weights that sum to the hemicubes'.
    ///
    /// # Errors
    /// When the part is damaged, or of another run than the rest.
    pub fn part(&self, place: usize) -> Result<Option<Part>> {
        let Some((path, part)) = self.part_as_it_is(place)? else {
            return Ok(None);
        };
        self.validate(place, &path, &part)?;
        Ok(Some(part))
    }

    /// A part with no check but that its arrays fit together, for `check`.
    #[doc(hidden)]
    pub fn part_as_it_is(&self, place: usize) -> Result<Option<(PathBuf, Part)>> {
        let Some(entry) = self.manifest.parts.get(place) else {
            return Ok(None);
        };
        let (path, mut npz, csr) = self.open_part(place)?;
        let part = read_part(&path, &mut npz, &csr, &self.manifest, entry.index)?;
        self.note(place, found::CRC);
        Ok(Some((path, part)))
    }

    /// Checks a part of [`Self::part_as_it_is`] against everything that readers rely on.
    ///
    /// # Errors
    /// [`Error::Malformed`] with the first violation.
    #[doc(hidden)]
    pub fn validate(&self, place: usize, path: &Path, part: &Part) -> Result<()> {
        let rows = self.manifest.rows_of_part(part.index) as usize;
        validate::part(part, rows, &self.manifest, validate::Entries::Stored)
            .map_err(|reason| Error::malformed(path, reason))?;
        self.claim(place, path, &part.rows)?;
        self.note(place, found::ENTRIES);
        Ok(())
    }

    fn has(&self, place: usize, what: u8) -> bool {
        let of_file = self.found.get(place);
        of_file.is_some_and(|found| found.load(Ordering::Acquire) & what != 0)
    }

    fn note(&self, place: usize, what: u8) {
        if let Some(of_file) = self.found.get(place) {
            of_file.fetch_or(what, Ordering::AcqRel);
        }
    }

    /// Returns whether the columns and form factors of a part were found to hold.
    pub(super) fn has_valid_entries(&self, place: usize) -> bool {
        self.has(place, found::ENTRIES)
    }

    pub(super) fn note_valid_entries(&self, place: usize) {
        self.note(place, found::ENTRIES);
    }

    /// Refuses rows of patches that do not exist, or that have a row already, in this part or another.
    fn claim(&self, place: usize, path: &Path, rows: &[u32]) -> Result<()> {
        let mut owners = self.owners.lock().unwrap_or_else(PoisonError::into_inner);
        if self.has(place, found::ROWS) {
            return Ok(());
        }
        owners.resize(self.manifest.patch_count as usize, 0);
        let claimant = u32::try_from(place).unwrap_or(u32::MAX - 1) + 1;
        for (row, &patch) in rows.iter().enumerate() {
            match owners.get_mut(patch as usize) {
                Some(slot @ 0) => *slot = claimant,
                _ => {
                    // Whoever looks again is told the same.
                    rows[..row].iter().for_each(|&patch| owners[patch as usize] = 0);
                    return Err(Error::malformed(path, validate::no_row(patch)));
                }
            }
        }
        self.note(place, found::ROWS);
        Ok(())
    }

    /// Refuses a file of another run than the first part's, which stands for the store.
    fn require_run(&self, place: usize, path: &Path, npz: &mut Npz) -> Result<()> {
        if self.has(place, found::RUN) {
            return Ok(());
        }
        let run: Vec<u8> = npz.shaped(RUN, &[32])?;
        let of_store = self.run.get_or_init(|| {
            let first = self.directory.join(&self.manifest.parts.first()?.file);
            // An unreadable first part is refused itself.
            let run: Vec<u8> = Npz::open(&first).ok()?.shaped(RUN, &[32]).ok()?;
            run.try_into().ok()
        });
        if of_store.is_some_and(|of_store| run != of_store) {
            let reason = "is of another run than the first part: another scene, other settings or another version; \
                          compute the matrix again";
            return Err(Error::malformed(path, reason));
        }
        self.note(place, found::RUN);
        Ok(())
    }

    /// Reads a part's file and compares its checksum with the manifest's. Place as in [`Self::part`].
    ///
    /// # Errors
    /// [`Error::Checksum`] when a bit differs; [`Error::Io`] when it cannot be read.
    pub fn verify_part(&self, place: usize) -> Result<()> {
        match self.manifest.parts.get(place) {
            Some(entry) => self.verify(&entry.file, &entry.blake3, place),
            None => Ok(()),
        }
    }

    /// Verifies a file before its first use.
    fn once(&self, place: usize, verify: impl FnOnce() -> Result<()>) -> Result<()> {
        if place < self.found.len() && !self.has(place, found::CHECKSUM) {
            verify()
        } else {
            Ok(())
        }
    }

    /// Reads the patch table and holds its checksum against the manifest's.
    ///
    /// # Errors
    /// [`Error::Checksum`] when a bit differs; [`Error::Io`] when it cannot be read.
    pub fn verify_patches(&self) -> Result<()> {
        match &self.manifest.patches {
            Some(entry) => self.verify(&entry.file, &entry.blake3, self.manifest.parts.len()),
            None => Ok(()),
        }
    }

    fn verify(&self, file: &str, expected: &str, place: usize) -> Result<()> {
        let path = self.directory.join(file);
        let found = file_checksum(&path)?;
        if found == expected {
            self.note(place, found::CHECKSUM);
            Ok(())
        } else {
            Err(Error::Checksum {
                path,
                expected: expected.to_owned(),
                found,
            })
        }
    }

    /// The patches: of objects and materials named by the manifest, each with an area and a unit normal.
    ///
    /// # Errors
    /// When the patch table is not there, or damaged.
    pub fn patches(&self) -> Result<PatchTable> {
        let (path, mut npz) = self.open_patches()?;
        read_patches(&path, &mut npz, &self.manifest)
    }

    /// The row table of exchanges, in which each patch keeps the same part of all that arrives: where optics depend on
    /// the angle, *passed* is Σ (ρs + τ) F by their hemispherical means. What a row hands on beyond that is in
    /// [`RowTable::returned`].
    ///
    /// # Errors
    /// When the patch table or a part is not there, or damaged.
    pub fn exchange_table(&self) -> Result<RowTable> {
        let mut table = self.row_table()?;
        if self.manifest.passes_by_angle() {
            for row in self.rows()? {
                let (patch, row) = row?;
                let of = |column: u32| table.handed_on.get(column as usize).copied().unwrap_or(0.0);
                let entries = row.indices.iter().zip(&row.data);
                let passed: f64 = entries.map(|(&column, factor)| of(column) * factor).sum();
                table.passed[patch.0 as usize] = passed;
            }
        }
        Ok(table)
    }

    /// Sum, shares and error of each row. All NaN until the store is complete.
    ///
    /// # Errors
    /// When the patch table is not there, or damaged.
    pub fn row_table(&self) -> Result<RowTable> {
        let (path, mut npz) = self.open_patches()?;
        let mut column = |name: &str, most: f64| -> Result<Vec<f64>> {
            let values: Vec<f64> = npz.shaped(name, &[self.manifest.patch_count.into()])?;
            validate::column(name, &values, most).map_err(|reason| Error::malformed(&path, reason))?;
            Ok(values)
        };
        let [passed, cut_off] = if self.manifest.has_portals() {
            [column(PASSED, f64::MAX)?, column(CUT_OFF, 1.0)?]
        } else {
            [Vec::new(), Vec::new()]
        };
        let handed_on = if self.manifest.has_specular() {
            self.manifest.handed_on(&self.patches()?).unwrap_or_default()
        } else {
            Vec::new()
        };
        let table = RowTable {
            passed,
            cut_off,
            handed_on,
            hemicube_escaped: column("hemicube_escaped", 1.0)?,
            hemicube_blocked: column("hemicube_blocked", 1.0)?,
            hemicube_unselected: column("hemicube_unselected", 1.0)?,
            escaped: column("escaped", 1.0)?,
            blocked: column("blocked", 1.0)?,
            unselected: column("unselected", 1.0)?,
            row_sum: column("row_sum", f64::MAX)?,
            error: column("error", f64::MAX)?,
            sum_error: column("sum_error", f64::MAX)?,
            escaped_error: column("escaped_error", f64::MAX)?,
        };
        validate::fractions(&[&table.escaped, &table.blocked, &table.unselected])
            .and_then(|()| {
                validate::fractions(&[
                    &table.hemicube_escaped,
                    &table.hemicube_blocked,
                    &table.hemicube_unselected,
                ])
            })
            .map_err(|reason| Error::malformed(&path, reason))?;
        Ok(table)
    }

    fn open_patches(&self) -> Result<(PathBuf, Npz)> {
        let place = self.manifest.parts.len();
        self.once(place, || self.verify_patches())?;
        let path = self.directory.join(super::manifest::PATCHES_FILE);
        let mut npz = Npz::open(&path)?;
        self.require_run(place, &path, &mut npz)?;
        Ok((path, npz))
    }

    /// Asks the system to read a part into its cache ahead of its use. Does nothing beyond the last part.
    #[doc(hidden)]
    pub fn read_ahead(&self, place: usize) {
        // Advice only: a file that cannot be opened fails when it is read.
        if let Some(entry) = self.manifest.parts.get(place)
            && let Ok(file) = hemicube_scene::open_regular(&self.directory.join(&entry.file))
        {
            super::csr::will_read(&file);
        }
    }

    fn open_part(&self, place: usize) -> Result<(PathBuf, Npz, CsrFile)> {
        let entry = self
            .manifest
            .parts
            .get(place)
            .ok_or_else(|| Error::malformed(&self.directory, format!("has no part at place {place}")))?;
        self.once(place, || self.verify_part(place))?;
        let path = self.directory.join(&entry.file);
        let (mut npz, csr) = open_part(&path, &self.manifest, entry.index)?;
        if self.has(place, found::CRC) {
            npz = npz.verified();
        }
        self.require_run(place, &path, &mut npz)?;
        if csr.entries() != entry.entries {
            return Err(Error::malformed(
                &path,
                format!("has {} entries, and {} by the manifest", csr.entries(), entry.entries),
            ));
        }
        Ok((path, npz, csr))
    }

    /// A part's matrix and file, for readers of many of its rows.
    pub(super) fn matrix_of_part(&self, place: usize) -> Result<(CsrFile, Vec<u32>, File)> {
        let (path, mut npz, csr) = self.open_part(place)?;
        let rows: Vec<u32> = npz.shaped("rows", &[csr.row_count])?;
        self.claim(place, &path, &rows)?;
        Ok((csr, rows, npz.into_file()))
    }

    fn head(&self, place: usize) -> Result<Arc<PartHead>> {
        if let Some(Some(head)) = self.heads.lock().unwrap_or_else(PoisonError::into_inner).get(place) {
            return Ok(Arc::clone(head));
        }
        let (path, npz, csr) = self.open_part(place)?;
        let head = Arc::new(PartHead { path, csr });
        self.keep_open(place, Arc::new(npz.into_file()));
        if let Some(slot) = self.heads.lock().unwrap_or_else(PoisonError::into_inner).get_mut(place) {
            *slot = Some(Arc::clone(&head));
        }
        Ok(head)
    }

    fn keep_open(&self, place: usize, file: Arc<File>) {
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if files.len() >= OPEN_FILES_MAX {
            files.remove(0);
        }
        files.push((place, file));
    }

    fn file(&self, place: usize, path: &Path) -> Result<Arc<File>> {
        let open = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, file)) = open.iter().rev().find(|(other, _)| *other == place) {
            return Ok(Arc::clone(file));
        }
        drop(open);
        let file = Arc::new(hemicube_scene::open_regular(path).map_err(|error| Error::io(path, "opened", error))?);
        self.keep_open(place, Arc::clone(&file));
        Ok(file)
    }

    fn rows_of_part(&self, place: usize) -> Result<Vec<u32>> {
        let (path, mut npz, csr) = self.open_part(place)?;
        let rows: Vec<u32> = npz.shaped("rows", &[csr.row_count])?;
        self.claim(place, &path, &rows)?;
        Ok(rows)
    }

    fn locations(&self) -> Result<Arc<Vec<Location>>> {
        let mut slot = self.locations.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(locations) = &*slot {
            return Ok(Arc::clone(locations));
        }
        let mut locations: Vec<Location> = vec![None; self.manifest.patch_count as usize];
        for (number, place) in (0u32..).zip(0..self.manifest.parts.len()) {
            for (row, patch) in (0u32..).zip(self.rows_of_part(place)?) {
                match locations.get_mut(patch as usize) {
                    Some(location @ None) => *location = Some((number, row)),
                    _ => {
                        let path = self.directory.join(&self.manifest.parts[place].file);
                        return Err(Error::malformed(&path, validate::no_row(patch)));
                    }
                }
            }
        }
        let locations = Arc::new(locations);
        *slot = Some(Arc::clone(&locations));
        Ok(locations)
    }

    fn row_at(&self, place: usize, row: u32) -> Result<Row> {
        let head = self.head(place)?;
        let file = self.file(place, &head.path)?;
        let (columns, data) = head.csr.row(&file, row.into())?;
        if !validate::are_columns(&columns, self.manifest.patch_count)
            || !validate::are_factors(data.as_slice(), self.manifest.factor_end())
        {
            let reason = format!(
                "has columns in its row {row} that do not ascend, or leave the matrix, or what is no form factor: it \
                 is damaged"
            );
            return Err(Error::malformed(&head.path, reason));
        }
        let indices = columns.into_iter().map(i32::cast_unsigned).collect();
        Ok(Row { indices, data })
    }
}

/// Refuses a table too short for `patch_count` patches.
pub(super) fn require_backed(table: &Path, patch_count: u32) -> Result<()> {
    let size = std::fs::metadata(table)
        .map_err(|error| Error::io(table, "read", error))?
        .len();
    if size < u64::from(patch_count) * PATCH_SIZE {
        return Err(Error::malformed(table, "is shorter than its patches: it is truncated"));
    }
    Ok(())
}

/// Reads the patches, and holds them against the manifest.
pub(super) fn read_patches(path: &Path, npz: &mut Npz, manifest: &Manifest) -> Result<PatchTable> {
    let count = u64::from(manifest.patch_count);
    let triples = |numbers: Vec<f64>| numbers.as_chunks::<3>().0.to_vec();
    let table = PatchTable {
        face: npz.shaped("face", &[count])?,
        object: npz.shaped("object", &[count])?,
        material: npz.shaped("material", &[count])?,
        side: npz.shaped("side", &[count])?,
        area: npz.shaped("area", &[count])?,
        centroid: triples(npz.shaped("centroid", &[count, 3])?),
        normal: triples(npz.shaped("normal", &[count, 3])?),
        corners: if npz.has(CORNERS) {
            let points = triples(npz.shaped(CORNERS, &[count, 3, 3])?);
            points.as_chunks::<3>().0.to_vec()
        } else {
            Vec::new()
        },
        drawn_by: if npz.has(DRAWN_BY) {
            npz.shaped(DRAWN_BY, &[count])?
        } else {
            Vec::new()
        },
    };
    validate::patches(
        &table,
        manifest.objects.len(),
        manifest.materials.len(),
        manifest.patch_kind(),
    )
    .map_err(|reason| Error::malformed(path, reason))?;
    Ok(table)
}

/// Opens the file of a part, and holds its shape against the manifest.
pub(super) fn open_part(path: &Path, manifest: &Manifest, part: u32) -> Result<(Npz, CsrFile)> {
    let mut npz = Npz::open(path)?;
    let csr = CsrFile::read(path, &mut npz)?;
    let rows = manifest.rows_of_part(part);
    if csr.row_count != u64::from(rows)
        || csr.column_count != u64::from(manifest.patch_count)
        || !csr.is_store_part(manifest.form, manifest.has_specular())
    {
        return Err(Error::malformed(
            path,
            format!(
                "is no {:?} part of {rows} rows and {} columns, as the manifest says",
                manifest.form, manifest.patch_count
            ),
        ));
    }
    Ok((npz, csr))
}

/// Reads a whole part. Checks only that its arrays fit together, which every reader needs.
pub(super) fn read_part(path: &Path, npz: &mut Npz, csr: &CsrFile, manifest: &Manifest, index: u32) -> Result<Part> {
    let count = u64::from(manifest.rows_of_part(index));
    let rows: Vec<u32> = npz.shaped("rows", &[count])?;
    let sums: Vec<u64> = npz.shaped("sums", &[count, 4])?;
    let hemicubes: Vec<u32> = npz.shaped("hemicubes", &[count])?;
    let (errors, rays): (Vec<f32>, Vec<u32>) = (npz.shaped("errors", &[count, 3])?, npz.shaped("rays", &[count])?);
    let errors = errors
        .as_chunks()
        .0
        .iter()
        .copied()
        .map(RowErrors::from_array)
        .collect();
    if let Some(&row) = rows.iter().find(|&&row| row >= manifest.patch_count) {
        return Err(Error::malformed(path, validate::no_row(row)));
    }
    let thinning = if npz.has(THINNING) {
        let numbers: Vec<f64> = npz.array(THINNING)?;
        let numbers: [f64; PartThinning::LENGTH] = numbers
            .try_into()
            .map_err(|_| Error::malformed(path, format!("has a `{THINNING}` of another length")))?;
        if let Some(bad) = numbers.iter().find(|number| !number.is_finite() || **number < 0.0) {
            return Err(Error::malformed(path, format!("has {bad} in `{THINNING}`")));
        }
        Some(PartThinning::from_numbers(numbers))
    } else {
        None
    };
    let sums: Vec<RowSums> = sums
        .chunks_exact(4)
        .map(|sums| RowSums {
            visible: sums[0],
            escaped: sums[1],
            blocked: sums[2],
            unselected: sums[3],
        })
        .collect();
    let shares: Vec<f64> = npz.shaped(SHARES, &[count, 3])?;
    let shares = shares
        .as_chunks()
        .0
        .iter()
        .copied()
        .map(RowShares::from_array)
        .collect();
    let passages = if manifest.has_portals() {
        let (passed, cut_off): (Vec<f64>, Vec<f64>) = (npz.shaped(PASSED, &[count])?, npz.shaped(CUT_OFF, &[count])?);
        let both = passed.into_iter().zip(cut_off);
        both.map(|(passed, cut_off)| Passage { passed, cut_off }).collect()
    } else {
        Vec::new()
    };
    let (indices, data) = csr.rows(npz)?;
    Ok(Part {
        index,
        rows,
        indptr: npz.array("indptr")?,
        indices,
        data,
        sums,
        shares,
        hemicubes,
        errors,
        rays,
        thinning,
        passages,
    })
}

/// The rows of a store, one at a time; see [`Store::rows`].
#[derive(Debug)]
pub struct Rows<'a> {
    store: &'a Store,
    order: Vec<InputPatch>,
    next: usize,
}

impl Iterator for Rows<'_> {
    type Item = Result<(InputPatch, Row)>;

    fn next(&mut self) -> Option<Self::Item> {
        let patch = *self.order.get(self.next)?;
        self.next += 1;
        match self.store.row(patch) {
            Ok(Some(row)) => Some(Ok((patch, row))),
            // Every row of the order has a place.
            Ok(None) => self.next(),
            Err(error) => Some(Err(error)),
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.order.len() - self.next;
        (0, Some(left))
    }
}
