//! A surface at one moment: seeds, growth and remarks, shared by the matcher and the tracker.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate::imaging::matching::Warp;
use foveate::prelude::*;
use nalgebra::{Point2, Point3, Vector3};

use crate::bent::{Straight, straightened};
use crate::cover::{Covered, LeftOut, cover, pieces, remove};
use crate::in_step::{InStep, OFF_LINES};
use crate::measure::{Measurer, Sample, plane_warp};
use crate::repeats::Repeats;
use crate::seeds::{SeedCounts, find_seeds};
use crate::settings::{NamedSeed, Prepared};
use crate::views::{Moment, View};

/// Matches surfaces; counts what it does.
#[derive(Debug)]
pub struct Engine {
    /// What it works with.
    pub prepared: Prepared,
    /// Of points.
    pub measurer: Measurer,
    /// Of seeds.
    pub seeds: SeedCounts,
    /// Moments at which seeds were searched.
    begun: u64,
    /// Named seeds that found nothing, by their number in the settings.
    pub bad_seeds: BTreeMap<usize, String>,
    /// Of what was left out after growing.
    pub left_out: LeftOut,
    /// Points given out, and those of them that a view before which they lie does not see.
    given: (u64, u64),
    repeats: Repeats,
    /// By piece of surface that looks as good elsewhere: how far off [m].
    elsewhere_m: Vec<f64>,
    /// By piece of surface of which cameras contradict each other: how far [m]; and of the last moment how many points.
    contradicted_m: Vec<f64>,
    contradicted: usize,
    in_step: InStep,
}

/// A view sees a surface well whose normal is within 60° of its direction, [–]
const FACING: f64 = 0.5;
/// and of points that lie so a larger part than this is seen unless something is wrong [–].
const UNSEEN: f64 = 0.5;

/// Points of smooth surfaces that neighbours disown are a hundredth; where they are more than this part, it is said [–].
const ALONE: f64 = 0.3;

/// Of a surface that the volume cuts, points found just beyond it are more than this part of those that were measured [–].
const CUT: f64 = 0.01;

/// A camera sees another side of a thing than the reference does from 75° on, as the cosine [–].
const ASIDE: f64 = 0.26;

/// Cameras that see one surface stand nearer to each other [m].
const FAR_APART_M: f64 = 20.0;

/// So many patches off their epipolar lines are no chance [–].
const LEAST_MISFITS: f64 = 20.0;

/// A named seed is good to so many pixels.
const NAMED_PX: f64 = 4.0;

impl Engine {
    /// Without anything counted yet.
    pub fn new(prepared: Prepared) -> Self {
        Self {
            prepared,
            measurer: Measurer::default(),
            seeds: SeedCounts::default(),
            begun: 0,
            bad_seeds: BTreeMap::new(),
            left_out: LeftOut::default(),
            given: (0, 0),
            repeats: Repeats::default(),
            elsewhere_m: Vec::new(),
            contradicted_m: Vec::new(),
            contradicted: 0,
            in_step: InStep::default(),
        }
    }

    /// Takes a set of pictures, each as a pyramid of `n_levels`; those that cannot be used are named.
    pub fn take(&mut self, moment: &mut Moment, images: &[Stamped<Arc<Image>>], n_levels: usize) -> Vec<String> {
        let Self { prepared, in_step, contradicted, .. } = self;
        *contradicted = 0;
        let (stuck, mut faults) = in_step.stuck(&prepared.views, images);
        let shown: Vec<_> = images.iter().filter(|it| !stuck.contains(&it.value.camera)).cloned().collect();
        faults.extend(moment.take(&prepared.views, &shown, n_levels));
        faults
    }

