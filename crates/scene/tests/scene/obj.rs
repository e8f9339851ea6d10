//! The OBJ reader: each odd syntax on inline text; the conformance files of two other readers, each with what must
//! become of it; the real scenes against counts and areas that an independent program took; `tobj` on the files that it
//! reads; and soup.

#![cfg(feature = "obj")]
#![allow(clippy::print_stdout, reason = "a skipped test says so")]

use glam::DVec3;
use hemicube_scene::{Budget, ErrorKind, ReadOptions, Scene, load, obj};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

fn read(text: impl AsRef<[u8]>) -> Scene {
    obj::read(text.as_ref(), None, ReadOptions::default()).unwrap()
}

/// Line and message of the error that reading must end with.
fn refusal(text: impl AsRef<[u8]>) -> (Option<u64>, String) {
    let error = obj::read(text.as_ref(), None, ReadOptions::default()).unwrap_err();
    (error.line, error.kind.to_string())
}

const V: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
const T: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

fn area(scene: &Scene) -> f64 {
    let areas = scene.triangles.iter().map(|t| {
        let [a, b, c] = t.corners;
        0.5 * (b - a).cross(c - a).length()
    });
    areas.sum()
}

// One statement or line form at a time.

#[test]
fn line_ends_marks_and_blanks() {
    for text in [
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n",
        "v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3",
        "\u{FEFF}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3",
        "  v\t0 0\x0b0  \n\n\n v 1 0 0 \nv 0 1 0\n\tf  1  2\t3 ",
        "v 0 0 0\nv 1 0 0 # east\nv 0 1 0# north\nf 1 2 3#\n# f 3 2 1\n#f 3 2 1\n",
        "v 0 \\\n0 0\nv 1 0 0\\\r\n\nv 0 1\\\r 0\nf 1\\\n2\\\n3\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 \\",
        "# C:\\\nv 0 0 0\n# a \\\nv 1 0 0\nv 0 1 0 # b\\\nf 1 2 3",
    ] {
        let scene = read(text);
        assert_eq!(scene.triangles.len(), 1, "{text:?}");
        assert_eq!(scene.triangles[0].corners, T, "{text:?}");
        assert!(scene.ledger.entries.is_empty(), "{text:?}: {:?}", scene.ledger);
        assert_eq!((scene.objects, scene.materials.len()), (vec![String::new()], 1));
    }
}

#[test]
fn lines_are_counted_whatever_ends_them() {
    for text in [
        "v 0 0 0\n\n# x\nv 1\n",
        "v 0 0 0\r\n\r\n# x\r\nv 1\r\n",
        "v 0 0 0\r\r# x\rv 1\r",
        "v 0 \\\n0 \\\n0\nv 1 \\\n\n",
    ] {
        assert_eq!(
            refusal(text),
            (Some(4), "`v` has 1 numbers; a vertex needs three".to_owned()),
            "{text:?}"
        );
    }
}

#[test]
fn indices() {
    let corners = |face: &str| read(format!("{V}vt 0 0\nvn 0 0 1\nf {face}\nv 9 9 9\n")).triangles[0].corners;
    for face in [
        "1 2 3",
        "-4 -3 -2",
        "1/1 2/1 3/1",
        "1//1 2//1 3//1",
        "1/1/1 2//1 3/7/-9",
        "+1 02 3/",
        "1 -3 3",
    ] {
        assert_eq!(corners(face), T, "{face}");
    }
    // Negative indices count from where the face stands.
    let scene = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -4 -3 -2\n");
    assert_eq!(scene.triangles[0].corners, scene.triangles[1].corners);
}

#[test]
fn indices_that_lead_nowhere() {
    for (face, part) in [
        ("0 1 2", "`0` is of vertex 0"),
        ("1 0/1 2", "`0/1` is of vertex 0"),
        ("1 2 -0", "vertex 0"),
        ("1 2 5", "`5` is of a vertex that is not there; 4 come before"),
        ("-5 1 2", "`-5` is of a vertex that is not there; 4 come before"),
        ("1 2 99999999999999999999999", "not there"),
        ("1 2 18446744073709551617", "not there"),
        ("1 2 -9223372036854775809", "not there"),
        ("1 2 three", "`three` is no face corner"),
        ("1 2 3.0", "`3.0` is no face corner"),
        ("1 2 3/x", "`3/x` is no face corner"),
        ("1 2 /3", "`/3` is no face corner"),
        ("1 2 --3", "`--3` is no face corner"),
        ("1 2 -", "`-` is no face corner"),
        ("1 2 3\u{301}", "is no face corner"),
    ] {
        let (line, message) = refusal(format!("{V}f {face}\nv 0 0 0\n"));
        assert_eq!(line, Some(5), "{face}");
        assert!(message.contains(part), "{face}: {message}");
    }
    let long = "9x".repeat(1000);
    assert!(refusal(format!("{V}f {long}")).1.len() < 200);
}

