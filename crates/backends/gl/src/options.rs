//! The options of a session: `--backend-option`.

use crate::cull::Cull;
use hemicube_contract::backend::BackendError;
use hemicube_shaders::chunks::FEWEST_FOR_OCCLUSION;
use hemicube_shaders::options::{Common, bytes, choice, draw, number};
use hemicube_shaders::probe::Probe;
use hemicube_shaders::{Draw, Edges};

/// A method to measure against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Baseline {
    /// No culling, one hemicube a call, whole rows read back.
    Original,
    /// Octree, frustum, occlusion queries with coherence, whole rows read back (Vázquez and Guartes 2017).
    Thesis,
    Best,
}

/// The options of a session.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Options {
    baseline: Baseline,
    /// `None` for the choice by scene.
    cull: Option<Cull>,
    /// The judge of pixels near edges.
    pub(crate) edges: Edges,
    pub(crate) draw: Draw,
    /// What a probe of the device found, if `draw` is by one.
    pub(crate) probe: Option<Probe>,
    /// Nodes of the octree at this level are not divided.
    pub(crate) max_level: u32,
    /// Nodes with no more triangles than this are drawn without a query. `None` for the choice by scene.
    pub(crate) min_patches: Option<u32>,
    /// Hemicubes of a submission.
    pub(crate) batch: Option<u32>,
    /// Hemicubes side by side in the stages.
    pub(crate) group: Option<u32>,
    /// Bytes to take on the device.
    pub(crate) memory: Option<u64>,
    pub(crate) timing: bool,
    pub(crate) debug: bool,
}

impl Options {
    /// Reads `key=value,key=value`. `probe` is asked for `draw=auto`, with the other options.
    pub(crate) fn parse(
        text: &str,
        probe: impl FnOnce(Self) -> Result<Probe, BackendError>,
    ) -> Result<Self, BackendError> {
        let mut given = hemicube_abi::Options::parse(text)?;
        let baseline = choice(
            &mut given,
            "baseline",
            &[
                ("best", Baseline::Best),
                ("original", Baseline::Original),
                ("thesis", Baseline::Thesis),
            ],
        )?;
        let baseline = baseline.unwrap_or(Baseline::Best);
        let cull = choice(
            &mut given,
            "cull",
            &[
                ("auto", None),
                ("off", Some(Cull::Off)),
                ("view", Some(Cull::View)),
                ("frustum", Some(Cull::Frustum)),
                ("queries", Some(Cull::Queries)),
                ("marks", Some(Cull::Marks)),
                ("depth", Some(Cull::Depth)),
            ],
        )?;
        let common = Common::take(&mut given, u32::MAX)?;
        let edges = match baseline {
            Baseline::Best => Edges::default(),
            Baseline::Original | Baseline::Thesis => Edges::Driver,
        };
        // The words of `cull` differ from other backends': any of them is culling that tiles do not know.
        let drawn = draw(&mut given, common.edges, cull.flatten().is_some())?;
        let mut options = Self {
            baseline,
            cull: cull.flatten(),
            edges: common.edges.unwrap_or(edges),
            draw: drawn.unwrap_or_default(),
            probe: None,
            max_level: number(&mut given, "max_level", 0, u32::MAX)?.unwrap_or(16),
            min_patches: number(&mut given, "min_patches", 0, u32::MAX)?,
            batch: common.batch,
            group: common.group,
            memory: bytes(&mut given, "memory")?,
            timing: common.timing,
            debug: given.take_switch("debug")?.unwrap_or(false),
        };
        given.finish()?;
        if options.baseline != Baseline::Best && (options.cull.is_some() || options.batch.is_some()) {
            return Err(BackendError::InvalidArgument(
                "a baseline has its own culling, one hemicube at a time: leave out `cull` and `batch`".to_owned(),
            ));
        }
        if options.baseline != Baseline::Best && options.edges == Edges::Exact {
            return Err(BackendError::InvalidArgument(
                "a baseline has the driver's edges: leave out `edges=exact`, or `baseline`".to_owned(),
            ));
        }
        if options.baseline != Baseline::Best && drawn != Some(Draw::Raster) {
            return Err(BackendError::InvalidArgument(
                "a baseline is drawn by the rasteriser: leave out `draw`, or `baseline`".to_owned(),
            ));
        }
        if drawn.is_none() {
            let found = probe(options)?;
            options.draw = found.draw;
            options.probe = Some(found);
        }
        Ok(options)
    }

