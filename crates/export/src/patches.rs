//! Results of the patches of a matrix, column by column.

use crate::{Error, Result};
use glam::DVec3;
use hemicube_scene::InputPatch;
use hemicube_scene::{Axis, Patches};
use hemicube_solve::solve::StoredSolution;
use hemicube_store::Grouping;
use hemicube_store::{PatchTable, Store};
use serde::Serialize;
use serde_json::Value;

/// Limit on right-hand sides as columns: the 8,760 hours of a year have files of their own.
const RIGHT_HAND_SIDES_MAX: u64 = 256;

/// The values of a column.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Values {
    /// Whole numbers.
    Whole(Vec<u32>),
    /// Indices into names.
    Named(Vec<u32>, Vec<String>),
    /// Numbers, patch by patch; NaN where unknown.
    Real(Vec<f64>),
}

/// A result of each patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name.
    pub name: String,
    /// The names of its components; empty for a single number.
    pub components: Vec<String>,
    /// The values, in the order of patches.
    pub values: Values,
}

impl Column {
    /// Numbers of each patch.
    pub fn width(&self) -> usize {
        self.components.len().max(1)
    }

    /// A label for each number of a patch: the name, followed by the component if there are several.
    pub fn labels(&self) -> Vec<String> {
        if self.components.is_empty() {
            return vec![self.name.clone()];
        }
        let label = |component| format!("{}_{component}", self.name);
        self.components.iter().map(label).collect()
    }

    fn real(name: impl Into<String>, values: Vec<f64>) -> Self {
        Self {
            name: name.into(),
            components: Vec::new(),
            values: Values::Real(values),
        }
    }

    fn vectors(name: &str, vectors: &[[f64; 3]]) -> Self {
        Self {
            name: name.to_owned(),
            components: ["x", "y", "z"].map(str::to_owned).to_vec(),
            values: Values::Real(vectors.as_flattened().to_vec()),
        }
    }
}

/// Meaning of the colours of a file, for formats with room for words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Legend {
    /// The result.
    pub quantity: String,
    /// The colour map.
    pub color_map: String,
    /// The numbers at the first and the last colour of a scale.
    pub range: Option<[f64; 2]>,
}

/// Viridis (Smith & van der Walt 2015) at equal steps: from dark to light, and told apart by any colour vision.
const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 45, 123],
    [59, 82, 139],
    [44, 114, 142],
    [33, 145, 140],
    [40, 174, 128],
    [94, 201, 98],
    [173, 220, 48],
    [253, 231, 37],
];
/// The colour of a patch without a value.
const UNKNOWN: [u8; 3] = [128; 3];

/// The colour of a number from 0 to 1; others have the colour of the nearer end.
///
/// ```
/// use hemicube_export::scale_color;
/// assert_eq!((scale_color(-1.0), scale_color(2.0)), ([68, 1, 84], [253, 231, 37]));
/// let light = |value: f64| scale_color(value).iter().map(|&channel| u32::from(channel)).sum::<u32>();
/// assert!(light(0.2) < light(0.9));
/// ```
pub fn scale_color(value: f64) -> [u8; 3] {
    let place = value.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 8")]
    let low = (place as usize).min(VIRIDIS.len() - 2);
    let share = place - low as f64;
    let mut color = [0; 3];
    for (channel, out) in color.iter_mut().enumerate() {
        let (from, to) = (f64::from(VIRIDIS[low][channel]), f64::from(VIRIDIS[low + 1][channel]));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 255")]
        let mixed = (from + share * (to - from)).round().clamp(0.0, 255.0) as u8;
        *out = mixed;
    }
    color
}

/// A colour for each patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Colors {
    /// sRGB.
    pub srgb: Vec<[u8; 3]>,
    /// Their meaning.
    pub legend: Legend,
}

impl Colors {
    /// The colours of numbers on a scale, by default from the least to the greatest. NaN is grey.
    pub fn on_scale(quantity: &str, values: &[f64], range: Option<[f64; 2]>) -> Self {
        let known = || values.iter().copied().filter(|value| !value.is_nan());
        let [low, high] = range.unwrap_or_else(|| {
            let (low, high) = (
                known().fold(f64::INFINITY, f64::min),
                known().fold(f64::NEG_INFINITY, f64::max),
            );
            // Nothing is known, or one value throughout: the first colour.
            if low <= high { [low, high] } else { [0.0, 0.0] }
        });
        let color = |&value: &f64| {
            if value.is_nan() {
                UNKNOWN
            } else {
                scale_color((value - low) / (high - low).max(f64::MIN_POSITIVE))
            }
        };
        Self {
            srgb: values.iter().map(color).collect(),
            legend: Legend {
                quantity: quantity.to_owned(),
                color_map: "viridis".to_owned(),
                range: Some([low, high]),
            },
        }
    }
}

