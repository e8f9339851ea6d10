//! What readers once dropped or bent: volume elements of second order in the orders of nodes of three programs.

use glam::DVec3;
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{ReadOptions, Scene, abaqus, gmsh, vtk};

fn list(numbers: impl IntoIterator<Item = usize>, between: &str) -> String {
    let words: Vec<String> = numbers.into_iter().map(|number| number.to_string()).collect();
    words.join(between)
}

/// Area and volume of a closed scene.
fn measures(mut scene: Scene) -> (f64, f64, usize) {
    repair(&mut scene, RepairOptions::default());
    assert_eq!(scene.ledger.losses().count(), 0, "{}", scene.ledger);
    let mut sum = DVec3::ZERO;
    let (mut area, mut volume) = (0.0, 0.0);
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.corners;
        let vector = 0.5 * (b - a).cross(c - a);
        sum += vector;
        area += vector.length();
        volume += a.dot(vector) / 3.0;
    }
    assert!(sum.length() < 1e-9, "it is not closed: {sum}");
    (area, volume, scene.triangles.len())
}

/// An element: its types in Gmsh, VTK and Abaqus, its corners, and its edges in the order of VTK and in Gmsh's.
struct Element {
    types: (u32, u32, &'static str),
    corners: &'static [[f64; 3]],
    edges: &'static [[usize; 2]],
    of_gmsh: &'static [usize],
}

const ELEMENTS: [Element; 4] = [
    Element {
        types: (11, 24, "C3D10"),
        corners: &[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]],
        edges: &[[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]],
        of_gmsh: &[0, 1, 2, 3, 5, 4],
    },
    Element {
        types: (19, 27, "C3D13"),
        corners: &[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0.5, 0.5, 1.]],
        edges: &[[0, 1], [1, 2], [2, 3], [3, 0], [0, 4], [1, 4], [2, 4], [3, 4]],
        of_gmsh: &[0, 3, 4, 1, 5, 2, 6, 7],
    },
    Element {
        types: (18, 26, "C3D15"),
        corners: &[
            [0., 0., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [1., 0., 1.],
            [0., 1., 1.],
        ],
        edges: &[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]],
        of_gmsh: &[0, 2, 6, 1, 7, 8, 3, 5, 4],
    },
    Element {
        types: (17, 25, "C3D20"),
        corners: &[
            [0., 0., 0.],
            [1., 0., 0.],
            [1., 1., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [1., 0., 1.],
            [1., 1., 1.],
            [0., 1., 1.],
        ],
        #[rustfmt::skip]
        edges: &[
            [0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7],
        ],
        of_gmsh: &[0, 3, 8, 1, 9, 2, 10, 11, 4, 7, 5, 6],
    },
];

