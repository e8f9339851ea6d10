//! Sky and suns through mirrors and panes: against rays traced backwards, written here, and the beam's geometry.
//!
//! The binary is the one beside this test: build it with the same profile and target directory before.

#![cfg(unix)]

use glam::DVec3;
use hemicube::portal::Law;
use hemicube::sky::{SkyDivision, StoredSky};
use hemicube_tests::random::Random;
use hemicube_tests::rooms::{Quad, both_ways, near, obj, room};
use hemicube_tests::runs::Place;
use std::f64::consts::TAU;

/// Evenly in [0, 1).
fn random() -> impl FnMut() -> f64 {
    let mut random = Random(7);
    move || random.unit()
}

const INDEX: f64 = 1.52;
const DEPTH: f64 = 0.006 * 30.0;
const GLASS: &str = "[object.facade]\nindex = 1.52\nthickness = 0.006\nextinction = 30\n";

/// A street along y: the ground, a façade of glass at x = 5, 8 high, and a sensor on the other side that looks at it.
fn street() -> Vec<Quad<'static>> {
    let mut quads = vec![
        (
            "ground",
            [[-5., -10., 0.], [5., -10., 0.], [5., 10., 0.], [-5., 10., 0.]],
        ),
        (
            "sensor",
            [[0., 0., 2.], [0., 0.02, 2.], [0., 0.02, 2.02], [0., 0., 2.02]],
        ),
    ];
    quads.extend(both_ways((
        "facade",
        [[5., -10., 0.], [5., 10., 0.], [5., 10., 8.], [5., -10., 8.]],
    )));
    quads
}

/// The part of the sky's light along a ray from the sensor: through the façade, off it, or past it.
fn brought(from: DVec3, towards: DVec3, glass: &Law, radiance: &impl Fn(DVec3) -> f64) -> f64 {
    let meets_ground = |from: DVec3, towards: DVec3| {
        let at = from + towards * (-from.z / towards.z);
        towards.z < 0.0 && (-5.0..=5.0).contains(&at.x) && (-10.0..=10.0).contains(&at.y)
    };
    let sky = |from: DVec3, towards: DVec3| {
        if meets_ground(from, towards) {
            0.0
        } else {
            radiance(towards)
        }
    };
    let at = from + towards * ((5.0 - from.x) / towards.x);
    let is_glass = towards.x > 0.0 && (-10.0..=10.0).contains(&at.y) && (0.0..=8.0).contains(&at.z);
    if !is_glass {
        return sky(from, towards);
    }
    let optics = glass.at(towards.x);
    let mirrored = DVec3::new(-towards.x, towards.y, towards.z);
    // Back over the street; the sensor is too small to be met.
    optics.specular * sky(at, mirrored) + optics.transmittance * sky(at, towards)
}

#[test]
fn a_facade_of_glass_lights_the_street_opposite() {
    let place = Place::new();
    place.write("street.obj", obj(&street()));
    place.write("glass.toml", GLASS);
    place
        .line("sky street.obj --up z -o sky --specular glass.toml --resolution 512 --quiet")
        .is(0);
    let sky = StoredSky::open(&place.path("sky/sky.npz")).expect("sky rows");
    let division = SkyDivision::new(1).expect("Tregenza's");
    // Brighter in the west, behind the sensor: what the façade reflects counts.
    let level = |column: u32| {
        if column == 0 {
            return 0.1;
        }
        let middle = division.middle(column);
        1.0 + 6.0 * (-middle.x).max(0.0) + middle.z
    };
    let radiance = |towards: DVec3| level(division.column(towards));
    let irradiance = |row: usize| -> f64 {
        let (columns, shares) = sky.row(row);
        let each = columns.iter().zip(shares);
        each.map(|(&column, &share)| level(column) * share).sum()
    };
    let glass = Law::Pane {
        index: INDEX,
        depth: DEPTH,
    };
    let mut unit = random();
    let (mut sum, mut direct) = (0.0, 0.0);
    let rays = 4_000_000;
    let opaque = Law::Face { index: 1.0 };
    for _ in 0..rays {
        let from = DVec3::new(0.0, 0.02 * unit(), 2.0 + 0.02 * unit());
        let (u, v) = (unit(), unit());
        let (sine, cosine) = (TAU * v).sin_cos();
        let towards = DVec3::new((1.0 - u).sqrt(), u.sqrt() * cosine, u.sqrt() * sine);
        sum += brought(from, towards, &glass, &radiance);
        direct += brought(from, towards, &opaque, &radiance);
    }
    let (exact, direct) = (sum / f64::from(rays), direct / f64::from(rays));
    assert!(
        exact > 1.3 * direct,
        "the façade brings much of it: {exact} and {direct}"
    );
    // Patches 2 and 3 are the sensor's halves.
    near(0.5 * (irradiance(2) + irradiance(3)), exact, 0.01 * exact);
    // Without the option the façade hides the sky.
    place
        .line("sky street.obj --up z -o plain --resolution 512 --quiet")
        .is(0);
    let plain = StoredSky::open(&place.path("plain/sky.npz")).expect("sky rows");
    let (columns, shares) = plain.row(2);
    let each = columns.iter().zip(shares);
    let seen: f64 = each.map(|(&column, &share)| level(column) * share).sum();
    near(seen, direct, 0.01 * direct);
}

