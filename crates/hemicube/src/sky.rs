//! The sky as a receiver: the escaped weight of a hemicube, divided over patches of the sky, and one *ground* column
//! for directions below the horizon.
//!
//! The division is Reinhart's (Reinhart & Walkenhorst 2001), with Tregenza's 145 patches (Tregenza 1987) as its first:
//! seven rings of 30, 30, 24, 24, 18, 12, 6 patches and a cap, each ring cut into n and each patch of it into n. The
//! height of a ring is 90° / (7 n + ½). Order and orientation are those of Radiance's `gendaymtx` and `rfluxmtx`:
//! column 0 is the ground, column 1 the patch of the lowest ring with its middle due north, and on clockwise (north,
//! east, south, west), ring by ring upwards. Their sky matrices can be multiplied with sky rows.
//!
//! An escaped pixel goes, with all of its weight, to the patch of the sky at its centre. The columns of a row therefore
//! sum to its escaped weight exactly, in whole weights. Comparisons are made on squares and on the diamond angle,
//! without trigonometry.
//!
//! No sky columns in the parts, because the sky is divided after the matrix is computed, by directions that may change:
//! parts would have to be written anew. An export with the sky reads both.

mod bins;
mod files;
mod grouped;
mod shadow;
mod sun;
mod through;

pub use crate::store::sky::{
    SkyCheck, StoredSky, check_sky, read_sky_view_factors, sky_beside, sky_view_factors_beside,
};
pub use files::{product_of_sky, sky_product, write_points, write_sky, write_sunlight};
pub use grouped::{hemicubes_along, sky_of_groups};
pub use sun::{SUN_ERROR, sunlit};
pub use through::{Glazed, sky_through_portals, sunlight};

use crate::Model;
use crate::backend::{BackendError, Hemicube, HemicubeBackend, RenderSettings, WHOLE};
use crate::delta::DeltaTable;
use crate::driver::compute::ComputeError;
use crate::frame;
pub use crate::frame::Horizon;
use crate::points::{in_parallel, threads_of};
use bins::Bins;
use glam::DVec3;
use hemicube_scene::InputPatch;

/// Patches of Tregenza's rings, from the horizon up.
const TREGENZA: [u32; 7] = [30, 30, 24, 24, 18, 12, 6];
/// Most pieces of a patch along each edge.
pub const PARTS_MAX: u32 = 16;
/// Levels of refinement: 1, 4, 16 and 64 hemicubes a row.
pub const LEVELS: u32 = 4;
/// Relative to the sky view factor, no error below this share of the hemisphere is worth a hemicube.
const NEGLIGIBLE: f64 = 1e-5;

/// A ring of the sky, or the cap.
#[derive(Clone, Debug)]
struct Ring {
    /// The column of its first patch.
    first: u32,
    /// Altitudes of its lower and upper edge, radians.
    altitude: [f64; 2],
    /// Diamond angles, from north clockwise, of the ends of its patches but the first, which lies on both sides of
    /// north.
    ends: Vec<f64>,
    /// Sine and cosine of the azimuths of `ends`.
    bearings: Vec<[f64; 2]>,
}

impl Ring {
    /// The patch of the ring in whose azimuths a direction lies, from 0.
    fn place(&self, direction: DVec3) -> u32 {
        let angle = diamond(direction.x, direction.y);
        let place = self.ends.partition_point(|&end| end <= angle);
        // Beyond the last end lies the western half of the first patch.
        if place == self.ends.len() {
            0
        } else {
            u32::try_from(place).unwrap_or(0)
        }
    }

    fn count(&self) -> u32 {
        u32::try_from(self.ends.len()).unwrap_or(u32::MAX)
    }
}

/// The diamond angle from north clockwise, growing from 0 to 4: 0 north, 1 east, 2 south, 3 west.
fn diamond(east: f64, north: f64) -> f64 {
    let size = east.abs() + north.abs();
    if size == 0.0 {
        return 0.0;
    }
    let share = east / size;
    if north < 0.0 {
        2.0 - share
    } else if east < 0.0 {
        4.0 + share
    } else {
        share
    }
}

