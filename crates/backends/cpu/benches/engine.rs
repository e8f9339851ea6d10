//! Hemicubes a second of the three engines: by scene, against engine `depth` patch by patch and against brute force, by
//! hierarchy, instruction set and resolution. `cargo bench -p hemicube-backend-cpu --bench engine`.
//!
//! Before criterion's own groups, a table of ratios is printed whose two sides were measured in turns in this run, in
//! processor time of the thread: those are what claims rest on. `HEMICUBE_BENCH=small` leaves the scenes of 1.5 million
//! patches out; scenes of ../shared/scenes are used where they are.
#![allow(clippy::print_stdout, reason = "a bench prints")]
#![allow(missing_docs, reason = "criterion_group! makes undocumented items")]

#[path = "../examples/clock/mod.rs"]
mod clock;

use clock::thread_seconds;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group};
use hemicube::accuracy::correct::{Correction, Refinement};
use hemicube::backend::{Culling, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::row::RowBlock;
use hemicube::store::Part;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice, Hierarchy, Isa};
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, cornell_box, generate};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Patches, ReadOptions, Scene, Subdivision, load};
use std::path::PathBuf;

/// A scene ready to be measured: runs of 16 consecutive patches spread over the order of work.
struct Case {
    name: &'static str,
    model: Model,
    hemicubes: Vec<Hemicube>,
}

impl Case {
    fn new(name: &'static str, mut scene: Scene, subdivision: Subdivision, rows: usize) -> Self {
        repair(&mut scene, RepairOptions::default());
        let patches = Patches::new(&scene, subdivision).expect("patches");
        let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
        let order: Vec<_> = model.order().collect();
        let runs = rows / 16;
        let hemicubes = (0..runs)
            .flat_map(|r| order[r * order.len() / runs..].iter().take(16))
            .flat_map(|&p| model.hemicubes(p, 1, true))
            .collect();
        Self { name, model, hemicubes }
    }

    fn backend(
        &self,
        isa: Isa,
        engine: EngineChoice,
        hierarchy: Hierarchy,
        resolution: u32,
        culling: Culling,
        covered: bool,
    ) -> CpuBackend {
        let mut backend = CpuBackend::with_isa(isa)
            .expect("an instruction set of this machine")
            .with_engine(engine)
            .with_hierarchy(hierarchy);
        backend
            .load(
                self.model.geometry(),
                RenderSettings {
                    resolution,
                    culling,
                    covered,
                },
            )
            .expect("settings in range");
        backend
    }

    fn engine(&self, engine: EngineChoice, resolution: u32, covered: bool) -> CpuBackend {
        self.backend(
            Isa::available()[0],
            engine,
            Hierarchy::SurfaceArea,
            resolution,
            Culling::On,
            covered,
        )
    }

    /// The engine that the scene gets where only fractions are asked, as by the corrections.
    fn for_fractions(&self, resolution: u32) -> CpuBackend {
        let mut backend = CpuBackend::new();
        let settings = RenderSettings {
            resolution,
            culling: Culling::On,
            covered: true,
        };
        backend
            .load_for_fractions(self.model.geometry(), settings)
            .expect("settings in range");
        backend
    }

    /// Engine `depth` as it draws patch by patch.
    fn patch_by_patch(&self, resolution: u32, culling: Culling, covered: bool) -> CpuBackend {
        let mut backend = CpuBackend::new().with_engine(EngineChoice::Depth).patch_by_patch();
        let settings = RenderSettings {
            resolution,
            culling,
            covered,
        };
        backend
            .load(self.model.geometry(), settings)
            .expect("settings in range");
        backend
    }
}

fn shared_scene(path: &str) -> Option<Scene> {
    let root = std::env::var_os("HEMICUBE_SCENES").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/scenes"),
        PathBuf::from,
    );
    let file = root.join(path);
    if !file.exists() {
        println!("SKIP {path}: no ../shared/scenes");
        return None;
    }
    Some(load(&file, ReadOptions::default()).expect("a scene that reads"))
}

fn block_city(blocks: u32, split: u32) -> Scene {
    BlockCityParameters {
        blocks,
        split,
        ..BlockCityParameters::for_target(1000, 1)
    }
    .generate()
    .expect("a city")
}

