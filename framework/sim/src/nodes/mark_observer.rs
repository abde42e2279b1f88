//! An ideal tracker of painted marks as a source: marks without pictures, for rigs too large to render.

use std::collections::BTreeMap;

use foveate_estimation::random::Random;
use foveate_messages::{CameraId, Feature, Features, MarkGuide};
use foveate_node::{
    ConfigError, Due, Figures, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, Time, ports,
};
use nalgebra::{Matrix2, Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fields::{CLOCK_FIGURES, Fields, own_camera};
use crate::chance::stream;
use crate::head::HeadMotion;
use crate::painted::Painted;
use crate::timing::{Arrival, Timing, TimingSettings};
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    HEAD: In<HeadMotion> = latest("head").optional();
    GUIDE: In<MarkGuide> = latest("guide").optional();
    FEATURES: Out<Features> = "features";
}

/// A mark takes the name that a guide states for a place if it truly lies within this distance of it [px].
const NEAR_PX: f64 = 4.0;

/// Settings of [`SimMarkObserver`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MarkObserverSettings {
    /// Capture times, clock and delivery of its features.
    #[serde(flatten)]
    pub timing: TimingSettings,
    /// Exposure time, as of a `sim.camera`: marks are seen at its middle [ms].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub exposure_ms: f64,
    /// Standard deviation of a mark's place, stated as it is [px].
    #[schemars(range(min = 0.001, max = 20.0))]
    pub noise_px: f64,
    /// Share of the marks in view that are not found, drawn for each mark and field [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub missed: f64,
    /// A mark seen more obliquely than this is not found; 90: as long as it faces the camera at all [deg].
    #[schemars(range(min = 0.0, max = 90.0))]
    pub most_oblique_deg: f64,
    /// Whether each mark is reported under its own number, as by hand, rather than by the name that the guide gives it [–].
    pub named: bool,
}

impl Default for MarkObserverSettings {
    fn default() -> Self {
        Self {
            timing: TimingSettings::default(),
            exposure_ms: 0.0,
            noise_px: 0.1,
            missed: 0.01,
            most_oblique_deg: 72.0,
            named: false,
        }
    }
}

/// A camera and its tracker of painted marks in one; with `head` connected it stands on that head. It never confuses marks, and
/// never forgets the name that a guide gave one.
pub struct SimMarkObserver {
    settings: MarkObserverSettings,
    /// Its name in the calibration.
    name: Option<String>,
    camera: TrueCamera,
    id: CameraId,
    fields: Fields,
    seed: u64,
    world: Option<World>,
    /// By true number: its name, and since when.
    names: BTreeMap<usize, (u32, Time)>,
    /// The newest guide that was listened to.
    guided: Option<Time>,
    /// Of the last fields: time, and where each mark was.
    seen: Vec<(Time, Vec<Option<Point2<f64>>>)>,
    pool: Pool<Features>,
}

