//! Writes a scene as Wavefront OBJ, and its materials as MTL: `v`, `f`, `o`, `usemtl`, `newmtl`, `Kd` and `Ke` lines.
//!
//! Each coordinate has the fewest digits that read back to the same f64, corners of equal bits are one vertex, and each
//! triangle is a face of its own (a polygon would be cut again on reading, perhaps otherwise). A reader gets back the
//! same triangles bit for bit, with the same object and material names; its face numbers count triangles. OBJ has no
//! two-sided triangles.

use crate::{Ledger, Scene};
use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::io::{self, Write};

/// Reason for each two-sided triangle written by [`obj`]: a reader gets its front only.
pub const TWO_SIDED: &str = "two-sided triangle written one-sided";
/// Reason for each object or material name with characters impossible in an OBJ line.
pub const CHANGED_NAME: &str = "name changed for OBJ";

/// Writes a scene as OBJ without naming a material library. Returns the losses ([`TWO_SIDED`], [`CHANGED_NAME`]).
///
/// # Errors
/// When `out` fails; of kind [`io::ErrorKind::InvalidInput`] when a coordinate is not finite or a triangle names an
/// object or a material that the scene does not have. `out` may then hold part of the scene.
///
/// ```
/// use hemicube_scene::{ReadOptions, generate, obj, write};
///
/// let scene = generate::cornell_box();
/// let mut text = Vec::new();
/// let lost = write::obj(&scene, &mut text)?;
/// assert_eq!(lost.get(write::TWO_SIDED), 0);
///
/// // The same triangles and names come back, bit for bit.
/// let read = obj::read(&text, None, ReadOptions::default())?;
/// assert!(read.triangles.iter().map(|t| t.corners).eq(scene.triangles.iter().map(|t| t.corners)));
/// assert_eq!(read.objects, scene.objects);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn obj(scene: &Scene, out: &mut impl Write) -> io::Result<Ledger> {
    write_obj(scene, None, out)
}

/// Writes a scene like [`obj`], with its materials in the file `library` beside it (see [`mtl`]).
///
/// # Errors
/// As [`obj`]; and when `library` is no single file name.
pub fn obj_with_library(scene: &Scene, library: &str, out: &mut impl Write) -> io::Result<Ledger> {
    if library.is_empty() || library.contains('/') || matches!(line_text(library), Cow::Owned(_)) {
        return Err(invalid(format!(
            "`{}` is no name for a material library beside an OBJ file",
            library.escape_debug()
        )));
    }
    write_obj(scene, Some(library), out)
}

/// Writes the materials of a scene as MTL: reflectance as `Kd`, emission as `Ke`, each if the scene has it.
///
/// # Errors
/// When `out` fails; of kind [`io::ErrorKind::InvalidInput`] when a value is not finite.
pub fn mtl(scene: &Scene, out: &mut impl Write) -> io::Result<()> {
    let named = scene.materials.iter().filter(|material| !material.name.is_empty());
    for (n, material) in named.enumerate() {
        if n > 0 {
            writeln!(out)?;
        }
        writeln!(out, "newmtl {}", line_text(&material.name))?;
        for (key, colour) in [("Kd", material.diffuse), ("Ke", material.emission)] {
            let Some(rgb) = colour else { continue };
            if !rgb.iter().all(|c| c.is_finite()) {
                return Err(invalid(format!(
                    "material `{}` has a `{key}` that is not finite",
                    material.name
                )));
            }
            let [r, g, b] = rgb.map(Shortest);
            writeln!(out, "{key} {r} {g} {b}")?;
        }
    }
    Ok(())
}

