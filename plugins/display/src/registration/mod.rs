//! `display.registration`: the pose of a wall in a room, from a light of the room held at places of the wall, or from dots that the wall shows and the room's cameras see.

mod dots;
mod pose;
mod rests;
#[cfg(test)]
mod tests;

use std::fmt::Write as _;
use std::path::PathBuf;

use foveate::prelude::*;
use nalgebra::{Matrix3, Point2, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use dots::Dots;
use pose::{LEAST_PLACES, Touch, WallPose, fit};
use rests::Rests;

/// Places may lie this far outside of the displayed area, on the wall's frame [m].
const BESIDE_M: f64 = 0.1;
/// A place is reported as wrong when the others fit this many times better without it than without any other.
const CLEARLY: f64 = 3.0;
/// A shorter run was interrupted, which is a remark and no failure [s].
const LEAST_S: f64 = 5.0;

ports! {
    TARGETS: In<Targets> = each("targets");
    SHOWN: In<Targets> = each("shown").optional();
}

figures! {
        "registration.places": count, high, "Places of the wall at which the light was held, or dots that were seen";
    "registration.dots_left_out": count, low, "Dots seen as no light, as several, or as one that moved; missing where the wall shows none";
    "registration.touch_mm": mm, low, "Distance between these places under the fitted pose and the light's positions; root mean square";
    "registration.held_out_mm": mm, low, "The same with each place held out of the pose that it is compared with; four places or more" => "places of the wall held out of its pose";
    "registration.worst_sigma_mm": mm, low, "Largest standard deviation of a corner of the wall in the room, by the pose's covariance";
}

/// Settings of [`Registration`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegistrationSettings {
    /// Displays along rows and columns [–]
    pub tiles: [u32; 2],
    /// Width and height of the displayed area of each [m]
    pub tile_m: [f64; 2],
    /// Distance from the last pixel of a display to the first of the next, along rows and columns [mm]
    #[serde(default)]
    pub gap_mm: [f64; 2],
    /// Width and height of each display [px]
    pub size_px: [u32; 2],
    /// Places at which a light is held on the wall, in this order, x to the right and y down from its upper left corner; three or more. Left out: its corners, clockwise
    /// from the upper left [m]
    #[serde(default)]
    pub touch_m: Vec<[f64; 2]>,
    /// How accurately the light is held there, its own radius included, standard deviation along each axis [mm]
    #[schemars(range(min = 0.01, max = 1000.0))]
    #[serde(default = "default_touch_mm")]
    pub touch_mm: f64,
    /// How long it is held at each place, at least [s]
    #[schemars(range(min = 0.2, max = 60.0))]
    #[serde(default = "default_hold_s")]
    pub hold_s: f64,
    /// Largest distance of a light that is held still from its first position [mm]
    #[schemars(range(min = 0.1, max = 1000.0))]
    #[serde(default = "default_still_mm")]
    pub still_mm: f64,
    /// Where the wall shows dots (`shown`): delay after a request until the dot is certainly seen and tracked, and the one before it gone [ms]
    #[schemars(range(min = 0.0, max = 60000.0))]
    #[serde(default = "default_settle_ms")]
    pub settle_ms: f64,
    /// Largest error at the places, root mean square, held out where there are four or more; a larger error gives no pose [mm]
    #[schemars(range(min = 0.1, max = 1000.0))]
    #[serde(default = "default_limit_mm")]
    pub limit_mm: f64,
    /// File name of the pose and the tiles in the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
}

fn default_touch_mm() -> f64 {
    2.0
}

fn default_hold_s() -> f64 {
    1.0
}

fn default_still_mm() -> f64 {
    15.0
}

fn default_settle_ms() -> f64 {
    300.0
}

fn default_limit_mm() -> f64 {
    20.0
}

fn default_file() -> String {
    "wall.tiles.toml".to_owned()
}

impl RegistrationSettings {
    /// Width and height of the wall [m].
    fn size(&self) -> [f64; 2] {
        [0, 1].map(|axis| {
            let n = f64::from(self.tiles[axis]);
            n * self.tile_m[axis] + (n - 1.0) * self.gap_mm[axis] * 1e-3
        })
    }

