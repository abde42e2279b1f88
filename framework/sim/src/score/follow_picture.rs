//! The distance of a target from the middle of the image over time, a row for each head: as [Davis 2002 Fig. 53].

use foveate_messages::Time;
use foveate_plot::axes::Range;
use foveate_plot::{Axis, COLOURS, Chart, Figure, Series, nothing};
use nalgebra::Vector2;

/// By how much a pose stated for a picture is off.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoseError {
    pub time: Time,
    /// Of the target in the picture, where that has it [px].
    pub pixels: Option<f64>,
    /// Of the line of sight [rad].
    pub angle: f64,
    /// Of pan and tilt, in stated standard deviations.
    pub sigmas: f64,
}

/// One head's pictures.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track {
    /// When, where the target is from the middle [px], and whether it is in the picture.
    pub pictures: Vec<(Time, Vector2<f64>, bool)>,
    pub poses: Vec<PoseError>,
}

/// An SVG, each row named and with its mean.
pub(crate) fn draw(tracks: &[(&str, &Track)]) -> String {
    let title = "Distance of the target from the middle of the image";
    let times = || tracks.iter().flat_map(|it| &it.1.pictures).map(|it| it.0.as_s());
    let Some(span) = Range::of(times()).map(|it| it.widened(0.01)) else {
        return nothing(title, "no picture of a camera on a head was scored");
    };
    let far = |track: &Track| track.pictures.iter().map(|it| it.1.norm()).fold(0.0, f64::max);
    let most = tracks.iter().map(|it| far(it.1)).fold(0.0, f64::max).clamp(50.0, 700.0);
    // Below it stands the axis of time of all.
    let last = tracks.iter().rposition(|it| !it.1.pictures.is_empty()).unwrap_or(0);
    let row = |(row, (name, track)): (usize, &(&str, &Track))| {
        let n = track.pictures.len().max(1) as f64;
        let mean = track.pictures.iter().map(|it| it.1.norm()).sum::<f64>() / n;
        let seen = track.pictures.iter().filter(|it| it.2).count() as f64 / n;
        let x = Axis::new("time [s]").over(span.min, span.max);
        let x = if row == last { x } else { x.hidden() };
        let y = Axis::new("distance [px]").over(0.0, 1.04 * most);
        let title = match track.pictures.is_empty() {
            true => (*name).to_owned(),
            false if far(track) > 1.04 * most => {
                format!("{name}: mean {mean:.1} px, in view {:.1} %, farthest {:.0} px", 100.0 * seen, far(track))
            }
            false => format!("{name}: mean {mean:.1} px, in view {:.1} %", 100.0 * seen),
        };
        // What lies beyond the axis is drawn at its end.
        let place = |it: &(Time, Vector2<f64>, bool)| [it.0.as_s(), it.1.norm().min(1.04 * most)];
        let lost = track.pictures.iter().filter(|it| !it.2).map(place).collect();
        let chart = Chart::new(title, [700.0, 110.0], x, y).if_empty("no picture was scored");
        if track.pictures.is_empty() {
            return chart;
        }
        chart
            .with(Series::line("distance", COLOURS[0], track.pictures.iter().map(place).collect()))
            .with(Series::line("its mean", COLOURS[1], vec![[span.min, mean], [span.max, mean]]).dashed())
            .with(Series::dots("not in the picture", COLOURS[1], lost))
    };
    Figure { title: title.to_owned(), n_columns: 1, charts: tracks.iter().enumerate().map(row).collect() }.svg()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture_of(first_s: f64, last_s: f64) -> String {
        let at = |share: f64| Time::from_s(first_s + (last_s - first_s) * share);
        let pictures = (0..=20).map(|it| (at(f64::from(it) / 20.0), Vector2::new(40.0, 3.0), true)).collect();
        draw(&[("ptz-1", &Track { pictures, poses: Vec::new() }), ("ptz-2", &Track::default())])
    }

    #[test]
    fn every_row_has_its_line_and_one_axis_of_time_however_short_or_long_the_run() {
        for (first, last) in [(0.5, 0.9), (3.1, 7.9), (5.0, 60.0), (0.0, 7200.0), (2.0, 2.0)] {
            let svg = picture_of(first, last);
            let of = |text: &str| svg.matches(text).count();
            assert_eq!(
                [of("time [s]"), of("distance [px]"), of("no picture was scored")],
                [1, 2, 1],
                "{first} {last}: {svg}"
            );
            assert!(of("text-anchor=\"middle\"") >= 4, "numbers at the axis of time");
            assert!(svg.contains(">40</text>") && svg.contains("ptz-1: mean 40.1 px, in view 100.0 %"), "{svg}");
            assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"));
        }
        assert!(draw(&[]).contains("no picture of a camera on a head was scored"));
    }
}
