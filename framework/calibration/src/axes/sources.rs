//! Estimates of scale, vertical and origin from each source, and their combination.

use foveate_geometry::CameraStatus;
use foveate_geometry::alignment::{AlignmentOptions, align};
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Similarity3, Unit, UnitQuaternion, Vector3};

use super::fall::{self, Fall};
use super::places::{Located, Room};
use super::spread::{COLLINEAR, Spread, collinear, not_collinear};
use super::{AxesError, FreedomName, Given, Place, SourceFigure, not_negative, positive};
use crate::solved::{FixedFreedoms, Solved};
use crate::wand;

/// Points off by more than this many times what is likely do not have the shape that is claimed.
const MISFIT: f64 = 5.0;
/// Share of the path that must lie on one side of a floor.
const ONE_SIDE: f64 = 0.9;
/// No camera is mounted with less roll than this, standard deviation [rad].
const LEAST_ROLL: f64 = 0.02;

/// Says how many metres the unit of the solution has.
struct Scale {
    by: String,
    factor: f64,
    sigma: f64,
    /// The length that it is a known one of.
    metres: Option<f64>,
}

/// Says which way is up, in the solution.
struct Up {
    by: String,
    up: Unit<Vector3<f64>>,
    sigma: f64,
}

/// How a frame of points whose coordinates a person says goes by: its Z = 0 is wherever that person wants it.
pub(crate) const KNOWN_PLACES: &str = "points of known place";

/// Says where the origin is and whereto X points, in the solution.
struct Origin {
    by: String,
    place: Point3<f64>,
    sigma: f64,
    heading: Option<Vector3<f64>>,
}

/// Everything that was said.
pub(super) struct Sources {
    scales: Vec<Scale>,
    ups: Vec<Up>,
    origins: Vec<Origin>,
    /// In the order given.
    pub falls: Vec<Fall>,
}

/// What follows from it.
pub(super) struct Settled {
    pub world_from_solved: Similarity3<f64>,
    pub fixed: FixedFreedoms,
    pub figures: Vec<SourceFigure>,
}

impl Sources {
    /// What is fixed already, if it says how well.
    pub(super) fn of_earlier_steps(solved: &Solved) -> Sources {
        let known = |it: &Option<Fixed>| it.as_ref().and_then(|it| Some((it.by.clone(), it.sigma?.max(1e-12))));
        let FixedFreedoms { scale, gravity, origin } = &solved.fixed;
        let scale = known(scale).map(|(by, sigma)| Scale { by, factor: 1.0, sigma, metres: None });
        let up = known(gravity).map(|(by, sigma)| Up { by, up: Vector3::z_axis(), sigma });
        let origin = known(origin).map(|(by, sigma)| {
            let (place, heading) = (Point3::origin(), Some(Vector3::x()));
            Origin { by, place, sigma, heading }
        });
        Sources {
            scales: scale.into_iter().collect(),
            ups: up.into_iter().collect(),
            origins: origin.into_iter().collect(),
            falls: Vec::new(),
        }
    }

    pub(super) fn add(&mut self, network: &Room<'_>, given: &Given) -> Result<(), AxesError> {
        match given {
            &Given::WandLength { ends, metres, sigma_m } => self.wand(network, ends, metres, sigma_m),
            Given::Distance { a, b, metres, sigma_m } => self.distance(network, [a, b], *metres, *sigma_m),
            Given::Points { known, sigma_m } => self.points(network, known, *sigma_m),
            Given::Floor { places, height_m, sigma_m } => self.floor(network, places, *height_m, *sigma_m),
            &Given::Falling { label, from_s, until_s } => self.falling(network, label, [from_s, until_s]),
            Given::Plumb { top, bottom, sigma } => self.plumb(network, [top, bottom], *sigma),
            Given::CamerasUpright => self.upright(network),
        }
    }

    fn wand(&mut self, network: &Room<'_>, ends: [u32; 2], metres: f64, sigma_m: f64) -> Result<(), AxesError> {
        positive("the length of the wand [m]", metres)?;
        not_negative("the sigma of the wand's length [m]", sigma_m)?;
        let found = wand::lengths(network.solved, ends).map_err(|it| AxesError::NoWand {
            ends,
            frames: it.frames,
            needed: it.needed,
        })?;
        let sigma = found.sigma.hypot(sigma_m / metres).max(f64::EPSILON);
        let by = format!("a wand of {metres} m");
        // The same wand, where an earlier step solved by it, is no second witness.
        self.scales.retain(|it| it.by != by);
        self.scales.push(Scale { by, factor: metres / found.mean, sigma, metres: Some(metres) });
        Ok(())
    }

