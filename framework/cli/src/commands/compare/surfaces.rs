//! `foveate compare A.ply B.ply`: how far a cloud or surface is from a reference.

use std::path::Path;

use foveate_diagnostics::file;
use foveate_geometry::surface::ply::{self, PlyShape};
use foveate_geometry::surface::{
    DistanceOptions, Distances, Placing, PlacingOptions, Shape, ShapeDistances, distances, place,
};
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::{CompareArgs, picture};
use crate::commands::motion_files::write_whole;
use crate::exit;
use crate::outcome::harmless;
use crate::output::say;
use crate::progress::Waiting;

/// Extents that differ by a factor from the first to the second are taken for millimetres beside metres.
const THOUSAND: [f64; 2] = [200.0, 5000.0];
/// Extents that differ by such a factor may be centimetres or inches beside metres.
const OTHER_UNITS: std::ops::Range<f64> = 20.0..200.0;
/// A shape of which nothing says the unit and that is larger than this would be a building [m].
const LARGE: f64 = 50.0;
/// Rotations from which places are tried: 26° between neighbours [–].
const STARTS: usize = 600;
/// Points from which on it takes seconds, and that is shown.
const MANY: usize = 200_000;
/// Places on a shape of triangles from which distances are measured.
const SAMPLES: usize = 100_000;
/// Default: B is covered where A has a point within so many times the distance between points of A.
const COVERS: f64 = 2.0;
/// With more of its points than this part beside B or too far away, `--within` fails [–].
const MOSTLY_BESIDE: f64 = 0.5;
/// With less of it on B than this, a placed A may lie in a wrong place [–].
const MOSTLY_ON: f64 = 0.5;
/// Without `--align`, a median beyond this part of B's extent means that they do not lie in one space [–].
const ELSEWHERE: f64 = 0.02;

/// A shape as it was read.
struct Loaded {
    name: &'static str,
    about: String,
    shape: PlyShape,
    metres_per_unit: f64,
    /// Where the unit is from.
    unit_by: &'static str,
}

/// Whether a file begins as a PLY does.
pub(super) fn is_ply(path: &Path) -> bool {
    let mut start = [0; 4];
    let read = file::open(path).and_then(|mut it| std::io::Read::read_exact(&mut it, &mut start));
    read.is_ok() && ply::is_ply(&start)
}

/// What was found, for the table, the files and the exit code.
struct Found {
    files: [Value; 2],
    lines: Vec<String>,
    notes: Vec<String>,
    placing: Option<Placing>,
    distances: ShapeDistances,
    covers: f64,
}

