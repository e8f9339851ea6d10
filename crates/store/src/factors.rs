//! Form factors in memory: f32, or f64 where the store's form is double.
//!
//! Readers ask for f64 and get it exactly from either. Writers round by [`Precision::round`].

use super::{Element, ElementType};

/// Width of stored form factors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// f32: 24 bits, relative rounding errors up to 6 · 10⁻⁸.
    #[default]
    Single,
    /// f64: 53 bits, up to 1.1 · 10⁻¹⁶.
    Double,
}

impl Precision {
    /// Bytes of a number.
    pub const fn size(self) -> usize {
        match self {
            Self::Single => 4,
            Self::Double => 8,
        }
    }

    /// The NumPy type.
    pub const fn element(self) -> ElementType {
        match self {
            Self::Single => ElementType::F32,
            Self::Double => ElementType::F64,
        }
    }

    /// Largest relative rounding error: half a unit in the last place.
    pub const fn rounding(self) -> f64 {
        match self {
            Self::Single => 0.5 * f32::EPSILON as f64,
            Self::Double => 0.5 * f64::EPSILON,
        }
    }

    /// Rounds a number to nearest, ties to even.
    ///
    /// ```
    /// use hemicube_store::Precision;
    /// assert_eq!(Precision::Single.round(0.1), f64::from(0.1_f32));
    /// assert_eq!(Precision::Double.round(0.1), 0.1);
    /// ```
    #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
    pub fn round(self, number: f64) -> f64 {
        match self {
            Self::Single => f64::from(number as f32),
            Self::Double => number,
        }
    }

    /// Appends the bytes of a number, little-endian.
    #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
    pub fn put(self, number: f64, bytes: &mut Vec<u8>) {
        match self {
            Self::Single => bytes.extend_from_slice(&(number as f32).to_le_bytes()),
            Self::Double => bytes.extend_from_slice(&number.to_le_bytes()),
        }
    }

    /// The number at the start of some bytes of [`Self::put`]; NaN for too few.
    pub fn get(self, bytes: &[u8]) -> f64 {
        match self {
            Self::Single => bytes
                .first_chunk()
                .map_or(f64::NAN, |&four| f32::from_le_bytes(four).into()),
            Self::Double => bytes.first_chunk().map_or(f64::NAN, |&eight| f64::from_le_bytes(eight)),
        }
    }

    /// The fewest digits that read back to the same number of this width, as `1.5e-3`.
    #[allow(clippy::cast_possible_truncation, reason = "a number of this width")]
    pub fn digits(self, number: f64) -> impl std::fmt::Display {
        struct Digits(Precision, f64);
        impl std::fmt::Display for Digits {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match self.0 {
                    Precision::Single => write!(f, "{:e}", self.1 as f32),
                    Precision::Double => write!(f, "{:e}", self.1),
                }
            }
        }
        Digits(self, number)
    }
}

/// Form factors of a part or a row.
///
/// ```
/// use hemicube_store::{FactorVec, Precision};
///
/// let mut factors = FactorVec::new(Precision::Double);
/// factors.push(0.1);
/// assert_eq!(factors.at(0), 0.1);
/// let single = FactorVec::from(vec![0.1_f32, 0.25]);
/// assert_eq!(single.iter().collect::<Vec<f64>>(), [f64::from(0.1_f32), 0.25]);
/// assert_eq!(single.as_slice().to_single(), [0.1, 0.25]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum FactorVec {
    /// f32, in the plain and the compact form.
    Single(Vec<f32>),
    /// f64, in the double form.
    Double(Vec<f64>),
}

/// Form factors borrowed from a [`FactorVec`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FactorSlice<'a> {
    /// f32, in the plain and the compact form.
    Single(&'a [f32]),
    /// f64, in the double form.
    Double(&'a [f64]),
}

impl Default for FactorVec {
    fn default() -> Self {
        Self::Single(Vec::new())
    }
}

impl Default for FactorSlice<'_> {
    fn default() -> Self {
        Self::Single(&[])
    }
}

impl From<Vec<f32>> for FactorVec {
    fn from(factors: Vec<f32>) -> Self {
        Self::Single(factors)
    }
}

impl From<Vec<f64>> for FactorVec {
    fn from(factors: Vec<f64>) -> Self {
        Self::Double(factors)
    }
}

impl PartialEq<[f32]> for FactorVec {
    fn eq(&self, other: &[f32]) -> bool {
        matches!(self, Self::Single(factors) if factors == other)
    }
}

