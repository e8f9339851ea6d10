//! Adapters, a device with its queue, and its errors.
//!
//! wgpu reports errors to a callback, not to the call at fault. On the APIs in use here, the callback has run when the
//! call returns: [`Device::check`] after some calls finds their errors.

use crate::conv;
use crate::options::Options;
use hemicube_contract::backend::{BackendError, RESOLUTIONS};
use hemicube_shaders::stage::Stage;
use hemicube_shaders::{Draw, Limits, OfStage, session};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use wgpu::{
    Backends, BindGroupLayout, ComputePipeline, DeviceType, Features, InstanceFlags, PipelineCompilationOptions,
    PipelineLayout, RenderPipeline, ShaderModule,
};

/// Memory to take on a driver running on the processor: Mesa's has a heap of 2 GiB. wgpu does not tell a GPU's memory;
/// there, a failing allocation is reported.
const SOFTWARE_MEMORY: u64 = 7 << 28;

/// Errors of a device, noted by wgpu's callbacks.
#[derive(Debug, Default)]
struct Faults {
    first: Mutex<Option<BackendError>>,
    lost: OnceLock<String>,
}

/// A device and its queue.
#[derive(Debug)]
pub(crate) struct Device {
    pub(crate) raw: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    limits: Limits,
    /// True if it is a program on the processor.
    pub(crate) is_software: bool,
    /// True if the number of indirect draws may come from a buffer.
    pub(crate) counts_draws: bool,
    faults: Arc<Faults>,
}

/// Instances kept for the life of the process, without and with validation, on a machine with a GPU: a driver may take
/// what other libraries of the process hold with it when an instance is destroyed (NVIDIA's 580 ends the displays of
/// EGL), and did crash when two threads made and destroyed instances.
static KEPT: Mutex<[Option<wgpu::Instance>; 2]> = Mutex::new([None, None]);

fn new_instance(validation: bool) -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
    // No `VALIDATION_INDIRECT_CALL`, because our own shaders write the draws, and checking each costs more than culling
    // saves. Direct3D needs it for the first vertex number; the cover stage's indirect draws leave that 0.
    descriptor.flags = if validation {
        InstanceFlags::VALIDATION
    } else {
        InstanceFlags::empty()
    };
    wgpu::Instance::new(descriptor)
}

fn adapters_of(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut adapters = pollster::block_on(instance.enumerate_adapters(Backends::all()));
    adapters.sort_by_key(|adapter| conv::rank(adapter.get_info().device_type));
    adapters
}

fn is_software(adapter: &wgpu::Adapter) -> bool {
    adapter.get_info().device_type == DeviceType::Cpu
}

/// Lists the adapters, the fastest first.
pub(crate) fn adapters(validation: bool) -> Vec<wgpu::Adapter> {
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let kept = &mut kept[usize::from(validation)];
    if let Some(instance) = kept {
        return adapters_of(instance);
    }
    let instance = new_instance(validation);
    let adapters = adapters_of(&instance);
    if !adapters.iter().all(is_software) {
        *kept = Some(instance);
    }
    adapters
}

/// Lists the adapters for a session on the one of this number. One on the processor is of an instance of its own,
/// because devices of one instance of Mesa's driver take turns drawing: they share its rasteriser.
pub(crate) fn adapters_for(number: u32, validation: bool) -> Vec<wgpu::Adapter> {
    let adapters = adapters(validation);
    let is_beside_a_gpu = !adapters.iter().all(is_software);
    if is_beside_a_gpu && adapters.get(number as usize).is_some_and(is_software) {
        return adapters_of(&new_instance(validation));
    }
    adapters
}

/// Name, API and driver.
pub(crate) fn describe(info: &wgpu::AdapterInfo) -> String {
    let driver = [info.driver.as_str(), info.driver_info.as_str()].join(" ");
    match driver.trim() {
        "" => format!("{} by {}", info.name, info.backend),
        driver => format!("{} by {}, {driver}", info.name, info.backend),
    }
}