    fn corners(&self) -> [Point2<f64>; 4] {
        let [width, height] = self.size();
        [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(Point2::from)
    }

    fn places(&self) -> Vec<Point2<f64>> {
        if self.touch_m.is_empty() {
            return self.corners().into();
        }
        self.touch_m.iter().map(|it| Point2::from(*it)).collect()
    }

    fn check(&self) -> Result<(), ConfigError> {
        for axis in 0..2 {
            ConfigError::unless_in("tiles", self.tiles[axis], 1..=64)?;
            ConfigError::unless_in("tile_m", self.tile_m[axis], 0.01..=1000.0)?;
            ConfigError::unless_in("gap_mm", self.gap_mm[axis], 0.0..=10_000.0)?;
            ConfigError::unless_in("size_px", self.size_px[axis], 1..=100_000)?;
        }
        ConfigError::unless_in("touch_mm", self.touch_mm, 0.01..=1000.0)?;
        ConfigError::unless_in("hold_s", self.hold_s, 0.2..=60.0)?;
        ConfigError::unless_in("still_mm", self.still_mm, 0.1..=1000.0)?;
        ConfigError::unless_in("settle_ms", self.settle_ms, 0.0..=60_000.0)?;
        ConfigError::unless_in("limit_mm", self.limit_mm, 0.1..=1000.0)?;
        let [width, height] = self.size();
        for (place, at) in self.touch_m.iter().enumerate() {
            let is_on = |axis: usize| (-BESIDE_M..=self.size()[axis] + BESIDE_M).contains(&at[axis]);
            if !(is_on(0) && is_on(1)) {
                let message = format!(
                    "found ({}, {}) m, expected a place of the wall, which is {width:.3} m by {height:.3} m by `tiles`, `tile_m` and `gap_mm`",
                    at[0], at[1]
                );
                return Err(ConfigError::at(&format!("touch_m[{place}]"), message));
            }
        }
        let n = self.touch_m.len();
        if n > 0 && n < LEAST_PLACES {
            let message = format!("found {n} places, expected at least {LEAST_PLACES}, or none for the corners");
            return Err(ConfigError::at("touch_m", message));
        }
        Ok(())
    }
}

/// Targets of one light in; at the end a file with the wall's pose, its covariance, and `tiles` for `display.viewer`. A single light is held at each place in turn; or, where `shown` is connected (one target at a time: the dot
/// that the wall is requested to show), the targets are the dots as the room's cameras see them.
pub struct Registration {
    settings: RegistrationSettings,
    rests: Rests,
    /// The wall's dots, where it shows some.
    dots: Option<Dots>,
    /// Centre of the scale's working volume, which is in front of the wall [m].
    before: Option<Point3<f64>>,
    span: Option<[Time; 2]>,
    /// Messages with several targets.
    crowded: u64,
    out_dir: Option<PathBuf>,
}

impl Node for Registration {
    const TYPE: &'static str = "display.registration";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Measures where a wall of displays is, from a light at its corners or from dots it shows";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = RegistrationSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: RegistrationSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        setup.claim_named_file("file", &settings.file)?;
        let middle = |[min, max]: [[f64; 3]; 2]| nalgebra::center(&Point3::from(min), &Point3::from(max));
        Ok(Self {
            dots: setup.is_connected(&SHOWN).then(Dots::default),
            settings,
            rests: Rests::default(),
            before: setup.volume_m.map(middle),
            span: None,
            crowded: 0,
            out_dir: setup.out_dir.clone().filter(|_| setup.purpose == Purpose::Run),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(shown) = io.take(&SHOWN) {
            if let Some(dots) = &mut self.dots {
                dots.show(shown.time(), &shown.value.list);
            }
        }
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        let targets = &targets.value;
        let last = self.span.map_or(Time(i64::MIN), |it| it[1]);
        // A message that comes late has no part in a rest.
        if targets.time < last {
            return Ok(());
        }
        self.span = Some([self.span.map_or(targets.time, |it| it[0]), targets.time]);
        if let Some(dots) = &mut self.dots {
            dots.see(targets, Interval::from_ms(self.settings.settle_ms));
            return Ok(());
        }
        let mut measured = targets.list.iter().filter(|it| it.provenance == Provenance::Measured);
        let (Some(it), other) = (measured.next(), measured.next()) else { return Ok(()) };
        if other.is_some() {
            self.crowded += 1;
            return Ok(());
        }
        let covariance: Matrix3<f64> = it.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let (still, hold) = (self.settings.still_mm * 1e-3, Interval::from_s(self.settings.hold_s));
        self.rests.add(targets.time, it.position, covariance, still, hold);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        if self.crowded > 0 {
            report.remark(format!(
                "{} messages had several lights and were left out, expected a single light",
                self.crowded
            ));
        }
        let lasted_s = self.span.map_or(0.0, |[first, last]| (last - first).as_s());
        let pose = match self.registered() {
            Ok(pose) => pose,
            Err(why) if lasted_s < LEAST_S => {
                report.remark(format!("the wall's pose is unknown, the run ended after {lasted_s:.1} s: {why}"));
                return Ok(());
            }
            Err(why) => return Err(NodeError::input(format_args!("the wall's pose is unknown: {why}"))),
        };
        let mm = |all: &[f64]| (all.iter().map(|it| it * it).sum::<f64>() / all.len() as f64).sqrt() * 1e3;
        report.figure("registration.places", pose.misses.len() as f64);
        if let Some(dots) = &self.dots {
            report.figure("registration.dots_left_out", dots.shown().count().saturating_sub(pose.misses.len()) as f64);
        }
        report.figure("registration.touch_mm", mm(&pose.misses));
        let error_mm = if pose.held_out.is_empty() { mm(&pose.misses) } else { mm(&pose.held_out) };
        if !pose.held_out.is_empty() {
            report.figure("registration.held_out_mm", error_mm);
        }
        let sigma = |corner: &Point2<f64>| pose.covariance_at(corner).symmetric_eigenvalues().max().max(0.0).sqrt();
        let worst = self.settings.corners().iter().map(sigma).fold(0.0, f64::max);
        report.figure("registration.worst_sigma_mm", worst * 1e3);
        if error_mm > self.settings.limit_mm {
            return Err(NodeError::input(format_args!(
                "places of the wall are {error_mm:.1} mm from the light's positions, expected at most {}: {}",
                self.settings.limit_mm,
                self.why(&pose)
            )));
        }
        let Some(folder) = &self.out_dir else { return Ok(()) };
        report.save(folder, &self.settings.file, self.text(&pose, error_mm))
    }
}

impl Registration {
    /// The pose from dots that the wall shows one at a time.
    fn by_dots(&self, dots: &Dots) -> Result<WallPose, String> {
        let touches = dots.places(self.settings.still_mm * 1e-3);
        let [width, height] = self.settings.size();
        let is_beyond = |it: &Point2<f64>| {
            !(-BESIDE_M..=width + BESIDE_M).contains(&it.x) || !(-BESIDE_M..=height + BESIDE_M).contains(&it.y)
        };
        if let Some(it) = dots.shown().find(is_beyond) {
            return Err(format!(
                "the wall shows a dot at ({:.3}, {:.3}) m from its upper left corner, expected one within {width:.3} m by {height:.3} m (`tiles`, `tile_m`, `gap_mm`)",
                it.x, it.y
            ));
        }
        if touches.len() < LEAST_PLACES {
            return Err(format!(
                "{} dots were shown and {} seen as one light without motion, expected {LEAST_PLACES} or more: do two cameras of the room see the wall, and is each dot shown for longer than `settle_ms`, {} ms?",
                dots.shown().count(),
                touches.len(),
                self.settings.settle_ms
            ));
        }
        fit(&touches)
    }

