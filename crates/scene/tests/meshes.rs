//! Meshes: the same room from every format, files of the programs' own writers, and what damaged files cost.

#![cfg(all(
    feature = "obj",
    feature = "gmsh",
    feature = "vtk",
    feature = "abaqus",
    feature = "energyplus",
    feature = "gbxml"
))]

use glam::DVec3;
use hemicube_scene::{Error, ReadOptions, Scene, abaqus, energyplus, gbxml, gmsh, load, vtk};
use std::alloc::{GlobalAlloc, Layout, System};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

type Read = fn(&[u8], Option<&Path>, ReadOptions) -> Result<Scene, Error>;

/// Counts the bytes that are allocated, and the most at one time.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);
/// Tests of this file run one at a time: the counts are of the process.
static ALONE: Mutex<()> = Mutex::new(());

fn grown(size: usize) {
    let now = NOW.fetch_add(size, Ordering::Relaxed) + size;
    MOST.fetch_max(now, Ordering::Relaxed);
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/meshes").join(name)
}

fn corpus(reader: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(reader);
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

fn open(path: &Path) -> Scene {
    load(path, ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn corners(scene: &Scene) -> Vec<[DVec3; 3]> {
    scene.triangles.iter().map(|t| t.corners).collect()
}

fn objects(scene: &Scene) -> Vec<&str> {
    scene
        .triangles
        .iter()
        .map(|t| scene.objects[t.object as usize].as_str())
        .collect()
}

/// The sum of the areas, and of the vector areas; the latter is 0 over a closed surface.
fn areas(scene: &Scene) -> (f64, DVec3) {
    let vectors = scene
        .triangles
        .iter()
        .map(|t| 0.5 * (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]));
    (vectors.clone().map(DVec3::length).sum(), vectors.sum())
}

/// The volume that a closed surface encloses; negative if it faces inwards.
fn volume(scene: &Scene) -> f64 {
    let of = |t: &[DVec3; 3]| t[0].dot(t[1].cross(t[2])) / 6.0;
    corners(scene).iter().map(of).sum()
}

/// The room of `room.obj`, written by meshio 5.3, Gmsh 4.15 and VTK 9.7, and as input of CalculiX, and whether with the
/// names of objects.
const ROOMS: &[(&str, bool)] = &[
    ("room-22-text.msh", true),
    ("room-22-binary.msh", true),
    ("room-41-text.msh", true),
    ("room-41-binary.msh", true),
    ("meshio-room-42-binary.vtk", false),
    ("meshio-room-42-text.vtk", false),
    ("meshio-room-binary.vtk", false),
    ("meshio-room-inline.vtu", false),
    ("meshio-room-text.vtk", false),
    ("meshio-room-text.vtu", false),
    ("meshio-room-zlib.vtu", false),
    ("room-appended-none.vtp", true),
    ("room-appended-none.vtu", true),
    ("room-appended-zlib.vtp", true),
    ("room-appended-zlib.vtu", true),
    ("room-ascii-none.vtp", true),
    ("room-ascii-none.vtu", true),
    ("room-grid-42-binary.vtk", true),
    ("room-grid-42-text.vtk", true),
    ("room-grid-51-binary.vtk", true),
    ("room-grid-51-text.vtk", true),
    ("room-inline-none-big.vtp", true),
    ("room-inline-none-big.vtu", true),
    ("room-inline-none.vtp", true),
    ("room-inline-none.vtu", true),
    ("room-inline-zlib-big.vtp", true),
    ("room-inline-zlib-big.vtu", true),
    ("room-inline-zlib.vtp", true),
    ("room-inline-zlib.vtu", true),
    ("room-polydata-42-binary.vtk", true),
    ("room-polydata-42-text.vtk", true),
    ("room-polydata-51-binary.vtk", true),
    ("room-polydata-51-text.vtk", true),
    ("room-raw-none-big.vtp", true),
    ("room-raw-none-big.vtu", true),
    ("room-raw-none.vtp", true),
    ("room-raw-none.vtu", true),
    ("room-raw-zlib.vtp", true),
    ("room-raw-zlib.vtu", true),
    ("meshio-room.inp", true),
    ("room.inp", true),
];

#[test]
fn the_same_room_comes_from_every_format() {
    let _alone = ALONE.lock();
    let room = open(&file("room.obj"));
    for &(name, named) in ROOMS {
        let brought = open(&file(name));
        assert_eq!(corners(&brought), corners(&room), "{name}");
        let faces = |scene: &Scene| -> Vec<u32> { scene.triangles.iter().map(|t| t.face).collect() };
        assert_eq!(faces(&brought), faces(&room), "{name}");
        if named {
            assert_eq!(objects(&brought), objects(&room), "{name}");
        }
    }
}

#[test]
fn surface_and_volume_elements_of_gmsh() {
    let _alone = ALONE.lock();
    for path in corpus("gmsh") {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if !["surface", "volume", "second-order", "reversed"]
            .iter()
            .any(|kind| name.contains(kind))
        {
            continue;
        }
        let scene = open(&path);
        if name.contains("reversed") {
            let (area, vector) = areas(&scene);
            assert!(
                (area - 1.0).abs() < 1e-12 && (vector + DVec3::Z).length() < 1e-12,
                "{name}: {vector}"
            );
            continue;
        }
        let (area, vector) = areas(&scene);
        assert!((area - 2.0 * (12.0 + 10.0 + 7.5)).abs() < 1e-9, "{name}: {area}");
        assert!(vector.length() < 1e-9, "{name}: {vector}");
        assert!((volume(&scene) - 30.0).abs() < 1e-9, "{name}: {}", volume(&scene));
        let mut names = scene.objects.clone();
        names.sort();
        if name.contains("volume") {
            assert_eq!(names, ["air"], "{name}");
            assert!(scene.ledger.warnings[0].contains("no surface cells"), "{name}");
        } else {
            assert_eq!(names, ["ceiling", "floor", "walls", "window"], "{name}");
            let of = |object: &str| objects(&scene).iter().filter(|&&name| name == object).count();
            assert!(of("floor") >= 2 && of("window") >= 2, "{name}");
            let second = scene
                .ledger
                .get("element of second order, cut by its mid-side nodes where they are off its edges");
            assert_eq!(second > 0, name.contains("second-order"), "{name}");
            assert_eq!(scene.ledger.losses().count(), 0, "{name}: {}", scene.ledger);
        }
    }
}

#[test]
fn volume_cells_and_strips_of_vtk() {
    let _alone = ALONE.lock();
    for extension in ["vtu", "vtk"] {
        let name = format!("vtk/ok-solid.{extension}");
        let scene = open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(&name));
        // A voxel and two wedges: 2 × 1 × 1.
        let (area, vector) = areas(&scene);
        assert!((area - 10.0).abs() < 1e-12 && vector.length() < 1e-12, "{name}: {area}");
        assert!((volume(&scene) - 2.0).abs() < 1e-12, "{name}: {}", volume(&scene));
        assert_eq!(scene.objects, ["CellEntityIds 5", "CellEntityIds 6"], "{name}");
    }
    for extension in ["vtp", "vtk"] {
        let name = format!("vtk/ok-strip.{extension}");
        let scene = open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(&name));
        let (area, vector) = areas(&scene);
        assert!(
            (vector.length() - area).abs() < 1e-12,
            "{name}: all of the strip faces one way"
        );
        assert_eq!(objects(&scene), ["zone 2"; 3], "{name}");
        assert!(scene.triangles.iter().all(|t| t.face == 1), "{name}: after the vertex");
    }
}

