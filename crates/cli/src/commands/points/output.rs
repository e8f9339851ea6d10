//! Rows of sensors as tables, arrays, maps and pictures.

use super::comfort;
use super::crs::Crs;
use super::heat::Heat;
use super::map::{self, Band, NO_DATA};
use super::sensors::Sensors;
use super::suns::{Brought, Felt, Hours};
use super::{Arguments, By};
use crate::args::Talk;
use crate::exit::hinted;
use crate::picture::canvas::{Anchor, Canvas, Color, NOTHING, Rect, WHITE, scale_color};
use crate::prepare::Prepared;
use crate::report::{PendingFile, SCHEMA, count, figures};
use crate::table::field;
use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use hemicube::diagnose::Place;
use hemicube::points::{SensorRow, Table, sides, write_rows};
use hemicube::portal::Portals;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::Path;

/// Most columns of a table.
const COLUMNS_MAX: usize = 16_384;
/// Pixels along the longer edge of a picture, about.
const PICTURE: usize = 900;
/// Pixels between the pictures of a cube's sides, with their names in it.
const GAP: usize = 24;
/// The sides of a cube, in the order of [`sides`], and the place of each in the picture.
pub(super) const SIDES: [(&str, [usize; 2]); 6] = [
    ("east", [2, 0]),
    ("north", [1, 0]),
    ("west", [0, 0]),
    ("south", [0, 1]),
    ("up", [1, 1]),
    ("down", [2, 1]),
];

/// Formats, by the names' extensions.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Csv,
    Json,
    Npz,
    Tiff,
    NetCdf,
    AsciiGrid,
    Picture,
    Idf,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
        match extension.as_ref().and_then(|extension| extension.to_str()) {
            Some("csv") => Ok(Self::Csv),
            Some("json") => Ok(Self::Json),
            Some("npz") => Ok(Self::Npz),
            Some("tif" | "tiff") => Ok(Self::Tiff),
            Some("nc") => Ok(Self::NetCdf),
            Some("asc") => Ok(Self::AsciiGrid),
            Some("png" | "svg") => Ok(Self::Picture),
            Some("idf") => Ok(Self::Idf),
            _ => bail!(
                "`--output {}`: a name that ends in .csv, .json, .npz, .idf, .tif, .nc, .asc, .png or .svg is needed",
                path.display()
            ),
        }
    }

    /// Returns whether it is a file of a grid's cells with their coordinates.
    fn is_map(self) -> bool {
        matches!(self, Self::Tiff | Self::NetCdf | Self::AsciiGrid)
    }
}

/// Refuses outputs that cannot be, before anything is read.
///
/// # Errors
/// For a name of no format, a map or a picture without a grid, and options of maps without one.
pub(super) fn require(arguments: &Arguments) -> Result<()> {
    let formats: Result<Vec<Format>> = arguments.output.iter().map(|path| Format::of(path)).collect();
    let formats = formats?;
    if formats.contains(&Format::Idf) {
        comfort::require(arguments)?;
    }
    for (path, format) in arguments.output.iter().zip(&formats) {
        let what = if format.is_map() { "map" } else { "picture" };
        let is_of_cells = format.is_map() || *format == Format::Picture;
        if is_of_cells && arguments.grid.is_none() {
            return Err(hinted(
                anyhow!("`{}`: a {what} is of a grid, and `--points` are none", path.display()),
                "`--grid STEP --height HEIGHT` makes one",
            ));
        }
        if *format == Format::AsciiGrid && arguments.body == Some(super::BodyName::Cube) {
            return Err(hinted(
                anyhow!("`{}`: an ASCII grid is one map, and a cube has six", path.display()),
                "a .tif has a band for each, a .nc a dimension",
            ));
        }
    }
    let has_cells = |format: &Format| format.is_map() || *format == Format::Picture;
    if arguments.show.is_some() && !formats.iter().any(has_cells) {
        bail!("`--show` is of a map or a picture, and no `-o` ends in .tif, .nc, .asc, .png or .svg");
    }
    if arguments.crs.is_some()
        && !formats
            .iter()
            .any(|format| matches!(format, Format::Tiff | Format::NetCdf))
    {
        bail!("`--crs` is written into a .tif or .nc, and no `-o` ends so");
    }
    Ok(())
}

