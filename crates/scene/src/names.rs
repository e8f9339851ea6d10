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

/// The places of names that several share, ascending, and a name of its own for each: `NAME 1`, `NAME 2`, without the
/// numbers that would make another's name. `nameless` stands for an empty name; names of one `key` are one.
///
/// Takes time and memory in proportion to the names: each number passed over is a name that was there.
pub(crate) fn numbered(names: &[&str], nameless: &str, key: impl Fn(&str) -> String) -> Vec<(usize, String)> {
    // Uses of each name, and the last number given.
    let mut uses: HashMap<String, (usize, u64)> = HashMap::new();
    for name in names {
        uses.entry(key(name)).or_default().0 += 1;
    }
    let mut found = Vec::new();
    for (at, name) in names.iter().enumerate() {
        let own = key(name);
        let Some(&(2.., mut number)) = uses.get(&own) else {
            continue;
        };
        let stem = Some(name.trim()).filter(|name| !name.is_empty()).unwrap_or(nameless);
        let new = loop {
            number += 1;
            let new = format!("{stem} {number}");
            if !uses.contains_key(&key(&new)) {
                break new;
            }
        };
        uses.entry(own).and_modify(|(_, last)| *last = number);
        uses.insert(key(&new), (1, 0));
        found.push((at, new));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_names_become_names_of_their_own() {
        let of = |names: &[&str]| numbered(names, "solid", str::to_uppercase);
        let own = |at: usize, name: &str| (at, name.to_owned());
        assert_eq!(of(&["w", "v", "W"]), [own(0, "w 1"), own(2, "W 2")]);
        assert_eq!(
            of(&["w", "w 1", "w", "W 3"]),
            [own(0, "w 2"), own(2, "w 4")],
            "no other's name"
        );
        assert_eq!(of(&["", "solid", "", "solid"]).len(), 4);
        let all = of(&["", "solid", "", "solid"]);
        let names: std::collections::HashSet<&String> = all.iter().map(|(_, name)| name).collect();
        assert_eq!(names.len(), 4, "{all:?}");
        assert!(of(&["", "w"]).is_empty());
    }

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
