//! The integrator against a face of known marks, seen by heads that are a little off.

use std::sync::Arc;

use foveate::estimation::{Random, statistics::median};
use foveate_testkit::check_node;
use nalgebra::{Matrix2, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector2, Vector3};

use super::initiation::NEAR_KNOWN_PX;
use super::*;

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// 69 marks, 12 mm or more apart, on something like a face that looks along +Y, about (0, 0, 1.6) m.
pub(crate) fn marks_on_a_face() -> Vec<Point3<f64>> {
    let mut random = Random::new(69);
    let mut marks: Vec<Point3<f64>> = Vec::new();
    while marks.len() < 69 {
        let (x, z) = (random.uniform_in(-0.075, 0.075), random.uniform_in(-0.1, 0.1));
        let nose = 0.025 * (-(x * x + (z + 0.01).powi(2)) / 4e-4).exp();
        let mark = Point3::new(x, 0.08 - 7.0 * x * x - 2.5 * z * z + nose, 1.6 + z);
        if marks.iter().all(|it| (it - mark).norm() > 0.012) {
            marks.push(mark);
        }
    }
    marks
}

/// Four heads about a face, and where they are believed to stand.
pub(crate) struct Scene {
    pub cameras: Vec<Camera>,
    viewpoints: Vec<Viewpoint>,
    random: Random,
    frames: i64,
    sigma: f64,
}

impl Scene {
    /// Heads that are `error` off [rad].
    pub fn new(error: f64) -> Scene {
        let mut random = Random::new(5);
        let at = |x: f64| Point3::new(x, 2.9 - 0.2 * x * x, 1.95);
        let cameras: Vec<Camera> = [-1.7, -0.6, 0.65, 1.8]
            .map(|x| Camera::look_at(at(x), Point3::new(0.01, 0.03, 1.6), [640, 480], 2600.0))
            .into();
        let believed = |camera: &Camera| {
            let centre = camera.centre().coords;
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| random.normal() * error));
            let about = Translation3::from(centre) * turn * Translation3::from(-centre);
            let mut by_turn = SMatrix::<f64, 6, 3>::zeros();
            by_turn.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            by_turn.fixed_view_mut::<3, 3>(3, 0).copy_from(&centre.cross_matrix());
            let covariance: Matrix6<f64> = by_turn * by_turn.transpose() * error * error;
            let camera = Camera { camera_from_world: camera.camera_from_world * about, ..camera.clone() };
            Viewpoint { camera, covariance }
        };
        let viewpoints = cameras.iter().map(believed).collect();
        Scene { cameras, viewpoints, random: Random::new(6), frames: 0, sigma: 0.1 }
    }

    /// What the cameras report of `marks`, each under the name that `name` gives it in that view, if any.
    fn frame(
        &mut self,
        marks: &[Point3<f64>],
        is_seen: impl Fn(usize, usize) -> bool,
        name: impl Fn(usize, &Point2<f64>) -> Option<u32>,
    ) -> Frame {
        self.frames += 1;
        let mut views = Vec::new();
        for (index, (camera, viewpoint)) in self.cameras.iter().zip(&self.viewpoints).enumerate() {
            let mut list = Vec::new();
            for (_, place) in marks.iter().enumerate().filter(|it| is_seen(index, it.0)) {
                let noise = Vector2::new(self.random.normal(), self.random.normal()) * self.sigma;
                let centre = camera.project(place).unwrap() + noise;
                let covariance = Matrix2::identity() * self.sigma.powi(2);

                list.push(Feature { centre, covariance, area: 12, peak: 60, label: name(index, &centre) });
            }
            let features = Arc::new(Features { camera: CameraId(index as u16), list });
            views.push(View { id: CameraId(index as u16), viewpoint: viewpoint.clone(), features });
        }
        Frame { time: Time::from_s(self.frames as f64 / 30.0), views }
    }
}

