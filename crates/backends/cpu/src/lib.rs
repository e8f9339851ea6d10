//! The built-in backend: hemicubes on the CPU, with SIMD chosen at run time.
//!
//! Engine `depth` is Greene's hierarchical z-buffer (Greene, Kass & Miller 1993): a tree over blocks of 16 triangles,
//! walked front to back, whose nodes are dropped where they lie outside all faces or behind what is already drawn. All
//! five faces are drawn in one walk. Engine `order` draws strictly front to back, in the order of a binary space
//! partition, and has one coverage bit a pixel. Engine `claims` walks the tree of engine `depth`, has the coverage bits
//! of engine `order`, and works out depths only of pixels that two surfaces contend for. [`EngineChoice`] says which
//! scenes get which. All of them draw triangles that were cut into patches as they were before, and share out what is
//! seen of them (engine `order` not at N = 1024, unless visible fractions are all that is asked): patches that follow
//! each other as `hemicube_scene::Subdivision` cuts them. Rows are the same bits on every instruction set and with
//! culling on or off; those of engines `depth` and `claims` are the same bits, and pixel sums of engine `order` the
//! same wherever f32 depths can tell surfaces apart.
//!
//! ```
//! use hemicube::{HierarchyOptions, Model, backend::*, row::RowBlock};
//! use hemicube_backend_cpu::CpuBackend;
//! use hemicube_scene::{Patches, Subdivision, generate};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let patches = Patches::new(&generate::cornell_box(), Subdivision::Levels(2))?;
//! let model = Model::new(patches.into(), HierarchyOptions::default())?;
//! let mut backend = CpuBackend::new();
//! backend.load(model.geometry(), RenderSettings { resolution: 64, culling: Culling::On, covered: false })?;
//! let hemicubes: Vec<_> = model.order().take(4).flat_map(|p| model.hemicubes(p, 1, true)).collect();
//! let mut rows = RowBlock::default();
//! backend.rows(&hemicubes, &mut rows)?;
//! rows.check(4, model.geometry().patch_count, false)?;
//! # Ok(())
//! # }
//! ```

mod alone;
mod buffer;
mod engine;
mod kernel;
mod order;
mod ordered;
mod share;
mod whole;

use engine::Engine;
use hemicube_contract::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Culling, Geometry, Hemicube, HemicubeBackend, RenderSettings,
    Surface,
};
pub use hemicube_contract::bvh::Hierarchy;
use hemicube_contract::bvh::{Block, LANES, Tree};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;
use kernel::{Claims, Target};
use order::{Limits, Order, Surfaces};
use ordered::OrderedEngine;
use std::sync::Arc;
use whole::Wholes;

/// An instruction set that the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512 F, BW, DQ, VL.
    Avx512,
    /// AVX2.
    Avx2,
    /// Whatever the target guarantees.
    Portable,
}

impl Isa {
    /// All of them that this machine has, best first.
    pub fn available() -> Vec<Self> {
        let mut found = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                found.push(Self::Avx512);
            }
            if avx2 {
                found.push(Self::Avx2);
            }
        }
        found.push(Self::Portable);
        found
    }

    fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "AVX-512",
            Self::Avx2 => "AVX2",
            Self::Portable => "portable",
        }
    }
}

/// Which of the three engines renders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// The one that suits the scene: [`EngineChoice::Order`] where few surfaces must be cut to put them in order and
    /// blocks stay well filled, else [`EngineChoice::Claims`] where what is seen has many pixels, else
    /// [`EngineChoice::Depth`]. What patches were cut from is put in order where it is drawn.
    #[default]
    Auto,
    /// Engine `depth`, the hierarchical z-buffer: for any scene.
    Depth,
    /// Engine `order`, ordered coverage bits: for scenes of polygons.
    Order,
    /// Engine `claims`, claimed coverage bits: for any scene, with the rows of [`EngineChoice::Depth`].
    Claims,
}

