//! The report of `inspect --json`, and the source of its text.

use super::forecast::Forecast;
use crate::enclosure;
use crate::prepare::{Prepared, RepairCounts, axis_name};
use crate::report::{BackendReport, Input};
use hemicube::diagnose::{DiagnoseOptions, Diagnosis, Enclosure, Finding, Precision, SceneStatistics, Unit};
use hemicube::driver::settings::LossRecord;
use hemicube::{InputPatch, Model};
use hemicube_scene::survey::{Edges, Survey};
use serde::Serialize;
use std::collections::BTreeMap;

/// The report of `--json`.
#[derive(Serialize)]
pub(super) struct Report {
    pub(super) schema: u32,
    pub(super) program: &'static str,
    pub(super) version: &'static str,
    pub(super) inputs: Vec<Input>,
    pub(super) scene: SceneReport,
    pub(super) repair: RepairCounts,
    /// What was not taken as the file says.
    pub(super) losses: Vec<LossRecord>,
    /// What has no area, or is in the scene as it should be.
    pub(super) noted: BTreeMap<String, u64>,
    pub(super) warnings: Vec<String>,
    /// The coordinate reference system.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) crs: Option<String>,
    pub(super) patches: PatchReport,
    pub(super) octree: OctreeReport,
    pub(super) diagnosis: DiagnosisReport,
    pub(super) enclosure: EnclosureReport,
    pub(super) backend: BackendReport,
    pub(super) statistics: SceneStatistics,
    pub(super) forecast: Forecast,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) timings: Option<Timings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) peak_memory_bytes: Option<u64>,
}

#[derive(Serialize)]
pub(super) struct SceneReport {
    pub(super) triangles: u64,
    pub(super) triangles_used: usize,
    pub(super) two_sided: usize,
    pub(super) objects: usize,
    pub(super) closed_objects: usize,
    pub(super) materials: usize,
    pub(super) bounds: Option<[[f64; 3]; 2]>,
    pub(super) diagonal: f64,
    pub(super) area: f64,
    pub(super) area_min: f64,
    pub(super) area_max: f64,
    pub(super) edges: EdgeReport,
    pub(super) welded_edges: EdgeReport,
    pub(super) closed: bool,
    pub(super) up: &'static str,
    pub(super) up_reason: String,
    pub(super) up_guessed: bool,
    pub(super) metres_per_unit: Option<f64>,
    pub(super) hints: Vec<String>,
    pub(super) worst: Vec<WorstReport>,
}

#[derive(Serialize)]
pub(super) struct EdgeReport {
    pub(super) count: usize,
    pub(super) boundary: usize,
    pub(super) non_manifold: usize,
    pub(super) inconsistent: usize,
}

impl From<&Edges> for EdgeReport {
    fn from(edges: &Edges) -> Self {
        Self {
            count: edges.count,
            boundary: edges.boundary,
            non_manifold: edges.non_manifold,
            inconsistent: edges.inconsistent,
        }
    }
}

#[derive(Serialize)]
pub(super) struct WorstReport {
    pub(super) face: u32,
    pub(super) object: String,
    pub(super) aspect: f64,
    pub(super) area: f64,
}

#[derive(Serialize)]
pub(super) struct PatchReport {
    pub(super) count: usize,
    pub(super) surfaces: usize,
    pub(super) area_min: f64,
    pub(super) area_median: f64,
    pub(super) area_max: f64,
}

#[derive(Serialize)]
pub(super) struct OctreeReport {
    pub(super) nodes: usize,
    pub(super) leaves: usize,
    pub(super) levels: u32,
    pub(super) surfaces_per_leaf: f64,
}

/// Defects that spoil form factors, each example with the faces and objects of its patches.
#[derive(Serialize)]
pub(super) struct DiagnosisReport {
    pub(super) seed: u64,
    pub(super) precision: Precision,
    pub(super) findings: Vec<FindingReport>,
}

/// Enclosure of the scene, with a sentence for each wrongly wound object and each leak.
#[derive(Serialize)]
pub(super) struct EnclosureReport {
    #[serde(flatten)]
    pub(super) enclosure: Enclosure,
    pub(super) sentences: Vec<String>,
    #[serde(skip)]
    pub(super) leaks_said: Vec<String>,
    #[serde(skip)]
    pub(super) is_oriented: bool,
}

