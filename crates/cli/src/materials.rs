//! Materials of surfaces: reflectance and emission from the scene, and from a TOML of materials by name, which takes
//! precedence.
//!
//! ```toml
//! bands = ["red", "green", "blue"]        # or any others; one number stands for all bands
//!
//! [default]                               # materials without a value of their own
//! reflectance = 0.5
//!
//! [material.white]
//! reflectance = [0.725, 0.71, 0.68]
//! emission = 0                            # emitted radiosity
//!
//! [material."facade*"]                    # a pattern, for names without an exact entry
//! emissivity = 0.9
//! temperature = 293.15                    # kelvin; or `adiabatic = true`: no net flux
//! ```

use crate::exit::hinted;
use crate::selection;
use anyhow::{Context, Result, anyhow, bail};
use hemicube_scene::{Material, ReadOptions};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The bands of a scene's own materials.
const RGB: [&str; 3] = ["red", "green", "blue"];
/// Names in an error.
const NAMES_SHOWN: usize = 5;
/// Upper bound of temperatures, in kelvin.
const KELVIN_MAX: f64 = 1e6;

/// A number for all bands, or one for each.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum Spectrum {
    Grey(f64),
    Bands(Vec<f64>),
}

/// A table of the file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    reflectance: Option<Spectrum>,
    emission: Option<Spectrum>,
    emissivity: Option<f64>,
    temperature: Option<f64>,
    adiabatic: Option<bool>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tables {
    bands: Option<Vec<String>>,
    #[serde(default)]
    default: Entry,
    #[serde(default)]
    material: BTreeMap<String, Entry>,
}

/// Values of the matrix's materials, from the scene and from the file.
#[derive(Debug)]
pub(crate) struct Materials {
    names: Vec<String>,
    pub(crate) bands: Vec<String>,
    scene: Option<Vec<Material>>,
    entries: Vec<Entry>,
}

/// Reflectance and emission of a material, a number a band.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Optics {
    pub(crate) name: String,
    pub(crate) reflectance: Vec<f64>,
    pub(crate) emission: Vec<f64>,
}

/// A material in an exchange of heat.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Thermal {
    pub(crate) name: String,
    pub(crate) emissivity: f64,
    /// In kelvin; `None` for an adiabatic surface.
    pub(crate) temperature: Option<f64>,
}

impl Materials {
    /// Reads the values of the materials `names` of a matrix from `scene` and from the TOML file `path`.
    ///
    /// # Errors
    /// When a file cannot be read, the scene is another than the matrix's, or the TOML names no material of it.
    pub(crate) fn read(names: &[String], scene: Option<&Path>, path: Option<&Path>, allow_large: bool) -> Result<Self> {
        let optics = scene.map(|scene| of_scene(names, scene, allow_large)).transpose()?;
        let tables: Tables = match path {
            Some(path) => {
                let text = hemicube_scene::read_regular_text(path)
                    .with_context(|| format!("`{}` cannot be read", path.display()))?;
                toml::from_str(&text).map_err(|error: toml::de::Error| {
                    let start = error.span().map_or(0, |span| span.start);
                    let line = 1 + text
                        .as_bytes()
                        .iter()
                        .take(start)
                        .filter(|&&byte| byte == b'\n')
                        .count();
                    let reason = error.message().trim().replace('\n', ", ");
                    anyhow!("{}:{line}: it is no file of materials: {reason}", path.display())
                })?
            }
            None => Tables::default(),
        };
        let shown = path.map_or_else(String::new, |path| format!("`{}`: ", path.display()));
        Self::new(names, optics, tables).map_err(|error| error.context(format!("{shown}the materials do not fit")))
    }

    fn new(names: &[String], scene: Option<Vec<Material>>, tables: Tables) -> Result<Self> {
        let bands = tables.bands.unwrap_or_else(|| RGB.map(str::to_owned).to_vec());
        if bands.is_empty() {
            bail!("`bands` names no band");
        }
        let scene = match scene {
            Some(_) if bands.len() != RGB.len() => {
                bail!(
                    "the scene's reflectances are of {} bands and the file's of {}; leave out `--scene`",
                    RGB.len(),
                    bands.len()
                )
            }
            scene => scene,
        };
        let mut used = BTreeMap::new();
        let mut entries = Vec::new();
        for name in names {
            entries.push(match entry_of(name, &tables.material)? {
                Some((key, entry)) => {
                    used.insert(key.clone(), ());
                    entry.or(&tables.default)
                }
                None => tables.default.clone(),
            });
        }
        if let Some(unused) = tables.material.keys().find(|key| !used.contains_key(*key)) {
            return Err(hinted(anyhow!("`{unused}` matches no material"), there_are(names)));
        }
        Ok(Self {
            names: names.to_vec(),
            bands,
            scene,
            entries,
        })
    }

