//! The axis pointing up: the format's word, or found from names and normals.
//!
//! With the area A, the normal n and the axis e of each triangle, an axis is found where one of these is clear:
//!
//! ```text
//! names     Σ A q(n·e) / Σ A over triangles of objects or materials named for what they are; q is (n·e)² for a floor
//!           and 1 − (n·e)² for a wall. At least 0.6 along one axis, and 0.2 less along the others
//! uprights  Σ A [n·e < 0.15 or n·e > 0.985] / Σ A: walls stand in many directions and only along e are they upright
//!           and floors level. At least 0.85 along one axis, 0.15 of it level, and 0.2 less along the others
//! open      |Σ A n·e| / Σ A at least 0.1 and four times that of the others', the extent along e at most half of the
//!           others': ground and roofs without undersides, whichever way they are wound
//! ```
//!
//! Two that contradict each other find nothing. What is not found is a guess, which only [`crate::survey`] tells.

use crate::{Axis, Scene};
use glam::DVec3;

/// The axis pointing up, and how it is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Up {
    /// The axis.
    pub axis: Axis,
    /// The reason, as a clause.
    pub reason: String,
    /// The evidence.
    pub source: Source,
}

/// Evidence for the axis pointing up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The format, or the user, says so.
    Said,
    /// Names or normals leave no doubt.
    Found,
    /// Nothing tells; the axis is a guess from the extent.
    Guessed,
}

impl Up {
    /// The axis, unless it is a guess.
    pub fn known(&self) -> Option<Axis> {
        (self.source != Source::Guessed).then_some(self.axis)
    }
}

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];
const LETTERS: [char; 3] = ['x', 'y', 'z'];

/// Names of level surfaces, and of upright ones, as parts of the words of a name.
const LEVEL: [&str; 14] = [
    "floor", "ceiling", "roof", "ground", "terrain", "road", "street", "pavement", "lawn", "grass", "water", "boden",
    "decke", "dach",
];
const UPRIGHT: [&str; 5] = ["wall", "facade", "window", "wand", "fassade"];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Named {
    Level,
    Upright,
}

/// Reads the axis from a name; `None` if it names neither, or both.
fn named(name: &str) -> Option<Named> {
    let name = name.to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
    match (has(&LEVEL), has(&UPRIGHT)) {
        (true, false) => Some(Named::Level),
        (false, true) => Some(Named::Upright),
        _ => None,
    }
}

/// Finds the axis pointing up.
///
/// ```
/// use hemicube_scene::up::{Source, up};
/// use hemicube_scene::{Axis, obj};
///
/// let text = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\no floor\nf 1 2 3 4\no back_wall\nf 1 5 6 2\n";
/// let found = up(&obj::read(text, None, Default::default())?);
/// assert_eq!((found.axis, found.source), (Axis::Z, Source::Found), "{}", found.reason);
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn up(scene: &Scene) -> Up {
    if let Some(axis) = scene.up {
        return Up {
            axis,
            reason: "the format says so".to_owned(),
            source: Source::Said,
        };
    }
    let sums = Sums::of(scene);
    let extent = extent(scene);
    let found = [sums.by_names(), sums.by_uprights(), sums.by_open_side(extent)];
    let mut known = found.iter().flatten();
    match known.next() {
        Some((place, reason)) if known.all(|(other, _)| other == place) => Up {
            axis: AXES[*place],
            reason: reason.clone(),
            source: Source::Found,
        },
        Some(_) => {
            let told = ["names", "uprights and levels", "what is open above"];
            let told = told.iter().zip(&found).filter_map(|(what, found)| {
                let (place, _) = found.as_ref()?;
                Some(format!("{what} tell {}", LETTERS[*place]))
            });
            Up {
                reason: format!("guessed: {}", told.collect::<Vec<_>>().join(", and ")),
                ..sums.guess(extent)
            }
        }
        None => sums.guess(extent),
    }
}

fn extent(scene: &Scene) -> DVec3 {
    let corners = || scene.triangles.iter().flat_map(|triangle| triangle.corners);
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    (high - low).max(DVec3::ZERO)
}

/// Sums over the triangles, by axis.
#[derive(Default)]
struct Sums {
    area: f64,
    /// Area of the triangles within 10° of perpendicular to the axis.
    level: [f64; 3],
    /// Area of the triangles that are level or upright.
    built: [f64; 3],
    /// Σ A n.
    net: DVec3,
    named_area: f64,
    named: [f64; 3],
}

impl Sums {
    fn of(scene: &Scene) -> Self {
        let of_names = |names: &mut dyn Iterator<Item = &str>| names.map(named).collect::<Vec<_>>();
        let objects = of_names(&mut scene.objects.iter().map(|name| &**name));
        let materials = of_names(&mut scene.materials.iter().map(|material| &*material.name));
        let mut sums = Self::default();
        for triangle in &scene.triangles {
            let [a, b, c] = triangle.corners;
            let across = 0.5 * (b - a).cross(c - a);
            let area = across.length();
            if !(area > 0.0 && area.is_finite()) {
                continue;
            }
            sums.area += area;
            sums.net += if triangle.two_sided { DVec3::ZERO } else { across };
            let object = objects.get(triangle.object as usize).copied().flatten();
            let named = object.or_else(|| materials.get(triangle.material as usize).copied().flatten());
            sums.named_area += if named.is_some() { area } else { 0.0 };
            for (axis, component) in (across / area).to_array().into_iter().enumerate() {
                let cosine = component.abs();
                sums.level[axis] += if cosine >= 0.985 { area } else { 0.0 };
                sums.built[axis] += if !(0.15..0.985).contains(&cosine) { area } else { 0.0 };
                sums.named[axis] += match named {
                    Some(Named::Level) => area * cosine * cosine,
                    Some(Named::Upright) => area * (1.0 - cosine * cosine),
                    None => 0.0,
                };
            }
        }
        sums
    }

