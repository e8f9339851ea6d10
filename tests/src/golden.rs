//! Reference rows in files: rows by rays of sixteen scenes, made once, as nothing that computes rows changes them.
//!
//! `tests/golden/rows/NAME.rows` has a head of lines (scene, its hash, [`reference::VERSION`], settings, number of
//! rows) up to an empty line, then deflated numbers. Form factors are f32; their standard errors are rounded to quarters
//! of an octave (by 9 % at most: they only ever say how far a difference may be chance). The file is a function of the
//! scene, the settings and the version, byte for byte on one machine; on another, the sine of a mathematical library
//! may differ in its last bit.
//!
//! `cargo run --release -p hemicube-tests --example scoreboard -- golden` makes them anew.

pub mod scenes;

use crate::scenes::workspace;
use hemicube::driver::compute::{Plan, RowChoice, Selection};
use hemicube::reference::{self, Reference, ReferenceRow, ReferenceSettings};
use hemicube::{InputPatch, Model};
use miniz_oxide::{deflate::compress_to_vec, inflate::decompress_to_vec_with_limit};
use scenes::Ready;
use std::path::PathBuf;

/// Rows of a scene.
pub const ROWS: u32 = 64;
/// Seed of the rows drawn.
pub const SEED: u64 = 56;

/// Settings of the reference. The error of a row, 0.1 % of its norm, adds 0.5 % to an error of 1 %, and is taken off; to
/// an error of 0.1 % it adds as much again. Halving it takes four times as long.
pub const SETTINGS: ReferenceSettings = ReferenceSettings {
    target: 1e-3,
    max_rays: 8_000_000,
    seed: 1,
};

/// Bytes that a file may inflate to.
const MOST_BYTES: usize = 64 << 20;

/// Reference rows of a scene, with what they depend on.
#[derive(Clone, Debug, PartialEq)]
pub struct Golden {
    /// The scene's name.
    pub scene: String,
    /// [`hemicube::store::scene_hash`] of its triangles.
    pub hash: String,
    /// [`reference::VERSION`] of the program that made them.
    pub version: u32,
    /// The settings in words.
    pub settings: String,
    /// The rows, in the order of the plan.
    pub rows: Vec<ReferenceRow>,
}

/// Why a file has no rows for a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stale {
    /// There is no file.
    Missing(PathBuf),
    /// The file is not what this program writes.
    Malformed(&'static str),
    /// It is of another scene, version or settings: the field, what the file has, what is wanted.
    Other(&'static str, String, String),
}

impl std::fmt::Display for Stale {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Missing(path) => write!(f, "there is no `{}`", path.display())?,
            Self::Malformed(what) => write!(f, "the file of reference rows {what}")?,
            Self::Other(field, found, wanted) => {
                write!(f, "the reference rows are of {field} `{found}`, not of `{wanted}`")?;
            }
        }
        write!(
            f,
            "; `cargo run --release -p hemicube-tests --example scoreboard -- golden` makes them anew"
        )
    }
}

impl std::error::Error for Stale {}

/// The patches with rows: [`ROWS`] drawn by [`SEED`], in the order of the plan.
pub fn plan(model: &Model) -> Plan {
    let choice = RowChoice::Sample {
        count: ROWS,
        seed: SEED,
    };
    Plan::new(model, choice, Selection::default(), 1, true)
}

fn settings_in_words(settings: ReferenceSettings) -> String {
    let ReferenceSettings { target, max_rays, seed } = settings;
    format!("target {target} max_rays {max_rays} seed {seed} rows drawn by {SEED}")
}

/// Rounds a row as its file does.
pub fn rounded(row: &ReferenceRow) -> ReferenceRow {
    ReferenceRow {
        values: row.values.iter().map(|&value| f64::from(single(value))).collect(),
        errors: row.errors.iter().map(|&error| of_code(code_of(error))).collect(),
        ..row.clone()
    }
}

#[allow(clippy::cast_possible_truncation, reason = "to the nearest")]
fn single(value: f64) -> f32 {
    value as f32
}

/// Quarters of an octave above 2⁻⁶³, from 1; 0 of 0.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between 1 and 255"
)]
fn code_of(error: f64) -> u8 {
    if error > 0.0 {
        (4.0 * (error.log2() + 63.0)).round().clamp(1.0, 255.0) as u8
    } else {
        0
    }
}

fn of_code(code: u8) -> f64 {
    match code {
        0 => 0.0,
        code => (f64::from(code) / 4.0 - 63.0).exp2(),
    }
}

