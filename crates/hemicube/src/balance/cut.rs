//! Small entries left out of a row that is on its own: the others share what they carried, in proportion.

/// By how much a row may be scaled at most where nobody says: an entry by the square of it.
pub(crate) const MAX_SCALE: f64 = 1.1;

/// What becomes of the entries of a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cut {
    /// Entries below are left out; 0 where the row would lose too much, and keeps all.
    pub(crate) least: f64,
    /// The others are multiplied by this.
    pub(crate) scale: f64,
}

impl Default for Cut {
    fn default() -> Self {
        Self { least: 0.0, scale: 1.0 }
    }
}

impl Cut {
    /// For a row that sums to `whole`, and to `kept` without what is below `least`.
    pub(crate) fn new(whole: f64, kept: f64, least: f64, max_scale: f64) -> Self {
        if kept * max_scale * max_scale < whole {
            Self::default()
        } else if kept == whole {
            Self { least, scale: 1.0 }
        } else {
            Self {
                least,
                scale: whole / kept,
            }
        }
    }

    pub(crate) fn keeps(self, factor: f32) -> bool {
        f64::from(factor) >= self.least
    }

    pub(crate) fn of(self, factor: f32) -> f32 {
        if self.keeps(factor) {
            super::narrow(f64::from(factor) * self.scale)
        } else {
            0.0
        }
    }
}

/// What a row sums to, and what it sums to without the entries below `least`.
pub(crate) fn sums(factors: &[f32], least: f64) -> (f64, f64) {
    factors.iter().fold((0.0, 0.0), |(whole, kept), &factor| {
        let factor = f64::from(factor);
        (whole + factor, if factor >= least { kept + factor } else { kept })
    })
}