    fn distance(
        &mut self,
        network: &Room<'_>,
        [a, b]: [&Place; 2],
        metres: f64,
        sigma_m: f64,
    ) -> Result<(), AxesError> {
        let by = format!("{metres} m from {a} to {b}");
        positive(&format!("the distance from {a} to {b} [m]"), metres)?;
        not_negative("the sigma of the distance [m]", sigma_m)?;
        let (a, b) = (network.locate(a)?, network.locate(b)?);
        let (distance, sigma) = apart(&by, a, b)?;
        let sigma = (sigma / distance).hypot(sigma_m / metres).max(f64::EPSILON);
        self.scales.push(Scale { by, factor: metres / distance, sigma, metres: Some(metres) });
        Ok(())
    }

    fn points(&mut self, network: &Room<'_>, known: &[(Place, Point3<f64>)], sigma_m: f64) -> Result<(), AxesError> {
        let by = format!("{} {KNOWN_PLACES}", known.len());
        not_negative("the sigma of the points [m]", sigma_m)?;
        for (index, (_, point)) in known.iter().enumerate() {
            if let Some(found) = point.iter().copied().find(|it| !it.is_finite()) {
                let what = format!("a coordinate of known point {} [m]", index + 1);
                return Err(AxesError::BadNumber { what, found, expected: "a finite number" });
            }
        }
        if known.len() < 3 {
            return Err(AxesError::TooFewPlaces { given: by, found: known.len(), needed: 3 });
        }
        let located: Vec<Located> = known.iter().map(|it| network.locate(&it.0)).collect::<Result<_, _>>()?;
        let in_solved: Vec<Point3<f64>> = located.iter().map(|it| it.position).collect();
        let in_world: Vec<Point3<f64>> = known.iter().map(|it| it.1).collect();
        not_collinear(&format!("{by} (their coordinates)"), &in_world)?;
        not_collinear(&by, &in_solved)?;
        let options = AlignmentOptions { scale: true, robust: false };
        let aligned = align(&in_solved, &in_world, options).map_err(|it| collinear(&by, it))?;
        let world_from_solved = aligned.b_from_a;
        let factor = world_from_solved.scaling();
        let own = (located.iter().map(|it| it.sigma * it.sigma).sum::<f64>() / located.len() as f64).sqrt() * factor;
        let sigma = own.hypot(sigma_m);
        // 3 n coordinates, 7 of them used up.
        let surplus = 3.0 * known.len() as f64 - 7.0;
        let rms_m = (aligned.distances.iter().map(|it| it * it).sum::<f64>() / surplus).sqrt();
        if rms_m > MISFIT * sigma {
            let mirrored: Vec<Point3<f64>> = in_world.iter().map(|it| Point3::new(it.x, it.y, -it.z)).collect();
            let in_mirror = align(&in_solved, &mirrored, options).map(|it| it.rms).unwrap_or(f64::INFINITY);
            if in_mirror < 0.3 * aligned.rms {
                let why = format!("mirrored they fit to {in_mirror:.4} m, as they are to {:.4} m", aligned.rms);
                return Err(AxesError::Mirrored { given: by, why });
            }
            let farthest = aligned.distances.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
            let (worst, worst_m) = farthest.unwrap_or((0, 0.0));
            return Err(AxesError::Misfit { given: by, rms_m, expected_m: sigma, worst: worst + 1, worst_m });
        }
        self.not_upside_down(network, &by, &world_from_solved, &in_world)?;
        let spread = Spread::of(&in_world);
        let sigma = sigma.max(rms_m).max(f64::MIN_POSITIVE);
        let tilt = sigma / spread.middle;
        self.scales.push(Scale {
            by: by.clone(),
            factor,
            sigma: (sigma / spread.size).max(f64::EPSILON),
            metres: None,
        });
        let back = world_from_solved.isometry.rotation.inverse();
        let up = Unit::new_normalize(back * Vector3::z());
        self.ups.push(Up { by: by.clone(), up, sigma: tilt.hypot(network.options.level_sigma_rad) });
        let place = world_from_solved.inverse() * Point3::origin();
        let at_centroid = sigma / (known.len() as f64).sqrt();
        let sigma = at_centroid.hypot(tilt * spread.centroid.coords.norm()) / factor;
        self.origins.push(Origin { by, place, sigma, heading: Some(back * Vector3::x()) });
        Ok(())
    }

