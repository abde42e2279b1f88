//! Painted marks against the truth: distances between them, identities, and errors of those filled in.

use std::collections::BTreeMap;

use foveate_diagnostics::fields::number;
use foveate_estimation::statistics::{median, percentile};
use foveate_geometry::{Alignment, AlignmentOptions, align};
use foveate_messages::{CameraId, Marks, Provenance, Time};
use foveate_node::Report;
use nalgebra::{Point3, Similarity3};

/// A recovered mark farther than this from all true ones is none of them [m].
const GATE: f64 = 0.008;
/// Before anything is known, a recovered mark may be this far from the true one, since the whole is [m].
const FARTHEST: f64 = 0.03;
/// Steps of the search for the motion of the whole.
const CLOSER_STEPS: usize = 12;
/// A mark that is farther than this from the one that it was, and closer to another, is another [m].
const OTHER: f64 = 0.004;
/// Pairs that should keep their distance lie this far apart [m].
const PAIRS: std::ops::Range<f64> = 0.015..0.08;
/// The pairs whose true distance changes least are those that should keep it: so many.
const N_PAIRS: usize = 60;
/// Share of the frames that both marks of a pair must be measured in.
const PAIR_SHARE: f64 = 0.2;

/// Marks of a group, one of them and those nearest to it, that should keep their distances: as many as lie below the eye in [Davis 2002 Fig. 64].
const GROUP: usize = 4;

/// Two labels over all moments in which both are measured.
struct Pair {
    labels: [u32; 2],
    /// True distance, mean [m].
    mean: f64,
    /// Deviation of the true distance from that, median [m].
    changes: f64,
    /// Recovered and true distances [m].
    found: Vec<f64>,
    truth: Vec<f64>,
}

impl Pair {
    /// Error of the recovered distance [m].
    fn errors(&self) -> impl Iterator<Item = f64> + '_ {
        self.found.iter().zip(&self.truth).map(|(a, b)| (a - b).abs())
    }

    /// Its deviation from its own mean [m].
    fn deviations(&self) -> impl Iterator<Item = f64> + '_ {
        let mean = self.found.iter().sum::<f64>() / self.found.len() as f64;
        self.found.iter().map(move |it| (it - mean).abs())
    }
}

/// All pairs of the group whose true distances change least, of a mark and the three nearest to it; empty where no four are often measured together.
fn stiffest_group(pairs: &[Pair]) -> Vec<&Pair> {
    let mut near: BTreeMap<u32, Vec<(f64, u32)>> = BTreeMap::new();
    let mut between: BTreeMap<[u32; 2], &Pair> = BTreeMap::new();
    for pair in pairs {
        let [a, b] = pair.labels;
        near.entry(a).or_default().push((pair.mean, b));
        near.entry(b).or_default().push((pair.mean, a));
        between.insert([a.min(b), a.max(b)], pair);
    }
    let groups = near.into_iter().filter_map(|(middle, mut others)| {
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut members: Vec<u32> = others.iter().take(GROUP - 1).map(|it| it.1).chain([middle]).collect();
        members.sort_unstable();
        let all: Vec<[u32; 2]> = (0..members.len())
            .flat_map(|b| (0..b).map(move |a| (a, b)))
            .map(|(a, b)| [members[a], members[b]])
            .collect();
        let known: Vec<&Pair> = all.iter().filter_map(|it| between.get(it).copied()).collect();
        (members.len() == GROUP && known.len() == all.len()).then_some(known)
    });
    let changes = |group: &Vec<&Pair>| group.iter().map(|it| it.changes).sum::<f64>();
    groups.min_by(|a, b| changes(a).total_cmp(&changes(b))).unwrap_or_default()
}

/// One mark as it was recovered.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    label: u32,
    in_world: Point3<f64>,
    provenance: Provenance,
    /// Stated, of one axis [m].
    sigma: f64,
}

/// In how many pictures of a moment a true mark could be found.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InView {
    /// Cameras before which nothing hides it.
    pub cameras: u8,
    /// Cameras whose pictures had a dot there, named or not.
    pub dots: u8,
}

