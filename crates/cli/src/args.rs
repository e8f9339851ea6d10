//! The command line: the one definition that help, settings files and environment variables are made from.

use clap::{Args, Parser, Subcommand, ValueEnum};
use hemicube::backend::RESOLUTIONS;
use hemicube::store::{Form, Shard};
use hemicube_scene::Axis;
use hemicube_scene::generate::Kind;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::str::FromStr;

/// What every `--help` ends in.
const AFTER_LONG_HELP: &str = "\
Environment:
  HEMICUBE_NAME         the setting `--name` of `compute`, `inspect` and `tradeoff`: HEMICUBE_RESOLUTION=512
  HEMICUBE_BACKEND_PATH folders with further backends
  HEMICUBE_NO_PROGRESS  1: no progress bar
  HEMICUBE_LOG          what the libraries log: error, warn, info, debug, trace
Exit status:
  0    done
  1    a check, a comparison or a tolerance did not hold
  2    wrong usage, unreadable input, or something that could not be written
  130  interrupted; what was computed is kept, and the same command goes on there";

/// Likewise for `balance`, of which an interrupt leaves nothing of use.
const AFTER_BALANCE_HELP: &str = "\
Environment:
  HEMICUBE_NO_PROGRESS  1: no progress bar
  HEMICUBE_LOG          what the libraries log: error, warn, info, debug, trace
Exit status:
  0    done
  1    the rows did not settle within `--max-sweeps`; the matrix is written all the same
  2    wrong usage, unreadable input, or something that could not be written
  130  interrupted; OUT is not there or says that it is incomplete, and `--overwrite` starts again
";

/// Likewise for `interactive`, which has keys.
const AFTER_INTERACTIVE_HELP: &str = "\
Examples:
  hemicube
  hemicube interactive --scenes ~/scenes
  hemicube interactive --plain <answers     # a line for each question
Keys:
  arrow keys, Enter  choose; or type the number, or a part of the name
  Tab                complete a path
  Esc, Ctrl-D        back; at the first menu, exit
  Ctrl-C             exit; while a command runs, end that, and come back
Environment:
  TERM                  dumb, or nothing: numbered lines in place of menus
  NO_COLOR              no colours
  HEMICUBE_SCENES       as `--scenes`
  HEMICUBE_NAME         as in `hemicube compute --help`, of which the dialogue shows the values
Exit status, whatever that of the commands was:
  0    left by the exit, by Esc, or at the end of the input
  2    no terminal, or a wrong file of settings
  130  left by Ctrl-C or a request to terminate";

const SETTINGS_HELP: &str = "\
Settings, strongest first:
  1. the command line
  2. variables HEMICUBE_NAME
  3. ./hemicube.toml, which holds the long names: `resolution = 512`
  4. $XDG_CONFIG_HOME/hemicube/hemicube.toml, or ~/.config/hemicube/hemicube.toml
  5. what is built in
  `--config FILE` stands for 3 and 4; `--print-config` shows each value and where it came from.
  ./hemicube.toml may name an installed backend, but no file of one (`backend = \"./x.so\"`) and no `backend-dir`: what
  runs is for the command line, a variable or `--config` to say.";

fn examples(examples: &str, settings: bool) -> String {
    let settings = if settings {
        format!("{SETTINGS_HELP}\n")
    } else {
        String::new()
    };
    format!("Examples:\n{examples}\n{settings}{AFTER_LONG_HELP}")
}

/// Form-factor (view-factor) matrices of triangle scenes by the hemicube method.
#[derive(Debug, Parser)]
#[command(
    name = "hemicube",
    version,
    max_term_width = 100,
    color = clap::ColorChoice::Never,
    subcommand_required = true,
    arg_required_else_help = true,
    disable_help_subcommand = true,
    after_long_help = examples(
        "  hemicube generate room --patches 10240 -o room.obj
  hemicube compute room.obj -o room.hemicube
  hemicube check room.hemicube
  hemicube export room.hemicube room.npz",
        false,
    )
)]
pub(crate) struct Cli {
    /// What to do
    #[command(subcommand)]
    pub(crate) command: Command,
    #[command(flatten)]
    pub(crate) talk: Talk,
}

/// How much is said on standard error.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Talk {
    /// Say nothing but errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Say more: all settings, and what was mended in the scene
    #[arg(short, long, global = true)]
    pub(crate) verbose: bool,
    /// Draw no progress bar (there is none anyway unless standard error is a terminal)
    #[arg(long, global = true, hide_short_help = true, env = "HEMICUBE_NO_PROGRESS", hide_env = true, value_parser = clap::builder::FalseyValueParser::new())]
    pub(crate) no_progress: bool,
    /// How messages on standard error look; json: one object a line, stages with their times among them
    #[arg(
        long,
        global = true,
        value_name = "text|json",
        default_value = "text",
        hide_possible_values = true,
        hide_short_help = true
    )]
    pub(crate) log_format: LogFormat,
}

