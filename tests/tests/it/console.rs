//! The console of a run, as a page talks to it.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

use crate::sessions::{must, same_files};
use crate::the_program::{new_room, program};

const PATIENCE: Duration = Duration::from_secs(60);

/// A program that shows a console; it is killed with this.
pub struct Shown {
    child: Child,
    /// Of the page.
    pub address: String,
}

impl Shown {
    /// `foveate` with these arguments, in `folder`.
    pub fn start(folder: &Path, arguments: &[&str]) -> Shown {
        let mut command = Command::new(program());
        let mut child =
            command.args(arguments).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        let address = lines.find_map(|it| it.strip_prefix("console: ").map(str::to_owned)).expect("no console");
        // Read to its end, so that the program never waits for a full pipe.
        std::thread::spawn(move || lines.for_each(drop));
        Shown { child, address }
    }

    /// Waits until the program ends by itself.
    pub fn end(&mut self) {
        let until = Instant::now() + PATIENCE;
        while self.child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < until, "the program does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// A window of the page without a browser.
struct Window {
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    hello: Value,
    n: i64,
}

/// What comes over the socket.
enum Came {
    Text(Value),
    Frame(Frame),
}

struct Frame {
    topic: u32,
    kind: u32,
    time_s: f64,
    header: Value,
    payload: Vec<u8>,
}

impl Window {
    fn open(address: &str) -> Window {
        let socket = address.replace("http://", "ws://") + "socket";
        let (socket, _) = tungstenite::connect(socket).unwrap();
        let mut window = Window { socket, hello: Value::Null, n: 0 };
        window.hello = window.text("hello");
        window
    }

    fn next(&mut self) -> Came {
        loop {
            match self.socket.read().unwrap() {
                Message::Text(text) => return Came::Text(serde_json::from_str(&text).unwrap()),
                Message::Binary(bytes) => {
                    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
                    let time_s = f64::from_le_bytes(bytes[8..16].try_into().unwrap());
                    let end = 32 + word(28) as usize;
                    let header = serde_json::from_slice(&bytes[32..end]).unwrap();
                    let payload = bytes[end..].to_vec();
                    return Came::Frame(Frame { topic: word(0), kind: word(4), time_s, header, payload });
                }
                _ => {}
            }
        }
    }

    /// The next text of that kind.
    fn text(&mut self, say: &str) -> Value {
        self.until(|it| match it {
            Came::Text(text) if text["say"] == say => Some(text),
            _ => None,
        })
    }

    fn until<T>(&mut self, mut found: impl FnMut(Came) -> Option<T>) -> T {
        let until = Instant::now() + PATIENCE;
        loop {
            assert!(Instant::now() < until, "it does not come");
            if let Some(it) = found(self.next()) {
                return it;
            }
        }
    }

    fn say(&mut self, command: Value) {
        self.socket.send(Message::text(command.to_string())).unwrap();
    }

    /// Gives a command; its answer.
    fn ask(&mut self, mut command: Value) -> (bool, String) {
        self.n += 1;
        command["n"] = json!(self.n);
        let n = self.n;
        self.say(command);
        let answer = self.until(|it| match it {
            Came::Text(text) if text["say"] == "answer" && text["n"] == n => Some(text),
            _ => None,
        });
        (answer["ok"] == true, answer["words"].as_str().unwrap().to_owned())
    }

    fn node(&self, name: &str) -> usize {
        self.hello["nodes"].as_array().unwrap().iter().position(|it| it["name"] == name).unwrap()
    }

    fn topic(&self, path: &str) -> usize {
        self.hello["topics"].as_array().unwrap().iter().position(|it| it["path"] == path).unwrap()
    }

    /// The next state whose session time is `now_s` or later.
    fn state_at(&mut self, now_s: f64) -> Value {
        self.until(|it| match it {
            Came::Text(text) if text["say"] == "state" && text["now_s"].as_f64().is_some_and(|it| it >= now_s) => {
                Some(text)
            }
            _ => None,
        })
    }
}

#[test]
fn settings_that_change_in_a_run_are_saved_and_replayed_to_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let rig = new_room(folder.path());
    assert!(rig.contains("offset = ") && rig.contains('#'), "the rig has a threshold and comments");
    for (name, more) in [("simulated", &[][..]), ("live", &["--live"])] {
        fs::write(folder.path().join("room.toml"), &rig).unwrap();
        let session = format!("{name}.mcap");
        let run =
            ["run", "room.toml", "--console", "--listen", "0", "--duration", "10", "--out", name, "--record", &session];
        let mut shown = Shown::start(folder.path(), &[&run[..], more].concat());
        let mut window = Window::open(&shown.address);
        let leds = window.node("room.leds");
        window.state_at(0.5);
        let masks = json!({ "wide-2": [[[0.0, 0.0], [320.0, 0.0], [320.0, 480.0], [0.0, 480.0]]] });
        let set = |values: Value| json!({ "do": "set", "node": leds, "values": values });
        assert_eq!(
            window.ask(set(json!({ "offset": 60, "camera_masks": masks }))),
            (true, "changed".to_owned()),
            "{name}"
        );
        // What cannot be says why, and changes nothing.
        for (values, words) in [
            (json!({ "offset": 300 }), "u8"),
            (json!({ "learn_frames": 5 }), "fixed"),
            (json!({ "no_such": 5 }), "no setting"),
            (json!({ "max_area_px": 1 }), "found 1"),
            (json!({ "masks": [[[0.0, 0.0]]] }), "found 1 corners"),
            (json!({ "camera_masks": { "wide-99": [[[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]]] } }), "`wide-99`"),
        ] {
            let (is_ok, said) = window.ask(set(values.clone()));
            assert!(!is_ok && said.contains(words), "{values}: {said}");
        }
        // Another window learns it, too.
        let mut other = Window::open(&shown.address);
        assert_eq!(other.text("settings")["values"]["offset"], 60);
        let unsaved = window.state_at(0.6)["unsaved"].clone();
        assert_eq!(unsaved, json!(["room.leds.camera_masks", "room.leds.offset"]));
        let (is_ok, said) = window.ask(json!({ "do": "save" }));
        assert!(is_ok && said == "saved 2 settings to room.toml", "{said}");
        // Later ones are not lost by a run that ends.
        assert!(window.ask(set(json!({ "offset": 45 }))).0);
        shown.end();

        let saved = fs::read_to_string(folder.path().join("room.toml")).unwrap();
        assert!(
            saved.contains("offset = 60") && saved.contains("camera_masks = { wide-2 = [[[0.0, 0.0], [320.0, 0.0]"),
            "{saved}"
        );
        let others = |text: &str| -> Vec<String> {
            text.lines()
                .filter(|it| !it.starts_with("offset") && !it.starts_with("camera_masks"))
                .map(str::to_owned)
                .collect()
        };
        assert_eq!(others(&saved), others(&rig), "comments and order stay");
        must(folder.path(), &["check", "room.toml"]);

        let again = format!("{name}-again");
        must(folder.path(), &["replay", &session, "--quiet", "--out", &again]);
        same_files(name, &folder.path().join(name), &folder.path().join(&again));
    }
    // The change has changed something.
    fs::write(folder.path().join("room.toml"), &rig).unwrap();
    must(folder.path(), &["run", "room.toml", "--duration", "10", "--quiet", "--out", "plain"]);
    let table = |out: &str| fs::read(folder.path().join(out).join("targets.csv")).unwrap();
    assert!(table("plain") != table("simulated"));
}

#[test]
fn a_simulated_run_waits_steps_and_goes_on_and_viewers_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    let run = ["run", "room.toml", "--console", "--listen", "0", "--duration", "6", "--out", "shown"];
    let mut shown = Shown::start(folder.path(), &run);
    let mut window = Window::open(&shown.address);
    assert_eq!(window.hello["rig"]["mode"], "simulated");
    window.state_at(0.3);
    let go = |what: &str| json!({ "do": what });
    assert!(window.ask(go("pause")).0);
    let paused = window.until(|it| match it {
        Came::Text(text) if text["phase"] == "paused" => Some(text),
        _ => None,
    });
    // Pictures and what was found in them, of one moment.
    let (image, features) = (window.topic("room.video[wide-1].image"), window.topic("room.leds[wide-1].features"));
    window.say(json!({ "do": "subscribe", "topics": [
        { "topic": image, "as": "picture", "width": 200, "hz": 30 }, { "topic": features, "as": "value", "hz": 30 },
    ] }));
    assert!(window.ask(go("step")).0 && window.ask(go("step")).0 && window.ask(go("step")).0);
    let mut seen = [None, None];
    while seen.iter().any(Option::is_none) {
        let frame = window.until(|it| if let Came::Frame(frame) = it { Some(frame) } else { None });
        let place = usize::from(frame.topic as usize == features);
        assert_eq!(frame.kind, [2, 1][place]);
        seen[place] = Some(frame);
    }
    let [Some(picture), Some(found)] = seen else { unreachable!() };
    let size = [&picture.header["width"], &picture.header["height"]].map(|it| it.as_u64().unwrap() as usize);
    assert!(size[0] <= 200 && picture.payload.len() == size[0] * size[1], "{size:?}");
    assert!(found.header["list"].is_array() && found.header["camera"].is_number());
    assert!(picture.time_s < paused["now_s"].as_f64().unwrap() + 1.0, "it waits");
    assert!(!window.ask(json!({ "do": "seek", "to_s": 0.0 })).0, "a run only goes forwards");
    assert!(window.ask(go("go")).0);
    // A second window that never reads holds nothing up.
    let _stalled = Window::open(&shown.address);
    shown.end();
    must(folder.path(), &["run", "room.toml", "--duration", "6", "--quiet", "--out", "plain"]);
    same_files("shown", &folder.path().join("plain"), &folder.path().join("shown"));
}

