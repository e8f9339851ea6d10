//! What goes into a submission, stage by stage, and the compute pipelines.

use crate::cull::Mode;
use crate::device::Gpu;
use crate::render::{Pipeline, Render, What, bind, compute};
use crate::upload::{Frame, Scene};
use ash::vk;
use ash::vk::{AccessFlags2 as A, PipelineStageFlags2 as P};
use hemicube_contract::backend::BackendError;
use hemicube_shaders::Edges;
use hemicube_shaders::limits::SETTLE_GROUPS;
use hemicube_shaders::stage;
use hemicube_shaders::view::FACES;
use std::sync::Arc;

/// Marks of the clock in a group: before the first stage and after each of five.
pub(crate) const MARKS: u32 = 6;

/// All pipelines of a scene.
#[derive(Debug)]
pub(crate) struct Stages {
    gpu: Arc<Gpu>,
    render: Render,
    pyramid_of: Pipeline,
    cull_seen: Pipeline,
    cull_hidden: Pipeline,
    cull_outside: Pipeline,
    reduce: Pipeline,
    settling: Option<Settling>,
    tiny: Pipeline,
    compact: Pipeline,
    pack: Pipeline,
}

/// What gives pixels near edges to the triangle that their centre lies in.
#[derive(Debug)]
struct Settling {
    near_edges: Pipeline,
    settle: Pipeline,
    put_settled: Pipeline,
    take_back: Pipeline,
}

/// What a submission does.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Work {
    /// Number of hemicubes.
    pub(crate) slots: u32,
    pub(crate) mode: Mode,
    pub(crate) covered: bool,
    /// True if some hemicube does not stand on its emitter.
    pub(crate) without_emitter: bool,
    /// Where marks of the clock go, if they do.
    pub(crate) marks: Option<vk::QueryPool>,
}

/// A use of memory: in which stages, and how.
type Use = (P, A);

const COMPUTE_WRITES: Use = (P::COMPUTE_SHADER, A::SHADER_STORAGE_WRITE);
const COMPUTE_USES: Use = (
    P::COMPUTE_SHADER,
    A::from_raw(A::SHADER_STORAGE_READ.as_raw() | A::SHADER_STORAGE_WRITE.as_raw() | A::SHADER_SAMPLED_READ.as_raw()),
);
const DEPTHS_USE: Use = (
    P::from_raw(P::EARLY_FRAGMENT_TESTS.as_raw() | P::LATE_FRAGMENT_TESTS.as_raw()),
    A::from_raw(A::DEPTH_STENCIL_ATTACHMENT_READ.as_raw() | A::DEPTH_STENCIL_ATTACHMENT_WRITE.as_raw()),
);
const DRAWING: Use = (
    P::from_raw(DEPTHS_USE.0.as_raw() | P::COLOR_ATTACHMENT_OUTPUT.as_raw()),
    A::from_raw(DEPTHS_USE.1.as_raw() | A::COLOR_ATTACHMENT_WRITE.as_raw()),
);
const DRAWS_READ: Use = (P::DRAW_INDIRECT, A::INDIRECT_COMMAND_READ);
const COVER_READS: Use = (
    P::from_raw(P::VERTEX_SHADER.as_raw() | P::FRAGMENT_SHADER.as_raw()),
    A::from_raw(A::SHADER_STORAGE_READ.as_raw() | A::SHADER_STORAGE_WRITE.as_raw() | A::SHADER_SAMPLED_READ.as_raw()),
);
const COVER_WRITES: Use = (P::FRAGMENT_SHADER, A::SHADER_STORAGE_WRITE);
const COPIES: Use = (
    P::ALL_TRANSFER,
    A::from_raw(A::TRANSFER_READ.as_raw() | A::TRANSFER_WRITE.as_raw()),
);
const HOST_READS: Use = (P::HOST, A::HOST_READ);

impl Stages {
    pub(crate) fn new(gpu: &Arc<Gpu>, scene: &Scene) -> Result<Self, BackendError> {
        let layout = scene.layout;
        let make = |stage| compute(gpu, layout, stage);
        let edges = scene.plan.edges;
        let (reduce, settling) = match edges {
            Edges::Driver => (&stage::REDUCE, None),
            Edges::Exact => {
                let settling = Settling {
                    near_edges: make(&stage::NEAR_EDGES)?,
                    settle: make(&stage::SETTLE)?,
                    put_settled: make(&stage::PUT_SETTLED)?,
                    take_back: make(&stage::TAKE_BACK)?,
                };
                (&stage::REDUCE_SIDES, Some(settling))
            }
        };
        Ok(Self {
            gpu: Arc::clone(gpu),
            render: Render::new(gpu, layout, edges)?,
            pyramid_of: make(if scene.plan.copies_depths {
                &stage::PYRAMID_OF_COPY
            } else {
                &stage::PYRAMID_OF
            })?,
            cull_seen: make(&stage::CULL_SEEN)?,
            cull_hidden: make(&stage::CULL_HIDDEN)?,
            cull_outside: make(&stage::CULL_OUTSIDE)?,
            reduce: make(reduce)?,
            settling,
            tiny: make(&stage::TINY)?,
            compact: make(&stage::COMPACT)?,
            pack: make(&stage::PACK)?,
        })
    }

    fn after(&self, commands: vk::CommandBuffer, before: &[Use], then: &[Use]) {
        let join = |uses: &[Use]| {
            uses.iter()
                .fold((P::empty(), A::empty()), |(p, a), u| (p | u.0, a | u.1))
        };
        let (before, then) = (join(before), join(then));
        let barrier = [vk::MemoryBarrier2 {
            src_stage_mask: before.0,
            src_access_mask: before.1,
            dst_stage_mask: then.0,
            dst_access_mask: then.1,
            ..Default::default()
        }];
        let dependency = vk::DependencyInfo::default().memory_barriers(&barrier);
        // SAFETY: commands of this device that are being recorded.
        unsafe { self.gpu.raw.cmd_pipeline_barrier2(commands, &dependency) };
    }

