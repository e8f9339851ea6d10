//! Texts that several commands' `--help` share.

/// End of every `--help`.
pub(crate) const AFTER_LONG_HELP: &str = "\
Environment:
  HEMICUBE_NAME         a setting of `compute`, `inspect` and `tradeoff`: HEMICUBE_RESOLUTION=512. Those that
                        `hemicube compute --print-config` lists
  HEMICUBE_BACKEND_PATH folders with further backends
  HEMICUBE_NO_PROGRESS  1: no progress bar
  HEMICUBE_LOG          what the libraries log: error, warn, info, debug, trace
Exit status:
  0    done
  1    a check, a comparison or a tolerance did not hold
  2    wrong usage, unreadable input, or something that could not be written
  130  interrupted; what was computed is kept, and the same command goes on there";

const SETTINGS_HELP: &str = "\
Settings, strongest first:
  1. the command line
  2. variables HEMICUBE_NAME, of the settings that `--print-config` lists
  3. ./hemicube.toml, which holds the long names: `resolution = 512`
  4. $XDG_CONFIG_HOME/hemicube/hemicube.toml, or ~/.config/hemicube/hemicube.toml
  5. what is built in
  `--config FILE` stands for 3 and 4; `--print-config` shows each value and where it came from.
  ./hemicube.toml may name an installed backend, but no file of one (`backend = \"./x.so\"`) and no `backend-dir`: what
  runs is for the command line, a variable or `--config` to say.";

/// Text after the options: examples, the sources of settings if the command has any, environment, exit status.
pub(crate) fn examples(examples: &str, settings: bool) -> String {
    let settings = if settings {
        format!("{SETTINGS_HELP}\n")
    } else {
        String::new()
    };
    format!("Examples:\n{examples}\n{settings}{AFTER_LONG_HELP}")
}

/// Help on the scene argument: the formats.
pub(crate) fn scene_help() -> String {
    format!(
        "The scene: {}; or a folder of such files",
        hemicube_scene::Format::listed()
    )
}
