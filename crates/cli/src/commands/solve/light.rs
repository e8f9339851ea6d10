//! Light by surface: a table on the terminal, `.csv`, `.json` and `.parquet`.

use super::surfaces::{Format, SURFACES_SHOWN, name_of};
use crate::args::By;
use crate::report::five;
use crate::report::{Listing, PendingFile, count, table};
use crate::table::field;
use anyhow::{Context, Result};
use hemicube::PatchKind;
use hemicube::analysis::zones::surfaces_of;
use hemicube::solve::StoredSolution;
use hemicube::store::{PatchTable, Store};
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// Light of a surface: means over its area, a number a band.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Surface {
    name: String,
    patches: u32,
    area: f64,
    radiosity: Vec<f64>,
    irradiance: Vec<f64>,
}

/// Mean over the area, least and most of a band's radiosity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Range {
    mean: f64,
    least: f64,
    most: f64,
}

/// Results by surface, of the first right-hand side of each band.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Results {
    by: By,
    bands: Vec<String>,
    /// Right-hand sides of the solution.
    rows: u64,
    /// Of all patches, band by band.
    radiosity: Vec<Range>,
    surfaces: Vec<Surface>,
}

impl Results {
    pub(super) fn new(
        by: Option<By>,
        stored: &StoredSolution,
        store: &Store,
        patches: &PatchTable,
        (bands, moment): (&[String], usize),
    ) -> Result<Self> {
        let usual = match store.manifest().patch_kind() {
            PatchKind::Material => By::Material,
            _ => By::Object,
        };
        let by = by.unwrap_or(usual);
        let (zones, zone_of) = surfaces_of(store, patches, by.group())?;
        let mut surfaces: Vec<Surface> = zones
            .iter()
            .map(|zone| Surface {
                name: zone.name.clone(),
                patches: zone.patches,
                area: zone.area,
                radiosity: Vec::with_capacity(bands.len()),
                irradiance: Vec::with_capacity(bands.len()),
            })
            .collect();
        let arrays = [stored.quantity("radiosity")?, stored.quantity("irradiance")?];
        let area: f64 = patches.area.iter().sum();
        let mut radiosity = Vec::with_capacity(bands.len());
        for band in 0..bands.len() as u64 {
            for (array, is_radiosity) in arrays.iter().zip([true, false]) {
                let values = array.row((moment * bands.len()) as u64 + band)?;
                let mut sums = vec![0.0; surfaces.len()];
                for ((value, area), &zone) in values.iter().zip(&patches.area).zip(&zone_of) {
                    sums[zone as usize] += value * area;
                }
                if is_radiosity {
                    radiosity.push(Range {
                        mean: sums.iter().sum::<f64>() / area,
                        least: values.iter().copied().fold(f64::INFINITY, f64::min),
                        most: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                    });
                }
                for (surface, sum) in surfaces.iter_mut().zip(sums) {
                    let means = if is_radiosity {
                        &mut surface.radiosity
                    } else {
                        &mut surface.irradiance
                    };
                    means.push(sum / surface.area);
                }
            }
        }
        Ok(Self {
            by,
            bands: bands.to_vec(),
            rows: arrays[0].rows(),
            radiosity,
            surfaces,
        })
    }

