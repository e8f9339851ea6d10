//! The scoreboard: error and cost of each scene at each accuracy level, held against reference rows and against the
//! committed board, `tests/golden/board.csv`.
//!
//! What is held, with the noise that it allows for:
//!
//! | figure | is worse when |
//! |---|---|
//! | error | error² has grown by more than three standard deviations (`spread`) of both |
//! | sums, escaped, the worst entry | more than a quarter and three standard errors of the reference above the committed |
//! | rows that do not say how far off their sum or *escaped* is | more than committed |
//! | steps | more than 2 % above the committed |
//! | between tolerances | a lower one has a larger error (three standard deviations), expects a larger, or takes 1 % fewer steps |
//! | between other levels | one takes 2 % more steps than another *and* has a larger error |
//!
//! `spread` has two parts: the reference's own noise, Σ (4 d² σ² + 2 σ⁴) over entries, and what another draw of the same
//! estimators gives, 2 Σ d⁴: the squares of normal errors. Entries that err together, as by one hemicube's centre, have
//! more. Times are on the board and are not held.

use crate::golden::scenes::Ready;
use crate::golden::{Golden, ROWS, plan};
use crate::rows::{Rung, settled};
use crate::scenes::workspace;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Counters, Culling, RenderSettings};
use hemicube::driver::compute::{Execution, compute};
use hemicube::reference::ReferenceRow;
use hemicube::store::{Part, RowErrors};
use hemicube_backend_cpu::CpuBackend;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::PathBuf;

/// An accuracy level of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// Sums of pixels.
    Pixel,
    /// A tolerance, relative: 2 % is the default.
    Tolerance(f64),
}

impl Level {
    /// All levels, in the order of the board.
    pub const ALL: [Self; 5] = [
        Self::Pixel,
        Self::Tolerance(2e-2),
        Self::Tolerance(1e-2),
        Self::Tolerance(3e-3),
        Self::Tolerance(1e-3),
    ];

    /// Its name on the board.
    pub fn name(self) -> String {
        match self {
            Self::Pixel => "pixel".to_owned(),
            Self::Tolerance(tolerance) => hemicube::driver::level::percentage(tolerance),
        }
    }

    /// The level of a name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.name() == name)
    }

    fn rung(self, ready: &Ready) -> Rung {
        match self {
            Self::Pixel => Rung::PIXEL,
            Self::Tolerance(tolerance) => {
                let settled = settled(&ready.model, tolerance, &mut CpuBackend::new()).expect("a backend");
                Rung {
                    correction: Correction::Tolerance(settled.refinement),
                    resolution: settled.resolution,
                }
            }
        }
    }
}

/// Steps of rendering, each of about a nanosecond: of a hemicube, of its pixel, of a triangle drawn into a face, of a
/// node. `scoreboard rendering` prints what they stand for; a fifth more or less of a row of one hemicube either way.
/// Without them a level that renders more would seem as cheap as one that does not.
const STEPS_A_HEMICUBE: f64 = 20_000.0;
const STEPS_A_PIXEL: f64 = 0.3;
const STEPS_A_TRIANGLE: f64 = 75.0;
const STEPS_A_NODE: f64 = 20.0;

/// Rendering in steps, from what the backend counts.
pub fn steps_of_rendering(counters: &Counters, resolution: u32) -> f64 {
    let of_hemicube = STEPS_A_HEMICUBE + STEPS_A_PIXEL * 3.0 * f64::from(resolution).powi(2);
    counters.hemicubes as f64 * of_hemicube
        + STEPS_A_TRIANGLE * counters.triangles_drawn as f64
        + STEPS_A_NODE * counters.nodes_tested as f64
}

