//! Hemicubes rendered and reduced through wgpu: Vulkan, Metal or Direct3D 12, with one source and no `unsafe`.
//!
//! The stages are those of [`hemicube_shaders`], given to wgpu as WGSL. What the GL and Vulkan backends do by hand,
//! wgpu does here: barriers between stages, memory, and checks of all that a shader reads or writes. It has no
//! conditional drawing and hands out results of occlusion queries only through a buffer, which would take a round trip
//! to the host for each hemicube: 18 ms of processor time on Mesa's software driver for a city of 144 000 triangles at
//! N = 256, where finding what is hidden on the device, against a pyramid of depths, takes 10. So that is what is done.
//!
//! Options, `key=value,key=value`:
//!
//! | key | value |
//! |---|---|
//! | `cull` | `auto` (default), `off`, `frustum` or `occlusion`: what is not drawn because it cannot be seen |
//! | `edges` | `exact` (default) or `driver`: who says on which side of an edge a pixel lies, see docs/gpu.md |
//! | `batch` | hemicubes of a submission |
//! | `group` | hemicubes that go through the stages side by side |
//! | `memory` | MiB that may be taken on the device |
//! | `timing` | `on`: measure where the time goes |
//! | `counts` | `off`: do without draw counts from the device, as on Metal |
//! | `validation` | `on`: the driver's validation layer, where it is installed |

#![forbid(unsafe_code)]

mod conv;
mod cull;
mod device;
mod reduce;
mod render;
mod upload;

use cull::{Cull, Culling, Policy};
use device::{Compiler, Device, Wanted};
use hemicube_abi::{Log, Options, Plugin};
use hemicube_contract::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Culling as Asked, Geometry, Hemicube, HemicubeBackend,
    RenderSettings, StageTimes,
};
use hemicube_contract::face::{Items, pixel_count};
use hemicube_contract::row::RowBlock;
use hemicube_shaders::stage::binding as b;
use hemicube_shaders::view::FIRST_STAMP;
use hemicube_shaders::{Edges, Plan, Upload};
use reduce::{Reduction, Side};
use render::{Recorder, Rendering, Scene, Views};
use std::ffi::CStr;
use std::sync::Arc;
use upload::Store;
use wgpu::{Adapter, BindGroupLayout};

const NAME: &str = "wgpu";
/// The arithmetic of the shared shaders.
const VERSION: &str = "gpu-1";
/// The same with `edges=exact`, by which rows are others.
const EXACT_VERSION: &str = "gpu-1-exact";
const CAPABILITIES: Capabilities = Capabilities {
    covered: true,
    tiny_patches: true,
    items: true,
    lossless_culling: true,
};

/// This backend as a plugin.
#[derive(Debug)]
pub struct Wgpu;