    fn registered(&mut self) -> Result<WallPose, String> {
        let pose = match &self.dots {
            Some(dots) => self.by_dots(dots)?,
            None => self.by_touches()?,
        };
        // Out of the wall is along −z.
        let out = pose.room_from_wall.rotation * -Vector3::z();
        let middle = nalgebra::center(&self.settings.corners()[0], &self.settings.corners()[2]);
        if self.before.is_some_and(|it| (it - pose.point(&middle)).dot(&out) < 0.0) {
            return Err(if self.dots.is_some() {
                "it would face away from the room's volume: what the wall shows is mirrored; expected places from its upper left corner, as seen from the front".into()
            } else {
                "it would face away from the room's volume: the places were touched in another order, as seen from behind; expected the corners clockwise from the upper left, as seen from the front".into()
            });
        }
        Ok(pose)
    }

    fn by_touches(&mut self) -> Result<WallPose, String> {
        let places = self.settings.places();
        let rests = self.rests.finish(Interval::from_s(self.settings.hold_s));
        if rests.len() != places.len() {
            let times: Vec<String> =
                rests.iter().map(|it| format!("{:.1} s to {:.1} s", it.from.as_s(), it.until.as_s())).collect();
            return Err(format!(
                "the light was held still {} times ({}), expected {}, one for each place",
                rests.len(),
                if times.is_empty() { "never".into() } else { times.join(", ") },
                places.len()
            ));
        }
        let held = Matrix3::from_diagonal_element((self.settings.touch_mm * 1e-3).powi(2));
        let touches = rests.iter().zip(&places).map(|(rest, place)| Touch {
            on_wall: *place,
            in_room: rest.point,
            covariance: rest.covariance + held,
        });
        fit(&touches.collect::<Vec<_>>())
    }