/// What a tracker does with a guide while nothing moves: the dot closest to where a mark should be is that mark.
fn named(guide: &MarkGuide, view: usize, pixel: &Point2<f64>) -> Option<u32> {
    let marks = guide.of(CameraId(view as u16)).iter().filter(|it| !it.disputed);
    let nearest = marks.map(|it| ((it.pixel - pixel).norm(), it.label)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    (nearest.0 < 4.0).then_some(nearest.1)
}

fn integrator(settings: IntegratorSettings) -> Integrator {
    Integrator::new(settings, &Setup::for_tests()).unwrap()
}

/// The mark of the truth that each label is, by place.
fn identities(marks: &Marks, truth: &[Point3<f64>]) -> BTreeMap<u32, usize> {
    let nearest = |it: &Mark| {
        let place = marks.in_world(it);
        let distances = truth.iter().map(|it| (it - place).norm()).enumerate();
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0
    };
    marks.list.iter().map(|it| (it.label, nearest(it))).collect()
}

fn pair_errors(marks: &Marks, truth: &[Point3<f64>], names: &BTreeMap<u32, usize>) -> Vec<f64> {
    let place = |it: &Mark| (it.position, truth[names[&it.label]]);
    let places: Vec<_> = marks.list.iter().filter(|it| names.contains_key(&it.label)).map(place).collect();
    let pairs = (0..places.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    pairs.map(|(a, b)| ((places[a].0 - places[b].0).norm() - (places[a].1 - places[b].1).norm()).abs() * 1e3).collect()
}

#[test]
fn node_keeps_the_law() {
    check_node::<Integrator>("");
    check_node::<Integrator>("views = \"best_pair\"\npose_errors = false\nblend_ms = 0.0");
}

#[test]
fn settings_out_of_range_are_refused() {
    let refused = |change: fn(&mut IntegratorSettings)| {
        let mut settings = IntegratorSettings::default();
        change(&mut settings);
        Integrator::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting).unwrap()
    };
    assert_eq!(refused(|it| it.outlier_sigmas = f64::NAN), "outlier_sigmas");
    assert_eq!(refused(|it| it.initiation_views = 1), "initiation_views");
    assert_eq!(refused(|it| it.start_px = 0.0), "start_px");
    assert_eq!(refused(|it| it.blend_ms = -1.0), "blend_ms");
}

#[test]
fn dots_without_names_become_marks_and_keep_their_names() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.05 * DEGREE);
    let mut integrator = integrator(IntegratorSettings::default());
    let mut guide = MarkGuide::default();
    let mut names = BTreeMap::new();
    let mut last = None;
    for number in 0..20 {
        // Each view misses other marks, and others in each frame.
        let frame = scene.frame(
            &truth,
            |view, mark| !(mark + view * 17 + number / 4).is_multiple_of(9),
            |view, pixel| named(&guide, view, pixel),
        );
        let (marks, next) = integrator.integrate(&frame, None);
        guide = next;
        if let Some(marks) = marks {
            for (label, mark) in identities(&marks, &truth) {
                assert_eq!(*names.entry(label).or_insert(mark), mark, "mark {label} of frame {number}");
            }
            last = Some(marks);
        }
    }
    let marks = last.unwrap();
    let errors = pair_errors(&marks, &truth, &names);
    assert!(marks.list.len() >= 66, "{} marks", marks.list.len());
    assert!(median(&errors).unwrap() < 0.1, "{} mm", median(&errors).unwrap());
    let distinct: BTreeSet<usize> = names.values().copied().collect();
    assert_eq!(distinct.len(), names.len(), "one mark got two names");
}

#[test]
fn a_camera_that_follows_something_else_is_told_so_and_does_no_harm() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.02 * DEGREE);
    let mut integrator = integrator(IntegratorSettings::default());
    let exact = |scene: &Scene, view: usize, pixel: &Point2<f64>| {
        let of = |it: &Point3<f64>| (scene.cameras[view].project(it).unwrap() - pixel).norm();
        (0..truth.len()).min_by(|a, b| of(&truth[*a]).total_cmp(&of(&truth[*b]))).map(|it| it as u32)
    };
    let cameras = Scene::new(0.02 * DEGREE);
    let name = |view: usize, pixel: &Point2<f64>| match exact(&cameras, view, pixel) {
        // One camera takes mark 8 for mark 30.
        Some(30) if view == 1 => None,
        Some(8) if view == 1 => Some(30),
        other => other,
    };
    let frame = scene.frame(&truth, |_, _| true, name);
    let (marks, guide) = integrator.integrate(&frame, None);
    let disputed: Vec<(CameraId, u32)> = guide
        .cameras
        .iter()
        .flat_map(|(id, list)| list.iter().filter(|it| it.disputed).map(|it| (*id, it.label)))
        .collect();
    assert_eq!(disputed, [(CameraId(1), 30)]);
    let marks = marks.unwrap();
    let off = (marks.in_world(marks.get(30).unwrap()) - truth[30]).norm();
    assert!(off < 2e-3 && marks.get(30).unwrap().cameras.len() == 3, "{off} m");
}

