//! A perfect maze of square rooms joined by doorways: a spanning tree of a grid, found by depth-first search with
//! backtracking, so that exactly one way leads from any room to any other. Strong occlusion indoors.
//!
//! A room is 3 m × 3 m × 3 m, a wall 0.25 m thick, a doorway 1 m wide and 2 m high. All faces are rectangles of one
//! common lattice, with its lines `pieces` to the metre, so that floors, walls, ceilings and door frames share their
//! edges exactly: the surface is watertight. A tree of n rooms has n − 1 doorways, so the count does not depend on the
//! seed: with p pieces to the metre and t = ⌈p/4⌉ across a wall, 108·n·p² + (n − 1)·(12·p·t − 8·p²) triangles.

use super::builder::SceneBuilder;
use super::random::Random;
use crate::{Error, Scene};
use glam::DVec3;

/// Metres (and thirds) along the side of a room.
const ROOM: u32 = 3;
const DOOR_HEIGHT: u32 = 2;
/// The third of a wall with the doorway.
const DOOR_START: u32 = 1;
const WALL: f64 = 0.25;

/// Properties of the maze.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MazeParameters {
    /// Rooms along x.
    pub columns: u32,
    /// Rooms along z.
    pub rows: u32,
    /// Lattice pieces to the metre.
    pub pieces: u32,
    /// True if the rooms have ceilings. With them the maze is closed and every row of F sums to 1; without, it is open
    /// to the sky, and the tops of the walls, invisible to all, stay out.
    pub ceiling: bool,
    /// Seed of the maze.
    pub seed: u64,
}

impl Default for MazeParameters {
    fn default() -> Self {
        Self {
            columns: 9,
            rows: 10,
            pieces: 1,
            ceiling: true,
            seed: 1,
        }
    }
}

impl MazeParameters {
    /// The closed maze nearest to a target, one piece to the metre: of those equally near the one nearest to a square.
    pub fn for_target(target: u64, seed: u64) -> Self {
        let with = |columns, rows| Self {
            columns,
            rows,
            pieces: 1,
            ceiling: true,
            seed,
        };
        let mut best = with(1, 1);
        // n rooms have 112·n − 4 triangles; a square maze of more columns than this is beyond the target.
        let rooms = (target.saturating_add(4) / 112).max(1);
        let last = u32::try_from(rooms.isqrt())
            .unwrap_or(u32::MAX)
            .saturating_mul(2)
            .max(3);
        for columns in 1..=last {
            let near = rooms / u64::from(columns);
            for rows in [near, near + 1] {
                let rows = u32::try_from(rows)
                    .unwrap_or(u32::MAX)
                    .clamp((columns / 2).max(1), columns);
                let maze = with(columns, rows);
                let distance = |m: &Self| (m.patch_count().abs_diff(target), m.columns - m.rows);
                if distance(&maze) < distance(&best) {
                    best = maze;
                }
            }
        }
        best
    }

    fn wall_pieces(&self) -> u32 {
        self.pieces.div_ceil(4)
    }

    /// Number of triangles made by [`MazeParameters::generate`]. Saturates.
    pub fn patch_count(&self) -> u64 {
        let rooms = u128::from(self.columns) * u128::from(self.rows);
        let (p, t) = (u128::from(self.pieces), u128::from(self.wall_pieces()));
        let sides = if self.ceiling { 6 } else { 5 };
        // Rectangles: floor, ceiling and four walls of 3p × 3p. A doorway takes p × 2p from two walls, and adds a
        // threshold and a head of p × t and two sides of 2p × t. Sums only, lest saturation cancel out.
        let room_less_doorway = (9 * sides - 4) * p * p;
        let rectangles = rooms
            .saturating_mul(room_less_doorway + 6 * p * t)
            .saturating_add(4 * p * p);
        let rectangles = if rooms == 0 { 0 } else { rectangles - 6 * p * t };
        u64::try_from(rectangles.saturating_mul(2)).unwrap_or(u64::MAX)
    }

    /// Builds the maze: one object a room, one a doorway.
    ///
    /// # Errors
    /// When a count is 0, or the maze has more than [`MAX_PATCHES`](super::MAX_PATCHES).
    pub fn generate(&self) -> Result<Scene, Error> {
        if self.columns == 0 || self.rows == 0 || self.pieces == 0 {
            return Err(Error::malformed(
                "`columns`, `rows` and `pieces` of a maze are at least 1",
            ));
        }
        let mut builder = SceneBuilder::new(self.patch_count(), 1.0)?;
        let doors = Doors::carve(self.columns as usize, self.rows as usize, &mut Random::new(self.seed));
        let maze = Lattice {
            x: self.lines(self.columns),
            z: self.lines(self.rows),
            y: (0..=ROOM * self.pieces)
                .map(|i| f64::from(i) / f64::from(self.pieces))
                .collect(),
            pieces: self.pieces as usize,
            wall: self.wall_pieces() as usize,
        };
        for row in 0..self.rows as usize {
            for column in 0..self.columns as usize {
                builder.object(format!("room_{column}_{row}"));
                maze.room(&mut builder, column, row, &doors, self.ceiling);
                if doors.east(column, row) {
                    builder.object(format!("door_{column}_{row}_x"));
                    maze.door_along_x(&mut builder, column, row);
                }
                if doors.south(column, row) {
                    builder.object(format!("door_{column}_{row}_z"));
                    maze.door_along_z(&mut builder, column, row);
                }
            }
        }
        Ok(builder.finish())
    }

