//! Views of patches, by rays: patches buried in solids, and those too large for their neighbours.
//!
//! A patch is *buried* if less than a twentieth of the rays from its centroid, and from other points of it, meet
//! anything but backs of one-sided surfaces; *mostly blocked* if half of the rays from its centroid meet backs. It is
//! *too large* if the form factor to one neighbour (Lambert's contour integral) from the centroid differs much from its
//! average over the patch: one hemicube at the centroid then is that much off.

use super::rays::{Caster, Emitter, Hit, directions};
use super::sample::{examine, hash};
use super::{
    Advice, DiagnoseOptions, Examined, Example, Finding, FindingKind, Remedy, Tally, rounded, scale_of, shape,
};
use crate::Model;
use crate::bvh::Tree;
use crate::factor::PointFactors;
use crate::frame;
use glam::DVec3;
use hemicube_scene::{InputPatch, Subdivision};

/// Rays from the centroid of a patch that may be buried.
const RAYS: u32 = 64;
/// Rays of a first test: a patch with at most one of them on a back is not buried.
const RAYS_FIRST: usize = 8;
/// Rays from each other point.
const RAYS_ELSEWHERE: usize = 24;
/// A point sees out when this share of its rays meets something else than backs.
const SHARE_OUT: f64 = 0.05;
/// Nodes of the tree that rays may meet: about a second of work.
const WORK_MAX: u64 = 50_000_000;
/// Surfaces with neighbours examined.
const NEIGHBOURS_MAX: usize = 5000;
/// Sub-triangles along an edge, by whose centroids the whole patch is averaged.
const POINTS_PER_EDGE: u32 = 8;
/// Difference of form factors from which a patch is too large.
const DIFFERENCE: f64 = 0.1;
/// Least rays that meet a neighbour.
const NEIGHBOUR_HITS: u32 = 2;

pub(super) fn findings(model: &Model, order: &[u32], options: DiagnoseOptions) -> Vec<Finding> {
    let order = &order[..order.len().min(options.surfaces_max)];
    let mut findings = buried(model, order, options.threads);
    let few = &order[..order.len().min(NEIGHBOURS_MAX)];
    findings.extend(large(model, few, options.threads));
    findings
}

/// Both sides of these surfaces.
fn patches_of<'a>(model: &'a Model, surfaces: &'a [u32]) -> impl Iterator<Item = InputPatch> + 'a {
    surfaces.iter().flat_map(|&index| {
        let surface = &model.geometry().surfaces[index as usize];
        [Some(surface.front), surface.back].into_iter().flatten()
    })
}

fn examined(model: &Model, surfaces: &[u32]) -> Examined {
    Examined {
        examined: patches_of(model, surfaces).count() as u64,
        population: model.patches().len() as u64,
    }
}

#[derive(Default)]
struct Burial {
    area: f64,
    wholly: Tally,
    at_centroid: Tally,
    mostly: Tally,
}

fn buried(model: &Model, order: &[u32], threads: usize) -> Vec<Finding> {
    let tree = &*Tree::of(model.geometry());
    let directions = directions(RAYS);
    let (found, looked_at) = examine(order, threads, WORK_MAX, |surfaces, work| {
        let mut caster = Caster::new(tree);
        let mut burial = Burial::default();
        for patch in patches_of(model, surfaces) {
            bury(model, &mut caster, &directions, patch, &mut burial);
        }
        *work += caster.work + 64 * surfaces.len() as u64;
        burial
    });
    let mut all = Burial::default();
    for burial in found {
        all.area += burial.area;
        all.wholly.merge(burial.wholly);
        all.at_centroid.merge(burial.at_centroid);
        all.mostly.merge(burial.mostly);
    }
    let of = examined(model, &order[..looked_at]);
    let whole = Some(all.area);
    let findings = [
        all.wholly.finding(
            FindingKind::Buried,
            of,
            whole,
            Advice::new(
                "delete them, turn them round if they face the wrong way, make both sides patches if they are sheets; \
                 their rows are `blocked`, not wrong",
                [Remedy::Flip, Remedy::TwoSided],
            ),
        ),
        all.at_centroid.finding(
            FindingKind::CentroidBuried,
            of,
            whole,
            Advice::new(
                "cut them, so that what is inside and what is outside become patches of their own",
                [Remedy::Split],
            ),
        ),
        all.mostly.finding(
            FindingKind::MostlyBlocked,
            of,
            whole,
            "look whether they face the right way; solids that pass through each other are best joined in the modeller"
                .to_owned(),
        ),
    ];
    findings.into_iter().flatten().collect()
}

fn bury(model: &Model, caster: &mut Caster<'_>, directions: &[DVec3], patch: InputPatch, burial: &mut Burial) {
    let area = model.patches().area(patch);
    burial.area += area;
    let Some(emitter) = Emitter::new(model, &Tree::of(model.geometry()), patch) else {
        return;
    };
    let example = |value| Example {
        patch,
        other: None,
        at: model.patches().centroid(patch),
        value,
    };
    let centroid = emitter.centroid();
    if share_out(caster, &emitter, centroid, &directions[..RAYS_FIRST]) > 1.0 - 1.5 / RAYS_FIRST as f64 {
        return;
    }
    let share = share_out(caster, &emitter, centroid, directions);
    if share >= SHARE_OUT {
        if share < 0.5 {
            burial.mostly.add(area * (1.0 - share), area, example(1.0 - share));
        }
        return;
    }
    let [a, b, c] = emitter.corners;
    let mut points = frame::sample_points(emitter.corners, 4);
    points.extend([(a, b, c), (b, c, a), (c, a, b)].map(|(p, q, r)| p * 0.98 + (q + r) * 0.01));
    let count = points.len() as f64;
    let out = points
        .into_iter()
        .filter(|&point| share_out(caster, &emitter, point, &directions[..RAYS_ELSEWHERE]) >= SHARE_OUT)
        .count() as f64;
    if out == 0.0 {
        burial.wholly.add(area, area, example(area));
    } else {
        burial.at_centroid.add(area * out / count, area, example(out / count));
    }
}

