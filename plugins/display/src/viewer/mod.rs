//! `display.viewer`: what each eye should see on each tile of a display at display time, from the lights on a viewer's head.
//!
//! The lights are found among all targets (`head`), and the eyes lie where the head's pose puts them. Each eye is predicted to `display_latency_ms` after the views
//! are sent, by a predictor of its own (`foveate::estimation::prediction`), which includes the head's rotation. The frustum is that of R. Kooima
//! (`foveate::geometry::off_axis`).
//!
//! While the head is not seen, the eyes are predicted for `hold_ms`, and then no views are sent: displays keep the last.

mod doubts;

use foveate::estimation::{PredictionMethod, Predictor, PredictorOptions};
use foveate::geometry::Screen;
use foveate::prelude::*;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::doubts::Doubts;
use crate::head::Head;

ports! {
    TARGETS: In<Targets> = each("targets");
    VIEWS: Out<Views> = "views";
}

figures! {
        "viewer.views": count, neither, "Messages of views sent";
        "viewer.found": share, high, "Messages of targets in which the head was found, of those from the first such message on";
        "viewer.eyes_behind": count, low, "Eyes not in front of a tile, over all tiles and messages";
}

/// How an eye is predicted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EyePrediction {
    /// Not predicted: the last position.
    Still,
    /// With its velocity.
    Velocity,
    /// By several predictors, weighted by recent prediction error.
    #[default]
    Weighted,
}

/// A tile of the display.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TileSettings {
    /// Its name [–]
    pub name: String,
    /// Its lower left corner, seen from the front [m]
    pub lower_left_m: [f64; 3],
    /// Its lower right corner [m]
    pub lower_right_m: [f64; 3],
    /// Its upper left corner [m]
    pub upper_left_m: [f64; 3],
    /// Its width and height [px]
    pub size_px: [u32; 2],
}

impl TileSettings {
    /// Whether a tile can be as large, and as far away, as its corners say.
    fn check_size(&self, corners: &[Point3<f64>; 3], volume_m: Option<[[f64; 3]; 2]>) -> Result<(), String> {
        let pixel = |side: usize| (corners[side + 1] - corners[0]).norm() / f64::from(self.size_px[side]);
        let ratio = pixel(0) / pixel(1);
        if !PIXEL_SIDES.contains(&ratio) {
            return Err(format!(
                "found pixels {ratio:.2} times as wide as high, expected {} to {}: do the corners match `size_px`?",
                PIXEL_SIDES.start(),
                PIXEL_SIDES.end()
            ));
        }
        let Some([low, high]) = volume_m.map(|it| it.map(Point3::from)) else { return Ok(()) };
        let (middle, across) = (nalgebra::center(&low, &high), (high - low).norm());
        let far = (corners[0] - middle).norm();
        if far > FARTHEST_TILE * across {
            return Err(format!(
                "found a corner {far:.1} m from the middle of `volume_m`, which is {across:.1} m across, expected at most {:.1} m: are all in metres?",
                FARTHEST_TILE * across
            ));
        }
        Ok(())
    }
}

/// Settings of [`Viewer`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ViewerSettings {
    /// The lights on the head, two or more, in its space: x forward, y left, z up. No two distances between them should be equal [mm]
    pub lights_mm: Vec<[f64; 3]>,
    /// The left and the right eye in the same space [mm]
    pub eyes_mm: [[f64; 3]; 2],
    /// Tolerance of the distances between lights: measurement of the lights and errors of the tracker [mm]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub tolerance_mm: f64,
    /// The tiles [–]
    pub tiles: Vec<TileSettings>,
    /// Delay from sending the views until their picture is visible, as measured at this display [ms]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub display_latency_ms: f64,
    /// How eyes are predicted to that moment [–]
    pub foretell: EyePrediction,
    /// How long views continue while the head is not seen [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub hold_ms: f64,
    /// Near plane: what is nearer to the eye is not drawn [m]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub near_m: f64,
    /// Far plane: what is farther from the eye is not drawn [m]
    #[schemars(range(min = 0.1, max = 100000.0))]
    pub far_m: f64,
}

