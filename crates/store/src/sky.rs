//! Sky rows on disk, beside the matrix whose rows lose them: a CSR archive for `scipy.sparse.load_npz`, with more
//! arrays beside, sealed like a part. `hemicube::sky` computes and writes them.

use super::{Error, HEMICUBE_WEIGHT, Npz, Result, Store, sealed_checksum};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Sum of each row's columns.
#[doc(hidden)]
pub const ESCAPED_SHARE: &str = "escaped_share";

/// A weight as a share of a row's hemicubes; 0 of none.
#[doc(hidden)]
pub fn share(weight: u64, whole: u64) -> f64 {
    if whole > 0 { weight as f64 / whole as f64 } else { 0.0 }
}

/// The sky view factor of each row of a file of `hemicube::sky::write_sky`, from 0 to 1.
///
/// # Errors
/// When it cannot be read, or is not an unchanged file of that kind.
pub fn read_sky_view_factors(path: &Path) -> Result<Vec<f64>> {
    require_seal(path)?;
    let factors: Vec<f64> = Npz::open(path)?.array("sky_view_factor")?;
    match (0..)
        .zip(&factors)
        .find(|(_, factor)| !(0.0..=1.0 + ROUNDING).contains(*factor))
    {
        None => Ok(factors),
        Some((row, factor)) => {
            let row: u64 = row;
            Err(Error::malformed(
                path,
                format!("has the sky view factor {factor} in row {row}; compute it anew"),
            ))
        }
    }
}

/// Likewise for the sky rows beside a matrix, one for each patch.
///
/// # Errors
/// Those of [`read_sky_view_factors`], and when it is of another number of patches.
pub fn sky_view_factors_beside(store: &Store) -> Result<Vec<f64>> {
    let path = sky_beside(store);
    let factors = read_sky_view_factors(&path)?;
    require_patches(&path, store, factors.len())?;
    Ok(factors)
}

/// Excess of the sum of one hemisphere's shares over 1 that rounding explains.
const ROUNDING: f64 = 1e-9;

fn require_seal(path: &Path) -> Result<()> {
    if sealed_checksum(path)?.is_some() {
        return Ok(());
    }
    Err(Error::malformed(
        path,
        "is not as it was written: its seal does not hold; compute it anew",
    ))
}

fn require_patches(path: &Path, store: &Store, rows: usize) -> Result<()> {
    if rows == store.patch_count() as usize {
        return Ok(());
    }
    Err(Error::malformed(
        path,
        format!(
            "has {rows} rows and the matrix {} patches: it is of another one; compute it anew",
            store.patch_count()
        ),
    ))
}

/// Path of a matrix's sky rows, beside it.
pub fn sky_beside(store: &Store) -> PathBuf {
    store.directory().join("sky").join("sky.npz")
}

/// Sky rows from the disk, each array held against the others.
#[derive(Debug)]
pub struct StoredSky {
    columns: u32,
    data: Vec<f64>,
    indices: Vec<u32>,
    bounds: Vec<usize>,
}

impl StoredSky {
    /// The sky rows beside a matrix, one for each patch.
    ///
    /// # Errors
    /// Those of [`Self::open`], and when they are of another number of patches.
    pub fn beside(store: &Store) -> Result<Self> {
        let path = sky_beside(store);
        let sky = Self::open(&path)?;
        require_patches(&path, store, sky.rows())?;
        Ok(sky)
    }

    /// Reads a file of `hemicube::sky::write_sky`: ascending columns within the sky, shares from 0 to 1 that sum to 1 at
    /// most in a row.
    ///
    /// # Errors
    /// When it cannot be read, or has changed since it was written.
    pub fn open(path: &Path) -> Result<Self> {
        require_seal(path)?;
        let malformed = |reason: &str| Error::malformed(path, reason);
        let mut npz = Npz::open(path)?;
        let shape: Vec<i64> = npz.array("shape")?;
        let (data, indices): (Vec<f64>, Vec<i32>) = (npz.array("data")?, npz.array("indices")?);
        let indptr: Vec<i64> = npz.array("indptr")?;
        let (rows, columns) = match shape[..] {
            [rows, columns] => (
                usize::try_from(rows).map_err(|_| malformed("has a negative shape"))?,
                u32::try_from(columns).map_err(|_| malformed("has a shape out of range"))?,
            ),
            _ => return Err(malformed("is no matrix")),
        };
        if indptr.len() != rows.saturating_add(1) || data.len() != indices.len() {
            return Err(malformed("has arrays that do not fit together"));
        }
        let bounds: Vec<usize> = indptr
            .iter()
            .map(|&bound| usize::try_from(bound).ok().filter(|&bound| bound <= data.len()))
            .collect::<Option<_>>()
            .ok_or_else(|| malformed("has bounds beyond its entries"))?;
        if bounds[0] != 0 || bounds[rows] != data.len() || !bounds.is_sorted() {
            return Err(malformed("has bounds that leave entries out"));
        }
        let indices: Vec<u32> = indices
            .into_iter()
            .map(|column| u32::try_from(column).ok().filter(|&column| column < columns))
            .collect::<Option<_>>()
            .ok_or_else(|| malformed("has a column that does not exist"))?;
        if bounds
            .windows(2)
            .any(|row| !indices[row[0]..row[1]].is_sorted_by(|a, b| a < b))
        {
            return Err(malformed("has columns out of order"));
        }
        for (row, bounds) in bounds.windows(2).enumerate() {
            let shares = &data[bounds[0]..bounds[1]];
            let sum: f64 = shares.iter().sum();
            if !shares.iter().all(|share| (0.0..=1.0).contains(share)) || sum > 1.0 + ROUNDING {
                return Err(malformed(&format!("has shares in row {row} that are none of a whole")));
            }
        }
        Ok(Self {
            columns,
            data,
            indices,
            bounds,
        })
    }

