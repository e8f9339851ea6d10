//! Recordings of all kinds: each step reads only what was written before.

use hemicube::{HierarchyOptions, Model};
use hemicube_contract::backend::{Culling, RenderSettings};
use hemicube_scene::{Patches, Subdivision, generate};
use hemicube_shaders::recording::compute_stages;
use hemicube_shaders::stage::{self, Stage, binding as b};
use hemicube_shaders::upload::contents;
use hemicube_shaders::{Action, Cull, Draw, Edges, Goal, Limits, Phase, Plan, Recording, Step, Upload};
use std::collections::BTreeSet;

fn model() -> Model {
    let patches = Patches::new(&generate::cornell_box(), Subdivision::None).expect("a scene that fits");
    Model::new(patches.into(), HierarchyOptions::default()).expect("a scene with an extent")
}

fn plan(upload: &Upload, covered: bool, draw: Draw, edges: Edges, copies_depths: bool) -> Plan {
    let settings = RenderSettings {
        resolution: 64,
        culling: Culling::On,
        covered,
    };
    let limits = Limits {
        storage_range: 1 << 30,
        memory: 1 << 32,
        layers: 64,
        image_edge: 4096,
        group: 4,
        batch: 8,
        tile_groups: 16,
        tiles_each: u32::MAX,
        copies_depths,
        edges,
        draw,
    };
    Plan::new(upload, settings, limits).expect("a small scene")
}

/// Buffers beginning at 0. Stages count on that, and leave them so.
const ZEROED: [u32; 7] = [b::SEEN, b::TALLIES, b::VISIBLE, b::TOUCHED, b::NEAR, b::SIDES, b::DRAWN];

/// The first binding read by a step before it was written.
fn missing(known: &mut BTreeSet<u32>, step: &Step) -> Option<u32> {
    let stages = |stages: &[&'static Stage]| -> (Vec<u32>, Vec<u32>) {
        (
            stages.iter().flat_map(|s| s.reads).copied().collect(),
            stages.iter().flat_map(|s| s.writes).copied().collect(),
        )
    };
    let (reads, writes) = match step.action {
        Action::Dispatch { stage, .. } => {
            let (reads, mut writes) = stages(&[stage]);
            // The item buffer by its other name.
            if writes.contains(&b::SETTLED_ITEMS) {
                writes.push(b::ITEMS);
            }
            (reads, writes)
        }
        Action::DrawDepths => (vec![b::DRAWS, b::DRAW_COUNTS], vec![b::DEPTHS]),
        Action::CopyDepths => (vec![b::DEPTHS], vec![b::DEPTH_COPY]),
        Action::DrawItems => (Vec::new(), vec![b::DEPTHS, b::ITEMS]),
        Action::DrawCover => {
            let (mut reads, writes) = stages(&[&stage::COVER, &stage::ADD_HIDDEN]);
            reads.push(b::COVER_DRAWS);
            (reads, writes)
        }
    };
    // The cull stages bind the pyramid; only the last reads it.
    let is_blind = matches!(step.action, Action::Dispatch { stage, .. }
        if [stage::CULL_SEEN.entry, stage::CULL_OUTSIDE.entry].contains(&stage.entry));
    let found = reads
        .into_iter()
        .find(|read| !(known.contains(read) || is_blind && *read == b::PYRAMID));
    known.extend(writes);
    found
}

#[test]
fn every_step_reads_what_was_written_before() {
    let model = model();
    let upload = Upload::new(model.geometry()).expect("a small scene");
    for cull in [Cull::Off, Cull::Frustum, Cull::Occlusion] {
        for goal in [Goal::Items, Goal::Weights, Goal::Rows] {
            for kind in 0..16 {
                let edges = if kind & 1 == 0 { Edges::Driver } else { Edges::Exact };
                let draw = if kind & 8 == 0 { Draw::Raster } else { Draw::Compute };
                if draw == Draw::Compute && goal == Goal::Weights {
                    continue;
                }
                let plan = plan(&upload, kind & 2 != 0, draw, edges, kind & 4 != 0);
                let recording = Recording {
                    plan: &plan,
                    upload: &upload,
                    cull,
                    goal,
                };
                let steps = recording.steps(3);
                let uploaded = contents(&upload, model.geometry(), &plan);
                let known: BTreeSet<u32> = uploaded.iter().map(|(binding, _)| *binding).collect();
                let mut known: BTreeSet<u32> = known.into_iter().chain(ZEROED).chain([b::VIEWS]).collect();
                for step in &steps {
                    assert_eq!(missing(&mut known, step), None, "{step:?} of {recording:?}");
                }
                let all = compute_stages(draw, edges, &[plan.copies_depths]);
                for step in &steps {
                    if let Action::Dispatch { stage, groups } = step.action {
                        assert!(all.iter().any(|known| known.entry == stage.entry), "{}", stage.entry);
                        assert!(groups.iter().all(|&n| n > 0), "{step:?}");
                    }
                }
                let last = steps.last().expect("steps");
                let expected = match goal {
                    Goal::Items if draw == Draw::Raster && edges == Edges::Driver => Phase::Render,
                    Goal::Weights => Phase::Reduce,
                    _ => Phase::ReadBack,
                };
                assert_eq!(last.phase, expected);
            }
        }
    }
}

#[test]
fn a_step_left_out_is_noticed() {
    let model = model();
    let upload = Upload::new(model.geometry()).expect("a small scene");
    let plan = plan(&upload, true, Draw::Raster, Edges::Exact, false);
    let recording = Recording {
        plan: &plan,
        upload: &upload,
        cull: Cull::Occlusion,
        goal: Goal::Rows,
    };
    let steps = recording.steps(1);
    let uploaded = contents(&upload, model.geometry(), &plan);
    for left_out in ["cull_seen", "pyramid_of", "compact"] {
        let known: BTreeSet<u32> = uploaded.iter().map(|(binding, _)| *binding).collect();
        let mut known: BTreeSet<u32> = known.into_iter().chain(ZEROED).chain([b::VIEWS]).collect();
        let without = steps
            .iter()
            .filter(|step| !matches!(step.action, Action::Dispatch { stage, .. } if stage.entry == left_out));
        let found = without.filter_map(|step| missing(&mut known, step)).count();
        assert!(found > 0, "without {left_out}");
    }
}
