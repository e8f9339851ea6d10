//! Feeds bytes to the reader of height models: it may refuse them, but not panic, hang or take memory that the bytes don't
//! justify, and a scene that it hands out refers only to what is there. From `crates/scene`, keeping what is found out
//! of the committed corpus:
//!
//! ```text
//! mkdir -p fuzz/artifacts/new
//! cargo fuzz run -s none raster fuzz/artifacts/new fuzz/corpus/raster -- -max_len=4096 -timeout=5 -rss_limit_mb=1024
//! ```

#![no_main]

use hemicube_scene::{ReadOptions, raster};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(scene) = raster::read(bytes, None, ReadOptions { optics: true, ..ReadOptions::default() }) {
        for triangle in &scene.triangles {
            assert!((triangle.object as usize) < scene.objects.len());
            assert!((triangle.material as usize) < scene.materials.len());
        }
        assert!(scene.triangles.is_sorted_by_key(|triangle| triangle.face));
    }
});
