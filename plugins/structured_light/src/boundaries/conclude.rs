//! Makes the map of a picture of the boundaries that were found in it, and says where the surface is: around the target, or where the last map had it.

use foveate::geometry::Camera;
use foveate::imaging::stripes::boundary::{BoundaryCode, Line};
use foveate::imaging::stripes::code::StripeCode;
use foveate::prelude::*;
use nalgebra::{Point2, Point3, Vector3};

use super::{Before, Boundaries, MAP, TARGETS, WHITE};
use crate::boundary_map::{Map, brightest, period_of};
use crate::pair::triangulate;

/// Points that say how far the surface is where no target does.
const SAMPLES: usize = 64;
/// A map of fewer than this part of the boundaries of the best one is of what tracking left behind: most of that is wrong …
const LEAST_PART: f64 = 0.1;
/// … where the best one counts for less from picture to picture.
const FADES: f64 = 0.99;

impl Boundaries {
    /// Where the surface is about, and its velocity [m, m/s].
    fn target(&self, io: &Io<'_>, camera: &Camera, time: Time) -> Option<(Point3<f64>, Vector3<f64>)> {
        if let Some((spaces, velocity)) = &self.spaces {
            let pose = spaces.world_from_own(time).ok().filter(|_| !spaces.is_suspended())?;
            return Some((pose.transform.translation.vector.into(), *velocity));
        }
        let [width, height] = camera.image_size.map(f64::from);
        let middle = Point2::new(width / 2.0, height / 2.0);
        let targets = io.latest(&TARGETS)?;
        let seen = targets.value.list.iter().filter_map(|target| {
            let place = target.position_after(time - targets.value.time);
            let off = (camera.project(&place)? - middle).norm();
            (off < width.max(height)).then_some((off, place, target.velocity))
        });
        seen.min_by(|a, b| a.0.total_cmp(&b.0)).map(|it| (it.1, it.2))
    }

    /// Nearest and farthest distance of the surface, a likely one between, and how fast it moves.
    pub(super) fn whereabouts(&self, io: &Io<'_>, camera: &Camera, time: Time) -> ([f64; 2], f64, Vector3<f64>) {
        match self.target(io, camera, time) {
            Some((place, velocity)) => {
                let distance = (place - camera.centre()).norm();
                let near = (distance - self.settings.around_m).max(1e-3);
                ([near, distance + self.settings.around_m], distance, velocity)
            }
            None => {
                let [near, far] = self.settings.distance_m;
                ([near, far], self.distance.unwrap_or((near * far).sqrt()).clamp(near, far), Vector3::zeros())
            }
        }
    }

    /// Makes the map of the picture before.
    pub(super) fn conclude(
        &mut self,
        io: &mut Io<'_>,
        before: &Before,
        code: &StripeCode,
        axis: usize,
        image: &Image,
        found: &[Vec<Line>],
    ) {
        let mut map = Map::new(image, self.projector.image_size, axis);
        let stripe = code.stripe[axis] as f32;
        let pitch = self.tracker.options().pitch;
        let period = stripe * BoundaryCode::get().len() as f32;
        let (mut n, mut n_ghosts, mut n_unknown) = (0, 0, 0);
        for (y, row) in found.iter().enumerate() {
            for line in row.iter().filter(|it| !it.may_be_end()) {
                let Some(column) = period_of(line, y, stripe, period, &before.lit_from) else {
                    n_unknown += 1;
                    continue;
                };
                n += 1;
                n_ghosts += u64::from(line.is_ghost);
                map.draw(y, line, column, stripe, pitch, self.settings.beside_px);
            }
        }
        self.unknown_period += n_unknown;
        if n == 0 {
            self.empty += 1;
            let fault = match n_unknown {
                0 => "no boundary could be decoded",
                _ => {
                    "the code repeats, and no single repetition fits: connect `targets`, or set `distance_m` to the possible distances of the surface"
                }
            };
            if n_unknown > 0 {
                self.note("period", before.stamp.time, fault);
            }
            io.gap(&MAP, before.stamp.time, fault);
            return;
        }
        self.most = (self.most * FADES).max(n as f64);
        if (n as f64) < LEAST_PART * self.most {
            self.empty += 1;
            let fault = format!(
                "{n} boundaries are left, expected about {:.0} as before: the surface was lost, or is nearly out of the picture",
                self.most
            );
            self.note("lost", before.stamp.time, &fault);
            io.gap(&MAP, before.stamp.time, fault);
            return;
        }
        self.frames += 1;
        self.found += n;
        self.ghosts += n_ghosts;
        let map = map.finish(format!("{:.3} s", before.stamp.time.as_s()));
        self.distance = self.distance_of(&before.camera, &map).or(self.distance);
        let white = Image { pixels: brightest(&self.recent), ..image.clone() };
        io.emit(&WHITE, before.stamp, white);
        io.emit(&MAP, before.stamp, map);
    }

    /// Median distance of some points of a map [m].
    fn distance_of(&self, camera: &Camera, map: &ProjectorMap) -> Option<f64> {
        let known = |at: &usize| {
            let (x, y) = (at % map.width as usize, at / map.width as usize);
            let sample = map.get(x, y);
            let pixel = Point2::new(x as f64, y as f64);
            triangulate(camera, &self.projector, &pixel, &sample).map(|it| it.depth)
        };
        let every = (map.width as usize * map.height as usize / (40 * SAMPLES)).max(1);
        let all = (0..map.width as usize * map.height as usize).step_by(every);
        let mut depths: Vec<f64> = all.filter_map(|at| known(&at)).collect();
        depths.sort_by(f64::total_cmp);
        depths.get(depths.len() / 2).copied()
    }
}
