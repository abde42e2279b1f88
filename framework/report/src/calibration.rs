//! The section on the calibration: where it comes from, and each camera with its stated uncertainty.

use std::path::{Path, PathBuf};

use toml::Value;

use crate::folder::{self, Folder};
use crate::page::{Html, Page, Table};
use crate::words::{natural, number};

/// Writes the section.
pub(crate) fn write(page: &mut Page, folder: &Folder) {
    page.section("calibration", "Calibration");
    if let Err(sentence) = &folder.rig {
        page.missing(&format!("{sentence} It would name the calibration."));
        return;
    }
    let Some(name) = folder.of_rig("calibration").and_then(Value::as_str).filter(|it| !it.is_empty()) else {
        page.paragraph("The rig names no calibration.");
        return;
    };
    let path = place(folder, name);
    match folder::toml_table(&path) {
        Err(what) => page.missing(&format!("The calibration `{}` {what}.", path.display())),
        Ok(calibration) => {
            page.paragraph(&format!(
                "The calibration is read from `{name}` as it is now; it may have changed since the run."
            ));
            page.table(&provenance(&calibration));
            if !calibration.contains_key("provenance") {
                page.missing("The calibration does not say where it comes from: it has no `[provenance]`.");
            }
            let cameras = cameras(&calibration);
            if cameras.is_empty() {
                page.missing(
                    "The calibration has no `[camera.…]`: it has the form of another program, which `foveate convert` reads.",
                );
            }
            page.table(&cameras);
            page.note(
                "± is one standard deviation, as the calibration states it; a dash where it states none. The position's is the one in its worst direction. \
                 It says how well the observations fix the camera, not whether the camera was moved afterwards.",
            );
        }
    }
}

/// Where the calibration lies: below the folder of the rig, unless its path is whole.
fn place(folder: &Folder, name: &str) -> PathBuf {
    let beside_rig = || folder.of_rig("folder").and_then(Value::as_str).map_or(folder.path.as_path(), Path::new);
    folder.session.as_ref().map_or_else(beside_rig, |it| &it.files).join(name)
}

/// What the calibration says of itself.
fn provenance(calibration: &toml::Table) -> Table {
    let mut table = Table::new("What the calibration says of itself", &[("entry", false), ("value", false)]);
    for section in ["calibration", "provenance"] {
        for (key, value) in calibration.get(section).and_then(Value::as_table).into_iter().flatten() {
            table.row(&[Html::text(&key.replace('_', " ")), Html::text(&in_words(key, value))]);
        }
    }
    table
}

/// A value of the provenance, with the unit of its σ.
fn in_words(key: &str, value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Float(it) => number(*it),
        Value::Array(list) => list.iter().map(|it| in_words(key, it)).collect::<Vec<_>>().join(", "),
        Value::Table(table) => {
            let by = table.get("fixed_by").and_then(Value::as_str);
            let sigma = table.get("sigma").and_then(as_number).map(|it| match key {
                "scale" => format!("{} %", number(1e2 * it)),
                "gravity" => format!("{}°", number(it.to_degrees())),
                "origin" => format!("{} mm", number(1e3 * it)),
                _ => number(it),
            });
            match (by, sigma) {
                (Some(by), Some(sigma)) => format!("{by}, ± {sigma}"),
                (Some(by), None) => format!("{by}, uncertainty not stated"),
                _ => {
                    table.iter().map(|(key, it)| format!("{key} {}", in_words(key, it))).collect::<Vec<_>>().join(", ")
                }
            }
        }
        other => other.to_string(),
    }
}

fn as_number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|it| it as f64))
}

/// The numbers of a list, if it has `N` of them.
fn numbers<const N: usize>(value: Option<&Value>) -> Option<[f64; N]> {
    let list: Option<Vec<f64>> = value?.as_array()?.iter().map(as_number).collect();
    list?.try_into().ok()
}

/// One row a camera.
fn cameras(calibration: &toml::Table) -> Table {
    let is_metres =
        calibration.get("calibration").and_then(|it| it.get("length_unit")).and_then(Value::as_str) == Some("m");
    let position_head = if is_metres { "position [m]" } else { "position [unit not known]" };
    let spread_head = if is_metres { "± [mm]" } else { "± [thousandths]" };
    let mut table = Table::new(
        "Cameras and their stated uncertainty",
        &[
            ("camera", false),
            ("picture [px]", true),
            ("focal length [px]", true),
            (position_head, true),
            (spread_head, true),
            ("direction ± [mrad]", true),
        ],
    );
    let dash = || "–".to_owned();
    let mut cameras: Vec<_> = calibration.get("camera").and_then(Value::as_table).into_iter().flatten().collect();
    cameras.sort_by_key(|it| natural(it.0));
    for (name, camera) in cameras {
        let about = camera.get("uncertainty");
        let size = numbers::<2>(camera.get("image_size_px")).map_or_else(dash, |[x, y]| format!("{x} × {y}"));
        let focal = numbers::<2>(camera.get("focal_px")).map_or_else(dash, |[x, _]| {
            let sigma = numbers::<2>(about.and_then(|it| it.get("focal_sigma_px")));
            sigma.map_or_else(|| number(x), |sigma| format!("{} ± {}", number(x), rounded(sigma[0])))
        });
        let position = numbers::<3>(camera.get("position_m"));
        let place = position.map_or_else(dash, |it| it.map(|it| foveate_plot::text::fixed(it, 3)).join(", "));
        let covariance = about.and_then(|it| it.get("pose_covariance")).and_then(covariance);
        let spread = covariance.zip(position).map(|(covariance, position)| centre_sigma(&covariance, position));
        let turn = covariance.map(|it| worst(&block(&it)));
        let cells = [spread, turn].map(|it| it.filter(|it| it.is_finite()).map_or_else(dash, |it| rounded(1e3 * it)));
        let [spread, turn] = cells;
        let cells = [size, focal, place, spread, turn].map(|it| Html::text(&it));
        let [size, focal, place, spread, turn] = cells;
        table.row(&[Html::name(name), size, focal, place, spread, turn]);
    }
    table
}

