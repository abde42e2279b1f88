//! The simulated world has cameras of its own, and a rig knows of them what was estimated.

use std::fs;
use std::sync::Arc;

use foveate::scene::calibration::Calibration;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::data::workspace_root;

/// How well the wide cameras track the lights on a walking person, with the calibration that the reference rig ships with, in the world of this seed: root of
/// the mean squared error [mm] and share of what was there that was found.
fn tracked(seed: u64) -> (f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    for file in ["lab.plan.toml", "face_body.calibration.toml"] {
        fs::copy(workspace_root().join("graphs").join(file), folder.path().join(file)).unwrap();
    }
    let text = format!(
        r#"
        [rig]
        name = "truth"
        calibration = "face_body.calibration.toml"
        duration_s = 5

        [scale.room]
        volume_m = {{ min = [-1.75, -2.5, 0.0], max = [1.75, 2.5, 2.2] }}

        [scale.room.node.lab]
        type = "sim.lab"
        truth = {{ plan = "lab.plan.toml", seed = {seed} }}

        [scale.room.node.lights]
        type = "sim.observer"
        each = "wide-*"
        in = {{ world = "lab.world" }}

        [scale.room.node.targets]
        type = "led.integrator"
        in = {{ features = "lights.features" }}

        [scale.room.node.score]
        type = "sim.score"
        in = {{ targets = "targets.targets", truth = "lab.truth" }}
        start_s = 1.5
        "#
    );
    let path = folder.path().join("truth.toml");
    fs::write(&path, text).unwrap();
    let graph =
        rig::load_file(&path, &foveate_cli::registry(), &Overrides::default()).unwrap_or_else(|it| panic!("{it}"));
    let options = Options { out_dir: Some(folder.path().join("out")), ..Options::default() };
    fs::create_dir(folder.path().join("out")).unwrap();
    let outcome = engine::deterministic(Arc::new(graph), &options, &mut |_| ()).unwrap();
    assert_eq!(outcome.faults, []);
    assert!(folder.path().join("out/truth.calibration.toml").exists());
    let figure = |name: &str| outcome.report.figures.get(name).copied().unwrap_or(f64::NAN);
    (figure("error_mm.rms"), figure("completeness"))
}

#[test]
fn what_was_estimated_in_one_world_holds_in_that_world_alone() {
    let (rms_mm, completeness) = tracked(1);
    assert!(rms_mm < 6.0 && completeness > 0.98, "{rms_mm} mm, {completeness}");
    // Had anything but the simulation read the truth, cameras that stand elsewhere would do no harm.
    for seed in [2, 3] {
        let (rms_mm, completeness) = tracked(seed);
        assert!(rms_mm.is_nan() || rms_mm > 12.0 || completeness < 0.7, "{seed}: {rms_mm} mm, {completeness}");
    }
}

/// What a rig's `truth` is drawn around, if it has one that is not the rig's own calibration: the plan's file and the calibration's.
fn plan_and_calibration(rig: &toml::Table) -> Option<[String; 2]> {
    let calibration = rig.get("rig")?.get("calibration")?.as_str()?;
    let scales = rig.get("scale")?.as_table()?.values();
    let nodes = scales.filter_map(|it| it.get("node")?.as_table()).flat_map(|it| it.values());
    let truth = nodes.filter(|it| it["type"].as_str() == Some("sim.lab")).find_map(|it| it.get("truth"))?;
    let plan = truth.get("plan")?.as_str()?;
    (plan != calibration).then(|| [plan, calibration].map(str::to_owned))
}

#[test]
fn shipped_calibrations_were_estimated_and_are_not_their_plans() {
    let graphs = workspace_root().join("graphs");
    let load = |file: &str| Calibration::load(&graphs.join(file)).unwrap();
    let mut rigs = Vec::new();
    for entry in fs::read_dir(&graphs).unwrap() {
        let path = entry.unwrap().path();
        let Ok(rig) = fs::read_to_string(&path).unwrap_or_default().parse::<toml::Table>() else { continue };
        let Some([plan, calibration]) = plan_and_calibration(&rig) else { continue };
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let (planned, estimated) = (load(&plan), load(&calibration));
        for named in &estimated.cameras {
            let camera = planned.camera(&named.name).unwrap();
            let apart_m = (camera.centre() - named.camera.centre()).norm();
            assert!(apart_m > 1e-4, "{name}: {} stands just where {plan} has it", named.name);
            // A mirrored room, or one that was turned, does not keep this bound.
            assert!(apart_m < 0.15, "{name}: {} is {apart_m} m from its plan", named.name);
        }
        let said = format!("{} {}", estimated.origin, estimated.provenance.map(|it| it.method).unwrap_or_default());
        assert!(said.contains("calibrate"), "{name}: {calibration} does not say how it was found: {said}");
        rigs.push(name);
    }
    for name in ["face_body", "pan_tilt_follow", "room", "knee", "stadium", "nested", "people"] {
        assert!(rigs.iter().any(|it| it == name), "{name} has no world apart from its calibration: {rigs:?}");
    }
}
