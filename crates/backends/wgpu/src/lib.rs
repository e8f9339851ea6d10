//! Hemicubes rendered and reduced through wgpu: Vulkan, Metal or Direct3D 12, with one source and no `unsafe`.
//!
//! The stages are those of [`hemicube_shaders`], in WGSL. wgpu does by itself what the GL and Vulkan backends do by
//! hand: barriers between stages, memory, and checks of all reads and writes of a shader.
//!
//! No occlusion queries, because wgpu has no conditional drawing and hands out results only through a buffer: a round
//! trip to the host for each hemicube. That takes 18 ms of processor time on Mesa's software driver for a city of 144
//! 000 triangles at N = 256. Finding hidden chunks on the device, against a pyramid of depths, takes 10 ms.
//!
//! Options, `key=value,key=value`:
//!
//! | key | value |
//! |---|---|
//! | `cull` | `auto` (default), `off`, `frustum` or `occlusion`; rows are the same with each |
//! | `edges` | `exact` (default) or `driver`: the judge of pixels near edges, see docs/dev/gpu.md |
//! | `draw` | `raster` (default), `compute` (compute shaders alone, with exact edges) or `auto` (the faster of them) |
//! | `batch` | hemicubes of a submission |
//! | `group` | hemicubes side by side in the stages |
//! | `memory` | bytes to take on the device |
//! | `timing` | `on`: measure the time of each stage |
//! | `counts` | `off`: do without draw counts from the device, as on Metal |
//! | `validation` | `on`: the driver's validation layer, if it is installed |

#![forbid(unsafe_code)]

mod conv;
mod cull;
mod device;
mod options;
mod rays;
mod reduce;
mod render;
mod upload;

use cull::Policy;
use device::{Compiler, Device};
use hemicube_abi::{Log, Plugin};
use hemicube_contract::backend::{
    BackendError, BackendInfo, Counters, Culling, Geometry, Hemicube, HemicubeBackend, Pass, Rays, RenderSettings,
    StageTimes,
};
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;
use hemicube_shaders::output::{self, unculled_triangles};
use hemicube_shaders::pass::{draws, first_depths};
use hemicube_shaders::probe::{self, Probe};
use hemicube_shaders::session::{self, BY_TILES, CAPABILITIES, VERSION, not_loaded, preferred_rows};
use hemicube_shaders::stage::binding as b;
use hemicube_shaders::view::{FIRST_STAMP, pass_views, submission_views};
use hemicube_shaders::{Cull, Draw, Goal, Plan, Recording, Upload};
use options::Options;
use reduce::{FirstDepths, Side, Stages};
use render::{Group, Recorder, Scene, view_bytes};
use std::ffi::CStr;
use std::sync::Arc;
use upload::Store;
use wgpu::{Adapter, BindGroupLayout};

const NAME: &str = "wgpu";
/// The backend's plugin.
#[derive(Debug)]
pub struct Wgpu;

impl Plugin for Wgpu {
    const NAME: &'static CStr = c"wgpu";
    const VERSION: &'static CStr = VERSION;
    type Session = Session;

    fn devices() -> Result<Vec<hemicube_abi::Device>, BackendError> {
        devices()
    }

    fn open(device: u32, options: &str, _: Log) -> Result<Session, BackendError> {
        open(device, options)
    }
}

hemicube_abi::export_backend!(Wgpu);

/// The devices there are, the fastest kind first.
///
/// # Errors
/// None at present: a system without drivers has no devices.
pub fn devices() -> Result<Vec<hemicube_abi::Device>, BackendError> {
    let describe = |adapter: &Adapter| {
        let info = adapter.get_info();
        let (max_resolution, preferred_rows) = device::sizes(adapter);
        hemicube_abi::Device {
            name: device::describe(&info),
            kind: conv::device_kind(info.device_type),
            capabilities: CAPABILITIES,
            max_resolution,
            preferred_rows,
        }
    };
    Ok(device::adapters(false).iter().map(describe).collect())
}

/// Opens a session on a device by its number in [`devices`].
///
/// # Errors
/// When there is no such device or option, or the device does not open.
pub fn open(device: u32, options: &str) -> Result<Session, BackendError> {
    Session::open(device, options_of(device, options)?)
}

/// [`open`] with a part of the shaders' text replaced: a session that is wrong, for tests that must notice.
///
/// # Errors
/// See [`open`].
#[doc(hidden)]
pub fn open_with_fault(device: u32, options: &str, from: &str, to: &str) -> Result<Session, BackendError> {
    let fault = (!from.is_empty()).then(|| (from.to_owned(), to.to_owned()));
    Session::open_with(device, options_of(device, options)?, fault)
}

