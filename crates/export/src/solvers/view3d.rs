//! View3D's view factor file, text (`out=0`), binary (`out=1`) and sparse (`out=2`, of uDALES' View3D).
//!
//! Read: View3D 4.0.0, `src/savevf.c` (the writer), `src/readvf.c` (the reader of View3D's own programs: header by
//! `"%s %s %d %d %d %d"` from its first 30 characters, then areas, rows, emittances; the lower triangle only, where a
//! triangular array is wanted: F must be reciprocal there), its manual (`view3d-manual.tex`), and uDALES' fork,
//! `src/savevf.c` (`out=2`).
//!
//! ```text
//! View3D VERSION OUT ENCL EMIT N         30 characters, then a line end; CR and LF in the binary file
//! areas                                  N numbers; f32, little-endian, in the binary file
//! N rows of N                            six decimals; f32
//! emittances                             three decimals; f32
//! ```

use super::{SolverJob, SolverWriter};
use crate::Result;
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::Cancellable;
use hemicube_solve::analysis::zones::GroupBy;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Emittance of a face without one: View3D's limit, black.
const BLACK: f64 = 0.999;
/// Least form factor in a sparse file: what six decimals round to one.
const SPARSE_MIN: f64 = 5e-7;

/// Form of View3D's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View3dForm {
    /// `out=0`
    Text,
    /// `out=1`
    Binary,
    /// `out=2`: lines `i j F` from 1, without header.
    Sparse,
}

impl View3dForm {
    /// The form of a number `out`.
    pub fn of(out: u64) -> Option<Self> {
        [Self::Text, Self::Binary, Self::Sparse]
            .get(usize::try_from(out).ok()?)
            .copied()
    }

    fn out(self) -> u8 {
        match self {
            Self::Text => 0,
            Self::Binary => 1,
            Self::Sparse => 2,
        }
    }
}

/// Head of a View3D file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View3dHead {
    /// The form.
    pub form: View3dForm,
    /// True if rows were adjusted to an enclosure.
    pub encl: bool,
    /// True if emittances are in the factors.
    pub emit: bool,
}

/// Writes a View3D file: `row(i)` gives the ascending columns and values of row i.
///
/// # Errors
/// When `out` fails or `row` does.
pub fn write_view3d<E: From<io::Error>>(
    out: &mut impl Write,
    head: View3dHead,
    areas: &[f64],
    emittances: &[f64],
    mut row: impl FnMut(usize) -> std::result::Result<Vec<(u32, f64)>, E>,
) -> std::result::Result<(), E> {
    let count = areas.len();
    let binary = head.form == View3dForm::Binary;
    // Areas, emittances and values with single precision, as View3D holds them.
    #[allow(clippy::cast_possible_truncation, reason = "View3D's numbers are f32")]
    let single = |number: f64| number as f32;
    let line = |numbers: Vec<String>| numbers.join(" ") + "\n";
    if head.form != View3dForm::Sparse {
        let name = format!(
            "View3D hc{} {} {} {} {count}",
            env!("CARGO_PKG_VERSION"),
            head.form.out(),
            u8::from(head.encl),
            u8::from(head.emit)
        );
        write!(out, "{name:30}{}", if binary { "\r\n" } else { "\n" })?;
        match binary {
            true => areas
                .iter()
                .try_for_each(|&area| out.write_all(&single(area).to_le_bytes()))?,
            false => out.write_all(line(areas.iter().map(|&area| single(area).to_string()).collect()).as_bytes())?,
        }
    }
    let mut text = String::new();
    for place in 0..count {
        let row = row(place)?;
        if head.form == View3dForm::Sparse {
            text.clear();
            for (column, factor) in row.into_iter().filter(|&(_, factor)| factor >= SPARSE_MIN) {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{} {} {factor:.6}", place + 1, column + 1);
            }
            out.write_all(text.as_bytes())?;
            continue;
        }
        let mut dense = vec![0.0; count];
        for (column, factor) in row {
            dense[column as usize] = factor;
        }
        match binary {
            true => {
                let bytes: Vec<u8> = dense.iter().flat_map(|&factor| single(factor).to_le_bytes()).collect();
                out.write_all(&bytes)?;
            }
            false => out.write_all(line(dense.iter().map(|factor| format!("{factor:.6}")).collect()).as_bytes())?,
        }
    }
    match head.form {
        View3dForm::Sparse => {}
        View3dForm::Binary => emittances
            .iter()
            .try_for_each(|&e| out.write_all(&single(e).to_le_bytes()))?,
        View3dForm::Text => out.write_all(line(emittances.iter().map(|e| format!("{e:.3}")).collect()).as_bytes())?,
    }
    Ok(())
}

/// The emittance of a face: of a material called `emissivity 0.9`, as View3D's scenes are read; otherwise [`BLACK`].
fn emittance(faces: &Faces<'_>, place: usize) -> f64 {
    let material = faces
        .store
        .manifest()
        .materials
        .get(faces.faces[place].material as usize);
    let given = material.and_then(|name| name.strip_prefix("emissivity ")?.parse().ok());
    given.unwrap_or(BLACK)
}

pub(crate) struct View3d;
pub(crate) struct View3dBinary;

const NEEDS: Needs = Needs {
    grouping: Grouping::By(GroupBy::Object),
    sums: Sums::Free,
    reciprocal: false,
};

fn write(form: View3dForm, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
    let faces = job.faces;
    let head = View3dHead {
        form,
        encl: false,
        emit: false,
    };
    let areas: Vec<f64> = faces.faces.iter().map(|face| face.area).collect();
    let emittances: Vec<f64> = (0..faces.len()).map(|place| emittance(faces, place)).collect();
    let file = &mut files[0];
    let mut buffer = io::BufWriter::new(file);
    let fail = |failure: Failure| match failure {
        Failure::Row(error) => error,
        Failure::File(error) => crate::write::on_write(&job.paths[0], error),
    };
    write_view3d(&mut buffer, head, &areas, &emittances, |place| {
        faces.row(place).map_err(Failure::Row)
    })
    .map_err(fail)?;
    buffer.flush().map_err(Failure::File).map_err(fail)
}

/// Failure of either side of a copy.
enum Failure {
    Row(crate::Error),
    File(io::Error),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::File(error)
    }
}

macro_rules! writer {
    ($name:ident, $form:expr, $bytes:literal) => {
        impl SolverWriter for $name {
            fn needs(&self) -> Needs {
                NEEDS
            }

            fn paths(&self, _: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
                Ok(vec![path.to_owned()])
            }

            fn forecast(&self, faces: &Faces<'_>, _: &Found, _: &Path) -> Result<Option<u64>> {
                let count = faces.len() as u64;
                Ok(Some($bytes * count * count))
            }

            fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
                write($form, job, files)
            }

            fn next(&self, _: &Faces<'_>, _: &Found, paths: &[PathBuf]) -> String {
                format!("View3D's programs read `{}` as its own", paths[0].display())
            }
        }
    };
}

writer!(View3d, View3dForm::Text, 9);
writer!(View3dBinary, View3dForm::Binary, 4);
