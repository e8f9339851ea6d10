//! Rays that measure shares and segments of pairs, on a device: rows are those of the processor's, to the bit, and few
//! are left to it.

use glam::DVec3;
use hemicube::Model;
use hemicube::backend::{
    BackendError, BackendInfo, Counters, Geometry, Hemicube, HemicubeBackend, Rays, RenderSettings,
};
use hemicube::driver::compute::{Execution, Plan, RowChoice, Selection};
use hemicube::face::Items;
use hemicube::row::RowBlock;
use hemicube::store::Part;
use hemicube_scene::generate::{self, Kind};
use hemicube_scene::{InputPatch, Scene, Subdivision, Triangle};
use hemicube_tests::devices::is_there;
use hemicube_tests::plugins::{rust, try_session};
use hemicube_tests::rows::{Rung, parts, settings};
use hemicube_tests::runs::{Place, assert_same};
use hemicube_tests::scenes::{generated, model, say};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Share of the rays that may be left to the processor.
const MOST_DOUBTFUL: f64 = 0.05;

/// Rays of shares that were cast, those that were doubtful, and the same of pairs.
type Counts = Arc<[AtomicU64; 4]>;

/// Length of the rays of shares.
const FAR: f64 = 4.0;

/// A session whose answers to rays are counted.
struct Counted(Box<dyn HemicubeBackend>, Counts);

impl HemicubeBackend for Counted {
    fn info(&self) -> &BackendInfo {
        self.0.info()
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.0.load(geometry, settings)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Ok(Box::new(Self(self.0.fork()?, Arc::clone(&self.1))))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        self.0.rows(hemicubes, out)
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let met = self.0.rays(rays)?;
        let doubtful = met.iter().filter(|&&met| met == Rays::DOUBTFUL).count();
        let [start, end] = rays.ends[0];
        let is_share = ((end - start).length() - FAR).abs() < 1e-9;
        let counts = if is_share { &self.1[..2] } else { &self.1[2..] };
        for (count, more) in counts.iter().zip([met.len(), doubtful]) {
            count.fetch_add(more as u64, Ordering::Relaxed);
        }
        Ok(met)
    }
}

/// Some rows of a scene at 0.3 %, by a plugin with these options, and its rays.
fn rows(name: &str, options: &[&str], model: &Model, some: RowChoice, threads: usize) -> (Vec<Part>, [u64; 4]) {
    let session = try_session(&rust(name), options).expect("it opened before");
    let counts = Counts::default();
    let backend = Box::new(Counted(Box::new(session), Arc::clone(&counts)));
    let rung = Rung::tolerance(3e-3);
    let plan = Plan::new(model, some, Selection::default(), 1, true).with_correction(rung.correction);
    let execution = Execution {
        threads,
        batch: 0,
        cancel: None,
    };
    let (parts, _) = parts(model, &plan, settings(rung.resolution), backend, execution).expect("a sound run");
    (parts, [0, 1, 2, 3].map(|k| counts[k].load(Ordering::Relaxed)))
}

fn casts_rays_to_the_bit(name: &str, options: &[&str]) {
    let opened = try_session(&rust(name), options);
    let opened = opened.map(|session| Box::new(session) as Box<dyn HemicubeBackend>);
    if !is_there(
        name,
        &opened.map_err(|error| BackendError::Unsupported(error.to_string())),
    ) {
        return;
    }
    let sample = RowChoice::Sample { count: 12, seed: 1 };
    // Rows of the room, whose pairs see each other through leaves.
    let walls = RowChoice::Range { start: 0, end: 3 };
    let cut = Subdivision::Levels(2);
    for (scene, model, some, [rays, segments]) in [
        ("city", generated(Kind::City, 600), sample, [5_000, 0]),
        ("towers", generated(Kind::BlockCity, 6_000), sample, [5_000, 0]),
        (
            "box",
            self::model(generate::cornell_box_open(), cut),
            sample,
            [5_000, 0],
        ),
        ("foliage", self::model(foliage(), Subdivision::None), walls, [0, 5_000]),
    ] {
        let (without, none) = rows(name, options, &model, some, 1);
        assert_eq!(none, [0; 4], "rays are cast by the device only where it is asked to");
        let with_rays = [options, &["rays=on"]].concat();
        let (with, counts) = rows(name, &with_rays, &model, some, 2);
        assert!(with == without, "{name}, {scene}: rays change rows");
        let [cast, doubtful, of_pairs, doubtful_of_pairs] = counts;
        for (what, cast, doubtful, least) in [
            ("rays", cast, doubtful, rays),
            ("segments", of_pairs, doubtful_of_pairs, segments),
        ] {
            if least == 0 {
                continue;
            }
            let share = doubtful as f64 / cast.max(1) as f64;
            say(&format!("{name}, {scene}: {cast} {what}, {share:.1e} of them doubtful"));
            assert!(
                cast >= least && share < MOST_DOUBTFUL,
                "{name}, {scene}: {doubtful} of {cast} {what}"
            );
        }
    }
    the_program_casts_rays_to_the_bit(name);
}

