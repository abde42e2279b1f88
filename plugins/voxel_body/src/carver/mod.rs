//! `voxel_body.carver`: carves voxels from the silhouettes of all cameras.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate::geometry::pan_tilt::Setting;
use foveate::geometry::voxels::DoubtOptions;
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::hull::{Hull, HullOptions, View, Volume};

mod words;

use words::Words;

ports! {
    SILHOUETTES: In<Silhouette> = synced("silhouettes", 4).many();
    IMAGES: In<Image> = latest("images").many().optional();
    POSES: In<HeadPose> = each("poses").many().optional();
    TARGETS: In<Targets> = latest("targets").optional();
    SPACES: In<ScaleSpace> = latest("spaces").many().optional();
    VOXELS: Out<Voxels> = "voxels";
}

figures! {
        "voxels.frames": count, neither, "Sets of silhouettes carved";
        "voxels.gaps": count, low, "Sets not carved: without a usable silhouette, or with an unknown pose of the scale";
        "voxels.nobody": count, neither, "Carved sets without a voxel";
        "voxels.cut_off": count, low, "Carved sets in which a person reaches an end of the volume, the floor excepted";
        "voxels.components_max": count, neither, "Most separate bodies at one time";
        "voxels.dropped": count, low, "Pieces left out because they are smaller than `min_component_l`, over all sets";
    "hull_l": litre, neither, "Median volume of the voxels, over sets with any";
    "hull_l.first": litre, neither, "Volume of the voxels of the first set with any";
    "completeness": share, high, "Part of the silhouettes that the voxels cover: mean over the views that carved, and over sets with voxels";
        "completeness.*": share, high, "The same of the camera's silhouettes, including those left out";
        "outside.*": share, low, "Part of the voxels' projection that is background in the camera's silhouettes, mean over sets with voxels";
    "voxels.unused.*": count, low, "Silhouettes of the camera that were left out: missing, empty where others see a person, full, moved, contradicting the others, or without a pose";
}

/// Settings of [`Carver`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CarverSettings {
    /// Edge of a voxel. [Mikić 2001] has 50 [mm]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub voxel_mm: f64,
    /// The carved volume, in the scale's space. Left out: the scale's `volume_m`, or a cube of twice its `radius_m` around the target that carries it [m]
    pub volume_m: Option<Volume>,
    /// Views that may wrongly call a voxel background. Each makes the hull larger [–]
    #[schemars(range(min = 0, max = 250))]
    pub may_err: usize,
    /// Views in whose picture a voxel has to lie; 0: all that carve. For cameras that each see a part of the volume, such as on heads, 2 or 3 [–]
    #[schemars(range(min = 0, max = 255))]
    pub min_views: usize,
    /// Part of the views that may have lost a piece of the body: where several other views show uncovered body, voxels are kept although this many views deny them. Where silhouettes fit
    /// each other nothing is added. With six views and more, up to a third may if half of the others request it. 0: none [–]
    #[schemars(range(min = 0.0, max = 0.5))]
    pub may_lose: f64,
    /// Connected pieces with a smaller volume are left out. Left out: below a litre, or below a twentieth of the largest [l]
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub min_component_l: Option<f64>,
    /// Where voxels cover less than this of the silhouettes, on average, each view is tested: without a contradicting view the others are covered better, and it is left out; with four views or
    /// more. 0: never [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_completeness: f64,
    /// Largest distance of a target from a body that it names [mm]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub target_reach_mm: f64,
    /// Smallest confidence of a pixel that may be body: a shadow, or clothes as dark as the background. Voxels that may be body in all views are kept if most views are certain, or
    /// where they are higher than shadows. 0.5: no pixel is in doubt [–]
    #[schemars(range(min = 0.02, max = 0.5))]
    pub may_be: f64,
    /// Voxels in doubt below this height are a shadow's [mm]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub shadow_height_mm: f64,
}

impl Default for CarverSettings {
    /// 20 mm, no view errs everywhere and one of five here and there, seen by all (a head has four litres), no pixel in doubt; a shadow's rims are blurred by less than 150 mm. Silhouettes that fit
    /// each other are covered to 0.97 and more.
    fn default() -> Self {
        Self {
            voxel_mm: 20.0,
            volume_m: None,
            may_err: 0,
            min_views: 0,
            may_lose: 0.2,
            min_component_l: None,
            min_completeness: 0.97,
            target_reach_mm: 200.0,
            may_be: 0.5,
            shadow_height_mm: 150.0,
        }
    }
}

