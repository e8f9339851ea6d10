//! Names in order of first use, each with a number: the objects and materials of a scene.

use crate::{Error, ErrorKind};
use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};

/// No further name of a hash.
const NONE: u32 = u32::MAX;

/// Names by number, in order of first use. A name is kept once: a file may have one a face.
#[derive(Default)]
pub(crate) struct Names {
    state: RandomState,
    /// The last number of each hash.
    numbers: HashMap<u64, u32>,
    /// The number before of the same hash, for each name.
    before: Vec<u32>,
    pub(crate) names: Vec<String>,
}

impl Names {
    /// The number of a name, its next place if it was not used before.
    pub(crate) fn number(&mut self, name: &str) -> Result<u32, Error> {
        let hash = self.state.hash_one(name);
        let last = self.numbers.get(&hash).copied().unwrap_or(NONE);
        let mut number = last;
        while let Some(other) = self.names.get(number as usize) {
            if other == name {
                return Ok(number);
            }
            number = self.before[number as usize];
        }
        let number = u32::try_from(self.names.len()).ok().filter(|&number| number != NONE);
        let number = number.ok_or_else(|| {
            Error::new(ErrorKind::TooLarge(
                "has more names than there are numbers for".to_owned(),
            ))
        })?;
        self.names.push(name.to_owned());
        self.before.push(last);
        self.numbers.insert(hash, number);
        Ok(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered_by_first_use() {
        let mut names = Names::default();
        let found: Vec<u32> = ["b", "a", "b", "", "a"]
            .iter()
            .map(|name| names.number(name).unwrap())
            .collect();
        assert_eq!(found, [0, 1, 0, 2, 1]);
        // As if their hashes were one.
        let hash = names.state.hash_one("c");
        names.numbers.insert(hash, 1);
        names.before[1] = 0;
        assert_eq!(names.number("c").unwrap(), 3);
        assert_eq!((names.before[3], names.number("c").unwrap()), (1, 3));
        assert_eq!(names.names, ["b", "a", "", "c"]);
    }
}
