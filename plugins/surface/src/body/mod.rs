//! `surface.body`: a layered body of metaballs on a skeleton that tracks points [D'Apuzzo 1999 §3–4].
//!
//! The first message starts it: joints that were clicked (`clicked`), or that another node found (`joints`), give an approximate posture; without any, each possible orientation of an arm in the
//! points is tried. For `shape_frames` messages lengths and radii are estimated, too; then they are fixed. Each message starts from the posture before, whose uncertainty grows as joints can have
//! rotated since. Points keep their places on a limb except for the sliding of skin and cloth (`slide_mm`), which determines the rotation of limbs about their own axes.
//!
//! A rejected fit is sent as no body, with the reason in `unmodelled`, and counted; the search restarts at the next message.

mod clicks;
mod message;
mod outline;
mod picture;
#[cfg(test)]
mod tests;
mod track;

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate::geometry::metaball::{self, Side, skin_patches};
use foveate::geometry::surface::TriangleMesh;
use foveate::prelude::*;
use foveate::scene::Calibration;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::outline::Outline;
use self::picture::Picture;
use self::track::{BodyTracker, Outcome, Rules};

ports! {
    TRACKED: In<TrackedSurface> = each("tracked");
    JOINTS: In<Targets> = latest("joints").optional();
    SILHOUETTES: In<Silhouette> = each("silhouettes").many().optional();
    SKELETONS: Out<Skeletons> = "skeletons";
    SKIN: Out<Mesh> = "skin";
}

figures! {
        "body.frames": count, neither, "Messages with an accepted fit of the body";
    "body.refused": count, low, "Messages whose points do not support a body";
        "body.refused.*": count, low, "Messages without a body by the first reason: points on too few limbs, off the body, an impossible size, too few points, or no start";
    "body.rms_mm.median": mm, low, "Root mean square distance of a message's points from the body's surface, outliers left out, median over messages";
        "body.outliers": share, low, "Points farther than outlier_sigmas from the surface, over all accepted messages";
        "body.limbs_unsupported": count, low, "Limbs without enough points for their posture, over all accepted messages: sent as filled";
        "body.iterations": count, low, "Iterations of the fit per message, mean over accepted messages after the shape is known";
        "body.silhouette_rays": count, neither, "Lines of sight through the borders of silhouettes used for a message, mean over all messages";
        "body.girth": ratio, neither, "Thickness of the fitted body relative to the template, geometric mean over its balls";
}

/// The fitted model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// Upper arm, forearm and hand of the right side.
    #[default]
    RightArm,
    /// The same of the left side.
    LeftArm,
    /// A whole person.
    Person,
}

impl Model {
    fn name(self) -> &'static str {
        match self {
            Model::RightArm => "right_arm",
            Model::LeftArm => "left_arm",
            Model::Person => "person",
        }
    }
}

/// The form of the equation of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Equation {
    /// The value of the field: (15) of the paper.
    #[default]
    Field,
    /// Distance from the surface, to first order.
    Distance,
}

/// Output of the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Skin {
    /// Nothing.
    #[default]
    None,
    /// The surface where the field has its threshold, in triangles of `skin_mm`.
    Isosurface,
    /// A B-spline patch over the cross-sections of each segment (§3.1).
    Patches,
}

/// A clicked joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Clicked {
    /// Name of the joint, such as `right-elbow`, as in tables of bodies [–]
    pub joint: String,
    /// Its position in the scale's space [m]
    pub at: [f64; 3],
}

