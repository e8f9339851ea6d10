//! Rays against every triangle, in f64.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{BackendError, Geometry, Hemicube, HemicubeBackend, Rays};
use hemicube::face::Items;
use hemicube_scene::InputPatch;

/// Rays of a patch.
const RAYS: usize = 192;
/// Share of the rays that may be doubtful. A choice: a backend that leaves more to the host is of little use. One in f32
/// leaves a thousandth of most scenes, and 9 % of the towers and 5 % of the terrace, nearly all of a patch or none: with
/// less, another rounding may break what is right.
const MOST_DOUBTFUL: f64 = 0.2;

/// Plane tolerances from an edge, across the ray, within which no answer is certain ([`Rays`]).
const NO_EDGE: f64 = 100.0;

/// The plane of a patch, as it looks, and its corners.
fn plane(geometry: &Geometry, patch: InputPatch) -> Option<(DVec3, [DVec3; 3])> {
    let mut surfaces = geometry.surfaces.iter();
    let surface = surfaces.find(|s| s.front == patch || s.back == Some(patch))?;
    let [a, b, c] = surface.corners;
    let normal = (b - a).cross(c - a).try_normalize()?;
    Some((if surface.front == patch { normal } else { -normal }, surface.corners))
}

/// Rays from all over a patch, more of them upright than flat; some end within the scene.
fn ends(normal: DVec3, [a, b, c]: [DVec3; 3]) -> Vec<[DVec3; 2]> {
    let (x, y) = normal.any_orthonormal_pair();
    // Four numbers that fill the unit cube evenly (Kronecker's sequence, by roots of primes).
    let numbers = |k: usize| [2f64, 3.0, 5.0, 7.0].map(|prime| (prime.sqrt() * (k + 1) as f64).fract());
    let ends = |k: usize| {
        let [mut s, mut t, u, v] = numbers(k);
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        let start = a + (b - a) * s + (c - a) * t;
        let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
        let towards = (x * cos + y * sin) * u.sqrt() + normal * (1.0 - u).sqrt();
        [start, start + towards * if k.is_multiple_of(3) { 0.3 } else { 4.0 }]
    };
    (0..RAYS).map(ends).collect()
}

/// Rays from the middle of a patch that pass edges of other triangles at half the distance within which no answer is
/// certain, on either side.
fn along_edges(geometry: &Geometry, normal: DVec3, [a, b, c]: [DVec3; 3]) -> Vec<[DVec3; 2]> {
    let start = (a + b + c) / 3.0;
    let edges = geometry.surfaces.iter().flat_map(|surface| {
        let [a, b, c] = surface.corners;
        [(a, b), (b, c), (c, a)]
    });
    let rays = edges.flat_map(|(p, q)| {
        let middle = (p + q) / 2.0;
        let aside = (q - p).cross(middle - start).normalize_or_zero() * (0.5 * NO_EDGE * geometry.plane_tolerance);
        [1.0, -1.0].map(|side| [start, start + (middle + aside * side - start) * 1.5])
    });
    let rises = |&[start, end]: &[DVec3; 2]| normal.dot(end - start) > 0.1 * (end - start).length();
    rays.filter(rises).take(RAYS).collect()
}

/// An error where an answer is certain, though the ray passes an edge that it would meet or miss a little aside.
fn sure_at_edges(answers: &[u32], geometry: &Geometry, rays: &Rays<'_>) -> Result<(), String> {
    let within = NO_EDGE * geometry.plane_tolerance;
    for (k, (&answer, &ends)) in answers.iter().zip(rays.ends).enumerate() {
        let [less, more] = [-within, within].map(|wider| met_by(geometry, rays, ends, wider));
        if answer != Rays::DOUBTFUL && less != more {
            return Err(format!(
                "ray {k} from patch {} certainly meets {answer}, it says; it passes an edge within {NO_EDGE} plane \
                 tolerances",
                rays.emitter.0
            ));
        }
    }
    Ok(())
}

/// What a ray meets.
fn met(geometry: &Geometry, rays: &Rays<'_>, ends: [DVec3; 2]) -> u32 {
    met_by(geometry, rays, ends, 0.0)
}

