//! The AC3D reader: each feature and each way a file lies, on inline text; the real files against counts and areas
//! that an independent program took; and soup.

#![allow(clippy::print_stdout, reason = "a skipped test says so")]

use glam::{DMat3, DVec3};
use hemicube_scene::{Axis, Budget, Error, ErrorKind, ReadOptions, Scene, ac3d};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

const HEAD: &str = "AC3Db\nMATERIAL \"white\" rgb 0.7 0.6 0.5  amb 1 1 1  emis 1 2 3  spec 0 0 0  shi 10  trans 0\n";

const OPTICS: ReadOptions = ReadOptions {
    optics: true,
    allow_large: false,
    budget: Budget::new(None),
};

/// A triangle object of three unit corners: (0,0,0), (1,0,0), (0,1,0).
fn poly(properties: &str, kids: u32) -> String {
    format!(
        "OBJECT poly\n{properties}numvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\nSURF 0x10\nmat 0\nrefs 3\n0 0 0\n1 0 0\n2 0 \
         0\nkids {kids}\n"
    )
}

/// An object with four corners of a unit square and one surface.
fn square(surface: &str) -> String {
    format!("{HEAD}OBJECT poly\nnumvert 4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\nnumsurf 1\n{surface}kids 0\n")
}

fn read(text: &str) -> Result<Scene, Error> {
    ac3d::read(text.as_bytes(), None, ReadOptions::default())
}

