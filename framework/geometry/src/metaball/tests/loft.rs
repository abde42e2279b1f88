//! An arm that is no metaball: rings of uneven, rounded-box shape about a middle line that bends at the elbow, with lumps, as three cameras see it.

use foveate_estimation::random::Random;
use nalgebra::{Matrix3, Point3, Rotation3, Unit, UnitQuaternion, Vector3};

use crate::metaball::{Body, BodyObservation, State};

/// Place in bones from the shoulder; half widths towards the bend, away from it, to both sides [m].
const RINGS: [(f64, [f64; 4]); 14] = [
    (-0.24, [0.028, 0.030, 0.026, 0.026]),
    (-0.12, [0.055, 0.058, 0.050, 0.052]),
    (0.10, [0.060, 0.058, 0.052, 0.055]),
    (0.35, [0.059, 0.050, 0.047, 0.048]),
    (0.60, [0.054, 0.047, 0.044, 0.045]),
    (0.85, [0.043, 0.043, 0.041, 0.042]),
    (1.00, [0.041, 0.046, 0.045, 0.044]),
    (1.20, [0.046, 0.042, 0.047, 0.045]),
    (1.50, [0.038, 0.036, 0.041, 0.039]),
    (1.80, [0.027, 0.026, 0.031, 0.030]),
    (2.00, [0.024, 0.024, 0.029, 0.030]),
    (2.15, [0.022, 0.020, 0.040, 0.041]),
    (2.35, [0.017, 0.016, 0.042, 0.040]),
    (2.60, [0.010, 0.010, 0.025, 0.025]),
];

/// Sections are between an ellipse and a box (Lamé).
fn rounded(cosine: f64, sine: f64, power: f64) -> f64 {
    (cosine.abs().powf(power) + sine.abs().powf(power)).powf(-1.0 / power)
}

/// The arm of a person in some posture.
pub struct LoftArm {
    /// Shoulder, elbow, wrist [m].
    pub joints: [Point3<f64>; 3],
    /// How thick it is, 1 for most people.
    pub girth: f64,
    twist: f64,
    power: f64,
    lumps: [Vector3<f64>; 3],
}

impl LoftArm {
    pub fn draw(seed: u64) -> LoftArm {
        let mut random = Random::new(seed).fork("arm");
        let share = |random: &mut Random, spread: f64| 1.0 + spread * random.normal().clamp(-2.0, 2.0);
        let girth = share(&mut random, 0.10);
        let bones = [0.30 * share(&mut random, 0.05), 0.255 * share(&mut random, 0.05)];
        let upper = Vector3::new(random.uniform_in(-0.6, 0.6), 1.0, random.uniform_in(-1.0, 0.6)).normalize();
        let side = Vector3::from_fn(|_, _| random.normal());
        let hinge = Unit::new_normalize(upper.cross(&side));
        let fore = UnitQuaternion::from_axis_angle(&hinge, random.uniform_in(0.35, 1.9)) * upper;
        // A limb that points to the cameras shows them its end only.
        if fore.x.abs() > 0.7 || upper.x.abs() > 0.7 {
            return LoftArm::draw(seed ^ random.next_u64());
        }
        let shoulder = Point3::new(0.2, -0.3, 1.3);
        let elbow = shoulder + upper * bones[0];
        let lumps = [(); 3].map(|()| Vector3::from_fn(|_, _| random.uniform_in(-60.0, 60.0)));
        LoftArm {
            joints: [shoulder, elbow, elbow + fore * bones[1]],
            girth,
            twist: random.uniform_in(-0.5, 0.5),
            power: random.uniform_in(1.9, 2.3),
            lumps,
        }
    }

    fn widths(&self, along: f64) -> [f64; 4] {
        let after = RINGS.iter().position(|it| it.0 > along).unwrap_or(RINGS.len() - 1).max(1);
        let ((from, a), (to, b)) = (RINGS[after - 1], RINGS[after]);
        let part = ((along - from) / (to - from)).clamp(0.0, 1.0);
        [0, 1, 2, 3].map(|it| self.girth * (a[it] + (b[it] - a[it]) * part))
    }

    /// Half its width there, mean over all directions [m].
    pub fn radius(&self, along: f64) -> f64 {
        let [front, back, one, other] = self.widths(along);
        let width = |it: i32| {
            let (sine, cosine) = (f64::from(it) * std::f64::consts::PI / 18.0).sin_cos();
            let (x, y) =
                (cosine * if cosine > 0.0 { front } else { back }, sine * if sine > 0.0 { one } else { other });
            rounded(cosine, sine, self.power) * x.hypot(y)
        };
        (0..36).map(width).sum::<f64>() / 36.0
    }

