//! The manifest: the matrix's scene and settings, and the parts present.
//!
//! `manifest.json` is pretty-printed JSON with its fields in the order of [`Manifest`]. Its last field, `blake3`, is
//! the checksum of all bytes before that field's name. It holds no clock, no machine and no thread count: equal runs
//! give equal bytes.

use super::BalanceEntry;
use super::Thinning;
use super::durable::write_whole;
use super::{Error, Form, Result, RowSums};
use crate::grouping::PatchKind;
use hemicube_scene::{Patches, Scene, Side};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::io::Read;
use std::path::Path;

/// Value of [`Manifest::format`] in every store.
pub const FORMAT: &str = "hemicube-store";

/// Version of the format: this program reads and writes no other.
pub const VERSION: u32 = 5;

/// Most patches of a matrix: columns are `i32`, with room for marks beyond the last id.
pub const PATCH_COUNT_MAX: u32 = (1 << 31) - 16;

pub(crate) const MANIFEST_FILE: &str = "manifest.json";
pub(crate) const PATCHES_FILE: &str = "patches.npz";
pub(crate) const PARTS_DIRECTORY: &str = "parts";

/// A manifest of a million parts has 300 MB; larger ones are not ours.
const MANIFEST_SIZE_MAX: u64 = 1 << 29;

/// Text between the manifest's fields and its checksum, and after it.
const CHECKSUM_KEY: &str = ",\n  \"blake3\": \"";
const CHECKSUM_END: &str = "\"\n}\n";

/// A matrix before its first row is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Version of the program.
    pub program: String,
    /// The scene.
    pub scene: SceneEntry,
    /// The resolved settings: everything that rows depend on, and nothing else.
    pub settings: Value,
    /// Name of the correction: `pixel` for sums of visible weights.
    pub correction: String,
    /// Patches of the scene: the matrix is square, of this size.
    pub patch_count: u32,
    /// Rows of the finished store: all of them, or those selected or sampled.
    pub row_count: u32,
    /// Rows of each part; the last one has the rest.
    pub rows_per_part: u32,
    /// Form of the parts.
    pub form: Form,
    /// Smaller form factors are left out while rows are computed; 0: none.
    pub min_factor: f64,
    /// The engine.
    pub backend: BackendEntry,
    /// Object names; [`PatchTable::object`] counts into them.
    pub objects: Vec<String>,
    /// Material names; [`PatchTable::material`] counts into them.
    pub materials: Vec<String>,
}

impl Header {
    /// Number of parts of the finished store.
    pub fn part_count(&self) -> u32 {
        self.row_count.div_ceil(self.rows_per_part.max(1))
    }

    /// Kind of the patches, by `settings.patches`; triangles where the settings name none.
    pub fn patch_kind(&self) -> PatchKind {
        kind_of(&self.settings).unwrap_or_default()
    }
}

/// The mirror or pane that each patch is, if it is one, by a matrix's settings and the names of its objects and
/// materials; `None` without any.
///
/// # Panics
/// When `patches` are of another matrix.
pub fn optics_of(
    settings: &Value,
    [objects, materials]: [&[String]; 2],
    patches: &PatchTable,
) -> Option<Vec<Option<PatchOptics>>> {
    let surfaces = settings.get("portals")?.get("specular")?.get("surfaces")?;
    let of = |kind: &str, name: &str| {
        let optics = surfaces.get(format!("{kind} {name}"))?;
        Some(PatchOptics {
            specular: optics.get("specular")?.as_f64()?,
            transmittance: optics.get("transmittance")?.as_f64()?,
            varies: varies(optics),
        })
    };
    let all = |kind: &str, names: &[String]| names.iter().map(|name| of(kind, name)).collect::<Vec<_>>();
    let (objects, materials) = (all("object", objects), all("material", materials));
    let get = |values: &[Option<PatchOptics>], index: u32| values.get(index as usize).copied().flatten();
    let both = patches.object.iter().zip(&patches.material);
    let of_patch = |(&object, &material): (&u32, &u32)| get(&objects, object).or_else(|| get(&materials, material));
    Some(both.map(of_patch).collect())
}

/// ρs and τ of a patch; hemispherical means where they depend on the angle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PatchOptics {
    /// ρs.
    pub specular: f64,
    /// τ.
    pub transmittance: f64,
    /// True if they depend on the angle.
    pub varies: bool,
}

