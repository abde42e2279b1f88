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
    let height = TOP + ROW * tracks.len().max(1) as f64 + 30.0;
    // Writing to a String cannot fail.
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"{LEFT}\" y=\"22\" font-size=\"15\">Distance of the target from the middle of \
         the image [px]</text>\n"
    );
    let x = |time: f64| LEFT + (WIDTH - LEFT - 20.0) * (time - first) / (last - first).max(1e-9);
    for (row, (name, track)) in tracks.iter().enumerate() {
        let bottom = TOP + ROW * (row as f64 + 1.0) - 22.0;
        let y = |pixels: f64| bottom - (ROW - 48.0) * (pixels / most).min(1.0);
        let mut tick = 0.0;
        while tick <= most {
            let at = y(tick);
            let _ = writeln!(
                svg,
                "<line x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555\">{tick}</text>",
                WIDTH - 20.0,
                LEFT - 6.0,
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
    let seconds = if first.is_finite() { (first.ceil() as i64)..=(last.floor() as i64) } else { 0..=0 };
    for second in seconds.filter(|it| it % 5 == 0) {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555\">{second} s</text>",
            x(second as f64),
            height - 30.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{LEFT}\" y=\"{:.1}\" fill=\"#555\">dashed: mean; red: the target is not in the picture</text>\n</svg>",
        height - 10.0
    );
    svg
}