#[test]
fn a_session_is_looked_at_forwards_and_backwards() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    must(folder.path(), &["run", "room.toml", "--duration", "2", "--quiet", "--record", "s.mcap", "--out", "run"]);
    let shown = Shown::start(folder.path(), &["view", "s.mcap", "--listen", "0"]);
    let mut window = Window::open(&shown.address);
    assert_eq!(window.hello["rig"]["mode"], "session");
    let targets = window.topic("room.targets.targets");
    window.say(json!({ "do": "subscribe", "topics": [{ "topic": targets, "as": "value", "hz": 60 }] }));
    assert!(window.ask(json!({ "do": "pause" })).0);
    let mut at = |to_s: f64| {
        assert!(window.ask(json!({ "do": "seek", "to_s": to_s })).0);
        window.until(|it| match it {
            Came::Frame(frame) if (frame.time_s - to_s).abs() < 0.06 => Some(frame.header["list"].clone()),
            _ => None,
        })
    };
    let (late, early, again) = (at(1.9), at(1.0), at(1.9));
    assert!(late != early && late == again && late.as_array().unwrap().len() > 3);
    // A picture on, and back.
    let now = |window: &mut Window| window.text("state")["now_s"].as_f64().unwrap();
    let step = |window: &mut Window, by: i32| {
        assert!(window.ask(json!({ "do": "step", "by": by })).0);
        now(window);
        now(window)
    };
    let first = now(&mut window);
    let (on, back) = (step(&mut window, 1), step(&mut window, -1));
    assert!(on > first && on < first + 0.03 && back <= first && back > first - 0.03, "{first} {on} {back}");
    // A part again and again, at twice the speed.
    assert!(!window.ask(json!({ "do": "loop", "from_s": 1.0, "to_s": 1.0 })).0);
    assert!(window.ask(json!({ "do": "loop", "from_s": 0.5, "to_s": 0.9 })).0);
    assert!(window.ask(json!({ "do": "speed", "factor": 2.0 })).0 && window.ask(json!({ "do": "go" })).0);
    let times: Vec<f64> = (0..8).map(|_| now(&mut window)).skip(1).collect();
    assert!(times.iter().all(|it| (0.5..0.9).contains(it)), "{times:?}");
    assert!(times.windows(2).any(|it| it[1] < it[0]), "{times:?}");
    let refused = window.ask(json!({ "do": "set", "node": 0, "values": { "offset": 1 } }));
    assert!(!refused.0 && refused.1.contains("replay --set"), "{}", refused.1);
}

