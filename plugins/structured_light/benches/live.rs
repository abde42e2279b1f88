//! Pictures a second of what a stripe boundary code costs with a head that follows: boundaries tracked and decoded, points made of them, one node after the other.
//!
//! `cargo bench -p foveate-structured-light --bench live`. A ball of 24 cm that moves sideways 4 m away, filling most of 640 x 480 pixels, 0.5 mm to a pixel, stripes of 4 mm; the camera turns with it. Pictures are made before.

use std::sync::Arc;
use std::time::Instant;

use foveate::estimation::random::Random;
use foveate::geometry::Camera;
use foveate::imaging::stripes::pattern::picture;
use foveate::prelude::*;
use foveate::scene::{Calibration, LengthUnit, NamedCamera};
use foveate_structured_light::PatternSettings;
use foveate_structured_light::boundaries::{Boundaries, BoundariesSettings};
use foveate_structured_light::pattern::Code;
use foveate_structured_light::triangulator::{Triangulator, TriangulatorSettings};
use nalgebra::{Matrix2, Matrix6, Point2, Point3};

const IMAGE: In<Image> = In::each(0, "image");
const SHOWN: In<PatternShown> = In::each(1, "shown");
const POSE: In<HeadPose> = In::each(2, "pose");
const MAP_OUT: Out<ProjectorMap> = Out::new(0, "map");
const MAP: In<ProjectorMap> = In::each(0, "map");
const MAP_POSE: In<HeadPose> = In::each(2, "pose");
const CLOUD: Out<PointCloud> = Out::new(0, "cloud");

const SIZE: [u32; 2] = [640, 480];
const PROJECTOR: [u32; 2] = [1920, 1080];
const PICTURES: u32 = 60;
const PERIOD_S: f64 = 1.0 / 60.0;
const RADIUS_M: f64 = 0.12;
const AWAY_M: f64 = 4.0;

fn projector() -> Camera {
    Camera::look_at(Point3::new(2.0, 0.5, 0.0), Point3::new(0.0, AWAY_M, 0.0), PROJECTOR, 4000.0)
}

fn time(number: u32) -> Time {
    Time::from_s(PERIOD_S * (f64::from(number) + 0.5))
}

/// Where the ball is.
fn ball(number: u32, speed_m_s: f64) -> Point3<f64> {
    Point3::new(speed_m_s * PERIOD_S * f64::from(number), AWAY_M + RADIUS_M, 0.0)
}

fn camera(number: u32, speed_m_s: f64) -> Camera {
    Camera::look_at(Point3::origin(), ball(number, speed_m_s), SIZE, 8000.0)
}

/// What a camera sees: each pixel is the mean of what a few lines of sight through it see.
fn seen(number: u32, speed_m_s: f64, shown: &[u8]) -> Image {
    let (camera, projector, middle) = (camera(number, speed_m_s), projector(), ball(number, speed_m_s));
    let mut random = Random::new(u64::from(number) + 1);
    let light = |x: f64, y: f64| -> f64 {
        let Some(ray) = camera.ray(&Point2::new(x, y)) else { return 0.0 };
        let along = ray.direction.into_inner();
        let to_middle = middle - ray.origin;
        let nearest = to_middle.dot(&along);
        let inside = RADIUS_M * RADIUS_M - (to_middle.norm_squared() - nearest * nearest);
        if inside <= 0.0 {
            return 0.0;
        }
        let place = ray.at(nearest - inside.sqrt());
        let facing = (place - middle).normalize().dot(&(projector.centre() - place).normalize()).max(0.0);
        let column = projector.project(&place).map_or(-1.0, |it| (it.x + 0.5).floor());
        if (0.0..f64::from(PROJECTOR[0])).contains(&column) {
            facing * f64::from(shown[column as usize]) / 255.0
        } else {
            0.0
        }
    };
    let pixels = (0..SIZE[0] * SIZE[1]).map(|at| {
        let (x, y) = (f64::from(at % SIZE[0]), f64::from(at / SIZE[0]));
        let mean = (0..4).map(|it| light(x + 0.25 * f64::from(it) - 0.375, y)).sum::<f64>() / 4.0;
        (12.0 + 180.0 * mean + random.normal()).round().clamp(0.0, 255.0) as u8
    });
    Image { width: SIZE[0], height: SIZE[1], pixels: pixels.collect(), ..Image::default() }
}

