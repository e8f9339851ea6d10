//! Legs that the bands of a row have in common.
//!
//! Rays through portals are of each band, because they end by its weights and their number is by its error. But bands
//! cast the same rays from the same sequences, and what a leg meets first depends on the scene alone: legs of a row's
//! first band are kept by their ends, and taken from there by the others. So a band's row is the one that it has
//! alone, to the bit, however many of its legs are known.

use crate::bvh::{LANES, Tree};
use crate::geometry::Plane;
use crate::visibility::nearest::{Met, nearest};
use glam::DVec3;

/// Legs kept of a row at most: 4 MiB. Of a row of more, those kept first are known.
const MOST: usize = 1 << 15;
/// Places looked at for a leg.
const PROBES: usize = 4;
/// The slot of a leg that meets nothing.
const NOTHING: u32 = u32::MAX;

/// Both ends and the plane that a leg leaves, bit by bit.
type Key = [u64; 10];

#[derive(Clone, Copy, Debug)]
struct Leg {
    key: Key,
    /// The row that it is of.
    row: u64,
    slot: u32,
    id: u32,
    place: f64,
}

/// What the legs of a row met; one a thread.
#[derive(Debug, Default)]
pub(super) struct KnownLegs {
    /// By a hash of the key; empty where none are kept.
    legs: Vec<Leg>,
    row: u64,
}

impl KnownLegs {
    /// `is_kept`: there are bands to share them.
    pub(super) fn new(is_kept: bool) -> Self {
        let none = Leg {
            key: [0; 10],
            row: 0,
            slot: NOTHING,
            id: 0,
            place: 0.0,
        };
        Self {
            legs: vec![none; if is_kept { MOST } else { 0 }],
            row: 0,
        }
    }

    /// Forgets the legs of the rows before.
    pub(super) fn begin_row(&mut self) {
        self.row += 1;
    }

    /// The first triangle on a leg, as [`nearest`] finds it.
    pub(super) fn nearest(
        &mut self,
        tree: &Tree,
        [start, end]: [DVec3; 2],
        horizon: &Plane,
        pending: &mut Vec<u32>,
    ) -> Option<Met> {
        if self.legs.is_empty() {
            return nearest(tree, [start, end], horizon, |_| false, pending);
        }
        let key = key(start, end, horizon);
        let first = place(&key);
        let mut free = None;
        for probe in 0..PROBES {
            let at = (first + probe) % MOST;
            let leg = &self.legs[at];
            if leg.row != self.row {
                free = Some(at);
                break;
            }
            if leg.key == key {
                let slot = leg.slot as usize;
                return (leg.slot != NOTHING).then(|| Met {
                    place: leg.place,
                    id: leg.id,
                    slot: leg.slot,
                    corners: tree.blocks[slot / LANES].triangle(slot % LANES),
                });
            }
        }
        let met = nearest(tree, [start, end], horizon, |_| false, pending);
        if let Some(at) = free {
            let (slot, id, place) = met.map_or((NOTHING, 0, 0.0), |met| (met.slot, met.id, met.place));
            self.legs[at] = Leg {
                key,
                row: self.row,
                slot,
                id,
                place,
            };
        }
        met
    }
}

fn key(start: DVec3, end: DVec3, horizon: &Plane) -> Key {
    let ([a, b, c], [d, e, f]) = (start.to_array(), end.to_array());
    let [x, y, z] = horizon.normal.to_array();
    [a, b, c, d, e, f, x, y, z, horizon.offset].map(f64::to_bits)
}

/// The place of a key in the table.
fn place(key: &Key) -> usize {
    // The plane belongs to the start.
    let mixed = key[..6].iter().fold(0_u64, |hash, &bits| {
        (hash.rotate_left(23) ^ bits).wrapping_mul(0x9E37_79B9_7F4A_7C15)
    });
    #[allow(clippy::cast_possible_truncation, reason = "the upper bits")]
    let place = (mixed >> 40) as usize;
    place % MOST
}