/// A division of the sky.
///
/// ```
/// use hemicube::sky::SkyDivision;
/// use hemicube_spatial::glam::DVec3;
///
/// // Tregenza's 145 patches after the ground; parts are along east, north and up.
/// let sky = SkyDivision::new(1).ok_or("out of range")?;
/// assert_eq!((sky.columns(), sky.column(DVec3::new(3.0, 4.0, -0.1)), sky.column(DVec3::Z)), (146, 0, 145));
/// assert_eq!(sky.column(sky.middle(17)), 17);
///
/// // A level plane that looks up sees all of it, and the cap better than what is near the horizon.
/// let share = |column| sky.share_of_a_level_plane(column);
/// assert!(((1..146).map(share).sum::<f64>() - 1.0).abs() < 1e-12);
/// assert!((1..145).all(|column| share(column) / sky.solid_angle(column) < share(145) / sky.solid_angle(145)));
/// # Ok::<(), &str>(())
/// ```
#[derive(Clone, Debug)]
pub struct SkyDivision {
    parts: u32,
    rings: Vec<Ring>,
    /// Squares of the sines of the rings' lower altitudes, without the first.
    squares: Vec<f64>,
    /// For each ring the square of the tangent of the altitude at which it begins.
    tangents: Vec<f64>,
}

impl SkyDivision {
    /// Reinhart's division, with each of Tregenza's patches cut into `parts`² (from 1, Tregenza's own, to
    /// [`PARTS_MAX`]): 144 `parts`² + 1 patches. `None` out of that range.
    pub fn new(parts: u32) -> Option<Self> {
        if !(1..=PARTS_MAX).contains(&parts) {
            return None;
        }
        let height = std::f64::consts::FRAC_PI_2 / (7.0 * f64::from(parts) + 0.5);
        let mut rings = Vec::new();
        let mut first = 1;
        for row in 0..7 * parts {
            let count = TREGENZA[(row / parts) as usize] * parts;
            let bearings: Vec<[f64; 2]> = (0..count)
                .map(|k| {
                    (std::f64::consts::TAU * (f64::from(k) + 0.5) / f64::from(count))
                        .sin_cos()
                        .into()
                })
                .collect();
            let ends = bearings.iter().map(|&[sine, cosine]| diamond(sine, cosine)).collect();
            rings.push(Ring {
                first,
                altitude: [height * f64::from(row), height * f64::from(row + 1)],
                ends,
                bearings,
            });
            first += count;
        }
        rings.push(Ring {
            first,
            altitude: [height * f64::from(7 * parts), std::f64::consts::FRAC_PI_2],
            ends: vec![4.0],
            bearings: Vec::new(),
        });
        let squares = rings[1..].iter().map(|ring| ring.altitude[0].sin().powi(2)).collect();
        let tangents = rings.iter().map(|ring| ring.altitude[0].tan().powi(2)).collect();
        Some(Self {
            parts,
            rings,
            squares,
            tangents,
        })
    }

    /// Into how many a patch of Tregenza's is cut along each edge.
    pub fn parts(&self) -> u32 {
        self.parts
    }

    /// Number of columns: the ground and the patches of the sky.
    pub fn columns(&self) -> u32 {
        self.rings.last().map_or(1, |cap| cap.first + 1)
    }

    /// The column of a direction, given by its parts along east, north and up; of any length.
    #[inline]
    pub fn column(&self, direction: DVec3) -> u32 {
        self.locate(direction)
            .map_or(0, |(ring, patch)| self.rings[ring].first + patch)
    }

    /// The ring of a direction, and its patch in the ring; `None` below the horizon.
    #[inline]
    fn locate(&self, direction: DVec3) -> Option<(usize, u32)> {
        if direction.z < 0.0 {
            return None;
        }
        let square = direction.z * direction.z / direction.length_squared();
        let ring = self.squares.partition_point(|&begin| begin <= square);
        Some((ring, self.rings[ring].place(direction)))
    }

    fn ring(&self, column: u32) -> Option<&Ring> {
        self.rings
            .iter()
            .find(|ring| (ring.first..ring.first + ring.count()).contains(&column))
    }

    /// The middle of a patch of the sky, by its parts along east, north and up; straight down for the ground.
    pub fn middle(&self, column: u32) -> DVec3 {
        let Some(ring) = self.ring(column) else {
            return DVec3::NEG_Z;
        };
        if ring.count() == 1 {
            return DVec3::Z;
        }
        let altitude = 0.5 * (ring.altitude[0] + ring.altitude[1]);
        let azimuth = std::f64::consts::TAU * f64::from(column - ring.first) / f64::from(ring.count());
        DVec3::new(
            altitude.cos() * azimuth.sin(),
            altitude.cos() * azimuth.cos(),
            altitude.sin(),
        )
    }

