//! Drawing of ids, depths and patches alone, and the passes of a submission with their timestamps.

use crate::conv;
use crate::device::{Compiler, Device, compilation};
use crate::reduce::{Groups, Stages};
use crate::upload::Store;
use hemicube_contract::backend::{Geometry, Hemicube, StageTimes};
use hemicube_contract::face::Face;
use hemicube_shaders::pass::FaceDraw;
use hemicube_shaders::recording::identify;
use hemicube_shaders::stage::{self, Stage, binding as b};
use hemicube_shaders::upload::VERTEX_BYTES;
use hemicube_shaders::view::{FACES, UPSIDE_DOWN_WORD, VIEW_BYTES, VIEW_WORDS, stands_on_emitter};
use hemicube_shaders::{Edges, Phase, Plan, Upload};
use std::num::NonZeroU64;
use wgpu::{
    BindGroup, BindGroupLayout, Buffer, CommandEncoder, ComputePass, LoadOp, Operations, QuerySet, RenderPass,
    RenderPipeline, StoreOp, TextureFormat, VertexFormat,
};

/// Bytes of an indirect draw of indexed corners, and of plain ones.
const DRAW_BYTES: u64 = 20;
const COVER_DRAW_BYTES: u64 = 16;
/// The most timestamps of a submission: two a pass.
pub(crate) const MOST_STAMPS: u32 = wgpu::QUERY_SET_MAX_QUERIES;

/// Timestamps of a submission.
pub(crate) struct Clock {
    pub(crate) stamps: QuerySet,
    pub(crate) resolved: Buffer,
    /// Nanoseconds a tick.
    period: f64,
    passes: Vec<Phase>,
}

impl Clock {
    pub(crate) fn new(device: &Device) -> Self {
        Self {
            stamps: device.raw.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stage times"),
                ty: wgpu::QueryType::Timestamp,
                count: MOST_STAMPS,
            }),
            resolved: device.raw.create_buffer(&wgpu::BufferDescriptor {
                label: Some("stage times"),
                size: u64::from(MOST_STAMPS) * 8,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            period: f64::from(device.queue.get_timestamp_period()),
            passes: Vec::new(),
        }
    }

    /// The places of the next pass's two timestamps; none when all are taken.
    fn next(&mut self, phase: Phase) -> Option<(&QuerySet, u32, u32)> {
        let first = 2 * u32::try_from(self.passes.len()).ok()?;
        if first + 2 > MOST_STAMPS {
            return None;
        }
        self.passes.push(phase);
        Some((&self.stamps, first, first + 1))
    }

    /// Bytes of the timestamps taken.
    pub(crate) fn bytes(&self) -> u64 {
        16 * self.passes.len() as u64
    }

    /// Adds the times between timestamps, and begins anew.
    pub(crate) fn add_to(&mut self, times: &mut StageTimes, stamps: &[u64]) {
        for (phase, pair) in self.passes.drain(..).zip(stamps.chunks_exact(2)) {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_precision_loss,
                clippy::cast_sign_loss,
                reason = "a time"
            )]
            let taken = (pair[1].saturating_sub(pair[0]) as f64 * self.period) as u64;
            *phase.time(times) += taken;
        }
    }
}

/// A submission being written.
pub(crate) struct Recorder<'a> {
    pub(crate) encoder: CommandEncoder,
    pub(crate) view_group: &'a BindGroup,
    /// The first slot of the group being recorded.
    pub(crate) first_slot: u32,
    pub(crate) clock: Option<&'a mut Clock>,
}

impl Recorder<'_> {
    /// Records a compute pass with the view of the group's first hemicube bound.
    pub(crate) fn compute(&mut self, phase: Phase, write: impl FnOnce(&mut ComputePass<'_>)) {
        let stamps = self.clock.as_mut().and_then(|clock| clock.next(phase));
        let mut pass = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes: stamps.map(|(query_set, first, last)| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(last),
            }),
        });
        pass.set_bind_group(0, self.view_group, &[view_offset(self.first_slot, 0)]);
        write(&mut pass);
    }

    /// Records a pass drawing a layer face by face. `write` is called once before, with `None`, and then with each
    /// face, its view and its rows of the image set.
    pub(crate) fn draw(
        &mut self,
        phase: Phase,
        resolution: u32,
        layer: u32,
        attachments: Attachments<'_>,
        mut write: impl FnMut(&mut RenderPass<'_>, Option<Face>),
    ) {
        let stamps = self.clock.as_mut().and_then(|clock| clock.next(phase));
        let color = attachments.items.map(|(view, clear)| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: escaped(clear),
        });
        let colors = [color];
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: if attachments.items.is_some() { &colors } else { &[] },
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: attachments.depths,
                depth_ops: attachments.is_depth_written.then_some(Operations {
                    load: LoadOp::Clear(0.0),
                    store: StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: stamps.map(|(query_set, first, last)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(last),
            }),
            ..Default::default()
        });
        write(&mut pass, None);
        for face in Face::ALL {
            let (first_row, rows) = (face.first_row(resolution), face.rows(resolution));
            #[allow(clippy::cast_precision_loss, reason = "at most 3072")]
            pass.set_viewport(0.0, first_row as f32, resolution as f32, rows as f32, 0.0, 1.0);
            pass.set_scissor_rect(0, first_row, resolution, rows);
            pass.set_bind_group(0, self.view_group, &[view_offset(self.first_slot + layer, face as u32)]);
            write(&mut pass, Some(face));
        }
    }
}

