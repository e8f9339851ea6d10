//! What a closed surface keeps apart has no form factor: not a small one, none. At every level, whichever backend renders.
//!
//! The scenes are what programs of heat and of CAD write: shells of no thickness with nodes shared by both faces, rooms
//! that share a wall, vessels with shields, hanging nodes; with plates whose centroids lie in the planes of hidden faces.

use glam::DVec3;
use hemicube::backend::{BackendError, HemicubeBackend};
use hemicube::reference::{Reference, ReferenceSettings};
use hemicube::{InputPatch, Model};
use hemicube_scene::Subdivision;
use hemicube_tests::devices::is_there;
use hemicube_tests::geometry::{
    box_inside, box_outside, even, flipped, grid, irrational_rotation, moved, quad, scene_with_sides, sphere,
};
use hemicube_tests::plugins::{rust, try_session};
use hemicube_tests::promise::Motion;
use hemicube_tests::rows::{Factors, Rung, factors, factors_with};
use hemicube_tests::scenes::model_as_it_is;

/// A triangle, with the space that its front faces, and its back if it has a patch there. Space 0 is open.
type Sided = ([DVec3; 3], u32, Option<u32>);

/// In place of a space: a patch that faces several.
const SEVERAL: u32 = u32::MAX;

/// A scene, and the space that each patch faces.
struct Kept {
    name: &'static str,
    model: Model,
    space: Vec<u32>,
}

impl Kept {
    fn new(name: &'static str, triangles: &[Sided], motion: impl Fn(DVec3) -> DVec3) -> Self {
        let scene = scene_with_sides(triangles.iter().map(|&(corners, _, back)| (corners, back.is_some())));
        let space = triangles
            .iter()
            .flat_map(|&(_, front, back)| std::iter::once(front).chain(back))
            .collect();
        Self {
            name,
            model: model_as_it_is(&moved(scene, motion), Subdivision::None),
            space,
        }
    }

    /// Returns whether two patches face different spaces.
    fn are_apart(&self, i: usize, j: usize) -> bool {
        let [i, j] = [self.space[i], self.space[j]];
        i != j && i != SEVERAL && j != SEVERAL
    }

    /// The entries between patches in different spaces, and the closed spaces' patches that lose something.
    fn leaks(&self, found: &Factors) -> Vec<String> {
        let mut leaks = Vec::new();
        for (i, row) in found.rows.iter().enumerate() {
            let other = row.iter().filter(|(j, _)| self.are_apart(i, *j as usize));
            leaks.extend(other.map(|(j, factor)| format!("F[{i}, {j}] = {factor:.3e}")));
            if self.space[i] > 0 && found.escaped[i] > 0.0 {
                leaks.push(format!("{:.3e} of row {i} escapes", found.escaped[i]));
            }
        }
        leaks
    }

    /// The rows of closed spaces whose form factors and blocked shares do not add up to 1.
    fn lacking(&self, found: &Factors) -> Vec<String> {
        let rows = (0..found.rows.len()).filter(|&i| self.space[i] > 0);
        let sums = rows.map(|i| {
            (
                i,
                found.rows[i].iter().map(|entry| entry.1).sum::<f64>() + found.blocked[i],
            )
        });
        let off = sums.filter(|(_, sum)| (sum - 1.0).abs() > 0.05);
        off.map(|(i, sum)| format!("row {i} sums to {sum}")).collect()
    }
}

/// Quads cut into a grid of `n` a side.
fn cut(quads: impl IntoIterator<Item = [DVec3; 4]>, n: u32) -> Vec<[DVec3; 3]> {
    quads
        .into_iter()
        .flat_map(|quad| grid(quad, &even(n), &even(n)))
        .collect()
}

fn facing(triangles: Vec<[DVec3; 3]>, space: u32) -> impl Iterator<Item = Sided> {
    triangles.into_iter().map(move |corners| (corners, space, None))
}

