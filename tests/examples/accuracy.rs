//! What accuracy costs, held against the reference by rays; prints the tables of docs/dev/accuracy.md.
//!
//! `accuracy ladder [ROWS [SCENE…]]`: every rung on generated scenes and a real tile. `accuracy rays [ROWS [SCENE…]]`:
//! what casting rays costs for the error that the default has. `accuracy calibration [ROWS [SCENE…]]`: whether what is
//! asked for is what one gets, over real scenes and tolerances, of the matrix (relative Frobenius) and of each row's
//! sum (Σ F against the reference's, and Σ F + what is lost against 1).
//!
//! With `REFERENCE_CACHE=DIR`, reference rows are kept there for the next run; with `RUNGS=WORD`, only the rungs whose
//! name has the word are climbed; with `WORST=1`, the entries that are farthest off are listed; with
//! `ENGINE=Depth|Order`, rungs without a tolerance have that engine of the CPU backend; with `EMBREE_RAYS=PROGRAM`,
//! `rays` casts by Intel Embree, too: see `scripts/embree-rays`, which builds that program.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example prints")]

use glam::{DVec3, Vec3A};
use hemicube::accuracy::correct::Correction;
use hemicube::backend::{Culling, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::reference::{
    EstimatedRow, Measured, Reference, ReferenceRow, ReferenceSettings, errors_against, noise_of,
};
use hemicube::store::{Form, Part, RowTable};
use hemicube::{InputPatch, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::{BlockCityParameters, Generate, Kind, cornell_box, generate};
use hemicube_tests::rows::settled;
use hemicube_tests::scenes::{model, read, scenes_or_skip};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const SEED: u64 = 777;
/// How long a rung is climbed for its time to be told.
const ENOUGH_SECONDS: f64 = 0.7;

/// A rung: its name, the correction, N, and n of n² hemicubes.
const RUNGS: [(&str, Rung, u32, u32); 6] = [
    ("pixel, K = 1, N = 256", Rung::Pixel, 256, 1),
    ("pixel, K = 4, N = 256", Rung::Pixel, 256, 2),
    ("pixel, K = 16, N = 256", Rung::Pixel, 256, 4),
    ("tolerance 2 %", Rung::Tolerance(2e-2), 128, 1),
    ("tolerance 1 %", Rung::Tolerance(1e-2), 128, 1),
    ("tolerance 0.3 %", Rung::Tolerance(3e-3), 128, 1),
];

#[derive(Clone, Copy)]
enum Rung {
    Pixel,
    Tolerance(f64),
}

/// A scene by the name that its rows in the tables have; `None` where the folder of real scenes lacks it.
fn scene(name: &str) -> Option<Model> {
    let block_city = |split| {
        let parameters = BlockCityParameters {
            blocks: 25,
            split,
            ..BlockCityParameters::for_target(1000, 1)
        };
        parameters.generate().expect("a city")
    };
    let generated = |kind| {
        let spec = Generate {
            kind,
            target_patches: 10_000,
            seed: 1,
        };
        generate(spec).expect("a target in range")
    };
    let (scene, subdivision) = match name {
        "room-10k" => (cornell_box(), Subdivision::Levels(4)),
        "block-city-9k" => (block_city(1), Subdivision::None),
        "block-city-140k" => (block_city(4), Subdivision::None),
        "maze" => (generated(Kind::Maze), Subdivision::None),
        "spheres" => (generated(Kind::Spheres), Subdivision::None),
        "denhaag-8897-x16" => (real("city/denhaag-8897.obj")?, Subdivision::Levels(2)),
        file => (real(file)?, Subdivision::None),
    };
    Some(model(scene, subdivision))
}

fn real(file: &str) -> Option<hemicube_scene::Scene> {
    let folder = scenes_or_skip(file)?;
    Some(read(&folder, file).unwrap_or_else(|error| panic!("{file}: {error}")))
}

const LADDER: [&str; 5] = [
    "room-10k",
    "block-city-9k",
    "block-city-140k",
    "city/denhaag-8897.obj",
    "denhaag-8897-x16",
];

/// Rows of a scene where no number is given.
const ROWS: u32 = 24;
const ROWS_OF_CALIBRATION: u32 = 48;

const CALIBRATION: [&str; 17] = [
    "city/denhaag-8897.obj",
    "city/rotterdam-delfshaven.obj",
    "city/zurich-lv95-rawcoords.obj",
    "city/3dfier-testarea.obj",
    "interior/oa_dm5.obj",
    "interior/aggressor.obj",
    "ac/fg-zone_maisons-ba.ac",
    "ac/fg-clem-superstructure.ac",
    "ac/torcs-street-1.acc",
    "room-10k",
    "maze",
    "spheres",
    "../cases/city/munich.obj",
    "../cases/thin-enclosure/cavity.obj",
    "city/denhaag-nested.glb",
    "ac/fg-jetway-movable-3.ac",
    "gltf/kenney-city-kit/building-small-c.glb",
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let what = args.next().unwrap_or_default();
    let given: Option<u32> = args.next().map(|a| a.parse()).transpose()?;
    let rows = given.unwrap_or(ROWS);
    let chosen: Vec<String> = args.collect();
    let listed = |all: &[&'static str]| -> Vec<String> {
        if chosen.is_empty() {
            all.iter().map(|&s| s.to_owned()).collect()
        } else {
            chosen.clone()
        }
    };
    match what.as_str() {
        "ladder" => ladder(rows, &listed(&LADDER)),
        "rays" => rays(rows, &listed(&LADDER)),
        "calibration" => calibration(given.unwrap_or(ROWS_OF_CALIBRATION), &listed(&CALIBRATION)),
        _ => Err("ladder, rays or calibration?".into()),
    }
}

fn ladder(rows: u32, scenes: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    println!("| scene | rung | ms a row | relative Frobenius | median row | 90th percentile | median L1 | row sums |");
    println!("|---|---|---|---|---|---|---|---|");
    for name in scenes {
        let Some(model) = scene(name) else { continue };
        let exact = reference(name, &model, rows)?;
        let word = std::env::var("RUNGS").unwrap_or_default();
        for (rung, kind, resolution, samples) in RUNGS {
            if !rung.contains(&word) {
                continue;
            }
            let (correction, resolution) = match kind {
                Rung::Pixel => (Correction::Pixel, resolution),
                Rung::Tolerance(tolerance) => {
                    let settled = settled(&model, tolerance, &mut CpuBackend::new())?;
                    (Correction::Tolerance(settled.refinement), settled.resolution)
                }
            };
            let (seconds, m) = measure(&model, rows, correction, resolution, samples, &exact)?;
            println!(
                "| {name} | {rung} | {:.2} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} |",
                seconds * 1e3,
                m.relative_frobenius,
                m.row_error.median,
                m.row_error.percentile_90,
                m.row_l1.median,
                m.row_sum_error.mean,
            );
        }
        println!(
            "| {name} | *the reference's own noise* | | {:.4} | | | | |",
            noise_of(&exact)
        );
    }
    Ok(())
}

/// Rays from points of the emitter, directions by the cosine, against obvhs's hierarchy and triangles: F_ij is the
/// share that meets j.
struct Caster {
    hierarchy: Bvh2,
    triangles: Vec<Triangle>,
    /// The patch on the side that a triangle's normal points to, and behind it.
    sides: Vec<(u32, Option<u32>)>,
    /// Corners of each patch, counter-clockwise from its own side.
    corners: Vec<[DVec3; 3]>,
}

impl Caster {
    fn new(model: &Model) -> Self {
        let surfaces = &model.geometry().surfaces;
        let single = |p: DVec3| p.as_vec3a();
        let triangles: Vec<Triangle> = surfaces
            .iter()
            .map(|s| Triangle {
                v0: single(s.corners[0]),
                v1: single(s.corners[1]),
                v2: single(s.corners[2]),
            })
            .collect();
        let boxes: Vec<Aabb> = triangles.iter().map(Triangle::aabb).collect();
        let mut hierarchy = build_bvh2(&boxes, BvhBuildParams::slow_build(), &mut Duration::default());
        // Triangles in the order of the leaves, so that a leaf's lie beside each other.
        let order = std::mem::take(&mut hierarchy.primitive_indices);
        let mut corners = vec![[DVec3::ZERO; 3]; model.patches().len()];
        for surface in surfaces {
            let [a, b, c] = surface.corners;
            corners[surface.front.0 as usize] = [a, b, c];
            if let Some(back) = surface.back {
                corners[back.0 as usize] = [a, c, b];
            }
        }
        Self {
            corners,
            triangles: order.iter().map(|&i| triangles[i as usize]).collect(),
            sides: order
                .iter()
                .map(|&i| &surfaces[i as usize])
                .map(|s| (s.front.0, s.back.map(|b| b.0)))
                .collect(),
            hierarchy,
        }
    }

    /// The rays of an emitter by their number, origin and direction: of low discrepancy (an additive sequence in four
    /// dimensions).
    fn rays_of(&self, emitter: InputPatch) -> impl Fn(u32) -> (Vec3A, Vec3A) {
        let [a, b, c] = self.corners[emitter.0 as usize];
        let (tangent, bitangent, normal) = {
            let normal = (b - a).cross(c - a).normalize();
            let (t, u) = normal.any_orthonormal_pair();
            (t, u, normal)
        };
        move |k| {
            let at = |step: f64| (f64::from(emitter.0) * 0.618_033_988_749_895 + f64::from(k) * step).fract();
            let [mut u, mut v, r, turn] =
                [0.856_674_883_854_5, 0.733_891_856_627_2, 0.628_706_721_1, 0.538_598_7].map(at);
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let origin = a + (b - a) * u + (c - a) * v;
            let (sine, cosine) = (turn * std::f64::consts::TAU).sin_cos();
            let direction = (tangent * cosine + bitangent * sine) * r.sqrt() + normal * (1.0 - r).sqrt();
            (origin.as_vec3a(), direction.as_vec3a())
        }
    }

    /// A row from the first so many rays.
    fn row(&self, emitter: InputPatch, count: u32, hits: &mut [u32]) -> EstimatedRow {
        let nth = self.rays_of(emitter);
        let mut seen = Vec::new();
        for k in 0..count {
            let (origin, direction) = nth(k);
            let ray = Ray::new(origin, direction, 1e-5, f32::MAX);
            let mut hit = RayHit::none();
            self.hierarchy
                .ray_traverse(ray, &mut hit, |ray, index| self.triangles[index].intersect(ray));
            if hit.t < f32::MAX {
                let index = hit.primitive_id as usize;
                let (front, back) = self.sides[index];
                let faces = self.triangles[index].compute_normal().dot(ray.direction) < 0.0;
                let patch = if faces { Some(front) } else { back };
                if let Some(patch) = patch.filter(|&p| p != emitter.0) {
                    if hits[patch as usize] == 0 {
                        seen.push(patch);
                    }
                    hits[patch as usize] += 1;
                }
            }
        }
        seen.sort_unstable();
        let values = seen
            .iter()
            .map(|&p| f64::from(std::mem::take(&mut hits[p as usize])) / f64::from(count))
            .collect();
        EstimatedRow {
            emitter,
            columns: seen,
            values,
        }
    }
}

/// The powers of two that numbers of rays are: the lowest and the highest.
const POWERS: (u32, u32) = (8, 19);

/// So many rays a row: the error of their rows, and seconds a row.
#[derive(Clone, Copy)]
struct Run {
    count: f64,
    error: f64,
    seconds: f64,
}

/// Runs of one caster with more and more rays.
struct Runs(Vec<Run>);

impl Runs {
    /// Cells of a table: how many rays have that error, their time, and how often ours is in it. Between two runs, the
    /// one where the error passes; beyond the last one, by the square of the error.
    fn cells(&self, error: f64, ours: f64) -> [String; 3] {
        let [.., before, _, last] = self.0.as_slice() else {
            return std::array::from_fn(|_| "–".into());
        };
        // Four times as many rays should halve the error; where they do not, more would not help either.
        let stuck = last.error > 0.8 * before.error;
        let reached = self.0.iter().find(|run| run.error <= error);
        match reached.or((!stuck).then_some(last)) {
            Some(run) => {
                let more = (run.error / error).powi(2);
                let (count, seconds) = (run.count * more, run.seconds * more);
                [
                    format!("{count:.0}"),
                    format!("{:.2}", seconds * 1e3),
                    format!("{:.1}", seconds / ours),
                ]
            }
            None => [
                format!("never: {:.4} at {:.0}", last.error, last.count),
                format!("{:.2}", last.seconds * 1e3),
                "–".into(),
            ],
        }
    }
}

/// The time that rays take for an error, from runs with more and more of them.
fn rays(rows: u32, scenes: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    let embree = std::env::var_os("EMBREE_RAYS");
    let (names, lines) = match embree {
        Some(_) => (
            " Embree: rays of that error | ms a row, rays ready | rays ÷ ours | ms a row, rays made | rays ÷ ours |",
            "---|---|---|---|---|",
        ),
        None => ("", ""),
    };
    println!("| scene | setting | error | ms a row | rays of that error | ms a row | rays ÷ ours |{names}");
    println!("|---|---|---|---|---|---|---|{lines}");
    for name in scenes {
        let Some(model) = scene(name) else { continue };
        let exact = reference(name, &model, rows)?;
        let caster = Caster::new(&model);
        let emitters: Vec<InputPatch> = exact.iter().map(|row| InputPatch(row.emitter)).collect();
        let by_obvhs = cast(&caster, &emitters, &exact);
        let mut by_embree = None;
        if let Some(program) = &embree {
            let making = seconds_to_make_rays(&caster, &emitters);
            eprintln!("{name}: making a ray takes {:.1} ns", making * 1e9);
            let [ready, made] = cast_by_embree(Path::new(program), &caster, &emitters, &exact, making)?;
            for ((a, b), c) in by_obvhs.0.iter().zip(&ready.0).zip(&made.0) {
                eprintln!(
                    "{name}, {} rays: obvhs {:.5} in {:.3} ms, Embree {:.5} in {:.3} ms, {:.3} with making and laying them out",
                    a.count,
                    a.error,
                    a.seconds * 1e3,
                    b.error,
                    b.seconds * 1e3,
                    c.seconds * 1e3
                );
            }
            by_embree = Some((ready, made));
        }
        for (setting, tolerance) in [
            ("tolerance 2 %", 2e-2),
            ("tolerance 1 %", 1e-2),
            ("tolerance 0.3 %", 3e-3),
        ] {
            let settled = settled(&model, tolerance, &mut CpuBackend::new())?;
            let (correction, resolution) = (Correction::Tolerance(settled.refinement), settled.resolution);
            let (seconds, m) = measure(&model, rows, correction, resolution, 1, &exact)?;
            let cells = |runs: &Runs| runs.cells(m.relative_frobenius, seconds).join(" | ");
            print!(
                "| {name} | {setting} | {:.4} | {:.3} | {} |",
                m.relative_frobenius,
                seconds * 1e3,
                cells(&by_obvhs),
            );
            if let Some((ready, made)) = &by_embree {
                let [_, of_made @ ..] = made.cells(m.relative_frobenius, seconds);
                print!(" {} | {} |", cells(ready), of_made.join(" | "));
            }
            println!();
        }
    }
    Ok(())
}

/// Runs by obvhs.
fn cast(caster: &Caster, emitters: &[InputPatch], exact: &[ReferenceRow]) -> Runs {
    let mut hits = vec![0; caster.corners.len()];
    let run = |power| {
        let count = 1u32 << power;
        let began = processor_time();
        let started = std::time::Instant::now();
        let mut rounds = 0;
        let (estimated, seconds) = loop {
            let estimated: Vec<EstimatedRow> = emitters.iter().map(|&e| caster.row(e, count, &mut hits)).collect();
            rounds += 1;
            let elapsed = match (began, processor_time()) {
                (Some(began), Some(now)) => now - began,
                _ => started.elapsed().as_secs_f64(),
            };
            if elapsed >= ENOUGH_SECONDS {
                break (estimated, elapsed / f64::from(rounds) / emitters.len() as f64);
            }
        };
        Run {
            count: f64::from(count),
            error: errors_against(exact, &estimated).relative_frobenius,
            seconds,
        }
    };
    Runs((POWERS.0..=POWERS.1).map(run).collect())
}

/// Runs of the same rays by Intel Embree, without and with what it takes to make them, a ray in so many seconds, and to
/// lay them out: `tests/embree/rays.cpp` says what goes to that program and what comes back.
fn cast_by_embree(
    program: &Path,
    caster: &Caster,
    emitters: &[InputPatch],
    exact: &[ReferenceRow],
    making: f64,
) -> Result<[Runs; 2], Box<dyn std::error::Error>> {
    let named = |what: String| format!("`{}` {what}; scripts/embree-rays builds it", program.display());
    let mut child = Command::new(program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| named(format!("of EMBREE_RAYS cannot be run: {error}")))?;
    // It reads all before it writes.
    let told = tell_embree(child.stdin.take().expect("a pipe"), caster, emitters);
    let output = child.wait_with_output()?;
    if !output.status.success() {
        return Err(named(format!("failed: {}", output.status)).into());
    }
    told.map_err(|error| named(format!("did not read its rays: {error}")))?;

    let mut unread = output.stdout.as_slice();
    let runs = (POWERS.0..=POWERS.1).map(|power| {
        let count = f64::from(1u32 << power);
        let seconds = f64::from_le_bytes(next(&mut unread)?);
        let laid_out = f64::from_le_bytes(next(&mut unread)?);
        let mut estimated = Vec::new();
        for &emitter in emitters {
            let (mut columns, mut values) = (Vec::new(), Vec::new());
            for _ in 0..u32::from_le_bytes(next(&mut unread)?) {
                columns.push(u32::from_le_bytes(next(&mut unread)?));
                values.push(f64::from(u32::from_le_bytes(next(&mut unread)?)) / count);
            }
            estimated.push(EstimatedRow {
                emitter,
                columns,
                values,
            });
        }
        let error = errors_against(exact, &estimated).relative_frobenius;
        let run = |seconds| Run { count, error, seconds };
        Some((run(seconds), run(laid_out + making * count)))
    });
    let runs: Option<(Vec<Run>, Vec<Run>)> = runs.collect();
    match runs {
        Some((ready, made)) if unread.is_empty() => Ok([Runs(ready), Runs(made)]),
        _ => Err(named("wrote something else than rows".into()).into()),
    }
}

/// Processor time that it takes to make a ray.
fn seconds_to_make_rays(caster: &Caster, emitters: &[InputPatch]) -> f64 {
    let (started, began) = (std::time::Instant::now(), processor_time());
    let mut made = 0.0;
    for &emitter in emitters.iter().cycle() {
        let nth = caster.rays_of(emitter);
        for k in 0..1 << 16 {
            std::hint::black_box(nth(k));
        }
        made += f64::from(1 << 16);
        let elapsed = match (began, processor_time()) {
            (Some(began), Some(now)) => now - began,
            _ => started.elapsed().as_secs_f64(),
        };
        if elapsed >= ENOUGH_SECONDS {
            return elapsed / made;
        }
    }
    f64::NAN
}

fn next<const N: usize>(unread: &mut &[u8]) -> Option<[u8; N]> {
    let (&first, rest) = unread.split_first_chunk()?;
    *unread = rest;
    Some(first)
}

fn tell_embree(pipe: impl Write, caster: &Caster, emitters: &[InputPatch]) -> std::io::Result<()> {
    let mut pipe = BufWriter::with_capacity(1 << 20, pipe);
    let size = |length: usize| u32::try_from(length).expect("patches are numbered in 32 bits");
    let count = 1u32 << POWERS.1;
    for number in [
        size(caster.triangles.len()),
        size(caster.corners.len()),
        size(emitters.len()),
        count,
        POWERS.0,
        POWERS.1,
    ] {
        pipe.write_all(&number.to_le_bytes())?;
    }
    pipe.write_all(&ENOUGH_SECONDS.to_le_bytes())?;
    for (triangle, &(front, back)) in caster.triangles.iter().zip(&caster.sides) {
        write_points(&mut pipe, &[triangle.v0, triangle.v1, triangle.v2])?;
        pipe.write_all(&front.to_le_bytes())?;
        pipe.write_all(&back.unwrap_or(u32::MAX).to_le_bytes())?;
    }
    for &emitter in emitters {
        pipe.write_all(&emitter.0.to_le_bytes())?;
        let nth = caster.rays_of(emitter);
        for k in 0..count {
            let (origin, direction) = nth(k);
            write_points(&mut pipe, &[origin, direction])?;
        }
    }
    pipe.flush()
}

fn write_points(to: &mut impl Write, points: &[Vec3A]) -> std::io::Result<()> {
    for number in points.iter().flat_map(|point| point.to_array()) {
        to.write_all(&number.to_le_bytes())?;
    }
    Ok(())
}

/// How far the sums of rows are off: over rows, from the reference's Σ F and from 1.
struct SumErrors {
    /// |Σ F − Σ F of the reference|.
    sums: Vec<f64>,
    /// The same, less twice the reference's own standard error: what cannot be its noise.
    certain: Vec<f64>,
    /// |Σ F + escaped + blocked + unselected − 1|.
    closures: Vec<f64>,
}

impl SumErrors {
    fn new(model: &Model, parts: &[Part], exact: &[ReferenceRow]) -> Self {
        let mut table = RowTable::unknown(model.patches().len());
        for part in parts {
            table.add(part, Form::Plain);
        }
        let (mut sums, mut certain, mut closures) = (Vec::new(), Vec::new(), Vec::new());
        for row in exact {
            let patch = row.emitter as usize;
            let off = (table.row_sum[patch] - row.sum()).abs();
            sums.push(off);
            certain.push(off - 2.0 * row.sum_noise());
            let lost = table.escaped[patch] + table.blocked[patch] + table.unselected[patch];
            closures.push((table.row_sum[patch] + lost - 1.0).abs());
        }
        for values in [&mut sums, &mut certain, &mut closures] {
            values.sort_by(f64::total_cmp);
        }
        Self {
            sums,
            certain,
            closures,
        }
    }

    /// Whether no row's sum is farther off than that. What is not a number sorts last, and is not.
    fn are_within(&self, tolerance: f64) -> bool {
        [&self.certain, &self.closures]
            .into_iter()
            .all(|values| values.last().is_none_or(|&most| most <= tolerance))
    }
}

/// The value that so many per cent of sorted values do not exceed.
fn percentile(sorted: &[f64], percent: usize) -> f64 {
    let rank = (sorted.len() * percent).div_ceil(100).max(1);
    sorted.get(rank - 1).copied().unwrap_or(f64::NAN)
}

fn calibration(rows: u32, scenes: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "| scene | asked | got | 95 % of the matrix | asked ÷ got | ΣF off: 95th, max | ΣF + lost − 1: 95th, max | λ | ms a row | settled in s | noise |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let (mut runs, mut kept, mut closed, mut both, mut shares) = (0usize, 0usize, 0usize, 0usize, Vec::new());
    for name in scenes {
        let Some(model) = scene(name) else { continue };
        let exact = reference(name, &model, rows)?;
        for tolerance in [5e-2, 2e-2, 1e-2, 5e-3] {
            let started = std::time::Instant::now();
            let settled = settled(&model, tolerance, &mut CpuBackend::new())?;
            let settling = started.elapsed();
            let (seconds, parts) = computed(
                &model,
                rows,
                Correction::Tolerance(settled.refinement),
                settled.resolution,
                1,
            )?;
            let m = against(&exact, &parts);
            let sums = SumErrors::new(&model, &parts, &exact);
            let multiplier = settled.refinement.multiplier;
            let spread = |values: &[f64]| {
                format!(
                    "{:.2} %, {:.2} %",
                    100.0 * percentile(values, 95),
                    100.0 * percentile(values, 100)
                )
            };
            println!(
                "| {name} | {} % | {:.2} % | {:.2}–{:.2} % | {:.2} | {} | {} | {multiplier:.1e} | {:.2} | {:.1} | {:.2} % |",
                100.0 * tolerance,
                100.0 * m.relative_frobenius,
                100.0 * m.interval_of_matrix.low,
                100.0 * m.interval_of_matrix.high,
                tolerance / m.relative_frobenius,
                spread(&sums.sums),
                spread(&sums.closures),
                seconds * 1e3,
                settling.as_secs_f64(),
                100.0 * m.reference_noise,
            );
            let (within, adds_up) = (m.relative_frobenius <= tolerance, sums.are_within(tolerance));
            runs += 1;
            kept += usize::from(within);
            closed += usize::from(adds_up);
            both += usize::from(within && adds_up);
            shares.push(tolerance / m.relative_frobenius);
        }
    }
    shares.sort_by(f64::total_cmp);
    println!(
        "\nOf {runs} runs, {kept} are within the tolerance by the matrix, {closed} by the sum of every row, {both} by both; \
         the median is {:.2} times better than asked.",
        shares.get(shares.len() / 2).copied().unwrap_or(f64::NAN)
    );
    Ok(())
}

fn plan(model: &Model, rows: u32, samples: u32) -> Plan {
    let choice = RowChoice::Sample {
        count: rows,
        seed: SEED,
    };
    Plan::new(model, choice, Selection::default(), samples, true)
}

/// Processor time that this process has had, threads that have ended included, in seconds; `None` where the system does
/// not tell. To a hundredth of a second.
fn processor_time() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name, in brackets, may hold anything.
    let mut fields = stat.rsplit_once(')')?.1.split_ascii_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / 100.0)
}

