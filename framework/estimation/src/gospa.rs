//! Distance between the set of recovered points and the set of true ones, in one number: OSPA and GOSPA.
//!
//! Both match the points of one set to those of the other at the least cost, cut distances off at c, and penalise points
//! without a partner. OSPA (D. Schuhmacher, B.-T. Vo and B.-N. Vo, "A consistent metric for performance evaluation of
//! multi-object filters", IEEE TSP 56(8), 2008, equation 3) is a mean over the larger set; GOSPA (A. S. Rahmathullah,
//! Á. F. García-Fernández and L. Svensson, "Generalized optimal sub-pattern assignment metric", FUSION 2017,
//! proposition 1: α = 2) is a sum that splits into localisation, missed and false.
//!
//! | here | papers | meaning |
//! |---|---|---|
//! | `cutoff` | c | largest distance of a pair |
//! | `order` | p | higher orders weigh outliers more |
//! | [`Comparison::n_pairs`] | \|γ\| | true points with a partner |
//! | [`Comparison::localisation`] | Σ d(x, y)ᵖ | over the pairs |
//!
//! One assignment serves both. A pair at distance d ≤ c saves GOSPA cᵖ − dᵖ, and saves OSPA just as much; an exact tie
//! at d = c counts as a pair and changes neither.

use nalgebra::Point3;

use crate::assignment::{self, Workspace};

/// Compares sets of points, and reuses its memory from call to call.
#[derive(Debug, Clone)]
pub struct SetDistance {
    cutoff: f64,
    order: f64,
    costs: Vec<f64>,
    partners: Vec<Option<usize>>,
    workspace: Workspace,
}

/// The difference of two sets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// True points with a recovered one within the cut-off.
    pub n_pairs: usize,
    /// True points without a recovered one: misses.
    pub n_missed: usize,
    /// Recovered points without a true one: false positives.
    pub n_false: usize,
    /// Sum over the pairs of their distances to the power of the order [unit of the points to that power].
    pub localisation: f64,
    cutoff: f64,
    order: f64,
}

impl SetDistance {
    /// A metric with this `cutoff` (in the unit of the points, above 0; larger distances count as `cutoff`) and this `order` (1 or more).
    ///
    /// # Panics
    /// When either is out of its range.
    pub fn new(cutoff: f64, order: f64) -> Self {
        assert!(cutoff > 0.0 && cutoff.is_finite(), "the cut-off of a set distance is {cutoff}, expected more than 0");
        assert!(order >= 1.0 && order.is_finite(), "the order of a set distance is {order}, expected at least 1");
        let (costs, partners, workspace) = (Vec::new(), Vec::new(), Workspace::default());
        Self { cutoff, order, costs, partners, workspace }
    }

    /// Compares `found` with `truth`. A point that is not finite matches no other.
    pub fn compare(&mut self, truth: &[Point3<f64>], found: &[Point3<f64>]) -> Comparison {
        let power = |distance: f64| if self.order == 2.0 { distance * distance } else { distance.powf(self.order) };
        self.costs.clear();
        for point in truth {
            self.costs.extend(found.iter().map(|it| power((it - point).norm())));
        }
        let (rows, columns, gate) = (truth.len(), found.len(), power(self.cutoff));
        assignment::optimal(&self.costs, rows, columns, gate, &mut self.workspace, &mut self.partners);
        let pairs = self.partners.iter().enumerate().filter_map(|(row, it)| Some(self.costs[row * columns + (*it)?]));
        let (n_pairs, localisation) = pairs.fold((0, 0.0), |(count, sum), cost| (count + 1, sum + cost));
        let (n_missed, n_false) = (rows - n_pairs, columns - n_pairs);
        Comparison { n_pairs, n_missed, n_false, localisation, cutoff: self.cutoff, order: self.order }
    }

    /// For each true point of the last comparison, its index in `found`.
    pub fn partners(&self) -> &[Option<usize>] {
        &self.partners
    }
}

impl Comparison {
    /// OSPA: 0 for equal sets, at most the cut-off [unit of the points]. Two empty sets are equal.
    pub fn ospa(&self) -> f64 {
        let larger = self.n_pairs + self.n_missed.max(self.n_false);
        if larger == 0 {
            return 0.0;
        }
        let unpaired = (larger - self.n_pairs) as f64 * self.cutoff.powf(self.order);
        ((self.localisation + unpaired) / larger as f64).powf(1.0 / self.order)
    }

