//! Bytes, many at a time: by AVX2 where the processor has it, by plain loops elsewhere, to the same result.
//!
//! The compiler does not find these instructions by itself: it left a third of the loops below as branches.

/// Bytes of a register.
pub(crate) const LANES: usize = 32;

/// The least whole number of lanes, as values, that holds so many.
pub(crate) fn lanes_for(count: usize) -> usize {
    count.next_multiple_of(LANES)
}

/// Registers of bytes, and what is done with them, lane by lane.
pub(crate) trait Lanes: Copy {
    /// Bytes.
    type Bytes: Copy;

    /// Loads a register.
    fn bytes(self, from: &[u8; LANES]) -> Self::Bytes;
    /// Stores a register.
    fn store_bytes(self, bytes: Self::Bytes, to: &mut [u8; LANES]);
    /// The same byte in all lanes.
    fn all_bytes(self, byte: u8) -> Self::Bytes;
    /// The lower of two.
    fn min_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The sum, at most 255.
    fn add_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The mean, rounded up.
    fn mean_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The difference, at least 0.
    fn sub_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The number of bits in which two differ.
    fn differing_bits(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The lowest of all lanes.
    fn lowest_byte(self, bytes: Self::Bytes) -> u8;
    /// `then` where `a` is no more than two above `b`, modulo 256; otherwise `other`.
    fn where_near(self, a: Self::Bytes, b: Self::Bytes, then: Self::Bytes, other: Self::Bytes) -> Self::Bytes;
    /// Sets `bit` where a word is no less than another.
    fn mark(self, bytes: Self::Bytes, bit: u8, word: &[u16; LANES], other: &[u16; LANES]) -> Self::Bytes;
    /// A bit for each lane in which two are the same, the first lane's lowest.
    fn same(self, a: Self::Bytes, b: Self::Bytes) -> u32;
}

/// Work that is done with registers. All of it is inlined, so that it is compiled for each kind of processor.
pub(crate) trait Kernel {
    /// Does it; with `#[inline(always)]`.
    fn run<L: Lanes>(self, lanes: L);
}

/// Runs with the best registers that there are.
pub(crate) fn run<K: Kernel>(kernel: K) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        simd.vectorize(avx2::Vectorized(kernel, simd));
        return;
    }
    kernel.run(Plain);
}

/// Without registers of the processor.
#[derive(Clone, Copy)]
pub(crate) struct Plain;

#[inline(always)]
fn zip<T: Copy, const N: usize>(mut a: [T; N], b: [T; N], of: impl Fn(T, T) -> T) -> [T; N] {
    for k in 0..N {
        a[k] = of(a[k], b[k]);
    }
    a
}

impl Lanes for Plain {
    type Bytes = [u8; LANES];

