//! Reader of PLY files from any program: ASCII or binary, points and triangles.
//!
//! Properties read are `x`, `y`, `z`, `nx`, `ny`, `nz` of the element `vertex` and the list `vertex_indices` (or
//! `vertex_index`) of `face`; polygons become triangles around their first corner. Everything else is skipped.
//! Vertices that are not finite, or farther from the others than single precision resolves, are left out, with their
//! triangles.
//!
//! Source: G. Turk, "The PLY polygon file format", 1994.

use foveate_estimation::statistics::percentile;
use nalgebra::{Point3, Vector3};

/// The shape in a PLY file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlyShape {
    /// Vertices, in the file's unit.
    pub points: Vec<Point3<f64>>,
    /// Unit normal of each vertex, zero where it has none; empty where the file has no normals [–].
    pub normals: Vec<Vector3<f64>>,
    /// Vertex indices of each triangle; empty for a cloud.
    pub triangles: Vec<[u32; 3]>,
    /// Length of the file's unit in metres, where a comment states it.
    pub metres_per_unit: Option<f64>,
    /// Number of vertices left out because they are not finite, or too far from the others.
    pub n_left_out: usize,
}

/// Why a file cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct PlyError {
    /// Place: a line of the header, or an item of an element.
    pub place: String,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: &'static str,
}

/// More vertices or faces than this are no file of a shape, and numbers of corners would not fit.
const MOST: u64 = 200_000_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Ascii,
    Little,
    Big,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    Signed(usize),
    Unsigned(usize),
    Float(usize),
}

impl Number {
    fn of(name: &str) -> Option<Number> {
        Some(match name {
            "char" | "int8" => Number::Signed(1),
            "short" | "int16" => Number::Signed(2),
            "int" | "int32" => Number::Signed(4),
            "uchar" | "uint8" => Number::Unsigned(1),
            "ushort" | "uint16" => Number::Unsigned(2),
            "uint" | "uint32" => Number::Unsigned(4),
            "float" | "float32" => Number::Float(4),
            "double" | "float64" => Number::Float(8),
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Number::Signed(size) | Number::Unsigned(size) | Number::Float(size) => size,
        }
    }

    /// Of bytes in little-endian order, eight of them, those that the number does not have being 0.
    fn value(self, bytes: [u8; 8]) -> f64 {
        let all = u64::from_le_bytes(bytes);
        match self {
            Number::Signed(size) => {
                let shift = 64 - 8 * size as u32;
                ((all << shift) as i64 >> shift) as f64
            }
            Number::Unsigned(_) => all as f64,
            Number::Float(4) => f64::from(f32::from_bits(all as u32)),
            Number::Float(_) => f64::from_bits(all),
        }
    }
}

#[derive(Debug)]
struct Property {
    name: String,
    /// Of the length, where it is a list.
    length: Option<Number>,
    number: Number,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    fn place(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|it| it.name == name)
    }
}

fn fault(place: impl Into<String>, found: impl Into<String>, expected: &'static str) -> PlyError {
    PlyError { place: place.into(), found: found.into(), expected }
}

/// Whether these are the first bytes of a PLY file.
pub fn is_ply(start: &[u8]) -> bool {
    start.starts_with(b"ply\n") || start.starts_with(b"ply\r")
}

/// Reads a PLY file.
///
/// # Errors
/// The place, what was found and what was expected.
pub fn read(bytes: &[u8]) -> Result<PlyShape, PlyError> {
    let Header { format, elements, metres_per_unit, body } = header(bytes)?;
    let mut shape = PlyShape { metres_per_unit, ..PlyShape::default() };
    let mut body = Body { format, bytes: body, at: 0 };
    let mut kept: Vec<u32> = Vec::new();
    let mut polygons: Vec<u32> = Vec::new();
    for element in &elements {
        match element.name.as_str() {
            "vertex" => kept = vertices(element, &mut body, &mut shape)?,
            "face" => faces(element, &mut body, &mut polygons)?,
            _ => {
                for number in 0..element.count {
                    body.item(element, number, |_, _| ())?;
                }
            }
        }
    }
    for (number, corners) in polygons.chunks_exact(3).enumerate() {
        let mut triangle = [0; 3];
        for (to, corner) in triangle.iter_mut().zip(corners) {
            let found = || format!("a triangle with a corner {corner}");
            let expected = "corners below the number of vertices";
            *to = *kept.get(*corner as usize).ok_or_else(|| fault(format!("triangle {number}"), found(), expected))?;
        }
        if !triangle.contains(&LEFT_OUT) {
            shape.triangles.push(triangle);
        }
    }
    if shape.points.is_empty() {
        return Err(fault("element vertex", "no vertex that is finite", "at least one"));
    }
    Ok(shape)
}

