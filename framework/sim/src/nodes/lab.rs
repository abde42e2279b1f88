//! The simulated lab as a source: the world once, and the truth about its targets again and again.

use std::path::PathBuf;
use std::sync::Arc;

use foveate_messages::Targets;
use foveate_node::{ConfigError, Due, Io, Node, NodeError, Plan, Pool, Ports, Report, Role, Setup, Time, ports};
use foveate_scene::skeleton::SkeletonMotion;

use crate::painted::{FaceSettings, FaceSource, PartKind, RecordedHead};
use crate::person::{RecordedBody, RecordingHints, WholeBody};
use crate::studio::{ArmSettings, StudioSettings};
use crate::truth::Truth;
use crate::world::{
    Body, BodyMotion, BodySource, BustSettings, DartSettings, LightPath, MAX_MONITORS, Recordings, SceneSettings,
    SwingSettings, WalkKind, World,
};

ports! {
    WORLD: Out<World> = "world";
    TRUTH: Out<Targets> = "truth";
}

/// The true cameras, for people to compare with.
const TRUTH_FILE: &str = "truth.calibration.toml";

/// More people would tread on each other's heels.
const MOST_ON_A_ROUND: usize = 4;

/// Gives the [`World`] at time 0, before any camera looks, and [`World::truth`] at 0, 1/`truth_hz`, …: person p's LED l, in the
/// order of [`LED_NAMES`](crate::person::LED_NAMES), is target 8 p + l, and
/// another one if the person has been away.
pub struct Lab {
    world: World,
    /// Remarks on where face and bodies come from.
    remarks: Vec<String>,
    /// What the true cameras are, and where that is written.
    cameras: Option<(String, PathBuf)>,
    truth_hz: f64,
    next: u64,
    pool: Pool<Targets>,
}