/// Share of the view from a point of a patch that is not backs.
fn share_out(caster: &mut Caster<'_>, emitter: &Emitter, point: DVec3, directions: &[DVec3]) -> f64 {
    let out = directions
        .iter()
        .filter(|&&direction| !matches!(caster.first(emitter, point, emitter.turned(direction)), Hit::Back(_)))
        .count();
    out as f64 / directions.len().max(1) as f64
}

#[derive(Default)]
struct Sizes {
    tally: Tally,
    /// Longest edges of the cases.
    longest: Vec<f64>,
}

fn large(model: &Model, order: &[u32], threads: usize) -> Option<Finding> {
    let tree = &*Tree::of(model.geometry());
    let directions = directions(POINTS_PER_EDGE * POINTS_PER_EDGE);
    let (found, looked_at) = examine(order, threads, WORK_MAX, |surfaces, work| {
        let mut caster = Caster::new(tree);
        let mut factors = PointFactors::new();
        let mut sizes = Sizes::default();
        for patch in patches_of(model, surfaces) {
            let Some(emitter) = Emitter::new(model, tree, patch) else {
                continue;
            };
            let Some((other, difference)) = worst_neighbour(model, &mut caster, &mut factors, &directions, &emitter)
            else {
                continue;
            };
            if difference >= DIFFERENCE {
                let example = Example {
                    patch,
                    other: Some(other),
                    at: model.patches().centroid(patch),
                    value: difference,
                };
                sizes.tally.add(difference, 0.0, example);
                sizes.longest.push(shape(&emitter.corners).0);
            }
        }
        *work += caster.work;
        sizes
    });
    let mut all = Sizes::default();
    for sizes in found {
        all.tally.merge(sizes.tally);
        all.longest.extend(sizes.longest);
    }
    all.longest.sort_unstable_by(f64::total_cmp);
    let median = all.longest.get(all.longest.len() / 2).copied().unwrap_or(0.0);
    let (cut, remedy) = how_to_cut(model, &rounded(0.5 * median / scale_of(model)));
    let next = Advice::new(
        format!("{cut}; a smaller tolerance looks from more points of each"),
        [remedy, Remedy::Tolerance],
    );
    all.tally.finding(
        FindingKind::LargePatch,
        examined(model, &order[..looked_at]),
        None,
        next,
    )
}

/// More patches than this many times the present number is no advice.
const TIMES_MAX: f64 = 20.0;

/// Advice to cut patches to `length`, with the number of patches.
fn how_to_cut(model: &Model, length: &str) -> (String, Remedy) {
    let surfaces = model.patches().surfaces();
    let times = length.parse().map_or(f64::INFINITY, |length| {
        let pieces = surfaces
            .iter()
            .map(|corners| Subdivision::PatchSize(length).count(corners) as f64);
        pieces.sum::<f64>() / surfaces.len().max(1) as f64
    });
    if times > TIMES_MAX {
        (
            "cut all, for patches differ too much in size for one length".to_owned(),
            Remedy::Split,
        )
    } else {
        let text = format!(
            "cut them: no longer than {length}, half their size, is {times:.1} times as many patches of the scene"
        );
        (text, Remedy::PatchSize(length.to_owned()))
    }
}

/// The neighbour with the largest difference of form factors from the centroid and from the patch, and that difference.
/// Occlusion decides who is a neighbour, and is in neither form factor.
fn worst_neighbour(
    model: &Model,
    caster: &mut Caster<'_>,
    factors: &mut PointFactors,
    directions: &[DVec3],
    emitter: &Emitter,
) -> Option<(InputPatch, f64)> {
    let points = frame::sample_points(emitter.corners, POINTS_PER_EDGE);
    let mut hits = Vec::new();
    for (k, &direction) in (0u64..).zip(directions) {
        let direction = emitter.turned(direction);
        // Neighbouring directions leave from unrelated points.
        #[allow(clippy::cast_possible_truncation, reason = "below the number of points")]
        let point = points[(hash(emitter.patch.0.into(), k) % points.len() as u64) as usize];
        for origin in [emitter.centroid(), point] {
            if let Hit::Patch(patch) = caster.first(emitter, origin, direction) {
                hits.push(patch);
            }
        }
    }
    hits.sort_unstable();
    let neighbours = hits
        .chunk_by(|a, b| a == b)
        .filter(|same| same.len() >= NEIGHBOUR_HITS as usize)
        .map(|same| InputPatch(same[0]));
    let mut worst: Option<(InputPatch, f64)> = None;
    for neighbour in neighbours {
        let triangle = model.patches().corners(neighbour).map(|p| model.normalise(p));
        let from = std::iter::once(emitter.centroid()).chain(points.iter().copied());
        let values = factors.evaluate(from.map(|point| (point, emitter.normal())), &triangle);
        let Some((&centroid, rest)) = values.split_first() else {
            continue;
        };
        let difference = (centroid - rest.iter().sum::<f64>() / rest.len().max(1) as f64).abs();
        if worst.is_none_or(|(_, most)| difference > most) {
            worst = Some((neighbour, difference));
        }
    }
    worst
}
