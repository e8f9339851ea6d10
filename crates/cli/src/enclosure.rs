//! Sentences on how a scene encloses: objects facing the wrong way, and holes.

use crate::args::Talk;
use crate::escape::shown;
use crate::prepare::Prepared;
use crate::report::{count, counted, figures, percent};
use hemicube::diagnose::{DiagnoseOptions, Enclosure, Leak, Part, Turn, Winding, doubles, enclosure};
use hemicube::driver::selection::matches_glob;
use hemicube_scene::Axis;
use std::collections::BTreeSet;

/// A run's scene is examined if its mean row sum is at most this, or its mean blocked share at least this.
const LEAST_SUM: f64 = 0.02;
const MOST_BLOCKED: f64 = 0.01;
/// Largest mean escaped share at which objects may see only themselves, and the least of one object.
const MOST_ESCAPED: f64 = 0.3;
const LEAST_ESCAPED: f64 = 1e-3;
/// Surfaces of a scene that is examined though nothing is odd, at most: for each row of the run, and in any run. An
/// examination takes some 3 µs a surface, a row a millisecond.
const SURFACES_A_ROW: u64 = 10;
const FEW_SURFACES: u64 = 30_000;
/// Most surfaces of an examined scene.
const SURFACES_MAX: usize = 1500;
/// Most surfaces if nothing but a closed view is odd.
const SURFACES_OF_CLOSED: usize = 400;
/// Names in a sentence.
const NAMES_SHOWN: usize = 4;

/// What the examination needs of a scene's triangles.
pub(crate) struct Objects {
    /// Of each triangle.
    of: Vec<u32>,
    up: Option<Axis>,
}

/// The object of each triangle of the scene, and the axis that points up.
pub(crate) fn objects(prepared: &Prepared) -> Objects {
    let triangles = prepared.scene.triangles.iter();
    Objects {
        of: triangles.map(|triangle| triangle.object).collect(),
        up: hemicube_scene::up::up(&prepared.scene).known(),
    }
}

/// Examines the enclosure, with triangles grouped by [`objects`].
pub(crate) fn of(prepared: &Prepared, objects: &Objects, options: DiagnoseOptions) -> Enclosure {
    let up = objects.up;
    enclosure(
        &prepared.model,
        |patch| objects.of[prepared.patches.triangle(patch)],
        DiagnoseOptions { up, ..options },
    )
}

/// Returns whether rows look odd: nothing in sight, or many backs in view.
fn is_odd(row_sum: f64, blocked: f64) -> bool {
    row_sum <= LEAST_SUM || blocked >= MOST_BLOCKED
}

/// Returns whether a run's scene is to be examined: its rows are odd, or little of them escapes, unless one object is
/// closed. What is not odd is examined where that takes a small part of the run's time.
pub(crate) fn is_examined(prepared: &Prepared, rows: u64, [row_sum, escaped, blocked]: [f64; 3]) -> bool {
    let is_quick = || prepared.patches.surfaces().len() as u64 <= FEW_SURFACES.max(SURFACES_A_ROW * rows);
    let is_one = prepared.scene.objects.len() <= 1;
    is_odd(row_sum, blocked) || (escaped <= MOST_ESCAPED && !(is_one && escaped <= LEAST_ESCAPED) && is_quick())
}

/// Warnings about the scene of a run with odd rows.
pub(crate) fn questions(
    prepared: &Prepared,
    objects: &Objects,
    [row_sum, blocked]: [f64; 2],
    threads: usize,
) -> Vec<String> {
    let options = DiagnoseOptions {
        threads,
        surfaces_max: if is_odd(row_sum, blocked) {
            SURFACES_MAX
        } else {
            SURFACES_OF_CLOSED
        },
        ..DiagnoseOptions::default()
    };
    let found = of(prepared, objects, options);
    let mut sentences = of_windings(prepared, &found.winding);
    if sentences.is_empty() && row_sum == 0.0 {
        sentences.push(format!(
            "the matrix is empty: no patch of these rows sees another; {} of the view leaves the scene, and {} is \
             backs",
            percent(1.0 - blocked),
            percent(blocked)
        ));
    }
    if sentences.is_empty() && !prepared.scene.is_oriented {
        sentences.extend(of_groups(&found));
    }
    sentences
}

/// Warns of a scene under the sky, or with free points, whose surfaces face the wrong way: their insides would be what
/// is computed. A solid alone, which is right there, is passed over. Call it before the images of portals are added.
pub(crate) fn warn_of_winding(prepared: &Prepared, threads: usize, talk: Talk) {
    let options = DiagnoseOptions {
        threads,
        surfaces_max: SURFACES_OF_CLOSED,
        ..DiagnoseOptions::default()
    };
    let mut found = of(prepared, &objects(prepared), options);
    found.winding.retain(|winding| winding.turn != Turn::All);
    for sentence in of_windings(prepared, &found.winding) {
        talk.warn(&sentence);
    }
}

