//! Bounds on the scene that a file becomes: one rule for all readers.
//!
//! Copies (nodes of glTF, templates of CityJSON, pieces around the holes of View3D) let kilobytes stand for gigabytes,
//! and a polygon takes time by the square of its corners. Both are bounded by the size of the files that are read:
//!
//! - triangles: at most one a byte, and always [`TRIANGLES`], because without copies a triangle takes two bytes and
//!   more
//! - corners of a polygon: at most [`CORNERS_MAX`], [`HOLED_CORNERS_MAX`] with holes, because cutting takes time by n²,
//!   and n³ where holes cross
//! - steps of cutting: at most [`STEPS_A_BYTE`] a byte, and always [`STEPS`], because polygons of up to 2,000 corners
//!   never reach it
//! - bytes that copies take before their triangles are counted: at most [`COPIED_A_BYTE`] a byte, and always [`COPIED`]:
//!   arrays that several pieces share, nodes of instances, a name once for each instance
//! - steps over copies that may have nothing: [`STEPS_A_COPY`] of the steps of cutting each
//! - bytes from compressed ones: at most [`INFLATED_A_BYTE`] a byte, and always [`INFLATED`]
//!
//! [`ReadOptions::allow_large`](crate::ReadOptions::allow_large) lifts all but [`CORNERS_MAX`]. Triangles and bytes are
//! held against the memory, too ([`Budget`](crate::Budget)): `room` is what was left when the file had been read.

use crate::{Error, ErrorKind, ReadOptions};

/// Triangles allowed to any file.
#[cfg(any(
    feature = "gltf",
    feature = "vs3",
    feature = "cityjson",
    feature = "abaqus",
    feature = "_buildings"
))]
const TRIANGLES: u64 = 1_000_000;
/// Bytes of a triangle, in a list that doubles when it is full.
#[cfg(any(
    feature = "gltf",
    feature = "vs3",
    feature = "cityjson",
    feature = "abaqus",
    feature = "_buildings"
))]
const TRIANGLE: u64 = 2 * size_of::<crate::Triangle>() as u64;
/// Bytes of copies allowed to any file.
#[cfg(any(feature = "abaqus", feature = "vtk"))]
const COPIED: u64 = 1 << 28;
/// Likewise for each byte: what a triangle takes, of which there may be one a byte.
#[cfg(any(feature = "abaqus", feature = "vtk"))]
const COPIED_A_BYTE: u64 = 128;
/// Steps of cutting, some 30 ns each, that go by while a copy is looked up.
#[cfg(any(feature = "abaqus", feature = "cityjson"))]
pub(crate) const STEPS_A_COPY: u64 = 16;
/// Bytes from compressed ones allowed to any file.
#[cfg(feature = "vtk")]
const INFLATED: u64 = 1 << 20;
/// Likewise for each byte.
#[cfg(feature = "vtk")]
const INFLATED_A_BYTE: u64 = 10;
/// Corners of a polygon, whatever is allowed: simple ones take seconds.
#[cfg(feature = "_polygons")]
const CORNERS_MAX: usize = 1 << 16;
/// Corners of a polygon with holes: from here on, crossing holes take minutes.
#[cfg(any(feature = "cityjson", feature = "_buildings"))]
const HOLED_CORNERS_MAX: usize = 1 << 14;
/// Steps of cutting allowed to any file: half a minute at most.
#[cfg(any(feature = "_polygons", feature = "vs3"))]
const STEPS: u64 = 1 << 30;
/// Steps of cutting for each byte.
#[cfg(any(feature = "_polygons", feature = "vs3"))]
const STEPS_A_BYTE: u64 = 1 << 10;
/// Corners of a simple polygon per step, squared; with holes it is one.
#[cfg(feature = "_polygons")]
const CORNERS_A_STEP: u64 = 8;

/// Remainder of a file's bounds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bounds {
    bytes: u64,
    allow_large: bool,
    /// Bytes of memory that are left.
    room: u64,
    #[cfg(any(feature = "abaqus", feature = "vtk"))]
    copied: u64,
    #[cfg(any(feature = "_polygons", feature = "vs3"))]
    steps: u64,
}

impl Bounds {
    /// The bounds of a file of `bytes`.
    pub(crate) fn new(bytes: usize, options: ReadOptions) -> Self {
        Self {
            bytes: bytes as u64,
            allow_large: options.allow_large,
            room: options.budget.left().unwrap_or(u64::MAX),
            #[cfg(any(feature = "abaqus", feature = "vtk"))]
            copied: 0,
            #[cfg(any(feature = "_polygons", feature = "vs3"))]
            steps: 0,
        }
    }