/// The patch table of a matrix, ready to be written.
///
/// ```
/// use hemicube_export::{PatchResults, Values};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/../store/doc/room.rs")); }
/// # let folder = tempfile::tempdir()?;
/// # let store = room::stored(&folder.path().join("room.hemicube"), 0.0)?;
///
/// let mut results = PatchResults::read(&store, &[])?;
/// let Some(Values::Real(areas)) = results.column("area").map(|column| &column.values) else {
///     return Err("no areas".into());
/// };
/// assert_eq!(*areas, store.patches()?.area);
/// assert!(results.push("temperature", vec![293.15]).is_err(), "one number for each patch");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PatchResults {
    /// The columns; the first is the patch's id, its position in the matrix.
    pub columns: Vec<Column>,
    /// Corners of each patch, counter-clockwise seen from its radiating side, in the file's unit.
    pub corners: Option<Vec<[[f64; 3]; 3]>>,
    /// The axis pointing up in the scene.
    pub up: Axis,
    /// A colour for each patch.
    pub colors: Option<Colors>,
    /// The scene's file, by its name in the store.
    pub scene: String,
    patch_count: usize,
}

impl PatchResults {
    /// Reads the patch table, the shares of each row, the number of patches seen by each, and these solutions. With
    /// more than one solution, quantities carry its name, too.
    ///
    /// # Errors
    /// When the store cannot be read, or a solution has too many right-hand sides for columns.
    pub fn read(store: &Store, solutions: &[&str]) -> Result<Self> {
        let rows = store.row_table()?;
        let manifest = store.manifest();
        let mut seen = Vec::with_capacity(store.patch_count() as usize);
        for patch in 0..store.patch_count() {
            let entries = store.entries_of_row(InputPatch(patch))?;
            seen.push(entries.map_or(f64::NAN, |entries| entries as f64));
        }
        let names = [&manifest.objects[..], &manifest.materials[..]];
        let Self { mut columns, .. } = Self::of_table(store.patches()?, names, &manifest.scene.file);
        columns.extend([
            Column::real("seen", seen),
            Column::real("row_sum", rows.row_sum),
            Column::real("escaped", rows.escaped),
            Column::real("blocked", rows.blocked),
            Column::real("unselected", rows.unselected),
        ]);
        // Without a tolerance nothing estimates it.
        if rows.error.iter().any(|error| !error.is_nan()) {
            columns.extend([
                Column::real("error", rows.error),
                Column::real("sum_error", rows.sum_error),
                Column::real("escaped_error", rows.escaped_error),
            ]);
        }
        for name in solutions {
            let prefix = if solutions.len() > 1 {
                format!("{name}_")
            } else {
                String::new()
            };
            let solution = StoredSolution::open(store, name)?;
            for quantity in solution.quantities() {
                columns.push(of_solution(&solution, name, quantity, &prefix)?);
            }
        }
        Ok(Self {
            columns,
            corners: None,
            up: Axis::Z,
            colors: None,
            scene: manifest.scene.file.clone(),
            patch_count: store.patch_count() as usize,
        })
    }

    /// The patch table alone: patch, object, material, face, side, area, centroid, normal. `names` are the objects' and
    /// the materials'.
    pub fn of_table(table: PatchTable, names: [&[String]; 2], scene: &str) -> Self {
        let patch_count = table.len();
        let whole = |name: &str, values: Vec<u32>| Column {
            name: name.to_owned(),
            components: Vec::new(),
            values: Values::Whole(values),
        };
        let named = |name: &str, values: Vec<u32>, names: &[String]| Column {
            name: name.to_owned(),
            components: Vec::new(),
            values: of_names(values, names),
        };
        let is_face = |&face: &u32| face != PatchTable::SEVERAL;
        let face = if table.face.iter().all(is_face) {
            whole("face", table.face)
        } else {
            let number = |face| if is_face(&face) { f64::from(face) } else { f64::NAN };
            Column::real("face", table.face.into_iter().map(number).collect())
        };
        Self {
            columns: vec![
                whole("patch", (0..).take(patch_count).collect()),
                named("object", table.object, names[0]),
                named("material", table.material, names[1]),
                face,
                whole("side", table.side.into_iter().map(u32::from).collect()),
                Column::real("area", table.area),
                Column::vectors("centroid", &table.centroid),
                Column::vectors("normal", &table.normal),
            ],
            corners: None,
            up: Axis::Z,
            colors: None,
            scene: scene.to_owned(),
            patch_count,
        }
    }