    #[inline(always)]
    fn bytes(self, from: &[u8; LANES]) -> Self::Bytes {
        *from
    }
    #[inline(always)]
    fn store_bytes(self, bytes: Self::Bytes, to: &mut [u8; LANES]) {
        *to = bytes;
    }
    #[inline(always)]
    fn all_bytes(self, byte: u8) -> Self::Bytes {
        [byte; LANES]
    }
    #[inline(always)]
    fn min_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes {
        zip(a, b, u8::min)
    }
    #[inline(always)]
    fn add_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes {
        zip(a, b, u8::saturating_add)
    }
    #[inline(always)]
    fn mean_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes {
        zip(a, b, |a, b| (u16::from(a) + u16::from(b)).div_ceil(2) as u8)
    }
    #[inline(always)]
    fn sub_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes {
        zip(a, b, u8::saturating_sub)
    }
    #[inline(always)]
    fn differing_bits(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes {
        zip(a, b, |a, b| (a ^ b).count_ones() as u8)
    }
    #[inline(always)]
    fn lowest_byte(self, bytes: Self::Bytes) -> u8 {
        bytes.iter().fold(u8::MAX, |a, b| a.min(*b))
    }
    #[inline(always)]
    fn where_near(self, a: Self::Bytes, b: Self::Bytes, then: Self::Bytes, mut other: Self::Bytes) -> Self::Bytes {
        for k in 0..LANES {
            other[k] = if a[k].wrapping_sub(b[k]) <= 2 { then[k] } else { other[k] };
        }
        other
    }
    #[inline(always)]
    fn mark(self, mut bytes: Self::Bytes, bit: u8, word: &[u16; LANES], other: &[u16; LANES]) -> Self::Bytes {
        for k in 0..LANES {
            bytes[k] |= if word[k] >= other[k] { bit } else { 0 };
        }
        bytes
    }
    #[inline(always)]
    fn same(self, a: Self::Bytes, b: Self::Bytes) -> u32 {
        (0..LANES).fold(0, |bits, k| bits | u32::from(a[k] == b[k]) << k)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Kernel, LANES, Lanes};
    use pulp::cast;
    use pulp::x86::V3;
    use std::arch::x86_64::__m256i;

    /// A kernel that is compiled for AVX2.
    pub(super) struct Vectorized<K>(pub(super) K, pub(super) V3);

    impl<K: Kernel> pulp::NullaryFnOnce for Vectorized<K> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            self.0.run(self.1);
        }
    }

    impl Lanes for V3 {
        type Bytes = __m256i;

        #[inline(always)]
        fn bytes(self, from: &[u8; LANES]) -> __m256i {
            cast(*from)
        }
        #[inline(always)]
        fn store_bytes(self, bytes: __m256i, to: &mut [u8; LANES]) {
            *to = cast(bytes);
        }
        #[inline(always)]
        fn all_bytes(self, byte: u8) -> __m256i {
            self.avx._mm256_set1_epi8(byte.cast_signed())
        }
        #[inline(always)]
        fn min_bytes(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_min_epu8(a, b)
        }
        #[inline(always)]
        fn add_bytes(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_adds_epu8(a, b)
        }
        #[inline(always)]
        fn mean_bytes(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_avg_epu8(a, b)
        }
        #[inline(always)]
        fn sub_bytes(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_subs_epu8(a, b)
        }
        /// By a table of the bits in half a byte (Mula, Kurz and Lemire, "Faster population counts using AVX2 instructions", 2018).
        #[inline(always)]
        fn differing_bits(self, a: __m256i, b: __m256i) -> __m256i {
            const OF_HALF: [u8; 16] = [0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4];
            let (table, low) = (cast([OF_HALF, OF_HALF]), self.all_bytes(0x0f));
            let bits = self.avx2._mm256_xor_si256(a, b);
            let lower = self.avx2._mm256_and_si256(bits, low);
            let upper = self.avx2._mm256_and_si256(self.avx2._mm256_srli_epi16::<4>(bits), low);
            let count = |half| self.avx2._mm256_shuffle_epi8(table, half);
            self.avx2._mm256_add_epi8(count(lower), count(upper))
        }
        #[inline(always)]
        fn lowest_byte(self, bytes: __m256i) -> u8 {
            let [low, high]: [std::arch::x86_64::__m128i; 2] = cast(bytes);
            let half = self.sse2._mm_min_epu8(low, high);
            // the lower byte of each word becomes the lower of both, the upper one 0
            let words = self.sse2._mm_min_epu8(half, self.sse2._mm_srli_epi16::<8>(half));
            self.sse2._mm_cvtsi128_si32(self.sse4_1._mm_minpos_epu16(words)) as u8
        }
        #[inline(always)]
        fn where_near(self, a: __m256i, b: __m256i, then: __m256i, other: __m256i) -> __m256i {
            let apart = self.avx2._mm256_sub_epi8(a, b);
            let near = self.avx2._mm256_cmpeq_epi8(apart, self.avx2._mm256_min_epu8(apart, self.all_bytes(2)));
            self.avx2._mm256_blendv_epi8(other, then, near)
        }
        #[inline(always)]
        fn mark(self, bytes: __m256i, bit: u8, word: &[u16; LANES], other: &[u16; LANES]) -> __m256i {
            let ([a, b], [c, d]): ([__m256i; 2], [__m256i; 2]) = (cast(*word), cast(*other));
            let no_less = |a, b| self.avx2._mm256_cmpeq_epi16(self.avx2._mm256_min_epu16(a, b), b);
            // packing takes the halves of both registers in turn
            let packed = self.avx2._mm256_packs_epi16(no_less(a, c), no_less(b, d));
            let mask = self.avx2._mm256_permute4x64_epi64::<0b11_01_10_00>(packed);
            self.avx2._mm256_or_si256(bytes, self.avx2._mm256_and_si256(mask, self.all_bytes(bit)))
        }
        #[inline(always)]
        fn same(self, a: __m256i, b: __m256i) -> u32 {
            self.avx2._mm256_movemask_epi8(self.avx2._mm256_cmpeq_epi8(a, b)).cast_unsigned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// All that registers can do, in one result.
    struct All<'a> {
        bytes: [[u8; LANES]; 2],
        words: [[u16; LANES]; 2],
        out: &'a mut Vec<u8>,
    }

    impl Kernel for All<'_> {
        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) {
            let Self { bytes: [a, b], words, out } = self;
            let (a, b) = (lanes.bytes(&a), lanes.bytes(&b));
            for bytes in [
                lanes.min_bytes(a, b),
                lanes.add_bytes(a, b),
                lanes.sub_bytes(a, b),
                lanes.mean_bytes(a, b),
                lanes.differing_bits(a, b),
                lanes.all_bytes(200),
                lanes.mark(a, 16, &words[0], &words[1]),
                lanes.where_near(a, b, lanes.all_bytes(7), b),
                lanes.where_near(a, lanes.min_bytes(a, b), lanes.all_bytes(7), b),
            ] {
                let mut stored = [0; LANES];
                lanes.store_bytes(bytes, &mut stored);
                out.extend(stored);
            }
            out.push(lanes.lowest_byte(a));
            out.extend(lanes.same(a, lanes.min_bytes(a, b)).to_le_bytes());
        }
    }

    proptest! {
        #[test]
        fn registers_do_the_same(bytes: [[u8; LANES]; 2], words: [[u16; LANES]; 2]) {
            let (mut plain, mut best) = (Vec::new(), Vec::new());
            All { bytes, words, out: &mut plain }.run(Plain);
            run(All { bytes, words, out: &mut best });
            prop_assert_eq!(plain, best);
        }
    }
}
