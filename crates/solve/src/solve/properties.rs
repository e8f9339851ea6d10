//! Properties of surfaces by the names of objects and materials.
//!
//! ```text
//! default              emissivity 0.9                     patches without a value of their own
//! material  facade*    reflectance 0.5                    a name, or a pattern: `*` any characters, `?` one
//! object    Zone 3*    temperature 20 °C                  goes before a material's
//! ```
//!
//! Of each patch at most one table of objects and one of materials hold: that of the exact name, otherwise the matching
//! pattern with most characters besides `*` and `?`. Two such patterns are an error. Each value is the object's
//! table's, otherwise the material's, otherwise `default`'s, otherwise the scene's. The thermal condition
//! (`temperature`, `adiabatic`, `flux`, `heat`, `isothermal`, `body`) is one value.
//!
//! A table holds for each name that it matches by itself: `heat` is each surface's, and an isothermal pattern makes one
//! temperature for each name. Surfaces of one `body` are one surface in both: they share one temperature and one heat.
//!
//! A patch with elements of several materials, or of several objects ([`PatchTable::SEVERAL`]), has the values on which
//! the tables of all materials or objects agree. Others are refused where they are needed and no table before has them.

use hemicube_scene::globs::{Patterns, matches_glob};
use hemicube_store::{PatchKind, PatchTable};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};

/// Bands without `bands`.
pub const RGB: [&str; 3] = ["red", "green", "blue"];
/// Names in an error.
const NAMES_SHOWN: usize = 5;
/// Upper bound of temperatures, in kelvin.
const KELVIN_MAX: f64 = 1e6;
/// 0 °C in kelvin.
const CELSIUS_ZERO: f64 = 273.15;
/// Begins the names of materials that View3D's scenes give: `emissivity 0.95`.
const EMISSIVITY: &str = "emissivity ";

/// Why properties do not fit a matrix, and the next step.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct PropertyError {
    /// The thing and the reason.
    pub reason: String,
    /// The next step, where there is one.
    pub step: Option<PropertyStep>,
}

/// What helps against a [`PropertyError`]; front ends have their own words for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PropertyStep {
    /// In words.
    Words(String),
    /// Leave the scene's properties out.
    WithoutScene,
    /// Give each surface a reflectance: the scene's file may have some.
    Reflectance,
    /// Give each surface an emissivity and a condition.
    Thermal,
    /// Give each surface an emissivity.
    Emissivity,
    /// Give each surface an absorptance, or a reflectance.
    Absorptance,
    /// Compute the matrix by one of these kinds of patches; or give this surface a value in a table of its object.
    Patches {
        /// The kinds.
        kinds: [PatchKind; 2],
        /// The surface, where a table of its object helps.
        table_of: Option<String>,
    },
}

impl From<String> for PropertyStep {
    fn from(words: String) -> Self {
        Self::Words(words)
    }
}

impl From<&str> for PropertyStep {
    fn from(words: &str) -> Self {
        Self::Words(words.to_owned())
    }
}

impl PropertyError {
    fn new(reason: impl Into<String>) -> Self {
        Self {
            reason: reason.into(),
            step: None,
        }
    }

    fn with(reason: impl Into<String>, step: impl Into<PropertyStep>) -> Self {
        Self {
            reason: reason.into(),
            step: Some(step.into()),
        }
    }
}

type Result<T> = std::result::Result<T, PropertyError>;

/// A number for all bands, or one for each.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "one number, or a list with one for each band, is needed")]
pub enum Spectrum {
    /// All bands.
    Grey(f64),
    /// Band by band.
    Bands(Vec<f64>),
}

/// A temperature as written: kelvin as a number or `"293 K"`, degrees Celsius as `"20 °C"` or `"20 C"`.
///
/// ```
/// use hemicube_solve::solve::Temperature;
/// for text in ["20 °C", "20C", "20 degC", "293.15", "293.15 K"] {
///     assert_eq!(text.parse::<Temperature>()?.kelvin(), 293.15, "{text}");
/// }
/// assert!("20 F".parse::<Temperature>().is_err() && "-300 °C".parse::<Temperature>().is_err());
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "TemperatureAsWritten", into = "f64")]
pub struct Temperature {
    kelvin: f64,
    is_celsius: bool,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a number of kelvin, or a text such as \"20 °C\", is needed")]
enum TemperatureAsWritten {
    Number(f64),
    Text(String),
}

impl TryFrom<TemperatureAsWritten> for Temperature {
    type Error = String;

    fn try_from(written: TemperatureAsWritten) -> std::result::Result<Self, String> {
        match written {
            // Judged where its surface is known.
            TemperatureAsWritten::Number(kelvin) => Ok(Self {
                kelvin,
                is_celsius: false,
            }),
            TemperatureAsWritten::Text(text) => text.parse(),
        }
    }
}

impl From<Temperature> for f64 {
    fn from(temperature: Temperature) -> Self {
        temperature.kelvin
    }
}

impl Temperature {
    /// Temperature in kelvin below which one is asked about ([`question_of_cold`]).
    pub const COLD: f64 = 100.0;

    /// In kelvin.
    pub fn kelvin(self) -> f64 {
        self.kelvin
    }

    /// True if it was given in degrees Celsius.
    pub fn is_celsius(self) -> bool {
        self.is_celsius
    }
}

/// Number of temperatures that [`question_of_cold`] names.
const COLD_SHOWN: usize = 3;

/// Asks whether temperatures below [`Temperature::COLD`], each with what it is of, are degrees Celsius; `None` without
/// any. It names three of them at most.
pub fn question_of_cold(cold: &[String]) -> Option<String> {
    let mut shown: Vec<String> = cold.iter().take(COLD_SHOWN).cloned().collect();
    if cold.len() > COLD_SHOWN {
        shown.push(format!("{} more", cold.len() - COLD_SHOWN));
    }
    (!shown.is_empty()).then(|| {
        format!(
            "{}: below {} K; if degrees Celsius are meant, add 273.15, for temperatures are in kelvin",
            shown.join(", "),
            Temperature::COLD
        )
    })
}

impl std::str::FromStr for Temperature {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = || format!("`{text}` is no temperature: kelvin, from 0 on, or `20 °C` is needed");
        let trimmed = text.trim();
        let end = trimmed
            .find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | 'e' | 'E')))
            .unwrap_or(trimmed.len());
        let (digits, unit) = trimmed.split_at(end);
        let number: f64 = digits.trim().parse().map_err(|_| wrong())?;
        let unit = unit.trim().to_lowercase().replace(' ', "");
        let is_celsius = match unit.as_str() {
            "" | "k" | "kelvin" => false,
            "°c" | "℃" | "c" | "degc" | "celsius" => true,
            _ => return Err(wrong()),
        };
        let kelvin = if is_celsius { number + CELSIUS_ZERO } else { number };
        if (0.0..=KELVIN_MAX).contains(&kelvin) {
            Ok(Self { kelvin, is_celsius })
        } else {
            Err(wrong())
        }
    }
}

