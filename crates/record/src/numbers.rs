//! Numbers of things that follow each other.

/// Numbers that count up from zero, but where a damaged log has lost some; the things they belong to stand without gaps.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Numbers {
    count: usize,
    /// From this place on the numbers count up from this one; both ascend.
    leaps: Vec<(usize, u64)>,
}

impl Numbers {
    /// Whether none was lost.
    pub(crate) fn is_whole(&self) -> bool {
        self.leaps.is_empty()
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// The number that comes next.
    pub(crate) fn next(&self) -> u64 {
        self.number(self.count)
    }

    /// The number of what stands at this place.
    pub(crate) fn number(&self, place: usize) -> u64 {
        let (from, number) = self.leap(self.leaps.partition_point(|(from, _)| *from <= place));
        number.saturating_add((place - from) as u64)
    }

    /// The place of a number, if it was not lost.
    pub(crate) fn place(&self, number: u64) -> Option<usize> {
        let after = self.leaps.partition_point(|(_, first)| *first <= number);
        let (from, first) = self.leap(after);
        let end = self.leaps.get(after).map_or(self.count, |(place, _)| *place);
        let place = from.checked_add(usize::try_from(number - first).ok()?)?;
        (place < end).then_some(place)
    }

    /// The last of the first leaps.
    fn leap(&self, leaps: usize) -> (usize, u64) {
        leaps.checked_sub(1).and_then(|leap| self.leaps.get(leap)).copied().unwrap_or_default()
    }

    /// What comes next has this number; no effect where that number has been passed.
    pub(crate) fn leap_to(&mut self, number: u64) {
        if number <= self.next() {
            return;
        }
        self.leaps.pop_if(|(place, _)| *place == self.count);
        self.leaps.push((self.count, number));
    }

    /// One more, with the next number.
    pub(crate) fn push(&mut self) {
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_numbers_agree_over_gaps() {
        let mut numbers = Numbers::default();
        for number in [0, 1, 4, 5, 9] {
            numbers.leap_to(number - number.min(1));
            numbers.leap_to(number);
            assert_eq!(numbers.next(), number);
            numbers.push();
        }
        numbers.leap_to(20);
        numbers.leap_to(3);
        assert_eq!((numbers.next(), numbers.is_whole()), (20, false));
        let places: Vec<_> = (0..22).map(|number| numbers.place(number)).collect();
        let known: Vec<_> =
            places.iter().enumerate().filter_map(|(number, place)| Some((number as u64, (*place)?))).collect();
        assert_eq!(known, [(0, 0), (1, 1), (4, 2), (5, 3), (9, 4)]);
        assert!(known.iter().all(|(number, place)| numbers.number(*place) == *number));
        assert_eq!(numbers.place(u64::MAX), None);
    }
}
