//! Reads input files of Abaqus and CalculiX (`.inp`).
//!
//! Source: *Abaqus Keywords Reference* (2017: `*ELEMENT`, `*ELSET`, `*SURFACE`, `*INSTANCE`) and, for labels of sides,
//! CalculiX 2.22's reader (`surfaces.f`) and tables of sides (`findsurface_se.f`). Files written by Gmsh 4.15 and
//! meshio 5.3 are among the tests; the 355 of CalculiX's own tests (Debian's `calculix-ccx-test`) were read, too.
//!
//! # What becomes of what
//! - `*SURFACE` of elements: where there is one, the scene is the faces of all of them: sides `S1` to `S6` of solids
//!   turned out of them, `SPOS` (`S2`) and `SNEG` (`S1`) of shells, front and back. Without a label: the boundary of
//!   solids, the front of shells. The object is the surface. A side of two surfaces is in the first; what no surface
//!   has is left out, and counted. Surfaces of edges alone, of elements in a plane, are left out with a warning
//! - without surfaces, shells: a face each, quadrilaterals too; its number is the element's position among the shells
//!   and solids of the file, from 0
//! - without surfaces and shells, solids: the sides that belong to one of them only, turned out of it
//! - an element's object without surfaces: the first set in the file that it is in, by its `*ELEMENT` or by an
//!   `*ELSET` that lists its number; further ones are further names. Otherwise a set of a surface in Gmsh's model
//!   (`Surface7`), which stands before the groups of a file of Gmsh; otherwise a set made of sets. A set of all
//!   elements comes last
//! - shells: `S3` to `S9`, `STRI3`, `STRI65`, `DS3` to `DS8`, membranes `M3D3` to `M3D9`, `SFM3D…`, rigid `R3D3` and
//!   `R3D4`, plane `CPS…`, `CPE…` and `DC2D…`, as which Gmsh writes surfaces, and axisymmetric `CAX…`, as which meshio
//!   writes quadrilaterals, with a warning. Solids: `C3D…`, `DC3D…`, `AC3D…`, `SC6`, `SC8` of 4, 5, 6, 8, 10, 13, 15,
//!   18, 20 and 27 nodes. Higher orders are read by their corners
//! - beams, springs and other elements: counted, with a warning; their sides in surfaces and rules for them are
//!   counted
//! - coordinates that are left out are 0; nodes of an element's line beyond its type's are left out, as by CalculiX
//! - `*SHELL SECTION` and its like: the material of its set
//! - `*PART`, `*INSTANCE`: placed (translation, then rotation); sets and surfaces of several instances have the
//!   instance's name before them
//! - `*INCLUDE` and `INPUT=`: files in the folder of the scene or beneath, each once
//! - `*SYSTEM`, cylindrical nodes, `*NGEN`, `*NFILL`, `*NCOPY`, `*ELGEN`, `*ELCOPY`: nodes and elements made by rule,
//!   as written out; parabolas, arcs of half a turn, poles, spherical coordinates, `*NMAP` and reflected solids are an
//!   error. CalculiX knows none of these
//! - `*SURFACE, COMBINE=` and `CROP`: nothing of its own, since its sides are in the surfaces that it is made of
//! - everything else: skipped
//!
//! Names are the same in upper and lower case. By a reader of our own: no crate reads these files.

mod generate;
mod lines;
mod model;
mod resolve;

use crate::bounds::Bounds;
use crate::{Error, ReadOptions, Scene};
use std::path::Path;

/// Reads an Abaqus or CalculiX input file from its bytes.
///
/// # Errors
/// When a line breaks the format, or an element, set or surface names what is missing; the error names the line.
///
/// ```
/// use hemicube_scene::{ReadOptions, abaqus};
///
/// let text = b"*NODE\n1, 0, 0, 0\n2, 4, 0, 0\n3, 4, 3, 0\n4, 0, 3, 0\n\
///     *ELEMENT, TYPE=S4, ELSET=floor\n1, 1, 2, 3, 4\n";
/// let scene = abaqus::read(text, None, ReadOptions::default())?;
/// assert_eq!((scene.triangles.len(), &*scene.objects[0]), (2, "floor"));
/// assert!(scene.triangles.iter().all(|triangle| triangle.face == 0));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn read(bytes: &[u8], base_dir: Option<&Path>, options: ReadOptions) -> Result<Scene, Error> {
    let text = crate::text::unmarked(bytes)?;
    let (model, size) = lines::read(text, base_dir, options)?;
    resolve::scene(model, Bounds::new(size, options))
}

/// Text for an error.
fn shown(text: &str) -> String {
    text.chars().take(40).collect::<String>().escape_debug().to_string()
}