fn ok(text: &str) -> Scene {
    read(text).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

#[track_caller]
fn assert_findings(scene: &Scene, expected: &[(&str, u64)]) {
    let found: Vec<(&str, u64)> = scene
        .ledger
        .entries
        .iter()
        .map(|(k, loss)| (k.as_str(), loss.count))
        .collect();
    assert_eq!(found, expected);
}

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn area(scene: &Scene) -> f64 {
    scene.triangles.iter().map(|t| normal(&t.corners).length() / 2.0).sum()
}

fn normal([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (*b - *a).cross(*c - *a)
}

#[test]
fn a_plain_file_is_read_without_findings() {
    let scene = ok(&format!(
        "{HEAD}OBJECT world\nkids 1\n{}",
        poly("name \"floor tile\"\n", 0)
    ));
    assert_eq!(scene.triangles.len(), 1);
    assert_eq!(scene.triangles[0].corners, [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert!(!scene.triangles[0].two_sided);
    assert_eq!(scene.objects, ["floor tile"]);
    assert_eq!(scene.materials.len(), 1);
    assert_eq!(scene.materials[0].name, "white");
    assert_eq!((scene.materials[0].diffuse, scene.materials[0].emission), (None, None));
    assert_eq!((scene.up, scene.metres_per_unit), (Some(Axis::Y), None));
    assert_findings(&scene, &[]);
    assert!(scene.ledger.warnings.is_empty());
}

#[test]
fn headers() {
    let body = poly("", 0);
    let after = HEAD.strip_prefix("AC3Db").unwrap();
    for known in ["AC3Db", "AC3Dc", "AC3Db ", "\n\n  AC3Db"] {
        assert!(
            ok(&format!("{known}{after}{body}")).ledger.warnings.is_empty(),
            "{known}"
        );
    }
    for unusual in ["AC3DbS", "AC3Da", "AC3D"] {
        let scene = ok(&format!("{unusual}{after}{body}"));
        assert_eq!(scene.triangles.len(), 1);
        assert_eq!(scene.ledger.warnings.len(), 1, "{unusual}");
        assert!(scene.ledger.warnings[0].contains(&format!("`{unusual}`")));
    }
    for (wrong, line) in [
        ("", 1),
        ("\n\n", 1),
        ("v 0 0 0\n", 1),
        ("ac3db\n", 1),
        ("\n\nPK\u{3}\u{4}", 3),
    ] {
        let error = read(wrong).unwrap_err();
        assert_eq!(error.line, Some(line), "{wrong:?}");
        assert!(error.to_string().contains("instead of `AC3Db`"), "{error}");
    }
}

#[test]
fn line_ends_and_encodings_do_not_matter() {
    let text = format!(
        "{HEAD}OBJECT world\nkids 2\n{}{}",
        poly("name \"Dach Süd\"\ndata 9\none\ntwo\n!\n", 0),
        poly("loc 0 0 1\n", 0)
    );
    let expected = ok(&text);
    assert_eq!(expected.triangles.len(), 2);
    assert_findings(&expected, &[]);
    let utf16 = |unit: fn(u16) -> [u8; 2], mark: bool| -> Vec<u8> {
        let mark: &str = if mark { "\u{feff}" } else { "" };
        mark.encode_utf16().chain(text.encode_utf16()).flat_map(unit).collect()
    };
    let variants: [(&str, Vec<u8>); 10] = [
        ("CRLF", text.replace('\n', "\r\n").into()),
        ("CR", text.replace('\n', "\r").into()),
        ("no last line end", text.trim_end().into()),
        (
            "indented",
            text.replace('\n', "\n\t ")
                .replace("\t one", "one")
                .replace("\t two", "two")
                .replace("\t !", "!")
                .into(),
        ),
        ("BOM", format!("\u{feff}{text}").into()),
        ("BOM and CRLF", format!("\u{feff}{text}").replace('\n', "\r\n").into()),
        ("UTF-16LE", utf16(u16::to_le_bytes, true)),
        ("UTF-16BE", utf16(u16::to_be_bytes, true)),
        ("UTF-16LE without a mark", utf16(u16::to_le_bytes, false)),
        ("UTF-16BE without a mark", utf16(u16::to_be_bytes, false)),
    ];
    for (what, bytes) in variants {
        let mut scene = ac3d::read(&bytes, None, ReadOptions::default()).unwrap_or_else(|e| panic!("{what}: {e}"));
        // The indented variant's data is longer than its count says.
        if what == "indented" {
            scene.ledger.entries.remove("`data` whose length is wrong");
        }
        assert_eq!(scene, expected, "{what}");
    }
    let mut odd = utf16(u16::to_le_bytes, true);
    odd.push(b'x');
    assert_eq!(ac3d::read(&odd, None, ReadOptions::default()).unwrap(), expected);
    // An unpaired surrogate in the name.
    let mut lone = utf16(u16::to_le_bytes, true);
    let place = lone.windows(4).position(|w| w == [b'D', 0, b'a', 0]).unwrap();
    lone[place..place + 2].copy_from_slice(&0xD800u16.to_le_bytes());
    assert_eq!(
        ac3d::read(&lone, None, ReadOptions::default()).unwrap().objects[0],
        "\u{fffd}ach Süd"
    );
    // Latin-1.
    let bytes = text
        .replace("Süd", "S?d")
        .into_bytes()
        .into_iter()
        .map(|b| if b == b'?' { 0xFC } else { b });
    let scene = ac3d::read(&bytes.collect::<Vec<u8>>(), None, ReadOptions::default()).unwrap();
    assert_eq!(scene.objects[0], "Dach S\u{fffd}d");
}

#[test]
fn errors_count_lines_alike_whatever_ends_them() {
    let text = format!("{HEAD}OBJECT poly\ndata 7\none\ntwo\n\nnumvert 1\n0 0 x\n");
    for text in [text.clone(), text.replace('\n', "\r\n"), text.replace('\n', "\r")] {
        assert_eq!(read(&text).unwrap_err().line, Some(9), "{text:?}");
    }
}

#[test]
fn loc_adds_up_through_the_tree() {
    let text = format!(
        "{HEAD}OBJECT world\nloc 100 0 0\nkids 2\nOBJECT group\nloc 0 10 0\nkids 2\n{}{}{}",
        poly("loc 1 0 0\n", 0),
        poly("loc 2 0 0\n", 0),
        poly("loc 3 0 0\n", 0)
    );
    let scene = ok(&text);
    let first: Vec<DVec3> = scene.triangles.iter().map(|t| t.corners[0]).collect();
    assert_eq!(first, [v(101.0, 10.0, 0.0), v(102.0, 10.0, 0.0), v(103.0, 0.0, 0.0)]);
    assert_findings(&scene, &[]);
}

#[test]
fn rot_is_a_row_vector_times_a_matrix() {
    // Rows (0 1 0), (-1 0 0), (0 0 1): x goes to the first row, which is y. The transpose would send it to -y.
    let scene = ok(&format!("{HEAD}{}", poly("rot 0 1 0  -1 0 0  0 0 1\nloc 5 6 7\n", 0)));
    assert_eq!(
        scene.triangles[0].corners,
        [v(5.0, 6.0, 7.0), v(5.0, 7.0, 7.0), v(4.0, 6.0, 7.0)]
    );
    assert_findings(&scene, &[]);
}

#[test]
fn rot_and_loc_nest() {
    let (r1, l1) = ([0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6], [1.0, 2.0, 3.0]);
    let (r2, l2) = ([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [-5.0, 0.5, 9.0]);
    let line = |word: &str, n: &[f64]| {
        format!(
            "{word} {}\n",
            n.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
        )
    };
    let group = format!("OBJECT group\n{}{}kids 1\n", line("rot", &r2), line("loc", &l2));
    // In the child `loc` comes before `rot` and after the vertices: the order does not matter.
    let child = poly("", 0).replace("kids 0\n", &format!("{}{}kids 0\n", line("loc", &l1), line("rot", &r1)));
    let scene = ok(&format!("{HEAD}{group}{child}"));
    // Written out as the formula has it: p R + loc.
    let row_times = |p: [f64; 3], r: [f64; 9], l: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|j| p[0] * r[j] + p[1] * r[3 + j] + p[2] * r[6 + j] + l[j])
    };
    for (corner, p) in scene.triangles[0]
        .corners
        .iter()
        .zip([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    {
        let expected = DVec3::from_array(row_times(row_times(p, r1, l1), r2, l2));
        assert!((*corner - expected).length() < 1e-12, "{corner} {expected}");
    }
    // The other reading gives something else here, so that this test can tell them apart.
    let transposed = DMat3::from_cols_array(&r1).transpose() * DVec3::X;
    assert!((transposed - DVec3::from_array(row_times([1.0, 0.0, 0.0], r1, [0.0; 3]))).length() > 0.1);
}

#[test]
fn a_mirroring_rot_keeps_the_order_of_corners_and_is_counted() {
    let scene = ok(&format!("{HEAD}{}", poly("rot -1 0 0 0 1 0 0 0 1\n", 0)));
    assert_eq!(scene.triangles[0].corners, [DVec3::ZERO, DVec3::NEG_X, DVec3::Y]);
    assert_findings(&scene, &[("object under a mirroring `rot`, turned inside out", 1)]);
    // Mirrored twice is not mirrored.
    let group = "OBJECT group\nrot 1 0 0 0 -1 0 0 0 1\nkids 1\n";
    assert_findings(
        &ok(&format!("{HEAD}{group}{}", poly("rot -1 0 0 0 1 0 0 0 1\n", 0))),
        &[],
    );
}

#[test]
fn kids_that_lie() {
    let more = format!("{HEAD}OBJECT world\nkids 9\n{}{}", poly("", 0), poly("", 7));
    let scene = ok(&more);
    assert_eq!(scene.triangles.len(), 2);
    assert_findings(&scene, &[("`kids` promising more objects than follow", 2)]);

    let fewer = format!(
        "{HEAD}OBJECT world\nloc 50 0 0\nkids 1\n{}{}{}",
        poly("", 0),
        poly("", 0),
        poly("", 0)
    );
    let scene = ok(&fewer);
    let first: Vec<f64> = scene.triangles.iter().map(|t| t.corners[0].x).collect();
    assert_eq!(first, [50.0, 0.0, 0.0], "objects that nobody asked for are top-level");
    assert_findings(&scene, &[("object that no `kids` asked for, read as top-level", 2)]);

    let missing = format!(
        "{HEAD}OBJECT world\nkids 2\n{}{}",
        poly("", 0).replace("kids 0\n", ""),
        poly("", 0)
    );
    let scene = ok(&missing);
    assert_eq!(scene.triangles.len(), 2);
    assert_findings(&scene, &[("object without `kids`", 1)]);
    let scene = ok(missing.trim_end().trim_end_matches("kids 0"));
    assert_eq!(scene.triangles.len(), 2);
    assert_findings(&scene, &[("object without `kids`", 2)]);

    let huge = format!("{HEAD}OBJECT world\nkids 9223372036854775807\n{}", poly("", 0));
    assert_eq!(ok(&huge).triangles.len(), 1);
}

#[test]
fn a_hundred_thousand_levels() {
    let mut text = String::from(HEAD);
    for _ in 0..100_000 {
        text.push_str("OBJECT group\nloc 1 0 0\nkids 1\n");
    }
    text.push_str(&poly("", 0));
    // A stack that a recursive reader would overflow.
    let scene = std::thread::Builder::new()
        .stack_size(128 << 10)
        .spawn(move || ok(&text))
        .unwrap()
        .join()
        .unwrap();
    assert_eq!(scene.triangles[0].corners[0], v(100_000.0, 0.0, 0.0));
    assert_findings(&scene, &[]);
}

#[test]
fn data_is_passed_over_whatever_it_holds() {
    let keywords = "OBJECT poly\nkids 3";
    for (length, text) in [
        (4, "jour\n".to_owned()),
        (5, "jour\n".to_owned()),
        (0, "\n".to_owned()),
        (keywords.len(), format!("{keywords}\n")),
        (7, "\"a\nb\n\"\n\n".to_owned()),
        (1, "\n\n".to_owned()),
    ] {
        let scene = ok(&format!(
            "{HEAD}OBJECT world\nkids 1\n{}",
            poly(&format!("data {length}\n{text}"), 0)
        ));
        assert_eq!(scene.triangles.len(), 1);
        assert_findings(&scene, &[]);
    }
    for (length, text) in [
        ("2", "jour\n"),
        ("30", "jour\n"),
        ("4000000000", "a\nb\nc\n"),
        ("18446744073709551615", ""),
    ] {
        let result = read(&format!(
            "{HEAD}OBJECT world\nkids 1\n{}",
            poly(&format!("data {length}\n{text}"), 0)
        ));
        if length.len() > 19 {
            assert!(result.unwrap_err().to_string().contains("is no count"));
            continue;
        }
        let scene = result.unwrap();
        assert_eq!(scene.triangles.len(), 1, "{length}");
        assert_findings(&scene, &[("`data` whose length is wrong", 1)]);
    }
    // A length that counts the line ends as one byte, and as written.
    for length in [7, 8] {
        let text = format!(
            "{HEAD}OBJECT world\nkids 1\n{}",
            poly(&format!("data {length}\none\ntwo\n"), 0)
        );
        assert_findings(&ok(&text.replace('\n', "\r\n")), &[]);
    }
}

#[test]
fn lying_lengths_take_linear_time() {
    let mut text = format!("{HEAD}OBJECT poly\n");
    for _ in 0..100_000 {
        text.push_str("data 1000000\nx y\rz\r\n");
    }
    let start = Instant::now();
    let scene = ok(&text);
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
    assert!(scene.ledger.get("`data` whose length is wrong") > 50_000);
}

#[test]
fn stray_text_is_skipped_counted_and_named() {
    let properties = "name \"mesh\"\n<<<<<<< HEAD\nloc 1 0 0\ntexture \"a.rgb\"\n=======\nloc 2 0 0\ntexture \
                      \"a.rgb\"\n>>>>>>> topic\nscale 3\n";
    let scene = ok(&format!("{HEAD}OBJECT world\nkids 1\n{}", poly(properties, 0)));
    assert_eq!(scene.triangles[0].corners[0].x, 2.0, "the last `loc` is taken");
    assert_findings(
        &scene,
        &[
            ("line that is no AC3D, skipped", 4),
            ("repeated `loc` in an object, the last taken", 1),
        ],
    );
    assert_eq!(scene.ledger.warnings.len(), 3, "only a few are named");
    assert_eq!(
        scene.ledger.warnings[0],
        "Line 7 was skipped: `<<<<<<<` means nothing there."
    );
    // What belongs into an object means nothing outside, and a hostile word is cut.
    let scene = ok(&format!(
        "{HEAD}name x\nmat 0\n{}\u{7}{}\n{}",
        '\u{1b}',
        "ü".repeat(500),
        poly("", 0)
    ));
    assert_eq!(scene.ledger.get("line that is no AC3D, skipped"), 3);
    assert!(scene.ledger.warnings[2].chars().count() < 140 && !scene.ledger.warnings[2].contains('\u{1b}'));
}

#[test]
fn repeated_properties() {
    let scene = ok(&format!(
        "{HEAD}{}",
        poly(
            "rot 9 0 0 0 9 0 0 0 9\nrot 1 0 0 0 1 0 0 0 1\nname a\nname b\nnumvert 1\n9 9 9\nnumsurf 7\n",
            0
        )
    ));
    assert_eq!(scene.triangles[0].corners[1], DVec3::X);
    assert_eq!(scene.objects, ["b"]);
    assert_findings(
        &scene,
        &[
            ("repeated `numsurf` in an object, the last taken", 1),
            ("repeated `numvert` in an object, the last taken", 1),
            ("repeated `rot` in an object, the last taken", 1),
        ],
    );
}

#[test]
fn surface_types_and_bits() {
    let refs = "mat 0\nrefs 4\n0 0 0\n1 0 0\n2 0 0\n3 0 0\n";
    let quad = [[0, 1, 2], [0, 2, 3]];
    let strip = [[0, 1, 2], [2, 1, 3]];
    let corner = [v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), v(1.0, 1.0, 0.0), v(0.0, 1.0, 0.0)];
    for (flags, two_sided, triangles) in [
        ("0x0", false, Some(quad)),
        ("0x00", false, Some(quad)),
        ("0X10", false, Some(quad)),
        ("16", false, Some(quad)),
        ("0x20", true, Some(quad)),
        ("0x30", true, Some(quad)),
        ("0x14", false, Some(strip)),
        ("0x34", true, Some(strip)),
        ("0x1", false, None),
        ("0x12", false, None),
        ("0x22", false, None),
        ("0x3", false, None),
        ("0xF", false, None),
    ] {
        let scene = ok(&square(&format!("SURF {flags}\n{refs}")));
        let Some(expected) = triangles else {
            let reason = if flags == "0x3" || flags == "0xF" {
                "surface of an unknown type, skipped"
            } else {
                "line element"
            };
            assert_findings(&scene, &[(reason, 1)]);
            assert!(scene.triangles.is_empty() && scene.objects.is_empty() && scene.materials.is_empty());
            continue;
        };
        assert_findings(&scene, &[]);
        assert_eq!(scene.triangles.len(), 2);
        assert!(
            scene.triangles.iter().all(|t| t.two_sided == two_sided && t.face == 0),
            "{flags}"
        );
        if flags.ends_with('4') {
            let corners: Vec<_> = scene.triangles.iter().map(|t| t.corners).collect();
            assert_eq!(corners, expected.map(|t| t.map(|i: usize| corner[i])), "{flags}");
        } else {
            assert!(scene.triangles.iter().all(|t| normal(&t.corners).z > 0.0));
            assert_eq!(area(&scene), 1.0);
        }
    }
}

#[test]
fn a_strip_winds_one_way_and_keeps_triangles_without_area() {
    // Two rows of corners, as a strip zigzags through them.
    let zigzag = "numvert 6\n0 0 0\n0 1 0\n1 0 0\n1 1 0\n2 0 0\n2 1 0\nnumsurf 1\nSURF 0x14\nmat 0\n";
    let refs = |order: &[u32]| {
        let lines: String = order.iter().map(|i| format!("{i} 0.5 0.5 1 1 2 2 3 3\n")).collect();
        format!("{HEAD}OBJECT poly\n{zigzag}refs {}\n{lines}kids 0\n", order.len())
    };
    let scene = ok(&refs(&[1, 0, 3, 2, 5, 4]));
    assert_eq!(scene.triangles.len(), 4);
    assert!(scene.triangles.iter().all(|t| normal(&t.corners).z == 1.0));
    let scene = ok(&refs(&[1, 0, 3, 3, 3, 2, 2, 5, 4]));
    assert_eq!(scene.triangles.len(), 7);
    assert_eq!(
        scene.triangles.iter().filter(|t| normal(&t.corners).z == 0.0).count(),
        5
    );
    assert_findings(&scene, &[]);
    for few in [&[][..], &[0], &[0, 1]] {
        assert_findings(&ok(&refs(few)), &[("face with fewer than 3 corners", 1)]);
    }
}

#[test]
fn faces_are_numbered_in_file_order_with_those_that_are_dropped() {
    let text = format!(
        "{HEAD}OBJECT world\nkids 2\n{}OBJECT poly\nnumvert 4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\nnumsurf 5\nSURF 0x2\nmat \
         0\nrefs 2\n0 0 0\n1 0 0\nSURF 0x0\nmat 0\nrefs 4\n0 0 0\n1 0 0\n2 0 0\n3 0 0\nSURF 0x0\nmat 0\nSURF 0x0\nmat \
         0\nrefs 1\n0 0 0\nSURF 0x0\nmat 0\nrefs 3\n0 0 0\n1 0 0\n2 0 0\nkids 0\n",
        poly("", 0)
    );
    let scene = ok(&text);
    let faces: Vec<u32> = scene.triangles.iter().map(|t| t.face).collect();
    assert_eq!(faces, [0, 2, 2, 5]);
    assert_findings(
        &scene,
        &[
            ("face with fewer than 3 corners", 1),
            ("line element", 1),
            ("surface without `refs`", 1),
        ],
    );
}

#[test]
fn surf_and_mat_may_be_missing_or_swapped() {
    let refs = "refs 3\n0 0 0\n1 0 0\n2 0 0\n";
    let scene = ok(&square(refs));
    assert_eq!((scene.triangles.len(), scene.triangles[0].two_sided), (1, false));
    assert_findings(&scene, &[("surface without `SURF`, read as a one-sided polygon", 1)]);
    let scene = ok(&square(&format!("mat 0\nSURF 0x20\n{refs}")));
    assert!(scene.triangles[0].two_sided);
    assert_findings(&scene, &[]);
}

#[test]
fn a_concave_polygon_keeps_its_area_and_winding() {
    // An L of area 3; a fan from the first corner would cover 5.
    let vertices = ["2 1 0", "1 1 0", "1 2 0", "0 2 0", "0 0 0", "2 0 0"];
    for turned in 0..vertices.len() {
        let lines: String = (0..6).map(|i| format!("{}\n", vertices[(i + turned) % 6])).collect();
        let text = format!(
            "{HEAD}OBJECT poly\nloc 1e6 -1e6 7\nnumvert 6\n{lines}numsurf 1\nSURF 0x20\nmat 0\nrefs 6\n0 0 0\n1 0 0\n2 0 \
             0\n3 0 0\n4 0 0\n5 0 0\nkids 0\n"
        );
        let scene = ok(&text);
        assert_eq!(scene.triangles.len(), 4);
        assert!((area(&scene) - 3.0).abs() < 1e-12, "{}", area(&scene));
        assert!(
            scene
                .triangles
                .iter()
                .all(|t| t.face == 0 && t.two_sided && normal(&t.corners).z >= 0.0)
        );
        assert_findings(&scene, &[]);
    }
}

#[test]
fn numbers_that_are_not_finite_reach_repair() {
    let text = format!("{HEAD}{}", poly("", 0)).replace("1 0 0\n0 1 0\nnumsurf", "nan 1e400 -inf\n0 1 0\nnumsurf");
    let corner = ok(&text).triangles[0].corners[1];
    assert!(corner.is_nan());
    let text = square("SURF 0x0\nmat 0\nrefs 4\n0\n1\n2\n3\n").replace("1 1 0\n0 1 0", "1 1 nan\n0 1 0");
    let scene = ok(&text);
    assert_eq!(scene.triangles.len(), 2);
    assert!(
        scene
            .triangles
            .iter()
            .all(|t| t.corners[1].is_nan() || t.corners[2].is_nan())
    );
    assert_findings(&scene, &[]);
}

#[test]
fn coordinates_stay_f64() {
    let text = format!("{HEAD}{}", poly("loc 2600000.123456789 1200000.000000001 0\n", 0));
    let corner = ok(&text).triangles[0].corners[0];
    assert_eq!(corner, v(2_600_000.123456789, 1_200_000.000000001, 0.0));
}

#[test]
fn materials_only_as_asked_and_in_order_of_first_use() {
    let mut text = String::from("AC3Dc\nMATERIAL \"unused\" rgb 0 0 0 amb 0 0 0 emis 0 0 0 spec 0 0 0 shi 0 trans 0\n");
    text.push_str("MATERIAL \"two words\" rgb 0.1 0.2 0.3 amb 9 9 9 emis 4 5 6 spec 9 9 9 shi 9 trans 9\n");
    text.push_str("MAT \"block\"\nrgb 0.4 0.5 0.6\namb 9 9 9\nemis 0 0 0\ndata 3\nrgb\nshi 1\ntrans 0\nENDMAT\n");
    text.push_str("MATERIAL bare rgb 2 -1 nan\n");
    for material in [2, 1, 2, 3] {
        text.push_str(&poly("", 0).replace("mat 0", &format!("mat {material}")));
    }
    text.push_str(&poly("", 0).replace("mat 0", "mat 4"));
    text.push_str("MATERIAL \"late\" rgb 1.5 -1 0.5 emis 1e9 -2 0\n");
    let plain = ok(&text);
    let names: Vec<&str> = plain.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["block", "two words", "bare", "late"]);
    assert!(
        plain
            .materials
            .iter()
            .all(|m| m.diffuse.is_none() && m.emission.is_none())
    );
    let used: Vec<u32> = plain.triangles.iter().map(|t| t.material).collect();
    assert_eq!(used, [0, 1, 0, 2, 3]);
    assert_eq!(plain.ledger.get("material colour out of range, clamped"), 0);
    let scene = ac3d::read(text.as_bytes(), None, OPTICS).unwrap();
    let colours: Vec<_> = scene.materials.iter().map(|m| (m.diffuse, m.emission)).collect();
    assert_eq!(
        colours,
        [
            (Some([0.4, 0.5, 0.6]), Some([0.0; 3])),
            (Some([0.1, 0.2, 0.3]), Some([4.0, 5.0, 6.0])),
            (None, None),
            (Some([1.0, 0.0, 0.5]), Some([1e9, 0.0, 0.0])),
        ]
    );
    assert_findings(
        &scene,
        &[
            ("material colour out of range, clamped", 3),
            ("material colour that is not three numbers, left out", 1),
            ("object that no `kids` asked for, read as top-level", 4),
        ],
    );
}

#[test]
fn materials_that_are_not_there() {
    for index in ["1", "-1", "4294967296", "9223372036854775807"] {
        let scene = ok(&format!(
            "{HEAD}{}",
            poly("", 0).replace("mat 0", &format!("mat {index}"))
        ));
        assert_eq!(
            (scene.triangles[0].material, scene.materials[0].name.as_str()),
            (0, "white")
        );
        assert_findings(
            &scene,
            &[("surface with a material that is not there, the first taken", 1)],
        );
    }
    let error = read(&format!("AC3Db\n{}", poly("", 0))).unwrap_err();
    assert_eq!(error.line, Some(9));
    assert!(error.to_string().contains("the file has none"), "{error}");
    let scene = ok(&format!("AC3Db\n{}", poly("", 0).replace("mat 0\n", "")));
    assert_eq!(scene.materials, [hemicube_scene::Material::default()]);
    let scene = ok(&format!(
        "AC3Dc\nMAT \"a\"\nrgb 1 1 1\nMAT \"b\"\nENDMAT\n{}",
        poly("", 0)
    ));
    assert_eq!(scene.materials[0].name, "a");
    assert_findings(&scene, &[("material without `ENDMAT`", 1)]);
}

#[test]
fn names() {
    for (line, expected) in [
        ("name \"a b  c\"\n", "a b  c"),
        ("name roof\n", "roof"),
        ("name roof left \n", "roof left"),
        ("name \"a \"quoted\" one\"\n", "a \"quoted\" one"),
        ("name \"open\n", "open"),
        ("name \"\"\n", ""),
        ("name\n", ""),
        ("name \"\n", ""),
        ("", "object 2"),
    ] {
        let scene = ok(&format!("{HEAD}OBJECT world\nkids 1\n{}", poly(line, 0)));
        assert_eq!(scene.objects, [expected], "{line:?}");
    }
}

#[test]
fn properties_without_geometry_are_passed_over_and_others_counted() {
    let quiet = "texture \"a b.png\" base\ntexture empty_texture_no_mapping skids\ntexrep 2 2\ntexoff .5 .5\nurl \
                 \"http\"\ncrease 61.000000\nlocked\nfolded\nsubdiv 0\n";
    assert_findings(&ok(&format!("{HEAD}{}", poly(quiet, 0))), &[]);
    let scene = ok(&format!(
        "{HEAD}OBJECT world\nkids 2\n{}OBJECT light\nloc 0 9 0\nkids 0\n",
        poly("hidden\nsubdiv 2\n", 0)
    ));
    assert_eq!(scene.triangles.len(), 1);
    assert_findings(
        &scene,
        &[
            ("hidden object, read all the same", 1),
            ("light", 1),
            ("subdivision surface read as its control mesh", 1),
        ],
    );
    let lamp = poly("", 0).replace("OBJECT poly", "OBJECT light");
    let odd = poly("", 0).replace("OBJECT poly", "OBJECT nurbs");
    let scene = ok(&format!("{HEAD}OBJECT world\nkids 2\n{lamp}{odd}"));
    assert_eq!(scene.triangles.len(), 1);
    assert_eq!(scene.triangles[0].face, 1);
    assert_findings(
        &scene,
        &[
            ("light", 1),
            ("object of an unknown type, read as `poly`", 1),
            ("surface of a light, skipped", 1),
        ],
    );
}

#[test]
fn counts_that_lie_but_leave_one_reading() {
    let text = format!("{HEAD}{}", poly("", 0));
    for (from, to, finding) in [
        (
            "numvert 3",
            "numvert 4000000000",
            "`numvert` promising more vertices than follow",
        ),
        (
            "numvert 3",
            "numvert 9223372036854775807",
            "`numvert` promising more vertices than follow",
        ),
        (
            "0 1 0\nnumsurf",
            "0 1 0\n9 9 9\nnumsurf",
            "line of numbers beyond the count before it, skipped",
        ),
        (
            "numsurf 1",
            "numsurf 4000000000",
            "`numsurf` promising more surfaces than follow",
        ),
        (
            "numsurf 1",
            "numsurf 0",
            "`numsurf` promising fewer surfaces than follow",
        ),
        (
            "2 0 0\nkids",
            "2 0 0\n0 0 0\nkids",
            "line of numbers beyond the count before it, skipped",
        ),
    ] {
        assert!(text.contains(from));
        let scene = ok(&text.replace(from, to));
        assert_eq!(scene.triangles.len(), 1, "{to}");
        assert_findings(&scene, &[(finding, 1)]);
    }
    assert_findings(&ok(&text.replace("numsurf 1\n", "")), &[]);
}

#[test]
fn where_it_cannot_go_on_the_error_names_the_line() {
    let text = format!("{HEAD}{}", poly("name \"roof\"\n", 0));
    for (from, to, line, message) in [
        (
            "0 1 0\nnumsurf",
            "0 1\nnumsurf",
            8,
            "`` in a vertex of `roof` is no number",
        ),
        (
            "0 1 0\nnumsurf",
            "0 1,5 0\nnumsurf",
            8,
            "`1,5` in a vertex of `roof` is no number",
        ),
        (
            "0 1 0\nnumsurf",
            "<<<<<<< HEAD\nnumsurf",
            8,
            "`<<<<<<<` in a vertex of `roof` is no number",
        ),
        ("numvert 3", "numvert three", 5, "`three` after `numvert` is no count"),
        ("numvert 3", "numvert -3", 5, "`-3` after `numvert` is no count"),
        ("numvert 3", "numvert", 5, "`` after `numvert` is no count"),
        ("numvert 3", "numvert 99999999999999999999", 5, "is no count"),
        (
            "numvert 3",
            "loc 1 2\nnumvert 3",
            5,
            "`` after `loc` is no number; 3 numbers",
        ),
        (
            "numvert 3",
            "rot 1 0 0 0 1 0 0 0 q\nnumvert 3",
            5,
            "`q` after `rot` is no number; 9 numbers",
        ),
        ("numvert 3", "data x\nnumvert 3", 5, "`x` after `data` is no count"),
        ("SURF 0x10", "SURF 0xZZ", 10, "`0xZZ` after `SURF` is no set of flags"),
        ("SURF 0x10", "SURF", 10, "`` after `SURF` is no set of flags"),
        ("mat 0", "mat red", 11, "`red` after `mat` is no material index"),
        (
            "refs 3",
            "refs 4000000000",
            16,
            "`kids` stands where corner 4 of 4000000000 of a surface of `roof` belongs",
        ),
        ("1 0 0\n2 0 0", "a 0 0\n2 0 0", 14, "`a` stands where corner 2 of 3"),
        (
            "1 0 0\n2 0 0",
            "3 0 0\n2 0 0",
            14,
            "vertex 3 is not there: `roof` has 3 vertices",
        ),
        ("1 0 0\n2 0 0", "-1 0 0\n2 0 0", 14, "vertex -1 is not there"),
        (
            "1 0 0\n2 0 0",
            "4294967296 0 0\n2 0 0",
            14,
            "vertex 4294967296 is not there",
        ),
        ("kids 0", "kids many", 16, "`many` after `kids` is no count"),
        (
            "kids 0",
            "numvert 0\nkids 0",
            16,
            "`numvert` stands after surfaces of `roof`",
        ),
        (
            "OBJECT poly\nname \"roof\"\n",
            "",
            3,
            "`numvert` stands outside an object",
        ),
        ("kids 0", "kids 0\nSURF 0x0", 17, "`SURF` stands outside an object"),
        ("kids 0", "kids 0\nrefs 3", 17, "`refs` stands outside an object"),
        ("kids 0", "kids 0\nnumsurf 3", 17, "`numsurf` stands outside an object"),
    ] {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        let error = read(&text.replace(from, to)).expect_err(to);
        assert_eq!(error.line, Some(line), "{to}: {error}");
        assert!(error.to_string().contains(message), "{to}: {error}");
        assert!(matches!(error.kind, ErrorKind::Malformed(_)));
    }
}

#[test]
fn a_file_cut_short_is_refused_wherever_it_would_lose_geometry() {
    let text = format!(
        "{HEAD}OBJECT world\nkids 2\n{}{}",
        poly("name \"a\"\n", 0),
        poly("name \"b\"\n", 0)
    );
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let (mut taken, mut refused) = (0, 0);
    for count in 1..lines.len() {
        // What the file ends in: the last keyword, and how many lines of numbers follow it.
        let keyword = lines[..count]
            .iter()
            .rposition(|l| l.starts_with(char::is_alphabetic))
            .unwrap();
        let numbers = count - 1 - keyword;
        let is_cut_short = match lines[keyword].split_whitespace().next().unwrap() {
            "numvert" | "refs" => numbers < 3,
            "numsurf" | "SURF" | "mat" => true,
            _ => false,
        };
        match read(&lines[..count].concat()) {
            Ok(_) => {
                taken += 1;
                assert!(!is_cut_short, "{}", lines[..count].concat());
            }
            Err(error) => {
                refused += 1;
                assert!(is_cut_short, "{}", lines[..count].concat());
                assert!(
                    error.to_string().contains("it is cut short, get a complete copy"),
                    "{error}"
                );
                assert_eq!(error.line, Some(count as u64));
            }
        }
    }
    assert_eq!((taken, refused), (13, 18));
    // The four places, one by one.
    for (end, place) in [
        ("numvert 3\n0 0 0\n", "after 1 of 3 vertices"),
        ("numsurf 1\n", "after 0 of 1 surfaces"),
        ("SURF 0x10\n", "before the corners of a surface"),
        ("refs 3\n0 0 0\n1 0 0\n", "after 2 of 3 corners of a surface"),
    ] {
        let at = text.find(end).unwrap() + end.len();
        let error = read(&text[..at]).unwrap_err();
        assert!(
            error.to_string().contains(&format!("the file ends in `a` {place}")),
            "{error}"
        );
    }
    assert!(
        read("AC3Dc\nMAT \"a\"\nrgb 1 1 1\n")
            .unwrap_err()
            .to_string()
            .contains("no `ENDMAT`")
    );
}

#[test]
fn a_huge_count_takes_no_memory_and_no_time() {
    let start = Instant::now();
    for count in ["4000000000", "9223372036854775807"] {
        for word in ["numvert", "refs", "kids", "numsurf", "data"] {
            let _ = read(&format!("{HEAD}OBJECT poly\n{word} {count}\n"));
            let _ = read(&format!(
                "{HEAD}OBJECT poly\nnumvert 1\n0 0 0\n{word} {count}\n0 0 0\n0 0 0\n"
            ));
        }
    }
    assert!(start.elapsed() < Duration::from_secs(1));
}

#[test]
fn polygons_with_very_many_corners_end() {
    let count = 60_000;
    let mut text = format!("{HEAD}OBJECT poly\nnumvert {count}\n");
    for i in 0..count {
        let angle = f64::from(i) / f64::from(count) * std::f64::consts::TAU;
        // A star, so that half of the corners are reflex.
        let radius = if i % 2 == 0 { 1.0 } else { 0.9 };
        text.push_str(&format!("{} 0 {}\n", radius * angle.cos(), -radius * angle.sin()));
    }
    text.push_str(&format!("numsurf 1\nSURF 0x0\nmat 0\nrefs {count}\n"));
    for i in 0..count {
        text.push_str(&format!("{i} 0 0\n"));
    }
    text.push_str("kids 0\n");
    let start = Instant::now();
    let scene = ok(&text);
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
    assert_eq!(scene.triangles.len(), count as usize - 2);
}

const WORDS: &[&str] = &[
    "AC3Db",
    "MATERIAL",
    "MAT",
    "ENDMAT",
    "rgb",
    "emis",
    "OBJECT",
    "world",
    "poly",
    "group",
    "light",
    "kids",
    "name",
    "\"a b\"",
    "\"",
    "data",
    "texture",
    "texrep",
    "loc",
    "rot",
    "crease",
    "subdiv",
    "hidden",
    "numvert",
    "numsurf",
    "SURF",
    "0x10",
    "0x34",
    "0x1",
    "mat",
    "refs",
    "0",
    "1",
    "2",
    "3",
    "4",
    "-1",
    "1e400",
    "nan",
    "4000000000",
    "0.5",
    "<<<<<<<",
    "\n",
    "\n",
    "\n",
    "\n",
    "\r\n",
    "\r",
    "\t",
    "\u{0}",
    "\u{feff}",
    "ü",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn word_soup_ends_without_panic(words in proptest::collection::vec(0..WORDS.len(), 0..200), glue in any::<bool>()) {
        let glue = if glue { " " } else { "\n" };
        let soup: Vec<&str> = words.iter().map(|&w| WORDS[w]).collect();
        let start = Instant::now();
        let _ = ac3d::read(format!("{HEAD}{}", soup.join(glue)).as_bytes(), None, OPTICS);
        let _ = ac3d::read(soup.join(glue).as_bytes(), None, OPTICS);
        prop_assert!(start.elapsed() < Duration::from_secs(1));
    }

    #[test]
    fn a_damaged_file_ends_without_panic(
        changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>(), 0..3u8), 1..20),
    ) {
        let mut bytes = format!("{HEAD}OBJECT world\nkids 2\n{}{}", poly("name \"a\"\ndata 3\nx\ny\nloc 1 2 3\n", 1), poly("", 0))
            .into_bytes();
        for (place, value, how) in changes {
            let at = place.index(bytes.len());
            match how {
                0 => bytes[at] = value,
                1 => bytes.insert(at, value),
                _ => bytes.truncate(at.max(1)),
            }
        }
        if let Ok(scene) = ac3d::read(&bytes, None, OPTICS) {
            prop_assert!(scene.triangles.iter().all(|t| (t.object as usize) < scene.objects.len()
                && (t.material as usize) < scene.materials.len()));
        }
    }

    #[test]
    fn bytes_end_without_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), begin in 0..4usize) {
        let begin: &[u8] = [&b""[..], b"AC3Db\n", b"\xFF\xFEA\0C\x003\0D\0b\0\n\0", b"\xFE\xFF"][begin];
        let _ = ac3d::read(&[begin, &bytes].concat(), None, OPTICS);
    }
}

