//! Every kind of fault: where it is pointed at, and what is said of it.

use foveate_rig::{Diagnostic, Diagnostics, Severity};

use crate::accepted::LAB;
use crate::parts::{bad, good};

/// The laboratory with one piece of its text replaced.
#[track_caller]
pub fn edited(from: &str, to: &str) -> String {
    assert_eq!(LAB.matches(from).count(), 1, "`{from}` must stand in the rig once");
    LAB.replacen(from, to, 1)
}

/// All that is said of a fault, in one line.
pub fn said(fault: &Diagnostic) -> String {
    let others: Vec<&str> = fault.others.iter().map(|it| it.1.as_str()).collect();
    format!("{} | {} | {} | {}", fault.title, fault.label, fault.help.as_deref().unwrap_or(""), others.join(", "))
}

#[track_caller]
pub fn expect(faults: &Diagnostics, index: usize, place: &str, underlined: &str, fragments: &[&str]) {
    let fault = &faults.list[index];
    let (line, column) = fault.line_column();
    assert_eq!(format!("{line}:{column}"), place, "{faults}");
    assert_eq!(&faults.text[fault.span.clone()], underlined, "{faults}");
    for fragment in fragments {
        assert!(said(fault).contains(fragment), "`{fragment}` in\n{}\n{faults}", said(fault));
    }
    assert!(faults.render(false).contains(&format!("lab.toml:{line}:{column}")), "{faults}");
}

/// The edit gives one fault, at `place` (line:column), which underlines `underlined` and says all `fragments`.
#[track_caller]
pub fn one(from: &str, to: &str, place: &str, underlined: &str, fragments: &[&str]) {
    let faults = bad(&edited(from, to));
    assert_eq!(faults.list.len(), 1, "{faults}");
    expect(&faults, 0, place, underlined, fragments);
}

/// A whole rig with one fault.
#[track_caller]
pub fn whole(text: &str, place: &str, underlined: &str, fragments: &[&str]) {
    let faults = bad(text);
    assert_eq!(faults.list.len(), 1, "{faults}");
    expect(&faults, 0, place, underlined, fragments);
}

/// Replaces the detector's only setting, on line 16.
#[track_caller]
fn setting(to: &str, column: usize, underlined: &str, fragments: &[&str]) {
    one("offset = 25", to, &format!("16:{column}"), underlined, fragments);
}

/// Replaces what the integrator is connected to, on line 20.
#[track_caller]
fn features(to: &str, column: usize, underlined: &str, fragments: &[&str]) {
    let to = format!("in = {to}");
    one("in = { features = \"leds.features\" }", &to, &format!("20:{column}"), underlined, fragments);
}

#[test]
fn unknown_type_setting_and_key_say_what_was_probably_meant() {
    let said = ["unknown node type `test.detectr`", "did you mean `test.detector`?"];
    one("test.detector", "test.detectr", "13:8", "\"test.detectr\"", &said);
    one("test.detector", "detector", "13:8", "\"detector\"", &["did you mean `test.detector`?"]);
    one("test.detector", "x", "13:8", "\"x\"", &["the types: `test.aim`, "]);
    setting("ofset = 25", 1, "ofset", &["`test.detector` has no setting `ofset`", "did you mean `offset`?"]);
    setting("window.colour = 3", 8, "colour", &["`window` has no setting", "its settings: `size_px` and `corners`"]);
    one("volume_m", "volume", "6:1", "volume", &["unknown key `volume` in `[scale.room]`", "did you mean `volume_m`?"]);
    one("radius_m", "rig", "30:1", "rig", &["`[scale.face]`", "keys that may stand here: `volume_m`, "]);
}

/// The lab with a scale in the face, and beside the room a world of its own.
fn nested(user: &str) -> String {
    format!(
        "{LAB}\n[scale.face.node.region]\ntype = \"test.region\"\nin = {{ targets = \"room.targets.targets\" }}\n\
         [scale.eye]\nparent = \"face\"\nradius_m = 0.02\n\
         [scale.hall]\n{user}"
    )
}

