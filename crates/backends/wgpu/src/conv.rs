//! Between wgpu's words and ours.

use hemicube_abi::DeviceKind;
use hemicube_contract::backend::BackendError;
use hemicube_shaders::stage::binding as b;
use wgpu::{BindGroupLayoutEntry, BindingType, BufferBindingType, BufferUsages, DeviceType, ShaderStages};

/// What kind of device it is.
pub(crate) fn device_kind(kind: DeviceType) -> DeviceKind {
    match kind {
        DeviceType::Cpu => DeviceKind::Software,
        DeviceType::IntegratedGpu => DeviceKind::IntegratedGpu,
        DeviceType::DiscreteGpu => DeviceKind::DiscreteGpu,
        DeviceType::VirtualGpu => DeviceKind::VirtualGpu,
        DeviceType::Other => DeviceKind::Other,
    }
}

/// Devices of each kind are listed together, what is fastest first.
pub(crate) fn rank(kind: DeviceType) -> u32 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// What an error that wgpu reports means for a session.
pub(crate) fn error(error: &wgpu::Error) -> BackendError {
    match error {
        wgpu::Error::OutOfMemory { source } => BackendError::OutOfMemory(format!(
            "the device refused an allocation ({source}); take a lower resolution, a coarser scene or fewer sessions"
        )),
        wgpu::Error::Validation { description, .. } => BackendError::Internal(format!("wgpu refuses: {description}")),
        wgpu::Error::Internal { description, .. } => BackendError::Internal(description.clone()),
    }
}

/// What a stage binds in group 1. Several entry points of a file may share one set.
pub(crate) struct Uses {
    /// What it only reads.
    pub(crate) reads: &'static [u32],
    /// What it writes.
    pub(crate) writes: &'static [u32],
}

/// The stages that bind anything but a view, each with the WGSL file of its name.
pub(crate) mod uses {
    use super::{Uses, b};

    pub(crate) const RENDER: Uses = Uses {
        reads: &[b::SETTINGS],
        writes: &[],
    };
    pub(crate) const CULL: Uses = Uses {
        reads: &[b::SETTINGS, b::VIEWS, b::CHUNKS, b::PYRAMID, b::SEEN],
        writes: &[b::DRAWS, b::DRAW_COUNTS, b::DRAWN, b::TALLIES],
    };
    pub(crate) const PYRAMID: Uses = Uses {
        reads: &[b::SETTINGS, b::DEPTHS, b::DEPTH_COPY],
        writes: &[b::PYRAMID],
    };
    pub(crate) const REDUCE: Uses = Uses {
        reads: &[b::SETTINGS, b::ITEMS, b::WEIGHTS],
        writes: &[b::VISIBLE, b::TOUCHED],
    };
    pub(crate) const REDUCE_SIDES: Uses = Uses {
        reads: &[b::SETTINGS, b::ITEMS, b::WEIGHTS],
        writes: &[b::NEAR, b::LISTED, b::SIDES],
    };
    pub(crate) const NEAR_EDGES: Uses = Uses {
        reads: &[b::SETTINGS, b::VIEWS, b::VERTICES, b::INDICES, b::TRIANGLE_OF_PATCH],
        writes: &[b::VISIBLE, b::TOUCHED, b::NEAR, b::LISTED, b::SIDES],
    };
    pub(crate) const SETTLE: Uses = Uses {
        reads: &[
            b::SETTINGS,
            b::VIEWS,
            b::ITEMS,
            b::WEIGHTS,
            b::VERTICES,
            b::INDICES,
            b::TRIANGLE_OF_PATCH,
        ],
        writes: &[b::VISIBLE, b::TOUCHED, b::NEAR, b::LISTED],
    };
    pub(crate) const PUT_SETTLED: Uses = Uses {
        reads: &[b::SETTINGS],
        writes: &[b::VISIBLE, b::TOUCHED, b::NEAR, b::LISTED, b::SETTLED_ITEMS],
    };
    pub(crate) const TAKE_BACK: Uses = Uses {
        reads: &[b::SETTINGS, b::WEIGHTS, b::ENTRIES, b::TOTALS],
        writes: &[b::HIDDEN, b::NEAR, b::LISTED],
    };
    pub(crate) const TINY: Uses = Uses {
        reads: &[
            b::SETTINGS,
            b::VIEWS,
            b::CHUNKS,
            b::DEPTHS,
            b::DRAWN,
            b::ITEMS,
            b::VERTICES,
            b::INDICES,
            b::TRIANGLE_OF_PATCH,
            b::CENTROIDS,
        ],
        writes: &[b::TOUCHED],
    };
    pub(crate) const COMPACT: Uses = Uses {
        reads: &[b::SETTINGS, b::CHUNK_OF_PATCH],
        writes: &[
            b::SEEN,
            b::VISIBLE,
            b::TOUCHED,
            b::ENTRIES,
            b::COVER_DRAWS,
            b::TOTALS,
            b::HIDDEN,
        ],
    };
    pub(crate) const COVER: Uses = Uses {
        reads: &[
            b::SETTINGS,
            b::ITEMS,
            b::WEIGHTS,
            b::VERTICES,
            b::INDICES,
            b::TRIANGLE_OF_PATCH,
            b::ENTRIES,
        ],
        writes: &[b::HIDDEN],
    };
    pub(crate) const PACK: Uses = Uses {
        reads: &[b::SETTINGS, b::ENTRIES, b::TOTALS, b::HIDDEN],
        writes: &[b::TALLIES, b::OUTPUT],
    };
}

