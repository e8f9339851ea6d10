//! A scene on the device: its buffers, images and descriptor sets.

use crate::conv;
use crate::device::{Buffer, Gpu, Image, Place};
use ash::vk;
use hemicube_contract::backend::{BackendError, Geometry, RenderSettings};
use hemicube_shaders::stage::binding;
use hemicube_shaders::upload::contents;
use hemicube_shaders::view::VIEW_BYTES;
use hemicube_shaders::{Cull, Edges, Limits, Plan, Upload};
use std::sync::Arc;

/// Submissions under way at once.
pub(crate) const FRAMES: usize = 2;

/// A scene on the device.
#[derive(Debug)]
pub(crate) struct Scene {
    gpu: Arc<Gpu>,
    pub(crate) upload: Arc<Upload>,
    pub(crate) plan: Plan,
    /// By binding, without those of [`Frame`].
    buffers: Vec<Option<Buffer>>,
    pub(crate) items: Image,
    pub(crate) depths: Image,
    pub(crate) frames: [Frame; FRAMES],
    pub(crate) layout: vk::PipelineLayout,
    set_layouts: [vk::DescriptorSetLayout; 2],
    pool: vk::DescriptorPool,
}

/// The part of a scene owned by each submission under way.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) views: Buffer,
    pub(crate) output: Buffer,
    pub(crate) view_set: vk::DescriptorSet,
    pub(crate) set: vk::DescriptorSet,
}

fn kind(binding: u32) -> vk::DescriptorType {
    match binding {
        binding::SETTINGS => vk::DescriptorType::UNIFORM_BUFFER,
        binding::SETTLED_ITEMS => vk::DescriptorType::STORAGE_IMAGE,
        b if binding::TEXTURES.contains(&b) => vk::DescriptorType::SAMPLED_IMAGE,
        _ => vk::DescriptorType::STORAGE_BUFFER,
    }
}

fn usage(binding: u32) -> vk::BufferUsageFlags {
    use vk::BufferUsageFlags as U;
    let storage = U::STORAGE_BUFFER | U::TRANSFER_DST;
    match binding {
        binding::SETTINGS => U::UNIFORM_BUFFER | U::TRANSFER_DST,
        binding::VIEWS => storage | U::UNIFORM_BUFFER,
        binding::DRAWS | binding::DRAW_COUNTS | binding::COVER_DRAWS => storage | U::INDIRECT_BUFFER,
        binding::VERTICES => storage | U::VERTEX_BUFFER,
        binding::INDICES => storage | U::INDEX_BUFFER,
        _ => storage,
    }
}