/// A table of properties; absent values come from the tables after it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// From 0 to 1.
    pub reflectance: Option<Spectrum>,
    /// Emitted radiosity, from 0 on.
    pub emission: Option<Spectrum>,
    /// From 0 to 1; bands are for exchange factors.
    pub emissivity: Option<Spectrum>,
    /// Share of the sun's radiation that is absorbed, from 0 to 1.
    pub absorptance: Option<f64>,
    /// A given temperature.
    pub temperature: Option<Temperature>,
    /// No net flux on any patch.
    pub adiabatic: Option<bool>,
    /// Net flux in W/m², positive where the surface gives heat to the enclosure.
    pub flux: Option<f64>,
    /// Net heat of the whole surface in W, positive where it gives heat to the enclosure.
    pub heat: Option<f64>,
    /// One unknown temperature for the whole surface, with `flux` or `heat`; alone: with no net heat.
    pub isothermal: Option<bool>,
    /// The body that the surface is a part of: all of its surfaces have one temperature, and `heat` is the body's.
    pub body: Option<String>,
}

/// All tables: a file of materials, or a dictionary.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tables {
    /// Names of the bands.
    pub bands: Option<Vec<String>>,
    /// For what has no value of its own.
    #[serde(default)]
    pub default: Entry,
    /// By the names of materials.
    #[serde(default)]
    pub material: BTreeMap<String, Entry>,
    /// By the names of objects.
    #[serde(default)]
    pub object: BTreeMap<String, Entry>,
}

/// Names of a matrix, and the object and material of each patch, as its manifest and its patch table have them.
#[derive(Clone, Copy, Debug)]
pub struct Named<'a> {
    /// Names of objects.
    pub objects: &'a [String],
    /// Names of materials.
    pub materials: &'a [String],
    /// Index of each patch's object; [`PatchTable::SEVERAL`].
    pub object: &'a [u32],
    /// Index of each patch's material; [`PatchTable::SEVERAL`].
    pub material: &'a [u32],
}

/// The table of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Level {
    /// A body, which any of them may name.
    Body,
    Object,
    Material,
    Default,
}

/// Patches with the same properties: of one material, or of one object and one material.
#[derive(Clone, Debug)]
struct Kind {
    /// `None` where tables name no objects, and for patches of several.
    object: Option<u32>,
    /// [`PatchTable::SEVERAL`] for patches of several.
    material: u32,
    entry: Entry,
    /// The table of the thermal condition.
    condition: Level,
    /// Values that the tables of several objects or materials give this patch.
    unclear: Vec<(Value, Level)>,
    is_used: bool,
}

/// A value of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Value {
    Reflectance,
    Emission,
    Emissivity,
    Absorptance,
    Condition,
}

impl Value {
    const ALL: [Self; 5] = [
        Self::Reflectance,
        Self::Emission,
        Self::Emissivity,
        Self::Absorptance,
        Self::Condition,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Reflectance => "a reflectance",
            Self::Emission => "an emission",
            Self::Emissivity => "an emissivity",
            Self::Absorptance => "an absorptance",
            Self::Condition => "a temperature, flux or heat",
        }
    }

    fn is_in(self, entry: &Entry) -> bool {
        match self {
            Self::Reflectance => entry.reflectance.is_some(),
            Self::Emission => entry.emission.is_some(),
            Self::Emissivity => entry.emissivity.is_some(),
            Self::Absorptance => entry.absorptance.is_some(),
            Self::Condition => entry.has_condition(),
        }
    }

    fn is_same(self, a: &Entry, b: &Entry) -> bool {
        match self {
            Self::Reflectance => a.reflectance == b.reflectance,
            Self::Emission => a.emission == b.emission,
            Self::Emissivity => a.emissivity == b.emissivity,
            Self::Absorptance => a.absorptance == b.absorptance,
            Self::Condition => a.condition() == b.condition() && a.body == b.body,
        }
    }
}

/// Reflectance and emission, a number a band.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Optics {
    /// Name of the material.
    pub name: String,
    /// Name of the object, where tables name objects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    /// From 0 to 1, a number a band.
    pub reflectance: Vec<f64>,
    /// Radiosity, a number a band.
    pub emission: Vec<f64>,
}

/// The thermal condition of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// Kelvin.
    Temperature(Temperature),
    /// W/m² on each patch; 0: adiabatic.
    Flux(f64),
    /// W on all patches of the surface, spread evenly over their area.
    Heat(f64),
    /// One unknown temperature for all patches of the surface, with this net heat in W/m² of its area.
    IsothermalFlux(f64),
    /// One unknown temperature for all patches of the surface, with this net heat in W.
    IsothermalHeat(f64),
}

/// A kind of patches in an exchange of heat.
#[derive(Clone, Debug, PartialEq)]
pub struct Thermal {
    /// Name of the material.
    pub material: String,
    /// Name of the object, where tables name objects.
    pub object: Option<String>,
    /// From 0 to 1; `None` where a flux is given and nothing else is known.
    pub emissivity: Option<f64>,
    /// True if the emissivity is the scene's ([`Properties::emissivities_of_scene`]).
    pub is_of_scene: bool,
    /// The condition.
    pub condition: Condition,
    /// Number of the surface that the condition is of: kinds of one number share `heat` and one unknown temperature.
    pub surface: u32,
    /// The body that it is a part of.
    pub body: Option<String>,
    /// True if a patch is of this kind.
    pub is_used: bool,
}

impl Thermal {
    /// The surface that the condition is of, in words.
    pub fn shown(&self) -> String {
        shown(self.object.as_deref(), &self.material)
    }
}

fn shown(object: Option<&str>, material: &str) -> String {
    match (object, material) {
        (None, "") => "faces without a material".to_owned(),
        (None, name) => format!("material `{name}`"),
        (Some(object), "") => format!("object `{object}`"),
        (Some(object), material) => format!("object `{object}`, material `{material}`"),
    }
}

/// Properties of the patches of a matrix.
///
/// ```
/// use hemicube_solve::solve::{Condition, Named, Properties, Tables};
///
/// // Objects `Zone 3 / floor`, `Zone 3 / roof` and `duct`, a patch each, all of one material.
/// let objects = ["Zone 3 / floor", "Zone 3 / roof", "duct"].map(str::to_owned);
/// let materials = ["concrete".to_owned()];
/// let named = Named { objects: &objects, materials: &materials, object: &[0, 1, 2], material: &[0, 0, 0] };
/// let tables: Tables = serde_json::from_str(
///     r#"{"default": {"adiabatic": true}, "material": {"concrete": {"emissivity": 0.9}},
///         "object": {"Zone 3*": {"temperature": "20 °C"}, "*floor": {"flux": 40}}}"#,
/// )?;
/// let properties = Properties::new(named, None, tables)?;
/// let thermal = properties.thermal()?;
/// let of = |patch: usize| thermal[properties.kind_of_patch()[patch] as usize].condition;
/// // `Zone 3*` has more characters of its own than `*floor`.
/// assert!(matches!(of(0), Condition::Temperature(kelvin) if kelvin.kelvin() == 293.15));
/// assert_eq!(of(2), Condition::Flux(0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Properties {
    bands: Vec<String>,
    objects: Vec<String>,
    materials: Vec<String>,
    /// Diffuse reflectance and emission of materials in the scene's file.
    scene: Option<Vec<[Option<[f64; 3]>; 2]>>,
    kinds: Vec<Kind>,
    kind_of_patch: Vec<u32>,
    object_of_patch: Vec<u32>,
    has_objects: bool,
    has_materials: bool,
    notes: Vec<String>,
}