/// A box of no thickness: inner faces towards `inside`, outer ones on the same nodes towards `outside`.
fn shell(low: DVec3, size: DVec3, n: u32, [inside, outside]: [u32; 2]) -> Vec<Sided> {
    let quads = box_inside(DVec3::ONE).map(|quad| quad.map(|p| low + p * size));
    let inner = cut(quads, n);
    let outer = inner.iter().map(|&[a, b, c]| [a, c, b]).collect();
    facing(inner, inside).chain(facing(outer, outside)).collect()
}

/// Triangles outside of the unit cube whose centroids lie in the planes of its faces, and plates before its faces.
fn plates() -> Vec<Sided> {
    let mut plates = Vec::new();
    let turn = |p: DVec3, axis: usize| match axis {
        0 => DVec3::new(p.x, p.y, p.z),
        1 => DVec3::new(p.z, p.x, p.y),
        _ => DVec3::new(p.y, p.z, p.x),
    };
    for axis in 0..3 {
        for plane in [0.0, 1.0] {
            // Centroid (0.75, 2, plane): in the plane of a face.
            let corners =
                [(1.25, -0.25), (0.5, 0.5), (0.5, -0.25)].map(|(x, z)| turn(DVec3::new(x, 2.0, plane + z), axis));
            plates.push((corners, 0, Some(0)));
        }
        for side in [-1.0, 2.0] {
            let square = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(x, y)| turn(DVec3::new(x, y, side), axis));
            plates.extend(quad(square).map(|corners| (corners, 0, Some(0))));
        }
    }
    plates
}

fn shell_among_plates() -> Vec<Sided> {
    let mut all = shell(DVec3::ZERO, DVec3::ONE, 2, [1, 0]);
    all.extend(plates());
    all
}

fn boxes_in_boxes() -> Vec<Sided> {
    let mut all = shell(DVec3::ZERO, DVec3::ONE, 2, [1, 0]);
    all.extend(shell(DVec3::splat(0.25), DVec3::splat(0.5), 1, [2, 1]));
    all.extend(shell(DVec3::splat(0.375), DVec3::splat(0.25), 1, [3, 2]));
    all.extend(plates().into_iter().take(3));
    all
}

/// Two rooms of inward faces, whose common wall is two walls back to back.
fn rooms_that_share_a_wall(first: u32, second: u32) -> Vec<Sided> {
    let room = |at: f64, n: u32, space: u32| {
        let quads = box_inside(DVec3::ONE).map(|quad| quad.map(|p| p + DVec3::X * at));
        facing(cut(quads, n), space)
    };
    room(0.0, first, 1).chain(room(1.0, second, 2)).collect()
}

fn rooms_apart() -> Vec<Sided> {
    let room = |at: f64, space: u32| {
        let quads = box_inside(DVec3::ONE).map(|quad| quad.map(|p| p + DVec3::X * at));
        facing(cut(quads, 1), space)
    };
    room(0.0, 1).chain(room(3.0, 2)).collect()
}

/// A room divided by a wall of one triangle pair, beside floors and walls cut otherwise: hanging nodes on every edge.
fn rooms_with_hanging_nodes() -> Vec<Sided> {
    let mut all = Vec::new();
    for (at, space, cuts) in [(0.0, 1, [1, 2, 3, 2, 1, 3]), (1.0, 2, [3, 1, 2, 1, 2, 2])] {
        for (quad, n) in box_inside(DVec3::ONE).into_iter().zip(cuts) {
            let quad = quad.map(|p| p + DVec3::X * at);
            // The wall between the two is one surface with two sides, added below.
            if quad.iter().all(|p| p.x == 1.0) {
                continue;
            }
            all.extend(facing(cut([quad], n), space));
            all.extend(facing(cut([flipped(quad)], n), 0));
        }
    }
    let wall = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(y, z)| DVec3::new(1.0, y, z));
    all.extend(quad(wall).map(|corners| (corners, 2, Some(1))));
    all.extend(plates().into_iter().take(3));
    all
}