/// Area and vector area of objects, by name without a number at its end.
fn by_group(scene: &Scene) -> BTreeMap<&str, (f64, DVec3)> {
    let mut sums: BTreeMap<&str, (f64, DVec3)> = BTreeMap::new();
    for (name, sum) in by_object(scene) {
        let group = name.trim_end_matches(|c: char| c == ' ' || c.is_ascii_digit());
        let total = sums.entry(group).or_default();
        *total = (total.0 + sum.0, total.1 + sum.1);
    }
    sums
}

/// Area and vector area of each object, by name.
fn by_object(scene: &Scene) -> BTreeMap<&str, (f64, DVec3)> {
    let mut sums = BTreeMap::new();
    for (t, object) in scene.triangles.iter().zip(objects(scene)) {
        let vector = 0.5 * (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]);
        let sum: &mut (f64, DVec3) = sums.entry(object).or_default();
        *sum = (sum.0 + vector.length(), sum.1 + vector);
    }
    sums
}

/// The room of `room.obj` with faces in another order, or from other corners on.
const ARRANGED: &[&str] = &[
    "room-solids.inp",
    "room-assembly.inp",
    "room-faces.obj",
    "room.idf",
    "room-relative.idf",
    "room.epJSON",
    "room.gbxml",
];

#[test]
fn the_same_room_comes_of_solids_instances_and_buildings() {
    let _alone = ALONE.lock();
    let room = open(&file("room.obj"));
    let expected = by_object(&room);
    for &name in ARRANGED {
        let brought = open(&file(name));
        let found = by_group(&brought);
        assert_eq!(
            found.keys().collect::<Vec<_>>(),
            expected.keys().collect::<Vec<_>>(),
            "{name}"
        );
        for (object, &(area, vector)) in &expected {
            let (found_area, found_vector) = found[object];
            assert!((found_area - area).abs() < 1e-12, "{name}: {object}: {found_area}");
            assert!(
                (found_vector - vector).length() < 1e-12,
                "{name}: {object}: {found_vector}"
            );
        }
        let faces = |scene: &Scene| {
            let mut corners: Vec<[i64; 3]> = Vec::new();
            for corner in scene.triangles.iter().flat_map(|t| t.corners) {
                #[allow(clippy::cast_possible_truncation, reason = "a room of metres in units of 10⁻⁹")]
                corners.push((corner * 1e9).round().to_array().map(|x| x as i64));
            }
            corners.sort_unstable();
            corners.dedup();
            (corners, scene.triangles.len(), scene.triangles.last().map(|t| t.face))
        };
        assert_eq!(faces(&brought), faces(&room), "{name}");
    }
}