/// So many pictures of two cameras: two dots that move by `step` px a picture on a pattern that moves with them; and a rig that tracks them.
pub fn dots(folder: &Path, n: u32, step: f64) {
    let wave = |x: f64, y: f64, a: f64, b: f64| (x * a + y * b).sin();
    for camera in ["left", "right"] {
        let shots = folder.join("shots").join(camera);
        fs::create_dir_all(&shots).unwrap();
        for number in 0..n {
            let shift = step * f64::from(number);
            let picture = image::GrayImage::from_fn(200, 120, |column, row| {
                let (x, y) = (f64::from(column) - shift, f64::from(row));
                let is_dot = |u: f64| (x - u).hypot(y - 50.0) < 3.2;
                let ground = wave(x, y, 0.13, 0.2) + wave(x, y, 0.31, -0.17) + wave(x, y, 0.07, 0.41);
                image::Luma([if is_dot(40.0) || is_dot(70.0) { 40 } else { (170.0 + 20.0 * ground) as u8 }])
            });
            picture.save(shots.join(format!("{number:03}.png"))).unwrap();
        }
    }
    let camera = |name: &str| {
        format!(
            "[camera.{name}]\nimage_size_px = [200, 120]\nfocal_px = [200.0, 200.0]\nprincipal_point_px = [99.5, 59.5]\n\
             position_m = [0.0, 0.0, 0.0]\ncamera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]\n\n"
        )
    };
    let calibration = "[calibration]\nlength_unit = \"m\"\n\n".to_owned() + &camera("left") + &camera("right");
    fs::write(folder.join("dots.calibration.toml"), calibration).unwrap();
    let rig = "[rig]\nname = \"dots\"\ncalibration = \"dots.calibration.toml\"\n\n[scale.face.node.video]\ntype = \"capture.images\"\neach = \"*\"\n\
               path = \"shots/{camera}/*.png\"\nrate_hz = 20\n\n[scale.face.node.marks]\ntype = \"painted_mark.tracker\"\neach = \"*\"\nin = { image = \"video.image\" }\n\n\
               [scale.face.node.table]\ntype = \"export.features\"\nin = { features = \"marks.features\" }\n";
    fs::write(folder.join("dots.toml"), rig).unwrap();
}