/// All marks of one moment, recovered and true.
#[derive(Debug, Clone, PartialEq)]
struct Moment {
    time: Time,
    samples: Vec<Sample>,
    truth: Vec<Point3<f64>>,
    /// By true mark; empty where not requested.
    in_view: Vec<InView>,
    rms: Option<f64>,
    out_of_distribution: Option<f64>,
}

impl Moment {
    /// Each named sample with where it truly is.
    fn pairs<'s>(&'s self, names: &'s Names) -> impl Iterator<Item = (Sample, Point3<f64>)> + 's {
        self.samples.iter().filter_map(|it| Some((*it, *self.truth.get(*names.get(&it.label)?)?)))
    }
}

/// The rigid motion that brings the samples closest to true marks, whichever these are (P. J. Besl and N. D. McKay, "A method for registration of 3-D shapes", TPAMI
/// 14(2), 1992).
fn closest_motion(moment: &Moment) -> Similarity3<f64> {
    let samples: Vec<Point3<f64>> = moment.samples.iter().map(|it| it.in_world).collect();
    let mut motion = Similarity3::identity();
    for _ in 0..CLOSER_STEPS {
        let pair = |it: &Point3<f64>| {
            let near = nearest(&(motion * it), &moment.truth).filter(|it| it.1 < FARTHEST)?;
            Some((*it, moment.truth[near.0]))
        };
        let (found, truth): (Vec<_>, Vec<_>) = samples.iter().filter_map(pair).unzip();
        let Ok(better) = align(&found, &truth, AlignmentOptions::default()) else { break };
        motion = better.b_from_a;
    }
    motion
}

/// The rigid motion that brings all samples closest to the truth; `None` where they fix none.
fn to_truth(pairs: &[(Sample, Point3<f64>)]) -> Option<Alignment> {
    let (found, truth): (Vec<_>, Vec<_>) = pairs.iter().map(|it| (it.0.in_world, it.1)).unzip();
    align(&found, &truth, AlignmentOptions { robust: true, ..AlignmentOptions::default() }).ok()
}

/// What was recovered over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MarkTrack {
    moments: Vec<Moment>,
}

/// Which true mark each label is.
pub type Names = BTreeMap<u32, usize>;

impl MarkTrack {
    /// Takes in what was recovered of `truth`, the true places of the marks at that time in the world, by their numbers; `in_view`: in how many pictures each of them could be found,
    /// empty where that does not matter.
    pub fn add(&mut self, marks: &Marks, truth: Vec<Point3<f64>>, in_view: Vec<InView>) {
        let sample = |it: &foveate_messages::Mark| Sample {
            label: it.label,
            in_world: marks.in_world(it),
            provenance: it.provenance,
            sigma: it.sigma(),
        };
        let samples = marks.list.iter().map(sample).collect();
        let (rms, out_of_distribution) = marks.fit.as_ref().map(|it| (it.rms, it.out_of_distribution)).unzip();
        self.moments.push(Moment { time: marks.time, samples, truth, in_view, rms, out_of_distribution });
    }

    /// Which true mark each label is: the one that it was closest to most often while it was measured, once the motion of the whole was taken off. Labels that
    /// mostly were close to none are left out: they are something else that looks like a mark.
    pub fn names(&self) -> Names {
        let rough = self.vote(GATE, false, closest_motion);
        self.vote(OTHER, true, |moment| {
            let pairs: Vec<_> = moment.pairs(&rough).collect();
            to_truth(&pairs).map_or_else(Similarity3::identity, |it| it.b_from_a)
        })
    }

    /// What most moments say, once `motion` has brought their marks to the truth. With `may_be_none`, being close to no true mark is a vote, too.
    fn vote(&self, gate: f64, may_be_none: bool, motion: impl Fn(&Moment) -> Similarity3<f64>) -> Names {
        let mut votes: BTreeMap<u32, BTreeMap<Option<usize>, u32>> = BTreeMap::new();
        for moment in &self.moments {
            let motion = motion(moment);
            for sample in moment.samples.iter().filter(|it| it.provenance == Provenance::Measured) {
                let near = nearest(&(motion * sample.in_world), &moment.truth).filter(|it| it.1 < gate);
                if may_be_none || near.is_some() {
                    *votes.entry(sample.label).or_default().entry(near.map(|it| it.0)).or_default() += 1;
                }
            }
        }
        let most =
            |votes: BTreeMap<Option<usize>, u32>| votes.into_iter().max_by_key(|it| (it.1, std::cmp::Reverse(it.0)));
        votes.into_iter().filter_map(|(label, votes)| Some((label, most(votes)?.0?))).collect()
    }

