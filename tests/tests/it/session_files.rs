//! Sessions from and as files of other kinds: imported, exported, merged, calibrated with, reported, and with parts of pictures left out.

use std::fs;
use std::path::Path;
use std::process::Command;

use foveate_messages::{Image, Targets};
use foveate_node::port::MessageType;
use foveate_session::source::{camera_of, fact};
use foveate_session::{Session, body, picture};
use serde_json::Value;

use crate::sessions::{must, refuses};
use crate::the_program::{new_room, root};

/// What a test picture shows: a gradient that is another one in each picture.
fn level(n: u32, x: u32, y: u32) -> u8 {
    (x * 3 + y * 5 + n * 17) as u8
}

/// A folder of pictures of 32 x 20 px, without the one of that number.
fn pictures(folder: &Path, count: u32, without: u32) {
    fs::create_dir_all(folder).unwrap();
    for n in (0..count).filter(|it| *it != without) {
        let picture = image::GrayImage::from_fn(32, 20, |x, y| image::Luma([level(n, x, y)]));
        picture.save(folder.join(format!("{n:03}.png"))).unwrap();
    }
}

/// The pictures of a session: camera, capture time [s], and the picture.
fn images(path: &Path) -> Vec<(String, f64, Image)> {
    let mut session = Session::open(path).unwrap();
    let mut found = Vec::new();
    let channels = session.summary.channels.clone();
    let schemas = session.summary.schemas.clone();
    for chunk in 0..session.summary.chunks.len() {
        session
            .messages(chunk, |channel, _, bytes| {
                let channel = &channels[&channel];
                if fact(channel, "message") == "image" {
                    let (stamp, image) = picture::read(&schemas[&channel.schema_id].0.name, bytes)?;
                    found.push((camera_of(channel).unwrap().to_owned(), stamp.time.as_s(), image));
                }
                Ok(())
            })
            .unwrap();
    }
    found
}

#[test]
fn pictures_become_a_session_and_films_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    pictures(&folder.path().join("shots/left"), 9, 4);
    pictures(&folder.path().join("shots/right"), 8, 99);
    refuses(folder.path(), &["import", "shots", "-o", "a.mcap"], &["hold no times", "--rate"]);
    let said = must(folder.path(), &["import", "shots", "--rate", "20", "-o", "a.mcap"]);
    assert!(said.contains("room.images[left] lacks 1 pictures, the first at 0.2"), "{said}");
    let found = images(&folder.path().join("a.mcap"));
    assert_eq!(found.len(), 16);
    for (camera, time_s, image) in &found {
        let n = (time_s * 20.0).round() as u32;
        assert!((f64::from(n) / 20.0 - time_s).abs() < 1e-9 && (camera == "right" || n != 4), "{camera} {time_s}");
        assert_eq!((image.width, image.height), (32, 20));
        let expected: Vec<u8> = (0..20).flat_map(|y| (0..32).map(move |x| level(n, x, y))).collect();
        assert!(image.pixels == expected, "{camera} {time_s}");
    }
    refuses(folder.path(), &["import", "shots", "--rate", "20", "-o", "a.mcap"], &["`a.mcap` cannot be written"]);
    refuses(folder.path(), &["import", "shots/left/000.png", "-o", "b.mcap"], &["is one picture"]);
    refuses(folder.path(), &["import", "nowhere", "-o", "b.mcap"], &["`nowhere` cannot be read"]);
    refuses(folder.path(), &["import", "shots", "shots", "--rate", "9", "-o", "b.mcap"], &["both of a camera `left`"]);
    refuses(folder.path(), &["export", "a.mcap", "--tables", "--out", "t"], &["neither targets nor marks"]);
    assert!(!folder.path().join("b.mcap").exists());
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("skipped: films of a session need ffmpeg on the PATH");
        return;
    }
    must(folder.path(), &["export", "a.mcap", "--video", "--out", "films", "--quiet"]);
    refuses(folder.path(), &["export", "a.mcap", "--video", "--cameras", "up", "--out", "x"], &["no pictures of up"]);
    // The frame of the picture that is missing shows the one before, so that both films are in step.
    let table = fs::read_to_string(folder.path().join("films/room.images.left.image.csv")).unwrap();
    let rows: Vec<&str> = table.lines().skip(1).collect();
    assert_eq!((rows.len(), rows[4], rows[5]), (9, "4,0.150000,1", "5,0.250000,0"));
    fs::remove_file(folder.path().join("films/room.images.left.image.csv")).unwrap();
    fs::remove_file(folder.path().join("films/room.images.right.image.csv")).unwrap();
    must(folder.path(), &["import", "films", "-o", "again.mcap", "--quiet"]);
    let again = images(&folder.path().join("again.mcap"));
    assert_eq!(again.len(), 17);
    for (camera, time_s, image) in &again {
        let n = (time_s * 20.0).round() as u32;
        let n = if camera.contains("left") && n == 4 { 3 } else { n };
        assert!(image.pixels[33] == level(n, 1, 1), "{camera} {time_s}: what was lossless is the same");
    }
}

