//! The steady state of the blob detector allocates nothing.

use foveate::messages::{Features, Image, PixelFormat};
use foveate::node::detector::Outcome;
use foveate_blob::blob_detector::BlobDetector;
use foveate_blob::{BlobSettings, ReportedPoint};
use foveate_testkit::allocation::{self, Counting};
use nalgebra::{Point2, Vector2};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test, so that no other thread of it allocates meanwhile.
#[test]
fn steady_state_allocates_nothing() {
    let settings = BlobSettings { learn_frames: 5, shrink: 2, point: ReportedPoint::Top, ..BlobSettings::default() };
    let mut blob_detector = BlobDetector::new(settings, None, None).unwrap();
    let n = 320 * 240;
    let mut image =
        Image { width: 320, height: 240, format: PixelFormat::Rgb8, pixels: vec![90; 3 * n], ..Image::default() };
    let mut features = Features::default();
    let mut find = |at: Option<usize>| {
        image.pixels.fill(90);
        for i in
            (0..n).filter(|i| at.is_some_and(|at| (at..at + 40).contains(&(i % 320)) && (60..180).contains(&(i / 320))))
        {
            image.pixels[3 * i..3 * i + 3].fill(200);
        }
        let predicted = at.map(|at| Point2::new(at as f64, 120.0));
        let up = |_: &Point2<f64>| Vector2::new(0.0, -1.0);
        let outcome = blob_detector.find(&image, predicted.into_iter(), up, &mut features).unwrap();
        (outcome, features.list.len())
    };
    (0..5).for_each(|_| assert_eq!(find(None), (Outcome::Learning, 0)));
    (0..50).for_each(|at| assert_eq!(find(Some(at)), (Outcome::Searched, 1)));
    let before = allocation::count();
    (50..200).for_each(|at| assert_eq!(find(Some(at)), (Outcome::Searched, 1)));
    assert_eq!(allocation::count() - before, 0, "allocations of the detector");
}
