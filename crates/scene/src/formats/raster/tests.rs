use super::*;
use std::collections::HashMap;

fn read_text(text: &str) -> Result<Scene, Error> {
    read(text.as_bytes(), None, ReadOptions::default())
}

fn grid(columns: usize, rows: usize, heights: &[f64]) -> String {
    let mut text = format!("ncols {columns}\nnrows {rows}\nxllcorner 85000.5\nyllcorner 447000.25\ncellsize 0.7\n");
    for row in heights.chunks(columns) {
        let row: Vec<String> = row.iter().map(f64::to_string).collect();
        text.push_str(&row.join(" "));
        text.push('\n');
    }
    text
}

/// Every edge with the times that triangles run along it, one way less the other.
fn edges(scene: &Scene) -> HashMap<[[u64; 3]; 2], i32> {
    let mut edges = HashMap::new();
    for triangle in &scene.triangles {
        for at in 0..3 {
            let ends = [triangle.corners[at], triangle.corners[(at + 1) % 3]];
            let [from, to] = ends.map(|end| end.to_array().map(f64::to_bits));
            if from < to {
                *edges.entry([from, to]).or_insert(0) += 1;
            } else {
                *edges.entry([to, from]).or_insert(0) -= 1;
            }
        }
    }
    edges
}

fn area(scene: &Scene, object: u32) -> f64 {
    let of = scene.triangles.iter().filter(|triangle| triangle.object == object);
    of.map(|triangle| {
        let [a, b, c] = triangle.corners;
        0.5 * (b - a).cross(c - a).length()
    })
    .sum()
}

/// Heights by a generator of Lehmer's: of a few values, so that some are equal.
fn some_heights(seed: u64, count: usize, values: u64) -> Vec<f64> {
    let mut state = seed;
    let mut next = || {
        state = state * 48271 % 0x7fff_ffff;
        state
    };
    (0..count).map(|_| (next() % values) as f64 * 1.3).collect()
}

#[test]
fn every_edge_but_those_of_the_border_is_that_of_two_faces() {
    for (seed, values) in [(1, 2), (2, 3), (3, 5), (4, 50), (5, 1)] {
        for (columns, rows) in [(1, 1), (7, 5), (12, 13), (1, 9)] {
            let heights = some_heights(seed, columns * rows, values);
            let scene = read_text(&grid(columns, rows, &heights)).expect("a scene");
            let [west, south] = [85000.5, 447000.25];
            let [east, north] = [0.7 * columns as f64, 0.7 * rows as f64];
            let north_edge = south + 0.7 * rows as f64;
            for ([from, to], times) in edges(&scene) {
                let [from, to] = [from, to].map(|end| end.map(f64::from_bits));
                let lies_on = |axis: usize, at: f64| (from[axis] - at).abs() < 1e-6 && (to[axis] - at).abs() < 1e-6;
                let is_border =
                    lies_on(0, west) || lies_on(0, west + east) || lies_on(1, south) || lies_on(1, north_edge);
                assert!(
                    times == 0 || is_border,
                    "{seed} {columns} × {rows}: {from:?} {to:?} {times}"
                );
            }
            // Each cell once from above, and a wall of every difference of neighbours.
            assert!((area(&scene, 0) - east * north).abs() < 1e-9);
            let mut walls = 0.0;
            for row in 0..rows {
                for column in 0..columns {
                    let at = |column: usize, row: usize| heights[row * columns + column];
                    if column + 1 < columns {
                        walls += (at(column, row) - at(column + 1, row)).abs();
                    }
                    if row + 1 < rows {
                        walls += (at(column, row) - at(column, row + 1)).abs();
                    }
                }
            }
            assert!(
                (area(&scene, 1) - 0.7 * walls).abs() < 1e-6 * (1.0 + walls),
                "{seed} {columns} × {rows}"
            );
            assert!(scene.triangles.is_sorted_by_key(|triangle| triangle.face));
            for triangle in &scene.triangles {
                let [a, b, c] = triangle.corners;
                let across = (b - a).cross(c - a);
                assert!(if triangle.object == 0 {
                    across.z > 0.0
                } else {
                    across.z.abs() < 1e-9
                });
                assert!(across.length() > 0.0);
            }
        }
    }
}

