//! Records the steps of a submission, and reads its rows back: first the numbers of entries, then the entries.
//!
//! [`Stages::record`] is the interpreter of [`hemicube_shaders::recording`] on wgpu. Dispatches of a phase share a
//! pass; wgpu puts the barriers.

use crate::conv;
use crate::cull;
use crate::device::{Compiler, Device};
use crate::render::{COVER, Clock, Group, MOST_STAMPS, PASS, Recorder, Rendering, Scene, scene_stages, view_size};
use crate::upload::TWICE;
use hemicube_contract::backend::{BackendError, Counters, StageTimes};
use hemicube_contract::face::pixel_count;
use hemicube_contract::row::RowBlock;
use hemicube_shaders::output::{HEADER_WORDS, append_rows, entry_words};
use hemicube_shaders::recording::compute_stages;
use hemicube_shaders::stage::{Stage, binding as b};
use hemicube_shaders::{Action, Cull, Draw, Edges, Plan, Recording, Step};
use std::collections::HashMap;
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;
use wgpu::{
    BindGroup, BindGroupLayout, BindingResource, Buffer, BufferUsages, ComputePass, ComputePipeline, MapMode,
    SubmissionIndex,
};

/// All pipelines.
pub(crate) struct Stages {
    pub(crate) rendering: Rendering,
    /// By entry point.
    compute: HashMap<&'static str, (&'static Stage, BindGroupLayout, ComputePipeline)>,
}

impl Stages {
    pub(crate) fn new(compiler: &mut Compiler<'_>, draw: Draw, edges: Edges) -> Self {
        // Some resolutions copy depths, others do not.
        let stages = compute_stages(draw, edges, &[false, true]).into_iter();
        let compute = stages.map(|stage| {
            let (layout, pipeline) = compiler.compute(stage);
            (stage.entry, (stage, layout, pipeline))
        });
        Self {
            compute: compute.collect(),
            rendering: Rendering::new(compiler, edges),
        }
    }

    /// Records the steps of a group.
    pub(crate) fn record(
        &self,
        scene: &Scene<'_>,
        recorder: &mut Recorder<'_>,
        groups: &Groups,
        recording: &Recording<'_>,
        group: Group,
    ) {
        let counts_draws = scene.device.counts_draws;
        let clears = |stage: &Stage| !counts_draws && stage.writes.contains(&b::DRAWS);
        // Dispatches of a phase are one pass.
        let share_a_pass = |before: &Step, after: &Step| match (before.action, after.action) {
            (Action::Dispatch { .. }, Action::Dispatch { stage, .. }) => before.phase == after.phase && !clears(stage),
            _ => false,
        };
        let steps = recording.steps(group.layers);
        for run in steps.chunk_by(share_a_pass) {
            match run[0].action {
                Action::Dispatch { stage, .. } => {
                    if clears(stage) {
                        cull::clear_lists(recorder, scene.store);
                    }
                    recorder.compute(run[0].phase, |pass| self.dispatch(pass, groups, run));
                }
                Action::DrawDepths => scene.draw_depths(recorder, groups, group),
                Action::CopyDepths => {
                    cull::copy_depths(recorder, scene.store, scene.plan.resolution, group.layers);
                }
                Action::DrawItems => scene.draw_items(recorder, groups, group, recording.cull != Cull::Off),
                Action::DrawCover => scene.draw_cover(recorder, groups, group.layers),
            }
        }
    }

    fn dispatch(&self, pass: &mut ComputePass<'_>, groups: &Groups, steps: &[Step]) {
        for step in steps {
            if let Action::Dispatch {
                stage,
                groups: [x, y, z],
            } = step.action
            {
                pass.set_pipeline(&self.compute[stage.entry].2);
                pass.set_bind_group(1, &groups.compute[stage.entry], &[]);
                pass.dispatch_workgroups(x, y, z);
            }
        }
    }
}

/// Group 1 of each pipeline, bound.
pub(crate) struct Groups {
    /// By entry point.
    compute: HashMap<&'static str, BindGroup>,
    pub(crate) scene: BindGroup,
    pub(crate) cover: BindGroup,
}

/// The first depths of passes, written before each.
pub(crate) struct FirstDepths {
    pub(crate) depths: Buffer,
    /// Group 1 of a pass: the settings, and these.
    pub(crate) bound: BindGroup,
}

