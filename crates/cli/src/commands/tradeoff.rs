//! `hemicube tradeoff`: error against rays and time on this machine of every rung of the accuracy ladder, on a sample
//! of a scene's rows, and the recommended setting for a tolerance.
//!
//! Errors depend on the scene, the sample and its seed only. Times, and therefore the front and the recommendation, are
//! this machine's. The settings tried are chosen by counting triangles and pixels, not by a clock.

mod plot;
mod report;
mod setting;
mod text;
mod trial;

use crate::args::{
    AutoSwitch, ConfigFiles, EngineSettings, Report as ReportArguments, SceneSettings, Switch, Talk, Tolerance, UpAxis,
    tolerance,
};
use crate::exit::{self, Exit};
use crate::help::{SCENE, examples, scene_help};
use crate::outputs::Paths;
use crate::picture::sheet::Format;
use crate::prepare::{Prepared, prepare};
use crate::progress::Bar;
use crate::report::print;
use crate::report::{BackendReport, JsonReport, PendingFile, SCHEMA, count, counted};
use crate::shell::word;
use crate::verify::{reference_rows, reference_settings};
use anyhow::{Context, Result, bail};
use clap::{Args, FromArgMatches};
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{Plan, Progress, RowChoice, Selection};
use hemicube::driver::room::Work;
use hemicube::reference::{Reference, ReferenceRow, noise_of};
use hemicube::row::RowBlock;
use hemicube::{InputPatch, Model};
use plot::{Mark, Picture};
use report::{Recommendation, ReferenceReport, Report, Skipped};
use setting::{RESOLUTION_OF_TOLERANCE, Setting, is_same, settings};
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use text::{Asked, text};
use trial::{ForAllRows, Timed, Trial, mark_front};

const EXAMPLES: &str = "  \
  hemicube tradeoff city.obj -o city.svg
  hemicube tradeoff city.obj --tolerance 0.3% --rows 64 --json > city.json";

/// Measure error against time on a scene and this machine, and recommend a setting
#[derive(Args, Debug)]
#[command(override_usage = "hemicube tradeoff [OPTIONS] SCENE", after_long_help = examples(EXAMPLES, true))]
pub(crate) struct Arguments {
    #[arg(value_name = "SCENE", required_unless_present = "print_config", help = SCENE, long_help = scene_help())]
    pub(crate) scene: Option<PathBuf>,
    /// The relative Frobenius error that a setting is recommended for
    #[arg(long, value_name = "T", default_value = "1%", value_parser = tolerance)]
    pub(crate) tolerance: Tolerance,
    /// How many random rows are measured
    #[arg(long, value_name = "N", default_value = "24", value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub(crate) rows: u32,
    /// Which rows
    #[arg(long, value_name = "S", default_value = "1")]
    pub(crate) seed: u64,
    /// Draw error against time into FILE: .svg or .png
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Replace what is there
    #[arg(long, requires = "output")]
    pub(crate) overwrite: bool,
    #[command(flatten)]
    pub(crate) patches: SceneSettings,
    #[command(flatten)]
    pub(crate) engine: EngineSettings,
    #[command(flatten)]
    pub(crate) config: ConfigFiles,
    #[command(flatten)]
    pub(crate) report: ReportArguments,
}
impl Arguments {
    /// Paths to read and to write.
    pub(crate) fn paths(&self) -> Paths {
        Paths::default()
            .reads(&self.scene)
            .reads(&self.config.config)
            .writes("-o", &self.output, self.overwrite)
    }
}

/// Errors of this share of the tolerance are still told from nothing.
const SHARE_TOLD_APART: f64 = 0.3;

/// Hemicubes sampled for the nominal cost.
const PROBES: usize = 8;
/// Largest nominal seconds of all sampled rows; slower settings are skipped.
const SECONDS_MOST: f64 = 60.0;
/// Repetitions of a timing, the best one counting, and seconds above which one is enough. The rows are always equal.
const REPEATS: u32 = 5;
const SECONDS_ONCE: f64 = 0.5;

