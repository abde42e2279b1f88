//! The distance of a target from the middle of the image over time, a row for each head: as [Davis 2002 Fig. 53].

use std::fmt::Write as _;

use foveate_messages::Time;
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

const WIDTH: f64 = 980.0;
const ROW: f64 = 170.0;
const LEFT: f64 = 60.0;
const TOP: f64 = 44.0;

/// An SVG, each row named and with its mean.
pub(crate) fn draw(tracks: &[(&str, &Track)]) -> String {
    let times = || tracks.iter().flat_map(|it| &it.1.pictures).map(|it| it.0.as_s());
    let (first, last) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
    let far = |track: &Track| track.pictures.iter().map(|it| it.1.norm()).fold(0.0, f64::max);
    let most = tracks.iter().map(|it| far(it.1)).fold(0.0, f64::max).clamp(50.0, 700.0);
    let step = if most > 300.0 { 100.0 } else { 50.0 };
    let height = TOP + ROW * tracks.len().max(1) as f64 + 44.0;
    // Writing to a String cannot fail.
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"{LEFT}\" y=\"22\" font-size=\"15\">Distance of the target from the middle of \
         the image [px]</text>\n"
    );
    if !first.is_finite() {
        let _ = writeln!(
            svg,
            "<text x=\"{LEFT}\" y=\"{:.1}\" fill=\"#555\">no picture of a camera on a head was scored</text>\n</svg>",
            TOP + 20.0
        );
        return svg;
    }
    let x = |time: f64| LEFT + (WIDTH - LEFT - 20.0) * (time - first) / (last - first).max(1e-9);
    for (row, (name, track)) in tracks.iter().enumerate() {
        let bottom = TOP + ROW * (row as f64 + 1.0) - 22.0;
        let y = |pixels: f64| bottom - (ROW - 48.0) * (pixels / most).min(1.0);
        let right = WIDTH - 20.0;
        for second in seconds_between(first, last) {
            let (at, top) = (x(second), bottom - (ROW - 48.0));
            let _ = writeln!(
                svg,
                "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{top:.1}\" y2=\"{bottom:.1}\" stroke=\"#eee\"/><line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{bottom:.1}\" y2=\"{:.1}\" \
                 stroke=\"#555\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555\">{}</text>",
                bottom + 5.0,
                bottom + 17.0,
                (second * 1e3).round() / 1e3
            );
        }
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {:.1} V{bottom:.1} H{right:.1}\" fill=\"none\" stroke=\"#555\"/>",
            bottom - (ROW - 48.0)
        );
        let mut tick = 0.0;
        while tick <= most {
            let at = y(tick);
            let _ = writeln!(
                svg,
                "<line x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"#ddd\"/><line x1=\"{:.1}\" x2=\"{LEFT}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"#555\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555\">{tick}</text>",
                WIDTH - 20.0,
                LEFT - 5.0,
                LEFT - 8.0,
                at + 4.0
            );
            tick += step;
        }
        let mean = track.pictures.iter().map(|it| it.1.norm()).sum::<f64>() / track.pictures.len().max(1) as f64;
        let seen = track.pictures.iter().filter(|it| it.2).count() as f64 / track.pictures.len().max(1) as f64;
        let _ = writeln!(
            svg,
            "<text x=\"{LEFT}\" y=\"{:.1}\" font-weight=\"bold\">{name}: mean {mean:.1} px, in view {:.1} %</text>",
            bottom - ROW + 40.0,
            100.0 * seen
        );
        let points: String =
            track.pictures.iter().map(|it| format!("{:.1},{:.1} ", x(it.0.as_s()), y(it.1.norm()))).collect();
        let _ = writeln!(svg, "<polyline points=\"{points}\" fill=\"none\" stroke=\"#1f5fa8\" stroke-width=\"1.2\"/>");
        let at = y(mean);
        let _ = writeln!(
            svg,
            "<line x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"#c0392b\" stroke-dasharray=\"6 4\"/>",
            WIDTH - 20.0
        );
        for it in track.pictures.iter().filter(|it| !it.2) {
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.6\" fill=\"#c0392b\"/>",
                x(it.0.as_s()),
                y(it.1.norm())
            );
        }
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#333\">time [s]</text>",
        0.5 * (LEFT + WIDTH - 20.0),
        height - 28.0
    );
    let _ = writeln!(
        svg,
        "<text x=\"{LEFT}\" y=\"{:.1}\" fill=\"#555\">dashed: mean; red: the target is not in the picture</text>\n</svg>",
        height - 10.0
    );
    svg
}

/// Round times between two, ten at most, one at least where they differ [s].
fn seconds_between(first: f64, last: f64) -> Vec<f64> {
    let least = ((last - first) / 10.0).max(1e-3);
    let power = 10_f64.powf(least.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|it| it * power).into_iter().find(|it| *it >= least * (1.0 - 1e-9));
    let step = step.unwrap_or(10.0 * power);
    let (from, to) = ((first / step - 1e-6).ceil() as i64, (last / step + 1e-6).floor() as i64);
    (from..=to).map(|it| it as f64 * step).collect()
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
    fn every_row_has_ticks_on_both_axes_however_short_or_long_the_run() {
        for (first, last) in [(0.5, 0.9), (3.1, 7.9), (5.0, 60.0), (0.0, 7200.0), (2.0, 2.0)] {
            let times = seconds_between(first, last);
            assert!((1..=11).contains(&times.len()), "{first} to {last}: {times:?}");
            assert!(times.iter().all(|it| (first - 1e-3..=last + 1e-3).contains(it)), "{first} to {last}: {times:?}");
            let svg = picture_of(first, last);
            let marks = svg.matches("text-anchor=\"middle\"").count();
            assert_eq!(marks, 2 * times.len() + 1, "a number at each tick of both rows, and the name of the axis");
            assert!(svg.contains(">50</text>") && svg.ends_with("</svg>\n"));
        }
        assert!(draw(&[]).contains("no picture of a camera on a head was scored"));
    }
}
