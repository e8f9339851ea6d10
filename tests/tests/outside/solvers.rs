//! Matrices in the files of radiation solvers, read back by readers of their own: order, orientation, sums and every
//! value, on a box whose form factors are not symmetric. And `view3d` in View3D's place: its four examples, its control
//! lines, its output forms, its exit status.

mod readers;

use hemicube_tests::readers::petsc_folder;
use hemicube_tests::runs::{Place, Ran, command_in, finish};
use hemicube_tests::scenes::{program, skip, workspace};
use readers::{Dense, calculix, elmer, energyplus, epjson, openfoam, petsc, udales, view3d, view3d_binary};
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// Least difference that a wrong order or orientation makes, and the greatest that text of nine digits leaves.
const FAR: f64 = 1e-2;
const NEAR: f64 = 2e-9;

/// A box of 4 × 3 × 2.5 seen from inside, its floor in two objects: quads, so that faces are not patches.
fn room() -> String {
    let mut text = String::new();
    for z in ["0", "2.5"] {
        for (x, y) in [("0", "0"), ("1", "0"), ("4", "0"), ("4", "3"), ("1", "3"), ("0", "3")] {
            let _ = writeln!(text, "v {x} {y} {z}");
        }
    }
    text + "o floor\nf 2 3 4 5\no hearth\nf 1 2 5 6\no ceiling\nf 7 12 11 8\nf 8 11 10 9\no south\nf 1 7 8 2\n\
            f 2 8 9 3\no east\nf 3 9 10 4\no north\nf 5 11 12 6\nf 4 10 11 5\no west\nf 6 12 7 1\n"
}

/// The names of [`room`]'s surfaces.
const SURFACES: [&str; 7] = ["floor", "hearth", "ceiling", "south", "east", "north", "west"];

/// A folder with the room's matrix, `F`, and the same closed and reciprocal, `B`.
fn computed() -> Place {
    let place = Place::new();
    place.write("room.obj", room());
    place
        .line("compute room.obj -o F --split 2 --tolerance 0.5% --quiet")
        .is(0);
    place.line("balance F -o B --closure --quiet").is(0);
    place
}

/// Areas and form factors of zones, by the table that the program writes of them.
fn zones(place: &Place, store: &str, by: &str) -> (Vec<f64>, Dense) {
    let name = format!("{store}-{by}.csv");
    place
        .line(&format!("export {store} -o {name} --by {by} --overwrite --quiet"))
        .is(0);
    let text = std::fs::read_to_string(place.path(name)).expect("a table");
    let rows: Vec<Vec<String>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let number = |text: &String| text.parse::<f64>().expect("a number");
    let areas = rows.iter().map(|row| number(&row[2])).collect();
    (
        areas,
        rows.iter().map(|row| row[6..].iter().map(number).collect()).collect(),
    )
}

fn read(place: &Place, name: &str) -> Vec<u8> {
    std::fs::read(place.path(name)).expect("a file")
}

fn text(place: &Place, name: &str) -> String {
    String::from_utf8(read(place, name)).expect("text")
}

