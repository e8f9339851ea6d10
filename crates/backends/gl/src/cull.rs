//! The ways of culling, and when one is given up.

use crate::render::Scene;
use hemicube_contract::backend::Counters;
use hemicube_shaders::Draw;
use hemicube_shaders::session::BY_TILES;

/// The ways of culling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cull {
    /// Everything is drawn.
    Off,
    /// Chunks outside every face's frustum are left out, by the device.
    Frustum,
    /// Chunks outside every face's frustum are left out, by the host.
    View,
    /// Hidden ones, too, by hardware occlusion queries from the host.
    Queries,
    /// Hidden ones, too, by marks of boxes in front, many boxes a draw.
    Marks,
    /// Hidden ones, too, by a pyramid of depths on the device.
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

    /// The device's own part: see [`hemicube_shaders::recording`].
    pub(crate) fn on_device(self) -> hemicube_shaders::Cull {
        match self {
            Self::Frustum => hemicube_shaders::Cull::Frustum,
            Self::Depth => hemicube_shaders::Cull::Occlusion,
            Self::Off | Self::View | Self::Queries | Self::Marks => hemicube_shaders::Cull::Off,
        }
    }
}

/// The effect of culling on the first hemicubes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Trial {
    pub(crate) in_view: u64,
    pub(crate) hidden: u64,
    /// Triangles in view of faces, and triangles sent to the device.
    pub(crate) triangles: u64,
    pub(crate) transformed: u64,
    pub(crate) hemicubes: u64,
    pub(crate) over: bool,
    pub(crate) gave_up: bool,
}

/// The cost of a hemicube's rounds of questions, in triangles: some 0.4 ms.
const ROUNDS: u64 = 6000;

/// Number of hemicubes on trial.
const TRIAL: u64 = 32;

/// The default of `min_patches`: nodes of more triangles are asked about. Chunks have up to 256, so that most nodes
/// are.
pub(crate) const FEW: u32 = 64;
/// The default of `min_patches` where the hidden share of the triangles in view is below [`IN_THE_OPEN`]: most answers
/// then say nothing (measured in `docs/dev/study.md`).
const FEW_IN_THE_OPEN: u32 = 600;
const IN_THE_OPEN: f64 = 0.125;

impl Scene {
    /// Returns whether hemicubes are counted still to decide how to cull.
    pub(crate) fn is_tried(&self) -> bool {
        let finds_few = self.cull == Cull::Queries && self.options.min_patches.is_none();
        !self.trial.over && (self.options.may_switch_off() || finds_few)
    }

    /// Ends the trial: gives up occlusion culling that finds too little for its time, or asks less. Rows stay the same.
    pub(crate) fn judge(&mut self, counters: &Counters) {
        if !self.is_tried() {
            return;
        }
        self.trial.hemicubes += counters.hemicubes;
        self.trial.in_view += counters.nodes_tested - counters.nodes_outside;
        self.trial.hidden += counters.nodes_hidden;
        self.trial.transformed += counters.triangles_transformed;
        if self.trial.hemicubes < TRIAL {
            return;
        }
        self.trial.over = true;
        match self.cull {
            Cull::Marks if self.trial.triangles < self.trial.transformed + ROUNDS * self.trial.hemicubes => {
                self.cull = Cull::View;
            }
            Cull::Depth if self.trial.hidden * 2 < self.trial.in_view => self.cull = Cull::Frustum,
            Cull::Queries if self.options.min_patches.is_none() => {
                // A triangle is drawn twice, for depths and for ids.
                let drawn = 0.5 * self.trial.transformed as f64;
                if drawn > (1.0 - IN_THE_OPEN) * self.trial.triangles as f64 {
                    self.few = FEW_IN_THE_OPEN;
                }
                return;
            }
            _ => return,
        }
        self.trial.gave_up = true;
    }

    /// Describes the decisions, for the log.
    pub(crate) fn choices(&self) -> Vec<String> {
        let chunks = self.upload.chunks.len();
        vec![
            format!(
                "{} triangles in {chunks} chunks ({} given twice); batches of {} hemicubes, {} at a time",
                self.upload.triangle_count(),
                self.upload.merged,
                self.plan.batch,
                self.plan.group
            ),
            if self.plan.draw == Draw::Compute {
                BY_TILES.to_owned()
            } else {
                format!(
                    "culling: {}{}{}",
                    self.cull.words(),
                    match self.cull {
                        Cull::Queries | Cull::Marks => format!(
                            " (of nodes down to level {} with more than {} triangles)",
                            self.options.max_level, self.few
                        ),
                        _ => String::new(),
                    },
                    if self.trial.gave_up {
                        "; too little is hidden for more"
                    } else {
                        ""
                    }
                )
            },
        ]
    }
}
