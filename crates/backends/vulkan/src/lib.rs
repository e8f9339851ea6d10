//! A hemicube backend on Vulkan: culling, rendering and reduction on the GPU, several hemicubes a submission, two
//! submissions under way, nothing but rows read back.
//!
//! Opening a session loads Vulkan. Any device of version 1.3 with a queue for drawing and computing will do, software
//! included.
//!
//! Options, `key=value,key=value`:
//!
//! ```text
//! cull        auto | off | frustum | occlusion     rows are the same with each
//! draw        raster | compute | auto              compute shaders alone, with exact edges; auto: the faster
//! edges       exact | driver                       the judge of pixels near edges: docs/dev/gpu.md
//! timing      on | off                             fills `stage_times`, and slows down
//! validation  on | off                             with Vulkan's validation layer; its messages are errors
//! batch       hemicubes of a submission
//! group       hemicubes side by side in the stages
//! memory      bytes to take on the device
//! ```

mod conv;
mod cull;
mod device;
mod options;
mod rays;
mod reduce;
mod render;
mod upload;

use ash::vk;
use cull::Judge;
use device::{Buffer, Gpu, Place};
use hemicube_abi::{Device, Log, Plugin, export_backend};
use hemicube_contract::backend::{
    BackendError, BackendInfo, Counters, Geometry, Hemicube, HemicubeBackend, Pass, RESOLUTIONS, Rays, RenderSettings,
    StageTimes,
};
use hemicube_contract::face::{Items, pixel_count};
use hemicube_contract::row::RowBlock;
use hemicube_shaders::output::{self, HEADER_WORDS, append_rows, entry_words, unculled_triangles};
use hemicube_shaders::pass::{draws, first_depths};
use hemicube_shaders::probe::{self, Probe};
use hemicube_shaders::session::{self, BY_TILES, CAPABILITIES, VERSION, not_loaded, preferred_rows};
use hemicube_shaders::view::{FIRST_STAMP, pass_views, stands_on_emitter, submission_views};
use hemicube_shaders::{Cull, Draw, Goal, Limits, OfStage, Phase};
use options::Options;
use reduce::{MARKS, Stages, Work};
use std::ffi::CStr;
use std::sync::Arc;
use upload::{FRAMES, Scene};

export_backend!(Session);

impl Plugin for Session {
    const NAME: &'static CStr = c"vulkan";
    const VERSION: &'static CStr = VERSION;
    type Session = Self;

    fn devices() -> Result<Vec<Device>, BackendError> {
        devices()
    }

    fn open(device: u32, options: &str, _log: Log) -> Result<Self, BackendError> {
        open(device, options)
    }
}

/// Lists the usable devices, GPUs first.
///
/// # Errors
/// [`BackendError::Unsupported`] without Vulkan.
pub fn devices() -> Result<Vec<Device>, BackendError> {
    let found = device::devices()?.into_iter();
    Ok(found
        .map(|(name, kind)| Device {
            name,
            kind: conv::device_kind(kind),
            capabilities: CAPABILITIES,
            max_resolution: *RESOLUTIONS.end(),
            preferred_rows: preferred_rows(Draw::Raster.at_once(kind == vk::PhysicalDeviceType::CPU).batch),
        })
        .collect())
}

/// Opens a session on a device by its number in [`devices`].
///
/// # Errors
/// [`BackendError::InvalidArgument`] for an unknown option, [`BackendError::Unsupported`] for a missing or insufficient
/// device.
pub fn open(device: u32, options: &str) -> Result<Session, BackendError> {
    Session::new(device, options_of(device, options)?)
}

/// The options of a session, drawing as a probe of the device finds where `draw=auto` asks for it.
fn options_of(device: u32, options: &str) -> Result<Options, BackendError> {
    Options::parse(options, |given| {
        probe::probe(device, |draw| Session::new(device, Options { draw, ..given }))
    })
}

/// A session on a Vulkan device.
#[derive(Debug)]
pub struct Session {
    info: BackendInfo,
    device: u32,
    options: Options,
    loaded: Option<Loaded>,
    /// Why the session cannot be used any more.
    dead: Option<String>,
    gpu: Arc<Gpu>,
}

/// A loaded scene, and its submissions under way.
#[derive(Debug)]
struct Loaded {
    geometry: Arc<Geometry>,
    settings: RenderSettings,
    judge: Judge,
    stamp: u32,
    under_way: [Option<UnderWay>; FRAMES],
    times: StageTimes,
    sync: Sync,
    stages: Stages,
    scene: Scene,
    /// First depths of passes; made by the first.
    first_depths: Option<Buffer>,
    /// A copy of the item buffer for the host; made by the first.
    items_copy: Option<Buffer>,
    /// What casts rays; made by the first.
    caster: Option<rays::Caster>,
    gpu: Arc<Gpu>,
}

