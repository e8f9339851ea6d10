//! The C header: generated from the types, committed, and compiled by C and C++ with Rust's layout.
//!
//! `BLESS=1 cargo test -p hemicube-abi --test header` writes it anew. Needs `cc` and `c++`.

use hemicube_abi::types::{
    HcBackend, HcCounters, HcDevice, HcError, HcHemicube, HcHost, HcNode, HcPass, HcRays, HcRows, HcScene,
    HcSessionInfo, HcSettings, HcStageTimes,
};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

fn header_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("include/hemicube_backend.h")
}

fn generate() -> String {
    let config = cbindgen::Config {
        language: cbindgen::Language::C,
        include_guard: Some("HEMICUBE_BACKEND_H".to_owned()),
        header: Some(
            "/* The ABI of hemicube backends loaded at run time.\n \
             * Generated from crates/backends/abi/src/types.rs: do not edit.\n */"
                .to_owned(),
        ),
        no_includes: true,
        // The session is the plugin's own struct, so it is only declared: cbindgen would make it one of size 0.
        after_includes: Some(
            "\n#include <stdint.h>\n\ntypedef struct HcSession HcSession;\n\n\
             /* Put before the definition of `hemicube_backend`. */\n\
             #if defined(_WIN32)\n\
             #define HC_EXPORT __declspec(dllexport)\n\
             #elif defined(__GNUC__)\n\
             #define HC_EXPORT __attribute__((visibility(\"default\")))\n\
             #else\n\
             #define HC_EXPORT\n\
             #endif"
                .to_owned(),
        ),
        trailer: Some(
            "#ifdef __cplusplus\nextern \"C\" {\n#endif\n\n\
             /* Defined by the plugin, once in its image. */\n\
             extern HC_EXPORT const HcBackend hemicube_backend;\n\n\
             #ifdef __cplusplus\n}\n#endif"
                .to_owned(),
        ),
        cpp_compat: true,
        style: cbindgen::Style::Both,
        documentation_style: cbindgen::DocumentationStyle::C,
        line_length: 110,
        export: cbindgen::ExportConfig {
            include: vec!["HcBackend".to_owned()],
            exclude: vec!["HcSession".to_owned()],
            ..Default::default()
        },
        ..Default::default()
    };
    let mut bytes = Vec::new();
    cbindgen::Builder::new()
        .with_src(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/types.rs"))
        .with_config(config)
        .generate()
        .expect("types that C has")
        .write(&mut bytes);
    String::from_utf8(bytes).expect("a header in UTF-8")
}

#[test]
fn the_header_is_that_of_the_types() {
    let (path, wanted) = (header_path(), generate());
    if std::env::var_os("BLESS").is_some_and(|value| value == "1") {
        std::fs::write(&path, &wanted).expect("the header can be written");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == wanted,
        "`{}` is not what the types give; BLESS=1 writes it anew",
        path.display()
    );
}

/// The size of a struct and the offsets of its fields, as assertions in C. A field missing here does not compile.
macro_rules! layout {
    ($out:ident, $($struct:ident { $($field:ident),* $(,)? })*) => { $(
        // Names every field, so that one that is new cannot be forgotten.
        #[allow(dead_code, reason = "only type-checked")]
        fn $struct(value: hemicube_abi::types::$struct) {
            let hemicube_abi::types::$struct { $($field: _),* } = value;
        }
        let name = stringify!($struct);
        let _ = writeln!($out, "ASSERT(sizeof({name}) == {});", size_of::<$struct>());
        $( let _ = writeln!(
            $out, "ASSERT(offsetof({name}, {}) == {});", stringify!($field), std::mem::offset_of!($struct, $field),
        ); )*
    )* };
}

#[allow(non_snake_case, reason = "functions named as the structs that they take apart")]
fn layout() -> String {
    let mut out = String::new();
    layout! { out,
        HcError { message }
        HcDevice { name, capabilities, kind, max_resolution, preferred_rows, reserved }
        HcHost { struct_size, reserved, context, log }
        HcSessionInfo { struct_size, preferred_rows, capabilities, device, version, choices }
        HcNode {
            min, max, own_min, own_max, first_surface, own_end, surface_end, first_child, child_count, parent, cell, level,
        }
        HcScene {
            struct_size, patch_count, identity, plane_tolerance, surface_count, corners, front, back, node_count, nodes,
            cube_origin, cube_half_edge, octree_levels, octree_min_items, octree_loose, reserved,
        }
        HcSettings { struct_size, resolution, culling, covered, weights }
        HcHemicube { emitter, reserved, origin, axes }
        HcPass { struct_size, reserved, origin, axes, normal, offset, word_count, open }
        HcRays { struct_size, emitter, normal, offset, ray_count, ends, met }
        HcCounters {
            hemicubes, nodes_tested, nodes_outside, nodes_hidden, triangles_transformed, triangles_drawn, queries,
            bytes_read_back, reserved,
        }
        HcStageTimes { cull, render, cover, reduce, read_back, reserved }
        HcRows {
            struct_size, row_count, capacity, hemicubes, row_end, patches, visible, covered, escaped, blocked, counters,
            stage_times,
        }
        HcBackend { abi_version, struct_size, name, version, devices, open, info, load, rows, items, close, pass, rays }
    }
    out
}

/// Compiles a source with all warnings as errors; returns the compiler's words if it refused.
fn compile(compiler: &str, standard: &str, file: &str, text: &str) -> Result<(), String> {
    let place = tempfile::tempdir().expect("a temporary directory");
    let source = place.path().join(file);
    std::fs::write(&source, text).expect("room for a source");
    let output = Command::new(compiler)
        .args([standard, "-Wall", "-Wextra", "-pedantic", "-Werror", "-c", "-o"])
        .arg(place.path().join("out.o"))
        .arg("-I")
        .arg(header_path().parent().expect("a folder"))
        .arg(&source)
        .output()
        .unwrap_or_else(|error| panic!("`{compiler}` cannot be run: {error}; install gcc and g++"));
    if output.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

const HEAD: &str = "#include \"hemicube_backend.h\"\n#include <stddef.h>\n";

#[test]
fn c_and_cpp_have_the_layout_of_rust() {
    let layout = layout();
    let constants = "ASSERT(HC_WHOLE == 2147483648u);\nASSERT(HC_ABI_VERSION == 1);\nASSERT(HC_CAN_ITEMS == 4);\n";
    let c = format!("{HEAD}#define ASSERT(c) _Static_assert(c, #c)\n{layout}{constants}");
    compile("cc", "-std=c11", "layout.c", &c).unwrap_or_else(|said| panic!("{said}"));
    let cpp = format!("{HEAD}#define ASSERT(c) static_assert(c, #c)\n{layout}{constants}");
    compile("c++", "-std=c++17", "layout.cpp", &cpp).unwrap_or_else(|said| panic!("{said}"));

    // And a layout that is not Rust's is refused.
    let offset = format!("offsetof(HcRows, covered) == {}", std::mem::offset_of!(HcRows, covered));
    assert_eq!(c.matches(&offset).count(), 1);
    let wrong = c.replace(&offset, "offsetof(HcRows, covered) == 52");
    assert!(compile("cc", "-std=c11", "layout.c", &wrong).is_err());
}
