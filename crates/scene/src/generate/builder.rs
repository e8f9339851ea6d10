//! Puts faces into a scene under a current object and material, within the count announced at the start.

use super::MAX_PATCHES;
use crate::{Axis, Error, ErrorKind, Material, Scene, Triangle};
use glam::DVec3;

/// Refuses a count above [`MAX_PATCHES`].
pub(super) fn check_count(count: u64) -> Result<(), Error> {
    if count > MAX_PATCHES {
        return Err(Error::new(ErrorKind::TooLarge(format!(
            "{count} patches are more than the {MAX_PATCHES} of a generated scene; generate fewer and subdivide them"
        ))));
    }
    Ok(())
}

/// The whole k ≥ 1 whose `per`·k² is nearest to `target`.
pub(super) fn nearest_square(target: u64, per: u64) -> u32 {
    let below = (target / per).isqrt().max(1);
    let count = |k: u64| per.saturating_mul(k.saturating_mul(k));
    let k = if count(below + 1).abs_diff(target) <= target.abs_diff(count(below)) {
        below + 1
    } else {
        below
    };
    u32::try_from(k).unwrap_or(u32::MAX)
}

/// The largest whole number whose cube is not above `n`.
pub(super) fn cube_root(n: u64) -> u32 {
    // 2,642,245³ is the last cube below 2⁶⁴.
    let (mut low, mut end) = (0u64, 2_642_246u64);
    while end - low > 1 {
        let middle = u64::midpoint(low, end);
        if middle * middle * middle <= n {
            low = middle
        } else {
            end = middle
        }
    }
    u32::try_from(low).unwrap_or(u32::MAX)
}

/// A scene in the making.
pub(super) struct SceneBuilder {
    scene: Scene,
    object: u32,
    material: u32,
    face: u32,
}

impl SceneBuilder {
    /// An empty scene, y up.
    pub(super) fn empty(metres_per_unit: f64) -> Self {
        let scene = Scene {
            up: Some(Axis::Y),
            metres_per_unit: Some(metres_per_unit),
            ..Scene::default()
        };
        Self {
            scene,
            object: 0,
            material: 0,
            face: 0,
        }
    }

    /// An empty scene with space for `count` triangles, y up.
    pub(super) fn new(count: u64, metres_per_unit: f64) -> Result<Self, Error> {
        check_count(count)?;
        let mut builder = Self::empty(metres_per_unit);
        let space = usize::try_from(count)
            .ok()
            .and_then(|n| builder.scene.triangles.try_reserve_exact(n).ok());
        space.ok_or_else(|| {
            Error::new(ErrorKind::TooLarge(format!(
                "{count} patches do not fit in this machine's memory; generate fewer"
            )))
        })?;
        Ok(builder)
    }

    /// Begins an object: the following faces belong to it.
    pub(super) fn object(&mut self, name: impl Into<String>) {
        self.object = index(self.scene.objects.len());
        self.scene.objects.push(name.into());
    }

    /// Takes a material for the following faces, by name, or adds it.
    pub(super) fn material(&mut self, name: &str) {
        let place = self
            .scene
            .materials
            .iter()
            .position(|m| m.name == name)
            .unwrap_or_else(|| {
                self.scene.materials.push(Material {
                    name: name.to_owned(),
                    ..Material::default()
                });
                self.scene.materials.len() - 1
            });
        self.material = index(place);
    }

    /// Takes a material with optical properties for the following faces, or adds it.
    pub(super) fn optical_material(&mut self, name: &str, diffuse: [f64; 3], emission: [f64; 3]) {
        self.material(name);
        if let Some(material) = self.scene.materials.get_mut(self.material as usize) {
            material.diffuse = Some(diffuse);
            material.emission = Some(emission);
        }
    }

    /// A face of several triangles.
    pub(super) fn face(&mut self, triangles: impl IntoIterator<Item = [DVec3; 3]>) {
        let (object, material, face) = (self.object, self.material, self.face);
        self.scene
            .triangles
            .extend(triangles.into_iter().map(|corners| Triangle {
                corners,
                object,
                material,
                face,
                two_sided: false,
            }));
        self.face += 1;
    }

    /// A triangle.
    pub(super) fn triangle(&mut self, corners: [DVec3; 3]) {
        self.face([corners]);
    }

    /// A face of four corners, cut along the diagonal from the first.
    pub(super) fn quad(&mut self, [a, b, c, d]: [DVec3; 4]) {
        self.face([[a, b, c], [a, c, d]]);
    }

    /// A sheet of `columns` × `rows` quads between lattice points; its normal is that of (first index, second index).
    pub(super) fn sheet(&mut self, columns: usize, rows: usize, at: impl Fn(usize, usize) -> DVec3) {
        for j in 0..rows {
            for i in 0..columns {
                self.quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }

    /// The six inner walls of a cube from 0 to `side`, each of `pieces`² quads, watertight. 12·`pieces`² triangles.
    pub(super) fn closed_room(&mut self, side: f64, pieces: u32) {
        let lines: Vec<f64> = (0..=pieces)
            .map(|i| side * (f64::from(i) / f64::from(pieces)))
            .collect();
        let n = pieces as usize;
        let at = |i: usize| lines[i];
        self.material("wall");
        self.object("floor");
        self.sheet(n, n, |i, j| DVec3::new(at(j), 0.0, at(i)));
        self.object("ceiling");
        self.sheet(n, n, |i, j| DVec3::new(at(i), side, at(j)));
        self.object("walls");
        self.sheet(n, n, |i, j| DVec3::new(0.0, at(i), at(j)));
        self.sheet(n, n, |i, j| DVec3::new(side, at(j), at(i)));
        self.sheet(n, n, |i, j| DVec3::new(at(i), at(j), 0.0));
        self.sheet(n, n, |i, j| DVec3::new(at(j), at(i), side));
    }

    pub(super) fn finish(self) -> Scene {
        self.scene
    }
}

/// A position in a list no longer than [`MAX_PATCHES`].
#[allow(
    clippy::cast_possible_truncation,
    reason = "every object has a face, and there are at most 2²⁶"
)]
fn index(place: usize) -> u32 {
    place as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_squares_and_cube_roots() {
        assert_eq!(nearest_square(10_240, 40), 16);
        assert_eq!(nearest_square(1, 40), 1);
        assert_eq!(nearest_square(40 * 89, 40), 9);
        assert_eq!(nearest_square(100, 40), 2, "a tie goes to the larger count");
        for n in 0..200u64 {
            assert_eq!(cube_root(n * n * n), u32::try_from(n).unwrap());
            assert_eq!(cube_root(n * n * n + 3 * n), u32::try_from(n).unwrap());
        }
        assert_eq!(cube_root(u64::MAX), 2_642_245);
    }
}
