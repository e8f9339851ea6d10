//! A closed room with triangles strewn in it, each in any place and direction, cutting one another: no modeller would
//! make it, and every engine must survive it. One-sided: half of the views of a triangle are blocked by its back.
//!
//! 12·m² triangles of the room, with m² squares on each wall, and the strewn ones.

use super::builder::{SceneBuilder, cube_root};
use super::random::Random;
use crate::{Error, Scene};
use glam::DVec3;

/// Side of the room, in metres.
const SIDE: f64 = 10.0;

/// Properties of the soup.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SoupParameters {
    /// Number of strewn triangles.
    pub triangles: u32,
    /// Squares along each edge of the room.
    pub wall_pieces: u32,
    /// Seed of the strewn triangles.
    pub seed: u64,
}

impl Default for SoupParameters {
    fn default() -> Self {
        Self {
            triangles: 5_200,
            wall_pieces: 20,
            seed: 1,
        }
    }
}

impl SoupParameters {
    /// The soup of a target: walls take up to half, and the count is met exactly from 12.
    pub fn for_target(target: u64, seed: u64) -> Self {
        let wall_pieces = u32::try_from((target / 24).isqrt()).unwrap_or(u32::MAX).max(1);
        let walls = u64::from(wall_pieces).pow(2).saturating_mul(12);
        Self {
            triangles: u32::try_from(target.saturating_sub(walls)).unwrap_or(u32::MAX),
            wall_pieces,
            seed,
        }
    }

    /// Number of triangles made by [`SoupParameters::generate`]. Saturates.
    pub fn patch_count(&self) -> u64 {
        let walls = u64::from(self.wall_pieces) * u64::from(self.wall_pieces);
        walls.saturating_mul(12).saturating_add(u64::from(self.triangles))
    }

    /// Builds the soup: floor, ceiling, walls, and the strewn triangles as one object.
    ///
    /// # Errors
    /// When `wall_pieces` is 0, or the soup has more than [`MAX_PATCHES`](super::MAX_PATCHES).
    pub fn generate(&self) -> Result<Scene, Error> {
        if self.wall_pieces == 0 {
            return Err(Error::malformed("`wall_pieces` of a soup is 0; give at least 1"));
        }
        let mut builder = SceneBuilder::new(self.patch_count(), 1.0)?;
        builder.closed_room(SIDE, self.wall_pieces);
        if self.triangles > 0 {
            builder.object("soup");
            builder.material("soup");
        }
        let mut random = Random::new(self.seed);
        // About as large as the mean distance between them, so that a view ends after a few of them at any count.
        let size = SIDE / f64::from(cube_root(u64::from(self.triangles)).max(4));
        for _ in 0..self.triangles {
            let centre = DVec3::splat(SIDE / 2.0) + random.in_cube() * (SIDE - 2.0 * size);
            let triangle = loop {
                let corners = [random.in_cube(), random.in_cube(), random.in_cube()];
                if is_stout(corners) {
                    break corners.map(|p| centre + p * size);
                }
            };
            builder.triangle(triangle);
        }
        Ok(builder.finish())
    }
}

/// Returns whether a triangle in the unit cube is neither a sliver nor tiny: longest edge above 0.4, least height above
/// 0.3 of it.
fn is_stout([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a)
        .length_squared()
        .max((c - b).length_squared())
        .max((a - c).length_squared());
    // Twice the area is longest edge times least height.
    longest > 0.16 && (b - a).cross(c - a).length() > 0.3 * longest
}