/// Times of the targets of a session: when they were given out, by their stamp, and by their own word [s].
fn target_times(path: &Path, of: &str) -> Vec<[f64; 3]> {
    let mut session = Session::open(path).unwrap();
    let topic = session.summary.channels.values().find(|it| it.topic == of).unwrap().id;
    let mut found = Vec::new();
    for chunk in 0..session.summary.chunks.len() {
        session
            .messages(chunk, |channel, log_ns, bytes| {
                if channel == topic {
                    let packet = body::decode(&MessageType::of::<Targets>(), bytes)?;
                    let own = packet.as_typed::<Targets>().unwrap().time;
                    found.push([log_ns as f64 * 1e-9, packet.stamp.time.as_s(), own.as_s()]);
                }
                Ok(())
            })
            .unwrap();
    }
    found
}

#[test]
fn sessions_of_two_machines_are_merged_onto_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    let at = |name: &str| folder.path().join(name);
    for (name, more) in [("a", &["--live"][..]), ("b", &["--live"]), ("c", &[])] {
        let file = format!("{name}.mcap");
        let run = ["run", "room.toml", "--duration", "1", "--quiet", "--no-pictures", "--record", &file, "--out", name];
        must(folder.path(), &[&run[..], more].concat());
    }
    let said = must(folder.path(), &["merge", "a.mcap", "b.mcap", "-o", "both.mcap"]);
    assert!(said.contains("/b/room/targets/targets"), "{said}");
    // How far apart they began, from their clocks on the wall.
    let zero = |name: &str| Session::open(&at(name)).unwrap().fact("zero_unix_ns").parse::<i128>().unwrap();
    let apart_s = (zero("b.mcap") - zero("a.mcap")) as f64 * 1e-9;
    assert!(apart_s > 1.0, "{apart_s}");
    let shifted = |from: &str, to: &str, topic: &str, by_s: f64| {
        let (before, after) = (target_times(&at(from), "/room/targets/targets"), target_times(&at(to), topic));
        assert!(before.len() > 20 && before.len() == after.len(), "{} and {}", before.len(), after.len());
        for (before, after) in before.iter().zip(&after) {
            (0..3).for_each(|it| assert!((after[it] - before[it] - by_s).abs() < 1e-6, "{before:?} {after:?} {by_s}"));
        }
    };
    shifted("a.mcap", "both.mcap", "/room/targets/targets", 0.0);
    shifted("b.mcap", "both.mcap", "/b/room/targets/targets", apart_s);
    // A run on a logical clock did not begin at any time.
    refuses(folder.path(), &["merge", "a.mcap", "c.mcap", "-o", "x.mcap"], &["`c.mcap`", "expected its offset"]);
    refuses(folder.path(), &["merge", "a.mcap", "c.mcap", "--offset", "d.mcap=1", "-o", "x.mcap"], &["`--offset d"]);
    must(folder.path(), &["merge", "a.mcap", "c.mcap", "--offset", "c.mcap=-0.25", "-o", "ac.mcap", "--quiet"]);
    shifted("a.mcap", "ac.mcap", "/room/targets/targets", 0.25);
    shifted("c.mcap", "ac.mcap", "/c/room/targets/targets", 0.0);
    refuses(folder.path(), &["replay", "ac.mcap"], &["holds no order of delivery"]);
    let info = must(folder.path(), &["info", "ac.mcap"]);
    assert!(info.contains("of several sessions: a at 0.25 s, c at 0 s"), "{info}");
}

#[test]
fn a_session_calibrates_its_cameras_as_its_rig_does() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["wave.toml", "face_body.calibration.toml", "lab.plan.toml"] {
        fs::copy(root().join("graphs").join(name), folder.path().join(name)).unwrap();
    }
    let run =
        ["run", "wave.toml", "--duration", "1.5", "--quiet", "--no-pictures", "--record", "s.mcap", "--out", "run"];
    must(folder.path(), &run);
    let calibrate = |of: &str, out: &str| {
        let arguments = ["calibrate", of, "--duration", "1.5", "--quiet", "--out", out];
        drop(crate::the_program::foveate(folder.path(), &arguments));
        fs::read_to_string(folder.path().join(out).join("observations.csv")).unwrap()
    };
    let (of_rig, of_session) = (calibrate("wave.toml", "rig"), calibrate("s.mcap", "session"));
    // Pictures that were under way at the end are in one of the two alone.
    let n_same = of_rig.lines().zip(of_session.lines()).take_while(|it| it.0 == it.1).count();
    let n_rows = of_rig.lines().count();
    assert!(n_rows > 400 && n_same + 100 > n_rows, "{n_same} of {n_rows}");
    refuses(
        folder.path(),
        &["calibrate", "s.mcap", "--from", "room.lights"],
        &["`--from room.lights` gave no features"],
    );
    refuses(folder.path(), &["calibrate", "s.mcap", "--write"], &["--write has nothing to replace"]);
    let board = ["calibrate", "s.mcap", "--chessboard", "8x6", "--square-mm", "30"];
    refuses(folder.path(), &board, &["neither pictures nor features"]);
}