    /// Number of columns: the ground, and the patches of the sky.
    pub fn columns(&self) -> u32 {
        self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.bounds.len() - 1
    }

    /// All entries.
    pub fn entries(&self) -> u64 {
        self.data.len() as u64
    }

    /// Columns of a row, ascending, and their shares of the hemisphere.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.bounds[row]..self.bounds[row + 1];
        (&self.indices[range.clone()], &self.data[range])
    }
}

/// Findings about the sky rows beside a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SkyCheck {
    /// The ground and the patches of the sky.
    pub columns: u32,
    /// Rows of the matrix.
    pub rows: u64,
    /// Rows that lose exactly as much there as in the matrix.
    pub rows_as_in_matrix: u64,
    /// By how much of the hemisphere the others differ at most.
    pub difference: f64,
}

/// Checks the sky rows beside a matrix: bytes as written; columns that sum, in whole weights, to the escaped weight;
/// and shares equal to those weights, scaled. `escaped` are the escaped shares of the matrix's rows.
///
/// # Errors
/// The first violation, or a file that cannot be read.
pub fn check_sky(path: &Path, escaped: &[f64]) -> Result<SkyCheck> {
    let sky = StoredSky::open(path)?;
    let mut npz = Npz::open(path)?;
    let weights: Vec<u64> = npz.array("weights")?;
    let (sums, blocked): (Vec<u64>, Vec<u64>) = (npz.array("escaped")?, npz.array("blocked")?);
    let hemicubes: Vec<u32> = npz.array("hemicubes")?;
    // Files of before refined shares have none.
    let shares = if npz.has(ESCAPED_SHARE) {
        npz.array(ESCAPED_SHARE)?
    } else {
        let whole = |count: u32| u64::from(count) * HEMICUBE_WEIGHT;
        let of_row = |(&sum, &count): (&u64, &u32)| sum as f64 / whole(count) as f64;
        sums.iter().zip(&hemicubes).map(of_row).collect::<Vec<f64>>()
    };
    let lengths = [sums.len(), blocked.len(), hemicubes.len(), escaped.len(), shares.len()];
    if lengths.iter().any(|&length| length != sky.rows()) || weights.len() != sky.data.len() {
        return Err(Error::malformed(path, "is not of the matrix's patches"));
    }
    let mut found = SkyCheck {
        columns: sky.columns(),
        rows: 0,
        rows_as_in_matrix: 0,
        difference: 0.0,
    };
    for row in 0..sky.rows() {
        let malformed = |reason: String| Error::malformed(path, format!("is wrong in row {row}: {reason}"));
        let range = sky.bounds[row]..sky.bounds[row + 1];
        let whole = u64::from(hemicubes[row]) * HEMICUBE_WEIGHT;
        let sum = weights[range.clone()]
            .iter()
            .try_fold(0u64, |sum, &weight| sum.checked_add(weight));
        if sum != Some(sums[row]) || sums[row].checked_add(blocked[row]).is_none_or(|lost| lost > whole) {
            return Err(malformed(format!(
                "its columns weigh {sum:?}, and {} of {whole} escaped",
                sums[row]
            )));
        }
        // The columns of a refined share are scaled to it.
        let counted = sums[row] as f64 / whole as f64;
        let is_scaled = sums[row] > 0 && shares[row].to_bits() != counted.to_bits();
        let scale = if is_scaled { shares[row] / counted } else { 1.0 };
        if range
            .clone()
            .any(|place| sky.data[place] != share(weights[place], whole) * scale)
        {
            return Err(malformed("a share is not its weight's".to_owned()));
        }
        // Rows not computed, or made without a hemicube, have nothing to differ from.
        if whole > 0 && !escaped[row].is_nan() {
            found.rows += 1;
            let difference = (shares[row] - escaped[row]).abs();
            found.rows_as_in_matrix += u64::from(difference == 0.0);
            found.difference = found.difference.max(difference);
        }
    }
    Ok(found)
}
