//! Nothing of a file is lost in silence: what is not taken as the file says is a warning of the command that was asked,
//! and files with one thing changed each, of every format, give the right scene, or say what was lost.

use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Fate, ReadOptions, Scene};
use hemicube_tests::runs::{Place, Ran};
use hemicube_tests::scenes::say;
use serde_json::Value;
use std::fmt::Write as _;

/// The corners of a unit cube, and its faces wound inwards.
const CORNERS: [[f64; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 1.0],
    [1.0, 1.0, 1.0],
    [0.0, 1.0, 1.0],
];
const FACES: [(&str, [usize; 4]); 6] = [
    ("floor", [0, 1, 2, 3]),
    ("ceiling", [4, 7, 6, 5]),
    ("south", [0, 4, 5, 1]),
    ("north", [3, 2, 6, 7]),
    ("west", [0, 3, 7, 4]),
    ("east", [1, 5, 6, 2]),
];

fn joined<T: ToString>(all: impl IntoIterator<Item = T>, between: &str) -> String {
    all.into_iter()
        .map(|one| one.to_string())
        .collect::<Vec<_>>()
        .join(between)
}

fn lines(rows: impl IntoIterator<Item = String>) -> String {
    rows.into_iter().fold(String::new(), |text, row| text + &row + "\n")
}

fn vertices(between: &str) -> Vec<String> {
    CORNERS.iter().map(|corner| joined(corner, between)).collect()
}

fn obj() -> String {
    let faces = FACES
        .iter()
        .map(|(name, face)| format!("o {name}\nf {}", joined(face.map(|at| at + 1), " ")));
    lines(vertices(" ").into_iter().map(|vertex| format!("v {vertex}"))) + &lines(faces)
}

fn stl() -> String {
    let facet = |at: [usize; 3]| {
        let corners = lines(at.iter().map(|&at| format!("vertex {}", joined(CORNERS[at], " "))));
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let solid = |&(name, [a, b, c, d]): &(&str, [usize; 4])| {
        format!(
            "solid {name}\n{}{}endsolid {name}\n",
            facet([a, b, c]),
            facet([a, c, d])
        )
    };
    FACES.iter().map(solid).collect()
}

fn ply() -> String {
    let head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
        element face 6\nproperty list uchar int vertex_indices\nend_header\n";
    let faces = FACES.iter().map(|(_, face)| format!("4 {}", joined(face, " ")));
    head.to_owned() + &lines(vertices(" ")) + &lines(faces)
}

fn ac3d() -> String {
    let mut text =
        "AC3Db\nMATERIAL \"m\" rgb 1 1 1 amb 0 0 0 emis 0 0 0 spec 0 0 0 shi 0 trans 0\nOBJECT world\nkids 6\n"
            .to_owned();
    for (name, face) in FACES {
        let corners = lines(face.iter().map(|&at| joined(CORNERS[at], " ")));
        let _ = write!(
            text,
            "OBJECT poly\nname \"{name}\"\nnumvert 4\n{corners}numsurf 1\nSURF 0x0\nmat 0\nrefs 4\n0 0 0\n1 0 0\n2 0 0\n3 0 \
             0\nkids 0\n"
        );
    }
    text
}

fn view3d() -> String {
    let corners = (1..).zip(vertices(" ")).map(|(at, vertex)| format!("V {at} {vertex}"));
    let faces = (1..)
        .zip(FACES)
        .map(|(at, (name, face))| format!("S {at} {} 0 0 0.9 {name}", joined(face.map(|at| at + 1), " ")));
    format!("T cube\nF 3\n{}{}E\n", lines(corners), lines(faces))
}

fn city() -> String {
    let faces = FACES.iter().map(|(_, face)| format!("[[{}]]", joined(face, ",")));
    format!(
        r#"{{"type":"CityJSON","version":"2.0","transform":{{"scale":[1,1,1],"translate":[0,0,0]}},"CityObjects":{{"room":
        {{"type":"Building","geometry":[{{"type":"MultiSurface","lod":"2","boundaries":[{}]}}]}}}},"vertices":[{}]}}"#,
        joined(faces, ","),
        joined(vertices(",").iter().map(|vertex| format!("[{vertex}]")), ",")
    )
}

fn names_of_gmsh() -> String {
    let names = (1..).zip(FACES).map(|(at, (name, _))| format!("2 {at} \"{name}\""));
    format!("$PhysicalNames\n6\n{}$EndPhysicalNames\n", lines(names))
}

fn gmsh2() -> String {
    let nodes = (1..).zip(vertices(" ")).map(|(at, vertex)| format!("{at} {vertex}"));
    let faces = (1..)
        .zip(FACES)
        .map(|(at, (_, face))| format!("{at} 3 2 {at} {at} {}", joined(face.map(|at| at + 1), " ")));
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{}$Nodes\n8\n{}$EndNodes\n$Elements\n6\n{}$EndElements\n",
        names_of_gmsh(),
        lines(nodes),
        lines(faces)
    )
}

fn gmsh4() -> String {
    let entities = (1..7).map(|at| format!("{at} 0 0 0 1 1 1 1 {at} 0"));
    let faces = (1..)
        .zip(FACES)
        .map(|(at, (_, face))| format!("2 {at} 3 1\n{at} {}", joined(face.map(|at| at + 1), " ")));
    format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{}$Entities\n0 0 6 0\n{}$EndEntities\n$Nodes\n1 8 1 8\n2 1 0 8\n{}{}$EndNodes\n\
         $Elements\n6 6 1 6\n{}$EndElements\n",
        names_of_gmsh(),
        lines(entities),
        lines((1..9).map(|at| at.to_string())),
        lines(vertices(" ")),
        lines(faces)
    )
}

