//! `export.voxels`: voxels as PLY and GLB.
//!
//! | file | what |
//! |---|---|
//! | `voxels_NUMBER.ply` | binary, little endian: the faces of the voxels' surface, as squares of two triangles with colours, in metres of the world |
//! | `voxels_NUMBER.glb` | the same for viewers; y up |
//! | `voxels_NUMBER_points.ply` | optional: the centre of each surface voxel (optionally of inner ones, too) with its colour, the views that saw it, the views that dissent, and its component |
//!
//! Numbers count the received sets of voxels. Source: G. Turk, "The PLY polygon file format", 1994.

use std::collections::HashSet;

use foveate::prelude::*;
use nalgebra::{Isometry3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::gltf::mesh_glb;
use crate::surface::ply as mesh_ply;
use crate::whole_file::{Faults, WholeFile};

ports! {
    VOXELS: In<Voxels> = each("voxels");
}

figures! {
        "export.voxel_sets": count, neither, "Sets of voxels written";
}

/// Settings of [`ExportVoxels`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportVoxelsSettings {
    /// Whether PLY files of the faces are written [–]
    pub ply: bool,
    /// Whether GLB files of the faces are written [–]
    pub glb: bool,
    /// Whether PLY files of the centres of surface voxels are written [–]
    pub points: bool,
    /// Whether these include inner voxels: for volumes, not for comparisons with surfaces [–]
    pub inside: bool,
    /// Every n-th set is written [–]
    #[schemars(range(min = 1, max = 1000000))]
    pub every_n: u64,
    /// Most sets that are written [–]
    #[schemars(range(min = 1, max = 100000))]
    pub max_sets: u64,
}

impl Default for ExportVoxelsSettings {
    fn default() -> Self {
        Self { ply: true, glb: true, points: false, inside: false, every_n: 50, max_sets: 20 }
    }
}

/// Voxels in, files out.
pub struct ExportVoxels {
    settings: ExportVoxelsSettings,
    file: WholeFile,
    n_come: u64,
    written: u64,
    report: Report,
}

