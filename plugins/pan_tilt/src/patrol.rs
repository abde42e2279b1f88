//! Motion of a head without a target.

use foveate::prelude::{HeadOrder, Interval, Time};

use crate::control::ControlSettings;

/// Settings that are visited while there is no target.
#[derive(Debug)]
pub(crate) struct Patrol {
    /// [rad].
    places: Vec<[f64; 2]>,
    speed: f64,
    stay: Interval,
    /// Index of the present setting, start of the motion to it, and arrival.
    at: usize,
    sent: Option<Time>,
    arrived: Option<Time>,
}

/// Largest distance of a head that has arrived at a setting [rad].
const ARRIVED: f64 = 0.01;
/// Time after which a setting that was not reached is skipped.
const PATROL_PATIENCE: Interval = Interval(10_000_000_000);

impl Patrol {
    pub fn new(settings: &ControlSettings) -> Patrol {
        Patrol {
            places: settings.patrol_deg.iter().map(|it| it.map(f64::to_radians)).collect(),
            speed: settings.patrol_deg_per_s.to_radians(),
            stay: Interval::from_ms(settings.patrol_stay_ms),
            at: 0,
            sent: None,
            arrived: None,
        }
    }

    /// A target interrupts the patrol: the present setting is the next again.
    pub fn leave(&mut self) {
        (self.sent, self.arrived) = (None, None);
    }

    /// The order now for the head at `angles`, as far as known.
    pub fn step(&mut self, now: Time, angles: Option<[f64; 2]>) -> Option<HeadOrder> {
        let place = *self.places.get(self.at)?;
        let Some(sent) = self.sent else {
            self.sent = Some(now);
            return Some(HeadOrder::Go { angles: place, speeds: [self.speed; 2] });
        };
        let is_there = angles.is_some_and(|it| (0..2).all(|axis| (it[axis] - place[axis]).abs() < ARRIVED));
        if is_there {
            self.arrived.get_or_insert(now);
        }
        let is_over = self.arrived.is_some_and(|it| now - it >= self.stay) || now - sent > PATROL_PATIENCE;
        if is_over {
            self.at = (self.at + 1) % self.places.len();
            self.leave();
            return self.step(now, None);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patrol(places: &[[f64; 2]]) -> Patrol {
        Patrol::new(&ControlSettings {
            patrol_deg: places.to_vec(),
            patrol_stay_ms: 200.0,
            ..ControlSettings::default()
        })
    }

    fn goal(order: Option<HeadOrder>) -> Option<[f64; 2]> {
        order.map(|it| match it {
            HeadOrder::Go { angles, .. } => angles.map(|it| it.to_degrees().round()),
            HeadOrder::Turn { .. } => panic!("{it:?}"),
        })
    }

    #[test]
    fn places_are_visited_in_turn_each_for_its_stay_and_one_that_is_not_reached_is_given_up() {
        let mut patrol = patrol(&[[10.0, 0.0], [-10.0, 5.0]]);
        let there = |degrees: [f64; 2]| Some(degrees.map(f64::to_radians));
        let mut step = |s: f64, angles| goal(patrol.step(Time::from_s(s), angles));
        assert_eq!(step(0.0, None), Some([10.0, 0.0]));
        assert_eq!(step(0.1, there([5.0, 0.0])), None);
        assert_eq!(step(0.3, there([10.1, 0.1])), None, "it has just come");
        assert_eq!(step(0.6, there([10.1, 0.1])), Some([-10.0, 5.0]));
        assert_eq!(step(5.0, there([3.0, 2.0])), None);
        assert_eq!(step(11.0, there([3.0, 2.0])), Some([10.0, 0.0]), "it never came there");
    }

    #[test]
    fn a_head_that_was_taken_away_goes_on_where_it_was_going_and_without_places_it_stays() {
        let mut patrol = patrol(&[[10.0, 0.0], [-10.0, 5.0]]);
        assert_eq!(goal(patrol.step(Time::ZERO, None)), Some([10.0, 0.0]));
        patrol.leave();
        assert_eq!(goal(patrol.step(Time::from_s(9.0), None)), Some([10.0, 0.0]));
        assert_eq!(self::patrol(&[]).step(Time::ZERO, None), None);
    }
}