#[test]
fn vertices() {
    let corner = |v: &str| read(format!("v {v}\nv 1 0 0\nv 0 1 0\nf 1 2 3")).triangles[0].corners[0];
    let expected = DVec3::new(2_678_219.194, 1.0, -0.5);
    for v in [
        "2678219.194 1 -.5",
        "2678219.194 1 -.5 1.0",
        "2678219.194 1 -.5 0.5 0.5 0.5",
        "2678219.194 1 -.5 x",
    ] {
        assert_eq!(corner(v), expected, "{v}");
    }
    for (v, part) in [
        ("", "0 numbers"),
        ("1 2", "2 numbers"),
        ("1 2 # 3", "2 numbers"),
        ("1,5 2 3", "`1,5` is no number; write a decimal point"),
        ("a 2 3", "`a` is no number"),
        ("1 2 \u{fffd}", "is no number"),
    ] {
        let (line, message) = refusal(format!("# x\nv {v}\n"));
        assert_eq!(line, Some(2), "{v}");
        assert!(message.contains(part), "{v}: {message}");
    }
    assert!(refusal(b"v 1 2 \xFF\n").1.contains("is no number"));
}

#[test]
fn corners_that_are_not_finite_are_kept_for_repair() {
    for x in ["nan", "inf", "-infinity", "1e400", "-1.#IND", "1.#QNAN # here"] {
        let scene = read(format!("{V}v 0 0 {x}\nf 1 2 3\nf 1 2 5\nf 1 2 3 5\nf 1 2 3\n"));
        assert_eq!(scene.ledger.get("face with a corner that is not finite"), 2, "{x}");
        let faces: Vec<u32> = scene.triangles.iter().map(|t| t.face).collect();
        assert_eq!(faces, [0, 1, 2, 2, 3], "{x}");
        assert!(!scene.triangles[1].corners[2].z.is_finite());
    }
    // Without a face such a vertex is nobody's.
    assert!(read(format!("{V}v nan nan nan\nf 1 2 3")).ledger.entries.is_empty());
}

#[test]
fn polygons() {
    let scene = read(
        "v 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 0 0 0\nv 2 0 0\nf 1 2 3 4 5 6\nf 5 5 6 1 2\nf 5 6\nf\nf 5 6 5 6\nfo 5 6 1\n",
    );
    let faces: Vec<u32> = scene.triangles.iter().map(|t| t.face).collect();
    assert_eq!(faces, [0, 0, 0, 0, 1, 1, 5]);
    assert_eq!(area(&scene), 3.0 + 1.5 + 1.0);
    assert!(
        scene
            .triangles
            .iter()
            .all(|t| (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]).z > 0.0)
    );
    assert_eq!(scene.ledger.get("face with fewer than 3 corners"), 2);
    assert_eq!(scene.ledger.get("face without area"), 1);
    assert_eq!(scene.ledger.get("face with a repeated corner, mended"), 1);
    assert_eq!(scene.ledger.entries.len(), 3, "{:?}", scene.ledger);
}

#[test]
fn polygons_far_from_plane_and_those_that_cross_themselves_are_losses() {
    let count = |last: &str| {
        read(format!(
            "v 0 0 0\nv 4 0 0\nv 4 4 0\nv {last}\nv 1 2 0\nf 1 2 3 4\nf 1 2 3 4 5\n"
        ))
        .ledger
        .get("face that crosses itself or is far from plane, cut into triangles")
    };
    assert_eq!(count("0 4 0"), 0);
    assert_eq!(count("0 4 0.1"), 0);
    assert_eq!(count("0 4 2"), 2);
    // Crossing the first edge.
    assert_eq!(count("3 -0.5 0"), 2);
}