#[test]
fn coordinates_of_one_space_are_not_taken_for_those_of_another_at_any_depth() {
    let user = |scale: &str, port: &str| {
        nested(&format!(
            "[scale.{scale}.node.user]\ntype = \"test.region_user\"\nin = {{ {port} = \"face.region.{port}\" }}\n"
        ))
    };
    // A region of the face lies in the room: nodes of the face know that, those of the eye would take it as in the face.
    let taken = |text: &str| crate::parts::load(text).map_or_else(|found| found.to_string(), |_| String::new());
    let told = taken(&user("face", "region"));
    assert!(!told.contains("takes it as in"), "{told}");
    for (scale, wanted) in [("eye", "scale `face`"), ("room", "no scale"), ("hall", "no scale")] {
        let told = taken(&user(scale, "region"));
        assert!(told.contains(&format!("found m in scale `room`, expected m in {wanted}")), "{scale}: {told}");
    }
    // Marks say where they are in the outermost scale: that is the same one for the eye and the face, and another one for the hall.
    for scale in ["face", "eye", "room"] {
        let told = taken(&user(scale, "marks"));
        assert!(!told.contains("takes it as in"), "{scale}: {told}");
    }
    let told = taken(&user("hall", "marks"));
    assert!(told.contains("found m in scale `room`, expected m in scale `hall`"), "{told}");
    assert!(told.contains("a `marks` holds m in the outermost scale"), "{told}");
}

#[test]
fn misspelt_keys_of_nodes_are_told_from_settings() {
    setting("cost_mss = 2", 1, "cost_mss", &["did you mean `cost_ms`?"]);
    setting("cost_jiter_ms = 2", 1, "cost_jiter_ms", &["did you mean `cost_jitter_ms`?"]);
}

#[test]
fn setting_out_of_range_names_the_range_and_the_unit() {
    setting(
        "offset = 300",
        10,
        "300",
        &["`offset` is out of range", "found 300, expected a number from 1 to 255 [gray level]"],
    );
    setting("offset = nan", 10, "nan", &["found nan"]);
    setting("max_area = -1", 12, "-1", &["expected a whole number, at least 0 [px²]", "Largest spot"]);
    setting("max_area = 1.5", 12, "1.5", &["found 1.5, expected a whole number"]);
    setting("max_area = 4_294_967_296", 12, "4_294_967_296", &["found 4294967296"]);
    setting(
        "max_area = 99999999999999999999999999999999999999999",
        12,
        "99999999999999999999999999999999999999999",
        &[],
    );
    setting(
        "window.size_px = 0",
        18,
        "0",
        &["`window.size_px`", "found 0, expected a whole number from 1 to 640 [px]"],
    );
}

#[test]
fn setting_of_another_kind_says_what_is_there() {
    setting("offset = \"25\"", 10, "\"25\"", &["found the text `25`, expected a number from 1 to 255 [gray level]"]);
    setting("relearn = false", 11, "false", &["found false, expected a number [fraction]"]);
    setting("window = [1]", 10, "[1]", &["found a list, expected a table"]);
    setting(
        "window.corners = [[1, 2], [3]]",
        27,
        "[3]",
        &["`window.corners.1` has 1 item", "expected a list of 2 items"],
    );
    setting("window.corners = [[1, \"x\"]]", 23, "\"x\"", &["`window.corners.0.1`", "expected a number"]);
    setting(
        "centre = \"weigthed\"",
        10,
        "\"weigthed\"",
        &["expected \"weighted\" or \"middle\"", "did you mean \"weighted\"?"],
    );
    setting("centre = 1979-05-27", 10, "1979-05-27", &["found the date 1979-05-27"]);
    setting(
        "mask = { kind = \"circel\" }",
        17,
        "\"circel\"",
        &["`mask.kind`", "did you mean \"circle\"?", "\"open\" or"],
    );
    setting(
        "mask = { kind = \"circle\" }",
        8,
        "{ kind = \"circle\" }",
        &["`mask` lacks the setting `radius_px`", "a number [px]"],
    );
    setting("mask = { radius_px = 2 }", 8, "{ radius_px = 2 }", &["`mask.kind` is left out"]);
    setting("mask = \"circle\"", 8, "\"circle\"", &["expected a table"]);
}

