//! Rays: a pipeline with buffers of its own, made by the first call.

use crate::conv;
use crate::device::{Buffer, Gpu, Place};
use crate::render::{Pipeline, compute};
use ash::vk;
use hemicube_contract::backend::{BackendError, Geometry, Rays};
use hemicube_shaders::rays::{MOST_RAYS, MOST_WORDS, RayTree, groups};
use hemicube_shaders::stage::{self, binding};
use std::sync::Arc;

/// The stage, bound to a scene's tree.
#[derive(Debug)]
pub(crate) struct Caster {
    tree: Arc<RayTree>,
    /// Nodes, triangles, rays, answers.
    buffers: [Buffer; 4],
    pipeline: Pipeline,
    bound: Bound,
}

/// A pipeline's layout and its one set.
#[derive(Debug)]
struct Bound {
    gpu: Arc<Gpu>,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
}

const BINDINGS: [u32; 4] = [binding::RAY_NODES, binding::RAY_TRIANGLES, binding::RAYS, binding::MET];

impl Bound {
    fn new(gpu: &Arc<Gpu>) -> Result<Self, vk::Result> {
        let mut bound = Self {
            gpu: Arc::clone(gpu),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            pool: vk::DescriptorPool::null(),
            set: vk::DescriptorSet::null(),
        };
        let kind = vk::DescriptorType::STORAGE_BUFFER;
        let slots = BINDINGS.map(|binding| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(kind)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        });
        let sizes = [vk::DescriptorPoolSize {
            ty: kind,
            descriptor_count: 4,
        }];
        let device = &gpu.raw;
        // SAFETY: all is of this device; `drop` destroys what was made, also when this ends early.
        unsafe {
            let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
            bound.set_layout = device.create_descriptor_set_layout(&create, None)?;
            // The stage's group is 1: set 0 is that of views, and of no use here.
            let layouts = [bound.set_layout; 2];
            let create = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts);
            bound.layout = device.create_pipeline_layout(&create, None)?;
            let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
            bound.pool = device.create_descriptor_pool(&create, None)?;
            let allocate = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(bound.pool)
                .set_layouts(&layouts[..1]);
            bound.set = device.allocate_descriptor_sets(&allocate)?[0];
        }
        Ok(bound)
    }

    fn bind(&self, buffers: &[Buffer; 4]) {
        let infos: Vec<_> = buffers
            .iter()
            .map(|buffer| {
                [vk::DescriptorBufferInfo::default()
                    .buffer(buffer.raw)
                    .range(vk::WHOLE_SIZE)]
            })
            .collect();
        let writes: Vec<_> = BINDINGS
            .iter()
            .zip(&infos)
            .map(|(&binding, info)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        // SAFETY: a set of this device that nothing uses yet, and infos that live until the call returns.
        unsafe { self.gpu.raw.update_descriptor_sets(&writes, &[]) };
    }
}

impl Drop for Bound {
    fn drop(&mut self) {
        // SAFETY: every dispatch was waited for; destroying null is allowed.
        unsafe {
            let device = &self.gpu.raw;
            device.destroy_descriptor_pool(self.pool, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

impl Caster {
    pub(crate) fn new(gpu: &Arc<Gpu>, geometry: &Geometry) -> Result<Self, BackendError> {
        let tree = RayTree::of(geometry);
        tree.require_range(gpu.limits.max_storage_buffer_range.into())?;
        let storage = |what: &str, words: usize, place| {
            let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_DST;
            Buffer::new(gpu, what, 4 * words as u64, place, usage)
        };
        let buffers = [
            storage("the tree of rays", tree.nodes.len(), Place::Device)?,
            storage("triangles for rays", tree.triangles.len(), Place::Device)?,
            storage("rays", MOST_WORDS, Place::Up)?,
            storage("answers to rays", MOST_RAYS, Place::Down)?,
        ];
        buffers[0].write(0, &tree.nodes)?;
        buffers[1].write(0, &tree.triangles)?;
        let bound = Bound::new(gpu).map_err(|r| conv::error("the descriptor set of rays", r))?;
        bound.bind(&buffers);
        Ok(Self {
            tree,
            buffers,
            pipeline: compute(gpu, bound.layout, &stage::CAST_RAYS)?,
            bound,
        })
    }

    pub(crate) fn cast(&self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let gpu = &self.bound.gpu;
        let mut met = Vec::with_capacity(rays.ends.len());
        for ends in rays.ends.chunks(MOST_RAYS) {
            self.buffers[2].write(0, &self.tree.words(rays, ends))?;
            let barrier = [vk::MemoryBarrier2 {
                src_stage_mask: vk::PipelineStageFlags2::COMPUTE_SHADER,
                src_access_mask: vk::AccessFlags2::SHADER_STORAGE_WRITE,
                dst_stage_mask: vk::PipelineStageFlags2::HOST,
                dst_access_mask: vk::AccessFlags2::HOST_READ,
                ..Default::default()
            }];
            gpu.run_once(|commands| {
                let point = vk::PipelineBindPoint::COMPUTE;
                let dependency = vk::DependencyInfo::default().memory_barriers(&barrier);
                // SAFETY: commands of this device that are being recorded; all that they use lives until the queue is
                // idle.
                unsafe {
                    let device = &gpu.raw;
                    device.cmd_bind_pipeline(commands, point, self.pipeline.raw);
                    device.cmd_bind_descriptor_sets(commands, point, self.bound.layout, 1, &[self.bound.set], &[]);
                    device.cmd_dispatch(commands, groups(ends.len()), 1, 1);
                    device.cmd_pipeline_barrier2(commands, &dependency);
                }
            })?;
            met.extend_from_slice(self.buffers[3].read(0, ends.len())?);
        }
        Ok(met)
    }
}
