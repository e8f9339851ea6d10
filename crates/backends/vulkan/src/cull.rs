//! The choice of culling, and its trial.

use hemicube_contract::backend::{Counters, Culling};
use hemicube_shaders::Cull;
use hemicube_shaders::chunks::{FEWEST_FOR_OCCLUSION, MOST_TRIANGLES};

/// With no more triangles than a chunk has there is nothing to choose.
const FEWEST_FOR_FRUSTUM: usize = MOST_TRIANGLES as usize + 1;
/// Number of hemicubes on trial.
const TRIAL: u64 = 32;
/// The cost of testing a chunk against the pyramid of a face, in triangles; measured on Mesa's software driver with a
/// city of 1.5 million patches, with four fifths of the time in these tests.
const TRIANGLES_A_TEST: f64 = 1.5;

/// The culling in use, and its effect so far.
#[derive(Clone, Debug)]
pub(crate) struct Judge {
    pub(crate) cull: Cull,
    /// Why.
    pub(crate) reason: String,
    trial: Option<Counters>,
    triangles: usize,
    chunks: usize,
    pixels: usize,
}

impl Judge {
    pub(crate) fn new(asked: Option<Cull>, culling: Culling, triangles: usize, chunks: usize, pixels: usize) -> Self {
        let (cull, reason) = match (culling, asked) {
            (Culling::Off, _) => (Cull::Off, "as the settings ask".to_owned()),
            (Culling::On, Some(cull)) => (cull, "as the option `cull` asks".to_owned()),
            (Culling::On, None) if triangles < FEWEST_FOR_FRUSTUM => {
                (Cull::Off, format!("{triangles} triangles are drawn sooner than culled"))
            }
            (Culling::On, None) if triangles < FEWEST_FOR_OCCLUSION => (
                Cull::Frustum,
                format!("{triangles} triangles are drawn sooner than found hidden"),
            ),
            (Culling::On, None) => (Cull::Occlusion, format!("on trial for {TRIAL} hemicubes")),
        };
        let on_trial = cull == Cull::Occlusion && asked.is_none();
        Self {
            cull,
            reason,
            trial: on_trial.then(Counters::default),
            triangles,
            chunks,
            pixels,
        }
    }

    /// Adds a submission's counters, and ends the trial after its last hemicube.
    pub(crate) fn note(&mut self, done: Counters) {
        let Some(mut sum) = self.trial else { return };
        sum += done;
        self.trial = Some(sum);
        if sum.hemicubes < TRIAL {
            return;
        }
        self.trial = None;
        let count = sum.hemicubes as f64;
        let each = self.triangles as f64 / self.chunks.max(1) as f64;
        let saved = sum.nodes_hidden as f64 * each / count;
        // Triangles drawn for depths alone, the tests, and the pyramid: a pixel costs about a tenth of a triangle.
        let spent = (sum.triangles_transformed - sum.triangles_drawn) as f64 / count
            + TRIANGLES_A_TEST * sum.nodes_tested as f64 / count
            + 0.1 * self.pixels as f64;
        if saved > spent {
            self.reason = format!("hidden: {saved:.0} triangles a hemicube, at the price of {spent:.0}");
        } else {
            self.cull = Cull::Frustum;
            self.reason = format!("hidden: only {saved:.0} triangles a hemicube, at the price of {spent:.0}");
        }
    }

    pub(crate) fn line(&self) -> String {
        let what = match self.cull {
            Cull::Off => "no culling",
            Cull::Frustum => "culling of what is outside the faces",
            Cull::Occlusion => "culling of what is outside the faces or hidden",
        };
        format!("{what}: {}", self.reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn done(hidden: u64, before: u64) -> Counters {
        Counters {
            hemicubes: TRIAL,
            nodes_tested: 2_500 * TRIAL,
            nodes_hidden: hidden * TRIAL,
            triangles_drawn: 1000 * TRIAL,
            triangles_transformed: (1000 + before) * TRIAL,
            ..Counters::default()
        }
    }

    #[test]
    fn culling_stays_where_it_pays_and_goes_where_it_does_not() {
        let judge = || Judge::new(None, Culling::On, 100_000, 500, 10_000);
        let mut paid = judge();
        assert_eq!(paid.cull, Cull::Occlusion);
        paid.note(done(400, 10_000));
        assert_eq!(paid.cull, Cull::Occlusion);
        let mut idle = judge();
        idle.note(done(20, 10_000));
        assert_eq!(idle.cull, Cull::Frustum);
        // 78 of 48,730 tested: the hidden chunks are worth more than the pyramid, and less than the tests.
        let mut vast = Judge::new(None, Culling::On, 1_495_068, 9_746, 49_152);
        vast.note(Counters {
            nodes_tested: 48_730 * TRIAL,
            ..done(78, 0)
        });
        assert_eq!(vast.cull, Cull::Frustum);
        let mut asked = Judge::new(Some(Cull::Occlusion), Culling::On, 10, 1, 10_000);
        asked.note(done(0, 10_000));
        assert_eq!(asked.cull, Cull::Occlusion, "what was asked for stays");
        assert_eq!(Judge::new(None, Culling::On, 100, 1, 1).cull, Cull::Off);
        assert_eq!(Judge::new(None, Culling::On, 10_000, 40, 1).cull, Cull::Frustum);
        assert_eq!(Judge::new(None, Culling::Off, 1 << 20, 4096, 1).cull, Cull::Off);
    }
}
