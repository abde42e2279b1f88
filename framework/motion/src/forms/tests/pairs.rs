//! Points go through every pair of forms and come back where they were.

use proptest::prelude::*;

use super::*;

/// Forms that carry points.
const FORMS: [Form; 4] = [Form::C3d, Form::Trc, Form::Table, Form::Npz];

/// What of a motion every form tells: the same points at the same times, z up.
fn check_places(found: &Motion, wanted: &Motion, what: &str) -> Result<(), TestCaseError> {
    let (mut found, mut wanted) = (found.clone(), wanted.clone());
    found.turn(Up::Z);
    wanted.turn(Up::Z);
    prop_assert_eq!(&found.labels, &wanted.labels, "{}", what);
    prop_assert_eq!(found.n_frames(), wanted.n_frames(), "{}", what);
    for (frame, (a, b)) in found.times_s.iter().zip(&wanted.times_s).enumerate() {
        prop_assert!((a - b).abs() < 5e-6, "{}: frame {}: {} s, expected {}", what, frame, a, b);
    }
    for (a, b) in found.samples.iter().zip(&wanted.samples) {
        match (a, b) {
            (Some(a), Some(b)) => {
                let apart = (a.position - b.position).norm();
                prop_assert!(apart < 1e-5, "{}: {}, expected {}", what, a.position, b.position);
            }
            _ => prop_assert!(a.is_none() && b.is_none(), "{}: {:?}, expected {:?}", what, a, b),
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn places_come_back_through_every_pair_of_forms(
        places in prop::collection::vec(prop::option::weighted(0.9, [-30.0_f64..30.0, -30.0..30.0, -30.0..30.0]), 8..40),
        rate in prop::sample::select(vec![25.0, 29.97, 60.0, 65.0543, 100.0, 120.0, 1000.0 / 7.0]),
        start in prop::sample::select(vec![0.0, 1.5, 0.012_345, 2916.667]),
        y_is_up: bool,
        unit in prop::sample::select(vec![None, Some("mm"), Some("cm")]),
    ) {
        let n_frames = places.len() / 2;
        let mut samples: Vec<Option<Sample>> =
            places[..2 * n_frames].iter().map(|it| it.map(|it| Sample::at(Point3::from(it)))).collect();
        // A table has a row for each sample: every frame needs one, and every point.
        for frame in samples.chunks_mut(2).filter(|it| it.iter().all(Option::is_none)) {
            frame[0] = Some(Sample::at(Point3::origin()));
        }
        for sample in &mut samples[..2] {
            sample.get_or_insert(Sample::at(Point3::new(1.0, 2.0, 3.0)));
        }
        let wanted = Motion {
            labels: ["left wrist", "waist"].map(str::to_owned).to_vec(),
            times_s: (0..n_frames).map(|it| start + it as f64 / rate).collect(),
            rate_hz: Some(rate),
            samples,
            up: if y_is_up { Up::Y } else { Up::Z },
            ..Motion::default()
        };
        let options = WriteOptions { unit, up: None };
        for first in FORMS {
            let once = read(&write(&wanted, first, "a", &options).unwrap().bytes, &AS_IT_SAYS).unwrap().motion;
            check_places(&once, &wanted, first.name())?;
            for second in FORMS {
                let twice = read(&write(&once, second, "b", &options).unwrap().bytes, &AS_IT_SAYS).unwrap().motion;
                check_places(&twice, &wanted, &format!("{first}, {second}"))?;
            }
        }
    }
}

#[test]
fn joints_of_a_skeleton_stand_alike_in_every_form() {
    let text = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 10 0\n}\n}\n\
                MOTION\nFrames: 3\nFrame Time: 0.0333333\n1 2 3 0 0 0\n1 2 3 90 0 0\n10 20 30 0 90 0\n";
    let wanted = read(text.as_bytes(), &AS_IT_SAYS).unwrap().motion;
    assert!(wanted.lacks_start);
    for first in [Form::C3d, Form::Trc, Form::Table, Form::Npz, Form::Bvh] {
        let once = read(&write(&wanted, first, "a", &AS_USUAL).unwrap().bytes, &AS_IT_SAYS).unwrap().motion;
        check_places(&once, &wanted, first.name()).unwrap();
    }
}

#[test]
fn a_table_with_z_up_is_written_where_it_is_asked_for_and_said_to_be_lost() {
    let wanted = whole();
    let written = write(&wanted, Form::Trc, "a", &WriteOptions { unit: None, up: Some(Up::Z) }).unwrap();
    assert!(written.lost.iter().any(|it| it.contains("--from-up z")) && written.notes.is_empty(), "{:?}", written.lost);
    let read = read(&written.bytes, &ReadOptions { up: Some(Up::Z), ..AS_IT_SAYS }).unwrap().motion;
    let (a, b) = (read.get(3, 1).unwrap(), wanted.get(3, 1).unwrap());
    assert!((a.position - b.position).norm() < 1e-8);
}

