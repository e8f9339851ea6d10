//! Defects of a scene that would spoil its form factors, found from geometry alone: each finding with a count, the
//! worst few places, and the next thing to try. A scene without defects has no findings.
//!
//! Small scenes are examined whole. In large ones a seeded sample of surfaces is examined, and counts are extrapolated
//! and marked so. The sample's size depends on counted work, never on a clock: a scene has the same findings on every
//! machine and with any number of threads.

mod contact;
mod enclosure;
mod place;
mod precision;
mod rays;
mod sample;
mod sight;
mod statistics;
mod units;

pub use enclosure::{Enclosure, Leak, Part, Turn, Winding, enclosure};
pub use place::{Place, places};
pub use precision::{Grain, Precision};
pub use statistics::SceneStatistics;

use crate::Model;
use glam::DVec3;
use hemicube_scene::{Axis, Fate, InputPatch, Kind, Ledger, Scene};
use hemicube_spatial::whole;
use serde::Serialize;

/// Options of an examination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiagnoseOptions {
    /// Seed of the sample.
    pub seed: u64,
    /// Worker threads; 0: one a core. They change nothing of the result.
    pub threads: usize,
    /// Most surfaces examined by each detector; the bound on the work is lower in large scenes.
    pub surfaces_max: usize,
    /// The axis that points up, where it is known.
    pub up: Option<Axis>,
}

impl Default for DiagnoseOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            threads: 0,
            surfaces_max: usize::MAX,
            up: None,
        }
    }
}

/// Kind of defect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FindingKind {
    /// No point of the patch sees anything but backs of one-sided surfaces.
    Buried,
    /// The centroid sees only backs, other points of the patch see more.
    CentroidBuried,
    /// Backs of one-sided surfaces fill more than half of the view from the centroid.
    MostlyBlocked,
    /// Two triangles pass through each other.
    Crossing,
    /// Two triangles cover each other in one plane, or so nearly that one always hides the other.
    Overlap,
    /// Two patches face each other across a gap that is nothing beside their size.
    NearContact,
    /// Seen from the centroid a neighbour is much larger or smaller than from the whole patch.
    LargePatch,
    /// A triangle more than a thousand times longer than high.
    Sliver,
    /// A triangle so small that the rounding of the file's coordinates turns its plane.
    CoarseGrain,
    /// Corners one unit of the file's rounding apart, probably meant to be one.
    Crack,
}

impl FindingKind {
    /// A short name, for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Buried => "buried",
            Self::CentroidBuried => "centroid buried",
            Self::MostlyBlocked => "mostly blocked",
            Self::Crossing => "crossing",
            Self::Overlap => "overlapping",
            Self::NearContact => "nearly touching",
            Self::LargePatch => "too large",
            Self::Sliver => "slivers",
            Self::CoarseGrain => "coarse grain",
            Self::Crack => "cracks",
        }
    }

    /// The thing counted, in the singular.
    pub fn counted(self) -> &'static str {
        match self {
            Self::Buried | Self::CentroidBuried | Self::MostlyBlocked | Self::LargePatch => "patch",
            Self::Sliver | Self::CoarseGrain => "triangle",
            Self::Crossing | Self::Overlap | Self::NearContact => "pair of triangles",
            Self::Crack => "pair of corners",
        }
    }

    /// The consequence, as a clause after the count.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Buried => "with nothing but backs of one-sided surfaces in view: buried, or wound the wrong way",
            Self::CentroidBuried => "with a centroid that sees only backs, and other points that see more",
            Self::MostlyBlocked => "with backs in more than half of what their centroid sees",
            Self::Crossing => "passing through each other: parts of them are hidden that no centroid knows of",
            Self::Overlap => "facing the same way in one place: one of them hides the other",
            Self::NearContact => "face to face across less than a ten-thousandth of their size",
            Self::LargePatch => {
                "so large that one neighbour is seen quite differently from the centroid than on average"
            }
            Self::Sliver => "over 1,000 times as long as high: a centroid stands for little of them",
            Self::CoarseGrain => "turned by over 3 degrees by the rounding of the file's coordinates",
            Self::Crack => "one step of the file's rounding apart: light leaks where they should be one",
        }
    }

    /// The quantity of [`Example::value`].
    pub fn measure(self) -> Measure {
        let (name, unit) = match self {
            Self::Buried => ("area", Unit::Area),
            Self::CentroidBuried => ("of its points see out", Unit::Fraction),
            Self::MostlyBlocked => ("of the view is backs", Unit::Fraction),
            Self::Crossing => ("crossing line", Unit::Length),
            Self::Overlap => ("common area", Unit::Area),
            Self::NearContact => ("gap", Unit::Length),
            Self::LargePatch => ("difference of F", Unit::Number),
            Self::Sliver => ("longest edge / height", Unit::Number),
            Self::CoarseGrain => ("turned", Unit::Degrees),
            Self::Crack => ("gap", Unit::Length),
        };
        Measure { name, unit }
    }

    /// The things counted by [`Finding::examined`] and [`Finding::population`], in the plural.
    pub fn population(self) -> &'static str {
        match self {
            Self::Buried | Self::CentroidBuried | Self::MostlyBlocked | Self::LargePatch => "patches",
            _ => "triangles",
        }
    }

    /// The quantity summed in [`Finding::total`], where a sum means something.
    pub fn total(self) -> Option<Measure> {
        let (name, unit) = match self {
            Self::Buried | Self::CentroidBuried | Self::MostlyBlocked => {
                ("of the area of the patches looked at", Unit::Fraction)
            }
            Self::Crossing => ("of crossing lines", Unit::Length),
            Self::Overlap | Self::NearContact => ("of common area", Unit::Area),
            _ => return None,
        };
        Some(Measure { name, unit })
    }
}

