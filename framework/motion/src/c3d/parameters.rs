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

/// Where the parameter section lies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Section {
    /// Its first byte.
    pub start: usize,
    /// How many blocks its head counts; 0: it does not say.
    pub n_blocks: usize,
    /// The first byte of the points, which lie behind it as a rule; 0: not known.
    pub data_start: usize,
}

impl Section {
    /// The byte behind its last one: by its own count, else where the points begin, else the end of the file.
    fn end(self, length: usize) -> usize {
        let end = match (self.n_blocks, self.data_start > self.start) {
            (1.., _) => self.start + self.n_blocks * BLOCK,
            (0, true) => self.data_start,
            (0, false) => length,
        };
        end.min(length)
    }
}

/// All parameters of a file.
#[derive(Debug, Clone)]
pub(super) struct Parameters<'a> {
    bytes: Bytes<'a>,
    /// What was not as the format's guide has it, and is passed over.
    pub remarks: Vec<String>,
    /// Number and name.
    groups: Vec<(u8, String)>,
    list: Vec<Parameter<'a>>,
}

impl<'a> Parameters<'a> {
    /// Those of a section, behind the four bytes of its head.
    ///
    /// The list ends with an entry without a name, with a link of 0, or with the section. A link that does not lead to the end of its
    /// entry, and does with its two bytes swapped, is taken so: files of SGI machines have such a last one.
    pub fn read(bytes: Bytes<'a>, section: Section) -> Result<Self, C3dError> {
        let mut this = Self { bytes, remarks: Vec::new(), groups: Vec::new(), list: Vec::new() };
        let mut end = section.end(bytes.all.len());
        let mut at = section.start + 4;
        while at < end {
            let length = usize::from((bytes.byte(at, "a parameter's name")? as i8).unsigned_abs());
            if length == 0 {
                break;
            }
            let number = bytes.byte(at + 1, "a parameter's group")? as i8;
            let name = text(bytes.range(at + 2, length, "a parameter's name")?).to_uppercase();
            let link = at + 2 + length;
            let step = usize::from(bytes.word(link, "the link to the next parameter")?);
            let behind = match number {
                0 => return fault(at + 1, "group 0", format_args!("a group from 1 to 127 of `{name}`")),
                ..0 => {
                    this.groups.push((number.unsigned_abs(), name));
                    link + 2
                }
                1.. => {
                    let (parameter, behind) = parameter(bytes, link + 2, number.unsigned_abs(), name)?;
                    this.list.push(parameter);
                    behind
                }
            };
            // The description, its length first; the last one may be cut off with the section.
            let natural = behind + 1 + bytes.byte(behind, "a description").map_or(0, usize::from);
            if step == 0 {
                break;
            }
            let swapped = usize::from((step as u16).swap_bytes());
            if link + step != natural && link + swapped == natural {
                this.remarks.push(format!(
                    "the link of {step} at byte {link} has its bytes swapped, and is taken as {swapped}"
                ));
                at = natural;
                continue;
            }
            if step < 2 || link + step > bytes.all.len() {
                let found = format!("a next parameter {step} bytes ahead");
                return fault(link, found, format_args!("0, or 2 to {} bytes", bytes.all.len() - link));
            }
            at = link + step;
            if at > end && section.data_start >= at {
                let n_blocks = section.n_blocks;
                this.remarks
                    .push(format!("the parameters go on behind the {n_blocks} blocks that their section counts"));
                end = section.data_start.min(bytes.all.len());
            }
        }
        Ok(this)
    }

    fn get(&self, group: &str, name: &str) -> Option<&Parameter<'a>> {
        let number = self.groups.iter().find(|it| it.1 == group)?.0;
        self.list.iter().find(|it| it.group == number && it.name == name)
    }

    /// The names of a group's parameters, in the order of the file.
    pub fn names(&self, group: &str) -> Vec<&str> {
        let Some((number, _)) = self.groups.iter().find(|it| it.1 == group) else { return Vec::new() };
        self.list.iter().filter(|it| it.group == *number).map(|it| it.name.as_str()).collect()
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

/// The parameter whose kind stands at `at`, and the byte behind its values.
fn parameter<'a>(bytes: Bytes<'a>, at: usize, group: u8, name: String) -> Result<(Parameter<'a>, usize), C3dError> {
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
    let behind = at + 2 + n_dimensions + length;
    Ok((Parameter { group, name, kind, dimensions, values }, behind))
}