    fn by_names(&self) -> Option<(usize, String)> {
        let shares = self.named.map(|sum| sum / self.named_area);
        let place = ahead(shares, 0.6, 0.2)?;
        let reason = format!(
            "found: what is named floor, roof, wall or the like lies and stands so for {:.0} % of its area",
            100.0 * shares[place]
        );
        Some((place, reason))
    }

    fn by_uprights(&self) -> Option<(usize, String)> {
        let shares = self.built.map(|sum| sum / self.area);
        let place = ahead(shares, 0.85, 0.2)?;
        // A tunnel's lining is upright along the tunnel.
        if self.level[place] < 0.15 * self.area {
            return None;
        }
        let reason = format!(
            "found: {:.0} % of the area lies level across {letter} or stands upright along it",
            100.0 * shares[place],
            letter = LETTERS[place]
        );
        Some((place, reason))
    }

    fn by_open_side(&self, extent: DVec3) -> Option<(usize, String)> {
        let [net, extent] = [(self.net / self.area).abs().to_array(), extent.to_array()];
        let place = (0..3).max_by(|&a, &b| net[a].total_cmp(&net[b]))?;
        let others = (0..3).filter(|&other| other != place);
        let is_flat = others.clone().all(|other| extent[place] <= 0.5 * extent[other]);
        let is_open = net[place] >= 0.1 && others.clone().all(|other| 4.0 * net[other] <= net[place]);
        let reason = format!(
            "found: the scene is flattest along {letter}, and fronts face {sign}{letter} without counterparts",
            letter = LETTERS[place],
            sign = if self.net[place] < 0.0 { "−" } else { "" }
        );
        (is_flat && is_open).then_some((place, reason))
    }

    /// z for a flat scene of level area, otherwise y.
    fn guess(&self, extent: DVec3) -> Up {
        let [x, y, z] = self.level;
        let flat = extent.z <= 0.5 * extent.x.min(extent.y);
        let (axis, reason) = if flat && z > x && z > y {
            let share = 100.0 * z / self.area;
            let reason =
                format!("guessed: the scene is flattest along z and {share:.0} % of its area lies level across it");
            (Axis::Z, reason)
        } else if flat {
            let reason = "guessed: most of the area does not lie level across z";
            (Axis::Y, reason.to_owned())
        } else {
            (Axis::Y, "guessed: the scene is not flat along z".to_owned())
        };
        Up {
            axis,
            reason,
            source: Source::Guessed,
        }
    }
}

/// The place of a share of at least `least` that is ahead of both others by `margin`.
fn ahead(shares: [f64; 3], least: f64, margin: f64) -> Option<usize> {
    (0..3).find(|&place| {
        let is_ahead = |other: usize| other == place || shares[place] - shares[other] >= margin;
        shares[place] >= least && (0..3).all(is_ahead)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::obj;

    fn of(text: &str) -> Up {
        up(&obj::read(text.as_bytes(), None, crate::ReadOptions::default()).expect("an OBJ file"))
    }

    /// A box from 0 to `size`, its floor named `floor`, with normals that face inwards.
    fn room(size: [f64; 3], floor: &str) -> String {
        let [x, y, z] = size;
        format!(
            "v 0 0 0\nv {x} 0 0\nv {x} {y} 0\nv 0 {y} 0\nv 0 0 {z}\nv {x} 0 {z}\nv {x} {y} {z}\nv 0 {y} {z}\n\
             o {floor}\nf 1 2 3 4\no b\nf 8 7 6 5\no c\nf 1 5 6 2\nf 3 7 8 4\nf 2 6 7 3\nf 1 4 8 5\n"
        )
    }

    #[test]
    fn a_name_finds_it_whatever_the_extent() {
        for size in [[4.0, 4.0, 4.0], [4.0, 4.0, 40.0], [4.0, 40.0, 4.0]] {
            let found = of(&room(size, "LivingRoomFloor_1"));
            assert_eq!(
                (found.axis, found.source),
                (Axis::Z, Source::Found),
                "{size:?}: {}",
                found.reason
            );
        }
    }

    #[test]
    fn a_box_without_names_tells_nothing() {
        for size in [[4.0, 4.0, 4.0], [9.0, 9.0, 3.0]] {
            assert_eq!(of(&room(size, "a")).known(), None);
        }
    }

    #[test]
    fn walls_in_many_directions_stand_along_it() {
        // A prism of eight sides, y up, without names; without its floor it may be a tunnel.
        let mut text = String::new();
        for k in 0..8 {
            let (sine, cosine) = (f64::from(k) * std::f64::consts::TAU / 8.0).sin_cos();
            text.push_str(&format!("v {cosine} 0 {sine}\nv {cosine} 3 {sine}\n"));
        }
        for k in 0..8 {
            let (a, b) = (2 * k + 1, 2 * ((k + 1) % 8) + 1);
            text.push_str(&format!("f {a} {} {} {b}\n", a + 1, b + 1));
        }
        assert_eq!(of(&text).known(), None);
        text.push_str("f 1 3 5 7 9 11 13 15\n");
        text.push_str("f 16 14 12 10 8 6 4 2\n");
        let found = of(&text);
        assert_eq!((found.axis, found.source), (Axis::Y, Source::Found), "{}", found.reason);
    }
}
