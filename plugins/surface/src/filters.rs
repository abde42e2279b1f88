//! Checks of trajectories: thresholds, and the motion of neighbours [D'Apuzzo 1999 §2.4.2].

use foveate::prelude::*;

use crate::tracks::{Neighbourhood, Track};

/// Limits of trajectories.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterOptions {
    /// [m/s].
    pub max_speed: f64,
    /// [m/s²].
    pub max_acceleration: f64,
    /// Neighbours lie within this of a point [m].
    pub radius_m: f64,
    /// A velocity may differ by this part of the speed around it, [–]
    pub uniform_part: f64,
    /// and by so many scatters of the neighbours' own velocities, [–]
    pub uniform_scatters: f64,
    /// and by what this error of positions over a step makes [m].
    pub uniform_m: f64,
}

/// Splits points into accepted and rejected ones, with the reason. In space the velocity is compared with the median of the neighbours' velocities;
/// in time its change over the last step with theirs: a point that starts or stops alone is as false as one with another motion.
pub fn filter(
    found: Vec<Track>,
    before: &[Track],
    dt_s: f64,
    options: &FilterOptions,
) -> (Vec<Track>, Vec<(Track, TrajectoryEnd)>) {
    let (mut held, mut ended) = (Vec::with_capacity(found.len()), Vec::new());
    for track in found {
        let end = match () {
            () if track.velocity.norm() > options.max_speed => Some(TrajectoryEnd::TooFast),
            () if track.acceleration.norm() > options.max_acceleration => Some(TrajectoryEnd::TooAbrupt),
            () => None,
        };
        match end {
            Some(end) => ended.push((track, end)),
            None => held.push(track),
        }
    }
    // False ones among the neighbours widen their scatter: once more without them.
    for _ in 0..2 {
        let around = Neighbourhood::new(&held, options.radius_m);
        let earlier = Neighbourhood::new(before, options.radius_m);
        let is_false: Vec<bool> = held.iter().map(|it| !is_uniform(it, &around, &earlier, dt_s, options)).collect();
        let mut flags = is_false.iter();
        let (mut kept, mut out) = (Vec::with_capacity(held.len()), Vec::new());
        for track in held {
            if *flags.next().unwrap_or(&false) {
                out.push((track, TrajectoryEnd::NotUniform));
            } else {
                kept.push(track);
            }
        }
        held = kept;
        let none = out.is_empty();
        ended.extend(out);
        if none {
            break;
        }
    }
    (held, ended)
}

/// A point without neighbours cannot be uniform with them, and is rejected.
fn is_uniform(
    track: &Track,
    around: &Neighbourhood<'_>,
    earlier: &Neighbourhood<'_>,
    dt_s: f64,
    options: &FilterOptions,
) -> bool {
    if track.n_samples < 2 {
        return true;
    }
    let Some(motion) = around.motion_without(&track.sample.position, Some(track.id)) else { return false };
    let tolerance = |speed: f64, scatter: f64| {
        options.uniform_part * speed + options.uniform_scatters * scatter + options.uniform_m / dt_s
    };
    let in_space = (track.velocity - motion.velocity).norm() <= tolerance(motion.velocity.norm(), motion.scatter);
    // In time: what it gained since the step before, beside what its neighbourhood gained.
    let then = track.sample.position - track.velocity * dt_s;
    let in_time = earlier.motion_without(&then, None).is_none_or(|before| {
        let gained = motion.velocity - before.velocity;
        let limit = tolerance(motion.velocity.norm().max(before.velocity.norm()), motion.scatter.max(before.scatter));
        track.n_samples < 3 || (track.acceleration * dt_s - gained).norm() <= 2.0 * limit
    });
    in_space && in_time
}