    /// Flat points fit as well when turned over: what is above the floor tells.
    fn not_upside_down(
        &self,
        network: &Room<'_>,
        by: &str,
        world_from_solved: &Similarity3<f64>,
        in_world: &[Point3<f64>],
    ) -> Result<(), AxesError> {
        let spread = Spread::of(in_world);
        let flat = spread.least < COLLINEAR * spread.largest && spread.flat_normal.z.abs() > 0.7;
        if !flat {
            return Ok(());
        }
        let floor = spread.centroid.z;
        let above = share_above(network.solved.points.iter().map(|it| (world_from_solved * it.position).z - floor));
        let mut calibrated = network.solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated);
        let cameras_below = calibrated.clone().all(|it| (world_from_solved * it.camera.centre()).z < floor);
        let to_world = world_from_solved.isometry.rotation;
        let upright = |it: &crate::solved::SolvedCamera| {
            let up = it.camera.camera_from_world.rotation.inverse() * -Vector3::y();
            (to_world * up).z
        };
        let heads_down = calibrated.clone().map(upright).sum::<f64>() < 0.0 && calibrated.next().is_some();
        if above <= 1.0 - ONE_SIDE && cameras_below && heads_down {
            let why = "the cameras would stand below the points, upside down".to_owned();
            return Err(AxesError::Mirrored { given: by.to_owned(), why });
        }
        Ok(())
    }

    fn floor(&mut self, network: &Room<'_>, places: &[Place], height_m: f64, sigma_m: f64) -> Result<(), AxesError> {
        let by = format!("{} points of a level floor", places.len());
        not_negative("the height of the light above the floor [m]", height_m)?;
        not_negative("the sigma of the floor [m]", sigma_m)?;
        if places.len() < 3 {
            return Err(AxesError::TooFewPlaces { given: by, found: places.len(), needed: 3 });
        }
        let located: Vec<Located> = places.iter().map(|it| network.locate(it)).collect::<Result<_, _>>()?;
        let in_solved: Vec<Point3<f64>> = located.iter().map(|it| it.position).collect();
        not_collinear(&by, &in_solved)?;
        apart(&by, located[0], located[1])?;
        let spread = Spread::of(&in_solved);
        let height = |it: &Point3<f64>| spread.flat_normal.dot(&(it - spread.centroid));
        let rest: Vec<f64> = in_solved.iter().map(|it| height(it).powi(2)).collect();
        let surplus = (rest.len() as f64 - 3.0).max(1.0);
        let own = (located.iter().map(|it| it.sigma * it.sigma).sum::<f64>() / located.len() as f64).sqrt();
        let sigma = own.max((rest.iter().sum::<f64>() / surplus).sqrt());
        let above = share_above(network.solved.points.iter().map(|it| height(&it.position)));
        if above > 1.0 - ONE_SIDE && above < ONE_SIDE {
            return Err(AxesError::NoSideIsUp { given: by, above: 100.0 * above });
        }
        let up = Unit::new_normalize(if above >= ONE_SIDE { spread.flat_normal } else { -spread.flat_normal });
        // What is said of the floor is in metres; without a scale the unit of the solution stands for it.
        let factor = combined(self.scales.iter().map(|it| (it.factor, it.sigma))).map_or(1.0, |it| it.0);
        let sigma = sigma.hypot(sigma_m / factor);
        let tilt = sigma / spread.middle;
        self.ups.push(Up { by: by.clone(), up, sigma: tilt.hypot(network.options.level_sigma_rad) });
        let place = in_solved[0] - up.into_inner() * (height_m / factor);
        self.origins.push(Origin { by, place, sigma, heading: Some(in_solved[1] - in_solved[0]) });
        Ok(())
    }

    fn falling(&mut self, network: &Room<'_>, label: u32, [from_s, until_s]: [f64; 2]) -> Result<(), AxesError> {
        if !(from_s.is_finite() && until_s.is_finite() && from_s < until_s) {
            let what = "the end of the fall, less its start [s]".to_owned();
            return Err(AxesError::BadNumber { what, found: until_s - from_s, expected: "a finite number above 0" });
        }
        let samples = network.span(label, from_s, until_s, fall::LEAST_SAMPLES)?;
        let fall = fall::find(&samples).map_err(|fault| AxesError::NoFall { from_s, until_s, fault })?;
        let by = format!("a fall from {:.2} s to {:.2} s", fall.span_s[0], fall.span_s[1]);
        let strength = fall.acceleration.norm();
        let sigma = fall.sigma / strength;
        self.scales.push(Scale {
            by: by.clone(),
            factor: network.options.gravity_mps2 / strength,
            sigma,
            metres: None,
        });
        self.ups.push(Up { by, up: Unit::new_normalize(-fall.acceleration), sigma });
        self.falls.push(fall);
        Ok(())
    }

    fn plumb(&mut self, network: &Room<'_>, [top, bottom]: [&Place; 2], sigma: f64) -> Result<(), AxesError> {
        not_negative("the sigma of the plumb line [–]", sigma)?;
        let by = format!("a plumb line from {top} to {bottom}");
        let (top, bottom) = (network.locate(top)?, network.locate(bottom)?);
        let (distance, own) = apart(&by, top, bottom)?;
        let up = Unit::new_normalize(top.position - bottom.position);
        self.ups.push(Up { by, up, sigma: (own / distance).hypot(sigma) });
        Ok(())
    }

    /// The direction to which the cameras' horizontal axes are most square.
    fn upright(&mut self, network: &Room<'_>) -> Result<(), AxesError> {
        let calibrated = network.solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated);
        let back: Vec<UnitQuaternion<f64>> =
            calibrated.map(|it| it.camera.camera_from_world.rotation.inverse()).collect();
        let mut scatter = Matrix3::zeros();
        let rights: Vec<Vector3<f64>> = back.iter().map(|it| it * Vector3::x()).collect();
        rights.iter().for_each(|it| scatter += it * it.transpose());
        let heads = back.iter().fold(Vector3::zeros(), |sum, it| sum + it * -Vector3::y());
        let axes = scatter.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| axes.eigenvalues[*a].total_cmp(&axes.eigenvalues[*b]));
        let [least, middle, _] = order;
        let roll = LEAST_ROLL.max((axes.eigenvalues[least].max(0.0) / (back.len() as f64 - 2.0).max(1.0)).sqrt());
        let sigma = roll / axes.eigenvalues[middle].max(f64::MIN_POSITIVE).sqrt();
        if back.len() < 2 || sigma > 0.3 {
            let why = format!("{} calibrated cameras point in nearly the same direction", back.len());
            return Err(AxesError::VerticalUnobservable { why });
        }
        let up: Vector3<f64> = axes.eigenvectors.column(least).into_owned();
        let agreement = up.dot(&heads) / back.len() as f64;
        if agreement.abs() < 0.2 {
            let why = "their upper edges do not lie on one side".to_owned();
            return Err(AxesError::VerticalUnobservable { why });
        }
        let by = "the cameras being mounted upright (an assumption)".to_owned();
        self.ups.push(Up { by, up: Unit::new_normalize(up * agreement.signum()), sigma });
        Ok(())
    }

    /// Weighs the sources of each freedom.
    pub(super) fn settle(&self, sigmas: f64) -> Result<Settled, AxesError> {
        for (a, b) in pairs(&self.scales) {
            let (difference, allowed) = ((a.factor / b.factor).ln().abs(), sigmas * a.sigma.hypot(b.sigma));
            let (a, b) = if a.metres.is_some() && b.metres.is_none() { (b, a) } else { (a, b) };
            let lengths = b.metres.map(|it| [it, it * a.factor / b.factor]);
            agree(FreedomName::Scale, [&a.by, &b.by], difference, allowed, lengths)?;
        }
        for (a, b) in pairs(&self.ups) {
            let (difference, allowed) = (a.up.angle(&b.up), sigmas * a.sigma.hypot(b.sigma));
            agree(FreedomName::Gravity, [&a.by, &b.by], difference, allowed, None)?;
        }
        let log_factor = combined(self.scales.iter().map(|it| (it.factor.ln(), it.sigma)));
        let factor = log_factor.map_or(1.0, |it| it.0.exp());
        for (a, b) in pairs(&self.origins) {
            let (difference, allowed) =
                ((a.place - b.place).norm() * factor, sigmas * a.sigma.hypot(b.sigma) * 2.0 * factor);
            agree(FreedomName::Origin, [&a.by, &b.by], difference, allowed, None)?;
        }
        let weighted = self.ups.iter().fold(Vector3::zeros(), |sum, it| sum + it.up.into_inner() / it.sigma.powi(2));
        let up = (!self.ups.is_empty()).then(|| weighted.normalize());
        let up_sigma = combined(self.ups.iter().map(|it| (0.0, it.sigma))).map(|it| it.1);
        // One origin, of the best source: a mean of two would be the place of neither.
        let best = self.origins.iter().min_by(|a, b| a.sigma.total_cmp(&b.sigma));
        let rotation = up.map_or_else(UnitQuaternion::identity, |up| {
            turn(up, best.and_then(|it| it.heading).unwrap_or_else(Vector3::x))
        });
        let origin = best.map_or_else(Point3::origin, |it| it.place);
        let translation = -(rotation * origin.coords) * factor;
        let world_from_solved = Similarity3::from_isometry(Isometry3::from_parts(translation.into(), rotation), factor);
        let mut figures = Vec::new();
        let mut figure = |freedom, by: &String, off: f64, sigma: f64| {
            figures.push(SourceFigure { freedom, by: by.clone(), off, sigma });
        };
        self.scales.iter().for_each(|it| figure(FreedomName::Scale, &it.by, it.factor / factor - 1.0, it.sigma));
        if let Some(up) = up {
            self.ups.iter().for_each(|it| figure(FreedomName::Gravity, &it.by, it.up.angle(&up), it.sigma));
        }
        for it in &self.origins {
            figure(FreedomName::Origin, &it.by, (it.place - origin).norm() * factor, it.sigma * factor);
        }
        let named = |names: Vec<&String>, sigma: Option<f64>| {
            let by = names.into_iter().map(String::as_str).collect::<Vec<_>>().join("; ");
            sigma.map(|it| Fixed { by, sigma: Some(it) })
        };
        let fixed = FixedFreedoms {
            scale: named(self.scales.iter().map(|it| &it.by).collect(), log_factor.map(|it| it.1)),
            gravity: named(self.ups.iter().map(|it| &it.by).collect(), up_sigma),
            origin: named(best.iter().map(|it| &it.by).collect(), best.map(|it| it.sigma * factor)),
        };
        Ok(Settled { world_from_solved, fixed, figures })
    }
}

