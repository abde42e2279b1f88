//! Aims a pan-tilt head at targets in the room: `cargo run -p foveate-geometry --example aim_head`.

use foveate_geometry::Camera;
use foveate_geometry::pan_tilt::{Limits, PanTiltHead, Setting, aim};
use nalgebra::Point3;

fn main() {
    // A head 2 m above the floor that looks along +Y at rest, with the limits of a Sony EVI-D30: ±100°, ±25°.
    let camera = Camera::look_at(Point3::new(0.0, 0.0, 2.0), Point3::new(0.0, 5.0, 2.0), [720, 576], 2500.0);
    let head = PanTiltHead::aligned(camera, Limits::symmetric(100_f64.to_radians(), 25_f64.to_radians()));

    let mut present = Setting::default();
    for target in [Point3::new(0.0, 3.0, 1.7), Point3::new(1.5, 3.0, 1.7), Point3::new(0.3, 1.0, 0.2)] {
        match aim(&head, &target, &present) {
            Ok(found) => {
                present = found.setting;
                let [pan, tilt] = [present.pan, present.tilt].map(f64::to_degrees);
                println!("{target}: pan {pan:.2}°, tilt {tilt:.2}°, {:.2} m away", found.distance);
            }
            Err(refused) => println!("{target}: {refused}"),
        }
    }
}
