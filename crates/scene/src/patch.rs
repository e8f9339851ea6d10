//! Patches: the planar triangles that emit and receive, the unit of a row and a column of F.

use crate::{Error, ErrorKind, Scene, Subdivision};
use glam::DVec3;

/// A patch by its position in the file's face order, sub-patches of a face in a fixed order, the back of a two-sided
/// one directly after its front. The number of its row and of its column in every file and report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InputPatch(pub u32);

/// A side of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The side seeing the file's corners run counter-clockwise.
    Front,
    /// The other side of a two-sided triangle.
    Back,
}

/// The patches of a scene, in input order.
///
/// A *surface* is a triangle after subdivision. A one-sided surface carries one patch, a two-sided one two: front and
/// back, with the same corners and opposite normals.
///
/// ```
/// use hemicube_scene::{InputPatch, Patches, Subdivision, generate};
///
/// let scene = generate::cornell_box();
/// let whole = Patches::new(&scene, Subdivision::None)?;
/// let cut = Patches::new(&scene, Subdivision::Split(3))?;
/// assert_eq!(cut.len(), 9 * whole.len());
///
/// // Patch 20 is one of the nine that triangle 2 was cut into, and no area is lost on the way.
/// assert_eq!(cut.triangle(InputPatch(20)), 2);
/// let area = |patches: &Patches| patches.iter().map(|patch| patches.area(patch)).sum::<f64>();
/// assert!((area(&cut) / area(&whole) - 1.0).abs() < 1e-12);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Patches {
    surfaces: Vec<[DVec3; 3]>,
    triangle_of_surface: Vec<u32>,
    /// Bit 31 set: back.
    surface_of_patch: Vec<u32>,
}

const BACK: u32 = 1 << 31;

impl Patches {
    /// Number of patches made by [`Self::new`], without cutting. Saturates at `u64::MAX`.
    ///
    /// ```
    /// use hemicube_scene::{Patches, Subdivision, generate::cornell_box};
    /// assert_eq!(Patches::count(&cornell_box(), Subdivision::Levels(10)), 40 << 20);
    /// ```
    pub fn count(scene: &Scene, subdivision: Subdivision) -> u64 {
        scene.triangles.iter().fold(0, |sum, triangle| {
            let sides = if triangle.two_sided { 2 } else { 1 };
            sum.saturating_add(subdivision.count(&triangle.corners).saturating_mul(sides))
        })
    }

    /// Cuts the triangles of `scene` into patches, without repair: run [`crate::repair`] first.
    ///
    /// # Errors
    /// [`ErrorKind::TooLarge`] when there would be more than 2³¹ − 16 patches.
    pub fn new(scene: &Scene, subdivision: Subdivision) -> Result<Self, Error> {
        let counts: Vec<u64> = scene.triangles.iter().map(|t| subdivision.count(&t.corners)).collect();
        let surface_count: u64 = counts.iter().fold(0, |a, &c| a.saturating_add(c));
        let patch_count = Self::count(scene, subdivision);
        if patch_count > u64::from(BACK - 16) {
            // The count saturates at 2³² pieces of an edge.
            let asked = if patch_count < 1_000_000_000_000_000_000 {
                patch_count.to_string()
            } else {
                "10¹⁸ or more".to_owned()
            };
            return Err(Error::new(ErrorKind::TooLarge(format!(
                "{asked} patches are more than the {} that a matrix can have; subdivide less",
                BACK - 16
            ))));
        }
        let too_large = || {
            Error::new(ErrorKind::TooLarge(format!(
                "{patch_count} patches do not fit in this machine's memory; subdivide less"
            )))
        };
        let mut patches = Self::default();
        let surface_count = usize::try_from(surface_count).map_err(|_| too_large())?;
        patches
            .surfaces
            .try_reserve_exact(surface_count)
            .map_err(|_| too_large())?;
        patches
            .triangle_of_surface
            .try_reserve_exact(surface_count)
            .map_err(|_| too_large())?;
        patches
            .surface_of_patch
            .try_reserve_exact(usize::try_from(patch_count).map_err(|_| too_large())?)
            .map_err(|_| too_large())?;
        let mut parts = Vec::new();
        for (index, triangle) in (0u32..).zip(&scene.triangles) {
            parts.clear();
            subdivision.cut(&triangle.corners, &mut parts);
            for part in &parts {
                // Fewer than 2³¹ surfaces, by the check above.
                #[allow(clippy::cast_possible_truncation, reason = "bounded above")]
                let surface = patches.surfaces.len() as u32;
                patches.surfaces.push(*part);
                patches.triangle_of_surface.push(index);
                patches.surface_of_patch.push(surface);
                if triangle.two_sided {
                    patches.surface_of_patch.push(surface | BACK);
                }
            }
        }
        Ok(patches)
    }

