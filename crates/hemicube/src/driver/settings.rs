//! Settings of rows in manifests and reports. Equal settings and scenes make equal stores, byte for byte.

use crate::PatchKind;
use crate::backend::BackendInfo;
use crate::driver::compute::{Plan, RowChoice};
use crate::portal::PortalRecord;
pub use crate::store::PROGRAM;
use crate::store::{BackendEntry, Error, Header, SceneEntry, scene_hash};
use hemicube_scene::{Axis, Fate, Loss, Patches, Scene, Subdivision};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Everything that rows depend on but the scene's triangles. Nothing in it is still to be chosen.
///
/// ```
/// use hemicube::driver::settings::RowSettings;
/// # use hemicube::backend::HemicubeBackend;
/// # use hemicube::accuracy::correct::Correction;
/// # use hemicube_backend_cpu::CpuBackend;
/// # use hemicube_scene::{Subdivision, generate};
/// # mod room { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/doc/room.rs")); }
/// # let (scene, model) = (generate::cornell_box(), room::model()?);
/// # let (plan, backend) = (room::plan(&model, Correction::Pixel), CpuBackend::new());
/// # let settings = room::settings(&plan.correction);
///
/// let header = |settings: &RowSettings, file: &str| {
///     settings.header(&scene, model.patches(), file.as_ref(), &plan, backend.info())
/// };
/// let (one, other) = (header(&settings, "rooms/a.obj")?, header(&settings, "b.obj")?);
/// assert_eq!((&*one.scene.file, &*other.scene.file), ("a.obj", "b.obj"));
/// assert_eq!(one.scene.blake3, other.scene.blake3, "the scene is its triangles, not its name");
///
/// // Another setting makes another store.
/// let finer = RowSettings { resolution: 128, ..settings.clone() };
/// assert_ne!(header(&finer, "b.obj")?.settings, other.settings);
/// assert_eq!(other.settings["resolution"], 64);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowSettings {
    /// Pixels along an edge of the hemicube.
    pub resolution: u32,
    /// Hemicubes of a patch, n².
    pub samples: u32,
    /// Name of the accuracy level's correction.
    pub correction: &'static str,
    /// The relative Frobenius error asked for.
    pub tolerance: Option<f64>,
    /// Reason of the accuracy level, where a tolerance chose it.
    pub reason: Option<String>,
    /// The price of a pair found for a tolerance: what [`crate::accuracy::correct::Refinement`] knows of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub price: Option<String>,
    /// The matrix that rows are taken over from, and whose price this is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub update: Option<String>,
    /// True if each hemicube is turned a little about its normal.
    pub rotation: bool,
    /// Subdivision of triangles into patches.
    pub subdivision: SubdivisionRecord,
    /// Triangles that radiate from their backs: `auto` as the scene says, `on` all, `off` none.
    pub two_sided: &'static str,
    /// Names of objects with their one-sided triangles turned round, or `all`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flip: Vec<String>,
    /// Names of objects and materials that were left out.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<String>,
    /// True if triangles that lie exactly on others were kept.
    pub keep_duplicates: bool,
    /// Factor on coordinates.
    pub scale: f64,
    /// The axis that points up, where it is known.
    pub up: Option<&'static str>,
    /// The rows asked for.
    pub rows: RowsRecord,
    /// Names of the patches that have rows; empty: all.
    pub emitters: Vec<String>,
    /// Names of the patches that have columns; empty: all.
    pub receivers: Vec<String>,
    /// Names of the patches that have neither.
    pub occluders: Vec<String>,
    /// Form factors below this are left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_factor: Option<f64>,
    /// Kind of the patches; absent for triangles.
    #[serde(skip_serializing_if = "PatchKind::is_triangle")]
    pub patches: PatchKind,
    /// Number of elements, where patches are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elements: Option<u64>,
    /// Mirrors, panes, planes of symmetry, sectors, periods; absent without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub portals: Option<PortalRecord>,
    /// How the scene was read, where that says something.
    #[serde(skip_serializing_if = "ReadingRecord::is_empty")]
    pub reading: ReadingRecord,
}

/// How a scene was read: what was not taken as its file says, and what its file says beyond its triangles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReadingRecord {
    /// What was not taken as the file says; see [`hemicube_scene::Ledger`].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub losses: Vec<LossRecord>,
    /// Sentences on what the file as a whole lacks.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Further names of objects, by their number.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub further_names: BTreeMap<u32, Vec<String>>,
    /// The coordinate reference system.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crs: Option<String>,
}

/// A kind of loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossRecord {
    /// What became of it: `left out`, `approximated`, `merged`, `turned round`, `doubtful`.
    pub fate: String,
    /// The thing, in the singular.
    pub what: String,
    /// Number of cases.
    pub count: u64,
    /// Area in the scene's unit squared, where it is known of all cases.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<f64>,
    /// Where the first one is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<String>,
    /// The next thing to try.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}

impl LossRecord {
    /// The record of a loss of the thing `what`.
    pub fn of(what: &str, loss: &Loss) -> Self {
        Self {
            fate: loss.fate.name().to_owned(),
            what: what.to_owned(),
            count: loss.count,
            area: loss.area,
            first: loss.first.clone(),
            next: loss.next.clone(),
        }
    }

