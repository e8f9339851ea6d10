//! Sky rows and rows of free points on disk: CSR archives for `scipy.sparse.load_npz`, with more arrays beside, and
//! sealed like a store's parts.

use super::{PointRow, SkyRow};
use crate::solve::Block;
use crate::store::sky::{ESCAPED_SHARE, StoredSky, share};
use crate::store::{DurableFile, ElementType, Error, NpzWriter, Result, write_whole};
use std::io;
use std::path::Path;

/// A CSR matrix of weights as shares of a row's hemicubes, each row times a scale. Weights are whole numbers below 2⁵³,
/// and hemicubes of a tolerance are powers of two: shares are then exact, and so are their sums.
fn write(
    path: &Path,
    columns: u64,
    rows: &mut dyn Iterator<Item = (Vec<(u32, u64)>, u64, f64)>,
    more: impl FnOnce(&mut NpzWriter<DurableFile>) -> io::Result<()>,
) -> Result<()> {
    let (mut data, mut indices, mut weights, mut indptr) = (Vec::new(), Vec::new(), Vec::new(), vec![0i64]);
    for (entries, whole, scale) in rows {
        for (column, weight) in entries {
            data.push(share(weight, whole) * scale);
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
        .and_then(|()| npz.finish_unsealed())
        .and_then(DurableFile::commit_sealed)
        .map_err(on_write)?;
    Ok(())
}

/// Writes sky rows, which [`StoredSky`] reads: `columns` of them, column 0 the ground; beside the matrix `weights`, `escaped`, `blocked`,
/// `hemicubes`, `sky_view_factor`, `change`, `escaped_share` (the sum of the columns); and `suns`, where suns were
/// asked for, one row a row, one column a sun.
///
/// # Errors
/// When the file cannot be written.
///
/// ```
/// use hemicube::backend::WHOLE;
/// use hemicube::sky::{SkyRow, StoredSky, read_sky_view_factors, sky_product, write_sky};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("sky.npz");
///
/// // A row that loses a quarter to the ground, column 0, and an eighth to a patch of the sky.
/// let (quarter, eighth) = (u64::from(WHOLE) / 4, u64::from(WHOLE) / 8);
/// let columns = vec![(0, quarter), (7, eighth)];
/// let row = SkyRow { columns, escaped: quarter + eighth, hemicubes: 1, change: f64::NAN, ..SkyRow::default() };
/// write_sky(&path, 146, &[row], None)?;
///
/// let sky = StoredSky::open(&path)?;
/// assert_eq!(sky.row(0), (&[0, 7][..], &[0.25, 0.125][..]));
/// assert_eq!(read_sky_view_factors(&path)?, [0.125], "the ground is no sky");
///
/// // Under a sky that is twice as bright as the ground:
/// let radiance = (0..146).map(|column| if column == 0 { 1.0 } else { 2.0 }).collect();
/// assert_eq!(sky_product(&path, &[radiance])?.of(0), [0.5]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_sky(path: &Path, columns: u32, rows: &[SkyRow], suns: Option<(usize, &[f32])>) -> Result<()> {
    let mut entries = rows.iter().map(|row| (row.columns.clone(), row.whole(), row.scale()));
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
        let shares: Vec<f64> = rows.iter().map(SkyRow::escaped_share).collect();
        npz.array(ESCAPED_SHARE, &count, &shares)?;
        match suns {
            Some((suns, visible)) => npz.array("suns", &[rows.len() as u64, suns as u64], visible),
            None => Ok(()),
        }
    })
}

/// Writes the sunlight of patches, a row each with a number a sun, as `.npy`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_sunlight(path: &Path, shape: [usize; 2], light: &[f32]) -> Result<()> {
    let mut bytes = ElementType::F32.npy_header(&shape.map(|length| length as u64));
    bytes.extend(light.iter().flat_map(|light| light.to_le_bytes()));
    write_whole(path, &bytes, "")
}

/// Writes the rows of free points over `patch_count` patches.
///
/// # Errors
/// When the file cannot be written.
pub fn write_points(path: &Path, patch_count: u32, rows: &[PointRow]) -> Result<()> {
    let mut entries = rows.iter().map(|row| {
        let patches = row.patches.iter().map(|(patch, weight)| (patch.0, *weight)).collect();
        (patches, row.sky.whole(), 1.0)
    });
    write(path, patch_count.into(), &mut entries, |_| Ok(()))
}

/// Σⱼ wᵢⱼ xⱼ of every row of a file of [`write_sky`], for several vectors of one number a column.
///
/// # Errors
/// When the file cannot be read or damaged, or a vector is not of its columns.
pub fn sky_product(path: &Path, vectors: &[Vec<f64>]) -> Result<Block> {
    product_of_sky(path, &StoredSky::open(path)?, vectors)
}

/// [`sky_product`] of a file that is open; `path` is its, for errors.
///
/// # Errors
/// When a vector is not of its columns.
pub fn product_of_sky(path: &Path, sky: &StoredSky, vectors: &[Vec<f64>]) -> Result<Block> {
    if vectors.iter().any(|vector| vector.len() != sky.columns() as usize) {
        return Err(Error::unsupported(
            path,
            format!(
                "has {} columns, the ground and the patches of the sky; the radiances are of another number",
                sky.columns()
            ),
        ));
    }
    // The numbers of a column side by side: each entry then meets all of them at once.
    let x = Block::from_fn(sky.columns() as usize, vectors.len(), |column, vector| {
        vectors[vector][column]
    });
    let mut product = Block::zeros(sky.rows(), vectors.len());
    for row in 0..sky.rows() {
        let out = product.of_mut(row);
        let (columns, shares) = sky.row(row);
        for (&column, share) in columns.iter().zip(shares) {
            for (sum, value) in out.iter_mut().zip(x.of(column as usize)) {
                *sum += share * value;
            }
        }
    }
    Ok(product)
}
