//! The files under `generated/` are naga's translations of `wgsl/`. `BLESS=1` writes them.

use hemicube_shaders::stage::{self, Kind, Stage, binding};
use naga::back::{glsl, spv};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Module, ShaderStage, StorageAccess};
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

fn module(file: &str) -> (Module, ModuleInfo) {
    let read = |name: &str| {
        std::fs::read_to_string(folder().join("wgsl").join(format!("{name}.wgsl"))).expect("a committed shader")
    };
    let source = stage::parts(file).into_iter().map(read).collect::<Vec<_>>().join("\n");
    let module = naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|error| panic!("{file}: {}", error.emit_to_string(&source)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{file}: {}", error.emit_to_string(&source)));
    (module, info)
}

fn shader_stage(stage: &Stage) -> ShaderStage {
    match stage.kind {
        Kind::Vertex => ShaderStage::Vertex,
        Kind::Fragment => ShaderStage::Fragment,
        Kind::Compute => ShaderStage::Compute,
    }
}

fn to_spirv(stage: &Stage) -> Vec<u8> {
    let (module, info) = module(stage.file);
    let options = spv::Options {
        lang_version: (1, 3),
        // No ADJUST_COORDINATE_SPACE: rows of the atlas go up in memory as v does.
        flags: spv::WriterFlags::empty(),
        // Indices are in bounds by construction.
        bounds_check_policies: naga::proc::BoundsCheckPolicies::default(),
        force_loop_bounding: false,
        // Stages set what they share before they read it. One thread would write zeros for all.
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        ..Default::default()
    };
    let pipeline = spv::PipelineOptions {
        shader_stage: shader_stage(stage),
        entry_point: stage.entry.to_owned(),
    };
    let words = spv::write_vec(&module, &info, &options, Some(&pipeline)).expect("SPIR-V can say it");
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

fn to_glsl(stage: &Stage) -> String {
    let (module, info) = module(stage.file);
    let map = module.global_variables.iter().filter_map(|(_, variable)| {
        let at = variable.binding?;
        // Drivers have as few as eight image units, and there is one image.
        let unit = if at.binding == binding::SETTLED_ITEMS {
            0
        } else {
            at.binding
        };
        Some((at, u8::try_from(unit).expect("few bindings")))
    });
    let options = glsl::Options {
        version: glsl::Version::Desktop(450),
        // No ADJUST_COORDINATE_SPACE, with glClipControl(LOWER_LEFT, ZERO_TO_ONE).
        writer_flags: glsl::WriterFlags::empty(),
        binding_map: map.collect(),
        // As for SPIR-V.
        zero_initialize_workgroup_memory: false,
    };
    let pipeline = glsl::PipelineOptions {
        shader_stage: shader_stage(stage),
        entry_point: stage.entry.to_owned(),
        multiview: None,
    };
    let mut text = String::new();
    glsl::Writer::new(
        &mut text,
        &module,
        &info,
        &options,
        &pipeline,
        naga::proc::BoundsCheckPolicies::default(),
    )
    .expect("GLSL can say it")
    .write()
    .expect("GLSL can say it");
    text
}

#[test]
fn generated_files_are_what_naga_makes_of_the_shaders() {
    let bless = std::env::var_os("BLESS").is_some_and(|v| v == "1");
    let mut stale = Vec::new();
    for stage in stage::ALL {
        for (ending, made, committed) in [
            ("spv", to_spirv(stage), stage.spirv),
            ("glsl", to_glsl(stage).into_bytes(), stage.glsl.as_bytes()),
        ] {
            let path = folder().join("generated").join(format!("{}.{ending}", stage.entry));
            if bless {
                std::fs::write(&path, &made).expect("a writable checkout");
            } else if made != committed {
                stale.push(path.display().to_string());
            }
        }
    }
    assert!(
        stale.is_empty(),
        "not what naga makes of wgsl/: {stale:?}; run this test with BLESS=1 and commit"
    );
}

#[test]
fn every_wgsl_file_is_a_stage_and_every_generated_file_is_one() {
    let names = |folder: PathBuf| -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .expect("a folder of the crate")
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    let mut files: Vec<String> = stage::ALL.iter().map(|s| format!("{}.wgsl", s.file)).collect();
    files.extend(["shared.wgsl".to_owned(), "exact.wgsl".to_owned()]);
    files.sort();
    files.dedup();
    assert_eq!(names(folder().join("wgsl")), files);
    let mut generated: Vec<String> = stage::ALL
        .iter()
        .flat_map(|s| [format!("{}.spv", s.entry), format!("{}.glsl", s.entry)])
        .collect();
    generated.sort();
    assert_eq!(names(folder().join("generated")), generated);
}

#[test]
fn bindings_are_below_their_count_and_only_the_view_is_in_group_0() {
    for stage in stage::ALL {
        let (module, _) = module(stage.file);
        for (_, variable) in module.global_variables.iter() {
            let Some(at) = variable.binding else { continue };
            assert!(at.binding < binding::COUNT || stage.file == "rays");
            assert_eq!(at.group == 0, at.binding == binding::VIEW, "{}", stage.file);
        }
    }
}

#[test]
fn stages_read_and_write_what_their_entry_points_use() {
    for stage in stage::ALL {
        let (module, info) = module(stage.file);
        let entry = module.entry_points.iter().position(|entry| entry.name == stage.entry);
        let uses = info.get_entry_point(entry.expect("an entry point of its file"));
        let (mut reads, mut writes) = (Vec::new(), Vec::new());
        for (handle, variable) in module.global_variables.iter() {
            let Some(at) = variable.binding else { continue };
            if at.binding == binding::VIEW || uses[handle].is_empty() {
                continue;
            }
            let is_written = match variable.space {
                AddressSpace::Storage { access } => access.contains(StorageAccess::STORE),
                _ => at.binding == binding::SETTLED_ITEMS,
            };
            if is_written { &mut writes } else { &mut reads }.push(at.binding);
        }
        reads.sort_unstable();
        writes.sort_unstable();
        let sorted = |bindings: &[u32]| {
            let mut bindings = bindings.to_vec();
            bindings.sort_unstable();
            bindings
        };
        assert_eq!(
            (sorted(stage.reads), sorted(stage.writes)),
            (reads, writes),
            "{}",
            stage.entry
        );
    }
}
