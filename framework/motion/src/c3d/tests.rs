//! Files that we write come back, files of others are read, and broken ones are refused by name.

use std::path::Path;
use std::process::Command;

use foveate_testkit::data_dir_or_skip;
use proptest::prelude::*;

use super::*;

const ORDERS: [ByteOrder; 3] = [ByteOrder::Intel, ByteOrder::Dec, ByteOrder::Sgi];
const MM: f32 = 0.015625;

/// Points on a curve, every seventh sample missing and every eleventh filled; exact in floats and in steps of [`MM`].
fn recording(n_points: usize, n_frames: usize) -> Recording {
    let sample = |i: usize| {
        let position = [(i % 1000) as f32 * MM, -((i / 3 % 1000) as f32) * MM, (i % 77) as f32];
        match i {
            _ if i % 7 == 6 => Sample::MISSING,
            _ if i % 11 == 10 => Sample { position, residual: 0.0, cameras: 0 },
            _ => Sample { position, residual: (1 + i % 255) as f32 * MM, cameras: (1 + i % 127) as u8 },
        }
    };
    let event = |i: usize| Event {
        label: ["Foot Strike", "Foot Off"][i % 2].to_owned(),
        context: "Left".to_owned(),
        time_s: i as f64 * 31.25,
    };
    Recording {
        rate_hz: 59.94,
        units: "mm".to_owned(),
        first_frame: 1,
        labels: (0..n_points).map(|it| format!("mark-{it}")).collect(),
        samples: (0..n_points * n_frames).map(sample).collect(),
        events: (0..3).map(event).collect(),
        analog: Analog::default(),
        start_s: Some(12.000_000_001),
        cameras: ["ptz-1", "ptz-2"].map(str::to_owned).to_vec(),
        y_is_up: false,
        model_outputs: Vec::new(),
    }
}

const FLOAT: Coding = Coding::Float { residual_step: MM };

#[test]
fn recording_comes_back_in_each_byte_order_and_coding() {
    let wanted = recording(5, 40);
    for order in ORDERS {
        for coding in [FLOAT, Coding::Integer { step: Some(MM) }] {
            let file = write(&wanted, coding, order).unwrap();
            assert!(file.len().is_multiple_of(BLOCK));
            assert_eq!(read(&file).unwrap(), wanted, "{order:?} {coding:?}");
        }
    }
}

proptest! {
    #[test]
    fn integers_come_back_within_half_a_step(
        places in prop::collection::vec([-9e3_f32..9e3, -2.0_f32..2.0, 0.0_f32..1e4], 1..40),
        order in prop::sample::select(ORDERS.to_vec()),
    ) {
        let samples: Vec<Sample> = places.iter().map(|&position| Sample { position, residual: 1e-9, cameras: 3 }).collect();
        let wanted = Recording { labels: vec!["a".into()], samples, ..recording(0, 0) };
        let step = places.iter().flatten().fold(0.0_f32, |most, it| most.max(it.abs())) / 32_767.0 * 1.000_001;
        let found = read(&write(&wanted, Coding::Integer { step: None }, order).unwrap()).unwrap();
        for (found, wanted) in found.samples.iter().zip(&wanted.samples) {
            for axis in 0..3 {
                let error = (found.position[axis] - wanted.position[axis]).abs();
                prop_assert!(error <= step * 0.5001 + 1e-7 * wanted.position[axis].abs(), "{} {} {}", error, step, wanted.position[axis]);
            }
            prop_assert!(found.residual > 0.0, "a residual of a measured point became that of one that is not");
        }
    }
}

#[test]
fn long_recordings_and_many_points_come_back() {
    let long = recording(1, 70_000);
    let file = write(&long, FLOAT, ByteOrder::Intel).unwrap();
    assert_eq!(file[8..10], [0xff, 0xff], "the header saturates");
    assert_eq!(read(&file).unwrap(), long);
    let late = Recording { first_frame: 100_000, ..recording(2, 9) };
    assert_eq!(read(&write(&late, FLOAT, ByteOrder::Dec).unwrap()).unwrap(), late);
    for n_points in [0, 1, 255, 256, 510, 511, 700] {
        let wide = recording(n_points, 2);
        assert_eq!(read(&write(&wide, FLOAT, ByteOrder::Sgi).unwrap()).unwrap(), wide, "{n_points} points");
    }
}