/// One scene at one level.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// The scene's name.
    pub scene: String,
    /// The level's name.
    pub level: String,
    /// Relative Frobenius error over the sampled rows, the reference's noise taken off.
    pub error: f64,
    /// Standard deviation of `error`².
    pub spread: f64,
    /// The reference's own relative Frobenius error.
    pub noise: f64,
    /// The rows' expected relative Frobenius error; NaN at levels that have none.
    pub expected: f64,
    /// |ΣF − reference|, the 95th percentile over the rows.
    pub sums_95: f64,
    /// The largest.
    pub sums_worst: f64,
    /// Standard error of the reference's ΣF, the 95th percentile.
    pub sums_noise: f64,
    /// Rows whose ΣF is off by more than the tolerance (1 % at other levels) and three standard errors.
    pub sums_beyond: f64,
    /// |escaped − reference|, the 95th percentile over the rows.
    pub escaped_95: f64,
    /// The largest.
    pub escaped_worst: f64,
    /// Standard error of the reference's escaped, the 95th percentile.
    pub escaped_noise: f64,
    /// Rows whose escaped is off by more than the tolerance (1 % at other levels) and three standard errors.
    pub escaped_beyond: f64,
    /// Root mean square of ΣF − reference over the rows, the reference's noise taken off.
    pub sums_rms: f64,
    /// Root mean square of the rows' standard errors of ΣF; NaN at levels that have none.
    pub sums_expected: f64,
    /// Rows whose ΣF is off by more than the tolerance, and by more than three standard errors, the reference's
    /// added: they say nothing of it.
    pub sums_unsaid: f64,
    /// Root mean square of escaped − reference over the rows, the reference's noise taken off.
    pub escaped_rms: f64,
    /// Root mean square of the rows' standard errors of escaped; NaN at levels that have none.
    pub escaped_expected: f64,
    /// Rows whose escaped is off by more than the tolerance, and by more than three standard errors, the reference's
    /// added: they say nothing of it.
    pub escaped_unsaid: f64,
    /// The largest |F − reference|, and three standard errors of the reference taken off.
    pub worst_entry: f64,
    /// Counted steps a row, rendering in them.
    pub steps: f64,
    /// Milliseconds of processor time a row; NaN where they were not measured.
    pub milliseconds: f64,
    /// Milliseconds of processor time to settle a tolerance.
    pub settling: f64,
}

const FIELDS: [&str; 24] = [
    "scene",
    "level",
    "error",
    "spread",
    "noise",
    "expected",
    "sums_95",
    "sums_worst",
    "sums_noise",
    "sums_beyond",
    "escaped_95",
    "escaped_worst",
    "escaped_noise",
    "escaped_beyond",
    "sums_rms",
    "sums_expected",
    "sums_unsaid",
    "escaped_rms",
    "escaped_expected",
    "escaped_unsaid",
    "worst_entry",
    "steps",
    "ms_a_row",
    "settling_ms",
];

impl Cell {
    fn numbers(&self) -> [f64; 22] {
        [
            self.error,
            self.spread,
            self.noise,
            self.expected,
            self.sums_95,
            self.sums_worst,
            self.sums_noise,
            self.sums_beyond,
            self.escaped_95,
            self.escaped_worst,
            self.escaped_noise,
            self.escaped_beyond,
            self.sums_rms,
            self.sums_expected,
            self.sums_unsaid,
            self.escaped_rms,
            self.escaped_expected,
            self.escaped_unsaid,
            self.worst_entry,
            self.steps,
            self.milliseconds,
            self.settling,
        ]
    }

    /// Four digits, as the board's file has them.
    #[must_use]
    pub fn rounded(&self) -> Self {
        let text = self.line();
        Self::parse(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
    }

    fn line(&self) -> String {
        let mut line = format!("{},{}", self.scene, self.level);
        for number in self.numbers() {
            if number.is_nan() {
                line.push_str(",-");
            } else {
                write!(line, ",{number:.3e}").expect("a string");
            }
        }
        line
    }

    fn parse(line: &str) -> Result<Self, String> {
        let fields: Vec<&str> = line.split(',').collect();
        let &[scene, level, ref rest @ ..] = fields.as_slice() else {
            return Err(format!("`{line}` is no line of a board"));
        };
        let number = |text: &&str| match *text {
            "-" => Ok(f64::NAN),
            text => text
                .parse::<f64>()
                .map_err(|_| format!("`{text}` is no number in `{line}`")),
        };
        let numbers: Vec<f64> = rest.iter().map(number).collect::<Result<_, _>>()?;
        let [
            error,
            spread,
            noise,
            expected,
            sums_95,
            sums_worst,
            sums_noise,
            sums_beyond,
            escaped_95,
            escaped_worst,
            escaped_noise,
            escaped_beyond,
            sums_rms,
            sums_expected,
            sums_unsaid,
            escaped_rms,
            escaped_expected,
            escaped_unsaid,
            worst_entry,
            steps,
            milliseconds,
            settling,
        ] = numbers
            .try_into()
            .map_err(|_| format!("`{line}` has another number of fields"))?;
        Level::of(level).ok_or_else(|| format!("`{level}` is no level"))?;
        Ok(Self {
            scene: scene.to_owned(),
            level: level.to_owned(),
            error,
            spread,
            noise,
            expected,
            sums_95,
            sums_worst,
            sums_noise,
            sums_beyond,
            escaped_95,
            escaped_worst,
            escaped_noise,
            escaped_beyond,
            sums_rms,
            sums_expected,
            sums_unsaid,
            escaped_rms,
            escaped_expected,
            escaped_unsaid,
            worst_entry,
            steps,
            milliseconds,
            settling,
        })
    }
}

/// The board as a file.
pub fn to_csv(cells: &[Cell]) -> String {
    let mut text = FIELDS.join(",") + "\n";
    for cell in cells {
        text.push_str(&cell.line());
        text.push('\n');
    }
    text
}

/// The board of a file.
///
/// # Errors
/// What is wrong with it.
pub fn from_csv(text: &str) -> Result<Vec<Cell>, String> {
    let mut lines = text.lines();
    if lines.next() != Some(&FIELDS.join(",")) {
        return Err("the board has other columns: make it anew by `scoreboard board --bless`".to_owned());
    }
    lines.map(Cell::parse).collect()
}

/// The file of the committed board.
fn file() -> PathBuf {
    workspace().join("tests/golden/board.csv")
}

/// The committed board.
///
/// # Errors
/// When there is none, or it is malformed.
pub fn committed() -> Result<Vec<Cell>, String> {
    let text = std::fs::read_to_string(file()).map_err(|error| format!("{}: {error}", file().display()))?;
    from_csv(&text)
}

/// Names of the failures of [`not_monotone`] that are known, by `tests/golden/expected-failures.txt`: a line each, `#`
/// begins a comment.
///
/// # Errors
/// When the file cannot be read.
pub fn expected_failures() -> Result<BTreeSet<String>, String> {
    let path = workspace().join("tests/golden/expected-failures.txt");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let lines = text
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default().trim());
    Ok(lines.filter(|line| !line.is_empty()).map(ToOwned::to_owned).collect())
}

