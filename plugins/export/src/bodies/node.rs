//! The node: writes the table during the run, and the other files at the end.

use std::fmt::Write;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Course, bvh, skin};
use crate::bvh::Unit;
use crate::csv::{check_file_name, fixed};
use crate::row_file::RowFile;
use crate::whole_file::{Faults, WholeFile};

ports! {
    SKELETONS: In<Skeletons> = each("skeletons");
}

figures! {
    "bodies.count": count, neither, "Bodies in the files, by identity";
    "bodies.rows": count, neither, "Joints in the table, over all bodies and messages";
        "bodies.bvh_frames_held": count, low, "Frames of BVH files in which a joint keeps its last rotation, over all bodies";
}

const HEADER: &str = "time_s,body,joint,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,sigma_m,provenance,limb_level,facing";

/// Settings of [`ExportBodies`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportBodiesSettings {
    /// Name of the table in the results folder [–]
    pub table: String,
    /// File name of the skinned shapes in the results folder; empty: none [–]
    pub glb: String,
    /// Prefix of the BVH files, one per body: `body` gives `body-0.bvh`; empty: none [–]
    pub bvh: String,
    /// Unit of lengths in BVH files: `cm` or `m` [–]
    pub unit: Unit,
    /// Bodies tracked for a shorter time have no BVH file [ms]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub least_ms: f64,
}

impl Default for ExportBodiesSettings {
    fn default() -> Self {
        Self {
            table: "bodies.csv".to_owned(),
            glb: "bodies.glb".to_owned(),
            bvh: "body".to_owned(),
            unit: Unit::Cm,
            least_ms: 500.0,
        }
    }
}

/// Writes skeletons.
pub struct ExportBodies {
    settings: ExportBodiesSettings,
    table: RowFile,
    whole: WholeFile,
    courses: Vec<Course>,
    text: String,
    n_rows: u64,
}

impl Node for ExportBodies {
    const TYPE: &'static str = "export.bodies";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes skeletons as a table, as BVH and as skinned meshes (GLB)";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportBodiesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportBodiesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        check_file_name("table", &settings.table)?;
        ConfigError::unless_in("least_ms", settings.least_ms, 0.0..=60_000.0)?;
        setup.claim_file(Some("table"), &settings.table)?;
        if !settings.glb.is_empty() {
            check_file_name("glb", &settings.glb)?;
            setup.claim_file(Some("glb"), &settings.glb)?;
        }
        if !settings.bvh.is_empty() {
            check_file_name("bvh", &settings.bvh)?;
            setup.claim_file(Some("bvh"), &format!("{}-0.bvh", settings.bvh))?;
        }
        Ok(Self {
            table: RowFile::new(setup, &settings.table, HEADER),
            whole: WholeFile::new(setup, &settings.glb),
            settings,
            courses: Vec::new(),
            text: String::new(),
            n_rows: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(message) = io.take(&SKELETONS) else { return Ok(()) };
        let skeletons = &*message.value;
        self.text.clear();
        for body in &skeletons.list {
            self.write_rows(skeletons.time, body);
            let place = match self.courses.binary_search_by_key(&body.id, |it| it.id) {
                Ok(place) => place,
                Err(place) => {
                    self.courses.insert(place, Course { id: body.id, frames: Vec::new() });
                    place
                }
            };
            let frames = &mut self.courses[place].frames;
            if frames.last().is_none_or(|it| it.0 < skeletons.time) {
                frames.push((skeletons.time, body.clone()));
            }
        }
        self.table.push(&self.text);
        self.table.flush_when_due(io.now());
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("bodies.count", self.courses.len() as f64);
        report.figure("bodies.rows", self.n_rows as f64);
        let mut held = 0;
        let mut faults = Faults::default();
        faults.note(self.table.finish(report));
        for course in &self.courses {
            let lasted = course.frames.first().zip(course.frames.last()).map_or(0.0, |(a, b)| (b.0 - a.0).as_s());
            if self.settings.bvh.is_empty() || lasted * 1e3 < self.settings.least_ms {
                continue;
            }
            let per_m = if self.settings.unit == Unit::Cm { 100.0 } else { 1.0 };
            let Some((motion, n_held)) = bvh::motion(course, per_m) else { continue };
            held += n_held;
            let file = self.whole.named(format!("{}-{}.bvh", self.settings.bvh, course.id));
            faults.note(file.write(motion.to_bvh().as_bytes(), report));
        }
        report.figure("bodies.bvh_frames_held", held as f64);
        if !self.settings.glb.is_empty() && self.whole.is_wanted() && !self.courses.is_empty() {
            let start = self.courses.iter().filter_map(|it| it.frames.first()).map(|it| it.0).min();
            let written = match skin::glb(&self.courses, start.unwrap_or(Time::ZERO)) {
                Ok(bytes) => self.whole.write(&bytes, report),
                Err(length) => Err(NodeError::input(format!(
                    "{}: {length} bytes, expected at most 4 GiB, the limit of a GLB file",
                    self.settings.glb
                ))),
            };
            faults.note(written);
        }
        faults.end()
    }
}

impl ExportBodies {
    fn write_rows(&mut self, time: Time, body: &Skeleton) {
        for joint in &body.joints {
            let name = joint.name();
            let limb = BODY_LIMBS.iter().position(|limb| {
                let is_arm = name.ends_with("elbow") || name.ends_with("wrist");
                let is_leg = name.ends_with("knee") || name.ends_with("ankle");
                let side = limb.split('-').next().unwrap_or_default();
                name.starts_with(side) && (is_arm && limb.ends_with("arm") || is_leg && limb.ends_with("leg"))
            });
            let level = limb.map_or("trunk", |it| match body.limbs[it] {
                LimbDetail::Absent => "absent",
                LimbDetail::Straight => "straight",
                LimbDetail::Bent => "bent",
            });
            fixed(&mut self.text, time.as_s(), 9);
            write!(self.text, ",{},{name}", body.id).ok();
            for value in joint.position.iter().chain(joint.velocity.iter()).chain([&joint.sigma()]) {
                self.text.push(',');
                fixed(&mut self.text, *value, 6);
            }
            write!(self.text, ",{},{level},", joint.provenance.name()).ok();
            fixed(&mut self.text, body.facing, 3);
            self.text.push('\n');
            self.n_rows += 1;
        }
    }
}