    /// How many labels are no mark at all, and how many samples they have, measured and filled.
    fn extra(&self, names: &Names) -> (usize, [usize; 2]) {
        let samples = || self.moments.iter().flat_map(|it| &it.samples).filter(|it| !names.contains_key(&it.label));
        let mut labels: Vec<u32> = samples().map(|it| it.label).collect();
        labels.sort_unstable();
        labels.dedup();
        let of = |provenance: Provenance| samples().filter(|it| it.provenance == provenance).count();
        (labels.len(), [of(Provenance::Measured), of(Provenance::Filled)])
    }

    /// Pairs of labels that are often measured together, of two marks.
    fn often(&self, names: &Names) -> Vec<Pair> {
        let labels: Vec<u32> = names.keys().copied().collect();
        let mut pairs = Vec::new();
        for (place, a) in labels.iter().enumerate() {
            for b in labels[..place].iter().filter(|it| names[a] != names[it]) {
                let (found, truth) = self.pair(names, [*a, *b]);
                if found.len() as f64 > PAIR_SHARE * self.moments.len() as f64 {
                    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
                    let changes = median(&truth.iter().map(|it| (it - mean).abs()).collect::<Vec<_>>()).unwrap_or(0.0);
                    pairs.push(Pair { labels: [*a, *b], mean, changes, found, truth });
                }
            }
        }
        pairs.sort_by(|a, b| a.changes.total_cmp(&b.changes));
        pairs
    }

    /// Recovered and true distance of two labels in each moment in which both are measured [m].
    fn pair(&self, names: &Names, pair: [u32; 2]) -> (Vec<f64>, Vec<f64>) {
        let both = |moment: &Moment| {
            let place = |label: u32| {
                let sample =
                    moment.samples.iter().find(|it| it.label == label && it.provenance == Provenance::Measured)?;
                Some((sample.in_world, *moment.truth.get(names[&label])?))
            };
            let (one, other) = (place(pair[0])?, place(pair[1])?);
            Some(((one.0 - other.0).norm(), (one.1 - other.1).norm()))
        };
        self.moments.iter().filter_map(both).unzip()
    }

    /// Figures of distances between marks, under names that end in `suffix`.
    pub fn report_distances(&self, names: &Names, suffix: &str, report: &mut Report) {
        let pairs = self.often(names);
        let apart = || pairs.iter().filter(|it| PAIRS.contains(&it.mean));
        let errors: Vec<f64> = apart().flat_map(Pair::errors).collect();
        let kept: Vec<f64> = apart().take(N_PAIRS).flat_map(Pair::deviations).collect();
        let group: Vec<f64> = stiffest_group(&pairs).into_iter().flat_map(Pair::deviations).collect();
        let mut figures = |name: &str, values: &[f64]| {
            for (which, percent) in [("median", 50.0), ("p95", 95.0), ("max", 100.0)] {
                let value = percentile(values, percent).map_or(f64::NAN, |it| it * 1e3);
                report.figure(format!("{name}.{which}{suffix}"), value);
            }
        };
        figures("pair_distance_mm", &kept);
        figures("pair_error_mm", &errors);
        figures("group_distance_mm", &group);
        let mut wrong = 0;
        let mut seen = 0;
        for moment in &self.moments {
            let pairs: Vec<_> = moment.pairs(names).filter(|it| it.0.provenance == Provenance::Measured).collect();
            seen += pairs.len();
            let Some(motion) = to_truth(&pairs) else { continue };
            for (sample, own) in &pairs {
                let place = motion.b_from_a * sample.in_world;
                let near = nearest(&place, &moment.truth).map_or(f64::INFINITY, |it| it.1);
                let off = (place - own).norm();
                wrong += usize::from(off > OTHER && near < off);
            }
        }
        report.figure(format!("marks_measured{suffix}"), seen as f64);
        report.figure(format!("mark_identity_errors{suffix}"), wrong as f64);
        let (labels, [measured, filled]) = self.extra(names);
        report.figure(format!("marks_extra{suffix}"), labels as f64);
        report.figure(format!("marks_extra.measured{suffix}"), measured as f64);
        report.figure(format!("marks_extra.filled{suffix}"), filled as f64);
    }

