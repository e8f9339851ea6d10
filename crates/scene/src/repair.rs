//! Drops triangles that cannot be patches, and records each in the scene's [ledger](crate::Ledger). The rules depend on
//! the triangle alone, not on its place or size.
//!
//! 1. **Not finite**: a corner with an infinite coordinate or a NaN. Dropped.
//! 2. **Degenerate**: with ℓ the longest edge, h the height over it and m the largest coordinate by magnitude,
//!
//!    ```text
//!    h ≤ max(10⁻¹² ℓ, 4 · 2⁻⁵² m)
//!    ```
//!
//!    Dropped. The first bound is of shape: a triangle ten thousand million times as long as high is still kept. The
//!    second is of rounding: corners are known to half a unit in the last place of m, so that a height of a few such
//!    units has no direction (at 10⁷ units from the origin that is a height of 10⁻⁸).
//! 3. **Duplicate**: every side of it that radiates (the front; of a two-sided triangle also the back) lies at the very
//!    place of an earlier triangle's radiating side. Same place means the same three corner positions, as f64 bits with
//!    −0 taken as 0, from whichever corner each begins. The later one is dropped, unless [`RepairOptions`] says to keep
//!    it. So without two-sided triangles a duplicate is a triangle with the same corners *and the same winding*.
//!
//!    A two-sided triangle that shares one side with an earlier one-sided triangle and adds the other is a duplicate
//!    too: it is dropped, and the earlier one becomes two-sided, so that what the file said of the second side holds.
//! 4. **Reversed duplicate**: same corners as an earlier triangle, but none of its sides is there yet: two one-sided
//!    triangles back to back, such as a wall between two rooms. Kept, only counted.
//!
//! Before rules 3 and 4, faces of several triangles are held against each other by their outlines, whatever corner they
//! begin at and whichever diagonal they are cut along: a face in the very place of an earlier one, facing alike, is
//! dropped as in rule 3; one back to back with it is cut into its triangles, turned round, as otherwise each would hide
//! parts of the other.
//!
//! After these rules no two patches of the scene coincide, unless their polygons differ. The rest keep their order and their face numbers.

mod outline;

use crate::{Fate, Kind, Ledger, Scene, Triangle};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BTreeMap;

/// Exceptions from [`repair`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RepairOptions {
    /// Count duplicates, but keep them.
    pub keep_duplicates: bool,
}

/// Triangles of each kind met by [`repair`]; see the [rules](self).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RepairReport {
    /// Dropped: a non-finite coordinate.
    pub non_finite: u64,
    /// Dropped: no area to speak of.
    pub degenerate: u64,
    /// Duplicates met, dropped or not.
    pub duplicates: u64,
    /// Duplicates dropped: all or none.
    pub duplicates_dropped: u64,
    /// Kept: back to back with an earlier triangle.
    pub reversed_duplicates: u64,
    /// Faces of several triangles among the duplicates that differ in their triangles.
    pub duplicate_faces: u64,
    /// Faces of several triangles cut anew, back to back with an earlier face.
    pub reversed_faces: u64,
}

