//! Backends, and the ways to try each: *original*, *thesis*, *ours*, and others between them.

use crate::prepare::{BUILT_IN, registry};
use anyhow::Result;
use hemicube::HierarchyOptions;
use hemicube::backend::{Culling, HemicubeBackend};
use hemicube_backend_cpu::{CpuBackend, EngineChoice, Hierarchy};
use hemicube_host::{DeviceKind, Options};

/// Backends to look for if none is named.
pub(super) const KNOWN: [&str; 4] = [BUILT_IN, "gl", "vulkan", "wgpu"];

/// A backend that opens.
#[derive(Clone, Debug)]
pub(super) struct Target {
    pub(super) name: String,
    pub(super) version: String,
    pub(super) device: String,
    /// True if the processor does the work: then processor time counts, otherwise wall-clock time.
    pub(super) on_processor: bool,
}

impl Target {
    /// Opens a backend by its name.
    ///
    /// # Errors
    /// When it does not open.
    pub(super) fn open(name: &str) -> Result<Self> {
        if name == BUILT_IN {
            let backend = CpuBackend::new();
            return Ok(Self {
                name: BUILT_IN.to_owned(),
                version: "1".to_owned(),
                device: backend.info().device.clone(),
                on_processor: true,
            });
        }
        let backend = registry().open(name, &Options::default())?;
        let info = backend.info();
        Ok(Self {
            name: info.name.clone(),
            version: info.version.clone(),
            device: info.device.clone(),
            on_processor: backend.device().kind == DeviceKind::Software,
        })
    }

    pub(super) fn is_built_in(&self) -> bool {
        self.name == BUILT_IN
    }

    /// Returns whether it has the thesis's algorithm: an octree with occlusion found or queried node by node.
    pub(super) fn has_thesis(&self) -> bool {
        self.is_built_in() || self.name == "gl"
    }
}

/// Instructions to a backend.
#[derive(Clone, Debug, PartialEq)]
enum How {
    /// The built-in one.
    Cpu(EngineChoice, Hierarchy, Culling),
    /// Options of a plugin.
    Options(Vec<String>, Culling),
}

/// A way of rendering.
#[derive(Clone, Debug)]
pub(super) struct Way {
    pub(super) name: String,
    /// Octree levels and least patches of a query, for ways with fixed ones.
    pub(super) parameters: Option<(u32, u32)>,
    how: How,
}

pub(super) const ORIGINAL: &str = "original";
pub(super) const THESIS: &str = "thesis";
pub(super) const FLAT: &str = "no octree";
pub(super) const OURS: &str = "ours";

impl Way {
    /// In keys: the name, with its parameters.
    pub(super) fn key(&self) -> String {
        match self.parameters {
            None => self.name.clone(),
            Some((levels, least)) => format!("{} {levels}/{least}", self.name),
        }
    }

    /// Subdivision of the octree given to this way's session.
    pub(super) fn hierarchy(&self) -> Option<HierarchyOptions> {
        match (&self.how, self.parameters) {
            (How::Cpu(..), Some((max_level, min_patches))) => Some(HierarchyOptions { max_level, min_patches }),
            _ => None,
        }
    }

    pub(super) fn culling(&self) -> Culling {
        match self.how {
            How::Cpu(_, _, culling) | How::Options(_, culling) => culling,
        }
    }

    /// Opens a session of this way.
    ///
    /// # Errors
    /// When the backend does not open.
    pub(super) fn session(&self, target: &Target) -> Result<Box<dyn HemicubeBackend>> {
        Ok(match &self.how {
            How::Cpu(engine, hierarchy, _) => {
                Box::new(CpuBackend::new().with_hierarchy(*hierarchy).with_engine(*engine))
            }
            How::Options(options, _) => Box::new(registry().open(&target.name, &Options::parse(options)?)?),
        })
    }

    /// Settings of `compute` for this way; `None` if it has none.
    pub(super) fn engine_words(&self, target: &Target) -> Option<Vec<String>> {
        let mut words = vec!["--backend".to_owned(), target.name.clone()];
        match &self.how {
            How::Cpu(EngineChoice::Auto, Hierarchy::SurfaceArea, Culling::On) => {}
            How::Cpu(..) | How::Options(_, Culling::Off) => return None,
            How::Options(options, Culling::On) => {
                words.extend(options.iter().flat_map(|o| ["--backend-option".to_owned(), o.clone()]));
            }
        }
        Some(words)
    }
}