    /// Figures of a model's marks: errors in its own space and in the world, and of those that it filled in.
    pub fn report_shape(&self, names: &Names, n_true: usize, report: &mut Report) {
        let mut errors = Errors::default();
        for moment in &self.moments {
            errors.add(moment, names);
        }
        let Errors { whole, world, filled, filled_in_view, filled_sigmas } = &errors;
        let mut spread = |name: &str, values: &[f64]| {
            for (which, percent) in [("median", 50.0), ("p95", 95.0)] {
                report.figure(format!("{name}.{which}"), percentile(values, percent).map_or(f64::NAN, |it| it * 1e3));
            }
        };
        spread("face_mm", whole);
        spread("face_world_mm", world);
        spread("filled_mm", filled);
        let frames = self.moments.len().max(1) as f64;
        let share = |of: &dyn Fn(&Moment) -> bool| self.moments.iter().filter(|it| of(it)).count() as f64 / frames;
        let covers = |moment: &Moment, is_counted: &dyn Fn(Provenance) -> bool| {
            let mut marks: Vec<usize> = moment
                .samples
                .iter()
                .filter(|it| is_counted(it.provenance))
                .filter_map(|it| names.get(&it.label).copied())
                .collect();
            marks.sort_unstable();
            marks.dedup();
            marks.len() >= n_true
        };
        spread("filled_in_view_mm", filled_in_view);
        report.figure("filled", filled.len() as f64);
        report.figure("filled_in_view", filled_in_view.len() as f64);
        let rms = |list: &[(f64, f64)]| (list.iter().map(|it| it.1 * it.1).sum::<f64>() / list.len() as f64).sqrt();
        report.figure("filled_sigmas.rms", rms(filled_sigmas));
        // Two errors may make one right number.
        let mut by_sigma = filled_sigmas.clone();
        by_sigma.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (sure, vague) = by_sigma.split_at(by_sigma.len() / 2);
        report.figure("filled_sigmas.sure_half", rms(sure));
        report.figure("filled_sigmas.vague_half", rms(vague));
        report.figure("frames_with_all_marks", share(&|it| covers(it, &|_| true)));
        report.figure(
            "frames_with_all_measured",
            share(&|it| covers(it, &|provenance| provenance == Provenance::Measured)),
        );
        report.figure(
            "frames_out_of_distribution",
            share(&|it| it.out_of_distribution.is_some_and(|out_of_distribution| out_of_distribution > 0.5)),
        );
    }

    /// Rows of a table: one for each moment.
    pub fn rows(&self, names: &Names) -> Vec<String> {
        let row = |moment: &Moment| {
            let mut errors = Errors::default();
            errors.add(moment, names);
            let middle = |values: &[f64]| number(1e3 * median(values).unwrap_or(f64::NAN), 4);
            let count = |provenance: Provenance| moment.samples.iter().filter(|it| it.provenance == provenance).count();
            let of = |it: Option<f64>, scale: f64| number(scale * it.unwrap_or(f64::NAN), 4);
            format!(
                "{:.6},{},{},{},{},{},{},{}",
                moment.time.as_s(),
                count(Provenance::Measured),
                count(Provenance::Filled),
                middle(&errors.whole),
                middle(&errors.world),
                middle(&errors.filled),
                of(moment.rms, 1e3),
                of(moment.out_of_distribution, 1.0)
            )
        };
        self.moments.iter().map(row).collect()
    }

