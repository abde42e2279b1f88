//! Bodies in space: `foxglove.SceneUpdate`, each with one entity, which the next one of its name replaces.

use foveate_messages::{Marks, Mesh, Skeleton, SkeletonJoint, Skeletons, Targets, Time};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};

use super::points::{Dot, colour};
use super::schemas::{
    line_primitive, scene_entity, scene_update, sphere_primitive, text_primitive, triangle_list_primitive,
};
use super::wire::Writer;

/// Smallest diameter of a ball [m].
const SMALLEST: f64 = 0.005;
/// Size of the letters on the screen [px].
const FONT_SIZE: f64 = 14.0;
/// Width of a skeleton's lines [m].
const LINE_WIDTH: f64 = 0.01;
const WHITE: [f64; 4] = [1.0; 4];
/// `LINE_LIST` of the schema: each two points are a line.
const LINE_LIST: u64 = 2;
/// Joints of a body that are connected, by their places in [`foveate_messages::BODY_JOINTS`]; a missing one is skipped.
const CHAINS: [&[u8]; 6] = [&[0, 1], &[1, 2, 4, 6], &[1, 3, 5, 7], &[1, 8, 10, 12], &[1, 9, 11, 13], &[8, 9]];
/// Rounds of the search for the axes of a covariance. It takes less than ten; one that holds NaN never ends.
const MOST_ROUNDS: usize = 100;

/// A `foxglove.SceneUpdate` of targets in the frame of their scale: the ellipsoid of one standard deviation, at least 5 mm across, coloured by provenance, and the identity.
pub fn targets_scene(targets: &Targets, frame: &str, entity: &str, out: &mut Vec<u8>) {
    dots_scene(targets.time, frame, entity, targets.list.iter().map(Dot::from), out);
}

/// A `foxglove.SceneUpdate` of marks in the world, as [`targets_scene`]; the ellipsoid is the mark's own.
pub fn marks_scene(marks: &Marks, world: &str, entity: &str, out: &mut Vec<u8>) {
    dots_scene(marks.time, world, entity, marks.list.iter().map(|it| Dot::of_mark(marks, it)), out);
}

/// A `foxglove.SceneUpdate` of a surface where it lay in the world at its time, coloured by its vertices.
pub fn mesh(mesh: &Mesh, world: &str, entity: &str, out: &mut Vec<u8>) {
    write_entity(mesh.time, world, entity, out, |it| {
        it.message(scene_entity::triangles, |it| {
            it.pose(triangle_list_primitive::pose, &mesh.world_from_mesh);
            for vertex in mesh.vertices() {
                it.point(triangle_list_primitive::points, &vertex.position.cast());
            }
            for vertex in mesh.vertices() {
                it.color(triangle_list_primitive::colors, &opaque(vertex.colour));
            }
            it.fixed32s(triangle_list_primitive::indices, mesh.triangles().flatten());
        });
    });
}

/// A `foxglove.SceneUpdate` of bodies in the frame of their scale: a ball for each joint, coloured by provenance, lines between joints, and the identity at the first joint.
pub fn skeletons(skeletons: &Skeletons, frame: &str, entity: &str, out: &mut Vec<u8>) {
    write_entity(skeletons.time, frame, entity, out, |it| {
        for joint in skeletons.list.iter().flat_map(|it| &it.joints) {
            let covariance = joint.covariance.fixed_view::<3, 3>(0, 0).into();
            write_ellipsoid(it, &joint.position, &covariance, opaque(colour(joint.provenance)));
        }
        for body in &skeletons.list {
            it.message(scene_entity::lines, |it| write_bones(it, body));
        }
        for body in &skeletons.list {
            if let Some(first) = body.joints.first() {
                write_text(it, &first.position, body.id);
            }
        }
    });
}

fn opaque(colour: [u8; 3]) -> [f64; 4] {
    let [r, g, b] = colour.map(|it| f64::from(it) / 255.0);
    [r, g, b, 1.0]
}

