//! Materials: names, sidedness and, when asked for, reflectance and emission.

use super::json::{Document, Object};
use crate::{Error, Gloss, Ledger, Material, ReadOptions};

/// The materials of a file, read when first used.
pub(super) struct Materials<'d, 'v> {
    document: &'d Document<'v>,
    options: ReadOptions,
    /// By index in the file, one more for primitives without a material: position in `used` and sidedness.
    resolved: Vec<Option<(u32, bool)>>,
    used: Vec<Material>,
}

impl<'d, 'v> Materials<'d, 'v> {
    pub(super) fn new(document: &'d Document<'v>, options: ReadOptions) -> Self {
        Self {
            document,
            options,
            resolved: vec![None; document.materials.len() + 1],
            used: Vec::new(),
        }
    }

    /// The materials in order of first use.
    pub(super) fn into_used(self) -> Vec<Material> {
        self.used
    }

    /// Position among the used materials of the one with this index in the file, and whether it is two-sided.
    pub(super) fn resolve(&mut self, index: Option<usize>, ledger: &mut Ledger) -> Result<(u32, bool), Error> {
        let slot = index.unwrap_or(self.document.materials.len());
        if let Some(Some(resolved)) = self.resolved.get(slot) {
            return Ok(*resolved);
        }
        let position = u32::try_from(self.used.len()).map_err(|_| super::too_many_objects())?;
        let (material, two_sided) = match index {
            None => (Material::default(), false),
            Some(index) => {
                let object = self.document.materials.get(index)?;
                let name = object
                    .name()
                    .map_or_else(|| format!("material {index}"), |n| super::cut(n).to_owned());
                let mut material = Material {
                    name,
                    ..Material::default()
                };
                if self.options.optics {
                    read_optics(&object, &mut material, ledger)?;
                }
                (material, object.boolean("doubleSided")?.unwrap_or(false))
            }
        };
        self.used.push(material);
        if let Some(resolved) = self.resolved.get_mut(slot) {
            *resolved = Some((position, two_sided));
        }
        Ok((position, two_sided))
    }
}

/// A surface without roughness that is all metal, or lets light through.
fn gloss(object: &Object<'_>, surface: &Object<'_>, colour: [f64; 3], metallic: f64) -> Result<Option<Gloss>, Error> {
    if surface.number("roughnessFactor")?.unwrap_or(1.0) > 0.0 {
        return Ok(None);
    }
    let colour = colour.map(|c| c.clamp(0.0, 1.0));
    if metallic >= 1.0 {
        return Ok(Some(Gloss {
            specular: colour,
            ..Gloss::default()
        }));
    }
    let factor = match object.extension("KHR_materials_transmission")? {
        Some(extension) => extension.number("transmissionFactor")?.unwrap_or(0.0).clamp(0.0, 1.0),
        None => 0.0,
    };
    if factor == 0.0 || metallic > 0.0 {
        return Ok(None);
    }
    let index = match object.extension("KHR_materials_ior")? {
        Some(extension) => extension.number("ior")?.unwrap_or(INDEX_OF_GLASS),
        None => INDEX_OF_GLASS,
    };
    Ok(Some(Gloss {
        specular: [0.0; 3],
        transmittance: colour.map(|c| c * factor),
        index: Some(index),
    }))
}

/// The index of refraction where a file gives none.
const INDEX_OF_GLASS: f64 = 1.5;

fn read_optics(object: &Object<'_>, material: &mut Material, ledger: &mut Ledger) -> Result<(), Error> {
    if let Some(surface) = object.object("pbrMetallicRoughness")? {
        let [r, g, b, _] = surface.numbers::<4>("baseColorFactor")?.unwrap_or([1.0; 4]);
        let metallic = surface.number("metallicFactor")?.unwrap_or(1.0);
        let diffuse = [r, g, b].map(|colour| colour * (1.0 - metallic));
        if diffuse.iter().any(|d| !(0.0..=1.0).contains(d)) {
            ledger.note("reflectance outside 0 to 1, clamped");
        }
        material.diffuse = Some(diffuse.map(|d| d.clamp(0.0, 1.0)));
        material.gloss = gloss(object, &surface, [r, g, b], metallic)?;
        for texture in ["baseColorTexture", "metallicRoughnessTexture"] {
            if surface.has(texture) {
                ledger.note("reflectance texture not read");
            }
        }
    }
    if object.has_extension(&["KHR_materials_pbrSpecularGlossiness"])? {
        ledger.note("KHR_materials_pbrSpecularGlossiness not read");
    }
    if let Some(factor) = object.numbers::<3>("emissiveFactor")? {
        let strength = match object.extension("KHR_materials_emissive_strength")? {
            Some(extension) => extension.number("emissiveStrength")?.unwrap_or(1.0),
            None => 1.0,
        };
        if factor.iter().any(|f| *f < 0.0) || strength < 0.0 {
            ledger.note("negative emission, read as none");
        }
        material.emission = Some(factor.map(|f| (f * strength).max(0.0)));
        if object.has("emissiveTexture") {
            ledger.note("emission texture not read");
        }
    }
    Ok(())
}
