//! How much is culled, and when culling is not worth it.

use hemicube_contract::backend::{Counters, Culling};

/// What the option `cull` asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Choice {
    /// What suits the scene.
    #[default]
    Auto,
    /// A given way.
    Fixed(Mode),
}

/// How chunks are chosen. Rows are the same bits with each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Everything is drawn.
    Off,
    /// What is outside a face is not.
    Frustum,
    /// What is behind what the hemicube before saw is not, either.
    Occlusion,
}

/// With no more triangles than a chunk has there is nothing to choose.
const FEWEST_FOR_FRUSTUM: usize = hemicube_shaders::chunks::MOST_TRIANGLES as usize + 1;
/// After how many hemicubes it is looked at whether culling what is hidden pays.
const TRIAL: u64 = 32;
/// What it costs to hold a chunk against the pyramid of a face, in triangles; measured on Mesa's software driver with a
/// city of 1.5 million patches, where that was four fifths of the price.
const TRIANGLES_A_TEST: f64 = 1.5;

/// The way in use and what it has brought so far.
#[derive(Clone, Debug)]
pub(crate) struct Judge {
    pub(crate) mode: Mode,
    /// Why.
    pub(crate) reason: String,
    trial: Option<Counters>,
    triangles: usize,
    chunks: usize,
    pixels: usize,
}

impl Judge {
    pub(crate) fn new(choice: Choice, culling: Culling, triangles: usize, chunks: usize, pixels: usize) -> Self {
        let (mode, reason) = match (culling, choice) {
            (Culling::Off, _) => (Mode::Off, "as the settings ask".to_owned()),
            (Culling::On, Choice::Fixed(mode)) => (mode, "as the option `cull` asks".to_owned()),
            (Culling::On, Choice::Auto) if triangles < FEWEST_FOR_FRUSTUM => {
                (Mode::Off, format!("{triangles} triangles are drawn sooner than culled"))
            }
            (Culling::On, Choice::Auto) if triangles < hemicube_shaders::chunks::FEWEST_FOR_OCCLUSION => (
                Mode::Frustum,
                format!("{triangles} triangles are drawn sooner than found hidden"),
            ),
            (Culling::On, Choice::Auto) => (Mode::Occlusion, format!("on trial for {TRIAL} hemicubes")),
        };
        let on_trial = mode == Mode::Occlusion && choice == Choice::Auto;
        Self {
            mode,
            reason,
            trial: on_trial.then(Counters::default),
            triangles,
            chunks,
            pixels,
        }
    }

    /// Takes note of what a submission did.
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
        // What depths were drawn for alone, the tests, and the pyramid: a pixel costs about a tenth of a triangle.
        let spent = (sum.triangles_transformed - sum.triangles_drawn) as f64 / count
            + TRIANGLES_A_TEST * sum.nodes_tested as f64 / count
            + 0.1 * self.pixels as f64;
        if saved > spent {
            self.reason = format!("hidden: {saved:.0} triangles a hemicube, at the price of {spent:.0}");
        } else {
            self.mode = Mode::Frustum;
            self.reason = format!("hidden: only {saved:.0} triangles a hemicube, at the price of {spent:.0}");
        }
    }

    pub(crate) fn line(&self) -> String {
        let what = match self.mode {
            Mode::Off => "no culling",
            Mode::Frustum => "culling of what is outside the faces",
            Mode::Occlusion => "culling of what is outside the faces or hidden",
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
        let judge = || Judge::new(Choice::Auto, Culling::On, 100_000, 500, 10_000);
        let mut paid = judge();
        assert_eq!(paid.mode, Mode::Occlusion);
        paid.note(done(400, 10_000));
        assert_eq!(paid.mode, Mode::Occlusion);
        let mut idle = judge();
        idle.note(done(20, 10_000));
        assert_eq!(idle.mode, Mode::Frustum);
        // 78 of 48,730 tested: what is hidden is worth more than the pyramid, and less than the tests.
        let mut vast = Judge::new(Choice::Auto, Culling::On, 1_495_068, 9_746, 49_152);
        vast.note(Counters {
            nodes_tested: 48_730 * TRIAL,
            ..done(78, 0)
        });
        assert_eq!(vast.mode, Mode::Frustum);
        let mut asked = Judge::new(Choice::Fixed(Mode::Occlusion), Culling::On, 10, 1, 10_000);
        asked.note(done(0, 10_000));
        assert_eq!(asked.mode, Mode::Occlusion, "what was asked for stays");
        assert_eq!(Judge::new(Choice::Auto, Culling::On, 100, 1, 1).mode, Mode::Off);
        assert_eq!(Judge::new(Choice::Auto, Culling::On, 10_000, 40, 1).mode, Mode::Frustum);
        assert_eq!(Judge::new(Choice::Auto, Culling::Off, 1 << 20, 4096, 1).mode, Mode::Off);
    }
}
