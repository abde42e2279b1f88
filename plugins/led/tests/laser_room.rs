//! A real recording: four cameras in a dark room with clutter, one waved light, and a peer's calibration of them.

use std::path::{Path, PathBuf};

use foveate::messages::{CameraId, Features, Image, Interval, PixelFormat, Targets, Time};
use foveate::scene::calibration::Calibration;
use foveate_led::detector::{ColourPlane, DetectorSettings, Search};
use foveate_led::reprojection::{Comparison, ComparisonRules};
use foveate_led::spotter::Spotter;
use foveate_led::tracker::{IntegratorSettings, Tracker};

const N_FRAMES: usize = 500;
const RATE: f64 = 25.0;

/// `None`, and a line that says so, where the recording is not at hand.
fn recording() -> Option<PathBuf> {
    let root = std::env::var_os("FOVEATE_DATA").map(PathBuf::from);
    let root = root.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"));
    let folder = root.join("s01_arctic_laser_4cam");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no recording at {}", folder.display());
    None
}

fn picture(folder: &Path, camera: usize, frame: usize) -> Image {
    let name = format!("arctic{0}/arctic{0}.pvi.{frame:04}.jpg", camera + 1);
    let rgb = image::open(folder.join(name)).unwrap().into_rgb8();
    let (width, height) = rgb.dimensions();
    Image { camera: CameraId(camera as u16), width, height, format: PixelFormat::Rgb8, pixels: rgb.into_raw() }
}

/// By frame, by camera.
fn detect(folder: &Path, settings: &DetectorSettings) -> Vec<Vec<Features>> {
    let of_camera = |camera: usize| -> Vec<Features> {
        let mut spotter = Spotter::new(settings.clone(), None, 0).unwrap();
        (0..N_FRAMES)
            .map(|frame| {
                let mut features = Features { camera: CameraId(camera as u16), list: Vec::new() };
                spotter.find(&picture(folder, camera, frame), std::iter::empty(), &mut features).unwrap();
                features
            })
            .collect()
    };
    let by_camera: Vec<Vec<Features>> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|camera| scope.spawn(move || of_camera(camera))).collect();
        threads.into_iter().map(|it| it.join().unwrap()).collect()
    });
    (0..N_FRAMES).map(|frame| by_camera.iter().map(|it| it[frame].clone()).collect()).collect()
}

#[test]
fn sweep() {
    let Some(folder) = recording() else { return };
    let calibration = Calibration::load(&folder.join("reference_multicamselfcal")).unwrap();
    let cameras: Vec<_> = calibration.cameras.iter().map(|it| it.camera.clone()).collect();
    println!("{:?}", calibration.cameras.iter().map(|it| (&it.name, it.camera.centre(), it.camera.image_size)).collect::<Vec<_>>());
    use foveate_led::detector::WhileLearning::Wait;
    let base = DetectorSettings { channel: ColourPlane::Green, learn_frames: 0, min_threshold: 60, search: Search::Full, while_learning: foveate_led::detector::WhileLearning::Search, ..Default::default() };
    for (name, settings) in [
        ("60", base.clone()),
        ("60 elong 10", DetectorSettings { max_elongation: 10.0, min_fill: 0.1, ..base.clone() }),
        ("60 area 1", DetectorSettings { max_elongation: 10.0, min_area_px: 1, ..base.clone() }),
        ("50", DetectorSettings { min_threshold: 50, ..base.clone() }),
        ("50 elong 10", DetectorSettings { min_threshold: 50, max_elongation: 10.0, min_fill: 0.1, ..base.clone() }),
        ("40 learn", DetectorSettings { min_threshold: 40, learn_frames: 60, left_out_frames: 15, ..base.clone() }),
        ("30 learn", DetectorSettings { min_threshold: 30, learn_frames: 60, left_out_frames: 15, ..base.clone() }),
        ("30 learn 30", DetectorSettings { min_threshold: 30, learn_frames: 30, left_out_frames: 15, ..base.clone() }),
        ("40 learn 30 w", DetectorSettings { min_threshold: 40, learn_frames: 30, left_out_frames: 15, while_learning: Wait, ..base.clone() }),
    ] {
        let start = std::time::Instant::now();
        let frames = detect(&folder, &settings);
        println!("{name}: detection {:?}", start.elapsed());
        println!("  features {:?} sets with 3: {}", (0..4).map(|c| frames.iter().map(|f| f[c].list.len()).sum::<usize>() as f64/500.0).collect::<Vec<_>>(), frames.iter().filter(|f| f.iter().filter(|c| !c.list.is_empty()).count()>=3).count());
        for acc in [10.0, 50.0, 200.0] { for tol in [15.0, 60.0] { for ce in [0.3, 0.6, 1.0] {
            let integrator = IntegratorSettings { acceleration_m_s2: acc, birth_tolerance_mm: tol, camera_error_px: ce, separation_mm: 200.0, birth_speed_m_s: 5.0, gate_px: 60.0, ..Default::default() };
            let mut tracker = Tracker::new(integrator, cameras.clone(), None);
            let mut c = Comparison::new(ComparisonRules { min_cameras: 3, gate: 8.0, settle_after: Interval::from_ms(1000.0) }, cameras.clone());
            let mut targets = Targets::default();
            for (k, set) in frames.iter().enumerate() {
                for f in set {
                    let time = Time::from_s(k as f64 / RATE);
                    c.add_features(time, f);
                    tracker.observe(time, f);
                    tracker.write(&mut targets);
                    c.add_targets(&targets);
                }
            }
            c.finish();
            println!("  acc {acc} tol {tol} ce {ce}: recovered {} of {} median {:.3} p90 {:.3} max {:.2} outliers {} per camera {:?} births {}", c.frames_recovered, c.frames_seen, c.all.quantile(0.5), c.all.quantile(0.9), c.all.max(), c.outliers_rejected, c.by_camera.iter().map(|d| (d.quantile(0.5)*1000.0).round()/1000.0).collect::<Vec<_>>(), tracker.tally().births);
        } } }
    }
}
