//! Code compiled for several instruction sets, and the one in use.
//!
//! No `multiversion` crate, because its functions choose for themselves: here a test can ask for each instruction set,
//! and whoever calls in a loop asks the processor once.

/// An instruction set that this processor has: whoever holds one may call what is compiled for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionSet(Kind);

/// Which it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// What every processor of the target has.
    Portable,
    /// AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 F, BW, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// The widest.
    #[inline]
    pub fn widest() -> Self {
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

    /// Which it is.
    #[inline]
    pub fn kind(self) -> Kind {
        self.0
    }

    /// All that there are, the narrowest first: for tests.
    pub fn all() -> Vec<Self> {
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

/// Defines a function that calls `$body`, an `#[inline(always)]` function, as compiled for an [`InstructionSet`], its
/// first argument. All give the same bits: there is no fused multiply-add, and no sum changes its order.
#[doc(hidden)]
#[macro_export]
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

pub use dispatch;