#[test]
fn setting_without_a_default_must_be_there() {
    let said =
        ["`test.aim` lacks the setting `latency_ms`", "expected `latency_ms` here: a number from 0 to 2000 [ms]"];
    one("latency_ms = 300", "", "32:1", "[scale.face.node.aim]", &said);
}

#[test]
fn what_a_node_refuses_is_pointed_at() {
    setting("min_area = 500", 12, "500", &["`leds` cannot work with this `min_area`", "found 500, expected 1 to 400"]);
    // The limit is too low, but the node complains of the other setting, which is left out.
    let said = [
        "`leds` cannot work with this `min_area`",
        "found 1, and other settings leave no value: expected at least 1 and at most 0 (`min_area` is left out: its default)",
    ];
    one("offset = 25", "max_area = 0", "12:1", "[scale.room.node.leds]", &said);
}

#[test]
fn what_one_camera_lacks_is_said_once_with_the_cameras() {
    let folder = |folder: &str| format!("type = \"test.camera\"\nfolder = \"{folder}\"");
    let faults = bad(&edited("type = \"test.camera\"", &folder("{camera}")));
    assert_eq!(faults.list.len(), 1, "{faults}");
    expect(&faults, 0, "10:10", "\"{camera}\"", &["`folder`", "for the cameras `wide-1`, `wide-2` and `wide-3`"]);

    let dir = tempfile::tempdir().unwrap();
    for camera in ["wide-1", "wide-3"] {
        std::fs::create_dir(dir.path().join(camera)).unwrap();
    }
    let faults = bad(&edited("type = \"test.camera\"", &folder(&format!("{}/{{camera}}", dir.path().display()))));
    assert_eq!(faults.list.len(), 1, "{faults}");
    assert!(said(&faults.list[0]).contains("so for the camera `wide-2`"), "{faults}");
}

#[test]
fn node_that_panics_while_it_is_made_is_a_fault() {
    let text = format!("{LAB}\n[scale.room.node.hands]\ntype = \"test.panic\"\n");
    whole(&text, "43:1", "[scale.room.node.hands]", &["cannot be made", "panicked", "no hands"]);
}

