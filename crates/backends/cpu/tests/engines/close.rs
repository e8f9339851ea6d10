//! Close hemicubes of a backend that leaves them are the CPU backend's, and all others its own.

use hemicube::backend::{
    BackendError, BackendInfo, Counters, Culling, Geometry, Hemicube, HemicubeBackend, RenderSettings,
};
use hemicube::close::is_close;
use hemicube::row::RowBlock;
use hemicube::{HierarchyOptions, Model};
use hemicube_backend_cpu::{CpuBackend, with_close};
use hemicube_scene::{Patches, Scene, Subdivision, Triangle};
use hemicube_spatial::glam::DVec3;
use std::sync::Arc;

const SETTINGS: RenderSettings = RenderSettings {
    resolution: 64,
    culling: Culling::On,
    covered: true,
};

/// A device that sees nothing: its rows escape. It refuses close hemicubes, and swallows the last row if it is to.
struct Blind {
    info: BackendInfo,
    geometry: Option<Arc<Geometry>>,
    swallows: bool,
}

impl Blind {
    fn new(leaves_close: bool, swallows: bool) -> Box<Self> {
        let mut info = CpuBackend::new().info().clone();
        info.name = "blind".to_owned();
        info.version = "b".to_owned();
        info.capabilities.leaves_close = leaves_close;
        Box::new(Self {
            info,
            geometry: None,
            swallows,
        })
    }
}

impl HemicubeBackend for Blind {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, _settings: RenderSettings) -> Result<(), BackendError> {
        self.geometry = Some(Arc::clone(geometry));
        Ok(())
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Ok(Box::new(Self {
            info: self.info.clone(),
            geometry: self.geometry.clone(),
            swallows: self.swallows,
        }))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let geometry = self.geometry.as_ref().expect("loaded");
        let close = hemicubes.iter().filter(|hemicube| is_close(geometry, hemicube)).count();
        if close > 0 {
            return Err(BackendError::Unsupported(format!("{close} close hemicubes")));
        }
        for _ in usize::from(self.swallows)..hemicubes.len() {
            out.end_row(hemicube::backend::WHOLE, 0);
        }
        Ok(Counters::default())
    }
}

/// Two walls a millionth of the scene apart and face to face, each of four triangles, and a floor.
fn party_walls() -> Model {
    let mut triangles = Vec::new();
    let mut quad = |corners: [DVec3; 4]| {
        for corners in [
            [corners[0], corners[1], corners[2]],
            [corners[0], corners[2], corners[3]],
        ] {
            triangles.push(Triangle {
                corners,
                object: 0,
                material: 0,
                face: 0,
                two_sided: false,
            });
        }
    };
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    quad([
        at(-1.0, -1.0, 0.0),
        at(1.0, -1.0, 0.0),
        at(1.0, 1.0, 0.0),
        at(-1.0, 1.0, 0.0),
    ]);
    for side in [-0.5, 0.0] {
        let (low, high) = (side, side + 0.5);
        quad([
            at(0.0, low, 0.1),
            at(0.0, high, 0.1),
            at(0.0, high, 0.5),
            at(0.0, low, 0.5),
        ]);
        quad([
            at(1e-6, low, 0.1),
            at(1e-6, low, 0.5),
            at(1e-6, high, 0.5),
            at(1e-6, high, 0.1),
        ]);
    }
    let scene = Scene {
        objects: vec!["walls".to_owned()],
        materials: vec![Default::default()],
        triangles,
        ..Scene::default()
    };
    let patches = Patches::new(&scene, Subdivision::None).expect("few patches");
    Model::new(patches.into(), HierarchyOptions::default()).expect("a scene")
}

fn hemicubes(model: &Model) -> Vec<Hemicube> {
    model
        .order()
        .flat_map(|patch| model.hemicubes(patch, 1, true))
        .collect()
}

#[test]
fn each_hemicube_is_drawn_where_it_can_be() {
    let model = party_walls();
    let hemicubes = hemicubes(&model);
    let mut processor = CpuBackend::new();
    processor.load(model.geometry(), SETTINGS).expect("loads");
    let mut wanted = RowBlock::default();
    processor.rows(&hemicubes, &mut wanted).expect("renders");

    let mut both = with_close(Blind::new(true, false));
    both.load(model.geometry(), SETTINGS).expect("loads");
    assert_eq!(both.info().version, format!("b+{}", processor.info().version));
    assert!(!both.info().capabilities.leaves_close);
    for mut session in [both.fork().expect("forks"), both] {
        let mut rows = RowBlock::default();
        session.rows(&hemicubes, &mut rows).expect("renders");
        rows.check(hemicubes.len(), model.geometry().patch_count, true)
            .expect("keeps the contract");
        let mut counts = [0; 2];
        for (row, hemicube) in hemicubes.iter().enumerate() {
            let close = is_close(model.geometry(), hemicube);
            counts[usize::from(close)] += 1;
            if close {
                assert_eq!(rows.row(row), wanted.row(row), "row {row}");
                assert!(!rows.row(row).patches.is_empty(), "a wall right before it");
            } else {
                assert_eq!(rows.row(row).escaped, hemicube::backend::WHOLE, "row {row}");
            }
        }
        // The walls' patches face each other; the floor's see them from afar.
        assert_eq!(counts, [2, 8]);
    }
}

#[test]
fn a_backend_that_draws_all_gets_all() {
    let model = party_walls();
    let mut alone = with_close(Blind::new(false, false));
    alone.load(model.geometry(), SETTINGS).expect("loads");
    assert_eq!(alone.info().version, "b");
    let refused = alone.rows(&hemicubes(&model), &mut RowBlock::default());
    assert!(matches!(refused, Err(BackendError::Unsupported(text)) if text == "8 close hemicubes"));
}

#[test]
fn a_row_that_a_device_swallows_is_missed() {
    let model = party_walls();
    let mut both = with_close(Blind::new(true, true));
    both.load(model.geometry(), SETTINGS).expect("loads");
    let error = both.rows(&hemicubes(&model), &mut RowBlock::default());
    assert!(matches!(error, Err(BackendError::Internal(text)) if text == "1 rows of 2 hemicubes"));
}
