//! Rectangles of cells of one height, the walls between them, and crowns of trees above them.

use super::{ROOF, Raster, TRUNK};
use glam::DVec3;

/// How far crowns stand off walls and roofs, in cells: a face in the plane of another would be seen or not by rounding.
/// A choice, far above that, and far below a cell.
const APART: f64 = 1e-3;
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
    /// The outside of crowns; it has two sides.
    Crown,
}

/// Cells alike: columns from `west` up to `east`, rows from `north` up to `south`, without the last ones.
struct Rectangle<K> {
    west: usize,
    east: usize,
    north: usize,
    south: usize,
    of: K,
}

/// The rectangles of cells alike, and the one of each cell.
struct Sweep<K> {
    rectangles: Vec<Rectangle<K>>,
    of_cell: Vec<u32>,
    columns: usize,
    rows: usize,
}

impl<K: Copy + PartialEq> Sweep<K> {
    /// Sweeps over the cells: each that is left begins a rectangle, as wide and then as high as there are cells like it.
    fn new(raster: &Raster, of: impl Fn(usize) -> Option<K>) -> Self {
        let columns = raster.columns;
        let mut found = Self {
            rectangles: Vec::new(),
            of_cell: vec![NONE; raster.heights.len()],
            columns,
            rows: raster.rows,
        };
        for cell in 0..raster.heights.len() {
            let Some(key) = of(cell).filter(|_| found.of_cell[cell] == NONE) else {
                continue;
            };
            let (west, north) = (cell % columns, cell / columns);
            let is_like = |found: &Self, other: usize| found.of_cell[other] == NONE && of(other) == Some(key);
            let mut east = west + 1;
            while east < columns && is_like(&found, north * columns + east) {
                east += 1;
            }
            let mut south = north + 1;
            while south < raster.rows && (west..east).all(|column| is_like(&found, south * columns + column)) {
                south += 1;
            }
            // There are four million cells at most.
            let number = u32::try_from(found.rectangles.len()).unwrap_or(NONE);
            for row in north..south {
                found.of_cell[row * columns + west..row * columns + east].fill(number);
            }
            found.rectangles.push(Rectangle {
                west,
                east,
                north,
                south,
                of: key,
            });
        }
        found
    }

    /// The rectangle of a cell by its column and row, from 1: 0 and those beyond the last are outside.
    fn at(&self, column: usize, row: usize) -> u32 {
        let is_inside = (1..=self.columns).contains(&column) && (1..=self.rows).contains(&row);
        if is_inside {
            self.of_cell[(row - 1) * self.columns + column - 1]
        } else {
            NONE
        }
    }

    /// The pieces of a rectangle's sides with one neighbour each, counter-clockwise from the south-west corner.
    fn runs(&self, rectangle: &Rectangle<K>, runs: &mut Vec<Run>) {
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
            let beside = self.at(column + 1, south + 1);
            step(beside, [column, south], [column + 1, south], column == west);
        }
        for row in (north..south).rev() {
            let beside = self.at(east + 1, row + 1);
            step(beside, [east, row + 1], [east, row], row + 1 == south);
        }
        for column in (west..east).rev() {
            let beside = self.at(column + 1, north);
            step(beside, [column + 1, north], [column, north], column + 1 == east);
        }
        for row in north..south {
            let beside = self.at(west, row + 1);
            step(beside, [west, row], [west, row + 1], row == north);
        }
    }
}

/// A raster's faces.
pub(super) struct Plan {
    /// By height and kind.
    level: Sweep<(f64, Kind)>,
    /// By the heights from which and up to which crowns are.
    crowns: Sweep<[f64; 2]>,
}