    /// The solid angle of a column in steradians; the lower half of all directions for the ground.
    pub fn solid_angle(&self, column: u32) -> f64 {
        match self.ring(column) {
            None => std::f64::consts::TAU,
            Some(ring) => {
                let [begin, end] = ring.altitude;
                std::f64::consts::TAU * (end.sin() - begin.sin()) / f64::from(ring.count())
            }
        }
    }

    /// The view factor of a level, free plane looking up to a column: ∫ cos θ dΩ / π. They sum to 1.
    pub fn share_of_a_level_plane(&self, column: u32) -> f64 {
        match self.ring(column) {
            None => 0.0,
            Some(ring) => {
                let [begin, end] = ring.altitude;
                (end.sin().powi(2) - begin.sin().powi(2)) / f64::from(ring.count())
            }
        }
    }
}

/// A row's weights to the sky and the ground.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkyRow {
    /// Columns with a weight, ascending, and their weights.
    pub columns: Vec<(u32, u64)>,
    /// The weight of all of them.
    pub escaped: u64,
    /// Weight on backs of one-sided patches.
    pub blocked: u64,
    /// Number of hemicubes, 2³¹ each.
    pub hemicubes: u32,
    /// Change of the sky view factor by the last refinement, no bound on its error; NaN without one.
    pub change: f64,
    /// Change of the ground's share, or of the backs', by the last refinement, the larger; NaN without one.
    pub change_below: f64,
    /// The escaped share, where it is known better than from the hemicubes, as beside a matrix: the columns' shares are
    /// then scaled to it.
    pub refined: Option<f64>,
}

impl SkyRow {
    /// The weight of all hemicubes.
    pub fn whole(&self) -> u64 {
        u64::from(self.hemicubes) * u64::from(WHOLE)
    }

    /// Sum of the columns' shares.
    pub fn escaped_share(&self) -> f64 {
        self.refined.unwrap_or_else(|| self.share(self.escaped))
    }

    /// Factor from a column's weight over that of all hemicubes to its share.
    pub fn scale(&self) -> f64 {
        match self.refined {
            Some(refined) if self.escaped > 0 => refined / self.share(self.escaped),
            _ => 1.0,
        }
    }

    fn share(&self, weight: u64) -> f64 {
        weight as f64 / self.whole() as f64
    }

    /// Takes the escaped share of a matrix's row. Returns whether the columns can be scaled to it.
    pub fn refine(&mut self, escaped: f64) -> bool {
        let can = self.hemicubes > 0 && (0.0..=1.0).contains(&escaped) && (self.escaped > 0 || escaped == 0.0);
        self.refined = can.then_some(escaped);
        can
    }

    /// The sky view factor: the share of the hemisphere, weighted by the cosine, that is sky. Escaped weight below the
    /// horizon is ground.
    pub fn sky_view_factor(&self) -> f64 {
        if self.hemicubes == 0 {
            return f64::NAN;
        }
        self.share(self.escaped - self.ground()) * self.scale()
    }

    /// The weight to the ground.
    fn ground(&self) -> u64 {
        let first = self.columns.first().filter(|(column, _)| *column == 0);
        first.map_or(0, |(_, weight)| *weight)
    }

    /// Shares of sky, ground and backs.
    fn shares(&self) -> [f64; 3] {
        let ground = self.share(self.ground()) * self.scale();
        [self.sky_view_factor(), ground, self.share(self.blocked)]
    }

    /// Notes by how much the row differs from the one `before` it was refined.
    fn compare(&mut self, before: [f64; 3]) {
        let now = self.shares();
        let [sky, ground, backs] = [0, 1, 2].map(|at| (now[at] - before[at]).abs());
        (self.change, self.change_below) = (sky, ground.max(backs));
    }

    /// Returns whether the last refinement changed the sky view factor by at most this share of it, and ground and
    /// backs by at most this share of the view. Never before a refinement.
    pub fn is_settled(&self, tolerance: f64) -> bool {
        self.change <= (tolerance * self.sky_view_factor()).max(NEGLIGIBLE) && self.change_below <= tolerance
    }
}