/// What a ray meets of triangles wider by so much on each side, across the ray.
fn met_by(geometry: &Geometry, rays: &Rays<'_>, [start, end]: [DVec3; 2], wider: f64) -> u32 {
    let mut nearest = (1.0, Items::ESCAPED);
    for surface in &geometry.surfaces {
        let [a, b, c] = surface.corners;
        let height = |p: DVec3| rays.normal.dot(p) - rays.offset;
        let is_own = surface.front == rays.emitter || surface.back == Some(rays.emitter);
        if is_own || height(a).max(height(b)).max(height(c)) <= geometry.plane_tolerance {
            continue;
        }
        let normal = (b - a).cross(c - a);
        let [at_start, at_end] = [start, end].map(|p| normal.dot(p - a));
        let along = end - start;
        let sides = [(a, b), (b, c), (c, a)].map(|(p, q)| (q - start).cross(p - start).dot(along));
        let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| (q - p).cross(along).length() * wider);
        let is_within = [1.0, -1.0]
            .iter()
            .any(|sign| sides.iter().zip(edges).all(|(s, edge)| sign * s >= -edge));
        // A plane that the ray grazes may be crossed far from the triangle, and a wider triangle is no nearer.
        let depths = [a, b, c].map(|p| (p - start).dot(along) / along.length_squared());
        let (nearest_corner, farthest_corner) =
            depths.iter().fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), &d| {
                (low.min(d), high.max(d))
            });
        let place = (at_start / (at_start - at_end))
            .max(nearest_corner)
            .min(farthest_corner);
        if is_within && at_start * at_end < 0.0 && place < nearest.0 {
            let back = surface.back.map_or(Items::BLOCKED, |patch| patch.0);
            nearest = (place, if at_start > 0.0 { surface.front.0 } else { back });
        }
    }
    nearest.1
}

/// The number of doubtful answers; an error where a certain one is wrong.
fn doubtful(answers: &[u32], geometry: &Geometry, rays: &Rays<'_>) -> Result<usize, String> {
    if answers.len() != rays.ends.len() {
        return Err(format!("{} answers to {} rays", answers.len(), rays.ends.len()));
    }
    let mut count = 0;
    for (k, (&answer, &ends)) in answers.iter().zip(rays.ends).enumerate() {
        if answer == Rays::DOUBTFUL {
            count += 1;
            continue;
        }
        let wanted = met(geometry, rays, ends);
        if answer != wanted {
            return Err(format!(
                "ray {k} from patch {} certainly meets {answer}, it says; it meets {wanted}",
                rays.emitter.0
            ));
        }
    }
    Ok(count)
}

