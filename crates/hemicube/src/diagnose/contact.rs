//! Pairs of triangles that cross, cover each other, nearly touch face to face, or leave a crack between their corners.
//!
//! Triangle and triangle (Möller 1997, "A fast triangle-triangle intersection test"): each is cut by the other's plane;
//! if both are cut, the two segments on the planes' common line overlap or not. Nearly parallel ones are projected onto
//! each other and clipped (Sutherland & Hodgman 1974). A pair is examined once, from the smaller of the two: a ground
//! under a city is not tested against the whole of it, and a sample of triangles finds its share of pairs.

use super::precision::Grain;
use super::sample::{examine, hash};
use super::{Advice, DiagnoseOptions, Examined, Example, Finding, FindingKind, Remedy, Tally, scale_of, shape};
use crate::Model;
use crate::bvh::{Block, INNER, LANES, Tree, UNUSED};
use crate::geometry;
use glam::DVec3;
use hemicube_scene::InputPatch;
use std::sync::Arc;

/// Boxes and pairs examined at most: one or two seconds of work.
const WORK_MAX: u64 = 60_000_000;
/// A reach through a triangle below this share of the smaller one's longest edge is contact.
const DEPTH: f64 = 1e-3;
/// Sine of the angle below which two planes count as parallel.
const PARALLEL: f64 = 1e-3;
/// The gap between two plates that nearly touch, as a share of the root of their common area.
const GAP: f64 = 1e-4;
/// Common share of the smaller triangle from which two cover each other.
const COMMON: f64 = 0.01;

/// Relation of two triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Relation {
    /// They cross along a line of this length, with its middle here.
    Crossing { length: f64, at: DVec3 },
    /// One hides the other over this area, with its middle here.
    Overlap { area: f64, at: DVec3 },
    /// They face each other across this gap, over an area with its middle here.
    NearContact { gap: f64, size: f64, at: DVec3 },
}

/// A triangle of the tree, in normalised coordinates.
#[derive(Clone, Copy, Debug)]
struct Plate {
    corners: [DVec3; 3],
    normal: DVec3,
    longest: f64,
    area: f64,
    patch: u32,
    two_sided: bool,
}

impl Plate {
    /// `None` for a triangle without area.
    fn new(corners: [DVec3; 3], patch: u32, two_sided: bool) -> Option<Self> {
        let [_, _, normal] = crate::frame::axes(corners, 0.0)?;
        let (longest, height) = shape(&corners);
        Some(Self {
            corners,
            normal,
            longest,
            area: 0.5 * longest * height,
            patch,
            two_sided,
        })
    }

    fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.corners[0])
    }

    fn heights(&self, of: &Self) -> [f64; 3] {
        of.corners.map(|p| self.height(p))
    }
}

/// The relation of `p` and `q`, if it matters. `tolerance`: see [`crate::backend::Geometry::plane_tolerance`].
fn relation(p: &Plate, q: &Plate, tolerance: f64) -> Option<Relation> {
    let line = p.normal.cross(q.normal);
    let sine = line.length();
    if sine < PARALLEL
        && let Some(relation) = cover(p, q, tolerance)
    {
        return Some(relation);
    }
    if sine < 1e-9 {
        return None;
    }
    let (of_p, of_q) = (q.heights(p), p.heights(q));
    let smaller = p.longest.min(q.longest);
    // Reach of each to the other side of the other's plane, measured within its own.
    let reach = |heights: [f64; 3]| {
        let (low, high) = range(heights);
        high.min(-low) / sine
    };
    if reach(of_p).min(reach(of_q)) <= (DEPTH * smaller).max(tolerance) {
        return None;
    }
    let line = line / sine;
    let origin = p.corners[0];
    let [a, b] = cut(&p.corners, of_p, line, origin)?;
    let [c, d] = cut(&q.corners, of_q, line, origin)?;
    let (low, high) = if a.0.max(c.0) == a.0 {
        (a, b.0.min(d.0))
    } else {
        (c, b.0.min(d.0))
    };
    let length = high - low.0;
    (length > DEPTH * smaller).then(|| Relation::Crossing {
        length,
        at: low.1 + line * (0.5 * length),
    })
}

