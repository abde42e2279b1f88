//! The path on the floor: closed and smooth. Either a round with turns to both sides, on which people follow each other, or a
//! [`Braid`], on which they cross, and which they join and leave.
//!
//! The round is p(θ) = (a ρ cos θ, b ρ sin θ) with ρ = 1 + e cos(3θ + φ): three lobes, e large enough for the path to turn both
//! ways. θ = ω t runs evenly, so the person slows down where the path bends. The way walked,
//! s(θ) = ∫ |dp/dθ| dθ = s₀ θ + Σₖ (cₖ sin kθ + dₖ (1 − cos kθ)), is kept as a Fourier series; it drives the steps.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point2, Vector2};

use super::braid::Braid;
use super::visit::Visits;

/// a and b above relative to the area's extents: the lobes reach beyond them.
const HALF_AXES: [f64; 2] = [0.4, 0.3875];
/// e above.
const LOBES: f64 = 0.2;
/// Harmonics kept of the way walked; the next one is below a millimetre.
const N_HARMONICS: usize = 16;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Walk {
    /// θ at time 0 [rad].
    start: f64,
    /// dθ/dt [rad/s].
    omega: f64,
    path: Path,
    /// When the path is walked; `None`: always.
    visits: Option<Visits>,
    /// s₀ [m/rad].
    mean_stretch: f64,
    /// cₖ and dₖ for k = 1, 2, … [m].
    harmonics: [[f64; 2]; N_HARMONICS],
}

#[derive(Debug, Clone, PartialEq)]
enum Path {
    /// a, b [m] and φ [rad] above.
    Round { half_axes: [f64; 2], lobe_phase: f64 },
    /// See [`Braid`].
    Braid(Braid),
}

/// Where the person is on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// [m]
    pub position: Point2<f64>,
    /// Direction of walking, of length 1.
    pub forward: Vector2<f64>,
    /// Way walked since θ = 0 [m].
    pub way: f64,
}

impl Walk {
    /// The round in an area of `area_m`; starts at `share` of it (0 to 1), at `speed` on average [m/s].
    pub fn round(share: f64, area_m: [f64; 2], speed: f64, random: &mut Random) -> Self {
        let half_axes = [0, 1].map(|axis| area_m[axis] * HALF_AXES[axis]);
        let start = random.uniform_in(0.0, TAU) + share * TAU;
        let lobe_phase = random.uniform_in(0.0, TAU);
        Self::on(Path::Round { half_axes, lobe_phase }, start, speed)
    }

    /// Place number `slot` of `braid`, at `speed` on average [m/s], from `enter_s` on; durations of stays and
    /// absences as for [`Visits::new`].
    pub fn braid(
        slot: usize,
        braid: &Braid,
        speed: f64,
        enter_s: f64,
        stay_away_s: [f64; 2],
        random: &mut Random,
    ) -> Self {
        let start = random.uniform_in(0.0, TAU) + slot as f64 / braid.slots as f64 * TAU;
        let mut walk = Self::on(Path::Braid(*braid), start, speed);
        walk.visits = Some(Visits::new(braid, start, walk.omega, speed, enter_s, stay_away_s));
        walk
    }

    fn on(path: Path, start: f64, speed: f64) -> Self {
        let mut walk =
            Self { start, omega: 0.0, path, visits: None, mean_stretch: 0.0, harmonics: [[0.0; 2]; N_HARMONICS] };
        const N: usize = 512;
        for i in 0..N {
            let theta = TAU * i as f64 / N as f64;
            let stretch = walk.on_path(theta).1.norm();
            walk.mean_stretch += stretch / N as f64;
            for (k, [sine, cosine]) in walk.harmonics.iter_mut().enumerate() {
                let order = (k + 1) as f64;
                *sine += 2.0 / N as f64 / order * stretch * (order * theta).cos();
                *cosine += 2.0 / N as f64 / order * stretch * (order * theta).sin();
            }
        }
        walk.omega = speed / walk.mean_stretch;
        walk
    }

    /// Which visit it is at `time_s`, counted from 0; `None` while the person is away.
    pub fn visit(&self, time_s: f64) -> Option<u32> {
        self.visits.map_or(Some(0), |visits| visits.at(time_s, self.omega).map(|it| it.0))
    }

