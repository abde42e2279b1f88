//! One point of a surface: a patch of one view, matched in others, and where the lines of sight meet.

use std::collections::BTreeMap;

use foveate::geometry::{Camera, PixelNoise, Ray, refine, triangulate_rays};
use foveate::imaging::matching::{
    Match, MatchBuffers, MatchOptions, Place, Refused, SplineImage, Template, Warp, match_in_space, match_template,
};
use nalgebra::{Matrix2, Matrix3, Point2, Point3, Vector3};

use crate::views::{Moment, View};

/// What one other view saw of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Which view.
    pub view: usize,
    /// Where it lies there, and how the patch is bent.
    pub warp: Warp,
    /// Of the place, relative to the pixel of the reference [px²].
    pub covariance: Matrix2<f64>,
    /// With the reference's patch [–].
    pub correlation: f64,
}

/// One point.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The view whose patch it is.
    pub reference: usize,
    /// Where that lies [px].
    pub pixel: [f64; 2],
    /// In the other views.
    pub seen: Vec<Seen>,
    /// In the world [m].
    pub position: Point3<f64>,
    /// Of the position [m²].
    pub covariance: Matrix3<f64>,
    /// The least over the other views [–].
    pub correlation: f64,
    /// Root mean square distance between its pixels and where the views see its position [px].
    pub misfit_px: f64,
}

/// Why there is no point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum NoPoint {
    /// No match.
    Match(Refused),
    /// Lines of sight do not meet: the match lies off the epipolar line.
    Misfit,
    /// Matched back from the other view it comes out elsewhere.
    NotMutual,
    /// It lies outside the volume.
    OutOfVolume,
    /// Seen by too few views.
    FewViews,
}

impl NoPoint {
    /// For figures.
    pub fn name(self) -> &'static str {
        match self {
            NoPoint::Match(refused) => refused.name(),
            NoPoint::Misfit => "misfit",
            NoPoint::NotMutual => "not_mutual",
            NoPoint::OutOfVolume => "out_of_volume",
            NoPoint::FewViews => "few_views",
        }
    }
}

/// When a point is believed.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureOptions {
    /// Half a side of the patch, without its centre [px].
    pub reach: usize,
    /// Gates of each match.
    pub matching: MatchOptions,
    /// Whether the point in space is an unknown of one match in all views, in place of one match a view.
    pub in_space: bool,
    /// See [`Sample::misfit_px`], at most [px].
    pub max_misfit_px: f64,
    /// A match back comes out within this; 0: none is made [px].
    pub max_back_px: f64,
    /// Views that see a point, the reference among them.
    pub min_views: usize,
    /// How well a pixel's direction is known: that of the calibration [px].
    pub camera_sigma_px: f64,
    /// Where points may lie [m].
    pub volume_m: Option<[[f64; 3]; 2]>,
}

/// Measures points; holds the memory for that, and counts.
#[derive(Debug, Default)]
pub struct Measurer {
    /// By reason.
    pub refused: BTreeMap<&'static str, u64>,
    /// Points measured.
    pub measured: u64,
    template: Template,
    back: Template,
    buffers: MatchBuffers,
}

/// Views beside the reference of which one may be wrong: fewer do not tell which [–].
const LEAST_TO_DOUBT: usize = 3;
/// Half the step of derivatives in pictures [px].
const STEP_PX: f64 = 2.0;

impl Measurer {
    /// The point that view `reference` sees at `pixel`; `starts` are other views with where to begin in them.
    ///
    /// # Errors
    /// See [`NoPoint`]; the reason is counted too.
    pub fn measure(
        &mut self,
        views: &[View],
        moment: &Moment,
        reference: usize,
        pixel: [f64; 2],
        starts: &[(usize, Warp)],
        options: &MeasureOptions,
    ) -> Result<Sample, NoPoint> {
        let found = self.attempt(views, moment, reference, pixel, starts, options);
        match &found {
            Ok(_) => self.measured += 1,
            Err(reason) => *self.refused.entry(reason.name()).or_default() += 1,
        }
        found
    }

