//! Tables of numbers in text: points and suns, written by people or exported by spreadsheets and simulations.
//!
//! A line is a row; `#` begins a comment. Without a header, a row has the requested columns in their order, separated
//! by blanks, tabs, commas or semicolons. With a header, columns are found by their names, others are skipped, and rows
//! use the header's separator. A name may have its unit in brackets; another unit than the column's is refused.

use anyhow::{Context, Result, anyhow, bail};
use glam::DVec3;
use std::path::Path;

/// A row and its line in the file, from 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Row<const N: usize> {
    pub(crate) line: u64,
    pub(crate) values: [f64; N],
}

impl Row<6> {
    /// The position `x y z` and the direction `nx ny nz` of a point.
    ///
    /// # Errors
    /// For a direction without length.
    pub(crate) fn looking(&self, path: &Path) -> Result<(DVec3, DVec3)> {
        let [x, y, z, nx, ny, nz] = self.values;
        let normal = DVec3::new(nx, ny, nz);
        if normal.try_normalize().is_none() {
            bail!(
                "{}:{}: the point ({x}, {y}, {z}) has no direction to look in: its normal has no length",
                path.display(),
                self.line
            );
        }
        Ok((DVec3::new(x, y, z), normal))
    }
}

/// An error, and its line where it has one.
pub(crate) type Located = (Option<u64>, anyhow::Error);

/// A table whose header names its columns, and whose fields may be quoted.
pub(crate) struct Head<'a> {
    pub(crate) reader: csv::Reader<&'a [u8]>,
    pub(crate) names: Vec<String>,
    /// The header's line in the file, from 1.
    pub(crate) line: u64,
}

/// Reads a header. What ends its first name, a comma, semicolon or tab, separates fields; `#` begins a comment.
///
/// # Errors
/// For text in another encoding.
pub(crate) fn head(bytes: &[u8]) -> Result<Head<'_>, Located> {
    let bytes = hemicube_scene::text::unmarked(bytes).map_err(|error| (None, anyhow!(error)))?;
    let is_head = |(_, line): &(u64, &[u8])| !line.starts_with(b"#") && !matches!(*line, b"" | b"\r");
    let head = (1..).zip(bytes.split(|&byte| byte == b'\n')).find(is_head);
    let separator = head.and_then(|(_, head)| head.iter().copied().find(|byte| b",;\t".contains(byte)));
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator.unwrap_or(b','))
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(bytes);
    let names = reader.headers().map_err(|error| told(&error))?;
    let names = names.iter().map(str::to_owned).collect();
    Ok(Head {
        reader,
        names,
        line: head.map_or(1, |(line, _)| line),
    })
}

/// What the numbers of a column are in. A header may say so in brackets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unit {
    Kelvin,
    Celsius,
    Irradiance,
    Degrees,
    Percent,
    Speed,
    /// A number from 0 to 1.
    Share,
    /// A length in a unit that a table does not know, or whose length does not matter.
    Length,
}