impl Node for SimMarkObserver {
    const TYPE: &'static str = "sim.mark_observer";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "An ideal tracker of painted marks in a simulated world, without pictures";
    const FIGURES: Figures = CLOCK_FIGURES;
    type Settings = MarkObserverSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: MarkObserverSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.timing.check()?;
        ConfigError::unless_in("exposure_ms", settings.exposure_ms, 0.0..=100.0)?;
        settings.timing.check_light(settings.exposure_ms, 0.0)?;
        ConfigError::unless_in("noise_px", settings.noise_px, 0.001..=20.0)?;
        ConfigError::unless_in("missed", settings.missed, 0.0..=1.0)?;
        ConfigError::unless_in("most_oblique_deg", settings.most_oblique_deg, 0.0..=90.0)?;
        let (id, camera) = own_camera(setup)?;
        Ok(Self {
            name: setup.camera_name().map(str::to_owned),
            camera: TrueCamera::from(camera),
            id,
            fields: Fields::new(
                Timing::new(&settings.timing, settings.exposure_ms, &setup.random),
                setup.camera_name(),
            ),
            seed: setup.random.fork("marks").next_u64(),
            world: None,
            names: BTreeMap::new(),
            guided: None,
            seen: Vec::new(),
            pool: Pool::default(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.world.is_none()
            && let Some(world) = io.latest(&WORLD).map(|it| it.value)
        {
            self.camera = world.camera(self.name.as_deref(), &self.camera);
            self.world = Some(world.clone());
        }
        let Some(Arrival { frame, capture, stamp, .. }) = self.fields.next(io, &FEATURES) else {
            return Ok(());
        };
        let Some(world) = self.world.clone() else {
            Fields::without_world(io, &FEATURES, stamp);
            return Ok(());
        };
        if let Some(guide) = io.latest(&GUIDE) {
            self.listen(guide.value, stamp);
        }
        let camera = match io.latest(&HEAD) {
            Some(motion) => motion.value.camera_at(&self.camera, capture),
            None => self.camera.clone(),
        };
        let mut features = self.pool.take(Features::default);
        features.camera = self.id;
        features.list.clear();
        let seen = world.painted(capture).map_or_else(Vec::new, |it| self.look(&it, &camera, capture, &mut features));
        if self.seen.len() == MOST_SEEN {
            self.seen.remove(0);
        }
        self.seen.push((stamp, seen));
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

    fn plan(settings: &MarkObserverSettings) -> Plan {
        settings.timing.plan()
    }
}

/// Fields that a guide may be about.
const MOST_SEEN: usize = 8;

impl SimMarkObserver {
    /// Takes over the names of a guide, `now`: of each guided place, the mark that truly was there. A name that is disputed is taken back wherever its mark should
    /// have been, unless it was given after the time of the guide.
    fn listen(&mut self, guide: &MarkGuide, now: Time) {
        if self.guided.replace(guide.time) == Some(guide.time) {
            return;
        }
        for disputed in guide.of(self.id).iter().filter(|it| it.disputed) {
            self.names.retain(|_, (label, since)| *label != disputed.label || *since > guide.time);
        }
        let Some((_, places)) = self.seen.iter().find(|it| it.0 == guide.time) else { return };
        for guided in guide.of(self.id).iter().filter(|it| !it.disputed) {
            let near = |place: &Option<Point2<f64>>| place.map_or(f64::INFINITY, |it| (it - guided.pixel).norm());
            let nearest = places.iter().map(near).enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((mark, _)) = nearest.filter(|it| it.1 < NEAR_PX) else { continue };
            let is_free = !self.names.contains_key(&mark) && !self.names.values().any(|it| it.0 == guided.label);
            if is_free {
                self.names.insert(mark, (guided.label, now));
            }
        }
    }

    /// Reports what is seen of the marks; where each of these is in the picture.
    fn look(
        &self,
        painted: &Painted,
        camera: &TrueCamera,
        time: Time,
        features: &mut Features,
    ) -> Vec<Option<Point2<f64>>> {
        let mut random = stream(self.seed, 0, time.0);
        let eye = camera.centre();
        let least_cosine = self.settings.most_oblique_deg.to_radians().cos();
        let mut places = vec![None; painted.marks.len()];
        for (mark, place) in painted.marks.iter().enumerate() {
            let (missed, noise) = (random.uniform() < self.settings.missed, noise(&mut random, self.settings.noise_px));
            let cosine = painted.normals[mark].dot(&(eye - place).normalize());
            let Some(pixel) = camera.sees(place).filter(|_| cosine > least_cosine && painted.sees(&eye, mark)) else {
                continue;
            };
            places[mark] = Some(pixel);
            if !missed {
                features.list.push(Feature {
                    centre: pixel + noise,
                    covariance: Matrix2::identity() * self.settings.noise_px.powi(2),
                    area: 0,
                    peak: 0,
                    label: if self.settings.named { Some(mark as u32) } else { self.names.get(&mark).map(|it| it.0) },
                });
            }
        }
        features.list.sort_by_key(|it| (it.label.is_none(), it.label));
        places
    }
}

fn noise(random: &mut Random, sigma: f64) -> Vector2<f64> {
    Vector2::new(random.normal(), random.normal()) * sigma
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_geometry::Camera;
    use foveate_messages::GuidedMark;
    use foveate_testkit::check_node;
    use nalgebra::Point3;

    use super::*;
    use crate::lab::lab_calibration;

    fn observer() -> SimMarkObserver {
        let mut setup = Setup::for_tests();
        (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
        SimMarkObserver::new(MarkObserverSettings::default(), &setup).unwrap()
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimMarkObserver>("");
        check_node::<SimMarkObserver>("noise_px = 0.2\nnamed = true\nmissed = 0.1");
    }

    #[test]
    fn settings_out_of_range_and_a_missing_camera_are_refused() {
        let refused = |settings| SimMarkObserver::new(settings, &Setup::for_tests()).err();
        let wrong = MarkObserverSettings { missed: f64::NAN, ..MarkObserverSettings::default() };
        assert_eq!(refused(wrong).and_then(|it| it.setting).as_deref(), Some("missed"));
        assert!(refused(MarkObserverSettings::default()).is_some_and(|it| it.message.contains("no camera")));
    }

    #[test]
    fn a_mark_has_the_name_that_a_guide_gave_it_until_that_is_disputed() {
        let mut observer = observer();
        let place = |x: f64| Some(Point2::new(x, 100.0));
        let guided = |label: u32, x: f64, disputed: bool| GuidedMark {
            label,
            pixel: Point2::new(x, 101.0),
            covariance: Matrix2::identity(),
            disputed,
        };
        let guide = |ms: f64, marks: Vec<GuidedMark>| MarkGuide {
            time: Time::from_s(ms * 1e-3),
            cameras: vec![(CameraId(0), marks)],
        };
        observer.seen.push((Time::from_s(0.001), vec![place(50.0), None, place(80.0)]));
        observer.seen.push((Time::from_s(0.002), vec![place(60.0), None, place(90.0)]));
        let (now, later) = (Time::from_s(0.002), Time::from_s(0.003));
        observer
            .listen(&guide(1.0, vec![guided(7, 51.0, false), guided(9, 79.0, false), guided(3, 200.0, false)]), now);
        assert_eq!(observer.names, [(0, (7, now)), (2, (9, now))].into());
        observer.listen(&guide(2.0, vec![guided(7, 60.0, true), guided(5, 90.0, false)]), later);
        assert_eq!(observer.names, [(2, (9, now))].into(), "one name is disputed, the other is kept");
        // Where mark 9 should be, nothing is seen: it is a name that went to another mark.
        observer.seen.push((later, vec![place(60.0), None, place(90.0)]));
        observer.listen(&guide(1.5, vec![guided(9, 150.0, true)]), later);
        assert_eq!(observer.names.len(), 1, "the name was given after the time of the guide");
        observer.listen(&guide(3.0, vec![guided(9, 150.0, true)]), later);
        assert!(observer.names.is_empty());
    }

    #[test]
    fn what_is_seen_is_before_the_camera_and_not_hidden() {
        let settings = crate::world::SceneSettings {
            walk: crate::world::WalkKind::Stage,
            face: Some(crate::painted::FaceSettings::default()),
            ..crate::world::SceneSettings::default()
        };
        let world = World::new(settings, &Random::new(1));
        let time = Time::from_s(6.0);
        let painted = world.painted(time).unwrap();
        let middle = painted.world_from_part * Point3::origin();
        let observer = observer();
        let count = |y: f64| {
            let camera = Camera::look_at(middle + nalgebra::Vector3::new(0.0, y, 0.1), middle, [640, 480], 2600.0);
            let mut features = Features::default();
            let places = observer.look(&painted, &TrueCamera::from(&camera), time, &mut features);
            assert!(features.list.len() <= places.iter().flatten().count());
            features.list.len()
        };
        assert!(count(3.0) > painted.marks.len() * 3 / 4 && count(-3.0) < 8, "{} {}", count(3.0), count(-3.0));
    }
}
