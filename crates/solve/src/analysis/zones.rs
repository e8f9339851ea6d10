//! Form factors between zones: rows and columns of patches added up by object, material or face of the scene's file.
//!
//! ```text
//! F_IJ = Σ_{i∈I} A_i Σ_{j∈J} F_ij / Σ_{i∈I} A_i
//! ```
//!
//! (Siegel & Howell 2002, *Thermal Radiation Heat Transfer*, view-factor algebra). Sums are over the stored matrix:
//! with reciprocal and closed patches, zones are reciprocal and closed.

use hemicube_scene::{Budget, NoRoom, is_unseen};
use hemicube_store::PatchKind;
use hemicube_store::{DurableFile, Error, Manifest, PatchTable, Result, Store};
use serde::Serialize;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Most surfaces of a table of all pairs, 4·10⁸ cells: a choice. Few programs open larger ones, and sparse formats have no
/// bound.
pub const DENSE_MAX: usize = 20_000;
/// Cells of a table of all pairs, whatever they hold, and beyond these for each form factor that is not 0. A choice: with
/// more, a sparse matrix of 74 MB becomes a table of 1.2 GB; with fewer, tables are refused that programs open.
const TABLE_CELLS: u64 = 4_000_000;
const CELLS_PER_FACTOR: u64 = 32;

/// Grouping of patches into zones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum GroupBy {
    /// By the file's object; objects of one name are one zone.
    Object,
    /// The material; materials of one name are one zone.
    Material,
    /// By the file's face; its two sides are two zones.
    Face,
}

impl GroupBy {
    /// The kind of patches that are such zones.
    pub fn kind(self) -> PatchKind {
        match self {
            Self::Object => PatchKind::Object,
            Self::Material => PatchKind::Material,
            Self::Face => PatchKind::Face,
        }
    }
}

/// A zone: patches added up.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Zone {
    /// The name of its object or material, or the number of its face from 0.
    pub name: String,
    /// Index of the material of its first patch into the manifest's.
    pub material: u32,
    /// Number of its patches.
    pub patches: u32,
    /// Their area, in the file's unit squared.
    pub area: f64,
    /// Share that leaves the scene; NaN without rows.
    pub escaped: f64,
    /// Share that ends on backs of one-sided patches; NaN without rows.
    pub blocked: f64,
    /// Share that ends on patches without a column; NaN without rows.
    pub unselected: f64,
    /// Form factors to zones, ascending by zone; absent ones are 0.
    pub factors: Vec<(u32, f64)>,
}

impl Zone {
    /// Returns whether rows were computed for the zone: without them nothing is known of what it sees.
    pub fn has_rows(&self) -> bool {
        !self.escaped.is_nan()
    }

    /// The form factor to a zone; NaN without rows.
    pub fn factor_to(&self, zone: u32) -> f64 {
        if !self.has_rows() {
            return f64::NAN;
        }
        let place = self.factors.binary_search_by_key(&zone, |&(zone, _)| zone);
        place.map_or(0.0, |place| self.factors[place].1)
    }
}