#[test]
fn a_polygon_with_too_many_corners_is_refused() {
    let (line, message) = refusal(format!("{V}f {}\n", "1 2 3 ".repeat(30_000)));
    assert_eq!(line, Some(5));
    assert!(message.contains("a face has 90000 corners"), "{message}");
}

#[test]
fn names_of_objects_and_materials() {
    let scene = read(format!(
        "{V}f 1 2 3\no house 7 # of brick\nf 1 2 3\nusemtl dark  red\ng roof left\nf 1 2 3\ng\nf 1 2 3\n\
         usemtl\ng roof left\nf 1 2 3\nusemtl wall#2\no unused\no house 7\nf 1 2 3\nusemtl\t\no\nf 1 2 3\n"
    ));
    assert_eq!(scene.objects, ["", "house 7", "roof left"]);
    let materials: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(materials, ["", "dark  red", "wall#2"]);
    let uses: Vec<(u32, u32)> = scene.triangles.iter().map(|t| (t.object, t.material)).collect();
    assert_eq!(uses, [(0, 0), (1, 0), (2, 1), (1, 1), (2, 0), (1, 2), (0, 0)]);
    assert!(scene.ledger.entries.is_empty(), "{:?}", scene.ledger);
}

#[test]
fn names_that_are_not_utf_8() {
    let scene = read(
        [
            b"# Stra\xDFe\no S\xFCd \\\n tor\nusemtl r\xF6d\n",
            V.as_bytes(),
            b"f 1 2 3",
        ]
        .concat(),
    );
    assert_eq!(scene.objects, ["S\u{fffd}d   tor"]);
    assert_eq!(scene.materials[0].name, "r\u{fffd}d");
    let utf_16: Vec<u8> = "\u{FEFF}v 0 0 0\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let error = obj::read(&utf_16, None, ReadOptions::default()).unwrap_err();
    assert!(
        matches!(&error.kind, ErrorKind::Unsupported(message) if message.contains("UTF-8")),
        "{error}"
    );
}

#[test]
fn what_is_no_face_is_counted_or_skipped() {
    let scene = read(format!(
        "{V}mtllib x.mtl\ns off\ns 1\nvt 0 0\nvn 0 0 1\nvp 0 0\nl 1 2 3\np 1 2\ncstype bezier\ndeg 3\ncurv 0 1 1 2 3\nparm u 0 1\nend\n\
         surf 0 1 0 1 1 2\ncall other.obj\nusemap x\ng#\n\nfoo bar\n<html>\nfoo\nV 1 2 3\nf 1 2 3\n"
    ));
    let counts: Vec<(&str, u64)> = scene
        .ledger
        .entries
        .iter()
        .map(|(k, loss)| (k.as_str(), loss.count))
        .collect();
    assert_eq!(
        counts,
        [
            ("command in the file, not run", 1),
            ("free-form curve", 1),
            ("free-form surface", 1),
            ("line element", 1),
            ("line that is no OBJ, skipped", 4),
            ("point element", 1),
        ]
    );
    let losses: Vec<&str> = scene.ledger.losses().map(|(what, _)| what).collect();
    assert_eq!(losses, ["command in the file, not run", "free-form surface"]);
    assert_eq!(scene.ledger.warnings.len(), 3);
    assert_eq!(
        scene.ledger.warnings[1],
        "line 24: `<html>` begins no statement of OBJ; the line was skipped"
    );
    assert_eq!(scene.triangles.len(), 1);
}

#[test]
fn files_without_faces_have_no_triangles() {
    for text in ["", "\n", "\\", "\\\n\\", "#", V, "\u{FEFF}", "\0\0\0\0"] {
        assert!(read(text).triangles.is_empty(), "{text:?}");
    }
}

// Material libraries.

/// An empty folder for a test's files.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("obj-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

const OPTICS: ReadOptions = ReadOptions {
    optics: true,
    allow_large: false,
    budget: Budget::new(None),
};

