//! Sessions as a person makes them: a run recorded, killed, replayed, replayed in part, and used as a camera.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use foveate_node::port::MessageType;
use foveate_pan_tilt::line_traffic::{Direction, LinePiece, LineTraffic};
use foveate_session::source::fact;
use foveate_session::{Session, body};
use serde_json::Value;

use crate::the_program::{foveate, new_room, program, root};

/// What a replay does not make: what the simulated world writes, and how fast the machine was.
const NOT_AGAIN: [&str; 4] = ["session.mcap", "timing.json", "truth.csv", "truth.calibration.toml"];

/// The files of a results folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|it| it.unwrap().path());
    let files = entries.filter(|it| it.is_file()).map(|it| {
        let name = it.file_name().unwrap().to_str().unwrap().to_owned();
        (name, fs::read(&it).unwrap())
    });
    files.filter(|it| !NOT_AGAIN.contains(&it.0.as_str())).collect()
}

fn figure(folder: &Path, name: &str) -> f64 {
    let summary: Value = serde_json::from_slice(&fs::read(folder.join("summary.json")).unwrap()).unwrap();
    summary[name].as_f64().unwrap()
}

#[track_caller]
pub fn must(folder: &Path, arguments: &[&str]) -> String {
    let (code, said, complaint) = foveate(folder, arguments);
    assert_eq!(code, 0, "{arguments:?}\n{said}{complaint}");
    said + &complaint
}

/// `foveate` refuses with exit code 2 and says all of `words`.
#[track_caller]
pub fn refuses(folder: &Path, arguments: &[&str], words: &[&str]) {
    let (code, _, complaint) = foveate(folder, arguments);
    assert_eq!(code, 2, "{complaint}");
    words.iter().for_each(|it| assert!(complaint.contains(it), "`{it}` is not in:\n{complaint}"));
}

