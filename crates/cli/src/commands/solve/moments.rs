//! Tables over moments, for heat: what surfaces take up from elsewhere, and temperatures.
//!
//! ```text
//! surface,06:00,12:00          patch,06:00,12:00          time,roof,wall*
//! roof,0,650                   0,0,650                    06:00,0,10
//! wall*,10,200                 1,0,420                    12:00,650,200
//! ```
//!
//! The first field says what a line is: `patch`, by its number; `surface` (or `object`, `material`, `name`), by the name
//! or pattern of an object or, where no object has it, of a material; `time` (or `moment`, `hour`), and then surfaces are
//! columns. A `.npy` has a row a moment and a number a patch. Several tables have the same moments in the same order; a
//! single moment holds for all.

use crate::exit::hinted;
use crate::report::{counted, figures};
use crate::suns::{Moment, Suns, first_difference};
use crate::table::{Head, Located, head, told};
use anyhow::{Context, Result, anyhow, bail};
use hemicube::solve::{ArrayFile, Block, Heat, STEFAN_BOLTZMANN, SolveError, Temperature};
use hemicube::store::{Manifest, PatchTable};
use hemicube_scene::globs::Patterns;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The name of what lies outside the scene, in tables as in results.
pub(super) const SURROUNDINGS: &str = "(surroundings)";
/// No line of a table is of a patch.
const NONE: u32 = u32::MAX;

/// A number a patch and moment.
#[derive(Debug)]
enum Values {
    /// A line a surface: its numbers, a moment each.
    Lines {
        lines: Vec<Vec<f64>>,
        /// The line of each patch, or [`NONE`].
        of_patch: Vec<u32>,
        /// The numbers of [`SURROUNDINGS`].
        outside: Option<Vec<f64>>,
    },
    /// A row a moment.
    Array(ArrayFile),
}

/// One table.
#[derive(Debug)]
struct Table {
    path: PathBuf,
    names: Vec<String>,
    values: Values,
}

/// The moments of an exchange of heat, at least one.
#[derive(Debug, Default)]
pub(super) struct Moments {
    loads: Option<Table>,
    temperatures: Option<Table>,
    /// The lowest temperature of a schedule in kelvin below [`Temperature::COLD`].
    coldest: Option<f64>,
    /// Sunlight that each patch absorbs, in W/m², a moment each.
    absorbed: Vec<Vec<f64>>,
    /// Temperatures of the sky by the suns' table, K, a moment each; empty where it does not hold.
    skies: Vec<f64>,
    /// A planet's infrared, W/m² of its surface, and what arrives on each patch of a radiosity of 1, a moment each;
    /// empty without infrared.
    planets: Vec<(f64, Vec<f64>)>,
    names: Vec<String>,
}

impl Moments {
    /// Reads the tables of loads, in W/m², and of temperatures.
    pub(super) fn read(
        loads: Option<&Path>,
        temperatures: Option<&Path>,
        suns: Option<&Suns>,
        manifest: &Manifest,
        table: &PatchTable,
    ) -> Result<Self> {
        let load = |text: &str| match text.parse::<f64>() {
            Ok(load) if load.is_finite() => Ok(load),
            _ => Err(anyhow!("`{text}` is no number of W/m²")),
        };
        // Perhaps degrees Celsius without their sign.
        let coldest = Cell::new(None);
        let kelvin = |text: &str| match text.parse::<Temperature>() {
            Ok(given) => {
                let kelvin = given.kelvin();
                if !given.is_celsius() {
                    coldest.set(colder(coldest.get(), kelvin));
                }
                Ok(kelvin)
            }
            Err(reason) => Err(anyhow!(reason)),
        };
        let read = |path: Option<&Path>, number: &dyn Fn(&str) -> Result<f64>| {
            path.map(|path| Table::read(path, number, manifest, table)).transpose()
        };
        let loads = read(loads, &load)?;
        let temperatures = read(temperatures, &kelvin)?;
        if let Some(Table {
            path,
            values: Values::Lines { outside: Some(_), .. },
            ..
        }) = &loads
        {
            bail!(
                "`{}` has heat taken up by `{SURROUNDINGS}`, which are no surface",
                path.display()
            );
        }
        let tables = loads.iter().chain(&temperatures);
        let mut given: Vec<(&Path, &[String])> = tables.map(|table| (&*table.path, &*table.names)).collect();
        given.extend(suns.map(|suns| (&*suns.path, &*suns.names)));
        let (path, names) = given
            .iter()
            .max_by_key(|(_, names)| names.len())
            .copied()
            .unwrap_or((Path::new(""), &[]));
        let other = given
            .iter()
            .find(|(_, other)| other.len() > 1 && other.len() != names.len());
        if let Some((other, of_other)) = other {
            bail!(
                "`{}` has {}, and `{}` {}: give both the same, or one of them a single one, which then holds for all",
                path.display(),
                counted(names.len() as u64, "moment"),
                other.display(),
                counted(of_other.len() as u64, "moment")
            );
        }
        let names = names.to_vec();
        let with_names = loads.iter().chain(&temperatures).filter(|table| !table.is_array());
        let mut named: Vec<(&Path, &[String])> = with_names.map(|table| (&*table.path, &*table.names)).collect();
        named.extend(suns.map(|suns| (&*suns.path, &*suns.names)));
        require_same_moments(&named)?;
        Ok(Self {
            loads,
            temperatures,
            coldest: coldest.get(),
            absorbed: Vec::new(),
            skies: Vec::new(),
            planets: Vec::new(),
            names,
        })
    }