#[test]
fn two_marks_taken_for_one_by_two_cameras_side_by_side_are_told_apart_again() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.02 * DEGREE);
    scene.sigma = 0.02;
    let cameras = scene.cameras.clone();
    let ray = |view: usize, mark: usize| cameras[view].ray(&cameras[view].project(&truth[mark]).unwrap()).unwrap();
    let seen_at = |view: usize, mark: usize, place: &Point3<f64>| {
        (cameras[view].project(&truth[mark]).unwrap() - cameras[view].project(place).unwrap()).norm()
    };
    // Marks a of camera 2 and b of camera 3 whose lines of sight meet behind the face.
    let pairs = (0..truth.len()).flat_map(|a| (0..truth.len()).map(move |b| (a, b))).filter(|it| it.0 != it.1);
    let meeting = |(a, b): (usize, usize)| {
        let place = foveate::geometry::triangulate_rays(&[ray(2, a), ray(3, b)])?;
        let miss = seen_at(2, a, &place).max(seen_at(3, b, &place));
        (miss < 0.05 && (place - truth[a]).norm() > 0.03 && (place - truth[b]).norm() < 0.2).then_some((a, b, place))
    };
    let (a, b, ghost) = pairs.filter_map(meeting).next().unwrap();
    let exact = |view: usize, pixel: &Point2<f64>| {
        let of = |mark: &usize| (cameras[view].project(&truth[*mark]).unwrap() - pixel).norm();
        (0..truth.len()).min_by(|one, other| of(one).total_cmp(&of(other))).unwrap()
    };
    for others_know in [true, false] {
        let mut integrator = integrator(IntegratorSettings::default());
        let first = scene.frame(
            &truth,
            |_, mark| others_know || (mark != a && mark != b),
            |view, pixel| Some(exact(view, pixel) as u32),
        );
        integrator.integrate(&first, None);
        integrator.track_store.initiate(ghost);
        let (label, mark) = integrator.track_store.marks.iter_mut().last().unwrap();
        // A third camera seemed to agree for a while.
        mark.is_believed = true;
        let label = *label;
        let mut guide = MarkGuide::default();
        for _ in 0..60 {
            let name = |view: usize, pixel: &Point2<f64>| match (view, exact(view, pixel)) {
                (2, it) if it == a => Some(label),
                (3, it) if it == b => Some(label),
                (_, it) if it == a || it == b => named(&guide, view, pixel).filter(|it| *it != label),
                (_, it) => Some(it as u32),
            };
            let frame = scene.frame(&truth, |_, _| true, name);
            guide = integrator.integrate(&frame, None).1;
        }
        assert!(integrator.track_store.retired.contains(&label), "others know the marks: {others_know}");
        assert!(guide.of(CameraId(2)).iter().any(|it| it.label == label && it.disputed));
    }
}

