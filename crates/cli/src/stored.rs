//! The scene of a matrix, prepared as for its computation: a store keeps no corners.

use crate::args::{AutoSwitch, Division, EngineSettings, SceneSettings, Switch, UpAxis};
use crate::exit::hinted;
use crate::prepare::{Prepared, prepare_of};
use anyhow::{Context, Result, anyhow, bail};
use hemicube::driver::input::SceneInput;
use hemicube::driver::room::Work;
use hemicube::frame::Horizon;
use hemicube::portal::{ImageSettings, Images, Portals, Specular};
use hemicube::sky::{SkyDivision, sky_beside};
use hemicube::solve::StoredSolution;
use hemicube::store::{Store, scene_hash};
use hemicube::{Grouping, HierarchyOptions};
use hemicube_scene::up::{Up, up};
use hemicube_scene::{Axis, ReadOptions};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Reading and subdivision of a matrix's scene, from the settings in its manifest.
///
/// # Errors
/// When the settings are not those of `hemicube compute`.
pub(crate) fn settings(store: &Store) -> Result<SceneSettings> {
    let settings = &store.manifest().settings;
    let number = |key: &str| {
        settings["subdivision"][key]
            .as_u64()
            .and_then(|n| u32::try_from(n).ok())
    };
    let Some(scale) = settings["scale"].as_f64() else {
        bail!(
            "`{}` was not computed by `hemicube compute`: its settings do not say how the scene was cut",
            store.directory().display()
        )
    };
    let (subdivide, split) = (number("subdivide"), number("split"));
    // These two cut all triangles alike: another scene is recognised without cutting it.
    let pieces = match (subdivide, split) {
        (Some(levels), _) => 1u64.checked_shl(levels).filter(|_| levels < 32),
        (_, Some(split)) => Some(u64::from(split)),
        _ => Some(1),
    };
    let each = pieces.map(|pieces| pieces * pieces).filter(|&each| each > 0);
    let elements = store.manifest().elements();
    if each.is_none_or(|each| !elements.is_multiple_of(each)) || !(scale > 0.0 && scale.is_finite()) {
        bail!(
            "`{}` says that its scene was scaled by {scale} and cut by {}, which does not come to its {elements} \
             patches: it is damaged",
            store.directory().display(),
            settings["subdivision"],
        )
    }
    let globs = |name: &str| {
        let globs = settings[name].as_array().into_iter().flatten();
        globs.filter_map(|glob| glob.as_str().map(str::to_owned)).collect()
    };
    Ok(SceneSettings {
        split: pieces
            .filter(|&pieces| pieces > 1)
            .and_then(|pieces| u32::try_from(pieces).ok()),
        patch_size: settings["subdivision"]["patch_size"].as_f64(),
        two_sided: match settings["two_sided"].as_str() {
            Some("on") => AutoSwitch::On,
            Some("off") => AutoSwitch::Off,
            _ => AutoSwitch::Auto,
        },
        flip: globs("flip"),
        exclude: globs("exclude"),
        up: match settings["up"].as_str() {
            Some("x") => Some(UpAxis::X),
            Some("y") => Some(UpAxis::Y),
            Some("z") => Some(UpAxis::Z),
            _ => None,
        },
        scale,
        keep_duplicates: if settings["keep_duplicates"] == Value::Bool(true) {
            Switch::On
        } else {
            Switch::Off
        },
        allow_large: false,
        memory: None,
    })
}

/// Opens a solution of a matrix.
///
/// # Errors
/// When it has none of that name, or its matrix has changed since; where it has none at all, with what makes one.
pub(crate) fn solution(store: &Store, name: &str) -> Result<StoredSolution> {
    StoredSolution::open(store, name).map_err(|error| {
        if !StoredSolution::names(store).is_empty() {
            return error.into();
        }
        let matrix = crate::shell::word(store.directory());
        hinted(
            error.into(),
            format!("`hemicube solve {matrix}` makes one; heat's by `--thermal`"),
        )
    })
}

/// What reading a scene may take.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Limits {
    allow_large: bool,
    memory: Option<u64>,
}

