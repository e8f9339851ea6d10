//! Statistics of the views of a few patches: seeded, for settings to choose themselves by, never by a clock.

use super::sample::hash;
use crate::Model;
use crate::backend::{BackendError, Culling, HemicubeBackend, RenderSettings, WHOLE};
use crate::driver::compute::{Plan, RowChoice, Selection};
use crate::row::RowBlock;
use glam::DVec3;
use hemicube_scene::InputPatch;
use serde::Serialize;

/// Most hemicubes of the statistics.
const ROWS: u32 = 64;
/// Patches among which those facing a patch are counted.
const FACING_SAMPLE: u64 = 32_768;
/// A patch nearer than this many radii of the emitter is near.
const NEAR: f64 = 1.5;

/// The views of one hemicube at the centroid of each of a few patches. They depend on the scene, the resolution and the
/// seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SceneStatistics {
    /// The patches.
    pub seed: u64,
    /// Their number.
    pub rows: u32,
    /// Pixels along an edge of the hemicubes.
    pub resolution: u32,
    /// Patches seen, on average a row.
    pub seen: f64,
    /// Average number of patches visible without occlusion: centroids in front of each other's plane.
    pub facing: f64,
    /// 1 − seen / facing, or 0 if more is seen than faces. Patches smaller than a pixel count as hidden.
    pub occlusion: f64,
    /// Share of the view that leaves the scene: 0 in a closed one.
    pub escaped: f64,
    /// Share of the view on backs of one-sided surfaces.
    pub blocked: f64,
    /// The emitter's radius (centroid to farthest corner) over the distance from its centroid to the nearest point of a
    /// visible patch: the median, each pair by its weight in the view.
    pub nearness: f64,
    /// Patches seen nearer than 1.5 radii of the emitter, on average a row.
    pub near: f64,
}

impl SceneStatistics {
    /// Renders the hemicubes. The backend is left with the scene loaded, culling on and no covered weights.
    ///
    /// # Errors
    /// The backend's error.
    pub fn measure(
        model: &Model,
        backend: &mut dyn HemicubeBackend,
        resolution: u32,
        seed: u64,
    ) -> Result<Self, BackendError> {
        let settings = RenderSettings {
            resolution,
            culling: Culling::On,
            covered: false,
        };
        backend.load(model.geometry(), settings)?;
        let choice = RowChoice::Sample { count: ROWS, seed };
        let plan = Plan::new(model, choice, Selection::default(), 1, true);
        let patches = model.patches();
        let others = Others::of(model, seed);
        let mut statistics = Self {
            seed,
            resolution,
            ..Self::default()
        };
        // Radius over distance, and the weight in the view.
        let mut nearness: Vec<(f64, u64)> = Vec::new();
        let mut block = RowBlock::default();
        for &patch in &plan.rows {
            let hemicubes = model.hemicubes(patch, 1, true);
            if hemicubes.is_empty() {
                continue;
            }
            block.clear();
            backend.rows(&hemicubes, &mut block)?;
            statistics.rows += 1;
            let (escaped, blocked) = (block.escaped.iter(), block.blocked.iter());
            statistics.escaped += escaped.map(|&weight| f64::from(weight)).sum::<f64>() / f64::from(WHOLE);
            statistics.blocked += blocked.map(|&weight| f64::from(weight)).sum::<f64>() / f64::from(WHOLE);
            let (centroid, normal) = (patches.centroid(patch), patches.normal(patch));
            let radius = patches
                .corners(patch)
                .iter()
                .map(|corner| corner.distance(centroid))
                .fold(0.0, f64::max);
            for (&seen, &weight) in block
                .patches
                .iter()
                .zip(&block.visible)
                .filter(|&(_, &weight)| weight > 0)
            {
                let distance = centroid.distance(nearest_point(centroid, patches.corners(InputPatch(seen))));
                statistics.seen += 1.0;
                statistics.near += f64::from(u8::from(distance < NEAR * radius));
                if distance > 0.0 {
                    nearness.push((radius / distance, weight.into()));
                }
            }
            statistics.facing += others.facing(centroid, normal);
        }
        let rows = f64::from(statistics.rows.max(1));
        let means = [
            &mut statistics.seen,
            &mut statistics.facing,
            &mut statistics.escaped,
            &mut statistics.blocked,
            &mut statistics.near,
        ];
        means.into_iter().for_each(|sum| *sum /= rows);
        if statistics.facing > 0.0 {
            statistics.occlusion = (1.0 - statistics.seen / statistics.facing).max(0.0);
        }
        statistics.nearness = weighted_median(&mut nearness);
        Ok(statistics)
    }
}

