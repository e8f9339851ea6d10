//! `hemicube.Matrix`: a form-factor matrix in memory or in a store.

use crate::attended::{Attendant, attended};
use crate::export::{self, Asked, ForSolver, Zones};
use crate::scene::{Scene, axis};
use crate::{errors, numbers, pickle};
use hemicube::solve::{Block, Factors, OutOfCore, Pairs, Reading, multiply};
use hemicube::store::{
    Assembly, Error as StoreError, FactorSlice, FactorVec, Header, Index, Part, PatchOptics, PatchTable, Precision,
    RowTable, Store, StoreWriter, optics_of,
};
use hemicube::{InputPatch, PatchKind};
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Rows in a run of a matrix in memory.
const RUN: usize = 1024;

/// Form factors owned by NumPy, read-only.
#[derive(Debug)]
enum Data {
    Single(Py<PyArray1<f32>>),
    Double(Py<PyArray1<f64>>),
}

impl Data {
    fn new(py: Python<'_>, data: FactorVec) -> Self {
        match data {
            FactorVec::Single(data) => Self::Single(numbers::frozen(py, data).unbind()),
            FactorVec::Double(data) => Self::Double(numbers::frozen(py, data).unbind()),
        }
    }

    fn bind<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        match self {
            Self::Single(data) => data.bind(py).as_any().clone(),
            Self::Double(data) => data.bind(py).as_any().clone(),
        }
    }

    fn view<'py>(&self, py: Python<'py>) -> DataView<'py> {
        match self {
            Self::Single(data) => DataView::Single(data.bind(py).readonly()),
            Self::Double(data) => DataView::Double(data.bind(py).readonly()),
        }
    }
}

/// Form factors borrowed for reading.
enum DataView<'py> {
    Single(PyReadonlyArray1<'py, f32>),
    Double(PyReadonlyArray1<'py, f64>),
}

impl DataView<'_> {
    fn as_slice(&self) -> PyResult<FactorSlice<'_>> {
        Ok(match self {
            Self::Single(data) => FactorSlice::Single(data.as_slice()?),
            Self::Double(data) => FactorSlice::Double(data.as_slice()?),
        })
    }
}

/// Compressed rows owned by NumPy, read-only.
#[derive(Debug)]
struct Arrays<I: Element> {
    indptr: Py<PyArray1<I>>,
    indices: Py<PyArray1<I>>,
    data: Data,
}

impl<I: Index + Element> Arrays<I> {
    fn new(py: Python<'_>, whole: Assembly<I>) -> Self {
        let (indptr, indices, data) = whole.into_arrays();
        Self {
            indptr: numbers::frozen(py, indptr).unbind(),
            indices: numbers::frozen(py, indices).unbind(),
            data: Data::new(py, data),
        }
    }

    fn to_scipy<'py>(&self, py: Python<'py>, shape: (usize, usize)) -> PyResult<Bound<'py, PyAny>> {
        let arrays = (self.data.bind(py), self.indices.bind(py), self.indptr.bind(py));
        let named = PyDict::new(py);
        named.set_item("shape", shape)?;
        named.set_item("copy", false)?;
        let matrix = py
            .import("scipy.sparse")?
            .call_method("csr_matrix", (arrays,), Some(&named))?;
        // So they are, and SciPy need not look.
        matrix.setattr("has_sorted_indices", true)?;
        matrix.setattr("has_canonical_format", true)?;
        Ok(matrix)
    }

    /// Columns and form factors of a row, as views.
    fn row<'py>(&self, py: Python<'py>, patch: usize) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let indptr = self.indptr.bind(py).readonly();
        let bound = |place: usize| {
            let bound: Option<usize> = indptr
                .as_slice()
                .ok()?
                .get(place)
                .and_then(|&bound| bound.try_into().ok());
            bound.and_then(|bound| isize::try_from(bound).ok())
        };
        let (Some(start), Some(end)) = (bound(patch), bound(patch + 1)) else {
            return Err(PyIndexError::new_err(format!("there is no row {patch}")));
        };
        let slice = PySlice::new(py, start, end, 1);
        Ok((
            self.indices.bind(py).get_item(&slice)?,
            self.data.bind(py).get_item(&slice)?,
        ))
    }

    fn view<'py>(&self, py: Python<'py>) -> View<'py, I> {
        View {
            indptr: self.indptr.bind(py).readonly(),
            indices: self.indices.bind(py).readonly(),
            data: self.data.view(py),
        }
    }
}