const BEGIN: &str = "<!-- the board: written by `scoreboard board --bless` -->\n";
const END: &str = "<!-- end of the board -->\n";

/// The page with the tables of `cells` in it.
///
/// # Errors
/// When the page lacks the lines between which they stand.
pub fn page_with(page: &str, cells: &[Cell]) -> Result<String, String> {
    let lacks = || "docs/dev/scoreboard.md lacks the lines that begin and end the board".to_owned();
    let (before, rest) = page.split_once(BEGIN).ok_or_else(lacks)?;
    let (_, after) = rest.split_once(END).ok_or_else(lacks)?;
    let (summary, table) = (summary(cells), table(cells, &[]));
    Ok(format!("{before}{BEGIN}\n{summary}\n{table}\n{END}{after}"))
}

/// The page of the board.
pub fn page() -> PathBuf {
    workspace().join("docs/dev/scoreboard.md")
}

/// Commits a board: its file, and the tables of its page.
///
/// # Errors
/// When one cannot be written.
pub fn commit(cells: &[Cell]) -> Result<(), Box<dyn std::error::Error>> {
    std::fs::write(file(), to_csv(cells))?;
    std::fs::write(page(), page_with(&std::fs::read_to_string(page())?, cells)?)?;
    Ok(())
}

/// Processor seconds of this process, threads that have ended included; NaN where none are told.
pub fn processor_seconds() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    f64::NAN
}

/// Seconds that rows are computed for their time to be told.
const ENOUGH_SECONDS: f64 = 0.1;

/// A row as it was computed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// Columns and form factors.
    pub entries: Vec<(u32, f64)>,
    /// Share that meets nothing.
    pub escaped: f64,
    /// Standard errors; NaN at levels that have none.
    pub errors: RowErrors,
}

