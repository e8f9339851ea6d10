//! Makes rows of items and brings them back: first how many entries there are, then those.

use crate::conv::{self, Uses, uses};
use crate::cull::SceneGroups;
use crate::device::{Compiler, Device, compilation};
use crate::render::{
    Attachments, COVER_DRAW_BYTES, Clock, Group, MOST_STAMPS, Recorder, Scene, Stretch, depth_test, view_size,
};
use crate::upload::TWICE;
use hemicube_contract::backend::{BackendError, Counters, StageTimes};
use hemicube_contract::row::RowBlock;
use hemicube_shaders::limits::SETTLE_GROUPS;
use hemicube_shaders::output::{HEADER_WORDS, append_rows, entry_words};
use hemicube_shaders::stage::{self, binding as b};
use hemicube_shaders::{Edges, Plan};
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;
use wgpu::{
    BindGroup, BindGroupLayout, BindingResource, Buffer, BufferUsages, ComputePipeline, MapMode, RenderPipeline,
    SubmissionIndex,
};

/// Workgroups that put one row where it is read.
const PACK_GROUPS: u32 = 4;

/// The stages after the ids are drawn.
pub(crate) struct Reduction {
    reduce: (BindGroupLayout, ComputePipeline),
    settling: Option<Settling>,
    tiny: (BindGroupLayout, ComputePipeline),
    compact: (BindGroupLayout, ComputePipeline),
    pack: (BindGroupLayout, ComputePipeline),
    cover: (BindGroupLayout, RenderPipeline),
}

/// What gives pixels near edges to the triangle that their centre lies in.
struct Settling {
    near_edges: (BindGroupLayout, ComputePipeline),
    settle: (BindGroupLayout, ComputePipeline),
    put_settled: (BindGroupLayout, ComputePipeline),
    take_back: (BindGroupLayout, ComputePipeline),
}

/// What the reduction binds.
fn uses_of(edges: Edges) -> &'static Uses {
    match edges {
        Edges::Driver => &uses::REDUCE,
        Edges::Exact => &uses::REDUCE_SIDES,
    }
}

impl Reduction {
    pub(crate) fn new(compiler: &mut Compiler<'_>, edges: Edges) -> Self {
        let mut compute = |uses: &Uses, stage| {
            let layout = compiler.layout(uses, false);
            let pipeline = compiler.compute(stage, &layout);
            (layout, pipeline)
        };
        let reduce = match edges {
            Edges::Driver => &stage::REDUCE,
            Edges::Exact => &stage::REDUCE_SIDES,
        };
        Self {
            reduce: compute(uses_of(edges), reduce),
            settling: (edges == Edges::Exact).then(|| Settling {
                near_edges: compute(&uses::NEAR_EDGES, &stage::NEAR_EDGES),
                settle: compute(&uses::SETTLE, &stage::SETTLE),
                put_settled: compute(&uses::PUT_SETTLED, &stage::PUT_SETTLED),
                take_back: compute(&uses::TAKE_BACK, &stage::TAKE_BACK),
            }),
            tiny: compute(&uses::TINY, &stage::TINY),
            compact: compute(&uses::COMPACT, &stage::COMPACT),
            pack: compute(&uses::PACK, &stage::PACK),
            cover: Self::cover(compiler),
        }
    }

