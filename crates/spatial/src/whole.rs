//! Whole numbers of f64: a fraction is cut off, a number out of range becomes the nearest bound, NaN becomes 0.
//!
//! ```
//! use hemicube_spatial::whole;
//! assert_eq!([2.9, -1.0, 300.0, f64::NAN].map(whole::to_u8), [2, 0, 255, 0]);
//! assert_eq!(whole::to_u64(f64::INFINITY), u64::MAX);
//! ```

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the conversion that these functions are"
)]

/// From 0 to 2⁸ − 1.
pub const fn to_u8(number: f64) -> u8 {
    number as u8
}

/// From 0 to 2¹⁶ − 1.
pub const fn to_u16(number: f64) -> u16 {
    number as u16
}

/// From 0 to 2³² − 1.
pub const fn to_u32(number: f64) -> u32 {
    number as u32
}

/// From 0 to 2⁶⁴ − 1.
pub const fn to_u64(number: f64) -> u64 {
    number as u64
}

/// From 0 to the largest index.
pub const fn to_usize(number: f64) -> usize {
    number as usize
}
