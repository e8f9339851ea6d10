//! Sunlight for `hemicube solve`: what the suns of a table and their skies send to each patch.

use super::Arguments;
use super::heat;
use crate::args::Talk;
use crate::exit::hinted;
use crate::forecast;
use crate::prepare::Prepared;
use crate::report::counted;
use crate::stored;
use crate::suns::{Planet, Suns};
use anyhow::{Context, Result, bail};
use glam::DVec3;
use hemicube::frame::Horizon;
use hemicube::portal::Portals;
use hemicube::sky::{Glazed, SUN_ERROR, SkyDivision, StoredSky, product_of_sky, sunlight, sunlit};
use hemicube::solve::Block;
use hemicube::store::{RowTable, Store};
use hemicube_scene::{Axis, Budget, InputPatch};
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

/// Moments whose skies are multiplied with the sky rows at a time.
const SKIES_AT_ONCE: usize = 64;

/// Rings of equal solid angle that a planet's disc is divided into, and parts of each. A choice: where a plane sees all
/// of the disc, any number is exact; where its horizon cuts the disc, an edge-on plane errs by 0.07 % of the whole
/// share, for half angles up to 64°.
const RINGS: usize = 12;
const AROUND: usize = 32;

/// What takes less memory.
const FEWER: &str = "solve for fewer suns at a time";

/// What memory is asked for.
fn what_of(patches: usize, suns: &Suns) -> String {
    format!(
        "sunlight of {} on {}",
        counted(suns.len() as u64, "moment"),
        counted(patches as u64, "patch")
    )
}

/// What each patch gets of the skies: a row a patch, a column a moment, in W/m².
///
/// An even sky needs each patch's share of it alone; another needs the sky rows of the matrix.
///
/// # Errors
/// When the sky is not even, and the matrix has no sky rows, or when they are of other patches.
pub(super) fn skylight(
    arguments: &Arguments,
    store: &Store,
    rows: &RowTable,
    suns: &Suns,
    talk: Talk,
) -> Result<Block> {
    // What arrives, and what is absorbed of it.
    let numbers = 16 * rows.escaped.len() as u64 * suns.len() as u64;
    forecast::require(Budget::default(), numbers, &what_of(rows.escaped.len(), suns), FEWER)?;
    let what = match (suns.uneven(), suns.names_ground()) {
        (Some(model), _) => format!("a sky such as `{model}` needs to know which part of it each patch sees"),
        (None, true) => format!(
            "the `ground` of `{}` needs to know what each patch sees below the horizon",
            suns.path.display()
        ),
        (None, false) => {
            let above = share_of_sky(arguments, store, rows, suns, talk)?;
            return Ok(Block::from_fn(above.len(), suns.len(), |patch, at| {
                suns.moments[at].diffuse * above[patch]
            }));
        }
    };
    let rows_of_sky = match &arguments.sky {
        Some(path) => Ok(path.clone()),
        None => stored::sky(store),
    };
    let path = rows_of_sky.map_err(|error| {
        hinted(
            error.context(what),
            format!(
                "`hemicube sky SCENE --matrix {} --division reinhart:2` computes it, with `--up` and `--north` where the \
                 scene does not say",
                crate::shell::word(store.directory())
            ),
        )
    })?;
    let (division, horizon) = stored::sky_frame(&path)?;
    let sky = StoredSky::open(&path)?;
    let patches = rows.escaped.len();
    if sky.rows() != patches {
        bail!(
            "`{}` is of {}, and the matrix of {patches}",
            path.display(),
            counted(sky.rows() as u64, "patch")
        );
    }
    // A patch of the sky sends π times its radiance, like a white wall, and so does the ground.
    let sent = |at: usize| -> Result<Vec<f64>> {
        let mut radiances = suns.radiances(at, &division, horizon)?;
        radiances
            .iter_mut()
            .for_each(|radiance| *radiance *= std::f64::consts::PI);
        Ok(radiances)
    };
    let is_bright = |at: &usize| {
        let moment = &suns.moments[*at];
        moment.diffuse > 0.0 || moment.ground_radiosity(horizon.up) > 0.0
    };
    let bright: Vec<usize> = (0..suns.len()).filter(is_bright).collect();
    let groups = Mutex::new(bright.chunks(SKIES_AT_ONCE).enumerate());
    let found = Mutex::new(Block::zeros(patches, suns.len()));
    let product_of = |moments: &[usize]| -> Result<Block> {
        let vectors: Vec<Vec<f64>> = moments.iter().map(|&at| sent(at)).collect::<Result<_>>()?;
        Ok(product_of_sky(&path, &sky, &vectors)?)
    };
    let work = || -> Result<(), (usize, anyhow::Error)> {
        loop {
            let Some((group, moments)) = groups.lock().unwrap_or_else(PoisonError::into_inner).next() else {
                return Ok(());
            };
            let product = product_of(moments).map_err(|error| (group, error))?;
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            for patch in 0..patches {
                for (&at, value) in moments.iter().zip(product.of(patch)) {
                    found.of_mut(patch)[at] = *value;
                }
            }
        }
    };
    let failed = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..arguments.options().threads()).map(|_| scope.spawn(work)).collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, Result<(), (usize, anyhow::Error)>>| {
            let ended = worker
                .join()
                .unwrap_or_else(|payload| std::panic::resume_unwind(payload));
            ended.err()
        };
        // Groups are begun in their order, so the first that fails is among them whatever the threads.
        workers.into_iter().filter_map(join).min_by_key(|(group, _)| *group)
    });
    if let Some((_, error)) = failed {
        return Err(error);
    }
    Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Adds the sunlight that planets reflect.
