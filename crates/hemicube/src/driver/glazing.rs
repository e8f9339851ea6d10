//! Mirrors and panes by the names of materials and objects: the tables of a file or a dictionary, and a scene's own.
//!
//! ```toml
//! bands = ["light", "heat"]               # a matrix each; values are one for all of them, or one for each
//!
//! [material."glass*"]                     # a pattern, for names without an exact entry
//! specular = 0.1                          # ρs, reflected as by a mirror
//! transmittance = 0.7                     # τ, let through
//!
//! [object.mirror]                         # an object's values hold, if its material has some, too
//! specular = [0.95, 0.9]
//!
//! [object.window]
//! index = 1.52                            # Fresnel's equations; a pane with a thickness, otherwise a face
//! thickness = 0.006
//! extinction = 8.0
//!
//! [object.blind]
//! angles = [[0, 0.5], [60, 0.3], [90, 0]] # degrees, τ, and ρs where a row has three numbers
//! ```

use super::selection::Patterns;
use crate::portal::{Law, Optics};
use hemicube_scene::{Gloss, Scene};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Why tables tell no mirrors and panes: a sentence, and the next step.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct GlazingError(pub String);

type Result<T> = std::result::Result<T, GlazingError>;

macro_rules! bail {
    ($($words:tt)*) => { return Err(GlazingError(format!($($words)*))) };
}

/// A number for all bands, or one for each.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a number is needed here, or a list of numbers, one a band")]
enum Values {
    All(f64),
    Each(Vec<f64>),
}

impl Values {
    fn of(&self, band: usize) -> f64 {
        match self {
            Self::All(value) => *value,
            Self::Each(values) => values.get(band).copied().unwrap_or(f64::NAN),
        }
    }
}

/// A table of the file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    specular: Option<Values>,
    transmittance: Option<Values>,
    index: Option<Values>,
    thickness: Option<f64>,
    extinction: Option<Values>,
    /// Degrees, τ and, in rows of three, ρs.
    angles: Option<Vec<Vec<f64>>>,
}

impl Entry {
    fn values(&self) -> impl Iterator<Item = &Values> {
        let all = [&self.specular, &self.transmittance, &self.index, &self.extinction];
        all.into_iter().flatten()
    }

    /// The law in a band. `name` is the table's.
    fn law(&self, name: &str, band: usize) -> Result<Law> {
        let of = |values: &Option<Values>| values.as_ref().map_or(0.0, |values| values.of(band));
        if self.index.is_none() && (self.thickness.is_some() || self.extinction.is_some()) {
            bail!("`[{name}]` has a thickness or an extinction without an `index`, by which they tell a pane");
        }
        if self.extinction.is_some() && self.thickness.is_none() {
            bail!("`[{name}]` has an `extinction` and no `thickness` that light goes through");
        }
        let constants = self.specular.is_some() || self.transmittance.is_some();
        if !constants && self.index.is_none() && self.angles.is_none() {
            bail!("`[{name}]` is empty: give it `specular`, `transmittance`, `index` or `angles`");
        }
        for (what, value) in [
            ("thickness", self.thickness),
            ("extinction", Some(of(&self.extinction))),
        ] {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value >= 0.0)) {
                bail!("`[{name}]` has the {what} {value}, and it is a number from 0 on");
            }
        }
        if self.index.is_some() {
            if constants || self.angles.is_some() {
                bail!("`[{name}]` has an `index`, by which its values follow, and values of its own: give one of them");
            }
            let index = of(&self.index);
            return Ok(match self.thickness {
                Some(thickness) => Law::Pane {
                    index,
                    depth: thickness * of(&self.extinction),
                },
                None => Law::Face { index },
            });
        }
        let Some(angles) = &self.angles else {
            return Ok(Law::Constant(Optics {
                specular: of(&self.specular),
                transmittance: of(&self.transmittance),
            }));
        };
        if self.transmittance.is_some() || (self.specular.is_some() && angles.iter().any(|row| row.len() != 2)) {
            bail!("`[{name}]` has `angles` and the same values beside them: give one of them");
        }
        let row = |row: &Vec<f64>| match *row.as_slice() {
            [degrees, transmittance] => Ok((degrees, transmittance, of(&self.specular))),
            [degrees, transmittance, specular] => Ok((degrees, transmittance, specular)),
            _ => bail!(
                "`[{name}]` has a row of {} numbers: `[degrees, τ]` or `[degrees, τ, ρs]` is one",
                row.len()
            ),
        };
        let rows = angles.iter().map(row).map(|row| {
            row.map(|(degrees, transmittance, specular)| {
                let optics = Optics {
                    specular,
                    transmittance,
                };
                (degrees, optics)
            })
        });
        Ok(Law::Table(rows.collect::<Result<_>>()?))
    }
}