/// Refuses `--by none` where patches are needed.
///
/// # Errors
/// For a sparse matrix of patches, radiant temperatures, and portals.
pub(super) fn require_columns(arguments: &Arguments, portals: &Portals) -> Result<()> {
    if arguments.by != By::None {
        return Ok(());
    }
    let needs = if keeps_patches(arguments) {
        "a .npz has a column for each patch"
    } else if !arguments.solution.is_empty() || arguments.temperatures.is_some() {
        "a radiant temperature is of all patches"
    } else if !portals.is_empty() {
        "mirrors, panes and images are followed by patches"
    } else {
        return Ok(());
    };
    Err(hinted(
        anyhow!("`--by none` leaves patches out, and {needs}"),
        "leave `--by none` out",
    ))
}

/// Refuses maps of what lies askew, and tells where a map is without the scene's coordinate reference system.
///
/// # Errors
/// When a map is asked for and the grid's cells do not lie along east and north; for `--crs` where z is not up.
pub(super) fn require_map(arguments: &Arguments, prepared: &Prepared, sensors: &Sensors, talk: Talk) -> Result<()> {
    let of = |path: &std::path::PathBuf| Format::of(path).ok();
    let maps: Vec<Format> = arguments
        .output
        .iter()
        .filter_map(of)
        .filter(|format| format.is_map())
        .collect();
    let (Some(raster), false) = (&sensors.raster, maps.is_empty()) else {
        return Ok(());
    };
    let horizon = &sensors.horizon;
    if raster.right != horizon.east * raster.step || raster.up != horizon.north * raster.step {
        return Err(hinted(
            anyhow!("a map lies along east and north, and these surfaces do not look up"),
            "write a .npz, which has the steps of the grid, or a .png",
        ));
    }
    if arguments.crs.is_some() && horizon.up != DVec3::Z {
        return Err(hinted(
            anyhow!("`--crs` is of scenes with x to the east and y to the north, and here z does not point up"),
            "turn the scene, or leave `--crs` out",
        ));
    }
    let bands = sensors.items[0].body.rows();
    prepared
        .budget
        .require(map::Map::bytes(raster.columns, raster.rows, bands), "a map")?;
    let is_named = arguments.crs.is_some() || maps.iter().all(|&format| format == Format::AsciiGrid);
    if let (false, Some(name)) = (is_named, &prepared.scene.crs)
        && let Err(reason) = Crs::of_scene(name)
    {
        talk.warn(&format!(
            "the map has no coordinate reference system: {reason}; `--crs EPSG:N` names a projected one"
        ));
    }
    Ok(())
}

/// The least that a file of so many sensors takes on the disk.
pub(super) fn bytes_at_least(path: &Path, sensors: usize) -> u64 {
    match Format::of(path) {
        // A point with its normal, and three shares: no cell is empty.
        Ok(Format::Csv | Format::Json) => 20 * sensors as u64,
        Ok(Format::NetCdf) => 4 * sensors as u64,
        Ok(Format::AsciiGrid) => 2 * sensors as u64,
        // Compressed arrays, and pictures of one colour.
        _ => 1 << 10,
    }
}

/// Returns whether rows are kept by patch.
pub(super) fn keeps_patches(arguments: &Arguments) -> bool {
    let is_npz = |path: &std::path::PathBuf| Format::of(path).is_ok_and(|format| format == Format::Npz);
    arguments.output.iter().any(is_npz)
}

/// Columns of tables that are no group.
const OWN_COLUMNS: [&str; 16] = [
    "point", "x", "y", "z", "nx", "ny", "nz", "body", "place", "sky", "ground", "blocked", "passed", "cut_off",
    "change", "mrt",
];

/// Groups of patches: the columns of tables. Those of one name are one.
pub(super) struct Groups {
    by: By,
    names: Vec<String>,
    /// By patch; `None`: each patch is a group.
    of_patch: Option<Vec<u32>>,
}