/// A session of the built-in backend.
///
/// Rows are the same bits on every instruction set:
///
/// ```
/// use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
/// use hemicube::row::RowBlock;
/// use hemicube_backend_cpu::{CpuBackend, EngineChoice, Isa};
/// # use hemicube::{HierarchyOptions, Model};
/// # use hemicube_scene::{Patches, Subdivision, generate};
/// # let patches = Patches::new(&generate::cornell_box(), Subdivision::Levels(1))?;
/// # let model = Model::new(patches.into(), HierarchyOptions::default())?;
/// # let hemicubes: Vec<_> = model.order().take(8).flat_map(|p| model.hemicubes(p, 1, true)).collect();
///
/// let settings = RenderSettings { resolution: 64, culling: Culling::On, covered: true };
/// let mut found = Vec::new();
/// for isa in Isa::available() {
///     let mut backend = CpuBackend::with_isa(isa).ok_or("this machine has it")?.with_engine(EngineChoice::Depth);
///     assert_eq!(backend.engine(), None, "an engine is chosen for a scene");
///     backend.load(model.geometry(), settings)?;
///     let mut rows = RowBlock::default();
///     backend.rows(&hemicubes, &mut rows)?;
///     found.push(rows);
/// }
/// assert!(found[0].len() == 8 && found.iter().all(|rows| *rows == found[0]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct CpuBackend {
    info: BackendInfo,
    isa: Isa,
    hierarchy: Hierarchy,
    choice: EngineChoice,
    /// True if triangles that were cut are drawn as they were before.
    whole: bool,
    /// Why the engine of the loaded scene is the one it is.
    reason: String,
    loaded: Option<Loaded>,
}

#[derive(Debug)]
struct Loaded {
    geometry: Arc<Geometry>,
    shared: Arc<Shared>,
    engine: AnyEngine,
    /// Draws patch by patch what is seen from off the triangle that an emitter was cut from, as its other patches are
    /// seen there; once that was asked for.
    parted: Option<Box<CpuBackend>>,
}

/// The engine that renders, with what it walks beside the tree.
#[derive(Debug)]
enum Way {
    Depth,
    Order(Arc<Order>),
    Claims,
}

/// What all sessions over one scene share.
#[derive(Debug)]
pub(crate) struct Shared {
    /// What is walked and drawn: surfaces, or with `wholes` what they were cut from.
    pub(crate) tree: Arc<Tree>,
    /// With [`Way::Order`] only below [`FINE`] or where fractions are asked.
    pub(crate) wholes: Option<Arc<Wholes>>,
    way: Way,
    pub(crate) table: DeltaTable,
    pub(crate) settings: RenderSettings,
    /// Whether of a patch that was cut from something, and shows all that it covers, nothing else is asked. Only with
    /// `wholes`, and with covered weights.
    pub(crate) fractions: bool,
}

impl Shared {
    /// Puts a patch, seen from either side, into a lane of a block.
    pub(crate) fn put(&self, patch: u32, lane: usize, out: &mut Block) {
        if let Some(wholes) = &self.wholes {
            wholes.put(patch, lane, out);
        } else {
            self.put_drawn(patch, lane, out);
        }
    }

    /// Puts what is drawn with an id, seen from either side, into a lane of a block.
    pub(crate) fn put_drawn(&self, patch: u32, lane: usize, out: &mut Block) {
        let slot = self.tree.slot_of_patch[patch as usize] as usize;
        let (block, from) = (&self.tree.blocks[slot / LANES], slot % LANES);
        for (to, corners) in out.corners.iter_mut().zip(&block.corners) {
            to[lane] = corners[from];
        }
        (out.negative[lane], out.positive[lane]) = (block.negative[from], block.positive[from]);
    }
}

/// The engines of one instruction set, made when first asked to work.
#[derive(Debug)]
struct Engines<K> {
    depth: Option<Engine<K, Target>>,
    ordered: Option<OrderedEngine<K>>,
    claims: Option<Engine<K, Claims>>,
}