/// Seconds of processor time a row, and how far the rows are from the reference.
fn measure(
    model: &Model,
    rows: u32,
    correction: Correction,
    resolution: u32,
    samples: u32,
    exact: &[ReferenceRow],
) -> Result<(f64, Measured), Box<dyn std::error::Error>> {
    let (seconds, parts) = computed(model, rows, correction, resolution, samples)?;
    Ok((seconds, against(exact, &parts)))
}

fn against(exact: &[ReferenceRow], parts: &[Part]) -> Measured {
    let estimated: Vec<EstimatedRow> = parts.iter().flat_map(EstimatedRow::of_part).collect();
    if std::env::var_os("WORST").is_some() {
        worst(exact, &estimated);
    }
    errors_against(exact, &estimated)
}

/// Seconds of processor time a row, and the rows.
fn computed(
    model: &Model,
    rows: u32,
    correction: Correction,
    resolution: u32,
    samples: u32,
) -> Result<(f64, Vec<Part>), Box<dyn std::error::Error>> {
    let plan = plan(model, rows, samples).with_correction(correction);
    let settings = RenderSettings {
        resolution,
        culling: Culling::On,
        covered: false,
    };
    let mut parts: Vec<Part> = Vec::new();
    let mut round = || {
        parts.clear();
        let execution = Execution {
            threads: 1,
            ..Execution::default()
        };
        let engine = match std::env::var("ENGINE").as_deref() {
            Ok("Depth") => EngineChoice::Depth,
            Ok("Order") => EngineChoice::Order,
            Ok("Claims") => EngineChoice::Claims,
            Ok(other) => panic!("ENGINE is Depth, Order or Claims, not {other}"),
            Err(_) => EngineChoice::Auto,
        };
        let backend = Box::new(CpuBackend::new().with_engine(engine));
        compute(model, &plan, settings, backend, execution, &mut parts, &mut |_| {})
    };
    // What is built once for a scene belongs to no row.
    round()?;
    // Until ticks of a hundredth of a second are fine enough.
    let (started, began) = (std::time::Instant::now(), processor_time());
    let mut rounds = 0;
    let seconds = loop {
        round()?;
        rounds += 1;
        let elapsed = match (began, processor_time()) {
            (Some(began), Some(now)) => now - began,
            _ => started.elapsed().as_secs_f64(),
        };
        if elapsed >= ENOUGH_SECONDS {
            break elapsed / (f64::from(rounds) * plan.rows.len() as f64);
        }
    };
    Ok((seconds, parts))
}

