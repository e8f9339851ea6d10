//! Output of the program: text and JSON on standard output or in files, and the form of numbers.

use crate::args::{Report, Talk};
use crate::escape::{shown, shown_lines};
use crate::exit::{OutputClosed, hinted};
use crate::shell::word;
use crate::style;
use anyhow::{Context, Result, anyhow, bail};
use hemicube::diagnose::Place;
use hemicube::store::{self, DurableFile};
use hemicube_scene::is_unseen;
use hemicube_spatial::whole;
use serde::Serialize;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The version of every JSON report.
pub(crate) const SCHEMA: u32 = 1;

/// End of temporary names. The library that writes matrices removes such files after a killed run.
pub(crate) const TEMPORARY_SUFFIX: &str = ".hemicube-tmp";

/// Writes text to standard output, unseen characters escaped.
///
/// # Errors
/// [`OutputClosed`] when the reader has gone, which is no failure.
pub(crate) fn print(text: &str) -> Result<()> {
    print_raw(&shown_lines(text))
}

/// Writes JSON to standard output. JSON escapes half of the unseen characters; the other half is escaped here in its
/// way.
fn print_json(text: &str) -> Result<()> {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if is_unseen(c) && c != '\n' {
            // All of them are of two bytes in UTF-16 or less.
            shown.push_str(&format!("\\u{:04x}", u32::from(c)));
        } else {
            shown.push(c);
        }
    }
    print_raw(&shown)
}

/// Writes text with verdicts in its lines to standard output: these in colour, on a terminal.
///
/// # Errors
/// Like [`print`].
pub(crate) fn print_verdicts(text: &str) -> Result<()> {
    print_raw(&style::verdicts(&shown_lines(text)))
}

fn print_raw(text: &str) -> Result<()> {
    let mut stdout = style::stdout();
    stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush())
        .map_err(output_error)
}

/// An error of standard output; [`OutputClosed`] for a reader that has gone.
pub(crate) fn output_error(error: io::Error) -> anyhow::Error {
    if error.kind() == io::ErrorKind::BrokenPipe {
        anyhow::Error::new(OutputClosed)
    } else {
        anyhow::Error::new(error).context("standard output cannot be written")
    }
}

/// Refuses a path to nothing.
///
/// # Errors
/// When nothing is there, or it cannot be inspected.
pub(crate) fn require(path: &Path) -> Result<()> {
    match std::fs::metadata(path) {
        Ok(_) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => bail!("`{}` does not exist", path.display()),
        Err(error) => Err(error).with_context(|| format!("`{}` cannot be read", path.display())),
    }
}

/// Name of a scene's matrix, where none is given: `room.hemicube` of `scenes/room.obj` and of the folder `scenes/room`.
pub(crate) fn matrix_of(scene: &Path) -> PathBuf {
    let mut name = if scene.is_dir() {
        // `.` and `..` have no name of their own.
        let whole = scene.canonicalize();
        whole
            .as_deref()
            .unwrap_or(scene)
            .file_name()
            .unwrap_or_default()
            .to_owned()
    } else {
        scene.file_stem().unwrap_or_default().to_owned()
    };
    name.push(".hemicube");
    name.into()
}

/// Refuses what cannot be a matrix: nothing, or a file.
///
/// # Errors
/// When there is no directory.
pub(crate) fn require_matrix(path: &Path) -> Result<()> {
    require(path)?;
    if path.is_dir() {
        return Ok(());
    }
    let error = anyhow!("`{}` is a file, and a matrix is a directory", path.display());
    let scene = word(path);
    let step = match hemicube_scene::Format::from_path(path) {
        Some(_) => format!(
            "`hemicube compute {scene} -o {}` makes one of it",
            word(&matrix_of(path))
        ),
        None => "give the directory that `hemicube compute` wrote".to_owned(),
    };
    Err(hinted(error, step))
}

/// A JSON report on standard output.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JsonReport(());

impl JsonReport {
    /// The report of `--json`; `None` without the option.
    pub(crate) fn asked(arguments: &Report) -> Option<Self> {
        arguments.json.then_some(Self(()))
    }

