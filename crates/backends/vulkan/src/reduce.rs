//! Records the steps of a submission, and makes the compute pipelines.
//!
//! [`Stages::record`] is the interpreter of [`hemicube_shaders::recording`] on Vulkan. Between two steps it puts a
//! memory barrier, from the uses of the one to the uses of the next. A draw clears images drawn and copied by earlier
//! steps of the group, so that its barrier begins at the uses of them all.

use crate::device::Gpu;
use crate::render::{Layer, Pipeline, Render, Target, bind, compute};
use crate::upload::{Frame, Scene};
use ash::vk;
use ash::vk::{AccessFlags2 as A, PipelineStageFlags2 as P};
use hemicube_contract::backend::{BackendError, StageTimes};
use hemicube_shaders::pass::FaceDraw;
use hemicube_shaders::recording::compute_stages;
use hemicube_shaders::view::FACES;
use hemicube_shaders::{Action, Cull, Goal, Phase, Recording};
use std::collections::HashMap;
use std::sync::Arc;

/// The most timestamps of a group: one before the first step, and one after each run of steps of a phase.
pub(crate) const MARKS: u32 = 8;

/// All pipelines of a scene.
#[derive(Debug)]
pub(crate) struct Stages {
    gpu: Arc<Gpu>,
    render: Render,
    /// By entry point.
    compute: HashMap<&'static str, Pipeline>,
}

/// A submission to record.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Work {
    /// Number of hemicubes.
    pub(crate) slots: u32,
    pub(crate) cull: Cull,
    /// What is to come of them.
    pub(crate) goal: Goal,
    /// True if some hemicube does not stand on its emitter.
    pub(crate) without_emitter: bool,
    /// The pool of timestamps, if time is measured.
    pub(crate) marks: Option<vk::QueryPool>,
}

/// A use of memory: pipeline stages and kinds of access.
#[derive(Clone, Copy)]
struct Use(P, A);

impl Use {
    const NONE: Self = Self(P::empty(), A::empty());

    fn and(self, other: Self) -> Self {
        Self(self.0 | other.0, self.1 | other.1)
    }
}

const SHADER_USES: A =
    A::from_raw(A::SHADER_STORAGE_READ.as_raw() | A::SHADER_STORAGE_WRITE.as_raw() | A::SHADER_SAMPLED_READ.as_raw());
const COMPUTES: Use = Use(P::COMPUTE_SHADER, SHADER_USES);
const DRAWS_DEPTHS: Use = Use(
    P::from_raw(P::EARLY_FRAGMENT_TESTS.as_raw() | P::LATE_FRAGMENT_TESTS.as_raw() | P::DRAW_INDIRECT.as_raw()),
    A::from_raw(
        A::DEPTH_STENCIL_ATTACHMENT_READ.as_raw()
            | A::DEPTH_STENCIL_ATTACHMENT_WRITE.as_raw()
            | A::INDIRECT_COMMAND_READ.as_raw(),
    ),
);
const DRAWS_ITEMS: Use = Use(
    P::from_raw(DRAWS_DEPTHS.0.as_raw() | P::COLOR_ATTACHMENT_OUTPUT.as_raw()),
    A::from_raw(DRAWS_DEPTHS.1.as_raw() | A::COLOR_ATTACHMENT_WRITE.as_raw()),
);
const DRAWS_COVER: Use = Use(
    P::from_raw(P::VERTEX_SHADER.as_raw() | P::FRAGMENT_SHADER.as_raw() | P::DRAW_INDIRECT.as_raw()),
    A::from_raw(SHADER_USES.as_raw() | A::INDIRECT_COMMAND_READ.as_raw()),
);
const COPIES: Use = Use(
    P::ALL_TRANSFER,
    A::from_raw(A::TRANSFER_READ.as_raw() | A::TRANSFER_WRITE.as_raw()),
);
const HOST_READS: Use = Use(P::HOST, A::HOST_READ);

fn use_of(action: &Action) -> Use {
    match action {
        Action::Dispatch { .. } => COMPUTES,
        Action::DrawDepths => DRAWS_DEPTHS,
        Action::CopyDepths => COPIES,
        Action::DrawItems => DRAWS_ITEMS,
        Action::DrawCover => DRAWS_COVER,
    }
}

/// The layers of a group, and the slot of the first.
#[derive(Clone, Copy)]
struct Group {
    number: u32,
    first_slot: u32,
    layers: u32,
}

impl Stages {
    pub(crate) fn new(gpu: &Arc<Gpu>, scene: &Scene) -> Result<Self, BackendError> {
        let (layout, plan) = (scene.layout, &scene.plan);
        let stages = compute_stages(plan.draw, plan.edges, &[plan.copies_depths]).into_iter();
        let pipelines = stages.map(|stage| Ok((stage.entry, compute(gpu, layout, stage)?)));
        Ok(Self {
            gpu: Arc::clone(gpu),
            render: Render::new(gpu, layout, plan.edges)?,
            compute: pipelines.collect::<Result<_, BackendError>>()?,
        })
    }