fn rounded(value: f64) -> String {
    foveate_plot::text::rounded(value)
}

type Matrix3 = [[f64; 3]; 3];

fn covariance(value: &Value) -> Option<[[f64; 6]; 6]> {
    let rows: Option<Vec<[f64; 6]>> = value.as_array()?.iter().map(|it| numbers::<6>(Some(it))).collect();
    rows?.try_into().ok()
}

/// The covariance of the rotation alone [rad²].
fn block(covariance: &[[f64; 6]; 6]) -> Matrix3 {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| covariance[row][column]))
}

/// Standard deviation of the camera's centre in its worst direction, in the unit of `centre`. With δ = [ω, v] of docs/notation.md, T exp(δ) has its centre c at
/// c − ω × c − v, so the covariance is J Σ Jᵀ with J = [[c]×, −1].
fn centre_sigma(covariance: &[[f64; 6]; 6], [x, y, z]: [f64; 3]) -> f64 {
    let by_pose = [[0.0, -z, y, -1.0, 0.0, 0.0], [z, 0.0, -x, 0.0, -1.0, 0.0], [-y, x, 0.0, 0.0, 0.0, -1.0]];
    let all = || (0..6).flat_map(|k| (0..6).map(move |l| (k, l)));
    worst(&by_pose.map(|a| by_pose.map(|b| all().map(|(k, l)| a[k] * covariance[k][l] * b[l]).sum())))
}

/// Square root of the largest eigenvalue of a symmetric matrix, in closed form [O. K. Smith, "Eigenvalues of a symmetric 3 × 3 matrix", Communications of the ACM 4(4), 1961].
fn worst(matrix: &Matrix3) -> f64 {
    let mean = (matrix[0][0] + matrix[1][1] + matrix[2][2]) / 3.0;
    let off = matrix[0][1].powi(2) + matrix[0][2].powi(2) + matrix[1][2].powi(2);
    let spread = ((0..3).map(|it| (matrix[it][it] - mean).powi(2)).sum::<f64>() / 6.0 + off / 3.0).sqrt();
    if spread <= 1e-12 * mean.abs() {
        return mean.max(0.0).sqrt();
    }
    let [a, b, c] = [0, 1, 2]
        .map(|row| [0, 1, 2].map(|column| (matrix[row][column] - if row == column { mean } else { 0.0 }) / spread));
    let determinant =
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    let angle = (determinant / 2.0).clamp(-1.0, 1.0).acos() / 3.0;
    (mean + 2.0 * spread * angle.cos()).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_eigenvalue_is_that_of_matrices_with_known_ones() {
        // [[2, 1], [1, 2]] has 3 and 1.
        let cases = [
            ([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.5]], 3.0),
            ([[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]], 4.0),
            ([[1e-8, 0.0, 0.0], [0.0, 9e-8, 0.0], [0.0, 0.0, 0.0]], 9e-8),
            ([[0.0; 3]; 3], 0.0),
        ];
        for (matrix, expected) in cases {
            let found = worst(&matrix).powi(2);
            assert!((found - expected).abs() <= 1e-9 * expected, "{found} for {expected}");
        }
    }

    #[test]
    fn a_turn_moves_the_centre_by_its_distance_from_the_origin() {
        let mut covariance = [[0.0; 6]; 6];
        covariance[2][2] = 1e-6; // 1 mrad about z
        assert!((centre_sigma(&covariance, [3.0, 4.0, 7.0]) - 5e-3).abs() < 1e-12, "5 m from the z axis");
        assert!((worst(&block(&covariance)) - 1e-3).abs() < 1e-12);
        covariance[2][2] = 0.0;
        covariance[4][4] = 4e-6; // 2 mm along y
        assert!((centre_sigma(&covariance, [3.0, 4.0, 7.0]) - 2e-3).abs() < 1e-12);
    }

    #[test]
    fn a_camera_that_turns_about_its_centre_keeps_it() {
        let ([a, b, c], [x, y, z]) = ([0.3, -0.2, 0.5], [3.0, 4.0, 7.0]);
        // δ = [ω, v] with v = −ω × c.
        let delta = [a, b, c, -(b * z - c * y), -(c * x - a * z), -(a * y - b * x)];
        let covariance = delta.map(|row| delta.map(|column| row * column));
        assert!(centre_sigma(&covariance, [x, y, z]) < 1e-6, "{}", centre_sigma(&covariance, [x, y, z]));
        let turn = (a * a + b * b + c * c).sqrt();
        assert!((worst(&block(&covariance)) - turn).abs() < 1e-9);
    }

    #[test]
    fn sigmas_of_the_provenance_have_their_units() {
        let of = |text: &str| {
            let table: toml::Table = text.parse().unwrap();
            let (key, value) = table.iter().next().unwrap();
            in_words(key, value)
        };
        assert_eq!(of("scale = { fixed_by = \"a wand\", sigma = 0.0005 }"), "a wand, ± 0.05 %");
        assert_eq!(of("gravity = { fixed_by = \"a floor\" }"), "a floor, uncertainty not stated");
        assert_eq!(of("origin = { fixed_by = \"points\", sigma = 0.0024 }"), "points, ± 2.4 mm");
        assert_eq!(of("sources = [\"a\", \"b\"]"), "a, b");
    }
}