/// How messages look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// For people.
    Text,
    /// A JSON object a line, with the time, and the stages of a run with how long they took.
    Json,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Compute the form-factor matrix of a scene, or go on where a run stopped
    #[command(override_usage = "hemicube compute [OPTIONS] SCENE -o DIR", after_long_help = examples(
        "  hemicube compute room.obj -o room.hemicube
  hemicube compute room.obj -o room.hemicube --tolerance 0.5% --verify 32
  hemicube compute city.obj -o city.hemicube --sample-rows 1% --seed 7
  hemicube compute city.obj -o city.hemicube --shard 3/16    then: hemicube merge city.hemicube
  hemicube compute city.glb -o facades.hemicube --emitters 'facade*' --occluders 'tree*'
  hemicube compute room.obj -o fine.hemicube --subdivide 4 --resolution 512 --json=fine.json",
        true,
    ))]
    Compute(Box<Compute>),
    /// Describe a scene: size, area, sides, defects, and what its matrix would cost
    #[command(override_usage = "hemicube inspect [OPTIONS] SCENE", after_long_help = examples("  hemicube inspect city.obj\n  hemicube inspect city.obj --split 4 --json", true))]
    Inspect(Box<Inspect>),
    /// Measure error against time on a scene and this machine, and recommend a setting
    #[command(override_usage = "hemicube tradeoff [OPTIONS] SCENE", after_long_help = examples("  hemicube tradeoff city.obj --plot city.svg\n  hemicube tradeoff city.obj --tolerance 0.3% --sample-rows 64 --json=city.json", true))]
    Tradeoff(Box<Tradeoff>),
    /// Rerun the study of algorithms on this machine: tables, pictures, and what finds itself
    #[command(override_usage = "hemicube bench [OPTIONS]", after_long_help = examples("  hemicube bench --quick\n  hemicube bench -o study --scenes ../shared/scenes", false))]
    Bench(crate::commands::bench::Arguments),
    /// Check a matrix: closure, reciprocity, range, checksums; exit 1 when a bound is broken
    #[command(after_long_help = examples("  hemicube check room.hemicube\n  hemicube check room.hemicube --reciprocity 0.05", false))]
    Check(Check),
    /// Make one matrix of what shards computed
    #[command(override_usage = "hemicube merge [OPTIONS] DIR [FROM]...", after_long_help = examples("  hemicube merge city.hemicube\n  hemicube merge city.hemicube /scratch/node1/city.hemicube /scratch/node2/city.hemicube", false))]
    Merge(Merge),
    /// Write a balanced copy of a matrix: reciprocal, closed, or without small entries
    #[command(override_usage = "hemicube balance [OPTIONS] DIR -o OUT", after_long_help = format!("Examples:\n  hemicube balance room.hemicube -o closed.hemicube --closure\n  hemicube balance city.hemicube -o small.hemicube --min-factor 1e-5 --reciprocity\n{}", AFTER_BALANCE_HELP.trim_end()))]
    Balance(Balance),
    /// Compare two matrices (stores, .npz, .mtx or .npy); the second is the reference
    #[command(after_long_help = examples("  hemicube compare fast.hemicube fine.hemicube --max-error 0.02\n  hemicube compare fast.hemicube fine.hemicube --plot errors.svg", false))]
    Compare(Compare),
    #[command(about = crate::commands::export::about(), after_long_help = examples(crate::commands::export::EXAMPLES, false))]
    Export(Box<crate::commands::export::Arguments>),
    /// Solve for light or heat: radiosity of every patch from a matrix and its materials
    #[command(after_long_help = examples("  hemicube solve room.hemicube --scene room.obj\n  hemicube solve city.hemicube --materials city.toml -o city.npz -o city.csv\n  hemicube solve oven.hemicube --thermal --materials oven.toml --ambient 293", false))]
    Solve(Box<crate::commands::solve::Arguments>),
    /// What patches and points see of the sky, of the ground below the horizon, and of the sun
    #[command(after_long_help = examples("  hemicube sky city.obj --up z -o city-sky --tolerance 0.5%\n  hemicube sky city.obj --store city.hemicube\n  hemicube sky street.obj -o sky --division reinhart:4 --points people.txt --suns june.txt", false))]
    Sky(Box<crate::commands::sky::Arguments>),
    /// Draw pictures: the hemicube of a patch, the model in the colours of a result, the matrix
    View {
        /// What to draw.
        #[command(subcommand)]
        command: crate::commands::view::View,
    },
    /// Write one HTML page about a matrix, to be opened from the disk: what it is, whether it holds, the model in 3-D
    #[command(after_long_help = examples("  hemicube report room.hemicube room.obj -o room.html\n  hemicube report city.hemicube city.obj -o city.html --entries 64", false))]
    Report(Box<crate::commands::report::Arguments>),
    /// Choose from menus, which show the command lines that they run; on a terminal, `hemicube` alone is this
    #[command(after_long_help = AFTER_INTERACTIVE_HELP)]
    Interactive(crate::commands::interactive::Arguments),
    /// Generate a scene: room, city, block-city, maze, spheres, field or soup
    #[command(after_long_help = examples("  hemicube generate city --patches 100000 --seed 3 -o city.obj", false))]
    Generate(Generate),
    /// Write man pages, for packages of the program
    #[command(hide = true)]
    Manual(Manual),
    /// Print a script that completes command lines in a shell
    #[command(hide = true)]
    Completions(Completions),
    /// The engines that render hemicubes
    Backends {
        /// What to do.
        #[command(subcommand)]
        command: Backends,
    },
}