    /// Rows of a table: one for each filled mark.
    pub fn filled_rows(&self, names: &Names) -> Vec<String> {
        let rows = |moment: &Moment| {
            let pairs: Vec<_> = moment.pairs(names).collect();
            let Some(motion) = to_truth(&pairs) else { return Vec::new() };
            let filled = pairs.iter().zip(&motion.distances).filter(|it| it.0.0.provenance == Provenance::Filled);
            let row = |((sample, _), off): (&(Sample, Point3<f64>), &f64)| {
                let own = names[&sample.label];
                let InView { cameras, dots } = moment.in_view.get(own).copied().unwrap_or_default();
                let (time, label, sigma) = (moment.time.as_s(), sample.label, sample.sigma * 1e3);
                let (off, sigma) = (number(off * 1e3, 4), number(sigma, 4));
                format!("{time:.6},{label},{own},{off},{sigma},{cameras},{dots}")
            };
            filled.map(row).collect()
        };
        self.moments.iter().flat_map(rows).collect()
    }

    /// Heading of [`Self::filled_rows`].
    pub const FILLED_HEADING: &str = "time_s,mark,true_mark,off_mm,sigma_mm,cameras_in_view,cameras_with_dot";

    /// Heading of [`Self::rows`].
    pub const HEADING: &str = "time_s,measured,filled,face_mm,face_world_mm,filled_mm,fit_rms_mm,out_of_distribution";
}

/// Distances from the truth [m].
#[derive(Default)]
struct Errors {
    /// After the rigid motion that brings all marks closest to the truth.
    whole: Vec<f64>,
    world: Vec<f64>,
    filled: Vec<f64>,
    /// Those of the filled ones that two cameras or more could see.
    filled_in_view: Vec<f64>,
    /// Of the filled ones what they state [m], and how far they are off, in stated standard deviations of three axes.
    filled_sigmas: Vec<(f64, f64)>,
}

impl Errors {
    fn add(&mut self, moment: &Moment, names: &Names) {
        let pairs: Vec<_> = moment.pairs(names).collect();
        let Some(motion) = to_truth(&pairs) else { return };
        let is_in_view = |label: u32| moment.in_view.get(names[&label]).is_some_and(|it| it.cameras >= 2);
        for ((sample, truth), off) in pairs.iter().zip(&motion.distances) {
            self.whole.push(*off);
            self.world.push((sample.in_world - truth).norm());
            if sample.provenance == Provenance::Filled {
                self.filled.push(*off);
                self.filled_in_view.extend(is_in_view(sample.label).then_some(*off));
                self.filled_sigmas.push((sample.sigma, off / (3.0_f64.sqrt() * sample.sigma)));
            }
        }
    }
}

/// Number of and distance to the closest of `places` [m].
fn nearest(to: &Point3<f64>, places: &[Point3<f64>]) -> Option<(usize, f64)> {
    let distances = places.iter().map(|it| (it - to).norm()).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// A mark that was reported in a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportedMark {
    /// When.
    pub time: Time,
    /// By which camera.
    pub camera: CameraId,
    /// Under which name.
    pub label: u32,
    /// Its distance from where each true mark is in that picture, by number [px]; not a number for those that are not before the camera.
    pub distances: Vec<f32>,
}

impl ReportedMark {
    /// From where its own mark truly is [px].
    fn off(&self, names: &Names) -> Option<f64> {
        self.distances.get(*names.get(&self.label)?).map(|it| f64::from(*it))
    }

    fn is_wrong(&self, names: &Names, wrong_px: f64) -> bool {
        self.off(names).is_some_and(|it| it.partial_cmp(&wrong_px).is_none_or(|it| it.is_gt()))
    }
}

/// What trackers reported of marks in pictures, against where these truly were.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MarkObservationTrack {
    reported: Vec<ReportedMark>,
}

impl MarkObservationTrack {
    /// Takes in a mark that was reported.
    pub fn add(&mut self, reported: ReportedMark) {
        self.reported.push(reported);
    }

