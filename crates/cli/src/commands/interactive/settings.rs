//! Settings of a dialogue: its choices above the environment and the files of settings. Only the definition of the
//! command line decides on valid values.

use crate::config::{self, Layers, Setting};
use crate::report::PendingFile;
use anyhow::{Context, Result};
use clap::Command;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A setting offered by the dialogue. The command line's definition explains it.
#[derive(Debug)]
pub(super) struct Offered {
    pub(super) name: &'static str,
    /// A few words for the menu.
    pub(super) note: &'static str,
    /// Its cost.
    pub(super) cost: &'static str,
}

/// In the order of the menu. Figures are from `docs/dev/accuracy.md` and `docs/store.md`.
pub(super) const OFFERED: [Offered; 9] = [
    Offered {
        name: "tolerance",
        note: "the error to aim at: 1%, 0.3%",
        cost: "What keeps it is found out on a sample of the rows. 1% takes about 1.4 times the time of the default, 2%; \
               0.1% takes 8 times.",
    },
    Offered {
        name: "correction",
        note: "what form factors are made of",
        cost: "tolerance keeps the tolerance; pixel is the plain hemicube, as in the thesis, and says no error.",
    },
    Offered {
        name: "resolution",
        note: "pixels along an edge",
        cost: "Of sums of pixels. More of them show small and distant patches, and take longer. auto: 256.",
    },
    Offered {
        name: "samples",
        note: "hemicubes on a patch",
        cost: "Of sums of pixels. 4 take two to four times as long as 1, and see what the middle of a patch does not.",
    },
    Offered {
        name: "split",
        note: "cut edges in K pieces: K² times the patches",
        cost: "2 is 4 times the rows and up to 16 times the entries: time, and room on the disk.",
    },
    Offered {
        name: "backend",
        note: "what renders",
        cost: "cpu is built in; others are plugins, for graphics cards.",
    },
    Offered {
        name: "culling",
        note: "skip what cannot be seen",
        cost: "It changes the time, not the matrix. auto tries it out on a few hemicubes.",
    },
    Offered {
        name: "threads",
        note: "0: one for each core",
        cost: "More take less time and more memory; the matrix is the same.",
    },
    Offered {
        name: "form",
        note: "how the matrix is written",
        cost: "compact takes a third to a quarter of the disk, and other programs need ten lines to read it. auto: \
               from a million patches on.",
    },
];

/// Question for a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One of these.
    OneOf(Vec<String>),
    /// Of this form, in the words of the command line's help.
    Typed(String),
}

/// The settings in force.
#[derive(Debug)]
pub(super) struct Settings {
    /// The definition of the command line.
    definition: Command,
    /// True if files of settings hold.
    files: bool,
    /// Choices, by long names.
    chosen: BTreeMap<&'static str, String>,
    /// Values by choices and the layers below.
    present: Vec<Setting>,
}

impl Settings {
    /// Reads the layers below the dialogue.
    ///
    /// # Errors
    /// When a file of settings or a variable is wrong.
    pub(super) fn read(definition: Command) -> Result<Self> {
        Self::with(definition, true)
    }

    /// Reads the layers below the dialogue, with or without files of settings.
    pub(super) fn with(definition: Command, files: bool) -> Result<Self> {
        let chosen = BTreeMap::new();
        Ok(Self {
            files,
            present: present(&definition, &chosen, files)?,
            definition,
            chosen,
        })
    }

    /// The definition of a subcommand.
    fn command(&self, name: &str) -> Command {
        self.definition.find_subcommand(name).cloned().unwrap_or_default()
    }

    /// The value of a setting; `None` if unset.
    pub(super) fn value(&self, name: &str) -> Option<&str> {
        self.setting(name)?.values.first().map(String::as_str)
    }

    /// Its origin, unless built in or chosen here.
    pub(super) fn origin(&self, name: &str) -> Option<&str> {
        if self.is_chosen(name) {
            return None;
        }
        self.setting(name)?.origin.as_deref()
    }

    fn setting(&self, name: &str) -> Option<&Setting> {
        self.present.iter().find(|setting| setting.name == name)
    }

    /// Returns whether it was chosen here.
    pub(super) fn is_chosen(&self, name: &str) -> bool {
        self.chosen.contains_key(name)
    }

    /// Choices and their values.
    pub(super) fn chosen(&self) -> impl Iterator<Item = (&str, &str)> {
        self.chosen.iter().map(|(name, value)| (*name, value.as_str()))
    }