    /// GOSPA with α = 2: half a cut-off (to the power of the order) for each point without a partner [unit of the points].
    pub fn gospa(&self) -> f64 {
        let alone = (self.n_missed + self.n_false) as f64 * self.cutoff.powf(self.order) / 2.0;
        (self.localisation + alone).powf(1.0 / self.order)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn on_a_line(places: &[f64]) -> Vec<Point3<f64>> {
        places.iter().map(|x| Point3::new(*x, 0.0, 0.0)).collect()
    }

    fn compare(cutoff: f64, order: f64, truth: &[f64], found: &[f64]) -> Comparison {
        SetDistance::new(cutoff, order).compare(&on_a_line(truth), &on_a_line(found))
    }

    #[test]
    fn small_cases_are_as_computed_by_hand() {
        let equal = compare(0.1, 2.0, &[1.0, 2.0], &[2.0, 1.0]);
        assert_eq!((equal.ospa(), equal.gospa(), equal.n_pairs), (0.0, 0.0, 2));
        let empty = compare(0.1, 2.0, &[], &[]);
        assert_eq!((empty.ospa(), empty.gospa()), (0.0, 0.0));
        // One missing: √((c² + 0)/2) and √(c²/2).
        let missed = compare(0.1, 2.0, &[1.0, 2.0], &[1.0]);
        assert!((missed.ospa() - 0.1 / 2.0_f64.sqrt()).abs() < 1e-12, "{missed:?}");
        assert!((missed.gospa() - 0.1 / 2.0_f64.sqrt()).abs() < 1e-12, "{missed:?}");
        assert_eq!((missed.n_missed, missed.n_false), (1, 0));
        // A pair beyond the cut-off is one missed and one false: OSPA c, GOSPA √(2 · c²/2) = c.
        let apart = compare(0.1, 2.0, &[1.0], &[1.2]);
        assert_eq!((apart.n_pairs, apart.n_missed, apart.n_false), (0, 1, 1));
        assert!((apart.ospa() - 0.1).abs() < 1e-12 && (apart.gospa() - 0.1).abs() < 1e-12);
        // 30 mm and 40 mm off, and one false: (0.0009 + 0.0016 + 0.01)/3, and 0.0025 + 0.005.
        let mixed = compare(0.1, 2.0, &[0.0, 1.0], &[0.03, 1.04, 5.0]);
        assert!((mixed.ospa() - (0.0125_f64 / 3.0).sqrt()).abs() < 1e-12, "{mixed:?}");
        assert!((mixed.gospa() - 0.0075_f64.sqrt()).abs() < 1e-12, "{mixed:?}");
        // Order 1 adds distances.
        assert!((compare(0.1, 1.0, &[0.0, 1.0], &[0.03, 1.04]).ospa() - 0.035).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_a_number_is_missed_and_false() {
        let found = compare(0.1, 2.0, &[0.0], &[f64::NAN]);
        assert_eq!((found.n_missed, found.n_false, found.n_pairs), (1, 1, 0));
    }

    #[test]
    fn nearest_first_is_not_always_the_least() {
        // 0.05 and 0.04 are the nearest, but would leave 0 and 0.085 alone.
        let mut distance = SetDistance::new(0.08, 1.0);
        let found = distance.compare(&on_a_line(&[0.0, 0.05]), &on_a_line(&[0.04, 0.085]));
        assert_eq!((found.n_pairs, distance.partners()), (2, &[Some(0), Some(1)][..]));
    }

    /// Both papers' definitions, by trying every way to match.
    fn by_trial(cutoff: f64, order: f64, truth: &[f64], found: &[f64]) -> (f64, f64) {
        fn every(
            truth: &[f64],
            found: &[f64],
            used: u32,
            visit: &mut dyn FnMut(f64, usize),
            sum: (f64, usize),
            p: f64,
        ) {
            let Some((first, rest)) = truth.split_first() else { return visit(sum.0, sum.1) };
            every(rest, found, used, visit, sum, p);
            for (place, it) in found.iter().enumerate().filter(|(place, _)| used & (1 << place) == 0) {
                let cost = (first - it).abs().powf(p);
                every(rest, found, used | (1 << place), visit, (sum.0 + cost, sum.1 + 1), p);
            }
        }
        let (m, n) = (truth.len(), found.len());
        let c_p = cutoff.powf(order);
        let (mut ospa, mut gospa) = (f64::INFINITY, f64::INFINITY);
        let mut visit = |sum: f64, pairs: usize| {
            gospa = gospa.min(sum + c_p / 2.0 * (m + n - 2 * pairs) as f64);
            ospa = ospa.min(sum + c_p * (m.max(n) - pairs) as f64);
        };
        every(truth, found, 0, &mut visit, (0.0, 0), order);
        let ospa = if m.max(n) == 0 { 0.0 } else { (ospa / m.max(n) as f64).powf(1.0 / order) };
        (ospa, gospa.powf(1.0 / order))
    }

    proptest! {
        #[test]
        fn both_are_those_of_the_definitions(
            truth in prop::collection::vec(0.0..1.0, 0..5), found in prop::collection::vec(0.0..1.0, 0..5),
            cutoff in 0.05..0.5_f64, order in 1.0..3.0_f64,
        ) {
            let compared = compare(cutoff, order, &truth, &found);
            let (ospa, gospa) = by_trial(cutoff, order, &truth, &found);
            prop_assert!((compared.ospa() - ospa).abs() < 1e-9, "{compared:?} {ospa}");
            prop_assert!((compared.gospa() - gospa).abs() < 1e-9, "{compared:?} {gospa}");
        }

        #[test]
        fn both_are_metrics(
            a in prop::collection::vec(0.0..1.0, 0..5), b in prop::collection::vec(0.0..1.0, 0..5),
            c in prop::collection::vec(0.0..1.0, 0..5),
        ) {
            for of in [Comparison::ospa, Comparison::gospa] {
                let between = |x: &[f64], y: &[f64]| of(&compare(0.2, 2.0, x, y));
                prop_assert!((between(&a, &b) - between(&b, &a)).abs() < 1e-9);
                prop_assert!(between(&a, &c) <= between(&a, &b) + between(&b, &c) + 1e-9);
            }
        }
    }
}