impl Unit {
    /// What is needed, in words.
    fn needed(self) -> &'static str {
        match self {
            Self::Kelvin => "K",
            Self::Celsius => "degC",
            Self::Irradiance => "W/m2",
            Self::Degrees => "deg",
            Self::Percent => "%",
            Self::Speed => "m/s",
            Self::Share => "a share from 0 to 1",
            Self::Length => "a length",
        }
    }

    /// Units that such a column may be in elsewhere; [`plain`] makes more spellings of them one. Other words in
    /// brackets are remarks: `(normal)`, `(10 m)`.
    fn others(self) -> &'static [&'static str] {
        match self {
            Self::Kelvin => &["degC", "°C", "℃", "C", "celsius", "degrees celsius", "degF", "°F", "F"],
            Self::Celsius => &["K", "kelvin", "degF", "°F", "F", "fahrenheit"],
            Self::Irradiance => &[
                "kW/m2", "kWh/m2", "Wh/m2", "J/m2", "kJ/m2", "MJ/m2", "mW/cm2", "lux", "lx", "klx",
            ],
            Self::Degrees => &["rad", "radian", "radians", "gon", "grad"],
            Self::Percent => &["0-1", "fraction", "kg/kg", "g/kg"],
            Self::Speed => &["km/h", "kmh", "kph", "mph", "kn", "kt", "knot", "knots", "ft/s"],
            Self::Share => &["%", "percent"],
            Self::Length => &[],
        }
    }

    /// Requires that a header's field names no other unit in brackets.
    ///
    /// # Errors
    /// For one that does.
    pub(crate) fn require(self, field: &str) -> Result<()> {
        let Some((_, rest)) = field.split_once(['(', '[']) else {
            return Ok(());
        };
        let given = rest.split([')', ']']).next().unwrap_or_default().trim();
        if !self.others().iter().any(|other| plain(other) == plain(given)) {
            return Ok(());
        }
        bail!(
            "column `{}` is in {}, and {} is needed; convert its numbers, and name it `{}`",
            excerpt(field),
            excerpt(given),
            self.needed(),
            excerpt(&short(field))
        )
    }
}

/// A unit without what people write differently: `W/m²`, `w/m^2` and `W/m2` are one, and so are `W·m⁻²` and `W m-2`.
fn plain(unit: &str) -> String {
    let part = |c: char| match c {
        '²' => Some('2'),
        '¹' => Some('1'),
        '⁻' | '−' => Some('-'),
        'º' => Some('°'),
        '^' | '.' | '·' | '*' | '_' | '(' | ')' => None,
        c => (!c.is_whitespace()).then_some(c),
    };
    unit.chars().filter_map(part).flat_map(char::to_lowercase).collect()
}

/// Why a table cannot be read, and the line.
pub(crate) fn told(error: &csv::Error) -> Located {
    let line = error.position().map(csv::Position::line);
    let reason = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            anyhow!("has {len} fields where the header has {expected_len}")
        }
        csv::ErrorKind::Utf8 { .. } => anyhow!("is no UTF-8 text; save it as UTF-8"),
        _ => anyhow!("is no table: {error}"),
    };
    (line, reason)
}

/// Separator of fields.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    Char(char),
    Blanks,
}

impl Separator {
    /// The separator of a line: characters foreign to numbers come first, since a comma may be a decimal one.
    fn of(text: &str) -> Self {
        [';', '\t', ',']
            .into_iter()
            .find(|&c| text.contains(c))
            .map_or(Self::Blanks, Self::Char)
    }

    fn fields(self, text: &str) -> Vec<&str> {
        match self {
            Self::Char(c) => text.split(c).map(unquoted).collect(),
            Self::Blanks => text.split_whitespace().map(unquoted).collect(),
        }
    }
}

fn unquoted(field: &str) -> &str {
    let field = field.trim();
    field
        .strip_prefix('"')
        .and_then(|rest| rest.strip_suffix('"'))
        .map_or(field, str::trim)
}

/// A header: number of fields, separator, and places of the requested columns.
struct Header<const N: usize> {
    separator: Separator,
    count: usize,
    places: [usize; N],
}

impl<const N: usize> Header<N> {
    fn read(text: &str, names: [&str; N]) -> Result<Self> {
        let separator = Separator::of(text);
        let fields = separator.fields(text);
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            let mut found = fields.iter().enumerate().filter(|(_, field)| short(field) == name);
            *place = match (found.next(), found.next()) {
                (Some((at, _)), None) => at,
                (Some(_), Some(_)) => bail!("the header names the column `{name}` twice"),
                (None, _) => bail!(
                    "the header `{}` names no column `{name}`; the columns {} are needed",
                    excerpt(text),
                    names.map(|name| format!("`{name}`")).join(", ")
                ),
            };
        }
        Ok(Self {
            separator,
            count: fields.len(),
            places,
        })
    }
}

