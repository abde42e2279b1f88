//! One camera's optics from its views of the board, and which of them the views determine.

use foveate_estimation::Loss;
use foveate_geometry::Camera;
use foveate_geometry::bundle::{CLOCK, Freedom, Optic, OpticsSigma};
use nalgebra::{Isometry3, Point2, Point3, SMatrix, Vector3};

use super::plane::{self, Homography};
use super::rigid::{self, Rigid, RigidOptions, Seen};
use super::{BoardOptions, OpticsFit, OpticsRefusal, Refused};

/// What one camera saw of the board in one picture.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub places: Vec<Point3<f64>>,
    pub pixels: Vec<Point2<f64>>,
    pub sigmas: Vec<f64>,
    pub homography: Homography,
}

/// Views that are looked at when optics are sought; more of the same hardly tell more.
const MAX_VIEWS: usize = 60;
/// A view whose marks are on average no farther than this from where another has them is the same [px].
const SAME_VIEW_PX: f64 = 3.0;
/// Views for the first guess of the focal length.
const START_VIEWS: usize = 15;

/// Finds what `free` asks for and the views can hold.
pub(super) fn fit(guess: &Camera, free: Freedom, views: &[&View], options: &BoardOptions) -> OpticsFit {
    let wanted = Freedom { pose: false, ..free };
    let mut fit = OpticsFit {
        camera: Camera { camera_from_world: Isometry3::identity(), ..guess.clone() },
        freed: Freedom::NONE,
        contradicted: false,
        sigma: OpticsSigma::default(),
        refused: Vec::new(),
        views: views.len(),
        reach: reach(guess, views),
        tilt_rad: 0.0,
        rms_px: f64::NAN,
    };
    if wanted == Freedom::NONE || views.is_empty() {
        return fit;
    }
    let views = &different(views)[..];
    if views.len() < options.min_views {
        let why = OpticsRefusal::TooFewViews { views: views.len(), needed: options.min_views };
        fit.refused = ladder(wanted).map(|what| Refused { what, why }).collect();
        return fit;
    }
    let chosen: Vec<&View> = spread(views, MAX_VIEWS);
    let mut start = fit.camera.clone();
    if wanted.focal {
        start = first_focal(guess, wanted, &spread(views, START_VIEWS), options);
    }
    let mut freed = wanted;
    loop {
        let Some((adjusted, n)) = refine(&start, freed, &chosen, options) else {
            fit.refused = ladder(wanted).map(|what| Refused { what, why: OpticsRefusal::Misfit }).collect();
            fit.freed = Freedom::NONE;
            return fit;
        };
        fit.tilt_rad = tilt(&adjusted.world_from_board);
        let camera = &adjusted.cameras[0];
        let squares: f64 = adjusted.residuals.iter().flatten().map(|it| it.norm_squared()).sum();
        let distances: Vec<f64> = adjusted.residuals.iter().flatten().map(|it| it.norm()).collect();
        fit.rms_px = (squares / adjusted.residuals.len().max(1) as f64).sqrt();
        // Noise as it was found, robustly, in units of what the observations claim: the median length of a 2D normal is 1.1774 σ.
        let sigma_px = foveate_estimation::statistics::median(&distances).unwrap_or(0.0) / 1.1774;
        let claimed = chosen.iter().flat_map(|it| &it.sigmas).sum::<f64>() / n.max(1) as f64;
        let factor = (sigma_px / claimed).max(1e-6);
        match verdict(camera, guess, freed, &adjusted, factor, n, &fit, options) {
            Some(refused) => {
                start = adjusted.cameras[0].clone();
                reset(&mut start, guess, refused.what);
                freed = freed.without(refused.what);
                fit.refused.push(refused);
                if freed == Freedom::NONE {
                    fit.freed = freed;
                    fit.camera = start;
                    return fit;
                }
            }
            None => {
                fit.sigma = OpticsSigma::of(|column| adjusted.columns[0][(column, column)].max(0.0).sqrt() * factor);
                fit.camera = adjusted.cameras[0].clone();
                fit.freed = freed;
                return fit;
            }
        }
    }
}

