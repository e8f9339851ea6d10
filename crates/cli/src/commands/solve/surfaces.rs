//! Heat by surface: a table on the terminal, `.csv`, `.json` and `.parquet`.

use super::moments::SURROUNDINGS;
use crate::args::By;
use crate::escape::shown;
use crate::exit::hinted;
use crate::report::{Listing, PendingFile, count, counted, five, percent, table};
use crate::table::field;
use anyhow::{Context, Result, bail};
use hemicube::analysis::surfaces::{ERROR_TOLD, EnclosureError, HeatBalance, HeatError, MatrixTables, SurfaceHeat};
use hemicube::solve::{Enclosures, Reading};
use hemicube_export::{Error as ExportError, TableColumn, parquet_table};
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// Surfaces in the table on the terminal; the others are in the files.
pub(super) const SURFACES_SHOWN: usize = 40;
/// Heat below this part of all that flows is shown as 0.
const ROUNDING: f64 = 1e-6;
/// Likewise below the residual of the iteration, and this, in all that surfaces send.
const LEAST_RESIDUAL: f64 = 1e-13;
/// Enclosures named.
const ENCLOSURES_SHOWN: usize = 6;
/// Names of an enclosure.
const NAMES_SHOWN: usize = 3;

/// A file of results by surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Csv,
    Json,
    Parquet,
}

impl Format {
    pub(super) fn of(path: &Path) -> Result<Self> {
        match path.extension().map(std::ffi::OsStr::to_ascii_lowercase) {
            Some(extension) if extension == "csv" => Ok(Self::Csv),
            Some(extension) if extension == "json" => Ok(Self::Json),
            Some(extension) if extension == "parquet" => Ok(Self::Parquet),
            _ => bail!(
                "`-o {}`: a name that ends in .csv, .json or .parquet is needed",
                path.display()
            ),
        }
    }

    /// The bytes of a file, of the lines of a `.csv`: Parquet has the same columns, and names in the first so many.
    pub(super) fn bytes(self, lines: String, names: usize) -> Result<Vec<u8>> {
        if self != Self::Parquet {
            return Ok(lines.into_bytes());
        }
        let mut reader = csv::Reader::from_reader(lines.as_bytes());
        let head = reader.headers().context("a table without a head")?.clone();
        let mut columns: Vec<TableColumn> = (0..head.len())
            .map(|at| match at < names {
                true => TableColumn::Names(Vec::new()),
                false => TableColumn::Numbers(Vec::new()),
            })
            .collect();
        for line in reader.records() {
            let line = line.context("a line of the table")?;
            for (column, cell) in columns.iter_mut().zip(&line) {
                match column {
                    TableColumn::Names(names) => names.push(cell.to_owned()),
                    // No number where the table has nothing.
                    TableColumn::Numbers(numbers) if cell.is_empty() => numbers.push(None),
                    TableColumn::Numbers(numbers) => {
                        let number = cell.parse().with_context(|| format!("`{cell}` is no number"))?;
                        numbers.push(Some(number));
                    }
                }
            }
        }
        let columns: Vec<(String, TableColumn)> = head.iter().map(str::to_owned).zip(columns).collect();
        parquet_table(&columns).map_err(|error| match error {
            ExportError::NotBuilt { .. } => hinted(error.into(), "build it with default features, or write a `.csv`"),
            error => error.into(),
        })
    }
}

/// Patches that exchange heat with each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Enclosure {
    patches: u64,
    area: f64,
    /// Part of its view that leaves the scene.
    escaped: f64,
    /// Names of its objects, or of its materials where objects have none.
    names: Vec<String>,
    /// Heat that flows in it, in W, what is not known of it, and that as a part.
    heat: f64,
    error: f64,
    relative_error: f64,
    /// The body of which least is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    worst: Option<Body>,
}

/// What is not known of the heat of a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Body {
    name: String,
    heat: f64,
    error: f64,
    relative_error: f64,
}

/// Enclosures of two patches or more, the largest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct EnclosuresOfHeat {
    enclosures: Vec<Enclosure>,
    /// Patches that see no other.
    alone: u64,
}

impl EnclosuresOfHeat {
    /// With what is not known of their heat, and the names of bodies.
    pub(super) fn new(
        found: &Enclosures,
        of: MatrixTables<'_>,
        errors: &[EnclosureError],
        shown: &dyn Fn(u32) -> String,
    ) -> Self {
        let (enclosures, alone) = enclosures_of(found, of, errors, shown);
        Self { enclosures, alone }
    }

