//! A LED on a linear stage, seen by the eighteen cameras of the simulated lab in rendered pictures [Davis 2002 §3.7, Figures 36
//! to 41].
//!
//! Each camera hangs where it hangs in the lab and looks at the stage with a lens that shows 2.0 m across its 640 px, the average
//! that the paper gives. The room with its monitors, lamps, glints and noise is in the pictures; the calibration is perfect.

use foveate::estimation::Random;
use foveate::geometry::Camera;
use foveate::messages::{CameraId, Features, Image, Targets, Time};
use foveate::plot::{Axis, COLOURS, Chart, Series};
use foveate_led::detector::{CentroidKind, DetectorSettings, Search};
use foveate_led::led_detector::LedDetector;
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_sim::camera::{CameraSettings, Renderer};
use foveate_sim::lab::{VOLUME_M, wide_cameras};
use foveate_sim::world::{REFERENCE_DISTANCE_M, SceneSettings, World};
use foveate_testkit::scene::add_oval_spot;
use nalgebra::{Point3, Vector2, Vector3};

use crate::Options;
use crate::chart::save;
use crate::lines::{distances_from_line, mean_and_most};
use crate::variants::settings;

/// How wide the view of a camera is where the stage stands [m].
const VIEW_M: f64 = 2.0;
const MIDDLE: Point3<f64> = Point3::new(0.0, 0.0, 1.1);
/// Half of the stage's travel [m].
const HALF_TRAVEL: Vector3<f64> = Vector3::new(0.42, 0.12, 0.1);
const RATE_HZ: f64 = 60.0;
/// The room alone is looked at for this long, then the LED stands still, then it moves [s].
const EMPTY_S: f64 = 1.0;
const STILL_S: f64 = 3.0;
const END_S: f64 = 9.0;

fn place(time_s: f64) -> Point3<f64> {
    let along = ((time_s - STILL_S) / (END_S - STILL_S)).clamp(0.0, 1.0);
    MIDDLE + HALF_TRAVEL * (2.0 * along - 1.0)
}

/// The lab's cameras with lenses for the stage.
fn cameras() -> Vec<Camera> {
    let at_stage = |(_, of_lab): (String, Camera)| {
        let centre = of_lab.centre();
        let [width, _] = of_lab.image_size;
        let focal = f64::from(width) * (centre - MIDDLE).norm() / VIEW_M;
        let mut camera = Camera::look_at(centre, MIDDLE, of_lab.image_size, focal);
        camera.intrinsics.focal[1] = focal / 2.0;
        camera.distortion = of_lab.distortion;
        camera
    };
    wide_cameras().into_iter().map(at_stage).collect()
}

/// One way to measure, with all that it found.
struct Way {
    name: &'static str,
    led_detectors: Vec<LedDetector>,
    tracker: Tracker,
    /// By camera: time [s] and place without distortion [px].
    seen: Vec<Vec<(f64, Vector2<f64>)>>,
    /// Time [s] and place [m].
    recovered: Vec<(f64, Vector3<f64>)>,
}

impl Way {
    fn new(name: &'static str, centroid: CentroidKind, tracker: IntegratorSettings, cameras: &[Camera]) -> Self {
        let detector = DetectorSettings { centroid, search: Search::Full, ..DetectorSettings::default() };
        let led_detector = |(k, camera): (usize, &Camera)| {
            LedDetector::new(detector.clone(), Some(camera.image_size), k as u64)
                .expect("the default settings are valid")
        };
        Self {
            name,
            led_detectors: cameras.iter().enumerate().map(led_detector).collect(),
            tracker: Tracker::new(tracker, cameras.to_vec(), Some(VOLUME_M)),
            seen: vec![Vec::new(); cameras.len()],
            recovered: Vec::new(),
        }
    }

    fn look(&mut self, time: Time, camera: (usize, &Camera), image: &Image, targets: &mut Targets) {
        let (index, camera) = camera;
        let mut features = Features { camera: CameraId(index as u16), list: Vec::new() };
        self.led_detectors[index]
            .find(image, std::iter::empty(), &mut features)
            .expect("pictures have the camera's size");
        let truth = camera.project(&place(time.as_s()));
        // The room's own lights are no observations of the LED.
        let near = |it: &&foveate::messages::Feature| truth.is_some_and(|truth| (it.centre - truth).norm() < 8.0);
        if let Some(normalised) = features.list.iter().find(near).and_then(|it| camera.normalise(&it.centre)) {
            let ideal = normalised.component_mul(&Vector2::from(camera.intrinsics.focal));
            self.seen[index].push((time.as_s(), ideal + Vector2::from(camera.intrinsics.principal)));
        }
        self.tracker.observe(time, &features);
        self.tracker.write(targets);
        let led = place(targets.time.as_s());
        let distance = |it: &Point3<f64>| (it - led).norm();
        let nearest = targets.list.iter().map(|it| it.position).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(nearest) = nearest.filter(|it| distance(it) < 0.1) {
            self.recovered.push((targets.time.as_s(), nearest.coords));
        }
    }