#[test]
fn a_matrix_with_panes_has_the_sky_that_escapes_through_them() {
    let place = Place::new();
    place.write("street.obj", obj(&street()));
    place.write("glass.toml", GLASS);
    let settings = "--correction pixel --resolution 128";
    place
        .line(&format!(
            "compute street.obj --up z -o street --specular glass.toml --quiet {settings}"
        ))
        .is(0);
    // The matrix's own mirrors and panes; others are refused.
    place.line("sky street.obj --matrix street --quiet").is(0);
    let report = place.line("check street --json").is(0).json();
    assert_eq!(report["ok"], true, "{report}");
    let sky = StoredSky::open(&place.path("street/sky/sky.npz")).expect("sky rows");
    let store = hemicube::store::Store::open(&place.path("street")).expect("a store");
    let escaped = store.row_table().expect("rows").escaped;
    for (row, &escaped) in escaped.iter().enumerate() {
        let sum: f64 = sky.row(row).1.iter().sum();
        near(sum, escaped, 1e-5);
    }
    place.write("glass.toml", "[object.facade]\nspecular = 0.5\n");
    place
        .line("sky street.obj --matrix street --specular glass.toml")
        .is(2)
        .says(&["are not those of"]);
}

/// The numbers of a `.npy` file of f32 in rows.
fn array(bytes: &[u8]) -> Vec<f32> {
    let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let (numbers, _) = bytes[10 + header..].as_chunks::<4>();
    numbers.iter().map(|number| f32::from_le_bytes(*number)).collect()
}

fn sunlight(place: &Place) -> Vec<f64> {
    let bytes = std::fs::read(place.path("sky/sunlight.npy")).expect("sunlight");
    array(&bytes).into_iter().map(f64::from).collect()
}

/// A room of 4 × 4 × 3 with a window of 2 × 1 in its north wall. Nothing else lets the sun in.
fn with_window() -> Vec<Quad<'static>> {
    let mut quads = room(4., 4., 3.);
    quads.retain(|(name, _)| *name != "y1");
    for (low, high, bottom, top) in [(0., 1., 0., 3.), (3., 4., 0., 3.), (1., 3., 0., 1.), (1., 3., 2., 3.)] {
        quads.extend(both_ways((
            "wall",
            [[low, 4., bottom], [low, 4., top], [high, 4., top], [high, 4., bottom]],
        )));
    }
    quads.extend(both_ways((
        "window",
        [[1., 4., 1.], [1., 4., 2.], [3., 4., 2.], [3., 4., 1.]],
    )));
    quads
}

