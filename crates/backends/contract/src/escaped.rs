//! The pixels of a hemicube that show nothing of the scene.

use crate::delta::DeltaTable;
use crate::face::{Face, Items};

/// The escaped pixels of one hemicube: one bit a pixel, in the atlas's order. Each row of the atlas ([`crate::face`])
/// begins a word; pixel x of a row is bit x mod 64 of its word x / 64.
///
/// ```
/// use hemicube_contract::backend::WHOLE;
/// use hemicube_contract::delta::DeltaTable;
/// use hemicube_contract::escaped::EscapedPixels;
/// use hemicube_contract::face::{Items, pixel_count};
///
/// let mut items = Items { resolution: 32, seen: vec![Items::ESCAPED; pixel_count(32)] };
/// items.seen[..32].fill(3);
/// let table = DeltaTable::new(32);
/// let mut escaped = EscapedPixels::default();
/// escaped.take(&items, &table);
/// assert_eq!((escaped.row(0), escaped.row(1)), (&[0][..], &[0xFFFF_FFFF][..]));
/// assert_eq!(escaped.weight(&table), WHOLE - table.span(hemicube_contract::face::Face::Top, 0, 0, 32));
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EscapedPixels {
    resolution: u32,
    words: Vec<u64>,
    /// The weight of the pixels that show backs of one-sided patches, of 2³¹.
    pub blocked: u32,
}

impl EscapedPixels {
    /// Pixels along the edge of the top face.
    pub fn resolution(&self) -> u32 {
        self.resolution
    }

    /// Words of a row of the atlas.
    fn words_of_row(&self) -> usize {
        self.resolution.div_ceil(64) as usize
    }

    /// Sets the resolution and takes all bits away.
    pub fn clear(&mut self, resolution: u32) {
        self.resolution = resolution;
        self.words.clear();
        self.words.resize(3 * resolution as usize * self.words_of_row(), 0);
        self.blocked = 0;
    }

    /// The bits of a row of the atlas, from 0 to 3N − 1.
    pub fn row(&self, row: u32) -> &[u64] {
        let words = self.words_of_row();
        &self.words[row as usize * words..][..words]
    }

    /// [`Self::row`], to be written. Bits of pixels from N on stay 0.
    pub fn row_mut(&mut self, row: u32) -> &mut [u64] {
        let words = self.words_of_row();
        &mut self.words[row as usize * words..][..words]
    }

    /// Takes what an item buffer says.
    pub fn take(&mut self, items: &Items, table: &DeltaTable) {
        self.clear(items.resolution);
        let mut seen = items.seen.iter();
        for face in Face::ALL {
            for y in 0..face.rows(items.resolution) {
                let row = face.first_row(items.resolution) + y;
                for x in 0..items.resolution {
                    match seen.next() {
                        Some(&Items::ESCAPED) => self.row_mut(row)[x as usize / 64] |= 1 << (x % 64),
                        Some(&Items::BLOCKED) => self.blocked += table.weight(face, x, y),
                        _ => {}
                    }
                }
            }
        }
    }

    /// The weight of all escaped pixels, of 2³¹.
    pub fn weight(&self, table: &DeltaTable) -> u32 {
        let mut sum = 0;
        for face in Face::ALL {
            for y in 0..face.rows(self.resolution) {
                let row = self.row(face.first_row(self.resolution) + y);
                for run in runs(row) {
                    sum += table.span(face, y, run.start, run.end);
                }
            }
        }
        sum
    }
}

/// The runs of set bits of a row, ascending: ranges of pixels.
pub fn runs(row: &[u64]) -> impl Iterator<Item = std::ops::Range<u32>> {
    /// The first pixel from `from` on whose bit is `set`, or the row's end.
    fn next(row: &[u64], from: u32, set: bool) -> u32 {
        let flip = if set { 0 } else { u64::MAX };
        let mut word = from as usize / 64;
        let mut mask = u64::MAX << (from % 64);
        while let Some(&bits) = row.get(word) {
            let bits = (bits ^ flip) & mask;
            if bits != 0 {
                #[allow(clippy::cast_possible_truncation, reason = "a row has at most 1024 pixels")]
                return word as u32 * 64 + bits.trailing_zeros();
            }
            mask = u64::MAX;
            word += 1;
        }
        #[allow(clippy::cast_possible_truncation, reason = "a row has at most 1024 pixels")]
        let end = row.len() as u32 * 64;
        end
    }
    let mut at = 0;
    std::iter::from_fn(move || {
        let begin = next(row, at, true);
        at = next(row, begin, false);
        (begin < at).then_some(begin..at)
    })
}

#[cfg(test)]
mod tests {
    use super::runs;

    #[test]
    fn runs_are_found_within_and_over_words() {
        let found = |row: &[u64]| runs(row).map(|run| [run.start, run.end]).collect::<Vec<_>>();
        assert!(found(&[0, 0]).is_empty());
        assert_eq!(found(&[u64::MAX, u64::MAX]), [[0, 128]]);
        assert_eq!(found(&[1 << 63 | 1, 0b101]), [[0, 1], [63, 65], [66, 67]]);
        assert_eq!(found(&[0xFFFF_FFFF]), [[0, 32]]);
    }
}
