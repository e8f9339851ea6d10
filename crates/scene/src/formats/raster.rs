//! Reads height models: GeoTIFF and ESRI ASCII grids of the height of each cell's surface.
//!
//! Sources: *OGC GeoTIFF Standard 1.1* (19-008r4), tags 33550, 33922, 34264, 34735; GDAL's tag 42113 for what has no
//! value; Esri's description of ASCII grids. TIFF itself by the `tiff` crate.
//!
//! # What becomes of what
//! - a cell: a level square at its height, north up, z up; between neighbours of other heights a vertical wall that
//!   faces the lower one. At the border, and beside a cell without a value, no wall stands: nothing is known of it
//! - cells of one height: as few rectangles as a sweep from the north-west finds. Where neighbours' corners lie on
//!   their sides they have corners, too: every edge is that of both faces beside it, watertight
//! - objects and materials: `surface` and `wall`; with a second band of a TIFF, the height of the ground, `ground`,
//!   `roof` and `wall`. A roof is `ROOF` above the ground or more
//! - with a third band of reals, the height of the canopy above the ground: `canopy`, the two-sided outside of crowns
//!   from `TRUNK` of that height up. Crowns beside each other are one where both are; what a roof covers is none
//! - values without a number, and the file's own value for none: no surface
//! - the coordinate reference system: its EPSG code; one in degrees is refused
//!
//! Terrain becomes terraces, a step a cell, as in programs that cast shadows over rasters: a facet sees neither the
//! terrace that it stands on nor its slope.

mod ascii;
mod faces;
mod geotiff;

use crate::{Axis, Error, ErrorKind, Fate, Kind, Ledger, Material, ReadOptions, Scene, Triangle};
use glam::DVec3;
use std::path::Path;

/// Most cells, as of a grid of points: 2,000 × 2,000.
const CELLS_MAX: u64 = 4_000_000;
/// Height above the ground, in the unit of heights, from which on a surface is a roof: as UMEP's SOLWEIG has it
/// (Lindberg, Holmer & Thorsson 2008; 2 m). Lower, hedges become roofs; higher, sheds become ground.
const ROOF: f64 = 2.0;

/// Where a crown begins, of its height above the ground: the trunk zone of UMEP's SOLWEIG (Lindberg & Grimmond 2011; 25
/// %). Lower, light below trees is missed from the side; higher, shade.
const TRUNK: f64 = 0.25;

/// Returns whether a file of a folder is a height model: an ASCII grid, a TIFF of up to three bands of reals, or of one
/// or two of more than eight bits that says where its cells lie. Others are textures, photographs and maps of classes.
pub(crate) fn is_height_model(path: &Path) -> bool {
    let is_grid = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("asc"));
    is_grid || geotiff::has_heights(path).unwrap_or(false)
}

/// A raster of heights: row by row from the north, each from the west.
struct Raster {
    columns: usize,
    rows: usize,
    /// The upper left corner.
    west: f64,
    north: f64,
    /// Width and height of a cell.
    cell: [f64; 2],
    /// NaN where there is no surface.
    heights: Vec<f64>,
    /// Likewise of the ground.
    ground: Option<Vec<f64>>,
    /// The canopy above the ground; there is none where it is not above 0.
    canopy: Option<Vec<f64>>,
    crs: Option<String>,
}

impl Raster {
    /// Returns whether a cell has no surface, or none of its ground is known.
    fn is_bare(&self, cell: usize) -> bool {
        self.heights[cell].is_nan() || self.ground.as_ref().is_some_and(|ground| ground[cell].is_nan())
    }
}

/// Reads a height model from the bytes of a file.
///
/// # Errors
/// When it is neither a GeoTIFF of heights nor an ASCII grid, has more than four million cells, no place, turned cells,
/// degrees, or an infinite height, or takes more memory than is left. The error names the line of a text.
///
/// ```
/// use hemicube_scene::{Axis, ReadOptions, raster};
///
/// // A block, two cells long and 3 high, on a yard of 4 × 3 cells of 2 m.
/// let text = b"ncols 4\nnrows 3\nxllcorner 100\nyllcorner 0\ncellsize 2\n0 0 0 0\n0 3 3 0\n0 0 0 0\n";
/// let scene = raster::read(text, None, ReadOptions::default())?;
/// assert_eq!((&scene.objects[..], scene.up), (&["surface".to_owned(), "wall".to_owned()][..], Some(Axis::Z)));
/// let walls = scene.triangles.iter().filter(|triangle| triangle.object == 1);
/// assert_eq!(walls.count(), 4 * 2);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], _base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let is_tiff = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| bytes.starts_with(*magic));
    let raster = if is_tiff {
        geotiff::read(bytes, options)?
    } else {
        ascii::read(bytes, options)?
    };
    let corners = [
        raster.west,
        raster.north,
        raster.west + raster.cell[0] * raster.columns as f64,
        raster.north - raster.cell[1] * raster.rows as f64,
    ];
    if !corners.iter().all(|corner| corner.is_finite()) || !raster.cell.iter().all(|edge| *edge > 0.0) {
        return Err(Error::malformed("has no cells of a finite size at a finite place"));
    }
    let bands = [Some(&raster.heights), raster.ground.as_ref(), raster.canopy.as_ref()];
    if bands.into_iter().flatten().flatten().any(|height| height.is_infinite()) {
        return Err(Error::malformed("has an infinite height"));
    }
    scene(raster, options)
}

