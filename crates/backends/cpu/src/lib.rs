//! The built-in backend: hemicubes on the CPU, with SIMD chosen at run time.
//!
//! Engine 1 is Greene's hierarchical z-buffer (Greene, Kass & Miller 1993): a tree over blocks of 16 triangles, walked
//! front to back, whose nodes are dropped where they lie outside all faces or behind what is already drawn. All five
//! faces are drawn in one walk. Rows are the same bits on every instruction set and with culling on or off.
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

mod engine;
mod kernel;

use engine::Engine;
use hemicube::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Geometry, Hemicube, HemicubeBackend, RenderSettings,
};
use hemicube::delta::{DeltaTable, is_resolution};
use hemicube::face::Items;
use hemicube::row::RowBlock;
pub use hemicube::tree::Hierarchy;
use hemicube::tree::Tree;
use std::sync::Arc;

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

/// A session of the built-in backend.
#[derive(Debug)]
pub struct CpuBackend {
    info: BackendInfo,
    isa: Isa,
    hierarchy: Hierarchy,
    loaded: Option<Loaded>,
}

#[derive(Debug)]
struct Loaded {
    shared: Arc<Shared>,
    engine: AnyEngine,
}

/// What all sessions over one scene share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) tree: Arc<Tree>,
    pub(crate) table: DeltaTable,
    pub(crate) settings: RenderSettings,
}

#[derive(Debug)]
enum AnyEngine {
    #[cfg(target_arch = "x86_64")]
    Avx512(Engine<kernel::x86::Avx512>),
    #[cfg(target_arch = "x86_64")]
    Avx2(Engine<kernel::x86::Avx2>),
    Portable(Engine<kernel::Portable>),
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

    fn of(isa: Isa) -> Self {
        Self {
            info: BackendInfo {
                name: "cpu".to_owned(),
                // The version of the arithmetic. It changes when any row could change by a bit.
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
            loaded: None,
        }
    }

    fn loaded(&mut self) -> Result<&mut Loaded, BackendError> {
        self.loaded
            .as_mut()
            .ok_or_else(|| BackendError::InvalidArgument("no scene is loaded; call `load` first".to_owned()))
    }
}

impl Loaded {
    fn new(shared: Arc<Shared>, isa: Isa) -> Self {
        let engine = match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => AnyEngine::Avx512(Engine::new(&shared)),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => AnyEngine::Avx2(Engine::new(&shared)),
            _ => AnyEngine::Portable(Engine::new(&shared)),
        };
        Self { shared, engine }
    }

    fn check(&self, hemicube: &Hemicube) -> Result<(), BackendError> {
        let count = self.shared.tree.patch_count;
        if let Some(patch) = hemicube.emitter
            && patch.0 >= count
        {
            return Err(BackendError::InvalidArgument(format!(
                "a hemicube names patch {} of a scene of {count} patches",
                patch.0
            )));
        }
        let finite = hemicube.origin.is_finite() && hemicube.axes.iter().all(|a| a.is_finite());
        if !finite {
            return Err(BackendError::InvalidArgument(
                "a hemicube's frame is not finite".to_owned(),
            ));
        }
        Ok(())
    }
}

impl HemicubeBackend for CpuBackend {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        if !is_resolution(settings.resolution) {
            return Err(BackendError::InvalidArgument(format!(
                "resolution {}: a multiple of 16 from 16 to 1024 is needed",
                settings.resolution
            )));
        }
        let shared = Arc::new(Shared {
            tree: match self.hierarchy {
                Hierarchy::SurfaceArea => Arc::clone(geometry.tree()),
                other => Arc::new(Tree::new(geometry, other)),
            },
            table: DeltaTable::new(settings.resolution),
            settings,
        });
        self.loaded = Some(Loaded::new(shared, self.isa));
        Ok(())
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
            loaded: Some(Loaded::new(Arc::clone(&loaded.shared), self.isa)),
        }))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let loaded = self.loaded()?;
        hemicubes.iter().try_for_each(|h| loaded.check(h))?;
        Ok(match &mut loaded.engine {
            #[cfg(target_arch = "x86_64")]
            AnyEngine::Avx512(engine) => engine.rows(&loaded.shared, hemicubes, out),
            #[cfg(target_arch = "x86_64")]
            AnyEngine::Avx2(engine) => engine.rows(&loaded.shared, hemicubes, out),
            AnyEngine::Portable(engine) => engine.rows(&loaded.shared, hemicubes, out),
        })
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let loaded = self.loaded()?;
        loaded.check(hemicube)?;
        Ok(match &mut loaded.engine {
            #[cfg(target_arch = "x86_64")]
            AnyEngine::Avx512(engine) => engine.items(&loaded.shared, hemicube),
            #[cfg(target_arch = "x86_64")]
            AnyEngine::Avx2(engine) => engine.items(&loaded.shared, hemicube),
            AnyEngine::Portable(engine) => engine.items(&loaded.shared, hemicube),
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
    fn nothing_works_before_load() {
        let mut backend = CpuBackend::new();
        assert!(matches!(
            backend.rows(&[], &mut RowBlock::default()),
            Err(BackendError::InvalidArgument(_))
        ));
        assert!(backend.fork().is_err());
    }
}