#[test]
fn the_sun_comes_through_a_window_onto_the_floor() {
    let place = Place::new();
    place.write("room.obj", obj(&with_window()));
    place.write(
        "glass.toml",
        "[object.window]\nindex = 1.52\nthickness = 0.006\nextinction = 30\n",
    );
    place.write("suns.txt", "0 1 1\n0 -1 1\n");
    place
        .line("sky room.obj --up z -o sky --specular glass.toml --suns suns.txt --split 16 --resolution 32 --quiet")
        .is(0);
    let light = sunlight(&place);
    // The floor is two triangles of 256 patches.
    let area = 16.0 / 512.0;
    let onto_floor = |sun: usize| (0..512).map(|patch| area * light[2 * patch + sun]).sum::<f64>();
    let cosine = 0.5f64.sqrt();
    let through = Law::Pane {
        index: INDEX,
        depth: DEPTH,
    }
    .at(cosine)
    .transmittance;
    near(onto_floor(0), through * 2.0 * cosine, 0.01 * through * 2.0 * cosine);
    assert_eq!(onto_floor(1), 0.0, "the sun behind the house");
    assert_eq!(light.iter().filter(|light| **light > 1.0).count(), 0);
}

#[test]
fn the_sun_comes_off_a_mirror() {
    let place = Place::new();
    place.write(
        "street.obj",
        obj(&[
            ("mirror", [[5., -9., 0.], [5., -9., 20.], [5., 9., 20.], [5., 9., 0.]]),
            ("wall", [[0., 0., 0.], [0., 1., 0.], [0., 1., 1.], [0., 0., 1.]]),
        ]),
    );
    place.write("mirror.toml", "[object.mirror]\nspecular = 0.8\n");
    place.write("suns.txt", "-1 0 1\n1 0 1\n");
    place
        .line("sky street.obj --up z -o sky --specular mirror.toml --suns suns.txt --resolution 32 --quiet")
        .is(0);
    let light = sunlight(&place);
    let cosine = 0.5f64.sqrt();
    for wall in [2, 3] {
        near(light[2 * wall], 0.8 * cosine, 1e-6);
        near(light[2 * wall + 1], 0.0, 1e-6);
    }
    // The mirror's front sees the first sun directly.
    near(light[0], cosine, 1e-6);
}

/// Irradiances at points: direct and diffuse, of each line.
fn of_points(place: &Place) -> Vec<[f64; 2]> {
    let text = std::fs::read_to_string(place.path("light.csv")).expect("a table");
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let [direct, diffuse] = ["direct (W/m2)", "diffuse (W/m2)"].map(|name| {
        let at = head.iter().position(|head| *head == name);
        at.unwrap_or_else(|| panic!("no {name}: {text}"))
    });
    let of = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        [direct, diffuse].map(|at| cells[at].parse().expect("a number"))
    };
    lines.map(of).collect()
}

