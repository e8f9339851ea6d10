//! Exchange factors as `.csv`, `.json` and `.npz`.

use crate::report::PendingFile;
use crate::table::field;
use anyhow::{Context, Result, bail};
use hemicube::analysis::exchange::{Exchange, Network};
use hemicube::store::{DurableFile, ElementType, NpzWriter};
use serde_json::json;
use std::io::{BufWriter, Write};
use std::path::Path;

/// The name of what lies outside.
pub(super) const SURROUNDINGS: &str = "(surroundings)";

/// A number of a band and two surfaces.
type Value<'a> = &'a dyn Fn(usize, usize, usize) -> f64;

/// A file of exchange factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Csv,
    Json,
    Npz,
}

impl Format {
    pub(super) fn of(path: &Path) -> Result<Self> {
        match path.extension().map(std::ffi::OsStr::to_ascii_lowercase) {
            Some(extension) if extension == "csv" => Ok(Self::Csv),
            Some(extension) if extension == "json" => Ok(Self::Json),
            Some(extension) if extension == "npz" => Ok(Self::Npz),
            _ => bail!(
                "`--output {}`: a name that ends in .csv, .json or .npz is needed",
                path.display()
            ),
        }
    }
}

/// The endings of files of all factors.
pub(super) fn names_of_factors() -> impl Iterator<Item = &'static str> {
    ["csv", "json", "npz"].into_iter()
}

/// A path ends so, in upper or lower case.
pub(super) fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// The factors of a network, and its bands.
pub(super) struct Found<'a> {
    pub(super) network: &'a Network,
    pub(super) exchange: &'a Exchange,
    pub(super) bands: &'a [String],
    /// The enclosure of each surface.
    pub(super) enclosure: &'a [u32],
}