    /// Reflectance and emission of all materials with patches (`used`, by material).
    ///
    /// # Errors
    /// When one of them has no reflectance, or a value is out of range.
    pub(crate) fn optics(&self, used: &[bool]) -> Result<Vec<Optics>> {
        let mut missing = Vec::new();
        let mut found = Vec::new();
        for (index, (name, entry)) in self.names.iter().zip(&self.entries).enumerate() {
            let of_scene = self.scene.as_ref().and_then(|scene| scene.get(index));
            let own = |value: Option<[f64; 3]>| value.map(|value| value.to_vec());
            let reflectance = match &entry.reflectance {
                Some(value) => Some(self.spectrum(name, "reflectance", value, 1.0)?),
                None => own(of_scene.and_then(|material| material.diffuse)),
            };
            let emission = match &entry.emission {
                Some(value) => Some(self.spectrum(name, "emission", value, f64::MAX)?),
                None => own(of_scene.and_then(|material| material.emission)),
            };
            let is_used = used.get(index).copied().unwrap_or(false);
            if reflectance.is_none() && is_used {
                missing.push(name.clone());
            }
            let none = || vec![0.0; self.bands.len()];
            found.push(Optics {
                name: name.clone(),
                reflectance: reflectance.unwrap_or_else(none),
                emission: emission.unwrap_or_else(none),
            });
        }
        if missing.is_empty() {
            return Ok(found);
        }
        Err(hinted(
            anyhow!("no reflectance is known of {}", listed(&missing)),
            "`--scene SCENE` takes those of the scene's file, `--materials FILE` names others; its table `[default]` \
             is for all that have none",
        ))
    }

    /// Emissivity and temperature of all materials with patches.
    ///
    /// # Errors
    /// When one of them lacks one, or a value is out of range.
    pub(crate) fn thermal(&self, used: &[bool]) -> Result<Vec<Thermal>> {
        let mut missing = Vec::new();
        let mut found = Vec::new();
        for (index, (name, entry)) in self.names.iter().zip(&self.entries).enumerate() {
            let adiabatic = entry.adiabatic.unwrap_or(false);
            let is_used = used.get(index).copied().unwrap_or(false);
            if is_used && !adiabatic && (entry.emissivity.is_none() || entry.temperature.is_none()) {
                missing.push(name.clone());
            }
            let emissivity = if adiabatic {
                0.0
            } else {
                entry.emissivity.unwrap_or(0.0)
            };
            let temperature = entry.temperature.filter(|_| !adiabatic);
            if !(0.0..=1.0).contains(&emissivity) {
                bail!("material `{name}` has an emissivity of {emissivity}; it is from 0 to 1");
            }
            if let Some(kelvin) = temperature
                && !(0.0..=KELVIN_MAX).contains(&kelvin)
            {
                bail!("material `{name}` has a temperature of {kelvin} K; it is in kelvin, from 0 on");
            }
            found.push(Thermal {
                name: name.clone(),
                emissivity,
                temperature,
            });
        }
        if missing.is_empty() {
            return Ok(found);
        }
        Err(hinted(
            anyhow!("no emissivity and temperature are known of {}", listed(&missing)),
            "`--materials FILE` names them: `emissivity = 0.9`, `temperature = 300` (kelvin), or `adiabatic = true`; \
             its table `[default]` is for all that have none",
        ))
    }

    fn spectrum(&self, name: &str, what: &str, value: &Spectrum, most: f64) -> Result<Vec<f64>> {
        let values = match value {
            Spectrum::Grey(value) => vec![*value; self.bands.len()],
            Spectrum::Bands(values) if values.len() == self.bands.len() => values.clone(),
            Spectrum::Bands(values) => bail!(
                "material `{name}` has {} numbers for its {what}, and there are {} bands ({})",
                values.len(),
                self.bands.len(),
                self.bands.join(", ")
            ),
        };
        if let Some(bad) = values.iter().find(|value| !(0.0..=most).contains(*value)) {
            bail!("material `{name}` has a {what} of {bad}, which cannot be");
        }
        Ok(values)
    }
}

impl Entry {
    /// Fills in missing values from `default`.
    fn or(&self, default: &Self) -> Self {
        let mut entry = self.clone();
        entry.reflectance = entry.reflectance.or_else(|| default.reflectance.clone());
        entry.emission = entry.emission.or_else(|| default.emission.clone());
        entry.emissivity = entry.emissivity.or(default.emissivity);
        // Its own temperature excludes the default's `adiabatic`.
        if entry.temperature.is_none() && entry.adiabatic.is_none() {
            entry.adiabatic = default.adiabatic;
        }
        entry.temperature = entry.temperature.or(default.temperature);
        entry
    }
}