/// A desk below a window, under a sun by azimuth and altitude, and under skies that are even and not.
#[test]
fn a_desk_has_sun_and_sky_through_a_window() {
    let place = Place::new();
    place.write("room.obj", obj(&with_window()));
    place.write("glass.toml", GLASS.replace("facade", "window"));
    place.write("desk.csv", "x,y,z,nx,ny,nz\n2,2.75,0.25,0,0,1\n");
    place.write(
        "day.csv",
        "time,azimuth,altitude,direct,diffuse,sky\n\
         in,0,45,500,100,overcast\nbehind,180,45,500,100,uniform\nbeside,60,45,500,0,uniform\n",
    );
    let line =
        "points room.obj --up z --points desk.csv --suns day.csv -o light.csv --overwrite --resolution 512 --quiet";
    let dark = |found: &[[f64; 2]]| found.iter().all(|found| *found == [0.0, 0.0]);
    place.line(line).is(0);
    assert!(dark(&of_points(&place)), "a window that is no pane is a wall");
    place.line(&format!("{line} --specular glass.toml")).is(0);
    let found = of_points(&place);
    let glass = Law::Pane {
        index: INDEX,
        depth: DEPTH,
    };
    // Over the window, cos θ dω = z (4 − y) dx dz / r⁴.
    let sky = |radiance: &dyn Fn(f64) -> f64| -> f64 {
        let (across, up) = (200, 100);
        let mut sum = 0.0;
        for i in 0..across * up {
            let (x, z) = (f64::from(i % across) + 0.5, f64::from(i / across) + 0.5);
            let to = DVec3::new(x * 2.0 / f64::from(across) - 1.0, 1.25, 0.75 + z / f64::from(up));
            let (length, towards) = (to.length(), to.normalize());
            let solid_angle = towards.y * 2.0 / f64::from(across * up) / (length * length);
            sum += glass.at(towards.y).transmittance * radiance(towards.z) * towards.z * solid_angle;
        }
        sum
    };
    // The overcast sky's zenith is 9 / (7 π) of its irradiance.
    let overcast = sky(&|sine| 9.0 / (7.0 * std::f64::consts::PI) * (1.0 + 2.0 * sine) / 3.0);
    let even = sky(&|_| 1.0 / std::f64::consts::PI);
    let cosine = 0.5f64.sqrt();
    let direct = glass.at(cosine).transmittance * cosine * 500.0;
    for (found, exact) in found
        .iter()
        .zip([[direct, 100.0 * overcast], [0.0, 100.0 * even], [0.0, 0.0]])
    {
        near(found[0], exact[0], 1e-5 * direct);
        near(found[1], exact[1], 0.01 * exact[1]);
    }
    // Heat does not go through glass as light does.
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.9\ntemperature = 300\n[object.window]\nemissivity = 0.1\n",
    );
    place.line("compute room.obj -o f --quiet --specular glass.toml").is(0);
    place
        .line("solve f --thermal --materials m.toml --sky-temperature 280")
        .is(0);
    place
        .line("points room.obj --up z --points desk.csv --suns day.csv --as sphere --solution f --sky-temperature 280")
        .is(2)
        .says(&[
            "panes let light through and little heat",
            "give the solution of light alone",
        ]);
}

#[test]
fn a_point_has_the_sun_off_a_mirror() {
    let place = Place::new();
    place.write(
        "street.obj",
        obj(&[("mirror", [[5., -9., 0.], [5., -9., 20.], [5., 9., 20.], [5., 9., 0.]])]),
    );
    place.write("mirror.toml", "[object.mirror]\nspecular = 0.8\n");
    place.write("wall.csv", "0 0.5 0.5 1 0 0\n");
    place.write("day.csv", "x,y,z,direct\n-1,0,1,500\n1,0,1,500\n-1,0,8,500\n");
    place
        .line("points street.obj --up z --points wall.csv --suns day.csv -o light.csv --specular mirror.toml --quiet")
        .is(0);
    let found = of_points(&place);
    // The first comes off the mirror, the second is behind it, and the third passes over it and comes from behind.
    near(found[0][0], 0.8 * 0.5f64.sqrt() * 500.0, 1e-3);
    assert_eq!([found[1][0], found[2][0]], [0.0, 0.0]);
}

/// A wall far from the point, and a mirror, which has rays followed: what lies beyond the scene's size hides, too.
#[test]
fn a_wall_hides_the_sun_from_a_point_far_outside_of_the_scene() {
    let place = Place::new();
    place.write(
        "wall.obj",
        obj(&[
            ("wall", [[0., -1., 0.], [0., -1., 2.], [0., 1., 2.], [0., 1., 0.]]),
            ("mirror", [[-1., 0., 0.], [-1., 1., 0.], [-0.9, 1., 0.], [-0.9, 0., 0.]]),
        ]),
    );
    place.write("mirror.toml", "[object.mirror]\nspecular = 0.8\n");
    place.write("far.csv", "9 0 1 -1 0 0\n");
    place.write("day.csv", "x,y,z,direct\n-1,0,0,1000\n-1,0,0.2,1000\n");
    place
        .line("points wall.obj --up z --points far.csv --suns day.csv -o light.csv --specular mirror.toml --quiet")
        .is(0);
    let found = of_points(&place);
    assert_eq!(found[0][0], 0.0);
    near(found[1][0], 1000.0 / (1.0f64 + 0.04).sqrt(), 0.01);
}

