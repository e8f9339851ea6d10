//! A regular grid of towers: many large triangles, strong occlusion, and a size that grows without changing character.
//!
//! 14·blocks²·split² triangles: each block is a 1 × 1 tower of random height 0.6 + 5·u·v (u, v uniform) with four
//! walls, a roof and no bottom, at a pitch of 1.5, and two ground rectangles. 25 blocks give 8,750, split in four
//! 140,000; 82 blocks split in four 1,506,176.

use super::builder::{SceneBuilder, nearest_square};
use super::random::Random;
use crate::{Error, Scene, Subdivision};
use glam::DVec3;

/// Parameters of the block city.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockCityParameters {
    /// Towers along each side of the city.
    pub blocks: u32,
    /// Pieces of each edge: each triangle becomes `split`² triangles.
    pub split: u32,
    /// Seed of the heights.
    pub seed: u64,
}

impl Default for BlockCityParameters {
    fn default() -> Self {
        Self {
            blocks: 25,
            split: 1,
            seed: 1,
        }
    }
}

impl BlockCityParameters {
    /// The block city nearest to a target: unsplit below 50,000, split in four from there.
    pub fn for_target(target: u64, seed: u64) -> Self {
        let split = if target < 50_000 { 1 } else { 4 };
        Self {
            blocks: nearest_square(target, 14 * u64::from(split * split)),
            split,
            seed,
        }
    }

    /// Number of triangles made by [`BlockCityParameters::generate`]. Saturates.
    pub fn patch_count(&self) -> u64 {
        let square = |n: u32| u64::from(n) * u64::from(n);
        square(self.blocks)
            .saturating_mul(square(self.split))
            .saturating_mul(14)
    }

    /// Builds the city, one object a block.
    ///
    /// # Errors
    /// When a parameter is 0, or the city has more than [`MAX_PATCHES`](super::MAX_PATCHES).
    pub fn generate(&self) -> Result<Scene, Error> {
        if self.blocks == 0 || self.split == 0 {
            return Err(Error::malformed("`blocks` and `split` of a block city are at least 1"));
        }
        let mut builder = SceneBuilder::new(self.patch_count(), 1.0)?;
        let mut random = Random::new(self.seed);
        let split = Subdivision::Split(self.split);
        let mut parts = Vec::new();
        let mut quad = |builder: &mut SceneBuilder, [a, b, c, d]: [DVec3; 4]| {
            parts.clear();
            split.cut(&[a, b, c], &mut parts);
            split.cut(&[a, c, d], &mut parts);
            builder.face(parts.iter().copied());
        };
        for k in 0..self.blocks {
            for i in 0..self.blocks {
                let height = 0.6 + 5.0 * random.unit() * random.unit();
                let (x, z) = (1.5 * f64::from(i), 1.5 * f64::from(k));
                let base = [(x, z), (x, z + 1.0), (x + 1.0, z + 1.0), (x + 1.0, z)];
                let level = |base: [(f64, f64); 4], y: f64| base.map(|(x, z)| DVec3::new(x, y, z));
                let (foot, top) = (level(base, 0.0), level(base, height));
                builder.object(format!("block_{i}_{k}"));
                builder.material("roof");
                quad(&mut builder, top);
                builder.material("wall");
                for n in 0..4 {
                    let m = (n + 1) % 4;
                    quad(&mut builder, [foot[n], foot[m], top[m], top[n]]);
                }
                builder.material("ground");
                let (x1, x2, z1, z2) = (x + 1.0, x + 1.5, z + 1.0, z + 1.5);
                quad(&mut builder, level([(x1, z), (x1, z2), (x2, z2), (x2, z)], 0.0));
                quad(&mut builder, level([(x, z1), (x, z2), (x1, z2), (x1, z1)], 0.0));
            }
        }
        Ok(builder.finish())
    }
}
