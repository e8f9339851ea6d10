//! Drawing: depths of occluders, ids, and patches alone.

use crate::conv;
use crate::device::Gpu;
use crate::upload::{Frame, Scene};
use ash::vk;
use hemicube_contract::backend::BackendError;
use hemicube_contract::face::Face;
use hemicube_shaders::Edges;
use hemicube_shaders::pass::FaceDraw;
use hemicube_shaders::recording::identify;
use hemicube_shaders::stage::{self, Stage, binding};
use hemicube_shaders::upload::VERTEX_BYTES;
use hemicube_shaders::view::{FACES, VIEW_BYTES};
use std::sync::Arc;

/// A pipeline of this device.
#[derive(Debug)]
pub(crate) struct Pipeline {
    gpu: Arc<Gpu>,
    pub(crate) raw: vk::Pipeline,
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: the session waits for the device before it drops its pipelines.
        unsafe { self.gpu.raw.destroy_pipeline(self.raw, None) };
    }
}

/// A shader module, needed while pipelines are made.
struct Module<'a> {
    gpu: &'a Gpu,
    raw: vk::ShaderModule,
    name: std::ffi::CString,
}

impl<'a> Module<'a> {
    fn new(gpu: &'a Gpu, stage: &Stage) -> Result<Self, BackendError> {
        let words = stage.words();
        let create = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: valid SPIR-V: naga made it, and the shaders' test compares.
        let raw = unsafe { gpu.raw.create_shader_module(&create, None) }.map_err(|r| conv::error(stage.entry, r))?;
        let name = std::ffi::CString::new(stage.entry).map_err(|e| BackendError::Internal(e.to_string()))?;
        Ok(Self { gpu, raw, name })
    }

    fn info(&self, kind: vk::ShaderStageFlags) -> vk::PipelineShaderStageCreateInfo<'_> {
        vk::PipelineShaderStageCreateInfo::default()
            .stage(kind)
            .module(self.raw)
            .name(&self.name)
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: pipelines do not need their modules once they are made.
        unsafe { self.gpu.raw.destroy_shader_module(self.raw, None) };
    }
}

/// A compute pipeline.
pub(crate) fn compute(gpu: &Arc<Gpu>, layout: vk::PipelineLayout, stage: &Stage) -> Result<Pipeline, BackendError> {
    let module = Module::new(gpu, stage)?;
    let create = [vk::ComputePipelineCreateInfo::default()
        .stage(module.info(vk::ShaderStageFlags::COMPUTE))
        .layout(layout)];
    // SAFETY: the module and the layout live until the call returns.
    let made = unsafe {
        gpu.raw
            .create_compute_pipelines(vk::PipelineCache::null(), &create, None)
    };
    let made = made.map_err(|(_, r)| conv::error(stage.entry, r))?;
    Ok(Pipeline {
        gpu: Arc::clone(gpu),
        raw: made[0],
    })
}

/// The images written by a graphics pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Images {
    IdsAndDepths,
    Depths,
    None,
}

fn graphics(
    gpu: &Arc<Gpu>,
    layout: vk::PipelineLayout,
    vertex: &Stage,
    fragment: Option<&Stage>,
    images: Images,
) -> Result<Pipeline, BackendError> {
    let modules = [
        Some((Module::new(gpu, vertex)?, vk::ShaderStageFlags::VERTEX)),
        match fragment {
            Some(stage) => Some((Module::new(gpu, stage)?, vk::ShaderStageFlags::FRAGMENT)),
            None => None,
        },
    ];
    let stages: Vec<_> = modules.iter().flatten().map(|(m, kind)| m.info(*kind)).collect();
    let bindings = [vk::VertexInputBindingDescription {
        binding: 0,
        stride: VERTEX_BYTES,
        input_rate: vk::VertexInputRate::VERTEX,
    }];
    let attributes = [
        (0, vk::Format::R32G32B32_SFLOAT, 0),
        (1, vk::Format::R32G32B32_SFLOAT, 12),
        (2, vk::Format::R32G32_UINT, 24),
        (3, vk::Format::R32G32B32_SFLOAT, 32),
    ]
    .map(|(location, format, offset)| vk::VertexInputAttributeDescription {
        location,
        binding: 0,
        format,
        offset,
    });
    let mut input = vk::PipelineVertexInputStateCreateInfo::default();
    // The cover stage pulls its corners itself.
    if images != Images::None {
        input = input
            .vertex_binding_descriptions(&bindings)
            .vertex_attribute_descriptions(&attributes);
    }
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default()
        .viewport_count(1)
        .scissor_count(1);
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default()
        .polygon_mode(vk::PolygonMode::FILL)
        .cull_mode(vk::CullModeFlags::NONE)
        // v goes up in memory, down in Vulkan's words: fronts are counter-clockwise then.
        .front_face(vk::FrontFace::COUNTER_CLOCKWISE)
        .line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let tested = images != Images::None;
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(tested)
        .depth_write_enable(tested)
        .depth_compare_op(vk::CompareOp::GREATER);
    let colors: &[vk::Format] = if images == Images::IdsAndDepths {
        &[vk::Format::R32_UINT]
    } else {
        &[]
    };
    let blends = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::R)];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends[..colors.len()]);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let mut rendering = vk::PipelineRenderingCreateInfo::default().color_attachment_formats(colors);
    if tested {
        rendering = rendering.depth_attachment_format(vk::Format::D32_SFLOAT);
    }
    let create = [vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&rasterization)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layout)
        .push_next(&mut rendering)];
    // SAFETY: all that `create` points to lives until the call returns.
    let made = unsafe {
        gpu.raw
            .create_graphics_pipelines(vk::PipelineCache::null(), &create, None)
    };
    let made = made.map_err(|(_, r)| conv::error(vertex.entry, r))?;
    Ok(Pipeline {
        gpu: Arc::clone(gpu),
        raw: made[0],
    })
}