/// Weights of a free point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointRow {
    /// Visible patches, ascending, and their weights.
    pub patches: Vec<(InputPatch, u64)>,
    /// The escaped weight.
    pub sky: SkyRow,
}

/// A free point with a direction, in the scene's coordinates: a measurement, a person, a point of a façade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPoint {
    /// Its place.
    pub position: DVec3,
    /// Its direction.
    pub normal: DVec3,
}

/// Fineness of sky rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyOptions {
    /// Settings of hemicubes; for free points, those of the first level.
    pub render: RenderSettings,
    /// n of the n² hemicubes of a patch, without a tolerance.
    pub samples_per_edge: u32,
    /// Refine rows until their sky view factor changes by at most this share, and ground and backs by at most this
    /// share of the view ([`SkyRow::is_settled`]): patches by four times as many hemicubes, up to 64, points by
    /// hemicubes of twice the resolution and another turn.
    pub tolerance: Option<f64>,
    /// True if each hemicube is turned about its normal.
    pub rotate: bool,
    /// Threads; 0: one a core.
    pub threads: usize,
}

fn failed(backend: &dyn HemicubeBackend, source: BackendError) -> ComputeError {
    ComputeError::Backend {
        backend: backend.info().name.clone(),
        source,
    }
}

/// The row of a patch.
fn patch_row(
    model: &Model,
    patch: InputPatch,
    samples_per_edge: u32,
    options: SkyOptions,
    backend: &mut dyn HemicubeBackend,
    table: &DeltaTable,
    bins: &mut Bins<'_>,
) -> Result<SkyRow, ComputeError> {
    let mut render = |n: u32| {
        let hemicubes = model.hemicubes(patch, n, options.rotate);
        let mut blocked = 0;
        for hemicube in &hemicubes {
            blocked += bins
                .render(backend, table, hemicube)
                .map_err(|error| failed(backend, error))?;
        }
        Ok(bins.take(blocked, u32::try_from(hemicubes.len()).unwrap_or(u32::MAX)))
    };
    let Some(tolerance) = options.tolerance else {
        return render(samples_per_edge);
    };
    let mut row = render(1)?;
    for level in 1..LEVELS {
        let before = row.shares();
        row = render(1 << level)?;
        row.compare(before);
        if row.is_settled(tolerance) || row.hemicubes == 0 {
            break;
        }
    }
    Ok(row)
}

/// The row of a free point: `sessions` are of the resolutions of the levels.
fn point_row(
    model: &Model,
    index: usize,
    point: SensorPoint,
    options: SkyOptions,
    sessions: &mut [(Box<dyn HemicubeBackend>, DeltaTable)],
    bins: &mut Bins<'_>,
) -> Result<PointRow, ComputeError> {
    let mut row = PointRow::default();
    let mut before = [f64::NAN; 3];
    for (level, (backend, table)) in sessions.iter_mut().enumerate() {
        // Another turn for each level: other pixels then meet the edges.
        let turn = frame::turn(InputPatch(
            u32::try_from(index).unwrap_or(0).wrapping_mul(LEVELS) + u32::try_from(level).unwrap_or(0),
        ));
        let Some(axes) = frame::axes_of(point.normal, if options.rotate { turn } else { 0.0 }) else {
            return Ok(PointRow::default());
        };
        let hemicube = Hemicube {
            emitter: None,
            origin: model.normalise(point.position),
            axes,
        };
        let items = backend
            .items(&hemicube)
            .map_err(|error| failed(backend.as_ref(), error))?;
        let mut seen = std::collections::BTreeMap::new();
        let blocked = bins.add_items(&items, table, &hemicube.axes, |patch, weight| {
            *seen.entry(InputPatch(patch)).or_insert(0) += u64::from(weight);
        });
        let sky = bins.take(blocked, 1);
        row = PointRow {
            patches: seen.into_iter().collect(),
            sky,
        };
        row.sky.compare(before);
        if options.tolerance.is_some_and(|tolerance| row.sky.is_settled(tolerance)) {
            break;
        }
        before = row.sky.shares();
    }
    Ok(row)
}