impl Node for Lab {
    const TYPE: &'static str = "sim.lab";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A simulated lab: people with LEDs, clutter, and the true positions of the LEDs";
    type Settings = SceneSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SceneSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let SceneSettings {
            people,
            walk,
            walk_area_m,
            closest_m,
            people_enter_s,
            stay_s,
            away_s,
            stand_s,
            stage_m,
            speed_m_s,
            led_peak,
            reflections,
            bright_spots,
            monitors,
            window_change_s,
            truth_hz,
            glints_hz,
            ref face,
            headband,
            ref body,
            waved_light,
            ref wave,
            ref swing,
            ref darts,
            ref light_path,
            ref bust,
            ref studio,
            ref arm,
            ref truth,
        } = settings;
        ConfigError::unless_in("people", people, 0..=32)?;
        for extent in walk_area_m {
            ConfigError::unless_in("walk_area_m", extent, 1.0..=200.0)?;
        }
        ConfigError::unless_in("closest_m", closest_m, 0.4..=10.0)?;
        ConfigError::unless_in("people_enter_s", people_enter_s, 0.0..=3600.0)?;
        ConfigError::unless_in("stay_s", stay_s, 0.0..=1e6)?;
        ConfigError::unless_in("away_s", away_s, 0.0..=1e6)?;
        ConfigError::unless_in("stand_s", stand_s, 0.0..=3600.0)?;
        ConfigError::unless_in("stage_m", stage_m, 0.2..=20.0)?;
        ConfigError::unless_in("speed_m_s", speed_m_s, 0.1..=2.0)?;
        ConfigError::unless_in("led_peak", led_peak, 0.0..=5000.0)?;
        ConfigError::unless_in("reflections", reflections, 0.0..=1.0)?;
        ConfigError::unless_in("bright_spots", bright_spots, 0..=200)?;
        ConfigError::unless_in("monitors", monitors, 0..=MAX_MONITORS)?;
        ConfigError::unless_in("window_change_s", window_change_s, 0.05..=3600.0)?;
        ConfigError::unless_in("truth_hz", truth_hz, 1.0..=10_000.0)?;
        ConfigError::unless_in("glints_hz", glints_hz, 0.0..=30.0)?;
        if headband && (people == 0 || walk == WalkKind::Crowd) {
            let message =
                "found with no people, or with a crowd, expected `people = 1` or more on a round or a stage beside it";
            return Err(ConfigError::at("headband", message));
        }
        if let Some(face) = face {
            face.check()?;
            if face.part == PartKind::Knee && (walk == WalkKind::Crowd || face.source == FaceSource::Ict) {
                let message =
                    "found a knee in a `crowd` or with `source = \"ict\"`, expected the built-in one elsewhere";
                return Err(ConfigError::at("face.part", message));
            }
            if people == 0 {
                return Err(ConfigError::at("face", "found with no people, expected `people = 1` or more beside it"));
            }
        }
        let singles = [
            ("waved_light", waved_light),
            ("swing", swing.is_some()),
            ("darts", darts.is_some()),
            ("light_path", light_path.is_some()),
            ("bust", bust.is_some()),
            ("arm", arm.is_some()),
        ];
        let mut singles = singles.into_iter().filter(|it| it.1).map(|it| it.0);
        if let Some(first) = singles.next() {
            if people > 0 {
                let message = format!("found with {people} people, expected `people = 0` beside it");
                return Err(ConfigError::at(first, message));
            }
            if let Some(second) = singles.next() {
                return Err(ConfigError::at(
                    second,
                    format!(
                        "found beside `{first}`, expected one kind of light by itself, one bust or one arm, at most"
                    ),
                ));
            }
        }
        wave.check()?;
        swing.as_ref().map_or(Ok(()), SwingSettings::check)?;
        darts.as_ref().map_or(Ok(()), DartSettings::check)?;
        bust.as_ref().map_or(Ok(()), BustSettings::check)?;
        studio.as_ref().map_or(Ok(()), StudioSettings::check)?;
        arm.as_ref().map_or(Ok(()), ArmSettings::check)?;
        if let Some(body) = body {
            ConfigError::unless_in("body.unit_m", body.unit_m, 0.0..=1000.0)?;
            if body.motion == BodyMotion::Whole && walk != WalkKind::Round {
                let message = "found `whole`, whose people follow the recorded path, expected `limbs` with this `walk`";
                return Err(ConfigError::at("body.motion", message));
            }
        }
        if walk == WalkKind::Round && people > MOST_ON_A_ROUND {
            let message = format!("found {people}, expected at most {MOST_ON_A_ROUND}, or `walk = \"crowd\"`");
            return Err(ConfigError::at("people", message));
        }
        if walk == WalkKind::Stage && people > 1 {
            return Err(ConfigError::at("people", format!("found {people}, expected at most 1 on a `stage`")));
        }
        if walk == WalkKind::Crowd
            && let Err(widest) = settings.braid()
        {
            let message = format!(
                "found {closest_m} m, expected at most {widest:.2} m for {people} people in this `walk_area_m`"
            );
            return Err(ConfigError::at("closest_m", message));
        }
        let light_paths = light_path.as_ref().map_or(Ok(Vec::new()), |file| read_paths(file, setup))?;
        let (head, of_head) = settings.face.as_ref().map_or(Ok((None, None)), |it| read_head(it, setup))?;
        let (bodies, of_body) = read_bodies(&settings, setup)?;
        let truth = truth.as_ref().map(|it| Truth::draw(it, setup)).transpose()?;
        let mut cameras = None;
        if let (Some(truth), Some(folder)) = (&truth, &setup.out_dir) {
            setup.claim_file(Some("truth"), TRUTH_FILE)?;
            cameras = Some((truth.stated().to_owned(), folder.clone()));
        }
        let recordings = Recordings { light_paths, head, bodies, truth };
        let world = World::with_recordings(settings, recordings, &setup.random);
        let remarks = of_head.into_iter().chain(of_body).collect();
        Ok(Self { world, remarks, cameras, truth_hz, next: 0, pool: Pool::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = self.next_time();
        if self.next == 0 {
            io.emit_at(&WORLD, time, self.world.clone());
        }
        let mut truth = self.pool.take(Targets::default);
        self.world.truth_into(time, &mut truth);
        io.emit_at(&TRUTH, time, self.pool.share(truth));
        self.next += 1;
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(self.next_time())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.remarks.iter().for_each(|it| report.remark(it));
        let Some((cameras, folder)) = &self.cameras else { return Ok(()) };
        report.save(folder, TRUTH_FILE, cameras)
    }

    fn plan(settings: &SceneSettings) -> Plan {
        // The world is as it is: nobody changes it.
        Plan { rate_hz: Some(settings.truth_hz), reacts_after_s: f64::INFINITY, ..Plan::default() }
    }
}

/// The recorded head, if one is wanted, and what the user is to know about it.
fn read_head(face: &FaceSettings, setup: &Setup) -> Result<(Option<RecordedHead>, Option<String>), ConfigError> {
    if face.part == PartKind::Knee {
        return Ok((None, None));
    }
    let folder = match (face.source, setup.path("face.data", &face.data)) {
        (FaceSource::BuiltIn, _) => return Ok((None, None)),
        (FaceSource::Ict, folder) => folder?,
        (FaceSource::Auto, Ok(folder)) if RecordedHead::is_in(&folder) => folder,
        (FaceSource::Auto, folder) => {
            let place = folder.map_or(face.data.clone(), |it| it.display().to_string());
            let remark = format!("the actor's face is the built-in one: no recorded one in {place}");
            return Ok((None, Some(remark)));
        }
    };
    match RecordedHead::read(&folder) {
        Ok(head) => Ok((Some(head), Some("the actor's face is a recorded one: ICT Face Model Light".to_owned()))),
        Err(message) => Err(ConfigError::at("face.data", message)),
    }
}

fn read_paths(file: &str, setup: &Setup) -> Result<Vec<LightPath>, ConfigError> {
    let path = setup.path("light_path", file)?;
    let fault = |message: String| ConfigError::at("light_path", format!("{}: {message}", path.display()));
    let text = foveate_diagnostics::file::read_text(&path)
        .map_err(|error| fault(format!("{error}, expected a file of rows time_s,x_m,y_m,z_m")))?;
    LightPath::parse_all(&text).map_err(fault)
}

/// The bodies of recordings, none for the built-in one, and what is to be said of them.
fn read_bodies(scene: &SceneSettings, setup: &Setup) -> Result<(Vec<Body>, Option<String>), ConfigError> {
    const BUILT_IN: &str = "the people's bodies have the built-in walk";
    let Some(body) = scene.body.as_ref().filter(|it| it.source != BodySource::BuiltIn) else {
        return Ok((Vec::new(), None));
    };
    let is_needed = body.source == BodySource::Bvh;
    let (setting, files) = match (body.file.is_empty(), body.files.is_empty()) {
        (false, true) => ("body.file", std::slice::from_ref(&body.file)),
        (true, false) => ("body.files", body.files.as_slice()),
        (true, true) => {
            return Err(ConfigError::at("body.file", "found neither `file` nor `files`, expected one of them"));
        }
        (false, false) => return Err(ConfigError::at("body.files", "found beside `file`, expected one of them")),
    };
    let (mut bodies, mut said) = (Vec::new(), Vec::new());
    for file in files {
        let path = match setup.path(setting, file) {
            Ok(path) => path,
            Err(error) if is_needed => return Err(error),
            Err(error) => return Ok((Vec::new(), Some(format!("{BUILT_IN}: {}", error.message)))),
        };
        if !is_needed && !path.exists() {
            return Ok((Vec::new(), Some(format!("{BUILT_IN}: there is no {}", path.display()))));
        }
        let fault = |message: String| ConfigError::at(setting, format!("{}: {message}", path.display()));
        let text = foveate_diagnostics::file::read_text(&path)
            .map_err(|error| fault(format!("{error}, expected a BVH file")))?;
        let motion = SkeletonMotion::from_bvh(&text).map_err(|error| fault(error.to_string()))?;
        let mut words = path.display().to_string();
        bodies.push(match body.motion {
            BodyMotion::Limbs => Body::Limbs(Arc::new(RecordedBody::new(&motion).map_err(fault)?)),
            BodyMotion::Whole => {
                let hints = RecordingHints { unit_m: Some(body.unit_m).filter(|it| *it > 0.0), up: body.up.axis() };
                let whole = WholeBody::new(&motion, hints, scene.part_of_area_m()).map_err(fault)?;
                words += &format!(" ({})", whole.notes().join("; "));
                Body::Whole(Arc::new(whole))
            }
        });
        said.push(words);
    }
    let is_anybody = scene.people > 0 && !said.is_empty();
    Ok((bodies, is_anybody.then(|| format!("the people's bodies move as in {}", said.join(", ")))))
}

impl Lab {
    fn next_time(&self) -> Time {
        Time::from_s(self.next as f64 / self.truth_hz)
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;
    use crate::world::BodySettings;

    #[test]
    fn node_keeps_the_law() {
        check_node::<Lab>("");
        check_node::<Lab>("people = 3\nglints_hz = 1.5");
        check_node::<Lab>("people = 0\nwaved_light = true");
        check_node::<Lab>("people = 0\nwaved_light = true\nwave = { min_m = [-1, -1, 0], max_m = [1, 1, 2] }");
        check_node::<Lab>("people = 0\nswing = { amplitude_m = 0.3 }");
        check_node::<Lab>("people = 0\ndarts = { lights = 3, speed_m_s = 2 }");
        check_node::<Lab>("people = 0\nbust = { speed_m_s = 0.05 }");
        check_node::<Lab>("people = 2\nstudio = { chairs = [[0.5, 0.5, 90]], lamps = [{ from_s = 2 }] }");
        check_node::<Lab>("people = 0\narm = { cloth = \"bare\", speed = 2 }");
        check_node::<Lab>("walk = \"stage\"\nstand_s = 3");
        check_node::<Lab>("face = { marks = 40, source = \"built_in\" }");
        check_node::<Lab>("walk = \"stage\"\nface = { part = \"knee\" }");
        check_node::<Lab>("body = { file = \"a.bvh\", source = \"bvh\" }");
        check_node::<Lab>("people = 16\nwalk = \"crowd\"\nwalk_area_m = [6, 8]\nstay_s = 30");
    }

    #[test]
    fn without_recordings_the_face_is_the_built_in_one_and_the_user_learns_it() {
        let face = |data: &str| FaceSettings { data: data.to_owned(), ..FaceSettings::default() };
        for data in ["no such folder", "${NO_SUCH_VARIABLE}"] {
            let settings = SceneSettings { face: Some(face(data)), ..SceneSettings::default() };
            let mut lab = Lab::new(settings, &Setup::for_tests()).unwrap();
            let mut report = Report::default();
            lab.finish(&mut report).unwrap();
            assert!(report.remarks.iter().any(|it| it.contains("built-in one") && it.contains(data.trim_matches('$'))));
            assert!(lab.world.painted(Time::from_s(2.0)).is_some());
        }
    }

    #[test]
    fn body_without_its_file_is_the_built_in_one_and_says_so() {
        let body = |source| Some(BodySettings { file: "no_such.bvh".to_owned(), source, ..BodySettings::default() });
        let lab =
            |source| Lab::new(SceneSettings { body: body(source), ..SceneSettings::default() }, &Setup::for_tests());
        let mut report = Report::default();
        lab(BodySource::Auto).ok().unwrap().finish(&mut report).unwrap();
        assert!(report.remarks[0].contains("built-in walk: there is no ./no_such.bvh"), "{:?}", report.remarks);
        let refused = lab(BodySource::Bvh).err().unwrap();
        assert!(refused.setting.as_deref() == Some("body.file") && refused.message.contains("expected a BVH file"));
        let mut silent = Report::default();
        lab(BodySource::BuiltIn).ok().unwrap().finish(&mut silent).unwrap();
        assert!(silent.remarks.is_empty());
    }

    #[test]
    fn recorded_body_has_another_gait_at_the_same_place() {
        let file = "${FOVEATE_DATA}/s18_bvh/131_03.bvh".to_owned();
        let settings =
            SceneSettings { body: Some(BodySettings { file, ..BodySettings::default() }), ..SceneSettings::default() };
        let lab = Lab::new(settings.clone(), &Setup::for_tests()).ok().unwrap();
        if lab.remarks.iter().any(|it| it.contains("built-in")) {
            return println!("skipped: recorded_body_has_another_gait_at_the_same_place needs FOVEATE_DATA");
        }
        let built_in = World::new(SceneSettings { body: None, ..settings }, &Setup::for_tests().random);
        let mut wrists: f64 = 0.0;
        for step in 0..200 {
            let time = Time::from_s(1.0 + 0.05 * f64::from(step));
            let [found, other] = [lab.world.truth(time), built_in.truth(time)];
            let away = |led: usize| (found.list[led].position - other.list[led].position).norm();
            assert!(away(1) < 0.25, "the waist is {} m away", away(1));
            wrists = wrists.max(away(6));
        }
        assert!(wrists > 0.3, "the wrists move alike to {wrists} m");
    }

    #[test]
    fn people_of_recordings_have_their_own_sizes_and_keep_to_their_parts_of_the_area() {
        let files = ["s18_bvh/131_03.bvh", "s22_bvh_people/fair1_zombie.bvh"]
            .map(|it| format!("${{FOVEATE_DATA}}/{it}"))
            .to_vec();
        let body = BodySettings { files, motion: BodyMotion::Whole, ..BodySettings::default() };
        let settings =
            SceneSettings { people: 2, walk_area_m: [3.0, 6.0], body: Some(body), ..SceneSettings::default() };
        let lab = Lab::new(settings, &Setup::for_tests()).ok().unwrap();
        if lab.remarks.iter().any(|it| it.contains("built-in")) {
            return println!(
                "skipped: people_of_recordings_have_their_own_sizes_and_keep_to_their_parts_of_the_area needs FOVEATE_DATA"
            );
        }
        assert!(
            lab.remarks[0].contains("131_03.bvh (1.") && lab.remarks[0].contains("since no unit"),
            "{:?}",
            lab.remarks
        );
        let mut moment = crate::world::Moment::default();
        for step in 0..600 {
            lab.world.at(Time::from_s(1.0 + 0.05 * f64::from(step)), &mut moment);
            for (pose, y) in moment.poses.iter().zip([-1.5, 1.5]) {
                let away = [pose.middle.x.abs(), (pose.middle.y - y).abs()];
                assert!(away[0] <= 1.5 && away[1] <= 1.25, "{} m, of the one about y = {y} m", pose.middle);
            }
        }
    }

    #[test]
    fn values_out_of_range_are_refused_by_name() {
        let refused = |change: fn(&mut SceneSettings)| {
            let mut settings = SceneSettings::default();
            change(&mut settings);
            Lab::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting).unwrap()
        };
        assert_eq!(refused(|it| it.people = 5), "people");
        assert_eq!(refused(|it| (it.people, it.walk) = (33, WalkKind::Crowd)), "people");
        assert_eq!(refused(|it| (it.people, it.walk) = (32, WalkKind::Crowd)), "closest_m");
        assert_eq!(refused(|it| (it.people, it.walk) = (2, WalkKind::Stage)), "people");
        assert_eq!(refused(|it| (it.people, it.face) = (0, Some(FaceSettings::default()))), "face");
        assert_eq!(refused(|it| it.face = Some(FaceSettings { marks: 77, ..FaceSettings::default() })), "face.marks");
        assert_eq!(refused(|it| it.stage_m = 0.0), "stage_m");
        assert_eq!(refused(|it| it.stand_s = -1.0), "stand_s");
        assert_eq!(refused(|it| it.walk_area_m[1] = 0.0), "walk_area_m");
        assert_eq!(refused(|it| it.speed_m_s = f64::NAN), "speed_m_s");
        assert_eq!(refused(|it| it.monitors = 9), "monitors");
        assert_eq!(refused(|it| it.truth_hz = 0.0), "truth_hz");
        assert_eq!(refused(|it| it.swing = Some(SwingSettings::default())), "swing");
        assert_eq!(refused(|it| it.darts = Some(DartSettings::default())), "darts");
        let slow = |it: &mut SceneSettings| {
            it.people = 0;
            it.darts = Some(DartSettings { acceleration_m_s2: 1.0, ..DartSettings::default() });
        };
        assert_eq!(refused(slow), "darts.max_m");
        assert_eq!(refused(|it| it.wave.turns_hz = [9.0; 3]), "wave.turns_hz");
        let swung = |period_s: f64| Some(SwingSettings { period_s, ..SwingSettings::default() });
        assert_eq!(
            refused(|it| (it.people, it.waved_light, it.swing) = (0, true, Some(SwingSettings::default()))),
            "swing"
        );
        let ict = |it: &mut SceneSettings| {
            let data = "no such folder".to_owned();
            it.face = Some(FaceSettings { source: FaceSource::Ict, data, ..FaceSettings::default() });
        };
        assert_eq!(refused(ict), "face.data");
        let knee = |it: &mut SceneSettings| {
            it.walk = WalkKind::Crowd;
            it.face = Some(FaceSettings { part: PartKind::Knee, ..FaceSettings::default() });
        };
        assert_eq!(refused(knee), "face.part");
        assert_eq!(refused(|it| (it.people, it.light_path) = (0, Some("no such file".to_owned()))), "light_path");
        let body = |body: BodySettings| Some(BodySettings { source: BodySource::Bvh, ..body });
        let of_body = |body: Option<BodySettings>, walk: WalkKind| {
            let settings = SceneSettings { body, walk, ..SceneSettings::default() };
            Lab::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting).unwrap()
        };
        let [none, both] = [
            BodySettings::default(),
            BodySettings { file: "a".into(), files: vec!["b".into()], ..BodySettings::default() },
        ];
        let whole = BodySettings { file: "a".into(), motion: BodyMotion::Whole, ..BodySettings::default() };
        assert_eq!(of_body(body(none), WalkKind::Round), "body.file");
        assert_eq!(of_body(body(both), WalkKind::Round), "body.files");
        assert_eq!(of_body(body(whole.clone()), WalkKind::Stage), "body.motion");
        assert_eq!(of_body(body(BodySettings { unit_m: -1.0, ..whole }), WalkKind::Round), "body.unit_m");
        let mut settings = SceneSettings { people: 0, swing: swung(0.1), ..SceneSettings::default() };
        assert!(
            Lab::new(settings.clone(), &Setup::for_tests())
                .is_err_and(|it| it.setting.as_deref() == Some("swing.period_s"))
        );
        settings.swing = swung(1.0);
        assert!(Lab::new(settings, &Setup::for_tests()).is_ok());
    }
}