#[test]
fn marks_of_a_session_are_corrected_by_hand_and_tracked_again() {
    let folder = tempfile::tempdir().unwrap();
    dots(folder.path(), 20, 2.0);
    must(folder.path(), &["run", "dots.toml", "--quiet", "--record", "s.mcap", "--out", "run"]);
    let shown = Shown::start(folder.path(), &["view", "s.mcap", "--listen", "0"]);
    let mut window = Window::open(&shown.address);
    assert_eq!(window.hello["rig"]["can"]["correct"], true);
    let (node, topic) = (window.node("face.marks"), window.topic("face.marks[right].features"));
    let right = window.hello["cameras"].as_array().unwrap().iter().position(|it| it["name"] == "right").unwrap();
    window.say(json!({ "do": "subscribe", "topics": [{ "topic": topic, "as": "value", "hz": 60 }] }));
    assert!(window.ask(json!({ "do": "pause" })).0);
    // By label: the columns of the marks at a time, without the common motion.
    let at = |window: &mut Window, to_s: f64| -> Vec<(u64, i64)> {
        assert!(window.ask(json!({ "do": "seek", "to_s": to_s + 0.001 })).0);
        let list = window.until(|it| match it {
            Came::Frame(frame) if (frame.time_s - to_s).abs() < 0.01 => Some(frame.header["list"].clone()),
            _ => None,
        });
        let column = |it: &Value| (it["centre"][0].as_f64().unwrap() - 2.0 * 20.0 * to_s).round() as i64;
        list.as_array().unwrap().iter().filter_map(|it| Some((it["label"].as_u64()?, column(it)))).collect()
    };
    assert!(at(&mut window, 0.5).is_empty(), "without a guide no dot has a name");
    // One dot is mark 7 from picture 4 on, the other one mark 8 from 6 to 11, with the first place a little off.
    let row = |mark: u32, frame: u32, place: Value| {
        let (u, v) = (place[0].clone(), place[1].clone());
        json!({ "camera": right, "mark": mark, "frame": frame, "u": u, "v": v })
    };
    let rows = json!([row(7, 4, json!([48.8, 49.6])), row(8, 6, json!([82.0, 50.0])), row(8, 12, json!([null, null]))]);
    let (is_ok, said) = window.ask(json!({ "do": "correct", "node": node, "rows": rows }));
    assert!(is_ok && said.ends_with("s.corrections.csv"), "{said}");
    let refused =
        window.ask(json!({ "do": "correct", "node": node, "rows": [{ "camera": 9, "mark": 1, "frame": 0 }] }));
    assert!(!refused.0 && refused.1.contains("camera 9"), "{}", refused.1);
    assert!(window.ask(json!({ "do": "again" })).0);
    let sheet = window.until(|it| match it {
        Came::Text(it) if it["name"] == "marks" && it["value"]["again"]["state"] != "running" => {
            Some(it["value"].clone())
        }
        _ => None,
    });
    assert_eq!(sheet["again"], json!({ "state": "done", "words": "tracked again with 3 rows" }), "{sheet}");
    assert_eq!(sheet["rows"].as_array().unwrap().len(), 3);
    assert_eq!(at(&mut window, 0.3), [(7, 40), (8, 70)]);
    assert_eq!(at(&mut window, 0.7), [(7, 40)]);
    assert!(at(&mut window, 0.1).is_empty());
    // Where the tracker lost a mark is found.
    assert!(window.ask(json!({ "do": "problems", "node": node })).0);
    let problems = window.until(|it| match it {
        Came::Text(it) if it["name"] == "marks" && it["value"]["searching"] == false && it["value"]["node"] == node => {
            Some(it["value"]["problems"].clone())
        }
        _ => None,
    });
    assert_eq!(problems.as_array().unwrap().len(), 1, "{problems}");
    let (kind, mark, frame) = (&problems[0]["kind"], &problems[0]["mark"], &problems[0]["frame"]);
    assert_eq!((kind, mark, frame), (&json!("gap"), &json!(8), &json!(12)), "{problems}");

    // The file is what a rig and a replay read: the same marks.
    drop(window);
    drop(shown);
    let text = fs::read_to_string(folder.path().join("s.corrections.csv")).unwrap();
    assert_eq!(text, "camera,mark,frame,u_px,v_px\nright,7,4,48.8,49.6\nright,8,6,82,50\nright,8,12,,\n");
    let file = folder.path().join("s.corrections.csv");
    let set = format!("face.marks.marks={}", file.display());
    must(folder.path(), &["replay", "s.mcap", "--quiet", "--set", &set, "--out", "again"]);
    let table = fs::read_to_string(folder.path().join("again/features.csv")).unwrap();
    assert!(table.lines().filter(|it| it.contains(",7")).count() >= 16, "{table}");
}

