//! Whole pages of small folders.

use std::fs;
use std::path::Path;

use super::of_folder;

const SUMMARY: &str = r#"{
  "body.error_mm.median": 1.4850000000000003,
  "body.error_mm.p95": 3.385,
  "faults": 1,
  "head.sigma_ms": 9.4265,
  "session_s": 4,
  "figures_about": {
    "body.error_mm.median": { "unit": "mm", "better": "low" },
    "body.error_mm.p95": { "unit": "mm", "better": "low" },
    "head.sigma_ms": { "unit": "ms", "better": "low" }
  }
}"#;
const LEDGER: &str = "edge,delivered,rate_hz,age_p50_ms,age_p99_ms,age_max_ms,gaps,dropped,suspended,late,loss,sigma,requirement\n\
    room.leds[c1].features -> room.targets.features,100,30,1,1,1,3,1,0,2,0.04,0.0809,met\n";
const EVENTS: &str = "what,where,first_time_s,count,action,message\n\
    fault,room.leds[c1],1.250000,1,stopped,\"it met a wall\"\n\
    gap,room.video[c1],1.368667,3,,\"picture lost\"\n\
    suspended,face,0.000000,1,,\"its target has not been found yet\"\n\
    note,,,,,\"the face is a recorded one\"\n\
    unmet,\"room.leds[c1].features -> room.targets.features\",,,must,\"rate is 20 Hz, required 30 Hz\"\n";
const RIG: &str = "[rig]\nname = \"small\"\nfolder = \"FOLDER\"\ncalibration = \"c.calibration.toml\"\nseed = 7\n\
    [scale.room.node.leds]\ntype = \"sim.observer\"\neach = \"c*\"\nin.world = { from = \"room.lab.world\" }\n";
const CALIBRATION: &str = "[calibration]\nlength_unit = \"m\"\n[provenance]\nmethod = \"one waved light\"\nscale = { fixed_by = \"a wand\", sigma = 0.0005 }\n\
    [camera.c1]\nimage_size_px = [640, 480]\nfocal_px = [520.0, 520.0]\nposition_m = [1.0, -2.0, 2.5]\n\
    [camera.c1.uncertainty]\nfocal_sigma_px = [0.8, 0.8]\n";
const SVG: &str =
    "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"300\" height=\"200\"><script>alert(1)</script></svg>";

/// A results folder with all files, its calibration in it.
fn whole() -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let rig = RIG.replace("FOLDER", &home.path().display().to_string());
    let files = [
        ("summary.json", SUMMARY),
        ("ledger.csv", LEDGER),
        ("events.csv", EVENTS),
        ("timing.json", "{ \"wall_s\": 2.0, \"real_time_factor\": 2.0, \"interrupted\": false }"),
        ("rig.resolved.toml", rig.as_str()),
        ("graph.svg", SVG),
        ("path_top.svg", SVG),
        ("targets.csv", "time_s,target\n1,0\n2,0\n"),
        ("motion.c3d", "x"),
        ("c.calibration.toml", CALIBRATION),
    ];
    for (name, text) in files {
        fs::write(home.path().join(name), text).unwrap();
    }
    home
}

#[track_caller]
fn page(folder: &Path) -> String {
    of_folder(folder, "0.1.0").unwrap()
}

/// The text of one section.
#[track_caller]
fn section<'a>(page: &'a str, id: &str) -> &'a str {
    let start = page.find(&format!("<section id=\"{id}\"")).unwrap();
    let rest = &page[start..];
    &rest[..rest.find("</section>").unwrap()]
}

#[track_caller]
fn has(text: &str, all: &[&str]) {
    for it in all {
        assert!(text.contains(it), "`{it}` is not in {text}");
    }
}