/// `hemicube manual`
#[derive(Args, Debug)]
pub(crate) struct Manual {
    /// The directory to write them to
    #[arg(value_name = "DIR")]
    pub(crate) directory: PathBuf,
}

/// `hemicube completions`
#[derive(Args, Debug)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub(crate) shell: clap_complete::Shell,
}

/// What can be done with backends.
#[derive(Debug, Subcommand)]
pub(crate) enum Backends {
    /// List the backends, their devices and what they can do, and why others cannot be used
    #[command(after_long_help = AFTER_LONG_HELP)]
    List(BackendsList),
    /// Hold a backend against the contract, each case in a process of its own; exit 1 when one is not kept
    #[command(after_long_help = examples("  hemicube backends check vulkan\n  hemicube backends check ./libhemicube_backend_mine.so --only 'room/*' --time-limit 20", false))]
    Check(BackendsCheck),
}

/// `hemicube backends check`
#[derive(Args, Debug)]
pub(crate) struct BackendsCheck {
    /// The backend: a name, or the file of one
    #[arg(value_name = "NAME|PATH")]
    pub(crate) backend: String,
    /// Look for backends in DIR first
    #[arg(long, value_name = "DIR", env = "HEMICUBE_BACKEND_DIR", hide_env = true)]
    pub(crate) backend_dir: Option<PathBuf>,
    /// An option of the backend, such as `device=1` (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) backend_option: Vec<String>,
    /// Only cases `scene/check` that match
    #[arg(long, value_name = "GLOB", default_value = "*")]
    pub(crate) only: String,
    /// Seconds after which a case counts as hung
    #[arg(long, value_name = "SECONDS", default_value = "120", value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub(crate) time_limit: u32,
    /// Run this case, in this process, and say on standard output what came of it
    #[arg(long, value_name = "CASE", hide = true)]
    pub(crate) case: Option<String>,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube backends list`
#[derive(Args, Debug)]
pub(crate) struct BackendsList {
    /// Look for backends in DIR first
    #[arg(long, value_name = "DIR", env = "HEMICUBE_BACKEND_DIR", hide_env = true)]
    pub(crate) backend_dir: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// How the scene is read and cut into patches.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Patches")]
pub(crate) struct SceneSettings {
    /// Halve all edges L times: each triangle becomes 4^L patches
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(0..=31))]
    pub(crate) subdivide: Option<u32>,
    /// Cut all edges in K pieces: each triangle becomes K² patches
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub(crate) split: Option<u32>,
    /// Cut until no patch is longer than LENGTH, in the scene's unit
    #[arg(long, value_name = "LENGTH", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) patch_size: Option<f64>,
    /// Make both sides of triangles patches; auto: as the file says
    #[arg(
        long,
        value_name = "auto|on|off",
        default_value = "auto",
        hide_possible_values = true
    )]
    pub(crate) two_sided: AutoSwitch,
    /// Turn the one-sided triangles of these objects round (repeatable); all: of every object
    #[arg(long, value_name = "GLOB|all", hide_short_help = true)]
    pub(crate) flip: Vec<String>,
    /// The axis that points up, where the file does not say or is wrong
    #[arg(long, value_name = "x|y|z", hide_possible_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Multiply all coordinates by FACTOR
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) scale: f64,
    /// Keep triangles that lie exactly on others
    #[arg(long, value_name = "WHEN", num_args = 0..=1, require_equals = true, default_missing_value = "on", default_value = "off", hide_short_help = true)]
    pub(crate) keep_duplicates: Switch,
    /// Read a scene of which more would come than a file of its size may become (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
}

/// What renders hemicubes, and how it goes about it. The rows are the same.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Hemicubes")]
pub(crate) struct EngineSettings {
    /// What renders: cpu, gl, wgpu, vulkan, or a file; never falls back to another
    #[arg(long, value_name = "auto|NAME|PATH", default_value = "auto")]
    pub(crate) backend: String,
    /// Look for backends in DIR first
    #[arg(long, value_name = "DIR", hide_short_help = true)]
    pub(crate) backend_dir: Option<PathBuf>,
    /// An option of the backend, such as `device=1` (repeatable)
    #[arg(long, value_name = "KEY=VALUE", hide_short_help = true)]
    pub(crate) backend_option: Vec<String>,
    /// How the CPU backend finds what is visible: by depth, for any scene, in order, for polygonal ones, or by claims,
    /// which gives the rows of depth and is faster where hemicubes are fine, or triangles are cut into many patches
    #[arg(
        long,
        value_name = "auto|depth|order|claims",
        default_value = "auto",
        hide_possible_values = true,
        hide_short_help = true
    )]
    pub(crate) engine: Engine,
    /// Deepest level of the octree, up to 21
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = octree_levels, hide_short_help = true)]
    pub(crate) octree_levels: Auto,
    /// Patches up to which a node of the octree is not divided
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = min_patches, hide_short_help = true)]
    pub(crate) min_patches: Auto,
    /// Worker threads; 0: one for each core
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(crate) threads: u32,
}

impl Default for EngineSettings {
    /// What is set where nobody says.
    fn default() -> Self {
        Self {
            backend: "auto".to_owned(),
            backend_dir: None,
            backend_option: Vec::new(),
            engine: Engine::Auto,
            octree_levels: Auto::Auto,
            min_patches: Auto::Auto,
            threads: 0,
        }
    }
}

/// How hemicubes are rendered, and what form factors are made of.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Hemicubes")]
pub(crate) struct RenderSettings {
    /// Aim at this relative Frobenius error: 1%, 0.003
    #[arg(long, value_name = "T", value_parser = tolerance)]
    pub(crate) tolerance: Option<Tolerance>,
    /// pixel: sums of pixels; point, area: visible fraction × closed form
    #[arg(long, value_name = "pixel|point|area", default_value = "area", value_parser = correction)]
    pub(crate) correction: Correction,
    /// Pixels along an edge: a multiple of 16 up to 1024
    #[arg(id = "resolution", long = "resolution", value_name = "auto|N", default_value = "auto", value_parser = resolution)]
    pub(crate) resolution_asked: Auto,
    /// What `resolution_asked` comes to, from [`RenderSettings::settle`].
    #[arg(skip)]
    pub(crate) resolution: u32,
    /// Hemicubes a patch: 1, 4, 9, 16…
    #[arg(long, value_name = "K", default_value = "1", value_parser = samples)]
    pub(crate) samples: Samples,
    /// Turn each hemicube by a hash of its patch
    #[arg(long, value_name = "on|off", default_value = "on", hide_possible_values = true)]
    pub(crate) rotation: Switch,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
}

impl RenderSettings {
    /// Pixels along an edge where nobody says: sums of pixels need more than fractions of them.
    const RESOLUTION_OF_PIXEL: u32 = 256;
    const RESOLUTION_OF_FRACTIONS: u32 = 128;

    /// Settles what was left open.
    pub(crate) fn settle(&mut self) {
        self.resolution = self.resolution_asked.or(match self.correction {
            Correction::Pixel => Self::RESOLUTION_OF_PIXEL,
            Correction::Point | Correction::Area => Self::RESOLUTION_OF_FRACTIONS,
        });
    }
}

/// Where settings come from.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Settings and reports")]
pub(crate) struct ConfigFiles {
    /// Read settings from FILE (TOML) and from no other file
    #[arg(long, value_name = "FILE", conflicts_with = "no_config")]
    pub(crate) config: Option<PathBuf>,
    /// Read no file of settings
    #[arg(long, hide_short_help = true)]
    pub(crate) no_config: bool,
    /// Print every setting and where it came from, and do nothing else
    #[arg(long)]
    pub(crate) print_config: bool,
}

/// Reports for programs.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Settings and reports")]
pub(crate) struct Report {
    /// Report as JSON, to standard output or to FILE
    #[arg(long, value_name = "FILE|-", num_args = 0..=1, require_equals = true, default_missing_value = "-")]
    pub(crate) json: Option<PathBuf>,
    /// Leave times and memory out of the report, so that equal runs report equally
    #[arg(long, requires = "json", hide_short_help = true)]
    pub(crate) no_timings: bool,
}

/// What a scene may be, for help.
pub(crate) fn scene_help() -> String {
    format!("The scene: {}", hemicube_scene::Format::listed())
}

/// `hemicube compute`
#[derive(Args, Debug)]
pub(crate) struct Compute {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    /// The directory to write the matrix to
    #[arg(short, long, value_name = "DIR", required_unless_present = "print_config")]
    pub(crate) output: Option<PathBuf>,
    /// Replace a matrix that is there, instead of going on with it
    #[arg(long)]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) render: RenderSettings,
    #[command(flatten)]
    pub(crate) process: ProcessSettings,
    /// Measure the error of ROWS of the rows against rays; exit 1 when it is above the tolerance
    #[arg(long, value_name = "ROWS", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Rows and columns")]
    pub(crate) verify: Option<u32>,
    /// Skip what cannot be seen; the matrix is the same
    #[arg(
        long,
        value_name = "auto|on|off",
        default_value = "auto",
        hide_possible_values = true,
        help_heading = "Hemicubes"
    )]
    pub(crate) culling: AutoSwitch,
    /// Hemicubes a call of the backend; 0: what it likes best
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=1 << 20), hide = true)]
    pub(crate) batch: u32,
    #[command(flatten)]
    pub(crate) selection: SelectionSettings,
    /// plain: f32, opens in SciPy; compact: a third to a quarter of that, F within 0.05 % of itself; auto: by size
    #[arg(
        long,
        value_name = "auto|plain|compact",
        default_value = "auto",
        hide_possible_values = true,
        help_heading = "What is kept"
    )]
    pub(crate) store: StoreForm,
    /// Leave out form factors below F, 1e-7 from a million patches on; the others of a row share what they carried
    #[arg(long, value_name = "F", value_parser = share_or_none, allow_negative_numbers = true, help_heading = "What is kept")]
    pub(crate) min_factor: Option<f64>,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// How a long run is spread, bounded and watched. The matrix is the same.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Long runs")]
pub(crate) struct ProcessSettings {
    /// Compute share I of N; auto: as Slurm, MPI or Kubernetes says
    #[arg(long, value_name = "I/N|auto", conflicts_with_all = ["overwrite", "verify"])]
    pub(crate) shard: Option<ShardChoice>,
    /// Take no more than SIZE of memory: 800M, 4G. With fewer threads, if need be
    #[arg(long, value_name = "SIZE", value_parser = bytes, hide_short_help = true)]
    pub(crate) memory: Option<u64>,
    /// Write how far it has come to FILE (JSON), once a second
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    pub(crate) progress_file: Option<PathBuf>,
}

/// Which rows and columns are computed.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Rows and columns")]
pub(crate) struct SelectionSettings {
    /// Only the rows of patches A to B − 1, counted from 0
    #[arg(long, value_name = "A..B")]
    pub(crate) rows: Option<RowRange>,
    /// Only a random sample of the rows
    #[arg(long, value_name = "N|P%")]
    pub(crate) sample_rows: Option<SampleSize>,
    /// Which sample
    #[arg(long, value_name = "S", default_value = "1")]
    pub(crate) seed: u64,
    /// Rows only for objects or materials that match (repeatable)
    #[arg(long, value_name = "GLOB")]
    pub(crate) emitters: Vec<String>,
    /// Columns only for these (repeatable)
    #[arg(long, value_name = "GLOB")]
    pub(crate) receivers: Vec<String>,
    /// Neither rows nor columns for these: they only occlude (repeatable)
    #[arg(long, value_name = "GLOB")]
    pub(crate) occluders: Vec<String>,
}

/// `hemicube inspect`
#[derive(Args, Debug)]
pub(crate) struct Inspect {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) render: RenderSettings,
    /// Which hemicubes the forecast is made from
    #[arg(
        long,
        value_name = "S",
        default_value = "1",
        help_heading = "Hemicubes",
        hide_short_help = true
    )]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube tradeoff`
#[derive(Args, Debug)]
pub(crate) struct Tradeoff {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    /// The relative Frobenius error that a setting is recommended for
    #[arg(long, value_name = "T", default_value = "1%", value_parser = tolerance)]
    pub(crate) tolerance: Tolerance,
    /// How many random rows are measured
    #[arg(long, value_name = "N", default_value = "24", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub(crate) sample_rows: u32,
    /// Which rows
    #[arg(long, value_name = "S", default_value = "1")]
    pub(crate) seed: u64,
    /// Draw error against time into FILE: .svg or .png
    #[arg(long, value_name = "FILE")]
    pub(crate) plot: Option<PathBuf>,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube check`
#[derive(Args, Debug)]
pub(crate) struct Check {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// Bound on how far from 1 a row may sum [default: 1e-6]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) closure: Option<f64>,
    /// Bound on the part of a row that escapes, for closed scenes: 0.001 [default: none, it is reported only]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) escaped: Option<f64>,
    /// Bound on the relative difference of A_i F_ij and A_j F_ji [default: none, it is reported only]
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) reciprocity: Option<f64>,
    /// Accept a matrix of which parts are missing, such as that of an interrupted run
    #[arg(long)]
    pub(crate) allow_incomplete: bool,
    /// How many of the rows that sum worst are listed
    #[arg(long, value_name = "N", default_value = "5", value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub(crate) worst: u16,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube merge`
#[derive(Args, Debug)]
pub(crate) struct Merge {
    /// The directory that the shards wrote to, or that is to hold the whole
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// Other directories that shards wrote to; their parts are copied
    #[arg(value_name = "FROM")]
    pub(crate) sources: Vec<PathBuf>,
    /// Threads that check parts; 0: one for each core
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(crate) threads: u32,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube balance`
#[derive(Args, Debug)]
#[command(group = clap::ArgGroup::new("work").required(true).multiple(true))]
pub(crate) struct Balance {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// The directory to write the balanced matrix to
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Scale rows and columns alike until each row and what it lost sum to 1; keeps reciprocity
    #[arg(long, group = "work")]
    pub(crate) closure: bool,
    /// Make A_i F_ij and A_j F_ji equal
    #[arg(long, group = "work")]
    pub(crate) reciprocity: bool,
    /// Leave out form factors below X, and give what a row loses to its others
    #[arg(long, value_name = "X", value_parser = share, allow_negative_numbers = true, group = "work")]
    pub(crate) min_factor: Option<f64>,
    /// By how much a row may be scaled; rows that want more stay there, and are counted
    #[arg(long, value_name = "S", default_value = "1.1", value_parser = max_scale, allow_negative_numbers = true)]
    pub(crate) max_scale: f64,
    /// How near its sum each row is to come
    #[arg(long, value_name = "T", default_value = "1e-6", value_parser = residual, allow_negative_numbers = true)]
    pub(crate) tolerance: f64,
    /// Sweeps of the scaling before it gives up; exit 1
    #[arg(long, value_name = "N", default_value = "1000", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_sweeps: u32,
    /// Replace a matrix that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube compare`
#[derive(Args, Debug)]
pub(crate) struct Compare {
    /// The matrix: a store, or a .npz, .mtx or .npy file
    #[arg(value_name = "A")]
    pub(crate) matrix: PathBuf,
    /// The reference
    #[arg(value_name = "B")]
    pub(crate) reference: PathBuf,
    /// Exit 1 when the relative Frobenius error is above X
    #[arg(long, value_name = "X", value_parser = not_negative, allow_negative_numbers = true)]
    pub(crate) max_error: Option<f64>,
    /// Compare only the rows A to B − 1, counted from 0
    #[arg(long, value_name = "A..B")]
    pub(crate) rows: Option<RowRange>,
    /// Draw how many rows have which error into FILE, beside what A expected of them if it was computed to a tolerance:
    /// .svg or .png
    #[arg(long, value_name = "FILE")]
    pub(crate) plot: Option<PathBuf>,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) report: Report,
}

/// `hemicube generate`
#[derive(Args, Debug)]
pub(crate) struct Generate {
    /// The kind of scene: room, city, block-city, maze, spheres, field or soup
    #[arg(value_name = "KIND")]
    pub(crate) kind: Kind,
    /// The OBJ file to write; `-` for standard output
    #[arg(short, long, value_name = "OUT.obj")]
    pub(crate) output: PathBuf,
    /// About how many patches it is to have
    #[arg(long, value_name = "N", default_value = "10000", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) patches: u64,
    /// Which of the scenes of this kind
    #[arg(long, value_name = "S", default_value = "1")]
    pub(crate) seed: u64,
    /// Replace a file that is there
    #[arg(long)]
    pub(crate) overwrite: bool,
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Switch {
    /// On.
    On,
    /// Off.
    Off,
}

/// Which engine of the CPU backend renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Engine {
    /// What suits the scene.
    Auto,
    /// The hierarchical z-buffer.
    Depth,
    /// Ordered coverage bits.
    Order,
    /// Coverage bits, and depth where surfaces contend: the rows of `depth`.
    Claims,
}

/// The form of a store's parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StoreForm {
    /// Compact from a million patches on.
    Auto,
    /// As SciPy reads it.
    Plain,
    /// Smaller.
    Compact,
}

impl StoreForm {
    /// What was asked for.
    pub(crate) fn form(self) -> Option<Form> {
        match self {
            Self::Auto => None,
            Self::Plain => Some(Form::Plain),
            Self::Compact => Some(Form::Compact),
        }
    }
}

/// On, off, or what suits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum AutoSwitch {
    /// What suits.
    Auto,
    /// On.
    On,
    /// Off.
    Off,
}