/// Settings of [`BodyFitter`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BodySettings {
    /// `right_arm`, `left_arm` or `person` [–]
    pub model: Model,
    /// Approximate stature of the person, which scales lengths and thicknesses of the template [m]
    #[schemars(range(min = 0.5, max = 2.5))]
    pub height_m: f64,
    /// Metaballs on each limb: three suffice for posture, more show the shape better [–]
    #[schemars(range(min = 1, max = 12))]
    pub balls: usize,
    /// Joints at the first message, three at least for an arm; not needed for joints that the port `joints` gives [m]
    pub clicked: Vec<Clicked>,
    /// Error of clicked joints: standard deviation of their distance [mm]
    #[schemars(range(min = 1.0, max = 500.0))]
    pub clicked_mm: f64,
    /// Most points used for a fit, spread evenly over their identities: more cost time, and neighbours are nearly redundant [–]
    #[schemars(range(min = 20, max = 100000))]
    pub points: usize,
    /// Standard deviation of a person's surface, clothes included, from the best body of metaballs; added to that of points [mm]
    #[schemars(range(min = 0.1, max = 50.0))]
    pub model_mm: f64,
    /// The same at a joint between two limbs, where skin bulges and cloth wrinkles; it fades over 50 mm. Points there have less weight [mm]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub joint_mm: f64,
    /// Correlation distance of that error: nearer points count as one [mm]
    #[schemars(range(min = 1.0, max = 500.0))]
    pub independent_mm: f64,
    /// Sliding of skin and cloth over a limb: standard deviation of a tracked point's place on its limb. 0: the place on the surface is not used [mm]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub slide_mm: f64,
    /// Rate of joints: standard deviation of a change of an angle, and of the root's position with a lever of 0.3 m [rad/s]
    #[schemars(range(min = 0.1, max = 100.0))]
    pub turn_rad_s: f64,
    /// Messages in which lengths and radii are estimated; their means are used from then on [–]
    #[schemars(range(min = 1, max = 10000))]
    pub shape_frames: u32,
    /// Most lines of sight through the border of each silhouette at `silhouettes` [–]
    #[schemars(range(min = 3, max = 100000))]
    pub silhouette_rays: usize,
    /// Standard deviation of a silhouette's border [px]
    #[schemars(range(min = 0.05, max = 50.0))]
    pub silhouette_px: f64,
    /// Form of a point's equation: `field` or `distance` [–]
    pub equation: Equation,
    /// Whether shape and posture are estimated alternately, as in the paper, instead of jointly [–]
    pub in_turn: bool,
    /// Largest distance of points from the surface in standard deviations of point and model together; farther points belong to no limb [σ]
    #[schemars(range(min = 2.0, max = 50.0))]
    pub outlier_sigmas: f64,
    /// Output at the port `skin`: `none`, `isosurface` or `patches` [–]
    pub skin: Skin,
    /// Resolution of the isosurface [mm]
    #[schemars(range(min = 1.0, max = 100.0))]
    pub skin_mm: f64,
    /// Whether `body.svg` with the body over the points, at the first, the middle and the last message, is written [–]
    pub picture: bool,
}

impl Default for BodySettings {
    fn default() -> Self {
        Self {
            model: Model::RightArm,
            height_m: 1.75,
            balls: 3,
            clicked: Vec::new(),
            clicked_mm: 40.0,
            points: 500,
            model_mm: 3.0,
            joint_mm: 12.0,
            independent_mm: 30.0,
            slide_mm: 15.0,
            turn_rad_s: 6.0,
            shape_frames: 8,
            silhouette_rays: 80,
            silhouette_px: 1.0,
            equation: Equation::Field,
            in_turn: false,
            outlier_sigmas: 5.0,
            skin: Skin::None,
            skin_mm: 8.0,
            picture: true,
        }
    }
}

/// Tracked points in, a body out.
pub struct BodyFitter {
    settings: BodySettings,
    tracker: BodyTracker,
    clicked: BTreeMap<usize, Point3<f64>>,
    picture: Option<Picture>,
    out_dir: Option<std::path::PathBuf>,
    rms: Vec<f64>,
    /// By kind of reason: number of messages, and time and text of the first.
    refused: BTreeMap<&'static str, (u64, Time, String)>,
    n_points: u64,
    n_outliers: u64,
    n_unsupported: u64,
    iterations: (u64, u64),
    calibration: Arc<Calibration>,
    /// The last one of each camera.
    outlines: BTreeMap<CameraId, Outline>,
    /// Lines of sight that messages were fitted to, and messages.
    rays: (u64, u64),
    /// Messages for which joints were there of which the model has none, and the first of these joints.
    foreign: Option<(u64, usize)>,
    /// Silhouettes that came too late for the message of their moment.
    late: u64,
    last_time: Option<Time>,
}