impl Default for ViewerSettings {
    fn default() -> Self {
        Self {
            lights_mm: Vec::new(),
            eyes_mm: [[85.0, 31.5, 0.0], [85.0, -31.5, 0.0]],
            tolerance_mm: 12.0,
            tiles: Vec::new(),
            display_latency_ms: 50.0,
            foretell: EyePrediction::default(),
            hold_ms: 200.0,
            near_m: 0.05,
            far_m: 50.0,
        }
    }
}

impl ViewerSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("tolerance_mm", self.tolerance_mm, 0.1..=1000.0)?;
        ConfigError::unless_in("display_latency_ms", self.display_latency_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("hold_ms", self.hold_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("near_m", self.near_m, 0.001..=100.0)?;
        ConfigError::unless_in("far_m", self.far_m, (self.near_m * 1.001)..=100_000.0)?;
        if !(2..=8).contains(&self.lights_mm.len()) {
            let message = format!("found {} lights, expected 2 to 8 on the head", self.lights_mm.len());
            return Err(ConfigError::at("lights_mm", message));
        }
        for (place, a) in self.lights_mm.iter().enumerate() {
            if !a.iter().all(|it| it.is_finite()) {
                return Err(ConfigError::at(
                    &format!("lights_mm[{place}]"),
                    format!("found {a:?}, expected three numbers"),
                ));
            }
            let near = |b: &&[f64; 3]| (Point3::from(*a) - Point3::from(**b)).norm() <= 2.0 * self.tolerance_mm;
            if let Some(b) = self.lights_mm[..place].iter().find(near) {
                let message =
                    format!("found lights at {a:?} and {b:?}, expected them farther apart than twice `tolerance_mm`");
                return Err(ConfigError::at(&format!("lights_mm[{place}]"), message));
            }
        }
        for (eye, name) in self.eyes_mm.iter().zip(["left", "right"]) {
            if !eye.iter().all(|it| it.abs() <= FARTHEST_EYE_MM) {
                let message = format!(
                    "found the {name} eye at {eye:?}, expected three numbers of {FARTHEST_EYE_MM} at most, from the head's own space"
                );
                return Err(ConfigError::at("eyes_mm", message));
            }
        }
        let [left, right] = self.eyes_mm;
        if left[1] < right[1] {
            let message = format!(
                "found the left eye at y = {} and the right one at y = {}: y is to the left, expected the left eye first",
                left[1], right[1]
            );
            return Err(ConfigError::at("eyes_mm", message));
        }
        let apart = (Point3::from(left) - Point3::from(right)).norm();
        // One place for both eyes is one view for both.
        if apart > 0.0 && !EYES_APART_MM.contains(&apart) {
            let message = format!(
                "found eyes {apart:.2} mm apart, expected {} to {} mm (or both at one place, for one view)",
                EYES_APART_MM.start(),
                EYES_APART_MM.end()
            );
            return Err(ConfigError::at("eyes_mm", message));
        }
        if !(1..=64).contains(&self.tiles.len()) {
            return Err(ConfigError::at("tiles", format!("found {} tiles, expected 1 to 64", self.tiles.len())));
        }
        Ok(())
    }
}

/// Pixels of displays are about as wide as high [–].
const PIXEL_SIDES: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Largest ratio of a tile's distance to the size of the room [–].
const FARTHEST_TILE: f64 = 10.0;
/// Distance between people's pupils, from small children on [mm].
const EYES_APART_MM: std::ops::RangeInclusive<f64> = 40.0..=90.0;
/// Eyes are no farther from the origin of the head's space than this along each axis [mm].
const FARTHEST_EYE_MM: f64 = 500.0;

/// A tile that is ready.
struct Tile {
    name: String,
    size_px: [u32; 2],
    corners: [Point3<f64>; 3],
    screen: Screen,
    /// Eyes that were not in front of it.
    n_behind: u64,
}