#[test]
fn each_section_says_what_its_files_hold() {
    let home = whole();
    let page = page(home.path());
    has(&page, &["<h1>Results of small</h1>", "<dt>session</dt><dd>4 s</dd>", "<dt>seed</dt><dd>7</dd>"]);
    has(
        section(&page, "rig"),
        &["1 scale and 1 node", "sim.observer", "(1)", "room.<wbr>lab", "data:image/svg+xml;base64,PHN2"],
    );
    has(
        section(&page, "recovered"),
        &[
            "body.<wbr>error_<wbr>mm",
            "<small>median</small> 1.485",
            "3.385",
            "<span class=\"u\">mm</span></td><td>lower</td>",
            "alt=\"path top\"",
            ">2</td>",
            "time_<wbr>s, target",
            "motion.<wbr>c3d",
        ],
    );
    has(section(&page, "uncertainty"), &["0.0809", "head.<wbr>sigma_<wbr>ms", "9.427"]);
    has(
        section(&page, "shortfalls"),
        &[
            "1 requirement not met; 1 failure of a node; 3 missing messages; 1 edge with gaps",
            "it met a wall",
            "stopped",
            "rate is 20 Hz",
            "must",
            "4.00 %",
            "picture lost",
            "not been found yet",
            "recorded one",
        ],
    );
    has(
        section(&page, "calibration"),
        &["one waved light", "a wand, ± 0.05 %", "640 × 480", "520 ± 0.800", "1.000, \u{2212}2.000, 2.500"],
    );
    has(
        section(&page, "again"),
        &["foveate run rig.resolved.toml --out again", "seed is 7", "foveate 0.1.0", "2 s of wall time"],
    );
    assert!(!section(&page, "recovered").contains("sigma_"), "figures of uncertainty are in their own section");
}

#[test]
fn the_same_folder_gives_the_same_bytes_with_its_page_in_it() {
    let home = whole();
    let first = page(home.path());
    fs::write(home.path().join(crate::FILE_NAME), &first).unwrap();
    fs::write(home.path().join("another.html"), &first).unwrap();
    assert_eq!(page(home.path()), first);
}

#[test]
fn nothing_in_the_page_runs_or_comes_from_elsewhere() {
    let home = whole();
    let page = page(home.path());
    for word in ["<script", "http://", "https://", "url(", "@import", "<link", "<iframe", "<object"] {
        assert!(!page.contains(word), "`{word}`");
    }
    assert!(page.contains("default-src 'none'"));
}

#[test]
fn what_files_say_is_escaped() {
    let bad = "<script>alert(1)</script>";
    let home = whole();
    let path = home.path();
    fs::write(path.join("summary.json"), format!("{{ \"{bad}.median\": 1, \"sigma{bad}\": 2, \"gone{bad}\": null }}"))
        .unwrap();
    fs::write(path.join("ledger.csv"), format!("edge,gaps,loss,sigma\na[{bad}].x -> {bad},1,0.5,0.1\n")).unwrap();
    let events = format!(
        "what,where,first_time_s,count,action,message\nfault,{bad},1,1,{bad},{bad}\ngap,{bad},1,1,,{bad}\nnote,,,,,{bad}\nunmet,{bad},,,must,{bad}\nsuspended,{bad},1,1,,{bad}\n"
    );
    fs::write(path.join("events.csv"), events).unwrap();
    let rig = format!(
        "[rig]\nname = '{bad}'\ncalibration = 'c.toml'\nfolder = '{}'\n[scale.'{bad}']\nparent = '{bad}'\n[scale.'{bad}'.node.'{bad}']\ntype = 'sim.{bad}'\neach = '{bad}'\n\
         in.a = {{ from = '{bad}.x' }}\nrequire.'{bad}' = {{ '{bad}' = '{bad}' }}\n",
        path.display()
    );
    fs::write(path.join("rig.resolved.toml"), rig).unwrap();
    fs::write(
        path.join("c.toml"),
        format!("[provenance]\nmethod = '{bad}'\n'{bad}' = 1\n[camera.'{bad}']\nfocal_px = 1\n"),
    )
    .unwrap();
    // A file's name cannot hold a slash.
    for name in ["<script>alert(1).svg", "<script>alert(1).csv", "<script>alert(1).x", "\"onerror=\"alert(1).png"] {
        fs::write(path.join(name), SVG).unwrap();
    }
    fs::create_dir(path.join("<script>")).unwrap();
    fs::write(path.join("<script>/a.svg"), SVG).unwrap();
    let page = page(path);
    assert!(!page.contains("<script"), "{page}");
    assert!(page.matches("&lt;script&gt;").count() > 30);
    assert!(!page.contains("alt=\"\"onerror"));
}

