//! What a frame costs, and how far joints are off, as views, voxels and people become more.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_geometry::body::{Cubes, Joint, People, PeopleOptions};
use foveate_geometry::voxels::{Carver, Parts};
use foveate_plot::{Axis, COLOURS, Chart, Figure, Series};
use foveate_scene::skeleton::SkeletonMotion;
use foveate_sim::person::{Person, RecordingHints, WholeBody};
use nalgebra::{Point3, Vector2};

use super::scene::{balls, grid_around, hull, mask, ring};
use super::{RATE_HZ, other_side, percentile, truth};

const FRAMES: usize = 30;
/// People stand on a square lattice this far apart [m].
const APART_M: f64 = 0.9;

/// Of one setting, medians over the frames.
struct Cost {
    carve_ms: f64,
    track_ms: f64,
    /// Of all joints of all people.
    error_mm: f64,
    p95_mm: f64,
    followed: usize,
}

/// Measures and draws.
pub fn growth(files: &[PathBuf], out: Option<&Path>) -> Result<(), Box<dyn std::error::Error>> {
    println!("| views | voxel [mm] | people | carving [ms] | bodies [ms] | joints, median / 95 % [mm] | followed |");
    println!("|---|---|---|---|---|---|---|");
    let views: Vec<(f64, [f64; 3])> =
        [4, 6, 8, 12, 16, 20].map(|it| (f64::from(it), [f64::from(it), 30.0, 1.0])).into();
    let voxels: Vec<(f64, [f64; 3])> = [15.0, 20.0, 30.0, 40.0, 50.0, 60.0].map(|it| (it, [8.0, it, 1.0])).into();
    let people: Vec<(f64, [f64; 3])> = [1, 2, 3, 4, 6].map(|it| (f64::from(it), [8.0, 30.0, f64::from(it)])).into();
    let mut charts = Vec::new();
    for (title, axis, settings) in [
        ("views (30 mm, one person)", Axis::new("views [–]"), views),
        ("voxels (8 views, one person)", Axis::new("voxel [mm]"), voxels),
        ("people (8 views, 30 mm)", Axis::new("people [–]"), people),
    ] {
        let (mut carving, mut tracking, mut errors) = (Vec::new(), Vec::new(), Vec::new());
        for (x, [views, voxel, people]) in settings {
            let cost = measure(files, views as usize, voxel / 1e3, people as usize)?;
            println!(
                "| {views} | {voxel} | {people} | {:.2} | {:.2} | {:.0} / {:.0} | {} |",
                cost.carve_ms, cost.track_ms, cost.error_mm, cost.p95_mm, cost.followed
            );
            carving.push([x, cost.carve_ms]);
            tracking.push([x, cost.track_ms]);
            errors.push([x, cost.error_mm]);
        }
        let series = vec![
            Series::line("carving [ms]", COLOURS[0], carving),
            Series::line("bodies [ms]", COLOURS[1], tracking),
            Series::line("joints off, median [mm]", COLOURS[2], errors),
        ];
        charts.push(Chart { series, ..Chart::new(title, [320.0, 260.0], axis, Axis::new("ms, mm").from_zero()) });
    }
    if let Some(path) = out {
        let title = "Bodies in voxels: growth with views, voxels and people".to_owned();
        std::fs::write(path, Figure { title, n_columns: 3, charts }.svg())?;
    }
    Ok(())
}

fn measure(files: &[PathBuf], views: usize, voxel: f64, n_people: usize) -> Result<Cost, Box<dyn std::error::Error>> {
    let cameras = ring(views, [640, 480]);
    let mut random = Random::new(77);
    let columns = (n_people as f64).sqrt().ceil() as usize;
    let mut persons = Vec::new();
    for number in 0..n_people {
        let motion = SkeletonMotion::from_bvh(&std::fs::read_to_string(&files[number % files.len()])?)?;
        let body = Arc::new(WholeBody::new(&motion, RecordingHints::default(), [0.3, 0.3])?);
        let place = Vector2::new((number % columns) as f64, (number / columns) as f64);
        let middle = Vector2::repeat(0.5 * (columns as f64 - 1.0));
        persons.push(Person::whole(body, (place - middle) * APART_M, &mut random));
    }
    let (mut carver, mut people) = (Carver::default(), People::new(PeopleOptions::default()));
    let (mut carve_ms, mut track_ms, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    for frame in 0..FRAMES {
        let time = frame as f64 / RATE_HZ;
        let poses: Vec<_> = persons.iter().map(|it| it.pose(time)).collect();
        let all: Vec<_> = poses.iter().flat_map(|it| balls(it, 1.0)).collect();
        let masks: Vec<(&Camera, Vec<u8>)> = cameras.iter().map(|it| (it, mask(it, &all))).collect();
        let grid = grid_around(&all, voxel);
        let start = Instant::now();
        let indices = hull(&mut carver, &grid, &masks);
        carve_ms.push(start.elapsed().as_secs_f64() * 1e3);
        let parts = Parts::of(carver.hull());
        let component = |it: &[u16; 3]| parts.part(it.map(u32::from)).unwrap_or(0) as u16;
        let components: Vec<u16> = indices.iter().map(component).collect();
        let cubes =
            Cubes { size: voxel, origin: grid.origin, cells: grid.cells, indices: &indices, components: &components };
        let start = Instant::now();
        people.step(&cubes, if frame == 0 { 0.0 } else { 1.0 / RATE_HZ }, |_, _| Vec::new());
        track_ms.push(start.elapsed().as_secs_f64() * 1e3);
        for followed in people.list() {
            let found = followed.tracker.joints();
            // Whom this body is, and which of its sides is which, is not the question here: that of least error.
            let of = |mirror: bool, pose| {
                let off = |(joint, place): &(Joint, Point3<f64>)| {
                    let name = if mirror { other_side(joint.name()) } else { joint.name().to_owned() };
                    found.iter().find(|it| it.joint.name() == name).map(|it| 1e3 * (it.position - place).norm())
                };
                truth(pose).iter().filter_map(off).collect::<Vec<f64>>()
            };
            let candidates = poses.iter().flat_map(|pose| [of(false, pose), of(true, pose)]);
            let mean = |it: &Vec<f64>| it.iter().sum::<f64>() / it.len().max(1) as f64;
            errors.extend(candidates.min_by(|a, b| mean(a).total_cmp(&mean(b))).unwrap_or_default());
        }
    }
    Ok(Cost {
        carve_ms: percentile(&mut carve_ms, 0.5),
        track_ms: percentile(&mut track_ms, 0.5),
        error_mm: percentile(&mut errors, 0.5),
        p95_mm: percentile(&mut errors, 0.95),
        followed: people.list().len(),
    })
}