/// Clears ids to what stands for escaped.
fn escaped(id: u32) -> Operations<wgpu::Color> {
    Operations {
        load: LoadOp::Clear(wgpu::Color {
            r: f64::from(id),
            ..wgpu::Color::TRANSPARENT
        }),
        store: StoreOp::Store,
    }
}

/// The images of a drawing pass.
pub(crate) struct Attachments<'a> {
    pub(crate) depths: &'a wgpu::TextureView,
    /// Cleared and written, or only there.
    pub(crate) is_depth_written: bool,
    /// The ids, and their cleared value.
    pub(crate) items: Option<(&'a wgpu::TextureView, u32)>,
}

fn view_offset(slot: u32, face: u32) -> u32 {
    (slot * FACES + face) * VIEW_BYTES
}

/// Drawing pipelines. Depths and ids have two each: for hemicubes on their emitters, and for others.
pub(crate) struct Rendering {
    depths: [RenderPipeline; 2],
    ids: [RenderPipeline; 2],
    cover: RenderPipeline,
    /// The first depths of a pass, and its ids.
    preset: RenderPipeline,
    through: RenderPipeline,
    pub(crate) pass_layout: BindGroupLayout,
    /// Group 1 of the scene's draws.
    pub(crate) layout: BindGroupLayout,
    pub(crate) cover_layout: BindGroupLayout,
}

/// The stages drawing patches alone.
pub(crate) const COVER: [&Stage; 2] = [&stage::COVER, &stage::ADD_HIDDEN];

/// The stages drawing a pass.
pub(crate) const PASS: [&Stage; 4] = [
    &stage::EVERY_PIXEL,
    &stage::PRESET_DEPTHS,
    &stage::THROUGH,
    &stage::IDENTIFY_THROUGH,
];

/// The stages drawing the scene.
pub(crate) fn scene_stages(edges: Edges) -> [&'static Stage; 4] {
    let [ids, ids_of_others] = identify(edges);
    [&stage::RENDER, ids, ids_of_others, &stage::OCCLUDE_OTHERS]
}

impl Rendering {
    pub(crate) fn new(compiler: &mut Compiler<'_>, edges: Edges) -> Self {
        let layout = compiler.layout(&scene_stages(edges));
        let cover_layout = compiler.layout(&COVER);
        let pass_layout = compiler.layout(&PASS);
        let ids = || Some(TextureFormat::R32Uint.into());
        Self {
            preset: Self::preset(compiler, &pass_layout),
            through: Self::pipeline(
                compiler,
                &pass_layout,
                &stage::THROUGH,
                Some((&stage::IDENTIFY_THROUGH, &[ids()])),
            ),
            pass_layout,
            depths: [None, Some((&stage::OCCLUDE_OTHERS, &[][..]))]
                .map(|fragment| Self::pipeline(compiler, &layout, &stage::RENDER, fragment)),
            ids: identify(edges)
                .map(|fragment| Self::pipeline(compiler, &layout, &stage::RENDER, Some((fragment, &[ids()])))),
            cover: Self::cover(compiler, &cover_layout),
            layout,
            cover_layout,
        }
    }