impl PartialEq<Vec<f32>> for FactorVec {
    fn eq(&self, other: &Vec<f32>) -> bool {
        *self == other[..]
    }
}

/// Runs the same expression on either kind of vector or slice.
macro_rules! either {
    ($of:expr, $name:ident => $body:expr) => {
        match $of {
            Self::Single($name) => $body,
            Self::Double($name) => $body,
        }
    };
}

impl FactorVec {
    /// No form factors yet, of this width.
    pub const fn new(precision: Precision) -> Self {
        match precision {
            Precision::Single => Self::Single(Vec::new()),
            Precision::Double => Self::Double(Vec::new()),
        }
    }

    /// `count` zeros of this width.
    pub fn zeros(precision: Precision, count: usize) -> Self {
        match precision {
            Precision::Single => Self::Single(vec![0.0; count]),
            Precision::Double => Self::Double(vec![0.0; count]),
        }
    }

    /// The width.
    pub const fn precision(&self) -> Precision {
        self.as_slice().precision()
    }

    /// Number of form factors.
    pub const fn len(&self) -> usize {
        self.as_slice().len()
    }

    /// Returns whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All of them.
    pub const fn as_slice(&self) -> FactorSlice<'_> {
        match self {
            Self::Single(factors) => FactorSlice::Single(factors.as_slice()),
            Self::Double(factors) => FactorSlice::Double(factors.as_slice()),
        }
    }

    /// Form factors in a range of places; `None` beyond the last.
    pub fn get(&self, range: std::ops::Range<usize>) -> Option<FactorSlice<'_>> {
        self.as_slice().get(range)
    }

    /// Form factors from a place on; none beyond the last.
    pub fn tail(&self, start: usize) -> FactorSlice<'_> {
        self.get(start..self.len()).unwrap_or_default()
    }

    /// The form factor at a place.
    ///
    /// # Panics
    /// Beyond the last.
    pub fn at(&self, place: usize) -> f64 {
        self.as_slice().at(place)
    }

    /// Rounds and stores a form factor at a place.
    ///
    /// # Panics
    /// Beyond the last.
    #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
    pub fn set(&mut self, place: usize, factor: f64) {
        match self {
            Self::Single(factors) => factors[place] = factor as f32,
            Self::Double(factors) => factors[place] = factor,
        }
    }

    /// Rounds and appends a form factor.
    #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
    #[inline]
    pub fn push(&mut self, factor: f64) {
        match self {
            Self::Single(factors) => factors.push(factor as f32),
            Self::Double(factors) => factors.push(factor),
        }
    }

    /// Rounds and appends a form factor that is above 0 as rounded. Returns whether it is.
    #[inline]
    #[doc(hidden)]
    pub fn push_positive(&mut self, factor: f64) -> bool {
        let is_positive = self.precision().round(factor) > 0.0;
        if is_positive {
            self.push(factor);
        }
        is_positive
    }

    /// Appends others, rounded.
    pub fn extend(&mut self, others: FactorSlice<'_>) {
        match (self, others) {
            (Self::Single(factors), FactorSlice::Single(others)) => factors.extend_from_slice(others),
            (Self::Double(factors), FactorSlice::Double(others)) => factors.extend_from_slice(others),
            (factors, others) => others.iter().for_each(|factor| factors.push(factor)),
        }
    }

    /// Copies form factors to a place and on. Returns false for another width, and beyond the last.
    #[doc(hidden)]
    pub fn place(&mut self, start: usize, factors: FactorSlice<'_>) -> bool {
        fn copied<T: Copy>(all: &mut [T], start: usize, factors: &[T]) -> bool {
            let range = start..start.saturating_add(factors.len());
            let slot = all.get_mut(range);
            slot.map(|slot| slot.copy_from_slice(factors)).is_some()
        }
        match (self, factors) {
            (Self::Single(all), FactorSlice::Single(factors)) => copied(all, start, factors),
            (Self::Double(all), FactorSlice::Double(factors)) => copied(all, start, factors),
            _ => false,
        }
    }

    /// Drops those from a place on.
    pub fn truncate(&mut self, len: usize) {
        either!(self, factors => factors.truncate(len));
    }

    /// Drops all.
    pub fn clear(&mut self) {
        self.truncate(0);
    }

    /// The form factors, exact.
    pub fn iter(&self) -> FactorIter<'_> {
        self.as_slice().iter()
    }

    /// The form factors, exact.
    pub fn into_f64(self) -> Vec<f64> {
        match self {
            Self::Single(factors) => factors.into_iter().map(f64::from).collect(),
            Self::Double(factors) => factors,
        }
    }
}