/// The name of a column: `x`, `X`, `x (m)` and `x [m]` are one. [`Unit::require`] looks at the unit.
pub(crate) fn short(field: &str) -> String {
    let name = field.split(['(', '[']).next().unwrap_or(field);
    name.trim().to_ascii_lowercase()
}

fn excerpt(text: &str) -> String {
    let text = text.trim();
    let mut shown: String = text.chars().take(80).collect();
    if shown.len() < text.len() {
        shown.push('…');
    }
    shown.escape_debug().to_string()
}

/// Returns whether a line is a header: none of its fields is a number.
fn is_header(text: &str) -> bool {
    let mut fields = text
        .split(|c: char| c.is_whitespace() || c == ',' || c == ';')
        .map(unquoted)
        .filter(|field| !field.is_empty())
        .peekable();
    fields.peek().is_some() && fields.all(|field| field.parse::<f64>().is_err())
}

/// Returns whether all numbers of a line have one comma each, as in `30,5 30,25 1,5`: these are three numbers or six.
fn has_decimal_commas(text: &str) -> bool {
    let is_decimal = |field: &str| {
        let field = field.trim_end_matches([',', ';']);
        let is_digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        let parts = field.trim_start_matches(['-', '+']).split_once(',');
        parts.is_some_and(|(whole, rest)| is_digits(whole) && is_digits(rest))
    };
    let mut fields = text.split_whitespace();
    text.split_whitespace().nth(1).is_some() && fields.all(is_decimal)
}

/// Fields of a line without a header: separated by blanks, too, if none is then empty.
fn fields_of(text: &str) -> Result<Vec<&str>> {
    if has_decimal_commas(text) {
        bail!(
            "`{}` may have decimal commas; write decimal points, or one separator between all numbers",
            excerpt(text)
        );
    }
    let separator = Separator::of(text);
    let mut fields = separator.fields(text);
    while fields.last().is_some_and(|field| field.is_empty()) {
        fields.pop();
    }
    if fields.iter().any(|field| field.is_empty()) {
        bail!("`{}` has an empty field", excerpt(text));
    }
    let split = fields.iter().flat_map(|field| field.split_whitespace());
    Ok(split.map(unquoted).collect())
}

fn number(field: &str) -> Result<f64> {
    match field.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ if field.contains(',') && field.replacen(',', ".", 1).parse::<f64>().is_ok() => {
            bail!("`{}` has a decimal comma; write a decimal point", excerpt(field))
        }
        _ if field.is_empty() => bail!("a field is empty where a number is needed"),
        _ => bail!("`{}` is no finite number", excerpt(field)),
    }
}

/// The rows of the columns `names` in a file.
///
/// # Errors
/// When the file cannot be read, is no UTF-8, holds no row, or a line is malformed: the error names it.
pub(crate) fn read<const N: usize>(path: &Path, names: [&str; N]) -> Result<Vec<Row<N>>> {
    let text = text(path)?;
    rows(&text, names).map_err(|(line, error)| located(path, line, error))
}

/// Rows of one of two sets of columns.
#[derive(Debug)]
pub(crate) enum Either<const A: usize, const B: usize> {
    First(Vec<Row<A>>),
    Second(Vec<Row<B>>),
}

/// The rows of a file with the columns `first`, or more of them, `second`: the header's names or the number of fields
/// in the first row tell which.
///
/// # Errors
/// As [`read`].
pub(crate) fn read_either<const A: usize, const B: usize>(
    path: &Path,
    first: [&str; A],
    second: [&str; B],
) -> Result<Either<A, B>> {
    let text = text(path)?;
    let has_more = has_more(&text, A, &second);
    let found = if has_more {
        rows(&text, second).map(Either::Second)
    } else {
        rows(&text, first).map(Either::First)
    };
    found.map_err(|(line, error)| located(path, line, error))
}

/// Returns whether a file has a header that names this column.
///
/// # Errors
/// When the file cannot be read, or is no UTF-8.
pub(crate) fn names_column(path: &Path, name: &str) -> Result<bool> {
    Ok(names(path)?.iter().any(|field| short(field) == name))
}

