//! Scenes: triangles from arrays or a file, cut into patches and made ready for hemicubes.

use crate::pickle::{Reduced, maker};
use crate::{errors, numbers};
use glam::DVec3;
use hemicube::diagnose::{DiagnoseOptions, doubles};
use hemicube::driver::input::{SceneInput, SceneSettings};
use hemicube::driver::room::{self, Work};
use hemicube::driver::settings::axis_name;
use hemicube::{HierarchyOptions, Model};
use hemicube_scene::generate::{Generate, generate};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{
    Axis, Budget, Fate, Kind, Loss, Material, Patches, ReadOptions, Scene as Triangles, Side, Subdivision, Triangle,
};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use std::ffi::CString;
use std::path::PathBuf;
use std::sync::Arc;

/// A loss as it is pickled: fate, kind, number, area, first place and next step.
type LossRecord = (String, String, u64, Option<f64>, Option<String>, Option<String>);

/// The keywords shared by all ways to a scene.
#[derive(Debug, Default)]
struct Keywords<'a> {
    up: Option<&'a str>,
    flip: Option<Vec<String>>,
    exclude: Option<Vec<String>>,
    split: Option<u32>,
    patch_size: Option<f64>,
    keep_duplicates: bool,
}

impl Keywords<'_> {
    fn settings(self) -> PyResult<SceneSettings> {
        let subdivision = match (self.split, self.patch_size) {
            (None, None) => Subdivision::None,
            (Some(pieces), None) if (1..=65536).contains(&pieces) => Subdivision::Split(pieces),
            (None, Some(length)) if length > 0.0 && length.is_finite() => Subdivision::PatchSize(length),
            (Some(pieces), None) => {
                return Err(errors::input(format!("`split` is {pieces}; 1 to 65536 is needed")));
            }
            (None, Some(length)) => {
                return Err(errors::input(format!(
                    "`patch_size` is {length}; a length above 0 is needed"
                )));
            }
            _ => {
                return Err(errors::input(
                    "`split` and `patch_size` are two ways to cut triangles; give one of them",
                ));
            }
        };
        Ok(SceneSettings {
            keep_duplicates: self.keep_duplicates,
            flip: self.flip.unwrap_or_default(),
            exclude: self.exclude.unwrap_or_default(),
            up: self.up.map(axis).transpose()?,
            ..subdivision.into()
        })
    }
}

/// An axis by its name.
pub(crate) fn axis(name: &str) -> PyResult<Axis> {
    match name {
        "x" => Ok(Axis::X),
        "y" => Ok(Axis::Y),
        "z" => Ok(Axis::Z),
        other => Err(errors::input(format!("`up` is `{other}`; x, y or z is needed"))),
    }
}

pub(crate) fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let text = CString::new(message.replace('\0', " ")).map_err(|error| errors::input(error.to_string()))?;
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}

/// A scene: triangles cut into patches, which rows and columns of a matrix are of.
///
/// Vertices are (n, 3) numbers, triangles (m, 3) indices into them, counter-clockwise seen from the front. `object` and
/// `material` are ids of each triangle, which `objects` and `materials` name. A `two_sided` triangle, all of them or
/// those of a mask, becomes two patches, its front and its back. `flip` lists objects (names, with `*` and `?`, or
/// 'all') whose one-sided triangles are turned round, `exclude` objects and materials that are left out. `up` ('x', 'y' or 'z') says where the sky is.
///
/// Triangles are cut by `split` (each edge in so many pieces) or by `patch_size` (until no edge is longer). Triangles without area, with coordinates that are not finite, or
/// that lie exactly on others (unless `keep_duplicates`) are dropped with a warning; the property `face` says which
/// triangle each patch is of, or which face, where `face` gives the triangles of a polygon one number.
#[pyclass(frozen, module = "hemicube")]
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) input: SceneInput,
    pub(crate) patches: Arc<Patches>,
    pub(crate) model: Model,
}

