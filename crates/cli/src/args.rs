//! Argument groups shared by several commands, and the values that they take.

use clap::{Args, ValueEnum};
use hemicube::analysis::zones::GroupBy;
use hemicube::backend::RESOLUTIONS;
use hemicube::driver::level::DEFAULT_TOLERANCE;
use hemicube::sky::PARTS_MAX;
use hemicube::store::Shard;
use hemicube_scene::Axis;
use hemicube_spatial::whole;
use serde::Serialize;
use std::path::PathBuf;
use std::str::FromStr;

/// Heading of options that few runs need: they are in `--help`, not in `-h`.
pub(crate) const EXPERT: &str = "Expert";

/// Verbosity on standard error, and colour.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Talk {
    /// No messages but warnings and errors
    ///
    /// Results are printed on standard output all the same.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// More messages and details
    ///
    /// All settings, the engine's work, what was mended in the scene, times in JSON.
    #[arg(short, long, global = true)]
    pub(crate) verbose: bool,
    /// Colour of errors, warnings, hints and verdicts; auto: on terminals, unless NO_COLOR is set
    #[arg(
        long,
        global = true,
        value_name = "auto|always|never",
        default_value = "auto",
        hide_possible_values = true,
        hide_short_help = true
    )]
    pub(crate) color: Color,
}

/// When there is colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Color {
    /// On terminals, unless `NO_COLOR` is set.
    Auto,
    /// Also in files and pipes.
    Always,
    /// Nowhere.
    Never,
}

/// Reading of a scene, and its subdivision into patches.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Patches")]
pub(crate) struct SceneSettings {
    /// Cut edges in K pieces: K² patches a triangle
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) split: Option<u32>,
    /// Cut until no patch is longer
    ///
    /// In the scene's unit.
    #[arg(long, value_name = "LENGTH", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) patch_size: Option<f64>,
    /// Both sides are patches
    ///
    /// auto: as the file says.
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
    /// Leave out the triangles of these objects and materials (repeatable)
    #[arg(long, value_name = "GLOB", hide_short_help = true)]
    pub(crate) exclude: Vec<String>,
    /// The axis that points up [default: as found]
    ///
    /// What the file says, or what its names and shapes suggest: `inspect` tells.
    #[arg(long, value_name = "x|y|z", hide_possible_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Multiply all coordinates by FACTOR
    #[arg(
        long,
        value_name = "FACTOR",
        default_value = "1",
        value_parser = positive,
        allow_negative_numbers = true,
        hide_short_help = true
    )]
    pub(crate) scale: f64,
    /// Keep triangles that lie exactly on others
    #[arg(
        long,
        value_name = "WHEN",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "on",
        default_value = "off",
        hide_short_help = true
    )]
    pub(crate) keep_duplicates: Switch,
    /// Lift the safety limits on the size of a scene (docs/security.md)
    #[arg(long, hide_short_help = true)]
    pub(crate) allow_large: bool,
    /// Memory limit (800M, 4G): a cut that would exceed it is refused at the start
    #[arg(long, value_name = "SIZE", value_parser = bytes, hide_short_help = true)]
    pub(crate) memory: Option<u64>,
}

/// The backend and its parameters. They change the time, never the rows.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Hemicubes")]
pub(crate) struct EngineSettings {
    /// What renders: cpu, gl, wgpu, vulkan, or a file; never falls back to another. HEMICUBE_BACKEND_PATH has the folders
    /// to look for others in
    #[arg(long, value_name = "auto|NAME|PATH", default_value = "auto", hide_short_help = true)]
    pub(crate) backend: String,
    /// An option of the backend, such as `device=1` (repeatable)
    #[arg(long, value_name = "KEY=VALUE", hide_short_help = true)]
    pub(crate) backend_option: Vec<String>,
    /// Visibility algorithm of the CPU backend: depth (any scene), order (polygonal scenes), claims (as depth, faster for
    /// small patches). Sky, points and pictures are by depth
    #[arg(
        long,
        value_name = "auto|depth|order|claims",
        default_value = "auto",
        hide_possible_values = true,
        hide_short_help = true
    )]
    pub(crate) engine: Engine,
    /// Worker threads; 0: one for each core
    ///
    /// Results are the same.
    #[arg(
        long,
        value_name = "N",
        default_value = "0",
        value_parser = clap::value_parser!(u32).range(0..=1024),
        help_heading = "Run"
    )]
    pub(crate) threads: u32,
}

