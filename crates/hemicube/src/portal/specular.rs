//! Mirrors and panes: ρs and τ of surfaces, by material or object.

use super::images::Images;
use super::law::{Law, LawError, LawRecord};
use glam::DVec3;
use hemicube_scene::{InputPatch, Patches, Scene};
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Division of arriving light: ρs is reflected as by a mirror, τ goes through unbent, and 1 − ρs − τ is absorbed or
/// diffusely reflected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Optics {
    /// ρs, from 0 to 1.
    pub specular: f64,
    /// τ, from 0 to 1 − ρs.
    pub transmittance: f64,
}

impl Optics {
    /// Returns whether it hands on anything.
    pub fn is_portal(&self) -> bool {
        self.specular > 0.0 || self.transmittance > 0.0
    }

    /// ρs + τ.
    pub fn passed(&self) -> f64 {
        self.specular + self.transmittance
    }

    /// Both scaled to a sum of 1 at most, against rounding.
    pub(super) fn within(self) -> Self {
        let over = self.passed().max(1.0);
        Self {
            specular: self.specular / over,
            transmittance: self.transmittance / over,
        }
    }

    /// Returns whether ρs and τ are shares of one whole.
    pub fn is_valid(&self) -> bool {
        let share = 0.0..=1.0;
        share.contains(&self.specular) && share.contains(&self.transmittance) && self.passed() <= 1.0 + 1e-12
    }
}

/// The mirrors and panes of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Specular {
    /// By patch of the cell; means where they depend on the angle.
    optics: Vec<Optics>,
    /// Laws that depend on the angle, and one plus the place of each patch's; empty where none does.
    laws: Vec<Law>,
    law_of: Vec<u16>,
    /// By the names of objects and materials, for the manifest.
    named: BTreeMap<String, LawRecord>,
    /// A path ends where no more than this share of it is left.
    pub bound: f64,
}

/// Mirrors and panes in a manifest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpecularRecord {
    /// A path ends where no more than this share of it is left.
    pub bound: f64,
    /// Mirrors and panes by `material NAME` and `object NAME`.
    pub surfaces: BTreeMap<String, LawRecord>,
}

/// Why a scene cannot have such mirrors and panes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpecularError {
    /// ρs or τ or both out of range.
    #[error("{name} has {reason}")]
    Range {
        /// The material or object.
        name: String,
        /// What is out of range.
        reason: LawError,
    },
    /// More laws than can be told apart.
    #[error("{0} materials and objects have optics by angle, and 65,535 can")]
    Laws(usize),
    /// A one-sided pane.
    #[error(
        "pane {name} is one-sided, and its back lets nothing through: wind its faces both ways, or make them two-sided"
    )]
    OneSided {
        /// The material or object.
        name: String,
    },
    /// A record that is none.
    #[error("the record of {0} says no optics")]
    Record(String),
    /// Nothing of the scene has values.
    #[error(
        "no patch of the scene is a mirror or a pane: give a material or an object of it `specular` or `transmittance`"
    )]
    None,
}

impl Specular {
    /// The mirrors and panes of a scene by the laws of its materials and of its objects (`None`: none given), of
    /// which the object's hold.
    ///
    /// # Errors
    /// When a value is out of range, or no patch has any.
    ///
    /// # Panics
    /// When `patches` are not of `scene`.
    pub fn new<L: Clone + Into<Law>>(
        scene: &Scene,
        patches: &Patches,
        materials: &[Option<L>],
        objects: &[Option<L>],
        bound: f64,
    ) -> Result<Self, SpecularError> {
        let laws = |values: &[Option<L>]| -> Vec<Option<Law>> {
            let laws = values.iter().map(|value| value.clone().map(Into::into));
            laws.collect()
        };
        Self::of_laws(scene, patches, [&laws(materials), &laws(objects)], bound)
    }

