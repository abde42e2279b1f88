//! Diagnosis of a wall's cameras and settings from their frames and spots, reported at the end of a run.

use foveate::prelude::Time;

use super::settings::TrackerSettings;

/// A camera with a larger share of frames that come late has another clock or delay than the others [–].
const LATE_SHARE: f64 = 0.02;
/// Fewest frames or spots for a remark.
const LEAST_COUNT: u64 = 20;
/// `lost_ms` should bridge a picture in which a pointer is missed: this many periods of the camera.
const BRIDGED_PERIODS: f64 = 2.0;
/// Kept intervals of each camera: their median is its period.
const MOST_INTERVALS: usize = 512;

/// Frames and spots of one camera.
#[derive(Debug, Clone, Default)]
pub(super) struct Camera {
    last: Option<Time>,
    /// Intervals between frames that came in order [s].
    intervals: Vec<f64>,
    frames: u64,
    late: u64,
    /// Largest delay of a frame behind the newest frame [s].
    most_late_s: f64,
    /// Spots that were bright enough.
    pub bright: u64,
    /// Spots outside of the wall.
    pub beside: u64,
    /// Spots that are too large.
    pub large: u64,
    /// Spots with a label.
    pub labelled: u64,
}

impl Camera {
    /// A frame at `time`; `latest` is that of the latest frame of any camera.
    pub fn frame(&mut self, time: Time, latest: Option<Time>) {
        self.frames += 1;
        if let Some(latest) = latest.filter(|it| time < *it) {
            self.late += 1;
            self.most_late_s = self.most_late_s.max((latest - time).as_s());
        }
        if let Some(last) = self.last.filter(|it| *it < time)
            && self.intervals.len() < MOST_INTERVALS
        {
            self.intervals.push((time - last).as_s());
        }
        self.last = Some(time);
    }

    /// Median time between two frames [s].
    fn period_s(&self) -> Option<f64> {
        foveate::estimation::statistics::percentile(&self.intervals, 50.0)
    }
}

/// The remarks. `begun` pointers began; `decided` of them were assigned to a user, where users are distinguished.
pub(super) fn remarks(
    cameras: &[Camera],
    names: &[String],
    settings: &TrackerSettings,
    begun: u64,
    decided: Option<u64>,
) -> Vec<String> {
    let mut said = Vec::new();
    for (camera, name) in cameras.iter().zip(names) {
        let Camera { frames, late, most_late_s, bright, beside, .. } = camera;
        if *late >= LEAST_COUNT && *late as f64 > LATE_SHARE * *frames as f64 {
            said.push(format!(
                "{late} of {frames} frames of camera `{name}` came after later ones of other cameras, by up to {:.0} ms, and were left out: their clocks or delays differ, expected stamps of one clock",
                most_late_s * 1e3
            ));
        }
        if *bright >= LEAST_COUNT && 2 * beside > *bright {
            said.push(format!(
                "{beside} of {bright} bright spots of camera `{name}` lie outside of the wall: its map may be of another place or camera"
            ));
        }
    }
    let slowest = cameras.iter().zip(names).filter_map(|(it, name)| Some((it.period_s()? * 1e3, name)));
    let slowest = slowest.max_by(|a, b| a.0.total_cmp(&b.0));
    let dark_ms = if settings.users.iter().any(|it| it.period_ms.is_some()) { settings.dark_ms } else { 0.0 };
    if let Some((period_ms, name)) = slowest.filter(|it| settings.lost_ms < dark_ms + BRIDGED_PERIODS * it.0) {
        said.push(format!(
            "camera `{name}` delivers a picture every {period_ms:.0} ms and pointers end after `lost_ms` = {} ms: strokes break, and short presses are missed; expected {:.0} ms or more",
            settings.lost_ms,
            dark_ms + BRIDGED_PERIODS * period_ms
        ));
    }
    let sum = |of: fn(&Camera) -> u64| cameras.iter().map(of).sum::<u64>();
    let [bright, large, beside, labelled] =
        [sum(|it| it.bright), sum(|it| it.large), sum(|it| it.beside), sum(|it| it.labelled)];
    if bright >= LEAST_COUNT && 2 * large > bright {
        said.push(format!(
            "{large} of {bright} bright spots are larger than `largest_mm` = {} mm: expected pointers to be smaller",
            settings.largest_mm
        ));
    }
    let has_colours = settings.users.iter().any(|it| it.colour.is_some());
    if has_colours && labelled == 0 && bright >= LEAST_COUNT {
        said.push(format!(
            "`users` have colours, but none of {bright} bright spots has one of their labels: does `led.detector` have `colours`, and are its pictures in colour?"
        ));
    } else if decided == Some(0) && begun >= 3 {
        said.push(format!(
            "none of {begun} pointers was assigned to a user: do the colours and periods of `users` match the pointers?"
        ));
    }
    if begun == 0 && sum(|it| it.frames) >= LEAST_COUNT {
        said.push(if bright == 0 {
            "no pointer began: no spot was bright enough; is one on, and are `min_threshold` and `min_peak` of `led.detector` and `brighter` below its peak?".to_owned()
        } else {
            format!("no pointer began: of {bright} bright spots {large} were too large, {beside} outside of the wall, and the others did not stay, or no second camera saw them")
        });
    }
    said
}