    /// Possible cause where places are far from the light's positions.
    fn why(&self, pose: &WallPose) -> String {
        let mut order: Vec<usize> = (0..pose.others.len()).collect();
        order.sort_by(|a, b| pose.others[*a].total_cmp(&pose.others[*b]));
        let limit = self.settings.limit_mm * 1e-3;
        match order[..] {
            [first, second, ..] if pose.others[first] < limit && CLEARLY * pose.others[first] < pose.others[second] => {
                let place = pose.places[first];
                format!(
                    "place {}, ({:.3}, {:.3}) m on the wall, is {:.0} mm off, and the others agree to {:.1} mm without it; was the light held there?",
                    first + 1,
                    place.x,
                    place.y,
                    pose.held_out[first] * 1e3,
                    pose.others[first] * 1e3
                )
            }
            _ => "check `tile_m`, then `gap_mm`, then `touch_m`; is the wall flat?".to_owned(),
        }
    }

    /// The file: the pose for people and programs, and the tiles for a rig.
    fn text(&self, pose: &WallPose, error_mm: f64) -> String {
        let RegistrationSettings { tiles, tile_m, gap_mm, size_px, .. } = &self.settings;
        let place = pose.room_from_wall.translation.vector;
        let turn = pose.room_from_wall.rotation.into_inner();
        let mut text = format!(
            "# From the wall's space (x to the right, y down, z into it, from its upper left corner) to the room's; `error_mm` is that at held-out places, if there were four or more.\n\
             [wall]\nposition_m = {:?}\nroom_from_wall_wxyz = {:?}\ncovariance = {:?}\nerror_mm = {error_mm:?}\n\n\
             # For `display.viewer`.\ntiles = [\n",
            place.as_slice(),
            [turn.w, turn.i, turn.j, turn.k],
            pose.covariance.as_slice(),
        );
        for row in 0..tiles[1] {
            for column in 0..tiles[0] {
                let begin = [(0, column), (1, row)]
                    .map(|(axis, number): (usize, u32)| f64::from(number) * (tile_m[axis] + gap_mm[axis] * 1e-3));
                let corner = |right: f64, down: f64| {
                    let at = pose.point(&Point2::new(begin[0] + right, begin[1] + down));
                    [at.x, at.y, at.z].map(|it| (it * 1e5).round() / 1e5)
                };
                let [width, height] = *tile_m;
                // Writing to a String cannot fail.
                let _ = writeln!(
                    text,
                    "  {{ name = \"{}-{}\", lower_left_m = {:?}, lower_right_m = {:?}, upper_left_m = {:?}, size_px = {size_px:?} }},",
                    column + 1,
                    row + 1,
                    corner(0.0, height),
                    corner(width, height),
                    corner(0.0, 0.0)
                );
            }
        }
        text + "]\n"
    }
}