impl Scene {
    fn ready(py: Python<'_>, triangles: Triangles, file: PathBuf, settings: SceneSettings) -> PyResult<Self> {
        let input = py.detach(|| SceneInput::new(triangles, file, settings));
        let input = input.map_err(|error| {
            let what = match error.list {
                "exclude" => "no object and no material",
                _ => "no object with one-sided triangles",
            };
            errors::input(format!(
                "`{}`: `{}` matches {what}; {}",
                error.list, error.glob, error.there
            ))
        })?;
        for sentence in input.ledger.sentences() {
            warn(py, &sentence)?;
        }
        let repaired = input.repaired;
        if input.triangles.is_empty() {
            return Err(errors::input(format!(
                "the scene holds no triangle that can be used: of {}, {} not finite and {} without area",
                input.triangles_read, repaired.non_finite, repaired.degenerate
            )));
        }
        let mut scene = Self::cut(py, input)?;
        let found = py.detach(|| doubles(&scene.model, &scene.input, DiagnoseOptions::default()));
        for sentence in found.sentences() {
            warn(py, &sentence)?;
        }
        scene.input.scene.ledger.join(found);
        Ok(scene)
    }

    /// The patches of repaired triangles.
    fn cut(py: Python<'_>, input: SceneInput) -> PyResult<Self> {
        let cut = input.settings.subdivision;
        if Patches::count(&input, cut) <= u64::from(hemicube::store::PATCH_COUNT_MAX) {
            room::require(&input, cut, Work::Fractions, Budget::default()).map_err(|error| errors::no_room(&error))?;
        }
        let model = py
            .detach(|| input.model(HierarchyOptions::default()))
            .map_err(|error| errors::uncut(&error))?;
        Ok(Self {
            input,
            patches: Arc::clone(model.patches()),
            model,
        })
    }

    /// Something of each patch's triangle.
    fn by_triangle<T: numpy::Element>(&self, py: Python<'_>, of: impl Fn(&Triangle) -> T) -> Py<PyArray1<T>> {
        let list = self
            .patches
            .iter()
            .map(|patch| of(&self.input.triangles[self.patches.triangle(patch)]));
        PyArray1::from_vec(py, list.collect()).unbind()
    }

    /// Three numbers of each patch.
    fn vectors(&self, py: Python<'_>, of: impl Fn(hemicube::InputPatch) -> DVec3) -> PyResult<Py<PyArray2<f64>>> {
        let flat: Vec<f64> = self.patches.iter().flat_map(|patch| of(patch).to_array()).collect();
        Ok(PyArray1::from_vec(py, flat).reshape([self.patches.len(), 3])?.unbind())
    }
}

/// Ids from 0 on, of things named or called by their numbers.
fn named(ids: &[i64], names: Option<Vec<String>>, what: &str) -> PyResult<(Vec<u32>, Vec<String>)> {
    let most = ids.iter().copied().max().unwrap_or(0);
    let names = names.unwrap_or_else(|| {
        (0..=most.clamp(0, i64::from(u32::MAX)))
            .map(|id| id.to_string())
            .collect()
    });
    let ids = ids
        .iter()
        .map(|&id| match u32::try_from(id) {
            Ok(place) if (place as usize) < names.len() => Ok(place),
            _ => Err(errors::input(format!(
                "`{what}` has the id {id}, and there are {} names",
                names.len()
            ))),
        })
        .collect::<PyResult<_>>()?;
    Ok((ids, names))
}

