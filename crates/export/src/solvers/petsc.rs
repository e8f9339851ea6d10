//! PETSc's binary AIJ matrix, for `MatLoad`.
//!
//! Read: PETSc 3.18, `MatLoad` (file format in its manual page) and `PetscBinaryRead` (byte order, width of integers);
//! held against petsc4py 3.18.5.
//!
//! ```text
//! i32 1211216 (MAT_FILE_CLASSID), rows, columns, entries
//! i32 entries of each row
//! i32 column of each entry, from 0, ascending in a row
//! f64 value of each entry
//! ```
//!
//! All big-endian. A PETSc configured with 64-bit indices writes and reads 64-bit integers; this is the default form.

use super::{SolverJob, SolverWriter};
use crate::Result;
use crate::faces::{Faces, Found, Grouping, Needs, Sums};
use crate::write::{Cancellable, too_large};
use std::path::{Path, PathBuf};

/// Marks a matrix.
const CLASS: i32 = 1_211_216;

pub(crate) struct Petsc;

impl SolverWriter for Petsc {
    fn needs(&self) -> Needs {
        Needs {
            grouping: Grouping::Patch,
            sums: Sums::Free,
            reciprocal: false,
        }
    }

    fn paths(&self, _: &Faces<'_>, path: &Path) -> Result<Vec<PathBuf>> {
        Ok(vec![path.to_owned()])
    }

    fn forecast(&self, faces: &Faces<'_>, found: &Found, path: &Path) -> Result<Option<u64>> {
        if i32::try_from(found.entries).is_err() {
            return Err(too_large(
                path,
                "PETSc's default integers count 2,147,483,647 entries; leave small ones out of the matrix, or \
                 write a `.npz`",
            ));
        }
        Ok(Some(16 + 4 * faces.len() as u64 + 12 * found.entries))
    }

    /// Three passes over the rows: lengths, columns, values.
    fn write(&self, job: &SolverJob<'_>, files: &mut [Cancellable<'_>]) -> Result<()> {
        let count = job.faces.len();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "`forecast` has counted, and patches are fewer than 2³¹"
        )]
        let whole = |number: u64| (number as i32).to_be_bytes();
        let head = [
            whole(CLASS.unsigned_abs().into()),
            whole(count as u64),
            whole(count as u64),
            whole(job.found.entries),
        ];
        job.put(files, 0, head.as_flattened())?;
        let mut bytes = Vec::new();
        for pass in 0..3 {
            for place in 0..count {
                let row = job.faces.row(place)?;
                bytes.clear();
                match pass {
                    0 => bytes.extend(whole(row.len() as u64)),
                    1 => bytes.extend(row.iter().flat_map(|&(column, _)| whole(column.into()))),
                    _ => bytes.extend(row.iter().flat_map(|&(_, factor)| factor.to_be_bytes())),
                }
                job.put(files, 0, &bytes)?;
            }
        }
        Ok(())
    }

    fn next(&self, _: &Faces<'_>, _: &Found, paths: &[PathBuf]) -> String {
        format!(
            "petsc4py: F = PETSc.Mat().load(PETSc.Viewer().createBinary(\"{}\", \"r\"))",
            paths[0].display()
        )
    }
}
