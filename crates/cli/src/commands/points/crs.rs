//! The coordinate reference system of a map, by its EPSG code.

use anyhow::{Result, anyhow};

/// A projected system, in which a scene's horizontal coordinates are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Crs {
    /// Its EPSG code.
    pub(super) code: u16,
    /// Its definition as Well-Known Text 1.
    pub(super) wkt: &'static str,
    /// Its unit of length, as UDUNITS has it.
    pub(super) unit: &'static str,
}

impl Crs {
    /// The system of a code; of one with heights, its horizontal part.
    ///
    /// # Errors
    /// When the code is not known, or the system is not projected: degrees, or coordinates from the earth's centre.
    pub(super) fn of(code: u16) -> Result<Self> {
        let defined = crs_definitions::from_code(code)
            .ok_or_else(|| anyhow!("EPSG:{code} is no coordinate reference system that is known here"))?;
        let horizontal = match defined.wkt.strip_prefix("COMPD_CS[") {
            Some(rest) => rest.find("PROJCS[").map_or("", |at| node(&rest[at..])),
            None => defined.wkt,
        };
        let projected = horizontal.starts_with("PROJCS[").then_some(horizontal);
        let wkt = projected.ok_or_else(|| anyhow!("EPSG:{code} is not projected: a scene has lengths, not degrees"))?;
        // The system's own unit and code come after those of the geographic system within it.
        let value = |key: &str| wkt.rsplit_once(key).and_then(|(_, rest)| rest.split('"').next());
        let code = value("AUTHORITY[\"EPSG\",\"")
            .and_then(|code| code.parse().ok())
            .unwrap_or(code);
        let unit = match value("UNIT[\"") {
            Some("metre") | None => "m",
            Some(other) => other,
        };
        Ok(Self { code, wkt, unit })
    }

    /// The system that `--crs` names: `EPSG:n`.
    pub(super) fn named(text: &str) -> Result<Self, String> {
        let code = text.strip_prefix("EPSG:").or_else(|| text.strip_prefix("epsg:"));
        let code = code.and_then(|code| code.parse().ok());
        let code = code.ok_or("a projected system is needed, by its code: EPSG:28992")?;
        Self::of(code).map_err(|error| error.to_string())
    }

    /// The system that a scene file names, as a URL, a URN or a code.
    ///
    /// # Errors
    /// When it is none that is known, or is not projected.
    pub(super) fn of_scene(name: &str) -> Result<Self> {
        let authority = name.to_ascii_uppercase().find("EPSG");
        // A URN may list a horizontal and a vertical system.
        let first = authority.map_or("", |at| name[at..].split(',').next().unwrap_or(""));
        let code = first.rsplit([':', '/']).next().and_then(|code| code.parse().ok());
        Self::of(code.ok_or_else(|| anyhow!("`{}` has no EPSG code", crate::escape::shown(name)))?)
    }
}

/// The node of Well-Known Text that a text begins with: up to the bracket that closes its first one.
fn node(text: &'static str) -> &'static str {
    let (mut depth, mut is_quoted) = (0usize, false);
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'"' => is_quoted = !is_quoted,
            b'[' if !is_quoted => depth += 1,
            b']' if !is_quoted => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return &text[..=at];
                }
            }
            _ => {}
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_name_their_system_in_several_ways_and_maps_have_its_horizontal_part() {
        for name in [
            "https://www.opengis.net/def/crs/EPSG/0/7415",
            "urn:ogc:def:crs:EPSG::7415",
            "urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709",
            "EPSG:28992",
        ] {
            let crs = Crs::of_scene(name).expect("a system");
            assert_eq!((crs.code, crs.unit), (28992, "m"), "{name}");
            assert!(crs.wkt.starts_with("PROJCS[\"Amersfoort / RD New\"") && crs.wkt.ends_with("]]"));
        }
    }

    #[test]
    fn degrees_unknown_codes_and_other_texts_are_refused() {
        for (name, reason) in [
            ("EPSG:4326", "not projected"),
            ("EPSG:6697", "not projected"),
            ("EPSG:4978", "not projected"),
            ("EPSG:1", "known here"),
            ("EPSG:70000", "EPSG code"),
            ("local", "EPSG code"),
        ] {
            let error = Crs::of_scene(name).expect_err(name).to_string();
            assert!(error.contains(reason), "{name}: {error}");
        }
        assert!(Crs::named("28992").is_err() && Crs::named("EPSG:28992").is_ok());
    }

    #[test]
    fn every_projected_system_that_is_known_has_its_own_code_and_unit() {
        let mut found = 0;
        for code in 1..=u16::MAX {
            let Ok(crs) = Crs::of(code) else { continue };
            found += 1;
            let is_compound = crs_definitions::from_code(code).is_some_and(|all| all.wkt.starts_with("COMPD_CS["));
            assert!(is_compound || crs.code == code, "{code}: {crs:?}");
            assert!(!crs.unit.contains("degree"), "{code}: {crs:?}");
        }
        assert!(found > 4000, "{found}");
    }
}