    /// How many marks were reported, and those of them that were farther than `wrong_px` from where they truly are.
    pub fn wrong<'s>(
        &'s self,
        names: &'s Names,
        wrong_px: f64,
    ) -> (usize, impl Iterator<Item = &'s ReportedMark> + 's) {
        let all = self.reported.iter().filter(|it| names.contains_key(&it.label)).count();
        (all, self.reported.iter().filter(move |it| it.is_wrong(names, wrong_px)))
    }

    /// Distances of those that were reported near where their mark truly was [px].
    pub fn right(&self, names: &Names, wrong_px: f64) -> Vec<f64> {
        self.reported.iter().filter_map(|it| it.off(names)).filter(|it| *it <= wrong_px).collect()
    }

    /// Rows of a table of the wrong ones: when, which camera, which name, which true mark that is and how far off, which true mark is closest and how far that is.
    pub fn wrong_rows(&self, names: &Names, wrong_px: f64, camera: impl Fn(CameraId) -> String) -> Vec<String> {
        let row = |it: &ReportedMark| {
            let near = it.distances.iter().enumerate().filter(|it| it.1.is_finite()).min_by(|a, b| a.1.total_cmp(b.1));
            let (nearest, distance) = near.map_or((String::new(), f32::NAN), |it| (it.0.to_string(), *it.1));
            let own = names.get(&it.label).map_or(String::new(), usize::to_string);
            let off = number(it.off(names).unwrap_or(f64::NAN), 3);
            let distance = number(f64::from(distance), 3);
            let (time_s, camera) = (it.time.as_s(), camera(it.camera));
            format!("{time_s:.6},{camera},{},{own},{off},{nearest},{distance}", it.label)
        };
        self.wrong(names, wrong_px).1.map(row).collect()
    }

    /// Heading of [`Self::wrong_rows`].
    pub const HEADING: &str = "time_s,camera,mark,true_mark,off_px,nearest_true_mark,off_nearest_px";
}

#[cfg(test)]
mod tests {
    use foveate_messages::{CameraSet, Mark};
    use nalgebra::{Isometry3, Matrix3, Vector3};

    use super::*;

    fn truth() -> Vec<Point3<f64>> {
        (0..20)
            .map(|it| Point3::new(f64::from(it % 5) * 0.02, 0.001 * f64::from(it * it % 7), f64::from(it / 5) * 0.02))
            .collect()
    }

    fn marks(places: &[(u32, Point3<f64>, Provenance)]) -> Marks {
        let mark = |(label, position, provenance): &(u32, Point3<f64>, Provenance)| Mark {
            label: *label,
            position: *position,
            covariance: Matrix3::identity() * 1e-6,
            cameras: CameraSet::default(),
            provenance: *provenance,
        };
        Marks { list: places.iter().map(mark).collect(), ..Marks::default() }
    }

    fn figures(of: impl FnOnce(&mut Report)) -> BTreeMap<String, f64> {
        let mut report = Report::default();
        of(&mut report);
        report.figures
    }

    #[test]
    fn what_is_filled_is_judged_without_the_motion_of_the_whole() {
        let truth = truth();
        let mut track = MarkTrack::default();
        let motion = Isometry3::new(Vector3::new(0.003, 0.0, 0.0), Vector3::new(0.0, 0.01, 0.0));
        for frame in 0..5 {
            let place = |(label, it): (u32, &Point3<f64>)| {
                let is_hidden = frame > 2 && label == 6;
                let off = if is_hidden { Vector3::x() * 0.001 } else { Vector3::zeros() };
                (label + 100, motion * (it + off), if is_hidden { Provenance::Filled } else { Provenance::Measured })
            };
            let places: Vec<_> = (0..).zip(&truth).map(place).collect();
            // One camera sees it in the fourth frame, two in the fifth.
            let in_view = InView { cameras: if frame == 4 { 2 } else { 1 }, dots: 1 };
            track.add(&marks(&places), truth.clone(), vec![in_view; 20]);
        }
        let names = track.names();
        assert_eq!(names[&106], 6);
        let found = figures(|report| track.report_shape(&names, 20, report));
        assert!((found["filled_mm.median"] - 1.0).abs() < 0.1, "{found:?}");
        assert!(found["face_mm.median"] < 0.1 && found["face_world_mm.median"] > 2.0, "{found:?}");
        for which in ["rms", "sure_half", "vague_half"] {
            let sigmas = found[&format!("filled_sigmas.{which}")];
            assert!((sigmas - 1.0 / 3.0_f64.sqrt()).abs() < 0.1, "{which}: {found:?}");
        }
        assert_eq!((found["filled"], found["filled_in_view"]), (2.0, 1.0));
        let rows = track.filled_rows(&names);
        assert!(rows.len() == 2 && rows[1].contains(",106,6,") && rows[1].ends_with(",2,1"), "{rows:?}");
        assert_eq!((found["frames_with_all_marks"], found["frames_with_all_measured"]), (1.0, 0.6));
    }