    /// The lattice lines along an axis with `rooms` rooms: those of each room, and those inside the walls between.
    fn lines(&self, rooms: u32) -> Vec<f64> {
        let wall = self.wall_pieces();
        let mut lines = Vec::new();
        for room in 0..rooms {
            let start = f64::from(room) * (f64::from(ROOM) + WALL);
            lines.extend((0..=ROOM * self.pieces).map(|i| start + f64::from(i) / f64::from(self.pieces)));
            if room + 1 < rooms {
                let end = start + f64::from(ROOM);
                lines.extend((1..wall).map(|i| end + WALL * f64::from(i) / f64::from(wall)));
            }
        }
        lines
    }
}

/// The walls with a doorway.
struct Doors {
    columns: usize,
    east: Vec<bool>,
    south: Vec<bool>,
}

impl Doors {
    fn carve(columns: usize, rows: usize, random: &mut Random) -> Self {
        let rooms = columns * rows;
        let mut doors = Self {
            columns,
            east: vec![false; rooms],
            south: vec![false; rooms],
        };
        let mut reached = vec![false; rooms];
        reached[0] = true;
        let mut way = vec![0usize];
        while let Some(&room) = way.last() {
            let (column, row) = (room % columns, room / columns);
            let neighbours = [
                (column + 1 < columns).then(|| room + 1),
                (row + 1 < rows).then(|| room + columns),
                (column > 0).then(|| room - 1),
                (row > 0).then(|| room - columns),
            ];
            let fresh = || neighbours.iter().flatten().filter(|&&n| !reached[n]);
            #[allow(clippy::cast_possible_truncation, reason = "at most 4")]
            let choice = random.below(fresh().count() as u32) as usize;
            let Some(&next) = fresh().nth(choice) else {
                way.pop();
                continue;
            };
            let first = room.min(next);
            if row == next / columns {
                doors.east[first] = true;
            } else {
                doors.south[first] = true;
            }
            reached[next] = true;
            way.push(next);
        }
        doors
    }

    fn east(&self, column: usize, row: usize) -> bool {
        self.east[row * self.columns + column]
    }

    fn south(&self, column: usize, row: usize) -> bool {
        self.south[row * self.columns + column]
    }
}

/// The common lattice.
struct Lattice {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    pieces: usize,
    wall: usize,
}

impl Lattice {
    fn at(&self, i: usize, j: usize, k: usize) -> DVec3 {
        DVec3::new(self.x[i], self.y[j], self.z[k])
    }

    /// The first lattice line of a room along x or z.
    fn start(&self, room: usize) -> usize {
        room * (ROOM as usize * self.pieces + self.wall)
    }

    fn room(&self, builder: &mut SceneBuilder, column: usize, row: usize, doors: &Doors, ceiling: bool) {
        let n = ROOM as usize * self.pieces;
        let (x, z) = (self.start(column), self.start(row));
        builder.material("floor");
        builder.sheet(n, n, |i, j| self.at(x + j, 0, z + i));
        if ceiling {
            builder.material("ceiling");
            builder.sheet(n, n, |i, j| self.at(x + i, n, z + j));
        }
        builder.material("wall");
        let west = column > 0 && doors.east(column - 1, row);
        let north = row > 0 && doors.south(column, row - 1);
        self.wall(builder, west, |along, up| self.at(x, up, z + n - along));
        self.wall(builder, doors.east(column, row), |along, up| {
            self.at(x + n, up, z + along)
        });
        self.wall(builder, north, |along, up| self.at(x + along, up, z));
        self.wall(builder, doors.south(column, row), |along, up| {
            self.at(x + n - along, up, z + n)
        });
    }

    /// A wall of a room, (along, up), less its doorway.
    fn wall(&self, builder: &mut SceneBuilder, door: bool, at: impl Fn(usize, usize) -> DVec3) {
        let n = ROOM as usize * self.pieces;
        let in_door = |i: usize, j: usize| {
            door && i / self.pieces == DOOR_START as usize && j / self.pieces < DOOR_HEIGHT as usize
        };
        for j in 0..n {
            for i in (0..n).filter(|&i| !in_door(i, j)) {
                builder.quad([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }

    /// The inside of the doorway from a room to the next along x.
    fn door_along_x(&self, builder: &mut SceneBuilder, column: usize, row: usize) {
        let x = self.start(column) + ROOM as usize * self.pieces;
        let z = self.start(row) + DOOR_START as usize * self.pieces;
        self.door(builder, |across, up, along| {
            self.at(x + along, up, z + self.pieces - across)
        });
    }

    /// The inside of the doorway from a room to the next along z.
    fn door_along_z(&self, builder: &mut SceneBuilder, column: usize, row: usize) {
        let x = self.start(column) + DOOR_START as usize * self.pieces;
        let z = self.start(row) + ROOM as usize * self.pieces;
        self.door(builder, |across, up, along| self.at(x + across, up, z + along));
    }

    /// Threshold, head and sides of a doorway; (across, up, along) is right-handed.
    fn door(&self, builder: &mut SceneBuilder, at: impl Fn(usize, usize, usize) -> DVec3) {
        let (width, height, depth) = (self.pieces, DOOR_HEIGHT as usize * self.pieces, self.wall);
        builder.material("floor");
        builder.sheet(depth, width, |i, j| at(j, 0, i));
        builder.material("ceiling");
        builder.sheet(width, depth, |i, j| at(i, height, j));
        builder.material("wall");
        builder.sheet(height, depth, |i, j| at(0, i, j));
        builder.sheet(depth, height, |i, j| at(width, j, i));
    }
}
