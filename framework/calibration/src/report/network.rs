//! The room in 3D: cameras, path, how well the cameras are known; once as SVG and once as data for the script.

use foveate_geometry::self_calibration::CameraStatus;
use foveate_plot::names::Names;
use foveate_plot::svg::{Anchor, Font, Pen, Rect, SMALL, Svg};
use foveate_plot::text::{count, rounded};
use foveate_plot::ticks::round_step;
use foveate_plot::view::View;
use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};

use super::ReportInput;
use super::figures::quantile;
use super::page::{PLOT, Page, SERIES, THEME, json_string};
use crate::solved::{ObservationRole, Solved};

/// Points of the path that are drawn at most.
const POINTS: usize = 4_000;
/// Frames further apart than this many times the usual distance are not joined.
const GAP: usize = 4;
/// Turn and tilt of the first view [rad].
const VIEW: [f64; 2] = [0.6, 0.45];
const STATIC_SIZE: [f64; 2] = [860.0, 520.0];
/// Cameras named in the static picture at most, where there is room.
const NAMED: usize = 40;

/// The room, turned so that Z is up on the page.
struct Scene {
    cameras: Vec<Shown>,
    points: Vec<Point>,
    /// Corners of the box that holds it.
    low: Point3<f64>,
    high: Point3<f64>,
    /// Half axes are drawn longer by this.
    factor: f64,
    /// Height of the ground, and whether it is that of the world.
    ground: f64,
    upright: bool,
    placed: bool,
    n_points: usize,
}

struct Shown {
    name: String,
    centre: Point3<f64>,
    corners: [Point3<f64>; 4],
    half_axes: Option<[Vector3<f64>; 3]>,
}

struct Point {
    place: Point3<f64>,
    time_s: f64,
    residual_px: f64,
    /// Whether a line leads here from the point before.
    joined: bool,
}

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>) {
    let Some(scene) = Scene::of(report.solved) else { return };
    let unit = report.unit;
    let vertical = match (scene.upright, scene.placed) {
        (true, true) => "The grid is the plane z = 0.",
        (true, false) => "The vertical is known; the grid lies at the lowest drawn point, as the origin is arbitrary.",
        _ => "The vertical is not known: up is the direction that is up in the cameras' pictures.",
    };
    page.section(
        "room",
        "The room",
        &format!(
            "Cameras look towards the open side of their pyramids. {vertical} Ellipsoids show one standard deviation of the cameras' centres along \
             each axis, drawn {} times as large.",
            rounded(scene.factor)
        ),
    );
    page.raw(&format!(
        "<figure class=\"room\"><div class=\"live\"><div class=\"tools\"><label>path coloured by <select id=\"room-colour\"><option \
         value=\"t\">time</option><option value=\"r\">residual</option></select></label><label><input type=\"checkbox\" id=\"room-names\" \
         checked> names</label><label><input type=\"checkbox\" id=\"room-sigma\" checked> uncertainty</label><button type=\"button\" \
         id=\"room-reset\">reset the view</button><span id=\"room-key\"></span></div><canvas id=\"room-canvas\" tabindex=\"0\" role=\"img\" \
         aria-label=\"The room in three dimensions; arrow keys turn it, plus and minus zoom\"></canvas><p class=\"note\">Drag to turn, with \
         Shift to shift, wheel to zoom.</p></div><div class=\"still\">{}</div></figure>",
        scene.svg(unit)
    ));
    if scene.n_points > scene.points.len() {
        page.note(&format!(
            "{} of {} points are drawn, evenly chosen.",
            count(scene.points.len()),
            count(scene.n_points)
        ));
    }
    page.raw(&format!("<script type=\"application/json\" id=\"room-data\">{}</script>", scene.json(unit)));
}