/// A submission not yet read back.
#[derive(Clone, Debug)]
struct UnderWay {
    slots: u32,
    cull: Cull,
    /// The phases of each group's timestamps.
    phases: Vec<Vec<Phase>>,
}

/// Command buffers, fences and timestamps, one of each a frame.
#[derive(Debug)]
struct Sync {
    gpu: Arc<Gpu>,
    pool: vk::CommandPool,
    commands: Vec<vk::CommandBuffer>,
    fences: Vec<vk::Fence>,
    marks: Vec<vk::QueryPool>,
}

impl Sync {
    fn new(gpu: &Arc<Gpu>, marks: Option<u32>) -> Result<Self, BackendError> {
        let failed = |r| conv::error("commands and fences", r);
        let mut sync = Self {
            gpu: Arc::clone(gpu),
            pool: vk::CommandPool::null(),
            commands: Vec::new(),
            fences: Vec::new(),
            marks: Vec::new(),
        };
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(gpu.family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: all of this device; `drop` destroys what was made, also when this ends early.
        unsafe {
            sync.pool = gpu.raw.create_command_pool(&pool, None).map_err(failed)?;
            #[allow(clippy::cast_possible_truncation, reason = "two frames")]
            let allocate = vk::CommandBufferAllocateInfo::default()
                .command_pool(sync.pool)
                .command_buffer_count(FRAMES as u32);
            sync.commands = gpu.raw.allocate_command_buffers(&allocate).map_err(failed)?;
            for _ in 0..FRAMES {
                let fence = gpu
                    .raw
                    .create_fence(&vk::FenceCreateInfo::default(), None)
                    .map_err(failed)?;
                sync.fences.push(fence);
                if let Some(count) = marks {
                    let create = vk::QueryPoolCreateInfo::default()
                        .query_type(vk::QueryType::TIMESTAMP)
                        .query_count(count);
                    sync.marks
                        .push(gpu.raw.create_query_pool(&create, None).map_err(failed)?);
                }
            }
        }
        Ok(sync)
    }
}

impl Drop for Sync {
    fn drop(&mut self) {
        // SAFETY: `Loaded` waits for the device before it drops this.
        unsafe {
            for &fence in &self.fences {
                self.gpu.raw.destroy_fence(fence, None);
            }
            for &marks in &self.marks {
                self.gpu.raw.destroy_query_pool(marks, None);
            }
            self.gpu.raw.destroy_command_pool(self.pool, None);
        }
    }
}

impl Drop for Loaded {
    fn drop(&mut self) {
        // SAFETY: the device is alive. Should it be lost, nothing is running on it either.
        let _ = unsafe { self.gpu.raw.device_wait_idle() };
    }
}

impl Session {
    fn new(device: u32, options: Options) -> Result<Self, BackendError> {
        let gpu = Gpu::open(device, options.validation)?;
        if options.timing && gpu.clock.1 == 0 {
            return Err(BackendError::Unsupported(format!(
                "`timing=on`: `{}` has no clock; leave the option out",
                gpu.name
            )));
        }
        let has = OfStage {
            threads: gpu.limits.max_compute_work_group_invocations,
            shared_bytes: gpu.limits.max_compute_shared_memory_size,
            storage_buffers: gpu.limits.max_per_stage_descriptor_storage_buffers,
        };
        options.draw.check(&gpu.name, has)?;
        let limits = limits(&gpu, options);
        Ok(Self {
            info: BackendInfo {
                name: Self::NAME.to_string_lossy().into_owned(),
                version: session::version(options.draw, options.edges),
                device: gpu.name.clone(),
                capabilities: CAPABILITIES,
                preferred_rows: preferred_rows(limits.batch),
            },
            device,
            options,
            loaded: None,
            dead: None,
            gpu,
        })
    }

    /// Remembers a fatal error, and adds the validation layer's messages.
    fn settle<T>(&mut self, result: Result<T, BackendError>) -> Result<T, BackendError> {
        let result = result.and_then(|value| self.gpu.validated().map(|()| value));
        if let Err(error) = &result {
            if conv::is_fatal(error) {
                self.dead = Some(error.to_string());
            }
            if let Some(loaded) = &mut self.loaded {
                loaded.give_up();
            }
        }
        result
    }

