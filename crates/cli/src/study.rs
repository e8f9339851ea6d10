//! The study of Vázquez and Guartes 2017, repeated on this machine and its backends and extended by
//! mazes, open scenes, parameters found by backends, and error against rays.
//!
//! The unit is a *cell*: a scene, a backend, a way. `results.rs` keeps cells in `study.json` by machine, version and
//! settings as they are measured. `tables.rs` and `plots.rs` make the report, of a finished study or not.
//!
//! The ways of a scene and backend take turns over the same rows: runs of neighbours spread over the order of work, as
//! many as the slowest has time for. A backend's findings are measured anew beside the fastest of the tables, over rows
//! and in turns of their own. Error against time comes from `tradeoff`. Whole runs are processes of this program,
//! watched from outside.

mod measure;
mod plots;
mod results;
mod scenes;
mod tables;
mod ways;

use crate::args::{Auto, Talk, positive, resolution};
use crate::exit::{self, Exit};
use crate::help::examples;
use crate::picture::sheet::{Format, Marker, color};
use crate::progress::Bar;
use crate::report::{count, counted, print};
use anyhow::{Context, Result};
use clap::{Parser, ValueEnum};
use measure::Bench;
use plots::{Diagram, Panel, Series, error_against_time, heat_map, memory_over_time};
use results::{Cell, Results, Settings};
use scenes::{CITY, Role, Size, StudyScene, scenes};
use serde::Deserialize;
use std::ffi::OsString;
use std::path::PathBuf;
use tables::{Grid, Study};
use ways::{
    FLAT, FOUND_CULLING, FOUND_PARAMETERS, ORIGINAL, OURS, THESIS, Target, Way, findings, targets, ways,
    with_parameters,
};

const EXAMPLES: &str = "  \
  study --quick
  study -o study --scenes ../shared/scenes";

/// Repeat the study of algorithms on this machine: tables and pictures
#[derive(Debug, Parser)]
#[command(name = "study", version, after_long_help = examples(EXAMPLES, false))]
pub(crate) struct Arguments {
    /// The folder for tables, pictures and what was measured; a run that finds some there goes on
    #[arg(short, long, value_name = "DIR", default_value = "hemicube-study")]
    output: PathBuf,
    /// Less of everything, in under five minutes
    #[arg(long)]
    quick: bool,
    /// A backend to measure: cpu, gl, vulkan, wgpu, or a file (repeatable; all that open otherwise)
    #[arg(long, value_name = "NAME|PATH")]
    backend: Vec<String>,
    /// A folder with `denhaag-8897.obj`, or `city/denhaag-8897.obj`, to measure as well
    #[arg(long, value_name = "DIR", env = "HEMICUBE_SCENES", hide_env = true)]
    scenes: Option<PathBuf>,
    /// Only these scenes, by their names in `study.json` (repeatable)
    #[arg(long, value_name = "NAME", hide_short_help = true)]
    scene: Vec<String>,
    /// Patches of the city, by which all generated scenes are sized
    #[arg(
        long,
        value_name = "N",
        default_value_t = CITY,
        value_parser = clap::value_parser!(u64).range(10..=100_000),
        hide_short_help = true
    )]
    patches: u64,
    /// Pixels along an edge of a hemicube
    #[arg(long, value_name = "auto|N", default_value = "auto", value_parser = resolution, hide_short_help = true)]
    resolution: Auto,
    /// The most rows of a cell
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), hide_short_help = true)]
    rows: Option<u32>,
    /// Seconds that the slowest way of a cell may take, by which the rows are chosen
    #[arg(long, value_name = "S", value_parser = positive, hide_short_help = true)]
    seconds: Option<f64>,
    /// What others measured on the same scenes, from `scripts/peers`
    #[arg(long, value_name = "FILE")]
    peers: Option<PathBuf>,
    /// What the report says that it is of, a commit for example
    #[arg(long, value_name = "TEXT")]
    label: Option<String>,
    /// The pictures' format
    #[arg(long, value_name = "svg|png", default_value = "svg", hide_possible_values = true)]
    pictures: Pictures,
    #[command(flatten)]
    talk: Talk,
}

/// Format of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Pictures {
    /// Lines and letters.
    Svg,
    /// Pixels.
    Png,
}

