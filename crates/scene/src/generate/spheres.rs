//! A closed room with spheres touching neither each other nor the walls.
//!
//! A sphere is an icosahedron whose edges are cut into k pieces, with the corners moved out onto the sphere: 20·k²
//! triangles of nearly one size, none of them slender anywhere (a sphere of meridians and parallels has slivers at its
//! poles). 20·k²·spheres + 12·m² triangles, where m² is the number of squares on each wall.

use super::builder::{SceneBuilder, check_count, cube_root, nearest_square};
use super::random::Random;
use crate::{Error, Scene, Subdivision};
use glam::DVec3;

/// Side of the room, in metres.
const SIDE: f64 = 10.0;

/// Properties of the room.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpheresParameters {
    /// Number of spheres.
    pub spheres: u32,
    /// Into how many pieces each edge of a sphere's icosahedron is cut.
    pub sphere_pieces: u32,
    /// Squares along each edge of the room.
    pub wall_pieces: u32,
    /// Seed of places, sizes and rotations.
    pub seed: u64,
}

impl Default for SpheresParameters {
    fn default() -> Self {
        Self {
            spheres: 30,
            sphere_pieces: 4,
            wall_pieces: 6,
            seed: 1,
        }
    }
}

impl SpheresParameters {
    /// Room and spheres nearest to a target: the number of spheres grows with its cube root (30 at 10,000), and the
    /// walls take about a twentieth.
    pub fn for_target(target: u64, seed: u64) -> Self {
        let on_spheres = target - target / 20;
        let wanted = u64::from(cube_root(target.saturating_mul(27) / 10).max(1));
        let sphere_pieces = nearest_square(on_spheres, 20 * wanted);
        let per_sphere = 20 * u64::from(sphere_pieces).pow(2);
        let spheres = ((on_spheres + per_sphere / 2) / per_sphere).max(1);
        let wall_pieces = nearest_square(target.saturating_sub(spheres.saturating_mul(per_sphere)), 12);
        Self {
            spheres: u32::try_from(spheres).unwrap_or(u32::MAX),
            sphere_pieces,
            wall_pieces,
            seed,
        }
    }

    /// Number of triangles made by [`SpheresParameters::generate`]. Saturates.
    pub fn patch_count(&self) -> u64 {
        let square = |n: u32| u64::from(n) * u64::from(n);
        let spheres = square(self.sphere_pieces)
            .saturating_mul(20)
            .saturating_mul(u64::from(self.spheres));
        spheres.saturating_add(square(self.wall_pieces).saturating_mul(12))
    }

    /// Builds the room: floor, ceiling, walls and one object a sphere.
    ///
    /// # Errors
    /// When a piece count is 0, or the room has more than [`MAX_PATCHES`](super::MAX_PATCHES).
    pub fn generate(&self) -> Result<Scene, Error> {
        if self.sphere_pieces == 0 || self.wall_pieces == 0 {
            return Err(Error::malformed("`sphere_pieces` and `wall_pieces` are at least 1"));
        }
        check_count(self.patch_count())?;
        let mut builder = SceneBuilder::new(self.patch_count(), 1.0)?;
        builder.closed_room(SIDE, self.wall_pieces);
        builder.material("sphere");
        let sphere = unit_sphere(self.sphere_pieces);
        let mut random = Random::new(self.seed);
        // One sphere to a cell of a cubic grid, the cells drawn without replacement: apart without any search.
        let cells_along = (1..=self.spheres)
            .find(|&n| u64::from(n).pow(3) >= u64::from(self.spheres))
            .unwrap_or(1);
        let cell_side = SIDE / f64::from(cells_along);
        let mut cells: Vec<u32> = (0..cells_along.pow(3)).collect();
        for n in 0..self.spheres {
            let rest = u32::try_from(cells.len()).unwrap_or(u32::MAX);
            let cell = cells.swap_remove(random.below(rest) as usize);
            let corner = DVec3::new(
                f64::from(cell % cells_along),
                f64::from(cell / cells_along % cells_along),
                f64::from(cell / cells_along / cells_along),
            ) * cell_side;
            let radius = cell_side * random.between(0.25, 0.45);
            let rotation = random.rotation();
            let play = 2.0 * (0.48 * cell_side - radius);
            let centre = corner + DVec3::splat(0.5 * cell_side) + random.in_cube() * play;
            builder.object(format!("sphere_{n}"));
            for triangle in &sphere {
                builder.triangle(triangle.map(|p| centre + rotation * p * radius));
            }
        }
        Ok(builder.finish())
    }
}

/// The unit sphere from an icosahedron with edges cut into `pieces`.
fn unit_sphere(pieces: u32) -> Vec<[DVec3; 3]> {
    // Corners (0, ±1, ±φ) and their cyclic permutations; two of them share an edge exactly if their scalar product is
    // positive (φ; otherwise −φ, or −1 − φ² for opposite ones).
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut corners = Vec::with_capacity(12);
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        corners.extend([DVec3::new(0.0, a, b), DVec3::new(b, 0.0, a), DVec3::new(a, b, 0.0)]);
    }
    let split = Subdivision::Split(pieces);
    let mut sphere = Vec::new();
    for (n, &a) in corners.iter().enumerate() {
        for (m, &b) in corners.iter().enumerate().skip(n + 1) {
            for &c in corners.iter().skip(m + 1) {
                if a.dot(b) > 0.0 && b.dot(c) > 0.0 && c.dot(a) > 0.0 {
                    let outwards = a.cross(b).dot(c) > 0.0;
                    split.cut(&if outwards { [a, b, c] } else { [a, c, b] }, &mut sphere);
                }
            }
        }
    }
    for triangle in &mut sphere {
        *triangle = triangle.map(|p| p / p.length());
    }
    sphere
}
