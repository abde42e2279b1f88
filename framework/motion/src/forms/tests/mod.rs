//! Motions come back from files of each form, real ones are read alike from whichever form, and broken ones do no harm.

use foveate_messages::{CameraId, Provenance};
use foveate_testkit::data_dir_or_skip;
use nalgebra::Point3;

use super::*;
use crate::compare::{CompareOptions, Pairing, compare};
use crate::motion::tests::motion;
use crate::motion::{Event, Sample};

mod pairs;

const AS_IT_SAYS: ReadOptions = ReadOptions { metres_per_unit: None, up: None };
const AS_USUAL: WriteOptions<'_> = WriteOptions { unit: None, up: None };

fn in_unit(unit: &str) -> WriteOptions<'_> {
    WriteOptions { unit: Some(unit), up: None }
}

/// With all that a file can tell: events, cameras, samples of every origin.
fn whole() -> Motion {
    let mut whole = motion(3, 60, 50.0);
    whole.times_s.iter_mut().for_each(|it| *it += 1.5);
    whole.cameras = ["left", "right"].map(str::to_owned).to_vec();
    whole.events = vec![Event { label: "Foot Strike".to_owned(), context: "Left".to_owned(), time_s: 1.75 }];
    for (place, sample) in whole.samples.iter_mut().enumerate() {
        if let Some(it) = sample.as_mut().filter(|it| it.provenance == Provenance::Measured) {
            it.cameras = [CameraId((place % 2) as u16)].into_iter().collect();
        }
    }
    whole
}

/// The same labels, times and origins, places within `tolerance` m.
#[track_caller]
fn check_alike(found: &Motion, wanted: &Motion, tolerance: f64) {
    assert_eq!(found.labels, wanted.labels);
    assert_eq!(found.n_frames(), wanted.n_frames());
    for (a, b) in found.times_s.iter().zip(&wanted.times_s) {
        assert!((a - b).abs() < 2e-6, "{a} s, expected {b}");
    }
    for (place, (a, b)) in found.samples.iter().zip(&wanted.samples).enumerate() {
        match (a, b) {
            (None, None) => {}
            (Some(a), Some(b)) => {
                assert!((a.position - b.position).norm() <= tolerance, "{place}: {a:?}, expected {b:?}");
                assert_eq!(a.provenance, b.provenance, "{place}");
            }
            _ => panic!("{place}: {a:?}, expected {b:?}"),
        }
    }
}

#[test]
fn units_rates_gaps_and_origins_come_back() {
    let wanted = whole();
    for (form, tolerance) in [(Form::C3d, 1e-6), (Form::Table, 1e-6), (Form::Npz, 0.0)] {
        for unit in ["mm", "cm", "m"] {
            let written = write(&wanted, form, "a", &in_unit(unit)).unwrap();
            let read = read(&written.bytes, &AS_IT_SAYS).unwrap();
            assert_eq!(
                (read.form, read.motion.rate_hz, read.motion.up),
                (form, Some(50.0), Up::Z),
                "{:?}",
                read.remarks
            );
            check_alike(&read.motion, &wanted, tolerance);
            assert_eq!(read.remarks, Vec::<String>::new());
            for (a, b) in read.motion.samples.iter().flatten().zip(wanted.samples.iter().flatten()) {
                assert_eq!(a.cameras, b.cameras, "{form}");
                let sigmas = [a, b].map(|it| it.sigma().unwrap_or(0.0));
                assert!((sigmas[0] - sigmas[1]).abs() < 2e-5, "{form}: {sigmas:?} m");
            }
            if form == Form::C3d {
                assert_eq!(read.motion.events, wanted.events);
                assert_eq!(read.motion.unit.unwrap().0, unit);
                assert_eq!(written.lost, Vec::<String>::new());
            } else {
                assert_eq!(written.lost, ["1 events"]);
            }
        }
    }
}

