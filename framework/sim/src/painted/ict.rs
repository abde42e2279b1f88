//! A head from recordings: the neutral mesh and the expressions of the ICT Face Model Light [Li et al. 2020], moved by recorded curves of an
//! ARKit face capture. Files are those of `s13_ict_facekit_min` and `s20_arkit_curves` in the folder of recordings.
//!
//! The mesh is made coarser ([`super::coarser`]), lies in metres and in the head's space, and has texture coordinates of its own; eyes are caps of
//! spheres, the mouth has its socket and a row of teeth.

use std::f64::consts::TAU;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use nalgebra::{Point3, Vector3};

use super::coarser;
use super::head::smooth;
use super::surface::{Material, Mode, Surface, Triangle};

const MESH: &str = "s13_ict_facekit_min/generic_neutral_mesh.obj.gz";
const EXPRESSIONS: &str = "s13_ict_facekit_min/expressions.sparse.bin.gz";
const CURVES: &str = "s20_arkit_curves/dao.gesichter";

/// Vertices of the whole model.
const N_VERTICES: usize = 26_719;
/// Of these, the face, the rest of head and neck, and the mouth's socket come first.
const SOCKET: std::ops::Range<usize> = 11_248..13_294;
/// The middle of the head in the model's coordinates: x left, y up, z ahead [cm].
const MIDDLE: [f64; 3] = [0.0, 3.4, 2.4];
/// Middle of the left eye, and its radius, a little less than the model's, so that lids lie over it [cm].
const EYE: ([f64; 3], f64) = ([3.156, 3.613, 8.06], 1.40);
/// The model's jaw opens wider at weight 1 than people do.
const JAW_SHARE: f64 = 0.55;
/// Texture: sides of the tiles of face, head, and the rest [texel].
const TILES: [f64; 2] = [1000.0, 560.0];

/// Names of the recorded curves, in the order of Live Link Face; the model's `…_L` and `…_R` are `…Left` and `…Right` there.
const CURVE_NAMES: [&str; 52] = [
    "eyeBlink_L",
    "eyeLookDown_L",
    "eyeLookIn_L",
    "eyeLookOut_L",
    "eyeLookUp_L",
    "eyeSquint_L",
    "eyeWide_L",
    "eyeBlink_R",
    "eyeLookDown_R",
    "eyeLookIn_R",
    "eyeLookOut_R",
    "eyeLookUp_R",
    "eyeSquint_R",
    "eyeWide_R",
    "jawForward",
    "jawRight",
    "jawLeft",
    "jawOpen",
    "mouthClose",
    "mouthFunnel",
    "mouthPucker",
    "mouthRight",
    "mouthLeft",
    "mouthSmile_L",
    "mouthSmile_R",
    "mouthFrown_L",
    "mouthFrown_R",
    "mouthDimple_L",
    "mouthDimple_R",
    "mouthStretch_L",
    "mouthStretch_R",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
    "mouthPress_L",
    "mouthPress_R",
    "mouthLowerDown_L",
    "mouthLowerDown_R",
    "mouthUpperUp_L",
    "mouthUpperUp_R",
    "browDown_L",
    "browDown_R",
    "browInnerUp",
    "browOuterUp_L",
    "browOuterUp_R",
    "cheekPuff",
    "cheekSquint_L",
    "cheekSquint_R",
    "noseSneer_L",
    "noseSneer_R",
    "tongueOut",
];
const CURVES_HZ: f64 = 60.0;

/// Curves of expressions as they were recorded, each 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curves {
    frames: Vec<Vec<f64>>,
}

/// What the files hold.
pub(super) struct Head {
    pub surface: Surface,
    pub texture_size: [usize; 2],
    pub curves: Curves,
}

/// Whether all files are there.
pub(super) fn is_in(folder: &Path) -> bool {
    [MESH, EXPRESSIONS, CURVES].iter().all(|it| folder.join(it).is_file())
}

