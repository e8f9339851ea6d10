//! The cases: a check on a scene, run on a session of a backend and one of a reference.

use crate::compare::{
    Verdict, bytes_bounded, counted, culled, emitter_unseen, pixels_near, rows_near, same_reduction, same_rows,
    tiny_count, tiny_found, unoccluded,
};
use crate::passes::{near_rays, some_near_rays};
use crate::rays::certain_answers;
use crate::scenes::TestScene;
use hemicube::Model;
use hemicube::backend::{BackendError, Counters, Culling, Hemicube, HemicubeBackend, RenderSettings};
use hemicube::delta::DeltaTable;
use hemicube::row::RowBlock;
use hemicube_scene::InputPatch;
use std::fmt;
use std::str::FromStr;

/// Pixels along an edge, for cases without a reference.
const RESOLUTION: u32 = 64;
/// Pixels along an edge, for cases with one.
const REFERENCE_RESOLUTION: u32 = 256;
/// Pixels along an edge of further passes: the fewest, no powers of two, and those of `compute` by default.
const PASS_RESOLUTIONS: [u32; 5] = [16, 48, 80, 128, 256];
/// A resolution with many sub-pixel patches.
const COARSE: u32 = 16;
/// Share of the pixels that may differ from the reference. Drivers snap corners to 1/256 of a pixel, so that pixels on
/// edges differ: 2.3 · 10⁻⁴ of them if small triangles fill the view (docs/dev/gpu.md has a setting for less).
const PIXELS: f64 = 3e-4;
/// Largest distance of a row from the reference's, in L1.
const ROW: f64 = 5e-3;
/// Fewer tiny patches than this of the reference say nothing.
const TINY_ENOUGH: usize = 20;

/// The subject of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Check {
    /// Rows keep the contract, with covered weights if they are claimed, and no patch sees itself.
    Contract,
    /// Rows are the same bits in batches of any size and in any order.
    Batches,
    /// Rows are the same bits after loading again, in another session, and after another scene.
    Repeat,
    /// Rows are the same bits with culling on and off.
    Culling,
    /// Culling culls: fewer triangles are drawn.
    Culls,
    /// Visible weights are the sums of the pixels of the backend's own item buffer.
    Reduction,
    /// Little more is read back than the entries.
    Bytes,
    /// Without occluders, every patch shows all that it covers.
    Unoccluded,
    /// Patches too small for a pixel are reported.
    Tiny,
    /// Rows and pixels are near the reference's.
    Reference,
    /// What is seen through portals is what rays meet, in open pixels only.
    Passes,
    /// Certain answers to rays are those in f64, and few are not certain.
    Rays,
    /// Requests against the contract are refused, and the session stays usable.
    Refusals,
}

impl Check {
    const ALL: [Self; 13] = [
        Self::Contract,
        Self::Batches,
        Self::Repeat,
        Self::Culling,
        Self::Culls,
        Self::Reduction,
        Self::Bytes,
        Self::Unoccluded,
        Self::Tiny,
        Self::Reference,
        Self::Passes,
        Self::Rays,
        Self::Refusals,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Contract => "contract",
            Self::Batches => "batches",
            Self::Repeat => "repeat",
            Self::Culling => "culling",
            Self::Culls => "culls",
            Self::Reduction => "reduction",
            Self::Bytes => "bytes",
            Self::Unoccluded => "unoccluded",
            Self::Tiny => "tiny",
            Self::Reference => "reference",
            Self::Passes => "passes",
            Self::Rays => "rays",
            Self::Refusals => "refusals",
        }
    }

    /// Returns true if it applies to that scene.
    fn suits(self, scene: TestScene) -> bool {
        match self {
            Self::Culls => matches!(scene, TestScene::Maze | TestScene::Towers),
            Self::Bytes => matches!(scene, TestScene::Room | TestScene::Towers),
            Self::Unoccluded => scene == TestScene::EmptyRoom,
            Self::Tiny => scene == TestScene::Towers,
            Self::Passes => matches!(
                scene,
                TestScene::Room | TestScene::Spheres | TestScene::Plates | TestScene::Soup
            ),
            Self::Rays => scene != TestScene::EmptyRoom,
            Self::Refusals => scene == TestScene::Room,
            _ => true,
        }
    }
}

