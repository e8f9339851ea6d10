//! The patch table of patches that are several elements.

use super::{Error, PatchTable, Result, Store};
use crate::grouping::{Grouping, PatchKind};
use glam::DVec3;
use hemicube_scene::{Patches, Scene};

/// Distance from a plane, in diameters of the patch's box, up to which elements lie in it, and the least cosine of
/// their normals with the plane's: single precision moves corners so far, and tilts small elements up to 2⁻¹⁰.
const IN_PLANE: f64 = 1e-6;
const UPRIGHT: f64 = 1.0 - 5e-7;

/// Most of itself that a patch of several elements in one plane may see: they are in it to rounding.
const FLAT_SELF: f64 = 1e-3;

/// Sums over the elements of a patch.
#[derive(Clone, Copy, Debug)]
struct Sums {
    area: f64,
    /// The largest element's, for its plane.
    largest: f64,
    normal: DVec3,
    point: DVec3,
    /// Σ A n.
    facing: DVec3,
    min: DVec3,
    max: DVec3,
    is_flat: bool,
}

impl PatchTable {
    /// The table of a grouping's patches: area Σ A, centroid Σ A c / Σ A, and the unit normal where all elements lie in
    /// one plane (to 10⁻⁶ of the patch's box, tilted to 10⁻³) and face one way; zero elsewhere. Face, object and
    /// material are [`Self::SEVERAL`] where the elements have several. O(elements).
    pub fn grouped(scene: &Scene, patches: &Patches, grouping: &Grouping) -> Self {
        let mut table = Self::default();
        let mut sums: Vec<Sums> = Vec::with_capacity(grouping.len());
        for element in patches.iter() {
            let patch = grouping.patch_of(element).0 as usize;
            let triangle = &scene.triangles[patches.triangle(element)];
            let (area, centroid) = (patches.area(element), patches.centroid(element));
            let side = u8::from(patches.side(element) == hemicube_scene::Side::Back);
            // Patches are numbered by their first elements.
            if patch == sums.len() {
                table.face.push(triangle.face);
                table.object.push(triangle.object);
                table.material.push(triangle.material);
                table.side.push(side);
                table.centroid.push([0.0; 3]);
                sums.push(Sums {
                    area: 0.0,
                    largest: 0.0,
                    normal: DVec3::ZERO,
                    point: centroid,
                    facing: DVec3::ZERO,
                    min: DVec3::INFINITY,
                    max: DVec3::NEG_INFINITY,
                    is_flat: true,
                });
            }
            // Elements of one patch share its name, numbered by the first of them.
            let kind = grouping.kind();
            for (own, of_element, of_kind) in [
                (&mut table.face[patch], triangle.face, PatchKind::Face),
                (&mut table.object[patch], triangle.object, PatchKind::Object),
                (&mut table.material[patch], triangle.material, PatchKind::Material),
            ] {
                if *own != of_element && kind != of_kind {
                    *own = Self::SEVERAL;
                }
            }
            table.side[patch] &= side;
            let own = &mut sums[patch];
            own.area += area;
            own.facing += area * patches.normal(element);
            if area > own.largest {
                (own.largest, own.normal, own.point) = (area, patches.normal(element), centroid);
            }
            for corner in patches.corners(element) {
                (own.min, own.max) = (own.min.min(corner), own.max.max(corner));
            }
            let mean = DVec3::from_array(table.centroid[patch]) + area * centroid;
            table.centroid[patch] = mean.to_array();
        }
        for element in patches.iter() {
            let own = &mut sums[grouping.patch_of(element).0 as usize];
            let reach = IN_PLANE * own.min.distance(own.max);
            let off = |corner: DVec3| (corner - own.point).dot(own.normal).abs();
            own.is_flat &= patches.normal(element).dot(own.normal) >= UPRIGHT
                && patches.corners(element).into_iter().all(|corner| off(corner) <= reach);
        }
        for (own, centroid) in sums.iter().zip(&mut table.centroid) {
            *centroid = (DVec3::from_array(*centroid) / own.area).to_array();
            let normal = if own.is_flat {
                own.facing.normalize_or_zero()
            } else {
                DVec3::ZERO
            };
            table.normal.push(normal.to_array());
            table.area.push(own.area);
        }
        table
    }

