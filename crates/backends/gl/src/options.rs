//! What `--backend-option` may say.

use hemicube_contract::backend::BackendError;
use hemicube_shaders::Edges;

/// How hidden chunks are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cull {
    /// Everything is drawn.
    Off,
    /// What is in no face's view is left out.
    Frustum,
    /// The same, found by the host.
    View,
    /// Also what hardware occlusion queries find hidden, asked from the host.
    Queries,
    /// The same by marks that boxes leave where they are in front, many boxes a draw.
    Marks,
    /// Also what a pyramid of depths hides, all on the device.
    Depth,
}

impl Cull {
    /// In words.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Off => "none",
            Self::Frustum => "frustum, on the device",
            Self::View => "frustum",
            Self::Queries => "frustum, occlusion queries with coherence",
            Self::Marks => "frustum, marks of boxes with coherence",
            Self::Depth => "frustum, depth pyramid with coherence",
        }
    }
}

/// What is measured against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Baseline {
    /// No culling, one hemicube a call, whole rows read back.
    Original,
    /// Octree, frustum, occlusion queries with coherence, whole rows read back (Vázquez and Guartes 2017).
    Thesis,
    Best,
}

/// The options of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Options {
    baseline: Baseline,
    /// `None` for the choice by scene.
    cull: Option<Cull>,
    /// Who says on which side of an edge a pixel lies.
    pub(crate) edges: Edges,
    /// Nodes of the octree at this level are not divided.
    pub(crate) max_level: u32,
    /// Nodes with no more triangles than this are drawn without a query. `None` for the choice by scene.
    pub(crate) min_patches: Option<u32>,
    /// Hemicubes of a submission.
    pub(crate) batch: Option<u32>,
    /// Hemicubes that go through the stages side by side.
    pub(crate) group: Option<u32>,
    /// Bytes that may be taken on the device.
    pub(crate) memory: Option<u64>,
    pub(crate) timing: bool,
    pub(crate) debug: bool,
}

impl Options {
    /// Reads `key=value,key=value`.
    pub(crate) fn parse(text: &str) -> Result<Self, BackendError> {
        let mut given = hemicube_abi::Options::parse(text)?;
        let wrong = |key: &str, value: &str, allowed: &str| {
            BackendError::InvalidArgument(format!("option `{key}` is `{value}`; it is {allowed}"))
        };
        let baseline = match given.take("baseline") {
            None | Some("best") => Baseline::Best,
            Some("original") => Baseline::Original,
            Some("thesis") => Baseline::Thesis,
            Some(other) => return Err(wrong("baseline", other, "`best`, `original` or `thesis`")),
        };
        let cull = match given.take("cull") {
            None | Some("auto") => None,
            Some("off") => Some(Cull::Off),
            Some("frustum") => Some(Cull::Frustum),
            Some("view") => Some(Cull::View),
            Some("queries") => Some(Cull::Queries),
            Some("marks") => Some(Cull::Marks),
            Some("depth") => Some(Cull::Depth),
            Some(other) => {
                return Err(wrong(
                    "cull",
                    other,
                    "`auto`, `off`, `view`, `frustum`, `queries`, `marks` or `depth`",
                ));
            }
        };
        let edges = match given.take("edges") {
            None if baseline != Baseline::Best => Edges::Driver,
            None => Edges::default(),
            Some(value) => Edges::parse(value).ok_or_else(|| wrong("edges", value, "`driver` or `exact`"))?,
        };
        let memory = match given.take("memory") {
            None => None,
            Some(value) => Some(value.parse().map_err(|_| wrong("memory", value, "a number of bytes"))?),
        };
        let mut number = |key: &str, smallest: u32| match given.take(key) {
            None => Ok(None),
            Some(value) => match value.parse() {
                Ok(number) if number >= smallest => Ok(Some(number)),
                _ => Err(wrong(key, value, &format!("a number from {smallest}"))),
            },
        };
        let options = Self {
            baseline,
            cull,
            edges,
            max_level: number("max_level", 0)?.unwrap_or(16),
            min_patches: number("min_patches", 0)?,
            batch: number("batch", 1)?,
            group: number("group", 1)?,
            memory,
            timing: given.take_switch("timing")?.unwrap_or(false),
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
        Ok(options)
    }

    /// Returns whether whole rows are read back, one hemicube at a time.
    pub(crate) fn dense(&self) -> bool {
        self.baseline != Baseline::Best
    }

    /// The culling of a scene.
    pub(crate) fn cull_for(&self, culling: bool, software: bool, can_count_draws: bool, triangles: usize) -> Cull {
        // With more triangles, a trial tells whether it pays (`Scene::judge`).
        let few = triangles < hemicube_shaders::chunks::FEWEST_FOR_OCCLUSION;
        match (self.baseline, culling) {
            (Baseline::Original, _) | (_, false) => Cull::Off,
            (Baseline::Thesis, true) => Cull::Queries,
            (Baseline::Best, true) => match self.cull {
                Some(Cull::Frustum) if !can_count_draws => Cull::View,
                Some(Cull::Depth) if !can_count_draws => Cull::Marks,
                Some(cull) => cull,
                // Software takes as long for a stage on the device as for drawing what it would leave out, and answers
                // the host at once; a GPU the other way round.
                None => match (software || !can_count_draws, few) {
                    (true, true) => Cull::View,
                    (true, false) => Cull::Marks,
                    (false, true) => Cull::Frustum,
                    (false, false) => Cull::Depth,
                },
            },
        }
    }

    /// Returns whether occlusion culling may be given up where it does not pay.
    pub(crate) fn may_switch_off(&self) -> bool {
        self.cull.is_none() && self.baseline == Baseline::Best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        ] {
            let error = Options::parse(text).expect_err(text).to_string();
            assert!(error.contains(named), "{text}: {error}");
        }
        let options = Options::parse("cull=queries,max_level=5,min_patches=600,batch=3").expect("good options");
        assert_eq!(
            (options.max_level, options.min_patches, options.batch),
            (5, Some(600), Some(3))
        );
        assert_eq!(options.cull_for(true, true, true, 100_000), Cull::Queries);
        assert_eq!(options.cull_for(false, true, true, 100_000), Cull::Off);
        let by_scene = Options::parse("").expect("nothing asked");
        let chosen = |software, triangles| by_scene.cull_for(true, software, true, triangles);
        assert_eq!([chosen(true, 8_860), chosen(true, 100_000)], [Cull::View, Cull::Marks]);
        assert_eq!(
            [chosen(false, 8_860), chosen(false, 100_000)],
            [Cull::Frustum, Cull::Depth]
        );
    }
}