pub(crate) fn run(arguments: Arguments, talk: Talk) -> Result<Exit> {
    // clap requires it; only `--print-config` goes without.
    let Some(path) = arguments.scene.as_deref() else {
        bail!("a scene is needed")
    };
    let plot = match &arguments.output {
        Some(file) => Some((Format::of(file)?, PendingFile::create(file)?)),
        None => None,
    };
    let json = JsonReport::asked(&arguments.report);
    let mut backend = arguments.engine.open_backend(talk)?;
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let prepared = prepare(path, &arguments.patches, &arguments.engine, Work::Fractions)?;
    prepared.tell(talk);
    // An interrupt ends the current work, and unfinished files are removed.
    let guard = exit::InterruptGuard::new();
    let Some(mut report) = measure(&arguments, prepared, backend.as_mut(), cancel, talk)? else {
        talk.say("interrupted: nothing is reported");
        return Ok(Exit::Interrupted);
    };
    drop(guard);
    let recommended = recommend(&report.trials, &arguments, path, report.patches, report.threads);
    if let Some((format, mut file)) = plot {
        let picture = picture(&report, recommended.as_ref(), path);
        file.write_all(&plot::draw(&picture, format)?)
            .context("the picture cannot be written")?;
        file.commit()?;
    }
    if !arguments.report.json {
        let asked = Asked {
            tolerance: arguments.tolerance.0,
            sample_rows: arguments.rows,
            all: talk.verbose,
        };
        print(&text(&report, recommended.as_ref(), asked, path))?;
    }
    if let Some(json) = json {
        if !talk.verbose {
            for trial in &mut report.trials {
                trial.timing = None;
            }
            // They are in the order of their times.
            report.trials.sort_by(|one, other| one.words.cmp(&other.words));
        } else {
            report.recommended = recommended;
        }
        json.write(&report)?;
    }
    Ok(Exit::Done)
}

/// Measures all settings on a scene, by the arguments of a `tradeoff` command line; `None` where interrupted. For
/// the study.
///
/// # Errors
/// When the arguments are wrong, the scene cannot be read, the backend does not open, or there is no reference.
pub(crate) fn measure_scene(words: Vec<OsString>, cancel: &AtomicBool, talk: Talk) -> Result<Option<Report>> {
    let definition = Arguments::augment_args(clap::Command::new("tradeoff").no_binary_name(true));
    let arguments = &Arguments::from_arg_matches(&definition.try_get_matches_from(words)?)?;
    let Some(path) = arguments.scene.as_deref() else {
        bail!("a scene is needed")
    };
    let mut backend = arguments.engine.open_backend(talk)?;
    let prepared = prepare(path, &arguments.patches, &arguments.engine, Work::Fractions)?;
    measure(arguments, prepared, backend.as_mut(), cancel, talk)
}

