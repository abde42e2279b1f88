//! A wall of displays and how each camera images it: a file of its own, written by a calibration and named by rigs.
//!
//! ```toml
//! [wall]
//! size_m = [4.132, 1.292]       # of what the wall can show; x to the right, y down from its top left corner
//! pixel_m = 0.0008              # side of one of the wall's pixels
//!
//! [camera.wall-1]
//! image_size_px = [640, 480]
//! homography = [0.8, 0.0, -0.6, 0.0, 0.8, -0.5, 0.01, 0.02, 1.0]   # row by row: from metres on the wall to half widths of the picture about its middle
//! distortion = { k1 = -0.01, k2 = 0.0, k3 = 0.0, p1 = 0.0, p2 = 0.0 }
//! covariance = [0.0]            # 13 x 13 numbers row by row, in the order of `geometry::PlaneMap`
//! held_out_px = 0.06            # error at dots that the fit did not know, root mean square, in pixels of the wall
//! brightest = 131               # brightest that a dot of the wall was in this camera's pictures [gray level]
//! mesh = { size_m = [4.132, 1.292], cells = [12, 4], shifts_m = [0.0], sigmas_m = [0.0] }   # only where the wall bends: `geometry::plane_map::Mesh`, x and y in turn
//! ```

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use foveate_geometry::plane_map::Mesh;
use foveate_geometry::{Distortion, PlaneMap};
use nalgebra::{Matrix3, SMatrix, Vector2};
use toml::de::DeTable;

use crate::error::CalibrationError;
use crate::text::key;
use crate::text::read_text;
use crate::toml_reader::{Reader, Value, read};

const SECTIONS: [&str; 2] = ["wall", "camera"];
const WALL_KEYS: [&str; 2] = ["size_m", "pixel_m"];
const CAMERA_KEYS: [&str; 7] =
    ["image_size_px", "homography", "distortion", "covariance", "held_out_px", "brightest", "mesh"];
const MESH_KEYS: [&str; 4] = ["size_m", "cells", "shifts_m", "sigmas_m"];
const LENS_KEYS: [&str; 5] = ["k1", "k2", "k3", "p1", "p2"];
/// More cells along an axis than this are a mistake, and would take memory.
const MOST_CELLS: f64 = 200.0;
/// A mesh and its wall may differ by this much in size: numbers written by hand [m].
const SAME_SIZE_M: f64 = 1e-3;
const N: usize = foveate_geometry::plane_map::UNKNOWNS;

/// A wall, and the cameras that see it.
#[derive(Debug, Clone, PartialEq)]
pub struct WallMap {
    /// Width and height of what the wall can show [m].
    pub size_m: [f64; 2],
    /// Side of one of the wall's pixels [m].
    pub pixel_m: f64,
    /// By the camera's name.
    pub cameras: BTreeMap<String, WallCamera>,
}

/// How a camera sees the wall.
#[derive(Debug, Clone, PartialEq)]
pub struct WallCamera {
    /// From the wall to pixels and back.
    pub map: PlaneMap,
    /// Error at dots that the fit did not know, root mean square [px of the wall].
    pub held_out_px: f64,
    /// Brightest pixel of a displayed dot, median over dots [gray level].
    pub brightest: f64,
}

impl WallMap {
    /// Reads a file.
    ///
    /// # Errors
    /// All faults with their places.
    pub fn load(path: &Path) -> Result<WallMap, CalibrationError> {
        WallMap::from_toml(&read_text(path)?, path)
    }