#[test]
fn sets_surfaces_instances_and_files_of_abaqus() {
    let _alone = ALONE.lock();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/abaqus");
    let scene = |name: &str| open(&folder.join(name));
    for (name, expected) in [
        ("ok-solid.inp", 2.0),
        ("ok-wedges.inp", 2.0),
        ("ok-tetrahedra.inp", 2.0),
    ] {
        let scene = scene(name);
        assert!((volume(&scene) - expected).abs() < 1e-12, "{name}: {}", volume(&scene));
        assert_eq!(scene.objects, ["air"], "{name}");
    }
    // As Gmsh 4.15 writes them: a set for each of its surfaces, and sets of numbers for groups.
    let gmsh = scene("ok-gmsh-surface.inp");
    let sums = by_object(&gmsh);
    assert_eq!(sums.keys().collect::<Vec<_>>(), [&"ceiling", &"floor", &"walls"]);
    assert!((sums["walls"].0 - 35.0).abs() < 1e-9 && (volume(&gmsh) - 30.0).abs() < 1e-9);
    let gmsh = scene("ok-gmsh-volume.inp");
    assert_eq!(gmsh.objects, ["air"]);
    assert!((volume(&gmsh) - 30.0).abs() < 1e-9, "{}", volume(&gmsh));
    let solid = scene("ok-surface-of-solid.inp");
    let sums = by_object(&solid);
    assert_eq!(sums["top"], (2.0, 2.0 * DVec3::Z));
    assert!(
        (sums["skin"].0 - 8.0).abs() < 1e-12,
        "without the top: {:?}",
        sums["skin"]
    );
    assert_eq!(solid.ledger.get("side of several surfaces, put into the first"), 1);
    let both = scene("ok-both-sides.inp");
    assert_eq!(by_object(&both)["up"].1, 12.0 * DVec3::Z);
    assert_eq!(by_object(&both)["down"].1, -12.0 * DVec3::Z);
    assert_eq!(both.ledger.get("edge of a shell in a surface, left out"), 1);
    // A set of all elements comes last; all of `b` only for materials.
    let sets = scene("ok-sets.inp");
    assert_eq!(objects(&sets), ["floor", "floor", "a", "a"]);
    assert_eq!(sets.materials[sets.triangles[3].material as usize].name, "paint");
    let instances = scene("ok-instances.inp");
    let sums = by_object(&instances);
    assert_eq!(sums["I.t"].1, 12.0 * DVec3::Z);
    assert!(
        (sums["J.t"].1 + 12.0 * DVec3::Z).length() < 1e-12,
        "turned over: {:?}",
        sums["J.t"]
    );
    let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-12;
    assert!(near(instances.triangles[3].corners[2], DVec3::new(0.0, -3.0, 5.0)));
    let own = scene("ok-own-instance.inp");
    assert_eq!(own.objects, ["t"]);
    assert_eq!(
        own.triangles[0]
            .corners
            .map(|corner| corner.x)
            .iter()
            .copied()
            .fold(9.0, f64::min),
        1.0
    );
    assert_eq!(by_object(&own)["t"], (24.0, DVec3::ZERO));
}

