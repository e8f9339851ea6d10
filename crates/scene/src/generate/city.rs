//! A city of blocks and streets after a patch count: separate buildings with log-normal heights, so that its occlusion
//! can be set beside that of real tiles of the same size.
//!
//! N = bx·bz·lots²·(8·wu·wv + 2) + 2·[(bx + 1)·bz + bx·(bz + 1)] triangles: four walls of wu × wv rectangles and a roof
//! on every lot, and the street rectangles. Metres.

use super::builder::SceneBuilder;
use super::random::{Random, exp};
use crate::{Error, Scene};
use glam::DVec3;

/// What the city is like. Each length is in metres.
///
/// A block (i, k) has its corner at i·(block + street), k·(block + street); a building stands on its lot less `gap`/2
/// on each side. Street strips `street` wide run before and after every row and column of blocks; crossings belong to
/// the strips along z, and there is no ground inside blocks. Order: block by block (i outer), lot by lot, walls then
/// roof; the ground last.
#[derive(Clone, Debug, PartialEq)]
pub struct CityParameters {
    /// Blocks along x.
    pub blocks_x: u32,
    /// Blocks along z.
    pub blocks_z: u32,
    /// Lots along each side of a block; a block has `lots`² buildings.
    pub lots: u32,
    /// Side of a block.
    pub block: f64,
    /// Width of a street.
    pub street: f64,
    /// Between neighbouring buildings. Never 0: two walls in one place would be one face twice.
    pub gap: f64,
    /// Median height of a building, before it is rounded to whole storeys (one at least).
    pub height_median: f64,
    /// Standard deviation of the logarithm of the height.
    pub height_sigma: f64,
    /// Height of a storey.
    pub storey: f64,
    /// Rectangles along each wall.
    pub wall_columns: u32,
    /// Rectangles up each wall.
    pub wall_rows: u32,
    /// Seed of the heights.
    pub seed: u64,
    /// If given, the blocks grow (1, 1), (2, 1), (2, 2), (3, 2) … to the first city of at least so many patches, in
    /// place of `blocks_x` and `blocks_z`; then lots are left out, last first, and after them ground rectangles, while
    /// the count stays at or above it. One building always stays.
    pub target: Option<u64>,
}

impl Default for CityParameters {
    fn default() -> Self {
        Self {
            blocks_x: 10,
            blocks_z: 9,
            lots: 3,
            block: 60.0,
            street: 18.0,
            gap: 0.2,
            height_median: 25.0,
            height_sigma: 0.45,
            storey: 3.0,
            wall_columns: 1,
            wall_rows: 1,
            seed: 1,
            target: None,
        }
    }
}

/// The built part of the city.
struct Extent {
    blocks_x: u32,
    blocks_z: u32,
    buildings: u64,
    ground: u64,
}

impl CityParameters {
    /// Number of triangles made by [`CityParameters::generate`]. Saturates.
    pub fn patch_count(&self) -> u64 {
        self.count(&self.extent())
    }

    fn per_building(&self) -> u64 {
        8u64.saturating_mul(u64::from(self.wall_columns))
            .saturating_mul(u64::from(self.wall_rows))
            .saturating_add(2)
    }

    fn count(&self, extent: &Extent) -> u64 {
        extent
            .buildings
            .saturating_mul(self.per_building())
            .saturating_add(extent.ground.saturating_mul(2))
    }

    fn full(&self, blocks_x: u32, blocks_z: u32) -> Extent {
        let (bx, bz, lots) = (u64::from(blocks_x), u64::from(blocks_z), u64::from(self.lots));
        Extent {
            blocks_x,
            blocks_z,
            buildings: bx.saturating_mul(bz).saturating_mul(lots.saturating_mul(lots)),
            ground: (bx + 1).saturating_mul(bz).saturating_add(bx.saturating_mul(bz + 1)),
        }
    }

    fn extent(&self) -> Extent {
        let Some(target) = self.target else {
            return self.full(self.blocks_x, self.blocks_z);
        };
        // A square city of n² blocks has n²·(per block + 4) + 4·n triangles: begin just below the target.
        let per_block = u64::from(self.lots).pow(2).saturating_mul(self.per_building());
        let start = (target / per_block.saturating_add(4)).isqrt().saturating_sub(2).max(1);
        let start = u32::try_from(start).unwrap_or(u32::MAX);
        let (mut bx, mut bz) = (start, start);
        let mut extent = self.full(bx, bz);
        while self.count(&extent) < target && bx < u32::MAX {
            if bx == bz {
                bx += 1
            } else {
                bz += 1
            }
            extent = self.full(bx, bz);
        }
        let spare = self.count(&extent).saturating_sub(target);
        extent.buildings -= (spare / self.per_building()).min(extent.buildings.saturating_sub(1));
        let spare = self.count(&extent).saturating_sub(target);
        extent.ground -= (spare / 2).min(extent.ground);
        extent
    }

