//! Reads BVH: a hierarchy of joints, then a line of numbers a frame.

use nalgebra::Vector3;

use super::{Axis, BvhError, Channel, Joint, SkeletonMotion};

/// Joints that a file may have at most: far above any body, so that a broken one stays small.
const MOST_JOINTS: usize = 1000;

/// The words of a file, each with its line.
struct Words<'a> {
    lines: std::iter::Enumerate<std::str::SplitTerminator<'a, char>>,
    line: usize,
    rest: &'a str,
}

impl<'a> Words<'a> {
    /// Goes to the next line that is not empty, unless this one is not used up; whether there is one.
    fn more(&mut self) -> bool {
        while self.rest.is_empty() {
            let Some((line, text)) = self.lines.next() else { return false };
            (self.line, self.rest) = (line + 1, text.trim());
        }
        true
    }

    fn next(&mut self, expected: &str) -> Result<&'a str, BvhError> {
        if !self.more() {
            return Err(BvhError { line: self.line, found: "the end".to_owned(), expected: expected.to_owned() });
        }
        let (word, rest) = self.rest.split_once(char::is_whitespace).unwrap_or((self.rest, ""));
        self.rest = rest.trim_start();
        Ok(word)
    }

    /// What is left of the line, up to a brace.
    fn name(&mut self, expected: &str) -> Result<String, BvhError> {
        let (name, rest) = match self.rest.find('{') {
            Some(brace) => self.rest.split_at(brace),
            None => (self.rest, ""),
        };
        let name = name.trim();
        self.rest = rest;
        if name.is_empty() { self.fault("no name", expected) } else { Ok(name.to_owned()) }
    }

    fn fault<T>(&self, found: &str, expected: &str) -> Result<T, BvhError> {
        let found = found.chars().take(60).collect();
        Err(BvhError { line: self.line, found, expected: expected.to_owned() })
    }

    /// A word and its colon, with or without blanks around that.
    fn expect_colon(&mut self, wanted: &str) -> Result<(), BvhError> {
        let expected = format!("`{wanted}:`");
        self.more();
        let matches = self.rest.get(..wanted.len()).is_some_and(|it| it.eq_ignore_ascii_case(wanted));
        let behind = self.rest.get(wanted.len()..).filter(|_| matches);
        match behind.and_then(|it| it.trim_start().strip_prefix(':')) {
            Some(rest) => {
                self.rest = rest.trim_start();
                Ok(())
            }
            None => {
                let word = self.next(&expected)?;
                self.fault(&format!("`{word}`"), &expected)
            }
        }
    }

    fn expect(&mut self, wanted: &str) -> Result<(), BvhError> {
        let expected = format!("`{wanted}`");
        match self.next(&expected)? {
            word if word.eq_ignore_ascii_case(wanted) => Ok(()),
            word => self.fault(&format!("`{word}`"), &expected),
        }
    }

    fn number(&mut self, what: &str) -> Result<f64, BvhError> {
        let word = self.next(what)?;
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => self.fault(&format!("`{word}`"), what),
        }
    }

    fn count(&mut self, what: &str) -> Result<usize, BvhError> {
        let word = self.next(what)?;
        word.parse().or_else(|_| self.fault(&format!("`{word}`"), what))
    }

    fn offset(&mut self) -> Result<Vector3<f64>, BvhError> {
        self.expect("OFFSET")?;
        let mut number = || self.number("a number of an `OFFSET`");
        Ok(Vector3::new(number()?, number()?, number()?))
    }
}