/// The zones of the patches, in order of their first patch, and the zone of each patch. `objects` and `materials` are
/// the names that the table counts into.
pub(super) fn zones_of(table: &PatchTable, [objects, materials]: [&[String]; 2], by: GroupBy) -> (Vec<Zone>, Vec<u32>) {
    let mut zones: Vec<Zone> = Vec::new();
    let mut by_name: HashMap<(&str, u32, u8), u32> = HashMap::new();
    let mut zone_of = Vec::with_capacity(table.len());
    for patch in 0..table.len() {
        let named = |names: &'_ [String], index: u32| names.get(index as usize).cloned().unwrap_or_default();
        let key = match by {
            GroupBy::Object => (name_in(objects, table.object[patch]), 0, 0),
            GroupBy::Material => (name_in(materials, table.material[patch]), 0, 0),
            GroupBy::Face => ("", table.face[patch], table.side[patch]),
        };
        #[allow(clippy::cast_possible_truncation, reason = "no more zones than patches")]
        let next = zones.len() as u32;
        let zone = *by_name.entry(key).or_insert(next);
        if zone == next {
            zones.push(Zone {
                name: match by {
                    GroupBy::Object => named(objects, table.object[patch]),
                    GroupBy::Material => named(materials, table.material[patch]),
                    GroupBy::Face if table.side[patch] == 0 => table.face[patch].to_string(),
                    GroupBy::Face => format!("{} back", table.face[patch]),
                },
                material: table.material[patch],
                patches: 0,
                area: 0.0,
                escaped: 0.0,
                blocked: 0.0,
                unselected: 0.0,
                factors: Vec::new(),
            });
        }
        zones[zone as usize].patches += 1;
        zones[zone as usize].area += table.area[patch];
        zone_of.push(zone);
    }
    (zones, zone_of)
}

/// The surfaces of a matrix's patches, in order of their first patch, without factors, and the surface of each patch.
///
/// # Errors
/// [`Error::Unsupported`] for surfaces that cut across patches of several elements.
pub fn surfaces_of(store: &Store, table: &PatchTable, by: GroupBy) -> Result<(Vec<Zone>, Vec<u32>)> {
    require_kind(store, by)?;
    Ok(zones_of(table, names_of(store.manifest()), by))
}

/// Names of objects and of materials.
pub(super) fn names_of(manifest: &Manifest) -> [&[String]; 2] {
    [&manifest.objects, &manifest.materials]
}

fn name_in(names: &[String], index: u32) -> &str {
    names.get(index as usize).map_or("", String::as_str)
}

/// Why patches of a kind cannot be added up by zones that cut across them: a row has one sum for all of a patch.
pub fn reason_against(kind: PatchKind, by: GroupBy) -> Option<String> {
    let wanted = by.kind();
    // A face is of one object and one material.
    if kind == wanted || matches!(kind, PatchKind::Triangle | PatchKind::Face) {
        return None;
    }
    let (kind, by) = (kind.name(), wanted.name());
    let otherwise = if wanted == PatchKind::Face { "" } else { "by face " };
    Some(format!(
        "is a matrix of patches by {kind}, which cannot be added up by {by}; compute it by {by}, {otherwise}or by \
         triangle"
    ))
}

/// Refuses zones that cut across patches of several elements.
///
/// # Errors
/// [`Error::Unsupported`] for zones other than the patches of several elements, or their faces' objects or materials.
pub fn require_kind(store: &Store, by: GroupBy) -> Result<()> {
    match reason_against(store.manifest().patch_kind(), by) {
        Some(reason) => Err(Error::unsupported(store.directory(), reason)),
        None => Ok(()),
    }
}