impl Node for ExportVoxels {
    const TYPE: &'static str = "export.voxels";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes voxels as PLY and GLB";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ExportVoxelsSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportVoxelsSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("every_n", settings.every_n, 1..=1_000_000)?;
        ConfigError::unless_in("max_sets", settings.max_sets, 1..=100_000)?;
        setup.claim_file(None, "voxels_*")?;
        let file = WholeFile::new(setup, "voxels.ply");
        Ok(Self { settings, file, n_come: 0, written: 0, report: Report::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(voxels) = io.take(&VOXELS) else { return Ok(()) };
        let number = self.n_come;
        self.n_come += 1;
        let ExportVoxelsSettings { ply, glb, points, inside, every_n, max_sets } = self.settings;
        if !number.is_multiple_of(every_n) || self.written >= max_sets || !self.file.is_wanted() {
            return Ok(());
        }
        self.written += 1;
        let stem = format!("voxels_{number:06}");
        let mesh = faces(&voxels.value);
        let mut faults = Faults::default();
        let mut put = |name: String, bytes: &[u8]| faults.note(self.file.named(name).write(bytes, &mut self.report));
        if ply {
            put(format!("{stem}.ply"), &mesh_ply(&mesh, &stem));
        }
        if glb {
            let bytes = mesh_glb(&mesh, &stem).map_err(|it| {
                NodeError::input(format!("{stem}.glb would have {it} bytes, expected fewer than 4 GB"))
            })?;
            put(format!("{stem}.glb"), &bytes);
        }
        if points {
            put(format!("{stem}_points.ply"), &points_ply(&voxels.value, inside));
        }
        faults.end()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.files.append(&mut self.report.files);
        report.figure("export.voxel_sets", self.written as f64);
        Ok(())
    }
}

/// The faces of the voxels' surface, in metres of the world: corners are shared by faces of one direction and one colour only, so that edges stay sharp.
pub fn faces(voxels: &Voxels) -> Mesh {
    let list: Vec<Voxel> = voxels.iter().collect();
    let places: HashSet<[u16; 3]> = list.iter().map(|it| it.index).collect();
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let pose = voxels.world_from_scale;
    for voxel in list.iter().filter(|it| it.is_surface) {
        for side in 0..6 {
            let (axis, is_far) = (side / 2, side % 2 == 1);
            let beside = match is_far {
                true => voxel.index[axis].checked_add(1),
                false => voxel.index[axis].checked_sub(1),
            };
            let mut neighbour = voxel.index;
            if let Some(at) = beside {
                neighbour[axis] = at;
                if places.contains(&neighbour) {
                    continue;
                }
            }
            let first = vertices.len() as u32;
            let normal = Vector3::ith(axis, if is_far { 1.0 } else { -1.0 });
            for corner in 0..4 {
                let mut at = voxel.index.map(f64::from);
                at[axis] += f64::from(u8::from(is_far));
                at[(axis + 1) % 3] += f64::from(corner & 1);
                at[(axis + 2) % 3] += f64::from(corner >> 1);
                let position = pose * (voxels.origin + Vector3::from(at) * voxels.size);
                vertices.push(MeshVertex {
                    position: Point3::from(position.coords.cast::<f32>()),
                    normal: (pose.rotation * normal).cast::<f32>(),
                    weight: f32::from(voxel.seen),
                    sigma: (voxels.size / 12f64.sqrt()) as f32,
                    colour: voxel.colour,
                });
            }
            let quads = if is_far { [[0, 1, 3], [0, 3, 2]] } else { [[0, 3, 1], [0, 2, 3]] };
            triangles.extend(quads.map(|it| it.map(|corner| first + corner)));
        }
    }
    Mesh { time: voxels.time, world_from_mesh: Isometry3::identity(), ..Mesh::new(vertices, &triangles) }
}

/// The centre of each surface voxel, and with `inside` of all others, as a binary PLY file, in metres of the world.
pub fn points_ply(voxels: &Voxels, inside: bool) -> Vec<u8> {
    let wanted = || voxels.iter().filter(|it| inside || it.is_surface);
    let n = wanted().count();
    let mut header = format!("ply\nformat binary_little_endian 1.0\ncomment metres\nelement vertex {n}\n");
    ["x", "y", "z"].iter().for_each(|it| header += &format!("property float {it}\n"));
    for property in ["red", "green", "blue", "seen", "dissent"] {
        header += &format!("property uchar {property}\n");
    }
    header += "property ushort component\nend_header\n";
    let mut bytes = header.into_bytes();
    for voxel in wanted() {
        let point = voxels.world_from_scale * voxels.centre(voxel.index);
        bytes.extend(point.iter().flat_map(|it| (*it as f32).to_le_bytes()));
        bytes.extend(voxel.colour);
        bytes.extend([voxel.seen, voxel.dissent]);
        bytes.extend(voxel.component.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use foveate::geometry::surface::ply::read;
    use foveate_testkit::check_node;

    use super::*;

    /// Two voxels side by side and one apart.
    fn voxels() -> Voxels {
        let mut voxels = Voxels { size: 0.5, origin: Point3::new(1.0, 0.0, 0.0), cells: [4; 3], ..Voxels::default() };
        for (index, colour) in [([0, 0, 0], [9, 8, 7]), ([1, 0, 0], [255, 0, 0]), ([3, 3, 3], [0, 0, 1])] {
            voxels.push(&Voxel { index, colour, is_surface: true, seen: 4, ..Voxel::default() });
        }
        voxels
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<ExportVoxels>("");
        check_node::<ExportVoxels>("points = true\ninside = true\nevery_n = 7");
    }

    #[test]
    fn faces_enclose_what_the_voxels_hold() {
        let mesh = faces(&voxels());
        assert_eq!(mesh.triangles().count(), 2 * (10 + 6));
        let corners: Vec<Point3<f32>> = mesh.vertices().map(|it| it.position).collect();
        let volume: f32 = mesh
            .triangles()
            .map(|it| it.map(|corner| corners[corner as usize].coords))
            .map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0)
            .sum();
        assert!((volume - 3.0 * 0.125).abs() < 1e-6, "{volume}: triangles turn the wrong way");
        let read = read(&mesh_ply(&mesh, "test")).unwrap();
        assert_eq!((read.points.len(), read.triangles.len()), (64, 32));
    }

    #[test]
    fn points_are_read_back() {
        let read_back = read(&points_ply(&voxels(), false)).unwrap();
        assert_eq!(read_back.points[2], Point3::new(2.75, 1.75, 1.75));
        let mut with_inside = voxels();
        with_inside.push(&Voxel { index: [1, 1, 1], is_surface: false, ..Voxel::default() });
        let count = |inside: bool| read(&points_ply(&with_inside, inside)).unwrap().points.len();
        assert_eq!([count(false), count(true)], [3, 4]);
    }
}