impl<K: kernel::Kernel> Engines<K> {
    fn new() -> Self {
        Self {
            depth: None,
            ordered: None,
            claims: None,
        }
    }

    fn depth(&mut self, shared: &Shared) -> &mut Engine<K, Target> {
        self.depth.get_or_insert_with(|| Engine::new(shared))
    }

    fn rows(&mut self, shared: &Shared, hemicubes: &[Hemicube], out: &mut RowBlock) -> Counters {
        match &shared.way {
            Way::Depth => self.depth(shared).rows(shared, hemicubes, out),
            Way::Order(order) => self
                .ordered
                .get_or_insert_with(|| OrderedEngine::new(shared))
                .rows(shared, order, hemicubes, out),
            Way::Claims => self
                .claims
                .get_or_insert_with(|| Engine::new(shared))
                .rows(shared, hemicubes, out),
        }
    }
}

#[derive(Debug)]
enum AnyEngine {
    #[cfg(target_arch = "x86_64")]
    Avx512(Engines<kernel::x86::Avx512>),
    #[cfg(target_arch = "x86_64")]
    Avx2(Engines<kernel::x86::Avx2>),
    Portable(Engines<kernel::Portable>),
}

impl Default for CpuBackend {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuBackend {
    /// A session with the best instruction set that this machine has.
    pub fn new() -> Self {
        Self::of(Isa::available()[0])
    }

    /// A session with a given instruction set, or `None` where the machine lacks it. For tests and measurements.
    pub fn with_isa(isa: Isa) -> Option<Self> {
        Isa::available().contains(&isa).then(|| Self::of(isa))
    }

    /// The same session, walking another hierarchy from its next `load` on. For measurements.
    #[must_use]
    pub fn with_hierarchy(mut self, hierarchy: Hierarchy) -> Self {
        self.hierarchy = hierarchy;
        self
    }

    /// The same session, with a given engine from its next `load` on.
    #[must_use]
    pub fn with_engine(mut self, choice: EngineChoice) -> Self {
        self.choice = choice;
        self
    }

    /// The same session; from its next `load` on, every patch is drawn by itself, where otherwise what was cut into
    /// patches is drawn whole and shared out. For measurements and tests.
    #[must_use]
    pub fn patch_by_patch(mut self) -> Self {
        self.whole = false;
        self
    }

    /// The engine that renders what is loaded: never [`EngineChoice::Auto`]. `None` before `load`.
    pub fn engine(&self) -> Option<EngineChoice> {
        self.loaded.as_ref().map(|loaded| match loaded.shared.way {
            Way::Depth => EngineChoice::Depth,
            Way::Order(_) => EngineChoice::Order,
            Way::Claims => EngineChoice::Claims,
        })
    }

    /// The engine that was asked for, or order or depth as the scene suits it, and why, to follow its name.
    ///
    /// With `whole`, what the scene was cut from is drawn in either.
    fn way(&self, geometry: &Geometry, whole: bool) -> Result<(Way, String), BackendError> {
        let found = match (self.choice, whole) {
            (EngineChoice::Depth, _) => return Ok((Way::Depth, ", as asked".to_owned())),
            (EngineChoice::Claims, _) => return Ok((Way::Claims, ", as asked".to_owned())),
            (EngineChoice::Order, false) => geometry.kept(InOrder::<true, false>::new).0.clone(),
            (EngineChoice::Order, true) => geometry.kept(InOrder::<true, true>::new).0.clone(),
            (EngineChoice::Auto, false) => geometry.kept(InOrder::<false, false>::new).0.clone(),
            (EngineChoice::Auto, true) => geometry.kept(InOrder::<false, true>::new).0.clone(),
        };
        match found {
            Ok(order) => {
                let reason = format!(": {order}");
                Ok((Way::Order(order), reason))
            }
            Err(reason) if self.choice == EngineChoice::Order => Err(BackendError::Unsupported(format!(
                "engine order does not suit this scene: {reason}; take engine auto, claims or depth"
            ))),
            Err(reason) => Ok((Way::Depth, format!(": {reason}"))),
        }
    }