/// Drops triangles that cannot be patches; see the [rules](self).
///
/// ```
/// use hemicube_scene::ReadOptions;
/// use hemicube_scene::obj;
/// use hemicube_scene::repair::{RepairOptions, repair};
///
/// // A triangle, the same again from another corner, its back, and one without area.
/// let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 2 3 1\nf 1 3 2\nf 1 2 4\n";
/// let mut scene = obj::read(text, None, ReadOptions::default())?;
/// let report = repair(&mut scene, RepairOptions::default());
/// assert_eq!((report.duplicates_dropped, report.reversed_duplicates, report.degenerate), (1, 1, 1));
/// assert_eq!(scene.triangles.iter().map(|triangle| triangle.face).collect::<Vec<_>>(), [0, 2]);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn repair(scene: &mut Scene, options: RepairOptions) -> RepairReport {
    let mut report = RepairReport::default();
    let Scene {
        triangles,
        objects,
        ledger,
        ..
    } = scene;
    let place = |triangle: &Triangle| {
        let object = objects.get(triangle.object as usize).map_or("", String::as_str);
        let name: String = object
            .chars()
            .filter(|&c| !crate::is_unseen(c))
            .take(NAME_SHOWN)
            .collect();
        let face = triangle.face;
        if name.is_empty() {
            format!("face {face}")
        } else {
            format!("`{name}`, face {face}")
        }
    };
    triangles.retain(|triangle| {
        if !triangle.corners.iter().all(|corner| corner.is_finite()) {
            report.non_finite += 1;
            ledger.lose(NOT_FINITE, 1, None, || place(triangle));
            return false;
        }
        let degenerate = Shape::of(&triangle.corners).is_degenerate();
        report.degenerate += u64::from(degenerate);
        if degenerate {
            ledger.lose(DEGENERATE, 1, Some(0.0), || place(triangle));
        }
        !degenerate
    });

    let mut dropped = vec![false; triangles.len()];
    settle_faces(triangles, options, &mut dropped, &mut report, ledger, &place);
    drop_marked(triangles, &mut dropped);
    for group in coincident(triangles) {
        settle(triangles, &group, options, &mut dropped, &mut report);
    }
    if !options.keep_duplicates {
        for (triangle, _) in triangles.iter().zip(&dropped).filter(|(_, dropped)| **dropped) {
            let area = Shape::of(&triangle.corners).area();
            ledger.lose(DUPLICATE, 1, Some(area), || place(triangle));
        }
        drop_marked(triangles, &mut dropped);
        report.duplicates_dropped = report.duplicates;
    }
    report
}

/// Most characters of a name in a place.
const NAME_SHOWN: usize = 80;
const NOT_FINITE: Kind<'static> = Kind {
    fate: Fate::LeftOut,
    what: "triangle with coordinates that are not finite",
    next: "",
};
const DEGENERATE: Kind<'static> = Kind {
    fate: Fate::LeftOut,
    what: "triangle without area",
    next: "",
};
const DUPLICATE: Kind<'static> = Kind {
    fate: Fate::Merged,
    what: "triangle in the very place of another",
    next: "",
};
const DUPLICATE_FACE: Kind<'static> = Kind {
    fate: Fate::Merged,
    what: "face in the very place of another, with another first corner or diagonal",
    next: "",
};

fn drop_marked(triangles: &mut Vec<Triangle>, marked: &mut Vec<bool>) {
    if marked.contains(&true) {
        let mut drop = marked.iter();
        triangles.retain(|_| drop.next() != Some(&true));
        *marked = vec![false; triangles.len()];
    }
}