/// The unit of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Unit {
    /// The file's unit of length.
    Length,
    /// The file's unit of length, squared.
    Area,
    /// 0 to 1.
    Fraction,
    /// Degrees of arc.
    Degrees,
    /// None.
    Number,
}

/// A measured quantity and its unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Measure {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
}

/// One place of a defect.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Example {
    /// The patch; of a pair the smaller triangle's.
    #[serde(serialize_with = "number")]
    pub patch: InputPatch,
    /// The other patch of a pair.
    #[serde(serialize_with = "number_if_any", skip_serializing_if = "Option::is_none")]
    pub other: Option<InputPatch>,
    /// The place, in the file's unit.
    #[serde(serialize_with = "coordinates")]
    pub at: DVec3,
    /// The quantity measured there, see [`FindingKind::measure`].
    pub value: f64,
}

fn number<S: serde::Serializer>(patch: &InputPatch, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_u32(patch.0)
}

fn number_if_any<S: serde::Serializer>(patch: &Option<InputPatch>, serializer: S) -> Result<S::Ok, S::Error> {
    patch.map(|patch| patch.0).serialize(serializer)
}

fn coordinates<S: serde::Serializer>(at: &DVec3, serializer: S) -> Result<S::Ok, S::Error> {
    at.to_array().serialize(serializer)
}

/// A kind of defect found in a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Its kind.
    pub kind: FindingKind,
    /// Number of cases among the surfaces examined.
    pub count: u64,
    /// Number of patches, or triangles, examined.
    pub examined: u64,
    /// Number of them in the scene.
    pub population: u64,
    /// Number of cases in the scene: `count` when all were examined, otherwise extrapolated.
    pub estimate: f64,
    /// Sum of the quantity of [`FindingKind::total`] over the cases; extrapolated like `estimate` unless it is a share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total: Option<f64>,
    /// The worst, worst first.
    pub examples: Vec<Example>,
    /// The next thing to try.
    pub next: String,
    /// Settings of a run that help.
    #[serde(skip)]
    pub helps: Vec<Remedy>,
}

/// A setting of a run that helps against a finding; front ends have their own words for it.
#[derive(Clone, Debug, PartialEq)]
pub enum Remedy {
    /// All edges in two pieces or more.
    Split,
    /// Patches no longer than this, in the scene's unit.
    PatchSize(String),
    /// Both sides of triangles as patches.
    TwoSided,
    /// Triangles of objects turned round.
    Flip,
    /// Rows for some objects only.
    Emitters,
    /// A smaller tolerance.
    Tolerance,
}

impl Finding {
    /// Returns whether only a sample was looked at.
    pub fn is_estimate(&self) -> bool {
        self.examined < self.population
    }
}

/// Findings about a scene, and the precision of its coordinates.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnosis {
    /// Seed of the sample.
    pub seed: u64,
    /// The defects, in the order of [`FindingKind`]; empty without defects.
    pub findings: Vec<Finding>,
    /// Digits and rounding of the coordinates.
    pub precision: Precision,
}

impl Diagnosis {
    /// The finding of a kind, if there is one.
    pub fn of(&self, kind: FindingKind) -> Option<&Finding> {
        self.findings.iter().find(|finding| finding.kind == kind)
    }
}

/// Nodes of the tree that the rays of [`enclosure`] may meet: about half a second of work.
const WORK_OF_ENCLOSURE: u64 = 25_000_000;

/// Number of the worst places kept.
const EXAMPLES_MAX: usize = 5;

/// Counts places and keeps the worst.
#[derive(Clone, Debug, Default)]
struct Tally {
    count: u64,
    total: f64,
    /// Severity and place, the worst first.
    worst: Vec<(f64, Example)>,
}