/// Poses of heads that wait for their silhouettes.
const HELD_POSES: usize = 256;
/// Sets of silhouettes that wait for the poses of their heads, at most.
const MOST_WAITING: usize = 4;

/// Silhouettes that were seen at one time in; voxels out, in the scale's space.
///
/// Every camera that ever gave a silhouette has a statement in each set of voxels: what became of its view, and how much of its silhouette the voxels cover. With `images`, surface voxels have
/// the colours of the cameras that see them free. A camera on a head is where the pose of the same time at `poses` says.
pub struct Carver {
    hull: Hull,
    setup: Setup,
    spaces: Option<Spaces>,
    poses: VecDeque<Arc<HeadPose>>,
    waiting: VecDeque<Vec<Stamped<Arc<Silhouette>>>>,
    has_poses: bool,
    /// By camera that ever gave a silhouette.
    tally: BTreeMap<CameraId, CameraTally>,
    totals: Totals,
    words: Words,
    volume: Volume,
}

#[derive(Default)]
struct CameraTally {
    unused: u64,
    by_status: BTreeMap<&'static str, u64>,
    n_compared: u64,
    covered: f64,
    outside: f64,
}

#[derive(Default)]
struct Totals {
    frames: u64,
    gaps: u64,
    nobody: u64,
    cut_off: u64,
    components_max: usize,
    dropped: u64,
    litres: Vec<f64>,
    covered: f64,
    n_covered: u64,
}