/// The rotation that takes `up` to Z, and `heading` above X; where heading is upright itself, any.
fn turn(up: Vector3<f64>, heading: Vector3<f64>) -> UnitQuaternion<f64> {
    let level = |it: Vector3<f64>| it - up * up.dot(&it);
    let x = [heading.normalize(), Vector3::x(), Vector3::y()].map(level).into_iter().find(|it| it.norm() > 0.1);
    let x = x.map_or_else(|| up.cross(&Vector3::z()).normalize(), |it| it.normalize());
    let solved_from_world = Rotation3::from_basis_unchecked(&[x, up.cross(&x), up]);
    UnitQuaternion::from_rotation_matrix(&solved_from_world).inverse()
}

fn pairs<T>(list: &[T]) -> impl Iterator<Item = (&T, &T)> {
    list.iter().enumerate().flat_map(|(index, a)| list[index + 1..].iter().map(move |b| (a, b)))
}

fn agree(
    freedom: FreedomName,
    [a, b]: [&String; 2],
    difference: f64,
    allowed: f64,
    lengths_m: Option<[f64; 2]>,
) -> Result<(), AxesError> {
    let fault = || AxesError::Contradiction { freedom, a: a.clone(), b: b.clone(), difference, allowed, lengths_m };
    if difference <= allowed { Ok(()) } else { Err(fault()) }
}

/// Mean by inverse variance, and its standard deviation.
fn combined(values: impl Iterator<Item = (f64, f64)>) -> Option<(f64, f64)> {
    let (sum, weight) = values.fold((0.0, 0.0), |(sum, total), (value, sigma)| {
        let weight = 1.0 / (sigma * sigma);
        (sum + weight * value, total + weight)
    });
    (weight > 0.0).then(|| (sum / weight, weight.sqrt().recip()))
}

/// Share of the sum of all distances from a floor that lies above it: places near it count little. One half without any.
fn share_above(heights: impl Iterator<Item = f64>) -> f64 {
    let (above, all) = heights.fold((0.0, 0.0), |(above, all), it| (above + it.max(0.0), all + it.abs()));
    if all > 0.0 { above / all } else { 0.5 }
}

/// Distance of two places and its standard deviation; a fault where it is not well above 0.
fn apart(given: &str, a: Located, b: Located) -> Result<(f64, f64), AxesError> {
    let (distance, sigma) = ((a.position - b.position).norm(), a.sigma.hypot(b.sigma));
    if distance.is_nan() || distance <= 5.0 * sigma {
        return Err(AxesError::SamePlace { given: given.to_owned(), distance, sigma });
    }
    Ok((distance, sigma))
}
