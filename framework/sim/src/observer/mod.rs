//! An ideal detector: the features of one camera straight from the world, without a picture.
//!
//! Order of events for one field: lights that shine towards the camera, lie in its view and are not hidden by a person → those by chance
//! hidden or missed taken out → lights that would be one spot joined → noise → clutter. A field depends on its time and on the seed
//! alone, so fields may be requested in any order.
//!
//! Covariances are honest: the noise's own, and for joined lights the scatter of what was joined as well, so that each of
//! these lights lies within what is stated.

mod settings;

use foveate_estimation::random::Random;
use foveate_messages::{CameraId, Feature, Features, TargetId, Time};
use nalgebra::{Matrix2, Point2, Point3, Vector2};

pub use settings::ObserverSettings;

use crate::chance::stream;
use crate::truth::TrueCamera;
use crate::world::{Light, Moment, World};

/// Number of the time line of fields; those of hidden lights have 1 and up.
const FIELDS: u64 = 0;

/// The ideal detector of one camera; keeps its memory from field to field.
#[derive(Debug, Clone)]
pub struct Observer {
    camera: TrueCamera,
    id: CameraId,
    settings: ObserverSettings,
    centre: Point3<f64>,
    /// Pixel rows for each pixel column of the same length.
    aspect: f64,
    seed: u64,
    moment: Moment,
    spots: Vec<Spot>,
}

/// A light, or several joined, in the picture.
#[derive(Debug, Clone, Copy)]
struct Spot {
    sum: Vector2<f64>,
    /// Sum of the outer products.
    squares: Matrix2<f64>,
    count: f64,
}

impl Spot {
    fn at(pixel: Point2<f64>) -> Self {
        Self { sum: pixel.coords, squares: pixel.coords * pixel.coords.transpose(), count: 1.0 }
    }

    fn centre(&self) -> Vector2<f64> {
        self.sum / self.count
    }

    fn join(&mut self, other: &Spot) {
        self.sum += other.sum;
        self.squares += other.squares;
        self.count += other.count;
    }

    /// Mean outer product of the distances of what was joined from its middle [px²].
    fn scatter(&self) -> Matrix2<f64> {
        if self.count > 1.0 {
            self.squares / self.count - self.centre() * self.centre().transpose()
        } else {
            Matrix2::zeros()
        }
    }
}

impl Observer {
    /// Number `id` of the cameras; `random` is the camera's own. Settings out of range are taken as they are, and their
    /// [`timing`](ObserverSettings::timing) is left to [`Timing`](crate::timing::Timing).
    pub fn new(camera: impl Into<TrueCamera>, id: CameraId, settings: &ObserverSettings, random: &Random) -> Self {
        let camera = camera.into();
        let [across, down] = camera.intrinsics.focal;
        Self {
            id,
            settings: settings.clone(),
            centre: camera.centre(),
            aspect: down / across,
            seed: random.fork("features").next_u64(),
            moment: Moment::default(),
            spots: Vec::new(),
            camera,
        }
    }

    /// From now on this is the camera.
    pub fn stand(&mut self, camera: &TrueCamera) {
        let [across, down] = camera.intrinsics.focal;
        (self.centre, self.aspect) = (camera.centre(), down / across);
        self.camera.clone_from(camera);
    }

    /// The features of the field at session time `time`, into `features`, whose memory is used again.
    pub fn look(&mut self, world: &World, time: Time, features: &mut Features) {
        let mut moment = std::mem::take(&mut self.moment);
        world.at(time, &mut moment);
        self.spots.clear();
        let mut random = self.random_of(time);
        if self.settings.bodies {
            let eye = self.centre;
            for light in moment.lights_towards(&eye, 1.0) {
                if let Some(pixel) = self.camera.sees(&light.position)
                    && !moment.occluded(&eye, &light.position)
                {
                    self.find(light.id, pixel, time, &mut random);
                }
            }
        } else {
            for Light { id, position, .. } in moment.lights() {
                if let Some(pixel) = self.camera.sees(&position) {
                    self.find(id, pixel, time, &mut random);
                }
            }
        }
        self.moment = moment;
        self.write(&mut random, features);
    }

