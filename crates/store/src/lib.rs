//! The store: a form-factor matrix on disk, never whole in memory.
//!
//! ```text
//! DIR/manifest.json          what it is a matrix of, how it was computed, which parts it has
//! DIR/patches.npz            one row a patch, in input order: face, object, material, side (0 front, 1 back), area,
//!                            centroid, normal, corners (of triangles), drawn_by (after an update); escaped, blocked,
//!                            unselected (with the form factors, they sum to 1),
//!                            row_sum, error (expected √Σ (F − true F)²), and hemicube_escaped, hemicube_blocked,
//!                            hemicube_unselected (what the hemicubes say); NaN where no row was computed
//! DIR/parts/part-00000.npz   format, shape, data, indices, indptr: what `scipy.sparse.load_npz` reads, a CSR block of
//!                            `rows_per_part` rows of the processing order and `patch_count` columns;
//!                            rows (which input patches its rows are), sums (weights: visible, escaped, blocked,
//!                            unselected), shares (escaped, blocked, unselected, refined with the form factors),
//!                            hemicubes (how many a row was rendered with),
//!                            errors (expected √Σ (F − true F)², NaN where not estimated) and rays (that its visible
//!                            fractions were measured with)
//! DIR/solutions/NAME/        what was solved of it (`hemicube::solve`), and
//! DIR/sky/                   what its rows lose to the sky (`hemicube::sky`), where somebody asked for that
//! ```
//!
//! F\[i, j\] is from i to j: the fraction of the diffuse energy leaving patch i that reaches patch j. Rows and columns
//! are *input patches*, positions in the scene file's face order; the order of work (Morton) shows only in the rows of
//! a part. With `settings.patches` of `face`, `object` or `material`, rows and columns are *patches of several
//! elements* ([`crate::Grouping`]), in the order of their first elements. Areas, weights, hemicubes and rays of a patch
//! are sums over its elements, shares are area-weighted means; face, object or material are 2³² − 1 where its elements
//! have several, and the normal is zero where they lie in no plane.
//!
//! Weights are fixed point, 2³¹ for each hemicube: visible + escaped + blocked + unselected = hemicubes · 2³¹ holds
//! exactly, row by row. Shares ([`RowShares`]) are for users: with the form factors of a row they sum to 1.
//!
//! In the *compact* form ([`Form`]) a part has a third to a quarter of the plain form's size. Instead of data and
//! indices it has codes, gaps, lengths and runptr (`compact.rs` and `docs/store.md` define them), and its form
//! factors are rounded by a relative error stated in the manifest. All readers of a store read both.
//!
//! Every file is written under a temporary name, synced and renamed; parts do not depend on each other, and the files
//! depend on scene and settings alone. A part is whole or absent: a killed run loses the part under way, and equal runs
//! give equal bytes.

mod assembly;
#[doc(hidden)]
pub mod closure;
mod compact;
mod csr;
mod durable;
mod error;
mod factors;
mod finished;
mod grouped;
mod grouping;
mod lock;
mod manifest;
mod matrix;
mod npy;
mod npz;
mod product;
mod read;
mod records;
mod resume;
mod row_product;
mod shard;
mod shares;
pub mod sky;
#[doc(hidden)]
pub mod small_entries;
mod validate;
mod write;

pub use assembly::{Assembly, Index};
pub use durable::{DurableFile, TemporaryFile};
pub use error::{Error, Result};
pub use factors::{FactorIter, FactorSlice, FactorVec, Precision};
pub use finished::FinishedRow;
pub use grouping::{Grouping, PatchKind};
pub use lock::FolderLock;
pub use manifest::{
    BackendEntry, FORMAT, FileEntry, Header, Manifest, PATCH_COUNT_MAX, PartEntry, PatchOptics, PatchTable, SceneEntry,
    VERSION, optics_of, scene_hash,
};
pub use matrix::{F32_COMMENT, Matrix, MatrixRow};
pub use npy::{Element, ElementType};
pub use npz::NpzWriter;
pub use read::{Row, RowTable, Rows, Store};
pub use records::{BalanceEntry, BalanceSource, Residuals};
pub use resume::{Merged, NotKept, Resumed, merge};
pub use shard::Shard;
pub use shares::RowShares;
pub use small_entries::{PartThinning, Thinning};
pub use write::StoreWriter;

