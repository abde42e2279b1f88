//! Settings that the matcher and the tracker share.

use foveate::imaging::matching::{MAX_REACH, MatchOptions};
use foveate::prelude::*;
use foveate::scene::Calibration;
use foveate::scene::selection::matches;
use nalgebra::{Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use crate::cover::CoverOptions;
use crate::measure::MeasureOptions;
use crate::seeds::SeedOptions;
use crate::views::View;

/// Settings of matching a surface between views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceSettings {
    /// Cameras that look at the surface, a pattern with `*` and `?` [–]
    pub cameras: String,
    /// The camera whose patches are matched in the others; empty: the one whose direction is nearest to the mean of all. For `surface.matcher` a pattern with `*` and `?`: each of
    /// these cameras gives a cloud, which cameras all around need [–]
    pub reference: String,
    /// Side of a patch, odd. Larger ones are more accurate and coarser; 13 as in [D'Apuzzo 1999] [px]
    #[schemars(range(min = 7, max = 63))]
    pub patch_px: usize,
    /// Distance between points in the reference's picture [px]
    #[schemars(range(min = 1, max = 200))]
    pub spacing_px: usize,
    /// Smallest correlation of matched patches. Below 0.9 patches of 13 px match by chance [–]
    #[schemars(range(min = 0.0, max = 0.999))]
    pub min_correlation: f64,
    /// Largest standard deviation of a match along its worst direction [px]
    #[schemars(range(min = 0.001, max = 10.0))]
    pub max_sigma_px: f64,
    /// Largest ratio of lengths between two views, and of the larger to the smaller of both stretches [–]
    #[schemars(range(min = 1.01, max = 10.0))]
    pub max_stretch: f64,
    /// Largest distance of a match from its prediction by a neighbour [px]
    #[schemars(range(min = 0.1, max = 50.0))]
    pub max_shift_px: f64,
    /// Largest root mean square reprojection error of a point. With two views this is half of a match's distance from its epipolar line [px]
    #[schemars(range(min = 0.01, max = 100.0))]
    pub max_misfit_px: f64,
    /// Largest error of a match back from the other view; 0: no match back, which takes half the time [px]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub max_back_px: f64,
    /// Fewest views of a point, the reference included [–]
    #[schemars(range(min = 2, max = 64))]
    pub min_views: usize,
    /// Whether all views are matched at once, with the point in space as the unknown. For calibrations as accurate as the matches: their errors become roughness [–]
    pub in_space: bool,
    /// Standard deviation of a pixel's direction: that of a good calibration [px]
    #[schemars(range(min = 0.001, max = 10.0))]
    pub camera_sigma_px: f64,
    /// Radius of a point's neighbourhood, in points [–]
    #[schemars(range(min = 1, max = 5))]
    pub around: usize,
    /// Smallest part of the neighbourhood that must be on the same surface [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_agreeing: f64,
    /// Largest deviation of a neighbourhood from a plane relative to its distance, beyond noise [–]
    #[schemars(range(min = 0.00001, max = 0.1))]
    pub step: f64,
    /// Fewest points of a piece of surface without a connection to others: a wrong match has few agreeing neighbours [–]
    #[schemars(range(min = 1, max = 10000))]
    pub min_piece: usize,
    /// Nearest and farthest distance from the reference for the search of seeds; left out: where its lines of sight pass the scale's `volume_m` [m]
    pub distance_m: Option<[f64; 2]>,
    /// Tiles along the picture's longer side, with one seed each [–]
    #[schemars(range(min = 1, max = 200))]
    pub seed_tiles: usize,
    /// Pyramid levels for the search of seeds and for large motions [–]
    #[schemars(range(min = 1, max = 6))]
    pub levels: usize,
    /// A second place this good, relative to the best one, makes a seed ambiguous [–]
    #[schemars(range(min = 0.1, max = 1.0))]
    pub max_second: f64,
    /// Seeds chosen by hand: by camera, column and row of one point of the surface, to a pixel or two. Left out: they are searched [px]
    pub seeds: Vec<BTreeMap<String, [f64; 2]>>,
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        Self {
            cameras: "*".to_owned(),
            reference: String::new(),
            patch_px: 13,
            spacing_px: 7,
            min_correlation: 0.9,
            max_sigma_px: 0.1,
            max_stretch: 2.5,
            max_shift_px: 3.0,
            max_misfit_px: 1.0,
            max_back_px: 0.3,
            min_views: 2,
            in_space: false,
            camera_sigma_px: 0.1,
            around: 2,
            min_agreeing: 0.25,
            step: 5e-4,
            min_piece: 12,
            distance_m: None,
            seed_tiles: 16,
            levels: 3,
            max_second: 0.93,
            seeds: Vec::new(),
        }
    }
}