/// Reads the head.
///
/// # Errors
/// A sentence with the file, what was found in it and what was expected.
pub(super) fn read(folder: &Path) -> Result<Head, String> {
    let (mut surface, texture_size) = named(folder.join(MESH), |bytes| mesh(&bytes))?;
    surface.modes = named(folder.join(EXPRESSIONS), |bytes| modes(&bytes))?;
    let curves = named(folder.join(CURVES), |bytes| curves(&bytes))?;
    let mut surface = coarser::coarser(surface, target_edge);
    surface.follow = surface.rest.iter().map(|it| smooth((-0.125 - it.z) / 0.06)).collect();
    add_eyes(&mut surface);
    Ok(Head { surface, texture_size, curves })
}

/// Reads and unpacks a file, and puts its name before what is wrong with it.
fn named<T>(path: PathBuf, decode: impl FnOnce(Vec<u8>) -> Result<T, String>) -> Result<T, String> {
    let unpacked = || -> std::io::Result<Vec<u8>> {
        let bytes = std::fs::read(&path)?;
        let mut unpacked = Vec::new();
        GzDecoder::new(&bytes[..]).read_to_end(&mut unpacked)?;
        Ok(unpacked)
    };
    let decoded = unpacked().map_err(|error| format!("{error}, expected a file packed with gzip")).and_then(decode);
    decoded.map_err(|message| format!("{}: {message}", path.display()))
}

/// From the model's coordinates [cm] to the head's space [m].
fn placed([x, y, z]: [f64; 3]) -> Point3<f64> {
    Point3::new(z - MIDDLE[2], x - MIDDLE[0], y - MIDDLE[1]) * 0.01
}

fn mesh(bytes: &[u8]) -> Result<(Surface, [usize; 2]), String> {
    let text = std::str::from_utf8(bytes).map_err(|error| format!("{error}, expected the text of an OBJ file"))?;
    let (mut rest, mut places, mut triangles) = (Vec::new(), Vec::<[f64; 2]>::new(), Vec::new());
    let mut is_wanted = false;
    for (number, line) in (1..).zip(text.lines()) {
        let mut words = line.split_ascii_whitespace();
        let fault = |expected: &str| format!("line {number}: found `{line}`, expected {expected}");
        let numbers = |words: std::str::SplitAsciiWhitespace<'_>| -> Vec<f64> {
            words.map_while(|it| it.parse().ok()).filter(|it: &f64| it.is_finite()).collect()
        };
        match words.next() {
            Some("v") => match numbers(words)[..] {
                [x, y, z, ..] => rest.push(placed([x, y, z])),
                _ => return Err(fault("`v` and three numbers")),
            },
            Some("vt") => match numbers(words)[..] {
                [u, v, ..] => places.push([u, v]),
                _ => return Err(fault("`vt` and two numbers")),
            },
            Some("usemtl") => is_wanted = matches!(words.next(), Some("M_Face" | "M_BackHead")),
            Some("f") if is_wanted => {
                let corner = |word: &str| -> Option<(usize, [f64; 2])> {
                    let (vertex, place) = word.split_once('/')?;
                    let place = place.split('/').next()?.parse::<usize>().ok()?;
                    let vertex = vertex.parse::<usize>().ok()?.checked_sub(1).filter(|it| *it < rest.len())?;
                    Some((vertex, *places.get(place.checked_sub(1)?)?))
                };
                let corners: Option<Vec<_>> = words.map(corner).collect();
                let Some(corners) = corners.filter(|it| it.len() >= 3) else {
                    return Err(fault("`f` and three or more `vertex/texture` known by then"));
                };
                add_face(&corners, &mut triangles);
            }
            _ => {}
        }
    }
    if rest.len() != N_VERTICES || triangles.is_empty() {
        let found = format!("found {} vertices and {} triangles of face and head", rest.len(), triangles.len());
        return Err(format!("{found}, expected {N_VERTICES} vertices and the materials M_Face and M_BackHead"));
    }
    let follow = vec![0.0; rest.len()];
    let size = [TILES[0] + TILES[1] + 12.0, TILES[0] + 8.0].map(|it| it as usize);
    let mut surface = Surface { rest, triangles, modes: Vec::new(), follow, openness: Vec::new() };
    surface.open();
    Ok((surface, size))
}