/// Adds up the matrix of a store. Memory: the patch table and the zones' own matrix.
///
/// # Errors
/// [`Error::Incomplete`] when parts are missing; [`Error::Unsupported`] for zones other than the patches of several
/// elements, or their faces' objects or materials, and for a zone with some rows computed and others
/// not, which leaves no area to divide by; otherwise errors of reading. A zone without any computed row has no factors.
///
/// ```
/// use hemicube_solve::analysis::zones::{GroupBy, ZoneFormat, write_zones, zones};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.05)?;
/// # let path = folder.path().join("zones.csv");
///
/// let zones = zones(&store, GroupBy::Object)?;
/// let number = |name: &str| (0..).zip(&zones).find_map(|(number, zone)| (zone.name == name).then_some(number));
/// let (light, floor) = (number("light").ok_or("no light")?, number("floor").ok_or("no floor")?);
/// let (to, from) = (&zones[light as usize], &zones[floor as usize]);
/// let (there, back) = (to.area * to.factor_to(floor), from.area * from.factor_to(light));
/// assert!((there / back - 1.0).abs() < 0.1, "reciprocal as far as the patches are: {there} and {back}");
/// assert_eq!(to.factor_to(light), 0.0, "a flat zone does not see itself");
///
/// write_zones(&zones, &store.manifest().materials, &path, ZoneFormat::of(&path)?, false)?;
/// assert_eq!(std::fs::read_to_string(&path)?.lines().count(), 1 + zones.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn zones(store: &Store, by: GroupBy) -> Result<Vec<Zone>> {
    store.require_complete()?;
    require_kind(store, by)?;
    let table = store.patches()?;
    let (mut zones, zone_of) = zones_of(&table, names_of(store.manifest()), by);
    let lost = store.row_table()?;
    // Rows come in the order of patches: every sum has one order. A table of sums becomes a list with its zone's last
    // row, as it takes more room.
    let mut sums: Vec<HashMap<u32, f64>> = vec![HashMap::new(); zones.len()];
    let mut room = Room::default();
    let mut computed = vec![0u32; zones.len()];
    let mut of_row: HashMap<u32, f64> = HashMap::new();
    for row in store.rows()? {
        let (patch, row) = row?;
        let (patch, area) = (patch.0 as usize, table.area[patch.0 as usize]);
        let zone = zone_of[patch] as usize;
        computed[zone] += 1;
        of_row.clear();
        for (&column, factor) in row.indices.iter().zip(&row.data) {
            *of_row.entry(zone_of[column as usize]).or_insert(0.0) += factor;
        }
        let before = sums[zone].len();
        for (&to, &factor) in &of_row {
            *sums[zone].entry(to).or_insert(0.0) += area * factor;
        }
        room.take(sums[zone].len() - before).map_err(|refused| {
            Error::unsupported(
                store.directory(),
                format!("cannot be added up here: {refused}; add up by fewer zones"),
            )
        })?;
        let part = |values: &[f64]| area * values.get(patch).copied().filter(|v| v.is_finite()).unwrap_or(0.0);
        zones[zone].escaped += part(&lost.escaped);
        zones[zone].blocked += part(&lost.blocked);
        zones[zone].unselected += part(&lost.unselected);
        if computed[zone] == zones[zone].patches && zones[zone].area > 0.0 {
            let area = zones[zone].area;
            let sums = std::mem::take(&mut sums[zone]);
            let factors = &mut zones[zone].factors;
            factors.extend(sums.into_iter().map(|(to, sum)| (to, sum / area)));
            factors.sort_unstable_by_key(|&(to, _)| to);
        }
    }
    drop(sums);
    for (zone, computed) in zones.iter_mut().zip(computed) {
        if computed > 0 && computed < zone.patches {
            return Err(Error::unsupported(
                store.directory(),
                format!(
                    "has {computed} of the {} rows of zone `{}`; compute all of them, or none, to add them up",
                    zone.patches, zone.name
                ),
            ));
        }
        if computed == 0 {
            (zone.escaped, zone.blocked, zone.unselected) = (f64::NAN, f64::NAN, f64::NAN);
        } else if zone.area > 0.0 {
            for lost in [&mut zone.escaped, &mut zone.blocked, &mut zone.unselected] {
                *lost /= zone.area;
            }
        }
    }
    Ok(zones)
}

/// The memory of form factors between zones, asked for a stretch at a time: nobody knows how many there will be.
#[derive(Default)]
struct Room {
    budget: Budget,
    /// Form factors that there is room for before memory is asked for again.
    left: usize,
}

impl Room {
    /// Form factors of each stretch.
    const STRETCH: usize = 1 << 20;
    /// Bytes of one in a table of sums: key, value and a byte, in a table that is 7/16 full at least.
    const BYTES: u64 = 17 * 16 / 7 + 1;

    fn take(&mut self, factors: usize) -> std::result::Result<(), NoRoom> {
        if factors > self.left {
            let more = factors.max(Self::STRETCH);
            self.budget.require(
                more as u64 * Self::BYTES,
                "a further part of the form factors between zones",
            )?;
            self.left = more;
        }
        self.left -= factors;
        Ok(())
    }
}