/// The graphics pipelines.
#[derive(Debug)]
pub(crate) struct Render {
    gpu: Arc<Gpu>,
    /// Ids: of all surfaces, and of all but the emitter's.
    ids: [Pipeline; 2],
    /// Depths alone, likewise.
    depths: [Pipeline; 2],
    /// Ids of what is seen through a portal.
    through: Pipeline,
    cover: Pipeline,
}

/// A drawing of the scene. `without_emitter`: the emitter is left out by its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// Depths of the listed chunks.
    Depths { without_emitter: bool },
    /// Ids, of the listed chunks or of all.
    Items { without_emitter: bool, is_listed: bool },
}

/// A hemicube's place in the submission, and in the images.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer {
    pub(crate) slot: u32,
    pub(crate) layer: u32,
}

impl Render {
    pub(crate) fn new(gpu: &Arc<Gpu>, layout: vk::PipelineLayout, edges: Edges) -> Result<Self, BackendError> {
        let ids = identify(edges);
        let make = |vertex, fragment, images| graphics(gpu, layout, vertex, fragment, images);
        Ok(Self {
            gpu: Arc::clone(gpu),
            ids: [
                make(&stage::RENDER, Some(ids[0]), Images::IdsAndDepths)?,
                make(&stage::RENDER, Some(ids[1]), Images::IdsAndDepths)?,
            ],
            depths: [
                make(&stage::RENDER, None, Images::Depths)?,
                make(&stage::RENDER, Some(&stage::OCCLUDE_OTHERS), Images::Depths)?,
            ],
            through: make(&stage::THROUGH, Some(&stage::IDENTIFY_THROUGH), Images::IdsAndDepths)?,
            cover: make(&stage::COVER, Some(&stage::ADD_HIDDEN), Images::None)?,
        })
    }

    /// Draws a slot into its layer.
    pub(crate) fn draw(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        Layer { slot, layer }: Layer,
        target: Target,
    ) {
        let (pipelines, without_emitter, has_ids, is_listed) = match target {
            Target::Depths { without_emitter } => (&self.depths, without_emitter, false, true),
            Target::Items {
                without_emitter,
                is_listed,
            } => (&self.ids, without_emitter, true, is_listed),
        };
        let color = [items_of(scene, layer)];
        // The clear value of the depth is 0: infinitely far.
        let depth = vk::RenderingAttachmentInfo::default()
            .image_view(scene.depths.layers[layer as usize])
            .image_layout(vk::ImageLayout::GENERAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE);
        let colors: &[_] = if has_ids { &color } else { &[] };
        let rendering = vk::RenderingInfo::default()
            .render_area(area(scene))
            .layer_count(1)
            .color_attachments(colors)
            .depth_attachment(&depth);
        let device = &self.gpu.raw;
        #[allow(clippy::cast_possible_truncation, reason = "checked when the scene was prepared")]
        let (chunks, indices) = (scene.upload.chunks.len() as u32, scene.upload.indices.len() as u32);
        // SAFETY: everything recorded lives until the submission is done; draws and counts are in their buffers'
        // bounds.
        unsafe {
            device.cmd_begin_rendering(commands, &rendering);
            device.cmd_bind_pipeline(
                commands,
                vk::PipelineBindPoint::GRAPHICS,
                pipelines[usize::from(without_emitter)].raw,
            );
            device.cmd_bind_vertex_buffers(commands, 0, &[scene.buffer(binding::VERTICES)], &[0]);
            device.cmd_bind_index_buffer(commands, scene.buffer(binding::INDICES), 0, vk::IndexType::UINT32);
            for face in Face::ALL {
                bind_face(&self.gpu, scene, frame, commands, slot, face);
                if !is_listed {
                    device.cmd_draw_indexed(commands, indices, 1, 0, 0, 0);
                    continue;
                }
                let at = layer * FACES + face as u32;
                device.cmd_draw_indexed_indirect_count(
                    commands,
                    scene.buffer(binding::DRAWS),
                    u64::from(at) * u64::from(chunks) * 20,
                    scene.buffer(binding::DRAW_COUNTS),
                    u64::from(at) * 4,
                    chunks,
                    20,
                );
            }
            device.cmd_end_rendering(commands);
        }
    }

