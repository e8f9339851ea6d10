//! A hemicube backend on OpenGL 4.5, without a window.
//!
//! Shaders, uploads and the steps of a hemicube are shared with the other GPU backends (`hemicube-shaders`). Here are
//! EGL, culling by hardware occlusion queries, and two baselines to measure against: *original*, without culling, one
//! hemicube a call and whole rows read back, and *thesis*, the octree with occlusion queries and coherence of Vázquez
//! and Guartes 2017.
//!
//! Options: `baseline=best|original|thesis`, `cull=auto|off|view|frustum|queries|marks|depth`, `edges=exact|driver`
//! (the judge of pixels near edges: docs/dev/gpu.md), `draw=raster|compute|auto`, `max_level=N` and `min_patches=N` of
//! the octree for queries and marks, `batch=N`, `group=N`, `memory=BYTES`, `timing=on`, `debug=on`.

mod ask;
mod conv;
mod cull;
mod device;
mod hierarchy;
mod options;
mod pass;
mod reduce;
mod render;
mod upload;

use device::Device;
use hemicube_abi::{Log, Plugin};
use hemicube_contract::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Geometry, Hemicube, HemicubeBackend, Pass, RenderSettings,
    StageTimes,
};
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;
use hemicube_shaders::probe::{self, Probe};
use hemicube_shaders::session::{self, CAPABILITIES, VERSION, not_loaded};
use options::Options;
use render::{Programs, Scene};
use std::ffi::CStr;
use std::fmt;
use std::sync::Arc;

hemicube_abi::export_backend!(Gl);

/// The backend's plugin.
#[derive(Clone, Copy, Debug)]
pub struct Gl;

impl Plugin for Gl {
    const NAME: &'static CStr = c"gl";
    const VERSION: &'static CStr = VERSION;
    type Session = Session;

    fn devices() -> Result<Vec<hemicube_abi::Device>, BackendError> {
        let devices = device::devices()?;
        let device = |d: device::DeviceInfo| hemicube_abi::Device {
            name: d.name,
            kind: conv::device_kind(d.software),
            capabilities: capabilities(false),
            max_resolution: d.max_resolution,
            preferred_rows: PREFERRED_ROWS,
        };
        Ok(devices.into_iter().map(device).collect())
    }

    fn open(device: u32, options: &str, _log: Log) -> Result<Session, BackendError> {
        Session::open(device, options)
    }
}

/// Several submissions: one is read back while the next is rendered.
const PREFERRED_ROWS: usize = 256;

fn capabilities(dense: bool) -> Capabilities {
    Capabilities {
        covered: !dense,
        tiny_patches: !dense,
        passes: !dense,
        // A choice: Vulkan and wgpu have them.
        rays: false,
        leaves_close: !dense,
        ..CAPABILITIES
    }
}

/// The options of a session, drawing as a probe of the device finds where `draw=auto` asks for it.
fn options_of(device: u32, options: &str) -> Result<Options, BackendError> {
    Options::parse(options, |given| {
        probe::probe(device, |draw| Session::open_with(device, given.drawing(draw)))
    })
}

/// A session: a context of its own on a device.
pub struct Session {
    // Before the device, because it is dropped first and needs the context. The context takes all with it.
    scene: Option<Scene>,
    programs: Programs,
    device: Device,
    options: Options,
    info: BackendInfo,
    failed: bool,
}

impl fmt::Debug for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Session")
            .field("info", &self.info)
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

impl Session {
    /// Opens a session on a device by its number. The options are those of the crate.
    ///
    /// # Errors
    /// When there is no such device or option, or the device does not open.
    pub fn open(device: u32, options: &str) -> Result<Self, BackendError> {
        Self::open_with(device, options_of(device, options)?)
    }

    fn open_with(device: u32, options: Options) -> Result<Self, BackendError> {
        let device = Device::open(device, options.debug)?;
        options.draw.check(&device.name, device.limits.of_stage)?;
        let programs = {
            let entered = device.enter()?;
            let programs = Programs::new(&entered, options.draw, options.edges)?;
            entered.check("compiling shaders")?;
            programs
        };
        let info = BackendInfo {
            name: "gl".to_owned(),
            version: session::version(options.draw, options.edges),
            device: device.name.clone(),
            capabilities: capabilities(options.dense()),
            preferred_rows: PREFERRED_ROWS,
        };
        Ok(Self {
            scene: None,
            programs,
            device,
            options,
            info,
            failed: false,
        })
    }