    /// Adds sunlight that each patch absorbs, in W/m²: a vector for each sun.
    pub(super) fn absorb(&mut self, absorbed: Vec<Vec<f64>>) {
        self.absorbed = absorbed;
    }

    /// Takes the temperatures of the sky from a table of suns that has them: a table has one at each moment, or none.
    pub(super) fn take_skies(&mut self, suns: &Suns) {
        let skies = suns.moments.iter().map(|moment| moment.sky_temperature);
        self.skies = skies.collect::<Option<_>>().unwrap_or_default();
    }

    /// Takes the infrared that arrives from planets; `planets` has what arrives of a radiosity of 1.
    pub(super) fn take_planets(&mut self, planets: &Block, suns: &Suns) {
        if !suns.has_infrared() {
            return;
        }
        let of = |(at, moment): (usize, &Moment)| {
            let sent = moment.planet.map_or(0.0, |planet| planet.infrared);
            (sent, planets.column(at).collect())
        };
        self.planets = suns.moments.iter().enumerate().map(of).collect();
    }

    /// Number of moments.
    pub(super) fn len(&self) -> usize {
        self.names.len().max(1)
    }

    /// Names of the moments; none without a table.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// The temperature of what lies above, in kelvin, at a moment: that of the schedule, else of the suns' table, else
    /// `otherwise`.
    pub(super) fn ambient(&self, moment: usize, otherwise: f64) -> f64 {
        let place = if self.skies.len() == 1 { 0 } else { moment };
        let scheduled = self.temperatures.as_ref().and_then(|table| table.outside(moment));
        scheduled
            .or_else(|| self.skies.get(place).copied())
            .unwrap_or(otherwise)
    }

    /// Temperatures of tables below [`Temperature::COLD`], in kelvin, with what they are of: perhaps degrees Celsius.
    pub(super) fn cold(&self) -> Vec<String> {
        let of_skies = self.skies.iter().copied().fold(None, colder);
        let of_schedule = self.temperatures.as_ref().map(|table| table.path.display().to_string());
        let found = [
            (self.coldest, of_schedule.unwrap_or_default()),
            (of_skies, "sky_temperature".to_owned()),
        ];
        let told = |(kelvin, of): (Option<f64>, String)| Some(format!("{} K of `{of}`", figures(kelvin?)));
        found.into_iter().filter_map(told).collect()
    }

    /// The exchange at the temperatures of a moment.
    pub(super) fn at(&self, moment: usize, heat: &Heat, surroundings: &Surroundings) -> Result<Heat> {
        let mut found = heat.clone();
        let sky = self.ambient(moment, surroundings.ambient);
        if self.has_surroundings() {
            surroundings.surround(&mut found, sky);
        }
        if let Some(table) = &self.temperatures {
            found = found
                .with_temperatures(&table.of(moment, f64::NAN)?)
                .map_err(|error| table.told(error))?;
        }
        let place = if self.planets.len() == 1 { 0 } else { moment };
        if let Some((infrared, factors)) = self.planets.get(place) {
            // It stands before the sky.
            let more = infrared - STEFAN_BOLTZMANN * sky.powi(4);
            let outside = found.outside.get_or_insert_with(|| vec![0.0; factors.len()]);
            for (outside, factor) in outside.iter_mut().zip(factors) {
                *outside += more * factor;
            }
        }
        Ok(found)
    }

