//! Every command that is suggested is one that the program takes.

use clap::Parser;
use foveate_calibration::cause::Cause;
use foveate_calibration::checks::{Candidate, Judgement};

use super::*;
use crate::calibrate::boards::BoardArgs;
use crate::commands::{Cli, Command};

fn calibrate(line: &str) -> CalibrateArgs {
    // Nothing that is tried here holds a blank within quotes.
    let words = line.split_whitespace().map(|it| it.trim_matches('\''));
    match Cli::try_parse_from(words).unwrap_or_else(|fault| panic!("{line}: {fault}")).command {
        Command::Calibrate(args) => *args,
        other => panic!("{other:?}"),
    }
}

#[test]
fn suggested_commands_are_taken_whatever_was_asked() {
    let shown = [
        "",
        "--wand-mm 400",
        "--chessboard 8x6 --square-mm 20",
        "--charuco 4x5 --square-mm 54 --board-floor 2.5",
        "--square-mm 30",
        "--floor-stops --floor-height-mm 20 --distance c0:c1=3.2m --falling 1..2",
        "--l-frame @1=0,0,0 --l-frame @2=1,0,0 --l-frame @3=0,1,0 --plumb @1:@2 --upright",
    ];
    let asked_besides = [
        "",
        "--from-nothing",
        "--from-nothing --unsynchronised --max-offset 1",
        "--from seen --cameras 'wide-*,!wide-3' --inlier-px 8",
    ];
    let optics = ["", "--optics known", "--optics focal", "--optics lens", "--optics all"];
    let causes = [
        Cause::Clock { offset_s: -0.4, sigma_s: 1e-3 },
        Cause::Focal { factor: 1.1 },
        Cause::Distortion { k1: 0.1 },
        Cause::PixelShape { factor: 0.5 },
        Cause::Mirrored,
    ];
    let mut suggested = 0;
    let besides = |shown| asked_besides.map(|it| (shown, it));
    let all = shown.into_iter().flat_map(besides).flat_map(|(shown, besides)| optics.map(|it| (shown, besides, it)));
    for (shown, besides, optics) in all {
        let typed = calibrate(&format!("foveate calibrate lab.toml {shown} {besides} {optics}"));
        for which in 0..1_usize << causes.len() {
            let of = |(index, cause): (usize, &Cause)| {
                let judgement = Judgement { level: Level::Redo, sentence: String::new() };
                let candidate = Candidate { judgement, camera: index, cause: *cause, misfit: 9.0, explained: 0.9 };
                (which >> index & 1 == 1).then_some(candidate)
            };
            let candidates: Vec<Candidate> = causes.iter().enumerate().filter_map(of).collect();
            let commands = advice::commands(&asked(&typed, typed.board != BoardArgs::default()), &candidates);
            let has_clock = which & 1 == 1 && !typed.unsynchronised;
            assert_eq!(
                has_clock,
                commands.iter().any(|it| it.contains("--unsynchronised --max-offset")),
                "{commands:?}"
            );
            for command in &commands {
                let line = command.strip_prefix("try: ").and_then(|it| it.split_once("   (")).unwrap().0;
                let taken = calibrate(line);
                let kept = |it: &CalibrateArgs| {
                    (it.wand_mm, it.board, it.cameras.clone(), it.l_frame.clone(), it.distance.clone(), it.upright)
                };
                assert_eq!(kept(&taken), kept(&typed), "{line}");
                suggested += 1;
            }
        }
    }
    assert!(suggested > 1000, "{suggested}");
    assert_eq!(quoted("my rig's.toml"), "'my rig'\\''s.toml'");
}

#[test]
fn cameras_that_are_kept_are_found_by_their_names_and_so_are_the_others() {
    let section = |name: &str| {
        format!(
            "[camera.{name}]\nimage_size_px = [640, 480]\nfocal_px = [600.0, 600.0]\nprincipal_point_px = [320.0, 240.0]\n\
             position_m = [0.0, 0.0, 1.0]\ncamera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]\n\n"
        )
    };
    let read = |names: &[&str]| {
        let text: String = names.iter().map(|it| section(it)).collect();
        let text = format!("[calibration]\nlength_unit = \"m\"\n\n{text}");
        Calibration::from_toml(&text, Path::new("lab.toml")).unwrap()
    };
    let older = read(&["ptz-1", "ptz-2", "wide-1", "wide-2", "wide-10"]);
    let mut newer = read(&["wide-1", "wide-2", "wide-10"]);
    let carried = carry_over(&mut newer, &older, true);
    assert_eq!((carried.kept, carried.lost.len()), (vec!["ptz-1".to_owned(), "ptz-2".to_owned()], 0));
    assert!(older.cameras.iter().all(|it| newer.camera(&it.name) == Some(&it.camera)));
    let carried = carry_over(&mut read(&["wide-1"]), &older, false);
    assert_eq!((carried.kept.len(), carried.lost.len()), (0, 4));
}