    /// The same, drawing in a given way.
    pub(crate) fn drawing(self, draw: Draw) -> Self {
        Self { draw, ..self }
    }

    /// Returns whether whole rows are read back, one hemicube at a time.
    pub(crate) fn dense(&self) -> bool {
        self.baseline != Baseline::Best
    }

    /// The culling of a scene.
    pub(crate) fn cull_for(&self, culling: bool, software: bool, can_count_draws: bool, triangles: usize) -> Cull {
        // With more triangles, a trial tells whether it pays (`Scene::judge`).
        let few = triangles < FEWEST_FOR_OCCLUSION;
        match (self.baseline, culling) {
            // Tiles leave out what they do not see.
            _ if self.draw == Draw::Compute => Cull::Off,
            (Baseline::Original, _) | (_, false) => Cull::Off,
            (Baseline::Thesis, true) => Cull::Queries,
            (Baseline::Best, true) => match self.cull {
                Some(Cull::Frustum) if !can_count_draws => Cull::View,
                Some(Cull::Depth) if !can_count_draws => Cull::Marks,
                Some(cull) => cull,
                // On software, a stage on the device costs no less than drawing the chunks it would leave out, and the
                // host is answered at once; on a GPU the other way round.
                None => match (software || !can_count_draws, few) {
                    (true, true) => Cull::View,
                    (true, false) => Cull::Marks,
                    (false, true) => Cull::Frustum,
                    (false, false) => Cull::Depth,
                },
            },
        }
    }

    /// Returns true if occlusion culling may be given up.
    pub(crate) fn may_switch_off(&self) -> bool {
        self.cull.is_none() && self.baseline == Baseline::Best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Options, BackendError> {
        Options::parse(text, |_| {
            Ok(Probe {
                draw: Draw::Compute,
                raster: 2.0,
                compute: Some(1.0),
            })
        })
    }

    #[test]
    fn what_is_not_understood_is_named() {
        for (text, named) in [
            ("speed=high", "speed"),
            ("cull=yes", "yes"),
            ("batch=0", "batch"),
            ("baseline=thesis,batch=4", "baseline"),
            ("edges=sharp", "sharp"),
            ("baseline=original,edges=exact", "edges"),
            ("timing=perhaps", "perhaps"),
            ("draw=compute,cull=marks", "cull"),
            ("draw=compute,edges=driver", "edges"),
            ("draw=auto,baseline=thesis", "baseline"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains(named), "{text}: {error}");
        }
        let options = parse("cull=queries,max_level=5,min_patches=600,batch=3").expect("good options");
        assert_eq!(
            (options.max_level, options.min_patches, options.batch),
            (5, Some(600), Some(3))
        );
        assert_eq!(options.cull_for(true, true, true, 100_000), Cull::Queries);
        assert_eq!(options.cull_for(false, true, true, 100_000), Cull::Off);
        let probed = parse("draw=auto").expect("probed");
        assert_eq!((probed.draw, probed.probe.is_some()), (Draw::Compute, true));
        assert_eq!(probed.cull_for(true, false, true, 100_000), Cull::Off);
        let by_scene = parse("").expect("nothing asked");
        let chosen = |software, triangles| by_scene.cull_for(true, software, true, triangles);
        assert_eq!([chosen(true, 8_860), chosen(true, 100_000)], [Cull::View, Cull::Marks]);
        assert_eq!(
            [chosen(false, 8_860), chosen(false, 100_000)],
            [Cull::Frustum, Cull::Depth]
        );
    }
}
