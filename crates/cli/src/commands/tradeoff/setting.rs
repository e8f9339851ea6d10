//! Settings to try: tolerances, and sums of pixels with their resolutions and hemicubes.

use super::plot::Family;
use crate::args::Tolerance;
use crate::level::{percentage, within};
use anyhow::Result;
use hemicube::Model;
use hemicube::accuracy::correct::Correction;
use hemicube::backend::HemicubeBackend;
use hemicube::driver::compute::Selection;
use std::sync::atomic::AtomicBool;

/// Settings tried: the tolerances, and the resolutions and hemicubes a patch (n of n²) of sums of pixels.
const TOLERANCES: [f64; 6] = [5e-2, 2e-2, 1e-2, 5e-3, 3e-3, 1e-3];
const SAMPLES: [u32; 3] = [1, 2, 4];
const RESOLUTIONS_OF_PIXEL: [u32; 4] = [64, 128, 256, 512];
/// Pixels along an edge with a tolerance, as in `compute`.
pub(super) const RESOLUTION_OF_TOLERANCE: u32 = 128;

/// Nominal milliseconds, to rule out absurd settings: a triangle, a pixel, and an entry at a tolerance of 1 %.
const COST_OF_TRIANGLE: f64 = 1e-4;
const COST_OF_PIXEL: f64 = 8e-7;
const COST_OF_TOLERANCE: f64 = 1e-3;

/// A setting to try.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Setting {
    pub(super) rung: Rung,
    pub(super) resolution: u32,
    pub(super) samples_per_edge: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rung {
    Pixel,
    Tolerance(f64),
}

impl Setting {
    /// Determines correction and resolution; a tolerance calibrates its own, like `compute`.
    pub(super) fn settle(
        self,
        model: &Model,
        backend: &mut dyn HemicubeBackend,
        threads: usize,
        cancel: &AtomicBool,
    ) -> Result<(Correction, u32)> {
        match self.rung {
            Rung::Pixel => Ok((Correction::Pixel, self.resolution)),
            Rung::Tolerance(tolerance) => {
                let settled = within(
                    model,
                    &Selection::default(),
                    true,
                    Tolerance(tolerance),
                    backend,
                    threads,
                    cancel,
                )?;
                Ok((Correction::Tolerance(settled.refinement), settled.resolution))
            }
        }
    }

    pub(super) fn family(self) -> Family {
        match self.rung {
            Rung::Pixel => Family::Pixel,
            Rung::Tolerance(_) => Family::Tolerance,
        }
    }

    pub(super) fn name(self) -> String {
        match self.rung {
            Rung::Pixel => format!(
                "pixel K={} N={}",
                self.samples_per_edge * self.samples_per_edge,
                self.resolution
            ),
            Rung::Tolerance(tolerance) => format!("tolerance {}", percentage(tolerance)),
        }
    }

    /// Options of `compute` for this setting.
    pub(super) fn words(self) -> String {
        match self.rung {
            Rung::Pixel => format!(
                "--correction pixel --samples {} --resolution {}",
                self.samples_per_edge * self.samples_per_edge,
                self.resolution
            ),
            Rung::Tolerance(tolerance) => format!("--tolerance {}", percentage(tolerance)),
        }
    }

    /// Nominal milliseconds of a row with this many triangles transformed and patches seen by a hemicube.
    pub(super) fn nominal(self, triangles: f64, seen: f64) -> f64 {
        let pixels = 3.0 * f64::from(self.resolution) * f64::from(self.resolution);
        let hemicube = COST_OF_TRIANGLE * triangles + COST_OF_PIXEL * pixels;
        let samples = f64::from(self.samples_per_edge * self.samples_per_edge);
        match self.rung {
            Rung::Pixel => samples * hemicube,
            Rung::Tolerance(tolerance) => hemicube + COST_OF_TOLERANCE * seen * (1e-2 / tolerance),
        }
    }
}

/// All settings to try, with the given tolerance.
pub(super) fn settings(asked: Tolerance) -> Vec<Setting> {
    let mut settings: Vec<Setting> = Vec::new();
    for samples_per_edge in SAMPLES {
        settings.extend(RESOLUTIONS_OF_PIXEL.map(|resolution| Setting {
            rung: Rung::Pixel,
            resolution,
            samples_per_edge,
        }));
    }
    let mut tolerances = TOLERANCES.to_vec();
    if !tolerances.iter().any(|&tolerance| is_same(tolerance, asked.0)) {
        tolerances.push(asked.0);
    }
    settings.extend(tolerances.into_iter().map(|tolerance| Setting {
        rung: Rung::Tolerance(tolerance),
        resolution: RESOLUTION_OF_TOLERANCE,
        samples_per_edge: 1,
    }));
    settings
}

/// Returns whether two tolerances are one but for rounding.
pub(super) fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.max(b)
}
