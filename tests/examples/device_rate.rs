//! What hemicubes cost on every backend, and where the time goes: the tables of docs/dev/gpu.md.
//!
//! `device_rate [RESOLUTION [ROWS [SCENE… [WAY…]]]]`: a scene is `room`, `denhaag` (`denhaag-8897`), `denhaag16` (its
//! triangles in 16), `denhaag169` (in 169) or `block-city`; a way is a backend and its options, `gl:baseline=thesis`.
//! Without scenes the first three, without ways those that the page compares. Plugins are those of
//! `cargo build --release --workspace`; one without a device is said and left out. Variables: `COVERED=1`, with covered
//! weights; `TWO=1`, two sessions on two threads against one, by the clock on the wall, so only on an idle machine or
//! ahead of all else (`chrt -r 1`); with it, how many processors they kept busy.
//!
//! Time is processor time of all threads, the less of three turns, so that other programs count little: on software the
//! GPU is the processor. On a GPU the clock on the wall is the one that tells.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube::Model;
use hemicube::backend::{Counters, Culling, Hemicube, HemicubeBackend, RenderSettings, StageTimes};
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::Kind;
use hemicube_tests::devices::neighbours;
use hemicube_tests::plugins::{self, try_session};
use hemicube_tests::scenes::{generated, model, read, scenes_dir};
use std::error::Error;
use std::time::Instant;

type Session = Box<dyn HemicubeBackend>;

const SCENES: [&str; 5] = ["room", "denhaag", "denhaag16", "denhaag169", "block-city"];

const WAYS: [&str; 9] = [
    "gl:baseline=original",
    "gl:baseline=thesis",
    "gl",
    "vulkan:cull=off",
    "vulkan:cull=frustum",
    "vulkan",
    "wgpu:cull=off",
    "wgpu",
    "cpu",
];

fn scene(name: &str) -> Result<Model, Box<dyn Error>> {
    let tile = |subdivision| -> Result<_, Box<dyn Error>> {
        let folder = scenes_dir().ok_or("no ../shared/scenes; HEMICUBE_SCENES names another folder")?;
        Ok(model(read(&folder, "city/denhaag-8897.obj")?, subdivision))
    };
    Ok(match name {
        "room" => generated(Kind::Room, 10_000),
        "block-city" => generated(Kind::BlockCity, 140_000),
        "denhaag" => tile(Subdivision::None)?,
        "denhaag16" => tile(Subdivision::Levels(2))?,
        "denhaag169" => tile(Subdivision::Split(13))?,
        other => return Err(format!("`{other}` is no scene").into()),
    })
}

fn open(way: &str, further: &[&str]) -> Result<Session, Box<dyn Error>> {
    let (backend, options) = way.split_once(':').unwrap_or((way, ""));
    let options: Vec<&str> = options
        .split(',')
        .filter(|o| !o.is_empty())
        .chain(further.iter().copied())
        .collect();
    Ok(match backend {
        "cpu" => Box::new(CpuBackend::new()),
        name => Box::new(try_session(&plugins::rust(name), &options)?),
    })
}

