//! The static background behind the people: the room, its bright spots, and the screens that change.

use foveate_messages::Time;
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use wide::{f32x8, i16x8};

use super::spot::Spot;
use super::{CameraSettings, STEPS, steps};
use crate::truth::TrueCamera;
use crate::world::{PANES, World, room_light};

/// Lines of sight are computed on a grid of this spacing [px] and interpolated: a tenth of a second saved a camera.
const GRID: usize = 8;

/// How bright the frame of a monitor is [gray level].
const FRAME_LIGHT: f64 = 18.0;

/// The still part of a camera's view, in steps of a gray level.
pub(super) struct Backdrop {
    still: Vec<i16>,
    /// Pixels that show a pane: index in the image, and number of the pane (monitor × panes + pane).
    screens: Vec<(u32, u16)>,
    gain: f64,
    black_level: f64,
    n_panes: usize,
    /// Brightness of each pane in this field [steps].
    levels: Vec<i16>,
}

impl Backdrop {
    pub fn new(camera: &TrueCamera, world: &World, settings: &CameraSettings) -> Self {
        let [width, height] = camera.image_size.map(|it| it as usize);
        let view_grid = ViewGrid::new(camera);
        let origin = camera.centre();
        let mut still = Vec::with_capacity(width * height);
        let mut screens = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let direction = view_grid.direction(column, row);
                let (light, _, depth) = room_light(&origin, &direction);
                let light = match nearest_monitor(&origin, &direction, depth, world) {
                    None => light,
                    Some((monitor, pane)) => {
                        let on_screen =
                            pane.map(|pane| ((row * width + column) as u32, (monitor * PANES + pane) as u16));
                        screens.extend(on_screen);
                        FRAME_LIGHT
                    }
                };
                still.push(steps(light * settings.room_light * settings.gain + settings.black_level));
            }
        }
        add_bright_spots(camera, world, settings, &mut still);
        let n_panes = world.monitors().len() * PANES;
        let (gain, black_level) = (settings.gain, settings.black_level);
        Self { still, screens, gain, black_level, n_panes, levels: Vec::with_capacity(n_panes) }
    }

    /// Overwrites `canvas` with the view at `time`, without people.
    pub fn draw(&mut self, world: &World, time: Time, canvas: &mut [i16]) {
        canvas.copy_from_slice(&self.still);
        self.levels.clear();
        let panes = 0..self.n_panes;
        self.levels.extend(panes.map(|pane| {
            let light = world.pane_brightness(pane / PANES, pane % PANES, time);
            ((light * self.gain + self.black_level) * STEPS) as i16
        }));
        for &(pixel, pane) in &self.screens {
            canvas[pixel as usize] = self.levels[usize::from(pane)];
        }
    }
}

/// The view of a camera that moves: the same room, light computed on the grid of the lines of sight alone and interpolated, so that edges are
/// as soft as the grid is wide; small bright things stand where they are, sharp. A field takes about a hundredth of a [`Backdrop`]'s time.
#[derive(Default)]
pub(super) struct MovingBackdrop {
    /// Of a camera with these optics in the middle of the world.
    view_grid: Option<(TrueCamera, ViewGrid)>,
    /// At the grid's places [steps].
    lights: Vec<f32>,
}

impl MovingBackdrop {
    /// Overwrites `canvas` with the view of `camera` at `time`, without people.
    pub fn draw(
        &mut self,
        camera: &TrueCamera,
        world: &World,
        settings: &CameraSettings,
        time: Time,
        canvas: &mut [i16],
    ) {
        let in_the_middle = camera.standing(Isometry3::identity());
        let (_, view_grid) = match self.view_grid.take().filter(|it| it.0 == in_the_middle) {
            Some(known) => self.view_grid.insert(known),
            None => {
                let view_grid = ViewGrid::new(&in_the_middle);
                self.view_grid.insert((in_the_middle, view_grid))
            }
        };
        let origin = camera.centre();
        let world_from_camera = camera.camera_from_world.rotation.inverse();
        self.lights.clear();
        self.lights.extend(view_grid.grid.iter().map(|direction| {
            let light = light_along(&origin, &(world_from_camera * direction), world, settings, time);
            (light * STEPS) as f32
        }));
        let width = camera.image_size[0] as usize;
        for (row, pixels) in canvas.chunks_exact_mut(width).enumerate() {
            let down = (row % GRID) as f32 / GRID as f32;
            let above = &self.lights[row / GRID * view_grid.columns..][..view_grid.columns];
            let below = &self.lights[(row / GRID + 1) * view_grid.columns..][..view_grid.columns];
            let at = |column: usize| above[column] + (below[column] - above[column]) * down;
            for (cell, pixels) in pixels.chunks_mut(GRID).enumerate() {
                let (left, right) = (at(cell), at(cell + 1));
                let step = (right - left) / GRID as f32;
                let lights =
                    f32x8::splat(left) + f32x8::splat(step) * f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
                let lights = i16x8::from_i32x8_saturate(lights.fast_trunc_int()).to_array();
                pixels.copy_from_slice(&lights[..pixels.len()]);
            }
        }
        add_bright_spots(camera, world, settings, canvas);
    }
}