/// Computes the rows of `golden` at a level and compares them. With `timed`, again until their time is told.
///
/// # Panics
/// When the backend breaks its contract.
pub fn measure(ready: &Ready, golden: &Golden, level: Level, timed: bool) -> Cell {
    let began = processor_seconds();
    let rung = level.rung(ready);
    let settling = 1e3 * (processor_seconds() - began);
    let plan = plan(&ready.model).with_correction(rung.correction);
    let settings = RenderSettings {
        resolution: rung.resolution,
        culling: Culling::On,
        covered: false,
    };
    let execution = Execution {
        threads: 1,
        ..Execution::default()
    };
    let mut parts: Vec<Part> = Vec::new();
    let mut round = || {
        parts.clear();
        let backend = Box::new(CpuBackend::new());
        compute(
            &ready.model,
            &plan,
            settings,
            backend,
            execution,
            &mut parts,
            &mut |_| {},
        )
        .expect("rows")
    };
    // What is built once for a scene belongs to no row.
    let summary = round();
    let mut milliseconds = f64::NAN;
    if timed {
        let (began, mut rounds) = (processor_seconds(), 0.0);
        while processor_seconds() - began < ENOUGH_SECONDS {
            round();
            rounds += 1.0;
        }
        milliseconds = 1e3 * (processor_seconds() - began) / (rounds * plan.rows.len() as f64);
    }
    let mut found = BTreeMap::new();
    for part in &parts {
        for (place, &row) in part.rows.iter().enumerate() {
            let (columns, values) = part.row(place);
            let entries = columns.iter().map(|&c| c.cast_unsigned()).zip(values.iter()).collect();
            let (escaped, errors) = (part.shares[place].escaped, part.errors[place]);
            found.insert(
                row,
                Found {
                    entries,
                    escaped,
                    errors,
                },
            );
        }
    }
    let steps = summary.steps as f64 + steps_of_rendering(&summary.counters, rung.resolution);
    let tolerance = if let Level::Tolerance(tolerance) = level {
        tolerance
    } else {
        1e-2
    };
    Cell {
        scene: ready.name.to_owned(),
        level: level.name(),
        steps: steps / plan.rows.len().max(1) as f64,
        milliseconds,
        settling: if settling > 0.05 { settling } else { 0.0 },
        ..errors(&golden.rows, &found, tolerance)
    }
}

/// How far a row's sum or share is off.
#[derive(Clone, Copy, Debug)]
struct Off {
    off: f64,
    /// The reference's standard error.
    noise: f64,
    /// The row's own; NaN where it has none.
    expected: f64,
}

impl Off {
    fn new(difference: f64, noise: f64, expected: f32) -> Self {
        Self {
            off: difference.abs(),
            noise,
            expected: expected.into(),
        }
    }
}

fn mean(values: &[Off], of: impl Fn(&Off) -> f64) -> f64 {
    values.iter().map(of).sum::<f64>() / values.len().max(1) as f64
}

fn quantile(values: &[Off], of: impl Fn(&Off) -> f64, share: f64) -> f64 {
    let mut values: Vec<f64> = values.iter().map(of).collect();
    values.sort_unstable_by(f64::total_cmp);
    let rank = (0..values.len()).find(|&rank| (rank + 1) as f64 >= share * values.len() as f64);
    rank.and_then(|rank| values.get(rank)).copied().unwrap_or(0.0)
}

/// The errors of rows, by emitter; a row that is missing has no entry and no share.
pub fn errors(reference: &[ReferenceRow], found: &BTreeMap<u32, Found>, tolerance: f64) -> Cell {
    let none = Found::default();
    let (mut difference, mut noise, mut norm, mut variance, mut expected) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut worst_entry = 0.0;
    let (mut sums, mut escaped) = (Vec::new(), Vec::new());
    for row in reference {
        let own = found.get(&row.emitter).unwrap_or(&none);
        let mut entries: BTreeMap<u32, (f64, f64, f64)> = BTreeMap::new();
        for ((&column, &value), &error) in row.columns.iter().zip(&row.values).zip(&row.errors) {
            entries.insert(column, (0.0, value, error));
        }
        for &(column, value) in &own.entries {
            entries.entry(column).or_default().0 += value;
        }
        for &(a, b, error) in entries.values() {
            let d = a - b;
            difference += d * d;
            variance += 4.0 * (d * error).powi(2) + 2.0 * error.powi(4) + 2.0 * d.powi(4);
            let beyond = d.abs() - 3.0 * error;
            // NaN must show.
            if exceeds(beyond, worst_entry) {
                worst_entry = beyond;
            }
        }
        variance += 2.0 * row.missed_squared.powi(2);
        noise += row.squared_error();
        norm += row.squared_norm();
        expected += f64::from(own.errors.norm).powi(2);
        let sum: f64 = own.entries.iter().map(|entry| entry.1).sum();
        sums.push(Off::new(sum - row.sum(), row.sum_noise(), own.errors.sum));
        escaped.push(Off::new(
            own.escaped - row.escaped,
            row.error_of_shares,
            own.errors.escaped,
        ));
    }
    let relative = |squared: f64| if norm > 0.0 { squared / norm } else { squared };
    let count = |values: &[Off], is: &dyn Fn(&Off) -> bool| values.iter().filter(|off| is(off)).count() as f64;
    // NaN is within nothing.
    let beyond = |values: &[Off]| count(values, &|off| is_beyond(off.off, tolerance + 3.0 * off.noise));
    let unsaid = |values: &[Off]| {
        count(values, &|off| {
            is_beyond(off.off, tolerance.max(3.0 * off.expected) + 3.0 * off.noise)
        })
    };
    let rms = |values: &[Off]| {
        let squared = mean(values, |off| off.off.powi(2)) - mean(values, |off| off.noise.powi(2));
        // NaN must show.
        if squared < 0.0 { 0.0 } else { squared.sqrt() }
    };
    let expected_rms = |values: &[Off]| mean(values, |off| off.expected.powi(2)).sqrt();
    Cell {
        scene: String::new(),
        level: String::new(),
        error: {
            let squared = relative(difference - noise);
            if squared < 0.0 { 0.0 } else { squared.sqrt() }
        },
        spread: relative(variance.sqrt()),
        noise: relative(noise).sqrt(),
        expected: relative(expected).sqrt(),
        sums_95: quantile(&sums, |off| off.off, 0.95),
        sums_worst: quantile(&sums, |off| off.off, 1.0),
        sums_noise: quantile(&sums, |off| off.noise, 0.95),
        sums_beyond: beyond(&sums),
        escaped_95: quantile(&escaped, |off| off.off, 0.95),
        escaped_worst: quantile(&escaped, |off| off.off, 1.0),
        escaped_noise: quantile(&escaped, |off| off.noise, 0.95),
        escaped_beyond: beyond(&escaped),
        sums_rms: rms(&sums),
        sums_expected: expected_rms(&sums),
        sums_unsaid: unsaid(&sums),
        escaped_rms: rms(&escaped),
        escaped_expected: expected_rms(&escaped),
        escaped_unsaid: unsaid(&escaped),
        worst_entry,
        steps: 0.0,
        milliseconds: f64::NAN,
        settling: 0.0,
    }
}

