//! Points on a grid: at a height above the ground, or on surfaces; and the raster of their cells.

use super::Arguments;
use crate::exit::hinted;
use crate::prepare::Prepared;
use crate::report::{count, counted};
use crate::selection::{matches_glob, matching_objects};
use anyhow::{Result, anyhow, bail};
use glam::{DVec2, DVec3};
use hemicube::frame::{Horizon, axes_of};
use hemicube_spatial::whole;
use std::collections::BTreeSet;

/// Part of a cell within which a border lies on a multiple of the step: steps such as 0.1 have no exact multiples.
const ON_MULTIPLE: f64 = 1e-6;
/// Most cells of a grid.
const CELLS_MAX: f64 = 4_000_000.0;
/// Offset from surfaces, in steps.
const OFFSET: f64 = 1e-3;
/// Heights of two surfaces in a cell that are one, in parts of the grid's extent.
const ONE: f64 = 1e-6;
/// Most surfaces back to back above a point that are looked through: storeys of a stack.
const STOREYS_MAX: usize = 64;
/// Least cosine between a surface's normal and the way that a grid looks.
const FACING: f64 = 0.1;
/// Least length of the mean normal of the surfaces of a grid.
const COMMON: f64 = 0.2;
/// Names in an error.
const NAMES_SHOWN: usize = 5;

/// A grid's points.
pub(super) struct Grid {
    pub(super) positions: Vec<DVec3>,
    /// Of the surfaces, or the way up.
    pub(super) normals: Vec<DVec3>,
    pub(super) raster: Raster,
}

/// The cells of a grid.
pub(super) struct Raster {
    /// Cells along `right`.
    pub(super) columns: usize,
    /// Cells along `up`.
    pub(super) rows: usize,
    /// The point of each cell, row by row from the corner of `origin`.
    pub(super) cells: Vec<Option<usize>>,
    /// The corner of the first cell along `right` and `up`, and the step.
    pub(super) corner: DVec2,
    pub(super) step: f64,
    /// The middle of the first cell, and the steps to the next cells.
    pub(super) origin: DVec3,
    pub(super) right: DVec3,
    pub(super) up: DVec3,
    /// Cells without a point.
    pub(super) left_out: u64,
}

impl Raster {
    /// Leaves out the points that do not stay, and numbers the others anew.
    pub(super) fn keep(&mut self, stays: &[bool]) {
        let mut next = 0;
        let numbers: Vec<Option<usize>> = stays
            .iter()
            .map(|&stay| {
                let number = next;
                next += usize::from(stay);
                stay.then_some(number)
            })
            .collect();
        for cell in &mut self.cells {
            *cell = cell.and_then(|point| numbers[point]);
        }
        self.left_out = self.cells.iter().filter(|cell| cell.is_none()).count() as u64;
    }
}

/// The frame of a grid: right, up and out of it.
struct Frame([DVec3; 3]);

impl Frame {
    fn local(&self, point: DVec3) -> DVec3 {
        let [right, up, out] = self.0;
        DVec3::new(right.dot(point), up.dot(point), out.dot(point))
    }

    fn world(&self, point: DVec3) -> DVec3 {
        let [right, up, out] = self.0;
        right * point.x + up * point.y + out * point.z
    }
}

