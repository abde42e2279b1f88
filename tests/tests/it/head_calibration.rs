//! `graphs/pan_tilt_calibration.toml`: two heads whose axes nobody knew, found while a light was waved, against where their axes are.

use std::fs;
use std::sync::Arc;

use foveate::geometry::pan_tilt::{Axis, AxisUnits, Setting};
use foveate::scene::calibration::Calibration;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use foveate_sim::head::{Axes, AxesSettings};
use serde::Deserialize as _;

/// Direction [°] and place [mm] of an axis, how far off.
fn apart(found: &Axis, truth: &Axis) -> [f64; 2] {
    let step = found.step_to(truth).unwrap();
    [step.fixed_rows::<2>(0).norm().to_degrees(), 1e3 * step.fixed_rows::<2>(2).norm()]
}

#[test]
fn heads_that_nobody_knew_are_found_in_the_simulated_lab() {
    let path = foveate_testkit::data::workspace_root().join("graphs/pan_tilt_calibration.toml");
    let text = fs::read_to_string(&path).unwrap();
    let graph = rig::load(&text, &path, &foveate_cli::registry(), &Overrides::default());
    let graph = graph.unwrap_or_else(|faults| panic!("{faults}"));
    let results = tempfile::tempdir().unwrap();
    let options = Options { out_dir: Some(results.path().to_owned()), ..Options::default() };
    let outcome = engine::deterministic(Arc::new(graph), &options, &mut |_| ()).unwrap();
    let figures = &outcome.report.figures;
    let document: toml::Table = text.parse().unwrap();
    let given = Calibration::load(&path.with_file_name("pan_tilt_calibration.calibration.toml")).unwrap();
    let found = Calibration::load(&results.path().join("heads.calibration.toml")).unwrap();
    assert!(given.heads.0.is_empty() && found.heads.0.len() == 2 && found.cameras.len() == given.cameras.len());
    for (number, name) in [(1, "ptz-1"), (2, "ptz-2")] {
        let axes = document["scale"]["room"]["node"][&format!("device_{number}")]["axes"].clone();
        let truth = Axes::new(&AxesSettings::deserialize(axes).unwrap()).carrying(given.camera(name).unwrap());
        let head = found.head(name).unwrap();
        let [pan, tilt] = [(&head.model.pan, &truth.pan), (&head.model.tilt, &truth.tilt)].map(|it| apart(it.0, it.1));
        let centre_mm = 1e3 * (head.model.at_rest.centre() - truth.at_rest.centre()).norm();
        println!(
            "{name}: pan axis {:.3}° {:.2} mm, tilt axis {:.3}° {:.2} mm, camera {centre_mm:.2} mm, units {:?}",
            pan[0],
            pan[1],
            tilt[0],
            tilt[1],
            head.units.map(|it| 1f64.to_radians() / it.rad_per_unit)
        );
        assert!(pan[0] < 0.1 && tilt[0] < 0.2 && pan[1] < 5.0 && tilt[1] < 12.0 && centre_mm < 3.0);
        // The data sheet was right.
        for (AxisUnits { rad_per_unit, .. }, per_degree) in head.units.iter().zip([8.8, 12.0]) {
            assert!((rad_per_unit.to_degrees() * per_degree - 1.0).abs() < 4e-3);
        }
        // What counts in the end: where the camera looks at settings that were not visited.
        for (pan, tilt) in [(45.0_f64, -10.0_f64), (-33.0, 8.0), (5.0, 5.0)] {
            let setting = Setting::new(pan.to_radians(), tilt.to_radians());
            let ahead = truth.camera_at(&setting).ray(&nalgebra::Point2::new(319.5, 239.5)).unwrap().at(3.0);
            let seen = head.model.camera_at(&setting).project(&ahead).unwrap();
            let off_px = (seen - nalgebra::Point2::new(319.5, 239.5)).norm();
            assert!(off_px < 3.0, "{name} at {pan}°, {tilt}°: {off_px} px");
        }
        let figure = |it: &str| figures[&format!("head_calibration.{name}.{it}")];
        assert!(figure("free_px.median") < 0.6 && figure("holdout_px.rms") < 0.8, "{figures:?}");
        assert!(
            figure("home_px.rms") > figure("aligned_px.rms") && figure("aligned_px.rms") > 5.0 * figure("free_px.rms")
        );
        assert_eq!(figures[&format!("sweep.{name}.reached")], 26.0);
    }
}
