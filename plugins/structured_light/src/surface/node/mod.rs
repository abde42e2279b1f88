//! The node: clouds in the world in, clouds in the target's space and the surface out.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate::estimation::statistics::median;
use foveate::geometry::surface::{MeshOptions, RegistrationOptions, SurfacePoint};
use foveate::messages::ScaleId;
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use foveate::scene::Calibration;
use nalgebra::{Isometry3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::apart::{Apart, Beside};
use super::model::{Joined, Model, ModelOptions, Piece, motion};

mod words;

use words::{Span, named};

ports! {
    pub(super) fn declared_ports;
    CLOUD: In<PointCloud> = each("cloud").many();
    SPACES: In<ScaleSpace> = each("spaces").many().optional();
    SURFACE: Out<Mesh> = "surface";
    JOINED: Out<ScaleCloud> = "joined";
}

figures! {
    "surface.clouds": count, high, "Clouds in the surface, or in any of the surfaces where there is one a moment";
    "surface.clouds_refused": count, low, "Clouds left out: they did not fit, their shape did not determine their pose, the target's place was not known, or the surface was restarted without them";
    "surface.points": count, neither, "Points in the surface";
    "surface.points_left_out": count, low, "Points of fused clouds that were left out: without a normal, or beyond `max_memory_mb`";
    "surface.restarts": count, low, "Times that the surface was restarted without its first cloud, since that fitted none of those after it";
    "surface.voxel_mm": mm, neither, "Size of a voxel";
    "surface.vertices": count, neither, "Vertices of the last surface that was sent";
    "surface.triangles": count, neither, "Triangles of the last surface that was sent";
    "surface.sigma_mm": mm, low, "Mean standard deviation of the vertices along their normals: noise, and disagreement between points and clouds; without errors common to all of them";
    "surface.correction_mm": mm, neither, "Correction by registration of the middle of a cloud, relative to the prediction from the last one and the target's place, median over clouds";
    "surface.pose_sigma_mm": mm, low, "Stated root mean square error of a cloud's points due to its pose relative to the first cloud, median over clouds";
    "surface.place_sigma_mm": mm, low, "Stated root mean square error common to all vertices of the last surface: the pose of its last cloud, and the error common to all its points, such as that of its camera's pose";
    "surface.misfit": ratio, low, "Residuals of registered points over their sigmas, median over clouds: above 1, the clouds disagree by more than noise";
    "surface.apart_mm": mm, low, "Distance of the points of an unregistered cloud from the clouds before it, along their normals, median over points and over clouds: noise, and disagreement of poses";
    "surface.apart_sigmas": sigmas, low, "surface.apart_mm over its stated standard deviation, median over clouds: above 1, clouds disagree by more than they state";
    "surface.memory_bytes": bytes, low, "Memory of voxels and patches";
}

/// Settings of [`JoinedSurface`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceSettings {
    /// Size of a voxel; 0: twice the distance between neighbouring points of the first cloud [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub voxel_mm: f64,
    /// How far to either side of the surface distances are kept; thinner things need less, noise of more than a voxel needs more [voxels]
    #[schemars(range(min = 1.5, max = 20.0))]
    pub truncation: f64,
    /// Whether each moment gives a surface of its own, sent each time: for objects that change their shape and are seen whole at once [–]
    pub each_moment: bool,
    /// Clouds to register are gathered until they have this many points together, and registered as one [–]
    #[schemars(range(min = 1, max = 10000000))]
    pub gather_points: usize,
    /// Longest time for gathering clouds, in which the target's own track is smoother than registration would be [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub gather_ms: f64,
    /// Whether clouds are registered to the surface; `false`: they lie where their cameras and the target's place have them, as those of calibrated cameras all around a thing do, and a remark says where they contradict each other [–]
    pub register: bool,
    /// How far a cloud may be from where the last one and the target's place have it, standard deviation an axis: of the target's own turns too [mm]
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub start_sigma_mm: f64,
    /// The same of its direction [°]
    #[schemars(range(min = 0.001, max = 60.0))]
    pub start_sigma_deg: f64,
    /// Root mean square error of a cloud's points by that of its pose, at most; more: the cloud is refused. 0: half a voxel [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub max_pose_sigma_mm: f64,
    /// After how long a cloud counts 1/e of what it did; for what changes its shape, such as a face; 0: each counts for good [ms]
    #[schemars(range(min = 0.0, max = 1e9))]
    pub keep_ms: f64,
    /// Part of a cloud's points that must lie on the surface so far; less: it is refused [–]
    #[schemars(range(min = 0.01, max = 1.0))]
    pub min_overlap: f64,
    /// Residuals over what sigmas say, at most; more: the cloud is refused. Errors of decoding that noise does not explain make 3 or so [–]
    #[schemars(range(min = 0.5, max = 1000.0))]
    pub max_misfit: f64,
    /// Points around a voxel that it needs to be used [–]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub min_points: f64,
    /// Pieces of fewer triangles are left out of the surface [–]
    #[schemars(range(min = 1, max = 10000000))]
    pub min_triangles: usize,
    /// The surface is sent no more often than so, but for one that has triangles at last, or a tenth more points than the last one that was sent [ms]
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub interval_ms: f64,
    /// Memory of voxels and patches, at most; points beyond are left out and counted [MB]
    #[schemars(range(min = 1, max = 1000000))]
    pub max_memory_mb: usize,
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        Self {
            voxel_mm: 0.0,
            truncation: 4.0,
            each_moment: false,
            gather_points: 3000,
            gather_ms: 100.0,
            register: true,
            start_sigma_mm: 10.0,
            start_sigma_deg: 4.0,
            max_pose_sigma_mm: 0.0,
            keep_ms: 0.0,
            min_overlap: 0.3,
            max_misfit: 8.0,
            min_points: 0.5,
            min_triangles: 200,
            interval_ms: 500.0,
            max_memory_mb: 512,
        }
    }
}

