//! Maps of all cameras from a pointer that was held at places of the wall and waved over it.
//!
//! Cameras run freely: where each saw the pointer at common moments is interpolated along its path, as in the calibration of rooms from a waved light
//! ([`foveate_calibration::clocks::frames`]); observations off a smooth path, such as reflections, are left out there.

use foveate::geometry::PlaneMap;
use foveate::geometry::plane_map::network::{KnownPlace, MomentObservation, PlaneNetwork, fit_network};
use foveate_calibration::clocks::{FrameOptions, frames};
use foveate_calibration::recording::Recording;
use foveate_calibration::solved::ClockFit;
use nalgebra::{Matrix2, Point2, Vector2};

use super::rests::rests;
use super::touched::{Touched, touched};

/// One of this many moments is held out.
const HELD_OUT: usize = 4;
/// Most moments; more are thinned evenly: an adjustment of this size takes a second.
const MOST_MOMENTS: usize = 2500;
/// The path is unknown between pictures farther apart [s].
const MAX_GAP_S: f64 = 0.04;
/// A held-out point whose places by the cameras are farther apart is an outlier: left out of the error, and counted [m].
const WILD_M: f64 = 0.05;

/// Touched places of the wall.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Touches {
    /// Where the pointer was held, in this order [m].
    pub(super) places: Vec<Point2<f64>>,
    /// Standard deviation along each axis [m].
    pub(super) sigma: f64,
    /// How long it was held at each, at least [s].
    pub(super) hold_s: f64,
}

/// Results of a calibration from a waved pointer.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Waved {
    pub(super) network: PlaneNetwork,
    /// By camera: the distance of its place of a held-out moment from the others', as the error of one camera, root mean square [m]; `None` where no moment was shared.
    pub(super) held_out_m: Vec<Option<f64>>,
    /// By touched place, its distance from maps of the others; empty with too few to leave one out.
    pub(super) touched: Vec<Touched>,
    /// Moments that two cameras with maps saw.
    pub(super) n_shared: usize,
    /// By camera, the part of its picture's width and height over which it shares moments with others [–].
    pub(super) shared_part: Vec<[f64; 2]>,
    /// Held-out moments with outliers.
    pub(super) n_wild: usize,
}

/// Maps all cameras of a recording.
///
/// # Errors
/// What is wrong, in words.
pub(super) fn solve(recording: &Recording, touches: &Touches) -> Result<Waved, String> {
    let n = recording.cameras.len();
    let sizes: Vec<[u32; 2]> = recording.cameras.iter().map(|it| it.camera.image_size).collect();
    let rests = rests(n, &recording.camera_frames, touches.hold_s);
    if rests.len() != touches.places.len() {
        let times: Vec<String> =
            rests.iter().map(|it| format!("{:.1} s to {:.1} s", it.span_s[0], it.span_s[1])).collect();
        return Err(format!(
            "the pointer was held still {} times ({}), expected {}, one for each of `touch_m`: hold it against the wall at each place for `hold_s`, and keep it moving afterwards",
            rests.len(),
            if times.is_empty() { "never".into() } else { times.join(", ") },
            touches.places.len()
        ));
    }
    let places: Vec<KnownPlace> = rests
        .iter()
        .zip(&touches.places)
        .map(|(rest, point)| KnownPlace { point: *point, sigma: touches.sigma, seen: rest.seen.clone() })
        .collect();
    let same = ClockFit { offset_s: 0.0, drift: 0.0, sigma_s: 0.0, pairs: 0 };
    let options = FrameOptions { max_gap_s: MAX_GAP_S, max_frames: MOST_MOMENTS, ..FrameOptions::default() };
    let frames = frames(recording, &vec![Some(same); n], &options);
    let is_resting = |time_s: f64| rests.iter().any(|it| (it.span_s[0]..=it.span_s[1]).contains(&time_s));
    let observations: Vec<MomentObservation> = frames
        .observations
        .iter()
        .zip(&frames.sigmas_px)
        .filter(|(it, _)| !is_resting(frames.times_s[it.frame]))
        .map(|(it, sigma)| MomentObservation { moment: it.frame, camera: it.camera, pixel: it.pixel, sigma: *sigma })
        .collect();
    let network = fit_network(&sizes, &observations, &places).map_err(|error| error.to_string())?;
    let kept: Vec<MomentObservation> = observations.iter().filter(|it| it.moment % HELD_OUT != 1).copied().collect();
    let partly =
        fit_network(&sizes, &kept, &places).map_err(|error| format!("without the held-out moments: {error}"))?;
    let (held_out_m, n_wild) = held_out(&partly, &observations);
    let (n_shared, shared_part) = shared(&sizes, &network, &observations);
    Ok(Waved { touched: touched(&sizes, &observations, &places), network, held_out_m, n_shared, shared_part, n_wild })
}

