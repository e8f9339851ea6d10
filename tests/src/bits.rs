//! Hashes of small matrices: whether a change changed bits, in seconds.
//!
//! `tests/golden/bits.txt` begins with [`PROGRAM`], by which a store is resumed; then a line for each of eight matrices
//! at each of four accuracy levels by each engine of the CPU backend: matrix, level, engine, hash; and some rows of one
//! whose patches are several triangles, one of them large. Where bits differ and [`PROGRAM`] does not, an old store would
//! be resumed with other numbers. Nine matrices cannot show every change:
//! `scripts/same-bits` compares two builds on scenes of any size.

use crate::extremes::{hinge, mote, near_plates, room_with_a_block, tower_through_the_ground};
use crate::geometry::{quad, scene_of};
use crate::rows::{Rung, parts, plan, settings, settled};
use crate::scenes::{model, model_as_it_is, workspace};
use glam::DVec3;
use hemicube::accuracy::correct::Correction;
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection};
use hemicube::driver::settings::PROGRAM;
use hemicube::store::Part;
use hemicube::{Grouping, Model, PatchKind};
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_scene::generate::{cornell_box, cornell_box_open};
use hemicube_scene::{Scene, Subdivision};
use std::path::PathBuf;
use std::sync::Arc;

const ENGINES: [(&str, EngineChoice); 3] = [
    ("depth", EngineChoice::Depth),
    ("order", EngineChoice::Order),
    ("claims", EngineChoice::Claims),
];

/// Bits of all matrices, with the program that they are of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bits {
    /// [`PROGRAM`].
    pub program: String,
    /// Matrix, level and engine; and the hash.
    pub hashes: Vec<(String, String)>,
}

