// Hidden beginning of the documentation's examples. Each includes this file in a module `room`: an example cannot call
// a function of another one, and making a store takes more lines than the example is about.

use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection, compute};
use hemicube::accuracy::correct::Correction;
use hemicube::driver::settings::{RowSettings, RowsRecord, SubdivisionRecord};
use hemicube::store::{Header, Part, PatchTable, Store, StoreWriter};
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::{Patches, Scene, Subdivision, Triangle, generate};
use std::path::Path;

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

pub const RENDER: RenderSettings = RenderSettings {
    resolution: 64,
    culling: Culling::On,
    covered: false,
};

/// Two unit squares at unit distance that face each other: four triangles.
pub fn squares() -> Scene {
    let square = |z: f64| [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| glam::DVec3::new(x, y, z));
    let ([a, b, c, d], [e, f, g, h]) = (square(0.0), square(1.0));
    let corners = [[a, b, c], [a, c, d], [e, g, f], [e, h, g]];
    let triangle = |(face, corners)| Triangle {
        corners,
        object: 0,
        material: 0,
        face,
        two_sided: false,
    };
    Scene {
        triangles: (0..).zip(corners).map(triangle).collect(),
        objects: vec!["squares".to_owned()],
        materials: vec![hemicube_scene::Material::default()],
        ..Scene::default()
    }
}

/// The model of a scene, each of its triangles cut into four.
pub fn model_of(scene: &Scene) -> Result<Model> {
    let patches = Patches::new(scene, Subdivision::Split(2))?;
    Ok(Model::new(patches.into(), HierarchyOptions::default())?)
}

/// The model of the closed Cornell box: 160 patches.
pub fn model() -> Result<Model> {
    model_of(&generate::cornell_box())
}

pub fn plan(model: &Model, correction: Correction) -> Plan {
    Plan::new(model, RowChoice::All, Selection::default(), 1, true).with_correction(correction)
}

/// Settings of the rows of [`plan`].
pub fn settings(correction: &Correction) -> RowSettings {
    RowSettings {
        resolution: RENDER.resolution,
        samples: 1,
        correction: correction.name(),
        tolerance: None,
        reason: None,
        price: None,
        update: None,
        rotation: true,
        subdivision: SubdivisionRecord::from(Subdivision::Split(2)),
        two_sided: "auto",
        flip: Vec::new(),
        exclude: Vec::new(),
        keep_duplicates: false,
        scale: 1.0,
        up: Some("y"),
        rows: RowsRecord::All,
        emitters: Vec::new(),
        receivers: Vec::new(),
        occluders: Vec::new(),
        min_factor: None,
        patches: hemicube::PatchKind::Triangle,
        elements: None,
        portals: None,
        reading: Default::default(),
    }
}

pub fn header(scene: &Scene, model: &Model, plan: &Plan) -> Result<Header> {
    let backend = CpuBackend::new();
    let settings = settings(&plan.correction);
    Ok(settings.header(scene, model.patches(), Path::new("room.obj"), plan, backend.info())?)
}

/// The rows of the closed Cornell box in memory.
pub fn parts(model: &Model, correction: Correction) -> Result<Vec<Part>> {
    let mut parts = Vec::new();
    let (plan, backend) = (plan(model, correction), Box::new(CpuBackend::new()));
    compute(
        model,
        &plan,
        RENDER,
        backend,
        Execution::default(),
        &mut parts,
        &mut |_| {},
    )?;
    Ok(parts)
}

/// A store of the closed Cornell box.
pub fn stored(directory: &Path, correction: Correction) -> Result<Store> {
    let scene = generate::cornell_box();
    let model = model_of(&scene)?;
    let table = PatchTable::new(&scene, model.patches());
    let plan = plan(&model, correction);
    let mut writer = StoreWriter::create(directory, header(&scene, &model, &plan)?, &table, false)?;
    let backend = Box::new(CpuBackend::new());
    compute(
        &model,
        &plan,
        RENDER,
        backend,
        Execution::default(),
        &mut writer,
        &mut |_| {},
    )?;
    writer.finish()?;
    Ok(Store::open(directory)?)
}
