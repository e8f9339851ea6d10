//! A scene on the device: its buffers and images.

use crate::conv;
use crate::device::Device;
use hemicube_contract::backend::{BackendError, Geometry};
use hemicube_shaders::stage::binding as b;
use hemicube_shaders::upload::contents;
use hemicube_shaders::{Edges, Plan, Upload};
use wgpu::util::DeviceExt;
use wgpu::{Buffer, BufferUsages, TextureFormat, TextureUsages, TextureView};

/// An image of layers: a view of all, and one of each.
pub(crate) struct Image {
    pub(crate) texture: wgpu::Texture,
    pub(crate) all: TextureView,
    pub(crate) layers: Vec<TextureView>,
}

impl Image {
    fn new(device: &Device, label: &str, format: TextureFormat, plan: &Plan, besides: TextureUsages) -> Self {
        let texture = device.raw.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: plan.resolution,
                height: 3 * plan.resolution,
                depth_or_array_layers: plan.group,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC
                | besides,
            view_formats: &[],
        });
        let view = |dimension, first, count| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(dimension),
                base_array_layer: first,
                array_layer_count: Some(count),
                ..Default::default()
            })
        };
        Self {
            all: view(wgpu::TextureViewDimension::D2Array, 0, plan.group),
            layers: (0..plan.group)
                .map(|layer| view(wgpu::TextureViewDimension::D2, layer, 1))
                .collect(),
            texture,
        }
    }
}

/// A scene on the device at a resolution.
pub(crate) struct Store {
    /// By binding, without [`TWICE`].
    buffers: Vec<Option<Buffer>>,
    pub(crate) depths: Image,
    pub(crate) items: Image,
}

/// Bindings with a buffer in each of the two sets: one is read while the other is written.
pub(crate) const TWICE: [u32; 2] = [b::VIEWS, b::OUTPUT];

impl Store {
    pub(crate) fn new(
        device: &Device,
        geometry: &Geometry,
        upload: &Upload,
        plan: &Plan,
    ) -> Result<Self, BackendError> {
        let mut buffers: Vec<Option<Buffer>> = (0..b::COUNT).map(|_| None).collect();
        for size in plan.sizes(upload) {
            if TWICE.contains(&size.binding) {
                continue;
            }
            // wgpu clears new buffers; marks, sums and counters need it.
            buffers[size.binding as usize] = Some(device.raw.create_buffer(&wgpu::BufferDescriptor {
                label: Some(size.name),
                size: size.bytes.next_multiple_of(16),
                usage: conv::usage(size.binding),
                mapped_at_creation: false,
            }));
            device.check().map_err(|error| match error {
                BackendError::OutOfMemory(_) => BackendError::OutOfMemory(format!(
                    "{} need {} bytes, which the device does not have left; \
                     take a coarser scene, a lower resolution or fewer sessions",
                    size.name, size.bytes
                )),
                error => error,
            })?;
        }
        let written = match plan.edges {
            Edges::Driver => TextureUsages::empty(),
            Edges::Exact => TextureUsages::STORAGE_BINDING,
        };
        let nothing = TextureUsages::empty();
        for (binding, words) in contents(upload, geometry, plan) {
            let bytes = conv::to_bytes(words.iter().copied());
            match &mut buffers[binding as usize] {
                Some(buffer) => device.queue.write_buffer(buffer, 0, &bytes),
                settings => {
                    *settings = Some(device.raw.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                        label: Some("settings"),
                        contents: &bytes,
                        usage: BufferUsages::UNIFORM,
                    }));
                }
            }
        }
        let store = Self {
            buffers,
            depths: Image::new(device, "depths", TextureFormat::Depth32Float, plan, nothing),
            items: Image::new(device, "items", TextureFormat::R32Uint, plan, written),
        };
        device.check()?;
        // Pending copies take as much memory again until they are done.
        let done = device.queue.submit([]);
        device.wait(done)?;
        Ok(store)
    }

    /// Returns the buffer of a binding.
    ///
    /// # Panics
    /// For a texture, and for the bindings of [`TWICE`].
    pub(crate) fn buffer(&self, binding: u32) -> &Buffer {
        self.buffers[binding as usize]
            .as_ref()
            .unwrap_or_else(|| unreachable!("binding {binding} has no buffer of its own"))
    }

    /// Marks all chunks drawn, for submissions without culling.
    pub(crate) fn mark_all_drawn(&self, device: &Device) {
        let drawn = self.buffer(b::DRAWN);
        let words = drawn.size() / 4;
        device
            .queue
            .write_buffer(drawn, 0, &conv::to_bytes((0..words).map(|_| 1)));
    }
}
