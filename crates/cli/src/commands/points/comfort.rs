//! What people in a zone see of its surfaces, for EnergyPlus: a `ComfortViewFactorAngles` a point, as IDF.
//!
//! Read: the dictionary's entry of EnergyPlus 25.1 (a name, then pairs of a surface's name and its angle factor), that of
//! 9.4 (the zone's name stands before the pairs), and `GetAngleFactorList` of `ThermalComfort.cc`, which ends the run
//! where factors do not add up to 1 within 0.01. The zone was taken out by the transition to 24.1; here it is written
//! where the table of points has a column `zone`.
//!
//! Surfaces are objects by their names. Factors have six digits and add up to 1: what rounding leaves is the largest's.
//! No epJSON, because its fields are called otherwise in 25.1 and after; EnergyPlus' `ConvertInputFormat` makes it.

use super::output::Groups;
use super::sensors::Sensors;
use super::{Arguments, BodyName, By, Kept};
use crate::exit::hinted;
use crate::report::percent;
use anyhow::{Result, anyhow, bail};
use std::collections::HashSet;
use std::fmt::Write as _;

/// By how much factors may miss 1: EnergyPlus' own limit.
const MISSING: f64 = 0.01;
/// Digits of a factor: parts of 1.
const WHOLE: i64 = 1_000_000;

/// Refuses what is no person, and columns that are no surfaces.
///
/// # Errors
/// For `--as cube` and `--by` of anything but objects.
pub(super) fn require(arguments: &Arguments) -> Result<()> {
    if arguments.body == Some(BodyName::Cube) {
        bail!("an .idf has one row a point, and a cube has six: `--as person`, `seated`, `sphere` or `cylinder`");
    }
    if arguments.by != By::Object {
        bail!("an .idf names EnergyPlus' surfaces, which are objects: leave `--by` out");
    }
    Ok(())
}

/// The objects of all points.
///
/// # Errors
/// Where a point sees more than its zone, a name is none in an IDF, or two points have one.
pub(super) fn idf(sensors: &Sensors, groups: &Groups, rows: &[Kept]) -> Result<String> {
    let (mut text, mut taken) = (String::new(), HashSet::new());
    for row in rows {
        let name = match sensors.names.as_ref().and_then(|names| names.get(row.sensor)) {
            Some(name) => name.clone(),
            None => format!("Point {}", row.sensor),
        };
        require_name(&name)?;
        if !taken.insert(name.to_uppercase()) {
            return Err(hinted(
                anyhow!("two points are called `{name}`, and EnergyPlus knows an object by its name"),
                "give each a name of its own in the column `name`",
            ));
        }
        let factors = parts(&row.groups).map_err(|sum| {
            hinted(
                anyhow!(
                    "`{name}` sees {} of the surfaces, and EnergyPlus takes view factors that add up to 1 within 1 %",
                    percent(sum)
                ),
                "the zone is closed, its surfaces look into it, and the point lies in it: `hemicube inspect` tells",
            )
        })?;
        // Text always has room.
        let _ = write!(text, "ComfortViewFactorAngles,\n  {name}");
        if let Some(zone) = sensors.zones.as_ref().and_then(|zones| zones.get(row.sensor)) {
            require_name(zone)?;
            let _ = write!(text, ",\n  {zone}");
        }
        for (group, factor) in factors {
            let surface = groups.name(group);
            require_name(&surface)?;
            let _ = write!(text, ",\n  {surface},{}.{:06}", factor / WHOLE, factor % WHOLE);
        }
        text.push_str(";\n\n");
    }
    Ok(text)
}

/// Factors in millionths, which add up to 1, without those of 0; their sum where that is off.
fn parts(groups: &[(u32, f64)]) -> std::result::Result<Vec<(u32, i64)>, f64> {
    let sum: f64 = groups.iter().map(|(_, factor)| factor).sum();
    if (sum - 1.0).abs() > MISSING || sum.is_nan() {
        return Err(sum);
    }
    #[allow(clippy::cast_possible_truncation, reason = "from 0 to a million")]
    let rounded = |factor: f64| (factor / sum * WHOLE as f64).round() as i64;
    let mut parts: Vec<(u32, i64)> = groups.iter().map(|&(group, factor)| (group, rounded(factor))).collect();
    let left = WHOLE - parts.iter().map(|(_, part)| part).sum::<i64>();
    if let Some((_, largest)) = parts.iter_mut().max_by_key(|(_, part)| *part) {
        *largest += left;
    }
    parts.retain(|(_, part)| *part > 0);
    Ok(parts)
}

/// Refuses names that an IDF cannot hold.
fn require_name(name: &str) -> Result<()> {
    let is_forbidden = |c: char| matches!(c, ',' | ';' | '!') || c.is_control();
    if name.trim().is_empty() || name.contains(is_forbidden) {
        return Err(hinted(
            anyhow!(
                "`{}` is no name in an IDF, which keeps `,`, `;` and `!` to itself",
                name.escape_debug()
            ),
            "name points, zones and surfaces as the model does",
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up_to_one_and_open_views_are_refused() {
        let third = 1.0 / 3.0;
        assert_eq!(
            parts(&[(4, third), (5, third), (6, third), (7, 1e-8)]),
            Ok(vec![(4, 333_333), (5, 333_333), (6, 333_334)])
        );
        assert_eq!(parts(&[(0, 0.496), (1, 0.496)]), Ok(vec![(0, 500_000), (1, 500_000)]));
        assert_eq!(parts(&[(0, 0.98)]), Err(0.98));
        assert!(parts(&[]).is_err());
    }

    #[test]
    fn names_with_separators_are_refused() {
        assert!(require_name("South Wall 1").is_ok());
        for name in ["", " ", "a,b", "a;b", "a!b", "a\nb"] {
            assert!(require_name(name).is_err(), "{name}");
        }
    }
}