    fn alive(&self) -> Result<(), BackendError> {
        match &self.dead {
            None => Ok(()),
            Some(reason) => Err(BackendError::DeviceLost(format!(
                "this session ended earlier ({reason}); open another"
            ))),
        }
    }

    fn checked(&mut self, hemicubes: &[Hemicube]) -> Result<&mut Loaded, BackendError> {
        self.alive()?;
        let loaded = self.loaded.as_mut().ok_or_else(not_loaded)?;
        session::check(&loaded.geometry, hemicubes)?;
        Ok(loaded)
    }
}

/// The limits to plan by.
fn limits(gpu: &Gpu, options: Options) -> Limits {
    let at_once = options.draw.at_once(gpu.is_software);
    let group = options.group.unwrap_or(at_once.group);
    Limits {
        storage_range: u64::from(gpu.limits.max_storage_buffer_range),
        memory: options.memory.unwrap_or_else(|| gpu.memory()),
        layers: gpu.limits.max_image_array_layers,
        image_edge: gpu.limits.max_image_dimension2_d.min(gpu.limits.max_framebuffer_height),
        group,
        batch: options.batch.unwrap_or(at_once.batch).max(group),
        tile_groups: at_once.tile_groups,
        tiles_each: at_once.tiles_each,
        copies_depths: gpu.is_software,
        edges: options.edges,
        draw: options.draw,
    }
}

impl Loaded {
    fn new(
        gpu: &Arc<Gpu>,
        options: Options,
        geometry: &Arc<Geometry>,
        settings: RenderSettings,
    ) -> Result<Self, BackendError> {
        let scene = Scene::new(gpu, geometry, settings, limits(gpu, options))?;
        let stages = Stages::new(gpu, &scene)?;
        let marks = options
            .timing
            .then(|| scene.plan.batch.div_ceil(scene.plan.group) * MARKS);
        let (triangles, chunks) = (scene.upload.triangle_count(), scene.upload.chunks.len());
        // Tiles leave out what they do not see.
        let cull = (options.draw == Draw::Compute).then_some(Cull::Off);
        let judge = Judge::new(
            cull.or(options.cull),
            settings.culling,
            triangles,
            chunks,
            pixel_count(settings.resolution),
        );
        scene.clear(judge.cull)?;
        Ok(Self {
            geometry: Arc::clone(geometry),
            settings,
            judge,
            stamp: FIRST_STAMP,
            under_way: [const { None }; FRAMES],
            times: StageTimes::default(),
            sync: Sync::new(gpu, marks)?,
            stages,
            scene,
            first_depths: None,
            items_copy: None,
            caster: None,
            gpu: Arc::clone(gpu),
        })
    }

    /// Forgets the submissions under way, after an error.
    fn give_up(&mut self) {
        // SAFETY: the device is alive or lost; neither is hurt by waiting.
        let _ = unsafe { self.gpu.raw.device_wait_idle() };
        self.under_way = [const { None }; FRAMES];
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let mut counters = Counters::default();
        let mut next = 0;
        for batch in hemicubes.chunks(self.scene.plan.batch as usize) {
            counters += self.finish(next, out)?;
            self.submit(next, batch, Goal::Rows)?;
            next = (next + 1) % FRAMES;
        }
        for _ in 0..FRAMES {
            counters += self.finish(next, out)?;
            next = (next + 1) % FRAMES;
        }
        Ok(counters)
    }

    /// Submits hemicubes on a free frame.
    fn submit(&mut self, at: usize, hemicubes: &[Hemicube], goal: Goal) -> Result<(), BackendError> {
        let group = self.scene.plan.group;
        let views = submission_views(&self.geometry, &self.scene.plan, hemicubes, self.stamp);
        #[allow(clippy::cast_possible_truncation, reason = "at most a batch")]
        let slots = hemicubes.len() as u32;
        self.stamp += slots.div_ceil(group);
        let frame = &self.scene.frames[at];
        frame.views.write(0, views.as_flattened())?;
        let on_emitter = |h: &Hemicube| stands_on_emitter(&self.geometry, &self.scene.upload, h);
        let work = Work {
            slots,
            cull: self.judge.cull,
            goal,
            without_emitter: !hemicubes.iter().all(on_emitter),
            marks: self.sync.marks.get(at).copied(),
        };
        let device = &self.gpu.raw;
        let commands = self.sync.commands[at];
        let failed = |r| conv::error("submitting hemicubes", r);
        // SAFETY: the frame's last submission was waited for, so its commands, fence and marks are free.
        let phases = unsafe {
            let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(commands, &begin).map_err(failed)?;
            if let Some(marks) = work.marks {
                device.cmd_reset_query_pool(commands, marks, 0, self.scene.plan.batch.div_ceil(group) * MARKS);
            }
            let phases = self.stages.record(&self.scene, frame, commands, work);
            device.end_command_buffer(commands).map_err(failed)?;
            device.reset_fences(&[self.sync.fences[at]]).map_err(failed)?;
            let infos = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
            let submit = [vk::SubmitInfo2::default().command_buffer_infos(&infos)];
            device
                .queue_submit2(self.gpu.queue, &submit, self.sync.fences[at])
                .map_err(failed)?;
            phases
        };
        self.under_way[at] = Some(UnderWay {
            slots,
            cull: work.cull,
            phases,
        });
        Ok(())
    }