impl Limits {
    /// As much memory as is free.
    pub(crate) fn of(allow_large: bool) -> Self {
        Self {
            allow_large,
            memory: None,
        }
    }
}

impl From<&SceneSettings> for Limits {
    fn from(settings: &SceneSettings) -> Self {
        Self {
            allow_large: settings.allow_large,
            memory: settings.memory,
        }
    }
}

/// The file of a matrix's scene where it is found: beside the matrix, or in the working directory.
pub(crate) fn found_scene(store: &Store) -> Option<PathBuf> {
    let name = Path::new(&store.manifest().scene.file);
    let name = name.file_name()?;
    let beside = store.directory().parent().map(|folder| folder.join(name));
    beside
        .into_iter()
        .chain([PathBuf::from(name)])
        .find(|path| path.exists())
}

/// The file of a matrix's scene: the one given, or the one that the matrix names.
///
/// # Errors
/// When none is given, and it is neither beside the matrix nor in the working directory.
pub(crate) fn scene_file(store: &Store, given: Option<&Path>, option: &str) -> Result<PathBuf> {
    if let Some(given) = given {
        return Ok(given.to_owned());
    }
    found_scene(store).ok_or_else(|| {
        hinted(
            anyhow!(
                "`{}` is the matrix of `{}`, which is neither beside it nor in this directory",
                store.directory().display(),
                store.manifest().scene.file
            ),
            format!("say where the scene is: {option}"),
        )
    })
}

/// Reads and cuts the scene of a matrix as for its computation.
///
/// # Errors
/// When it cannot be read, or is another scene than the matrix's.
pub(crate) fn scene(
    store: &Store,
    path: &Path,
    engine: &impl AsRef<EngineSettings>,
    limits: Limits,
) -> Result<Prepared> {
    let settings = SceneSettings {
        allow_large: limits.allow_large,
        memory: limits.memory,
        ..settings(store)?
    };
    let elements = u32::try_from(store.manifest().elements()).unwrap_or(u32::MAX);
    let prepared = prepare_of(path, &settings, engine, Work::Pixels, Some(elements))?;
    let is_scene =
        |prepared: &Prepared| scene_hash(&prepared.scene, &prepared.patches) == store.manifest().scene.blake3;
    let Some(mut prepared) = prepared.filter(is_scene) else {
        return Err(hinted(
            anyhow!(
                "`{}` is not the scene that `{}` is the matrix of",
                path.display(),
                store.directory().display()
            ),
            format!(
                "it was computed from `{}`; a scene that has changed since needs a matrix of its own",
                store.manifest().scene.file
            ),
        ));
    };
    prepared.grouping = Grouping::of_store(store, &prepared.scene, &prepared.patches)?;
    if store.manifest().settings.get("update").is_some() {
        // Its hemicubes stand as those of the matrix that it took rows over from.
        let numbers = store.patches()?.drawn_by;
        if numbers.len() == prepared.patches.len() {
            prepared.model = prepared.model.drawn_by(numbers);
        }
    }
    Ok(prepared)
}

/// The mirrors and panes of a matrix; `None` without any.
///
/// # Errors
/// When its settings do not fit the scene.
pub(crate) fn specular(store: &Store, prepared: &Prepared) -> Result<Option<Specular>> {
    let found = Specular::of_settings(&prepared.scene, &prepared.patches, &store.manifest().settings);
    found.with_context(|| {
        format!(
            "`{}` says other mirrors and panes than its scene has",
            store.directory().display()
        )
    })
}

/// The portals of a matrix, whose images the scene's model gets.
///
/// # Errors
/// When its settings do not fit the scene.
pub(crate) fn portals(store: &Store, prepared: &mut Prepared, hierarchy: HierarchyOptions) -> Result<Portals> {
    let specular = specular(store, prepared)?;
    let Some(settings) = ImageSettings::of_settings(&store.manifest().settings) else {
        return Ok(Portals { images: None, specular });
    };
    let made = Images::model(settings, &prepared.scene, &prepared.patches, hierarchy);
    let (model, images) = made.with_context(|| {
        format!(
            "`{}` says other symmetry and periods than its scene has",
            store.directory().display()
        )
    })?;
    prepared.model = model;
    Ok(Portals {
        images: Some(images),
        specular,
    })
}