fn cases(large: bool) -> Vec<Case> {
    let mut cases = vec![
        Case::new("room-10k", cornell_box(), Subdivision::Levels(4), 256),
        Case::new("block-city-9k", block_city(25, 1), Subdivision::None, 256),
        Case::new("block-city-140k", block_city(25, 4), Subdivision::None, 256),
        Case::new(
            "spheres-10k",
            generate(Generate {
                kind: Kind::Spheres,
                target_patches: 10_000,
                seed: 1,
            })
            .expect("spheres"),
            Subdivision::None,
            256,
        ),
        Case::new(
            "soup-10k",
            generate(Generate {
                kind: Kind::Soup,
                target_patches: 10_000,
                seed: 1,
            })
            .expect("a soup"),
            Subdivision::None,
            256,
        ),
    ];
    for (name, path, subdivision) in [
        ("denhaag-8897", "city/denhaag-8897.obj", Subdivision::None),
        ("denhaag-8897-x16", "city/denhaag-8897.obj", Subdivision::Levels(2)),
    ] {
        cases.extend(shared_scene(path).map(|scene| Case::new(name, scene, subdivision, 256)));
    }
    if large {
        cases.push(Case::new("block-city-1.5M", block_city(82, 4), Subdivision::None, 64));
        cases.extend(
            shared_scene("city/denhaag.obj").map(|s| Case::new("denhaag-split6", s, Subdivision::Split(6), 64)),
        );
    }
    cases
}

/// Processor time is counted in ticks of up to 4 ms: what is measured takes at least so many seconds.
const LEAST_SECONDS: f64 = 0.2;
/// Turns of each of two backends.
const TURNS: usize = 5;

/// Under `--test` every bench runs once, to see that it still does.
fn is_test() -> bool {
    std::env::args().any(|argument| argument == "--test")
}

/// Best seconds of each of two backends over the same hemicubes, measured in turns.
fn in_turns(a: &mut CpuBackend, b: &mut CpuBackend, hemicubes: &[Hemicube]) -> (f64, f64) {
    let (turns, least) = if is_test() { (1, 0.0) } else { (TURNS, LEAST_SECONDS) };
    let mut rows = RowBlock::default();
    let mut time = |backend: &mut CpuBackend| {
        let start = thread_seconds();
        let mut times = 0.0;
        loop {
            rows.clear();
            backend.rows(hemicubes, &mut rows).expect("rows");
            times += 1.0;
            let seconds = thread_seconds() - start;
            if seconds >= least {
                return seconds / times;
            }
        }
    };
    let mut best = (f64::INFINITY, f64::INFINITY);
    for _ in 0..turns {
        best.0 = best.0.min(time(a));
        best.1 = best.1.min(time(b));
    }
    best
}

/// What a session's engine is called on the command line.
fn name(backend: &CpuBackend) -> &'static str {
    match backend.engine() {
        Some(EngineChoice::Depth) => "depth",
        Some(EngineChoice::Order) => "order",
        Some(EngineChoice::Claims) => "claims",
        Some(EngineChoice::Auto) | None => unreachable!("it is loaded"),
    }
}

const ENGINES: [EngineChoice; 3] = [EngineChoice::Order, EngineChoice::Claims, EngineChoice::Depth];

