//! Weights added up by patch, sets of patches, and an index of a list by id.

use hemicube_contract::bvh::UNUSED;

/// Sums for each patch, for blocked and for nothing, with the set of the non-zero ones.
#[derive(Debug)]
pub(crate) struct Sums {
    /// Upper half: visible pixels, or with engine `order` covered weight. Lower half: visible weight.
    pub(crate) of: Vec<u64>,
    /// Ids with a non-zero sum.
    touched: PatchSet,
}

impl Sums {
    pub(crate) fn new(count: usize) -> Self {
        Self {
            of: vec![0; count],
            touched: PatchSet::new(count),
        }
    }

    #[inline(always)]
    pub(crate) fn add(&mut self, id: u32, pixels: u32, weight: u32) {
        let index = id as usize;
        let sum = self.of[index];
        if sum == 0 {
            self.touched.insert(id);
        }
        // The weights of a hemicube sum to 2³¹, so the lower half never carries into the upper.
        self.of[index] = sum + (u64::from(pixels) << 32 | u64::from(weight));
    }

    /// Sets bits in the upper half of a non-zero sum.
    #[inline(always)]
    pub(crate) fn mark(&mut self, id: u32, bits: u32) {
        self.of[id as usize] |= u64::from(bits) << 32;
    }

    /// Calls `each(id, upper half, weight)` in ascending order of id, and clears the sums.
    #[inline]
    pub(crate) fn drain(&mut self, mut each: impl FnMut(u32, u32, u32)) {
        let of = &mut self.of;
        self.touched.drain(|id| {
            let sum = std::mem::take(&mut of[id as usize]);
            #[allow(clippy::cast_possible_truncation, reason = "the halves of a u64")]
            each(id, (sum >> 32) as u32, sum as u32);
        });
    }
}

/// A set of ids, drained in ascending order.
#[derive(Debug)]
pub(crate) struct PatchSet {
    /// One bit for each id.
    bits: Vec<u64>,
    /// One bit for each non-zero word of `bits`.
    words: Vec<u64>,
}

impl PatchSet {
    pub(crate) fn new(count: usize) -> Self {
        let words = count.div_ceil(64);
        Self {
            bits: vec![0; words],
            words: vec![0; words.div_ceil(64)],
        }
    }

    #[inline(always)]
    pub(crate) fn insert(&mut self, patch: u32) {
        let index = patch as usize;
        self.bits[index >> 6] |= 1 << (index & 63);
        self.words[index >> 12] |= 1 << (index >> 6 & 63);
    }

    /// Empties the set in ascending order.
    #[inline]
    pub(crate) fn drain(&mut self, mut each: impl FnMut(u32)) {
        for group in 0..self.words.len() {
            let mut words = std::mem::take(&mut self.words[group]);
            while words != 0 {
                let word = group * 64 + words.trailing_zeros() as usize;
                words &= words - 1;
                let mut bits = std::mem::take(&mut self.bits[word]);
                while bits != 0 {
                    #[allow(clippy::cast_possible_truncation, reason = "an id that was inserted")]
                    let id = (word * 64) as u32 + bits.trailing_zeros();
                    bits &= bits - 1;
                    each(id);
                }
            }
        }
    }
}

/// Index of a list by id: for each indexed id, a chain of its places from the last to the first.
#[derive(Debug, Default)]
pub(crate) struct RunIndex {
    /// Last place of each id, plus 1; [`UNUSED`] for ids without an index.
    last: Vec<u32>,
    /// For each place, the previous one of the id, plus 1.
    previous: Vec<u32>,
}

impl RunIndex {
    /// Indexes `ids`, all below `count`.
    pub(crate) fn new(count: usize, ids: impl Iterator<Item = u32>) -> Self {
        let mut last = vec![UNUSED; count];
        ids.for_each(|id| last[id as usize] = 0);
        Self {
            last,
            previous: Vec::new(),
        }
    }

    /// Returns true if the index has ids at all.
    pub(crate) fn is_used(&self) -> bool {
        !self.last.is_empty()
    }

    /// Returns true if the id is indexed.
    #[inline(always)]
    pub(crate) fn has(&self, id: u32) -> bool {
        self.last[id as usize] != UNUSED
    }

    /// Adds the list's next place, of `id`.
    #[inline(always)]
    pub(crate) fn add(&mut self, id: u32) {
        let last = &mut self.last[id as usize];
        self.previous.push(*last);
        if *last != UNUSED {
            #[allow(clippy::cast_possible_truncation, reason = "fewer than pixels of an atlas")]
            {
                *last = self.previous.len() as u32;
            }
        }
    }

    /// Skips the list's next place.
    pub(crate) fn skip(&mut self) {
        self.previous.push(0);
    }

    /// Places of an id, from the last to the first.
    pub(crate) fn of(&self, id: u32) -> impl Iterator<Item = usize> + use<'_> {
        let mut next = self.last[id as usize];
        std::iter::from_fn(move || {
            (next != 0).then(|| {
                let place = next as usize - 1;
                next = self.previous[place];
                place
            })
        })
    }

    /// Forgets the places of an id.
    pub(crate) fn forget(&mut self, id: u32) {
        self.last[id as usize] = 0;
    }

    /// Begins a new list; the places of all ids must have been forgotten.
    pub(crate) fn clear(&mut self) {
        self.previous.clear();
    }
}
