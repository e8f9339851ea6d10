//! Portals of a run: mirrors and panes from a TOML file, planes of symmetry, sectors and periods from the command line.
//!
//! ```toml
//! [material."glass*"]                     # a pattern, for names without an exact entry
//! specular = 0.1                          # ρs, reflected as by a mirror
//! transmittance = 0.7                     # τ, let through
//!
//! [object.mirror]                         # an object's values hold, if its material has some, too
//! specular = 0.95
//! ```

use crate::exit::hinted;
use crate::prepare::Prepared;
use crate::selection::matches_glob;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hemicube::HierarchyOptions;
use hemicube::portal::{ImageError, ImageSettings, Images, Optics, Period, Portals, Sector, Specular, Symmetry};
use hemicube_scene::Axis;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Mirrors, panes, symmetry and periods
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mirrors, glass, symmetry")]
pub(crate) struct PortalSettings {
    /// Follow mirrors and panes: `[material.NAME]`, `specular = 0.9`
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) specular: Option<PathBuf>,
    /// End a path where no more than B of it is left; a twentieth of the tolerance, or 1e-4
    #[arg(long, value_name = "B", value_parser = bound, requires = "specular", hide_short_help = true)]
    pub(crate) specular_bound: Option<f64>,
    /// The scene is one side of these planes: `x=0,y=5`
    #[arg(long, value_name = "AXIS=AT,…", value_delimiter = ',', value_parser = symmetry, allow_hyphen_values = true)]
    pub(crate) symmetry: Vec<Symmetry>,
    /// The scene is one of N sectors about an axis through 0: `z,12`
    #[arg(long, value_name = "AXIS,N", value_parser = sector)]
    pub(crate) sector: Option<Sector>,
    /// The scene repeats: `x=0..100,y=0..80`
    #[arg(long, value_name = "AXIS=A..B,…", value_delimiter = ',', value_parser = period, allow_hyphen_values = true)]
    pub(crate) periodic: Vec<Period>,
    /// Repeats on either side of a period; by default as many as take what is cut off to a tenth of the tolerance
    #[arg(
        long,
        value_name = "R",
        value_parser = clap::value_parser!(u32).range(0..=1000),
        requires = "periodic",
        hide_short_help = true
    )]
    pub(crate) repeats: Option<u32>,
}

fn bound(text: &str) -> Result<f64, String> {
    let bound = crate::args::number(text)?;
    if (0.0..1.0).contains(&bound) {
        Ok(bound)
    } else {
        Err("a share from 0 up to 1 is needed, such as `1e-4`".to_owned())
    }
}

fn axis(text: &str) -> Result<Axis, String> {
    match text.trim() {
        "x" => Ok(Axis::X),
        "y" => Ok(Axis::Y),
        "z" => Ok(Axis::Z),
        _ => Err(format!("`{text}` is no axis: x, y or z is")),
    }
}

fn finite(text: &str) -> Result<f64, String> {
    let number = crate::args::number(text.trim()).map_err(|_| format!("`{text}` is no number"))?;
    if number.is_finite() {
        Ok(number)
    } else {
        Err(format!("`{text}` is not finite"))
    }
}

fn symmetry(text: &str) -> Result<Symmetry, String> {
    let (name, at) = text.split_once('=').ok_or("a plane is needed, such as `x=0`")?;
    Ok(Symmetry {
        axis: axis(name)?,
        at: finite(at)?,
    })
}

fn sector(text: &str) -> Result<Sector, String> {
    let (name, count) = text
        .split_once(',')
        .ok_or("an axis and a number are needed, such as `z,12`")?;
    let count = count
        .trim()
        .parse()
        .map_err(|_| format!("`{count}` is no number of sectors"))?;
    Ok(Sector {
        axis: axis(name)?,
        count,
    })
}

fn period(text: &str) -> Result<Period, String> {
    let (name, range) = text.split_once('=').ok_or("a period is needed, such as `x=0..100`")?;
    let (low, high) = range
        .split_once("..")
        .ok_or("a period has a beginning and an end, such as `x=0..100`")?;
    let (low, high) = (finite(low)?, finite(high)?);
    if low < high {
        Ok(Period {
            axis: axis(name)?,
            low,
            high,
        })
    } else {
        Err(format!("a period ends after its beginning: {low} is not below {high}"))
    }
}

/// A table of the file.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    #[serde(default)]
    specular: f64,
    #[serde(default)]
    transmittance: f64,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tables {
    #[serde(default)]
    material: BTreeMap<String, Entry>,
    #[serde(default)]
    object: BTreeMap<String, Entry>,
}

impl PortalSettings {
    /// Returns whether there is a portal.
    pub(crate) fn is_given(&self) -> bool {
        self.specular.is_some() || !self.symmetry.is_empty() || self.sector.is_some() || !self.periodic.is_empty()
    }

