//! Results, kept in the output folder cell by cell: an interrupted run resumes.

use crate::report::{PendingFile, SCHEMA};
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file with all results.
const FILE: &str = "study.json";

/// The measuring machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Machine {
    pub(super) processor: String,
    pub(super) threads: usize,
    pub(super) system: String,
}

impl Machine {
    pub(super) fn this() -> Self {
        let said = |file: &str, field: &str| {
            let text = std::fs::read_to_string(file).ok()?;
            let line = text
                .lines()
                .find_map(|line| line.strip_prefix(field)?.trim_start().strip_prefix([':', '=']))?;
            Some(line.trim().trim_matches('"').to_owned())
        };
        Self {
            processor: said("/proc/cpuinfo", "model name").unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            system: said("/etc/os-release", "PRETTY_NAME").unwrap_or_else(|| std::env::consts::OS.to_owned()),
        }
    }
}

/// Settings of a cell, besides scene, backend and way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Settings {
    /// Patches of the city; all generated scenes are sized by it.
    pub(super) city: u64,
    pub(super) resolution: u32,
    /// The most hemicubes of a cell.
    pub(super) rows: u32,
    pub(super) turns: u32,
    /// Seconds allowed to the slowest way of a cell.
    pub(super) seconds: f64,
    /// Rows measured for their error.
    pub(super) sample_rows: u32,
}

impl Settings {
    /// The turns of a quick study; a whole one has more.
    pub(super) const QUICK_TURNS: u32 = 2;

    pub(super) fn is_quick(&self) -> bool {
        self.turns <= Self::QUICK_TURNS
    }
}

/// Speed of a way on a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Rate {
    pub(super) patches: u64,
    /// Rows measured.
    pub(super) rows: u64,
    /// Milliseconds a row: processor time, or wall-clock time for a GPU.
    pub(super) milliseconds: f64,
    pub(super) wall_milliseconds: f64,
    /// Processors kept busy.
    pub(super) processors: f64,
    pub(super) load_seconds: f64,
    /// Patches seen from a hemicube.
    pub(super) seen: f64,
    pub(super) nodes_tested: f64,
    pub(super) nodes_hidden: f64,
    pub(super) triangles: f64,
    pub(super) queries: f64,
    pub(super) bytes_read_back: f64,
    /// ‖F − F of `original`‖ / ‖F of `original`‖ over these rows, by the same backend.
    pub(super) from_original: f64,
    /// Likewise against the rows of the built-in backend.
    pub(super) from_built_in: f64,
    pub(super) choices: Vec<String>,
}

/// A backend's finding, measured anew beside its fastest rivals: in the same turns over the same rows, so that a
/// machine slowing down between two cells does not decide.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Choice {
    /// Name of the finding.
    pub(super) what: String,
    pub(super) patches: u64,
    pub(super) rows: u64,
    /// Rows that are neighbours in the order of work.
    pub(super) neighbours: u64,
    pub(super) found_milliseconds: f64,
    /// The fastest of the table, by their keys.
    pub(super) others: Vec<(String, f64)>,
    /// The backend's own words on its choices.
    pub(super) choices: Vec<String>,
}

impl Choice {
    /// The best of the others.
    pub(super) fn best(&self) -> Option<(&str, f64)> {
        let others = self.others.iter().map(|(name, ms)| (name.as_str(), *ms));
        others.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// A setting's error and time.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Point {
    pub(super) name: String,
    pub(super) family: String,
    pub(super) milliseconds: f64,
    pub(super) error: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

/// Error against time on a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Accuracy {
    pub(super) patches: u64,
    pub(super) rows: u64,
    /// The reference's own noise.
    pub(super) noise: f64,
    pub(super) points: Vec<Point>,
}

/// Cost of a whole run, from start to end.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Course {
    pub(super) patches: u64,
    pub(super) rows: u64,
    pub(super) seconds: f64,
    pub(super) processor_seconds: f64,
    pub(super) peak_bytes: u64,
    pub(super) matrix_bytes: u64,
    /// Seconds since the start, resident bytes, processors busy since the moment before.
    pub(super) moments: Vec<(f64, u64, f64)>,
}

/// A cell of the study.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Cell {
    Rate(Rate),
    Choice(Choice),
    Accuracy(Accuracy),
    Course(Course),
    /// Why there is nothing.
    None(String),
}

/// The study's file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Results {
    schema: u32,
    pub(super) program: String,
    /// Label of the run, a commit for example.
    pub(super) label: Option<String>,
    pub(super) machine: Machine,
    pub(super) settings: Settings,
    /// By version, machine, settings, scene, backend and way. Cells of other settings stay.
    cells: BTreeMap<String, Cell>,
    #[serde(skip)]
    folder: PathBuf,
    #[serde(skip)]
    prefix: String,
    /// Cells measured by this run.
    #[serde(skip)]
    pub(super) measured: usize,
}

