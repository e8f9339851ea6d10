//! Questions, their order, and the command line of the answers. Nothing here knows a terminal.

use super::ask::{Answer, Ask, Item, Left, Menu, Text, wrapped};
use super::found::{self, Found, Place, SceneFile};
use super::line::Line;
use super::settings::{Kind, OFFERED, Offered, Settings};
use crate::prepare::axis_name;
use crate::report::size;
use hemicube_scene::{Axis, Format};
use serde_json::Value;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// End of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    /// By itself, with this exit status.
    By(i32),
    /// By a signal, or it could not be started.
    Not,
}

/// Exit statuses known to the dialogue.
const DONE: i32 = 0;
const NOT_HELD: i32 = 1;
const INTERRUPTED: i32 = 130;

/// Runs command lines.
pub(super) trait Run {
    /// Runs one on the terminal.
    fn run(&mut self, line: &Line) -> Result<Ended, Left>;
    /// Runs one and returns its standard output.
    ///
    /// # Errors
    /// When it fails: its message.
    fn output(&mut self, line: &Line) -> Result<Vec<u8>, String>;
}

/// The answer that resets a setting.
const DEFAULT: &str = "default";

/// Columns of explanations on terminals of unknown width.
const COLUMNS: usize = 80;

/// Patches of a generated room: a moment's work.
const ROOM_PATCHES: &str = "1000";

/// A dialogue.
pub(super) struct Dialogue<'a> {
    pub(super) ask: &'a mut dyn Ask,
    pub(super) run: &'a mut dyn Run,
    /// Name of the program in command lines.
    pub(super) program: OsString,
    /// Options of every command line.
    pub(super) common: Vec<OsString>,
    pub(super) settings: Settings,
    /// Folder of scenes and matrices, and of new matrices.
    pub(super) here: PathBuf,
    /// Another folder of scenes.
    pub(super) scenes: Option<PathBuf>,
    /// True if the dialogue chose it.
    pub(super) scenes_are_chosen: bool,
    /// Matrices computed in the dialogue, in whatever folder, and their scenes.
    pub(super) computed: Vec<(PathBuf, PathBuf)>,
}

/// Actions on a matrix.
#[derive(Clone, Copy)]
enum Look {
    Check,
    Compare,
    Report,
    Export,
    Picture,
}

/// Required target of a path.
#[derive(Clone, Copy)]
enum Existing {
    File,
    Folder,
    Any,
}

/// Actions before computing a matrix.
#[derive(Clone, Copy)]
enum Before {
    Run,
    Replace,
    Rename,
    Configure,
}

