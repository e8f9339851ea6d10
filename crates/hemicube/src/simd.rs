//! Code compiled for several instruction sets, the one in use, and the arithmetic of a lane.
//!
//! No `multiversion` crate, because its functions choose for themselves: here a test can ask for each instruction set,
//! and whoever calls in a loop asks the processor once.

/// An instruction set that this processor has: whoever holds one may call what is compiled for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct InstructionSet(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 F, BW, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// The widest.
    #[inline]
    pub(crate) fn widest() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                return Self(Kind::Avx512);
            }
            if is_x86_feature_detected!("avx2") {
                return Self(Kind::Avx2);
            }
        }
        Self(Kind::Portable)
    }

    #[inline]
    pub(crate) fn kind(self) -> Kind {
        self.0
    }

    /// All that there are, the narrowest first.
    #[cfg(test)]
    pub(crate) fn all() -> Vec<Self> {
        let mut all = vec![Self(Kind::Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            let widest = Self::widest();
            if widest == Self(Kind::Avx512) || is_x86_feature_detected!("avx2") {
                all.push(Self(Kind::Avx2));
            }
            if widest == Self(Kind::Avx512) {
                all.push(widest);
            }
        }
        all
    }
}

/// The lesser of two numbers; `q` where one is NaN. One instruction of every set, unlike [`f64::min`].
#[inline(always)]
pub(crate) fn least(p: f64, q: f64) -> f64 {
    if p < q { p } else { q }
}

/// The greater of two numbers; `q` where one is NaN.
#[inline(always)]
pub(crate) fn most(p: f64, q: f64) -> f64 {
    if p > q { p } else { q }
}

/// p + q.
#[inline(always)]
pub(crate) fn plus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[0] + q[0], p[1] + q[1], p[2] + q[2]]
}

/// p − q.
#[inline(always)]
pub(crate) fn minus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[0] - q[0], p[1] - q[1], p[2] - q[2]]
}

/// p · q.
#[inline(always)]
pub(crate) fn dot(p: [f64; 3], q: [f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

/// p × q.
#[inline(always)]
pub(crate) fn cross(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    ]
}

/// A bit for each lane that is not 0.
#[inline(always)]
pub(crate) fn mask(lanes: &[u64; 16]) -> u16 {
    let mut mask = 0;
    for (l, &lane) in lanes.iter().enumerate() {
        mask |= u16::from(lane != 0) << l;
    }
    mask
}

/// The lanes whose bits are set, ascending.
#[inline(always)]
pub(crate) fn lanes(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            lane
        })
    })
}

/// Defines a function that calls `$body`, an `#[inline(always)]` function, as compiled for an [`InstructionSet`], its
/// first argument. All give the same bits: there is no fused multiply-add, and no sum changes its order.
macro_rules! dispatch {
    ($(#[$doc:meta])* $vis:vis fn $name:ident = $body:ident($($arg:ident: $type:ty),* $(,)?) $(-> $out:ty)?) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments, reason = "one more than the body has")]
        #[allow(unsafe_code, reason = "what is compiled for an instruction set is called by whoever holds its token")]
        $vis fn $name(set: $crate::simd::InstructionSet, $($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
            fn avx512($($arg: $type),*) $(-> $out)? {
                $body($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn avx2($($arg: $type),*) $(-> $out)? {
                $body($($arg),*)
            }
            match set.kind() {
                $crate::simd::Kind::Portable => $body($($arg),*),
                // SAFETY: the token says that the processor has AVX2.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::Kind::Avx2 => unsafe { avx2($($arg),*) },
                // SAFETY: the token says that the processor has AVX-512 F, BW, DQ and VL.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::Kind::Avx512 => unsafe { avx512($($arg),*) },
            }
        }
    };
}

pub(crate) use dispatch;