    fn cover(compiler: &mut Compiler<'_>) -> (BindGroupLayout, RenderPipeline) {
        let group = compiler.layout(&uses::COVER, true);
        let module = compiler.module(&stage::COVER);
        let layout = compiler.pipeline_layout(Some(&group));
        let pipeline = compiler.draw(&wgpu::RenderPipelineDescriptor {
            label: Some("cover"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(stage::COVER.entry),
                compilation_options: compilation(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            // wgpu wants something to draw to: the depths, which are neither tested nor written.
            depth_stencil: Some(depth_test(wgpu::CompareFunction::Always)),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(stage::ADD_HIDDEN.entry),
                compilation_options: compilation(),
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        });
        (group, pipeline)
    }

    /// Makes the rows of a group.
    pub(crate) fn reduce(
        &self,
        scene: &Scene<'_>,
        recorder: &mut Recorder<'_>,
        groups: &Groups,
        group: Group,
        covered: bool,
    ) {
        let (plan, layers) = (scene.plan, group.layers);
        recorder.compute(Stretch::Reduce, |pass| {
            pass.set_pipeline(&self.reduce.1);
            pass.set_bind_group(1, &groups.reduce, &[]);
            pass.dispatch_workgroups(plan.reduce_groups(), layers, 1);
            if let (Some(settling), Some(groups)) = (&self.settling, &groups.settling) {
                for (stage, group) in [
                    (&settling.near_edges, &groups.near_edges),
                    (&settling.settle, &groups.settle),
                    (&settling.put_settled, &groups.put_settled),
                ] {
                    pass.set_pipeline(&stage.1);
                    pass.set_bind_group(1, group, &[]);
                    pass.dispatch_workgroups(SETTLE_GROUPS, layers, 1);
                }
            }
            if covered {
                let (x, z) = plan.tiny_groups(scene.upload);
                pass.set_pipeline(&self.tiny.1);
                pass.set_bind_group(1, &groups.tiny, &[]);
                pass.dispatch_workgroups(x, layers, z);
            }
            pass.set_pipeline(&self.compact.1);
            pass.set_bind_group(1, &groups.compact, &[]);
            pass.dispatch_workgroups(layers, 1, 1);
        });
        for layer in (0..layers).filter(|_| covered) {
            let attachments = Attachments {
                depths: &scene.store.depths.layers[layer as usize],
                is_depth_written: false,
                items: None,
            };
            recorder.draw(Stretch::Cover, plan.resolution, layer, attachments, |pass, face| {
                if face.is_some() {
                    let draws = scene.store.buffer(b::COVER_DRAWS);
                    pass.draw_indirect(draws, u64::from(layer) * COVER_DRAW_BYTES);
                } else {
                    pass.set_pipeline(&self.cover.1);
                    pass.set_bind_group(1, &groups.cover, &[]);
                }
            });
        }
        if let (Some(settling), Some(groups), true) = (&self.settling, &groups.settling, covered) {
            recorder.compute(Stretch::Cover, |pass| {
                pass.set_pipeline(&settling.take_back.1);
                pass.set_bind_group(1, &groups.take_back, &[]);
                pass.dispatch_workgroups(SETTLE_GROUPS, layers, 1);
            });
        }
        recorder.compute(Stretch::ReadBack, |pass| {
            pass.set_pipeline(&self.pack.1);
            pass.set_bind_group(1, &groups.pack, &[]);
            pass.dispatch_workgroups(PACK_GROUPS, layers, 1);
        });
    }
}

/// What the stages of [`Settling`] are bound to.
struct SettlingGroups {
    near_edges: BindGroup,
    settle: BindGroup,
    put_settled: BindGroup,
    take_back: BindGroup,
}

/// What the stages are bound to.
pub(crate) struct Groups {
    pub(crate) scene: SceneGroups,
    reduce: BindGroup,
    settling: Option<SettlingGroups>,
    tiny: BindGroup,
    compact: BindGroup,
    pack: BindGroup,
    cover: BindGroup,
}

/// One of the two that take turns: while one's rows are brought back, the other's are made.
pub(crate) struct Side {
    /// The views that are drawn, and those that are computed with.
    pub(crate) drawn_views: Buffer,
    pub(crate) stored_views: Buffer,
    pub(crate) view_group: BindGroup,
    pub(crate) groups: Groups,
    output: Buffer,
    /// Where the host reads headers, and timestamps after them.
    headers: Buffer,
    /// Where it reads entries; longer when there are more.
    entries: Option<Buffer>,
    pub(crate) clock: Option<Clock>,
}

/// A buffer on its way to the host.
struct Mapping {
    submission: SubmissionIndex,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

/// A submission whose headers are on their way.
pub(crate) struct Counted {
    slots: u32,
    stamp_bytes: u64,
    mapping: Mapping,
}

/// A submission whose entries are on their way.
pub(crate) struct Arriving {
    headers: Vec<u32>,
    slots: u32,
    words: usize,
    mapping: Option<Mapping>,
}

impl Side {
    pub(crate) fn new(
        scene: &Scene<'_>,
        reduction: &Reduction,
        view_layout: &BindGroupLayout,
        timing: bool,
    ) -> Result<Self, BackendError> {
        let Scene {
            device,
            culling,
            rendering,
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
        let bind = |uses: &Uses, layout: &BindGroupLayout| {
            let entries: Vec<_> = uses
                .bindings()
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
        let groups = Groups {
            scene: SceneGroups {
                cull: bind(&uses::CULL, &culling.layout),
                pyramid: bind(&uses::PYRAMID, &culling.pyramid_layout),
                render: bind(&uses::RENDER, &rendering.layout),
            },
            reduce: bind(uses_of(plan.edges), &reduction.reduce.0),
            settling: reduction.settling.as_ref().map(|settling| SettlingGroups {
                near_edges: bind(&uses::NEAR_EDGES, &settling.near_edges.0),
                settle: bind(&uses::SETTLE, &settling.settle.0),
                put_settled: bind(&uses::PUT_SETTLED, &settling.put_settled.0),
                take_back: bind(&uses::TAKE_BACK, &settling.take_back.0),
            }),
            tiny: bind(&uses::TINY, &reduction.tiny.0),
            compact: bind(&uses::COMPACT, &reduction.compact.0),
            pack: bind(&uses::PACK, &reduction.pack.0),
            cover: bind(&uses::COVER, &reduction.cover.0),
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

    /// Waits for a submission's headers, and asks for as many entries as they say there are.
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
            // Half as much again, so that a little longer rows do not ask for another.
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
    /// Asks for the first bytes of a buffer that a submission writes.
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