/// A surface whose first cloud fits none of this many after it is restarted.
const DOUBTS: u32 = 4;

/// A cloud is nearly refused where its residuals are more than so much of `max_misfit` [–].
const NEARLY_REFUSED: f64 = 0.7;
/// A surface is sent at once when it has so many times the points of the last one that was sent: what is seen first may be a few stripes that do not meet, and nothing is sent once the last cloud has come [–].
const GROWN: f64 = 1.1;

/// At least so long between two poses of a space that are kept [ms].
const POSES_MS: f64 = 8.0;

/// Clouds of one thing in, its surface out. With `spaces` connected to the anchor of the node's scale, that target's motion is where registration starts; otherwise
/// the scale's space stands still, and each cloud is expected where the last one was.
pub struct JoinedSurface {
    settings: SurfaceSettings,
    calibration: Arc<Calibration>,
    spaces: Spaces,
    mesh_options: MeshOptions,
    model: Model,
    /// Gathered, with the poses of the scale's space in the world.
    waiting: VecDeque<(Stamped<Arc<PointCloud>>, Placed)>,
    learnt: BTreeMap<ScaleId, Time>,
    n_joined: u64,
    n_refused: u64,
    n_in_a_row: u32,
    /// Clouds that are in the surface.
    inside: Option<Span>,
    /// Clouds that it was restarted without, by restart.
    given_up: Vec<Span>,
    n_points: u64,
    n_left_out: u64,
    /// That of the surface, where each has one of its own.
    moment: Option<Time>,
    /// When a surface with triangles was last sent, and how many points it had.
    sent: Option<(Time, u64)>,
    last: [f64; 4],
    corrections_mm: Vec<f64>,
    pose_sigmas_mm: Vec<f64>,
    misfits: Vec<f64>,
    /// Which were nearly refused, with their misfits.
    doubtful: Vec<(String, f64)>,
    /// Where clouds lie as they are said to: how far apart, where a shape is not to change.
    apart: Option<Apart>,
    apart_mm: Vec<f64>,
    apart_sigmas: Vec<f64>,
    contradicting_mm: Vec<f64>,
    /// The cloud that lies farthest from those before it, and how.
    worst: Option<(String, Beside)>,
}