    /// What each patch takes up from elsewhere at a moment, in W/m².
    pub(super) fn load_at(&self, moment: usize) -> Result<Option<Vec<f64>>> {
        let load = self.loads.as_ref().map(|table| table.of(moment, 0.0)).transpose()?;
        let place = if self.absorbed.len() == 1 { 0 } else { moment };
        let Some(absorbed) = self.absorbed.get(place) else {
            return Ok(load);
        };
        let load = load.unwrap_or_else(|| vec![0.0; absorbed.len()]);
        Ok(Some(load.iter().zip(absorbed).map(|(load, sun)| load + sun).collect()))
    }

    /// Returns whether the surroundings have a temperature at each moment.
    pub(super) fn has_surroundings(&self) -> bool {
        let is_scheduled = |table: &Table| table.outside(0).is_some();
        !self.skies.is_empty() || self.temperatures.as_ref().is_some_and(is_scheduled)
    }
}

/// The lower of two temperatures, where it is above 0 K and below [`Temperature::COLD`].
fn colder(than: Option<f64>, kelvin: f64) -> Option<f64> {
    if kelvin > 0.0 && kelvin < Temperature::COLD {
        Some(than.map_or(kelvin, |than| than.min(kelvin)))
    } else {
        than
    }
}

/// What lies outside a scene.
#[derive(Clone, Debug)]
pub(super) struct Surroundings {
    /// The share of each patch's view that leaves the scene, without what ends on the ground.
    pub(super) above: Vec<f64>,
    /// Its temperature, in kelvin.
    pub(super) ambient: f64,
    /// The share that ends on the ground, and its temperature.
    pub(super) ground: Option<(f64, Vec<f64>)>,
}

impl Surroundings {
    /// Surrounds an exchange, with what lies above at another temperature.
    pub(super) fn surround(&self, heat: &mut Heat, ambient: f64) {
        let mut around: Vec<(f64, &[f64])> = vec![(ambient, &self.above)];
        if let Some((kelvin, below)) = &self.ground {
            around.push((*kelvin, below));
        }
        heat.surround(&around);
    }
}

impl Table {
    fn read(
        path: &Path,
        number: &dyn Fn(&str) -> Result<f64>,
        manifest: &Manifest,
        patches: &PatchTable,
    ) -> Result<Self> {
        let ends_in = |name: &str| path.extension().is_some_and(|end| end.eq_ignore_ascii_case(name));
        if ends_in("npy") {
            let array = ArrayFile::open(path)?;
            if array.columns() != patches.len() as u64 {
                bail!(
                    "`{}` has {}, and the matrix {}: one row a moment is needed",
                    path.display(),
                    counted(array.columns(), "column"),
                    counted(patches.len() as u64, "patch")
                );
            }
            return Ok(Self {
                path: path.to_owned(),
                names: (0..array.rows()).map(|row| row.to_string()).collect(),
                values: Values::Array(array),
            });
        }
        let bytes =
            hemicube_scene::read_regular(path).with_context(|| format!("`{}` cannot be read", path.display()))?;
        let cells = Cells::read(&bytes, number).map_err(|(line, error)| match line {
            Some(line) => anyhow!("{}:{line}: {error}", path.display()),
            None => anyhow!("`{}` {error}", path.display()),
        })?;
        let (names, values) = cells
            .values(manifest, patches)
            .map_err(|(error, hint)| hinted(anyhow!("`{}` {error}", path.display()), hint))?;
        Ok(Self {
            path: path.to_owned(),
            names,
            values,
        })
    }

    /// True for an array, whose moments have numbers in place of names.
    fn is_array(&self) -> bool {
        matches!(self.values, Values::Array(_))
    }

    /// The place of a moment: a single one holds for all.
    fn place(&self, moment: usize) -> usize {
        if self.names.len() == 1 { 0 } else { moment }
    }