fn write_entity(time: Time, frame: &str, id: &str, out: &mut Vec<u8>, fill: impl FnOnce(&mut Writer<'_>)) {
    Writer::new(out).message(scene_update::entities, |it| {
        it.time(scene_entity::timestamp, time);
        it.string(scene_entity::frame_id, frame);
        it.string(scene_entity::id, id);
        fill(it);
    });
}

fn dots_scene(time: Time, frame: &str, entity: &str, dots: impl Iterator<Item = Dot>, out: &mut Vec<u8>) {
    write_entity(time, frame, entity, out, |it| {
        for dot in dots {
            write_ellipsoid(it, &dot.position, &dot.covariance, opaque(colour(dot.provenance)));
            write_text(it, &dot.position, dot.id);
        }
    });
}

/// The surface of one standard deviation.
fn write_ellipsoid(out: &mut Writer<'_>, centre: &Point3<f64>, covariance: &Matrix3<f64>, colour: [f64; 4]) {
    let (rotation, diameters) = ellipsoid(covariance);
    out.message(scene_entity::spheres, |it| {
        it.pose(sphere_primitive::pose, &Isometry3::from_parts((*centre).into(), rotation));
        it.vector(sphere_primitive::size, &diameters);
        it.color(sphere_primitive::color, &colour);
    });
}

/// How its axes lie in the frame, and twice the standard deviation along each, at least [`SMALLEST`] [m]. What is no covariance is a small ball.
fn ellipsoid(covariance: &Matrix3<f64>) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let Some(found) = SymmetricEigen::try_new(*covariance, f64::EPSILON, MOST_ROUNDS) else {
        return (UnitQuaternion::identity(), Vector3::repeat(SMALLEST));
    };
    let mut axes = found.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(0).neg_mut();
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    (rotation, found.eigenvalues.map(|it| (2.0 * it.max(0.0).sqrt()).max(SMALLEST)))
}

fn write_text(out: &mut Writer<'_>, place: &Point3<f64>, id: u32) {
    out.message(scene_entity::texts, |it| {
        it.pose(text_primitive::pose, &Translation3::from(*place).into());
        it.varint(text_primitive::billboard, 1);
        it.double(text_primitive::font_size, FONT_SIZE);
        it.varint(text_primitive::scale_invariant, 1);
        it.color(text_primitive::color, &WHITE);
        it.string(text_primitive::text, &id.to_string());
    });
}