/// Adds the triangles of a polygon; sockets of the eyes are left out, for nothing is seen of them.
fn add_face(corners: &[(usize, [f64; 2])], triangles: &mut Vec<Triangle>) {
    let socket = |it: &(usize, [f64; 2])| SOCKET.contains(&it.0);
    if corners.iter().any(|it| it.0 >= SOCKET.end) {
        return;
    }
    let material = if corners.iter().any(socket) { Material::Mouth } else { Material::Skin };
    let texel = |[u, v]: [f64; 2]| {
        // The face's tile spans 0 to 1, the head's 1 to 2; rows run downwards.
        let (from, side, u) = if u < 1.0 { (2.0, TILES[0], u) } else { (TILES[0] + 6.0, TILES[1], u - 1.0) };
        [(from + side * u) as f32, (2.0 + side * (1.0 - v)) as f32]
    };
    for pair in corners[1..].windows(2) {
        let of = [corners[0], pair[0], pair[1]];
        triangles.push(Triangle { corners: of.map(|it| it.0 as u32), texels: of.map(|it| texel(it.1)), material });
    }
}

/// How far apart vertices should lie [m]: near around eyes and mouth, far on skull and neck.
fn target_edge(p: &Point3<f64>) -> f64 {
    let near = |at: [f64; 3], reach: f64| ((Point3::new(p.x, p.y.abs(), p.z) - placed(at)).norm() / reach).min(1.0);
    let fine = near([0.8, -3.4, 11.0], 0.034).min(near([3.2, 3.5, 9.5], 0.024)).min(near([0.5, -0.6, 12.0], 0.024));
    let coarse = if p.x < 0.02 || p.z < -0.12 { 10e-3 } else { 7e-3 };
    2e-3 + (coarse - 2e-3) * fine * fine
}

fn modes(bytes: &[u8]) -> Result<Vec<Mode>, String> {
    let mut rest = bytes;
    let end = || "ends within a shape, expected all that its counts announce".to_owned();
    let mut take = |n: usize| -> Result<&[u8], String> {
        let (taken, left) = rest.split_at_checked(n).ok_or_else(end)?;
        rest = left;
        Ok(taken)
    };
    let word = |bytes: &[u8]| bytes.try_into().map(u32::from_le_bytes).map_err(|_| end());
    let mark = take(8)?;
    if mark != b"ICTDELT1" {
        return Err(format!("begins with {:?}, expected \"ICTDELT1\"", String::from_utf8_lossy(mark)));
    }
    let (n_shapes, n_vertices) = (word(take(4)?)?, word(take(4)?)?);
    if n_vertices as usize != N_VERTICES {
        return Err(format!("found shapes of {n_vertices} vertices, expected {N_VERTICES}"));
    }
    let mut modes = Vec::new();
    for _ in 0..n_shapes {
        let length = take(2)?.iter().rev().fold(0, |sum, it| sum << 8 | usize::from(*it));
        let name = String::from_utf8_lossy(take(length)?).into_owned();
        let n = word(take(4)?)? as usize;
        let indices = take(n.checked_mul(4).ok_or_else(end)?)?;
        let deltas = take(n.checked_mul(12).ok_or_else(end)?)?;
        let share = if name == "jawOpen" || name == "mouthClose" { JAW_SHARE } else { 1.0 };
        let mut moves = Vec::with_capacity(n);
        for (index, delta) in indices.chunks_exact(4).zip(deltas.chunks_exact(12)) {
            let vertex = word(index)?;
            let mut by = [0.0; 3];
            for (to, from) in by.iter_mut().zip(delta.chunks_exact(4)) {
                *to = f64::from(f32::from_bits(word(from)?));
            }
            if vertex as usize >= N_VERTICES || by.iter().any(|it| !it.is_finite()) {
                return Err(format!(
                    "found vertex {vertex} moved by {by:?} in `{name}`, expected less than {N_VERTICES}, and numbers"
                ));
            }
            let [x, y, z] = by;
            moves.push((vertex, Vector3::new(z, x, y) * (0.01 * share)));
        }
        modes.push(Mode { name, moves });
    }
    Ok(modes)
}

