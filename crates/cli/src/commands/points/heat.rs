//! Radiosities of a solution, or of black surfaces at given temperatures, for mean radiant temperatures.

use super::Arguments;
use crate::args::Talk;
use crate::exit::hinted;
use crate::prepare::Prepared;
use crate::report::{counted, percent, require_matrix};
use anyhow::{Context, Result, anyhow, bail};
use hemicube::points::SensorRow;
use hemicube::solve::{STEFAN_BOLTZMANN, StoredSolution, Temperature, question_of_cold};
use hemicube::store::Store;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of a solution, where none is given.
const NAME: &str = "thermal";

/// The directory of a matrix and the name of its solution, of `DIR` or `DIR:NAME`.
pub(super) fn parts_of(given: &Path) -> (PathBuf, String) {
    if !given.is_dir()
        && let Some((directory, name)) = given.to_str().and_then(|text| text.rsplit_once(':'))
    {
        return (directory.into(), name.to_owned());
    }
    (given.to_owned(), NAME.to_owned())
}

/// Opens the matrix and the solution.
///
/// # Errors
/// When there is none.
pub(super) fn open(given: &Path) -> Result<(Store, StoredSolution)> {
    let (directory, name) = parts_of(given);
    require_matrix(&directory)?;
    let store = Store::open(&directory)?;
    let solution = crate::stored::solution(&store, &name)?;
    Ok((store, solution))
}

/// Opens the matrices and solutions: of one scene, one of heat and, with suns, one of light.
///
/// # Errors
/// When one is not there, or several are of one kind or of other scenes.
pub(super) fn open_all(given: &[PathBuf], with_suns: bool) -> Result<Vec<(Store, StoredSolution)>> {
    let opened: Vec<(Store, StoredSolution)> = given.iter().map(|given| open(given)).collect::<Result<_>>()?;
    let kind = |solution: &StoredSolution| solution.report()["quantity"].as_str().unwrap_or_default().to_owned();
    for (at, (store, solution)) in opened.iter().enumerate() {
        for (other_store, other) in &opened[..at] {
            if kind(solution) == kind(other) {
                bail!("two of `--solution` are of {}, and one is needed", kind(solution));
            }
            if store.manifest().scene.blake3 != other_store.manifest().scene.blake3 {
                bail!(
                    "`{}` and `{}` are of other scenes",
                    other_store.directory().display(),
                    store.directory().display()
                );
            }
        }
    }
    if opened.len() > 1 && !with_suns {
        return Err(hinted(
            anyhow!("`--solution` is given {} times, and one is needed", opened.len()),
            "`--suns FILE` takes one of light and one of heat",
        ));
    }
    Ok(opened)
}

/// Radiosities by triangle in W/m², and the temperatures of sky and ground in kelvin.
pub(super) struct Heat {
    radiosity: Vec<f64>,
    /// True if surfaces are black, and mirrors and panes emit what they absorb; otherwise radiosities are what leaves
    /// diffusely.
    is_of_kept: bool,
    outside: [f64; 2],
    /// Temperature of the scene's surfaces on average, where nothing says how warm what is below the horizon is: it is
    /// then taken to be at the sky's.
    instead_of_ground: Option<f64>,
}

/// Least change of a mean radiant temperature that is told, in kelvin: half of what ISO 7726 (1998) desires of those
/// who measure it.
const KELVINS_TOLD: f64 = 0.1;

impl Heat {
    /// Of a solution of heat with a single right-hand side.
    pub(super) fn alone(
        arguments: &Arguments,
        store: &Store,
        solution: &StoredSolution,
        prepared: &Prepared,
    ) -> Result<Self> {
        let report = solution.report();
        if report["quantity"] != "heat" {
            return Err(hinted(
                anyhow!(
                    "the solution in `{}` is of light, and a mean radiant temperature is of heat",
                    store.directory().display()
                ),
                format!("`hemicube solve {} --thermal` makes one", store.directory().display()),
            ));
        }
        let rows = solution.quantity("radiosity")?.rows();
        if rows != 1 {
            return Err(hinted(
                anyhow!(
                    "the solution in `{}` has {rows} right-hand sides; one of a single one is needed",
                    store.directory().display()
                ),
                "`--suns FILE` takes the moments that the solution was made for",
            ));
        }
        Self::new(arguments, solution, prepared, 0)
    }

    /// Of a right-hand side of a solution of heat; where patches are several triangles, each has its patch's radiosity.
    pub(super) fn new(arguments: &Arguments, solution: &StoredSolution, prepared: &Prepared, row: u64) -> Result<Self> {
        let heat = &solution.report()["surfaces"]["heat"];
        let of_moment = usize::try_from(row).ok().and_then(|row| heat["ambients"][row].as_f64());
        let ambient = of_moment.or_else(|| heat["ambient"].as_f64());
        let of = |given: Option<f64>, what: &str| {
            given.or(ambient).with_context(|| {
                format!("the solution does not say what lay outside; `--{what}-temperature KELVIN` does")
            })
        };
        let sky = of(arguments.sky_temperature, "sky")?;
        let known = arguments.ground_temperature.or_else(|| heat["ground"].as_f64());
        let ground = of(known, "ground")?;
        let radiosity = solution.quantity("radiosity")?.row(row)?;
        let radiosity = match &prepared.grouping {
            Some(grouping) => grouping.spread(&radiosity),
            None => radiosity,
        };
        Ok(Self {
            instead_of_ground: known.is_none().then(|| of_surfaces(&radiosity, prepared)),
            radiosity,
            is_of_kept: false,
            outside: [sky, ground],
        })
    }

