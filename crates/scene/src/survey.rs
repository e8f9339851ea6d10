//! Facts about a scene before anything is computed: its extent, its triangles, their joints, and likely mistakes.
//!
//! Two triangles join at an edge with equal end points, as positions, whatever vertices the file gave them. A
//! *boundary* edge belongs to one triangle, a *non-manifold* one to three and more, and an *inconsistent* one to two
//! that run along it the same way, so that a front borders a back.

use crate::repair::{RepairReport, Shape};
use crate::{Axis, Scene, Triangle};
use glam::DVec3;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::Hash;

/// Positions nearer than this part of the largest extent are one in [`Survey::welded_edges`].
pub const WELD: f64 = 1e-7;
/// Number of triangles in [`Survey::worst`].
pub const WORST_MAX: usize = 5;

/// Facts about a scene; see [`survey`].
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Triangles left after repair.
    pub triangle_count: usize,
    /// Two-sided triangles.
    pub two_sided_count: usize,
    /// Names of objects.
    pub object_count: usize,
    /// Names of materials.
    pub material_count: usize,
    /// Triangles dropped and counted by repair.
    pub repair: RepairReport,
    /// The corners of the bounding box, least and greatest, unless there is no triangle.
    pub bounds: Option<[DVec3; 2]>,
    /// The bounding box's diagonal.
    pub diagonal: f64,
    /// The area of all triangles, of one side each.
    pub area: f64,
    /// The smallest triangle's area.
    pub area_min: f64,
    /// The largest triangle's area.
    pub area_max: f64,
    /// Joints of triangles, positions equal to the last bit.
    pub edges: Edges,
    /// Joints of triangles, positions equal after rounding to steps of [`WELD`] of the largest extent. Fewer boundary
    /// edges than in [`Survey::edges`] mean cracks too narrow to be meant.
    pub welded_edges: Edges,
    /// Objects closed on their own, positions equal to the last bit.
    pub closed_object_count: usize,
    /// Up to [`WORST_MAX`] triangles of the largest aspect, the worst first.
    pub worst: Vec<WorstTriangle>,
    /// The axis pointing up.
    pub up: Axis,
    /// The reason for this axis.
    pub up_reason: String,
    /// True if the axis is a guess: neither the format nor names and normals say it ([`crate::up`]).
    pub up_guessed: bool,
    /// Sentences about units and coordinates worth a second look.
    pub unit_hints: Vec<String>,
}

/// Joints of triangles along their edges; the [module](self) has the words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// Edges, each once however many triangles have it.
    pub count: usize,
    /// Edges of one triangle.
    pub boundary: usize,
    /// Edges of three triangles and more.
    pub non_manifold: usize,
    /// Edges of two triangles of opposite sense.
    pub inconsistent: usize,
}

impl Edges {
    /// Returns whether the surface is closed: every edge joins two triangles, front to front.
    pub fn are_closed(&self) -> bool {
        self.count > 0 && self.boundary == 0 && self.non_manifold == 0 && self.inconsistent == 0
    }

    fn add(&mut self, uses: &[Edge]) {
        self.count += 1;
        match uses {
            [_] => self.boundary += 1,
            [a, b] => self.inconsistent += usize::from(a.forward == b.forward),
            _ => self.non_manifold += 1,
        }
    }
}

/// A triangle much longer than high.
#[derive(Clone, Debug, PartialEq)]
pub struct WorstTriangle {
    /// Position of its face in the file, from 0.
    pub face: u32,
    /// The name of its object.
    pub object: String,
    /// Longest edge by the height over it; 1.15 for an equilateral triangle.
    pub aspect: f64,
    /// Its area.
    pub area: f64,
}

/// Surveys a scene after [`crate::repair::repair`], with its report.
///
/// ```
/// use hemicube_scene::repair::{RepairOptions, repair};
/// use hemicube_scene::survey::survey;
/// use hemicube_scene::{Axis, obj};
///
/// // A tetrahedron with a face missing.
/// let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\n";
/// let mut scene = obj::read(text, None, Default::default())?;
/// let report = repair(&mut scene, RepairOptions::default());
/// let found = survey(&scene, &report);
/// assert_eq!((found.edges.count, found.edges.boundary), (6, 3));
/// assert!(!found.edges.are_closed() && found.area == 1.5);
/// assert!(found.up == Axis::Y && found.up_guessed, "OBJ does not say: {}", found.up_reason);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn survey(scene: &Scene, report: &RepairReport) -> Survey {
    let bounds = bounds(&scene.triangles);
    let extent = bounds.map_or(DVec3::ZERO, |[low, high]| high - low);
    let mut area = 0.0;
    let (mut area_min, mut area_max) = (f64::INFINITY, 0.0_f64);
    let mut worst: Vec<(f64, f64, &Triangle)> = Vec::new();
    for triangle in &scene.triangles {
        let shape = Shape::of(&triangle.corners);
        let triangle_area = shape.area();
        area += triangle_area;
        area_min = area_min.min(triangle_area);
        area_max = area_max.max(triangle_area);
        // After equally bad ones, so that the first in the file is named.
        let at = worst.partition_point(|&(aspect, _, _)| aspect >= shape.aspect());
        if at < WORST_MAX {
            worst.insert(at, (shape.aspect(), triangle_area, triangle));
            worst.truncate(WORST_MAX);
        }
    }
    if scene.triangles.is_empty() {
        area_min = 0.0;
    }

    let exact = |p: DVec3| (p + 0.0).to_array().map(f64::to_bits);
    let low = bounds.map_or(DVec3::ZERO, |[low, _]| low);
    let step = WELD * extent.max_element();
    // With an extent of 0, rounding would merge all.
    let rounded = |p: DVec3| {
        if step > 0.0 {
            ((p - low) / step).round().to_array().map(f64::to_bits)
        } else {
            exact(p)
        }
    };
    let mut exact_edges = edges_of(&scene.triangles, exact);
    let mut rounded_edges = edges_of(&scene.triangles, rounded);
    let up = crate::up::up(scene);
    Survey {
        triangle_count: scene.triangles.len(),
        two_sided_count: scene.triangles.iter().filter(|t| t.two_sided).count(),
        object_count: scene.objects.len(),
        material_count: scene.materials.len(),
        repair: *report,
        bounds,
        diagonal: extent.length(),
        area,
        area_min,
        area_max,
        closed_object_count: closed_object_count(&mut exact_edges),
        edges: tally(&mut exact_edges),
        welded_edges: tally(&mut rounded_edges),
        worst: worst
            .into_iter()
            .map(|(aspect, area, triangle)| WorstTriangle {
                face: triangle.face,
                object: scene.objects.get(triangle.object as usize).cloned().unwrap_or_default(),
                aspect,
                area,
            })
            .collect(),
        up: up.axis,
        up_guessed: up.known().is_none(),
        up_reason: up.reason,
        unit_hints: unit_hints(scene, bounds, extent, area),
    }
}

