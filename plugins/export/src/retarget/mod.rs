//! `export.retarget`: the motion of a body, or of a BVH recording, on another skeleton: a BVH rig or the skin of a GLB file [D'Apuzzo 1999 §4.3].
//!
//! ```toml
//! [scale.room.node.puppet]
//! type = "export.retarget"
//! in = { skeletons = "body.skeletons" }          # or motion = "walk.bvh"
//! rig = "puppet.glb"
//! map = { hips = "Hips", upper_arm_r = "RightArm", fore_arm_r = "RightForeArm" }
//! ```
//!
//! Names to the left are the rig's; those to the right are the motion's: of bodies those of `export.bodies` (`Hips`, `Head`, `LeftArm`, `LeftForeArm`, `LeftUpLeg`, `LeftLeg`, and the same on the right).
//! Without a map, joints of equal names are paired. A body without a torso, such as a single arm, gets a static one, upright and facing along x of its scale.

mod glb;
mod picture;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use foveate::geometry::body::{Part, SHOULDER_UP, proportions::Proportions};
use foveate::prelude::*;
use foveate::scene::skeleton::retarget::{
    RetargetError, RigJoint, RigPose, UpAxes, as_motion, followed, retarget, rig_of, suspicious_pairs, up_axes,
};
use foveate::scene::skeleton::{Axis, SkeletonMotion};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::glb::Rigged;
use crate::bodies::{Course, bvh};
use crate::csv::check_file_name;
use crate::whole_file::{Faults, WholeFile};

ports! {
    SKELETONS: In<Skeletons> = each("skeletons").optional();
}

figures! {
        "retarget.frames": count, neither, "Frames written for the rig";
        "retarget.joints": count, high, "Joints of the rig that are driven by the motion; the others keep their rest pose";
        "retarget.frames_held": count, low, "Frames in which a joint of the body is missing and keeps its last rotation";
}

/// Settings of [`ExportRetarget`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportRetargetSettings {
    /// The skeleton to animate: a BVH file, whose own motion is not read, or a GLB file with a skin [–]
    pub rig: String,
    /// A BVH file with the motion, rotated so that y is up; empty: the motion of the first body at the port `skeletons` [–]
    pub motion: String,
    /// For joints of the rig, the joint of the motion that drives each; empty: joints of equal names [–]
    pub map: BTreeMap<String, String>,
    /// File name in the results folder without its extension, which is the rig's; empty: `retargeted` [–]
    pub name: String,
    /// Whether an SVG picture of the same name, which shows how the rig moves, is written [–]
    pub picture: bool,
}

impl Default for ExportRetargetSettings {
    fn default() -> Self {
        let [rig, motion, name] = [const { String::new() }; 3];
        Self { rig, motion, map: BTreeMap::new(), name, picture: true }
    }
}

/// The animated skeleton.
enum Rig {
    Bvh(SkeletonMotion),
    Glb(Box<Rigged>),
}

/// Gathers a body, and writes its motion for another skeleton.
pub struct ExportRetarget {
    settings: ExportRetargetSettings,
    rig: Option<Rig>,
    motion: Option<SkeletonMotion>,
    file: WholeFile,
    picture: Option<WholeFile>,
    course: Course,
}

fn read(setup: &Setup, setting: &str, path: &str) -> Result<(std::path::PathBuf, Vec<u8>), ConfigError> {
    let path = setup.path(setting, path)?;
    let bytes = std::fs::read(&path);
    let bytes = bytes.map_err(|it| ConfigError::at(setting, format!("{}: {it}, expected a file", path.display())))?;
    Ok((path, bytes))
}

fn read_bvh(setup: &Setup, setting: &str, path: &str) -> Result<SkeletonMotion, ConfigError> {
    let (path, bytes) = read(setup, setting, path)?;
    SkeletonMotion::from_bvh(&String::from_utf8_lossy(&bytes))
        .map_err(|it| ConfigError::at(setting, format!("{}: {it}", path.display())))
}