    /// Mean and largest distance of one camera's observations of the moving LED from their line [px].
    fn image_error(&self, camera: usize) -> [f64; 2] {
        let moving: Vec<_> = self.seen[camera].iter().filter(|it| it.0 > STILL_S).map(|it| it.1).collect();
        mean_and_most(&distances_from_line(&moving))
    }

    /// Distances of the moving target from its line: time [s] and distance [m].
    fn deviations(&self) -> Vec<(f64, f64)> {
        let moving: Vec<_> = self.recovered.iter().filter(|it| it.0 > STILL_S + 0.2).collect();
        let points: Vec<_> = moving.iter().map(|it| it.1).collect();
        moving.iter().map(|it| it.0).zip(distances_from_line(&points)).collect()
    }

    /// Difference of the highest and the lowest place of the LED that stands still, in z [m].
    fn jitter(&self) -> f64 {
        let still = self.recovered.iter().filter(|it| (EMPTY_S + 0.5..STILL_S).contains(&it.0)).map(|it| it.1.z);
        let (low, high) = still.fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(it), high.max(it)));
        high - low
    }
}

/// Measures and draws.
pub fn stage(options: &Options) {
    println!("## A LED on a linear stage, 18 cameras, rendered pictures [Davis 2002 §3.7]\n");
    let cameras = cameras();
    let strict = settings("acceleration_m_s2 = 1.0\ncamera_error_px = 0.05").unwrap_or_default();
    let coarse = settings("acceleration_m_s2 = 1.0\ncamera_error_px = 0.5").unwrap_or_default();
    let mut ways = [
        Way::new("whole pixels", CentroidKind::Integer, IntegratorSettings::default(), &cameras),
        Way::new("whole pixels, calm", CentroidKind::Integer, coarse, &cameras),
        Way::new("sub-pixel", CentroidKind::Weighted, IntegratorSettings::default(), &cameras),
        Way::new("sub-pixel, calm", CentroidKind::Weighted, strict, &cameras),
    ];
    let random = Random::new(7);
    let world = World::new(SceneSettings { people: 0, ..SceneSettings::default() }, &random.fork("world"));
    let look = CameraSettings::default();
    let mut renderers: Vec<Renderer> = (0..)
        .zip(&cameras)
        .map(|(k, camera)| Renderer::new(camera, CameraId(k), &world, &look, &random.fork(&format!("camera {k}"))))
        .collect();
    let mut offsets = random.fork("offsets");
    let mut fields: Vec<(Time, usize, u64)> = Vec::new();
    for camera in 0..cameras.len() {
        let offset_s = offsets.uniform() / RATE_HZ;
        let times = (0..(END_S * RATE_HZ) as u64).map(|it| (Time::from_s(offset_s + it as f64 / RATE_HZ), camera, it));
        fields.extend(times);
    }
    fields.sort_unstable();
    let (mut image, mut targets) = (Image::default(), Targets::default());
    for (time, index, number) in fields {
        let camera = &cameras[index];
        renderers[index].render(&world, time, number, &mut image);
        let led = place(time.as_s());
        if let (true, Some(pixel)) = (time.as_s() > EMPTY_S, camera.project(&led)) {
            // It shines upwards, as much to the side as the cosine says.
            let towards = camera.centre() - led;
            let brightness = world.settings().led_peak * (towards.z / towards.norm()).max(0.0);
            let peak = brightness * (REFERENCE_DISTANCE_M / towards.norm()).powi(2);
            add_oval_spot(&mut image, [pixel.x, pixel.y], [look.spot_sigma_px, look.spot_sigma_px / 2.0], peak);
        }
        ways.iter_mut().for_each(|way| way.look(time, (index, camera), &image, &mut targets));
    }
    report(&ways, cameras.len());
    plots(&ways, options);
}

