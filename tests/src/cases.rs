//! The public cases of `reference_cases.json`: pairs of quads with plates between them, and enclosures and discs by
//! name.

use crate::geometry::quad;
use crate::scenes::{scenes_or_skip, skip};
use glam::DVec3;
use serde_json::Value;

/// From an emitter to a receiver, with opaque plates between them.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The case's id.
    pub name: String,
    /// The emitter's faces.
    pub emitter: Vec<[DVec3; 4]>,
    /// The receiver's faces.
    pub receiver: Vec<[DVec3; 4]>,
    /// The plates between them.
    pub obstructions: Vec<[DVec3; 4]>,
    /// The form factor from the emitter to the receiver, and back.
    pub exact: [f64; 2],
}

impl Pair {
    /// The triangles of the emitter, of the receiver and of the plates.
    pub fn triangles(&self) -> [Vec<[DVec3; 3]>; 3] {
        [&self.emitter, &self.receiver, &self.obstructions]
            .map(|quads| quads.iter().copied().flat_map(quad).collect::<Vec<_>>())
    }
}

/// The cases of the public file; `None` after a loud skip.
///
/// # Panics
/// When the file is there and malformed.
pub fn cases(test: &str) -> Option<Vec<Value>> {
    let file = scenes_or_skip(test)?.join("../reference_cases.json");
    let Ok(text) = std::fs::read_to_string(&file) else {
        skip(
            test,
            "no reference_cases.json beside the scenes",
            "HEMICUBE_REQUIRE_SCENES",
        );
        return None;
    };
    let json: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["format"], "reference_cases/1");
    Some(json["cases"].as_array().expect("a list of cases").clone())
}

/// A number, possibly written as a string to keep its digits.
///
/// # Panics
/// When it is none.
pub fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .or_else(|| value.as_str()?.parse().ok())
        .unwrap_or_else(|| panic!("{value} is no number"))
}

/// All cases with quads as emitter and receiver.
pub fn pairs(cases: &[Value]) -> Vec<Pair> {
    let quads = |value: &Value| -> Option<Vec<[DVec3; 4]>> {
        let point = |p: &Value| DVec3::new(number(&p[0]), number(&p[1]), number(&p[2]));
        let corners = |q: &Value| [point(&q[0]), point(&q[1]), point(&q[2]), point(&q[3])];
        Some(value.as_array()?.iter().map(corners).collect())
    };
    let pair = |case: &Value| {
        Some(Pair {
            name: case["id"].as_str()?.to_owned(),
            emitter: quads(&case["emitter"])?,
            receiver: quads(&case["receiver"])?,
            obstructions: quads(&case["obstructions"])?,
            exact: ["F_emitter_to_receiver", "F_receiver_to_emitter"].map(|key| number(&case[key])),
        })
    };
    cases.iter().filter_map(pair).collect()
}

/// The case with this id.
///
/// # Panics
/// When there is none.
pub fn case<'c>(cases: &'c [Value], id: &str) -> &'c Value {
    cases
        .iter()
        .find(|case| case["id"] == id)
        .unwrap_or_else(|| panic!("no case `{id}`"))
}

/// The expectations of an enclosure's case.
///
/// # Panics
/// When there is no such case, or it expects nothing of the kind.
pub fn expected(cases: &[Value], id: &str, key: &str) -> f64 {
    number(&case(cases, id)["expected"][key])
}