    fn check(&self) -> Result<(), Error> {
        let counts = [
            ("blocks_x", self.blocks_x),
            ("blocks_z", self.blocks_z),
            ("lots", self.lots),
            ("wall_columns", self.wall_columns),
            ("wall_rows", self.wall_rows),
        ];
        if let Some((name, _)) = counts.into_iter().find(|&(_, n)| n == 0) {
            return Err(Error::malformed(format!("`{name}` is 0; a city needs at least 1")));
        }
        let lengths = [
            ("block", self.block),
            ("street", self.street),
            ("gap", self.gap),
            ("height_median", self.height_median),
            ("storey", self.storey),
        ];
        for (name, length) in lengths {
            if !(1e-3..=1e6).contains(&length) {
                return Err(Error::malformed(format!(
                    "`{name}` is {length} m; give 0.001 to 1,000,000"
                )));
            }
        }
        if !(0.0..=2.0).contains(&self.height_sigma) {
            return Err(Error::malformed(format!(
                "`height_sigma` is {}; give 0 to 2",
                self.height_sigma
            )));
        }
        let lot = self.block / f64::from(self.lots);
        if self.gap > lot / 2.0 {
            return Err(Error::malformed(format!(
                "`gap` is {} m and a lot {lot} m wide; leave a building at least half its lot",
                self.gap
            )));
        }
        Ok(())
    }

    /// Builds the city: one object a building, and the ground.
    ///
    /// # Errors
    /// When a parameter is out of its range (the message names it), or the city has more than
    /// [`MAX_PATCHES`](super::MAX_PATCHES).
    pub fn generate(&self) -> Result<Scene, Error> {
        self.check()?;
        let extent = self.extent();
        let mut builder = SceneBuilder::new(self.count(&extent), 1.0)?;
        let mut random = Random::new(self.seed);
        let pitch = self.block + self.street;
        let lot = self.block / f64::from(self.lots);
        let mut left = extent.buildings;
        for i in 0..extent.blocks_x {
            for k in 0..extent.blocks_z {
                for p in 0..self.lots {
                    for q in 0..self.lots {
                        if left == 0 {
                            break;
                        }
                        left -= 1;
                        let x = f64::from(i) * pitch + f64::from(p) * lot;
                        let z = f64::from(k) * pitch + f64::from(q) * lot;
                        let height = self.height_median * exp(self.height_sigma * random.normal());
                        let height = (height / self.storey).round().max(1.0) * self.storey;
                        builder.object(format!("building_{i}_{k}_{p}_{q}"));
                        self.building(&mut builder, x, z, lot, height);
                    }
                }
            }
        }
        if extent.ground > 0 {
            self.ground(&mut builder, &extent, pitch);
        }
        Ok(builder.finish())
    }

    fn building(&self, builder: &mut SceneBuilder, x: f64, z: f64, lot: f64, height: f64) {
        let (x0, x1) = (x + self.gap / 2.0, x + lot - self.gap / 2.0);
        let (z0, z1) = (z + self.gap / 2.0, z + lot - self.gap / 2.0);
        // Round the footprint with each wall's normal, (along, up), pointing outwards.
        let base = [(x0, z0), (x0, z1), (x1, z1), (x1, z0)];
        let (columns, rows) = (self.wall_columns as usize, self.wall_rows as usize);
        let part = |low: f64, high: f64, i: usize, n: u32| {
            #[allow(clippy::cast_precision_loss, reason = "a position in a wall, below 2³²")]
            let t = i as f64 / f64::from(n);
            // Exact at both ends, so that neighbouring walls share their corner.
            low * (1.0 - t) + high * t
        };
        builder.material("wall");
        for (&(ax, az), &(bx, bz)) in base.iter().zip(base.iter().cycle().skip(1)) {
            builder.sheet(columns, rows, |i, j| {
                let n = self.wall_columns;
                DVec3::new(
                    part(ax, bx, i, n),
                    part(0.0, height, j, self.wall_rows),
                    part(az, bz, i, n),
                )
            });
        }
        builder.material("roof");
        builder.quad(base.map(|(x, z)| DVec3::new(x, height, z)));
    }

    fn ground(&self, builder: &mut SceneBuilder, extent: &Extent, pitch: f64) {
        builder.object("ground");
        builder.material("ground");
        let mut left = extent.ground;
        let mut rectangle = |x0: f64, x1: f64, z0: f64, z1: f64| {
            if left > 0 {
                left -= 1;
                builder.quad([(x0, z0), (x0, z1), (x1, z1), (x1, z0)].map(|(x, z)| DVec3::new(x, 0.0, z)));
            }
        };
        let start = |i: u32| f64::from(i) * pitch;
        for i in 0..=extent.blocks_x {
            for k in 0..extent.blocks_z {
                // The last one goes on over the last crossing.
                let end = if k + 1 == extent.blocks_z {
                    start(k + 1)
                } else {
                    start(k) + self.block
                };
                rectangle(start(i) - self.street, start(i), start(k) - self.street, end);
            }
        }
        for k in 0..=extent.blocks_z {
            for i in 0..extent.blocks_x {
                rectangle(start(i), start(i) + self.block, start(k) - self.street, start(k));
            }
        }
    }
}
