//! Settings in layers: command line, environment, `./hemicube.toml`, the user's file, built-in.
//!
//! Every layer below the command line becomes the *default* of the flag of the same name: one definition parses all of
//! them, and one rule decides. The origin of each value is kept beside it.

use crate::exit::hinted;
use anyhow::{Context, Result, anyhow, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, Command};
use hemicube_host::Registry;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;
use std::fmt::Write as _;
use std::io::Read;
use std::path::{Path, PathBuf};
use strsim::levenshtein;
use toml::de::{DeTable, DeValue};

/// Flags accepted as settings in files and in the environment.
const SETTINGS: [&str; 28] = [
    "backend",
    "backend-option",
    "engine",
    "tolerance",
    "correction",
    "resolution",
    "samples",
    "culling",
    "split",
    "patch-size",
    "two-sided",
    "flip",
    "exclude",
    "up",
    "scale",
    "keep-duplicates",
    "rows",
    "seed",
    "emitters",
    "receivers",
    "occluders",
    "by",
    "form",
    "min-factor",
    "threads",
    "memory",
    "batch",
    "scenes",
];

/// Groups of settings that exclude each other: the strongest layer's holds.
pub(crate) const EXCLUSIVE: [&[&str]; 4] = [
    &["split", "patch-size"],
    &["correction", "tolerance"],
    &["samples", "tolerance"],
    &["resolution", "tolerance"],
];

/// Options of the command line that choose among what others ask for: without any of these they do nothing. In files
/// they stand ready for other runs.
const CHOOSES: [(&str, &str, [&str; 2]); 1] = [("compute", "seed", ["rows", "verify"])];

/// Values compatible with their group: a tolerance chooses the pixels.
const AGREES: [(&str, &str); 3] = [("correction", "tolerance"), ("resolution", "auto"), ("samples", "1")];

/// Options of the command line that do nothing unless pixels are summed. In files they stand ready for other runs.
const OF_PIXELS: [&str; 2] = ["resolution", "samples"];

/// Variables that are no settings of a command, read in other places.
const OTHER_VARIABLES: [&str; 2] = ["HEMICUBE_BACKEND_PATH", "HEMICUBE_LOG"];

/// Settings with another meaning to a subcommand, taken from its command line only.
const OWN: [(&str, &str); 1] = [("tradeoff", "rows")];

/// Settings that run code from a file. A file found by its place may not name such code: the scene's folder is less
/// trusted than the command line (`docs/security.md`).
const RUNS_CODE: [&str; 1] = ["backend"];

/// `--config none`: no file of settings.
const NO_FILE: &str = "none";

/// Name of the file of settings in the working directory.
const FILE: &str = "hemicube.toml";

/// No file of settings is larger; a scene given by mistake is.
const FILE_SIZE_MAX: u64 = 1 << 20;

/// Origin of a value. Stronger layers compare greater.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Origin {
    User(PathBuf, usize),
    Project(PathBuf, usize),
    Environment(String),
    CommandLine,
}

impl Origin {
    fn layer(&self) -> u8 {
        match self {
            Self::User(..) => 0,
            Self::Project(..) => 1,
            Self::Environment(_) => 2,
            Self::CommandLine => 3,
        }
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::User(path, line) | Self::Project(path, line) => write!(f, "{}:{line}", path.display()),
            Self::Environment(name) => f.write_str(name),
            Self::CommandLine => f.write_str("command line"),
        }
    }
}

/// A value below the command line, as the words after its flag.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Layered {
    words: Vec<String>,
    origin: Origin,
}

/// A setting in force.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Setting {
    /// Its long name.
    pub(crate) name: &'static str,
    /// Values: several for a repeatable setting, none for an unset one.
    pub(crate) values: Vec<String>,
    /// Their origin; `None` if built in.
    pub(crate) origin: Option<String>,
}