#[test]
fn what_no_file_can_tell_is_refused() {
    let refused = |recording: Recording, coding: Coding| write(&recording, coding, ByteOrder::Intel).unwrap_err();
    let far = || {
        let mut far = recording(1, 1);
        far.samples[0].position[0] = 1e4;
        far
    };
    assert!(refused(far(), Coding::Integer { step: Some(0.1) }).to_string().contains("at most 32767 steps"));
    assert!(refused(far(), Coding::Float { residual_step: 0.0 }).expected.contains("above 0"));
    let torn = Recording { samples: vec![Sample::MISSING; 3], ..recording(2, 0) };
    assert!(refused(torn, FLOAT).expected.contains("whole frames"));
    let named = Recording { labels: vec!["x".repeat(121)], samples: Vec::new(), ..recording(0, 0) };
    assert!(refused(named, FLOAT).found.contains("xxx"));
    let labels = (0..20_000).map(|it| format!("mark-{it}")).collect();
    let crowd = Recording { labels, samples: Vec::new(), ..recording(0, 0) };
    assert!(refused(crowd, FLOAT).expected.contains("255 blocks"));
    let mut broken = recording(1, 1);
    broken.samples[0].position[1] = f32::NAN;
    let file = write(&broken, FLOAT, ByteOrder::Intel).unwrap();
    assert_eq!(read(&file).unwrap().samples, [Sample::MISSING]);
}

#[track_caller]
fn check_broken(change: impl FnOnce(&mut Vec<u8>), offset: usize, expected: &str) {
    let mut file = write(&recording(5, 40), FLOAT, ByteOrder::Intel).unwrap();
    change(&mut file);
    let error = read(&file).unwrap_err();
    assert!(error.offset == offset && error.expected.contains(expected), "{error}");
}

#[test]
fn broken_headers_are_named() {
    check_broken(|it| it.truncate(100), 0, "512 bytes of a header");
    check_broken(|it| it[1] = 0x51, 1, "0x50");
    check_broken(|it| it[0] = 0, 0, "block 2 or later");
    check_broken(|it| it[0] = 200, 199 * 512, "4 bytes of the head of the parameters");
    check_broken(|it| it[515] = 83, 515, "84 (Intel)");
    check_broken(|it| it[516 + 1] = 0, 517, "a group from 1 to 127");
    check_broken(|it| (it[16], it[DATA_START]) = (1, 1), 16, "a block behind");
    check_broken(|it| it.truncate(2048), 1536, "40 frames of 80 bytes each");
    // The first parameter: `USED` of `POINT`, behind 2 + 5 + 3 bytes of its group.
    check_broken(|it| it[526 + 2 + 4 + 1] = 0xff, 532, "0, or 2 to");
    check_broken(|it| it[526 + 2 + 4 + 2] = 3, 534, "-1, 1, 2 or 4");
    check_broken(|it| it[526 + 2 + 4 + 3] = 8, 535, "0 to 7");
}

/// Where the value of `POINT:DATA_START` stands in files of [`recording`]: behind `USED` (14 bytes), `FRAMES` (16) and its own head (17).
const DATA_START: usize = 526 + 14 + 16 + 17;

/// What is said of a file of [`recording`] after a change that leaves its points as they were.
#[track_caller]
fn check_put_right(order: ByteOrder, change: impl FnOnce(&mut Vec<u8>), words: &str) {
    let wanted = recording(5, 40);
    let mut file = write(&wanted, FLOAT, order).unwrap();
    change(&mut file);
    let (found, remarks) = read_with_remarks(&file).unwrap();
    assert_eq!((found.labels, found.samples), (wanted.labels, wanted.samples));
    assert!(remarks.len() == 1 && remarks[0].contains(words), "{remarks:?}");
}

#[test]
fn header_and_parameters_may_disagree() {
    // The word of a byte that may stand first or second.
    let all = |change: &dyn Fn(&mut Vec<u8>, usize), words: &str| {
        check_put_right(ByteOrder::Intel, |it| change(it, 0), words);
        check_put_right(ByteOrder::Dec, |it| change(it, 0), words);
        check_put_right(ByteOrder::Sgi, |it| change(it, 1), words);
    };
    all(&|it, low| it[4 + low] = 100, "disagree on analog samples");
    all(&|it, low| it[2 + low] = 7, "POINT:USED says 5 points and the header 7; taken: 5");
    all(&|it, low| it[526 + 11 + low] = 99, "POINT:USED says 99 points and the header 5; taken: 5");
    all(&|it, low| it[16 + low] = 1, "in block 1 by the header, 4 by POINT:DATA_START; taken: 4");
    all(&|it, low| it[DATA_START + low] = 9, "taken: 4");
    // Word 10: samples of each channel in a frame; no channel has any.
    for per_frame in [0, 1, 7] {
        let mut file = write(&recording(5, 40), FLOAT, ByteOrder::Intel).unwrap();
        file[18] = per_frame;
        assert_eq!(read_with_remarks(&file).unwrap(), (recording(5, 40), Vec::new()));
    }
}