#[test]
fn the_first_set_of_an_element_names_it_and_others_are_further_names() {
    let deck = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n*ELEMENT, TYPE=S3, ELSET=floor\n1,1,2,3\n2,1,3,4\n\
        *ELEMENT, TYPE=S3, ELSET=roof\n3,1,3,2\n*ELSET, ELSET=warm\n2, 3\n";
    let scene = abaqus::read(deck.as_bytes(), None, ReadOptions::default()).unwrap();
    assert_eq!(objects(&scene), ["floor", "floor + warm", "roof"]);
    let further: Vec<(u32, &[String])> = scene.further_names.iter().map(|(&at, names)| (at, &**names)).collect();
    let [floor, warm] = ["floor", "warm"].map(str::to_owned);
    assert_eq!(further, [(1, &[floor, warm.clone()][..]), (2, &[warm])]);
    // What Gmsh calls a surface of its model is no name that a person gave.
    let gmsh = deck.replace("=floor", "=Surface1").replace("=roof", "=Surface20");
    let scene = abaqus::read(gmsh.as_bytes(), None, ReadOptions::default()).unwrap();
    assert_eq!(objects(&scene), ["Surface1", "warm", "warm"]);
    assert!(scene.further_names.is_empty(), "{:?}", scene.further_names);
}

#[test]
fn files_that_an_input_file_includes() {
    let _alone = ALONE.lock();
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    std::fs::create_dir(folder.path().join("mesh")).unwrap();
    write("mesh/nodes.inp", "*NODE\n1,0,0,0\n2,4,0,0\n3,4,3,0\n4,0,3,0");
    write("elements.txt", "1, 1, 2, 3,\n4\n2, 1, 2, 3, 9\n");
    let main =
        "*INCLUDE, INPUT=mesh\\nodes.inp\n*ELEMENT, TYPE=S4, ELSET=floor, INPUT=elements.txt\n*ELSET,ELSET=a\nb\n";
    write("main.inp", main);
    let read = |name: &str| load(&folder.path().join(name), ReadOptions::default());
    // The error names the included file and its line, and the including one after it.
    let of = |error: Error| error.to_string().replace(&*folder.path().to_string_lossy(), "");
    assert_eq!(
        of(read("main.inp").unwrap_err()).split(": ").next(),
        Some("/main.inp:4")
    );
    write("main.inp", &main.replace("*ELSET,ELSET=a\nb\n", ""));
    let message = of(read("main.inp").unwrap_err());
    assert_eq!(
        message,
        "/elements.txt:3: element 2 has a corner at node 9, which is not there"
    );
    write("elements.txt", "1, 1, 2, 3,\n4\n");
    assert_eq!(read("main.inp").unwrap().objects, ["floor"]);
    write("self.inp", "*INCLUDE, INPUT=self.inp\n");
    assert!(of(read("self.inp").unwrap_err()).starts_with("/self.inp:1: `self.inp` is included a second time"));
    write("out.inp", "*INCLUDE, INPUT=../out.inp\n");
    assert!(of(read("out.inp").unwrap_err()).contains("it leads out of the scene's folder"));
    write("none.inp", "*INCLUDE, INPUT=nothing.inp\n");
    assert!(of(read("none.inp").unwrap_err()).starts_with("/none.inp:1: `nothing.inp` is included and cannot be read"));
}

/// Numbers that look random (Marsaglia, *Xorshift RNGs*, 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 % end as u64).unwrap()
    }
}

