//! Joint mapping of several cameras to one plane, from a point moved over the plane and a few known places.
//!
//! Cameras with overlapping views see the moving point at the same moments; a homography maps the picture of one to
//! that of the other (Hartley and Zisserman, §2.3). Homographies are chained along the tree of the strongest overlaps;
//! the known places give the plane its axes and its scale. From there all maps, lenses included, and the points of all
//! moments are adjusted together, with the points eliminated (B. Triggs et al., "Bundle adjustment: a modern
//! synthesis", 2000, §6.1).

use foveate_estimation::least_squares::{DriverOptions, GroupedEquations, GroupedProblem, Loss, solve_grouped};
use foveate_estimation::statistics::median;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Point2, SMatrix, SVector, Vector2};

use super::{
    LEAST_SPREAD, LOSS_SIGMAS, PRIOR_DECENTERING, PRIOR_RADIAL, PlaneMap, PlanePoint, UNKNOWNS, first_homography,
    spread,
};
use crate::Distortion;

/// Least number of moments shared by two cameras, for a homography between them: it has eight unknowns, and outliers must stand out.
pub const LEAST_SHARED: usize = 20;
/// Least number of known places, for the axes and the scale of the plane.
pub const LEAST_PLACES: usize = 4;
/// A point that moved over less of a picture stood still, relative to its width.
const STOOD_STILL: f64 = 0.03;
/// Beyond so many standard deviations an observation is an outlier, when they are counted.
const OUTLIER_SIGMAS: f64 = 6.0;
/// Median of the square of two normal deviates: 2 ln 2.
const MEDIAN_OF_TWO: f64 = 1.386_294_361_119_890_6;

/// An observation of the moved point by one camera at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MomentObservation {
    /// Index of the moment.
    pub moment: usize,
    /// Index of the camera.
    pub camera: usize,
    /// Measured pixel, raw [px].
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along each axis [px].
    pub sigma: f64,
}

/// A known place on the plane, and its observations.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownPlace {
    /// Position on the plane [m].
    pub point: Point2<f64>,
    /// Standard deviation of the position, along each axis [m].
    pub sigma: f64,
    /// Observations: camera, pixel, its standard deviation [px].
    pub seen: Vec<(usize, Point2<f64>, f64)>,
}

/// Why a camera has no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unmapped {
    /// The camera saw the point too rarely.
    #[error("it saw the moved point {moments} times, expected at least {LEAST_SHARED}")]
    Unseen {
        /// Number of moments.
        moments: usize,
    },
    /// The point hardly moved in the camera's picture.
    #[error("in its picture the point moved over {extent_px:.1} px, expected more: it stood still")]
    StoodStill {
        /// Extent of the motion [px].
        extent_px: f64,
    },
    /// The camera's view overlaps no other enough.
    #[error(
        "it shares at most {shared} moments with a camera that is mapped, expected at least {LEAST_SHARED}: their views do not overlap, or the point was not moved where they do"
    )]
    NotConnected {
        /// The most moments shared with a mapped camera.
        shared: usize,
    },
    /// The points shared with other cameras lie on a line.
    #[error(
        "the points that it shares with other cameras lie on one line: move the point to and fro where their views overlap"
    )]
    OnALine,
}

/// Why there are no maps at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NetworkError {
    /// No two cameras share enough moments.
    #[error("no two cameras share {LEAST_SHARED} moments of the point, spread beyond one line")]
    NoOverlap,
    /// Too few known places were seen.
    #[error("{seen} known places were seen by connected cameras, expected at least {LEAST_PLACES}")]
    TooFewPlaces {
        /// Number of known places.
        seen: usize,
    },
    /// The known places do not determine the axes.
    #[error("the known places lie on one line, or were seen by cameras whose views are not connected to the others")]
    NoAxes,
    /// The adjustment failed.
    #[error("no maps explain the observations of all cameras together: {0}")]
    NoFit(&'static str),
}

/// Maps of several cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneNetwork {
    /// By camera: its map with covariance, or why it has none.
    pub maps: Vec<Result<PlaneMap, Unmapped>>,
    /// By camera: number of observations that fit badly and got little weight.
    pub outliers: Vec<usize>,
    /// Ratio of the pixel errors to their stated standard deviations.
    pub sigma_factor: f64,
}

