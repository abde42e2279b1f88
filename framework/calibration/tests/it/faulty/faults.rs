//! What goes wrong with recordings, done to one on purpose.

use foveate_calibration::recording::{CameraFrame, Recording, Spot};
use foveate_estimation::Random;
use nalgebra::{Point2, Rotation3, Vector3};

/// What is done to the rows of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// Nothing.
    Clean,
    /// x → width − 1 − x.
    Mirrored,
    /// Both coordinates.
    UpsideDown,
    /// Its rows and those of another camera exchanged throughout.
    Swapped,
    /// The same from the middle of the recording on.
    SwappedHalf,
    /// Its rows are of so many frames before.
    Late(usize),
    /// Its times are later by this part of a frame.
    LatePart(f64),
    /// This part of its rows is missing.
    Dropped(f64),
    /// It turns by so much in the middle of the recording [mrad].
    Knocked(f64),
    /// Its picture shifts by so much, along its rows, in the middle of the recording [px].
    Shifted(f64),
    /// This part of its rows is anywhere in its picture.
    Random(f64),
    /// Rows without a number, and rows that stand there twice.
    NaNAndTwice,
    /// Its focal length is stated to be this many times as long as it is.
    WrongFocal(f64),
    /// Its pixels are this many times as wide as they are stated to be.
    WrongPixelShape(f64),
    /// Pixels count from 1.
    OriginOff,
    /// It shares so many frames with the others.
    FewCommon(usize),
    /// No fault: the first half of the recording, or the last.
    Half { first: bool },
    /// No fault: so many frames from the one of that number on.
    Window { from: usize, n: usize },
    /// No fault: all of its rows are gone.
    Without,
    /// No fault: pictures taken so many times a second.
    Rate(f64),
}