    /// Waits for a frame's submission, if there is one, and appends its rows.
    fn finish(&mut self, at: usize, out: &mut RowBlock) -> Result<Counters, BackendError> {
        if self.under_way[at].is_none() {
            return Ok(Counters::default());
        }
        self.wait(at)?;
        let Some(UnderWay { slots, cull, phases }) = self.under_way[at].take() else {
            return Ok(Counters::default());
        };
        let began = std::time::Instant::now();
        let buffer = &self.scene.frames[at].output;
        let headers = buffer.read(0, (slots * HEADER_WORDS) as usize)?;
        let words = entry_words(&self.scene.plan, headers, slots)?;
        let entries = buffer.read(self.scene.plan.output_entries() as usize, words)?;
        let mut counters = append_rows(headers, entries, slots, self.settings.covered, out);
        if cull == Cull::Off && self.scene.plan.draw == Draw::Raster {
            let all = unculled_triangles(&self.scene.upload, u64::from(slots));
            counters.triangles_drawn = all;
            counters.triangles_transformed = all;
        }
        self.judge.note(counters);
        if let Some(&marks) = self.sync.marks.get(at) {
            self.times.read_back += u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
            self.clock(marks, &phases)?;
        }
        Ok(counters)
    }

    fn wait(&self, at: usize) -> Result<(), BackendError> {
        // SAFETY: the fence was submitted.
        unsafe { self.gpu.raw.wait_for_fences(&[self.sync.fences[at]], true, u64::MAX) }
            .map_err(|r| conv::error("waiting for hemicubes", r))
    }

    /// Adds up a submission's timestamps.
    fn clock(&mut self, marks: vk::QueryPool, phases: &[Vec<Phase>]) -> Result<(), BackendError> {
        let (period, bits) = self.gpu.clock;
        let mask = if bits >= 64 { u64::MAX } else { (1 << bits) - 1 };
        let mut ticks = vec![0u64; phases.len() * MARKS as usize];
        let groups = (0u32..)
            .step_by(MARKS as usize)
            .zip(ticks.chunks_exact_mut(MARKS as usize));
        for ((first, ticks), phases) in groups.zip(phases) {
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            let ticks = &mut ticks[..=phases.len()];
            // SAFETY: the submission that wrote the timestamps of these phases is done.
            unsafe { self.gpu.raw.get_query_pool_results(marks, first, ticks, flags) }
                .map_err(|r| conv::error("reading the device's clock", r))?;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "nanoseconds of a submission"
        )]
        let nanoseconds = |from: u64, to: u64| ((to.wrapping_sub(from) & mask) as f64 * period) as u64;
        reduce::add_times(phases, &ticks, nanoseconds, &mut self.times);
        Ok(())
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        // Tiles keep no item buffer unless it is asked for. Rows clear what culling counted.
        let goal = match self.scene.plan.draw {
            Draw::Compute => Goal::Items,
            Draw::Raster => Goal::Rows,
        };
        self.submit(0, std::slice::from_ref(hemicube), goal)?;
        self.finish(0, &mut RowBlock::default())?;
        self.read_items()
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        let n = self.settings.resolution;
        let depths = match self.first_depths.take() {
            Some(depths) => depths,
            None => Buffer::new(
                &self.gpu,
                "the first depths of a pass",
                pixel_count(n) as u64 * 4,
                Place::Up,
                vk::BufferUsageFlags::TRANSFER_SRC,
            )?,
        };
        let depths = self.first_depths.insert(depths);
        let upload = &self.scene.upload;
        // No submission is under way.
        let frame = &self.scene.frames[0];
        frame
            .views
            .write(0, pass_views(&self.geometry, pass, n).as_flattened())?;
        let words: Vec<u32> = first_depths(pass, n).into_iter().map(f32::to_bits).collect();
        depths.write(0, &words)?;
        let draws = draws(upload, pass, n);
        self.gpu.run_once(|commands| {
            self.stages
                .record_pass(&self.scene, frame, commands, depths.raw, &draws);
        })?;
        self.read_items()
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let caster = match self.caster.take() {
            Some(caster) => caster,
            None => rays::Caster::new(&self.gpu, &self.geometry)?,
        };
        self.caster.insert(caster).cast(rays)
    }

