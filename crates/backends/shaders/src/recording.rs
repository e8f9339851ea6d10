//! The steps of a group of hemicubes, as data: one list for all APIs, one interpreter in each backend.
//!
//! A step is a compute stage with its work groups, or a draw. A stage names the buffers it reads and writes
//! ([`Stage::reads`], [`Stage::writes`]). From these, the interpreter (`reduce.rs` of each backend) makes barriers,
//! passes, bind groups and timestamps.
//!
//! Two things are not data. *Barriers*, because each API has its own kind: wgpu sets them itself, OpenGL has one call
//! after each dispatch, Vulkan pairs of pipeline stages. *Culling by the host* in the GL backend (`cull=view`, `marks`,
//! `queries`), because its draws depend on answers read back within a hemicube. It records [`Cull::Off`] and carries
//! out [`Action::DrawItems`] by lists of its own.

use crate::limits::{Draw, Edges, Plan, SETTLE_GROUPS};
use crate::stage::{self, Kind, Stage};
use crate::upload::Upload;
use crate::view::FACES;
use hemicube_contract::backend::StageTimes;

/// Work groups to pack one row: enough for the bandwidth of a few thousand entries.
const PACK_GROUPS: u32 = 4;

/// Culling by the device. Rows are equal to the bit with each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cull {
    /// Every chunk is drawn on every face.
    Off,
    /// Chunks outside a face's frustum are left out.
    Frustum,
    /// Chunks behind the depths of chunks seen by earlier hemicubes are left out, too.
    Occlusion,
}

/// The last result of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Goal {
    /// Item buffers. With [`Edges::Exact`] ids are settled on the way to a row: uncovered rows are made.
    Items,
    /// Visible weights of all patches, in [`stage::binding::VISIBLE`]: by [`Draw::Raster`] alone, as rows reset the
    /// queue of tiles.
    Weights,
    /// Rows, in [`stage::binding::OUTPUT`].
    Rows,
}

/// The part of the work to which a step's time counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Choosing the chunks to draw.
    Cull,
    /// Drawing depths and ids.
    Render,
    /// Adding up weights and picking entries.
    Reduce,
    /// Drawing visible patches alone.
    Cover,
    /// Packing rows.
    ReadBack,
}

impl Phase {
    /// The time of this phase, in nanoseconds.
    pub fn time(self, times: &mut StageTimes) -> &mut u64 {
        match self {
            Self::Cull => &mut times.cull,
            Self::Render => &mut times.render,
            Self::Reduce => &mut times.reduce,
            Self::Cover => &mut times.cover,
            Self::ReadBack => &mut times.read_back,
        }
    }
}

/// A step, for all layers of a group.
#[derive(Clone, Copy, Debug)]
pub enum Action {
    /// Runs a compute stage. [`stage::binding::VIEW`] is face 0 of the group's first slot.
    Dispatch {
        /// The stage.
        stage: &'static Stage,
        /// Work groups in x, y and z.
        groups: [u32; 3],
    },
    /// Clears depths to 0, infinitely far, and draws the listed chunks into them.
    DrawDepths,
    /// Copies depths to [`stage::binding::DEPTH_COPY`].
    CopyDepths,
    /// Clears depths to 0 and ids to escaped, and draws ids: of the listed chunks, or of all with [`Cull::Off`].
    DrawItems,
    /// Draws the entries of each row alone, by [`stage::binding::COVER_DRAWS`].
    DrawCover,
}

/// An action and its phase.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// The phase.
    pub phase: Phase,
    /// The action.
    pub action: Action,
}

/// Makes the steps of groups.
#[derive(Clone, Copy, Debug)]
pub struct Recording<'a> {
    /// The plan of the scene.
    pub plan: &'a Plan,
    /// The scene.
    pub upload: &'a Upload,
    /// The device's culling.
    pub cull: Cull,
    /// The last result.
    pub goal: Goal,
}