impl<'a> FactorSlice<'a> {
    /// The width.
    pub const fn precision(self) -> Precision {
        match self {
            Self::Single(_) => Precision::Single,
            Self::Double(_) => Precision::Double,
        }
    }

    /// Number of form factors.
    pub const fn len(self) -> usize {
        either!(self, factors => factors.len())
    }

    /// Returns whether there are none.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Form factors in a range of places; `None` beyond the last.
    pub fn get(self, range: std::ops::Range<usize>) -> Option<FactorSlice<'a>> {
        Some(match self {
            Self::Single(factors) => Self::Single(factors.get(range)?),
            Self::Double(factors) => Self::Double(factors.get(range)?),
        })
    }

    /// The form factor at a place.
    ///
    /// # Panics
    /// Beyond the last.
    pub fn at(self, place: usize) -> f64 {
        match self {
            Self::Single(factors) => factors[place].into(),
            Self::Double(factors) => factors[place],
        }
    }

    /// The form factors, exact.
    pub fn iter(self) -> FactorIter<'a> {
        match self {
            Self::Single(factors) => FactorIter::Single(factors.iter()),
            Self::Double(factors) => FactorIter::Double(factors.iter()),
        }
    }

    /// Rounded to f32.
    #[allow(clippy::cast_possible_truncation, reason = "rounding to f32 is asked for")]
    pub fn to_single(self) -> Vec<f32> {
        match self {
            Self::Single(factors) => factors.to_vec(),
            Self::Double(factors) => factors.iter().map(|&factor| factor as f32).collect(),
        }
    }

    /// A copy.
    pub fn to_vec(self) -> FactorVec {
        match self {
            Self::Single(factors) => FactorVec::Single(factors.to_vec()),
            Self::Double(factors) => FactorVec::Double(factors.to_vec()),
        }
    }

    /// The sum, in eight sums, so that none waits for the one before.
    #[doc(hidden)]
    pub fn sum(self) -> f64 {
        match self {
            Self::Single(factors) => in_eight(factors),
            Self::Double(factors) => in_eight(factors),
        }
    }
}

fn in_eight<T: Copy + Into<f64>>(values: &[T]) -> f64 {
    let mut sums = [0.0; 8];
    let chunks = values.chunks_exact(sums.len());
    let rest: f64 = chunks.remainder().iter().map(|&value| -> f64 { value.into() }).sum();
    for chunk in chunks {
        for (sum, &value) in sums.iter_mut().zip(chunk) {
            *sum += value.into();
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Exact form factors, one by one.
#[derive(Clone, Debug)]
pub enum FactorIter<'a> {
    /// From f32.
    Single(std::slice::Iter<'a, f32>),
    /// From f64.
    Double(std::slice::Iter<'a, f64>),
}

impl Iterator for FactorIter<'_> {
    type Item = f64;

    #[inline]
    fn next(&mut self) -> Option<f64> {
        match self {
            Self::Single(factors) => factors.next().map(|&factor| factor.into()),
            Self::Double(factors) => factors.next().copied(),
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        either!(self, factors => factors.size_hint())
    }

    // The width is asked for once.
    fn fold<B, F: FnMut(B, f64) -> B>(self, init: B, mut f: F) -> B {
        match self {
            Self::Single(factors) => factors.fold(init, |sum, &factor| f(sum, factor.into())),
            Self::Double(factors) => factors.fold(init, |sum, &factor| f(sum, factor)),
        }
    }
}

impl ExactSizeIterator for FactorIter<'_> {}

impl<'a> IntoIterator for &'a FactorVec {
    type Item = f64;
    type IntoIter = FactorIter<'a>;

    fn into_iter(self) -> FactorIter<'a> {
        self.iter()
    }
}

impl<'a> IntoIterator for FactorSlice<'a> {
    type Item = f64;
    type IntoIter = FactorIter<'a>;

    fn into_iter(self) -> FactorIter<'a> {
        self.iter()
    }
}

/// A number of a [`FactorVec`] in hot loops over one width.
pub trait Number: Copy + Into<f64> + Element {}

impl Number for f32 {}
impl Number for f64 {}