impl Groups {
    pub(super) fn new(by: By, prepared: &Prepared) -> Self {
        let scene = &prepared.scene;
        // The group of each index of the scene: the first of its name.
        let made = |what: &str, names: Vec<&String>, index: fn(&hemicube_scene::Triangle) -> u32| {
            let (mut groups, mut known, mut of_index) = (Vec::new(), HashMap::new(), Vec::new());
            for (at, name) in names.into_iter().enumerate() {
                let name = if name.is_empty() {
                    format!("{what} {at}")
                } else {
                    name.clone()
                };
                let group = *known.entry(name.clone()).or_insert_with(|| {
                    groups.push(name);
                    u32::try_from(groups.len() - 1).unwrap_or(u32::MAX)
                });
                of_index.push(group);
            }
            let of = |patch| {
                let index = index(&scene.triangles[prepared.patches.triangle(patch)]) as usize;
                of_index.get(index).copied().unwrap_or(0)
            };
            Self {
                by,
                names: groups,
                of_patch: Some(prepared.patches.iter().map(of).collect()),
            }
        };
        match by {
            By::Object => made("object", scene.objects.iter().collect(), |triangle| triangle.object),
            By::Material => {
                let names = scene.materials.iter().map(|material| &material.name);
                made("material", names.collect(), |triangle| triangle.material)
            }
            By::Patch | By::None => Self {
                by,
                names: Vec::new(),
                of_patch: None,
            },
        }
    }

    /// The column of a group: its name, with its kind where another column has that name.
    fn column(&self, group: u32) -> String {
        let name = self.name(group);
        match self.by {
            By::Object if OWN_COLUMNS.contains(&name.as_str()) => format!("{name} (object)"),
            By::Material if OWN_COLUMNS.contains(&name.as_str()) => format!("{name} (material)"),
            _ => name,
        }
    }

    /// The name of a group.
    pub(super) fn name(&self, group: u32) -> String {
        self.names
            .get(group as usize)
            .cloned()
            .unwrap_or_else(|| format!("patch {group}"))
    }

    fn of(&self, patch: u32) -> u32 {
        self.of_patch
            .as_ref()
            .map_or(patch, |groups| groups.get(patch as usize).copied().unwrap_or(0))
    }
}

/// Numbers kept of a row.
pub(super) struct Kept {
    pub(super) sensor: usize,
    /// Without patches, unless they are asked for.
    pub(super) row: SensorRow,
    /// Groups seen, ascending, and their view factors.
    pub(super) groups: Vec<(u32, f64)>,
    /// Mean radiant temperature in kelvin; NaN without a solution.
    pub(super) temperature: f64,
    /// What it brings at each moment of a table of suns; empty without one.
    pub(super) brought: Vec<Brought>,
    /// By how much it changes with another ground ([`Heat::change_by_ground`]).
    pub(super) change_by_ground: f64,
}

impl Kept {
    /// Bytes that it takes.
    pub(super) fn bytes(&self) -> u64 {
        let lists = size_of_val(&self.groups[..]) + size_of_val(&self.row.patches[..]) + size_of_val(&self.brought[..]);
        (size_of::<Self>() + lists) as u64
    }

    pub(super) fn new(sensor: usize, row: SensorRow, groups: &Groups, heat: Option<&Heat>, keeps: bool) -> Self {
        let mut sums: BTreeMap<u32, f64> = BTreeMap::new();
        for &(patch, factor) in &row.patches {
            *sums.entry(groups.of(patch.0)).or_default() += factor;
        }
        Self {
            sensor,
            groups: sums.into_iter().collect(),
            brought: Vec::new(),
            temperature: heat.map_or(f64::NAN, |heat| heat.temperature(&row)),
            change_by_ground: heat.map_or(0.0, |heat| heat.change_by_ground(&row)),
            row: if keeps {
                row
            } else {
                SensorRow {
                    patches: Vec::new(),
                    ..row
                }
            },
        }
    }
}

/// ‖a − b‖² over the patches.
pub(super) fn squared_difference(a: &SensorRow, b: &SensorRow) -> f64 {
    let mut differences: BTreeMap<u32, f64> = a.patches.iter().map(|&(patch, factor)| (patch.0, factor)).collect();
    for &(patch, factor) in &b.patches {
        *differences.entry(patch.0).or_default() -= factor;
    }
    differences.values().map(|difference| difference * difference).sum()
}

/// A column of a map or a picture.
enum Column {
    Sky,
    Ground,
    Blocked,
    Temperature,
    Group(u32),
}

