//! Codes and orders: round trips, monotony, locality.

use hemicube_spatial::glam::DVec3;
use hemicube_spatial::{Aabb, invert, morton, order_by_normal_and_position, order_by_position};
use proptest::prelude::*;

fn cell() -> impl Strategy<Value = [u32; 3]> {
    [0..morton::CELL_COUNT, 0..morton::CELL_COUNT, 0..morton::CELL_COUNT]
}

fn point() -> impl Strategy<Value = DVec3> {
    [0.0..=1.0, 0.0..=1.0, 0.0..=1.0].prop_map(DVec3::from_array)
}

/// Vectors of all lengths and directions, the flat and the axis-aligned more often than chance would.
fn vector() -> impl Strategy<Value = DVec3> {
    let component = || prop_oneof![3 => -1.0..1.0, 1 => Just(0.0), 1 => -1e-12..1e-12];
    ([component(), component(), component()], -200i32..200)
        .prop_map(|(v, scale)| DVec3::from_array(v) * 10f64.powi(scale))
}

proptest! {
    #[test]
    fn decode_undoes_encode(cell in cell()) {
        let code = morton::encode(cell);
        prop_assert!(code < 1 << 63);
        prop_assert_eq!(morton::decode(code), cell);
    }

    #[test]
    fn encode_undoes_decode(code in 0..1u64 << 63) {
        prop_assert_eq!(morton::encode(morton::decode(code)), code);
    }

    /// What grows on every axis grows in the code, and strictly if it grows at all.
    #[test]
    fn codes_are_monotone(a in cell(), b in cell()) {
        let low = [0, 1, 2].map(|axis| a[axis].min(b[axis]));
        prop_assert!(morton::encode(low) <= morton::encode(a));
        prop_assert_eq!(morton::encode(low) == morton::encode(a), low == a);
    }

    /// Two cells share the leading 3·level bits just when they lie in one cell of that level: this is the locality.
    #[test]
    fn a_prefix_is_a_cell(a in cell(), step in cell(), keep in 0..=21u32, level in 0..=21u32) {
        let b = [0, 1, 2].map(|axis| a[axis] ^ step[axis] & ((1 << (21 - keep)) - 1));
        let shift = 21 - level;
        let same_cell = a.map(|c| c >> shift) == b.map(|c| c >> shift);
        let same_prefix = morton::encode(a) >> (3 * shift) == morton::encode(b) >> (3 * shift);
        prop_assert_eq!(same_cell, same_prefix);
        prop_assert!(level > keep || same_cell);
    }

    #[test]
    fn quantise_finds_the_cell_that_holds_the_point(x in 0.0..1.0) {
        let (cell, cells) = (f64::from(morton::quantise(x)), f64::from(morton::CELL_COUNT));
        prop_assert!(cell / cells <= x && x < (cell + 1.0) / cells);
    }

    #[test]
    fn a_normal_is_near_the_middle_of_its_code(normal in vector()) {
        let code = morton::normal_code(normal);
        if normal == DVec3::ZERO {
            prop_assert_eq!(code, morton::NO_NORMAL);
        } else {
            let middle = morton::normal_from_code(code).expect("a code of a normal");
            let unit = (normal / normal.abs().max_element()).normalize();
            let angle = unit.cross(middle).length().atan2(unit.dot(middle)).to_degrees();
            prop_assert!(angle < 20.0, "{} is {}° from {}", unit, angle, middle);
            prop_assert_eq!(morton::normal_code(middle), code);
        }
    }

    #[test]
    fn orders_are_sorted_permutations(items in prop::collection::vec((vector(), point()), 0..200)) {
        let (normals, positions): (Vec<_>, Vec<_>) = items.into_iter().unzip();
        let unit = Aabb { min: DVec3::ZERO, max: DVec3::ONE };
        let order = order_by_normal_and_position(&normals, &positions, unit);
        let places = invert(&order);
        for (place, &index) in (0..).zip(&order) {
            prop_assert_eq!(places[index as usize], place);
        }
        let key = |index: u32| {
            let index = index as usize;
            (morton::normal_code(normals[index]), morton::position_code(positions[index]), index)
        };
        prop_assert!(order.windows(2).all(|pair| key(pair[0]) < key(pair[1])));
        let order = order_by_position(&positions, unit);
        prop_assert!(order.windows(2).all(|pair| (key(pair[0]).1, pair[0]) < (key(pair[1]).1, pair[1])));
    }
}

/// Every code that a normal can have leads to a direction, and the directions cover the sphere evenly enough.
#[test]
fn codes_of_normals_are_as_many_as_their_cells() {
    let middles: Vec<DVec3> = (0..=morton::NO_NORMAL).filter_map(morton::normal_from_code).collect();
    // 11² cells off the border; of the 11 on each edge five pairs are one each and the middle is its own; the four
    // corners are one.
    assert_eq!(middles.len(), 11 * 11 + 4 * 6 + 1);
    let mean: DVec3 = middles.iter().sum::<DVec3>() / 146.0;
    assert!(mean.length() < 1e-12, "{mean}");
}

#[test]
fn neighbours_in_order_are_near() {
    let mut state = 1u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        f64::from(u32::try_from(state >> 32).expect("32 bits")) / f64::from(u32::MAX)
    };
    let positions: Vec<DVec3> = (0..10_000).map(|_| DVec3::new(random(), random(), random())).collect();
    let path = |order: &[u32]| -> f64 {
        order
            .windows(2)
            .map(|pair| positions[pair[0] as usize].distance(positions[pair[1] as usize]))
            .sum()
    };
    let unsorted: Vec<u32> = (0..10_000).collect();
    let sorted = order_by_position(&positions, Aabb::from_points(positions.iter().copied()));
    let ratio = path(&unsorted) / path(&sorted);
    assert!(ratio > 8.0, "the way through all points is only {ratio} times as short");
}