    /// A point of the surface.
    fn at(&self, along: f64, angle: f64) -> Point3<f64> {
        let [shoulder, elbow, wrist] = self.joints;
        let (upper, fore) = (elbow - shoulder, wrist - elbow);
        let towards = (fore.normalize() - upper.normalize()).normalize();
        // The middle line is a parabola over 0.15 bones to both sides of the elbow.
        let bend = 0.15;
        let off = along - 1.0;
        let (middle, way) = if off.abs() < bend {
            let t = (off + bend) / (2.0 * bend);
            let (a, c) = (elbow - upper * bend, elbow + fore * bend);
            let middle = a.coords * (1.0 - t).powi(2) + elbow.coords * (2.0 * t * (1.0 - t)) + c.coords * t * t;
            (Point3::from(middle), (upper * (1.0 - t) + fore * t).normalize())
        } else if off < 0.0 {
            (shoulder + upper * along, upper.normalize())
        } else {
            (elbow + fore * off, fore.normalize())
        };
        let x = (towards - way * towards.dot(&way)).normalize();
        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(way), self.twist * off.max(0.0));
        let axes = turn * Matrix3::from_columns(&[x, way.cross(&x), way]);
        let (sine, cosine) = angle.sin_cos();
        let round = rounded(cosine, sine, self.power);
        let [front, back, one, other] = self.widths(along);
        let place = Vector3::new(
            cosine * round * if cosine > 0.0 { front } else { back },
            sine * round * if sine > 0.0 { one } else { other },
            0.0,
        );
        let at = Vector3::new(place.x, place.y, 0.27 * along);
        let lump: f64 = self.lumps.iter().map(|it| 0.0008 * it.dot(&at).sin()).sum();
        middle + axes * (place + place.normalize() * lump)
    }

    /// Points that at least two of three cameras in a line see, 40° apart from the first to the last; one in fifty is wrong by up to a decimetre.
    pub fn points(&self, n: usize, noise_m: f64, seed: u64) -> Vec<BodyObservation> {
        let mut random = Random::new(seed).fork("points");
        let middle = self.joints[1];
        let eyes = [-20.0_f64, 0.0, 20.0].map(|deg| {
            let (sine, cosine) = deg.to_radians().sin_cos();
            middle + Vector3::new(1.6 * cosine, 1.6 * sine, 0.2)
        });
        let mut points = Vec::new();
        while points.len() < n {
            let (along, angle) = (random.uniform_in(-0.2, 2.55), random.uniform_in(0.0, std::f64::consts::TAU));
            let at = self.at(along, angle);
            let [a, b] = [self.at(along + 1e-3, angle) - at, self.at(along, angle + 1e-3) - at];
            let normal = b.cross(&a).normalize();
            let normal =
                if normal.dot(&(at - self.at(along, angle + std::f64::consts::PI))) < 0.0 { -normal } else { normal };
            if eyes.iter().filter(|it| normal.dot(&(*it - at).normalize()) > 0.35).count() < 2 {
                continue;
            }
            let mut at = at + Vector3::from_fn(|_, _| noise_m * random.normal());
            if random.below(50) == 0 {
                at += Vector3::from_fn(|_, _| random.uniform_in(-0.1, 0.1));
            }
            points.push(BodyObservation::Point { at, sigma_m: noise_m, segment: None });
        }
        points
    }

    /// Shoulder, elbow and wrist as a person clicks them: each `off_m` off, in any direction.
    pub fn clicks(&self, body: &Body, off_m: f64, seed: u64) -> Vec<BodyObservation> {
        let mut random = Random::new(seed).fork("clicks");
        let fore = 1;
        let wrist = Vector3::new(0.0, 0.0, body.skeleton.segments()[fore].length);
        [(0, Vector3::zeros()), (fore, Vector3::zeros()), (fore, wrist)]
            .iter()
            .zip(self.joints)
            .map(|((segment, place), at)| BodyObservation::Anchored {
                segment: *segment,
                place: *place,
                at: at + Vector3::from_fn(|_, _| random.normal()).normalize() * off_m,
                sigma_m: 0.04,
            })
            .collect()
    }

    /// Angles of upper arm and forearm, and of the elbow, against the truth [deg]; differences of radii in the middle of both [m].
    pub fn errors(&self, body: &Body, state: &State) -> ([f64; 3], Vec<f64>) {
        let posed = body.skeleton.pose(state);
        let bone = |it: usize| posed.world_from_segment[it] * Vector3::z();
        let [shoulder, elbow, wrist] = self.joints;
        let (upper, fore) = (elbow - shoulder, wrist - elbow);
        let angles = [
            bone(0).angle(&upper).to_degrees(),
            bone(1).angle(&fore).to_degrees(),
            (bone(0).angle(&bone(1)) - upper.angle(&fore)).to_degrees(),
        ];
        // Stretched, so that no ray from a bone runs along the other one.
        let straight = State { angles: vec![0.0; state.angles.len()], ..state.clone() };
        let radius = |segment: usize, part: f64| {
            let it = &body.skeleton.segments()[segment];
            let along = part * it.length * state.scales[it.scale];
            let across = |axis| body.thickness_at(&straight, segment, along, axis);
            let width = |it: i32| {
                let (sine, cosine) = (f64::from(it) * std::f64::consts::PI / 8.0).sin_cos();
                across(Vector3::new(cosine, sine, 0.0))
            };
            (0..8).map(width).sum::<f64>() / 8.0 - self.radius(segment as f64 + part)
        };
        let radii = [(0, 0.3), (0, 0.5), (0, 0.7), (1, 0.3), (1, 0.5), (1, 0.7)].map(|it| radius(it.0, it.1));
        (angles, radii.to_vec())
    }
}