/// The largest difference of two matrices.
fn apart(a: &Dense, b: &Dense) -> f64 {
    assert_eq!(a.len(), b.len(), "rows");
    let pairs = a.iter().zip(b).flat_map(|(a, b)| {
        assert_eq!(a.len(), b.len(), "columns");
        a.iter().zip(b)
    });
    pairs.fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

fn transposed(matrix: &Dense) -> Dense {
    (0..matrix.len())
        .map(|column| matrix.iter().map(|row| row[column]).collect())
        .collect()
}

/// A file holds the matrix, neither its transpose nor another order of it: for both it must be seen to differ.
#[track_caller]
fn holds(found: &Dense, wanted: &Dense, within: f64) {
    assert!(apart(found, wanted) <= within, "{} apart", apart(found, wanted));
    assert!(apart(&transposed(found), wanted) > FAR, "the transpose would pass, too");
    let mut turned = found.clone();
    turned.reverse();
    turned.iter_mut().for_each(|row| row.reverse());
    assert!(apart(&turned, wanted) > FAR, "another order would pass, too");
}

#[test]
fn files_of_faces_hold_the_matrix_from_row_to_column() {
    let place = computed();
    let (areas, faces) = zones(&place, "B", "face");
    assert_eq!(faces.len(), 10);
    for (i, row) in faces.iter().enumerate() {
        assert!(
            (row.iter().sum::<f64>() - 1.0).abs() < 1e-6,
            "row {i} is of a closed box"
        );
        for (j, factor) in row.iter().enumerate() {
            assert!(
                (areas[i] * factor - areas[j] * faces[j][i]).abs() < 1e-6,
                "({i}, {j}) is reciprocal"
            );
        }
    }

    place
        .line("export B --for elmer -o ViewFactors.dat")
        .is(0)
        .says(&["10 faces", "mesh.boundary"]);
    holds(&elmer(&text(&place, "ViewFactors.dat"), 10), &faces, NEAR);

    place
        .line("export B --for udales -o vfsparse.inp.064")
        .is(0)
        .says(&["lvfsparse = .true.", "reciprocal"]);
    let (found, sky, entries) = udales(&text(&place, "vfsparse.inp.064"), &text(&place, "svf.inp.064"));
    holds(&found, &faces, NEAR);
    for (row, sky) in found.iter().zip(&sky) {
        assert!((row.iter().sum::<f64>() + sky - 1.0).abs() < 1e-6 && *sky >= 0.0);
    }
    let ran = place
        .line("export B --for udales -o vfsparse.inp.064 --overwrite --json")
        .is(0);
    ran.clone().says(&[&format!("nnz = {entries}")]);
    assert_eq!(ran.json()["entries"], entries);

    std::fs::create_dir_all(place.path("case/constant/polyMesh")).expect("a folder");
    place
        .line("export B --for openfoam -o case/constant")
        .is(0)
        .says(&["smoothing false"]);
    let files = ["F", "globalFaceFaces", "mapDist"].map(|name| text(&place, &format!("case/constant/{name}")));
    holds(&openfoam(&files), &faces, NEAR);

    place
        .line("export B --for calculix -o box.vwf")
        .is(0)
        .says(&["*VIEWFACTOR, READ"]);
    let (version, found, outside) = calculix(&read(&place, "box.vwf"));
    assert_eq!(version, "Version 2.20");
    holds(&found, &faces, 1e-15);
    for (row, outside) in found.iter().zip(outside) {
        assert!((row.iter().sum::<f64>() + outside - 1.0).abs() < 1e-6);
    }
    place.line("export B --for calculix:2.21 -o new.vwf").is(0);
    assert_eq!(calculix(&read(&place, "new.vwf")).0, "Version 2.21");
}

#[test]
fn files_of_surfaces_hold_the_matrix_by_name() {
    let place = computed();
    let (areas, objects) = zones(&place, "B", "object");
    for form in ["idf", "epJSON"] {
        let line = format!("export B --for energyplus --zone Room -o factors.{form}");
        place.line(&line).is(0).says(&["7 objects"]);
    }
    let wanted: Vec<String> = SURFACES.map(str::to_owned).to_vec();
    for (zone, names, found) in [
        energyplus(&text(&place, "factors.idf")),
        epjson(
            &text(&place, "factors.epJSON"),
            "zone_or_zonelist_or_space_or_spacelist_name",
        ),
    ] {
        assert_eq!((zone.as_str(), &names), ("Room", &wanted));
        holds(&found, &objects, NEAR);
        for row in &found {
            assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-6);
        }
    }
    place
        .line("export B --for energyplus:9.6 --zone Room -o old.epJSON")
        .is(0);
    epjson(&text(&place, "old.epJSON"), "zone_or_zonelist_name");

    place.line("export B --for view3d -o room.vf").is(0);
    let file = view3d(&text(&place, "room.vf"));
    holds(&file.factors, &objects, 6e-7);
    assert_eq!((file.form, file.encl, file.emit), (0, 0, 0));
    assert!(file.areas.iter().zip(&areas).all(|(a, b)| (a - b).abs() < 1e-5));
    place.line("export B --for view3d-binary -o room.bin").is(0);
    let binary = view3d_binary(&read(&place, "room.bin"));
    holds(&binary.factors, &objects, 1e-7);
    assert_eq!(
        binary.emittances,
        file.emittances.iter().map(|_| f64::from(0.999_f32)).collect::<Vec<_>>()
    );
}

/// Fields of the objects of an IDF.
fn idf_objects(text: &str) -> Vec<Vec<String>> {
    let objects = text.split(';').map(str::trim).filter(|object| !object.is_empty());
    objects
        .map(|object| object.split(',').map(|field| field.trim().to_owned()).collect())
        .collect()
}

