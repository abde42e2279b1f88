//! Association of features with targets.
//!
//! Each target is projected into the camera; features within a gate around it are candidates [Davis 2002 §3.4]. The distance is
//! the filter's own measure, νᵀS⁻¹ν + ln det S: the likelihood, up to a constant. The second term lets a target
//! with a small covariance win over an uncertain one, such as a new one, which the distance νᵀS⁻¹ν alone would
//! favour. One feature per target, by one of three methods:
//!
//! | method | rule |
//! |---|---|
//! | nearest | the best pair is fixed first, then the best of the rest |
//! | global | the pairs whose costs have the least sum; a target without a feature costs as much as one at its gate |
//! | hypotheses | as global, and where a second choice is nearly as good, both are kept (`hypotheses`) |
//!
//! Only targets whose gates share a feature compete, so that the work grows with the targets and not with their square.

use std::f64::consts::PI;

use foveate::estimation::assignment::{Workspace, optimal};
use foveate::estimation::motion::Filter;
use foveate::geometry::Camera;
use foveate::messages::Feature;
use nalgebra::{Matrix2, Matrix2x3, Point2, Vector2};

use super::unresolved::Predicted;

/// Conditions of a pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gate {
    /// Largest √(νᵀS⁻¹ν) [–].
    pub sigma: f64,
    /// Largest |ν| [px].
    pub pixels: f64,
    /// Variance added to each axis of each feature [px²].
    pub camera_variance: f64,
    /// Mean squared error of the frame's time [s²].
    pub time_variance: f64,
    /// Estimated density of false features in a frame of this camera [1/px²].
    pub clutter: f64,
}

/// One filter of a target, as a view of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    /// Number of the target.
    pub track: usize,
    pub filter: &'a Filter,
    /// Most false features that its gate may hold in one frame, on average [–].
    pub most_clutter: f64,
    /// Recent detection rate, where it is certain enough to share a feature with another target [–].
    pub shares: Option<f64>,
}

/// Cost of a target without a feature: −2 ln of a density of false features of one in a picture of
/// 640 × 240 and a chance of 0.3 to be hidden, in the units of [`Pair::cost`].
const MISS_COST: f64 = 22.0;

/// A target and a candidate feature.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    /// νᵀS⁻¹ν + ln det S; less is better.
    pub cost: f64,
    /// Place of the filter among those that were offered.
    pub view: usize,
    /// Number of the target.
    pub track: usize,
    /// Number of the feature.
    pub feature: usize,
    /// Measured position of the target by the feature [px].
    pub pixel: Point2<f64>,
    /// Measured minus expected [px].
    pub innovation: Vector2<f64>,
    /// Of the pixel by the position [px/m].
    pub jacobian: Matrix2x3<f64>,
    /// Uncertainty beyond the feature's own covariance and the camera's error: of a spot that is two targets [px²].
    pub spread: Matrix2<f64>,
}

/// The search for pairs, with its buffers.
#[derive(Debug, Default)]
pub(super) struct Association {
    /// Row and number of each usable feature, ascending by row.
    pub(super) rows: Vec<(f64, usize)>,
    /// All pairs within the gate, by view.
    candidates: Vec<Pair>,
    /// Those that were chosen: at most one a target, at most one a feature.
    pub(super) chosen: Vec<Pair>,
    /// By target: whether it has a feature.
    pub(super) target_taken: Vec<bool>,
    /// By target: whether it lies in the camera's field of view.
    in_view: Vec<bool>,
    /// By feature: whether it has a target.
    pub(super) feature_taken: Vec<bool>,
    /// By feature: whether it lies in the gate of a target that is too uncertain to take it.
    disputed: Vec<bool>,
    /// Targets that may share a feature.
    pub(super) predicted: Vec<Predicted>,
    /// By target: whether it shares a feature with another one.
    pub(super) is_unresolved: Vec<bool>,
    /// Features without finite numbers or with a negative variance.
    pub unusable: u64,
    clusters: Clusters,
    costs: Vec<f64>,
    workspace: Workspace,
    assigned: Vec<Option<usize>>,
}