fn curves(bytes: &[u8]) -> Result<Curves, String> {
    let big = |bytes: &[u8]| bytes.try_into().map(u32::from_be_bytes).ok();
    let n =
        bytes.get(1..5).and_then(big).ok_or("ends before its number of frames, expected a version and four bytes")?;
    let (mut place, mut frames) = (5, Vec::new());
    for frame in 0..n {
        let length = bytes.get(place..place + 4).and_then(big).map(|it| it as usize);
        let packet = length.and_then(|it| bytes.get(place + 4..place + 4 + it)).filter(|it| it.len() >= 244);
        let Some(packet) = packet else {
            return Err(format!("ends within frame {frame} of {n}, expected packets of 244 bytes or more"));
        };
        let values = packet[packet.len() - 244..].chunks_exact(4);
        let values = values.filter_map(big).map(|it| f64::from(f32::from_bits(it)));
        let values: Vec<f64> = values.take(CURVE_NAMES.len()).map(|it| it.clamp(0.0, 1.0)).collect();
        if let Some(place) = values.iter().position(|it| it.is_nan()) {
            return Err(format!("frame {frame}: `{}` is not a number", CURVE_NAMES[place]));
        }
        frames.push(values);
        place += 4 + packet.len();
    }
    if frames.len() < 4 {
        return Err(format!("found {} frames, expected 4 or more", frames.len()));
    }
    Ok(Curves { frames })
}

impl Curves {
    /// What was recorded for a shape, played to and fro without end.
    pub fn at(&self, shape: &str, time_s: f64) -> f64 {
        let is_it =
            |name: &&str| *name == shape || shape.strip_prefix(*name).is_some_and(|it| it == "_L" || it == "_R");
        let Some(curve) = CURVE_NAMES.iter().position(is_it) else { return 0.0 };
        // Turning around at both ends as smoothly as a cosine does.
        let last = (self.frames.len() - 1) as f64;
        let way = (time_s * CURVES_HZ / last).rem_euclid(2.0);
        let there = if way > 1.0 { 2.0 - way } else { way };
        let eased = (1.0 - SOFT) * there + SOFT * smooth(there);
        let place = eased * last;
        let frame = (place as usize).min(self.frames.len() - 2);
        let read = |frame: isize| self.frames[frame.clamp(0, last as isize) as usize][curve];
        let frame = frame as isize;
        let (t, [a, b, c, d]) = (place - frame as f64, [-1, 0, 1, 2].map(|it| read(frame + it)));
        // Smoothed as a cubic B-spline: continuous in its curvature.
        let (t2, t3) = (t * t, t * t * t);
        let weights =
            [1.0 - 3.0 * t + 3.0 * t2 - t3, 4.0 - 6.0 * t2 + 3.0 * t3, 1.0 + 3.0 * t + 3.0 * t2 - 3.0 * t3, t3];
        weights.iter().zip([a, b, c, d]).map(|(weight, it)| weight * it).sum::<f64>() / 6.0
    }
}

/// How softly the curves turn around.
const SOFT: f64 = 0.5;

/// Adds caps of spheres for the eyes.
fn add_eyes(surface: &mut Surface) {
    const RINGS: usize = 9;
    const SECTORS: usize = 20;
    for side in [1.0, -1.0] {
        let ([x, y, z], radius) = EYE;
        let middle = placed([x * side, y, z]);
        let first = surface.rest.len() as u32;
        surface.rest.push(middle + Vector3::x() * radius * 0.01);
        for ring in 1..=RINGS {
            let away = 1.15 * ring as f64 / RINGS as f64;
            for sector in 0..SECTORS {
                let (sine, cosine) = (TAU * sector as f64 / SECTORS as f64).sin_cos();
                let out = Vector3::new(away.cos(), away.sin() * cosine, away.sin() * sine);
                surface.rest.push(middle + out * (radius * 0.01));
            }
        }
        surface.follow.resize(surface.rest.len(), 0.0);
        surface.openness.resize(surface.rest.len(), 0.85);
        // In the free corner of the texture below the head's tile, 0.12 mm a texel.
        let texel = |vertex: u32| {
            let p = surface.rest[vertex as usize] - middle;
            let centre = [TILES[0] + 150.0 + if side > 0.0 { 0.0 } else { 230.0 }, TILES[1] + 150.0];
            [(centre[0] + p.y / 0.13e-3) as f32, (centre[1] - p.z / 0.13e-3) as f32]
        };
        let at = |ring: usize, sector: usize| match ring {
            0 => first,
            _ => first + 1 + ((ring - 1) * SECTORS + sector % SECTORS) as u32,
        };
        let mut triangles = Vec::new();
        for ring in 0..RINGS {
            for sector in 0..SECTORS {
                let (a, b) = (at(ring, sector), at(ring, sector + 1));
                let (c, d) = (at(ring + 1, sector), at(ring + 1, sector + 1));
                triangles.push([a, c, d]);
                if ring > 0 {
                    triangles.push([a, d, b]);
                }
            }
        }
        let triangles = triangles.into_iter().map(|corners| Triangle {
            corners,
            texels: corners.map(texel),
            material: Material::Eye,
        });
        surface.triangles.extend(triangles.collect::<Vec<_>>());
    }
}

