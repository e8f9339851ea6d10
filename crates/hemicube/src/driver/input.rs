//! Scenes on their way to a model: settings applied, triangles repaired, patches cut.

use crate::driver::selection::{NoMatch, exclude, flip};
use crate::driver::settings::axis_name;
use crate::{HierarchyOptions, Model, ModelError};
use hemicube_scene::repair::{RepairOptions, RepairReport, repair};
use hemicube_scene::{Axis, Patches, Scene, Subdivision};
use std::ops::Deref;
use std::path::PathBuf;

/// Settings of a scene. All of them are part of a store's settings: rows depend on them.
///
/// ```
/// use hemicube::driver::input::{SceneInput, SceneSettings};
/// use hemicube::HierarchyOptions;
/// use hemicube_scene::{Subdivision, generate};
///
/// let settings = SceneSettings { two_sided: Some(true), scale: 0.001, ..Subdivision::Split(2).into() };
/// let scene = SceneInput::new(generate::cornell_box(), "room.obj", settings)?;
/// let model = scene.model(HierarchyOptions::default())?;
/// assert_eq!(model.patches().len(), 2 * 160);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSettings {
    /// Subdivision of triangles into patches.
    pub subdivision: Subdivision,
    /// Sides that radiate: both of every triangle, the front of every triangle, or (`None`) by the scene.
    pub two_sided: Option<bool>,
    /// Globs for objects whose one-sided triangles are turned round; `all` stands for every object.
    pub flip: Vec<String>,
    /// Globs for objects and materials whose triangles are left out.
    pub exclude: Vec<String>,
    /// True to keep exact duplicates of triangles.
    pub keep_duplicates: bool,
    /// Factor on coordinates, above 0.
    pub scale: f64,
    /// The axis pointing up; `None`: the scene's.
    pub up: Option<Axis>,
}

impl Default for SceneSettings {
    fn default() -> Self {
        Self {
            subdivision: Subdivision::None,
            two_sided: None,
            flip: Vec::new(),
            exclude: Vec::new(),
            keep_duplicates: false,
            scale: 1.0,
            up: None,
        }
    }
}

impl From<Subdivision> for SceneSettings {
    fn from(subdivision: Subdivision) -> Self {
        Self {
            subdivision,
            ..Self::default()
        }
    }
}

impl SceneSettings {
    /// Name of `two_sided` in settings and reports: `auto`, `on` or `off`.
    pub fn two_sided_name(&self) -> &'static str {
        match self.two_sided {
            None => "auto",
            Some(true) => "on",
            Some(false) => "off",
        }
    }
}

/// A repaired scene with the settings applied to it. Derefs to the [`Scene`].
#[derive(Clone, Debug)]
pub struct SceneInput {
    /// The scene, to be cut into patches.
    pub scene: Scene,
    /// Its file, or a name in place of one. A store keeps the last component.
    pub file: PathBuf,
    /// The settings applied.
    pub settings: SceneSettings,
    /// Triangles before the repair.
    pub triangles_read: u64,
    /// Triangles dropped and noted by the repair.
    pub repaired: RepairReport,
}

impl Deref for SceneInput {
    type Target = Scene;

    fn deref(&self) -> &Scene {
        &self.scene
    }
}

/// Why a scene cannot be cut into a model's patches.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// Triangles cannot be cut.
    #[error(transparent)]
    Patches(#[from] hemicube_scene::Error),
    /// Patches make no model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl SceneInput {
    /// Applies `settings` to `scene` and repairs it ([`mod@hemicube_scene::repair`]).
    ///
    /// # Errors
    /// When a glob of `settings.flip` matches no object with one-sided triangles, or one of `settings.exclude` nothing.
    pub fn new(mut scene: Scene, file: impl Into<PathBuf>, settings: SceneSettings) -> Result<Self, NoMatch> {
        let triangles_read = scene.triangles.len() as u64;
        if let Some(axis) = settings.up {
            scene.up = Some(axis);
        }
        if settings.scale != 1.0 {
            for corner in scene.triangles.iter_mut().flat_map(|triangle| &mut triangle.corners) {
                *corner *= settings.scale;
            }
            scene.metres_per_unit = scene.metres_per_unit.map(|metres| metres / settings.scale);
        }
        if let Some(two_sided) = settings.two_sided {
            for triangle in &mut scene.triangles {
                triangle.two_sided = two_sided;
            }
        }
        exclude(&mut scene, &settings.exclude)?;
        flip(&mut scene, &settings.flip)?;
        let options = RepairOptions {
            keep_duplicates: settings.keep_duplicates,
        };
        let repaired = repair(&mut scene, options);
        Ok(Self {
            scene,
            file: file.into(),
            settings,
            triangles_read,
            repaired,
        })
    }

    /// Cuts the triangles into patches and makes a model of them.
    ///
    /// # Errors
    /// When there are too many patches, or none, or the scene's extent is out of range.
    pub fn model(&self, options: HierarchyOptions) -> Result<Model, InputError> {
        let patches = Patches::new(&self.scene, self.settings.subdivision)?;
        Ok(Model::new(patches.into(), options)?)
    }

    /// Name of the axis pointing up, if known.
    pub fn up_name(&self) -> Option<&'static str> {
        self.scene.up.map(axis_name)
    }
}