impl Default for EngineSettings {
    /// The built-in settings.
    fn default() -> Self {
        Self {
            backend: "auto".to_owned(),
            backend_option: Vec::new(),
            engine: Engine::Auto,
            threads: 0,
        }
    }
}

/// Hemicubes, and the correction of their rows to form factors.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Matrix")]
pub(crate) struct RenderSettings {
    /// Relative Frobenius error to aim at [default: 2%]
    ///
    /// 1%, or 0.003: from 0.00001% to 50%.
    #[arg(long, value_name = "T", value_parser = tolerance)]
    pub(crate) tolerance: Option<Tolerance>,
    /// tolerance: visible fraction × closed form, to the tolerance; pixel: sums of pixels, the method as published
    #[arg(
        long,
        value_name = "tolerance|pixel",
        default_value = "tolerance",
        value_parser = correction,
        hide_short_help = true
    )]
    pub(crate) correction: Correction,
    /// Pixels along an edge of sums of pixels: 16, 32, 48… 1024
    #[arg(
        id = "resolution",
        long = "resolution",
        value_name = "auto|N",
        default_value = "auto",
        value_parser = resolution,
        hide_short_help = true
    )]
    pub(crate) resolution_asked: Auto,
    /// The resolution in force, from [`RenderSettings::settle`].
    #[arg(skip)]
    pub(crate) resolution: u32,
    /// Hemicubes a patch of sums of pixels: 1, 4, 9, 16…
    #[arg(long, value_name = "K", default_value = "1", value_parser = samples, hide_short_help = true)]
    pub(crate) samples: Samples,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
}

impl RenderSettings {
    /// Built-in resolutions: sums of pixels need more of them than fractions.
    const RESOLUTION_OF_PIXEL: u32 = 256;
    const RESOLUTION_OF_TOLERANCE: u32 = 128;

    /// Fills in `resolution`, by the correction if the user leaves it open. A tolerance has hemicubes of its own, whatever
    /// a file of settings says of those of pixels.
    pub(crate) fn settle(&mut self) {
        match self.correction {
            Correction::Pixel => self.resolution = self.resolution_asked.or(Self::RESOLUTION_OF_PIXEL),
            Correction::Tolerance => {
                (self.resolution, self.samples) = (Self::RESOLUTION_OF_TOLERANCE, Samples { per_edge: 1 });
            }
        }
    }

    /// The tolerance, unless pixels are summed.
    pub(crate) fn tolerance(&self) -> Option<Tolerance> {
        let asked = self.tolerance.unwrap_or(Tolerance(DEFAULT_TOLERANCE));
        (self.correction == Correction::Tolerance).then_some(asked)
    }
}

/// Sources of settings.
#[derive(Args, Clone, Debug)]
pub(crate) struct ConfigFiles {
    /// Read settings from FILE (TOML) and from no other file; none: from no file
    #[arg(long, value_name = "FILE|none", hide_short_help = true)]
    pub(crate) config: Option<PathBuf>,
    /// Print every setting and where it came from, and do nothing else
    #[arg(long, hide_short_help = true)]
    pub(crate) print_config: bool,
}

/// Reports for programs.
#[derive(Args, Clone, Debug)]
pub(crate) struct Report {
    /// Print the results as JSON
    ///
    /// With `-v` times and memory, too; without, equal runs print equally.
    #[arg(long, help_heading = clap::builder::Resettable::Reset)]
    pub(crate) json: bool,
}

/// A stored matrix to solve with: `solve`, `exchange`.
#[derive(Args, Clone, Debug)]
pub(crate) struct StoredMatrix {
    /// The matrix
    #[arg(value_name = "DIR")]
    pub(crate) store: PathBuf,
    /// Worker threads; 0: one for each core
    ///
    /// Results are the same.
    #[arg(long, value_name = "N", default_value = "0", value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(crate) threads: u32,
    /// Replace what is there
    #[arg(long)]
    pub(crate) overwrite: bool,
}