impl Fault {
    /// The causes by one of which it is to be named; none for a fault that cannot be seen from nothing.
    pub fn causes(self, optics_known: bool) -> &'static [&'static str] {
        match self {
            Fault::UpsideDown if optics_known => &["upside_down", "wrong_lens"],
            Fault::Swapped if optics_known => &["rows_swapped"],
            Fault::Clean | Fault::UpsideDown | Fault::Swapped | Fault::Dropped(_) => &[],
            Fault::NaNAndTwice | Fault::OriginOff => &[],
            Fault::Half { .. } | Fault::Window { .. } | Fault::Without | Fault::Rate(_) => &[],
            Fault::Mirrored => &["mirrored"],
            Fault::SwappedHalf => &["rows_swapped"],
            Fault::Late(_) | Fault::LatePart(_) => &["late"],
            Fault::Knocked(_) | Fault::Shifted(_) => &["moved"],
            Fault::Random(_) => &["false_observations"],
            Fault::WrongFocal(_) if !optics_known => &[],
            Fault::WrongFocal(_) => &["wrong_lens"],
            Fault::WrongPixelShape(_) => &["wrong_pixel_shape", "wrong_lens"],
            Fault::FewCommon(_) => &["too_few_common", "few_observations"],
        }
    }

    /// The recording with it in `camera`; `None` where that camera cannot have it.
    pub fn done_to(self, given: &Recording, camera: usize, seed: u64) -> Option<Recording> {
        let mut recording = given.clone();
        let n = recording.cameras.len();
        let other = (camera + 1) % n;
        let mut random = Random::new(seed).fork("fault");
        let axis = Vector3::new(random.normal(), random.normal(), 0.4 * random.normal()).normalize();
        let model = given.cameras[camera].camera.clone();
        let [width, height] = model.image_size.map(f64::from);
        let own = |it: &CameraFrame| it.camera == camera;
        let times: Vec<f64> = given.camera_frames.iter().filter(|it| own(it)).map(|it| it.time_s).collect();
        let middle_s = times[times.len() / 2];
        let mut change = |recording: &mut Recording, to: &mut dyn FnMut(f64, &mut Spot, &mut Random)| {
            for camera_frame in recording.camera_frames.iter_mut().filter(|it| it.camera == camera) {
                let time_s = camera_frame.time_s;
                camera_frame.spots.iter_mut().for_each(|it| to(time_s, it, &mut random));
            }
        };
        match self {
            Fault::Clean => {}
            Fault::Mirrored => change(&mut recording, &mut |_, it, _| it.pixel.x = width - 1.0 - it.pixel.x),
            Fault::UpsideDown => change(&mut recording, &mut |_, it, _| {
                it.pixel = Point2::new(width - 1.0 - it.pixel.x, height - 1.0 - it.pixel.y);
            }),
            Fault::Swapped | Fault::SwappedHalf => {
                if given.cameras[other].camera.image_size != model.image_size {
                    return None;
                }
                let from_s = if self == Fault::Swapped { f64::NEG_INFINITY } else { middle_s };
                for camera_frame in recording.camera_frames.iter_mut().filter(|it| it.time_s >= from_s) {
                    camera_frame.camera = match camera_frame.camera {
                        it if it == camera => other,
                        it if it == other => camera,
                        it => it,
                    };
                }
                recording.camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
            }
            Fault::Late(frames) => {
                let places: Vec<usize> =
                    (0..given.camera_frames.len()).filter(|it| own(&given.camera_frames[*it])).collect();
                for (index, place) in places.iter().enumerate() {
                    recording.camera_frames[*place].spots = match index.checked_sub(frames) {
                        Some(before) => given.camera_frames[places[before]].spots.clone(),
                        None => Vec::new(),
                    };
                }
            }
            Fault::LatePart(part) => {
                let gaps = times.windows(2).map(|it| it[1] - it[0]).filter(|it| *it > 0.0);
                let late_s = part * gaps.fold(f64::INFINITY, f64::min);
                recording.camera_frames.iter_mut().filter(|it| own(it)).for_each(|it| it.time_s += late_s);
                recording.camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.camera.cmp(&b.camera)));
            }
            Fault::Dropped(share) => {
                recording.camera_frames.retain(|it| !own(it) || random.uniform_in(0.0, 1.0) >= share);
            }
            Fault::Knocked(mrad) => {
                let turn = Rotation3::new(axis * 1e-3 * mrad);
                change(&mut recording, &mut |time_s, it, _| {
                    if time_s >= middle_s {
                        let [fx, fy] = model.intrinsics.focal;
                        let [cx, cy] = model.intrinsics.principal;
                        let ray = turn * Vector3::new((it.pixel.x - cx) / fx, (it.pixel.y - cy) / fy, 1.0);
                        it.pixel = Point2::new(fx * ray.x / ray.z + cx, fy * ray.y / ray.z + cy);
                    }
                });
            }
            Fault::Shifted(px) => change(&mut recording, &mut |time_s, it, _| {
                if time_s >= middle_s {
                    it.pixel.x += px;
                }
            }),
            Fault::Random(share) => change(&mut recording, &mut |_, it, random| {
                if random.uniform_in(0.0, 1.0) < share {
                    it.pixel = Point2::new(random.uniform_in(0.0, width - 1.0), random.uniform_in(0.0, height - 1.0));
                }
            }),
            Fault::NaNAndTwice => {
                change(&mut recording, &mut |_, it, random| {
                    if random.uniform_in(0.0, 1.0) < 0.1 {
                        it.pixel.x = f64::NAN;
                    }
                });
                for camera_frame in recording.camera_frames.iter_mut().filter(|it| it.camera == camera) {
                    let again = camera_frame.spots.clone();
                    camera_frame.spots.extend(again);
                }
                let twice: Vec<CameraFrame> = recording.camera_frames.iter().step_by(7).cloned().collect();
                recording.camera_frames.extend(twice);
            }
            Fault::WrongFocal(factor) => {
                if recording.cameras[camera].free.focal {
                    return None;
                }
                let focal = &mut recording.cameras[camera].camera.intrinsics.focal;
                *focal = focal.map(|it| it * factor);
            }
            Fault::WrongPixelShape(factor) => {
                change(&mut recording, &mut |_, it, _| it.pixel.y = (it.pixel.y - 0.5 * height) / factor + 0.5 * height)
            }
            Fault::OriginOff => change(&mut recording, &mut |_, it, _| it.pixel += nalgebra::Vector2::new(1.0, 1.0)),
            Fault::Half { first } => {
                let (from_s, to_s) =
                    (given.camera_frames[0].time_s, given.camera_frames[given.camera_frames.len() - 1].time_s);
                recording.camera_frames.retain(|it| (it.time_s < 0.5 * (from_s + to_s)) == first);
            }
            Fault::Window { from, n } => {
                let mut starts: Vec<f64> = given.camera_frames.iter().map(|it| it.time_s).collect();
                starts.dedup();
                let [from_s, to_s] = [*starts.get(from)?, *starts.get(from + n)?];
                recording.camera_frames.retain(|it| it.time_s >= from_s && it.time_s < to_s);
            }
            Fault::Without => recording.camera_frames.retain(|it| !own(it)),
            Fault::Rate(hz) => {
                let gaps = times.windows(2).map(|it| it[1] - it[0]).filter(|it| *it > 0.0);
                let period_s = gaps.fold(f64::INFINITY, f64::min);
                recording.camera_frames.iter_mut().for_each(|it| it.time_s = (it.time_s / period_s).round() / hz);
            }
            Fault::FewCommon(frames) => {
                let with_spots: Vec<f64> = given
                    .camera_frames
                    .iter()
                    .filter(|it| own(it) && !it.spots.is_empty())
                    .map(|it| it.time_s)
                    .collect();
                let every = with_spots.len() / frames;
                let kept: Vec<f64> = with_spots.into_iter().step_by(every.max(1)).take(frames).collect();
                recording.camera_frames.retain(|it| !own(it) || kept.contains(&it.time_s));
            }
        }
        Some(recording)
    }

    /// Cameras that are at fault when it is done to `camera`.
    pub fn culprits(self, camera: usize, n_cameras: usize) -> Vec<usize> {
        match self {
            Fault::Swapped | Fault::SwappedHalf => vec![camera, (camera + 1) % n_cameras],
            Fault::Clean | Fault::Half { .. } | Fault::Window { .. } | Fault::Rate(_) => Vec::new(),
            _ => vec![camera],
        }
    }
}
