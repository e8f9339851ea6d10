//! The table of exports: one row a file format. The program's help, messages and dialogue come of it.
//!
//! A new format is a module of this folder, declared below, with a [`MatrixWriter`] or a [`PatchWriter`], and a row of
//! the table. A new solver's is a module of `solvers` with a [`SolverWriter`], and a row of the third table.

mod array;
mod gltf;
#[cfg(feature = "parquet")]
mod parquet;
mod ply;
mod table;
mod text;
mod vtk;

use crate::faces::Needs;
use crate::matrix::Export;
use crate::solvers::{self, SolverWriter};
use crate::write::Cancellable;
use crate::{Error, PatchResults, Result, WriteOptions};
use serde::Serialize;
use std::path::Path;

/// Size of a matrix file, in bytes.
pub(crate) struct Forecast {
    /// The likely size.
    pub(crate) bytes: u64,
    /// The least size; below `bytes` for text extrapolated from some rows.
    pub(crate) least: u64,
}

impl Forecast {
    fn exact(bytes: u64) -> Self {
        Self { bytes, least: bytes }
    }
}

/// Writer of a matrix format.
pub(crate) trait MatrixWriter: Sync {
    /// Size of the file, if it can be told before writing.
    fn forecast(&self, export: &Export<'_>) -> Result<Option<Forecast>>;

    /// Writes all of the matrix.
    fn write<'a>(&self, export: &Export<'_>, file: Cancellable<'a>) -> Result<Cancellable<'a>>;
}

/// Writer of a format of patches.
pub(crate) trait PatchWriter: Sync {
    /// Writes `results` to `path`; returns the file's size in bytes. Refuses before there is a file.
    fn write(&self, results: &PatchResults, path: &Path, options: WriteOptions<'_>) -> Result<u64>;
}

/// Properties of a format.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Trait {
    /// Rows and columns of the matrix count from 1.
    FromOne,
    /// Columns of the sky may follow those of the patches.
    Sky,
    /// Every result of a patch is in the file.
    Results,
    /// Corners of the patches must be known.
    Corners,
    /// Patches are in the colours of one result.
    Colors,
    /// The scene is turned so that y points up.
    Upright,
}

/// Makes the formats of a kind of export of its table: variant, extensions, program or form, sentence for `--format`,
/// properties, how to read the file (`{}`: its name), writer, and the writer's feature, if it has one.
macro_rules! exports {
    (
        $(#[$kind_doc:meta])*
        $kind:ident: $writer_trait:ident;
        $(
            $(#[$doc:meta])*
            $format:ident, [$($extension:literal),+], $label:literal, $about:literal, [$($property:ident),*],
            $read:literal, $writer:expr $(, $feature:literal)?;
        )+
    ) => {
        $(#[$kind_doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
        #[serde(rename_all = "lowercase")]
        #[non_exhaustive]
        pub enum $kind {
            $($(#[$doc])* $format,)+
        }

        impl $kind {
            /// All formats, in the order of lists.
            pub const ALL: &'static [Self] = &[$(Self::$format),+];

            /// The extensions of its files, in lower case, the usual one first.
            pub fn extensions(self) -> &'static [&'static str] {
                match self {
                    $(Self::$format => &[$($extension),+],)+
                }
            }

            /// The file's program, or its form; empty if the extension says all.
            pub fn label(self) -> &'static str {
                match self {
                    $(Self::$format => $label,)+
                }
            }

            /// Extensions and label.
            pub fn named(self) -> Named {
                (self.extensions(), self.label())
            }

            /// A sentence for people, without a full stop.
            pub fn about(self) -> &'static str {
                match self {
                    $(Self::$format => $about,)+
                }
            }

            /// The words to type in the file's program; `None` if there are none.
            pub fn how_to_read(self, path: &str) -> Option<String> {
                let read = match self {
                    $(Self::$format => $read,)+
                };
                (!read.is_empty()).then(|| read.replace("{}", path))
            }

            /// The format named by a file's extension, in any case.
            ///
            /// # Errors
            /// [`Error::Format`] when it asks for none of these; it lists them.
            pub fn of(path: &Path) -> Result<Self> {
                let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
                let is_named = |format: &&Self| extension.as_deref().is_some_and(|e| format.extensions().contains(&e));
                Self::ALL.iter().find(is_named).copied().ok_or_else(|| Error::Format {
                    path: path.to_owned(),
                    known: Self::ALL.iter().map(|format| format.named()).collect(),
                })
            }

            fn has(self, property: Trait) -> bool {
                match self {
                    $(Self::$format => [$(Trait::$property),*].contains(&property),)+
                }
            }

            /// The writer.
            ///
            /// # Errors
            /// [`Error::NotBuilt`] if it is not compiled in.
            pub(crate) fn writer(self) -> Result<&'static dyn $writer_trait> {
                match self {
                    $(
                        $(#[cfg(feature = $feature)])?
                        Self::$format => Ok(&$writer),
                        $(
                            #[cfg(not(feature = $feature))]
                            Self::$format => Err(Error::NotBuilt { feature: $feature }),
                        )?
                    )+
                }
            }
        }
    };
}

exports! {
    /// A file format for matrices.
    ///
    /// ```
    /// use hemicube_export::ExportFormat;
    ///
    /// assert_eq!(ExportFormat::of("room.MTX".as_ref())?, ExportFormat::MatrixMarket);
    /// let error = ExportFormat::of("room.h5".as_ref()).expect_err("no format of a matrix");
    /// assert!(error.to_string().contains("`.txt` or `.dat` (MATLAB's `spconvert`), `.npy` (dense) or `.parquet`"));
    /// # Ok::<(), hemicube_export::Error>(())
    /// ```
    ExportFormat: MatrixWriter;
    /// `.npz`: one CSR matrix for `scipy.sparse.load_npz`, uncompressed; f32 values, i32 columns, i64 `indptr`.
    Npz, ["npz"], "SciPy", "A sparse matrix for `scipy.sparse.load_npz`", [Sky],
        "Python: F = scipy.sparse.load_npz(\"{}\")", array::Npz;
    /// `.mtx`: Matrix Market, coordinate real general, 1-based.
    MatrixMarket, ["mtx"], "Matrix Market", "Matrix Market", [Sky, FromOne],
        "Python: F = scipy.io.mmread(\"{}\").tocsr()", text::MatrixMarket;
    /// `.txt`, `.dat`: `row column value` lines, 1-based, for MATLAB's and Octave's `spconvert`; the last line gives
    /// the size.
    Triplets, ["txt", "dat"], "MATLAB's `spconvert`", "`row column value` lines for MATLAB's and Octave's `spconvert`",
        [Sky, FromOne], "MATLAB, Octave: F = spconvert(load('{}'));", text::Triplets;
    /// `.npy`: a dense array of f32.
    Npy, ["npy"], "dense", "A dense NumPy array", [Sky],
        "Python: F = numpy.load(\"{}\", mmap_mode=\"r\")", array::Npy;
    /// `.parquet`: Apache Parquet, a table of triplets, 0-based.
    Parquet, ["parquet"], "triplets", "Apache Parquet: row, col, value, from 0", [],
        "DuckDB: SELECT row, sum(value) FROM '{}' GROUP BY row; F[row, col] is from row to col, counted from 0",
        parquet::Parquet, "parquet";
}

exports! {
    /// A file format for results of patches.
    ///
    /// ```
    /// use hemicube_export::PatchFormat;
    ///
    /// assert_eq!(PatchFormat::of("room.GLB".as_ref())?, PatchFormat::Glb);
    /// assert!(PatchFormat::of("room.mtx".as_ref()).is_err(), "a format of the matrix");
    /// assert!(PatchFormat::Glb.needs_corners() && PatchFormat::Glb.has_colors());
    /// assert!(!PatchFormat::Csv.needs_corners());
    /// # Ok::<(), hemicube_export::Error>(())
    /// ```
    PatchFormat: PatchWriter;
    /// VTK's PolyData: triangles with shared points, an array for each result.
    Vtp, ["vtp"], "ParaView", "VTK's PolyData, for ParaView: patches", [Corners, Results], "", vtk::PolyData;
    /// VTK's UnstructuredGrid: triangles as cells, otherwise as PolyData.
    Vtu, ["vtu"], "ParaView", "VTK's UnstructuredGrid: patches", [Corners, Results], "", vtk::UnstructuredGrid;
    /// Binary glTF 2.0: a mesh for each object, three vertices of their own and one colour for each patch.
    Glb, ["glb"], "glTF", "Binary glTF: patches in the colours of a result", [Corners, Colors, Upright], "",
        gltf::BinaryGltf;
    /// Binary PLY: one mesh, three vertices and one colour for each patch, all results as properties of faces.
    Ply, ["ply"], "", "PLY: patches", [Corners, Colors, Results], "", ply::Ply;
    /// Text, a line a patch.
    Csv, ["csv"], "", "A table: patches", [Results], "", table::Csv;
    /// NumPy arrays, a row a patch.
    Npz, ["npz"], "", "NumPy arrays: patches", [Results], "", table::Npz;
}

exports! {
    /// A solver, and its file format. The label is its name for [`SolverFormat::named_as`].
    ///
    /// ```
    /// use hemicube_export::SolverFormat;
    ///
    /// assert_eq!(SolverFormat::named_as("openfoam"), Some(SolverFormat::OpenFoam));
    /// assert!(SolverFormat::named_as("fluent").is_none());
    /// ```
    SolverFormat: SolverWriter;
    /// PETSc's binary AIJ matrix, from 0.
    Petsc, ["petsc"], "petsc", "PETSc: a binary AIJ matrix for `MatLoad`", [], "", solvers::Petsc;
    /// View3D's text, `out=0`.
    View3d, ["vf"], "view3d", "View3D: its text file (`out=0`)", [], "", solvers::View3d;
    /// View3D's binary file, `out=1`.
    View3dBinary, ["vf"], "view3d-binary", "View3D: its binary file (`out=1`)", [], "", solvers::View3dBinary;
    /// EnergyPlus' user view factors by surface name.
    EnergyPlus, ["epjson", "idf"], "energyplus",
        "EnergyPlus: user view factors by surface name, OUT an .epJSON or .idf", [], "", solvers::EnergyPlus;
    /// EnergyPlus' surroundings of exterior surfaces: sky, ground and other surfaces.
    EnergyPlusOutside, ["epjson", "idf"], "energyplus-outside",
        "EnergyPlus: surroundings of exterior surfaces, OUT an .epJSON or .idf", [], "", solvers::EnergyPlusOutside;
    /// uDALES' sparse view factors and sky view factors, from 1.
    Udales, ["inp"], "udales", "uDALES: OUT vfsparse.inp.NNN, and svf.inp.NNN beside it", [FromOne], "",
        solvers::Udales;
    /// Elmer's `ViewFactors.dat`, from 1.
    Elmer, ["dat"], "elmer", "Elmer: ViewFactors.dat", [FromOne], "", solvers::Elmer;
    /// OpenFOAM's `F`, `globalFaceFaces` and `mapDist`.
    OpenFoam, ["foam"], "openfoam", "OpenFOAM (.com): F, globalFaceFaces, mapDist; OUT is the case's `constant`", [],
        "", solvers::OpenFoam;
    /// CalculiX's `.vwf`.
    Calculix, ["vwf"], "calculix", "CalculiX: a .vwf for `*VIEWFACTOR, READ`", [], "", solvers::Calculix;
}

impl SolverFormat {
    /// The solver of a name such as `elmer`.
    pub fn named_as(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|format| format.label() == name)
    }

    /// The solver's requirements of a matrix.
    ///
    /// # Errors
    /// [`Error::NotBuilt`] if its writer is not compiled in.
    pub fn needs(self) -> Result<Needs> {
        Ok(self.writer()?.needs())
    }

    /// The number of the first row and of the first column in its files: 0 or 1.
    pub fn first_index(self) -> u32 {
        u32::from(self.has(Trait::FromOne))
    }

    /// The solver's name for people.
    pub fn program(self) -> &'static str {
        self.about().split(':').next().unwrap_or_default()
    }
}

impl ExportFormat {
    /// The number of the first row and of the first column: 0 or 1.
    pub fn first_index(self) -> u32 {
        u32::from(self.has(Trait::FromOne))
    }