impl Tally {
    fn add(&mut self, badness: f64, share_of_total: f64, example: Example) {
        self.count += 1;
        self.total += share_of_total;
        self.keep(badness, example);
    }

    fn keep(&mut self, badness: f64, example: Example) {
        // Many triangles meet in one corner: one of them is enough.
        if let Some(same) = self.worst.iter().position(|(_, kept)| kept.at == example.at) {
            if self.worst[same].0 >= badness {
                return;
            }
            self.worst.remove(same);
        }
        let before = |kept: &(f64, Example)| {
            let id = |e: &Example| (e.patch, e.other);
            badness.total_cmp(&kept.0).then(id(&kept.1).cmp(&id(&example))).is_lt()
        };
        let place = self.worst.partition_point(before);
        if place < EXAMPLES_MAX {
            self.worst.insert(place, (badness, example));
            self.worst.truncate(EXAMPLES_MAX);
        }
    }

    fn merge(&mut self, other: Self) {
        self.count += other.count;
        self.total += other.total;
        for (badness, example) in other.worst {
            self.keep(badness, example);
        }
    }

    /// `of` is the number examined and the population; `whole` the reference of the total, if it is a share.
    fn finding(self, kind: FindingKind, of: Examined, whole: Option<f64>, next: impl Into<Advice>) -> Option<Finding> {
        let Advice { next, helps } = next.into();
        if self.count == 0 {
            return None;
        }
        let total = kind.total().map(|_| match whole {
            Some(whole) => self.total / whole,
            None => self.total * of.factor(),
        });
        Some(Finding {
            kind,
            count: self.count,
            examined: of.examined,
            population: of.population,
            estimate: self.count as f64 * of.factor(),
            total,
            examples: self.worst.into_iter().map(|(_, example)| example).collect(),
            next,
            helps,
        })
    }
}

/// The next thing to try, and the settings that do it.
struct Advice {
    next: String,
    helps: Vec<Remedy>,
}

impl From<String> for Advice {
    fn from(next: String) -> Self {
        Self {
            next,
            helps: Vec::new(),
        }
    }
}

impl Advice {
    fn new(next: impl Into<String>, helps: impl Into<Vec<Remedy>>) -> Self {
        Self {
            next: next.into(),
            helps: helps.into(),
        }
    }
}

/// Numbers looked at, and of how many.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Examined {
    examined: u64,
    population: u64,
}

impl Examined {
    fn factor(self) -> f64 {
        if self.examined == self.population {
            1.0
        } else {
            self.population as f64 / self.examined.max(1) as f64
        }
    }
}

/// Examines a scene.
///
/// ```
/// use hemicube::diagnose::{DiagnoseOptions, FindingKind, diagnose};
/// use hemicube::{HierarchyOptions, Model};
/// use hemicube_scene::{Patches, Scene, Subdivision, Triangle};
/// use hemicube_spatial::glam::DVec3;
///
/// // Two triangles that pass through each other.
/// let p = DVec3::new;
/// let level = [p(0.0, 0.0, 0.0), p(4.0, 0.0, 0.0), p(0.0, 4.0, 0.0)];
/// let upright = [p(1.0, 1.0, -1.0), p(1.0, 1.0, 2.0), p(3.0, 1.0, 2.0)];
/// let triangle = |(face, corners)| Triangle { corners, object: 0, material: 0, face, two_sided: true };
/// let scene = Scene { triangles: (0..).zip([level, upright]).map(triangle).collect(), ..Scene::default() };
/// let model = Model::new(Patches::new(&scene, Subdivision::None)?.into(), HierarchyOptions::default())?;
///
/// let diagnosis = diagnose(&model, DiagnoseOptions::default());
/// let finding = diagnosis.of(FindingKind::Crossing).ok_or("nothing crosses")?;
/// assert!(finding.count > 0 && !finding.is_estimate());
/// assert!(!finding.next.is_empty(), "each finding says what to try next");
/// assert_eq!(diagnosis.of(FindingKind::Sliver), None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn diagnose(model: &Model, options: DiagnoseOptions) -> Diagnosis {
    let order = sample::order(model, options.seed);
    let precision = precision::measure(model, &order);
    let mut findings = sight::findings(model, &order, options);
    findings.extend(contact::findings(model, &order, precision.grain, options));
    findings.extend(precision::findings(model, precision.grain));
    findings.sort_by_key(|finding| finding.kind);
    Diagnosis {
        seed: options.seed,
        findings,
        precision,
    }
}

/// Least common area by the scene's that is a loss: a choice. Below it no number of the scene's changes in four digits.
const COMMON_AREA: f64 = 1e-4;