    /// As [`WallMap::load`], from the text of the file; `path` is for the messages.
    ///
    /// # Errors
    /// As [`WallMap::load`].
    pub fn from_toml(text: &str, path: &Path) -> Result<WallMap, CalibrationError> {
        read(text, path, |reader, root, whole| {
            reader.refuse_unknown(root, "section", &SECTIONS);
            let wall = reader.required_table(root, "wall", whole.clone()).and_then(|(table, at)| {
                reader.refuse_unknown(table, "key of wall", &WALL_KEYS);
                let size = reader.numbers::<2>(table, "size_m", at.clone());
                let pixel = reader.positive(table, "pixel_m", at.clone());
                if size.is_some_and(|it| it.iter().any(|side| *side <= 0.0)) {
                    let at = table.get("size_m").map_or(at, |it| it.span());
                    reader.report(at, "size_m has a side of 0 or less".into(), "two numbers above 0".into());
                }
                Some((size?, pixel?))
            });
            let mut cameras = BTreeMap::new();
            if let Some((table, at)) = reader.required_table(root, "camera", whole) {
                if table.is_empty() {
                    reader.report(at, "no camera".into(), "a section for each camera, such as [camera.wall-1]".into());
                }
                for (name, value) in table {
                    reader.camera = Some(name.get_ref().to_string());
                    if let Some(camera) = reader.wall_camera(value, wall.map(|it| it.0)) {
                        cameras.insert(name.get_ref().to_string(), camera);
                    }
                }
                reader.camera = None;
            }
            let (size_m, pixel_m) = wall.unwrap_or(([1.0; 2], 1.0));
            WallMap { size_m, pixel_m, cameras }
        })
    }

    /// As it stands in a file. Reading it gives the same numbers.
    pub fn to_toml(&self) -> String {
        let mut text = format!("[wall]\nsize_m = {:?}\npixel_m = {:?}\n", self.size_m, self.pixel_m);
        for (name, WallCamera { map, held_out_px, brightest }) in &self.cameras {
            let PlaneMap { image_size, ideal_from_plane, distortion, covariance, mesh } = map;
            let Distortion { k1, k2, k3, p1, p2 } = distortion;
            let [h, c] = [ideal_from_plane.transpose().as_slice().to_vec(), covariance.as_slice().to_vec()];
            // Writing to a String cannot fail.
            let _ = write!(
                text,
                "\n[camera.{}]\nimage_size_px = {image_size:?}\nhomography = {h:?}\ndistortion = {{ k1 = {k1:?}, k2 = {k2:?}, k3 = {k3:?}, p1 = {p1:?}, p2 = {p2:?} }}\n\
                 held_out_px = {held_out_px:?}\nbrightest = {brightest:?}\ncovariance = {c:?}\n",
                key(name)
            );
            if let Some(Mesh { size_m, cells, shifts_m, sigmas_m }) = mesh {
                let [shifts, sigmas] =
                    [shifts_m, sigmas_m].map(|it| it.iter().flat_map(|it| [it.x, it.y]).collect::<Vec<f64>>());
                let _ = writeln!(
                    text,
                    "mesh = {{ size_m = {size_m:?}, cells = {cells:?}, shifts_m = {shifts:?}, sigmas_m = {sigmas:?} }}"
                );
            }
        }
        text
    }
}

