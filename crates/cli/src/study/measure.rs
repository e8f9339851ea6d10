//! Measuring: ways in turns over the same rows, error against time, and whole runs from start to end.

use crate::args::Talk;
use crate::clock::{process_seconds, thread_seconds, wall_seconds};
use crate::commands::tradeoff;
use crate::study::results::{Accuracy, Cell, Choice, Course, Point, Rate, Results};
use crate::study::scenes::{Ready, StudyScene};
use crate::study::ways::{Finding, ORIGINAL, OURS, Target, Way, ways};
use anyhow::{Context, Result, anyhow, bail};
use hemicube::backend::{BackendError, Counters, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube::{InputPatch, Model};
use hemicube_spatial::whole;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Consecutive rows in the order of work, measured together: sharing between neighbours counts.
const RUN: usize = 16;
/// Sessions loaded side by side, for scenes up to [`MANY_PATCHES`] and for larger ones.
const TOGETHER: usize = 24;
const TOGETHER_OF_MANY: usize = 3;
const MANY_PATCHES: usize = 400_000;

/// Hemicubes rendered before measuring a plugin with a choice of its own: it chooses after the first 32 to 48, of a
/// run's thousands.
const BEFORE: usize = 64;

/// Number of a table's fastest ways measured anew beside a finding, and the number for large scenes; none slower than
/// `IN_QUESTION` times the fastest, more than any drift of the machine.
const FASTEST: usize = 4;
const FASTEST_OF_MANY: usize = 2;
const IN_QUESTION: f64 = 1.5;
/// Least turns, in turns of a cell, and the time of all ways together, in times of a cell's slowest.
const TURNS_OF_CHOICE: u32 = 2;
const TIME_OF_CHOICE: f64 = 4.0;
/// Turns go on until this many have lowered no way's least time by more than a hundredth, whoever leads: how threads
/// meet on a core is luck, as large as the differences compared. At most this many times the least turns.
const QUIET_TURNS: u32 = 4;
const MOST_TURNS: u32 = 5;
const SETTLED: f64 = 0.99;
/// A quick study has no time for more turns than the least, nor for long ones.
const TIME_OF_QUICK_CHOICE: f64 = 1.0;
/// Places of a choice's rows, and most neighbours at each: a run goes from neighbour to neighbour, and engines must
/// find their data in the cache here as there.
const PLACES: usize = 16;
const NEIGHBOURS: usize = 256;

/// A turn takes at least this long: a kernel may count processor time by ticks of 4 ms.
const LEAST_SECONDS: f64 = 0.12;

/// Ways that a finding competes with.
pub(super) struct Rivals {
    ways: Vec<Way>,
    /// Time of a row by all of them and the finding.
    milliseconds: f64,
}

/// Interrupted.
#[derive(Debug)]
pub(super) struct Stopped;

/// Shared state of all measurements.
pub(super) struct Bench<'a> {
    pub(super) results: Results,
    pub(super) cancel: &'a AtomicBool,
}

/// Number `index` in [0, 1) of a sequence with evenly spread beginnings.
fn spread(index: usize) -> f64 {
    let mut index = index as u64;
    let (mut value, mut digit) = (0.0, 0.5);
    while index > 0 {
        value += digit * (index & 1) as f64;
        digit *= 0.5;
        index >>= 1;
    }
    value
}

/// Rows to measure: runs of neighbours in the order of work, spread over it. Fewer rows are the first of more.
pub(super) fn sample(model: &Model, rows: usize, run: usize) -> Vec<Hemicube> {
    let order: Vec<InputPatch> = model.order().collect();
    let rows = rows.min(order.len());
    if order.len() <= run {
        return order.iter().flat_map(|&p| model.hemicubes(p, 1, true)).collect();
    }
    let start = |place: usize| whole::to_usize(spread(place) * (order.len() - run) as f64);
    (0..rows.div_ceil(run))
        .flat_map(|place| order[start(place)..].iter().take(run))
        .flat_map(|&p| model.hemicubes(p, 1, true))
        .take(rows)
        .collect()
}

/// Affordable number of rows of a choice, and the number of neighbours among them.
fn rows_of_choice(affordable: f64) -> (usize, usize) {
    let rows = whole::to_usize(affordable).clamp(RUN, PLACES * NEIGHBOURS);
    let neighbours = (rows / PLACES).max(RUN);
    (rows / neighbours * neighbours, neighbours)
}

