//! An instance, a device with its one queue, and memory on it. The loader is opened at run time.

use crate::conv;
use ash::{Entry, vk};
use hemicube_contract::backend::BackendError;
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex, PoisonError};

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages of the validation layer.
type Messages = Arc<Mutex<Vec<String>>>;

/// A device and its properties.
type Found = (vk::PhysicalDevice, vk::PhysicalDeviceProperties);

struct Instance {
    entry: Entry,
    raw: ash::Instance,
    debug: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Messages,
}

/// An open device and its queue.
pub(crate) struct Gpu {
    pub(crate) raw: ash::Device,
    pub(crate) queue: vk::Queue,
    pub(crate) family: u32,
    pub(crate) name: String,
    pub(crate) is_software: bool,
    pub(crate) limits: vk::PhysicalDeviceLimits,
    /// Nanoseconds a tick, and the number of valid bits of a tick.
    pub(crate) clock: (f64, u32),
    memory: vk::PhysicalDeviceMemoryProperties,
    instance: Arc<Instance>,
}

unsafe extern "system" fn note(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    messages: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data, and `messages` is what `Instance::new` gave, which outlives the messenger.
    let (data, messages) = unsafe { (&*data, &*messages.cast::<Mutex<Vec<String>>>()) };
    // SAFETY: null or a C string, says the specification.
    let text = unsafe { data.message_as_c_str() };
    let text = text.map_or_else(String::new, |t| t.to_string_lossy().into_owned());
    messages.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    vk::FALSE
}