impl Scene {
    fn of(solved: &Solved) -> Option<Self> {
        let calibrated = || {
            let found = solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated);
            found.filter(|it| it.camera.check().is_ok())
        };
        let upright = solved.fixed.gravity.is_some();
        let placed = upright && solved.fixed.origin.is_some();
        let turn =
            if upright { UnitQuaternion::identity() } else { up_from_pictures(calibrated().map(|it| &it.camera)) };
        let (points, n_points) = points(solved, &turn);
        let mut places: Vec<Point3<f64>> = points.iter().map(|it| it.place).collect();
        let centres: Vec<Point3<f64>> = calibrated().map(|it| turn * it.camera.centre()).collect();
        places.extend(&centres);
        let (mut low, mut high) = box_of(&places)?;
        let size = (high - low).norm().max(1e-9);
        // Pyramids reach a twentieth of the room, or less where cameras crowd.
        let reach = 0.25 * size / (centres.len() as f64).sqrt().max(5.0);
        let mut cameras: Vec<Shown> = Vec::with_capacity(centres.len());
        for solved in calibrated() {
            let camera = &solved.camera;
            let centre = turn * camera.centre();
            let [width, height] = camera.image_size.map(f64::from);
            let [focal_x, focal_y] = camera.intrinsics.focal;
            let [middle_x, middle_y] = camera.intrinsics.principal;
            let corner = |u: f64, v: f64| {
                let in_camera = Vector3::new((u - middle_x) / focal_x, (v - middle_y) / focal_y, 1.0);
                let in_world = camera.camera_from_world.rotation.inverse() * in_camera;
                centre + turn * in_world * reach
            };
            let corners = [
                corner(-0.5, -0.5),
                corner(width - 0.5, -0.5),
                corner(width - 0.5, height - 0.5),
                corner(-0.5, height - 0.5),
            ];
            let half_axes =
                solved.covariance.as_ref().filter(|it| it.centre.iter().all(|it| it.is_finite())).map(|it| {
                    let eigen = it.centre.symmetric_eigen();
                    let axis = |index: usize| {
                        let half = eigen.eigenvectors.column(index) * eigen.eigenvalues[index].max(0.0).sqrt();
                        turn * half
                    };
                    [axis(0), axis(1), axis(2)]
                });
            cameras.push(Shown { name: solved.name.clone(), centre, corners, half_axes });
        }
        let mut longest: Vec<f64> = cameras
            .iter()
            .filter_map(|it| it.half_axes.as_ref())
            .map(|axes| axes.iter().map(|it| it.norm()).fold(0.0, f64::max))
            .collect();
        longest.sort_by(f64::total_cmp);
        let typical = quantile(&longest, 0.5);
        let factor = if typical > 0.0 { 10_f64.powf((0.03 * size / typical).log10().floor()) } else { 1.0 };
        let factor = if 5.0 * factor * typical < 0.04 * size { 5.0 * factor } else { factor };
        if let Some(held) = box_of(&[low, high, Point3::new(low.x, low.y, 0.0)]).filter(|_| placed) {
            (low, high) = held;
        }
        let ground = if placed { 0.0 } else { low.z };
        Some(Self { cameras, points, low, high, factor, ground, upright, placed, n_points })
    }

    /// Lines of the ground's grid, and the length of a cell.
    fn grid(&self) -> (Vec<[Point3<f64>; 2]>, f64) {
        let size = (self.high - self.low).xy().amax().max(1e-9);
        let step = round_step(size / 12.0);
        let from = (self.low.xy() / step).map(f64::floor) * step;
        let to = (self.high.xy() / step).map(f64::ceil) * step;
        let lines =
            |from: f64, to: f64| (0..=((to - from) / step).round() as usize).map(move |it| from + it as f64 * step);
        let at = |x: f64, y: f64| Point3::new(x, y, self.ground);
        let mut grid: Vec<[Point3<f64>; 2]> = lines(from.x, to.x).map(|x| [at(x, from.y), at(x, to.y)]).collect();
        grid.extend(lines(from.y, to.y).map(|y| [at(from.x, y), at(to.x, y)]));
        (grid, step)
    }

    /// The first view.
    fn svg(&self, unit: &str) -> String {
        let (grid, step) = self.grid();
        let corners = self.cameras.iter().flat_map(|it| it.corners.iter().chain([&it.centre]));
        let all = self.points.iter().map(|it| &it.place).chain(corners).chain(grid.iter().flatten());
        let middle = nalgebra::center(&self.low, &self.high).into();
        let view = View::of(all.map(|it| (*it).into()), middle, VIEW, STATIC_SIZE);
        let on_page = |place: &Point3<f64>| view.place((*place).into());
        let mut svg = Svg::bare(STATIC_SIZE[0], STATIC_SIZE[1], "The room", THEME);
        let lines: Vec<_> = grid.iter().map(|it| it.each_ref().map(on_page).to_vec()).collect();
        svg.lines(&lines, Pen::new(THEME.grid, 1.0));
        let pieces =
            self.points.chunk_by(|_, next| next.joined).map(|it| it.iter().map(|it| on_page(&it.place)).collect());
        let pieces: Vec<Vec<_>> = pieces.collect();
        let alone = pieces.iter().filter(|it| it.len() == 1).flatten().copied();
        svg.dots(alone, 0.8, THEME.muted, 0.7);
        svg.lines(&pieces, Pen::new(THEME.muted, 1.1).faint(0.7));
        let bounds = Rect { left: 0.0, top: 0.0, width: STATIC_SIZE[0], height: STATIC_SIZE[1] - 24.0 };
        let mut names = Names::within(bounds);
        let (mut ellipses, mut pyramids) = (Vec::new(), Vec::new());
        for camera in &self.cameras {
            let (centre, [a, b, c, d]) = (on_page(&camera.centre), camera.corners.each_ref().map(on_page));
            pyramids.extend([vec![a, centre, b], vec![c, centre, d], vec![a, b, c, d, a]]);
            names.keep_off(centre);
            [a, b, c, d].into_iter().for_each(|corner| names.keep_off_line(centre, corner));
            for axis in camera.half_axes.iter().flatten() {
                let ends = [-1.0, 1.0].map(|sign| on_page(&(camera.centre + axis * (sign * self.factor))));
                ellipses.push(ends.to_vec());
            }
        }
        svg.lines(&ellipses, Pen::new(SERIES[1], 2.0));
        svg.lines(&pyramids, Pen::new(SERIES[0], 1.1));
        for camera in self.cameras.iter().take(NAMED) {
            names.write(&mut svg, on_page(&camera.centre), &camera.name);
        }
        let words = format!("a cell of the grid is {} {unit}", rounded(step));
        svg.text([8.0, STATIC_SIZE[1] - 8.0], Anchor::Start, Font::new(SMALL).coloured(THEME.muted), &words);
        svg.element(PLOT)
    }

    fn json(&self, unit: &str) -> String {
        // Five digits of the size of the room.
        let size = (self.high - self.low).norm().max(1e-9);
        let digits = (5.0 - size.log10().ceil()).clamp(0.0, 12.0) as usize;
        let point = |it: &Point3<f64>| format!("{:.digits$},{:.digits$},{:.digits$}", it.x, it.y, it.z);
        let list = |items: Vec<String>| format!("[{}]", items.join(","));
        let cameras = self.cameras.iter().map(|it| {
            let axes = it.half_axes.as_ref().map_or_else(
                || "null".to_owned(),
                |axes| list(axes.iter().map(|axis| point(&Point3::from(axis * self.factor))).collect()),
            );
            let corners = list(it.corners.iter().map(point).collect());
            format!("{{\"n\":{},\"c\":[{}],\"f\":{corners},\"e\":{axes}}}", json_string(&it.name), point(&it.centre))
        });
        let (grid, step) = self.grid();
        let number =
            |value: f64, digits: usize| if value.is_finite() { format!("{value:.digits$}") } else { "null".to_owned() };
        format!(
            "{{\"unit\":{},\"placed\":{},\"step\":{},\"low\":[{}],\"high\":[{}],\"view\":[{},{}],\"cameras\":{},\"grid\":{},\"path\":{},\
             \"joined\":{},\"t\":{},\"r\":{}}}",
            json_string(unit),
            self.placed,
            step,
            point(&self.low),
            point(&self.high),
            VIEW[0],
            VIEW[1],
            list(cameras.collect()),
            list(grid.iter().flatten().map(point).collect()),
            list(self.points.iter().map(|it| point(&it.place)).collect()),
            list(self.points.iter().map(|it| u8::from(it.joined).to_string()).collect()),
            list(self.points.iter().map(|it| number(it.time_s, 2)).collect()),
            list(self.points.iter().map(|it| number(it.residual_px, 2)).collect()),
        )
    }
}

