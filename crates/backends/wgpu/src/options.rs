//! The options of a session.

use hemicube_contract::backend::BackendError;
use hemicube_shaders::options::{Common, MOST_BATCH, bytes, device_cull, draw};
use hemicube_shaders::probe::Probe;
use hemicube_shaders::{Cull, Draw, Edges};

/// The options of a session.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Options {
    /// `None`: chosen by scene.
    pub(crate) cull: Option<Cull>,
    pub(crate) edges: Edges,
    pub(crate) draw: Draw,
    /// What a probe of the device found, if `draw` is by one.
    pub(crate) probe: Option<Probe>,
    /// Hemicubes of a submission.
    pub(crate) batch: Option<u32>,
    /// Hemicubes side by side.
    pub(crate) group: Option<u32>,
    /// Bytes to take on the device.
    pub(crate) memory: Option<u64>,
    /// Timestamps.
    pub(crate) timing: bool,
    /// The driver's validation layer, if it is installed.
    pub(crate) validation: bool,
    /// True to do without draw counts from a buffer on every device: Metal has none.
    pub(crate) fixed_draws: bool,
}

impl Options {
    /// Reads `key=value,key=value`. `probe` is asked for `draw=auto`, with the other options.
    pub(crate) fn parse(
        text: &str,
        probe: impl FnOnce(Self) -> Result<Probe, BackendError>,
    ) -> Result<Self, BackendError> {
        let mut given = hemicube_abi::Options::parse(text)?;
        let cull = device_cull(&mut given)?;
        let common = Common::take(&mut given, MOST_BATCH)?;
        let memory = bytes(&mut given, "memory")?;
        let drawn = draw(&mut given, common.edges, cull.is_some())?;
        let mut options = Self {
            cull,
            edges: common.edges.unwrap_or_default(),
            draw: drawn.unwrap_or_default(),
            probe: None,
            batch: common.batch,
            group: common.group,
            memory,
            timing: common.timing,
            validation: given.take_switch("validation")?.unwrap_or(false),
            fixed_draws: !given.take_switch("counts")?.unwrap_or(true),
        };
        given.finish()?;
        if drawn.is_none() {
            let found = probe(options)?;
            options.draw = found.draw;
            options.probe = Some(found);
        }
        Ok(options)
    }
}