/// Measures all settings; `None` where interrupted.
fn measure(
    arguments: &Arguments,
    prepared: Prepared,
    backend: &mut dyn HemicubeBackend,
    cancel: &AtomicBool,
    talk: Talk,
) -> Result<Option<Report>> {
    let model = &prepared.model;
    let threads = arguments.engine.thread_count();
    let rows = plan_of(model, arguments, 1, Correction::Pixel).rows;
    // The reference tells settings finer than the recommended one apart, too.
    let finer = Tolerance(arguments.tolerance.0 * SHARE_TOLD_APART);
    let settings_of_reference = reference_settings(Some(finer), arguments.seed);
    let reference = Reference::new(model, settings_of_reference)
        .context("there is no reference to measure against")?
        .cancelled_by(cancel);
    let Some(exact) = trace(&reference, &rows, threads, cancel, talk)? else {
        return Ok(None);
    };
    let Some((mut timings, skipped)) = affordable(model, arguments, &rows, backend, cancel)? else {
        return Ok(None);
    };
    if !time(&mut timings, model, arguments, cancel, talk)? {
        return Ok(None);
    }
    let patches = model.patches().len() as u64;
    let all = ForAllRows { patches, threads };
    let mut trials: Vec<Trial> = timings.into_iter().map(|timed| timed.trial(&exact, all)).collect();
    mark_front(&mut trials);
    let info = backend.info();
    Ok(Some(Report {
        schema: SCHEMA,
        program: "hemicube",
        version: env!("CARGO_PKG_VERSION"),
        inputs: vec![prepared.input],
        patches,
        backend: BackendReport {
            name: info.name.clone(),
            version: info.version.clone(),
            device: info.device.clone(),
        },
        threads,
        tolerance: arguments.tolerance.0,
        sampled_rows: rows.len(),
        seed: arguments.seed,
        reference: ReferenceReport {
            target: settings_of_reference.target,
            noise: noise_of(&exact),
            rays: exact.iter().map(|row| row.rays).sum(),
        },
        trials,
        skipped,
        recommended: None,
    }))
}

/// The sampled rows with a number of hemicubes a patch and a correction.
fn plan_of(model: &Model, arguments: &Arguments, samples_per_edge: u32, correction: Correction) -> Plan {
    let choice = RowChoice::Sample {
        count: arguments.rows,
        seed: arguments.seed,
    };
    Plan::new(model, choice, Selection::default(), samples_per_edge, true).with_correction(correction)
}

/// Computes the rows by rays; `None` where interrupted.
fn trace(
    reference: &Reference<'_>,
    rows: &[InputPatch],
    threads: usize,
    cancel: &AtomicBool,
    talk: Talk,
) -> Result<Option<Vec<ReferenceRow>>> {
    let row_count = rows.len() as u64;
    talk.say(&format!("reference: {} by rays", counted(row_count, "row")));
    let bar = Bar::rows(talk, row_count, 0);
    let exact = reference_rows(reference, rows, threads, cancel, &mut |done| {
        bar.show(Progress {
            rows: done,
            row_count,
            entries: 0,
        });
    })?;
    Ok((!cancel.load(Ordering::Relaxed)).then_some(exact))
}

/// Calibrates the settings with a nominal time within [`SECONDS_MOST`], and names the others; `None` where interrupted.
fn affordable(
    model: &Model,
    arguments: &Arguments,
    rows: &[InputPatch],
    backend: &mut dyn HemicubeBackend,
    cancel: &AtomicBool,
) -> Result<Option<(Vec<Timed>, Vec<Skipped>)>> {
    let threads = arguments.engine.thread_count();
    let (triangles, seen) = probe(model, rows, backend)?;
    let (mut timings, mut skipped) = (Vec::new(), Vec::new());
    for setting in settings(arguments.tolerance) {
        let nominal_seconds = setting.nominal(triangles, seen) * 1e-3 * rows.len() as f64;
        if nominal_seconds > SECONDS_MOST {
            skipped.push(Skipped {
                name: setting.name(),
                nominal_seconds,
            });
        } else {
            let settled = setting.settle(model, backend, threads, cancel);
            if cancel.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let (correction, resolution) = settled?;
            timings.push(Timed {
                setting: Setting { resolution, ..setting },
                plan: plan_of(model, arguments, setting.samples_per_edge, correction),
                repeats: 0,
                parts: Vec::new(),
                milliseconds_per_row: f64::INFINITY,
            });
        }
    }
    Ok(Some((timings, skipped)))
}