/// Selection of rows and columns.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Matrix")]
pub(crate) struct SelectionSettings {
    /// Only a range of rows, or a random sample
    ///
    /// A..B: the rows of patches A to B − 1, from 0; N or P%: a random sample of so many.
    #[arg(long, value_name = "A..B|N|P%")]
    pub(crate) rows: Option<RowsAsked>,
    /// Which sample
    #[arg(long, value_name = "S", default_value = "1", hide_short_help = true)]
    pub(crate) seed: u64,
    /// Rows only for these objects or materials
    ///
    /// A glob of names; repeatable.
    #[arg(long, value_name = "GLOB")]
    pub(crate) emitters: Vec<String>,
    /// Columns only for these
    ///
    /// A glob of names; repeatable.
    #[arg(long, value_name = "GLOB")]
    pub(crate) receivers: Vec<String>,
    /// Neither rows nor columns for these: they only occlude
    ///
    /// A glob of names; repeatable.
    #[arg(long, value_name = "GLOB")]
    pub(crate) occluders: Vec<String>,
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Switch {
    /// On.
    On,
    /// Off.
    Off,
}

/// Engine of the CPU backend.
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

/// On, off, or the program's choice.
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

/// An angle in degrees.
///
/// # Errors
/// For what is no angle from −360° to 360°.
pub(crate) fn degrees(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(degrees) if degrees.abs() <= 360.0 => Ok(degrees),
        _ => Err("an angle from -360 to 360 degrees is needed".to_owned()),
    }
}

/// A number, or the program's choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Auto {
    /// The program's choice.
    Auto,
    /// This.
    Number(u32),
}

impl Auto {
    /// The number; `suits` for `auto`.
    pub(crate) fn or(self, suits: u32) -> u32 {
        match self {
            Self::Auto => suits,
            Self::Number(number) => number,
        }
    }
}

/// Composition of form factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Correction {
    /// The weights of the pixels seen.
    Pixel,
    /// Visible fraction × closed form, to a tolerance.
    Tolerance,
}

/// A relative Frobenius error to aim at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerance(pub(crate) f64);

/// Number n² of hemicubes a patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Samples {
    /// n of n².
    pub(crate) per_edge: u32,
}

/// Share of the work of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ShardChoice {
    /// This one.
    Given(Shard),
    /// The share named by a scheduler's variables; the number of shares, where they do not say it.
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

/// `A..B`, either end optional.
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

/// Number of sampled rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SampleSize {
    /// Absolute number.
    Count(u32),
    /// Percentage of the rows, above 0 and up to 100.
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

/// Rows to compute: a range, or a random sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RowsAsked {
    /// `A..B`.
    Range(RowRange),
    /// `N` or `P%`.
    Sample(SampleSize),
}

impl FromStr for RowsAsked {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.contains("..") {
            text.parse().map(Self::Range)
        } else {
            let sample = text.parse().map(Self::Sample);
            sample.map_err(|error| format!("{error}; or a range such as `0..100`"))
        }
    }
}

/// A division of the sky, by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Division(pub(crate) u32);

impl FromStr for Division {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = match text.split_once(':') {
            None if text == "tregenza" => Some(1),
            Some(("reinhart", parts)) => parts.parse().ok().filter(|parts| (1..=PARTS_MAX).contains(parts)),
            _ => None,
        };
        parts
            .map(Self)
            .ok_or_else(|| format!("`tregenza`, or `reinhart:1` to `reinhart:{PARTS_MAX}`, is needed"))
    }
}

pub(crate) fn number(text: &str) -> Result<f64, String> {
    text.parse::<f64>().map_err(|_| "it is no number".to_owned())
}

pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number >= 0.0 {
        Ok(number)
    } else {
        Err("a number not below 0 is needed".to_owned())
    }
}

pub(crate) fn share(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number > 0.0 && number < 1.0 {
        Ok(number)
    } else {
        Err("a form factor above 0 and below 1 is needed, such as `1e-5`".to_owned())
    }
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number > 0.0 && number.is_finite() {
        Ok(number)
    } else {
        Err("a number above 0 is needed".to_owned())
    }
}