#[test]
fn libraries_are_read_only_when_asked_for() {
    let folder = folder("libraries");
    std::fs::create_dir_all(folder.join("sub")).unwrap();
    std::fs::write(folder.join("a.mtl"), "newmtl one\nKd 0.1 0.2 0.3\n").unwrap();
    std::fs::write(
        folder.join("b.mtl"),
        "newmtl one\nKd 0.9 0.9 0.9\nnewmtl two\nKe 4 5 6\n",
    )
    .unwrap();
    std::fs::write(folder.join("with blank.mtl"), "newmtl three\nKd .5 .5 .5\n").unwrap();
    std::fs::write(folder.join("sub/c.mtl"), "newmtl four\nKd 1 1 1\n").unwrap();
    let text = format!(
        "mtllib a.mtl b.mtl\nmtllib with blank.mtl # x\nmtllib sub\\c.mtl\nmtllib a.mtl b.mtl\n{V}\
         usemtl one\nf 1 2 3\nusemtl two\nf 1 2 3\nusemtl three\nf 1 2 3\nusemtl four\nf 1 2 3\nusemtl five\nf 1 2 3\nusemtl\nf 1 2 3\n"
    );
    let scene = obj::read(text.as_bytes(), Some(&folder), OPTICS).unwrap();
    let of = |i: usize| (scene.materials[i].diffuse, scene.materials[i].emission);
    assert_eq!(of(0), (Some([0.1, 0.2, 0.3]), None), "the first library counts");
    assert_eq!(of(1), (None, Some([4.0, 5.0, 6.0])));
    assert_eq!(of(2), (Some([0.5; 3]), None));
    assert_eq!(of(3), (Some([1.0; 3]), None));
    assert_eq!((of(4), of(5)), ((None, None), (None, None)));
    assert_eq!(scene.ledger.get("material that no library describes"), 1);
    assert!(scene.ledger.warnings.is_empty(), "{:?}", scene.ledger);

    let scene = obj::read(text.as_bytes(), Some(&folder), ReadOptions::default()).unwrap();
    assert!(
        scene
            .materials
            .iter()
            .all(|m| m.diffuse.is_none() && m.emission.is_none())
    );
    assert!(scene.ledger.entries.is_empty() && scene.ledger.warnings.is_empty());
}

#[test]
fn libraries_that_cannot_be_read_are_warned_of() {
    let folder = folder("missing");
    std::fs::create_dir_all(folder.join("directory.mtl")).unwrap();
    let text = format!("mtllib gone.mtl\nmtllib directory.mtl\nmtllib\n{V}usemtl one\nf 1 2 3\n");
    let scene = obj::read(text.as_bytes(), Some(&folder), OPTICS).unwrap();
    assert_eq!(scene.triangles.len(), 1);
    assert_eq!(scene.ledger.get("material library that could not be read"), 2);
    assert!(
        scene.ledger.warnings[0].contains("`gone.mtl` could not be read"),
        "{:?}",
        scene.ledger
    );
    assert!(
        scene.ledger.warnings[1].contains("a regular file is needed"),
        "{:?}",
        scene.ledger
    );

    let scene = obj::read(text.as_bytes(), None, OPTICS).unwrap();
    assert_eq!(scene.ledger.get("material library that could not be read"), 2);

    // However many there are: a few warnings, and an end to opening files.
    let many: String = (0..5000).map(|i| format!("mtllib {i}.mtl\n")).collect();
    let scene = obj::read(many.as_bytes(), Some(&folder), OPTICS).unwrap();
    assert_eq!(scene.ledger.warnings.len(), 3);
    assert_eq!(scene.ledger.get("material library that could not be read"), 1001);
}

#[cfg(unix)]
#[test]
fn a_library_that_never_ends_is_not_read() {
    let text = format!("mtllib /dev/zero\n{V}f 1 2 3\n");
    let scene = obj::read(text.as_bytes(), Some(Path::new(".")), OPTICS).unwrap();
    assert!(
        scene.ledger.warnings[0].contains("leads out of the scene's folder"),
        "{:?}",
        scene.ledger
    );
}

// The files of others.

fn scenes(test: &str) -> Option<PathBuf> {
    let root = std::env::var_os("HEMICUBE_SCENES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes"),
        PathBuf::from,
    );
    let there = root.join("manifest.tsv").is_file();
    if !there {
        println!("SKIP {test}: no ../shared/scenes");
    }
    there.then_some(root)
}

/// What must become of the conformance files of `tobj` and `tinyobjloader`.
#[derive(Debug, PartialEq)]
enum Outcome {
    Triangles(usize),
    RefusedAt(u64),
}
use Outcome::{RefusedAt, Triangles};