    /// Adds a number for each patch, such as its sky view factor.
    ///
    /// # Errors
    /// When the number of values is not that of the patches.
    pub fn push(&mut self, name: &str, values: Vec<f64>) -> Result<()> {
        if values.len() != self.patch_count {
            return Err(Error::OtherPatches {
                what: name.to_owned(),
                found: values.len(),
                expected: self.patch_count,
            });
        }
        self.columns.push(Column::real(name, values));
        Ok(())
    }

    /// Turns the rows of patches into rows of their elements, with the values of their patches; the column `patch` says
    /// whose they are.
    ///
    /// # Errors
    /// When there are other patches than the grouping has.
    pub fn spread(&mut self, grouping: &Grouping) -> Result<()> {
        if grouping.len() != self.patch_count {
            return Err(Error::OtherPatches {
                what: "the scene".to_owned(),
                found: grouping.len(),
                expected: self.patch_count,
            });
        }
        for column in &mut self.columns {
            let width = column.width();
            match &mut column.values {
                Values::Whole(values) | Values::Named(values, _) => *values = grouping.spread(values),
                Values::Real(values) => {
                    let of = |&patch: &u32| values[patch as usize * width..][..width].iter().copied();
                    *values = grouping.patches().iter().flat_map(of).collect();
                }
            }
        }
        self.patch_count = grouping.elements();
        Ok(())
    }

    /// Sets the corners of the patches, and the axis pointing up. Patches of several elements are
    /// [`spread`](Self::spread) first.
    ///
    /// # Errors
    /// When their number is not that of the matrix.
    pub fn place(&mut self, patches: &Patches, up: Axis) -> Result<()> {
        if patches.len() != self.patch_count {
            return Err(Error::OtherPatches {
                what: "the scene".to_owned(),
                found: patches.len(),
                expected: self.patch_count,
            });
        }
        let corners = |patch| patches.corners(patch).map(|corner: DVec3| corner.to_array());
        self.corners = Some(patches.iter().map(corners).collect());
        self.up = up;
        Ok(())
    }

    /// Number of patches.
    pub fn patch_count(&self) -> usize {
        self.patch_count
    }

    /// The labels of all columns and components.
    pub fn labels(&self) -> Vec<String> {
        self.columns.iter().flat_map(Column::labels).collect()
    }

    /// The numbers of a column or of a component, by its label.
    pub fn numbers(&self, label: &str) -> Option<Vec<f64>> {
        self.columns.iter().find_map(|column| {
            let component = column.labels().iter().position(|found| found == label)?;
            Some(match &column.values {
                Values::Whole(values) | Values::Named(values, _) => values.iter().map(|&value| value.into()).collect(),
                Values::Real(values) => values.iter().copied().skip(component).step_by(column.width()).collect(),
            })
        })
    }

    /// A column by its name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }
}

/// Indices into names; a name of its own for those of several.
fn of_names(mut values: Vec<u32>, names: &[String]) -> Values {
    let mut names = names.to_vec();
    if values.contains(&PatchTable::SEVERAL) {
        let several = u32::try_from(names.len()).unwrap_or(PatchTable::SEVERAL);
        names.push("(several)".to_owned());
        values
            .iter_mut()
            .filter(|value| **value == PatchTable::SEVERAL)
            .for_each(|value| *value = several);
    }
    Values::Named(values, names)
}

/// A quantity of a solution: a component for each band, or for each right-hand side.
fn of_solution(solution: &StoredSolution, name: &str, quantity: &str, prefix: &str) -> Result<Column> {
    let array = solution.quantity(quantity)?;
    if array.rows() > RIGHT_HAND_SIDES_MAX {
        return Err(Error::TooManyRightHandSides {
            solution: name.to_owned(),
            rows: array.rows(),
            most: RIGHT_HAND_SIDES_MAX,
        });
    }
    let report = solution.report();
    let bands = report["bands"].as_array().map_or(&[][..], Vec::as_slice);
    let several = array.rows() > bands.len() as u64;
    let mut components = Vec::new();
    let mut of_row = Vec::new();
    for row in 0..array.rows() {
        let place = usize::try_from(row).unwrap_or(usize::MAX);
        let band = report["band_of_row"][place].as_u64().unwrap_or(row);
        let band = bands
            .get(usize::try_from(band).unwrap_or(usize::MAX))
            .and_then(Value::as_str)
            .unwrap_or("band");
        components.push(if several {
            format!("{band}_{row}")
        } else {
            band.to_owned()
        });
        of_row.push(array.row(row)?);
    }
    if of_row.len() == 1 {
        components.clear();
    }
    let patches = of_row.first().map_or(0, Vec::len);
    let values = (0..patches).flat_map(|patch| of_row.iter().map(move |row| row[patch]));
    Ok(Column {
        name: format!("{prefix}{quantity}"),
        components,
        values: Values::Real(values.collect()),
    })
}
