//! Skin that is soft: it swings after what carries it, slides over what lies below, and bulges where it is pushed together.
//!
//! Nothing here is linear in the modes that a surface has, and none of it follows from the shape of one moment:
//!
//! | here | after |
//! |---|---|
//! | swings | a mass on a damped spring at each point, whose base is carried: x̂ = g ∗ x with ĝ(s) = (2ζω s + ω²) / (s² + 2ζω s + ω²), of place and turn of the parts and of the weights of all modes |
//! | sags | by g/ω² against the shape at rest, which is that of an upright person |
//! | is dragged | skin of the jaw by that of the neck, when the head turns on the trunk |
//! | slides | what pulls along the skin meets friction: of a pull of t there is t² / (t + t₀) left; into the bone goes half of what goes outwards |
//! | bulges | its volume stays: a layer of thickness h over an area that is J times as large as at rest is h / J thick |
//!
//! All is a pure function of time: g is sampled at fixed delays.

use std::f64::consts::TAU;

use foveate_node::ConfigError;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::head::{bell, smooth};
use super::surface::{Material, Surface};

/// Standard gravity [m/s²].
const GRAVITY: f64 = 9.806_65;
/// Samples of g in each period of the swing.
const SAMPLES: f64 = 8.0;
/// What is left of a swing where its past ends [–].
const ENDS: f64 = 0.01;
/// A larger step between two samples is a jump: a recording began again [m].
const LEAP_M: f64 = 0.5;
/// How much a layer may be pushed together or stretched before it is as hard as bone, by area [–].
const AREAS: [f64; 2] = [0.6, 1.6];

/// How soft the skin of a painted part is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SoftSettings {
    /// How much of what carries it soft skin follows late; 1: cheeks by 0.6, calves by 0.4 of it, a forehead by 0.06 [–].
    #[schemars(range(min = 0.0, max = 1.5))]
    pub amount: f64,
    /// Frequency at which it swings [Hz].
    #[schemars(range(min = 1.0, max = 30.0))]
    pub frequency_hz: f64,
    /// Damping of that swing, as a part of the critical damping [–].
    #[schemars(range(min = 0.1, max = 0.95))]
    pub damping: f64,
    /// Friction of skin on what lies below: of a pull of so much along the skin half is left [mm].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub friction_mm: f64,
    /// Thickness of the layer that keeps its volume, where it is softest [mm].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub thickness_mm: f64,
    /// How much of the way that a turned head's jaw goes past the neck the skin there stays behind [–].
    #[schemars(range(min = 0.0, max = 0.5))]
    pub drag: f64,
}

impl Default for SoftSettings {
    fn default() -> Self {
        Self { amount: 1.0, frequency_hz: 5.0, damping: 0.3, friction_mm: 0.3, thickness_mm: 4.0, drag: 0.06 }
    }
}

impl SoftSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("face.soft.amount", self.amount, 0.0..=1.5)?;
        ConfigError::unless_in("face.soft.frequency_hz", self.frequency_hz, 1.0..=30.0)?;
        ConfigError::unless_in("face.soft.damping", self.damping, 0.1..=0.95)?;
        ConfigError::unless_in("face.soft.friction_mm", self.friction_mm, 0.0..=10.0)?;
        ConfigError::unless_in("face.soft.thickness_mm", self.thickness_mm, 0.0..=20.0)?;
        ConfigError::unless_in("face.soft.drag", self.drag, 0.0..=0.5)
    }
}

/// What carries a surface at one time: weights of its modes, the part, and what a share of it follows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Carried {
    pub weights: Vec<f64>,
    pub world_from_part: Isometry3<f64>,
    pub world_from_next: Isometry3<f64>,
}

/// How the skin of one surface is soft.
pub(super) struct Soft {
    settings: SoftSettings,
    /// Delay [s] and share of each sample of g; shares add up to 1.
    kernel: Vec<[f64; 2]>,
    /// Of each vertex: how much of the swing it shows, and of the drag.
    softness: Vec<[f64; 2]>,
    /// Area of the triangles around each vertex, at rest [m²].
    areas: Vec<f64>,
}

