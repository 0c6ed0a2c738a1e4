//! Bytes and words, many at a time: by AVX2 where the processor has it, by plain loops elsewhere, to the same result.
//!
//! The compiler does not find these instructions by itself: it left a third of the loops below as branches.

/// Bytes of a register.
pub(crate) const LANES: usize = 32;
/// Words of a register.
pub(crate) const WORDS: usize = LANES / 2;

/// The least whole number of lanes, as values, that holds so many.
pub(crate) fn lanes_for(count: usize) -> usize {
    count.next_multiple_of(LANES)
}

/// Registers of bytes and of words of 16 bits, and what is done with them, lane by lane.
pub(crate) trait Lanes: Copy {
    /// Bytes.
    type Bytes: Copy;
    /// Words.
    type Words: Copy;

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
    /// The difference, at least 0.
    fn sub_bytes(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The number of bits in which two differ.
    fn differing_bits(self, a: Self::Bytes, b: Self::Bytes) -> Self::Bytes;
    /// The lowest of all lanes.
    fn lowest_byte(self, bytes: Self::Bytes) -> u8;
    /// Bytes as words, in their order.
    fn widen(self, bytes: Self::Bytes) -> [Self::Words; 2];

    /// Loads a register.
    fn words(self, from: &[u16; WORDS]) -> Self::Words;
    /// Stores a register.
    fn store_words(self, words: Self::Words, to: &mut [u16; WORDS]);
    /// The same word in all lanes.
    fn all_words(self, word: u16) -> Self::Words;
    /// The lower of two.
    fn min_words(self, a: Self::Words, b: Self::Words) -> Self::Words;
    /// The sum, modulo 65536.
    fn add_words(self, a: Self::Words, b: Self::Words) -> Self::Words;
    /// The difference, modulo 65536.
    fn sub_words(self, a: Self::Words, b: Self::Words) -> Self::Words;
    /// `then` where `a` and `b` are the same, otherwise `other`.
    fn where_same(self, a: Self::Words, b: Self::Words, then: Self::Words, other: Self::Words) -> Self::Words;
    /// The lowest of all lanes.
    fn lowest_word(self, words: Self::Words) -> u16;
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
    type Words = [u16; WORDS];

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
    fn widen(self, bytes: Self::Bytes) -> [Self::Words; 2] {
        let mut words = [[0; WORDS]; 2];
        for k in 0..WORDS {
            words[0][k] = u16::from(bytes[k]);
            words[1][k] = u16::from(bytes[WORDS + k]);
        }
        words
    }
    #[inline(always)]
    fn words(self, from: &[u16; WORDS]) -> Self::Words {
        *from
    }
    #[inline(always)]
    fn store_words(self, words: Self::Words, to: &mut [u16; WORDS]) {
        *to = words;
    }
    #[inline(always)]
    fn all_words(self, word: u16) -> Self::Words {
        [word; WORDS]
    }
    #[inline(always)]
    fn min_words(self, a: Self::Words, b: Self::Words) -> Self::Words {
        zip(a, b, u16::min)
    }
    #[inline(always)]
    fn add_words(self, a: Self::Words, b: Self::Words) -> Self::Words {
        zip(a, b, u16::wrapping_add)
    }
    #[inline(always)]
    fn sub_words(self, a: Self::Words, b: Self::Words) -> Self::Words {
        zip(a, b, u16::wrapping_sub)
    }
    #[inline(always)]
    fn where_same(self, a: Self::Words, b: Self::Words, then: Self::Words, mut other: Self::Words) -> Self::Words {
        for k in 0..WORDS {
            other[k] = if a[k] == b[k] { then[k] } else { other[k] };
        }
        other
    }
    #[inline(always)]
    fn lowest_word(self, words: Self::Words) -> u16 {
        words.iter().fold(u16::MAX, |a, b| a.min(*b))
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Kernel, LANES, Lanes, WORDS};
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
        type Words = __m256i;

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
        fn widen(self, bytes: __m256i) -> [__m256i; 2] {
            let [low, high]: [std::arch::x86_64::__m128i; 2] = cast(bytes);
            [self.avx2._mm256_cvtepu8_epi16(low), self.avx2._mm256_cvtepu8_epi16(high)]
        }
        #[inline(always)]
        fn words(self, from: &[u16; WORDS]) -> __m256i {
            cast(*from)
        }
        #[inline(always)]
        fn store_words(self, words: __m256i, to: &mut [u16; WORDS]) {
            *to = cast(words);
        }
        #[inline(always)]
        fn all_words(self, word: u16) -> __m256i {
            self.avx._mm256_set1_epi16(word.cast_signed())
        }
        #[inline(always)]
        fn min_words(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_min_epu16(a, b)
        }
        #[inline(always)]
        fn add_words(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_add_epi16(a, b)
        }
        #[inline(always)]
        fn sub_words(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_sub_epi16(a, b)
        }
        #[inline(always)]
        fn where_same(self, a: __m256i, b: __m256i, then: __m256i, other: __m256i) -> __m256i {
            self.avx2._mm256_blendv_epi8(other, then, self.avx2._mm256_cmpeq_epi16(a, b))
        }
        #[inline(always)]
        fn lowest_word(self, words: __m256i) -> u16 {
            let [low, high]: [std::arch::x86_64::__m128i; 2] = cast(words);
            let half = self.sse4_1._mm_min_epu16(low, high);
            self.sse2._mm_cvtsi128_si32(self.sse4_1._mm_minpos_epu16(half)) as u16
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
        words: [[u16; WORDS]; 2],
        out: &'a mut Vec<u16>,
    }

    impl Kernel for All<'_> {
        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) {
            let Self { bytes: [a, b], words: [c, d], out } = self;
            let (a, b, c, d) = (lanes.bytes(&a), lanes.bytes(&b), lanes.words(&c), lanes.words(&d));
            for bytes in [
                lanes.min_bytes(a, b),
                lanes.add_bytes(a, b),
                lanes.sub_bytes(a, b),
                lanes.differing_bits(a, b),
                lanes.all_bytes(200),
            ] {
                let mut stored = [0; LANES];
                lanes.store_bytes(bytes, &mut stored);
                out.extend(stored.map(u16::from));
                for words in lanes.widen(bytes) {
                    let mut stored = [0; WORDS];
                    lanes.store_words(words, &mut stored);
                    out.extend(stored);
                }
            }
            for words in [
                lanes.min_words(c, d),
                lanes.add_words(c, d),
                lanes.sub_words(c, d),
                lanes.where_same(c, d, lanes.all_words(50_000), d),
                lanes.where_same(c, lanes.min_words(c, d), c, d),
            ] {
                let mut stored = [0; WORDS];
                lanes.store_words(words, &mut stored);
                out.extend(stored);
            }
            out.extend([u16::from(lanes.lowest_byte(a)), lanes.lowest_word(c)]);
        }
    }

    proptest! {
        #[test]
        fn registers_do_the_same(bytes: [[u8; LANES]; 2], words: [[u16; WORDS]; 2]) {
            let (mut plain, mut best) = (Vec::new(), Vec::new());
            All { bytes, words, out: &mut plain }.run(Plain);
            run(All { bytes, words, out: &mut best });
            prop_assert_eq!(plain, best);
        }
    }
}
