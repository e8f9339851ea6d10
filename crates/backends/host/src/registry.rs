//! From a user's request to a session: by path, by name, or `auto`.

use crate::discover::{Origin, Search, file_name, name_of_file};
use crate::load::{Library, LoadError, OPENS_LIBRARIES};
use crate::loaded::LoadedBackend;
use crate::{Device, DeviceKind};
use hemicube_contract::backend::BackendError;
use std::collections::BTreeMap;
use std::env::consts::DLL_SUFFIX;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The backends tried by `auto`, in order.
const AUTO: [&str; 3] = ["vulkan", "wgpu", "gl"];

/// Threads of a processor up to which a GPU is taken to draw more hemicubes than they do. A choice: one NVIDIA H100 draws as
/// many as 2.7 to 8 threads of the processor beside it, by scene (docs/dev/gpu.md has the table and its command). With
/// more, `auto` takes a GPU in large scenes that it slows down; with fewer, it leaves one that pays in small ones.
const THREADS_OF_A_GPU: usize = 5;

/// A place searched, and the reason of its failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tried {
    /// The file, or the folder if it has no such file.
    pub path: PathBuf,
    /// Why not.
    pub reason: String,
}

/// Why there is no session.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// No usable file of that name.
    #[error("no backend named `{name}`{}", list(tried))]
    NotFound {
        /// The name asked for.
        name: String,
        /// All places searched.
        tried: Vec<Tried>,
    },
    /// The file named cannot be used.
    #[error("backend `{}`: {reason}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: LoadError,
    },
    /// The program itself is static: [`OPENS_LIBRARIES`].
    #[error("backend `{name}`: {}", LoadError::Static)]
    Static {
        /// The name asked for.
        name: String,
    },
    /// With raised privileges, files are not the user's to choose.
    #[error(
        "backend `{}`: with raised privileges, none is loaded from a place that the command line names",
        path.display()
    )]
    Raised {
        /// The file.
        path: PathBuf,
    },
    /// The backend is there, and has no device.
    #[error("backend `{name}` finds no device")]
    NoDevice {
        /// Its name.
        name: String,
    },
    /// There is no such device.
    #[error("backend `{name}` has no device `{wanted}`; it has {}", devices(there))]
    NoSuchDevice {
        /// Its name.
        name: String,
        /// The device asked for.
        wanted: String,
        /// Its devices.
        there: Vec<Device>,
    },
    /// The backend is there, and fails.
    #[error("backend `{name}`: {source}")]
    Backend {
        /// Its name.
        name: String,
        /// Its message.
        source: BackendError,
    },
    /// An option that cannot be passed on.
    #[error("backend option `{0}`: a key and a value without `,` are needed, `key=value`")]
    Option(String),
    /// A key that was given before.
    #[error("backend option `{0}`: its key has a value already; give each key once")]
    Twice(String),
    /// A value that is no switch.
    #[error("backend option `{0}`: `passes` and `rays` are `on` or `off`")]
    Switch(String),
}

fn list(tried: &[Tried]) -> String {
    let width = tried
        .iter()
        .map(|t| t.path.display().to_string().chars().count())
        .max()
        .unwrap_or(0);
    tried.iter().fold(String::new(), |mut text, tried| {
        let _ = write!(
            text,
            "\n  tried  {:width$}  {}",
            tried.path.display().to_string(),
            tried.reason
        );
        text
    })
}

fn devices(there: &[Device]) -> String {
    let names: Vec<String> = (0..)
        .zip(there)
        .map(|(k, device): (u32, _)| format!("{k} `{}`", device.name))
        .collect();
    names.join(", ")
}

/// Options of a session, from repeated `key=value`. The host's own are `device`, a number or a part of a name, and two
/// that are `on` for what the host does by itself otherwise: `passes` has the backend draw what is seen through portals,
/// if it can, `rays` has it cast rays.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    given: BTreeMap<String, String>,
    /// See [`Options::within`].
    memory: Option<u64>,
}

/// What a backend does only where it is asked to.
const SWITCHES: [&str; 2] = ["passes", "rays"];