/// The face of each triangle: its place, or as given, which must not fall.
fn faces(given: Option<&Bound<'_, PyAny>>, count: usize) -> PyResult<Vec<u32>> {
    let Some(given) = given else {
        return Ok((0..).take(count).collect());
    };
    let ids = numbers::ids(given, "face", count)?;
    let faces: Option<Vec<u32>> = ids
        .iter()
        .map(|&id| u32::try_from(id).ok().filter(|&id| id < u32::MAX))
        .collect();
    faces
        .filter(|faces| faces.is_sorted())
        .ok_or_else(|| errors::input("`face` must be from 0 on, and rise from triangle to triangle or stay"))
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (
        vertices, triangles, *, object=None, material=None, face=None, objects=None, materials=None, two_sided=None,
        flip=None, exclude=None, up=None, split=None, patch_size=None, keep_duplicates=false
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords")]
    fn new(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        object: Option<&Bound<'_, PyAny>>,
        material: Option<&Bound<'_, PyAny>>,
        face: Option<&Bound<'_, PyAny>>,
        objects: Option<Vec<String>>,
        materials: Option<Vec<String>>,
        two_sided: Option<&Bound<'_, PyAny>>,
        flip: Option<Vec<String>>,
        exclude: Option<Vec<String>>,
        up: Option<&str>,
        split: Option<u32>,
        patch_size: Option<f64>,
        keep_duplicates: bool,
    ) -> PyResult<Self> {
        let given = Keywords {
            up,
            flip,
            exclude,
            split,
            patch_size,
            keep_duplicates,
        };
        let settings = given.settings()?;
        let vertices = numbers::points(vertices, "vertices")?;
        let triangles = numbers::triples(triangles, "triangles")?;
        let count = triangles.len();
        if u32::try_from(count).is_err() {
            return Err(errors::input(format!(
                "there are {count} triangles, more than a scene can have"
            )));
        }
        let ids = |given: Option<&Bound<'_, PyAny>>, what| match given {
            Some(given) => numbers::ids(given, what, count),
            None => Ok(vec![0; count]),
        };
        let unnamed = |names: Option<Vec<String>>, is_given: bool| match names {
            None if !is_given => Some(vec![String::new()]),
            names => names,
        };
        let (object_ids, objects) = named(&ids(object, "object")?, unnamed(objects, object.is_some()), "object")?;
        let (material_ids, materials) = named(
            &ids(material, "material")?,
            unnamed(materials, material.is_some()),
            "material",
        )?;
        let faces = faces(face, count)?;
        let two_sided = match two_sided {
            Some(given) => numbers::flags(given, "two_sided", count)?,
            None => vec![false; count],
        };
        let mut scene = Triangles {
            objects,
            materials: materials
                .into_iter()
                .map(|name| Material {
                    name,
                    ..Material::default()
                })
                .collect(),
            ..Triangles::default()
        };
        for (place, corners) in triangles.iter().enumerate() {
            let mut points = [DVec3::ZERO; 3];
            for (point, &index) in points.iter_mut().zip(corners) {
                let vertex = usize::try_from(index).ok().and_then(|index| vertices.get(index));
                let Some(vertex) = vertex else {
                    return Err(errors::input(format!(
                        "triangle {place} has the vertex {index}, and there are {}, from 0 on",
                        vertices.len()
                    )));
                };
                *point = DVec3::from_array(*vertex);
            }
            scene.triangles.push(Triangle {
                corners: points,
                object: object_ids[place],
                material: material_ids[place],
                face: faces[place],
                two_sided: two_sided[place],
            });
        }
        Self::ready(py, scene, PathBuf::from("arrays"), settings)
    }

    /// The scene in a file, whose extension names its format, or in all such files of a folder:
    #[doc = hemicube_scene::scene_formats!()]
    ///
    /// `scale` multiplies its coordinates; `two_sided` makes every triangle two patches (True) or one (False), by
    /// default (None) as the file says; `up` is for files that do not say, or are wrong. `allow_large` reads files that
    /// become far more triangles than their size explains. The rest is as for arrays.
    #[classmethod]
    #[pyo3(signature = (
        path, *, scale=1.0, two_sided=None, flip=None, exclude=None, up=None, split=None,
        patch_size=None, keep_duplicates=false, allow_large=false
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords")]
    fn load(
        _class: &Bound<'_, PyType>,
        py: Python<'_>,
        path: PathBuf,
        scale: f64,
        two_sided: Option<bool>,
        flip: Option<Vec<String>>,
        exclude: Option<Vec<String>>,
        up: Option<&str>,
        split: Option<u32>,
        patch_size: Option<f64>,
        keep_duplicates: bool,
        allow_large: bool,
    ) -> PyResult<Self> {
        let given = Keywords {
            up,
            flip,
            exclude,
            split,
            patch_size,
            keep_duplicates,
        };
        let settings = given.settings()?;
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(errors::input(format!("`scale` is {scale}; a number above 0 is needed")));
        }
        let scene = py
            .detach(|| {
                hemicube_scene::load(
                    &path,
                    ReadOptions {
                        allow_large,
                        ..ReadOptions::default()
                    },
                )
            })
            .map_err(|error| errors::scene(&error))?;
        let settings = SceneSettings {
            scale,
            two_sided,
            ..settings
        };
        Self::ready(py, scene, path, settings)
    }

    /// A scene made up: room, city, block-city, maze, spheres, field or soup, of about so many patches.
    #[classmethod]
    #[pyo3(signature = (kind, patches, *, seed=1))]
    fn generate(_class: &Bound<'_, PyType>, py: Python<'_>, kind: &str, patches: u64, seed: u64) -> PyResult<Self> {
        let spec = Generate {
            kind: kind.parse().map_err(|error| errors::scene(&error))?,
            target_patches: patches,
            seed,
        };
        let mut scene = py.detach(|| generate(spec)).map_err(|error| errors::scene(&error))?;
        // The number of patches is approximate by nature.
        scene.ledger.warnings.clear();
        let file = PathBuf::from(format!("{kind}.generated"));
        Self::ready(py, scene, file, SceneSettings::default())
    }

    /// Number of patches: rows and columns of a matrix.
    fn __len__(&self) -> usize {
        self.patches.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<hemicube.Scene of {} patches, {}>",
            self.patches.len(),
            self.input.file.display()
        )
    }

    /// Area of each patch: (n,), in the scene's unit squared.
    #[getter]
    fn areas(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        PyArray1::from_vec(py, self.patches.iter().map(|patch| self.patches.area(patch)).collect()).unbind()
    }

    /// Centroid of each patch: (n, 3).
    #[getter]
    fn centroids(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        self.vectors(py, |patch| self.patches.centroid(patch))
    }

    /// Unit normal of each patch, away from its radiating side: (n, 3).
    #[getter]
    fn normals(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        self.vectors(py, |patch| self.patches.normal(patch))
    }

    /// Corners of each patch, counter-clockwise seen from its radiating side: (n, 3, 3).
    #[getter]
    fn corners(&self, py: Python<'_>) -> PyResult<Py<PyArray3<f64>>> {
        let corners = self.patches.iter().flat_map(|patch| self.patches.corners(patch));
        let flat: Vec<f64> = corners.flat_map(|corner| corner.to_array()).collect();
        Ok(PyArray1::from_vec(py, flat)
            .reshape([self.patches.len(), 3, 3])?
            .unbind())
    }

    /// The triangle of the arrays, or the face of the file, of each patch: (n,), from 0.
    #[getter]
    fn face(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        self.by_triangle(py, |triangle| triangle.face)
    }

    /// The object of each patch: (n,), places in `objects`.
    #[getter]
    fn object(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        self.by_triangle(py, |triangle| triangle.object)
    }

    /// The material of each patch: (n,), places in `materials`.
    #[getter]
    fn material(&self, py: Python<'_>) -> Py<PyArray1<u32>> {
        self.by_triangle(py, |triangle| triangle.material)
    }

    /// The side of its triangle of each patch: (n,), 0 the front, 1 the back.
    #[getter]
    fn side(&self, py: Python<'_>) -> Py<PyArray1<u8>> {
        let side = |patch| match self.patches.side(patch) {
            Side::Front => 0,
            Side::Back => 1,
        };
        PyArray1::from_vec(py, self.patches.iter().map(side).collect()).unbind()
    }

    /// Names of the objects.
    #[getter]
    fn objects(&self) -> Vec<String> {
        self.input.objects.clone()
    }

    /// Names of the materials.
    #[getter]
    fn materials(&self) -> Vec<String> {
        self.input
            .materials
            .iter()
            .map(|material| material.name.clone())
            .collect()
    }

    /// Pickles the repaired triangles and the settings; patches are cut from them again.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, input) = (slf.py(), &slf.get().input);
        let (triangles, settings) = (&input.scene.triangles, &input.settings);
        let corners = triangles.iter().flat_map(|triangle| triangle.corners);
        let corners: Vec<f64> = corners.flat_map(|corner| corner.to_array()).collect();
        let of = |triangle: &Triangle| {
            [
                triangle.object,
                triangle.material,
                triangle.face,
                u32::from(triangle.two_sided),
            ]
        };
        let ids: Vec<i64> = triangles.iter().flat_map(of).map(i64::from).collect();
        let (split, patch_size) = match settings.subdivision {
            Subdivision::None => (None, None),
            Subdivision::Levels(levels) => (Some(1 << levels.min(31)), None),
            Subdivision::Split(pieces) => (Some(pieces), None),
            Subdivision::PatchSize(length) => (None, Some(length)),
        };
        let state = PyDict::new(py);
        state.set_item(
            "corners",
            PyArray1::from_vec(py, corners).reshape([3 * triangles.len(), 3])?,
        )?;
        state.set_item("ids", PyArray1::from_vec(py, ids).reshape([triangles.len(), 4])?)?;
        state.set_item("objects", slf.get().objects())?;
        state.set_item("materials", slf.get().materials())?;
        state.set_item("file", &input.file)?;
        state.set_item("triangles_read", input.triangles_read)?;
        state.set_item("scale", settings.scale)?;
        state.set_item("two_sided", settings.two_sided)?;
        state.set_item("flip", settings.flip.clone())?;
        state.set_item("exclude", settings.exclude.clone())?;
        let losses = input.ledger.losses().map(|(what, loss)| {
            let fate = loss.fate.name().to_owned();
            (
                fate,
                what.to_owned(),
                loss.count,
                loss.area,
                loss.first.clone(),
                loss.next.clone(),
            )
        });
        state.set_item("losses", losses.collect::<Vec<_>>())?;
        state.set_item("warnings", input.ledger.warnings.clone())?;
        state.set_item("further_names", input.further_names.clone())?;
        state.set_item("crs", input.crs.clone())?;
        state.set_item("asked_up", settings.up.map(axis_name))?;
        state.set_item("up", input.up_name())?;
        state.set_item("keep_duplicates", settings.keep_duplicates)?;
        state.set_item("split", split)?;
        state.set_item("patch_size", patch_size)?;
        Ok((maker(py, "_scene_of")?, (state,).into_pyobject(py)?))
    }

    /// What was not taken as the file says: a list of dictionaries with `fate` ('left out', 'approximated', 'merged',
    /// 'turned round', 'doubtful'), `what`, `count`, `area` (of all, in the scene's unit squared, or None), `first` (the
    /// place of the first) and `next` (what to try, or None). Each was a warning when the scene was read.
    #[getter]
    fn losses<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let one = |(what, loss): (&str, &Loss)| {
            let of = PyDict::new(py);
            of.set_item("fate", loss.fate.name())?;
            of.set_item("what", what)?;
            of.set_item("count", loss.count)?;
            of.set_item("area", loss.area)?;
            of.set_item("first", loss.first.as_deref())?;
            of.set_item("next", loss.next.as_deref())?;
            Ok(of)
        };
        self.input.ledger.losses().map(one).collect()
    }

    /// Further names of objects, by their number: lists that properties, `emitters` and `flip` match, too.
    #[getter]
    fn further_names(&self) -> std::collections::BTreeMap<u32, Vec<String>> {
        self.input.further_names.clone()
    }

    /// The coordinate reference system that the file names, or None.
    #[getter]
    fn crs(&self) -> Option<&str> {
        self.input.crs.as_deref()
    }

    /// The axis that points up: 'x', 'y', 'z', or None if unknown.
    #[getter]
    fn up(&self) -> Option<&'static str> {
        self.input.up_name()
    }
}