/// Arrays borrowed for reading.
struct View<'py, I: Element> {
    indptr: PyReadonlyArray1<'py, I>,
    indices: PyReadonlyArray1<'py, I>,
    data: DataView<'py>,
}

impl<I: Index + Element> View<'_, I> {
    fn slices(&self) -> PyResult<Slices<'_, I>> {
        Ok(Slices {
            indptr: self.indptr.as_slice()?,
            indices: self.indices.as_slice()?,
            data: self.data.as_slice()?,
        })
    }
}

/// The matrix for solvers, in runs copied when they are needed: a few at once, not all.
struct Slices<'a, I> {
    indptr: &'a [I],
    indices: &'a [I],
    data: FactorSlice<'a>,
}

impl<I: Index> Factors for Slices<'_, I> {
    fn patch_count(&self) -> usize {
        self.indptr.len().saturating_sub(1)
    }

    fn run_count(&self) -> usize {
        self.patch_count().div_ceil(RUN)
    }

    fn run(&self, index: usize) -> Result<Arc<Part>, StoreError> {
        let bound = |row: usize| -> usize { self.indptr[row].try_into().unwrap_or(0) };
        let first = index * RUN;
        let end = (first + RUN).min(self.patch_count());
        let (start, stop) = (bound(first), bound(end));
        let count = |number: usize| i64::try_from(number).unwrap_or(i64::MAX);
        Ok(Arc::new(Part {
            rows: (first..end).filter_map(|row| u32::try_from(row).ok()).collect(),
            indptr: (first..=end).map(|row| count(bound(row) - start)).collect(),
            indices: self.indices[start..stop].iter().map(column).collect(),
            data: self.data.get(start..stop).unwrap_or_default().to_vec(),
            ..Part::default()
        }))
    }
}

impl<I: Index> Slices<'_, I> {
    /// The part of `head`, whose entries are here.
    fn filled(&self, head: &Part) -> Part {
        let mut part = head.clone();
        let bound = |row: usize| -> usize { self.indptr[row].try_into().unwrap_or(0) };
        for &patch in &head.rows {
            let entries = bound(patch as usize)..bound(patch as usize + 1);
            part.data.extend(self.data.get(entries.clone()).unwrap_or_default());
            part.indices.extend(self.indices[entries].iter().map(column));
        }
        part
    }

    /// Writes a store with these entries. Its bytes are those of a run with an output.
    fn write(&self, memory: &Memory, directory: &Path) -> Result<(), StoreError> {
        let mut writer = StoreWriter::create(directory, memory.header.clone(), &memory.patches, false)?;
        for head in &memory.heads {
            writer.write_part(&self.filled(head))?;
        }
        writer.finish().map(drop)
    }
}

/// A column as parts have it.
fn column<I: Index>(column: &I) -> i32 {
    let column: usize = (*column).try_into().unwrap_or(0);
    i32::try_from(column).unwrap_or(0)
}

/// `indptr` and `indices`, as wide as the number of entries needs: SciPy wants both alike, and copies others.
#[derive(Debug)]
enum CompressedRows {
    Narrow(Arrays<i32>),
    Wide(Arrays<i64>),
}

/// Compressed rows before NumPy owns them.
enum Assembled {
    Narrow(Assembly<i32>),
    Wide(Assembly<i64>),
}

impl Assembled {
    fn new(entries_of_rows: &[u64], precision: Precision) -> PyResult<Self> {
        if let Some(narrow) = Assembly::new(entries_of_rows, precision) {
            return Ok(Self::Narrow(narrow));
        }
        let wide = Assembly::new(entries_of_rows, precision);
        wide.map(Self::Wide)
            .ok_or_else(|| errors::input("the matrix has more entries than can be counted"))
    }

    fn place(&mut self, part: &Part) -> PyResult<()> {
        match self {
            Self::Narrow(whole) => whole.place(part),
            Self::Wide(whole) => whole.place(part),
        }
        .map_err(|patch| errors::input(format!("row {patch} changed while it was read")))
    }

    fn into_arrays(self, py: Python<'_>) -> CompressedRows {
        match self {
            Self::Narrow(whole) => CompressedRows::Narrow(Arrays::new(py, whole)),
            Self::Wide(whole) => CompressedRows::Wide(Arrays::new(py, whole)),
        }
    }
}

