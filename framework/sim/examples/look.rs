//! Pictures of the simulated lab: the view of some cameras, and the plan from above.
//!
//! `cargo run --release -p foveate-sim --example look -- [FOLDER] [SECONDS] [PEOPLE] [REFLECTIONS]` writes PNG files and prints how
//! long a field takes, rendered and as an ideal detector sees it. With PEOPLE they walk as a crowd.

use std::path::{Path, PathBuf};
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Features, Image, Time};
use foveate_sim::camera::{CameraSettings, Renderer};
use foveate_sim::head::{Axes, AxesSettings, HeadMotion, HeadSettings, LineFaults, LineHead, LineSettings};
use foveate_sim::lab::{ROOM_M, VOLUME_M, coverage, wide_cameras};
use foveate_sim::observer::{Observer, ObserverSettings};
use foveate_sim::world::{Moment, SceneSettings, WalkKind, World};
use image::{GrayImage, Rgb, RgbImage};
use nalgebra::{Point2, Point3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "results/look".to_owned()));
    let seconds: f64 = arguments.next().map_or(Ok(4.0), |it| it.parse())?;
    std::fs::create_dir_all(&folder)?;
    let mut scene = SceneSettings::default();
    if let Some(people) = arguments.next() {
        (scene.people, scene.walk, scene.closest_m) = (people.parse()?, WalkKind::Crowd, 0.4);
    }
    if let Some(reflections) = arguments.next() {
        scene.reflections = reflections.parse()?;
    }
    let (world, random) = (World::new(scene, &Random::new(1)), Random::new(1));
    let cameras = wide_cameras();
    for number in [0, 2, 6, 10] {
        let (name, camera) = &cameras[number];
        let mut renderer = Renderer::new(camera, CameraId(number as u16), &world, &CameraSettings::default(), &random);
        let mut image = Image::default();
        renderer.render(&world, Time::from_s(seconds), 0, &mut image);
        save_square(&image, &folder.join(format!("{name}.png")))?;
    }
    plan(&cameras, &world, seconds).save(folder.join("plan.png"))?;
    let models: Vec<Camera> = cameras.iter().map(|(_, camera)| camera.clone()).collect();
    println!("{:?}", coverage(&models, VOLUME_M, 0.125));
    time_fields(&cameras, &world, &random, seconds);
    look_from_head(&cameras[2].1, &world, &random, seconds, &folder)?;
    time_looks(&cameras, &world, &random, seconds);
    println!("pictures in {}", folder.display());
    Ok(())
}

/// Mean time of a field, one camera after the other as a run would ask for them.
fn time_fields(cameras: &[(String, Camera)], world: &World, random: &Random, from_s: f64) {
    let start = Instant::now();
    let mut renderers: Vec<Renderer> = (0_u16..)
        .zip(cameras)
        .map(|(i, (_, camera))| Renderer::new(camera, CameraId(i), world, &CameraSettings::default(), random))
        .collect();
    println!("{:.1} ms to get one camera ready", start.elapsed().as_secs_f64() * 1e3 / cameras.len() as f64);
    let mut images = vec![Image::default(); cameras.len()];
    let mut best = f64::INFINITY;
    for frame in 0..60 {
        let start = Instant::now();
        for (renderer, image) in renderers.iter_mut().zip(&mut images) {
            renderer.render(world, Time::from_s(from_s + frame as f64 / 60.0), frame, image);
        }
        best = best.min(start.elapsed().as_secs_f64() / cameras.len() as f64);
    }
    println!("{:.3} ms a field of 640 × 240 px (the best of 60 rounds over all cameras)", best * 1e3);
}

/// The view of a camera on a head that has turned, and the time of a field of it.
fn look_from_head(
    camera: &Camera,
    world: &World,
    random: &Random,
    seconds: f64,
    folder: &Path,
) -> Result<(), Box<dyn std::error::Error>> {
    let head = LineHead::serial(&HeadSettings::default(), &LineSettings::default(), LineFaults::default(), 1)?;
    let motion = HeadMotion::new(CameraId(2), head, Axes::new(&AxesSettings::default()).carrying(camera));
    // Pan by 20° to the left and tilt by 5° up, at full speed: 81 01 06 02 speeds, -176 units, 60 units, FF.
    let go = [0x81, 0x01, 0x06, 0x02, 0x18, 0x14, 0xF, 0xF, 0x5, 0x0, 0x0, 0x0, 0x3, 0xC, 0xFF];
    motion.line().device().write(Time::from_s(seconds - 0.5), &go);
    let mut renderer = Renderer::on_head(camera, CameraId(2), &CameraSettings::default(), random);
    let (mut image, mut best) = (Image::default(), f64::INFINITY);
    for frame in 0..60 {
        let start = Instant::now();
        let capture = Time::from_s(seconds + frame as f64 / 60.0);
        renderer.render_on(&motion, &camera.into(), world, capture, frame, &mut image);
        best = best.min(start.elapsed().as_secs_f64());
        if frame == 2 {
            save_square(&image, &folder.join("on-a-head-moving.png"))?;
        }
    }
    save_square(&image, &folder.join("on-a-head.png"))?;
    println!("{:.3} ms a field of 640 × 240 px on a head (the best of 60)", best * 1e3);
    Ok(())
}

