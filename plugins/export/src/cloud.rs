//! `export.cloud`: point clouds as PLY and GLB, and as range, normal and shaded pictures in the pixels of the camera that saw them.
//!
//! | file | what |
//! |---|---|
//! | `CAMERA_SET.ply` | binary, little endian: x, y, z [m], nx, ny, nz, red, green, blue, confidence, sigma [m] of each point |
//! | `CAMERA_SET.glb` | points with colours, normals, sigma and confidence, for viewers; y up |
//! | `CAMERA_SET_range.png` | 16 bits a pixel: depth along the camera's axis in units of `range_unit_mm`, in the pixel of each point; 0 elsewhere |
//! | `CAMERA_SET_shaded.png` | 8 bits a pixel: the surface lit from the upper left of the camera; 0 where there is no point |
//! | `CAMERA_SET_normals.png` | 8 bits a channel: x, y, z of the normals in the cloud's space, −1 to 1 as 1 to 255; 0 where there is none |
//!
//! The last two are for viewing: points of a cloud that has fewer than one point per pixel are drawn as squares, each as wide as the distance to the next (module `dots`). The range picture is for programs.
//!
//! SET is the cloud's name; a cloud without a name, as of live measurement, has the number of its moment from 1 on, where a moment without a cloud leaves a gap. A second file of one name ends in `_2`.
//!
//! Clouds at `cloud` are in the world. Those at `joined` are in the space of the scale that registered them, in which a moving object is still: their files end in `_target`.
//!
//! Source: G. Turk, "The PLY polygon file format", 1994.

use std::collections::BTreeMap;

use foveate::prelude::*;
use foveate::scene::{Calibration, LengthUnit};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::file_part;
use crate::dots::Dots;
use crate::gltf::cloud_glb;
use crate::whole_file::{Faults, WholeFile};

ports! {
    CLOUD: In<PointCloud> = each("cloud").many().optional();
    JOINED: In<ScaleCloud> = each("joined").many().optional();
}

figures! {
        "export.clouds": count, neither, "Point clouds written";
}

/// Settings of [`ExportCloud`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportCloudSettings {
    /// Whether PLY files are written [–]
    pub ply: bool,
    /// Whether GLB files of the points are written [–]
    pub glb: bool,
    /// Whether range, normal and shaded pictures are written [–]
    pub pictures: bool,
    /// Size of one gray level of a range picture: at 0.1, 16 bits reach 6.5 m [mm]
    #[schemars(range(min = 0.0001, max = 1000.0))]
    pub range_unit_mm: f64,
    /// Most clouds that are written [–]
    #[schemars(range(min = 1, max = 100000))]
    pub max_clouds: u64,
}

impl Default for ExportCloudSettings {
    fn default() -> Self {
        Self { ply: true, glb: false, pictures: true, range_unit_mm: 0.1, max_clouds: 1000 }
    }
}

/// Point clouds in, files out.
pub struct ExportCloud {
    settings: ExportCloudSettings,
    calibration: std::sync::Arc<Calibration>,
    file: WholeFile,
    names: BTreeMap<String, u64>,
    written: u64,
    left_out: u64,
    /// Points too far away for range pictures.
    far: u64,
    report: Report,
}