impl CompressedRows {
    fn to_scipy<'py>(&self, py: Python<'py>, shape: (usize, usize)) -> PyResult<Bound<'py, PyAny>> {
        match self {
            Self::Narrow(arrays) => arrays.to_scipy(py, shape),
            Self::Wide(arrays) => arrays.to_scipy(py, shape),
        }
    }

    fn row<'py>(&self, py: Python<'py>, patch: usize) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        match self {
            Self::Narrow(arrays) => arrays.row(py, patch),
            Self::Wide(arrays) => arrays.row(py, patch),
        }
    }

    fn entries(&self, py: Python<'_>) -> PyResult<u64> {
        let data = match self {
            Self::Narrow(arrays) => &arrays.data,
            Self::Wide(arrays) => &arrays.data,
        };
        Ok(data.bind(py).len()? as u64)
    }
}

/// Some matrix, held for a product or a solution.
pub(crate) trait Use<T> {
    /// Runs `work` without the interpreter's lock.
    fn with(self, factors: &dyn Factors) -> T;
}

#[derive(Debug)]
struct Memory {
    whole: CompressedRows,
    table: RowTable,
    header: Header,
    patches: PatchTable,
    /// The parts without their entries.
    heads: Vec<Part>,
    expected_error: Option<f64>,
}

impl Memory {
    /// Writes the matrix as a store.
    fn write(&self, py: Python<'_>, directory: &Path) -> PyResult<()> {
        match &self.whole {
            CompressedRows::Narrow(arrays) => {
                let view = arrays.view(py);
                let slices = view.slices()?;
                stored(py.detach(|| slices.write(self, directory)))
            }
            CompressedRows::Wide(arrays) => {
                let view = arrays.view(py);
                let slices = view.slices()?;
                stored(py.detach(|| slices.write(self, directory)))
            }
        }
    }
}

#[derive(Debug)]
enum Source {
    Memory(Box<Memory>),
    Store(Box<Store>),
}

/// A form-factor matrix: F[i, j] is the fraction of the diffuse energy leaving patch i that reaches patch j.
///
/// `compute` makes one, in memory or in a store, and `open` opens a store. Rows of a store are read when they are asked
/// for.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Matrix {
    source: Source,
}

pub(crate) fn stored<T>(result: Result<T, StoreError>) -> PyResult<T> {
    result.map_err(|error| errors::store(&error))
}

/// A folder below `folder`, or below the system's for temporary files, removed when it is dropped.
pub(crate) fn temporary(folder: Option<&Path>) -> PyResult<tempfile::TempDir> {
    let made = match folder {
        Some(folder) => tempfile::TempDir::with_prefix_in(".hemicube-", folder),
        None => tempfile::TempDir::with_prefix("hemicube-"),
    };
    made.map_err(|source| {
        let path = folder.map_or_else(std::env::temp_dir, Path::to_owned);
        let action = "written to";
        errors::store(&StoreError::Io { path, action, source })
    })
}

/// Relative Frobenius error by the rows' expected errors; `None` where no row has one.
fn relative(errors: &[f64], squared_norm: f64) -> Option<f64> {
    let squared: f64 = errors
        .iter()
        .filter(|error| !error.is_nan())
        .map(|error| error * error)
        .sum();
    let relative = (squared / squared_norm).sqrt();
    (squared > 0.0 && relative.is_finite()).then_some(relative)
}

fn squared_norm(part: &Part) -> f64 {
    part.data.iter().map(|factor| factor.powi(2)).sum()
}

impl Matrix {
    pub(crate) fn stored(store: Store) -> Self {
        Self {
            source: Source::Store(Box::new(store)),
        }
    }

    /// The matrix of finished parts. Their entries are dropped when they are in their places.
    pub(crate) fn in_memory(header: Header, patches: PatchTable, mut parts: Vec<Part>) -> PyResult<Self> {
        let mut table = RowTable::unknown(patches.len());
        let optics = optics_of(&header.settings, [&header.objects, &header.materials], &patches);
        let passed = |optics: Option<PatchOptics>| optics.map_or(0.0, |optics| optics.specular + optics.transmittance);
        table.handed_on = optics.into_iter().flatten().map(passed).collect();
        let mut entries = vec![0; patches.len()];
        let mut norm = 0.0;
        for part in &parts {
            table.add(part, header.form);
            norm += squared_norm(part);
            for (row, &patch) in part.rows.iter().enumerate() {
                entries[patch as usize] = part.row(row).0.len() as u64;
            }
        }
        let mut whole = Assembled::new(&entries, header.form.precision())?;
        for part in &mut parts {
            whole.place(part)?;
            part.indices = Vec::new();
            part.data = FactorVec::new(header.form.precision());
        }
        let memory = Memory {
            whole: Python::attach(|py| whole.into_arrays(py)),
            expected_error: relative(&table.error, norm),
            table,
            header,
            patches,
            heads: parts,
        };
        Ok(Self {
            source: Source::Memory(Box::new(memory)),
        })
    }

