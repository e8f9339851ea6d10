//! An open field with little occlusion: a shallow bowl of ground, gently uneven, with a hut here and there. Most of the
//! ground faces and sees most of the rest, so F is nearly full: culling cannot help.
//!
//! 2·n² + 8·⌊n/12⌋² triangles on n × n squares of 10 m: a hut stands on one square in place of its ground, so that
//! ground and walls share their edges and no patch lies underneath.

use super::builder::SceneBuilder;
use super::random::Random;
use crate::{Error, Scene};
use glam::DVec3;

/// Side of a square, in metres.
const SQUARE: f64 = 10.0;
/// Squares along a parcel; each whole parcel has one hut, not on its rim, so that no two huts touch.
const PARCEL: u32 = 12;
/// Height of the middle of a side above the middle of the bowl, as a share of the field's side.
const DEPTH: f64 = 0.1;
/// Height by which the ground leaves the bowl, as a share of the field's side.
const UNEVENNESS: f64 = 0.001;
/// Knots of the unevenness along a side, less one.
const WAVES: u32 = 6;

/// Properties of the field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldParameters {
    /// Squares of ground along each side.
    pub squares: u32,
    /// Seed of the ground and the huts.
    pub seed: u64,
}

impl Default for FieldParameters {
    fn default() -> Self {
        Self { squares: 70, seed: 1 }
    }
}

impl FieldParameters {
    /// The field nearest to a target.
    pub fn for_target(target: u64, seed: u64) -> Self {
        // Huts add at most a 36th to 2·n².
        let most = u32::try_from((target / 2).isqrt())
            .unwrap_or(u32::MAX)
            .saturating_add(1);
        let least = (most - most / 30).saturating_sub(3).max(1);
        let with = |squares| Self { squares, seed };
        let nearest = (least..=most).min_by_key(|&n| with(n).patch_count().abs_diff(target));
        with(nearest.unwrap_or(1))
    }

    /// Number of triangles made by [`FieldParameters::generate`]. Saturates.
    pub fn patch_count(&self) -> u64 {
        let square = |n: u32| u64::from(n) * u64::from(n);
        square(self.squares)
            .saturating_mul(2)
            .saturating_add(square(self.squares / PARCEL).saturating_mul(8))
    }

    /// Builds the field: the ground and one object a hut.
    ///
    /// # Errors
    /// When `squares` is 0, or the field has more than [`MAX_PATCHES`](super::MAX_PATCHES).
    pub fn generate(&self) -> Result<Scene, Error> {
        if self.squares == 0 {
            return Err(Error::malformed("`squares` of a field is 0; give at least 1"));
        }
        let mut builder = SceneBuilder::new(self.patch_count(), 1.0)?;
        let mut random = Random::new(self.seed);
        let n = self.squares as usize;
        let ground = Ground::new(self.squares, &mut random);

        let parcels = self.squares / PARCEL;
        let mut huts = Vec::new();
        for row in 0..parcels {
            for column in 0..parcels {
                let inside = PARCEL - 2;
                let x = column * PARCEL + 1 + random.below(inside);
                let z = row * PARCEL + 1 + random.below(inside);
                huts.push(([x as usize, z as usize], random.between(3.0, 12.0)));
            }
        }
        let mut taken = vec![false; n * n];
        for &([x, z], _) in &huts {
            taken[z * n + x] = true;
        }

        builder.object("ground");
        builder.material("ground");
        let around =
            |x: usize, z: usize| [[x, z], [x, z + 1], [x + 1, z + 1], [x + 1, z]].map(|[x, z]| ground.at(x, z));
        for z in 0..n {
            for x in (0..n).filter(|x| !taken[z * n + x]) {
                builder.quad(around(x, z));
            }
        }
        for (number, &([x, z], height)) in huts.iter().enumerate() {
            let foot = around(x, z);
            let eaves = foot.iter().fold(f64::MIN, |top, p| top.max(p.y)) + height;
            let roof = foot.map(|p| DVec3::new(p.x, eaves, p.z));
            builder.object(format!("hut_{number}"));
            builder.material("wall");
            for i in 0..4 {
                let j = (i + 1) % 4;
                builder.quad([foot[i], foot[j], roof[j], roof[i]]);
            }
            builder.material("roof");
            builder.quad(roof);
        }
        Ok(builder.finish())
    }
}

/// Corners of the squares of ground.
struct Ground {
    corners: Vec<DVec3>,
    along: usize,
}

impl Ground {
    fn new(squares: u32, random: &mut Random) -> Self {
        let side = SQUARE * f64::from(squares);
        let knots: Vec<f64> = (0..(WAVES + 1).pow(2)).map(|_| random.between(-1.0, 1.0)).collect();
        let knot = |i: u32, j: u32| knots[(j * (WAVES + 1) + i) as usize];
        // Knot before a line, and the smooth share 3t² − 2t³ of the knot after it.
        let share = |i: u32| {
            let along = f64::from(i) / f64::from(squares) * f64::from(WAVES);
            let before = (0..WAVES - 1).take_while(|&k| f64::from(k + 1) <= along).count();
            let before = u32::try_from(before).unwrap_or(0);
            let t = along - f64::from(before);
            (before, t * t * (3.0 - 2.0 * t))
        };
        let shares: Vec<(u32, f64)> = (0..=squares).map(share).collect();
        let centred = |i: u32| 2.0 * f64::from(i) / f64::from(squares) - 1.0;
        let mut corners = Vec::with_capacity(shares.len() * shares.len());
        for (k, &(row, v)) in (0..).zip(&shares) {
            for (i, &(column, u)) in (0..).zip(&shares) {
                let low = knot(column, row) * (1.0 - u) + knot(column + 1, row) * u;
                let high = knot(column, row + 1) * (1.0 - u) + knot(column + 1, row + 1) * u;
                let uneven = UNEVENNESS * (low * (1.0 - v) + high * v);
                let bowl = DEPTH * (centred(i) * centred(i) + centred(k) * centred(k));
                corners.push(DVec3::new(
                    SQUARE * f64::from(i),
                    side * (bowl + uneven),
                    SQUARE * f64::from(k),
                ));
            }
        }
        Self {
            corners,
            along: shares.len(),
        }
    }

    fn at(&self, x: usize, z: usize) -> DVec3 {
        self.corners[z * self.along + x]
    }
}