    fn attempt(
        &mut self,
        views: &[View],
        moment: &Moment,
        reference: usize,
        pixel: [f64; 2],
        starts: &[(usize, Warp)],
        options: &MeasureOptions,
    ) -> Result<Sample, NoPoint> {
        let outside = NoPoint::Match(Refused::Outside);
        let picture = moment.pictures[reference].as_ref().ok_or(outside)?.finest();
        self.template.take(picture, pixel, options.reach, &options.matching).map_err(NoPoint::Match)?;
        let others: Vec<(usize, Warp, &SplineImage)> = starts
            .iter()
            .filter_map(|(view, warp)| Some((*view, *warp, moment.pictures[*view].as_ref()?.finest())))
            .collect();
        let mut seen = Vec::with_capacity(others.len());
        let mut reason = NoPoint::FewViews;
        if options.in_space {
            self.match_in_space(&views[reference].camera, views, pixel, &others, options, &mut seen, &mut reason);
        } else {
            for (view, start, other) in &others {
                match match_template(&self.template, other, start, &options.matching, &mut self.buffers) {
                    Ok(found) => {
                        let Match { warp, covariance, correlation, .. } = found;
                        seen.push(Seen { view: *view, warp, covariance, correlation });
                    }
                    Err(refused) => reason = NoPoint::Match(refused),
                }
            }
        }
        if options.max_back_px > 0.0 {
            seen.retain(|it: &Seen| {
                let other = moment.pictures[it.view].as_ref().map(|it| it.finest());
                let back = other.and_then(|other| self.match_back(picture, other, pixel, it, options));
                let mutual = back.is_some_and(|off| off <= options.max_back_px);
                if !mutual {
                    reason = NoPoint::NotMutual;
                }
                mutual
            });
        }
        loop {
            if seen.len() + 1 < options.min_views.max(2) {
                return Err(reason);
            }
            let (position, covariance, misfit_px) =
                meet(views, reference, pixel, &seen, options.camera_sigma_px).ok_or(NoPoint::Misfit)?;
            if misfit_px > options.max_misfit_px {
                // Of four or more views one may be wrong: the one without which the rest meets best. Of three it is not known which, for any two may meet: cameras in a line, of which one is
                // out of step.
                reason = NoPoint::Misfit;
                let without = |at: usize| {
                    let rest: Vec<Seen> = seen.iter().enumerate().filter(|it| it.0 != at).map(|it| *it.1).collect();
                    meet(views, reference, pixel, &rest, options.camera_sigma_px).map_or(f64::INFINITY, |it| it.2)
                };
                if seen.len() < LEAST_TO_DOUBT {
                    return Err(reason);
                }
                let worst = (0..seen.len()).min_by(|a, b| without(*a).total_cmp(&without(*b))).unwrap_or(0);
                seen.remove(worst);
                continue;
            }
            if let Some([a, b]) = options.volume_m
                && !(0..3).all(|axis| (a[axis].min(b[axis])..=a[axis].max(b[axis])).contains(&position[axis]))
            {
                return Err(NoPoint::OutOfVolume);
            }
            let correlation = seen.iter().map(|it| it.correlation).fold(1.0, f64::min);
            return Ok(Sample { reference, pixel, seen, position, covariance, correlation, misfit_px });
        }
    }

    /// How far off `pixel` a patch comes out that is matched back from another view [px].
    fn match_back(
        &mut self,
        picture: &SplineImage,
        other: &SplineImage,
        pixel: [f64; 2],
        seen: &Seen,
        options: &MeasureOptions,
    ) -> Option<f64> {
        self.back.take(other, seen.warp.at, options.reach, &options.matching).ok()?;
        let start = seen.warp.inverse(pixel)?;
        let found = match_template(&self.back, picture, &start, &options.matching, &mut self.buffers).ok()?;
        Some((found.warp.at[0] - pixel[0]).hypot(found.warp.at[1] - pixel[1]))
    }