    /// The matrix of a complete store, in memory.
    pub(crate) fn read(store: &Store) -> PyResult<Self> {
        stored(store.require_complete())?;
        let manifest = store.manifest().clone();
        let places = 0..manifest.parts.len();
        let parts = places.filter_map(|place| stored(store.part(place)).transpose());
        let parts = parts.collect::<PyResult<Vec<Part>>>()?;
        let header = Header {
            program: manifest.program,
            scene: manifest.scene,
            settings: manifest.settings,
            correction: manifest.correction,
            patch_count: manifest.patch_count,
            row_count: manifest.row_count,
            rows_per_part: manifest.rows_per_part,
            form: manifest.form,
            min_factor: manifest.min_factor,
            backend: manifest.backend,
            objects: manifest.objects,
            materials: manifest.materials,
        };
        Self::in_memory(header, stored(store.patches())?, parts)
    }

    /// The store of the matrix, if it has one.
    pub(crate) fn store(&self) -> Option<&Store> {
        match &self.source {
            Source::Memory(_) => None,
            Source::Store(store) => Some(store),
        }
    }

    /// Writes a matrix in memory as a store; nothing for one that is in a store.
    pub(crate) fn write(&self, py: Python<'_>, directory: &Path) -> PyResult<()> {
        match &self.source {
            Source::Memory(memory) => memory.write(py, directory),
            Source::Store(_) => Ok(()),
        }
    }

