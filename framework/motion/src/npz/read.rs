//! Reader of archives from `numpy.savez` and `numpy.savez_compressed`.

use std::io::Read;

use flate2::read::DeflateDecoder;

/// An archive with more than this, unpacked, is refused [bytes].
const MOST_BYTES: u64 = 1 << 31;

/// The arrays of an archive, unpacked.
#[derive(Debug, Clone, Default)]
pub struct Arrays {
    files: Vec<(String, Vec<u8>)>,
}

/// An array of numbers of any type.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers {
    /// Length along each index.
    pub shape: Vec<usize>,
    /// Values, the last index fastest.
    pub values: Vec<f64>,
}

/// Little-endian numbers at a place of a file.
fn number(bytes: &[u8], at: usize, length: usize) -> Option<usize> {
    let field = bytes.get(at..at.checked_add(length)?)?;
    Some(field.iter().rev().fold(0, |all, it| all << 8 | usize::from(*it)))
}

/// The files that the list at an archive's end names: name, method of packing, packed bytes.
fn packed(bytes: &[u8]) -> Option<Vec<(String, usize, &[u8])>> {
    // The last record has 22 bytes and perhaps a comment.
    let end =
        (0..=bytes.len().checked_sub(22)?).rev().take(1 << 16).find(|it| bytes[*it..].starts_with(b"PK\x05\x06"))?;
    let (n_files, mut at) = (number(bytes, end + 10, 2)?, number(bytes, end + 16, 4)?);
    let mut files = Vec::new();
    for _ in 0..n_files {
        if !bytes.get(at..)?.starts_with(b"PK\x01\x02") {
            return None;
        }
        let method = number(bytes, at + 10, 2)?;
        let length = number(bytes, at + 20, 4)?;
        let [name, extra, comment] = [28, 30, 32].map(|it| number(bytes, at + it, 2));
        let place = number(bytes, at + 42, 4)?;
        let name_bytes = bytes.get(at + 46..at + 46 + name?)?;
        let content = place + 30 + number(bytes, place + 26, 2)? + number(bytes, place + 28, 2)?;
        let content = bytes.get(content..content.checked_add(length)?)?;
        files.push((String::from_utf8_lossy(name_bytes).into_owned(), method, content));
        at += 46 + name? + extra? + comment?;
    }
    Some(files)
}