    /// The largest share of its heat that is not known of an enclosure or a body.
    pub(super) fn share(&self) -> f64 {
        self.enclosures.iter().map(Enclosure::share).fold(0.0, f64::max)
    }

    /// Enclosures, or bodies in them, of whose heat more than [`ERROR_TOLD`] is not known: names and errors.
    pub(super) fn unsure(&self) -> impl Iterator<Item = (String, HeatError)> {
        let unsure = self
            .enclosures
            .iter()
            .enumerate()
            .filter(|(_, of)| of.share() > ERROR_TOLD);
        unsure.take(ENCLOSURES_SHOWN).map(|(at, of)| {
            let enclosure = format!("enclosure {} ({})", at + 1, of.listed());
            match &of.worst {
                Some(body) if body.relative_error > of.relative_error => {
                    let (heat, error) = (body.heat, body.error);
                    (format!("{} in {enclosure}", body.name), HeatError { heat, error })
                }
                _ => {
                    let (heat, error) = (of.heat, of.error);
                    (enclosure, HeatError { heat, error })
                }
            }
        })
    }
}

/// Results of each moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(super) struct Moments {
    /// Of a single moment.
    #[serde(skip_serializing_if = "Option::is_none")]
    by_surface: Option<Results>,
    /// Of several, with their names: files and the terminal have them.
    #[serde(skip)]
    of_moments: Vec<(String, Results)>,
}

impl Moments {
    /// Adds the results of the next moment, with its name where it has one.
    pub(super) fn add(&mut self, name: Option<&String>, results: Results) {
        match name {
            None => self.by_surface = Some(results),
            Some(name) => self.of_moments.push((name.clone(), results)),
        }
    }

    /// Returns whether the record of a solution has none of it.
    pub(super) fn is_no_single(&self) -> bool {
        self.by_surface.is_none()
    }

    /// The table of a single moment; of several, a line a surface with its temperatures over them.
    pub(super) fn text(&self, is_verbose: bool) -> String {
        match (&self.by_surface, &self.of_moments[..]) {
            (Some(results), _) => results.text(is_verbose),
            (None, []) => String::new(),
            (None, [(_, results)]) => results.text(is_verbose),
            (None, moments) => over_moments(moments),
        }
    }

    /// Writes a file: a line a surface, and of several moments a line a moment and surface.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let cannot = || format!("`{}` cannot be written", path.display());
        let format = Format::of(path)?;
        let text = match (&self.by_surface, format) {
            (Some(results), Format::Json) => serde_json::to_string_pretty(results),
            (None, Format::Json) => {
                #[derive(Serialize)]
                struct Moment<'a> {
                    moment: &'a str,
                    #[serde(flatten)]
                    results: &'a Results,
                }
                let moments = self.of_moments.iter();
                let moments: Vec<Moment<'_>> = moments.map(|(moment, results)| Moment { moment, results }).collect();
                serde_json::to_string_pretty(&moments)
            }
            (Some(results), _) => Ok(results.csv(None)),
            (None, _) => {
                Ok(self
                    .of_moments
                    .iter()
                    .enumerate()
                    .fold(String::new(), |mut text, (at, (moment, results))| {
                        let lines = results.csv(Some(moment));
                        let head = if at > 0 {
                            lines.find('\n').map_or(0, |end| end + 1)
                        } else {
                            0
                        };
                        text.push_str(&lines[head..]);
                        text
                    }))
            }
        };
        let text = text.context("the results are no JSON")?;
        let end = if text.ends_with('\n') { "" } else { "\n" };
        let bytes = format.bytes(text + end, if self.by_surface.is_some() { 1 } else { 2 })?;
        let mut file = PendingFile::create(path)?;
        file.write_all(&bytes).with_context(cannot)?;
        file.commit()
    }
}