/// Returns the largest resolution, and the hemicubes of a call that keep submissions following one another.
pub(crate) fn sizes(adapter: &wgpu::Adapter) -> (u32, usize) {
    let edge = adapter.limits().max_texture_dimension_2d;
    let at_once = Draw::Raster.at_once(adapter.get_info().device_type == DeviceType::Cpu);
    (
        RESOLUTIONS.end().min(&(edge / 3)) / 16 * 16,
        session::preferred_rows(at_once.batch),
    )
}

impl Device {
    pub(crate) fn open(adapter: &wgpu::Adapter, options: Options) -> Result<Self, BackendError> {
        let info = adapter.get_info();
        let missing = |what: &str| {
            BackendError::Unsupported(format!(
                "`{}` lacks {what}; take another device or the CPU",
                describe(&info)
            ))
        };
        let downlevel = wgpu::DownlevelFlags::COMPUTE_SHADERS
            | wgpu::DownlevelFlags::FRAGMENT_WRITABLE_STORAGE
            | wgpu::DownlevelFlags::INDIRECT_EXECUTION
            | wgpu::DownlevelFlags::VERTEX_STORAGE
            | wgpu::DownlevelFlags::READ_ONLY_DEPTH_STENCIL;
        let lacks = downlevel - adapter.get_downlevel_capabilities().flags;
        if !lacks.is_empty() {
            return Err(missing(&format!("{lacks:?}")));
        }
        let has = adapter.features();
        let counts_draws = !options.fixed_draws && has.contains(Features::MULTI_DRAW_INDIRECT_COUNT);
        let mut features = Features::empty();
        features.set(Features::MULTI_DRAW_INDIRECT_COUNT, counts_draws);
        features.set(Features::TIMESTAMP_QUERY, options.timing);
        if !has.contains(features) {
            return Err(missing("timestamps, which `timing=on` takes"));
        }
        let allowed = adapter.limits();
        let of_stage = OfStage {
            threads: allowed.max_compute_invocations_per_workgroup,
            shared_bytes: allowed.max_compute_workgroup_storage_size,
            storage_buffers: allowed.max_storage_buffers_per_shader_stage,
        };
        options.draw.check(&describe(&info), of_stage)?;
        let (raw, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("hemicube"),
            required_features: features,
            required_limits: allowed.clone(),
            ..Default::default()
        }))
        .map_err(|error| BackendError::Unsupported(format!("`{}` does not open: {error}", describe(&info))))?;
        let faults = Arc::new(Faults::default());
        let noted = Arc::clone(&faults);
        raw.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut first = noted.first.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| conv::error(&error));
        }));
        let noted = Arc::clone(&faults);
        raw.set_device_lost_callback(move |reason, message| {
            // The first reason is the cause, if it comes twice.
            let _ = noted.lost.set(format!("{reason:?}: {message}"));
        });
        let is_software = info.device_type == DeviceType::Cpu;
        let at_once = options.draw.at_once(is_software);
        let batch = options.batch.unwrap_or(at_once.batch);
        let memory = if is_software { SOFTWARE_MEMORY } else { u64::MAX };
        Ok(Self {
            raw,
            queue,
            limits: Limits {
                storage_range: allowed.max_storage_buffer_binding_size.min(allowed.max_buffer_size),
                memory: options.memory.unwrap_or(memory),
                layers: allowed.max_texture_array_layers,
                image_edge: allowed.max_texture_dimension_2d,
                copies_depths: is_software,
                edges: options.edges,
                draw: options.draw,
                group: options.group.unwrap_or(at_once.group).min(batch),
                batch,
                tile_groups: at_once.tile_groups,
                tiles_each: at_once.tiles_each,
            },
            is_software,
            counts_draws,
            faults,
        })
    }

    /// Returns the hemicubes of a call that keep submissions following one another.
    pub(crate) fn preferred_rows(&self) -> usize {
        session::preferred_rows(self.limits.batch)
    }

    /// Returns the longest range of a storage buffer, in bytes.
    pub(crate) fn storage_range(&self) -> u64 {
        self.limits.storage_range
    }

    /// Returns the limits at a resolution.
    pub(crate) fn limits_for(&self, resolution: u32) -> Limits {
        // wgpu copies rows of multiples of 256 bytes only; the copy has no gaps between rows.
        let whole_rows = (4 * resolution).is_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        Limits {
            copies_depths: self.limits.copies_depths && whole_rows,
            ..self.limits
        }
    }

    /// Fails for errors since the last call.
    pub(crate) fn check(&self) -> Result<(), BackendError> {
        if let Some(reason) = self.faults.lost.get() {
            return Err(BackendError::DeviceLost(format!(
                "{reason}; what is stored is kept: run again"
            )));
        }
        let mut first = self.faults.first.lock().unwrap_or_else(PoisonError::into_inner);
        first.take().map_or(Ok(()), Err)
    }

    /// Waits until a submission is done; callbacks of mapped buffers have then run.
    pub(crate) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), BackendError> {
        let waited = self.raw.poll(wgpu::PollType::Wait {
            submission_index: Some(submission),
            timeout: None,
        });
        self.check()?;
        waited
            .map(|_| ())
            .map_err(|error| BackendError::Internal(format!("waiting for the device: {error}")))
    }
}

