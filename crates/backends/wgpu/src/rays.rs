//! Rays: a pipeline with buffers of its own, made by the first call.

use crate::conv;
use crate::device::{Compiler, Device};
use crate::reduce::read;
use hemicube_contract::backend::{BackendError, Geometry, Rays};
use hemicube_shaders::rays::{MOST_RAYS, MOST_WORDS, RayTree, groups};
use hemicube_shaders::stage::{self, binding as b};
use std::sync::Arc;
use wgpu::{BindGroup, Buffer, BufferUsages, ComputePipeline};

/// The stage, bound to a scene's tree.
pub(crate) struct Caster {
    tree: Arc<RayTree>,
    rays: Buffer,
    met: Buffer,
    /// A copy of the answers for the host.
    copy: Buffer,
    pipeline: ComputePipeline,
    bound: BindGroup,
}

impl Caster {
    pub(crate) fn new(device: &Device, compiler: &mut Compiler<'_>, geometry: &Geometry) -> Result<Self, BackendError> {
        let tree = RayTree::of(geometry);
        tree.require_range(device.storage_range())?;
        let buffer = |what, words: usize, usage| {
            device.raw.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: 4 * words.max(4) as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let up = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let nodes = buffer("the tree of rays", tree.nodes.len(), up);
        let triangles = buffer("triangles for rays", tree.triangles.len(), up);
        let rays = buffer("rays", MOST_WORDS, up);
        let met = buffer(
            "answers to rays",
            MOST_RAYS,
            BufferUsages::STORAGE | BufferUsages::COPY_SRC,
        );
        let copy = buffer(
            "a copy of them",
            MOST_RAYS,
            BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        );
        for (buffer, words) in [(&nodes, &tree.nodes), (&triangles, &tree.triangles)] {
            device
                .queue
                .write_buffer(buffer, 0, &conv::to_bytes(words.iter().copied()));
        }
        let (layout, pipeline) = compiler.compute(&stage::CAST_RAYS);
        let entries = [
            (b::RAY_NODES, &nodes),
            (b::RAY_TRIANGLES, &triangles),
            (b::RAYS, &rays),
            (b::MET, &met),
        ];
        let entries = entries.map(|(binding, buffer)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        });
        let bound = device.raw.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("rays"),
            layout: &layout,
            entries: &entries,
        });
        device.check()?;
        Ok(Self {
            tree,
            rays,
            met,
            copy,
            pipeline,
            bound,
        })
    }

    /// Casts rays. `view` is bound as group 0, which the stage does not read.
    pub(crate) fn cast(&self, device: &Device, view: &BindGroup, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let mut met = Vec::with_capacity(rays.ends.len());
        for ends in rays.ends.chunks(MOST_RAYS) {
            let words = conv::to_bytes(self.tree.words(rays, ends));
            device.queue.write_buffer(&self.rays, 0, &words);
            let mut encoder = device
                .raw
                .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, view, &[0]);
            pass.set_bind_group(1, &self.bound, &[]);
            pass.dispatch_workgroups(groups(ends.len()), 1, 1);
            drop(pass);
            let bytes = 4 * ends.len() as u64;
            encoder.copy_buffer_to_buffer(&self.met, 0, &self.copy, 0, bytes);
            let submission = device.queue.submit([encoder.finish()]);
            met.extend(read(device, &self.copy, bytes, submission)?);
        }
        Ok(met)
    }
}