struct Header<'a> {
    format: Format,
    elements: Vec<Element>,
    metres_per_unit: Option<f64>,
    body: &'a [u8],
}

fn header(bytes: &[u8]) -> Result<Header<'_>, PlyError> {
    if !is_ply(bytes) {
        return Err(fault("line 1", "something else", "`ply`"));
    }
    let (mut format, mut metres_per_unit) = (None, None);
    let mut elements: Vec<Element> = Vec::new();
    let (mut at, mut line_number) = (0, 0);
    loop {
        line_number += 1;
        let place = format!("line {line_number}");
        let Some(length) = bytes[at..].iter().take(4096).position(|it| matches!(it, b'\n' | b'\r')) else {
            return Err(fault(place, "no end of the header", "`end_header`"));
        };
        let line = String::from_utf8_lossy(&bytes[at..at + length]).into_owned();
        at += length + 1;
        if bytes[at - 1] == b'\r' && bytes.get(at) == Some(&b'\n') {
            at += 1;
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let shown = || format!("`{}`", line.trim());
        match words[..] {
            ["ply"] | ["obj_info", ..] | [] => {}
            ["comment", ref words @ ..] => metres_per_unit = metres_per_unit.or_else(|| unit_in(words)),
            ["format", "ascii", _] => format = Some(Format::Ascii),
            ["format", "binary_little_endian", _] => format = Some(Format::Little),
            ["format", "binary_big_endian", _] => format = Some(Format::Big),
            ["element", name, count] => {
                let count = count.parse().ok().filter(|it| *it <= MOST);
                let count = count.ok_or_else(|| fault(&place, shown(), "a count of at most 200 million"))?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref words @ ..] => {
                let property =
                    match words {
                        ["list", length, number, name] => Number::of(length)
                            .zip(Number::of(number))
                            .map(|it| Property { name: (*name).to_owned(), length: Some(it.0), number: it.1 }),
                        [number, name] => {
                            Number::of(number).map(|number| Property { name: (*name).to_owned(), length: None, number })
                        }
                        _ => None,
                    };
                let property = property.filter(|it| !matches!(it.length, Some(Number::Float(_))));
                match (property, elements.last_mut()) {
                    (Some(property), Some(element)) => element.properties.push(property),
                    _ => return Err(fault(place, shown(), "`property TYPE NAME` after an element")),
                }
            }
            ["end_header"] => break,
            _ => return Err(fault(place, shown(), "a line of a PLY header")),
        }
    }
    let format =
        format.ok_or_else(|| fault("header", "no format", "`format ascii`, or binary little or big endian"))?;
    Ok(Header { format, elements, metres_per_unit, body: &bytes[at..] })
}

/// The unit that a comment names, alone or before a comma: `comment metres, scan 3`.
fn unit_in(words: &[&str]) -> Option<f64> {
    let word = |it: &&str| it.trim_end_matches([',', ';', '.', ':']).to_lowercase();
    words.iter().map(word).find_map(|it| match it.as_str() {
        "metres" | "meters" | "metre" | "meter" => Some(1.0),
        "millimetres" | "millimeters" | "millimetre" | "millimeter" | "mm" => Some(1e-3),
        "centimetres" | "centimeters" | "centimetre" | "centimeter" | "cm" => Some(1e-2),
        _ => None,
    })
}

/// In place of the number of a vertex that was left out.
const LEFT_OUT: u32 = u32::MAX;