/// Times all settings once, then all again: other load of the machine hits them alike. Returns false where interrupted.
fn time(timings: &mut [Timed], model: &Model, arguments: &Arguments, cancel: &AtomicBool, talk: Talk) -> Result<bool> {
    talk.say(&format!(
        "settings: {}, timed with one thread",
        count(timings.len() as u64)
    ));
    let all = timings.len() as u64 * u64::from(REPEATS);
    let bar = Bar::counting(talk, all, "timings");
    let mut done = 0;
    for _ in 0..REPEATS {
        for timed in &mut *timings {
            if timed.repeats == 0 || timed.seconds() < SECONDS_ONCE {
                let ran = timed.run(model, &arguments.engine, cancel);
                if cancel.load(Ordering::Relaxed) {
                    return Ok(false);
                }
                ran?;
            }
            done += 1;
            bar.show(Progress {
                rows: done,
                row_count: all,
                entries: 0,
            });
        }
    }
    Ok(true)
}

/// Mean triangles transformed and patches seen by a hemicube, from a few.
fn probe(model: &Model, rows: &[InputPatch], backend: &mut dyn HemicubeBackend) -> Result<(f64, f64)> {
    let hemicubes: Vec<_> = (0..PROBES)
        .filter_map(|probe| rows.get(probe * rows.len() / PROBES))
        .flat_map(|&patch| model.hemicubes(patch, 1, true))
        .collect();
    let settings = RenderSettings {
        resolution: RESOLUTION_OF_TOLERANCE,
        culling: Culling::On,
        covered: false,
    };
    backend.load(model.geometry(), settings)?;
    let mut block = RowBlock::default();
    let counters = backend.rows(&hemicubes, &mut block)?;
    let share = 1.0 / hemicubes.len().max(1) as f64;
    Ok((
        counters.triangles_transformed as f64 * share,
        block.patches.len() as f64 * share,
    ))
}

/// The cheapest setting with even the upper end of its error within the tolerance.
fn recommend(
    trials: &[Trial],
    arguments: &Arguments,
    path: &Path,
    patches: u64,
    threads: usize,
) -> Option<Recommendation> {
    let keeps = |trial: &&Trial| trial.bound() <= arguments.tolerance.0;
    let asked = arguments.tolerance.0;
    let promises = |trial: &&Trial| trial.tolerance.is_some_and(|t| t < asked || is_same(t, asked));
    let cost = |a: &&Trial, b: &&Trial| a.milliseconds().total_cmp(&b.milliseconds());
    // Settings that promise as much go first where they keep it: a cheaper one keeps it in these few rows, but nothing
    // was learnt about the others.
    let trial = trials.iter().filter(keeps).filter(promises).min_by(cost);
    let trial = trial.or_else(|| trials.iter().filter(keeps).min_by(cost))?;
    Some(Recommendation {
        name: trial.name.clone(),
        command: command(trial, arguments, path),
        error: trial.bound(),
        milliseconds_per_row: trial.milliseconds(),
        seconds_for_all_rows: trial.milliseconds() * 1e-3 * patches as f64 / threads as f64,
        error_of_matrix: trial.measured.interval_of_matrix.high,
    })
}

/// The command line for the whole matrix.
fn command(trial: &Trial, arguments: &Arguments, path: &Path) -> String {
    let output = crate::report::matrix_of(path);
    let mut words = vec![format!("hemicube compute {} -o {}", word(path), word(&output))];
    words.extend(scene_words(&arguments.patches, &arguments.engine));
    words.push(trial.words.clone());
    words.join(" ")
}