impl Uses {
    /// All that is bound.
    pub(crate) fn bindings(&self) -> impl Iterator<Item = u32> {
        self.reads.iter().chain(self.writes).copied()
    }

    /// The layout of group 1 for a stage that is drawn or computed. What is written is written by fragments only.
    pub(crate) fn layout(&self, is_drawn: bool) -> Vec<BindGroupLayoutEntry> {
        let entry = |binding, is_written: bool| BindGroupLayoutEntry {
            binding,
            visibility: match (is_drawn, is_written) {
                (true, true) => ShaderStages::FRAGMENT,
                (true, false) => ShaderStages::VERTEX_FRAGMENT,
                (false, _) => ShaderStages::COMPUTE,
            },
            ty: binding_type(binding, !is_written),
            count: None,
        };
        let reads = self.reads.iter().map(|&binding| entry(binding, false));
        reads
            .chain(self.writes.iter().map(|&binding| entry(binding, true)))
            .collect()
    }
}

fn binding_type(binding: u32, read_only: bool) -> BindingType {
    let texture = |sample_type| BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    match binding {
        b::DEPTHS => texture(wgpu::TextureSampleType::Float { filterable: false }),
        b::ITEMS => texture(wgpu::TextureSampleType::Uint),
        b::SETTLED_ITEMS => BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format: wgpu::TextureFormat::R32Uint,
            view_dimension: wgpu::TextureViewDimension::D2Array,
        },
        b::SETTINGS => buffer(BufferBindingType::Uniform, false),
        _ => buffer(BufferBindingType::Storage { read_only }, false),
    }
}

/// The layout of group 0: the view, at an offset that each draw chooses.
pub(crate) fn view_layout() -> BindGroupLayoutEntry {
    BindGroupLayoutEntry {
        binding: b::VIEW,
        visibility: ShaderStages::VERTEX_FRAGMENT | ShaderStages::COMPUTE,
        ty: buffer(BufferBindingType::Uniform, true),
        count: None,
    }
}

fn buffer(ty: BufferBindingType, has_dynamic_offset: bool) -> BindingType {
    BindingType::Buffer {
        ty,
        has_dynamic_offset,
        // Checked by wgpu when it is drawn: sizes depend on the scene.
        min_binding_size: None,
    }
}

/// How the buffer of a binding is used.
pub(crate) fn usage(binding: u32) -> BufferUsages {
    let besides = match binding {
        b::DRAWS | b::DRAW_COUNTS | b::COVER_DRAWS => BufferUsages::INDIRECT,
        b::VERTICES => BufferUsages::VERTEX,
        b::INDICES => BufferUsages::INDEX,
        b::OUTPUT => BufferUsages::COPY_SRC,
        _ => BufferUsages::empty(),
    };
    BufferUsages::STORAGE | BufferUsages::COPY_DST | besides
}

/// Words as wgpu is given them.
pub(crate) fn to_bytes(words: impl IntoIterator<Item = u32>) -> Vec<u8> {
    words.into_iter().flat_map(u32::to_ne_bytes).collect()
}

/// Words as wgpu hands them back.
pub(crate) fn to_words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|&word| u32::from_ne_bytes(word)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn want_of_memory_is_told_from_a_defect() {
        let source = || -> Box<dyn std::error::Error + Send + Sync> { "no room".into() };
        let memory = wgpu::Error::OutOfMemory { source: source() };
        assert!(matches!(error(&memory), BackendError::OutOfMemory(text) if text.contains("no room")));
        let defect = wgpu::Error::Validation {
            source: source(),
            description: "bad binding".to_owned(),
        };
        assert!(matches!(error(&defect), BackendError::Internal(text) if text.contains("bad binding")));
    }

    #[test]
    fn no_stage_reads_and_writes_the_same_binding() {
        use uses::{
            COMPACT, COVER, CULL, NEAR_EDGES, PACK, PUT_SETTLED, PYRAMID, REDUCE, REDUCE_SIDES, RENDER, SETTLE,
            TAKE_BACK, TINY,
        };
        for uses in [
            RENDER,
            CULL,
            PYRAMID,
            REDUCE,
            REDUCE_SIDES,
            NEAR_EDGES,
            SETTLE,
            PUT_SETTLED,
            TINY,
            COMPACT,
            COVER,
            TAKE_BACK,
            PACK,
        ] {
            let mut all: Vec<u32> = uses.bindings().collect();
            all.sort_unstable();
            all.dedup();
            assert_eq!(all.len(), uses.reads.len() + uses.writes.len());
        }
    }

    #[test]
    fn words_survive_the_way_there_and_back() {
        let words = [0, 1, u32::MAX, 0x1234_5678];
        assert_eq!(to_words(&to_bytes(words)), words);
    }
}