fn print_ratios(cases: &[Case]) {
    let isa = Isa::available()[0];
    let auto = |case: &Case, resolution, covered| case.engine(EngineChoice::Auto, resolution, covered);
    println!(
        "One core, N = 256, best of 5 in turns; hemicubes a second and their ratios. `auto` is what the scene gets, `parted` engine `depth` \
         patch by patch."
    );
    println!(
        "| scene | patches | auto | order | claims | depth | parted | auto / parted | depth / parted | brute force | auto / brute |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for case in cases {
        let count = case.hemicubes.len() as f64;
        let mut best = auto(case, 256, false);
        let mut parted = case.patch_by_patch(256, Culling::On, false);
        let [order, claims, depth] = ENGINES.map(|engine| case.engine(engine, 256, false));
        let (t_best, t_parted) = in_turns(&mut best, &mut parted, &case.hemicubes);
        let [(t_order, _), (t_claims, _), (t_depth, t_parted_again)] =
            [order, claims, depth].map(|mut engine| in_turns(&mut engine, &mut parted, &case.hemicubes));
        let mut brute = case.patch_by_patch(256, Culling::Off, false);
        let (t_best_again, t_brute) = in_turns(&mut best, &mut brute, &case.hemicubes);
        println!(
            "| {} | {} | {} | {:.0} | {:.0} | {:.0} | {:.0} | {:.2} | {:.2} | {:.0} | {:.1} |",
            case.name,
            case.model.patches().len(),
            name(&best),
            count / t_order,
            count / t_claims,
            count / t_depth,
            count / t_parted,
            t_parted / t_best,
            t_parted_again / t_depth,
            count / t_brute,
            t_brute / t_best_again,
        );
    }
    println!("The same with covered weights, and what the chosen engines make of it:");
    println!(
        "| scene | order | claims | depth | parted | auto / parted | depth / parted | claims / depth at N = 1024 | N = 1024 / 64 in \
         time, engines | portable / {isa:?} at 256 | at 64 |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for case in cases {
        let count = case.hemicubes.len() as f64;
        let mut parted = case.patch_by_patch(256, Culling::On, true);
        let (t_best, t_parted) = in_turns(&mut auto(case, 256, true), &mut parted, &case.hemicubes);
        let [(t_order, _), (t_claims, _), (t_depth, t_parted_again)] = ENGINES
            .map(|engine| case.engine(engine, 256, true))
            .map(|mut engine| in_turns(&mut engine, &mut parted, &case.hemicubes));
        let (mut small, mut large) = (auto(case, 64, true), auto(case, 1024, true));
        let (t_small, t_large) = in_turns(&mut small, &mut large, &case.hemicubes);
        let mut large_claims = case.engine(EngineChoice::Claims, 1024, true);
        let mut large_depth = case.engine(EngineChoice::Depth, 1024, true);
        let fine = &case.hemicubes[..case.hemicubes.len().min(128)];
        let (t_large_claims, t_large_depth) = in_turns(&mut large_claims, &mut large_depth, fine);
        let portable = [256, 64].map(|n| {
            let mut plain = case.backend(
                Isa::Portable,
                EngineChoice::Auto,
                Hierarchy::SurfaceArea,
                n,
                Culling::On,
                true,
            );
            let (t_best, t_plain) = in_turns(&mut auto(case, n, true), &mut plain, &case.hemicubes);
            t_best / t_plain
        });
        println!(
            "| {} | {:.0} | {:.0} | {:.0} | {:.0} | {:.2} | {:.2} | {:.2} | {:.2}, {} / {} | {:.2} | {:.2} |",
            case.name,
            count / t_order,
            count / t_claims,
            count / t_depth,
            count / t_parted,
            t_parted / t_best,
            t_parted_again / t_depth,
            t_large_depth / t_large_claims,
            t_large / t_small,
            name(&large),
            name(&small),
            portable[0],
            portable[1],
        );
    }
    println!(
        "Where only fractions are asked, as by the corrections, against the engine that the scene gets for covered weights:"
    );
    println!("| scene | engine | hemicubes a second | / covered weights | / parted | N = 1024 / 64 in time, engines |");
    println!("|---|---|---|---|---|---|");
    for case in cases {
        let count = case.hemicubes.len() as f64;
        let mut fractions = case.for_fractions(256);
        let (t_fractions, t_weights) = in_turns(&mut fractions, &mut auto(case, 256, true), &case.hemicubes);
        let mut parted = case.patch_by_patch(256, Culling::On, true);
        let (t_again, t_parted) = in_turns(&mut fractions, &mut parted, &case.hemicubes);
        let (mut small, mut large) = (case.for_fractions(64), case.for_fractions(1024));
        let (t_small, t_large) = in_turns(&mut small, &mut large, &case.hemicubes);
        println!(
            "| {} | {} | {:.0} | {:.2} | {:.2} | {:.2}, {} / {} |",
            case.name,
            name(&fractions),
            count / t_fractions,
            t_weights / t_fractions,
            t_parted / t_again,
            t_large / t_small,
            name(&large),
            name(&small),
        );
    }
    println!("Engine `depth`, patch by patch, over the surface area tree against the octree:");
    for case in cases {
        let depth = EngineChoice::Depth;
        let mut octree = case.backend(isa, depth, Hierarchy::Octree, 256, Culling::On, false);
        let mut parted = case.patch_by_patch(256, Culling::On, false);
        let (t_area, t_octree) = in_turns(&mut parted, &mut octree, &case.hemicubes);
        println!("{}: {:.2}", case.name, t_octree / t_area);
    }
    for case in cases.iter().filter(|c| c.model.patches().len() < 1_000_000) {
        let plan = Plan::new(
            &case.model,
            RowChoice::Sample { count: 4096, seed: 1 },
            Selection::default(),
            1,
            true,
        );
        let time = |threads, resolution, correction| {
            let settings = RenderSettings {
                resolution,
                culling: Culling::On,
                covered: false,
            };
            let mut parts: Vec<Part> = Vec::new();
            let summary = compute(
                &case.model,
                &plan.clone().with_correction(correction),
                settings,
                Box::new(CpuBackend::new()),
                Execution {
                    threads,
                    ..Execution::default()
                },
                &mut parts,
                &mut |_| {},
            )
            .expect("rows");
            summary.elapsed.as_secs_f64()
        };
        let within = Correction::Tolerance(Refinement::for_tolerance(0.02));
        let [mut one, mut two, mut pixel_128, mut within_128] = [f64::INFINITY; 4];
        for _ in 0..3 {
            one = one.min(time(1, 256, Correction::Pixel));
            two = two.min(time(2, 256, Correction::Pixel));
            pixel_128 = pixel_128.min(time(1, 128, Correction::Pixel));
            within_128 = within_128.min(time(1, 128, within));
        }
        let rows = plan.rows.len() as f64;
        println!(
            "{}: two threads {:.2} times one; a row at N = 128, one thread: pixel {:.3} ms, tolerance 2 % {:.3} ms (clock on the \
             wall, best of 3 in turns)",
            case.name,
            one / two,
            1e3 * pixel_128 / rows,
            1e3 * within_128 / rows,
        );
    }
}