    /// Of black surfaces at the temperatures of a table. What lies outside is NaN unless the options say how warm it
    /// is.
    pub(super) fn of_table(arguments: &Arguments, path: &Path, prepared: &Prepared, talk: Talk) -> Result<Self> {
        let table = read(path)?;
        let scene = &prepared.scene;
        let mut used = vec![false; table.len()];
        let mut without: BTreeMap<&str, u64> = BTreeMap::new();
        let mut radiosity = Vec::with_capacity(prepared.patches.len());
        for element in prepared.patches.iter() {
            let triangle = &scene.triangles[prepared.patches.triangle(element)];
            let object = scene.objects.get(triangle.object as usize).map_or("", String::as_str);
            let material = scene.materials.get(triangle.material as usize);
            let material = material.map_or("", |material| material.name.as_str());
            let place = [object, material, "*"]
                .iter()
                .find_map(|name| table.iter().position(|(known, _)| known == name));
            match place {
                Some(place) => {
                    used[place] = true;
                    radiosity.push(STEFAN_BOLTZMANN * table[place].1.powi(4));
                }
                None => {
                    *without.entry(object).or_default() += 1;
                    radiosity.push(f64::NAN);
                }
            }
        }
        if let Some((name, count)) = without.iter().next() {
            bail!(
                "`{}` has no temperature for the object `{name}`, {}, nor for {} more; a line `*,KELVIN` is for all \
                 others",
                path.display(),
                counted(*count, "patch"),
                counted(without.len() as u64 - 1, "object"),
            );
        }
        if let Some(place) = used
            .iter()
            .position(|used| !used)
            .filter(|&place| table[place].0 != "*")
        {
            bail!(
                "`{}` has a temperature for `{}`, and no object and no material has that name",
                path.display(),
                table[place].0
            );
        }
        let mut cold: Vec<String> = table
            .iter()
            .filter(|(_, kelvin)| *kelvin < Temperature::COLD)
            .map(|(name, kelvin)| format!("{kelvin} K of `{name}`"))
            .collect();
        for (given, name) in [
            (arguments.sky_temperature, "--sky-temperature"),
            (arguments.ground_temperature, "--ground-temperature"),
        ] {
            let is_cold = |kelvin: &f64| *kelvin > 0.0 && *kelvin < Temperature::COLD;
            cold.extend(given.filter(is_cold).map(|kelvin| format!("{kelvin} K of `{name}`")));
        }
        if let Some(question) = question_of_cold(&cold) {
            talk.warn(&question);
        }
        let sky = arguments.sky_temperature.unwrap_or(f64::NAN);
        let ground = arguments.ground_temperature.unwrap_or(sky);
        Ok(Self {
            instead_of_ground: arguments
                .ground_temperature
                .is_none()
                .then(|| of_surfaces(&radiosity, prepared)),
            radiosity,
            is_of_kept: true,
            outside: [sky, ground],
        })
    }

    /// Refuses rows that see what has no temperature.
    pub(super) fn require_outside<'a>(&self, mut rows: impl Iterator<Item = &'a SensorRow>) -> Result<()> {
        let [sky, ground] = self.outside;
        let is_seen = |share: f64, kelvin: f64| share > 0.0 && kelvin.is_nan();
        let sees = |row: &&SensorRow| is_seen(row.sky, sky) || is_seen(row.ground, ground);
        match rows.find(sees) {
            None => Ok(()),
            Some(_) => Err(hinted(
                anyhow!("points see what lies outside, and nothing says how warm that is"),
                "`--sky-temperature KELVIN` does, and `--ground-temperature KELVIN` for what is below the horizon",
            )),
        }
    }

    /// The mean radiant temperature of a row in kelvin.
    pub(super) fn temperature(&self, row: &SensorRow) -> f64 {
        self.temperature_with(row, self.outside)
    }

    /// Likewise under a sky of this temperature, in kelvin, where one is given.
    pub(super) fn temperature_under(&self, row: &SensorRow, sky: Option<f64>) -> f64 {
        let [of_solution, ground] = self.outside;
        self.temperature_with(row, [sky.unwrap_or(of_solution), ground])
    }

    /// By how many kelvins that of a row changes if what is below the horizon is as warm as the scene's surfaces; 0
    /// where it is known how warm it is.
    pub(super) fn change_by_ground(&self, row: &SensorRow) -> f64 {
        let other = self.instead_of_ground.filter(|_| row.ground > 0.0);
        other.map_or(0.0, |other| {
            self.temperature_with(row, [self.outside[0], other]) - self.temperature(row)
        })
    }

    /// The warning that the ground is taken to be at the sky's temperature, where that matters: `change` and `seen` are
    /// the greatest of all rows.
    pub(super) fn question_of_ground(&self, change: f64, seen: f64) -> Option<String> {
        let other = self.instead_of_ground.filter(|_| change.abs() >= KELVINS_TOLD)?;
        Some(format!(
            "what is below the horizon, up to {} of the view, is taken to be at the sky's {:.1} K; at {other:.1} K, as \
             the scene's surfaces are, mean radiant temperatures would change by up to {change:+.1} K; \
             `--ground-temperature KELVIN` says how warm it is",
            percent(seen),
            self.outside[1]
        ))
    }

    fn temperature_with(&self, row: &SensorRow, [sky, ground]: [f64; 2]) -> f64 {
        // Backs exchange nothing in `solve`, and have no temperature here.
        let outside = [sky, ground, f64::NAN];
        if self.is_of_kept && !row.passed.is_empty() {
            row.kept().mean_radiant_temperature(&self.radiosity, outside)
        } else {
            row.mean_radiant_temperature(&self.radiosity, outside)
        }
    }
}