impl Column {
    fn of(arguments: &Arguments, groups: &Groups, has_heat: bool) -> Result<Self> {
        match arguments.show.as_deref() {
            None if has_heat => Ok(Self::Temperature),
            None | Some("sky") => Ok(Self::Sky),
            Some("ground") => Ok(Self::Ground),
            Some("blocked") => Ok(Self::Blocked),
            Some("mrt") if has_heat => Ok(Self::Temperature),
            Some("mrt") => Err(hinted(
                anyhow!("`--show mrt` needs radiosities"),
                "`--solution DIR` has them, and `--temperatures FILE` those of black surfaces",
            )),
            Some(name) => match (0..)
                .zip(&groups.names)
                .find(|(group, _)| groups.column(*group) == name)
            {
                Some((group, _)) => Ok(Self::Group(group)),
                None => Err(hinted(
                    anyhow!("`--show {name}` is neither sky, ground, blocked, mrt nor a column of the table"),
                    format!(
                        "there are {} columns by `--by`; `hemicube inspect` names them",
                        count(groups.names.len() as u64)
                    ),
                )),
            },
        }
    }

    fn value(&self, row: &Kept) -> f64 {
        match self {
            Self::Sky => row.row.sky,
            Self::Ground => row.row.ground,
            Self::Blocked => row.row.blocked,
            Self::Temperature => row.temperature,
            Self::Group(group) => {
                let at = row.groups.binary_search_by_key(group, |(group, _)| *group);
                at.map_or(0.0, |at| row.groups[at].1)
            }
        }
    }

    /// Its name and its unit in a file.
    fn variable(&self) -> (&'static str, &'static str) {
        match self {
            Self::Sky => ("sky_view_factor", "1"),
            Self::Ground => ("ground_view_factor", "1"),
            Self::Blocked => ("blocked_share", "1"),
            Self::Temperature => ("mean_radiant_temperature", "K"),
            Self::Group(_) => ("view_factor", "1"),
        }
    }

    /// What it is, of sensors of a form.
    fn title(&self, groups: &Groups, form: &str) -> String {
        match self {
            Self::Sky => format!("sky view factor ({form})"),
            Self::Ground => format!("view factor of what is below the horizon ({form})"),
            Self::Blocked => format!("share on backs of surfaces ({form})"),
            Self::Temperature => format!("mean radiant temperature ({form})"),
            Self::Group(group) => format!("view factor of {} ({form})", groups.name(*group)),
        }
    }
}

/// Refuses a column that does not exist, before anything is computed.
///
/// # Errors
/// When `--show` names nothing.
pub(super) fn require_column(arguments: &Arguments, groups: &Groups, has_heat: bool) -> Result<()> {
    Column::of(arguments, groups, has_heat).map(|_| ())
}

/// A run's rows, ready to be written.
pub(super) struct Written<'a> {
    pub(super) arguments: &'a Arguments,
    pub(super) prepared: &'a Prepared,
    pub(super) sensors: &'a Sensors,
    pub(super) groups: &'a Groups,
    pub(super) rows: &'a [Kept],
    /// Then tables have `passed` and `cut_off`.
    pub(super) has_portals: bool,
    /// The moments of a table of suns, and what all rows get at them: a .csv then has a line a moment and row.
    pub(super) hours: Option<(&'a Hours, &'a [Felt])>,
}

fn place_name(place: Place) -> &'static str {
    match place {
        Place::InSolid => "in-solid",
        Place::BelowGround => "below-ground",
        Place::BehindSheet => "behind-sheet",
        Place::FarOff => "far-off",
        _ => "open",
    }
}