// For the crates beside this one, which write and read files of the same kinds: these change without notice.
#[doc(hidden)]
pub use durable::{file_checksum, read_exact_at, sealed_checksum, write_whole};
#[doc(hidden)]
pub use factors::Number;
#[doc(hidden)]
pub use manifest::{is_sealed_or_plain_json, seal_json};
#[doc(hidden)]
pub use npy::{Header as NpyHeader, decode};
#[doc(hidden)]
pub use npz::Npz;
#[doc(hidden)]
pub use shares::ERRORS;

use serde::{Deserialize, Serialize};

/// Name of this program in manifests: its version, a plus sign, and a number raised whenever the same settings and
/// hemicubes come to other bits. A store is resumed only by the program of its manifest.
pub const PROGRAM: &str = concat!(env!("CARGO_PKG_VERSION"), "+34");

/// The weight of a whole hemicube.
pub const HEMICUBE_WEIGHT: u64 = 1 << 31;

/// Form of the parts.
///
/// ```
/// use hemicube_store::Form;
/// let kept = Form::Compact.round(0.1);
/// assert!(kept != 0.1 && (kept - 0.1).abs() / 0.1 <= Form::Compact.value_error());
/// assert_eq!(Form::Compact.round(kept), kept);
/// assert_eq!((Form::Plain.round(0.1), Form::Plain.value_error()), (0.1_f32.into(), 0.0));
/// assert_eq!(Form::Double.round(0.1), 0.1);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// f32 form factors and i32 columns, 8 bytes an entry, readable by `scipy.sparse.load_npz`.
    #[default]
    Plain,
    /// 16-bit form factors and runs of columns, 2 to 3 bytes an entry in most scenes.
    Compact,
    /// f64 form factors and i32 columns, 12 bytes an entry, readable by `scipy.sparse.load_npz`.
    Double,
}

impl Form {
    /// The name in manifests and of `--store`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Compact => "compact",
            Self::Double => "double",
        }
    }

    /// Relative rounding error of a form factor beyond f32's: 0 in the plain and the double form, 2⁻¹¹ in the compact
    /// one (from 2⁻⁶² up; smaller ones are rounded to something below that).
    pub fn value_error(self) -> f64 {
        match self {
            Self::Plain | Self::Double => 0.0,
            Self::Compact => compact::VALUE_ERROR,
        }
    }

    /// Rounds a form factor. Rounding again changes nothing.
    #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
    pub fn round(self, factor: f64) -> f64 {
        match self {
            Self::Plain => f64::from(factor as f32),
            Self::Compact => f64::from(compact::round(factor as f32)),
            Self::Double => factor,
        }
    }

    /// Width of form factors in memory.
    pub fn precision(self) -> Precision {
        match self {
            Self::Plain | Self::Compact => Precision::Single,
            Self::Double => Precision::Double,
        }
    }

    pub(crate) fn is_plain(&self) -> bool {
        *self == Self::Plain
    }
}

/// Weights of a row's hemicubes by where they went. The four sum to the number of hemicubes times [`HEMICUBE_WEIGHT`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowSums {
    /// To patches with columns.
    pub visible: u64,
    /// To nothing.
    pub escaped: u64,
    /// To the backs of one-sided patches.
    pub blocked: u64,
    /// To patches without a column.
    pub unselected: u64,
}

impl RowSums {
    /// All four together, if 64 bits can hold it.
    pub fn total(&self) -> Option<u64> {
        self.visible
            .checked_add(self.escaped)?
            .checked_add(self.blocked)?
            .checked_add(self.unselected)
    }

    /// Both together, if 64 bits can hold it.
    #[doc(hidden)]
    pub fn plus(&self, other: &Self) -> Option<Self> {
        Some(Self {
            visible: self.visible.checked_add(other.visible)?,
            escaped: self.escaped.checked_add(other.escaped)?,
            blocked: self.blocked.checked_add(other.blocked)?,
            unselected: self.unselected.checked_add(other.unselected)?,
        })
    }
}

/// Standard errors of a row, each NaN at accuracy levels that do not estimate it.
///
/// They are expectations: of many rows, two thirds are off by less, and one in twenty by more than twice as much.
#[derive(Clone, Copy, Debug)]
pub struct RowErrors {
    /// Of the row as a whole: expected √Σ (F − true F)².
    pub norm: f32,
    /// Of Σ F.
    pub sum: f32,
    /// Of *escaped*.
    pub escaped: f32,
}