/// An axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum UpAxis {
    /// x
    X,
    /// y
    Y,
    /// z
    Z,
}

impl From<UpAxis> for Axis {
    fn from(axis: UpAxis) -> Self {
        match axis {
            UpAxis::X => Self::X,
            UpAxis::Y => Self::Y,
            UpAxis::Z => Self::Z,
        }
    }
}

/// A number, or what suits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Auto {
    /// What suits.
    Auto,
    /// This.
    Number(u32),
}

impl Auto {
    /// The number, or what suits.
    pub(crate) fn or(self, suits: u32) -> u32 {
        match self {
            Self::Auto => suits,
            Self::Number(number) => number,
        }
    }
}

/// What form factors are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Correction {
    /// The weights of the pixels seen.
    Pixel,
    /// Visible fraction × closed form from the hemicube's centre.
    Point,
    /// Visible fraction × closed form from the whole patch.
    Area,
}

/// A relative Frobenius error to aim at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerance(pub(crate) f64);

/// Number of hemicubes that a patch has: the square of what is held here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Samples {
    /// n of n².
    pub(crate) per_edge: u32,
}

/// Which share of the work is this process's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ShardChoice {
    /// This one.
    Given(Shard),
    /// The one that a scheduler's variables say, of so many where they do not say that.
    Auto(Option<u32>),
}