/// A check on a scene; its name is `scene/check`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    /// The scene.
    pub scene: TestScene,
    /// The check.
    pub check: Check,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{}/{}", self.scene.name(), self.check.name()))
    }
}

impl FromStr for Case {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = cases().into_iter().find(|case| case.to_string() == name);
        found.ok_or_else(|| format!("there is no case `{name}`"))
    }
}

/// All cases.
pub fn cases() -> Vec<Case> {
    let of_scene = |scene| {
        let checks = Check::ALL.into_iter().filter(move |check| check.suits(scene));
        checks.map(move |check| Case { scene, check })
    };
    TestScene::ALL.into_iter().flat_map(of_scene).collect()
}

/// The outcome of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It held, with a summary.
    Held(String),
    /// The backend does not claim its subject.
    NotClaimed(String),
    /// It did not hold, with the reason.
    Broken(String),
}

/// Runs a case. `reference` is asked only if the case needs one.
pub fn run(case: Case, backend: &mut dyn HemicubeBackend, reference: &mut dyn HemicubeBackend) -> Outcome {
    let model = case.scene.model();
    let hemicubes = case.scene.hemicubes(&model);
    let mut subject = Subject {
        backend,
        model: &model,
        hemicubes: &hemicubes,
    };
    match subject.run(case.check, reference) {
        Ok(outcome) => outcome,
        Err(wrong) => Outcome::Broken(wrong),
    }
}

/// A session and its scene.
struct Subject<'a> {
    backend: &'a mut dyn HemicubeBackend,
    model: &'a Model,
    hemicubes: &'a [Hemicube],
}

fn held(text: String) -> Result<Outcome, String> {
    Ok(Outcome::Held(text))
}

fn not_claimed(what: &str) -> Result<Outcome, String> {
    Ok(Outcome::NotClaimed(what.to_owned()))
}

fn said(call: &str) -> impl Fn(BackendError) -> String + '_ {
    move |error| format!("`{call}` failed: {error}")
}

