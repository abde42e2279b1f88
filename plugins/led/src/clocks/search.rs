//! The offset between two cameras' clocks without a prior: every offset and rate is tried on lines of sight that should meet.
//!
//! For each offset and rate the gain is the mean of max(0, 1 − (miss / tolerance)²) over the times at which both cameras see the
//! target. The score is the excess of the gain over its mean over all trials, times the root of the number of times: a long
//! stretch that agrees beats a short one, and a target that hardly moves agrees with every offset and so with none.

use nalgebra::Vector3;

use super::bearings::{Bearings, miss};

/// Options of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOptions {
    /// Largest offset, in both directions [s].
    pub max_offset_s: f64,
    /// Largest difference of the rate from 1, in both directions [–].
    pub max_rate: f64,
    /// Step between offsets [s].
    pub step_s: f64,
    /// Largest angle by which lines of sight may miss one another [rad].
    pub tolerance_rad: f64,
    /// How long both must see the target [s].
    pub min_overlap_s: f64,
    /// The best offset must exceed chance by this factor more than any other [–].
    pub min_distinction: f64,
}

/// The clock of camera b against that of camera a: b = a + `offset_s` + (`rate` − 1) (a − `middle_s`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairClock {
    /// At `middle_s` [s].
    pub offset_s: f64,
    /// Of b against a [–].
    pub rate: f64,
    /// On a's clock [s].
    pub middle_s: f64,
    /// Mean gain, 0 to 1.
    pub gain: f64,
    /// Mean gain over all trials.
    pub chance: f64,
    /// Excess over chance, relative to that of the best offset elsewhere; at least `min_distinction`.
    pub distinction: f64,
    /// For how long both cameras see the target [s].
    pub overlap_s: f64,
}

impl PairClock {
    /// What b's clock shows when a's shows `a_s`.
    pub fn b_s(&self, a_s: f64) -> f64 {
        a_s + self.offset_s + (self.rate - 1.0) * (a_s - self.middle_s)
    }
}

/// Why the clocks of two tracks cannot be related.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SearchError {
    /// Cameras in one place, or one that saw nothing.
    #[error("the cameras are at one place, or one of them saw nothing")]
    NoBaseline,
    /// At no offset do both see the target for long.
    #[error("at no offset do both see the target for more than {best_s:.1} s, expected {min_s:.1} s")]
    TooShort {
        /// The longest [s].
        best_s: f64,
        /// The required time [s].
        min_s: f64,
    },
    /// Every offset is as good as any other: the target hardly moves, or along the same plane.
    #[error("every offset agrees as well as any other: gain {gain:.2} at best, {chance:.2} on average")]
    Flat {
        /// At the best offset.
        gain: f64,
        /// Over all offsets.
        chance: f64,
    },
    /// Two offsets agree.
    #[error("two offsets agree: {first_s:.1} s and {second_s:.1} s, the one {distinction:.2} times as well")]
    Ambiguous {
        /// The best [s].
        first_s: f64,
        /// The best elsewhere [s].
        second_s: f64,
        /// Excess over chance of the first over that of the second.
        distinction: f64,
    },
}

/// The least by which a gain must exceed chance.
const LEAST_EXCESS: f64 = 0.15;
/// Offsets that differ by less belong to one peak [s].
const PEAK_S: f64 = 3.0;
/// Bearings of a that are tried are this many steps apart.
const STRIDE: usize = 4;