#[test]
fn walls_face_the_lower_side() {
    let scene = read_text(&grid(3, 3, &[0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0])).expect("a scene");
    let middle = DVec3::new(85000.5 + 1.05, 447000.25 + 1.05, 0.0);
    for triangle in scene.triangles.iter().filter(|triangle| triangle.object == 1) {
        let [a, b, c] = triangle.corners;
        assert!(
            (b - a).cross(c - a).dot((a + b + c) / 3.0 - middle) > 0.0,
            "{triangle:?}"
        );
    }
}

#[test]
fn level_ground_is_a_few_rectangles_and_nothing_stands_where_there_is_no_value() {
    let flat = read_text(&grid(100, 80, &[2.0; 8000])).expect("a scene");
    assert_eq!(flat.triangles.len(), 2);
    let mut heights = [1.0; 25];
    heights[12] = -9999.0;
    let holed = read_text(&grid(5, 5, &heights)).expect("a scene");
    assert!((area(&holed, 0) - 24.0 * 0.49).abs() < 1e-9);
    assert_eq!(area(&holed, 1), 0.0);
}

#[test]
fn a_header_says_corners_or_middles_and_its_own_value_for_none() {
    let text = "NCOLS 2\r\nNROWS 1\r\nXLLCENTER 10\r\nYLLCENTER 20\r\nDX 2\r\nDY 4\r\nNODATA_VALUE 7\r\n7\r\n3\r\n";
    let scene = read_text(text).expect("a scene");
    let corners: Vec<DVec3> = scene.triangles.iter().flat_map(|triangle| triangle.corners).collect();
    let low = corners.iter().fold(DVec3::INFINITY, |low, &corner| low.min(corner));
    let high = corners
        .iter()
        .fold(DVec3::NEG_INFINITY, |high, &corner| high.max(corner));
    assert_eq!((low, high), (DVec3::new(11.0, 18.0, 3.0), DVec3::new(13.0, 22.0, 3.0)));
}

#[test]
fn what_is_no_height_model_is_said_with_its_line() {
    let header = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    for (text, line, reason) in [
        (format!("{header}1 2\n3\n"), None, "cut short"),
        (format!("{header}1 2\n3 4 5\n"), Some(7), "more than 2 × 2"),
        (format!("{header}1 2\n3 x4\n"), Some(7), "`x4` is no number"),
        (format!("{header}1,5 2 3 4\n"), Some(6), "`1,5` is no number"),
        (format!("{header}1 2 3 inf\n"), None, "infinite"),
        ("ncols 2 3\n".to_owned(), Some(1), "one number"),
        ("nrows 2\n1 2\n".to_owned(), None, "no `ncols`"),
        ("solid scan\n".to_owned(), None, "no `ncols`"),
        (
            header.replace("ncols 2", "ncols 2.5") + "1 2 3 4\n",
            None,
            "whole number",
        ),
        (header.replace("size 1", "size 0") + "1 2 3 4\n", None, "finite size"),
        (header.replace("ncols 2", "ncols 900000000"), None, "cut short"),
    ] {
        let error = read_text(&text).expect_err(&text);
        assert_eq!(error.line, line, "{text}: {error}");
        assert!(error.to_string().contains(reason), "{text}: {error}");
    }
    let error = read(b"\xff\x00\x01", None, ReadOptions::default()).expect_err("binary");
    assert!(error.to_string().contains("GeoTIFF or an ASCII grid"), "{error}");
    assert!(read(b"II*\0", None, ReadOptions::default()).is_err());
}