    /// Why the points of a moment are not sent: their cameras are not synchronised, or one was moved; otherwise they are counted, with whether all views that face them see them.
    pub fn give<'a>(&mut self, points: impl Iterator<Item = (&'a Sample, &'a Vector3<f64>)> + Clone) -> Option<String> {
        let misfits = self.misfits();
        let samples: Vec<&Sample> = points.clone().map(|it| it.0).collect();
        if self.contradicted > samples.len() {
            return Some(format!(
                "some cameras see {} points at another depth than others do, and only {} points are left",
                self.contradicted,
                samples.len()
            ));
        }
        let Prepared { views, measure, .. } = &self.prepared;
        let why = self.in_step.judge(views, &samples, measure, [self.measurer.measured as f64, misfits]);
        if why.is_none() {
            points.for_each(|(sample, normal)| self.count(sample, normal));
        }
        why
    }

    /// Factor on the variances of the last moment's points, for cameras that contradict each other [–].
    pub fn widened(&self) -> f64 {
        self.in_step.widened()
    }

    /// Patches that were recognised in another view off their epipolar lines.
    fn misfits(&self) -> f64 {
        self.measurer.refused.get("misfit").copied().unwrap_or(0) as f64
    }

    fn count(&mut self, sample: &Sample, normal: &Vector3<f64>) {
        let is_seen = |view: usize| view == sample.reference || sample.seen.iter().any(|it| it.view == view);
        let is_unseen = self.prepared.views.iter().enumerate().any(|(view, it)| {
            let towards = (it.camera.centre() - sample.position).normalize();
            !is_seen(view) && normal.dot(&towards) > FACING && it.camera.sees(&sample.position).is_some()
        });
        self.given = (self.given.0 + 1, self.given.1 + u64::from(is_unseen));
    }

    /// Takes another of the references.
    pub fn look_from(&mut self, number: usize) {
        let (reference, distance_m) = self.prepared.references[number];
        self.prepared.reference = reference;
        self.prepared.seeds.distance_m = distance_m;
    }

    /// Whether the settings name seeds that the reference sees.
    pub fn is_named(&self) -> bool {
        self.prepared.named.iter().flatten().any(|it| it.0 == self.prepared.reference)
    }

    /// Seeds of a moment: those that were named, or found.
    pub fn begin(&mut self, moment: &Moment) -> Vec<Sample> {
        self.begun += 1;
        let Prepared { views, reference, measure, seeds, named, .. } = &self.prepared;
        if !self.is_named() {
            let (found, counts) = find_seeds(&mut self.measurer, views, moment, *reference, measure, seeds);
            self.seeds.tried += counts.tried;
            self.seeds.ambiguous += counts.ambiguous;
            self.seeds.even += counts.even;
            self.seeds.unlike += counts.unlike;
            self.seeds.refused += counts.refused;
            self.seeds.found += counts.found;
            return found;
        }
        let mut samples = Vec::new();
        let seen = |it: &(usize, &NamedSeed)| it.1.iter().any(|it| it.0 == *reference);
        for (number, seed) in named.iter().enumerate().filter(seen) {
            self.seeds.tried += 1;
            match named_sample(&mut self.measurer, &self.prepared, moment, seed) {
                Ok(sample) => {
                    self.seeds.found += 1;
                    samples.push(sample);
                }
                Err(why) => {
                    self.bad_seeds.insert(number, why);
                }
            }
        }
        samples
    }

    /// The surface connected to `seeds`. Pieces without a named or tracked (`are_known`) seed are left out where their texture repeats, as they may
    /// be at another depth.
    pub fn grow(&mut self, moment: &Moment, seeds: &[Sample], are_known: bool) -> Vec<Covered> {
        let Prepared { views, reference, measure, cover: options, .. } = &self.prepared;
        let (mut found, left_out) = cover(&mut self.measurer, views, moment, *reference, seeds, measure, options);
        self.left_out.alone += left_out.alone;
        self.left_out.disordered += left_out.disordered;
        self.left_out.piece += left_out.piece;
        self.left_out.cut += left_out.cut;
        let mut out = Vec::new();
        for piece in pieces(&found, &views[*reference].camera, options) {
            if are_known && piece.iter().any(|it| found[*it].seed.is_some()) {
                continue;
            }
            let distance_m = self.prepared.seeds.distance_m;
            if let Some(doubt) = self.repeats.doubt(views, moment, &found, &piece, measure, distance_m) {
                // Of clouds of several references it is settled between them which camera it is.
                if doubt.is_contradicted && self.prepared.references.len() > 1 {
                    continue;
                }
                let (offs, count) = if doubt.is_contradicted {
                    self.contradicted += piece.len();
                    (&mut self.contradicted_m, &mut self.left_out.contradicted)
                } else {
                    (&mut self.elsewhere_m, &mut self.left_out.repeats)
                };
                offs.push(doubt.off_m);
                *count += piece.len() as u64;
                out.extend(piece);
            }
        }
        remove(&mut found, &out);
        found
    }

    /// Where points lie with the bending of the surface taken off, by which patches that are matched as flat ones are off.
    pub fn straightened(&self, samples: &[&Sample]) -> Vec<Straight> {
        straightened(&self.prepared.views, samples, &self.prepared.measure, self.prepared.cover.spacing_px)
    }

    /// As a message, colours from the reference's picture; `places` of the points, see [`Engine::straightened`].
    pub fn cloud(&self, moment: &Moment, surface: &[Covered], places: &[Straight], name: String) -> PointCloud {
        let view = &self.prepared.views[self.prepared.reference];
        let mut cloud = PointCloud {
            time: moment.time,
            camera: view.id,
            name,
            camera_size: view.camera.image_size,
            viewpoint: Some(Viewpoint { camera_from_space: view.camera.camera_from_world }),
            ..PointCloud::default()
        };
        let picture = moment.pictures[self.prepared.reference].as_ref();
        for (it, (position, covariance)) in surface.iter().zip(places) {
            let [x, y] = it.sample.pixel;
            let level =
                picture.and_then(|it| it.finest().at(x, y)).map_or(255, |it| it.round().clamp(0.0, 255.0) as u8);
            cloud.push(&CloudPoint {
                position: position.cast(),
                covariance: (covariance * self.widened()).cast(),
                normal: it.normal.cast(),
                confidence: it.confidence as f32,
                pixel: [x.round() as u16, y.round() as u16],
                colour: [level; 3],
            });
        }
        cloud
    }

    /// Figures of all moments so far.
    pub fn report(&self, report: &mut Report) {
        report.figure("surface.measured", self.measurer.measured as f64);
        for (reason, count) in &self.measurer.refused {
            report.figure(format!("surface.refused.{reason}"), *count as f64);
        }
        report.figure("surface.refused.alone", self.left_out.alone as f64);
        report.figure("surface.refused.disordered", self.left_out.disordered as f64);
        report.figure("surface.refused.piece", self.left_out.piece as f64);
        report.figure("surface.refused.repeats", self.left_out.repeats as f64);
        report.figure("surface.refused.contradicted", self.left_out.contradicted as f64);
        if let Some(off) = foveate::estimation::statistics::median(&self.contradicted_m) {
            report.remark(format!(
                "{} points of {} pieces of surface were left out: their depth differs by {:.1} mm between cameras: one was moved since it was calibrated, its calibration is wrong, or it is \
                 not synchronised",
                self.left_out.contradicted,
                self.contradicted_m.len(),
                1e3 * off
            ));
        }
        let off = foveate::estimation::statistics::median(&self.elsewhere_m).unwrap_or(0.0);
        if !self.elsewhere_m.is_empty() {
            report.remark(format!(
                "{} points of {} pieces of surface were left out: most of their patches match as well at another depth, {:.0} mm off: the texture repeats; expected another texture, `seeds` \
                 chosen by hand, a `volume_m` or `distance_m` with one possible depth, or one more camera",
                self.left_out.repeats,
                self.elsewhere_m.len(),
                1e3 * off
            ));
        }
        let misfits = self.misfits();
        let attempts = self.measurer.measured as f64 + misfits;
        if misfits > LEAST_MISFITS && misfits > OFF_LINES * attempts && self.given.0 == 0 {
            report.remark(format!(
                "{:.0} % of the patches that were recognised in another view are off their epipolar lines there: the calibration does not match these pictures (cameras exchanged, pictures mirrored, \
                 rotated or cropped, a camera moved since), or cameras are not synchronised; no points are sent, as accidental matches on the lines are unreliable",
                100.0 * misfits / attempts
            ));
        }
        let alone = self.left_out.alone as f64 / self.measurer.measured as f64;
        if alone > ALONE {
            report.remark(format!(
                "{:.0} % of the points that were measured were left out, because few of their neighbours are in one plane with them within {} of the distance (`step`) and their uncertainty: where the surface \
                 is curved that much from point to point, use a smaller `spacing_px` or a larger `step`; otherwise the calibration has changed, or the texture is poor",
                100.0 * alone,
                self.prepared.cover.step
            ));
        }
        if self.left_out.cut as f64 > CUT * self.measurer.measured as f64 {
            report.remark(format!(
                "the surface extends beyond the scale's `volume_m`: {} neighbouring points were found outside; these are not measured, which is right where the volume excludes other objects",
                self.left_out.cut
            ));
        }
        self.in_step.report(report);
        self.units().into_iter().for_each(|it| report.remark(it));
        let unseen = self.given.1 as f64 / self.given.0 as f64;
        report.figure("surface.unseen", unseen);
        if unseen > UNSEEN {
            report.remark(format!(
                "{:.0} % of the points are not seen by some camera that they face, and two views may confirm them: cameras are not synchronised (by a field, or a frame), one has moved since it was \
                 calibrated, or something occludes them; `surface.min_views = 3` leaves out points without a third camera",
                100.0 * unseen
            ));
        }
        report.figure("surface.seeds.tried", self.seeds.tried as f64);
        report.figure("surface.seeds.ambiguous", self.seeds.ambiguous as f64);
        report.figure("surface.seeds.found", self.seeds.found as f64);
        for (number, why) in &self.bad_seeds {
            report.remark(format!(
                "seed {} of `seeds` was not found on a surface that all its cameras see: {why}",
                number + 1
            ));
        }
        if self.prepared.named.is_empty()
            && self.begun > 0
            && self.given.0 == 0
            && self.elsewhere_m.is_empty()
            && self.contradicted_m.is_empty()
            && self.in_step.n_left_out() == 0
        {
            report.remark(self.why_nothing());
        }
    }

    /// Cameras that stand as far apart as those of no rig do.
    fn units(&self) -> Option<String> {
        let views = &self.prepared.views;
        let from = views[self.prepared.reference].camera.centre();
        let away = views.iter().map(|it| (it.camera.centre() - from).norm());
        let nearest = away.filter(|it| *it > 0.0).reduce(f64::min).filter(|it| *it > FAR_APART_M)?;
        Some(format!(
            "the reference and the nearest camera are {nearest:.0} m apart in the calibration: is it in millimetres \
             (`foveate convert --metres-per-unit 0.001`)?"
        ))
    }

    /// Cameras that see sides of which the reference sees nothing, where there is one reference.
    pub fn other_sides(&self) -> Option<String> {
        let Prepared { views, reference, references, .. } = &self.prepared;
        let axis = |it: &View| it.camera.camera_from_world.inverse() * Vector3::z();
        let from = &views[*reference];
        let is_aside = |it: &&View| axis(it).dot(&axis(from)) < ASIDE;
        let n = views.iter().filter(is_aside).count();
        (references.len() == 1 && n > 0).then(|| {
            format!(
                "{n} cameras look from another side than the reference, `{}`; surface that the reference does not see is not measured",
                from.name
            )
        })
    }

    /// Why no point was sent, from the counts of seeds.
    fn why_nothing(&self) -> String {
        let SeedCounts { tried, ambiguous, even, unlike, refused, found } = self.seeds;
        let nothing = match found {
            0 => "no seed was found".to_owned(),
            _ => format!("no surface grew from {found} seeds"),
        };
        if tried == 0 {
            let name = &self.prepared.views[self.prepared.reference].name;
            return format!("{nothing}: no patch in the pictures of the reference `{name}` has texture");
        }
        let looked = format!(
            "{nothing}: of {tried} textured patches that were searched along their epipolar lines {ambiguous} have a second place that is as good, {even} look alike all along them, and {unlike} match \
             nowhere;"
        );
        // Of points that were tried from seeds, too; without points there are few.
        let most = self.measurer.refused.iter().max_by_key(|it| it.1).map_or("", |it| it.0).replace('_', " ");
        if refused > ambiguous.max(even).max(unlike) {
            return format!(
                "{looked} {refused} were found at coarse resolution and refused at full resolution, most often for \u{201c}{most}\u{201d} (`surface.refused.*`): expected pictures of all cameras as sharp and as \
                 clear as each other, and the matching calibration"
            );
        }
        if 2 * ambiguous > tried {
            format!("{looked} the texture repeats: expected another texture, or `seeds` chosen by hand")
        } else if even > ambiguous.max(unlike) {
            format!(
                "{looked} expected more texture, three or four blobs to a patch of `patch_px`: finer pictures, larger patches, or a pattern that is projected"
            )
        } else {
            format!(
                "{looked} expected similar patches in two views: pictures of the calibrated cameras (not exchanged, mirrored, rotated or cropped), taken at the same time, with the surface at the \
                 distances given, and texture on it: three or four blobs to a patch"
            )
        }
    }
}

