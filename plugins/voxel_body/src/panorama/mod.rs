//! The background of a camera that turns on a head: a panorama of pictures, each of which stays as it was taken.
//!
//! A head's axes do not pass through its camera's centre: what is near moves against what is far when it turns, and no single panorama fits from everywhere. So views are kept, a few degrees apart. What is behind the
//! body in a picture is the next view, as the head's pose says that it lies in the picture; where that ends, the one after it. Then the picture itself tells how far the pose was off ([`align`]), by the part of
//! the background that shows. What poses are off in the mean is the views' own fault: the rest is the picture's, and makes its pose better.
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | `spacing` | from view to view: an eighth of the picture's diagonal | rad |
//! | `distance` | how far the background is, roughly: it only says where the middle of the parallax lies | m |
//! | `own` of a view | from where the pose says that something lies in it to where it does | px |

mod align;
mod bent;
mod part;
mod warp;

use foveate::geometry::Camera;
use foveate::imaging::ImagingError;
use nalgebra::{Point2, Similarity2, UnitQuaternion, Vector3};

use align::{Aligner, Alignment};
use bent::Bent;
pub(crate) use part::known_part;
use warp::{FINE, Warp, between};

/// Views along the diagonal of the picture.
const VIEWS_ALONG: f64 = 8.0;
/// Poses may be off by so many of their standard deviations, and by this more [px].
const REACH_SIGMAS: f64 = 5.0;
const REACH_PX: f64 = 8.0;
/// What a picture must share with those before it to be aligned with them [–].
const SHARED: f64 = 0.3;
/// A view is the mean of so many pictures at most.
const PICTURES: u16 = 16;
/// One row in so many follows the light at a picture.
const BANDS: usize = 8;

/// A picture of the background.
struct View {
    camera: Camera,
    own: Similarity2<f64>,
    /// Gray levels in steps of 1/[`FINE`].
    levels: Vec<u16>,
    n: u16,
}

/// The background of one camera on a head, for pictures of one size and kind.
pub(crate) struct Panorama {
    size: [usize; 2],
    channels: usize,
    distance: f64,
    views: Vec<View>,
    aligner: Aligner,
    warp: Warp,
    pixels: Vec<u8>,
    covered: Vec<bool>,
    /// How the last picture lies.
    moved: Similarity2<f64>,
    bent: Bent,
    /// Sum of the turns by which poses were off the views, and of how many [rad].
    turns: (Vector3<f64>, f64),
    n_pictures: usize,
    /// Of single pictures against the views: median differences [gray level].
    noise: Vec<f32>,
}

/// The predicted empty scene from a pose.
pub(crate) struct Behind<'a> {
    pub pixels: &'a [u8],
    /// Where that is known.
    pub covered: &'a [bool],
    /// How far edges in it may be off, one standard deviation [px].
    pub jitter_px: f64,
    /// Rotation of the camera relative to its pose, about its own axes, if the picture was aligned.
    pub turned: Option<UnitQuaternion<f64>>,
}

impl Panorama {
    /// For pictures of `size` (columns, rows); the background is about `distance` away [m].
    ///
    /// # Errors
    /// A setting of the alignment.
    pub fn new(size: [usize; 2], channels: usize, distance: f64) -> Result<Self, ImagingError> {
        let n = size[0] * size[1];
        Ok(Self {
            size,
            channels,
            distance,
            views: Vec::new(),
            aligner: Aligner::new()?,
            warp: Warp::default(),
            pixels: vec![0; n * channels],
            covered: vec![false; n],
            moved: Similarity2::identity(),
            bent: Bent::default(),
            turns: (Vector3::zeros(), 0.0),
            n_pictures: 0,
            noise: Vec::new(),
        })
    }

    /// For which pictures it is: columns, rows, channels.
    pub fn shape(&self) -> ([usize; 2], usize) {
        (self.size, self.channels)
    }

    /// Views that are kept.
    pub fn n_views(&self) -> usize {
        self.views.len()
    }

    /// Standard deviation of a picture's noise about its view, by what was learnt; `None` before two pictures of one view [gray level].
    pub fn noise(&self) -> Option<f32> {
        let mut sorted = self.noise.clone();
        sorted.sort_by(f32::total_cmp);
        sorted.get(sorted.len() / 2).map(|it| 1.4826 * it)
    }