/// Mirrors and panes by name: a file, or a dictionary.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glazing {
    bands: Option<Vec<String>>,
    #[serde(default)]
    material: BTreeMap<String, Entry>,
    #[serde(default)]
    object: BTreeMap<String, Entry>,
}

impl Glazing {
    /// Names of the bands, one matrix each; of one where no value has several.
    ///
    /// # Errors
    /// When their numbers differ, or a name cannot name a matrix.
    pub fn bands(&self) -> Result<Vec<String>> {
        let named = self.bands.as_ref().map(|names| ("`bands`".to_owned(), names.len()));
        let entries = (self.material.iter().map(|entry| ("material", entry)))
            .chain(self.object.iter().map(|entry| ("object", entry)));
        let listed = entries.flat_map(|(kind, (name, entry))| {
            let lists = entry.values().filter_map(|values| match values {
                Values::All(_) => None,
                Values::Each(values) => Some(values.len()),
            });
            lists.map(move |length| (format!("`[{kind}.{name:?}]`"), length))
        });
        let mut known: Option<(String, usize)> = named;
        for (name, length) in listed {
            match &known {
                Some((first, count)) if *count != length => {
                    bail!("{first} has {count} bands and {name} {length}");
                }
                Some(_) => {}
                None => known = Some((name, length)),
            }
        }
        let count = known.map_or(1, |(_, count)| count);
        if count == 0 || count > BANDS_MAX {
            bail!("{count} bands are not from 1 to {BANDS_MAX}");
        }
        let names = match &self.bands {
            Some(names) => names.clone(),
            None => (1..=count).map(|band| band.to_string()).collect(),
        };
        let is_fit = |name: &String| !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '_');
        if let Some(name) = names.iter().find(|name| !is_fit(name)) {
            bail!("the band {name:?} names a matrix, and letters, digits and `_` do");
        }
        let distinct: BTreeSet<&String> = names.iter().collect();
        if distinct.len() < names.len() {
            bail!("two bands have one name, and would have one matrix");
        }
        Ok(names)
    }

    /// The laws of a scene's materials and objects in a band.
    ///
    /// # Errors
    /// When a table matches nothing, two patterns match alike, or a table's values exclude each other.
    pub fn laws(&self, scene: &Scene, band: usize) -> Result<[Vec<Option<Law>>; 2]> {
        let materials: Vec<&str> = scene.materials.iter().map(|material| material.name.as_str()).collect();
        let objects: Vec<&str> = scene.objects.iter().map(String::as_str).collect();
        Ok([
            by_name("material", &materials, &self.material, band)?,
            by_name("object", &objects, &self.object, band)?,
        ])
    }
}

/// Most bands: a matrix each.
const BANDS_MAX: usize = 64;

/// The name of a band's matrix: `room-red.hemicube` of `room.hemicube`.
pub fn matrix_of_band(whole: &Path, band: &str) -> PathBuf {
    let part = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
    let stem = part(whole.file_stem()).unwrap_or_default();
    let name = match part(whole.extension()) {
        Some(extension) => format!("{stem}-{band}.{extension}"),
        None => format!("{stem}-{band}"),
    };
    whole.with_file_name(name)
}