/// From the built-in head's y and z to those of this one [mm]: features lie at other heights.
pub(super) fn place([y, z]: [f64; 2]) -> [f64; 2] {
    const HEIGHTS: [[f64; 2]; 11] = [
        [105.0, 106.0],
        [75.0, 77.0],
        [42.0, 45.0],
        [28.0, 27.0],
        [9.0, 1.5],
        [-8.0, -15.0],
        [-23.0, -29.0],
        [-35.0, -46.5],
        [-62.0, -68.0],
        [-79.0, -84.5],
        [-106.0, -109.5],
    ];
    let i = HEIGHTS.iter().position(|it| it[0] < z).unwrap_or(HEIGHTS.len() - 1).max(1);
    let (a, b) = (HEIGHTS[i - 1], HEIGHTS[i]);
    [y, a[1] + (b[1] - a[1]) * (z - a[0]) / (b[0] - a[0])]
}

/// The way back of [`place`], for a point of this head [m]: where the same feature lies on the built-in one [mm].
pub(super) fn as_built_in(p: &Point3<f64>) -> Point3<f64> {
    let z = p.z * 1e3;
    let (mut low, mut high) = (-300.0, 300.0);
    for _ in 0..32 {
        let middle = (low + high) / 2.0;
        if place([0.0, middle])[1] < z { low = middle } else { high = middle }
    }
    Point3::new(p.x * 1e3, p.y * 1e3, low)
}

/// How far a point of the neck and shoulders [m] is covered by cloth, 0 to 1.
pub(super) fn cloth(p: &Point3<f64>) -> f32 {
    let around = (p.x * 0.9 + 0.018).hypot(p.y);
    let collar = smooth((around - 0.082 + 0.25 * (p.x.max(0.0) - 0.05).max(0.0)) / 2e-3);
    (collar * smooth((-0.13 - p.z) / 4e-3)).max(smooth((-0.186 - p.z) / 2e-3)) as f32
}