impl Node for Carver {
    const TYPE: &'static str = "voxel_body.carver";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Carves voxels from the silhouettes of all cameras (visual hull)";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CarverSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CarverSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("voxel_mm", settings.voxel_mm, 0.1..=1000.0)?;
        ConfigError::unless_in("may_err", settings.may_err, 0..=250)?;
        ConfigError::unless_in("min_views", settings.min_views, 0..=255)?;
        let n_cameras = setup.calibration.cameras.len();
        for (name, found, most) in
            [("may_err", settings.may_err + 1, "fewer than"), ("min_views", settings.min_views, "no more than")]
        {
            // With a single camera nothing is carved, whatever may err.
            if n_cameras > 1 && found > n_cameras {
                let found = if name == "may_err" { settings.may_err } else { found };
                let message = format!("found {found}, expected {most} the {n_cameras} cameras of the calibration");
                return Err(ConfigError::at(name, message));
            }
        }
        ConfigError::unless_in("may_lose", settings.may_lose, 0.0..=0.5)?;
        ConfigError::unless_in("min_component_l", settings.min_component_l.unwrap_or(0.0), 0.0..=1e6)?;
        ConfigError::unless_in("min_completeness", settings.min_completeness, 0.0..=1.0)?;
        ConfigError::unless_in("may_be", settings.may_be, 0.02..=0.5)?;
        ConfigError::unless_in("shadow_height_mm", settings.shadow_height_mm, 0.0..=1e5)?;
        ConfigError::unless_in("target_reach_mm", settings.target_reach_mm, 0.0..=1e5)?;
        let around = setup.radius_m.map(|it| Volume { min: [-it; 3], max: [it; 3] });
        let of_scale = setup.volume_m.map(|[min, max]| Volume { min, max });
        let Some(volume) = settings.volume_m.or(of_scale).or(around) else {
            return Err(ConfigError::at(
                "volume_m",
                "found no volume, expected one here, `volume_m` of the scale, or `radius_m` of a scale with an anchor",
            ));
        };
        let options = HullOptions {
            size: settings.voxel_mm / 1e3,
            may_err: settings.may_err,
            min_views: settings.min_views,
            n_cameras,
            may_lose: settings.may_lose,
            min_component: settings.min_component_l.map(|it| it / 1e3),
            min_completeness: settings.min_completeness,
            target_reach: settings.target_reach_mm / 1e3,
            doubt: DoubtOptions {
                from: (settings.may_be * 255.0).round() as u8,
                height: settings.shadow_height_mm / 1e3,
            },
        };
        let hull = Hull::new(options, volume).map_err(|error| ConfigError::at("voxel_mm", error))?;
        Ok(Self {
            hull,
            spaces: Some(Spaces::new(&setup.scales)).filter(Spaces::is_moving),
            setup: setup.clone(),
            poses: VecDeque::new(),
            waiting: VecDeque::new(),
            has_poses: setup.is_connected(&POSES),
            tally: BTreeMap::new(),
            totals: Totals::default(),
            words: Words::new(settings.min_views == 0),
            volume,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(pose) = io.take(&POSES) {
            self.poses.push_back(pose.value);
            if self.poses.len() > HELD_POSES {
                self.poses.pop_front();
            }
        }
        let silhouettes: Vec<Stamped<Arc<Silhouette>>> = io.take_set(&SILHOUETTES).collect();
        if !silhouettes.is_empty() {
            self.waiting.push_back(silhouettes);
        }
        while let Some(silhouettes) = self.next_set() {
            self.carve(io, silhouettes);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let totals = &mut self.totals;
        report.figure("voxels.frames", totals.frames as f64);
        for (what, n) in
            [("gaps", totals.gaps), ("nobody", totals.nobody), ("cut_off", totals.cut_off), ("dropped", totals.dropped)]
        {
            if n > 0 {
                report.figure(format!("voxels.{what}"), n as f64);
            }
        }
        if let Some(first) = totals.litres.first().copied() {
            report.figure("voxels.components_max", totals.components_max as f64);
            report.figure("hull_l.first", first);
            totals.litres.sort_by(f64::total_cmp);
            report.figure("hull_l", totals.litres[totals.litres.len() / 2]);
        }
        let covered = (totals.n_covered > 0).then(|| totals.covered / totals.n_covered as f64);
        if let Some(covered) = covered {
            report.figure("completeness", covered);
        }
        let mut of_cameras = Vec::new();
        for (camera, tally) in &self.tally {
            let name = self.setup.calibration.cameras.get(usize::from(camera.0)).map_or("?", |it| it.name.as_str());
            if tally.n_compared > 0 {
                of_cameras.push((tally.covered / tally.n_compared as f64, name));
                report.figure(format!("completeness.{name}"), tally.covered / tally.n_compared as f64);
                report.figure(format!("outside.{name}"), tally.outside / tally.n_compared as f64);
            }
            if tally.unused > 0 {
                report.figure(format!("voxels.unused.{name}"), tally.unused as f64);
                let reasons: Vec<String> = tally.by_status.iter().map(|(why, n)| format!("{why} {n}")).collect();
                report.remark(format!("{name}: views left out: {}", reasons.join(", ")));
            }
        }
        self.words.say(&self.setup, &self.volume, covered, &of_cameras, report);
        Ok(())
    }
}

impl Carver {
    /// The next set whose poses are there, as far as they will come.
    fn next_set(&mut self) -> Option<Vec<Stamped<Arc<Silhouette>>>> {
        let set = self.waiting.front()?;
        let awaits = |it: &Stamped<Arc<Silhouette>>| {
            let camera = it.value.camera;
            let has_come = || self.poses.iter().rev().any(|pose| pose.camera == camera && pose.time >= it.time());
            self.has_poses && self.setup.head_of(camera).is_some() && !has_come()
        };
        if self.waiting.len() < MOST_WAITING && set.iter().any(awaits) {
            return None;
        }
        self.waiting.pop_front()
    }

    fn carve(&mut self, io: &mut Io<'_>, silhouettes: Vec<Stamped<Arc<Silhouette>>>) {
        let Some(time) = silhouettes.iter().map(Stamped::time).min() else { return };
        let world_from_scale = match &mut self.spaces {
            None => Isometry3::identity(),
            Some(spaces) => {
                io.latest_of_each(&SPACES).for_each(|it| spaces.learn(it.value));
                match spaces.world_from_own(time) {
                    Ok(pose) => pose.transform,
                    Err(error) => {
                        self.totals.gaps += 1;
                        io.gap(&VOXELS, time, format_args!("the scale's pose is unknown: {error}"));
                        return;
                    }
                }
            }
        };
        for it in &silhouettes {
            self.tally.entry(it.value.camera).or_default();
        }
        let pictures: Vec<Stamped<&Image>> = io.latest_of_each(&IMAGES).collect();
        let mut views: Vec<View> = silhouettes
            .iter()
            .filter_map(|it| {
                let camera = it.value.camera;
                let picture = pictures.iter().find(|of| of.value.camera == camera && of.time() == it.time());
                self.view(&it.value, picture.map(|it| it.value), it.time(), &world_from_scale)
            })
            .collect();
        views.sort_by_key(|it| it.silhouette.camera);
        views.dedup_by_key(|it| it.silhouette.camera);
        let targets = io.latest(&TARGETS).map(|it| it.value);
        let targets: Vec<_> = targets
            .into_iter()
            .flat_map(|it| it.list.iter().map(move |target| (target.id, target.position_after(time - it.time))))
            .collect();
        let mut voxels = Voxels { time, world_from_scale, ..Voxels::default() };
        let cameras: Vec<CameraId> = self.tally.keys().copied().collect();
        let result = self.hull.carve(&views, &cameras, &targets, &mut voxels);
        let seen: Vec<&Silhouette> = views.iter().map(|it| it.silhouette).collect();
        self.words.count(&seen, self.hull.contradictions(), self.hull.is_mirrored());
        match result {
            Ok(dropped) => {
                drop(views);
                self.count(&voxels, dropped.count);
                self.words.see(&voxels, &dropped);
                io.emit_at(&VOXELS, time, voxels);
            }
            Err(reason) => {
                drop(views);
                self.totals.gaps += 1;
                self.count_views(&voxels);
                io.gap(&VOXELS, time, reason);
            }
        }
    }

    /// The view of a silhouette; `None` for a camera that the calibration lacks.
    fn view<'a>(
        &self,
        silhouette: &'a Silhouette,
        picture: Option<&'a Image>,
        time: Time,
        world_from_scale: &Isometry3<f64>,
    ) -> Option<View<'a>> {
        let mut camera = self.setup.calibration.cameras.get(usize::from(silhouette.camera.0))?.camera.clone();
        let mut is_placed = true;
        if let Some(head) = self.setup.head_of(silhouette.camera) {
            let pose = self.poses.iter().rev().find(|it| it.camera == silhouette.camera && it.time == time);
            is_placed = pose.is_some();
            if let Some(pose) = pose {
                let [pan, tilt] = pose.angles;
                camera = head.model.camera_at(&Setting { pan, tilt, zoom: pose.zoom });
                camera.camera_from_world = pose.camera_from_world;
            }
        }
        camera.camera_from_world *= world_from_scale;
        Some(View { camera, silhouette, picture, is_placed })
    }

