//! Rows of the Vulkan backend, with the validation layer on: whatever it says fails the call.

use hemicube::backend::{Culling, HemicubeBackend, RenderSettings};
use hemicube::row::RowBlock;
use hemicube_backend_cpu::CpuBackend;
use hemicube_backend_vulkan::open;
use hemicube_tests::devices::{self, Opened, compare_items, compare_rows, is_there, some};
use hemicube_tests::rows::render_with;
use hemicube_tests::scenes::say;

fn vulkan(options: &str) -> Opened {
    Ok(Box::new(open(0, &format!("validation=on,{options}"))?))
}

#[test]
fn rows_agree_with_the_cpu_backend() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::scenes() {
        let settings = RenderSettings {
            resolution: 256,
            culling: Culling::Off,
            covered: false,
        };
        let hemicubes = some(&model, 24);
        let mut gpu = vulkan("").expect("it was there");
        let mut cpu = CpuBackend::new();
        let (a, _) = render_with(&mut *gpu, &model, &hemicubes, settings);
        let (b, _) = render_with(&mut cpu, &model, &hemicubes, settings);
        let apart = compare_rows(&a, &b);
        let pixels: usize = hemicubes
            .iter()
            .map(|h| compare_items(&gpu.items(h).expect("legal"), &cpu.items(h).expect("legal")))
            .sum();
        let share = pixels as f64 / (hemicubes.len() * 3 * 256 * 256) as f64;
        say(&format!(
            "{name}: {pixels} pixels differ ({share:.1e}), row L1 {:.1e} mean {:.1e}",
            apart.worst, apart.mean
        ));
        let _ = RowBlock::default();
    }
}

#[test]
fn rows_do_not_depend_on_culling_batches_or_the_run() {
    if !is_there("vulkan", &vulkan("")) {
        return;
    }
    for (name, model) in devices::scenes().into_iter().chain(devices::extreme_scenes()) {
        let hemicubes = some(&model, 40);
        for (resolution, covered) in [(64, true), (256, false)] {
            let counters = devices::rows_do_not_depend(
                &vulkan,
                &[
                    "cull=occlusion",
                    "cull=occlusion,batch=1",
                    "cull=occlusion,group=5,batch=10",
                    "cull=frustum,batch=3",
                    "cull=auto",
                    "cull=off",
                ],
                name,
                &model,
                &hemicubes,
                covered,
                resolution,
            );
            say(&format!("{name}, N = {resolution}, covered {covered}: {counters:?}"));
        }
    }
}