    /// The parser's error about a value; `None` if it accepts it.
    pub(super) fn refusal(&self, name: &str, value: &str) -> Option<String> {
        config::refusal(&self.command("compute"), name, &[value.to_owned()])
    }

    /// Chooses a value. Excluded choices are dropped, and so are choices without effect.
    ///
    /// # Errors
    /// When the parser refuses it, or a layer below has become wrong.
    pub(super) fn choose(&mut self, name: &'static str, value: &str) -> Result<()> {
        if let Some(reason) = self.refusal(name, value) {
            anyhow::bail!(reason);
        }
        let mut chosen = self.chosen.clone();
        for group in config::EXCLUSIVE.iter().filter(|group| group.contains(&name)) {
            chosen.retain(|other, _| !group.contains(other));
        }
        chosen.insert(name, value.to_owned());
        self.settle(chosen)
    }

    /// Takes a choice back.
    ///
    /// # Errors
    /// When a layer below has become wrong.
    pub(super) fn unset(&mut self, name: &str) -> Result<()> {
        let mut chosen = self.chosen.clone();
        chosen.remove(name);
        self.settle(chosen)
    }

    /// Takes all choices back.
    ///
    /// # Errors
    /// When a layer below has become wrong.
    pub(super) fn clear(&mut self) -> Result<()> {
        self.settle(BTreeMap::new())
    }

    /// Sets the choices, without those that change no setting.
    fn settle(&mut self, mut chosen: BTreeMap<&'static str, String>) -> Result<()> {
        let values = |settings: &[Setting]| -> Vec<Vec<String>> {
            settings.iter().map(|setting| setting.values.clone()).collect()
        };
        let wanted = values(&present(&self.definition, &chosen, self.files)?);
        for name in chosen.keys().copied().collect::<Vec<_>>() {
            let mut without = chosen.clone();
            without.remove(name);
            if values(&present(&self.definition, &without, self.files)?) == wanted {
                chosen = without;
            }
        }
        self.present = present(&self.definition, &chosen, self.files)?;
        self.chosen = chosen;
        Ok(())
    }

    /// Options of a subcommand for the choices that it knows.
    pub(super) fn words(&self, subcommand: &str) -> Vec<OsString> {
        words(&self.chosen, &self.command(subcommand))
    }

    /// Writes the choices, and `more`, into a file of settings.
    ///
    /// # Errors
    /// When it cannot be read or written, or the program would not read the result.
    pub(super) fn write(&mut self, path: &Path, more: &[(&str, &str)]) -> Result<()> {
        let text = match hemicube_scene::read_regular_text(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(error).with_context(|| format!("`{}` cannot be read", path.display())),
        };
        let changes: Vec<(&str, &str)> = self.chosen().chain(more.iter().copied()).collect();
        let text = config::changed(&text, path, &changes, &self.command("compute"))?;
        // A link stays: its target is replaced.
        let path = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let mut file = PendingFile::create(&path)?;
        file.write_all(text.as_bytes())
            .with_context(|| format!("`{}` cannot be written", path.display()))?;
        file.commit()?;
        // Choices against a variable's value must stay.
        self.settle(self.chosen.clone())
    }

    /// The file for [`Self::write`].
    pub(super) fn file() -> PathBuf {
        config::file_to_write()
    }

    /// Help on a setting, from the command line's definition.
    pub(super) fn help(&self, name: &str) -> String {
        let command = self.command("compute");
        let arg = command.get_arguments().find(|arg| arg.get_long() == Some(name));
        arg.and_then(clap::Arg::get_help)
            .map(ToString::to_string)
            .unwrap_or_default()
    }

    /// Form of a value, from the command line's definition.
    pub(super) fn form(&self, name: &str) -> String {
        let command = self.command("compute");
        let arg = command.get_arguments().find(|arg| arg.get_long() == Some(name));
        let form = arg.and_then(clap::Arg::get_value_names).and_then(|names| names.first());
        form.map(ToString::to_string).unwrap_or_default()
    }

    /// Question for the value of a setting.
    pub(super) fn kind(&self, name: &str) -> Kind {
        let form = self.form(name);
        let words: Vec<String> = form.split('|').map(str::to_owned).collect();
        if words.len() > 1 && words.iter().all(|word| word.chars().all(|c| c.is_ascii_lowercase())) {
            Kind::OneOf(words)
        } else {
            Kind::Typed(form)
        }
    }
}