/// The moments in order, each with the observations of cameras with maps.
fn by_moment<'a>(
    network: &'a PlaneNetwork,
    observations: &'a [MomentObservation],
) -> impl Iterator<Item = Vec<(&'a MomentObservation, &'a PlaneMap)>> {
    observations
        .chunk_by(|a, b| a.moment == b.moment)
        .map(|own| own.iter().filter_map(|it| Some((it, network.maps[it.camera].as_ref().ok()?))).collect())
}

fn held_out(network: &PlaneNetwork, observations: &[MomentObservation]) -> (Vec<Option<f64>>, usize) {
    let mut sums = vec![(0.0, 0.0); network.maps.len()];
    let mut n_wild = 0;
    for seen in by_moment(network, observations) {
        if seen.len() < 2 || seen[0].0.moment % HELD_OUT != 1 {
            continue;
        }
        let places: Vec<(usize, Vector2<f64>)> =
            seen.iter().filter_map(|(it, map)| Some((it.camera, map.point(&it.pixel)?.coords))).collect();
        let n = places.len() as f64;
        let mean = places.iter().map(|it| it.1).sum::<Vector2<f64>>() / n;
        if places.len() < 2 || places.iter().any(|it| (it.1 - mean).norm() > WILD_M) {
            n_wild += 1;
            continue;
        }
        for (camera, place) in places {
            // The mean has a part of each camera's own error.
            sums[camera].0 += (place - mean).norm_squared() * n / (n - 1.0);
            sums[camera].1 += 1.0;
        }
    }
    (sums.into_iter().map(|(sum, n)| (n > 0.0).then(|| (sum / n).sqrt())).collect(), n_wild)
}

fn shared(sizes: &[[u32; 2]], network: &PlaneNetwork, observations: &[MomentObservation]) -> (usize, Vec<[f64; 2]>) {
    let mut bounds = vec![[[f64::MAX, f64::MIN]; 2]; sizes.len()];
    let mut n_shared = 0;
    for seen in by_moment(network, observations).filter(|it| it.len() > 1) {
        n_shared += 1;
        for (it, _) in seen {
            for ([least, most], at) in bounds[it.camera].iter_mut().zip(it.pixel.iter()) {
                (*least, *most) = (least.min(*at), most.max(*at));
            }
        }
    }
    let part = |bounds: &[[f64; 2]; 2], size: &[u32; 2]| {
        [0, 1].map(|axis| ((bounds[axis][1] - bounds[axis][0]) / f64::from(size[axis])).max(0.0))
    };
    (n_shared, bounds.iter().zip(sizes).map(|(bounds, size)| part(bounds, size)).collect())
}

/// The largest standard deviation of a place on the wall over the part of `map`'s picture that sees the wall [m].
pub(super) fn worst_sigma(map: &PlaneMap, size_m: [f64; 2]) -> f64 {
    const STEPS: u32 = 8;
    let [width, height] = map.image_size.map(f64::from);
    let at = |step: u32, side: f64| (f64::from(step) + 0.5) / f64::from(STEPS) * side;
    let pixels = (0..STEPS).flat_map(|row| (0..STEPS).map(move |column| (column, row)));
    let sigmas = pixels.filter_map(|(column, row)| {
        let placed = map.place(&Point2::new(at(column, width), at(row, height)), &Matrix2::zeros())?;
        let is_wall = (0..2).all(|axis| (0.0..=size_m[axis]).contains(&placed.point[axis]));
        is_wall.then(|| placed.covariance.symmetric_eigenvalues().max().max(0.0).sqrt())
    });
    sigmas.fold(0.0, f64::max)
}