impl Dialogue<'_> {
    /// The whole of it.
    ///
    /// # Errors
    /// Why it ended, if the exit was not chosen.
    pub(super) fn main(&mut self) -> Result<(), Left> {
        type Step = fn(&mut Dialogue<'_>) -> Result<(), Left>;
        // The first three follow the thesis.
        let steps: [(&str, &str, Step); 5] = [
            ("Compute form factors", "of a scene", |dialogue| dialogue.compute()),
            ("Compare results", "how far one is from another", |dialogue| {
                dialogue.compare(None)
            }),
            ("Change configuration", "accuracy, backend, threads", |dialogue| {
                dialogue.configure()
            }),
            ("Look at a result", "check, page, export, picture", |dialogue| {
                dialogue.look()
            }),
            ("Inspect a scene", "size, defects, what it would cost", |dialogue| {
                dialogue.inspect()
            }),
        ];
        self.explain("hemicube: form factors of triangle scenes. Each choice shows the command that it runs.");
        self.ask.tell("");
        let options = steps.map(|(name, note, step)| (Item::new(name, note), step));
        while let Some(step) = self.choose("Select an option", 0, &options, "Exit")? {
            step(self)?;
        }
        Ok(())
    }

    /// Asks for one of some, or to go back.
    fn choose<T: Copy>(&mut self, question: &str, start: usize, options: &[(Item, T)], back: &str) -> Answer<T> {
        let mut items: Vec<Item> = options.iter().map(|(item, _)| item.clone()).collect();
        items.push(Item::new(back, ""));
        let place = self.ask.choose(&Menu {
            question,
            items: &items,
            start,
        })?;
        Ok(place.and_then(|place| options.get(place)).map(|(_, answer)| *answer))
    }

    /// Prints a wrapped explanation, after an empty line.
    fn explain(&mut self, text: &str) {
        let width = self.ask.width().unwrap_or(COLUMNS);
        self.ask.tell(&format!("\n{}", wrapped(text, width)));
    }

    fn line(&self, subcommand: &str) -> Line {
        Line::new(subcommand).with_all(self.common.iter().cloned())
    }

    fn show(&mut self, line: &Line) {
        let shown = line.shown(&self.program);
        self.ask.tell(&format!("\n$ {shown}"));
    }

    /// Shows a command line and runs it.
    fn go(&mut self, line: &Line) -> Result<Ended, Left> {
        self.show(line);
        self.go_on(line)
    }

    /// Runs a command line after showing it.
    fn go_on(&mut self, line: &Line) -> Result<Ended, Left> {
        let ended = self.run.run(line)?;
        match ended {
            Ended::By(DONE) => {}
            Ended::By(NOT_HELD) => self.ask.tell("(exit status 1: what was checked does not hold)"),
            Ended::By(INTERRUPTED) => self.ask.tell("(exit status 130: it was interrupted)"),
            Ended::By(status) => self.ask.tell(&format!("(exit status {status}: it failed)")),
            Ended::Not => self.ask.tell("(it did not come to its end)"),
        }
        Ok(ended)
    }

    fn compute(&mut self) -> Result<(), Left> {
        let Some(scene) = self.scene("Select the scene to process")? else {
            return Ok(());
        };
        let mut output = self.in_here(&crate::report::matrix_of(&scene));
        loop {
            let line = |dialogue: &Self, replaces: bool| {
                let line = dialogue.line("compute").with_path(&scene).with("-o").with_path(&output);
                let line = if replaces { line.with("--overwrite") } else { line };
                line.with_all(dialogue.settings.words("compute"))
            };
            let shown = line(self, false);
            let place = Place::of(&output);
            let name = output.display().to_string();
            let rename = (Item::new("Another name for the result", ""), Before::Rename);
            let configure = (Item::new("Change the configuration", ""), Before::Configure);
            let options = match &place {
                Place::Free => {
                    self.show(&shown);
                    vec![(Item::new("Run it", ""), Before::Run), rename, configure]
                }
                Place::Matrix(found) => {
                    let about = found
                        .as_ref()
                        .map_or("its manifest cannot be read", |found| found.about.as_str());
                    self.explain(&format!("`{name}` is there already: {about}"));
                    self.show(&shown);
                    vec![
                        (
                            Item::new("Go on with it", "of the same scene and settings"),
                            Before::Run,
                        ),
                        (Item::new("Replace it", "by --overwrite"), Before::Replace),
                        rename,
                        configure,
                    ]
                }
                Place::Taken => {
                    self.explain(&format!("`{name}` is there already, and is no matrix."));
                    vec![rename, configure]
                }
            };
            let ended = match self.choose("Run this command?", 0, &options, "Back")? {
                None => return Ok(()),
                Some(Before::Rename) => {
                    let suggested = found::free_name(&output);
                    if let Some(renamed) = self.place("Folder for the result", &suggested)? {
                        output = renamed;
                    }
                    continue;
                }
                Some(Before::Configure) => {
                    self.configure()?;
                    continue;
                }
                Some(Before::Run) => self.go_on(&shown)?,
                Some(Before::Replace) => self.go(&line(self, true))?,
            };
            if matches!(ended, Ended::By(DONE | NOT_HELD)) {
                self.computed.retain(|(path, _)| *path != output);
                self.computed.push((output.clone(), scene));
                return self.look_at(&output);
            }
        }
    }

    fn inspect(&mut self) -> Result<(), Left> {
        if let Some(scene) = self.scene("Inspect which scene")? {
            let line = self.line("inspect").with_path(&scene);
            self.go(&line.with_all(self.settings.words("inspect")))?;
        }
        Ok(())
    }

    fn look(&mut self) -> Result<(), Left> {
        match self.result("Look at which result", &|_| true)? {
            Some(store) => self.look_at(&store),
            None => Ok(()),
        }
    }

    fn look_at(&mut self, store: &Path) -> Result<(), Left> {
        let (extension, program) = crate::commands::export::first_choice();
        let options = [
            (Item::new("Check it", "sums, reciprocity, checksums"), Look::Check),
            (Item::new("Compare it", "with another result"), Look::Compare),
            (Item::new("Write a page", "HTML, with the model in 3-D"), Look::Report),
            (
                Item::new("Export it", format!("for {program}: .{extension}")),
                Look::Export,
            ),
            (Item::new("Draw the matrix", ".png"), Look::Picture),
        ];
        let question = format!("What next with {}", store.display());
        loop {
            let file = |extension: &str| {
                let mut name = store.file_stem().unwrap_or_default().to_owned();
                name.push(extension);
                store.with_file_name(name)
            };
            match self.choose(&question, 0, &options, "Back")? {
                None => return Ok(()),
                Some(Look::Check) => {
                    let line = self.line("check").with_path(store);
                    self.go(&line)?;
                }
                Some(Look::Compare) => self.compare(Some(store))?,
                Some(Look::Report) => {
                    let Some(scene) = self.scene_of(store)? else { continue };
                    let Some(up) = self.up_of(store, &scene)? else { continue };
                    if let Some((page, replaces)) = self.file(&file(".html"))? {
                        let line = self.line("report").with_path(store).with_path(&scene);
                        let line = line.with("-o").with_path(&page).with_all(up);
                        self.go(&if replaces { line.with("--overwrite") } else { line })?;
                    }
                }
                Some(Look::Export) => {
                    if let Some((matrix, replaces)) = self.file(&file(&format!(".{extension}")))? {
                        let line = self.line("export").with_path(store).with("-o").with_path(&matrix);
                        self.go(&if replaces { line.with("--overwrite") } else { line })?;
                    }
                }
                Some(Look::Picture) => {
                    if let Some((picture, replaces)) = self.file(&file(".png"))? {
                        let line = self.line("view sparsity").with_path(store);
                        let line = line.with("-o").with_path(&picture);
                        self.go(&if replaces { line.with("--overwrite") } else { line })?;
                    }
                }
            }
        }
    }

    fn compare(&mut self, first: Option<&Path>) -> Result<(), Left> {
        let first = match first {
            Some(first) => first.to_owned(),
            None => match self.result("Compare which result", &|_| true)? {
                Some(first) => first,
                None => return Ok(()),
            },
        };
        // Files other than stores, such as .npz, do not name their scene.
        let scene = Found::at(&first).map(|found| found.scene_hash);
        let is_of_scene = |other: &Found| scene.as_ref().is_none_or(|scene| *scene == other.scene_hash);
        let fits = |other: &Found| other.path != first && is_of_scene(other);
        if let Some(reference) = self.result("With which reference", &fits)? {
            let line = self.line("compare").with_path(&first).with_path(&reference);
            self.go(&line)?;
        }
        Ok(())
    }

    /// Asks for a scene.
    fn scene(&mut self, question: &str) -> Answer<PathBuf> {
        #[derive(Clone, Copy)]
        enum Pick {
            File(usize),
            Other,
            Generate,
        }
        loop {
            let scenes = self.scene_files();
            let mut options: Vec<(Item, Pick)> = scenes
                .iter()
                .enumerate()
                .map(|(k, scene)| {
                    (
                        Item::new(scene.path.display().to_string(), size(scene.bytes)),
                        Pick::File(k),
                    )
                })
                .collect();
            options.push((Item::new("Another file…", ""), Pick::Other));
            if scenes.is_empty() {
                self.explain(&format!("There is no scene here: {}.", Format::listed()));
                options.push((Item::new("Generate a room to try", ""), Pick::Generate));
            }
            match self.choose(question, 0, &options, "Back")? {
                None => return Ok(None),
                Some(Pick::File(k)) => return Ok(scenes.get(k).map(|scene| scene.path.clone())),
                Some(Pick::Other) => {
                    if let Some(path) = self.existing("File of the scene", Existing::File)? {
                        return Ok(Some(path));
                    }
                }
                Some(Pick::Generate) => {
                    let room = found::free_name(&self.in_here(Path::new("room.obj")));
                    let line = self.line("generate").with("room").with("--patches").with(ROOM_PATCHES);
                    self.go(&line.with("-o").with_path(&room))?;
                }
            }
        }
    }

    fn scene_files(&mut self) -> Vec<SceneFile> {
        let mut scenes = Vec::new();
        for folder in [Some(self.here.clone()), self.scenes.clone()].into_iter().flatten() {
            match found::scenes(&folder) {
                Ok(found) => scenes.extend(found),
                Err(error) => self.explain(&format!("The folder `{}` cannot be read: {error}", folder.display())),
            }
        }
        scenes
    }

    /// The scene of a matrix: as computed here, found by its name, or asked for.
    fn scene_of(&mut self, store: &Path) -> Answer<PathBuf> {
        if let Some((_, scene)) = self.computed.iter().find(|(path, _)| path == store) {
            return Ok(Some(scene.clone()));
        }
        let name = Found::at(store).map(|found| found.scene).unwrap_or_default();
        let scenes = self.scene_files();
        let mut named = scenes
            .into_iter()
            .filter(|scene| scene.path.file_name() == Path::new(&name).file_name());
        match (named.next(), named.next()) {
            (Some(scene), None) => Ok(Some(scene.path)),
            _ => self.scene(&format!("Which file is its scene, {name}")),
        }
    }

    /// Options of the axis pointing up: none where the matrix or its scene tells, otherwise as answered, with the guess
    /// highlighted.
    fn up_of(&mut self, store: &Path, scene: &Path) -> Answer<Vec<OsString>> {
        let Some(guess) = found::guessed_up(store, scene) else {
            return Ok(Some(Vec::new()));
        };
        self.explain(&format!(
            "`{}` does not say which axis points up; {} is {}.",
            scene.display(),
            axis_name(guess.axis),
            guess.reason
        ));
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let start = axes.iter().position(|&axis| axis == guess.axis).unwrap_or(0);
        let options = axes.map(|axis| {
            let note = if axis == guess.axis { "guessed" } else { "" };
            (Item::new(axis_name(axis), note), axis)
        });
        let chosen = self.choose("Which axis points up", start, &options, "Back")?;
        Ok(chosen.map(|axis| vec!["--up".into(), axis_name(axis).into()]))
    }

    /// Asks for one of the found and fitting matrices.
    fn result(&mut self, question: &str, fits: &dyn Fn(&Found) -> bool) -> Answer<PathBuf> {
        let mut results = match found::stores(&self.here) {
            Ok(results) => results,
            Err(error) => {
                self.explain(&format!("The folder `{}` cannot be read: {error}", self.here.display()));
                Vec::new()
            }
        };
        for (path, _) in &self.computed {
            if !results.iter().any(|result| result.path == *path) {
                results.extend(Found::at(path));
            }
        }
        results.retain(fits);
        if results.is_empty() {
            self.explain("There is no such result here. Compute one, of the same scene to compare, or name a file.");
        }
        let mut options: Vec<(Item, Option<usize>)> = results
            .iter()
            .enumerate()
            .map(|(k, result)| (Item::new(result.path.display().to_string(), &result.about), Some(k)))
            .collect();
        options.push((Item::new("Another…", "a folder, or .npz, .mtx, .npy"), None));
        match self.choose(question, 0, &options, "Back")? {
            None => Ok(None),
            Some(Some(k)) => Ok(results.get(k).map(|result| result.path.clone())),
            Some(None) => self.existing("Path of the result", Existing::Any),
        }
    }

    /// Asks for the path of an existing file or folder.
    fn existing(&mut self, question: &str, kind: Existing) -> Answer<PathBuf> {
        let check = |typed: &str| {
            if typed.is_empty() {
                return Err("a path is needed".to_owned());
            }
            let path = found::at_home(typed);
            crate::report::require(&path).map_err(|error| error.to_string())?;
            match kind {
                Existing::File if path.is_dir() => Err(format!("`{typed}` is a directory; name the file in it")),
                Existing::Folder if !path.is_dir() => Err(format!("`{typed}` is no directory")),
                _ => Ok(()),
            }
        };
        let typed = self.ask.text(&Text {
            question,
            default: None,
            help: "A path; Tab completes it.",
            check: &check,
            is_path: true,
        })?;
        Ok(typed.map(|typed| found::at_home(&typed)))
    }

    /// Asks for the place of a new matrix.
    fn place(&mut self, question: &str, suggested: &Path) -> Answer<PathBuf> {
        let suggested = suggested.to_string_lossy();
        let check = |typed: &str| match typed {
            "" => Err("a name is needed".to_owned()),
            _ => Ok(()),
        };
        let typed = self.ask.text(&Text {
            question,
            default: Some(&suggested),
            help: "A name or a path.",
            check: &check,
            is_path: true,
        })?;
        Ok(typed.map(|typed| found::at_home(&typed)))
    }

    /// Asks for the file to write; returns whether it replaces an existing one.
    fn file(&mut self, suggested: &Path) -> Answer<(PathBuf, bool)> {
        let mut file = suggested.to_owned();
        while file.exists() {
            let options = [
                (Item::new("Replace it", ""), true),
                (Item::new("Another name", ""), false),
            ];
            let question = format!("{} is there already", file.display());
            match self.choose(&question, 0, &options, "Back")? {
                None => return Ok(None),
                Some(true) => return Ok(Some((file, true))),
                Some(false) => {
                    let free = found::free_name(&file);
                    if let Some(named) = self.place("File to write", &free)? {
                        file = named;
                    }
                }
            }
        }
        Ok(Some((file, false)))
    }

    fn in_here(&self, name: &Path) -> PathBuf {
        found::in_folder(&self.here, name)
    }

    fn configure(&mut self) -> Result<(), Left> {
        #[derive(Clone, Copy)]
        enum Pick {
            Setting(&'static Offered),
            Scenes,
            Write,
            Forget,
        }
        let mut start = 0;
        loop {
            let values: Vec<String> = OFFERED.iter().map(|offered| self.value(offered.name)).collect();
            let column = values.iter().map(|value| value.chars().count()).max().unwrap_or(0);
            let mut options: Vec<(Item, Pick)> = OFFERED
                .iter()
                .zip(&values)
                .map(|(offered, value)| {
                    let note = format!("{value:column$}  {}", offered.note);
                    (Item::new(offered.name, note), Pick::Setting(offered))
                })
                .collect();
            let scenes = self
                .scenes
                .as_ref()
                .map_or("not set".to_owned(), |path| path.display().to_string());
            let mark = if self.scenes_are_chosen { "*" } else { "" };
            let note = format!("{:column$}  where scenes are, too", format!("{scenes}{mark}"));
            options.push((Item::new("scenes", note), Pick::Scenes));
            let file = Settings::file();
            let count = self.settings.chosen().count() + usize::from(self.scenes_are_chosen);
            if count > 0 {
                let note = format!("those with a *, into {}", file.display());
                options.push((Item::new("Write changes", note), Pick::Write));
                options.push((Item::new("Forget changes", "those with a *"), Pick::Forget));
            }
            let picked = self.choose("Change which setting", start.min(options.len()), &options, "Back")?;
            match picked {
                None => return Ok(()),
                Some(Pick::Setting(offered)) => {
                    start = OFFERED.iter().position(|other| other.name == offered.name).unwrap_or(0);
                    self.set(offered)?;
                }
                Some(Pick::Scenes) => {
                    start = OFFERED.len();
                    if let Some(folder) = self.existing("Folder with scenes", Existing::Folder)? {
                        (self.scenes, self.scenes_are_chosen) = (Some(folder), true);
                    }
                }
                Some(Pick::Write) => {
                    start = 0;
                    self.write(&file)?;
                }
                Some(Pick::Forget) => {
                    start = 0;
                    self.scenes_are_chosen = false;
                    let cleared = self.settings.clear();
                    self.tell_error(cleared);
                }
            }
        }
    }

    /// The value of a setting, marked if chosen here.
    fn value(&self, name: &str) -> String {
        let mark = if self.settings.is_chosen(name) { "*" } else { "" };
        format!("{}{mark}", self.settings.value(name).unwrap_or("not set"))
    }

    fn tell_error(&mut self, result: anyhow::Result<()>) {
        if let Err(error) = result {
            self.explain(&format!("That is not possible: {error:#}"));
        }
    }

    fn set(&mut self, offered: &'static Offered) -> Result<(), Left> {
        let Offered { name, cost, .. } = *offered;
        let value = self.settings.value(name).unwrap_or("not set");
        let origin = self
            .settings
            .origin(name)
            .map(|origin| format!(", from {origin}"))
            .unwrap_or_default();
        let text = format!("{}. {cost} It is {value}{origin}.", self.settings.help(name));
        self.ask.tell(&format!("\n--{name} <{}>", self.settings.form(name)));
        let width = self.ask.width().unwrap_or(COLUMNS);
        self.ask.tell(&wrapped(&text, width));
        let chosen = match self.settings.kind(name) {
            Kind::OneOf(values) => {
                let options: Vec<(Item, usize)> = values
                    .iter()
                    .enumerate()
                    .map(|(k, value)| (Item::new(value, ""), k))
                    .collect();
                let start = values.iter().position(|value| self.settings.value(name) == Some(value));
                let picked = self.choose(name, start.unwrap_or(0), &options, "Back")?;
                picked.and_then(|k| values.get(k)).cloned()
            }
            Kind::Typed(_) if name == "backend" => self.backend()?,
            Kind::Typed(_) => self.typed(name)?,
        };
        if let Some(chosen) = chosen {
            let done = if chosen == DEFAULT {
                self.settings.unset(name)
            } else {
                self.settings.choose(name, &chosen)
            };
            self.tell_error(done);
        }
        Ok(())
    }

    fn typed(&mut self, name: &str) -> Answer<String> {
        let settings = &self.settings;
        let check = |typed: &str| match (typed, settings.refusal(name, typed)) {
            (DEFAULT, _) | (_, None) => Ok(()),
            (_, Some(reason)) => Err(reason),
        };
        self.ask.text(&Text {
            question: name,
            default: None,
            help: "`default` takes the choice back.",
            check: &check,
            is_path: false,
        })
    }

    /// Asks for one of the backends that open, listed by `hemicube backends list`.
    fn backend(&mut self) -> Answer<String> {
        let mut line = Line::new("backends list").with("--json");
        if let Some(folder) = self.settings.value("backend-dir") {
            line = line.with("--backend-dir").with(folder);
        }
        let listed = self.run.output(&line);
        let list: Value = match listed.map(|bytes| serde_json::from_slice(&bytes)) {
            Ok(Ok(list)) => list,
            Ok(Err(error)) => {
                self.explain(&format!("Backends cannot be listed: {error}"));
                Value::Null
            }
            Err(reason) => {
                self.explain(&format!("Backends cannot be listed: {reason}"));
                Value::Null
            }
        };
        let entries = |key: &str| list[key].as_array().cloned().unwrap_or_default();
        let word = |entry: &Value, key: &str| entry[key].as_str().unwrap_or_default().to_owned();
        for entry in entries("unusable") {
            self.explain(&format!(
                "`{}` cannot be used: {}",
                word(&entry, "name"),
                word(&entry, "reason")
            ));
        }
        let mut names: Vec<(String, String)> = vec![(
            "auto".to_owned(),
            "a graphics card's, where one opens, otherwise cpu".to_owned(),
        )];
        for entry in entries("backends") {
            let name = word(&entry, "name");
            // Its first device; others take `--backend-option device=N`.
            if !names.iter().any(|(other, _)| *other == name) {
                names.push((name, word(&entry, "device")));
            }
        }
        let mut options: Vec<(Item, Option<usize>)> = names
            .iter()
            .enumerate()
            .map(|(k, (name, device))| (Item::new(name, device), Some(k)))
            .collect();
        options.push((Item::new("Another…", "the file of a plugin"), None));
        let start = names
            .iter()
            .position(|(name, _)| self.settings.value("backend") == Some(name));
        match self.choose("backend", start.unwrap_or(0), &options, "Back")? {
            None => Ok(None),
            Some(Some(k)) => Ok(names.get(k).map(|(name, _)| name.clone())),
            Some(None) => {
                let path = self.existing("File of the plugin", Existing::File)?;
                Ok(path.map(|path| path.to_string_lossy().into_owned()))
            }
        }
    }

    /// Shows the text to write, and writes it on request.
    fn write(&mut self, file: &Path) -> Result<(), Left> {
        let scenes = self.scenes.as_ref().filter(|_| self.scenes_are_chosen);
        let scenes = scenes.map(|path| path.to_string_lossy().into_owned());
        let more: Vec<(&str, &str)> = scenes.iter().map(|path| ("scenes", path.as_str())).collect();
        let mut lines = format!("\n{}:", file.display());
        for (name, value) in self.settings.chosen().chain(more.iter().copied()) {
            lines.push_str(&format!("\n  {name} = {value}"));
        }
        self.ask.tell(&lines);
        let options = [(Item::new("Write them", "for this and later runs"), ())];
        if self.choose("Write these settings", 0, &options, "Back")?.is_some() {
            match self.settings.write(file, &more) {
                Ok(()) => {
                    self.scenes_are_chosen = false;
                    self.ask.tell(&format!("`{}` is written.", file.display()));
                }
                Err(error) => self.tell_error(Err(error)),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_line::definition;
    use Say::{Esc, Pick, Type};
    use std::collections::VecDeque;

    /// An answer.
    #[derive(Clone, Copy)]
    enum Say {
        /// Picks the item by the beginning or end of its name.
        Pick(&'static str),
        Type(&'static str),
        Esc,
    }

    /// A front that reads from a list.
    #[derive(Default)]
    struct Script {
        answers: VecDeque<Say>,
        /// All questions and messages.
        seen: Vec<String>,
    }

    impl Ask for Script {
        fn choose(&mut self, menu: &Menu<'_>) -> Answer<usize> {
            assert!(menu.start < menu.items.len());
            let rows = super::super::ask::rows(menu.items, None).join("\n");
            self.seen.push(format!("{}\n{rows}", menu.question));
            match self.answers.pop_front() {
                Some(Say::Pick(name)) => {
                    let place = menu
                        .items
                        .iter()
                        .position(|item| item.name.starts_with(name) || item.name.ends_with(name));
                    Ok(Some(place.unwrap_or_else(|| panic!("`{name}` is not in: {rows}"))))
                }
                Some(Say::Esc) => Ok(None),
                Some(Say::Type(typed)) => panic!("`{typed}` for a menu: {}", menu.question),
                None => Err(Left::Ended),
            }
        }

        fn text(&mut self, text: &Text<'_>) -> Answer<String> {
            self.seen.push(format!("{} {:?}", text.question, text.default));
            loop {
                match self.answers.pop_front() {
                    Some(Say::Type(typed)) => {
                        let typed = if typed.is_empty() {
                            text.default.unwrap_or_default()
                        } else {
                            typed
                        };
                        match (text.check)(typed) {
                            Ok(()) => return Ok(Some(typed.to_owned())),
                            Err(reason) => self.seen.push(reason),
                        }
                    }
                    Some(Say::Esc) => return Ok(None),
                    Some(Say::Pick(name)) => panic!("`{name}` for a text: {}", text.question),
                    None => return Err(Left::Ended),
                }
            }
        }

        fn tell(&mut self, text: &str) {
            self.seen.push(text.to_owned());
        }

        fn width(&self) -> Option<usize> {
            None
        }
    }

    /// Runs nothing, and records the command lines.
    struct Kept {
        lines: Vec<String>,
        ended: Ended,
    }

    impl Run for Kept {
        fn run(&mut self, line: &Line) -> Result<Ended, Left> {
            self.lines.push(line.shown("hemicube".as_ref()));
            Ok(self.ended)
        }

        fn output(&mut self, line: &Line) -> Result<Vec<u8>, String> {
            self.lines.push(line.shown("hemicube".as_ref()));
            Ok(LISTED.into())
        }
    }

    const LISTED: &str = r#"{"backends": [
        {"name": "cpu", "device": "this processor"}, {"name": "gl", "device": "a card"},
        {"name": "gl", "device": "another"}],
        "unusable": [{"name": "vulkan", "reason": "finds no device"}]}"#;

    /// Holds a dialogue in a folder with all `answers`; returns the command lines, and the questions and messages.
    fn held(here: &Path, ended: Ended, answers: impl IntoIterator<Item = Say>) -> (Vec<String>, String) {
        let mut script = Script {
            answers: answers.into_iter().collect(),
            seen: Vec::new(),
        };
        let mut kept = Kept {
            lines: Vec::new(),
            ended,
        };
        let mut dialogue = Dialogue {
            ask: &mut script,
            run: &mut kept,
            program: "hemicube".into(),
            common: Vec::new(),
            settings: Settings::with(definition(), false).expect("settings"),
            here: here.to_owned(),
            scenes: None,
            scenes_are_chosen: false,
            computed: Vec::new(),
        };
        let left = dialogue.main();
        assert!(matches!(left, Ok(()) | Err(Left::Ended)), "{left:?}");
        let seen = script.seen.join("\n");
        assert!(script.answers.is_empty(), "not all was asked: {seen}");
        let here = format!("{}/", here.display());
        let lines = kept.lines.iter().map(|line| line.replace(&here, "")).collect();
        (lines, seen.replace(&here, ""))
    }

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a temporary directory");
        for scene in ["cubitos.ac", "high.ac", "it's.obj", "notes.txt"] {
            std::fs::write(folder.path().join(scene), "AC3Db\n").expect("a file");
        }
        folder
    }

    const DONE: Ended = Ended::By(0);

    #[test]
    fn a_scene_is_computed_compared_and_computed_otherwise() {
        let folder = folder();
        let reference = folder.path().join("high.npz");
        std::fs::write(&reference, "").expect("a file");
        let reference: &'static str = Box::leak(reference.display().to_string().into_boxed_str());
        let (lines, seen) = held(
            folder.path(),
            DONE,
            [
                Pick("Compute form factors"),
                Pick("high.ac"),
                Pick("Run it"),
                Pick("Compare it"),
                Pick("Another…"),
                Type("missing.npz"),
                Type(reference),
                Pick("Export it"),
                Pick("Replace it"),
                Esc,
                Pick("Change configuration"),
                Pick("correction"),
                Pick("pixel"),
                Pick("threads"),
                Type("-1"),
                Type("2"),
                Pick("Back"),
                Pick("Compute form factors"),
                Pick("it's.obj"),
                Pick("Another name"),
                Type(""),
                Pick("Change the configuration"),
                Pick("threads"),
                Type("default"),
                Esc,
                Pick("Run it"),
                Pick("Write a page"),
                Pick("Back"),
                Pick("Inspect a scene"),
                Pick("cubitos.ac"),
                Pick("Exit"),
            ],
        );
        assert_eq!(
            lines,
            [
                "hemicube compute high.ac -o high.hemicube",
                "hemicube compare high.hemicube high.npz",
                "hemicube export high.hemicube -o high.npz --overwrite",
                r"hemicube compute 'it'\''s.obj' -o 'it'\''s.hemicube' --correction pixel",
                r"hemicube report 'it'\''s.hemicube' 'it'\''s.obj' -o 'it'\''s.html'",
                "hemicube inspect cubitos.ac --correction pixel",
            ]
        );
        for words in [
            "Select an option\n1 - Compute form factors",
            "2 - Compare results ",
            "3 - Change configuration ",
            "6 - Exit",
            "Select the scene to process\n1 - cubitos.ac  6 B\n2 - high.ac     6 B\n3 - it's.obj    6 B\n\
             4 - Another file…\n5 - Back",
            "`missing.npz` does not exist",
            "high.npz is there already",
            "--threads <N>\nWorker threads; 0: one for each core",
            "invalid value '-1' for '--threads <N>'",
            "correction      pixel*",
            // Shown before it is run, and again when the configuration changes it.
            r"$ hemicube compute 'it'\''s.obj' -o 'it'\''s.hemicube' --correction pixel --threads 2",
        ] {
            assert!(seen.contains(words), "`{words}` is not in: {seen}");
        }
    }

    #[test]
    fn what_is_there_is_gone_on_with_replaced_or_left() {
        let folder = folder();
        std::fs::create_dir_all(folder.path().join("high.hemicube/parts")).expect("a directory");
        let before = [Pick("Compute form factors"), Pick("high.ac")];
        let answered = |answers: Vec<Say>| held(folder.path(), DONE, before.iter().copied().chain(answers));
        let (lines, seen) = answered(vec![Pick("Go on with it")]);
        assert_eq!(lines, ["hemicube compute high.ac -o high.hemicube"]);
        assert!(seen.contains("`high.hemicube` is there already"), "{seen}");
        let (lines, _) = answered(vec![Pick("Replace it")]);
        assert_eq!(lines, ["hemicube compute high.ac -o high.hemicube --overwrite"]);
        let (lines, seen) = answered(vec![Pick("Another name"), Type(""), Pick("Back"), Pick("Exit")]);
        assert_eq!(lines, [""; 0]);
        assert!(seen.contains("$ hemicube compute high.ac -o high-2.hemicube"), "{seen}");
        // A file other than a matrix is never written over.
        std::fs::write(folder.path().join("cubitos.hemicube"), "").expect("a file");
        let (lines, seen) = held(
            folder.path(),
            DONE,
            [Pick("Compute form factors"), Pick("cubitos.ac"), Esc, Esc],
        );
        assert_eq!(lines, [""; 0]);
        assert!(seen.contains("is no matrix.") && !seen.contains("Run it"), "{seen}");
    }

    #[test]
    fn a_command_that_fails_leads_back_to_its_question() {
        let folder = folder();
        let answers = [
            Pick("Compute form factors"),
            Pick("high.ac"),
            Pick("Run it"),
            Pick("Run it"),
            Esc,
            Esc,
        ];
        for (ended, said) in [
            (Ended::By(2), "(exit status 2: it failed)"),
            (Ended::By(130), "(exit status 130: it was interrupted)"),
            (Ended::Not, "(it did not come to its end)"),
        ] {
            let (lines, seen) = held(folder.path(), ended, answers);
            assert_eq!(lines.len(), 2);
            assert_eq!(seen.matches(said).count(), 2, "{seen}");
        }
        // A check that found defects did its work.
        let (_, seen) = held(
            folder.path(),
            Ended::By(1),
            [
                Pick("Compute form factors"),
                Pick("high.ac"),
                Pick("Run it"),
                Pick("Check it"),
            ],
        );
        assert_eq!(
            seen.matches("(exit status 1: what was checked does not hold)").count(),
            2,
            "{seen}"
        );
    }

    #[test]
    fn backends_are_listed_when_they_are_asked_for() {
        let folder = folder();
        let (lines, seen) = held(
            folder.path(),
            DONE,
            [
                Pick("Change configuration"),
                Pick("backend"),
                Pick("gl"),
                Esc,
                Pick("Inspect a scene"),
                Pick("high.ac"),
            ],
        );
        assert_eq!(
            lines,
            ["hemicube backends list --json", "hemicube inspect high.ac --backend gl"]
        );
        for words in [
            "2 - cpu       this processor\n3 - gl        a card\n4 - Another…",
            "`vulkan` cannot be used: finds no device",
        ] {
            assert!(seen.contains(words), "`{words}` is not in: {seen}");
        }
    }

    #[test]
    fn where_there_is_no_scene_one_is_generated() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let (lines, seen) = held(
            folder.path(),
            DONE,
            [Pick("Compute form factors"), Pick("Generate a room"), Esc, Esc],
        );
        assert_eq!(lines, ["hemicube generate room --patches 1000 -o room.obj"]);
        assert!(seen.contains("There is no scene here"), "{seen}");
        let (_, seen) = held(folder.path(), DONE, [Pick("Compare results")]);
        assert!(seen.contains("There is no such result here"), "{seen}");
    }

    #[test]
    fn scenes_come_from_a_second_folder_too() {
        let (here, scenes) = (folder(), folder());
        let path: &'static str = Box::leak(scenes.path().display().to_string().into_boxed_str());
        let answers = [
            Pick("Change configuration"),
            Pick("scenes"),
            Type("Cargo.toml"),
            Type(path),
            Esc,
            Pick("Compute form factors"),
        ];
        let (_, seen) = held(here.path(), DONE, answers);
        assert!(seen.contains(&format!("4 - {path}/cubitos.ac")), "{seen}");
    }

    #[test]
    fn the_input_may_end_at_every_question() {
        let folder = folder();
        let answers = [
            Pick("Change configuration"),
            Pick("samples"),
            Type("4"),
            Pick("backend"),
            Esc,
            Esc,
            Pick("Compute form factors"),
            Pick("high.ac"),
            Pick("Another name"),
            Type("x.hemicube"),
            Pick("Run it"),
            Pick("Compare it"),
            Pick("Another…"),
        ];
        for count in 0..=answers.len() {
            held(folder.path(), DONE, answers.iter().copied().take(count));
        }
    }
}