fn rate(c: &mut Criterion) {
    let small = std::env::var("HEMICUBE_BENCH").is_ok_and(|v| v == "small");
    let cases = if is_test() {
        vec![Case::new("room-640", cornell_box(), Subdivision::Levels(2), 16)]
    } else {
        cases(!small)
    };
    print_ratios(&cases);

    let mut run = |group: &str, id: BenchmarkId, case: &Case, mut backend: CpuBackend| {
        let mut rows = RowBlock::default();
        let mut group = c.benchmark_group(group);
        group
            .sample_size(10)
            .throughput(Throughput::Elements(case.hemicubes.len() as u64));
        group.bench_function(id, |b| {
            b.iter(|| {
                rows.clear();
                backend.rows(&case.hemicubes, &mut rows).expect("rows")
            });
        });
        group.finish();
    };
    for case in &cases {
        run(
            "culled",
            BenchmarkId::new(case.name, 256),
            case,
            case.engine(EngineChoice::Auto, 256, false),
        );
    }
    for case in cases
        .iter()
        .filter(|c| c.name.starts_with("room") || c.name == "denhaag-8897-x16")
    {
        let brute = case.patch_by_patch(256, Culling::Off, false);
        run("brute", BenchmarkId::new(case.name, 256), case, brute);
        for isa in Isa::available() {
            let auto = EngineChoice::Auto;
            let backend = case.backend(isa, auto, Hierarchy::SurfaceArea, 256, Culling::On, false);
            run("isa", BenchmarkId::new(format!("{isa:?}"), case.name), case, backend);
        }
        run(
            "hierarchy",
            BenchmarkId::new("octree", case.name),
            case,
            case.backend(
                Isa::available()[0],
                EngineChoice::Depth,
                Hierarchy::Octree,
                256,
                Culling::On,
                false,
            ),
        );
        for resolution in [64, 128, 512, 1024] {
            run(
                "resolution",
                BenchmarkId::new(case.name, resolution),
                case,
                case.engine(EngineChoice::Auto, resolution, false),
            );
        }
    }
}

criterion_group!(benches, rate);

fn main() {
    benches();
    Criterion::default().configure_from_args().final_summary();
}
