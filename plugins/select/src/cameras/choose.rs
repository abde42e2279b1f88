//! Selection of the fixed cameras that are worth processing for the present targets.
//!
//! For each target, a pair of cameras and then further ones are added that increase the joint information of their lines of sight most
//! ([`Worth`]), less what each costs: little where another target uses the camera anyway, more where it sees the target small, at the rim of
//! the picture, or has not seen it recently although it should have.

use std::collections::BTreeMap;

use foveate::estimation::allocation::Worth;
use foveate::geometry::Camera;
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};

use super::settings::CamerasSettings;

/// Most cameras that are tried in pairs for a target: the cheapest.
const CANDIDATES: usize = 40;

/// Chooses cameras.
pub struct Chooser {
    settings: CamerasSettings,
    worth: Worth,
    cameras: Vec<(CameraId, Camera)>,
    /// By target, by index in `cameras`: time of the last observation.
    seen: BTreeMap<TargetId, Vec<Option<Time>>>,
    /// By index in `cameras`: whether the last choice included it.
    chosen: Vec<bool>,
    last: Option<Time>,
    tally: Tally,
}

/// Counts so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Choices made.
    pub choices: u64,
    /// Cameras chosen, over all choices.
    pub cameras: u64,
    /// Cameras that were added to a choice, while there were targets.
    pub changes: u64,
    /// Targets, over all choices.
    pub targets: u64,
    /// Targets that fewer than two cameras can see.
    pub unseen: u64,
}

/// A camera that can see a target.
#[derive(Debug, Clone, Copy)]
struct View {
    place: usize,
    towards: Vector3<f64>,
    cost: f64,
}

impl Chooser {
    /// For these cameras.
    pub fn new(settings: CamerasSettings, cameras: Vec<(CameraId, Camera)>) -> Chooser {
        let worth = Worth { best_angle: settings.best_angle_deg.to_radians(), ..Worth::default() };
        let chosen = vec![true; cameras.len()];
        Chooser { settings, worth, cameras, seen: BTreeMap::new(), chosen, last: None, tally: Tally::default() }
    }

    /// Counts so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Number of cameras to choose from.
    pub fn n_cameras(&self) -> usize {
        self.cameras.len()
    }

    /// Takes all targets of one time; a choice when the last one is old enough. Without targets all cameras are chosen.
    pub fn update(&mut self, targets: &Targets) -> Option<CameraChoice> {
        self.note(targets);
        if self.last.is_some_and(|last| targets.time - last < Interval::from_s(1.0 / self.settings.rate_hz)) {
            return None;
        }
        self.last = Some(targets.time);
        let list: Vec<(TargetId, Point3<f64>)> = targets
            .list
            .iter()
            .filter(|it| it.position.iter().all(|it| it.is_finite()))
            .map(|it| (it.id, it.position))
            .collect();
        let mut used = vec![list.is_empty(); self.cameras.len()];
        for (id, place) in &list {
            let views = self.views(targets.time, *id, place, &used);
            self.tally.unseen += u64::from(views.len() < 2);
            self.pick(&views).into_iter().for_each(|place| used[place] = true);
        }
        self.tally.choices += 1;
        self.tally.targets += list.len() as u64;
        self.tally.cameras += used.iter().filter(|it| **it).count() as u64;
        if !list.is_empty() {
            self.tally.changes +=
                used.iter().zip(&self.chosen).filter(|(now, before)| **now && !**before).count() as u64;
        }
        let cameras = self.cameras.iter().zip(&used).filter(|it| *it.1).map(|it| it.0.0).collect();
        self.chosen = used;
        Some(CameraChoice { cameras })
    }

    /// Stores which cameras saw the targets.
    fn note(&mut self, targets: &Targets) {
        for target in &targets.list {
            let seen = self.seen.entry(target.id).or_insert_with(|| vec![None; self.cameras.len()]);
            for camera in target.cameras.iter() {
                if let Ok(place) = self.cameras.binary_search_by_key(&camera, |it| it.0) {
                    seen[place] = Some(targets.time);
                }
            }
        }
        self.seen.retain(|id, _| targets.list.iter().any(|it| it.id == *id));
    }

    /// The cameras with `place` in view, the cheapest first.
    fn views(&self, now: Time, id: TargetId, place: &Point3<f64>, used: &[bool]) -> Vec<View> {
        let CamerasSettings { camera_cost, change_cost, coarse_cost, rim_cost, rim_px, hidden_cost, hidden_ms, .. } =
            self.settings;
        let (mut views, mut px_per_m, mut finest) = (Vec::new(), Vec::new(), 0.0);
        for (at, (_, camera)) in self.cameras.iter().enumerate() {
            let Some((pixel, by_point)) = camera.project_with_jacobian(place) else { continue };
            if !camera.has_pixel(&pixel) {
                continue;
            }
            let [width, height] = camera.image_size.map(f64::from);
            let to_rim = (pixel.x + 0.5).min(width - 0.5 - pixel.x).min(pixel.y + 0.5).min(height - 0.5 - pixel.y);
            let fine = by_point.norm();
            finest = fine.max(finest);
            px_per_m.push(fine);
            let seen = self.seen.get(&id).and_then(|it| it[at]);
            let hidden = seen.is_none_or(|seen| now - seen > Interval::from_ms(hidden_ms));
            let sum = [
                (!used[at], camera_cost),
                (!self.chosen[at], change_cost),
                (to_rim < rim_px, rim_cost * (1.0 - to_rim / rim_px.max(f64::MIN_POSITIVE))),
                (hidden, hidden_cost),
            ];
            let cost = sum.iter().filter(|it| it.0).map(|it| it.1).sum();
            views.push(View { place: at, towards: camera.centre() - place, cost });
        }
        for (view, fine) in views.iter_mut().zip(px_per_m) {
            view.cost += coarse_cost * (1.0 - fine / finest);
        }
        views.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        views
    }

    /// A pair, then further cameras as long as each is a gain.
    fn pick(&self, views: &[View]) -> Vec<usize> {
        let views = &views[..views.len().min(CANDIDATES)];
        let (least, most) = (self.settings.least as usize, self.settings.most as usize);
        let mut best = (f64::NEG_INFINITY, 0, 0);
        for (b, second) in views.iter().enumerate() {
            for (a, first) in views[..b].iter().enumerate() {
                let net = self.worth.of_set(&[first.towards, second.towards]) - first.cost - second.cost;
                if net > best.0 {
                    best = (net, a, b);
                }
            }
        }
        if views.len() < 2 {
            return views.iter().map(|it| it.place).collect();
        }
        let mut taken = vec![best.1, best.2];
        while taken.len() < most.min(views.len()) {
            let mut lines: Vec<Vector3<f64>> = taken.iter().map(|it| views[*it].towards).collect();
            let before = self.worth.of_set(&lines);
            let mut next = (f64::NEG_INFINITY, 0);
            for (at, view) in views.iter().enumerate().filter(|it| !taken.contains(&it.0)) {
                lines.push(view.towards);
                let gain = self.worth.of_set(&lines) - before - view.cost;
                lines.pop();
                if gain > next.0 {
                    next = (gain, at);
                }
            }
            if next.0 <= 0.0 && taken.len() >= least {
                break;
            }
            taken.push(next.1);
        }
        taken.into_iter().map(|it| views[it].place).collect()
    }
}