/// Lays out the grid of the arguments.
///
/// # Errors
/// When nothing is there to lay it on, or it would have too many cells.
pub(super) fn grid(arguments: &Arguments, prepared: &Prepared, horizon: &Horizon) -> Result<Grid> {
    let Some(step) = arguments.grid else {
        bail!("`--grid` needs a step")
    };
    if arguments.height.is_none() && arguments.on.is_empty() {
        return Err(hinted(
            anyhow!("`--grid {step}` says neither a height nor surfaces"),
            "`--height 1.5` puts it above the ground, `--on \"floor*\"` on surfaces",
        ));
    }
    let chosen = chosen("--on", &arguments.on, prepared)?;
    match arguments.height {
        Some(height) => {
            let clip = chosen_of_some("--clip", &arguments.clip, prepared)?;
            let extent = match (arguments.extent, &clip) {
                (Some([x0, y0, x1, y1]), _) => Extent::Box([DVec2::new(x0, y0), DVec2::new(x1, y1)]),
                (None, Some(clip)) => Extent::Of(clip),
                (None, None) => Extent::Of(&chosen),
            };
            let frame = Frame([horizon.east, horizon.north, horizon.up]);
            let layout = Layout::new(prepared, frame, &chosen, step, extent)?;
            above_ground(prepared, horizon, layout, clip.as_deref(), height)
        }
        None => on_surfaces(prepared, horizon, &chosen, step, OFFSET * step),
    }
}

/// The triangles that an option's globs name, by object or material; `None` without a glob.
fn chosen_of_some(flag: &str, globs: &[String], prepared: &Prepared) -> Result<Option<Vec<bool>>> {
    (!globs.is_empty()).then(|| chosen(flag, globs, prepared)).transpose()
}

/// Likewise, and all triangles without a glob.
fn chosen(flag: &str, globs: &[String], prepared: &Prepared) -> Result<Vec<bool>> {
    let scene = &prepared.scene;
    let mut chosen = vec![globs.is_empty(); scene.triangles.len()];
    for glob in globs {
        let objects = matching_objects(scene, glob);
        let materials: Vec<bool> = scene.materials.iter().map(|m| matches_glob(glob, &m.name)).collect();
        let is = |names: &[bool], index: u32| names.get(index as usize).copied().unwrap_or(false);
        let mut any = false;
        for (chosen, triangle) in chosen.iter_mut().zip(&scene.triangles) {
            if is(&objects, triangle.object) || is(&materials, triangle.material) {
                (*chosen, any) = (true, true);
            }
        }
        if !any {
            let objects = scene.objects.iter().map(String::as_str);
            let materials = scene.materials.iter().map(|material| material.name.as_str());
            let names: BTreeSet<&str> = objects.chain(materials).filter(|name| !name.is_empty()).collect();
            let shown: Vec<String> = names.iter().take(NAMES_SHOWN).map(|name| format!("`{name}`")).collect();
            let more = names.len().saturating_sub(NAMES_SHOWN);
            return Err(hinted(
                anyhow!("`{flag} {glob}` matches no object and no material"),
                if shown.is_empty() {
                    "the scene has no names".to_owned()
                } else if more > 0 {
                    format!("the scene has {} and {more} more", shown.join(", "))
                } else {
                    format!("the scene has {}", shown.join(", "))
                },
            ));
        }
    }
    Ok(chosen)
}

/// The area that a grid's cells cover.
#[derive(Clone, Copy)]
enum Extent<'a> {
    /// Between two corners along right and up, with cells at multiples of the step.
    Box([DVec2; 2]),
    /// About triangles, with cells at multiples of the step.
    Of(&'a [bool]),
    /// The grid lies in the middle of its surfaces.
    Middle,
}

/// The chosen triangles in a grid's frame.
struct Layout {
    frame: Frame,
    step: f64,
    /// Corners along right and up, height out of the grid, and the place of the triangle in the scene.
    triangles: Vec<([DVec3; 3], usize)>,
    /// The corner of the first cell, in steps: a cell has the same middle in every grid that is aligned.
    first: DVec2,
    columns: usize,
    rows: usize,
    extent: f64,
}