/// A seed that was named, by view.
pub type NamedSeed = Vec<(usize, [f64; 2])>;

/// Prepared settings.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The cameras.
    pub views: Vec<View>,
    /// Which of them is the reference now.
    pub reference: usize,
    /// All references, which take turns, and the nearest and farthest distance from each for the search of seeds [m].
    pub references: Vec<(usize, [f64; 2])>,
    /// Of a point.
    pub measure: MeasureOptions,
    /// Of the surface.
    pub cover: CoverOptions,
    /// Of its beginning.
    pub seeds: SeedOptions,
    /// Named ones.
    pub named: Vec<NamedSeed>,
}

/// The least distance between camera and surface that is looked at [m].
const NEAREST_M: f64 = 1e-3;

impl SurfaceSettings {
    /// Finds cameras and reference in the calibration and checks what ranges cannot say.
    ///
    /// # Errors
    /// The setting, what was found, and what is expected.
    pub fn prepare(&self, setup: &Setup) -> Result<Prepared, ConfigError> {
        ConfigError::unless_in("patch_px", self.patch_px, 7..=2 * MAX_REACH + 1)?;
        if self.patch_px.is_multiple_of(2) {
            return Err(ConfigError::at("patch_px", format_args!("found {}, expected an odd number", self.patch_px)));
        }
        ConfigError::unless_in("spacing_px", self.spacing_px, 1..=200)?;
        ConfigError::unless_in("min_correlation", self.min_correlation, 0.0..=0.999)?;
        ConfigError::unless_in("max_sigma_px", self.max_sigma_px, 0.001..=10.0)?;
        ConfigError::unless_in("max_stretch", self.max_stretch, 1.01..=10.0)?;
        ConfigError::unless_in("max_shift_px", self.max_shift_px, 0.1..=50.0)?;
        ConfigError::unless_in("max_misfit_px", self.max_misfit_px, 0.01..=100.0)?;
        ConfigError::unless_in("max_back_px", self.max_back_px, 0.0..=10.0)?;
        ConfigError::unless_in("min_views", self.min_views, 2..=64)?;
        ConfigError::unless_in("camera_sigma_px", self.camera_sigma_px, 0.001..=10.0)?;
        ConfigError::unless_in("around", self.around, 1..=5)?;
        ConfigError::unless_in("min_agreeing", self.min_agreeing, 0.0..=1.0)?;
        ConfigError::unless_in("step", self.step, 1e-5..=0.1)?;
        ConfigError::unless_in("min_piece", self.min_piece, 1..=10_000)?;
        ConfigError::unless_in("seed_tiles", self.seed_tiles, 1..=200)?;
        ConfigError::unless_in("levels", self.levels, 1..=6)?;
        ConfigError::unless_in("max_second", self.max_second, 0.1..=1.0)?;
        let calibration: &Calibration = &setup.calibration;
        let views: Vec<View> = setup
            .cameras_named(&self.cameras)
            .map(|id| {
                let named = &calibration.cameras[usize::from(id.0)];
                View { id, name: named.name.clone(), camera: named.camera.clone() }
            })
            .collect();
        if views.len() >= 2 && views.len() < self.min_views {
            let n = views.len();
            return Err(ConfigError::at(
                "min_views",
                format_args!("found {}, expected at most {n}, the number of cameras", self.min_views),
            ));
        }
        if views.len() < self.min_views {
            let n = views.len();
            return Err(ConfigError::at(
                "cameras",
                format_args!("found {n} matching cameras in the calibration, expected at least {}", self.min_views),
            ));
        }
        let references: Vec<usize> = match self.reference.as_str() {
            "" => vec![middle_of(&views)],
            pattern => (0..views.len()).filter(|it| matches(pattern, &views[*it].name)).collect(),
        };
        if references.is_empty() {
            let names: Vec<&str> = views.iter().map(|it| it.name.as_str()).collect();
            let message = format_args!("found `{}`, expected one of {}", self.reference, names.join(", "));
            return Err(ConfigError::at("reference", message));
        }
        let references = references
            .into_iter()
            .map(|it| Ok((it, self.distances(&views[it], setup)?)))
            .collect::<Result<Vec<_>, ConfigError>>()?;
        let (reference, distance_m) = references[0];
        let mut named = Vec::new();
        for seed in &self.seeds {
            let mut places: NamedSeed = Vec::new();
            for (name, pixel) in seed {
                let view = views.iter().position(|it| it.name == *name);
                let view = view.filter(|it| views[*it].camera.has_pixel(&Point2::from(*pixel))).ok_or_else(|| {
                    ConfigError::at(
                        "seeds",
                        format_args!(
                            "found {pixel:?} in `{name}`, expected a camera of the surface and a pixel in its picture"
                        ),
                    )
                })?;
                places.push((view, *pixel));
            }
            if places.len() < 2 || references.iter().all(|of| places.iter().all(|it| it.0 != of.0)) {
                let names: Vec<String> = references.iter().map(|it| format!("`{}`", views[it.0].name)).collect();
                return Err(ConfigError::at(
                    "seeds",
                    format_args!(
                        "found a seed in {} cameras, expected {} and at least one other",
                        places.len(),
                        names.join(" or ")
                    ),
                ));
            }
            named.push(places);
        }
        let matching = MatchOptions {
            min_correlation: self.min_correlation,
            max_sigma_px: self.max_sigma_px,
            max_stretch: self.max_stretch,
            max_shear: self.max_stretch,
            max_shift_px: self.max_shift_px,
            ..MatchOptions::default()
        };
        Ok(Prepared {
            measure: MeasureOptions {
                reach: self.patch_px / 2,
                matching,
                in_space: self.in_space,
                max_misfit_px: self.max_misfit_px,
                max_back_px: self.max_back_px,
                min_views: self.min_views,
                camera_sigma_px: self.camera_sigma_px,
                volume_m: setup.volume_m,
            },
            cover: CoverOptions {
                spacing_px: self.spacing_px,
                tries: 3,
                around: self.around,
                min_agreeing: self.min_agreeing,
                step: self.step,
                min_piece: self.min_piece,
            },
            seeds: SeedOptions {
                tiles: self.seed_tiles,
                n_levels: self.levels,
                max_second: self.max_second,
                min_correlation: self.min_correlation.min(0.85),
                distance_m,
            },
            reference,
            references,
            views,
            named,
        })
    }