/// Maps all cameras to the plane; their pictures have `sizes` [px].
///
/// # Errors
/// See [`NetworkError`]. Cameras that cannot be connected to the others have no map; the others do.
pub fn fit_network(
    sizes: &[[u32; 2]],
    observations: &[MomentObservation],
    places: &[KnownPlace],
) -> Result<PlaneNetwork, NetworkError> {
    let n = sizes.len();
    let n_moments = observations.iter().map(|it| it.moment + 1).max().unwrap_or(0);
    let mut seen: Vec<Vec<Option<Point2<f64>>>> = vec![vec![None; n_moments]; n];
    for it in observations {
        seen[it.camera][it.moment] = Some(it.pixel);
    }
    let (mut refused, links) = links(sizes, &seen);
    let from_root = chained(&mut refused, &links, n).ok_or(NetworkError::NoOverlap)?;
    let start = start(sizes, &from_root, places)?;
    let mut columns = vec![None; n];
    for (number, camera) in (0..n).filter(|it| start[*it].is_some()).enumerate() {
        columns[camera] = Some(number * UNKNOWNS);
    }
    let problem = Adjustment::new(observations, places, &start, columns);
    let start = State { points: problem.start(&start), maps: start };
    let loss = Loss::Cauchy { scale: LOSS_SIGMAS };
    let solution = solve_grouped(&problem, start, loss, &DriverOptions::default())
        .map_err(|_| NetworkError::NoFit("are the known places right, and was one point alone moved over the wall?"))?;
    let (covariance, _) = solution.covariance().map_err(|_| {
        NetworkError::NoFit("a part of some view has too few observations: move the point all over where views overlap")
    })?;
    Ok(problem.outcome(&solution.parameters, &covariance, refused))
}

/// Homographies between ideal pictures without lenses: `b_from_a` by pair, with how many moments they share.
struct Link {
    a: usize,
    b: usize,
    shared: usize,
    b_from_a: Option<Matrix3<f64>>,
}

fn centred(size: [u32; 2], pixel: &Point2<f64>) -> Point2<f64> {
    let [width, height] = size.map(f64::from);
    let half = width / 2.0;
    Point2::new((pixel.x - (width - 1.0) / 2.0) / half, (pixel.y - (height - 1.0) / 2.0) / half)
}

/// What each pair of cameras shares, and cameras that can share nothing.
fn links(sizes: &[[u32; 2]], seen: &[Vec<Option<Point2<f64>>>]) -> (Vec<Option<Unmapped>>, Vec<Link>) {
    let refused = seen.iter().zip(sizes).map(|(own, size)| {
        let pixels: Vec<Point2<f64>> = own.iter().flatten().copied().collect();
        if pixels.len() < LEAST_SHARED {
            return Some(Unmapped::Unseen { moments: pixels.len() });
        }
        let extent = |axis: usize| {
            let along = pixels.iter().map(|it| it[axis]);
            let (least, most) = along.fold((f64::MAX, f64::MIN), |(a, b), it| (a.min(it), b.max(it)));
            most - least
        };
        let extent_px = extent(0).max(extent(1));
        (extent_px < STOOD_STILL * f64::from(size[0])).then_some(Unmapped::StoodStill { extent_px })
    });
    let refused: Vec<Option<Unmapped>> = refused.collect();
    let mut links = Vec::new();
    for b in 0..seen.len() {
        for a in (0..b).filter(|a| refused[*a].is_none() && refused[b].is_none()) {
            let both = seen[a].iter().zip(&seen[b]).filter_map(|(a, b)| Some(((*a)?, (*b)?)));
            let points: Vec<PlanePoint> = both
                .map(|(in_a, in_b)| PlanePoint { point: centred(sizes[a], &in_a), pixel: in_b, sigma: 1.0 })
                .collect();
            let off_a_line = |places: Vec<Point2<f64>>| spread(&places) >= LEAST_SPREAD;
            let is_enough = points.len() >= LEAST_SHARED
                && off_a_line(points.iter().map(|it| it.point).collect())
                && off_a_line(points.iter().map(|it| it.pixel).collect());
            let b_from_a = is_enough.then(|| first_homography(sizes[b], &points)).flatten();
            links.push(Link { a, b, shared: points.len(), b_from_a });
        }
    }
    (refused, links)
}