/// Targets in, views out.
pub struct Viewer {
    settings: ViewerSettings,
    head: Head,
    eyes: [Point3<f64>; 2],
    predictors: [Predictor; 2],
    tiles: Vec<Tile>,
    /// The newest time so far, and when the head was found last.
    time: Time,
    seen: Option<Time>,
    n_views: u64,
    n_looked: u64,
    n_found: u64,
    doubts: Doubts,
    /// Mean normal of the tiles.
    out: Vector3<f64>,
}

impl Node for Viewer {
    const TYPE: &'static str = "display.viewer";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str =
        "Computes a frustum for each eye and tile from a tracked head, predicted to display time";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ViewerSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ViewerSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let mut tiles: Vec<Tile> = Vec::new();
        for (place, it) in settings.tiles.iter().enumerate() {
            let at = |name: &str| format!("tiles[{place}].{name}");
            if it.name.is_empty() || tiles.iter().any(|tile| tile.name == it.name) {
                let message = format!("found `{}`, expected a name that no other tile has", it.name);
                return Err(ConfigError::at(&at("name"), message));
            }
            for size in it.size_px {
                ConfigError::unless_in(&at("size_px"), size, 1..=100_000)?;
            }
            let corners = [it.lower_left_m, it.lower_right_m, it.upper_left_m].map(Point3::from);
            let screen = Screen::from_corners(corners[0], corners[1], corners[2]);
            let screen = screen.map_err(|fault| ConfigError::at(&at("lower_left_m"), fault))?;
            if setup.volume_m.is_some_and(|it| !is_before(&screen, &corners[0], it)) {
                let message = "found the whole `volume_m` of the scale behind this tile, expected its corners as seen from the front: are lower left and lower right exchanged?";
                return Err(ConfigError::at(&at("lower_left_m"), message));
            }
            it.check_size(&corners, setup.volume_m).map_err(|fault| ConfigError::at(&at("lower_left_m"), fault))?;
            if let Some(other) = tiles.iter().find(|tile| tile.corners == corners) {
                let message = format!("found the place of tile `{}` again, expected each tile at its own", other.name);
                return Err(ConfigError::at(&at("lower_left_m"), message));
            }
            setup.offer("tile", &it.name);
            tiles.push(Tile { name: it.name.clone(), size_px: it.size_px, corners, screen, n_behind: 0 });
        }
        let lights: Vec<Point3<f64>> = settings.lights_mm.iter().map(|it| Point3::from(*it) * 1e-3).collect();
        let method = match settings.foretell {
            EyePrediction::Still => PredictionMethod::Still,
            EyePrediction::Velocity => PredictionMethod::Velocity,
            EyePrediction::Weighted => PredictionMethod::Weighted,
        };
        let predictor = Predictor::new(PredictorOptions { method, ..PredictorOptions::default() });
        let normal: Vector3<f64> = tiles.iter().map(|it| it.screen.normal()).sum();
        let (tolerance, start) = (settings.tolerance_mm * 1e-3, looking_against(&normal));
        Ok(Self {
            doubts: Doubts::new(&lights, tolerance, start),
            out: normal,
            head: Head::new(lights, tolerance, start),
            eyes: settings.eyes_mm.map(|it| Point3::from(it) * 1e-3),
            predictors: [predictor.clone(), predictor],
            tiles,
            settings,
            time: Time(i64::MIN),
            seen: None,
            n_views: 0,
            n_looked: 0,
            n_found: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(Stamped { stamp, value: targets }) = io.take(&TARGETS) else { return Ok(()) };
        // Out of order: the eyes have been carried on already.
        if targets.time <= self.time {
            return Ok(());
        }
        self.time = targets.time;
        self.look(&targets);
        let hold = Interval::from_ms(self.settings.hold_ms);
        if self.seen.is_none_or(|it| targets.time - it > hold) {
            if self.seen.take().is_some() {
                self.head.forget();
                self.predictors.iter_mut().for_each(Predictor::clear);
            }
            return Ok(());
        }
        let shown_at = io.now() + Interval::from_ms(self.settings.display_latency_ms);
        let eyes = self.predictors.each_mut().map(|it| it.predict(shown_at.as_s()).map(|it| it.position));
        let views = Views { time: targets.time, shown_at, tiles: self.views(&eyes) };
        self.n_views += 1;
        io.emit(&VIEWS, stamp, views);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("viewer.views", self.n_views as f64);
        report.figure("viewer.found", self.n_found as f64 / self.n_looked as f64);
        report.figure("viewer.eyes_behind", self.tiles.iter().map(|it| it.n_behind).sum::<u64>() as f64);
        for it in self.tiles.iter().filter(|it| self.n_views > 0 && it.n_behind == 2 * self.n_views) {
            report.remark(format!(
                "no eye was ever before tile `{}`: does it face away? Expected its corners as seen from the front",
                it.name
            ));
        }
        self.doubts.remarks(&self.out).into_iter().for_each(|it| report.remark(it));
        if self.n_found == 0 {
            report.remark("The head was never found: no targets had the mutual distances of `lights_mm`.");
        }
        Ok(())
    }
}

impl Viewer {
    /// Searches the head among the targets, and updates the predictors of its eyes.
    fn look(&mut self, targets: &Targets) {
        let found = self.head.find(&targets.list);
        self.n_looked += u64::from(self.seen.is_some() || found.is_some());
        let Some(space_from_head) = found else { return };
        self.n_found += 1;
        self.doubts.add(&self.head, &space_from_head, &targets.list);
        self.seen = Some(targets.time);
        let lights = targets.list.iter().filter(|it| self.head.knows(it.id));
        let (mut velocity, mut variance, mut n) = (Vector3::zeros(), 0.0, 0.0);
        for it in lights {
            velocity += it.velocity;
            variance += it.position_sigma().powi(2);
            n += 1.0;
        }
        if n == 0.0 {
            return;
        }
        let covariance = Matrix3::from_diagonal_element(variance / (n * n));
        for (eye, predictor) in self.eyes.iter().zip(&mut self.predictors) {
            predictor.observe(targets.time.as_s(), space_from_head * eye, velocity / n, &covariance);
        }
    }