#[test]
fn marks_of_a_run_are_corrected_at_once() {
    let folder = tempfile::tempdir().unwrap();
    dots(folder.path(), 300, 0.3);
    let run = ["run", "dots.toml", "--console", "--listen", "0", "--record", "s.mcap", "--out", "run"];
    let mut shown = Shown::start(folder.path(), &run);
    let mut window = Window::open(&shown.address);
    let (node, topic) = (window.node("face.marks"), window.topic("face.marks[left].features"));
    window.say(json!({ "do": "subscribe", "topics": [{ "topic": topic, "as": "value", "hz": 60 }] }));
    assert!(window.ask(json!({ "do": "pause" })).0);
    let frames = |window: &mut Window, is: &dyn Fn(&Value) -> bool| loop {
        assert!(window.ask(json!({ "do": "step" })).0);
        let found = window.until(|it| match it {
            Came::Frame(frame) => Some(Some((frame.time_s, frame.header["list"].clone()))),
            Came::Text(it) if it["say"] == "state" => Some(None),
            Came::Text(_) => None,
        });
        if let Some((time_s, list)) = found.filter(|it| is(&it.1)) {
            return (time_s, list);
        }
    };
    let dot = |it: &Value| {
        let mut all = it.as_array().unwrap().iter();
        all.find(|it| (it["centre"][1].as_f64().unwrap() - 50.0).abs() < 0.5).map(|it| it["centre"].clone())
    };
    let (time_s, list) = frames(&mut window, &|it| dot(it).is_some());
    let place = dot(&list).unwrap();
    let frame = (time_s * 20.0).round() as u64;
    let left = window.hello["topics"][topic]["camera"].clone();
    let row = json!({ "camera": left, "mark": 5, "frame": frame, "u": place[0], "v": place[1] });
    assert_eq!(window.ask(json!({ "do": "correct", "node": node, "rows": [row] })), (true, "changed".to_owned()));
    let (later_s, list) = frames(&mut window, &|it| it[0]["label"] == 5);
    let moved = list[0]["centre"][0].as_f64().unwrap() - place[0].as_f64().unwrap();
    assert!((moved - 6.0 * (later_s - time_s)).abs() < 0.3, "{moved} px in {} s", later_s - time_s);
    assert!(window.ask(json!({ "do": "go" })).0);
    shown.end();
    assert!(folder.path().join("run/corrections.csv").exists());
    must(folder.path(), &["replay", "s.mcap", "--quiet", "--out", "again"]);
    same_features(&folder.path().join("run"), &folder.path().join("again"));
}

