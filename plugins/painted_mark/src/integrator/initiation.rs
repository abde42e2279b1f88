//! Initiation without a prior: dots of several pictures that agree on places become the surface, and dots that are no known mark become marks.

use std::collections::{BTreeMap, BTreeSet};

use foveate::geometry::{Camera, JointObservation, JointPoint, Viewpoint, triangulate_jointly};
use foveate::prelude::*;
use nalgebra::{Matrix2, Point2, Point3};

use super::coherence::MOST_OFF;
use super::gather::{Frame, View};
use super::matching::{self, DotView, MatchOptions, match_dots, where_all_look};
use super::pair::middle;
use super::registration::register;
use super::track_store::Known;
use super::{Integrator, LEAST_TO_GO_ON};

/// Tolerances of a search: smaller once the errors of the poses are estimated [px].
const NARROWING_PX: [f64; 2] = [3.0, 1.5];
/// Share of a picture's dots that must be matched.
const MATCHED: f64 = 0.5;
/// Share of the dots of a picture that must agree on a shift.
const AGREEING: f64 = 0.3;
/// A dot closer than this to the prediction of a mark that other cameras see may be that mark [px].
pub(super) const NEAR_KNOWN_PX: f64 = 6.0;

impl Integrator {
    /// The dots without a label in each view, where `is_free` accepts them.
    fn dots(view: &View, is_free: impl Fn(&Point2<f64>) -> bool) -> Vec<Point2<f64>> {
        let unnamed = view.features.list.iter().filter(|it| it.label.is_none()).map(|it| it.centre);
        unnamed.filter(is_free).collect()
    }

    pub(super) fn initiation_views(&self, frame: &Frame) -> usize {
        (self.settings.initiation_views as usize).min(frame.views.len()).max(2)
    }

    /// Without a prior: matches all dots, and labels them, with known labels where the marks are recognised. Returns the cameras at the poses
    /// that fit the matches best.
    pub(super) fn look_for_surface(&mut self, frame: &Frame) -> Option<Vec<Camera>> {
        let all = |view: &View| {
            let named = view.features.list.iter().filter(|it| it.label.is_some()).map(|it| it.centre);
            Self::dots(view, |_| true).into_iter().chain(named).collect::<Vec<_>>()
        };
        let mut views: Vec<DotView> =
            frame.views.iter().map(|view| DotView { camera: view.viewpoint.camera.clone(), dots: all(view) }).collect();
        let centre = where_all_look(views.iter().map(|it| &it.camera))?;
        let viewpoints: Vec<Viewpoint> = frame.views.iter().map(|it| it.viewpoint.clone()).collect();
        let mut counts: Vec<usize> = views.iter().map(|it| it.dots.len()).collect();
        counts.sort_unstable();
        // As many as the second fullest picture has: fewer than two pictures make no place.
        let full = *counts.iter().rev().nth(1)?;
        let share = |of: f64| ((of * full as f64) as usize).max(LEAST_TO_GO_ON);
        let (agreeing, matched) = (share(AGREEING), share(MATCHED));
        let ball = (centre, self.radius);
        let n_views = self.initiation_views(frame);
        if self.settings.pose_errors && !register(&mut views, ball, self.settings.start_px, agreeing, n_views) {
            return None;
        }
        let mut found = Vec::new();
        for tolerance in NARROWING_PX {
            let options = MatchOptions { ball, tolerance, views: n_views };
            found = match_dots(&views, &options);
            let observations: Vec<JointObservation> = found
                .iter()
                .enumerate()
                .flat_map(|(point, it)| it.dots.iter().map(move |(view, dot)| (point, *view, *dot)))
                .map(|(point, viewpoint, dot)| {
                    let covariance = Matrix2::identity() * (0.3 * tolerance).powi(2);
                    JointObservation { viewpoint, point, pixel: views[viewpoint].dots[dot], covariance }
                })
                .collect();
            let joint = triangulate_jointly(&viewpoints, found.len(), &observations, &self.options()).ok()?;
            for (view, camera) in views.iter_mut().zip(&joint.cameras) {
                view.camera = camera.clone();
            }
            let place = |(it, point): (&mut matching::Match, &Option<JointPoint>)| {
                point.inspect(|point| it.position = point.position).is_some()
            };
            let kept: Vec<bool> = found.iter_mut().zip(&joint.points).map(place).collect();
            let mut kept = kept.into_iter();
            found.retain(|_| kept.next().unwrap_or(false));
        }
        let points: Vec<Point3<f64>> = found.iter().map(|it| it.position).collect();
        if points.len() < matched {
            return None;
        }
        self.tally.starts += 1;
        let believed = self.track_store.marks.iter().filter(|it| it.1.is_believed);
        let believed: BTreeMap<u32, Point3<f64>> = believed.map(|(label, it)| (*label, it.position)).collect();
        if believed.len() < LEAST_TO_GO_ON {
            self.track_store.marks.retain(|_, it| it.is_believed);
            points.into_iter().for_each(|it| self.initiate(it));
        } else {
            let (measured, shape) = self.shapes.recognise(&points, believed)?;
            self.track_store.take_shape(&shape);
            self.track_store.update(&measured, &BTreeSet::new(), None, self.settings.initiation_frames);
        }
        Some(views.into_iter().map(|it| it.camera).collect())
    }