/// Drops faces that lie in the place of earlier ones, and cuts those back to back with them alike. Faces whose
/// triangles are the same are left to the rules of triangles.
fn settle_faces(
    triangles: &mut Vec<Triangle>,
    options: RepairOptions,
    dropped: &mut Vec<bool>,
    report: &mut RepairReport,
    ledger: &mut Ledger,
    place: &impl Fn(&Triangle) -> String,
) {
    let places = |range: std::ops::Range<usize>, all: &[Triangle]| {
        let mut of: Vec<Place> = all[range].iter().map(|triangle| self::place(triangle).0).collect();
        of.sort_unstable();
        of
    };
    // Faces cut anew, by their first triangle: how many there are, and what comes in their place.
    let mut anew: BTreeMap<usize, (usize, Vec<Triangle>)> = BTreeMap::new();
    for group in outline::coincident(triangles) {
        // The faces that radiate from the side of either sense.
        let mut owners: [Option<usize>; 2] = [None, None];
        for (number, face) in group.iter().enumerate() {
            let first = triangles[face.triangles.start];
            let (front, back) = (usize::from(face.is_along), usize::from(!face.is_along));
            let earlier = owners[front].or(owners[back]);
            let Some(earlier) = earlier else {
                owners[front] = Some(number);
                if first.two_sided {
                    owners[back] = Some(number);
                }
                continue;
            };
            let of_earlier = group[earlier].triangles.clone();
            if places(face.triangles.clone(), triangles) == places(of_earlier.clone(), triangles) {
                // Rules 3 and 4 find each of its triangles.
                owners[front] = owners[front].or(Some(number));
                continue;
            }
            let shares = owners[front].is_some() || first.two_sided;
            if shares {
                if options.keep_duplicates {
                    report.duplicates += face.triangles.len() as u64;
                    continue;
                }
                report.duplicates += face.triangles.len() as u64;
                report.duplicate_faces += 1;
                let area = triangles[face.triangles.clone()].iter();
                let area = area.map(|triangle| Shape::of(&triangle.corners).area()).sum();
                ledger.lose(DUPLICATE_FACE, 1, Some(area), || place(&first));
                dropped[face.triangles.clone()].fill(true);
                if first.two_sided && (owners[front].is_none() || owners[back].is_none()) {
                    owners = [Some(earlier); 2];
                    triangles[of_earlier]
                        .iter_mut()
                        .for_each(|triangle| triangle.two_sided = true);
                }
                continue;
            }
            owners[front] = Some(number);
            report.reversed_faces += 1;
            let turned = triangles[of_earlier].iter().map(|triangle| {
                let [a, b, c] = triangle.corners;
                Triangle {
                    corners: [a, c, b],
                    ..first
                }
            });
            anew.insert(face.triangles.start, (face.triangles.len(), turned.collect()));
        }
    }
    if anew.is_empty() {
        return;
    }
    let old = std::mem::take(triangles);
    let marked = std::mem::take(dropped);
    let mut at = 0;
    while at < old.len() {
        if let Some((count, mut now)) = anew.remove(&at) {
            dropped.resize(dropped.len() + now.len(), false);
            triangles.append(&mut now);
            at += count;
        } else {
            dropped.push(marked[at]);
            triangles.push(old[at]);
            at += 1;
        }
    }
}

/// Longest edge and height of a triangle with finite corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shape {
    /// The longest edge.
    pub(crate) longest: f64,
    /// The height over it.
    pub(crate) height: f64,
    /// Rounding of the coordinates: no smaller height can be told from it.
    noise: f64,
    /// Powers of two from these units to the scene's, applied one after the other lest their product overflow.
    units: [f64; 2],
}

impl Shape {
    pub(crate) fn of(corners: &[DVec3; 3]) -> Self {
        let [a, b, c] = *corners;
        // In units of about the extent, so that no product of four lengths leaves the range of f64.
        let (unit, [u, v]) = relative(a, [b, c]);
        let mut edges = [u, v - u, v].map(|edge| (edge.length(), edge));
        edges.sort_by(|p, q| p.0.total_cmp(&q.0));
        let [(_, p), (_, q), (longest, _)] = edges;
        // The two shorter edges: their product is rounded least.
        let doubled_area = p.cross(q).length();
        let largest = corners.iter().fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
        Self {
            longest,
            height: if longest > 0.0 { doubled_area / longest } else { 0.0 },
            noise: 4.0 * f64::EPSILON * (0.5 * largest / unit),
            units: [unit, 2.0],
        }
    }

    pub(crate) fn is_degenerate(&self) -> bool {
        self.height <= (1e-12 * self.longest).max(self.noise)
    }

    /// Longest edge by height.
    pub(crate) fn aspect(&self) -> f64 {
        self.longest / self.height
    }

    /// The area, in the scene's unit squared.
    pub(crate) fn area(&self) -> f64 {
        let [p, q] = self.units;
        0.5 * (self.longest * p * q) * (self.height * p * q)
    }
}