/// The next optic that has to be given up, if any.
#[expect(clippy::too_many_arguments, reason = "all of them are of one fit, which is at hand nowhere else")]
fn verdict(
    camera: &Camera,
    guess: &Camera,
    freed: Freedom,
    adjusted: &Rigid,
    factor: f64,
    n: usize,
    fit: &OpticsFit,
    options: &BoardOptions,
) -> Option<Refused> {
    let refusable: Vec<Optic> = ladder(freed).collect();
    let open_reason = |sigma: f64, limit: f64| match () {
        () if fit.tilt_rad < options.min_tilt_rad => {
            OpticsRefusal::ViewsParallel { tilt_rad: fit.tilt_rad, needed_rad: options.min_tilt_rad }
        }
        () if fit.reach < 0.5 => OpticsRefusal::MiddleOnly { reach: fit.reach },
        () => OpticsRefusal::Uncertain { sigma, limit },
    };
    if let Some(Err(open)) = &adjusted.covariance {
        let named = |it: &&Optic| open.iter().any(|(_, name)| Optic::named(name) == Some(**it));
        let what = refusable.iter().find(named).or(refusable.first()).copied()?;
        return Some(Refused { what, why: open_reason(f64::INFINITY, 0.0) });
    }
    let block = adjusted.columns.first()?;
    let sigma = |column: usize| block[(column, column)].max(0.0).sqrt() * factor;
    let (size, intrinsics) = (camera.image_size, &camera.intrinsics);
    let focal = intrinsics.focal[0];
    let half_diagonal = f64::from(size[0]).hypot(f64::from(size[1])) / 2.0;
    let corner = half_diagonal / focal;
    // Terms whose effect at the corner of the image is uncertain: the highest of them goes.
    let mut by_radial = SMatrix::<f64, CLOCK, 1>::zeros();
    for (power, column) in [(3, 7), (5, 8), (7, 14)] {
        by_radial[column] = focal * corner.powi(power);
    }
    let radial = (by_radial.transpose() * block * by_radial)[0].max(0.0).sqrt() * factor;
    for what in refusable.iter().copied() {
        let (found, limit) = match what {
            Optic::K3 | Optic::K2 | Optic::K1 => (radial, options.max_corner_px),
            Optic::Decentering => (sigma(12).hypot(sigma(13)) * 3.0 * corner * corner * focal, options.max_corner_px),
            Optic::Principal => (sigma(9).max(sigma(10)), 0.02 * half_diagonal * 2.0),
            Optic::Aspect => (sigma(11), 0.01),
            Optic::Focal => continue,
        };
        if found > limit {
            return Some(Refused { what, why: open_reason(found, limit) });
        }
    }
    // The focal length is worth more than any other: all of them go first.
    if freed.focal && sigma(6) > options.max_focal_sigma {
        return Some(Refused { what: *refusable.first()?, why: open_reason(sigma(6), options.max_focal_sigma) });
    }
    // A term that explains less than its place in the Bayesian information criterion costs is better left as it was.
    let cost = (n as f64).max(2.0).ln();
    for what in refusable {
        let gained = |column: usize, by: f64| (by / sigma(column).max(f64::MIN_POSITIVE)).powi(2);
        let lens = (&camera.distortion, &guess.distortion);
        let gain = match what {
            Optic::K3 => gained(14, lens.0.k3 - lens.1.k3),
            Optic::Decentering => (gained(12, lens.0.p1 - lens.1.p1) + gained(13, lens.0.p2 - lens.1.p2)) / 2.0,
            Optic::Aspect => {
                let ratio = |it: &Camera| it.intrinsics.focal[1] / it.intrinsics.focal[0];
                gained(11, (ratio(camera) / ratio(guess)).ln())
            }
            _ => f64::INFINITY,
        };
        if gain < cost {
            return Some(Refused { what, why: OpticsRefusal::Unneeded });
        }
    }
    None
}

/// The views without those that show the board where one before them does: these add pictures, but nothing about the optics.
fn different<'a>(views: &[&'a View]) -> Vec<&'a View> {
    let apart = |a: &View, b: &View| {
        let at = |of: &View, place: &Point3<f64>| {
            let seen = of.homography.image_from_plane * place.coords.xy().push(1.0);
            seen.xy() / seen.z
        };
        let sum: f64 = b.places.iter().map(|place| (at(a, place) - at(b, place)).norm()).sum();
        sum / b.places.len() as f64
    };
    let mut kept: Vec<&View> = Vec::new();
    for view in views {
        if kept.iter().all(|it| apart(it, view) > SAME_VIEW_PX) {
            kept.push(view);
        }
    }
    kept
}

/// What is free, in the order in which it is given up.
fn ladder(free: Freedom) -> impl Iterator<Item = Optic> {
    Optic::ALL.into_iter().rev().filter(move |it| free.frees(*it))
}

/// Puts an optic back to what was given.
fn reset(camera: &mut Camera, given: &Camera, optic: Optic) {
    let (lens, was) = (&mut camera.distortion, &given.distortion);
    let (intrinsics, before) = (&mut camera.intrinsics, &given.intrinsics);
    match optic {
        Optic::K3 => lens.k3 = was.k3,
        Optic::Decentering => (lens.p1, lens.p2) = (was.p1, was.p2),
        Optic::Aspect => intrinsics.focal[1] = intrinsics.focal[0] * before.focal[1] / before.focal[0],
        Optic::K2 => lens.k2 = was.k2,
        Optic::Principal => intrinsics.principal = before.principal,
        Optic::K1 => lens.k1 = was.k1,
        Optic::Focal => intrinsics.focal = before.focal,
    }
}

