//! Features on pictures: `foxglove.ImageAnnotations`.

use foveate_messages::{Features, Time, Window};
use nalgebra::Vector2;

use super::schemas::{circle_annotation, color, image_annotations, text_annotation};
use super::wire::Writer;

/// Colour of circles and labels, which gray pictures and skin do not have [0..=1].
const OUTLINE: [f64; 4] = [0.6, 1.0, 0.0, 1.0];
/// Smallest diameter of a circle [px].
const SMALLEST: f64 = 6.0;
/// Height of the text of a label [px].
const FONT_SIZE: f64 = 12.0;

/// A `foxglove.ImageAnnotations`: a circle about each feature, as large as its area, and its label beside it. `window` is what the picture beneath shows of its camera's.
///
/// The schema counts from the outer corner of the top-left pixel, we count from its centre.
pub fn features(time: Time, features: &Features, window: &Window, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    it.time(image_annotations::timestamp, time);
    for feature in &features.list {
        let centre = window.in_image(&feature.centre) + Vector2::repeat(0.5);
        let diameter = 2.0 * (f64::from(feature.area) / std::f64::consts::PI).sqrt() / f64::from(window.shrink);
        let diameter = diameter.max(SMALLEST);
        it.message(image_annotations::circles, |it| {
            it.time(circle_annotation::timestamp, time);
            it.point2(circle_annotation::position, &centre);
            it.double(circle_annotation::diameter, diameter);
            it.double(circle_annotation::thickness, 1.0);
            it.color(circle_annotation::fill_color, &[0.0; 4]);
            it.color(circle_annotation::outline_color, &OUTLINE);
        });
        if let Some(label) = feature.label {
            it.message(image_annotations::texts, |it| {
                it.time(text_annotation::timestamp, time);
                it.point2(text_annotation::position, &(centre + Vector2::new(diameter / 2.0, 0.0)));
                it.string(text_annotation::text, &label.to_string());
                it.double(text_annotation::font_size, FONT_SIZE);
                it.color(text_annotation::text_color, &OUTLINE);
                it.color(text_annotation::background_color, &[0.0; 4]);
            });
        }
    }
}

impl Writer<'_> {
    /// A `foxglove.Color`: red, green, blue and opacity [0..=1].
    pub(super) fn color(&mut self, field: u32, value: &[f64; 4]) {
        self.message(field, |it| {
            it.double(color::r, value[0]);
            it.double(color::g, value[1]);
            it.double(color::b, value[2]);
            it.double(color::a, value[3]);
        });
    }
}

#[cfg(test)]
mod tests {
    use foveate_messages::{CameraId, Feature};
    use nalgebra::{Matrix2, Point2};

    use super::super::Kind;
    use super::super::decoded::Decoded;
    use super::*;

    #[test]
    fn a_feature_is_a_circle_where_the_picture_shows_it() {
        let feature = |area: u32, label: Option<u32>| Feature {
            centre: Point2::new(101.5, 43.5),
            covariance: Matrix2::identity(),
            area,
            peak: 0,
            label,
        };
        let list = vec![feature(1257, Some(12)), feature(0, None)];
        let found = Features { camera: CameraId(2), list };
        let mut out = Vec::new();
        features(Time(4), &found, &Window::default(), &mut out);
        let whole = Decoded::of(Kind::ImageAnnotations, &out);
        assert_eq!((whole.count("circles"), whole.count("texts")), (2, 1));
        assert_eq!((whole.number("circles[0].position.x"), whole.number("circles[0].position.y")), (102.0, 44.0));
        let diameter = whole.number("circles[0].diameter");
        assert!((diameter - 40.0).abs() < 0.01, "{diameter}: a circle of 20 px has 1257 px²");
        assert_eq!(whole.number("circles[1].diameter"), SMALLEST);
        assert_eq!((whole.text("texts[0].text"), whole.number("texts[0].timestamp.nanos")), ("12", 4.0));

        features(Time(4), &found, &Window { left: 100, top: 40, shrink: 4 }, &mut out);
        let part = Decoded::of(Kind::ImageAnnotations, &out);
        // The middle of the first column, which is 100 to 103, and the edge between the first two rows, which is after row 43.
        assert_eq!((part.number("circles[0].position.x"), part.number("circles[0].position.y")), (0.5, 1.0));
        assert!((part.number("circles[0].diameter") - 10.0).abs() < 0.01);
    }
}