/// A street of two long walls on a ground, open above: what a wall's row loses is sky, but for what its foot sees of
/// the ground beyond the street's ends.
#[test]
fn energyplus_reads_sky_ground_and_surfaces_around_exterior_surfaces() {
    let place = Place::new();
    place.write(
        "street.obj",
        "v 0 0 0\nv 8 0 0\nv 8 20 0\nv 0 20 0\nv 0 0 6\nv 8 0 6\nv 8 20 6\nv 0 20 6\no road\nf 1 2 3 4\no west\nf 1 \
         4 8 5\no east\nf 2 6 7 3\n",
    );
    place
        .line("compute street.obj -o S --split 4 --tolerance 0.5% --quiet")
        .is(0);
    place
        .line("export S --for energyplus-outside -o early.idf")
        .is(2)
        .says(&["what of the view is sky", "hemicube sky SCENE --matrix S"]);
    place.line("sky street.obj --matrix S --up z").is(0);
    for name in ["around.idf", "around.epJSON"] {
        let line = format!("export S --for energyplus-outside -o {name}");
        place.line(&line).is(0).says(&["3 objects"]);
    }
    let (areas, dense) = zones(&place, "S", "object");
    let names = ["road", "west", "east"];
    let model: serde_json::Value = serde_json::from_str(&text(&place, "around.epJSON")).expect("JSON");
    let objects = idf_objects(&text(&place, "around.idf"));
    assert_eq!((areas.len(), objects.len()), (3, 6));
    for (at, name) in names.into_iter().enumerate() {
        let around = format!("{name} surroundings");
        let of_surface = &model["SurfaceProperty:LocalEnvironment"][format!("{name} environment")];
        assert_eq!(of_surface["exterior_surface_name"], name);
        assert_eq!(of_surface["surrounding_surfaces_object_name"], around.as_str());
        let json = &model["SurfaceProperty:SurroundingSurfaces"][&around];
        let number = |value: &serde_json::Value| value.as_f64().expect("a number");
        let (sky, ground) = (number(&json["sky_view_factor"]), number(&json["ground_view_factor"]));
        let mut sum = sky + ground;
        for surface in json["surfaces"].as_array().expect("surfaces") {
            let other = surface["surrounding_surface_name"].as_str().expect("a name");
            let to = names.iter().position(|name| *name == other).expect("a surface");
            let factor = number(&surface["surrounding_surface_view_factor"]);
            assert!((factor - dense[at][to]).abs() < 1e-6, "{name} {other}: {factor}");
            assert_eq!(
                surface["surrounding_surface_temperature_schedule_name"],
                format!("{other} temperature")
            );
            sum += factor;
        }
        assert!((sum - 1.0).abs() < 5e-3, "{name}: {sum}");
        // A level road sees nothing below the horizon; a wall does, through the open ends.
        assert_eq!(ground > 0.005, name != "road", "{name}: {ground}");
        // The dictionary's order: name, sky, its schedule, ground, its schedule, then three fields a surface.
        let is_it = |object: &&Vec<String>| object[0].ends_with("SurroundingSurfaces") && object[1] == around;
        let idf = objects.iter().find(is_it).expect("an object");
        let field = |at: usize| idf[at].parse::<f64>().expect("a number");
        assert!(
            (field(2) - sky).abs() < 2e-6 && (field(4) - ground).abs() < 2e-6,
            "{idf:?}"
        );
        assert!(idf[3].is_empty() && idf[5].is_empty() && idf.len() % 3 == 0, "{idf:?}");
        assert_eq!(idf[8], format!("{} temperature", idf[6]));
    }
    place
        .line("export S --for energyplus-outside --zone Z -o zone.idf")
        .is(2)
        .says(&["`--zone` has no meaning"]);
    // The yard sees the back of a wall that faces away: no view factor has it.
    place.write(
        "back.obj",
        "v 0 0 0\nv 8 0 0\nv 8 8 0\nv 0 8 0\nv 0 0 6\nv 0 8 6\no yard\nf 1 2 3 4\no wall\nf 1 5 6 4\n",
    );
    place.line("compute back.obj -o B --split 4 --quiet").is(0);
    place.line("sky back.obj --matrix B --up z").is(0);
    place
        .line("export B --for energyplus-outside -o back.idf")
        .is(0)
        .says(&["backs of one-sided surfaces are in no view factor", "`yard` most"]);
}

#[test]
fn petsc_loads_the_matrix() {
    let place = computed();
    place
        .line("export F --for petsc -o F.petsc")
        .is(0)
        .says(&["80 patches", "petsc4py"]);
    place.line("export F -o F.npy --quiet").is(0);
    let dense: Dense = {
        let bytes = read(&place, "F.npy");
        let values = &bytes[bytes.len() - 4 * 80 * 80..];
        let value = |b: &[u8]| f64::from(f32::from_le_bytes(b.try_into().expect("four bytes")));
        values
            .chunks(320)
            .map(|row| row.chunks(4).map(value).collect())
            .collect()
    };
    let found = petsc(&read(&place, "F.petsc"));
    assert!(apart(&found, &dense) == 0.0 && apart(&transposed(&found), &dense) > FAR);

    let Some(folder) = petsc_folder() else {
        return skip("petsc_loads_the_matrix", "no petsc4py", "HEMICUBE_REQUIRE_SOLVERS");
    };
    let code = "from petsc4py import PETSc\nF = PETSc.Mat().load(PETSc.Viewer().createBinary('F.petsc', 'r'))\n\
                x = F.createVecRight(); x.set(1.0); y = F.createVecLeft(); F.mult(x, y)\nprint(F.getType(), *y.array)";
    let mut python = Command::new("/usr/bin/python3");
    python
        .args(["-c", code])
        .current_dir(place.path(""))
        .env("PETSC_DIR", folder);
    let output = python.output().expect("Debian's Python");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let words = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut words = words.split_whitespace();
    assert_eq!(words.next(), Some("seqaij"));
    let sums: Vec<f64> = words.map(|word| word.parse().expect("a number")).collect();
    assert_eq!(sums.len(), 80);
    for (row, sum) in dense.iter().zip(sums) {
        assert!((row.iter().sum::<f64>() - sum).abs() < 1e-12, "F·1 is ours");
    }
}

#[test]
fn rows_come_in_the_solvers_order() {
    let place = computed();
    let (_, faces) = zones(&place, "B", "face");
    let order = [9, 0, 8, 1, 7, 2, 6, 3, 5, 4];
    place.write("order.txt", order.map(|face: usize| format!("{face}\n")).concat());
    place
        .line("export B --for elmer --order order.txt -o ordered.dat")
        .is(0);
    let wanted: Dense = order.map(|i| order.map(|j| faces[i][j]).to_vec()).to_vec();
    assert!(apart(&elmer(&text(&place, "ordered.dat"), 10), &wanted) < NEAR && apart(&wanted, &faces) > FAR);

    place.write("names.txt", "west\neast\nfloor\nhearth\nnorth\nsouth\nceiling\n");
    place
        .line("export B --for energyplus --zone R --order names.txt -o ordered.idf")
        .is(0);
    assert_eq!(energyplus(&text(&place, "ordered.idf")).1[..2], ["west", "east"]);
    for (lines, expected) in [
        ("0\n1\n1\n", "line 3 of the order: face `1` comes a second time"),
        ("0\n10\n", "line 2 of the order: face `10` is none of those with a row"),
        ("0\n1\n", "the order lacks face `2`"),
    ] {
        place.write("bad.txt", lines);
        place
            .line("export B --for elmer --order bad.txt -o bad.dat")
            .is(2)
            .says(&[expected, "name each face once"]);
        assert!(!place.path("bad.dat").exists());
    }
}