/// Sky rows of patches, in the order asked for; with each patch, n of its n² hemicubes for runs without a tolerance.
/// `progress` is called with the number of rows done and returns whether to go on; `None` when it returned false.
///
/// # Errors
/// When the backend hands out no item buffers, or fails.
///
/// ```
/// use hemicube::InputPatch;
/// use hemicube::sky::{Horizon, SkyDivision, SkyOptions, sky_of_patches};
/// use hemicube_backend_cpu::CpuBackend;
/// use hemicube_scene::Axis;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model_of(&room::squares())?;
///
/// // A floor with a roof above it: patches 0 to 7 are the floor, the others the roof's underside.
/// let options = SkyOptions { render: room::RENDER, samples_per_edge: 2, tolerance: None, rotate: true, threads: 0 };
/// let (sky, horizon) = (SkyDivision::new(1).ok_or("out of range")?, Horizon::new(Axis::Z, 0.0));
/// let rows = [(InputPatch(0), 2), (InputPatch(8), 2)];
/// let seen = sky_of_patches(&model, &rows, &sky, horizon, options, Box::new(CpuBackend::new()), &mut |_| true)?;
/// let [floor, roof] = &seen.ok_or("told to stop")?[..] else { unreachable!("a row for each") };
/// assert!(floor.sky_view_factor() > 0.5 && floor.sky_view_factor() < 1.0);
/// assert_eq!(roof.sky_view_factor(), 0.0, "what escapes downwards is the ground's");
/// assert!(roof.columns.iter().all(|&(column, _weight)| column == 0) && roof.escaped > 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn sky_of_patches(
    model: &Model,
    rows: &[(InputPatch, u32)],
    division: &SkyDivision,
    horizon: Horizon,
    options: SkyOptions,
    mut backend: Box<dyn HemicubeBackend>,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Vec<SkyRow>>, ComputeError> {
    backend
        .load(model.geometry(), options.render)
        .map_err(|error| failed(backend.as_ref(), error))?;
    let mut states = Vec::new();
    for _ in 1..threads_of(options.threads).clamp(1, rows.len().max(1)) {
        let session = backend.fork().map_err(|error| failed(backend.as_ref(), error))?;
        states.push((session, Bins::new(division, horizon)));
    }
    states.push((backend, Bins::new(division, horizon)));
    let table = DeltaTable::new(options.render.resolution);
    in_parallel(
        rows.len(),
        states,
        |(backend, bins), index| {
            let (patch, samples) = rows[index];
            patch_row(model, patch, samples, options, backend.as_mut(), &table, bins)
        },
        progress,
    )
}