fn range(values: [f64; 3]) -> (f64, f64) {
    let [a, b, c] = values;
    (a.min(b).min(c), a.max(b).max(c))
}

/// The two intersections of a triangle's edges with a plane over which its corners have these heights, by their place
/// along `line`, ascending.
fn cut(corners: &[DVec3; 3], heights: [f64; 3], line: DVec3, origin: DVec3) -> Option<[(f64, DVec3); 2]> {
    let mut ends = [(0.0, DVec3::ZERO); 2];
    let mut count = 0;
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        let (from, to) = (heights[i], heights[j]);
        if (from > 0.0) != (to > 0.0) {
            let at = geometry::crossing(corners[i], corners[j], from, to);
            *ends.get_mut(count)? = (line.dot(at - origin), at);
            count += 1;
        }
    }
    if ends[0].0 > ends[1].0 {
        ends.swap(0, 1);
    }
    (count == 2).then_some(ends)
}

/// Two nearly parallel triangles that cover each other with hardly a gap.
fn cover(p: &Plate, q: &Plate, tolerance: f64) -> Option<Relation> {
    // The corners' own heights bound the gap: most pairs end here.
    let (low, high) = range(p.heights(q));
    let size_max = p.longest.min(q.longest);
    if low > GAP * size_max + tolerance || high < -GAP * size_max - tolerance {
        return None;
    }
    // Most of the rest are neighbours, divided by an edge of either.
    if are_divided(p, q) || are_divided(q, p) {
        return None;
    }
    let on_p = q.corners.map(|c| c - p.normal * p.height(c));
    let polygon = geometry::within(on_p.to_vec(), &p.corners);
    let (&first, rest) = polygon.split_first()?;
    let area = 0.5
        * rest
            .windows(2)
            .map(|pair| (pair[0] - first).cross(pair[1] - first).dot(p.normal))
            .sum::<f64>()
            .abs();
    if area <= COMMON * p.area.min(q.area) {
        return None;
    }
    let at = polygon.iter().sum::<DVec3>() / polygon.len() as f64;
    // q's plane over p's, on their common area.
    let tilt = p.normal.dot(q.normal);
    let over = |point: DVec3| -q.height(point) / tilt;
    let size = area.sqrt();
    let most = polygon.iter().map(|&c| over(c).abs()).fold(0.0, f64::max);
    if most > GAP * size + tolerance {
        return None;
    }
    let same_way = tilt > 0.0;
    let gap = over(at);
    if most <= tolerance {
        let sides_coincide = same_way || p.two_sided || q.two_sided;
        return sides_coincide.then_some(Relation::Overlap { area, at });
    }
    // Sides that look into the gap: p's front with q over it, q's front if it looks down at p.
    let p_looks = gap > 0.0 || p.two_sided;
    let q_looks = (gap > 0.0) != same_way || q.two_sided;
    match (p_looks, q_looks) {
        (true, true) => Some(Relation::NearContact {
            gap: gap.abs(),
            size,
            at,
        }),
        (false, false) => None,
        _ => Some(Relation::Overlap { area, at }),
    }
}

/// Distance of a point from an edge of a triangle, inwards, in the triangle's plane and times the edge's length.
fn inside_of(p: &Plate, edge: usize) -> impl Fn(DVec3) -> f64 {
    let (from, to) = (p.corners[edge], p.corners[(edge + 1) % 3]);
    let inward = p.normal.cross(to - from);
    move |point| inward.dot(point - from)
}

/// Returns whether all of `q` lies outside one edge of `p`.
fn are_divided(p: &Plate, q: &Plate) -> bool {
    (0..3).any(|edge| {
        let side = inside_of(p, edge);
        q.corners.iter().all(|&corner| side(corner) <= 0.0)
    })
}

#[derive(Default)]
struct Contacts {
    crossing: Tally,
    overlap: Tally,
    near: Tally,
    cracks: Tally,
    /// A number for each place of a crack: many triangles share its corners.
    crack_places: Vec<u64>,
}