/// A deck as FreeCAD writes it: two loads of one cavity, their faces in no order, two of one element. FreeCAD's
/// `src/Mod/Fem/femsolver/calculix/write_constraint_heatflux.py` of August 2026 was read.
const FREECAD: &str = "*Node, NSET=Nall\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, -2\n5, 0, 0, 3\n6, 2, 0, 3\n\
    7, 0, 2, 3\n8, 0, 0, 4\n9, 5, 0, 3\n10, 8, 0, 3\n11, 5, 3, 3\n12, 5, 0, 4\n\
    *Element, TYPE=C3D4, ELSET=Evolumes\n12, 1, 2, 3, 4\n7, 5, 6, 7, 8\n9, 9, 10, 11, 12\n*STEP\n*HEAT TRANSFER\n\
    *RADIATE, CAVITY=cav\n** HeatFlux.Face1\n12,R1CR,-1,0.9\n12,R4CR,-1,0.9\n\
    *RADIATE, CAVITY=cav\n** HeatFlux001.Face1\n9,R1CR,-1,0.8\n7,R1CR,-1,0.8\n*DFLUX\n9,S2,3\n*END STEP\n";

#[test]
fn the_faces_of_freecads_deck_are_a_scene_in_calculixs_order() {
    let place = Place::new();
    place.write("freecad.inp", FREECAD);
    let faces = |words: &[&str]| {
        Command::new("python3")
            .arg(workspace().join("scripts/radiate_faces.py"))
            .args(words)
            .current_dir(place.path(""))
            .output()
            .expect("Python runs")
    };
    let output = faces(&["freecad.inp", "cavity.inp"]);
    assert_eq!(output.stdout, b"4 faces of 3 elements\n", "{output:?}");
    place.line("compute cavity.inp -o F --quiet").is(0);
    let (areas, _) = zones(&place, "F", "face");
    // Elements 7, 9, and of 12 the face that was named last, first.
    assert_eq!(areas, [2.0, 4.5, 1.0, 0.5]);
    place.line("export F --for calculix -o F.vwf").is(0);
    assert_eq!(calculix(&read(&place, "F.vwf")).1.len(), 4);

    // Of two cavities one is to be named; a deck without any is refused.
    place.write("two.inp", FREECAD.replacen("CAVITY=cav", "CAVITY=other", 1));
    place.write("none.inp", FREECAD.replace("CR,", ","));
    let refused = |words: &[&str]| {
        let output = faces(words);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        String::from_utf8(output.stderr).expect("UTF-8")
    };
    assert!(refused(&["two.inp", "c.inp"]).contains("name one of OTHER, CAV"));
    assert!(refused(&["none.inp", "c.inp"]).contains("no face radiates in a cavity"));
    assert_eq!(faces(&["two.inp", "c.inp", "cav"]).stdout, b"2 faces of 2 elements\n");
    assert!(text(&place, "c.inp").ends_with("*SURFACE, NAME=CAVITY\n7, S1\n9, S1\n"));
}