fn vtk() -> String {
    let faces = FACES.iter().map(|(_, face)| format!("4 {}", joined(face, " ")));
    format!(
        "# vtk DataFile Version 3.0\ncube\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n{}CELLS 6 30\n{}CELL_TYPES \
         6\n9\n9\n9\n9\n9\n9\nCELL_DATA 6\nSCALARS zone int 1\nLOOKUP_TABLE default\n0 1 2 3 4 5\n",
        lines(vertices(" ")),
        lines(faces)
    )
}

fn vtu() -> String {
    format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\"><UnstructuredGrid><Piece \
         NumberOfPoints=\"8\" NumberOfCells=\"6\"><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" \
         format=\"ascii\">{}</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\" \
         format=\"ascii\">{}</DataArray><DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">4 8 12 16 20 \
         24</DataArray><DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">9 9 9 9 9 \
         9</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>",
        joined(vertices(" "), " "),
        joined(FACES.iter().map(|(_, face)| joined(face, " ")), " ")
    )
}

fn abaqus() -> String {
    let nodes = (1..).zip(vertices(", ")).map(|(at, vertex)| format!("{at}, {vertex}"));
    let faces = (1..).zip(FACES).map(|(at, (name, face))| {
        format!(
            "*ELEMENT, TYPE=S4, ELSET={name}\n{at}, {}",
            joined(face.map(|at| at + 1), ", ")
        )
    });
    format!("*NODE\n{}{}", lines(nodes), lines(faces))
}

/// The faces wound outwards, as buildings have them.
fn outward() -> impl Iterator<Item = (&'static str, [usize; 4])> {
    FACES.iter().map(|&(name, [a, b, c, d])| (name, [d, c, b, a]))
}

fn idf() -> String {
    let faces = outward().map(|(name, face)| {
        let kind = match name {
            "floor" => "Floor",
            "ceiling" => "Roof",
            _ => "Wall",
        };
        let corners = joined(face.map(|at| joined(CORNERS[at], ",")), ", ");
        format!("BuildingSurface:Detailed,{name},{kind},C,Z,,Outdoors,,SunExposed,WindExposed,,4,{corners};")
    });
    format!(
        "GlobalGeometryRules,UpperLeftCorner,Counterclockwise,World;\nZone,Z,0,0,0,0,1,1;\n{}",
        lines(faces)
    )
}

fn epjson() -> String {
    let faces = outward().map(|(name, face)| {
        let corner = |at: usize| {
            let [x, y, z] = CORNERS[at];
            format!(r#"{{"vertex_x_coordinate":{x},"vertex_y_coordinate":{y},"vertex_z_coordinate":{z}}}"#)
        };
        format!(
            r#""{name}":{{"construction_name":"C","zone_name":"Z","surface_type":"Wall","vertices":[{}]}}"#,
            joined(face.map(corner), ",")
        )
    });
    format!(
        r#"{{"GlobalGeometryRules":{{"r":{{"vertex_entry_direction":"Counterclockwise","coordinate_system":"World"}}}},
        "Zone":{{"Z":{{}}}},"BuildingSurface:Detailed":{{{}}}}}"#,
        joined(faces, ",\n")
    )
}

fn gbxml() -> String {
    let faces = outward().map(|(name, face)| {
        let point = |at: usize| {
            let numbers = CORNERS[at].map(|x| format!("<Coordinate>{x}</Coordinate>"));
            format!("<CartesianPoint>{}</CartesianPoint>", joined(numbers, ""))
        };
        format!(
            "<Surface id=\"{name}\" surfaceType=\"ExteriorWall\"><AdjacentSpaceId spaceIdRef=\"A\"/><PlanarGeometry>\
             <PolyLoop>{}</PolyLoop></PlanarGeometry></Surface>",
            joined(face.map(point), "")
        )
    });
    format!(
        "<gbXML lengthUnit=\"Meters\"><Campus>\n{}</Campus></gbXML>",
        lines(faces)
    )
}

/// Base64 of a number of bytes that three divides.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letter = |bits: u32| char::from(LETTERS[(bits & 63) as usize]);
    let (threes, rest) = bytes.as_chunks::<3>();
    assert!(rest.is_empty());
    let four = |three: &[u8; 3]| {
        let bits = three.iter().fold(0, |bits, &byte| bits << 8 | u32::from(byte));
        [18, 12, 6, 0].map(|shift| letter(bits >> shift))
    };
    threes.iter().flat_map(four).collect()
}

