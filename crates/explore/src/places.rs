//! What became of robots that were sent somewhere: the blacklist, whose entries age, and whose number is bounded.

/// Why a frontier is left as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WhyLeft {
    /// Too little is expected beyond it, for a robot of this size.
    TooSmall {
        /// What is expected, square metres.
        new_m2: f64,
    },
    /// No robot fits near enough to look beyond it.
    TooNarrow,
    /// No robot has a way there.
    Unreachable,
    /// Robots made no progress towards it; it is tried again later.
    Blacklisted {
        /// Until then, seconds.
        until_s: f64,
        /// How often robots gave up.
        times: u32,
    },
    /// Robots made no progress towards it too often.
    GivenUp {
        /// How often.
        times: u32,
    },
    /// Robots stood there and saw nothing new.
    NothingNew {
        /// How often.
        times: u32,
    },
    /// Something new was seen there again and again, and it is a frontier still: a map that does not hold still.
    SeenTooOften {
        /// How often.
        times: u32,
    },
    /// Others go where the same is to be seen, or nothing could be given yet.
    Waiting,
}

/// How an errand ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// The goal is no frontier any more.
    Seen,
    /// The robot looked from there, and it is a frontier still.
    NothingNew,
    /// No progress.
    Stuck,
}

/// How often a place is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Limits {
    pub(crate) tries: u32,
    pub(crate) looks: u32,
    pub(crate) visits: u32,
}

#[derive(Debug, Clone)]
struct Place {
    at_m: [f64; 2],
    stuck: Vec<Stuck>,
    nothing_new: u32,
    seen: u32,
}

/// A robot made no progress towards a place. Others may.
#[derive(Debug, Clone)]
struct Stuck {
    robot: u32,
    times: u32,
    until_s: f64,
}

/// The ledger of all places that robots were sent to.
#[derive(Debug, Clone, Default)]
pub(crate) struct Places {
    places: Vec<Place>,
}

impl Places {
    fn near(&self, point_m: [f64; 2], within_m: f64) -> Option<usize> {
        let away_m = |place: &Place| (place.at_m[0] - point_m[0]).hypot(place.at_m[1] - point_m[1]);
        let nearest =
            (0..self.places.len()).min_by(|&a, &b| away_m(&self.places[a]).total_cmp(&away_m(&self.places[b])));
        nearest.filter(|&k| away_m(&self.places[k]) <= within_m)
    }

    /// Books how a robot's errand ended. It leaves a place alone that it got stuck on its way to for `age_s`, twice as long each time.
    pub(crate) fn book(
        &mut self,
        robot: u32,
        point_m: [f64; 2],
        within_m: f64,
        ending: Ending,
        now_s: f64,
        age_s: f64,
    ) {
        let place = self.near(point_m, within_m).unwrap_or_else(|| {
            self.places.push(Place { at_m: point_m, stuck: Vec::new(), nothing_new: 0, seen: 0 });
            self.places.len() - 1
        });
        let place = &mut self.places[place];
        match ending {
            Ending::Seen => place.seen += 1,
            Ending::NothingNew => place.nothing_new += 1,
            Ending::Stuck => match place.stuck.iter_mut().find(|stuck| stuck.robot == robot) {
                Some(stuck) => {
                    stuck.until_s = now_s + age_s * f64::from(1_u32 << stuck.times.min(8));
                    stuck.times += 1;
                }
                None => place.stuck.push(Stuck { robot, times: 1, until_s: now_s + age_s }),
            },
        }
    }

    /// Why a robot may not be sent there now, if so.
    pub(crate) fn barred(
        &self,
        robot: u32,
        point_m: [f64; 2],
        within_m: f64,
        now_s: f64,
        limits: Limits,
    ) -> Option<WhyLeft> {
        let place = &self.places[self.near(point_m, within_m)?];
        if place.nothing_new >= limits.looks {
            return Some(WhyLeft::NothingNew { times: place.nothing_new });
        }
        if place.seen >= limits.visits {
            return Some(WhyLeft::SeenTooOften { times: place.seen });
        }
        let &Stuck { times, until_s, .. } = place.stuck.iter().find(|stuck| stuck.robot == robot)?;
        if times >= limits.tries {
            Some(WhyLeft::GivenUp { times })
        } else {
            (now_s < until_s).then_some(WhyLeft::Blacklisted { until_s, times })
        }
    }

    /// Nothing else is left to do: what waits for its time is tried now.
    pub(crate) fn let_out(&mut self) {
        let stuck = self.places.iter_mut().flat_map(|place| &mut place.stuck);
        stuck.for_each(|stuck| stuck.until_s = f64::NEG_INFINITY);
    }

    /// Errands that were booked.
    pub(crate) fn booked(&self) -> u32 {
        let stuck = |place: &Place| place.stuck.iter().map(|stuck| stuck.times).sum::<u32>();
        self.places.iter().map(|place| stuck(place) + place.nothing_new + place.seen).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { tries: 3, looks: 2, visits: 5 };

    #[test]
    fn a_place_comes_back_with_age_a_bounded_number_of_times() {
        let mut places = Places::default();
        let barred = |places: &Places, now_s: f64| places.barred(7, [1.0, 1.1], 0.5, now_s, LIMITS);
        assert_eq!(barred(&places, 0.0), None);
        places.book(7, [1.0, 1.0], 0.5, Ending::Stuck, 0.0, 10.0);
        assert_eq!(barred(&places, 9.0), Some(WhyLeft::Blacklisted { until_s: 10.0, times: 1 }));
        assert_eq!(barred(&places, 10.0), None);
        places.book(7, [1.0, 1.2], 0.5, Ending::Stuck, 10.0, 10.0);
        assert_eq!(barred(&places, 20.0), Some(WhyLeft::Blacklisted { until_s: 30.0, times: 2 }));
        places.let_out();
        assert_eq!(barred(&places, 20.0), None);
        places.book(7, [1.0, 1.0], 0.5, Ending::Stuck, 20.0, 10.0);
        places.let_out();
        assert_eq!(barred(&places, 1e9), Some(WhyLeft::GivenUp { times: 3 }));
        assert_eq!(places.barred(8, [1.0, 1.1], 0.5, 1e9, LIMITS), None, "another may get there");
        assert_eq!(places.barred(7, [2.0, 2.0], 0.5, 0.0, LIMITS), None);
        assert_eq!(places.booked(), 3);
    }

    #[test]
    fn looking_twice_is_enough() {
        let mut places = Places::default();
        for _ in 0..2 {
            assert_eq!(places.barred(7, [0.0; 2], 0.5, 0.0, LIMITS), None);
            places.book(7, [0.0; 2], 0.5, Ending::NothingNew, 0.0, 10.0);
        }
        assert_eq!(places.barred(7, [0.0; 2], 0.5, 0.0, LIMITS), Some(WhyLeft::NothingNew { times: 2 }));
        (0..5).for_each(|_| places.book(7, [9.0; 2], 0.5, Ending::Seen, 0.0, 10.0));
        assert_eq!(places.barred(7, [9.0; 2], 0.5, 0.0, LIMITS), Some(WhyLeft::SeenTooOften { times: 5 }));
    }
}