/// By camera, the homography from the root's picture, along the tree of the strongest links; reasons for those that are not reached go to `refused`. `None` without any link.
fn chained(refused: &mut [Option<Unmapped>], links: &[Link], n: usize) -> Option<Vec<Option<Matrix3<f64>>>> {
    let strongest = links.iter().filter(|it| it.b_from_a.is_some()).max_by_key(|it| it.shared)?;
    let mut from_root = vec![None; n];
    from_root[strongest.a] = Some(Matrix3::identity());
    loop {
        let grows = |it: &&Link| it.b_from_a.is_some() && from_root[it.a].is_some() != from_root[it.b].is_some();
        let Some(link) = links.iter().filter(grows).max_by_key(|it| it.shared) else { break };
        let b_from_a = link.b_from_a?;
        match from_root[link.a] {
            Some(a_from_root) => from_root[link.b] = Some(b_from_a * a_from_root),
            None => from_root[link.a] = Some(b_from_a.try_inverse()? * from_root[link.b]?),
        }
    }
    for (camera, reason) in refused.iter_mut().enumerate() {
        if from_root[camera].is_some() || reason.is_some() {
            continue;
        }
        let own =
            |it: &&Link| (it.a == camera && from_root[it.b].is_some()) || (it.b == camera && from_root[it.a].is_some());
        let shared = links.iter().filter(own).map(|it| it.shared).max().unwrap_or(0);
        *reason = Some(if shared < LEAST_SHARED { Unmapped::NotConnected { shared } } else { Unmapped::OnALine });
    }
    Some(from_root)
}

/// Maps without lenses: by the places that are known.
fn start(
    sizes: &[[u32; 2]],
    from_root: &[Option<Matrix3<f64>>],
    places: &[KnownPlace],
) -> Result<Vec<Option<PlaneMap>>, NetworkError> {
    let in_root = places.iter().filter_map(|place| {
        place.seen.iter().find_map(|(camera, pixel, _)| {
            let on_root = from_root[*camera]?.try_inverse()? * centred(sizes[*camera], pixel).coords.push(1.0);
            let pixel = Point2::new(on_root.x / on_root.z, on_root.y / on_root.z);
            Some(PlanePoint { point: place.point, pixel, sigma: 1.0 })
        })
    });
    let in_root: Vec<PlanePoint> = in_root.collect();
    if in_root.len() < LEAST_PLACES {
        return Err(NetworkError::TooFewPlaces { seen: in_root.len() });
    }
    if spread(&in_root.iter().map(|it| it.point).collect::<Vec<_>>()) < LEAST_SPREAD {
        return Err(NetworkError::NoAxes);
    }
    // A picture of two "pixels" about 0.5 has half widths for pixels.
    let shifted: Vec<PlanePoint> =
        in_root.iter().map(|it| PlanePoint { pixel: it.pixel + Vector2::new(0.5, 0.5), ..*it }).collect();
    let root_from_wall = first_homography([2, 2], &shifted).ok_or(NetworkError::NoAxes)?;
    let maps = sizes.iter().zip(from_root).map(|(size, from_root)| {
        let Some(from_root) = from_root else { return Ok(None) };
        let h = from_root * root_from_wall;
        if h[(2, 2)].abs() < 1e-12 * h.norm() {
            return Err(NetworkError::NoAxes);
        }
        Ok(Some(PlaneMap {
            image_size: *size,
            ideal_from_plane: h / h[(2, 2)],
            distortion: Distortion::default(),
            covariance: SMatrix::zeros(),
            mesh: None,
        }))
    });
    maps.collect()
}

#[derive(Debug, Clone)]
struct State {
    maps: Vec<Option<PlaneMap>>,
    points: Vec<Point2<f64>>,
}

/// One observation of a group: camera, pixel, standard deviation.
type Seen = (usize, Point2<f64>, f64);