/// Mean time of a field of ideal detectors.
fn time_looks(cameras: &[(String, Camera)], world: &World, random: &Random, from_s: f64) {
    let settings = ObserverSettings::default();
    let mut observers: Vec<Observer> =
        (0_u16..).zip(cameras).map(|(i, (_, camera))| Observer::new(camera, CameraId(i), &settings, random)).collect();
    let (mut features, mut n_features, mut best) = (Features::default(), 0, f64::INFINITY);
    let n_rounds = 300;
    for frame in 0..n_rounds {
        let start = Instant::now();
        for observer in &mut observers {
            observer.look(world, Time::from_s(from_s + f64::from(frame) / 60.0), &mut features);
            n_features += features.list.len();
        }
        best = best.min(start.elapsed().as_secs_f64() / cameras.len() as f64);
    }
    println!(
        "{:.4} ms a field of {:.1} features without a picture (the best of {n_rounds} rounds)",
        best * 1e3,
        n_features as f64 / (observers.len() as f64 * f64::from(n_rounds))
    );
}

/// Saves a field with every row twice, so that things keep their shape.
fn save_square(image: &Image, path: &Path) -> image::ImageResult<()> {
    let tall = GrayImage::from_fn(image.width, image.height * 2, |x, y| {
        image::Luma([image.pixels[(y / 2 * image.width + x) as usize]])
    });
    tall.save(path)
}

/// The lab from above: room, volume, cameras with their lines of sight, the person's path over a minute, LEDs now.
fn plan(cameras: &[(String, Camera)], world: &World, seconds: f64) -> RgbImage {
    const PER_METRE: f64 = 100.0;
    let [min, max] = ROOM_M;
    let size = [0, 1].map(|axis| ((max[axis] - min[axis]) * PER_METRE) as u32 + 1);
    let mut picture = RgbImage::from_pixel(size[0], size[1], Rgb([255; 3]));
    let to_pixel = |p: Point3<f64>| Point2::new((p.x - min[0]) * PER_METRE, (max[1] - p.y) * PER_METRE);
    let mut dot = |p: Point3<f64>, radius: f64, colour: [u8; 3]| {
        let middle = to_pixel(p);
        let reach = radius.ceil() as i64;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (x, y) = (middle.x.round() as i64 + dx, middle.y.round() as i64 + dy);
                let inside = (dx * dx + dy * dy) as f64 <= radius * radius;
                if inside && (0..i64::from(size[0])).contains(&x) && (0..i64::from(size[1])).contains(&y) {
                    picture.put_pixel(x as u32, y as u32, Rgb(colour));
                }
            }
        }
    };
    let mut line = |a: Point3<f64>, b: Point3<f64>, colour: [u8; 3]| {
        let steps = ((b - a).norm() * PER_METRE).ceil();
        (0..=steps as u32).for_each(|i| dot(a + (b - a) * (f64::from(i) / steps), 0.5, colour));
    };
    let [low, high] = VOLUME_M;
    let corners = [[0, 0], [1, 0], [1, 1], [0, 1]];
    let corner = |[i, j]: [usize; 2]| Point3::new([low, high][i][0], [low, high][j][1], 0.0);
    (0..4).for_each(|i| line(corner(corners[i]), corner(corners[(i + 1) % 4]), [120, 120, 220]));
    line(Point3::new(-1.9, 3.85, 0.0), Point3::new(1.9, 3.85, 0.0), [0, 0, 0]);
    for (_, camera) in cameras {
        let edges = [0.0, 639.0].map(|column| camera.ray(&Point2::new(column, 119.5)));
        for ray in edges.into_iter().flatten() {
            line(ray.origin, ray.origin + ray.direction.into_inner() * 0.8, [240, 170, 90]);
        }
    }
    cameras.iter().for_each(|(_, camera)| dot(camera.centre(), 6.0, [200, 80, 0]));
    let mut moment = Moment::default();
    for step in 0..6000 {
        world.at(Time::from_s(f64::from(step) * 0.01), &mut moment);
        moment.poses.iter().take(1).for_each(|pose| dot(pose.leds[1].position, 0.5, [150, 190, 150]));
    }
    world.at(Time::from_s(seconds), &mut moment);
    moment.poses.iter().flat_map(|pose| pose.leds).for_each(|led| dot(led.position, 3.0, [200, 0, 0]));
    picture
}