    #[test]
    fn marks_that_change_places_are_counted_and_distances_compared_with_their_means() {
        let truth = truth();
        let mut track = MarkTrack::default();
        for frame in 0..40 {
            let shake = if frame % 2 == 0 { 0.5e-3 } else { -0.5e-3 };
            let mut places: Vec<_> = (0..).zip(&truth).map(|(label, it)| (label, *it, Provenance::Measured)).collect();
            places[3].1.z += shake;
            if frame == 39 {
                (places[8].1, places[9].1) = (places[9].1, places[8].1);
            }
            places.push((77, Point3::new(1.0, 1.0, 1.0), Provenance::Measured));
            track.add(&marks(&places), truth.clone(), Vec::new());
        }
        let names = track.names();
        let found = figures(|report| track.report_distances(&names, "", report));
        assert_eq!((found["mark_identity_errors"], found["marks_extra"]), (2.0, 1.0));
        assert_eq!((found["marks_extra.measured"], found["marks_extra.filled"]), (40.0, 0.0));
        assert!(found["pair_distance_mm.median"] < 0.01 && found["pair_distance_mm.max"] > 0.4, "{found:?}");
        assert!(found["group_distance_mm.median"] < 0.01, "{found:?}");
    }

    #[test]
    fn of_all_groups_of_four_the_one_that_changes_least_is_judged() {
        // Two clusters of four; the one that is 20 cm off changes by 2 mm, and its marks are recovered well; a mark of the other is off by 0.5 mm, up and down.
        let corner =
            |it: u32| Point3::new(0.02 * f64::from(it % 2), 0.02 * f64::from(it / 2 % 2), 0.2 * f64::from(it / 4));
        let mut track = MarkTrack::default();
        for frame in 0..40 {
            let side = if frame % 2 == 0 { 1.0 } else { -1.0 };
            let truth: Vec<_> =
                (0..8).map(|it| corner(it) + Vector3::x() * if it == 5 { 1e-3 * side } else { 0.0 }).collect();
            let off = |it: u32| Vector3::x() * if it == 1 { 0.5e-3 * side } else { 0.0 };
            let places: Vec<_> =
                (0..).zip(&truth).map(|(it, place)| (it, place + off(it), Provenance::Measured)).collect();
            track.add(&marks(&places), truth, Vec::new());
        }
        let names = track.names();
        let found = figures(|report| track.report_distances(&names, "", report));
        // Three of six distances have that mark.
        assert!((found["group_distance_mm.max"] - 0.5).abs() < 0.02, "{found:?}");
        assert!(found["group_distance_mm.p95"] > 0.3, "{found:?}");
    }

    #[test]
    fn a_sight_is_wrong_when_it_is_far_from_its_own_mark() {
        let mut track = MarkObservationTrack::default();
        let names: Names = [(5, 1)].into();
        for (label, distances) in [(5, [20.0, 0.4]), (5, [0.3, 12.0]), (5, [0.3, f32::NAN]), (6, [0.1, 0.1])] {
            track.add(ReportedMark { time: Time::ZERO, camera: CameraId(3), label, distances: distances.into() });
        }
        let (all, wrong) = track.wrong(&names, 4.0);
        assert_eq!((all, wrong.count()), (3, 2));
        let rows = track.wrong_rows(&names, 4.0, |it| format!("ptz-{}", it.0));
        assert_eq!(rows, ["0.000000,ptz-3,5,1,12.000,0,0.300", "0.000000,ptz-3,5,1,,0,0.300"]);
        assert_eq!(track.right(&names, 4.0).len(), 1);
    }
}