/// Columns and rows of a raster, before room is taken for them.
fn cells_of(columns: u64, rows: u64, options: ReadOptions) -> Result<[usize; 2], Error> {
    let cells = columns.saturating_mul(rows);
    if cells == 0 {
        return Err(Error::malformed("has no cells"));
    }
    if cells > CELLS_MAX {
        return Err(Error::new(ErrorKind::TooLarge(format!(
            "has {columns} × {rows} cells; {CELLS_MAX} are read at most: cut it (gdal_translate -projwin), or coarsen it \
             (gdalwarp -tr)"
        ))));
    }
    // Values as they are decoded, heights, ground, the rectangle of each, and rectangles.
    options
        .budget
        .require(cells * 64, format!("a height model of {cells} cells"))?;
    // Four million at most.
    Ok([columns, rows].map(|count| usize::try_from(count).unwrap_or(0)))
}

/// The faces of a raster as triangles.
fn scene(raster: Raster, options: ReadOptions) -> Result<Scene, Error> {
    let plan = faces::Plan::new(&raster);
    let mut count = 0u64;
    plan.each(&raster, &mut |corners: &[DVec3], _| {
        count += triangles_of(corners.len()) as u64
    });
    options.budget.require(
        count * size_of::<Triangle>() as u64,
        format!("a height model of {count} triangles"),
    )?;
    let mut triangles = Vec::with_capacity(usize::try_from(count).unwrap_or(0));
    let names: &[&str] = match raster.ground {
        Some(_) if raster.canopy.is_some() => &["ground", "roof", "wall", "canopy"],
        Some(_) => &["ground", "roof", "wall"],
        None => &["surface", "wall"],
    };
    let mut face = 0u32;
    plan.each(&raster, &mut |corners: &[DVec3], kind| {
        let object = match kind {
            faces::Kind::Low => 0,
            faces::Kind::High => 1,
            faces::Kind::Wall if raster.ground.is_some() => 2,
            faces::Kind::Wall => 1,
            faces::Kind::Crown => 3,
        };
        let mut push = |corners: [DVec3; 3]| {
            triangles.push(Triangle {
                corners,
                object,
                material: object,
                face,
                two_sided: kind == faces::Kind::Crown,
            });
        };
        match *corners {
            [a, b, c, d] => {
                push([a, b, c]);
                push([a, c, d]);
            }
            // A fan about the middle of the rectangle: corners on a side may lie on one line.
            _ => {
                let [low, high] = corners.iter().fold([corners[0]; 2], |[low, high], &corner| {
                    [low.min(corner), high.max(corner)]
                });
                let middle = (low + high) * 0.5;
                for (at, &corner) in corners.iter().enumerate() {
                    push([middle, corner, corners[(at + 1) % corners.len()]]);
                }
            }
        }
        face += 1;
    });
    let mut ledger = Ledger::default();
    let without =
        |cell: &usize| raster.canopy.as_ref().is_some_and(|canopy| canopy[*cell] > 0.0) && raster.is_bare(*cell);
    let trees: Vec<usize> = (0..raster.heights.len()).filter(without).collect();
    if let Some(first) = trees.first() {
        let kind = Kind {
            fate: Fate::LeftOut,
            what: "cell of canopy without the height of the surface or the ground",
            next: "fill those bands",
        };
        let area = raster.cell[0] * raster.cell[1] * trees.len() as f64;
        let place = || {
            format!(
                "column {}, row {}",
                first % raster.columns + 1,
                first / raster.columns + 1
            )
        };
        ledger.lose(kind, trees.len() as u64, Some(area), place);
    }
    Ok(Scene {
        ledger,
        triangles,
        objects: names.iter().map(|&name| name.to_owned()).collect(),
        materials: names
            .iter()
            .map(|&name| Material {
                name: name.to_owned(),
                ..Material::default()
            })
            .collect(),
        crs: raster.crs,
        is_oriented: true,
        up: Some(Axis::Z),
        ..Scene::default()
    })
}

/// Triangles of a face with so many corners.
fn triangles_of(corners: usize) -> usize {
    if corners == 4 { 2 } else { corners }
}

#[cfg(test)]
mod tests;