    /// Prints the report.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn write(self, report: &impl Serialize) -> Result<()> {
        let mut text = serde_json::to_string_pretty(report).context("the report is no JSON")?;
        text.push('\n');
        print_json(&text)
    }
}

/// A file named only when complete, removed otherwise.
#[derive(Debug)]
pub(crate) struct PendingFile {
    path: PathBuf,
    file: DurableFile,
}

impl PendingFile {
    /// Opens a temporary file beside `path`.
    ///
    /// # Errors
    /// When there can be none.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            file: DurableFile::create(path).map_err(|error| match error {
                store::Error::Io { source, .. } => {
                    anyhow::Error::new(source).context(format!("`{}` cannot be written", path.display()))
                }
                error => error.into(),
            })?,
        })
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// When the disk is full, or the name cannot be given.
    pub(crate) fn commit(self) -> Result<()> {
        let cannot = || format!("`{}` cannot be written", self.path.display());
        self.file.commit().with_context(cannot)
    }
}

impl Write for PendingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A file that was read, by its bytes.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Input {
    pub(crate) path: String,
    pub(crate) blake3: String,
    pub(crate) bytes: u64,
}

impl Input {
    /// Reads the file at `path`, or the scene files of a folder, of which names and lengths are hashed, too.
    ///
    /// # Errors
    /// When one cannot be read.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        let is_folder = path.is_dir();
        let mut hasher = blake3::Hasher::new();
        let mut bytes = 0;
        for file in hemicube_scene::files(path)? {
            let cannot = || format!("`{}` cannot be read", file.display());
            let mut opened = hemicube_scene::open_regular(&file).with_context(cannot)?;
            if is_folder {
                hasher.update(file.file_name().unwrap_or_default().as_encoded_bytes());
                let length = opened.metadata().with_context(cannot)?.len();
                hasher.update(&[0]).update(&length.to_le_bytes());
            }
            bytes += io::copy(&mut opened, &mut hasher).with_context(cannot)?;
        }
        Ok(Self {
            path: path.display().to_string(),
            blake3: hasher.finalize().to_hex().to_string(),
            bytes,
        })
    }
}

/// The engine, in reports.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct BackendReport {
    pub(crate) name: String,
    pub(crate) version: String,
    pub(crate) device: String,
}

/// Least, average and most over the rows.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Spread {
    pub(crate) min: f64,
    pub(crate) mean: f64,
    pub(crate) max: f64,
}

/// Peak of the process's memory in bytes, where the system tells.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    memory_bytes("VmHWM:")
}

/// Resident memory of the process in bytes, where the system tells.
pub(crate) fn resident_memory_bytes() -> Option<u64> {
    memory_bytes("VmRSS:")
}

fn memory_bytes(line: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|other| other.strip_prefix(line))?;
    line.trim()
        .strip_suffix("kB")?
        .trim()
        .parse::<u64>()
        .ok()
        .map(|kib| kib * 1024)
}

/// Labels and values in two columns.
#[derive(Debug, Default)]
pub(crate) struct Listing(Vec<(String, String)>);

impl Listing {
    /// Adds a line.
    pub(crate) fn add(&mut self, label: &str, value: impl Into<String>) {
        self.0
            .push((shown(label).into_owned(), shown(&value.into()).into_owned()));
    }

    /// Labels and values, in order.
    pub(crate) fn lines(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(label, value)| (label.as_str(), value.as_str()))
    }

    /// The lines, values aligned.
    pub(crate) fn text(&self) -> String {
        let width = self.0.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
        self.0
            .iter()
            .map(|(label, value)| format!("{label:width$}  {value}\n"))
            .collect()
    }
}

/// A table with a line of headings.
pub(crate) fn table<const N: usize>(headings: [&str; N], rows: impl IntoIterator<Item = [String; N]>) -> String {
    table_of(&headings, rows)
}

/// Likewise with as many columns as there are headings.
pub(crate) fn table_of<R: IntoIterator<Item = String>>(headings: &[&str], rows: impl IntoIterator<Item = R>) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::NOTHING);
    table.set_header(headings);
    for row in rows {
        table.add_row(row.into_iter().map(|cell| shown(&cell).into_owned()));
    }
    let mut text: String = table.lines().map(|line| format!("{}\n", line.trim_end())).collect();
    if text.starts_with(' ') {
        text = text
            .lines()
            .map(|line| format!("{}\n", line.strip_prefix(' ').unwrap_or(line)))
            .collect();
    }
    text
}

