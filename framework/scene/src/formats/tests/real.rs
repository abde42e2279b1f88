//! Files that other programs wrote.

use super::*;

/// The file `name` of the recordings, unless this machine has none.
fn real(name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("FOVEATE_DATA") else {
        println!("skipped: FOVEATE_DATA is not set");
        return None;
    };
    let path = Path::new(&folder).join(name);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
    }
    path.exists().then_some(path)
}

/// The data set holds the calibration of Qualisys and what Pose2Sim made of it: the same but for the lens, 64 times weaker there.
#[test]
fn a_real_qualisys_file_is_its_pose2sim_twin_with_the_lens_as_it_was() {
    let (Some(xml), Some(toml)) =
        (real("s06_pose2sim_single/Calib.qca.txt"), real("s06_pose2sim_single/Calib_qualisys.toml"))
    else {
        return;
    };
    let (theirs, twin) = (Calibration::load(&xml).unwrap(), Calibration::load(&toml).unwrap());
    assert_eq!((theirs.cameras.len(), theirs.length_unit), (4, LengthUnit::Metre));
    for (a, b) in theirs.cameras.iter().zip(&twin.cameras) {
        let (a, b) = (&a.camera, &b.camera);
        assert_eq!(a.image_size, b.image_size);
        for index in 0..2 {
            assert!((a.intrinsics.focal[index] - b.intrinsics.focal[index]).abs() < 1e-6);
            // Pose2Sim turned and moved its image's centre by rounding only.
            assert!((a.intrinsics.principal[index] - b.intrinsics.principal[index]).abs() < 0.01);
        }
        assert!((a.centre() - b.centre()).norm() < 1e-5, "{} {}", a.centre(), b.centre());
        assert!(a.camera_from_world.rotation.angle_to(&b.camera_from_world.rotation) < 1e-5);
        assert!((a.distortion.k1 / 64.0 - b.distortion.k1).abs() < 1e-7);
        assert!((a.distortion.p2 / 64.0 - b.distortion.p2).abs() < 1e-7);
    }
    check_same(&theirs, &there_and_back(&theirs, Format::Qualisys), "the real file again");
    check_same(&twin, &there_and_back(&twin, Format::Pose2Sim), "its twin again");
}

#[test]
fn both_generations_of_a_real_caliscope_file_say_the_same() {
    let (Some(new), Some(old)) =
        (real("s16_caliscope_4cam_charuco/camera_array.toml"), real("s16_caliscope_4cam_charuco/config.toml"))
    else {
        return;
    };
    let (new, old) = (Calibration::load(&new).unwrap(), Calibration::load(&old).unwrap());
    let names: Vec<&str> = new.cameras.iter().map(|it| it.name.as_str()).collect();
    assert_eq!((names, new.length_unit), (vec!["0", "1", "2", "3"], LengthUnit::Metre));
    assert_eq!(new.cameras, old.cameras);
    check_same(&new, &there_and_back(&new, Format::Caliscope), "caliscope");
}

/// The hand-clicked pose there is some 5 px off; the refined one, kept beside it, is what it should be near.
#[test]
fn a_real_opencv_xml_puts_the_board_s_camera_near_its_refined_place() {
    let Some(path) = real("s05_voxel_4cam_seated/data/cam1/config.xml") else { return };
    let options = ImportOptions { image_size: Some([644, 486]), metres_per_unit: Some(1e-3), ..Default::default() };
    let calibration = Calibration::load_with(&path, &options).unwrap();
    let camera = &calibration.cameras[0].camera;
    assert!((camera.intrinsics.focal[0] - 490.756439).abs() < 1e-9);
    assert!((camera.distortion.k3 + 0.0712014362).abs() < 1e-12);
    let refined = Isometry3::new(
        Vector3::new(0.213109813, 0.748549327, 4.58776568),
        Vector3::new(-1.34755187, 0.544553621, 0.622654746),
    );
    let refined = Camera { camera_from_world: refined, ..camera.clone() };
    assert!((camera.centre() - refined.centre()).norm() < 1.6, "{} {}", camera.centre(), refined.centre());
    let turn = camera.camera_from_world.rotation.angle_to(&refined.camera_from_world.rotation);
    assert!(turn < 0.1, "{turn}");
    let alone = path.with_file_name("intrinsics.xml");
    let error = Calibration::load_with(&alone, &options).unwrap_err().to_string();
    assert!(error.contains("a lens without a pose"), "{error}");
    let error = Calibration::load(&path).unwrap_err().to_string();
    assert!(error.contains("no image size"), "{error}");
    let board = path.with_file_name("../checkerboard.xml");
    let error = Calibration::load_with(&board, &options).unwrap_err().to_string();
    assert!(error.contains("no camera_matrix"), "{error}");
}

/// Exported again, a real result gives the files' own numbers: the rays of `.cal` and the projections.
#[test]
fn a_real_result_of_multicamselfcal_survives_its_own_form() {
    let Some(folder) = real("s01_arctic_laser_4cam/reference_multicamselfcal") else { return };
    let imported = Calibration::load(&folder).unwrap();
    check_same(&without_k3(&imported), &there_and_back(&without_k3(&imported), Format::MultiCamSelfCal), "arctic");
    // The centres in .cal, but for Z, which its left-handed world turns.
    for NamedCamera { name, camera } in &imported.cameras {
        let text = fs::read_to_string(folder.join(format!("{name}.cal"))).unwrap();
        let value = |key: &str| -> f64 {
            text.lines().find_map(|line| line.strip_prefix(key)?.split_once('=')?.1.trim().parse().ok()).unwrap()
        };
        let theirs = Point3::new(value("C1 "), value("C2 "), -value("C3 "));
        assert!((camera.centre() - theirs).norm() < 1e-4, "{name}: {} {theirs}", camera.centre());
    }
}

fn without_k3(calibration: &Calibration) -> Calibration {
    let mut changed = calibration.clone();
    changed.cameras.iter_mut().for_each(|it| it.camera.distortion.k3 = 0.0);
    changed
}

/// `.cal` holds C and the inverse of P's left half: checked on a result of the original program, to its six digits.
#[test]
fn rays_in_cal_files_are_the_inverse_of_the_projection() {
    let Some(folder) = real("s01_arctic_laser_4cam/reference_multicamselfcal") else { return };
    let numbers: Vec<f64> = fs::read_to_string(folder.join("Pmatrices.dat"))
        .unwrap()
        .split_whitespace()
        .take(12)
        .map(|it| it.parse().unwrap())
        .collect();
    let left = nalgebra::Matrix3::from_fn(|row, column| numbers[4 * row + column]);
    let inverse = left.try_inverse().unwrap();
    let text = fs::read_to_string(folder.join("arctic1.cal")).unwrap();
    for (row, column) in (0..9).map(|it| (it / 3, it % 3)) {
        let key = format!("P{}{} =", row + 1, column + 1);
        let value: f64 = text.lines().find_map(|line| line.strip_prefix(&key)?.trim().parse().ok()).unwrap();
        assert!((value - inverse[(row, column)]).abs() < 2e-6, "{key} {value} {}", inverse[(row, column)]);
    }
}