/// A TIFF with the tags of a GeoTIFF.
fn tiff_of(size: [u32; 2], bands: usize, values: &[f32], keys: &[u16], tie: [f64; 6]) -> Vec<u8> {
    use ::tiff::tags::Tag;
    let place = [
        (Tag::ModelPixelScaleTag, &[2.0, 2.0, 0.0][..]),
        (Tag::ModelTiepointTag, &tie[..]),
    ];
    tiff_at(size, bands, values, keys, &place)
}

/// Likewise, with these tags of where its cells lie.
fn tiff_at(
    size: [u32; 2],
    bands: usize,
    values: &[f32],
    keys: &[u16],
    place: &[(::tiff::tags::Tag, &[f64])],
) -> Vec<u8> {
    use ::tiff::encoder::{TiffEncoder, colortype::Gray32Float};
    use ::tiff::tags::{ExtraSamples, Tag};
    let mut file = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).expect("a file");
    let mut image = encoder.new_image::<Gray32Float>(size[0], size[1]).expect("an image");
    if bands > 1 {
        let more = vec![ExtraSamples::Unspecified; bands - 1];
        image.extra_samples(&more).expect("bands");
    }
    let tags = image.encoder();
    for (tag, numbers) in place {
        tags.write_tag(*tag, *numbers).expect("a tag");
    }
    tags.write_tag(Tag::GeoKeyDirectoryTag, keys).expect("a tag");
    tags.write_tag(Tag::GdalNodata, "-3.4028234663852886e+38")
        .expect("a tag");
    image.write_data(values).expect("values");
    file.into_inner()
}

#[test]
fn a_geotiff_has_its_place_its_system_and_the_ground_as_a_second_band() {
    let keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 28992];
    let tie = [0.0, 0.0, 0.0, 85000.0, 447000.0, 0.0];
    // Ground at 1, a shed of 1.5 m, a house of 6 m, and a cell without a value.
    let values = [1.0, 1.0, 2.5, 1.0, 7.0, 1.0, f32::MIN, 1.0];
    let scene = read(&tiff_of([2, 2], 2, &values, &keys, tie), None, ReadOptions::default()).expect("a scene");
    assert_eq!(scene.objects, ["ground", "roof", "wall"]);
    assert_eq!(scene.crs.as_deref(), Some("EPSG:28992"));
    assert_eq!(
        [area(&scene, 0), area(&scene, 1), area(&scene, 2)],
        [8.0, 4.0, 2.0 * (1.5 + 6.0)]
    );
    let roof = scene
        .triangles
        .iter()
        .find(|triangle| triangle.object == 1)
        .expect("a roof");
    let middle = roof
        .corners
        .iter()
        .fold(DVec3::INFINITY, |low, &corner| low.min(corner));
    assert_eq!(middle, DVec3::new(85000.0, 446996.0, 7.0));
    // The tie is the middle of a cell.
    let mut as_points = keys;
    as_points[11] = 2;
    let shifted = read(
        &tiff_of([2, 2], 2, &values, &as_points, tie),
        None,
        ReadOptions::default(),
    )
    .expect("a scene");
    assert_eq!(
        shifted.triangles[0].corners[0] - scene.triangles[0].corners[0],
        DVec3::new(-1.0, 1.0, 0.0)
    );
}

/// Heights 10 times as large in a file of integers, and a mask of the cells as a second image.
fn scaled(metadata: &str, has_mask: bool) -> Vec<u8> {
    use ::tiff::encoder::TiffEncoder;
    use ::tiff::encoder::colortype::{Gray8, Gray16};
    use ::tiff::tags::Tag;
    let mut file = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).expect("a file");
    let mut image = encoder.new_image::<Gray16>(2, 1).expect("an image");
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[2.0, 2.0, 0.0][..])
        .expect("a tag");
    tags.write_tag(Tag::ModelTiepointTag, &[0.0; 6][..]).expect("a tag");
    tags.write_tag(Tag::Unknown(42112), metadata).expect("a tag");
    image.write_data(&[0, 100]).expect("values");
    if has_mask {
        let mut mask = encoder.new_image::<Gray8>(2, 1).expect("an image");
        mask.encoder().write_tag(Tag::NewSubfileType, 4u32).expect("a tag");
        mask.write_data(&[255, 0]).expect("values");
    }
    file.into_inner()
}