impl Scene {
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        geometry: &Geometry,
        settings: RenderSettings,
        limits: Limits,
    ) -> Result<Self, BackendError> {
        let upload = Upload::of(geometry, limits.draw)?;
        let plan = Plan::new(&upload, settings, limits)?;
        let storage = |name: &str, bytes, binding| Buffer::new(gpu, name, bytes, Place::Device, usage(binding));
        let mut buffers: Vec<Option<Buffer>> = (0..binding::COUNT).map(|_| None).collect();
        for size in plan.sizes(&upload) {
            if ![binding::VIEWS, binding::OUTPUT].contains(&size.binding) {
                buffers[size.binding as usize] = Some(storage(size.name, size.bytes, size.binding)?);
            }
        }
        for (at, words) in contents(&upload, geometry, &plan) {
            let buffer = &mut buffers[at as usize];
            if at == binding::SETTINGS {
                *buffer = Some(storage("settings", 4 * words.len() as u64, at)?);
            }
            if let Some(buffer) = buffer {
                buffer.write(0, &words)?;
            }
        }
        let extent = vk::Extent2D {
            width: settings.resolution,
            height: 3 * settings.resolution,
        };
        let written = match plan.edges {
            Edges::Driver => vk::ImageUsageFlags::empty(),
            Edges::Exact => vk::ImageUsageFlags::STORAGE,
        };
        let image = |what, format, besides| Image::new(gpu, what, format, extent, plan.group, besides);
        let items = image("the item buffer", vk::Format::R32_UINT, written)?;
        // Passes begin with depths of the host's.
        let depths = image(
            "the depth buffer",
            vk::Format::D32_SFLOAT,
            vk::ImageUsageFlags::TRANSFER_DST,
        )?;
        let frame = || -> Result<Frame, BackendError> {
            let size = |wanted| {
                let sizes = plan.sizes(&upload);
                sizes.iter().find(|s| s.binding == wanted).map_or(0, |s| s.bytes)
            };
            let (views, output) = (binding::VIEWS, binding::OUTPUT);
            Ok(Frame {
                views: Buffer::new(gpu, "views", size(views), Place::Up, usage(views))?,
                output: Buffer::new(gpu, "rows to read back", size(output), Place::Down, usage(output))?,
                view_set: vk::DescriptorSet::null(),
                set: vk::DescriptorSet::null(),
            })
        };
        let mut scene = Self {
            gpu: Arc::clone(gpu),
            frames: [frame()?, frame()?],
            upload,
            plan,
            buffers,
            items,
            depths,
            layout: vk::PipelineLayout::null(),
            set_layouts: [vk::DescriptorSetLayout::null(); 2],
            pool: vk::DescriptorPool::null(),
        };
        let made = scene.make_layouts().and_then(|()| scene.make_sets());
        made.map_err(|r| conv::error("descriptor sets", r))?;
        Ok(scene)
    }

    pub(crate) fn buffer(&self, binding: u32) -> vk::Buffer {
        self.buffers[binding as usize]
            .as_ref()
            .map_or(vk::Buffer::null(), |b| b.raw)
    }

    /// Makes the layouts of the descriptor sets: set 0 holds a view, chosen by its offset, set 1 all else.
    fn make_layouts(&mut self) -> Result<(), vk::Result> {
        use vk::{DescriptorType as T, ShaderStageFlags as S};
        let device = &self.gpu.raw;
        let everywhere = S::VERTEX | S::FRAGMENT | S::COMPUTE;
        let slot = |binding, kind| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(kind)
                .descriptor_count(1)
                .stage_flags(everywhere)
        };
        let first = [slot(binding::VIEW, T::UNIFORM_BUFFER_DYNAMIC)];
        let second: Vec<_> = (binding::SETTINGS..binding::COUNT).map(|b| slot(b, kind(b))).collect();
        // SAFETY: all is of this device; `drop` destroys what was made, also when this ends early.
        unsafe {
            for (made, bindings) in self.set_layouts.iter_mut().zip([&first[..], &second]) {
                let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(bindings);
                *made = device.create_descriptor_set_layout(&create, None)?;
            }
            let create = vk::PipelineLayoutCreateInfo::default().set_layouts(&self.set_layouts);
            self.layout = device.create_pipeline_layout(&create, None)?;
            #[allow(clippy::cast_possible_truncation, reason = "two frames")]
            let frames = FRAMES as u32;
            let sizes = [
                (T::UNIFORM_BUFFER_DYNAMIC, 1),
                (T::UNIFORM_BUFFER, 1),
                (T::SAMPLED_IMAGE, 2),
                (T::STORAGE_IMAGE, 1),
                (T::STORAGE_BUFFER, binding::COUNT),
            ]
            .map(|(kind, count)| vk::DescriptorPoolSize {
                ty: kind,
                descriptor_count: count * frames,
            });
            let create = vk::DescriptorPoolCreateInfo::default()
                .max_sets(2 * frames)
                .pool_sizes(&sizes);
            self.pool = device.create_descriptor_pool(&create, None)?;
        }
        Ok(())
    }

    /// Makes the descriptor sets of each frame.
    fn make_sets(&mut self) -> Result<(), vk::Result> {
        for at in 0..FRAMES {
            let allocate = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(self.pool)
                .set_layouts(&self.set_layouts);
            // SAFETY: the pool has room for the sets of all frames.
            let sets = unsafe { self.gpu.raw.allocate_descriptor_sets(&allocate)? };
            let frame = &mut self.frames[at];
            (frame.view_set, frame.set) = (sets[0], sets[1]);
            let frame = &self.frames[at];
            let view = [vk::DescriptorBufferInfo {
                buffer: frame.views.raw,
                offset: 0,
                range: u64::from(VIEW_BYTES),
            }];
            // Bindings unused by every pipeline may stay empty.
            let settles = self.plan.edges == Edges::Exact;
            let infos: Vec<_> = (binding::SETTINGS..binding::COUNT)
                .filter(|&b| settles || b != binding::SETTLED_ITEMS)
                .map(|b| {
                    let buffer = match b {
                        binding::VIEWS => frame.views.raw,
                        binding::OUTPUT => frame.output.raw,
                        _ => self.buffer(b),
                    };
                    let image = match b {
                        binding::DEPTHS => self.depths.all,
                        _ => self.items.all,
                    };
                    let buffer = vk::DescriptorBufferInfo::default().buffer(buffer).range(vk::WHOLE_SIZE);
                    let image = vk::DescriptorImageInfo::default()
                        .image_view(image)
                        .image_layout(vk::ImageLayout::GENERAL);
                    (b, [buffer], [image])
                })
                .collect();
            let mut writes: Vec<_> = infos
                .iter()
                .map(|(b, buffer, image)| {
                    let write = vk::WriteDescriptorSet::default()
                        .dst_set(frame.set)
                        .dst_binding(*b)
                        .descriptor_type(kind(*b));
                    if binding::TEXTURES.contains(b) || *b == binding::SETTLED_ITEMS {
                        write.image_info(image)
                    } else {
                        write.buffer_info(buffer)
                    }
                })
                .collect();
            writes.push(
                vk::WriteDescriptorSet::default()
                    .dst_set(frame.view_set)
                    .dst_binding(binding::VIEW)
                    .descriptor_type(vk::DescriptorType::UNIFORM_BUFFER_DYNAMIC)
                    .buffer_info(&view),
            );
            // SAFETY: sets of this device that nothing uses yet, and infos that live until the call returns.
            unsafe { self.gpu.raw.update_descriptor_sets(&writes, &[]) };
        }
        Ok(())
    }

    /// Copies depths of the first layers to a buffer, for software.
    pub(crate) fn copy_depths(&self, commands: vk::CommandBuffer, layers: u32) {
        let n = self.plan.resolution;
        let region = [vk::BufferImageCopy::default()
            .image_subresource(
                vk::ImageSubresourceLayers::default()
                    .aspect_mask(vk::ImageAspectFlags::DEPTH)
                    .layer_count(layers),
            )
            .image_extent(vk::Extent3D {
                width: n,
                height: 3 * n,
                depth: 1,
            })];
        // SAFETY: commands of this device that are being recorded; the buffer has room for the layers of a group.
        unsafe {
            self.gpu.raw.cmd_copy_image_to_buffer(
                commands,
                self.depths.raw,
                vk::ImageLayout::GENERAL,
                self.buffer(binding::DEPTH_COPY),
                &region,
            );
        }
    }

    /// Copies depths of the first layer from a buffer.
    pub(crate) fn preset_depths(&self, commands: vk::CommandBuffer, from: vk::Buffer) {
        let n = self.plan.resolution;
        let region = [vk::BufferImageCopy::default()
            .image_subresource(
                vk::ImageSubresourceLayers::default()
                    .aspect_mask(vk::ImageAspectFlags::DEPTH)
                    .layer_count(1),
            )
            .image_extent(vk::Extent3D {
                width: n,
                height: 3 * n,
                depth: 1,
            })];
        // SAFETY: commands of this device that are being recorded; the caller's buffer has a depth for each pixel.
        unsafe {
            self.gpu
                .raw
                .cmd_copy_buffer_to_image(commands, from, self.depths.raw, vk::ImageLayout::GENERAL, &region);
        }
    }

    /// Brings the images into the general layout, and sets the buffers' first values.
    pub(crate) fn clear(&self, cull: Cull) -> Result<(), BackendError> {
        // Without culling, all chunks are drawn.
        let drawn = u32::from(cull == Cull::Off);
        self.gpu.run_once(|commands| {
            let images = [&self.items, &self.depths].map(|image| {
                vk::ImageMemoryBarrier2::default()
                    .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                    .new_layout(vk::ImageLayout::GENERAL)
                    .image(image.raw)
                    .subresource_range(
                        vk::ImageSubresourceRange::default()
                            .aspect_mask(image.aspect)
                            .level_count(1)
                            .layer_count(vk::REMAINING_ARRAY_LAYERS),
                    )
            });
            let dependency = vk::DependencyInfo::default().image_memory_barriers(&images);
            // SAFETY: images and buffers of this device that nothing else uses yet.
            unsafe { self.gpu.raw.cmd_pipeline_barrier2(commands, &dependency) };
            for (binding, value) in [
                (binding::SEEN, 0),
                (binding::TALLIES, 0),
                (binding::VISIBLE, 0),
                (binding::TOUCHED, 0),
                (binding::NEAR, 0),
                (binding::SIDES, 0),
                (binding::DRAWN, drawn),
            ] {
                // SAFETY: as above.
                unsafe {
                    self.gpu
                        .raw
                        .cmd_fill_buffer(commands, self.buffer(binding), 0, vk::WHOLE_SIZE, value);
                }
            }
        })
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the session waits for the device before it drops a scene; destroying null is allowed.
        unsafe {
            let device = &self.gpu.raw;
            device.destroy_descriptor_pool(self.pool, None);
            device.destroy_pipeline_layout(self.layout, None);
            for layout in self.set_layouts {
                device.destroy_descriptor_set_layout(layout, None);
            }
        }
    }
}