    /// Dots that are no known mark become marks where enough cameras agree. Those of `weak` marks are tried as well: returns the weak marks that are in doubt because one of
    /// their dots fits another mark, or enough dots of other cameras elsewhere. Two cameras side by side see any two dots at one height as a place.
    pub(super) fn look_for_new(&mut self, frame: &Frame, cameras: &[Camera], weak: &BTreeSet<u32>) -> BTreeSet<u32> {
        let mut doubted = BTreeSet::new();
        let mut owners: Vec<Vec<Option<u32>>> = Vec::new();
        let mut views: Vec<DotView> = Vec::new();
        let tolerance = NARROWING_PX[NARROWING_PX.len() - 1];
        for (view, camera) in frame.views.iter().zip(cameras) {
            let named: BTreeSet<u32> = view.features.list.iter().filter_map(|it| it.label).collect();
            let known = || self.track_store.marks.iter().filter(|it| !weak.contains(it.0));
            let places = |it: (&u32, &Known)| camera.project(&it.1.position);
            let all: Vec<Point2<f64>> = known().filter_map(places).collect();
            // A mark that has its dot here is no other one; and one that no camera knows may be anywhere.
            let missing = known().filter(|it| it.1.is_seen && !named.contains(it.0));
            let missing: Vec<Point2<f64>> = missing.filter_map(places).collect();
            let is_clear =
                |of: &[Point2<f64>], dot: &Point2<f64>, most: f64| of.iter().all(|it| (it - dot).norm() > most);
            let (mut here, mut dots) = (Vec::new(), Vec::new());
            for Feature { label, centre, .. } in &view.features.list {
                match label {
                    Some(label) if !weak.contains(label) => continue,
                    Some(label) if !is_clear(&all, centre, tolerance) => {
                        doubted.insert(*label);
                    }
                    None if !is_clear(&missing, centre, NEAR_KNOWN_PX) => continue,
                    _ => {
                        here.push(*label);
                        dots.push(*centre);
                    }
                }
            }
            owners.push(here);
            views.push(DotView { camera: camera.clone(), dots });
        }
        let n_views = self.initiation_views(frame);
        if views.iter().filter(|it| !it.dots.is_empty()).count() < n_views {
            return doubted;
        }
        let seen: Vec<Point3<f64>> =
            self.track_store.marks.values().filter(|it| it.is_seen).map(|it| it.position).collect();
        let options = MatchOptions { ball: (middle(&seen), self.radius), tolerance, views: n_views };
        for found in match_dots(&views, &options) {
            let owned: BTreeSet<u32> = found.dots.iter().filter_map(|(view, dot)| owners[*view][*dot]).collect();
            let is_there = |label: &u32| {
                self.track_store.marks.get(label).is_some_and(|it| (it.position - found.position).norm() < MOST_OFF)
            };
            if owned.is_empty() {
                if !self.track_store.moved_to(&found.position, MOST_OFF) {
                    self.initiate(found.position);
                }
            } else if !owned.iter().any(is_there) {
                doubted.extend(owned);
            }
        }
        doubted
    }

    /// Begins a mark where none is near.
    fn initiate(&mut self, position: Point3<f64>) {
        if self.track_store.nearest(&position) > self.settings.spacing_mm * 1e-3 {
            self.track_store.initiate(position);
        }
    }
}