fn pose(number: u32, speed_m_s: f64) -> HeadPose {
    HeadPose {
        camera: CameraId(0),
        time: time(number),
        angles: [0.0; 2],
        angles_covariance: Matrix2::identity() * 1e-10,
        rates: [0.0; 2],
        zoom: None,
        camera_from_world: camera(number, speed_m_s).camera_from_world,
        covariance: Matrix6::identity() * 1e-12,
        age: Interval(0),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pattern =
        PatternSettings { projector_px: PROJECTOR, code: Code::Boundary, stripe_px: 4, ..PatternSettings::default() };
    let (manifest, code) = (toml::to_string(&pattern)?, pattern.stripe_code(None).map_err(|it| it.message)?);
    let shown: Vec<Vec<u8>> = code.pictures().iter().map(|it| picture(&code, *it, 1.0)).collect();
    let named = |name: &str, camera: Camera| NamedCamera { name: name.to_owned(), camera };
    let cameras = vec![named("camera", camera(0, 0.0)), named("projector", projector())];
    let calibration = Arc::new(Calibration::new(cameras, LengthUnit::Metre, String::new())?);
    let setup = |connected: &[&str]| Setup {
        camera: Some(CameraId(0)),
        calibration: Arc::clone(&calibration),
        connected: connected.iter().map(ToString::to_string).collect(),
        ..Setup::for_tests()
    };
    println!("| speed | threads | boundaries | points | pictures a second, both | boundaries a map | points a cloud |");
    println!("|---|---|---|---|---|---|---|");
    for speed in [0.0, 0.05, 0.2] {
        let images: Vec<Arc<Image>> =
            (0..PICTURES).map(|it| Arc::new(seen(it, speed, &shown[it as usize % shown.len()]))).collect();
        for threads in [1, 2] {
            let settings = BoundariesSettings {
                latency_ms: 0.0,
                exposure_ms: 2.0,
                distance_m: [AWAY_M - 0.05, AWAY_M + 0.15],
                black: 12.0,
                beside_px: 2.0,
                threads,
                ..BoundariesSettings::default()
            };
            let mut tracked = NodeBench::<Boundaries>::with_setup(settings, &setup(&["image", "shown", "pose"]))?;
            let mut made = NodeBench::<Triangulator>::with_setup(
                TriangulatorSettings { threads, ..TriangulatorSettings::default() },
                &setup(&["map", "pose"]),
            )?;
            let (mut tracking_s, mut making_s, mut n_maps, mut n_points) = (0.0, 0.0, 0, 0);
            for number in 0..PICTURES {
                let from = Time::from_s(PERIOD_S * f64::from(number));
                let told = PatternShown {
                    set: u64::from(number / 4),
                    index: number % 4,
                    count: 4,
                    from,
                    lasts: Interval::from_s(PERIOD_S),
                    manifest: manifest.clone(),
                    ..PatternShown::default()
                };
                let begun = Instant::now();
                tracked.feed(&SHOWN, from, told)?;
                tracked.feed(&POSE, time(number), pose(number, speed))?;
                tracked.feed(&IMAGE, time(number), Arc::clone(&images[number as usize]))?;
                let maps = tracked.outputs(&MAP_OUT);
                tracking_s += begun.elapsed().as_secs_f64();
                let begun = Instant::now();
                made.feed(&MAP_POSE, time(number), pose(number, speed))?;
                for map in maps {
                    n_maps += 1;
                    made.feed(&MAP, map.time(), map.value)?;
                }
                n_points += made.outputs(&CLOUD).iter().map(|it| it.value.len()).sum::<usize>();
                making_s += begun.elapsed().as_secs_f64();
            }
            let report = tracked.finish()?;
            let a_map = report.figures.get("boundaries.a_frame.camera").copied().unwrap_or(f64::NAN);
            let n = f64::from(PICTURES);
            println!(
                "| {:.0} cm/s | {threads} | {:.2} ms | {:.2} ms | {:.0} | {a_map:.0} | {:.0} |",
                100.0 * speed,
                1e3 * tracking_s / n,
                1e3 * making_s / n,
                n / (tracking_s + making_s),
                n_points as f64 / f64::from(n_maps.max(1))
            );
        }
    }
    Ok(())
}
