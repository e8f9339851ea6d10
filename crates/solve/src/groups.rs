//! Properties by the further names of objects: a surface of a mesh may be in several groups, and its object shows the
//! name of the first.
//!
//! [`spread`] gives each such object a table of its own: the one that its own name has, with the values that it lacks
//! from the tables of its further names, in the order of the file. What holds by its own name holds first; a thermal
//! condition is taken whole.

use crate::solve::{Entry, Tables};
use hemicube_scene::globs::{Patterns, Tie, matches_glob};
use std::collections::{BTreeMap, BTreeSet};

/// Makes tables by further names those of the objects that have them.
///
/// # Errors
/// When two patterns match a name alike.
///
/// ```
/// use hemicube_solve::groups::spread;
/// use hemicube_solve::solve::Tables;
///
/// let objects = ["floor".to_owned(), "roof".to_owned()];
/// let further = [(1, vec!["insulated".to_owned()])].into();
/// let text = r#"{"object": {"roof": {"emissivity": 0.5}, "insulated": {"adiabatic": true, "emissivity": 0.9}}}"#;
/// let mut tables: Tables = serde_json::from_str(text)?;
/// spread(&mut tables, &objects, &[], &further)?;
/// assert_eq!(tables.object.len(), 1);
/// let roof = &tables.object["roof"];
/// assert_eq!(roof.adiabatic, Some(true));
/// assert_eq!(roof.emissivity, Some(hemicube_solve::solve::Spectrum::Grey(0.5)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn spread(
    tables: &mut Tables,
    objects: &[String],
    materials: &[String],
    further: &BTreeMap<u32, Vec<String>>,
) -> Result<(), Tie> {
    if further.is_empty() {
        return Ok(());
    }
    let fits = |key: &str, name: &String| key == name || matches_glob(key, name);
    let is_further = |key: &str| further.values().flatten().any(|name| fits(key, name));
    // A table of a material that only a further name of an object fits counts as that name's.
    let moved: Vec<String> = tables.material.keys().cloned().collect();
    for key in moved {
        let is_there = materials.iter().chain(objects).any(|name| fits(&key, name));
        if !is_there
            && is_further(&key)
            && !tables.object.contains_key(&key)
            && let Some(entry) = tables.material.remove(&key)
        {
            tables.object.insert(key, entry);
        }
    }
    let patterns = Patterns::new(&tables.object);
    let mut used: BTreeSet<&String> = BTreeSet::new();
    let mut made: BTreeMap<String, Entry> = BTreeMap::new();
    for (&object, names) in further {
        let Some(own) = objects.get(object as usize) else {
            continue;
        };
        let mut entry: Option<Entry> = patterns.of(own)?.map(|(_, entry)| entry.clone());
        let mut changed = false;
        for name in names {
            let Some((key, other)) = patterns.of(name)? else {
                continue;
            };
            used.insert(key);
            changed = true;
            fill(entry.get_or_insert_with(Entry::default), other);
        }
        if let Some(entry) = entry.filter(|_| changed) {
            made.insert(own.clone(), entry);
        }
    }
    let gone: Vec<String> = used
        .into_iter()
        .filter(|key| !objects.iter().any(|name| fits(key, name)))
        .cloned()
        .collect();
    for key in gone {
        tables.object.remove(&key);
    }
    tables.object.extend(made);
    Ok(())
}

/// Fills what an entry lacks.
fn fill(entry: &mut Entry, other: &Entry) {
    let take = |own: &mut Option<_>, other: &Option<_>| {
        if own.is_none() {
            own.clone_from(other);
        }
    };
    take(&mut entry.reflectance, &other.reflectance);
    take(&mut entry.emission, &other.emission);
    take(&mut entry.emissivity, &other.emissivity);
    let has_condition = entry.temperature.is_some()
        || entry.adiabatic.is_some()
        || entry.flux.is_some()
        || entry.heat.is_some()
        || entry.isothermal.is_some()
        || entry.body.is_some();
    if !has_condition {
        entry.temperature = other.temperature;
        entry.adiabatic = other.adiabatic;
        entry.flux = other.flux;
        entry.heat = other.heat;
        entry.isothermal = other.isothermal;
        entry.body.clone_from(&other.body);
    }
}