fn words(chosen: &BTreeMap<&'static str, String>, command: &Command) -> Vec<OsString> {
    let mut words = Vec::new();
    for (name, value) in chosen {
        let Some(arg) = command.get_arguments().find(|arg| arg.get_long() == Some(name)) else {
            continue;
        };
        if arg.is_require_equals_set() || value.starts_with('-') {
            words.push(format!("--{name}={value}").into());
        } else {
            words.extend([OsString::from(format!("--{name}")), value.into()]);
        }
    }
    words
}

/// The settings of `compute` with these on its command line.
fn present(definition: &Command, chosen: &BTreeMap<&'static str, String>, files: bool) -> Result<Vec<Setting>> {
    let command = definition.find_subcommand("compute").cloned().unwrap_or_default();
    let mut line: Vec<OsString> = ["hemicube", "compute", "--print-config"].map(OsString::from).into();
    if !files {
        line.push("--config=none".into());
    }
    line.extend(words(chosen, &command));
    let first = definition.clone().try_get_matches_from(&line)?;
    let matches = first
        .subcommand_matches("compute")
        .context("`compute` is a subcommand")?;
    let layers = Layers::gather(&command, matches)?;
    let second = layers
        .apply(definition.clone(), "compute")
        .try_get_matches_from(&line)?;
    let matches = second
        .subcommand_matches("compute")
        .context("`compute` is a subcommand")?;
    Ok(layers.settings(&command, matches))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_line::definition;

    fn settings() -> Settings {
        Settings::with(definition(), false).expect("settings")
    }

    #[test]
    fn what_is_offered_is_a_setting_with_help_and_values_that_parse() {
        for Offered { name, .. } in &OFFERED {
            assert!(!settings().help(name).is_empty(), "{name}");
            match settings().kind(name) {
                Kind::OneOf(values) => {
                    for value in values {
                        assert_eq!(settings().refusal(name, &value), None, "{name} {value}");
                    }
                }
                Kind::Typed(form) => assert!(!form.is_empty(), "{name}"),
            }
        }
        assert_eq!(
            settings().kind("correction"),
            Kind::OneOf(vec!["tolerance".into(), "pixel".into()])
        );
        assert_eq!(settings().kind("resolution"), Kind::Typed("auto|N".into()));
    }

    #[test]
    fn a_wrong_value_is_refused_in_the_parsers_words() {
        let reason = settings().refusal("resolution", "100").expect("it is refused");
        assert!(
            reason.starts_with("invalid value '100' for '--resolution <auto|N>'") && reason.contains("multiple of 16"),
            "{reason}"
        );
        assert!(settings().refusal("threads", "-1").is_some());
        assert!(settings().refusal("tolerance", "").is_some());
        assert_eq!(settings().refusal("tolerance", "0.3%"), None);
    }

    fn line(settings: &Settings, subcommand: &str) -> String {
        let words: Vec<String> = settings
            .words(subcommand)
            .iter()
            .map(|word| word.to_string_lossy().into_owned())
            .collect();
        words.join(" ")
    }

    #[test]
    fn only_what_differs_becomes_an_option() {
        let mut settings = settings();
        assert_eq!(settings.value("correction"), Some("tolerance"));
        assert_eq!(settings.value("tolerance"), None);
        settings.choose("correction", "tolerance").expect("it is a value");
        assert_eq!(line(&settings, "compute"), "");
        settings.choose("correction", "pixel").expect("it is a value");
        settings.choose("resolution", "64").expect("it is a value");
        assert_eq!(line(&settings, "compute"), "--correction pixel --resolution 64");
        settings.choose("tolerance", "1%").expect("it is a value");
        assert_eq!(line(&settings, "compute"), "--tolerance 1%");
        assert_eq!(settings.value("correction"), Some("tolerance"));
        settings.choose("form", "compact").expect("it is a value");
        assert_eq!(
            line(&settings, "inspect"),
            "--tolerance 1%",
            "`inspect` has no `--form`"
        );
        settings.choose("form", "auto").expect("it is a value");
        assert_eq!(line(&settings, "compute"), "--tolerance 1%");
        settings.clear().expect("all go");
        assert_eq!(line(&settings, "compute"), "");
        assert!(
            settings
                .choose("samples", "3")
                .is_err_and(|error| error.to_string().contains("perfect square"))
        );
    }
}