impl Association {
    /// Finds all pairs within the gate of `features` and of the filters in `views`, which are of the frame's time. The views of one target
    /// follow one another.
    pub fn find_candidates<'a>(
        &mut self,
        n_tracks: usize,
        views: impl Iterator<Item = View<'a>>,
        camera: &Camera,
        features: &[Feature],
        gate: &Gate,
    ) {
        let largest_variance = self.sort_features(features);
        self.candidates.clear();
        self.chosen.clear();
        self.in_view.clear();
        self.in_view.resize(n_tracks, false);
        self.target_taken.clear();
        self.target_taken.resize(n_tracks, false);
        self.predicted.clear();
        self.is_unresolved.clear();
        self.is_unresolved.resize(n_tracks, false);
        for (number, view) in views.enumerate() {
            self.pair_up(number, &view, camera, features, gate, largest_variance);
        }
    }

    /// Chooses the best pair, then the best of the rest, and so on.
    pub fn choose_nearest(&mut self) {
        // A complete order: equal costs by identity, then by place, so that a run can be repeated.
        self.candidates.sort_unstable_by(|a, b| {
            a.cost.total_cmp(&b.cost).then_with(|| (a.track, a.feature).cmp(&(b.track, b.feature)))
        });
        for index in 0..self.candidates.len() {
            let pair = self.candidates[index];
            if !self.target_taken[pair.track] && !self.feature_taken[pair.feature] {
                self.choose(pair);
            }
        }
    }

    /// Chooses the pairs with the smallest sum of costs.
    pub fn choose_global(&mut self) {
        self.cluster(std::iter::empty::<(usize, usize)>());
        for number in 0..self.clusters.len() {
            self.choose_best_of(number, |_| true);
        }
    }

    /// Whether target number `track` shared a feature of the last frame with another target.
    pub fn is_unresolved(&self, track: usize) -> bool {
        self.is_unresolved.get(track).copied().unwrap_or(false)
    }

    /// Chooses the best pairs of cluster `number`, among those that `counts` accepts.
    pub fn choose_best_of(&mut self, number: usize, counts: impl Fn(&Pair) -> bool) {
        let cluster = self.clusters.get(number);
        let (n_rows, n_columns) = (cluster.tracks.len(), cluster.features.len());
        self.costs.clear();
        self.costs.resize(n_rows * n_columns, f64::NAN);
        for &index in cluster.candidates {
            let pair = &self.candidates[index];
            let row = cluster.tracks.binary_search(&pair.track);
            let column = cluster.features.binary_search(&pair.feature);
            if let (Ok(row), Ok(column), true) = (row, column, counts(pair)) {
                self.costs[row * n_columns + column] = pair.cost;
            }
        }
        optimal(&self.costs, n_rows, n_columns, cluster.miss_cost, &mut self.workspace, &mut self.assigned);
        for &index in cluster.candidates {
            let pair = self.candidates[index];
            let row = cluster.tracks.binary_search(&pair.track);
            let column = cluster.features.binary_search(&pair.feature).ok();
            if counts(&pair) && row.is_ok_and(|row| column.is_some() && self.assigned[row] == column) {
                self.target_taken[pair.track] = true;
                self.feature_taken[pair.feature] = true;
                self.chosen.push(pair);
            }
        }
    }

    /// Separates the pairs without a competitor, and groups the rest: targets in one cluster share features, or are `tied`
    /// (pairs of numbers of targets). Returns the number of clusters.
    pub fn cluster(&mut self, tied: impl Iterator<Item = (usize, usize)>) -> usize {
        let n_tracks = self.target_taken.len();
        self.clusters.form(&self.candidates, n_tracks, self.feature_taken.len(), tied);
        for index in 0..self.clusters.plain.len() {
            self.choose(self.candidates[self.clusters.plain[index]]);
        }
        self.clusters.len()
    }

    /// Cluster `number` of [`Self::cluster`].
    pub fn in_cluster(&self, number: usize) -> Cluster<'_> {
        self.clusters.get(number)
    }

    /// All pairs within the gate.
    pub fn candidates(&self) -> &[Pair] {
        &self.candidates
    }

    /// Chooses candidate number `candidate`.
    pub fn choose_candidate(&mut self, candidate: usize) {
        self.choose(self.candidates[candidate]);
    }

    fn choose(&mut self, pair: Pair) {
        self.target_taken[pair.track] = true;
        self.feature_taken[pair.feature] = true;
        self.chosen.push(pair);
    }

    /// Notes that `track` has a feature in the likeliest hypothesis.
    pub fn note_target(&mut self, track: usize) {
        self.target_taken[track] = true;
    }

    /// Notes that `feature` belongs to a target in some hypothesis.
    pub fn note_feature(&mut self, feature: usize) {
        self.feature_taken[feature] = true;
    }

    /// The pairs of the last frame: at most one a target, at most one a feature.
    pub fn pairs(&self) -> &[Pair] {
        &self.chosen
    }

    /// Whether target number `track` got a feature in the last frame.
    pub fn has_feature(&self, track: usize) -> bool {
        self.target_taken.get(track).copied().unwrap_or(false)
    }

    /// Whether target number `track` lay in the field of view of the last frame's camera.
    pub fn in_view(&self, track: usize) -> bool {
        self.in_view.get(track).copied().unwrap_or(false)
    }

    /// How many features of the last frame belong to a target.
    pub fn n_used(&self) -> usize {
        self.feature_taken.iter().filter(|it| **it).count()
    }

    /// How many features of the last frame belong to two targets.
    pub fn n_shared(&self) -> usize {
        self.is_unresolved.iter().filter(|it| **it).count() / 2
    }

    /// How many features of the last frame are no target's, and in no target's gate.
    pub fn n_false(&self) -> usize {
        self.unmatched().filter(|&feature| !self.disputed[feature]).count()
    }

    /// The usable features of the last frame that no target got.
    pub fn unmatched(&self) -> impl Iterator<Item = usize> + '_ {
        self.rows.iter().map(|it| it.1).filter(|&feature| !self.feature_taken[feature])
    }

    /// Lists the usable features by row; returns the largest variance among them [px²].
    fn sort_features(&mut self, features: &[Feature]) -> f64 {
        self.rows.clear();
        self.feature_taken.clear();
        self.feature_taken.resize(features.len(), false);
        self.disputed.clear();
        self.disputed.resize(features.len(), false);
        let mut largest: f64 = 0.0;
        for (index, feature) in features.iter().enumerate() {
            let [a, b, c] = [feature.covariance[(0, 0)], feature.covariance[(0, 1)], feature.covariance[(1, 1)]];
            let finite = feature.centre.coords.sum().is_finite() && (a + b + c).is_finite();
            if !(finite && a >= 0.0 && c >= 0.0 && a * c >= b * b) {
                self.unusable += 1;
                continue;
            }
            largest = largest.max(a + c);
            self.rows.push((feature.centre.y, index));
        }
        self.rows.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        largest
    }

    /// Adds the pairs of one view of a target.
    fn pair_up(
        &mut self,
        number: usize,
        &View { track, filter, most_clutter, shares }: &View<'_>,
        camera: &Camera,
        features: &[Feature],
        gate: &Gate,
        largest_variance: f64,
    ) {
        let projected = camera.project_with_jacobian(&filter.position());
        self.in_view[track] |= projected.is_some_and(|(pixel, _)| camera.has_pixel(&pixel));
        let Some((expected, jacobian)) = projected else { return };
        let own = gate.noise(&Matrix2::zeros(), &jacobian, filter);
        let predicted = filter.innovation_covariance(&jacobian, &own);
        if let Some(share) = shares {
            let covariance = predicted - own;
            self.predicted.push(Predicted { track, view: number, share, pixel: expected, jacobian, covariance });
        }
        let area = PI * gate.sigma * gate.sigma * predicted.determinant().max(0.0).sqrt();
        let dares = area * gate.clutter <= most_clutter;
        // No axis of S is longer than its trace; a feature further away than that cannot pass the gate.
        let reach = gate.pixels.min(gate.sigma * (predicted.trace() + largest_variance).sqrt());
        let first = self.rows.partition_point(|row| row.0 < expected.y - reach);
        for &(row, feature) in &self.rows[first..] {
            if row > expected.y + reach {
                break;
            }
            let innovation = features[feature].centre - expected;
            if !(innovation.x.abs() <= reach && innovation.norm_squared() <= gate.pixels * gate.pixels) {
                continue;
            }
            let s = predicted + features[feature].covariance;
            let determinant = s[(0, 0)] * s[(1, 1)] - s[(0, 1)] * s[(1, 0)];
            let (x, y) = (innovation.x, innovation.y);
            let squared = (s[(1, 1)] * x * x - (s[(0, 1)] + s[(1, 0)]) * x * y + s[(0, 0)] * y * y) / determinant;
            let inside = determinant > 0.0 && squared <= gate.sigma * gate.sigma;
            if inside && !dares {
                self.disputed[feature] = true;
            } else if inside {
                let cost = squared + determinant.ln();
                let (pixel, spread) = (features[feature].centre, Matrix2::zeros());
                self.candidates.push(Pair { cost, view: number, track, feature, pixel, innovation, jacobian, spread });
            }
        }
    }
}

