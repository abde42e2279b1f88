//! Golden table: how far spot centres are from the truth, by size, brightness and noise, and whether they know it.

use std::fmt::Write as _;

use foveate_estimation::random::Random;
use foveate_imaging::{Centroid, ImageView, Measure, SpotFinder, SpotLimits, ThresholdMap};
use nalgebra::Point2;

use crate::scene::{Look, places};

const N_SPOTS: usize = 1000;
const OFFSET: u8 = 25;

/// One line of the table.
struct Line {
    /// Part of the spots that were found, within 3 px.
    found: f64,
    /// Mean and 95th percentile of the distance to the truth [px].
    mean: f64,
    p95: f64,
    /// Mean squared error in units of the covariance; 2 when the covariance is right.
    nees: f64,
}

fn measure(look: Look, centroid: Centroid) -> Line {
    let name = format!("{} {} {}", look.sigma_px, look.amplitude, look.noise);
    let mut random = Random::new(1).fork(&name);
    let how = Measure { centroid, foot: OFFSET, pixel_sigma: look.noise, ..Default::default() };
    let (mut finder, mut spots) = (SpotFinder::new(how).unwrap(), Vec::new());
    let limits = SpotLimits { min_area: 1, ..Default::default() };
    let (width, height, n_in_picture) = (320, 240, 20);
    // The background as the maximum over many frames would give it: four times the noise above the mean.
    let level = (look.background + 4.0 * look.noise) as u8;
    let thresholds = ThresholdMap::uniform(level + OFFSET, width, height);
    let (mut errors, mut nees) = (Vec::new(), 0.0);
    for _ in 0..N_SPOTS / n_in_picture {
        let centres = places(n_in_picture, width, height, &mut random);
        let pixels = look.render(width, height, &centres, &mut random);
        let view = ImageView::new(&pixels, width, height).unwrap();
        finder.find_full(&view, &thresholds, &limits, &mut spots).unwrap();
        for centre in &centres {
            let distance = |it: &Point2<f64>| (it - centre).norm();
            let Some(spot) = spots.iter().min_by(|a, b| distance(&a.centre).total_cmp(&distance(&b.centre))) else {
                continue;
            };
            let error = spot.centre - centre;
            if error.norm() < 3.0 {
                errors.push(error.norm());
                nees += (error.transpose() * spot.covariance.try_inverse().unwrap() * error).x;
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    let n = errors.len() as f64;
    Line {
        found: n / N_SPOTS as f64,
        mean: errors.iter().sum::<f64>() / n,
        p95: errors[errors.len() * 95 / 100],
        nees: nees / n,
    }
}

#[test]
fn errors_by_size_brightness_and_noise() {
    let mut table = String::from(
        "# Gaussian spots over a background of 20, threshold 4 noise + 25 above it; 1000 spots a line; errors in px.\n\
         # nees: mean squared error in units of the reported covariance, 2 when that is right, less when it is careful.\n\
         # sigma_px amplitude noise |  found  mean    p95     nees   | integer: mean  p95    nees\n",
    );
    for sigma_px in [0.7, 1.0, 1.6, 3.0] {
        for amplitude in [80.0, 200.0, 600.0] {
            for noise in [1.0, 3.0, 6.0] {
                let look = Look { amplitude, sigma_px, noise, ..Look::LED };
                let (weighted, integer) = (measure(look, Centroid::Weighted), measure(look, Centroid::Integer));
                writeln!(
                    table,
                    "  {sigma_px:<8} {amplitude:<9} {noise:<5} |  {:.3}  {:.4}  {:.4}  {:<6.2} |          {:.3}  {:.3}  {:.2}",
                    weighted.found, weighted.mean, weighted.p95, weighted.nees, integer.mean, integer.p95, integer.nees
                )
                .unwrap();
            }
        }
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/spot_error.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(path, &table).unwrap();
    }
    let golden = std::fs::read_to_string(path).unwrap_or_default();
    assert!(golden == table, "the table has changed; UPDATE_GOLDEN=1 rewrites it:\n{table}");
}