impl Layout {
    fn new(prepared: &Prepared, frame: Frame, chosen: &[bool], step: f64, extent: Extent<'_>) -> Result<Self> {
        let triangles = triangles_of(prepared, &frame, chosen);
        let [low, high] = bounds(&triangles);
        let aligned = |low: DVec2, high: DVec2| {
            let first = (low / step + ON_MULTIPLE).floor();
            (first, ((high / step - ON_MULTIPLE).ceil() - first).max(DVec2::ONE))
        };
        let (first, cells) = match extent {
            Extent::Box([low, high]) => aligned(low, high),
            Extent::Of(others) => {
                let [low, high] = bounds(&triangles_of(prepared, &frame, others));
                aligned(low.truncate(), high.truncate())
            }
            Extent::Middle => {
                let size = (high - low).truncate();
                let cells = (size / step).ceil().max(DVec2::ONE);
                let rest = (cells * step - size) * 0.5;
                ((low.truncate() - rest) / step, cells)
            }
        };
        // Infinite where a coordinate all but overflows.
        if cells.x * cells.y > CELLS_MAX || !cells.is_finite() {
            return Err(hinted(
                anyhow!(
                    "a step of {step} makes {:.3e} cells of {:.6} × {:.6}; a grid has {} at most",
                    cells.x * cells.y,
                    cells.x * step,
                    cells.y * step,
                    count(4_000_000)
                ),
                "take a larger step, or `--box`, or `--on` a part of the scene",
            ));
        }
        let (columns, rows) = (whole::to_usize(cells.x), whole::to_usize(cells.y));
        Ok(Self {
            frame,
            step,
            triangles,
            first,
            columns,
            rows,
            extent: (high - low).max_element(),
        })
    }

    /// Takes other triangles of the scene in place of the chosen ones; the cells stay.
    fn take(&mut self, prepared: &Prepared, others: &[bool]) {
        self.triangles = triangles_of(prepared, &self.frame, others);
    }

    fn middle(&self, column: usize, row: usize) -> DVec2 {
        (self.first + DVec2::new(column as f64, row as f64) + 0.5) * self.step
    }

    /// Calls `meet` for every cell with its middle on a triangle, with the height there.
    fn each(&self, mut meet: impl FnMut(usize, f64, usize)) {
        let cell = |at: f64, count: usize| whole::to_usize(at).min(count);
        for &([a, b, c], place) in &self.triangles {
            let (p, q, r) = (a.truncate(), b.truncate(), c.truncate());
            let area = (q - p).perp_dot(r - p);
            if area == 0.0 {
                continue;
            }
            let low = p.min(q).min(r) / self.step - self.first - 0.5;
            let high = p.max(q).max(r) / self.step - self.first - 0.5;
            for row in cell(low.y.ceil(), self.rows)..cell(high.y.floor() + 1.0, self.rows) {
                for column in cell(low.x.ceil(), self.columns)..cell(high.x.floor() + 1.0, self.columns) {
                    let at = self.middle(column, row);
                    let of_b = (at - p).perp_dot(r - p) / area;
                    let of_c = (q - p).perp_dot(at - p) / area;
                    if of_b >= 0.0 && of_c >= 0.0 && of_b + of_c <= 1.0 {
                        let height = a.z + (b.z - a.z) * of_b + (c.z - a.z) * of_c;
                        meet(row * self.columns + column, height, place);
                    }
                }
            }
        }
    }

    /// The grid with a point at each cell that has a height and a normal.
    fn grid(&self, heights: &[Option<(f64, DVec3)>]) -> Result<Grid> {
        let (mut positions, mut normals, mut cells) = (Vec::new(), Vec::new(), Vec::with_capacity(heights.len()));
        for (cell, found) in heights.iter().enumerate() {
            cells.push(found.map(|_| positions.len()));
            if let Some((height, normal)) = found {
                let at = self.middle(cell % self.columns, cell / self.columns);
                positions.push(self.frame.world(at.extend(*height)));
                normals.push(*normal);
            }
        }
        if positions.is_empty() {
            return Err(hinted(
                anyhow!(
                    "no middle of {} of the grid has a point in the open",
                    counted(cells.len() as u64, "cell")
                ),
                "take a smaller step, and look at `--height`, `--on`, `--box`, `--clip`, `--up`, and whether surfaces \
                 face outwards (`hemicube inspect`)",
            ));
        }
        let level = positions
            .iter()
            .map(|&p| self.frame.local(p).z)
            .fold(f64::INFINITY, f64::min);
        let left_out = cells.iter().filter(|cell| cell.is_none()).count() as u64;
        Ok(Grid {
            positions,
            normals,
            raster: Raster {
                columns: self.columns,
                rows: self.rows,
                cells,
                corner: self.first * self.step,
                step: self.step,
                origin: self.frame.world(self.middle(0, 0).extend(level)),
                right: self.frame.0[0] * self.step,
                up: self.frame.0[1] * self.step,
                left_out,
            },
        })
    }
}