/// Standard deviations, and standard errors of the reference, by which a figure may be worse.
const DEVIATIONS: f64 = 3.0;
/// Share by which a percentile of 64 rows, or a worst of all, may be worse: they scatter by some tenth. A choice: less
/// calls chance a fault, more lets a fault of a few rows pass.
const SCATTER: f64 = 0.25;
/// Share by which steps may grow. A choice: they are exact, but a change for other reasons moves a few rows.
const STEPS: f64 = 0.02;
/// Share by which a lower tolerance may take fewer steps.
const FEWER: f64 = 0.01;

/// NaN is within nothing, and once it is the worst, it stays so.
fn exceeds(value: f64, limit: f64) -> bool {
    value > limit || value.is_nan()
}

/// What is worse in `new` than in `old`, in words.
pub fn worse(new: &Cell, old: &Cell) -> Vec<String> {
    let mut found = Vec::new();
    let place = format!("{} {}", new.scene, new.level);
    let grown = new.error.powi(2) - old.error.powi(2);
    if exceeds(grown, DEVIATIONS * new.spread.hypot(old.spread)) {
        found.push(format!("{place}: error {:.3e}, committed {:.3e}", new.error, old.error));
    }
    for (figure, new, old, noise) in [
        ("95 % of sums", new.sums_95, old.sums_95, old.sums_noise),
        ("worst sum", new.sums_worst, old.sums_worst, old.sums_noise),
        ("95 % of escaped", new.escaped_95, old.escaped_95, old.escaped_noise),
        ("worst escaped", new.escaped_worst, old.escaped_worst, old.escaped_noise),
        ("worst entry", new.worst_entry, old.worst_entry, 0.0),
    ] {
        // Rows that were exact stay so to a millionth.
        if exceeds(new, (1.0 + SCATTER) * old + DEVIATIONS * noise + 1e-6) {
            found.push(format!("{place}: {figure} {new:.3e}, committed {old:.3e}"));
        }
    }
    for (figure, new, old) in [
        ("sums", new.sums_unsaid, old.sums_unsaid),
        ("escaped", new.escaped_unsaid, old.escaped_unsaid),
    ] {
        if exceeds(new, old) {
            found.push(format!(
                "{place}: {new:.0} rows do not say how far off their {figure} are, committed {old:.0}"
            ));
        }
    }
    if exceeds(new.steps, (1.0 + STEPS) * old.steps) {
        found.push(format!(
            "{place}: {:.0} steps a row, committed {:.0}",
            new.steps, old.steps
        ));
    }
    found
}