/// Adds what lies on other surfaces to the ledger. Call it before the images of portals are added: they are the scene's
/// triangles once more.
pub(crate) fn note_doubles(prepared: &mut Prepared, threads: usize) {
    let options = DiagnoseOptions {
        threads,
        ..DiagnoseOptions::default()
    };
    let found = doubles(&prepared.model, &prepared.scene, options);
    prepared.scene.scene.ledger.join(found);
}

/// The sentence on groups of surfaces that see only themselves.
pub(crate) fn of_groups(found: &Enclosure) -> Option<String> {
    (found.apart > 0).then(|| {
        format!(
            "{} of surfaces each see only their own insides: right for rooms; for buildings that are seen from \
             outside, `--flip all` turns them round",
            counted(found.apart, "group")
        )
    })
}

/// A word of a command line.
fn word(text: &str) -> String {
    crate::shell::quoted(shown(text).as_ref().as_ref())
}

/// The options that turn exactly these objects round.
fn options(prepared: &Prepared, names: &BTreeSet<&str>) -> String {
    let others = || {
        prepared
            .scene
            .objects
            .iter()
            .map(String::as_str)
            .filter(|name| !names.contains(name))
    };
    if names.len() <= NAMES_SHOWN {
        let options: Vec<String> = names.iter().map(|name| format!("--flip {}", word(name))).collect();
        return format!("`{}`", options.join(" "));
    }
    // One glob, if a common beginning or end tells them from all others.
    let common = |reversed: bool| {
        let chars = |name: &str| -> Vec<char> {
            if reversed {
                name.chars().rev().collect()
            } else {
                name.chars().collect()
            }
        };
        let (first, last) = (
            chars(names.first().copied().unwrap_or("")),
            names.iter().map(|name| chars(name)),
        );
        let shared = last.fold(first.len(), |shared, name| {
            shared.min(first.iter().zip(&name).take_while(|(a, b)| a == b).count())
        });
        let part = &first[..shared];
        if reversed {
            format!("*{}", part.iter().rev().collect::<String>())
        } else {
            format!("{}*", part.iter().collect::<String>())
        }
    };
    [common(false), common(true)]
        .into_iter()
        .find(|glob| others().all(|name| !matches_glob(glob, name)))
        .map_or_else(
            || {
                let options: Vec<String> = names.iter().map(|name| format!("--flip {}", word(name))).collect();
                format!("`{}`", options.join(" "))
            },
            |glob| format!("`--flip {}`", word(&glob)),
        )
}

/// The defects of objects' winding, and what to try. Parts alone that face the same wrong way are told at once.
pub(crate) fn of_windings(prepared: &Prepared, windings: &[Winding]) -> Vec<String> {
    let mut told: Vec<Winding> = Vec::new();
    // Where a format says which way its surfaces face, a few may contradict it, but not what encloses a zone.
    let is_right = |winding: &&Winding| prepared.scene.is_oriented && winding.turn != Turn::Objects;
    for winding in windings.iter().filter(|winding| !is_right(winding)) {
        let parts_alone = |of: &Winding| of.objects.is_empty() && !of.parts.is_empty();
        let joins = |before: &&mut Winding| before.turn == winding.turn && parts_alone(before) && parts_alone(winding);
        if let Some(before) = told.iter_mut().find(joins) {
            before.parts.extend(winding.parts.iter().cloned());
            before.lost += winding.lost;
        } else {
            told.push(winding.clone());
        }
    }
    told.iter().map(|winding| of_winding(prepared, winding)).collect()
}