impl Properties {
    /// Gives each patch its tables. `scene`: reflectance and emission of each material in the scene's file.
    ///
    /// A table of a material that only an object is called counts as that object's, with a note
    /// ([`Self::notes`]).
    ///
    /// # Errors
    /// For a name that nothing has, two patterns that match alike, a table with conditions that exclude each other, and
    /// bands that do not fit the scene's.
    pub fn new(named: Named<'_>, scene: Option<Vec<[Option<[f64; 3]>; 2]>>, mut tables: Tables) -> Result<Self> {
        let bands = tables.bands.take().unwrap_or_else(|| RGB.map(str::to_owned).to_vec());
        if bands.is_empty() {
            return Err(PropertyError::new("`bands` names no band"));
        }
        if scene.is_some() && bands.len() != RGB.len() {
            return Err(PropertyError::with(
                format!(
                    "the scene's reflectances are of {} bands and the file's of {}",
                    RGB.len(),
                    bands.len()
                ),
                PropertyStep::WithoutScene,
            ));
        }
        let notes = objects_called_materials(named, &mut tables);
        check_conditions(&tables)?;
        let of_material = Matched::new(named.materials, &tables.material, "material")?;
        let of_object = Matched::new(named.objects, &tables.object, "object")?;
        of_material.require_all_used(&tables, named)?;
        of_object.require_all_used(&tables, named)?;
        let has_objects = !tables.object.is_empty()
            || tables.default.is_of_surfaces()
            || named.material.contains(&PatchTable::SEVERAL);
        let (kinds, kind_of_patch) = kinds(named, &tables, &of_object, &of_material, scene.as_deref(), has_objects);
        Ok(Self {
            bands,
            objects: named.objects.to_vec(),
            materials: named.materials.to_vec(),
            scene,
            kinds,
            kind_of_patch,
            object_of_patch: named.object.to_vec(),
            has_objects,
            has_materials: !tables.material.is_empty(),
            notes,
        })
    }

    /// These, with kinds by object: for [`Self::tables`].
    #[must_use]
    pub fn by_object(&self) -> Self {
        if self.has_objects {
            return self.clone();
        }
        let mut found = self.clone();
        let mut known: HashMap<(u32, u32), u32> = HashMap::new();
        found.kinds.clear();
        found.kind_of_patch.clear();
        for (&object, &kind) in self.object_of_patch.iter().zip(&self.kind_of_patch) {
            let next = u32::try_from(found.kinds.len()).unwrap_or(u32::MAX);
            let number = *known.entry((object, kind)).or_insert(next);
            if number == next {
                found.kinds.push(Kind {
                    object: one(object),
                    ..self.kinds[kind as usize].clone()
                });
            }
            found.kind_of_patch.push(number);
        }
        found.has_objects = true;
        found
    }

    /// Names of the bands.
    pub fn bands(&self) -> &[String] {
        &self.bands
    }

    /// Kind of each patch: an index into [`Self::optics`] and [`Self::thermal`].
    pub fn kind_of_patch(&self) -> &[u32] {
        &self.kind_of_patch
    }

    /// True if kinds are of objects, not of materials alone.
    pub fn has_objects(&self) -> bool {
        self.has_objects
    }

    /// True if materials were given values, and nothing is of objects: results are then of materials, unless another
    /// grouping is asked for.
    pub fn are_of_materials(&self) -> bool {
        self.has_materials && !self.has_objects
    }