/// The values of all layers below the command line, the strongest of each setting.
#[derive(Debug, Default)]
pub(crate) struct Layers(BTreeMap<&'static str, Layered>);

/// Variables `HEMICUBE_…` of this process that nothing reads and that are like no setting's.
///
/// # Errors
/// For a misspelt one, or one of an option that is no setting.
pub(crate) fn unread_variables(command: &Command) -> Result<Vec<String>> {
    unread(
        command,
        std::env::vars_os().filter_map(|(name, _)| name.into_string().ok()),
    )
}

impl Layers {
    /// Gathers the layers of a subcommand. `matches` is the parsed command line.
    pub(crate) fn gather(command: &Command, matches: &ArgMatches) -> Result<Self> {
        let mut layers = Self::default();
        // `interactive` has no such flag.
        let chosen = matches.try_get_one::<PathBuf>("config").ok().flatten();
        if let Some(path) = chosen {
            if path.as_os_str() != NO_FILE {
                layers.read(path, Origin::Project)?;
            }
        } else {
            // Weakest first: later layers replace earlier ones.
            if let Some(path) = user_file()
                && path.exists()
            {
                layers.read(&path, Origin::User)?;
            }
            if Path::new(FILE).exists() {
                layers.read(Path::new(FILE), Origin::Project)?;
            }
            layers.refuse_code()?;
        }
        for name in SETTINGS {
            let variable = variable(name);
            if let Some(value) = std::env::var_os(&variable) {
                let word = value
                    .into_string()
                    .map_err(|_| anyhow!("the variable `{variable}` is not UTF-8"))?;
                layers.0.insert(
                    name,
                    Layered {
                        words: vec![word],
                        origin: Origin::Environment(variable),
                    },
                );
            }
        }
        layers
            .0
            .retain(|name, _| argument(command, name).is_some() && !OWN.contains(&(command.get_name(), *name)));
        for (name, layered) in &layers.0 {
            layered.check(command, name)?;
        }
        layers.exclude(matches)?;
        for (of, name, asks) in CHOOSES {
            // A range of rows leaves nothing to choose.
            let chooses = |word: &str| !word.contains("..");
            let is_asked = |asks: &&str| {
                let given = matches.get_raw(asks).filter(|_| is_given(matches, asks));
                match given {
                    Some(mut words) => words.any(|word| word.to_str().is_none_or(chooses)),
                    None => layers
                        .0
                        .get(*asks)
                        .is_some_and(|layered| layered.words.iter().any(|word| chooses(word))),
                }
            };
            if of == command.get_name() && is_given(matches, name) && !asks.iter().any(is_asked) {
                bail!(
                    "`--{name}` chooses the sample of `--{}`, and none of these is given",
                    asks.join("` or `--")
                );
            }
        }
        Ok(layers)
    }

    /// # Errors
    /// When the command line sets hemicubes of pixels, and a tolerance chooses its own.
    pub(crate) fn refuse_idle(&self, command: &Command, matches: &ArgMatches) -> Result<()> {
        if argument(command, "correction").is_none() || self.sums_pixels(matches) {
            return Ok(());
        }
        let idle = |name: &&&str| is_given(matches, name) && !self.agrees(matches, name);
        match OF_PIXELS.iter().find(idle) {
            None => Ok(()),
            Some(name) => Err(hinted(
                anyhow!("`--{name}` does nothing: a tolerance chooses its hemicubes"),
                "leave it out, or sum pixels by `--correction pixel`",
            )),
        }
    }

    /// Returns whether rows are sums of pixels.
    fn sums_pixels(&self, matches: &ArgMatches) -> bool {
        if is_given(matches, "correction") {
            let given = matches.get_raw("correction");
            return given.is_some_and(|mut words| words.any(|word| word == "pixel"));
        }
        self.0
            .get("correction")
            .is_some_and(|layered| layered.words.iter().any(|word| word == "pixel"))
    }

    /// Lets the strongest of settings that exclude each other win. Refuses two of the same layer.
    fn exclude(&mut self, matches: &ArgMatches) -> Result<()> {
        for group in EXCLUSIVE {
            let set: Vec<(&str, Origin)> = group
                .iter()
                .filter_map(|&name| {
                    let given = is_given(matches, name).then_some(Origin::CommandLine);
                    given
                        .or_else(|| self.0.get(name).map(|l| l.origin.clone()))
                        .map(|origin| (name, origin))
                })
                .collect();
            let Some(top) = set.iter().map(|(_, origin)| origin.layer()).max() else {
                continue;
            };
            let strongest: Vec<_> = set
                .iter()
                .filter(|(name, origin)| origin.layer() == top && !self.agrees(matches, name))
                .collect();
            if let [(first, at), (second, other), ..] = strongest[..] {
                let places = if at == other {
                    at.to_string()
                } else {
                    format!("{at} and {other}")
                };
                bail!("`--{first}` and `--{second}` exclude each other, and both are given ({places}); choose one");
            }
            for (name, origin) in &set {
                if origin.layer() < top {
                    self.0.remove(name);
                }
            }
        }
        Ok(())
    }

    /// Refuses code named by files of the working directory: every backend file in `./hemicube.toml`, and those that
    /// the user's file names relative to the working directory.
    fn refuse_code(&self) -> Result<()> {
        for name in RUNS_CODE {
            let Some(Layered { words, origin }) = self.0.get(name) else {
                continue;
            };
            let is_code = |word: &String| match origin {
                Origin::Project(..) => Registry::is_path(word),
                Origin::User(..) => Registry::is_path(word) && !Path::new(word).is_absolute(),
                Origin::Environment(_) | Origin::CommandLine => false,
            };
            let Some(word) = words.iter().find(|word| is_code(word)) else {
                continue;
            };
            let (what, hint) = match origin {
                Origin::User(..) => (
                    "a path from the working directory, wherever that is",
                    "give its whole path".to_owned(),
                ),
                _ => (
                    "code, and what was found in the working directory may not have it run",
                    format!(
                        "if you trust it, say so by `--{name} {word}` or `--config {FILE}`; `--config {NO_FILE}` \
                         leaves the file out"
                    ),
                ),
            };
            return Err(hinted(
                anyhow!("{origin}: `{name} = {}` names {what}", toml_value(word)),
                hint,
            ));
        }
        Ok(())
    }

    /// Returns whether a setting has its value of [`AGREES`], compatible with its group.
    fn agrees(&self, matches: &ArgMatches, name: &str) -> bool {
        let Some((_, value)) = AGREES.iter().find(|(setting, _)| *setting == name) else {
            return false;
        };
        if is_given(matches, name) {
            return matches
                .get_raw(&id(name))
                .is_some_and(|mut values| values.any(|given| given == *value));
        }
        self.0
            .get(name)
            .is_some_and(|layered| layered.words.iter().any(|word| word == value))
    }

    fn read(&mut self, path: &Path, origin: fn(PathBuf, usize) -> Origin) -> Result<()> {
        self.take(&read_text(path)?, path, origin)
    }

    /// Takes the settings of a file's text.
    fn take(&mut self, text: &str, path: &Path, origin: fn(PathBuf, usize) -> Origin) -> Result<()> {
        let line = |offset: usize| {
            1 + text
                .as_bytes()
                .iter()
                .take(offset)
                .filter(|&&byte| byte == b'\n')
                .count()
        };
        let place = |offset: usize| format!("{}:{}", path.display(), line(offset));
        let table = DeTable::parse(text).map_err(|error| {
            let place = error
                .span()
                .map_or_else(|| path.display().to_string(), |span| place(span.start));
            anyhow!("{place}: {}", error.message().trim().replace('\n', ", "))
        })?;
        for (key, value) in table.get_ref() {
            let place = place(key.span().start);
            let name = SETTINGS
                .into_iter()
                .find(|&name| name == key.get_ref())
                .ok_or_else(|| {
                    let error = anyhow!("{place}: there is no setting `{}`", key.get_ref());
                    match nearest(key.get_ref()) {
                        Some(name) => hinted(error, format!("did you mean `{name}`?")),
                        None => hinted(error, "`hemicube compute --print-config` lists all settings"),
                    }
                })?;
            let words = words(value.get_ref()).with_context(|| format!("{place}: `{name}`"))?;
            self.0.insert(
                name,
                Layered {
                    words,
                    origin: origin(path.to_owned(), line(key.span().start)),
                },
            );
        }
        Ok(())
    }

    /// The definition, these layers' values the defaults of `subcommand`.
    pub(crate) fn apply(&self, command: Command, subcommand: &str) -> Command {
        command.mut_subcommand(subcommand, |mut command| {
            for (name, layered) in &self.0 {
                if argument(&command, name).is_some() {
                    command = command.mut_arg(id(name), |arg| arg.default_values(layered.words.clone()));
                }
            }
            command
        })
    }

    /// All settings of a subcommand, by these layers and a command line.
    pub(crate) fn settings(&self, command: &Command, matches: &ArgMatches) -> Vec<Setting> {
        let mut settings = Vec::new();
        for name in SETTINGS {
            if argument(command, name).is_none_or(|arg| arg.is_hide_set()) {
                continue;
            }
            let given = is_given(matches, name).then(|| Origin::CommandLine.to_string());
            settings.push(Setting {
                name,
                values: matches
                    .get_raw(&id(name))
                    .into_iter()
                    .flatten()
                    .map(|value| value.to_string_lossy().into_owned())
                    .collect(),
                origin: given.or_else(|| self.0.get(name).map(|layered| layered.origin.to_string())),
            });
        }
        settings
    }

    /// All settings of a subcommand, as a file of settings with origins.
    pub(crate) fn print(&self, command: &Command, matches: &ArgMatches) -> String {
        let mut lines = Vec::new();
        for Setting { name, values, origin } in self.settings(command, matches) {
            let origin = origin.unwrap_or_else(|| "built-in".to_owned());
            let values: Vec<String> = values.iter().map(|value| toml_value(value)).collect();
            lines.push(match &values[..] {
                [] => (format!("# {name} ="), "not set".to_owned()),
                _ if matches!(name, "backend-option" | "emitters" | "receivers" | "occluders") => {
                    (format!("{name} = [{}]", values.join(", ")), origin)
                }
                [value, ..] => (format!("{name} = {value}"), origin),
            });
        }
        let width = lines
            .iter()
            .map(|(setting, _)| setting.chars().count())
            .max()
            .unwrap_or(0);
        lines.iter().fold(String::new(), |mut text, (setting, origin)| {
            let _ = writeln!(text, "{setting:width$}  # {origin}");
            text
        })
    }
}

impl Layered {
    /// Parses the value with its flag alone, so that an error can name its origin.
    fn check(&self, command: &Command, name: &str) -> Result<()> {
        match refusal(command, name, &self.words) {
            None => Ok(()),
            Some(reason) => bail!("{}: {reason}", self.origin),
        }
    }
}

/// The error of a flag's parser about `words`; `None` if it accepts them.
pub(crate) fn refusal(command: &Command, name: &str, words: &[String]) -> Option<String> {
    let arg = argument(command, name)?;
    let mut line: Vec<OsString> = vec!["hemicube".into()];
    let is_positional = arg.is_positional();
    line.extend(words.iter().map(|word| match is_positional {
        true => word.into(),
        false => format!("--{name}={word}").into(),
    }));
    let error = Command::new("hemicube")
        .arg(arg.clone())
        .try_get_matches_from(line)
        .err()?;
    let text = error.render().to_string();
    let first = text
        .lines()
        .find(|line| !line.trim().is_empty())
        .unwrap_or("it is wrong");
    let possible = text
        .lines()
        .map(str::trim)
        .find(|line| line.starts_with("[possible values"));
    let first = first.strip_prefix("error: ").unwrap_or(first);
    Some(format!(
        "{first}{}",
        possible.map(|p| format!(" {p}")).unwrap_or_default()
    ))
}

/// The file to write settings to: the one in the working directory, otherwise the user's; without either, a new one in
/// the working directory.
pub(crate) fn file_to_write() -> PathBuf {
    let project = PathBuf::from(FILE);
    match user_file() {
        Some(user) if user.exists() && !project.exists() => user,
        _ => project,
    }
}

/// Returns the text of a file of settings with `changes` made and all else preserved. Settings that exclude a changed
/// one become comments.
///
/// # Errors
/// When the program would not read the text, before or after.
pub(crate) fn changed(text: &str, path: &Path, changes: &[(&str, &str)], command: &Command) -> Result<String> {
    let table = DeTable::parse(text)
        .map_err(|error| anyhow!("`{}`: {}", path.display(), error.message().trim().replace('\n', ", ")))?;
    // Replacements by place in the text: end of the range, and new text.
    let mut edits: BTreeMap<usize, (usize, String)> = BTreeMap::new();
    let mut added = String::new();
    for (name, value) in changes {
        let entry = table.get_ref().iter().find(|(key, _)| key.get_ref() == name);
        if let Some((_, old)) = entry {
            edits.insert(old.span().start, (old.span().end, toml_value(value)));
        } else {
            let _ = writeln!(added, "{name} = {}", toml_value(value));
        }
        let excluding = EXCLUSIVE.iter().filter(|group| group.contains(name)).copied().flatten();
        for other in excluding.filter(|other| *other != name && !changes.iter().any(|(name, _)| name == *other)) {
            let key = table
                .get_ref()
                .iter()
                .map(|(key, _)| key)
                .find(|key| key.get_ref() == other);
            if let Some(key) = key {
                edits.insert(key.span().start, (key.span().start, "# ".to_owned()));
            }
        }
    }
    let mut changed = text.to_owned();
    for (start, (end, new)) in edits.into_iter().rev() {
        changed.replace_range(start..end, &new);
    }
    if !added.is_empty() && !changed.is_empty() && !changed.ends_with('\n') {
        changed.push('\n');
    }
    changed.push_str(&added);
    let mut layers = Layers::default();
    layers.take(&changed, path, Origin::Project)?;
    for (name, layered) in &layers.0 {
        layered.check(command, name)?;
    }
    // As for an empty command line.
    layers.exclude(&ArgMatches::default())?;
    if path == Path::new(FILE) {
        layers.refuse_code()?;
    }
    Ok(changed)
}

fn read_text(path: &Path) -> Result<String> {
    let cannot = || format!("the settings in `{}` cannot be read", path.display());
    let file = hemicube_scene::open_regular(path).with_context(cannot)?;
    let mut bytes = Vec::new();
    file.take(FILE_SIZE_MAX + 1)
        .read_to_end(&mut bytes)
        .with_context(cannot)?;
    if bytes.len() as u64 > FILE_SIZE_MAX {
        bail!("`{}` is too large for a file of settings", path.display());
    }
    String::from_utf8(bytes).map_err(|_| anyhow!("`{}` is no file of settings: it is not UTF-8", path.display()))
}

/// A value as the words after its flag.
fn words(value: &DeValue<'_>) -> Result<Vec<String>> {
    Ok(vec![match value {
        DeValue::String(text) => text.clone().into_owned(),
        DeValue::Integer(number) if number.radix() == 10 => number.as_str().to_owned(),
        DeValue::Integer(number) => u64::from_str_radix(number.as_str(), number.radix())
            .context("the number is too large")?
            .to_string(),
        DeValue::Float(number) => number.as_str().to_owned(),
        DeValue::Boolean(_) => bail!("a switch is \"on\" or \"off\", in quotes"),
        DeValue::Array(values) => {
            return values
                .iter()
                .map(|value| match value.get_ref() {
                    DeValue::String(text) => Ok(text.clone().into_owned()),
                    _ => bail!("a list of texts in quotes is needed"),
                })
                .collect();
        }
        DeValue::Datetime(_) | DeValue::Table(_) => bail!("a number, a text or a list of texts is needed"),
    }])
}

fn toml_value(text: &str) -> String {
    let is_number = text.parse::<f64>().is_ok_and(f64::is_finite) && text.starts_with(|c: char| c.is_ascii_digit());
    if is_number && !text.ends_with('.') {
        return text.to_owned();
    }
    toml::Value::String(text.to_owned()).to_string()
}

/// The user's file, on systems with a place for it.
fn user_file() -> Option<PathBuf> {
    let set = |name: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let directory = if cfg!(windows) {
        set("APPDATA")
    } else {
        // The specification: a relative path is ignored.
        set("XDG_CONFIG_HOME")
            .filter(|path| path.is_absolute())
            .or_else(|| set("HOME").map(|home| home.join(".config")))
    };
    Some(directory?.join("hemicube").join(FILE))
}

fn variable(name: &str) -> String {
    format!("HEMICUBE_{}", name.replace('-', "_").to_ascii_uppercase())
}

fn id(name: &str) -> String {
    name.replace('-', "_")
}

fn argument<'a>(command: &'a Command, name: &str) -> Option<&'a clap::Arg> {
    let is_named = |arg: &&clap::Arg| match arg.get_long() {
        Some(long) => long == name,
        None => arg.is_positional() && arg.get_id() == name,
    };
    command.get_arguments().find(is_named)
}