impl FirstDepths {
    pub(crate) fn new(scene: &Scene<'_>) -> Self {
        let device = &scene.device.raw;
        let depths = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("the first depths of a pass"),
            size: 4 * pixel_count(scene.plan.resolution) as u64,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let entries = conv::bindings(&PASS).into_iter().map(|binding| wgpu::BindGroupEntry {
            binding,
            resource: match binding {
                b::DEPTH_COPY => depths.as_entire_binding(),
                _ => scene.store.buffer(binding).as_entire_binding(),
            },
        });
        let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pass"),
            layout: &scene.stages.rendering.pass_layout,
            entries: &entries.collect::<Vec<_>>(),
        });
        Self { depths, bound }
    }
}

/// One of two sets of buffers: the rows of one are read back while those of the other are made.
pub(crate) struct Side {
    /// The views for drawing, and those for computing.
    pub(crate) drawn_views: Buffer,
    pub(crate) stored_views: Buffer,
    pub(crate) view_group: BindGroup,
    pub(crate) groups: Groups,
    output: Buffer,
    /// Headers for the host, and timestamps after them.
    headers: Buffer,
    /// Entries for the host; grows.
    entries: Option<Buffer>,
    pub(crate) clock: Option<Clock>,
}

/// A buffer on its way to the host.
struct Mapping {
    submission: SubmissionIndex,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

/// A submission with its headers on their way.
pub(crate) struct Counted {
    slots: u32,
    stamp_bytes: u64,
    mapping: Mapping,
}

/// A submission with its entries on their way.
pub(crate) struct Arriving {
    headers: Vec<u32>,
    slots: u32,
    words: usize,
    mapping: Option<Mapping>,
}

impl Side {
    pub(crate) fn new(scene: &Scene<'_>, view_layout: &BindGroupLayout, timing: bool) -> Result<Self, BackendError> {
        let Scene {
            device,
            stages,
            store,
            plan,
            upload,
        } = *scene;
        let make = |label, size: u64, usage| {
            device.raw.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size.next_multiple_of(16),
                usage,
                mapped_at_creation: false,
            })
        };
        let sizes = plan.sizes(upload);
        let [stored_views, output] = TWICE.map(|binding| {
            let size = sizes.iter().find(|size| size.binding == binding);
            let bytes = size.map_or(0, |size| size.bytes);
            make("one of two", bytes, conv::usage(binding))
        });
        let drawn_views = make(
            "drawn views",
            stored_views.size(),
            BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        );
        let view_group = device.raw.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view"),
            layout: view_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: b::VIEW,
                resource: BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &drawn_views,
                    offset: 0,
                    size: view_size(),
                }),
            }],
        });
        let bind = |stages: &[&Stage], layout: &BindGroupLayout| {
            let entries: Vec<_> = conv::bindings(stages)
                .into_iter()
                .map(|binding| wgpu::BindGroupEntry {
                    binding,
                    resource: match binding {
                        b::DEPTHS => BindingResource::TextureView(&store.depths.all),
                        b::ITEMS | b::SETTLED_ITEMS => BindingResource::TextureView(&store.items.all),
                        b::VIEWS => stored_views.as_entire_binding(),
                        b::OUTPUT => output.as_entire_binding(),
                        _ => store.buffer(binding).as_entire_binding(),
                    },
                })
                .collect();
            device.raw.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout,
                entries: &entries,
            })
        };
        let compute = stages.compute.values();
        let groups = Groups {
            compute: compute
                .map(|(stage, layout, _)| (stage.entry, bind(&[stage], layout)))
                .collect(),
            scene: bind(&scene_stages(plan.edges), &stages.rendering.layout),
            cover: bind(&COVER, &stages.rendering.cover_layout),
        };
        let stamps = if timing { u64::from(MOST_STAMPS) * 8 } else { 0 };
        let to_read = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let side = Self {
            headers: make("headers", header_bytes(plan.batch) + stamps, to_read),
            entries: None,
            clock: timing.then(|| Clock::new(device)),
            drawn_views,
            stored_views,
            view_group,
            groups,
            output,
        };
        device.check()?;
        Ok(side)
    }

    /// Ends a submission and sends it, and its headers after it.
    pub(crate) fn send(&mut self, device: &Device, mut encoder: wgpu::CommandEncoder, slots: u32) -> Counted {
        let bytes = header_bytes(slots);
        encoder.copy_buffer_to_buffer(&self.output, 0, &self.headers, 0, bytes);
        let mut stamp_bytes = 0;
        if let Some(clock) = &self.clock {
            stamp_bytes = clock.bytes();
            let count = u32::try_from(stamp_bytes / 8).unwrap_or(MOST_STAMPS);
            encoder.resolve_query_set(&clock.stamps, 0..count, &clock.resolved, 0);
            encoder.copy_buffer_to_buffer(&clock.resolved, 0, &self.headers, bytes, stamp_bytes);
        }
        let submission = device.queue.submit([encoder.finish()]);
        Counted {
            slots,
            stamp_bytes,
            mapping: Mapping::begin(&self.headers, bytes + stamp_bytes, submission),
        }
    }

    /// Waits for a submission's headers, and asks for the entries counted there.
    pub(crate) fn ask_for_entries(
        &mut self,
        device: &Device,
        plan: &Plan,
        counted: Counted,
        times: &mut StageTimes,
    ) -> Result<Arriving, BackendError> {
        let Counted {
            slots,
            stamp_bytes,
            mapping,
        } = counted;
        let bytes = header_bytes(slots);
        let mut headers = mapping.end(device, &self.headers, bytes + stamp_bytes)?;
        let stamps: Vec<u64> = headers
            .split_off(words(bytes))
            .chunks_exact(2)
            .map(|half| u64::from(half[0]) | u64::from(half[1]) << 32)
            .collect();
        if let Some(clock) = &mut self.clock {
            clock.add_to(times, &stamps);
        }
        let words = entry_words(plan, &headers, slots)?;
        let bytes = 4 * words as u64;
        let mapping = if words == 0 {
            None
        } else {
            let entries = self.room_for(device, bytes)?;
            let mut encoder = device
                .raw
                .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let first = 4 * u64::from(plan.output_entries());
            encoder.copy_buffer_to_buffer(&self.output, first, &entries, 0, bytes);
            let submission = device.queue.submit([encoder.finish()]);
            Some(Mapping::begin(&entries, bytes, submission))
        };
        Ok(Arriving {
            headers,
            slots,
            words,
            mapping,
        })
    }

    /// A buffer for entries of so many bytes.
    fn room_for(&mut self, device: &Device, bytes: u64) -> Result<Buffer, BackendError> {
        if let Some(entries) = self.entries.as_ref().filter(|entries| entries.size() >= bytes) {
            return Ok(entries.clone());
        }
        let entries = device.raw.create_buffer(&wgpu::BufferDescriptor {
            label: Some("entries"),
            // Half as much again, so that slightly longer rows still fit.
            size: (bytes + bytes / 2).next_multiple_of(4096),
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        device.check()?;
        self.entries = Some(entries.clone());
        Ok(entries)
    }

    /// Waits for the entries and appends the rows.
    pub(crate) fn finish(
        &self,
        device: &Device,
        arriving: Arriving,
        covered: bool,
        times: &mut StageTimes,
        out: &mut RowBlock,
    ) -> Result<Counters, BackendError> {
        let entries = match (arriving.mapping, &self.entries) {
            (Some(mapping), Some(entries)) => mapping.end(device, entries, 4 * arriving.words as u64)?,
            _ => Vec::new(),
        };
        let start = Instant::now();
        let counters = append_rows(&arriving.headers, &entries, arriving.slots, covered, out);
        if self.clock.is_some() {
            times.read_back += u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        }
        Ok(counters)
    }
}

impl Mapping {
    /// Asks for the first bytes of a buffer written by a submission.
    fn begin(buffer: &Buffer, bytes: u64, submission: SubmissionIndex) -> Self {
        let (sender, mapped) = channel();
        buffer.map_async(MapMode::Read, 0..bytes, move |result| {
            // Nobody waits any more when a call was given up.
            let _ = sender.send(result);
        });
        Self { submission, mapped }
    }

    /// Waits for them, and hands them over.
    fn end(self, device: &Device, buffer: &Buffer, bytes: u64) -> Result<Vec<u32>, BackendError> {
        device.wait(self.submission)?;
        let failed = |reason: &dyn std::fmt::Display| BackendError::Internal(format!("reading back rows: {reason}"));
        self.mapped
            .try_recv()
            .map_err(|error| failed(&error))?
            .map_err(|error| failed(&error))?;
        let view = buffer.get_mapped_range(0..bytes).map_err(|error| failed(&error))?;
        let words = conv::to_words(&view);
        drop(view);
        buffer.unmap();
        Ok(words)
    }
}

/// The words of the first bytes of a buffer, after a submission.
pub(crate) fn read(
    device: &Device,
    buffer: &Buffer,
    bytes: u64,
    submission: SubmissionIndex,
) -> Result<Vec<u32>, BackendError> {
    Mapping::begin(buffer, bytes, submission).end(device, buffer, bytes)
}

fn header_bytes(slots: u32) -> u64 {
    4 * u64::from(slots) * u64::from(HEADER_WORDS)
}

fn words(bytes: u64) -> usize {
    usize::try_from(bytes / 4).unwrap_or(usize::MAX)
}