/// Turns the world so that up is, on average, up in the pictures.
fn up_from_pictures<'a>(cameras: impl Iterator<Item = &'a foveate_geometry::Camera>) -> UnitQuaternion<f64> {
    let up = cameras.map(|it| it.camera_from_world.rotation.inverse() * -Vector3::y()).sum::<Vector3<f64>>();
    let turn = Rotation3::rotation_between(&up, &Vector3::z());
    // Straight down has no one way to be turned up.
    let turn = turn.unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    if up.norm() > 1e-6 { UnitQuaternion::from_rotation_matrix(&turn) } else { UnitQuaternion::identity() }
}

/// The points that are drawn, by label and then by frame, and of how many.
fn points(solved: &Solved, turn: &UnitQuaternion<f64>) -> (Vec<Point>, usize) {
    let mut squares = vec![(0_usize, 0.0); solved.points.len()];
    for observation in solved.observations.iter().filter(|it| it.role == ObservationRole::Used) {
        let of_point = observation.point.and_then(|it| squares.get_mut(it));
        if let Some(((n, sum), residual)) = of_point.zip(observation.residual.filter(|it| it.norm().is_finite())) {
            *n += 1;
            *sum += residual.norm_squared();
        }
    }
    let mut order: Vec<usize> =
        (0..solved.points.len()).filter(|it| solved.points[*it].position.iter().all(|it| it.is_finite())).collect();
    order.sort_by_key(|it| (solved.points[*it].label, solved.points[*it].frame));
    let n_points = order.len();
    let every = n_points.div_ceil(POINTS).max(1);
    let kept: Vec<usize> = order.into_iter().step_by(every).collect();
    let mut steps: Vec<usize> =
        kept.windows(2).map(|it| solved.points[it[1]].frame.saturating_sub(solved.points[it[0]].frame)).collect();
    steps.sort_unstable();
    let usual = steps.get(steps.len() / 2).copied().unwrap_or(1).max(1);
    let mut before: Option<(u32, usize)> = None;
    let mut points = Vec::with_capacity(kept.len());
    for index in kept {
        let point = &solved.points[index];
        let joined = before.is_some_and(|(label, frame)| label == point.label && point.frame - frame <= GAP * usual);
        before = Some((point.label, point.frame));
        let (n, sum) = squares[index];
        let residual_px = (sum / n as f64).sqrt();
        points.push(Point { place: turn * point.position, time_s: point.time_s, residual_px, joined });
    }
    (points, n_points)
}

fn box_of(places: &[Point3<f64>]) -> Option<(Point3<f64>, Point3<f64>)> {
    let first = places.first()?;
    let fold = |pick: fn(f64, f64) -> f64| {
        places.iter().fold(*first, |held, it| Point3::new(pick(held.x, it.x), pick(held.y, it.y), pick(held.z, it.z)))
    };
    Some((fold(f64::min), fold(f64::max)))
}