#[track_caller]
fn same_features(a: &Path, b: &Path) {
    let table = |it: &Path| fs::read_to_string(it.join("features.csv")).unwrap();
    assert!(table(a) == table(b) && table(a).contains(",5"));
}

#[test]
fn a_part_of_a_run_is_recorded_when_people_want_it() {
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    for (name, more) in [("simulated", &[][..]), ("live", &["--live"])] {
        let run = ["run", "room.toml", "--console", "--listen", "0", "--duration", "600", "--out", name];
        let mut shown = Shown::start(folder.path(), &[&run[..], more].concat());
        let mut window = Window::open(&shown.address);
        window.state_at(1.2);
        assert!(!window.ask(json!({ "do": "record", "on": false })).0);
        let mut files = Vec::new();
        for part in 0..2 {
            let (is_ok, said) = window.ask(json!({ "do": "record" }));
            assert!(is_ok && said.starts_with("recording to "), "{said}");
            let state = window.text("state");
            files.push(state["recording"]["path"].as_str().unwrap().to_owned());
            window.state_at(state["now_s"].as_f64().unwrap() + 0.7);
            assert!(!window.ask(json!({ "do": "record" })).0);
            if part == 0 {
                let (is_ok, said) = window.ask(json!({ "do": "record", "on": false }));
                assert!(is_ok && said.starts_with("recorded "), "{said}");
            }
        }
        // The second one ends with the run.
        assert!(window.ask(json!({ "do": "stop" })).0);
        shown.end();
        assert_eq!(files, [format!("{name}/session.mcap"), format!("{name}/session-2.mcap")]);
        for file in &files {
            let info = must(folder.path(), &["info", "--whole", file]);
            assert!(info.contains("a part, from ") && !info.contains("damaged"), "{info}");
            // A busy machine may not have come to every camera of a live run.
            if name == "live" {
                continue;
            }
            let out = file.replace('/', "-");
            must(folder.path(), &["replay", file, "--from", "room.targets", "--quiet", "--out", &out]);
            let table = fs::read_to_string(folder.path().join(&out).join("targets.csv")).unwrap();
            assert!(table.lines().count() > 2, "{file}: {}", table.lines().count());
        }
    }
}