impl Soft {
    /// Of a head's surface; `as_built_in` takes its points to those of the built-in head [mm].
    pub fn head(settings: &SoftSettings, surface: &Surface, as_built_in: impl Fn(&Point3<f64>) -> Point3<f64>) -> Self {
        let mut soft = Self::of(settings, surface, |p| {
            let p = as_built_in(p);
            let side = p.y.abs();
            let cheek = bell(side - 44.0, 17.0) * bell(p.z + 32.0, 26.0);
            let jowl = bell(side - 34.0, 20.0) * bell(p.z + 80.0, 20.0);
            let chin = 0.6 * bell(side, 16.0) * bell(p.z + 97.0, 16.0);
            let lids = bell(side - 31.0, 13.0) * bell(p.z - 20.0, 12.0);
            let ahead = smooth((p.x - 5.0) / 30.0);
            let is_skin = smooth((p.z + 124.0) / 10.0) * smooth((88.0 - p.z) / 20.0);
            let soft = 0.06 + 0.54 * cheek.max(jowl).max(chin);
            let jaw = smooth((-66.0 - p.z) / 34.0);
            [soft * (1.0 - lids), jaw].map(|it| it * ahead * is_skin)
        });
        // Eyes and the inside of the mouth are no skin.
        let hard = surface.triangles.iter().filter(|it| it.material != Material::Skin).flat_map(|it| it.corners);
        hard.for_each(|it| soft.softness[it as usize] = [0.0; 2]);
        soft
    }

    /// Of the piece of leg around a knee: flesh of thigh and calf is soft, what lies on the kneecap and the shin is not.
    pub fn knee(settings: &SoftSettings, surface: &Surface) -> Self {
        Self::of(settings, surface, |p| {
            let p = p * 1e3;
            let thigh = 0.25 * smooth((p.z - 20.0) / 60.0);
            let calf = smooth((-30.0 - p.z) / 60.0) * (0.12 + 0.28 * smooth(-p.x / 30.0));
            // Where shorts and a sock hold it.
            let bare = smooth((175.0 - p.z) / 40.0) * smooth((p.z + 180.0) / 30.0);
            [(0.06 + thigh + calf) * bare, 0.0]
        })
    }

    fn of(settings: &SoftSettings, surface: &Surface, at: impl Fn(&Point3<f64>) -> [f64; 2]) -> Self {
        let scaled = |[soft, dragged]: [f64; 2]| [soft * settings.amount, dragged * settings.drag];
        Self {
            kernel: kernel(settings.frequency_hz, settings.damping),
            softness: surface.rest.iter().map(|it| scaled(at(it))).collect(),
            areas: around(surface, &surface.rest),
            settings: settings.clone(),
        }
    }

    /// The vertices at `time_s`, which `now` carries and `earlier` carried; `hard` are those of skin that is not soft [m].
    pub fn settle(
        &self,
        surface: &Surface,
        now: &Carried,
        hard: &[Point3<f64>],
        time_s: f64,
        earlier: impl Fn(f64) -> Carried,
    ) -> Vec<Point3<f64>> {
        let late = self.late(surface, now, time_s, earlier);
        let normals = surface.normals(hard);
        // Against somebody upright.
        let turn = now.world_from_part.rotation;
        let sag = (turn * Vector3::z() - Vector3::z()) * (GRAVITY / (TAU * self.settings.frequency_hz).powi(2));
        let friction = self.settings.friction_mm * 1e-3;
        let slid = |(i, (here, late)): (usize, (&Point3<f64>, &Point3<f64>))| {
            let [soft, dragged] = self.softness[i];
            let with_next = now.world_from_next * surface.rest[i] - now.world_from_part * surface.rest[i];
            let pull = (late - here + sag) * soft + with_next * (dragged * (1.0 - surface.follow[i]));
            let normal = normals[i].cast::<f64>();
            let out = pull.dot(&normal);
            let along = pull - normal * out;
            let length = along.norm();
            let sliding = length / (length + friction).max(1e-12);
            here + along * sliding + normal * if out > 0.0 { out } else { 0.5 * out }
        };
        let mut vertices: Vec<Point3<f64>> = hard.iter().zip(&late).enumerate().map(slid).collect();
        let areas = around(surface, &vertices);
        let layer = self.settings.thickness_mm * 1e-3;
        for (i, vertex) in vertices.iter_mut().enumerate() {
            let ratio = (areas[i] / self.areas[i].max(1e-12)).clamp(AREAS[0], AREAS[1]);
            let share = (self.softness[i][0] / 0.3).min(1.0);
            *vertex += normals[i].cast::<f64>() * (layer * share * (1.0 / ratio - 1.0));
        }
        vertices
    }