impl Options {
    /// Reads options, each `key=value`.
    ///
    /// # Errors
    /// [`OpenError::Option`] for another form, [`OpenError::Twice`] for a repeated key, [`OpenError::Switch`] for
    /// `passes` and `rays` other than `on` and `off`.
    ///
    /// ```
    /// use hemicube_host::Options;
    /// assert!(!Options::parse(&["device=1", "validation=on"])?.is_empty());
    /// assert!(Options::parse(&["device"]).is_err(), "a key and a value are needed");
    /// assert!(Options::parse(&["device=1", "device=2"]).is_err(), "and each key once");
    /// assert!(Options::parse(&["passes=off"]).is_ok() && Options::parse(&["passes=no"]).is_err());
    /// # Ok::<(), hemicube_host::OpenError>(())
    /// ```
    pub fn parse<T: AsRef<str>>(given: &[T]) -> Result<Self, OpenError> {
        let mut options = BTreeMap::new();
        for option in given {
            let option = option.as_ref();
            let bad = || OpenError::Option(option.to_owned());
            let (key, value) = option.split_once('=').ok_or_else(bad)?;
            if SWITCHES.contains(&key) && !["on", "off"].contains(&value) {
                return Err(OpenError::Switch(option.to_owned()));
            }
            if key.is_empty() || option.contains([',', '\0']) {
                return Err(bad());
            }
            if options.insert(key.to_owned(), value.to_owned()).is_some() {
                return Err(OpenError::Twice(option.to_owned()));
            }
        }
        Ok(Self {
            given: options,
            memory: None,
        })
    }

    /// Bounds what a session of the project's plugins takes, in bytes, where its device has the processor's memory and no
    /// option `memory` says otherwise.
    #[must_use]
    pub fn within(mut self, bytes: u64) -> Self {
        self.memory = Some(bytes);
        self
    }

    /// Has the backend draw passes and cast rays, if it can and no option says otherwise.
    #[must_use]
    pub fn with_passes_and_rays(mut self) -> Self {
        for key in SWITCHES {
            self.given.entry(key.to_owned()).or_insert_with(|| "on".to_owned());
        }
        self
    }

    /// Returns whether there is none.
    pub fn is_empty(&self) -> bool {
        self.given.is_empty()
    }

    fn device(&self) -> Option<&str> {
        self.given.get("device").map(String::as_str)
    }

    fn is_on(&self, switch: &str) -> bool {
        self.given.get(switch).is_some_and(|value| value == "on")
    }

    /// Returns all but the host's own, in the table's form, for a plugin and the kind of its device.
    fn for_plugin(&self, plugin: &str, kind: DeviceKind) -> String {
        let is_own = |key: &str| key == "device" || SWITCHES.contains(&key);
        let pairs = self.given.iter().filter(|(key, _)| !is_own(key));
        let mut pairs: Vec<String> = pairs.map(|(key, value)| format!("{key}={value}")).collect();
        if let Some(bytes) = self.memory
            && matches!(kind, DeviceKind::Software | DeviceKind::IntegratedGpu)
            && AUTO.contains(&plugin)
            && !self.given.contains_key("memory")
        {
            pairs.push(format!("memory={bytes}"));
        }
        pairs.join(",")
    }
}

/// The state of a file in one of the folders.
#[derive(Debug)]
#[non_exhaustive]
pub enum State {
    /// A backend, and its devices.
    Usable {
        /// The version of its arithmetic.
        version: String,
        /// Its devices; none is none.
        devices: Vec<Device>,
    },
    /// A backend without a list of devices.
    Failing {
        /// The version of its arithmetic.
        version: String,
        /// Its message.
        error: BackendError,
    },
    /// Another file or the built-in backend has the same name and comes first.
    Shadowed {
        /// The file of the backend; `None`: the built-in one.
        by: Option<PathBuf>,
    },
    /// It cannot be used.
    Unusable(LoadError),
}

/// A file named like a backend.
#[derive(Debug)]
pub struct Listed {
    /// The name to ask for.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// The source of its folder.
    pub origin: Origin,
    /// Its state.
    pub state: State,
}

/// A backend passed over by `auto`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PassedOver {
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: String,
    /// True if there is a file for it at all.
    pub installed: bool,
}

