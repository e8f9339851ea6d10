//! The built-in backend: hemicubes on the CPU, with SIMD chosen at run time.
//!
//! Engine `depth` is Greene's hierarchical z-buffer (Greene, Kass & Miller 1993): a tree over blocks of 16 triangles,
//! walked front to back; nodes are dropped outside all faces or behind the buffer. All five faces are drawn in one
//! walk. Engine `order` draws strictly front to back, in the order of a binary space partition, with one coverage bit a
//! pixel. Engine `claims` walks the tree of engine `depth` with the coverage bits of engine `order`, and computes
//! depths only for pixels that two surfaces contend for. [`EngineChoice`] says which scenes get which.
//!
//! All of them draw parent triangles, the triangles before they were cut into patches, and distribute their visible
//! weights over the patches (engine `order` not at N = 1024, unless only visible fractions are asked for). Parents are
//! found by consecutive patches as `hemicube_scene::Subdivision` cuts them.
//!
//! Rows are the same bits on every instruction set and with culling on or off. Those of engines `depth` and `claims`
//! are the same bits, and pixel sums of engine `order` the same wherever f32 depths can tell surfaces apart.
//!
//! ```text
//! lib      sessions: the HemicubeBackend implementation
//! choice   the engine that suits a scene
//! close    hemicubes that a device leaves
//! engine   walks and rows
//! kernel   arithmetic, instruction sets
//! bsp      binary space partition
//! parents  parent triangles
//! ```
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

mod bsp;
mod choice;
mod close;
mod engine;
mod kernel;
mod parents;

pub use choice::EngineChoice;
use choice::{Engine, Plan};
pub use close::with_close;
use engine::{BspEngine, TreeEngine};
use hemicube_contract::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Geometry, Hemicube, HemicubeBackend, RenderSettings,
};
pub use hemicube_contract::bvh::Hierarchy;
use hemicube_contract::bvh::{Block, LANES, Tree};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;
use kernel::{DepthBuffer, InstructionSet, OwnershipBuffer};
use parents::ParentTriangles;
use std::sync::Arc;

/// An instruction set that the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512 F, BW, DQ, VL.
    Avx512,
    /// AVX2.
    Avx2,
    /// The instructions that the target guarantees.
    Portable,
}

impl Isa {
    /// The sets that this machine has, best first.
    pub fn available() -> Vec<Self> {
        let mut all = vec![Self::Avx512, Self::Avx2, Self::Portable];
        all.retain(|&isa| InstructionSet::of(isa).is_some());
        all
    }

    fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "AVX-512",
            Self::Avx2 => "AVX2",
            Self::Portable => "portable",
        }
    }
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
    isa: InstructionSet,
    hierarchy: Hierarchy,
    choice: EngineChoice,
    /// True if parent triangles are drawn.
    draws_parents: bool,
    /// Why the engine of the loaded scene is the one it is.
    reason: String,
    loaded: Option<Session>,
}

/// A session with a scene.
#[derive(Debug)]
struct Session {
    geometry: Arc<Geometry>,
    scene: Arc<SharedScene>,
    engines: Engines,
    /// Draws patch by patch for hemicubes that do not stand on their emitter's parent: they see its other patches. Made
    /// when first asked for.
    patch_by_patch: Option<Box<CpuBackend>>,
}

/// The parts of a loaded scene that all sessions share.
#[derive(Debug)]
pub(crate) struct SharedScene {
    pub(crate) isa: InstructionSet,
    engine: Engine,
    /// Tree over the drawn triangles: surfaces, or `parents`.
    pub(crate) tree: Arc<Tree>,
    pub(crate) parents: Option<Arc<ParentTriangles>>,
    pub(crate) table: DeltaTable,
    pub(crate) settings: RenderSettings,
    /// True if the weights of a parent's fully visible patches may be any equal ones. Only with `parents` and with
    /// covered weights.
    pub(crate) fractions: bool,
}