/// The options of a session, drawing as a probe of the device finds where `draw=auto` asks for it.
fn options_of(device: u32, options: &str) -> Result<Options, BackendError> {
    Options::parse(options, |given| {
        probe::probe(device, |draw| Session::open(device, Options { draw, ..given }))
    })
}

/// A session: a device of its own, and a scene on it.
pub struct Session {
    info: BackendInfo,
    options: Options,
    /// Its place in [`devices`].
    number: u32,
    adapter: Adapter,
    device: Device,
    view_layout: BindGroupLayout,
    stages: Stages,
    loaded: Option<Loaded>,
    /// See [`open_with_fault`].
    fault: Option<(String, String)>,
}

impl std::fmt::Debug for Session {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session")
            .field("info", &self.info)
            .finish_non_exhaustive()
    }
}

struct Loaded {
    geometry: Arc<Geometry>,
    settings: RenderSettings,
    upload: Arc<Upload>,
    plan: Plan,
    store: Store,
    sides: [Side; 2],
    policy: Policy,
    /// The number of the last group of hemicubes.
    stamp: u32,
    /// True if the device's marks of drawn chunks are all 1.
    all_marked: bool,
    times: StageTimes,
    /// First depths of passes, and their binding; made by the first.
    first_depths: Option<FirstDepths>,
    /// A copy of the item buffer for the host; made by the first.
    items_copy: Option<wgpu::Buffer>,
    /// What casts rays; made by the first.
    caster: Option<rays::Caster>,
}

impl Session {
    /// A session on an adapter of an instance of its own.
    fn open(number: u32, options: Options) -> Result<Self, BackendError> {
        Self::open_with(number, options, None)
    }

    fn open_with(number: u32, options: Options, fault: Option<(String, String)>) -> Result<Self, BackendError> {
        let adapters = device::adapters_for(number, options.validation);
        let Some(adapter) = adapters.get(number as usize) else {
            return Err(BackendError::Unsupported(match adapters.len() {
                0 => "wgpu finds no device; install a driver (Debian: libvulkan1 and mesa-vulkan-drivers)".to_owned(),
                n => format!("device {number} of {n} that wgpu finds; they are numbered from 0"),
            }));
        };
        Self::new(number, adapter.clone(), options, fault)
    }

    fn new(
        number: u32,
        adapter: Adapter,
        options: Options,
        fault: Option<(String, String)>,
    ) -> Result<Self, BackendError> {
        let device = Device::open(&adapter, options)?;
        let view_layout = device.raw.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("view"),
            entries: &[conv::view_layout()],
        });
        let mut compiler = Compiler::new(&device, &view_layout, fault.clone());
        let stages = Stages::new(&mut compiler, options.draw, options.edges);
        device.check()?;
        let info = BackendInfo {
            name: NAME.to_owned(),
            version: session::version(options.draw, options.edges),
            device: device::describe(&adapter.get_info()),
            capabilities: CAPABILITIES,
            preferred_rows: device.preferred_rows(),
        };
        Ok(Self {
            info,
            options,
            number,
            adapter,
            view_layout,
            stages,
            device,
            loaded: None,
            fault,
        })
    }

    /// Ends the device like a driver's reset: every later call reports a lost device. For tests.
    pub fn lose_device(&self) {
        self.device.raw.destroy();
        // The callback noting it runs while the device is polled.
        let _ = self.device.raw.poll(wgpu::PollType::Poll);
    }

    fn side(&self, store: &Store, plan: &Plan, upload: &Upload) -> Result<Side, BackendError> {
        let scene = Scene {
            device: &self.device,
            stages: &self.stages,
            store,
            plan,
            upload,
        };
        Side::new(&scene, &self.view_layout, self.options.timing)
    }

    /// Recovers from a failed call without waiting for its submissions. Their buffers are replaced; if that fails, too,
    /// the scene is no longer loaded.
    fn give_up(&mut self) {
        let Some(mut loaded) = self.loaded.take() else { return };
        let side = || self.side(&loaded.store, &loaded.plan, &loaded.upload);
        if let (Ok(first), Ok(second)) = (side(), side()) {
            loaded.sides = [first, second];
            // It may be on its way to the host.
            loaded.items_copy = None;
            loaded.caster = None;
            self.loaded = Some(loaded);
        }
    }
}