#[test]
fn tables_of_trc_keep_places_and_say_what_they_lose() {
    let wanted = whole();
    for (unit, tolerance) in [("mm", 1e-8), ("m", 1e-5)] {
        let written = write(&wanted, Form::Trc, "a.trc", &in_unit(unit)).unwrap();
        assert_eq!(written.notes, ["turned: y is up in the table"]);
        let mut read = read(&written.bytes, &AS_IT_SAYS).unwrap();
        assert!(read.motion.turn(Up::Z));
        let mut measured = wanted.clone();
        measured.samples.iter_mut().flatten().for_each(|it| it.provenance = Provenance::Measured);
        check_alike(&read.motion, &measured, tolerance);
        assert_eq!((read.motion.rate_hz, read.motion.unit.unwrap().0.as_str()), (Some(50.0), unit));
        let n_filled = wanted.n_of(Provenance::Filled);
        assert!(
            written.lost.contains(&format!("{n_filled} samples were filled in, and now look measured")),
            "{:?}",
            written.lost
        );
        assert!(written.lost.iter().any(|it| it.contains("cameras")) && written.lost.contains(&"1 events".to_owned()));
    }
}

#[test]
fn what_is_only_predicted_is_missing_where_a_form_has_no_word_for_it() {
    let mut motion = whole();
    motion.samples[0].as_mut().unwrap().provenance = Provenance::Predicted;
    for form in [Form::C3d, Form::Trc] {
        let written = write(&motion, form, "a", &AS_USUAL).unwrap();
        assert!(
            written.lost.iter().any(|it| it.starts_with("1 samples that were only predicted")),
            "{:?}",
            written.lost
        );
        assert!(read(&written.bytes, &AS_IT_SAYS).unwrap().motion.samples[0].is_none());
    }
    let table = write(&motion, Form::Table, "a", &AS_USUAL).unwrap();
    assert_eq!(
        read(&table.bytes, &AS_IT_SAYS).unwrap().motion.samples[0].as_ref().unwrap().provenance,
        Provenance::Predicted
    );
}

#[test]
fn names_times_and_marks_survive_our_tables() {
    let mut named = motion(3, 4, 10.0);
    named.labels = ["a,\"b\"", "mark-1", "#c"].map(str::to_owned).to_vec();
    let text = write(&named, Form::Table, "", &AS_USUAL).unwrap().bytes;
    check_alike(&read(&text, &AS_IT_SAYS).unwrap().motion, &named, 1e-6);
    named.labels = ["mark-7", "mark-1", "mark-30"].map(str::to_owned).to_vec();
    let text = String::from_utf8(write(&named, Form::Table, "", &AS_USUAL).unwrap().bytes).unwrap();
    assert!(text.starts_with("time_s,mark,x_m") && text.contains(",world_x_m,") && !text.contains("name"), "{text}");
    let back = read(text.as_bytes(), &AS_IT_SAYS).unwrap().motion;
    assert_eq!(back.labels, ["mark-1", "mark-7", "mark-30"]);
    assert_eq!(
        back.get(0, 1).map(|it| it.position.map(|it| (it * 1e6).round())),
        named.get(0, 0).map(|it| it.position.map(|it| (it * 1e6).round()))
    );
    let quoted = "\"time_s\", \"name\" ,target,x_m,y_m,z_m,\"a, b\"\r\n0,\"knee, left\",1,1,2,3.5,x\r\n";
    let quoted = read(quoted.as_bytes(), &AS_IT_SAYS).unwrap().motion;
    assert_eq!((quoted.labels[0].as_str(), quoted.samples.len()), ("knee, left", 1));
    // Times of two cameras that are not synchronised: no rate, and each point missing between its own.
    let text = "\u{feff}target,time_s,y_m,x_m,z_m,provenance\r\n3,0.0,2,1,3,filled\r\n\r\n1,0.013,0,0,0,\r\n3,0.02,2,1,3.5,predicted\r\n";
    let odd = read(text.as_bytes(), &AS_IT_SAYS).unwrap().motion;
    assert_eq!(
        (odd.labels.clone(), odd.n_frames(), odd.n_present(), odd.rate_hz),
        (vec!["target-1".into(), "target-3".into()], 3, 3, None)
    );
    assert_eq!(
        odd.get(0, 1).unwrap(),
        &Sample { provenance: Provenance::Filled, ..Sample::at(Point3::new(1.0, 2.0, 3.0)) }
    );
}