impl Pictures {
    fn format(self) -> (Format, &'static str) {
        match self {
            Self::Svg => (Format::Svg, "svg"),
            Self::Png => (Format::Png, "png"),
        }
    }
}

/// Results of a peer, from `scripts/peers`.
#[derive(Clone, Debug, Deserialize)]
struct Peer {
    scene: String,
    peer: String,
    setting: String,
    milliseconds: f64,
    error: f64,
    bytes: u64,
    row_sum_error: f64,
}

/// The file of `scripts/peers`.
#[derive(Clone, Debug, Default, Deserialize)]
struct Peers {
    peers: Vec<Peer>,
    #[serde(default)]
    without: Vec<String>,
}

/// Built-in resolution of `compute` for visible fractions.
const RESOLUTION: u32 = 128;
/// Rows of a whole, watched run.
const ROWS_OF_RUN: u64 = 10_240;

/// Octree levels and least patches tried on a scene: the thesis's, and some with cheap queries.
fn grid(size: Size, scene: &StudyScene) -> Option<Grid> {
    let (levels, least): (&[u32], &[u32]) = match (size, scene.role) {
        (_, Role::Step) => return None,
        (Size::Quick, Role::City) => (&[3, 10], &[64, 600]),
        (Size::Quick, _) => return None,
        (Size::Full, Role::Venice) => (&[1, 2, 3, 4, 5, 8], &[64, 500, 1000, 2000]),
        (Size::Full, Role::City | Role::Other) => (&[3, 5, 10], &[64, 300, 600, 1000]),
    };
    Some(Grid {
        levels: levels.to_vec(),
        least: least.to_vec(),
    })
}

/// Stages of a study, the most important first: an interrupted one has measured most of the essential.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// *Original*, *thesis*, *ours*; errors, and whole runs.
    Algorithms,
    /// Competitors of the best way.
    Others,
    /// Levels of the octree and least patches.
    Parameters,
    /// Findings beside the best of these, measured anew.
    Choices,
}

const STAGES: [Stage; 4] = [Stage::Algorithms, Stage::Others, Stage::Parameters, Stage::Choices];

/// Ways to measure of a scene by a backend.
fn wanted(stage: Stage, size: Size, scene: &StudyScene, target: &Target) -> Vec<Way> {
    match stage {
        Stage::Algorithms => ways(target, false),
        Stage::Others if scene.role != Role::Step && (size == Size::Full || target.is_built_in()) => ways(target, true),
        Stage::Parameters if target.has_thesis() => grid(size, scene).map_or_else(Vec::new, |grid| {
            let pairs = grid
                .levels
                .iter()
                .flat_map(|&l| grid.least.iter().map(move |&m| (l, m)));
            pairs.map(|(l, m)| with_parameters(target, l, m)).collect()
        }),
        Stage::Others | Stage::Parameters | Stage::Choices => Vec::new(),
    }
}

/// Returns whether the error of a scene is measured.
fn is_for_errors(size: Size, scene: &StudyScene) -> bool {
    match size {
        Size::Quick => scene.key == "city",
        Size::Full => ["room-1k", "city-1k", "room", "city", "maze", "denhaag-8897"].contains(&scene.key.as_str()),
    }
}

/// Returns whether a whole run of a scene is watched.
fn is_for_runs(scene: &StudyScene) -> bool {
    ["room", "city"].contains(&scene.key.as_str())
}

/// Parses a command line of the study, and runs it.
pub(crate) fn run_line(words: impl IntoIterator<Item = OsString>) -> Result<Exit> {
    let arguments = Arguments::parse_from(words);
    let talk = arguments.talk;
    crate::log::start(talk);
    run(&arguments, talk)
}