/// Formats 1234567 as `1,234,567`.
pub(crate) fn count(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// `line 4`, `lines 4, 6 and 9`, `lines 1, 2, 3, 4, 5 and 20 more`.
pub(crate) fn lines(of: &[u64]) -> String {
    const SHOWN: usize = 5;
    let mut shown: Vec<String> = of.iter().take(SHOWN).map(u64::to_string).collect();
    if of.len() > SHOWN {
        shown.push(format!("{} more", count((of.len() - SHOWN) as u64)));
    }
    match shown.split_last() {
        Some((last, [])) => format!("line {last}"),
        Some((last, rest)) => format!("lines {} and {last}", rest.join(", ")),
        None => String::new(),
    }
}

/// `1 row`, `2,000 rows`.
pub(crate) fn counted(number: u64, what: &str) -> String {
    let plural = match what.strip_suffix("ch") {
        _ if number == 1 => what.to_owned(),
        Some(_) => format!("{what}es"),
        None => what
            .strip_suffix('y')
            .map_or_else(|| format!("{what}s"), |stem| format!("{stem}ies")),
    };
    format!("{} {plural}", count(number))
}

/// [`percent`] with three digits however small the share is.
pub(crate) fn small_percent(fraction: f64) -> String {
    if fraction > 0.0 && fraction < 1e-4 {
        format!("{} %", figures(100.0 * fraction))
    } else {
        percent(fraction)
    }
}

/// Formats 0.1234 as `12.3 %`. A share above 0 never reads 0, and one below 1 never reads 100.
pub(crate) fn percent(fraction: f64) -> String {
    let percent = 100.0 * fraction;
    if percent > 0.0 && percent < 0.01 {
        "< 0.01 %".to_owned()
    } else if percent > 99.99 && percent < 100.0 {
        "> 99.99 %".to_owned()
    } else if percent == 0.0 || percent == 100.0 {
        format!("{percent:.0} %")
    } else if !(1.0..=99.0).contains(&percent) {
        format!("{percent:.2} %")
    } else {
        format!("{percent:.1} %")
    }
}

/// Formats bytes in the largest unit below them.
pub(crate) fn size(bytes: u64) -> String {
    let mut value = bytes as f64;
    let mut unit = "B";
    for larger in ["kB", "MB", "GB", "TB", "PB"] {
        if value < 999.5 {
            break;
        }
        value /= 1000.0;
        unit = larger;
    }
    if unit == "B" || value >= 99.5 {
        format!("{value:.0} {unit}")
    } else {
        format!("{} {unit}", figures(value))
    }
}

/// Formats seconds for people.
pub(crate) fn duration(seconds: f64) -> String {
    if seconds < 59.95 {
        return format!("{} s", figures(seconds));
    }
    let minutes = seconds / 60.0;
    if minutes < 59.95 {
        return format!("{} min", figures(minutes));
    }
    let hours = minutes / 60.0;
    if hours < 47.95 {
        format!("{} h", figures(hours))
    } else {
        format!("{} days", figures(hours / 24.0))
    }
}

/// Formats three significant figures, without an exponent if readable.
pub(crate) fn figures(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 {
        "0".to_owned()
    } else if !(1e-3..1e6).contains(&magnitude) {
        format!("{value:.2e}")
    } else if magnitude < 0.1 {
        format!("{value:.4}")
    } else if magnitude < 9.995 {
        format!("{value:.2}")
    } else if magnitude < 99.95 {
        format!("{value:.1}")
    } else {
        let rounded = count(whole::to_u64(magnitude.round()));
        if value < 0.0 { format!("-{rounded}") } else { rounded }
    }
}

/// An estimate: three figures of a count.
pub(crate) fn about(value: f64) -> String {
    let value = value.max(0.0);
    let unit = if value < 1000.0 {
        1.0
    } else {
        10f64.powf(value.log10().floor() - 2.0)
    };
    count(whole::to_u64(((value / unit).round() * unit).round()))
}

/// The warning of rows that still changed at the last refinement.
pub(crate) fn unsettled(rows: u64, tolerance: f64) -> String {
    format!(
        "{} still changed by more than {} with the finest hemicubes: `change` has what the last step changed, and an \
         error may be greater; a larger `--tolerance`, or smaller patches",
        counted(rows, "row"),
        percent(tolerance)
    )
}

/// Warns of a file's points that are not in the open, by place, with their lines. `places` are of all points or of
/// these alone.
pub(crate) fn tell_of_places(path: &Path, points: usize, places: impl Iterator<Item = (Place, u64)>, talk: Talk) {
    let places: Vec<(Place, u64)> = places.collect();
    for (place, what, next) in [
        (
            Place::InSolid,
            "in solids, surrounded by backs of one-sided surfaces",
            "move them out, or turn the surfaces round (`--flip`) if it is an inside that they are in",
        ),
        (
            Place::BelowGround,
            "below the ground, with its back above them",
            "raise them above it, and look whether `--up` is right",
        ),
        (
            Place::BehindSheet,
            "behind surfaces, with backs in more than half of their view",
            "move them to the other side, turn their normals, or `--two-sided on` if the surfaces are sheets",
        ),
        (
            Place::FarOff,
            "more than ten times the scene's size away from it",
            "give them in the scene's unit and from its origin (`inspect` shows its box)",
        ),
    ] {
        let there: Vec<u64> = places
            .iter()
            .filter(|(at, _)| *at == place)
            .map(|&(_, line)| line)
            .collect();
        if !there.is_empty() {
            talk.warn(&format!(
                "{} of {} in `{}` {} {what}: {}; {next}",
                count(there.len() as u64),
                counted(points as u64, "point"),
                path.display(),
                if there.len() == 1 { "is" } else { "are" },
                lines(&there)
            ));
        }
    }
}

/// Formats five significant figures, without an exponent if readable.
pub(crate) fn five(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 || !magnitude.is_finite() {
        return if value == 0.0 {
            "0".to_owned()
        } else {
            value.to_string()
        };
    }
    #[allow(clippy::cast_possible_truncation, reason = "within ±308")]
    let exponent = magnitude.log10().floor() as i32;
    match 4 - exponent {
        decimals @ 0..=8 => format!("{value:.*}", usize::try_from(decimals).unwrap_or(0)),
        _ => format!("{value:.4e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_as_people_read_them() {
        assert_eq!([0, 999, 1000, 1_234_567].map(count), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!(counted(1, "entry"), "1 entry");
        assert_eq!(counted(2000, "entry"), "2,000 entries");
        assert_eq!(counted(3, "patch"), "3 patches");
        assert_eq!(
            [0.0, 1e-9, 0.0123, 0.5, 0.9999999, 1.0].map(percent),
            ["0 %", "< 0.01 %", "1.2 %", "50.0 %", "> 99.99 %", "100 %"]
        );
        assert_eq!(
            [0, 999, 1000, 185_000_000].map(size),
            ["0 B", "999 B", "1.00 kB", "185 MB"]
        );
        assert_eq!(
            [0.0, 4.5, 90.0, 7200.0, 1e6].map(duration),
            ["0 s", "4.50 s", "1.50 min", "2.00 h", "11.6 days"]
        );
        assert_eq!(
            [3.1e-8, 0.0123, 1234.6, 2e9].map(figures),
            ["3.10e-8", "0.0123", "1,235", "2.00e9"]
        );
    }

    #[test]
    fn estimates_are_round() {
        assert_eq!(
            [0.0, 12.4, 663_382.0, 35_049_000.0].map(about),
            ["0", "12", "663,000", "35,000,000"]
        );
    }

    #[test]
    fn tables_are_aligned_and_have_no_trailing_blanks() {
        let text = table(["name", "n"], [["a".into(), "1".into()], ["long".into(), "22".into()]]);
        assert_eq!(text, "name  n\na     1\nlong  22\n");
    }

    #[test]
    fn a_name_makes_no_line_of_a_listing_or_table() {
        let name = "a\u{7}\nerror: no\u{9b}2J";
        let mut list = Listing::default();
        list.add("label", name);
        assert_eq!(list.text().lines().count(), 1);
        assert_eq!(table(["name"], [[name.to_owned()]]).lines().count(), 2);
    }
}