impl Node for ExportCloud {
    const TYPE: &'static str = "export.cloud";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes point clouds as PLY and GLB, with range, normal and shaded pictures";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportCloudSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportCloudSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("range_unit_mm", settings.range_unit_mm, 1e-4..=1000.0)?;
        ConfigError::unless_in("max_clouds", settings.max_clouds, 1..=100_000)?;
        setup.claim_file(None, "*.ply")?;
        Ok(Self {
            settings,
            calibration: setup.calibration.clone(),
            file: WholeFile::new(setup, "cloud.ply"),
            names: BTreeMap::new(),
            written: 0,
            left_out: 0,
            far: 0,
            report: Report::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(cloud) = io.take(&CLOUD) {
            self.take(&cloud.value, "", cloud.stamp.sequence)?;
        }
        while let Some(joined) = io.take(&JOINED) {
            self.take(&joined.value.cloud, "_target", joined.stamp.sequence)?;
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.open_first = self.report.files.iter().find(|it| it.to_string_lossy().ends_with("_shaded.png")).cloned();
        report.files.append(&mut self.report.files);
        report.figure("export.clouds", self.written as f64);
        if self.left_out > 0 && self.file.is_wanted() {
            let (n, all) = (self.written, self.written + self.left_out);
            report.remark(format!("the first {n} of {all} point clouds are written (`max_clouds = {n}`)"));
        }
        if self.far > 0 {
            let (n, unit) = (self.far, self.settings.range_unit_mm);
            report.remark(format!(
                "{n} points are farther away than {:.1} m, the limit of a range picture of 65535 steps of {unit} mm, and are 0 there: set a larger `range_unit_mm`",
                65.535 * unit
            ));
        }
        if self.calibration.length_unit != LengthUnit::Metre && self.written > 0 {
            report.remark(
                "lengths in the files of point clouds are in the calibration's own unit, whose length in metres is unknown: state it with `foveate convert --metres-per-unit`",
            );
        }
        Ok(())
    }
}

impl ExportCloud {
    /// A file prefix that no earlier cloud has: a repeated prefix gets a `_2`. Clouds without a name have the number of their moment; `sequence` counts from 0.
    fn free_stem(&mut self, camera: &str, name: &str, ending: &str, sequence: u64) -> String {
        let stem = match name {
            "" => file_part(&format!("{camera}{ending}_{}", sequence.saturating_add(1))),
            name => file_part(&format!("{camera}_{name}{ending}")),
        };
        loop {
            let again = self.names.entry(stem.clone()).or_default();
            *again += 1;
            let numbered = if *again == 1 { stem.clone() } else { format!("{stem}_{again}") };
            if numbered == stem || self.names.get(&numbered).is_none_or(|it| *it == 0) {
                self.names.entry(numbered.clone()).or_insert(1);
                return numbered;
            }
        }
    }

    fn take(&mut self, cloud: &PointCloud, ending: &str, sequence: u64) -> Result<(), NodeError> {
        if self.written >= self.settings.max_clouds || !self.file.is_wanted() {
            self.left_out += 1;
            return Ok(());
        }
        self.written += 1;
        self.write(cloud, ending, sequence)
    }

    fn write(&mut self, cloud: &PointCloud, ending: &str, sequence: u64) -> Result<(), NodeError> {
        let calibration = self.calibration.clone();
        let camera = calibration.cameras.get(usize::from(cloud.camera.0));
        let camera_name = camera.map_or_else(|| cloud.camera.0.to_string(), |it| it.name.clone());
        let stem = self.free_stem(&camera_name, &cloud.name, ending, sequence);
        let mut faults = Faults::default();
        let mut put = |name: String, bytes: &[u8]| faults.note(self.file.named(name).write(bytes, &mut self.report));
        if self.settings.ply {
            let unit = if calibration.length_unit == LengthUnit::Metre { "metres" } else { "unit unknown" };
            put(format!("{stem}.ply"), &ply(cloud, unit));
        }
        if self.settings.glb {
            let bytes = cloud_glb(cloud, &stem).map_err(|it| {
                NodeError::input(format!("{stem}.glb would have {it} bytes, expected fewer than 4 GB"))
            })?;
            put(format!("{stem}.glb"), &bytes);
        }
        let viewpoint = cloud.viewpoint.map(|it| it.camera_from_space);
        if let Some(camera_from_space) = viewpoint.or_else(|| Some(camera?.camera.camera_from_world))
            && self.settings.pictures
        {
            let [columns, rows] = cloud.camera_size;
            let n = columns as usize * rows as usize;
            let (mut range, mut shaded, mut normals) = (vec![0_u16; n], vec![0_u8; n], vec![0_u8; 3 * n]);
            let mut dots = Dots::of(cloud);
            for point in cloud.iter() {
                let at = usize::from(point.pixel[1]) * columns as usize + usize::from(point.pixel[0]);
                let Some(range) = range.get_mut(at).filter(|_| u32::from(point.pixel[0]) < columns) else { continue };
                let depth_mm = 1e3 * (camera_from_space * point.position.cast::<f64>()).z;
                let steps = (depth_mm / self.settings.range_unit_mm).round();
                if steps > 65_535.0 {
                    self.far += 1;
                } else {
                    *range = steps.max(0.0) as u16;
                }
                let light = shade(&(camera_from_space.rotation * point.normal.cast::<f64>()));
                let known = (point.normal != Vector3::zeros()).then_some(point.normal);
                let colour = known.map(|it| [0, 1, 2].map(|axis| (128.0 + 127.0 * it[axis]).round() as u8));
                dots.around(point.pixel, |at| {
                    shaded[at] = light;
                    normals[3 * at..3 * at + 3].copy_from_slice(&colour.unwrap_or([0; 3]));
                });
            }
            let range: Vec<u8> = range.iter().flat_map(|it| it.to_be_bytes()).collect();
            for (ending, kind, bits, pixels) in [
                ("range", png::ColorType::Grayscale, png::BitDepth::Sixteen, &range),
                ("shaded", png::ColorType::Grayscale, png::BitDepth::Eight, &shaded),
                ("normals", png::ColorType::Rgb, png::BitDepth::Eight, &normals),
            ] {
                let picture = encoded([columns, rows], kind, bits, pixels).map_err(NodeError::input)?;
                put(format!("{stem}_{ending}.png"), &picture);
            }
        }
        faults.end()
    }
}

/// Brightness of a surface with `normal` in the space of a camera, lit from the camera's upper left.
pub(crate) fn shade(normal: &Vector3<f64>) -> u8 {
    let light = Vector3::new(-0.5, -0.6, -1.0).normalize();
    (20.0 + 235.0 * normal.dot(&light).max(0.0)) as u8
}

/// A PNG of `size` (columns, rows).
pub(crate) fn encoded(
    [columns, rows]: [u32; 2],
    kind: png::ColorType,
    bits: png::BitDepth,
    pixels: &[u8],
) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, columns, rows);
    encoder.set_color(kind);
    encoder.set_depth(bits);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(bytes)
}