    fn cover(compiler: &mut Compiler<'_>, group: &BindGroupLayout) -> RenderPipeline {
        let module = compiler.module(&stage::COVER);
        let layout = compiler.pipeline_layout(group);
        compiler.draw(&wgpu::RenderPipelineDescriptor {
            label: Some("cover"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(stage::COVER.entry),
                compilation_options: compilation(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            // wgpu requires an attachment: depths, neither tested nor written.
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
        })
    }

    fn preset(compiler: &mut Compiler<'_>, group: &BindGroupLayout) -> RenderPipeline {
        let module = compiler.module(&stage::PRESET_DEPTHS);
        let layout = compiler.pipeline_layout(group);
        compiler.draw(&wgpu::RenderPipelineDescriptor {
            label: Some(stage::PRESET_DEPTHS.entry),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(stage::EVERY_PIXEL.entry),
                compilation_options: compilation(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                depth_write_enabled: Some(true),
                ..depth_test(wgpu::CompareFunction::Always)
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(stage::PRESET_DEPTHS.entry),
                compilation_options: compilation(),
                targets: &[Some(wgpu::ColorTargetState {
                    format: TextureFormat::R32Uint,
                    blend: None,
                    write_mask: wgpu::ColorWrites::empty(),
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    fn pipeline(
        compiler: &mut Compiler<'_>,
        group: &BindGroupLayout,
        vertex: &Stage,
        fragment: Option<(&Stage, &[Option<wgpu::ColorTargetState>])>,
    ) -> RenderPipeline {
        let module = compiler.module(vertex);
        let layout = compiler.pipeline_layout(group);
        let attribute = |format, offset, shader_location| wgpu::VertexAttribute {
            format,
            offset,
            shader_location,
        };
        let attributes = [
            attribute(VertexFormat::Float32x3, 0, 0),
            attribute(VertexFormat::Float32x3, 12, 1),
            attribute(VertexFormat::Uint32x2, 24, 2),
            attribute(VertexFormat::Float32x3, 32, 3),
        ];
        compiler.draw(&wgpu::RenderPipelineDescriptor {
            label: Some(fragment.map_or("depths", |(stage, _)| stage.entry)),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(vertex.entry),
                compilation_options: compilation(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: u64::from(VERTEX_BYTES),
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &attributes,
                })],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(depth_test(wgpu::CompareFunction::Greater)),
            multisample: wgpu::MultisampleState::default(),
            fragment: fragment.map(|(stage, targets)| wgpu::FragmentState {
                module: &module,
                entry_point: Some(stage.entry),
                compilation_options: compilation(),
                targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Makes the state of depths; they are written if the test can fail.
fn depth_test(compare: wgpu::CompareFunction) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: TextureFormat::Depth32Float,
        depth_write_enabled: Some(compare != wgpu::CompareFunction::Always),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// Hemicubes side by side, each in its layer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group {
    /// Number of hemicubes.
    pub(crate) layers: u32,
    /// True if one does not stand on its emitter.
    pub(crate) others: bool,
}

impl Group {
    /// A group of these hemicubes.
    pub(crate) fn of(geometry: &Geometry, upload: &Upload, hemicubes: &[Hemicube]) -> Self {
        Self {
            layers: u32::try_from(hemicubes.len()).unwrap_or(u32::MAX),
            others: !hemicubes.iter().all(|h| stands_on_emitter(geometry, upload, h)),
        }
    }
}

/// Converts the views of a submission, for computing and for drawing.
pub(crate) fn view_bytes(views: &[[u32; VIEW_WORDS]]) -> (Vec<u8>, Vec<u8>) {
    let stored = conv::to_bytes(views.as_flattened().iter().copied());
    let drawn = conv::to_bytes(views.iter().flat_map(|&view| upside_down(view)));
    (stored, drawn)
}

/// The first of the words of `clip_y`.
const CLIP_Y: usize = 24;

/// wgpu's images begin at the top, ours at the bottom. Negating a float is exact.
fn upside_down(mut view: [u32; VIEW_WORDS]) -> [u32; VIEW_WORDS] {
    for word in &mut view[CLIP_Y..CLIP_Y + 3] {
        *word ^= 1 << 31;
    }
    view[UPSIDE_DOWN_WORD] = 1;
    view
}

/// A scene on a device.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) device: &'a Device,
    pub(crate) stages: &'a Stages,
    pub(crate) store: &'a Store,
    pub(crate) plan: &'a Plan,
    pub(crate) upload: &'a Upload,
}

impl Scene<'_> {
    /// Draws depths of a group.
    pub(crate) fn draw_depths(&self, recorder: &mut Recorder<'_>, groups: &Groups, group: Group) {
        let pipeline = &self.stages.rendering.depths[usize::from(group.others)];
        for layer in 0..group.layers {
            let attachments = Attachments {
                depths: &self.store.depths.layers[layer as usize],
                is_depth_written: true,
                items: None,
            };
            self.draw_layer(recorder, &groups.scene, pipeline, attachments, layer, true);
        }
    }

    /// Draws ids of a group: of the listed chunks, or of all.
    pub(crate) fn draw_items(&self, recorder: &mut Recorder<'_>, groups: &Groups, group: Group, is_listed: bool) {
        let pipeline = &self.stages.rendering.ids[usize::from(group.others)];
        for layer in 0..group.layers {
            let attachments = Attachments {
                depths: &self.store.depths.layers[layer as usize],
                is_depth_written: true,
                items: Some((&self.store.items.layers[layer as usize], self.upload.patch_count + 1)),
            };
            self.draw_layer(recorder, &groups.scene, pipeline, attachments, layer, is_listed);
        }
    }

    /// Draws a pass into the first layer, with the views of the first slot. `bound` has its first depths.
    pub(crate) fn draw_pass(
        &self,
        encoder: &mut CommandEncoder,
        view_group: &BindGroup,
        bound: &BindGroup,
        draws: &[FaceDraw],
    ) {
        let color = wgpu::RenderPassColorAttachment {
            view: &self.store.items.layers[0],
            depth_slice: None,
            resolve_target: None,
            ops: escaped(self.upload.patch_count + 1),
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("pass"),
            color_attachments: &[Some(color)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.store.depths.layers[0],
                depth_ops: Some(Operations {
                    load: LoadOp::Clear(0.0),
                    store: StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let n = self.plan.resolution;
        pass.set_bind_group(0, view_group, &[view_offset(0, 0)]);
        pass.set_bind_group(1, bound, &[]);
        pass.set_pipeline(&self.stages.rendering.preset);
        pass.draw(0..3, 0..1);
        pass.set_pipeline(&self.stages.rendering.through);
        pass.set_vertex_buffer(0, self.store.buffer(b::VERTICES).slice(..));
        pass.set_index_buffer(self.store.buffer(b::INDICES).slice(..), wgpu::IndexFormat::Uint32);
        for draw in draws {
            let (first_row, rows) = (draw.face.first_row(n), draw.face.rows(n));
            #[allow(clippy::cast_precision_loss, reason = "at most 3072")]
            pass.set_viewport(0.0, first_row as f32, n as f32, rows as f32, 0.0, 1.0);
            let ([x, y], [width, height]) = (draw.low, draw.size);
            pass.set_scissor_rect(x, y, width, height);
            pass.set_bind_group(0, view_group, &[view_offset(0, draw.face as u32)]);
            for run in &draw.runs {
                pass.draw_indexed(run.clone(), 0, 0..1);
            }
        }
    }

    /// Draws the entries of a group's rows, each alone.
    pub(crate) fn draw_cover(&self, recorder: &mut Recorder<'_>, groups: &Groups, layers: u32) {
        for layer in 0..layers {
            let attachments = Attachments {
                depths: &self.store.depths.layers[layer as usize],
                is_depth_written: false,
                items: None,
            };
            recorder.draw(Phase::Cover, self.plan.resolution, layer, attachments, |pass, face| {
                if face.is_some() {
                    let draws = self.store.buffer(b::COVER_DRAWS);
                    pass.draw_indirect(draws, u64::from(layer) * COVER_DRAW_BYTES);
                } else {
                    pass.set_pipeline(&self.stages.rendering.cover);
                    pass.set_bind_group(1, &groups.cover, &[]);
                }
            });
        }
    }

    fn draw_layer(
        &self,
        recorder: &mut Recorder<'_>,
        bound: &BindGroup,
        pipeline: &RenderPipeline,
        attachments: Attachments<'_>,
        layer: u32,
        is_listed: bool,
    ) {
        let chunks = u32::try_from(self.upload.chunks.len()).unwrap_or(u32::MAX);
        let indices = u32::try_from(self.upload.indices.len()).unwrap_or(u32::MAX);
        let draws = self.store.buffer(b::DRAWS);
        recorder.draw(Phase::Render, self.plan.resolution, layer, attachments, |pass, face| {
            let Some(face) = face else {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(1, bound, &[]);
                pass.set_vertex_buffer(0, self.store.buffer(b::VERTICES).slice(..));
                let range = self.store.buffer(b::INDICES).slice(..);
                pass.set_index_buffer(range, wgpu::IndexFormat::Uint32);
                return;
            };
            let place = u64::from(layer * FACES + face as u32);
            let first = place * u64::from(chunks) * DRAW_BYTES;
            if chunks == 0 {
                // An empty scene.
            } else if !is_listed {
                pass.draw_indexed(0..indices, 0, 0..1);
            } else if self.device.counts_draws {
                let counts = self.store.buffer(b::DRAW_COUNTS);
                pass.multi_draw_indexed_indirect_count(draws, first, counts, place * 4, chunks);
            } else {
                pass.multi_draw_indexed_indirect(draws, first, chunks);
            }
        });
    }
}

/// The view binding's size.
pub(crate) fn view_size() -> Option<NonZeroU64> {
    NonZeroU64::new(u64::from(VIEW_BYTES))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_row_of_y_is_turned_over() {
        let mut view = [0; VIEW_WORDS];
        for (word, x) in view.iter_mut().zip([1.5f32; VIEW_WORDS]) {
            *word = x.to_bits();
        }
        let turned = upside_down(view);
        let changed: Vec<usize> = (0..VIEW_WORDS).filter(|&i| turned[i] != view[i]).collect();
        assert_eq!(changed, [24, 25, 26, UPSIDE_DOWN_WORD]);
        assert_eq!(f32::from_bits(turned[25]), -1.5);
    }
}