/// Returns whether recorded optics depend on the angle.
fn varies(optics: &Value) -> bool {
    optics.get("index").is_some() || optics.get("angles").is_some()
}

/// Returns whether settings name portals.
fn names_portals(settings: &Value) -> bool {
    settings.get("portals").is_some_and(|portals| !portals.is_null())
}

/// The kind of patches that settings name.
fn kind_of(settings: &Value) -> Option<PatchKind> {
    PatchKind::of_name(settings.get("patches")?.as_str()?)
}

/// The scene of a matrix.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Its file's name without a directory, or whatever a person recognises it by.
    pub file: String,
    /// BLAKE3 of the resolved patches, in hexadecimal; see [`scene_hash`].
    pub blake3: String,
}

/// The backend of the hemicubes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BackendEntry {
    /// Its name.
    pub name: String,
    /// Its version, with that of its arithmetic.
    pub version: String,
}

/// A file of a store and the checksum of its bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileEntry {
    /// Path in the store, with `/` between its steps.
    pub file: String,
    /// BLAKE3 of its bytes, in hexadecimal.
    pub blake3: String,
}

/// A part of a matrix.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartEntry {
    /// Place in the processing order, from 0.
    pub index: u32,
    /// Path in the store, with `/` between its steps.
    pub file: String,
    /// Number of rows.
    pub rows: u32,
    /// Number of entries.
    pub entries: u64,
    /// BLAKE3 of its bytes, in hexadecimal.
    pub blake3: String,
    /// Weights over all its rows.
    pub sums: RowSums,
}

/// Scene, settings and parts of a store.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// Version of the program.
    pub program: String,
    /// The scene.
    pub scene: SceneEntry,
    /// The resolved settings.
    pub settings: Value,
    /// BLAKE3 of the settings as compact JSON with sorted keys, in hexadecimal.
    pub settings_hash: String,
    /// Name of the correction: `pixel` for sums of visible weights.
    pub correction: String,
    /// Patches of the scene: the matrix is square, of this size.
    pub patch_count: u32,
    /// Rows of the finished store.
    pub row_count: u32,
    /// Parts of the finished store.
    pub part_count: u32,
    /// Rows of each part but the last.
    pub rows_per_part: u32,
    /// Form of the parts; absent where they are plain.
    #[serde(default, skip_serializing_if = "Form::is_plain")]
    pub form: Form,
    /// Relative rounding error of a form factor by the form; absent where the form is exact.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub value_error: f64,
    /// Smaller form factors were left out while rows were computed, the others of their row sharing their sum; absent
    /// where none were.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub min_factor: f64,
    /// The engine.
    pub backend: BackendEntry,
    /// Object names.
    pub objects: Vec<String>,
    /// Material names.
    pub materials: Vec<String>,
    /// The patch table, once it is written.
    pub patches: Option<FileEntry>,
    /// The parts present, by index. All of them in a complete store.
    pub parts: Vec<PartEntry>,
    /// Entries of all these parts.
    pub entries: u64,
    /// True if every part is there.
    pub complete: bool,
    /// Effect of leaving out small form factors, over the parts present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thinning: Option<Thinning>,
    /// Change of the matrix after it was computed; absent for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub balance: Option<BalanceEntry>,
}

/// A pretty-printed JSON table with the checksum of its text as its last field.
pub fn seal_json(mut text: String) -> String {
    // The closing brace and the line break before it.
    text.truncate(text.strip_suffix("\n}").map_or(text.len(), str::len));
    let checksum = blake3::hash(text.as_bytes()).to_hex();
    text.push_str(CHECKSUM_KEY);
    text.push_str(&checksum);
    text.push_str(CHECKSUM_END);
    text
}

/// Returns whether a text of [`seal_json`] is unchanged; `None` without a checksum.
fn is_sealed_json(text: &str) -> Option<bool> {
    let (body, end) = text.rsplit_once(CHECKSUM_KEY)?;
    let checksum = blake3::hash(body.as_bytes()).to_hex();
    Some(end.strip_suffix(CHECKSUM_END) == Some(checksum.as_str()))
}

/// Likewise for a text that may be of a version without a checksum.
pub fn is_sealed_or_plain_json(text: &str) -> bool {
    is_sealed_json(text).unwrap_or(true)
}