    /// The numbers of all patches at a moment, `otherwise` where the table says nothing.
    fn of(&self, moment: usize, otherwise: f64) -> Result<Vec<f64>> {
        let place = self.place(moment);
        match &self.values {
            Values::Array(array) => Ok(array.row(place as u64)?),
            Values::Lines { lines, of_patch, .. } => {
                let of = |&line: &u32| lines.get(line as usize).map_or(otherwise, |numbers| numbers[place]);
                Ok(of_patch.iter().map(of).collect())
            }
        }
    }

    fn outside(&self, moment: usize) -> Option<f64> {
        match &self.values {
            Values::Lines { outside, .. } => outside.as_ref().map(|numbers| numbers[self.place(moment)]),
            Values::Array(_) => None,
        }
    }

    fn told(&self, error: SolveError) -> anyhow::Error {
        anyhow::Error::new(error).context(format!("`{}` does not fit", self.path.display()))
    }
}

/// Requires that tables of several moments, which each name theirs, name the same in the same order.
fn require_same_moments(tables: &[(&Path, &[String])]) -> Result<()> {
    for (at, (path, names)) in tables.iter().enumerate() {
        for (other, of_other) in &tables[..at] {
            if names.len() == 1 || of_other.len() == 1 {
                continue;
            }
            if let Some(moment) = first_difference(of_other, names) {
                return Err(hinted(
                    anyhow!(
                        "moment {} is `{}` in `{}` and `{}` in `{}`",
                        moment + 1,
                        of_other[moment],
                        other.display(),
                        names[moment],
                        path.display()
                    ),
                    "moments are taken in the order of each table: give both the same names in the same order",
                ));
            }
        }
    }
    Ok(())
}

/// What the lines of a table are, when surfaces are its lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lines {
    Patches,
    Surfaces,
}

/// A table as written, with surfaces as lines.
#[derive(Debug, PartialEq)]
struct Cells {
    lines_are: Lines,
    moments: Vec<String>,
    surfaces: Vec<(String, Vec<f64>)>,
}