/// The entries with the largest part in the error.
fn worst(exact: &[ReferenceRow], estimated: &[EstimatedRow]) {
    let mut entries = Vec::new();
    for (e, a) in exact.iter().zip(estimated) {
        assert_eq!(e.emitter, a.emitter.0);
        let mut all: std::collections::BTreeMap<u32, (f64, f64)> = std::collections::BTreeMap::new();
        for (&c, &v) in e.columns.iter().zip(&e.values) {
            all.entry(c).or_default().0 = v;
        }
        for (&c, &v) in a.columns.iter().zip(&a.values) {
            all.entry(c).or_default().1 = v;
        }
        entries.extend(all.into_iter().map(|(c, (b, a))| ((a - b).powi(2), e.emitter, c, a, b)));
    }
    entries.sort_by(|p, q| q.0.total_cmp(&p.0));
    let total: f64 = entries.iter().map(|e| e.0).sum();
    for (squared, i, j, a, b) in entries.iter().take(12) {
        eprintln!(
            "   {:.3} of Σ d²: F[{i}, {j}] = {a:.6}, reference {b:.6}",
            squared / total
        );
    }
}

/// Reference rows of the sampled patches, from the cache where there is one.
fn reference(name: &str, model: &Model, rows: u32) -> Result<Vec<ReferenceRow>, Box<dyn std::error::Error>> {
    let emitters: Vec<InputPatch> = plan(model, rows, 1).rows;
    let cached = std::env::var_os("REFERENCE_CACHE").map(|folder| {
        let key = what_a_reference_depends_on(model, &emitters);
        Path::new(&folder).join(format!("{}-{rows}-{key:016x}.bin", name.replace('/', "-")))
    });
    if let Some(path) = &cached
        && let Ok(bytes) = std::fs::read(path)
    {
        return Ok(unpack(&bytes));
    }
    let settings = ReferenceSettings {
        target: 2e-3,
        ..ReferenceSettings::default()
    };
    let started = std::time::Instant::now();
    let exact = Reference::new(model, settings)?.rows(&emitters, 0, &mut |_| {})?;
    eprintln!(
        "{name}: reference in {:.1?}, noise {:.5}",
        started.elapsed(),
        noise_of(&exact)
    );
    if let Some(path) = &cached {
        std::fs::write(path, pack(&exact))?;
    }
    Ok(exact)
}

