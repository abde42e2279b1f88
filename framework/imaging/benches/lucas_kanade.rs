//! Time and error of Lucas–Kanade tracking and of stabilisation, beside OpenCV on the same pictures.
//!
//! `FOVEATE_PEER_PYTHON=python3 cargo bench -p foveate-imaging --bench lucas_kanade`: with the variable the surface is scikit-image's
//! astronaut and OpenCV runs after ours (see `peer_lucas_kanade.py`), without it a surface of random waves, and ours alone.
//! 640 × 480 px, area-averaged from the surface, noise of 0 or 2 gray levels; 76 corners, windows of 21 × 21, 4 levels.

use std::hint::black_box;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_imaging::{FlowSettings, ImageView, LucasKanade, Pyramid, Stabiliser, StabiliserSettings, Template};
use nalgebra::{Matrix2, Point2, Rotation2, Vector2};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const TEXTURE: usize = 512;
/// Pixels of a picture that one pixel of the texture takes.
const MAGNIFIED: f64 = 1.25;
const N_POINTS: usize = 76;

struct Surface(Vec<u8>);

impl Surface {
    /// Waves of all directions, of 4 to 40 px.
    fn waves() -> Self {
        let mut random = Random::new(20020601);
        let waves: Vec<[f64; 4]> = (0..60)
            .map(|_| {
                let direction = random.uniform_in(0.0, std::f64::consts::TAU);
                let k = std::f64::consts::TAU / random.uniform_in(4.0, 40.0);
                [k * direction.cos(), k * direction.sin(), random.uniform_in(0.0, 6.3), random.uniform_in(2.0, 12.0)]
            })
            .collect();
        let level = |i: usize| {
            let (x, y) = ((i % TEXTURE) as f64, (i / TEXTURE) as f64);
            let sum: f64 = waves.iter().map(|[kx, ky, phase, size]| size * (kx * x + ky * y + phase).sin()).sum();
            (128.0 + sum).round().clamp(0.0, 255.0) as u8
        };
        Self((0..TEXTURE * TEXTURE).map(level).collect())
    }

    /// Catmull-Rom; the surface is mirrored at its border.
    fn at(&self, x: f64, y: f64) -> f64 {
        let weights = |t: f64| {
            let (t2, t3) = (t * t, t * t * t);
            [-t + 2.0 * t2 - t3, 2.0 - 5.0 * t2 + 3.0 * t3, t + 4.0 * t2 - 3.0 * t3, t3 - t2].map(|it| it / 2.0)
        };
        let mirrored = |i: i64| {
            let i = i.rem_euclid(2 * TEXTURE as i64) as usize;
            if i < TEXTURE { i } else { 2 * TEXTURE - 1 - i }
        };
        let (i, j) = (x.floor(), y.floor());
        let (wx, wy) = (weights(x - i), weights(y - j));
        let mut sum = 0.0;
        for (b, wy) in wy.iter().enumerate() {
            let row = mirrored(j as i64 + b as i64 - 1) * TEXTURE;
            for (a, wx) in wx.iter().enumerate() {
                sum += wx * wy * f64::from(self.0[row + mirrored(i as i64 + a as i64 - 1)]);
            }
        }
        sum
    }

    /// What a camera sees whose pixel p shows the place `motion`⁻¹(p).
    fn picture(&self, motion: &Motion, noise: f64, random: &mut Random) -> Vec<u8> {
        let mut pixels = Vec::with_capacity(WIDTH * HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let mut sum = 0.0;
                for k in 0..9 {
                    let part = Vector2::new((k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0) / 3.0;
                    let place = motion.back(&(Point2::new(x as f64, y as f64) + part));
                    sum += self.at(place.x / MAGNIFIED, (place.y + 80.0) / MAGNIFIED);
                }
                pixels.push((sum / 9.0 + noise * random.normal()).round().clamp(0.0, 255.0) as u8);
            }
        }
        pixels
    }
}