    fn of(isa: Isa) -> Self {
        Self {
            info: BackendInfo {
                name: "cpu".to_owned(),
                // The version of the arithmetic. It changes when any row could change by a bit. `load` says which
                // engine's.
                version: "1".to_owned(),
                device: format!("this machine's processor, {}", isa.name()),
                capabilities: Capabilities {
                    covered: true,
                    tiny_patches: true,
                    items: true,
                    lossless_culling: true,
                },
                preferred_rows: 16,
            },
            isa,
            hierarchy: Hierarchy::default(),
            choice: EngineChoice::default(),
            whole: true,
            reason: String::new(),
            loaded: None,
        }
    }

    fn load_for(
        &mut self,
        geometry: &Arc<Geometry>,
        settings: RenderSettings,
        fractions: bool,
    ) -> Result<(), BackendError> {
        settings.check()?;
        let cut_from = || {
            let can_be = self.whole && self.hierarchy == Hierarchy::SurfaceArea;
            can_be.then(|| geometry.kept(CutFrom::new).0.clone()).flatten()
        };
        let is_cut = cut_from().is_some();
        let fractions = fractions && is_cut;
        let whole_in_order = is_cut && (fractions || settings.resolution < FINE);
        let (mut way, mut reason) = self.way(geometry, whole_in_order)?;
        let mut rendered = settings;
        let is_well_filled = matches!(&way, Way::Order(order) if order.fill() >= WELL_FILLED);
        if self.choice == EngineChoice::Auto && !is_well_filled {
            let look = geometry.kept(|_| Look::new(geometry, self.isa));
            let pixels = look.pixels(settings.resolution);
            // Few triangles that many patches were cut from are soon put in order, however much is seen of them.
            let is_coarse = whole_in_order
                && matches!(way, Way::Order(_))
                && look.pixels(RESOLUTION_LOOKED_WITH) >= PIXELS_OF_COARSE;
            if look.share > OPEN && !is_coarse {
                // The engine must not depend on whether culling was asked for, as one with other rows would.
                way = Way::Depth;
                rendered.culling = Culling::Off;
                reason = format!(
                    ", everything drawn: patches see {:.0} % of the scene",
                    100.0 * look.share
                );
            } else if matches!(way, Way::Depth) && settings.culling == Culling::On && pixels >= PIXELS_TO_CLAIM {
                way = Way::Claims;
                reason = format!("{reason}, and {pixels:.0} pixels a triangle");
            }
        }
        let wholes = match way {
            Way::Order(_) if !whole_in_order => None,
            _ => cut_from(),
        };
        // Claims are settled by the depths of engine `depth`, to the bit.
        let by_depth = match (&wholes, fractions) {
            (None, _) => "depth-2",
            (Some(_), false) => "depth-3",
            (Some(_), true) => "depth-4",
        };
        let (engine, version) = match way {
            Way::Order(_) if fractions => ("order", "order-2"),
            Way::Order(_) if whole_in_order => ("order", "order-3"),
            Way::Order(_) => ("order", "order-1"),
            Way::Depth => ("depth", by_depth),
            Way::Claims => ("claims", by_depth),
        };
        self.info.version = version.to_owned();
        self.reason = format!("engine {engine}{reason}");
        let shared = Arc::new(Shared {
            way,
            tree: match (&wholes, self.hierarchy) {
                (Some(wholes), _) => Arc::clone(&wholes.tree),
                (None, Hierarchy::SurfaceArea) => Tree::of(geometry),
                (None, other) => Arc::new(Tree::new(geometry, other)),
            },
            wholes,
            table: DeltaTable::new(settings.resolution),
            settings: rendered,
            fractions,
        });
        self.loaded = Some(Loaded::new(Arc::clone(geometry), shared, self.isa));
        Ok(())
    }