fn write_obj(scene: &Scene, library: Option<&str>, out: &mut impl Write) -> io::Result<Ledger> {
    let mut ledger = Ledger::default();
    let names = scene
        .objects
        .iter()
        .chain(scene.materials.iter().map(|material| &material.name));
    ledger.note_many(
        CHANGED_NAME,
        names.filter(|n| matches!(line_text(n), Cow::Owned(_))).count() as u64,
    );
    ledger.note_many(TWO_SIDED, scene.triangles.iter().filter(|t| t.two_sided).count() as u64);

    if let Some(library) = library {
        writeln!(out, "mtllib {library}")?;
    }
    let mut vertices: HashMap<[u64; 3], u64> = HashMap::new();
    let mut written = 0;
    let mut material = None;
    let mut faces = Vec::new();
    let mut rest = scene.triangles.as_slice();
    let mut first_object = true;
    while let Some(first) = rest.first() {
        let run = rest.iter().take_while(|t| t.object == first.object).count();
        let (triangles, after) = rest.split_at(run);
        rest = after;
        let object = scene.objects.get(first.object as usize).ok_or_else(|| {
            invalid(format!(
                "a triangle is of object {}; the scene has {}",
                first.object,
                scene.objects.len()
            ))
        })?;
        // Faces before any `o` line have no object name, so an unnamed first object needs none.
        if !(first_object && object.is_empty()) {
            writeln!(out, "{}", format!("o {}", line_text(object)).trim_end())?;
        }
        first_object = false;

        faces.clear();
        for triangle in triangles {
            let mut face = [0; 3];
            for (corner, index) in triangle.corners.iter().zip(&mut face) {
                if !corner.is_finite() {
                    return Err(invalid(format!(
                        "a triangle of object `{object}` has a coordinate that is not finite"
                    )));
                }
                let [x, y, z] = corner.to_array();
                *index = *vertices.entry([x, y, z].map(f64::to_bits)).or_insert(written + 1);
                if *index > written {
                    written = *index;
                    writeln!(out, "v {} {} {}", Shortest(x), Shortest(y), Shortest(z))?;
                }
            }
            faces.push((triangle.material, face));
        }
        for &(of, [a, b, c]) in &faces {
            if material != Some(of) {
                let name = scene
                    .materials
                    .get(of as usize)
                    .map(|m| m.name.as_str())
                    .ok_or_else(|| {
                        invalid(format!(
                            "a triangle is of material {of}; the scene has {}",
                            scene.materials.len()
                        ))
                    })?;
                if material.is_some() || !name.is_empty() {
                    writeln!(out, "{}", format!("usemtl {}", line_text(name)).trim_end())?;
                }
                material = Some(of);
            }
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    Ok(ledger)
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, message)
}

/// A name that fits a line of OBJ: line ends, comments, continuations and outer blanks become `_`.
fn line_text(name: &str) -> Cow<'_, str> {
    let breaks = |c: char| c.is_control() || c == '#' || c == '\\';
    if !name.contains(breaks) && name.trim() == name {
        return Cow::Borrowed(name);
    }
    let text: String = name.chars().map(|c| if breaks(c) { '_' } else { c }).collect();
    let start = text.len() - text.trim_start().len();
    let end = text.trim_end().len();
    Cow::Owned(
        text.char_indices()
            .map(|(at, c)| if at < start || at >= end { '_' } else { c })
            .collect(),
    )
}

/// The fewest digits that read back to the same number, with an exponent where plain digits would run long.
struct Shortest(f64);