impl FromStr for ShardChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.strip_prefix("auto") {
            Some("") => Ok(Self::Auto(None)),
            Some(count) => count
                .strip_prefix('/')
                .and_then(|count| count.parse().ok())
                .filter(|&count| count > 0)
                .map(|count| Self::Auto(Some(count)))
                .ok_or_else(|| {
                    "`auto`, or `auto/16` where the scheduler does not say of how many, is needed".to_owned()
                }),
            None => text.parse().map(Self::Given),
        }
    }
}

/// `A..B`, either end of which may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RowRange {
    /// The first row.
    pub(crate) start: u32,
    /// One past the last; `None`: to the end.
    pub(crate) end: Option<u32>,
}

impl FromStr for RowRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || "a range such as `0..100`, `100..` or `..100` is needed".to_owned();
        let (start, end) = text.split_once("..").ok_or_else(form)?;
        let number = |text: &str| match text.trim() {
            "" => Ok(None),
            digits => digits.parse::<u32>().map(Some).map_err(|_| form()),
        };
        let (start, end) = (number(start)?.unwrap_or(0), number(end)?);
        if let Some(end) = end
            && start >= end
        {
            return Err(format!(
                "it holds no row: the end, {end}, is not above the start, {start}"
            ));
        }
        Ok(Self { start, end })
    }
}