    /// Takes a picture of the empty scene in: a new view, or one that the next view becomes less noisy by. Its pose is known to `sigma_px`. What was behind it before it came, if that could be laid into it.
    ///
    /// # Errors
    /// Pixels that are not what the size promises.
    pub fn learn(&mut self, camera: &Camera, sigma_px: f64, pixels: &[u8]) -> Result<Option<Behind<'_>>, ImagingError> {
        let alignment = self.expect(camera, sigma_px, pixels)?;
        let n_covered = self.covered.iter().filter(|it| **it).count();
        let is_shared = n_covered as f64 >= SHARED * self.covered.len() as f64;
        match self.next(camera) {
            Some((next, angle)) if angle < self.spacing(camera) / 2.0 => {
                // From elsewhere parallax would blur it; and of a wall without texture nothing is known but the pose.
                if alignment.is_some() && angle < self.spacing(camera) / 8.0 && self.views[next].n < PICTURES {
                    self.learn_noise(pixels);
                    let share = 1.0 / f32::from(self.views[next].n + 1);
                    self.blend(next, camera, 0..self.size[1], |at| (f32::from(pixels[at]), share));
                    self.views[next].n += 1;
                }
            }
            _ => {
                let own = if is_shared { self.moved } else { Similarity2::identity() };
                let levels = pixels.iter().map(|it| u16::from(*it) * FINE as u16).collect();
                self.views.push(View { camera: camera.clone(), own, levels, n: 1 });
            }
        }
        Ok(alignment.map(|it| Behind {
            pixels: &self.pixels,
            covered: &self.covered,
            jitter_px: it.rms_px,
            turned: None,
        }))
    }

    /// What should be seen behind `pixels`, a picture from `camera` whose pose is known to `sigma_px`.
    ///
    /// # Errors
    /// Pixels that are not what the size promises.
    pub fn behind(&mut self, camera: &Camera, sigma_px: f64, pixels: &[u8]) -> Result<Behind<'_>, ImagingError> {
        let alignment = self.expect(camera, sigma_px, pixels)?;
        // All views may be turned alike: by what poses are off in the mean they are not.
        let common = camera.camera_from_world.rotation * (self.turns.0 / self.turns.1.max(1.0));
        let turned = alignment.as_ref().map(|it| UnitQuaternion::from_scaled_axis(turned_by(camera, it) - common));
        Ok(Behind {
            pixels: &self.pixels,
            covered: &self.covered,
            jitter_px: alignment.map_or(sigma_px, |it| it.rms_px),
            turned,
        })
    }

    /// The next view follows what the last picture that was asked about shows where `is_background`, by `share`; `gains` are its light over the view's, channel by channel.
    pub fn follow(
        &mut self,
        camera: &Camera,
        pixels: &[u8],
        is_background: impl Fn(usize) -> bool,
        gains: &[f32],
        share: f32,
    ) {
        let Some((next, angle)) = self.next(camera) else { return };
        if angle > self.spacing(camera) / 4.0 {
            return;
        }
        self.n_pictures += 1;
        let channels = self.channels;
        let share = (BANDS as f32 * share).min(1.0);
        let first = self.n_pictures % BANDS;
        for row in (first..self.size[1]).step_by(BANDS) {
            self.blend(next, camera, row..row + 1, |at| {
                let value = f32::from(pixels[at]) / gains[at % channels].max(0.05);
                (value, if is_background(at / channels) { share } else { 0.0 })
            });
        }
    }

    /// Finds how a picture lies on what its pose lets expect, and fills `pixels` and `covered` so.
    fn expect(&mut self, camera: &Camera, sigma_px: f64, pixels: &[u8]) -> Result<Option<Alignment>, ImagingError> {
        let expected = self.size[0] * self.size[1] * self.channels;
        if pixels.len() != expected {
            return Err(ImagingError::WrongLength { what: "picture", expected, found: pixels.len() });
        }
        (self.moved, self.bent) = (Similarity2::identity(), Bent::default());
        self.render(camera);
        let reach = REACH_PX + REACH_SIGMAS * sigma_px;
        let found = self.aligner.align(&self.pixels, &self.covered, pixels, self.size, reach)?;
        if let Some(found) = &found {
            let turn = camera.camera_from_world.rotation.inverse() * turned_by(camera, found);
            self.turns = (self.turns.0 + turn, self.turns.1 + 1.0);
            (self.moved, self.bent) = (found.moved, found.bent.clone());
            self.render(camera);
        }
        Ok(found)
    }

    /// From view to view [rad].
    fn spacing(&self, camera: &Camera) -> f64 {
        let diagonal = (self.size[0] as f64).hypot(self.size[1] as f64);
        diagonal / camera.intrinsics.focal[0] / VIEWS_ALONG
    }

    /// The view that was taken from the nearest pose, and how far the camera has turned since [rad].
    fn next(&self, camera: &Camera) -> Option<(usize, f64)> {
        let turned = self.views.iter().map(|it| turn(&it.camera, camera));
        turned.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// What the views show from `camera`, where the last picture lies.
    fn render(&mut self, camera: &Camera) {
        self.covered.fill(false);
        let mut order: Vec<(usize, f64)> = self.views.iter().map(|it| turn(&it.camera, camera)).enumerate().collect();
        order.sort_by(|a, b| a.1.total_cmp(&b.1));
        let diagonal = VIEWS_ALONG * self.spacing(camera);
        let (back, bent) = (self.moved.inverse(), &self.bent);
        for (at, _) in order.into_iter().take_while(|it| it.1 < diagonal) {
            let view = &self.views[at];
            let distance = self.distance;
            self.warp.set(self.size, |pixel| {
                let place = camera.ray(&(back * (pixel - bent.at(pixel))))?.at(distance);
                Some(view.own * view.camera.project(&place)?)
            });
            self.warp.take(&view.levels, self.channels, &mut self.pixels, &mut self.covered);
            if self.covered.iter().all(|it| *it) {
                break;
            }
        }
    }

    /// Rows of a view move towards a picture from `camera`: `source` gives level and share of each of its bytes.
    fn blend(
        &mut self,
        at: usize,
        camera: &Camera,
        rows: std::ops::Range<usize>,
        source: impl Fn(usize) -> (f32, f32),
    ) {
        let Self { views, warp, size, channels, moved, bent, distance, .. } = self;
        let view = &mut views[at];
        let back = view.own.inverse();
        let from = view.camera.clone();
        // Where the pixels of the view lie in the picture.
        warp.set(*size, |pixel| {
            let place = from.ray(&(back * pixel))?.at(*distance);
            let about = *moved * camera.project(&place)?;
            Some(about + bent.at(&about))
        });
        for row in rows {
            warp.along_row(row, |pixel, u, v| {
                for channel in 0..*channels {
                    let share = source((v as usize * size[0] + u as usize) * *channels + channel).1;
                    let level = between(|it| source(it * *channels + channel).0, size[0], u, v) * FINE;
                    let known = &mut view.levels[pixel * *channels + channel];
                    let was = f32::from(*known);
                    *known = (was + share * (level - was) + 0.5) as u16;
                }
            });
        }
    }

    /// By how much single pixels of a picture are off what was expected, in its own alignment.
    fn learn_noise(&mut self, pixels: &[u8]) {
        let mut off: Vec<u8> = (0..self.covered.len())
            .step_by(37)
            .filter(|it| self.covered[*it])
            .map(|it| pixels[it * self.channels].abs_diff(self.pixels[it * self.channels]))
            .collect();
        off.sort_unstable();
        if let Some(median) = off.get(off.len() / 2) {
            // Whole levels: half of those that are equal lie below.
            let below = off.partition_point(|it| it < median);
            let equal = off.partition_point(|it| it <= median) - below;
            let part = (off.len() as f32 / 2.0 - below as f32) / equal as f32;
            self.noise.push(f32::from(*median) - 0.5 + part);
        }
    }
}

/// By which turn of the camera, about its own axes, a picture comes to lie where it does [rad].
fn turned_by(camera: &Camera, found: &Alignment) -> Vector3<f64> {
    let [x, y] = camera.intrinsics.principal;
    let centre = Point2::new(x, y);
    let shift = found.moved * centre - centre;
    let [across, down] = camera.intrinsics.focal;
    Vector3::new(-shift.y / down, shift.x / across, found.moved.isometry.rotation.angle())
}

/// The angle between two cameras' orientations [rad].
fn turn(a: &Camera, b: &Camera) -> f64 {
    a.camera_from_world.rotation.angle_to(&b.camera_from_world.rotation)
}