pub(super) fn add_albedo(suns: &Suns, planets: &Block, arriving: &mut Block) {
    for patch in 0..planets.patches() {
        let of_patch = arriving.of_mut(patch).iter_mut().zip(planets.of(patch));
        for ((arriving, factor), moment) in of_patch.zip(&suns.moments) {
            *arriving += factor * moment.planet.map_or(0.0, |planet| planet.albedo);
        }
    }
}

/// The share of each patch's view that is sky: what leaves the scene, without what the sky rows know to be below the
/// horizon.
fn share_of_sky(arguments: &Arguments, store: &Store, rows: &RowTable, suns: &Suns, talk: Talk) -> Result<Vec<f64>> {
    let escaped = || {
        rows.escaped
            .iter()
            .map(|&share| if share.is_nan() { 0.0 } else { share })
    };
    if !suns.has_sky() {
        return Ok(escaped().collect());
    }
    if arguments.sky.is_none() && stored::sky(store).is_err() {
        talk.warn(&format!(
            "diffuse light comes from all that leaves the scene, also from below the horizon; `hemicube sky {} --matrix \
             {}` tells the sky from the ground",
            crate::shell::word(store.manifest().scene.file.as_ref()),
            crate::shell::word(store.directory())
        ));
        return Ok(escaped().collect());
    }
    let below = heat::below_horizon(arguments, store, &rows.escaped)?;
    Ok(escaped()
        .zip(&below)
        .map(|(escaped, below)| (escaped - below).max(0.0))
        .collect())
}

/// Directions to the middles of parts of a planet's disc, of equal solid angle. A plane that sees all of them has sin² α
/// cos θ of them, to rounding: a ring's middle cosine is its mean.
fn parts_of(disc: &Planet) -> Vec<DVec3> {
    let axis = disc.direction;
    let across = axis.any_orthonormal_vector();
    let other = axis.cross(across);
    let mut parts = Vec::with_capacity(RINGS * AROUND);
    for ring in 0..RINGS {
        let cosine = 1.0 - (1.0 - disc.half_angle.cos()) * (ring as f64 + 0.5) / RINGS as f64;
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        for part in 0..AROUND {
            // Each ring is turned by the golden angle: parts of no two lie in line.
            let turn = std::f64::consts::TAU * (part as f64 / AROUND as f64 + 0.381_966 * ring as f64);
            let (side, ahead) = turn.sin_cos();
            parts.push(axis * cosine + (across * ahead + other * side) * sine);
        }
    }
    parts
}

/// A matrix's scene as suns see it.
pub(super) struct Lit<'a> {
    prepared: &'a Prepared,
    portals: Portals,
    error: f64,
    threads: usize,
}

impl<'a> Lit<'a> {
    /// The scene of a matrix, to the error of its tolerance.
    pub(super) fn new(arguments: &Arguments, store: &Store, prepared: &'a mut Prepared, talk: Talk) -> Result<Self> {
        let portals = stored::portals(store, prepared, crate::args::EngineSettings::default().hierarchy())?;
        crate::portals::tell_of_reflections(&portals, prepared, talk);
        let tolerance = store.manifest().settings["tolerance"].as_f64();
        Ok(Self {
            prepared,
            portals,
            error: tolerance.unwrap_or(SUN_ERROR).min(SUN_ERROR),
            threads: arguments.options().threads(),
        })
    }

