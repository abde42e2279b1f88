//! All clocks together, from pairs that were compared individually.
//!
//! A tree of the pairs that agree best gives each camera's clock against one of them; contradicting pairs are left out. Then all
//! offsets and rates are adjusted so that the lines of sight of all pairs meet best: damped least squares under Cauchy's loss, whose
//! scale follows the residuals down. Lines of sight that miss for another reason (a small error of a camera's pose) do so for
//! seconds on end, so they are not independent: the uncertainty is that of leaving out one interval after
//! another and solving again (jackknife).

use foveate::estimation::Loss;
use foveate::estimation::least_squares::{self, Equations, Options};
use nalgebra::{DVector, RowVector2, RowVector4, Vector1, Vector3};

use super::bearings::{Bearings, miss};
use super::search::PairClock;

/// A pair of cameras, by number, and the clock of the second against the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Camera a.
    pub a: usize,
    /// Camera b.
    pub b: usize,
    /// Result of the search.
    pub clock: PairClock,
}

/// A camera's clock against the reference camera's: own = `offset_s` + `rate` · reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolvedClock {
    /// Its reading when the reference's is 0 [s].
    pub offset_s: f64,
    /// Its seconds in a second of the reference's [–].
    pub rate: f64,
    /// Standard deviation of its reading in the middle of its recording [s].
    pub sigma_s: f64,
    /// Standard deviation of the rate [–].
    pub sigma_rate: f64,
}

/// All clocks.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// By camera; `None` where no pair reaches it.
    pub clocks: Vec<Option<SolvedClock>>,
    /// Pairs that contradict the others, by their place in the list of links.
    pub contradicting: Vec<usize>,
    /// Median angle by which lines of sight miss one another [rad].
    pub miss_rad: f64,
}

/// Largest difference between a pair's offset and the others' [s].
const CONTRADICTION_S: f64 = 1.0;
/// Spacing of the bearings that are used [s].
const THINNED_S: f64 = 0.1;
const BLOCKS: usize = 10;

/// Solves for all cameras that `links` connect to camera `reference`.
pub fn solve(bearings: &[Bearings], links: &[Link], reference: usize) -> Solution {
    let mut clocks: Vec<Option<[f64; 2]>> = vec![None; bearings.len()];
    if let Some(own) = clocks.get_mut(reference) {
        *own = Some([0.0, 1.0]);
    }
    let mut order: Vec<usize> = (0..links.len()).collect();
    let strength = |link: &Link| (link.clock.gain - link.clock.chance) * link.clock.overlap_s.sqrt();
    order.sort_by(|x, y| strength(&links[*y]).total_cmp(&strength(&links[*x])));
    // The strongest link that reaches a new camera comes next.
    while let Some((link, from_a)) = order.iter().find_map(|&it| {
        let link = &links[it];
        match (clocks[link.a], clocks[link.b]) {
            (Some(_), None) => Some((link, true)),
            (None, Some(_)) => Some((link, false)),
            _ => None,
        }
    }) {
        let PairClock { offset_s, rate, middle_s, .. } = link.clock;
        let at_zero = offset_s - (rate - 1.0) * middle_s; // b = at_zero + rate a
        match (clocks[link.a], clocks[link.b]) {
            (Some([o, r]), _) if from_a => clocks[link.b] = Some([at_zero + rate * o, rate * r]),
            (_, Some([o, r])) => clocks[link.a] = Some([(o - at_zero) / rate, r / rate]),
            _ => unreachable!("one of the two was known"),
        }
    }
    let contradicts = |link: &Link| {
        let (Some(a), Some(b)) = (clocks[link.a], clocks[link.b]) else { return false };
        let session = (link.clock.middle_s - a[0]) / a[1];
        (link.clock.b_s(link.clock.middle_s) - (b[0] + b[1] * session)).abs() > CONTRADICTION_S
    };
    let contradicting: Vec<usize> = (0..links.len()).filter(|it| contradicts(&links[*it])).collect();
    let problem = Problem::new(bearings, links, &contradicting, &clocks, reference);
    let (solved, miss_rad) = problem.solve(&problem.start(&clocks), None);
    let left_out: Vec<DVector<f64>> = (0..BLOCKS).map(|block| problem.solve(&solved, Some(block)).0).collect();
    let n = BLOCKS as f64;
    let sigma = |of: &dyn Fn(&DVector<f64>) -> f64| {
        let mean = left_out.iter().map(of).sum::<f64>() / n;
        ((n - 1.0) / n * left_out.iter().map(|it| (of(it) - mean).powi(2)).sum::<f64>()).sqrt()
    };
    let clocks = (0..bearings.len()).map(|camera| {
        clocks[camera]?;
        let Some(place) = problem.places[camera] else {
            return Some(SolvedClock { offset_s: 0.0, rate: 1.0, sigma_s: 0.0, sigma_rate: 0.0 });
        };
        let middle = problem.middle_s;
        let (shift, rate) = (solved[place], 1.0 + solved[place + 1]);
        Some(SolvedClock {
            offset_s: shift - solved[place + 1] * middle,
            rate,
            sigma_s: sigma(&|it| it[place]),
            sigma_rate: sigma(&|it| it[place + 1]),
        })
    });
    Solution { clocks: clocks.collect(), contradicting, miss_rad }
}