impl Reader<'_> {
    fn positive(&mut self, table: &DeTable<'_>, name: &str, at: std::ops::Range<usize>) -> Option<f64> {
        let value = self.required(table, name, "a number above 0", at)?;
        let number = self.number(value, name)?;
        self.expect(Some(number).filter(|it| *it > 0.0), value, name, "a number above 0")
    }

    /// How the wall, of size `wall_m` where that could be read, bends before a camera.
    fn mesh(&mut self, value: &Value<'_>, wall_m: Option<[f64; 2]>) -> Option<Mesh> {
        let at = value.span();
        let table = self.expect(value.get_ref().as_table(), value, "mesh", "a table")?;
        self.refuse_unknown(table, "key of mesh", &MESH_KEYS);
        let size_m = self.numbers::<2>(table, "size_m", at.clone());
        let cells = self.numbers::<2>(table, "cells", at.clone());
        let (size_m, cells) = (size_m?, cells?);
        let given = |key: &str| table.get(key).unwrap_or(value);
        let is_size = size_m.iter().all(|it| *it > 0.0);
        self.expect(is_size.then_some(()), given("size_m"), "size_m", "two numbers above 0")?;
        let are_cells = cells.iter().all(|it| it.fract() == 0.0 && (1.0..=MOST_CELLS).contains(it));
        self.expect(are_cells.then_some(()), given("cells"), "cells", "two whole numbers from 1 to 200")?;
        let cells = cells.map(|it| it as usize);
        if let Some(wall) = wall_m.filter(|it| (0..2).any(|axis| (it[axis] - size_m[axis]).abs() > SAME_SIZE_M)) {
            let expected = format!("the wall's own size, {wall:?}");
            self.expect(None::<()>, given("size_m"), "size_m of mesh", &expected)?;
        }
        let long = usize::from(size_m[1] > size_m[0]);
        let fits = cells[long] >= cells[1 - long];
        self.expect(
            fits.then_some(()),
            given("cells"),
            "cells",
            "as many cells along the wall's longer side as along the other, or more",
        )?;
        let shifts = self.number_list(table, "shifts_m", 2 * Mesh::n_splines(cells), at.clone());
        let sigmas = self.number_list(table, "sigmas_m", 2 * Mesh::n_corners(cells), at);
        let pairs = |it: Vec<f64>| it.chunks_exact(2).map(|it| Vector2::new(it[0], it[1])).collect::<Vec<_>>();
        let (shifts, sigmas) = (shifts?, sigmas?);
        let are_sigmas = sigmas.iter().all(|it| *it >= 0.0);
        self.expect(are_sigmas.then_some(()), given("sigmas_m"), "sigmas_m", "standard deviations, none below 0")?;
        Some(Mesh { size_m, cells, shifts_m: pairs(shifts), sigmas_m: pairs(sigmas) })
    }

    /// A camera before a wall of that size, where that could be read.
    fn wall_camera(&mut self, value: &Value<'_>, wall_m: Option<[f64; 2]>) -> Option<WallCamera> {
        let at = value.span();
        let table = self.expect(value.get_ref().as_table(), value, "camera", "a table such as [camera.wall-1]")?;
        self.refuse_unknown(table, "key of camera", &CAMERA_KEYS);
        let size = self.numbers::<2>(table, "image_size_px", at.clone());
        let h = self.numbers::<9>(table, "homography", at.clone());
        let lens = self.required_table(table, "distortion", at.clone()).and_then(|(lens, at)| {
            self.refuse_unknown(lens, "key of distortion", &LENS_KEYS);
            let mut terms = [0.0; 5];
            for (term, name) in terms.iter_mut().zip(LENS_KEYS) {
                let value = self.required(lens, name, "a number", at.clone())?;
                *term = self.number(value, name)?;
            }
            let [k1, k2, k3, p1, p2] = terms;
            Some(Distortion { k1, k2, p1, p2, k3 })
        });
        let covariance = self.numbers::<{ N * N }>(table, "covariance", at.clone());
        let held_out_px = self.positive(table, "held_out_px", at.clone());
        let brightest = self.positive(table, "brightest", at);
        let mesh = table.get("mesh").map(|it| self.mesh(it, wall_m));
        let size = size?;
        let fits = size.iter().all(|it| it.fract() == 0.0 && (1.0..=65_536.0).contains(it));
        let given = table.get("image_size_px").unwrap_or(value);
        self.expect(fits.then_some(()), given, "image_size_px", "two whole numbers from 1 to 65536")?;
        let ideal_from_plane = Matrix3::from_row_slice(&h?);
        let given = table.get("homography").unwrap_or(value);
        let last = ideal_from_plane[(2, 2)];
        let turns = ideal_from_plane.try_inverse().is_some() && last == 1.0;
        self.expect(
            turns.then_some(()),
            given,
            "homography",
            "9 numbers of a matrix that can be inverted, the last one 1",
        )?;
        let covariance = SMatrix::<f64, N, N>::from_row_slice(&covariance?);
        let most = covariance.amax();
        let given = table.get("covariance").unwrap_or(value);
        let symmetric = (covariance - covariance.transpose()).amax() <= 1e-9 * most;
        let positive = covariance.diagonal().iter().all(|it| *it >= 0.0);
        self.expect(
            (symmetric && positive).then_some(()),
            given,
            "covariance",
            "a covariance: symmetric, none of its diagonal below 0",
        )?;
        let mesh = match mesh {
            Some(mesh) => Some(mesh?),
            None => None,
        };
        let image_size = size.map(|it| it as u32);
        let map = PlaneMap { image_size, ideal_from_plane, distortion: lens?, covariance, mesh };
        Some(WallCamera { map, held_out_px: held_out_px?, brightest: brightest? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> WallMap {
        let camera = |k1: f64, mesh: Option<Mesh>| WallCamera {
            map: PlaneMap {
                image_size: [640, 480],
                ideal_from_plane: Matrix3::new(0.8, 0.01, -0.6, 0.02, 0.8, -0.5, 0.01, 0.02, 1.0),
                distortion: Distortion { k1, k2: 0.1, p1: 1e-4, p2: 2e-4, k3: -0.3 },
                covariance: SMatrix::from_fn(|r, c| if r == c { 1e-7 } else { 1e-9 * (r + c) as f64 }),
                mesh,
            },
            held_out_px: 0.07,
            brightest: 130.5,
        };
        let vectors = |n: usize| (0..n).map(|it| Vector2::new(0.001 * it as f64, 1e-7)).collect::<Vec<_>>();
        let mesh = Mesh { size_m: [4.1, 1.3], cells: [2, 1], shifts_m: vectors(20), sigmas_m: vectors(6) };
        let cameras =
            [("wall-1".to_owned(), camera(-0.2, None)), ("wall 2".to_owned(), camera(0.1, Some(mesh)))].into();
        WallMap { size_m: [4.1, 1.3], pixel_m: 8e-4, cameras }
    }

    #[track_caller]
    fn refusal(from: &str, to: &str) -> String {
        let text = map().to_toml();
        assert!(text.contains(from), "{text}");
        WallMap::from_toml(&text.replace(from, to), Path::new("w.toml")).unwrap_err().to_string()
    }

    #[test]
    fn what_is_written_is_read() {
        assert_eq!(WallMap::from_toml(&map().to_toml(), Path::new("w.toml")).unwrap(), map());
    }

    #[test]
    fn faults_are_named_with_their_place() {
        for (from, to, says) in [
            ("pixel_m = 0.0008", "pixel_m = -1", "expected a number above 0"),
            ("pixel_m", "pixels_m", "did you mean"),
            ("640, 480", "640.5, 480", "two whole numbers"),
            ("homography = [0.8", "homography = [\"a\"", "a finite number"),
            ("0.01, 0.02, 1.0]", "0.01, 0.02, 2.0]", "the last one 1"),
            ("k1 = -0.2, ", "", "k1 is missing"),
            ("brightest = 130.5", "", "brightest is missing"),
            ("cells = [2, 1]", "cells = [2, 1.5]", "two whole numbers from 1 to 200"),
            ("cells = [2, 1]", "cells = [2, 2]", "expected 50 numbers"),
            ("cells = [2, 1]", "cell = [2, 1]", "did you mean"),
            ("cells = [2, 1]", "cells = [1, 2]", "along the wall's longer side"),
            ("mesh = { size_m = [4.1", "mesh = { size_m = [3.9", "the wall's own size, [4.1, 1.3]"),
            ("sigmas_m = [0.0", "sigmas_m = [-1.0", "none below 0"),
            ("mesh = {", "mesch = {", "did you mean"),
            ("covariance = [1e-7", "covariance = [-1e-7", "none of its diagonal below 0"),
        ] {
            let message = refusal(from, to);
            assert!(message.contains(says) && message.contains("w.toml"), "{message}");
        }
        assert!(refusal("homography", "homographie").contains("wall-1"));
        let empty = WallMap::from_toml("[wall]\nsize_m = [1, 1]\npixel_m = 0.1\n[camera]\n", Path::new("w.toml"));
        assert!(empty.unwrap_err().to_string().contains("no camera"));
    }
}
