//! Scenes made by rule: the measured Cornell box, and scenes of a requested patch count for tests and benchmarks.
//!
//! A patch here is one triangle. Every scene is the same, bit for bit, on every machine: random numbers come from
//! SplitMix64, and coordinates from the five operations that IEEE 754 rounds exactly (+ − × ÷ √), never from a maths
//! library's sine or logarithm. No scene has a sliver, a repeated face or a two-sided triangle; y points up.
//!
//! - [`Kind::Room`]: the closed Cornell box, each of its 40 triangles split into k²; 40·k²
//! - [`Kind::City`]: streets and blocks of separate buildings ([`CityParameters`]); every even count from 10
//! - [`Kind::BlockCity`]: a regular grid of towers ([`BlockCityParameters`]); 14·n²·k², k = 1 below 50,000 and 4 above
//! - [`Kind::Maze`]: a perfect maze of rooms with doorways, closed ([`MazeParameters`]); 108·n + 4·(n − 1), n rooms
//! - [`Kind::Spheres`]: spheres apart from each other in a closed room ([`SpheresParameters`]); 20·k²·s + 12·m²
//! - [`Kind::Field`]: an open bowl of terrain with a few huts: little occlusion ([`FieldParameters`]); 2·n² + 8·⌊n/12⌋²
//! - [`Kind::Soup`]: triangles strewn in a closed room ([`SoupParameters`]); every count from 12
//!
//! [`generate`] takes the reachable count nearest to the target (the city: the first count not below it), within 25 %
//! from a target of 1,000 on. The length of [`Scene::triangles`] is the count reached; a warning in [`Scene::ledger`]
//! tells a difference from the target.

mod block_city;
mod builder;
mod city;
mod cornell;
mod field;
mod maze;
mod random;
mod soup;
mod spheres;

pub use block_city::BlockCityParameters;
pub use city::CityParameters;
pub use cornell::{cornell_box, cornell_box_open, room};
pub use field::FieldParameters;
pub use maze::MazeParameters;
pub use soup::SoupParameters;
pub use spheres::SpheresParameters;

use crate::{Error, Scene};
use std::fmt;
use std::str::FromStr;

/// The most patches of a generated scene, 2²⁶: about 6 GB of triangles. Cut a smaller one for more.
pub const MAX_PATCHES: u64 = 1 << 26;

/// A kind of generated scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// The closed measured Cornell box, split evenly. The seed changes nothing.
    Room,
    /// Streets and blocks of separate buildings with log-normal heights.
    City,
    /// A regular grid of towers of random height.
    BlockCity,
    /// A perfect maze of rooms with doorways, under a ceiling.
    Maze,
    /// Spheres apart from each other in a closed room.
    Spheres,
    /// An open bowl of terrain with a few huts: nearly everything sees nearly everything.
    Field,
    /// Triangles strewn in a closed room; they may cut one another.
    Soup,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 7] = [
        Self::Room,
        Self::City,
        Self::BlockCity,
        Self::Maze,
        Self::Spheres,
        Self::Field,
        Self::Soup,
    ];

    /// The kind's name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Room => "room",
            Self::City => "city",
            Self::BlockCity => "block-city",
            Self::Maze => "maze",
            Self::Spheres => "spheres",
            Self::Field => "field",
            Self::Soup => "soup",
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Kind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let known: Vec<String> = Self::ALL.iter().map(|kind| format!("`{kind}`")).collect();
            Error::unsupported(format!(
                "`{name}` is no kind of generated scene; there are {}",
                known.join(", ")
            ))
        })
    }
}

/// Parameters of a generated scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Generate {
    /// The kind of scene.
    pub kind: Kind,
    /// The number of patches wanted, from 1 to [`MAX_PATCHES`].
    pub target_patches: u64,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// Generates a scene of about a target number of patches; see the [module](self) for how near it comes.
///
/// # Errors
/// When the target is 0, is more than [`MAX_PATCHES`], or needs more memory than there is.
///
/// ```
/// use hemicube_scene::generate::{Generate, Kind, generate};
///
/// let city = |seed| generate(Generate { kind: Kind::City, target_patches: 1000, seed });
/// let scene = city(1)?;
/// assert_eq!(scene.triangles.len(), 1000);
/// assert_eq!(scene, city(1)?, "the same on every machine");
/// assert_ne!(scene, city(2)?);
///
/// // A room has 40·k² triangles: where the target is out of reach, the scene says what it has.
/// let room = generate(Generate { kind: Kind::Room, target_patches: 1000, seed: 1 })?;
/// assert_eq!((room.triangles.len(), room.ledger.warnings.len()), (1000, 0));
/// let room = generate(Generate { kind: "room".parse()?, target_patches: 1100, seed: 1 })?;
/// assert_eq!((room.triangles.len(), room.ledger.warnings.len()), (1000, 1));
/// # Ok::<(), hemicube_scene::Error>(())
/// ```
pub fn generate(spec: Generate) -> Result<Scene, Error> {
    let Generate {
        kind,
        target_patches: target,
        seed,
    } = spec;
    if target == 0 {
        return Err(Error::malformed("`patches` is 0; ask for at least 1"));
    }
    builder::check_count(target)?;
    let mut scene = match kind {
        Kind::Room => room(cornell::pieces_for(target)),
        Kind::City => CityParameters {
            target: Some(target),
            seed,
            ..CityParameters::default()
        }
        .generate(),
        Kind::BlockCity => BlockCityParameters::for_target(target, seed).generate(),
        Kind::Maze => MazeParameters::for_target(target, seed).generate(),
        Kind::Spheres => SpheresParameters::for_target(target, seed).generate(),
        Kind::Field => FieldParameters::for_target(target, seed).generate(),
        Kind::Soup => SoupParameters::for_target(target, seed).generate(),
    }?;
    let reached = scene.triangles.len();
    if reached as u64 != target {
        scene.ledger.warnings.push(format!(
            "a `{kind}` of {target} patches was asked for; it has {reached}"
        ));
    }
    Ok(scene)
}