/// Number of rows that are sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SampleSize {
    /// So many.
    Count(u32),
    /// So many of a hundred.
    Percent(f64),
}

impl FromStr for SampleSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(percent) = text.strip_suffix('%') {
            return match percent.trim().parse::<f64>() {
                Ok(percent) if percent > 0.0 && percent <= 100.0 => Ok(Self::Percent(percent)),
                _ => Err("a percentage above 0 % and up to 100 % is needed".to_owned()),
            };
        }
        match text.parse::<u32>() {
            Ok(0) => Err("at least 1 row is needed".to_owned()),
            Ok(count) => Ok(Self::Count(count)),
            Err(_) => Err("a number of rows such as `200`, or a percentage such as `5%`, is needed".to_owned()),
        }
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.parse::<f64>().map_err(|_| "it is no number".to_owned())
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number > 0.0 && number.is_finite() {
        Ok(number)
    } else {
        Err("a number above 0 is needed".to_owned())
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number >= 0.0 {
        Ok(number)
    } else {
        Err("a number not below 0 is needed".to_owned())
    }
}

fn share(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number > 0.0 && number < 1.0 {
        Ok(number)
    } else {
        Err("a form factor above 0 and below 1 is needed, such as `1e-5`".to_owned())
    }
}

/// A share, or 0 for nothing.
fn share_or_none(text: &str) -> Result<f64, String> {
    if number(text)? == 0.0 { Ok(0.0) } else { share(text) }
}