/// The names of a table's columns; none without a header.
///
/// # Errors
/// When the file cannot be read, or is no UTF-8.
pub(crate) fn names(path: &Path) -> Result<Vec<String>> {
    let text = text(path)?;
    let mut lines = text.lines().map(|line| line.split('#').next().unwrap_or(""));
    let head = lines.find(|line| !is_empty(line)).filter(|line| is_header(line));
    let fields = |head: &str| {
        Separator::of(head)
            .fields(head)
            .iter()
            .map(|field| (*field).to_owned())
            .collect()
    };
    Ok(head.map(fields).unwrap_or_default())
}

/// The text of each row in the column `name`; `None` without such a column.
///
/// # Errors
/// When the file cannot be read, or is no UTF-8.
pub(crate) fn words(path: &Path, name: &str) -> Result<Option<Vec<String>>> {
    Ok(words_of(&text(path)?, name))
}

fn words_of(text: &str, name: &str) -> Option<Vec<String>> {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or(""));
    let mut lines = lines.filter(|line| !is_empty(line));
    let head = lines.next().filter(|line| is_header(line))?;
    let separator = Separator::of(head);
    let place = separator.fields(head).iter().position(|field| short(field) == name)?;
    let word = |line: &str| {
        separator
            .fields(line)
            .get(place)
            .copied()
            .unwrap_or_default()
            .to_owned()
    };
    Some(lines.map(word).collect())
}

/// Returns whether a table has columns beyond the first `count` of `names`.
fn has_more(text: &str, count: usize, names: &[&str]) -> bool {
    let mut lines = text.lines().map(|line| line.split('#').next().unwrap_or(""));
    let Some(line) = lines.find(|line| !is_empty(line)) else {
        return false;
    };
    if is_header(line) {
        let fields = Separator::of(line).fields(line);
        return fields.iter().any(|field| names[count..].contains(&&*short(field)));
    }
    fields_of(line).is_ok_and(|fields| fields.len() > count)
}

/// An error by its line.
fn located(path: &Path, line: Option<u64>, error: anyhow::Error) -> anyhow::Error {
    match line {
        Some(line) => anyhow!("{}:{line}: {error}", path.display()),
        None => anyhow!("`{}` {error}", path.display()),
    }
}

/// The text of a file, without a byte-order mark.
fn text(path: &Path) -> Result<String> {
    let bytes = hemicube_scene::read_regular(path).with_context(|| format!("`{}` cannot be read", path.display()))?;
    let text = hemicube_scene::text::unmarked(&bytes).map_err(|error| error.in_file(path))?;
    let text = std::str::from_utf8(text).map_err(|error| {
        let line = 1 + text[..error.valid_up_to()]
            .iter()
            .filter(|&&byte| byte == b'\n')
            .count();
        anyhow!("{}:{line}: is no UTF-8 text; save it as UTF-8", path.display())
    })?;
    Ok(text.to_owned())
}

/// Returns whether a line has no field.
fn is_empty(text: &str) -> bool {
    text.trim_matches(|c: char| c.is_whitespace() || c == ',' || c == ';')
        .is_empty()
}

fn rows<const N: usize>(text: &str, names: [&str; N]) -> Result<Vec<Row<N>>, (Option<u64>, anyhow::Error)> {
    let mut header: Option<Header<N>> = None;
    let mut rows = Vec::new();
    for (line, text) in (1..).zip(text.lines()) {
        let at = |error| (Some(line), error);
        let text = text.split('#').next().unwrap_or("");
        if is_empty(text) {
            continue;
        }
        if header.is_none() && rows.is_empty() && is_header(text) {
            header = Some(Header::read(text, names).map_err(at)?);
            continue;
        }
        rows.push(Row {
            line,
            values: row(text, header.as_ref(), names).map_err(at)?,
        });
    }
    if rows.is_empty() {
        return Err((None, anyhow!("holds no line of `{}`", names.join(" "))));
    }
    Ok(rows)
}