// The real files.

fn scenes() -> Option<PathBuf> {
    let root = std::env::var_os("HEMICUBE_SCENES").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes"),
        PathBuf::from,
    );
    root.join("manifest.tsv").is_file().then_some(root)
}

/// The bytes of a manifest row's file, unpacked; `None`, with a loud line, where that cannot be done here.
fn bytes_of(root: &Path, path: &str) -> Option<Vec<u8>> {
    if let Ok(bytes) = std::fs::read(root.join(path)) {
        return Some(bytes);
    }
    let packed = root.join(format!("{path}.zst"));
    assert!(packed.is_file(), "the manifest names {path}, which is not there");
    if let Some(directory) = std::env::var_os("HEMICUBE_UNPACKED") {
        let name = Path::new(path).file_name().unwrap();
        for unpacked in [Path::new(&directory).join(path), Path::new(&directory).join(name)] {
            if let Ok(bytes) = std::fs::read(unpacked) {
                return Some(bytes);
            }
        }
    }
    match Command::new("zstd").arg("-dcq").arg(&packed).output() {
        Ok(output) if output.status.success() => Some(output.stdout),
        outcome => {
            println!("SKIP {path}: cannot be unpacked; install `zstd` or set HEMICUBE_UNPACKED ({outcome:?})");
            None
        }
    }
}

