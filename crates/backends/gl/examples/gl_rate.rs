//! Hemicubes a second, where the time goes and what was culled, for the baselines and the best: `rate [RESOLUTION [ROWS
//! [SCENE [PATCHES]]]]`, `SCENE` one of `room`, `block-city` or a file, `PATCHES` a target count or, for a file, into how many
//! each edge is cut. `COVERED=1` with covered weights; `OPTIONS=…` measures these options instead.
//!
//! Processor time of the whole process, the best of three turns: a software driver has threads of its own.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_gl::Session;
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, generate};
use hemicube_scene::{Patches, ReadOptions, Subdivision, load};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: u32| args.get(i).map_or(Ok(default), |a| a.parse::<u32>());
    let (resolution, rows, amount) = (number(0, 128)?, number(1, 256)?, number(3, 10_000)?);
    let (scene, split) = match args.get(2).map_or("room", String::as_str) {
        "room" => (
            generate(Generate {
                kind: Kind::Room,
                target_patches: u64::from(amount),
                seed: 1,
            })?,
            1,
        ),
        "block-city" => {
            let parameters = BlockCityParameters::for_target(u64::from(amount), 1);
            let split = if amount > 9000 { 4 } else { 1 };
            (BlockCityParameters { split, ..parameters }.generate()?, 1)
        }
        file => (load(file.as_ref(), ReadOptions::default())?, amount.clamp(1, 64)),
    };
    let patches = Patches::new(&scene, Subdivision::Split(split))?;
    let model = Model::new(patches.into(), HierarchyOptions::default())?;
    let order: Vec<_> = model.order().collect();
    // Runs of 32 consecutive patches, spread over the order of work.
    let runs = (rows as usize / 32).max(1);
    let hemicubes: Vec<_> = (0..runs)
        .flat_map(|r| order[r * order.len() / runs..].iter().take(32))
        .flat_map(|&p| model.hemicubes(p, 1, true))
        .collect();
    println!(
        "{} patches, N = {resolution}, {} hemicubes",
        order.len(),
        hemicubes.len()
    );
    let covered = std::env::var("COVERED").is_ok();
    let given = std::env::var("OPTIONS").ok();
    let options: Vec<&str> = match &given {
        Some(given) => given.split(';').collect(),
        None => vec![
            "baseline=original",
            "baseline=thesis",
            "",
            "cull=view",
            "cull=queries",
            "cull=depth",
        ],
    };
    let mut first = None;
    for options in options {
        let settings = RenderSettings {
            resolution,
            culling: Culling::On,
            covered: covered && !options.contains("baseline"),
        };
        let mut session = Session::open(0, options)?;
        session.load(model.geometry(), settings)?;
        let mut block = RowBlock::default();
        let (mut cpu, mut wall) = (f64::INFINITY, f64::INFINITY);
        let mut counters = Default::default();
        for _ in 0..3 {
            block.clear();
            let (start, clock) = (process_seconds(), Instant::now());
            counters = session.rows(&hemicubes, &mut block)?;
            cpu = cpu.min(process_seconds() - start);
            wall = wall.min(clock.elapsed().as_secs_f64());
        }
        block.check(hemicubes.len(), model.geometry().patch_count, settings.covered)?;
        let timed = [options, "timing=on"]
            .iter()
            .filter(|o| !o.is_empty())
            .copied()
            .collect::<Vec<_>>()
            .join(",");
        let mut timed = Session::open(0, &timed)?;
        timed.load(model.geometry(), settings)?;
        let count = hemicubes.len() as f64;
        let mut stages = [u64::MAX; 5];
        let mut before = [0; 5];
        for _ in 0..3 {
            timed.rows(&hemicubes, &mut RowBlock::default())?;
            let t = timed.stage_times();
            let now = [t.cull, t.render, t.cover, t.reduce, t.read_back];
            for k in 0..5 {
                stages[k] = stages[k].min(now[k] - before[k]);
            }
            before = now;
        }
        let [cull, render, cover, reduce, read_back] = stages.map(|ns| ns as f64 / count * 1e-3);
        let per = |n: u64| n as f64 / count;
        let hash = block.visible.iter().zip(&block.patches).fold(0u64, |h, (&v, &p)| {
            (h ^ (u64::from(v) << 32 | u64::from(p)))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                .rotate_left(23)
        });
        let first = *first.get_or_insert(cpu);
        println!(
            "{:<18} {:6.0} hemicubes/s ({:5.0} µs; {:4.2}× the first; wall {:5.0}): cull {cull:.0} render {render:.0} cover {cover:.0} reduce {reduce:.0} back {read_back:.0} µs; nodes {:.0}, outside {:.0}, hidden {:.0}; triangles {:.0} + {:.0}; queries {:.0}; {:.0} B back, {:.0} entries; hash {:06x}",
            if options.is_empty() { "best" } else { options },
            count / cpu,
            cpu / count * 1e6,
            first / cpu,
            wall / count * 1e6,
            per(counters.nodes_tested),
            per(counters.nodes_outside),
            per(counters.nodes_hidden),
            per(counters.triangles_drawn),
            per(counters.triangles_transformed - counters.triangles_drawn),
            per(counters.queries),
            per(counters.bytes_read_back),
            block.patches.len() as f64 / count,
            hash >> 40,
        );
        if std::env::var("CONTEXTS").is_ok() {
            // By the clock on the wall: for an idle machine.
            let mut sessions = [session.fork()?, session.fork()?];
            for session in &mut sessions {
                // Drivers compile shaders when they are first used.
                session.rows(&hemicubes, &mut RowBlock::default())?;
            }
            let clock = Instant::now();
            std::thread::scope(|scope| {
                for session in &mut sessions {
                    scope.spawn(|| session.rows(&hemicubes, &mut RowBlock::default()));
                }
            });
            let two = clock.elapsed().as_secs_f64() / 2.0;
            println!("    two contexts: {:.2}× one", wall / two);
        }
        for choice in session.choices() {
            println!("    {choice}");
        }
    }
    Ok(())
}

/// Processor time of this process, all threads; the clock on the wall where the system does not tell.
fn process_seconds() -> f64 {
    let of_process = || {
        let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
        let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
        // Fields 14 and 15 of proc(5), in hundredths of a second.
        Some((fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?) * 0.01)
    };
    of_process().unwrap_or_else(|| std::time::UNIX_EPOCH.elapsed().map_or(0.0, |d| d.as_secs_f64()))
}
