//! Search for lost points by their last patch: at the place predicted by their neighbours, or, where these are lost too, by a body.
//! Points that are found again keep their identity.

use foveate::estimation::statistics::median;
use foveate::geometry::Camera;
use foveate::imaging::matching::{Correlated, Template, Warp, match_template, search};
use foveate::prelude::*;
use nalgebra::{Isometry3, Point3, Vector3};

use crate::guide::{Anchor, Guide};
use crate::measure::{MeasureOptions, Measurer, Sample, plane_warp};
use crate::tracks::{
    AS_GOOD, BESIDE_PX, LocalMotion, MIN_CORRELATION, MIN_NEIGHBOURS, Neighbourhood, Stepper, Track, TrackOptions,
    UNBENT, may_be_elsewhere, product,
};
use crate::views::{Moment, View};

/// What a body is off changes from point to point by so much [m],
const ALIKE_M: f64 = 1e-3;
/// and by so many median differences of the points around [–].
const SCATTERS: f64 = 5.0;
/// Other views are searched so far around where a body says that they see a point [px].
const OTHER_VIEW_PX: usize = 8;

/// A lost point.
#[derive(Debug, Clone)]
pub struct LostTrack {
    /// Where it would be now; its bending is that of its patch since it was seen last.
    track: Track,
    /// The reference's patch when it was seen last.
    template: Template,
    /// Where else that picture looked the same, off the patch [px].
    repeats: Vec<[f64; 2]>,
    /// Moments since then.
    age: u32,
    /// Until when it, or neighbours of it, were seen.
    known: Time,
    /// On a body, and how that part of it lay when the point was seen last.
    anchor: Option<(Anchor, Isometry3<f64>)>,
}

/// Data for the search of lost points at one moment.
pub struct Search<'a> {
    /// All views.
    pub views: &'a [View],
    /// A moment before, and now.
    pub moments: [&'a Moment; 2],
    /// What was found in this step.
    pub found: &'a Neighbourhood<'a>,
    /// What a body says.
    pub guide: &'a Guide,
    /// Gates between views.
    pub measure: &'a MeasureOptions,
    /// Gates in time.
    pub options: &'a TrackOptions,
}

/// Source of a lost point's prediction.
pub enum Expected<'a> {
    /// Its neighbours.
    Beside(LocalMotion<'a>),
    /// A body.
    OnBody {
        /// Of the point [m/s].
        velocity: Vector3<f64>,
        /// Of the surface [–].
        normal: Vector3<f64>,
    },
}

impl LostTrack {
    /// A point that was seen a moment before and is not now; `None` where its patch cannot be kept.
    pub fn of(track: Track, stepper: &mut Stepper, search: &Search<'_>) -> Option<Self> {
        let (before, options) = (search.moments[0], search.options);
        let mut template = Template::default();
        let picture = before.pictures[track.sample.reference].as_ref()?.finest();
        template.take(picture, track.sample.pixel, options.reach, &options.matching).ok()?;
        let repeats = stepper.repeats(&template, picture, options.boxes_px[1]);
        let anchor = search.guide.anchor(&track.sample.position, before.time);
        let anchor = anchor.and_then(|it| Some((it, search.guide.pose(&it, before.time)?)));
        let track = Track { bend: UNBENT, ..track };
        let mut lost = Self { track, template, repeats, age: 0, known: before.time, anchor };
        lost.advance(search);
        Some(lost)
    }

    /// Goes to where it would be now; `None` where nothing says where that is.
    fn advance<'a>(&mut self, search: &Search<'a>) -> Option<Expected<'a>> {
        let [before, now] = search.moments;
        let dt_s = (now.time - before.time).as_s();
        // Where it is not known, what repeats may be taken for another place, and nothing else.
        let goes_with_neighbours = self.known == before.time || (self.anchor.is_none() && self.repeats.is_empty());
        if goes_with_neighbours && let Some(motion) = search.found.motion_at(&self.track.sample.position) {
            self.track.sample.position += motion.velocity * dt_s;
            self.track.bend = product(&motion.nearest.bend, &self.track.bend);
            self.known = now.time;
            return Some(Expected::Beside(motion));
        }
        let (anchor, seen) = self.anchor.as_ref().filter(|_| self.repeats.is_empty())?;
        let velocity = search.guide.velocity(anchor, [before.time, now.time])?;
        let pose = search.guide.pose(anchor, now.time)?;
        self.track.sample.position = pose * anchor.place;
        // As a camera that goes with the part of the body sees the tangent plane, then and now.
        let camera = &search.views[self.track.sample.reference].camera;
        let within = |world_from_part: &Isometry3<f64>| Camera {
            camera_from_world: camera.camera_from_world * world_from_part,
            ..camera.clone()
        };
        let normal = seen.inverse_transform_vector(&self.track.normal);
        self.track.bend = plane_warp(&within(seen), &within(&pose), &anchor.place, &normal)?.matrix;
        Some(Expected::OnBody { velocity, normal: pose * normal })
    }

    fn look(
        &self,
        stepper: &mut Stepper,
        measurer: &mut Measurer,
        expected: &Expected<'_>,
        with: &Search<'_>,
    ) -> Option<Sample> {
        let Search { views, options, .. } = *with;
        let now = with.moments[1];
        let reference = self.track.sample.reference;
        let picture = now.pictures[reference].as_ref()?.finest();
        let pixel = views[reference].camera.sees(&self.track.sample.position)?;
        let start = Warp { at: [pixel.x, pixel.y], matrix: self.track.bend };
        let mut place = None;
        for box_px in [BESIDE_PX, options.boxes_px[1].ceil()] {
            let found = search(&self.template, picture, &start, box_px as usize, &mut stepper.templates.1);
            let is_clear = |it: &Correlated| {
                it.correlation >= MIN_CORRELATION
                    && it.second <= AS_GOOD * it.correlation
                    && !may_be_elsewhere(&self.repeats, &start, &it.warp, box_px)
            };
            let Some(found) = found.filter(is_clear) else { continue };
            let matched = match_template(&self.template, picture, &found.warp, &options.matching, &mut stepper.matches);
            place = matched.ok();
            if place.is_some() {
                break;
            }
        }
        let at = place?.warp.at;
        let starts = match expected {
            Expected::Beside(motion) => motion.nearest.sample.starts_at(views, at),
            Expected::OnBody { normal, .. } => {
                stepper.template.take(picture, at, with.measure.reach, &with.measure.matching).ok()?;
                let off = [at[0] - pixel.x, at[1] - pixel.y];
                let others = views.iter().enumerate().filter(|it| it.0 != reference);
                let found = others.filter_map(|(view, to)| {
                    let from = &views[reference].camera;
                    let warp = plane_warp(from, &to.camera, &self.track.sample.position, normal)?.beside(off);
                    let other = now.pictures[view].as_ref()?.finest();
                    let found = search(&stepper.template, other, &warp, OTHER_VIEW_PX, &mut stepper.templates.1)?;
                    (found.correlation >= MIN_CORRELATION).then_some((view, found.warp))
                });
                found.collect()
            }
        };
        measurer.measure(views, now, reference, at, &starts, with.measure).ok()
    }
}