    /// Sentences about how names were taken.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    fn name_of(&self, kind: &Kind) -> (Option<String>, String) {
        let object = kind.object.map(|object| name_in(&self.objects, object).to_owned());
        (object, name_in(&self.materials, kind.material).to_owned())
    }

    fn shown(&self, kind: &Kind) -> String {
        let (object, material) = self.name_of(kind);
        shown(object.as_deref(), &material)
    }

    /// Refuses patches of several objects or materials of which tables, or the scene, say different values.
    fn require_clear(&self, values: &[Value]) -> Result<()> {
        for kind in self.kinds.iter().filter(|kind| kind.is_used) {
            if let Some(&(value, level)) = kind.unclear.iter().find(|(value, _)| values.contains(value)) {
                let name = self.listed(kind);
                let (several, step) = match level {
                    Level::Object => (
                        "objects",
                        PropertyStep::Patches {
                            kinds: [PatchKind::Object, PatchKind::Face],
                            table_of: None,
                        },
                    ),
                    _ => (
                        "materials",
                        PropertyStep::Patches {
                            kinds: [PatchKind::Face, PatchKind::Material],
                            table_of: Some(name.clone()),
                        },
                    ),
                };
                let value = value.name();
                let reason = format!("{name} has patches of several {several}, which do not agree on {value}");
                return Err(PropertyError::with(reason, step));
            }
        }
        Ok(())
    }

    /// Reflectance and emission of each kind.
    ///
    /// # Errors
    /// When a kind with patches has no reflectance, a value is out of range, or patches are of several kinds.
    pub fn optics(&self) -> Result<Vec<Optics>> {
        self.require_clear(&[Value::Reflectance, Value::Emission])?;
        let mut missing = Vec::new();
        let mut found = Vec::new();
        for kind in &self.kinds {
            let of_scene = self.scene.as_ref().and_then(|scene| scene.get(kind.material as usize));
            let own = |at: usize| of_scene.and_then(|values| values[at]).map(|value| value.to_vec());
            let given = |what: &str, value: &Option<Spectrum>, most: f64| {
                let value = value.as_ref();
                value
                    .map(|value| self.spectrum(&self.shown(kind), what, value, most))
                    .transpose()
            };
            let reflectance = given("reflectance", &kind.entry.reflectance, 1.0)?.or_else(|| own(0));
            let emission = given("emission", &kind.entry.emission, f64::MAX)?.or_else(|| own(1));
            if reflectance.is_none() && kind.is_used {
                missing.push(self.listed(kind));
            }
            let none = || vec![0.0; self.bands.len()];
            let (object, name) = self.name_of(kind);
            found.push(Optics {
                name,
                object,
                reflectance: reflectance.unwrap_or_else(none),
                emission: emission.unwrap_or_else(none),
            });
        }
        if missing.is_empty() {
            return Ok(found);
        }
        Err(PropertyError::with(
            format!("no reflectance is known of {}", short_list(&missing)),
            PropertyStep::Reflectance,
        ))
    }

    /// Emissivity and condition of each kind. An emissivity that no table has is the scene's, where a material is
    /// called `emissivity 0.95`, as View3D's scenes give it.
    ///
    /// # Errors
    /// When a kind with patches lacks one, a value is out of range, or patches are of several kinds.
    pub fn thermal(&self) -> Result<Vec<Thermal>> {
        self.require_clear(&[Value::Emissivity, Value::Condition])?;
        let (mut missing, mut lacks_emissivity, mut lacks_condition) = (Vec::new(), false, false);
        let mut found = Vec::new();
        let mut surfaces: HashMap<(Level, &str), u32> = HashMap::new();
        let bodies = self.conditions_of_bodies()?;
        for kind in &self.kinds {
            let what = self.shown(kind);
            let (emissivity, is_of_scene) = self.emissivity(kind)?;
            let emissivity = match emissivity {
                Some(Spectrum::Grey(value)) => Some(value),
                Some(Spectrum::Bands(values)) => match values[..] {
                    [value] => Some(value),
                    _ => {
                        return Err(PropertyError::new(format!(
                            "{what} has an emissivity of {} bands, and heat is exchanged by grey surfaces: give one \
                             number",
                            values.len()
                        )));
                    }
                },
                None => None,
            };
            let body = kind.entry.body.as_deref();
            let of_body = body.and_then(|body| bodies.get(body).copied());
            let condition = of_body.or_else(|| kind.entry.condition());
            if let Some(Condition::Temperature(given)) = condition
                && !(0.0..=KELVIN_MAX).contains(&given.kelvin)
            {
                return Err(PropertyError::new(format!(
                    "{what} has a temperature of {} K; it is in kelvin, from 0 on",
                    given.kelvin
                )));
            }
            let without_emissivity = emissivity.is_none() && condition != Some(Condition::Flux(0.0));
            if kind.is_used && (condition.is_none() || without_emissivity) {
                missing.push(self.listed(kind));
                lacks_emissivity |= without_emissivity;
                lacks_condition |= condition.is_none();
            }
            let source = match kind.condition {
                _ if body.is_some() => (Level::Body, body.unwrap_or_default()),
                Level::Object | Level::Default if kind.object.is_some() => {
                    (Level::Object, name_in(&self.objects, kind.object.unwrap_or(0)))
                }
                _ => (Level::Material, name_in(&self.materials, kind.material)),
            };
            let next = u32::try_from(surfaces.len()).unwrap_or(u32::MAX);
            let (object, material) = self.name_of(kind);
            found.push(Thermal {
                material,
                object,
                emissivity,
                is_of_scene,
                condition: condition.unwrap_or(Condition::Flux(0.0)),
                surface: *surfaces.entry(source).or_insert(next),
                body: kind.entry.body.clone(),
                is_used: kind.is_used,
            });
        }
        if missing.is_empty() {
            return Ok(found);
        }
        let what = match (lacks_emissivity, lacks_condition) {
            (true, true) => "no emissivity and temperature are",
            (true, false) => "no emissivity is",
            (false, _) => "no temperature is",
        };
        Err(PropertyError::with(
            format!("{what} known of {}", short_list(&missing)),
            PropertyStep::Thermal,
        ))
    }

    /// The body of each kind, where it is a part of one.
    pub fn bodies(&self) -> Vec<Option<&str>> {
        self.kinds.iter().map(|kind| kind.entry.body.as_deref()).collect()
    }

    /// The condition of each body: that of the tables that give it one. Tables that name the body alone follow them.
    ///
    /// # Errors
    /// When tables give one body several.
    fn conditions_of_bodies(&self) -> Result<HashMap<&str, Condition>> {
        let mut found: HashMap<&str, (&Kind, Condition)> = HashMap::new();
        for kind in self.kinds.iter().filter(|kind| kind.is_used) {
            let entry = &kind.entry;
            let says_more = entry.temperature.is_some() || entry.flux.is_some() || entry.heat.is_some();
            let (Some(body), Some(condition), true) = (entry.body.as_deref(), entry.condition(), says_more) else {
                continue;
            };
            match found.get(body) {
                Some((other, of_other)) if *of_other != condition => {
                    return Err(PropertyError::with(
                        format!(
                            "{} and {} are of the body `{body}`, and have several conditions",
                            self.shown(other),
                            self.shown(kind)
                        ),
                        "give the body one temperature, flux or heat, which is that of all of its surfaces together",
                    ));
                }
                Some(_) => {}
                None => {
                    found.insert(body, (kind, condition));
                }
            }
        }
        Ok(found
            .into_iter()
            .map(|(body, (_, condition))| (body, condition))
            .collect())
    }

    /// Emissivity of each kind, a number a band: `bands` where a table gives one for each, otherwise one.
    ///
    /// # Errors
    /// When a kind with patches has none, a value is out of range, or patches are of several kinds.
    pub fn emissivities(&self) -> Result<Vec<Vec<f64>>> {
        self.require_clear(&[Value::Emissivity])?;
        let is_banded = |kind: &Kind| matches!(kind.entry.emissivity, Some(Spectrum::Bands(_)));
        let bands = if self.kinds.iter().any(is_banded) {
            self.bands.len()
        } else {
            1
        };
        let mut missing = Vec::new();
        let mut found = Vec::new();
        for kind in &self.kinds {
            found.push(match self.emissivity(kind)?.0 {
                Some(Spectrum::Grey(value)) => vec![value; bands],
                Some(Spectrum::Bands(values)) => values,
                None => {
                    if kind.is_used {
                        missing.push(self.listed(kind));
                    }
                    vec![0.0; bands]
                }
            });
        }
        if missing.is_empty() {
            return Ok(found);
        }
        Err(PropertyError::with(
            format!("no emissivity is known of {}", short_list(&missing)),
            PropertyStep::Emissivity,
        ))
    }

    /// Absorptance of the sun's radiation of each kind, and whether it is 1 less the mean reflectance, for want of one
    /// of its own.
    ///
    /// # Errors
    /// When a kind with patches has neither, a value is out of range, or patches are of several kinds.
    pub fn absorptances(&self) -> Result<Vec<(f64, bool)>> {
        self.require_clear(&[Value::Absorptance])?;
        let needs_reflectance = |kind: &Kind| kind.is_used && kind.entry.absorptance.is_none();
        if self.kinds.iter().any(needs_reflectance) {
            self.require_clear(&[Value::Reflectance])?;
        }
        let (mut missing, mut found) = (Vec::new(), Vec::new());
        for kind in &self.kinds {
            if let Some(given) = kind.entry.absorptance {
                if !(0.0..=1.0).contains(&given) {
                    return Err(PropertyError::new(format!(
                        "{} has an absorptance of {given}; it is from 0 to 1",
                        self.shown(kind)
                    )));
                }
                found.push((given, false));
                continue;
            }
            let of_scene = self.scene.as_ref().and_then(|scene| scene.get(kind.material as usize));
            let of_scene = of_scene.and_then(|values| values[0]).map(|value| value.to_vec());
            let given = kind.entry.reflectance.as_ref();
            let given = given.map(|value| self.spectrum(&self.shown(kind), "reflectance", value, 1.0));
            let reflectance = given.transpose()?.or(of_scene);
            found.push(match reflectance {
                Some(bands) => (1.0 - bands.iter().sum::<f64>() / bands.len().max(1) as f64, true),
                None => {
                    if kind.is_used {
                        missing.push(self.listed(kind));
                    }
                    (0.0, false)
                }
            });
        }
        if missing.is_empty() {
            return Ok(found);
        }
        Err(PropertyError::with(
            format!("no absorptance is known of {}", short_list(&missing)),
            PropertyStep::Absorptance,
        ))
    }

    /// Number of objects or materials with emissivities of the scene, and the least and greatest of these.
    pub fn emissivities_of_scene(&self) -> Option<(usize, f64, f64)> {
        let values = self.kinds.iter().filter(|kind| kind.is_used);
        let values = values.filter(|kind| kind.entry.emissivity.is_none());
        let values: Vec<f64> = values.filter_map(|kind| self.emissivity_of_scene(kind)).collect();
        let (least, most) = (values.iter().copied()).fold((1.0_f64, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        (!values.is_empty()).then_some((values.len(), least, most))
    }

    fn emissivity_of_scene(&self, kind: &Kind) -> Option<f64> {
        let name = name_in(&self.materials, kind.material);
        let value: f64 = name.strip_prefix(EMISSIVITY)?.trim().parse().ok()?;
        (0.0..=1.0).contains(&value).then_some(value)
    }

    /// Emissivity of a kind, and whether it is the scene's.
    fn emissivity(&self, kind: &Kind) -> Result<(Option<Spectrum>, bool)> {
        let Some(given) = &kind.entry.emissivity else {
            let of_scene = self.emissivity_of_scene(kind);
            return Ok((of_scene.map(Spectrum::Grey), of_scene.is_some()));
        };
        let values = match given {
            Spectrum::Grey(value) => std::slice::from_ref(value),
            Spectrum::Bands(values) => values,
        };
        if let Some(bad) = values.iter().find(|value| !(0.0..=1.0).contains(*value)) {
            return Err(PropertyError::new(format!(
                "{} has an emissivity of {bad}; it is from 0 to 1",
                self.shown(kind)
            )));
        }
        if let Spectrum::Bands(values) = given {
            self.require_bands(&self.shown(kind), "emissivity", values)?;
        }
        Ok((Some(given.clone()), false))
    }

    fn require_bands(&self, what: &str, quantity: &str, values: &[f64]) -> Result<()> {
        if values.len() == self.bands.len() {
            return Ok(());
        }
        Err(PropertyError::new(format!(
            "{what} has {} numbers for its {quantity}, and there are {} bands ({})",
            values.len(),
            self.bands.len(),
            self.bands.join(", ")
        )))
    }

    fn spectrum(&self, what: &str, quantity: &str, value: &Spectrum, most: f64) -> Result<Vec<f64>> {
        let values = match value {
            Spectrum::Grey(value) => vec![*value; self.bands.len()],
            Spectrum::Bands(values) => {
                self.require_bands(what, quantity, values)?;
                values.clone()
            }
        };
        match values.iter().find(|value| !(0.0..=most).contains(*value)) {
            Some(bad) => Err(PropertyError::new(format!(
                "{what} has a {quantity} of {bad}, which cannot be"
            ))),
            None => Ok(values),
        }
    }

    fn listed(&self, kind: &Kind) -> String {
        let material = name_in(&self.materials, kind.material);
        match kind.object {
            Some(object) => format!("`{}`", name_in(&self.objects, object)),
            None if material.is_empty() => "faces without a material".to_owned(),
            None => format!("`{material}`"),
        }
    }

    /// The tables that hold, to begin a file with: those of materials, then those of objects with values that hold for
    /// all of their patches.
    pub fn tables(&self) -> Vec<PrintedTable> {
        let mut printed = Vec::new();
        for (level, names) in [(Level::Material, &self.materials), (Level::Object, &self.objects)] {
            let mut kinds: BTreeMap<&str, Vec<&Kind>> = BTreeMap::new();
            let mut order: Vec<&str> = Vec::new();
            for kind in self.kinds.iter().filter(|kind| kind.is_used) {
                let index = match level {
                    Level::Object => kind.object,
                    _ => one(kind.material),
                };
                let Some(index) = index else { continue };
                let name = name_in(names, index);
                let of_name = kinds.entry(name).or_default();
                if of_name.is_empty() {
                    order.push(name);
                }
                of_name.push(kind);
            }
            for name in order {
                printed.push(self.printed(level, name, &kinds[name]));
            }
        }
        printed
    }

    /// A table with the values on which kinds agree.
    fn printed(&self, level: Level, name: &str, kinds: &[&Kind]) -> PrintedTable {
        let first = &kinds[0].entry;
        let agree = |same: &dyn Fn(&Entry) -> bool| kinds.iter().all(|kind| same(&kind.entry));
        let of_scene = |at: usize| {
            let value = |kind: &&Kind| self.scene.as_ref()?.get(kind.material as usize)?[at];
            let first = value(&kinds[0])?;
            let alike = kinds.iter().all(|kind| value(kind) == Some(first));
            alike.then(|| Spectrum::Bands(first.to_vec()))
        };
        let given = |same: bool, value: &Option<Spectrum>| value.clone().filter(|_| same);
        let reflectance = given(agree(&|e| e.reflectance == first.reflectance), &first.reflectance);
        let emission = given(agree(&|e| e.emission == first.emission), &first.emission);
        let emissivity = given(agree(&|e| e.emissivity == first.emissivity), &first.emissivity);
        let scene_emissivity = || {
            let value = self.emissivity_of_scene(kinds[0])?;
            let alike = |kind: &&Kind| kind.entry.emissivity.is_none() && self.emissivity_of_scene(kind) == Some(value);
            kinds.iter().all(alike).then_some(Spectrum::Grey(value))
        };
        let mut entry = Entry {
            reflectance: reflectance.or_else(|| of_scene(0)),
            emission: emission.or_else(|| of_scene(1)),
            emissivity: emissivity.or_else(scene_emissivity),
            absorptance: first
                .absorptance
                .filter(|_| agree(&|e| e.absorptance == first.absorptance)),
            ..Entry::default()
        };
        if agree(&|e| e.condition() == first.condition()) {
            entry.take_condition(first);
        }
        PrintedTable {
            is_object: level == Level::Object,
            name: name.to_owned(),
            entry,
        }
    }
}

/// A table of [`Properties::tables`].
#[derive(Clone, Debug, PartialEq)]
pub struct PrintedTable {
    /// True for an object, false for a material.
    pub is_object: bool,
    /// Its name.
    pub name: String,
    /// Values that hold for all of its patches.
    pub entry: Entry,
}

impl Entry {
    /// True if a condition is of a surface as a whole.
    fn is_of_surfaces(&self) -> bool {
        self.heat.is_some() || self.isothermal == Some(true) || self.body.is_some()
    }

    fn has_condition(&self) -> bool {
        self.temperature.is_some() || self.adiabatic == Some(true) || self.flux.is_some() || self.is_of_surfaces()
    }

    /// The thermal condition; `None` without one.
    pub fn condition(&self) -> Option<Condition> {
        let isothermal = self.isothermal == Some(true) || self.body.is_some();
        if self.adiabatic == Some(true) {
            return Some(Condition::Flux(0.0));
        }
        match (self.temperature, self.flux, self.heat) {
            (Some(given), ..) => Some(Condition::Temperature(given)),
            (_, Some(flux), _) if isothermal => Some(Condition::IsothermalFlux(flux)),
            (_, Some(flux), _) => Some(Condition::Flux(flux)),
            (.., Some(heat)) if isothermal => Some(Condition::IsothermalHeat(heat)),
            (.., Some(heat)) => Some(Condition::Heat(heat)),
            _ if isothermal => Some(Condition::IsothermalHeat(0.0)),
            _ => None,
        }
    }

    fn take_condition(&mut self, other: &Self) {
        (self.temperature, self.adiabatic) = (other.temperature, other.adiabatic);
        (self.flux, self.heat, self.isothermal) = (other.flux, other.heat, other.isothermal);
        self.body.clone_from(&other.body);
    }

    /// Conditions that exclude each other.
    fn contradiction(&self) -> Option<&'static str> {
        let isothermal = self.isothermal == Some(true);
        match (self.temperature, self.adiabatic, self.flux, self.heat) {
            (Some(_), _, Some(_), _) => Some("`temperature` and `flux`"),
            (Some(_), _, _, Some(_)) => Some("`temperature` and `heat`"),
            (_, _, Some(_), Some(_)) => Some("`flux` and `heat`"),
            (_, Some(true), Some(_), _) => Some("`adiabatic` and `flux`"),
            (_, Some(true), _, Some(_)) => Some("`adiabatic` and `heat`"),
            (_, Some(true), ..) if isothermal => Some("`adiabatic` (no flux on any patch) and `isothermal`"),
            (_, Some(true), ..) if self.body.is_some() => {
                Some("`adiabatic` (no flux on any patch) and `body` (one temperature)")
            }
            _ => None,
        }
    }
}