/// The entry of a name: its own, otherwise the only pattern that matches.
fn entry_of<'t>(name: &str, tables: &'t BTreeMap<String, Entry>) -> Result<Option<(&'t String, &'t Entry)>> {
    if let Some(exact) = tables.get_key_value(name) {
        return Ok(Some(exact));
    }
    let mut fitting = tables.iter().filter(|(key, _)| selection::matches_glob(key, name));
    match (fitting.next(), fitting.next()) {
        (Some((first, _)), Some((second, _))) => {
            bail!("material `{name}` fits both `{first}` and `{second}`; name it in a table of its own")
        }
        (first, _) => Ok(first),
    }
}

fn of_scene(names: &[String], path: &Path, allow_large: bool) -> Result<Vec<Material>> {
    let scene = hemicube_scene::load(
        path,
        ReadOptions {
            optics: true,
            allow_large,
        },
    )?;
    if !scene.materials.iter().map(|material| &material.name).eq(names) {
        bail!(
            "`{}` is not the scene that the matrix is of: its materials are others",
            path.display()
        );
    }
    Ok(scene.materials)
}

fn listed(names: &[String]) -> String {
    let shown: Vec<String> = names
        .iter()
        .take(NAMES_SHOWN)
        .map(|name| {
            if name.is_empty() {
                "faces without a material".to_owned()
            } else {
                format!("`{name}`")
            }
        })
        .collect();
    match names.len().saturating_sub(NAMES_SHOWN) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

fn there_are(names: &[String]) -> String {
    format!("the matrix has {}", listed(names))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["white", "facade_a", "facade_b", ""].map(str::to_owned).to_vec()
    }

    fn read(text: &str) -> Result<Materials> {
        Materials::new(&names(), None, toml::from_str(text).expect("good TOML"))
    }

    #[test]
    fn names_patterns_and_defaults() {
        let materials = read(
            "[default]\nreflectance = 0.2\n[material.white]\nreflectance = [0.7, 0.6, 0.5]\nemission = 2\n\
             [material.\"facade*\"]\nemission = [1, 0, 0]\n",
        )
        .expect("good materials");
        let optics = materials.optics(&[true; 4]).expect("all known");
        assert_eq!(optics[0].reflectance, [0.7, 0.6, 0.5]);
        assert_eq!(optics[0].emission, [2.0; 3]);
        assert_eq!(optics[1].reflectance, [0.2; 3]);
        assert_eq!(optics[2].emission, [1.0, 0.0, 0.0]);
        assert_eq!(optics[3].reflectance, [0.2; 3]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let error = |text: &str| read(text).map(|_| ()).expect_err(text).to_string();
        assert!(error("[material.wite]\nreflectance = 1").contains("`wite` matches no material"));
        assert!(error("[material.\"f*\"]\n[material.\"*b\"]").contains("fits both"));
        assert!(error("bands = []").contains("no band"));
        let optics = |text: &str| read(text).expect(text).optics(&[true; 4]).expect_err(text).to_string();
        assert!(optics("[material.white]\nreflectance = 0.5").contains("`facade_a`, `facade_b`"));
        assert!(optics("[default]\nreflectance = 1.5").contains("1.5"));
        assert!(optics("bands = [\"a\", \"b\"]\n[default]\nreflectance = [1, 1, 1]").contains("2 bands"));
        assert!(toml::from_str::<Tables>("[default]\nreflectivity = 1").is_err());
        // A material without a patch needs no reflectance.
        assert!(
            read("[material.white]\nreflectance = 0.5")
                .and_then(|m| m.optics(&[true, false, false, false]))
                .is_ok()
        );
    }

    #[test]
    fn heat() {
        let thermal = |text: &str| read(text).expect(text).thermal(&[true; 4]);
        let found = thermal(
            "[default]\nadiabatic = true\n[material.white]\nemissivity = 0.5\ntemperature = 300\n[material.facade_a]\n\
             emissivity = 0.5\n",
        )
        .expect("all known");
        assert_eq!(found[0].temperature, Some(300.0));
        assert_eq!((found[1].emissivity, found[1].temperature), (0.0, None));
        assert!(
            thermal("[default]\nemissivity = 0.9")
                .expect_err("no temperature")
                .to_string()
                .contains("`white`")
        );
        assert!(thermal("[default]\nemissivity = 0.9\ntemperature = -3").is_err());
    }
}