impl Stepper {
    /// Searches lost points; those that are found are removed from the list.
    pub fn regenerate(
        &mut self,
        measurer: &mut Measurer,
        lost: &mut Vec<LostTrack>,
        search: &Search<'_>,
    ) -> Vec<Track> {
        let mut again = Vec::new();
        // Off where a body says that they are, and which of the lost ones they are.
        let mut guided: Vec<(usize, Vector3<f64>, Track)> = Vec::new();
        let mut is_found = vec![false; lost.len()];
        for (index, it) in lost.iter_mut().enumerate() {
            it.age += 1;
            let Some(expected) = it.advance(search) else { continue };
            let Some(sample) = it.look(self, measurer, &expected, search) else { continue };
            let off = sample.position - it.track.sample.position;
            let (velocity, bend) = match &expected {
                Expected::Beside(motion) => (motion.velocity, motion.nearest.bend),
                Expected::OnBody { velocity, .. } => (*velocity, UNBENT),
            };
            let (n_samples, acceleration) = (it.track.n_samples + 1, Vector3::zeros());
            let track = Track { sample, velocity, acceleration, n_samples, bend, ..it.track.clone() };
            match expected {
                Expected::Beside(_) => {
                    is_found[index] = true;
                    again.push(track);
                }
                Expected::OnBody { .. } => guided.push((index, off, track)),
            }
        }
        let offs: Vec<Vector3<f64>> = guided.iter().map(|it| it.1).collect();
        let agree =
            agreeing(&offs, search.options.radius_m, &guided.iter().map(|it| it.2.sample.position).collect::<Vec<_>>());
        for ((index, _, track), _) in guided.into_iter().zip(agree).filter(|it| it.1) {
            self.guided += 1;
            is_found[index] = true;
            again.push(track);
        }
        let mut found = is_found.iter();
        lost.retain(|it| found.next() == Some(&false) && it.age < search.options.remember);
        again
    }
}

/// Which points are off where a body says by as much as those around them are: a body is off, but for all of them alike. One without company is not believed.
fn agreeing(offs: &[Vector3<f64>], radius_m: f64, places: &[Point3<f64>]) -> Vec<bool> {
    let around = |index: usize| {
        let near =
            (0..places.len()).filter(move |it| *it != index && (places[*it] - places[index]).norm() <= 2.0 * radius_m);
        near.map(|it| offs[it]).collect::<Vec<_>>()
    };
    let agrees = |index: usize| {
        let near = around(index);
        let middle = |axis: usize| median(&near.iter().map(|it| it[axis]).collect::<Vec<f64>>());
        let (Some(x), Some(y), Some(z)) = (middle(0), middle(1), middle(2)) else { return false };
        let off = |it: &Vector3<f64>| (it - Vector3::new(x, y, z)).norm();
        let scatter = median(&near.iter().map(off).collect::<Vec<f64>>()).unwrap_or(0.0);
        near.len() >= MIN_NEIGHBOURS && off(&offs[index]) <= ALIKE_M + SCATTERS * scatter
    };
    (0..offs.len()).map(agrees).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_are_off_otherwise_than_those_around_them_are_not_believed() {
        let places: Vec<Point3<f64>> = (0..12).map(|it| Point3::new(5e-3 * f64::from(it), 0.0, 0.0)).collect();
        let mut offs = vec![Vector3::new(6e-3, -4e-3, 1e-3); 12];
        offs[5].z += 8e-3;
        let believed = agreeing(&offs, 0.015, &places);
        assert!((0..12).all(|it| believed[it] == (it != 5)), "{believed:?}");
        // All off by as much, but alone.
        assert_eq!(agreeing(&offs[..4], 0.015, &places[..4]), vec![false; 4]);
        let far: Vec<Point3<f64>> = (0..12).map(|it| Point3::new(0.1 * f64::from(it), 0.0, 0.0)).collect();
        assert_eq!(agreeing(&offs, 0.015, &far), vec![false; 12]);
    }
}