    /// The table of a scene's patches: its elements, or those of a grouping.
    pub fn of(scene: &Scene, patches: &Patches, grouping: Option<&Grouping>) -> Self {
        match grouping {
            Some(grouping) => Self::grouped(scene, patches, grouping),
            None => Self::new(scene, patches),
        }
    }

    /// Returns whether a patch lies in one plane, so that it cannot see itself.
    ///
    /// # Panics
    /// When there is no such patch.
    pub fn is_flat(&self, patch: usize) -> bool {
        self.normal[patch] != [0.0; 3]
    }

    /// The most of itself that each patch may see: nothing of a triangle, [`FLAT_SELF`] of several elements in one plane,
    /// anything of several that lie in none, and through portals.
    #[doc(hidden)]
    pub fn most_of_itself(&self, kind: PatchKind, has_portals: bool) -> Vec<f64> {
        let most = |patch: usize| match (has_portals, kind.is_triangle()) {
            (true, _) => f64::INFINITY,
            (false, true) => 0.0,
            (false, false) if self.is_flat(patch) => FLAT_SELF,
            (false, false) => 1.0,
        };
        (0..self.len()).map(most).collect()
    }

    /// The name of a patch of several elements: of its object or material, or the number of its face, from 0, with
    /// `back` for a back; `None` for triangles. Objects and materials are the manifest's.
    ///
    /// # Panics
    /// When there is no such patch.
    pub fn name(&self, patch: usize, kind: PatchKind, objects: &[String], materials: &[String]) -> Option<String> {
        let named = |names: &[String], index: u32| names.get(index as usize).cloned().unwrap_or_default();
        match kind {
            PatchKind::Triangle => None,
            PatchKind::Object => Some(named(objects, self.object[patch])),
            PatchKind::Material => Some(named(materials, self.material[patch])),
            PatchKind::Face if self.side[patch] == 0 => Some(self.face[patch].to_string()),
            PatchKind::Face => Some(format!("{} back", self.face[patch])),
        }
    }

    /// The names of all patches of several elements, as of [`Self::name`]; `None` for triangles.
    pub fn names(&self, kind: PatchKind, objects: &[String], materials: &[String]) -> Option<Vec<String>> {
        (0..self.len())
            .map(|patch| self.name(patch, kind, objects, materials))
            .collect()
    }
}

impl Grouping {
    /// The patches of a store's scene, made anew; `None` for triangles. The scene is to have the store's hash.
    ///
    /// # Errors
    /// [`Error::Unsupported`] when the scene has another number of patches.
    pub fn of_store(store: &Store, scene: &Scene, patches: &Patches) -> Result<Option<Self>> {
        let kind = store.manifest().patch_kind();
        let grouping = Self::new(scene, patches, kind);
        let count = grouping.as_ref().map_or(patches.len(), Self::len);
        if count == store.patch_count() as usize {
            return Ok(grouping);
        }
        let reason = format!(
            "has {} patches, and the scene has {count} by {}: it is of another scene",
            store.patch_count(),
            kind.name()
        );
        Err(Error::unsupported(store.directory(), reason))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::{Subdivision, generate};

    #[test]
    fn flat_patches_have_a_normal_and_others_none() {
        let scene = generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::Split(3)).unwrap();
        let grouping = Grouping::new(&scene, &patches, PatchKind::Object).unwrap();
        let table = PatchTable::grouped(&scene, &patches, &grouping);
        assert!(table.is_of(u32::try_from(grouping.len()).unwrap()));
        let all: f64 = patches.iter().map(|element| patches.area(element)).sum();
        assert!((table.area.iter().sum::<f64>() / all - 1.0).abs() < 1e-12);
        for (patch, &object) in table.object.iter().enumerate() {
            let name = scene.objects[object as usize].as_str();
            // The corners of the measured left wall lie in no plane.
            let is_bent = name.ends_with("block") || name == "left_wall";
            assert_eq!(table.is_flat(patch), !is_bent, "{name}");
        }
        assert!(table.material.contains(&0) && table.face.contains(&PatchTable::SEVERAL));
        let floor = table
            .object
            .iter()
            .position(|&object| scene.objects[object as usize] == "floor");
        assert_eq!(table.normal[floor.unwrap()], [0.0, 1.0, 0.0]);
    }
}
