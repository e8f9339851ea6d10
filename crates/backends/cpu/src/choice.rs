//! The engine that suits a scene, and the parts of a scene that are prepared once for all sessions.
//!
//! Engine `order` is chosen where the partition cuts few surfaces and fills its blocks. A scene that falls into more
//! than 1.4 pieces a surface, or with almost empty blocks, gets `depth` or `claims`: real city models do, as their
//! terrain runs under the buildings. A survey renders eight hemicubes when a scene is loaded. Where patches see a third
//! of the scene and blocks are not well filled, `depth` draws everything, unless few parent triangles are ordered.

use crate::CpuBackend;
use crate::bsp::{BspTree, Limits, Surfaces};
use crate::parents::ParentTriangles;
use hemicube_contract::backend::{BackendError, Culling, Geometry, Hemicube, HemicubeBackend, RenderSettings, Surface};
use hemicube_contract::row::RowBlock;
use std::sync::{Arc, OnceLock};

/// The engine that renders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// The one that suits the scene: [`EngineChoice::Order`] where few surfaces must be cut to put them in order and
    /// blocks stay well filled, else [`EngineChoice::Claims`] where the visible triangles have many pixels, else
    /// [`EngineChoice::Depth`]. Where parent triangles are drawn, they are put in order.
    #[default]
    Auto,
    /// Engine `depth`, the hierarchical z-buffer: for any scene.
    Depth,
    /// Engine `order`, ordered coverage bits: for scenes of polygons.
    Order,
    /// Engine `claims`, coverage bits with owners: for any scene, with the rows of [`EngineChoice::Depth`].
    Claims,
}

impl EngineChoice {
    /// The engine with the rows of a matrix that names this version of the backend.
    pub fn of_version(version: &str) -> Self {
        if version.starts_with("order") {
            Self::Order
        } else {
            Self::Depth
        }
    }
}

/// The engine of a scene, with the partition that it walks beside the tree.
#[derive(Debug)]
pub(crate) enum Engine {
    Depth,
    Order(Arc<BspTree>),
    Claims,
}

/// With more pieces a surface than this, ordering costs more than it saves.
const MOST_FRAGMENTS: f64 = 1.4;
/// Even if engine `order` was asked for: beyond, memory is the limit.
const MOST_FRAGMENTS_IF_ASKED: f64 = 32.0;
/// Least number of lanes of a block in use for ordering to pay: of surfaces, and of parent triangles.
const LEAST_FILL: [f64; 2] = [4.0, 2.5];
/// Share of the scene seen by a patch above which everything is drawn, unless blocks in order are filled better than
/// `WELL_FILLED` (`docs/dev/study.md` has the scenes).
const OPEN: f64 = 1.0 / 3.0;
const WELL_FILLED: f64 = 12.0;
/// Scenes of fewer surfaces are not surveyed: they take no time either way.
const LEAST_TO_SURVEY: usize = 1000;
/// Number of patches that a survey renders from.
const SURVEYED_FROM: usize = 8;
/// Resolution of a survey, independent of the settings: the choice must not hang on them.
const SURVEY_RESOLUTION: u32 = 128;
/// With more pixels of a survey for each triangle drawn, parent triangles are put in order even where patches see much
/// of the scene: a room has 1,000, an open field of 2,500 triangles 22 (`docs/dev/engines.md`).
const PIXELS_OF_COARSE: f64 = 100.0;
/// From this resolution on, engine `order` takes longer to draw pixels twice, of parents and of their patches, than to
/// cull the patches themselves, unless most of these need not be drawn (`docs/dev/engines.md`).
const FINE: u32 = 1024;
/// With more pixels of a hemicube for each triangle drawn, engine `claims` is faster than engine `depth`
/// (`docs/dev/engines.md`).
const PIXELS_TO_CLAIM: f64 = 350.0;

/// The choices for a scene and settings.
#[derive(Debug)]
pub(crate) struct Plan {
    pub(crate) engine: Engine,
    pub(crate) parents: Option<Arc<ParentTriangles>>,
    pub(crate) culling: Culling,
    /// True if the weights of a parent's fully visible patches may be any equal ones.
    pub(crate) fractions: bool,
    /// Version of the arithmetic.
    pub(crate) version: &'static str,
    /// The engine and why it was chosen.
    pub(crate) reason: String,
}