    fn barrier(&self, commands: vk::CommandBuffer, before: Use, then: Use) {
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

    /// Records a submission. Returns the phases of each group's timestamps.
    pub(crate) fn record(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        work: Work,
    ) -> Vec<Vec<Phase>> {
        let mut phases = Vec::new();
        let mut first_slot = 0;
        while first_slot < work.slots {
            let group = Group {
                number: u32::try_from(phases.len()).unwrap_or(u32::MAX),
                first_slot,
                layers: scene.plan.group.min(work.slots - first_slot),
            };
            // The group before and the submission before share everything but the frame's own buffers.
            let all = COMPUTES.and(DRAWS_ITEMS).and(DRAWS_COVER).and(COPIES);
            self.barrier(commands, all, all);
            phases.push(self.record_group(scene, frame, commands, work, group));
            first_slot += group.layers;
        }
        self.barrier(commands, COMPUTES, HOST_READS);
        phases
    }

    /// Records a pass: its first depths, then its draws.
    pub(crate) fn record_pass(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        depths: vk::Buffer,
        draws: &[FaceDraw],
    ) {
        // The submission before shares the images.
        let all = COMPUTES.and(DRAWS_ITEMS).and(DRAWS_COVER).and(COPIES);
        self.barrier(commands, all, COPIES);
        scene.preset_depths(commands, depths);
        self.barrier(commands, all, DRAWS_ITEMS);
        self.render.pass(scene, frame, commands, draws);
    }

    fn record_group(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        work: Work,
        group: Group,
    ) -> Vec<Phase> {
        let recording = Recording {
            plan: &scene.plan,
            upload: &scene.upload,
            cull: work.cull,
            goal: work.goal,
        };
        let mark = |number: usize| {
            if let Some(pool) = work.marks {
                let number = group.number * MARKS + u32::try_from(number).unwrap_or(u32::MAX);
                // SAFETY: the pool has room for the marks of all groups of a submission.
                unsafe {
                    self.gpu
                        .raw
                        .cmd_write_timestamp2(commands, P::ALL_COMMANDS, pool, number)
                };
            }
        };
        let mut phases: Vec<Phase> = Vec::new();
        let (mut last, mut all) = (Use::NONE, Use::NONE);
        for step in recording.steps(group.layers) {
            let next = use_of(&step.action);
            let before = match step.action {
                Action::DrawDepths | Action::DrawItems => all,
                _ => last,
            };
            if !before.0.is_empty() {
                self.barrier(commands, before, next);
            }
            (last, all) = (next, all.and(next));
            if phases.last() != Some(&step.phase) {
                mark(phases.len());
                phases.push(step.phase);
            }
            self.act(scene, frame, commands, &step.action, work, group);
        }
        mark(phases.len());
        phases
    }

    fn act(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        action: &Action,
        work: Work,
        group: Group,
    ) {
        let layers = (0..group.layers).map(|layer| Layer {
            slot: group.first_slot + layer,
            layer,
        });
        let draw = |target| {
            for at in layers.clone() {
                self.render.draw(scene, frame, commands, at, target);
            }
        };
        let without_emitter = work.without_emitter;
        match *action {
            Action::Dispatch {
                stage,
                groups: [x, y, z],
            } => {
                let (point, view) = (vk::PipelineBindPoint::COMPUTE, group.first_slot * FACES);
                // SAFETY: commands of this device that are being recorded; the group's first view is in the views.
                unsafe {
                    let device = &self.gpu.raw;
                    device.cmd_bind_pipeline(commands, point, self.compute[stage.entry].raw);
                    bind(&self.gpu, scene, frame, commands, point, view);
                    device.cmd_dispatch(commands, x, y, z);
                }
            }
            Action::DrawDepths => draw(Target::Depths { without_emitter }),
            Action::CopyDepths => scene.copy_depths(commands, group.layers),
            Action::DrawItems => draw(Target::Items {
                without_emitter,
                is_listed: work.cull != Cull::Off,
            }),
            Action::DrawCover => layers.for_each(|at| self.render.cover(scene, frame, commands, at)),
        }
    }
}

/// Adds the times between the marks of a submission. `nanoseconds` converts the ticks between two of them.
pub(crate) fn add_times(
    phases: &[Vec<Phase>],
    marks: &[u64],
    nanoseconds: impl Fn(u64, u64) -> u64,
    times: &mut StageTimes,
) {
    for (phases, marks) in phases.iter().zip(marks.chunks_exact(MARKS as usize)) {
        for (phase, ends) in phases.iter().zip(marks.windows(2)) {
            *phase.time(times) += nanoseconds(ends[0], ends[1]);
        }
    }
}