/// The vertices; by number in the file the number in `shape`.
fn vertices(element: &Element, body: &mut Body<'_>, shape: &mut PlyShape) -> Result<Vec<u32>, PlyError> {
    let place = |name: &str| {
        let found = || format!("no property {name}");
        element.place(name).ok_or_else(|| fault("element vertex", found(), "x, y and z"))
    };
    let position = [place("x")?, place("y")?, place("z")?];
    let normal = match ["nx", "ny", "nz"].map(|it| element.place(it)) {
        [Some(x), Some(y), Some(z)] => Some([x, y, z]),
        _ => None,
    };
    let (mut kept, mut read) = (Vec::new(), Vec::new());
    let mut values = vec![0.0; element.properties.len()];
    for number in 0..element.count {
        body.item(element, number, |property, value| values[property] = value)?;
        let at = |it: [usize; 3]| Vector3::from(it.map(|it| values[it]));
        read.push((Point3::from(at(position)), normal.map(at)));
    }
    // From far enough away all places of a shape are equally near, and no search for the nearest one ends early.
    let part = |axis: usize, percent: f64| {
        let all: Vec<f64> = read.iter().map(|it| it.0[axis]).collect();
        percentile(&all, percent).unwrap_or_default()
    };
    let [low, middle, high] = [5.0, 50.0, 95.0].map(|it| Point3::from([0, 1, 2].map(|axis| part(axis, it))));
    let extent = (high - low).norm();
    let reach = if extent > 0.0 { extent / f64::from(f32::EPSILON) } else { f64::MAX };
    for (point, normal) in read {
        let is_near = (point - middle).norm() <= reach;
        if !is_near {
            shape.n_left_out += 1;
            kept.push(LEFT_OUT);
            continue;
        }
        kept.push(shape.points.len() as u32);
        shape.points.push(point);
        if let Some(normal) = normal {
            shape
                .normals
                .push(normal.try_normalize(1e-12).filter(|it| it.sum().is_finite()).unwrap_or_else(Vector3::zeros));
        }
    }
    if shape.normals.iter().all(|it| *it == Vector3::zeros()) {
        shape.normals.clear();
    }
    Ok(kept)
}

/// Three corners a triangle.
fn faces(element: &Element, body: &mut Body<'_>, triangles: &mut Vec<u32>) -> Result<(), PlyError> {
    let list = ["vertex_indices", "vertex_index"].iter().find_map(|it| element.place(it));
    let mut corners: Vec<f64> = Vec::new();
    for number in 0..element.count {
        corners.clear();
        body.item(element, number, |property, value| {
            if Some(property) == list {
                corners.push(value);
            }
        })?;
        if let Some(bad) = corners.iter().find(|it| !(0.0..f64::from(LEFT_OUT)).contains(*it)) {
            return Err(fault(format!("face {number}"), format!("a corner {bad}"), "numbers of vertices"));
        }
        for pair in corners.windows(2).skip(1) {
            triangles.extend([corners[0], pair[0], pair[1]].map(|it| it as u32));
        }
    }
    Ok(())
}

/// What follows the header.
struct Body<'a> {
    format: Format,
    bytes: &'a [u8],
    at: usize,
}