fn bounds(triangles: &[Triangle]) -> Option<[DVec3; 2]> {
    let mut corners = triangles.iter().flat_map(|t| t.corners);
    let first = corners.next()?;
    Some(corners.fold([first, first], |[low, high], p| [low.min(p), high.max(p)]))
}

/// A use of an edge by a triangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    /// Numbers of the end points, the smaller first.
    ends: [usize; 2],
    object: u32,
    /// True if the triangle runs from the smaller to the larger number.
    forward: bool,
}

/// The edges of all triangles without two corners at one position, unordered.
fn edges_of<K: Eq + Hash>(triangles: &[Triangle], position: impl Fn(DVec3) -> K) -> Vec<Edge> {
    let mut numbers: HashMap<K, usize> = HashMap::new();
    let mut edges = Vec::with_capacity(3 * triangles.len());
    for triangle in triangles {
        let [a, b, c] = triangle.corners.map(|p| {
            let next = numbers.len();
            match numbers.entry(position(p)) {
                Entry::Occupied(number) => *number.get(),
                Entry::Vacant(place) => *place.insert(next),
            }
        });
        if a == b || b == c || c == a {
            continue;
        }
        edges.extend([[a, b], [b, c], [c, a]].map(|[from, to]| Edge {
            ends: [from.min(to), from.max(to)],
            object: triangle.object,
            forward: from < to,
        }));
    }
    edges
}

fn tally(edges: &mut [Edge]) -> Edges {
    edges.sort_unstable();
    let mut tally = Edges::default();
    for uses in edges.chunk_by(|a, b| a.ends == b.ends) {
        tally.add(uses);
    }
    tally
}

fn closed_object_count(edges: &mut [Edge]) -> usize {
    edges.sort_unstable_by_key(|edge| (edge.object, *edge));
    edges
        .chunk_by(|a, b| a.object == b.object)
        .filter(|object| {
            let mut tally = Edges::default();
            for uses in object.chunk_by(|a, b| a.ends == b.ends) {
                tally.add(uses);
            }
            tally.are_closed()
        })
        .count()
}

fn unit_hints(scene: &Scene, bounds: Option<[DVec3; 2]>, extent: DVec3, area: f64) -> Vec<String> {
    let mut hints = Vec::new();
    let Some([low, high]) = bounds else { return hints };
    let across = extent.max_element();
    if scene.metres_per_unit.is_none() {
        if across > 1e5 {
            hints.push(format!(
                "the scene is {} units across: 1 unit is probably a millimetre, which makes it {} m (scale by 0.001 \
                 for metres)",
                short(across),
                short(across * 1e-3)
            ));
        } else if across < 1e-3 {
            hints.push(format!(
                "the scene is only {} units across: 1 unit is probably a kilometre or more (scale by 1000 for metres)",
                short(across)
            ));
        }
    }
    let largest = low.abs().max(high.abs()).max_element();
    let typical = (area / scene.triangles.len() as f64).sqrt();
    let step = f32_step(largest);
    if step > 1e-3 * typical {
        hints.push(format!(
            "coordinates reach {}, where f32 has steps of {} ({} of a typical triangle's size): they are kept in f64 \
             here, and ruined where they pass through f32",
            short(largest),
            short(step),
            if step < typical {
                format!("{:.1} %", 100.0 * step / typical)
            } else {
                "more than all".to_owned()
            }
        ));
    }
    hints
}

/// The distance between neighbouring f32 numbers at `x`.
fn f32_step(x: f64) -> f64 {
    // 23 bits of fraction; f32 ends at 2⁻¹⁴⁹.
    (crate::repair::power_of_two(x) * 2.0_f64.powi(-23)).max(2.0_f64.powi(-149))
}

/// A length for a sentence: plain digits if there are few.
fn short(x: f64) -> String {
    if (1e-3..1e7).contains(&x) {
        // Four digits after the first.
        let digits = (4.0 - x.log10().floor()).clamp(0.0, 8.0);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to 0 to 8"
        )]
        let text = format!("{x:.*}", digits as usize);
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    } else {
        format!("{x:.3e}")
    }
}