/// Words in place of words, for counts, indices, sizes and names.
const WORDS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "3",
    "255",
    "2147483647",
    "4294967296",
    "18446744073709551616",
    "1e308",
    "nan",
    "",
    "\n",
    ",",
    "\"",
];

fn damaged(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(3) {
        let at = random.below(bytes.len() + 1);
        let end = (at + 1 + random.below(40)).min(bytes.len());
        match random.below(7) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..end)),
            2 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            3 => {
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            // Binary counts and sizes of four bytes.
            4 if at + 4 <= bytes.len() => {
                let number = [0, 1, u32::MAX, 0x7fff_ffff, 0x0100_0000][random.below(5)];
                bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
            }
            _ => {
                let word = WORDS[random.below(WORDS.len())].bytes();
                let is_word = |b: &u8| b.is_ascii_alphanumeric() || b".-+".contains(b);
                let end = at + bytes[at..].iter().take_while(|b| is_word(b)).count();
                bytes.splice(at..end, word);
            }
        }
    }
    bytes
}

/// Reads 10,000 mutants of files: none panics, hangs or takes more than ten times its size beside 64 KiB.
fn mutants(extension: &str, reader: &str, read: Read) {
    let _alone = ALONE.lock();
    let has = |path: &PathBuf| path.extension().is_some_and(|found| found == extension);
    let rooms = std::fs::read_dir(file("")).unwrap().map(|entry| entry.unwrap().path());
    let seeds: Vec<(PathBuf, Vec<u8>)> = corpus(reader)
        .into_iter()
        .chain(rooms)
        .filter(has)
        .map(|path| (path.clone(), std::fs::read(&path).unwrap()))
        .collect();
    assert!(seeds.len() > 3, "{} seeds", seeds.len());
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut read_count = 0;
    for mutant in 0..10_000 {
        let (seed, bytes) = &seeds[random.below(seeds.len())];
        let bytes = damaged(bytes, &mut random);
        let of = || format!("mutant {mutant} of {}", seed.display());
        let (started, before) = (Instant::now(), NOW.load(Ordering::Relaxed));
        MOST.store(before, Ordering::Relaxed);
        let scene = std::panic::catch_unwind(|| read(&bytes, None, ReadOptions::default()));
        let taken = MOST.load(Ordering::Relaxed) - before;
        let scene = scene.unwrap_or_else(|_| panic!("{} panicked", of()));
        assert!(
            taken <= 10 * bytes.len() + (1 << 16),
            "{} took {taken} bytes of {}",
            of(),
            bytes.len()
        );
        assert!(
            started.elapsed() < Duration::from_secs(10),
            "{} took {:?}",
            of(),
            started.elapsed()
        );
        match scene {
            Err(error) => {
                let text = error.to_string();
                assert!(
                    !text.is_empty() && !text.contains('\n') && text.len() < 400,
                    "{}: {error}",
                    of()
                );
            }
            Ok(scene) => {
                read_count += 1;
                for triangle in &scene.triangles {
                    assert!((triangle.object as usize) < scene.objects.len(), "{}", of());
                    assert!((triangle.material as usize) < scene.materials.len(), "{}", of());
                }
                assert!(scene.triangles.is_sorted_by_key(|t| t.face), "{}", of());
            }
        }
    }
    // Most damage to JSON and XML breaks all of it.
    assert!(
        (100..9_700).contains(&read_count),
        "{read_count} of 10,000 mutants were read"
    );
}

#[test]
fn mutants_of_gmsh() {
    mutants("msh", "gmsh", gmsh::read);
}

#[test]
fn mutants_of_vtk() {
    for extension in ["vtu", "vtp", "vtk"] {
        mutants(extension, "vtk", vtk::read);
    }
}

#[test]
fn mutants_of_abaqus() {
    mutants("inp", "abaqus", abaqus::read);
}

#[test]
fn mutants_of_energyplus() {
    for extension in ["idf", "epJSON"] {
        mutants(extension, "energyplus", energyplus::read);
    }
}

#[test]
fn mutants_of_gbxml() {
    mutants("gbxml", "gbxml", gbxml::read);
}