impl SkeletonMotion {
    /// Reads the text of a BVH file, with any line ends and perhaps a byte-order mark.
    ///
    /// # Errors
    /// The line, what is there and what should be.
    pub fn from_bvh(text: &str) -> Result<Self, BvhError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        // Lines are trimmed, of a carriage return too.
        let ends = if text.contains('\n') { '\n' } else { '\r' };
        let mut words = Words { lines: text.split_terminator(ends).enumerate(), line: 1, rest: "" };
        words.expect("HIERARCHY")?;
        words.expect("ROOT")?;
        let joints = joints(&mut words)?;
        let n_channels: usize = joints.iter().map(|it| it.channels.len()).sum();
        if n_channels == 0 {
            return words.fault("joints without a channel", "at least one channel");
        }
        words.expect("MOTION")?;
        words.expect_colon("Frames")?;
        let n_frames = words.count("the number of frames")?;
        words.expect("Frame")?;
        words.expect_colon("Time")?;
        let frame_s = words.number("the time between two frames [s]")?;
        if frame_s <= 0.0 {
            return words.fault(&format!("a frame time of {frame_s}"), "seconds above 0");
        }
        let mut values = Vec::new();
        // Where numbers are too many or too few is told at the end of the file: more helpful is the first line in which a frame ends before the line does.
        let mut ragged: Option<usize> = None;
        let hint = |ragged: Option<usize>| {
            ragged.map_or(String::new(), |it| format!("; line {it} is the first that does not hold whole frames"))
        };
        for frame in 0..n_frames {
            words.more();
            let begins = words.line;
            for number in 0..n_channels {
                let what = || format!("number {} of {n_channels} of frame {} of {n_frames}", number + 1, frame + 1);
                if !words.more() {
                    return words.fault("the end", &(what() + &hint(ragged)));
                }
                let word = words.next("a number")?;
                match word.parse::<f64>() {
                    Ok(value) if value.is_finite() => values.push(value),
                    _ => return words.fault(&format!("`{word}`"), &what()),
                }
            }
            if !words.rest.is_empty() && ragged.is_none() {
                ragged = Some(begins);
            }
        }
        if words.more() {
            let word = words.next("the end")?;
            return words.fault(&format!("`{word}`"), &format!("the end behind {n_frames} frames{}", hint(ragged)));
        }
        Ok(Self { joints, frame_s, values })
    }
}

/// From the root's name to its closing brace.
fn joints(words: &mut Words) -> Result<Vec<Joint>, BvhError> {
    let mut joints = vec![joint(words, None)?];
    let mut open = vec![0];
    while let Some(&parent) = open.last() {
        match words.next("`JOINT`, `End Site` or `}`")? {
            "}" => drop(open.pop()),
            word if word.eq_ignore_ascii_case("JOINT") => {
                if joints.len() >= MOST_JOINTS {
                    return words.fault(&format!("more than {MOST_JOINTS} joints"), "a body");
                }
                open.push(joints.len());
                joints.push(joint(words, Some(parent))?);
            }
            word if word.eq_ignore_ascii_case("End") => {
                words.expect("Site")?;
                words.expect("{")?;
                let end = words.offset()?;
                words.expect("}")?;
                if joints[parent].end.replace(end).is_some() {
                    return words.fault("a second `End Site`", "at most one of a joint");
                }
            }
            word => return words.fault(&format!("`{word}`"), "`JOINT`, `End Site` or `}`"),
        }
    }
    Ok(joints)
}

/// From a joint's name to its channels.
fn joint(words: &mut Words, parent: Option<usize>) -> Result<Joint, BvhError> {
    let name = words.name("the name of a joint")?;
    words.expect("{")?;
    let offset = words.offset()?;
    words.expect("CHANNELS")?;
    let n_channels = words.count("the number of channels")?;
    if n_channels > 6 {
        return words.fault(&format!("{n_channels} channels"), "at most 6");
    }
    let channels = (0..n_channels).map(|_| channel(words)).collect::<Result<_, _>>()?;
    Ok(Joint { name, parent, offset, channels, end: None })
}

fn channel(words: &mut Words) -> Result<Channel, BvhError> {
    const EXPECTED: &str = "a channel such as `Xposition` or `Zrotation`";
    let word = words.next(EXPECTED)?;
    let axis = match word.as_bytes().first() {
        Some(b'X' | b'x') => Axis::X,
        Some(b'Y' | b'y') => Axis::Y,
        Some(b'Z' | b'z') => Axis::Z,
        _ => return words.fault(&format!("`{word}`"), EXPECTED),
    };
    match word[1..].to_ascii_lowercase().as_str() {
        "position" => Ok(Channel::Position(axis)),
        "rotation" => Ok(Channel::Rotation(axis)),
        _ => words.fault(&format!("`{word}`"), EXPECTED),
    }
}