/// The guess of the axis pointing up, where neither the matrix nor its scene at `path` tells; `None` where one does.
///
/// # Errors
/// When the scene cannot be read.
pub(crate) fn guessed_up(store: &Store, path: &Path) -> Result<Option<Up>> {
    let settings = settings(store)?;
    if settings.up.is_some() {
        return Ok(None);
    }
    let scene = SceneInput::new(
        hemicube_scene::load(path, ReadOptions::default())?,
        path,
        settings.given(),
    )?;
    let found = up(&scene);
    Ok(found.known().is_none().then_some(found))
}

/// The sky rows beside a matrix, from `hemicube sky --matrix`.
///
/// # Errors
/// When there are none, or the matrix has been computed anew from another scene.
pub(crate) fn sky(store: &Store) -> Result<PathBuf> {
    let path = sky_beside(store);
    sky_record(store)?;
    Ok(path)
}

/// Division and horizon of the sky rows in a file of `hemicube sky`, from the record beside it.
///
/// # Errors
/// When the record cannot be read, or lacks them.
pub(crate) fn sky_frame(path: &Path) -> Result<(SkyDivision, Horizon)> {
    let record = path.with_extension("json");
    let cannot = || format!("`{}` cannot be read", record.display());
    let text = hemicube_scene::read_regular_text(&record).with_context(cannot)?;
    let found: Value = serde_json::from_str(&text).with_context(cannot)?;
    let division: Option<Division> = found["division"].as_str().and_then(|text| text.parse().ok());
    let up = match found["up"].as_str() {
        Some("x") => Some(Axis::X),
        Some("y") => Some(Axis::Y),
        Some("z") => Some(Axis::Z),
        _ => None,
    };
    let whole = division
        .and_then(|division| SkyDivision::new(division.0))
        .zip(up.zip(found["north_degrees"].as_f64()));
    let (division, (up, north)) = whole.with_context(|| {
        format!(
            "`{}` says no division of the sky, no way up or no north: `hemicube sky` writes them",
            record.display()
        )
    })?;
    Ok((division, Horizon::new(up, north)))
}

/// The horizon of a matrix's scene: that of the sky rows beside it, or, with +y, −z or +z north, what is known of up.
///
/// # Errors
/// When neither says which way is up.
pub(crate) fn horizon(store: &Store, prepared: &Prepared) -> Result<Horizon> {
    if let Ok(path) = sky(store) {
        return Ok(sky_frame(&path)?.1);
    }
    let given = settings(store)?.up.map(Into::into);
    let up = given.or(up(&prepared.scene).known()).ok_or_else(|| {
        hinted(
            anyhow!(
                "neither `{}` nor the matrix says which axis points up",
                prepared.input.path
            ),
            format!(
                "`hemicube sky {} --matrix {} --up z` says it for all; or give `x,y,z` in the scene's axes",
                crate::shell::word(store.manifest().scene.file.as_ref()),
                crate::shell::word(store.directory())
            ),
        )
    })?;
    Ok(Horizon::new(up, 0.0))
}

fn sky_record(store: &Store) -> Result<Value> {
    let path = sky_beside(store);
    let record = path.with_extension("json");
    let step = format!(
        "`hemicube sky SCENE --matrix {}` computes them",
        store.directory().display()
    );
    if !path.exists() || !record.exists() {
        return Err(hinted(
            anyhow!("`{}` has no sky rows", store.directory().display()),
            step,
        ));
    }
    let cannot = || format!("`{}` cannot be read", record.display());
    let text = hemicube_scene::read_regular_text(&record).with_context(cannot)?;
    let found: Value = serde_json::from_str(&text).with_context(cannot)?;
    if found["scene_blake3"].as_str() != Some(store.manifest().scene.blake3.as_str()) {
        return Err(hinted(
            anyhow!(
                "`{}` is of another scene than the matrix beside it, which was computed anew",
                path.display()
            ),
            step,
        ));
    }
    Ok(found)
}
