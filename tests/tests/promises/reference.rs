//! The reference on real scenes: its rows close, and a huge emitter's row ends.

use hemicube::InputPatch;
use hemicube::reference::{EstimatedRow, Reference, ReferenceRow, ReferenceSettings, errors_against};
use hemicube_scene::Subdivision;
use hemicube_tests::scenes::{model, read, say, scenes_or_skip};
use std::time::Instant;

fn settings(target: f64) -> ReferenceSettings {
    ReferenceSettings {
        target,
        ..ReferenceSettings::default()
    }
}

fn tell(name: &str, row: &ReferenceRow) {
    say(&format!(
        "{name}, patch {}: {} patches, norm {:.4}, noise {:.1e}, closure {:+.1e} ± {:.1e}, missed {:.1e} ± {:.1e}, escaped {:.4} ± {:.1e}, agreement {:.2} over {}, {} rays",
        row.emitter,
        row.columns.len(),
        row.squared_norm().sqrt(),
        row.noise(),
        row.closure() - 1.0,
        row.closure_noise(),
        row.missed,
        row.error_of_missed,
        row.escaped,
        row.error_of_shares,
        row.agreement,
        row.agreement_count,
        row.rays,
    ));
}

/// Closed, nearly closed and open scenes: Σ F and what is lost are 1 up to what the reference says of itself.
#[test]
fn rows_close() {
    let Some(folder) = scenes_or_skip("rows_close") else {
        return;
    };
    for (file, subdivision, target) in [
        ("../cases/thin-enclosure/cavity.obj", Subdivision::None, 3.3e-4),
        ("cornell/cornell-measured-closed-20q.obj", Subdivision::Levels(2), 1e-3),
        ("cornell/CornellBox-Original.obj", Subdivision::Levels(2), 1e-3),
        ("city/denhaag-8897.obj", Subdivision::None, 3e-3),
    ] {
        let model = model(read(&folder, file).expect("a scene"), subdivision);
        let reference = Reference::new(&model, settings(target)).expect("good settings");
        let count = model.geometry().patch_count;
        let emitters: Vec<InputPatch> = (0..10).map(|k| InputPatch((count / 10) * k + k)).collect();
        let rows = reference.rows(&emitters, 2, &mut |_| {}).expect("patches of the scene");
        for row in &rows {
            tell(file, row);
            let (off, noise) = (row.closure() - 1.0, row.closure_noise());
            assert!(
                off.abs() <= 4.0 * noise + 2e-5,
                "{file}, patch {}: {off:e} ± {noise:e}",
                row.emitter
            );
            assert!(noise <= 2.0 * target, "{file}, patch {}: {noise:e}", row.emitter);
            assert!(row.agreement < 2.0, "{file}, patch {}: {}", row.emitter, row.agreement);
        }
    }
}

/// Two triangles of 889,438 m² under a city, with tens of thousands of small patches in view.
#[test]
#[ignore = "half a minute of processor time and more: ./test --full"]
fn a_huge_emitter_ends() {
    let Some(folder) = scenes_or_skip("a_huge_emitter_ends") else {
        return;
    };
    let model = model(
        read(&folder, "../cases/city/munich.obj").expect("a scene"),
        Subdivision::None,
    );
    let row_of = |patch, settings| {
        let reference = Reference::new(&model, settings).expect("good settings");
        reference.row(InputPatch(patch)).expect("a patch of the scene")
    };
    for patch in [38_934, 38_935] {
        let started = Instant::now();
        let row = row_of(patch, settings(1e-2));
        tell("munich", &row);
        say(&format!("  in {:.1?}", started.elapsed()));
        // The rays end it before the target is reached.
        assert!(row.rays <= settings(1e-2).max_rays);
        assert!((1e-2..0.1).contains(&row.noise()), "{}", row.noise());
        let (off, noise) = (row.closure() - 1.0, row.closure_noise());
        assert!(off.abs() <= 4.0 * noise, "{off:e} ± {noise:e}");
        assert!(row.agreement < 2.0, "{}", row.agreement);
        // Another seed differs by what both say.
        let other = row_of(
            patch,
            ReferenceSettings {
                seed: 2,
                ..settings(1e-2)
            },
        );
        let stated = row.noise().hypot(other.noise());
        let estimated = EstimatedRow {
            emitter: InputPatch(patch),
            columns: other.columns,
            values: other.values,
        };
        let found = errors_against(&[row], &[estimated]).relative_frobenius_with_noise;
        say(&format!("  another seed differs by {found:.1e}; stated {stated:.1e}"));
        assert!((0.4..1.8).contains(&(found / stated)), "{found} stated {stated}");
    }
    // Few rays say that they are few.
    let row = row_of(
        38_934,
        ReferenceSettings {
            max_rays: 140_000,
            ..settings(1e-2)
        },
    );
    tell("munich, few rays", &row);
    assert!(row.noise() > 0.1, "{}", row.noise());
}
