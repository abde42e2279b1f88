//! A controller that leads a simulated head after a light that swings.

use foveate::estimation::Random;
use foveate::geometry::pan_tilt::{Limits, PanTiltHead, Setting, ZoomStop, ZoomTable};
use foveate::geometry::{Camera, Intrinsics};
use foveate::prelude::*;
use nalgebra::{Matrix6, Point3, Vector3};

use super::*;

const LATENCY_S: f64 = 0.27;

fn head() -> PanTiltHead {
    let at_rest = Camera::look_at(Point3::new(-3.0, 0.0, 1.8), Point3::new(0.0, 0.0, 1.5), [640, 480], 3000.0);
    PanTiltHead::aligned(at_rest, Limits::symmetric(1.7, 0.43))
}

/// Half a metre to either side in 2.4 s, now faster, now slower.
fn swing(time_s: f64) -> Point3<f64> {
    Point3::new(0.0, 0.5 * (2.618 * (time_s + 0.1 / 0.59 * (0.59 * time_s).sin())).sin(), 1.5)
}

fn target(position: Point3<f64>, velocity: Vector3<f64>) -> Target {
    Target {
        id: TargetId(1),
        position,
        velocity,
        covariance: Matrix6::identity() * 1e-6,
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    }
}

/// What came of following for 30 s.
struct Outcome {
    mean_px: f64,
    in_view: f64,
    latency_s: f64,
    n_commands: u32,
    n_commands_late: u32,
}

/// A head of one's own making: obeys 270 ms late, at 400 °/s² and up to 80 °/s, answers in steps every 100 ms.
fn follow(settings: ControlSettings, path: impl Fn(f64) -> Point3<f64>) -> Outcome {
    let head = head();
    let mut controller = HeadController::new(settings, head.clone(), 0.25);
    let mut random = Random::new(5);
    let (mut angles, mut rates) = ([0.0_f64; 2], [0.0_f64; 2]);
    let mut obeyed: Option<([f64; 2], [f64; 2])> = None;
    let mut pending: Vec<(f64, [f64; 2], [f64; 2])> = Vec::new();
    let mut report = HeadReport { link: HeadLink::Ready, ..HeadReport::default() };
    let (mut next, mut sum, mut seen, mut count) = (0, 0.0, 0.0, 0.0);
    let (mut n_commands, mut n_commands_late) = (0, 0);
    for tick in 0..30_000 {
        let now_s = f64::from(tick) * 1e-3;
        if let Some(at) = pending.iter().position(|it| it.0 <= now_s) {
            let (_, goal, speeds) = pending.remove(at);
            obeyed = Some((goal, speeds));
        }
        if let Some((goal, speeds)) = obeyed {
            for axis in [0, 1] {
                let change = 400_f64.to_radians() * 1e-3;
                let way = goal[axis] - angles[axis];
                let brakes = (2.0 * 400_f64.to_radians() * way.abs()).sqrt();
                let wanted = speeds[axis].min(brakes).min(80_f64.to_radians()).copysign(way);
                rates[axis] += (wanted - rates[axis]).clamp(-change, change);
                angles[axis] += rates[axis] * 1e-3;
            }
        }
        if tick % 100 == 50 {
            let said = [0, 1].map(|it| (angles[it] / 0.002).round() * 0.002);
            let (earliest, latest) = (Time::from_s(now_s - 0.01), Time::from_s(now_s + 0.01));
            report
                .events
                .push((Time::from_s(now_s), HeadEvent::Position(HeadPosition { earliest, latest, angles: said })));
        }
        if tick % 10 == 0 {
            let at_s = now_s - 0.015;
            let velocity = (path(at_s + 1e-4) - path(at_s - 1e-4)) / 2e-4;
            let noise = Vector3::from_fn(|_, _| 0.001 * random.normal());
            controller.take_report(&report, &mut next);
            controller.see(Time::from_s(at_s), &target(path(at_s) + noise, velocity), &Vector3::zeros());
            if let Some(Lead { order: HeadOrder::Go { angles, speeds }, .. }) = controller.command(Time::from_s(now_s))
            {
                n_commands += 1;
                n_commands_late += u32::from(tick >= 20_000);
                report.events.push((Time::from_s(now_s), HeadEvent::Sent(HeadOrder::Go { angles, speeds })));
                pending.push((now_s + LATENCY_S, angles, speeds));
            }
        }
        if tick % 33 == 0 && tick > 5000 {
            let camera = head.camera_at(&Setting::new(angles[0], angles[1]));
            let pixel = camera.project(&path(now_s)).unwrap();
            sum += (pixel - nalgebra::Point2::new(319.5, 239.5)).norm();
            seen += f64::from(u8::from(camera.sees(&path(now_s)).is_some()));
            count += 1.0;
        }
    }
    Outcome {
        mean_px: sum / count,
        in_view: seen / count,
        latency_s: controller.latency_s()[0],
        n_commands,
        n_commands_late,
    }
}

fn paper(predictor: PredictorKind) -> ControlSettings {
    ControlSettings { predictor, latency: LatencyFrom::Fixed, control: Control::Step, ..ControlSettings::default() }
}

