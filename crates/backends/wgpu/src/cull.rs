//! The choice of culling, and its trials.

use crate::render::Recorder;
use crate::upload::Store;
use hemicube_contract::backend::Counters;
use hemicube_shaders::stage::binding as b;
use hemicube_shaders::{Cull, Plan, Upload, chunks};

/// Fewer triangles are drawn without culling: they are one chunk.
const FEWEST_TRIANGLES: usize = 257;
/// Number of hemicubes on trial with occlusion culling.
const TRIED: u64 = 96;
/// Number of hemicubes until another trial: other parts of a scene may hide more.
const AGAIN: u64 = 512;
/// The fixed cost of occlusion culling, in triangles a pixel of the top face: drawing depths, and making the pyramid.
/// Measured on Mesa's software driver.
const TRIANGLES_A_PIXEL: f64 = 0.3;
/// The cost of testing a chunk against the pyramid of a face, in triangles. Vast scenes have more chunks than pixels.
const TRIANGLES_A_TEST: f64 = 1.5;
/// The part of a scene's triangles in view of a hemicube's faces, until it is known: seldom is more hidden.
const IN_VIEW: f64 = 0.25;

/// Chooses the culling of each submission.
#[derive(Clone, Debug)]
pub(crate) struct Policy {
    fixed: Option<Cull>,
    now: Cull,
    /// True if occlusion culling is worth a trial.
    may_pay: bool,
    triangles: f64,
    overhead: f64,
    /// Counters since the last decision.
    since: Counters,
}

impl Policy {
    /// Begins with `fixed`, the user's decision, or with the scene's size.
    pub(crate) fn new(fixed: Option<Cull>, upload: &Upload, plan: &Plan) -> Self {
        let triangles = upload.triangle_count();
        let pixels = f64::from(plan.resolution) * f64::from(plan.resolution);
        let overhead = TRIANGLES_A_PIXEL * pixels;
        #[allow(clippy::cast_precision_loss, reason = "an estimate")]
        let all = 5.0 * triangles as f64;
        let may_pay = triangles >= chunks::FEWEST_FOR_OCCLUSION && IN_VIEW * all >= overhead;
        let first = match triangles {
            0..FEWEST_TRIANGLES => Cull::Off,
            _ if may_pay => Cull::Occlusion,
            _ => Cull::Frustum,
        };
        Self {
            fixed,
            now: fixed.unwrap_or(first),
            may_pay,
            triangles: all,
            overhead,
            since: Counters::default(),
        }
    }

    /// Returns the culling of the next submission.
    pub(crate) fn now(&self) -> Cull {
        self.now
    }

    /// Adds a submission's counters under `cull`, and decides after enough hemicubes.
    pub(crate) fn learn(&mut self, cull: Cull, done: Counters) {
        if self.fixed.is_some() || cull != self.now {
            return;
        }
        self.since += done;
        match self.now {
            Cull::Occlusion if self.since.hemicubes >= TRIED => {
                if !self.hiding_pays() {
                    self.now = Cull::Frustum;
                }
                self.since = Counters::default();
            }
            Cull::Frustum if self.may_pay && self.since.hemicubes >= AGAIN => {
                self.now = Cull::Occlusion;
                self.since = Counters::default();
            }
            _ => {}
        }
    }

    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    fn hiding_pays(&self) -> bool {
        let Counters {
            hemicubes,
            nodes_tested,
            nodes_outside,
            triangles_transformed,
            ..
        } = self.since;
        let inside = 1.0 - nodes_outside as f64 / nodes_tested.max(1) as f64;
        let each = |count: u64| count as f64 / hemicubes.max(1) as f64;
        let price = self.overhead + TRIANGLES_A_TEST * each(nodes_tested);
        each(triangles_transformed) + price < inside * self.triangles
    }