#[track_caller]
pub fn same_files(name: &str, a: &Path, b: &Path) {
    let (a, b) = (files(a), files(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{name}");
    for (file, bytes) in &a {
        assert!(bytes == &b[file], "{name}: `{file}` differs");
    }
}

#[test]
fn a_recorded_run_is_replayed_to_the_same_files_from_its_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    for (name, seed, more) in
        [("simulated", "3", &[][..]), ("live", "4", &["--live"]), ("crowded", "5", &["--live", "--workers", "1"])]
    {
        let run = ["run", "room.toml", "--duration", "1.5", "--quiet", "--record", "--out", name, "--seed", seed];
        must(folder.path(), &[&run[..], more].concat());
        // Elsewhere, where neither rig nor calibration is.
        let elsewhere = tempfile::tempdir().unwrap();
        fs::rename(folder.path().join(name).join("session.mcap"), elsewhere.path().join("s.mcap")).unwrap();
        must(elsewhere.path(), &["replay", "s.mcap", "--quiet", "--out", "again"]);
        same_files(name, &folder.path().join(name), &elsewhere.path().join("again"));
        let delivered = figure(&elsewhere.path().join("again"), "messages.delivered");
        assert!(delivered > 200.0, "{name}: {delivered}");
    }
    // A run that is recorded gives what one gives that is not.
    must(folder.path(), &["run", "room.toml", "--duration", "1.5", "--quiet", "--out", "plain", "--seed", "3"]);
    same_files("plain", &folder.path().join("simulated"), &folder.path().join("plain"));
}

/// Line traffic by topic, in the order of the file.
fn line_traffic(path: &Path) -> BTreeMap<String, Vec<LinePiece>> {
    let mut session = Session::open(path).unwrap();
    let of_lines = session.summary.channels.values().filter(|it| fact(it, "message") == "line_traffic");
    let topics: BTreeMap<u16, String> = of_lines.map(|it| (it.id, it.topic.clone())).collect();
    let mut found: BTreeMap<String, Vec<LinePiece>> = BTreeMap::new();
    for chunk in 0..session.summary.chunks.len() {
        session
            .messages(chunk, |channel, _, bytes| {
                let Some(topic) = topics.get(&channel) else { return Ok(()) };
                let packet = body::decode(&MessageType::of::<LineTraffic>(), bytes)?;
                let traffic = packet.as_typed::<LineTraffic>().unwrap();
                assert_eq!(traffic.lost, 0);
                found.entry(topic.clone()).or_default().extend(traffic.pieces.iter().cloned());
                Ok(())
            })
            .unwrap();
    }
    found
}

#[test]
fn a_session_holds_the_bytes_to_heads_and_their_answers_and_is_replayed_as_before() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["pan_tilt_follow.toml", "pan_tilt_follow.calibration.toml", "pan_tilt_follow.plan.toml"] {
        fs::copy(root().join("graphs").join(name), at(name)).unwrap();
    }
    let run = ["run", "pan_tilt_follow.toml", "--duration", "4", "--quiet"];
    must(folder.path(), &[&run[..], &["--record", "s.mcap", "--out", "recorded"]].concat());
    must(folder.path(), &[&run[..], &["--out", "plain"]].concat());
    same_files("plain", &at("recorded"), &at("plain"));

    let traffic = line_traffic(&at("s.mcap"));
    let topics: Vec<&str> = traffic.keys().map(String::as_str).collect();
    let expected = ["head/ptz-1", "head_paper/ptz-paper", "head_still/ptz-still"];
    assert_eq!(topics, expected.map(|it| format!("/close/{it}/line_traffic")));
    for (topic, pieces) in &traffic {
        assert!(pieces.windows(2).all(|it| it[0].time <= it[1].time), "{topic}");
        let count = |direction: Direction, begin: &[u8]| {
            pieces.iter().filter(|it| it.direction == direction && it.bytes.starts_with(begin)).count()
        };
        // Drives and moves, and that they were accepted; inquiries of the position, and their answers.
        let (n_commands, n_accepted) =
            (count(Direction::Sent, &[0x81, 0x01, 0x06]), count(Direction::Received, &[0x90, 0x41]));
        let n_accepted = n_accepted + count(Direction::Received, &[0x90, 0x42]);
        assert!(n_commands > 2 && n_accepted.abs_diff(n_commands) < 5, "{topic}: {n_commands}, {n_accepted} accepted");
        let (n_asked, n_said) =
            (count(Direction::Sent, &[0x81, 0x09, 0x06, 0x12, 0xFF]), count(Direction::Received, &[0x90, 0x50]));
        assert!(n_asked > 20 && n_said.abs_diff(n_asked) < 5, "{topic}: {n_asked} inquiries, {n_said} answers");
    }
    let info = must(folder.path(), &["info", "s.mcap"]);
    assert!(topics.iter().all(|it| info.contains(it)), "{info}");

    // Heads and all that is simulated are not made again: what the others write is the same.
    must(folder.path(), &["replay", "s.mcap", "--quiet", "--out", "again"]);
    let (recorded, again) = (files(&at("recorded")), files(&at("again")));
    assert!(again.contains_key("summary.json"), "{:?}", again.keys());
    for (name, bytes) in &again {
        assert!(recorded.get(name) == Some(bytes), "`{name}` differs");
    }
    must(folder.path(), &["replay", "s.mcap", "--quiet", "--from", "close.pose", "--out", "pose"]);
}