/// How bright an eye's cap is at a point [m].
pub(super) fn eye_albedo(p: &Point3<f64>) -> f32 {
    let ([x, y, z], _) = EYE;
    let from = p - placed([x * p.y.signum(), y, z]);
    let away = from.y.hypot(from.z) * 1e3;
    let iris = smooth((6.0 - away) / 0.7 + 0.5) as f32;
    let pupil = smooth((2.3 - away) / 0.5 + 0.5) as f32;
    let white = 0.62 - 0.25 * smooth((away - 7.0) / 4.0) as f32 - 0.12 * smooth(from.z * 1e3 / 5.0) as f32;
    let eye = white + (0.22 - white) * iris;
    eye + (0.03 - eye) * pupil
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;
    use foveate_testkit::data_dir_or_skip;

    use super::*;

    #[test]
    fn the_recorded_head_has_the_size_of_a_head_and_moves_as_faces_do() {
        let Some(mesh) = data_dir_or_skip("the recorded head", "s13_ict_facekit_min") else { return };
        let folder = mesh.parent().unwrap();
        if !is_in(folder) {
            println!("skipped: the recorded head needs {CURVES}, too");
            return;
        }
        let head = read(folder).unwrap();
        let n = head.surface.rest.len();
        assert!((1500..7000).contains(&n), "{n} vertices");
        let extent = |axis: usize| {
            let head = head.surface.rest.iter().filter(|it| it.z > -0.1);
            let along = head.map(|it| it[axis]);
            (along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max))
        };
        assert!((0.1..0.115).contains(&extent(2).1) && (0.1..0.115).contains(&extent(0).1), "{:?}", extent(2));
        assert!((0.08..0.1).contains(&extent(1).1) && (extent(1).0 + extent(1).1).abs() < 1e-3, "{:?}", extent(1));
        let most = |name: &str| {
            let mode = head.surface.modes.iter().find(|it| it.name == name).unwrap();
            mode.moves
                .iter()
                .max_by(|a, b| a.1.norm().total_cmp(&b.1.norm()))
                .map(|it| (head.surface.rest[it.0 as usize], it.1))
                .unwrap()
        };
        let (chin, opens) = most("jawOpen");
        assert!(opens.z < -0.015 && opens.norm() < 0.026 && chin.z < -0.07, "{opens} at {chin}");
        let (corner, smiles) = most("mouthSmile_L");
        assert!(smiles.y > 0.004 && corner.y > 0.015, "{smiles} at {corner}");
        // Curves go on smoothly for ever.
        let jaw: Vec<f64> = (0..6000).map(|it| head.curves.at("jawOpen", f64::from(it) * 1e-3)).collect();
        assert!(jaw.iter().all(|it| (0.0..=1.0).contains(it)) && jaw.iter().any(|it| *it > 0.5));
        assert!(jaw.windows(2).all(|it| (it[1] - it[0]).abs() < 0.02));
        assert_eq!(head.curves.at("PupilDilate_L", 1.0), 0.0);
        assert_eq!(head.curves.at("browInnerUp_L", 1.3), head.curves.at("browInnerUp", 1.3));
    }

    fn packed(folder: &Path, name: &str, bytes: &[u8]) {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut encoder = GzEncoder::new(std::fs::File::create(path).unwrap(), Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap();
    }

    #[track_caller]
    fn refused(decoded: Result<impl Sized, String>, parts: &[&str]) {
        let message = decoded.err().unwrap();
        parts.iter().for_each(|part| assert!(message.contains(part), "`{part}` is not in: {message}"));
    }

    #[test]
    fn bad_files_are_refused_by_name_with_what_was_found_and_expected() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        refused(read(folder), &[MESH, "expected"]);
        assert!(!is_in(folder));
        packed(folder, MESH, b"v 1 2 three\n");
        refused(read(folder), &[MESH, "line 1", "v 1 2 three", "three numbers"]);
        packed(folder, MESH, b"v 1 2 3\nvt 0 0\nusemtl M_Face\nf 1/1 2/1 1/1\n");
        refused(read(folder), &[MESH, "line 4", "known by then"]);
        packed(folder, MESH, b"v 1 2 3\n");
        refused(read(folder), &[MESH, "found 1 vertices", "expected 26719"]);
        refused(modes(b"ICTDELT2\0\0\0\0"), &["ICTDELT2", "ICTDELT1"]);
        refused(modes(b"ICTDELT1\x01\0\0\0\x02\0\0\0"), &["shapes of 2 vertices", "26719"]);
        let mut short = b"ICTDELT1\x01\0\0\0".to_vec();
        short.extend(26_719_u32.to_le_bytes());
        short.extend(b"\x02\0ab\xFF\xFF\xFF\xFF");
        refused(modes(&short), &["ends within a shape"]);
        short.truncate(20);
        short.extend(1_u32.to_le_bytes());
        short.extend(99_999_u32.to_le_bytes());
        short.extend([0; 12]);
        refused(modes(&short), &["vertex 99999", "`ab`"]);
        refused(curves(b"\x06\0\0"), &["ends before"]);
        refused(curves(b"\x06\0\0\0\x05\0\0\x01\x40abc"), &["frame 0 of 5"]);
        refused(curves(b"\x06\0\0\0\0"), &["found 0 frames"]);
        packed(folder, EXPRESSIONS, b"");
        std::fs::create_dir_all(folder.join("s20_arkit_curves")).unwrap();
        std::fs::write(folder.join(CURVES), b"not packed").unwrap();
        assert!(is_in(folder));
        refused(named(folder.join(CURVES), |bytes| curves(&bytes)), &[CURVES, "gzip"]);
    }
}