#[test]
fn points_are_kept_where_analog_values_are_no_whole_number_of_channels() {
    let wanted = recording(2, 3);
    let file = write(&wanted, FLOAT, ByteOrder::Intel).unwrap();
    let (head, data) = file.split_at(file.len() - BLOCK);
    // Three values a frame of two samples each: one channel and a half.
    let mut torn = head.to_vec();
    (torn[4], torn[18]) = (3, 2);
    for frame in data.chunks_exact(32).take(3) {
        torn.extend_from_slice(frame);
        torn.extend_from_slice(&[7; 12]);
    }
    torn.resize(file.len(), 0);
    let (found, remarks) = read_with_remarks(&torn).unwrap();
    assert_eq!((found.samples, found.analog), (wanted.samples, Analog::default()));
    assert!(remarks.iter().any(|it| it.contains("not a whole number of channels")), "{remarks:?}");
}

/// The file's last link with its bytes swapped, as files of SGI machines have it.
fn swap_last_link(file: &mut [u8]) {
    let end = file.windows(7).rposition(|it| it == b"Foveate").unwrap();
    // `COMPANY`, its link, kind, number of dimensions and the two of them.
    let link = end - 4 - 2;
    assert_eq!(&file[link - 7..link], b"COMPANY");
    file.swap(link, link + 1);
}

#[test]
fn files_of_sgi_machines_are_read() {
    check_put_right(ByteOrder::Sgi, |it| swap_last_link(it), "has its bytes swapped");
    check_put_right(ByteOrder::Intel, |it| swap_last_link(it), "has its bytes swapped");
}

#[test]
fn the_section_ends_where_its_blocks_do() {
    let wanted = recording(5, 40);
    let plain = write(&wanted, FLOAT, ByteOrder::Intel).unwrap();
    // The mark of the end becomes a group whose link leads out of the section, into the data.
    let end = BLOCK * 3;
    let last = plain[..end].iter().rposition(|it| *it != 0).unwrap();
    let mut endless = plain.clone();
    let link = last + 5;
    let [low, high] = ((end + 123 - link) as u16).to_le_bytes();
    // Behind the empty description of the last parameter.
    endless[last + 2..last + 7].copy_from_slice(&[1, 0xff, b'x', low, high]);
    assert_eq!((endless[BLOCK + 2], read_with_remarks(&endless).unwrap()), (2, (wanted.clone(), Vec::new())));
    // A section that counts one block too few, and one that does not count.
    let mut short = plain.clone();
    short[BLOCK + 2] = 1;
    let (found, remarks) = read_with_remarks(&short).unwrap();
    assert_eq!((found, remarks.len()), (wanted.clone(), 1));
    assert!(remarks[0].contains("behind the 1 blocks"), "{remarks:?}");
    let mut silent = plain;
    silent[BLOCK + 2] = 0;
    assert_eq!(read_with_remarks(&silent).unwrap(), (wanted, Vec::new()));
}