/// A line a surface: its mean temperature at the moments where it is least and most, and the mean of its heat.
fn over_moments(moments: &[(String, Results)]) -> String {
    let Some((_, first)) = moments.first() else {
        return String::new();
    };
    let of = |surface: usize| {
        moments
            .iter()
            .map(move |(name, results)| (name, &results.surfaces[surface]))
    };
    let mean_heat = |surface: usize| of(surface).map(|(_, found)| found.heat).sum::<f64>() / moments.len() as f64;
    let extreme = |surface: usize, sign: f64| {
        let known = of(surface).filter_map(|(name, found)| Some((name, found.temperature?[0])));
        let extreme = known.max_by(|a, b| (sign * a.1).total_cmp(&(sign * b.1)));
        extreme.map_or_else(|| "–".to_owned(), |(name, kelvin)| format!("{kelvin:.2} at {name}"))
    };
    let mut places: Vec<usize> = (0..first.surfaces.len()).collect();
    if places.len() > SURFACES_SHOWN {
        places.sort_by(|&a, &b| mean_heat(b).abs().total_cmp(&mean_heat(a).abs()).then(a.cmp(&b)));
        places.truncate(SURFACES_SHOWN);
        places.sort_unstable();
    }
    let left = moments.iter().map(|(_, results)| results.left).fold(0.0, f64::max);
    let rows = places.iter().map(|&place| {
        let heat = mean_heat(place);
        let surface = &first.surfaces[place];
        [
            name_of(&surface.name),
            count(surface.patches.into()),
            five(surface.area),
            extreme(place, -1.0),
            extreme(place, 1.0),
            if heat.abs() <= left { "0".to_owned() } else { five(heat) },
        ]
    });
    let headings = [
        first.by.name(),
        "patches",
        "area",
        "least mean, K",
        "most mean, K",
        "mean heat, W",
    ];
    let mut text = format!("{}\n", table(headings, rows));
    let mut list = Listing::default();
    if first.surfaces.len() > places.len() {
        list.add(
            "surfaces",
            format!(
                "{} with less heat are not shown",
                count((first.surfaces.len() - places.len()) as u64)
            ),
        );
    }
    list.add(
        "moments",
        format!(
            "{}; `--by {} -o FILE.csv` has each",
            count(moments.len() as u64),
            first.by.name()
        ),
    );
    text.push_str(&list.text());
    text
}

/// Results by surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Results {
    by: By,
    surfaces: Vec<SurfaceHeat>,
    balance: HeatBalance,
    reading: Reading,
    /// What is not known of the heat of all enclosures, in W.
    error: f64,
    /// The largest part of its heat that is not known of an enclosure or a body in one.
    relative_error: f64,
    enclosures: Vec<Enclosure>,
    /// Patches that see no other.
    alone: u64,
    /// Number of surfaces with emissivities of the scene's file, and the least and greatest.
    #[serde(skip_serializing_if = "Option::is_none")]
    emissivities_of_scene: Option<(usize, f64, f64)>,
    /// Heat that the iteration and the rounding of numbers leave, in W: the table shows less as 0.
    #[serde(skip)]
    left: f64,
}

impl Results {
    pub(super) fn new(
        by: By,
        reading: Reading,
        surfaces: Vec<SurfaceHeat>,
        balance: HeatBalance,
        found: EnclosuresOfHeat,
    ) -> Self {
        Self {
            by,
            surfaces,
            balance,
            reading,
            error: found.enclosures.iter().map(|of| of.error).sum(),
            relative_error: found.share(),
            enclosures: found.enclosures,
            alone: found.alone,
            emissivities_of_scene: None,
            left: ROUNDING * balance.given_off.max(-balance.taken_up),
        }
    }

    /// Memory that they take, names apart.
    pub(super) fn bytes(&self) -> u64 {
        (self.surfaces.len() * size_of::<SurfaceHeat>() + size_of::<Self>()) as u64
    }

    /// With the relative residual of the iteration.
    pub(super) fn with_residual(mut self, residual: f64) -> Self {
        let sent: f64 = self.surfaces.iter().map(|of| of.area * of.radiosity).sum();
        self.left = self.left.max(residual.max(LEAST_RESIDUAL) * sent);
        self
    }

    pub(super) fn with_emissivities(mut self, of_scene: Option<(usize, f64, f64)>) -> Self {
        self.emissivities_of_scene = of_scene;
        self
    }

