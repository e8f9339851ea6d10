//! The scenes, made by rule. They are turned and moved by irrational amounts, so that no edge passes through a pixel's
//! centre by construction.

use glam::{DQuat, DVec3};
use hemicube::backend::Hemicube;
use hemicube::{HierarchyOptions, Model};
use hemicube_scene::generate::{Generate, Kind, cornell_box, generate, room};
use hemicube_scene::{Patches, Scene, Subdivision, Triangle};

/// A scene of the suite.
///
/// ```
/// use hemicube_conformance::scenes::TestScene;
///
/// let scene = TestScene::Plates;
/// let model = scene.model();
/// assert_eq!(scene.hemicubes(&model).len(), scene.hemicube_count());
/// assert!(model.patches().len() > model.patches().surfaces().len(), "plates emit on both sides");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TestScene {
    /// The closed Cornell box.
    Room,
    /// A closed convex box: every patch sees all of every other facing it.
    EmptyRoom,
    /// Rooms with doorways: nearly everything is hidden.
    Maze,
    /// Round things in a room.
    Spheres,
    /// Triangles cutting one another.
    Soup,
    /// Plates emitting on both sides, some of them crossing.
    Plates,
    /// Streets of separate buildings.
    City,
    /// More than 30,000 triangles of towers, every tenth of them given twice, with its corners in another order.
    Towers,
    /// Houses in a row. Neighbours share a wall's plane, cut differently: each sees a wall of the next house but one
    /// at the place of a back.
    Terrace,
}

impl TestScene {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Room,
        Self::EmptyRoom,
        Self::Maze,
        Self::Spheres,
        Self::Soup,
        Self::Plates,
        Self::City,
        Self::Towers,
        Self::Terrace,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Room => "room",
            Self::EmptyRoom => "empty-room",
            Self::Maze => "maze",
            Self::Spheres => "spheres",
            Self::Soup => "soup",
            Self::Plates => "plates",
            Self::City => "city",
            Self::Towers => "towers",
            Self::Terrace => "terrace",
        }
    }

    /// The scene, made ready.
    ///
    /// # Panics
    /// Never: the scenes are given.
    pub fn model(self) -> Model {
        let generated = |kind, target_patches| {
            let seed = 1;
            generate(Generate {
                kind,
                target_patches,
                seed,
            })
            .expect("a target in range")
        };
        let scene = match self {
            Self::Room => room(4).expect("a room in range"),
            Self::EmptyRoom => convex_box(),
            Self::Maze => generated(Kind::Maze, 900),
            Self::Spheres => generated(Kind::Spheres, 1200),
            Self::Soup => generated(Kind::Soup, 600),
            Self::Plates => plates(),
            Self::City => generated(Kind::City, 2000),
            Self::Towers => with_duplicates(generated(Kind::BlockCity, 31_000)),
            Self::Terrace => terrace(),
        };
        let patches = Patches::new(&moved(scene), Subdivision::None).expect("a scene that fits");
        Model::new(patches.into(), HierarchyOptions::default()).expect("a scene with an extent")
    }

    /// Number of its hemicubes to render.
    pub fn hemicube_count(self) -> usize {
        if self == Self::Towers { 10 } else { 20 }
    }

    /// Hemicubes evenly through the order of work.
    pub fn hemicubes(self, model: &Model) -> Vec<Hemicube> {
        let order: Vec<_> = model.order().collect();
        let count = self.hemicube_count().min(order.len());
        (0..count)
            .flat_map(|k| model.hemicubes(order[k * order.len() / count], 1, true))
            .collect()
    }
}

/// Turns and moves a scene, so that nothing is aligned.
fn moved(mut scene: Scene) -> Scene {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, std::f64::consts::SQRT_2, 0.3).normalize(), 0.7);
    let offset = DVec3::new(std::f64::consts::E, -std::f64::consts::PI, std::f64::consts::SQRT_2);
    for corner in scene.triangles.iter_mut().flat_map(|triangle| &mut triangle.corners) {
        *corner = turn * *corner + offset;
    }
    scene
}

fn of_triangles(triangles: Vec<Triangle>) -> Scene {
    Scene {
        triangles,
        ..cornell_box()
    }
}