impl Plan {
    pub(super) fn new(raster: &Raster) -> Self {
        let kind = |cell: usize| match &raster.ground {
            Some(ground) if raster.heights[cell] - ground[cell] >= ROOF => Kind::High,
            _ => Kind::Low,
        };
        let level = |cell: usize| {
            let height = raster.heights[cell];
            (!height.is_nan()).then(|| (height, kind(cell)))
        };
        let crown = |cell: usize| {
            let (ground, canopy) = (raster.ground.as_ref()?[cell], raster.canopy.as_ref()?[cell]);
            let (low, high) = (ground + TRUNK * canopy, ground + canopy);
            // What lies below a roof is no crown. Without a surface there is none, either.
            let gap = APART * raster.cell[0].min(raster.cell[1]);
            let low = low.max(raster.heights[cell] + gap);
            (canopy > 0.0 && low < high && !raster.heights[cell].is_nan()).then_some([low, high])
        };
        Self {
            level: Sweep::new(raster, level),
            crowns: Sweep::new(raster, crown),
        }
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
        for rectangle in &self.level.rectangles {
            let (height, kind) = rectangle.of;
            self.level.runs(rectangle, &mut runs);
            top.clear();
            top.extend(runs.iter().map(|run: &Run| place(run.from, height)));
            meet(&top, kind);
            for run in &runs {
                let Some((lower, _)) = self.level.rectangles.get(run.beside as usize).map(|other| other.of) else {
                    continue;
                };
                if lower >= height {
                    continue;
                }
                // The upper edge runs as the rectangle's does, and the wall's back: seen from outside, the way round
                // is down at `from`, along below, up at `to`.
                wall.clear();
                wall.extend([place(run.from, lower), place(run.to, lower)]);
                self.levels(run.to, [lower, height], &mut levels);
                wall.extend(levels.iter().map(|&level| place(run.to, level)));
                wall.extend([place(run.to, height), place(run.from, height)]);
                self.levels(run.from, [lower, height], &mut levels);
                wall.extend(levels.iter().rev().map(|&level| place(run.from, level)));
                meet(&wall, Kind::Wall);
            }
        }
        for rectangle in &self.crowns.rectangles {
            let [low, high] = rectangle.of;
            let &Rectangle {
                west,
                east,
                north,
                south,
                ..
            } = rectangle;
            let corners = [[west, south], [east, south], [east, north], [west, north]];
            meet(&corners.map(|at| place(at, high)), Kind::Crown);
            meet(&corners.map(|at| place(at, low)), Kind::Crown);
            self.crowns.runs(rectangle, &mut runs);
            for run in &runs {
                let beside = self.crowns.rectangles.get(run.beside as usize);
                let [from, to] = beside.map_or([high; 2], |other| other.of);
                // Sides stand off the cell's, in which walls stand.
                let step = |from: usize, to: usize| f64::from(i8::from(to > from) - i8::from(to < from));
                // Runs go counter-clockwise, rows to the south.
                let inwards = [step(run.from[1], run.to[1]), step(run.from[0], run.to[0])];
                let inwards = DVec3::new(inwards[0] * raster.cell[0], inwards[1] * raster.cell[1], 0.0) * APART;
                let side = |at, height| place(at, height) + inwards;
                // What the crown beside does not cover, below it and above it.
                for [low, high] in [[low, high.min(from)], [low.max(to), high]] {
                    // Without one beside, all of it is below.
                    if low < high {
                        meet(
                            &[
                                side(run.from, low),
                                side(run.to, low),
                                side(run.to, high),
                                side(run.from, high),
                            ],
                            Kind::Crown,
                        );
                    }
                }
            }
        }
    }

    /// The heights between two at which other walls end at a corner of cells, ascending: each wall has corners there.
    fn levels(&self, [i, j]: [usize; 2], [low, high]: [f64; 2], levels: &mut Vec<f64>) {
        levels.clear();
        for (column, row) in [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)] {
            if let Some(rectangle) = self.level.rectangles.get(self.level.at(column, row) as usize)
                && rectangle.of.0 > low
                && rectangle.of.0 < high
            {
                levels.push(rectangle.of.0);
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
