//! Mirrors and panes: ρs and τ of surfaces, by material or object.

use super::images::Images;
use glam::DVec3;
use hemicube_scene::{Patches, Scene};
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};

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

    /// Returns whether ρs and τ are shares of one whole.
    pub fn is_valid(&self) -> bool {
        let share = 0.0..=1.0;
        share.contains(&self.specular) && share.contains(&self.transmittance) && self.passed() <= 1.0 + 1e-12
    }
}

/// The mirrors and panes of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Specular {
    /// By patch of the cell.
    optics: Vec<Optics>,
    /// By the names of objects and materials, for the manifest.
    named: BTreeMap<String, Optics>,
    /// A path ends where no more than this share of it is left.
    pub bound: f64,
}

/// Mirrors and panes in a manifest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpecularRecord {
    /// A path ends where no more than this share of it is left.
    pub bound: f64,
    /// Mirrors and panes by `material NAME` and `object NAME`.
    pub surfaces: BTreeMap<String, Optics>,
}

/// Why a scene cannot have such mirrors and panes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpecularError {
    /// ρs or τ or both out of range.
    #[error(
        "{name} has ρs {} and τ {}, and each and both together are from 0 to 1",
        optics.specular,
        optics.transmittance
    )]
    Range {
        /// The material or object.
        name: String,
        /// Its values.
        optics: Optics,
    },
    /// A one-sided pane.
    #[error(
        "pane {name} is one-sided, and its back lets nothing through: wind its faces both ways, or make them two-sided"
    )]
    OneSided {
        /// The material or object.
        name: String,
    },
    /// Nothing of the scene is a mirror or a pane.
    #[error(
        "no patch of the scene is a mirror or a pane: give a material or an object of it `specular` or `transmittance`"
    )]
    None,
}

impl Specular {
    /// The mirrors and panes of a scene by the optics of its materials and of its objects (`None`: none given), of
    /// which the object's hold.
    ///
    /// # Errors
    /// When a value is out of range, or no patch hands on anything.
    ///
    /// # Panics
    /// When `patches` are not of `scene`.
    pub fn new(
        scene: &Scene,
        patches: &Patches,
        materials: &[Option<Optics>],
        objects: &[Option<Optics>],
        bound: f64,
    ) -> Result<Self, SpecularError> {
        let mut named = BTreeMap::new();
        for (of, index_of, values) in [("material", 0, materials), ("object", 1, objects)] {
            for (index, optics) in values.iter().enumerate() {
                let Some(optics) = *optics else { continue };
                let name = if index_of == 0 {
                    scene.materials.get(index).map(|material| material.name.as_str())
                } else {
                    scene.objects.get(index).map(String::as_str)
                };
                let name = format!("{of} {}", name.unwrap_or_default());
                if !optics.is_valid() {
                    return Err(SpecularError::Range { name, optics });
                }
                named.insert(name, optics);
            }
        }
        let of_patch = |patch| {
            let triangle = &scene.triangles[patches.triangle(patch)];
            let of = |values: &[Option<Optics>], index: u32| values.get(index as usize).copied().flatten();
            of(objects, triangle.object)
                .or_else(|| of(materials, triangle.material))
                .unwrap_or_default()
        };
        let optics: Vec<Optics> = patches.iter().map(of_patch).collect();
        // Sides of one triangle that let light through; two, where it is two-sided or given both ways.
        let mut sides: HashMap<[[u64; 3]; 3], u32> = HashMap::new();
        let key = |patch| {
            let mut corners = patches
                .corners(patch)
                .map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
            corners.sort_unstable();
            corners
        };
        let panes = || {
            patches
                .iter()
                .zip(&optics)
                .filter(|(_, optics)| optics.transmittance > 0.0)
        };
        for (patch, _) in panes() {
            *sides.entry(key(patch)).or_default() += 1;
        }
        if let Some((patch, _)) = panes().find(|&(patch, _)| sides.get(&key(patch)) == Some(&1)) {
            let triangle = &scene.triangles[patches.triangle(patch)];
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
        if !optics.iter().any(Optics::is_portal) {
            return Err(SpecularError::None);
        }
        Ok(Self { optics, named, bound })
    }

    /// The optics of a patch of the cell.
    pub fn of(&self, patch: u32) -> Optics {
        self.optics.get(patch as usize).copied().unwrap_or_default()
    }

    /// Likewise for each patch of a model with images.
    pub(super) fn by_patch(&self, images: Option<&Images>, patch_count: u32) -> Vec<Optics> {
        let folded = |patch: u32| images.map_or(Some(patch), |images| images.fold(patch));
        let patches = 0..patch_count;
        patches
            .map(|patch| folded(patch).map_or_else(Optics::default, |patch| self.of(patch)))
            .collect()
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
