//! `export.surface`: the joined surface as PLY and GLB, and as pictures from the front.
//!
//! | file | what |
//! |---|---|
//! | `NAME.ply` | binary, little endian: x, y, z [m], nx, ny, nz, red, green, blue, weight, sigma [m] of each vertex; triangles |
//! | `NAME.glb` | the same for viewers; y up, `_SIGMA` and `_WEIGHT` beside positions, normals and colours |
//! | `NAME_shaded.png` | the bare surface from the front, lit from the upper left |
//! | `NAME_range.png` | 16 bits a pixel: distance from a plane in front of the surface in units of `range_unit_mm`; 0 where there is none |
//!
//! With `each_moment`, every surface is written, as `NAME_0001` and so on, one per moment; all pictures have the view of the first one.
//!
//! The front is the mean direction of the normals; for a closed surface it is the side of the calibration's cameras (of the first one, where they are all around). Pictures have no perspective.

mod view;

use std::sync::Arc;

use foveate::estimation::statistics::median;
use foveate::prelude::*;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cloud::encoded;
use crate::gltf::mesh_glb;
use crate::whole_file::{Faults, WholeFile};
use view::Frame;

ports! {
    SURFACE: In<Mesh> = each("surface");
}

figures! {
        "export.triangles": count, neither, "Triangles of the surface written; with several surfaces the median";
}

/// Settings of [`ExportSurface`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportSurfaceSettings {
    /// File names without their extensions [–]
    pub name: String,
    /// Whether a PLY file is written [–]
    pub ply: bool,
    /// Whether a GLB file is written [–]
    pub glb: bool,
    /// Whether a range and a shaded picture are written [–]
    pub pictures: bool,
    /// Whether every surface is written with a number, and not only the last one: for deforming objects, with `each_moment` of `structured_light.surface` [–]
    pub each_moment: bool,
    /// Most surfaces that are written then [–]
    #[schemars(range(min = 1, max = 100000))]
    pub max_surfaces: u64,
    /// Height of the pictures [px]
    #[schemars(range(min = 16, max = 8192))]
    pub height_px: u32,
    /// Size of one gray level of the range picture [mm]
    #[schemars(range(min = 0.0001, max = 1000.0))]
    pub range_unit_mm: f64,
}

impl Default for ExportSurfaceSettings {
    fn default() -> Self {
        Self {
            name: "surface".to_owned(),
            ply: true,
            glb: true,
            pictures: true,
            each_moment: false,
            max_surfaces: 1000,
            height_px: 900,
            range_unit_mm: 0.01,
        }
    }
}

/// Surfaces in, files of the last one or of each out.
pub struct ExportSurface {
    settings: ExportSurfaceSettings,
    file: WholeFile,
    last: Option<Arc<Mesh>>,
    /// Surfaces written, and surfaces beyond the limit.
    written: u64,
    left_out: u64,
    triangles: Vec<f64>,
    frame: Option<Frame>,
    report: Report,
    /// Positions of the cameras [m].
    cameras: Vec<Point3<f64>>,
}

