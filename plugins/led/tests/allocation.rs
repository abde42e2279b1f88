//! The steady state of the tracker and of the detector allocates nothing.

use foveate::messages::{Features, Image, PixelFormat, Targets};
use foveate::node::detector::Outcome;
use foveate_led::detector::DetectorSettings;
use foveate_led::led_detector::LedDetector;
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_testkit::allocation::{self, Counting};
use foveate_testkit::lab::{Lab, person};
use nalgebra::Point2;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count(work: impl FnOnce()) -> u64 {
    let before = allocation::count();
    work();
    allocation::count() - before
}

/// One test, so that no other thread of it allocates meanwhile.
#[test]
fn steady_state_allocates_nothing() {
    let lab = Lab { clutter: 1.0, hidden: 0.2, ..Lab::new(18) };
    let frames = lab.frames(10.0, &person);
    let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), None);
    let mut targets = Targets::default();
    let mut run = |part: &[(foveate::messages::Time, Features)]| {
        for (time, features) in part {
            tracker.observe(*time, features);
            tracker.write(&mut targets);
        }
    };
    let (warm_up, steady) = frames.split_at(frames.len() / 2);
    run(warm_up);
    assert_eq!(count(|| run(steady)), 0, "allocations of the tracker in {} frames", steady.len());

    let mut led_detector =
        LedDetector::new(DetectorSettings { learn_frames: 5, ..DetectorSettings::default() }, None, 7).unwrap();
    let mut image =
        Image { width: 640, height: 240, format: PixelFormat::Gray8, pixels: vec![5; 640 * 240], ..Image::default() };
    let mut features = Features::default();
    let mut find = |at: usize| {
        image.pixels.fill(5);
        for k in 0..8 {
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (1, 2)] {
                image.pixels[(20 + 25 * k + dy) * 640 + 30 * k + at % 300 + dx] = 200;
            }
        }
        let predicted = (0..8).map(|k| Point2::new((30 * k + at % 300) as f64, (20 + 25 * k) as f64));
        led_detector.find(&image, predicted, &mut features).unwrap()
    };
    (0..5).for_each(|_| assert_eq!(find(400), Outcome::Learning));
    (0..100).for_each(|at| assert_eq!(find(at), Outcome::Searched));
    assert_eq!(
        count(|| (100..250).for_each(|at| assert_eq!(find(at), Outcome::Searched))),
        0,
        "allocations of the detector"
    );
    assert_eq!(features.list.len(), 8);
}
