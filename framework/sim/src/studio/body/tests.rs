//! What bodies of the studio promise, tried.

use super::*;
use crate::person::Person;

#[test]
fn every_joint_lies_inside_and_the_body_is_as_large_as_a_person() {
    let person = Person::new(0, 1, [2.5, 4.0], 0.9, &Random::new(5));
    for seed in 0..3 {
        let mut random = Random::new(seed);
        let body = Body::new(Build::draw(&mut random), 1, seed as u32);
        let (triangles, _) = body.triangles();
        let (mut vertices, mut normals) = (Vec::new(), Vec::new());
        for step in 0..5 {
            let joints = person.pose(f64::from(step) * 0.7).joints();
            body.pose(&joints, &mut vertices, &mut normals);
            assert_eq!(vertices.len(), body.pieces.iter().map(|it| it.grid.n_vertices()).sum::<usize>());
            // Angles under which all triangles are seen add up to full spheres inside, to none outside.
            let turns = |point: &Point3<f64>| {
                let angle = |it: &Triangle| {
                    let [a, b, c] = it.corners.map(|it| vertices[it as usize] - point);
                    let [la, lb, lc] = [a, b, c].map(|it| it.norm());
                    let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
                    2.0 * a.dot(&b.cross(&c)).atan2(below)
                };
                triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
            };
            for (joint, name) in joints.centres().iter().zip(crate::person::JOINT_NAMES) {
                assert!(turns(joint) > 0.5, "{name}: {}", turns(joint));
            }
            // Not quite none: where pieces end inside others they are open.
            assert!(turns(&(joints.centres()[0] + Vector3::z() * 0.3)).abs() < 0.1);
            let low = vertices.iter().map(|it| it.z).fold(f64::INFINITY, f64::min);
            let high = vertices.iter().map(|it| it.z).fold(0.0, f64::max);
            assert!((-0.05..0.08).contains(&low) && (1.68..1.9).contains(&high), "{low} {high}");
            // By the divergence theorem; surfaces overlap at joints.
            let volume: f64 = triangles
                .iter()
                .map(|it| {
                    let [a, b, c] = it.corners.map(|it| vertices[it as usize].coords);
                    a.dot(&b.cross(&c)) / 6.0
                })
                .sum();
            assert!((0.055..0.13).contains(&volume), "{volume} m³");
        }
    }
}
