//! Selection of rows and columns by the names of objects and materials: `*` stands for any characters, `?` for one.

use crate::driver::compute::Selection;
pub use hemicube_scene::globs::{Patterns, Tie, matches_glob};
use hemicube_scene::{Patches, Scene};
use std::collections::BTreeSet;

/// Names listed by an error.
const NAMES_SHOWN: usize = 5;

/// Globs for the names of objects and materials. An empty list chooses nothing, and so leaves everything chosen.
///
/// ```
/// use hemicube::driver::compute::Selection;
/// use hemicube::driver::selection::Names;
/// use hemicube_scene::{Patches, Subdivision, generate};
///
/// let scene = generate::cornell_box();
/// let patches = Patches::new(&scene, Subdivision::Split(2))?;
/// let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
///
/// // What the light sends to all but the blocks, which only stand in the way.
/// let (emitters, occluders) = (names(&["light"]), names(&["*_block"]));
/// let chosen = Names { emitters: &emitters, occluders: &occluders, ..Names::default() };
/// let selection = Selection::by_name(&scene, &patches, chosen)?;
/// let count = |chosen: Option<Vec<bool>>| chosen.map(|chosen| chosen.iter().filter(|&&is| is).count());
/// assert_eq!(count(selection.emitters), Some(8));
/// assert_eq!(count(selection.receivers), Some(80));
///
/// // A name that nothing has is a mistake, and the error says what there is.
/// let emitters = names(&["lamp"]);
/// let error = Selection::by_name(&scene, &patches, Names { emitters: &emitters, ..Names::default() });
/// assert!(error.is_err_and(|error| error.list == "emitters" && error.there.contains("`ceiling`")));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Names<'a> {
    /// Patches with rows; empty: all.
    pub emitters: &'a [String],
    /// Patches with columns; empty: all.
    pub receivers: &'a [String],
    /// Patches with neither, which only occlude.
    pub occluders: &'a [String],
}

/// Turns round the one-sided triangles of objects with names that match one of `globs`; `all` stands for every object.
/// Two-sided triangles radiate from both sides and are not turned. Returns the number of triangles turned.
///
/// # Errors
/// When a glob matches no object with one-sided triangles.
///
/// ```
/// use hemicube::driver::selection::flip;
/// use hemicube_scene::generate;
///
/// let room = generate::cornell_box();
/// let mut turned = room.clone();
/// let triangles = flip(&mut turned, &["left_*".to_owned()])?;
/// assert_eq!(triangles, room.triangles.iter().zip(&turned.triangles).filter(|(a, b)| a != b).count());
/// assert!(triangles > 0 && flip(&mut turned, &["left_*".to_owned()])? == triangles);
/// assert_eq!(room, turned);
/// assert!(flip(&mut turned, &["lamp".to_owned()]).is_err_and(|error| error.there.contains("`ceiling`")));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn flip(scene: &mut Scene, globs: &[String]) -> Result<usize, NoMatch> {
    let mut chosen = vec![false; scene.objects.len().max(1)];
    for glob in globs {
        let matching: Vec<bool> = (0..chosen.len())
            .map(|object| glob == "all" || matches_object(scene, object, glob))
            .collect();
        let is_of = |object: u32| matching.get(object as usize).copied().unwrap_or(false);
        if !scene
            .triangles
            .iter()
            .any(|triangle| !triangle.two_sided && is_of(triangle.object))
        {
            let objects: BTreeSet<&str> = scene
                .triangles
                .iter()
                .filter(|triangle| !triangle.two_sided)
                .filter_map(|triangle| scene.objects.get(triangle.object as usize))
                .map(String::as_str)
                .collect();
            return Err(NoMatch {
                list: "flip",
                glob: glob.clone(),
                there: if objects.is_empty() {
                    "the scene has none: all of its triangles are two-sided, or its objects have no names".to_owned()
                } else {
                    format!("the scene has {}", list("objects", objects))
                },
            });
        }
        for (chosen, matching) in chosen.iter_mut().zip(matching) {
            *chosen |= matching;
        }
    }
    let mut turned = 0;
    for triangle in scene.triangles.iter_mut().filter(|triangle| !triangle.two_sided) {
        if chosen.get(triangle.object as usize).copied().unwrap_or(false) {
            triangle.corners.swap(1, 2);
            turned += 1;
        }
    }
    Ok(turned)
}

/// Takes the triangles out of a scene whose object or material matches one of `globs`. Returns their number.
///
/// # Errors
/// When a glob matches nothing.
///
/// ```
/// use hemicube::driver::selection::exclude;
/// use hemicube_scene::generate;
///
/// let mut room = generate::cornell_box();
/// let whole = room.triangles.len();
/// let left_out = exclude(&mut room, &["*_block".to_owned()])?;
/// assert!(left_out > 0 && room.triangles.len() == whole - left_out);
/// assert!(exclude(&mut room, &["*_block".to_owned()]).is_err(), "they are gone");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn exclude(scene: &mut Scene, globs: &[String]) -> Result<usize, NoMatch> {
    let whole = scene.triangles.len();
    for glob in globs {
        let objects = matching_objects(scene, glob);
        let materials: Vec<bool> = scene.materials.iter().map(|of| matches_glob(glob, &of.name)).collect();
        let is = |names: &[bool], index: u32| names.get(index as usize).copied().unwrap_or(false);
        let before = scene.triangles.len();
        scene
            .triangles
            .retain(|triangle| !is(&objects, triangle.object) && !is(&materials, triangle.material));
        if scene.triangles.len() == before {
            return Err(NoMatch {
                list: "exclude",
                glob: glob.clone(),
                there: names(scene),
            });
        }
    }
    Ok(whole - scene.triangles.len())
}