impl Golden {
    /// Traces the rows of a scene by several threads (0: one a core).
    ///
    /// # Panics
    /// When the settings are out of range.
    pub fn trace(ready: &Ready, threads: usize) -> Self {
        let emitters = plan(&ready.model).rows;
        let reference = Reference::new(&ready.model, SETTINGS).expect("settings in range");
        let rows = reference
            .rows(&emitters, threads, &mut |_| {})
            .expect("patches of the scene");
        Self {
            scene: ready.name.to_owned(),
            hash: ready.hash.clone(),
            version: reference::VERSION,
            settings: settings_in_words(SETTINGS),
            rows: rows.iter().map(rounded).collect(),
        }
    }

    /// The file of a scene.
    pub fn path(scene: &str) -> PathBuf {
        workspace().join(format!("tests/golden/rows/{scene}.rows"))
    }

    /// Reads the committed rows of a scene.
    ///
    /// # Errors
    /// When there are none, or they are of another scene, version or settings.
    pub fn read(ready: &Ready) -> Result<Self, Stale> {
        let path = Self::path(ready.name);
        let bytes = std::fs::read(&path).map_err(|_| Stale::Missing(path))?;
        let golden = Self::unpack(&bytes)?;
        golden.fits(ready)?;
        Ok(golden)
    }

    /// Returns whether they are of this scene, this version of the reference and these settings.
    ///
    /// # Errors
    /// The first that they are not of.
    pub fn fits(&self, ready: &Ready) -> Result<(), Stale> {
        let emitters: Vec<u32> = plan(&ready.model).rows.iter().map(|patch| patch.0).collect();
        let own: Vec<u32> = self.rows.iter().map(|row| row.emitter).collect();
        for (field, found, wanted) in [
            ("the scene", self.scene.clone(), ready.name.to_owned()),
            ("a scene with the hash", self.hash.clone(), ready.hash.clone()),
            ("the version", self.version.to_string(), reference::VERSION.to_string()),
            ("the settings", self.settings.clone(), settings_in_words(SETTINGS)),
            ("the patches", format!("{own:?}"), format!("{emitters:?}")),
        ] {
            if found != wanted {
                return Err(Stale::Other(field, found, wanted));
            }
        }
        Ok(())
    }

    /// The file's bytes.
    pub fn pack(&self) -> Vec<u8> {
        let Self {
            scene,
            hash,
            version,
            settings,
            rows,
        } = self;
        let count = rows.len();
        let head = format!(
            "hemicube reference rows 1\nscene {scene}\nhash {hash}\nversion {version}\nsettings {settings}\nrows {count}\n\n"
        );
        let mut numbers = Vec::new();
        for row in rows {
            for whole in [u64::from(row.emitter), row.columns.len() as u64, row.rays] {
                numbers.extend(whole.to_le_bytes());
            }
            for share in shares(row) {
                numbers.extend(share.to_le_bytes());
            }
            numbers.extend(row.agreement_count.to_le_bytes());
            numbers.push(u8::from(row.cut_short));
        }
        // Column by column of the table: bytes of a kind beside each other deflate better.
        for row in rows {
            let mut before = 0;
            for &column in &row.columns {
                put(&mut numbers, column - before);
                before = column;
            }
        }
        let values: Vec<[u8; 4]> = rows
            .iter()
            .flat_map(|row| &row.values)
            .map(|&value| single(value).to_le_bytes())
            .collect();
        for byte in (0..4).rev() {
            numbers.extend(values.iter().map(|bytes| bytes[byte]));
        }
        numbers.extend(rows.iter().flat_map(|row| &row.errors).map(|&error| code_of(error)));
        let mut file = head.into_bytes();
        file.extend(compress_to_vec(&numbers, 9));
        file
    }