fn report(ways: &[Way], n_cameras: usize) {
    println!(
        "| centroid, filter | image error mean (best to worst camera) px | worst px | 3D deviation mean / largest mm | jitter at rest mm |"
    );
    println!("|---|---|---|---|---|");
    println!("| [Davis 2002] whole pixels | 0.94, 0.71 | 5 | 2.2 / 10 | 10 |");
    for way in ways {
        let errors: Vec<[f64; 2]> = (0..n_cameras).map(|it| way.image_error(it)).collect();
        let of = |pick: usize| errors.iter().map(move |it| it[pick]);
        let mean = of(0).sum::<f64>() / n_cameras as f64;
        let (best, worst) = (of(0).fold(f64::MAX, f64::min), of(0).fold(0.0, f64::max));
        let deviations: Vec<f64> = way.deviations().iter().map(|it| 1e3 * it.1).collect();
        let [deviation, largest] = mean_and_most(&deviations);
        println!(
            "| {} | {mean:.3} ({best:.3} to {worst:.3}) | {:.2} | {deviation:.3} / {largest:.3} | {:.3} |",
            way.name,
            of(1).fold(0.0, f64::max),
            1e3 * way.jitter(),
        );
    }
    println!();
}

fn plots(ways: &[Way], options: &Options) {
    let out = options.out.as_deref();
    let (whole, fine) = (&ways[0], &ways[2]);
    let moving = |way: &Way, camera: usize| -> Vec<(f64, Vector2<f64>)> {
        way.seen[camera].iter().filter(|it| it.0 > STILL_S).copied().collect()
    };
    let chart = |title: String, size, x: &str, y: &str, series| Chart {
        series,
        ..Chart::new(title, size, Axis::new(x), Axis::new(y))
    };
    let two = |of: &dyn Fn(&Way) -> Vec<[f64; 2]>| {
        vec![Series::line("whole pixels", COLOURS[1], of(whole)), Series::line("sub-pixel", COLOURS[0], of(fine))]
    };
    let paths: Vec<Chart> = (0..9)
        .map(|camera| {
            let camera = 2 * camera;
            let series = two(&|way| moving(way, camera).iter().map(|it| [it.1.x, 240.0 - it.1.y]).collect());
            chart(format!("wide-{}", camera + 1), [230.0, 150.0], "x [px]", "240 − y [px]", series)
        })
        .collect();
    save(out, "stage_fig36_37_paths", "Observed path of the LED, nine cameras (Figures 36, 37)", 3, paths);
    let shown = [0, 8];
    let over_time: Vec<Chart> = shown
        .iter()
        .flat_map(|&camera| {
            [0, 1].map(|axis| {
                let early = STILL_S..STILL_S + 1.5;
                let of = |way: &Way| {
                    moving(way, camera).iter().filter(|it| early.contains(&it.0)).map(|it| [it.0, it.1[axis]]).collect()
                };
                let y = if axis == 0 { "x [px]" } else { "y [px]" };
                chart(format!("wide-{}", camera + 1), [340.0, 170.0], "time [s]", y, two(&of))
            })
        })
        .collect();
    save(out, "stage_fig38_series", "Observed position over time (Figure 38)", 2, over_time);
    let errors: Vec<Chart> = shown
        .iter()
        .map(|&camera| {
            let of = |way: &Way| {
                let moving = moving(way, camera);
                let points: Vec<_> = moving.iter().map(|it| it.1).collect();
                moving.iter().zip(distances_from_line(&points)).map(|(it, error)| [it.0, error]).collect()
            };
            chart(format!("wide-{}", camera + 1), [360.0, 200.0], "time [s]", "distance from the line [px]", two(&of))
        })
        .collect();
    save(out, "stage_fig39_image_error", "Distance of observations from the fitted line (Figure 39)", 2, errors);
    let mut position: Vec<Chart> = [("x [m]", 0), ("y [m]", 1), ("z [m]", 2)]
        .map(|(y, axis)| {
            let of = |way: &Way| way.recovered.iter().map(|it| [it.0, it.1[axis]]).collect();
            chart(String::new(), [360.0, 180.0], "time [s]", y, two(&of))
        })
        .to_vec();
    let still = |way: &Way| {
        let still = way.recovered.iter().filter(|it| (EMPTY_S + 0.5..STILL_S).contains(&it.0));
        still.map(|it| [it.0, 1e3 * (it.1.z - place(0.0).z)]).collect()
    };
    position.push(chart("at rest, enlarged".to_owned(), [360.0, 180.0], "time [s]", "z error [mm]", two(&still)));
    save(out, "stage_fig40_position", "Recovered position over time (Figure 40)", 2, position);
    let series = ways.iter().zip([COLOURS[1], COLOURS[4], COLOURS[0], COLOURS[2]]).map(|(way, colour)| {
        let points = way.deviations().iter().map(|it| [it.0, 1e3 * it.1]).collect();
        Series::line(way.name, colour, points)
    });
    let deviation = chart(String::new(), [720.0, 260.0], "time [s]", "deviation from the line [mm]", series.collect());
    save(
        out,
        "stage_fig41_deviation",
        "Deviation of the recovered position from a line (Figure 41)",
        1,
        vec![deviation],
    );
}