impl Found<'_> {
    /// Writes a file; it appears whole or not at all.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let cannot = || format!("`{}` cannot be written", path.display());
        if Format::of(path)? == Format::Npz {
            return self.npz(path).with_context(cannot);
        }
        let mut file = PendingFile::create(path)?;
        let mut out = BufWriter::with_capacity(1 << 20, &mut file);
        match Format::of(path)? {
            Format::Csv => self.csv(&mut out),
            _ => self.json(&mut out),
        }
        .and_then(|()| out.flush())
        .with_context(cannot)?;
        drop(out);
        file.commit()
    }

    /// A line for each band and pair, both directions, that exchanges anything.
    fn csv(&self, out: &mut impl Write) -> std::io::Result<()> {
        writeln!(
            out,
            "band,from,to,gebhart_factor,exchange_area,conductance_W_per_K4,surface_resistance_from"
        )?;
        for (band, name) in self.bands.iter().enumerate() {
            let name = field(name);
            for from in 0..self.network.len() {
                let of = field(&self.network.names[from]);
                for to in 0..=self.network.len() {
                    let gebhart = self.exchange.gebhart(band, from, to);
                    if gebhart == 0.0 {
                        continue;
                    }
                    let other = field(self.network.names.get(to).map_or(SURROUNDINGS, String::as_str));
                    let area = self.exchange.area(self.network, band, from, to);
                    let conductance = self.exchange.conductance(self.network, band, from, to);
                    let resistance = number(self.surface_resistance(band, from));
                    writeln!(out, "{name},{of},{other},{gebhart},{area},{conductance},{resistance}")?;
                }
            }
        }
        Ok(())
    }

    /// (1 − ε) / (A ε); `None` where nothing is emitted.
    fn surface_resistance(&self, band: usize, surface: usize) -> Option<f64> {
        let (emissivity, area) = (self.exchange.emissivity[band][surface], self.network.area[surface]);
        (emissivity * area > 0.0).then(|| (1.0 - emissivity) / (area * emissivity))
    }

    /// Surfaces and the resistor network between their radiosities, factors band by band.
    fn json(&self, out: &mut impl Write) -> std::io::Result<()> {
        let network = self.network;
        let count = network.len();
        let surface = |at: usize| {
            let bands = 0..self.bands.len();
            json!({
                "name": network.names[at],
                "patches": network.patches[at],
                "area": network.area[at],
                "escaped": network.escaped[at],
                "enclosure": self.enclosure[at],
                "emissivity": bands.clone().map(|band| self.exchange.emissivity[band][at]).collect::<Vec<_>>(),
                "surface_resistance": bands.map(|band| self.surface_resistance(band, at)).collect::<Vec<_>>(),
            })
        };
        let pairs = network.pairs().map_err(std::io::Error::other)?;
        let resistors = pairs.iter().filter(|(a, b, area)| a != b && *area > 0.0);
        let resistors = resistors.map(|(a, b, area)| json!([a, b, area, 1.0 / area]));
        let band = |band: usize| {
            let rows = |of: &dyn Fn(usize, usize) -> f64| {
                (0..count)
                    .map(|from| (0..=count).map(|to| of(from, to)).collect())
                    .collect::<Vec<Vec<f64>>>()
            };
            json!({
                "name": self.bands[band],
                "gebhart": rows(&|from, to| self.exchange.gebhart(band, from, to)),
                "exchange_area": rows(&|from, to| self.exchange.area(network, band, from, to)),
                "conductance": rows(&|from, to| self.exchange.conductance(network, band, from, to)),
                "conservation": self.exchange.conservation(band),
                "reciprocity": self.exchange.reciprocity(network, band),
            })
        };
        let whole = json!({
            "format": "hemicube exchange",
            "version": 1,
            "surfaces": (0..count).map(surface).collect::<Vec<_>>(),
            "last_column": SURROUNDINGS,
            "space_resistors": {
                "columns": ["from", "to", "exchange_area", "resistance"],
                "rows": resistors.collect::<Vec<_>>(),
            },
            "bands": (0..self.bands.len()).map(band).collect::<Vec<_>>(),
        });
        serde_json::to_writer(&mut *out, &whole)?;
        writeln!(out)
    }

    /// Arrays: `names` is JSON in UTF-8; `gebhart` and `exchange_area` are (bands, N, N + 1).
    fn npz(&self, path: &Path) -> Result<()> {
        let network = self.network;
        let (bands, count) = (self.bands.len(), network.len());
        let mut npz = NpzWriter::new(DurableFile::create(path)?);
        let text = json!({ "surfaces": network.names, "bands": self.bands }).to_string();
        npz.array("names", &[text.len() as u64], text.as_bytes())?;
        npz.array("area", &[count as u64], &network.area)?;
        npz.array("escaped", &[count as u64], &network.escaped)?;
        npz.array("enclosure", &[count as u64], self.enclosure)?;
        npz.array(
            "emissivity",
            &[bands as u64, count as u64],
            &self.exchange.emissivity.concat(),
        )?;
        let shape = [bands as u64, count as u64, count as u64 + 1];
        let values: [(&str, Value<'_>); 2] = [
            ("gebhart", &|band, from, to| self.exchange.gebhart(band, from, to)),
            ("exchange_area", &|band, from, to| {
                self.exchange.area(network, band, from, to)
            }),
        ];
        for (name, value) in values {
            npz.begin(name, ElementType::F64, &shape)?;
            for band in 0..bands {
                for from in 0..count {
                    let row: Vec<f64> = (0..=count).map(|to| value(band, from, to)).collect();
                    npz.push(&row)?;
                }
            }
        }
        let pairs = network.pairs()?;
        let ends: Vec<u32> = pairs.iter().flat_map(|&(a, b, _)| [a, b]).collect();
        let areas: Vec<f64> = pairs.iter().map(|&(.., area)| area).collect();
        npz.array("resistor_ends", &[pairs.len() as u64, 2], &ends)?;
        npz.array("resistor_exchange_area", &[pairs.len() as u64], &areas)?;
        npz.finish()?.commit()?;
        Ok(())
    }
}

/// A number, or nothing.
fn number(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}