/// Refuses tables that say two things of one surface, or a flux that is no number.
fn check_conditions(tables: &Tables) -> Result<()> {
    let named = |kind: &'static str| move |(name, entry)| (format!("[{kind}.\"{name}\"]"), entry);
    let all = std::iter::once(("[default]".to_owned(), &tables.default))
        .chain(tables.material.iter().map(named("material")))
        .chain(tables.object.iter().map(named("object")));
    for (table, entry) in all {
        if let Some(both) = entry.contradiction() {
            return Err(PropertyError::with(
                format!("`{table}` has {both}"),
                "leave one of them out: a surface has one thermal condition",
            ));
        }
        for (key, unit, value) in [("flux", "W/m²", entry.flux), ("heat", "W", entry.heat)] {
            if let Some(bad) = value.filter(|value| !value.is_finite()) {
                return Err(PropertyError::new(format!(
                    "`{table}`: `{key}` is {bad}; a finite number of {unit} is needed, above 0 where the surface gives \
                     heat off"
                )));
            }
        }
    }
    Ok(())
}

/// Makes the tables of materials that only objects are called those objects', and says so.
fn objects_called_materials(named: Named<'_>, tables: &mut Tables) -> Vec<String> {
    let is_there = |names: &[String], key: &str| names.iter().any(|name| name == key || matches_glob(key, name));
    let moved: Vec<String> = tables
        .material
        .keys()
        .filter(|key| !is_there(named.materials, key) && is_there(named.objects, key))
        .filter(|key| !tables.object.contains_key(*key))
        .cloned()
        .collect();
    let mut notes = Vec::new();
    for key in moved {
        if let Some(entry) = tables.material.remove(&key) {
            notes.push(format!(
                "no material is called `{key}`, and objects are: `[material.\"{key}\"]` is taken as \
                 `[object.\"{key}\"]`"
            ));
            tables.object.insert(key, entry);
        }
    }
    notes
}