/// Sky rows of free points. Otherwise as [`sky_of_patches`]. `sessions` are of one backend, a level each: the first
/// renders at the resolution asked for, each further one at twice that of the one before. Levels beyond the resolutions
/// of the backend, and all but the first without a tolerance, are not used.
///
/// # Errors
/// Those of [`sky_of_patches`].
///
/// ```
/// use hemicube::sky::{Horizon, SensorPoint, SkyDivision, SkyOptions, rows_of_points};
/// # use hemicube_backend_cpu::CpuBackend;
/// # use hemicube_scene::Axis;
/// # use hemicube_spatial::glam::DVec3;
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let model = room::model_of(&room::squares())?;
/// # let options = SkyOptions { render: room::RENDER, samples_per_edge: 1, tolerance: None, rotate: true, threads: 0 };
/// # let (sky, horizon) = (SkyDivision::new(1).ok_or("out of range")?, Horizon::new(Axis::Z, 0.0));
///
/// // Halfway between floor and roof, and far above both.
/// let points = [0.5, 100.0].map(|z| SensorPoint { position: DVec3::new(0.5, 0.5, z), normal: DVec3::Z });
/// let sessions = vec![Box::new(CpuBackend::new()) as _];
/// let rows = rows_of_points(&model, &points, &sky, horizon, options, sessions, &mut |_| true)?.ok_or("told to stop")?;
/// let under: u64 = rows[0].patches.iter().map(|&(_patch, weight)| weight).sum();
/// assert!((under as f64 / rows[0].sky.whole() as f64 - 0.554).abs() < 0.005, "the roof is the top of a hemicube");
/// assert!(rows[1].patches.is_empty() && rows[1].sky.sky_view_factor() == 1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn rows_of_points(
    model: &Model,
    points: &[SensorPoint],
    division: &SkyDivision,
    horizon: Horizon,
    options: SkyOptions,
    sessions: Vec<Box<dyn HemicubeBackend>>,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Vec<PointRow>>, ComputeError> {
    let levels = if options.tolerance.is_some() { sessions.len() } else { 1 };
    let mut loaded = Vec::new();
    for (level, mut backend) in sessions.into_iter().take(levels).enumerate() {
        let resolution = options.render.resolution << level;
        if !crate::backend::RESOLUTIONS.contains(&resolution) {
            break;
        }
        let render = RenderSettings {
            resolution,
            ..options.render
        };
        backend
            .load(model.geometry(), render)
            .map_err(|error| failed(backend.as_ref(), error))?;
        loaded.push((backend, DeltaTable::new(resolution)));
    }
    let mut states = Vec::new();
    for _ in 1..threads_of(options.threads).clamp(1, points.len().max(1)) {
        let mut sessions = Vec::new();
        for (backend, table) in &loaded {
            let session = backend.fork().map_err(|error| failed(backend.as_ref(), error))?;
            sessions.push((session, table.clone()));
        }
        states.push((sessions, Bins::new(division, horizon)));
    }
    states.push((loaded, Bins::new(division, horizon)));
    in_parallel(
        points.len(),
        states,
        |(sessions, bins), index| point_row(model, index, points[index], options, sessions, bins),
        progress,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::Axis;

    #[test]
    fn tregenza_and_reinhart_have_as_many_patches_as_they_should() {
        for (parts, columns) in [(1, 146), (2, 578), (4, 2306)] {
            assert_eq!(SkyDivision::new(parts).expect("in range").columns(), columns);
        }
        assert!(SkyDivision::new(0).is_none() && SkyDivision::new(PARTS_MAX + 1).is_none());
    }

    #[test]
    fn every_patch_holds_its_own_middle_and_all_of_them_the_sky() {
        for parts in 1..5 {
            let sky = SkyDivision::new(parts).expect("in range");
            let (mut solid, mut level) = (0.0, 0.0);
            for column in 1..sky.columns() {
                assert_eq!(sky.column(sky.middle(column) * 3.0), column);
                solid += sky.solid_angle(column);
                level += sky.share_of_a_level_plane(column);
            }
            assert!((solid - std::f64::consts::TAU).abs() < 1e-12);
            assert!((level - 1.0).abs() < 1e-12);
            assert_eq!(sky.column(sky.middle(0)), 0);
        }
    }

    #[test]
    fn columns_go_from_north_clockwise() {
        let sky = SkyDivision::new(1).expect("in range");
        let low = 0.1;
        assert_eq!(sky.column(DVec3::new(0.0, 1.0, low)), 1);
        assert_eq!(
            sky.column(DVec3::new(-0.05, 1.0, low)),
            1,
            "the western half of the first patch"
        );
        assert_eq!(sky.column(DVec3::new(0.05, 1.0, low)), 1);
        assert_eq!(sky.column(DVec3::new((12f64).to_radians().tan(), 1.0, low)), 2);
        assert_eq!(sky.column(DVec3::new(0.0, -1.0, low)), 16);
        // 90° is between the patches 7 (84°) and 8 (96°), of which 6 + 1 begins at 78°.
        assert_eq!(sky.column(DVec3::new(1.0, 0.001, low)), 8);
        assert_eq!(sky.column(DVec3::new(1.0, -0.001, low)), 9);
        assert_eq!(sky.column(DVec3::new(-(12f64).to_radians().tan(), 1.0, low)), 30);
        assert_eq!(sky.column(DVec3::Z), 145);
        assert_eq!(sky.column(DVec3::new(0.3, 0.2, -1e-9)), 0);
    }

    #[test]
    fn horizons_are_right_handed() {
        for up in [Axis::X, Axis::Y, Axis::Z] {
            for turn in [0.0, 30.0, 270.0] {
                let horizon = Horizon::new(up, turn);
                assert!((horizon.east.cross(horizon.north) - horizon.up).length() < 1e-12);
            }
        }
        let turned = Horizon::new(Axis::Z, 90.0);
        assert!(
            (turned.north - DVec3::X).length() < 1e-12,
            "a quarter clockwise is east"
        );
    }
}