fn gltf() -> String {
    let mut bytes: Vec<u8> = Vec::new();
    for (_, [a, b, c, d]) in FACES {
        for at in [a, b, c, a, c, d] {
            #[allow(clippy::cast_possible_truncation, reason = "corners of a unit cube")]
            bytes.extend(CORNERS[at].iter().flat_map(|&x| (x as f32).to_le_bytes()));
        }
    }
    let data = base64(&bytes);
    let list = |of: &dyn Fn(usize) -> String| joined((0..6).map(of), ",");
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1,2,3,4,5]}}],"nodes":[{}],"meshes":[{}],
        "accessors":[{}],"bufferViews":[{{"buffer":0,"byteLength":432}}],
        "buffers":[{{"byteLength":432,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#,
        list(&|at| format!(r#"{{"name":"{}","mesh":{at}}}"#, FACES[at].0)),
        list(&|at| format!(r#"{{"primitives":[{{"attributes":{{"POSITION":{at}}}}}]}}"#)),
        list(&|at| format!(
            r#"{{"bufferView":0,"byteOffset":{},"componentType":5126,"count":6,"type":"VEC3"}}"#,
            72 * at
        )),
    )
}

/// A change of a file: what is replaced once, and by what. An empty first part stands for the end.
type Change = (&'static str, &'static str, &'static str);

/// All formats: the file's name, its text, and what is changed in it.
fn formats() -> Vec<(&'static str, String, Vec<Change>)> {
    let quad = "<PolyLoop><CartesianPoint><Coordinate>0</Coordinate><Coordinate>0</Coordinate><Coordinate>0</Coordinate>\
        </CartesianPoint><CartesianPoint><Coordinate>0</Coordinate><Coordinate>1</Coordinate><Coordinate>0</Coordinate>\
        </CartesianPoint><CartesianPoint><Coordinate>1</Coordinate><Coordinate>1</Coordinate><Coordinate>0</Coordinate>\
        </CartesianPoint></PolyLoop></PlanarGeometry>";
    vec![
        (
            "cube.obj",
            obj(),
            vec![
                ("a face doubled from another corner", "", "o again\nf 2 3 4 1\n"),
                ("a face doubled", "", "o again\nf 1 2 3 4\n"),
                ("a statement renamed", "f 1 2", "fc 1 2"),
                ("a face made a free-form surface", "f 1 2 3 4", "surf 0 1 0 1 1 2 3 4"),
                ("a face that crosses itself", "f 1 2 3 4", "f 1 3 2 4"),
                ("a face in another file", "f 1 2 3 4", "call floor.obj"),
                ("a line joined with a blank after it", "v 0 1 0\n", "v 0 1 \\ \n 0\n"),
                ("a face of two corners", "f 1 2 3 4", "f 1 2"),
                ("a face on a line", "f 1 2 3 4", "f 1 2 1 2"),
                ("a corner far off", "v 1 1 1\n", "v 1 1 1e20\n"),
            ],
        ),
        (
            "cube.stl",
            stl(),
            vec![
                ("solids of one name", "solid ceiling", "solid floor"),
                ("solids without names", "solid ceiling", "solid"),
                (
                    "a facet against its normal",
                    "facet normal 0 0 0",
                    "facet normal 0 0 -1",
                ),
                ("a keyword renamed", "outer loop", "outer lop\nfacet"),
                ("a corner left out", "vertex 1 0 0\n", ""),
                (
                    "a solid repeated",
                    "",
                    "solid more\nfacet normal 0 0 0\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 0 \
              0\nendloop\nendfacet\nendsolid\n",
                ),
            ],
        ),
        (
            "cube.ply",
            ply(),
            vec![
                ("the faces' element renamed", "element face", "element faces"),
                ("the faces' list renamed", "vertex_indices", "vertex_indexes"),
                ("the faces made another element", "element face", "element polygons"),
                ("a face doubled", "4 1 5 6 2\n", "4 1 5 6 2\n4 6 2 1 5\n"),
                ("a face that crosses itself", "4 0 1 2 3", "4 0 2 1 3"),
                ("a corner more than the list has", "4 0 1 2 3", "3 0 1 2 3"),
                ("a face more than the header has", "element face 6", "element face 5"),
                ("a coordinate renamed", "property float z", "property float height"),
            ],
        ),
        (
            "cube.ac",
            ac3d(),
            vec![
                ("a surface of an unknown type", "SURF 0x0", "SURF 0x7"),
                ("a surface without corners", "refs 4\n0 0 0\n1 0 0\n2 0 0\n3 0 0\n", ""),
                ("surfaces promised", "numsurf 1", "numsurf 2"),
                ("an object of an unknown type", "OBJECT poly", "OBJECT mesh"),
                ("a keyword renamed", "SURF 0x0", "SURFACE 0x0"),
            ],
        ),
        (
            "cube.vs3",
            view3d(),
            vec![
                ("an element renamed", "S 6 ", "Z 6 "),
                ("a surface cut out of itself", "S 1 1 2 3 4 0", "S 1 1 2 3 4 1"),
                ("a surface doubled", "E\n", "S 7 2 3 4 1 0 0 0.9 again\nE\n"),
            ],
        ),
        (
            "cube.city.json",
            city(),
            vec![
                ("the geometry renamed", "\"geometry\"", "\"geometrie\""),
                ("a geometry of another type", "MultiSurface", "MultiSurfaces"),
                ("the transform left out", "\"transform\"", "\"transformed\""),
                ("a surface doubled", "[[0,1,2,3]]", "[[0,1,2,3]],[[1,2,3,0]]"),
                ("a surface that crosses itself", "[[0,1,2,3]]", "[[0,2,1,3]]"),
                ("a surface on a line", "[[0,1,2,3]]", "[[0,1,0,1]]"),
                ("a surface of two corners", "[[0,1,2,3]]", "[[0,1]]"),
            ],
        ),
        (
            "cube2.msh",
            gmsh2(),
            vec![
                ("an element made a line", "1 3 2 1 1", "1 1 2 1 1"),
                ("an order raised", "1 3 2 1 1", "1 16 2 1 1"),
                (
                    "an element in a second group",
                    "$Elements\n6\n",
                    "$Elements\n7\n7 3 2 2 1 1 2 3 4\n",
                ),
                (
                    "an element doubled from another node",
                    "$Elements\n6\n",
                    "$Elements\n7\n7 3 2 1 1 2 3 4 1\n",
                ),
                ("the names renamed", "$PhysicalNames", "$PhysicalName"),
                ("the nodes renamed", "$Nodes", "$Node"),
                ("the elements renamed", "$Elements", "$Element"),
            ],
        ),
        (
            "cube4.msh",
            gmsh4(),
            vec![
                ("an element made triangles", "2 1 3 1\n", "2 1 2 1\n"),
                ("a second group", "1 0 0 0 1 1 1 1 1 0", "1 0 0 0 1 1 1 2 1 2 0"),
                ("a section renamed", "$Elements", "$Elemente"),
            ],
        ),
        (
            "cube.vtk",
            vtk(),
            vec![
                ("a cell made a line", "CELL_TYPES 6\n9", "CELL_TYPES 6\n3"),
                ("a cell made a triangle", "CELL_TYPES 6\n9", "CELL_TYPES 6\n5"),
                ("a cell made a tetrahedron", "CELL_TYPES 6\n9", "CELL_TYPES 6\n10"),
                ("a cell made a pixel", "CELL_TYPES 6\n9", "CELL_TYPES 6\n8"),
                ("a cell of an unknown type", "CELL_TYPES 6\n9", "CELL_TYPES 6\n60"),
                ("an order raised", "CELL_TYPES 6\n9", "CELL_TYPES 6\n23"),
            ],
        ),
        (
            "cube.vtu",
            vtu(),
            vec![
                ("a cell made a polyhedron", ">9 9", ">42 9"),
                ("a cell of Lagrange's form", ">9 9", ">70 9"),
                ("the types renamed", "\"types\"", "\"type\""),
                ("a cell made a line", ">9 9", ">3 9"),
            ],
        ),
        (
            "cube.inp",
            abaqus(),
            vec![
                (
                    "an element type changed",
                    "TYPE=S4, ELSET=floor",
                    "TYPE=B31, ELSET=floor",
                ),
                (
                    "an element type with fewer nodes",
                    "TYPE=S4, ELSET=floor",
                    "TYPE=S3, ELSET=floor",
                ),
                ("an order raised", "TYPE=S4, ELSET=floor", "TYPE=S8, ELSET=floor"),
                ("a keyword renamed", "*ELEMENT", "*ELEMENTS"),
                (
                    "a set repeated",
                    "",
                    "*ELSET, ELSET=warm\n1, 2\n*ELSET, ELSET=lower\n1\n",
                ),
                (
                    "an element doubled",
                    "",
                    "*ELEMENT, TYPE=S4, ELSET=again\n7, 2, 3, 4, 1\n",
                ),
            ],
        ),
        (
            "cube.idf",
            idf(),
            vec![
                (
                    "a class renamed",
                    "BuildingSurface:Detailed,east",
                    "BuildingSurface:Detail,east",
                ),
                ("a surface of air", "west,Wall,C", "west,Wall,Open"),
                ("two surfaces of one name", "Detailed,west", "Detailed,east"),
                ("shading without corners", "", "Shading:Overhang,o,west,0,90,0,0,1;\n"),
                (
                    "a window against its wall",
                    "",
                    "FenestrationSurface:Detailed,w,Window,G,east,,,,,4,1,.2,.2,1,.2,.8,1,.8,.8,1,\
              .8,.2;\n",
                ),
            ],
        ),
        (
            "cube.epJSON",
            epjson(),
            vec![
                (
                    "a class renamed",
                    "BuildingSurface:Detailed",
                    "BuildingSurface:Detailled",
                ),
                ("corners renamed", "\"vertices\"", "\"vertexes\""),
            ],
        ),
        (
            "cube.gbxml",
            gbxml(),
            vec![
                ("a surface renamed", "<Surface id=\"floor\"", "<Surfaces id=\"floor\""),
                ("a wall of no space", "<AdjacentSpaceId", "<AdjacentSpace"),
                ("a second loop", "</PolyLoop></PlanarGeometry>", "</PolyLoop>SECOND"),
                ("a surface listed for another room", "</Campus>", "AGAIN</Campus>"),
            ],
        ),
        (
            "cube.gltf",
            gltf(),
            vec![
                ("a mesh not placed", r#""mesh":0"#, r#""meshes":0"#),
                ("half a triangle", r#""count":6"#, r#""count":5"#),
                (
                    "a mesh placed twice",
                    r#"{"name":"floor","mesh":0}"#,
                    r#"{"name":"floor","mesh":0,"extensions":
              {"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}"#,
                ),
                ("positions renamed", "\"POSITION\":0", "\"POSITIONS\":0"),
            ],
        ),
    ]
    .into_iter()
    .map(|(name, text, changes)| {
        let changes = changes.into_iter().map(|(what, from, to)| match to {
            "</PolyLoop>SECOND" => (what, from, &*format!("</PolyLoop>{quad}").leak()),
            "AGAIN</Campus>" => {
                let floor = text
                    .lines()
                    .find(|line| line.contains("id=\"floor\""))
                    .expect("a floor");
                // From another corner: the first point goes to the end.
                let begin = floor.find("<CartesianPoint>").expect("a point");
                let end =
                    floor[begin..].find("</CartesianPoint>").expect("its end") + begin + "</CartesianPoint>".len();
                let turned = floor[..begin].to_owned()
                    + &floor[end..].replace("</PolyLoop>", &format!("{}</PolyLoop>", &floor[begin..end]));
                (
                    what,
                    from,
                    &*format!("{}\n</Campus>", turned.replace("id=\"floor\"", "id=\"again\"")).leak(),
                )
            }
            _ => (what, from, to),
        });
        (name, text.clone(), changes.collect())
    })
    .collect()
}

/// Returns whether a scene is the cube: area 1 in each of its planes, facing inwards, and nothing else.
fn is_cube(scene: &Scene) -> bool {
    let mut areas = [0.0; 6];
    let mut whole = 0.0;
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.corners;
        let area = 0.5 * (b - a).cross(c - a);
        whole += area.length() * if triangle.two_sided { 2.0 } else { 1.0 };
        for axis in 0..3 {
            for (side, place) in [(0, 0.0), (1, 1.0)] {
                let inward = if side == 0 { 1.0 } else { -1.0 };
                if triangle
                    .corners
                    .iter()
                    .all(|corner| (corner[axis] - place).abs() < 1e-9)
                {
                    areas[2 * axis + side] += inward * area[axis];
                }
            }
        }
    }
    areas.iter().all(|area| (area - 1.0_f64).abs() < 1e-9) && (whole - 6.0).abs() < 1e-9
}

/// Changes that name or group surfaces otherwise, so that their objects have other names, as the file then says.
const OTHER_NAMES: [&str; 3] = ["solids without names", "an element in a second group", "a set repeated"];

/// What became of a changed file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    /// The scene is the cube, and its objects have their names.
    Right,
    /// Exit 2, and an error that names the file.
    Refused,
    /// A warning of the ledger: one that says what became of what.
    Warned,
    /// None of these.
    Silent,
}

/// A file read and repaired.
fn scene_of(place: &Place, name: &str) -> Option<Scene> {
    let mut scene = hemicube_scene::load(&place.path(name), ReadOptions::default()).ok()?;
    repair(&mut scene, RepairOptions::default());
    Some(scene)
}

/// Whether a line on standard error names a loss. Warnings of rows, of winding and of empty matrices do not.
fn names_a_loss(line: &str, scene: Option<&Scene>) -> bool {
    let Some(text) = line.strip_prefix("warning: ") else {
        return false;
    };
    let has_fate = |fate: &Fate| {
        text.strip_prefix(fate.name())
            .is_some_and(|rest| rest.starts_with(": "))
    };
    Fate::ALL.iter().filter(|fate| **fate != Fate::Noted).any(has_fate)
        || scene.is_some_and(|scene| scene.ledger.warnings.iter().any(|sentence| sentence == text))
}

/// Judges what `compute` says of a file by the names that the cube's objects should have, or by its surfaces alone.
fn outcome(place: &Place, name: &str, objects: Option<&[String]>) -> Outcome {
    let ran = place.line(&format!("compute {name} -o m --overwrite"));
    let scene = scene_of(place, name);
    let is_right = |scene: &Scene| is_cube(scene) && objects.is_none_or(|objects| scene.objects == objects);
    if ran.code == Some(2) && ran.err.contains(&format!("error: {name}:")) {
        Outcome::Refused
    } else if ran.err.lines().any(|line| names_a_loss(line, scene.as_ref())) {
        Outcome::Warned
    } else if ran.code == Some(0) && scene.is_some_and(|scene| is_right(&scene)) {
        Outcome::Right
    } else {
        Outcome::Silent
    }
}

#[test]
fn sixty_changed_files_give_the_right_scene_or_say_what_was_lost() {
    let place = Place::new();
    let mut outcomes = Vec::new();
    for (name, text, changes) in formats() {
        place.write(name, &text);
        let whole = scene_of(&place, name).unwrap_or_else(|| panic!("{name} is not read"));
        assert!(
            is_cube(&whole) && whole.ledger.losses().count() == 0,
            "{name}: {}",
            whole.ledger
        );
        let unchanged = place.line(&format!("compute {name} -o whole --overwrite")).is(0);
        assert!(!unchanged.err.contains("warning"), "{name}: {}", unchanged.err);
        for (what, from, to) in changes {
            let changed = if from.is_empty() {
                text.clone() + to
            } else {
                text.replacen(from, to, 1)
            };
            assert_ne!(changed, text, "{name}: {what}");
            place.write(name, &changed);
            let objects = (!OTHER_NAMES.contains(&what)).then_some(whole.objects.as_slice());
            outcomes.push((outcome(&place, name, objects), format!("{name}: {what}")));
        }
    }
    let count = |of: Outcome| outcomes.iter().filter(|(found, _)| *found == of).count();
    say(&format!(
        "{} changed files: {} right, {} refused, {} warned of, {} silent",
        outcomes.len(),
        count(Outcome::Right),
        count(Outcome::Refused),
        count(Outcome::Warned),
        count(Outcome::Silent)
    ));
    assert!(outcomes.len() >= 60, "{}", outcomes.len());
    outcomes.retain(|(found, _)| *found == Outcome::Silent);
    assert!(outcomes.is_empty(), "silent losses: {outcomes:#?}");
}

/// Words of a text that are no names that a user gave, each where it first stands.
fn keywords(text: &str) -> Vec<std::ops::Range<usize>> {
    let data = text.find("base64,").map(|from| {
        let length = text[from..].find('"').unwrap_or(text.len() - from);
        from..from + length
    });
    let is_letter = |at: usize| text.as_bytes().get(at).is_some_and(|byte| byte.is_ascii_alphabetic());
    let is_inner = |at: usize| text.as_bytes().get(at).is_some_and(|byte| byte.is_ascii_alphanumeric());
    let mut seen = std::collections::BTreeSet::new();
    let mut found = Vec::new();
    let mut at = 0;
    while at < text.len() {
        let begins = is_letter(at) && (at == 0 || !is_inner(at - 1));
        let mut end = at + 1;
        while begins && is_letter(end) {
            end += 1;
        }
        let word = at..end;
        at = end;
        let is_data = data.as_ref().is_some_and(|data| data.contains(&word.start));
        let is_name = FACES.iter().any(|(name, _)| *name == &text[word.clone()]);
        if begins && !is_data && !is_name && seen.insert(&text[word.clone()]) {
            found.push(word);
        }
    }
    found
}

#[test]
fn no_word_of_a_file_is_passed_over_where_it_matters() {
    let place = Place::new();
    let (mut count, mut silent) = (0, Vec::new());
    for (name, text, _) in formats() {
        let mut changed: Vec<(String, String)> = Vec::new();
        for word in keywords(&text) {
            let (before, rest) = text.split_at(word.end);
            changed.push((format!("`{}` renamed", &text[word]), format!("{before}x{rest}")));
        }
        let rows: Vec<&str> = text.lines().collect();
        for at in (0..rows.len()).filter(|_| rows.len() > 1) {
            let twice = [&rows[..=at], &rows[at..]].concat().join("\n") + "\n";
            changed.push((format!("line {} twice: {}", at + 1, rows[at]), twice));
        }
        for (what, text) in changed {
            place.write(name, &text);
            count += 1;
            let is_said = |scene: &Scene| scene.ledger.losses().count() > 0 || !scene.ledger.warnings.is_empty();
            if scene_of(&place, name).is_some_and(|scene| !is_cube(&scene) && !is_said(&scene)) {
                silent.push(format!("{name}: {what}"));
            }
        }
    }
    say(&format!("{count} changed files: {} silent", silent.len()));
    assert!(count > 600, "{count}");
    assert!(silent.is_empty(), "silent losses: {silent:#?}");
}

#[test]
fn a_silent_loss_would_be_found() {
    // A cube that lacks its floor, one with a double, and one wound outwards are no cube.
    let read = |text: &str| hemicube_scene::obj::read(text.as_bytes(), None, ReadOptions::default()).expect("an OBJ");
    assert!(is_cube(&read(&obj())));
    assert!(!is_cube(&read(&obj().replace("f 1 2 3 4", "l 1 2 3 4"))));
    assert!(!is_cube(&read(&(obj() + "f 1 2 3 4\n"))));
    assert!(!is_cube(&read(&obj().replace("f 1 2 3 4", "f 4 3 2 1"))));
    // What a file lacks altogether stands for what a reader passes over: a face, a name, the sense of a wall, of which
    // `compute` warns by the rows.
    let place = Place::new();
    let whole = read(&obj());
    let of = |text: String| {
        place.write("cube.obj", text);
        outcome(&place, "cube.obj", Some(&whole.objects))
    };
    assert_eq!(of(obj()), Outcome::Right);
    assert_eq!(of(obj().replace("f 1 2 3 4\n", "")), Outcome::Silent);
    assert_eq!(of(obj().replace("o floor\n", "")), Outcome::Silent);
    assert_eq!(of(obj().replace("f 1 2 3 4", "f 4 3 2 1")), Outcome::Silent);
    assert!(
        place
            .line("compute cube.obj -o m --overwrite")
            .err
            .contains("warning: ")
    );
    assert_eq!(of(obj().replace("f 1 2 3 4", "f 1 2 3 99")), Outcome::Refused);
    assert_eq!(of(obj() + "f 1 2 3 4\n"), Outcome::Warned);
    assert!(keywords("v 1 vt v").len() == 2 && keywords("floor f1 \"base64,AB\"").len() == 1);
}

fn compute(place: &Place, scene: &str) -> Ran {
    place.line(&format!("compute {scene} -o m --overwrite")).is(0)
}

#[test]
fn losses_are_said_by_each_command_kept_with_the_matrix_and_repeated_by_check() {
    let place = Place::new();
    place.write("cube.obj", obj() + "o again\nf 2 3 4 1\n");
    let words = ["merged: 1 × face in the very place of another", "`again`, face 6"];
    compute(&place, "cube.obj").says(&words);
    place.line("sky cube.obj --up z -o sky.npz").says(&words);
    place.line("inspect cube.obj").is(0).says(&words);
    let inspected = place.line("inspect cube.obj --json").is(0).json();
    assert_eq!(inspected["losses"][0]["fate"], "merged");
    let checked = place.line("check m").is(0);
    assert!(checked.out.contains(words[0]), "{}", checked.out);
    let data = place.line("check m --json").json();
    assert_eq!(
        (&data["losses"][0]["count"], &data["losses"][0]["area"]),
        (&Value::from(1), &Value::from(1.0))
    );
}

#[test]
fn surfaces_in_several_groups_have_the_properties_of_each() {
    let place = Place::new();
    // All but the floor in a group of their own, and in one more.
    let mut text = gmsh4().replace("$PhysicalNames\n6\n", "$PhysicalNames\n7\n2 7 \"insulated\"\n");
    for at in 2..7 {
        text = text.replace(
            &format!("{at} 0 0 0 1 1 1 1 {at} 0"),
            &format!("{at} 0 0 0 1 1 1 2 {at} 7 0"),
        );
    }
    place.write("cube4.msh", &text);
    // Version 2 lists an element once for each of its groups.
    let mut lines: Vec<String> = gmsh2()
        .replace("$PhysicalNames\n6\n", "$PhysicalNames\n7\n2 7 \"insulated\"\n")
        .replace("$Elements\n6\n", "$Elements\n11\n")
        .lines()
        .map(str::to_owned)
        .collect();
    let end = lines.len() - 1;
    for at in 2..7 {
        let element = lines
            .iter()
            .find(|line| line.starts_with(&format!("{at} 3 2 {at} ")))
            .expect("an element");
        let copy = element.replacen(&format!("{at} 3 2 {at}"), &format!("{} 3 2 7", at + 5), 1);
        lines.insert(end, copy);
    }
    place.write("cube2.msh", lines.join("\n") + "\n");
    place.write(
        "m.toml",
        "[default]\nemissivity = 0.9\n[object.floor]\ntemperature = \"40 °C\"\n[object.insulated]\nadiabatic = true\n",
    );
    for name in ["cube4.msh", "cube2.msh"] {
        let ran = compute(&place, name);
        assert!(!ran.err.contains("warning"), "{name}: {}", ran.err);
        let solved = place.line("solve m --thermal --materials m.toml --by object").is(0);
        let heat = |object: &str| -> f64 {
            let row = solved
                .out
                .lines()
                .chain(solved.err.lines())
                .find(|line| line.starts_with(object));
            let row = row.unwrap_or_else(|| panic!("{object} in {}{}", solved.out, solved.err));
            row.split_whitespace()
                .nth(3)
                .and_then(|word| word.parse().ok())
                .unwrap_or_else(|| panic!("{row}"))
        };
        for object in ["floor", "ceiling", "west"] {
            assert!(heat(object).abs() < 1e-6, "{name}: {object}: {}", solved.out);
        }
        place
            .line(&format!("compute {name} -o e --overwrite --emitters insulated"))
            .is(0);
        let rows = place.line("check e --json").json()["rows"].clone();
        assert_eq!(rows, Value::from(10), "{name}");
        place
            .line(&format!("compute {name} -o e --overwrite --exclude insulated"))
            .is(0);
    }
}

/// A can of eight-node quadrilaterals and six-node triangles, radius 1, length 2, as a mesh of Gmsh 2.2.
fn can(sectors: usize) -> String {
    let mut nodes: Vec<[f64; 3]> = Vec::new();
    let mut elements = Vec::new();
    let mut node = |radius: f64, eighth: usize, z: f64| {
        let angle = std::f64::consts::PI * (eighth as f64) / (sectors as f64);
        let point = [radius * angle.cos(), radius * angle.sin(), z];
        let same = |other: &[f64; 3]| other.iter().zip(point).all(|(a, b)| (a - b).abs() < 1e-9);
        nodes.iter().position(same).unwrap_or_else(|| {
            nodes.push(point);
            nodes.len() - 1
        }) + 1
    };
    for sector in 0..sectors {
        let [a, m, b] = [2 * sector, 2 * sector + 1, 2 * sector + 2];
        let mut cap = |z: f64| {
            [
                node(0.0, a, z),
                node(1.0, a, z),
                node(1.0, b, z),
                node(0.5, a, z),
                node(1.0, m, z),
                node(0.5, b, z),
            ]
        };
        let [low, high] = [cap(0.0), cap(2.0)];
        elements.push(format!("9 2 1 1 {}", joined(low, " ")));
        let [c, p, q, cp, pq, qc] = high;
        elements.push(format!("9 2 2 2 {}", joined([c, q, p, qc, pq, cp], " ")));
        let [left, right] = [node(1.0, a, 1.0), node(1.0, b, 1.0)];
        let mantle = [low[1], high[1], high[2], low[2], left, high[4], right, low[4]];
        elements.push(format!("16 2 3 3 {}", joined(mantle, " ")));
    }
    let nodes = (1..)
        .zip(&nodes)
        .map(|(at, node)| format!("{at} {}", joined(node, " ")));
    let elements: Vec<String> = (1..)
        .zip(elements)
        .map(|(at, element): (usize, _)| format!("{at} {element}"))
        .collect();
    let nodes: Vec<String> = nodes.collect();
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n3\n2 1 \"bottom\"\n2 2 \"top\"\n2 3 \"mantle\"\n\
         $EndPhysicalNames\n$Nodes\n{}\n{}$EndNodes\n$Elements\n{}\n{}$EndElements\n",
        nodes.len(),
        lines(nodes.clone()),
        elements.len(),
        lines(elements.clone())
    )
}

#[test]
fn curved_elements_of_second_order_have_the_area_of_their_nodes() {
    let place = Place::new();
    let area = |sectors: usize| {
        place.write("can.msh", can(sectors));
        let mut scene = hemicube_scene::load(&place.path("can.msh"), ReadOptions::default()).expect("a mesh");
        repair(&mut scene, RepairOptions::default());
        assert_eq!(scene.ledger.losses().count(), 0, "{}", scene.ledger);
        let of = |t: &hemicube_scene::Triangle| {
            0.5 * (t.corners[1] - t.corners[0])
                .cross(t.corners[2] - t.corners[0])
                .length()
        };
        scene.triangles.iter().map(of).sum::<f64>()
    };
    for sectors in [4, 6, 8] {
        // A prism over twice as many sides as there are elements.
        let sides = 2.0 * sectors as f64;
        let half = std::f64::consts::PI / sides;
        let exact = 2.0 * sides * half.sin() * half.cos() + 2.0 * sides * 2.0 * half.sin();
        assert!(
            (area(sectors) - exact).abs() < 1e-9,
            "{sectors}: {} for {exact}",
            area(sectors)
        );
    }
    // Bottom to top of the prism of sixteen sides, by its own nodes; the can's own factor is 0.171573.
    place.write("can.msh", can(8));
    place
        .line("compute can.msh -o m --overwrite --tolerance 0.1% --by object")
        .is(0);
    place.line("export m -o f.csv --by object --overwrite").is(0);
    let text = std::fs::read_to_string(place.path("f.csv")).expect("a table");
    assert!(text.contains("0.168"), "{text}");
}

#[test]
fn a_reader_that_turned_surfaces_is_not_told_to_turn_them_again() {
    let place = Place::new();
    // A zone under an overhang, which sees its outside.
    place.write(
        "zone.idf",
        idf() + "Shading:Building:Detailed,roof,,4,-1,-1,1.2,2,-1,1.2,2,2,1.2,-1,2,1.2;\n",
    );
    let ran = compute(&place, "zone.idf");
    assert!(!ran.err.contains("--flip"), "{}", ran.err);
    let ran = place.line("inspect zone.idf").is(0);
    assert!(!ran.out.contains("--flip"), "{}", ran.out);
    // The same box of an OBJ, wound outwards, is told of.
    let outward = FACES.iter().fold(obj(), |text, (_, [a, b, c, d])| {
        text.replace(
            &joined([a + 1, b + 1, c + 1, d + 1], " "),
            &joined([d + 1, c + 1, b + 1, a + 1], " "),
        )
    });
    place.write("box.obj", outward);
    assert!(compute(&place, "box.obj").err.contains("--flip all"));
}

#[test]
fn partial_overlap_in_a_plane_is_a_warning_of_compute() {
    let place = Place::new();
    place.write(
        "cube.obj",
        obj() + "o mat\nv 0.2 0.2 0\nv 0.7 0.2 0\nv 0.7 0.6 0\nv 0.2 0.6 0\nf -4 -3 -2 -1\n",
    );
    compute(&place, "cube.obj").says(&["cover each other in one plane", "`mat`"]);
    place.write("cube.obj", obj());
    assert!(!compute(&place, "cube.obj").err.contains("cover each other"));
}

#[test]
fn surfaces_that_nearly_lie_on_each_other_are_doubles_with_a_name() {
    let place = Place::new();
    place.write("points.txt", "0.5 0.5 0.5 0 0 1\n");
    // The same way round they hide each other; the other way round they see little else.
    for (gap, order, says) in [
        (1e-7, "-4 -3 -2 -1", "cover each other in one plane"),
        (1e-5, "-4 -3 -2 -1", "cover each other in one plane"),
        (1e-7, "-1 -2 -3 -4", "face each other with hardly a gap"),
        (1e-5, "-1 -2 -3 -4", "face each other with hardly a gap"),
    ] {
        let again = CORNERS[..4]
            .iter()
            .fold(String::new(), |text, [x, y, _]| text + &format!("v {x} {y} {gap}\n"));
        place.write("cube.obj", obj() + "o again\n" + &again + "f " + order + "\n");
        let words = [says, "area", "`again`"];
        compute(&place, "cube.obj").says(&words);
        // The matrix keeps it, and its judge repeats it.
        let checked = place.line("check m");
        assert!(
            (checked.out.clone() + &checked.err).contains(says),
            "{gap} {order}: {} {}",
            checked.out,
            checked.err
        );
        place.line("sky cube.obj --up z -o sky --overwrite").says(&words);
        place.line("points cube.obj --up z --points points.txt").says(&words);
    }
    // A plate of a thousandth is a plate.
    let plate = CORNERS[..4]
        .iter()
        .fold(String::new(), |text, [x, y, _]| text + &format!("v {x} {y} 0.001\n"));
    place.write("cube.obj", obj() + "o again\n" + &plate + "f -4 -3 -2 -1\n");
    let ran = compute(&place, "cube.obj");
    assert!(
        !ran.err.contains("cover each other") && !ran.err.contains("hardly a gap"),
        "{}",
        ran.err
    );
}

#[test]
fn a_city_wound_inside_out_is_told_of_under_the_sky() {
    let place = Place::new();
    let mut text = "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\no ground\nf 1 2 3 4\n".to_owned();
    for (at, [x, y]) in [[-20, -20], [0, -20], [20, -20], [-20, 10], [0, 10], [20, 10]]
        .into_iter()
        .enumerate()
    {
        let _ = writeln!(text, "o house{at}");
        for [u, v, w] in CORNERS {
            let _ = writeln!(
                text,
                "v {} {} {}",
                f64::from(x) + 8.0 * u,
                f64::from(y) + 8.0 * v,
                12.0 * w
            );
        }
        for (name, face) in FACES {
            // The faces of `FACES` see the inside. Houses stand on the ground without a floor.
            if name != "floor" {
                let _ = writeln!(text, "f {}", joined(face.map(|at| at as i64 - 8), " "));
            }
        }
    }
    place.write("city.obj", &text);
    place.write("points.txt", "0 0 1 0 0 1\n");
    place
        .line("sky city.obj --up z -o sky.npz")
        .says(&["face inwards", "--flip"]);
    place
        .line("points city.obj --points points.txt --up z")
        .says(&["face inwards", "--flip"]);
    // A matrix that says so itself, and what is solved of it.
    compute(&place, "city.obj");
    place.write("m.toml", "[default]\nreflectance = 0.3\nemission = 1\n");
    place
        .line("solve m --scene city.obj --materials m.toml")
        .says(&["face inwards", "--flip"]);
}

#[test]
fn millimetres_are_asked_about_where_heat_is() {
    let place = Place::new();
    place.write("m.toml", "[default]\nemissivity = 0.9\ntemperature = 300\n");
    let scaled = |by: f64| {
        let vertices = CORNERS.map(|corner| format!("v {}", joined(corner.map(|x| by * x), " ")));
        lines(vertices)
            + &obj()
                .lines()
                .filter(|line| !line.starts_with('v'))
                .fold(String::new(), |t, l| t + l + "\n")
    };
    for (name, by, asked) in [
        ("part.obj", 4000.0, true),
        ("part_mm.obj", 400.0, true),
        ("room.obj", 4.0, false),
    ] {
        place.write(name, scaled(by));
        compute(&place, name);
        let ran = place
            .line("solve m --thermal --materials m.toml --sky-temperature 300")
            .is(0);
        assert_eq!(ran.err.contains("--scale 0.001"), asked, "{name}: {}", ran.err);
    }
}
