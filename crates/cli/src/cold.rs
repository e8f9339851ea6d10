//! Temperatures that may be in degrees Celsius.

use crate::args::Talk;
use crate::report::count;

/// Temperatures below this, in kelvin, are asked about, and how many of them are named.
pub(crate) const COLD: f64 = 100.0;
const COLD_SHOWN: usize = 3;

/// Asks whether these temperatures below [`COLD`], with what they are of, are degrees Celsius.
pub(crate) fn question_cold(mut cold: Vec<String>, talk: Talk) {
    let more = cold.len().saturating_sub(COLD_SHOWN);
    cold.truncate(COLD_SHOWN);
    if more > 0 {
        cold.push(format!("{} more", count(more as u64)));
    }
    if !cold.is_empty() {
        talk.warn(&format!(
            "{}: below {COLD} K; if degrees Celsius are meant, add 273.15, for temperatures are in kelvin",
            cold.join(", ")
        ));
    }
}