    /// The mirrors and panes that a matrix's settings record; `None` without any.
    ///
    /// # Errors
    /// When they are not a record of this scene's.
    pub fn of_settings(scene: &Scene, patches: &Patches, settings: &Value) -> Result<Option<Self>, SpecularError> {
        let record = &settings["portals"]["specular"];
        let (Some(surfaces), Some(bound)) = (record["surfaces"].as_object(), record["bound"].as_f64()) else {
            return Ok(None);
        };
        let of = |name: String| match surfaces.get(&name) {
            None => Ok(None),
            Some(record) => Law::of_record(record).map(Some).ok_or(SpecularError::Record(name)),
        };
        let all = |kind: &str, names: &mut dyn Iterator<Item = &str>| {
            let laws = names.map(|name| of(format!("{kind} {name}")));
            laws.collect::<Result<Vec<Option<Law>>, SpecularError>>()
        };
        let materials = all(
            "material",
            &mut scene.materials.iter().map(|material| material.name.as_str()),
        )?;
        let objects = all("object", &mut scene.objects.iter().map(String::as_str))?;
        Self::of_laws(scene, patches, [&materials, &objects], bound).map(Some)
    }

    fn of_laws(
        scene: &Scene,
        patches: &Patches,
        [materials, objects]: [&[Option<Law>]; 2],
        bound: f64,
    ) -> Result<Self, SpecularError> {
        let mut named = BTreeMap::new();
        for (of, index_of, values) in [("material", 0, materials), ("object", 1, objects)] {
            for (index, optics) in values.iter().enumerate() {
                let Some(law) = optics else { continue };
                let name = if index_of == 0 {
                    scene.materials.get(index).map(|material| material.name.as_str())
                } else {
                    scene.objects.get(index).map(String::as_str)
                };
                let name = format!("{of} {}", name.unwrap_or_default());
                if let Err(reason) = law.check() {
                    return Err(SpecularError::Range { name, reason });
                }
                named.insert(name, law.record());
            }
        }
        // Places of laws: materials, then objects.
        let all: Vec<Option<&Law>> = materials.iter().chain(objects).map(Option::as_ref).collect();
        let means: Vec<Option<Optics>> = all.iter().map(|law| law.map(Law::mean)).collect();
        let varying: Vec<usize> = (0..all.len()).filter(|&at| all[at].is_some_and(Law::varies)).collect();
        let laws: Vec<Law> = varying.iter().filter_map(|&at| all[at].cloned()).collect();
        if laws.len() >= usize::from(u16::MAX) {
            return Err(SpecularError::Laws(laws.len()));
        }
        let place_of = |patch| {
            let triangle = &scene.triangles[patches.triangle(patch)];
            let given = |at: usize| means.get(at).is_some_and(Option::is_some).then_some(at);
            let of_object = given(materials.len() + triangle.object as usize);
            let of_material = (triangle.material as usize) < materials.len();
            of_object.or_else(|| given(triangle.material as usize).filter(|_| of_material))
        };
        let of_patch = |patch| place_of(patch).and_then(|at| means[at]).unwrap_or_default();
        let optics: Vec<Optics> = patches.iter().map(of_patch).collect();
        let number = |patch| {
            let law = place_of(patch).and_then(|at| varying.binary_search(&at).ok());
            law.map_or(0, |law| u16::try_from(law + 1).unwrap_or(0))
        };
        let law_of = if laws.is_empty() {
            Vec::new()
        } else {
            patches.iter().map(number).collect()
        };
        let is_pane = |patch: &InputPatch| optics.get(patch.0 as usize).is_some_and(|o| o.transmittance > 0.0);
        if let Some(triangle) = one_sided(
            scene,
            patches.iter().filter(is_pane).map(|patch| patches.triangle(patch)),
        ) {
            let triangle = &scene.triangles[triangle];
            let object = scene.objects.get(triangle.object as usize).map(String::as_str);
            let material = scene
                .materials
                .get(triangle.material as usize)
                .map(|material| material.name.as_str());
            let name = [material, object].into_iter().flatten().find(|name| !name.is_empty());
            return Err(SpecularError::OneSided {
                name: name.unwrap_or("without a name").to_owned(),
            });
        }
        // Values of 0 are values: glass may be opaque in a band, and F^s is F.
        if !patches.iter().any(|patch| place_of(patch).is_some()) {
            return Err(SpecularError::None);
        }
        Ok(Self {
            optics,
            laws,
            law_of,
            named,
            bound,
        })
    }

    /// No mirrors and panes, for a scene of these patches.
    pub fn none(patches: &Patches) -> Self {
        Self {
            optics: vec![Optics::default(); patches.len()],
            laws: Vec::new(),
            law_of: Vec::new(),
            named: BTreeMap::new(),
            bound: 0.0,
        }
    }

    /// The optics of a patch of the cell; the mean where they depend on the angle.
    pub fn of(&self, patch: u32) -> Optics {
        self.optics.get(patch as usize).copied().unwrap_or_default()
    }

