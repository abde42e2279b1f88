//! Events of a run, those alike taken together.

use std::collections::BTreeMap;

use crate::folder::Rows;

/// An event, and those like it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Event {
    /// `fault`, `gap`, `suspended`, `resumed`, `note` or `unmet`.
    pub(crate) what: String,
    pub(crate) place: String,
    pub(crate) first_time_s: Option<f64>,
    /// How often it came, and those like it; 0 where none is counted.
    pub(crate) count: f64,
    pub(crate) action: String,
    pub(crate) message: String,
    /// How many rows differ from it only in the camera and in numbers.
    pub(crate) others: usize,
}

/// The events in the order of the file, the first of each kind.
pub(crate) fn events(rows: &Rows, cameras: &[String]) -> Vec<Event> {
    let mut found: Vec<Event> = Vec::new();
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    for row in rows.iter() {
        let [what, place, action, message] = ["what", "where", "action", "message"].map(|it| row.text(it).to_owned());
        if what.is_empty() {
            continue;
        }
        let kind = format!("{what}\n{}\n{action}\n{}", without_cameras(&place), kind(&message, cameras));
        let count = row.count("count");
        if let Some(&known) = places.get(&kind) {
            found[known].others += 1;
            found[known].count += count;
        } else {
            places.insert(kind, found.len());
            let first_time_s = row.number("first_time_s");
            found.push(Event { what, place, first_time_s, count, action, message, others: 0 });
        }
    }
    found
}

/// `room.leds[wide-1].features` without what stands in brackets.
pub(crate) fn without_cameras(edge: &str) -> String {
    let mut parts = edge.split('[');
    let start = parts.next().unwrap_or_default().to_owned();
    parts.fold(start, |text, part| text + part.split_once(']').map_or(part, |it| it.1))
}

/// A message without what differs from camera to camera: its name, and numbers.
fn kind(message: &str, cameras: &[String]) -> String {
    let is_word = |it: char| it.is_alphanumeric() || matches!(it, '-' | '_' | '.');
    let mut kind = String::new();
    for piece in message.split_inclusive(|it| !is_word(it)) {
        let word = piece.trim_end_matches(|it| !is_word(it));
        if cameras.iter().any(|it| it == word) {
            kind.push('*');
            kind += &piece[word.len()..];
        } else if word.chars().any(|it| it.is_ascii_digit()) {
            kind.extend(word.chars().filter(|it| !it.is_ascii_digit() && *it != '.'));
            kind.push('#');
            kind += &piece[word.len()..];
        } else {
            kind += piece;
        }
    }
    kind
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_that_differ_in_camera_and_number_are_one() {
        let text = "what,where,first_time_s,count,action,message\n\
                    gap,room.video[c1],1.5,3,,\"frame 10 of c1 is lost\"\ngap,room.video[c2],2.5,4,,\"frame 7.5 of c2 is lost\"\n\
                    gap,room.video[c2],3,1,,another\nnote,,,,,\"c1: dark\"\nnote,,,,,\"c2: dark\"\n";
        let cameras = ["c1", "c2"].map(str::to_owned);
        let found = events(&Rows::parse(text, "what").unwrap(), &cameras);
        let short: Vec<_> = found
            .iter()
            .map(|it| (it.what.as_str(), it.first_time_s, it.count, it.message.as_str(), it.others))
            .collect();
        assert_eq!(
            short,
            [
                ("gap", Some(1.5), 7.0, "frame 10 of c1 is lost", 1),
                ("gap", Some(3.0), 1.0, "another", 0),
                ("note", None, 0.0, "c1: dark", 1)
            ]
        );
    }

    #[test]
    fn edges_lose_their_cameras() {
        assert_eq!(without_cameras("room.leds[wide-1].x -> room.t[a].x"), "room.leds.x -> room.t.x");
        assert_eq!(without_cameras("no camera"), "no camera");
        assert_eq!(without_cameras("open[bracket"), "openbracket");
    }
}