impl Node for ExportSurface {
    const TYPE: &'static str = "export.surface";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes surfaces as PLY and GLB, with range and shaded pictures";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportSurfaceSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportSurfaceSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("height_px", settings.height_px, 16..=8192)?;
        ConfigError::unless_in("range_unit_mm", settings.range_unit_mm, 1e-4..=1000.0)?;
        ConfigError::unless_in("max_surfaces", settings.max_surfaces, 1..=100_000)?;
        let first = if settings.each_moment { numbered(&settings.name, 1) } else { settings.name.clone() };
        for ending in [".ply", ".glb", "_range.png", "_shaded.png"] {
            setup.claim_named_file("name", &format!("{first}{ending}"))?;
        }
        let cameras = setup.calibration.cameras.iter().map(|it| it.camera.centre()).collect();
        Ok(Self {
            file: WholeFile::new(setup, &settings.name),
            settings,
            last: None,
            written: 0,
            left_out: 0,
            triangles: Vec::new(),
            frame: None,
            report: Report::default(),
            cameras,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(mesh) = io.take(&SURFACE) {
            let before = self.last.replace(mesh.value);
            // A surface that comes again is more of the same moment.
            if let Some(before) = before.filter(|it| self.settings.each_moment && it.time != mesh.stamp.time) {
                self.write(&before)?;
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = self.settings.name.clone();
        let Some(mesh) = self.last.take() else {
            report.remark(format!("No surface came: no `{name}` was written."));
            return Ok(());
        };
        let written = self.write(&mesh);
        report.open_first = self.report.files.iter().find(|it| it.to_string_lossy().ends_with("_shaded.png")).cloned();
        report.files.append(&mut self.report.files);
        written?;
        if let Some(middle) = median(&self.triangles) {
            report.figure("export.triangles", middle);
        }
        if self.left_out > 0 && self.file.is_wanted() {
            let (n, all) = (self.settings.max_surfaces, self.settings.max_surfaces + self.left_out);
            report.remark(format!("the first {n} of {all} surfaces are written (`max_surfaces = {n}`)"));
        }
        Ok(())
    }
}

impl ExportSurface {
    fn write(&mut self, mesh: &Mesh) -> Result<(), NodeError> {
        if self.written >= self.settings.max_surfaces {
            self.left_out += 1;
            return Ok(());
        }
        self.written += 1;
        self.triangles.push(mesh.triangles().count() as f64);
        if !self.file.is_wanted() {
            return Ok(());
        }
        let name = match self.settings.each_moment {
            true => numbered(&self.settings.name, self.written),
            false => self.settings.name.clone(),
        };
        let report = &mut self.report;
        let mut faults = Faults::default();
        let mut put =
            |ending: &str, bytes: &[u8]| faults.note(self.file.named(format!("{name}{ending}")).write(bytes, report));
        if self.settings.ply {
            put(".ply", &ply(mesh, &name));
        }
        if self.settings.glb {
            let too_large =
                |it| NodeError::input(format!("{name}.glb would have {it} bytes, expected fewer than 4 GB"));
            put(".glb", &mesh_glb(mesh, &name).map_err(too_large)?);
        }
        if self.settings.pictures {
            self.frame = self.frame.or_else(|| Frame::of(mesh, &self.cameras, self.settings.height_px));
        }
        if let Some(view) = self.frame.map(|it| it.view(mesh)) {
            let range = view.range(1e-3 * self.settings.range_unit_mm);
            let gray = png::ColorType::Grayscale;
            put("_range.png", &encoded(view.size, gray, png::BitDepth::Sixteen, &range).map_err(NodeError::input)?);
            put(
                "_shaded.png",
                &encoded(view.size, gray, png::BitDepth::Eight, &view.shaded).map_err(NodeError::input)?,
            );
        }
        faults.end()
    }
}

fn numbered(name: &str, number: u64) -> String {
    format!("{name}_{number:04}")
}

/// A surface as a binary PLY file.
pub fn ply(mesh: &Mesh, name: &str) -> Vec<u8> {
    let (vertices, triangles): (Vec<MeshVertex>, Vec<[u32; 3]>) =
        (mesh.vertices().collect(), mesh.triangles().collect());
    let name = name.replace(['\n', '\r'], " ");
    let mut header =
        format!("ply\nformat binary_little_endian 1.0\ncomment metres, {name}\nelement vertex {}\n", vertices.len());
    for property in ["x", "y", "z", "nx", "ny", "nz"] {
        header += &format!("property float {property}\n");
    }
    for property in ["red", "green", "blue"] {
        header += &format!("property uchar {property}\n");
    }
    header += "property float weight\nproperty float sigma\n";
    header += &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", triangles.len());
    let mut bytes = header.into_bytes();
    for it in &vertices {
        let (p, n) = (it.position, it.normal);
        bytes.extend([p.x, p.y, p.z, n.x, n.y, n.z].iter().flat_map(|it| it.to_le_bytes()));
        bytes.extend(it.colour);
        bytes.extend([it.weight, it.sigma].iter().flat_map(|it| it.to_le_bytes()));
    }
    for triangle in triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|it| it.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// A square of 10 cm that faces along y, with a bump of 2 cm in its middle.
    pub(super) fn roof() -> Mesh {
        let vertex = |x: f32, y: f32, z: f32| MeshVertex {
            position: Point3::new(x, y, z),
            normal: Vector3::y(),
            weight: 3.0,
            sigma: 1e-4,
            colour: [10, 20, 30],
        };
        let corners = [[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]];
        let mut vertices: Vec<MeshVertex> = corners.iter().map(|it| vertex(it[0], 0.0, it[1])).collect();
        vertices.push(vertex(0.0, 0.02, 0.0));
        Mesh::new(vertices, &[[1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]])
    }

    fn setup(folder: &std::path::Path) -> Setup {
        Setup { out_dir: Some(folder.to_owned()), ..Setup::for_tests() }
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportSurface>("height_px = 64\nname = \"face\"");
    }

    #[test]
    fn the_last_surface_becomes_four_files() {
        let folder = tempfile::tempdir().unwrap();
        let mut bench =
            NodeBench::<ExportSurface>::with_setup(ExportSurfaceSettings::default(), &setup(folder.path())).unwrap();
        bench.feed(&SURFACE, Time::ZERO, Mesh::new([], &[])).unwrap();
        bench.feed(&SURFACE, Time::from_s(1.0), roof()).unwrap();
        let report = bench.finish().unwrap();
        assert_eq!((report.files.len(), report.figures["export.triangles"]), (4, 4.0));
        let bytes = std::fs::read(folder.path().join("surface.ply")).unwrap();
        let end = b"end_header\n";
        let start = bytes.windows(end.len()).position(|it| it == end).unwrap() + end.len();
        let header = String::from_utf8(bytes[..start].to_vec()).unwrap();
        assert!(header.contains("element vertex 5\n") && header.contains("element face 4\n"), "{header}");
        assert_eq!(bytes.len() - start, 5 * 35 + 4 * 13);
        assert_eq!(bytes[bytes.len() - 13..], [3, 0, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0]);
        let range = image::open(folder.path().join("surface_range.png")).unwrap().into_luma16();
        let (columns, rows) = range.dimensions();
        let level = |x: u32, y: u32| f64::from(range.get_pixel(x, y).0[0]);
        // The middle is 2 cm nearer than the corners.
        let nearer_mm = 0.01 * (level(columns / 2 + rows / 2 - rows / 16, rows / 2) - level(columns / 2, rows / 2));
        assert!((14.0..19.0).contains(&nearer_mm), "{nearer_mm}");
        assert_eq!(range.get_pixel(0, 0).0[0], 0);
    }

    #[test]
    fn each_moment_has_files_of_its_own_seen_from_one_place() {
        let folder = tempfile::tempdir().unwrap();
        let settings =
            ExportSurfaceSettings { each_moment: true, max_surfaces: 2, height_px: 64, ..Default::default() };
        let mut bench = NodeBench::<ExportSurface>::with_setup(settings, &setup(folder.path())).unwrap();
        let at = |s: f64, mesh: Mesh| Mesh { time: Time::from_s(s), ..mesh };
        let whole = roof();
        let aside = whole.vertices().map(|it| MeshVertex { position: it.position + Vector3::x() * 0.02, ..it });
        let moved = Mesh::new(aside, &whole.triangles().collect::<Vec<_>>());
        // Of the first moment a part, then all.
        let part = Mesh::new(whole.vertices(), &[[1, 0, 4]]);
        for (s, mesh) in [(0.0, part), (0.0, roof()), (1.0, moved), (2.0, roof())] {
            bench.feed(&SURFACE, Time::from_s(s), at(s, mesh)).unwrap();
        }
        let report = bench.finish().unwrap();
        assert_eq!((report.files.len(), report.figures["export.triangles"]), (8, 4.0));
        assert!(report.remarks[0].contains("the first 2 of 3 surfaces"), "{:?}", report.remarks);
        let shaded = |number: u32| {
            let picture = image::open(folder.path().join(format!("surface_000{number}_shaded.png"))).unwrap();
            picture.into_luma8()
        };
        let (first, second) = (shaded(1), shaded(2));
        assert_eq!(first.dimensions(), second.dimensions());
        let columns = |it: &image::GrayImage| it.enumerate_pixels().filter(|it| it.2.0[0] > 0).map(|it| it.0).max();
        assert_ne!(columns(&first), columns(&second), "it has moved in the picture");
        let ply = std::fs::read(folder.path().join("surface_0001.ply")).unwrap();
        assert!(String::from_utf8_lossy(&ply).contains("element face 4\n"), "the whole of the first moment");
    }

    #[test]
    fn a_run_without_a_surface_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let bench = NodeBench::<ExportSurface>::with_setup(ExportSurfaceSettings::default(), &setup(folder.path()));
        let report = bench.unwrap().finish().unwrap();
        assert!(report.files.is_empty() && report.remarks[0].contains("No surface came"), "{:?}", report.remarks);
    }
}
