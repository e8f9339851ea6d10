//! The arithmetic of a lane, beside what compiles code for several instruction sets.

pub(crate) use hemicube_spatial::simd::{InstructionSet, dispatch};

/// The lesser of two numbers; `q` where one is NaN. One instruction of every set, unlike [`f64::min`].
#[inline(always)]
pub(crate) fn least(p: f64, q: f64) -> f64 {
    if p < q { p } else { q }
}

/// The greater of two numbers; `q` where one is NaN.
#[inline(always)]
pub(crate) fn most(p: f64, q: f64) -> f64 {
    if p > q { p } else { q }
}

/// p + q.
#[inline(always)]
pub(crate) fn plus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[0] + q[0], p[1] + q[1], p[2] + q[2]]
}

/// p − q.
#[inline(always)]
pub(crate) fn minus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[0] - q[0], p[1] - q[1], p[2] - q[2]]
}

/// p · q.
#[inline(always)]
pub(crate) fn dot(p: [f64; 3], q: [f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

/// p × q.
#[inline(always)]
pub(crate) fn cross(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    ]
}

/// A bit for each lane that is not 0.
#[inline(always)]
pub(crate) fn mask(lanes: &[u64; 16]) -> u16 {
    let mut mask = 0;
    for (l, &lane) in lanes.iter().enumerate() {
        mask |= u16::from(lane != 0) << l;
    }
    mask
}

/// The lanes whose bits are set, ascending.
#[inline(always)]
pub(crate) fn lanes(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            lane
        })
    })
}