    /// Records the stages of a submission.
    pub(crate) fn record(&self, scene: &Scene, frame: &Frame, commands: vk::CommandBuffer, work: Work) {
        // The submission before may still be at work with all that is not the frame's own.
        let all = [COMPUTE_USES, DRAWING, COVER_READS, DRAWS_READ];
        self.after(commands, &all, &all);
        let mut group = 0;
        let mut slot = 0;
        while slot < work.slots {
            let layers = scene.plan.group.min(work.slots - slot);
            self.record_group(scene, frame, commands, work, (group, slot, layers));
            slot += layers;
            group += 1;
        }
        self.after(commands, &[COMPUTE_WRITES], &[HOST_READS]);
    }

    fn record_group(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        work: Work,
        (group, slot, layers): (u32, u32, u32),
    ) {
        let after = |before: &[Use], then: &[Use]| self.after(commands, before, then);
        let dispatch = |pipeline: &Pipeline, [x, y, z]: [u32; 3]| {
            // SAFETY: commands of this device that are being recorded; the group's first view is in the views.
            unsafe {
                let device = &self.gpu.raw;
                device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline.raw);
                bind(
                    &self.gpu,
                    scene,
                    frame,
                    commands,
                    vk::PipelineBindPoint::COMPUTE,
                    slot * FACES,
                );
                device.cmd_dispatch(commands, x, y, z);
            }
        };
        let draw = |what| {
            for layer in 0..layers {
                let at = (slot + layer, layer);
                self.render.draw(scene, frame, commands, at, what, work.without_emitter);
            }
        };
        let mark = |number: u32| {
            if let Some(pool) = work.marks {
                // SAFETY: the pool has room for the marks of all groups of a submission.
                unsafe {
                    let device = &self.gpu.raw;
                    device.cmd_write_timestamp2(commands, P::ALL_COMMANDS, pool, group * MARKS + number);
                }
            }
        };
        let n = scene.plan.resolution;
        mark(0);
        match work.mode {
            Mode::Off => {}
            Mode::Frustum => {
                dispatch(&self.cull_outside, [FACES, layers, 1]);
                after(&[COMPUTE_WRITES], &[DRAWS_READ, COMPUTE_USES]);
            }
            Mode::Occlusion => {
                dispatch(&self.cull_seen, [FACES, layers, 1]);
                after(&[COMPUTE_WRITES], &[DRAWS_READ, COMPUTE_USES]);
                draw(What::Occluders);
                let before = [DEPTHS_USE, DRAWS_READ];
                if scene.plan.copies_depths {
                    after(&before, &[COPIES]);
                    scene.copy_depths(commands, layers);
                    after(&[COPIES], &[COMPUTE_USES]);
                } else {
                    after(&before, &[COMPUTE_USES]);
                }
                dispatch(&self.pyramid_of, [n / 16, 3 * n / 16, layers]);
                after(&[COMPUTE_USES], &[COMPUTE_USES]);
                dispatch(&self.cull_hidden, [FACES, layers, 1]);
                after(
                    &[COMPUTE_USES, DEPTHS_USE, COPIES],
                    &[DRAWS_READ, COMPUTE_USES, DEPTHS_USE],
                );
            }
        }
        mark(1);
        draw(if work.mode == Mode::Off {
            What::All
        } else {
            What::Listed
        });
        after(&[DRAWING, DRAWS_READ], &[COMPUTE_USES]);
        mark(2);
        dispatch(&self.reduce, [scene.plan.reduce_groups(), layers, 1]);
        after(&[COMPUTE_USES], &[COMPUTE_USES]);
        if let Some(settling) = &self.settling {
            dispatch(&settling.near_edges, [SETTLE_GROUPS, layers, 1]);
            after(&[COMPUTE_USES], &[COMPUTE_USES]);
            dispatch(&settling.settle, [SETTLE_GROUPS, layers, 1]);
            after(&[COMPUTE_USES], &[COMPUTE_USES]);
            dispatch(&settling.put_settled, [SETTLE_GROUPS, layers, 1]);
            after(&[COMPUTE_USES], &[COMPUTE_USES]);
        }
        if work.covered {
            let (x, z) = scene.plan.tiny_groups(&scene.upload);
            dispatch(&self.tiny, [x, layers, z]);
            after(&[COMPUTE_USES], &[COMPUTE_USES]);
        }
        dispatch(&self.compact, [layers, 1, 1]);
        after(&[COMPUTE_USES], &[COMPUTE_USES, DRAWS_READ, COVER_READS]);
        mark(3);
        if work.covered {
            for layer in 0..layers {
                self.render.cover(scene, frame, commands, (slot + layer, layer));
            }
            after(&[COVER_WRITES, COVER_READS, DRAWS_READ], &[COMPUTE_USES]);
            if let Some(settling) = &self.settling {
                dispatch(&settling.take_back, [SETTLE_GROUPS, layers, 1]);
                after(&[COMPUTE_USES], &[COMPUTE_USES]);
            }
        }
        mark(4);
        dispatch(&self.pack, [4, layers, 1]);
        mark(5);
        // The next group reuses the layers and all that is a layer's.
        after(&[COMPUTE_USES, COVER_READS], &[COMPUTE_USES, DRAWING, COVER_READS]);
    }
}