/// The outcome of `auto`.
#[derive(Debug)]
pub struct Auto {
    /// The session; `None`: the built-in backend is the best.
    pub taken: Option<LoadedBackend>,
    /// The backends passed over, with reasons.
    pub passed_over: Vec<PassedOver>,
}

/// Finds and opens backends.
#[derive(Clone, Debug)]
pub struct Registry {
    search: Search,
    /// Names never searched for: the program has them built in.
    built_in: Vec<String>,
}

impl Registry {
    /// Makes a registry over some folders. `built_in` are the program's own backends.
    pub fn new(search: Search, built_in: &[&str]) -> Self {
        Self {
            search,
            built_in: built_in.iter().map(|&name| name.to_owned()).collect(),
        }
    }

    /// The folders.
    pub fn search(&self) -> &Search {
        &self.search
    }

    /// Returns true if a request is a file rather than a name.
    pub fn is_path(asked: &str) -> bool {
        asked.contains(std::path::is_separator) || asked.ends_with(DLL_SUFFIX)
    }

    /// Loads the library of a file or name. A name never becomes another.
    ///
    /// # Errors
    /// [`OpenError`], with all places tried.
    pub fn find(&self, asked: &str) -> Result<Library, OpenError> {
        if Self::is_path(asked) {
            let path = PathBuf::from(asked);
            if self.search.is_raised() {
                return Err(OpenError::Raised { path });
            }
            return Library::load(&path).map_err(|reason| OpenError::Unusable { path, reason });
        }
        self.named(asked, |_| true)
    }

    /// Loads the library of a name from folders of some origins.
    fn named(&self, asked: &str, is_searched: impl Fn(Origin) -> bool) -> Result<Library, OpenError> {
        if !OPENS_LIBRARIES {
            return Err(OpenError::Static { name: asked.to_owned() });
        }
        let mut tried = Vec::new();
        for folder in self.search.folders().iter().filter(|folder| is_searched(folder.origin)) {
            if !folder.path.is_dir() {
                tried.push(Tried {
                    path: folder.path.clone(),
                    reason: "no such folder".to_owned(),
                });
                continue;
            }
            let path = folder.path.join(file_name(asked));
            match Library::load(&path).and_then(|library| library.named(asked)) {
                Ok(library) => return Ok(library),
                Err(reason) => tried.push(Tried {
                    path,
                    reason: reason.to_string(),
                }),
            }
        }
        Err(OpenError::NotFound {
            name: asked.to_owned(),
            tried,
        })
    }