#[test]
fn a_geotiff_has_its_scale_and_offset_and_no_mask() {
    let items = |scale: &str| {
        format!(
            "<GDALMetadata><Item name=\"SCALE\" sample=\"0\" role=\"scale\">{scale}</Item><Item name=\"OFFSET\" \
             sample=\"0\" role=\"offset\">5</Item><Item name=\"AREA\">city</Item></GDALMetadata>"
        )
    };
    let read = |bytes: &[u8]| read(bytes, None, ReadOptions::default());
    let scene = read(&scaled(&items("0.1"), false)).expect("a scene");
    let highest = scene
        .triangles
        .iter()
        .flat_map(|triangle| triangle.corners)
        .map(|corner| corner.z);
    assert_eq!(highest.fold(0.0, f64::max), 15.0);
    let error = read(&scaled(&items("tall"), false)).expect_err("no number");
    assert!(error.to_string().contains("a scale of its heights"), "{error}");
    let error = read(&scaled(&items("0"), false)).expect_err("flat");
    assert!(error.to_string().contains("a scale of its heights"), "{error}");
    // What says nothing of this band, or is no XML, changes nothing.
    for other in ["salt & pepper", &items("2").replace("sample=\"0\"", "sample=\"1\"")] {
        let scene = read(&scaled(other, false)).expect("a scene");
        let highest = scene
            .triangles
            .iter()
            .flat_map(|triangle| triangle.corners)
            .map(|corner| corner.z);
        assert_eq!(highest.fold(0.0, f64::max), 100.0, "{other}");
    }
    let error = read(&scaled(&items("0.1"), true)).expect_err("a mask");
    assert!(error.to_string().contains("has a mask of its cells"), "{error}");
}

/// A picture of 16 bits and three colours with a place.
fn photo(keys: &[u16]) -> Vec<u8> {
    use ::tiff::encoder::{TiffEncoder, colortype::RGB16};
    use ::tiff::tags::Tag;
    let mut file = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).expect("a file");
    let mut image = encoder.new_image::<RGB16>(1, 1).expect("an image");
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[2.0, 2.0, 0.0][..])
        .expect("a tag");
    tags.write_tag(Tag::ModelTiepointTag, &[0.0; 6][..]).expect("a tag");
    tags.write_tag(Tag::GeoKeyDirectoryTag, keys).expect("a tag");
    image.write_data(&[1, 2, 3]).expect("values");
    file.into_inner()
}