/// A room full of leaves: more than a shaft lists lie between its walls.
fn foliage() -> Scene {
    let mut scene = generate::room(2).expect("a room");
    let corners = || scene.triangles.iter().flat_map(|triangle| triangle.corners);
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let size = corners().fold(DVec3::NEG_INFINITY, DVec3::max) - low;
    // Numbers that fill a cube evenly (Kronecker's sequence, by roots of primes).
    let point = |k: u32, primes: [f64; 3]| DVec3::from_array(primes.map(|p| (p.sqrt() * f64::from(k + 1)).fract()));
    let leaf = |k: u32| {
        let middle = 0.1 + 0.8 * point(k, [2.0, 3.0, 5.0]);
        let corner = |primes| low + size * (middle + 0.04 * (point(k, primes) - 0.5));
        Triangle {
            corners: [
                corner([7.0, 11.0, 13.0]),
                corner([17.0, 19.0, 23.0]),
                corner([29.0, 31.0, 37.0]),
            ],
            object: 0,
            material: 0,
            face: 0,
            two_sided: true,
        }
    };
    let leaves: Vec<_> = (0..3_000).map(leaf).collect();
    scene.triangles.extend(leaves);
    scene
}

/// What a device answers to a ray past thin diagonal triangles, all of whose boxes the ray passes through.
fn past_diagonals(name: &str, count: u32) -> u32 {
    let [along, up] = [DVec3::new(0.6, -0.6, -1.0), DVec3::new(0.6, -0.6, 1.0)];
    let of = |corners: [DVec3; 3]| Triangle {
        corners,
        object: 0,
        material: 0,
        face: 0,
        two_sided: false,
    };
    let mut triangles = vec![of(
        [DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1].map(|corner| along + corner)
    )];
    triangles.extend((1..=count).map(|k| {
        let aside = 0.1 * f64::from(k) / f64::from(count);
        of([
            DVec3::new(-1.0, -1.0, -0.9),
            DVec3::new(1.0, 1.0, 0.9),
            DVec3::new(1.0 - aside, 1.0, 0.9),
        ])
    }));
    let scene = Scene {
        triangles,
        ..Scene::default()
    };
    let model = model(scene, Subdivision::None);
    let mut session = try_session(&rust(name), &["rays=on"]).expect("it opened before");
    session.load(model.geometry(), settings(64)).expect("a small scene");
    let centre = model.hemicubes(InputPatch(0), 1, false)[0].origin;
    let ends = [[centre, centre + (up - along) * 0.9]];
    let rays = Rays {
        emitter: InputPatch(0),
        normal: DVec3::Z,
        offset: centre.z,
        ends: &ends,
    };
    session.rays(&rays).expect("legal rays")[0]
}

/// What a ray looks at is bounded: beyond that it is the processor's.
#[test]
fn a_ray_among_too_many_boxes_is_left_to_the_processor() {
    for name in ["vulkan", "wgpu"] {
        let opened = try_session(&rust(name), &[]);
        let opened = opened.map(|session| Box::new(session) as Box<dyn HemicubeBackend>);
        if is_there(
            name,
            &opened.map_err(|error| BackendError::Unsupported(error.to_string())),
        ) {
            assert_eq!(
                past_diagonals(name, 1_000),
                Items::ESCAPED,
                "{name}: nothing is met, surely"
            );
            assert_eq!(past_diagonals(name, 12_000), Rays::DOUBTFUL, "{name}");
        }
    }
}

/// The program's rows with and without, where a plugin's session may be one of two.
fn the_program_casts_rays_to_the_bit(name: &str) {
    let place = Place::new();
    place.line("generate city --patches 600 -o city.obj").is(0);
    let plugin = rust(name);
    let folder = plugin.parent().expect("a folder").display();
    let compute = format!(
        "HEMICUBE_BACKEND_PATH={folder} compute city.obj --tolerance 0.3% --rows 12 -v --backend {name} --backend-option"
    );
    place.line(&format!("{compute} rays=off -o off")).is(0);
    let with = place.line(&format!("{compute} rays=on -o on")).is(0);
    with.says(&["casts the rays beyond a patch's first 256"]);
    assert_same(&place.path("off/parts"), &place.path("on/parts"));
}

/// Where the validation layer is installed, its messages are errors.
#[test]
fn vulkan_casts_rays_to_the_bit() {
    match try_session(&rust("vulkan"), &["validation=on"]) {
        Ok(_) => casts_rays_to_the_bit("vulkan", &["validation=on"]),
        Err(error) => {
            say(&format!("SKIP validation: {error}"));
            casts_rays_to_the_bit("vulkan", &[]);
        }
    }
}

#[test]
fn wgpu_casts_rays_to_the_bit() {
    casts_rays_to_the_bit("wgpu", &[]);
}
