//! The promise of a tolerance for single form factors, and whether it is kept.

use crate::cases::Pair;
use crate::geometry::{irrational_rotation, moved, scene_with_sides};
use crate::rows::{Factors, Rung, factors};
use crate::scenes::{model_as_it_is, say};
use glam::DVec3;
use hemicube::Model;
use hemicube_scene::{InputPatch, Scene, Subdivision};

type Triangle = [DVec3; 3];

/// A move of the scene, in words and for a point.
pub type Motion = (&'static str, fn(DVec3) -> DVec3);

/// Patches unchanged.
pub const WHOLE: Subdivision = Subdivision::None;

/// Factors between groups of triangles, area-weighted: `[from][to]`.
pub fn between_groups(model: &Model, factors: &Factors, group_of_triangle: &[usize]) -> Vec<Vec<f64>> {
    let count = group_of_triangle.iter().max().map_or(0, |g| g + 1);
    let patches = model.patches();
    let group = |patch: InputPatch| group_of_triangle[patches.triangle(patch)];
    let (mut areas, mut found) = (vec![0.0; count], vec![vec![0.0; count]; count]);
    for patch in patches.iter() {
        areas[group(patch)] += patches.area(patch);
        for &(to, factor) in &factors.rows[patch.0 as usize] {
            found[group(patch)][group(InputPatch(to))] += patches.area(patch) * factor;
        }
    }
    for (row, area) in found.iter_mut().zip(areas) {
        row.iter_mut().for_each(|f| *f /= area);
    }
    found
}

/// The bounds that a tolerance promises for one form factor.
pub fn bound(exact: f64, tolerance: f64) -> f64 {
    tolerance * if exact < 1e-2 { 1e-2 } else { exact }
}

/// Cases with their bounds. All are tried before any fails, so that a failure shows the whole pattern.
#[derive(Debug, Default)]
pub struct Tally {
    tried: usize,
    worst: f64,
    failures: Vec<String>,
}

impl Tally {
    /// Holds one factor.
    pub fn hold(&mut self, name: impl FnOnce() -> String, found: f64, exact: f64, bound: f64) {
        let share = (found - exact).abs() / bound;
        self.tried += 1;
        self.worst = self.worst.max(share);
        // Not a number is a failure too.
        if share > 1.0 || share.is_nan() {
            self.failures
                .push(format!("{}: {found}, not {exact}: {share:.2} bounds off", name()));
        }
    }

    /// Says how many were tried and how near the worst came.
    ///
    /// # Panics
    /// When any was beyond its bound, or none was tried.
    pub fn finish(self, name: &str) {
        let Self { tried, worst, failures } = self;
        say(&format!("{name}: {tried} tried, the worst at {worst:.2} of its bound"));
        assert!(tried > 0, "{name}: nothing was tried");
        let list = failures.join("\n  ");
        assert!(
            failures.is_empty(),
            "{name}: {} of {tried} fail\n  {list}",
            failures.len()
        );
    }
}

/// The scene unchanged.
pub const AS_IT_IS: Motion = ("as it is", |p| p);
/// A million of its sizes away.
pub const FAR_AWAY: Motion = ("a million sizes away", |p| p + DVec3::new(1.2e6, -2.7e6, 1.9e6));
/// Rotated by [`irrational_rotation`].
pub const ROTATED: Motion = ("rotated", |p| irrational_rotation() * p);
/// In a unit a million times as large.
pub const SCALED: Motion = ("scaled", |p| p * 1e-6);

/// The whole matrix, by the backend under test.
///
/// # Panics
/// When it breaks its contract.
pub fn matrix(model: &Model, rung: Rung) -> Factors {
    factors(model, rung).expect("a backend that keeps its contract")
}

/// The scene of a pair and each triangle's group: 0 of the emitter, 1 of the receiver, 2 between them.
pub fn pair_scene(pair: &Pair) -> (Scene, Vec<usize>) {
    let triangles = pair.triangles();
    let groups = triangles
        .iter()
        .enumerate()
        .flat_map(|(g, part)| vec![g; part.len()])
        .collect();
    let sided = |(g, part): (usize, Vec<Triangle>)| part.into_iter().map(move |t| (t, g == 2));
    (
        scene_with_sides(triangles.into_iter().enumerate().flat_map(sided)),
        groups,
    )
}

/// Both factors of a pair.
pub fn both_ways(pair: &Pair, motion: Motion, cut: Subdivision, rung: impl Fn(&Model) -> Rung) -> [f64; 2] {
    let (scene, groups) = pair_scene(pair);
    let model = model_as_it_is(&moved(scene, motion.1), cut);
    let found = between_groups(&model, &matrix(&model, rung(&model)), &groups);
    [found[0][1], found[1][0]]
}

/// Checks both form factors of each pair, in each way, against the promise.
///
/// # Panics
/// When one is not kept.
pub fn hold_pairs(name: &str, pairs: &[Pair], tolerance: f64, ways: &[(Motion, Subdivision)]) {
    let mut tally = Tally::default();
    for pair in pairs {
        for &(motion, cut) in ways {
            let found = both_ways(pair, motion, cut, |model| Rung::settled(model, tolerance));
            for (way, (found, exact)) in ["there", "back"].into_iter().zip(found.into_iter().zip(pair.exact)) {
                let name = || format!("{}, {}, {cut:?}, {way}", pair.name, motion.0);
                tally.hold(name, found, exact, bound(exact, tolerance));
            }
        }
    }
    tally.finish(&format!("{name} at {tolerance}"));
}
