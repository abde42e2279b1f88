//! Files as OpenCV 5.0.0 wrote them: what has one dimension is no matrix of one row or column there any more.

use super::*;

const YAML: &str = include_str!("opencv5.yml");
const XML: &str = include_str!("opencv5.xml");
const JSON: &str = include_str!("opencv5.json");

fn load(name: &str, text: &str) -> Result<Calibration, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    Calibration::load(&path).map_err(|error| error.to_string())
}

#[test]
fn one_camera_in_each_of_its_three_forms_is_the_same() {
    let [yaml, xml, json] =
        [("left.yml", YAML), ("left.xml", XML), ("left.json", JSON)].map(|it| load(it.0, it.1).unwrap());
    let camera = yaml.camera("left").unwrap();
    assert_eq!((camera.image_size, camera.intrinsics.focal), ([640, 480], [600.0, 601.0]));
    assert_eq!(camera.distortion, Distortion { k1: -0.2, k2: 0.05, p1: 1e-3, p2: -2e-3, k3: 0.0 });
    assert!((camera.camera_from_world.rotation.scaled_axis() - Vector3::new(0.1, -0.2, 0.3)).norm() < 1e-12);
    assert_eq!(camera.camera_from_world.translation.vector, Vector3::new(0.1, 0.2, 3.0));
    assert_eq!((yaml.camera("left"), yaml.camera("left")), (xml.camera("left"), json.camera("left")));
}

#[test]
fn a_folder_takes_opencv_s_json_and_leaves_other_programs_alone() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [("a.yml", YAML), ("b.json", JSON), ("notes.json", "{\"who\": 1}")] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let names: Vec<String> = Calibration::load(folder.path()).unwrap().cameras.into_iter().map(|it| it.name).collect();
    assert_eq!(names, ["a", "b"]);
}

#[test]
fn sizes_that_do_not_fit_are_named() {
    let fault = load("left.yml", &YAML.replace("sizes: [ 5 ]", "sizes: [ 6 ]")).unwrap_err();
    assert!(
        fault.contains("left.yml:10:1") && fault.contains("distortion_coefficients of 1 x 6 holds 5 numbers"),
        "{fault}"
    );
    let fault = load("left.json", &JSON.replace("\"sizes\": [ 5 ]", "\"sizes\": [ \"five\" ]")).unwrap_err();
    assert!(fault.contains("distortion_coefficients"), "{fault}");
    let fault = load("left.xml", &XML.replace("<sizes>\n    5</sizes>", "")).unwrap_err();
    assert!(fault.contains("distortion_coefficients without rows and cols"), "{fault}");
    assert!(load("left.json", &JSON[..200]).unwrap_err().contains("this is not JSON"));
    // Three channels of one element, as a vector of three is in other versions, and two dimensions as two sizes.
    let three = YAML.replace(
        "sizes: [ 3 ]\n   dt: d\n   data: [ 0.10000000000000001, 0.2",
        "sizes: [ 1, 1 ]\n   dt: \"3d\"\n   data: [ 0.10000000000000001, 0.2",
    );
    assert_ne!(three, YAML);
    let [three, one] = [&three, YAML].map(|it| load("left.yml", it).unwrap());
    assert_eq!(three.camera("left"), one.camera("left"));
}