/// A room with a wall across it that shares no node with it, and stands on the middle of floor tiles.
fn room_with_a_wall_that_shares_no_node() -> Vec<Sided> {
    let cuts = even(4);
    let tiles = box_inside(DVec3::ONE)
        .into_iter()
        .flat_map(|quad| grid(quad, &cuts, &cuts));
    let at = 0.4;
    let space = |corners: &[DVec3; 3]| {
        let sides = corners.map(|p| p.x > at);
        if sides == [true; 3] {
            2
        } else if sides == [false; 3] {
            1
        } else {
            SEVERAL
        }
    };
    let mut all: Vec<Sided> = tiles.map(|corners| (corners, space(&corners), None)).collect();
    let wall = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(y, z)| DVec3::new(at, y, z));
    all.extend(quad(wall).map(|corners| (corners, 2, Some(1))));
    all
}

/// A core in a shield in a vessel.
fn vessel_with_a_shield() -> Vec<Sided> {
    let ball = |radius: f64, inwards: bool, space: u32| facing(sphere(1, radius, inwards, true), space);
    ball(0.3, false, 1)
        .chain(ball(0.6, true, 1))
        .chain(ball(0.6, false, 2))
        .chain(ball(1.0, true, 2))
        .chain(ball(1.0, false, 0))
        .chain(plates().into_iter().take(2))
        .collect()
}

/// A cabinet whose faces lie in the walls of its room, corner to corner, and a table that shares no node with the floor.
fn room_with_a_cabinet() -> Vec<Sided> {
    let mut all: Vec<Sided> = facing(cut(box_inside(DVec3::ONE), 2), 1).collect();
    all.extend(facing(cut(box_outside(DVec3::ZERO, DVec3::new(0.3, 1.0, 1.0)), 1), 1));
    all.extend(facing(
        cut(box_outside(DVec3::new(0.5, 0.3, 0.0), DVec3::splat(0.3)), 1),
        1,
    ));
    all.extend(shell(DVec3::new(3.0, 0.0, 0.0), DVec3::ONE, 1, [2, 0]));
    all
}

const MOTIONS: [Motion; 3] = [
    ("as it is", |p| p),
    ("turned", |p| {
        irrational_rotation() * p + DVec3::new(0.123_456_7, -7.654_321, 2.236_068)
    }),
    ("moved", |p| p * 0.3 + DVec3::new(1e3 / 3.0, -77.7, 1e3 / 7.0)),
];

fn scenes() -> Vec<(&'static str, Vec<Sided>)> {
    vec![
        ("shell among plates", shell_among_plates()),
        ("boxes in boxes", boxes_in_boxes()),
        ("rooms that share a wall", rooms_that_share_a_wall(2, 2)),
        (
            "rooms whose common wall is cut in two ways",
            rooms_that_share_a_wall(2, 3),
        ),
        ("rooms apart", rooms_apart()),
        ("rooms with hanging nodes", rooms_with_hanging_nodes()),
        ("vessel with a shield", vessel_with_a_shield()),
        (
            "room with a wall that shares no node",
            room_with_a_wall_that_shares_no_node(),
        ),
    ]
}

fn levels(model: &Model) -> Vec<(&'static str, Rung)> {
    vec![
        ("pixel", Rung::PIXEL),
        ("2 %", Rung::usual(model)),
        ("1 %", Rung::settled(model, 1e-2)),
        ("0.2 %", Rung::settled(model, 2e-3)),
        ("0.1 %", Rung::settled(model, 1e-3)),
    ]
}