/// The table of each name.
struct Matched<'t> {
    kind: &'static str,
    of_name: Vec<Option<&'t Entry>>,
    unused: Option<&'t String>,
}

impl<'t> Matched<'t> {
    fn new(names: &[String], tables: &'t BTreeMap<String, Entry>, kind: &'static str) -> Result<Self> {
        let patterns = Patterns::new(tables);
        let mut of_name = Vec::with_capacity(names.len());
        // Objects may share names by the thousand.
        let mut known: HashMap<&str, Option<&Entry>> = HashMap::new();
        for name in names {
            if let Some(found) = known.get(name.as_str()) {
                of_name.push(*found);
                continue;
            }
            let found = patterns
                .of(name)
                .map_err(|tie| PropertyError::new(format!("{kind} {tie}")))?;
            let entry = found.map(|(_, entry)| entry);
            known.insert(name, entry);
            of_name.push(entry);
        }
        let unused = patterns.unused(names);
        Ok(Self { kind, of_name, unused })
    }

    fn require_all_used(&self, tables: &Tables, named: Named<'_>) -> Result<()> {
        let Some(unused) = self.unused else {
            return Ok(());
        };
        let mut there = Vec::new();
        // A file without objects is answered in its own terms first.
        if self.kind == "material" || tables.object.is_empty() {
            there.push(there_are("", named.materials));
        }
        let mut seen = std::collections::HashSet::new();
        let objects: Vec<String> = (named.objects.iter())
            .filter(|name| !name.is_empty() && seen.insert(name.as_str()))
            .cloned()
            .collect();
        if !objects.is_empty() {
            there.push(there_are("the objects ", &objects));
        } else if there.is_empty() {
            there.push("objects without names".to_owned());
        }
        Err(PropertyError::with(
            format!("`{unused}` matches no {}", self.kind),
            format!("the matrix has {}", there.join(", and ")),
        ))
    }
}

/// The tables of all names of a level, for a patch of several of them: the values on which all agree, and those on
/// which they do not. What is of a surface as a whole, such as heat, is of one name.
fn agreed(of_name: &[Option<&Entry>]) -> (Entry, Vec<Value>) {
    let first = of_name.first().copied().flatten().cloned().unwrap_or_default();
    let mut entry = Entry::default();
    let mut unclear = Vec::new();
    for value in Value::ALL {
        let given = of_name
            .iter()
            .filter(|entry| entry.is_some_and(|entry| value.is_in(entry)));
        if given.count() == 0 {
            continue;
        }
        let is_agreed = |entry: &Option<&Entry>| entry.is_some_and(|entry| value.is_same(entry, &first));
        let is_of_surfaces = value == Value::Condition && first.is_of_surfaces();
        if is_of_surfaces || !of_name.iter().all(is_agreed) {
            unclear.push(value);
            continue;
        }
        match value {
            Value::Reflectance => entry.reflectance = first.reflectance.clone(),
            Value::Emission => entry.emission = first.emission.clone(),
            Value::Emissivity => entry.emissivity = first.emissivity.clone(),
            Value::Absorptance => entry.absorptance = first.absorptance,
            Value::Condition => entry.take_condition(&first),
        }
    }
    (entry, unclear)
}