/// Centroids and normals of all patches, or of a sample of them.
struct Others {
    patches: Vec<(DVec3, DVec3)>,
    /// Number of patches that each one examined stands for.
    each: f64,
}

impl Others {
    fn of(model: &Model, seed: u64) -> Self {
        let patches = model.patches();
        let count = patches.len() as u64;
        let is_taken =
            |patch: &InputPatch| count <= FACING_SAMPLE || hash(seed, patch.0.into()) % count < FACING_SAMPLE;
        let taken: Vec<_> = patches
            .iter()
            .filter(is_taken)
            .map(|patch| (patches.centroid(patch), patches.normal(patch)))
            .collect();
        Self {
            each: count as f64 / taken.len().max(1) as f64,
            patches: taken,
        }
    }

    /// Number of patches visible without occlusion: each centroid in front of the other's plane.
    fn facing(&self, centroid: DVec3, normal: DVec3) -> f64 {
        let faces = |&&(other, other_normal): &&(DVec3, DVec3)| {
            let way = other - centroid;
            way.dot(normal) > 0.0 && way.dot(other_normal) < 0.0
        };
        self.patches.iter().filter(faces).count() as f64 * self.each
    }
}

/// The point of a triangle nearest to `point` (Ericson 2005, Real-Time Collision Detection, 5.1.5): on the face if the
/// foot of the perpendicular is, on the nearest edge otherwise.
fn nearest_point(point: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let edges = [(a, b), (b, c), (c, a)];
    let inside = edges
        .iter()
        .all(|&(from, to)| (to - from).cross(point - from).dot(normal) >= 0.0);
    if inside && normal.length_squared() > 0.0 {
        return point - normal * (normal.dot(point - a) / normal.length_squared());
    }
    let on_edge = |(from, to): (DVec3, DVec3)| {
        let edge = to - from;
        let along = (edge.dot(point - from) / edge.length_squared()).clamp(0.0, 1.0);
        // An edge without length is its end.
        if along.is_nan() { from } else { from + edge * along }
    };
    edges
        .map(on_edge)
        .into_iter()
        .min_by(|p, q| point.distance_squared(*p).total_cmp(&point.distance_squared(*q)))
        .unwrap_or(a)
}

/// The weighted median; 0 for none.
fn weighted_median(values: &mut [(f64, u64)]) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let whole: u64 = values.iter().map(|&(_, weight)| weight).sum();
    let mut sum = 0;
    values
        .iter()
        .find(|&&(_, weight)| {
            sum += weight;
            2 * sum >= whole
        })
        .map_or(0.0, |&(value, _)| value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_points() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let near = |x, y, z| nearest_point(DVec3::new(x, y, z), triangle);
        assert_eq!(near(0.25, 0.25, 3.0), DVec3::new(0.25, 0.25, 0.0));
        assert_eq!(near(0.5, -1.0, 1.0), DVec3::new(0.5, 0.0, 0.0));
        assert_eq!(near(2.0, -1.0, 0.0), DVec3::X);
        assert_eq!(near(1.0, 1.0, 1.0), DVec3::new(0.5, 0.5, 0.0));
        assert_eq!(nearest_point(DVec3::X, [DVec3::ZERO; 3]), DVec3::ZERO);
    }

    #[test]
    fn medians_by_weight() {
        assert_eq!(weighted_median(&mut []), 0.0);
        assert_eq!(weighted_median(&mut [(3.0, 1), (1.0, 1), (2.0, 1)]), 2.0);
        assert_eq!(weighted_median(&mut [(3.0, 9), (1.0, 1), (2.0, 1)]), 3.0);
    }
}