impl RowErrors {
    /// Errors that nobody estimated.
    pub const UNKNOWN: Self = Self::from_array([f32::NAN; 3]);

    /// Norm, sum, escaped: the order in files.
    pub const fn to_array(self) -> [f32; 3] {
        [self.norm, self.sum, self.escaped]
    }

    /// The inverse of [`Self::to_array`].
    pub const fn from_array([norm, sum, escaped]: [f32; 3]) -> Self {
        Self { norm, sum, escaped }
    }

    /// Returns whether Σ F, or the share that escapes, may be off by more than a tolerance: by three standard errors.
    pub fn exceed(self, tolerance: f64) -> bool {
        // NaN is no larger: what nobody estimated is not said to exceed anything.
        ERRORS * f64::from(self.sum.max(self.escaped)) > tolerance
    }
}

impl Default for RowErrors {
    fn default() -> Self {
        Self::UNKNOWN
    }
}

impl PartialEq for RowErrors {
    /// Bit by bit: NaN equals itself.
    fn eq(&self, other: &Self) -> bool {
        self.to_array().map(f32::to_bits) == other.to_array().map(f32::to_bits)
    }
}

/// A fixed run of the processing order: rows of the matrix, compressed. Parts are equal when all their bits are.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Place among the parts, from 0.
    pub index: u32,
    /// The input patch of each row.
    pub rows: Vec<u32>,
    /// Start of each row's entries, and the end of the last one's.
    pub indptr: Vec<i64>,
    /// The input patch of each entry's column, ascending within a row.
    pub indices: Vec<i32>,
    /// The form factor of each entry.
    pub data: FactorVec,
    /// Weights of each row.
    pub sums: Vec<RowSums>,
    /// Shares of each row, refined with its form factors; with pixel sums, the weights' shares.
    pub shares: Vec<RowShares>,
    /// Number of hemicubes of each row; 0 for a row made without any.
    pub hemicubes: Vec<u32>,
    /// Standard errors of each row.
    pub errors: Vec<RowErrors>,
    /// Rays and points spent on each row's visible fractions.
    pub rays: Vec<u32>,
    /// Effect of leaving out small form factors, where that was asked for.
    pub thinning: Option<PartThinning>,
    /// Passage through portals of each row; empty without portals.
    pub passages: Vec<Passage>,
}

/// Passage of a row through portals, as shares of what leaves its patch.
///
/// With mirrors and panes, form factors are of what *arrives*: closure is Σ F − passed + escaped + blocked + unselected
/// = 1, where *unselected* holds what was cut off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Passage {
    /// Handed on by mirrors and panes after it had arrived there, Σ (ρs + τ) F; above 1 where it comes back often.
    pub passed: f64,
    /// Cut off after the last portal followed.
    pub cut_off: f64,
}

impl Passage {
    /// Returns whether both are shares.
    pub(crate) fn is_valid(&self) -> bool {
        self.passed >= 0.0 && self.passed.is_finite() && (0.0..=1.0 + 1e-9).contains(&self.cut_off)
    }
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.index == other.index
            && self.rows == other.rows
            && self.indptr == other.indptr
            && self.indices == other.indices
            && self.data == other.data
            && self.sums == other.sums
            && self.shares == other.shares
            && self.hemicubes == other.hemicubes
            && self.errors == other.errors
            && self.rays == other.rays
            && self.thinning == other.thinning
            && self.passages == other.passages
    }
}

impl Part {
    /// A part without rows, with form factors as wide as a form's.
    pub fn new(form: Form) -> Self {
        Self {
            data: FactorVec::new(form.precision()),
            ..Self::default()
        }
    }

    /// Expected Σ (F − true F)² of the rows that estimate it.
    pub fn squared_error(&self) -> f64 {
        let squared = self.errors.iter().map(|errors| f64::from(errors.norm).powi(2));
        squared.filter(|squared| !squared.is_nan()).sum()
    }

    /// The columns and form factors of a row, by its place in the part; empty beyond the last row.
    pub fn row(&self, row: usize) -> (&[i32], FactorSlice<'_>) {
        let bound = |place: usize| self.indptr.get(place).and_then(|&bound| usize::try_from(bound).ok());
        match (bound(row), bound(row.saturating_add(1))) {
            (Some(start), Some(end)) => (
                self.indices.get(start..end).unwrap_or(&[]),
                self.data.get(start..end).unwrap_or_default(),
            ),
            _ => (&[], FactorSlice::default()),
        }
    }
}