    /// The sentence on it.
    pub fn sentence(&self) -> String {
        let loss = Loss {
            fate: Fate::of_name(&self.fate).unwrap_or(Fate::Doubtful),
            count: self.count,
            area: self.area,
            first: self.first.clone(),
            next: self.next.clone(),
        };
        loss.sentence(&self.what)
    }
}

impl ReadingRecord {
    /// The record of a scene.
    pub fn of(scene: &Scene) -> Self {
        Self {
            losses: scene
                .ledger
                .losses()
                .map(|(what, loss)| LossRecord::of(what, loss))
                .collect(),
            warnings: scene.ledger.warnings.clone(),
            further_names: scene.further_names.clone(),
            crs: scene.crs.clone(),
        }
    }

    /// The record in the settings of a matrix; empty where there is none, or none that is known.
    pub fn of_settings(settings: &Value) -> Self {
        let record = settings.get("reading").cloned();
        record
            .and_then(|record| serde_json::from_value(record).ok())
            .unwrap_or_default()
    }

    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// A [`Subdivision`] in a manifest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SubdivisionRecord {
    /// One patch a triangle.
    None,
    /// Levels of halved edges.
    Subdivide(u32),
    /// Pieces of each edge.
    Split(u32),
    /// The longest piece of an edge.
    PatchSize(f64),
}

impl From<Subdivision> for SubdivisionRecord {
    fn from(subdivision: Subdivision) -> Self {
        match subdivision {
            Subdivision::None => Self::None,
            Subdivision::Levels(levels) => Self::Subdivide(levels),
            Subdivision::Split(pieces) => Self::Split(pieces),
            Subdivision::PatchSize(length) => Self::PatchSize(length),
        }
    }
}

/// A [`RowChoice`] in a manifest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RowsRecord {
    /// All that emit.
    All,
    /// The rows of a range of input patches.
    Range {
        /// The first.
        start: u32,
        /// One past the last.
        end: u32,
    },
    /// A sample.
    Sample {
        /// Number of rows.
        count: u32,
        /// Seed of the draw.
        seed: u64,
    },
}

impl From<RowChoice> for RowsRecord {
    fn from(choice: RowChoice) -> Self {
        match choice {
            RowChoice::All => Self::All,
            RowChoice::Range { start, end } => Self::Range { start, end },
            RowChoice::Sample { count, seed } => Self::Sample { count, seed },
        }
    }
}

/// An axis' name in settings and reports.
pub fn axis_name(axis: Axis) -> &'static str {
    match axis {
        Axis::X => "x",
        Axis::Y => "y",
        Axis::Z => "z",
    }
}

impl RowSettings {
    /// The header of a store of `plan`. It holds the last component of `file`, the scene's path.
    ///
    /// # Errors
    /// When there are more patches or rows than a store holds.
    pub fn header(
        &self,
        scene: &Scene,
        patches: &Patches,
        file: &Path,
        plan: &Plan,
        backend: &BackendInfo,
    ) -> Result<Header, Error> {
        let too_many = |what| Error::unsupported(file, format!("has more {what} than a matrix can have"));
        let name = file.file_name();
        let patch_count = plan
            .groups
            .as_ref()
            .map_or(patches.len(), |groups| groups.grouping.len());
        Ok(Header {
            program: PROGRAM.to_owned(),
            scene: SceneEntry {
                file: name.map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
                blake3: scene_hash(scene, patches),
            },
            settings: serde_json::to_value(self)
                .map_err(|error| Error::unsupported(file, format!("has settings that are no JSON: {error}")))?,
            correction: self.correction.to_owned(),
            patch_count: u32::try_from(patch_count).map_err(|_| too_many("patches"))?,
            row_count: u32::try_from(plan.row_count()).map_err(|_| too_many("rows"))?,
            rows_per_part: plan.rows_per_part,
            form: plan.form,
            min_factor: plan.min_factor,
            backend: BackendEntry {
                name: backend.name.clone(),
                version: plan.arithmetic(backend),
            },
            objects: scene.objects.clone(),
            materials: scene.materials.iter().map(|material| material.name.clone()).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_kept_and_read_back() {
        let mut scene = Scene::default();
        scene.further_names.insert(2, vec!["insulated".to_owned()]);
        let kind = hemicube_scene::Kind {
            fate: Fate::Merged,
            what: "face",
            next: "",
        };
        scene.ledger.lose(kind, 2, Some(1.5), || "`floor`".to_owned());
        scene.ledger.note("line element");
        let record = ReadingRecord::of(&scene);
        let settings = serde_json::json!({ "reading": record });
        let read = ReadingRecord::of_settings(&settings);
        assert_eq!(read, record);
        assert_eq!(read.losses.len(), 1);
        assert_eq!(
            read.losses[0].sentence(),
            "merged: 2 × face (area 1.5; the first: `floor`)"
        );
        assert_eq!(
            ReadingRecord::of_settings(&serde_json::json!({})),
            ReadingRecord::default()
        );
    }

    #[test]
    fn settings_have_readable_names() {
        let text = serde_json::to_string(&[
            SubdivisionRecord::None,
            SubdivisionRecord::PatchSize(0.5),
            SubdivisionRecord::Split(3),
        ])
        .unwrap();
        assert_eq!(text, r#"["none",{"patch_size":0.5},{"split":3}]"#);
        let text = serde_json::to_string(&RowsRecord::Range { start: 1, end: 4 }).unwrap();
        assert_eq!(text, r#"{"range":{"start":1,"end":4}}"#);
    }
}
