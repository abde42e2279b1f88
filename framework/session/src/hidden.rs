//! Parts of pictures that are never written: rectangles, and scales such as a face.
//!
//! A scale is where its anchor's target carries it: its ball, as the rig states its radius, at the time of the picture. Where that is not known, the picture is not written.

use std::sync::Arc;

use foveate_geometry::Camera;
use foveate_messages::{Image, Message, ScaleSpace, Time};
use foveate_node::io::Packet;
use foveate_rig::graph::Graph;
use foveate_scene::selection::matches;
use nalgebra::{Point2, Point3, Vector3};

/// A place of a scale is known for so long after it was seen [s].
const KNOWN_S: f64 = 0.5;

/// What becomes of a picture.
pub(crate) enum Cover {
    /// It is written as it is.
    Nothing,
    /// This is written in its place.
    Parts(Image),
    /// It is not written: where a hidden scale is was not known.
    Unknown,
}

/// Left, top, width, height [px].
type Rectangle = [u32; 4];

/// What is hidden in a run.
pub(crate) struct Hidden {
    graph: Arc<Graph>,
    /// By instance.
    rectangles: Vec<Vec<Rectangle>>,
    /// Scales by number, with their radius [m].
    scales: Vec<(usize, f64)>,
    /// By scale: where it was last.
    spaces: Vec<Option<ScaleSpace>>,
}