struct Adjustment<'a> {
    /// First unknown of each camera that has a map.
    columns: Vec<Option<usize>>,
    /// By group, what is known of its place.
    known: Vec<Option<&'a KnownPlace>>,
    seen: Vec<Vec<Seen>>,
}

impl<'a> Adjustment<'a> {
    /// Groups are known places, then moments that several cameras with maps saw.
    fn new(
        observations: &[MomentObservation],
        places: &'a [KnownPlace],
        maps: &[Option<PlaneMap>],
        columns: Vec<Option<usize>>,
    ) -> Adjustment<'a> {
        let mut by_moment = std::collections::BTreeMap::<usize, Vec<Seen>>::new();
        for it in observations.iter().filter(|it| maps[it.camera].is_some()) {
            by_moment.entry(it.moment).or_default().push((it.camera, it.pixel, it.sigma));
        }
        let (mut known, mut seen) = (Vec::new(), Vec::new());
        for place in places {
            known.push(Some(place));
            seen.push(place.seen.iter().filter(|it| maps[it.0].is_some()).copied().collect());
        }
        for own in by_moment.into_values().filter(|it| it.len() > 1) {
            known.push(None);
            seen.push(own);
        }
        Adjustment { columns, known, seen }
    }

    fn start(&self, maps: &[Option<PlaneMap>]) -> Vec<Point2<f64>> {
        let start = self.known.iter().zip(&self.seen).map(|(known, seen)| {
            let places = seen.iter().filter_map(|(camera, pixel, _)| maps[*camera].as_ref()?.point(pixel));
            let places: Vec<Vector2<f64>> = places.map(|it| it.coords).collect();
            let mean = places.iter().sum::<Vector2<f64>>() / places.len().max(1) as f64;
            known.map_or(Point2::from(mean), |it| it.point)
        });
        start.collect()
    }

    fn outcome(&self, at: &State, covariance: &DMatrix<f64>, refused: Vec<Option<Unmapped>>) -> PlaneNetwork {
        let mut misses: Vec<(usize, f64)> = Vec::new();
        for (point, seen) in at.points.iter().zip(&self.seen) {
            for (camera, pixel, sigma) in seen {
                let off = at.maps[*camera].as_ref().and_then(|it| it.pixel(point)).map(|it| (it - pixel) / *sigma);
                misses.push((*camera, off.map_or(f64::INFINITY, |it| it.norm_squared())));
            }
        }
        let n = 2.0 * misses.len() as f64;
        let n_unknown = covariance.nrows() as f64 + 2.0 * at.points.len() as f64;
        let left = ((n - n_unknown) / n).max(0.01);
        let squares: Vec<f64> = misses.iter().map(|it| it.1).collect();
        let factor = (median(&squares).unwrap_or(0.0) / (MEDIAN_OF_TWO * left)).max(1.0);
        let mut outliers = vec![0; self.columns.len()];
        for (camera, square) in &misses {
            outliers[*camera] += usize::from(*square > OUTLIER_SIGMAS * OUTLIER_SIGMAS * factor);
        }
        let maps = at.maps.iter().zip(&self.columns).zip(refused).map(|((map, column), why)| match (map, column) {
            (Some(map), Some(column)) => {
                let covariance = SMatrix::from_fn(|a, b| covariance[(column + a, column + b)] * factor);
                Ok(PlaneMap { covariance, ..map.clone() })
            }
            _ => Err(why.unwrap_or(Unmapped::NotConnected { shared: 0 })),
        });
        PlaneNetwork { maps: maps.collect(), outliers, sigma_factor: factor.sqrt() }
    }
}