impl Plugin for Wgpu {
    const NAME: &'static CStr = c"wgpu";
    const VERSION: &'static CStr = c"gpu-1";
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

/// Opens a session on the device with that place in [`devices`].
///
/// # Errors
/// When there is no such device or option, or the device does not open.
pub fn open(device: u32, options: &str) -> Result<Session, BackendError> {
    Session::open(device, Choice::parse(options)?)
}

/// What the options say.
#[derive(Clone, Copy, Debug, Default)]
struct Choice {
    wanted: Wanted,
    cull: Option<Cull>,
}

impl Choice {
    fn parse(text: &str) -> Result<Self, BackendError> {
        let mut options = Options::parse(text)?;
        let cull = match options.take("cull") {
            None | Some("auto") => None,
            Some("off") => Some(Cull::Nothing),
            Some("frustum") => Some(Cull::Outside),
            Some("occlusion") => Some(Cull::Occlusion),
            Some(other) => {
                return Err(BackendError::InvalidArgument(format!(
                    "option `cull` is `{other}`; it is `auto`, `off`, `frustum` or `occlusion`"
                )));
            }
        };
        let edges = match options.take("edges") {
            None => Edges::default(),
            Some(value) => Edges::parse(value).ok_or_else(|| {
                BackendError::InvalidArgument(format!("option `edges` is `{value}`; it is `driver` or `exact`"))
            })?,
        };
        let mut number = |key, most| match options.take(key).map(|value| (value, value.parse())) {
            None => Ok(None),
            Some((_, Ok(number))) if (1..=most).contains(&number) => Ok(Some(number)),
            Some((text, _)) => Err(BackendError::InvalidArgument(format!(
                "option `{key}` is `{text}`; it is a number from 1 to {most}"
            ))),
        };
        let (batch, group) = (number("batch", MOST_BATCH)?, number("group", MOST_BATCH)?);
        let memory = number("memory", u32::MAX)?.map(|mib| u64::from(mib) << 20);
        let mut switch = |key| options.take_switch(key);
        let wanted = Wanted {
            batch,
            group,
            memory,
            edges,
            timing: switch("timing")?.unwrap_or(false),
            validation: switch("validation")?.unwrap_or(false),
            fixed_draws: !switch("counts")?.unwrap_or(true),
        };
        options.finish()?;
        Ok(Self { wanted, cull })
    }
}

/// More hemicubes in a submission gain nothing on any device, and a driver may take it for hung.
const MOST_BATCH: u32 = 1024;

/// A session: a device of its own, and a scene on it.
pub struct Session {
    info: BackendInfo,
    choice: Choice,
    /// Its place in [`devices`].
    number: u32,
    adapter: Adapter,
    device: Device,
    view_layout: BindGroupLayout,
    culling: Culling,
    rendering: Rendering,
    reduction: Reduction,
    loaded: Option<Loaded>,
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
    /// True if the device's marks say that every chunk is drawn.
    all_marked: bool,
    times: StageTimes,
}

impl Session {
    /// A session on an adapter of an instance of its own.
    fn open(number: u32, choice: Choice) -> Result<Self, BackendError> {
        let adapters = device::adapters(choice.wanted.validation);
        let Some(adapter) = adapters.get(number as usize) else {
            return Err(BackendError::Unsupported(match adapters.len() {
                0 => "wgpu finds no device; install a driver (Debian: libvulkan1 and mesa-vulkan-drivers)".to_owned(),
                n => format!("device {number} of {n} that wgpu finds; they are numbered from 0"),
            }));
        };
        Self::new(number, adapter.clone(), choice)
    }

    fn new(number: u32, adapter: Adapter, choice: Choice) -> Result<Self, BackendError> {
        let device = Device::open(&adapter, choice.wanted)?;
        let view_layout = device.raw.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("view"),
            entries: &[conv::view_layout()],
        });
        let mut compiler = Compiler::new(&device, &view_layout);
        let culling = Culling::new(&mut compiler);
        let edges = choice.wanted.edges;
        let rendering = Rendering::new(&mut compiler, edges);
        let reduction = Reduction::new(&mut compiler, edges);
        device.check()?;
        let info = BackendInfo {
            name: NAME.to_owned(),
            version: match edges {
                Edges::Driver => VERSION,
                Edges::Exact => EXACT_VERSION,
            }
            .to_owned(),
            device: device::describe(&adapter.get_info()),
            capabilities: CAPABILITIES,
            preferred_rows: device.preferred_rows(),
        };
        Ok(Self {
            info,
            choice,
            number,
            adapter,
            view_layout,
            culling,
            rendering,
            reduction,
            device,
            loaded: None,
        })
    }

    /// Ends the device as a driver's reset would: every call after it says that the device is lost. For tests of what
    /// goes on after that.
    pub fn lose_device(&self) {
        self.device.raw.destroy();
        // The callback that notes it runs while the device is asked.
        let _ = self.device.raw.poll(wgpu::PollType::Poll);
    }

    fn side(&self, store: &Store, plan: &Plan, upload: &Upload) -> Result<Side, BackendError> {
        let scene = Scene {
            device: &self.device,
            culling: &self.culling,
            rendering: &self.rendering,
            store,
            plan,
            upload,
        };
        Side::new(&scene, &self.reduction, &self.view_layout, self.choice.wanted.timing)
    }

    /// After a call that failed: what was on its way is not waited for, and the buffers that it may still hold are
    /// given up for others. Where there are no others, the scene is no longer loaded.
    fn give_up(&mut self) {
        let Some(mut loaded) = self.loaded.take() else { return };
        let side = || self.side(&loaded.store, &loaded.plan, &loaded.upload);
        if let (Ok(first), Ok(second)) = (side(), side()) {
            loaded.sides = [first, second];
            self.loaded = Some(loaded);
        }
    }

    fn loaded(&mut self) -> Result<&mut Loaded, BackendError> {
        self.device.check()?;
        self.loaded
            .as_mut()
            .ok_or_else(|| BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned()))
    }
}

