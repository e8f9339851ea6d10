//! Globs of names: `*` stands for any characters, `?` for one.

use std::collections::BTreeMap;
use wildmatch::WildMatch;

/// Returns whether `name` matches `glob`, with case: `?` is any character, `*` any number of them, all others
/// themselves. Time is at most the product of the lengths.
///
/// ```
/// use hemicube_scene::globs::matches_glob;
/// assert!(matches_glob("*_wall", "left_wall") && matches_glob("roof ?", "roof 7"));
/// assert!(!matches_glob("wall", "left_wall") && !matches_glob("Wall", "wall"));
/// assert!(matches_glob("*", "") && matches_glob("*ab*b?", "aabab\u{e9}") && !matches_glob("?", ""));
/// ```
pub fn matches_glob(glob: &str, name: &str) -> bool {
    WildMatch::new(glob).matches(name)
}

/// Tables by name or pattern. A name has the table of its own, otherwise that of the most particular pattern that
/// matches: the one with most characters besides `*` and `?`.
///
/// ```
/// use hemicube_scene::globs::Patterns;
/// use std::collections::BTreeMap;
///
/// let tables = [("*", 1), ("glass*", 2), ("glass_door", 3), ("*_door", 4)];
/// let tables: BTreeMap<String, i32> = tables.map(|(key, value)| (key.to_owned(), value)).into();
/// let patterns = Patterns::new(&tables);
/// let of = |name| patterns.of(name).map(|found| found.map(|(_, value)| *value));
/// assert_eq!([of("wall"), of("glass_roof"), of("glass_door")], [Ok(Some(1)), Ok(Some(2)), Ok(Some(3))]);
/// // `glass*` and `*_door` have five characters each.
/// let tie = of("glass_front_door").unwrap_err();
/// assert_eq!((tie.first.as_str(), tie.second.as_str()), ("*_door", "glass*"));
/// ```
#[derive(Clone, Debug)]
pub struct Patterns<'t, T> {
    tables: &'t BTreeMap<String, T>,
    /// Keys with wildcards, the most particular first, and the number of their other characters.
    globs: Vec<(usize, &'t String, WildMatch)>,
}

/// Two patterns match a name, and neither is more particular.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` fits both `{first}` and `{second}`; name it in a table of its own")]
pub struct Tie {
    /// The name.
    pub name: String,
    /// One pattern.
    pub first: String,
    /// The other.
    pub second: String,
}

impl<'t, T> Patterns<'t, T> {
    /// Sorts the patterns among the keys of tables.
    pub fn new(tables: &'t BTreeMap<String, T>) -> Self {
        let literals = |key: &str| key.chars().filter(|c| !matches!(c, '*' | '?')).count();
        let patterns = tables.keys().filter(|key| key.contains(['*', '?']));
        let mut globs: Vec<_> = patterns.map(|key| (literals(key), key, WildMatch::new(key))).collect();
        globs.sort_by_key(|(literals, ..)| std::cmp::Reverse(*literals));
        Self { tables, globs }
    }

    /// The table of a name, with its key; `None` where nothing matches.
    ///
    /// # Errors
    /// When two patterns match alike.
    pub fn of(&self, name: &str) -> Result<Option<(&'t String, &'t T)>, Tie> {
        if let Some(exact) = self.tables.get_key_value(name) {
            return Ok(Some(exact));
        }
        let mut fitting = self.globs.iter().filter(|(.., glob)| glob.matches(name));
        let Some((literals, key, _)) = fitting.next() else {
            return Ok(None);
        };
        match fitting.next() {
            Some((others, other, _)) if others == literals => Err(Tie {
                name: name.to_owned(),
                first: (*key).clone(),
                second: (*other).clone(),
            }),
            _ => Ok(self.tables.get_key_value(key.as_str())),
        }
    }

    /// The first key that matches none of `names`. A pattern whose every name has a more particular table matches.
    pub fn unused<S: AsRef<str>>(&self, names: &[S]) -> Option<&'t String> {
        let is_used = |key: &&String| {
            let glob = WildMatch::new(key);
            names
                .iter()
                .any(|name| name.as_ref() == key.as_str() || glob.matches(name.as_ref()))
        };
        self.tables.keys().find(|key| !is_used(key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn globs() {
        for (glob, name) in [
            ("", ""),
            ("*", ""),
            ("*", "wall"),
            ("wall", "wall"),
            ("wa*", "wall"),
            ("*ll", "wall"),
            ("w?ll", "wall"),
            ("*a*l*", "wall"),
            ("**", "x"),
            ("a*b*c", "aXbYbZc"),
            ("f?r", "für"),
            ("[ab]", "[ab]"),
        ] {
            assert!(matches_glob(glob, name), "{glob} {name}");
        }
        for (glob, name) in [
            ("", "a"),
            ("?", ""),
            ("wall", "Wall"),
            ("wa", "wall"),
            ("*x", "wall"),
            ("w?l", "wall"),
            ("a*b", "abc"),
        ] {
            assert!(!matches_glob(glob, name), "{glob} {name}");
        }
    }

    #[test]
    fn a_hostile_glob_takes_no_time() {
        assert!(!matches_glob(&"*a".repeat(200), &format!("{}b", "a".repeat(10_000))));
    }
}
