//! Options common to the GPU backends.

use crate::limits::{Draw, Edges};
use crate::recording::Cull;
use hemicube_abi::Options;
use hemicube_contract::backend::BackendError;

/// The most hemicubes of a submission: more gain nothing on any device, and a driver may take it for hung.
pub const MOST_BATCH: u32 = 1024;

/// `edges`, `batch`, `group` and `timing`. `None`: left to the backend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Common {
    /// The judge of pixels near edges.
    pub edges: Option<Edges>,
    /// Hemicubes of a submission.
    pub batch: Option<u32>,
    /// Hemicubes side by side in the stages.
    pub group: Option<u32>,
    /// True if times are measured; slows down.
    pub timing: bool,
}

impl Common {
    /// Takes the common options. `most` bounds `batch` and `group`.
    ///
    /// # Errors
    /// [`BackendError::InvalidArgument`] for a value out of range.
    pub fn take(options: &mut Options<'_>, most: u32) -> Result<Self, BackendError> {
        let edges = match options.take("edges") {
            None => None,
            Some(value) => Some(Edges::parse(value).ok_or_else(|| wrong("edges", value, "`driver` or `exact`"))?),
        };
        Ok(Self {
            edges,
            batch: number(options, "batch", 1, most)?,
            group: number(options, "group", 1, most)?,
            timing: options.take_switch("timing")?.unwrap_or(false),
        })
    }
}

/// Takes a number from `least` to `most`.
///
/// # Errors
/// [`BackendError::InvalidArgument`] for anything else.
pub fn number(options: &mut Options<'_>, key: &str, least: u32, most: u32) -> Result<Option<u32>, BackendError> {
    let Some(value) = options.take(key) else {
        return Ok(None);
    };
    match value.parse() {
        Ok(number) if (least..=most).contains(&number) => Ok(Some(number)),
        _ if most == u32::MAX => Err(wrong(key, value, &format!("a number from {least}"))),
        _ => Err(wrong(key, value, &format!("a number from {least} to {most}"))),
    }
}

/// Takes one of several words.
///
/// # Errors
/// [`BackendError::InvalidArgument`] for any other.
pub fn choice<T: Copy>(options: &mut Options<'_>, key: &str, words: &[(&str, T)]) -> Result<Option<T>, BackendError> {
    let Some(value) = options.take(key) else {
        return Ok(None);
    };
    match words.iter().find(|(word, _)| *word == value) {
        Some(&(_, chosen)) => Ok(Some(chosen)),
        None => {
            let words: Vec<String> = words.iter().map(|(word, _)| format!("`{word}`")).collect();
            let (last, others) = words
                .split_last()
                .map_or((String::new(), String::new()), |(last, others)| {
                    (last.clone(), others.join(", "))
                });
            Err(wrong(key, value, &format!("{others} or {last}")))
        }
    }
}

/// Takes `cull` of a backend that culls on the device only. `None`: chosen by scene.
///
/// # Errors
/// [`BackendError::InvalidArgument`] for any other word.
pub fn device_cull(options: &mut Options<'_>) -> Result<Option<Cull>, BackendError> {
    let words = [
        ("auto", None),
        ("off", Some(Cull::Off)),
        ("frustum", Some(Cull::Frustum)),
        ("occlusion", Some(Cull::Occlusion)),
    ];
    Ok(choice(options, "cull", &words)?.flatten())
}

/// Takes `draw` of a backend that can draw by compute. `None`: as [`crate::probe`] finds. `culls`: culling was asked for.
///
/// # Errors
/// [`BackendError::InvalidArgument`] for any other word, and, unless it is `raster`, beside the driver's edges or
/// culling.
pub fn draw(options: &mut Options<'_>, edges: Option<Edges>, culls: bool) -> Result<Option<Draw>, BackendError> {
    let words = [
        ("raster", Some(Draw::Raster)),
        ("compute", Some(Draw::Compute)),
        ("auto", None),
    ];
    let draw = choice(options, "draw", &words)?.unwrap_or(Some(Draw::Raster));
    let word = if draw.is_some() { "compute" } else { "auto" };
    if draw != Some(Draw::Raster) && edges == Some(Edges::Driver) {
        return Err(BackendError::InvalidArgument(format!(
            "`draw=compute` has no driver's edges: leave out `edges=driver`, or take `draw=raster` in place of \
             `draw={word}`"
        )));
    }
    if draw != Some(Draw::Raster) && culls {
        return Err(BackendError::InvalidArgument(format!(
            "`draw=compute` leaves out what a tile cannot see: leave out `cull`, or take `draw=raster` in place of \
             `draw={word}`"
        )));
    }
    Ok(draw)
}

/// Takes a number of bytes.
///
/// # Errors
/// [`BackendError::InvalidArgument`] for anything else.
pub fn bytes(options: &mut Options<'_>, key: &str) -> Result<Option<u64>, BackendError> {
    let Some(value) = options.take(key) else {
        return Ok(None);
    };
    value
        .parse()
        .map(Some)
        .map_err(|_| wrong(key, value, "a number of bytes"))
}

fn wrong(key: &str, value: &str, allowed: &str) -> BackendError {
    BackendError::InvalidArgument(format!("option `{key}` is `{value}`; it is {allowed}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_value_is_named_with_those_allowed() {
        let mut options = Options::parse("edges=sharp").expect("key=value");
        let error = Common::take(&mut options, MOST_BATCH)
            .expect_err("not an edge")
            .to_string();
        assert!(
            error.contains("`sharp`") && error.contains("`driver` or `exact`"),
            "{error}"
        );
        let mut options = Options::parse("cull=perhaps,batch=1025").expect("key=value");
        let error = choice(&mut options, "cull", &[("auto", 0), ("off", 1), ("frustum", 2)]).expect_err("no word");
        assert!(error.to_string().contains("`auto`, `off` or `frustum`"), "{error}");
        let error = Common::take(&mut options, MOST_BATCH)
            .expect_err("too many")
            .to_string();
        assert!(error.contains("a number from 1 to 1024"), "{error}");
    }
}