#[test]
fn a_mirror_on_the_floor_shows_any_sky() {
    let place = Place::new();
    place.write(
        "floor.obj",
        obj(&[(
            "mirror",
            [[-99., -99., 0.], [99., -99., 0.], [99., 99., 0.], [-99., 99., 0.]],
        )]),
    );
    place.write("mirror.toml", "[object.mirror]\nspecular = 0.9\n");
    place.write("down.csv", "0.3 0.2 1 0 0 -1\n");
    let skies = ["uniform", "overcast", "clear", "perez"];
    let day: Vec<String> = skies.iter().map(|sky| format!("0.3,0.2,0.9,300,100,{sky}\n")).collect();
    place.write("day.csv", format!("x,y,z,direct,diffuse,sky\n{}", day.concat()));
    place
        .line("points floor.obj --up z --points down.csv --suns day.csv -o light.csv --specular mirror.toml --quiet")
        .is(0);
    // All but what passes the mirror's edge, a ten-thousandth.
    for (sky, found) in skies.iter().zip(of_points(&place)) {
        assert!((found[1] - 90.0).abs() < 0.5, "{sky}: {found:?}");
    }
}

/// What a mirror overhead shows of the ground is no sky: lines of a table do not depend on each other.
#[test]
fn an_even_sky_is_the_same_beside_others() {
    let place = Place::new();
    place.write(
        "lid.obj",
        obj(&[("mirror", [[-1., -1., 1.], [-1., 1., 1.], [1., 1., 1.], [1., -1., 1.]])]),
    );
    place.write("mirror.toml", "[object.mirror]\nspecular = 0.9\n");
    place.write("up.csv", "0 0 0 0 0 1\n");
    let diffuse = |lines: &str| {
        place.write("day.csv", format!("x,y,z,direct,diffuse,sky,ground\n{lines}"));
        place
            .line("points lid.obj --up z --points up.csv --suns day.csv -o light.csv --specular mirror.toml --quiet --overwrite")
            .is(0);
        of_points(&place)
            .into_iter()
            .map(|found| found[1])
            .collect::<Vec<f64>>()
    };
    let alone = diffuse("0,0,1,0,100,uniform,0.5\n")[0];
    // The view factor of the lid from the point below its middle (Howell C-3, four of them).
    let slant = 2.0f64.sqrt();
    let lid = 4.0 * (2.0 / slant * (1.0 / slant).atan()) / TAU;
    near(alone, 100.0 * (1.0 - lid), 0.5);
    let beside = diffuse("0,0,1,0,100,overcast,0\n0,0,1,0,100,uniform,1\n0,0,1,0,100,overcast,1\n");
    near(beside[1], alone, 1e-3);
    assert_eq!(beside[0], beside[2]);
}

/// Sun and reflected light at points go by the north of the sky rows that the reflected light was made with.
#[test]
fn one_north_is_of_sun_and_reflections() {
    let place = Place::new();
    place.write(
        "walls.obj",
        obj(&[
            ("west", [[-2., -1., 0.], [-2., 1., 0.], [-2., 1., 2.], [-2., -1., 2.]]),
            ("floor", [[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]]),
        ]),
    );
    place.write("m.toml", "bands = [\"all\"]\n[default]\nreflectance = 0.5\n");
    place.write("day.csv", "azimuth,altitude,direct\n0,20,1000\n");
    place.write("p.csv", "0 0 1 1 0 0\n");
    place.line("compute walls.obj --up z -o f -q").is(0);
    // North lies to the east.
    place.line("sky walls.obj --matrix f --north 90 -q").is(0);
    place.line("solve f --materials m.toml --suns day.csv -q").is(0);
    let direct = |options: &str| {
        place
            .line(&format!(
                "points walls.obj --up z --points p.csv --suns day.csv -o light.csv -q --overwrite {options}"
            ))
            .is(0);
        of_points(&place)[0][0]
    };
    near(
        direct("--solution f:radiosity"),
        1000.0 * 20f64.to_radians().cos(),
        0.01,
    );
    assert_eq!(direct(""), 0.0, "north is +y of itself");
}
