//! `puppet.svg`: the motion of the other skeleton, as in Figure 14 of [D'Apuzzo 1999].

use foveate::plot::svg::Pen;
use foveate::plot::{Axis, COLOURS, Chart, Figure, Marks, Series};
use foveate::scene::skeleton::retarget::{RigJoint, RigPose, stand};
use nalgebra::Point3;

/// Of one chart [px].
const SIZE: [f64; 2] = [230.0, 260.0];
/// Moments that are drawn at most, from the first to the last.
const MOMENTS: usize = 4;

/// Bones of the rig from in front and from the side at moments that are spread evenly; `frame_s` between poses [s].
pub(super) fn svg(rig: &[RigJoint], poses: &[RigPose], frame_s: f64) -> String {
    let last = poses.len().saturating_sub(1);
    let mut moments: Vec<usize> = (0..MOMENTS).map(|it| it * last / (MOMENTS - 1)).collect();
    moments.dedup();
    let views = [[(0, "x"), (1, "y")], [(2, "z"), (1, "y")]];
    let charts =
        views.iter().flat_map(|axes| moments.iter().map(|it| chart(rig, &poses[*it], *it as f64 * frame_s, *axes)));
    Figure { title: "The other skeleton as it moves".to_owned(), n_columns: moments.len(), charts: charts.collect() }
        .svg()
}

fn chart<'a>(
    rig: &[RigJoint],
    pose: &RigPose,
    time_s: f64,
    [(x, across), (y, up)]: [(usize, &'static str); 2],
) -> Chart<'a> {
    let stands = stand(rig, Some(pose));
    let flat = |it: &Point3<f64>| [it[x], it[y]];
    let place = |joint: usize| Point3::from(stands[joint].translation.vector);
    let bone = |joint: usize| {
        let to_joint = rig[joint].parent.map(|it| vec![flat(&place(it)), flat(&place(joint))]);
        let to_end = rig[joint].end.map(|it| vec![flat(&place(joint)), flat(&(stands[joint] * Point3::from(it)))]);
        to_joint.into_iter().chain(to_end)
    };
    let pieces = (0..rig.len()).flat_map(bone).collect();
    let bones = Series { name: "bones".to_owned(), marks: Marks::Line, pen: Pen::new(COLOURS[1], 2.0), pieces };
    let joints = Series::dots("joints", COLOURS[2], (0..rig.len()).map(|it| flat(&place(it))).collect());
    Chart::new(format!("{time_s:.2} s"), SIZE, Axis::new(across), Axis::new(up)).equal().with(bones).with(joints)
}