fn run(arguments: &Arguments, talk: Talk) -> Result<Exit> {
    let size = if arguments.quick { Size::Quick } else { Size::Full };
    let settings = Settings {
        city: arguments.patches,
        resolution: arguments.resolution.or(RESOLUTION),
        rows: arguments.rows.unwrap_or(if arguments.quick { 128 } else { 512 }),
        turns: if arguments.quick { Settings::QUICK_TURNS } else { 3 },
        seconds: arguments.seconds.unwrap_or(if arguments.quick { 1.5 } else { 6.0 }),
        sample_rows: if arguments.quick { 6 } else { 24 },
    };
    let peers: Peers = match &arguments.peers {
        None => Peers::default(),
        Some(file) => {
            let text =
                hemicube_scene::read_regular(file).with_context(|| format!("`{}` cannot be read", file.display()))?;
            serde_json::from_slice(&text)
                .with_context(|| format!("`{}` is not what `scripts/peers` writes", file.display()))?
        }
    };
    let (targets, without) = targets(&arguments.backend)?;
    let mut scenes = scenes(size, arguments.patches, arguments.scenes.as_deref())?;
    if !arguments.scene.is_empty() {
        for name in &arguments.scene {
            if !scenes.iter().any(|scene| scene.key == *name) {
                let known: Vec<&str> = scenes.iter().map(|scene| scene.key.as_str()).collect();
                anyhow::bail!("the study has no scene `{name}`; it has {}", known.join(", "));
            }
        }
        scenes.retain(|scene| arguments.scene.contains(&scene.key));
    }
    let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
    let results = Results::open(&arguments.output, arguments.label.clone(), settings)?;
    let guard = exit::InterruptGuard::new();
    let mut bench = Bench { results, cancel };
    let done = measure_all(&mut bench, size, &scenes, &targets, talk)?;
    bench.results.save()?;
    let study = Study {
        results: &bench.results,
        scenes: &scenes,
        targets: &targets,
        grid: &|scene| grid(size, scene),
    };
    write_report(&study, &without, &peers, arguments)?;
    drop(guard);
    print(&format!("{}\n{}\n", about_rows(&settings), study.algorithms()))?;
    let place = arguments.output.join("study.md");
    talk.say(&format!(
        "{} measured; everything is in `{}`",
        counted(bench.results.measured as u64, "cell"),
        place.display()
    ));
    if !done {
        talk.say("interrupted: the same command goes on where this stopped");
        return Ok(Exit::Interrupted);
    }
    Ok(Exit::Done)
}