    /// Runs `work` on the store of the matrix, without the interpreter's lock. Of a matrix in memory, a store below
    /// `folder` (by default the system's for temporary files) is written first and removed afterwards.
    pub(crate) fn with_store<T: Send>(
        &self,
        py: Python<'_>,
        folder: Option<&Path>,
        work: impl FnOnce(&Store, &AtomicBool) -> PyResult<T> + Send,
    ) -> PyResult<T> {
        let attend = |store: &Store| {
            attended(py, None, |attendant: Attendant<'_, (u64,)>| {
                work(store, attendant.cancel())
            })?
        };
        if let Some(store) = self.store() {
            return attend(store);
        }
        let temporary = temporary(folder)?;
        let directory = temporary.path().join("matrix.hemicube");
        self.write(py, &directory)?;
        attend(&stored(Store::open(&directory))?)
    }

    /// A value of the mirror or pane that each patch is; 0 for others.
    fn optics(&self, value: impl Fn(PatchOptics) -> f64) -> PyResult<Vec<f64>> {
        let table = self.patches()?;
        let found = match &self.source {
            Source::Memory(memory) => {
                let header = &memory.header;
                optics_of(&header.settings, [&header.objects, &header.materials], &table)
            }
            Source::Store(store) => store.manifest().optics_of(&table),
        };
        let of = |optics: Option<PatchOptics>| optics.map_or(0.0, &value);
        Ok(found.map_or_else(|| vec![0.0; table.len()], |found| found.into_iter().map(of).collect()))
    }

    pub(crate) fn patch_count(&self) -> usize {
        match &self.source {
            Source::Memory(memory) => memory.patches.len(),
            Source::Store(store) => store.patch_count() as usize,
        }
    }

    pub(crate) fn table(&self) -> PyResult<RowTable> {
        match &self.source {
            Source::Memory(memory) => Ok(memory.table.clone()),
            Source::Store(store) => stored(store.row_table()),
        }
    }

    /// The rows' shares for exchanges.
    pub(crate) fn exchange_table(&self) -> PyResult<RowTable> {
        match &self.source {
            Source::Memory(memory) => Ok(memory.table.clone()),
            Source::Store(store) => stored(store.exchange_table()),
        }
    }

    /// The table of the rows that a solver reads, and the stored rows' shares for exchanges, which it is made of.
    pub(crate) fn read_table(
        &self,
        py: Python<'_>,
        budget: u64,
        reading: Reading,
        threads: usize,
    ) -> PyResult<[RowTable; 2]> {
        let rows = self.exchange_table()?;
        let read = match reading {
            Reading::AsStored => rows.clone(),
            Reading::Pairs => {
                let areas = self.area()?;
                let using = RowsOfPairs {
                    py,
                    areas: &areas,
                    rows: &rows,
                    threads,
                };
                self.lend(py, budget, using)?
            }
        };
        Ok([read, rows])
    }

    /// The patch table.
    pub(crate) fn patches(&self) -> PyResult<PatchTable> {
        match &self.source {
            Source::Memory(memory) => Ok(memory.patches.clone()),
            Source::Store(store) => stored(store.patches()),
        }
    }

    /// What a patch is.
    pub(crate) fn patch_kind(&self) -> PatchKind {
        match &self.source {
            Source::Memory(memory) => memory.header.patch_kind(),
            Source::Store(store) => store.manifest().patch_kind(),
        }
    }

    /// Further names of objects.
    pub(crate) fn further_names(&self) -> std::collections::BTreeMap<u32, Vec<String>> {
        let settings = match &self.source {
            Source::Memory(memory) => &memory.header.settings,
            Source::Store(store) => &store.manifest().settings,
        };
        hemicube::driver::settings::ReadingRecord::of_settings(settings).further_names
    }

    /// Names of objects and of materials.
    pub(crate) fn group_names(&self) -> [&[String]; 2] {
        match &self.source {
            Source::Memory(memory) => [&memory.header.objects, &memory.header.materials],
            Source::Store(store) => [&store.manifest().objects, &store.manifest().materials],
        }
    }

    pub(crate) fn area(&self) -> PyResult<Vec<f64>> {
        match &self.source {
            Source::Memory(memory) => Ok(memory.patches.area.clone()),
            Source::Store(store) => Ok(stored(store.patches())?.area),
        }
    }

    /// Lends the whole matrix. Of a store, at most `budget` bytes are kept in memory.
    ///
    /// # Errors
    /// When rows are missing.
    pub(crate) fn lend<T>(&self, py: Python<'_>, budget: u64, using: impl Use<PyResult<T>>) -> PyResult<T> {
        match &self.source {
            Source::Store(store) => using.with(&stored(OutOfCore::new(store, budget))?),
            Source::Memory(memory) => {
                let missing = memory.table.row_sum.iter().filter(|sum| sum.is_nan()).count();
                if missing > 0 {
                    return Err(errors::input(format!(
                        "the matrix has no rows of {missing} of {} patches; what they send is not known: compute it \
                         without `rows`, `sample_rows`, `emitters` and `occluders`",
                        self.patch_count()
                    )));
                }
                match &memory.whole {
                    CompressedRows::Narrow(arrays) => using.with(&arrays.view(py).slices()?),
                    CompressedRows::Wide(arrays) => using.with(&arrays.view(py).slices()?),
                }
            }
        }
    }

    fn column<'py>(
        &self,
        py: Python<'py>,
        of: impl FnOnce(RowTable) -> Vec<f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, of(self.table()?)))
    }

    fn computed(&self) -> PyResult<Vec<u32>> {
        match &self.source {
            Source::Store(store) => Ok(stored(store.computed_patches())?.iter().map(|patch| patch.0).collect()),
            Source::Memory(memory) => {
                let rows = (0..).zip(&memory.table.row_sum);
                Ok(rows.filter(|(_, sum)| !sum.is_nan()).map(|(patch, _)| patch).collect())
            }
        }
    }

    /// Columns and form factors of an existing row.
    fn entries_of<'py>(&self, py: Python<'py>, patch: u32) -> PyResult<Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>> {
        match &self.source {
            Source::Memory(memory) => {
                let is_there = memory
                    .table
                    .row_sum
                    .get(patch as usize)
                    .is_some_and(|sum| !sum.is_nan());
                is_there.then(|| memory.whole.row(py, patch as usize)).transpose()
            }
            Source::Store(store) => {
                let Some(row) = stored(py.detach(|| store.row(InputPatch(patch))))? else {
                    return Ok(None);
                };
                let columns = row.indices.into_iter().map(u32::cast_signed).collect();
                Ok(Some((
                    PyArray1::<i32>::from_vec(py, columns).into_any(),
                    match row.data {
                        FactorVec::Single(data) => PyArray1::from_vec(py, data).into_any(),
                        FactorVec::Double(data) => PyArray1::from_vec(py, data).into_any(),
                    },
                )))
            }
        }
    }
}

/// The table of the rows whose pairs are read once.
struct RowsOfPairs<'a, 'py> {
    py: Python<'py>,
    areas: &'a [f64],
    rows: &'a RowTable,
    threads: usize,
}

impl Use<PyResult<RowTable>> for RowsOfPairs<'_, '_> {
    fn with(self, factors: &dyn Factors) -> PyResult<RowTable> {
        let (areas, rows, threads) = (self.areas, self.rows, self.threads);
        stored(
            self.py
                .detach(|| Pairs::new(factors, areas, rows, threads)?.rows(rows, threads)),
        )
    }
}