impl Plan {
    /// Chooses for a scene and settings, with parent triangles if `draws_parents` allows.
    pub(crate) fn new(
        choice: EngineChoice,
        geometry: &Arc<Geometry>,
        settings: RenderSettings,
        draws_parents: bool,
        fractions: bool,
    ) -> Result<Self, BackendError> {
        let cache = geometry.kept(|_| Cache::default());
        let parents = || draws_parents.then(|| cache.parents(geometry).cloned()).flatten();
        let is_subdivided = parents().is_some();
        let fractions = fractions && is_subdivided;
        let orders_parents = is_subdivided && (fractions || settings.resolution < FINE);
        let (mut engine, mut reason) = engine_of(choice, &cache, geometry, orders_parents)?;
        let mut culling = settings.culling;
        let is_well_filled = matches!(&engine, Engine::Order(bsp) if bsp.fill() >= WELL_FILLED);
        if choice == EngineChoice::Auto && !is_well_filled {
            let survey = cache.survey(geometry);
            let pixels = survey.pixels(settings.resolution);
            // Few parents are soon put in order, however much of them is visible.
            let is_coarse = orders_parents
                && matches!(engine, Engine::Order(_))
                && survey.pixels(SURVEY_RESOLUTION) >= PIXELS_OF_COARSE;
            if survey.share > OPEN && !is_coarse {
                // The engine must not depend on whether culling was asked for, as an engine with other rows would.
                engine = Engine::Depth;
                culling = Culling::Off;
                reason = format!(
                    ", everything drawn: patches see {:.0} % of the scene",
                    100.0 * survey.share
                );
            } else if matches!(engine, Engine::Depth) && culling == Culling::On && pixels >= PIXELS_TO_CLAIM {
                engine = Engine::Claims;
                reason = format!("{reason}, and {pixels:.0} pixels a triangle");
            }
        }
        let parents = match engine {
            Engine::Order(_) if !orders_parents => None,
            _ => parents(),
        };
        // Engine `claims` has the rows of engine `depth`, to the bit.
        let by_depth = match (&parents, fractions) {
            (None, _) => "depth-2",
            (Some(_), false) => "depth-3",
            (Some(_), true) => "depth-4",
        };
        let (name, version) = match engine {
            Engine::Order(_) if fractions => ("order", "order-2"),
            Engine::Order(_) if orders_parents => ("order", "order-3"),
            Engine::Order(_) => ("order", "order-1"),
            Engine::Depth => ("depth", by_depth),
            Engine::Claims => ("claims", by_depth),
        };
        Ok(Self {
            engine,
            parents,
            culling,
            fractions,
            version,
            reason: format!("engine {name}{reason}"),
        })
    }
}

/// The engine that was asked for, or `order` or `depth` as the scene suits it, and why, to follow its name.
fn engine_of(
    choice: EngineChoice,
    cache: &Cache,
    geometry: &Geometry,
    of_parents: bool,
) -> Result<(Engine, String), BackendError> {
    let is_asked = match choice {
        EngineChoice::Depth => return Ok((Engine::Depth, ", as asked".to_owned())),
        EngineChoice::Claims => return Ok((Engine::Claims, ", as asked".to_owned())),
        EngineChoice::Order => true,
        EngineChoice::Auto => false,
    };
    match cache.bsp(geometry, OrderOf { of_parents, is_asked }) {
        Ok(bsp) => Ok((Engine::Order(Arc::clone(bsp)), format!(": {bsp}"))),
        Err(reason) if is_asked => Err(BackendError::Unsupported(format!(
            "engine order does not suit this scene: {reason}; take engine auto, claims or depth"
        ))),
        Err(reason) => Ok((Engine::Depth, format!(": {reason}"))),
    }
}

/// The parts of a scene that are prepared once, whatever the number of sessions and settings; each when first asked
/// for.
#[derive(Debug, Default)]
struct Cache {
    parents: OnceLock<Option<Arc<ParentTriangles>>>,
    /// By [`OrderOf::place`].
    bsp: [OnceLock<Result<Arc<BspTree>, String>>; 4],
    survey: OnceLock<Survey>,
}

