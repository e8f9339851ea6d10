//! Orders along the Morton curve: by normal first and then position (the order of work of a form-factor matrix), or by
//! position alone.
//!
//! An order is a permutation: `order[k]` is the input index of the k-th item.
//!
//! No internal patch ids, because renumbering every row costs a sort of it, and ids do nothing for the rasteriser: the
//! patch's position in the input is its id everywhere. "The smaller id wins" at equal depths then means the first in
//! the file. The order of work (Morton, by normal and position) is a list beside it.

use crate::Aabb;
use crate::morton::{Cube, normal_code};
use glam::DVec3;

/// Items in the Morton order of their normals' directions (see [`normal_code`]), those of one direction in the Morton
/// order of their positions, the rest by input index.
///
/// The codes of position are taken in the cube over `bounds` ([`Cube::around`]); positions outside go to its nearest
/// cell, a NaN coordinate to the first. Normals may have any length; those without direction come last.
///
/// # Panics
/// When the two slices differ in length, or there are 2³² items or more.
///
/// ```
/// use hemicube_spatial::{Aabb, glam::DVec3, order_by_normal_and_position};
/// let normals = [DVec3::Z, -DVec3::Z, DVec3::Z];
/// let positions = [DVec3::ONE, DVec3::ONE * 0.5, DVec3::ZERO];
/// let order = order_by_normal_and_position(&normals, &positions, Aabb::from_points(positions));
/// assert_eq!(order, [2, 0, 1]);
/// ```
pub fn order_by_normal_and_position(normals: &[DVec3], positions: &[DVec3], bounds: Aabb) -> Vec<u32> {
    assert_eq!(normals.len(), positions.len(), "every position needs one normal");
    let cube = Cube::around(bounds);
    sort(
        normals
            .iter()
            .zip(positions)
            .map(|(&n, &p)| (normal_code(n), cube.position_code(p))),
    )
}

/// Items in the Morton order of their positions, ties by input index; for `bounds`, positions outside it and NaN see
/// [`order_by_normal_and_position`].
///
/// # Panics
/// When there are 2³² items or more.
pub fn order_by_position(positions: &[DVec3], bounds: Aabb) -> Vec<u32> {
    let cube = Cube::around(bounds);
    sort(positions.iter().map(|&p| (0, cube.position_code(p))))
}

/// One key holds all, so that an unstable sort of plain integers has one outcome:
///
/// ```text
/// bits  103 … 95      94 … 32         31 … 0
///       normal (9)    position (63)   input index (32)
/// ```
fn sort(codes: impl ExactSizeIterator<Item = (u32, u64)>) -> Vec<u32> {
    assert!(
        u32::try_from(codes.len()).is_ok(),
        "the count of items must fit 32 bits"
    );
    let key = |(index, (normal, position)): (u32, (u32, u64))| {
        u128::from(normal) << 95 | u128::from(position) << 32 | u128::from(index)
    };
    let mut keys: Vec<u128> = (0..u32::MAX).zip(codes).map(key).collect();
    keys.sort_unstable();
    #[allow(clippy::cast_possible_truncation, reason = "the low 32 bits are the index")]
    keys.into_iter().map(|key| key as u32).collect()
}

/// The inverse permutation: `invert(order)[i]` is the place of input item i in the order.
///
/// # Panics
/// When `order` is not a permutation of `0..order.len()`, or has 2³² items or more.
pub fn invert(order: &[u32]) -> Vec<u32> {
    // With fewer than 2³² items none has this place, so it marks a vacant one.
    const VACANT: u32 = u32::MAX;
    assert!(
        u32::try_from(order.len()).is_ok(),
        "the count of items must fit 32 bits"
    );
    let mut places = vec![VACANT; order.len()];
    for (place, &index) in (0..VACANT).zip(order) {
        match places.get_mut(index as usize) {
            Some(slot) if *slot == VACANT => *slot = place,
            Some(_) => panic!("`order` is not a permutation: {index} is in it twice"),
            None => panic!(
                "`order` is not a permutation: {index} is not below its length {}",
                order.len()
            ),
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Aabb = Aabb {
        min: DVec3::ZERO,
        max: DVec3::ONE,
    };

    #[test]
    fn nothing_and_one_are_orders() {
        assert!(order_by_position(&[], Aabb::EMPTY).is_empty());
        assert!(order_by_normal_and_position(&[], &[], UNIT).is_empty());
        assert!(invert(&[]).is_empty());
        assert_eq!(order_by_position(&[DVec3::NAN], Aabb::EMPTY), [0]);
    }

    #[test]
    fn ties_go_to_the_smaller_index() {
        let positions = [DVec3::splat(0.3); 40];
        let expected: Vec<u32> = (0..40).collect();
        assert_eq!(order_by_position(&positions, UNIT), expected);
        assert_eq!(
            order_by_normal_and_position(&[DVec3::Y; 40], &positions, UNIT),
            expected
        );
        let flat = Aabb::from_points(positions);
        assert_eq!(order_by_position(&positions, flat), expected, "bounds without extent");
    }

    #[test]
    fn the_normal_counts_before_the_position_and_none_comes_last() {
        let normals = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X];
        let positions = [DVec3::ZERO, DVec3::ONE, DVec3::splat(0.5), DVec3::ZERO];
        let order = order_by_normal_and_position(&normals, &positions, UNIT);
        let places = invert(&order);
        assert_eq!(places[0], 3);
        assert_eq!(
            places[3] + 1,
            places[1],
            "the two normals along x are neighbours, the lower position first"
        );
    }

    #[test]
    fn position_order_is_that_of_the_octants() {
        let corners: Vec<DVec3> = (0..8)
            .rev()
            .map(|o| DVec3::new(f64::from(o & 1), f64::from(o >> 1 & 1), f64::from(o >> 2)))
            .collect();
        assert_eq!(order_by_position(&corners, UNIT), [7, 6, 5, 4, 3, 2, 1, 0]);
    }

    #[test]
    #[should_panic(expected = "every position needs one normal")]
    fn slices_must_match() {
        order_by_normal_and_position(&[DVec3::X], &[], UNIT);
    }

    #[test]
    #[should_panic(expected = "1 is in it twice")]
    fn invert_refuses_a_repetition() {
        invert(&[0, 1, 1]);
    }

    #[test]
    #[should_panic(expected = "3 is not below its length 3")]
    fn invert_refuses_an_index_beyond() {
        invert(&[0, 1, 3]);
    }
}