#[test]
fn crowns_stand_on_the_ground_where_a_third_band_says_how_high() {
    let keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 28992];
    let nothing = f32::MIN;
    // Surface, ground, canopy; four cells of 2 m from west to east, two rows.
    #[rustfmt::skip]
    let values = [
        1.0, 1.0, 8.0,   1.0, 1.0, 8.0,   1.0, 1.0, 4.0,   1.0, 1.0, 0.0,
        // A house that is higher than one crown and stands in the other, and no surface.
        9.5, 1.0, 8.0,   5.0, 1.0, 8.0,   1.0, 1.0, nothing,   nothing, 1.0, 8.0,
    ];
    let bytes = tiff_of([4, 2], 3, &values, &keys, [0.0; 6]);
    let scene = read(&bytes, None, ReadOptions::default()).expect("a scene");
    assert_eq!(scene.objects, ["ground", "roof", "wall", "canopy"]);
    let crowns: Vec<_> = scene.triangles.iter().filter(|triangle| triangle.object == 3).collect();
    assert!(crowns.iter().all(|triangle| triangle.two_sided));
    assert!(scene.triangles.iter().all(|of| of.object == 3 || !of.two_sided));
    // From 3 to 9 over two cells, from 2 to 5 over one, from the roof at 5 to 9 over one.
    let level = 2.0 * (8.0 + 4.0 + 4.0);
    let height = |low: f64, high: f64| high - low;
    // Sides of 2 m. First crown: two to the north, one to the west, one to the south of the first cell, one to the
    // south of the second beside the crown on the roof, one to the east beside the lower crown.
    let first = 4.0 * height(3.0, 9.0) + height(3.0, 5.0) + height(5.0, 9.0);
    // Second: north, east, south, and below the first.
    let second = 3.0 * height(2.0, 5.0) + height(2.0, 3.0);
    // On the roof: west, south, east.
    let third = 3.0 * height(5.0, 9.0);
    let found = area(&scene, 3);
    // Crowns stand 2 mm off walls and roofs.
    assert!((found - level - 2.0 * (first + second + third)).abs() < 0.02, "{found}");
    // Sides stand inside: those of the wall beside a roof and of two crowns are in no plane of others.
    for triangle in crowns.iter().filter(|triangle| {
        let [a, b, c] = triangle.corners;
        (b - a).cross(c - a).z.abs() < 1e-9
    }) {
        let middle = triangle.corners.iter().sum::<DVec3>() / 3.0;
        let (column, row) = ((middle.x / 2.0).floor(), (-middle.y / 2.0).floor());
        let is_crown = row == 0.0 && (0.0..=2.0).contains(&column) || row == 1.0 && column == 1.0;
        let off = [middle.x / 2.0, middle.y / 2.0].map(|part| (part - part.round()).abs());
        assert!(is_crown && off.iter().any(|off| (off - 1e-3).abs() < 1e-9), "{middle}");
    }
    // Trees without a surface or a ground are said, heights without an end refused.
    let loss = scene.ledger.losses().next().expect("a loss").1;
    assert_eq!((loss.count, loss.area), (1, Some(4.0)));
    let endless = tiff_of([1, 1], 3, &[1.0, 1.0, f32::INFINITY], &keys, [0.0; 6]);
    assert!(read(&endless, None, ReadOptions::default()).is_err());
    // Without the band nothing else changes.
    let two: Vec<f32> = values.chunks(3).flat_map(|cell| [cell[0], cell[1]]).collect();
    let bare = read(&tiff_of([4, 2], 2, &two, &keys, [0.0; 6]), None, ReadOptions::default()).expect("a scene");
    let rest: Vec<_> = scene.triangles.iter().filter(|of| of.object < 3).cloned().collect();
    assert_eq!(bare.triangles, rest);
}

#[test]
fn in_a_folder_a_raster_of_heights_is_a_part_of_the_scene_and_a_picture_is_none() {
    use ::tiff::encoder::TiffEncoder;
    use ::tiff::encoder::colortype::{Gray8, Gray32Float};
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str| folder.path().join(name);
    let keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 28992];
    std::fs::write(file("house.obj"), "v 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\n").expect("a file");
    std::fs::write(file("dem.tif"), tiff_of([2, 2], 1, &[1.0; 4], &keys, [0.0; 6])).expect("a file");
    let grid = "ncols 2\nnrows 1\nxllcorner 10\nyllcorner 0\ncellsize 1\n0 1\n";
    std::fs::write(file("yard.asc"), grid).expect("a file");
    // An orthophoto with a place, a texture without one, and what is no TIFF.
    std::fs::write(file("photo.tif"), photo(&keys)).expect("a file");
    let mut classes = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut classes).expect("a file");
    encoder.write_image::<Gray8>(1, 1, &[7]).expect("an image");
    std::fs::write(file("brick.tif"), classes.into_inner()).expect("a file");
    std::fs::write(file("broken.tif"), "II").expect("a file");
    let files = crate::files(folder.path()).expect("files");
    assert_eq!(files, ["dem.tif", "house.obj", "yard.asc"].map(file));
    let scene = crate::load(folder.path(), ReadOptions::default()).expect("a scene");
    let names = ["dem/surface", "dem/wall", "house", "yard/surface", "yard/wall"];
    assert_eq!(scene.objects, names);
    // Heights that lack their place are no picture, and are not passed over.
    let mut lost = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut lost).expect("a file");
    encoder.write_image::<Gray32Float>(1, 1, &[7.5]).expect("an image");
    std::fs::write(file("lost.tif"), lost.into_inner()).expect("a file");
    let error = crate::load(folder.path(), ReadOptions::default()).expect_err("no place");
    let error = error.to_string();
    assert!(
        error.contains("lost.tif") && error.contains("where its cells lie"),
        "{error}"
    );
    assert_eq!(
        (scene.up, scene.crs.as_deref()),
        (Some(crate::Axis::Z), Some("EPSG:28992"))
    );
}

