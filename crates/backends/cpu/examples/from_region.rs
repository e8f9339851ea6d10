//! What a set of surfaces that neighbours share could gain (from-region visibility, Wonka, Wimmer & Schmalstieg 2000):
//! `from_region [RESOLUTION [CLUSTERS [FILE SPLIT]…]]`, on generated scenes where no file is named.
//!
//! Patches that follow each other in the order of work form a cluster, and are rendered from three scenes: the whole
//! one; one without what lies behind all their planes, which is conservative and cheap to find; and one with nothing
//! but what at least one of them sees. The last is an oracle: no conservative set is smaller, so no algorithm gains
//! more than it does. Rows must be the same bits from all three. Milliseconds of processor time a row; with *and
//! loading*, what it takes to put the set into a tree is shared by the rows of the cluster, and finding the set costs
//! nothing.
#![allow(clippy::print_stdout, reason = "an example prints")]

mod clock;

use clock::thread_seconds;
use hemicube::backend::{Culling, Geometry, Hemicube, HemicubeBackend, RenderSettings, Surface};
use hemicube::row::RowBlock;
use hemicube::{HierarchyOptions, InputPatch, Model};
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_scene::generate::{Generate, Kind, generate};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Patches, ReadOptions, Subdivision, load};
use hemicube_spatial::{Aabb, Octree};
use std::sync::Arc;

type Failed = Box<dyn std::error::Error>;

/// Long enough that a clock of ticks can tell.
const LEAST_SECONDS: f64 = 0.08;
const TURNS: usize = 3;

fn main() -> Result<(), Failed> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: u32| args.get(i).map_or(Ok(default), |a| a.parse::<u32>());
    let (resolution, clusters) = (number(0, 128)?, number(1, 6)? as usize);
    println!("N = {resolution}, {clusters} clusters of each size; ms a row");
    println!(
        "| scene | engine | patches of a cluster | seen by one | by the cluster | of | whole scene | behind left out | gain | oracle | gain | oracle and loading | gain |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    let files = args.get(2..).unwrap_or_default();
    let kinds = [(Kind::City, 1), (Kind::City, 4), (Kind::Maze, 4), (Kind::Room, 1)];
    for (kind, split) in kinds.into_iter().filter(|_| files.is_empty()) {
        let spec = Generate {
            kind,
            target_patches: 8_897,
            seed: 1,
        };
        let patches = Patches::new(&generate(spec)?, Subdivision::Split(split))?;
        study(&format!("{kind} ×{}", split * split), patches, resolution, clusters)?;
    }
    for pair in files.chunks(2) {
        let mut scene = load(pair[0].as_ref(), ReadOptions::default())?;
        repair(&mut scene, RepairOptions::default());
        let split = pair.get(1).map_or(Ok(1), |text| text.parse::<u32>())?;
        let patches = Patches::new(&scene, Subdivision::Split(split))?;
        study(
            &format!("{} ×{}", pair[0], split * split),
            patches,
            resolution,
            clusters,
        )?;
    }
    Ok(())
}

fn study(name: &str, patches: Patches, resolution: u32, clusters: usize) -> Result<(), Failed> {
    let model = Model::new(patches.into(), HierarchyOptions::default())?;
    let order: Vec<InputPatch> = model.order().collect();
    let settings = RenderSettings {
        resolution,
        culling: Culling::On,
        covered: false,
    };
    for choice in [EngineChoice::Depth, EngineChoice::Order] {
        let mut whole = CpuBackend::new().with_engine(choice);
        if whole.load(model.geometry(), settings).is_err() {
            continue;
        }
        for size in [16, 64, 256] {
            let mut sums = Sums::default();
            for place in 0..clusters {
                let start = place * (order.len() - size) / clusters;
                let members = &order[start..start + size];
                let hemicubes: Vec<Hemicube> = members.iter().flat_map(|&p| model.hemicubes(p, 1, true)).collect();
                sums.add(&model, &mut whole, choice, settings, &hemicubes)?;
            }
            sums.print(name, choice, size, model.geometry().surfaces.len());
        }
    }
    Ok(())
}

/// Sums over clusters; seconds are of all rows of them.
#[derive(Debug, Default)]
struct Sums {
    clusters: f64,
    rows: f64,
    seen: f64,
    seen_by_cluster: f64,
    whole: f64,
    before: f64,
    oracle: f64,
    loading: f64,
}