#[cfg(test)]
mod tests {
    use super::super::settings::UserCode;
    use super::*;

    fn camera(period_ms: f64, off_ms: f64) -> Camera {
        let mut camera = Camera { bright: 100, labelled: 50, ..Camera::default() };
        for frame in 0..100 {
            let time_s = period_ms * 1e-3 * f64::from(frame);
            camera.frame(Time::from_s(time_s - off_ms * 1e-3), Some(Time::from_s(time_s)));
        }
        camera
    }

    fn said(camera: Camera, change: impl Fn(&mut TrackerSettings), begun: u64, decided: Option<u64>) -> Vec<String> {
        let mut settings = TrackerSettings::default();
        change(&mut settings);
        remarks(&[camera], &["wall-1".to_owned()], &settings, begun, decided)
    }

    #[track_caller]
    fn says(said: &[String], words: &[&str]) {
        assert_eq!(said.len(), words.len(), "{said:?}");
        for (said, words) in said.iter().zip(words) {
            assert!(said.contains(words), "{said}");
        }
    }

    #[test]
    fn a_run_in_which_all_is_well_says_nothing() {
        says(&said(camera(16.7, 0.0), |_| (), 10, None), &[]);
        says(&said(camera(16.7, -1.0), |_| (), 10, Some(4)), &[]);
    }

    #[test]
    fn clocks_rates_maps_and_settings_that_do_not_fit_are_named() {
        says(&said(camera(16.7, 110.0), |_| (), 10, None), &["100 of 100 frames of camera `wall-1`"]);
        says(&said(camera(66.7, 0.0), |_| (), 10, None), &["every 67 ms and pointers end after `lost_ms` = 50 ms"]);
        let blink = |it: &mut TrackerSettings| {
            it.users = vec![UserCode { user: 1, period_ms: Some(60.0), colour: None }];
        };
        says(&said(camera(16.7, 0.0), blink, 10, Some(3)), &["expected 53 ms or more"]);
        let colour = |it: &mut TrackerSettings| {
            it.users = vec![UserCode { user: 1, period_ms: None, colour: Some(1) }];
        };
        says(&said(Camera { labelled: 0, ..camera(16.7, 0.0) }, colour, 10, Some(0)), &["does `led.detector` have"]);
        says(&said(camera(16.7, 0.0), colour, 10, Some(0)), &["none of 10 pointers was assigned"]);
        says(
            &said(Camera { beside: 80, ..camera(16.7, 0.0) }, |_| (), 10, None),
            &["80 of 100 bright spots of camera"],
        );
        says(&said(Camera { large: 80, ..camera(16.7, 0.0) }, |_| (), 10, None), &["larger than `largest_mm` = 40 mm"]);
        says(&said(Camera { bright: 0, ..camera(16.7, 0.0) }, |_| (), 0, None), &["no spot was bright enough"]);
        says(&said(camera(16.7, 0.0), |_| (), 0, None), &["no pointer began: of 100 bright spots 0 were too large"]);
    }
}