    /// Draws a pass into the first layer, whose depths are preset, with the views of the first slot.
    pub(crate) fn pass(&self, scene: &Scene, frame: &Frame, commands: vk::CommandBuffer, draws: &[FaceDraw]) {
        let color = [items_of(scene, 0)];
        let depth = vk::RenderingAttachmentInfo::default()
            .image_view(scene.depths.layers[0])
            .image_layout(vk::ImageLayout::GENERAL)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE);
        let rendering = vk::RenderingInfo::default()
            .render_area(area(scene))
            .layer_count(1)
            .color_attachments(&color)
            .depth_attachment(&depth);
        let device = &self.gpu.raw;
        // SAFETY: as above; runs are within the indices, and rectangles within the image.
        unsafe {
            device.cmd_begin_rendering(commands, &rendering);
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, self.through.raw);
            device.cmd_bind_vertex_buffers(commands, 0, &[scene.buffer(binding::VERTICES)], &[0]);
            device.cmd_bind_index_buffer(commands, scene.buffer(binding::INDICES), 0, vk::IndexType::UINT32);
            for draw in draws {
                bind_face(&self.gpu, scene, frame, commands, 0, draw.face);
                #[allow(clippy::cast_possible_wrap, reason = "at most 3072")]
                let [x, y] = draw.low.map(|low| low as i32);
                let [width, height] = draw.size;
                let scissor = [vk::Rect2D {
                    offset: vk::Offset2D { x, y },
                    extent: vk::Extent2D { width, height },
                }];
                device.cmd_set_scissor(commands, 0, &scissor);
                for run in &draw.runs {
                    device.cmd_draw_indexed(commands, run.end - run.start, 1, run.start, 0, 0);
                }
            }
            device.cmd_end_rendering(commands);
        }
    }

    /// Draws the entries of a slot's row alone.
    pub(crate) fn cover(
        &self,
        scene: &Scene,
        frame: &Frame,
        commands: vk::CommandBuffer,
        Layer { slot, layer }: Layer,
    ) {
        let rendering = vk::RenderingInfo::default().render_area(area(scene)).layer_count(1);
        let device = &self.gpu.raw;
        // SAFETY: as above.
        unsafe {
            device.cmd_begin_rendering(commands, &rendering);
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, self.cover.raw);
            for face in Face::ALL {
                bind_face(&self.gpu, scene, frame, commands, slot, face);
                let offset = u64::from(layer) * 16;
                device.cmd_draw_indirect(commands, scene.buffer(binding::COVER_DRAWS), offset, 1, 16);
            }
            device.cmd_end_rendering(commands);
        }
    }
}

/// The item buffer of a layer, to be cleared.
fn items_of(scene: &Scene, layer: u32) -> vk::RenderingAttachmentInfo<'static> {
    let escaped = vk::ClearValue {
        color: vk::ClearColorValue {
            uint32: [scene.upload.patch_count + 1; 4],
        },
    };
    vk::RenderingAttachmentInfo::default()
        .image_view(scene.items.layers[layer as usize])
        .image_layout(vk::ImageLayout::GENERAL)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .store_op(vk::AttachmentStoreOp::STORE)
        .clear_value(escaped)
}

fn area(scene: &Scene) -> vk::Rect2D {
    let n = scene.plan.resolution;
    vk::Rect2D::default().extent(vk::Extent2D {
        width: n,
        height: 3 * n,
    })
}

fn bind_face(gpu: &Gpu, scene: &Scene, frame: &Frame, commands: vk::CommandBuffer, slot: u32, face: Face) {
    let n = scene.plan.resolution;
    let (first, rows) = (face.first_row(n), face.rows(n));
    #[allow(clippy::cast_precision_loss, reason = "at most 3072")]
    let viewport = [vk::Viewport {
        x: 0.0,
        y: first as f32,
        width: n as f32,
        height: rows as f32,
        min_depth: 0.0,
        max_depth: 1.0,
    }];
    #[allow(clippy::cast_possible_wrap, reason = "at most 3072")]
    let scissor = [vk::Rect2D {
        offset: vk::Offset2D { x: 0, y: first as i32 },
        extent: vk::Extent2D { width: n, height: rows },
    }];
    // SAFETY: sets of this device, and an offset within the views.
    unsafe {
        gpu.raw.cmd_set_viewport(commands, 0, &viewport);
        gpu.raw.cmd_set_scissor(commands, 0, &scissor);
        bind(
            gpu,
            scene,
            frame,
            commands,
            vk::PipelineBindPoint::GRAPHICS,
            slot * FACES + face as u32,
        );
    }
}

/// Binds both sets, with the view of a number.
///
/// # Safety
/// The commands are being recorded, for this device.
pub(crate) unsafe fn bind(
    gpu: &Gpu,
    scene: &Scene,
    frame: &Frame,
    commands: vk::CommandBuffer,
    point: vk::PipelineBindPoint,
    view: u32,
) {
    let sets = [frame.view_set, frame.set];
    // SAFETY: the caller's promise; the sets fit the layout.
    unsafe {
        gpu.raw
            .cmd_bind_descriptor_sets(commands, point, scene.layout, 0, &sets, &[view * VIEW_BYTES]);
    }
}