    fn loaded(&mut self) -> Result<&mut Loaded, BackendError> {
        self.loaded
            .as_mut()
            .ok_or_else(|| BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned()))
    }
}

/// With more fragments a surface than this, ordering costs more than it saves.
const MOST_FRAGMENTS: f64 = 1.4;
/// Whatever was asked for: with more, memory would be the limit.
const MOST_FRAGMENTS_IF_ASKED: f64 = 32.0;
/// With fewer lanes of a block in use than this, likewise; of what patches were cut from, with fewer than the second.
const LEAST_FILL: [f64; 2] = [4.0, 2.5];

/// What the surfaces of a scene were cut from, if they were.
struct CutFrom(Option<Arc<Wholes>>);

impl CutFrom {
    fn new(geometry: &Geometry) -> Self {
        Self(Wholes::new(geometry).map(Arc::new))
    }
}

/// The order of a scene, or with `WHOLE` of what it was cut from; unless it was `ASKED` for, where that suits it.
struct InOrder<const ASKED: bool, const WHOLE: bool>(Result<Arc<Order>, String>);

impl<const ASKED: bool, const WHOLE: bool> InOrder<ASKED, WHOLE> {
    fn new(geometry: &Geometry) -> Self {
        let limits = Limits {
            fragments: if ASKED { MOST_FRAGMENTS_IF_ASKED } else { MOST_FRAGMENTS },
        };
        let wholes = if WHOLE {
            geometry.kept(CutFrom::new).0.as_ref().map(|wholes| wholes.surfaces())
        } else {
            None
        };
        let surfaces = Surfaces {
            of: wholes.as_ref().unwrap_or(&geometry.surfaces),
            ..Surfaces::from(geometry)
        };
        Self(match Order::new(surfaces, limits) {
            Ok(order) if ASKED || order.fill() >= LEAST_FILL[usize::from(WHOLE)] => Ok(Arc::new(order)),
            Ok(order) => Err(format!("in order, blocks would be too empty ({order})")),
            Err(why) => Err(why.to_string()),
        })
    }
}

/// What a few patches see of the scene: where that is much of it, putting surfaces in order or looking for what is
/// hidden takes longer than drawing everything; and where it is little, each of what they see has many pixels.
#[derive(Debug)]
struct Look {
    /// Patches that a patch sees, of all.
    share: f64,
    /// Triangles drawn for a hemicube, once a face.
    drawn: f64,
}

/// Where patches see a larger share of the scene, everything is drawn, unless blocks in order are filled better than
/// this (`docs/study.md` has the scenes). Smaller scenes take no time either way.
const OPEN: f64 = 1.0 / 3.0;
const WELL_FILLED: f64 = 12.0;
const LEAST_TO_LOOK_AT: usize = 1000;
/// Patches that are looked from.
const LOOKED_FROM: usize = 8;
/// Whatever the settings': the choice must not hang on them.
const RESOLUTION_LOOKED_WITH: u32 = 128;
/// With more pixels of it for each triangle drawn, triangles that were cut are put in order even where patches see much
/// of the scene: a room has 1,000, an open field of 2,500 triangles 22 (`docs/performance.md`).
const PIXELS_OF_COARSE: f64 = 100.0;
/// From this resolution on, engine `order` takes longer to draw pixels twice, of triangles that were cut and of their
/// patches, than to look for what is hidden of the patches themselves, unless most of these need not be drawn
/// (`docs/performance.md`).
const FINE: u32 = 1024;
/// With more pixels of a hemicube for each triangle drawn, engine `claims` is faster than engine `depth`
/// (`docs/performance.md`).
const PIXELS_TO_CLAIM: f64 = 350.0;

