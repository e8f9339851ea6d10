//! Hemicubes a second of one thread on a scene: `rate KIND PATCHES [RESOLUTION] [ROWS]`, KIND a generated scene or a
//! file, PATCHES a target count or, for a file, into how many each edge is cut.
//!
//! `ISA=Avx512|Avx2|Portable` and `ENGINE=Depth|Claims|Order` leave out the others; with `COVERED=1` only rows with
//! covered weights are measured, with `COVERED=0` only pixel sums; with `FRACTIONS=1` those are rows for fractions;
//! with `WHOLE=0` triangles that were cut are drawn patch by patch.
#![allow(clippy::print_stdout, reason = "an example prints")]

mod clock;

use clock::thread_seconds;
use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice, Isa};
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, generate};
use hemicube_scene::{Patches, ReadOptions, Subdivision, load};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: u32| args.get(i).map_or(Ok(default), |a| a.parse::<u32>());
    let (amount, resolution, rows) = (number(1, 10_000)?, number(2, 256)?, number(3, 256)?);
    let kind = args.first().map_or("room", String::as_str);
    let target_patches = u64::from(amount);
    let spec = |kind| Generate {
        kind,
        target_patches,
        seed: 1,
    };
    let (scene, split) = match kind {
        "room" => (generate(spec(Kind::Room))?, 1),
        "block-city" => (
            BlockCityParameters {
                split: if amount > 9000 { 4 } else { 1 },
                ..BlockCityParameters::for_target(target_patches, 1)
            }
            .generate()?,
            1,
        ),
        "spheres" => (generate(spec(Kind::Spheres))?, 1),
        "soup" => (generate(spec(Kind::Soup))?, 1),
        "maze" => (generate(spec(Kind::Maze))?, 1),
        file => (load(file.as_ref(), ReadOptions::default())?, amount.max(1)),
    };
    let start = Instant::now();
    let patches = Patches::new(&scene, Subdivision::Split(split))?;
    let model = Model::new(patches.into(), HierarchyOptions::default())?;
    let prepared = start.elapsed();
    let order: Vec<_> = model.order().collect();
    println!("{} patches; model {prepared:.2?}", order.len());
    // Runs of 16 consecutive patches, spread over the order of work.
    let runs = (rows as usize / 16).max(1);
    let hemicubes: Vec<_> = (0..runs)
        .flat_map(|r| order[r * order.len() / runs..].iter().take(16))
        .flat_map(|&p| model.hemicubes(p, 1, true))
        .collect();
    let wanted = std::env::var("ISA").ok();
    for isa in Isa::available()
        .into_iter()
        .filter(|i| wanted.as_ref().is_none_or(|w| format!("{i:?}") == *w))
    {
        let settings = [(Culling::On, false), (Culling::On, true), (Culling::Off, false)];
        for (engine, (culling, covered)) in [EngineChoice::Depth, EngineChoice::Claims, EngineChoice::Order]
            .into_iter()
            .filter(|e| {
                std::env::var("ENGINE").is_ok_and(|w| format!("{e:?}") == w) || std::env::var("ENGINE").is_err()
            })
            .flat_map(|engine| settings.map(|s| (engine, s)))
            .filter(|(_, (culling, covered))| match std::env::var("COVERED").as_deref() {
                Ok("0") => !covered && *culling == Culling::On,
                Ok(_) => *covered,
                Err(_) => *covered || *culling == Culling::On,
            })
        {
            let Some(backend) = CpuBackend::with_isa(isa) else {
                continue;
            };
            let mut backend = backend.with_engine(engine);
            if std::env::var("WHOLE").is_ok_and(|w| w == "0") {
                backend = backend.patch_by_patch();
            }
            let start = Instant::now();
            let settings = RenderSettings {
                resolution,
                culling,
                covered,
            };
            if covered && std::env::var("FRACTIONS").is_ok_and(|w| w == "1") {
                backend.load_for_fractions(model.geometry(), settings)?;
            } else {
                backend.load(model.geometry(), settings)?;
            }
            let loaded = start.elapsed();
            let used = &hemicubes;
            let mut block = RowBlock::default();
            let mut best = f64::INFINITY;
            let mut counters = Default::default();
            for _ in 0..3 {
                block.clear();
                let start = thread_seconds();
                counters = backend.rows(used, &mut block)?;
                best = best.min(thread_seconds() - start);
            }
            block.check(used.len(), model.geometry().patch_count, covered)?;
            let count = used.len() as f64;
            let per = |n: u64| n as f64 / count;
            println!(
                "{engine:?} {isa:?} culling {culling:?} covered {covered}: {:.0} hemicubes/s ({:.0} µs), {:.0} visible, nodes {:.0} hidden {:.0}, transformed {:.0}, drawn {:.0}, load {loaded:.2?}, hash {}",
                count / best,
                best / count * 1e6,
                block.patches.len() as f64 / count,
                per(counters.nodes_tested),
                per(counters.nodes_hidden),
                per(counters.triangles_transformed),
                per(counters.triangles_drawn),
                block
                    .visible
                    .iter()
                    .zip(&block.patches)
                    .fold(0u64, |h, (&v, &p)| (h ^ (u64::from(v) << 32 | u64::from(p)))
                        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                        .rotate_left(23))
                    >> 40,
            );
        }
    }
    Ok(())
}