/// `800M`, `4G`, `1.5 GiB` or a number of bytes.
fn bytes(text: &str) -> Result<u64, String> {
    let needed = || "a size such as `800M` or `4G` is needed".to_owned();
    let text = text.trim();
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit: f64 = match text[digits.len()..].to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "t" | "tb" => 1e12,
        "kib" => 1024.0,
        "mib" => 1_048_576.0,
        "gib" => 1_073_741_824.0,
        "tib" => 1_099_511_627_776.0,
        _ => return Err(needed()),
    };
    let number: f64 = digits.trim().parse().map_err(|_| needed())?;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "held against its range"
    )]
    if (1e6..1e18).contains(&(number * unit)) {
        Ok((number * unit) as u64)
    } else {
        Err(needed())
    }
}

fn max_scale(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number > 1.0 && number <= hemicube::analysis::balance::MAX_SCALE_MAX {
        Ok(number)
    } else {
        Err("a factor above 1 and up to 16 is needed".to_owned())
    }
}

fn residual(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if (hemicube::analysis::balance::TOLERANCE_MIN..1.0).contains(&number) {
        Ok(number)
    } else {
        Err("a number from 1e-7 up to 1 is needed: form factors are stored with seven digits".to_owned())
    }
}

fn tolerance(text: &str) -> Result<Tolerance, String> {
    const LEAST: f64 = 1e-5;
    const MOST: f64 = 0.5;
    // 0.001% is 1e-5, but need not be to the last bit.
    let share = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
        None => text.parse::<f64>(),
    };
    match share {
        Ok(share) if (LEAST * (1.0 - 1e-9)..=MOST).contains(&share) => Ok(Tolerance(share)),
        Ok(share) if share > MOST => Err("it is above 50 %; 1% is 0.01, and 1 is 100 %".to_owned()),
        Ok(_) => Err("an error from 0.001% to 50% is needed".to_owned()),
        Err(_) => Err("an error such as `1%`, `0.3%` or `0.003` is needed".to_owned()),
    }
}

pub(crate) fn resolution(text: &str) -> Result<Auto, String> {
    if text == "auto" {
        return Ok(Auto::Auto);
    }
    match text.parse::<u32>() {
        Ok(n) if n % 16 == 0 && RESOLUTIONS.contains(&n) => Ok(Auto::Number(n)),
        _ => Err(format!(
            "`auto`, or a multiple of 16 from {} to {}, is needed",
            RESOLUTIONS.start(),
            RESOLUTIONS.end()
        )),
    }
}

fn samples(text: &str) -> Result<Samples, String> {
    const MOST: u32 = 4096;
    match text.parse::<u32>() {
        Ok(k) if k > 0 && k <= MOST && k.isqrt().pow(2) == k => Ok(Samples { per_edge: k.isqrt() }),
        _ => Err(format!("a perfect square (1, 4, 9, 16…) up to {MOST} is needed")),
    }
}

fn correction(text: &str) -> Result<Correction, String> {
    match text {
        "pixel" => Ok(Correction::Pixel),
        "point" => Ok(Correction::Point),
        "area" => Ok(Correction::Area),
        _ => Err("there are `pixel`, `point` and `area`".to_owned()),
    }
}

fn auto(text: &str, range: std::ops::RangeInclusive<u32>) -> Result<Auto, String> {
    if text == "auto" {
        return Ok(Auto::Auto);
    }
    match text.parse::<u32>() {
        Ok(number) if range.contains(&number) => Ok(Auto::Number(number)),
        _ => Err(format!(
            "`auto`, or a number from {} to {}, is needed",
            range.start(),
            range.end()
        )),
    }
}

fn octree_levels(text: &str) -> Result<Auto, String> {
    auto(text, 0..=21)
}

fn min_patches(text: &str) -> Result<Auto, String> {
    auto(text, 1..=1 << 20)
}