/// Options for the scene and the engine, without built-in values.
fn scene_words(patches: &SceneSettings, engine: &EngineSettings) -> Vec<String> {
    let mut words = Vec::new();
    let mut add = |name: &str, value: Option<String>| {
        words.extend(value.map(|value| format!("--{name} {value}")));
    };
    add("split", patches.split.map(|pieces| pieces.to_string()));
    add("patch-size", patches.patch_size.map(|length| length.to_string()));
    add(
        "two-sided",
        match patches.two_sided {
            AutoSwitch::Auto => None,
            AutoSwitch::On => Some("on".to_owned()),
            AutoSwitch::Off => Some("off".to_owned()),
        },
    );
    for glob in &patches.flip {
        add("flip", Some(word(glob.as_ref())));
    }
    for glob in &patches.exclude {
        add("exclude", Some(word(glob.as_ref())));
    }
    add(
        "up",
        patches.up.map(|axis| {
            match axis {
                UpAxis::X => "x",
                UpAxis::Y => "y",
                UpAxis::Z => "z",
            }
            .to_owned()
        }),
    );
    add("scale", (patches.scale != 1.0).then(|| patches.scale.to_string()));
    add(
        "backend",
        (engine.backend != "auto").then(|| word(engine.backend.as_ref())),
    );
    for option in &engine.backend_option {
        add("backend-option", Some(word(option.as_ref())));
    }
    add("threads", (engine.threads != 0).then(|| engine.threads.to_string()));
    if patches.keep_duplicates == Switch::On {
        words.push("--keep-duplicates".to_owned());
    }
    words
}

fn picture(report: &Report, recommended: Option<&Recommendation>, path: &Path) -> Picture {
    let name = path
        .file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Picture {
        title: format!("{name}: error against time"),
        subtitle: format!(
            "{} · {}, {} · {}, seed {}",
            counted(report.patches, "patch"),
            report.backend.device,
            counted(report.threads as u64, "thread"),
            counted(report.sampled_rows as u64, "random row"),
            report.seed,
        ),
        marks: report
            .trials
            .iter()
            .map(|trial| Mark {
                family: trial.setting.family(),
                name: trial.name.clone(),
                milliseconds: trial.milliseconds(),
                error: trial.measured.relative_frobenius,
                low: trial.measured.interval_of_rows.low,
                high: trial.measured.interval_of_rows.high,
                front: trial.is_on_front(),
                recommended: recommended.is_some_and(|best| best.name == trial.name),
            })
            .collect(),
        tolerance: report.tolerance,
        noise: report.reference.noise,
    }
}

#[cfg(test)]
mod tests {
    use super::setting::Rung;
    use super::trial::Timing;
    use super::*;
    use crate::command_line::{Cli, Command};
    use clap::Parser;
    use hemicube::reference::{Interval, Measured};

    fn arguments(words: &[&str]) -> Arguments {
        let words = ["hemicube", "tradeoff", "a b.obj"].iter().chain(words);
        match Cli::try_parse_from(words).expect("good words").command {
            Command::Tradeoff(arguments) => *arguments,
            other => panic!("{other:?}"),
        }
    }

    fn trial(setting: Setting, milliseconds: f64, error: f64) -> Trial {
        Trial {
            name: setting.name(),
            rung: "pixel",
            tolerance: match setting.rung {
                Rung::Tolerance(tolerance) => Some(tolerance),
                Rung::Pixel => None,
            },
            samples: 1,
            resolution: setting.resolution,
            words: setting.words(),
            entries: 0,
            measured: Measured {
                relative_frobenius: 0.9 * error,
                interval_of_rows: Interval {
                    low: 0.8 * error,
                    high: error,
                },
                ..Measured::default()
            },
            timing: Some(Timing {
                milliseconds_per_row: milliseconds,
                seconds_for_all_rows: 0.0,
                repeats: 1,
                front: false,
            }),
            setting,
        }
    }

    fn pixels(samples_per_edge: u32) -> Setting {
        Setting {
            rung: Rung::Pixel,
            resolution: 128,
            samples_per_edge,
        }
    }

    fn within(tolerance: f64) -> Setting {
        Setting {
            rung: Rung::Tolerance(tolerance),
            resolution: RESOLUTION_OF_TOLERANCE,
            samples_per_edge: 1,
        }
    }