#[test]
fn a_session_is_reported_exported_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    let run = ["run", "room.toml", "--duration", "1.5", "--quiet", "--no-pictures", "--seed"];
    must(folder.path(), &[&run[..], &["3", "--out", "a", "--record", "s.mcap"]].concat());
    must(folder.path(), &[&run[..], &["4", "--out", "b"]].concat());
    must(folder.path(), &["report", "s.mcap"]);
    let page = fs::read_to_string(folder.path().join("s.html")).unwrap();
    must(folder.path(), &["report", "s.mcap", "-o", "again.html"]);
    assert!(page == fs::read_to_string(folder.path().join("again.html")).unwrap(), "the same page again");
    assert!(page.contains("foveate replay s.mcap") && page.contains("wide-1") && !page.contains("/tmp/"));

    must(
        folder.path(),
        &["export", "s.mcap", "--tables", "--c3d", "--glb", "--rate", "60", "--out", "files", "--quiet"],
    );
    let table = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let (exported, written) = (table("files/room.targets.csv"), table("a/targets.csv"));
    assert!(written.lines().count() > 100 && exported == written, "what the rig wrote itself");
    assert!(
        folder.path().join("files/room.targets.c3d").is_file()
            && folder.path().join("files/room.targets.glb").is_file()
    );

    let said = must(folder.path(), &["compare", "a", "b", "--json", "c.json"]);
    let all: Value = serde_json::from_str(&table("c.json")).unwrap();
    let rows = all["different"].as_array().unwrap();
    let of = |path: &str, name: &str| -> f64 {
        let summary: Value = serde_json::from_str(&table(&format!("{path}/summary.json"))).unwrap();
        summary[name].as_f64().unwrap()
    };
    let row = rows.iter().find(|it| it["unit"] == "m" || it["unit"] == "mm").unwrap();
    let name = row["figure"].as_str().unwrap();
    assert_eq!(row["difference"].as_f64().unwrap(), of("b", name) - of("a", name));
    assert!(said.contains(name), "{said}");
    let same = must(folder.path(), &["compare", "a", "a/summary.json"]);
    assert!(same.contains("0 differ"), "{same}");
    refuses(folder.path(), &["compare", "a", "nowhere"], &["`nowhere` cannot be read"]);
}

#[test]
fn hidden_parts_of_pictures_are_not_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let rig = new_room(folder.path());
    let with =
        |record: &str| fs::write(folder.path().join("hidden.toml"), format!("{rig}\n[record]\n{record}\n")).unwrap();
    with("hide_px = { \"wide-1\" = [[10, 20, 300, 40]], \"wide-2\" = [[0, 0, 9999, 9999]] }");
    let run = ["run", "hidden.toml", "--duration", "0.3", "--quiet", "--record", "s.mcap", "--out", "run"];
    must(folder.path(), &run);
    let found = images(&folder.path().join("s.mcap"));
    let bright = |it: &Image| -> Vec<usize> { (0..it.pixels.len()).filter(|at| it.pixels[*at] > 0).collect() };
    for (camera, time_s, image) in &found {
        let bright = bright(image);
        let is_hidden = |at: &usize| {
            (10..310).contains(&(at % image.width as usize)) && (20..60).contains(&(at / image.width as usize))
        };
        match camera.as_str() {
            "wide-1" => assert!(!bright.is_empty() && !bright.iter().any(is_hidden), "{time_s}"),
            "wide-2" => assert!(bright.is_empty(), "{time_s}"),
            _ => assert!(bright.iter().any(is_hidden), "{camera} {time_s}"),
        }
    }
    // A replay from these pictures would not be the same.
    let said = must(folder.path(), &["replay", "s.mcap", "--out", "again"]);
    let again = |node: &str| !said.contains(&format!("{node} is not made again"));
    assert!(!again("room.leds[wide-1]") && again("room.leds[wide-3]") && again("room.targets"), "{said}");
    for (record, words) in [
        ("hide_px = { \"tall-*\" = [[0, 0, 1, 1]] }", ["`hide_px` names `tall-*`", "wide-1"]),
        ("hide_scales = [\"face\"]", ["`hide_scales` names `face`", "room"]),
        ("hide_scales = [\"room\"]", ["`hide_scales` names `room`", "`radius_m`"]),
    ] {
        with(record);
        refuses(folder.path(), &["run", "hidden.toml", "--quiet", "--record", "x.mcap", "--out", "x"], &words);
        assert!(!folder.path().join("x.mcap").exists());
    }
}