/// The triangles of a choice in a grid's frame, with their places in the scene.
fn triangles_of(prepared: &Prepared, frame: &Frame, chosen: &[bool]) -> Vec<([DVec3; 3], usize)> {
    let triangles = prepared.scene.triangles.iter().zip(chosen).enumerate();
    triangles
        .filter(|(_, (_, chosen))| **chosen)
        .map(|(place, (triangle, _))| (triangle.corners.map(|corner| frame.local(corner)), place))
        .collect()
}

/// The least and the greatest coordinates.
fn bounds(triangles: &[([DVec3; 3], usize)]) -> [DVec3; 2] {
    let corners = triangles.iter().flat_map(|(corners, _)| corners);
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &corner| {
        [low.min(corner), high.max(corner)]
    })
}

/// The first surfaces above a point, in one place.
#[derive(Clone, Copy)]
struct Above {
    height: f64,
    has_front: bool,
    has_back: bool,
    has_both: bool,
}

impl Above {
    /// Returns whether one-sided surfaces lie back to back, as solids that stand on one another do: what is above them
    /// tells which side the point is on.
    fn is_back_to_back(&self) -> bool {
        self.has_front && self.has_back && !self.has_both
    }

    fn is_back(&self) -> bool {
        self.has_back && !self.has_front && !self.has_both
    }
}

/// Points above the lowest surface that looks up, but those below the back of a surface: in a solid, or under the
/// ground. Inside a solid that stands wall to wall with others, fronts of theirs are all round, and only its roof
/// tells; in one that carries others, the roof of the highest. The cost is one pass over the triangles a storey. With
/// `clip`, cells alone whose middles lie above or below its triangles.
fn above_ground(
    prepared: &Prepared,
    horizon: &Horizon,
    mut layout: Layout,
    clip: Option<&[bool]>,
    height: f64,
) -> Result<Grid> {
    let looks_up = |place: usize| {
        let triangle = &prepared.scene.triangles[place];
        let [a, b, c] = triangle.corners;
        ((b - a).cross(c - a).dot(horizon.up) > 0.0, triangle.two_sided)
    };
    let mut ground: Vec<Option<(f64, DVec3)>> = vec![None; layout.columns * layout.rows];
    layout.each(|cell, at, place| {
        let (is_up, two_sided) = looks_up(place);
        let is_lower = ground[cell].is_none_or(|(lowest, _)| at < lowest);
        if (is_up || two_sided) && is_lower {
            ground[cell] = Some((at, horizon.up));
        }
    });
    for (at, _) in ground.iter_mut().flatten() {
        *at += height;
    }
    if let Some(clip) = clip {
        let mut is_within = vec![false; ground.len()];
        layout.take(prepared, clip);
        layout.each(|cell, _, _| is_within[cell] = true);
        for (point, is_within) in ground.iter_mut().zip(is_within) {
            *point = point.filter(|_| is_within);
        }
    }
    layout.take(prepared, &vec![true; prepared.scene.triangles.len()]);
    let near = ONE * layout.extent;
    // Where to look from in each cell; what is decided is looked at no more.
    let mut from: Vec<Option<f64>> = ground.iter().map(|point| point.map(|(at, _)| at)).collect();
    for _ in 0..STOREYS_MAX {
        let mut above: Vec<Option<Above>> = vec![None; ground.len()];
        layout.each(|cell, at, place| {
            let (is_up, two_sided) = looks_up(place);
            if from[cell].is_none_or(|from| at < from) || above[cell].is_some_and(|before| at > before.height + near) {
                return;
            }
            let nothing = Above {
                height: at,
                has_front: false,
                has_back: false,
                has_both: false,
            };
            let found = above[cell].get_or_insert(nothing);
            if at < found.height - near {
                *found = nothing;
            }
            found.height = found.height.min(at);
            found.has_both |= two_sided;
            found.has_back |= is_up && !two_sided;
            found.has_front |= !is_up && !two_sided;
        });
        for ((point, from), above) in ground.iter_mut().zip(&mut from).zip(&above) {
            if above.is_some_and(|above| above.is_back()) {
                *point = None;
            }
            *from = above
                .filter(Above::is_back_to_back)
                .map(|above| above.height + 2.0 * near);
        }
        if from.iter().all(Option::is_none) {
            break;
        }
    }
    layout.grid(&ground)
}