fn check(hemicubes: &[Hemicube], patch_count: u32) -> Result<(), BackendError> {
    hemicubes.iter().try_for_each(|hemicube| hemicube.check(patch_count))
}

impl Loaded {
    /// What drawing takes, and the rest.
    fn parts<'a>(
        &'a mut self,
        device: &'a Device,
        culling: &'a Culling,
        rendering: &'a Rendering,
    ) -> (Scene<'a>, Rest<'a>) {
        let scene = Scene {
            device,
            culling,
            rendering,
            store: &self.store,
            plan: &self.plan,
            upload: &self.upload,
        };
        let rest = Rest {
            geometry: &self.geometry,
            settings: self.settings,
            sides: &mut self.sides,
            policy: &mut self.policy,
            stamp: &mut self.stamp,
            all_marked: &mut self.all_marked,
            times: &mut self.times,
        };
        (scene, rest)
    }
}

/// What changes while a scene is drawn.
struct Rest<'a> {
    geometry: &'a Geometry,
    settings: RenderSettings,
    sides: &'a mut [Side; 2],
    policy: &'a mut Policy,
    stamp: &'a mut u32,
    all_marked: &'a mut bool,
    times: &'a mut StageTimes,
}

impl Rest<'_> {
    /// Begins a submission on a side and writes each group of hemicubes by `write`. Returns its commands, how many
    /// hemicubes it has, and what is left out.
    fn record(
        &mut self,
        scene: &Scene<'_>,
        side: usize,
        hemicubes: &[Hemicube],
        write: impl Fn(&mut Recorder<'_>, &reduce::Groups, render::Group),
    ) -> (wgpu::CommandEncoder, u32, Cull) {
        let cull = self.policy.now();
        if cull == Cull::Nothing && !*self.all_marked {
            scene.store.mark_all_drawn(scene.device);
        }
        *self.all_marked = cull == Cull::Nothing;
        let side = &mut self.sides[side];
        let encoder = scene
            .device
            .raw
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut recorder = Recorder {
            encoder,
            view_group: &side.view_group,
            first_slot: 0,
            clock: side.clock.as_mut(),
        };
        let mut views = Views::with_room_for(hemicubes.len());
        for members in hemicubes.chunks(scene.plan.group as usize) {
            *self.stamp += 1;
            let resolution = scene.plan.resolution;
            let first_slot = recorder.first_slot;
            let group = views.add(
                self.geometry,
                scene.upload,
                resolution,
                members,
                first_slot,
                *self.stamp,
            );
            scene.render(&mut recorder, &side.groups.scene, group, cull);
            write(&mut recorder, &side.groups, group);
            recorder.first_slot += group.layers;
        }
        let (encoder, slots) = (recorder.encoder, recorder.first_slot);
        // Written before the commands of the next submission, which is this one, and after those before it.
        scene.device.queue.write_buffer(&side.stored_views, 0, &views.stored);
        scene.device.queue.write_buffer(&side.drawn_views, 0, &views.drawn);
        (encoder, slots, cull)
    }

    /// Two submissions are on the device at any time: when the first has counted its entries, they are asked for and
    /// the third is sent, on the side of the first; only then the entries are waited for.
    fn rows(
        &mut self,
        scene: &Scene<'_>,
        reduction: &Reduction,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
    ) -> Result<Counters, BackendError> {
        let (device, covered) = (scene.device, self.settings.covered);
        let batches: Vec<&[Hemicube]> = hemicubes.chunks(scene.plan.batch as usize).collect();
        let mut counted = [None, None];
        let mut counters = Counters::default();
        for turn in 0..batches.len() + 2 {
            let side = turn % 2;
            let before = counted[side].take();
            let arriving = match before {
                None => None,
                Some((before, cull)) => {
                    let arriving = self.sides[side].ask_for_entries(device, scene.plan, before, self.times)?;
                    Some((arriving, cull))
                }
            };
            if let Some(batch) = batches.get(turn) {
                let (encoder, slots, cull) = self.record(scene, side, batch, |recorder, groups, group| {
                    reduction.reduce(scene, recorder, groups, group, covered);
                });
                counted[side] = Some((self.sides[side].send(device, encoder, slots), cull));
            }
            if let Some((arriving, cull)) = arriving {
                let mut done = self.sides[side].finish(device, arriving, covered, self.times, out)?;
                if cull == Cull::Nothing {
                    // No stage was there to count.
                    done.triangles_transformed = done.hemicubes * self.policy.all_triangles();
                    done.triangles_drawn = done.triangles_transformed;
                }
                self.policy.learn(cull, done);
                counters += done;
            }
        }
        device.check()?;
        Ok(counters)
    }

    fn items(&mut self, scene: &Scene<'_>, reduction: &Reduction, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let n = scene.plan.resolution;
        let (mut encoder, _, _) =
            self.record(
                scene,
                0,
                std::slice::from_ref(hemicube),
                |recorder, groups, group| match scene.plan.edges {
                    Edges::Driver => {}
                    // Ids are settled on the way to a row.
                    Edges::Exact => reduction.reduce(scene, recorder, groups, group, false),
                },
            );
        // Nobody asks what this one counted, nor how long it took.
        encoder.clear_buffer(scene.store.buffer(b::TALLIES), 0, None);
        if let Some(clock) = &mut self.sides[0].clock {
            clock.add_to(&mut StageTimes::default(), &[]);
        }
        let pitch = (4 * n).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(pitch) * 3 * u64::from(n);
        let copy = scene.device.raw.create_buffer(&wgpu::BufferDescriptor {
            label: Some("an item buffer"),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            scene.store.items.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &copy,
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
        let submission = scene.device.queue.submit([encoder.finish()]);
        let words = reduce::read(scene.device, &copy, bytes, submission)?;
        let mut seen = Vec::with_capacity(pixel_count(n));
        for row in words.chunks_exact(pitch as usize / 4) {
            seen.extend(row[..n as usize].iter().map(|&id| match id {
                id if id < scene.upload.patch_count => id,
                id if id == scene.upload.patch_count + 1 => Items::ESCAPED,
                _ => Items::BLOCKED,
            }));
        }
        Ok(Items { resolution: n, seen })
    }
}

impl HemicubeBackend for Session {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.device.check()?;
        settings.check()?;
        // What was loaded may take the room that this needs.
        self.loaded = None;
        let upload = upload::prepare(geometry)?;
        let plan = Plan::new(&upload, settings, self.device.limits_for(settings.resolution))?;
        let store = Store::new(&self.device, geometry, &upload, &plan)?;
        let sides = [self.side(&store, &plan, &upload)?, self.side(&store, &plan, &upload)?];
        let fixed = match settings.culling {
            Asked::Off => Some(Cull::Nothing),
            Asked::On => self.choice.cull,
        };
        self.info.preferred_rows = 4 * plan.batch as usize;
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
        });
        Ok(())
    }

    fn choices(&self) -> Vec<String> {
        let Some(loaded) = &self.loaded else {
            return Vec::new();
        };
        let Plan { group, batch, .. } = loaded.plan;
        vec![
            loaded.policy.choice(),
            format!("{batch} hemicubes a submission, {group} side by side"),
        ]
    }

    fn stage_times(&self) -> StageTimes {
        self.loaded
            .as_ref()
            .map_or_else(StageTimes::default, |loaded| loaded.times)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        let Some(loaded) = &self.loaded else {
            return Err(BackendError::InvalidArgument(
                "no scene is loaded; call `load` first".to_owned(),
            ));
        };
        // Devices of one instance of lavapipe draw by turns: what rasterises is one of the instance.
        let mut session = if self.device.is_software {
            Self::open(self.number, self.choice)?
        } else {
            Self::new(self.number, self.adapter.clone(), self.choice)?
        };
        session.load(&loaded.geometry, loaded.settings)?;
        Ok(Box::new(session))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let patch_count = self.loaded()?.geometry.patch_count;
        check(hemicubes, patch_count)?;
        let Some(loaded) = &mut self.loaded else {
            return Err(BackendError::Internal("the scene is gone".to_owned()));
        };
        let (scene, mut rest) = loaded.parts(&self.device, &self.culling, &self.rendering);
        let done = rest.rows(&scene, &self.reduction, hemicubes, out);
        if done.is_err() {
            self.give_up();
        }
        done
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let patch_count = self.loaded()?.geometry.patch_count;
        check(std::slice::from_ref(hemicube), patch_count)?;
        let Some(loaded) = &mut self.loaded else {
            return Err(BackendError::Internal("the scene is gone".to_owned()));
        };
        let (scene, mut rest) = loaded.parts(&self.device, &self.culling, &self.rendering);
        let items = rest.items(&scene, &self.reduction, hemicube);
        if items.is_err() {
            self.give_up();
        }
        items
    }
}