/// The kinds of patches, and that of each patch. O(patches + names).
fn kinds(
    named: Named<'_>,
    tables: &Tables,
    of_object: &Matched<'_>,
    of_material: &Matched<'_>,
    scene: Option<&[[Option<[f64; 3]>; 2]]>,
    has_objects: bool,
) -> (Vec<Kind>, Vec<u32>) {
    let of_objects = agreed(&of_object.of_name);
    let of_materials = agreed(&of_material.of_name);
    let is_in_scene = |at: usize| scene.is_some_and(|scene| scene.iter().any(|values| values[at].is_some()));
    let make = |object: Option<u32>, material: u32| {
        let single =
            |matched: &Matched<'_>, index: u32| matched.of_name.get(index as usize).copied().flatten().cloned();
        let (object_entry, unclear_objects) = match object.map(one) {
            None => (None, &[][..]),
            Some(Some(object)) => (single(of_object, object), &[][..]),
            Some(None) => (Some(of_objects.0.clone()), &of_objects.1[..]),
        };
        let (material_entry, unclear_materials) = match one(material) {
            Some(material) => (single(of_material, material), &[][..]),
            None => (Some(of_materials.0.clone()), &of_materials.1[..]),
        };
        let is_before = |value: Value| object_entry.as_ref().is_some_and(|entry| value.is_in(entry));
        let mut unclear: Vec<(Value, Level)> = unclear_objects.iter().map(|&value| (value, Level::Object)).collect();
        let materials = unclear_materials.iter().filter(|value| !is_before(**value));
        unclear.extend(materials.map(|&value| (value, Level::Material)));
        let levels = [
            (Level::Object, object_entry.as_ref()),
            (Level::Material, material_entry.as_ref()),
            (Level::Default, Some(&tables.default)),
        ];
        let entries = || levels.iter().filter_map(|&(_, entry)| entry);
        let mut entry = Entry {
            reflectance: entries().find_map(|entry| entry.reflectance.clone()),
            emission: entries().find_map(|entry| entry.emission.clone()),
            emissivity: entries().find_map(|entry| entry.emissivity.clone()),
            absorptance: entries().find_map(|entry| entry.absorptance),
            ..Entry::default()
        };
        for (at, value) in [(0, Value::Reflectance), (1, Value::Emission)] {
            if one(material).is_none() && !value.is_in(&entry) && is_in_scene(at) {
                unclear.push((value, Level::Material));
            }
        }
        let mut condition = Level::Default;
        for (level, given) in levels {
            if let Some(given) = given.filter(|given| given.has_condition()) {
                entry.take_condition(given);
                condition = level;
                break;
            }
        }
        Kind {
            object: object.and_then(one),
            material,
            entry,
            condition,
            unclear,
            is_used: false,
        }
    };
    #[allow(clippy::cast_possible_truncation, reason = "patches are counted by u32")]
    if !has_objects {
        let mut kinds: Vec<Kind> = (0..named.materials.len() as u32)
            .map(|material| make(None, material))
            .collect();
        for &material in named.material {
            if let Some(kind) = kinds.get_mut(material as usize) {
                kind.is_used = true;
            }
        }
        return (kinds, named.material.to_vec());
    }
    let mut kinds: Vec<Kind> = Vec::new();
    let mut known: HashMap<(u32, u32), u32> = HashMap::new();
    let pairs = named.object.iter().zip(named.material);
    let kind_of_patch = pairs
        .map(|(&object, &material)| {
            *known.entry((object, material)).or_insert_with(|| {
                kinds.push(Kind {
                    is_used: true,
                    ..make(Some(object), material)
                });
                u32::try_from(kinds.len() - 1).unwrap_or(u32::MAX)
            })
        })
        .collect();
    (kinds, kind_of_patch)
}

/// An object or material, where a patch has one.
fn one(index: u32) -> Option<u32> {
    (index != PatchTable::SEVERAL).then_some(index)
}

fn name_in(names: &[String], index: u32) -> &str {
    names.get(index as usize).map_or("", String::as_str)
}