    /// Triangles that were cut, in input order: the first patch, and the number of pieces of an edge, from 2 on.
    ///
    /// ```
    /// use hemicube_scene::{InputPatch, Patches, Subdivision, generate::cornell_box};
    /// let cut = Patches::new(&cornell_box(), Subdivision::Split(3))?;
    /// assert_eq!(cut.cut_triangles().nth(2), Some((InputPatch(18), 3)));
    /// # Ok::<(), hemicube_scene::Error>(())
    /// ```
    pub fn cut_triangles(&self) -> impl Iterator<Item = (InputPatch, u32)> + '_ {
        let mut first = 0;
        self.surface_of_patch
            .chunk_by(|&one, &next| self.triangle_of(one) == self.triangle_of(next))
            .filter_map(move |patches| {
                let (patch, sides) = (InputPatch(first), if patches.last()? & BACK == 0 { 1 } else { 2 });
                let count = u32::try_from(patches.len()).ok()?;
                first += count;
                let pieces = (count / sides).isqrt();
                (pieces > 1).then_some((patch, pieces))
            })
    }

    fn triangle_of(&self, surface: u32) -> u32 {
        self.triangle_of_surface[(surface & !BACK) as usize]
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.surface_of_patch.len()
    }

    /// Returns whether there is no patch.
    pub fn is_empty(&self) -> bool {
        self.surface_of_patch.is_empty()
    }

    /// All patches in input order.
    pub fn iter(&self) -> impl Iterator<Item = InputPatch> + use<> {
        #[allow(clippy::cast_possible_truncation, reason = "at most 2³¹ patches")]
        let count = self.len() as u32;
        (0..count).map(InputPatch)
    }

    /// The surfaces (triangles after subdivision), in input order; corners counter-clockwise seen from the front.
    pub fn surfaces(&self) -> &[[DVec3; 3]] {
        &self.surfaces
    }

    /// The surface of a patch.
    pub fn surface(&self, patch: InputPatch) -> usize {
        (self.surface_of_patch[patch.0 as usize] & !BACK) as usize
    }

    /// The side of its surface that a patch is.
    pub fn side(&self, patch: InputPatch) -> Side {
        if self.surface_of_patch[patch.0 as usize] & BACK == 0 {
            Side::Front
        } else {
            Side::Back
        }
    }

    /// Index into [`Scene::triangles`] of a patch's triangle.
    pub fn triangle(&self, patch: InputPatch) -> usize {
        self.triangle_of_surface[self.surface(patch)] as usize
    }

    /// A patch's corners, counter-clockwise seen from its radiating side.
    pub fn corners(&self, patch: InputPatch) -> [DVec3; 3] {
        let [a, b, c] = self.surfaces[self.surface(patch)];
        match self.side(patch) {
            Side::Front => [a, b, c],
            Side::Back => [a, c, b],
        }
    }

    /// A patch's area, in the file's unit squared.
    pub fn area(&self, patch: InputPatch) -> f64 {
        let [a, b, c] = self.corners(patch);
        0.5 * (b - a).cross(c - a).length()
    }

    /// A patch's centroid, in the file's unit. The same for both sides of a surface.
    pub fn centroid(&self, patch: InputPatch) -> DVec3 {
        let [a, b, c] = self.surfaces[self.surface(patch)];
        (a + b + c) / 3.0
    }

    /// A patch's unit normal, pointing away from its radiating side. Zero for a patch without area.
    pub fn normal(&self, patch: InputPatch) -> DVec3 {
        let [a, b, c] = self.corners(patch);
        (b - a).cross(c - a).normalize_or_zero()
    }
}

#[cfg(all(test, feature = "generate"))]
mod tests {
    use super::*;
    use crate::generate::cornell_box;

    #[test]
    fn too_many_patches_are_refused_by_a_number_that_is_one() {
        let refused = |subdivision| Patches::new(&cornell_box(), subdivision).unwrap_err().to_string();
        let many = refused(Subdivision::Split(100_000));
        assert!(many.starts_with("400000000000 patches are more than"), "{many}");
        // A saturated count is not given as a number.
        for length in [1e-9, 1e-300, f64::NAN] {
            let refused = refused(Subdivision::PatchSize(length));
            assert!(refused.starts_with("10¹⁸ or more patches are more than"), "{refused}");
        }
    }
}