impl Contacts {
    fn merge(&mut self, other: Self) {
        self.crossing.merge(other.crossing);
        self.overlap.merge(other.overlap);
        self.near.merge(other.near);
        self.cracks.merge(other.cracks);
        self.crack_places.extend(other.crack_places);
    }
}

pub(super) fn findings(model: &Model, order: &[u32], grain: Option<Grain>, options: DiagnoseOptions) -> Vec<Finding> {
    let search = Search::new(model, grain);
    let order = &order[..order.len().min(options.surfaces_max)];
    let (found, looked_at) = examine(order, options.threads, WORK_MAX, |surfaces, work| {
        let mut contacts = Contacts::default();
        for &index in surfaces {
            search.around(index, &mut contacts, work);
        }
        contacts
    });
    let mut all = Contacts::default();
    for contacts in found {
        all.merge(contacts);
    }
    all.crack_places.sort_unstable();
    all.crack_places.dedup();
    all.cracks.count = all.crack_places.len() as u64;
    let of = Examined {
        examined: looked_at as u64,
        population: model.geometry().surfaces.len() as u64,
    };
    let findings = [
        all.crossing.finding(
            FindingKind::Crossing,
            of,
            None,
            Advice::new(
                "cut them finer, or along each other in the modeller; to a tolerance each is seen from several points, \
                 where a single hemicube errs",
                [Remedy::Split],
            ),
        ),
        all.overlap.finding(
            FindingKind::Overlap,
            of,
            None,
            "delete one of each pair; until then the smaller patch number is seen where both lie in one plane, the \
             upper one otherwise"
                .to_owned(),
        ),
        all.near.finding(
            FindingKind::NearContact,
            of,
            None,
            Advice::new(
                "delete both (walls between joined houses), or compute rows of the others only: theirs hold little but \
                 each other",
                [Remedy::Emitters],
            ),
        ),
        all.cracks.finding(
            FindingKind::Crack,
            of,
            None,
            "merge corners by distance in the modeller, or export with more digits".to_owned(),
        ),
    ];
    findings.into_iter().flatten().collect()
}

/// Finds the pairs of one triangle after the other.
struct Search<'m> {
    model: &'m Model,
    tree: Arc<Tree>,
    tolerance: f64,
    /// Distinct corners nearer than this are a crack; 0 for a file without a grain.
    crack: f64,
    /// Normalised lengths are this times the file's.
    scale: f64,
    /// The file's origin in normalised coordinates.
    origin: DVec3,
    /// The largest box under each node, see [`measure_box`].
    largest: Vec<f64>,
}

/// The squared diagonal of a triangle's box: the same bits from whichever corner.
fn measure_box(corners: &[DVec3; 3]) -> (DVec3, DVec3, f64) {
    let (low, high) = geometry::bounds(corners);
    (low, high, (high - low).length_squared())
}

/// Lanes with boxes that meet the one from `low` to `high`.
fn lanes_near(block: &Block, low: DVec3, high: DVec3) -> [bool; LANES] {
    let mut near = [true; LANES];
    for axis in 0..3 {
        let [a, b, c] = [0, 3, 6].map(|corner| &block.corners[corner + axis]);
        for lane in 0..LANES {
            let least = a[lane].min(b[lane]).min(c[lane]);
            let most = a[lane].max(b[lane]).max(c[lane]);
            near[lane] &= least <= high[axis] && most >= low[axis];
        }
    }
    near
}

impl<'m> Search<'m> {
    fn new(model: &'m Model, grain: Option<Grain>) -> Self {
        let tree = Tree::of(model.geometry());
        let mut largest = vec![0.0_f64; tree.nodes.len()];
        // Children come after their parents.
        for (index, node) in tree.nodes.iter().enumerate().rev() {
            largest[index] = if node.block == INNER {
                largest[node.child as usize].max(largest[node.child as usize + 1])
            } else {
                let block = &tree.blocks[node.block as usize];
                (0..LANES)
                    .map(|lane| measure_box(&block.triangle(lane)).2)
                    .fold(0.0, f64::max)
            };
        }
        let scale = scale_of(model);
        Self {
            model,
            tree,
            tolerance: model.geometry().plane_tolerance,
            // One step along each axis, and a little for its own rounding.
            crack: grain.map_or(0.0, |grain| 1.8 * grain.step() * scale),
            scale,
            origin: model.normalise(DVec3::ZERO),
            largest,
        }
    }