/// The scene, the rows, and the arithmetic: rows that an older reference left are none of this one.
fn what_a_reference_depends_on(model: &Model, emitters: &[InputPatch]) -> u64 {
    const SOURCES: [&str; 12] = [
        include_str!("../../crates/hemicube/src/reference.rs"),
        include_str!("../../crates/hemicube/src/reference/facing.rs"),
        include_str!("../../crates/hemicube/src/reference/hemisphere.rs"),
        include_str!("../../crates/hemicube/src/reference/pair.rs"),
        include_str!("../../crates/hemicube/src/reference/random.rs"),
        include_str!("../../crates/hemicube/src/reference/visibility.rs"),
        include_str!("../../crates/hemicube/src/factor.rs"),
        include_str!("../../crates/hemicube/src/factor/contour.rs"),
        include_str!("../../crates/hemicube/src/factor/coarse.rs"),
        include_str!("../../crates/hemicube/src/factor/far.rs"),
        include_str!("../../crates/hemicube/src/factor/lanes.rs"),
        include_str!("../../crates/hemicube/src/model.rs"),
    ];
    let mut hasher = DefaultHasher::new();
    SOURCES.hash(&mut hasher);
    emitters.hash(&mut hasher);
    for corner in model.patches().surfaces().iter().flatten() {
        corner.to_array().map(f64::to_bits).hash(&mut hasher);
    }
    hasher.finish()
}