impl SharedScene {
    /// Puts a patch, with its own id on both sides, into a lane of a block.
    pub(crate) fn put(&self, patch: u32, lane: usize, out: &mut Block) {
        if let Some(parents) = &self.parents {
            parents.put(patch, lane, out);
        } else {
            self.put_drawn(patch, lane, out);
        }
    }

    /// Puts the triangle drawn with an id into a lane of a block.
    pub(crate) fn put_drawn(&self, id: u32, lane: usize, out: &mut Block) {
        let slot = self.tree.slot_of_patch[id as usize] as usize;
        let (block, from) = (&self.tree.blocks[slot / LANES], slot % LANES);
        for (to, corners) in out.corners.iter_mut().zip(&block.corners) {
            to[lane] = corners[from];
        }
        (out.negative[lane], out.positive[lane]) = (block.negative[from], block.positive[from]);
    }
}

/// Working memory of the engines, made when first used.
#[derive(Debug, Default)]
struct Engines {
    depth: Option<TreeEngine<DepthBuffer>>,
    order: Option<BspEngine>,
    claims: Option<TreeEngine<OwnershipBuffer>>,
}

impl Engines {
    fn depth(&mut self, scene: &SharedScene) -> &mut TreeEngine<DepthBuffer> {
        self.depth.get_or_insert_with(|| TreeEngine::new(scene))
    }

    fn rows(&mut self, scene: &SharedScene, hemicubes: &[Hemicube], out: &mut RowBlock) -> Counters {
        match &scene.engine {
            Engine::Depth => self.depth(scene).rows(scene, hemicubes, out),
            Engine::Order(bsp) => self
                .order
                .get_or_insert_with(|| BspEngine::new(scene))
                .rows(scene, bsp, hemicubes, out),
            Engine::Claims => self
                .claims
                .get_or_insert_with(|| TreeEngine::new(scene))
                .rows(scene, hemicubes, out),
        }
    }
}

impl Engines {
    fn claims(&mut self, scene: &SharedScene) -> &mut TreeEngine<OwnershipBuffer> {
        self.claims.get_or_insert_with(|| TreeEngine::new(scene))
    }

    /// The item buffer of a hemicube: engine `order` has none, and leaves it to engine `depth`.
    fn items(&mut self, scene: &SharedScene, hemicube: &Hemicube) -> Items {
        match &scene.engine {
            Engine::Claims => self.claims(scene).items(scene, hemicube),
            Engine::Depth | Engine::Order(_) => self.depth(scene).items(scene, hemicube),
        }
    }

    fn row_and_items(&mut self, scene: &SharedScene, hemicube: &Hemicube, out: &mut RowBlock) -> (Items, Counters) {
        match &scene.engine {
            Engine::Claims => self.claims(scene).row_and_items(scene, hemicube, out),
            Engine::Depth | Engine::Order(_) => self.depth(scene).row_and_items(scene, hemicube, out),
        }
    }

    /// The pixels of a hemicube that show nothing of the scene, by the engine that renders its rows.
    fn escaped(&mut self, scene: &SharedScene, hemicube: &Hemicube, out: &mut EscapedPixels) {
        match &scene.engine {
            Engine::Depth => self.depth(scene).escaped(scene, hemicube, out),
            Engine::Order(bsp) => self
                .order
                .get_or_insert_with(|| BspEngine::new(scene))
                .escaped(scene, bsp, hemicube, out),
            Engine::Claims => self
                .claims
                .get_or_insert_with(|| TreeEngine::new(scene))
                .escaped(scene, hemicube, out),
        }
    }
}

impl Default for CpuBackend {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuBackend {
    /// A session with the best instruction set that this machine has.
    pub fn new() -> Self {
        let best = Isa::available()[0];
        Self::with_isa(best).expect("it is available")
    }