    /// Returns whether columns of the sky may follow those of the patches.
    pub fn takes_sky(self) -> bool {
        self.has(Trait::Sky)
    }
}

impl PatchFormat {
    /// Returns whether nothing can be written without the corners of the patches.
    pub fn needs_corners(self) -> bool {
        self.has(Trait::Corners)
    }

    /// Returns whether patches are shown in the colours of one result.
    pub fn has_colors(self) -> bool {
        self.has(Trait::Colors)
    }

    /// Returns whether every result is in the file, not only the colours of one.
    pub fn has_results(self) -> bool {
        self.has(Trait::Results)
    }

    /// Returns whether the scene is turned so that y points up.
    pub fn is_upright(self) -> bool {
        self.has(Trait::Upright)
    }
}

/// Extensions of a format, and its label.
pub type Named = (&'static [&'static str], &'static str);

/// Extensions with their labels, for people. Neighbours of one label stand together.
///
/// ```
/// use hemicube_export::{PatchFormat, listed};
/// let meshes = PatchFormat::ALL.iter().filter(|format| format.needs_corners()).map(|format| format.named());
/// assert_eq!(listed(meshes, ""), [".vtp or .vtu (ParaView)", ".glb (glTF)", ".ply"]);
/// ```
pub fn listed(formats: impl IntoIterator<Item = Named>, quote: &str) -> Vec<String> {
    let formats: Vec<Named> = formats.into_iter().collect();
    formats
        .chunk_by(|a, b| !a.1.is_empty() && a.1 == b.1)
        .map(|group| {
            let extensions = group.iter().flat_map(|(extensions, _)| extensions.iter());
            let extensions: Vec<String> = extensions.map(|e| format!("{quote}.{e}{quote}")).collect();
            let label = match group[0].1 {
                "" => String::new(),
                label => format!(" ({label})"),
            };
            extensions.join(" or ") + &label
        })
        .collect()
}