/// ‖a − b‖ / ‖b‖ of rows of the same hemicubes.
fn distance(a: &RowBlock, b: &RowBlock) -> f64 {
    let (mut difference, mut norm) = (0.0, 0.0);
    for row in 0..a.len().min(b.len()) {
        let (a, b) = (a.row(row), b.row(row));
        let (mut i, mut j) = (0, 0);
        while i < a.patches.len() || j < b.patches.len() {
            let of = |patches: &[u32], place: usize| patches.get(place).copied().unwrap_or(u32::MAX);
            let (p, q) = (of(a.patches, i), of(b.patches, j));
            let (mut x, mut y) = (0.0, 0.0);
            if p <= q {
                x = f64::from(a.visible[i]);
                i += 1;
            }
            if q <= p {
                y = f64::from(b.visible[j]);
                j += 1;
            }
            difference += (x - y) * (x - y);
            norm += y * y;
        }
    }
    if norm > 0.0 { (difference / norm).sqrt() } else { 0.0 }
}

/// A way's session, and the best of its turns.
struct Live {
    way: Way,
    session: Box<dyn HemicubeBackend>,
    load_seconds: f64,
    seconds: f64,
    wall: f64,
    processors: f64,
    counters: Counters,
    seen: u64,
    from_original: f64,
    from_built_in: f64,
}

impl Live {
    /// Renders enough rows for a plugin's choice.
    fn decide(&mut self, hemicubes: &[Hemicube], block: &mut RowBlock) -> Result<(), BackendError> {
        let few = &hemicubes[..hemicubes.len().min(BEFORE)];
        for _ in 0..BEFORE.div_ceil(few.len().max(1)) {
            block.clear();
            self.session.rows(few, block)?;
        }
        Ok(())
    }

    /// Renders the rows repeatedly, for a measurable time, and keeps the least time of one round.
    fn turn(&mut self, target: &Target, hemicubes: &[Hemicube], block: &mut RowBlock) -> Result<(), BackendError> {
        let processor = |target: &Target| {
            if target.is_built_in() {
                thread_seconds()
            } else {
                process_seconds()
            }
        };
        let (wall, start) = (wall_seconds(), processor(target));
        let mut passes = 0.0;
        let (spent, wall) = loop {
            block.clear();
            self.counters = self.session.rows(hemicubes, block)?;
            passes += 1.0;
            let (spent, wall) = (processor(target) - start, wall_seconds() - wall);
            if spent.max(0.5 * wall) >= LEAST_SECONDS {
                break (spent / passes, wall / passes);
            }
        };
        let seconds = if target.on_processor { spent } else { wall };
        if seconds < self.seconds {
            self.seconds = seconds;
            self.processors = spent / wall.max(1e-9);
        }
        self.wall = self.wall.min(wall);
        Ok(())
    }
}