impl Gate {
    /// The covariance of a feature with the camera's own error, and that of its time along the motion of the target, which `filter` and
    /// the `jacobian` of the pixel by its position know [px²].
    pub fn noise(&self, feature: &Matrix2<f64>, jacobian: &Matrix2x3<f64>, filter: &Filter) -> Matrix2<f64> {
        let noise = widened(feature, self.camera_variance);
        if self.time_variance == 0.0 {
            return noise;
        }
        let moves = jacobian * filter.velocity();
        noise + moves * moves.transpose() * self.time_variance
    }
}

/// A feature's covariance and the camera's own error [px²].
pub(super) fn widened(covariance: &Matrix2<f64>, camera_variance: f64) -> Matrix2<f64> {
    covariance + Matrix2::identity() * camera_variance
}

/// Competing targets.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cluster<'a> {
    /// Numbers of the targets, ascending.
    pub tracks: &'a [usize],
    /// Numbers of the features, ascending.
    pub features: &'a [usize],
    /// Places among the candidates.
    pub candidates: &'a [usize],
    /// What a target without a feature costs.
    pub miss_cost: f64,
}

/// Clusters of competing targets.
#[derive(Debug, Default)]
struct Clusters {
    /// Candidates without a competitor.
    plain: Vec<usize>,
    /// By target: the first of its cluster, by links.
    parent: Vec<usize>,
    /// By target: pairs with it, and whether it is tied to another.
    of_track: Vec<(u32, bool)>,
    /// By feature: pairs with it and the first target of them.
    of_feature: Vec<(u32, usize)>,
    /// Cluster, then the target, feature or candidate.
    tracks: Vec<(usize, usize)>,
    features: Vec<(usize, usize)>,
    candidates: Vec<(usize, usize)>,
    lists: Lists,
    /// By cluster: ends of its targets, features and candidates in `lists`, and the cost of a miss.
    ends: Vec<([usize; 3], f64)>,
}