    fn count(&mut self, voxels: &Voxels, n_dropped: usize) {
        self.count_views(voxels);
        let totals = &mut self.totals;
        totals.frames += 1;
        totals.dropped += n_dropped as u64;
        totals.components_max = totals.components_max.max(voxels.components.len());
        totals.cut_off += u64::from(voxels.components.iter().any(|it| it.is_cut_off));
        if voxels.is_empty() {
            totals.nobody += 1;
            return;
        }
        totals.litres.push(voxels.volume() * 1e3);
        let used = voxels.views.iter().filter(|it| it.status == ViewStatus::Used && it.body_px > 0);
        let (n, sum) = used.fold((0, 0.0), |(n, sum), it| (n + 1, sum + it.covered));
        if n > 0 {
            totals.n_covered += 1;
            totals.covered += sum / f64::from(n);
        }
    }

    fn count_views(&mut self, voxels: &Voxels) {
        for view in &voxels.views {
            let tally = self.tally.entry(view.camera).or_default();
            let why = match view.status {
                ViewStatus::Used => None,
                ViewStatus::Missing => Some("missing"),
                ViewStatus::Learning => Some("still learning"),
                ViewStatus::Empty => Some("empty where others see a person"),
                ViewStatus::Full => Some("full"),
                ViewStatus::Moved => Some("moved"),
                ViewStatus::Contradicts => Some("contradicting the others"),
                ViewStatus::Unplaced => Some("without a pose"),
                ViewStatus::OutOfView => Some("without the volume in view"),
            };
            if let Some(why) = why {
                tally.unused += 1;
                *tally.by_status.entry(why).or_default() += 1;
            }
            if !voxels.is_empty() && view.body_px > 0 {
                tally.n_compared += 1;
                tally.covered += view.covered;
                tally.outside += view.outside;
            }
        }
    }
}

#[cfg(test)]
mod tests;