fn held(scenes: &[(&'static str, Vec<Sided>)], levels: impl Fn(&Model) -> Vec<(&'static str, Rung)>) {
    let mut failed = Vec::new();
    for (name, triangles) in scenes {
        for (way, motion) in MOTIONS {
            let kept = Kept::new(name, triangles, motion);
            for (level, rung) in levels(&kept.model) {
                let found = factors(&kept.model, rung).expect("a matrix");
                let entries: usize = found.rows.iter().map(Vec::len).sum();
                assert!(entries > 100, "{name}: {entries} entries");
                let mut leaks = kept.leaks(&found);
                leaks.extend(kept.lacking(&found));
                if let Some(first) = leaks.first() {
                    failed.push(format!("{}, {way}, {level}: {} leaks, {first}", kept.name, leaks.len()));
                }
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn nothing_passes_a_closed_surface() {
    held(&scenes(), levels);
}

#[test]
fn nothing_passes_a_closed_surface_where_each_pair_is_measured() {
    held(&scenes(), |model| vec![("0.01 %", Rung::settled(model, 1e-4))]);
}

/// The engines of the built-in backend, and each plugin with a device.
#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn nothing_passes_a_closed_surface_whatever_renders() {
    let engines = ["depth", "order", "claims"].map(|engine| ("wrapped-cpu", vec![format!("engine={engine}")]));
    let devices = ["gl", "vulkan", "wgpu"].map(|name| (name, Vec::new()));
    for (name, options) in engines.into_iter().chain(devices) {
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let open = || try_session(&rust(name), &options).map(|session| Box::new(session) as Box<dyn HemicubeBackend>);
        if !is_there(
            name,
            &open().map_err(|error| BackendError::Unsupported(error.to_string())),
        ) {
            continue;
        }
        for (scene, triangles) in scenes() {
            let kept = Kept::new(scene, &triangles, MOTIONS[1].1);
            for rung in [Rung::PIXEL, Rung::usual(&kept.model)] {
                let session = open().expect("it opened before");
                let found = factors_with(&kept.model, rung, session).expect("a matrix");
                assert_eq!(
                    kept.leaks(&found),
                    Vec::<String>::new(),
                    "{scene} by {name} {options:?}"
                );
            }
        }
    }
}

/// What is proved of closed spaces takes nothing from an open one: what touches the walls of a room stays in it.
#[test]
fn what_touches_the_walls_of_a_room_stays_in_sight() {
    for (way, motion) in MOTIONS {
        let kept = Kept::new("cabinet", &room_with_a_cabinet(), motion);
        let found = factors(&kept.model, Rung::usual(&kept.model)).expect("a matrix");
        assert_eq!(kept.leaks(&found), Vec::<String>::new(), "{way}");
        // The cabinet's front, at a third of the room's depth, sees the wall behind the table.
        let of_cabinet = 48 + 2 * 3..48 + 2 * 4;
        for i in of_cabinet {
            let sum: f64 = found.rows[i].iter().map(|entry| entry.1).sum();
            assert!(sum > 0.9, "{way}: the cabinet's front {i} sees {sum} of its room");
        }
        for i in 60..72 {
            let sum: f64 = found.rows[i].iter().map(|entry| entry.1).sum();
            let is_bottom = (0..2).contains(&(i - 60));
            assert!(
                sum > 0.9 || is_bottom,
                "{way}: the table's side {i} sees {sum} of its room"
            );
        }
    }
}

/// A closed body of two-sided surfaces.
fn body(low: DVec3, size: DVec3, [inside, outside]: [u32; 2]) -> impl Iterator<Item = Sided> {
    let faces = cut(box_outside(low, size), 1);
    faces.into_iter().map(move |corners| (corners, outside, Some(inside)))
}

const BOX: DVec3 = DVec3::new(1.0, 0.7, 0.5);

/// A box of two-sided surfaces on a slab of them, its floor in the plane of the slab's top.
fn box_on_a_slab() -> Vec<Sided> {
    let slab = body(DVec3::ZERO, DVec3::new(3.0, 3.0, 0.2), [1, 0]);
    slab.chain(body(DVec3::new(1.0, 1.0, 0.2), BOX, [2, 0])).collect()
}

/// By coordinates alone either of two surfaces in one plane may be above the other: the box's floor sees nothing of the
/// slab's inside, and the reference says so.
#[test]
fn what_rests_on_a_closed_body_sees_nothing_of_its_inside() {
    let scene = box_on_a_slab();
    let kept = Kept::new("box on a slab", &scene, |p| p);
    let under = |i: usize| {
        let z = scene[i / 2].0.map(|p| p.z);
        i / 2 >= 12 && i.is_multiple_of(2) && z.iter().all(|&z| z == 0.2)
    };
    let floors: Vec<usize> = (0..kept.space.len()).filter(|&i| under(i)).collect();
    assert_eq!(floors.len(), 2);
    let settings = ReferenceSettings::default();
    let reference = Reference::new(&kept.model, settings).expect("settings in range");
    for (level, rung) in levels(&kept.model) {
        let found = factors(&kept.model, rung).expect("a matrix");
        for &i in &floors {
            assert!(found.rows[i].is_empty(), "{level}: {:?}", found.rows[i]);
        }
    }
    for i in floors {
        let row = reference
            .row(InputPatch(u32::try_from(i).expect("few patches")))
            .expect("a patch");
        assert!(row.values.is_empty() && row.blocked > 0.999, "{row:?}");
    }
}

/// Of two surfaces in one plane, each space sees its own, whichever of them has the smaller number. The inside of a box
/// sees all of itself.
#[test]
fn the_inside_of_a_box_sees_its_own_floor_where_it_stands_on_another() {
    let at = DVec3::new(1.0, 1.0, 0.0);
    let floor = || {
        let corners = [(0., 0.), (3., 0.), (3., 3.), (0., 3.)].map(|(x, y)| DVec3::new(x, y, 0.0));
        facing(quad(corners).to_vec(), 0)
    };
    let on_a_floor = |n: u32| floor().chain(shell(at, BOX, n, [2, 0])).collect::<Vec<_>>();
    let before_a_floor = shell(at, BOX, 2, [2, 0]).into_iter().chain(floor());
    let mut failed = Vec::new();
    for (name, scene) in [
        ("box on a slab", box_on_a_slab()),
        ("shell on a floor", on_a_floor(1)),
        ("cut shell on a floor", on_a_floor(3)),
        ("shell before a floor", before_a_floor.collect()),
    ] {
        for (way, motion) in MOTIONS {
            let kept = Kept::new(name, &scene, motion);
            let inside = || (0..kept.space.len()).filter(|&i| kept.space[i] == 2);
            for (level, rung) in levels(&kept.model) {
                let found = factors(&kept.model, rung).expect("a matrix");
                failed.extend(
                    kept.leaks(&found)
                        .first()
                        .map(|leak| format!("{name}, {way}, {level}: {leak}")),
                );
                // Of a patch's middle, pixels add up all the same.
                for i in inside() {
                    let sum: f64 = found.rows[i].iter().map(|entry| entry.1).sum();
                    if (sum - 1.0).abs() > 0.02 {
                        failed.push(format!("{name}, {way}, {level}: row {i} sums to {sum}"));
                    }
                }
            }
            let reference = Reference::new(&kept.model, ReferenceSettings::default()).expect("settings in range");
            for i in inside().step_by(5) {
                let row = reference
                    .row(InputPatch(u32::try_from(i).expect("few patches")))
                    .expect("a patch");
                let sum: f64 = row.values.iter().sum();
                if (sum - 1.0).abs() > 0.01 || row.columns.iter().any(|&j| kept.are_apart(i, j as usize)) {
                    failed.push(format!("{name}, {way}, reference: row {i} sums to {sum}"));
                }
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// The check of leaks fails where something leaks.
#[test]
fn a_room_with_a_hole_leaks() {
    let mut shell = shell_among_plates();
    shell.retain(|(corners, ..)| corners.iter().any(|p| p.z != 1.0));
    let kept = Kept::new("open box", &shell, |p| p);
    let found = factors(&kept.model, Rung::usual(&kept.model)).expect("a matrix");
    assert!(kept.leaks(&found).iter().any(|leak| leak.starts_with("F[")));
    assert!(kept.leaks(&found).iter().any(|leak| leak.ends_with("escapes")));
}