/// The laws of a scene's own materials ([`Gloss`]), read with its optics. Colours are averaged.
pub fn laws_of_scene(scene: &Scene) -> Vec<Option<Law>> {
    let mean = |rgb: [f64; 3]| rgb.iter().sum::<f64>() / 3.0;
    let law = |gloss: &Gloss| {
        let (specular, transmittance) = (mean(gloss.specular), mean(gloss.transmittance));
        match gloss.index {
            None => Law::Constant(Optics {
                specular,
                transmittance,
            }),
            Some(index) if transmittance > 0.0 => Law::Pane {
                index,
                depth: -transmittance.ln(),
            },
            Some(index) => Law::Face { index },
        }
    };
    let materials = scene.materials.iter();
    materials.map(|material| material.gloss.as_ref().map(law)).collect()
}

/// The law of each name, by the rule of [`Patterns`].
fn by_name(kind: &str, names: &[&str], tables: &BTreeMap<String, Entry>, band: usize) -> Result<Vec<Option<Law>>> {
    let patterns = Patterns::new(tables);
    let law = |name: &&str| {
        let table = patterns.of(name).map_err(|tie| GlazingError(format!("{kind} {tie}")))?;
        table
            .map(|(key, entry)| entry.law(&format!("{kind}.{key:?}"), band))
            .transpose()
    };
    let found = names.iter().map(law).collect::<Result<_>>()?;
    match patterns.unused(names) {
        Some(unused) => {
            bail!("`[{kind}.\"{unused}\"]` matches no {kind} of the scene")
        }
        None => Ok(found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_go_by_name_then_by_pattern() {
        let glazing: Glazing = serde_json::from_str(
            r#"{"material": {"glass*": {"specular": 0.1, "transmittance": 0.7}, "glass_door": {"specular": 0.2}}}"#,
        )
        .expect("good tables");
        let found = by_name("material", &["wall", "glass_a", "glass_door"], &glazing.material, 0).expect("all fit");
        assert_eq!(found[0], None);
        assert_eq!(found[1].as_ref().map(|law| law.mean().passed()), Some(0.1 + 0.7));
        assert_eq!(found[2].as_ref().map(|law| law.mean().specular), Some(0.2));
        // The most particular pattern holds; of two alike both are named.
        let tables = |json: &str| serde_json::from_str::<BTreeMap<String, Entry>>(json).expect("good tables");
        let nested = tables(r#"{"*": {"specular": 0.5}, "glass*": {"specular": 0.1}, "glass_d*": {"specular": 0.2}}"#);
        let found = by_name("object", &["wall", "glass_a", "glass_door"], &nested, 0).expect("one is most particular");
        let values: Vec<f64> = found.iter().flatten().map(|law| law.mean().specular).collect();
        assert_eq!(values, [0.5, 0.1, 0.2]);
        let alike = tables(r#"{"glass*": {"specular": 0.1}, "*_door": {"specular": 0.2}}"#);
        let tie = by_name("object", &["glass_door"], &alike, 0).expect_err("five characters each");
        assert!(
            tie.to_string()
                .starts_with("object `glass_door` fits both `*_door` and `glass*`"),
            "{tie}"
        );
        // Not used is what matches no name, and not what others go before.
        let before = by_name("object", &["glass_door"], &nested, 0).expect("`*` matches too");
        assert_eq!(before.len(), 1);
        let unused = by_name("material", &["wall"], &glazing.material, 0).expect_err("no glass");
        assert!(unused.to_string().contains("matches no material"), "{unused}");
        assert!(serde_json::from_str::<Glazing>(r#"{"material": {"a": {"reflectance": 1}}}"#).is_err());
    }
}