/// File name of `part`, from the store's directory.
pub(crate) fn part_file(part: u32) -> String {
    format!("{PARTS_DIRECTORY}/part-{part:05}.npz")
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde asks with a reference")]
fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

/// A setting in words: `with split 2`, `without min factor`.
fn in_words(name: &str, value: &Value) -> String {
    let shown = name.replace('_', " ");
    let with = |value: &dyn std::fmt::Display| format!("with {shown} {value}");
    match value {
        Value::Null if name == "patches" => "with rows by triangle".to_owned(),
        Value::String(kind) if name == "patches" => format!("with rows by {kind}"),
        Value::Null => format!("without {shown}"),
        Value::Array(globs) if globs.is_empty() => format!("without {shown}"),
        Value::Array(globs) => {
            let globs: Vec<String> = globs.iter().map(|glob| in_words(name, glob)).collect();
            globs.join(" and ")
        }
        Value::Bool(on) => with(&if *on { "on" } else { "off" }),
        Value::String(text) if name == "subdivision" && text == "none" => "with uncut triangles".to_owned(),
        Value::String(text) if name == "rows" && text == "all" => "with all rows".to_owned(),
        Value::String(text) => with(text),
        Value::Object(map) => match (name, map.iter().next()) {
            ("subdivision", Some((kind, fineness))) => in_words(kind, fineness),
            ("rows", Some((kind, rows))) if kind == "range" => {
                format!("with rows {}..{}", rows["start"], rows["end"])
            }
            ("rows", Some((_, rows))) => format!("with a sample of {} rows (seed {})", rows["count"], rows["seed"]),
            _ => with(value),
        },
        Value::Number(_) => with(value),
    }
}

/// Names the settings that differ. Settings of other programs have their path as a name.
fn differing(name: &str, theirs: &Value, ours: &Value, found: &mut Vec<String>) {
    // Options of portals are those of a run, and without any the record is missing.
    let none = serde_json::json!({});
    let or_none = |value: &'_ Value| matches!((name, value), ("portals", Value::Null));
    let theirs = if or_none(theirs) { &none } else { theirs };
    let ours = if or_none(ours) { &none } else { ours };
    let name = match name.strip_prefix("portals.").unwrap_or(name) {
        "specular.bound" => "specular_bound",
        name => name,
    };
    match (theirs, ours) {
        // They follow from the tolerance and the scene.
        _ if matches!(name, "reason" | "elements") => {}
        (Value::Object(theirs), Value::Object(ours)) if name == "specular.surfaces" => {
            let names: std::collections::BTreeSet<&String> = theirs.keys().chain(ours.keys()).collect();
            let others = names.into_iter().filter(|&name| theirs.get(name) != ours.get(name));
            let others: Vec<String> = others.map(|name| format!("`{name}`")).collect();
            if !others.is_empty() {
                found.push(format!(
                    "it was computed with other mirrors and panes, of {}",
                    others.join(", ")
                ));
            }
        }
        (Value::Object(_), Value::Null) | (Value::Null, Value::Object(_)) if name == "specular" => {
            let [theirs, ours] = [theirs, ours].map(|value| if value.is_null() { "without" } else { "with" });
            found.push(format!(
                "it was computed {theirs} mirrors and panes, and here it is {ours}"
            ));
        }
        (Value::Object(theirs), Value::Object(ours)) if !matches!(name, "subdivision" | "rows") => {
            let keys: std::collections::BTreeSet<&String> = theirs.keys().chain(ours.keys()).collect();
            for key in keys {
                let inner = if name.is_empty() {
                    key.clone()
                } else {
                    format!("{name}.{key}")
                };
                let of = |map: &serde_json::Map<String, Value>| map.get(key).cloned().unwrap_or(Value::Null);
                differing(&inner, &of(theirs), &of(ours), found);
            }
        }
        _ if theirs != ours => {
            let [theirs, ours] = [theirs, ours].map(|value| in_words(name, value));
            found.push(format!("it was computed {theirs}, and here it is {ours}"));
        }
        _ => {}
    }
}

/// Keys in alphabetical order at every level, whatever order the JSON crate was built to keep.
fn sorted(value: &Value) -> Value {
    match value {
        Value::Object(map) => {
            let by_key: BTreeMap<&String, Value> = map.iter().map(|(key, value)| (key, sorted(value))).collect();
            Value::Object(by_key.into_iter().map(|(key, value)| (key.clone(), value)).collect())
        }
        Value::Array(values) => Value::Array(values.iter().map(sorted).collect()),
        other => other.clone(),
    }
}

impl Manifest {
    /// The manifest of a store without parts.
    pub(crate) fn new(header: Header) -> Self {
        let part_count = header.part_count();
        let settings = sorted(&header.settings);
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            program: header.program,
            scene: header.scene,
            settings_hash: blake3::hash(settings.to_string().as_bytes()).to_hex().to_string(),
            settings,
            correction: header.correction,
            patch_count: header.patch_count,
            row_count: header.row_count,
            part_count,
            rows_per_part: header.rows_per_part,
            form: header.form,
            value_error: header.form.value_error(),
            min_factor: header.min_factor,
            backend: header.backend,
            objects: header.objects,
            materials: header.materials,
            patches: None,
            parts: Vec::new(),
            entries: 0,
            complete: false,
            thinning: None,
            balance: None,
        }
    }

    /// Id of the run, in every part: equal for all processes that compute the same rows in the same way, and different
    /// as soon as a bit of a part could be.
    pub(crate) fn run_id(&self) -> [u8; 32] {
        let identity = serde_json::json!({
            "format": self.format,
            "version": self.version,
            "program": self.program,
            "scene": self.scene.blake3,
            "settings": self.settings,
            "correction": self.correction,
            "patch_count": self.patch_count,
            "row_count": self.row_count,
            "rows_per_part": self.rows_per_part,
            "form": self.form,
            "min_factor": self.min_factor,
            "backend": [self.backend.name, self.backend.version],
        });
        *blake3::hash(sorted(&identity).to_string().as_bytes()).as_bytes()
    }

    /// Id of the run in hexadecimal, as a matrix that takes rows over names this one.
    pub fn run(&self) -> String {
        blake3::Hash::from_bytes(self.run_id()).to_hex().to_string()
    }

    /// Difference between the runs of two stores, for a person, theirs first; `None` when their parts belong together.
    /// The scene's content counts, not its file's name.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        let of = |what: &str, theirs: &dyn std::fmt::Display, ours: &dyn std::fmt::Display| {
            Some(format!("its {what} is {theirs}, here it is {ours}"))
        };
        if self.program != other.program {
            return of("version of hemicube", &self.program, &other.program);
        }
        if self.backend.name != other.backend.name {
            return of("backend", &self.backend.name, &other.backend.name);
        }
        // Settings before the scene: they may be why it is another.
        let mut differences = Vec::new();
        differing("", &self.settings, &other.settings, &mut differences);
        if !differences.is_empty() {
            return Some(differences.join("; "));
        }
        if self.form != other.form {
            return of("form", &self.form.name(), &other.form.name());
        }
        if self.patch_count != other.patch_count {
            return of("number of patches", &self.patch_count, &other.patch_count);
        }
        if self.scene.blake3 != other.scene.blake3 || self.objects != other.objects || self.materials != other.materials
        {
            return Some(format!(
                "it is of another scene: `{}` has changed since, or is another file than `{}`",
                other.scene.file, self.scene.file
            ));
        }
        // After its possible causes: scenes and settings imply engines of their own.
        if self.backend.version != other.backend.version {
            let what = format!("version of the backend `{}`", self.backend.name);
            return of(&what, &self.backend.version, &other.backend.version);
        }
        // The rest follows, unless somebody edited a manifest by hand.
        (self.run_id() != other.run_id()).then(|| "it was computed in another way".to_owned())
    }

    /// Number of rows of `part`.
    pub fn rows_of_part(&self, part: u32) -> u32 {
        let first = u64::from(part) * u64::from(self.rows_per_part);
        let left = u64::from(self.row_count).saturating_sub(first);
        u32::try_from(left.min(u64::from(self.rows_per_part))).unwrap_or(0)
    }

    /// Rows of all parts present.
    pub fn rows_present(&self) -> u64 {
        self.parts.iter().map(|part| u64::from(part.rows)).sum()
    }

    /// The bytes of `manifest.json`.
    ///
    /// # Errors
    /// Only for settings that JSON cannot hold.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(seal_json)
    }

    pub(crate) fn write(&self, directory: &Path) -> Result<()> {
        self.write_as(directory, "")
    }

    /// [`Self::write`] with a label in the temporary name.
    pub(crate) fn write_as(&self, directory: &Path, label: &str) -> Result<()> {
        let path = directory.join(MANIFEST_FILE);
        let text = self
            .to_json()
            .map_err(|error| Error::refused(&path, format!("its settings are no JSON: {error}")))?;
        write_whole(&path, text.as_bytes(), label)
    }

    /// Returns whether `directory` holds a manifest of this format, of whatever version and in whatever state.
    pub(crate) fn is_in(directory: &Path) -> bool {
        // The format's name comes first; the rest may be damaged.
        let start = format!("{{\n  \"format\": \"{FORMAT}\"");
        let mut found = vec![0; start.len()];
        hemicube_scene::open_regular(&directory.join(MANIFEST_FILE))
            .and_then(|mut file| file.read_exact(&mut found))
            .is_ok_and(|()| found == start.as_bytes())
    }

    pub(crate) fn read(directory: &Path) -> Result<Self> {
        let path = directory.join(MANIFEST_FILE);
        let file = match hemicube_scene::open_regular(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound && directory.is_dir() => {
                return Err(Error::malformed(
                    directory,
                    format!("is no store: it has no `{MANIFEST_FILE}`"),
                ));
            }
            Err(error) => return Err(Error::io(&path, "opened", error)),
        };
        let mut bytes = Vec::new();
        file.take(MANIFEST_SIZE_MAX + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| Error::io(&path, "read", error))?;
        if bytes.len() as u64 > MANIFEST_SIZE_MAX {
            return Err(Error::malformed(&path, "is too large for a manifest"));
        }
        Self::parse(&bytes).map_err(|reason| Error::malformed(&path, reason))
    }

    fn parse(bytes: &[u8]) -> std::result::Result<Self, String> {
        let text = std::str::from_utf8(bytes).map_err(|_| "is not text: it is damaged")?;
        let mut value: Value = serde_json::from_str(text).map_err(|error| format!("is no JSON: {error}"))?;
        let fields = value.as_object_mut().ok_or("is no manifest of a store")?;
        if fields.get("format").and_then(Value::as_str) != Some(FORMAT) {
            return Err("is no manifest of a store".into());
        }
        match fields.get("version").and_then(Value::as_u64) {
            Some(version) if version == u64::from(VERSION) => {}
            Some(version) => {
                return Err(format!(
                    "has version {version}; this program reads version {VERSION}: use the one that wrote it"
                ));
            }
            None => return Err("has no version".into()),
        }
        if !is_sealed_json(text).ok_or("has no checksum: it is truncated or damaged")? {
            return Err("has changed since it was written: its checksum does not fit".into());
        }
        fields.remove("blake3");
        let manifest: Self =
            serde_json::from_value(value).map_err(|error| format!("is no manifest of a store: {error}"))?;
        manifest.check()?;
        Ok(manifest)
    }

    /// Returns whether rows go through portals: mirrors, panes, planes of symmetry, sectors, periods. A row then says
    /// what portals handed on and what was cut off.
    pub fn has_portals(&self) -> bool {
        names_portals(&self.settings)
    }

    /// Returns whether mirrors or panes hand on what arrives at them, so that form factors are of arrivals
    /// ([`Passage`](super::Passage)).
    pub fn has_specular(&self) -> bool {
        let specular = self.settings.get("portals").and_then(|portals| portals.get("specular"));
        self.has_portals() && specular.is_some_and(|specular| !specular.is_null())
    }

    /// ρs + τ of each patch, by the names of the mirrors and panes; `None` without any. Hemispherical means where they
    /// depend on the angle.
    ///
    /// # Panics
    /// When `patches` are of another store.
    pub fn handed_on(&self, patches: &PatchTable) -> Option<Vec<f64>> {
        let optics = self.optics_of(patches)?;
        let passed = |optics: Option<PatchOptics>| optics.map_or(0.0, |optics| optics.specular + optics.transmittance);
        Some(optics.into_iter().map(passed).collect())
    }

    /// The mirror or pane that each patch is, if it is one; `None` without any.
    ///
    /// # Panics
    /// When `patches` are of another store.
    pub fn optics_of(&self, patches: &PatchTable) -> Option<Vec<Option<PatchOptics>>> {
        optics_of(&self.settings, [&self.objects, &self.materials], patches)
    }

    /// Returns whether the optics of a mirror or a pane depend on the angle.
    pub fn passes_by_angle(&self) -> bool {
        let specular = self.settings.get("portals").and_then(|portals| portals.get("specular"));
        let surfaces = specular
            .and_then(|specular| specular.get("surfaces"))
            .and_then(Value::as_object);
        surfaces.is_some_and(|surfaces| surfaces.values().any(varies))
    }

    /// The end of form factors.
    pub(super) fn factor_end(&self) -> f32 {
        if self.has_specular() {
            super::validate::PASSED_FACTOR_END
        } else {
            super::validate::FACTOR_END
        }
    }

    /// Kind of the patches: rows and columns.
    pub fn patch_kind(&self) -> PatchKind {
        kind_of(&self.settings).unwrap_or_default()
    }

    /// Number of elements of the scene, its triangles as cut, by `settings.elements`; the patches where they are
    /// triangles.
    pub fn elements(&self) -> u64 {
        let counted = self.settings.get("elements").and_then(Value::as_u64);
        counted
            .filter(|_| !self.patch_kind().is_triangle())
            .unwrap_or_else(|| self.patch_count.into())
    }

    /// Returns whether the numbers fit together. Every size allocated later rests on this or on a file's size.
    fn check(&self) -> std::result::Result<(), String> {
        if self.patch_count > PATCH_COUNT_MAX || self.row_count > self.patch_count {
            return Err(format!(
                "has {} rows of {} patches, which cannot be",
                self.row_count, self.patch_count
            ));
        }
        if self.rows_per_part == 0 || self.part_count != self.row_count.div_ceil(self.rows_per_part) {
            return Err(format!(
                "has {} parts of {} rows, which cannot be",
                self.part_count, self.rows_per_part
            ));
        }
        if self.value_error != self.form.value_error() || !(0.0..1.0).contains(&self.min_factor) {
            return Err(format!(
                "has {:?} parts with a value error of {} and a least factor of {}, which cannot be",
                self.form, self.value_error, self.min_factor
            ));
        }
        if self.patches.as_ref().is_some_and(|entry| entry.file != PATCHES_FILE) {
            return Err("has its patch table in another place than a store has it".into());
        }
        let mut entries = 0u64;
        for (place, part) in self.parts.iter().enumerate() {
            let after = place.checked_sub(1).and_then(|before| self.parts.get(before));
            if part.index >= self.part_count
                || after.is_some_and(|before| before.index >= part.index)
                || part.file != part_file(part.index)
                || part.rows != self.rows_of_part(part.index)
                || part.entries > u64::from(part.rows) * u64::from(self.patch_count)
            {
                return Err(format!("has a part `{}` that does not fit the rest", part.file));
            }
            entries = entries.saturating_add(part.entries);
        }
        if entries != self.entries || self.complete != (self.parts.len() as u64 == u64::from(self.part_count)) {
            return Err("has totals that its parts do not have".into());
        }
        Ok(())
    }
}