#[test]
fn prediction_keeps_a_swinging_target_in_the_middle() {
    let still = follow(paper(PredictorKind::None), swing);
    let velocity = follow(paper(PredictorKind::Velocity), swing);
    let ours = follow(ControlSettings::default(), swing);
    for (name, it) in [("still", &still), ("velocity", &velocity), ("ours", &ours)] {
        println!(
            "{name}: {:.1} px, in view {:.3}, {} commands, latency {:.3} s",
            it.mean_px, it.in_view, it.n_commands, it.latency_s
        );
    }
    assert!(velocity.mean_px < 0.7 * still.mean_px && still.in_view < 0.7 && ours.in_view > 0.99);
    assert!(ours.mean_px < 0.3 * velocity.mean_px && ours.mean_px < 35.0);
    assert!((ours.latency_s - LATENCY_S).abs() < 0.03, "{}", ours.latency_s);
}

#[test]
fn a_target_at_rest_is_left_alone_once_it_is_in_the_middle() {
    let outcome = follow(ControlSettings::default(), |_| Point3::new(0.3, 0.4, 1.6));
    assert!(outcome.mean_px < 8.0, "{} px", outcome.mean_px);
    assert!(outcome.n_commands_late < 5, "{} commands in ten quiet seconds", outcome.n_commands_late);
}

#[test]
fn a_lost_target_moves_nothing_and_commands_keep_their_distance() {
    let mut controller = HeadController::new(ControlSettings::default(), head(), 0.25);
    assert_eq!(controller.command(Time::ZERO), None, "nothing was seen yet");
    let at = |time_s: f64| Time::from_s(time_s);
    controller.see(at(1.0), &target(Point3::new(0.0, 0.5, 1.5), Vector3::zeros()), &Vector3::zeros());
    assert!(controller.command(at(1.01)).is_some());
    assert_eq!(controller.command(at(1.03)), None, "20 a second");
    assert_eq!(controller.command(at(1.6)), None, "it was not seen for more than half a second");
}

#[test]
fn what_is_out_of_reach_is_said_to_be_and_the_head_goes_as_far_as_it_can() {
    let mut controller = HeadController::new(ControlSettings::default(), head(), 0.25);
    controller.see(Time::ZERO, &target(Point3::new(-3.0, 0.3, 6.0), Vector3::zeros()), &Vector3::zeros());
    let lead = controller.command(Time::from_s(0.01)).unwrap();
    let HeadOrder::Go { angles, speeds } = lead.order else { panic!("a place is commanded") };
    assert!(!lead.reachable && angles[1] <= 0.43 + 1e-12 && speeds.iter().all(|it| *it > 0.0));
}

/// A head whose lens is three times as long at 1000 as at 0.
fn zooming() -> PanTiltHead {
    let mut head = head();
    let stop = |zoom: f64, focal: f64| ZoomStop {
        zoom,
        intrinsics: Intrinsics { focal: [focal; 2], ..head.at_rest.intrinsics },
        distortion: head.at_rest.distortion,
    };
    head.zoom = Some(ZoomTable::new(vec![stop(0.0, 1000.0), stop(500.0, 2000.0), stop(1000.0, 3000.0)]).unwrap());
    head
}

#[test]
fn a_target_that_comes_nearer_is_zoomed_out_from_though_its_direction_stays() {
    let settings = ControlSettings { fill: 0.9, ..ControlSettings::default() };
    let mut controller = HeadController::new(settings, zooming(), 0.25);
    let mut zooms = Vec::new();
    for step in 0..300 {
        let time_s = f64::from(step) * 0.01;
        // Along the line of sight at rest, from 3 m to 1.5 m.
        let way = (f64::from(step) / 300.0) * 0.5;
        let place = Point3::new(0.0, 0.0, 1.5) + (Point3::new(-3.0, 0.0, 1.8) - Point3::new(0.0, 0.0, 1.5)) * way;
        controller.see(Time::from_s(time_s), &target(place, Vector3::new(-0.5, 0.0, 0.05)), &Vector3::zeros());
        zooms.extend(controller.command(Time::from_s(time_s + 0.01)).and_then(|it| it.zoom));
    }
    // When the head obeys first it is 2.86 m away: 0.25 m over 0.9 of 240 px wants 2471 px; some ways to go on
    // let its velocity fade. At the end it is 1.4 m, and wants half of that.
    assert!((zooms[0] - 735.0).abs() < 20.0 && zooms.len() > 20, "{zooms:?}");
    assert!(zooms.windows(2).skip(2).all(|it| it[1] < it[0] + 15.0) && zooms[zooms.len() - 1] < 220.0, "{zooms:?}");
}

#[test]
fn without_a_fill_the_zoom_is_left_alone() {
    let mut controller = HeadController::new(ControlSettings::default(), zooming(), 0.25);
    controller.see(Time::ZERO, &target(Point3::new(0.0, 0.3, 1.5), Vector3::zeros()), &Vector3::zeros());
    assert_eq!(controller.command(Time::from_s(0.01)).unwrap().zoom, None);
}
