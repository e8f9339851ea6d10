//! Shards: the parts of a matrix computed by one of several processes.

use std::fmt;
use std::str::FromStr;

/// One of several processes that compute a matrix together, each its own parts, in any order and on any machine.
///
/// Shard I of N has every N-th part from the I-th on. Parts that follow each other see the same region of the scene and
/// take about equal times, so shards end at about the same time.
///
/// ```
/// use hemicube_store::Shard;
/// let shard: Shard = "2/3".parse()?;
/// assert_eq!((0..8).filter(|&part| shard.has(part)).collect::<Vec<u32>>(), [1, 4, 7]);
/// assert_eq!(Shard::new(1, 3), Some(shard));
/// assert!("0/3".parse::<Shard>().is_err(), "shards are counted from 1 where people read them");
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    index: u32,
    count: u32,
}

impl Shard {
    /// The shard with this index, counted from 0, of `count`; `None` when there is no such one.
    pub fn new(index: u32, count: u32) -> Option<Self> {
        (index < count).then_some(Self { index, count })
    }

    /// Its number, from 1.
    pub fn number(&self) -> u32 {
        self.index + 1
    }

    /// Number of shards.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Returns whether it computes a part.
    pub fn has(&self, part: u32) -> bool {
        part % self.count == self.index
    }

    /// Label of its temporary files and its lock.
    pub(super) fn label(self) -> String {
        format!("-{}-of-{}", self.number(), self.count)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number(), self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let needed = || "a shard such as `3/16`, from `1/16` to `16/16`, is needed".to_owned();
        let (number, count) = text.split_once('/').ok_or_else(needed)?;
        let parse = |text: &str| text.trim().parse::<u32>().map_err(|_| needed());
        let (number, count) = (parse(number)?, parse(count)?);
        number
            .checked_sub(1)
            .and_then(|index| Self::new(index, count))
            .ok_or_else(needed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_is_of_one_shard() {
        for count in 1..20 {
            for part in 0..100 {
                let of = |index: u32| Shard::new(index, count).is_some_and(|shard| shard.has(part));
                assert_eq!((0..count).filter(|&index| of(index)).count(), 1);
            }
        }
    }

    #[test]
    fn shards_are_counted_from_one() {
        assert_eq!("3/16".parse(), Ok(Shard { index: 2, count: 16 }));
        assert_eq!(
            "3/16".parse::<Shard>().map(|shard| shard.to_string()),
            Ok("3/16".to_owned())
        );
        for wrong in ["0/4", "5/4", "1/0", "4", "a/b", "-1/4", "", "1/4/5"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }
}