fn is_given(matches: &ArgMatches, name: &str) -> bool {
    // Asking for the source of an unknown flag would panic.
    matches.ids().any(|known| known.as_str() == id(name))
        && matches.value_source(&id(name)) == Some(ValueSource::CommandLine)
}

/// The setting at most two edits from `name`.
fn nearest(name: &str) -> Option<&'static str> {
    let name = name.replace('_', "-").to_ascii_lowercase();
    SETTINGS
        .into_iter()
        .map(|setting| (levenshtein(&name, setting), setting))
        .min()
        .and_then(|(distance, setting)| (distance <= 2).then_some(setting))
}

/// Returns the variables `HEMICUBE_…` that nothing reads and that are like no setting's, for a warning.
///
/// # Errors
/// For a variable that is an option of `command` but no setting, or is misspelt.
fn unread(command: &Command, names: impl Iterator<Item = String>) -> Result<Vec<String>> {
    let mut unread = Vec::new();
    for given in names.filter(|name| name.starts_with("HEMICUBE_")) {
        let is_read = |name: &str| given == variable(name);
        if SETTINGS.into_iter().any(is_read) || OTHER_VARIABLES.contains(&given.as_str()) {
            continue;
        }
        if let Some(long) = command
            .get_arguments()
            .filter_map(clap::Arg::get_long)
            .find(|long| is_read(long))
        {
            return Err(hinted(
                anyhow!("the variable `{given}` is set, and `--{long}` is read from the command line only"),
                format!("give `--{long}`, and unset the variable"),
            ));
        }
        let known = SETTINGS
            .into_iter()
            .map(variable)
            .chain(OTHER_VARIABLES.map(str::to_owned));
        match known.map(|known| (levenshtein(&given, &known), known)).min() {
            // A fourth of its letters, so that no other short word is taken for a misspelt one.
            Some((distance, known)) if distance <= ((given.len() - "HEMICUBE_".len()) / 4).clamp(1, 2) => {
                return Err(hinted(
                    anyhow!("there is no setting of the variable `{given}`"),
                    format!("did you mean `{known}`?"),
                ));
            }
            _ => unread.push(given),
        }
    }
    Ok(unread)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_line::definition;
    use crate::exit::hint;

    fn compute() -> Command {
        let mut command = definition();
        command.build();
        command.find_subcommand("compute").expect("compute").clone()
    }

    #[test]
    fn every_setting_is_a_flag_of_compute() {
        let command = compute();
        // A setting of `interactive` only.
        for name in SETTINGS.into_iter().filter(|name| *name != "scenes") {
            assert!(argument(&command, name).is_some(), "{name}");
        }
    }

    #[test]
    fn every_flag_of_compute_is_a_setting_or_known_not_to_be() {
        let others = [
            "output",
            "overwrite",
            "update",
            "verify",
            "config",
            "print-config",
            "json",
            "quiet",
            "verbose",
            "no-progress",
            "color",
            // Each process has its own.
            "shard",
            "progress-file",
            // For this scene, not for all.
            "allow-large",
            "specular",
            "specular-bound",
            "symmetry",
            "sector",
            "periodic",
            "repeats",
            "help",
            "version",
        ];
        for arg in compute().get_arguments() {
            if let Some(name) = arg.get_long() {
                assert!(SETTINGS.contains(&name) != others.contains(&name), "{name}");
            }
        }
    }

    fn layers(text: &str) -> Result<Layers> {
        let file = std::env::temp_dir().join(format!("hemicube-config-{}-{:p}.toml", std::process::id(), &text));
        std::fs::write(&file, text).unwrap();
        let mut layers = Layers::default();
        let read = layers.read(&file, Origin::Project);
        std::fs::remove_file(&file).unwrap();
        read.map(|()| layers)
    }

    #[test]
    fn values_become_the_words_of_flags() {
        let read = layers("resolution = 512\n\n# why\nscale=1e-3\nemitters = ['a*', \"b\"]\nkeep-duplicates = 'off'\n")
            .unwrap();
        assert_eq!(read.0["resolution"].words, ["512"]);
        assert_eq!(read.0["scale"].words, ["1e-3"]);
        assert_eq!(read.0["emitters"].words, ["a*", "b"]);
        assert!(matches!(read.0["keep-duplicates"].origin, Origin::Project(_, 6)));
        assert!(layers("resolution = { n = 3 }").is_err() && layers("x = = 3").is_err());
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line() {
        let error = layers("\nresolutoin = 512\n").unwrap_err();
        assert!(
            error.to_string().contains(".toml:2: there is no setting `resolutoin`"),
            "{error}"
        );
        assert_eq!(nearest("resolutoin"), Some("resolution"));
        assert_eq!(nearest("patch_size"), Some("patch-size"));
        assert_eq!(nearest("colour"), None);
    }

    #[test]
    fn a_wrong_value_is_named_with_its_place() {
        let layered = |word: &str, origin| Layered {
            words: vec![word.to_owned()],
            origin,
        };
        let command = compute();
        assert!(
            layered("512", Origin::CommandLine)
                .check(&command, "resolution")
                .is_ok()
        );
        let wrong = layered("100", Origin::Environment("HEMICUBE_RESOLUTION".into())).check(&command, "resolution");
        let text = wrong.unwrap_err().to_string();
        assert!(
            text.starts_with("HEMICUBE_RESOLUTION: invalid value '100'") && text.contains("multiple of 16"),
            "{text}"
        );
        let wrong = layered("sometimes", Origin::Project("f".into(), 3)).check(&command, "culling");
        let text = wrong.unwrap_err().to_string();
        assert!(text.starts_with("f:3: ") && text.contains("auto, on, off"), "{text}");
    }

    #[test]
    fn a_file_is_changed_where_it_must_be_and_nowhere_else() {
        let command = compute();
        let changed = |text: &str, changes: &[(&str, &str)]| changed(text, Path::new("f"), changes, &command);
        let text = "# mine\nmin-factor = 1e-6 # fine\ntolerance = '1%'\n\nthreads=2";
        assert_eq!(
            changed(text, &[("min-factor", "1e-5"), ("form", "compact")]).unwrap(),
            "# mine\nmin-factor = 1e-5 # fine\ntolerance = '1%'\n\nthreads=2\nform = \"compact\"\n"
        );
        // A tolerance and sums of pixels exclude each other.
        assert_eq!(
            changed(text, &[("correction", "pixel")]).unwrap(),
            "# mine\nmin-factor = 1e-6 # fine\n# tolerance = '1%'\n\nthreads=2\ncorrection = \"pixel\"\n"
        );
        assert_eq!(changed("", &[("tolerance", "0.3%")]).unwrap(), "tolerance = \"0.3%\"\n");
        for (text, changes, words) in [
            ("x = = 3", [("threads", "1")], "f"),
            ("resolution = 3", [("threads", "1")], "multiple of 16"),
            ("", [("resolution", "3")], "multiple of 16"),
            ("patch-size = 1\nsplit = 2", [("threads", "1")], "exclude each other"),
        ] {
            let error = changed(text, &changes).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn variables_that_nothing_reads_are_named() {
        let of = |name: &str| unread(&compute(), std::iter::once(name.to_owned()));
        for read in ["HEMICUBE_RESOLUTION", "HEMICUBE_MEMORY", "HEMICUBE_LOG", "HOME"] {
            assert_eq!(of(read).unwrap(), [""; 0], "{read}");
        }
        for other in ["HEMICUBE_COLOUR", "HEMICUBE_"] {
            assert_eq!(of(other).unwrap(), [other]);
        }
        for (wrong, right) in [
            ("HEMICUBE_RESOLUTOIN", "did you mean `HEMICUBE_RESOLUTION`?"),
            ("HEMICUBE_TOLERENCE", "did you mean `HEMICUBE_TOLERANCE`?"),
            ("HEMICUBE_BACKENDPATH", "did you mean `HEMICUBE_BACKEND_PATH`?"),
            ("HEMICUBE_SHARD", "give `--shard`"),
            ("HEMICUBE_VERIFY", "give `--verify`"),
        ] {
            let error = of(wrong).unwrap_err();
            let hint = hint(&error).expect("a hint");
            assert!(
                error.to_string().contains(wrong) && hint.contains(right),
                "{error}: {hint}"
            );
        }
    }
}