impl Sums {
    fn add(
        &mut self,
        model: &Model,
        whole: &mut CpuBackend,
        choice: EngineChoice,
        settings: RenderSettings,
        hemicubes: &[Hemicube],
    ) -> Result<(), Failed> {
        let geometry = model.geometry();
        let mut rows = RowBlock::default();
        whole.rows(hemicubes, &mut rows)?;
        // Rows do not say which backs they see, and those would be missed: buried patches stay out.
        let sees_none = |(_, blocked): &(&Hemicube, &u32)| **blocked == 0;
        let clear: Vec<Hemicube> = hemicubes
            .iter()
            .zip(&rows.blocked)
            .filter(sees_none)
            .map(|(h, _)| *h)
            .collect();
        if clear.is_empty() {
            return Ok(());
        }
        let hemicubes = clear.as_slice();
        rows.clear();
        whole.rows(hemicubes, &mut rows)?;
        let mut seen = vec![false; geometry.patch_count as usize];
        rows.patches.iter().for_each(|&patch| seen[patch as usize] = true);
        // The surfaces of the emitters stay: they are skipped by what they are.
        hemicubes
            .iter()
            .filter_map(|h| h.emitter)
            .for_each(|patch| seen[patch.0 as usize] = true);
        let is_seen = |s: &Surface| seen[s.front.0 as usize] || s.back.is_some_and(|back| seen[back.0 as usize]);
        let tolerance = geometry.plane_tolerance;
        let is_before = |s: &Surface| {
            is_seen(s)
                || hemicubes.iter().any(|h| {
                    let height = |corner| h.axes[2].dot(corner - h.origin);
                    s.corners.iter().any(|&corner| height(corner) > tolerance)
                })
        };
        let (oracle, loading) = part(geometry, is_seen, choice, settings)?;
        let (before, _) = part(geometry, is_before, choice, settings)?;
        let mut sessions = [Some(oracle), Some(before)];
        let mut best = [f64::INFINITY; 3];
        for _ in 0..TURNS {
            best[0] = best[0].min(seconds(whole, hemicubes, &rows)?);
            for (session, best) in sessions.iter_mut().zip(&mut best[1..]) {
                if let Some(session) = session {
                    *best = best.min(seconds(session, hemicubes, &rows)?);
                }
            }
        }
        self.clusters += 1.0;
        self.rows += hemicubes.len() as f64;
        self.seen += rows.patches.len() as f64;
        self.seen_by_cluster += seen.iter().filter(|&&seen| seen).count() as f64;
        self.whole += best[0];
        self.oracle += best[1];
        self.before += best[2];
        self.loading += loading;
        Ok(())
    }

    fn print(&self, name: &str, choice: EngineChoice, size: usize, surfaces: usize) {
        let row = |seconds: f64| 1e3 * seconds / self.rows;
        println!(
            "| {name} | {choice:?} | {size} | {:.0} | {:.0} | {surfaces} | {:.4} | {:.4} | {:.2}× | {:.4} | {:.2}× | {:.4} | {:.2}× |",
            self.seen / self.rows,
            self.seen_by_cluster / self.clusters,
            row(self.whole),
            row(self.before),
            self.whole / self.before,
            row(self.oracle),
            self.whole / self.oracle,
            row(self.oracle + self.loading),
            self.whole / (self.oracle + self.loading),
        );
    }
}

/// A session over some of the surfaces, and what it took to load it.
fn part(
    geometry: &Geometry,
    is_in: impl Fn(&Surface) -> bool,
    choice: EngineChoice,
    settings: RenderSettings,
) -> Result<(CpuBackend, f64), Failed> {
    let start = thread_seconds();
    let found: Vec<Surface> = geometry.surfaces.iter().filter(|s| is_in(s)).copied().collect();
    let filtered = thread_seconds() - start;
    let start = thread_seconds();
    let boxes: Vec<Aabb> = found.iter().map(|s| Aabb::from_points(s.corners)).collect();
    let octree = Octree::build_loose(&boxes, geometry.octree.options())?;
    let surfaces = octree.order().iter().map(|&k| found[k as usize]).collect();
    let part = Geometry::new(surfaces, octree, geometry.patch_count, geometry.plane_tolerance);
    let mut session = CpuBackend::new().with_engine(choice);
    session.load(&Arc::new(part), settings)?;
    // The tables of weights are made anew as well, which sessions of one scene share: some tenths of a millisecond.
    Ok((session, (thread_seconds() - start + filtered).max(0.0)))
}

/// Seconds of these rows, which must be those expected.
fn seconds(session: &mut CpuBackend, hemicubes: &[Hemicube], expected: &RowBlock) -> Result<f64, Failed> {
    let mut rows = RowBlock::default();
    let (start, mut passes) = (thread_seconds(), 0.0);
    loop {
        rows.clear();
        session.rows(hemicubes, &mut rows)?;
        passes += 1.0;
        let spent = thread_seconds() - start;
        if spent >= LEAST_SECONDS {
            if (&rows.patches, &rows.visible, &rows.escaped)
                != (&expected.patches, &expected.visible, &expected.escaped)
            {
                return Err("rows from a part of the scene are not those from the whole".into());
            }
            return Ok(spent / passes);
        }
    }
}