fn write_bones(out: &mut Writer<'_>, body: &Skeleton) {
    out.varint(line_primitive::r#type, LINE_LIST);
    out.pose(line_primitive::pose, &Isometry3::identity());
    out.double(line_primitive::thickness, LINE_WIDTH);
    out.color(line_primitive::color, &WHITE);
    for chain in CHAINS {
        let joint = |place: &u8| body.joints.iter().find(|it| it.joint == *place);
        let mut last: Option<&SkeletonJoint> = None;
        for next in chain.iter().filter_map(joint) {
            if let Some(last) = last.replace(next) {
                out.point(line_primitive::points, &last.position);
                out.point(line_primitive::points, &next.position);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_messages::{CameraSet, LimbDetail, MeshVertex, Provenance};
    use nalgebra::{Matrix6, Quaternion};
    use proptest::prelude::*;

    use super::super::Kind;
    use super::super::decoded::Decoded;
    use super::super::points::tests::{marks, targets};
    use super::*;

    fn vector(decoded: &Decoded, path: &str) -> Vector3<f64> {
        Vector3::from(["x", "y", "z"].map(|it| decoded.number(&format!("{path}.{it}"))))
    }

    /// The covariance whose ellipsoid of one standard deviation a viewer draws.
    fn drawn_covariance(decoded: &Decoded, sphere: usize) -> Matrix3<f64> {
        let path = format!("entities[0].spheres[{sphere}]");
        let [x, y, z, w] = ["x", "y", "z", "w"].map(|it| decoded.number(&format!("{path}.pose.orientation.{it}")));
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix();
        let sigmas = vector(decoded, &format!("{path}.size")) / 2.0;
        turn * Matrix3::from_diagonal(&sigmas.component_mul(&sigmas)) * turn.inverse()
    }

    #[test]
    fn a_target_is_an_ellipsoid_of_its_covariance_with_its_identity() {
        let mut out = Vec::new();
        targets_scene(&targets(), "room", "targets", &mut out);
        let decoded = Decoded::of(Kind::SceneUpdate, &out);
        assert_eq!((decoded.count("entities"), decoded.text("entities[0].id")), (1, "targets"));
        assert_eq!(decoded.text("entities[0].frame_id"), "room");
        assert_eq!(decoded.number("entities[0].timestamp.seconds"), 1.0);
        assert_eq!((decoded.count("entities[0].spheres"), decoded.count("entities[0].texts")), (2, 2));
        assert_eq!(vector(&decoded, "entities[0].spheres[1].pose.position"), Vector3::new(1.5, 2.0, -3.0));
        let expected = Matrix3::from_diagonal(&[1e-4, 4e-4, 16e-4].into());
        assert!((drawn_covariance(&decoded, 1) - expected).norm() < 1e-12);
        assert_eq!(decoded.number("entities[0].spheres[0].color.r"), 1.0);
        assert_eq!(decoded.number("entities[0].spheres[1].color.g"), 0.8);
        assert_eq!((decoded.text("entities[0].texts[1].text"), decoded.count("entities[0].lines")), ("300", 0));
    }

    #[test]
    fn an_ellipsoid_turns_with_its_marks() {
        let mut out = Vec::new();
        marks_scene(&marks(), "world", "marks", &mut out);
        let decoded = Decoded::of(Kind::SceneUpdate, &out);
        let position = vector(&decoded, "entities[0].spheres[0].pose.position");
        assert!((position - Vector3::new(1.0, 3.0, 0.0)).norm() < 1e-12, "{position}");
        let expected = Matrix3::from_diagonal(&[4e-4, 1e-4, 16e-4].into());
        assert!((drawn_covariance(&decoded, 0) - expected).norm() < 1e-12);
    }

    #[test]
    fn an_ellipsoid_is_never_too_small_to_be_seen() {
        assert_eq!(ellipsoid(&Matrix3::zeros()).1, Vector3::repeat(SMALLEST));
        assert_eq!(ellipsoid(&Matrix3::repeat(f64::NAN)).1, Vector3::repeat(SMALLEST));
    }

    proptest! {
        #[test]
        fn an_ellipsoid_is_that_of_its_covariance_and_no_mirror_image(root in proptest::array::uniform9(-1.0..1.0)) {
            let root = Matrix3::from_row_slice(&root);
            let covariance = root * root.transpose() + Matrix3::identity() * 0.01;
            let (rotation, diameters) = ellipsoid(&covariance);
            let turn = rotation.to_rotation_matrix();
            let again = turn * Matrix3::from_diagonal(&(diameters / 2.0).map(|it| it * it)) * turn.inverse();
            prop_assert!((again - covariance).norm() < 1e-9, "{again} is not {covariance}");
        }
    }

    #[test]
    fn no_targets_are_an_entity_that_replaces_the_last_by_nothing() {
        let mut out = Vec::new();
        targets_scene(&Targets::default(), "room", "targets", &mut out);
        let decoded = Decoded::of(Kind::SceneUpdate, &out);
        assert_eq!((decoded.text("entities[0].id"), decoded.count("entities[0].spheres")), ("targets", 0));
    }

    #[test]
    fn a_mesh_is_its_triangles_where_it_lay() {
        let vertex = |x: f32| MeshVertex {
            position: Point3::new(x, -2.5, 3.25),
            normal: Vector3::y(),
            weight: 12.5,
            sigma: 0.25,
            colour: [51, 0, 255],
        };
        let mut ours = Mesh::new([0.0, 1.0, 2.0, 3.0].map(vertex), &[[0, 1, 2], [3, 1, 2]]);
        ours.world_from_mesh = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::x());
        let mut out = Vec::new();
        mesh(&ours, "world", "face", &mut out);
        let decoded = Decoded::of(Kind::SceneUpdate, &out);
        let path = "entities[0].triangles[0]";
        assert_eq!(vector(&decoded, &format!("{path}.pose.position")), Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(decoded.count(&format!("{path}.points")), 4);
        assert_eq!(vector(&decoded, &format!("{path}.points[3]")), Vector3::new(3.0, -2.5, 3.25));
        assert_eq!(decoded.numbers(&format!("{path}.indices")), [0.0, 1.0, 2.0, 3.0, 1.0, 2.0]);
        assert_eq!(decoded.count(&format!("{path}.colors")), 4);
        assert_eq!(decoded.number(&format!("{path}.colors[2].r")), 0.2);
    }

    #[test]
    fn a_body_is_balls_and_lines_also_past_a_joint_that_is_missing() {
        let joint = |joint: u8| SkeletonJoint {
            joint,
            position: Point3::new(f64::from(joint), 0.0, 1.0),
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity() * 1e-4,
            provenance: Provenance::Measured,
        };
        let body = Skeleton {
            id: 3,
            joints: [0, 1, 2, 6].map(joint).to_vec(),
            parts: Vec::new(),
            limbs: [LimbDetail::Straight; 4],
            facing: 0.5,
            unexplained: 0.0,
            cameras: CameraSet::default(),
        };
        let mut out = Vec::new();
        skeletons(&Skeletons { list: vec![body], ..Skeletons::default() }, "room", "bodies", &mut out);
        let decoded = Decoded::of(Kind::SceneUpdate, &out);
        assert_eq!((decoded.count("entities[0].spheres"), decoded.text("entities[0].texts[0].text")), (4, "3"));
        let size = decoded.number("entities[0].spheres[3].size.x");
        assert!((size - 0.02).abs() < 1e-12, "{size}");
        assert_eq!(decoded.number("entities[0].lines[0].type"), 2.0);
        let ends: Vec<f64> = (0..decoded.count("entities[0].lines[0].points"))
            .map(|it| decoded.number(&format!("entities[0].lines[0].points[{it}].x")))
            .collect();
        assert_eq!(ends, [0.0, 1.0, 1.0, 2.0, 2.0, 6.0], "head to neck, to shoulder, to wrist");
    }
}
