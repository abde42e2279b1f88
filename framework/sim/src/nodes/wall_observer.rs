//! An ideal detector before a simulated wall as a source: features without pictures.

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Feature, Features};
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, ports};
use nalgebra::{Matrix2, Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::chance::stream;
use crate::timing::{Arrival, Timing, TimingSettings};
use crate::truth::TrueCamera;
use crate::wall::{Wall, WallLight};

ports! {
    WALL: In<Wall> = latest("wall");
    FEATURES: Out<Features> = "features";
}

const FIELDS: u64 = 0;

/// When an observer of a wall looks, and how well it sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WallObserverSettings {
    /// Capture times, clock and delivery of its features.
    #[serde(flatten)]
    pub timing: TimingSettings,
    /// Standard deviation of a feature along each axis; stated as it is with each feature [px].
    #[schemars(range(min = 0.001, max = 20.0))]
    pub noise_px: f64,
    /// Share of the spots in view that are not found, drawn for each spot and field [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub missed: f64,
    /// Spots closer to each other than this are found as one, in the middle of their light [px].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub spot_width_px: f64,
    /// Darker spots are not found [gray level].
    #[schemars(range(min = 1.0, max = 255.0))]
    pub least_peak: f64,
}

impl Default for WallObserverSettings {
    fn default() -> Self {
        Self { timing: TimingSettings::default(), noise_px: 0.05, missed: 0.0, spot_width_px: 4.0, least_peak: 100.0 }
    }
}

/// A camera and its detector in one, before a wall: spots of pointers, their reflections in bezels, and red spots of the contents, each with the peak that it has.
pub struct SimWallObserver {
    settings: WallObserverSettings,
    name: Option<String>,
    calibrated: Camera,
    id: CameraId,
    seed: u64,
    fields: Fields,
    seen: Option<(Wall, TrueCamera)>,
    spots: Vec<(Point2<f64>, f64, f64)>,
    pool: Pool<Features>,
}

impl Node for SimWallObserver {
    const TYPE: &'static str = "sim.wall_observer";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "An ideal spot detector before the simulated wall: noise and misses, no pictures";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = WallObserverSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: WallObserverSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.timing.check()?;
        ConfigError::unless_in("noise_px", settings.noise_px, 0.001..=20.0)?;
        ConfigError::unless_in("missed", settings.missed, 0.0..=1.0)?;
        ConfigError::unless_in("spot_width_px", settings.spot_width_px, 0.0..=100.0)?;
        ConfigError::unless_in("least_peak", settings.least_peak, 1.0..=255.0)?;
        let (id, camera) = own_camera(setup)?;
        Ok(Self {
            name: setup.camera_name().map(str::to_owned),
            calibrated: camera.clone(),
            id,
            seed: setup.random.fork("features").next_u64(),
            fields: Fields::new(Timing::new(&settings.timing, 0.0, &setup.random), setup.camera_name()),
            seen: None,
            spots: Vec::new(),
            pool: Pool::default(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.seen.is_none()
            && let Some(wall) = io.latest(&WALL).map(|it| it.value.clone())
        {
            let camera = wall.camera(self.name.as_deref(), &self.calibrated);
            self.seen = Some((wall, camera));
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &FEATURES) else {
            return Ok(());
        };
        let Some((wall, camera)) = &self.seen else {
            Fields::without_world(io, &FEATURES, stamp);
            return Ok(());
        };
        let WallObserverSettings { noise_px, missed, spot_width_px, least_peak, .. } = self.settings;
        let mut random = stream(self.seed, FIELDS, capture.0);
        let spots = &mut self.spots;
        spots.clear();
        let is_before = wall.faces(&camera.centre());
        let mut see = |light: WallLight, random: &mut Random| {
            if !is_before {
                return;
            }
            let Some(pixel) = camera.sees(&wall.in_space(&light.point)) else { return };
            let Some(scale) = wall.pixels_a_metre(camera, &light.point) else { return };
            let is_found = random.uniform() >= missed;
            if is_found && light.peak >= least_peak {
                spots.push((pixel, light.peak, light.sigma * scale));
            }
        };
        wall.spots(capture, &camera.centre(), |light| see(light, &mut random));
        wall.shown_lights(capture, |light| see(light, &mut random));
        join(spots, spot_width_px);
        let mut features = self.pool.take(Features::default);
        features.camera = self.id;
        features.list.clear();
        features.list.extend(spots.iter().map(|(pixel, peak, sigma)| {
            let off = Vector2::new(random.normal(), random.normal()) * noise_px;
            // Of a Gaussian, as much is above the least peak.
            let area = std::f64::consts::TAU * sigma.max(0.5).powi(2) * (peak / least_peak).ln().max(0.2);
            Feature {
                centre: pixel + off,
                covariance: Matrix2::identity() * noise_px * noise_px,
                area: area.ceil() as u32,
                peak: peak.min(255.0) as u8,
                label: None,
            }
        }));
        features.list.sort_by(|a, b| a.centre.y.total_cmp(&b.centre.y));
        io.emit_numbered(&FEATURES, stamp, frame, self.pool.share(features));
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.fields.due()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.fields.report_clock(report);
        Ok(())
    }

    fn plan(settings: &WallObserverSettings) -> Plan {
        settings.timing.plan()
    }
}

/// Joins spots closer than `width`, each with pixel, peak and width, into one in the middle of their light.
fn join(spots: &mut Vec<(Point2<f64>, f64, f64)>, width: f64) {
    let mut first = 0;
    while first < spots.len() {
        let near = (first + 1..spots.len()).find(|it| (spots[*it].0 - spots[first].0).norm() < width);
        match near {
            Some(other) => {
                let (pixel, peak, sigma) = spots.swap_remove(other);
                let (at, most, wide) = spots[first];
                let share = peak / (peak + most);
                let apart = (pixel - at).norm() / 2.0;
                spots[first] = (at + (pixel - at) * share, most.max(peak), wide.max(sigma).hypot(apart));
                // The joined one has moved: it is compared with all again.
                first = 0;
            }
            None => first += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimWallObserver>("");
        check_node::<SimWallObserver>("noise_px = 0.2\nmissed = 0.1");
        let none = SimWallObserver::new(WallObserverSettings::default(), &Setup::for_tests());
        assert!(none.is_err_and(|it| it.setting.is_none()));
    }

    #[test]
    fn spots_that_touch_are_one_in_the_middle_of_their_light() {
        let mut spots = vec![
            (Point2::new(10.0, 10.0), 300.0, 1.0),
            (Point2::new(50.0, 10.0), 200.0, 1.0),
            (Point2::new(12.0, 10.0), 100.0, 1.0),
        ];
        join(&mut spots, 3.0);
        assert_eq!(spots.len(), 2);
        assert_eq!((spots[0].0, spots[0].1), (Point2::new(10.5, 10.0), 300.0));
    }
}