#[test]
fn what_a_solver_lacks_is_said_with_the_next_step() {
    let place = computed();
    place
        .line("compute room.obj -o P --correction pixel --resolution 16 --quiet")
        .is(0);
    place
        .line("export P --for udales -o vfsparse.inp.001")
        .is(2)
        .says(&["differ by", "hemicube balance P"]);
    place
        .line("export B --for udales -o vfsparse.txt")
        .is(2)
        .says(&["vfsparse.inp.NNN"]);
    place
        .line("export B --for energyplus -o f.idf")
        .is(2)
        .says(&["--zone NAME"]);
    place
        .line("export B --for energyplus --zone R -o f.txt")
        .is(2)
        .says(&[".idf` or `.epJSON"]);
    place.line("export B --for openfoam -o .").is(2).says(&["polyMesh"]);
    place
        .line("export B --for elmer --zone R -o f.dat")
        .is(2)
        .says(&["`--zone` has no meaning"]);
    place.line("export B --for fluent -o f.s2s").is(2).says(&["calculix"]);

    // Joined houses: what lies against the other's wall keeps its number, and no sky is seen of it.
    let mut joined = "solid city\n".to_owned();
    let mut facet = |corners: [[f64; 3]; 3]| {
        joined += "facet normal 0 0 0\nouter loop\n";
        corners.iter().for_each(|[x, y, z]| {
            let _ = writeln!(joined, "vertex {x} {y} {z}");
        });
        joined += "endloop\nendfacet\n";
    };
    let mut quad = |[a, b, c, d]: [[f64; 3]; 4]| {
        facet([a, b, c]);
        facet([a, c, d]);
    };
    for x in [0.0, 1.0] {
        let at = |u: f64, v: f64, w: f64| [x + u, v, w];
        quad([at(0., 0., 1.), at(1., 0., 1.), at(1., 1., 1.), at(0., 1., 1.)]);
        quad([at(0., 0., 0.), at(1., 0., 0.), at(1., 0., 1.), at(0., 0., 1.)]);
        quad([at(1., 1., 0.), at(0., 1., 0.), at(0., 1., 1.), at(1., 1., 1.)]);
        quad([at(1., 0., 0.), at(1., 1., 0.), at(1., 1., 1.), at(1., 0., 1.)]);
        quad([at(0., 1., 0.), at(0., 0., 0.), at(0., 0., 1.), at(0., 1., 1.)]);
    }
    let ground = |x: f64, y: f64, to: [f64; 2]| [[x, y, 0.], [to[0], y, 0.], [to[0], to[1], 0.], [x, to[1], 0.]];
    quad(ground(-3., -3., [5., 0.]));
    quad(ground(-3., 1., [5., 4.]));
    quad(ground(-3., 0., [0., 1.]));
    quad(ground(2., 0., [5., 1.]));
    place.write("joined.stl", joined + "endsolid city\n");
    place.line("compute joined.stl -o J --tolerance 0.5% --quiet").is(0);
    place.line("balance J -o JB --closure --quiet").is(0);
    place
        .line("export JB --for udales -o vfsparse.inp.002")
        .is(0)
        .says(&["no other's front", "touch: 4, the first face `6`"]);
    let (found, sky, _) = udales(&text(&place, "vfsparse.inp.002"), &text(&place, "svf.inp.002"));
    for (facet, (row, sky)) in found.iter().zip(&sky).enumerate() {
        let sum = row.iter().sum::<f64>() + sky;
        let is_covered = [6, 7, 18, 19].contains(&facet);
        assert!(
            (sum - if is_covered { 0.0 } else { 1.0 }).abs() < 1e-3,
            "facet {facet}: {sum}"
        );
    }

    // A hole in the ceiling: rows cannot sum to 1.
    let open = room().replacen("f 7 12 11 8\n", "", 1);
    place.write("open.obj", open);
    place.line("compute open.obj -o O --tolerance 1% --quiet").is(0);
    place.line("export O --for energyplus --zone R -o f.idf").is(2).says(&[
        "escapes",
        "rows must sum to 1",
        "hemicube inspect",
    ]);
    // Two rooms are two enclosures.
    let second = room().replace("\nv ", "\nv 1").replacen("v ", "v 1", 1);
    let mut two = room();
    for line in second.lines() {
        two += &match line.split_once(' ') {
            Some(("f", faces)) => {
                let moved: Vec<String> = faces
                    .split(' ')
                    .map(|v| (v.parse::<u32>().expect("a vertex") + 12).to_string())
                    .collect();
                format!("f {}\n", moved.join(" "))
            }
            Some(("o", name)) => format!("o {name}-2\n"),
            _ => format!("{line}\n"),
        };
    }
    place.write("two.obj", two);
    place.line("compute two.obj -o T --tolerance 1% --quiet").is(0);
    place.line("balance T -o TB --closure --quiet").is(0);
    place
        .line("export TB --for energyplus --zone R -o f.idf")
        .is(2)
        .says(&["are of two enclosures", "each zone by itself"]);
    assert!(!place.path("f.idf").exists());
}

/// View3D's own examples (View3D 4.0.0, `examples`).
const CUBE: &str = "T The unit cube\nC encl=1 list=3\nF 3\nV 1 0. 0. 0.\nV 2 1. 0. 0.\nV 3 1. 1. 0.\nV 4 0. 1. 0.\n\
    V 5 0. 0. 1.\nV 6 1. 0. 1.\nV 7 1. 1. 1.\nV 8 0. 1. 1.\nS 1 1 2 3 4 0 0 0.50 zeq0\nS 2 1 4 8 5 0 0 0.50 xeq0\n\
    S 3 1 5 6 2 0 0 0.50 yeq0\nS 4 7 6 5 8 0 0 0.50 zeq1\nS 5 7 3 2 6 0 0 0.50 xeq1\nS 6 7 8 4 3 0 0 0.50 yeq1\nEnd\n";
const OBSTRUCTION: &str = "T Two squares with a square obstruction in between\nC encl=0 list=3\nF 3\nV 1 0. 0. 0.\n\
    V 2 1. 0. 0.\nV 3 1. 1. 0.\nV 4 0. 1. 0.\nV 5 0. 0. 1.\nV 6 1. 0. 1.\nV 7 1. 1. 1.\nV 8 0. 1. 1.\nV 9 0. 0. .5\n\
    V 10 .5 0. .5\nV 11 .5 .5 .5\nV 12 0. .5 .5\nS 1 1 2 3 4 0 0 0.50 zeq0.0\nS 2 7 6 5 8 0 0 0.50 zeq1.0\n\
    S 3 9 10 11 12 0 0 0.50 zeq0.5\nEnd of data\n";
