//! Hemicubes in a window, during their computation.

use crate::args::{EngineSettings, Talk};
use crate::exit::Exit;
use crate::prepare::Prepared;
use anyhow::Result;

/// A run in a window.
#[derive(Clone, Copy)]
#[cfg_attr(not(feature = "live"), allow(dead_code, reason = "read by the window only"))]
pub(super) struct Live<'a> {
    pub(super) resolution: u32,
    /// The first patch; otherwise the order of work begins.
    pub(super) first: Option<u32>,
    pub(super) engine: &'a EngineSettings,
}

/// Without windows there is nothing to show them in.
#[cfg(not(feature = "live"))]
pub(super) fn run(_: Live<'_>, _: &Prepared, _: Talk) -> Result<Exit> {
    Err(crate::exit::hinted(
        anyhow::anyhow!("this hemicube was built without windows"),
        "build it with the feature `live`, or write a picture: `--patch I -o FILE`",
    ))
}

#[cfg(feature = "live")]
pub(super) fn run(live: Live<'_>, prepared: &Prepared, talk: Talk) -> Result<Exit> {
    window::run(live, prepared, talk)
}

#[cfg(feature = "live")]
mod window {
    use super::{Exit, Live, Prepared, Result, Talk};
    use crate::commands::view::unfolded::{atlas_place, color_of};
    use crate::exit::{self, hinted};
    use crate::picture::canvas::{Color, WHITE};
    use crate::report::{count, counted, percent};
    use anyhow::{Context, anyhow};
    use hemicube::InputPatch;
    use hemicube::backend::{Culling, RenderSettings};
    use hemicube::delta::DeltaTable;
    use minifb::{Error, Key, KeyRepeat, Window, WindowOptions};
    use std::sync::atomic::Ordering;
    use std::time::Duration;

    /// Hemicubes a second at most: more than this nobody sees.
    const RATE: usize = 30;
    /// Pixels along an edge of the window, about.
    const SIDE: usize = 640;
    const PAUSE: Duration = Duration::from_millis(30);

    fn word([r, g, b]: Color) -> u32 {
        u32::from_be_bytes([0, r, g, b])
    }

    fn open(side: usize) -> Result<Window> {
        let reason = match Window::new("hemicube", side, side, WindowOptions::default()) {
            Ok(window) => return Ok(window),
            Err(Error::WindowCreate(reason)) => reason,
            Err(error) => error.to_string(),
        };
        Err(hinted(
            anyhow!("no window can be opened: {reason}"),
            "`--live` needs a display (on Linux an X server, by DISPLAY, and libX11); `--patch I -o FILE` writes a \
             picture",
        ))
    }

    pub(super) fn run(live: Live<'_>, prepared: &Prepared, talk: Talk) -> Result<Exit> {
        let resolution = live.resolution;
        let n = resolution as usize;
        let side = 2 * n * SIDE.div_ceil(2 * n).max(1);
        let enlarge = side / (2 * n);
        // Opened first: without one, nothing is worth computing.
        let mut window = open(side)?;
        window.set_target_fps(RATE);
        let cancel = exit::watch_interrupts().context("Ctrl-C cannot be watched")?;
        let mut backend = live.engine.open_backend(talk)?;
        backend.load(
            prepared.model.geometry(),
            RenderSettings {
                resolution,
                culling: Culling::On,
                covered: false,
            },
        )?;
        let table = DeltaTable::new(resolution);
        // Place in the atlas of each pixel of the window.
        let places: Vec<Option<usize>> = (0..side * side)
            .map(|pixel| {
                let place = atlas_place(pixel % side / enlarge, pixel / side / enlarge, resolution);
                place.map(|(face, x, y)| (face.first_row(resolution) + y) as usize * n + x as usize)
            })
            .collect();
        let mut order: Vec<InputPatch> = prepared.model.order().collect();
        if let Some(first) = live.first {
            let place = order.iter().position(|patch| patch.0 == first).unwrap_or(0);
            order.rotate_left(place);
        }
        let mut pixels = vec![word(WHITE); side * side];
        let mut shown = 0u64;
        for &patch in &order {
            // Without an area there is no hemicube.
            let hemicubes = prepared.model.hemicubes(patch, 1, false);
            let Some(hemicube) = hemicubes.first() else { continue };
            let items = backend.items(hemicube)?;
            for (pixel, place) in pixels.iter_mut().zip(&places) {
                *pixel = word(place.map_or(WHITE, |place| color_of(items.seen[place])));
            }
            shown += 1;
            let (visible, escaped, _) = items.reduce(&table);
            window.set_title(&format!(
                "hemicube: patch {}, {} of {}; {} in sight, {} escapes",
                patch.0,
                count(shown),
                count(order.len() as u64),
                counted(visible.len() as u64, "patch"),
                percent(f64::from(escaped) / f64::from(hemicube::backend::WHOLE)),
            ));
            window
                .update_with_buffer(&pixels, side, side)
                .map_err(|error| anyhow!("{error}"))?;
            let mut paused = false;
            loop {
                if cancel.load(Ordering::SeqCst) {
                    return Ok(Exit::Interrupted);
                }
                if !window.is_open() || window.is_key_down(Key::Escape) {
                    return Ok(said(talk, shown));
                }
                if window.is_key_pressed(Key::Space, KeyRepeat::No) {
                    paused = !paused;
                }
                if !paused {
                    break;
                }
                std::thread::sleep(PAUSE);
                window.update();
            }
        }
        // The last stays in view.
        while window.is_open() && !window.is_key_down(Key::Escape) {
            if cancel.load(Ordering::SeqCst) {
                return Ok(Exit::Interrupted);
            }
            std::thread::sleep(PAUSE);
            window.update();
        }
        Ok(said(talk, shown))
    }

    fn said(talk: Talk, shown: u64) -> Exit {
        talk.say(&format!("{} shown", counted(shown, "hemicube")));
        Exit::Done
    }
}