/// Compares the answers to rays, and asks for some against the contract. The scene is loaded.
///
/// # Errors
/// The first certain answer that is wrong, or too many doubtful ones.
pub(crate) fn certain_answers(
    backend: &mut dyn HemicubeBackend,
    model: &Model,
    hemicubes: &[Hemicube],
) -> Result<String, String> {
    let geometry = model.geometry();
    let mut cast = |rays: &Rays<'_>| backend.rays(rays);
    let said = |error: BackendError| format!("`rays` failed: {error}");
    let (mut all, mut left) = (0, 0);
    for emitter in hemicubes.iter().filter_map(|hemicube| hemicube.emitter) {
        let Some((normal, corners)) = plane(geometry, emitter) else {
            continue;
        };
        let ends = ends(normal, corners);
        let rays = Rays {
            emitter,
            normal,
            offset: normal.dot(corners[0]),
            ends: &ends,
        };
        let answers = cast(&rays).map_err(said)?;
        left += doubtful(&answers, geometry, &rays)?;
        all += ends.len();
        let along_edges = along_edges(geometry, normal, corners);
        let at_edges = Rays {
            ends: &along_edges,
            ..rays
        };
        sure_at_edges(&cast(&at_edges).map_err(said)?, geometry, &at_edges)?;
        let some = Rays {
            ends: &ends[70..],
            ..rays
        };
        if cast(&some).map_err(said)? != answers[70..] {
            return Err(format!("rays from patch {}: fewer at once, other answers", emitter.0));
        }
        let none = Rays { ends: &[], ..rays };
        if !cast(&none).map_err(said)?.is_empty() {
            return Err("answers without a ray".to_owned());
        }
        for (what, wrong) in [
            (
                "a patch that does not exist",
                Rays {
                    emitter: InputPatch(geometry.patch_count),
                    ..rays
                },
            ),
            (
                "a normal without length",
                Rays {
                    normal: DVec3::ZERO,
                    ..rays
                },
            ),
            (
                "an end that is not finite",
                Rays {
                    ends: &[[DVec3::ZERO, DVec3::NAN]],
                    ..rays
                },
            ),
        ] {
            match cast(&wrong) {
                Err(BackendError::InvalidArgument(_)) => {}
                Err(other) => return Err(format!("{what}: refused, but as another error: {other}")),
                Ok(_) => return Err(format!("{what} was not refused")),
            }
        }
    }
    let share = left as f64 / all.max(1) as f64;
    if share > MOST_DOUBTFUL {
        return Err(format!("{left} of {all} rays are doubtful: more than {MOST_DOUBTFUL}"));
    }
    Ok(format!(
        "{all} rays, {share:.1e} of them doubtful, the others as in f64"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::TestScene;

    #[test]
    fn a_certain_answer_at_an_edge_is_found() {
        let model = TestScene::Room.model();
        let geometry = model.geometry();
        let emitter = TestScene::Room.hemicubes(&model)[3].emitter.expect("a patch");
        let (normal, corners) = plane(geometry, emitter).expect("it has area");
        let ends = along_edges(geometry, normal, corners);
        let rays = Rays {
            emitter,
            normal,
            offset: normal.dot(corners[0]),
            ends: &ends,
        };
        let exact: Vec<u32> = ends.iter().map(|&ends| met(geometry, &rays, ends)).collect();
        sure_at_edges(&exact, geometry, &rays).expect_err("exact, and too sure");
        let doubtful = vec![Rays::DOUBTFUL; ends.len()];
        assert_eq!(sure_at_edges(&doubtful, geometry, &rays), Ok(()));
    }

    /// A gable in the plane of which the ray starts is crossed at its start, and is itself behind a roof near by.
    #[test]
    fn a_wider_triangle_seen_edge_on_is_no_nearer() {
        let model = TestScene::City.model();
        let geometry = model.geometry();
        let emitter = InputPatch(92);
        let (normal, corners) = plane(geometry, emitter).expect("it has area");
        let ends = along_edges(geometry, normal, corners)[8];
        let rays = Rays {
            emitter,
            normal,
            offset: normal.dot(corners[0]),
            ends: &[ends],
        };
        assert_eq!(met(geometry, &rays, ends), 107);
        assert_eq!(sure_at_edges(&[107], geometry, &rays), Ok(()));
    }

    #[test]
    fn one_wrong_answer_is_found_and_a_doubtful_one_is_counted() {
        for scene in [TestScene::Room, TestScene::Plates] {
            let model = scene.model();
            let geometry = model.geometry();
            let emitter = scene.hemicubes(&model)[3].emitter.expect("a patch");
            let (normal, corners) = plane(geometry, emitter).expect("it has area");
            let ends = ends(normal, corners);
            let offset = normal.dot(corners[0]);
            let rays = Rays {
                emitter,
                normal,
                offset,
                ends: &ends,
            };
            let right: Vec<u32> = ends.iter().map(|&ends| met(geometry, &rays, ends)).collect();
            assert_eq!(doubtful(&right, geometry, &rays), Ok(0));
            for ray in [0, 7, RAYS - 1] {
                let mut wrong = right.clone();
                wrong[ray] = Rays::DOUBTFUL;
                assert_eq!(doubtful(&wrong, geometry, &rays), Ok(1));
                wrong[ray] = u32::from(right[ray] == 0);
                doubtful(&wrong, geometry, &rays).expect_err("another patch");
            }
            doubtful(&right[1..], geometry, &rays).expect_err("an answer is missing");
        }
    }
}
