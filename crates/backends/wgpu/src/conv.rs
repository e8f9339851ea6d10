//! Between wgpu's words and ours.

use hemicube_abi::DeviceKind;
use hemicube_contract::backend::BackendError;
use hemicube_shaders::stage::{Kind, Stage, binding as b};
use std::collections::BTreeSet;
use wgpu::{BindGroupLayoutEntry, BindingType, BufferBindingType, BufferUsages, DeviceType, ShaderStages};

/// Translates the kind of a device.
pub(crate) fn device_kind(kind: DeviceType) -> DeviceKind {
    match kind {
        DeviceType::Cpu => DeviceKind::Software,
        DeviceType::IntegratedGpu => DeviceKind::IntegratedGpu,
        DeviceType::DiscreteGpu => DeviceKind::DiscreteGpu,
        DeviceType::VirtualGpu => DeviceKind::VirtualGpu,
        DeviceType::Other => DeviceKind::Other,
    }
}

/// Orders kinds of devices, the fastest first.
pub(crate) fn rank(kind: DeviceType) -> u32 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// Translates an error reported by wgpu.
pub(crate) fn error(error: &wgpu::Error) -> BackendError {
    match error {
        wgpu::Error::OutOfMemory { source } => BackendError::OutOfMemory(format!(
            "the device refused an allocation ({source}); take a lower resolution, a coarser scene or fewer sessions"
        )),
        wgpu::Error::Validation { description, .. } => BackendError::Internal(format!("wgpu refuses: {description}")),
        wgpu::Error::Internal { description, .. } => BackendError::Internal(description.clone()),
    }
}

/// Lists the bindings of group 1 of stages run together, ascending.
pub(crate) fn bindings(stages: &[&Stage]) -> BTreeSet<u32> {
    let all = stages.iter().flat_map(|stage| stage.reads.iter().chain(stage.writes));
    all.copied().collect()
}

/// Makes the layout of group 1 of stages run together: a compute stage, or those of a draw. Only fragments write.
pub(crate) fn layout(stages: &[&Stage]) -> Vec<BindGroupLayoutEntry> {
    let is_drawn = stages.iter().any(|stage| stage.kind != Kind::Compute);
    let entry = |binding| {
        let is_written = stages.iter().any(|stage| stage.writes.contains(&binding));
        BindGroupLayoutEntry {
            binding,
            visibility: match (is_drawn, is_written) {
                (true, true) => ShaderStages::FRAGMENT,
                (true, false) => ShaderStages::VERTEX_FRAGMENT,
                (false, _) => ShaderStages::COMPUTE,
            },
            ty: binding_type(binding, !is_written),
            count: None,
        }
    };
    bindings(stages).into_iter().map(entry).collect()
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

/// Makes the layout of group 0: the view, at an offset chosen by each draw.
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

/// Returns the usages of a binding's buffer.
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

/// Converts words for wgpu.
pub(crate) fn to_bytes(words: impl IntoIterator<Item = u32>) -> Vec<u8> {
    words.into_iter().flat_map(u32::to_ne_bytes).collect()
}

/// Converts bytes from wgpu.
pub(crate) fn to_words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|&word| u32::from_ne_bytes(word)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_shaders::stage;

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
        for stage in stage::ALL {
            assert_eq!(bindings(&[stage]).len(), stage.reads.len() + stage.writes.len());
        }
    }

    #[test]
    fn words_survive_the_way_there_and_back() {
        let words = [0, 1, u32::MAX, 0x1234_5678];
        assert_eq!(to_words(&to_bytes(words)), words);
    }
}