    /// Opens a session of a backend by path or name.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn open(&self, asked: &str, options: &Options) -> Result<LoadedBackend, OpenError> {
        let library = Arc::new(self.find(asked)?);
        let name = library.name().to_owned();
        let devices = library.devices().map_err(|source| OpenError::Backend {
            name: name.clone(),
            source,
        })?;
        open_on(library, devices, options)
    }

    /// Opens the best backend: the first of Vulkan, wgpu and GL that is installed, has a GPU and has all capabilities
    /// for every accuracy level; otherwise none, for the built-in one. A driver running on the processor is not taken:
    /// the built-in backend is faster. Nor is a GPU beside a processor of so many `threads` that these draw more.
    ///
    /// A failing backend is passed over, and the reason kept. What a build left in the program's folder is not
    /// installed.
    pub fn auto(&self, options: &Options, threads: usize) -> Auto {
        let mut passed_over = Vec::new();
        for name in AUTO {
            match self.suitable(name, options, threads) {
                Ok(taken) => {
                    return Auto {
                        taken: Some(taken),
                        passed_over,
                    };
                }
                Err((reason, installed)) => passed_over.push(PassedOver {
                    name: name.to_owned(),
                    reason,
                    installed,
                }),
            }
        }
        Auto {
            taken: None,
            passed_over,
        }
    }

    /// Opens a session of that backend, if `auto` takes it. Otherwise returns the reason, and true if it is installed.
    fn suitable(&self, name: &str, options: &Options, threads: usize) -> Result<LoadedBackend, (String, bool)> {
        let library = match self.named(name, |origin| origin != Origin::Build) {
            Ok(library) => library,
            Err(OpenError::NotFound { tried, .. }) => {
                let there: Vec<String> = tried
                    .iter()
                    .filter(|tried| tried.path.is_file())
                    .map(|tried| format!("`{}`: {}", tried.path.display(), tried.reason))
                    .collect();
                return Err(if there.is_empty() {
                    ("not installed".to_owned(), false)
                } else {
                    (there.join("; "), true)
                });
            }
            Err(OpenError::Static { .. }) => return Err((LoadError::Static.to_string(), false)),
            Err(other) => return Err((other.to_string(), true)),
        };
        let no = |reason: String| (reason, true);
        let devices = library.devices().map_err(|error| no(error.to_string()))?;
        let Some(first) = devices.first() else {
            return Err(no("no device".to_owned()));
        };
        if first.kind == DeviceKind::Software {
            return Err(no(format!("`{}` runs on the processor", first.name)));
        }
        if !(first.capabilities.covered && first.capabilities.lossless_culling) {
            return Err(no(format!("`{}` does not give all that is needed", first.name)));
        }
        if threads > THREADS_OF_A_GPU {
            return Err(no(format!("{threads} threads of the processor draw more than a GPU")));
        }
        open_on(Arc::new(library), devices, options).map_err(|error| no(error.to_string()))
    }

    /// Lists all files in the folders named like backends, in order of search. Opens only the libraries, and asks only
    /// for their devices.
    ///
    /// ```
    /// use hemicube_host::{Environment, LoadError, Registry, Search, State, file_name};
    /// # let folder = tempfile::tempdir()?;
    ///
    /// for name in ["cpu", "mine"] {
    ///     std::fs::write(folder.path().join(file_name(name)), "not a library")?;
    /// }
    /// let registry = Registry::new(Search::new(&[folder.path().to_owned()], &Environment::default()), &["cpu"]);
    /// let [cpu, mine] = &registry.list()[..] else { panic!("two files") };
    /// assert!(cpu.name == "cpu" && matches!(cpu.state, State::Shadowed { by: None }), "the program has its own");
    /// assert!(mine.name == "mine" && matches!(mine.state, State::Unusable(LoadError::Refused(_))));
    /// # Ok::<(), std::io::Error>(())
    /// ```
    pub fn list(&self) -> Vec<Listed> {
        let mut listed: Vec<Listed> = Vec::new();
        for folder in self.search.folders() {
            for (name, path) in backends_in(&folder.path) {
                let state = if self.built_in.contains(&name) {
                    State::Shadowed { by: None }
                } else if let Some(first) = listed.iter().find(|other| {
                    other.name == name && matches!(other.state, State::Usable { .. } | State::Failing { .. })
                }) {
                    State::Shadowed {
                        by: Some(first.path.clone()),
                    }
                } else {
                    state_of(&path, &name)
                };
                listed.push(Listed {
                    name,
                    path,
                    origin: folder.origin,
                    state,
                });
            }
        }
        listed
    }
}

fn state_of(path: &Path, name: &str) -> State {
    match Library::load(path).and_then(|library| library.named(name)) {
        Err(reason) => State::Unusable(reason),
        Ok(library) => {
            let version = library.version().to_owned();
            match library.devices() {
                Ok(devices) => State::Usable { version, devices },
                Err(error) => State::Failing { version, error },
            }
        }
    }
}

/// Lists files of a folder named like backends, by name; an unreadable folder has none.
fn backends_in(folder: &Path) -> Vec<(String, PathBuf)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<(String, PathBuf)> = entries
        .filter_map(|entry| Some((name_of_file(entry.file_name().to_str()?)?, entry.path())))
        .filter(|(_, path)| path.is_file())
        .collect();
    found.sort();
    found
}