    /// Nearest and farthest distance from a reference for the search of seeds [m].
    fn distances(&self, reference: &View, setup: &Setup) -> Result<[f64; 2], ConfigError> {
        match (self.distance_m, setup.volume_m) {
            (Some([near, far]), _) if near >= NEAREST_M && far > near && far.is_finite() => Ok([near, far]),
            (Some([near, far]), _) => Err(ConfigError::at(
                "distance_m",
                format_args!(
                    "found [{near}, {far}], expected the nearer one, more than {NEAREST_M}, and a farther one"
                ),
            )),
            (None, Some(volume)) => distances(reference, volume).ok_or_else(|| {
                ConfigError::node(format_args!(
                    "`{}` does not see the scale's volume, expected it in front of the camera",
                    reference.name
                ))
            }),
            (None, None) => Err(ConfigError::at(
                "distance_m",
                "found neither this nor `volume_m` of the scale, expected one of them for the search of seeds",
            )),
        }
    }
}

/// The view whose direction is nearest to the mean of all.
fn middle_of(views: &[View]) -> usize {
    let direction = |it: &View| it.camera.camera_from_world.rotation.inverse() * nalgebra::Vector3::z();
    let mean: nalgebra::Vector3<f64> = views.iter().map(direction).sum();
    let along = |at: &usize| direction(&views[*at]).dot(&mean);
    (0..views.len()).rev().max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(0)
}

/// Nearest and farthest distance of the corners of a volume before a camera.
fn distances(view: &View, [a, b]: [[f64; 3]; 2]) -> Option<[f64; 2]> {
    let mut range = [f64::INFINITY, 0.0_f64];
    for corner in 0..8 {
        let point = Point3::from([0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { a[axis] } else { b[axis] }));
        let depth = (view.camera.camera_from_world * point).z;
        let distance = (point - view.camera.centre()).norm();
        if depth > 0.0 {
            range = [range[0].min(depth.max(NEAREST_M)), range[1].max(distance)];
        }
    }
    (range[0] < range[1]).then_some(range)
}