    /// Mean and range, and the table; of the moment of this name, where there are several.
    pub(super) fn text(&self, moment: Option<&str>) -> String {
        let mut list = Listing::default();
        let moments = self.rows / self.bands.len() as u64;
        if let Some(moment) = moment {
            let which = match moments {
                0 | 1 => moment.to_owned(),
                _ => format!(
                    "{moment}, the brightest of {}; `-o FILE.csv --by object` has all",
                    count(moments)
                ),
            };
            list.add("moment", which);
        }
        for (band, range) in self.bands.iter().zip(&self.radiosity) {
            list.add(
                &format!("radiosity, {band}"),
                format!(
                    "{} on average over the area, from {} to {}",
                    five(range.mean),
                    five(range.least),
                    five(range.most)
                ),
            );
        }
        if moment.is_none() && moments > 1 {
            list.add(
                "",
                format!("of the first of {} right-hand sides a band", count(moments)),
            );
        }
        let unit = match moment {
            Some(_) => "W/m²",
            None => "that of the emission given, per area: W/m² for W/m²",
        };
        list.add("unit", unit);
        let mut shown: Vec<&Surface> = self.surfaces.iter().collect();
        if shown.len() > SURFACES_SHOWN {
            shown.sort_by(|a, b| b.area.total_cmp(&a.area));
            shown.truncate(SURFACES_SHOWN);
        }
        let bands = |values: &[f64]| values.iter().map(|&value| five(value)).collect::<Vec<_>>().join("  ");
        let of_bands = self.bands.join(", ");
        let (radiosity, irradiance) = (format!("radiosity ({of_bands})"), format!("irradiance ({of_bands})"));
        let rows = shown.iter().map(|surface| {
            [
                name_of(&surface.name),
                count(surface.patches.into()),
                five(surface.area),
                bands(&surface.radiosity),
                bands(&surface.irradiance),
            ]
        });
        let mut text = list.text();
        text.push('\n');
        text.push_str(&table(
            [self.by.name(), "patches", "area", &radiosity, &irradiance],
            rows,
        ));
        let left_out = self.surfaces.len() - shown.len();
        if left_out > 0 {
            text.push_str(&format!(
                "{} smaller surfaces are not shown; `--by {} -o FILE.csv` has all\n",
                count(left_out as u64),
                self.by.name()
            ));
        }
        text.push('\n');
        text
    }

    /// Writes a file.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let cannot = || format!("`{}` cannot be written", path.display());
        let bytes = match Format::of(path)? {
            Format::Json => {
                (serde_json::to_string_pretty(self).context("the results are no JSON")? + "\n").into_bytes()
            }
            format => format.bytes(self.csv(None), 1)?,
        };
        let mut file = PendingFile::create(path)?;
        file.write_all(&bytes).with_context(cannot)?;
        file.commit()
    }

    /// A line a surface, with the name of the moment where there is one.
    fn csv(&self, moment: Option<&str>) -> String {
        let of_moment = moment.map(|moment| format!("{},", field(moment))).unwrap_or_default();
        let mut text = match moment {
            Some(_) => "moment,".to_owned(),
            None => String::new(),
        };
        text.push_str(&format!("{},patches,area", self.by.name()));
        for quantity in ["radiosity", "irradiance"] {
            for band in &self.bands {
                text.push_str(&format!(",{}", field(&format!("{quantity}_{band}"))));
            }
        }
        text.push('\n');
        for surface in &self.surfaces {
            text.push_str(&format!(
                "{of_moment}{},{},{}",
                field(&surface.name),
                surface.patches,
                surface.area
            ));
            for value in surface.radiosity.iter().chain(&surface.irradiance) {
                text.push_str(&format!(",{value}"));
            }
            text.push('\n');
        }
        text
    }
}

/// Writes results by surface of several moments, a line a moment and surface.
pub(super) fn write_moments(path: &Path, names: &[String], at: impl Fn(usize) -> Result<Results>) -> Result<()> {
    #[derive(Serialize)]
    struct Moment<'a> {
        moment: &'a str,
        #[serde(flatten)]
        results: Results,
    }
    let cannot = || format!("`{}` cannot be written", path.display());
    let format = Format::of(path)?;
    let mut file = PendingFile::create(path)?;
    let mut moments = Vec::new();
    let mut text = String::new();
    for (place, moment) in names.iter().enumerate() {
        let results = at(place)?;
        match format {
            Format::Json => moments.push(Moment { moment, results }),
            Format::Csv | Format::Parquet => {
                let lines = results.csv(Some(moment));
                let head = if place > 0 {
                    lines.find('\n').map_or(0, |end| end + 1)
                } else {
                    0
                };
                text.push_str(&lines[head..]);
                if format == Format::Csv {
                    file.write_all(text.as_bytes()).with_context(cannot)?;
                    text.clear();
                }
            }
        }
    }
    if format == Format::Json {
        text = serde_json::to_string_pretty(&moments).context("the results are no JSON")? + "\n";
    }
    if format != Format::Csv {
        file.write_all(&format.bytes(text, 2)?).with_context(cannot)?;
    }
    file.commit()
}
