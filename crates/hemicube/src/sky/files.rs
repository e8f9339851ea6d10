//! Sky rows and rows of free points on disk: CSR archives that `scipy.sparse.load_npz` opens, with more arrays beside.

use super::{PointRow, SkyRow};
use crate::store::{DurableFile, Error, NpzWriter, Result};
use std::io;
use std::path::Path;

/// A CSR matrix of weights as shares of a row's hemicubes. Weights are whole numbers below 2⁵³, and hemicubes powers of
/// two wherever they come from a tolerance: shares are then exact, and so are their sums.
fn write(
    path: &Path,
    columns: u64,
    rows: &mut dyn Iterator<Item = (Vec<(u32, u64)>, u64)>,
    more: impl FnOnce(&mut NpzWriter<DurableFile>) -> io::Result<()>,
) -> Result<()> {
    let (mut data, mut indices, mut weights, mut indptr) = (Vec::new(), Vec::new(), Vec::new(), vec![0i64]);
    for (entries, whole) in rows {
        for (column, weight) in entries {
            data.push(if whole > 0 { weight as f64 / whole as f64 } else { 0.0 });
            indices.push(column.cast_signed());
            weights.push(weight);
        }
        indptr.push(i64::try_from(data.len()).unwrap_or(i64::MAX));
    }
    let wanted = 20 * data.len() as u64 + 8 * indptr.len() as u64 + 4096;
    let on_write = |error| Error::write(path, wanted, error);
    let count = [data.len() as u64];
    let mut npz = NpzWriter::new(DurableFile::create(path)?);
    npz.csr_preamble(indptr.len() as u64 - 1, columns)
        .and_then(|()| npz.array("data", &count, &data))
        .and_then(|()| npz.array("indices", &count, &indices))
        .and_then(|()| npz.array("indptr", &[indptr.len() as u64], &indptr))
        .and_then(|()| npz.array("weights", &count, &weights))
        .and_then(|()| more(&mut npz))
        .and_then(|()| npz.finish())
        .and_then(DurableFile::commit)
        .map_err(on_write)
}

/// Writes sky rows: `columns` of them, column 0 the ground; beside the matrix `weights`, `escaped`, `blocked`, `hemicubes`,
/// `sky_view_factor`, `change`; and where suns were asked for `suns`, one row a row, one column a sun.
///
/// # Errors
/// When the file cannot be written.
pub fn write_sky(path: &Path, columns: u32, rows: &[SkyRow], suns: Option<(usize, &[f32])>) -> Result<()> {
    let mut entries = rows.iter().map(|row| (row.columns.clone(), row.whole()));
    write(path, columns.into(), &mut entries, |npz| {
        let count = [rows.len() as u64];
        npz.array(
            "escaped",
            &count,
            &rows.iter().map(|row| row.escaped).collect::<Vec<_>>(),
        )?;
        npz.array(
            "blocked",
            &count,
            &rows.iter().map(|row| row.blocked).collect::<Vec<_>>(),
        )?;
        npz.array(
            "hemicubes",
            &count,
            &rows.iter().map(|row| row.hemicubes).collect::<Vec<_>>(),
        )?;
        let factors: Vec<f64> = rows.iter().map(SkyRow::sky_view_factor).collect();
        npz.array("sky_view_factor", &count, &factors)?;
        npz.array("change", &count, &rows.iter().map(|row| row.change).collect::<Vec<_>>())?;
        match suns {
            Some((suns, visible)) => npz.array("suns", &[rows.len() as u64, suns as u64], visible),
            None => Ok(()),
        }
    })
}

/// Writes the rows of free points over `patch_count` patches.
///
/// # Errors
/// When the file cannot be written.
pub fn write_points(path: &Path, patch_count: u32, rows: &[PointRow]) -> Result<()> {
    let mut entries = rows.iter().map(|row| {
        let patches = row.patches.iter().map(|(patch, weight)| (patch.0, *weight)).collect();
        (patches, row.sky.whole())
    });
    write(path, patch_count.into(), &mut entries, |_| Ok(()))
}

/// The sky view factor of each row of a file that [`write_sky`] wrote.
///
/// # Errors
/// When it cannot be read, or is no such file.
pub fn read_sky_view_factors(path: &Path) -> Result<Vec<f64>> {
    crate::store::Npz::open(path)?.array("sky_view_factor")
}

/// Σⱼ wᵢⱼ xⱼ of every row of a file that [`write_sky`] wrote, for several vectors of one number a column.
///
/// # Errors
/// When the file cannot be read or damaged, or a vector is not of its columns.
pub fn sky_product(path: &Path, vectors: &[Vec<f64>]) -> Result<crate::solve::Block> {
    let mut npz = crate::store::Npz::open(path)?;
    let shape: Vec<i64> = npz.array("shape")?;
    let (data, indices): (Vec<f64>, Vec<i32>) = (npz.array("data")?, npz.array("indices")?);
    let indptr: Vec<i64> = npz.array("indptr")?;
    let malformed = |reason: &str| Error::malformed(path, reason);
    let (rows, columns) = match shape[..] {
        [rows, columns] => (
            usize::try_from(rows).map_err(|_| malformed("has a negative shape"))?,
            usize::try_from(columns).map_err(|_| malformed("has a negative shape"))?,
        ),
        _ => return Err(malformed("is no matrix")),
    };
    if vectors.iter().any(|vector| vector.len() != columns) {
        return Err(Error::unsupported(
            path,
            format!(
                "has {columns} columns, the ground and the patches of the sky; the radiances are of another number"
            ),
        ));
    }
    if indptr.len() != rows + 1 || data.len() != indices.len() {
        return Err(malformed("has arrays that do not fit together"));
    }
    let mut product = crate::solve::Block::zeros(rows, vectors.len());
    for row in 0..rows {
        let (begin, end) = (usize::try_from(indptr[row]), usize::try_from(indptr[row + 1]));
        let (Ok(begin), Ok(end)) = (begin, end) else {
            return Err(malformed("has a negative bound"));
        };
        let (Some(data), Some(indices)) = (data.get(begin..end), indices.get(begin..end)) else {
            return Err(malformed("has bounds beyond its entries"));
        };
        let out = product.of_mut(row);
        for (value, &column) in data.iter().zip(indices) {
            let column = usize::try_from(column).ok().filter(|&column| column < columns);
            let column = column.ok_or_else(|| malformed("has a column that does not exist"))?;
            for (sum, vector) in out.iter_mut().zip(vectors) {
                *sum += value * vector[column];
            }
        }
    }
    Ok(product)
}