impl GroupedProblem<2> for Adjustment<'_> {
    type Parameters = State;

    fn dimension(&self) -> usize {
        self.columns.iter().flatten().count() * UNKNOWNS
    }

    fn n_groups(&self) -> usize {
        self.seen.len()
    }

    fn moved(&self, from: &State, shared: &DVector<f64>, groups: &[SVector<f64, 2>]) -> State {
        let maps = from.maps.iter().zip(&self.columns).map(|(map, column)| {
            let column = (*column)?;
            Some(map.as_ref()?.moved(&shared.as_slice()[column..column + UNKNOWNS]))
        });
        let points = from.points.iter().zip(groups).map(|(point, step)| point + step);
        State { maps: maps.collect(), points: points.collect() }
    }

    fn linearise(&self, at: &State, equations: &mut GroupedEquations<2>) -> Option<()> {
        for (group, (point, seen)) in at.points.iter().zip(&self.seen).enumerate() {
            if let Some(known) = self.known[group] {
                let off = (point - known.point) / known.sigma;
                let by_point = Matrix2::identity() / known.sigma;
                equations.add(&[], group, &off, (&SMatrix::<f64, 2, 0>::zeros(), &by_point));
            }
            for (camera, pixel, sigma) in seen {
                let (Some(map), Some(column)) = (&at.maps[*camera], self.columns[*camera]) else { continue };
                let (found, by_point) = map.pixel_with_jacobian(point)?;
                let by_unknowns = map.pixel_by_unknowns(point)?;
                let rows: [Option<usize>; UNKNOWNS] = std::array::from_fn(|it| Some(column + it));
                let jacobians = (&(by_unknowns / *sigma), &(by_point / *sigma));
                equations.add(&rows, group, &((found - pixel) / *sigma), jacobians);
            }
        }
        for (map, column) in at.maps.iter().zip(&self.columns) {
            let (Some(map), Some(column)) = (map, column) else { continue };
            let Distortion { k1, k2, k3, p1, p2 } = map.distortion;
            for (number, term) in [k1, k2, k3, p1, p2].into_iter().enumerate() {
                let sigma = if number < 3 { PRIOR_RADIAL } else { PRIOR_DECENTERING };
                equations.add_known(column + 8 + number, term / sigma, 1.0 / sigma);
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::Random;

    use super::*;
    use crate::{Camera, Intrinsics};

    const SIZE: [u32; 2] = [640, 480];
    const WALL: [f64; 2] = [2.8, 1.2];

    /// Three cameras in a row whose views overlap by a third.
    fn cameras() -> Vec<Camera> {
        let camera = |x: f64, k1: f64| Camera {
            image_size: SIZE,
            intrinsics: Intrinsics { focal: [880.0, 882.0], principal: [322.0, 238.0], skew: 0.0 },
            distortion: Distortion { k1, p1: 2e-4, ..Distortion::default() },
            camera_from_world: nalgebra::Isometry3::translation(-x, -0.6, 1.9),
        };
        vec![camera(0.62, -0.06), camera(1.4, -0.03), camera(2.18, 0.02)]
    }

    struct Scene {
        observations: Vec<MomentObservation>,
        places: Vec<KnownPlace>,
    }

    fn scene(noise: f64, seed: u64, path: impl Fn(usize) -> Point2<f64>) -> Scene {
        let mut random = Random::new(seed);
        let cameras = cameras();
        let mut see = |camera: usize, point: &Point2<f64>| {
            let pixel = cameras[camera].sees(&nalgebra::Point3::new(point.x, point.y, 0.0))?;
            Some(pixel + Vector2::new(random.normal(), random.normal()) * noise)
        };
        let sigma = noise.max(0.01);
        let mut observations = Vec::new();
        for moment in 0..900 {
            for camera in 0..3 {
                if let Some(pixel) = see(camera, &path(moment)) {
                    observations.push(MomentObservation { moment, camera, pixel, sigma });
                }
            }
        }
        let corners = [[0.05, 0.12], [2.75, 0.12], [2.75, 1.08], [0.05, 1.08], [1.4, 0.12], [1.4, 1.08]];
        let places = corners.map(|[x, y]| {
            let point = Point2::new(x, y);
            let seen = (0..3).filter_map(|camera| Some((camera, see(camera, &point)?, sigma)));
            KnownPlace { point, sigma: 5e-4, seen: seen.collect() }
        });
        Scene { observations, places: places.into() }
    }

    fn all_over(moment: usize) -> Point2<f64> {
        let at = moment as f64;
        Point2::new(WALL[0] * (0.5 + 0.5 * (0.071 * at).sin()), WALL[1] * (0.5 + 0.5 * (0.183 * at + 1.0).sin()))
    }

    #[test]
    fn cameras_are_mapped_from_a_point_that_was_moved_and_their_covariance_says_how_well() {
        let (mut normalised, mut n) = (0.0, 0.0);
        for seed in 1..=12 {
            let Scene { observations, places } = scene(0.05, seed, all_over);
            let exact: Vec<KnownPlace> = places.iter().map(|it| KnownPlace { sigma: 1e-4, ..it.clone() }).collect();
            let found = fit_network(&[SIZE; 3], &observations, &exact).unwrap();
            assert!(found.sigma_factor < 1.2, "{}", found.sigma_factor);
            for (camera, map) in cameras().iter().zip(&found.maps) {
                let map = map.as_ref().unwrap();
                for step in 0..40 {
                    let point = Point2::new(0.07 * f64::from(step), 0.2 + 0.02 * f64::from(step));
                    let Some(pixel) = camera.sees(&nalgebra::Point3::new(point.x, point.y, 0.0)) else { continue };
                    let placed = map.place(&pixel, &Matrix2::zeros()).unwrap();
                    let off = placed.point - point;
                    assert!(off.norm() < 1e-3, "{} mm at {point}", off.norm() * 1e3);
                    normalised += off.dot(&(placed.covariance.try_inverse().unwrap() * off));
                    n += 2.0;
                }
            }
        }
        assert!((0.3..2.0).contains(&(normalised / n)), "normalised error {}", normalised / n);
    }

    #[test]
    fn wrong_spots_are_outweighed_and_counted() {
        let Scene { mut observations, places } = scene(0.05, 3, all_over);
        // Every fifteenth observation of the middle camera is of a reflection.
        let middle = observations.iter_mut().filter(|it| it.camera == 1);
        middle.step_by(15).for_each(|it| it.pixel.x += 25.0);
        let found = fit_network(&[SIZE; 3], &observations, &places).unwrap();
        // Where two cameras disagree either may be blamed.
        assert!(found.outliers.iter().sum::<usize>() >= 8, "{:?}", found.outliers);
        let point = Point2::new(1.3, 0.7);
        let pixel = cameras()[1].sees(&nalgebra::Point3::new(point.x, point.y, 0.0)).unwrap();
        let off = (found.maps[1].as_ref().unwrap().point(&pixel).unwrap() - point).norm();
        assert!(off < 1e-3, "{} mm", off * 1e3);
    }

    #[test]
    fn what_cannot_be_joined_is_named_and_the_others_go_on() {
        let Scene { observations, mut places } = scene(0.05, 4, all_over);
        // The last camera saw the point only where no other sees it.
        let apart: Vec<MomentObservation> =
            observations.iter().filter(|it| it.camera != 2 || all_over(it.moment).x > 2.4).copied().collect();
        places.iter_mut().zip([0.3, 1.9, 1.9, 0.3, 1.2, 1.2]).for_each(|(it, x)| {
            it.point.x = x;
            it.seen = (0..2)
                .filter_map(|camera| {
                    let point = nalgebra::Point3::new(it.point.x, it.point.y, 0.0);
                    Some((camera, cameras()[camera].sees(&point)?, 0.05))
                })
                .collect();
        });
        let found = fit_network(&[SIZE; 3], &apart, &places).unwrap();
        assert!(found.maps[0].is_ok() && found.maps[1].is_ok());
        assert!(matches!(found.maps[2], Err(Unmapped::NotConnected { shared: 0..=19 })), "{:?}", found.maps[2]);

        let line = scene(0.05, 4, |moment| Point2::new(all_over(moment).x, 0.6));
        assert_eq!(fit_network(&[SIZE; 3], &line.observations, &line.places), Err(NetworkError::NoOverlap));
        let still = scene(0.05, 4, |_| Point2::new(1.0, 0.6));
        assert_eq!(fit_network(&[SIZE; 3], &still.observations, &still.places), Err(NetworkError::NoOverlap));
        let few = scene(0.05, 4, all_over);
        let found = fit_network(&[SIZE; 3], &few.observations, &few.places[..3]);
        assert_eq!(found, Err(NetworkError::TooFewPlaces { seen: 3 }));
    }
}
