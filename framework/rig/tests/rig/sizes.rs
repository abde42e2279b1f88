//! Rigs and files of unusual size.

use std::fmt::Write as _;
use std::io::Write as _;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use foveate_rig::{self as rig, Diagnostics, MAX_BYTES, Overrides};

use crate::accepted::LAB;
use crate::parts::{bad, good, registry};

/// A chain of `count` nodes behind a source, each scale and node on three lines.
pub fn chain(count: usize) -> String {
    let mut text = String::from(
        "[rig]\nname = \"chain\"\ncalibration = \"lab.calibration.toml\"\n[scale.s.node.video]\ntype = \"test.camera\"\ncamera = \"wide-1\"\n\
         [scale.s.node.leds]\ntype = \"test.detector\"\nin.image = \"video.image\"\n\
         [scale.s.node.n0]\ntype = \"test.integrator\"\nin.features = \"leds.features\"\n",
    );
    for index in 1..count {
        let before = index - 1;
        let _ = write!(text, "[scale.s.node.n{index}]\ntype = \"test.smoother\"\nin.targets = \"n{before}.targets\"\n");
    }
    text
}

#[test]
fn hundred_thousand_nodes_in_a_row_are_scheduled() {
    let begin = Instant::now();
    let graph = good(&chain(100_000));
    assert_eq!(graph.instances.len(), 100_002);
    assert!(graph.instances[100_001].path.ends_with(".n99999"));
    assert_eq!(good(&graph.resolved).resolved, graph.resolved);
    assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", begin.elapsed());
}

#[test]
fn hundred_thousand_faults_are_collected_and_the_first_hundred_shown() {
    let begin = Instant::now();
    let faults = bad(&chain(100_000).replace(".targets\"", ".target\"").replace("test.smoother", "test.smother"));
    assert!(faults.list.len() >= 99_999, "{}", faults.list.len());
    let page = faults.render(false);
    assert!(page.contains(&format!("and {} more", faults.list.len() - 100)), "{}", page.len());
    assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", begin.elapsed());
}

#[test]
fn hundred_thousand_scales_nest() {
    let mut text = String::from("[rig]\nname = \"deep\"\n");
    for index in (1..100_000).rev() {
        let _ = write!(text, "[scale.s{index}]\nparent = \"s{}\"\n", index - 1);
    }
    text.push_str("[scale.s0.node.end]\ntype = \"test.panic\"\n");
    let faults = bad(&text);
    assert_eq!(faults.list.len(), 1, "the only node panics: {}", faults.list.len());
}

#[test]
fn nesting_without_end_is_refused() {
    for (open, close) in [("[", "]"), ("{a=", "}"), ("a.", "")] {
        for count in [100, 100_000] {
            let nested = format!("{}1{}", open.repeat(count), close.repeat(count));
            let text = if open == "a." { format!("{}a = 1\n", open.repeat(count)) } else { format!("x = {nested}\n") };
            assert!(bad(&text).n_errors() > 0);
            assert!(!bad(&text).render(true).is_empty());
        }
    }
    let nested = format!("window.corners = {}1{}", "[".repeat(60), "]".repeat(60));
    assert_eq!(bad(&LAB.replace("offset = 25", &nested)).n_errors(), 2);
}

#[test]
fn long_lines_are_not_shown() {
    let text = LAB.replace("offset = 25", &format!("window.corners = [{}3]", "[1, 2], ".repeat(200_000)));
    let begin = Instant::now();
    let faults = bad(&text);
    let page = faults.render(false);
    assert!(page.len() < 1000 && page.contains("found 3, expected a list of 2 items"), "{page}");
    assert!(page.contains("lab.toml:16:1600019"), "{page}");
    assert!(begin.elapsed() < Duration::from_secs(30), "{:?}", begin.elapsed());
}

#[track_caller]
fn refused(path: &Path) -> Diagnostics {
    match rig::load_file(path, &registry(), &Overrides::default()) {
        Ok(graph) => panic!("no fault in {graph:?}"),
        Err(faults) => faults,
    }
}

#[test]
fn file_that_cannot_be_a_rig_is_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let page = |path: &Path| refused(path).render(false);
    assert!(page(dir.path()).contains("found a folder, expected a file"), "{}", page(dir.path()));
    let missing = dir.path().join("none.toml");
    assert!(page(&missing).contains("none.toml"), "{}", page(&missing));

    let large = dir.path().join("large.toml");
    std::fs::File::create(&large).unwrap().set_len(100_000_000).unwrap();
    let begin = Instant::now();
    assert!(page(&large).contains(&format!("found 100000000 bytes, expected at most {MAX_BYTES}")), "{}", page(&large));
    assert!(begin.elapsed() < Duration::from_secs(1));
    // Without a program at its other end a pipe would be waited for.
    let pipe = dir.path().join("pipe.toml");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for it in [&pipe, Path::new("/dev/zero")] {
        assert!(page(it).contains("found a pipe or device, expected a file"), "{}", page(it));
    }
    let (open, mut end) = std::io::pipe().unwrap();
    end.write_all(b"!").unwrap();
    drop(end);
    let open = page(Path::new(&format!("/dev/fd/{}", open.as_raw_fd())));
    assert!(open.contains("1 | !"), "{open}");

    let binary = dir.path().join("binary.toml");
    std::fs::File::create(&binary).unwrap().write_all(b"[rig]\nname = \"\xff\xfe\"\n").unwrap();
    let faults = refused(&binary);
    assert_eq!(faults.list[0].line_column(), (2, 9));
    assert!(faults.render(false).contains("found the byte 0xff, expected UTF-8"), "{faults}");
}

#[test]
fn relative_paths_start_at_the_rig_or_at_its_folder() {
    let dir = tempfile::tempdir().unwrap();
    let lab = crate::parts::path().parent().unwrap();
    std::fs::copy(lab.join("lab.calibration.toml"), dir.path().join("lab.calibration.toml")).unwrap();
    let rig = dir.path().join("mine.toml");
    std::fs::write(&rig, LAB).unwrap();
    let graph = rig::load_file(&rig, &registry(), &Overrides::default()).unwrap();
    assert_eq!(graph.rig_dir, dir.path());
    // What was resolved runs from anywhere.
    let elsewhere = tempfile::tempdir().unwrap();
    let copy = elsewhere.path().join("rig.resolved.toml");
    std::fs::write(&copy, &graph.resolved).unwrap();
    let again = rig::load_file(&copy, &registry(), &Overrides::default()).unwrap();
    assert_eq!((again.resolved, again.rig_dir), (graph.resolved, graph.rig_dir));
}

#[test]
fn command_line_comes_before_the_rig() {
    let load = |overrides: Overrides| rig::load(LAB, crate::parts::path(), &registry(), &overrides);
    let graph = load(Overrides { seed: Some(7), duration_s: Some(2.5), ..Overrides::default() }).unwrap();
    assert_eq!((graph.seed, graph.duration.map(|it| it.as_s())), (7, Some(2.5)));
    assert!(graph.resolved.contains("seed = 7\nduration_s = 2.5\n"));
    let faults =
        load(Overrides { seed: Some(u64::MAX), duration_s: Some(f64::NAN), ..Overrides::default() }).unwrap_err();
    assert_eq!(faults.n_errors(), 2, "{faults}");
}