#[test]
fn ports_that_do_not_exist_are_told_with_those_that_do() {
    features(
        "{ feature = \"leds.features\" }",
        8,
        "feature",
        &["`test.integrator` has no input `feature`", "its inputs: `features`"],
    );
    features(
        "{ features = \"leds.feature\" }",
        25,
        "feature",
        &["`leds` has no output `feature`", "did you mean `features`?"],
    );
    features("{ features = \"led.features\" }", 20, "led", &["scale `room` has no node `led`", "did you mean `leds`?"]);
    features(
        "{ features = \"leds\" }",
        19,
        "\"leds\"",
        &["expected \"NODE.OUTPUT\"", "the outputs of `leds`: `leds.features`"],
    );
    features("{ features = \"\" }", 19, "\"\"", &["does not name an output"]);
    features("{ features = 3 }", 19, "3", &["found 3, expected an output"]);
    features("{ features = [\"leds.features\", 3] }", 37, "3", &["found 3, expected an output"]);
    features("{ features = [] }", 19, "[]", &["port `features` names no source"]);
    features("{ features = { capacity = 8 } }", 8, "features", &["names no source", "expected `from = "]);
    features("{ features = \"table.x\" }", 26, "x", &["`test.table` has no outputs: it is a sink"]);
    features("3", 6, "3", &["found 3, expected a table"]);
    let said = ["scale `face` has no node `targets`", "did you mean `room.targets.targets`?"];
    one("\"room.targets.targets\"", "\"targets.targets\"", "35:18", "targets", &said);
    let said = ["there is no scale `rom`", "did you mean `room`?"];
    one("\"room.targets.targets\"", "\"rom.targets.targets\"", "35:18", "rom", &said);
    let said = ["`room` is a scale"];
    one("\"room.targets.targets\"", "\"room.targets\"", "35:18", "room", &said);
    // Written with an escape, so that parts of it cannot be pointed at.
    features(r#"{ features = "led\u0073.feature" }"#, 19, r#""led\u0073.feature""#, &["no output `feature`"]);
}

#[test]
fn messages_that_do_not_match_are_both_named() {
    let said = [
        "`video.image` gives `image`",
        "`targets.features` takes `features`",
        "`features` is given by `leds.features`",
    ];
    features("{ features = \"video.image\" }", 19, "\"video.image\"", &said);
}

#[test]
fn open_input_says_what_could_be_connected() {
    let said = ["input `image` of `leds` is open", "it takes `image`", "given by `video.image`"];
    one("image = \"video.image\", ", "", "12:1", "[scale.room.node.leds]", &said);
    let text = "[rig]\nname = \"a\"\n[scale.s.node.n]\ntype = \"test.smoother\"\n";
    let faults = bad(text);
    expect(&faults, 0, "3:1", "[scale.s.node.n]", &["input `targets` of `n` is open"]);
}

#[test]
fn input_takes_as_many_sources_as_it_says() {
    let said = ["input `image` of `leds` takes one source", "found 2 sources"];
    one("\"video.image\"", "[\"video.image\", \"video[wide-1].image\"]", "15:32", "\"video[wide-1].image\"", &said);
    let said = ["names a source twice", "it stands here already"];
    features("{ features = [\"leds.features\", \"room.leds.features\"] }", 37, "\"room.leds.features\"", &said);
    let said = ["takes one source, and `video` runs for 3 cameras", "`video[wide-1].image`", "each = "];
    let without = "type = \"test.detector\"\nin = { image = \"video.image\" }";
    let with =
        "type = \"test.detector\"\neach = \"wide-*\"\nin = { image = \"video.image\", hints = \"targets.hints\" }";
    one(with, without, "14:16", "\"video.image\"", &said);
}

#[test]
fn pixels_of_one_camera_do_not_enter_a_node_of_another() {
    let title = "pixels of one camera cannot enter a node of another: `video[wide-1]` to `leds[wide-2]`";
    let said = [title, "found camera `wide-1`, expected `wide-2` and `wide-3`"];
    one("\"video.image\"", "\"video[wide-1].image\"", "15:16", "\"video[wide-1].image\"", &said);
    let video = "[scale.room.node.video]\ntype = \"test.camera\"\neach = \"wide-*\"";
    one(video, &video.replace("wide-*", "wide-1"), "15:16", "\"video.image\"", &said);
    one(video, &video.replace("each = \"wide-*\"", "camera = \"wide-1\""), "15:16", "\"video.image\"", &said);
    let said = ["`aim` does not run for camera `wide-1` as `heads` does", "name one: `aim[ptz-1].OUTPUT`"];
    let heads = "type = \"test.motor\"\neach = \"ptz-*\"";
    one(heads, &heads.replace("ptz", "wide"), "41:18", "\"aim.command\"", &said);
}

#[test]
fn cameras_that_the_calibration_lacks_are_told_with_those_it_has() {
    let heads = "type = \"test.motor\"\neach = \"ptz-*\"";
    let said = ["no camera of the calibration matches `pan-*`", "`ptz-1`, `ptz-2`, `wide-1`, `wide-2` and `wide-3`"];
    one(heads, &heads.replace("ptz", "pan"), "40:8", "\"pan-*\"", &said);
    let said = ["no camera of the calibration is `ptz-3`", "did you mean `ptz-1`?"];
    one(heads, &heads.replace("each = \"ptz-*\"", "camera = \"ptz-3\""), "40:10", "\"ptz-3\"", &said);
    let both = heads.replace("each", "camera = \"ptz-1\"\neach");
    one(heads, &both, "40:10", "\"ptz-1\"", &["`each` or `camera`, not both"]);
    features("{ features = \"leds[wide-9].features\" }", 25, "wide-9", &["`leds` does not run for a camera `wide-9`"]);
    features("{ features = \"targets[wide-1].hints\" }", 28, "wide-1", &["`targets` runs once, for no camera"]);
    let faults = bad(&edited("calibration = \"lab.calibration.toml\"\n", ""));
    assert_eq!(faults.list.len(), 4, "{faults}");
    expect(&faults, 0, "9:8", "\"wide-*\"", &["`each` needs cameras", "add `calibration = "]);
}

#[test]
fn calibration_that_cannot_be_used_is_told_with_its_own_errors() {
    let said = ["the calibration cannot be used", "lib.calibration.toml", "image_size_px", "foveate calibrate"];
    one("lab.calibration", "lib.calibration", "3:15", "\"lib.calibration.toml\"", &said);
    let said = ["the calibration cannot be found", "NO_SUCH_VARIABLE_HERE"];
    one("\"lab.calibration.toml\"", "\"${NO_SUCH_VARIABLE_HERE}/a\"", "3:15", "\"${NO_SUCH_VARIABLE_HERE}/a\"", &said);
}

/// A calibration as it is begun with: one message, and what finds the rest.
#[test]
fn a_room_that_is_not_calibrated_yet_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let sizes: String = ["ptz-1", "ptz-2", "wide-1", "wide-2", "wide-3"]
        .map(|it| format!("[camera.{it}]\nimage_size_px = [640, 480]\n[clock.{it}]\nframe_rate_hz = 30\n"))
        .concat();
    let path = folder.path().join("new.calibration.toml");
    std::fs::write(&path, format!("[calibration]\nlength_unit = \"unknown\"\n{sizes}")).unwrap();
    let faults = bad(&edited("lab.calibration.toml", &path.display().to_string()));
    assert_eq!(faults.list.len(), 1, "{faults}");
    let said = faults.to_string();
    for words in [
        "not calibrated yet",
        "lacks the poses of 5 and the optics of 5 of its 5 cameras",
        "foveate calibrate",
        "led.detector",
        "--wand-mm",
        "board.detector",
        "--chessboard",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    // Something else is wrong with it: that is said.
    std::fs::write(&path, format!("[calibration]\nlength_unit = \"unknown\"\n{sizes}focal = 3\n")).unwrap();
    assert!(!bad(&edited("lab.calibration.toml", &path.display().to_string())).to_string().contains("not calibrated"));
}

#[test]
fn scales_nest_in_scales_that_exist_and_not_in_themselves() {
    let parent = "parent = \"room\"";
    one(parent, "parent = \"rom\"", "28:10", "\"rom\"", &["there is no scale `rom`", "did you mean `room`?"]);
    one(parent, "parent = 3", "28:10", "3", &["found 3, expected the name of a scale"]);
    one(parent, "parent = \"face\"", "28:10", "\"face\"", &["scales nest in a circle: `face`"]);
    let faults = bad(&edited(parent, ""));
    assert_eq!(faults.list.len(), 2, "{faults}");
    expect(&faults, 0, "29:10", "\"targets.head\"", &["has an anchor and no parent"]);
    expect(&faults, 1, "35:17", "\"room.targets.targets\"", &["takes points of the parent scale, and `face` has none"]);
    let text = format!("{LAB}\n[scale.hand]\nparent = \"thumb\"\n[scale.thumb]\nparent = \"hand\"\n");
    whole(&text, "44:10", "\"thumb\"", &["scales nest in a circle: `hand`, `thumb`", "found `hand` inside itself"]);
}

#[test]
fn anchor_is_a_target_of_the_parent() {
    let anchor = "\"targets.head\"";
    one(anchor, "\"target.head\"", "29:10", "\"target.head\"", &["scale `room` has no node `target`", "`targets`?"]);
    one(anchor, "\"leds.head\"", "29:10", "\"leds.head\"", &["`leds` recovers no targets", "found a `test.detector`"]);
    one(anchor, "\"head\"", "29:10", "\"head\"", &["expected \"NODE.TARGET\" with a node of scale `room`"]);
}

#[test]
fn points_of_one_scale_do_not_enter_a_node_of_another() {
    let text =
        format!("{LAB}\n[scale.face.node.table]\ntype = \"test.table\"\nin.targets = \"room.targets.targets\"\n");
    let said = ["points of scale `room` cannot enter input `targets` of `table`", "expected metres in `face`"];
    whole(&text, "45:14", "\"room.targets.targets\"", &said);
    let text = format!(
        "{LAB}\n[scale.nose]\nparent = \"face\"\n[scale.nose.node.aim]\ntype = \"test.aim\"\nlatency_ms = 1\nin.target = \"room.targets.targets\"\n"
    );
    let faults = bad(&text);
    expect(
        &faults,
        0,
        "48:13",
        "\"room.targets.targets\"",
        &["points of scale `room`", "takes points of scale `face`"],
    );
}

#[test]
fn volume_and_radius_are_of_this_world() {
    let max = "max = [1.75, 2.5, 2.0]";
    one(
        max,
        "max = [1.75, -3, 2.0]",
        "6:12",
        "{ min = [-1.75, -2.5, 0.5], max = [1.75, -3, 2.0] }",
        &["found -2.5 to -3 m in y"],
    );
    one(max, "max = [1.75, 2.5]", "6:46", "[1.75, 2.5]", &["expected three numbers [m]"]);
    one(max, "max = [1.75, inf, 2.0]", "6:53", "inf", &["found inf, expected a number [m]"]);
    one(", max = [1.75, 2.5, 2.0]", "", "6:1", "volume_m", &["`volume_m` lacks `max`"]);
    one("radius_m = 0.25", "radius_m = 0", "30:12", "0", &["found 0, expected more than 0 [m]"]);
}

#[test]
fn head_of_the_rig_is_checked() {
    one("\"lab\"", "\"My Lab\"", "2:8", "\"My Lab\"", &["a rig cannot be named `My Lab`", "lower-case"]);
    one("name = \"lab\"", "", "1:1", "[rig]", &["the rig has no name"]);
    let with = |line: &str| format!("name = \"lab\"\n{line}");
    one("name = \"lab\"", &with("seed = -1"), "3:8", "-1", &["found -1, expected a whole number from 0"]);
    one("name = \"lab\"", &with("duration_s = 0"), "3:14", "0", &["expected more than 0"]);
    one("name = \"lab\"", &with("duration_s = nan"), "3:14", "nan", &["found nan"]);
    one("name = \"lab\"", &with("report_speed = 3"), "3:16", "3", &["expected true or false"]);
    one("name = \"lab\"", &with("paced = 3"), "3:9", "3", &["expected true or false"]);
    assert!(said(&bad("").list[0]).contains("write `[rig]`"));
    whole("[rig]\nname = \"a\"\n", "1:1", "[rig]", &["this rig has no nodes"]);
}

#[test]
fn cycle_names_all_its_nodes() {
    let ring = "
[scale.room.node.a]
type = \"test.smoother\"
in.targets = \"b.targets\"
[scale.room.node.b]
type = \"test.smoother\"
in.targets = \"c.targets\"
[scale.room.node.c]
type = \"test.smoother\"
in.targets = \"a.targets\"
";
    let title = "nodes trigger each other in a cycle: room.a -> room.c -> room.b -> room.a";
    let said = [title, "`room.b` triggers `room.a`", "`room.c` triggers `room.b`", "samples the latest"];
    whole(&format!("{LAB}{ring}"), "45:14", "\"b.targets\"", &said);
    let itself = ring.replace("b.targets", "a.targets");
    whole(&format!("{LAB}{itself}"), "45:14", "\"a.targets\"", &["room.a -> room.a"]);
}

#[test]
fn requirement_that_the_plan_cannot_meet_gives_both_numbers() {
    let require = "{ age_ms = 20, rate_hz = 30 }";
    one(
        require,
        "{ age_ms = 6 }",
        "21:31",
        "6",
        &["found 6 ms, expected at least 7 ms", "given by `room.leds[wide-1]`"],
    );
    one(require, "{ rate_hz = 90 }", "21:32", "90", &["found 90 Hz, expected at most 60 Hz"]);
    // Three cameras of 60 Hz into one port: what leaves the node may come 180 times a second, and no more.
    let table = "in.targets = { from = [\"targets.targets\"], capacity = 64, when_full = \"wait\" }";
    good(&edited(table, &format!("{table}\nrequire.targets.rate_hz = 180")));
    one(table, &format!("{table}\nrequire.targets.rate_hz = 181"), "26:27", "181", &["expected at most 180 Hz"]);
    // A joined set comes as often as its fastest source.
    let joined = LAB.replace("hints = \"targets.hints\"", "").replace("\"video.image\",", "\"video.image\"");
    let joined = joined
        .replace("test.integrator", "test.joiner")
        .replace(table, &format!("{table}\nrequire.targets.rate_hz = 61"));
    whole(&joined, "26:27", "61", &["expected at most 60 Hz"]);
    one(require, "{ loss = 2 }", "21:29", "2", &["expected 0 to 1 [–]"]);
    one(
        require,
        "{ ag_ms = 2 }",
        "21:22",
        "ag_ms",
        &["unknown key `ag_ms` in a requirement", "did you mean `age_ms`?"],
    );
    one("require.features", "require.feature", "21:9", "feature", &["has no input `feature`"]);
    one(
        "hints = \"targets.hints\" }",
        "}\nrequire.hints.age_ms = 5",
        "16:9",
        "hints",
        &["found no source at port `hints`"],
    );
}

#[test]
fn reserved_keys_are_checked() {
    one("type = \"test.integrator\"", "", "18:1", "[scale.room.node.targets]", &["node `targets` has no type"]);
    one("type = \"test.integrator\"", "type = 3", "19:8", "3", &["found 3, expected the name of a node type"]);
    let said = ["expected \"stop\", \"skip\" or \"restart\"", "did you mean \"restart\"?"];
    setting("on_error = \"restrat\"", 12, "\"restrat\"", &said);
    features("{ features = { from = \"leds.features\", capacity = 0 } }", 56, "0", &["expected a whole number from 1"]);
    features("{ features = { from = \"leds.features\", when_full = \"drop\" } }", 57, "\"drop\"", &["\"drop_oldest\""]);
    features("{ features = { from = \"leds.features\", form = 1 } }", 45, "form", &["did you mean `from`?"]);
}

#[test]
fn each_key_of_a_recording_is_checked() {
    let refused = |line: &str, place: &str, what: &str, words: &[&str]| {
        whole(&format!("{LAB}\n[record]\n{line}\n"), place, what, words);
    };
    refused("pictures = \"jpg\"", "44:12", "\"jpg\"", &["did you mean \"jpeg\"?"]);
    refused("jpeg_quality = 0", "44:16", "0", &["expected a whole number from 1 to 100"]);
    refused("cameras = { \"wide-1\" = \"raw\" }", "44:24", "\"raw\"", &["\"lossless\""]);
    refused("hide_px = { \"wide-1\" = [[0, 0, 5]] }", "44:24", "[[0, 0, 5]]", &["[[LEFT, TOP, WIDTH, HEIGHT]]"]);
    refused("hide_scales = \"face\"", "44:15", "\"face\"", &["names of scales"]);
    refused("compression = \"gzip\"", "44:15", "\"gzip\"", &["\"zstd\""]);
    refused("memory_mb = 1", "44:13", "1", &["expected a whole number from 16"]);
    refused("picture = \"jpeg\"", "44:1", "picture", &["did you mean `pictures`?"]);
}

#[test]
fn text_that_is_not_toml_is_told_with_all_its_places() {
    let faults = bad("[rig]\nname = \"a\"\n[scale.s.node.n]\ntype = \"test.camera\nrate_hz = = \nx = [1,\n");
    assert_eq!(faults.list.len(), 3, "{faults}");
    expect(&faults, 0, "4:20", "", &["this is not TOML", "expected `\"`"]);
    expect(&faults, 1, "5:11", "=", &[]);
    let text = format!("{LAB}\n[scale.room.node.video]\n");
    whole(&text, "43:18", "video", &["`video` stands here twice"]);
}

#[test]
fn all_faults_of_a_rig_come_in_one_run_in_the_order_of_its_text() {
    let text = LAB
        .replace("name = \"lab\"", "name = \"La b\"\nseeds = 1")
        .replace("offset = 25", "offset = 300\nofset = 2\ncentre = \"x\"")
        .replace("test.integrator", "test.intgrator")
        .replace("parent = \"room\"", "parent = \"rom\"")
        .replace("latency_ms = 300", "latency_ms = \"long\"")
        .replace("\"aim.command\"", "\"aim.comand\"");
    let faults = bad(&text);
    let places: Vec<usize> = faults.list.iter().map(|it| it.line_column().0).collect();
    assert_eq!(places, [2, 3, 17, 18, 19, 22, 31, 39, 44], "{faults}");
    assert!(faults.list.iter().all(|it| it.severity == Severity::Error));
}

#[test]
fn page_is_plain_or_coloured_and_hides_control_characters() {
    let faults = bad(&edited("test.detector", "\\u001b[31mx"));
    assert!(!faults.render(false).contains('\u{1b}'), "{faults}");
    assert!(faults.render(true).contains("\u{1b}["));
    assert!(faults.list[0].title.contains("\\u{1b}[31mx"), "{faults}");
}

#[test]
fn columns_count_characters() {
    let faults = bad(&edited("offset = 25", "window = { \"é𝄞\" = 1, size_px = 0 }"));
    expect(&faults, 0, "16:12", "\"é𝄞\"", &[]);
    expect(&faults, 1, "16:32", "0", &[]);
}

#[test]
fn way_to_take_data_is_one_of_four_and_only_where_there_is_a_choice() {
    features(
        "{ features = { from = \"leds.features\", policy = \"newest_of_all\" } }",
        54,
        "\"newest_of_all\"",
        &[
            "found the text `newest_of_all`",
            "\"newest_of_each\"",
            "\"round_robin\"",
            "did you mean \"newest_of_each\"?",
        ],
    );
    let sampled = "in = { image = \"video.image\", hints = { from = \"targets.hints\", policy = \"each\" } }";
    one(
        "in = { image = \"video.image\", hints = \"targets.hints\" }",
        sampled,
        "15:74",
        "\"each\"",
        &[
            "how input `hints` of `leds` takes data cannot be chosen",
            "found `policy`, expected nothing: the latest is sampled",
        ],
    );
}

#[test]
fn only_what_is_sampled_is_delayed() {
    features(
        "{ features = { from = \"leds.features\", delay_ms = 5 } }",
        56,
        "5",
        &["what comes into input `features` of `targets` cannot be delayed", "found `delay_ms`, expected nothing"],
    );
}

#[test]
fn renamed_key_of_a_connection_is_refused_with_its_new_name() {
    features(
        "{ features = { from = \"leds.features\", take = \"newest\" } }",
        45,
        "take",
        &["the key `take` is now called `policy`", "found the old name, expected `policy`"],
    );
}

#[test]
fn cost_of_a_turn_is_a_time_and_sources_have_none() {
    one("offset = 25", "cost_ms = -1", "16:11", "-1", &["found -1, expected 0 to 60000 [ms]"]);
    one(
        "offset = 25",
        "cost_ms = 1\ncost_jitter_ms = 2",
        "17:18",
        "2",
        &["an activation cannot take less than no time", "found 2 ms, expected at most `cost_ms`, which is 1 ms"],
    );
    let source = "type = \"test.camera\"\ncost_ms = 1";
    one("type = \"test.camera\"", source, "10:11", "1", &["`video` is a source", "found a cost, expected none"]);
}