/// Points on the chosen surfaces, off them by `offset` along their normals.
fn on_surfaces(prepared: &Prepared, horizon: &Horizon, chosen: &[bool], step: f64, offset: f64) -> Result<Grid> {
    let normal_of = |place: usize| {
        let [a, b, c] = prepared.scene.triangles[place].corners;
        0.5 * (b - a).cross(c - a)
    };
    let places: Vec<usize> = (0..chosen.len()).filter(|&place| chosen[place]).collect();
    let sum: DVec3 = places.iter().map(|&place| normal_of(place)).sum();
    let area: f64 = places.iter().map(|&place| normal_of(place).length()).sum();
    if !(sum.length() >= COMMON * area && area > 0.0) {
        return Err(hinted(
            anyhow!("the surfaces of `--on` look to all sides: a grid lies on surfaces that look one way"),
            "name those of one side, such as `floor*`",
        ));
    }
    let out = sum.normalize();
    let frame = match axes_of(out, 0.0) {
        // As a map where it looks up, and as an elevation where it stands.
        Some(_) if out.dot(horizon.up) > 0.999_999 => Frame([horizon.east, horizon.north, horizon.up]),
        Some([tangent, bitangent, normal]) => {
            let steep = horizon.up - normal * normal.dot(horizon.up);
            match steep.try_normalize().filter(|_| steep.length() > 1e-3) {
                Some(up) => Frame([up.cross(normal), up, normal]),
                None => Frame([tangent, bitangent, normal]),
            }
        }
        None => bail!("the surfaces of `--on` have no area"),
    };
    let layout = Layout::new(prepared, frame, chosen, step, Extent::Middle)?;
    let mut found: Vec<Option<(f64, DVec3)>> = vec![None; layout.columns * layout.rows];
    let mut over = None;
    layout.each(|cell, at, place| {
        let normal = normal_of(place).normalize_or_zero();
        if normal.dot(out) < FACING {
            return;
        }
        match found[cell] {
            Some((before, _)) if (before - at).abs() > ONE * layout.extent => over = Some((cell, before, at)),
            Some(_) => {}
            None => found[cell] = Some((at, normal)),
        }
    });
    if let Some((cell, one, other)) = over {
        let at = layout.middle(cell % layout.columns, cell / layout.columns);
        let at = layout.frame.world(at.extend(one));
        return Err(hinted(
            anyhow!(
                "surfaces of `--on` lie over one another, {:.6} apart at ({:.6} {:.6} {:.6}): a cell has one point",
                (one - other).abs(),
                at.x,
                at.y,
                at.z
            ),
            "name those of one storey",
        ));
    }
    let mut grid = layout.grid(&found)?;
    for (position, normal) in grid.positions.iter_mut().zip(&grid.normals) {
        *position += *normal * offset;
    }
    Ok(grid)
}