const L_ROOM: &str = "T L shaped room\nC encl=1 list=2 eps=1.e-4 maxu=8 maxo=8 mino=0 emit=1\nF 3\nV 1 0. 3. 3.\n\
    V 2 1. 3. 3.\nV 3 0. 3. 0.\nV 4 1. 3. 0.\nV 5 0. 1. 0.\nV 6 1. 1. 0.\nV 7 3. 1. 0.\nV 8 0. 0. 0.\nV 9 1. 0. 0.\n\
    V 10 3. 0. 0.\nV 11 0. 0. 3.\nV 12 1. 0. 3.\nV 13 3. 0. 3.\nV 14 0. 1. 3.\nV 15 1. 1. 3.\nV 16 3. 1. 3.\n\
    S 1 11 13 10 8 0 0 0.90 srf-1\nS 2 10 13 16 7 0 0 0.90 srf-2\nS 3 6 7 16 15 0 0 0.90 srf-3\n\
    S 4 4 6 15 2 0 0 0.90 srf-4\nS 5 3 4 2 1 0 0 0.90 srf-5\nS 6 8 3 1 11 0 0 0.90 srf-6\n\
    S 7 11 14 15 12 0 0 0.90 srf-7\nS 8 8 9 6 5 0 0 0.90 srf-8\nS 9 1 2 15 14 0 7 0.90 srf-7b ! combined\n\
    S 10 15 16 13 12 0 7 0.90 srf-7c\nS 11 5 6 4 3 0 8 0.90 srf-8b\nS 12 9 10 7 6 0 8 0.90 srf-8c\nEnd of data\n";
const L_ROOM_IN_PLANES: &str = "T L shaped room\nC  encl=1 list=2 eps=1.e-5\nF  3a\nS 1 R 0 0 0.90 srf-1\n\
    3. 0. 0. 0 90 3. 3.\nS 2 R 0 0 0.90 srf-2\n3. 1. 0. 270 90 1. 3.\nS 3 r 0 0 0.90 srf-3\n1. 1. 0. 180 90 2. 3.\n\
    S 4 R 0 0 0.90 srf-4\n1. 3. 0. 270 90 2. 3.\nS 5 R 0 0 0.90 srf-5\n0. 3. 0. 180 90 1. 3.\n\
    S 6 R 0 0 0.90 srf-6\n0. 0. 0. 90 90 3. 3.\nS 7 Q 0 0 0.90 srf-7\n3. 0. 3. 0 180\n2. 0. 3. 0. 3. 1. 2. 1.\n\
    S 8 Q 0 0 0.90 srf-8\n0. 0. 0. 180 0\n0. 0. 1. 0. 1. 1. 0. 1.\nS 9 Q 0 7 0.90 srf-7b\n3. 0. 3. 0 180\n\
    2. 1. 3. 1. 3. 3. 2. 3.\nS 10 Q 0 7 0.90 srf-7c\n3. 0. 3. 0 180\n0. 0. 2. 0. 2. 1. 0. 1.\n\
    S 11 Q 0 8 0.90 srf-8b\n0. 0. 0. 180. 0.\n0. 1. 1. 1. 1. 3. 0. 3.\nS 12 q 0 8 0.90 srf-8c\n0. 0. 0. 180. 0.\n\
    1. 0. 3. 0. 3. 1. 1. 1.\nEnd of data\n";
/// F between perpendicular rectangles with a common edge of length `edge`, from the one of depth `from` to the one of
/// depth `to` (Siegel & Howell 2002, configuration C-14).
fn perpendicular(edge: f64, from: f64, to: f64) -> f64 {
    let (h, w) = (to / edge, from / edge);
    let (h2, w2, root) = (h * h, w * w, (h * h + w * w).sqrt());
    let first = (1.0 + w2) * (1.0 + h2) / (1.0 + h2 + w2);
    let second = (w2 * (1.0 + w2 + h2) / ((1.0 + w2) * (w2 + h2))).powf(w2);
    let third = (h2 * (1.0 + h2 + w2) / ((1.0 + h2) * (h2 + w2))).powf(h2);
    let angles = w * (1.0 / w).atan() + h * (1.0 / h).atan() - root * (1.0 / root).atan();
    (angles + 0.25 * (first * second * third).ln()) / (std::f64::consts::PI * w)
}

/// F from wall 2 of the L-shaped room to wall 6, past the corner at (1, 1), by midpoints: from y on x = 3, what lies
/// below 1.5 − y / 2 on x = 0 is in sight. The error falls with n⁻²: two of them are extrapolated (Richardson).
fn past_the_corner() -> f64 {
    let sum = |n: u32| {
        let middle = |k: u32, length: f64| length * (f64::from(k) + 0.5) / f64::from(n);
        let mut sum = 0.0;
        for i in 0..n {
            let y = middle(i, 1.0);
            let seen = 1.5 - y / 2.0;
            for j in 0..n {
                let across = 9.0 + (y - middle(j, seen)).powi(2);
                for k in 0..n {
                    for l in 0..n {
                        let r2 = across + (middle(k, 3.0) - middle(l, 3.0)).powi(2);
                        sum += seen / (r2 * r2);
                    }
                }
            }
        }
        // cos cos = 9 / r²; dA dA' = seen · 9 / n⁴, of an area of 3.
        sum * 9.0 * 9.0 / (3.0 * std::f64::consts::PI * f64::from(n).powi(4))
    };
    let (coarse, fine) = (sum(16), sum(32));
    fine + (fine - coarse) / 3.0
}