pub(super) fn run(args: &CompareArgs) -> Result<u8, String> {
    for (is_set, flag) in [(args.shift.is_some(), "--shift"), (args.pairing.is_some(), "--match")] {
        if is_set {
            return Err(format!("`{flag}` is for motion files: shapes have neither times nor names"));
        }
    }
    let mut a = load("A", &args.a, args.metres_per_unit_a)?;
    let mut b = load("B", &args.b, args.metres_per_unit_b)?;
    let mut notes = Vec::new();
    for it in [&a, &b].into_iter().filter(|it| it.shape.n_left_out > 0) {
        let n = it.shape.n_left_out;
        notes.push(format!("{}: {n} vertices are not finite, or too far from the others, and are left out", it.name));
    }
    notes.extend(agree_on_units(&mut a, &mut b));
    let files = [about(&a, &args.a), about(&b, &args.b)];
    let lines = [&a, &b].map(|it| format!("{}: {}, {}", it.name, it.about, unit_in_words(it))).to_vec();
    let shape_a = shape_of(&a)?;
    let mut shape_b = shape_of(&b)?;
    // Which side of B is outside: as B says, else as A says of the same place.
    let has_sides = |it: &Loaded| !it.shape.triangles.is_empty() || !it.shape.normals.is_empty();
    let most = args.farthest.map_or(f64::INFINITY, |it| it * 1e-3);
    let mut placing = None;
    let mut moved = shape_a.clone();
    let is_quick = a.shape.points.len() + b.shape.points.len() < MANY;
    let waiting = |what: &'static str| Waiting::new(what, is_quick);
    if args.align || args.scale {
        // Sides that one of them does not tell must not contradict those of the other.
        let of_a = if has_sides(&a) && has_sides(&b) { shape_a.clone() } else { shape_a.without_sides() };
        let options = PlacingOptions { scale: args.scale, n_starts: STARTS, most };
        let _waiting = waiting("laying A onto B");
        let found = place(&of_a, &shape_b, &options).map_err(|it| format!("A finds no place on B: {it}"))?;
        if found.n_open > 0 {
            notes.push(format!(
                "A slides along B in {} of 6 directions without a distance, as planes and spheres do: where it lies there is not known",
                found.n_open
            ));
        }
        if let Some((turn, shift)) = found.other {
            notes.push(format!(
                "the place is not unique: another one, turned by {:.0}° and moved by {:.1} mm, fits nearly as well: a symmetry, or too little shape",
                turn.to_degrees(),
                1e3 * shift
            ));
        }
        if found.overlap < MOSTLY_ON {
            notes.push(format!(
                "only {:.0} % of A lies on B: the place may be wrong, or A shows much that B does not; --out shows where it lies",
                100.0 * found.overlap
            ));
        }
        let points = shape_a.points().iter().map(|it| found.b_from_a * it).collect();
        let normals = shape_a.normals().iter().map(|it| found.b_from_a.isometry.rotation * it).collect();
        moved = Shape::new(points, normals, shape_a.triangles().to_vec(), &Point3::origin()).unwrap_or(moved);
        placing = Some(found);
    }
    let mut is_signed = true;
    if !has_sides(&b) {
        is_signed = has_sides(&a) && shape_b.turn_normals(&moved);
        if !is_signed {
            notes.push("the outside of B is unknown: distances are without a sign".to_owned());
        }
    }
    let covers = args.coverage_within.map_or(COVERS * moved.spacing().max(1e-9), |it| it * 1e-3);
    let measuring = waiting("measuring distances");
    let mut found = distances(&moved, &shape_b, &DistanceOptions { most, covers, n_samples: SAMPLES });
    drop(measuring);
    found.is_signed &= is_signed;
    if placing.is_none() && (found.to_second.n == 0 || found.to_second.median > ELSEWHERE * shape_b.extent()) {
        notes.push("A lies far from B for its size: if they are not in one space, `--align` lays A onto B".to_owned());
    }
    let found = Found { files, lines, notes, placing, distances: found, covers };
    finish(args, &found, &moved, &shape_b)
}

fn finish(args: &CompareArgs, found: &Found, a: &Shape, b: &Shape) -> Result<u8, String> {
    let figures = figures(found);
    let to_stdout = args.json.as_ref().is_some_and(|it| it.as_os_str() == "-");
    let text = format!("{figures:#}\n");
    match &args.json {
        Some(_) if to_stdout => say(&text),
        Some(path) => write_whole(path, text.as_bytes(), true)?,
        None => {}
    }
    let mut written = Vec::new();
    if let Some(folder) = &args.out {
        let shown = folder.display();
        std::fs::create_dir_all(folder).map_err(|it| format!("`{shown}` cannot be made: {it}"))?;
        let mut put = |name: &str, bytes: &[u8]| {
            written.push(name.to_owned());
            write_whole(&folder.join(name), bytes, true)
        };
        put("comparison.json", text.as_bytes())?;
        put("distances.svg", picture::svg(a, b, &found.distances).as_bytes())?;
        put("distances.ply", &picture::ply(a, &found.distances))?;
    }
    if !to_stdout {
        let mut text = words(found);
        if let Some(folder) = &args.out {
            text += &format!("results: {}/  {}\n", folder.display(), written.join("  "));
        }
        say(&text.split('\n').map(harmless).collect::<Vec<_>>().join("\n"));
    }
    let not_met = args.within.and_then(|it| not_met(&found.distances.to_second, it));
    if let Some(sentence) = &not_met {
        eprintln!("not met: {sentence}");
    }
    Ok(if not_met.is_none() { exit::DONE } else { exit::UNMET })
}