    #[test]
    fn what_is_tried_has_distinct_names_and_the_tolerance_asked_for() {
        for (asked, more) in [(0.01, 0), (0.007, 1), (0.3 / 100.0, 0)] {
            let tried = settings(Tolerance(asked));
            assert_eq!(tried.len(), 12 + 6 + more);
            assert!(
                tried
                    .iter()
                    .any(|s| matches!(s.rung, Rung::Tolerance(t) if is_same(t, asked)))
            );
            let mut names: Vec<String> = tried.iter().map(|s| s.name()).collect();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), tried.len());
        }
    }

    #[test]
    fn every_setting_is_a_good_command_line() {
        for setting in settings(Tolerance(0.0123)) {
            let words = setting.words();
            let line = ["hemicube", "compute", "a.obj", "-o", "b"]
                .into_iter()
                .chain(words.split(' '));
            let Command::Compute(compute) = Cli::try_parse_from(line).expect(&words).command else {
                panic!("{words}");
            };
            let render = compute.render;
            match setting.rung {
                Rung::Pixel => assert_eq!(
                    (render.tolerance(), render.samples.per_edge),
                    (None, setting.samples_per_edge)
                ),
                Rung::Tolerance(t) => assert!(render.tolerance().is_some_and(|read| is_same(read.0, t)), "{words}"),
            }
        }
    }

    #[test]
    fn the_front_and_the_cheapest_that_is_good_enough() {
        let mut trials = [
            trial(within(0.001), 9.0, 0.001),
            trial(pixels(2), 2.0, 0.03),
            trial(pixels(1), 0.5, 0.02),
            trial(pixels(4), 3.0, 0.0199),
            trial(within(0.01), 1.5, 0.008),
            trial(within(0.02), 1.2, f64::NAN),
        ];
        mark_front(&mut trials);
        let front: Vec<&str> = trials
            .iter()
            .filter(|t| t.is_on_front())
            .map(|t| t.name.as_str())
            .collect();
        assert_eq!(front, ["pixel K=1 N=128", "tolerance 1%", "tolerance 0.1%"]);

        let of = |trials: &[Trial], words: &[&str]| {
            let arguments = arguments(words);
            recommend(trials, &arguments, "x/a b.obj".as_ref(), 1000, 2).map(|best| best.command)
        };
        let recommended = |words: &[&str]| of(&trials, words);
        assert_eq!(
            recommended(&["--tolerance", "1%"]).as_deref(),
            Some("hemicube compute 'x/a b.obj' -o 'a b.hemicube' --tolerance 1%")
        );
        assert_eq!(
            recommended(&["--tolerance", "5%"]).as_deref(),
            Some("hemicube compute 'x/a b.obj' -o 'a b.hemicube' --tolerance 1%"),
            "what promises 5 % goes before what is cheaper"
        );
        let more = [
            "--tolerance",
            "5%",
            "--split",
            "4",
            "--scale",
            "0.5",
            "--keep-duplicates",
        ];
        let sums_of_pixels = [trial(pixels(2), 2.0, 0.03), trial(pixels(1), 0.5, 0.02)];
        assert_eq!(
            of(&sums_of_pixels, &more).as_deref(),
            Some(
                "hemicube compute 'x/a b.obj' -o 'a b.hemicube' --split 4 --scale 0.5 --keep-duplicates \
                 --correction pixel --samples 1 --resolution 128"
            )
        );
        assert_eq!(recommended(&["--tolerance", "0.05%"]), None);
        // The upper end decides, not the estimate.
        assert_eq!(
            recommended(&["--tolerance", "0.75%"])
                .as_deref()
                .map(|c| c.ends_with("0.1%")),
            Some(true)
        );
    }

    #[test]
    fn what_is_absurd_is_known_beforehand() {
        let most = |triangles| {
            let nominal = settings(Tolerance(0.01))
                .into_iter()
                .map(|s| s.nominal(triangles, 100.0) * 24.0e-3);
            nominal.fold(0.0, f64::max)
        };
        assert!(most(2_000.0) < SECONDS_MOST && most(5e6) > SECONDS_MOST);
    }
}
