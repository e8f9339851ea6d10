//! Patches that are several elements: faces of the scene's file, objects, or materials.
//!
//! Rows and columns of a matrix are *patches*. A patch is one triangle, or the triangles of a face, an object or a
//! material. Its triangles, as cut, are then its *elements*: hemicubes stand on them, and visibility and closed forms
//! are theirs (the words of Cohen, Greenberg, Immel & Brock 1986, *An Efficient Radiosity Approach for Realistic Image
//! Synthesis*). With A the areas of elements,
//!
//! ```text
//! F_IJ = Σ_{i∈I} A_i Σ_{j∈J} F_ij / Σ_{i∈I} A_i
//! ```
//!
//! (Siegel & Howell 2002, *Thermal Radiation Heat Transfer*, view-factor algebra). F_II is 0 where all elements of I
//! lie in one plane; elsewhere a patch may see itself.

use hemicube_scene::{InputPatch, Patches, Scene, Side};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Kind of the patches of a matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PatchKind {
    /// Triangles, as cut: a patch is its own and only element.
    #[default]
    Triangle,
    /// Faces of the file, its polygons, quads or cells; the two sides of a two-sided face are two patches.
    Face,
    /// Objects; those of one name are one patch, both sides together.
    Object,
    /// Materials; those of one name are one patch, both sides together.
    Material,
}

impl PatchKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Triangle, Self::Face, Self::Object, Self::Material];

    /// The name in settings, options and manifests.
    pub fn name(self) -> &'static str {
        match self {
            Self::Triangle => "triangle",
            Self::Face => "face",
            Self::Object => "object",
            Self::Material => "material",
        }
    }

    /// The kind of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns whether patches are single triangles.
    #[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks with a reference")]
    pub fn is_triangle(&self) -> bool {
        *self == Self::Triangle
    }
}

/// The patch of each element of a scene. Patches are numbered in the order of their first elements, in input order.
///
/// ```
/// use hemicube_store::{Grouping, PatchKind};
/// use hemicube_scene::{InputPatch, Patches, Subdivision, generate};
///
/// let scene = generate::cornell_box();
/// let patches = Patches::new(&scene, Subdivision::Split(3))?;
/// let objects = Grouping::new(&scene, &patches, PatchKind::Object).ok_or("triangles are no groups")?;
/// assert_eq!((objects.elements(), objects.len()), (patches.len(), scene.objects.len()));
/// assert_eq!(objects.patch_of(InputPatch(0)), InputPatch(0));
///
/// // A mean over each patch, and each patch's value on all of its elements.
/// let areas: Vec<f64> = patches.iter().map(|element| patches.area(element)).collect();
/// let means = objects.means(&vec![0.25; patches.len()], &areas);
/// assert_eq!(objects.spread(&means), vec![0.25; patches.len()]);
/// assert!(Grouping::new(&scene, &patches, PatchKind::Triangle).is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grouping {
    kind: PatchKind,
    patch_of: Vec<u32>,
    len: usize,
}

impl Grouping {
    /// Groups the elements of a scene; `None` for triangles. O(elements).
    pub fn new(scene: &Scene, patches: &Patches, kind: PatchKind) -> Option<Self> {
        let name = |names: Option<&String>| names.map_or("", String::as_str).to_owned();
        // One number for all objects, or materials, of a name.
        let (mut by_name, mut numbers) = (HashMap::new(), Vec::new());
        let mut number_all = |names: &mut dyn Iterator<Item = String>| {
            for name in names {
                let next = by_name.len() as u64;
                numbers.push(*by_name.entry(name).or_insert(next));
            }
        };
        match kind {
            PatchKind::Triangle => return None,
            PatchKind::Face => {}
            PatchKind::Object => number_all(&mut scene.objects.iter().map(|object| name(Some(object)))),
            PatchKind::Material => number_all(&mut scene.materials.iter().map(|m| name(Some(&m.name)))),
        }
        let mut by_key: HashMap<u64, u32> = HashMap::new();
        let mut patch_of = Vec::with_capacity(patches.len());
        for element in patches.iter() {
            let triangle = &scene.triangles[patches.triangle(element)];
            let number = |index: u32| numbers.get(index as usize).copied().unwrap_or(u64::MAX);
            let key = match kind {
                PatchKind::Object => number(triangle.object),
                PatchKind::Material => number(triangle.material),
                _ => 2 * u64::from(triangle.face) + u64::from(patches.side(element) == Side::Back),
            };
            #[allow(clippy::cast_possible_truncation, reason = "no more patches than elements")]
            let next = by_key.len() as u32;
            patch_of.push(*by_key.entry(key).or_insert(next));
        }
        Some(Self {
            kind,
            patch_of,
            len: by_key.len(),
        })
    }

    /// The grouping of more elements, each of which stands for one of these, or is a patch of its own.
    #[doc(hidden)]
    pub fn of_images(&self, elements: u32, stands_for: impl Fn(u32) -> Option<u32>) -> Self {
        let mut len = self.len;
        let patch_of = (0..elements).map(|element| match stands_for(element) {
            Some(own) => self.patch_of[own as usize],
            None => {
                len += 1;
                u32::try_from(len - 1).unwrap_or(u32::MAX)
            }
        });
        Self {
            kind: self.kind,
            patch_of: patch_of.collect(),
            len,
        }
    }

