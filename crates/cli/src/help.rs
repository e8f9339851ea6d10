//! Texts of `--help`: examples, where settings come from, the environment, and each command's own exit statuses.

/// Variables that all commands read.
const ENVIRONMENT: &str = "\
Environment:
  HEMICUBE_BACKEND_PATH folders with further backends
  HEMICUBE_LOG          what the libraries log: error, warn, info, debug, trace
  NO_COLOR              1: no colour";

const SETTINGS_HELP: &str = "\
Settings, strongest first:
  1. the command line
  2. variables HEMICUBE_NAME, of the settings that `--print-config` lists: HEMICUBE_RESOLUTION=512
  3. ./hemicube.toml, which holds the long names: `resolution = 512`
  4. $XDG_CONFIG_HOME/hemicube/hemicube.toml, or ~/.config/hemicube/hemicube.toml
  5. what is built in
  `--config FILE` stands for 3 and 4; `--print-config` shows each value and where it came from.
  ./hemicube.toml may name an installed backend, but no file of one (`backend = \"./x.so\"`): what runs is for the
  command line, a variable or `--config` to say.";

/// Exit statuses 1 and 130 of a command, by its words; empty where it does not end so.
const EXIT_STATUS: [(&str, &str, &str); 24] = [
    (
        "compute",
        "`--verify` measured an error above the tolerance; the matrix is written",
        "interrupted; finished parts are kept, and the same command resumes",
    ),
    ("inspect", "", "interrupted"),
    ("tradeoff", "", "interrupted; nothing is reported"),
    (
        "check",
        "integrity or conservation FAILED, parts are missing, or with `--strict` the quality is DOUBTFUL",
        "interrupted",
    ),
    ("merge", "", "interrupted; the same command goes on"),
    (
        "balance",
        "the rows did not settle within `--max-iterations`; the matrix is written",
        "interrupted; OUT is not there or incomplete, and `--overwrite` starts again",
    ),
    ("compare", "the error is above `--max-error`", "interrupted"),
    ("export", "", "interrupted; nothing is written"),
    (
        "solve",
        "the solver did not converge, or too little of the heat is known; the solution is written",
        "interrupted; no solution is written",
    ),
    (
        "exchange",
        "the Gebhart factors of a surface do not sum to 1; what was asked for is written",
        "interrupted; nothing is written",
    ),
    (
        "sky",
        "rows still changed by more than `--tolerance`; they are written",
        "interrupted; nothing is written",
    ),
    (
        "points",
        "rows still changed by more than `--tolerance`, or `--verify` found more; they are written",
        "interrupted; nothing is written",
    ),
    ("view hemicube", "", "interrupted"),
    ("view model", "", "interrupted"),
    ("view sparsity", "", "interrupted"),
    (
        "report",
        "the matrix does not hold; the page is written, and says what",
        "interrupted",
    ),
    (
        "view3d",
        "as View3D ends for wrong input and for what could not be written; View3D.log says what",
        "interrupted",
    ),
    ("generate", "", "interrupted"),
    ("suns", "", "interrupted"),
    ("manual", "", ""),
    ("completions", "", ""),
    ("backends list", "", ""),
    ("backends check", "a case of the contract is not kept", "interrupted"),
    ("backends header", "", ""),
];

/// Text after the options: examples, and the sources of settings if the command has any.
pub(crate) fn examples(examples: &str, settings: bool) -> String {
    let settings = if settings {
        format!("\n{SETTINGS_HELP}")
    } else {
        String::new()
    };
    format!("Examples:\n{examples}{settings}")
}

/// What ends the help of a command: the environment and its exit statuses; `None` for a command of commands.
pub(crate) fn ending(command: &str) -> Option<String> {
    let (_, not_held, interrupted) = EXIT_STATUS.iter().find(|(name, ..)| *name == command)?;
    let mut text = format!("{ENVIRONMENT}\nExit status:\n  0    done");
    for (status, meaning) in [
        (1, *not_held),
        (
            2,
            "wrong usage, unreadable input, or something that could not be written",
        ),
        (130, *interrupted),
    ] {
        let is_of_view3d = command == "view3d" && status == 2;
        if !meaning.is_empty() && !is_of_view3d {
            text.push_str(&format!("\n  {status:<4} {meaning}"));
        }
    }
    Some(text)
}

/// Help on the scene argument in `-h`.
pub(crate) const SCENE: &str = "The scene's file, or a folder of them (formats: --help)";

/// Help on the scene argument: the formats.
pub(crate) fn scene_help() -> String {
    format!(
        "The scene: {}; or a folder of such files",
        hemicube_scene::Format::listed()
    )
}