/// The unknowns of a camera: o and ρ of own = s + o + ρ (s − middle), s being the reference's time.
struct Problem<'a> {
    bearings: &'a [Bearings],
    pairs: Vec<(usize, usize, Vector3<f64>)>,
    /// By camera: index of its two unknowns.
    places: Vec<Option<usize>>,
    n_unknowns: usize,
    /// Middle time on the reference's clock, so that offsets and rates are nearly uncorrelated [s].
    middle_s: f64,
    /// Start and length of a block of the jackknife [s].
    blocks: (f64, f64),
}

/// The problem at one scale of the loss [rad].
struct Scaled<'a> {
    problem: &'a Problem<'a>,
    left_out: Option<usize>,
    scale: f64,
}

impl least_squares::Problem for Scaled<'_> {
    type Parameters = DVector<f64>;

    fn dimension(&self) -> usize {
        self.problem.n_unknowns
    }

    fn moved(&self, from: &DVector<f64>, step: &DVector<f64>) -> DVector<f64> {
        from + step
    }

    fn linearise(&self, at: &DVector<f64>, equations: &mut Equations) -> Option<()> {
        let places = &self.problem.places;
        self.problem.for_each(at, self.left_out, |a, b, angle, by_a, by_b| {
            let residual = Vector1::new(angle / self.scale);
            let [by_a, by_b] = [by_a, by_b].map(|it| RowVector2::from(it) / self.scale);
            match (places[a], places[b]) {
                (Some(a), Some(b)) => {
                    let jacobian = RowVector4::new(by_a.x, by_a.y, by_b.x, by_b.y);
                    equations.add(&[a, a + 1, b, b + 1], &residual, &jacobian);
                }
                (Some(a), None) => equations.add(&[a, a + 1], &residual, &by_a),
                (None, Some(b)) => equations.add(&[b, b + 1], &residual, &by_b),
                (None, None) => {}
            }
        });
        // Fewer bearings that overlap are no gain.
        equations.average();
        Some(())
    }
}

impl<'a> Problem<'a> {
    fn new(
        bearings: &'a [Bearings],
        links: &[Link],
        contradicting: &[usize],
        clocks: &[Option<[f64; 2]>],
        reference: usize,
    ) -> Self {
        let used = links.iter().enumerate().filter(|(index, link)| {
            !contradicting.contains(index) && clocks[link.a].is_some() && clocks[link.b].is_some()
        });
        let pairs = used.filter_map(|(_, link)| {
            let baseline = (bearings[link.b].centre - bearings[link.a].centre).try_normalize(1e-9)?;
            Some((link.a, link.b, baseline))
        });
        let mut n_unknowns = 0;
        let places = clocks.iter().enumerate().map(|(camera, clock)| {
            clock.filter(|_| camera != reference)?;
            n_unknowns += 2;
            Some(n_unknowns - 2)
        });
        let places = places.collect();
        let spans = bearings.iter().zip(clocks).filter_map(|(bearings, clock)| {
            let ([offset, rate], (start, end)) = ((*clock)?, bearings.span_s()?);
            Some(((start - offset) / rate, (end - offset) / rate))
        });
        let (start, end) = spans.fold((f64::INFINITY, f64::NEG_INFINITY), |all, it| (all.0.min(it.0), all.1.max(it.1)));
        let (start, end) = if start < end { (start, end) } else { (0.0, 1.0) };
        let blocks = (start, (end - start) / BLOCKS as f64);
        Self { bearings, pairs: pairs.collect(), places, n_unknowns, middle_s: 0.5 * (start + end), blocks }
    }