/// q = L (p − c) + c + d.
struct Motion {
    linear: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Motion {
    const MIDDLE: Point2<f64> = Point2::new(WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0);

    fn new(shift: [f64; 2], turn_deg: f64, scale: f64) -> Self {
        let linear = Rotation2::new(turn_deg.to_radians()).into_inner() * scale;
        Self { linear, shift: Vector2::from(shift) }
    }

    fn forth(&self, p: &Point2<f64>) -> Point2<f64> {
        Self::MIDDLE + self.linear * (p - Self::MIDDLE) + self.shift
    }

    fn back(&self, q: &Point2<f64>) -> Point2<f64> {
        let linear = self.linear.try_inverse().expect("a turn and a scale");
        Self::MIDDLE + linear * (q - Self::MIDDLE - self.shift)
    }
}

/// The strongest corners at least 10 px apart and 60 px inside, by the smaller eigenvalue over 7 × 7 px.
fn corners(pixels: &[u8]) -> Vec<Point2<f64>> {
    let at = |x: usize, y: usize| f64::from(pixels[y * WIDTH + x]);
    let gradient = |x: usize, y: usize| [at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)];
    let mut found = Vec::new();
    for y in 60..HEIGHT - 60 {
        for x in 60..WIDTH - 60 {
            let mut tensor = Matrix2::zeros();
            for k in 0..49 {
                let it = Vector2::from(gradient(x + k % 7 - 3, y + k / 7 - 3));
                tensor += it * it.transpose();
            }
            found.push((tensor.symmetric_eigenvalues().min(), Point2::new(x as f64, y as f64)));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<Point2<f64>> = Vec::new();
    for (_, point) in found {
        if kept.len() < N_POINTS && kept.iter().all(|it| (it - point).norm() >= 10.0) {
            kept.push(point);
        }
    }
    kept
}

fn view(pixels: &[u8]) -> ImageView<'_> {
    ImageView::new(pixels, WIDTH, HEIGHT).expect("rendered at this size")
}

fn pyramid(pixels: &[u8]) -> Pyramid {
    let mut pyramid = Pyramid::default();
    pyramid.build(&view(pixels), 4);
    pyramid
}

/// The points of one way of tracking, and of those that are claimed to be found, how far off.
fn track(
    [first, second]: [&Pyramid; 2],
    points: &[Point2<f64>],
    shift: Vector2<f64>,
    checked: bool,
) -> Vec<Option<Point2<f64>>> {
    let mut tracker = LucasKanade::new(FlowSettings::default()).expect("settings in range");
    let (mut forth, mut back) = (Template::default(), Template::default());
    let mut one = |point: &Point2<f64>| {
        tracker.learn(first, *point, &mut forth).ok()?;
        let flow = tracker.find(&forth, second, point + shift).ok()?;
        if checked {
            tracker.learn(second, flow.pixel, &mut back).ok()?;
            let returned = tracker.find(&back, first, flow.pixel - shift).ok()?;
            let is_back = (returned.pixel - point).norm() < 0.5;
            (is_back && flow.correlation > 0.8).then_some(())?;
        }
        Some(flow.pixel)
    };
    points.iter().map(&mut one).collect()
}

fn accuracy(surface: &Surface, folder: &Path) {
    let mut random = Random::new(20020601);
    let mut stabiliser = Stabiliser::new(StabiliserSettings::default()).expect("settings in range");
    let mut cases = String::new();
    for noise in [0.0, 2.0] {
        let still = surface.picture(&Motion::new([0.0; 2], 0.0, 1.0), noise, &mut random);
        let (points, first) = (corners(&still), pyramid(&still));
        for (name, shift, turn_deg, scale) in [
            ("sub-px", [0.3, 0.7], 0.0, 1.0),
            ("3.37 px", [3.1, -1.3], 0.0, 1.0),
            ("15 px", [12.4, 8.6], 0.0, 1.0),
            ("50 px", [40.3, 29.7], 0.0, 1.0),
            ("affine 4 px 2 deg 2 %", [3.3, 2.2], 2.0, 1.02),
        ] {
            let motion = Motion::new(shift, turn_deg, scale);
            let moved = surface.picture(&motion, noise, &mut random);
            let second = pyramid(&moved);
            let dominant = stabiliser.shift(&first, &second).map_or(Vector2::zeros(), |it| it.translation);
            let off = (dominant - motion.shift).norm();
            for (way, guess, checked) in [
                ("raw", Vector2::zeros(), false),
                ("stabilised", dominant, false),
                ("stabilised, checked", dominant, true),
                ("raw, checked", Vector2::zeros(), true),
            ] {
                let found = track([&first, &second], &points, guess, checked);
                let error = |(it, point): (&Option<Point2<f64>>, _)| it.map(|it| (it - motion.forth(point)).norm());
                let errors: Vec<f64> = found.iter().zip(&points).filter_map(error).collect();
                let mut good: Vec<f64> = errors.iter().copied().filter(|it| *it < 1.0).collect();
                good.sort_by(f64::total_cmp);
                let median = good.get(good.len() / 2).copied().unwrap_or(f64::NAN);
                let rms = (good.iter().map(|it| it * it).sum::<f64>() / good.len() as f64).sqrt();
                let (n, all, wrong) = (good.len(), points.len(), errors.len() - good.len());
                println!(
                    "  noise {noise} {name}, {way}: {n} of {all} within 1 px, median {median:.4}, rms {rms:.4} px; {wrong} wrong as found"
                );
            }
            println!("  noise {noise} {name}, dominant motion: {off:.2} px off");
            let case = format!("noise {noise} {name}").replace(' ', "_");
            write_case(folder, &case, [&still, &moved], &points, |it| (motion.forth(it), it + motion.shift));
            cases += &format!("{case}\n");
        }
    }
    std::fs::write(folder.join("cases.txt"), cases).expect("the folder is there");
}

fn write_case(
    folder: &Path,
    case: &str,
    pictures: [&[u8]; 2],
    points: &[Point2<f64>],
    of: impl Fn(&Point2<f64>) -> (Point2<f64>, Point2<f64>),
) {
    for (k, pixels) in pictures.iter().enumerate() {
        std::fs::write(folder.join(format!("{case}.{k}.raw")), pixels).expect("the folder is there");
    }
    let line = |p: &Point2<f64>| {
        let (truth, guess) = of(p);
        format!("{} {} {} {} {} {}\n", p.x, p.y, truth.x, truth.y, guess.x, guess.y)
    };
    let text: String = points.iter().map(line).collect();
    std::fs::write(folder.join(format!("{case}.points.txt")), text).expect("the folder is there");
}

/// Median and least of 400 rounds.
fn speed(surface: &Surface, folder: &Path) {
    let mut random = Random::new(7);
    let motion = Motion::new([2.3, 1.1], 0.0, 1.0);
    let still = surface.picture(&Motion::new([0.0; 2], 0.0, 1.0), 2.0, &mut random);
    let moved = surface.picture(&motion, 2.0, &mut random);
    let points = corners(&still);
    write_case(folder, "speed", [&still, &moved], &points, |it| (motion.forth(it), it + motion.shift));
    let (first, mut second) = (pyramid(&still), pyramid(&moved));
    let mut tracker = LucasKanade::new(FlowSettings::default()).expect("settings in range");
    let (mut forth, mut back) = (Template::default(), Template::default());
    let mut stabiliser = Stabiliser::new(StabiliserSettings::default()).expect("settings in range");
    let print = |name: &str, work: &mut dyn FnMut()| {
        let mut times: Vec<f64> = (0..400)
            .map(|_| {
                let start = Instant::now();
                work();
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!("  {} points, {name}: median {:.4} ms, least {:.4} ms", points.len(), times[200], times[0]);
    };
    print("the new picture's pyramid built", &mut || {
        second.build(&view(&moved), 4);
        for point in &points {
            tracker.learn(&first, *point, &mut forth).expect("a corner");
            black_box(tracker.find(&forth, &second, *point)).ok();
        }
    });
    print("the same and searched back", &mut || {
        second.build(&view(&moved), 4);
        for point in &points {
            tracker.learn(&first, *point, &mut forth).expect("a corner");
            if let Ok(flow) = tracker.find(&forth, &second, *point)
                && tracker.learn(&second, flow.pixel, &mut back).is_ok()
            {
                black_box(tracker.find(&back, &first, flow.pixel)).ok();
            }
        }
    });
    print("learning alone", &mut || {
        for point in &points {
            tracker.learn(&first, *point, &mut forth).expect("a corner");
        }
    });
    let mut pyramid = Pyramid::default();
    print("pyramid of one picture alone", &mut || pyramid.build(&view(&moved), 4));
    print("dominant motion, pyramids there", &mut || {
        black_box(stabiliser.shift(&first, &second));
    });
}

fn main() {
    let folder = std::env::temp_dir().join(format!("foveate-lucas-kanade-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for temporary files");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/peer_lucas_kanade.py");
    let peer = |what: &str| {
        let python = std::env::var_os("FOVEATE_PEER_PYTHON")?;
        let status = Command::new(python).args([script, what]).arg(&folder).status();
        Some(status.is_ok_and(|it| it.success()))
    };
    let surface = match peer("texture") {
        Some(true) => Surface(std::fs::read(folder.join("texture.raw")).expect("the script has written it")),
        _ => Surface::waves(),
    };
    println!("foveate");
    accuracy(&surface, &folder);
    speed(&surface, &folder);
    if peer("track").is_none() {
        println!("FOVEATE_PEER_PYTHON names no Python with OpenCV: ours alone, on a surface of random waves");
    }
    std::fs::remove_dir_all(&folder).expect("it was made above");
}
