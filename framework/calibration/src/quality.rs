//! How well cameras explain their common observations: compares an older and a newer calibration over the same recording.

use std::collections::BTreeMap;

use foveate_estimation::statistics::median;
use foveate_geometry::{Camera, agreeing_point};
use nalgebra::Point2;

use crate::solved::Solved;

/// How well a set of cameras explains the observations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Cameras with a pose that saw something [–].
    pub cameras: usize,
    /// Share of the observations, of all cameras and of moments that two or more saw, within the limit of a point on which most agree [–].
    pub explained: f64,
    /// Median distance of these from where the point is seen [px].
    pub median_px: f64,
}

/// Cameras and where each saw a light at one moment.
type Seen = Vec<(usize, Point2<f64>)>;

/// How well `cameras`, by camera of `solved`, explain its observations; `None` is an unknown camera, which explains nothing.
/// Points are intersected again with these cameras, so that no calibration has an advantage because the points were adjusted to it.
pub fn quality(solved: &Solved, cameras: &[Option<Camera>], limit_px: f64) -> Quality {
    let mut moments: BTreeMap<(usize, u32), Seen> = BTreeMap::new();
    for it in &solved.observations {
        let label = it.point.map_or(0, |point| solved.points[point].label);
        moments.entry((it.frame, label)).or_default().push((it.camera, it.pixel));
    }
    let (mut n, mut explained, mut errors) = (0_usize, 0_usize, Vec::new());
    let mut seen = vec![false; cameras.len()];
    for moment in moments.values().filter(|it| it.len() >= 2) {
        n += moment.len();
        let known: Vec<(&Camera, Point2<f64>)> =
            moment.iter().filter_map(|(camera, pixel)| Some((cameras[*camera].as_ref()?, *pixel))).collect();
        moment.iter().for_each(|it| seen[it.0] |= cameras[it.0].is_some());
        let Some(found) = agreeing_point(&known, limit_px) else { continue };
        explained += found.agreeing.iter().filter(|it| **it).count();
        let right = known.iter().zip(&found.agreeing).filter(|it| *it.1).map(|it| it.0);
        errors.extend(right.filter_map(|(camera, pixel)| Some((camera.project(&found.point)? - pixel).norm())));
    }
    Quality {
        cameras: seen.iter().filter(|it| **it).count(),
        explained: explained as f64 / n.max(1) as f64,
        median_px: median(&errors).unwrap_or(f64::INFINITY),
    }
}

/// Explaining so much less is worse [–].
const LESS_EXPLAINED: f64 = 0.02;
/// So many times the distance, and by so much, is worse.
const FARTHER: (f64, f64) = (1.1, 0.05);

impl Quality {
    /// In which respect this is worse than `older`, as a sentence; `None` where it is not.
    pub fn worse_than(&self, older: &Quality) -> Option<String> {
        if self.cameras < older.cameras {
            return Some(format!("{} cameras are known, {} were before", self.cameras, older.cameras));
        }
        if self.explained < older.explained - LESS_EXPLAINED {
            let [now, before] = [self, older].map(|it| 100.0 * it.explained);
            return Some(format!("it explains {now:.1} % of the observations, the older one {before:.1} %"));
        }
        if self.median_px > FARTHER.0 * older.median_px && self.median_px > older.median_px + FARTHER.1 {
            let [now, before] = [self.median_px, older.median_px];
            return Some(format!("observations are {now:.2} px off in the median, {before:.2} px with the older one"));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_cameras_less_explained_and_larger_distances_are_worse() {
        let older = Quality { cameras: 4, explained: 0.97, median_px: 0.3 };
        let worse = |it: Quality| it.worse_than(&older);
        assert_eq!(worse(older), None);
        assert!(worse(Quality { cameras: 3, ..older }).is_some_and(|it| it.contains('3')));
        assert!(worse(Quality { explained: 0.9, ..older }).is_some_and(|it| it.contains("90.0")));
        assert!(worse(Quality { median_px: 0.5, ..older }).is_some_and(|it| it.contains("0.50")));
        assert_eq!(worse(Quality { median_px: 0.31, explained: 0.96, ..older }), None);
    }
}
