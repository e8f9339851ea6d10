//! How soon the model of a page that `hemicube report` wrote is shown, and how smoothly it turns.
//!
//! `page_speed PAGE...`: each page is opened from the disk in Chromium without a window, whose renderer is software,
//! and its model turned for three seconds: with all pixels, and as it is for who drags it
//! (`crates/cli/viewer/src/scene.js`: fewer where pictures come late). Needs Chromium with its driver.
#![allow(clippy::print_stdout, reason = "an example prints")]

use hemicube_tests::browser::Browser;
use std::path::Path;
use std::time::Instant;

/// Turns the model round its vertical axis, a step a picture, and gives the times between pictures in milliseconds and
/// the width of the last, in pixels.
const TURN: &str = "
    const { model } = hemicube, { camera, controls } = model;
    const times = [];
    const started = performance.now();
    let last = started;
    model.turning = true;
    while (last - started < 3000) {
        camera.position.sub(controls.target).applyAxisAngle(camera.up, 0.03).add(controls.target);
        controls.update();
        model.draw();
        const before = model.frames;
        while (model.frames === before) await new Promise(requestAnimationFrame);
        const now = performance.now();
        times.push(now - last);
        last = now;
    }
    const width = model.canvas.width;
    model.turning = false;
    model.draw();
    return [width, ...times];";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pages: Vec<String> = std::env::args().skip(1).collect();
    if pages.is_empty() {
        return Err("no page: page_speed PAGE...".into());
    }
    println!("| page | MB | shown after, s | turned with | pixels wide | ms a picture, median | slowest of 20 |");
    println!("|---|---|---|---|---|---|---|");
    for page in &pages {
        let bytes = std::fs::metadata(page)?.len();
        let Some(browser) = Browser::start("page_speed", 1280, 1000) else {
            return Err("no Chromium with its driver".into());
        };
        let started = Instant::now();
        browser.open(Path::new(page));
        browser.wait("document.documentElement.dataset.ready && hemicube.model.frames");
        let shown = started.elapsed().as_secs_f64();
        browser.script("window.patience = hemicube.model.patience");
        for (with, patience) in [("all pixels", "Infinity"), ("as dragged", "window.patience")] {
            let turned = browser.script(&format!("hemicube.model.patience = {patience}; {TURN}"));
            let numbers: Vec<f64> = turned
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(serde_json::Value::as_f64)
                .collect();
            let [width, times @ ..] = numbers.as_slice() else {
                return Err(format!("{page}: not turned: {turned}").into());
            };
            let mut times = times.to_vec();
            times.sort_by(f64::total_cmp);
            println!(
                "| {page} | {:.1} | {shown:.1} | {with} | {width} | {:.0} | {:.0} |",
                bytes as f64 / 1e6,
                times[times.len() / 2],
                times[times.len() * 19 / 20],
            );
        }
    }
    Ok(())
}