fn triangle(corners: [DVec3; 3], two_sided: bool) -> Triangle {
    Triangle {
        corners,
        two_sided,
        ..cornell_box().triangles[0]
    }
}

/// The inside of a box of 1 × 2 × 1.5, each face cut into 5 × 5 squares.
fn convex_box() -> Scene {
    let size = DVec3::new(1.0, 2.0, 1.5);
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for high in [false, true] {
            let at = |i: u32, j: u32| {
                let mut point = DVec3::ZERO;
                point[axis] = if high { size[axis] } else { 0.0 };
                point[u] = size[u] * f64::from(i) / 5.0;
                point[v] = size[v] * f64::from(j) / 5.0;
                point
            };
            for (i, j) in (0..25).map(|k| (k / 5, k % 5)) {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                // Seen from inside: the lower face looks up its axis, the upper one down.
                let halves = if high {
                    [[a, c, b], [a, d, c]]
                } else {
                    [[a, b, c], [a, c, d]]
                };
                triangles.extend(halves.map(|corners| triangle(corners, false)));
            }
        }
    }
    of_triangles(triangles)
}

/// Four plates above each other, and two crossing them.
fn plates() -> Scene {
    let mut triangles = Vec::new();
    let mut plate = |origin: DVec3, u: DVec3, v: DVec3| {
        let at = |i: u32, j: u32| origin + u * (f64::from(i) / 6.0) + v * (f64::from(j) / 6.0);
        for (i, j) in (0..36).map(|k| (k / 6, k % 6)) {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]].map(|corners| triangle(corners, true)));
        }
    };
    for k in 0..4 {
        plate(DVec3::new(0.0, 0.0, 0.3 * f64::from(k)), DVec3::X, DVec3::Y);
    }
    plate(DVec3::new(0.21, -0.1, -0.2), DVec3::new(0.1, 0.0, 1.4), DVec3::Y);
    plate(DVec3::new(-0.1, 0.63, -0.1), DVec3::X, DVec3::new(0.0, 0.2, 1.2));
    of_triangles(triangles)
}

/// Eight houses of unlike heights, side by side along x; faces of each cut into 3 × 3 to 5 × 5 rectangles.
fn terrace() -> Scene {
    let mut triangles = Vec::new();
    for house in 0..8u32 {
        let low = DVec3::X * f64::from(house);
        let size = DVec3::new(1.0, 1.5, 1.0 + 0.4 * f64::from(house * 5 % 8));
        let pieces = 3 + house % 3;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for is_high in [false, true] {
                let at = |i: u32, j: u32| {
                    let mut point = DVec3::ZERO;
                    point[axis] = if is_high { size[axis] } else { 0.0 };
                    point[u] = size[u] * f64::from(i) / f64::from(pieces);
                    point[v] = size[v] * f64::from(j) / f64::from(pieces);
                    low + point
                };
                for (i, j) in (0..pieces * pieces).map(|k| (k / pieces, k % pieces)) {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    // Seen from outside: the upper face looks up its axis, the lower one down.
                    let halves = if is_high {
                        [[a, b, c], [a, c, d]]
                    } else {
                        [[a, c, b], [a, d, c]]
                    };
                    triangles.extend(halves.map(|corners| triangle(corners, false)));
                }
            }
        }
    }
    of_triangles(triangles)
}

/// Every tenth triangle twice, the second time beginning with another corner.
fn with_duplicates(mut scene: Scene) -> Scene {
    let again: Vec<Triangle> = scene.triangles.iter().step_by(10).cloned().collect();
    scene.triangles.extend(again.into_iter().map(|mut triangle| {
        triangle.corners.rotate_left(1);
        triangle
    }));
    scene
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_what_they_say() {
        for scene in TestScene::ALL {
            let model = scene.model();
            let hemicubes = scene.hemicubes(&model);
            assert!(hemicubes.len() >= 10, "{}", scene.name());
            match scene {
                TestScene::Towers => assert!(model.geometry().surfaces.len() >= 33_000),
                TestScene::Plates => assert_eq!(
                    model.geometry().patch_count as usize,
                    2 * model.geometry().surfaces.len()
                ),
                _ => assert!(model.geometry().surfaces.len() >= 250, "{}", scene.name()),
            }
        }
    }
}