#[derive(Serialize)]
pub(super) struct FindingReport {
    #[serde(flatten)]
    pub(super) finding: Finding,
    pub(super) meaning: &'static str,
    pub(super) measure: &'static str,
    pub(super) unit: Unit,
    /// For each example, the faces and objects of its patches.
    pub(super) objects: Vec<Vec<Place>>,
}

/// Face and object of a patch.
#[derive(Serialize)]
pub(super) struct Place {
    pub(super) face: u32,
    pub(super) object: String,
}

#[derive(Serialize)]
pub(super) struct Timings {
    pub(super) load: f64,
    pub(super) build: f64,
    pub(super) diagnose: f64,
}

pub(super) fn scene_report(prepared: &Prepared, survey: Survey) -> SceneReport {
    SceneReport {
        triangles: prepared.scene.triangles_read,
        triangles_used: survey.triangle_count,
        two_sided: survey.two_sided_count,
        objects: survey.object_count,
        closed_objects: survey.closed_object_count,
        materials: survey.material_count,
        bounds: survey.bounds.map(|bounds| bounds.map(|corner| corner.to_array())),
        diagonal: survey.diagonal,
        area: survey.area,
        area_min: survey.area_min,
        area_max: survey.area_max,
        closed: survey.edges.are_closed(),
        edges: EdgeReport::from(&survey.edges),
        welded_edges: EdgeReport::from(&survey.welded_edges),
        up: axis_name(survey.up),
        up_reason: survey.up_reason,
        up_guessed: survey.up_guessed,
        metres_per_unit: prepared.scene.metres_per_unit,
        hints: survey.unit_hints,
        worst: survey
            .worst
            .into_iter()
            .map(|worst| WorstReport {
                face: worst.face,
                object: worst.object,
                aspect: worst.aspect,
                area: worst.area,
            })
            .collect(),
    }
}

pub(super) fn patch_report(prepared: &Prepared) -> PatchReport {
    let patches = &prepared.patches;
    let mut areas: Vec<f64> = patches.iter().map(|patch| patches.area(patch)).collect();
    areas.sort_unstable_by(f64::total_cmp);
    let at = |place: usize| areas.get(place).copied().unwrap_or(0.0);
    PatchReport {
        count: patches.len(),
        surfaces: patches.surfaces().len(),
        area_min: at(0),
        area_median: at(areas.len() / 2),
        area_max: at(areas.len().saturating_sub(1)),
    }
}

pub(super) fn octree_report(model: &Model) -> OctreeReport {
    let nodes = model.geometry().octree.nodes();
    let leaves = nodes.iter().filter(|node| node.is_leaf()).count();
    OctreeReport {
        nodes: nodes.len(),
        leaves,
        levels: nodes.iter().map(|node| node.level).max().unwrap_or(0),
        surfaces_per_leaf: model.geometry().surfaces.len() as f64 / leaves.max(1) as f64,
    }
}

pub(super) fn diagnosis_report(prepared: &Prepared, diagnosis: Diagnosis) -> DiagnosisReport {
    let place = |patch: InputPatch| {
        let triangle = prepared.scene.triangles.get(prepared.patches.triangle(patch))?;
        let object = prepared.scene.objects.get(triangle.object as usize);
        Some(Place {
            face: triangle.face,
            object: object.cloned().unwrap_or_default(),
        })
    };
    let report = |finding: Finding| FindingReport {
        meaning: finding.kind.meaning(),
        measure: finding.kind.measure().name,
        unit: finding.kind.measure().unit,
        objects: finding
            .examples
            .iter()
            .map(|example| {
                [Some(example.patch), example.other]
                    .into_iter()
                    .flatten()
                    .filter_map(place)
                    .collect()
            })
            .collect(),
        finding,
    };
    DiagnosisReport {
        seed: diagnosis.seed,
        precision: diagnosis.precision,
        findings: diagnosis.findings.into_iter().map(report).collect(),
    }
}

pub(super) fn enclosure_report(prepared: &Prepared, options: DiagnoseOptions) -> EnclosureReport {
    let enclosure = enclosure::of(prepared, &enclosure::objects(prepared), options);
    EnclosureReport {
        is_oriented: prepared.scene.is_oriented,
        sentences: enclosure::of_windings(prepared, &enclosure.winding),
        leaks_said: enclosure
            .leaks
            .iter()
            .map(|of| enclosure::of_leak(prepared, of))
            .collect(),
        enclosure,
    }
}