/// Joins `--json` with a file that follows it as a word of its own. The value is optional, so `--json scene.obj` would
/// otherwise be ambiguous, and taking the scene for the report's file would overwrite it: only `-` and names that end
/// in `.json` are joined.
pub(crate) fn join_json(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    let mut literal = false;
    for argument in arguments {
        let is_report = argument == OsStr::new("-")
            || PathBuf::from(&argument)
                .extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
                && !argument.as_encoded_bytes().starts_with(b"-");
        match joined.last_mut() {
            Some(last) if !literal && is_report && last == "--json" => {
                last.push("=");
                last.push(argument);
            }
            _ => {
                literal |= argument == "--";
                joined.push(argument);
            }
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn ranges_and_samples() {
        let range = |start, end| RowRange { start, end };
        assert_eq!("3..7".parse(), Ok(range(3, Some(7))));
        assert_eq!("3..".parse(), Ok(range(3, None)));
        assert_eq!("..7".parse(), Ok(range(0, Some(7))));
        for wrong in ["5..2", "5..5", "5", "a..b", "-1..3", "1...3", "", "0..4294967296"] {
            assert!(wrong.parse::<RowRange>().is_err(), "{wrong}");
        }
        assert_eq!("200".parse(), Ok(SampleSize::Count(200)));
        assert_eq!("2.5%".parse(), Ok(SampleSize::Percent(2.5)));
        for wrong in ["0", "0%", "101%", "NaN%", "-3", "few", "%"] {
            assert!(wrong.parse::<SampleSize>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        assert_eq!(resolution("256"), Ok(Auto::Number(256)));
        assert_eq!(resolution("auto"), Ok(Auto::Auto));
        for wrong in ["0", "8", "100", "1040", "-16", "1e2"] {
            assert!(resolution(wrong).is_err(), "{wrong}");
        }
        assert_eq!(samples("9"), Ok(Samples { per_edge: 3 }));
        for wrong in ["0", "2", "3", "4225", "-4"] {
            assert!(samples(wrong).is_err(), "{wrong}");
        }
        for wrong in ["0", "-1", "nan", "inf", "x"] {
            assert!(positive(wrong).is_err(), "{wrong}");
        }
        assert_eq!(octree_levels("auto"), Ok(Auto::Auto));
        assert!(octree_levels("22").is_err() && min_patches("0").is_err());
        assert_eq!(correction("area"), Ok(Correction::Area));
        assert!(correction("best").is_err_and(|e| e.contains("area")));
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(bytes("800M"), Ok(800_000_000));
        assert_eq!(bytes("1.5 GiB"), Ok(3 << 29));
        assert_eq!(bytes("4g"), Ok(4_000_000_000));
        for wrong in ["", "4", "M", "4X", "-4G", "nan", "1e30"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn tolerances_are_shares_or_percentages() {
        for (text, share) in [
            ("1%", 0.01),
            ("0.01", 0.01),
            ("0.3 %", 0.003),
            ("1e-5", 1e-5),
            ("0.001%", 1e-5),
            ("50%", 0.5),
        ] {
            let read = tolerance(text).expect(text).0;
            assert!((read - share).abs() <= 1e-12 * share, "{text}: {read}");
        }
        for wrong in [
            "0", "-1%", "0.0009%", "51%", "1", "5", "nan", "nan%", "inf", "%", "", "few",
        ] {
            assert!(tolerance(wrong).is_err(), "{wrong}");
        }
        assert!(tolerance("1").is_err_and(|error| error.contains("100 %")));
    }

    #[test]
    fn the_resolution_settles_by_the_correction() {
        let settled = |words: &[&str]| {
            let words = ["hemicube", "compute", "a", "-o", "b"].iter().chain(words);
            let Command::Compute(mut compute) = Cli::try_parse_from(words).expect("good words").command else {
                panic!("`compute` is `compute`");
            };
            compute.render.settle();
            compute.render.resolution
        };
        assert_eq!(settled(&[]), 128);
        assert_eq!(settled(&["--correction", "pixel"]), 256);
        assert_eq!(settled(&["--correction", "point"]), 128);
        assert_eq!(settled(&["--tolerance", "1%"]), 128);
        assert_eq!(settled(&["--correction=pixel", "--resolution", "64"]), 64);
    }

    #[test]
    fn a_scene_is_never_taken_for_the_report() {
        let join = |words: &[&str]| join_json(words.iter().map(OsString::from));
        let words = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
        assert_eq!(
            join(&["inspect", "--json", "a.obj"]),
            words(&["inspect", "--json", "a.obj"])
        );
        assert_eq!(
            join(&["inspect", "--json", "-", "a.obj"]),
            words(&["inspect", "--json=-", "a.obj"])
        );
        assert_eq!(
            join(&["check", "--json", "r.json", "d"]),
            words(&["check", "--json=r.json", "d"])
        );
        assert_eq!(
            join(&["check", "--", "--json", "r.json"]),
            words(&["check", "--", "--json", "r.json"])
        );
    }

    #[test]
    fn a_least_factor_may_be_none() {
        assert_eq!((share_or_none("0"), share_or_none("1e-5")), (Ok(0.0), Ok(1e-5)));
        assert!(share("0").is_err() && share_or_none("-1e-5").is_err() && share_or_none("1").is_err());
    }
}