#[test]
fn a_coordinate_that_is_no_number_makes_its_point_missing() {
    let wanted = recording(5, 40);
    let mut file = write(&wanted, FLOAT, ByteOrder::Intel).unwrap();
    file[BLOCK * 3..BLOCK * 3 + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let found = read(&file).unwrap();
    assert_eq!(found.samples[0], Sample::MISSING);
    assert_eq!(found.samples[1..], wanted.samples[1..]);
}

/// Cut off anywhere, and with any byte of the header or the parameters changed: an answer, and no more memory than the file is worth.
fn torture(file: &[u8], stride: usize) {
    let check = |bytes: &[u8]| {
        if let Ok(found) = read(bytes) {
            assert!(found.samples.len() * 8 <= bytes.len() && found.analog.values.len() * 2 <= bytes.len());
        }
    };
    for length in (0..file.len().min(8192)).step_by(stride).chain((8192..file.len()).step_by(997)) {
        check(&file[..length]);
    }
    let mut changed = file.to_vec();
    let end = file.len().min(usize::from(file[16]).max(3) * BLOCK);
    for place in (0..end).step_by(stride) {
        for value in [0, 1, 0x7f, 0x80, 0xff, file[place] ^ 0x10, file[place].wrapping_add(1)] {
            changed[place] = value;
            check(&changed);
        }
        changed[place] = file[place];
    }
}

#[test]
fn no_broken_file_harms() {
    for order in ORDERS {
        let mut file = write(&recording(3, 4), FLOAT, order).unwrap();
        torture(&file, 3);
        swap_last_link(&mut file);
        torture(&file, 5);
    }
    torture(&write(&recording(600, 1), Coding::Integer { step: None }, ByteOrder::Intel).unwrap(), 7);
}

fn data(test: &str) -> Option<std::path::PathBuf> {
    data_dir_or_skip(test, "s10_btk_c3d_trc")
}

fn real(folder: &Path, name: &str) -> Recording {
    let path = folder.join(name);
    read(&std::fs::read(&path).unwrap()).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn no_broken_real_file_harms() {
    let Some(folder) = data("no_broken_real_file_harms") else { return };
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_c3d = path.extension().is_some_and(|it| it.eq_ignore_ascii_case("c3d"));
        if is_c3d && path.metadata().unwrap().len() < 100_000 {
            torture(&std::fs::read(&path).unwrap(), 7);
        }
    }
}

#[test]
fn recordings_of_laboratories_are_read() {
    let Some(folder) = data("recordings_of_laboratories_are_read") else { return };
    let facts = |name: &str| {
        let it = real(&folder, &format!("C3DSamples__{name}"));
        let missing = it.samples.iter().filter(|it| !it.is_present()).count();
        let channels = (it.analog.labels.len(), it.analog.per_frame);
        (it.labels.len(), it.n_frames(), it.rate_hz, missing, channels, it.first_frame, it.units)
    };
    // Figures as another reader (ezc3d 1.7.2) gives them, and for Dance those of its maker's table.
    let mm = || "mm".to_owned();
    assert_eq!(facts("c3d.org__sample02__DEC_INT.C3D"), (36, 89, 50.0, 228, (16, 4), 1, mm()));
    assert_eq!(facts("c3d.org__sample02__pc_real.c3d"), (36, 89, 50.0, 228, (16, 4), 1, mm()));
    assert_eq!(facts("c3d.org__sample10__TYPE-4.C3D").0, 13);
    assert_eq!(facts("c3d.org__sample04__sub_labels.c3d").0, 114);
    assert_eq!(facts("others__Gait.c3d"), (33, 487, 100.0, 9682, (28, 10), 1, mm()));
    assert_eq!(facts("others__FunctionalWalk.c3d").5, 480);
    assert_eq!(facts("PiG__PiG_Motion-FlatFoot-Full.c3d").1, 315);
    let dance = facts("c3d.org__sample13__Dance.c3d");
    assert_eq!((dance.0, dance.1), (40, 499));
    assert!((dance.2 - 65.05).abs() < 0.01, "{} Hz", dance.2);
}

/// The bytes of a real file as an SGI machine has them: words and floats of header, parameters and data in its order.
fn mirrored(intel: &[u8]) -> Vec<u8> {
    let mut file = intel.to_vec();
    let is_float = f32::from_le_bytes([file[12], file[13], file[14], file[15]]) < 0.0;
    let swap = |file: &mut [u8], from: usize, n: usize, size: usize| {
        file[from..from + n * size].chunks_exact_mut(size).for_each(|it| it.reverse());
    };
    let data = (usize::from(file[16]) - 1) * BLOCK;
    let section = (usize::from(file[0]) - 1) * BLOCK;
    // Words 2 to 6, the scale, words 9 and 10, the rate, the events.
    for (word, n, size) in [(2, 5, 2), (7, 1, 4), (9, 2, 2), (11, 1, 4), (149, 3, 2), (153, 18, 4)] {
        swap(&mut file, (word - 1) * 2, n, size);
    }
    file[section + 3] = 86;
    let mut at = section + 4;
    while file[at] != 0 {
        let is_group = file[at + 1] as i8 <= 0;
        let link = at + 2 + usize::from((file[at] as i8).unsigned_abs());
        let step = usize::from(u16::from_le_bytes([file[link], file[link + 1]]));
        if !is_group {
            let n_dimensions = usize::from(file[link + 3]);
            let n: usize = file[link + 4..link + 4 + n_dimensions].iter().map(|it| usize::from(*it)).product();
            let size = usize::from((file[link + 2] as i8).unsigned_abs());
            swap(&mut file, link + 4 + n_dimensions, n, size);
        }
        swap(&mut file, link, 1, 2);
        if step == 0 {
            break;
        }
        at = link + step;
    }
    let size = if is_float { 4 } else { 2 };
    let n = (file.len() - data) / size;
    swap(&mut file, data, n, size);
    file
}

#[test]
fn real_files_in_the_order_of_sgi_machines_are_the_same() {
    let Some(folder) = data("real_files_in_the_order_of_sgi_machines_are_the_same") else { return };
    for name in [
        "c3d.org__sample02__pc_real.c3d",
        "others__Gait.c3d",
        "c3d.org__sample13__Dance.c3d",
        "PiG__PiG_Motion-FlatFoot-Full.c3d",
    ] {
        let file = std::fs::read(folder.join(format!("C3DSamples__{name}"))).unwrap();
        if file[(usize::from(file[0]) - 1) * BLOCK + 3] != 84 {
            continue;
        }
        let (intel, sgi) = (read(&file).unwrap(), read(&mirrored(&file)).unwrap());
        assert!(intel == sgi && intel.n_frames() > 50, "{name}");
        torture(&mirrored(&file)[..file.len().min(60_000)], 211);
    }
}

/// The same trial as integers with DEC floats and as Intel floats.
#[test]
fn one_trial_in_two_byte_orders_agrees() {
    let Some(folder) = data("one_trial_in_two_byte_orders_agrees") else { return };
    let dec = real(&folder, "C3DSamples__c3d.org__sample02__DEC_INT.C3D");
    let intel = real(&folder, "C3DSamples__c3d.org__sample02__pc_real.c3d");
    assert_eq!(dec.labels, intel.labels);
    assert_eq!(dec.events[..8], intel.events[..8]);
    assert_eq!(dec.analog.labels, intel.analog.labels);
    let same_cameras = dec.samples.iter().zip(&intel.samples).filter(|it| it.0.cameras == it.1.cameras).count();
    assert_eq!(dec.samples.len() - same_cameras, 96, "so many differ in the files");
    for (a, b) in dec.samples.iter().zip(&intel.samples) {
        assert_eq!(a.is_present(), b.is_present());
        assert!((0..3).all(|it| (a.position[it] - b.position[it]).abs() < 0.15), "{a:?} {b:?}");
        assert!((a.residual - b.residual).abs() < 1e-3, "{a:?} {b:?}");
    }
    for (a, b) in dec.analog.values.iter().zip(&intel.analog.values) {
        assert!((a - b).abs() <= 1e-3 * a.abs().max(1.0), "{a} {b}");
    }
}

/// Runs `script` with `FOVEATE_PEER_PYTHON`, a Python that has ezc3d; `None` and one line where it is not named.
fn peer(test: &str, script: &str, arguments: &[&Path]) -> Option<String> {
    let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
        println!("skipped: {test} needs FOVEATE_PEER_PYTHON, a python with ezc3d and numpy");
        return None;
    };
    let output = Command::new(python).arg("-c").arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

/// ezc3d gives all that it reads; a missing point is NaN there.
const DUMP: &str = r#"
import sys, struct, ezc3d, numpy
for path in sys.argv[1:]:
    file = ezc3d.c3d(path)
    points = file["data"]["points"][:3].transpose(2, 1, 0).astype("<f4")
    labels = []
    for number in [""] + list(range(2, 9)):
        labels += file["parameters"]["POINT"].get("LABELS%s" % number, {"value": []})["value"]
    print(points.shape[0], points.shape[1], file["header"]["points"]["frame_rate"], len(labels), labels[-1],
          file["parameters"]["POINT"]["UNITS"]["value"][0], points.tobytes().hex())
    mask = file["data"]["meta_points"]["camera_masks"].transpose(2, 1, 0).astype(int)
    bits = (mask * (1 << numpy.arange(7))).sum(2).astype("u1")
    residuals = file["data"]["meta_points"]["residuals"][0].transpose(1, 0).astype("<f4")
    print(bits.tobytes().hex(), residuals.tobytes().hex())
"#;

#[test]
fn ezc3d_reads_what_we_write() {
    let folder = tempfile::tempdir().unwrap();
    let whole = recording(5, 200);
    let files = [
        ("float.c3d", whole.clone(), FLOAT, ByteOrder::Intel),
        ("integer.c3d", whole.clone(), Coding::Integer { step: Some(MM) }, ByteOrder::Intel),
        ("dec.c3d", whole, Coding::Integer { step: Some(MM) }, ByteOrder::Dec),
        ("wide.c3d", recording(600, 3), FLOAT, ByteOrder::Intel),
        ("long.c3d", recording(1, 70_000), FLOAT, ByteOrder::Intel),
    ];
    let mut paths = Vec::new();
    for (name, recording, coding, order) in &files {
        paths.push(folder.path().join(name));
        std::fs::write(&paths[paths.len() - 1], write(recording, *coding, *order).unwrap()).unwrap();
    }
    let arguments: Vec<&Path> = paths.iter().map(|it| it.as_path()).collect();
    let Some(said) = peer("ezc3d_reads_what_we_write", DUMP, &arguments) else { return };
    let mut lines = said.lines();
    for (name, wanted, coding, _) in &files {
        let n_points = wanted.labels.len();
        let fields: Vec<&str> = lines.next().unwrap().split(' ').collect();
        let [frames, points, rate, labels, last, units, hex] = fields[..] else { panic!("{name}: {fields:?}") };
        assert_eq!(
            [frames, points, labels],
            [wanted.n_frames(), n_points, n_points].map(|it| it.to_string()),
            "{name}"
        );
        assert_eq!((rate.parse::<f32>().unwrap(), last, units), (59.94, &*wanted.labels[n_points - 1], "mm"), "{name}");
        let positions = floats_of(hex);
        assert_eq!(positions.len(), wanted.samples.len() * 3, "{name}");
        for (sample, found) in wanted.samples.iter().zip(positions.chunks_exact(3)) {
            match sample.is_present() {
                true => assert_eq!(found, sample.position, "{name}"),
                false => assert!(found.iter().all(|it| it.is_nan()), "{name}: {found:?}"),
            }
        }
        // ezc3d takes the words of a float for residual and cameras, and of integers the cameras' byte for the residual's: against the
        // format's guide and the files of its makers. Whether a point is there it tells all the same.
        let (_, residuals) = lines.next().unwrap().split_once(' ').unwrap();
        for (sample, found) in wanted.samples.iter().zip(floats_of(residuals)) {
            assert_eq!(found >= 0.0, sample.is_present(), "{name} {coding:?}: {found} {sample:?}");
        }
    }
}

fn floats_of(hex: &str) -> Vec<f32> {
    let digit = |it: u8| char::from(it).to_digit(16).unwrap();
    let bytes: Vec<u8> = hex.as_bytes().chunks_exact(2).map(|it| (digit(it[0]) << 4 | digit(it[1])) as u8).collect();
    bytes.chunks_exact(4).map(|it| f32::from_le_bytes([it[0], it[1], it[2], it[3]])).collect()
}

/// What both can read, both read alike.
#[test]
fn we_read_what_ezc3d_reads() {
    let Some(folder) = data("we_read_what_ezc3d_reads") else { return };
    let names = ["c3d.org__sample02__DEC_INT.C3D", "others__Gait.c3d", "others__FunctionalWalk.c3d"];
    let paths = names.map(|it| folder.join(format!("C3DSamples__{it}")));
    let arguments: Vec<&Path> = paths.iter().map(|it| it.as_path()).collect();
    let Some(said) = peer("we_read_what_ezc3d_reads", DUMP, &arguments) else { return };
    for (path, line) in paths.iter().zip(said.lines().step_by(2)) {
        let ours = read(&std::fs::read(path).unwrap()).unwrap();
        let theirs = floats_of(line.rsplit(' ').next().unwrap());
        assert_eq!(ours.samples.len() * 3, theirs.len());
        for (sample, found) in ours.samples.iter().zip(theirs.chunks_exact(3)) {
            let agrees = |axis: usize| (sample.position[axis] - found[axis]).abs() <= 1e-6 * found[axis].abs();
            assert!(!sample.is_present() || (0..3).all(agrees), "{sample:?} {found:?}");
        }
    }
}