/// The patches of a matrix, in input order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PatchTable {
    /// Number of the scene file's face that the patch was cut from, from 0; [`Self::SEVERAL`].
    pub face: Vec<u32>,
    /// Index into [`Manifest::objects`]; [`Self::SEVERAL`].
    pub object: Vec<u32>,
    /// Index into [`Manifest::materials`]; [`Self::SEVERAL`].
    pub material: Vec<u32>,
    /// 0 for a front, 1 for the back of a two-sided triangle; 1 for a patch of several elements if all are backs.
    pub side: Vec<u8>,
    /// Area, in the file's unit squared.
    pub area: Vec<f64>,
    /// Centroid, in the file's unit.
    pub centroid: Vec<[f64; 3]>,
    /// Unit normal, away from the radiating side; zero for a patch without area, and for elements that lie in no plane.
    pub normal: Vec<[f64; 3]>,
    /// The three corners, in the file's unit, counter-clockwise as seen from the radiating side; empty where patches are
    /// several elements.
    pub corners: Vec<[[f64; 3]; 3]>,
    /// The number by which random numbers are drawn for a patch; empty: its own. A matrix that took rows over from
    /// another has the numbers of that one.
    pub drawn_by: Vec<u32>,
}

impl PatchTable {
    /// Face, object or material of a patch whose elements have several.
    pub const SEVERAL: u32 = u32::MAX;