    /// Away from the path on a track, if one is walked at `time_s`.
    fn on_track(&self, time_s: f64) -> Option<Place> {
        let (Some(visits), Path::Braid(braid)) = (&self.visits, &self.path) else { return None };
        let (_, doing) = visits.at(time_s, self.omega)?;
        let (track, since_s, tip_theta) = visits.track(braid, doing, self.omega)?;
        let (position, velocity) = track.at(since_s);
        let way = self.way(tip_theta) + track.way_from_tip(since_s);
        Some(Place { position, forward: velocity.normalize(), way })
    }

    /// Where the person is; on the path while the person is away.
    pub fn at(&self, time_s: f64) -> Place {
        if let Some(place) = self.on_track(time_s) {
            return place;
        }
        let theta = self.start + self.omega * time_s;
        let (position, tangent) = self.on_path(theta);
        Place { position, forward: tangent.normalize(), way: self.way(theta) }
    }

    /// s(θ) above [m].
    fn way(&self, theta: f64) -> f64 {
        let (sine_1, cosine_1) = theta.sin_cos();
        let (mut sine, mut cosine) = (0.0, 1.0);
        let mut way = self.mean_stretch * theta;
        for [c, d] in self.harmonics {
            (sine, cosine) = (sine * cosine_1 + cosine * sine_1, cosine * cosine_1 - sine * sine_1);
            way += c * sine + d * (1.0 - cosine);
        }
        way
    }

    /// p and dp/dθ.
    fn on_path(&self, theta: f64) -> (Point2<f64>, Vector2<f64>) {
        let ([a, b], lobe_phase) = match &self.path {
            Path::Round { half_axes, lobe_phase } => (*half_axes, *lobe_phase),
            Path::Braid(braid) => {
                let point = braid.at(theta);
                return (point.position, point.tangent);
            }
        };
        let (sine, cosine) = theta.sin_cos();
        let (lobe_sine, lobe_cosine) = (3.0 * theta + lobe_phase).sin_cos();
        let radius = 1.0 + LOBES * lobe_cosine;
        let slope = -3.0 * LOBES * lobe_sine;
        let position = Point2::new(a * radius * cosine, b * radius * sine);
        (position, Vector2::new(a * (slope * cosine - radius * sine), b * (slope * sine + radius * cosine)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_way(walk: &Walk, tolerance: f64) {
        for step in 0..2000 {
            let time = f64::from(step) * 0.05;
            if walk.visit(time - 0.05).is_none() || walk.visit(time + 0.05).is_none() {
                continue;
            }
            let (before, after) = (walk.at(time - 1e-4), walk.at(time + 1e-4));
            let moved = (after.position - before.position).norm();
            let error = (after.way - before.way - moved).abs();
            assert!(error < tolerance * moved, "at {time} s: {} m and {moved} m", after.way - before.way);
            assert!((after.position - before.position).normalize().dot(&walk.at(time).forward) > 0.999_999);
        }
    }

    #[test]
    fn way_grows_as_fast_as_the_position_moves() {
        check_way(&Walk::round(0.3, [2.5, 4.0], 1.0, &mut Random::new(9)), 0.01);
        let braid = Braid::new(6, [5.0, 7.0], 0.6).unwrap();
        check_way(&Walk::braid(2, &braid, 1.0, 1.0, [20.0, 5.0], &mut Random::new(9)), 0.03);
    }

    #[test]
    fn tracks_join_the_path_smoothly_and_visits_follow_each_other() {
        let braid = Braid::new(6, [5.0, 7.0], 0.6).unwrap();
        let walk = Walk::braid(2, &braid, 1.0, 1.0, [20.0, 5.0], &mut Random::new(9));
        let (mut visits, mut before) = (Vec::new(), None::<(u32, Place)>);
        for step in 0..200_000 {
            let time = f64::from(step) * 1e-3;
            let now = walk.visit(time).map(|visit| (visit, walk.at(time)));
            if let (Some((visit, a)), Some((next, b))) = (before, now)
                && visit == next
            {
                let step = b.position - a.position;
                assert!(step.norm() < 3e-3, "jumps by {} m at {time} s", step.norm());
                assert!(a.forward.dot(&b.forward) > 0.9999, "turns at once at {time} s");
            }
            visits.extend(now.map(|it| it.0));
            before = now;
        }
        visits.dedup();
        assert!(visits.len() >= 4 && visits.windows(2).all(|it| it[1] == it[0] + 1), "{visits:?}");
        assert_eq!(walk.visit(0.99), None);
    }
}