fn short_list(shown: &[String]) -> String {
    let mut distinct: Vec<&String> = Vec::new();
    for name in shown {
        if distinct.last() != Some(&name) {
            distinct.push(name);
        }
    }
    let first: Vec<&str> = distinct.iter().take(NAMES_SHOWN).map(|name| name.as_str()).collect();
    match distinct.len().saturating_sub(NAMES_SHOWN) {
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}

fn there_are(what: &str, names: &[String]) -> String {
    let shown: Vec<String> = names
        .iter()
        .map(|name| {
            if name.is_empty() {
                "faces without a material".to_owned()
            } else {
                format!("`{name}`")
            }
        })
        .collect();
    format!("{what}{}", short_list(&shown))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJECTS: [&str; 5] = ["floor", "Zone 3 / wall 1", "Zone 3 / wall 7", "duct", "duct"];
    const MATERIALS: [&str; 4] = ["white", "facade_a", "facade_b", ""];

    /// Five objects, all but the last of a material of their own.
    fn read(json: &str) -> Result<Properties> {
        let (objects, materials) = (OBJECTS.map(str::to_owned), MATERIALS.map(str::to_owned));
        let named = Named {
            objects: &objects,
            materials: &materials,
            object: &[0, 1, 2, 3, 4],
            material: &[0, 1, 2, 3, 3],
        };
        Properties::new(named, None, serde_json::from_str(json).expect("good JSON"))
    }

    fn condition(json: &str, patch: usize) -> Condition {
        let properties = read(json).expect(json);
        let kind = properties.kind_of_patch()[patch] as usize;
        properties.thermal().expect(json)[kind].condition
    }

    fn kelvin(json: &str, patch: usize) -> f64 {
        match condition(json, patch) {
            Condition::Temperature(given) => given.kelvin(),
            other => panic!("{json}: {other:?}"),
        }
    }

    #[test]
    fn the_most_particular_table_holds() {
        let with = |object: &str, material: &str| {
            format!(
                "{{\"default\": {{\"emissivity\": 0.9, \"temperature\": 1}}, \"material\": {{{material}}}, \
                 \"object\": {{{object}}}}}"
            )
        };
        // Default, material's pattern, material's name, object's pattern, longer pattern, object's name.
        let steps = [
            ("", ""),
            ("", "\"facade*\": {\"temperature\": 2}"),
            (
                "",
                "\"facade_a\": {\"temperature\": 3}, \"facade*\": {\"temperature\": 2}",
            ),
            ("\"Zone*\": {\"temperature\": 4}", "\"facade_a\": {\"temperature\": 3}"),
            (
                "\"Zone*\": {\"temperature\": 4}, \"Zone 3*\": {\"temperature\": 5}",
                "\"facade_a\": {\"temperature\": 3}",
            ),
            (
                "\"Zone 3*\": {\"temperature\": 5}, \"Zone 3 / wall 1\": {\"temperature\": 6}",
                "\"facade_a\": {\"temperature\": 3}",
            ),
        ];
        for (wanted, (object, material)) in (1..).zip(steps) {
            assert_eq!(
                kelvin(&with(object, material), 1),
                f64::from(wanted),
                "{object} {material}"
            );
        }
        // An object's table leaves what it does not say to the material's.
        let both = with("\"Zone*\": {\"temperature\": 4}", "\"facade_a\": {\"emissivity\": 0.2}");
        let properties = read(&both).expect("good tables");
        let thermal = properties.thermal().expect("all known");
        let of = |patch: usize| &thermal[properties.kind_of_patch()[patch] as usize];
        assert_eq!((of(1).emissivity, of(2).emissivity), (Some(0.2), Some(0.9)));
        // A condition goes as a whole: a flux is not beside a temperature from elsewhere.
        let flux = with("\"Zone*\": {\"flux\": 40}", "\"facade_a\": {\"temperature\": 3}");
        assert_eq!(condition(&flux, 1), Condition::Flux(40.0));
        let error = |json: &str| read(json).expect_err(json);
        let tied = error(&with("\"Zone 3*\": {}, \"*wall 1\": {}", ""));
        assert!(tied.reason.contains("fits both"), "{tied}");
    }

    #[test]
    fn each_name_of_a_pattern_is_a_surface() {
        let json = "{\"default\": {\"emissivity\": 0.9, \"temperature\": 300}, \
                    \"object\": {\"Zone*\": {\"heat\": 100, \"isothermal\": true}, \"duct\": {\"heat\": 5}}}";
        let properties = read(json).expect("good tables");
        let thermal = properties.thermal().expect("all known");
        let of = |patch: usize| &thermal[properties.kind_of_patch()[patch] as usize];
        assert_eq!(of(1).condition, Condition::IsothermalHeat(100.0));
        assert_ne!(of(1).surface, of(2).surface);
        // Two objects of one name are one surface.
        assert_eq!(of(3).surface, of(4).surface);
        assert_eq!(of(3).condition, Condition::Heat(5.0));
    }

    #[test]
    fn surfaces_of_a_body_are_one() {
        let json = "{\"default\": {\"emissivity\": 0.9, \"temperature\": 300}, \
                    \"object\": {\"Zone*\": {\"body\": \"stove\"}, \"duct\": {\"body\": \"stove\", \"heat\": 5}}}";
        let properties = read(json).expect("good tables");
        let thermal = properties.thermal().expect("all known");
        let of = |patch: usize| &thermal[properties.kind_of_patch()[patch] as usize];
        for patch in 1..5 {
            // Tables that name the body alone follow the one that gives it heat.
            assert_eq!(of(patch).condition, Condition::IsothermalHeat(5.0));
            assert_eq!(of(patch).surface, of(1).surface);
        }
        assert_ne!(of(0).surface, of(1).surface);
        assert_eq!(
            properties.bodies()[properties.kind_of_patch()[2] as usize],
            Some("stove")
        );
        let several = json.replace("\"body\": \"stove\"}", "\"body\": \"stove\", \"heat\": 7}");
        let error = read(&several).expect("good tables").thermal().expect_err("two heats");
        assert!(error.reason.contains("are of the body `stove`"), "{error}");
        let still = json.replace("\"heat\": 5", "\"adiabatic\": true");
        assert!(read(&still).expect_err("no one temperature").reason.contains("`body`"));
    }

    #[test]
    fn what_matches_nothing_is_answered_by_what_there_is() {
        let error = read("{\"object\": {\"flor\": {}}}").expect_err("no such object");
        assert!(error.reason.contains("`flor` matches no object"), "{error}");
        assert!(
            error
                .step
                .is_some_and(|step| format!("{step:?}").contains("`floor`, `Zone 3 / wall 1`"))
        );
        let error = read("{\"material\": {\"wite\": {}}}").expect_err("no such material");
        let step = error.step.expect("a step");
        assert!(error.reason.contains("`wite` matches no material"));
        let step = format!("{step:?}");
        assert!(step.contains("the matrix has `white`, `facade_a`") && step.contains("the objects `floor`"));
        // An object named among the materials is found, and said.
        let properties = read("{\"material\": {\"floor\": {\"temperature\": 3}}}").expect("an object");
        assert!(properties.has_objects() && properties.notes()[0].contains("`[object.\"floor\"]`"));
        // A pattern that more particular tables leave nothing is not wrong.
        assert!(read("{\"object\": {\"flo*\": {}, \"floor\": {}}}").is_ok());
    }

    #[test]
    fn contradictions_and_wrong_values_are_refused() {
        for (table, wanted) in [
            ("\"temperature\": 3, \"flux\": 1", "`temperature` and `flux`"),
            ("\"flux\": 3, \"heat\": 1", "`flux` and `heat`"),
            ("\"adiabatic\": true, \"isothermal\": true", "`isothermal`"),
        ] {
            let error = read(&format!("{{\"object\": {{\"floor\": {{{table}}}}}}}")).expect_err(table);
            assert!(error.reason.contains(wanted), "{error}");
        }
        let thermal = |json: &str| read(json).expect(json).thermal().expect_err(json).reason;
        assert!(thermal("{\"default\": {\"emissivity\": 0.9}}").contains("no temperature is known of"));
        assert!(thermal("{\"default\": {\"temperature\": 300}}").contains("no emissivity is known of"));
        assert!(thermal("{}").contains("no emissivity and temperature are known of"));
        assert!(thermal("{\"default\": {\"emissivity\": 0.9, \"temperature\": -3}}").contains("-3 K"));
        assert!(thermal("{\"default\": {\"emissivity\": 1.9, \"temperature\": 3}}").contains("1.9"));
        assert!(thermal("{\"default\": {\"emissivity\": [0.1, 0.2, 0.3], \"temperature\": 3}}").contains("grey"));
        for wrong in [
            "{\"temperature\": \"20 F\"}",
            "{\"temperature\": \"warm\"}",
            "{\"flus\": 3}",
        ] {
            assert!(serde_json::from_str::<Entry>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_value_of_another_kind_is_told_what_is_needed() {
        let told = |json: &str| serde_json::from_str::<Entry>(json).expect_err(json).to_string();
        for wrong in ["[300]", "true", "{}"] {
            let temperature = told(&format!("{{\"temperature\": {wrong}}}"));
            let needed = "a number of kelvin, or a text such as \"20 °C\", is needed";
            assert!(temperature.starts_with(needed), "{temperature}");
        }
        for wrong in ["\"x\"", "[true]"] {
            let spectrum = told(&format!("{{\"reflectance\": {wrong}}}"));
            assert!(
                spectrum.starts_with("one number, or a list with one for each band, is needed"),
                "{spectrum}"
            );
        }
        let named = Named {
            objects: &[],
            materials: &[],
            object: &[],
            material: &[],
        };
        for (key, unit) in [("flux", "W/m²"), ("heat", "W")] {
            let mut tables = Tables::default();
            let value = Some(f64::NAN);
            match key {
                "flux" => tables.default.flux = value,
                _ => tables.default.heat = value,
            }
            let reason = Properties::new(named, None, tables).expect_err(key).reason;
            let expected = format!("`[default]`: `{key}` is NaN; a finite number of {unit} is needed");
            assert!(reason.starts_with(&expected), "{reason}");
        }
    }

    #[test]
    fn a_scene_by_view3d_knows_its_emissivities() {
        let (objects, materials) = (["Floor".to_owned()], ["emissivity 0.95".to_owned()]);
        let named = Named {
            objects: &objects,
            materials: &materials,
            object: &[0],
            material: &[0],
        };
        let with = |json: &str| Properties::new(named, None, serde_json::from_str(json).expect("JSON")).expect("fits");
        let scene = with("{\"default\": {\"temperature\": 300}}");
        assert_eq!(scene.thermal().expect("known")[0].emissivity, Some(0.95));
        assert_eq!(scene.emissivities_of_scene(), Some((1, 0.95, 0.95)));
        let own = with("{\"default\": {\"temperature\": 300, \"emissivity\": 0.5}}");
        assert_eq!(own.thermal().expect("known")[0].emissivity, Some(0.5));
        assert_eq!(own.emissivities_of_scene(), None);
    }
}