impl Node for BodyFitter {
    const TYPE: &'static str = "surface.body";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Fits a body of metaballs on a skeleton to tracked points";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = BodySettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: BodySettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("height_m", settings.height_m, 0.5..=2.5)?;
        ConfigError::unless_in("balls", settings.balls, 1..=12)?;
        ConfigError::unless_in("clicked_mm", settings.clicked_mm, 1.0..=500.0)?;
        ConfigError::unless_in("points", settings.points, 20..=100_000)?;
        ConfigError::unless_in("model_mm", settings.model_mm, 0.1..=50.0)?;
        ConfigError::unless_in("joint_mm", settings.joint_mm, 0.0..=200.0)?;
        ConfigError::unless_in("independent_mm", settings.independent_mm, 1.0..=500.0)?;
        ConfigError::unless_in("slide_mm", settings.slide_mm, 0.0..=200.0)?;
        ConfigError::unless_in("turn_rad_s", settings.turn_rad_s, 0.1..=100.0)?;
        ConfigError::unless_in("shape_frames", settings.shape_frames, 1..=10_000)?;
        ConfigError::unless_in("silhouette_rays", settings.silhouette_rays, 3..=100_000)?;
        ConfigError::unless_in("silhouette_px", settings.silhouette_px, 0.05..=50.0)?;
        ConfigError::unless_in("outlier_sigmas", settings.outlier_sigmas, 2.0..=50.0)?;
        ConfigError::unless_in("skin_mm", settings.skin_mm, 1.0..=100.0)?;
        let mut clicked = BTreeMap::new();
        for it in &settings.clicked {
            let Some(number) = BODY_JOINTS.iter().position(|name| **name == it.joint) else {
                let expected = BODY_JOINTS.join(", ");
                return Err(ConfigError::at(
                    "clicked",
                    format!("found the joint `{}`, expected one of {expected}", it.joint),
                ));
            };
            if !it.at.iter().all(|it| it.is_finite()) {
                return Err(ConfigError::at(
                    "clicked",
                    format!("found {:?} for {}, expected numbers", it.at, it.joint),
                ));
            }
            if clicked.insert(number, Point3::from(it.at)).is_some() {
                return Err(ConfigError::at("clicked", format!("found {} twice, expected each joint once", it.joint)));
            }
        }
        if settings.picture {
            setup.claim_file(Some("picture"), "body.svg")?;
        }
        let (mut body, mut template) = match settings.model {
            Model::RightArm => metaball::arm(Side::Right, settings.height_m),
            Model::LeftArm => metaball::arm(Side::Left, settings.height_m),
            Model::Person => metaball::person(settings.height_m),
        };
        let own: Vec<&str> = (0..BODY_JOINTS.len())
            .filter(|it| message::joint_place(&body, *it).is_some())
            .map(|it| BODY_JOINTS[it])
            .collect();
        if let Some(other) = settings.clicked.iter().find(|it| !own.contains(&it.joint.as_str())) {
            let expected = own.join(", ");
            return Err(ConfigError::at(
                "clicked",
                format!("found the joint `{}`, expected one of the model's: {expected}", other.joint),
            ));
        }
        if settings.balls != 3 {
            let all = 0..body.skeleton.segments().len();
            for segment in all.filter(|it| message::is_limb(&body.skeleton, *it)).collect::<Vec<_>>() {
                (body, template) = body.refined(&template, segment, settings.balls);
            }
        }
        let rules = Rules {
            clicked_m: settings.clicked_mm * 1e-3,
            points: settings.points,
            slide_m: settings.slide_mm * 1e-3,
            turn_rad_s: settings.turn_rad_s,
            silhouette_px: settings.silhouette_px,
            shape_frames: settings.shape_frames,
            options: metaball::BodyFitOptions {
                residual: match settings.equation {
                    Equation::Field => metaball::ResidualKind::Field,
                    Equation::Distance => metaball::ResidualKind::Distance,
                },
                in_turn: settings.in_turn,
                model_sigma_m: settings.model_mm * 1e-3,
                joint_sigma_m: settings.joint_mm * 1e-3,
                independent_m: settings.independent_mm * 1e-3,
                outlier_sigmas: settings.outlier_sigmas,
                ..metaball::BodyFitOptions::default()
            },
        };
        Ok(Self {
            picture: settings.picture.then(Picture::default),
            tracker: BodyTracker::new(body, template, rules),
            settings,
            clicked,
            out_dir: setup.out_dir.clone(),
            rms: Vec::new(),
            refused: BTreeMap::new(),
            n_points: 0,
            n_outliers: 0,
            n_unsupported: 0,
            iterations: (0, 0),
            calibration: setup.calibration.clone(),
            outlines: BTreeMap::new(),
            rays: (0, 0),
            late: 0,
            last_time: None,
            foreign: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(silhouette) = io.take(&SILHOUETTES) {
            let (id, time) = (silhouette.value.camera, silhouette.time());
            let Some(named) = self.calibration.cameras.get(usize::from(id.0)) else { continue };
            self.late += u64::from(self.last_time.is_some_and(|it| it >= time));
            let outline = Outline::of(&silhouette.value, time, &named.camera, self.settings.silhouette_rays);
            self.outlines.insert(id, outline);
        }
        let Some(tracked) = io.take(&TRACKED) else { return Ok(()) };
        self.last_time = Some(tracked.value.time);
        let outlines: Vec<&Outline> = self.outlines.values().filter(|it| it.is_of(tracked.value.time)).collect();
        self.rays = (self.rays.0 + outlines.iter().map(|it| it.len() as u64).sum::<u64>(), self.rays.1 + 1);
        let mut clicks = self.clicked.clone();
        if let Some(joints) = io.latest(&JOINTS) {
            // Targets of several bodies have hundreds in front.
            let lowest = joints.value.list.iter().map(|it| it.id.0 / 100).min();
            for target in joints.value.list.iter().filter(|it| Some(it.id.0 / 100) == lowest) {
                clicks.insert((target.id.0 % 100) as usize, target.position);
            }
            let body = self.tracker.body();
            if let Some(first) =
                clicks.keys().next().filter(|_| clicks.keys().all(|it| message::joint_place(body, *it).is_none()))
            {
                self.foreign.get_or_insert((0, *first)).0 += 1;
            }
        }
        let surface = &tracked.value;
        let mut message = Skeletons { time: surface.time, list: Vec::new(), unmodelled: Vec::new() };
        match self.tracker.track(surface, &clicks, &outlines) {
            Outcome::Followed(frame) => {
                self.rms.push(frame.fit.rms_m);
                self.n_points += frame.n_points as u64;
                self.n_outliers += frame.fit.outliers as u64;
                self.n_unsupported += frame.unsupported.len() as u64;
                if !frame.is_shaping {
                    self.iterations = (self.iterations.0 + u64::from(frame.fit.iterations), self.iterations.1 + 1);
                }
                message.list.push(frame.skeleton);
                let state = &frame.fit.state;
                if let Some(picture) = &mut self.picture {
                    picture.add(surface, self.tracker.body(), state);
                }
                if let Some(mesh) = self.skin(state, surface.time) {
                    io.emit(&SKIN, tracked.stamp, mesh);
                }
            }
            Outcome::Refused { kind, reason } => {
                self.refused.entry(kind).or_insert_with(|| (0, surface.time, reason.clone())).0 += 1;
                let n = surface.list.len().max(1) as f64;
                let sum = surface.list.iter().fold(Vector3::zeros(), |sum, it| sum + it.position.coords);
                let centroid = Point3::from(sum / n);
                message.unmodelled.push(Unmodelled { centroid, volume: 0.0, target: None, reason });
            }
        }
        io.emit(&SKELETONS, tracked.stamp, message);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("body.frames", self.rms.len() as f64);
        report.figure("body.refused", self.refused.values().map(|it| it.0).sum::<u64>() as f64);
        for (kind, (n, time, reason)) in &self.refused {
            report.figure(format!("body.refused.{kind}"), *n as f64);
            report.remark(format!("no body in {n} messages, first at {:.2} s: {reason}", time.as_s()));
        }
        let rms = foveate::estimation::statistics::median(&self.rms).unwrap_or(f64::NAN);
        report.figure("body.rms_mm.median", 1e3 * rms);
        report.figure("body.outliers", self.n_outliers as f64 / self.n_points as f64);
        report.figure("body.limbs_unsupported", self.n_unsupported as f64);
        report.figure("body.iterations", self.iterations.0 as f64 / self.iterations.1 as f64);
        if self.rays.0 + self.late > 0 {
            report.figure("body.silhouette_rays", self.rays.0 as f64 / self.rays.1 as f64);
        }
        if let Some((n, first)) = self.foreign {
            let first = BODY_JOINTS.get(first).copied().unwrap_or("one without a name");
            report.remark(format!(
                "none of the joints at `joints` ({first} and so on) is of the model in {n} messages: expected those of `model = \"{}\"`; only the points are used",
                self.settings.model.name()
            ));
        }
        if self.late > 0 {
            report.remark(format!(
                "{} silhouettes came after the points of their moment and were not used: expected their node before that of the points in the rig",
                self.late
            ));
        }
        report.figure("body.girth", self.tracker.girth().unwrap_or(f64::NAN));
        let Some((picture, folder)) = self.picture.as_ref().zip(self.out_dir.as_ref()) else { return Ok(()) };
        let saved = report.save(folder, "body.svg", picture.svg(self.tracker.body()));
        saved.map_err(|it| NodeError::input(it.to_string()))
    }
}

impl BodyFitter {
    fn skin(&self, state: &metaball::State, time: Time) -> Option<Arc<Mesh>> {
        let body = self.tracker.body();
        let mesh = match self.settings.skin {
            Skin::None => return None,
            Skin::Isosurface => metaball::surface(body, state, self.settings.skin_mm * 1e-3),
            Skin::Patches => joined(skin_patches(body, state, 8, 16, 4).into_iter().map(|it| it.mesh)),
        };
        let vertices = mesh.vertices.iter().map(|it| MeshVertex {
            position: it.position.cast(),
            normal: it.normal.cast(),
            weight: 1.0,
            sigma: (self.settings.model_mm * 1e-3) as f32,
            colour: [200; 3],
        });
        Some(Arc::new(Mesh { time, ..Mesh::new(vertices, &mesh.triangles) }))
    }
}

fn joined(meshes: impl Iterator<Item = TriangleMesh>) -> TriangleMesh {
    let mut all = TriangleMesh::default();
    for mesh in meshes {
        let first = all.vertices.len() as u32;
        all.vertices.extend(mesh.vertices);
        all.triangles.extend(mesh.triangles.iter().map(|it| it.map(|corner| corner + first)));
    }
    all
}