    /// One match in all views, the depth along the reference's line of sight in common. Its start is where the first start's line of sight passes.
    #[expect(clippy::too_many_arguments, reason = "half of one function, apart for its length")]
    fn match_in_space(
        &mut self,
        camera: &Camera,
        views: &[View],
        pixel: [f64; 2],
        others: &[(usize, Warp, &SplineImage)],
        options: &MeasureOptions,
        seen: &mut Vec<Seen>,
        reason: &mut NoPoint,
    ) {
        let Some(ray) = camera.ray(&Point2::from(pixel)) else { return };
        let depths = others.iter().filter_map(|(view, warp, _)| {
            let other = views[*view].camera.ray(&Point2::from(warp.at))?;
            Some(ray.depth_of(&triangulate_rays(&[ray, other])?))
        });
        let depths: Vec<f64> = depths.filter(|it| *it > 0.0).collect();
        let Some(start) = foveate::estimation::statistics::median(&depths) else { return };
        let place = |k: usize, depth: f64| {
            let (at, by_point) = views[others[k].0].camera.project_with_jacobian(&ray.at(depth))?;
            let by_depth = by_point * ray.direction.into_inner();
            Some(Place { at: [at.x, at.y], by_depth: [by_depth.x, by_depth.y] })
        };
        let pictures: Vec<&SplineImage> = others.iter().map(|it| it.2).collect();
        let starts: Vec<[[f64; 2]; 2]> = others.iter().map(|it| it.1.matrix).collect();
        let found =
            match_in_space(&self.template, &pictures, &starts, start, &options.matching, place, &mut self.buffers);
        match found {
            Ok(found) => {
                for (k, result) in found.pictures.iter().enumerate() {
                    match result {
                        Ok((warp, correlation)) => {
                            let Some(place) = place(k, found.depth) else { continue };
                            // Along the line by the depth; across it by the calibration alone.
                            let by_depth = nalgebra::Vector2::from(place.by_depth);
                            let covariance = by_depth * by_depth.transpose() * found.variance;
                            let view = others[k].0;
                            seen.push(Seen { view, warp: *warp, covariance, correlation: *correlation });
                        }
                        Err(refused) => *reason = NoPoint::Match(*refused),
                    }
                }
            }
            Err(refused) => *reason = NoPoint::Match(refused),
        }
    }
}

/// Where lines of sight meet, how well that is known, and how far from meeting they are [px].
pub(crate) fn meet(
    views: &[View],
    reference: usize,
    pixel: [f64; 2],
    seen: &[Seen],
    sigma_px: f64,
) -> Option<(Point3<f64>, Matrix3<f64>, f64)> {
    let all = || {
        std::iter::once((reference, pixel, Matrix2::zeros()))
            .chain(seen.iter().map(|it| (it.view, it.warp.at, it.covariance)))
    };
    let cameras: Vec<&Camera> = all().map(|it| &views[it.0].camera).collect();
    let pixels: Vec<Point2<f64>> = all().map(|it| Point2::from(it.1)).collect();
    let noise = Matrix2::identity() * (sigma_px * sigma_px).max(1e-8);
    let covariances: Vec<Matrix2<f64>> = all().map(|it| it.2 + noise).collect();
    let rays: Option<Vec<Ray>> = cameras.iter().zip(&pixels).map(|it| it.0.ray(it.1)).collect();
    let start = triangulate_rays(&rays?)?;
    let found = refine(&cameras, &pixels, PixelNoise::Covariances(&covariances), start).ok()?;
    Some((found.position, found.covariance, found.residuals_rms_px))
}