/// A file format for zones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ZoneFormat {
    /// `.csv`: a line for each zone with its name, patches, area, losses, and the factors to all zones under their
    /// names; empty where no row was computed.
    Csv,
    /// `.vf`: View3D's `out=0`: a header, areas, a square matrix of six decimals, emissivities. These are taken from
    /// materials called `emissivity 0.9`, as in its own scenes; others count as 0.999, black.
    View3d,
}

impl ZoneFormat {
    /// The format of a file's extension.
    ///
    /// # Errors
    /// [`Error::Unsupported`] when it asks for none.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("vf") => Ok(Self::View3d),
            _ => Err(Error::unsupported(
                path,
                "does not say which format of zones is wanted; end it in `.csv` (a table) or `.vf` (View3D's)",
            )),
        }
    }
}

/// Writes zones to `path`; the file appears whole or not at all. Returns its size.
///
/// # Errors
/// [`Error::Exists`] when something is there and `overwrite` is not set; [`Error::Unsupported`] for more zones than
/// [`DENSE_MAX`], for a table of many more cells than form factors, and for View3D's format and a zone without rows,
/// which it has no word for; [`Error::Io`] or [`Error::NoSpace`].
pub fn write_zones(
    zones: &[Zone],
    materials: &[String],
    path: &Path,
    format: ZoneFormat,
    overwrite: bool,
) -> Result<u64> {
    if !overwrite && path.symlink_metadata().is_ok() {
        return Err(Error::Exists { path: path.to_owned() });
    }
    if zones.len() > DENSE_MAX {
        return Err(Error::unsupported(
            path,
            format!(
                "would be a table of {count} × {count} zones, and at most {DENSE_MAX} are written so; end it in `.npz`, \
                 or take larger ones",
                count = zones.len()
            ),
        ));
    }
    let cells = (zones.len() as u64).pow(2);
    let factors: u64 = zones.iter().map(|zone| zone.factors.len() as u64).sum();
    if cells > TABLE_CELLS.max(CELLS_PER_FACTOR * factors) {
        return Err(Error::unsupported(
            path,
            format!(
                "would be a table of {cells} cells for {factors} form factors; end it in `.npz` or `.mtx`, which hold these \
                 alone, or take larger zones"
            ),
        ));
    }
    if let (ZoneFormat::View3d, Some(unknown)) = (format, zones.iter().find(|zone| !zone.has_rows())) {
        return Err(Error::unsupported(
            path,
            format!(
                "cannot say that zone `{}` has no rows; compute all rows, or end it in `.csv`",
                unknown.name
            ),
        ));
    }
    let mut file = Counted {
        file: BufWriter::new(DurableFile::create(path)?),
        bytes: 0,
    };
    let written = match format {
        ZoneFormat::Csv => csv_of(zones, &mut file).map_err(io::Error::other),
        ZoneFormat::View3d => view3d_of(zones, materials, &mut file),
    };
    let bytes = file.bytes;
    let file = written.and_then(|()| file.file.into_inner().map_err(io::IntoInnerError::into_error));
    let committed = file.and_then(DurableFile::commit);
    committed.map_err(|error| Error::write(path, bytes, error))?;
    Ok(bytes)
}