impl Node for ExportRetarget {
    const TYPE: &'static str = "export.retarget";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes the motion of a body for another skeleton, a BVH or GLB rig";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportRetargetSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(mut settings: ExportRetargetSettings, setup: &Setup) -> Result<Self, ConfigError> {
        if settings.name.is_empty() {
            settings.name = "retargeted".to_owned();
        }
        let is_glb = settings.rig.to_ascii_lowercase().ends_with(".glb");
        let name = format!("{}.{}", settings.name, if is_glb { "glb" } else { "bvh" });
        check_file_name("name", &name)?;
        setup.claim_file(Some("name"), &name)?;
        let picture = format!("{}.svg", settings.name);
        if settings.picture {
            setup.claim_file(Some("picture"), &picture)?;
        }
        let picture = settings.picture.then(|| WholeFile::new(setup, &picture));
        let rig = match settings.rig.as_str() {
            "" => None,
            path if is_glb => {
                let (path, bytes) = read(setup, "rig", path)?;
                let rigged = Rigged::read(bytes);
                let rigged = rigged.map_err(|it| ConfigError::at("rig", format!("{}: {it}", path.display())))?;
                Some(Rig::Glb(Box::new(rigged)))
            }
            path => Some(Rig::Bvh(read_bvh(setup, "rig", path)?)),
        };
        let motion = match settings.motion.as_str() {
            "" => None,
            path => Some(read_bvh(setup, "motion", path)?),
        };
        if let Some(rig) = &rig {
            check(rig, motion.as_ref(), &settings)?;
        }
        Ok(Self { rig, motion, file: WholeFile::new(setup, &name), picture, settings, course: Course::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(message) = io.take(&SKELETONS) else { return Ok(()) };
        let wanted = self.course.frames.first().map(|it| it.1.id);
        let body = message.value.list.iter().find(|it| wanted.is_none_or(|id| id == it.id));
        if let Some(body) = body.filter(|_| self.motion.is_none())
            && self.course.frames.last().is_none_or(|it| it.0 < message.value.time)
        {
            let mut body = body.clone();
            add_torso(&mut body, self.course.frames.first().map(|it| &it.1));
            self.course.frames.push((message.value.time, body));
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some(rig) = &self.rig else {
            report.remark("No rig is named: nothing was written.");
            return Ok(());
        };
        let (motion, n_held) = match self.motion.take() {
            Some(motion) => (motion, 0),
            None => match bvh::motion(&self.course, 1.0) {
                Some(found) => found,
                None => {
                    report.remark("No body came: nothing was written.");
                    return Ok(());
                }
            },
        };
        report.figure("retarget.frames_held", n_held as f64);
        let joints = rig.joints();
        let map: Vec<(String, String)> = if self.settings.map.is_empty() {
            of_one_name(&joints, |it| motion.joint(it).is_some())
        } else {
            // What the body does not have, as an arm by itself has no legs, is left out, and said.
            let is_there = |it: &(&String, &String)| motion.joint(it.1).is_some() || !self.settings.motion.is_empty();
            let (there, missing): (Vec<_>, Vec<_>) = self.settings.map.iter().partition(is_there);
            for (of_rig, of_motion) in missing {
                report.remark(format!("`{of_rig}` keeps its rest pose: the body has no {of_motion}."));
            }
            there.into_iter().map(|it| (it.0.clone(), it.1.clone())).collect()
        };
        let wrong = |it: RetargetError| NodeError::input(it.to_string());
        // Bodies stand on z = 0 whatever they do; of a file only its poses say what is up.
        let is_file = !self.settings.motion.is_empty();
        let ups =
            if is_file { up_axes(&motion, &joints, &map, Axis::Y).map_err(wrong)? } else { UpAxes::both(Axis::Y) };
        if !ups.are_both(Axis::Y) {
            let (at_rest, moving) = (axis_name(&ups.rest), axis_name(&ups.moving));
            report.remark(format!(
                "The motion's {moving} points up in the motion, and {at_rest} at rest, expected y: the motion was rotated to y up."
            ));
        }
        let odd = suspicious_pairs(&motion, &joints, &map, Axis::Y, &ups).map_err(wrong)?;
        if !odd.is_empty() {
            report.remark(format!("The map may be wrong: {}.", odd.join("; ")));
        }
        let poses = retarget(&motion, &joints, &map, Axis::Y, &ups).map_err(wrong)?;
        report.figure("retarget.frames", poses.len() as f64);
        report.figure("retarget.joints", map.len() as f64);
        let bytes = match rig {
            Rig::Bvh(rig) => as_motion(rig, &poses, motion.frame_s).map_err(wrong)?.to_bvh().into_bytes(),
            Rig::Glb(rig) => rig.moved(&poses, motion.frame_s).map_err(NodeError::input)?,
        };
        let mut faults = Faults::default();
        faults.note(self.file.write(&bytes, report));
        if let Some(picture) = &self.picture {
            faults.note(picture.write(picture::svg(&joints, &poses, motion.frame_s).as_bytes(), report));
        }
        faults.end()
    }
}

impl Rig {
    fn joints(&self) -> Vec<RigJoint> {
        match self {
            Rig::Bvh(rig) => rig_of(rig),
            Rig::Glb(rig) => rig.joints.clone(),
        }
    }
}

/// Joints of a rig for which the motion has a joint of the same name.
fn of_one_name(joints: &[RigJoint], is_there: impl Fn(&str) -> bool) -> Vec<(String, String)> {
    let plain = |name: &str| name.rsplit(':').next().unwrap_or(name).to_owned();
    let names = joints.iter().map(|it| plain(&it.name));
    names.filter(|it| is_there(it)).map(|it| (it.clone(), it)).collect()
}

/// Checks a rig and a map before any motion: missing names, joints without a pair, channels that cannot hold a rotation, and for a recording all faults of its retargeting.
fn check(rig: &Rig, motion: Option<&SkeletonMotion>, settings: &ExportRetargetSettings) -> Result<(), ConfigError> {
    let joints = rig.joints();
    let names: Vec<&str> = match motion {
        Some(motion) => motion.joints.iter().map(|it| it.name.as_str()).collect(),
        None => bvh::joint_names(),
    };
    let own: Vec<(String, String)> = settings.map.iter().map(|it| (it.0.clone(), it.1.clone())).collect();
    for pair in &own {
        let setting = format!("map.{}", pair.0);
        followed(&joints, &names, std::slice::from_ref(pair)).map_err(|it| ConfigError::at(&setting, it))?;
    }
    followed(&joints, &names, &own).map_err(|it| ConfigError::at("map", it.to_string()))?;
    let is_there = |it: &str| names.iter().any(|name| name.rsplit(':').next() == Some(it));
    let map = if own.is_empty() { of_one_name(&joints, is_there) } else { own };
    if map.is_empty() {
        let of_rig: Vec<&str> = joints.iter().map(|it| it.name.as_str()).collect();
        let (of_rig, of_motion) = (of_rig.join(", "), names.join(", "));
        let what = "without a map joints of equal names are paired, but no name of the rig";
        return Err(ConfigError::at("map", format!("{what} ({of_rig}) is a name of the motion ({of_motion})")));
    }
    if let Rig::Bvh(rig) = rig {
        let rest = RigPose { root: joints[0].offset, turns: joints.iter().map(|it| it.rest).collect() };
        as_motion(rig, &[rest], 0.1).map_err(|it| ConfigError::at("rig", it.to_string()))?;
    }
    if let Some(motion) = motion {
        let found =
            up_axes(motion, &joints, &map, Axis::Y).and_then(|ups| retarget(motion, &joints, &map, Axis::Y, &ups));
        found.map_err(|it| {
            ConfigError::at(if matches!(it, RetargetError::Empty { .. }) { "motion" } else { "rig" }, it.to_string())
        })?;
    }
    Ok(())
}

fn axis_name(axis: &Vector3<f64>) -> &'static str {
    let names = [["x", "-x"], ["y", "-y"], ["z", "-z"]];
    names[axis.iamax()][usize::from(axis.sum() < 0.0)]
}

/// Gives a body without a torso a static one, where its first shoulder was at `first`.
fn add_torso(body: &mut Skeleton, first: Option<&Skeleton>) {
    let number = Part::Torso.index() as u8;
    if body.parts.iter().any(|it| it.part == number) {
        return;
    }
    if let Some(torso) = first.and_then(|it| it.parts.iter().find(|it| it.part == number)) {
        body.parts.insert(0, torso.clone());
        return;
    }
    let sizes = Proportions::default().sizes()[Part::Torso.index()];
    let shoulder = [("left-shoulder", 1.0), ("right-shoulder", -1.0)]
        .into_iter()
        .find_map(|(name, side)| Some((body.joint(name)?.position, side)));
    let Some((shoulder, side)) = shoulder else { return };
    let middle = shoulder.coords - Vector3::new(0.0, side * sizes.y, SHOULDER_UP * sizes.z);
    body.parts.insert(
        0,
        SkeletonPart {
            part: number,
            scale_from_part: Isometry3::from_parts(Translation3::from(middle), UnitQuaternion::identity()),
            sizes,
            size_sigmas: Vector3::repeat(0.1),
            provenance: Provenance::Filled,
        },
    );
}
