//! Loops that the compiler turns into vector instructions, of the best kind that the processor has.

/// Values that are worked on at once: bytes of a register of AVX2.
pub(crate) const LANES: usize = 32;

/// The least whole number of lanes, as values, that holds so many.
pub(crate) fn lanes_for(count: usize) -> usize {
    count.next_multiple_of(LANES)
}

/// Work on a row. All of it is inlined, so that it is compiled for each kind of processor.
pub(crate) trait Row {
    /// Does it; with `#[inline(always)]`.
    fn run(self);
}

struct Dispatched<R>(R);

impl<R: Row> pulp::WithSimd for Dispatched<R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.0.run();
    }
}

/// Runs with the widest registers that there are. Everything is done in integers or lane by lane: the result is the same with any.
pub(crate) fn run<R: Row>(row: R) {
    pulp::Arch::new().dispatch(Dispatched(row));
}