#[test]
fn what_one_camera_alone_takes_for_a_hidden_mark_has_to_be_near_it() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.02 * DEGREE);
    let mut integrator = integrator(IntegratorSettings::default());
    let cameras = scene.cameras.clone();
    let exact = |view: usize, pixel: &Point2<f64>| {
        let of = |mark: &usize| (cameras[view].project(&truth[*mark]).unwrap() - pixel).norm();
        (0..truth.len()).min_by(|one, other| of(one).total_cmp(&of(other))).map(|it| it as u32)
    };
    let disputed = |guide: &MarkGuide| {
        let of = |(id, list): &(CameraId, Vec<GuidedMark>)| -> Vec<_> {
            list.iter().filter(|it| it.disputed).map(|it| (*id, it.label)).collect()
        };
        guide.cameras.iter().flat_map(of).collect::<Vec<_>>()
    };
    let all = scene.frame(&truth, |_, _| true, exact);
    assert_eq!(disputed(&integrator.integrate(&all, None).1), []);
    for (beside, expected) in [(0.0, vec![]), (1.5, vec![]), (5.0, vec![(CameraId(1), 30)])] {
        // Camera 1 alone still sees mark 30.
        let mut frame = scene.frame(&truth, |view, mark| mark != 30 || view == 1, exact);
        let features = Arc::make_mut(&mut frame.views[1].features);
        features.list.iter_mut().find(|it| it.label == Some(30)).unwrap().centre.x += beside;
        assert_eq!(disputed(&integrator.integrate(&frame, None).1), expected, "{beside} px beside it");
    }
}

#[test]
fn marks_that_all_cameras_lost_get_their_names_again_somewhere_else() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.03 * DEGREE);
    let mut integrator = integrator(IntegratorSettings::default());
    let mut guide = MarkGuide::default();
    let mut names = BTreeMap::new();
    let motion = Isometry3::new(Vector3::new(0.06, 0.02, -0.03), Vector3::new(0.1, 0.05, 0.3));
    for number in 0..40 {
        let place =
            |it: &Point3<f64>| if number < 20 { *it } else { motion * (it - Vector3::z() * 1.6) + Vector3::z() * 1.6 };
        let marks_now: Vec<Point3<f64>> = truth.iter().map(place).collect();
        let is_away = (15..22).contains(&number);
        let frame = scene.frame(
            &marks_now,
            |_, _| !is_away,
            |view, pixel| named(&guide, view, pixel).filter(|_| !(15..=22).contains(&number)),
        );
        let (marks, next) = integrator.integrate(&frame, None);
        guide = next;
        let Some(marks) = marks else { continue };
        for (label, mark) in identities(&marks, &marks_now) {
            assert_eq!(*names.entry(label).or_insert(mark), mark, "mark {label} of frame {number}");
        }
        assert!(number < 30 || marks.list.len() > 64, "{} marks in frame {number}", marks.list.len());
    }
}

#[test]
fn one_pair_changes_to_another_without_a_visible_step() {
    let truth = marks_on_a_face();
    let largest_step = |blend_ms: f64| {
        let mut scene = Scene::new(0.1 * DEGREE);
        scene.sigma = 0.01;
        let cameras = Scene::new(0.1 * DEGREE);
        let settings = IntegratorSettings {
            views: Views::BestPair,
            pose_errors: false,
            blend_ms,
            ..IntegratorSettings::default()
        };
        let mut integrator = integrator(settings);
        let name = |view: usize, pixel: &Point2<f64>| {
            let of = |it: &Point3<f64>| (cameras.cameras[view].project(it).unwrap() - pixel).norm();
            (0..truth.len()).min_by(|a, b| of(&truth[*a]).total_cmp(&of(&truth[*b]))).map(|it| it as u32)
        };
        let mut last: Option<Marks> = None;
        let mut largest: f64 = 0.0;
        for number in 0..10 {
            // From the sixth frame on, the last camera sees half of the marks only.
            let frame = scene.frame(&truth, |view, mark| number < 5 || view < 3 || mark % 2 == 0, name);
            let marks = integrator.integrate(&frame, None).0.unwrap();
            assert!(marks.list.iter().all(|it| it.cameras.len() == 2));
            if let Some(last) = &last {
                let step = |it: &Mark| Some((marks.in_world(it) - last.in_world(last.get(it.label)?)).norm());
                largest = marks.list.iter().filter_map(step).fold(largest, f64::max);
            }
            last = Some(marks);
        }
        assert!(integrator.choice.changes > 0);
        largest * 1e3
    };
    let [sudden, spread] = [0.0, 500.0].map(largest_step);
    assert!(sudden > 2.0 && spread < 0.25 * sudden, "{sudden} mm, {spread} mm");
}

