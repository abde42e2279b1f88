//! Score of a tracker against the truth: identities, misses, false targets, errors, consistency.

use foveate_estimation::gospa::SetDistance;
use foveate_estimation::identities::{Identified, Identities};
use foveate_estimation::statistics;
use foveate_messages::{Features, Provenance, TargetId, Targets, Time};
use nalgebra::{Matrix3, Point3};

use super::Lights;

/// A target farther from a light than this does not follow it; also the cut-off of OSPA and GOSPA [m].
pub const GATE_M: f64 = 0.1;

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreOptions {
    /// Nothing before counts but initiations [s].
    pub settled_s: f64,
    /// Least time between two comparisons; 0: after each frame [s].
    pub step_s: f64,
}

/// How a tracker did against the truth. All but the initiations is of the time after settling.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Score {
    /// By light: the identities that followed it.
    pub identities: Vec<Vec<TargetId>>,
    /// How many identities followed any light.
    pub n_identities: usize,
    /// A light was followed by an identity that had followed another one before.
    pub id_switches: u64,
    /// A light that had an identity was followed by a new one.
    pub reinitialisations: u64,
    /// Comparisons of all lights with all targets.
    pub moments: usize,
    /// Samples of targets that followed no light.
    pub ghosts: usize,
    /// Samples of lights that no target followed.
    pub missed: usize,
    /// Samples of lights.
    pub samples: usize,
    /// Root of the mean squared error of measured samples [m].
    pub rms: f64,
    /// Largest error of measured samples [m].
    pub worst: f64,
    /// Half of the errors of all samples that follow a light are smaller [m].
    pub error_median: f64,
    /// 95 % of them are smaller [m].
    pub error_p95: f64,
    /// Mean of eᵀP⁻¹e over the measured samples, e the error of the position; 3 if the covariance P is right.
    pub consistency: f64,
    /// Mean over the comparisons, with p = 2 [m].
    pub ospa: f64,
    /// Mean over the comparisons, with p = 2 and α = 2 [m].
    pub gospa: f64,
    /// By light: from the first frame to the first target that followed it [s].
    pub initiations: Vec<Option<f64>>,
    /// When the first target was there at all.
    pub first_initiation: Option<Time>,
}

impl Score {
    /// Identities for each light; 1 is ideal.
    pub fn identities_per_light(&self) -> f64 {
        self.n_identities as f64 / self.identities.len().max(1) as f64
    }

    /// False targets at a time, mean.
    pub fn false_targets(&self) -> f64 {
        self.ghosts as f64 / self.moments.max(1) as f64
    }

    /// Part of the lights' time without a target that follows them.
    pub fn missed_part(&self) -> f64 {
        self.missed as f64 / self.samples.max(1) as f64
    }

    /// Mean time from the first frame to the target of a light, over those that had one [s]; NaN without any.
    pub fn time_to_initiation(&self) -> f64 {
        let born: Vec<f64> = self.initiations.iter().flatten().copied().collect();
        born.iter().sum::<f64>() / born.len() as f64
    }
}

/// Compares targets with lights, moment by moment.
pub struct Scorer {
    options: ScoreOptions,
    identities: Identities,
    /// Before settling: initiations only.
    early: Identities,
    distance: SetDistance,
    score: Score,
    first_s: Option<f64>,
    next_s: f64,
    errors: Vec<f64>,
    squares: f64,
    honesty: f64,
    n_measured: usize,
    truth: Vec<Identified>,
    found: Vec<Identified>,
    points: [Vec<Point3<f64>>; 2],
}

impl Scorer {
    /// Of so many lights.
    pub fn new(n_lights: usize, options: ScoreOptions) -> Self {
        let (identities, initiations) = (vec![Vec::new(); n_lights], vec![None; n_lights]);
        Self {
            options,
            identities: Identities::new(GATE_M),
            early: Identities::new(GATE_M),
            distance: SetDistance::new(GATE_M, 2.0),
            score: Score { identities, initiations, ..Score::default() },
            first_s: None,
            next_s: f64::NEG_INFINITY,
            errors: Vec::new(),
            squares: 0.0,
            honesty: 0.0,
            n_measured: 0,
            truth: Vec::new(),
            found: Vec::new(),
            points: [Vec::new(), Vec::new()],
        }
    }

    /// Whether targets of `time` are to be compared.
    pub fn is_due(&self, time: Time) -> bool {
        time.as_s() >= self.next_s
    }

    /// Compares `targets` with the `lights` at their time.
    pub fn compare(&mut self, targets: &Targets, lights: impl Iterator<Item = Point3<f64>>) {
        let time_s = targets.time.as_s();
        let first_s = *self.first_s.get_or_insert(time_s);
        self.next_s = time_s + self.options.step_s;
        self.truth.clear();
        self.truth.extend((0..).zip(lights));
        self.found.clear();
        self.found.extend(targets.list.iter().map(|it| (it.id.0, it.position)));
        if !targets.list.is_empty() {
            self.score.first_initiation.get_or_insert(targets.time);
        }
        let is_settled = time_s >= self.options.settled_s;
        let identities = if is_settled { &mut self.identities } else { &mut self.early };
        let partners = identities.match_up(&self.truth, &self.found);
        for (born, partner) in self.score.initiations.iter_mut().zip(partners) {
            if partner.is_some() {
                born.get_or_insert(time_s - first_s);
            }
        }
        if !is_settled {
            return;
        }
        let mut n_pairs = 0;
        for (light, target) in partners.iter().enumerate().filter_map(|(light, it)| Some((light, (*it)?))) {
            let target = &targets.list[target];
            let error = self.truth[light].1 - target.position;
            n_pairs += 1;
            self.errors.push(error.norm());
            if target.provenance == Provenance::Measured {
                self.squares += error.norm_squared();
                self.n_measured += 1;
                let covariance: Matrix3<f64> = target.covariance.fixed_view::<3, 3>(0, 0).into_owned();
                self.honesty += covariance.try_inverse().map_or(f64::NAN, |it| error.dot(&(it * error)));
                self.score.worst = self.score.worst.max(error.norm());
            }
        }
        for (points, all) in self.points.iter_mut().zip([&self.truth, &self.found]) {
            points.clear();
            points.extend(all.iter().map(|(_, place)| place));
        }
        let [truth, found] = &self.points;
        let difference = self.distance.compare(truth, found);
        self.score.ospa += difference.ospa();
        self.score.gospa += difference.gospa();
        self.score.moments += 1;
        self.score.samples += self.truth.len();
        self.score.missed += self.truth.len() - n_pairs;
        self.score.ghosts += self.found.len() - n_pairs;
    }

