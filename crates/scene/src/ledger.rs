//! The ledger of losses: what a reader or the repair did not take as the file says, by kind, with number, area, first
//! place and the next step.
//!
//! What has area and was left out, approximated, merged, turned or read against a contradiction is a *loss*: front ends
//! warn of it whatever was asked. What has no area or changes nothing is *noted*, for those who ask for more.

use std::collections::BTreeMap;
use std::fmt;

/// Most kinds told apart; names in a file make kinds, and the rest is counted as one.
const KINDS_MAX: usize = 256;
/// The kind of what is beyond [`KINDS_MAX`].
const FURTHER: &str = "thing of a further kind";
/// Beginning of a warning of a material library that could not be read.
pub(crate) const UNREAD_LIBRARY: &str = "the material library";

/// What became of a part of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Fate {
    /// It is not in the scene.
    LeftOut,
    /// It is in the scene with another shape.
    Approximated,
    /// It is one with another part of the scene.
    Merged,
    /// It faces otherwise than in the file.
    Turned,
    /// The file contradicts itself or leaves something open, and one reading was taken.
    Doubtful,
    /// It has no area, or is in the scene as it should be.
    Noted,
}

impl Fate {
    /// All fates.
    pub const ALL: [Self; 6] = [
        Self::LeftOut,
        Self::Approximated,
        Self::Merged,
        Self::Turned,
        Self::Doubtful,
        Self::Noted,
    ];

    /// The fate in words, as before a colon.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeftOut => "left out",
            Self::Approximated => "approximated",
            Self::Merged => "merged",
            Self::Turned => "turned round",
            Self::Doubtful => "doubtful",
            Self::Noted => "noted",
        }
    }

    /// The fate of a name of [`Self::name`].
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|fate| fate.name() == name)
    }
}

/// A kind of loss.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// What became of it.
    pub fate: Fate,
    /// Number of cases.
    pub count: u64,
    /// Area in the scene's unit squared, where it is known of all cases.
    pub area: Option<f64>,
    /// Where the first one is: an element, a line, an object.
    pub first: Option<String>,
    /// The next thing to try, where there is one.
    pub next: Option<String>,
}

impl Loss {
    /// True if it has area and was not taken as the file says.
    pub fn is_loss(&self) -> bool {
        self.fate != Fate::Noted
    }

    /// The sentence on it, of the thing `what`: fate, number, area, first place, next step.
    pub fn sentence(&self, what: &str) -> String {
        let mut text = format!("{}: {} × {what}", self.fate.name(), self.count);
        let mut place = Vec::new();
        if let Some(area) = self.area.filter(|area| *area > 0.0) {
            place.push(format!("area {}", short(area)));
        }
        if let Some(first) = &self.first {
            place.push(if self.count > 1 {
                format!("the first: {first}")
            } else {
                first.clone()
            });
        }
        if !place.is_empty() {
            text.push_str(&format!(" ({})", place.join("; ")));
        }
        if let Some(next) = &self.next {
            text.push_str("; ");
            text.push_str(next);
        }
        text
    }
}

/// A number of four digits.
fn short(number: f64) -> String {
    let size = number.abs();
    if !(1e-3..1e6).contains(&size) {
        return format!("{number:.3e}");
    }
    // Four digits in all.
    let before = 1 + (0..6).filter(|&power| size >= 10_f64.powi(power + 1)).count();
    let text = format!(
        "{number:.*}",
        4_usize.saturating_sub(before) + if size < 1.0 { 1 } else { 0 }
    );
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A kind of loss before its number: what, its fate, and the next step (empty for none).
#[derive(Clone, Copy, Debug)]
pub struct Kind<'a> {
    /// What became of it.
    pub fate: Fate,
    /// The thing, in the singular.
    pub what: &'a str,
    /// The next step; empty for none.
    pub next: &'a str,
}

/// What was not taken as a file says, by kind.
///
/// ```
/// use hemicube_scene::{Fate, Kind, Ledger};
///
/// let mut ledger = Ledger::default();
/// ledger.note("line element");
/// let kind = Kind { fate: Fate::LeftOut, what: "polyhedron", next: "extract the surface" };
/// ledger.lose(kind, 2, Some(1.5), || "cell 7".to_owned());
/// ledger.lose(kind, 1, Some(0.5), || unreachable!("only the first is placed"));
/// let losses: Vec<String> = ledger.losses().map(|(what, loss)| loss.sentence(what)).collect();
/// assert_eq!(losses, ["left out: 3 × polyhedron (area 2; the first: cell 7); extract the surface"]);
/// assert_eq!(ledger.get("line element"), 1);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ledger {
    /// By what they are of, sorted, so that reports are reproducible.
    pub entries: BTreeMap<String, Loss>,
    /// Complete sentences for a person, at most a few: what a file as a whole lacks (a missing material library).
    pub warnings: Vec<String>,
}

impl Ledger {
    /// Notes one more `what`, which has no area.
    pub fn note(&mut self, what: &str) {
        self.note_many(what, 1);
    }