impl Results {
    /// Opens the folder with an earlier run's results.
    ///
    /// # Errors
    /// When it cannot be made, or holds a file of another program.
    pub(super) fn open(folder: &Path, label: Option<String>, settings: Settings) -> Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| format!("`{}` cannot be made", folder.display()))?;
        let machine = Machine::this();
        let path = folder.join(FILE);
        let cells = match hemicube_scene::read_regular(&path) {
            Ok(bytes) => {
                let before: Self = serde_json::from_slice(&bytes).with_context(|| {
                    format!(
                        "`{}` holds no study; move it away, or name another folder",
                        path.display()
                    )
                })?;
                if before.schema != SCHEMA {
                    bail!(
                        "`{}` is of schema {}, and this program writes {SCHEMA}",
                        path.display(),
                        before.schema
                    );
                }
                before.cells
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => BTreeMap::new(),
            Err(error) => return Err(error).with_context(|| format!("`{}` cannot be read", path.display())),
        };
        let version = env!("CARGO_PKG_VERSION");
        let key = serde_json::to_vec(&(version, &machine, settings)).context("settings are no JSON")?;
        Ok(Self {
            schema: SCHEMA,
            program: format!("hemicube {version}"),
            label,
            machine,
            settings,
            cells,
            folder: folder.to_owned(),
            prefix: blake3::hash(&key).to_hex()[..16].to_owned(),
            measured: 0,
        })
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    fn key(&self, parts: &[&str]) -> String {
        format!("{}/{}", self.prefix, parts.join("/"))
    }

    /// A cell of this machine and these settings.
    pub(super) fn get(&self, parts: &[&str]) -> Option<&Cell> {
        self.cells.get(&self.key(parts))
    }

    /// Speed of a way.
    pub(super) fn rate(&self, scene: &str, target: &str, way: &str) -> Option<&Rate> {
        match self.get(&[scene, target, way])? {
            Cell::Rate(rate) => Some(rate),
            _ => None,
        }
    }

    /// A finding beside its rivals.
    pub(super) fn choice(&self, scene: &str, target: &str, finding: &str) -> Option<&Choice> {
        match self.get(&[scene, target, finding])? {
            Cell::Choice(choice) => Some(choice),
            _ => None,
        }
    }

    /// Puts a cell in its place.
    pub(super) fn put(&mut self, parts: &[&str], cell: Cell) {
        self.measured += 1;
        self.cells.insert(self.key(parts), cell);
    }

    /// Writes the file.
    ///
    /// # Errors
    /// When the disk is full.
    pub(super) fn save(&self) -> Result<()> {
        let mut text = serde_json::to_string_pretty(self).context("the study is no JSON")?;
        text.push('\n');
        self.write(FILE, text.as_bytes())
    }

    /// Writes a file beside it.
    ///
    /// # Errors
    /// Like [`Results::save`].
    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.folder.join(name);
        let mut file = PendingFile::create(&path)?;
        file.write_all(bytes)
            .with_context(|| format!("`{}` cannot be written", path.display()))?;
        file.commit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_of_a_choice_is_the_fastest_of_the_others() {
        let choice = Choice {
            what: "culling".to_owned(),
            patches: 100,
            rows: 32,
            neighbours: 16,
            found_milliseconds: 1.0,
            others: vec![("depth".to_owned(), 1.5), ("order".to_owned(), 1.25)],
            choices: Vec::new(),
        };
        assert_eq!(choice.best(), Some(("order", 1.25)));
    }

    #[test]
    fn what_was_measured_is_found_again_and_only_for_the_same_settings() {
        let place = std::env::temp_dir().join(format!("hemicube-results-{}", std::process::id()));
        let settings = Settings {
            city: 100,
            resolution: 64,
            rows: 16,
            turns: 1,
            seconds: 1.0,
            sample_rows: 2,
        };
        let mut results = Results::open(&place, None, settings).unwrap();
        results.put(&["city", "cpu", "ours"], Cell::None("no reason".to_owned()));
        results.save().unwrap();
        let again = Results::open(&place, None, settings).unwrap();
        assert!(matches!(again.get(&["city", "cpu", "ours"]), Some(Cell::None(_))));
        assert!(again.get(&["city", "cpu", "thesis"]).is_none());
        let other = Results::open(&place, None, Settings { rows: 32, ..settings }).unwrap();
        assert!(other.get(&["city", "cpu", "ours"]).is_none());
        std::fs::write(place.join(FILE), "{}").unwrap();
        assert!(Results::open(&place, None, settings).is_err());
        std::fs::remove_dir_all(&place).unwrap();
    }
}
