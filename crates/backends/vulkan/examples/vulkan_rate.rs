//! Hemicubes a second on a device, and where the time goes: `rate [RESOLUTION [ROWS [SCENE…]]]`, SCENE one of `room`,
//! `denhaag`, `denhaag16`. `docs/gpu.md` was made with it. `TWO=1` compares two sessions with one instead; `MODES` (with spaces: `off frustum occlusion auto`) and `OPTIONS`
//! (further options of each session) choose among the ways.
//!
//! Time is processor time of all threads, so that other programs do not count: on software the GPU is the processor.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube_backend_vulkan::open;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::Kind;
use hemicube_tests::devices::neighbours;
use hemicube_tests::scenes::{generated, model, read, scenes_dir};
use std::time::Instant;

/// Seconds that this process's threads have been on a processor.
fn processor_seconds() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    tasks
        .filter_map(|task| std::fs::read_to_string(task.path().join("schedstat")).ok())
        .filter_map(|text| text.split(' ').next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| args.get(i).map_or(Ok(default), |a| a.parse::<usize>());
    let (resolution, count) = (u32::try_from(number(0, 256)?)?, number(1, 128)?);
    let names = if args.len() > 2 {
        args[2..].to_vec()
    } else {
        ["room", "denhaag", "denhaag16"].map(str::to_owned).to_vec()
    };
    let modes = std::env::var("MODES").unwrap_or_else(|_| "off frustum occlusion auto".to_owned());
    let further = std::env::var("OPTIONS").unwrap_or_default();
    for name in names {
        let tile = |levels| -> Result<_, Box<dyn std::error::Error>> {
            let folder = scenes_dir().ok_or("no ../shared/scenes; HEMICUBE_SCENES names another folder")?;
            Ok(model(
                read(&folder, "city/denhaag-8897.obj")?,
                Subdivision::Levels(levels),
            ))
        };
        let model = match name.as_str() {
            "room" => generated(Kind::Room, 10_000),
            "denhaag" => tile(0)?,
            "denhaag16" => tile(2)?,
            other => return Err(format!("`{other}`: room, denhaag and denhaag16 are known").into()),
        };
        let hemicubes = neighbours(&model, count);
        println!(
            "{name}: {} patches, N = {resolution}, {} hemicubes",
            model.patches().len(),
            hemicubes.len()
        );
        if std::env::var_os("TWO").is_some() {
            // Rows of one session, and of two on two threads: by the clock on the wall, so only on an idle machine.
            let mut one = open(0, &format!("cull=auto,{further}"))?;
            let settings = RenderSettings {
                resolution,
                culling: Culling::On,
                covered: false,
            };
            one.load(model.geometry(), settings)?;
            let mut two = one.fork()?;
            let timed = |sessions: &mut [&mut dyn HemicubeBackend]| {
                let began = Instant::now();
                std::thread::scope(|scope| {
                    for session in sessions.iter_mut() {
                        scope.spawn(|| session.rows(&hemicubes, &mut RowBlock::default()));
                    }
                });
                hemicubes.len() as f64 * sessions.len() as f64 / began.elapsed().as_secs_f64()
            };
            let best = |mut rate: Box<dyn FnMut() -> f64 + '_>| (0..4).map(|_| rate()).fold(0.0, f64::max);
            let alone = best(Box::new(|| timed(&mut [&mut one])));
            let both = best(Box::new(|| timed(&mut [&mut one, &mut *two])));
            println!(
                "  one session {alone:.0} hemicubes/s, two {both:.0}: {:.2} times",
                both / alone
            );
            continue;
        }
        for (mode, covered) in modes.split_whitespace().flat_map(|m| [(m, false), (m, true)]) {
            if covered && std::env::var_os("BARE").is_some() {
                continue;
            }
            let settings = RenderSettings {
                resolution,
                culling: Culling::On,
                covered,
            };
            let mut plain = open(0, &format!("cull={mode},{further}"))?;
            plain.load(model.geometry(), settings)?;
            let (mut best, mut wall, mut counters) = (f64::INFINITY, f64::INFINITY, None);
            for _ in 0..3 {
                let mut rows = RowBlock::default();
                let (start, began) = (processor_seconds(), Instant::now());
                counters = Some(plain.rows(&hemicubes, &mut rows)?);
                best = best.min(processor_seconds() - start);
                wall = wall.min(began.elapsed().as_secs_f64());
            }
            let mut timed = open(0, &format!("cull={mode},timing=on,{further}"))?;
            timed.load(model.geometry(), settings)?;
            timed.rows(&hemicubes, &mut RowBlock::default())?;
            let each = |n: u64| n as f64 / hemicubes.len() as f64;
            let (t, c) = (timed.stage_times(), counters.unwrap_or_default());
            let ms = |n: u64| each(n) * 1e-6;
            println!(
                "  {mode:9} covered {}: {:6.2} ms processor, {:6.2} ms wall; cull {:.2} render {:.2} reduce {:.2} cover {:.2} back {:.2}; chunks {:.0} outside {:.0} hidden {:.0}; triangles {:.0} of {:.0}; bytes {:.0}; {}",
                u8::from(covered),
                best / hemicubes.len() as f64 * 1e3,
                wall / hemicubes.len() as f64 * 1e3,
                ms(t.cull),
                ms(t.render),
                ms(t.reduce),
                ms(t.cover),
                ms(t.read_back),
                each(c.nodes_tested),
                each(c.nodes_outside),
                each(c.nodes_hidden),
                each(c.triangles_drawn),
                each(c.triangles_transformed),
                each(c.bytes_read_back),
                plain.choices().join("; "),
            );
        }
    }
    Ok(())
}