    /// The table of `patches`, cut from `scene`.
    pub fn new(scene: &Scene, patches: &Patches) -> Self {
        let mut table = Self::default();
        for patch in patches.iter() {
            let triangle = &scene.triangles[patches.triangle(patch)];
            table.face.push(triangle.face);
            table.object.push(triangle.object);
            table.material.push(triangle.material);
            table.side.push(match patches.side(patch) {
                Side::Front => 0,
                Side::Back => 1,
            });
            table.area.push(patches.area(patch));
            table.centroid.push(patches.centroid(patch).to_array());
            table.normal.push(patches.normal(patch).to_array());
            table
                .corners
                .push(patches.corners(patch).map(|corner| corner.to_array()));
        }
        table
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// Returns whether there is no patch.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// By triangle of `corners`, the patch here with the same corners, to the bit but for the sign of 0. Of several in
    /// one place, the first stands for the first, and so on.
    pub fn partners(&self, corners: impl Iterator<Item = [[f64; 3]; 3]>) -> Vec<Option<u32>> {
        let key = |corners: &[[f64; 3]; 3]| corners.map(|corner| corner.map(|x| (x + 0.0).to_bits()));
        let mut places: HashMap<_, VecDeque<u32>> = HashMap::with_capacity(self.corners.len());
        for (corners, patch) in self.corners.iter().zip(0u32..) {
            places.entry(key(corners)).or_default().push_back(patch);
        }
        corners
            .map(|corners| places.get_mut(&key(&corners)).and_then(VecDeque::pop_front))
            .collect()
    }

    pub(crate) fn is_of(&self, patch_count: u32) -> bool {
        let lengths = [
            self.face.len(),
            self.object.len(),
            self.material.len(),
            self.side.len(),
            self.area.len(),
            self.centroid.len(),
            self.normal.len(),
        ];
        let optional = [self.corners.len(), self.drawn_by.len()];
        lengths.iter().all(|&length| length == patch_count as usize)
            && optional
                .iter()
                .all(|&length| length == 0 || length == patch_count as usize)
    }
}

/// BLAKE3 of the resolved patches, in hexadecimal: the corners of every surface, and for every patch its surface, side,
/// object and material. Equal geometry under another file name has the same hash; one bit of one corner changes it.
///
/// ```
/// use hemicube_store::scene_hash;
/// use hemicube_scene::{Patches, Subdivision, generate};
///
/// let mut scene = generate::cornell_box();
/// let hash = |scene: &_| Ok::<_, hemicube_scene::Error>(scene_hash(scene, &Patches::new(scene, Subdivision::None)?));
/// let before = hash(&scene)?;
/// assert_eq!((before.len(), hash(&scene)?), (64, before.clone()));
/// scene.triangles[0].corners[0].x += 1e-9;
/// assert_ne!(hash(&scene)?, before);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn scene_hash(scene: &Scene, patches: &Patches) -> String {
    let mut hasher = blake3::Hasher::new();
    // Gathered first: hashing several kilobytes at once is many times as fast as eight bytes.
    let mut bytes = Vec::with_capacity(HASHED + 128);
    for corner in patches.surfaces().iter().flatten() {
        for coordinate in corner.to_array() {
            bytes.extend_from_slice(&coordinate.to_bits().to_le_bytes());
        }
        hash_when_full(&mut hasher, &mut bytes);
    }
    for patch in patches.iter() {
        let triangle = &scene.triangles[patches.triangle(patch)];
        bytes.extend_from_slice(&(patches.surface(patch) as u64).to_le_bytes());
        bytes.push(u8::from(patches.side(patch) == Side::Back));
        bytes.extend_from_slice(&triangle.object.to_le_bytes());
        bytes.extend_from_slice(&triangle.material.to_le_bytes());
        hash_when_full(&mut hasher, &mut bytes);
    }
    hasher.update(&bytes);
    hasher.finalize().to_hex().to_string()
}

/// Bytes hashed at a time.
const HASHED: usize = 1 << 16;

fn hash_when_full(hasher: &mut blake3::Hasher, bytes: &mut Vec<u8>) {
    if bytes.len() >= HASHED {
        hasher.update(bytes);
        bytes.clear();
    }
}