    /// Refuses more triangles than a file of this size, with `others` bytes beside it, may become.
    #[cfg(any(
        feature = "gltf",
        feature = "vs3",
        feature = "cityjson",
        feature = "abaqus",
        feature = "_buildings"
    ))]
    pub(crate) fn triangles(&self, count: u64, others: u64) -> Result<(), Error> {
        let bytes = self.bytes.saturating_add(others);
        let most = TRIANGLES.max(bytes);
        self.fits(count.saturating_mul(TRIANGLE), "triangles by copies")?;
        if self.allow_large || count <= most {
            return Ok(());
        }
        Err(over_limit(format!(
            "becomes {count} triangles or more by copies, and a file of {bytes} bytes may become {most}; place fewer \
             copies"
        )))
    }

    /// Counts bytes that are held once more, and refuses too many in all, before they are taken.
    #[cfg(any(feature = "abaqus", feature = "vtk"))]
    pub(crate) fn copied(&mut self, bytes: u64) -> Result<(), Error> {
        self.copied = self.copied.saturating_add(bytes);
        let most = COPIED.max(COPIED_A_BYTE.saturating_mul(self.bytes));
        self.fits(self.copied, "copies")?;
        if self.allow_large || self.copied <= most {
            return Ok(());
        }
        Err(over_limit(format!(
            "becomes more than {most} bytes by copies, the most for a file of {} bytes; place fewer copies",
            self.bytes
        )))
    }

    /// Refuses more bytes from compressed ones than ten times the file's.
    #[cfg(feature = "vtk")]
    pub(crate) fn inflated(&self, bytes: u64) -> Result<(), Error> {
        let most = INFLATED.max(INFLATED_A_BYTE.saturating_mul(self.bytes));
        self.fits(bytes, "what is compressed")?;
        if self.allow_large || bytes <= most {
            return Ok(());
        }
        Err(over_limit(format!(
            "has compressed arrays of {bytes} bytes or more, and a file of {} bytes may hold {most}; save it \
             uncompressed",
            self.bytes
        )))
    }

    /// Refuses what the memory has no room for.
    #[cfg(any(
        feature = "gltf",
        feature = "vs3",
        feature = "cityjson",
        feature = "abaqus",
        feature = "vtk",
        feature = "_buildings"
    ))]
    fn fits(&self, bytes: u64, what: &str) -> Result<(), Error> {
        if bytes <= self.room {
            return Ok(());
        }
        Err(too_large(format!(
            "{what} would take {} MB or more, and {} MB of memory are left; place fewer copies, or allow more",
            bytes / 1_000_000,
            self.room / 1_000_000
        )))
    }

    /// Refuses a simple polygon with too many corners, alone or with the polygons before it.
    #[cfg(feature = "_polygons")]
    pub(crate) fn polygon(&mut self, corners: usize) -> Result<(), Error> {
        if corners > CORNERS_MAX {
            return Err(too_large(format!(
                "a face has {corners} corners; at most {CORNERS_MAX} are cut into triangles, so split it first"
            )));
        }
        self.steps((corners as u64).pow(2) / CORNERS_A_STEP)
    }

    /// Likewise for a polygon with holes, whose corners count, too.
    #[cfg(any(feature = "cityjson", feature = "_buildings"))]
    pub(crate) fn polygon_with_holes(&mut self, corners: usize, holes: usize) -> Result<(), Error> {
        if holes == 0 {
            return self.polygon(corners);
        }
        self.polygon(corners)?;
        if corners > HOLED_CORNERS_MAX && !self.allow_large {
            return Err(over_limit(format!(
                "a face with holes has {corners} corners; at most {HOLED_CORNERS_MAX} are cut into triangles \
                 unless that is allowed, so split it first"
            )));
        }
        self.steps((corners as u64).pow(2))
    }

    /// Counts steps of cutting.
    #[cfg(any(feature = "_polygons", feature = "vs3"))]
    pub(crate) fn steps(&mut self, steps: u64) -> Result<(), Error> {
        self.steps = self.steps.saturating_add(steps);
        if self.allow_large || self.steps <= STEPS.max(STEPS_A_BYTE.saturating_mul(self.bytes)) {
            return Ok(());
        }
        Err(over_limit(
            "polygons of very many corners, or copies of very many surfaces, would take too long; split them first"
                .to_owned(),
        ))
    }
}

fn too_large(message: String) -> Error {
    Error::new(ErrorKind::TooLarge(message))
}

fn over_limit(message: String) -> Error {
    Error::new(ErrorKind::OverLimit(message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_and_are_lifted() {
        let large = ReadOptions {
            allow_large: true,
            ..ReadOptions::default()
        };
        let of = |bytes, options| Bounds::new(bytes, options);
        let default = ReadOptions::default();
        #[cfg(feature = "gltf")]
        {
            assert!(of(10, default).triangles(TRIANGLES, 0).is_ok());
            assert!(of(10, default).triangles(TRIANGLES + 1, 0).is_err());
            assert!(of(10, default).triangles(TRIANGLES + 1, TRIANGLES).is_ok());
            assert!(of(10, large).triangles(TRIANGLES + 1, 0).is_ok());
            // No option makes memory.
            let refused = of(10, large)
                .triangles(u64::MAX, 0)
                .expect_err("more than any machine has");
            assert!(!matches!(refused.kind, ErrorKind::OverLimit(_)), "{refused}");
        }
        assert!(of(10, default).polygon(CORNERS_MAX).is_ok());
        assert!(of(10, large).polygon(CORNERS_MAX + 1).is_err());
        let mut some = of(10, default);
        let fit = (0..10).filter(|_| some.polygon(CORNERS_MAX).is_ok()).count();
        assert_eq!(fit, 2, "of 2³² / 8 steps each");
        #[cfg(feature = "cityjson")]
        {
            assert!(of(10, default).polygon_with_holes(HOLED_CORNERS_MAX, 9).is_ok());
            assert!(of(10, default).polygon_with_holes(HOLED_CORNERS_MAX + 1, 9).is_err());
            assert!(of(10, large).polygon_with_holes(HOLED_CORNERS_MAX + 1, 9).is_ok());
        }
    }

    #[test]
    fn polygons_of_two_thousand_corners_never_reach_it() {
        // The most corners of a file of 100 MB, at two bytes a corner.
        let bytes = 100_000_000;
        let mut bounds = Bounds::new(bytes, ReadOptions::default());
        for _ in 0..bytes / 4_000 {
            bounds.steps(2_000 * 2_000).expect("no more than 1024 a byte");
        }
    }
}