impl Bench<'_> {
    pub(super) fn is_stopped(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    fn render_settings(&self, way: &Way) -> RenderSettings {
        RenderSettings {
            resolution: self.results.settings.resolution,
            culling: way.culling(),
            covered: false,
        }
    }

    fn live(&self, target: &Target, way: &Way, ready: &Ready) -> Result<Live> {
        let mut session = way.session(target)?;
        let cut = way
            .hierarchy()
            .map(|options| Model::new(Arc::clone(&ready.patches), options))
            .transpose()?;
        let model = cut.as_ref().unwrap_or(&ready.model);
        let start = wall_seconds();
        session.load(model.geometry(), self.render_settings(way))?;
        Ok(Live {
            way: way.clone(),
            session,
            load_seconds: wall_seconds() - start,
            seconds: f64::INFINITY,
            wall: f64::INFINITY,
            processors: 0.0,
            counters: Counters::default(),
            seen: 0,
            from_original: 0.0,
            from_built_in: 0.0,
        })
    }

    /// Measures the missing cells of `wanted`, in turns. The slowest, *original*, determines the number of rows.
    ///
    /// # Errors
    /// When *original* fails, or results cannot be kept. Failures of other ways are kept as such.
    pub(super) fn rates(
        &mut self,
        scene: &StudyScene,
        ready: &Ready,
        target: &Target,
        wanted: Vec<Way>,
    ) -> Result<Option<Stopped>> {
        let is_there = |bench: &Self, way: &Way| bench.results.get(&[&scene.key, &target.name, &way.key()]).is_some();
        let missing: Vec<Way> = wanted.into_iter().filter(|way| !is_there(self, way)).collect();
        if missing.is_empty() {
            return Ok(None);
        }
        let original = ways(target, false)
            .into_iter()
            .find(|way| way.name == ORIGINAL)
            .ok_or_else(|| anyhow!("backend `{}` has no way to be compared with", target.name))?;
        let mut first = self.live(target, &original, ready)?;
        let hemicubes = self.choose(scene, ready, target, &mut first)?;
        let mut by_original = RowBlock::default();
        first.turn(target, &hemicubes, &mut by_original)?;
        let by_built_in = self.by_built_in(ready, &hemicubes)?;
        let mut given = Some(first);
        let together = if ready.patches.len() > MANY_PATCHES {
            TOGETHER_OF_MANY
        } else {
            TOGETHER
        };
        for ways in missing.chunks(together) {
            let mut live: Vec<Live> = Vec::new();
            for way in ways {
                let opened = match given.take() {
                    Some(first) if way.key() == ORIGINAL => Ok(first),
                    _ => self.live(target, way, ready),
                };
                match opened {
                    Ok(opened) => live.push(opened),
                    Err(error) => {
                        let reason = format!("{error:#}");
                        self.results
                            .put(&[&scene.key, &target.name, &way.key()], Cell::None(reason));
                    }
                }
            }
            let mut block = RowBlock::default();
            for one in &mut live {
                if target.is_built_in() || one.way.name != OURS {
                    continue;
                }
                one.decide(&hemicubes, &mut block)
                    .with_context(|| format!("`{}` by {} of `{}`", scene.key, one.way.key(), target.name))?;
            }
            for turn in 0..self.results.settings.turns {
                for one in &mut live {
                    if self.is_stopped() {
                        return Ok(Some(Stopped));
                    }
                    one.turn(target, &hemicubes, &mut block)
                        .with_context(|| format!("`{}` by {} of `{}`", scene.key, one.way.key(), target.name))?;
                    if turn == 0 {
                        block.check(hemicubes.len(), ready.model.geometry().patch_count, false)?;
                        one.seen = block.patches.len() as u64;
                        one.from_original = distance(&block, &by_original);
                        one.from_built_in = distance(&block, &by_built_in);
                    }
                }
            }
            for one in live {
                let rows = hemicubes.len() as f64;
                let per = |count: u64| count as f64 / rows;
                let rate = Rate {
                    patches: ready.patches.len() as u64,
                    rows: hemicubes.len() as u64,
                    milliseconds: 1e3 * one.seconds / rows,
                    wall_milliseconds: 1e3 * one.wall / rows,
                    processors: one.processors,
                    load_seconds: one.load_seconds,
                    seen: per(one.seen),
                    nodes_tested: per(one.counters.nodes_tested),
                    nodes_hidden: per(one.counters.nodes_hidden),
                    triangles: per(one.counters.triangles_drawn),
                    queries: per(one.counters.queries),
                    bytes_read_back: per(one.counters.bytes_read_back),
                    from_original: one.from_original,
                    from_built_in: one.from_built_in,
                    choices: one.session.choices(),
                };
                self.results
                    .put(&[&scene.key, &target.name, &one.way.key()], Cell::Rate(rate));
            }
            self.results.save()?;
        }
        Ok(None)
    }

    /// The fastest ways that compete with `finding`, by their cells. `None` if it was measured already, or cells are
    /// missing.
    pub(super) fn fastest(&self, scene: &StudyScene, target: &Target, finding: &Finding) -> Option<Rivals> {
        if self.results.get(&[&scene.key, &target.name, finding.key]).is_some() {
            return None;
        }
        let rate = |way: &Way| self.results.rate(&scene.key, &target.name, &way.key());
        let found = rate(&finding.found)?;
        let mut tried: Vec<(f64, &Way)> = finding
            .others
            .iter()
            .filter_map(|way| Some((rate(way)?.milliseconds, way)))
            .collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let &(best, _) = tried.first()?;
        tried.retain(|(milliseconds, _)| *milliseconds <= IN_QUESTION * best);
        tried.truncate(if found.patches > MANY_PATCHES as u64 {
            FASTEST_OF_MANY
        } else {
            FASTEST
        });
        Some(Rivals {
            milliseconds: found.milliseconds + tried.iter().map(|(milliseconds, _)| milliseconds).sum::<f64>(),
            ways: tried.into_iter().map(|(_, way)| way.clone()).collect(),
        })
    }

    /// Measures a finding beside its rivals, in the same turns over the same rows.
    ///
    /// # Errors
    /// When a way fails, or results cannot be kept.
    pub(super) fn choice(
        &mut self,
        scene: &StudyScene,
        ready: &Ready,
        target: &Target,
        finding: &Finding,
        rivals: &Rivals,
    ) -> Result<Option<Stopped>> {
        let settings = self.results.settings;
        let turns = TURNS_OF_CHOICE * settings.turns;
        let (time, most) = if settings.is_quick() {
            (TIME_OF_QUICK_CHOICE, turns)
        } else {
            (TIME_OF_CHOICE, MOST_TURNS * turns)
        };
        let affordable = time * settings.seconds / (f64::from(turns) * 1e-3 * rivals.milliseconds.max(1e-6));
        let (rows, neighbours) = rows_of_choice(affordable.min(ready.patches.len() as f64));
        let hemicubes = sample(&ready.model, rows, neighbours);
        let by = |way: &Way| format!("`{}` by {} of `{}`", scene.key, way.key(), target.name);
        let mut block = RowBlock::default();
        let mut live: Vec<Live> = Vec::new();
        for way in std::iter::once(&finding.found).chain(&rivals.ways) {
            let mut one = self.live(target, way, ready).with_context(|| by(way))?;
            one.decide(&hemicubes, &mut block).with_context(|| by(way))?;
            live.push(one);
        }
        let (mut turn, mut quiet) = (0, 0);
        while turn < turns || (quiet < QUIET_TURNS && turn < most) {
            (turn, quiet) = (turn + 1, quiet + 1);
            for one in &mut live {
                if self.is_stopped() {
                    return Ok(Some(Stopped));
                }
                let before = one.seconds;
                one.turn(target, &hemicubes, &mut block).with_context(|| by(&one.way))?;
                block.check(hemicubes.len(), ready.model.geometry().patch_count, false)?;
                if one.seconds < SETTLED * before {
                    quiet = 0;
                }
            }
        }
        let milliseconds = |one: &Live| 1e3 * one.seconds / hemicubes.len() as f64;
        let (found, others) = live.split_first().context("what is found by itself was measured")?;
        let cell = Choice {
            what: finding.what.to_owned(),
            patches: ready.patches.len() as u64,
            rows: hemicubes.len() as u64,
            neighbours: neighbours as u64,
            found_milliseconds: milliseconds(found),
            others: others.iter().map(|one| (one.way.key(), milliseconds(one))).collect(),
            choices: found.session.choices(),
        };
        self.results
            .put(&[&scene.key, &target.name, finding.key], Cell::Choice(cell));
        self.results.save()?;
        Ok(None)
    }

    /// Chooses the rows: as many as *original* has time for, at most the limit; an earlier run's, if there is one.
    fn choose(&self, scene: &StudyScene, ready: &Ready, target: &Target, original: &mut Live) -> Result<Vec<Hemicube>> {
        let settings = self.results.settings;
        if let Some(before) = self.results.rate(&scene.key, &target.name, ORIGINAL) {
            return Ok(sample(&ready.model, usize::try_from(before.rows)?, RUN));
        }
        let few = sample(&ready.model, RUN, RUN);
        if few.is_empty() {
            bail!("scene `{}` has no patch with an area", scene.key);
        }
        // The first call, with the driver's compilation of shaders, does not count.
        original.turn(target, &few[..1], &mut RowBlock::default())?;
        original.seconds = f64::INFINITY;
        original.turn(target, &few, &mut RowBlock::default())?;
        let each = original.seconds / few.len() as f64;
        (original.seconds, original.wall) = (f64::INFINITY, f64::INFINITY);
        let affordable = settings.seconds / (f64::from(settings.turns) * each.max(1e-9));
        let runs = whole::to_usize(affordable / RUN as f64);
        let rows = (runs.max(1) * RUN).min(settings.rows as usize);
        Ok(sample(&ready.model, rows, RUN))
    }

    /// Renders the rows by the built-in backend, by depth.
    fn by_built_in(&self, ready: &Ready, hemicubes: &[Hemicube]) -> Result<RowBlock> {
        let mut backend =
            hemicube_backend_cpu::CpuBackend::new().with_engine(hemicube_backend_cpu::EngineChoice::Depth);
        let settings = RenderSettings {
            resolution: self.results.settings.resolution,
            culling: hemicube::backend::Culling::On,
            covered: false,
        };
        backend.load(ready.model.geometry(), settings)?;
        let mut block = RowBlock::default();
        backend.rows(hemicubes, &mut block)?;
        Ok(block)
    }

    /// Measures error against time with the built-in backend, by `tradeoff`.
    ///
    /// # Errors
    /// When the scene cannot be written for it, or there is no reference.
    pub(super) fn accuracy(&mut self, scene: &StudyScene, talk: Talk) -> Result<Option<Stopped>> {
        let key = [scene.key.as_str(), "cpu", "error"];
        if self.results.get(&key).is_some() {
            return Ok(None);
        }
        let (path, split) = scene.file(&self.results.folder().join("scenes"))?;
        let words = vec![
            path.into_os_string(),
            "--split".into(),
            split.to_string().into(),
            "--rows".into(),
            self.results.settings.sample_rows.to_string().into(),
            "--backend".into(),
            "cpu".into(),
        ];
        let Some(measured) = tradeoff::measure_scene(words, self.cancel, talk)? else {
            return Ok(Some(Stopped));
        };
        let points = measured.trials.into_iter().map(|trial| Point {
            milliseconds: trial.milliseconds(),
            error: trial.measured.relative_frobenius,
            low: trial.measured.interval_of_rows.low,
            high: trial.measured.interval_of_rows.high,
            family: trial.rung.to_owned(),
            name: trial.name,
        });
        let cell = Accuracy {
            patches: measured.patches,
            rows: measured.sampled_rows as u64,
            noise: measured.reference.noise,
            points: points.collect(),
        };
        self.results.put(&key, Cell::Accuracy(cell));
        self.results.save()?;
        Ok(None)
    }

    /// A whole run of this program, watched from outside: memory and processor over time.
    ///
    /// # Errors
    /// When the program cannot be started, or its matrix not be kept for a moment.
    pub(super) fn course(
        &mut self,
        scene: &StudyScene,
        target: &Target,
        way: &Way,
        rows: u64,
    ) -> Result<Option<Stopped>> {
        let name = format!("run {}", way.name);
        let key = [scene.key.as_str(), target.name.as_str(), name.as_str()];
        let Some(words) = way.engine_words(target) else {
            return Ok(None);
        };
        if self.results.get(&key).is_some() {
            return Ok(None);
        }
        let (path, split) = scene.file(&self.results.folder().join("scenes"))?;
        let matrix = Matrix(self.results.folder().join(".run.hemicube"));
        matrix.remove();
        let program = program()?;
        let mut process = Process::new(program);
        process
            .args([
                "compute",
                "-q",
                "--config=none",
                "--threads",
                "1",
                "--correction",
                "pixel",
                "--resolution",
            ])
            .arg(self.results.settings.resolution.to_string())
            .arg("--split")
            .arg(split.to_string())
            .args(&words)
            .arg(&path)
            .arg("-o")
            .arg(&matrix.0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        if rows < scene.target {
            process.args(["--rows", &rows.to_string()]);
        }
        let watched = match watch(process, self.cancel)? {
            Some(watched) => watched,
            None => return Ok(Some(Stopped)),
        };
        let cell = match watched {
            Ok(mut course) => {
                course.patches = scene.target;
                course.rows = rows.min(scene.target);
                course.matrix_bytes = matrix.bytes();
                Cell::Course(course)
            }
            Err(reason) => Cell::None(reason),
        };
        self.results.put(&key, cell);
        self.results.save()?;
        Ok(None)
    }
}

/// A temporary matrix.
struct Matrix(PathBuf);

impl Matrix {
    fn remove(&self) {
        // A missing one is no matter; the program reports one that cannot be removed when it meets it.
        let _ = std::fs::remove_dir_all(&self.0);
    }

    fn bytes(&self) -> u64 {
        let files = std::fs::read_dir(&self.0).into_iter().flatten().flatten();
        files
            .filter_map(|file| file.metadata().ok())
            .map(|file| file.len())
            .sum()
    }
}

impl Drop for Matrix {
    fn drop(&mut self) {
        self.remove();
    }
}

/// Interval between looks at a process.
const MOMENT: Duration = Duration::from_millis(25);
/// More moments than this are thinned out.
const MOMENTS: usize = 400;

/// Runs a process to its end; the reason of its failure, or `None` where interrupted.
fn watch(mut process: Process, cancel: &AtomicBool) -> Result<Option<Result<Course, String>>> {
    let start = wall_seconds();
    let mut child = process.spawn().context("this program cannot be started once more")?;
    let mut course = Course {
        patches: 0,
        rows: 0,
        seconds: 0.0,
        processor_seconds: 0.0,
        peak_bytes: 0,
        matrix_bytes: 0,
        moments: Vec::new(),
    };
    let (mut before, mut spent_before) = (0.0, 0.0);
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if cancel.load(Ordering::Relaxed) {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        let now = wall_seconds() - start;
        let folder = PathBuf::from(format!("/proc/{}", child.id()));
        if let (Some(bytes), Some(spent)) = (resident_bytes(&folder), spent_seconds(&folder)) {
            let busy = (spent - spent_before) / (now - before).max(1e-3);
            course.moments.push((now, bytes, busy));
            course.peak_bytes = course.peak_bytes.max(bytes);
            course.processor_seconds = spent;
            (before, spent_before) = (now, spent);
        }
        std::thread::sleep(MOMENT);
    };
    course.seconds = wall_seconds() - start;
    if !status.success() {
        let output = child.wait_with_output()?;
        let said = String::from_utf8_lossy(&output.stderr);
        return Ok(Some(Err(said
            .lines()
            .next()
            .unwrap_or("it failed and said nothing")
            .to_owned())));
    }
    let every = course.moments.len().div_ceil(MOMENTS).max(1);
    course.moments = course.moments.into_iter().step_by(every).collect();
    Ok(Some(Ok(course)))
}

fn resident_bytes(process: &Path) -> Option<u64> {
    let status = std::fs::read_to_string(process.join("status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(1024 * line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?)
}

/// Processor time of a process and its ended threads, in steps of 0.01 s.
fn spent_seconds(process: &Path) -> Option<f64> {
    let stat = std::fs::read_to_string(process.join("stat")).ok()?;
    let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
    // Fields 14 and 15 of proc(5).
    Some((fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?) * 0.01)
}

/// The program: beside the folder of this example, where one build puts both.
fn program() -> Result<std::path::PathBuf> {
    let own = std::env::current_exe().context("the example's own path")?;
    let name = format!("hemicube{}", std::env::consts::EXE_SUFFIX);
    let folders = own.ancestors().skip(1).take(2);
    let found = folders.map(|folder| folder.join(&name)).find(|path| path.is_file());
    found.context("the program is not beside the example: `cargo build --release -p hemicube-cli`")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(rows: &[&[(u32, u32)]]) -> RowBlock {
        let mut block = RowBlock::default();
        for row in rows {
            for &(patch, weight) in *row {
                block.push(InputPatch(patch), weight, 0);
            }
            block.end_row(0, 0);
        }
        block
    }

    #[test]
    fn rows_are_compared_patch_by_patch() {
        let a = block(&[&[(1, 3), (4, 4)], &[(2, 5)]]);
        assert_eq!(distance(&a, &a), 0.0);
        let off = block(&[&[(1, 3), (5, 4)], &[(2, 5)]]);
        assert!((distance(&off, &a) - (32.0f64 / 50.0).sqrt()).abs() < 1e-12);
        assert_eq!(distance(&block(&[&[], &[]]), &a), 1.0);
    }

    #[test]
    fn rows_of_a_choice_are_from_many_places_and_then_neighbours() {
        assert_eq!(rows_of_choice(0.0), (16, 16));
        assert_eq!(rows_of_choice(100.0), (96, 16));
        assert_eq!(rows_of_choice(3300.0), (3296, 206));
        assert_eq!(rows_of_choice(f64::INFINITY), (4096, 256));
    }

    #[test]
    fn any_beginning_of_the_sequence_is_spread() {
        let mut first: Vec<f64> = (0..8).map(spread).collect();
        first.sort_by(f64::total_cmp);
        assert_eq!(first, [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875]);
    }
}