/// A partition of a scene.
#[derive(Clone, Copy, Debug)]
struct OrderOf {
    /// True for parent triangles, false for surfaces.
    of_parents: bool,
    /// True if engine `order` was asked for, false if it must suit the scene.
    is_asked: bool,
}

impl OrderOf {
    fn place(self) -> usize {
        2 * usize::from(self.of_parents) + usize::from(self.is_asked)
    }
}

impl Cache {
    fn parents(&self, geometry: &Geometry) -> Option<&Arc<ParentTriangles>> {
        let found = self
            .parents
            .get_or_init(|| ParentTriangles::find(geometry).map(Arc::new));
        found.as_ref()
    }

    fn bsp(&self, geometry: &Geometry, which: OrderOf) -> &Result<Arc<BspTree>, String> {
        self.bsp[which.place()].get_or_init(|| {
            let OrderOf { of_parents, is_asked } = which;
            let limits = Limits {
                fragments: if is_asked {
                    MOST_FRAGMENTS_IF_ASKED
                } else {
                    MOST_FRAGMENTS
                },
            };
            let parents = of_parents
                .then(|| self.parents(geometry))
                .flatten()
                .map(|parents| parents.surfaces());
            let surfaces = Surfaces {
                of: parents.as_ref().unwrap_or(&geometry.surfaces),
                ..Surfaces::from(geometry)
            };
            match BspTree::new(surfaces, limits) {
                Ok(bsp) if is_asked || bsp.fill() >= LEAST_FILL[usize::from(of_parents)] => Ok(Arc::new(bsp)),
                Ok(bsp) => Err(format!("in order, blocks would be too empty ({bsp})")),
                Err(why) => Err(why.to_string()),
            }
        })
    }

    fn survey(&self, geometry: &Arc<Geometry>) -> &Survey {
        self.survey.get_or_init(|| Survey::new(geometry))
    }
}

/// The view of a few patches. Where it is much of the scene, ordering surfaces or culling takes longer than drawing
/// everything; where it is little, each visible triangle has many pixels.
#[derive(Debug)]
struct Survey {
    /// Visible patches of a patch, as a fraction of all.
    share: f64,
    /// Triangles drawn for a hemicube, counted once a face.
    drawn: f64,
}

impl Survey {
    fn new(geometry: &Arc<Geometry>) -> Self {
        let surfaces = &geometry.surfaces;
        if surfaces.len() < LEAST_TO_SURVEY {
            // More than all of them are hardly ever drawn.
            return Self {
                share: 0.0,
                drawn: surfaces.len() as f64,
            };
        }
        let mut backend = CpuBackend::new().with_engine(EngineChoice::Depth);
        let settings = RenderSettings {
            resolution: SURVEY_RESOLUTION,
            culling: Culling::On,
            covered: false,
        };
        let hemicubes: Vec<Hemicube> = (0..SURVEYED_FROM)
            .map(|place| &surfaces[(2 * place + 1) * surfaces.len() / (2 * SURVEYED_FROM)])
            .filter_map(hemicube_of)
            .collect();
        let mut rows = RowBlock::default();
        let rendered = backend
            .load(geometry, settings)
            .and_then(|()| backend.rows(&hemicubes, &mut rows));
        let count = hemicubes.len().max(1) as f64;
        match rendered {
            Ok(counters) => Self {
                share: rows.patches.len() as f64 / (count * f64::from(geometry.patch_count)),
                drawn: counters.triangles_drawn as f64 / count,
            },
            // A scene that cannot be rendered does not count as open; the session itself will report the error.
            Err(_) => Self {
                share: 0.0,
                drawn: f64::INFINITY,
            },
        }
    }

    /// Pixels of a hemicube for each triangle drawn.
    fn pixels(&self, resolution: u32) -> f64 {
        3.0 * f64::from(resolution) * f64::from(resolution) / self.drawn.max(1.0)
    }
}

/// A hemicube at the centroid of a surface's front; `None` without area.
fn hemicube_of(surface: &Surface) -> Option<Hemicube> {
    let [a, b, c] = surface.corners;
    let normal = (b - a).cross(c - a).try_normalize()?;
    let tangent = (b - a).try_normalize()?;
    Some(Hemicube {
        emitter: Some(surface.front),
        origin: (a + b + c) / 3.0,
        axes: [tangent, normal.cross(tangent), normal],
    })
}