impl Body<'_> {
    /// Calls `each` with the number of the property and each of its values.
    fn item(&mut self, element: &Element, number: u64, mut each: impl FnMut(usize, f64)) -> Result<(), PlyError> {
        for (place, property) in element.properties.iter().enumerate() {
            let cut_off = |it: &str| {
                let what = format!("{} {number} of {}, {}", element.name, element.count, property.name);
                fault(what, it, "a number")
            };
            let count = match property.length {
                None => 1,
                Some(length) => {
                    let count = self.number(length).map_err(cut_off)?;
                    if !(0.0..=65_536.0).contains(&count) {
                        return Err(cut_off(&format!("a list of {count}")));
                    }
                    count as usize
                }
            };
            for _ in 0..count {
                each(place, self.number(property.number).map_err(cut_off)?);
            }
        }
        Ok(())
    }

    fn number(&mut self, number: Number) -> Result<f64, &'static str> {
        let rest = &self.bytes[self.at..];
        if self.format == Format::Ascii {
            let blanks = rest.iter().position(|it| !it.is_ascii_whitespace()).ok_or("the end of the file")?;
            let word = &rest[blanks..];
            let length = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
            self.at += blanks + length;
            let text = std::str::from_utf8(&word[..length]).map_err(|_| "bytes that are no text")?;
            return text.parse().map_err(|_| "a word that is no number");
        }
        let size = number.size();
        let found = rest.get(..size).ok_or("the end of the file")?;
        self.at += size;
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(found);
        if self.format == Format::Big {
            bytes[..size].reverse();
        }
        Ok(number.value(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn a_square_is_two_triangles_in_every_format() {
        let places = [[0.0, 0.0, 1.5], [1.0, 0.0, 1.5], [1.0, 1.0, 1.5], [0.0, 1.0, -2.5]];
        let mut ascii = format!("ply\r\nformat ascii 1.0\r\ncomment made of millimetres\r\n{HEADER}").into_bytes();
        places.iter().for_each(|it| ascii.extend(format!("{} {} {} 200\n", it[0], it[1], it[2]).bytes()));
        ascii.extend(b"4 0 1 2 3");
        let first = read(&ascii).unwrap();
        assert_eq!((first.points.len(), first.points[3].z, first.metres_per_unit), (4, -2.5, Some(1e-3)));
        assert_eq!(first.triangles, [[0, 1, 2], [0, 2, 3]]);
        for format in ["little", "big"] {
            let mut bytes = format!("ply\nformat binary_{format}_endian 1.0\n{HEADER}").into_bytes();
            let is_little = format == "little";
            for it in &places {
                it.iter().for_each(|it| {
                    let it = *it as f32;
                    bytes.extend(if is_little { it.to_le_bytes() } else { it.to_be_bytes() });
                });
                bytes.push(200);
            }
            bytes.push(4);
            (0..4_i32).for_each(|it| bytes.extend(if is_little { it.to_le_bytes() } else { it.to_be_bytes() }));
            assert_eq!(read(&bytes).unwrap(), PlyShape { metres_per_unit: None, ..first.clone() }, "{format}");
            let cut = read(&bytes[..bytes.len() - 2]).unwrap_err().to_string();
            assert!(cut.contains("face 0 of 1, vertex_indices: found the end of the file"), "{cut}");
        }
    }

    #[test]
    fn what_is_not_finite_is_left_out_with_its_triangles() {
        let file = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float ny\nproperty float nz\nelement edge 1\nproperty int a\nelement face 2\nproperty list uchar uint vertex_index\nend_header\nnan 0 0 0 0 1\n1 0 0 0 0 2\n1 1 0 0 0 0\n0 1 0 0 0 1\n7\n3 0 1 2\n3 1 2 3\n";
        let shape = read(file.as_bytes()).unwrap();
        assert_eq!((shape.points.len(), shape.n_left_out, shape.triangles.len()), (3, 1, 1));
        assert_eq!(
            (shape.triangles[0], shape.normals[0], shape.normals[1]),
            ([0, 1, 2], Vector3::z(), Vector3::zeros())
        );
    }

    #[test]
    fn a_vertex_farther_away_than_single_precision_resolves_is_left_out_and_nearer_ones_stay() {
        let count = |far: f64, offset: f64| {
            let header = "ply\nformat ascii 1.0\nelement vertex 101\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
            let rows: String = (0..100).map(|it| format!("{} 0 0\n", offset + 0.01 * f64::from(it))).collect();
            let shape = read(format!("{header}{rows}{far} 0 0\n").as_bytes()).unwrap();
            (shape.points.len(), shape.n_left_out)
        };
        assert_eq!(count(1e32, 0.0), (100, 1));
        assert_eq!(count(-1e32, 0.0), (100, 1));
        // 0.9 m · 2²³ is 7.5e6 m, around the points and not around the origin.
        assert_eq!(count(1e6, 0.0), (101, 0));
        assert_eq!(count(1e9 + 2.0, 1e9), (101, 0));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let error = |text: &str| read(text.as_bytes()).unwrap_err().to_string();
        assert!(error("solid x").contains("line 1: found something else, expected `ply`"));
        assert!(error("ply\nformat ascii 1.0\nelement vertex x\n").contains("line 3: found `element vertex x`"));
        assert!(
            error("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n")
                .contains("no property y")
        );
        let corner = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n3 0 0 5\n";
        assert!(error(corner).contains("triangle 0: found a triangle with a corner 5"));
        assert!(error("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n").contains("no vertex"));
    }
}