impl Loaded {
    /// Records a submission on a side. Returns its commands, how many hemicubes it has, and how it culls.
    fn record(
        &mut self,
        device: &Device,
        stages: &Stages,
        side: usize,
        hemicubes: &[Hemicube],
        goal: Goal,
    ) -> (wgpu::CommandEncoder, u32, Cull) {
        let cull = self.policy.now();
        if cull == Cull::Off && !self.all_marked {
            self.store.mark_all_drawn(device);
        }
        self.all_marked = cull == Cull::Off;
        let scene = Scene {
            device,
            stages,
            store: &self.store,
            plan: &self.plan,
            upload: &self.upload,
        };
        let recording = Recording {
            plan: &self.plan,
            upload: &self.upload,
            cull,
            goal,
        };
        let side = &mut self.sides[side];
        let encoder = device
            .raw
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut recorder = Recorder {
            encoder,
            view_group: &side.view_group,
            first_slot: 0,
            clock: side.clock.as_mut(),
        };
        let views = submission_views(&self.geometry, &self.plan, hemicubes, self.stamp);
        for members in hemicubes.chunks(self.plan.group as usize) {
            self.stamp = self.stamp.wrapping_add(1);
            let group = Group::of(&self.geometry, &self.upload, members);
            stages.record(&scene, &mut recorder, &side.groups, &recording, group);
            recorder.first_slot += group.layers;
        }
        let (encoder, slots) = (recorder.encoder, recorder.first_slot);
        // Written after the commands of earlier submissions and before those of the next one, which is this.
        let (stored, drawn) = view_bytes(&views);
        device.queue.write_buffer(&side.stored_views, 0, &stored);
        device.queue.write_buffer(&side.drawn_views, 0, &drawn);
        (encoder, slots, cull)
    }

    /// Two submissions are on the device at any time: when the first has counted its entries, they are asked for and
    /// the third is sent, on the side of the first; only then the entries are waited for.
    fn rows(
        &mut self,
        device: &Device,
        stages: &Stages,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
    ) -> Result<Counters, BackendError> {
        let covered = self.settings.covered;
        let batches: Vec<&[Hemicube]> = hemicubes.chunks(self.plan.batch as usize).collect();
        let mut counted = [None, None];
        let mut counters = Counters::default();
        for turn in 0..batches.len() + 2 {
            let side = turn % 2;
            let before = counted[side].take();
            let arriving = match before {
                None => None,
                Some((before, cull)) => {
                    let arriving = self.sides[side].ask_for_entries(device, &self.plan, before, &mut self.times)?;
                    Some((arriving, cull))
                }
            };
            if let Some(batch) = batches.get(turn) {
                let (encoder, slots, cull) = self.record(device, stages, side, batch, Goal::Rows);
                counted[side] = Some((self.sides[side].send(device, encoder, slots), cull));
            }
            if let Some((arriving, cull)) = arriving {
                let mut done = self.sides[side].finish(device, arriving, covered, &mut self.times, out)?;
                if cull == Cull::Off && self.plan.draw == Draw::Raster {
                    done.triangles_transformed = unculled_triangles(&self.upload, done.hemicubes);
                    done.triangles_drawn = done.triangles_transformed;
                }
                self.policy.learn(cull, done);
                counters += done;
            }
        }
        device.check()?;
        Ok(counters)
    }

    fn items(&mut self, device: &Device, stages: &Stages, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let (mut encoder, _, _) = self.record(device, stages, 0, std::slice::from_ref(hemicube), Goal::Items);
        // The counters and times of this submission are dropped.
        encoder.clear_buffer(self.store.buffer(b::TALLIES), 0, None);
        if let Some(clock) = &mut self.sides[0].clock {
            clock.add_to(&mut StageTimes::default(), &[]);
        }
        self.read_items(device, encoder)
    }

    fn pass(&mut self, device: &Device, stages: &Stages, pass: &Pass<'_>) -> Result<Items, BackendError> {
        let n = self.plan.resolution;
        let scene = Scene {
            device,
            stages,
            store: &self.store,
            plan: &self.plan,
            upload: &self.upload,
        };
        let depths = first_depths(pass, n).into_iter().map(f32::to_bits);
        let first = self.first_depths.get_or_insert_with(|| FirstDepths::new(&scene));
        device.queue.write_buffer(&first.depths, 0, &conv::to_bytes(depths));
        let mut encoder = device
            .raw
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        // No submission is under way.
        let side = &self.sides[0];
        let draws = draws(&self.upload, pass, n);
        scene.draw_pass(&mut encoder, &side.view_group, &first.bound, &draws);
        let (_, drawn) = view_bytes(&pass_views(&self.geometry, pass, n));
        device.queue.write_buffer(&side.drawn_views, 0, &drawn);
        self.read_items(device, encoder)
    }

    fn rays(
        &mut self,
        device: &Device,
        compiler: &mut Compiler<'_>,
        rays: &Rays<'_>,
    ) -> Result<Vec<u32>, BackendError> {
        let caster = match self.caster.take() {
            Some(caster) => caster,
            None => rays::Caster::new(device, compiler, &self.geometry)?,
        };
        // No submission is under way.
        let view = &self.sides[0].view_group;
        self.caster.insert(caster).cast(device, view, rays)
    }