/// How a plane through `point` maps what lies around where camera `from` sees it into camera `to`; `None` where either does not see it from the front.
pub fn plane_warp(from: &Camera, to: &Camera, point: &Point3<f64>, normal: &Vector3<f64>) -> Option<Warp> {
    let at = to.sees(point)?;
    let centre = from.project(point)?;
    // Both must look at the same face.
    let side = |camera: &Camera| normal.dot(&(camera.centre() - point));
    if side(from) * side(to) <= 0.0 {
        return None;
    }
    let mapped = |dx: f64, dy: f64| {
        let ray = from.ray(&Point2::new(centre.x + dx, centre.y + dy))?;
        let along = ray.direction.dot(normal);
        let depth = (point - ray.origin).dot(normal) / along;
        to.project(&ray.at(depth)).filter(|_| depth > 0.0)
    };
    let (right, left) = (mapped(STEP_PX, 0.0)?, mapped(-STEP_PX, 0.0)?);
    let (below, above) = (mapped(0.0, STEP_PX)?, mapped(0.0, -STEP_PX)?);
    let (x, y) = ((right - left) / (2.0 * STEP_PX), (below - above) / (2.0 * STEP_PX));
    Some(Warp { at: [at.x, at.y], matrix: [[x.x, y.x], [x.y, y.y]] })
}

impl Sample {
    /// The surface's direction as the bending of the patch says it, towards the reference; `None` where lines of sight do not meet.
    pub fn normal(&self, views: &[View]) -> Option<Vector3<f64>> {
        let first = self.seen.first()?;
        let (camera, other) = (&views[self.reference].camera, &views[first.view].camera);
        let at = |dx: f64, dy: f64| {
            let here = camera.ray(&Point2::new(self.pixel[0] + dx, self.pixel[1] + dy))?;
            let there = other.ray(&Point2::from(first.warp.apply([dx, dy])))?;
            triangulate_rays(&[here, there])
        };
        let across = at(STEP_PX, 0.0)? - at(-STEP_PX, 0.0)?;
        let down = at(0.0, STEP_PX)? - at(0.0, -STEP_PX)?;
        let normal = across.cross(&down).try_normalize(0.0)?;
        let towards = camera.centre() - self.position;
        Some(if normal.dot(&towards) < 0.0 { -normal } else { normal })
    }

    /// Where matching of a neighbour that the reference sees at `pixel` is to begin: as this one is bent, and as its plane lies in views that do not see this one.
    pub fn starts_at(&self, views: &[View], pixel: [f64; 2]) -> Vec<(usize, Warp)> {
        let offset = [pixel[0] - self.pixel[0], pixel[1] - self.pixel[1]];
        let mut starts: Vec<(usize, Warp)> = self.seen.iter().map(|it| (it.view, it.warp.beside(offset))).collect();
        if starts.len() + 1 < views.len()
            && let Some(normal) = self.normal(views)
        {
            let from = &views[self.reference].camera;
            for (view, to) in views.iter().enumerate() {
                if view != self.reference
                    && !self.seen.iter().any(|it| it.view == view)
                    && let Some(warp) = plane_warp(from, &to.camera, &self.position, &normal)
                {
                    starts.push((view, warp.beside(offset)));
                }
            }
        }
        starts
    }

    /// How far lines of sight pass the place that they agree on without one view [px]; `None` where that leaves fewer than two, or it does not see the point.
    pub fn misfit_without(&self, views: &[View], view: usize, sigma_px: f64) -> Option<f64> {
        let mut left: Vec<Seen> = self.seen.iter().filter(|it| it.view != view).copied().collect();
        if view != self.reference {
            return (left.len() < self.seen.len() && !left.is_empty())
                .then(|| Some(meet(views, self.reference, self.pixel, &left, sigma_px)?.2))?;
        }
        let first = (left.len() > 1).then(|| left.remove(0))?;
        Some(meet(views, first.view, first.warp.at, &left, sigma_px)?.2)
    }

    /// See [`sigma`] [m].
    pub fn sigma(&self) -> f64 {
        sigma(&self.covariance)
    }
}

/// Standard deviation of a position: the root of the mean variance over the three axes [m].
pub fn sigma(covariance: &Matrix3<f64>) -> f64 {
    (covariance.trace() / 3.0).max(0.0).sqrt()
}