/// F times a vector.
struct Product<'py> {
    py: Python<'py>,
    x: Block,
    threads: usize,
}

impl Use<PyResult<Vec<f64>>> for Product<'_> {
    fn with(self, factors: &dyn Factors) -> PyResult<Vec<f64>> {
        let threads = match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let product = stored(self.py.detach(|| multiply(factors, &self.x, threads)))?;
        Ok(product.values().to_vec())
    }
}

/// JSON as Python objects.
pub(crate) fn python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (value.to_string(),))
}

#[pymethods]
impl Matrix {
    /// Rows and columns: both the number of patches.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.patch_count(), self.patch_count())
    }

    fn __len__(&self) -> usize {
        self.patch_count()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let place = match &self.source {
            Source::Memory(_) => "in memory".to_owned(),
            Source::Store(store) => format!("in {}", store.directory().display()),
        };
        Ok(format!(
            "<hemicube.Matrix of {} patches, {} entries, {place}>",
            self.patch_count(),
            self.nnz(py)?
        ))
    }

    /// Number of entries.
    #[getter]
    fn nnz(&self, py: Python<'_>) -> PyResult<u64> {
        match &self.source {
            Source::Memory(memory) => memory.whole.entries(py),
            Source::Store(store) => Ok(store.manifest().entries),
        }
    }

    /// Names of the patches where they are objects, materials or faces (numbers from 0, `back` for backs); None where
    /// they are triangles.
    #[getter]
    fn names(&self) -> PyResult<Option<Vec<String>>> {
        Ok(match &self.source {
            Source::Memory(memory) => {
                let Header { objects, materials, .. } = &memory.header;
                memory.patches.names(memory.header.patch_kind(), objects, materials)
            }
            Source::Store(store) => {
                let manifest = store.manifest();
                let table = stored(store.patches())?;
                table.names(manifest.patch_kind(), &manifest.objects, &manifest.materials)
            }
        })
    }

    /// The store's directory; None for a matrix in memory.
    #[getter]
    fn path(&self) -> Option<PathBuf> {
        match &self.source {
            Source::Memory(_) => None,
            Source::Store(store) => Some(store.directory().to_owned()),
        }
    }

    /// True if all rows asked for are there.
    #[getter]
    fn complete(&self) -> bool {
        match &self.source {
            Source::Memory(_) => true,
            Source::Store(store) => store.manifest().complete,
        }
    }

    /// Everything that its rows depend on: resolution, correction, tolerance and the reason of the settings chosen for
    /// it.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        python(
            py,
            match &self.source {
                Source::Memory(memory) => &memory.header.settings,
                Source::Store(store) => &store.manifest().settings,
            },
        )
    }

    /// Area of each patch.
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.area()?))
    }

    /// Sum of the form factors of each row; NaN for rows not computed.
    #[getter]
    fn row_sums<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.row_sum)
    }

    /// Share of each patch's view that leaves the scene, refined with its form factors; NaN for rows without hemicubes.
    #[getter]
    fn escaped<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.escaped)
    }

    /// Share of each patch's view that ends on backs of one-sided patches.
    #[getter]
    fn blocked<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.blocked)
    }

    /// Share of each patch's view that ends on patches without a column.
    #[getter]
    fn unselected<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.unselected)
    }

    /// Specular reflectance ρs of each patch, from 0 to 1; the hemispherical mean where it depends on the angle.
    #[getter]
    fn specular_reflectance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.optics(|optics| optics.specular)?))
    }

    /// Transmittance τ of each patch, from 0 to 1; the hemispherical mean where it depends on the angle.
    #[getter]
    fn transmittance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.optics(|optics| optics.transmittance)?))
    }

    /// Share of each row that mirrors and panes handed on after it had arrived; 0 without any.
    #[getter]
    fn passed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let count = self.patch_count();
        self.column(py, |table| (0..count).map(|patch| table.passed_of(patch)).collect())
    }

    /// Share of each row cut off after the last portal followed, a part of `unselected`; 0 without portals.
    #[getter]
    fn cut_off<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let count = self.patch_count();
        self.column(py, |table| match table.cut_off.is_empty() {
            true => vec![0.0; count],
            false => table.cut_off,
        })
    }

    /// Closure error of each row: row sum + escaped + blocked + unselected − 1, less what mirrors and panes handed on.
    #[getter]
    fn closure<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| {
            let lost = table.escaped.iter().zip(&table.blocked).zip(&table.unselected);
            let rows = table.row_sum.iter().zip(lost).enumerate();
            rows.map(|(patch, (sum, ((escaped, blocked), unselected)))| {
                sum + escaped + blocked + unselected - 1.0 - table.passed_of(patch)
            })
            .collect()
        })
    }

    /// The expected √Σ (F − true F)² of each row; NaN without a tolerance.
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.error)
    }

    /// The standard error of each row's sum of form factors; NaN without a tolerance.
    #[getter]
    fn sum_errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.sum_error)
    }

    /// The standard error of the share of each row that escapes; NaN without a tolerance.
    #[getter]
    fn escaped_errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |table| table.escaped_error)
    }

    /// The expected relative Frobenius error of the matrix; None without a tolerance. Reads all of a store.
    fn expected_error(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        match &self.source {
            Source::Memory(memory) => Ok(memory.expected_error),
            Source::Store(store) => py.detach(|| {
                let table = stored(store.row_table())?;
                if table.error.iter().all(|error| error.is_nan()) {
                    return Ok(None);
                }
                let mut norm = 0.0;
                for place in 0..store.manifest().parts.len() {
                    norm += stored(store.part(place))?.as_ref().map_or(0.0, squared_norm);
                }
                Ok(relative(&table.error, norm))
            }),
        }
    }

    /// The matrix as a `scipy.sparse.csr_matrix` of float32, rows and columns in the scene's order.
    ///
    /// All calls on a matrix in memory share the same read-only arrays; nothing is copied (`.copy()` makes arrays that
    /// can be written to). A store is read whole, each time.
    fn to_scipy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let shape = self.shape();
        let store = match &self.source {
            Source::Memory(memory) => return memory.whole.to_scipy(py, shape),
            Source::Store(store) => store,
        };
        stored(store.require_complete())?;
        let whole = py.detach(|| -> PyResult<Assembled> {
            let patches = (0..store.patch_count()).map(InputPatch);
            let entries = patches.map(|patch| Ok(stored(store.entries_of_row(patch))?.unwrap_or(0)));
            let mut whole = Assembled::new(
                &entries.collect::<PyResult<Vec<u64>>>()?,
                store.manifest().form.precision(),
            )?;
            for place in 0..store.manifest().parts.len() {
                if let Some(part) = stored(store.part(place))? {
                    whole.place(&part)?;
                }
            }
            Ok(whole)
        })?;
        whole.into_arrays(py).to_scipy(py, shape)
    }

    /// Equal to `to_scipy()`.
    #[getter]
    fn csr<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.to_scipy(py)
    }

    /// The columns and form factors of a row; None where it was not computed.
    fn row<'py>(&self, py: Python<'py>, patch: u32) -> PyResult<Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>> {
        if patch as usize >= self.patch_count() {
            return Err(PyIndexError::new_err(format!(
                "there is no row {patch}: the matrix has {}, from 0 on",
                self.patch_count()
            )));
        }
        self.entries_of(py, patch)
    }

    /// All computed rows, one after the other: (patch, columns, form factors). One row of a store is in memory at a
    /// time; `stored_order` reads its files from the first to the last instead of by patches.
    #[pyo3(signature = (*, stored_order=false))]
    fn rows(slf: &Bound<'_, Self>, stored_order: bool) -> PyResult<Rows> {
        let matrix = slf.get();
        let order = match &matrix.source {
            Source::Store(store) if stored_order => {
                let order = stored(store.processing_order())?;
                order.iter().map(|patch| patch.0).collect()
            }
            _ => matrix.computed()?,
        };
        Ok(Rows {
            matrix: slf.clone().unbind(),
            order: order.into_iter(),
        })
    }

    fn __iter__(slf: &Bound<'_, Self>) -> PyResult<Rows> {
        Self::rows(slf, false)
    }

    /// F x, without the whole matrix in memory: y[i] = Σ F[i, j] x[j], the irradiance of each patch by radiosities x.
    #[pyo3(signature = (x, *, threads=0))]
    fn multiply<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = numbers::vector(x, "x", self.patch_count())?;
        let x = Block::from_fn(values.len(), 1, |patch, _| values[patch]);
        let product = self.lend(py, 0, Product { py, x, threads })?;
        Ok(PyArray1::from_vec(py, product))
    }

    /// Writes the matrix, or what is known of its patches, to a file, whose extension names its format: `.npz`, `.mtx`,
    /// `.txt`, `.npy` or `.parquet` for the matrix; `.vtp`, `.vtu`, `.glb`, `.ply` or `.csv` for the patches, `.npz`
    /// with `patches=True`. Returns the file's size in bytes.
    ///
    /// `values` are more results of the patches, by name: (n,) numbers each, such as radiosities. Formats with the
    /// shape of the patches need the `scene`; `.glb` and `.ply` are coloured by the result `show`, by default the last
    /// of `values`, or the number of patches in sight. `up` is for `.glb`, by default the scene's.
    ///
    /// `format` names a solver in place of the extension, as `hemicube export --for` does: 'calculix', 'elmer',
    /// 'energyplus', 'openfoam', 'petsc', 'udales', 'view3d' or 'view3d-binary'. `by` ('patch', 'face', 'object',
    /// 'material'; by default as the solver counts) says what its rows are, `order` names all of them in the solver's
    /// order, `zone` is EnergyPlus's, and `program_version` the solver's where its files tell it. The size is then of
    /// all files together.
    #[pyo3(signature = (path, *, patches=false, scene=None, values=None, show=None, up=None, overwrite=false,
                        format=None, by=None, order=None, zone=None, program_version=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords")]
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        patches: bool,
        scene: Option<&Bound<'_, Scene>>,
        values: Option<&Bound<'_, PyDict>>,
        show: Option<String>,
        up: Option<&str>,
        overwrite: bool,
        format: Option<&str>,
        by: Option<&str>,
        order: Option<Vec<String>>,
        zone: Option<&str>,
        program_version: Option<&str>,
    ) -> PyResult<u64> {
        let for_solver = ForSolver {
            by,
            order,
            zone,
            program_version,
        };
        let asked = Asked {
            patches,
            scene: scene.map(|scene| scene.get()),
            values: values
                .map(|values| export::values(values, self.patch_count()))
                .transpose()?,
            show,
            up: up.map(axis).transpose()?,
            overwrite,
        };
        match format {
            Some(solver) => export::export_for_solver(py, self, &path, solver, &for_solver, &asked),
            None => {
                for_solver.require_none()?;
                export::export(py, self, &path, asked)
            }
        }
    }

    /// A `pandas.DataFrame` of all form factors, from rows to columns, by the names of the patches, or by their numbers
    /// where they are triangles; rows that were not computed are NaN. Up to 10,000 patches. Needs pandas.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::pandas::require_few(self.patch_count())?;
        let names = self.names()?;
        let dense = self.to_scipy(py)?.call_method0("toarray")?;
        let computed = self.computed()?;
        let mut missing = vec![true; self.patch_count()];
        computed.iter().for_each(|&patch| missing[patch as usize] = false);
        let rows: Vec<usize> = (0..missing.len()).filter(|&patch| missing[patch]).collect();
        if !rows.is_empty() {
            dense.set_item(rows, f64::NAN)?;
        }
        crate::pandas::frame(py, &dense, names.as_deref(), names.as_deref())
    }

    /// Form factors between zones: rows and columns added up by 'object', 'material' or 'face'.
    #[pyo3(signature = (by="object"))]
    fn zones(&self, py: Python<'_>, by: &str) -> PyResult<Zones> {
        Zones::of(py, self, by)
    }

    /// Pickles a matrix in a store as its path, one in memory as the bytes of a store.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<pickle::Reduced<'py>> {
        pickle::matrix(slf.py(), slf.get())
    }

    fn __matmul__<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.multiply(py, x, 0)
    }
}

/// The patch, columns and form factors of a row.
type Entries<'py> = (u32, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// The rows of a matrix, one after the other.
#[pyclass(module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Rows {
    matrix: Py<Matrix>,
    order: std::vec::IntoIter<u32>,
}

#[pymethods]
impl Rows {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __length_hint__(&self) -> usize {
        self.order.len()
    }

    fn __next__<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Entries<'py>>> {
        let Some(patch) = self.order.next() else {
            return Ok(None);
        };
        match self.matrix.get().entries_of(py, patch)? {
            Some((columns, factors)) => Ok(Some((patch, columns, factors))),
            None => Err(errors::input(format!("row {patch} is not there any more"))),
        }
    }
}

/// Opens the store in a directory, complete or not. Rows are read when they are asked for.
#[pyfunction]
#[pyo3(signature = (path))]
pub(crate) fn open(py: Python<'_>, path: PathBuf) -> PyResult<Matrix> {
    py.detach(|| Store::open(&path))
        .map(Matrix::stored)
        .map_err(|error| errors::store(&error))
}