    /// Adds what the suns send to each patch to `arriving`, W/m²: a row a patch, a column a moment.
    ///
    /// # Errors
    /// When there is not the memory for it, or the scene is too large.
    pub(super) fn add(&self, suns: &Suns, arriving: &mut Block) -> Result<()> {
        let shining: Vec<usize> = (0..suns.len()).filter(|&at| suns.moments[at].direct > 0.0).collect();
        let elements = self.prepared.patches.len();
        let numbers = 4 * elements as u64 * shining.len() as u64;
        forecast::require(Budget::default(), numbers, &what_of(elements, suns), FEWER)?;
        let directions: Vec<DVec3> = shining.iter().map(|&at| suns.moments[at].direction).collect();
        let shares = self.of(&directions)?;
        for (sun, &at) in shining.iter().enumerate() {
            let of_sun: Vec<f64> = (0..elements)
                .map(|element| f64::from(shares[element * shining.len() + sun]))
                .collect();
            let of_rows = match &self.prepared.grouping {
                Some(grouping) => grouping.means(&of_sun, &self.areas()),
                None => of_sun,
            };
            for (patch, share) in of_rows.into_iter().enumerate() {
                arriving.of_mut(patch)[at] += suns.moments[at].direct * share;
            }
        }
        Ok(())
    }

    /// The irradiance of each patch from the planet of each moment, of a radiosity of 1: a row a patch, a column a
    /// moment. `None` without planets. Each disc takes as long as [`RINGS`] · [`AROUND`] suns.
    ///
    /// # Errors
    /// When there is not the memory for it, or the scene is too large.
    pub(super) fn planets(&self, suns: &Suns, patches: usize) -> Result<Option<Block>> {
        // A satellite that looks down always has one planet at one place.
        let mut discs: Vec<Planet> = Vec::new();
        let mut disc_of = Vec::with_capacity(suns.len());
        let mut known: HashMap<[u64; 4], usize> = HashMap::new();
        for moment in &suns.moments {
            disc_of.push(moment.planet.map(|planet| {
                *known.entry(planet.place()).or_insert_with(|| {
                    discs.push(planet);
                    discs.len() - 1
                })
            }));
        }
        if discs.is_empty() {
            return Ok(None);
        }
        let elements = self.prepared.patches.len();
        let numbers = 4 * (elements * RINGS * AROUND) as u64 + 16 * (patches * suns.len()) as u64;
        forecast::require(Budget::default(), numbers, &what_of(elements, suns), FEWER)?;
        let mut factors = Vec::with_capacity(discs.len());
        for disc in &discs {
            let directions = parts_of(disc);
            // Each part is ΔΩ / π of a plane's view at its middle.
            let weight = 2.0 * (1.0 - disc.half_angle.cos()) / directions.len() as f64;
            let shares = self.of(&directions)?;
            let of_element = |shares: &[f32]| weight * shares.iter().map(|&share| f64::from(share)).sum::<f64>();
            let of_elements: Vec<f64> = shares.chunks_exact(directions.len()).map(of_element).collect();
            factors.push(match &self.prepared.grouping {
                Some(grouping) => grouping.means(&of_elements, &self.areas()),
                None => of_elements,
            });
        }
        let of = |patch: usize, at: usize| disc_of[at].map_or(0.0, |disc| factors[disc][patch]);
        Ok(Some(Block::from_fn(patches, suns.len(), of)))
    }

    fn areas(&self) -> Vec<f64> {
        let patches = &self.prepared.patches;
        patches.iter().map(|patch| patches.area(patch)).collect()
    }

    /// The irradiance of each element from each sun of 1 across its beam: a row an element.
    fn of(&self, suns: &[DVec3]) -> Result<Vec<f32>> {
        // No sun is hidden by a horizon here: at night its irradiance is 0.
        let horizon = Horizon::new(Axis::Z, 0.0).without_ground();
        let patches: Vec<InputPatch> = self.prepared.patches.iter().collect();
        let model = &self.prepared.model;
        if let Some(specular) = &self.portals.specular {
            let division = SkyDivision::new(1).context("a sky of one division")?;
            let glazed = Glazed {
                division: &division,
                specular,
                images: self.portals.images.as_ref(),
                horizon,
            };
            return Ok(sunlight(model, &patches, suns, glazed, self.error, self.threads));
        }
        let mut shares = sunlit(model, &patches, suns, horizon, self.error, self.threads)?;
        for (at, &patch) in patches.iter().enumerate() {
            let normal = self.prepared.patches.normal(patch);
            for (sun, direction) in suns.iter().enumerate() {
                #[allow(clippy::cast_possible_truncation, reason = "a cosine")]
                let cosine = normal.dot(*direction).max(0.0) as f32;
                shares[at * suns.len() + sun] *= cosine;
            }
        }
        Ok(shares)
    }
}
