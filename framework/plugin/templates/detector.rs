//! `my_plugin.detector`: finds bright spots in gray pictures, each with a sub-pixel centre.
//!
//! A pixel above `threshold` that no neighbour outshines is the middle of a spot. The centre is Σ wᵢ xᵢ / Σ wᵢ over the 5 × 5 pixels around it, with
//! wᵢ = brightnessᵢ − threshold, 0 at least.

use foveate::prelude::*;
use nalgebra::{Matrix2, Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    IMAGE: In<Image> = each("image");
    FEATURES: Out<Features> = "features";
}

figures! {
    "my_plugin.found.*": count, neither, "Features found, over all pictures of the camera";
}

/// Settings of [`MyNode`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MyNodeSettings {
    /// Pixels above this brightness belong to a spot [gray level, 0..=255].
    pub threshold: u8,
}

impl Default for MyNodeSettings {
    fn default() -> Self {
        Self { threshold: 120 }
    }
}

/// A picture in, its spots out in scan order. Nothing seen: an empty list.
pub struct MyNode {
    threshold: u8,
    pool: Pool<Features>,
    camera: String,
    found: u64,
}

impl Node for MyNode {
    const TYPE: &'static str = "my_plugin.detector";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds bright spots in the pictures of one camera";
    type Settings = MyNodeSettings;
    const FIGURES: Figures = DECLARED_FIGURES;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: MyNodeSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let camera = setup.camera_name().unwrap_or("all").to_owned();
        Ok(Self { threshold: settings.threshold, pool: Pool::default(), camera, found: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let (columns, rows) = (image.value.width as usize, image.value.height as usize);
        if image.value.format != PixelFormat::Gray8 || image.value.pixels.len() != columns * rows {
            return Err(NodeError::input("found a picture that is not gray or not whole, expected one byte a pixel"));
        }
        let mut features = self.pool.take(Features::default);
        features.camera = image.value.camera;
        features.list.clear();
        for row in 2..rows.saturating_sub(2) {
            for column in 2..columns.saturating_sub(2) {
                features.list.extend(spot(&image.value, row, column, self.threshold));
            }
        }
        self.found += features.list.len() as u64;
        io.emit(&FEATURES, image.stamp, self.pool.share(features));
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure(format!("my_plugin.found.{}", self.camera), self.found as f64);
        Ok(())
    }
}

/// The spot whose brightest pixel this is, if it is one.
fn spot(image: &Image, row: usize, column: usize, threshold: u8) -> Option<Feature> {
    let columns = image.width as usize;
    let at = |row: usize, column: usize| image.pixels[row * columns + column];
    let peak = at(row, column);
    if peak <= threshold {
        return None;
    }
    let (mut sum, mut moment, mut area) = (0.0, Vector2::zeros(), 0);
    for r in row - 2..=row + 2 {
        for c in column - 2..=column + 2 {
            // Of equal pixels the first one counts.
            let is_before = (r, c) < (row, column);
            if at(r, c) > peak || (is_before && at(r, c) == peak) {
                return None;
            }
            let weight = f64::from(at(r, c).saturating_sub(threshold));
            sum += weight;
            moment += weight * Vector2::new(c as f64, r as f64);
            area += u32::from(weight > 0.0);
        }
    }
    let centre = image.window.in_camera(&Point2::from(moment / sum));
    Some(Feature { centre, covariance: Matrix2::identity() * 0.01, area, peak, label: None })
}

#[cfg(test)]
mod tests {
    use foveate_testkit::{check_node, render_spot};

    use super::*;

    /// The node on one picture with a spot drawn at `truth`.
    fn find(truth: [f64; 2], settings: MyNodeSettings) -> Vec<Feature> {
        let image = render_spot([64, 48], truth, 1.2, 200.0);
        let mut bench = NodeBench::<MyNode>::new(settings).unwrap();
        bench.feed(&IMAGE, Time::from_s(0.1), image).unwrap();
        bench.outputs(&FEATURES)[0].value.list.clone()
    }

    #[test]
    fn a_spot_is_found_within_a_fifth_of_a_pixel() {
        for truth in [[20.0, 30.0], [20.4, 30.3], [41.7, 12.5]] {
            let found = find(truth, MyNodeSettings::default());
            assert_eq!(found.len(), 1, "{found:?}");
            assert!((found[0].centre - Point2::from(truth)).norm() < 0.2, "{found:?}");
        }
    }

    #[test]
    fn what_is_darker_than_the_threshold_is_no_spot() {
        assert_eq!(find([20.0, 30.0], MyNodeSettings { threshold: 250 }), []);
    }

    #[test]
    fn the_node_keeps_what_every_node_promises() {
        check_node::<MyNode>("threshold = 40");
    }
}