#[test]
fn a_missing_file_is_said_in_its_section() {
    let of = [
        ("summary.json", "recovered"),
        ("ledger.csv", "uncertainty"),
        ("events.csv", "shortfalls"),
        ("rig.resolved.toml", "rig"),
        ("rig.resolved.toml", "calibration"),
        ("rig.resolved.toml", "again"),
        ("graph.svg", "rig"),
        ("timing.json", "again"),
        ("c.calibration.toml", "calibration"),
    ];
    for (file, id) in of {
        let home = whole();
        fs::remove_file(home.path().join(file)).unwrap();
        let page = page(home.path());
        let text = section(&page, id);
        assert!(
            text.contains("class=\"missing\"") && text.contains(file) && text.contains("is missing"),
            "{file}: {text}"
        );
    }
}

#[test]
fn damaged_files_are_said_and_the_rest_is_shown() {
    for (damage, word) in [(&b"\xff\xfe\x00"[..], "damaged"), (b"", "damaged"), (b"{ \"a\": [1, ", "damaged")] {
        for (file, id) in [
            ("summary.json", "recovered"),
            ("ledger.csv", "uncertainty"),
            ("events.csv", "shortfalls"),
            ("graph.svg", "rig"),
            ("path_top.svg", "recovered"),
        ] {
            let home = whole();
            fs::write(home.path().join(file), damage).unwrap();
            let page = page(home.path());
            let text = section(&page, id);
            assert!(text.contains(file) && text.contains(word), "{file}: {text}");
            has(section(&page, "calibration"), &["one waved light"]);
        }
    }
}

#[test]
fn a_run_without_shortfalls_says_so() {
    let home = whole();
    fs::write(home.path().join("summary.json"), "{ \"session_s\": 4, \"faults\": 0 }").unwrap();
    fs::write(home.path().join("events.csv"), "what,where,first_time_s,count,action,message\n").unwrap();
    fs::write(home.path().join("ledger.csv"), "edge,delivered,gaps,dropped,late,loss,sigma\na -> b,9,0,0,0,0,\n")
        .unwrap();
    has(section(&page(home.path()), "shortfalls"), &["Nothing fell short"]);
    fs::remove_file(home.path().join("events.csv")).unwrap();
    let page = page(home.path());
    let text = section(&page, "shortfalls");
    assert!(!text.contains("Nothing fell short"));
    has(text, &["not all files that would say so can be read"]);
}

#[test]
fn a_folder_that_is_none_of_results_is_refused_with_what_was_looked_for() {
    let home = tempfile::tempdir().unwrap();
    fs::write(home.path().join("graph.svg"), SVG).unwrap();
    let error = of_folder(home.path(), "0").unwrap_err();
    has(&error, &["no results folder", "`summary.json`", "`ledger.csv`", "`events.csv`"]);
    let error = of_folder(&home.path().join("none"), "0").unwrap_err();
    has(&error, &["is no folder"]);
}

#[test]
fn results_of_another_run_in_the_folder_are_left_out_and_said() {
    let home = whole();
    let again = home.path().join("again");
    fs::create_dir(&again).unwrap();
    fs::write(again.join("summary.json"), "{}").unwrap();
    fs::write(again.join("path_of_another.svg"), SVG).unwrap();
    let page = page(home.path());
    assert!(!page.contains("of_another"));
    has(section(&page, "recovered"), &["<code>again</code> holds the results of another run"]);
}