impl Look {
    fn new(geometry: &Arc<Geometry>, isa: Isa) -> Self {
        let surfaces = &geometry.surfaces;
        if surfaces.len() < LEAST_TO_LOOK_AT {
            // More than all of them are hardly ever drawn.
            return Self {
                share: 0.0,
                drawn: surfaces.len() as f64,
            };
        }
        let mut backend = CpuBackend::of(isa).with_engine(EngineChoice::Depth);
        let settings = RenderSettings {
            resolution: RESOLUTION_LOOKED_WITH,
            culling: Culling::On,
            covered: false,
        };
        let hemicubes: Vec<Hemicube> = (0..LOOKED_FROM)
            .map(|place| &surfaces[(2 * place + 1) * surfaces.len() / (2 * LOOKED_FROM)])
            .filter_map(hemicube_of)
            .collect();
        let mut rows = RowBlock::default();
        let rendered = backend
            .load(geometry, settings)
            .and_then(|()| backend.rows(&hemicubes, &mut rows));
        // What cannot be looked at is not taken for open; the session itself will say what is wrong.
        let looked = hemicubes.len().max(1) as f64;
        match rendered {
            Ok(counters) => Self {
                share: rows.patches.len() as f64 / (looked * f64::from(geometry.patch_count)),
                drawn: counters.triangles_drawn as f64 / looked,
            },
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

/// A hemicube at the middle of a surface's front; nothing for one without area.
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

impl Loaded {
    fn new(geometry: Arc<Geometry>, shared: Arc<Shared>, isa: Isa) -> Self {
        let engine = match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => AnyEngine::Avx512(Engines::new()),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => AnyEngine::Avx2(Engines::new()),
            _ => AnyEngine::Portable(Engines::new()),
        };
        Self {
            geometry,
            shared,
            engine,
            parted: None,
        }
    }

    /// Returns whether what was cut may be drawn whole for a hemicube.
    fn is_whole(&self, hemicube: &Hemicube) -> bool {
        let wholes = self.shared.wholes.as_ref();
        wholes.is_none_or(|wholes| wholes.is_stood_on(hemicube, self.shared.tree.plane_tolerance))
    }

    /// A session for the others.
    fn parted(&mut self, isa: Isa) -> Result<&mut CpuBackend, BackendError> {
        if self.parted.is_none() {
            let mut parted = CpuBackend::of(isa).with_engine(EngineChoice::Depth).patch_by_patch();
            parted.load(&self.geometry, self.shared.settings)?;
            self.parted = Some(Box::new(parted));
        }
        Ok(self.parted.as_mut().expect("made above"))
    }

    fn check(&self, hemicube: &Hemicube) -> Result<(), BackendError> {
        hemicube.check(self.shared.tree.patch_count)
    }
}

impl HemicubeBackend for CpuBackend {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn choices(&self) -> Vec<String> {
        match self.loaded {
            Some(_) => vec![self.reason.clone()],
            None => Vec::new(),
        }
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.load_for(geometry, settings, false)
    }

    fn load_for_fractions(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.load_for(geometry, settings, settings.covered)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        let loaded = self
            .loaded
            .as_ref()
            .ok_or_else(|| BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned()))?;
        Ok(Box::new(Self {
            info: self.info.clone(),
            isa: self.isa,
            hierarchy: self.hierarchy,
            choice: self.choice,
            whole: self.whole,
            reason: self.reason.clone(),
            loaded: Some(Loaded::new(
                Arc::clone(&loaded.geometry),
                Arc::clone(&loaded.shared),
                self.isa,
            )),
        }))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let isa = self.isa;
        let loaded = self.loaded()?;
        hemicubes.iter().try_for_each(|h| loaded.check(h))?;
        let mut counters = Counters::default();
        let mut left = hemicubes;
        while let Some(first) = left.first() {
            let is_whole = loaded.is_whole(first);
            let other = left.iter().position(|hemicube| loaded.is_whole(hemicube) != is_whole);
            let (these, others) = left.split_at(other.unwrap_or(left.len()));
            left = others;
            if !is_whole {
                counters += loaded.parted(isa)?.rows(these, out)?;
                continue;
            }
            counters += match &mut loaded.engine {
                #[cfg(target_arch = "x86_64")]
                AnyEngine::Avx512(engine) => engine.rows(&loaded.shared, these, out),
                #[cfg(target_arch = "x86_64")]
                AnyEngine::Avx2(engine) => engine.rows(&loaded.shared, these, out),
                AnyEngine::Portable(engine) => engine.rows(&loaded.shared, these, out),
            };
        }
        Ok(counters)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let isa = self.isa;
        let loaded = self.loaded()?;
        loaded.check(hemicube)?;
        if !loaded.is_whole(hemicube) {
            return loaded.parted(isa)?.items(hemicube);
        }
        Ok(match &mut loaded.engine {
            #[cfg(target_arch = "x86_64")]
            AnyEngine::Avx512(engine) => engine.depth(&loaded.shared).items(&loaded.shared, hemicube),
            #[cfg(target_arch = "x86_64")]
            AnyEngine::Avx2(engine) => engine.depth(&loaded.shared).items(&loaded.shared, hemicube),
            AnyEngine::Portable(engine) => engine.depth(&loaded.shared).items(&loaded.shared, hemicube),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_always_has_the_portable_path() {
        assert!(Isa::available().contains(&Isa::Portable));
        assert!(CpuBackend::with_isa(Isa::Portable).is_some());
    }

    #[test]
    fn open_scenes_are_drawn_whole_and_others_are_not() {
        use hemicube::{HierarchyOptions, Model};
        use hemicube_scene::generate::{Generate, Kind, generate};
        use hemicube_scene::{Patches, Subdivision};
        for (kind, is_open) in [
            (Kind::Field, true),
            (Kind::Room, false),
            (Kind::City, false),
            (Kind::Maze, false),
            (Kind::Spheres, false),
        ] {
            let spec = Generate {
                kind,
                target_patches: 2000,
                seed: 1,
            };
            let patches = Patches::new(&generate(spec).expect("a scene"), Subdivision::None).expect("patches");
            let model = Model::new(patches.into(), HierarchyOptions::default()).expect("a model");
            let mut hemicubes = model.order().step_by(97).flat_map(|p| model.hemicubes(p, 1, true));
            let hemicubes: Vec<Hemicube> = hemicubes.by_ref().collect();
            let rows = |choice, culling| {
                let mut backend = CpuBackend::new().with_engine(choice);
                let settings = RenderSettings {
                    resolution: 64,
                    culling,
                    covered: true,
                };
                backend.load(model.geometry(), settings).expect("loads");
                let mut rows = RowBlock::default();
                let counters = backend.rows(&hemicubes, &mut rows).expect("renders");
                (rows, counters.nodes_tested, backend.choices().concat())
            };
            let (found, tested, says) = rows(EngineChoice::Auto, Culling::On);
            assert_eq!(says.contains("everything drawn"), is_open, "{kind}: {says}");
            assert_eq!(tested == 0, is_open, "{kind}");
            // What was asked for changes no bit, and is done where an engine was named.
            assert_eq!(found, rows(EngineChoice::Auto, Culling::Off).0, "{kind}");
            if is_open {
                let (by_depth, tested, _) = rows(EngineChoice::Depth, Culling::On);
                assert_eq!(found, by_depth, "{kind}");
                assert!(tested > 0, "{kind}");
            }
        }
    }

    #[test]
    fn nothing_works_before_load() {
        let mut backend = CpuBackend::new();
        assert!(matches!(
            backend.rows(&[], &mut RowBlock::default()),
            Err(BackendError::InvalidArgument(_))
        ));
        assert!(backend.fork().is_err());
    }
}