    /// The table, what it adds up to, and what is not known of it; enclosures where there are several, or all is wanted.
    pub(super) fn text(&self, is_verbose: bool) -> String {
        let mut places: Vec<usize> = (0..self.surfaces.len()).collect();
        if places.len() > SURFACES_SHOWN {
            // Most heat first, and then in the file's order again.
            let heat = |place: &usize| self.surfaces[*place].heat.abs();
            places.sort_by(|a, b| heat(b).total_cmp(&heat(a)).then(a.cmp(b)));
            places.truncate(SURFACES_SHOWN);
            places.sort_unstable();
        }
        let kelvin = |surface: &SurfaceHeat, at: usize| {
            let found = surface.temperature.map(|values| format!("{:.2}", values[at]));
            found.unwrap_or_else(|| "–".to_owned())
        };
        let headings = [
            self.by.name(),
            "patches",
            "area",
            "heat, W",
            "flux, W/m²",
            "mean, K",
            "least, K",
            "most, K",
            "radiosity, W/m²",
        ];
        let heat = |heat: f64, scale: f64| {
            if heat.abs() <= self.left {
                "0".to_owned()
            } else {
                five(heat / scale)
            }
        };
        let rows = places.iter().map(|&place| {
            let surface = &self.surfaces[place];
            [
                name_of(&surface.name),
                count(surface.patches.into()),
                five(surface.area),
                heat(surface.heat, 1.0),
                heat(surface.heat, surface.area),
                kelvin(surface, 0),
                kelvin(surface, 1),
                kelvin(surface, 2),
                five(surface.radiosity),
            ]
        });
        let mut text = format!("{}\n", table(headings, rows));
        let mut list = Listing::default();
        let left_out = self.surfaces.len() - places.len();
        if left_out > 0 {
            list.add(
                "surfaces",
                format!(
                    "{} with less heat are not shown; `--by {} -o FILE.csv` has all",
                    count(left_out as u64),
                    self.by.name()
                ),
            );
        }
        list.add("heat", self.sum());
        if let Some((number, least, most)) = self.emissivities_of_scene {
            let range = if least == most {
                format!("{least}")
            } else {
                format!("{least} to {most}")
            };
            list.add(
                "emissivity",
                format!(
                    "of {} as the scene's file has it: {range}",
                    counted(number as u64, "surface")
                ),
            );
        }
        let told = if self.enclosures.len() > 1 || is_verbose {
            ENCLOSURES_SHOWN
        } else {
            0
        };
        for (at, enclosure) in self.enclosures.iter().enumerate().take(told) {
            list.add(&format!("enclosure {}", at + 1), enclosure.text());
        }
        if self.enclosures.len() > ENCLOSURES_SHOWN {
            let more = (self.enclosures.len() - ENCLOSURES_SHOWN) as u64;
            list.add("enclosures", format!("{} more", count(more)));
        }
        if self.alone > 0 {
            list.add(
                "alone",
                format!("{} without another in sight", counted(self.alone, "patch")),
            );
        }
        text.push_str(&list.text());
        text
    }

    fn sum(&self) -> String {
        let HeatBalance {
            given_off,
            taken_up,
            surroundings,
            ..
        } = self.balance;
        if given_off.max(-taken_up).max(surroundings.abs()) <= self.left {
            return format!(
                "none flows: what is left, {} W given off and {} W taken up, is rounding",
                five(given_off),
                five(-taken_up)
            );
        }
        format!(
            "{} W given off, {} W taken up, {} W to the surroundings; known within {} W ({}), by {}",
            five(given_off),
            five(-taken_up),
            five(surroundings),
            five(self.error),
            percent(self.relative_error),
            match self.reading {
                Reading::Pairs => "the closure of rows",
                Reading::AsStored => "the reciprocity of the matrix as stored",
            }
        )
    }

    /// The surfaces and, last, the surroundings: heat adds up to the error. A moment is the first column.
    fn csv(&self, moment: Option<&str>) -> String {
        let of_moment = moment.map_or_else(String::new, |moment| format!("{},", field(moment)));
        let mut text = format!(
            "{}{},patches,area,heat_W,flux_W_per_m2,mean_K,least_K,most_K,mean_of_K,radiosity_W_per_m2,\
             irradiance_W_per_m2\n",
            if moment.is_some() { "moment," } else { "" },
            self.by.name()
        );
        for surface in &self.surfaces {
            let [mean, least, most] = surface.temperature.map_or_else(
                || [const { String::new() }; 3],
                |values| values.map(|kelvin| kelvin.to_string()),
            );
            text.push_str(&format!(
                "{of_moment}{},{},{},{},{},{mean},{least},{most},{},{},{}\n",
                field(&surface.name),
                surface.patches,
                surface.area,
                surface.heat,
                surface.flux,
                surface
                    .mean_of_kelvin
                    .map_or_else(String::new, |kelvin| kelvin.to_string()),
                surface.radiosity,
                surface.irradiance
            ));
        }
        if self.balance.surroundings != 0.0 {
            text.push_str(&format!(
                "{of_moment}{SURROUNDINGS},,,{},,,,,,,\n",
                -self.balance.surroundings
            ));
        }
        text
    }
}

impl Enclosure {
    /// The larger share of its own heat and of a body's that is not known.
    fn share(&self) -> f64 {
        let of_body = self.worst.as_ref().map_or(0.0, |body| body.relative_error);
        self.relative_error.max(of_body)
    }