impl fmt::Display for Shortest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0.0 || (1e-5..1e16).contains(&self.0.abs()) {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, Triangle};
    use glam::DVec3;

    fn text(scene: &Scene) -> (String, Ledger) {
        let mut out = Vec::new();
        let ledger = obj(scene, &mut out).unwrap();
        (String::from_utf8(out).unwrap(), ledger)
    }

    fn scene(corners: &[[DVec3; 3]], objects: &[&str], materials: &[&str]) -> Scene {
        let last = |names: &[&str]| u32::try_from(names.len()).unwrap() - 1;
        Scene {
            triangles: (0u32..)
                .zip(corners)
                .map(|(face, &corners)| Triangle {
                    corners,
                    object: face.min(last(objects)),
                    material: face.min(last(materials)),
                    face,
                    two_sided: false,
                })
                .collect(),
            objects: objects.iter().map(|&n| n.to_owned()).collect(),
            materials: materials
                .iter()
                .map(|&n| Material {
                    name: n.to_owned(),
                    ..Material::default()
                })
                .collect(),
            ..Scene::default()
        }
    }

    const T: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];
    const U: [DVec3; 3] = [DVec3::X, DVec3::Z, DVec3::Y];

    #[test]
    fn vertices_are_shared_and_names_kept() {
        let (text, ledger) = text(&scene(&[T, U], &["a b", "c"], &["m", "n"]));
        assert_eq!(
            text,
            "o a b\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\no c\nv 0 0 1\nusemtl n\nf 2 4 3\n"
        );
        assert_eq!(ledger, Ledger::default());
    }

    #[test]
    fn unnamed_objects_and_materials_before_and_after_named_ones() {
        let (text, _) = text(&scene(&[T, U, T], &["", "c", ""], &["", "n", ""]));
        let lines: Vec<&str> = text.lines().filter(|l| !l.starts_with("v ")).collect();
        assert_eq!(
            lines,
            ["f 1 2 3", "o c", "usemtl n", "f 2 4 3", "o", "usemtl", "f 1 2 3"]
        );
    }

    #[test]
    fn what_a_line_cannot_hold_is_replaced_and_counted() {
        let (text, ledger) = text(&scene(&[T], &["a\nf 1 1 1"], &[" # \\"]));
        assert!(text.starts_with("o a_f 1 1 1\nv "), "{text}");
        assert!(text.contains("usemtl __ _\n"), "{text}");
        assert_eq!(ledger.get(CHANGED_NAME), 2);
    }

    #[test]
    fn two_sided_triangles_are_counted() {
        let mut scene = scene(&[T, U], &["o"], &["m"]);
        scene.triangles[1].two_sided = true;
        assert_eq!(text(&scene).1.get(TWO_SIDED), 1);
    }

    #[test]
    fn numbers_read_back_to_the_same_bits() {
        for x in [
            0.0,
            -0.0,
            552.8,
            1e-300,
            5e-324,
            f64::MAX,
            -1.0 / 3.0,
            1e16,
            1e-5,
            78_642.123_456_789,
        ] {
            let text = Shortest(x).to_string();
            assert_eq!(text.parse::<f64>().unwrap().to_bits(), x.to_bits(), "{text}");
            assert!(text.len() < 25, "{text}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_finite_number_reads_back_to_the_same_bits(bits: u64) {
            let x = f64::from_bits(bits);
            if x.is_finite() {
                proptest::prop_assert_eq!(Shortest(x).to_string().parse::<f64>().unwrap().to_bits(), bits);
            }
        }
    }

    #[test]
    fn a_scene_that_is_not_sound_is_refused() {
        let bad = |change: fn(&mut Scene)| {
            let mut scene = scene(&[T, U], &["o"], &["m"]);
            change(&mut scene);
            obj(&scene, &mut Vec::new()).unwrap_err().to_string()
        };
        assert!(bad(|s| s.triangles[1].corners[2].y = f64::NAN).contains("not finite"));
        assert!(bad(|s| s.triangles[1].object = 1).contains("object 1"));
        assert!(bad(|s| s.triangles[1].material = 7).contains("material 7"));
        let sound = scene(&[T], &["o"], &["m"]);
        assert!(obj_with_library(&sound, "a\nb.mtl", &mut Vec::new()).is_err());
        assert!(obj_with_library(&sound, "../b.mtl", &mut Vec::new()).is_err());
    }

    #[test]
    fn a_full_disk_is_an_error() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let error = obj(&scene(&[T], &["o"], &["m"]), &mut Full).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    }

    #[test]
    fn materials_with_and_without_optics() {
        let mut scene = scene(&[T], &["o"], &["white", "", "plain"]);
        scene.materials[0].diffuse = Some([0.725, 0.71, 0.68]);
        scene.materials[0].emission = Some([17.0, 0.0, 1e-9]);
        let mut out = Vec::new();
        mtl(&scene, &mut out).unwrap();
        assert_eq!(
            String::from_utf8(out).unwrap(),
            "newmtl white\nKd 0.725 0.71 0.68\nKe 17 0 1e-9\n\nnewmtl plain\n"
        );
    }
}
