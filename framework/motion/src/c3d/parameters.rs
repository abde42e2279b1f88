//! The parameters of a C3D file: named values in named groups.

use super::order::{Bytes, text};
use super::{BLOCK, C3dError, fault};

/// As many values of a parameter are looked at: points and channels are counted in 16 bits.
const MOST_VALUES: usize = 65_535;

/// One parameter; its values lie in the file.
#[derive(Debug, Clone)]
struct Parameter<'a> {
    group: u8,
    name: String,
    /// −1: characters, 1: bytes, 2: words, 4: floats.
    kind: i8,
    dimensions: Vec<usize>,
    values: &'a [u8],
}

/// All parameters of a file.
#[derive(Debug, Clone)]
pub(super) struct Parameters<'a> {
    bytes: Bytes<'a>,
    /// Number and name.
    groups: Vec<(u8, String)>,
    list: Vec<Parameter<'a>>,
}

impl<'a> Parameters<'a> {
    /// Those that stand from `start` on: after the four bytes of the section's head.
    pub fn read(bytes: Bytes<'a>, start: usize) -> Result<Self, C3dError> {
        let mut this = Self { bytes, groups: Vec::new(), list: Vec::new() };
        let mut at = start;
        loop {
            // A section that fills its last block to the end has no room for the mark of its end.
            if at == bytes.all.len() || ((at - start + 4).is_multiple_of(BLOCK) && bytes.all.get(at) == Some(&0)) {
                break;
            }
            let length = usize::from((bytes.byte(at, "a parameter's name")? as i8).unsigned_abs());
            if length == 0 {
                break;
            }
            let number = bytes.byte(at + 1, "a parameter's group")? as i8;
            let name = text(bytes.range(at + 2, length, "a parameter's name")?).to_uppercase();
            let link = at + 2 + length;
            let step = usize::from(bytes.word(link, "the way to the next parameter")?);
            match number {
                0 => return fault(at + 1, "group 0", format_args!("a group from 1 to 127 of `{name}`")),
                ..0 => this.groups.push((number.unsigned_abs(), name)),
                1.. => this.list.push(parameter(bytes, link + 2, number.unsigned_abs(), name)?),
            }
            if step == 0 {
                break;
            }
            if step < 2 || link + step > bytes.all.len() {
                let found = format!("a next parameter {step} bytes ahead");
                return fault(link, found, format_args!("0, or 2 to {} bytes", bytes.all.len() - link));
            }
            at = link + step;
        }
        Ok(this)
    }

    fn get(&self, group: &str, name: &str) -> Option<&Parameter<'a>> {
        let number = self.groups.iter().find(|it| it.1 == group)?.0;
        self.list.iter().find(|it| it.group == number && it.name == name)
    }

    /// The numbers of a parameter, whatever they are stored as; empty where it is missing or text.
    pub fn numbers(&self, group: &str, name: &str) -> Vec<f64> {
        let Some(parameter) = self.get(group, name) else { return Vec::new() };
        let order = self.bytes.order;
        let values = parameter.values;
        match parameter.kind {
            1 => values.iter().take(MOST_VALUES).map(|&it| f64::from(it)).collect(),
            2 => {
                let words = values.chunks_exact(2).take(MOST_VALUES);
                words.map(|it| f64::from(order.word([it[0], it[1]]) as i16)).collect()
            }
            4 => {
                let floats = values.chunks_exact(4).take(MOST_VALUES);
                floats.map(|it| f64::from(order.float([it[0], it[1], it[2], it[3]]))).collect()
            }
            _ => Vec::new(),
        }
    }

    /// The first number of a parameter.
    pub fn number(&self, group: &str, name: &str) -> Option<f64> {
        self.numbers(group, name).first().copied()
    }

    /// The first number of a parameter as a count: words have no sign.
    pub fn count(&self, group: &str, name: &str) -> Option<usize> {
        let is_word = self.get(group, name)?.kind == 2;
        let number = self.number(group, name)?;
        Some(if is_word { usize::from(number as i16 as u16) } else { number.max(0.0) as usize })
    }

    /// A number of two words, the lower one first.
    pub fn double_word(&self, group: &str, name: &str) -> Option<usize> {
        match (self.get(group, name)?.kind, &self.numbers(group, name)[..]) {
            (2, [low, high, ..]) => Some(usize::from(*low as i16 as u16) | usize::from(*high as i16 as u16) << 16),
            _ => None,
        }
    }

    /// The texts of a parameter.
    pub fn texts(&self, group: &str, name: &str) -> Vec<String> {
        let Some(it) = self.get(group, name).filter(|it| it.kind == -1) else { return Vec::new() };
        match it.dimensions.first() {
            None | Some(0) if it.values.is_empty() => Vec::new(),
            None | Some(0) => vec![text(it.values)],
            Some(&length) => it.values.chunks(length).take(MOST_VALUES).map(text).collect(),
        }
    }

    /// The texts of `name`, `name2`, `name3` and so on, one after the other.
    pub fn continued_texts(&self, group: &str, name: &str) -> Vec<String> {
        continued(name, |name| self.texts(group, name))
    }

    /// As [`Self::continued_texts`], of numbers.
    pub fn continued_numbers(&self, group: &str, name: &str) -> Vec<f64> {
        continued(name, |name| self.numbers(group, name))
    }
}

/// What `get` gives for `name`, `name2`, … until nothing comes or there are more than a file can have points.
fn continued<T>(name: &str, get: impl Fn(&str) -> Vec<T>) -> Vec<T> {
    let mut all = get(name);
    for number in 2.. {
        let more = get(&format!("{name}{number}"));
        if more.is_empty() || all.len() >= MOST_VALUES {
            break;
        }
        all.extend(more);
    }
    all
}

/// The parameter whose kind stands at `at`.
fn parameter<'a>(bytes: Bytes<'a>, at: usize, group: u8, name: String) -> Result<Parameter<'a>, C3dError> {
    let kind = bytes.byte(at, "a parameter's kind")? as i8;
    if !matches!(kind, -1 | 1 | 2 | 4) {
        return fault(at, format_args!("kind {kind} of `{name}`"), "-1, 1, 2 or 4");
    }
    let n_dimensions = usize::from(bytes.byte(at + 1, "a parameter's dimensions")?);
    if n_dimensions > 7 {
        return fault(at + 1, format_args!("{n_dimensions} dimensions of `{name}`"), "0 to 7");
    }
    let dimensions = bytes.range(at + 2, n_dimensions, "a parameter's dimensions")?;
    let dimensions: Vec<usize> = dimensions.iter().map(|&it| usize::from(it)).collect();
    // Seven bytes and a size of four: fits 64 bits, and on smaller machines it saturates.
    let length = dimensions.iter().fold(usize::from(kind.unsigned_abs()), |all, &it| all.saturating_mul(it));
    let values = bytes.range(at + 2 + n_dimensions, length, &format!("`{name}`"))?;
    Ok(Parameter { group, name, kind, dimensions, values })
}