    /// Adds the pairs of a surface with all larger ones, and with equally large ones of a larger id.
    fn around(&self, index: u32, contacts: &mut Contacts, work: &mut u64) {
        let surface = &self.model.geometry().surfaces[index as usize];
        let Some(p) = Plate::new(surface.corners, surface.front.0, surface.back.is_some()) else {
            return;
        };
        let (low, high, size) = measure_box(&p.corners);
        // Plates that nearly touch need not have boxes that meet.
        let margin = (GAP * p.longest).max(self.crack) + self.tolerance;
        let (low, high) = (low - margin, high + margin);
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let mut pending = vec![0u32];
        while let Some(index) = pending.pop() {
            *work += 1;
            let node = &self.tree.nodes[index as usize];
            let apart = (node.center - middle).abs() - (node.half + half);
            if self.largest[index as usize] < size || apart.max_element() > 0.0 {
                continue;
            }
            if node.block == INNER {
                pending.extend([node.child + 1, node.child]);
                continue;
            }
            *work += 4;
            let block = &self.tree.blocks[node.block as usize];
            let near = lanes_near(block, low, high);
            for lane in (0..LANES).filter(|&lane| near[lane]) {
                let (negative, positive) = (block.negative[lane], block.positive[lane]);
                // The front is the smaller: backs come after their fronts, and the id for blocked after all.
                let front = negative.min(positive);
                if negative == UNUSED || front == p.patch {
                    continue;
                }
                let corners = block.triangle(lane);
                let q_size = measure_box(&corners).2;
                if q_size < size || (q_size == size && front < p.patch) {
                    continue;
                }
                *work += 4;
                // Whatever two triangles are to each other, they are not apart by one's plane.
                let (below, above) = range(corners.map(|c| p.height(c)));
                if below > margin || above < -margin {
                    continue;
                }
                *work += 12;
                let two_sided = negative.max(positive) < self.tree.patch_count;
                // Corners in the tree are sorted: the ids tell whether that turned the triangle around.
                let corners = if front == negative {
                    corners
                } else {
                    [corners[0], corners[2], corners[1]]
                };
                if let Some(q) = Plate::new(corners, front, two_sided) {
                    self.compare(&p, &q, contacts);
                }
            }
        }
    }

    fn compare(&self, p: &Plate, q: &Plate, contacts: &mut Contacts) {
        let example = |at, value| Example {
            patch: InputPatch(p.patch),
            other: Some(InputPatch(q.patch)),
            at: (at - self.origin) / self.scale,
            value,
        };
        match relation(p, q, self.tolerance) {
            Some(Relation::Crossing { length, at }) => {
                let length = length / self.scale;
                contacts.crossing.add(length, length, example(at, length));
            }
            Some(Relation::Overlap { area, at }) => {
                let area = area / self.scale / self.scale;
                contacts.overlap.add(area, area, example(at, area));
            }
            Some(Relation::NearContact { gap, size, at }) => {
                contacts
                    .near
                    .add(size, (size / self.scale).powi(2), example(at, gap / self.scale));
            }
            None => {}
        }
        if self.crack > 0.0 {
            for &a in &p.corners {
                // Exactly there, or one step off: never both.
                let near = q.corners.iter().map(|&b| (a.distance(b), b));
                let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
                if let Some((gap, b)) = nearest
                    && gap > 0.0
                    && gap <= self.crack
                {
                    let gap = gap / self.scale;
                    let middle = (a + b) * 0.5;
                    let place = middle.to_array().map(f64::to_bits);
                    contacts.cracks.add(gap, 0.0, example(middle, gap));
                    contacts
                        .crack_places
                        .push(place.into_iter().fold(0, |key, bits| hash(key, bits >> 1)));
                }
            }
        }
    }
}