const CONFORMANCE: [(&str, Outcome); 55] = [
    ("tinyobjloader/catmark_torus_creases0.obj", Triangles(64)),
    ("tinyobjloader/colorspace-issue-184.obj", Triangles(1)),
    ("tinyobjloader/cornell_box.obj", Triangles(36)),
    ("tinyobjloader/cornell_box_multimaterial.obj", Triangles(36)),
    ("tinyobjloader/cube-vertex-w-component.obj", Triangles(12)),
    ("tinyobjloader/cube-vertexcol.obj", Triangles(12)),
    ("tinyobjloader/cube.obj", Triangles(12)),
    // Faces of one and two corners: counted.
    ("tinyobjloader/invalid-face-definition.obj", Triangles(0)),
    // No vertices at all.
    ("tinyobjloader/invalid-relative-texture-index.obj", RefusedAt(2)),
    ("tinyobjloader/invalid-relative-vertex-index.obj", RefusedAt(1)),
    ("tinyobjloader/issue-138.obj", Triangles(12)),
    ("tinyobjloader/issue-140-zero-face-idx.obj", RefusedAt(16)),
    ("tinyobjloader/issue-161-inconsistent-f.obj", Triangles(12)),
    ("tinyobjloader/issue-162-smoothing-group.obj", Triangles(12)),
    ("tinyobjloader/issue-235-usemtl-then-o.obj", Triangles(2)),
    ("tinyobjloader/issue-244-mtl-searchpaths.obj", Triangles(2)),
    ("tinyobjloader/issue-246-usemtl-whitespace.obj", Triangles(1)),
    ("tinyobjloader/issue-248-texres-texopt.obj", Triangles(12)),
    ("tinyobjloader/issue-295-trianguation-failure.obj", Triangles(28)),
    // A fan has 14, one of them at a repeated position.
    ("tinyobjloader/issue-319-002.obj", Triangles(13)),
    ("tinyobjloader/issue-319-003.obj", Triangles(8)),
    ("tinyobjloader/issue-330.obj", Triangles(3)),
    // No faces.
    ("tinyobjloader/issue-356-leading-spaces-newmtl.obj", Triangles(0)),
    ("tinyobjloader/issue-92.obj", Triangles(1)),
    ("tinyobjloader/issue-95-2.obj", Triangles(1)),
    ("tinyobjloader/issue-95.obj", Triangles(1)),
    ("tinyobjloader/leading-decimal-dot-issue-201.obj", Triangles(1)),
    (
        "tinyobjloader/leading-zero-in-exponent-notation-issue-210.obj",
        Triangles(1),
    ),
    ("tinyobjloader/line-prim.obj", Triangles(0)),
    ("tinyobjloader/map-bump.obj", Triangles(400)),
    ("tinyobjloader/missing_material_file.obj", Triangles(36)),
    ("tinyobjloader/mtl filename with whitespace issue46.obj", Triangles(12)),
    ("tinyobjloader/mtllib-multiple-files-issue-112.obj", Triangles(1)),
    ("tinyobjloader/no_material.obj", Triangles(36)),
    ("tinyobjloader/norm-texopt.obj", Triangles(1)),
    ("tinyobjloader/pbr-mat-ext.obj", Triangles(2)),
    ("tinyobjloader/points-prim.obj", Triangles(0)),
    ("tinyobjloader/refl.obj", Triangles(12)),
    ("tinyobjloader/skin-weight.obj", Triangles(12)),
    ("tinyobjloader/smoothing-group-two-squares.obj", Triangles(3)),
    ("tinyobjloader/smoothing-normal.obj", Triangles(6)),
    // Kept for repair to drop.
    ("tinyobjloader/test-nan.obj", Triangles(36)),
    ("tinyobjloader/texture-filename-with-whitespace.obj", Triangles(12)),
    ("tinyobjloader/texture-options-issue-85.obj", Triangles(1)),
    ("tinyobjloader/tr-and-d-issue-43.obj", Triangles(400)),
    ("tinyobjloader/usemtl-issue-104.obj", Triangles(6)),
    ("tinyobjloader/usemtl-issue-68.obj", Triangles(400)),
    ("tobj/cornell_box.obj", Triangles(36)),
    ("tobj/empty_name_triangle.obj", Triangles(1)),
    ("tobj/invalid_index.obj", RefusedAt(12)),
    ("tobj/lines.obj", Triangles(0)),
    ("tobj/quad.obj", Triangles(5)),
    ("tobj/quad_colored_merge.obj", Triangles(2)),
    ("tobj/triangle.obj", Triangles(1)),
    ("tobj/triangle_colored.obj", Triangles(1)),
];

