//! Memory of a scene's patches, asked for before one is made.
//!
//! ```text
//! bytes = patches · of a patch, until the first row
//! ```
//!
//! beyond the scene as it was read. Pieces of one plane cost most: those of a closed room, 202 MB for 144,000 to a
//! tolerance, 556 MB by object (`generate room --patches 360`, `compute room.obj --split 20 --rows 0..16 --json`:
//! `peak_memory_bytes`). Whole triangles of a city, a soup and a room took 0.5 to 1.1 kB by pixels and 0.9 to 1.3 kB to a
//! tolerance (`generate city --patches 200000`, likewise). They are taken at more than was measured, an upper bound.

use hemicube_scene::{Budget, NoRoom, Patches, Scene, Subdivision};

/// Kinds of work, by the memory that a patch takes until the first row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Work {
    /// Sums of pixels.
    Pixels,
    /// Visible fractions times closed forms, to a tolerance.
    Fractions,
    /// The same of patches of several triangles: a sample's rows are kept until they are added up.
    Grouped,
}

impl Work {
    /// Bytes of a patch: the most.
    fn patch(self) -> u64 {
        match self {
            Self::Pixels => 1_100,
            Self::Fractions => 1_600,
            Self::Grouped => 3_800,
        }
    }
}

/// More patches than there is memory for.
///
/// ```
/// use hemicube::driver::room::{TooManyPatches, Work, require};
/// use hemicube_scene::{Budget, Subdivision, generate};
///
/// let (room, budget) = (generate::cornell_box(), Budget::new(Some(2_000_000_000)));
/// let refused = require(&room, Subdivision::PatchSize(0.5), Work::Fractions, budget);
/// let TooManyPatches { patch_count, finest, .. } = refused.expect_err("60 GB");
/// assert!(patch_count > 39_000_000);
/// let finest = finest.expect("a length");
/// assert!(require(&room, finest, Work::Fractions, budget).is_ok());
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{room}")]
pub struct TooManyPatches {
    /// Patches that the scene would be cut into.
    pub patch_count: u64,
    /// What they take at most, and what is left.
    pub room: NoRoom,
    /// The finest subdivision of the same kind that fits, if any.
    pub finest: Option<Subdivision>,
}

/// Bytes of a scene's patches until the first row of a matrix, by their number alone: at most.
pub fn bytes(scene: &Scene, cut: Subdivision, work: Work) -> u64 {
    Patches::count(scene, cut).saturating_mul(work.patch())
}

/// Refuses to cut a scene into more patches than the memory has room for. Takes no memory itself.
///
/// # Errors
/// [`TooManyPatches`], with the finest subdivision that fits.
pub fn require(scene: &Scene, cut: Subdivision, work: Work, budget: Budget) -> Result<(), TooManyPatches> {
    let patch_count = Patches::count(scene, cut);
    let wanted = bytes(scene, cut, work);
    let Err(room) = budget.require(wanted, format!("{patch_count} patches")) else {
        return Ok(());
    };
    let finest = finest(cut, |cut| bytes(scene, cut, work) <= room.left);
    Err(TooManyPatches {
        patch_count,
        room,
        finest,
    })
}

/// The finest subdivision of a kind that fits, coarser than `cut`.
fn finest(cut: Subdivision, fits: impl Fn(Subdivision) -> bool) -> Option<Subdivision> {
    match cut {
        Subdivision::None => None,
        Subdivision::Levels(levels) => (0..levels).rev().map(Subdivision::Levels).find(|&cut| fits(cut)),
        Subdivision::Split(pieces) => {
            // The first that does not fit.
            let (mut low, mut high) = (1, pieces);
            while low < high {
                let middle = low + (high - low) / 2;
                if fits(Subdivision::Split(middle)) {
                    low = middle + 1;
                } else {
                    high = middle;
                }
            }
            (low > 1).then(|| Subdivision::Split(low - 1))
        }
        Subdivision::PatchSize(length) => {
            // In steps of a tenth, as fine as lengths are chosen.
            std::iter::successors(Some(length), |length| Some(1.1 * length))
                .take(2000)
                .map(|length| Subdivision::PatchSize(round_up(length)))
                .find(|&cut| fits(cut))
        }
    }
}

/// The next length of two digits.
fn round_up(length: f64) -> f64 {
    let unit = 10f64.powf(length.log10().floor() - 1.0);
    let rounded = (length / unit).ceil() * unit;
    // Without the last digits of the unit.
    format!("{rounded:.2e}").parse().unwrap_or(length).max(length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::generate::cornell_box;

    #[test]
    fn what_is_named_fits_and_the_next_finer_does_not() {
        let scene = cornell_box();
        for work in [Work::Pixels, Work::Fractions, Work::Grouped] {
            let most = 100_000_000;
            let fits = |cut| bytes(&scene, cut, work) <= most;
            let finest = |cut| finest(cut, fits);
            let Some(Subdivision::Levels(levels)) = finest(Subdivision::Levels(31)) else {
                panic!("levels")
            };
            assert!(fits(Subdivision::Levels(levels)) && !fits(Subdivision::Levels(levels + 1)));
            let Some(Subdivision::Split(pieces)) = finest(Subdivision::Split(65_536)) else {
                panic!("pieces")
            };
            assert!(fits(Subdivision::Split(pieces)) && !fits(Subdivision::Split(pieces + 1)));
            let Some(Subdivision::PatchSize(length)) = finest(Subdivision::PatchSize(1e-3)) else {
                panic!("a length")
            };
            assert!(fits(Subdivision::PatchSize(length)) && !fits(Subdivision::PatchSize(length / 1.2)));
        }
        let refused = require(&scene, Subdivision::None, Work::Pixels, Budget::new(Some(1)));
        assert_eq!(refused.map_err(|error| error.finest), Err(None));
    }
}
