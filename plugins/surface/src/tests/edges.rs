//! Where a surface ends.

use super::*;

/// Points where the reference sees no surface, by how far from the next pixel that does [px], and all points.
fn beyond(scene: &Scene, camera: &Camera, points: &[CloudPoint]) -> (Vec<f64>, usize) {
    let seen = |x: i32, y: i32| scene.hit(camera, [f64::from(x), f64::from(y)]).is_some();
    let mut list = Vec::new();
    for it in points {
        let [x, y] = it.pixel.map(i32::from);
        if seen(x, y) {
            continue;
        }
        let around = (-12..=12).flat_map(|dy| (-12..=12).map(move |dx| (dx, dy)));
        let near = around.filter(|(dx, dy)| seen(x + dx, y + dy));
        list.push(near.map(|(dx, dy)| f64::from(dx * dx + dy * dy).sqrt()).fold(f64::INFINITY, f64::min));
    }
    (list, points.len())
}

#[test]
fn a_round_limb_has_no_points_beyond_its_rim_and_a_cut_few_and_near() {
    for (shape, half_m, part, reach_px) in [
        (Shape::Cylinder(0.05), 0.1, 0.01, 2.0),
        (Shape::Sphere(0.06), 0.1, 0.01, 2.0),
        (Shape::Plane, 0.06, 0.13, 6.1),
    ] {
        for n in [2, 3] {
            let cameras = cameras(n);
            let scene = Scene { half_m, ..Scene::of(shape, 91) };
            let settings = SurfaceSettings { reference: "cam-0".into(), spacing_px: 3, ..settings() };
            let (points, _) = matched(scene.pictures(&cameras), &cameras, settings);
            let (off, all) = beyond(&scene, &cameras[0], &points);
            let farthest = off.iter().copied().fold(0.0, f64::max);
            let share = off.len() as f64 / all as f64;
            assert!(all > 400 && share < part && farthest < reach_px, "{share} of {all}, {farthest} px, {n} cameras");
        }
    }
}

/// Patches of 16 mm on a cylinder and on a ball of 9 and 10 cm radius: matched as if they were flat they come out 0.14 and 0.22 mm too deep.
#[test]
fn patches_do_not_flatten_a_round_surface() {
    for (shape, radius) in [(Shape::Cylinder(0.09), 0.09), (Shape::Sphere(0.1), 0.1)] {
        let cameras = cameras(2);
        let scene = Scene::of(shape, 93);
        let settings = SurfaceSettings { spacing_px: 4, patch_px: 13, ..settings() };
        let (points, _) = matched(scene.pictures(&cameras), &cameras, settings);
        let outwards = |it: &CloudPoint| {
            let at = it.position.cast::<f64>();
            if matches!(shape, Shape::Sphere(_)) { at.coords.norm() - radius } else { at.x.hypot(at.y) - radius }
        };
        let off: Vec<f64> = points.iter().map(outwards).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let away = sorted(off.iter().map(|it| it.abs()).collect());
        let median = away[away.len() / 2];
        assert!(points.len() > 900 && mean.abs() < 3e-5, "{} points, {:.3} mm outwards", points.len(), 1e3 * mean);
        assert!(median < 1.1e-4, "{:.3} mm", 1e3 * median);
    }
}