#[test]
fn conformance_files_are_read_or_refused_as_stated() {
    let Some(root) = scenes("conformance_files_are_read_or_refused_as_stated") else {
        return;
    };
    let mut complaints = Vec::new();
    for (file, expected) in CONFORMANCE {
        let path = root.join("obj").join(file);
        let bytes = std::fs::read(&path).unwrap();
        for options in [ReadOptions::default(), OPTICS] {
            let outcome = match obj::read(&bytes, path.parent(), options) {
                Ok(scene) => Triangles(scene.triangles.len()),
                Err(error) => RefusedAt(error.line.unwrap()),
            };
            if outcome != expected {
                complaints.push(format!("{file}: {outcome:?} instead of {expected:?}"));
            }
        }
    }
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
    // None was forgotten.
    let there = ["tobj", "tinyobjloader"]
        .iter()
        .flat_map(|folder| std::fs::read_dir(root.join("obj").join(folder)).unwrap())
        .filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|e| e == "obj"));
    assert_eq!(there.count(), CONFORMANCE.len());
}

/// The triangles that `tobj` reads, in the file's order, or none where it refuses the file or there are polygons.
fn triangles_of_tobj(bytes: &[u8]) -> Option<Vec<[DVec3; 3]>> {
    let options = tobj::LoadOptions {
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let missing = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut &*bytes, &options, missing).ok()?;
    let mut triangles = Vec::new();
    for model in models {
        let mesh = model.mesh;
        if !mesh.face_arities.iter().all(|&n| n == 3) {
            return None;
        }
        let vertices = mesh.positions.as_chunks().0;
        let corner = |&i: &u32| DVec3::from_array(vertices[i as usize]);
        triangles.extend(
            mesh.indices
                .as_chunks()
                .0
                .iter()
                .map(|[a, b, c]| [corner(a), corner(b), corner(c)]),
        );
    }
    Some(triangles)
}

#[test]
fn tobj_reads_the_same_triangles_where_it_reads_any() {
    let Some(root) = scenes("tobj_reads_the_same_triangles_where_it_reads_any") else {
        return;
    };
    let cities = [
        "city/3dfier-testarea.obj",
        "city/denhaag-8897.obj",
        "city/denhaag.obj",
        "city/rotterdam-delfshaven.obj",
        "city/zurich-lv95-rawcoords.obj",
        "interior/aggressor.obj",
        "interior/oa_dm5.obj",
    ];
    let conformance = CONFORMANCE.iter().map(|(file, _)| format!("obj/{file}"));
    let mut compared = (0, 0);
    for file in cities.iter().map(|&f| f.to_owned()).chain(conformance) {
        let bytes = std::fs::read(root.join(&file)).unwrap();
        let (Ok(ours), Some(theirs)) = (
            obj::read(&bytes, None, ReadOptions::default()),
            triangles_of_tobj(&bytes),
        ) else {
            continue;
        };
        // Bits, so that NaN equals itself.
        let bits = |corners: &[DVec3; 3]| corners.map(|p| p.to_array().map(f64::to_bits));
        let ours: Vec<_> = ours.triangles.iter().map(|t| bits(&t.corners)).collect();
        let theirs: Vec<_> = theirs.iter().map(bits).collect();
        assert!(ours == theirs, "{file}: {} triangles and {}", ours.len(), theirs.len());
        compared = (compared.0 + 1, compared.1 + ours.len());
    }
    // So many it reads and cuts no polygon of; were it fewer, the comparison would have stopped comparing.
    assert!(compared.0 >= 25 && compared.1 > 160_000, "{compared:?}");
}

/// Triangle counts and areas where these are not the manifest's, which are of fans.
const NOT_AS_FANS: [(&str, usize, f64); 1] = [
    // 906 concave polygons, 1,246 triangles of the fans without area. The area is that of the published triangulation.
    ("city/rotterdam-ngons.obj", 37_798, 627_077.137_340),
];