    /// The kind of the patches.
    pub fn kind(&self) -> PatchKind {
        self.kind
    }

    /// Number of patches.
    #[allow(clippy::len_without_is_empty, reason = "a scene without an element is no model")]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.patch_of.len()
    }

    /// The patch of an element.
    ///
    /// # Panics
    /// When there is no such element.
    pub fn patch_of(&self, element: InputPatch) -> InputPatch {
        InputPatch(self.patch_of[element.0 as usize])
    }

    /// The patch of each element, by its number.
    pub fn patches(&self) -> &[u32] {
        &self.patch_of
    }

    /// The elements of some patches, in input order within each: O(elements).
    pub fn elements_of(&self, patches: &[InputPatch]) -> Vec<Vec<InputPatch>> {
        let place: HashMap<u32, usize> = patches
            .iter()
            .enumerate()
            .map(|(place, patch)| (patch.0, place))
            .collect();
        let mut found = vec![Vec::new(); patches.len()];
        for (element, patch) in (0..).zip(&self.patch_of) {
            if let Some(&place) = place.get(patch) {
                found[place].push(InputPatch(element));
            }
        }
        found
    }

    /// The value of its patch for each element.
    ///
    /// # Panics
    /// When there are fewer values than patches.
    pub fn spread<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.patch_of.iter().map(|&patch| values[patch as usize]).collect()
    }

    /// The area-weighted mean of each patch, of a value for each element; NaN where no element has a number.
    pub fn means(&self, values: &[f64], areas: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.len];
        for ((&patch, &value), &area) in self.patch_of.iter().zip(values).zip(areas) {
            if !value.is_nan() {
                let sum = &mut sums[patch as usize];
                *sum = (sum.0 + area * value, sum.1 + area);
            }
        }
        sums.into_iter().map(|(sum, area)| sum / area).collect()
    }

    /// The first patch of which some elements are chosen and others not, and how many are, of how many.
    pub fn partly(&self, chosen: &[bool]) -> Option<(InputPatch, u64, u64)> {
        let mut counts = vec![(0_u64, 0_u64); self.len];
        for (&patch, &chosen) in self.patch_of.iter().zip(chosen) {
            let count = &mut counts[patch as usize];
            *count = (count.0 + u64::from(chosen), count.1 + 1);
        }
        let partly = |&(_, (chosen, all)): &(u32, (u64, u64))| chosen > 0 && chosen < all;
        let found = (0..).zip(counts).find(partly);
        found.map(|(patch, (chosen, all))| (InputPatch(patch), chosen, all))
    }

    /// The name of a patch, as people read it: of its object or material, or the number of its face from 0, with `back`
    /// for a back.
    pub fn name_of(&self, patch: InputPatch, scene: &Scene, patches: &Patches) -> String {
        let Some(element) = self.patch_of.iter().position(|&of| of == patch.0) else {
            return String::new();
        };
        let element = InputPatch(u32::try_from(element).unwrap_or(u32::MAX));
        let triangle = &scene.triangles[patches.triangle(element)];
        match self.kind {
            PatchKind::Object => scene.objects.get(triangle.object as usize).cloned().unwrap_or_default(),
            PatchKind::Material => {
                let material = scene.materials.get(triangle.material as usize);
                material.map(|material| material.name.clone()).unwrap_or_default()
            }
            _ if patches.side(element) == Side::Back => format!("{} back", triangle.face),
            _ => triangle.face.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::{Subdivision, generate};

    #[test]
    fn objects_of_one_name_are_one_patch_and_sides_of_a_face_are_two() {
        let mut scene = generate::cornell_box();
        scene
            .triangles
            .iter_mut()
            .for_each(|triangle| triangle.two_sided = true);
        let count = |scene: &Scene, kind| {
            let patches = Patches::new(scene, Subdivision::Split(2)).unwrap();
            Grouping::new(scene, &patches, kind).map(|grouping| grouping.len())
        };
        let mut faces: Vec<u32> = scene.triangles.iter().map(|triangle| triangle.face).collect();
        faces.dedup();
        assert_eq!(count(&scene, PatchKind::Face), Some(2 * faces.len()));
        let objects = scene.objects.len();
        assert_eq!(count(&scene, PatchKind::Object), Some(objects));
        let last = scene.objects[objects - 1].clone();
        scene.objects[0] = last;
        assert_eq!(count(&scene, PatchKind::Object), Some(objects - 1));
        assert_eq!(count(&scene, PatchKind::Triangle), None);
    }

    #[test]
    fn a_patch_chosen_in_part_is_found() {
        let scene = generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::None).unwrap();
        let grouping = Grouping::new(&scene, &patches, PatchKind::Object).unwrap();
        let mut chosen: Vec<bool> = grouping.patches().iter().map(|&patch| patch == 2).collect();
        assert_eq!(grouping.partly(&chosen), None);
        let one = chosen.iter().position(|&chosen| chosen).unwrap();
        chosen[one] = false;
        let all = grouping.patches().iter().filter(|&&patch| patch == 2).count() as u64;
        assert_eq!(grouping.partly(&chosen), Some((InputPatch(2), all - 1, all)));
    }
}