/// Interchange factors of grey surfaces by following what each emits through its reflections.
fn interchange(factors: &Dense, emittance: f64) -> Dense {
    let count = factors.len();
    let of = |from: usize| {
        let mut arrives = vec![0.0; count];
        for _ in 0..60 {
            let leaves: Vec<f64> = (0..count)
                .map(|k| if k == from { emittance } else { 0.0 } + (1.0 - emittance) * arrives[k])
                .collect();
            arrives = factors
                .iter()
                .map(|row| row.iter().zip(&leaves).map(|(f, j)| f * j).sum())
                .collect();
        }
        arrives.into_iter().map(|h: f64| emittance * h).collect::<Vec<f64>>()
    };
    // Of i's emission j absorbs A_i 𝓕_ij: here it is taken at j, 𝓕_ji.
    transposed(&(0..count).map(of).collect())
}

/// A run of the program by another name, in a folder, as a script would have it.
fn by_name(place: &Place, name: &str, arguments: &[&str]) -> Ran {
    let link = place.path(name);
    if !link.exists() {
        std::os::unix::fs::symlink(program(), &link).expect("a link");
    }
    let mut command = command_in(&link, &place.path(""));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    finish(place.spawn(command))
}

#[test]
fn view3ds_own_examples_have_its_numbers() {
    let place = Place::new();
    let found = |name: &str, scene: &str| {
        place.write("in.vs3", scene);
        by_name(&place, name, &["in.vs3", "out.vf"]).is(0);
        view3d(&text(&place, "out.vf"))
    };
    let cube = found("view3d", CUBE);
    assert_eq!((cube.form, cube.encl, cube.emit, &cube.areas), (0, 1, 0, &vec![1.0; 6]));
    for (i, row) in cube.factors.iter().enumerate() {
        for (j, factor) in row.iter().enumerate() {
            let exact = if i == j {
                0.0
            } else if i % 3 == j % 3 {
                0.199_824_896
            } else {
                0.200_043_776
            };
            assert!((factor - exact).abs() < 1e-6, "F[{i}, {j}] = {factor}");
        }
    }
    let obstruction = found("View3D", OBSTRUCTION);
    assert_eq!((obstruction.encl, obstruction.emittances), (0, vec![0.5; 3]));
    let [first, second, third] = obstruction.factors.as_slice() else {
        panic!("three rows")
    };
    assert!((first[1] - 0.149_868_671_773_8).abs() < 1e-6 && (second[0] - 0.149_868_671_773_8).abs() < 1e-6);
    // Parallel rectangles, offset: what View3D prints. The obstruction faces up.
    assert!((second[2] - 0.103_813).abs() < 1e-5 && (third[1] - 0.415_254).abs() < 1e-5);
    assert_eq!((first[2], third[0]), (0.0, 0.0));

    let planes = found("view3d", L_ROOM_IN_PLANES);
    assert_eq!(planes.areas, [9.0, 3.0, 6.0, 6.0, 3.0, 9.0, 5.0, 5.0]);
    let hidden = past_the_corner();
    // The integral of another program, to its last digit; View3D prints 0.098715 for it.
    assert!((hidden - 0.098_670_742_7).abs() < 1e-7, "{hidden}");
    for (i, j, exact) in [
        (0, 1, perpendicular(3.0, 3.0, 1.0)),
        (3, 4, perpendicular(3.0, 2.0, 1.0)),
        (2, 1, perpendicular(3.0, 2.0, 1.0)),
        (1, 5, hidden),
        (4, 0, hidden),
    ] {
        let found = planes.factors[i][j];
        assert!((found - exact).abs() < 2e-6, "F[{i}, {j}] is {found}, exactly {exact}");
    }
    assert_eq!((planes.encl, planes.emit), (1, 0));
    let black = found("view3d", &L_ROOM.replace("emit=1", ""));
    assert!(apart(&black.factors, &planes.factors) < 1e-5, "both geometry formats");
    let grey = found("view3d", L_ROOM);
    assert_eq!((grey.encl, grey.emit, grey.emittances), (1, 1, vec![0.9; 8]));
    assert!(apart(&grey.factors, &interchange(&black.factors, 0.9)) < 5e-6);
    assert!(apart(&grey.factors, &black.factors) > FAR);
    for row in &grey.factors {
        assert!((row.iter().sum::<f64>() - 0.9).abs() < 5e-6);
    }
    let log = text(&place, "View3D.log");
    assert!(log.contains("Final view factors:") && log.contains("Name: srf-1, sum of view factors:  0.900000"));
}

/// A cube with something on its floor, and a plate that obstructs above it.
fn furnished(covers: &str, rest: &str) -> String {
    CUBE.replace("C encl=1 list=3", "C encl=0 eps=1e-5")
        .replace(
            "S 1 ",
            "V 9 .25 .25 0\nV 10 .5 .25 0\nV 11 .5 .75 0\nV 12 .25 .75 0\nV 13 .2 .2 .5\nV 14 .8 .2 .5\nV 15 .8 .8 .5\n\
         V 16 .2 .8 .5\nV 17 .4 .4 .5\nV 18 .6 .4 .5\nV 19 .6 .6 .5\nV 20 .4 .6 .5\nS 1 ",
        )
        .replace("End", &format!("{covers}\n{rest}\nEnd"))
}