/// The best of a few focal lengths to start from.
fn first_focal(guess: &Camera, wanted: Freedom, views: &[&View], options: &BoardOptions) -> Camera {
    let homographies: Vec<Homography> = views.iter().map(|it| it.homography).collect();
    let width = f64::from(guess.image_size[0]);
    let given = guess.intrinsics.focal[0];
    let candidates = plane::focal(&homographies, guess.intrinsics.principal).into_iter().chain([
        given,
        0.6 * width,
        width,
        2.0 * width,
        4.0 * width,
    ]);
    let freed = Freedom { focal: true, k1: wanted.k1, ..Freedom::NONE };
    let mut best: Option<(f64, Camera)> = None;
    for focal in candidates {
        let mut camera = Camera { camera_from_world: Isometry3::identity(), ..guess.clone() };
        let factor = focal / given;
        camera.intrinsics.focal = guess.intrinsics.focal.map(|it| it * factor);
        let rough =
            RigidOptions { loss: Loss::HUBER, max_iterations: 25, relative_gain: 1e-4, ..RigidOptions::default() };
        let Some((adjusted, _)) = refine_once(&camera, freed, views, options, &rough) else { continue };
        if best.as_ref().is_none_or(|it| adjusted.cost < it.0) {
            best = Some((adjusted.cost, adjusted.cameras[0].clone()));
        }
    }
    best.map_or_else(|| guess.clone(), |it| it.1)
}

/// Optics and views together, twice: the second time from the poses, mirrored ones among them, that fit the new optics best.
fn refine(start: &Camera, freed: Freedom, views: &[&View], options: &BoardOptions) -> Option<(Rigid, usize)> {
    let rough = RigidOptions { loss: Loss::HUBER, max_iterations: 40, ..RigidOptions::default() };
    let (first, _) = refine_once(start, freed, views, options, &rough)?;
    let fine = RigidOptions { loss: Loss::HUBER, covariance: true, ..RigidOptions::default() };
    refine_once(&first.cameras[0], freed, views, options, &fine)
}

fn refine_once(
    camera: &Camera,
    freed: Freedom,
    views: &[&View],
    options: &BoardOptions,
    how: &RigidOptions,
) -> Option<(Rigid, usize)> {
    let (mut boards, mut seen) = (Vec::new(), Vec::new());
    for view in views {
        // Far from the truth no mark is within the usual distance.
        let wide = options.inlier_px.max(0.1 * view.homography.extent);
        let Some(best) = plane::poses(camera, &view.places, &view.pixels, wide).first().copied() else { continue };
        let board = boards.len();
        boards.push(best.camera_from_board);
        let marks = view.places.iter().zip(&view.pixels).zip(&view.sigmas);
        seen.extend(marks.map(|((place, pixel), sigma)| Seen {
            camera: 0,
            board,
            place: *place,
            pixel: *pixel,
            sigma_px: *sigma,
        }));
    }
    if boards.len() < options.min_views.min(views.len()) {
        return None;
    }
    let n = seen.len();
    Some((rigid::adjust(std::slice::from_ref(camera), &[freed], &boards, &seen, how)?, n))
}

fn spread<'a>(views: &[&'a View], at_most: usize) -> Vec<&'a View> {
    let n = views.len().min(at_most);
    (0..n).map(|it| views[it * views.len() / n]).collect()
}

/// How far from the principal point marks were seen: the 95th percentile over half the diagonal of the image [–].
fn reach(camera: &Camera, views: &[&View]) -> f64 {
    let centre = Point2::from(camera.intrinsics.principal);
    let radii: Vec<f64> = views.iter().flat_map(|it| &it.pixels).map(|it| (it - centre).norm()).collect();
    let half = f64::from(camera.image_size[0]).hypot(f64::from(camera.image_size[1])) / 2.0;
    foveate_estimation::statistics::percentile(&radii, 95.0).unwrap_or(0.0) / half
}

/// The largest angle between the normals of two views, or of a view to the optical axis: without either, depth and focal length are one [rad].
fn tilt(boards: &[Isometry3<f64>]) -> f64 {
    let normals: Vec<Vector3<f64>> = boards.iter().map(|it| it.rotation * Vector3::z()).collect();
    let to_axis = normals.iter().map(|it| it.dot(&Vector3::z()).abs().min(1.0).acos());
    to_axis.fold(0.0, f64::max)
}
