//! `voxel_body.silhouette`: separates a body from background, shadow and highlight in one camera's pictures.

use std::ops::Range;
use std::sync::Arc;

use foveate::node::detector::{DetectorPorts, DetectorShell};
use foveate::prelude::*;

use crate::finder::{Refusal, SilhouetteFinder};
use crate::on_head::{From, OnHead, Turn};
use crate::panorama::{Behind, known_part};
use crate::settings::SilhouetteSettings;

ports! {
    IMAGE: In<Image> = each("image");
    BACKGROUND: In<Image> = each("background").optional();
    PREDICTED: In<Targets> = latest("predicted").optional();
    POSE: In<HeadPose> = each("pose").optional();
    FEATURES: Out<Features> = "features";
    SILHOUETTE: Out<Silhouette> = "silhouette";
    ALIGNED: Out<HeadPose> = "aligned";
}

const PORTS: DetectorPorts = DetectorPorts { image: &IMAGE, predicted: &PREDICTED, features: &FEATURES };

figures! {
        "detector.features.*": count, neither, "Blobs found in all pictures of the camera";
        "detector.pictures_searched.*": count, neither, "Pictures searched; the pictures of the three figures below are not among them";
        "detector.pictures_learning.*": count, neither, "Pictures used only to learn the background";
        "detector.pictures_flooded.*": count, low, "Pictures not searched because too much of them differed from the background";
    "detector.pictures_refused.*": count, low, "Pictures that could not be read: wrong size, part, colour or pixels";
    "silhouette.seen.*": count, high, "Silhouettes of the camera with a body";
        "silhouette.empty.*": count, neither, "Silhouettes without a body";
    "silhouette.full.*": count, low, "Silhouettes that fill the picture: the background was wrong, such as after a lamp was switched on";
    "silhouette.moved.*": count, low, "Silhouettes of a camera that was moved since the background was learnt";
    "silhouette.body_share.*": share, neither, "Mean part of the camera's picture that is body, over silhouettes with one";
    "silhouette.relit.*": count, neither, "Pictures of the camera whose light differs from the learnt one by more than a tenth";
        "silhouette.views.*": count, neither, "Stored views of the background of a camera on a head";
        "silhouette.without_pose.*": count, low, "Pictures of a camera on a head without a pose";
        "silhouette.unknown.*": count, low, "Pictures of a camera on a head with less than half of the background known";
        "silhouette.aligned.*": share, high, "Pictures of a camera on a head whose pose was corrected by alignment; the others use the stated pose";
    "silhouette.background_refused.*": count, low, "Pictures of the empty scene that could not be learnt from";
}

/// Pictures in; a silhouette of each out, and its blobs with the ports of `blob.detector`.
///
/// The background is learnt from the pictures at `background` (a film of the empty scene, which ends before the person's begins), from a picture that the settings name, or from the camera's own first
/// pictures. Every readable picture gives a silhouette; its status states its quality.
///
/// With `pose` the camera is one on a head: each picture waits for the pose of its time, and the background is a panorama of views that are kept. A silhouette is then of the part of the picture behind which
/// it is known what stands; where that is less than half, its status is `learning`. At `aligned` the poses come out again, better by what the pictures' backgrounds say of them.
pub struct SilhouetteNode {
    finder: SilhouetteFinder,
    on_head: Option<OnHead>,
    /// Whether the calibration says that the camera stands on a head.
    is_on_head: bool,
    learn_frames: u32,
    adapt_frames: f32,
    shell: DetectorShell,
    pool: Pool<Silhouette>,
    camera: Option<CameraId>,
    camera_name: String,
    /// Whether pictures of the empty scene come.
    is_taught: bool,
    tally: Tally,
}

#[derive(Default)]
struct Tally {
    by_status: [u64; 5],
    body_share: f64,
    relit: u64,
    background_refused: u64,
    without_pose: u64,
    unknown: u64,
    aligned: u64,
    first_refusal: Option<String>,
    /// Pictures that are dark all over, and the brightest level in any of them.
    dark: u64,
    brightest_dark: u8,
}

