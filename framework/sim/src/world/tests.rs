//! What the world holds, tried.

use super::*;
use crate::lab::wide_cameras;

fn world(settings: SceneSettings) -> World {
    World::new(SceneSettings { people_enter_s: 0.0, ..settings }, &Random::new(1))
}

#[test]
fn answers_do_not_depend_on_the_order_of_questions() {
    let (one, other) = (world(SceneSettings::default()), world(SceneSettings::default()));
    let times: Vec<Time> = (0..200).map(|i| Time::from_s(f64::from(i * 37 % 200) * 0.05)).collect();
    let mut sorted = times.clone();
    sorted.sort();
    let answer = |world: &World, time: Time| {
        let panes: Vec<f64> = (0..PANES).map(|pane| world.pane_brightness(1, pane, time)).collect();
        let glints: Vec<Glint> = (0..18).flat_map(|camera| world.glints(CameraId(camera), time)).collect();
        (world.truth(time), panes, glints)
    };
    let in_order: Vec<_> = sorted.iter().map(|&time| answer(&one, time)).collect();
    for time in times {
        let expected = &in_order[sorted.binary_search(&time).unwrap()];
        assert_eq!(answer(&other, time), *expected);
    }
}

#[test]
fn every_led_is_seen_by_several_cameras_nearly_always() {
    let world = world(SceneSettings::default());
    let cameras = wide_cameras();
    let mut moment = Moment::default();
    let (mut counts, n_times) = ([[0; 19]; N_LEDS], 600);
    for step in 0..n_times {
        world.at(Time::from_s(f64::from(step) * 0.1), &mut moment);
        let mut seen = [0; N_LEDS];
        for (_, camera) in &cameras {
            for light in moment.lights_seen_from(&camera.centre(), 1.0) {
                let bright = light.brightness > 0.2;
                seen[light.id.0 as usize] += usize::from(bright && camera.sees(&light.position).is_some());
            }
        }
        (0..N_LEDS).for_each(|led| counts[led][seen[led]] += 1);
    }
    for (led, histogram) in counts.iter().enumerate() {
        let sum: usize = histogram.iter().enumerate().map(|(n, count)| n * count).sum();
        let few: usize = histogram[..3].iter().sum();
        println!("{:15} mean {:.1}, below 3: {few}", crate::person::LED_NAMES[led], sum as f64 / f64::from(n_times));
        assert!(few * 50 < n_times as usize, "LED {led} is seen by fewer than three cameras in {few} of {n_times}");
    }
}

#[test]
fn room_is_empty_until_people_come_in() {
    let world = World::new(SceneSettings { people_enter_s: 1.0, ..SceneSettings::default() }, &Random::new(1));
    let mut moment = Moment::default();
    for (time, n_people) in [(0.0, 0), (0.999, 0), (1.0, 1), (50.0, 1)] {
        world.at(Time::from_s(time), &mut moment);
        assert_eq!((moment.poses.len(), world.truth(Time::from_s(time)).list.len()), (n_people, n_people * N_LEDS));
    }
}

#[test]
fn people_have_eight_targets_each_with_numbers_in_order() {
    let world = world(SceneSettings { people: 3, ..SceneSettings::default() });
    let truth = world.truth(Time::from_s(2.0));
    assert_eq!(truth.list.len(), world.n_targets());
    assert!(truth.list.iter().enumerate().all(|(i, it)| it.id == TargetId(i as u32)));
}

#[test]
fn lights_that_dart_are_targets_of_their_own_from_people_enter_s_on() {
    let darts = Some(DartSettings { lights: 5, ..DartSettings::default() });
    let world = World::new(SceneSettings { people: 0, darts, ..SceneSettings::default() }, &Random::new(1));
    assert_eq!((world.n_targets(), world.truth(Time::from_s(0.99)).list.len()), (5, 0));
    let (mut moment, time) = (Moment::default(), Time::from_s(3.0));
    world.at(time, &mut moment);
    let truth = world.truth(time);
    let seen: Vec<Light> = moment.lights_seen_from(&Point3::new(0.0, 3.5, 2.5), 800.0).collect();
    assert_eq!(seen.len(), 5);
    for (number, (light, target)) in seen.iter().zip(&truth.list).enumerate() {
        assert_eq!((light.id, light.position), (TargetId(number as u32), target.position));
        assert_eq!(target.id, light.id);
        assert!(target.velocity.norm() < 5.001);
        assert!(truth.list[..number].iter().all(|it| (it.position - target.position).norm() > 1e-3));
    }
}