    /// As [`Self::look`] at lights of one's own that nothing hides and that shine all around; positions in the world [m].
    pub fn look_at(&mut self, lights: &[(TargetId, Point3<f64>)], time: Time, features: &mut Features) {
        self.spots.clear();
        let mut random = self.random_of(time);
        for (id, position) in lights {
            if let Some(pixel) = self.camera.sees(position) {
                self.find(*id, pixel, time, &mut random);
            }
        }
        self.write(&mut random, features);
    }

    fn random_of(&self, time: Time) -> Random {
        stream(self.seed, FIELDS, time.0)
    }

    fn find(&mut self, id: TargetId, pixel: Point2<f64>, time: Time, random: &mut Random) {
        let missed = self.settings.missed > 0.0 && random.uniform() < self.settings.missed;
        if !missed && !self.is_hidden(id, time.as_s()) {
            self.spots.push(Spot::at(pixel));
        }
    }

    /// Whether chance hides `light` at `time_s`: from one random moment in each slot of `hidden_every_s` on.
    fn is_hidden(&self, light: TargetId, time_s: f64) -> bool {
        let ObserverSettings { hidden_every_s: every, hidden_lasts_s: lasts, .. } = self.settings;
        if every <= 0.0 {
            return false;
        }
        let slot = (time_s / every).floor() as i64;
        (slot - 1..=slot).any(|slot| {
            let mut random = stream(self.seed, 1 + u64::from(light.0), slot);
            let start = (slot as f64 + random.uniform()) * every;
            (start..start + lasts).contains(&time_s)
        })
    }

    /// Joins, blurs, adds clutter, sorts.
    fn write(&mut self, random: &mut Random, features: &mut Features) {
        self.join_close_spots();
        let sigmas = Vector2::new(self.settings.noise_px, self.settings.noise_px * self.aspect);
        let noise = Matrix2::from_diagonal(&sigmas.component_mul(&sigmas));
        features.camera = self.id;
        features.list.clear();
        let mut put = |centre: Vector2<f64>, covariance: Matrix2<f64>| {
            let centre = Point2::from(centre);
            if self.camera.has_pixel(&centre) {
                features.list.push(Feature { centre, covariance, area: 0, peak: 0, label: None });
            }
        };
        for spot in &self.spots {
            let error = Vector2::new(random.normal(), random.normal()).component_mul(&sigmas);
            put(spot.centre() + error, noise + spot.scatter());
        }
        let [width, height] = self.camera.image_size.map(f64::from);
        for _ in 0..poisson(self.settings.clutter, random) {
            put(Vector2::new(random.uniform() * width - 0.5, random.uniform() * height - 0.5), noise);
        }
        let order = |it: &Feature| (it.centre.y, it.centre.x);
        features.list.sort_unstable_by(|a, b| {
            let (a, b) = (order(a), order(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
    }

    /// Joins spots until no two middles are closer than a spot is wide.
    fn join_close_spots(&mut self) {
        let width = self.settings.spot_width_px;
        if width <= 0.0 {
            return;
        }
        let shape = Vector2::new(1.0, 1.0 / self.aspect);
        let close = |a: &Spot, b: &Spot| (a.centre() - b.centre()).component_mul(&shape).norm_squared() < width * width;
        let mut i = 0;
        while i < self.spots.len() {
            let near = (i + 1..self.spots.len()).find(|&j| close(&self.spots[i], &self.spots[j]));
            match near {
                // The joined one has moved: it is compared with all again.
                Some(j) => {
                    let mut joined = self.spots.swap_remove(j);
                    joined.join(&self.spots.swap_remove(i));
                    self.spots.push(joined);
                    i = 0;
                }
                None => i += 1,
            }
        }
    }
}

/// A number of events that happen `mean` times on average (D. Knuth, *The Art of Computer Programming* 2, 3.4.1).
fn poisson(mean: f64, random: &mut Random) -> u32 {
    if mean <= 0.0 {
        return 0;
    }
    let limit = (-mean).exp();
    let (mut count, mut product) = (0, random.uniform());
    while product > limit {
        count += 1;
        product *= random.uniform();
    }
    count
}

#[cfg(test)]
mod tests;