/// Where a cloud is.
#[derive(Clone, Copy)]
struct Placed {
    world_from_scale: Isometry3<f64>,
    covariance: Matrix6<f64>,
    camera_from_world: Isometry3<f64>,
}

impl Node for JoinedSurface {
    const TYPE: &'static str = "structured_light.surface";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Registers point clouds of an object that may move, and fuses them into one mesh";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SurfaceSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SurfaceSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("voxel_mm", settings.voxel_mm, 0.0..=1000.0)?;
        ConfigError::unless_in("truncation", settings.truncation, 1.5..=20.0)?;
        ConfigError::unless_in("gather_points", settings.gather_points, 1..=10_000_000)?;
        ConfigError::unless_in("gather_ms", settings.gather_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("start_sigma_mm", settings.start_sigma_mm, 0.001..=1000.0)?;
        ConfigError::unless_in("start_sigma_deg", settings.start_sigma_deg, 0.001..=60.0)?;
        ConfigError::unless_in("max_pose_sigma_mm", settings.max_pose_sigma_mm, 0.0..=1000.0)?;
        ConfigError::unless_in("keep_ms", settings.keep_ms, 0.0..=1e9)?;
        ConfigError::unless_in("min_overlap", settings.min_overlap, 0.01..=1.0)?;
        ConfigError::unless_in("max_misfit", settings.max_misfit, 0.5..=1000.0)?;
        ConfigError::unless_in("min_points", settings.min_points, 0.0..=1000.0)?;
        ConfigError::unless_in("min_triangles", settings.min_triangles, 1..=10_000_000)?;
        ConfigError::unless_in("interval_ms", settings.interval_ms, 0.0..=1e6)?;
        ConfigError::unless_in("max_memory_mb", settings.max_memory_mb, 1..=1_000_000)?;
        let spaces = Spaces::new(&setup.scales);
        if spaces.is_moving() && !setup.is_connected(&SPACES) {
            return Err(ConfigError::node(
                "the space of this scale moves, so registration needs its place; found nothing at `spaces`, expected `anchor.space` of this scale and of those around it",
            ));
        }
        let registration = RegistrationOptions {
            min_overlap: settings.min_overlap,
            max_misfit: settings.max_misfit,
            ..RegistrationOptions::default()
        };
        let model = Model::new(ModelOptions {
            voxel_m: 1e-3 * settings.voxel_mm,
            truncation: settings.truncation,
            start_sigmas: [1e-3 * settings.start_sigma_mm, settings.start_sigma_deg.to_radians()],
            max_pose_sigma_m: 1e-3 * settings.max_pose_sigma_mm,
            keep_s: 1e-3 * settings.keep_ms,
            registration: settings.register.then_some(registration),
            max_bytes: settings.max_memory_mb * 1_000_000,
        });
        Ok(Self {
            mesh_options: MeshOptions { min_points: settings.min_points, min_triangles: settings.min_triangles },
            settings,
            calibration: Arc::clone(&setup.calibration),
            spaces,
            model,
            waiting: VecDeque::new(),
            learnt: BTreeMap::new(),
            n_joined: 0,
            n_refused: 0,
            n_in_a_row: 0,
            inside: None,
            given_up: Vec::new(),
            n_points: 0,
            n_left_out: 0,
            moment: None,
            sent: None,
            last: [0.0; 4],
            corrections_mm: Vec::new(),
            pose_sigmas_mm: Vec::new(),
            misfits: Vec::new(),
            doubtful: Vec::new(),
            apart: None,
            apart_mm: Vec::new(),
            apart_sigmas: Vec::new(),
            contradicting_mm: Vec::new(),
            worst: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(space) = io.take(&SPACES) {
            self.learn(&space.value);
        }
        while let Some(cloud) = io.take(&CLOUD) {
            let is_next = self.waiting.front().is_some_and(|it| it.0.value.time != cloud.value.time);
            if self.by_moment() && is_next {
                self.join(io);
            }
            match self.placed(&cloud.value) {
                Ok(placed) => self.waiting.push_back((cloud, placed)),
                Err(why) => {
                    self.n_refused += 1;
                    io.gap(&JOINED, cloud.value.time, why);
                    continue;
                }
            }
            if self.by_moment() {
                continue;
            }
            let points: usize = self.waiting.iter().map(|it| it.0.value.len()).sum();
            let first = self.waiting.front().map_or(Time::ZERO, |it| it.0.value.time);
            let last = self.waiting.back().map_or(Time::ZERO, |it| it.0.value.time);
            if points >= self.settings.gather_points || (last - first).as_s() * 1e3 >= self.settings.gather_ms {
                self.join(io);
            }
        }
        if self.by_moment() {
            self.join(io);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let waiting = self.waiting.len();
        if waiting > 0 {
            let n = self.settings.gather_points;
            report.remark(format!("the last {waiting} clouds are not in the surface: they have fewer than `gather_points = {n}` points together; a smaller number includes them"));
        }
        if let Some(remark) = self.begun_anew() {
            report.remark(remark);
        }
        for remark in self.contradicting().into_iter().chain(self.nearly_refused()) {
            report.remark(remark);
        }
        report.figure("surface.clouds", self.n_joined as f64);
        report.figure("surface.clouds_refused", self.n_refused as f64);
        report.figure("surface.points", self.n_points as f64);
        report.figure("surface.points_left_out", self.n_left_out as f64);
        report.figure("surface.restarts", self.given_up.len() as f64);
        report.figure("surface.voxel_mm", 1e3 * self.model.voxel_m());
        report.figure("surface.memory_bytes", self.model.bytes() as f64);
        let [vertices, triangles, sigma, place_sigma] = self.last;
        report.figure("surface.vertices", vertices);
        report.figure("surface.triangles", triangles);
        if vertices > 0.0 {
            report.figure("surface.sigma_mm", 1e3 * sigma);
            report.figure("surface.place_sigma_mm", 1e3 * place_sigma);
        }
        for (name, list) in [
            ("surface.correction_mm", &self.corrections_mm),
            ("surface.pose_sigma_mm", &self.pose_sigmas_mm),
            ("surface.misfit", &self.misfits),
            ("surface.apart_mm", &self.apart_mm),
            ("surface.apart_sigmas", &self.apart_sigmas),
        ] {
            if let Some(middle) = median(list) {
                report.figure(name, middle);
            }
        }
        Ok(())
    }
}

impl JoinedSurface {
    /// Whether clouds are taken in as they come, those of a moment together: what is not registered needs no company.
    fn by_moment(&self) -> bool {
        self.settings.each_moment || !self.settings.register
    }

    /// Whether clouds that lie apart contradict each other: those that are registered do not, and a shape that changes may.
    fn lies_as_said(&self) -> bool {
        !self.settings.register && self.settings.keep_ms == 0.0
    }

    /// Holds clouds against those before them. Points of cloud i end before `ends[i]`.
    fn hold_apart(&mut self, clouds: &[(Stamped<Arc<PointCloud>>, Placed)], points: &[SurfacePoint], ends: &[usize]) {
        // Beside what `max_memory_mb` bounds, a tenth of it.
        let max_patches = 1000 * self.settings.max_memory_mb;
        let voxel_m = self.model.voxel_m();
        let mut from = 0;
        for ((cloud, placed), end) in clouds.iter().zip(ends) {
            let points = &points[from..*end];
            from = *end;
            let sum: Vector3<f64> = points.iter().map(|it| it.position.coords).sum();
            let middle = sum / points.len().max(1) as f64;
            let motion = motion(&placed.covariance, points.iter().map(|it| it.position - middle));
            let variance = Some(motion * motion / 3.0).filter(|it| it.is_finite()).unwrap_or(0.0);
            let apart = self.apart.get_or_insert_with(|| Apart::new(voxel_m, max_patches));
            let Some(beside) = apart.add(points, variance) else { continue };
            self.apart_mm.push(1e3 * beside.distance_m);
            self.apart_sigmas.push(beside.distance_m / beside.stated_m);
            if beside.contradicts {
                self.contradicting_mm.push(1e3 * beside.distance_m);
                if self.worst.as_ref().is_none_or(|it| it.1.distance_m < beside.distance_m) {
                    self.worst = Some((named(&cloud.value), beside));
                }
            }
        }
    }

    /// Poses of spaces are kept by number, and asynchronous cameras make many: some of them reach as far back as clouds come late.
    fn learn(&mut self, space: &ScaleSpace) {
        let is_soon = self.learnt.get(&space.scale).is_some_and(|it| (space.time - *it) < Interval::from_ms(POSES_MS));
        if space.target.is_none() || !is_soon {
            self.learnt.insert(space.scale, space.time);
            self.spaces.learn(space);
        }
    }

    /// Where the scale's space and the camera were.
    fn placed(&self, cloud: &PointCloud) -> Result<Placed, String> {
        let pose = self.spaces.world_from_own(cloud.time);
        let pose = pose.map_err(|why| format!("{}: the target's place is not known: {why}", cloud.name))?;
        let camera = self.calibration.cameras.get(usize::from(cloud.camera.0));
        let camera_from_world = match (cloud.viewpoint, camera) {
            (Some(viewpoint), _) => viewpoint.camera_from_space,
            (None, Some(camera)) => camera.camera.camera_from_world,
            (None, None) => {
                return Err(format!(
                    "{}: found no place of its camera, expected one with the cloud or in the calibration",
                    cloud.name
                ));
            }
        };
        Ok(Placed { world_from_scale: pose.transform, covariance: pose.covariance, camera_from_world })
    }

    /// Takes in what waits.
    fn join(&mut self, io: &mut Io<'_>) {
        let clouds: Vec<_> = self.waiting.drain(..).collect();
        let Some((last, placed)) = clouds.last().map(|it| (it.0.clone(), it.1)) else { return };
        let n = clouds.len() as u64;
        if self.settings.each_moment && self.moment.replace(last.value.time) != Some(last.value.time) {
            self.model.clear();
            self.apart = None;
        }
        let mut piece = Piece { time_s: last.value.time.as_s(), ..Piece::default() };
        let mut ends = Vec::new();
        for (cloud, placed) in &clouds {
            let back = placed.world_from_scale.inverse();
            let turn = back.rotation.to_rotation_matrix().into_inner();
            piece.points.extend(cloud.value.iter().map(|it| {
                let covariance = turn * it.covariance.cast::<f64>() * turn.transpose();
                let normal = back.rotation * it.normal.cast::<f64>();
                (SurfacePoint { position: back * it.position.cast::<f64>(), covariance, normal }, it.colour)
            }));
            ends.push(piece.points.len());
            piece.viewpoint = back * placed.camera_from_world.inverse() * Point3::origin();
        }
        let n_points = piece.points.len();
        let lying: Vec<SurfacePoint> =
            if self.lies_as_said() { piece.points.iter().map(|it| it.0).collect() } else { Vec::new() };
        let is_doubted = self.settings.register && self.n_in_a_row >= DOUBTS && self.model.n_pieces() == 1;
        if is_doubted && n_points >= self.model.min_points() {
            self.begin_anew();
        }
        let joined = match self.model.join(piece, &placed.covariance) {
            Ok(joined) => joined,
            Err(why) => {
                self.n_refused += n;
                self.n_in_a_row += 1;
                let also = if n > 1 { format!(" with {} more", n - 1) } else { String::new() };
                let name = match last.value.name.as_str() {
                    "" => "a cloud",
                    name => name,
                };
                io.gap(&JOINED, last.value.time, format!("{name}{also}: not joined: {why}"));
                return;
            }
        };
        self.n_in_a_row = 0;
        self.n_joined += n;
        Span::extend(&mut self.inside, &clouds);
        self.n_points += joined.n_fused as u64;
        self.n_left_out += (n_points - joined.n_fused) as u64;
        self.note(&joined, &last.value);
        if self.lies_as_said() {
            self.hold_apart(&clouds, &lying, &ends);
        }
        for (cloud, placed) in &clouds {
            io.emit(&JOINED, cloud.stamp, moved(&cloud.value, placed, &joined));
        }
        let time = last.value.time;
        let is_due = self.settings.each_moment
            || self.sent.is_none_or(|(when, n_points)| {
                let is_more_of_it = self.by_moment() && time == when;
                let has_grown = self.n_points as f64 >= GROWN * n_points as f64;
                is_more_of_it || has_grown || (time - when).as_s() * 1e3 >= self.settings.interval_ms
            });
        if is_due {
            let mesh = self.mesh(time, &(placed.world_from_scale * joined.surface_from_cloud.inverse()), &joined);
            if mesh.triangles().next().is_some() {
                self.sent = Some((time, self.n_points));
            }
            io.emit(&SURFACE, last.stamp, mesh);
        }
    }

    /// Forgets the surface, for the next cloud to begin it.
    fn begin_anew(&mut self) {
        self.model.clear();
        self.given_up.extend(self.inside.take());
        self.n_refused += self.n_joined;
        (self.n_joined, self.n_points, self.n_left_out, self.n_in_a_row) = (0, 0, 0, 0);
        self.sent = None;
    }

    fn note(&mut self, joined: &Joined, cloud: &PointCloud) {
        let Some(found) = &joined.registration else { return };
        self.pose_sigmas_mm.push(1e3 * joined.sigma);
        self.misfits.push(found.misfit);
        // Residuals of a shape that changes are of that, too.
        if self.settings.keep_ms == 0.0 && found.misfit > NEARLY_REFUSED * self.settings.max_misfit {
            self.doubtful.push((named(cloud), found.misfit));
        }
        self.corrections_mm.push(1e3 * found.moved);
    }

    fn mesh(&mut self, time: Time, world_from_mesh: &Isometry3<f64>, joined: &Joined) -> Mesh {
        let mut covariance = joined.covariance;
        let mut shift = covariance.fixed_view_mut::<3, 3>(3, 3);
        shift += joined.shared;
        let surface = self.model.mesh(&self.mesh_options);
        let least = self.apart.as_ref().map(Apart::least_sigma);
        let least = |it: &Point3<f64>| least.as_ref().map_or(0.0, |least| least(it));
        let vertices = surface.vertices.iter().map(|it| MeshVertex {
            position: it.position.cast(),
            normal: it.normal.cast(),
            weight: it.n_points as f32,
            sigma: it.sigma.max(least(&it.position)) as f32,
            colour: it.colour,
        });
        let mesh = Mesh {
            time,
            n_clouds: self.n_joined as u32,
            world_from_mesh: *world_from_mesh,
            covariance,
            ..Mesh::new(vertices, &surface.triangles)
        };
        let place_sigma = motion(&covariance, surface.vertices.iter().map(|it| it.position));
        self.last = [surface.vertices.len() as f64, surface.triangles.len() as f64, mesh.mean_sigma, place_sigma];
        mesh
    }
}

/// A cloud where it lies on the surface.
fn moved(cloud: &PointCloud, placed: &Placed, joined: &Joined) -> ScaleCloud {
    let world_from_surface = placed.world_from_scale * joined.surface_from_cloud.inverse();
    let surface_from_world = world_from_surface.inverse();
    let turn = surface_from_world.rotation.to_rotation_matrix().into_inner();
    let viewpoint = Some(Viewpoint { camera_from_space: placed.camera_from_world * world_from_surface });
    let mut there = PointCloud { points: Vec::with_capacity(cloud.points.len()), viewpoint, ..PointCloud::default() };
    for point in cloud.iter() {
        there.push(&CloudPoint {
            position: (surface_from_world * point.position.cast::<f64>()).cast(),
            covariance: (turn * point.covariance.cast::<f64>() * turn.transpose()).cast(),
            normal: (surface_from_world.rotation * point.normal.cast::<f64>()).cast(),
            ..point
        });
    }
    let PointCloud { points, mean_sigma, viewpoint, .. } = there;
    let (name, camera_size) = (cloud.name.clone(), cloud.camera_size);
    let cloud = PointCloud { time: cloud.time, camera: cloud.camera, name, camera_size, viewpoint, mean_sigma, points };
    ScaleCloud { cloud, world_from_scale: world_from_surface, covariance: joined.covariance }
}