#[test]
fn broken_tables_are_named_by_their_line() {
    let complaint = |text: &str| read(text.as_bytes(), &AS_IT_SAYS).unwrap_err().to_string();
    assert!(complaint("time_s,target,x_m,y_m\n").starts_with("line 1: found no column `z_m`"));
    let table = |row: &str| format!("time_s,target,x_m,y_m,z_m,provenance\n0,1,0,0,0,measured\n{row}\n");
    assert!(complaint(&table("x,1,0,0,0,")).starts_with("line 3: found `x` for `time_s`"));
    assert!(complaint(&table("1,-1,0,0,0,")).starts_with("line 3: found `-1` for `target`"));
    assert!(complaint(&table("1,1,0,,0,")).starts_with("line 3: found `` for y_m"));
    assert!(complaint(&table("1,1,0,0,nan,")).contains("found `nan` for z_m"));
    assert!(complaint(&table("1,1,0,0,0,guessed")).contains("`guessed`"));
    assert!(complaint(&table("1e99,1,0,0,0,")).contains("found the time"));
    assert!(
        complaint(&table("1,1,0,0\n2,1,0,0,0,")).starts_with("line 3: found `` for z_m"),
        "a row that is too short"
    );
    // Each time another point: as many places as rows times points.
    let apart: String = (0..9_000).map(|it| format!("{it},{it},0,0,0,\n")).collect();
    assert!(
        complaint(&format!("time_s,target,x_m,y_m,z_m,provenance\n{apart}"))
            .contains("expected points that are seen together")
    );
}

/// However a table is cut, no number of it is taken that is not in the whole one.
#[test]
fn a_last_row_of_a_table_that_may_be_cut_is_left_out() {
    for labels in [["target-0", "target-7"], ["mark-0", "mark-1"], ["left", "left wrist"]] {
        let mut motion = motion(2, 3, 10.0);
        motion.labels = labels.map(str::to_owned).to_vec();
        let text = String::from_utf8(write(&motion, Form::Table, "", &AS_USUAL).unwrap().bytes).unwrap();
        let wanted = read(text.as_bytes(), &AS_IT_SAYS).unwrap().motion;
        for length in text.find('\n').unwrap() + 1..text.len() {
            let found = read(&text.as_bytes()[..length], &AS_IT_SAYS).unwrap();
            let (found, is_said) = (found.motion, found.remarks.iter().any(|it| it.contains("may be cut")));
            let n_ended = text[..length].matches('\n').count() - 1;
            let is_whole = text[length..].starts_with('\n') && found.n_present() == n_ended + 1;
            let is_cut = !text[..length].ends_with('\n');
            assert!(is_whole || (found.n_present(), is_said) == (n_ended, is_cut), "{:?}", &text[..length]);
            for (frame, time) in found.times_s.iter().enumerate() {
                assert_eq!(*time, wanted.times_s[frame], "{length}");
                for (point, label) in found.labels.iter().enumerate() {
                    let place = wanted.labels.iter().position(|it| it == label).unwrap();
                    assert!(found.get(frame, point).is_none_or(|it| Some(it) == wanted.get(frame, place)), "{length}");
                }
            }
        }
    }
    let short = "time_s,target,x_m,y_m,z_m,provenance\n0,0,1,2,3.5,measured\n0.1,0,1,2,3\n";
    let found = read(short.as_bytes(), &AS_IT_SAYS).unwrap();
    assert_eq!((found.motion.n_frames(), found.remarks[0].contains("line 3: found fewer fields")), (1, true));
}

#[test]
fn tables_that_are_nearly_right_are_told_what_is_wrong() {
    let right = "time_s,target,x_m,y_m,z_m,provenance\n0,1,0.5,0.5,0.5,measured\n";
    let complaint = |text: String| read(text.as_bytes(), &AS_IT_SAYS).unwrap_err().to_string();
    for (separator, called) in [(";", "semicolons"), ("\t", "tabs"), (" ", "blanks"), ("|", "`|`")] {
        let found = complaint(format!("\u{feff}# of a run\n{}", right.replace(',', separator)));
        assert!(found.starts_with(&format!("line 2: found columns with {called} between them")), "{found}");
    }
    let found = complaint(right.replace("target", "Target"));
    assert!(found.contains("line 1: found no column `target` or `mark`; expected `time_s`"), "{found}");
    let found = complaint(right.replace("time_s", "t"));
    assert!(found.contains("no column `time_s`, and `t` instead"), "{found}");
    for other in ["time_s,camera,x_px,y_px\n", "name,fx,fy,cx,cy\n", "", "#\n", "\n\n", "x_m,y_m\n"] {
        assert_eq!(nearly_table(other.as_bytes()), None, "{other}");
    }
    assert_eq!(nearly_table(right.as_bytes()), None);
}