impl Instance {
    fn new(validation: bool) -> Result<Self, BackendError> {
        // SAFETY: the system's Vulkan loader, whose initialisation is what every Vulkan program runs.
        let entry = unsafe { Entry::load() }.map_err(|error| {
            BackendError::Unsupported(format!(
                "no Vulkan loader: {error}; install one (Debian: libvulkan1 and mesa-vulkan-drivers)"
            ))
        })?;
        let failed = |r| conv::error("a Vulkan instance", r);
        // SAFETY: nothing is passed that could dangle.
        let version = unsafe { entry.try_enumerate_instance_version() }.map_err(failed)?;
        if version.unwrap_or(vk::API_VERSION_1_0) < vk::API_VERSION_1_3 {
            return Err(BackendError::Unsupported(
                "the Vulkan loader is older than 1.3; update it".to_owned(),
            ));
        }
        let application = vk::ApplicationInfo::default()
            .application_name(c"hemicube")
            .api_version(vk::API_VERSION_1_3);
        let (mut layers, mut extensions) = (Vec::new(), Vec::new());
        if validation {
            // SAFETY: as above.
            let found = unsafe { entry.enumerate_instance_layer_properties() }.map_err(failed)?;
            if !found.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION)) {
                return Err(BackendError::Unsupported(
                    "`validation=on` needs the layer VK_LAYER_KHRONOS_validation (Debian: vulkan-validationlayers)"
                        .to_owned(),
                ));
            }
            layers.push(VALIDATION.as_ptr());
            extensions.push(ash::ext::debug_utils::NAME.as_ptr());
        }
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let mut create = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validation {
            create = create.push_next(&mut features);
        }
        // SAFETY: all that `create` points to lives until the call returns.
        let raw = unsafe { entry.create_instance(&create, None) }.map_err(failed)?;
        let messages = Messages::default();
        let mut instance = Self {
            entry,
            raw,
            debug: None,
            messages,
        };
        if validation {
            let utils = ash::ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(
                    vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
                )
                // No performance advice: images keep the general layout on purpose.
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                .pfn_user_callback(Some(note))
                .user_data(Arc::as_ptr(&instance.messages).cast_mut().cast());
            // SAFETY: the messages outlive the messenger: `drop` destroys it first.
            let messenger = unsafe { utils.create_debug_utils_messenger(&create, None) }.map_err(failed)?;
            instance.debug = Some((utils, messenger));
        }
        Ok(instance)
    }

    /// Lists the usable devices, GPUs first, in the driver's order within a kind; and the reasons against the others.
    fn usable(&self) -> Result<(Vec<Found>, Vec<String>), BackendError> {
        // SAFETY: the instance is alive.
        let found = unsafe { self.raw.enumerate_physical_devices() }.map_err(|r| conv::error("Vulkan's devices", r))?;
        let mut found: Vec<_> = found
            .into_iter()
            // SAFETY: a device of this instance.
            .map(|d| (d, unsafe { self.raw.get_physical_device_properties(d) }))
            .collect();
        found.sort_by_key(|(_, p)| match p.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => 0,
            vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
            vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
            vk::PhysicalDeviceType::CPU => 4,
            _ => 3,
        });
        let mut refused = Vec::new();
        found.retain(|(device, properties)| match self.refuses(*device, properties) {
            None => true,
            Some(reason) => {
                refused.push(format!("`{}`: {reason}", name_of(properties)));
                false
            }
        });
        Ok((found, refused))
    }

    /// Names the first thing a device lacks.
    fn refuses(&self, device: vk::PhysicalDevice, properties: &vk::PhysicalDeviceProperties) -> Option<String> {
        if properties.api_version < vk::API_VERSION_1_3 {
            return Some(format!(
                "Vulkan {}.{} where 1.3 is needed",
                vk::api_version_major(properties.api_version),
                vk::api_version_minor(properties.api_version)
            ));
        }
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut features = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut v12)
            .push_next(&mut v13);
        // SAFETY: a device of this instance, of a version that knows these structures.
        unsafe { self.raw.get_physical_device_features2(device, &mut features) };
        let core = features.features;
        let wanted = [
            ("multiDrawIndirect", core.multi_draw_indirect),
            ("fragmentStoresAndAtomics", core.fragment_stores_and_atomics),
            ("drawIndirectCount", v12.draw_indirect_count),
            ("dynamicRendering", v13.dynamic_rendering),
            ("synchronization2", v13.synchronization2),
        ];
        if let Some((name, _)) = wanted.iter().find(|(_, has)| *has == vk::FALSE) {
            return Some(format!("the feature {name} is missing"));
        }
        let formats = [
            (
                vk::Format::R32_UINT,
                vk::FormatFeatureFlags::COLOR_ATTACHMENT | vk::FormatFeatureFlags::SAMPLED_IMAGE,
            ),
            (
                vk::Format::D32_SFLOAT,
                vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT | vk::FormatFeatureFlags::SAMPLED_IMAGE,
            ),
        ];
        for (format, uses) in formats {
            // SAFETY: a device of this instance.
            let found = unsafe { self.raw.get_physical_device_format_properties(device, format) };
            if !found.optimal_tiling_features.contains(uses) {
                return Some(format!("images of format {format:?} cannot be drawn to and read"));
            }
        }
        self.family(device)
            .is_none()
            .then(|| "no queue both draws and computes".to_owned())
    }

    fn family(&self, device: vk::PhysicalDevice) -> Option<(u32, u32)> {
        // SAFETY: a device of this instance.
        let families = unsafe { self.raw.get_physical_device_queue_family_properties(device) };
        let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        (0..)
            .zip(families)
            .find(|(_, f)| f.queue_flags.contains(both))
            .map(|(i, f)| (i, f.timestamp_valid_bits))
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices are destroyed before their instance (`Gpu` holds it), and nobody else has the messenger.
        unsafe {
            if let Some((utils, messenger)) = self.debug.take() {
                utils.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

/// An instance kept for the life of the process on a machine with a GPU: a driver may take what other libraries of the
/// process hold with it when an instance is destroyed (NVIDIA's 580 ends the displays of EGL).
static KEPT: Mutex<Option<Arc<Instance>>> = Mutex::new(None);

fn is_software(properties: &vk::PhysicalDeviceProperties) -> bool {
    properties.device_type == vk::PhysicalDeviceType::CPU
}

/// The kept instance, or another, which is kept if it has a GPU.
fn instance() -> Result<Arc<Instance>, BackendError> {
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(instance) = &*kept {
        return Ok(Arc::clone(instance));
    }
    let instance = Arc::new(Instance::new(false)?);
    if !instance.usable()?.0.iter().all(|(_, p)| is_software(p)) {
        *kept = Some(Arc::clone(&instance));
    }
    Ok(instance)
}

/// Lists the usable devices.
pub(crate) fn devices() -> Result<Vec<(String, vk::PhysicalDeviceType)>, BackendError> {
    let (usable, _) = instance()?.usable()?;
    Ok(usable.iter().map(|(_, p)| (name_of(p), p.device_type)).collect())
}

fn name_of(properties: &vk::PhysicalDeviceProperties) -> String {
    properties
        .device_name_as_c_str()
        .map_or_else(|_| "unnamed".to_owned(), |n| n.to_string_lossy().into_owned())
}

impl Gpu {
    pub(crate) fn open(index: u32, validation: bool) -> Result<Arc<Self>, BackendError> {
        // The messages of validation are of one session.
        let mut instance = if validation {
            Arc::new(Instance::new(true)?)
        } else {
            instance()?
        };
        let (mut usable, refused) = instance.usable()?;
        if !validation && usable.get(index as usize).is_some_and(|(_, p)| is_software(p)) {
            // Devices of one instance of Mesa's driver take turns drawing: they share its rasteriser.
            instance = Arc::new(Instance::new(false)?);
            (usable, _) = instance.usable()?;
        }
        let Some((device, properties)) = usable.get(index as usize).copied() else {
            let mut text = match usable.len() {
                0 => "no Vulkan device; install a driver (Debian: mesa-vulkan-drivers)".to_owned(),
                n => format!("device {index} of {n} Vulkan devices; they are numbered from 0"),
            };
            for reason in refused {
                text += "; ";
                text += &reason;
            }
            return Err(BackendError::Unsupported(text));
        };
        let name = name_of(&properties);
        let Some((family, bits)) = instance.family(device) else {
            return Err(BackendError::Unsupported(format!(
                "`{name}` has no queue that draws and computes"
            )));
        };
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(family)
            .queue_priorities(&[1.0])];
        let core = vk::PhysicalDeviceFeatures::default()
            .multi_draw_indirect(true)
            .fragment_stores_and_atomics(true);
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default().draw_indirect_count(true);
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default()
            .dynamic_rendering(true)
            .synchronization2(true);
        let create = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&core)
            .push_next(&mut v12)
            .push_next(&mut v13);
        // SAFETY: all that `create` points to lives until the call returns; the features were asked for.
        let raw = unsafe { instance.raw.create_device(device, &create, None) }
            .map_err(|r| conv::error(&format!("opening `{name}`"), r))?;
        Ok(Arc::new(Self {
            // SAFETY: the family and its first queue were created with the device.
            queue: unsafe { raw.get_device_queue(family, 0) },
            raw,
            family,
            is_software: is_software(&properties),
            limits: properties.limits,
            clock: (f64::from(properties.limits.timestamp_period), bits),
            // SAFETY: a device of this instance.
            memory: unsafe { instance.raw.get_physical_device_memory_properties(device) },
            name,
            instance,
        }))
    }

    /// Fails for messages of the validation layer since the last call.
    pub(crate) fn validated(&self) -> Result<(), BackendError> {
        let mut messages = self.instance.messages.lock().unwrap_or_else(PoisonError::into_inner);
        if messages.is_empty() {
            return Ok(());
        }
        let all = std::mem::take(&mut *messages);
        Err(BackendError::Internal(format!(
            "the validation layer says: {}",
            all.join("\n")
        )))
    }

    /// The memory to take: three quarters of the device's largest heap.
    pub(crate) fn memory(&self) -> u64 {
        let heaps = self.memory.memory_heaps_as_slice();
        let own = heaps
            .iter()
            .filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .map(|h| h.size)
            .max();
        own.unwrap_or(0) / 4 * 3
    }

    fn memory_type(&self, allowed: u32, wanted: &[vk::MemoryPropertyFlags]) -> Option<(u32, vk::MemoryPropertyFlags)> {
        let types = self.memory.memory_types_as_slice();
        wanted.iter().find_map(|&flags| {
            (0..)
                .zip(types)
                .find(|(i, t)| allowed >> i & 1 != 0 && t.property_flags.contains(flags))
                .map(|(i, t)| (i, t.property_flags))
        })
    }

    fn allocate(
        &self,
        what: &str,
        needs: vk::MemoryRequirements,
        wanted: &[vk::MemoryPropertyFlags],
    ) -> Result<(vk::DeviceMemory, vk::MemoryPropertyFlags), BackendError> {
        let Some((index, flags)) = self.memory_type(needs.memory_type_bits, wanted) else {
            return Err(BackendError::Unsupported(format!(
                "`{}` has no memory for {what}; take another device",
                self.name
            )));
        };
        let create = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(index);
        // SAFETY: the type is one of the device's.
        let memory = unsafe { self.raw.allocate_memory(&create, None) }
            .map_err(|r| conv::error(&format!("{} bytes for {what}", needs.size), r))?;
        Ok((memory, flags))
    }

    /// Runs some commands and waits for them.
    pub(crate) fn run_once(&self, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), BackendError> {
        let failed = |r| conv::error("commands that run once", r);
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(self.family)
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: everything is of this device, and is destroyed after the queue is idle.
        unsafe {
            let pool = self.raw.create_command_pool(&pool, None).map_err(failed)?;
            let run = || -> Result<(), vk::Result> {
                let allocate = vk::CommandBufferAllocateInfo::default()
                    .command_pool(pool)
                    .command_buffer_count(1);
                let commands = self.raw.allocate_command_buffers(&allocate)?[0];
                let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
                self.raw.begin_command_buffer(commands, &begin)?;
                record(commands);
                self.raw.end_command_buffer(commands)?;
                let infos = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
                let submit = [vk::SubmitInfo2::default().command_buffer_infos(&infos)];
                self.raw.queue_submit2(self.queue, &submit, vk::Fence::null())?;
                self.raw.queue_wait_idle(self.queue)
            };
            let done = run();
            self.raw.destroy_command_pool(pool, None);
            done.map_err(failed)
        }
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // SAFETY: everything made of the device holds it, so nothing is left.
        unsafe { self.raw.destroy_device(None) };
    }
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gpu").field("name", &self.name).finish_non_exhaustive()
    }
}