    /// Sends commands, and reads the item buffer of the first layer after them.
    fn read_items(&mut self, device: &Device, mut encoder: wgpu::CommandEncoder) -> Result<Items, BackendError> {
        let n = self.plan.resolution;
        let pitch = (4 * n).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(pitch) * 3 * u64::from(n);
        let copy = self.items_copy.get_or_insert_with(|| {
            device.raw.create_buffer(&wgpu::BufferDescriptor {
                label: Some("an item buffer"),
                size: bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        encoder.copy_texture_to_buffer(
            self.store.items.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: copy,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(pitch),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d {
                width: n,
                height: 3 * n,
                depth_or_array_layers: 1,
            },
        );
        let submission = device.queue.submit([encoder.finish()]);
        let words = reduce::read(device, copy, bytes, submission)?;
        let rows = words.chunks_exact(pitch as usize / 4);
        let ids = rows.flat_map(|row| row[..n as usize].iter().copied());
        Ok(output::items(ids, self.upload.patch_count, n))
    }
}

impl HemicubeBackend for Session {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.device.check()?;
        settings.check()?;
        // The scene before makes room first.
        self.loaded = None;
        let upload = Upload::of(geometry, self.options.draw)?;
        let plan = Plan::new(&upload, settings, self.device.limits_for(settings.resolution))?;
        let store = Store::new(&self.device, geometry, &upload, &plan)?;
        let sides = [self.side(&store, &plan, &upload)?, self.side(&store, &plan, &upload)?];
        let fixed = match settings.culling {
            Culling::Off => Some(Cull::Off),
            Culling::On if plan.draw == Draw::Compute => Some(Cull::Off),
            Culling::On => self.options.cull,
        };
        self.info.preferred_rows = preferred_rows(plan.batch);
        self.loaded = Some(Loaded {
            policy: Policy::new(fixed, &upload, &plan),
            geometry: Arc::clone(geometry),
            settings,
            upload,
            plan,
            store,
            sides,
            stamp: FIRST_STAMP,
            all_marked: false,
            times: StageTimes::default(),
            first_depths: None,
            items_copy: None,
            caster: None,
        });
        Ok(())
    }

    fn choices(&self) -> Vec<String> {
        let Some(loaded) = &self.loaded else {
            return Vec::new();
        };
        let Plan { group, batch, .. } = loaded.plan;
        let mut choices = vec![
            match loaded.plan.draw {
                Draw::Raster => loaded.policy.choice(),
                Draw::Compute => BY_TILES.to_owned(),
            },
            format!("{batch} hemicubes a submission, {group} side by side"),
        ];
        choices.extend(self.options.probe.iter().map(Probe::line));
        choices
    }

    fn stage_times(&self) -> StageTimes {
        self.loaded
            .as_ref()
            .map_or_else(StageTimes::default, |loaded| loaded.times)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        let loaded = self.loaded.as_ref().ok_or_else(not_loaded)?;
        // A device on the processor needs an instance of its own.
        let mut session = if self.device.is_software {
            Self::open(self.number, self.options)?
        } else {
            Self::new(self.number, self.adapter.clone(), self.options, None)?
        };
        session.load(&loaded.geometry, loaded.settings)?;
        Ok(Box::new(session))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        self.device.check()?;
        let loaded = self.loaded.as_mut().ok_or_else(not_loaded)?;
        session::check(&loaded.geometry, hemicubes)?;
        let done = loaded.rows(&self.device, &self.stages, hemicubes, out);
        if done.is_err() {
            self.give_up();
        }
        done
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        self.device.check()?;
        let loaded = self.loaded.as_mut().ok_or_else(not_loaded)?;
        session::check(&loaded.geometry, std::slice::from_ref(hemicube))?;
        let items = loaded.items(&self.device, &self.stages, hemicube);
        if items.is_err() {
            self.give_up();
        }
        items
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        self.device.check()?;
        let loaded = self.loaded.as_mut().ok_or_else(not_loaded)?;
        pass.check(loaded.plan.resolution)?;
        let items = loaded.pass(&self.device, &self.stages, pass);
        if items.is_err() {
            self.give_up();
        }
        items
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        self.device.check()?;
        let loaded = self.loaded.as_mut().ok_or_else(not_loaded)?;
        rays.check(loaded.geometry.patch_count)?;
        let mut compiler = Compiler::new(&self.device, &self.view_layout, self.fault.clone());
        let met = loaded.rays(&self.device, &mut compiler, rays);
        if met.is_err() {
            self.give_up();
        }
        met
    }
}