/// What is seen along a line of sight [gray level].
fn light_along(
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    world: &World,
    settings: &CameraSettings,
    time: Time,
) -> f64 {
    let (light, _, depth) = room_light(origin, direction);
    let light = match nearest_monitor(origin, direction, depth, world) {
        None => light * settings.room_light,
        Some((_, None)) => FRAME_LIGHT * settings.room_light,
        Some((monitor, Some(pane))) => world.pane_brightness(monitor, pane, time),
    };
    light * settings.gain + settings.black_level
}

/// The first monitor along a line of sight, nearer than `depth`, and which of its panes.
fn nearest_monitor(
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    depth: f64,
    world: &World,
) -> Option<(usize, Option<usize>)> {
    let hits = world.monitors().iter().zip(world.monitor_normals()).enumerate();
    hits.filter_map(|(i, (monitor, normal))| Some((i, monitor.hit_with(normal, origin, direction)?)))
        .filter(|(_, (_, at))| *at < depth)
        .min_by(|a, b| a.1.1.total_cmp(&b.1.1))
        .map(|(monitor, (pane, _))| (monitor, pane))
}

fn add_bright_spots(camera: &TrueCamera, world: &World, settings: &CameraSettings, canvas: &mut [i16]) {
    let origin = camera.centre();
    for spot in world.bright_spots() {
        if let Some(pixel) = camera.project(&spot.position) {
            let distance = (spot.position - origin).norm();
            let sigma = camera.intrinsics.focal.map(|focal| (spot.sigma * focal / distance).hypot(0.5));
            let peak = spot.peak * settings.gain;
            Spot { centre: [pixel.x, pixel.y], sigma, peak }.add_to(canvas, camera.image_size);
        }
    }
}

/// Lines of sight of all pixels, from a grid of exact ones.
struct ViewGrid {
    columns: usize,
    grid: Vec<Vector3<f64>>,
}

impl ViewGrid {
    fn new(camera: &TrueCamera) -> Self {
        let [width, height] = camera.image_size.map(|it| it as usize);
        let (columns, rows) = (width / GRID + 2, height / GRID + 2);
        let axis = camera.camera_from_world.rotation.inverse() * Vector3::z();
        let exact = |i: usize| {
            let pixel = Point2::new((i % columns * GRID) as f64, (i / columns * GRID) as f64);
            // Where the lens model ends nothing sharp is seen; the axis stands in.
            camera.ray(&pixel).map_or(axis, |ray| ray.direction.into_inner())
        };
        Self { columns, grid: (0..columns * rows).map(exact).collect() }
    }

    fn direction(&self, column: usize, row: usize) -> Vector3<f64> {
        let first = row / GRID * self.columns + column / GRID;
        let [x, y] = [column, row].map(|it| (it % GRID) as f64 / GRID as f64);
        let [a, b, c, d] = [0, 1, self.columns, self.columns + 1].map(|it| self.grid[first + it]);
        (a * (1.0 - x) + b * x) * (1.0 - y) + (c * (1.0 - x) + d * x) * y
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::wide_cameras;

    #[test]
    fn interpolated_lines_of_sight_are_good_to_a_twentieth_of_a_pixel() {
        for (name, camera) in wide_cameras() {
            let view_grid = ViewGrid::new(&TrueCamera::from(&camera));
            for (column, row) in [(3, 3), (4, 4), (637, 236), (333, 117), (5, 237)] {
                let point = camera.centre() + view_grid.direction(column, row);
                let pixel = camera.project(&point).unwrap();
                let error = (pixel - Point2::new(column as f64, row as f64)).norm();
                assert!(error < 0.05, "{name} at {column}, {row}: {error} px");
            }
        }
    }
}