    /// The sum of it.
    pub fn finish(self) -> Score {
        let mut score = self.score;
        let n = score.moments.max(1) as f64;
        score.ospa /= n;
        score.gospa /= n;
        score.n_identities = self.identities.n_identities();
        (score.id_switches, score.reinitialisations) =
            (self.identities.id_switches(), self.identities.reinitialisations());
        for (light, identities_of) in self.identities.identities_of() {
            score.identities[*light as usize] = identities_of.iter().map(|it| TargetId(*it)).collect();
        }
        score.error_median = statistics::median(&self.errors).unwrap_or(f64::NAN);
        score.error_p95 = statistics::percentile(&self.errors, 95.0).unwrap_or(f64::NAN);
        score.consistency = self.honesty / self.n_measured.max(1) as f64;
        score.rms = (self.squares / self.n_measured.max(1) as f64).sqrt();
        score
    }
}

/// Carries all frames through `track` and compares its targets with the lights after each that it takes: `track` fills
/// the targets and says whether the frame was taken.
pub fn score<'a>(
    frames: impl IntoIterator<Item = &'a (Time, Features)>,
    options: ScoreOptions,
    lights: &impl Lights,
    mut track: impl FnMut(Time, &Features, &mut Targets) -> bool,
) -> Score {
    let mut scorer = Scorer::new(lights.count(), options);
    let (mut targets, mut here) = (Targets::default(), Vec::new());
    for (time, features) in frames {
        if track(*time, features, &mut targets) && scorer.is_due(targets.time) {
            lights.at(targets.time.as_s(), &mut here);
            scorer.compare(&targets, here.iter().map(|it| it.position));
        }
    }
    scorer.finish()
}

#[cfg(test)]
mod tests {
    use foveate_messages::Target;
    use nalgebra::{Matrix6, Vector3};

    use super::*;

    fn target(id: u32, x: f64) -> Target {
        Target {
            id: TargetId(id),
            position: Point3::new(x, 0.0, 0.0),
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity() * 1e-4,
            cameras: Default::default(),
            provenance: Provenance::Measured,
        }
    }

    /// Two lights at 0 and 1 m, compared once a second from 0 s with what `found` gives; settled at 2 s.
    fn scored(n: u32, found: impl Fn(u32) -> Vec<Target>) -> Score {
        let mut scorer = Scorer::new(2, ScoreOptions { settled_s: 2.0, step_s: 0.0 });
        for second in 0..n {
            let targets = Targets { time: Time::from_s(f64::from(second)), list: found(second) };
            scorer.compare(&targets, [0.0, 1.0].map(|x| Point3::new(x, 0.0, 0.0)).into_iter());
        }
        scorer.finish()
    }

    #[test]
    fn figures_are_as_computed_by_hand() {
        // From second 1 on: one is 10 mm off, the other missing and a false one instead; settled: seconds 2 to 5.
        let list = |second: u32| if second == 0 { vec![] } else { vec![target(4, 0.01), target(9, 5.0)] };
        let score = scored(6, list);
        assert_eq!((score.moments, score.samples, score.missed, score.ghosts), (4, 8, 4, 4));
        assert_eq!((score.false_targets(), score.missed_part(), score.identities_per_light()), (1.0, 0.5, 0.5));
        assert_eq!((&score.identities[0][..], &score.identities[1][..]), (&[TargetId(4)][..], &[][..]));
        assert_eq!((&score.initiations[..], score.first_initiation), (&[Some(1.0), None][..], Some(Time::from_s(1.0))));
        for (found, expected) in [
            (score.rms, 0.01),
            (score.error_median, 0.01),
            (score.consistency, 1.0),
            (score.ospa, ((1e-4 + 0.01) / 2.0_f64).sqrt()),
            (score.gospa, (1e-4 + 0.01_f64).sqrt()),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn identities_before_settling_do_not_count() {
        let score = scored(6, |second| vec![target(second.min(3), 0.0), target(10, 1.0)]);
        assert_eq!((score.n_identities, score.reinitialisations, score.id_switches), (3, 1, 0));
    }

    #[test]
    fn a_step_leaves_moments_out() {
        let mut scorer = Scorer::new(1, ScoreOptions { settled_s: 0.0, step_s: 0.5 });
        let due: Vec<bool> = (0..6)
            .map(|it| {
                let time = Time::from_s(f64::from(it) * 0.2);
                let due = scorer.is_due(time);
                if due {
                    scorer.compare(&Targets { time, list: vec![] }, std::iter::once(Point3::origin()));
                }
                due
            })
            .collect();
        assert_eq!(due, [true, false, false, true, false, false]);
    }
}