#[test]
fn what_covers_a_part_of_a_surface_has_view3ds_numbers() {
    let place = Place::new();
    let found = |scene: &str| {
        place.write("in.vs3", scene);
        by_name(&place, "view3d", &["in.vs3", "out.vf"]).is(0);
        view3d(&text(&place, "out.vf"))
    };
    // Row 1 is the floor, from z = 0 up. Figures of View3D 4.0.0 with eps=1e-6.
    let masked = found(&furnished("M 7 12 11 10 9 1 0 .4 rug", ""));
    assert_eq!(masked.areas, [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.125]);
    assert_eq!((masked.factors[0][6], masked.factors[6][0]), (0.125, 1.0));
    assert!(masked.factors[6][1..].iter().all(|&factor| factor == 0.0));
    let null = found(&furnished("N 7 12 11 10 9 1 0 .4 rug", ""));
    assert_eq!(null.areas, [0.875, 1.0, 1.0, 1.0, 1.0, 1.0]);
    let rug = found(&furnished("S 7 9 10 11 12 1 0 .4 rug", ""));
    for (j, (&masked, &null)) in masked.factors[0][1..6].iter().zip(&null.factors[0][1..6]).enumerate() {
        // The floor's area has the covered part with a mask, and not with a null surface.
        assert!((masked - 0.875 * null).abs() < 2e-6, "to {}: {masked}, {null}", j + 1);
        assert!((null - rug.factors[0][j + 1]).abs() < 2e-6);
    }
    // A lamp in the middle of a plate that obstructs and has no row; the plate faces up.
    let lamp = found(&furnished("S 7 17 18 19 20 8 0 .4 lamp", "O 8 13 14 15 16"));
    assert_eq!((lamp.areas.len(), lamp.areas[6]), (7, 0.04));
    let up = lamp.factors[6]
        .iter()
        .position(|&factor| factor > 0.5)
        .expect("it sees the ceiling");
    assert!((lamp.factors[6][up] - 0.548_287).abs() < 3e-6, "{:?}", lamp.factors[6]);
    let walls = lamp.factors[6]
        .iter()
        .filter(|&&factor| (factor - 0.112_928).abs() < 3e-6)
        .count();
    assert_eq!((walls, lamp.factors[6][0]), (4, 0.0));
    // A line of no element is passed over, as View3D does, and noted in the log.
    found(&CUBE.replace("F 3\n", "F 3\nglazing 1\n"));
    assert!(text(&place, "View3D.log").contains("`glazing` begins no element"));
}

#[test]
fn view3ds_forms_and_control_lines() {
    let place = Place::new();
    let write = |controls: &str| place.write("in.vs3", CUBE.replace("C encl=1 list=3", controls));
    let run = || by_name(&place, "view3d", &["in.vs3", "out.vf"]);
    write("C out=1 encl=1");
    run().is(0);
    let binary = view3d_binary(&read(&place, "out.vf"));
    assert_eq!((binary.form, binary.encl), (1, 1));
    write("C out=2");
    run().is(0);
    let sparse = text(&place, "out.vf");
    assert_eq!(sparse.lines().count(), 30);
    assert!(sparse.starts_with("1 2 0.2000"), "{sparse}");
    // The subcommand is the same program.
    write("C out=1 encl=1");
    place.line("view3d in.vs3 by-command.vf").is(0);
    assert_eq!(read(&place, "by-command.vf"), {
        run().is(0);
        read(&place, "out.vf")
    });
    // Obstructions have no row and hide what is behind them.
    let scene = OBSTRUCTION
        .replace("S 3 9 10 11 12 0 0 0.50 zeq0.5", "O 3 9 10 11 12")
        .replace("encl=0", "encl=0 eps=1e-5");
    place.write("in.vs3", scene);
    run().is(0);
    let hidden = view3d(&text(&place, "out.vf"));
    assert_eq!(hidden.areas.len(), 2);
    assert!((hidden.factors[0][1] - 0.149_868_671_773_8).abs() < 1e-6);
    // A row is told in the log, and nothing written.
    write("C row=1 col=4");
    run().is(0);
    assert_eq!(text(&place, "out.vf"), "");
    assert!(
        text(&place, "View3D.log").contains("F[1][4] = 1.99825e-1"),
        "{}",
        text(&place, "View3D.log")
    );

    // A file that View3D refuses ends with its status, 1, and the reason in the log.
    by_name(&place, "view3d", &["missing.vs3", "out.vf"])
        .is(1)
        .says(&["missing.vs3"]);
    assert!(text(&place, "View3D.log").contains("FATAL"));
    for arguments in [&["?"][..], &[], &["a", "b", "c"]] {
        by_name(&place, "view3d", arguments)
            .is(1)
            .says(&["usage: view3d <input file> <output file>"]);
    }
    write("C out=3");
    run().is(1).says(&["in.vs3:2: out=3 is no form of output"]);
    by_name(&place, "view3d", &["in.vs3", "in.vs3"])
        .is(2)
        .says(&["which is to be read"]);
    // A surface that faces outwards sees nothing: no enclosure.
    place.write("in.vs3", CUBE.replace("S 1 1 2 3 4", "S 1 4 3 2 1"));
    run().is(1).says(&["surface 1 (`zeq0`) sees nothing"]);
    assert!(Path::new(&place.path("View3D.log")).exists());
}