    /// The portals of a scene, whose model gets the images.
    ///
    /// # Errors
    /// When the file cannot be read, names nothing of the scene, or the scene does not fit the planes, the sector or
    /// the period.
    pub(crate) fn portals(
        &self,
        prepared: &mut Prepared,
        hierarchy: HierarchyOptions,
        tolerance: Option<f64>,
    ) -> Result<Portals> {
        let settings = ImageSettings {
            symmetry: self.symmetry.clone(),
            sector: self.sector,
            periods: self.periodic.clone(),
            repeats: self.repeats,
            bound: tolerance.unwrap_or(0.01) / 10.0,
        };
        let images = if settings.is_empty() {
            None
        } else {
            let (model, images) = Images::model(settings, &prepared.scene, &prepared.patches, hierarchy)
                .map_err(|error| explain(error, &prepared.input.path))?;
            prepared.model = model;
            Some(images)
        };
        let bound = self
            .specular_bound
            .unwrap_or_else(|| tolerance.map_or(1e-4, |tolerance| tolerance / 20.0));
        let specular = self
            .specular
            .as_deref()
            .map(|path| specular(path, prepared, bound))
            .transpose()?;
        Ok(Portals { images, specular })
    }
}

fn explain(error: ImageError, path: &str) -> anyhow::Error {
    anyhow!("`{path}`: {error}")
}

/// The mirrors and panes of a scene, by a file.
fn specular(path: &Path, prepared: &Prepared, bound: f64) -> Result<Specular> {
    let text =
        hemicube_scene::read_regular_text(path).with_context(|| format!("`{}` cannot be read", path.display()))?;
    let tables: Tables = toml::from_str(&text).map_err(|error: toml::de::Error| {
        let start = error.span().map_or(0, |span| span.start);
        let line = 1 + text
            .as_bytes()
            .iter()
            .take(start)
            .filter(|&&byte| byte == b'\n')
            .count();
        let reason = error.message().trim().replace('\n', ", ");
        anyhow!(
            "{}:{line}: it is no file of mirrors and panes: {reason}",
            path.display()
        )
    })?;
    let scene = &prepared.scene;
    let materials: Vec<&str> = scene.materials.iter().map(|material| material.name.as_str()).collect();
    let objects: Vec<&str> = scene.objects.iter().map(String::as_str).collect();
    let read = || -> Result<Specular> {
        let materials = by_name("material", &materials, &tables.material)?;
        let objects = by_name("object", &objects, &tables.object)?;
        Ok(Specular::new(scene, &prepared.patches, &materials, &objects, bound)?)
    };
    read().with_context(|| format!("`{}` does not fit `{}`", path.display(), prepared.input.path))
}

/// The optics of each name: of its own table, otherwise of the only pattern that matches.
fn by_name(kind: &str, names: &[&str], tables: &BTreeMap<String, Entry>) -> Result<Vec<Option<Optics>>> {
    let mut used = BTreeMap::new();
    let mut found = Vec::with_capacity(names.len());
    for &name in names {
        let exact = tables.get_key_value(name);
        let mut fitting = tables.iter().filter(|(key, _)| matches_glob(key, name));
        let (first, second) = (fitting.next(), fitting.next());
        if let (None, Some((first, _)), Some((second, _))) = (exact, first, second) {
            bail!("{kind} `{name}` fits both `{first}` and `{second}`; name it in a table of its own");
        }
        found.push(exact.or(first).map(|(key, entry)| {
            used.insert(key.as_str(), ());
            Optics {
                specular: entry.specular,
                transmittance: entry.transmittance,
            }
        }));
    }
    match tables.keys().find(|key| !used.contains_key(key.as_str())) {
        Some(unused) => Err(hinted(
            anyhow!("`[{kind}.\"{unused}\"]` matches no {kind}"),
            format!("`hemicube inspect` lists the {kind}s of a scene"),
        )),
        None => Ok(found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_sectors_and_periods_are_read_and_others_refused() {
        assert_eq!(
            symmetry("y=-2.5"),
            Ok(Symmetry {
                axis: Axis::Y,
                at: -2.5
            })
        );
        assert_eq!(
            sector("z,12"),
            Ok(Sector {
                axis: Axis::Z,
                count: 12
            })
        );
        assert_eq!(
            period("x=-1..1e2"),
            Ok(Period {
                axis: Axis::X,
                low: -1.0,
                high: 100.0
            })
        );
        for wrong in ["x", "w=1", "x=nan", "x=one"] {
            assert!(symmetry(wrong).is_err(), "{wrong}");
        }
        assert!(sector("z").is_err() && sector("z,-1").is_err());
        for wrong in ["x=1", "x=2..1", "x=1..1", "x=..3"] {
            assert!(period(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn tables_go_by_name_then_by_pattern() {
        let tables: Tables = toml::from_str(
            "[material.\"glass*\"]\nspecular = 0.1\ntransmittance = 0.7\n[material.glass_door]\nspecular = 0.2\n",
        )
        .expect("good TOML");
        let found = by_name("material", &["wall", "glass_a", "glass_door"], &tables.material).expect("all fit");
        assert_eq!(found[0], None);
        assert_eq!(found[1].map(|optics| optics.passed()), Some(0.1 + 0.7));
        assert_eq!(found[2].map(|optics| optics.specular), Some(0.2));
        let unused = by_name("material", &["wall"], &tables.material).expect_err("no glass");
        assert!(unused.to_string().contains("matches no material"), "{unused}");
        assert!(toml::from_str::<Tables>("[material.a]\nreflectance = 1").is_err());
    }
}
