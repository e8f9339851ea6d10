//! Portals of a run: mirrors and panes from a TOML file, planes of symmetry, sectors and periods from the command line.

use crate::args::Talk;
use crate::prepare::Prepared;
use crate::toml_file;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hemicube::HierarchyOptions;
use hemicube::driver::glazing::{Glazing, laws_of_scene};
use hemicube::portal::sight::{MIRRORS, ThroughPortals};
use hemicube::portal::{ImageError, ImageSettings, Images, Period, Portals, Sector, Specular, Symmetry};
use hemicube_scene::{Axis, ReadOptions};
use std::path::{Path, PathBuf};

/// Mirrors, panes, symmetry and periods
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mirrors, glass, symmetry")]
pub(crate) struct PortalSettings {
    /// Mirrors and panes, by FILE or the `scene`
    #[arg(long, value_name = "FILE")]
    pub(crate) specular: Option<PathBuf>,
    /// End a path where no more than B of it is left; a twentieth of the tolerance, or 1e-4
    #[arg(long, value_name = "B", value_parser = bound, requires = "specular", hide_short_help = true)]
    pub(crate) specular_bound: Option<f64>,
    /// One side of mirror planes: `x=0,y=5`
    ///
    /// The scene is one side of these planes, and goes on behind them as its image.
    #[arg(long, value_name = "AXIS=AT,…", value_delimiter = ',', value_parser = symmetry, allow_hyphen_values = true)]
    pub(crate) symmetry: Vec<Symmetry>,
    /// One of N sectors about an axis: `z,12`
    ///
    /// The axis goes through 0.
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

/// The word for the scene's own mirrors and panes; a file of that name is `./scene`.
const SCENE: &str = "scene";

/// The file of mirrors and panes.
fn read(path: &Path) -> Result<Glazing> {
    toml_file::read(path, "mirrors and panes")
}

impl PortalSettings {
    /// The file of mirrors and panes, to read.
    pub(crate) fn file(&self) -> Option<PathBuf> {
        file_of(self.specular.as_ref())
    }

    /// Names of the bands of mirrors and panes; one where no value has several.
    ///
    /// # Errors
    /// When the file cannot be read, or its bands do not fit each other.
    pub(crate) fn bands(&self) -> Result<Vec<String>> {
        match self.file() {
            Some(path) => {
                let bands = read(&path)?.bands();
                bands.with_context(|| format!("`{}` is no file of mirrors and panes", path.display()))
            }
            None => Ok(vec!["1".to_owned()]),
        }
    }

    /// [`Self::portals`] for commands other than `compute`, of one band.
    ///
    /// # Errors
    /// Like it, and when the file has several bands.
    pub(crate) fn of_one_band(
        &self,
        prepared: &mut Prepared,
        hierarchy: HierarchyOptions,
        tolerance: Option<f64>,
    ) -> Result<Portals> {
        if let Some(path) = &self.specular {
            require_one_band(path)?;
        }
        self.portals(prepared, hierarchy, tolerance)
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
            budget: prepared.budget,
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
        Ok(Portals {
            images,
            specular: self.of_band(prepared, tolerance, 0)?,
        })
    }

    /// The mirrors and panes of a band.
    fn of_band(&self, prepared: &Prepared, tolerance: Option<f64>, band: usize) -> Result<Option<Specular>> {
        let bound = self
            .specular_bound
            .unwrap_or_else(|| tolerance.map_or(1e-4, |tolerance| tolerance / 20.0));
        let path = self.specular.as_deref();
        path.map(|path| specular(path, prepared, bound, band)).transpose()
    }

    /// The portals of all bands but the first, whose [`Self::portals`] are given.
    ///
    /// # Errors
    /// Like them.
    pub(crate) fn of_further_bands(
        &self,
        first: &Portals,
        prepared: &Prepared,
        tolerance: Option<f64>,
        count: usize,
    ) -> Result<Vec<Portals>> {
        let of_band = |band| {
            Ok(Portals {
                images: first.images.clone(),
                specular: self.of_band(prepared, tolerance, band)?,
            })
        };
        (1..count).map(of_band).collect()
    }
}

fn explain(error: ImageError, path: &str) -> anyhow::Error {
    anyhow!("`{path}`: {error}")
}

/// The mirrors and panes of `--specular` for commands other than `compute`, of one band.
///
/// # Errors
/// When the file has several bands, or does not fit the scene.
pub(crate) fn of_one_band(path: &Path, prepared: &Prepared, bound: f64) -> Result<Specular> {
    require_one_band(path)?;
    specular(path, prepared, bound, 0)
}

/// Refuses files of several bands.
fn require_one_band(path: &Path) -> Result<()> {
    if path != Path::new(SCENE) {
        let bands = read(path)?.bands()?;
        if bands.len() > 1 {
            bail!(
                "`{}` has {} bands, and one is needed here: give numbers in place of lists",
                path.display(),
                bands.len()
            );
        }
    }
    Ok(())
}

/// A path of `--specular` to read: not the word for the scene's own.
pub(crate) fn file_of(path: Option<&PathBuf>) -> Option<PathBuf> {
    path.filter(|path| path.as_path() != Path::new(SCENE)).cloned()
}

/// The mirrors and panes of a scene in a band, by a file or its own.
fn specular(path: &Path, prepared: &Prepared, bound: f64, band: usize) -> Result<Specular> {
    let scene = &prepared.scene;
    if path == Path::new(SCENE) {
        // It was read before, without them.
        let options = ReadOptions {
            optics: true,
            allow_large: true,
            budget: prepared.budget,
        };
        let read = hemicube_scene::load(Path::new(&prepared.input.path), options)?;
        // Mirrors that it may describe would be left out.
        if let Some(warning) = read.ledger.unread_libraries().next() {
            bail!("the mirrors and panes of `{}`: {warning}", prepared.input.path);
        }
        let laws = laws_of_scene(&read);
        let specular = Specular::new(scene, &prepared.patches, &laws, &[], bound);
        return specular.with_context(|| format!("the mirrors and panes of `{}`", prepared.input.path));
    }
    let glazing = read(path)?;
    let fit = || -> Result<Specular> {
        let [materials, objects] = glazing.laws(scene, band)?;
        Ok(Specular::new(scene, &prepared.patches, &materials, &objects, bound)?)
    };
    fit().with_context(|| format!("`{}` does not fit `{}`", path.display(), prepared.input.path))
}

/// Warns where suns are reflected in more directions than are followed.
pub(crate) fn tell_of_reflections(portals: &Portals, prepared: &Prepared, talk: Talk) {
    let Some(specular) = &portals.specular else { return };
    if ThroughPortals::new(specular, portals.images.as_ref(), &prepared.model).leaves_out_reflections() {
        talk.warn(&format!(
            "mirrors of many directions: suns are followed off the largest alone, and off fewer than {MIRRORS} of them one \
             after the other"
        ));
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
}