fn pack(rows: &[ReferenceRow]) -> Vec<u8> {
    let mut numbers = Vec::new();
    for row in rows {
        numbers.extend([
            f64::from(row.emitter),
            row.columns.len() as f64,
            row.missed,
            row.error_of_missed,
            row.missed_squared,
        ]);
        for ((&c, &v), &e) in row.columns.iter().zip(&row.values).zip(&row.errors) {
            numbers.extend([f64::from(c), v, e]);
        }
    }
    numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
}

fn unpack(bytes: &[u8]) -> Vec<ReferenceRow> {
    let numbers: Vec<f64> = bytes
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes(b.try_into().expect("eight bytes")))
        .collect();
    let mut rows = Vec::new();
    let mut at = 0;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "written as integers"
    )]
    while at < numbers.len() {
        let mut row = ReferenceRow {
            emitter: numbers[at] as u32,
            missed: numbers[at + 2],
            error_of_missed: numbers[at + 3],
            missed_squared: numbers[at + 4],
            ..ReferenceRow::default()
        };
        let count = numbers[at + 1] as usize;
        at += 5;
        for entry in numbers[at..at + 3 * count].chunks_exact(3) {
            row.columns.push(entry[0] as u32);
            row.values.push(entry[1]);
            row.errors.push(entry[2]);
        }
        at += 3 * count;
        rows.push(row);
    }
    rows
}
