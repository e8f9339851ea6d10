//! Hashes of small matrices: whether a change changed bits, in seconds.
//!
//! `tests/golden/bits.txt` begins with [`PROGRAM`], by which a store is resumed; then a line for each of eight matrices
//! at each of five accuracy levels by each engine of the CPU backend: matrix, level, engine, hash. Where bits differ and
//! [`PROGRAM`] does not, an old store would be resumed with other numbers. Eight matrices cannot show every change:
//! `scripts/same-bits` compares two builds on scenes of any size.

use crate::extremes::{hinge, mote, near_plates, room_with_a_block, tower_through_the_ground};
use crate::geometry::scene_of;
use crate::rows::{Rung, parts, plan, settings, settled};
use crate::scenes::{model, model_as_it_is, workspace};
use hemicube::Model;
use hemicube::accuracy::correct::Correction;
use hemicube::driver::compute::Execution;
use hemicube::driver::settings::PROGRAM;
use hemicube::store::Part;
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::{cornell_box, cornell_box_open};
use std::path::PathBuf;

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