#[test]
fn forms_are_told_by_their_content() {
    assert_eq!(Form::of(b"\xef\xbb\xbf PathFileType\t4"), Some(Form::Trc));
    assert_eq!(Form::of(b"\r\nHIERARCHY\n"), Some(Form::Bvh));
    assert_eq!(Form::of(b"# of a run\ntime_s,target,x_m"), Some(Form::Table));
    for other in
        [&b""[..], b"time_s,camera,x_px,y_px\n", b"[camera.a]\n", b"P", b"%YAML:1.0\n", b"\xff\xd8\xff\xe0", b"1P\r\n2"]
    {
        assert_eq!(Form::of(other), None, "{other:?}");
    }
    assert!(read(b"[camera.a]\n", &AS_IT_SAYS).unwrap_err().to_string().contains("5b 63 61"));
}

#[test]
fn the_joints_of_a_skeleton_are_points() {
    let text = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 10 0\n}\n}\n\
                MOTION\nFrames: 2\nFrame Time: 0.0083333\n1 2 3 0 0 0\n1 2 3 90 0 0";
    let found = read(text.as_bytes(), &AS_IT_SAYS).unwrap();
    assert!(found.remarks[0].contains("centimetres"), "{:?}", found.remarks);
    let motion = found.motion;
    assert_eq!(
        (motion.labels.clone(), motion.rate_hz, motion.up),
        (vec!["Hips".into(), "Hips-end".into()], Some(120.0), Up::Y)
    );
    assert!((motion.get(1, 1).unwrap().position - Point3::new(-0.09, 0.02, 0.03)).norm() < 1e-12);
    let bvh = write(&motion, Form::Bvh, "", &AS_USUAL).unwrap();
    assert_eq!(read(&bvh.bytes, &AS_IT_SAYS).unwrap().motion, motion);
    // Points over time in another form, without what makes them a skeleton.
    let points = write(&motion, Form::C3d, "", &AS_USUAL).unwrap();
    assert!(points.lost[0].contains("the skeleton"), "{:?}", points.lost);
    let points = read(&points.bytes, &AS_IT_SAYS).unwrap().motion;
    assert_eq!(points.up, Up::Y, "C3D says so");
    assert!(write(&points, Form::Bvh, "", &AS_USUAL).unwrap_err().to_string().contains("without a skeleton"));
}

#[test]
fn archives_of_numpy_are_read_and_refused_by_name() {
    let file = write(&whole(), Form::Npz, "", &AS_USUAL).unwrap().bytes;
    for length in (4..file.len()).step_by(97) {
        assert!(read(&file[..length], &AS_IT_SAYS).is_err());
    }
    let mut changed = file.clone();
    for place in (0..file.len()).step_by(41) {
        changed[place] ^= 0x55;
        // An answer or an error.
        read_as(&changed, Form::Npz, &AS_IT_SAYS).ok();
        changed[place] = file[place];
    }
    let mut empty = crate::npz::Archive::default();
    empty.floats("positions", &[0], &[]).unwrap();
    let error = read(&empty.finish(), &AS_IT_SAYS).unwrap_err().to_string();
    assert_eq!(error, "found arrays positions, expected `positions_m`");
    let mut flat = crate::npz::Archive::default();
    flat.floats("positions_m", &[6], &[0.0; 6]).unwrap();
    assert!(read(&flat.finish(), &AS_IT_SAYS).unwrap_err().to_string().contains("[6], expected frames × points × 3"));
}

