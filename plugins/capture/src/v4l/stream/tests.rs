//! The stream over a camera that fails on command.

use super::*;
use crate::v4l::device::FourCc;
use crate::v4l::fake::{Act, Fake, PERIOD};

/// What `n_steps` steps over a camera with this script come to, in words, and the stream's counts.
#[track_caller]
fn play(fourcc: &FourCc, script: &[Act], n_steps: usize) -> (Vec<String>, Counts, Vec<&'static str>) {
    let mut fake = Fake::new(fourcc, script);
    let layout = fake.open().unwrap();
    let log = Arc::clone(&fake.log);
    log.lock().unwrap().clear();
    let timeout = Duration::from_millis(200);
    let mut stream = Stream::new(Box::new(fake), layout, CameraId(3), Format::Gray, timeout);
    let mut words = Vec::new();
    for _ in 0..n_steps {
        match stream.step() {
            Step::Turn(turn) => {
                words.extend(turn.lost.iter().map(|it| format!("lost {}: {}", it.count, it.reason)));
                words.push(match turn.what {
                    What::Picture(image) => {
                        assert_eq!((image.camera, image.width, image.height), (CameraId(3), 2, 2));
                        format!("{:?}", image.pixels)
                    }
                    What::Gap(reason) => format!("gap: {reason}"),
                });
            }
            Step::Nothing => {}
            Step::Pause(length) => words.push(format!("pause {}", length.as_millis())),
        }
    }
    let counts = stream.counts;
    let log = log.lock().unwrap().clone();
    (words, counts, log)
}

#[test]
fn pictures_come_out_as_they_came() {
    let (words, counts, log) = play(b"GREY", &[Act::Frame, Act::Frame], 3);
    assert_eq!(words, ["[0, 0, 0, 0]", "[1, 1, 1, 1]"]);
    assert_eq!(counts, Counts { at_start: true, ..Counts::default() });
    assert_eq!(log, ["start"]);
}

#[test]
fn jump_of_the_drivers_number_is_a_gap_for_each_frame() {
    let (words, counts, _) = play(b"GREY", &[Act::Lose(2), Act::Frame, Act::Lose(3), Act::Frame], 6);
    assert_eq!(words, ["[2, 2, 2, 2]", "lost 3: the driver lost this frame", "[6, 6, 6, 6]"]);
    assert_eq!(counts.lost_by_driver, 3, "what was lost before the first picture is before the stream");
}

#[test]
fn number_that_wraps_around_or_stands_still_loses_nothing() {
    let script = [Act::Number(u32::MAX), Act::Frame, Act::Frame, Act::Number(0), Act::Frame];
    let (words, counts, _) = play(b"GREY", &script, 6);
    assert_eq!(words, ["[255, 255, 255, 255]", "[0, 0, 0, 0]", "[0, 0, 0, 0]"]);
    assert_eq!(counts.lost_by_driver, 0);
}

#[test]
fn damaged_short_and_undecodable_pictures_are_gaps_and_the_stream_goes_on() {
    let script = [Act::Frame, Act::Damaged, Act::Bytes(vec![1, 2, 3]), Act::Frame];
    let (words, counts, log) = play(b"GREY", &script, 5);
    let expected = [
        "[0, 0, 0, 0]",
        "gap: a picture is marked as damaged by the driver",
        "gap: a picture has 3 bytes, expected 4",
        "[3, 3, 3, 3]",
    ];
    assert_eq!(words, expected);
    assert_eq!((counts.unusable, counts.restarts), (2, 0));
    assert_eq!(log, ["start"]);
    let (words, ..) = play(b"MJPG", &[Act::Bytes(vec![0xff, 0xd8, 0xff, 0xe0, 0, 4])], 2);
    assert_eq!(words, ["gap: a picture is a truncated JPEG: 6 bytes, and no end marker"]);
}