impl Written<'_> {
    /// Writes the rows in the format of the file's name.
    ///
    /// # Errors
    /// When it cannot be written, or a table would have too many columns.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        match Format::of(path)? {
            Format::Csv => match self.hours {
                Some((hours, felt)) => hours.csv(path, self.sensors, felt),
                None => self.csv(path),
            },
            Format::Json => self.json(path),
            Format::Npz => self.npz(path),
            format @ (Format::Tiff | Format::NetCdf | Format::AsciiGrid) => self.map_file(format, path),
            Format::Picture => self.picture()?.save(path),
            Format::Idf => self.idf(path),
        }
    }

    fn idf(&self, path: &Path) -> Result<()> {
        let text = comfort::idf(self.sensors, self.groups, self.rows)?;
        let mut file = PendingFile::create(path)?;
        file.write_all(text.as_bytes())
            .with_context(|| format!("`{}` cannot be written", path.display()))?;
        file.commit()
    }

    /// Groups seen by any row, ascending.
    fn seen(&self, path: &Path) -> Result<Vec<u32>> {
        let mut seen: Vec<u32> = self
            .rows
            .iter()
            .flat_map(|row| &row.groups)
            .map(|(group, _)| *group)
            .collect();
        seen.sort_unstable();
        seen.dedup();
        if seen.len() > COLUMNS_MAX {
            return Err(hinted(
                anyhow!(
                    "`{}` would have {} columns; a table has {} at most",
                    path.display(),
                    count(seen.len() as u64),
                    count(COLUMNS_MAX as u64)
                ),
                "write a .npz, or `--by material`",
            ));
        }
        Ok(seen)
    }

    fn has_heat(&self) -> bool {
        !self.arguments.solution.is_empty() || self.arguments.temperatures.is_some()
    }

    /// The direction of a row: a plane's normal, or that of a cube's side.
    fn normal(&self, at: usize) -> Option<DVec3> {
        let row = &self.rows[at];
        if let Some(normals) = &self.sensors.normals {
            return normals.get(row.sensor).copied();
        }
        let first = self.rows[..at]
            .iter()
            .rev()
            .take_while(|before| before.sensor == row.sensor)
            .count();
        (self.sensors.body == super::BodyName::Cube).then(|| sides(&self.sensors.horizon)[first.min(5)])
    }

    fn has_normals(&self) -> bool {
        self.sensors.normals.is_some() || self.sensors.body == super::BodyName::Cube
    }

    fn csv(&self, path: &Path) -> Result<()> {
        let seen = self.seen(path)?;
        let mut header = "point,x,y,z".to_owned();
        header.push_str(if self.has_normals() { ",nx,ny,nz" } else { "" });
        header.push_str(",body,place,sky,ground,blocked");
        header.push_str(if self.has_portals { ",passed,cut_off" } else { "" });
        header.push_str(if self.arguments.tolerance.is_some() {
            ",change"
        } else {
            ""
        });
        header.push_str(if self.has_heat() { ",mrt" } else { "" });
        for &group in &seen {
            header.push(',');
            header.push_str(&field(&self.groups.column(group)));
        }
        let mut file = PendingFile::create(path)?;
        let cannot = || format!("`{}` cannot be written", path.display());
        let mut out = std::io::BufWriter::with_capacity(1 << 20, &mut file);
        writeln!(out, "{header}").with_context(cannot)?;
        for (at, row) in self.rows.iter().enumerate() {
            let p = self.sensors.items[row.sensor].position;
            let mut line = format!("{},{},{},{}", row.sensor, p.x, p.y, p.z);
            if let Some(n) = self.normal(at) {
                line.push_str(&format!(",{},{},{}", n.x, n.y, n.z));
            }
            let place = place_name(self.sensors.places[row.sensor]);
            line.push_str(&format!(
                ",{},{place},{},{},{}",
                self.sensors.form(),
                row.row.sky,
                row.row.ground,
                row.row.blocked
            ));
            if self.has_portals {
                line.push_str(&format!(",{},{}", row.row.handed_on(), row.row.cut_off));
            }
            if self.arguments.tolerance.is_some() {
                line.push_str(&format!(",{}", row.row.change));
            }
            if self.has_heat() {
                line.push_str(&format!(",{}", row.temperature));
            }
            let mut groups = row.groups.iter().peekable();
            for group in &seen {
                match groups.next_if(|(found, _)| found == group) {
                    Some((_, factor)) => line.push_str(&format!(",{factor}")),
                    None => line.push_str(",0"),
                }
            }
            writeln!(out, "{line}").with_context(cannot)?;
        }
        out.flush().with_context(cannot)?;
        drop(out);
        file.commit()
    }

    fn json(&self, path: &Path) -> Result<()> {
        let points: Vec<Value> = (0..self.rows.len()).map(|at| self.json_of(at)).collect();
        let whole = json!({
            "schema": SCHEMA,
            "program": env!("CARGO_PKG_VERSION"),
            "body": self.sensors.body,
            "by": self.arguments.by,
            "tolerance": self.arguments.tolerance,
            "rows": points,
        });
        let mut file = PendingFile::create(path)?;
        let mut text = serde_json::to_string_pretty(&whole).context("the rows are no JSON")?;
        text.push('\n');
        file.write_all(text.as_bytes())
            .with_context(|| format!("`{}` cannot be written", path.display()))?;
        file.commit()
    }

    fn json_of(&self, at: usize) -> Value {
        let row = &self.rows[at];
        let mut factors = Map::new();
        for &(group, factor) in &row.groups {
            factors.insert(self.groups.name(group), json!(factor));
        }
        let mut of_row = json!({
            "point": row.sensor,
            "position": self.sensors.items[row.sensor].position.to_array(),
            "place": place_name(self.sensors.places[row.sensor]),
            "sky": row.row.sky,
            "ground": row.row.ground,
            "blocked": row.row.blocked,
            "view_factors": factors,
        });
        if self.has_portals {
            of_row["passed"] = json!(row.row.handed_on());
            of_row["cut_off"] = json!(row.row.cut_off);
        }
        if let Some(normal) = self.normal(at) {
            of_row["normal"] = json!(normal.to_array());
        }
        if self.arguments.tolerance.is_some() {
            of_row["change"] = json!(row.row.change);
        }
        if self.has_heat() {
            of_row["mean_radiant_temperature"] = json!(row.temperature);
        }
        of_row
    }

    fn npz(&self, path: &Path) -> Result<()> {
        let rows: Vec<SensorRow> = self.rows.iter().map(|row| row.row.clone()).collect();
        let count = rows.len() as u64;
        let triples = |of: &dyn Fn(usize) -> DVec3| {
            let values = (0..self.rows.len()).flat_map(|at| of(at).to_array()).collect();
            Table::Real(vec![count, 3], values)
        };
        let points = self
            .rows
            .iter()
            .map(|row| i64::try_from(row.sensor).unwrap_or(i64::MAX));
        let mut more = vec![
            (
                "points",
                triples(&|at| self.sensors.items[self.rows[at].sensor].position),
            ),
            ("point", Table::Whole(vec![count], points.collect())),
        ];
        if self.has_portals {
            let of = |value: fn(&SensorRow) -> f64| Table::Real(vec![count], rows.iter().map(value).collect());
            more.push(("passed", of(SensorRow::handed_on)));
            more.push(("cut_off", of(|row| row.cut_off)));
        }
        if self.has_normals() {
            more.push(("normals", triples(&|at| self.normal(at).unwrap_or(DVec3::NAN))));
        }
        // Those of each moment take the place of their means.
        if self.has_heat() && self.hours.is_none() {
            let temperatures = self.rows.iter().map(|row| row.temperature).collect();
            more.push(("mean_radiant_temperature", Table::Real(vec![count], temperatures)));
        }
        if let Some((hours, felt)) = self.hours {
            more.extend(hours.arrays(felt));
        }
        if let Some(raster) = &self.sensors.raster {
            let each = self.sensors.items[0].body.rows();
            let row_of =
                |cell: &Option<usize>| cell.map_or(-1, |point| i64::try_from(point * each).unwrap_or(i64::MAX));
            let shape = vec![raster.rows as u64, raster.columns as u64];
            more.push(("grid", Table::Whole(shape, raster.cells.iter().map(row_of).collect())));
            more.push(("grid_origin", Table::Real(vec![3], raster.origin.to_array().to_vec())));
            let steps = [raster.right, raster.up]
                .iter()
                .flat_map(|step| step.to_array())
                .collect();
            more.push(("grid_steps", Table::Real(vec![2, 3], steps)));
        }
        let patches = u32::try_from(self.prepared.patches.len()).context("too many patches")?;
        Ok(write_rows(path, patches, &rows, &more)?)
    }

    fn map_file(&self, format: Format, path: &Path) -> Result<()> {
        let map = self.map()?;
        let bytes = match format {
            Format::Tiff => map.tiff(),
            Format::NetCdf => map.netcdf(),
            _ => map.ascii_grid(),
        };
        let cannot = || format!("`{}` cannot be written", path.display());
        let mut file = PendingFile::create(path)?;
        file.write_all(&bytes.with_context(cannot)?).with_context(cannot)?;
        file.commit()
    }

    /// The column of `--show` as a map.
    #[allow(clippy::cast_possible_truncation, reason = "maps have numbers of 32 bits")]
    fn map(&self) -> Result<map::Map> {
        let Some(raster) = &self.sensors.raster else {
            bail!("a map is of a grid")
        };
        let column = Column::of(self.arguments, self.groups, self.has_heat())?;
        let each = self.sensors.items[0].body.rows();
        let band = |side: usize| Band {
            side: if each == SIDES.len() { SIDES[side].0 } else { "" },
            values: (0..raster.rows)
                .rev()
                .flat_map(|row| &raster.cells[row * raster.columns..(row + 1) * raster.columns])
                .map(|point| point.map_or(NO_DATA, |point| column.value(&self.rows[point * each + side]) as f32))
                .map(|value| if value.is_finite() { value } else { NO_DATA })
                .collect(),
        };
        let (variable, units) = column.variable();
        let named = self.prepared.scene.crs.as_deref();
        Ok(map::Map {
            columns: raster.columns,
            rows: raster.rows,
            corner: raster.corner,
            step: raster.step,
            bands: (0..each).map(band).collect(),
            title: column.title(self.groups, self.sensors.form()),
            variable,
            units,
            // A system of the scene that no map can have was told of.
            crs: self
                .arguments
                .crs
                .or_else(|| named.and_then(|name| Crs::of_scene(name).ok())),
        })
    }

    fn picture(&self) -> Result<Canvas> {
        let Some(raster) = &self.sensors.raster else {
            bail!("a picture is of a grid")
        };
        let column = Column::of(self.arguments, self.groups, self.has_heat())?;
        let each = self.sensors.items[0].body.rows();
        let values: Vec<f64> = self.rows.iter().map(|row| column.value(row)).collect();
        let known = || values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = (
            known().fold(f64::INFINITY, f64::min),
            known().fold(f64::NEG_INFINITY, f64::max),
        );
        // A cube has a row a side: each is drawn, to one scale.
        let is_cube = each == SIDES.len();
        let [across, down] = if is_cube { [3, 2] } else { [1, 1] };
        let gap = if is_cube { GAP } else { 0 };
        let size = (PICTURE / (across * raster.columns).max(down * raster.rows)).max(1);
        let (wide, tall) = (size * raster.columns, size * raster.rows);
        let (width, height) = (across * wide + (across - 1) * gap, down * (tall + gap));
        let mut canvas = Canvas::new(width.max(480), height + 56, WHITE);
        let left = (canvas.width - width) / 2;
        for side in 0..each {
            let (name, [column, line]) = if is_cube { SIDES[side] } else { ("", [0, 0]) };
            let (left, top) = (left + column * (wide + gap), line * (tall + gap) + gap);
            if is_cube {
                let at = (left as f64, (top - 8) as f64);
                canvas.write(name, at, 13.0, Anchor::Start);
            }
            for (cell, point) in raster.cells.iter().enumerate() {
                let color: Color = match point.map(|point| values[point * each + side]) {
                    Some(value) if value.is_finite() => {
                        scale_color((value - low) / (high - low).max(f64::MIN_POSITIVE))
                    }
                    _ => NOTHING,
                };
                let (x, y) = (cell % raster.columns, raster.rows - 1 - cell / raster.columns);
                canvas.fill(Rect::square(left + size * x, top + size * y, size), color);
            }
        }
        let wide = (canvas.width / 3).max(120);
        let labels = [figures(low), figures(high)];
        let title = match (column.title(self.groups, self.sensors.form()), column.variable().1) {
            (title, "1") => title,
            (title, unit) => format!("{title}, {unit}"),
        };
        canvas.scale((16, height + 12), wide, [&labels[0], &labels[1]], &title);
        let note = format!("a cell is {}", figures(raster.right.length()));
        let at = ((canvas.width - 16) as f64, (height + 40) as f64);
        canvas.write(&note, at, 13.0, Anchor::End);
        Ok(canvas)
    }
}