/// The defect of a winding, and what to try.
fn of_winding(prepared: &Prepared, winding: &Winding) -> String {
    let names: BTreeSet<&str> = winding
        .objects
        .iter()
        .filter_map(|&object| prepared.scene.objects.get(object as usize))
        .map(String::as_str)
        .collect();
    let mut listed: Vec<String> = names
        .iter()
        .take(NAMES_SHOWN)
        .map(|name| format!("`{}`", shown(name)))
        .collect();
    if names.len() > NAMES_SHOWN {
        listed.push(format!("{} more", count((names.len() - NAMES_SHOWN) as u64)));
    }
    let listed = listing(&listed);
    let lost = percent(winding.lost);
    let one = names.len() == 1;
    let them = if one { "it" } else { "them" };
    match winding.turn {
        Turn::All => format!(
            "the model is wound outwards throughout: its patches face away from the space that it encloses, which is \
             right for a solid alone that is seen from outside; for the space within, {}",
            turned_all(prepared)
        ),
        Turn::Everything => format!(
            "everything faces the wrong way: the ground faces down, and what stands on it inwards; {}",
            turned_all(prepared)
        ),
        _ if !winding.parts.is_empty() => of_parts(prepared, winding, &listed, &lost),
        Turn::InsideOut => format!(
            "{} {} inwards ({listed}): {} only {} own {}, and others see {}, {lost} of all views; {} \
             turns {them} round",
            counted(winding.objects.len() as u64, "object"),
            if one { "faces" } else { "face" },
            if one { "it sees" } else { "they see" },
            if one { "its" } else { "their" },
            if one { "inside" } else { "insides" },
            if one { "its back" } else { "their backs" },
            options(prepared, &names)
        ),
        Turn::Ground => format!(
            "{listed} {} down and {} nothing, and {lost} of all views is lost by {}; {} turns {them} round",
            if one { "faces" } else { "face" },
            if one { "sees" } else { "see" },
            if one { "its back" } else { "their backs" },
            options(prepared, &names)
        ),
        _ => format!(
            "{listed} {} the wrong way: {lost} of all views is lost by {}; {} turns {them} round, and \
             `--two-sided on` is for sheets",
            if one { "faces" } else { "face" },
            if one { "its back" } else { "their backs" },
            options(prepared, &names),
        ),
    }
}

/// What turns the whole model round.
fn turned_all(prepared: &Prepared) -> &'static str {
    if prepared.scene.settings.flip.iter().any(|glob| glob == "all") {
        "leave `--flip all` out"
    } else {
        "`--flip all` turns it round"
    }
}

/// `a, b and c`.
fn listing(of: &[String]) -> String {
    match of.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
        None => String::new(),
    }
}

/// The sentence where parts of objects face the wrong way, which no option turns; whole objects may be among them.
fn of_parts(prepared: &Prepared, winding: &Winding, objects: &str, lost: &str) -> String {
    let parts = &winding.parts;
    let name = |part: &Part| {
        let names = &prepared.scene.objects;
        let name = names.get(part.object as usize).map_or("", String::as_str);
        if name.is_empty() {
            String::new()
        } else {
            format!("`{}` ", shown(name))
        }
    };
    let mut listed: Vec<String> = parts
        .iter()
        .take(NAMES_SHOWN)
        .map(|part| format!("{}at {}", name(part), extent(part.low, part.high)))
        .collect();
    if parts.len() > NAMES_SHOWN {
        listed.push(format!("{} more", count((parts.len() - NAMES_SHOWN) as u64)));
    }
    let among = if objects.is_empty() {
        String::new()
    } else {
        format!(", and {objects}")
    };
    let one = parts.len() == 1 && objects.is_empty();
    let way = match winding.turn {
        Turn::InsideOut => "inwards",
        Turn::Ground => "down",
        _ => "the wrong way",
    };
    format!(
        "{} of objects {} {way} ({}{among}): {lost} of all views is lost by {}; turn {} round in the modeller, as \
         `--flip` turns whole objects",
        counted(parts.len() as u64, "part"),
        if one { "faces" } else { "face" },
        listed.join("; "),
        if one { "its back" } else { "their backs" },
        if one { "it" } else { "them" },
    )
}

/// `x 2.25–3, y 5, z 1.01–1.35`.
fn extent(low: [f64; 3], high: [f64; 3]) -> String {
    let across = low.iter().zip(high).map(|(low, high)| high - low).fold(0.0, f64::max);
    let number = |value: f64| {
        let text = format!("{value:.3}");
        let short = text.trim_end_matches('0').trim_end_matches('.');
        if short == "-0" {
            "0".to_owned()
        } else {
            short.to_owned()
        }
    };
    let parts: Vec<String> = ["x", "y", "z"]
        .iter()
        .zip(low.iter().zip(high))
        .map(|(axis, (&low, high))| {
            if high - low <= 1e-6 * across {
                format!("{axis} {}", number(low))
            } else {
                format!("{axis} {}–{}", number(low), number(high))
            }
        })
        .collect();
    parts.join(", ")
}

/// Place of a hole, and the share that leaves through it.
pub(crate) fn of_leak(prepared: &Prepared, leak: &Leak) -> String {
    let name = prepared
        .scene
        .objects
        .get(leak.object as usize)
        .map_or("", String::as_str);
    let name = if name.is_empty() {
        String::new()
    } else {
        format!("`{}` at ", shown(name))
    };
    format!(
        "{name}{}: area {}, {} of what escapes",
        extent(leak.low, leak.high),
        figures(leak.area),
        percent(leak.share)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_words() {
        assert_eq!(
            extent([2.25, 5.0, 1.0125], [3.0, 5.0, 1.35]),
            "x 2.25–3, y 5, z 1.012–1.35"
        );
        assert_eq!(word("north"), "north");
        assert_eq!(word("b1 *"), "'b1 *'");
    }
}