/// A unit that is missing, an unknown one, a rate of 0, residuals that say nothing.
#[test]
fn what_a_c3d_file_leaves_open_is_said() {
    let of = |units: &str, largest: f32, residual: f32| {
        let recording = crate::c3d::Recording {
            rate_hz: 100.0,
            units: units.to_owned(),
            first_frame: 101,
            labels: vec!["a".to_owned()],
            samples: vec![crate::c3d::Sample { position: [largest, 0.0, 0.0], residual, cameras: 0 }; 3],
            ..Default::default()
        };
        let coding = crate::c3d::Coding::Float { residual_step: 0.02 };
        crate::c3d::write(&recording, coding, crate::c3d::ByteOrder::Sgi).unwrap()
    };
    let x = |units: &str, largest: f32| {
        let read = read(&of(units, largest, 0.1), &AS_IT_SAYS).unwrap();
        (read.motion.get(0, 0).unwrap().position.x, read.remarks.len())
    };
    assert_eq!([x("mm", 1500.0), x("cm", 150.0), x("m", 1.5)], [(1.5, 0); 3]);
    assert_eq!([x("", 1500.0), x("", 1.5), x("smoots", 1500.0)], [(1.5, 1); 3]);
    let told = read(&of("mm", 1500.0, 0.1), &ReadOptions { metres_per_unit: Some(0.01), ..AS_IT_SAYS }).unwrap().motion;
    assert_eq!(told.get(0, 0).unwrap().position.x, 15.0);
    assert_eq!(told.start_s(), 1.0, "frame 101 at 100 Hz");
    let silent = read(&of("mm", 1500.0, 0.0), &AS_IT_SAYS).unwrap();
    assert_eq!((silent.motion.n_of(Provenance::Measured), silent.remarks.len()), (3, 1));
}

/// One trial, written by its laboratory as C3D as it was measured and as TRC smoothed and with holes filled.
#[test]
fn one_trial_in_two_forms_is_one_motion() {
    let Some(folder) = data_dir_or_skip("one_trial_in_two_forms_is_one_motion", "s10_btk_c3d_trc") else { return };
    let of = |name: &str| read(&std::fs::read(folder.join(name)).unwrap(), &AS_IT_SAYS).unwrap().motion;
    let (file, table) = (of("C3DSamples__others__Gait.c3d"), of("TRCSamples__Gait.trc"));
    assert_eq!(
        (file.n_frames(), file.rate_hz, file.labels.len()),
        (table.n_frames(), table.rate_hz, table.labels.len())
    );
    assert_eq!(file.besides, ["28 analog channels"]);
    for form in Form::ALL.into_iter().filter(|it| *it != Form::Bvh) {
        let again = read(&write(&file, form, "", &AS_USUAL).unwrap().bytes, &AS_IT_SAYS).unwrap().motion;
        assert_eq!((again.n_present(), again.rate_hz), (file.n_present(), file.rate_hz), "{form}");
        let apart = compare(&file, &again, &CompareOptions::default()).unwrap();
        assert_eq!((apart.all.n, apart.pairing), (file.n_present(), Pairing::Names), "{form}");
        assert!(apart.all.max < 1e-6, "{form}: {} m", apart.all.max);
    }
}

/// Every real file, cut and with bytes changed, gives an answer or an error.
#[test]
fn no_broken_file_of_any_form_harms() {
    for (test_folder, endings) in [("s10_btk_c3d_trc", &["trc"][..]), ("s22_bvh_people", &["bvh"])] {
        let Some(folder) = data_dir_or_skip("no_broken_file_of_any_form_harms", test_folder) else { return };
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let Some(form) = path.extension().and_then(|it| it.to_str()).and_then(Form::of_ending) else { continue };
            let whole = std::fs::read(&path).unwrap();
            // The start of long ones will do.
            let bytes = &whole[..whole.len().min(20_000)];
            if endings.contains(&form.name()) {
                for length in (0..bytes.len()).step_by(1 + bytes.len() / 40) {
                    read_as(&bytes[..length], form, &AS_IT_SAYS).ok();
                }
                for place in (0..bytes.len()).step_by(1 + bytes.len() / 60) {
                    let mut changed = bytes.to_vec();
                    for value in [b'\t', b'\n', 0xff, b'9', b' '] {
                        changed[place] = value;
                        read_as(&changed, form, &AS_IT_SAYS).ok();
                    }
                }
            }
        }
    }
}