    /// Remembers a failure that leaves the device in an unknown state.
    fn note<T>(&mut self, result: Result<T, BackendError>) -> Result<T, BackendError> {
        self.failed |= matches!(result, Err(BackendError::DeviceLost(_) | BackendError::Internal(_)));
        result
    }

    fn usable(&self) -> Result<(), BackendError> {
        if self.failed {
            return Err(BackendError::DeviceLost(format!(
                "an earlier call on `{}` failed; open another session and resume",
                self.info.device
            )));
        }
        Ok(())
    }

    fn check(&self, hemicubes: &[Hemicube]) -> Result<(), BackendError> {
        let scene = self.scene.as_ref().ok_or_else(not_loaded)?;
        session::check(&scene.geometry, hemicubes)
    }

    fn render(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let Some(scene) = &mut self.scene else {
            return Ok(Counters::default());
        };
        let entered = self.device.enter()?;
        let mut counters = Counters::default();
        let mut before = None;
        for (number, batch) in hemicubes.chunks(scene.plan.batch as usize).enumerate() {
            let submission = scene.submit(&entered, &self.programs, batch, number % 2)?;
            if scene.one_by_one() {
                counters += scene.finish(&entered, submission, out)?;
            } else if let Some(before) = before.replace(submission) {
                counters += scene.finish(&entered, before, out)?;
            }
        }
        if let Some(last) = before {
            counters += scene.finish(&entered, last, out)?;
        }
        entered.check("rendering")?;
        Ok(counters)
    }
}

impl HemicubeBackend for Session {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.usable()?;
        settings.check()?;
        if settings.covered && !self.info.capabilities.covered {
            return Err(BackendError::Unsupported(
                "the baselines have pixel sums only: leave out covered weights, or the option `baseline`".to_owned(),
            ));
        }
        let result = self.device.enter().and_then(|entered| {
            if let Some(old) = self.scene.take() {
                old.delete(&entered);
            }
            Scene::new(&self.device, &entered, geometry, settings, self.options)
        });
        self.scene = Some(self.note(result)?);
        Ok(())
    }

    fn choices(&self) -> Vec<String> {
        let probe = self.options.probe.iter().map(Probe::line);
        self.scene.iter().flat_map(Scene::choices).chain(probe).collect()
    }

    fn stage_times(&self) -> StageTimes {
        self.scene
            .as_ref()
            .map_or_else(StageTimes::default, |scene| scene.times)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        let scene = self.scene.as_ref().ok_or_else(not_loaded)?;
        let mut other = Self::open_with(self.device.number, self.options)?;
        other.load(&scene.geometry, scene.settings)?;
        Ok(Box::new(other))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        self.usable()?;
        self.check(hemicubes)?;
        let result = self.render(hemicubes, out);
        self.note(result)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        self.usable()?;
        self.check(std::slice::from_ref(hemicube))?;
        let scene = self.scene.as_mut().ok_or_else(not_loaded)?;
        let result = self
            .device
            .enter()
            .and_then(|entered| scene.items(&entered, &self.programs, hemicube));
        self.note(result)
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        self.usable()?;
        let scene = self.scene.as_ref().ok_or_else(not_loaded)?;
        if !self.info.capabilities.passes {
            return Err(BackendError::Unsupported(
                "the baselines draw no passes through portals: leave out the option `baseline`".to_owned(),
            ));
        }
        pass.check(scene.settings.resolution)?;
        let result = self
            .device
            .enter()
            .and_then(|entered| scene.pass(&entered, &self.programs, pass));
        self.note(result)
    }
}

/// Reports a test skipped for want of a device, past the capture of test output.
///
/// # Panics
/// If `HEMICUBE_REQUIRE_BACKENDS` names this backend: a skip is then a failure.
#[cfg(test)]
fn skip(reason: &hemicube_contract::backend::BackendError) {
    use std::io::Write;
    let required = std::env::var("HEMICUBE_REQUIRE_BACKENDS").unwrap_or_default();
    assert!(
        !required.split(',').any(|name| name == "gl"),
        "gl would be skipped: {reason}"
    );
    let _ = std::io::stderr().write_all(format!("SKIP gl: {reason}\n").as_bytes());
}
