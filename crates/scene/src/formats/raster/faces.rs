//! Rectangles of cells of one height, and the walls between them.

use super::{ROOF, Raster};
use glam::DVec3;

/// No rectangle: outside, or without a surface.
const NONE: u32 = u32::MAX;

/// The kind of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The ground, or any surface where the ground is not known.
    Low,
    /// A roof.
    High,
    /// Between two heights.
    Wall,
}

/// Level cells: columns from `west` up to `east`, rows from `north` up to `south`, without the last ones.
struct Rectangle {
    west: usize,
    east: usize,
    north: usize,
    south: usize,
    height: f64,
    kind: Kind,
}

/// A raster's rectangles, and the one of each cell.
pub(super) struct Plan {
    rectangles: Vec<Rectangle>,
    of_cell: Vec<u32>,
}

impl Plan {
    /// Sweeps over the cells: each that is left begins a rectangle, as wide and then as high as there are cells like it.
    pub(super) fn new(raster: &Raster) -> Self {
        let columns = raster.columns;
        let kind = |cell: usize| match &raster.ground {
            Some(ground) if raster.heights[cell] - ground[cell] >= ROOF => Kind::High,
            _ => Kind::Low,
        };
        let mut plan = Self {
            rectangles: Vec::new(),
            of_cell: vec![NONE; raster.heights.len()],
        };
        for cell in 0..raster.heights.len() {
            let height = raster.heights[cell];
            if height.is_nan() || plan.of_cell[cell] != NONE {
                continue;
            }
            let (west, north) = (cell % columns, cell / columns);
            let of = kind(cell);
            let is_like = |plan: &Self, other: usize| {
                plan.of_cell[other] == NONE && raster.heights[other] == height && kind(other) == of
            };
            let mut east = west + 1;
            while east < columns && is_like(&plan, north * columns + east) {
                east += 1;
            }
            let mut south = north + 1;
            while south < raster.rows && (west..east).all(|column| is_like(&plan, south * columns + column)) {
                south += 1;
            }
            // There are four million cells at most.
            let number = u32::try_from(plan.rectangles.len()).unwrap_or(NONE);
            for row in north..south {
                plan.of_cell[row * columns + west..row * columns + east].fill(number);
            }
            plan.rectangles.push(Rectangle {
                west,
                east,
                north,
                south,
                height,
                kind: of,
            });
        }
        plan
    }

    /// Calls `meet` for each face, with its corners counter-clockwise seen from the front: rectangles in their order,
    /// each followed by the walls down from it.
    pub(super) fn each(&self, raster: &Raster, meet: &mut impl FnMut(&[DVec3], Kind)) {
        let place = |[i, j]: [usize; 2], height: f64| {
            DVec3::new(
                raster.west + i as f64 * raster.cell[0],
                raster.north - j as f64 * raster.cell[1],
                height,
            )
        };
        let (mut top, mut wall) = (Vec::new(), Vec::new());
        let (mut runs, mut levels) = (Vec::new(), Vec::new());
        for rectangle in &self.rectangles {
            let height = rectangle.height;
            self.runs(raster, rectangle, &mut runs);
            top.clear();
            top.extend(runs.iter().map(|run: &Run| place(run.from, height)));
            meet(&top, rectangle.kind);
            for run in &runs {
                let Some(lower) = self.rectangles.get(run.beside as usize).map(|other| other.height) else {
                    continue;
                };
                if lower >= height {
                    continue;
                }
                // The upper edge runs as the rectangle's does, and the wall's back: seen from outside, the way round
                // is down at `from`, along below, up at `to`.
                wall.clear();
                wall.extend([place(run.from, lower), place(run.to, lower)]);
                self.levels(raster, run.to, [lower, height], &mut levels);
                wall.extend(levels.iter().map(|&level| place(run.to, level)));
                wall.extend([place(run.to, height), place(run.from, height)]);
                self.levels(raster, run.from, [lower, height], &mut levels);
                wall.extend(levels.iter().rev().map(|&level| place(run.from, level)));
                meet(&wall, Kind::Wall);
            }
        }
    }

    /// The rectangle of a cell by its column and row, from 1: 0 and those beyond the last are outside.
    fn at(&self, raster: &Raster, column: usize, row: usize) -> u32 {
        let is_inside = (1..=raster.columns).contains(&column) && (1..=raster.rows).contains(&row);
        if is_inside {
            self.of_cell[(row - 1) * raster.columns + column - 1]
        } else {
            NONE
        }
    }

    /// The pieces of a rectangle's sides with one neighbour each, counter-clockwise from the south-west corner.
    fn runs(&self, raster: &Raster, rectangle: &Rectangle, runs: &mut Vec<Run>) {
        let &Rectangle {
            west,
            east,
            north,
            south,
            ..
        } = rectangle;
        runs.clear();
        let mut step = |beside: u32, from: [usize; 2], to: [usize; 2], is_corner: bool| match runs.last_mut() {
            Some(run) if run.beside == beside && !is_corner => run.to = to,
            _ => runs.push(Run { from, to, beside }),
        };
        for column in west..east {
            let beside = self.at(raster, column + 1, south + 1);
            step(beside, [column, south], [column + 1, south], column == west);
        }
        for row in (north..south).rev() {
            let beside = self.at(raster, east + 1, row + 1);
            step(beside, [east, row + 1], [east, row], row + 1 == south);
        }
        for column in (west..east).rev() {
            let beside = self.at(raster, column + 1, north);
            step(beside, [column + 1, north], [column, north], column + 1 == east);
        }
        for row in north..south {
            let beside = self.at(raster, west, row + 1);
            step(beside, [west, row], [west, row + 1], row == north);
        }
    }

    /// The heights between two at which other walls end at a corner of cells, ascending: each wall has corners there.
    fn levels(&self, raster: &Raster, [i, j]: [usize; 2], [low, high]: [f64; 2], levels: &mut Vec<f64>) {
        levels.clear();
        for (column, row) in [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)] {
            if let Some(rectangle) = self.rectangles.get(self.at(raster, column, row) as usize)
                && rectangle.height > low
                && rectangle.height < high
            {
                levels.push(rectangle.height);
            }
        }
        levels.sort_by(f64::total_cmp);
        levels.dedup();
    }
}

/// A piece of a side between two corners of cells, and the rectangle beyond it.
struct Run {
    from: [usize; 2],
    to: [usize; 2],
    beside: u32,
}