    /// Where the vertices would be of skin that swings freely: g ∗ x.
    fn late(
        &self,
        surface: &Surface,
        now: &Carried,
        time_s: f64,
        earlier: impl Fn(f64) -> Carried,
    ) -> Vec<Point3<f64>> {
        let mut frames = [(Matrix3::zeros(), Vector3::zeros()); 2];
        let mut weights = vec![0.0; now.weights.len()];
        let mut before = now.clone();
        for [delay_s, share] in &self.kernel {
            let then = earlier(time_s - delay_s);
            let way = |a: &Isometry3<f64>, b: &Isometry3<f64>| (a.translation.vector - b.translation.vector).norm();
            if way(&then.world_from_part, &before.world_from_part) < LEAP_M {
                before = then;
            }
            for ((turn, place), frame) in frames.iter_mut().zip([&before.world_from_part, &before.world_from_next]) {
                *turn += frame.rotation.to_rotation_matrix().matrix() * *share;
                *place += frame.translation.vector * *share;
            }
            weights.iter_mut().zip(&before.weights).for_each(|(sum, weight)| *sum += weight * share);
        }
        let [part, next] = frames;
        let mut vertices = surface.shaped(&weights);
        for (vertex, &follow) in vertices.iter_mut().zip(&surface.follow) {
            let with_part = part.0 * *vertex + part.1;
            *vertex = with_part + (next.0 * *vertex + next.1 - with_part) * follow;
        }
        vertices
    }
}

/// Delays [s] and shares of g, the answer of a mass on a damped spring to where its base is: e^(−ζωτ) (2ζω cos ω_d τ + (ω² − 2ζ²ω²) / ω_d · sin ω_d τ).
fn kernel(frequency_hz: f64, damping: f64) -> Vec<[f64; 2]> {
    let omega = TAU * frequency_hz;
    let (decay, swing) = (damping * omega, omega * (1.0 - damping * damping).sqrt());
    let step = 1.0 / (SAMPLES * frequency_hz);
    let n = (-ENDS.ln() / decay / step).ceil() as usize;
    let answer = |delay: f64| {
        let sine = (omega * omega - 2.0 * decay * decay) / swing * (swing * delay).sin();
        (-decay * delay).exp() * (2.0 * decay * (swing * delay).cos() + sine)
    };
    let delays = (0..n).map(|it| (it as f64 + 0.5) * step);
    let sum: f64 = delays.clone().map(answer).sum();
    delays.map(|it| [it, answer(it) / sum]).collect()
}