impl Node for SilhouetteNode {
    const TYPE: &'static str = "voxel_body.silhouette";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Separates a body from background, shadow and highlight in one camera's pictures";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SilhouetteSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SilhouetteSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let size = setup.camera_model().map(|it| it.image_size);
        let is_taught = setup.is_connected(&BACKGROUND);
        let on_head = if setup.is_connected(&POSE) {
            let (Some(head), Some(_)) = (setup.head_model(), size) else {
                let name = setup.camera_name().unwrap_or_default();
                let message = format!(
                    "found a pose for `{name}`, which has no head in the calibration, expected `[head.{name}]` there, or no input `pose`"
                );
                return Err(ConfigError::node(message));
            };
            settings.check_on_head()?;
            Some(OnHead::new(head, settings.background_m))
        } else {
            None
        };
        let background = match settings.background.as_str() {
            "" => None,
            _ if is_taught => None,
            text => Some(read_background(&setup.path("background", text)?, size)?),
        };
        Ok(Self {
            on_head,
            is_on_head: setup.head_model().is_some(),
            learn_frames: settings.learn_frames,
            adapt_frames: settings.adapt_frames,
            finder: SilhouetteFinder::new(settings, size, background),
            shell: DetectorShell::new(setup),
            pool: Pool::default(),
            camera: setup.camera,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            is_taught,
            tally: Tally::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let (empty, image) = (io.take(&BACKGROUND), io.take(&IMAGE));
        if let Some(on_head) = &mut self.on_head {
            if let Some(pose) = io.take(&POSE) {
                on_head.pose(pose.value);
            }
            for (image, is_empty) in [(empty, true), (image, false)] {
                if let Some(image) = image {
                    on_head.hold(image, is_empty);
                }
            }
            while let Some(turn) = self.on_head.as_mut().and_then(OnHead::next) {
                self.turned(io, turn);
            }
            return Ok(());
        }
        if let Some(empty) = empty
            && let Err(refusal) = self.finder.teach(&empty.value)
        {
            self.refuse_background(&refusal);
        }
        if let Some(image) = image {
            if self.is_taught {
                self.finder.end_teaching();
            }
            self.find(io, &image, |_, _| ());
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.shell.report(report);
        let (name, tally) = (&self.camera_name, &self.tally);
        let count = |status: SilhouetteStatus| tally.by_status[status as usize];
        let seen = count(SilhouetteStatus::Seen);
        report.figure(format!("silhouette.seen.{name}"), seen as f64);
        if seen > 0 {
            report.figure(format!("silhouette.body_share.{name}"), tally.body_share / seen as f64);
        }
        for (what, n) in [
            ("empty", count(SilhouetteStatus::Empty)),
            ("full", count(SilhouetteStatus::Full)),
            ("moved", count(SilhouetteStatus::Moved)),
            ("relit", tally.relit),
            ("background_refused", tally.background_refused),
        ] {
            if n > 0 {
                report.figure(format!("silhouette.{what}.{name}"), n as f64);
            }
        }
        if let Some(on_head) = &self.on_head {
            report.figure(format!("silhouette.views.{name}"), on_head.n_views() as f64);
            let n = tally.by_status.iter().sum::<u64>() - count(SilhouetteStatus::Learning);
            report.figure(format!("silhouette.aligned.{name}"), tally.aligned as f64 / n as f64);
            for (what, n) in [("without_pose", tally.without_pose), ("unknown", tally.unknown)] {
                if n > 0 {
                    report.figure(format!("silhouette.{what}.{name}"), n as f64);
                }
            }
            if n > 0 && tally.aligned * 2 < n {
                report.remark(format!(
                    "{name}: {} of {n} pictures could be aligned with the background: it has too little texture, or has changed since it was learnt; the others use the stated pose",
                    tally.aligned
                ));
            }
            if tally.unknown > 0 {
                report.remark(format!(
                    "{name}: in {} pictures less than half of the background is known: the head did not look there while learning, expected views of the empty scene in all later directions (`patrol_deg` of `pan_tilt.selector`)",
                    tally.unknown
                ));
            }
        }
        if let Some(refusal) = &tally.first_refusal {
            report.remark(format!("{name}: a picture of the empty scene was not learnt from: {refusal}"));
        }
        if tally.dark > 0 {
            report.remark(format!(
                "{name}: {} pictures are dark: their brightest level is {} of 255, expected {DARK} or more: is its cap on, or the light off?",
                tally.dark, tally.brightest_dark
            ));
        }
        let searched: u64 = tally.by_status.iter().sum();
        if tally.relit as f64 > RELIT * searched as f64 {
            report.remark(format!(
                "{name}: in {} of {searched} pictures the light differs from the background's by more than a tenth: automatic exposure or white balance, or a lamp? Silhouettes are then less accurate",
                tally.relit
            ));
        }
        if count(SilhouetteStatus::Moved) > 0 {
            let n = count(SilhouetteStatus::Moved);
            let why = match (&self.on_head, self.is_on_head) {
                (Some(_), _) => "did it turn while it exposed, or does its light change?",
                (None, true) => "it is on a head, expected `pose` from `pan_tilt.pose`, unless the head never turns",
                (None, false) => "was the camera moved?",
            };
            report.remark(format!("{name}: in {n} pictures the edges of the background have moved: {why}"));
        }
        Ok(())
    }
}

impl SilhouetteNode {
    /// Gives out the silhouette of a picture, after `finish` has had it.
    fn find(
        &mut self,
        io: &mut Io<'_>,
        image: &Stamped<Arc<Image>>,
        finish: impl FnOnce(&mut Silhouette, &SilhouetteFinder),
    ) {
        let Self { finder, shell, pool, tally, .. } = self;
        let mut silhouette = pool.take(Silhouette::default);
        let mut refused = None;
        let unusable = "too much of the picture differs from the learnt background, or the camera was moved";
        shell.search(io, &PORTS, image, unusable, |image, predicted, _, features| {
            if image.pixels.iter().all(|it| *it < DARK) {
                tally.dark += 1;
                tally.brightest_dark = image.pixels.iter().copied().fold(tally.brightest_dark, u8::max);
            }
            let found = finder.find(image, predicted, &mut silhouette, features);
            refused = found.as_ref().err().map(ToString::to_string);
            found
        });
        if let Some(refusal) = refused {
            io.gap(&SILHOUETTE, image.time(), refusal);
            return;
        }
        let is_other = |gain: &f32| (gain - 1.0).abs() > 0.1;
        tally.relit += u64::from(finder.gains().is_some_and(|it| it.iter().any(is_other)));
        finish(&mut silhouette, finder);
        silhouette.camera = self.camera.unwrap_or(silhouette.camera);
        let status = silhouette.status;
        tally.by_status[status as usize] += 1;
        let n_pixels = silhouette.confidence.len().max(1) as f64;
        if status == SilhouetteStatus::Seen {
            tally.body_share += f64::from(silhouette.n_body) / n_pixels;
        }
        io.emit(&SILHOUETTE, image.stamp, pool.share(silhouette));
    }

    fn refuse_background(&mut self, refusal: &Refusal) {
        self.tally.background_refused += 1;
        self.tally.first_refusal.get_or_insert_with(|| refusal.to_string());
    }

    /// A picture of a camera on a head, whose turn it is.
    fn turned(&mut self, io: &mut Io<'_>, turn: Turn) {
        let Some(mut on_head) = self.on_head.take() else { return };
        let Turn { image, is_empty, from } = turn;
        match from {
            None if is_empty => {}
            None => {
                self.tally.without_pose += 1;
                let reason = "the head's pose is unknown";
                io.gap(&FEATURES, image.time(), reason);
                io.gap(&SILHOUETTE, image.time(), reason);
            }
            Some(from) => {
                let is_learning = is_empty || (!self.is_taught && on_head.n_learnt < self.learn_frames);
                let done = if is_learning {
                    self.learn_view(io, &mut on_head, &image, &from, is_empty)
                } else {
                    self.find_before(io, &mut on_head, &image, &from)
                };
                if let Err(refusal) = done {
                    if is_empty {
                        self.refuse_background(&refusal);
                    } else {
                        io.gap(&FEATURES, image.time(), &refusal);
                        io.gap(&SILHOUETTE, image.time(), &refusal);
                    }
                }
            }
        }
        self.on_head = Some(on_head);
    }

    fn learn_view(
        &mut self,
        io: &mut Io<'_>,
        on_head: &mut OnHead,
        image: &Stamped<Arc<Image>>,
        from: &From,
        is_empty: bool,
    ) -> Result<(), Refusal> {
        let panorama = on_head.panorama(&image.value)?;
        let noise = std::f32::consts::FRAC_1_SQRT_2 * panorama.noise().unwrap_or(0.0);
        let behind = panorama.learn(&from.camera, from.sigma_px, &image.value.pixels)?;
        let is_known = |it: &Behind<'_>| 2 * it.covered.iter().filter(|it| **it).count() > it.covered.len();
        if let Some(behind) = behind.filter(is_known) {
            self.finder.set_behind(&image.value, &behind, noise)?;
            self.finder.rehearse(&image.value)?;
        }
        on_head.n_learnt += 1;
        if !is_empty {
            io.emit(&ALIGNED, image.stamp, HeadPose::clone(&from.pose));
            self.emit_unknown(io, image);
        }
        Ok(())
    }

    /// A silhouette that says that its pixels say nothing.
    fn emit_unknown(&mut self, io: &mut Io<'_>, image: &Stamped<Arc<Image>>) {
        let mut silhouette = self.pool.take(Silhouette::default);
        let Image { width, height, window, camera, .. } = *image.value;
        silhouette.camera = self.camera.unwrap_or(camera);
        (silhouette.width, silhouette.height, silhouette.window) = (width, height, window);
        (silhouette.status, silhouette.n_body) = (SilhouetteStatus::Learning, 0);
        silhouette.confidence.clear();
        silhouette.confidence.resize(width as usize * height as usize, 0);
        self.tally.by_status[SilhouetteStatus::Learning as usize] += 1;
        io.emit(&SILHOUETTE, image.stamp, self.pool.share(silhouette));
        io.emit(&FEATURES, image.stamp, Features { camera: self.camera.unwrap_or(camera), list: Vec::new() });
    }

    fn find_before(
        &mut self,
        io: &mut Io<'_>,
        on_head: &mut OnHead,
        image: &Stamped<Arc<Image>>,
        from: &From,
    ) -> Result<(), Refusal> {
        let panorama = on_head.panorama(&image.value)?;
        let noise = std::f32::consts::FRAC_1_SQRT_2 * panorama.noise().unwrap_or(0.0);
        let behind = panorama.behind(&from.camera, from.sigma_px, &image.value.pixels)?;
        let turned = behind.turned;
        let mut pose = HeadPose::clone(&from.pose);
        if let Some(turned) = turned {
            pose.camera_from_world = turned * pose.camera_from_world;
        }
        io.emit(&ALIGNED, image.stamp, pose);
        let size = [image.value.width, image.value.height].map(|it| it as usize);
        let part = known_part(behind.covered, size);
        if 2 * part[0].len() * part[1].len() < size[0] * size[1] {
            self.tally.unknown += 1;
            self.emit_unknown(io, image);
            return Ok(());
        }
        self.tally.aligned += u64::from(turned.is_some());
        self.finder.set_behind(&image.value, &behind, noise)?;
        let (share, mut taught) = (1.0 / self.adapt_frames, None);
        self.find(io, image, |silhouette, finder| {
            if turned.is_some() && silhouette.status.is_usable() {
                let is_plain = silhouette.confidence.iter().map(|it| *it < PLAIN).collect::<Vec<bool>>();
                taught = Some((is_plain, finder.gains().unwrap_or([1.0; 3])));
            }
            crop(silhouette, &part);
        });
        if let Some((is_plain, gains)) = taught {
            on_head.panorama(&image.value)?.follow(&from.camera, &image.value.pixels, |at| is_plain[at], &gains, share);
        }
        Ok(())
    }
}

/// Below this confidence a pixel is plain background, and the background follows it.
const PLAIN: u8 = 64;

/// Leaves of the silhouette of a whole picture these columns and rows.
fn crop(silhouette: &mut Silhouette, [columns, rows]: &[Range<usize>; 2]) {
    let width = silhouette.width as usize;
    if columns.len() == width && rows.len() == silhouette.height as usize {
        return;
    }
    let mut to = 0;
    for y in rows.clone() {
        let from = y * width + columns.start;
        silhouette.confidence.copy_within(from..from + columns.len(), to);
        to += columns.len();
    }
    silhouette.confidence.truncate(to);
    (silhouette.width, silhouette.height) = (columns.len() as u32, rows.len() as u32);
    silhouette.window = foveate::messages::Window { left: columns.start as u32, top: rows.start as u32, shrink: 1 };
    silhouette.n_body = silhouette.confidence.iter().filter(|it| **it >= Silhouette::BODY).count() as u32;
}

/// Other light in this part of the pictures and more is said in words [–].
const RELIT: f64 = 0.1;

/// A picture without any pixel of this level shows nothing: dark current and noise make less [gray level].
const DARK: u8 = 16;

/// Reads a picture in colour. Where it is larger than the camera's pictures, their part of it, from the top left.
fn read_background(path: &std::path::Path, size: Option<[u32; 2]>) -> Result<Image, ConfigError> {
    let refuse = |text: String| ConfigError::at("background", text);
    let picture = image::open(path).map_err(|error| refuse(format!("`{}` cannot be read: {error}", path.display())))?;
    let rgb = picture.into_rgb8();
    let [w, h] = size.unwrap_or([rgb.width(), rgb.height()]);
    if rgb.width() < w || rgb.height() < h {
        let (a, b) = rgb.dimensions();
        return Err(refuse(format!("`{}` is {a} x {b} px, expected at least {w} x {h} px", path.display())));
    }
    let pixels = image::imageops::crop_imm(&rgb, 0, 0, w, h).to_image().into_raw();
    Ok(Image { width: w, height: h, format: PixelFormat::Rgb8, pixels, ..Image::default() })
}

#[cfg(test)]
mod turning;

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    const SIZE: [u32; 2] = [96, 72];

    fn setup(connected: &[&str]) -> Setup {
        let connected = connected.iter().map(|it| (*it).to_owned()).collect();
        Setup { connected, ..Setup::for_tests() }
    }

    fn picture(x: Option<u32>, light: f32, format: PixelFormat) -> Image {
        let [width, height] = SIZE;
        let level = |at: u32| {
            let (column, row) = (at % width, at / width);
            let body = x.is_some_and(|x| (x..x + 20).contains(&column) && (20..60).contains(&row));
            let hole = x.is_some_and(|x| (x + 8..x + 11).contains(&column) && (40..43).contains(&row));
            let stripe = if column / 6 % 2 == 0 { 1.0 } else { 0.8 };
            if body && !hole { [200.0, 40.0, 40.0] } else { [80.0, 120.0, 100.0].map(|it| it * stripe) }
        };
        let rgb = (0..width * height).flat_map(|at| level(at).map(|it| (it * light) as u8));
        let pixels = match format {
            PixelFormat::Rgb8 => rgb.collect(),
            PixelFormat::Gray8 => rgb.skip(1).step_by(3).collect(),
        };
        Image { camera: CameraId(0), width, height, format, pixels, ..Image::default() }
    }

    fn settings() -> SilhouetteSettings {
        SilhouetteSettings { learn_frames: 4, min_area_px: 50, ..SilhouetteSettings::default() }
    }

    fn statuses(bench: &mut NodeBench<SilhouetteNode>) -> Vec<(SilhouetteStatus, u32)> {
        bench.outputs(&SILHOUETTE).iter().map(|it| (it.value.status, it.value.n_body)).collect()
    }

    #[test]
    fn pictures_that_are_dark_are_told() {
        for (light, is_dark) in [(0.05, true), (1.0, false)] {
            let mut bench = NodeBench::<SilhouetteNode>::with_setup(settings(), &setup(&[])).unwrap();
            for at in 0..8_u32 {
                let image = picture(None, if at < 6 { 1.0 } else { light }, PixelFormat::Rgb8);
                bench.feed(&IMAGE, Time::from_s(f64::from(at) / 25.0), image).unwrap();
            }
            let remarks = bench.finish().unwrap().remarks.join("; ");
            assert_eq!(
                remarks.contains("2 pictures are dark: their brightest level is 6 of 255"),
                is_dark,
                "{remarks}"
            );
        }
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<SilhouetteNode>("");
        check_node::<SilhouetteNode>("shadow_ratio = 0.6\nmasks = [[[0, 0], [10, 0], [0, 10.5]]]");
    }

    #[test]
    fn a_body_is_seen_in_colour_and_in_gray_whole_and_named_empty_full_or_learning_otherwise() {
        for format in [PixelFormat::Rgb8, PixelFormat::Gray8] {
            let mut bench = NodeBench::<SilhouetteNode>::new(settings()).unwrap();
            let mut time = 0_u32;
            let mut feed = |image: Image| {
                time += 20;
                bench.feed(&IMAGE, Time::from_s(f64::from(time) / 1e3), image).unwrap();
            };
            (0..4).for_each(|_| feed(picture(None, 1.0, format)));
            feed(picture(Some(30), 1.0, format));
            feed(picture(None, 1.0, format));
            let mut strange = picture(None, 1.0, format);
            strange.pixels.iter_mut().zip(0_u32..).for_each(|(it, at)| *it = (at * 7919 % 251) as u8);
            feed(strange);
            let found = statuses(&mut bench);
            assert_eq!(found[0].0, SilhouetteStatus::Learning);
            assert_eq!(found[4].0, SilhouetteStatus::Seen);
            // With the hole of 3 × 3; corners may be rounded.
            assert!((790..=800).contains(&found[4].1), "{format:?}: {}", found[4].1);
            assert_eq!(found[5], (SilhouetteStatus::Empty, 0));
            assert!(matches!(found[6].0, SilhouetteStatus::Full | SilhouetteStatus::Moved), "{:?}", found[6].0);
            assert_eq!(
                bench.outputs(&FEATURES).iter().map(|it| it.value.list.len()).collect::<Vec<_>>(),
                [0, 0, 0, 0, 1, 0]
            );
            let figures = bench.finish().unwrap().figures;
            assert_eq!(figures["silhouette.seen.test.node"], 1.0);
        }
    }

    #[test]
    fn a_film_of_the_empty_scene_teaches_and_who_is_there_from_the_start_is_seen() {
        let mut bench = NodeBench::<SilhouetteNode>::with_setup(settings(), &setup(&["background"])).unwrap();
        // Fewer pictures than asked for: they have to do. One is broken.
        for k in 0..3 {
            bench.feed(&BACKGROUND, Time::from_s(f64::from(k) / 1e3), picture(None, 1.0, PixelFormat::Rgb8)).unwrap();
        }
        let broken = Image { pixels: vec![0; 7], ..picture(None, 1.0, PixelFormat::Rgb8) };
        bench.feed(&BACKGROUND, Time::from_s(0.004), broken).unwrap();
        bench.feed(&IMAGE, Time::from_s(0.02), picture(Some(40), 1.0, PixelFormat::Rgb8)).unwrap();
        bench.feed(&IMAGE, Time::from_s(0.04), picture(Some(40), 0.7, PixelFormat::Rgb8)).unwrap();
        let found = statuses(&mut bench);
        assert!(found.iter().all(|it| it.0 == SilhouetteStatus::Seen && (780..=810).contains(&it.1)), "{found:?}");
        let figures = bench.finish().unwrap().figures;
        assert_eq!(
            (figures["silhouette.background_refused.test.node"], figures["silhouette.relit.test.node"]),
            (1.0, 1.0)
        );
    }

    #[test]
    fn what_is_no_picture_of_the_camera_is_a_gap_and_the_next_is_searched() {
        let mut bench = NodeBench::<SilhouetteNode>::new(settings()).unwrap();
        for k in 0..4 {
            bench.feed(&IMAGE, Time::from_s(f64::from(k) / 1e3), picture(None, 1.0, PixelFormat::Rgb8)).unwrap();
        }
        bench.feed(&IMAGE, Time::from_s(0.005), picture(None, 1.0, PixelFormat::Gray8)).unwrap();
        bench.feed(&IMAGE, Time::from_s(0.006), picture(Some(10), 1.0, PixelFormat::Rgb8)).unwrap();
        assert_eq!(bench.outputs(&SILHOUETTE).len(), 5);
        assert!(bench.gaps(&SILHOUETTE)[0].reason.contains("the picture is gray, the background in colour"));
    }
}
