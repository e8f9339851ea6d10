//! Measures the constants of the error model anew, and prints them beside the committed ones.
//!
//! `fit_error_model [ROWS]`: over a block city and a real tile, each uncut and cut, pairs of a sixteenth of ROWS (default:
//! 200) patches. `scripts/fit-error-model` runs it. Times are of this machine.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube::Model;
use hemicube::accuracy::fit::{Fitted, RayMeasurements};
use hemicube_scene::Subdivision;
use hemicube_scene::generate::BlockCityParameters;
use hemicube_tests::scenes::{model, read, scenes_or_skip};

const TILE: &str = "city/denhaag-8897.obj";
fn block_city(split: u32) -> Model {
    let parameters = BlockCityParameters {
        blocks: 25,
        split,
        ..BlockCityParameters::for_target(1000, 1)
    };
    model(parameters.generate().expect("a city"), Subdivision::None)
}

fn tile(subdivision: Subdivision) -> Option<Model> {
    let folder = scenes_or_skip(TILE)?;
    let scene = read(&folder, TILE).unwrap_or_else(|error| panic!("{TILE}: {error}"));
    Some(model(scene, subdivision))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rows: usize = std::env::args().nth(1).map_or(Ok(200), |rows| rows.parse())?;
    let scenes = [
        Some(block_city(1)),
        Some(block_city(4)),
        tile(Subdivision::None),
        tile(Subdivision::Levels(2)),
    ];
    let mut rays = RayMeasurements::default();
    for model in scenes.iter().flatten() {
        rays.add(model, model.patches().len() / (rows / 16).max(1) + 1);
    }
    println!("| constant | committed | measured | measured ÷ committed | pairs |");
    println!("|---|---|---|---|---|");
    for fitted in rays.fitted() {
        let Fitted {
            name,
            committed,
            measured,
            pairs,
        } = fitted;
        if pairs == 0.0 {
            println!("| {name} | {committed:.5} | – | – | 0 |");
        } else {
            println!(
                "| {name} | {committed:.5} | {measured:.5} | {:.2} | {pairs} |",
                measured / committed
            );
        }
    }
    Ok(())
}