#[test]
fn a_form_without_a_clock_says_that_it_loses_the_start() {
    let text = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}\nMOTION\nFrames: 2\nFrame Time: 0.01\n1 2 3\n4 5 6\n";
    let mut motion = read(text.as_bytes(), &AS_IT_SAYS).unwrap().motion;
    assert_eq!(write(&motion, Form::Bvh, "", &AS_USUAL).unwrap().lost, Vec::<String>::new());
    motion.times_s.iter_mut().for_each(|it| *it += 2.5);
    let lost = write(&motion, Form::Bvh, "", &AS_USUAL).unwrap().lost;
    assert!(lost.iter().any(|it| it.contains("the first frame is at 2.500000 s")), "{lost:?}");
}

/// A C3D file of Intel machines with more parameters in its first group, and what leads to the points moved on.
fn with_parameters(file: &[u8], entries: &[u8]) -> Vec<u8> {
    let list = 512 + 4;
    let points = 512 * (usize::from(file[16]) - 1);
    let mut head = [&file[..list], entries, &file[list..points]].concat();
    head.resize(head.len().next_multiple_of(512), 0);
    let more = ((head.len() - points) / 512) as u8;
    let data_start = head.windows(10).position(|it| it == b"DATA_START").unwrap() + 15;
    [16, 514, data_start].into_iter().for_each(|it| head[it] += more);
    [&head, &file[points..]].concat()
}

/// Angles, forces and so on of a model, stored as points, are no places; whatever their lists are called and however many they are.
#[test]
fn outputs_of_a_model_are_left_out_and_said() {
    let labels = ["LASI", "Bob:LHipAngles", "LKneeAngles", "RHEE", "Bob:Weight", "Odd"];
    let lists: [(&str, &[&str], &[u8]); 8] = [
        ("ANGLES", &["Bob:LHipAngles", ""], &[14, 2]),
        ("ANGLES12", &["LKneeAngles"], &[11, 1]),
        ("SCALARS", &["Weight", "nobody"], &[6, 2]),
        ("TYPE_GROUPS", &["ODDITY", "ODD", "PLACES", "PLACE"], &[6, 2, 2]),
        ("ODD_UNITS", &["N"], &[1]),
        ("PLACE_UNITS", &["mm"], &[2]),
        ("ODDITY", &["Odd"], &[3, 1]),
        ("PLACES", &["RHEE"], &[4, 1]),
    ];
    let mut entries = Vec::new();
    for (name, texts, dimensions) in lists {
        entries.extend([name.len() as u8, 1]);
        entries.extend(name.bytes());
        let width = usize::from(dimensions[0]);
        let values: String = texts.iter().map(|it| format!("{it:width$.width$}")).collect();
        entries.extend(((5 + dimensions.len() + values.len()) as u16).to_le_bytes());
        entries.extend([0xff, dimensions.len() as u8]);
        entries.extend(dimensions);
        entries.extend(values.bytes());
        entries.push(0);
    }
    let recording = crate::c3d::Recording {
        rate_hz: 100.0,
        units: "mm".to_owned(),
        first_frame: 1,
        labels: labels.map(str::to_owned).to_vec(),
        samples: (0..12)
            .map(|it| crate::c3d::Sample { position: [it as f32, 0.0, 0.0], residual: 0.1, cameras: 0 })
            .collect(),
        ..Default::default()
    };
    let coding = crate::c3d::Coding::Float { residual_step: 0.02 };
    let file = crate::c3d::write(&recording, coding, crate::c3d::ByteOrder::Intel).unwrap();
    assert_eq!(read(&file, &AS_IT_SAYS).unwrap().motion.labels.len(), 6);
    let read = read(&with_parameters(&file, &entries), &AS_IT_SAYS).unwrap();
    assert_eq!(read.motion.labels, ["LASI", "RHEE"]);
    let x: Vec<f64> = read.motion.samples.iter().flatten().map(|it| (it.position.x * 1e3).round()).collect();
    assert_eq!(x, [0.0, 3.0, 6.0, 9.0]);
    // `Weight` is cut to the width of its list; `Bob:Weight` is found without the subject.
    let said = "4 outputs of a model that are no places (2 ANGLES, 1 ODDITY, 1 SCALARS)";
    assert_eq!(read.motion.besides, [said]);
    assert_eq!(read.remarks, [format!("{said}: left out")]);
}

/// A trial with the outputs of Plug-in Gait: markers and the axes of segments stay, 80 angles, forces, moments and powers go.
#[test]
fn a_trial_with_model_outputs_has_its_markers_alone() {
    let Some(folder) = data_dir_or_skip("a_trial_with_model_outputs_has_its_markers_alone", "s10_btk_c3d_trc") else {
        return;
    };
    let of = |name: &str| read(&std::fs::read(folder.join(name)).unwrap(), &AS_IT_SAYS).unwrap();
    let read = of("C3DSamples__PiG__PiG_Motion-FlatFoot-Full.c3d");
    let labels = &read.motion.labels;
    assert!(labels.iter().any(|it| it == "LASI") && labels.iter().any(|it| it == "PELO"));
    assert!(!labels.iter().any(|it| ["Angles", "Force", "Moment", "Power"].iter().any(|word| it.ends_with(word))));
    assert_eq!(labels.len(), 193 - 80, "{:?}", read.remarks);
    assert!(read.remarks.iter().any(|it| it.contains("26 ANGLES, 20 FORCES, 18 MOMENTS, 16 POWERS")));
}