impl Recording<'_> {
    /// The steps of a group of `layers` hemicubes.
    pub fn steps(&self, layers: u32) -> Vec<Step> {
        let mut steps = Vec::with_capacity(20);
        if self.plan.draw == Draw::Compute {
            self.add_tiles(&mut steps, layers);
            return steps;
        }
        self.add_culling(&mut steps, layers);
        add(&mut steps, Phase::Render, Action::DrawItems);
        let exact = self.plan.edges == Edges::Exact;
        if self.goal == Goal::Items && !exact {
            return steps;
        }
        let settle = [SETTLE_GROUPS, layers, 1];
        dispatch(
            &mut steps,
            Phase::Reduce,
            weights_of(self.plan.edges),
            [self.plan.reduce_groups(), layers, 1],
        );
        if exact {
            for stage in [&stage::NEAR_EDGES, &stage::SETTLE, &stage::PUT_SETTLED] {
                dispatch(&mut steps, Phase::Reduce, stage, settle);
            }
        }
        if self.goal == Goal::Weights {
            return steps;
        }
        let covered = self.plan.covered && self.goal == Goal::Rows;
        if covered {
            let (x, z) = self.plan.tiny_groups(self.upload);
            dispatch(&mut steps, Phase::Reduce, &stage::TINY, [x, layers, z]);
        }
        dispatch(&mut steps, Phase::Reduce, &stage::COMPACT, [layers, 1, 1]);
        if covered {
            add(&mut steps, Phase::Cover, Action::DrawCover);
            if exact {
                dispatch(&mut steps, Phase::Cover, &stage::TAKE_BACK, settle);
            }
        }
        dispatch(&mut steps, Phase::ReadBack, &stage::PACK, [PACK_GROUPS, layers, 1]);
        steps
    }

    /// The steps by compute alone. Item buffers are kept on the way to a row, too.
    fn add_tiles(&self, steps: &mut Vec<Step>, layers: u32) {
        let covered = self.plan.covered && self.goal == Goal::Rows;
        let draw = if covered || self.goal == Goal::Items {
            &stage::KEEP_TILES
        } else {
            &stage::DRAW_TILES
        };
        dispatch(steps, Phase::Render, draw, [self.plan.tile_groups(layers), layers, 1]);
        let settle = [SETTLE_GROUPS, layers, 1];
        if covered {
            dispatch(steps, Phase::Reduce, &stage::TINY_OF_ALL, settle);
        }
        dispatch(steps, Phase::Reduce, &stage::COMPACT, [layers, 1, 1]);
        if covered {
            dispatch(steps, Phase::Cover, &stage::COVER_TILES, settle);
        }
        dispatch(steps, Phase::ReadBack, &stage::PACK, [PACK_GROUPS, layers, 1]);
    }

    fn add_culling(&self, steps: &mut Vec<Step>, layers: u32) {
        let faces = [FACES, layers, 1];
        match self.cull {
            Cull::Off => {}
            Cull::Frustum => dispatch(steps, Phase::Cull, &stage::CULL_OUTSIDE, faces),
            Cull::Occlusion => {
                dispatch(steps, Phase::Cull, &stage::CULL_SEEN, faces);
                add(steps, Phase::Render, Action::DrawDepths);
                if self.plan.copies_depths {
                    add(steps, Phase::Cull, Action::CopyDepths);
                }
                let n = self.plan.resolution;
                dispatch(
                    steps,
                    Phase::Cull,
                    pyramid_of(self.plan.copies_depths),
                    [n / 16, 3 * n / 16, layers],
                );
                dispatch(steps, Phase::Cull, &stage::CULL_HIDDEN, faces);
            }
        }
    }
}

fn add(steps: &mut Vec<Step>, phase: Phase, action: Action) {
    steps.push(Step { phase, action });
}

fn dispatch(steps: &mut Vec<Step>, phase: Phase, stage: &'static Stage, groups: [u32; 3]) {
    add(steps, phase, Action::Dispatch { stage, groups });
}

fn pyramid_of(copies_depths: bool) -> &'static Stage {
    if copies_depths {
        &stage::PYRAMID_OF_COPY
    } else {
        &stage::PYRAMID_OF
    }
}

fn weights_of(edges: Edges) -> &'static Stage {
    match edges {
        Edges::Driver => &stage::REDUCE,
        Edges::Exact => &stage::REDUCE_SIDES,
    }
}

/// The fragment stages for ids: of all patches, and of all but the emitter.
pub fn identify(edges: Edges) -> [&'static Stage; 2] {
    match edges {
        Edges::Driver => [&stage::IDENTIFY, &stage::IDENTIFY_OTHERS],
        Edges::Exact => [&stage::IDENTIFY_SIDES, &stage::IDENTIFY_OTHER_SIDES],
    }
}

/// The compute stages of recordings that draw so with these edges. `copies_depths` lists the possible values of
/// [`Plan::copies_depths`].
pub fn compute_stages(draw: Draw, edges: Edges, copies_depths: &[bool]) -> Vec<&'static Stage> {
    const BY_COMPUTE: [&str; 6] = [
        "draw_tiles",
        "keep_tiles",
        "tiny_of_all",
        "compact",
        "cover_tiles",
        "pack",
    ];
    let pyramids: Vec<_> = copies_depths.iter().map(|&copies| pyramid_of(copies).entry).collect();
    stage::ALL
        .iter()
        .filter(|stage| stage.kind == Kind::Compute)
        .filter(|stage| match stage.file {
            _ if draw == Draw::Compute => BY_COMPUTE.contains(&stage.entry),
            "tiles" | "covered" | "rays" => false,
            "tiny" => stage.entry == stage::TINY.entry,
            "reduce" => edges == Edges::Driver,
            "settle" => edges == Edges::Exact,
            "pyramid" => pyramids.contains(&stage.entry),
            _ => true,
        })
        .collect()
}