impl Hidden {
    /// Of these rectangles, by patterns of cameras, and scales.
    ///
    /// # Errors
    /// A sentence: no such camera or scale, or a scale that nothing carries.
    pub fn new(
        graph: &Arc<Graph>,
        rectangles: &[(String, Vec<Rectangle>)],
        scales: &[String],
    ) -> Result<Hidden, String> {
        let names: Vec<&str> = graph.calibration.cameras.iter().map(|it| it.name.as_str()).collect();
        if let Some((pattern, _)) = rectangles.iter().find(|it| !names.iter().any(|name| matches(&it.0, name))) {
            return Err(format!("`hide_px` names `{pattern}`, expected one of the cameras {}", names.join(", ")));
        }
        for (pattern, list) in rectangles {
            let sizes =
                graph.calibration.cameras.iter().filter(|it| matches(pattern, &it.name)).map(|it| it.camera.image_size);
            let [width, height] = sizes.fold([0, 0], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
            if let Some(it) = list.iter().find(|it| it[0] >= width || it[1] >= height || it[2] == 0 || it[3] == 0) {
                return Err(format!(
                    "`hide_px` hides {it:?} of `{pattern}`, which is no part of pictures of {width} x {height} px"
                ));
            }
        }
        let of_camera = |name: &str| -> Vec<Rectangle> {
            rectangles.iter().filter(|it| matches(&it.0, name)).flat_map(|it| it.1.clone()).collect()
        };
        let of_instance = |camera: Option<foveate_messages::CameraId>| {
            camera.and_then(|it| names.get(usize::from(it.0))).map(|it| of_camera(it)).unwrap_or_default()
        };
        let scales = scales.iter().map(|name| {
            let place = graph.scales.iter().position(|it| it.name == *name);
            let place = place.ok_or_else(|| {
                let known: Vec<&str> = graph.scales.iter().map(|it| it.name.as_str()).collect();
                format!("`hide_scales` names `{name}`, expected one of the scales {}", known.join(", "))
            })?;
            let radius = graph.scales[place].radius_m.filter(|_| graph.places[place].parent.is_some());
            radius.map(|it| (place, it)).ok_or_else(|| {
                format!("`hide_scales` names `{name}`, which has no `anchor` and `radius_m`: expected a scale that a target carries")
            })
        });
        Ok(Hidden {
            rectangles: graph.instances.iter().map(|it| of_instance(it.camera)).collect(),
            scales: scales.collect::<Result<_, _>>()?,
            spaces: vec![None; graph.scales.len()],
            graph: Arc::clone(graph),
        })
    }

    /// Whether all that a node shows is hidden: it is in a scale that is, or carried by a head.
    pub fn is_whole(&self, instance: usize) -> bool {
        let it = &self.graph.instances[instance];
        let hidden = |scale: usize| self.scales.iter().any(|it| it.0 == scale);
        let mut around = std::iter::successors(Some(it.scale), |it| Some(self.graph.places[*it].parent?.0 as usize));
        let is_within = around.any(hidden);
        let camera = it.camera.and_then(|it| self.graph.calibration.cameras.get(usize::from(it.0)));
        let is_carried = camera.is_some_and(|it| self.graph.calibration.head(&it.name).is_some());
        is_within || (is_carried && !self.scales.is_empty())
    }

    /// Whether anything is hidden at all.
    pub fn is_any(&self) -> bool {
        !self.scales.is_empty() || self.rectangles.iter().any(|it| !it.is_empty())
    }

    /// Whether anything may be hidden in the pictures of a node.
    pub fn hides(&self, instance: usize) -> bool {
        !self.scales.is_empty() || !self.rectangles[instance].is_empty()
    }

    /// Calls `want` with each output that says where scales are.
    pub fn needs(&self, mut want: impl FnMut(usize, usize)) {
        for (instance, it) in self.graph.instances.iter().enumerate().filter(|_| !self.scales.is_empty()) {
            for (port, output) in it.node_type.ports.outputs.iter().enumerate() {
                if output.message.name == ScaleSpace::NAME {
                    want(instance, port);
                }
            }
        }
    }

    /// A message of the run.
    pub fn see(&mut self, packet: &Packet) {
        if let Some(space) = packet.as_typed::<ScaleSpace>()
            && let Some(place) = self.spaces.get_mut(space.scale.0 as usize)
        {
            *place = Some(*space);
        }
    }

    /// What becomes of a picture that a node gave.
    pub fn cover(&self, instance: usize, time: Time, image: &Image) -> Cover {
        let mut rectangles = self.rectangles[instance].clone();
        let camera = self.graph.calibration.cameras.get(usize::from(image.camera.0));
        for &(scale, radius) in &self.scales {
            let Some((centre, camera)) = self.centre(scale, time).zip(camera) else { return Cover::Unknown };
            rectangles.extend(around(&camera.camera, &centre, radius));
        }
        if rectangles.is_empty() {
            return Cover::Nothing;
        }
        let mut image = image.clone();
        rectangles.iter().for_each(|it| blacken(&mut image, it));
        Cover::Parts(image)
    }

    /// The middle of a scale in the world; `None` where it is not known.
    fn centre(&self, scale: usize, time: Time) -> Option<Point3<f64>> {
        let (mut centre, mut scale) = (Point3::origin(), scale);
        while let Some(parent) = self.graph.places[scale].parent {
            let space = self.spaces[scale].filter(|it| it.target.is_some())?;
            let age = (time - space.time).as_s();
            if age.abs() > KNOWN_S {
                return None;
            }
            centre = space.parent_from_scale * centre + space.velocity * age;
            scale = parent.0 as usize;
        }
        Some(centre)
    }
}

/// What a ball covers in the pictures of a camera: the rectangle around the cube that holds it; all, where the camera is in it.
fn around(camera: &Camera, centre: &Point3<f64>, radius: f64) -> Option<Rectangle> {
    let [width, height] = camera.image_size;
    let in_camera = camera.camera_from_world * centre;
    if in_camera.z < -radius {
        return None;
    }
    let sign = |corner: u8, axis: u8| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
    let corners = (0..8_u8).map(|it| Vector3::new(sign(it, 0), sign(it, 1), sign(it, 2)));
    let pixels: Option<Vec<Point2<f64>>> = corners.map(|it| camera.project(&(centre + it * radius))).collect();
    let Some(pixels) = pixels else { return Some([0, 0, width, height]) };
    let bounds = |of: fn(&Point2<f64>) -> f64, most: u32| {
        let low = pixels.iter().map(of).fold(f64::INFINITY, f64::min).floor().clamp(0.0, f64::from(most));
        let high = pixels.iter().map(of).fold(f64::NEG_INFINITY, f64::max).ceil().clamp(0.0, f64::from(most));
        (low as u32, (high - low) as u32 + 1)
    };
    let ((left, columns), (top, rows)) = (bounds(|it| it.x, width), bounds(|it| it.y, height));
    Some([left, top, columns, rows])
}

/// Makes a rectangle of its camera's picture black.
fn blacken(image: &mut Image, rectangle: &Rectangle) {
    let [left, top, width, height] = rectangle.map(u64::from);
    let window = image.window;
    // In pixels of the image, outwards.
    let range = |start: u64, size: u64, of_window: u32, most: u32| {
        let (start, end) = (start.saturating_sub(of_window.into()), (start + size).saturating_sub(of_window.into()));
        let shrink = u64::from(window.shrink.max(1));
        let clamped = |it: u64| it.min(most.into()) as usize;
        clamped(start / shrink)..clamped(end.div_ceil(shrink))
    };
    let (columns, rows) = (range(left, width, window.left, image.width), range(top, height, window.top, image.height));
    let channels = image.format.channels();
    let line = image.width as usize * channels;
    for row in rows {
        let start = row * line;
        if let Some(pixels) = image.pixels.get_mut(start + columns.start * channels..start + columns.end * channels) {
            pixels.fill(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_geometry::{Distortion, Intrinsics};
    use foveate_messages::Window;
    use nalgebra::Isometry3;

    use super::*;

    fn white(width: u32, height: u32, window: Window) -> Image {
        Image { width, height, pixels: vec![255; (width * height) as usize], window, ..Image::default() }
    }

    fn black(image: &Image) -> Vec<(u32, u32)> {
        let places = (0..image.height).flat_map(|y| (0..image.width).map(move |x| (x, y)));
        places.filter(|(x, y)| image.pixels[(y * image.width + x) as usize] == 0).collect()
    }

    #[test]
    fn a_rectangle_is_black_in_whole_pictures_and_in_parts_of_them() {
        let mut image = white(6, 5, Window::default());
        blacken(&mut image, &[4, 3, 9, 1]);
        assert_eq!(black(&image), [(4, 3), (5, 3)]);
        // Each pixel of this part is two of the camera's, from (4, 2) on.
        let mut image = white(6, 5, Window { left: 4, top: 2, shrink: 2 });
        blacken(&mut image, &[7, 0, 2, 4]);
        assert_eq!(black(&image), [(1, 0), (2, 0)]);
        let mut image = white(6, 5, Window { left: 40, top: 2, shrink: 2 });
        blacken(&mut image, &[7, 0, 2, 4]);
        assert_eq!(black(&image), []);
    }

    #[test]
    fn a_ball_is_hidden_with_all_of_its_outline() {
        let camera = Camera {
            image_size: [640, 480],
            intrinsics: Intrinsics { focal: [600.0, 610.0], principal: [319.5, 239.5], skew: 0.0 },
            distortion: Distortion::default(),
            camera_from_world: Isometry3::identity(),
        };
        let centre = Point3::new(0.1, -0.2, 3.0);
        let [left, top, width, height] = around(&camera, &centre, 0.3).unwrap();
        for degrees in 0..360 {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let pixel = camera.project(&(centre + Vector3::new(cos, sin, 0.0) * 0.3)).unwrap();
            let is_in = |at: f64, start: u32, size: u32| at >= f64::from(start) && at <= f64::from(start + size);
            assert!(is_in(pixel.x, left, width) && is_in(pixel.y, top, height), "{degrees}");
        }
        assert_eq!(around(&camera, &Point3::new(0.0, 0.0, 0.1), 0.3), Some([0, 0, 640, 480]));
        assert_eq!(around(&camera, &Point3::new(0.0, 0.0, -3.0), 0.3), None);
    }
}