#[test]
fn a_part_of_a_rig_is_replayed_with_other_settings() {
    let folder = tempfile::tempdir().unwrap();
    let rig = new_room(folder.path());
    let run = ["run", "room.toml", "--duration", "2", "--quiet", "--record", "s.mcap", "--out", "run"];
    must(folder.path(), &run);
    refuses(folder.path(), &run, &["`s.mcap` cannot be written"]);
    let replay = |more: &[&'static str]| [&["replay", "s.mcap", "--quiet"][..], more].concat();
    must(folder.path(), &replay(&["--from", "room.targets", "--out", "same"]));
    must(folder.path(), &replay(&["--set", "room.leds.offset=60", "--out", "bright"]));
    let table = |out: &str| fs::read(folder.path().join(out).join("targets.csv")).unwrap();
    assert!(table("same") == table("run"), "the same features in the same order");
    assert!(table("bright") != table("run"), "another threshold finds other centres");
    let resolved = fs::read_to_string(folder.path().join("bright/rig.resolved.toml")).unwrap();
    assert!(resolved.starts_with("# foveate replay s.mcap --set room.leds.offset=60\n"), "{resolved}");
    assert!(resolved.contains("offset = 60") && !resolved.contains("foveate-session-"), "{resolved}");

    // What is damaged is named, and the rest can be kept.
    let mut bytes = fs::read(folder.path().join("s.mcap")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 16;
    fs::write(folder.path().join("bad.mcap"), bytes).unwrap();
    let (code, said, _) = foveate(folder.path(), &["info", "--whole", "bad.mcap"]);
    assert!(code == 2 && said.contains("note: `bad.mcap` is damaged at byte"), "{code} {said}");
    let said = must(folder.path(), &["cut", "bad.mcap", "rest.mcap"]);
    assert!(said.contains("that chunk is left away"), "{said}");
    must(folder.path(), &["info", "--whole", "rest.mcap"]);
    refuses(folder.path(), &["cut", "s.mcap", "none.mcap", "--start", "99"], &["holds nothing of that part"]);
    assert!(!folder.path().join("none.mcap").exists());
    refuses(folder.path(), &replay(&["--from", "room.lab"]), &["`room.lab` is never made again"]);
    refuses(folder.path(), &replay(&["--from", "room.target"]), &["did you mean `room.targets`?"]);
    refuses(folder.path(), &replay(&["--set", "room.leds.offsets=60"]), &["did you mean `offset`?"]);
    refuses(folder.path(), &replay(&["--set", "room.leds"]), &["expected SCALE.NODE.SETTING=VALUE"]);

    // Without pictures a replay begins behind them, and cannot begin at them.
    let run =
        ["run", "room.toml", "--duration", "1", "--quiet", "--record", "n.mcap", "--no-pictures", "--out", "none"];
    must(folder.path(), &run);
    let said = must(folder.path(), &["replay", "n.mcap", "--out", "none-again"]);
    assert!(said.contains("room.leds[wide-1] is not made again"), "{said}");
    same_files("no pictures", &folder.path().join("none"), &folder.path().join("none-again"));
    let from_pixels = ["replay", "n.mcap", "--quiet", "--from", "room.leds"];
    refuses(
        folder.path(),
        &from_pixels,
        &["cannot begin at room.leds[wide-1]", "no messages of room.video[wide-1].image"],
    );

    // A part: the end away, one camera's pictures only; what cannot be is not made again, and the rest is as it was.
    must(folder.path(), &["cut", "s.mcap", "part.mcap", "--end", "1.7", "--without", "/room/video/wide-1/image"]);
    refuses(folder.path(), &["cut", "s.mcap", "x.mcap", "--cameras", "wide-99"], &["no camera `wide-99`", "wide-1"]);
    refuses(folder.path(), &["cut", "s.mcap", "part.mcap"], &["`part.mcap` cannot be written"]);
    let said = must(folder.path(), &["replay", "part.mcap", "--out", "part"]);
    assert!(said.contains("room.leds[wide-1] is not made again") && !said.contains("room.leds[wide-2]"), "{said}");
    let part = table("part");
    // Where it ends, rows wait for messages that are not there.
    let whole = &part[..part.len() * 3 / 4];
    assert!(part.len() > 1000 && table("run").starts_with(whole), "what it holds is the same");
    must(folder.path(), &["cut", "s.mcap", "late.mcap", "--start", "0.7"]);
    refuses(folder.path(), &["replay", "late.mcap"], &["holds no order of delivery"]);
    must(folder.path(), &["replay", "late.mcap", "--quiet", "--from", "room.leds", "--out", "late"]);
    assert!(table("late").len() > 500, "half a second of targets");

    // A session is a camera for any rig.
    let session = "type = \"capture.session\"\neach = \"wide-*\"\npath = \"s.mcap\"\n";
    let camera = "type = \"sim.camera\"\neach = \"wide-*\"\nin = { world = \"lab.world\" }\n";
    assert!(rig.contains(camera));
    let start = rig.find("[scale.room.node.pictures]").unwrap();
    let rig = rig[..start].replace(camera, session).replace("[scale.room.node.lab]\ntype = \"sim.lab\"\n", "");
    fs::write(folder.path().join("other.toml"), rig).unwrap();
    must(folder.path(), &["run", "other.toml", "--quiet", "--out", "other"]);
    let rows = |out: &str| table(out).iter().filter(|it| **it == b'\n').count();
    assert!(rows("run") > 200 && rows("other").abs_diff(rows("run")) < 20, "{} and {}", rows("run"), rows("other"));
    let without = fs::read_to_string(folder.path().join("other.toml")).unwrap().replace("s.mcap", "n.mcap");
    fs::write(folder.path().join("without.toml"), without).unwrap();
    let words = ["n.mcap` has no pictures of wide-1, wide-2, wide-3", "`foveate info "];
    refuses(folder.path(), &["check", "without.toml"], &words);
    let named = "path = \"s.mcap\"\nimages = \"/room/leds/{camera}/features\"\n";
    let wrong = fs::read_to_string(folder.path().join("other.toml")).unwrap().replace("path = \"s.mcap\"\n", named);
    fs::write(folder.path().join("wrong.toml"), wrong).unwrap();
    refuses(
        folder.path(),
        &["check", "wrong.toml"],
        &["expected a topic of camera `wide-1`: /room/video/wide-1/image"],
    );
}

#[test]
fn a_recording_that_is_killed_opens_is_mended_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    for millis in [700, 2500] {
        let name = format!("killed-{millis}");
        let path = folder.path().join(format!("{name}.mcap"));
        let arguments = ["run", "room.toml", "--live", "--duration", "1000", "--quiet", "--record"];
        let mut child = Command::new(program())
            .args(arguments)
            .args([path.to_str().unwrap(), "--out", &name])
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        // Until it has recorded something.
        while fs::metadata(&path).map_or(0, |it| it.len()) < 2_000_000 {
            assert!(begun.elapsed() < Duration::from_secs(60), "it has not begun");
            std::thread::sleep(Duration::from_millis(20));
        }
        let while_recording = must(folder.path(), &["info", path.to_str().unwrap()]);
        assert!(while_recording.contains("still being recorded"), "{while_recording}");
        std::thread::sleep(Duration::from_millis(millis));
        child.kill().unwrap();
        child.wait().unwrap();
        let first = must(folder.path(), &["info", path.to_str().unwrap()]);
        assert!(first.contains("did not end in good order") && first.contains("its summary was written"), "{first}");
        let second = must(folder.path(), &["info", path.to_str().unwrap()]);
        assert!(!second.contains("its summary"), "{second}");
        let out = format!("{name}-again");
        must(folder.path(), &["replay", path.to_str().unwrap(), "--quiet", "--out", &out]);
        let last = figure(&folder.path().join(out), "session_s");
        assert!(last * 1e3 > millis as f64 - 1500.0, "replayed to {last} s, killed after more than {millis} ms");
    }
}

#[test]
fn what_is_no_session_is_refused_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    fs::write(folder.path().join("empty.mcap"), b"").unwrap();
    for command in ["info", "replay"] {
        refuses(folder.path(), &[command, "empty.mcap"], &["`empty.mcap` is empty"]);
        refuses(folder.path(), &[command, "room.toml"], &["`room.toml` is no MCAP file"]);
        refuses(folder.path(), &[command, "."], &["`.` is no file"]);
        refuses(folder.path(), &[command, "nowhere.mcap"], &["`nowhere.mcap` cannot be read"]);
    }
    let wrong = ["run", "room.toml", "--record", "s.txt"];
    refuses(folder.path(), &wrong, &["expected a file `….mcap`"]);
}