impl Cells {
    fn read(bytes: &[u8], number: &dyn Fn(&str) -> Result<f64>) -> Result<Self, Located> {
        let Head {
            mut reader,
            names: header,
            line: first_line,
        } = head(bytes)?;
        let first = header
            .first()
            .map_or_else(String::new, |name| name.to_ascii_lowercase());
        let (lines_are, is_turned) = match &*first {
            "patch" => (Lines::Patches, false),
            "surface" | "object" | "material" | "name" => (Lines::Surfaces, false),
            "time" | "moment" | "hour" => (Lines::Surfaces, true),
            other => {
                return Err((
                    Some(first_line),
                    anyhow!("begins with `{other}`, where `patch`, `surface` or `time` says what a line is"),
                ));
            }
        };
        let columns = &header[1.min(header.len())..];
        let mut lines: Vec<(String, Vec<f64>)> = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|error| told(&error))?;
            let line = record.position().map(csv::Position::line);
            let mut fields = record.iter();
            let name = fields.next().unwrap_or_default().to_owned();
            let numbers = fields.map(number).collect::<Result<Vec<f64>>>();
            lines.push((name, numbers.map_err(|error| (line, error))?));
        }
        if columns.is_empty() || lines.is_empty() {
            return Err((None, anyhow!("has no numbers")));
        }
        if !is_turned {
            return Ok(Self {
                lines_are,
                moments: columns.to_vec(),
                surfaces: lines,
            });
        }
        let column = |(at, name): (usize, &String)| (name.clone(), lines.iter().map(|(_, line)| line[at]).collect());
        Ok(Self {
            lines_are,
            surfaces: columns.iter().enumerate().map(column).collect(),
            moments: lines.iter().map(|(name, _)| name.clone()).collect(),
        })
    }

    /// The names of the moments, and the numbers by patch; or what is wrong, and the next step.
    fn values(self, manifest: &Manifest, table: &PatchTable) -> Result<(Vec<String>, Values), (String, String)> {
        let patches = table.len();
        let mut by_name: BTreeMap<String, u32> = BTreeMap::new();
        let mut outside = None;
        let mut lines = Vec::new();
        for (name, numbers) in self.surfaces {
            if name == SURROUNDINGS {
                outside = Some(numbers);
                continue;
            }
            let line = u32::try_from(lines.len()).unwrap_or(NONE);
            if by_name.insert(name.clone(), line).is_some() {
                return Err((format!("names `{name}` twice"), "leave one of the two out".to_owned()));
            }
            lines.push(numbers);
        }
        let mut of_patch = vec![NONE; patches];
        match self.lines_are {
            Lines::Patches => {
                for (name, line) in by_name {
                    match name.parse::<usize>().ok().filter(|&patch| patch < patches) {
                        Some(patch) => of_patch[patch] = line,
                        None => {
                            return Err((
                                format!(
                                    "has the patch `{name}`, and the matrix those from 0 to {}",
                                    patches.max(1) - 1
                                ),
                                "begin the header with `surface` where lines are objects or materials".to_owned(),
                            ));
                        }
                    }
                }
            }
            Lines::Surfaces => {
                let patterns = Patterns::new(&by_name);
                let tie = |tie: hemicube_scene::globs::Tie| (tie.to_string(), "name it by itself".to_owned());
                let of = |names: &[String]| {
                    let line = |name: &String| Ok(patterns.of(name)?.map(|(_, &line)| line));
                    names.iter().map(line).collect::<Result<Vec<Option<u32>>, _>>()
                };
                let objects = of(&manifest.objects).map_err(tie)?;
                let materials = of(&manifest.materials).map_err(tie)?;
                let named = |lines: &[Option<u32>], of: u32| lines.get(of as usize).copied().flatten();
                for (patch, line) in of_patch.iter_mut().enumerate() {
                    let object = named(&objects, table.object[patch]);
                    *line = object.or(named(&materials, table.material[patch])).unwrap_or(NONE);
                }
                let names: Vec<&String> = manifest.objects.iter().chain(&manifest.materials).collect();
                if let Some(unused) = patterns.unused(&names) {
                    let known: Vec<String> = names.iter().take(6).map(|name| format!("`{name}`")).collect();
                    return Err((
                        format!("names `{unused}`, which matches no object and no material"),
                        format!("the matrix has {}", known.join(", ")),
                    ));
                }
            }
        }
        Ok((
            self.moments,
            Values::Lines {
                lines,
                of_patch,
                outside,
            },
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(text: &str) -> Result<f64> {
        text.parse().map_err(|_| anyhow!("`{text}` is no number"))
    }

    #[test]
    fn surfaces_are_lines_or_columns() {
        let lines = Cells::read(b"surface,6:00,12:00\nroof,0,650\n\"wall, north\",10,200\n", &number).expect("a table");
        let columns = Cells::read(b"time;roof;wall, north\n6:00;0;10\n12:00;650;200\n", &number).expect("a table");
        assert_eq!(lines, columns);
        assert_eq!(lines.moments, ["6:00", "12:00"]);
        assert_eq!(lines.surfaces[1], ("wall, north".to_owned(), vec![10.0, 200.0]));
        let patches = Cells::read(b"# of noon\nPatch\tnoon\n0\t1\n", &number).expect("a table");
        assert_eq!(
            (patches.lines_are, patches.moments),
            (Lines::Patches, vec!["noon".to_owned()])
        );
    }

    #[test]
    fn tables_of_several_moments_have_the_same_in_the_same_order() {
        let of = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<String>>();
        let (day, turned, one) = (of(&["06:00", "12:00"]), of(&["12:00", "06:00"]), of(&["noon"]));
        let [a, b, c] = ["a.csv", "b.csv", "c.csv"].map(Path::new);
        assert!(require_same_moments(&[(a, &day), (b, &one), (c, &day)]).is_ok());
        let error = require_same_moments(&[(a, &day), (b, &one), (c, &turned)]).expect_err("another order");
        assert_eq!(
            error.to_string(),
            "moment 1 is `06:00` in `a.csv` and `12:00` in `c.csv`"
        );
    }

    #[test]
    fn what_is_malformed_is_refused_by_its_line() {
        let error = |text: &str| {
            let (line, error) = Cells::read(text.as_bytes(), &number).expect_err(text);
            format!("{line:?} {error}")
        };
        assert!(error("roof,1\n").contains("begins with `roof`"));
        assert!(error("surface,6:00\nroof,1\nwall,1,2\n").starts_with("Some(3) has 3 fields where the header has 2"));
        assert!(error("surface,6:00\nroof,hot\n").starts_with("Some(2) `hot` is no number"));
        assert!(error("surface\nroof\n").contains("no numbers"));
        assert!(error("surface,6:00\n").contains("no numbers"));
    }
}