    /// Reads the item buffer of the first layer.
    fn read_items(&mut self) -> Result<Items, BackendError> {
        let n = self.settings.resolution;
        let copy = match self.items_copy.take() {
            Some(copy) => copy,
            None => Buffer::new(
                &self.gpu,
                "a copy of the item buffer",
                pixel_count(n) as u64 * 4,
                Place::Down,
                vk::BufferUsageFlags::TRANSFER_DST,
            )?,
        };
        let copy = self.items_copy.insert(copy);
        let region = [vk::BufferImageCopy::default()
            .image_subresource(
                vk::ImageSubresourceLayers::default()
                    .aspect_mask(vk::ImageAspectFlags::COLOR)
                    .layer_count(1),
            )
            .image_extent(vk::Extent3D {
                width: n,
                height: 3 * n,
                depth: 1,
            })];
        self.gpu.run_once(|commands| {
            let barrier = |source: (vk::PipelineStageFlags2, vk::AccessFlags2), then: (_, _)| {
                let barrier = [vk::MemoryBarrier2 {
                    src_stage_mask: source.0,
                    src_access_mask: source.1,
                    dst_stage_mask: then.0,
                    dst_access_mask: then.1,
                    ..Default::default()
                }];
                let dependency = vk::DependencyInfo::default().memory_barriers(&barrier);
                // SAFETY: commands of this device that are being recorded.
                unsafe { self.gpu.raw.cmd_pipeline_barrier2(commands, &dependency) };
            };
            barrier(
                (
                    vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT | vk::PipelineStageFlags2::COMPUTE_SHADER,
                    vk::AccessFlags2::COLOR_ATTACHMENT_WRITE | vk::AccessFlags2::SHADER_STORAGE_WRITE,
                ),
                (vk::PipelineStageFlags2::COPY, vk::AccessFlags2::TRANSFER_READ),
            );
            // SAFETY: layer 0 of the image and the whole of the buffer, both alive until the queue is idle.
            unsafe {
                self.gpu.raw.cmd_copy_image_to_buffer(
                    commands,
                    self.scene.items.raw,
                    vk::ImageLayout::GENERAL,
                    copy.raw,
                    &region,
                );
            }
            barrier(
                (vk::PipelineStageFlags2::COPY, vk::AccessFlags2::TRANSFER_WRITE),
                (vk::PipelineStageFlags2::HOST, vk::AccessFlags2::HOST_READ),
            );
        })?;
        let ids = copy.read(0, pixel_count(n))?.iter().copied();
        Ok(output::items(ids, self.geometry.patch_count, n))
    }
}

impl HemicubeBackend for Session {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.alive()?;
        settings.check()?;
        // The scene before makes room first.
        self.loaded = None;
        let loaded = Loaded::new(&self.gpu, self.options, geometry, settings);
        let loaded = self.settle(loaded)?;
        self.info.preferred_rows = preferred_rows(loaded.scene.plan.batch);
        self.loaded = Some(loaded);
        Ok(())
    }

    fn choices(&self) -> Vec<String> {
        let how = |loaded: &Loaded| match loaded.scene.plan.draw {
            Draw::Raster => loaded.judge.line(),
            Draw::Compute => BY_TILES.to_owned(),
        };
        let probe = self.options.probe.iter().map(Probe::line);
        self.loaded.iter().map(how).chain(probe).collect()
    }

    fn stage_times(&self) -> StageTimes {
        self.loaded.as_ref().map_or_else(StageTimes::default, |l| l.times)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        self.alive()?;
        let loaded = self.loaded.as_ref().ok_or_else(not_loaded)?;
        let mut other = Self::new(self.device, self.options)?;
        other.load(&loaded.geometry, loaded.settings)?;
        Ok(Box::new(other))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let done = self.checked(hemicubes)?.rows(hemicubes, out);
        self.settle(done)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let done = self.checked(std::slice::from_ref(hemicube))?.items(hemicube);
        self.settle(done)
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        let loaded = self.checked(&[])?;
        pass.check(loaded.settings.resolution)?;
        let done = loaded.pass(pass);
        self.settle(done)
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let loaded = self.checked(&[])?;
        rays.check(loaded.geometry.patch_count)?;
        let done = loaded.rays(rays);
        self.settle(done)
    }
}