/// Why a shape is not within so many millimetres of another, if it is not.
fn not_met(found: &Distances, within: f64) -> Option<String> {
    let p95 = 1e3 * found.p95;
    let all = found.n + found.n_beside + found.n_far;
    let not_over = (found.n_beside + found.n_far) as f64 / all.max(1) as f64;
    // No distance at all is no promise kept.
    if p95.is_nan() {
        Some(format!("none of A's points lies over B, expected 95 % of them within {within} mm"))
    } else if p95 > within {
        Some(format!("95 % of A's points are within {p95:.3} mm of B, expected {within} mm"))
    } else if not_over > MOSTLY_BESIDE {
        Some(format!(
            "{:.0} % of A's points lie beside B or farther away than --farthest, where no distance says how right they are, expected half at most: cut A to what B shows",
            100.0 * not_over
        ))
    } else {
        None
    }
}

fn load(name: &'static str, path: &Path, metres_per_unit: Option<f64>) -> Result<Loaded, String> {
    let bytes = std::fs::read(path).map_err(|it| format!("`{}` cannot be read: {it}", path.display()))?;
    let fault =
        |it: &dyn std::fmt::Display| harmless(&format!("`{}` is no PLY file that can be read: {it}", path.display()));
    let shape = ply::read(&bytes).map_err(|it| fault(&it))?;
    let (metres_per_unit, unit_by) = match (metres_per_unit, shape.metres_per_unit) {
        (Some(given), _) => (given, "from the command line"),
        (None, Some(said)) => (said, "the file says"),
        (None, None) => (1.0, "taken"),
    };
    let what = match (shape.triangles.len(), shape.normals.is_empty()) {
        (0, true) => "points".to_owned(),
        (0, false) => "points with normals".to_owned(),
        (n, _) => format!("corners of {n} triangles"),
    };
    let about = harmless(&format!("{}: {} {what}", path.display(), shape.points.len()));
    Ok(Loaded { name, about, shape, metres_per_unit, unit_by })
}