    /// Its first names.
    fn listed(&self) -> String {
        let first: Vec<String> = self.names.iter().take(NAMES_SHOWN).map(|name| name_of(name)).collect();
        let more = self.names.len().saturating_sub(NAMES_SHOWN);
        match more {
            0 => first.join(", "),
            more => format!("{} and {} more", first.join(", "), count(more as u64)),
        }
    }

    fn text(&self) -> String {
        let lost = if self.escaped > 0.0 {
            format!("{} of its view leaves the scene", percent(self.escaped))
        } else {
            "closed".to_owned()
        };
        let unsure = match &self.worst {
            _ if self.heat == 0.0 => String::new(),
            Some(body) if body.relative_error > self.relative_error => format!(
                "; heat within {}, of {} within {}",
                percent(self.relative_error),
                body.name,
                percent(body.relative_error)
            ),
            _ => format!("; heat within {}", percent(self.relative_error)),
        };
        format!(
            "{} of {}; {lost}{unsure}",
            counted(self.patches, "patch"),
            self.listed()
        )
    }
}

/// Enclosures of two patches or more, the largest first, and the number of patches alone.
fn enclosures_of(
    found: &Enclosures,
    tables: MatrixTables<'_>,
    errors: &[EnclosureError],
    shown: &dyn Fn(u32) -> String,
) -> (Vec<Enclosure>, u64) {
    let MatrixTables {
        patches: table,
        rows,
        names,
    } = tables;
    let [objects, materials] = names;
    let mut all = Vec::new();
    let mut alone = 0;
    for (patches, error) in found.patches().into_iter().zip(errors) {
        if patches.len() < 2 {
            alone += patches.len() as u64;
            continue;
        }
        let (mut area, mut escaped) = (0.0, 0.0);
        let mut names: Vec<String> = Vec::new();
        let mut seen = std::collections::HashSet::new();
        for &patch in &patches {
            let patch = patch as usize;
            area += table.area[patch];
            escaped += table.area[patch] * Some(rows.escaped[patch]).filter(|share| !share.is_nan()).unwrap_or(0.0);
            let object = objects.get(table.object[patch] as usize);
            let material = materials.get(table.material[patch] as usize);
            let name = object.filter(|name| !name.is_empty()).or(material);
            let name = name.map_or("", String::as_str);
            if seen.insert(name) {
                names.push(name.to_owned());
            }
        }
        all.push(Enclosure {
            patches: patches.len() as u64,
            area,
            escaped: if area > 0.0 { escaped / area } else { 0.0 },
            names,
            heat: error.whole.heat,
            error: error.whole.error,
            relative_error: error.whole.share(),
            worst: error.worst.map(|(body, error)| Body {
                name: shown(body),
                heat: error.heat,
                error: error.error,
                relative_error: error.share(),
            }),
        });
    }
    all.sort_by_key(|enclosure| std::cmp::Reverse(enclosure.patches));
    (all, alone)
}

/// A name for people.
pub(super) fn name_of(name: &str) -> String {
    if name.is_empty() {
        "(without a name)".to_owned()
    } else {
        shown(name).into_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_figures() {
        let values = [0.0, 1564.87, -12.345_67, 0.000_123_456, 99_999.0, 1.5e7, 3e-9];
        let shown = ["0", "1564.9", "-12.346", "0.00012346", "99999", "1.5000e7", "3.0000e-9"];
        assert_eq!(values.map(five), shown);
    }

    #[test]
    fn many_surfaces_show_those_with_most_heat_and_fields_are_quoted() {
        let surface = |at: usize| SurfaceHeat {
            name: format!("wall, {at}"),
            patches: 1,
            area: 1.0,
            heat: at as f64,
            flux: at as f64,
            temperature: None,
            mean_of_kelvin: None,
            radiosity: 0.0,
            irradiance: 0.0,
        };
        let balance = HeatBalance {
            given_off: 2.0,
            surroundings: 2.0,
            ..HeatBalance::default()
        };
        let results = Results::new(
            By::Object,
            Reading::Pairs,
            (0..50).map(surface).collect(),
            balance,
            EnclosuresOfHeat::default(),
        );
        assert!(results.sum().contains("2.0000 W given off"), "{}", results.sum());
        let text = results.text(false);
        assert!(text.contains("wall, 49") && !text.contains("wall, 9 ") && text.contains("10 with less heat"));
        let csv = results.csv(None);
        assert!(csv.contains("\n\"wall, 3\",1,1,3,3,,,,,0,0\n") && csv.ends_with("(surroundings),,,-2,,,,,,,\n"));
    }
}