/// Seconds that this process's threads have been on a processor.
fn processor_seconds() -> f64 {
    // What a running thread has had since the last tick is counted when it gives way.
    std::thread::yield_now();
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    tasks
        .filter_map(|task| std::fs::read_to_string(task.path().join("schedstat")).ok())
        .filter_map(|text| text.split(' ').next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}

/// What the rows of one way came to.
struct Measured {
    processor: f64,
    wall: f64,
    /// Of a session of its own, in which stages wait for one another.
    stages: StageTimes,
    counters: Counters,
    entries: usize,
    /// Of all rows: two ways with the same have the same bits.
    fingerprint: u64,
    choices: Vec<String>,
}

fn measure(
    way: &str,
    model: &Model,
    hemicubes: &[Hemicube],
    settings: RenderSettings,
) -> Result<Measured, Box<dyn Error>> {
    let mut session = open(way, &[])?;
    session.load(model.geometry(), settings)?;
    let (mut processor, mut wall) = (f64::INFINITY, f64::INFINITY);
    let (mut rows, mut counters) = (RowBlock::default(), Counters::default());
    for _ in 0..3 {
        rows.clear();
        let (start, began) = (processor_seconds(), Instant::now());
        counters = session.rows(hemicubes, &mut rows)?;
        processor = processor.min(processor_seconds() - start);
        wall = wall.min(began.elapsed().as_secs_f64());
    }
    rows.check(hemicubes.len(), model.geometry().patch_count, settings.covered)?;
    let mut timed = if way == "cpu" {
        open(way, &[])?
    } else {
        open(way, &["timing=on"])?
    };
    timed.load(model.geometry(), settings)?;
    timed.rows(hemicubes, &mut RowBlock::default())?;
    let fingerprint = rows
        .patches
        .iter()
        .zip(&rows.visible)
        .fold(0u64, |hash, (&patch, &weight)| {
            (hash ^ (u64::from(weight) << 32 | u64::from(patch)))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                .rotate_left(23)
        });
    Ok(Measured {
        processor,
        wall,
        stages: timed.stage_times(),
        counters,
        entries: rows.patches.len(),
        fingerprint,
        choices: session.choices(),
    })
}

/// Hemicubes a second.
#[derive(Clone, Copy, Default)]
struct Rate {
    by_the_clock: f64,
    /// Of one processor.
    by_the_processor: f64,
}

impl Rate {
    fn max(self, other: Self) -> Self {
        Self {
            by_the_clock: self.by_the_clock.max(other.by_the_clock),
            by_the_processor: self.by_the_processor.max(other.by_the_processor),
        }
    }

    /// Processors that were busy.
    fn busy(self) -> f64 {
        self.by_the_clock / self.by_the_processor
    }
}

/// Hemicubes a second of one session, and of two on two threads.
fn one_and_two(
    way: &str,
    model: &Model,
    hemicubes: &[Hemicube],
    settings: RenderSettings,
) -> Result<(Rate, Rate), Box<dyn Error>> {
    let mut one = open(way, &[])?;
    one.load(model.geometry(), settings)?;
    let mut two = one.fork()?;
    let timed = |sessions: &mut [&mut dyn HemicubeBackend]| {
        let (start, began) = (processor_seconds(), Instant::now());
        std::thread::scope(|scope| {
            let made: Vec<_> = sessions
                .iter_mut()
                .map(|session| scope.spawn(|| session.rows(hemicubes, &mut RowBlock::default())))
                .collect();
            made.into_iter().try_for_each(|thread| {
                thread
                    .join()
                    .map_err(|_| "a thread panicked".to_owned())?
                    .map(|_| ())
                    .map_err(|error| error.to_string())
            })
        })?;
        let rows = hemicubes.len() as f64 * sessions.len() as f64;
        let made = Rate {
            by_the_clock: rows / began.elapsed().as_secs_f64(),
            by_the_processor: rows / (processor_seconds() - start),
        };
        Ok::<_, Box<dyn Error>>(made)
    };
    // In turns; drivers compile shaders in the first.
    let (mut alone, mut both) = (Rate::default(), Rate::default());
    for _ in 0..4 {
        alone = alone.max(timed(&mut [&mut *one])?);
        both = both.max(timed(&mut [&mut *one, &mut *two])?);
    }
    Ok((alone, both))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1).peekable();
    let mut number = |default: u32| match args.next_if(|word| word.parse::<u32>().is_ok()) {
        Some(word) => word.parse(),
        None => Ok(default),
    };
    let (resolution, count) = (number(128)?, number(128)? as usize);
    let (mut scenes, mut ways): (Vec<String>, Vec<String>) = args.partition(|word| SCENES.contains(&word.as_str()));
    if scenes.is_empty() {
        scenes = SCENES[..3].iter().map(ToString::to_string).collect();
    }
    if ways.is_empty() {
        ways = WAYS.iter().map(ToString::to_string).collect();
    }
    let mut there = Vec::new();
    for way in ways {
        match open(&way, &[]) {
            Ok(session) => {
                println!("`{way}`: {}  ", session.info().device);
                there.push(way);
            }
            Err(reason) => println!("`{way}` is left out: {reason}  "),
        }
    }
    let covered = std::env::var_os("COVERED").is_some();
    let two = std::env::var_os("TWO").is_some();
    println!(
        "\nN = {resolution}, {} covered weights\n",
        if covered { "with" } else { "without" }
    );
    if two {
        println!(
            "| scene | way | one session, hemicubes/s | two | times | processors, one | two |\n|{}",
            "---|".repeat(7)
        );
    } else {
        println!(
            "| scene | way | processor, ms | times the first | wall, ms | cull | render | reduce | cover | back | chunks hidden | triangles (ids + depths) | queries | bytes back | entries | bits |"
        );
        println!("|{}", "---|".repeat(16));
    }
    let mut choices = Vec::new();
    for name in scenes {
        let model = scene(&name)?;
        let hemicubes = neighbours(&model, count);
        let mut first = None;
        for way in &there {
            let settings = RenderSettings {
                resolution,
                culling: Culling::On,
                covered: covered && !way.contains("baseline"),
            };
            if two {
                let (alone, both) = one_and_two(way, &model, &hemicubes, settings)?;
                println!(
                    "| {name} | {way} | {:.0} | {:.0} | {:.2} | {:.2} | {:.2} |",
                    alone.by_the_clock,
                    both.by_the_clock,
                    both.by_the_clock / alone.by_the_clock,
                    alone.busy(),
                    both.busy()
                );
                continue;
            }
            let made = measure(way, &model, &hemicubes, settings)?;
            let each = |n: u64| n as f64 / hemicubes.len() as f64;
            let ms = |seconds: f64| seconds * 1e3 / hemicubes.len() as f64;
            let stages = made.stages;
            let stages = [
                stages.cull,
                stages.render,
                stages.reduce,
                stages.cover,
                stages.read_back,
            ];
            let stages = stages.map(|ns| format!("{:.2}", each(ns) * 1e-6)).join(" | ");
            let c = made.counters;
            println!(
                "| {name} | {way} | {:.2} | {:.2} | {:.2} | {stages} | {:.0} | {:.0} + {:.0} | {:.0} | {:.0} | {:.0} | {:06x} |",
                ms(made.processor),
                *first.get_or_insert(made.processor) / made.processor,
                ms(made.wall),
                each(c.nodes_hidden),
                each(c.triangles_drawn),
                each(c.triangles_transformed.saturating_sub(c.triangles_drawn)),
                each(c.queries),
                each(c.bytes_read_back),
                made.entries as f64 / hemicubes.len() as f64,
                made.fingerprint >> 40,
            );
            for choice in made.choices {
                choices.push(format!("- {name}, `{way}`: {choice}"));
            }
        }
    }
    println!("\n{}", choices.join("\n"));
    Ok(())
}