#[test]
fn real_scenes_have_the_counts_and_areas_of_the_manifest() {
    let Some(root) = scenes("real_scenes_have_the_counts_and_areas_of_the_manifest") else {
        return;
    };
    let manifest = std::fs::read_to_string(root.join("manifest.tsv")).unwrap();
    let mut read = 0;
    for row in manifest.lines() {
        let columns: Vec<&str> = row.split('\t').collect();
        let file = columns[0];
        if !file.ends_with(".obj") || file.starts_with("obj/") {
            continue;
        }
        let (count, expected_area) = NOT_AS_FANS.iter().find(|row| row.0 == file).map_or_else(
            || (columns[2].parse().unwrap(), columns[11].parse().unwrap()),
            |row| (row.1, row.2),
        );
        let scene = load(&root.join(file), OPTICS).unwrap();
        assert_eq!(scene.triangles.len(), count, "{file}");
        // The manifest has six decimals.
        let difference: f64 = area(&scene) - expected_area;
        assert!(
            difference.abs() < 1e-6 + 1e-12 * expected_area,
            "{file}: {}",
            area(&scene)
        );
        read += 1;
    }
    assert_eq!(read, 11);
}

#[test]
fn optics_of_the_cornell_boxes() {
    let Some(root) = scenes("optics_of_the_cornell_boxes") else {
        return;
    };
    for file in [
        "cornell/cornell-measured-closed-20q.obj",
        "cornell/CornellBox-Original.obj",
    ] {
        let scene = load(&root.join(file), OPTICS).unwrap();
        let light = scene.materials.iter().find(|m| m.name == "light").unwrap();
        assert_eq!(light.emission, Some([17.0, 12.0, 4.0]), "{file}");
        assert!(scene.materials.iter().all(|m| m.diffuse.is_some()), "{file}");
        assert!(scene.ledger.warnings.is_empty(), "{file}: {:?}", scene.ledger);
    }
}

#[test]
fn errors_name_file_and_line() {
    let Some(root) = scenes("errors_name_file_and_line") else {
        return;
    };
    let error = load(&root.join("obj/tobj/invalid_index.obj"), ReadOptions::default()).unwrap_err();
    assert!(
        error.to_string().contains("invalid_index.obj:12: face corner `7`"),
        "{error}"
    );
    let error = load(&root.join("obj/tobj/lines.obj"), ReadOptions::default()).unwrap_err();
    assert!(error.to_string().ends_with("in the file: 3 × line element"), "{error}");
}

// Soup.

fn check(bytes: &[u8]) -> Result<(), TestCaseError> {
    for options in [ReadOptions::default(), OPTICS] {
        match obj::read(bytes, None, options) {
            Ok(scene) => {
                prop_assert!(scene.triangles.len() <= bytes.len());
                prop_assert!(scene.triangles.is_sorted_by_key(|t| t.face));
                for t in &scene.triangles {
                    prop_assert!((t.object as usize) < scene.objects.len());
                    prop_assert!((t.material as usize) < scene.materials.len());
                }
            }
            Err(error) => prop_assert!(error.line.is_some() || matches!(error.kind, ErrorKind::Unsupported(_))),
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn any_bytes_at_all(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        check(&bytes)?;
    }

    #[test]
    fn any_words(words in prop::collection::vec(prop::sample::select(vec![
        "v", "v", "f", "f", "vt", "o", "g", "usemtl", "mtllib", "l", "curv", "fo", "0", "1", "2", "3", "-1", "-2", "1/1", "2//3", "1e400",
        "nan", "1.#INF", "-0", "7e-3", "#", "\\", "\\\n", "\n", "\n", "\r\n", "\r", "\t", "a b", "\u{FEFF}", "é", "/",
    ]), 0..200)) {
        check(words.join(" ").as_bytes())?;
        check(words.concat().as_bytes())?;
    }

    #[test]
    fn any_faces_of_good_vertices(
        vertices in prop::collection::vec(prop::array::uniform3(-3..4_i8), 3..12),
        faces in prop::collection::vec(prop::collection::vec(1..4_usize, 0..9), 0..12),
    ) {
        use std::fmt::Write;
        let mut text = String::new();
        for [x, y, z] in vertices {
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        for face in &faces {
            writeln!(text, "f{}", face.iter().map(|i| format!(" {i}")).collect::<String>()).unwrap();
        }
        let scene = obj::read(text.as_bytes(), None, ReadOptions::default()).unwrap();
        prop_assert!(scene.triangles.iter().all(|t| (t.face as usize) < faces.len()));
        let few = faces.iter().filter(|face| face.len() < 3).count() as u64;
        prop_assert_eq!(scene.ledger.get("face with fewer than 3 corners"), few);
    }
}
