//! The scenes of the study: the thesis's by their sizes, and additional ones.

use crate::report::PendingFile;
use anyhow::{Context, Result, bail};
use hemicube::{HierarchyOptions, Model};
use hemicube_scene::generate::Kind;
use hemicube_scene::generate::{Generate, generate};
use hemicube_scene::repair::{RepairOptions, repair};
use hemicube_scene::{Patches, ReadOptions, Scene, Subdivision, load, write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Extent of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Size {
    Quick,
    Full,
}

/// Patches of the thesis's city; its other scenes are sized relative to it.
pub(super) const CITY: u64 = 8_897;
const ROOM: u64 = 10_240;
const VENICE: u64 = 1_495_068;
/// Patches of the scene for `scripts/peers`: small enough for peers with memory quadratic in it.
const PEERS: u64 = 1_000;
/// Pieces of each edge of the larger city: 16 patches for one.
const SPLIT: u32 = 4;

/// Purpose of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Its octree's parameters are tried as in tables 4.3 and 4.4.
    City,
    /// Its octree's parameters are tried as in table 4.5.
    Venice,
    /// Beside these.
    Other,
    /// Only for time against the number of patches.
    Step,
}

#[derive(Clone, Debug)]
enum Source {
    Generated(Generate),
    File(PathBuf),
}

/// A scene of the study.
#[derive(Clone, Debug)]
pub(super) struct StudyScene {
    /// In keys and names of files.
    pub(super) key: String,
    /// In tables.
    pub(super) title: String,
    pub(super) role: Role,
    source: Source,
    split: u32,
    /// About how many patches it has.
    pub(super) target: u64,
}

/// A scene made ready.
pub(super) struct Ready {
    pub(super) patches: Arc<Patches>,
    pub(super) model: Model,
}

impl StudyScene {
    fn generated(key: &str, title: &str, kind: Kind, target: u64, split: u32, role: Role) -> Self {
        let source = Source::Generated(Generate {
            kind,
            target_patches: target.max(1),
            seed: 1,
        });
        Self {
            key: key.to_owned(),
            title: title.to_owned(),
            role,
            source,
            split,
            target: target * u64::from(split * split),
        }
    }

    fn read(&self) -> Result<Scene> {
        Ok(match &self.source {
            Source::Generated(spec) => generate(*spec)?,
            Source::File(path) => {
                let mut scene = load(path, ReadOptions::default())?;
                repair(&mut scene, RepairOptions::default());
                scene
            }
        })
    }

    /// Reads or generates it.
    ///
    /// # Errors
    /// When it cannot be read, or has no patch.
    pub(super) fn ready(&self) -> Result<Ready> {
        let scene = self.read()?;
        let patches = Arc::new(Patches::new(&scene, Subdivision::Split(self.split))?);
        drop(scene);
        let model = Model::new(Arc::clone(&patches), HierarchyOptions::default())
            .with_context(|| format!("scene `{}` cannot be computed", self.key))?;
        Ok(Ready { patches, model })
    }

    /// Writes the scene to a file in `folder`, for programs that read one; returns it with the number of pieces of each
    /// edge.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn file(&self, folder: &Path) -> Result<(PathBuf, u32)> {
        if let Source::File(path) = &self.source {
            return Ok((path.clone(), self.split));
        }
        let path = folder.join(format!("{}.obj", self.key));
        let cannot = || format!("`{}` cannot be written", path.display());
        std::fs::create_dir_all(folder).with_context(cannot)?;
        let mut out = PendingFile::create(&path)?;
        write::obj(&self.read()?, &mut out).with_context(cannot)?;
        out.commit()?;
        Ok((path, self.split))
    }
}

/// The scenes, smallest first. `city` is the number of the city's patches; the others keep their sizes relative to it.
///
/// # Errors
/// When a named folder of scenes has none of the study's.
pub(super) fn scenes(size: Size, city: u64, folder: Option<&Path>) -> Result<Vec<StudyScene>> {
    let beside = |there: u64| (city * there).div_ceil(CITY).max(40);
    let mut scenes = vec![
        StudyScene::generated("room", "room", Kind::Room, beside(ROOM), 1, Role::Other),
        StudyScene::generated("city", "city", Kind::City, city, 1, Role::City),
        StudyScene::generated("city-x16", "city ×16", Kind::City, city, SPLIT, Role::City),
        StudyScene::generated("maze", "maze", Kind::Maze, city, 1, Role::Other),
        StudyScene::generated(
            "field",
            "field (hardly any occlusion)",
            Kind::Field,
            city,
            1,
            Role::Other,
        ),
    ];
    if size == Size::Full {
        scenes.extend([
            StudyScene::generated("room-1k", "room of 1,000", Kind::Room, PEERS.min(city), 1, Role::Step),
            StudyScene::generated("city-1k", "city of 1,000", Kind::City, PEERS.min(city), 1, Role::Step),
            StudyScene::generated("spheres", "spheres", Kind::Spheres, city, 1, Role::Other),
            StudyScene::generated("maze-x16", "maze ×16", Kind::Maze, city, SPLIT, Role::Other),
            StudyScene::generated("city-quarter", "city ÷4", Kind::City, city / 4, 1, Role::Step),
            StudyScene::generated("city-x4", "city ×4", Kind::City, 4 * city, 1, Role::Step),
            StudyScene::generated(
                "city-large",
                "city as large as Venice",
                Kind::City,
                beside(VENICE),
                1,
                Role::Venice,
            ),
        ]);
    }
    if let Some(folder) = folder {
        let name = "denhaag-8897";
        let places = [
            folder.join("city").join(format!("{name}.obj")),
            folder.join(format!("{name}.obj")),
        ];
        let Some(path) = places.iter().find(|path| path.is_file()) else {
            bail!(
                "`{}` has no `{name}.obj`, nor has `{}`; leave `--scenes` out to do without it",
                folder.display(),
                folder.join("city").display()
            );
        };
        for (split, key, title) in [
            (1, name.to_owned(), name.to_owned()),
            (SPLIT, format!("{name}-x16"), format!("{name} ×16")),
        ] {
            scenes.push(StudyScene {
                key,
                title,
                role: Role::City,
                source: Source::File(path.clone()),
                split,
                target: CITY * u64::from(split * split),
            });
        }
    }
    scenes.sort_by_key(|scene| scene.target);
    Ok(scenes)
}