/// A file while it is written, with its size.
struct Counted<W> {
    file: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A text from a file as a cell of a table. Spreadsheets take a text with `=`, `+`, `-`, `@`, a tab or a line end at
/// its beginning for a formula, which may run programs, unless an apostrophe stands before it. Numbers stay numbers;
/// control characters are escaped, `\u{1b}`.
///
/// ```
/// use hemicube_solve::analysis::zones::table_text;
/// assert_eq!(table_text("=cmd|' /C calc'!A0"), "'=cmd|' /C calc'!A0");
/// assert_eq!((&*table_text("wall"), &*table_text("-1.5"), &*table_text("a-b")), ("wall", "-1.5", "a-b"));
/// ```
pub fn table_text(text: &str) -> Cow<'_, str> {
    let begins = |c: char| {
        matches!(
            c,
            '=' | '+' | '-' | '@' | '\t' | '\r' | '\n' | '＝' | '＋' | '－' | '＠'
        )
    };
    // Blanks before it are dropped by some of them.
    let is_formula = text.starts_with(begins) || text.trim_start().starts_with(begins);
    let is_number = text.trim().parse::<f64>().is_ok_and(f64::is_finite);
    let has_controls = text.contains(is_unseen);
    if (!is_formula || is_number) && !has_controls {
        return Cow::Borrowed(text);
    }
    let mut cell = String::from(if is_formula && !is_number { "'" } else { "" });
    for c in text.chars() {
        if is_unseen(c) {
            cell.extend(c.escape_default());
        } else {
            cell.push(c);
        }
    }
    Cow::Owned(cell)
}

/// The columns of a table: its own, and those of the zones. A zone called as one of its own is `escaped (zone)`.
fn columns_of(zones: &[Zone]) -> Vec<String> {
    const OWN: [&str; 6] = ["zone", "patches", "area", "escaped", "blocked", "unselected"];
    let names: Vec<Cow<'_, str>> = zones.iter().map(|zone| table_text(&zone.name)).collect();
    let known: HashSet<&str> = names.iter().map(|name| &**name).collect();
    let column = |name: &Cow<'_, str>| {
        let mut column = name.to_string();
        if OWN.contains(&&**name) {
            column.push_str(" (zone)");
            while known.contains(&*column) {
                column.push('\'');
            }
        }
        column
    };
    OWN.into_iter()
        .map(str::to_owned)
        .chain(names.iter().map(column))
        .collect()
}

fn csv_of(zones: &[Zone], file: impl Write) -> std::result::Result<(), csv::Error> {
    let mut writer = csv::Writer::from_writer(file);
    writer.write_record(columns_of(zones))?;
    for zone in zones {
        let known = |number: f64| {
            if zone.has_rows() {
                number.to_string()
            } else {
                String::new()
            }
        };
        let numbers = [
            zone.area.to_string(),
            known(zone.escaped),
            known(zone.blocked),
            known(zone.unselected),
        ];
        let to = (0..).take(zones.len()).map(|to| known(zone.factor_to(to)));
        let start = [table_text(&zone.name).into_owned(), zone.patches.to_string()];
        writer.write_record(start.into_iter().chain(numbers).chain(to))?;
    }
    Ok(writer.flush()?)
}