#[derive(Debug, Default)]
struct Lists {
    tracks: Vec<usize>,
    features: Vec<usize>,
    candidates: Vec<usize>,
}

impl Clusters {
    fn form(&mut self, pairs: &[Pair], n_tracks: usize, n_features: usize, tied: impl Iterator<Item = (usize, usize)>) {
        self.plain.clear();
        self.ends.clear();
        self.of_track.clear();
        self.of_track.resize(n_tracks, (0, false));
        self.of_feature.clear();
        self.of_feature.resize(n_features, (0, usize::MAX));
        self.parent.clear();
        self.parent.extend(0..n_tracks);
        for (a, b) in tied {
            self.of_track[a].1 = true;
            self.of_track[b].1 = true;
            self.join(a, b);
        }
        for pair in pairs {
            self.of_track[pair.track].0 += 1;
            let (count, first) = &mut self.of_feature[pair.feature];
            *count += 1;
            let first = std::mem::replace(first, pair.track);
            if first != usize::MAX {
                self.join(first, pair.track);
            }
        }
        let is_plain = |of_track: &[(u32, bool)], of_feature: &[(u32, usize)], pair: &Pair| {
            of_track[pair.track] == (1, false) && of_feature[pair.feature].0 == 1
        };
        self.tracks.clear();
        self.features.clear();
        self.candidates.clear();
        for (index, pair) in pairs.iter().enumerate() {
            if is_plain(&self.of_track, &self.of_feature, pair) {
                self.plain.push(index);
                continue;
            }
            let root = self.root(pair.track);
            self.tracks.push((root, pair.track));
            self.features.push((root, pair.feature));
            self.candidates.push((root, index));
        }
        for track in 0..n_tracks {
            if self.of_track[track].1 {
                let root = self.root(track);
                self.tracks.push((root, track)); // without any feature as well
            }
        }
        self.list(pairs);
    }

    /// Cuts the sorted lists at the borders of the clusters.
    fn list(&mut self, pairs: &[Pair]) {
        for list in [&mut self.tracks, &mut self.features, &mut self.candidates] {
            list.sort_unstable();
            list.dedup();
        }
        for (from, to) in [
            (&self.tracks, &mut self.lists.tracks),
            (&self.features, &mut self.lists.features),
            (&self.candidates, &mut self.lists.candidates),
        ] {
            to.clear();
            to.extend(from.iter().map(|it| it.1));
        }
        let (mut feature, mut candidate) = (0, 0);
        for (place, &(root, _)) in self.tracks.iter().enumerate() {
            if self.tracks.get(place + 1).is_some_and(|it| it.0 == root) {
                continue;
            }
            let mut largest = f64::NEG_INFINITY;
            while self.features.get(feature).is_some_and(|it| it.0 == root) {
                feature += 1;
            }
            while let Some(&(_, index)) = self.candidates.get(candidate).filter(|it| it.0 == root) {
                largest = largest.max(pairs[index].cost);
                candidate += 1;
            }
            self.ends.push(([place + 1, feature, candidate], largest.max(MISS_COST)));
        }
    }

    fn len(&self) -> usize {
        self.ends.len()
    }

    fn get(&self, number: usize) -> Cluster<'_> {
        let ([tracks, features, candidates], miss_cost) = self.ends[number];
        let start = number.checked_sub(1).map_or([0; 3], |before| self.ends[before].0);
        Cluster {
            tracks: &self.lists.tracks[start[0]..tracks],
            features: &self.lists.features[start[1]..features],
            candidates: &self.lists.candidates[start[2]..candidates],
            miss_cost,
        }
    }

    fn root(&mut self, mut track: usize) -> usize {
        while self.parent[track] != track {
            self.parent[track] = self.parent[self.parent[track]];
            track = self.parent[track];
        }
        track
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b);
    }
}