/// Returns whether an object has a name that matches a glob, its further names included.
pub fn matches_object(scene: &Scene, object: usize, glob: &str) -> bool {
    let number = u32::try_from(object).unwrap_or(u32::MAX);
    let further = scene.further_names.get(&number).into_iter().flatten();
    let mut all = scene.objects.get(object).into_iter().chain(further);
    all.any(|name| matches_glob(glob, name))
}

/// Whether each object of a scene matches a glob.
pub fn matching_objects(scene: &Scene, glob: &str) -> Vec<bool> {
    (0..scene.objects.len())
        .map(|object| matches_object(scene, object, glob))
        .collect()
}

/// A glob matches nothing of the scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{glob}` matches no object and no material of a patch; {there}")]
pub struct NoMatch {
    /// Its list: `emitters`, `receivers`, `occluders`, `flip` or `exclude`.
    pub list: &'static str,
    /// The glob.
    pub glob: String,
    /// The names to choose from.
    pub there: String,
}

/// True for each patch with an object or material that matches one of `globs`; `None` without a glob.
fn matching(
    scene: &Scene,
    patches: &Patches,
    list: &'static str,
    globs: &[String],
) -> Result<Option<Vec<bool>>, NoMatch> {
    if globs.is_empty() {
        return Ok(None);
    }
    let mut found = vec![false; patches.len()];
    for glob in globs {
        let objects = matching_objects(scene, glob);
        let materials: Vec<bool> = scene
            .materials
            .iter()
            .map(|material| matches_glob(glob, &material.name))
            .collect();
        let is = |names: &[bool], index: u32| names.get(index as usize).copied().unwrap_or(false);
        let mut any = false;
        for patch in patches.iter() {
            let triangle = &scene.triangles[patches.triangle(patch)];
            if is(&objects, triangle.object) || is(&materials, triangle.material) {
                found[patch.0 as usize] = true;
                any = true;
            }
        }
        if !any {
            return Err(NoMatch {
                list,
                glob: glob.clone(),
                there: names(scene),
            });
        }
    }
    Ok(Some(found))
}

/// The first few of some names.
fn list(of: &str, names: BTreeSet<&str>) -> String {
    let shown: Vec<String> = names.iter().take(NAMES_SHOWN).map(|name| format!("`{name}`")).collect();
    let more = names.len().saturating_sub(NAMES_SHOWN);
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    if shown.is_empty() {
        format!("no {of}")
    } else {
        format!("the {of} {}{more}", shown.join(", "))
    }
}

/// The names to choose from.
fn names(scene: &Scene) -> String {
    let objects = scene
        .objects
        .iter()
        .chain(scene.further_names.values().flatten())
        .map(String::as_str)
        .filter(|name| !name.is_empty())
        .collect();
    let materials = scene
        .materials
        .iter()
        .map(|m| m.name.as_str())
        .filter(|name| !name.is_empty())
        .collect();
    format!(
        "the scene has {} and {}",
        list("objects", objects),
        list("materials", materials)
    )
}

impl Selection {
    /// The rows and columns of patches of these names.
    ///
    /// # Errors
    /// When a glob matches nothing.
    pub fn by_name(scene: &Scene, patches: &Patches, names: Names<'_>) -> Result<Self, NoMatch> {
        let mut selection = Self {
            emitters: matching(scene, patches, "emitters", names.emitters)?,
            receivers: matching(scene, patches, "receivers", names.receivers)?,
        };
        if let Some(occluders) = matching(scene, patches, "occluders", names.occluders)? {
            for side in [&mut selection.emitters, &mut selection.receivers] {
                let chosen = side.get_or_insert_with(|| vec![true; occluders.len()]);
                for (chosen, &occludes_only) in chosen.iter_mut().zip(&occluders) {
                    *chosen &= !occludes_only;
                }
            }
        }
        Ok(selection)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::{Subdivision, generate};

    #[test]
    fn occluders_have_neither_rows_nor_columns() {
        let scene = generate::cornell_box();
        let patches = Patches::new(&scene, Subdivision::None).unwrap();
        assert_eq!(
            Selection::by_name(&scene, &patches, Names::default()).unwrap(),
            Selection::default()
        );
        let (all, name) = (["*".to_owned()], [scene.objects[0].clone()]);
        let found = Selection::by_name(
            &scene,
            &patches,
            Names {
                receivers: &all,
                occluders: &name,
                ..Names::default()
            },
        );
        let found = found.unwrap();
        let (emitters, receivers) = (found.emitters.unwrap(), found.receivers.unwrap());
        assert_eq!(emitters, receivers);
        let left = emitters.iter().filter(|&&chosen| chosen).count();
        assert!(left > 0 && left < patches.len());
        let none = ["no such thing*".to_owned()];
        let error = Selection::by_name(
            &scene,
            &patches,
            Names {
                emitters: &none,
                ..Names::default()
            },
        );
        let error = error.unwrap_err();
        assert_eq!((error.list, error.glob.as_str()), ("emitters", "no such thing*"));
        assert!(error.there.contains("the scene has the objects"), "{error}");
    }
}
