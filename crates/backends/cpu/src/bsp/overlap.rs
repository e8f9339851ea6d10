//! Pairs of overlapping surfaces in a plane.

use super::piece::Bounds;
use glam::DVec3;

/// Most overlapping pairs in a plane: for each surface, and in addition. A plane with more is a heap of copies, with as
/// many layers.
const PAIRS_OF_EACH: usize = 16;
const PAIRS_BESIDE: usize = 10_000;

/// Places of two items.
pub(super) type Pair = (usize, usize);

/// Box of a surface in its plane, seen along the axis that the plane faces most.
#[derive(Clone, Copy)]
struct Flat {
    place: usize,
    low: [f64; 2],
    high: [f64; 2],
}

impl Flat {
    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|a| self.low[a] < other.high[a] && other.low[a] < self.high[a])
    }

    fn around(items: &[Self]) -> Self {
        let mut around = Self {
            place: 0,
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        };
        for item in items {
            for a in 0..2 {
                around.low[a] = around.low[a].min(item.low[a]);
                around.high[a] = around.high[a].max(item.high[a]);
            }
        }
        around
    }
}

/// Sorts items so that halves of halves lie apart.
fn halve(items: &mut [Flat]) {
    if items.len() <= FEW {
        return;
    }
    let around = Flat::around(items);
    let axis = usize::from(around.high[1] - around.low[1] > around.high[0] - around.low[0]);
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |p, q| {
        (p.low[axis] + p.high[axis])
            .total_cmp(&(q.low[axis] + q.high[axis]))
            .then(p.place.cmp(&q.place))
    });
    let (first, second) = items.split_at_mut(middle);
    halve(first);
    halve(second);
}

/// Up to this number, items are compared each with each.
const FEW: usize = 8;

/// Finds the pairs of items in a plane with a common inside; `None` if there are too many.
pub(super) fn overlaps(
    items: &[u32],
    normal: DVec3,
    touch: f64,
    corners: impl Fn(u32) -> [DVec3; 3],
) -> Option<Vec<Pair>> {
    if items.len() < 2 {
        return Some(Vec::new());
    }
    let size = normal.abs();
    let (u, v) = if size.x >= size.y && size.x >= size.z {
        (1, 2)
    } else if size.y >= size.z {
        (0, 2)
    } else {
        (0, 1)
    };
    let flat = items.iter().enumerate().map(|(place, &item)| {
        let b = Bounds::of(&corners(item));
        Flat {
            place,
            low: [b.low[u] + touch, b.low[v] + touch],
            high: [b.high[u] - touch, b.high[v] - touch],
        }
    });
    let mut flat: Vec<Flat> = flat.collect();
    halve(&mut flat);
    let most = PAIRS_OF_EACH * items.len() + PAIRS_BESIDE;
    let mut found = Vec::new();
    // Halve two sets with boxes that meet, or one set with itself, until few are left.
    let mut pending = vec![(0..flat.len(), 0..flat.len())];
    while let Some((first, second)) = pending.pop() {
        let with_itself = first == second;
        if !with_itself && !Flat::around(&flat[first.clone()]).meets(&Flat::around(&flat[second.clone()])) {
            continue;
        }
        let halves = |range: &std::ops::Range<usize>| {
            let middle = range.start + range.len() / 2;
            if range.len() > FEW {
                [range.start..middle, middle..range.end]
            } else {
                [range.clone(), range.end..range.end]
            }
        };
        if first.len() > FEW || second.len() > FEW {
            let ([a, b], [c, d]) = (halves(&first), halves(&second));
            let pairs = if with_itself {
                vec![(a.clone(), a), (b.clone(), b.clone()), (c, b)]
            } else {
                vec![(a.clone(), c.clone()), (a, d.clone()), (b.clone(), c), (b, d)]
            };
            pending.extend(pairs.into_iter().filter(|(p, q)| !p.is_empty() && !q.is_empty()));
            continue;
        }
        for p in first.clone() {
            for q in if with_itself { p + 1..first.end } else { second.clone() } {
                let (p, q) = (&flat[p], &flat[q]);
                let overlap = p.meets(q)
                    && hemicube_contract::bvh::overlap(
                        &corners(items[p.place]),
                        &corners(items[q.place]),
                        normal,
                        touch,
                    );
                if overlap {
                    found.push((p.place.min(q.place), p.place.max(q.place)));
                }
            }
        }
        if found.len() > most {
            return None;
        }
    }
    // Restore the order of the items.
    found.sort_unstable();
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsp::Lcg;

    #[test]
    fn overlaps_are_those_of_all_pairs() {
        let mut draw = Lcg(5);
        let mut coordinate = |most: f64| draw.below(1 << 20) as f64 / f64::from(1 << 20) * most;
        let triangles: Vec<[DVec3; 3]> = (0..300)
            .map(|_| {
                let at = DVec3::new(coordinate(8.0), coordinate(8.0), 0.0);
                [0, 1, 2].map(|_| at + DVec3::new(coordinate(0.7), coordinate(0.7), 0.0))
            })
            .collect();
        let items: Vec<u32> = (0..300).collect();
        let of = |i: u32| triangles[i as usize];
        let mut each: Vec<(usize, usize)> = Vec::new();
        for p in 0..300usize {
            for q in p + 1..300 {
                if hemicube_contract::bvh::overlap(&triangles[p], &triangles[q], DVec3::Z, 1e-10) {
                    each.push((p, q));
                }
            }
        }
        assert!(each.len() > 100, "{}", each.len());
        assert_eq!(overlaps(&items, DVec3::Z, 1e-10, of), Some(each));
    }

    #[test]
    fn a_heap_of_copies_is_given_up() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let items: Vec<u32> = (0..4000).collect();
        assert_eq!(overlaps(&items, DVec3::Z, 1e-10, |_| triangle), None);
    }

    #[test]
    fn overlapping_surfaces_in_a_plane_lie_in_layers() {
        let square = |x: f64, z: f64| {
            [
                DVec3::new(x, 0.0, z),
                DVec3::new(x + 1.0, 0.0, z),
                DVec3::new(x, 1.0, z),
            ]
        };
        let triangles = [square(0.0, 0.0), square(0.5, 0.0), square(2.0, 0.0)];
        let of = |i: u32| triangles[i as usize];
        assert_eq!(overlaps(&[0, 1, 2], DVec3::Z, 1e-10, of), Some(vec![(0, 1)]));
        assert_eq!(overlaps(&[0, 2], DVec3::Z, 1e-10, of), Some(Vec::new()));
    }
}