    /// The views of eyes that are there.
    fn views(&mut self, eyes: &[Option<Point3<f64>>; 2]) -> Vec<TileView> {
        let clip = [self.settings.near_m, self.settings.far_m];
        let mut tiles = Vec::new();
        for Tile { name, size_px, corners, screen, n_behind } in &mut self.tiles {
            let view = |eye: &Option<Point3<f64>>| {
                let eye = (*eye)?;
                let found = screen.off_axis(&eye, clip).ok()?;
                Some(EyeView { eye, clip_from_space: found.clip_from_world })
            };
            let eyes = [view(&eyes[0]), view(&eyes[1])];
            *n_behind += eyes.iter().filter(|it| it.is_none()).count() as u64;
            tiles.push(TileView { name: name.clone(), size_px: *size_px, corners: *corners, eyes });
        }
        tiles
    }
}

/// Whether any place of `volume`, opposite corners, is in front of `screen`, one of whose points is `on`.
fn is_before(screen: &Screen, on: &Point3<f64>, volume: [[f64; 3]; 2]) -> bool {
    let corner = |number: usize| Point3::from([0, 1, 2].map(|axis| volume[(number >> axis) & 1][axis]));
    (0..8).any(|it| (corner(it) - on).dot(&screen.normal()) > 1e-6)
}

/// Orientation of an upright head that looks along the opposite of `normal`.
fn looking_against(normal: &Vector3<f64>) -> UnitQuaternion<f64> {
    let level = Vector3::new(-normal.x, -normal.y, 0.0).try_normalize(1e-6).unwrap_or(Vector3::x());
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[
        level,
        Vector3::z().cross(&level),
        Vector3::z(),
    ]))
}

#[cfg(test)]
mod tests;