fn open_on(library: Arc<Library>, devices: Vec<Device>, options: &Options) -> Result<LoadedBackend, OpenError> {
    let name = library.name().to_owned();
    if devices.is_empty() {
        return Err(OpenError::NoDevice { name });
    }
    let chosen = match options.device() {
        None => Some(0),
        Some(wanted) => match wanted.parse::<usize>() {
            Ok(number) => (number < devices.len()).then_some(number),
            Err(_) => {
                let wanted = wanted.to_lowercase();
                devices
                    .iter()
                    .position(|device| device.name.to_lowercase().contains(&wanted))
            }
        },
    };
    let Some(chosen) = chosen else {
        return Err(OpenError::NoSuchDevice {
            name,
            wanted: options.device().unwrap_or_default().to_owned(),
            there: devices,
        });
    };
    let number = u32::try_from(chosen).unwrap_or(u32::MAX);
    let device = devices[chosen].clone();
    let for_plugin = options.for_plugin(&name, device.kind);
    let mut opened = LoadedBackend::open(library, number, device, &for_plugin)
        .map_err(|source| OpenError::Backend { name, source })?;
    if !options.is_on("passes") {
        opened = opened.without_passes();
    }
    if !options.is_on("rays") {
        opened = opened.without_rays();
    }
    Ok(opened)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::Environment;

    #[test]
    fn options_are_judged() {
        let good = Options::parse(&["timing=on", "device=1", "a=b=c"]).expect("good options");
        let on_software = |options: &Options, plugin| options.for_plugin(plugin, DeviceKind::Software);
        assert_eq!(on_software(&good, "vulkan"), "a=b=c,timing=on");
        let bounded = good.clone().within(4096);
        assert_eq!(on_software(&bounded, "vulkan"), "a=b=c,timing=on,memory=4096");
        assert_eq!(
            on_software(&bounded, "another"),
            "a=b=c,timing=on",
            "it may know no such option"
        );
        assert_eq!(bounded.for_plugin("vulkan", DeviceKind::DiscreteGpu), "a=b=c,timing=on");
        let own = Options::parse(&["memory=7"]).expect("a good option").within(4096);
        assert_eq!(on_software(&own, "gl"), "memory=7");
        assert_eq!(good.device(), Some("1"));
        for wrong in [&["fast"][..], &["=1"], &["a=1,b=2"], &["a=\0"]] {
            assert!(matches!(Options::parse(wrong), Err(OpenError::Option(_))), "{wrong:?}");
        }
        assert!(matches!(Options::parse(&["a=1", "a=2"]), Err(OpenError::Twice(_))));
        assert!(Options::parse::<&str>(&[]).expect("none").is_empty());
    }

    #[test]
    fn names_and_paths_are_told_apart() {
        assert!(Registry::is_path("./x") && Registry::is_path(&format!("x{DLL_SUFFIX}")));
        assert!(!Registry::is_path("vulkan"));
    }

    #[test]
    fn everything_that_was_tried_is_said() {
        let place = tempfile::tempdir().expect("a temporary directory");
        let missing = place.path().join("nowhere");
        std::fs::write(place.path().join(file_name("vulkan")), "not a library").expect("a file");
        let search = Search::new(&[place.path().to_owned(), missing.clone()], &Environment::default());
        let registry = Registry::new(search, &["cpu"]);
        let error = registry.find("vulkan").expect_err("there is none").to_string();
        let lines: Vec<&str> = error.lines().collect();
        assert_eq!(lines[0], "no backend named `vulkan`");
        assert!(
            lines[1].starts_with("  tried  ") && lines[1].contains("not loaded: "),
            "{error}"
        );
        assert!(
            lines[2].contains("nowhere") && lines[2].ends_with("no such folder"),
            "{error}"
        );
        let auto = registry.auto(&Options::default(), 2);
        assert!(auto.taken.is_none());
        assert!(auto.passed_over[0].reason.contains("not loaded"), "{auto:?}");
        assert_eq!(auto.passed_over[1].reason, "not installed");
        let listed = registry.list();
        assert!(
            matches!(
                &listed[..],
                [Listed {
                    state: State::Unusable(_),
                    ..
                }]
            ),
            "{listed:?}"
        );
    }

    #[test]
    fn with_raised_privileges_no_path_is_loaded() {
        let raised = Environment {
            raised: true,
            ..Environment::default()
        };
        let registry = Registry::new(Search::new(&[], &raised), &["cpu"]);
        let path = format!("/tmp/x{DLL_SUFFIX}");
        assert!(matches!(registry.find(&path), Err(OpenError::Raised { .. })));
    }
}