    /// Likewise for each patch of a model with images.
    pub(crate) fn laws(&self, images: Option<&Images>, patch_count: u32) -> Laws {
        let of = |patch: u32| {
            let patch = images.map_or(Some(patch), |images| images.fold(patch))?;
            self.law_of.get(patch as usize).copied()
        };
        let of_patch = if self.laws.is_empty() {
            Vec::new()
        } else {
            (0..patch_count).map(|patch| of(patch).unwrap_or(0)).collect()
        };
        Laws {
            means: self.by_patch(images, patch_count),
            laws: self.laws.clone(),
            of_patch,
        }
    }

    /// The means.
    pub(super) fn by_patch(&self, images: Option<&Images>, patch_count: u32) -> Vec<Optics> {
        let folded = |patch: u32| images.map_or(Some(patch), |images| images.fold(patch));
        let patches = 0..patch_count;
        patches
            .map(|patch| folded(patch).map_or_else(Optics::default, |patch| self.of(patch)))
            .collect()
    }

    /// Number of patches of the cell.
    pub fn patch_count(&self) -> usize {
        self.optics.len()
    }

    /// Patches of the cell with ρs or τ above 0.
    pub fn portals(&self) -> impl Iterator<Item = u32> + '_ {
        (0u32..)
            .zip(&self.optics)
            .filter(|(_, optics)| optics.is_portal())
            .map(|(patch, _)| patch)
    }

    /// For manifests and reports.
    pub fn record(&self) -> SpecularRecord {
        SpecularRecord {
            bound: self.bound,
            surfaces: self.named.clone(),
        }
    }
}

/// The first triangle that lets light through on one side only: neither two-sided nor there both ways, as itself or as
/// a part of its face, whose other side may be cut along the other diagonal. However patches cut a triangle, its
/// corners are those of its other side.
fn one_sided(scene: &Scene, triangles: impl Iterator<Item = usize>) -> Option<usize> {
    let panes: BTreeSet<usize> = triangles.collect();
    let bits = |triangle: usize| {
        let corners = scene.triangles[triangle].corners;
        corners.map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits))
    };
    let mut faces: HashMap<u32, BTreeSet<[u64; 3]>> = HashMap::new();
    let mut sides: HashMap<[[u64; 3]; 3], u32> = HashMap::new();
    let key = |triangle: usize| {
        let mut corners = bits(triangle);
        corners.sort_unstable();
        corners
    };
    for &triangle in &panes {
        let count = if scene.triangles[triangle].two_sided { 2 } else { 1 };
        *sides.entry(key(triangle)).or_default() += count;
        faces
            .entry(scene.triangles[triangle].face)
            .or_default()
            .extend(bits(triangle));
    }
    let mut of_corners: HashMap<&BTreeSet<[u64; 3]>, u32> = HashMap::new();
    for corners in faces.values() {
        *of_corners.entry(corners).or_default() += 1;
    }
    panes.iter().copied().find(|&triangle| {
        let face = faces.get(&scene.triangles[triangle].face);
        let is_there_twice = face
            .and_then(|face| of_corners.get(face))
            .is_some_and(|&count| count > 1);
        sides.get(&key(triangle)) == Some(&1) && !is_there_twice
    })
}

/// The optics of each patch of a model, at every angle.
#[derive(Clone, Debug, Default)]
pub(crate) struct Laws {
    /// Hemispherical means.
    pub(crate) means: Vec<Optics>,
    laws: Vec<Law>,
    /// One plus the place of a patch's law, 0 for constants; empty where all are.
    of_patch: Vec<u16>,
}

impl Laws {
    /// The optics of a patch met at an angle, by the cosine from its normal, of either sign; none of a side that is no
    /// patch.
    pub(crate) fn at(&self, patch: u32, cosine: f64) -> Optics {
        match self.law(patch) {
            Some(law) => law.at(cosine.abs()),
            None => self.means.get(patch as usize).copied().unwrap_or_default(),
        }
    }

    /// Returns whether those of a patch depend on the angle.
    pub(crate) fn varies(&self, patch: u32) -> bool {
        self.law(patch).is_some()
    }

    fn law(&self, patch: u32) -> Option<&Law> {
        let number = *self.of_patch.get(patch as usize)?;
        usize::from(number).checked_sub(1).and_then(|at| self.laws.get(at))
    }
}
