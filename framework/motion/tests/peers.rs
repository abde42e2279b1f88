//! Readers that others wrote open our C3D files without a complaint and find in them what was put in: `ezc3d` and `c3d` for Python.

use std::path::Path;
use std::process::Command;

use foveate_motion::c3d::{ByteOrder, Coding, Event, Growing, Recording, Sample, write};

/// A 64th, so that floats and steps are exact [mm].
const STEP: f32 = 0.015625;

/// Points on a curve, some missing and some filled.
fn recording(n_points: usize, n_frames: usize) -> Recording {
    let sample = |i: usize| {
        let position = [(i % 1000) as f32 * STEP, -((i / 3 % 1000) as f32) * STEP, (i % 77) as f32];
        match i {
            _ if i % 7 == 6 => Sample::MISSING,
            _ if i % 11 == 10 => Sample { position, residual: 0.0, cameras: 0 },
            _ => Sample { position, residual: (1 + i % 255) as f32 * STEP, cameras: (1 + i % 127) as u8 },
        }
    };
    Recording {
        rate_hz: 59.94,
        units: "mm".to_owned(),
        first_frame: 1,
        labels: (0..n_points).map(|it| format!("mark-{it}")).collect(),
        samples: (0..n_points * n_frames).map(sample).collect(),
        events: vec![Event { label: "Foot Strike".to_owned(), context: "Left".to_owned(), time_s: 0.5 }],
        start_s: Some(12.5),
        cameras: ["ptz-1", "ptz-2"].map(str::to_owned).to_vec(),
        ..Recording::default()
    }
}

/// As it is found while it grows: two lots of frames, and no end.
fn growing(recording: &Recording) -> Vec<u8> {
    let growing = Growing::new(recording.clone(), STEP, 24).unwrap();
    let mut frames = Vec::new();
    for frame in recording.samples.chunks(recording.labels.len()) {
        growing.put(frame, &mut frames);
    }
    [growing.head(recording.n_frames()).unwrap(), frames].concat()
}

/// Runs `script` with the Python that the variable names; `None` and one line where it names none.
fn peer(test: &str, script: &str, folder: &Path) -> Option<String> {
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        println!("skipped: {test} needs FOVEATE_PEER_PYTHON, a python with c3d, ezc3d and numpy");
        return None;
    };
    let output = Command::new(python).arg("-c").arg(script).arg(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    Some(said)
}

/// Frames, points, rate, labels, units and each sample as `x y z residual cameras`, by the package `c3d`; a warning but for what is no fault ends it.
const C3D: &str = r#"
import sys, os, warnings, c3d
warnings.simplefilter("error")
warnings.filterwarnings("ignore", "No analog data found in file")
for name in sorted(os.listdir(sys.argv[1])):
    with open(os.path.join(sys.argv[1], name), "rb") as handle:
        reader = c3d.Reader(handle)
        labels = []
        for number in [""] + list(range(2, 9)):
            part = reader.get("POINT:LABELS%s" % number)
            labels += [] if part is None else [str(it).strip() for it in part.string_array]
        assert reader.header.analog_per_frame == 1 and reader.analog_rate == reader.point_rate and reader.analog_used == 0
        assert reader.get("FORCE_PLATFORM:USED").uint16_value == 0
        print("file", name, reader.frame_count, reader.point_used, reader.point_rate, len(labels), labels[-1], reader.get("POINT:UNITS").string_value.strip())
        for number, points, analog in reader.read_frames():
            for point in points.tolist():
                print(*point)
"#;

/// The same by `ezc3d`, which gives NaN for what is missing; its residuals and cameras are left out: it takes the word of them otherwise than the format's guide.
const EZC3D: &str = r#"
import sys, os, ezc3d
for name in sorted(os.listdir(sys.argv[1])):
    file = ezc3d.c3d(os.path.join(sys.argv[1], name))
    points = file["data"]["points"][:3].transpose(2, 1, 0)
    group = file["parameters"]["POINT"]
    labels = []
    for number in [""] + list(range(2, 9)):
        labels += group.get("LABELS%s" % number, {"value": []})["value"]
    print("file", name, points.shape[0], points.shape[1], group["RATE"]["value"][0], len(labels), labels[-1], group["UNITS"]["value"][0])
    for frame in points.tolist():
        for point in frame:
            print(*point)
"#;

#[test]
fn two_readers_open_what_we_write() {
    let folder = tempfile::tempdir().unwrap();
    let float = Coding::Float { residual_step: STEP };
    let integer = Coding::Integer { step: Some(STEP) };
    let long = || Recording { labels: vec!["one".to_owned()], ..recording(1, 70_000) };
    let files = [
        ("1-float.c3d", recording(5, 40), write(&recording(5, 40), float, ByteOrder::Intel).unwrap()),
        ("2-integer.c3d", recording(5, 40), write(&recording(5, 40), integer, ByteOrder::Intel).unwrap()),
        ("3-wide.c3d", recording(600, 3), write(&recording(600, 3), float, ByteOrder::Intel).unwrap()),
        ("5-growing.c3d", recording(5, 40), growing(&recording(5, 40))),
        ("6-growing-long.c3d", long(), growing(&long())),
        ("7-growing-wide.c3d", recording(300, 7), growing(&recording(300, 7))),
    ];
    for (name, _, bytes) in &files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    for (reader, script) in [("c3d", C3D), ("ezc3d", EZC3D)] {
        let Some(said) = peer("two_readers_open_what_we_write", script, folder.path()) else { return };
        let mut lines = said.lines();
        for (name, wanted, _) in &files {
            let n_points = wanted.labels.len();
            let fields: Vec<&str> = lines.next().unwrap().split(' ').collect();
            let ["file", found, frames, points, rate, labels, last, units] = fields[..] else {
                panic!("{reader} {name}: {fields:?}")
            };
            assert_eq!((found, units), (*name, "mm"), "{reader}");
            let counts = [frames, points, labels].map(|it| it.parse::<usize>().unwrap());
            assert_eq!(counts, [wanted.n_frames(), n_points, n_points], "{reader} {name}");
            assert!((rate.parse::<f32>().unwrap() - wanted.rate_hz).abs() < 1e-5, "{reader} {name}: {rate}");
            assert_eq!(last, wanted.labels[n_points - 1], "{reader} {name}");
            for (index, sample) in wanted.samples.iter().enumerate() {
                let values: Vec<f32> = lines.next().unwrap().split(' ').map(|it| it.parse().unwrap()).collect();
                let is_there = if reader == "c3d" { values[3] >= 0.0 } else { !values[0].is_nan() };
                assert_eq!(is_there, sample.is_present(), "{reader} {name}, sample {index}: {values:?}");
                if is_there {
                    assert_eq!(values[..3], sample.position, "{reader} {name}, sample {index}");
                }
                if is_there && reader == "c3d" {
                    assert_eq!(
                        (values[3], values[4]),
                        (sample.residual, f32::from(sample.cameras)),
                        "{name}, sample {index}"
                    );
                }
            }
        }
        assert_eq!(lines.next(), None, "{reader}");
    }
}