    /// Describes the decision and its reason.
    pub(crate) fn choice(&self) -> String {
        let why = match (self.fixed, self.now) {
            (Some(_), _) => "as asked for",
            (None, Cull::Off) => "the scene is small",
            (None, Cull::Frustum) if !self.may_pay => "its triangles are drawn sooner than found hidden",
            (None, Cull::Frustum) => "too little is hidden for finding it to pay",
            (None, Cull::Occlusion) => "what is hidden is dear to draw",
        };
        let now = match self.now {
            Cull::Off => "off",
            Cull::Frustum => "frustum",
            Cull::Occlusion => "occlusion",
        };
        format!("culling: {now} ({why})")
    }
}

/// Copies a group's depths to a buffer, for software.
pub(crate) fn copy_depths(recorder: &mut Recorder<'_>, store: &Store, resolution: u32, layers: u32) {
    recorder.encoder.copy_texture_to_buffer(
        wgpu::TexelCopyTextureInfo {
            aspect: wgpu::TextureAspect::DepthOnly,
            ..store.depths.texture.as_image_copy()
        },
        wgpu::TexelCopyBufferInfo {
            buffer: store.buffer(b::DEPTH_COPY),
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * resolution),
                rows_per_image: Some(3 * resolution),
            },
        },
        wgpu::Extent3d {
            width: resolution,
            height: 3 * resolution,
            depth_or_array_layers: layers,
        },
    );
}

/// Clears the lists of draws before a stage writes them, on devices without draw counts: they go through whole lists.
pub(crate) fn clear_lists(recorder: &mut Recorder<'_>, store: &Store) {
    recorder.encoder.clear_buffer(store.buffer(b::DRAWS), 0, None);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn policy(fixed: Option<Cull>) -> Policy {
        Policy {
            fixed,
            now: fixed.unwrap_or(Cull::Occlusion),
            may_pay: true,
            triangles: 500_000.0,
            overhead: 10_000.0,
            since: Counters::default(),
        }
    }

    fn done(hemicubes: u64, outside: u64, drawn: u64) -> Counters {
        Counters {
            hemicubes,
            nodes_tested: 1000 * hemicubes,
            nodes_outside: outside * hemicubes,
            triangles_transformed: drawn * hemicubes,
            ..Counters::default()
        }
    }

    #[test]
    fn hiding_is_given_up_where_it_does_not_pay_and_tried_again_later() {
        let mut policy = policy(None);
        policy.learn(Cull::Occlusion, done(TRIED - 1, 500, 245_000));
        assert_eq!(policy.now(), Cull::Occlusion, "too early to tell");
        policy.learn(Cull::Occlusion, done(1, 500, 245_000));
        assert_eq!(
            policy.now(),
            Cull::Frustum,
            "245 000 + 10 000 is more than the half of 500 000"
        );
        policy.learn(Cull::Occlusion, done(AGAIN, 500, 245_000));
        assert_eq!(
            policy.now(),
            Cull::Frustum,
            "submissions from before the change tell nothing"
        );
        policy.learn(Cull::Frustum, done(AGAIN, 500, 250_000));
        assert_eq!(policy.now(), Cull::Occlusion);
        policy.learn(Cull::Occlusion, done(TRIED, 500, 100_000));
        assert_eq!(policy.now(), Cull::Occlusion, "it pays here");
        policy.learn(
            Cull::Occlusion,
            Counters {
                nodes_tested: 100_000 * TRIED,
                nodes_outside: 50_000 * TRIED,
                ..done(TRIED, 0, 100_000)
            },
        );
        assert_eq!(policy.now(), Cull::Frustum, "the tests alone cost 150,000");
        policy.may_pay = false;
        policy.learn(Cull::Frustum, done(AGAIN, 500, 250_000));
        assert_eq!(policy.now(), Cull::Frustum, "of so few triangles it is not tried again");
    }

    #[test]
    fn what_the_user_decided_stays() {
        let mut policy = policy(Some(Cull::Occlusion));
        policy.learn(Cull::Occlusion, done(10 * AGAIN, 0, 1_000_000));
        assert_eq!(policy.now(), Cull::Occlusion);
        assert!(policy.choice().contains("as asked for"));
    }
}
