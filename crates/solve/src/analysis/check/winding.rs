//! A model wound outwards, told from its matrix: a closed surface that sees nothing, around all that sees something.
//!
//! ```text
//! shell    rows with escaped ≥ 0.99; inside: rows with escaped ≤ 0.01; no others, up to 1 % of the area
//! closed   |Σ A n| ≤ 0.05 Σ A, of the shell and of the inside
//! outwards V = ⅓ Σ A n · (c − c₀) > 0 of the shell (divergence theorem), c the centroids and c₀ their mean
//! around   the inside lies within the shell's box, and its |V| is at most half of the shell's
//! ```
//!
//! The last line leaves out a solid with rooms in it, which is right from both sides: the rooms fill most of it. A
//! shell without an inside is an empty matrix, which fails by itself.

use glam::DVec3;
use hemicube_store::{PatchTable, RowShares};

/// Escaped share from which on a row sees nothing; an inside row has at most the rest.
const ESCAPES: f64 = 0.99;
/// Share of the area of rows that are neither.
const NEITHER: f64 = 0.01;
/// |Σ A n| of a closed surface, as a share of Σ A: a room may have a door.
const CLOSED: f64 = 0.05;
/// Volume inside, as a share of the shell's.
const VOLUME: f64 = 0.5;

/// The side of the model that a row looks to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Looks {
    #[default]
    Unknown,
    Out,
    In,
    Both,
}

/// The rows seen so far.
#[derive(Debug, Default)]
pub(super) struct Sides {
    looks: Vec<Looks>,
}

/// The surface wound outwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outwards {
    /// The shell, and all inside.
    All,
    /// The shell alone.
    Shell,
}

impl Sides {
    /// For so many patches.
    pub(super) fn new(patches: usize) -> Self {
        Self {
            looks: vec![Looks::Unknown; patches],
        }
    }

    /// Takes a rendered row.
    pub(super) fn add(&mut self, patch: u32, shares: RowShares) {
        if let Some(looks) = self.looks.get_mut(patch as usize) {
            *looks = if shares.escaped >= ESCAPES {
                Looks::Out
            } else if shares.escaped <= 1.0 - ESCAPES {
                Looks::In
            } else {
                Looks::Both
            };
        }
    }

    /// The surface wound outwards; `None` where there is none, or rows are missing.
    pub(super) fn outwards(&self, table: &PatchTable) -> Option<Outwards> {
        if self.looks.contains(&Looks::Unknown) || self.looks.len() != table.len() {
            return None;
        }
        let of = |looks| Surface::of(table, self.looks.iter().map(move |found| *found == looks));
        let (shell, inside, both) = (of(Looks::Out), of(Looks::In), of(Looks::Both));
        let whole = shell.area + inside.area + both.area;
        let is_around = inside.area > 0.0
            && both.area <= NEITHER * whole
            && shell.is_closed()
            && inside.is_closed()
            && shell.volume > 0.0
            && inside.volume.abs() <= VOLUME * shell.volume
            && inside.low.cmpge(shell.low).all()
            && inside.high.cmple(shell.high).all();
        is_around.then_some(if inside.volume < 0.0 {
            Outwards::All
        } else {
            Outwards::Shell
        })
    }
}

/// Area, closure, volume and box of some patches.
#[derive(Clone, Copy, Debug)]
struct Surface {
    area: f64,
    /// Σ A n.
    vector: DVec3,
    volume: f64,
    /// Box of the centroids.
    low: DVec3,
    high: DVec3,
}

impl Surface {
    fn of(table: &PatchTable, chosen: impl Iterator<Item = bool> + Clone) -> Self {
        let mut found = Self {
            area: 0.0,
            vector: DVec3::ZERO,
            volume: 0.0,
            low: DVec3::INFINITY,
            high: DVec3::NEG_INFINITY,
        };
        let list = || {
            let of = chosen.clone().enumerate().filter(|(_, is_chosen)| *is_chosen);
            of.map(|(patch, _)| {
                let normal = DVec3::from_array(table.normal[patch]);
                (table.area[patch], DVec3::from_array(table.centroid[patch]), normal)
            })
        };
        let mut middle = DVec3::ZERO;
        for (area, centroid, normal) in list() {
            found.area += area;
            found.vector += area * normal;
            middle += area * centroid;
            found.low = found.low.min(centroid);
            found.high = found.high.max(centroid);
        }
        if found.area > 0.0 {
            middle /= found.area;
        }
        // About the middle: what an open end leaves is small.
        found.volume = list()
            .map(|(area, centroid, normal)| area * normal.dot(centroid - middle) / 3.0)
            .sum();
        found
    }

    fn is_closed(&self) -> bool {
        self.area > 0.0 && self.vector.length() <= CLOSED * self.area
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six squares of a cube of this edge about `middle`, outwards by `side` 1 and inwards by −1.
    fn cube(table: &mut PatchTable, middle: DVec3, edge: f64, side: f64) {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            for sign in [1.0, -1.0] {
                table.area.push(edge * edge);
                table.centroid.push((middle + axis * sign * edge / 2.0).to_array());
                table.normal.push((axis * sign * side).to_array());
            }
        }
        let count = table.area.len();
        table.object.resize(count, 0);
        table.material.resize(count, 0);
        table.face.resize(count, 0);
        table.side.resize(count, 0);
    }

    fn found(cubes: &[(DVec3, f64, f64)], escaped: &[f64]) -> Option<Outwards> {
        let mut table = PatchTable::default();
        for &(middle, edge, side) in cubes {
            cube(&mut table, middle, edge, side);
        }
        let mut sides = Sides::new(table.len());
        for (patch, escaped) in (0..).zip(escaped.iter().flat_map(|&share| [share; 6])) {
            let shares = RowShares {
                escaped,
                ..RowShares::default()
            };
            sides.add(patch, shares);
        }
        sides.outwards(&table)
    }

    #[test]
    fn a_shell_around_cavities_is_wound_outwards_and_a_solid_with_rooms_is_not() {
        let (shell, small, large) = (
            (DVec3::ZERO, 4.0, 1.0),
            (DVec3::ONE, 1.0, -1.0),
            (DVec3::ZERO, 3.6, -1.0),
        );
        assert_eq!(found(&[shell, small], &[1.0, 0.0]), Some(Outwards::All));
        assert_eq!(
            found(&[shell, (DVec3::ONE, 1.0, 1.0)], &[1.0, 0.0]),
            Some(Outwards::Shell)
        );
        // Thick walls; a room beside; things in a room that is right; an open scene; a row that is missing.
        assert_eq!(found(&[shell, large], &[1.0, 0.0]), None);
        assert_eq!(found(&[shell, (DVec3::splat(9.0), 1.0, -1.0)], &[1.0, 0.0]), None);
        assert_eq!(
            found(&[(DVec3::ZERO, 4.0, -1.0), (DVec3::ONE, 1.0, 1.0)], &[0.0, 0.0]),
            None
        );
        assert_eq!(found(&[shell, small], &[1.0, 0.5]), None);
        assert_eq!(found(&[shell, small], &[1.0]), None);
        assert_eq!(found(&[shell], &[1.0]), None);
    }
}