/// All ways to try on `target`, without parameters. `all` adds the competitors of the best.
pub(super) fn ways(target: &Target, all: bool) -> Vec<Way> {
    use EngineChoice::{Auto, Depth, Order};
    let way = |name: &str, how| Way {
        name: name.to_owned(),
        parameters: None,
        how,
    };
    let cpu = |name: &str, engine, hierarchy, culling| way(name, How::Cpu(engine, hierarchy, culling));
    let plugin = |name: &str, options: &[&str]| {
        let options = options.iter().map(|&o| o.to_owned()).collect();
        way(name, How::Options(options, Culling::On))
    };
    let (main, more) = match target.name.as_str() {
        BUILT_IN => (
            vec![
                cpu(ORIGINAL, Depth, Hierarchy::SurfaceArea, Culling::Off),
                cpu(THESIS, Depth, Hierarchy::Octree, Culling::On),
                cpu(OURS, Auto, Hierarchy::SurfaceArea, Culling::On),
            ],
            vec![
                cpu("depth", Depth, Hierarchy::SurfaceArea, Culling::On),
                cpu("order", Order, Hierarchy::SurfaceArea, Culling::On),
            ],
        ),
        "gl" => (
            vec![
                plugin(ORIGINAL, &["baseline=original"]),
                plugin(FLAT, &["cull=off"]),
                plugin(THESIS, &["baseline=thesis"]),
                plugin(OURS, &[]),
            ],
            vec![
                plugin("frustum", &["cull=view"]),
                plugin("queries", &["cull=queries"]),
                plugin("marks", &["cull=marks"]),
                plugin("depth", &["cull=depth"]),
            ],
        ),
        "vulkan" | "wgpu" => (
            vec![
                plugin(ORIGINAL, &["cull=off", "batch=1", "group=1"]),
                plugin(FLAT, &["cull=off"]),
                plugin(OURS, &[]),
            ],
            vec![
                plugin("frustum", &["cull=frustum"]),
                plugin("occlusion", &["cull=occlusion"]),
            ],
        ),
        // Another backend: only the contract's settings.
        _ => (
            vec![way(ORIGINAL, How::Options(Vec::new(), Culling::Off)), plugin(OURS, &[])],
            Vec::new(),
        ),
    };
    main.into_iter().chain(more.into_iter().filter(|_| all)).collect()
}

/// The thesis's way with these parameters, if the target has it.
pub(super) fn with_parameters(target: &Target, levels: u32, least: u32) -> Way {
    let how = if target.is_built_in() {
        How::Cpu(EngineChoice::Depth, Hierarchy::Octree, Culling::On)
    } else {
        let options = [
            "baseline=thesis".to_owned(),
            format!("max_level={levels}"),
            format!("min_patches={least}"),
        ];
        How::Options(options.to_vec(), Culling::On)
    };
    Way {
        name: THESIS.to_owned(),
        parameters: Some((levels, least)),
        how,
    }
}

/// A backend's own finding, and its competitors.
#[derive(Clone, Debug)]
pub(super) struct Finding {
    /// In keys.
    pub(super) key: &'static str,
    /// In tables.
    pub(super) what: &'static str,
    /// The way with the finding.
    pub(super) found: Way,
    /// Ways to choose by hand instead.
    pub(super) others: Vec<Way>,
}

pub(super) const FOUND_PARAMETERS: &str = "found parameters";
pub(super) const FOUND_CULLING: &str = "found culling";

/// Findings of `target`. `parameters` are the thesis's way with the parameters tried.
pub(super) fn findings(target: &Target, parameters: Vec<Way>) -> Vec<Finding> {
    let by_name = |name: &str| ways(target, false).into_iter().find(|way| way.name == name);
    let mut findings = Vec::new();
    // The built-in backend has the octree for comparison only.
    if let Some(found) = by_name(THESIS).filter(|_| !target.is_built_in() && !parameters.is_empty()) {
        findings.push(Finding {
            key: FOUND_PARAMETERS,
            what: "octree levels, least patches",
            found,
            others: parameters,
        });
    }
    let mut others = ways(target, true);
    others.retain(|way| way.name != OURS && (way.name != THESIS || target.is_built_in()));
    // Two are no choice: *original*, and the contract's settings.
    if let Some(found) = by_name(OURS).filter(|_| others.len() > 2) {
        findings.push(Finding {
            key: FOUND_CULLING,
            what: if target.is_built_in() {
                "engine, culling"
            } else {
                "culling"
            },
            found,
            others,
        });
    }
    findings
}

/// The backends to measure: the named ones, or all known ones that open, and the reasons why others do not.
///
/// # Errors
/// When a named one does not open.
pub(super) fn targets(named: &[String]) -> Result<(Vec<Target>, Vec<String>)> {
    if !named.is_empty() {
        let targets = named.iter().map(|name| Target::open(name)).collect::<Result<_>>()?;
        return Ok((targets, Vec::new()));
    }
    let (mut targets, mut without) = (Vec::new(), Vec::new());
    for name in KNOWN {
        match Target::open(name) {
            Ok(target) => targets.push(target),
            Err(error) => {
                let reason = format!("{error:#}");
                without.push(reason.lines().next().unwrap_or_default().to_owned());
            }
        }
    }
    Ok((targets, without))
}
