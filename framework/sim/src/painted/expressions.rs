//! How the built-in head deforms: its modes, under the names that face capture gives them. Millimetres, as in [`super::head`].

use nalgebra::{Point3, Rotation3, Vector3};

use super::head::{HALF_MOUTH, HALF_SLIT, SLIT, bell, smooth};
use super::surface::Mode;

/// The joint of the jaw.
const HINGE: [f64; 3] = [2.0, 0.0, -14.0];
/// How far the jaw opens at weight 1 [rad].
const JAW: f64 = 0.235;

/// The modes over the vertices `base` of the head without features [mm].
pub(super) fn modes(base: &[Point3<f64>]) -> Vec<Mode> {
    let mode = |name: &str, by: &dyn Fn(&Point3<f64>) -> Vector3<f64>| {
        let moved = base.iter().enumerate().map(|(i, p)| (i as u32, by(p)));
        Mode {
            name: name.to_owned(),
            moves: moved.filter(|(_, by)| by.norm() > 0.02).map(|(i, by)| (i, by * 1e-3)).collect(),
        }
    };
    let mut modes = vec![
        mode("jawOpen", &jaw_open),
        mode("jawLeft", &|p| Vector3::y() * (7.0 * jaw(p))),
        mode("jawRight", &|p| Vector3::y() * (-7.0 * jaw(p))),
        mode("mouthPucker", &pucker),
        mode("mouthFunnel", &funnel),
        mode("browInnerUp", &|p| Vector3::z() * (8.0 * ahead(p) * bell(p.y, 15.0) * brow(p, 14.0))),
        mode("cheekPuff", &|p| around(p, [70.0, 42.0, -48.0], 15.0) * out(p) * 9.0),
        mode("eyeBlink", &|p| Vector3::z() * (-8.0 * ahead(p) * eye(p) * bell(p.z - 14.0, 3.4))),
        mode("eyeSquint", &|p| Vector3::z() * (2.6 * ahead(p) * eye(p) * bell(p.z - 1.0, 4.0))),
    ];
    for (side, sign) in [("L", 1.0), ("R", -1.0)] {
        // The other half joins in a little at the middle.
        let half = move |p: &Point3<f64>| smooth((p.y * sign + 9.0) / 18.0);
        let named = |name: &str| format!("{name}_{side}");
        let near = move |p: &Point3<f64>, at: [f64; 3], sigma: f64| around_one(p, at, sigma, sign);
        modes.extend([
            mode(&named("mouthSmile"), &move |p| {
                let corner = near(p, [78.0, 29.0, -59.0], 13.0);
                let cheek = near(p, [75.0, 42.0, -26.0], 13.0);
                Vector3::new(-5.5, 7.5 * sign, 8.5) * corner + Vector3::new(3.0, 1.5 * sign, 4.0) * cheek
            }),
            mode(&named("mouthFrown"), &move |p| {
                Vector3::new(-1.5, 1.5 * sign, -7.0) * near(p, [78.0, 28.0, -65.0], 12.0)
            }),
            mode(&named("browOuterUp"), &move |p| {
                Vector3::z() * (7.5 * ahead(p) * bell(p.y * sign - 43.0, 14.0) * brow(p, 13.0))
            }),
            mode(&named("browDown"), &move |p| {
                Vector3::new(0.8, -3.2 * sign, -5.5) * (ahead(p) * bell(p.y * sign - 18.0, 14.0) * brow(p, 9.0))
            }),
            mode(&named("noseSneer"), &move |p| {
                let wing = near(p, [95.0, 14.0, -25.0], 8.0);
                let lip =
                    bell(p.y * sign - 12.0, 9.0) * smooth((p.z - SLIT) / HALF_SLIT) * bell(p.z + 54.0, 9.0) * ahead(p);
                Vector3::new(-0.5, 0.5 * sign, 5.0) * wing + Vector3::z() * (4.0 * lip)
            }),
            mode(&named("mouthLowerDown"), &move |p| {
                let lip = bell(p.y * sign - 10.0, 9.0) * smooth((SLIT - p.z) / HALF_SLIT) * bell(p.z + 69.0, 8.0);
                Vector3::new(0.5, 1.2 * sign, -5.5) * (lip * ahead(p) * half(p) * lips(p))
            }),
        ]);
    }
    modes
}

fn ahead(p: &Point3<f64>) -> f64 {
    smooth((p.x - 5.0) / 40.0)
}

fn brow(p: &Point3<f64>, above: f64) -> f64 {
    let sigma = if p.z > 29.0 { above } else { 6.5 };
    bell(p.z - 29.0, sigma)
}

fn eye(p: &Point3<f64>) -> f64 {
    bell(p.y.abs() - 31.0, 10.0)
}

/// 1 between the corners of the mouth, 0 beyond.
fn lips(p: &Point3<f64>) -> f64 {
    (1.0 - (p.y / HALF_MOUTH).powi(2)).max(0.0).sqrt()
}

/// Near a point on either side.
fn around(p: &Point3<f64>, [x, y, z]: [f64; 3], sigma: f64) -> f64 {
    bell(((p.x - x) * 0.6).hypot(p.y.abs() - y).hypot(p.z - z), sigma)
}

/// Near a point on one side.
fn around_one(p: &Point3<f64>, [x, y, z]: [f64; 3], sigma: f64, sign: f64) -> f64 {
    bell(((p.x - x) * 0.6).hypot(p.y * sign - y).hypot(p.z - z), sigma)
}

fn out(p: &Point3<f64>) -> Vector3<f64> {
    Vector3::new(p.x * 0.7, p.y, 0.0).try_normalize(1e-9).unwrap_or(Vector3::x())
}

/// How far a point goes with the jaw: all of the lower lip in its middle, less towards the corners of the mouth and towards the ears;
/// nothing above the line between the lips, and the throat not.
fn jaw(p: &Point3<f64>) -> f64 {
    if p.z > SLIT {
        return 0.0;
    }
    let below = smooth((SLIT - p.z) / 26.0);
    let at_lips = lips(p);
    let share = at_lips + (1.0 - at_lips) * below;
    share * smooth((p.x + 5.0) / 38.0) * smooth((p.z + 138.0) / 24.0)
}

fn jaw_open(p: &Point3<f64>) -> Vector3<f64> {
    let arm = p - Point3::from(HINGE);
    let turned = Rotation3::from_axis_angle(&Vector3::y_axis(), JAW) * arm - arm;
    // The upper lip is drawn along a little, and the cheeks inward.
    let drawn = bell(p.y, 18.0) * smooth((p.z - SLIT) / HALF_SLIT) * bell(p.z + 57.0, 8.0) * ahead(p);
    let hollow = around(p, [70.0, 40.0, -55.0], 13.0);
    turned * jaw(p) - Vector3::z() * (1.5 * drawn) - out(p) * (2.5 * hollow)
}

fn pucker(p: &Point3<f64>) -> Vector3<f64> {
    let near = ahead(p) * bell(p.y, 22.0) * bell(p.z + 60.0, 15.0);
    Vector3::new(8.5, -0.42 * p.y, (SLIT - p.z) * 0.12) * near
}

fn funnel(p: &Point3<f64>) -> Vector3<f64> {
    let near = ahead(p) * bell(p.y, 20.0) * bell(p.z + 62.0, 15.0);
    let lift = if p.z > SLIT { 3.5 } else { -4.5 } * lips(p) * bell(p.z - SLIT, 9.0) * ahead(p);
    Vector3::new(5.0, -0.25 * p.y, 0.0) * near + Vector3::z() * lift
}