/// Named places to a point: bent as a plane between the views would be.
fn named_sample(
    measurer: &mut Measurer,
    prepared: &Prepared,
    moment: &Moment,
    seed: &NamedSeed,
) -> Result<Sample, String> {
    let Prepared { views, reference, measure, .. } = prepared;
    let Some((_, pixel)) = seed.iter().find(|it| it.0 == *reference) else { return Err("not in the reference".into()) };
    let from = &views[*reference].camera;
    let mut starts = Vec::new();
    for (view, place) in seed.iter().filter(|it| it.0 != *reference) {
        let to = &views[*view].camera;
        let rays = from.ray(&Point2::from(*pixel)).zip(to.ray(&Point2::from(*place)));
        let point: Option<Point3<f64>> = rays
            .and_then(|(a, b)| foveate::geometry::triangulate_rays(&[a, b]))
            .filter(|it| (from.camera_from_world * it).z > 0.0);
        let bent = point.and_then(|point| {
            let towards = (from.centre() - point).normalize() + (to.centre() - point).normalize();
            plane_warp(from, to, &point, &towards.normalize())
        });
        starts.push((*view, Warp { at: *place, ..bent.unwrap_or(Warp::shift(*place)) }));
    }
    let mut loose = measure.clone();
    loose.matching.max_shift_px = loose.matching.max_shift_px.max(NAMED_PX);
    measurer.measure(views, moment, *reference, *pixel, &starts, &loose).map_err(|it| it.name().replace('_', " "))
}