/// Tries all offsets and rates.
///
/// # Errors
/// See [`SearchError`].
pub fn search(a: &Bearings, b: &Bearings, options: &SearchOptions) -> Result<PairClock, SearchError> {
    let baseline = (b.centre - a.centre).try_normalize(1e-9).ok_or(SearchError::NoBaseline)?;
    let (Some((a_start, a_end)), Some((b_start, _))) = (a.span_s(), b.span_s()) else {
        return Err(SearchError::NoBaseline);
    };
    let trials = Trials {
        baseline,
        a: a.resampled(a_start, options.step_s * STRIDE as f64),
        b: b.resampled(b_start, options.step_s),
        a_start,
        b_start,
        middle_s: 0.5 * (a_start + a_end),
        options,
    };
    let n_offsets = (options.max_offset_s / options.step_s).ceil() as i64;
    // A rate moves the ends of the recording against its middle: two steps of offset there are close enough.
    let half_length = (0.5 * (a_end - a_start)).max(options.step_s);
    let rate_step = 2.0 * options.step_s / half_length;
    let n_rates = (options.max_rate / rate_step).ceil() as i64;
    let least = (options.min_overlap_s / (options.step_s * STRIDE as f64)).ceil().max(3.0);
    // By offset: the best over the rates.
    let mut best: Vec<Trial> = Vec::with_capacity(2 * n_offsets as usize + 1);
    let (mut sum, mut count) = (0.0, 0.0);
    for offset in -n_offsets..=n_offsets {
        let offset_s = offset as f64 * options.step_s;
        let at_one = trials.gain(offset_s, 1.0);
        sum += at_one.gain * at_one.count;
        count += at_one.count;
        best.push(at_one);
    }
    let longest = best.iter().fold(0.0_f64, |longest, it| longest.max(it.count));
    if longest < least {
        let best_s = longest * options.step_s * STRIDE as f64;
        return Err(SearchError::TooShort { best_s, min_s: options.min_overlap_s });
    }
    let chance = sum / count;
    let excess = |it: &Trial| if it.count < least { 0.0 } else { (it.gain - chance).max(0.0) * it.count.sqrt() };
    for place in &mut best {
        for rate in (-n_rates..=n_rates).filter(|it| *it != 0) {
            let trial = trials.gain(place.offset_s, 1.0 + rate as f64 * rate_step);
            if excess(&trial) > excess(place) {
                *place = trial;
            }
        }
    }
    let highest =
        |among: &mut dyn Iterator<Item = &Trial>| among.copied().max_by(|x, y| excess(x).total_cmp(&excess(y)));
    let Some(first) = highest(&mut best.iter()) else { return Err(SearchError::NoBaseline) };
    if first.gain - chance < LEAST_EXCESS || first.count < least {
        return Err(SearchError::Flat { gain: first.gain, chance });
    }
    let second = highest(&mut best.iter().filter(|it| (it.offset_s - first.offset_s).abs() > PEAK_S));
    let distinction = second.map_or(f64::INFINITY, |it| excess(&first) / excess(&it));
    if distinction < options.min_distinction {
        let second_s = second.map_or(f64::NAN, |it| it.offset_s);
        return Err(SearchError::Ambiguous { first_s: first.offset_s, second_s, distinction });
    }
    Ok(PairClock {
        offset_s: first.offset_s,
        rate: first.rate,
        middle_s: trials.middle_s,
        gain: first.gain,
        chance,
        distinction,
        overlap_s: first.count * options.step_s * STRIDE as f64,
    })
}

/// Both tracks at regular times of their own.
struct Trials<'a> {
    baseline: Vector3<f64>,
    a: Vec<Option<Vector3<f64>>>,
    b: Vec<Option<Vector3<f64>>>,
    a_start: f64,
    b_start: f64,
    middle_s: f64,
    options: &'a SearchOptions,
}

#[derive(Clone, Copy)]
struct Trial {
    offset_s: f64,
    rate: f64,
    gain: f64,
    count: f64,
}

impl Trials<'_> {
    fn gain(&self, offset_s: f64, rate: f64) -> Trial {
        let step = self.options.step_s;
        let per_square = self.options.tolerance_rad.powi(-2);
        let (mut sum, mut count) = (0.0, 0.0);
        // Place in b of the first bearing of a, and how far it moves on from one to the next.
        let at_start = self.a_start + offset_s + (rate - 1.0) * (self.a_start - self.middle_s) - self.b_start;
        let (first, on) = (at_start / step + 0.5, rate * STRIDE as f64);
        for (index, of_a) in self.a.iter().enumerate() {
            let place = first + on * index as f64;
            if place < 0.0 {
                continue;
            }
            let Some(of_b) = self.b.get(place as usize) else { break };
            let (Some(of_a), Some(of_b)) = (of_a, of_b) else { continue };
            if let Some((angle, _)) = miss(&self.baseline, of_a, of_b) {
                sum += (1.0 - angle * angle * per_square).max(0.0);
                count += 1.0;
            }
        }
        Trial { offset_s, rate, gain: if count > 0.0 { sum / count } else { 0.0 }, count }
    }
}