/// What lies on other surfaces of the scene, as losses: triangles that cover each other in one plane, where the smaller
/// of each pair is hidden or hides the other, and triangles that face each other with hardly a gap, which see little
/// else. Exact doubles are the repair's. Of large scenes a sample, as [`diagnose`] takes it: numbers and areas are then
/// estimates.
pub fn doubles(model: &Model, scene: &Scene, options: DiagnoseOptions) -> Ledger {
    let order = sample::order(model, options.seed);
    let patches = model.patches();
    let area_of_all: f64 = patches.iter().map(|patch| patches.area(patch)).sum();
    let mut ledger = Ledger::default();
    for finding in contact::findings(model, &order, None, options) {
        let (what, next) = match finding.kind {
            FindingKind::Overlap => (
                "pair of triangles that cover each other in one plane",
                "one hides the other: delete one of each",
            ),
            FindingKind::NearContact => (
                "pair of triangles that face each other with hardly a gap",
                "they see little else: delete both where houses are joined, one where a face is there twice",
            ),
            _ => continue,
        };
        let (Some(area), Some(first)) = (finding.total, finding.examples.first()) else {
            continue;
        };
        if area < COMMON_AREA * area_of_all {
            continue;
        }
        let name = |patch: InputPatch| {
            let triangle = scene.triangles.get(patches.triangle(patch))?;
            let name = scene.objects.get(triangle.object as usize)?;
            (!name.is_empty()).then(|| format!("`{name}`"))
        };
        let mut names: Vec<String> = std::iter::once(first.patch)
            .chain(first.other)
            .filter_map(name)
            .collect();
        names.dedup();
        let place = || {
            let [x, y, z] = first.at.to_array().map(|at| format!("{at:.4}"));
            format!("{} at {x} {y} {z}", names.join(" and "))
                .trim_start()
                .to_owned()
        };
        let kind = Kind {
            fate: Fate::Doubtful,
            what,
            next,
        };
        ledger.lose(kind, whole::to_u64(finding.estimate), Some(area), place);
    }
    ledger
}

/// The power of two that a model's coordinates were scaled by.
fn scale_of(model: &Model) -> f64 {
    let edges = model
        .patches()
        .surfaces()
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    // Not their lengths: these may have squares out of range.
    let across = |a: DVec3, b: DVec3| (b - a).abs().max_element();
    let scale = edges
        .map(|(a, b)| across(model.normalise(a), model.normalise(b)) / across(a, b))
        .find(|scale| scale.is_finite() && *scale > 0.0)
        .unwrap_or(1.0);
    // The rounding of coordinates far from the origin is far less than a factor of two.
    scale.log2().round().exp2()
}

/// The longest edge, and the height over it. Of normalised corners, for it squares them.
fn shape(corners: &[DVec3; 3]) -> (f64, f64) {
    let [a, b, c] = *corners;
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let doubled = (b - a).cross(c - a).length();
    (longest, if longest > 0.0 { doubled / longest } else { 0.0 })
}

/// A length in two figures, rounded up, for a person to type.
fn rounded(length: f64) -> String {
    if !(length.is_finite() && length > 0.0) {
        return "LENGTH".to_owned();
    }
    let magnitude = length.log10().floor();
    if (-4.0..6.0).contains(&magnitude) {
        let decimals = whole::to_usize(1.0 - magnitude);
        let step = 10f64.powf(magnitude - 1.0);
        format!("{:.decimals$}", (length / step - 1e-9).ceil() * step)
    } else {
        format!("{length:.1e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_are_kept_whatever_the_order() {
        let example = |patch| Example {
            patch: InputPatch(patch),
            other: None,
            at: DVec3::splat(patch.into()),
            value: 0.0,
        };
        let badness = |patch: u32| f64::from(patch * 7 % 10);
        let tally = |patches: &[u32]| {
            let mut tally = Tally::default();
            patches.iter().for_each(|&p| tally.add(badness(p), 1.0, example(p)));
            tally
        };
        let up: Vec<u32> = (0..40).collect();
        let down: Vec<u32> = (0..40).rev().collect();
        let mut merged = tally(&up[..13]);
        merged.merge(tally(&up[13..]));
        let ids = |tally: &Tally| tally.worst.iter().map(|(_, e)| e.patch.0).collect::<Vec<_>>();
        // 7 p mod 10 is 9 for 7, 17, 27 and 37, and 8 first for 4.
        assert_eq!(ids(&tally(&up)), [7, 17, 27, 37, 4]);
        assert_eq!(ids(&tally(&down)), ids(&merged));
        assert_eq!((merged.count, merged.total), (40, 40.0));
    }

    #[test]
    fn lengths_to_type() {
        assert_eq!(
            [0.01234, 1.26, 987.0, 3e-9].map(rounded),
            ["0.013", "1.3", "990", "3.0e-9"]
        );
        assert_eq!(rounded(f64::NAN), "LENGTH");
    }
}