/// Files of some megabytes, with little but numbers.
fn large_files() -> Vec<(&'static str, Read, String)> {
    use std::fmt::Write as _;
    let n = 150_u32;
    let [mut inp, mut idf, mut json, mut xml, mut msh, mut vtk, mut names] = [(); 7].map(|()| String::new());
    inp += "*NODE\n";
    write!(msh, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", n * n).unwrap();
    let cells = (n - 1) * (n - 1);
    write!(
        vtk,
        "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS {} float\n",
        n * n
    )
    .unwrap();
    for at in 0..n * n {
        writeln!(inp, "{},{},{},0", at + 1, at % n, at / n).unwrap();
        writeln!(msh, "{} {} {} 0", at + 1, at % n, at / n).unwrap();
        writeln!(vtk, "{} {} 0", at % n, at / n).unwrap();
    }
    write!(msh, "$EndNodes\n$Elements\n{cells}\n").unwrap();
    writeln!(vtk, "POLYGONS {cells} {}", 5 * cells).unwrap();
    inp += "*ELEMENT,TYPE=S4,ELSET=a\n";
    idf += "GlobalGeometryRules,,Counterclockwise,World;\nZone,z;\n";
    json += "{\"Zone\":{\"z\":{}},\"BuildingSurface:Detailed\":{";
    xml += "<gbXML><Campus>";
    for at in 0..n * n - n {
        let (x, y) = (at % n, at / n);
        if x + 1 == n {
            continue;
        }
        writeln!(vtk, "4 {at} {} {} {}", at + 1, at + n + 1, at + n).unwrap();
        let at = at + 1;
        // A surface of its own, and a name of its own.
        writeln!(msh, "{at} 3 2 0 {at} {at} {} {} {}", at + 1, at + n + 1, at + n).unwrap();
        writeln!(names, "{at:x}").unwrap();
        writeln!(inp, "{at},{at},{},{},{}", at + 1, at + n + 1, at + n).unwrap();
        let corners = [(x, y), (x, y + 1), (x + 1, y + 1), (x + 1, y)];
        write!(idf, "Wall:Detailed,{at},,z,,,,,,,").unwrap();
        write!(
            json,
            "{}\"{at}\":{{\"zone_name\":\"z\",\"vertices\":[",
            if at > 1 { "," } else { "" }
        )
        .unwrap();
        write!(xml, "<Surface id=\"{at}\"><PlanarGeometry><PolyLoop>").unwrap();
        for (corner, (x, y)) in corners.into_iter().enumerate() {
            write!(idf, ",{x},{y},0").unwrap();
            let comma = if corner > 0 { "," } else { "" };
            let [px, py, pz] = ["x", "y", "z"].map(|axis| format!("\"vertex_{axis}_coordinate\""));
            write!(json, "{comma}{{{px}:{x},{py}:{y},{pz}:0}}").unwrap();
            let coordinate = |x: u32| format!("<Coordinate>{x}</Coordinate>");
            let (x, y, z) = (coordinate(x), coordinate(y), coordinate(0));
            write!(xml, "<CartesianPoint>{x}{y}{z}</CartesianPoint>").unwrap();
        }
        idf += ";\n";
        json += "]}";
        xml += "</PolyLoop></PlanarGeometry></Surface>\n";
    }
    msh += "$EndElements\n";
    write!(vtk, "CELL_DATA {cells}\nFIELD f 1\nzone 1 {cells} string\n{names}").unwrap();
    json += "}}";
    xml += "</Campus></gbXML>";
    vec![
        ("inp", abaqus::read, inp),
        ("idf", energyplus::read, idf),
        ("epJSON", energyplus::read, json),
        ("gbxml", gbxml::read, xml),
        ("msh", gmsh::read, msh),
        ("vtk", vtk::read, vtk),
    ]
}

#[test]
fn large_files_take_no_more_than_ten_times_their_size() {
    let _alone = ALONE.lock();
    for (name, read, text) in large_files() {
        let before = NOW.load(Ordering::Relaxed);
        MOST.store(before, Ordering::Relaxed);
        let scene = read(text.as_bytes(), None, ReadOptions::default()).unwrap();
        let taken = MOST.load(Ordering::Relaxed) - before;
        assert_eq!(scene.triangles.len(), 149 * 149 * 2, "{name}");
        assert!(taken <= 10 * text.len(), "{name}: {taken} bytes of {}", text.len());
    }
}
