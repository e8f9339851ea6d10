//! Names as ASCII words, for headers.

use std::collections::HashSet;

/// Makes distinct words of names: letters, digits and `_` stay, all else becomes `_`.
pub(crate) fn words<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut taken = HashSet::new();
    names
        .map(|name| {
            let word: String = name
                .chars()
                .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
                .collect();
            let mut unique = word.clone();
            let mut number = 2;
            while !taken.insert(unique.clone()) {
                unique = format!("{word}_{number}");
                number += 1;
            }
            unique
        })
        .collect()
}

/// A name on one line of ASCII, escaped as in Rust.
pub(crate) fn line(name: &str) -> String {
    name.escape_default().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_differ() {
        assert_eq!(
            words(["near infrared", "near-infrared", "grün", "u"].into_iter()),
            ["near_infrared", "near_infrared_2", "gr_n", "u"]
        );
        assert_eq!(line("Dach\nö"), "Dach\\n\\u{f6}");
    }
}