    fn start(&self, clocks: &[Option<[f64; 2]>]) -> DVector<f64> {
        let mut unknowns = DVector::zeros(self.n_unknowns);
        for (place, clock) in self.places.iter().zip(clocks) {
            if let (Some(place), Some([offset, rate])) = (*place, *clock) {
                unknowns[place] = offset + (rate - 1.0) * self.middle_s;
                unknowns[place + 1] = rate - 1.0;
            }
        }
        unknowns
    }

    /// Offset and rate − 1 of a camera.
    fn clock(&self, unknowns: &DVector<f64>, camera: usize) -> (f64, f64) {
        self.places[camera].map_or((0.0, 0.0), |place| (unknowns[place], unknowns[place + 1]))
    }

    /// Calls `each` with miss angle, and its derivatives by the unknowns of both cameras, for each bearing of each pair.
    fn for_each(
        &self,
        unknowns: &DVector<f64>,
        left_out: Option<usize>,
        mut each: impl FnMut(usize, usize, f64, [f64; 2], [f64; 2]),
    ) {
        for &(a, b, baseline) in &self.pairs {
            let ((shift_a, rate_a), (shift_b, rate_b)) = (self.clock(unknowns, a), self.clock(unknowns, b));
            let mut last = f64::NEG_INFINITY;
            for bearing in self.bearings[a].list() {
                if bearing.time_s - last < THINNED_S {
                    continue;
                }
                last = bearing.time_s;
                // a's time is that of the bearing; the session's follows from it, and b's from that.
                let since_middle = (bearing.time_s - self.middle_s - shift_a) / (1.0 + rate_a);
                let session = self.middle_s + since_middle;
                let block = ((session - self.blocks.0) / self.blocks.1).max(0.0) as usize;
                if left_out == Some(block.min(BLOCKS - 1)) {
                    continue;
                }
                let Some((of_b, change)) = self.bearings[b].at(session + shift_b + rate_b * since_middle) else {
                    continue;
                };
                let Some((angle, per_scale)) = miss(&baseline, &bearing.direction, &of_b) else { continue };
                let by_time_of_b = baseline.cross(&bearing.direction).dot(&change) * per_scale;
                let by_session = by_time_of_b * (1.0 + rate_b) / (1.0 + rate_a);
                each(
                    a,
                    b,
                    angle,
                    [-by_session, -by_session * since_middle],
                    [by_time_of_b, by_time_of_b * since_middle],
                );
            }
        }
    }

    /// Median absolute miss angle [rad].
    fn median_miss(&self, unknowns: &DVector<f64>, left_out: Option<usize>) -> f64 {
        let mut angles = Vec::new();
        self.for_each(unknowns, left_out, |_, _, angle, _, _| angles.push(angle.abs()));
        let middle = angles.len() / 2;
        if angles.is_empty() { f64::NAN } else { *angles.select_nth_unstable_by(middle, f64::total_cmp).1 }
    }

    /// The unknowns with the smallest loss, and the median miss [rad].
    fn solve(&self, start: &DVector<f64>, left_out: Option<usize>) -> (DVector<f64>, f64) {
        let mut unknowns = start.clone();
        for _ in 0..4 {
            let median = self.median_miss(&unknowns, left_out);
            if self.n_unknowns == 0 || median.is_nan() {
                break;
            }
            let scale = (1.5 * median).max(1e-6);
            let scaled = Scaled { problem: self, left_out, scale };
            let loss = Loss::Cauchy { scale: 1.0 };
            let options = Options { loss, max_iterations: 40, relative_gain: 1e-9, ..Options::default() };
            let Ok(found) = least_squares::solve(&scaled, unknowns.clone(), &options) else { break };
            unknowns = found.parameters;
        }
        let median = self.median_miss(&unknowns, left_out);
        (unknowns, median)
    }
}
