//! Camera counters that wrap around: after `DSC_9999.JPG` comes `DSC_0001.JPG`, which sorts before it by name.

use std::path::{Path, PathBuf};

/// A name's part before its last number, the number and how many digits it has, and the part after it.
fn parts(path: &Path) -> Option<(String, u64, usize, String)> {
    let name = path.file_name()?.to_str()?;
    let end = name.rfind(|it: char| it.is_ascii_digit())? + 1;
    let start = name[..end]
        .rfind(|it: char| !it.is_ascii_digit())
        .map_or(0, |it| it + name[it..].chars().next().map_or(1, char::len_utf8));
    let digits = &name[start..end];
    Some((name[..start].to_owned(), digits.parse().ok()?, digits.len(), name[end..].to_owned()))
}

/// Digits that a counter has at least.
const MIN_DIGITS: usize = 3;

/// Of pictures in the order of their names, the place of the one that was taken first, where a counter wrapped around in the middle of the set; else 0.
///
/// It did where all names have the same words and as many digits, the last one has the highest number that these can say, the first one 0 or 1, and all but half of the
/// numbers in between are missing in one place.
pub(crate) fn first_taken(files: &[PathBuf]) -> usize {
    let Some(all) = files.iter().map(|it| parts(it)).collect::<Option<Vec<_>>>() else { return 0 };
    let (Some(first), Some(last)) = (all.first(), all.last()) else { return 0 };
    let is_alike = all.iter().all(|it| (&it.0, it.2, &it.3) == (&first.0, first.2, &first.3));
    let full = 10_u64.checked_pow(first.2 as u32);
    let Some(full) = full.filter(|it| is_alike && first.2 >= MIN_DIGITS && first.1 <= 1 && last.1 == it - 1) else {
        return 0;
    };
    (1..all.len()).find(|it| all[*it].1 - all[*it - 1].1 > full / 2).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first_of(names: &[&str]) -> usize {
        first_taken(&names.iter().map(PathBuf::from).collect::<Vec<_>>())
    }

    #[test]
    fn a_counter_that_begins_anew_is_told_from_numbers_that_lack() {
        assert_eq!(first_of(&["a/DSC_0001.JPG", "a/DSC_0002.JPG", "a/DSC_9998.JPG", "a/DSC_9999.JPG"]), 2);
        assert_eq!(first_of(&["000.png", "998.png", "999.png"]), 1);
        // One that did not reach its end, another word, fewer digits, no number, a gap that is not half of all, nothing.
        assert_eq!(first_of(&["DSC_0001.JPG", "DSC_9997.JPG", "DSC_9998.JPG"]), 0);
        assert_eq!(first_of(&["DSC_0001.JPG", "IMG_9998.JPG", "IMG_9999.JPG"]), 0);
        assert_eq!(first_of(&["1.png", "98.png", "99.png"]), 0);
        assert_eq!(first_of(&["white.png", "é.png"]), 0);
        assert_eq!(first_of(&["001.png", "400.png", "800.png", "999.png"]), 0);
        assert_eq!(first_of(&["é0001.png", "é9999.png"]), 1);
        assert_eq!(first_of(&[]), 0);
    }
}