    /// A session with a given instruction set, or `None` if the machine lacks it. For tests and measurements.
    pub fn with_isa(isa: Isa) -> Option<Self> {
        InstructionSet::of(isa).map(|set| Self::of(set, isa.name()))
    }

    fn of(isa: InstructionSet, name: &str) -> Self {
        Self {
            info: BackendInfo {
                name: "cpu".to_owned(),
                // The version of the arithmetic. It changes when any row could change by a bit. `load` says which
                // engine's.
                version: "1".to_owned(),
                device: format!("this machine's processor, {name}"),
                capabilities: Capabilities {
                    covered: true,
                    tiny_patches: true,
                    items: true,
                    lossless_culling: true,
                    passes: false,
                    rays: false,
                    leaves_close: false,
                },
                preferred_rows: 16,
            },
            isa,
            hierarchy: Hierarchy::default(),
            choice: EngineChoice::default(),
            draws_parents: true,
            reason: String::new(),
            loaded: None,
        }
    }

    /// Sets the hierarchy that is walked from the next `load` on. For measurements.
    #[must_use]
    pub fn with_hierarchy(mut self, hierarchy: Hierarchy) -> Self {
        self.hierarchy = hierarchy;
        self
    }

    /// Sets the engine from the next `load` on.
    #[must_use]
    pub fn with_engine(mut self, choice: EngineChoice) -> Self {
        self.choice = choice;
        self
    }

    /// Draws every patch by itself from the next `load` on, instead of parent triangles. For measurements and tests.
    #[must_use]
    pub fn patch_by_patch(mut self) -> Self {
        self.draws_parents = false;
        self
    }

    /// The engine that renders the loaded scene: never [`EngineChoice::Auto`]. `None` before `load`.
    pub fn engine(&self) -> Option<EngineChoice> {
        self.loaded.as_ref().map(|loaded| match loaded.scene.engine {
            Engine::Depth => EngineChoice::Depth,
            Engine::Order(_) => EngineChoice::Order,
            Engine::Claims => EngineChoice::Claims,
        })
    }

    fn load_for(
        &mut self,
        geometry: &Arc<Geometry>,
        settings: RenderSettings,
        fractions: bool,
    ) -> Result<(), BackendError> {
        settings.check()?;
        let draws_parents = self.draws_parents && self.hierarchy == Hierarchy::SurfaceArea;
        let Plan {
            engine,
            parents,
            culling,
            fractions,
            version,
            reason,
        } = Plan::new(self.choice, geometry, settings, draws_parents, fractions)?;
        self.info.version = version.to_owned();
        self.reason = reason;
        let scene = Arc::new(SharedScene {
            isa: self.isa,
            engine,
            tree: match (&parents, self.hierarchy) {
                (Some(parents), _) => Arc::clone(&parents.tree),
                (None, Hierarchy::SurfaceArea) => Tree::of(geometry),
                (None, other) => Arc::new(Tree::new(geometry, other)),
            },
            parents,
            table: DeltaTable::new(settings.resolution),
            settings: RenderSettings { culling, ..settings },
            fractions,
        });
        self.loaded = Some(Session::new(Arc::clone(geometry), scene));
        Ok(())
    }

    /// The pixels of a hemicube that show nothing of the scene.
    fn escaped_pixels(&mut self, hemicube: &Hemicube, out: &mut EscapedPixels) -> Result<(), BackendError> {
        let loaded = self.loaded()?;
        loaded.check(hemicube)?;
        if !loaded.may_draw_parents(hemicube) {
            return loaded.patch_by_patch()?.escaped_pixels(hemicube, out);
        }
        loaded.engines.escaped(&loaded.scene, hemicube, out);
        Ok(())
    }

    fn loaded(&mut self) -> Result<&mut Session, BackendError> {
        self.loaded.as_mut().ok_or_else(not_loaded)
    }
}

fn not_loaded() -> BackendError {
    BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned())
}

