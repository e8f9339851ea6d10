//! Messages of the library in Python's words: an option of the program as the keyword of the same name.
//!
//! ```text
//! `--resolution`      `resolution`
//! `--min-factor 1e-7` `min_factor=1e-7`
//! `--two-sided=on`    `two_sided=True`
//! `--flip all`        `flip=['all']`
//! `--rows 0..5`       `rows=(0, 5)`
//! `--symmetry x=0`    `symmetry={'x': 0}`
//! `--sector z,12`     `sector=('z', 12)`
//! `--periodic y=0..8` `periodic={'y': (0, 8)}`
//! ```
//!
//! Options without a keyword keep their form: such matrices come from the program.

/// A keyword's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// `on` or `off`; on by itself.
    Truth,
    /// A number as it stands.
    Number,
    /// A text.
    Text,
    /// A list of globs.
    Globs,
    /// `A..B`.
    Range,
    /// `AXIS=AT`.
    Plane,
    /// `AXIS,N`.
    Sector,
    /// `AXIS=A..B`.
    Period,
}

/// Options that are keywords of `Scene`, `compute`, `sky`, `solve` or `Matrix.export` and the like.
const KEYWORDS: [(&str, Kind); 38] = [
    ("allow-large", Kind::Truth),
    ("as-stored", Kind::Truth),
    ("backend", Kind::Text),
    ("backend-dir", Kind::Text),
    ("by", Kind::Text),
    ("correction", Kind::Text),
    ("culling", Kind::Truth),
    ("emitters", Kind::Globs),
    ("engine", Kind::Text),
    ("exclude", Kind::Globs),
    ("flip", Kind::Globs),
    ("keep-duplicates", Kind::Truth),
    ("min-factor", Kind::Number),
    ("occluders", Kind::Globs),
    ("overwrite", Kind::Truth),
    ("patch-size", Kind::Number),
    ("patches", Kind::Text),
    ("periodic", Kind::Period),
    ("receivers", Kind::Globs),
    ("resolution", Kind::Number),
    ("repeats", Kind::Number),
    ("rotation", Kind::Truth),
    ("rows", Kind::Range),
    ("sample-rows", Kind::Number),
    ("samples", Kind::Number),
    ("scale", Kind::Number),
    ("sector", Kind::Sector),
    ("seed", Kind::Number),
    ("specular", Kind::Text),
    ("specular-bound", Kind::Number),
    ("split", Kind::Number),
    ("store", Kind::Text),
    ("subdivide", Kind::Number),
    ("symmetry", Kind::Plane),
    ("threads", Kind::Number),
    ("tolerance", Kind::Number),
    ("two-sided", Kind::Truth),
    ("up", Kind::Text),
];

/// Words about files of properties, and about the dictionary in their place.
const PROPERTIES: [(&str, &str); 5] = [
    ("--materials FILE", "properties"),
    ("[default]", "'default'"),
    ("adiabatic = true", "'adiabatic': True"),
    ("emissivity = 0.9", "'emissivity': 0.9"),
    ("temperature = 300", "'temperature': 300"),
];

/// A message with options as keywords.
pub(crate) fn keywords(message: &str) -> String {
    let mut words = message.split('`');
    let mut text = words.next().unwrap_or_default().to_owned();
    // Every second piece stands between backticks.
    let mut is_quoted = true;
    for piece in words {
        text.push('`');
        match keyword(piece).filter(|_| is_quoted) {
            Some(keyword) => text.push_str(&keyword),
            None => text.push_str(piece),
        }
        is_quoted = !is_quoted;
    }
    text
}

/// The keywords of one or more options: `--sample-rows 8 --seed 1`. `None` where one of them has no keyword.
fn keyword(options: &str) -> Option<String> {
    if let Some((_, python)) = PROPERTIES.iter().find(|(program, _)| *program == options) {
        return Some((*python).to_owned());
    }
    let options = options.strip_prefix("--")?;
    let translated: Option<Vec<String>> = options
        .split(" --")
        .map(|option| {
            let (name, value) = option.split_once([' ', '=']).unwrap_or((option, ""));
            let (_, kind) = KEYWORDS.iter().find(|(known, _)| *known == name)?;
            let name = name.replace('-', "_");
            match value {
                "" => Some(name),
                value => Some(format!("{name}={}", written(*kind, value)?)),
            }
        })
        .collect();
    Some(translated?.join(", "))
}

/// A value as Python writes it.
fn written(kind: Kind, value: &str) -> Option<String> {
    let text = value.trim_matches('\'');
    match kind {
        Kind::Truth => match value {
            "on" => Some("True".to_owned()),
            "off" => Some("False".to_owned()),
            // The program decides.
            "auto" => Some("None".to_owned()),
            _ => None,
        },
        Kind::Number => value.parse::<f64>().is_ok().then(|| value.to_owned()),
        Kind::Text => Some(format!("'{text}'")),
        Kind::Globs => Some(format!("['{text}']")),
        Kind::Range => {
            let (start, end) = value.split_once("..")?;
            Some(format!("({start}, {end})"))
        }
        Kind::Plane => {
            let (axis, at) = value.split_once('=')?;
            Some(format!("{{'{axis}': {at}}}"))
        }
        Kind::Sector => {
            let (axis, count) = value.split_once(',')?;
            Some(format!("('{axis}', {count})"))
        }
        Kind::Period => {
            let (axis, range) = value.split_once('=')?;
            Some(format!("{{'{axis}': {}}}", written(Kind::Range, range)?))
        }
    }
}