/// The memory of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// The device's own memory.
    Device,
    /// Written by the host, read by the device.
    Up,
    /// Written by the device, read by the host.
    Down,
}

/// A buffer with memory of its own.
#[derive(Debug)]
pub(crate) struct Buffer {
    gpu: Arc<Gpu>,
    pub(crate) raw: vk::Buffer,
    memory: vk::DeviceMemory,
    pub(crate) bytes: u64,
    /// The host's mapping.
    mapped: Option<*mut u32>,
    coherent: bool,
}

// SAFETY: the mapped memory belongs to this buffer alone and has no thread of its own.
unsafe impl Send for Buffer {}

impl Buffer {
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        what: &str,
        bytes: u64,
        place: Place,
        usage: vk::BufferUsageFlags,
    ) -> Result<Self, BackendError> {
        use vk::MemoryPropertyFlags as M;
        let visible = M::HOST_VISIBLE | M::HOST_COHERENT;
        let wanted = match place {
            Place::Device => vec![M::DEVICE_LOCAL, M::empty()],
            Place::Up => vec![visible],
            Place::Down => vec![visible | M::HOST_CACHED, M::HOST_VISIBLE | M::HOST_CACHED, visible],
        };
        let create = vk::BufferCreateInfo::default().size(bytes.max(4)).usage(usage);
        // SAFETY: a buffer of this device, bound to memory of its needs before anyone uses it.
        unsafe {
            let raw = gpu.raw.create_buffer(&create, None).map_err(|r| conv::error(what, r))?;
            let needs = gpu.raw.get_buffer_memory_requirements(raw);
            let (memory, flags) = match gpu.allocate(what, needs, &wanted) {
                Ok(allocated) => allocated,
                Err(error) => {
                    gpu.raw.destroy_buffer(raw, None);
                    return Err(error);
                }
            };
            let mut buffer = Self {
                gpu: Arc::clone(gpu),
                raw,
                memory,
                bytes: bytes.max(4),
                mapped: None,
                coherent: flags.contains(M::HOST_COHERENT),
            };
            gpu.raw
                .bind_buffer_memory(raw, memory, 0)
                .map_err(|r| conv::error(what, r))?;
            if flags.contains(M::HOST_VISIBLE) {
                let at = gpu
                    .raw
                    .map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())
                    .map_err(|r| conv::error(what, r))?;
                buffer.mapped = Some(at.cast());
            }
            Ok(buffer)
        }
    }

    /// Writes words, through another buffer if the host cannot see this one. The device must not be using it.
    pub(crate) fn write(&self, at: usize, words: &[u32]) -> Result<(), BackendError> {
        assert!(
            (at + words.len()) as u64 * 4 <= self.bytes,
            "written past a buffer's end"
        );
        if words.is_empty() {
            return Ok(());
        }
        if let Some(mapped) = self.mapped {
            // SAFETY: within the mapping, as asserted; the caller says that the device does not use it.
            unsafe { std::ptr::copy_nonoverlapping(words.as_ptr(), mapped.add(at), words.len()) };
            if !self.coherent {
                let range = [self.whole()];
                // SAFETY: the memory is mapped.
                unsafe { self.gpu.raw.flush_mapped_memory_ranges(&range) }.map_err(|r| conv::error("flushing", r))?;
            }
            return Ok(());
        }
        let bytes = words.len() as u64 * 4;
        let stage = Self::new(
            &self.gpu,
            "a copy on its way",
            bytes,
            Place::Up,
            vk::BufferUsageFlags::TRANSFER_SRC,
        )?;
        stage.write(0, words)?;
        let region = [vk::BufferCopy {
            src_offset: 0,
            dst_offset: at as u64 * 4,
            size: bytes,
        }];
        self.gpu.run_once(|commands| {
            // SAFETY: both buffers live until the queue is idle again, and the region is in both.
            unsafe { self.gpu.raw.cmd_copy_buffer(commands, stage.raw, self.raw, &region) };
        })
    }

    /// Reads words written by the device, after it has finished and made them visible to the host.
    pub(crate) fn read(&self, at: usize, count: usize) -> Result<&[u32], BackendError> {
        assert!((at + count) as u64 * 4 <= self.bytes, "read past a buffer's end");
        let Some(mapped) = self.mapped else {
            return Err(BackendError::Internal(
                "a buffer to be read back is not mapped".to_owned(),
            ));
        };
        if !self.coherent {
            let range = [self.whole()];
            // SAFETY: the memory is mapped.
            unsafe { self.gpu.raw.invalidate_mapped_memory_ranges(&range) }
                .map_err(|r| conv::error("reading back", r))?;
        }
        // SAFETY: within the mapping, as asserted; any bits are words, and the device has finished with them.
        Ok(unsafe { std::slice::from_raw_parts(mapped.add(at), count) })
    }

    fn whole(&self) -> vk::MappedMemoryRange<'_> {
        vk::MappedMemoryRange::default()
            .memory(self.memory)
            .size(vk::WHOLE_SIZE)
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: owners wait for the device before they drop what it uses.
        unsafe {
            self.gpu.raw.destroy_buffer(self.raw, None);
            self.gpu.raw.free_memory(self.memory, None);
        }
    }
}