/// Files with concave polygons, of which the manifest's fans cover some area twice (6.6 % of `fg-truman`). Beside the
/// path the sum of the areas that the polygons' outlines enclose, ½ |Σ pᵢ × pᵢ₊₁| each, by an independent program; and
/// how many triangles fewer than corners − 2 there are, in polygons without area (2 in `fg-clem-superstructure`) or
/// whose outline touches itself.
const CONCAVE: &[(&str, f64, usize)] = &[
    ("ac/fg-KC135.ac", 1571.941132029, 2),
    ("ac/fg-clem-superstructure.ac", 11549.083810586, 5),
    ("ac/fg-truman.ac", 216584.586620090, 0),
];

#[test]
fn real_files_have_the_counts_and_areas_of_the_manifest() {
    let Some(root) = scenes() else {
        println!("SKIP real_files_have_the_counts_and_areas_of_the_manifest: no ../shared/scenes");
        return;
    };
    let manifest = std::fs::read_to_string(root.join("manifest.tsv")).unwrap();
    let mut read = 0;
    for row in manifest.lines().skip(1) {
        let columns: Vec<&str> = row.split('\t').collect();
        let path = columns[0];
        if !(path.ends_with(".ac") || path.ends_with(".acc")) {
            continue;
        }
        let Some(bytes) = bytes_of(&root, path) else { continue };
        let start = Instant::now();
        let scene = ac3d::read(&bytes, None, OPTICS).unwrap_or_else(|e| panic!("{path}: {e}"));
        let seconds = start.elapsed().as_secs_f64();
        let expected_area: f64 = columns[11].parse().unwrap();
        println!(
            "{path}: {} triangles (manifest {}), area {} ({}), {seconds:.3} s, {:?} {:?}",
            scene.triangles.len(),
            columns[2],
            area(&scene),
            expected_area,
            scene.ledger.entries,
            scene.ledger.warnings,
        );
        read += 1;
        let concave = CONCAVE.iter().find(|concave| concave.0 == path);
        let missing = concave.map_or(0, |concave| concave.2);
        assert_eq!((scene.triangles.len() + missing).to_string(), columns[2], "{path}");
        match concave {
            // Corners that are not quite planar have more area than their outline, whichever way they are cut.
            Some((_, outlines, _)) => {
                let excess = area(&scene) / outlines - 1.0;
                assert!(
                    (0.0..0.003).contains(&excess),
                    "{path}: {excess} more than the outlines"
                );
            }
            None => {
                let difference = area(&scene) / expected_area - 1.0;
                assert!(difference.abs() < 1e-6, "{path}: {difference}");
            }
        }
        // The corners of the bounding box, with the four decimals of the manifest.
        let corners = || scene.triangles.iter().flat_map(|t| t.corners);
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        for (found, column) in [(low, columns[9]), (high, columns[10])] {
            let expected: Vec<f64> = column.split(',').map(|n| n.parse().unwrap()).collect();
            for (a, b) in found.to_array().into_iter().zip(expected) {
                assert!(
                    (a - b).abs() <= 1e-4 + 1e-5 * b.abs(),
                    "{path}: {found} is not {column}"
                );
            }
        }
        assert!(
            scene.triangles.iter().any(|t| t.two_sided) != columns[15].contains("twosided_surfs=0"),
            "{path}"
        );
    }
    assert!(read >= 13, "only {read} files were read");
}