impl Session {
    fn new(geometry: Arc<Geometry>, scene: Arc<SharedScene>) -> Self {
        Self {
            geometry,
            scene,
            engines: Engines::default(),
            patch_by_patch: None,
        }
    }

    /// Returns true if parent triangles may be drawn for a hemicube.
    fn may_draw_parents(&self, hemicube: &Hemicube) -> bool {
        let parents = self.scene.parents.as_ref();
        parents.is_none_or(|parents| parents.is_stood_on(hemicube, self.scene.tree.plane_tolerance))
    }

    /// The session for all other hemicubes.
    fn patch_by_patch(&mut self) -> Result<&mut CpuBackend, BackendError> {
        if self.patch_by_patch.is_none() {
            let mut backend = CpuBackend::of(self.scene.isa, "")
                .with_engine(EngineChoice::Depth)
                .patch_by_patch();
            backend.load(&self.geometry, self.scene.settings)?;
            self.patch_by_patch = Some(Box::new(backend));
        }
        Ok(self.patch_by_patch.as_mut().expect("made above"))
    }

    fn check(&self, hemicube: &Hemicube) -> Result<(), BackendError> {
        hemicube.check(self.scene.tree.patch_count)
    }
}

impl CpuBackend {
    /// Another session over the loaded scene.
    fn another(&self) -> Result<Self, BackendError> {
        let loaded = self.loaded.as_ref().ok_or_else(not_loaded)?;
        Ok(Self {
            info: self.info.clone(),
            reason: self.reason.clone(),
            loaded: Some(Session::new(Arc::clone(&loaded.geometry), Arc::clone(&loaded.scene))),
            ..*self
        })
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
        Ok(Box::new(self.another()?))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let loaded = self.loaded()?;
        hemicubes.iter().try_for_each(|h| loaded.check(h))?;
        let mut counters = Counters::default();
        let mut left = hemicubes;
        // Render runs of hemicubes that may, or may not, draw parents.
        while let Some(first) = left.first() {
            let draws_parents = loaded.may_draw_parents(first);
            let other = left
                .iter()
                .position(|hemicube| loaded.may_draw_parents(hemicube) != draws_parents);
            let (these, others) = left.split_at(other.unwrap_or(left.len()));
            left = others;
            counters += if draws_parents {
                loaded.engines.rows(&loaded.scene, these, out)
            } else {
                loaded.patch_by_patch()?.rows(these, out)?
            };
        }
        Ok(counters)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let loaded = self.loaded()?;
        loaded.check(hemicube)?;
        if !loaded.may_draw_parents(hemicube) {
            return loaded.patch_by_patch()?.items(hemicube);
        }
        Ok(loaded.engines.items(&loaded.scene, hemicube))
    }

    fn draws_once(&self) -> bool {
        self.loaded
            .as_ref()
            .is_some_and(|loaded| !loaded.scene.settings.covered)
    }

    fn rows_and_items(
        &mut self,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
        items: &mut Vec<Items>,
    ) -> Result<Counters, BackendError> {
        let mut counters = Counters::default();
        for hemicube in hemicubes {
            let loaded = self.loaded()?;
            loaded.check(hemicube)?;
            counters += if loaded.may_draw_parents(hemicube) {
                let (seen, counters) = loaded.engines.row_and_items(&loaded.scene, hemicube, out);
                items.push(seen);
                counters
            } else {
                let whole = loaded.patch_by_patch()?;
                whole.rows_and_items(std::slice::from_ref(hemicube), out, items)?
            };
        }
        Ok(counters)
    }

    fn escaped(
        &mut self,
        hemicube: &Hemicube,
        _table: &DeltaTable,
        out: &mut EscapedPixels,
    ) -> Result<(), BackendError> {
        self.escaped_pixels(hemicube, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_contract::backend::Culling;

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
            // The wish changes no bit, and is granted where an engine was named.
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