    /// Rows from a file's bytes.
    ///
    /// # Errors
    /// When it is none of [`Golden::pack`].
    pub fn unpack(bytes: &[u8]) -> Result<Self, Stale> {
        let end = bytes.windows(2).position(|pair| pair == b"\n\n");
        let (head, packed) = bytes.split_at(end.ok_or(Stale::Malformed("has no head"))? + 2);
        let head = std::str::from_utf8(head).map_err(|_| Stale::Malformed("has a head that is no text"))?;
        if !head.starts_with("hemicube reference rows 1\n") {
            return Err(Stale::Malformed("is of another kind"));
        }
        let field = |name: &str| {
            let line = head.lines().find_map(|line| line.strip_prefix(name));
            line.map(|value| value.trim().to_owned())
                .ok_or(Stale::Malformed("lacks a line of its head"))
        };
        let number = |text: String| {
            text.parse::<u32>()
                .map_err(|_| Stale::Malformed("has no number in its head"))
        };
        let numbers =
            decompress_to_vec_with_limit(packed, MOST_BYTES).map_err(|_| Stale::Malformed("does not inflate"))?;
        let mut rest = Cursor(&numbers);
        let mut rows = Vec::new();
        let mut counts = Vec::new();
        for _ in 0..number(field("rows ")?)? {
            let emitter = u32::try_from(rest.whole()?).map_err(|_| Stale::Malformed("has no such patch"))?;
            counts.push(usize::try_from(rest.whole()?).map_err(|_| Stale::Malformed("is too long"))?);
            let mut row = ReferenceRow {
                emitter,
                rays: rest.whole()?,
                ..ReferenceRow::default()
            };
            let [escaped, blocked, of_shares, missed, of_missed, squared, agreement] = rest.shares()?;
            (row.escaped, row.blocked, row.error_of_shares) = (escaped, blocked, of_shares);
            (row.missed, row.error_of_missed, row.missed_squared) = (missed, of_missed, squared);
            row.agreement = agreement;
            row.agreement_count = u32::from_le_bytes(rest.array()?);
            row.cut_short = rest.array::<1>()? != [0];
            rows.push(row);
        }
        for (row, &count) in rows.iter_mut().zip(&counts) {
            let mut before = 0_u32;
            for _ in 0..count {
                before = before
                    .checked_add(rest.varint()?)
                    .ok_or(Stale::Malformed("has no such patch"))?;
                row.columns.push(before);
            }
        }
        let all = counts.iter().sum::<usize>();
        let planes = [rest.take(all)?, rest.take(all)?, rest.take(all)?, rest.take(all)?];
        let codes = rest.take(all)?;
        if !rest.0.is_empty() {
            return Err(Stale::Malformed("is too long"));
        }
        let mut at = 0;
        for (row, &count) in rows.iter_mut().zip(&counts) {
            for k in at..at + count {
                let [a, b, c, d] = planes.map(|plane| plane[k]);
                row.values.push(f64::from(f32::from_be_bytes([a, b, c, d])));
                row.errors.push(of_code(codes[k]));
            }
            at += count;
        }
        Ok(Self {
            scene: field("scene ")?,
            hash: field("hash ")?,
            version: number(field("version ")?)?,
            settings: field("settings ")?,
            rows,
        })
    }
}

/// The numbers of a row beside its entries, in the file's order.
fn shares(row: &ReferenceRow) -> [f64; 7] {
    [
        row.escaped,
        row.blocked,
        row.error_of_shares,
        row.missed,
        row.error_of_missed,
        row.missed_squared,
        row.agreement,
    ]
}

/// Seven bits a byte, the lowest first.
#[allow(clippy::cast_possible_truncation, reason = "seven bits")]
fn put(bytes: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

struct Cursor<'b>(&'b [u8]);

impl<'b> Cursor<'b> {
    fn take(&mut self, count: usize) -> Result<&'b [u8], Stale> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(Stale::Malformed("ends early"))?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Stale> {
        self.take(N)?.try_into().map_err(|_| Stale::Malformed("ends early"))
    }

    fn whole(&mut self) -> Result<u64, Stale> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn shares(&mut self) -> Result<[f64; 7], Stale> {
        let mut shares = [0.0; 7];
        for share in &mut shares {
            *share = f64::from_le_bytes(self.array()?);
        }
        Ok(shares)
    }

    fn varint(&mut self) -> Result<u32, Stale> {
        let mut value = 0;
        for shift in (0..35).step_by(7) {
            let [byte] = self.array()?;
            value |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return u32::try_from(value).map_err(|_| Stale::Malformed("has no such patch"));
            }
        }
        Err(Stale::Malformed("has no such patch"))
    }
}

/// The fewest rays over a row's hemisphere.
const RAYS_AT_LEAST: f64 = 65_536.0;

