//! Memory of a scene's patches, known before one is made.
//!
//! ```text
//! bytes = base + (patches − triangles' patches) · of a piece + triangles' patches · of a whole one
//! ```
//!
//! Pieces of one plane cost most: those of a closed room, 202 MB for 144,000 to a tolerance, 556 MB by object (`generate
//! room --patches 360`, `compute room.obj --split 20 --rows 0..16 --json`: `peak_memory_bytes`). They are taken at more
//! than was measured there, an upper bound. Uncut triangles, in memory as they are read, are taken at 330 bytes, the least
//! that was measured, so that no scene is refused that could fit.

use hemicube_scene::{Patches, Scene, Subdivision};

/// Bytes of a program without a scene.
const BASE: u64 = 20_000_000;
/// Bytes of a triangle that is not cut: the least.
const WHOLE: u64 = 330;

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
    /// Bytes of a piece: the most.
    fn piece(self) -> u64 {
        match self {
            Self::Pixels => 1_050,
            Self::Fractions => 1_600,
            Self::Grouped => 3_800,
        }
    }
}

/// More patches than there is memory for.
///
/// ```
/// use hemicube::driver::room::{NoRoom, Work, require};
/// use hemicube_scene::{Subdivision, generate};
///
/// let room = generate::cornell_box();
/// let refused = require(&room, Subdivision::PatchSize(0.5), Work::Fractions, 200_000_000);
/// let NoRoom { patch_count, finest, .. } = refused.expect_err("60 GB");
/// assert!(patch_count > 39_000_000);
/// let finest = finest.expect("a length");
/// assert!(require(&room, finest, Work::Fractions, 200_000_000).is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "{patch_count} patches would take {} of memory, and there are {}",
    megabytes(*bytes),
    megabytes(*limit)
)]
pub struct NoRoom {
    /// Patches that the scene would be cut into.
    pub patch_count: u64,
    /// Bytes that they take: at most, or at least if `is_least`.
    pub bytes: u64,
    /// True if no triangle is cut.
    pub is_least: bool,
    /// Bytes that they may take.
    pub limit: u64,
    /// The finest subdivision of the same kind that fits, if any.
    pub finest: Option<Subdivision>,
}

fn megabytes(bytes: u64) -> String {
    format!("{:.0} MB", bytes as f64 / 1e6)
}

/// Bytes of a scene's patches until the first row of a matrix, by their number alone.
pub fn bytes(scene: &Scene, cut: Subdivision, work: Work) -> u64 {
    let count = Patches::count(scene, cut);
    let whole = Patches::count(scene, Subdivision::None).min(count);
    let pieces = (count - whole).saturating_mul(work.piece());
    BASE.saturating_add(whole.saturating_mul(WHOLE)).saturating_add(pieces)
}

/// Refuses to cut a scene into more patches than fit into `limit` bytes. Takes no memory itself.
///
/// # Errors
/// [`NoRoom`], with the finest subdivision that fits.
pub fn require(scene: &Scene, cut: Subdivision, work: Work, limit: u64) -> Result<(), NoRoom> {
    let wanted = bytes(scene, cut, work);
    if wanted <= limit {
        return Ok(());
    }
    let patch_count = Patches::count(scene, cut);
    Err(NoRoom {
        patch_count,
        bytes: wanted,
        is_least: patch_count <= Patches::count(scene, Subdivision::None),
        limit,
        finest: finest(cut, |cut| bytes(scene, cut, work) <= limit),
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

/// Bytes that the machine has for this process: free or reclaimable memory and swap, within the limits of the control
/// group and of the address space (`ulimit -v`). `None` if unknown.
pub fn free_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()
    };
    let free = 1024 * (field("MemAvailable:")? + field("SwapFree:").unwrap_or(0));
    // `max` means no limit.
    let group = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let group = group.and_then(|text| text.trim().parse::<u64>().ok());
    [Some(free), group, address_space()].into_iter().flatten().min()
}

/// Limit of the process's address space (`ulimit -v`), if any.
#[cfg(unix)]
pub fn address_space() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::As).current
}

/// Limit of the process's address space, if any.
#[cfg(not(unix))]
pub fn address_space() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemicube_scene::generate::cornell_box;

    #[test]
    fn what_is_named_fits_and_the_next_finer_does_not() {
        let scene = cornell_box();
        for work in [Work::Pixels, Work::Fractions, Work::Grouped] {
            let refused = |cut| require(&scene, cut, work, 100_000_000).expect_err("too many").finest;
            let fits = |cut| require(&scene, cut, work, 100_000_000).is_ok();
            let Some(Subdivision::Levels(levels)) = refused(Subdivision::Levels(31)) else {
                panic!("levels")
            };
            assert!(fits(Subdivision::Levels(levels)) && !fits(Subdivision::Levels(levels + 1)));
            let Some(Subdivision::Split(pieces)) = refused(Subdivision::Split(65_536)) else {
                panic!("pieces")
            };
            assert!(fits(Subdivision::Split(pieces)) && !fits(Subdivision::Split(pieces + 1)));
            let Some(Subdivision::PatchSize(length)) = refused(Subdivision::PatchSize(1e-3)) else {
                panic!("a length")
            };
            assert!(fits(Subdivision::PatchSize(length)) && !fits(Subdivision::PatchSize(length / 1.2)));
        }
        assert_eq!(
            require(&scene, Subdivision::None, Work::Pixels, 1).map_err(|error| error.finest),
            Err(None)
        );
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_system_tells_what_is_free() {
        assert!(free_memory().is_some_and(|bytes| bytes > 1_000_000));
    }
}