impl Subject<'_> {
    fn settings(&self, resolution: u32) -> RenderSettings {
        RenderSettings {
            resolution,
            culling: Culling::On,
            covered: self.backend.info().capabilities.covered,
        }
    }

    fn load(&mut self, settings: RenderSettings) -> Result<(), String> {
        self.backend.load(self.model.geometry(), settings).map_err(said("load"))
    }

    /// Renders hemicubes, so many a call, and checks their rows.
    fn rows(&mut self, hemicubes: &[Hemicube], at_once: usize, covered: bool) -> Result<(RowBlock, Counters), String> {
        let mut rows = RowBlock::default();
        let mut counters = Counters::default();
        for some in hemicubes.chunks(at_once) {
            counters += self.backend.rows(some, &mut rows).map_err(said("rows"))?;
        }
        let patch_count = self.model.geometry().patch_count;
        rows.check(hemicubes.len(), patch_count, covered)
            .map_err(|wrong| wrong.to_string())?;
        Ok((rows, counters))
    }

    /// All hemicubes in one call, with the settings given.
    fn all(&mut self, settings: RenderSettings) -> Result<(RowBlock, Counters), String> {
        self.load(settings)?;
        let hemicubes = self.hemicubes;
        self.rows(hemicubes, hemicubes.len(), settings.covered)
    }

    fn run(&mut self, check: Check, reference: &mut dyn HemicubeBackend) -> Result<Outcome, String> {
        let can = self.backend.info().capabilities;
        let settings = self.settings(RESOLUTION);
        match check {
            Check::Contract => {
                let (rows, counters) = self.all(settings)?;
                let emitters: Vec<Option<u32>> = self.hemicubes.iter().map(|h| h.emitter.map(|p| p.0)).collect();
                emitter_unseen(&rows, &emitters)?;
                counted(&counters, self.hemicubes.len())?;
                held(format!("{} entries in {} rows", rows.patches.len(), rows.len()))
            }
            Check::Batches => held(self.batches(settings)?),
            Check::Repeat => held(self.repeat(settings)?),
            Check::Culling | Check::Culls => {
                if check == Check::Culling && !can.lossless_culling {
                    return not_claimed("lossless culling");
                }
                let (on, on_counters) = self.all(settings)?;
                let (off, off_counters) = self.all(RenderSettings {
                    culling: Culling::Off,
                    ..settings
                })?;
                if check == Check::Culls {
                    if off_counters.triangles_drawn == 0 {
                        return not_claimed("a count of the triangles drawn");
                    }
                    return held(culled(&on_counters, &off_counters)?);
                }
                let places: Vec<usize> = (0..on.len()).collect();
                held(same_rows(&on, &off, &places)?)
            }
            Check::Reduction => {
                if !can.items {
                    return not_claimed("item buffers");
                }
                held(self.reduction(settings)?)
            }
            Check::Bytes => {
                let (rows, counters) = self.all(settings)?;
                if counters.bytes_read_back == 0 {
                    return not_claimed("a device that anything is read back from");
                }
                held(bytes_bounded(&counters, rows.patches.len(), 1)?)
            }
            Check::Unoccluded => {
                if !can.covered {
                    return not_claimed("covered weights");
                }
                held(unoccluded(&self.all(settings)?.0)?)
            }
            Check::Tiny => {
                if !(can.tiny_patches && can.covered) {
                    return not_claimed("tiny patches");
                }
                let settings = self.settings(COARSE);
                let wanted = self.with(reference).all(settings)?.0;
                if tiny_count(&wanted) < TINY_ENOUGH {
                    return Err(format!(
                        "the reference has only {} tiny patches here",
                        tiny_count(&wanted)
                    ));
                }
                held(tiny_found(&self.all(settings)?.0, &wanted)?)
            }
            Check::Reference => self.near(reference),
            Check::Passes => {
                if !can.passes {
                    return not_claimed("passes through portals");
                }
                self.passes(settings)
            }
            Check::Rays => {
                if !can.rays {
                    return not_claimed("rays");
                }
                self.load(settings)?;
                held(certain_answers(self.backend, self.model, self.hemicubes)?)
            }
            Check::Refusals => held(self.refusals(settings)?),
        }
    }

    /// Compares passes with rays, at one resolution thoroughly and at others in some pixels.
    fn passes(&mut self, settings: RenderSettings) -> Result<Outcome, String> {
        let (model, hemicubes) = (self.model, self.hemicubes);
        let mut count = 0;
        for resolution in PASS_RESOLUTIONS {
            self.load(RenderSettings { resolution, ..settings })?;
            let found = some_near_rays(self.backend, model, &hemicubes[0], resolution);
            count += found.map_err(|wrong| format!("at resolution {resolution}: {wrong}"))?;
        }
        self.load(settings)?;
        let found = near_rays(self.backend, model, hemicubes, settings.resolution)?;
        held(format!("{found}; {count} at other resolutions"))
    }

    /// Opens another session on the scene.
    fn with<'b>(&'b self, backend: &'b mut dyn HemicubeBackend) -> Subject<'b> {
        Subject {
            backend,
            model: self.model,
            hemicubes: self.hemicubes,
        }
    }

    fn batches(&mut self, settings: RenderSettings) -> Verdict {
        let (wanted, _) = self.all(settings)?;
        let count = self.hemicubes.len();
        let forwards: Vec<usize> = (0..count).collect();
        let backwards: Vec<usize> = (0..count).rev().collect();
        // 7 has no divisor in common with any count here but its own multiples, so this visits each place once.
        let strewn: Vec<usize> = (0..count).map(|k| k * 7 % count).collect();
        let twice: Vec<usize> = forwards.iter().chain(&forwards).copied().collect();
        for (places, at_once) in [
            (&forwards, 1),
            (&forwards, 3),
            (&backwards, count),
            (&strewn, 5),
            (&twice, twice.len()),
        ] {
            let hemicubes: Vec<Hemicube> = places.iter().map(|&place| self.hemicubes[place]).collect();
            let (found, _) = self.rows(&hemicubes, at_once, settings.covered)?;
            same_rows(&found, &wanted, places).map_err(|wrong| format!("{at_once} a call: {wrong}"))?;
        }
        Ok(format!("{count} rows, 1 to {} a call, in four orders", twice.len()))
    }

    fn repeat(&mut self, settings: RenderSettings) -> Verdict {
        let (wanted, _) = self.all(settings)?;
        let places: Vec<usize> = (0..wanted.len()).collect();
        let hemicubes = self.hemicubes;
        let mut fork = self.backend.fork().map_err(said("fork"))?;
        let (found, _) = self
            .with(fork.as_mut())
            .rows(hemicubes, hemicubes.len(), settings.covered)?;
        same_rows(&found, &wanted, &places).map_err(|wrong| format!("another session: {wrong}"))?;
        drop(fork);
        let other = TestScene::EmptyRoom.model();
        let smaller = RenderSettings {
            resolution: COARSE,
            ..settings
        };
        self.backend.load(other.geometry(), smaller).map_err(said("load"))?;
        let mut rows = RowBlock::default();
        let others = TestScene::EmptyRoom.hemicubes(&other);
        self.backend.rows(&others, &mut rows).map_err(said("rows"))?;
        let (found, _) = self.all(settings)?;
        same_rows(&found, &wanted, &places).map_err(|wrong| format!("after another scene: {wrong}"))
    }

    fn reduction(&mut self, settings: RenderSettings) -> Verdict {
        let (rows, _) = self.all(settings)?;
        let table = DeltaTable::new(settings.resolution);
        for (k, hemicube) in self.hemicubes.iter().enumerate() {
            let items = self.backend.items(hemicube).map_err(said("items"))?;
            same_reduction(rows.row(k), &items, &table).map_err(|wrong| format!("row {k}: {wrong}"))?;
        }
        Ok(format!("{} rows are the sums of their pixels", rows.len()))
    }

    fn near(&mut self, reference: &mut dyn HemicubeBackend) -> Result<Outcome, String> {
        let settings = RenderSettings {
            covered: false,
            ..self.settings(REFERENCE_RESOLUTION)
        };
        let wanted = self.with(reference).all(settings)?.0;
        let mut text = rows_near(&self.all(settings)?.0, &wanted, ROW)?;
        if self.backend.info().capabilities.items && reference.info().capabilities.items {
            let buffers = |backend: &mut dyn HemicubeBackend| {
                let all = self.hemicubes.iter().map(|hemicube| backend.items(hemicube));
                all.collect::<Result<Vec<_>, _>>().map_err(said("items"))
            };
            let wanted = buffers(reference)?;
            text = format!("{text}; {}", pixels_near(&buffers(self.backend)?, &wanted, PIXELS)?);
        }
        held(text)
    }

    fn refusals(&mut self, settings: RenderSettings) -> Verdict {
        let places: Vec<usize> = (0..self.hemicubes.len()).collect();
        let (wanted, _) = self.all(settings)?;
        let hemicubes = self.hemicubes;
        let mut rows = RowBlock::default();
        let stray = Hemicube {
            emitter: Some(InputPatch(self.model.geometry().patch_count)),
            ..hemicubes[0]
        };
        for (what, hemicube) in [
            ("a patch that does not exist", stray),
            (
                "an origin that is not finite",
                Hemicube {
                    origin: hemicubes[0].origin * f64::NAN,
                    ..hemicubes[0]
                },
            ),
            (
                "an axis that is not finite",
                Hemicube {
                    axes: hemicubes[0].axes.map(|axis| axis * f64::INFINITY),
                    ..hemicubes[0]
                },
            ),
        ] {
            match self.backend.rows(&[hemicube], &mut rows) {
                Err(BackendError::InvalidArgument(_)) => {}
                Err(other) => return Err(format!("{what}: `{other}` is not an invalid argument")),
                Ok(_) => return Err(format!("{what} is not refused")),
            }
            let (found, _) = self.rows(hemicubes, hemicubes.len(), settings.covered)?;
            same_rows(&found, &wanted, &places).map_err(|wrong| format!("after {what}: {wrong}"))?;
        }
        // No row is a legal number of rows.
        let (none, _) = self.rows(&[], 1, settings.covered)?;
        let odd = RenderSettings {
            resolution: RESOLUTION + 1,
            ..settings
        };
        if none.is_empty() && self.backend.load(self.model.geometry(), odd).is_err() {
            Ok("4 requests refused, and the session stays usable".to_owned())
        } else {
            Err(format!("a resolution of {} is not refused", odd.resolution))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_have_names_of_their_own() {
        let mut names: Vec<String> = cases().iter().map(Case::to_string).collect();
        for name in &names {
            assert_eq!(name.parse::<Case>().expect("its own name").to_string(), *name);
        }
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count);
        assert!(count >= 50, "{count}");
        assert!("room/everything".parse::<Case>().is_err());
    }
}