/// A cloud as a binary PLY file, whose header says that lengths are in `unit`.
pub fn ply(cloud: &PointCloud, unit: &str) -> Vec<u8> {
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment {unit}, {}\nelement vertex {}\n",
        cloud.name.replace(['\n', '\r'], " "),
        cloud.len()
    );
    for property in ["x", "y", "z", "nx", "ny", "nz"] {
        header += &format!("property float {property}\n");
    }
    for property in ["red", "green", "blue"] {
        header += &format!("property uchar {property}\n");
    }
    header += "property float confidence\nproperty float sigma\nend_header\n";
    let mut bytes = header.into_bytes();
    for point in cloud.iter() {
        let (p, n) = (point.position, point.normal);
        bytes.extend([p.x, p.y, p.z, n.x, n.y, n.z].iter().flat_map(|it| it.to_le_bytes()));
        bytes.extend(point.colour);
        bytes.extend([point.confidence, point.sigma()].iter().flat_map(|it| it.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;

    fn cloud() -> PointCloud {
        let mut cloud = PointCloud { name: "pose 1".into(), camera_size: [4, 3], ..PointCloud::default() };
        for x in 0..3_u16 {
            cloud.push(&CloudPoint {
                position: Point3::new(f32::from(x), 0.5, 2.0),
                covariance: Matrix3::identity() * 1e-6,
                normal: -Vector3::z(),
                confidence: 0.5,
                pixel: [x, 1],
                colour: [10, 20, 30],
            });
        }
        cloud
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportCloud>("range_unit_mm = 0.5");
    }

    #[test]
    fn a_ply_file_has_a_record_of_35_bytes_for_each_point() {
        let bytes = ply(&cloud(), "metres");
        let end = b"end_header\n";
        let start = bytes.windows(end.len()).position(|it| it == end).unwrap() + end.len();
        let header = String::from_utf8(bytes[..start].to_vec()).unwrap();
        assert!(header.contains("element vertex 3\n") && header.contains("property uchar blue\n"), "{header}");
        let records: Vec<&[u8]> = bytes[start..].chunks(35).collect();
        assert_eq!((records.len(), records[2].len()), (3, 35));
        assert_eq!(records[2][..4], 2.0_f32.to_le_bytes());
        assert_eq!(records[2][24..27], [10, 20, 30]);
        assert_eq!(records[2][31..], 1e-3_f32.to_le_bytes());
    }

    #[test]
    fn files_are_called_by_camera_and_set_or_moment_and_none_twice() {
        let mut export = ExportCloud::new(ExportCloudSettings::default(), &Setup::for_tests()).unwrap();
        let mut stem = |name: &str, ending: &str, sequence: u64| export.free_stem("left", name, ending, sequence);
        let names = ["pose", "pose", "pose_2", "1"].map(|it| stem(it, "", 7));
        assert_eq!(names, ["left_pose", "left_pose_2", "left_pose_2_2", "left_1"]);
        // The moment numbered 1 has no cloud.
        let numbered = [0, 2, 3, 2].map(|it| stem("", "", it));
        assert_eq!(numbered, ["left_1_2", "left_3", "left_4", "left_3_2"]);
        assert_eq!(stem("", "_target", 4), "left_target_5");
    }

    #[test]
    fn a_cloud_of_a_run_becomes_a_ply_file_and_two_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let calibration = foveate_testkit::scene::ring_calibration(4);
        let out_dir = Some(folder.path().to_owned());
        let setup = Setup { calibration: std::sync::Arc::new(calibration), out_dir, ..Setup::for_tests() };
        let mut bench = NodeBench::<ExportCloud>::with_setup(ExportCloudSettings::default(), &setup).unwrap();
        bench.feed(&CLOUD, Time::ZERO, cloud()).unwrap();
        bench.feed(&CLOUD, Time::from_s(1.0), cloud()).unwrap();
        let report = bench.finish().unwrap();
        assert_eq!((report.files.len(), report.figures["export.clouds"]), (8, 2.0));
        let range = report.files.iter().find(|it| it.to_string_lossy().contains("range")).unwrap();
        let picture = image::open(folder.path().join(range)).unwrap();
        assert_eq!((picture.width(), picture.height(), picture.color()), (4, 3, image::ColorType::L16));
    }

    #[test]
    fn unknown_units_and_points_beyond_range_pictures_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let mut calibration = foveate_testkit::scene::ring_calibration(4);
        calibration.length_unit = LengthUnit::Unknown;
        let out_dir = Some(folder.path().to_owned());
        let setup = Setup { calibration: std::sync::Arc::new(calibration), out_dir, ..Setup::for_tests() };
        let mut bench = NodeBench::<ExportCloud>::with_setup(ExportCloudSettings::default(), &setup).unwrap();
        // As a calibration in millimetres has it.
        let viewpoint = Some(Viewpoint { camera_from_space: nalgebra::Isometry3::translation(0.0, 0.0, 1998.0) });
        bench.feed(&CLOUD, Time::ZERO, PointCloud { viewpoint, ..cloud() }).unwrap();
        let report = bench.finish().unwrap();
        let said = report.remarks.join("; ");
        assert!(said.contains("3 points are farther away than 6.6 m"), "{said}");
        assert!(said.contains("`foveate convert --metres-per-unit`"), "{said}");
        let file = report.files.iter().find(|it| it.to_string_lossy().ends_with(".ply")).unwrap();
        let header = String::from_utf8_lossy(&std::fs::read(folder.path().join(file)).unwrap()[..80]).into_owned();
        assert!(header.contains("comment unit unknown") && !header.contains("metres"), "{header}");
    }
}