/// An image of layers, a view of all and one of each.
#[derive(Debug)]
pub(crate) struct Image {
    gpu: Arc<Gpu>,
    pub(crate) raw: vk::Image,
    memory: vk::DeviceMemory,
    pub(crate) all: vk::ImageView,
    pub(crate) layers: Vec<vk::ImageView>,
    pub(crate) aspect: vk::ImageAspectFlags,
}

impl Image {
    pub(crate) fn new(
        gpu: &Arc<Gpu>,
        what: &str,
        format: vk::Format,
        extent: vk::Extent2D,
        layers: u32,
        besides: vk::ImageUsageFlags,
    ) -> Result<Self, BackendError> {
        let is_depth = format == vk::Format::D32_SFLOAT;
        let (usage, aspect) = if is_depth {
            (
                vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
                vk::ImageAspectFlags::DEPTH,
            )
        } else {
            (vk::ImageUsageFlags::COLOR_ATTACHMENT, vk::ImageAspectFlags::COLOR)
        };
        let create = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(extent.into())
            .mip_levels(1)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage | besides | vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_SRC);
        let failed = |r| conv::error(what, r);
        // SAFETY: an image of this device, bound to memory of its needs before anyone uses it; `drop` destroys what is
        // there.
        unsafe {
            let raw = gpu.raw.create_image(&create, None).map_err(failed)?;
            let needs = gpu.raw.get_image_memory_requirements(raw);
            let own = [vk::MemoryPropertyFlags::DEVICE_LOCAL, vk::MemoryPropertyFlags::empty()];
            let memory = match gpu.allocate(what, needs, &own) {
                Ok((memory, _)) => memory,
                Err(error) => {
                    gpu.raw.destroy_image(raw, None);
                    return Err(error);
                }
            };
            let mut image = Self {
                gpu: Arc::clone(gpu),
                raw,
                memory,
                all: vk::ImageView::null(),
                layers: Vec::new(),
                aspect,
            };
            gpu.raw.bind_image_memory(raw, memory, 0).map_err(failed)?;
            let view = |kind, first, count| {
                let range = vk::ImageSubresourceRange::default()
                    .aspect_mask(aspect)
                    .level_count(1)
                    .base_array_layer(first)
                    .layer_count(count);
                let create = vk::ImageViewCreateInfo::default()
                    .image(raw)
                    .view_type(kind)
                    .format(format)
                    .subresource_range(range);
                gpu.raw.create_image_view(&create, None).map_err(failed)
            };
            image.all = view(vk::ImageViewType::TYPE_2D_ARRAY, 0, layers)?;
            for layer in 0..layers {
                image.layers.push(view(vk::ImageViewType::TYPE_2D, layer, 1)?);
            }
            Ok(image)
        }
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        // SAFETY: owners wait for the device before they drop what it uses.
        unsafe {
            for &view in self.layers.iter().chain([&self.all]) {
                self.gpu.raw.destroy_image_view(view, None);
            }
            self.gpu.raw.destroy_image(self.raw, None);
            self.gpu.raw.free_memory(self.memory, None);
        }
    }
}