fn matrices() -> [(&'static str, Model); 8] {
    let mut two_sided = room_with_a_block(1);
    for triangle in two_sided.triangles.iter_mut().step_by(3) {
        triangle.two_sided = true;
    }
    let tower = tower_through_the_ground(false)
        .into_iter()
        .map(|(_, triangle)| triangle);
    [
        ("cornell", model(cornell_box(), Subdivision::None)),
        ("cornell-open", model(cornell_box_open(), Subdivision::None)),
        ("room-with-a-block", model(room_with_a_block(1), Subdivision::None)),
        ("mote", model_as_it_is(&mote(), Subdivision::None)),
        ("near-plates", model_as_it_is(&near_plates(1e-3), Subdivision::Split(2))),
        ("hinge", model_as_it_is(&hinge(60.0), Subdivision::None)),
        ("tower", model_as_it_is(&scene_of(tower), Subdivision::Split(2))),
        ("two-sided", model(two_sided, Subdivision::None)),
    ]
}

/// A ground of two triangles, which has several hemicubes, with walls on it.
fn ground() -> (Scene, Model) {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let ground = quad([at(0., 0., 0.), at(40., 0., 0.), at(40., 40., 0.), at(0., 40., 0.)]);
    let walls = (0..144).flat_map(|k| {
        let (x, y) = (f64::from(k % 12) * 3.3 + 0.3, f64::from(k / 12) * 3.3 + 0.3);
        let turned = if k % 5 == 0 { at(0., 1., 0.) } else { at(1., 0., 0.) };
        let foot = at(x, y, 0.);
        quad([foot, foot + turned, foot + turned + DVec3::Z, foot + DVec3::Z])
    });
    let mut scene = scene_of(ground.into_iter().chain(walls));
    for (k, triangle) in (0..).zip(&mut scene.triangles) {
        triangle.face = if k < 2 { 0 } else { k / 3 };
    }
    let model = model_as_it_is(&scene, Subdivision::None);
    (scene, model)
}

/// Some rows of the ground and its walls, by face.
fn of_the_ground() -> Vec<(String, String)> {
    let (scene, model) = ground();
    let grouping = Grouping::new(&scene, model.patches(), PatchKind::Face).map(Arc::new);
    let rows = RowChoice::Range { start: 0, end: 9 };
    let hash_of = |(level, rung): (&str, Rung)| {
        let plan = Plan::grouped(&model, rows, Selection::default(), 1, true, grouping.clone());
        let (settings, backend) = (settings(rung.resolution), Box::new(CpuBackend::new()));
        let plan = plan.with_correction(rung.correction);
        let (parts, _) =
            parts(&model, &plan, settings, backend, Execution::default()).expect("a backend that keeps its contract");
        (format!("ground-by-face {level} depth"), hash(&parts))
    };
    // Finer levels take seconds, and differ where these do.
    let coarse = rungs(&model, EngineChoice::Depth).into_iter().take(2);
    coarse.map(hash_of).collect()
}

fn rungs(model: &Model, engine: EngineChoice) -> [(&'static str, Rung); 4] {
    let settled = |tolerance| {
        let mut backend = CpuBackend::new().with_engine(engine);
        let settled = settled(model, tolerance, &mut backend).expect("a backend that keeps its contract");
        Rung {
            correction: Correction::Tolerance(settled.refinement),
            resolution: settled.resolution,
        }
    };
    [
        ("pixel", Rung::PIXEL),
        ("2%", settled(2e-2)),
        ("1%", settled(1e-2)),
        ("0.1%", settled(1e-3)),
    ]
}

/// Hash of all that a part puts into a store.
pub fn hash(parts: &[Part]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        let mut put = |bits: u64| {
            hasher.update(&bits.to_le_bytes());
        };
        part.rows.iter().for_each(|&row| put(u64::from(row)));
        part.indptr.iter().for_each(|&at| put(at.cast_unsigned()));
        part.indices
            .iter()
            .for_each(|&column| put(u64::from(column.cast_unsigned())));
        part.data.iter().for_each(|value| put(value.to_bits()));
        for sums in &part.sums {
            [sums.escaped, sums.blocked].into_iter().for_each(&mut put);
        }
        for shares in &part.shares {
            [shares.escaped, shares.blocked, shares.unselected]
                .into_iter()
                .for_each(|share| put(share.to_bits()));
        }
        part.hemicubes.iter().for_each(|&count| put(u64::from(count)));
        let errors = part.errors.iter().flat_map(|errors| errors.to_array());
        errors.for_each(|error| put(u64::from(error.to_bits())));
        part.rays.iter().for_each(|&rays| put(u64::from(rays)));
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

impl Bits {
    /// Computes all matrices.
    ///
    /// # Panics
    /// When the backend breaks its contract.
    pub fn compute() -> Self {
        let mut hashes = Vec::new();
        for (name, model) in matrices() {
            for (engine, choice) in ENGINES {
                for (level, rung) in rungs(&model, choice) {
                    let plan = plan(&model).with_correction(rung.correction);
                    let backend = Box::new(CpuBackend::new().with_engine(choice));
                    let settings = settings(rung.resolution);
                    let (parts, _) = parts(&model, &plan, settings, backend, Execution::default())
                        .expect("a backend that keeps its contract");
                    hashes.push((format!("{name} {level} {engine}"), hash(&parts)));
                }
            }
        }
        hashes.extend(of_the_ground());
        Self {
            program: PROGRAM.to_owned(),
            hashes,
        }
    }

    /// The file of the committed bits.
    pub fn path() -> PathBuf {
        workspace().join("tests/golden/bits.txt")
    }

    /// As a file.
    pub fn to_text(&self) -> String {
        let lines = self.hashes.iter().map(|(name, hash)| format!("{name} {hash}\n"));
        std::iter::once(format!("program {}\n", self.program))
            .chain(lines)
            .collect()
    }

    /// From a file's text; lines without a hash are left out, and so differ.
    pub fn of_text(text: &str) -> Self {
        let mut lines = text.lines();
        let program = lines
            .next()
            .and_then(|line| line.strip_prefix("program "))
            .unwrap_or_default();
        let hashes = lines
            .filter_map(|line| line.rsplit_once(' '))
            .map(|(name, hash)| (name.to_owned(), hash.to_owned()))
            .collect();
        Self {
            program: program.to_owned(),
            hashes,
        }
    }

    /// What differs from the committed bits, in words with what to do; `None` where nothing does.
    pub fn changed(&self, committed: &Self) -> Option<String> {
        let of = |bits: &Self, name: &str| {
            bits.hashes
                .iter()
                .find(|(n, _)| n == name)
                .map(|(_, hash)| hash.clone())
        };
        let own = self.hashes.iter().map(|(name, _)| name);
        let gone = committed
            .hashes
            .iter()
            .map(|(name, _)| name)
            .filter(|name| of(self, name).is_none());
        let differing: Vec<&str> = own
            .chain(gone)
            .filter(|name| of(self, name) != of(committed, name))
            .map(String::as_str)
            .collect();
        let is_raised = self.program != committed.program;
        let bless = "`cargo run --release -p hemicube-tests --example scoreboard -- bits --bless`";
        match (differing.is_empty(), is_raised) {
            (true, false) => None,
            (true, true) => Some(format!(
                "bits changed: no; but the program is `{}`, and the committed bits are of `{}`: {bless}",
                self.program, committed.program
            )),
            (false, is_raised) => {
                let first = if is_raised {
                    String::new()
                } else {
                    "raise `PROGRAM` in crates/store/src/lib.rs, and then ".to_owned()
                };
                Some(format!(
                    "bits changed: yes, in {} of {}: {}. If they should: {first}{bless}",
                    differing.len(),
                    self.hashes.len(),
                    differing.join(", ")
                ))
            }
        }
    }

    /// Whether other bits may be committed: not by a program of the same name, but for matrices that were not there.
    pub fn may_replace(&self, committed: &Self) -> bool {
        let is_same = |(name, hash): &(String, String)| committed.hashes.iter().all(|(n, h)| n != name || h == hash);
        self.program != committed.program || self.hashes.iter().all(is_same)
    }
}
