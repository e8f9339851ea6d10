//! A pass in the device's words: what is seen through a portal, in its open pixels.
//!
//! Depths are preset: closed pixels are as near as the near plane, so that nothing is drawn there. [`stage::THROUGH`]
//! and [`stage::IDENTIFY_THROUGH`] cut away what lies before the portal's plane. Chunks outside a face or before the
//! plane, and faces without open pixels, are left out, and nothing is drawn outside the rectangle of a face's open
//! pixels. None of that changes what an open pixel shows.
//!
//! Nothing is left out for being hidden, and pixels near edges are the driver's: the settle stage knows no planes.
//!
//! [`stage::THROUGH`]: crate::stage::THROUGH
//! [`stage::IDENTIFY_THROUGH`]: crate::stage::IDENTIFY_THROUGH

use crate::Chunk;
use crate::upload::Upload;
use glam::DVec3;
use hemicube_contract::backend::Pass;
use hemicube_contract::face::{Face, pixel_count};
use std::ops::Range;

/// Distance outside a face up to which a chunk is drawn: shaders put points near a plane into it. Normalised.
const SLACK: f64 = 1e-5;

/// What is to be drawn on a face.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaceDraw {
    /// The face.
    pub face: Face,
    /// The first column and row of the atlas of its open pixels' rectangle.
    pub low: [u32; 2],
    /// Columns and rows of that rectangle.
    pub size: [u32; 2],
    /// Runs of [`Upload::indices`], ascending.
    pub runs: Vec<Range<u32>>,
}

/// The first depths of a pass, by the pixels of the atlas: nearest in closed ones, infinitely far in open ones.
pub fn first_depths(pass: &Pass<'_>, resolution: u32) -> Vec<f32> {
    let pixels = 0..pixel_count(resolution);
    pixels
        .map(|pixel| if pass.is_open(pixel) { 0.0 } else { 1.0 })
        .collect()
}

/// The draws of a pass, of the faces that have any.
pub fn draws(upload: &Upload, pass: &Pass<'_>, resolution: u32) -> Vec<FaceDraw> {
    let of_face = |face: Face| {
        let [low, high] = opening(pass, face, resolution)?;
        let sides = Sides::new(pass, face);
        let mut runs: Vec<Range<u32>> = Vec::new();
        for chunk in upload.chunks.iter().filter(|chunk| !sides.miss(chunk)) {
            let end = chunk.first_index + chunk.index_count;
            match runs.last_mut() {
                Some(last) if last.end == chunk.first_index => last.end = end,
                _ => runs.push(chunk.first_index..end),
            }
        }
        (!runs.is_empty()).then(|| FaceDraw {
            face,
            low: [low[0], low[1] + face.first_row(resolution)],
            size: [high[0] - low[0], high[1] - low[1]],
            runs,
        })
    };
    Face::ALL.into_iter().filter_map(of_face).collect()
}

/// The rectangle of a face's open pixels: the first column and row, and one past the last. None if all are closed.
fn opening(pass: &Pass<'_>, face: Face, resolution: u32) -> Option<[[u32; 2]; 2]> {
    let mut found: Option<[[u32; 2]; 2]> = None;
    for y in 0..face.rows(resolution) {
        for x in 0..resolution {
            if pass.is_open(((face.first_row(resolution) + y) * resolution + x) as usize) {
                let [low, high] = found.unwrap_or([[x, y], [x + 1, y + 1]]);
                found = Some([[low[0].min(x), low[1].min(y)], [high[0].max(x + 1), high[1].max(y + 1)]]);
            }
        }
    }
    found
}

/// The half spaces that a face looks into beyond the portal: normal · p ≥ offset.
struct Sides([(DVec3, f64); 5]);

impl Sides {
    fn new(pass: &Pass<'_>, face: Face) -> Self {
        let (places, signs) = face.axes();
        let [u, v, w]: [DVec3; 3] = std::array::from_fn(|k| pass.axes[places[k]] * signs[k]);
        let below = if face.is_top() { w + v } else { v };
        let of_eye = [w + u, w - u, w - v, below].map(|normal| (normal, normal.dot(pass.origin)));
        let [a, b, c, d] = of_eye;
        Self([a, b, c, d, (pass.normal, pass.offset)])
    }

    /// Whether a chunk is outside, more than by what is rounded.
    fn miss(&self, chunk: &Chunk) -> bool {
        self.0.iter().any(|&(normal, offset)| {
            let reach = normal.abs().dot(chunk.half_sides);
            normal.dot(chunk.center) - offset + reach < -SLACK
        })
    }
}