/// The mean squared difference of two estimates of the same rows, in their own variances: about 1 if both are right.
/// Over entries, ΣF, escaped and blocked. That one of the two has an entry and the other no ray to it is chance as far as
/// rays go: its variance is F over the rays of a row.
pub fn disagreement(a: &[ReferenceRow], b: &[ReferenceRow]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    let mut hold = |difference: f64, variance: f64| {
        // Closed forms and f32 are right to six digits, and say an error of less.
        if variance > 0.0 || difference.abs() > 1e-6 {
            sum += difference * difference / (variance + 1e-14);
            count += 1.0;
        }
    };
    for (a, b) in a.iter().zip(b) {
        assert_eq!(a.emitter, b.emitter, "the same rows");
        let mut entries = std::collections::BTreeMap::new();
        for (row, side) in [(a, 0), (b, 1)] {
            for ((&column, &value), &error) in row.columns.iter().zip(&row.values).zip(&row.errors) {
                entries.entry(column).or_insert([None; 2])[side] = Some((value, error));
            }
        }
        for sides in entries.into_values() {
            match sides {
                [Some((x, e)), Some((y, f))] => hold(x - y, e * e + f * f),
                [Some((x, e)), None] | [None, Some((x, e))] => hold(x, e * e + x / RAYS_AT_LEAST),
                [None, None] => {}
            }
        }
        hold(a.sum() - b.sum(), a.sum_noise().powi(2) + b.sum_noise().powi(2));
        let of_shares = a.error_of_shares.powi(2) + b.error_of_shares.powi(2);
        hold(a.escaped - b.escaped, of_shares);
        hold(a.blocked - b.blocked, of_shares);
    }
    sum / f64::max(count, 1.0)
}

/// The rows of some emitters by other random numbers.
///
/// # Panics
/// When one is no patch of the scene.
pub fn trace_again(ready: &Ready, emitters: &[InputPatch], target: f64, seed: u64) -> Vec<ReferenceRow> {
    let settings = ReferenceSettings {
        target,
        seed,
        ..SETTINGS
    };
    let reference = Reference::new(&ready.model, settings).expect("settings in range");
    reference.rows(emitters, 1, &mut |_| {}).expect("patches of the scene")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Golden {
        let row = |emitter, columns: &[u32], values: &[f64], errors: &[f64]| ReferenceRow {
            emitter,
            columns: columns.to_vec(),
            values: values.to_vec(),
            errors: errors.to_vec(),
            escaped: 0.125,
            blocked: 0.01,
            error_of_shares: 1e-3,
            missed: 1e-5,
            error_of_missed: 2e-5,
            missed_squared: 1e-9,
            agreement: 1.1,
            agreement_count: 3,
            rays: 1 << 40,
            cut_short: emitter == 9,
            ..ReferenceRow::default()
        };
        let rows = [
            row(
                3,
                &[0, 1, 300, 70_000],
                &[0.5, 0.25, 1e-9, 0.0625],
                &[1e-3, 0.0, 1e-9, 2e-4],
            ),
            row(9, &[], &[], &[]),
            row(4, &[4_000_000_000], &[1.0 / 3.0], &[1e-12]),
        ];
        Golden {
            scene: "some".to_owned(),
            hash: "0123".to_owned(),
            version: 7,
            settings: "target 1".to_owned(),
            rows: rows.iter().map(rounded).collect(),
        }
    }

    #[test]
    fn a_file_gives_back_its_rows() {
        let golden = some();
        let bytes = golden.pack();
        assert_eq!(Golden::unpack(&bytes).as_ref(), Ok(&golden));
        assert_eq!(bytes, golden.pack());
        // Codes are within 9 % of what they stand for.
        for error in [1e-12, 3.3e-7, 1.0, 0.02] {
            assert!((of_code(code_of(error)) / error - 1.0).abs() < 0.091, "{error}");
        }
        for end in [0, 5, 30, bytes.len() - 1] {
            assert!(Golden::unpack(&bytes[..end]).is_err(), "{end}");
        }
        let mut more = bytes;
        more[0] = b'x';
        assert_eq!(Golden::unpack(&more), Err(Stale::Malformed("is of another kind")));
    }

    #[test]
    fn rows_that_are_off_by_their_errors_agree_and_others_do_not() {
        let rows = some().rows;
        assert!(disagreement(&rows, &rows) < 1e-9);
        let mut off = rows.clone();
        off[0].values[0] += 2e-3;
        assert!((0.3..1.5).contains(&disagreement(&rows[..1], &off[..1])));
        off[0].values[1] += 1e-3;
        assert!(
            disagreement(&rows, &off) > 100.0,
            "an entry without an error must be right"
        );
        off = rows.clone();
        off[2].columns.clear();
        off[2].values.clear();
        off[2].errors.clear();
        assert!(
            disagreement(&rows, &off) > 100.0,
            "no ray to a third of the hemisphere is no chance"
        );
        off = rows.clone();
        off[1].escaped += 0.02;
        assert!(disagreement(&rows, &off) > 10.0);
    }
}