/// Makes pipelines of the shared stages.
pub(crate) struct Compiler<'a> {
    device: &'a wgpu::Device,
    pub(crate) view_layout: &'a BindGroupLayout,
    /// By WGSL file.
    modules: HashMap<&'static str, ShaderModule>,
    /// Text of the shaders, and what is put in its place.
    fault: Option<(String, String)>,
}

impl<'a> Compiler<'a> {
    pub(crate) fn new(device: &'a Device, view_layout: &'a BindGroupLayout, fault: Option<(String, String)>) -> Self {
        Self {
            device: &device.raw,
            view_layout,
            modules: HashMap::new(),
            fault,
        }
    }

    /// The module of a stage's file.
    pub(crate) fn module(&mut self, stage: &Stage) -> ShaderModule {
        let compile = || {
            let text = match &self.fault {
                Some((from, to)) => stage.wgsl.replace(from, to).into(),
                None => stage.wgsl.into(),
            };
            self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(stage.file),
                source: wgpu::ShaderSource::Wgsl(text),
            })
        };
        self.modules.entry(stage.file).or_insert_with(compile).clone()
    }

    /// Makes the layout of group 1 of stages run together.
    pub(crate) fn layout(&self, stages: &[&Stage]) -> BindGroupLayout {
        self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &conv::layout(stages),
        })
    }

    /// Makes the layout of a pipeline with the view and that group 1.
    pub(crate) fn pipeline_layout(&self, group: &BindGroupLayout) -> PipelineLayout {
        self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(self.view_layout), Some(group)],
            immediate_size: 0,
        })
    }

    /// A compute pipeline, and the layout of its group 1.
    pub(crate) fn compute(&mut self, stage: &Stage) -> (BindGroupLayout, ComputePipeline) {
        let module = self.module(stage);
        let group = self.layout(&[stage]);
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(stage.entry),
            layout: Some(&self.pipeline_layout(&group)),
            module: &module,
            entry_point: Some(stage.entry),
            compilation_options: compilation(),
            cache: None,
        });
        (group, pipeline)
    }

    /// Makes a drawing pipeline.
    pub(crate) fn draw(&self, descriptor: &wgpu::RenderPipelineDescriptor<'_>) -> RenderPipeline {
        self.device.create_render_pipeline(descriptor)
    }
}

/// Stages set their workgroup memory before reading it.
pub(crate) fn compilation() -> PipelineCompilationOptions<'static> {
    PipelineCompilationOptions {
        zero_initialize_workgroup_memory: false,
        ..Default::default()
    }
}