/// A power of two `unit` of about half the points' extent, and the points relative to `origin` in units of 2 · `unit`.
pub(crate) fn relative<const N: usize>(origin: DVec3, points: [DVec3; N]) -> (f64, [DVec3; N]) {
    let halves = points.map(|p| half_difference(p, origin));
    let extent = halves.iter().fold(0.0_f64, |m, d| m.max(d.abs().max_element()));
    let unit = power_of_two(extent);
    (unit, halves.map(|d| d / unit))
}

/// (p − origin) / 2: finite for finite p and origin.
pub(crate) fn half_difference(p: DVec3, origin: DVec3) -> DVec3 {
    0.5 * p - 0.5 * origin
}

/// The largest power of two up to `x`, or the smallest normal one.
pub(crate) fn power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & (0x7FF << 52)).max(f64::MIN_POSITIVE)
}

/// Corner positions in an order common to all triangles with these corners, and whether the winding is that order's.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Place([[u64; 3]; 3]);

fn place(triangle: &Triangle) -> (Place, bool) {
    // Adding 0 turns −0 into 0 and leaves all else.
    let mut corners = triangle.corners.map(|p| (p + 0.0).to_array().map(f64::to_bits));
    let mut even = true;
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if corners[i] > corners[j] {
            corners.swap(i, j);
            even = !even;
        }
    }
    (Place(corners), even)
}

/// A number equal for equal places, so that sorting seldom compares all nine coordinates.
fn digest(Place(corners): &Place) -> u64 {
    corners.as_flattened().iter().fold(0, |hash: u64, &bits| {
        let mixed = (hash ^ bits).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        mixed ^ (mixed >> 29)
    })
}

/// Groups of triangles with the same corner positions, of two and more, each in the order of the scene.
fn coincident(triangles: &[Triangle]) -> Vec<Vec<usize>> {
    let mut order: Vec<(u64, usize)> = triangles
        .iter()
        .enumerate()
        .map(|(i, t)| (digest(&place(t).0), i))
        .collect();
    let same_place = |&(_, i): &(u64, usize), &(_, j): &(u64, usize)| match (triangles.get(i), triangles.get(j)) {
        (Some(a), Some(b)) => place(a).0.cmp(&place(b).0),
        _ => Ordering::Equal,
    };
    // A full order, however digests collide: input made to collide costs no more than sorting.
    order.sort_unstable_by(|a, b| a.0.cmp(&b.0).then_with(|| same_place(a, b)).then(a.1.cmp(&b.1)));
    order
        .chunk_by(|a, b| a.0 == b.0 && same_place(a, b).is_eq())
        .filter(|group| group.len() > 1)
        .map(|group| group.iter().map(|&(_, i)| i).collect())
        .collect()
}

/// Rules 3 and 4 on triangles of one place, in the order of the scene.
fn settle(
    triangles: &mut [Triangle],
    group: &[usize],
    options: RepairOptions,
    dropped: &mut [bool],
    report: &mut RepairReport,
) {
    // The triangle radiating from the side of either winding.
    let mut owners: [Option<usize>; 2] = [None, None];
    for &i in group {
        let front = usize::from(place(&triangles[i]).1);
        let back = 1 - front;
        let two_sided = triangles[i].two_sided;
        let shares = owners[front].is_some() || (two_sided && owners[back].is_some());
        if !shares {
            report.reversed_duplicates += u64::from(owners[back].is_some());
            owners[front] = Some(i);
            if two_sided {
                owners[back] = Some(i);
            }
            continue;
        }
        report.duplicates += 1;
        dropped[i] = true;
        if two_sided && let (Some(owner), None) | (None, Some(owner)) = (owners[front], owners[back]) {
            owners = [Some(owner); 2];
            // Kept duplicates radiate for themselves.
            if !options.keep_duplicates {
                triangles[owner].two_sided = true;
            }
        }
    }
}