/// Area of the triangles around each vertex, and around its neighbours: the surroundings of a point of skin are not those of one corner [m²].
fn around(surface: &Surface, vertices: &[Point3<f64>]) -> Vec<f64> {
    let mut areas = vec![0.0; vertices.len()];
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.corners.map(|it| vertices[it as usize]);
        let area = 0.5 * (b - a).cross(&(c - a)).norm();
        triangle.corners.iter().for_each(|it| areas[*it as usize] += area);
    }
    let mut wider = vec![0.0; vertices.len()];
    for triangle in &surface.triangles {
        let sum: f64 = triangle.corners.iter().map(|it| areas[*it as usize]).sum();
        triangle.corners.iter().for_each(|it| wider[*it as usize] += sum);
    }
    wider
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_messages::Time;

    use super::*;
    use crate::painted::{FaceSettings, FaceSource, Painted, PartKind};
    use crate::world::{SceneSettings, WalkKind, World};

    fn world(part: PartKind, soft: Option<SoftSettings>) -> World {
        let settings = SceneSettings {
            walk: WalkKind::Stage,
            stand_s: 6.0,
            people_enter_s: 0.0,
            face: Some(FaceSettings { part, soft, source: FaceSource::BuiltIn, ..FaceSettings::default() }),
            ..SceneSettings::default()
        };
        World::new(settings, &Random::new(3))
    }

    fn in_part(world: &World, time_s: f64) -> Vec<Point3<f64>> {
        let Painted { marks, world_from_part, .. } = world.painted(Time::from_s(time_s)).unwrap();
        marks.iter().map(|it| world_from_part.inverse_transform_point(it)).collect()
    }

    /// By how much soft skin differs from hard skin: of each mark, over a walk [mm].
    fn moved(part: PartKind, soft: SoftSettings) -> Vec<Vec<f64>> {
        let [hard, soft] = [None, Some(soft)].map(|it| world(part, it));
        let times = (0..160).map(|it| 9.0 + f64::from(it) * 0.05);
        let by = times.map(|time_s| {
            let places = [&hard, &soft].map(|it| in_part(it, time_s));
            places[0].iter().zip(&places[1]).map(|(a, b)| (a - b).norm() * 1e3).collect()
        });
        by.collect()
    }

    #[test]
    fn cheeks_move_by_millimetres_and_foreheads_hardly() {
        let moved = moved(PartKind::Face, SoftSettings::default());
        let of = |mark: usize| {
            let mut by: Vec<f64> = moved.iter().map(|it| it[mark]).collect();
            by.sort_by(f64::total_cmp);
            [by[by.len() / 2], by[by.len() * 95 / 100]]
        };
        let all: Vec<[f64; 2]> = (0..moved[0].len()).map(of).collect();
        let most = all.iter().map(|it| it[1]).fold(0.0, f64::max);
        let least = all.iter().map(|it| it[1]).fold(f64::INFINITY, f64::min);
        assert!((1.0..5.0).contains(&most) && least < 0.4, "{least} to {most} mm");
    }

    #[test]
    fn flesh_about_a_knee_moves_and_the_kneecap_hardly() {
        let moved = moved(PartKind::Knee, SoftSettings::default());
        let most: Vec<f64> = (0..45).map(|mark| moved.iter().map(|it| it[mark]).fold(0.0, f64::max)).collect();
        let [soft, hard] =
            [most.iter().copied().fold(0.0, f64::max), most.iter().copied().fold(f64::INFINITY, f64::min)];
        assert!((2.0..9.0).contains(&soft) && hard < 1.5, "{hard} to {soft} mm");
    }

    #[test]
    fn who_does_not_move_is_shaped_as_hard_skin_is_but_for_bulges() {
        let surface = crate::painted::head::head().0;
        let soft = Soft::head(&SoftSettings { thickness_mm: 0.0, ..SoftSettings::default() }, &surface, |p| p * 1e3);
        let stands = Isometry3::translation(0.4, -0.2, 1.7);
        let weights: Vec<f64> = surface.modes.iter().map(|_| 0.3).collect();
        let now = Carried { weights, world_from_part: stands, world_from_next: stands };
        let hard = surface.deform(&now.weights, &stands, &stands);
        let settled = soft.settle(&surface, &now, &hard, 5.0, |_| now.clone());
        let most = hard.iter().zip(&settled).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(most < 1e-9, "{most} m");
    }

    #[test]
    fn a_swing_answers_as_a_mass_on_a_spring_does() {
        // To a base that swings at f: |(2ζr i + 1) / (1 − r² + 2ζr i)| with r = f / f₀.
        let kernel = kernel(5.0, 0.3);
        for ratio in [0.2, 0.5, 1.0] {
            let sums = kernel.iter().fold([0.0; 2], |[re, im], [delay, share]| {
                let phase = TAU * 5.0 * ratio * delay;
                [re + share * phase.cos(), im - share * phase.sin()]
            });
            let expected = (1.0_f64.hypot(0.6 * ratio)) / (1.0 - ratio * ratio).hypot(0.6 * ratio);
            let found = sums[0].hypot(sums[1]);
            assert!((found / expected - 1.0).abs() < 0.06, "{ratio}: {found}, expected {expected}");
        }
        assert!(kernel.iter().any(|it| it[1] < 0.0), "it swings back");
    }

    #[test]
    fn layers_that_are_pushed_together_bulge() {
        let surface = crate::painted::head::head().0;
        let soft = Soft::head(&SoftSettings::default(), &surface, |p| p * 1e3);
        // The whole skin stays where it is but for a cheek, whose points come closer together.
        let pushed: Vec<Point3<f64>> = surface
            .rest
            .iter()
            .map(|it| {
                let middle = Vector3::new(it.x, 0.044, -0.032);
                let near = bell(it.y - 0.044, 0.02) * bell(it.z + 0.032, 0.02);
                it + (middle - it.coords) * (0.2 * near)
            })
            .collect();
        let here = Isometry3::identity();
        let now = Carried { weights: Vec::new(), world_from_part: here, world_from_next: here };
        let settled = soft.settle(&surface, &now, &pushed, 0.0, |_| now.clone());
        let normals = surface.normals(&pushed);
        let cheek = (0..pushed.len()).min_by(|a, b| {
            let off = |i: usize| (surface.rest[i].y - 0.044).hypot(surface.rest[i].z + 0.032) - surface.rest[i].x;
            off(*a).total_cmp(&off(*b))
        });
        let cheek = cheek.unwrap();
        let out = (settled[cheek] - pushed[cheek]).dot(&normals[cheek].cast());
        assert!(out > 0.5e-3, "{out} m");
    }
}