/// The temperature whose black radiation is the mean radiosity of the scene's surfaces by area, in kelvin.
fn of_surfaces(radiosity: &[f64], prepared: &Prepared) -> f64 {
    let patches = &prepared.patches;
    let (mut power, mut area) = (0.0, 0.0);
    for (patch, radiosity) in patches.iter().zip(radiosity).filter(|(_, b)| b.is_finite()) {
        power += patches.area(patch) * radiosity;
        area += patches.area(patch);
    }
    (power / area.max(f64::MIN_POSITIVE) / STEFAN_BOLTZMANN)
        .max(0.0)
        .powf(0.25)
}

/// Bytes of a table of temperatures, at most.
const TABLE_BYTES_MAX: u64 = 1 << 26;

/// Names and temperatures in kelvin, one a line: `name,kelvin` or `name,20 °C`. A name in quotes may hold a comma; a
/// first line whose second column is `temperature` is a header.
fn read(path: &Path) -> Result<Vec<(String, f64)>> {
    let failed = || format!("`{}` cannot be read", path.display());
    if std::fs::metadata(path).with_context(failed)?.len() > TABLE_BYTES_MAX {
        bail!(
            "`{}` is larger than a table of temperatures may be, 64 MB",
            path.display()
        );
    }
    let text = hemicube_scene::read_regular_text(path).with_context(failed)?;
    let mut found: Vec<(String, f64)> = Vec::new();
    let mut lines: BTreeMap<String, usize> = BTreeMap::new();
    for (at, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let place = || format!("{}:{}", path.display(), at + 1);
        let parts = line.rsplit_once([',', ';', '\t']);
        let Some((name, value)) = parts.map(|(name, value)| (name.trim().trim_matches('"'), value.trim())) else {
            bail!(
                "{}: a line is a name and a temperature, with a comma between them",
                place()
            );
        };
        if found.is_empty() && value.eq_ignore_ascii_case("temperature") {
            continue;
        }
        let kelvin = match value.trim_matches('"').parse::<Temperature>() {
            Ok(temperature) if (0.0..=1e6).contains(&temperature.kelvin()) => temperature.kelvin(),
            _ => bail!(
                "{}: `{value}` is no temperature: kelvin from 0 on, or text such as `20 °C`",
                place()
            ),
        };
        if let Some(first) = lines.insert(name.to_owned(), at + 1) {
            bail!("{}: `{name}` has a temperature in line {first} already", place());
        }
        found.push((name.to_owned(), kelvin));
    }
    if found.is_empty() {
        bail!("`{}` has no temperature", path.display());
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_temperatures_are_read_and_refused_by_line() {
        let path = std::env::temp_dir().join(format!("hemicube-temperatures-{}", std::process::id()));
        std::fs::write(
            &path,
            "surface,temperature\nfloor, 30 °C\n# none\n\"wall, north\",293.15\n*;250\n",
        )
        .expect("a file");
        let table = read(&path).expect("a table");
        let names: Vec<&str> = table.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["floor", "wall, north", "*"]);
        assert!((table[0].1 - 303.15).abs() < 1e-9 && table[2].1 == 250.0);
        for (text, says) in [
            ("floor\n", ":1: a line is"),
            ("floor,300\nfloor,301\n", ":2: `floor`"),
            ("floor,-1\n", "`-1` is no temperature"),
            ("floor,warm\n", "`warm` is no temperature"),
            ("# nothing\n", "has no temperature"),
        ] {
            std::fs::write(&path, text).expect("a file");
            let error = read(&path).expect_err(text).to_string();
            assert!(error.contains(says), "{error}");
        }
        std::fs::remove_file(&path).expect("it was there");
    }
}