/// The state of a pickled scene.
#[derive(Debug, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct State<'py> {
    corners: Bound<'py, PyAny>,
    ids: Bound<'py, PyAny>,
    objects: Vec<String>,
    materials: Vec<String>,
    file: PathBuf,
    triangles_read: u64,
    scale: f64,
    two_sided: Option<bool>,
    flip: Vec<String>,
    exclude: Vec<String>,
    losses: Vec<LossRecord>,
    warnings: Vec<String>,
    further_names: std::collections::BTreeMap<u32, Vec<String>>,
    crs: Option<String>,
    asked_up: Option<String>,
    up: Option<String>,
    keep_duplicates: bool,
    split: Option<u32>,
    patch_size: Option<f64>,
}

/// The scene of a pickle. Its triangles are repaired, flipped and scaled, and pass through the repair once more: it
/// drops nothing of what it has passed.
#[pyfunction]
#[pyo3(name = "_scene_of", signature = (state))]
pub(crate) fn scene_of(py: Python<'_>, state: State<'_>) -> PyResult<Scene> {
    let keywords = Keywords {
        up: state.asked_up.as_deref(),
        flip: Some(state.flip),
        exclude: Some(state.exclude),
        split: state.split,
        patch_size: state.patch_size,
        keep_duplicates: state.keep_duplicates,
    };
    let settings = SceneSettings {
        scale: state.scale,
        two_sided: state.two_sided,
        ..keywords.settings()?
    };
    let corners = numbers::points(&state.corners, "corners")?;
    let ids = numbers::rows_of_ids::<4>(&state.ids, "ids")?;
    let (corners, rest) = corners.as_chunks::<3>();
    if corners.len() != ids.len() || !rest.is_empty() {
        return Err(errors::content(format!(
            "a pickled scene has {} corners of {} triangles",
            3 * corners.len() + rest.len(),
            ids.len()
        )));
    }
    let id = |given: i64, less_than: usize| match u32::try_from(given) {
        Ok(id) if (id as usize) < less_than => Ok(id),
        _ => Err(errors::content(format!(
            "a pickled scene has the id {given}, of {less_than}"
        ))),
    };
    let triangle = |(corners, &[object, material, face, two_sided]): (&[[f64; 3]; 3], &[i64; 4])| {
        Ok(Triangle {
            corners: corners.map(DVec3::from_array),
            object: id(object, state.objects.len())?,
            material: id(material, state.materials.len())?,
            face: id(face, u32::MAX as usize)?,
            two_sided: two_sided != 0,
        })
    };
    let triangles = corners.iter().zip(&ids).map(triangle).collect::<PyResult<Vec<_>>>()?;
    let material = |name| Material {
        name,
        ..Material::default()
    };
    let mut scene = Triangles {
        triangles,
        objects: state.objects,
        materials: state.materials.into_iter().map(material).collect(),
        up: state.up.as_deref().map(axis).transpose()?,
        further_names: state.further_names,
        crs: state.crs,
        ..Triangles::default()
    };
    scene.ledger.warnings = state.warnings;
    for (fate, what, count, area, first, next) in state.losses {
        let fate =
            Fate::of_name(&fate).ok_or_else(|| errors::content(format!("a pickled scene has the loss `{fate}`")))?;
        let (what, next) = (what.as_str(), next.unwrap_or_default());
        let next = next.as_str();
        scene
            .ledger
            .lose(Kind { fate, what, next }, count, area, || first.unwrap_or_default());
    }
    let keep_duplicates = settings.keep_duplicates;
    let repaired = py.detach(|| repair(&mut scene, RepairOptions { keep_duplicates }));
    if scene.triangles.is_empty() {
        return Err(errors::content("a pickled scene has no triangle that can be used"));
    }
    let input = SceneInput {
        scene,
        file: state.file,
        settings,
        triangles_read: state.triangles_read,
        repaired,
    };
    Scene::cut(py, input)
}