#[test]
fn time_out_starts_the_stream_again_and_counts_what_the_time_would_have_held() {
    let script = [Act::Frame, Act::Frame, Act::Nothing(10), Act::Nothing(1), Act::Frame, Act::Frame];
    let (words, counts, log) = play(b"GREY", &script, 8);
    // Frames stamped at 0 and 12 periods: eleven are missing, one of which was told of at once.
    let expected = [
        "[0, 0, 0, 0]",
        "[1, 1, 1, 1]",
        "gap: no picture for 200 ms",
        "lost 10: no picture for 200 ms",
        "[0, 0, 0, 0]",
        "[1, 1, 1, 1]",
    ];
    assert_eq!(words, expected);
    assert_eq!((counts.restarts, counts.reopenings), (1, 0));
    assert_eq!(log, ["start", "start"]);
}

#[test]
fn error_of_the_driver_starts_the_stream_again() {
    let (words, counts, _) = play(b"GREY", &[Act::Frame, Act::Error, Act::Frame], 5);
    assert_eq!(words, ["[0, 0, 0, 0]", "gap: the driver reports: EIO", "[0, 0, 0, 0]"]);
    assert_eq!((counts.restarts, counts.lost_by_driver), (1, 0), "the number begins anew without a loss");
}

#[test]
fn stream_that_does_not_start_is_opened_anew() {
    let (words, counts, log) = play(b"GREY", &[Act::Frame, Act::NoStart(3), Act::Frame], 9);
    let expected = [
        "[0, 0, 0, 0]",
        "gap: the driver reports: EIO",
        "pause 50",
        "pause 100",
        "pause 200",
        "lost 1: the driver reports: EIO",
    ];
    assert_eq!(words[..5], expected[..5]);
    assert_eq!(words.last().unwrap(), "[0, 0, 0, 0]");
    assert_eq!((counts.restarts, counts.reopenings), (4, 1));
    assert_eq!(log, ["start", "start", "start", "start", "close", "open", "start"]);
}

#[test]
fn camera_that_disappears_is_looked_for_ever_more_slowly_until_it_is_there() {
    let (words, counts, log) = play(b"GREY", &[Act::Frame, Act::Unplug(8), Act::Frame], 14);
    let expected = [
        "[0, 0, 0, 0]",
        "gap: the camera is gone: ENODEV",
        "pause 50",
        "pause 100",
        "pause 200",
        "pause 400",
        "pause 800",
        "pause 1600",
        "pause 2000",
        "pause 2000",
        // Nine attempts to open took a period each.
        "lost 8: the camera is gone: ENODEV",
        "[0, 0, 0, 0]",
    ];
    assert_eq!(words, expected);
    assert_eq!((counts.reopenings, counts.restarts), (1, 1));
    assert_eq!(log.iter().filter(|it| **it == "open").count(), 9);
    assert_eq!(log.iter().filter(|it| **it == "start").count(), 2);
}

#[test]
fn picture_without_a_stamp_of_this_clock_has_the_time_of_its_arrival() {
    let mut fake = Fake::new(b"GREY", &[Act::Unstamped]);
    let layout = fake.open().unwrap();
    let clock = fake.clock();
    let mut stream = Stream::new(Box::new(fake), layout, CameraId(0), Format::Gray, Duration::from_secs(1));
    assert!(matches!(stream.step(), Step::Nothing));
    let Step::Turn(turn) = stream.step() else { panic!("a picture") };
    assert_eq!((turn.stamp, turn.arrival), (clock(), clock()));
    assert_eq!(stream.counts.unstamped, 1);
}

#[test]
fn long_absence_counts_as_a_thousand_frames() {
    assert_eq!(missed(Some(0), 3 * PERIOD, Some(PERIOD)), 2);
    assert_eq!(missed(Some(0), PERIOD + PERIOD / 3, Some(PERIOD)), 0);
    assert_eq!(missed(Some(0), i64::MAX, Some(1)), GAPS_AT_ONCE);
    assert_eq!(missed(None, PERIOD, Some(PERIOD)), 0);
    assert_eq!(missed(Some(0), PERIOD, None), 0);
}