/// Extent of what most points are: a few far away say nothing about a unit.
fn extent(it: &Loaded) -> f64 {
    let along = |axis: usize| {
        let mut values: Vec<f64> = it.shape.points.iter().map(|it| it[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[(values.len() - 1) * 95 / 100] - values[values.len() * 5 / 100]
    };
    it.metres_per_unit * Vector3::new(along(0), along(1), along(2)).norm()
}

/// Takes a shape of which nothing says the unit for one in millimetres where the other is a thousand times as small, and says so.
fn agree_on_units(a: &mut Loaded, b: &mut Loaded) -> Vec<String> {
    let is_thousand = |ratio: f64| (THOUSAND[0]..THOUSAND[1]).contains(&ratio);
    let [of_a, of_b] = [extent(a), extent(b)];
    let (large, ratio) = if of_b >= of_a { (&mut *b, of_b / of_a) } else { (&mut *a, of_a / of_b) };
    let flag = large.name.to_lowercase();
    if is_thousand(ratio) && large.unit_by == "taken" {
        large.metres_per_unit *= 1e-3;
        large.unit_by = "taken, because the other is a thousand times as small";
        return vec![format!(
            "{} is {ratio:.0} times as large as the other, and is taken to be in millimetres; --metres-per-unit-{flag} says it for certain",
            large.name
        )];
    }
    if is_thousand(ratio) {
        return vec![format!(
            "{} is {ratio:.0} times as large as the other although its unit is known: is the other in kilometres, or one of the two another thing? --metres-per-unit-a and -b say units",
            large.name
        )];
    }
    if OTHER_UNITS.contains(&ratio) && large.unit_by == "taken" {
        return vec![format!(
            "{} is {ratio:.0} times as large as the other, and nothing says its unit: --metres-per-unit-{flag} 0.01 if it is in centimetres, 0.0254 if it is in inches",
            large.name
        )];
    }
    let large = [&*a, &*b].into_iter().filter(|it| it.unit_by == "taken" && extent(it) > LARGE);
    large
        .map(|it| {
            let flag = it.name.to_lowercase();
            format!(
                "nothing says the unit of {}, and in metres it is {:.0} m large: if that is millimetres, --metres-per-unit-{flag} 0.001",
                it.name,
                extent(it)
            )
        })
        .collect()
}

fn unit_in_words(it: &Loaded) -> String {
    let unit = match it.metres_per_unit {
        1.0 => "m".to_owned(),
        1e-3 => "mm".to_owned(),
        other => format!("{other} m"),
    };
    format!("{unit} ({}), {:.4} m large", it.unit_by, extent(it))
}

fn about(it: &Loaded, path: &Path) -> Value {
    json!({
        "file": path.display().to_string(), "points": it.shape.points.len(), "triangles": it.shape.triangles.len(),
        "metres_per_unit": it.metres_per_unit, "unit_by": it.unit_by, "extent_m": extent(it),
    })
}

fn shape_of(it: &Loaded) -> Result<Shape, String> {
    let points = it.shape.points.iter().map(|at| at * it.metres_per_unit).collect();
    let shape = Shape::new(points, it.shape.normals.clone(), it.shape.triangles.clone(), &Point3::origin());
    shape.ok_or_else(|| format!("{} has no points", it.name))
}

fn figures(found: &Found) -> Value {
    let of = |it: &Distances| {
        json!({
            "points": it.n, "points_beside": it.n_beside, "points_too_far": it.n_far, "median_mm": it.median * 1e3,
            "p95_mm": it.p95 * 1e3, "rms_mm": it.rms * 1e3, "max_mm": it.max * 1e3,
            "mean_signed_mm": it.mean.filter(|_| found.distances.is_signed).map(|it| it * 1e3),
        })
    };
    let [a, b] = &found.files;
    let placing = found.placing.as_ref().map(|it| {
        let (t, q) = (it.b_from_a.isometry.translation, it.b_from_a.isometry.rotation.coords);
        json!({
            "rotation_xyzw": [q.x, q.y, q.z, q.w], "translation_m": [t.x, t.y, t.z], "scale": it.b_from_a.scaling(),
            "overlap": it.overlap, "sigma_mm": 1e3 * it.sigma, "directions_open": it.n_open,
            "is_ambiguous": it.other.is_some(),
        })
    });
    json!({
        "a": a, "b": b, "b_from_a": placing, "a_to_b": of(&found.distances.to_second), "b_to_a": of(&found.distances.to_first),
        "coverage": found.distances.coverage, "coverage_of_a": found.distances.coverage_of_first, "coverage_within_mm": 1e3 * found.covers, "notes": found.notes,
    })
}

fn words(found: &Found) -> String {
    let mut text: String = found.lines.iter().map(|it| format!("{it}\n")).collect();
    text.extend(found.notes.iter().map(|it| format!("note: {it}\n")));
    if let Some(placing) = &found.placing {
        let isometry = placing.b_from_a.isometry;
        let (turn, t) = (isometry.rotation.angle().to_degrees(), isometry.translation.vector * 1e3);
        text += &format!(
            "aligned: A turned by {turn:.3}° and moved by ({:.3}, {:.3}, {:.3}) mm; {:.1} % of it lie on B\n",
            t.x,
            t.y,
            t.z,
            100.0 * placing.overlap
        );
        let scale = placing.b_from_a.scaling();
        if scale != 1.0 {
            text += &format!("scale: A times {scale:.6}, which is {:+.3} %\n", 100.0 * (scale - 1.0));
        }
    }
    let sign = if found.distances.is_signed { "mean mm" } else { "" };
    text += &format!(
        "{:6}  {:>9}  {:>10}  {:>10}  {:>10}  {sign:>10}  {:>9}  {:>9}\n",
        "", "points", "median mm", "p95 mm", "rms mm", "beside", "too far"
    );
    for (name, it) in [("A to B", &found.distances.to_second), ("B to A", &found.distances.to_first)] {
        let number = |it: f64| if it.is_finite() { format!("{:.4}", it * 1e3) } else { "–".to_owned() };
        let mean =
            it.mean.filter(|_| found.distances.is_signed).map_or(String::new(), |it| format!("{:+.4}", it * 1e3));
        text += &format!(
            "{name:6}  {:>9}  {:>10}  {:>10}  {:>10}  {mean:>10}  {:>9}  {:>9}\n",
            it.n,
            number(it.median),
            number(it.p95),
            number(it.rms),
            it.n_beside,
            it.n_far
        );
    }
    text + &format!(
        "coverage: {:.1} % of A have a place of B within {covers:.3} mm, {:.1} % of B one of A\n",
        100.0 * found.distances.coverage_of_first,
        100.0 * found.distances.coverage,
        covers = 1e3 * found.covers,
    )
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use nalgebra::{Isometry3, UnitQuaternion};

    use super::*;

    #[derive(Parser)]
    struct Typed {
        #[command(flatten)]
        args: CompareArgs,
    }

    /// A hill of 20 cm with a smaller one on its side, as ASCII points; by rows and columns of so many, moved, in units of a metre over `per_metre`.
    fn hill(n: usize, moved: &Isometry3<f64>, per_metre: f64, comment: &str) -> String {
        let mut text = format!(
            "ply\nformat ascii 1.0\n{comment}element vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
            n * n
        );
        for it in 0..n * n {
            let [x, y] = [it % n, it / n].map(|it| it as f64 / (n - 1) as f64 - 0.5);
            let bump = |u: f64, v: f64, w: f64| (-((x - u).powi(2) + (y - v).powi(2)) / (w * w)).exp();
            let z = 0.3 * bump(0.0, 0.05, 0.25) + 0.15 * bump(0.3, -0.2, 0.1) + 0.1 * bump(-0.3, 0.3, 0.12);
            let at = moved * Point3::new(0.2 * x, 0.3 * y, 0.2 * z) * per_metre;
            text += &format!("{} {} {}\n", at.x, at.y, at.z);
        }
        text
    }

    /// Exit code and figures of a comparison of two such files.
    fn compared(a: &str, b: &str, more: &[&str]) -> (Result<u8, String>, Value) {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        std::fs::write(path("a.ply"), a).unwrap();
        std::fs::write(path("b.ply"), b).unwrap();
        let out = path("out");
        let words = ["compare", &path("a.ply"), &path("b.ply"), "--out", &out].map(str::to_owned);
        let all = words.into_iter().chain(more.iter().map(|it| (*it).to_owned()));
        let code = run(&Typed::try_parse_from(all).unwrap().args);
        let text = std::fs::read_to_string(Path::new(&out).join("comparison.json")).unwrap_or("null".to_owned());
        if code.is_ok() {
            let cloud = std::fs::read(Path::new(&out).join("distances.ply")).unwrap();
            assert!(ply::read(&cloud).is_ok() && Path::new(&out).join("distances.svg").exists());
        }
        (code, serde_json::from_str(&text).unwrap())
    }

    #[test]
    fn a_scan_in_another_space_and_unit_is_laid_on_its_reference() {
        let turn = UnitQuaternion::from_euler_angles(0.4, -2.0, 1.1);
        let moved = Isometry3::from_parts(nalgebra::Translation3::new(0.3, -0.8, 1.2), turn);
        let scan = hill(41, &moved, 1.0, "comment metres, scan\n");
        let reference = hill(90, &Isometry3::identity(), 1000.0, "");
        let (code, figures) = compared(&scan, &reference, &["--align", "--within", "0.5"]);
        assert_eq!(code, Ok(exit::DONE), "{figures:#}");
        assert!(figures["a_to_b"]["p95_mm"].as_f64().unwrap() < 0.1, "{figures:#}");
        assert!(figures["b_to_a"]["median_mm"].as_f64().unwrap() < 0.1, "{figures:#}");
        assert!(figures["coverage"].as_f64().unwrap() > 0.98, "{figures:#}");
        assert_eq!(figures["b"]["metres_per_unit"], 0.001);
        assert!(figures["notes"][0].as_str().unwrap().contains("taken to be in millimetres"), "{figures:#}");
        // Where it lies it is nowhere near.
        let (code, figures) = compared(&scan, &reference, &["--within", "0.5"]);
        assert_eq!(code, Ok(exit::UNMET));
        assert!(figures["notes"].to_string().contains("`--align` lays A onto B"), "{figures:#}");
    }

    #[test]
    fn a_scan_that_lies_mostly_beside_its_reference_keeps_no_promise() {
        let whole = hill(41, &Isometry3::identity(), 1.0, "comment metres\n");
        let reference = |until: f64| {
            let is_kept =
                |it: &&str| it.split(' ').next().and_then(|it| it.parse().ok()).is_some_and(|x: f64| x < until);
            let points = hill(41, &Isometry3::identity(), 1.0, "");
            let (_, points) = points.split_once("end_header\n").unwrap();
            let kept: Vec<&str> = points.lines().filter(is_kept).collect();
            let (header, _) = whole.split_once("end_header\n").unwrap();
            let header = header.replace("vertex 1681", &format!("vertex {}", kept.len()));
            format!("{header}end_header\n{}\n", kept.join("\n"))
        };
        for (until, expected) in [(-0.03, exit::UNMET), (0.03, exit::DONE)] {
            let (code, figures) = compared(&whole, &reference(until), &["--within", "1"]);
            assert_eq!(code, Ok(expected), "up to {until} m: {figures:#}");
        }
    }

    #[test]
    fn units_that_are_neither_metres_nor_millimetres_are_suggested() {
        let scan = hill(41, &Isometry3::identity(), 1.0, "comment metres\n");
        let reference = hill(90, &Isometry3::identity(), 100.0, "");
        let (_, figures) = compared(&scan, &reference, &[]);
        assert!(
            figures["notes"][0].as_str().unwrap().contains("--metres-per-unit-b 0.01 if it is in centimetres"),
            "{figures:#}"
        );
        let (_, figures) = compared(&scan, &reference, &["--metres-per-unit-b", "0.01"]);
        assert!(figures["a_to_b"]["p95_mm"].as_f64().unwrap() < 0.2, "{figures:#}");
    }

    #[test]
    fn a_scale_is_told() {
        let scan = hill(41, &Isometry3::identity(), 0.97, "comment metres\n");
        let reference = hill(90, &Isometry3::identity(), 1.0, "comment metres\n");
        let (_, figures) = compared(&scan, &reference, &["--scale"]);
        let scale = figures["b_from_a"]["scale"].as_f64().unwrap();
        assert!((scale * 0.97 - 1.0).abs() < 1e-3, "{figures:#}");
    }

    #[test]
    fn a_shape_that_is_none_of_the_reference_does_not_pass_by_shrinking() {
        // A ball of points beside the hill.
        let mut random = foveate_estimation::random::Random::new(3);
        let header = "ply\nformat ascii 1.0\ncomment metres\nelement vertex 1000\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
        let ball: String = (0..1000)
            .map(|_| format!("{} {} {}\n", 0.1 * random.normal(), 0.1 * random.normal(), 0.1 * random.normal()))
            .collect();
        let (code, figures) = compared(
            &format!("{header}{ball}"),
            &hill(41, &Isometry3::identity(), 1.0, "comment metres\n"),
            &["--scale", "--within", "1"],
        );
        assert_ne!(code, Ok(exit::DONE), "{figures:#}");
    }

    #[test]
    fn coverage_is_given_both_ways_and_a_place_of_little_overlap_is_remarked_on() {
        let whole = hill(41, &Isometry3::identity(), 1.0, "comment metres\n");
        let (_, figures) = compared(&whole, &whole, &["--align"]);
        assert_eq!(
            (figures["coverage"].as_f64(), figures["coverage_of_a"].as_f64()),
            (Some(1.0), Some(1.0)),
            "{figures:#}"
        );
        assert!(!figures["notes"].to_string().contains("of A lies on B"), "{figures:#}");
        // A: the hill, and twice as many points elsewhere.
        let (header, points) = whole.split_once("end_header\n").unwrap();
        let mut random = foveate_estimation::random::Random::new(4);
        let mut far = || format!("{} {} {}\n", random.uniform(), random.uniform(), 0.5 + random.uniform());
        let more: String = (0..3362).map(|_| far()).collect();
        let scan = format!("{}end_header\n{points}{more}", header.replace("1681", "5043"));
        let (code, figures) = compared(&scan, &whole, &["--align", "--within", "1", "--farthest", "5"]);
        assert!(figures["b_from_a"]["overlap"].as_f64().unwrap() < 0.4, "{figures:#}");
        assert!(
            figures["coverage_of_a"].as_f64().unwrap() < 0.4 && figures["coverage"].as_f64().unwrap() > 0.9,
            "{figures:#}"
        );
        assert_eq!(
            (code, figures["notes"].to_string().contains("of A lies on B")),
            (Ok(exit::UNMET), true),
            "{figures:#}"
        );
    }

    #[test]
    fn what_is_no_pair_of_shapes_is_named() {
        let shape = hill(20, &Isometry3::identity(), 1.0, "");
        let (code, _) =
            compared(&shape, "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nend_header\n1\n2\n", &[]);
        assert!(
            code.unwrap_err().contains("b.ply` is no PLY file that can be read: element vertex: found no property y")
        );
        let (code, _) = compared(&shape, &shape, &["--shift", "2"]);
        assert!(code.unwrap_err().contains("`--shift` is for motion files"));
    }
}