#[test]
fn volume_elements_of_second_order_are_the_same_body_in_each_programs_order_of_nodes() {
    for element in ELEMENTS {
        let (of_gmsh, of_vtk, of_abaqus) = element.types;
        let corners: Vec<DVec3> = element
            .corners
            .iter()
            .map(|&corner| DVec3::from_array(corner))
            .collect();
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let mut bodies = Vec::new();
        for bulge in [0.0, 0.2] {
            // Each edge is pushed out by its own share, so that nodes in a wrong place would show.
            let mids = (0..).zip(element.edges).map(|(at, &[a, b])| {
                let point = 0.5 * (corners[a] + corners[b]);
                point + bulge * (1.0 + 0.05 * f64::from(at)) * (point - middle)
            });
            let nodes: Vec<DVec3> = corners.iter().copied().chain(mids).collect();
            let count = nodes.len();
            let rows = |between: &str, first: Option<usize>| -> String {
                nodes.iter().enumerate().fold(String::new(), |text, (at, node)| {
                    let number = first.map_or_else(String::new, |first| format!("{}{between}", at + first));
                    text + &format!("{number}{}{between}{}{between}{}\n", node.x, node.y, node.z)
                })
            };
            let in_gmsh = (0..corners.len()).chain(element.of_gmsh.iter().map(|&edge| corners.len() + edge));
            let mesh = format!(
                "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{count}\n{}$EndNodes\n$Elements\n1\n1 {of_gmsh} 2 1 1 {}\n\
                 $EndElements\n",
                rows(" ", Some(1)),
                list(in_gmsh.map(|at| at + 1), " ")
            );
            let grid = format!(
                "# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {count} double\n{}CELLS 1 {}\n\
                 {count} {}\nCELL_TYPES 1\n{of_vtk}\n",
                rows(" ", None),
                count + 1,
                list(0..count, " ")
            );
            // Lines of an element end with a comma where it goes on.
            let deck = format!(
                "*NODE\n{}*ELEMENT, TYPE={of_abaqus}\n1, {}\n",
                rows(", ", Some(1)),
                list(1..=count, ", ").replace(" 11,", "\n11,")
            );
            let read = |scene: Result<Scene, hemicube_scene::Error>| measures(scene.expect("a mesh"));
            let options = ReadOptions::default();
            let of_each = [
                read(gmsh::read(mesh.as_bytes(), None, options)),
                read(vtk::read(grid.as_bytes(), None, options)),
                read(abaqus::read(deck.as_bytes(), None, options)),
            ];
            for of in &of_each[1..] {
                let is_near = |a: f64, b: f64| (a - b).abs() < 1e-9;
                assert!(
                    is_near(of.0, of_each[0].0) && is_near(of.1, of_each[0].1),
                    "{of_abaqus}: {of_each:?}"
                );
            }
            bodies.push(of_each[0]);
        }
        // Straight edges cost no triangles; bulging ones add to area and volume.
        let sides = match element.corners.len() {
            4 => 4,
            5 => 6,
            6 => 8,
            _ => 12,
        };
        assert_eq!(bodies[0].2, sides, "{of_abaqus}");
        assert!(
            bodies[1].0 > bodies[0].0 && bodies[1].1 > bodies[0].1 && bodies[1].2 > sides,
            "{bodies:?}"
        );
    }
}

#[test]
fn windows_wound_against_their_wall_are_turned_with_it() {
    let point = |[x, z]: [f64; 2]| {
        format!(
            "<CartesianPoint><Coordinate>{x}</Coordinate><Coordinate>0</Coordinate><Coordinate>{z}</Coordinate>\
            </CartesianPoint>"
        )
    };
    let polygon = |points: &[[f64; 2]]| {
        let points: String = points.iter().map(|&at| point(at)).collect();
        format!("<PlanarGeometry><PolyLoop>{points}</PolyLoop></PlanarGeometry>")
    };
    let wall = polygon(&[[0., 0.], [4., 0.], [4., 3.], [0., 3.]]);
    let window = [[1., 1.], [2., 1.], [2., 2.], [1., 2.]];
    let against: Vec<[f64; 2]> = window.iter().rev().copied().collect();
    let mut found = Vec::new();
    for window in [&window[..], &against] {
        let text = format!(
            "<gbXML><Campus><Surface id=\"w\" surfaceType=\"ExteriorWall\"><AdjacentSpaceId spaceIdRef=\"A\"/>{wall}<Opening \
             id=\"o\" openingType=\"FixedWindow\">{}</Opening></Surface></Campus></gbXML>",
            polygon(window)
        );
        let scene = hemicube_scene::gbxml::read(text.as_bytes(), None, ReadOptions::default()).expect("a building");
        for triangle in &scene.triangles {
            let [a, b, c] = triangle.corners;
            assert!((b - a).cross(c - a).y > 0.0, "all face into the room");
        }
        found.push(
            scene
                .ledger
                .losses()
                .map(|(_, loss)| (loss.count, loss.area))
                .collect::<Vec<_>>(),
        );
    }
    assert_eq!(found, [vec![], vec![(1, Some(1.0))]]);
}
