//! Pictures of the simulated wall, as the cameras of `graphs/laser_wall.calibration.toml` see it.
//!
//! `cargo run --release -p foveate-sim --example look_wall -- [FOLDER] [SECONDS]` writes a PNG file for each camera and prints how long a field takes.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_messages::{CameraId, Image, Interval, Time};
use foveate_scene::Calibration;
use foveate_sim::camera::{WallCameraSettings, WallRenderer};
use foveate_sim::truth::Truth;
use foveate_sim::wall::{Wall, WallSettings};
use image::GrayImage;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "results/look_wall".to_owned()));
    let seconds: f64 = arguments.next().map_or(Ok(4.0), |it| it.parse())?;
    std::fs::create_dir_all(&folder)?;
    let plan = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/laser_wall.calibration.toml");
    let cameras = Calibration::load(&plan)?.cameras;
    let wall = Wall::new(WallSettings::default(), Truth::default(), &Random::new(1));
    let (mut image, time) = (Image::default(), Time::from_s(seconds));
    for (number, named) in (0..).zip(&cameras) {
        let camera = wall.camera(None, &named.camera);
        let start = Instant::now();
        let settings = WallCameraSettings::default();
        let mut renderer = WallRenderer::new(wall.clone(), camera, CameraId(number), &settings, &Random::new(1));
        let ready = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        let fields = 60;
        for field in 0..fields {
            renderer.render(time + Interval::from_ms(field as f64), field, &mut image);
        }
        let mean = start.elapsed().as_secs_f64() * 1e3 / fields as f64;
        println!("{}: {ready:.1} ms to get ready, {mean:.2} ms a field", named.name);
        renderer.render(time, 0, &mut image);
        let picture = GrayImage::from_raw(image.width, image.height, image.pixels.clone());
        picture.ok_or("a picture of the wrong size")?.save(folder.join(format!("{}.png", named.name)))?;
    }
    println!("pictures in {}", folder.display());
    Ok(())
}