fn row<const N: usize>(text: &str, header: Option<&Header<N>>, names: [&str; N]) -> Result<[f64; N]> {
    let mut values = [0.0; N];
    let Some(header) = header else {
        let fields = fields_of(text)?;
        // Before their number: a decimal comma makes two of one.
        let numbers = fields.iter().map(|field| number(field)).collect::<Result<Vec<f64>>>();
        if fields.len() != N {
            bail!(
                "`{}` has {} where {} are needed: `{}`",
                excerpt(text),
                crate::report::counted(fields.len() as u64, "number"),
                N,
                names.join(" ")
            );
        }
        values.copy_from_slice(&numbers?);
        return Ok(values);
    };
    let fields = header.separator.fields(text);
    if fields.len() != header.count {
        bail!(
            "`{}` has {} where the header has {}",
            excerpt(text),
            crate::report::counted(fields.len() as u64, "field"),
            header.count
        );
    }
    for (value, &place) in values.iter_mut().zip(&header.places) {
        *value = number(fields[place])?;
    }
    Ok(values)
}

/// A field of a comma-separated table; names may hold anything.
pub(crate) fn field(text: &str) -> String {
    let text = &*hemicube::analysis::zones::table_text(text);
    if text.contains(['"', ',', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINT: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

    fn values<const N: usize>(text: &str, names: [&str; N]) -> Vec<[f64; N]> {
        rows(text, names)
            .expect("a good table")
            .iter()
            .map(|row| row.values)
            .collect()
    }

    fn error(text: &str) -> String {
        let (line, error) = rows(text, POINT).expect_err(text);
        format!("{line:?} {error}")
    }

    #[test]
    fn words_are_those_of_a_named_column() {
        let table = "# people\nname;x;Zone\ndesk;1;Zone One\n\n\"a b\";2;Two # here\n";
        assert_eq!(
            words_of(table, "zone"),
            Some(vec!["Zone One".to_owned(), "Two".to_owned()])
        );
        assert_eq!(words_of(table, "name"), Some(vec!["desk".to_owned(), "a b".to_owned()]));
        assert!(words_of(table, "y").is_none() && words_of("1 2 3\n", "name").is_none());
    }

    #[test]
    fn rows_however_they_are_separated() {
        let expected = [[1.0, 2.0, 3.0, 0.0, -1.0, 0.5]];
        for text in [
            "1 2 3 0 -1 .5\n",
            "# a point\n\n1,2,3,0,-1,.5 # there\n",
            "1;2;3;0;-1;.5\r\n",
            "1\t2\t3\t0\t-1\t.5",
            "  1, 2, 3  0 -1 0.5,\n",
            "\"1\",\"2\",\"3\",\"0\",\"-1\",\"5e-1\"\n",
            "x,y,z,nx,ny,nz\n1,2,3,0,-1,.5\n",
            "X (m);Y (m);Z [m];NX;NY;NZ\n1;2;3;0;-1;.5\n,,,\n",
            "nx ny nz x y z\n0 -1 .5 1 2 3\n",
            "name\tx\ty\tz\tnx\tny\tnz\nbus stop 7\t1\t2\t3\t0\t-1\t.5\n",
        ] {
            assert_eq!(values(text, POINT), expected, "{text}");
        }
        let rows = rows("x y z\n\n0 0 1\n# noon\n0 1 1\n", ["x", "y", "z"]).expect("suns");
        assert_eq!(rows.iter().map(|row| row.line).collect::<Vec<_>>(), [3, 5]);
    }

    #[test]
    fn a_header_may_not_name_another_unit() {
        use Unit::{Celsius, Degrees, Irradiance, Kelvin, Length, Percent, Share, Speed};
        for (unit, fields) in [
            (Kelvin, &["t", "t (K)", "t [Kelvin]", "t ()", "t ("][..]),
            (Celsius, &["t (degC)", "t (ºC)", "t (2 m)"]),
            (
                Irradiance,
                &["e (W/m²)", "e [W m-2]", "e (normal)", "e (W/m2) [DNI]", "albedo (-)"],
            ),
            (Degrees, &["a (°)", "a (deg clockwise from north)"]),
            (Percent, &["h (%)", "h (relative)"]),
            (Speed, &["w (m s^-1)", "w (10 m)"]),
            (Share, &["g (-)"]),
            (Length, &["x", "x (mm)", "x (east)"]),
        ] {
            for field in fields {
                assert!(unit.require(field).is_ok(), "{unit:?} {field}");
            }
        }
        for (unit, field, said) in [
            (
                Kelvin,
                "sky (degC)",
                "column `sky (degC)` is in degC, and K is needed; convert its numbers, and name it `sky`",
            ),
            (Kelvin, "sky [°C] (night)", "is in °C, and K is needed"),
            (Irradiance, "e (kW/m²)", "is in kW/m², and W/m2 is needed"),
            (Irradiance, "e [Wh/m2]", "is in Wh/m2, and W/m2 is needed"),
            (Degrees, "a (rad)", "is in rad, and deg is needed"),
            (Share, "g (%)", "is in %, and a share from 0 to 1 is needed"),
            (Speed, "w (km/h)", "is in km/h, and m/s is needed"),
        ] {
            let found = unit.require(field).expect_err(field).to_string();
            assert!(found.contains(said), "{found}");
        }
    }

    #[test]
    fn a_header_after_comments_has_its_line() {
        let found = head(b"# a\n\r\n# b\nx;y\n1;2\n")
            .map_err(|(_, error)| error)
            .expect("a header");
        assert_eq!((found.line, found.names), (4, vec!["x".to_owned(), "y".to_owned()]));
    }

    #[test]
    fn the_first_line_tells_which_columns_there_are() {
        for (text, more) in [
            ("1 2 3\n", false),
            ("# a point\n\n1,2,3,0,0,1\n", true),
            ("x,y,z\n1,2,3\n", false),
            ("name;x;y;z\nhere;1;2;3\n", false),
            ("X (m),Y (m),Z (m),NX,NY,NZ\n1,2,3,0,0,1\n", true),
            ("x y z nx\n1 2 3 0\n", true),
            ("", false),
        ] {
            assert_eq!(has_more(text, 3, &POINT), more, "{text}");
        }
    }

    #[test]
    fn what_is_malformed_is_refused_by_its_line() {
        for (text, expected) in [
            (
                "0 0 1 0 0 1\n0 0 1 0 0\n",
                "Some(2) `0 0 1 0 0` has 5 numbers where 6 are needed: `x y z nx ny nz`",
            ),
            ("15 5 1.1\n", "Some(1) `15 5 1.1` has 3 numbers"),
            ("1,,3,0,0,1\n", "Some(1) `1,,3,0,0,1` has an empty field"),
            ("1;2;3;0;0;0,5\n", "decimal comma"),
            ("1 2 3 0 0 nan\n", "`nan` is no finite number"),
            ("1 2 3 0 0 up\n", "`up` is no finite number"),
            ("x,y,z\n1,2,3\n", "Some(1) the header `x,y,z` names no column `nx`"),
            ("x,x,y,z,nx,ny,nz\n", "twice"),
            (
                "x,y,z,nx,ny,nz\n1,2,3,0,0\n",
                "Some(2) `1,2,3,0,0` has 5 fields where the header has 6",
            ),
            ("x,y,z,nx,ny,nz\n1,2,3,0,0,\n", "empty"),
            ("1 2 3 0 0 1\nx y z nx ny nz\n", "Some(2) `x` is no finite number"),
            ("x y z nx ny nz\n", "None holds no line of"),
            ("", "None holds no line of"),
        ] {
            let found = error(text);
            assert!(found.contains(expected), "{text}: {found}");
        }
    }
}
