//! Corners of the patches for a page: on a grid of 2¹⁶ steps along each edge of the scene's box, equal places shared.

use super::blocks::Blocks;
use crate::prepare::Prepared;
use glam::DVec3;
use hemicube_spatial::whole;
use std::collections::HashMap;

const STEPS: f64 = 65535.0;

/// The scene's box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Bounds {
    /// The widest step of the grid: by half of it at most is a corner off, along each axis.
    pub(super) fn step(&self) -> f64 {
        (self.high - self.low).max_element() / STEPS
    }

    fn grid(&self, corner: DVec3) -> [u16; 3] {
        let (place, extent) = ((corner - self.low).to_array(), (self.high - self.low).to_array());
        [0, 1, 2].map(|axis| {
            // Along an axis, a flat scene has one place.
            if extent[axis] > 0.0 {
                whole::to_u16((place[axis] / extent[axis] * STEPS).round().clamp(0.0, STEPS))
            } else {
                0
            }
        })
    }
}

/// Writes `corners` and `triangles`, three numbers of corners a patch.
pub(super) fn write(prepared: &Prepared, blocks: &mut Blocks) -> Bounds {
    let patches = &prepared.patches;
    let corners = || patches.surfaces().iter().flatten().copied();
    let bounds = Bounds {
        low: corners().fold(DVec3::INFINITY, DVec3::min),
        high: corners().fold(DVec3::NEG_INFINITY, DVec3::max),
    };
    let mut places: HashMap<[u16; 3], u32> = HashMap::new();
    let (mut grid, mut triangles) = (Vec::new(), Vec::with_capacity(3 * patches.len()));
    for patch in patches.iter() {
        for corner in patches.corners(patch) {
            let place = bounds.grid(corner);
            let next = u32::try_from(places.len()).unwrap_or(u32::MAX);
            let number = *places.entry(place).or_insert_with(|| {
                grid.extend(place);
                next
            });
            triangles.push(number);
        }
    }
    blocks.array("corners", &grid);
    blocks.array("triangles", &triangles);
    bounds
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_half_a_step_off_at_most() {
        let bounds = Bounds {
            low: DVec3::new(-3.0, 0.0, 7.0),
            high: DVec3::new(97.0, 10.0, 7.0),
        };
        assert_eq!(bounds.grid(bounds.low), [0, 0, 0]);
        assert_eq!(bounds.grid(bounds.high), [65535, 65535, 0]);
        for k in 0..1000 {
            let corner = DVec3::new(-3.0 + 0.0999 * f64::from(k), 0.00987 * f64::from(k), 7.0);
            let grid = bounds.grid(corner);
            for (axis, &place) in grid.iter().enumerate() {
                let extent = (bounds.high - bounds.low)[axis];
                let back = bounds.low[axis] + f64::from(place) / STEPS * extent;
                assert!((back - corner[axis]).abs() <= 0.5001 * bounds.step(), "{corner} {axis}");
            }
        }
    }
}