/// Where more is asked for and less is had: names of failures, each with its figures.
pub fn not_monotone(cells: &[Cell]) -> BTreeMap<String, String> {
    let mut failures = BTreeMap::new();
    let scenes: BTreeSet<&str> = cells.iter().map(|cell| cell.scene.as_str()).collect();
    let is_more_exact = |a: &Cell, b: &Cell| b.error.powi(2) - a.error.powi(2) > DEVIATIONS * a.spread.hypot(b.spread);
    for scene in scenes {
        let tolerances: Vec<&Cell> = cells
            .iter()
            .filter(|cell| cell.scene == scene)
            .filter(|cell| matches!(Level::of(&cell.level), Some(Level::Tolerance(_))))
            .collect();
        for pair in tolerances.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let mut fail = |what: &str, from: f64, to: f64| {
                let name = format!("{scene}: from {} to {}, {what}", a.level, b.level);
                failures.insert(name, format!("{from:.3e} to {to:.3e}"));
            };
            if is_more_exact(a, b) {
                fail("the error rises", a.error, b.error);
            }
            if b.expected > a.expected {
                fail("the expected error rises", a.expected, b.expected);
            }
            if b.steps < (1.0 - FEWER) * a.steps {
                fail("the cost falls", a.steps, b.steps);
            }
        }
    }
    failures
}

/// The cells to compute anew within `budget` milliseconds by the committed times: the cheapest ones, in the board's
/// order.
pub fn within_budget(cells: &[Cell], budget: f64) -> Vec<&Cell> {
    let cost = |cell: &Cell| {
        cell.settling
            + f64::from(ROWS)
                * if cell.milliseconds.is_nan() {
                    0.0
                } else {
                    cell.milliseconds
                }
    };
    let mut order: Vec<&Cell> = cells.iter().collect();
    order.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    let mut left = budget;
    let chosen: Vec<*const Cell> = order
        .into_iter()
        .take_while(|cell| {
            left -= cost(cell);
            left >= 0.0
        })
        .map(std::ptr::from_ref)
        .collect();
    cells
        .iter()
        .filter(|&cell| chosen.contains(&std::ptr::from_ref(cell)))
        .collect()
}

/// A figure, and the committed one where it is another.
fn beside(new: f64, old: Option<f64>, show: impl Fn(f64) -> String) -> String {
    let text = show(new);
    match old.map(show) {
        Some(old) if old != text => format!("{text} ({old})"),
        _ => text,
    }
}

/// Expected over measured; NaN for an error within this noise of the reference.
fn ratio_of(expected: f64, error: f64, noise: f64) -> f64 {
    if error > noise { expected / error } else { f64::NAN }
}

