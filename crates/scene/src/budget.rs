//! Memory that may be taken: whoever takes much asks first.
//!
//! One rule for readers, preparation, images of portals, pictures and tables:
//!
//! ```text
//! resident + asked ≤ allowed      what a user allows (`--memory`)
//! asked ≤ left                    where nothing is said: what the machine has left for this process
//! ```
//!
//! In either case asked is at most what the address space (`ulimit -v`) has left. What is left: free and reclaimable
//! memory and swap, and what the control group has left. Nothing is booked: what was taken since is resident, or no
//! longer free. What was given back and is still resident counts as taken, so that the rule errs on the safe side.

use std::fmt;

/// Memory that may be taken.
///
/// ```
/// use hemicube_scene::Budget;
///
/// let some = Budget::new(Some(1 << 40));
/// assert!(some.require(1 << 20, "a picture").is_ok());
/// let refused = some.require(1 << 41, "a picture").expect_err("two terabytes of one");
/// assert!(refused.to_string().starts_with("a picture takes 2199023.3 MB, and "));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Budget {
    allowed: Option<u64>,
}

impl Budget {
    /// What a user allows to the whole process, in bytes; `None`: what the machine has left.
    pub const fn new(allowed: Option<u64>) -> Self {
        Self { allowed }
    }

    /// What a user allows, if anything was said.
    pub const fn allowed(self) -> Option<u64> {
        self.allowed
    }

    /// Bytes that may yet be taken; `None` if the system does not tell.
    pub fn left(self) -> Option<u64> {
        let status = Status::read();
        let resident = status.as_ref().map_or(0, |status| status.resident);
        let free = match self.allowed {
            Some(allowed) => Some(allowed.saturating_sub(resident)),
            None => [machine(), group()].into_iter().flatten().min(),
        };
        let mapped = status.map_or(0, |status| status.mapped);
        let addresses = address_space().map(|most| most.saturating_sub(mapped));
        [free, addresses].into_iter().flatten().min()
    }

    /// Asks for bytes that `what` takes, before it takes them.
    ///
    /// # Errors
    /// When fewer are left.
    pub fn require(self, bytes: u64, what: impl Into<String>) -> Result<(), NoRoom> {
        match self.left() {
            Some(left) if left < bytes => Err(NoRoom {
                what: what.into(),
                bytes,
                left,
                allowed: self.allowed,
            }),
            _ => Ok(()),
        }
    }
}

/// More memory than is left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoRoom {
    /// Who asked, as a noun.
    pub what: String,
    /// Bytes that it takes.
    pub bytes: u64,
    /// Bytes that were left.
    pub left: u64,
    /// Bytes that a user allows to the whole process.
    pub allowed: Option<u64>,
}

impl NoRoom {
    /// The least that would have to be allowed, in whole megabytes.
    pub fn megabytes(&self) -> u64 {
        let taken = match self.allowed {
            Some(allowed) if self.left > 0 => allowed.saturating_sub(self.left),
            // More than is allowed may be taken already: by a device's driver, before a scene is read.
            _ => Status::read().map_or(0, |status| status.resident),
        };
        self.bytes.saturating_add(taken).div_ceil(1_000_000)
    }
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = |bytes: u64| format!("{:.1} MB", bytes as f64 / 1e6);
        write!(f, "{} takes {}, and ", self.what, size(self.bytes))?;
        match self.allowed {
            Some(allowed) => write!(f, "{} of the {} allowed are left", size(self.left), size(allowed)),
            None => write!(f, "{} of memory are free", size(self.left)),
        }
    }
}

impl std::error::Error for NoRoom {}

/// What the process has of memory and of addresses, in bytes.
struct Status {
    resident: u64,
    mapped: u64,
}

impl Status {
    fn read() -> Option<Self> {
        let text = std::fs::read_to_string("/proc/self/status").ok()?;
        Some(Self {
            resident: kibibytes(&text, "VmRSS:")?,
            mapped: kibibytes(&text, "VmSize:")?,
        })
    }
}

/// A line `NAME  N kB` of the system's, in bytes.
fn kibibytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim()
        .strip_suffix("kB")?
        .trim()
        .parse::<u64>()
        .ok()?
        .checked_mul(1024)
}

/// Free and reclaimable memory and swap.
fn machine() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    Some(kibibytes(&text, "MemAvailable:")? + kibibytes(&text, "SwapFree:").unwrap_or(0))
}

/// What the control group has left: its bound without the memory that cannot be reclaimed.
fn group() -> Option<u64> {
    let folder = "/sys/fs/cgroup";
    // `max` means no bound.
    let most = std::fs::read_to_string(format!("{folder}/memory.max")).ok()?;
    let most = most.trim().parse::<u64>().ok()?;
    let taken = std::fs::read_to_string(format!("{folder}/memory.stat")).unwrap_or_default();
    let taken = taken
        .lines()
        .find_map(|line| line.strip_prefix("anon "))
        .and_then(|bytes| bytes.trim().parse().ok());
    Some(most.saturating_sub(taken.unwrap_or(0)))
}

/// Limit of the process's address space (`ulimit -v`), if any.
#[cfg(unix)]
fn address_space() -> Option<u64> {
    rustix::process::getrlimit(rustix::process::Resource::As).current
}

/// Limit of the process's address space, if any.
#[cfg(not(unix))]
fn address_space() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_resident_counts_as_taken() {
        assert!(Budget::default().left().is_some_and(|bytes| bytes > 1_000_000));
        let resident = Status::read().expect("Linux").resident;
        // Less than what the process has already.
        let few = Budget::new(Some(resident / 2));
        assert_eq!(few.left(), Some(0));
        let refused = few.require(1, "a byte").expect_err("nothing is left");
        // What it says would do does.
        let said = Budget::new(Some(1_000_000 * refused.megabytes() + 10_000_000));
        assert!(said.require(1, "a byte").is_ok(), "{refused}");
        let more = Budget::new(Some(resident + 200_000_000));
        assert!(more.require(100_000_000, "half of it").is_ok());
        assert!(more.require(300_000_000, "more than it").is_err());
    }

    #[test]
    fn a_line_of_the_system_is_in_bytes() {
        let text = "Name:\tx\nVmSize:\t    9 kB\nVmRSS:\t    3 kB\n";
        assert_eq!(kibibytes(text, "VmRSS:"), Some(3 * 1024));
        assert_eq!(kibibytes(text, "VmSwap:"), None);
    }
}