pub(crate) fn tolerance(text: &str) -> Result<Tolerance, String> {
    const LEAST: f64 = 1e-7;
    const MOST: f64 = 0.5;
    // 0.00001% is 1e-7, but need not be to the last bit.
    let share = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
        None => text.parse::<f64>(),
    };
    match share {
        Ok(share) if (LEAST * (1.0 - 1e-9)..=MOST).contains(&share) => Ok(Tolerance(share)),
        Ok(share) if share > MOST => Err("it is above 50 %; 1% is 0.01, and 1 is 100 %".to_owned()),
        Ok(_) => Err("an error from 0.00001% (1e-7) to 50% is needed".to_owned()),
        Err(_) => Err("an error such as `1%`, `0.3%` or `0.003` is needed".to_owned()),
    }
}

/// `800M`, `4G`, `1.5 GiB` or a number of bytes: 1 MB at least.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let needed = || "a size such as `800M` or `4G` is needed".to_owned();
    let size = size(text).filter(|size| (1e6..1e18).contains(size));
    size.map(whole::to_u64).ok_or_else(needed)
}

/// A number of bytes, with or without a unit; `None` without a number, or with another unit.
pub(crate) fn size(text: &str) -> Option<f64> {
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
        _ => return None,
    };
    digits.trim().parse::<f64>().ok().map(|number| number * unit)
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
        "tolerance" => Ok(Correction::Tolerance),
        _ => Err("there are `tolerance` and `pixel`".to_owned()),
    }
}

/// A share by which a refined row may change: `0.1%`, 0.001.
pub(crate) fn change(text: &str) -> Result<f64, String> {
    let share = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
        None => text.parse::<f64>(),
    };
    match share {
        Ok(share) if (1e-5..=0.5).contains(&share) => Ok(share),
        _ => Err("a share from 0.001% to 50% is needed, such as `0.1%`".to_owned()),
    }
}

/// Pixels along an edge of a hemicube.
pub(crate) fn pixels(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(n) if n % 16 == 0 && RESOLUTIONS.contains(&n) => Ok(n),
        _ => Err(format!(
            "a multiple of 16 from {} to {} is needed",
            RESOLUTIONS.start(),
            RESOLUTIONS.end()
        )),
    }
}

/// Grouping of patches into surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum By {
    /// Objects of one name
    Object,
    /// Materials of one name
    Material,
    /// Faces of the scene's file
    Face,
}

impl By {
    pub(crate) fn group(self) -> GroupBy {
        match self {
            Self::Object => GroupBy::Object,
            Self::Material => GroupBy::Material,
            Self::Face => GroupBy::Face,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Object => "object",
            Self::Material => "material",
            Self::Face => "face",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn sizes_have_units() {
        assert_eq!(bytes("800M"), Ok(800_000_000));
        assert_eq!(bytes("1.5 GiB"), Ok(3 << 29));
        assert_eq!(bytes("4g"), Ok(4_000_000_000));
        for wrong in ["", "4", "M", "4X", "-4G", "nan", "1e30"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
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
        assert_eq!(correction("tolerance"), Ok(Correction::Tolerance));
        assert!(correction("area").is_err_and(|e| e.contains("pixel")));
    }

    #[test]
    fn tolerances_are_shares_or_percentages() {
        for (text, share) in [
            ("1%", 0.01),
            ("0.01", 0.01),
            ("0.3 %", 0.003),
            ("1e-5", 1e-5),
            ("0.001%", 1e-5),
            ("0.00001%", 1e-7),
            ("1e-7", 1e-7),
            ("50%", 0.5),
        ] {
            let read = tolerance(text).expect(text).0;
            assert!((read - share).abs() <= 1e-12 * share, "{text}: {read}");
        }
        for wrong in [
            "0",
            "-1%",
            "0.000009%",
            "9e-8",
            "51%",
            "1",
            "5",
            "nan",
            "nan%",
            "inf",
            "%",
            "",
            "few",
        ] {
            assert!(tolerance(wrong).is_err(), "{wrong}");
        }
        assert!(tolerance("1").is_err_and(|error| error.contains("100 %")));
    }
}