    /// Notes `count` more of `what`.
    pub fn note_many(&mut self, what: &str, count: u64) {
        let kind = Kind {
            fate: Fate::Noted,
            what,
            next: "",
        };
        self.add(kind, count, None, || None);
    }

    /// Adds `count` of a kind with their area, where it is known, and the place of the first.
    pub fn lose(&mut self, kind: Kind<'_>, count: u64, area: Option<f64>, first: impl FnOnce() -> String) {
        self.add(kind, count, area, || Some(first()));
    }

    fn add(&mut self, kind: Kind<'_>, count: u64, area: Option<f64>, first: impl FnOnce() -> Option<String>) {
        if count == 0 {
            return;
        }
        let is_further = self.entries.len() >= KINDS_MAX && !self.entries.contains_key(kind.what);
        let what = if is_further { FURTHER } else { kind.what };
        if let Some(loss) = self.entries.get_mut(what) {
            loss.count = loss.count.saturating_add(count);
            loss.area = loss.area.zip(area).map(|(sum, area)| sum + area);
            // Of several fates the gravest.
            loss.fate = loss.fate.min(kind.fate);
            return;
        }
        let loss = Loss {
            fate: kind.fate,
            count,
            area,
            first: first(),
            next: Some(kind.next).filter(|next| !next.is_empty()).map(str::to_owned),
        };
        self.entries.insert(what.to_owned(), loss);
    }

    /// Adds the entries of another ledger, their places said of `of`, such as a file of several.
    pub fn append(&mut self, other: Self, of: &str) {
        for (what, loss) in other.entries {
            let kind = Kind {
                fate: loss.fate,
                what: &what,
                next: loss.next.as_deref().unwrap_or_default(),
            };
            let first = Some(
                loss.first
                    .map_or_else(|| format!("`{of}`"), |first| format!("`{of}`, {first}")),
            );
            let first = first.filter(|_| loss.fate != Fate::Noted);
            self.add(kind, loss.count, loss.area, || first);
        }
    }

    /// Adds the entries of another ledger on the same scene.
    pub fn join(&mut self, other: Self) {
        for (what, loss) in other.entries {
            let kind = Kind {
                fate: loss.fate,
                what: &what,
                next: loss.next.as_deref().unwrap_or_default(),
            };
            self.add(kind, loss.count, loss.area, || loss.first);
        }
        self.warnings.extend(other.warnings);
    }

    /// The losses: what front ends warn of.
    pub fn losses(&self) -> impl Iterator<Item = (&str, &Loss)> {
        let losses = self.entries.iter().filter(|(_, loss)| loss.is_loss());
        losses.map(|(what, loss)| (what.as_str(), loss))
    }

    /// What is only noted, with its number.
    pub fn notes(&self) -> impl Iterator<Item = (&str, u64)> {
        let notes = self.entries.iter().filter(|(_, loss)| !loss.is_loss());
        notes.map(|(what, loss)| (what.as_str(), loss.count))
    }

    /// True without an entry and a warning.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty() && self.warnings.is_empty()
    }

    /// The sentences that a command says whatever was asked: warnings, then losses.
    pub fn sentences(&self) -> Vec<String> {
        let losses = self.losses().map(|(what, loss)| loss.sentence(what));
        self.warnings.iter().cloned().chain(losses).collect()
    }

    /// The warnings of material libraries that could not be read: what they describe is missing.
    pub fn unread_libraries(&self) -> impl Iterator<Item = &str> {
        self.warnings
            .iter()
            .map(String::as_str)
            .filter(|warning| warning.starts_with(UNREAD_LIBRARY))
    }

    /// Number of times `what` was added.
    pub fn get(&self, what: &str) -> u64 {
        self.entries.get(what).map_or(0, |loss| loss.count)
    }
}

impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.sentences()
            .iter()
            .try_for_each(|sentence| writeln!(f, "{sentence}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_are_known_only_where_all_are_and_kinds_are_bounded() {
        let mut ledger = Ledger::default();
        let kind = Kind {
            fate: Fate::Approximated,
            what: "cell",
            next: "",
        };
        ledger.lose(kind, 1, Some(2.0), || "cell 0".to_owned());
        ledger.lose(kind, 0, None, || unreachable!("none"));
        assert_eq!(ledger.entries["cell"].area, Some(2.0));
        ledger.lose(kind, 1, None, String::new);
        assert_eq!(ledger.entries["cell"].area, None);
        for number in 0..2 * KINDS_MAX {
            ledger.note(&format!("kind {number}"));
        }
        assert_eq!(ledger.entries.len(), KINDS_MAX + 1);
        assert_eq!(ledger.get(FURTHER), 1 + KINDS_MAX as u64);
        assert_eq!(ledger.losses().count(), 1);
    }

    #[test]
    fn numbers_have_four_digits() {
        for (number, text) in [
            (2.0, "2"),
            (0.171_57, "0.1716"),
            (12.345_6, "12.35"),
            (1234.5, "1234"),
            (1e9, "1.000e9"),
        ] {
            assert_eq!(short(number), text);
        }
        assert!(Fate::ALL.iter().all(|&fate| Fate::of_name(fate.name()) == Some(fate)));
    }
}