/// The board as a table, beside the committed one where figures differ.
pub fn table(cells: &[Cell], committed: &[Cell]) -> String {
    let mut text = String::from(
        "| scene | level | error % | expected ÷ error | ΣF: 95 %, worst, expected ÷ error | escaped: 95 %, worst, expected ÷ error | worst entry | steps a row | ms a row | settling, ms |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    let percent = |x: f64| format!("{:.3}", 100.0 * x);
    for cell in cells {
        let old = committed
            .iter()
            .find(|old| old.scene == cell.scene && old.level == cell.level);
        let of = |get: fn(&Cell) -> f64, show: &dyn Fn(f64) -> String| beside(get(cell), old.map(get), show);
        let ratio = |x: f64| {
            if x.is_nan() {
                "–".to_owned()
            } else {
                format!("{x:.2}")
            }
        };
        // An error that the reference's noise hides has no ratio.
        let calibration = |cell: &Cell| ratio_of(cell.expected, cell.error, 0.5 * cell.noise);
        let kilo = |x: f64| format!("{:.1} k", x / 1e3);
        let plain = |x: f64| {
            if x.is_nan() {
                "–".to_owned()
            } else {
                format!("{x:.2}")
            }
        };
        let whole = |x: f64| format!("{x:.0}");
        let of_sums = |cell: &Cell| ratio_of(cell.sums_expected, cell.sums_rms, cell.sums_noise);
        let of_escaped = |cell: &Cell| ratio_of(cell.escaped_expected, cell.escaped_rms, cell.escaped_noise);
        let cells = [
            of(|c| c.error, &percent),
            beside(calibration(cell), old.map(calibration), ratio),
            format!(
                "{}, {}, {}",
                of(|c| c.sums_95, &percent),
                of(|c| c.sums_worst, &percent),
                beside(of_sums(cell), old.map(of_sums), ratio)
            ),
            format!(
                "{}, {}, {}",
                of(|c| c.escaped_95, &percent),
                of(|c| c.escaped_worst, &percent),
                beside(of_escaped(cell), old.map(of_escaped), ratio)
            ),
            of(|c| c.worst_entry, &|x| format!("{x:.1e}")),
            of(|c| c.steps, &kilo),
            of(|c| c.milliseconds, &plain),
            of(|c| c.settling, &whole),
        ];
        writeln!(text, "| {} | {} | {} |", cell.scene, cell.level, cells.join(" | ")).expect("a string");
    }
    text
}

/// Figures of the whole board, a line a level: rows beyond the tolerance, calibration, cost as geometric means.
pub fn summary(cells: &[Cell]) -> String {
    let rows = f64::from(ROWS);
    let mut text = String::from(
        "| level | scenes | error ≤ T in | ΣF beyond T, rows | escaped beyond T, rows | expected ÷ error, median | of ΣF, unsaid rows | of escaped, unsaid rows | steps a row | ms a row | ms a row with settling |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for level in Level::ALL {
        let of: Vec<&Cell> = cells.iter().filter(|cell| cell.level == level.name()).collect();
        if of.is_empty() {
            continue;
        }
        let mean = |get: &dyn Fn(&Cell) -> f64| {
            let sum: f64 = of.iter().map(|cell| get(cell).ln()).sum();
            (sum / of.len() as f64).exp()
        };
        let total = |get: fn(&Cell) -> f64| of.iter().map(|cell| get(cell)).sum::<f64>();
        let tolerance = if let Level::Tolerance(tolerance) = level {
            tolerance
        } else {
            1e-2
        };
        let kept = of
            .iter()
            .filter(|cell| cell.error.powi(2) - 2.0 * cell.spread <= tolerance.powi(2))
            .count();
        let median = |ratio: &dyn Fn(&Cell) -> f64| {
            let mut ratios: Vec<f64> = of
                .iter()
                .map(|cell| ratio(cell))
                .filter(|ratio| !ratio.is_nan())
                .collect();
            ratios.sort_unstable_by(f64::total_cmp);
            ratios
                .get(ratios.len() / 2)
                .map_or("–".to_owned(), |ratio| format!("{ratio:.2}"))
        };
        let calibration = [
            median(&|cell| ratio_of(cell.expected, cell.error, 0.5 * cell.noise)),
            median(&|cell| ratio_of(cell.sums_expected, cell.sums_rms, cell.sums_noise)),
            median(&|cell| ratio_of(cell.escaped_expected, cell.escaped_rms, cell.escaped_noise)),
        ];
        let unsaid = |get: fn(&Cell) -> f64| {
            if level == Level::Pixel {
                "–".to_owned()
            } else {
                format!("{:.0}", total(get))
            }
        };
        let all = rows * of.len() as f64;
        writeln!(
            text,
            "| {} | {} | {kept} | {:.0} of {all} | {:.0} of {all} | {} | {}, {} | {}, {} | {:.1} k | {:.3} | {:.3} |",
            level.name(),
            of.len(),
            total(|cell| cell.sums_beyond),
            total(|cell| cell.escaped_beyond),
            calibration[0],
            calibration[1],
            unsaid(|cell| cell.sums_unsaid),
            calibration[2],
            unsaid(|cell| cell.escaped_unsaid),
            mean(&|cell| cell.steps) / 1e3,
            mean(&|cell| cell.milliseconds),
            mean(&|cell| cell.milliseconds + cell.settling / rows),
        )
        .expect("a string");
    }
    text
}

/// Returns whether an error is above a bound; one that is no number is.
fn is_beyond(error: f64, bound: f64) -> bool {
    error.partial_cmp(&bound).is_none_or(std::cmp::Ordering::is_gt)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(level: &str, error: f64, steps: f64) -> Cell {
        Cell {
            scene: "some".to_owned(),
            level: level.to_owned(),
            error,
            spread: 1e-7,
            noise: 5e-4,
            expected: error,
            sums_95: 2e-3,
            sums_worst: 4e-3,
            sums_noise: 1e-4,
            sums_beyond: 0.0,
            escaped_95: 1e-3,
            escaped_worst: 2e-3,
            escaped_noise: 1e-4,
            escaped_beyond: 0.0,
            sums_rms: 1e-3,
            sums_expected: 1e-3,
            sums_unsaid: 0.0,
            escaped_rms: 5e-4,
            escaped_expected: 5e-4,
            escaped_unsaid: 0.0,
            worst_entry: 1e-3,
            steps,
            milliseconds: 1.0,
            settling: 100.0,
        }
    }

    #[test]
    fn a_board_is_read_back_as_it_was_written() {
        let cells: Vec<Cell> = [cell("pixel", 1e-2, 1e4), cell("0.3%", 3e-3, f64::NAN)]
            .map(|c| c.rounded())
            .into();
        let text = to_csv(&cells);
        let again = from_csv(&text).expect("a board");
        assert_eq!(to_csv(&again), text);
        assert_eq!(again[0], cells[0]);
        assert!(again[1].steps.is_nan());
        for wrong in [
            "scene,level\n",
            &text.replace("pixel", "dot"),
            &text.replacen(",1.000e-2", "", 1),
            &text.replacen("1.000e-2", "x", 1),
        ] {
            assert!(from_csv(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn each_figure_is_held_and_noise_is_allowed_for() {
        let old = cell("1%", 1e-2, 1e4);
        assert!(worse(&old, &old).is_empty());
        let with = |change: fn(&mut Cell)| {
            let mut new = old.clone();
            change(&mut new);
            worse(&new, &old).len()
        };
        assert_eq!(with(|c| c.error = 1.001e-2), 0, "within three standard deviations");
        assert_eq!(with(|c| c.error = 1.1e-2), 1);
        assert_eq!(with(|c| c.error = f64::NAN), 1);
        assert_eq!(with(|c| c.sums_95 = 2.7e-3), 0);
        assert_eq!(with(|c| c.sums_95 = 2.9e-3), 1);
        assert_eq!(with(|c| c.sums_worst = 6e-3), 1);
        assert_eq!(with(|c| c.escaped_95 = 2e-3), 1);
        assert_eq!(with(|c| c.escaped_worst = 3e-3), 1);
        assert_eq!(with(|c| c.sums_unsaid = 1.0), 1);
        assert_eq!(with(|c| c.escaped_unsaid = 1.0), 1);
        assert_eq!(with(|c| c.worst_entry = f64::NAN), 1);
        assert_eq!(with(|c| c.steps = 1.03e4), 1);
        assert_eq!(with(|c| c.steps = 0.5e4), 0);
    }

    #[test]
    fn asking_for_more_and_having_less_has_a_name() {
        let good = [
            cell("pixel", 1e-3, 9e4),
            cell("2%", 1.5e-2, 0.5e4),
            cell("1%", 7e-3, 2e4),
            cell("0.3%", 2e-3, 4e4),
        ];
        assert!(not_monotone(&good).is_empty(), "sums of pixels ask for nothing");
        let names = |cells: &[Cell]| not_monotone(cells).into_keys().collect::<Vec<_>>();
        let mut cheaper = good.clone();
        cheaper[3].steps = 1e4;
        assert_eq!(names(&cheaper), ["some: from 1% to 0.3%, the cost falls"]);
        let mut worse = good.clone();
        worse[3].error = 9e-3;
        worse[3].expected = 9e-3;
        assert_eq!(
            names(&worse),
            [
                "some: from 1% to 0.3%, the error rises",
                "some: from 1% to 0.3%, the expected error rises"
            ]
        );
    }

    #[test]
    fn errors_are_those_of_the_comparison_against_a_reference() {
        use hemicube::InputPatch;
        use hemicube::reference::{EstimatedRow, errors_against};
        let reference = [ReferenceRow {
            emitter: 3,
            columns: vec![1, 2],
            values: vec![0.3, 0.4],
            errors: vec![1e-3, 2e-3],
            escaped: 0.3,
            error_of_shares: 1e-3,
            ..ReferenceRow::default()
        }];
        let entries = vec![(1, 0.31), (2, 0.4), (5, 0.02)];
        let estimated = [EstimatedRow {
            emitter: InputPatch(3),
            columns: vec![1, 2, 5],
            values: vec![0.31, 0.4, 0.02],
        }];
        let own = Found {
            entries,
            escaped: 0.27,
            // Of the sum, which is 0.03 off, it says enough; of escaped, too little.
            errors: RowErrors::from_array([0.05, 0.02, 0.001]),
        };
        let measured = errors_against(&reference, &estimated);
        let cell = errors(&reference, &BTreeMap::from([(3, own)]), 1e-2);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(cell.error, measured.relative_frobenius);
        near(cell.noise, measured.reference_noise);
        near(cell.sums_worst, measured.row_sum_error.max);
        assert!((cell.expected - 0.1).abs() < 1e-6, "{}", cell.expected);
        near(cell.escaped_worst, 0.03);
        near(cell.worst_entry, 0.02);
        assert_eq!((cell.sums_beyond, cell.escaped_beyond), (1.0, 1.0));
        assert_eq!((cell.sums_unsaid, cell.escaped_unsaid), (0.0, 1.0));
        near(cell.escaped_rms, (0.03f64.powi(2) - 1e-6).sqrt());
        assert!((cell.sums_expected - 0.02).abs() < 1e-6, "{}", cell.sums_expected);
        // A row that is not there is no exact one.
        assert!(errors(&reference, &BTreeMap::new(), 1e-2).error > 0.99);
    }
}