/// Measures the missing cells; returns whether it came to the end.
fn measure_all(
    bench: &mut Bench<'_>,
    size: Size,
    scenes: &[StudyScene],
    targets: &[Target],
    talk: Talk,
) -> Result<bool> {
    let bar = Bar::counting(talk, (STAGES.len() * scenes.len()) as u64, "steps");
    let mut step = 0;
    for stage in STAGES {
        for scene in scenes {
            bar.at(step);
            step += 1;
            talk.detail(&format!("{stage:?}: {}", scene.title));
            if !measure_scene(bench, stage, size, scene, targets, talk)? {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// Measures the missing cells of a scene at a stage.
fn measure_scene(
    bench: &mut Bench<'_>,
    stage: Stage,
    size: Size,
    scene: &StudyScene,
    targets: &[Target],
    talk: Talk,
) -> Result<bool> {
    if stage == Stage::Choices {
        return measure_choices(bench, size, scene, targets, talk);
    }
    let is_missing = |target: &Target| {
        let is_there = |way: &Way| bench.results.get(&[&scene.key, &target.name, &way.key()]).is_some();
        wanted(stage, size, scene, target).iter().any(|way| !is_there(way))
    };
    let missing: Vec<&Target> = targets.iter().filter(|target| is_missing(target)).collect();
    if !missing.is_empty() {
        let ready = scene.ready()?;
        for target in missing {
            match bench.rates(scene, &ready, target, wanted(stage, size, scene, target)) {
                Ok(None) => {}
                Ok(Some(measure::Stopped)) => return Ok(false),
                // One driver's failure loses only its own cells; the report names it.
                Err(error) => {
                    let reason = format!("{error:#}");
                    talk.warn(&format!("{}, `{}`: {reason}", scene.title, target.name));
                    for way in wanted(stage, size, scene, target) {
                        let key = [scene.key.as_str(), &target.name, &way.key()];
                        if bench.results.get(&key).is_none() {
                            bench.results.put(&key, Cell::None(reason.clone()));
                        }
                    }
                }
            }
        }
    }
    if stage != Stage::Algorithms {
        return Ok(!bench.is_stopped());
    }
    if is_for_errors(size, scene) && bench.accuracy(scene, Talk::SILENT)?.is_some() {
        return Ok(false);
    }
    if is_for_runs(scene) {
        for target in targets {
            // A driver on the processor would take minutes to show nothing new.
            let rows = if target.is_built_in() {
                ROWS_OF_RUN
            } else {
                ROWS_OF_RUN / 8
            };
            for way in ways(target, false) {
                let is_shown = [ORIGINAL, THESIS, OURS].contains(&way.name.as_str());
                let is_wanted = is_shown && (size == Size::Full || target.is_built_in());
                if is_wanted && bench.course(scene, target, &way, rows)?.is_some() {
                    return Ok(false);
                }
            }
        }
    }
    Ok(!bench.is_stopped())
}

/// Measures findings with their rivals' cells present, unless measured already.
fn measure_choices(
    bench: &mut Bench<'_>,
    size: Size,
    scene: &StudyScene,
    targets: &[Target],
    talk: Talk,
) -> Result<bool> {
    let mut ready = None;
    for target in targets {
        let parameters = wanted(Stage::Parameters, size, scene, target);
        // Without rivals, a choice has nothing to compete with.
        let are_tried = !wanted(Stage::Others, size, scene, target).is_empty();
        let findings = findings(target, parameters).into_iter();
        for finding in findings.filter(|finding| finding.key != FOUND_CULLING || are_tried) {
            let Some(rivals) = bench.fastest(scene, target, &finding) else {
                continue;
            };
            let ready = match &mut ready {
                Some(ready) => ready,
                none => none.insert(scene.ready()?),
            };
            match bench.choice(scene, ready, target, &finding, &rivals) {
                Ok(None) => {}
                Ok(Some(measure::Stopped)) => return Ok(false),
                Err(error) => {
                    let reason = format!("{error:#}");
                    talk.warn(&format!("{}, `{}`: {reason}", scene.title, target.name));
                    bench
                        .results
                        .put(&[&scene.key, &target.name, finding.key], Cell::None(reason));
                }
            }
        }
    }
    Ok(!bench.is_stopped())
}

fn about_rows(settings: &Settings) -> String {
    format!(
        "Milliseconds of processor time a row at N = {} (of the clock on the wall for a GPU), the least of {} turns.\n\
         occlusion: patches of the scene for each one that a row sees.\n",
        settings.resolution, settings.turns
    )
}

/// Writes the tables and the pictures.
fn write_report(study: &Study<'_>, without: &[String], peers: &Peers, arguments: &Arguments) -> Result<()> {
    let results = study.results;
    let (format, extension) = arguments.pictures.format();
    let mut pictures = Vec::new();
    let mut keep = |name: &str, says: &str, bytes: Vec<u8>| -> Result<()> {
        let file = format!("{name}.{extension}");
        results.write(&file, &bytes)?;
        pictures.push(format!("![{says}]({file})\n"));
        Ok(())
    };
    let subtitle = format!(
        "{}, {} threads · {}",
        results.machine.processor,
        results.machine.threads,
        named(results)
    );
    for scene in study.scenes {
        if let Some(Cell::Accuracy(accuracy)) = results.get(&[&scene.key, "cpu", "error"]) {
            let title = format!("{}: error against time", scene.title);
            let about = format!(
                "{} patches, {} random rows · {subtitle}",
                count(accuracy.patches),
                count(accuracy.rows)
            );
            let picture = error_against_time(title.clone(), about, accuracy, &of_peers(peers, scene));
            keep(
                &format!("error-against-time-{}", scene.key),
                &title,
                picture.draw(format)?,
            )?;
        }
    }
    if let Some(picture) = time_against_patches(study, &subtitle) {
        keep(
            "time-against-patches",
            "time of a row against the number of patches",
            picture.draw(format)?,
        )?;
    }
    if let Some(picture) = gain_against_occlusion(study, &subtitle) {
        keep(
            "gain-against-occlusion",
            "speed-up against the occlusion of the scene",
            picture.draw(format)?,
        )?;
    }
    for target in study.targets {
        let panels = panels(study, target);
        if !panels.is_empty() {
            let title = format!(
                "Milliseconds a row by octree levels and least patches of a query, `{}`",
                target.name
            );
            let bytes = heat_map(
                &title,
                &format!("dark is fast, each scene on its own scale · {subtitle}"),
                &panels,
                format,
            )?;
            keep(&format!("octree-parameters-{}", target.name), &title, bytes)?;
        }
    }
    let runs = study.runs();
    if !runs.is_empty() {
        let shown: Vec<_> = runs.iter().map(|(name, _, course)| (name.clone(), *course)).collect();
        let bytes = memory_over_time(
            "Memory over time, from the program's start to its end",
            &subtitle,
            &shown,
            format,
        )?;
        keep("memory-over-time", "memory over time", bytes)?;
    }
    let text = report(study, without, peers, &pictures);
    results.write("study.md", text.as_bytes())
}

fn named(results: &Results) -> String {
    match &results.label {
        None => results.program.clone(),
        Some(label) => format!("{}, {label}", results.program),
    }
}

fn report(study: &Study<'_>, without: &[String], peers: &Peers, pictures: &[String]) -> String {
    let results = study.results;
    let mut text = format!(
        "# The study\n\n{}, on {} ({} threads), {}.\n",
        named(results),
        results.machine.processor,
        results.machine.threads,
        results.machine.system
    );
    for target in study.targets {
        text.push_str(&format!("- `{}` {}: {}\n", target.name, target.version, target.device));
    }
    for reason in without {
        text.push_str(&format!("- without {reason}\n"));
    }
    let mut add = |heading: &str, about: &str, body: &str| {
        if !body.is_empty() {
            text.push_str(&format!(
                "\n## {heading}\n\n{about}\n\n{}\n",
                body.trim_start_matches('\n')
            ));
        }
    };
    let about = about_rows(&results.settings);
    add("Algorithms compared (table 4.6)", about.trim(), &study.algorithms());
    add(
        "Octree levels and least patches (tables 4.3 to 4.5)",
        "The thesis's way with each pair of parameters; best in bold.",
        &study.parameters(),
    );
    add(
        "What finds itself",
        "What a backend comes to without being told, beside the best of everything that was tried on that scene. The \
         fastest of those tables (four, or two in scenes of more than 400,000 patches, and none that took half as \
         long again as the first) are measured anew with what is found, all in the same turns over the same rows: as \
         many as there is time for, in twice as many turns and, but for a quick study, more, until four have made no \
         way's least time less by a hundredth, sixteen neighbours at a place and, from sixteen places on, up to 256, \
         as a run goes through them. Such times can be compared with each other, and not with those of the tables. \
         The built-in backend has the octree for comparison only, so that nothing is to be found for it.",
        &study.found(),
    );
    add(
        "Without the octree, and what the octree gains (tables 4.7 and 4.8)",
        "The built-in backend has no bus to save, so that without its tree it is *original*.",
        &study.octree(),
    );
    add(
        "Processors and the bus (section 4.3.1)",
        "Of a software driver, processors busy are its own threads.",
        &study.processors(),
    );
    add(
        "Memory over time (figures 4.7 and 4.8)",
        "Whole runs of `hemicube compute`, seen from outside.",
        &study.memory(),
    );
    add(
        "Distances (table 4.9)",
        "‖F − F of original‖ / ‖F of original‖, Frobenius, over the rows measured. The thesis has 0.0033 to 0.0056 \
         between its two.",
        &study.distances(),
    );
    add(
        "Error against rays",
        "Relative Frobenius error of the rows, and what a row takes on one thread of the built-in backend (the clock \
         on the wall, the least of up to five).",
        &study.errors(),
    );
    add("Peers", "Same scenes, from `scripts/peers`.", &peers_table(peers));
    add("Pictures", "", &pictures.join("\n"));
    let failures = study.failures();
    if !failures.is_empty() {
        let lines: Vec<String> = failures.iter().map(|line| format!("- {line}")).collect();
        add("What did not work", "", &lines.join("\n"));
    }
    text
}

fn peers_table(peers: &Peers) -> String {
    let mut text = String::new();
    if !peers.peers.is_empty() {
        text.push_str(
            "| scene | peer | setting | ms a row | error | row sums off by | memory |\n|---|---|---|---|---|---|---|\n",
        );
        for peer in &peers.peers {
            text.push_str(&format!(
                "| {} | {} | {} | {} | {} | {} | {} |\n",
                peer.scene,
                peer.peer,
                peer.setting,
                crate::report::figures(peer.milliseconds),
                crate::report::percent(peer.error),
                crate::report::figures(peer.row_sum_error),
                crate::report::size(peer.bytes)
            ));
        }
    }
    for reason in &peers.without {
        text.push_str(&format!("\nwithout {reason}\n"));
    }
    text
}

/// Peers on a scene: milliseconds and error of each setting.
fn of_peers(peers: &Peers, scene: &StudyScene) -> Vec<(String, Vec<(f64, f64)>)> {
    let mut found: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
    for peer in peers
        .peers
        .iter()
        .filter(|peer| peer.scene == scene.key && peer.error > 0.0)
    {
        let point = (peer.milliseconds, peer.error);
        match found.iter_mut().find(|(name, _)| *name == peer.peer) {
            Some((_, points)) => points.push(point),
            None => found.push((peer.peer.clone(), vec![point])),
        }
    }
    found
}

fn marker(way: &str) -> Marker {
    match way {
        ORIGINAL => Marker::Disc,
        THESIS => Marker::Diamond,
        FLAT => Marker::Down,
        _ => Marker::Square,
    }
}

/// Time of a row against the number of patches, over cities of several sizes.
fn time_against_patches(study: &Study<'_>, subtitle: &str) -> Option<Diagram> {
    let mut series = Vec::new();
    for (place, target) in study.targets.iter().enumerate() {
        for way in [ORIGINAL, THESIS, OURS] {
            let is_city = |scene: &&StudyScene| scene.key.starts_with("city");
            let rates = study
                .scenes
                .iter()
                .filter(is_city)
                .filter_map(|s| study.rate(s, target, way));
            let mut points: Vec<_> = rates
                .map(|rate| (rate.patches as f64, rate.milliseconds, None))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            if points.len() > 1 {
                series.push(Series {
                    name: format!("{way} on {}", target.name),
                    color: color(place),
                    marker: marker(way),
                    joined: true,
                    points,
                });
            }
        }
    }
    (!series.is_empty()).then(|| Diagram {
        title: "Time of a row against the number of patches: generated cities".to_owned(),
        subtitle: subtitle.to_owned(),
        x: "patches of the city (logarithmic)",
        y: "milliseconds of processor time a row (logarithmic; further down is faster)",
        unit: " ms",
        level: None,
        series,
    })
}

/// Speedup over the original, against the hidden share of the scene.
fn gain_against_occlusion(study: &Study<'_>, subtitle: &str) -> Option<Diagram> {
    let mut series = Vec::new();
    for (place, target) in study.targets.iter().enumerate() {
        for way in [THESIS, OURS] {
            let point = |scene: &StudyScene| {
                let (original, rate) = (study.rate(scene, target, ORIGINAL)?, study.rate(scene, target, way)?);
                let label = (way == OURS && target.is_built_in()).then(|| scene.title.clone());
                let occlusion = original.patches as f64 / original.seen.max(1e-9);
                Some((occlusion, original.milliseconds / rate.milliseconds, label))
            };
            let points: Vec<_> = study.scenes.iter().filter_map(point).collect();
            if !points.is_empty() {
                series.push(Series {
                    name: format!("{way} on {}", target.name),
                    color: color(place),
                    marker: marker(way),
                    joined: false,
                    points,
                });
            }
        }
    }
    (!series.is_empty()).then(|| Diagram {
        title: "Speed-up over the original against the occlusion of the scene".to_owned(),
        subtitle: subtitle.to_owned(),
        x: "occlusion: patches of the scene for each one that a row sees (logarithmic)",
        y: "times as fast as the original, which draws everything (logarithmic; above 1 is a gain)",
        unit: "×",
        level: Some((1.0, "as fast as the original".to_owned())),
        series,
    })
}

fn panels(study: &Study<'_>, target: &Target) -> Vec<Panel> {
    let panel = |scene: &StudyScene| {
        let tried = study.tried(scene, target);
        let grid = (study.grid)(scene).filter(|_| !tried.is_empty())?;
        let pairs = grid
            .levels
            .iter()
            .flat_map(|&l| grid.least.iter().map(move |&m| (l, m)));
        let at = |(l, m)| tried.iter().find(|t| (t.0, t.1) == (l, m)).map(|t| t.2.milliseconds);
        Some(Panel {
            title: format!("{}, {} patches", scene.title, count(tried.first()?.2.patches)),
            milliseconds: pairs.map(at).collect(),
            found: study
                .results
                .choice(&scene.key, &target.name, FOUND_PARAMETERS)
                .and_then(|choice| Some(choice.found_milliseconds / choice.best()?.1)),
            levels: grid.levels.clone(),
            least: grid.least.clone(),
        })
    };
    study.scenes.iter().filter_map(panel).collect()
}
