//! A motion file as an animated scene.

use foveate::motion::Motion;
use foveate::motion::motion::Up;
use foveate::prelude::*;

use super::scene::{Look, scene};
use crate::gather::{Column, Table};
use crate::time_base::Sample;

/// A GLB file with a ball of `radius_m` for each point. Predicted samples are left out.
///
/// # Errors
/// A sentence: irregular times, or more than the file can hold.
pub fn glb(motion: &Motion, radius_m: f64) -> Result<Vec<u8>, String> {
    let mut z_up = motion.clone();
    z_up.turn(Up::Z);
    let Some(rate_hz) = z_up.rate_hz.or((z_up.n_frames() <= 1).then_some(1.0)) else {
        return Err("found irregular times, expected one frame rate for a scene".to_owned());
    };
    let sample = |it: &foveate::motion::motion::Sample| {
        let covariance = it.covariance().unwrap_or_default();
        Sample::new(it.position, &covariance, it.provenance, &it.cameras)
    };
    let column = |point: usize| Column {
        label: z_up.labels[point].clone(),
        target: None,
        mark: None,
        samples: z_up.column(point).enumerate().filter_map(|(frame, it)| Some((frame, sample(it?)?))).collect(),
    };
    let table = Table {
        start: Time::from_s(z_up.start_s()),
        rate_hz,
        n_frames: z_up.n_frames(),
        // A point that is never there has nothing to move along.
        points: (0..z_up.labels.len()).map(column).filter(|it| !it.samples.is_empty()).collect(),
        own_marks: Vec::new(),
        marks_from: Vec::new(),
        cameras: Vec::new(),
    };
    let look = Look { radius: radius_m, cameras: None };
    scene(&table, &look).map_err(|length| format!("{length} bytes, expected at most 4 GiB, the limit of a GLB file"))
}

#[cfg(test)]
mod tests {
    use foveate::motion::motion::Sample;
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn points_of_a_file_become_a_scene() {
        let place = |x: f64| Some(Sample::at(Point3::new(x, 2.0, 3.0)));
        let motion = Motion {
            labels: ["LASI", "never"].map(str::to_owned).to_vec(),
            times_s: vec![0.0, 0.01, 0.02],
            rate_hz: Some(100.0),
            samples: vec![place(1.0), None, None, None, place(1.5), None],
            ..Motion::default()
        };
        let file = glb(&motion, 0.01).unwrap();
        assert!(file.starts_with(b"glTF"));
        let length = u32::from_le_bytes([file[12], file[13], file[14], file[15]]) as usize;
        let json: serde_json::Value = serde_json::from_slice(&file[20..20 + length]).unwrap();
        let names: Vec<&str> = json["nodes"].as_array().unwrap().iter().filter_map(|it| it["name"].as_str()).collect();
        assert_eq!(names, ["LASI", "world"]);
        assert_eq!(json["nodes"][0]["translation"], serde_json::json!([1.0, 2.0, 3.0]));
        // The same from a file with y up.
        let mut y_up = motion;
        y_up.turn(Up::Y);
        assert_eq!(glb(&y_up, 0.01).unwrap(), file);
        assert!(glb(&Motion { rate_hz: None, ..y_up }, 0.01).unwrap_err().contains("irregular times"));
    }
}
