//! Pictures of the simulated studio: people in clothes, lamps and furniture in colour, and how long they take.
//!
//! `cargo run --release -p foveate-sim --example look_studio -- [FOLDER] [SECONDS] [PEOPLE] [BVH]` writes PNG files and prints how long a picture takes for rigs of 8 cameras of
//! 640 × 480 px and of 4 cameras of 320 × 240 px. With BVH people move as that recording does.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Image, PixelFormat, Time};
use foveate_scene::skeleton::SkeletonMotion;
use foveate_sim::camera::{CameraSettings, Renderer, SensorSettings};
use foveate_sim::person::{RecordingHints, WholeBody};
use foveate_sim::studio::StudioSettings;
use foveate_sim::world::{Body, Recordings, SceneSettings, WalkKind, World};
use nalgebra::Point3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "results/look_studio".to_owned()));
    let seconds: f64 = arguments.next().map_or(Ok(4.0), |it| it.parse())?;
    let people: usize = arguments.next().map_or(Ok(1), |it| it.parse())?;
    let bvh = arguments.next();
    std::fs::create_dir_all(&folder)?;
    let scene = SceneSettings {
        people,
        people_enter_s: 0.5,
        walk: if people > 1 && bvh.is_none() { WalkKind::Crowd } else { WalkKind::Round },
        closest_m: 0.4,
        bright_spots: 0,
        monitors: 0,
        glints_hz: 0.0,
        led_peak: 0.0,
        studio: Some(StudioSettings { chairs: vec![[0.7, 0.6, 200.0]], ..StudioSettings::default() }),
        ..SceneSettings::default()
    };
    let bodies = match bvh {
        None => Vec::new(),
        Some(file) => {
            let motion = SkeletonMotion::from_bvh(&std::fs::read_to_string(file)?)?;
            vec![Body::Whole(Arc::new(WholeBody::new(&motion, RecordingHints::default(), scene.walk_area_m)?))]
        }
    };
    let recordings = Recordings { bodies, ..Recordings::default() };
    let (world, random) = (World::with_recordings(scene, recordings, &Random::new(1)), Random::new(1));
    let settings =
        CameraSettings { colour: true, sensor: Some(SensorSettings::default()), ..CameraSettings::default() };
    let ring = |n: usize, size: [u32; 2], focal: f64| -> Vec<Camera> {
        let place = |i: usize| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.5) / n as f64;
            let height = if i.is_multiple_of(2) { 2.5 } else { 1.3 };
            Point3::new(2.7 * angle.cos(), 3.5 * angle.sin(), height)
        };
        (0..n).map(|it| Camera::look_at(place(it), Point3::new(0.0, 0.0, 0.95), size, focal)).collect()
    };
    for (n, size, focal) in [(8, [640, 480], 520.0), (4, [320, 240], 260.0)] {
        let start = Instant::now();
        let mut renderers: Vec<Renderer> = (0_u16..)
            .zip(ring(n, size, focal))
            .map(|(i, camera)| Renderer::new(&camera, CameraId(i), &world, &settings, &random))
            .collect();
        let mut images = vec![Image::default(); n];
        let mut best = f64::INFINITY;
        for frame in 0..12 {
            let start = Instant::now();
            for (renderer, image) in renderers.iter_mut().zip(&mut images) {
                renderer.render(&world, Time::from_s(seconds + frame as f64 / 60.0), frame, image);
            }
            if frame == 0 {
                for (number, image) in images.iter().enumerate() {
                    save(image, &folder.join(format!("{}x{}-{number}.png", size[0], size[1])))?;
                }
            } else {
                best = best.min(start.elapsed().as_secs_f64() / n as f64);
            }
        }
        println!(
            "{:.2} ms a picture of {} x {} px in colour, {n} cameras (the best of 11 rounds; all took {:.1} s)",
            best * 1e3,
            size[0],
            size[1],
            start.elapsed().as_secs_f64()
        );
    }
    Ok(())
}

fn save(image: &Image, path: &std::path::Path) -> image::ImageResult<()> {
    let colours = match image.format {
        PixelFormat::Gray8 => image::ExtendedColorType::L8,
        PixelFormat::Rgb8 => image::ExtendedColorType::Rgb8,
    };
    image::save_buffer(path, &image.pixels, image.width, image.height, colours)
}