fn view3d_of(zones: &[Zone], materials: &[String], mut file: impl Write) -> io::Result<()> {
    let joined = |numbers: Vec<String>| numbers.join(" ");
    // `encl` and `emit` are 0: nothing was adjusted, nothing reflected.
    writeln!(
        file,
        "View3D hemicube-{} 0 0 0 {}",
        env!("CARGO_PKG_VERSION"),
        zones.len()
    )?;
    writeln!(
        file,
        "{}",
        joined(zones.iter().map(|zone| zone.area.to_string()).collect())
    )?;
    for zone in zones {
        let row = (0..).take(zones.len()).map(|to| format!("{:.6}", zone.factor_to(to)));
        writeln!(file, "{}", joined(row.collect()))?;
    }
    let emissivity = |zone: &Zone| -> f64 {
        let material = materials.get(zone.material as usize);
        let given = material.and_then(|name| name.strip_prefix("emissivity ")?.parse().ok());
        given.unwrap_or(0.999)
    };
    let emissivities = zones.iter().map(|zone| format!("{:.3}", emissivity(zone)));
    writeln!(file, "{}", joined(emissivities.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zone(name: &str, area: f64, material: u32, factors: &[(u32, f64)]) -> Zone {
        Zone {
            name: name.to_owned(),
            material,
            patches: 2,
            area,
            escaped: 0.25,
            blocked: 0.0,
            unselected: 0.0,
            factors: factors.to_vec(),
        }
    }

    #[test]
    fn both_formats() {
        let zones = [
            zone("roof, \"flat\"", 2.0, 1, &[(1, 0.5)]),
            zone("wall", 4.0, 0, &[(0, 0.25), (1, 0.125)]),
        ];
        let materials = ["brick".to_owned(), "emissivity 0.9".to_owned()];
        let mut table = Vec::new();
        csv_of(&zones, &mut table).unwrap();
        assert_eq!(
            String::from_utf8(table).unwrap(),
            "zone,patches,area,escaped,blocked,unselected,\"roof, \"\"flat\"\"\",wall\n\
             \"roof, \"\"flat\"\"\",2,2,0.25,0,0,0,0.5\nwall,2,4,0.25,0,0,0.25,0.125\n"
        );
        let mut text = Vec::new();
        view3d_of(&zones, &materials, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].starts_with("View3D ") && lines[0].ends_with(" 0 0 0 2") && lines[0].len() < 35);
        assert_eq!(
            lines[1..],
            ["2 4", "0.000000 0.500000", "0.250000 0.125000", "0.900 0.999"]
        );
    }

    #[test]
    fn no_two_columns_of_a_table_have_one_name() {
        let names = ["zone", "wall", "escaped", "escaped (zone)", "area"];
        let zones = names.map(|name| zone(name, 1.0, 0, &[]));
        let mut table = Vec::new();
        csv_of(&zones, &mut table).unwrap();
        let text = String::from_utf8(table).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "zone,patches,area,escaped,blocked,unselected,zone (zone),wall,escaped (zone)',escaped (zone),area (zone)"
        );
        let first = |line: &&str| line.split(',').next().map(str::to_owned);
        let rows: Vec<String> = lines[1..].iter().filter_map(first).collect();
        assert_eq!(rows, names, "rows keep their names");
    }

    #[test]
    fn memory_is_asked_for_before_more_factors_are_kept() {
        let mut room = Room::default();
        assert_eq!((room.take(2), room.left), (Ok(()), Room::STRETCH - 2));
        let mut none = Room {
            budget: Budget::new(Some(1)),
            left: 1,
        };
        assert_eq!(none.take(1), Ok(()), "there is room for one");
        let refused = none.take(1).expect_err("a byte is allowed");
        assert!(
            refused.to_string().starts_with("a further part of the form factors"),
            "{refused}"
        );
    }

    #[test]
    fn a_table_of_more_zones_than_it_may_have_is_refused_before_it_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let zones = vec![zone("o", 1.0, 0, &[]); DENSE_MAX + 1];
        for (name, format) in [("F.csv", ZoneFormat::Csv), ("F.vf", ZoneFormat::View3d)] {
            let path = folder.path().join(name);
            let error = write_zones(&zones, &[], &path, format, false).unwrap_err();
            assert!(error.to_string().contains("a table of 20001 × 20001 zones"), "{error}");
            assert!(!path.exists());
        }
    }

    #[test]
    fn a_table_of_many_more_cells_than_factors_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("F.csv");
        let written = |count: usize, each: u32| {
            let factors: Vec<(u32, f64)> = (0..each).map(|zone| (zone, 1e-3)).collect();
            let zones = vec![zone("o", 1.0, 0, &factors); count];
            write_zones(&zones, &[], &path, ZoneFormat::Csv, true)
        };
        let refused = written(2_001, 60).unwrap_err().to_string();
        assert!(
            refused.contains("4004001 cells for 120060 form factors") && refused.contains(".mtx"),
            "{refused}"
        );
        assert!(!path.exists());
        assert!(written(2_001, 63).is_ok() && written(2_000, 1).is_ok());
    }
}