impl Arrays {
    /// Unpacks an archive.
    ///
    /// # Errors
    /// A sentence: what was found and what was expected.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let broken = || {
            format!(
                "found an archive of {} bytes that is broken or cut off, expected a list of files at its end",
                bytes.len()
            )
        };
        let mut left = MOST_BYTES;
        let mut files = Vec::new();
        for (name, method, content) in packed(bytes).ok_or_else(broken)? {
            let mut array = Vec::new();
            let unpacked = match method {
                0 => content.take(left).read_to_end(&mut array),
                8 => DeflateDecoder::new(content).take(left).read_to_end(&mut array),
                _ => return Err(format!("`{name}`: found the packing {method}, expected 0 (none) or 8 (deflate)")),
            };
            unpacked.map_err(|it| format!("`{name}` cannot be unpacked: {it}"))?;
            left -= array.len() as u64;
            if left == 0 {
                return Err(format!("`{name}`: found more than {MOST_BYTES} bytes, expected a shorter archive"));
            }
            files.push((name.strip_suffix(".npy").unwrap_or(&name).to_owned(), array));
        }
        Ok(Self { files })
    }

    /// Whether there is an array of this name.
    pub fn has(&self, name: &str) -> bool {
        self.files.iter().any(|it| it.0 == name)
    }

    /// Type, shape and bytes of an array.
    fn array(&self, name: &str) -> Result<(String, Vec<usize>, &[u8]), String> {
        let Some((_, bytes)) = self.files.iter().find(|it| it.0 == name) else {
            let names: Vec<&str> = self.files.iter().map(|it| it.0.as_str()).collect();
            return Err(format!("found arrays {}, expected `{name}`", names.join(", ")));
        };
        let wrong = |what: &str| format!("`{name}`: found {what}, expected an array of NumPy in the order of C");
        if !bytes.starts_with(b"\x93NUMPY") || bytes.len() < 12 {
            return Err(wrong("no array"));
        }
        let (length, start) = if bytes[6] == 1 { (number(bytes, 8, 2), 10) } else { (number(bytes, 8, 4), 12) };
        let head = length.and_then(|it| bytes.get(start..start + it)).and_then(|it| std::str::from_utf8(it).ok());
        let head = head.ok_or_else(|| wrong("a broken head"))?;
        let behind = |key: &str| head.split_once(&format!("'{key}':")).map(|it| it.1.trim_start());
        let kind = behind("descr").and_then(|it| it.strip_prefix('\'')?.split_once('\'')).map(|it| it.0);
        let shape = behind("shape").and_then(|it| it.strip_prefix('(')?.split_once(')')).map(|it| it.0);
        let (Some(kind), Some(shape)) = (kind, shape) else { return Err(wrong("a head without type and shape")) };
        if behind("fortran_order").is_some_and(|it| it.starts_with("True")) {
            return Err(wrong("columns before rows"));
        }
        let shape: Option<Vec<usize>> =
            shape.split(',').map(str::trim).filter(|it| !it.is_empty()).map(|it| it.parse().ok()).collect();
        let shape = shape.ok_or_else(|| wrong("a broken shape"))?;
        let content = &bytes[start + length.unwrap_or(0)..];
        let size: Option<usize> = kind.get(2..).and_then(|it| it.parse().ok());
        let size = size.map(|it| if kind.as_bytes()[1] == b'U' { it * 4 } else { it });
        let wanted = shape.iter().chain(&size).try_fold(1_usize, |all, it| all.checked_mul(*it));
        match (size, wanted) {
            (Some(_), Some(wanted)) if wanted <= content.len() => Ok((kind.to_owned(), shape, &content[..wanted])),
            _ => Err(wrong(&format!("{} bytes of `{kind}` and shape {shape:?}", content.len()))),
        }
    }

    /// The array of numbers `name`.
    ///
    /// # Errors
    /// A sentence: what was found and what was expected.
    pub fn numbers(&self, name: &str) -> Result<Numbers, String> {
        let (kind, shape, bytes) = self.array(name)?;
        let eight = |it: &[u8]| <[u8; 8]>::try_from(it).unwrap_or_default();
        let four = |it: &[u8]| <[u8; 4]>::try_from(it).unwrap_or_default();
        let values = match kind.as_str() {
            "<f8" => bytes.chunks_exact(8).map(|it| f64::from_le_bytes(eight(it))).collect(),
            "<f4" => bytes.chunks_exact(4).map(|it| f64::from(f32::from_le_bytes(four(it)))).collect(),
            "<i8" => bytes.chunks_exact(8).map(|it| i64::from_le_bytes(eight(it)) as f64).collect(),
            "<i4" => bytes.chunks_exact(4).map(|it| f64::from(i32::from_le_bytes(four(it)))).collect(),
            "|u1" => bytes.iter().map(|it| f64::from(*it)).collect(),
            _ => return Err(format!("`{name}`: found numbers of type `{kind}`, expected <f8, <f4, <i8, <i4 or |u1")),
        };
        Ok(Numbers { shape, values })
    }

    /// The list of texts `name`.
    ///
    /// # Errors
    /// A sentence: what was found and what was expected.
    pub fn texts(&self, name: &str) -> Result<Vec<String>, String> {
        let (kind, shape, bytes) = self.array(name)?;
        let length = kind.strip_prefix("<U").and_then(|it| it.parse::<usize>().ok());
        let (Some(length), [n_texts]) = (length, &shape[..]) else {
            return Err(format!("`{name}`: found `{kind}` of shape {shape:?}, expected a list of texts"));
        };
        if length == 0 {
            return Ok(vec![String::new(); (*n_texts).min(1 << 16)]);
        }
        let letter = |it: &[u8]| char::from_u32(u32::from_le_bytes([it[0], it[1], it[2], it[3]])).unwrap_or('\u{fffd}');
        let text = |it: &[u8]| it.chunks_exact(4).map(letter).collect::<String>().trim_end_matches('\0').to_owned();
        Ok(bytes.chunks_exact(4 * length).map(text).collect())
    }
}