#[test]
fn real_files_are_found_to_be_odd_as_they_are() {
    let Some(root) = scenes() else {
        println!("SKIP real_files_are_found_to_be_odd_as_they_are: no ../shared/scenes");
        return;
    };
    let mut expected: BTreeMap<&str, Vec<(&str, u64)>> = BTreeMap::new();
    expected.insert(
        "ac/fg-Buoy-Safe-Water.ac",
        vec![("face with fewer than 3 corners", 16), ("line element", 1)],
    );
    expected.insert("ac/fg-Helgo_Toilets.ac", vec![]);
    expected.insert("ac/fg-KC135.ac", vec![("line element", 20)]);
    expected.insert(
        "ac/fg-cirrus_alt4.ac",
        vec![
            ("line that is no AC3D, skipped", 6),
            ("repeated `loc` in an object, the last taken", 1),
        ],
    );
    expected.insert("ac/fg-jetway-movable-3.ac", vec![("line element", 21)]);
    expected.insert("ac/fg-nimitz.ac", vec![("line element", 8)]);
    expected.insert("ac/fg-truman.ac", vec![("line element", 115)]);
    expected.insert(
        "ac/sd-sc-spirit-300.acc",
        vec![("`kids` promising more objects than follow", 1)],
    );
    expected.insert("ac/torcs-e-track-5.ac", vec![]);
    expected.insert(
        "ac/torcs-street-1.acc",
        vec![("`kids` promising more objects than follow", 1)],
    );
    for (path, ledger) in expected {
        let Some(bytes) = bytes_of(&root, path) else { continue };
        let scene = ac3d::read(&bytes, None, ReadOptions::default()).unwrap();
        // How far their faces are from plane is the modeller's.
        let counts = scene
            .ledger
            .entries
            .iter()
            .map(|(what, loss)| (what.as_str(), loss.count));
        let found: Vec<(&str, u64)> = counts.filter(|(what, _)| !what.contains("far from plane")).collect();
        assert_eq!(found, ledger, "{path}");
    }
}