#[test]
fn a_tiff_without_a_place_in_degrees_or_of_colours_is_refused() {
    let keys = [1, 1, 0, 1, 1024, 0, 1, 2];
    let refused = |bytes: &[u8], reason: &str| {
        let error = read(bytes, None, ReadOptions::default()).expect_err(reason).to_string();
        assert!(error.contains(reason), "{error}");
    };
    refused(&tiff_of([1, 1], 1, &[1.0], &keys, [0.0; 6]), "degrees");
    refused(&photo(&keys), "one band");
    refused(&tiff_of([1, 1], 4, &[1.0; 4], &keys, [0.0; 6]), "other bands");
    let mut file = std::io::Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut file).expect("a file");
    encoder
        .write_image::<::tiff::encoder::colortype::Gray8>(1, 1, &[1])
        .expect("an image");
    refused(&file.into_inner(), "where its cells lie");
}

#[test]
fn a_geotiff_with_south_up_is_named_as_such() {
    use ::tiff::tags::Tag;
    let keys = [1, 1, 0, 1, 1024, 0, 1, 1];
    let refused = |place: &[(Tag, &[f64])], reason: &str| {
        let bytes = tiff_at([1, 2], 1, &[1.0, 2.0], &keys, place);
        let error = read(&bytes, None, ReadOptions::default())
            .expect_err(reason)
            .to_string();
        assert!(
            error.contains(reason) && error.contains("`gdalwarp IN.tif OUT.tif`"),
            "{error}"
        );
    };
    let turned = |dx: f64, dy: f64| {
        let mut matrix = [0.0; 16];
        (matrix[0], matrix[5], matrix[15]) = (dx, dy, 1.0);
        matrix
    };
    let matrix = Tag::ModelTransformationTag;
    refused(&[(matrix, &turned(2.0, 2.0))], "from south to north");
    refused(&[(matrix, &turned(-2.0, -2.0))], "from east to west");
    let tie = (Tag::ModelTiepointTag, &[0.0; 6][..]);
    refused(
        &[(Tag::ModelPixelScaleTag, &[2.0, -2.0, 0.0]), tie],
        "from south to north",
    );
    let north_up = tiff_at([1, 2], 1, &[1.0, 2.0], &keys, &[(matrix, &turned(2.0, -2.0))]);
    assert!(read(&north_up, None, ReadOptions::default()).is_ok());
}

#[test]
fn more_than_four_million_cells_are_refused_before_they_are_taken() {
    let error = super::cells_of(2001, 2000, ReadOptions::default()).expect_err("too many");
    assert!(matches!(error.kind, ErrorKind::TooLarge(_)), "{error}");
    let few = ReadOptions {
        budget: crate::Budget::new(Some(1)),
        ..ReadOptions::default()
    };
    assert!(super::cells_of(10, 10, few).is_err());
}