#[test]
fn frames_without_anything_say_nothing() {
    let mut scene = Scene::new(0.0);
    let mut integrator = integrator(IntegratorSettings::default());
    let empty = scene.frame(&[], |_, _| true, |_, _| None);
    let (marks, guide) = integrator.integrate(&empty, None);
    assert!(marks.is_none() && guide.cameras.iter().all(|it| it.1.is_empty()));
    let none = Frame { time: Time::ZERO, views: Vec::new() };
    assert!(integrator.integrate(&none, None).0.is_none());
}

/// An integrator that found the marks of a face by itself, its last guide, and the label that each mark of the truth got.
fn settled(scene: &mut Scene, truth: &[Point3<f64>]) -> (Integrator, MarkGuide, Vec<u32>) {
    let mut integrator = integrator(IntegratorSettings::default());
    let mut guide = MarkGuide::default();
    let mut labels = BTreeMap::new();
    for _ in 0..12 {
        let frame = scene.frame(truth, |_, _| true, |view, pixel| named(&guide, view, pixel));
        let (marks, next) = integrator.integrate(&frame, None);
        guide = next;
        labels = marks.map_or(labels, |it| identities(&it, truth).into_iter().map(|it| (it.1, it.0)).collect());
    }
    assert_eq!(labels.len(), truth.len());
    (integrator, guide, labels.into_values().collect())
}

#[test]
fn names_that_all_cameras_exchange_are_disputed_in_all_of_them() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.02 * DEGREE);
    let (mut integrator, guide, labels) = settled(&mut scene, &truth);
    let exchanged = [labels[8], labels[30]];
    let name = |view: usize, pixel: &Point2<f64>| {
        let name = named(&guide, view, pixel);
        name.map(|it| {
            if it == exchanged[0] {
                exchanged[1]
            } else if it == exchanged[1] {
                exchanged[0]
            } else {
                it
            }
        })
    };
    let frame = scene.frame(&truth, |_, _| true, name);
    let (marks, guide) = integrator.integrate(&frame, None);
    let marks = marks.unwrap();
    assert!(marks.list.len() > 60 && exchanged.iter().all(|it| marks.get(*it).is_none()), "{}", marks.list.len());
    for view in 0..4 {
        let disputed = guide.of(CameraId(view)).iter().filter(|it| it.disputed).map(|it| it.label);
        assert_eq!(disputed.collect::<BTreeSet<_>>(), exchanged.into(), "view {view}");
    }
}

#[test]
fn a_hidden_mark_that_comes_out_beside_one_that_has_its_dot_is_found() {
    let truth = marks_on_a_face();
    let mut scene = Scene::new(0.02 * DEGREE);
    let (mut integrator, mut guide, labels) = settled(&mut scene, &truth);
    let distance = |a: usize, b: usize| (truth[a] - truth[b]).norm();
    let pairs = (0..truth.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let (hidden, beside) = pairs.min_by(|a, b| distance(a.0, a.1).total_cmp(&distance(b.0, b.1))).unwrap();
    let mut moved = truth.clone();
    // It comes out 8 mm from where it was, towards its neighbour.
    moved[hidden] += (truth[beside] - truth[hidden]).normalize() * 0.008;
    let cameras = scene.cameras.clone();
    let in_view = |view: usize, place: &Point3<f64>| cameras[view].project(place).unwrap();
    let off = |view: usize| (in_view(view, &moved[hidden]) - in_view(view, &truth[beside])).norm();
    assert!((0..4).any(|view| off(view) < NEAR_KNOWN_PX), "it has to come out near its neighbour");
    for number in 0..6 {
        let name = |view: usize, pixel: &Point2<f64>| {
            let is_it = (in_view(view, &moved[hidden]) - pixel).norm() < 1.0;
            if is_it { None } else { named(&guide, view, pixel).filter(|it| *it != labels[hidden]) }
        };
        let frame = scene.frame(&moved, |_, mark| number > 2 || mark != hidden, name);
        guide = integrator.integrate(&frame, None).1;
    }
    let found = integrator.track_store.marks[&labels[hidden]].position;
    assert!((found - moved[hidden]).norm() < 2e-3, "{} m off", (found - moved[hidden]).norm());
}