#[test]
fn the_measured_cornell_box() {
    let Some(root) = scenes() else {
        println!("SKIP the_measured_cornell_box: no ../shared/scenes");
        return;
    };
    let bytes = std::fs::read(root.join("cornell/cornell-measured-closed.ac")).unwrap();
    let scene = ac3d::read(&bytes, None, OPTICS).unwrap();
    assert_eq!(scene.triangles.len(), 40);
    assert_findings(&scene, &[]);
    let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names.len(), 4);
    let light = scene.materials.iter().find(|m| m.name == "light").unwrap();
    assert_eq!(
        (light.diffuse, light.emission),
        (Some([0.78; 3]), Some([1.0, 0.705882, 0.235294]))
    );
    // The box in millimetres, blocks under `loc` within it.
    assert!(
        scene
            .triangles
            .iter()
            .flat_map(|t| t.corners)
            .all(|c| { c.cmpge(DVec3::splat(-1e-9)).all() && c.cmple(v(556.001, 548.801, 559.201)).all() })
    );
}

#[test]
fn strips_of_real_files_face_as_their_normals_do() {
    let Some(root) = scenes() else {
        println!("SKIP strips_of_real_files_face_as_their_normals_do: no ../shared/scenes");
        return;
    };
    let Some(bytes) = bytes_of(&root, "ac/sd-sc-spirit-300.acc") else {
        return;
    };
    // Each vertex line of the file is a position and a normal, which the reader does not keep.
    let mut normal_at: BTreeMap<[u64; 3], Vec<DVec3>> = BTreeMap::new();
    for line in String::from_utf8_lossy(&bytes).lines() {
        let numbers: Vec<f64> = line.split_whitespace().map_while(|w| w.parse().ok()).collect();
        if let [x, y, z, nx, ny, nz] = numbers[..] {
            normal_at
                .entry([x, y, z].map(f64::to_bits))
                .or_default()
                .push(v(nx, ny, nz));
        }
    }
    let scene = ac3d::read(&bytes, None, ReadOptions::default()).unwrap();
    let (mut along, mut against) = (0, 0);
    for triangle in &scene.triangles {
        let Some([only]) = normal_at
            .get(&triangle.corners[0].to_array().map(f64::to_bits))
            .map(Vec::as_slice)
        else {
            continue;
        };
        let normal = normal(&triangle.corners);
        if normal.length() > 1e-9 {
            *(if normal.dot(*only) > 0.0 {
                &mut along
            } else {
                &mut against
            }) += 1;
        }
    }
    println!("{along} triangles face as their first corner's normal, {against} do not");
    assert!(along > 1000 && against * 20 < along);
}

#[test]
fn a_polygon_that_would_take_minutes_to_cut_is_refused() {
    let count = 70_000;
    let mut text = format!("AC3Db\nOBJECT world\nkids 1\nOBJECT poly\nnumvert {count}\n");
    for k in 0..count {
        text.push_str(&format!("{} 0 {}\n", k, (k % 7) * k));
    }
    text.push_str(&format!("numsurf 1\nSURF 0x10\nrefs {count}\n"));
    for k in 0..count {
        text.push_str(&format!("{k} 0 0\n"));
    }
    text.push_str("kids 0\n");
    let error = hemicube_scene::ac3d::read(text.as_bytes(), None, hemicube_scene::ReadOptions::default())
        .expect_err("a polygon of 70,000 corners was cut");
    assert!(error.to_string().contains("70000 corners"), "{error}");
}
