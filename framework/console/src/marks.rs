//! Marks corrected by hand [Davis 2002 §5.1, Fig. 56]: the rows, their file, and where a tracker may have gone wrong.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use foveate_diagnostics::fields::field;
use foveate_messages::{CameraId, Features, MarkGuide, Time};
use foveate_node::given::{Table, Value as Given};
use foveate_rig::graph::Graph;
use foveate_session::glance::Glance;
use nalgebra::{Point2, Vector2};
use serde_json::{Value, json};

use crate::hello::Index;

/// The setting of a node that takes rows.
pub const SETTING: &str = "corrections";
/// Problems that a page lists, at most.
const MOST_PROBLEMS: usize = 500;

/// One correction.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The node, as the page numbers it.
    pub node: usize,
    /// The camera.
    pub camera: usize,
    /// The mark.
    pub mark: u32,
    /// Sequence number of the picture.
    pub frame: u64,
    /// Where it is [px]; `None`: not visible from there on.
    pub pixel: Option<[f64; 2]>,
}

impl Row {
    /// Reads a row as a page sends it, and whether it is to be taken away.
    ///
    /// # Errors
    /// What was found and what is expected.
    pub fn read(node: usize, it: &Value, n_cameras: usize) -> Result<(Row, bool), String> {
        let whole = |name: &str, most: u64| {
            let found = it.get(name).and_then(Value::as_u64).filter(|it| *it <= most);
            found.ok_or_else(|| format!("found {name} {}, expected a whole number up to {most}", it[name]))
        };
        let camera = usize::try_from(whole("camera", n_cameras.saturating_sub(1) as u64)?).unwrap_or(usize::MAX);
        let mark = u32::try_from(whole("mark", u64::from(u32::MAX))?).unwrap_or(u32::MAX);
        let frame = whole("frame", i64::MAX as u64)?;
        let pixel = match (it["u"].as_f64(), it["v"].as_f64()) {
            (Some(u), Some(v)) => Some([u, v]),
            (None, None) if it["u"].is_null() && it["v"].is_null() => None,
            _ => return Err(format!("found ({}, {}), expected two numbers or nothing", it["u"], it["v"])),
        };
        Ok((Row { node, camera, mark, frame, pixel }, it["remove"] == true))
    }

    fn is_same(&self, other: &Row) -> bool {
        (self.node, self.camera, self.mark, self.frame) == (other.node, other.camera, other.mark, other.frame)
    }

    fn in_json(&self) -> Value {
        let at = |place: usize| self.pixel.map(|it| it[place]);
        json!({ "node": self.node, "camera": self.camera, "mark": self.mark, "frame": self.frame, "u": at(0), "v": at(1) })
    }
}

/// All rows of a run or a session.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// In the order of nodes, cameras, frames and marks.
    pub list: Vec<Row>,
    cameras: Vec<String>,
}

impl Rows {
    /// Those that the nodes of a graph have already.
    pub fn of(graph: &Graph, index: &Index) -> Rows {
        let cameras: Vec<String> = graph.calibration.cameras.iter().map(|it| it.name.clone()).collect();
        let mut rows = Rows { list: Vec::new(), cameras };
        for (node, (_, instances)) in index.nodes.iter().enumerate() {
            let settings = foveate_rig::live::table(&*graph.instances[instances[0]].settings).unwrap_or_default();
            let Some(Given::List(list)) = settings.get(SETTING) else { continue };
            for it in list {
                let row = rows.given(node, it);
                rows.list.extend(row);
            }
        }
        rows
    }

    fn given(&self, node: usize, it: &Given) -> Option<Row> {
        let Given::Table(it) = it else { return None };
        let whole =
            |name: &str| if let Some(Given::Integer(it)) = it.get(name) { u64::try_from(*it).ok() } else { None };
        let number = |name: &str| match it.get(name) {
            Some(Given::Float(it)) => Some(*it),
            Some(Given::Integer(it)) => Some(*it as f64),
            _ => None,
        };
        let Some(Given::Text(camera)) = it.get("camera") else { return None };
        let camera = self.cameras.iter().position(|it| it == camera)?;
        let pixel = number("u_px").zip(number("v_px")).map(|(u, v)| [u, v]);
        Some(Row { node, camera, mark: u32::try_from(whole("mark")?).ok()?, frame: whole("frame")?, pixel })
    }

    /// Puts a row in the place of an earlier one of the same camera, mark and picture, or takes that away.
    pub fn put(&mut self, row: Row, is_removed: bool) {
        self.list.retain(|it| !it.is_same(&row));
        if !is_removed {
            self.list.push(row);
            self.list.sort_by_key(|it| (it.node, it.camera, it.frame, it.mark));
        }
    }

    /// The setting of a node.
    pub fn setting(&self, node: usize) -> Table {
        let number = |name: &str, it: f64| (name.to_owned(), Given::Float(it));
        let row = |it: &Row| {
            let mut table: Table = [
                ("camera".to_owned(), Given::Text(self.cameras[it.camera].clone())),
                ("mark".to_owned(), Given::Integer(it.mark.into())),
                ("frame".to_owned(), Given::Integer(i64::try_from(it.frame).unwrap_or(i64::MAX))),
            ]
            .into();
            table.extend(it.pixel.into_iter().flat_map(|[u, v]| [number("u_px", u), number("v_px", v)]));
            Given::Table(table)
        };
        let list = self.list.iter().filter(|it| it.node == node).map(row).collect();
        [(SETTING.to_owned(), Given::List(list))].into()
    }

    /// Nodes that have rows, in order.
    pub fn nodes(&self) -> Vec<usize> {
        let mut nodes: Vec<usize> = self.list.iter().map(|it| it.node).collect();
        nodes.dedup();
        nodes
    }

    /// As the page lists them.
    pub fn in_json(&self) -> Value {
        self.list.iter().map(Row::in_json).collect()
    }

    /// Writes the table that a tracker reads as its setting `marks`: all rows of all nodes.
    ///
    /// # Errors
    /// A sentence.
    pub fn write(&self, path: &Path) -> Result<(), String> {
        let mut text = "camera,mark,frame,u_px,v_px\n".to_owned();
        for it in &self.list {
            let camera = field(&self.cameras[it.camera]);
            let _ = match it.pixel {
                Some([u, v]) => writeln!(text, "{camera},{},{},{u},{v}", it.mark, it.frame),
                None => writeln!(text, "{camera},{},{},,", it.mark, it.frame),
            }; // writing to a text cannot fail
        }
        std::fs::write(path, text).map_err(|error| format!("`{}` cannot be written: {error}", path.display()))
    }
}

/// One camera's labelled marks in one picture.
struct Seen {
    frame: u64,
    time: Time,
    marks: BTreeMap<u32, Point2<f64>>,
}

/// Where the tracker of `node` may have gone wrong: identity swaps, then gaps, the longest first.
pub fn problems(glance: &mut Glance, graph: &Graph, index: &Index, node: usize) -> Vec<Value> {
    let mut swaps = Vec::new();
    let mut gaps = Vec::new();
    for &instance in &index.nodes[node].1 {
        let it = &graph.instances[instance];
        let Some(camera) = it.camera else { continue };
        let outputs = it.node_type.ports.outputs.iter();
        let Some(port) = outputs.clone().position(|it| it.message.name == "features") else { continue };
        let mut seen = Vec::new();
        glance.each((instance, port), &mut |packet| {
            let Some(features) = packet.as_typed::<Features>() else { return };
            let marks = features.list.iter().filter_map(|it| Some((it.label?, it.centre))).collect();
            seen.push(Seen { frame: packet.stamp.sequence, time: packet.stamp.time, marks });
        });
        for pair in seen.windows(2) {
            for (a, b) in swapped(&pair[0].marks, &pair[1].marks) {
                let reason = format!("marks {a} and {b} changed places");
                swaps.push(json!({
                    "kind": "swap", "camera": camera.0, "mark": a, "other": b, "frame": pair[1].frame, "at_s": pair[1].time.as_s(), "reason": reason,
                }));
            }
        }
        let guide = graph.edges.iter().find(|edge| {
            let from = &graph.instances[edge.from.0].node_type.ports.outputs[edge.from.1];
            edge.to.0 == instance && from.message.name == "mark_guide"
        });
        let mut guides: Vec<(Time, MarkGuide)> = Vec::new();
        if let Some(edge) = guide {
            glance.each(edge.from, &mut |packet| {
                guides.extend(packet.as_typed::<MarkGuide>().map(|it| (packet.stamp.time, it.clone())));
            });
        }
        let size = graph.calibration.cameras.get(usize::from(camera.0)).map(|it| it.camera.image_size);
        gaps.extend(missing(&seen).into_iter().map(|(mark, from, n_frames, until)| {
            let reason = reason(&guides, camera, mark, seen[from].time, size);
            let gap = json!({
                "kind": "gap", "camera": camera.0, "mark": mark, "other": null, "frame": seen[from].frame, "at_s": seen[from].time.as_s(),
                "frames": n_frames, "until_s": until.map(Time::as_s), "reason": reason,
            });
            (n_frames, gap)
        }));
    }
    gaps.sort_by_key(|it| std::cmp::Reverse(it.0));
    swaps.into_iter().chain(gaps.into_iter().map(|it| it.1)).take(MOST_PROBLEMS).collect()
}

/// Pairs of marks that have changed places: exchanged, both would have moved with the others, and less than half as far.
fn swapped(before: &BTreeMap<u32, Point2<f64>>, now: &BTreeMap<u32, Point2<f64>>) -> Vec<(u32, u32)> {
    let both: Vec<(u32, Point2<f64>, Point2<f64>)> =
        before.iter().filter_map(|(label, place)| Some((*label, *place, *now.get(label)?))).collect();
    let median = |axis: usize| {
        let mut steps: Vec<f64> = both.iter().map(|it| (it.2 - it.1)[axis]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or(0.0)
    };
    let usual = Vector2::new(median(0), median(1));
    let mut found = Vec::new();
    for (place, a) in both.iter().enumerate() {
        for b in &both[place + 1..] {
            let kept = (a.2 - a.1 - usual).norm() + (b.2 - b.1 - usual).norm();
            let exchanged = (a.2 - b.1 - usual).norm() + (b.2 - a.1 - usual).norm();
            if exchanged < 0.5 * kept {
                found.push((a.0, b.0));
            }
        }
    }
    found
}

/// By mark: where in `seen` a gap begins, how many pictures it lasts, and when the mark is seen again.
fn missing(seen: &[Seen]) -> Vec<(u32, usize, usize, Option<Time>)> {
    let mut last: BTreeMap<u32, usize> = BTreeMap::new();
    let mut found = Vec::new();
    for (at, it) in seen.iter().enumerate() {
        for &label in it.marks.keys() {
            if let Some(before) = last.insert(label, at).filter(|before| before + 1 < at) {
                found.push((label, before + 1, at - before - 1, Some(it.time)));
            }
        }
    }
    let ends = last.into_iter().filter(|it| it.1 + 1 < seen.len());
    found.extend(ends.map(|(label, before)| (label, before + 1, seen.len() - before - 1, None)));
    found
}

/// Why a mark was not seen, as far as the guide tells.
fn reason(guides: &[(Time, MarkGuide)], camera: CameraId, mark: u32, at: Time, size: Option<[u32; 2]>) -> &'static str {
    let place = guides.partition_point(|it| it.0 <= at);
    let guide = place.checked_sub(1).map(|it| guides[it].1.of(camera)).unwrap_or_default();
    let Some(guided) = guide.iter().find(|it| it.label == mark) else { return "not found" };
    let is_inside = size.is_none_or(|size| {
        [guided.pixel.x, guided.pixel.y].iter().zip(size).all(|(it, n)| (-0.5..f64::from(n) - 0.5).contains(it))
    });
    match is_inside {
        false => "outside the picture",
        true if guided.disputed => "other cameras disagree",
        true => "not found",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marks(list: &[(u32, f64, f64)]) -> BTreeMap<u32, Point2<f64>> {
        list.iter().map(|(label, u, v)| (*label, Point2::new(*u, *v))).collect()
    }

    #[test]
    fn marks_that_change_places_are_told_from_marks_that_move_together() {
        let before = marks(&[(1, 10.0, 10.0), (2, 22.0, 10.0), (3, 10.0, 30.0), (4, 40.0, 40.0)]);
        let moved =
            |it: &BTreeMap<u32, Point2<f64>>| it.iter().map(|(k, p)| (*k, p + Vector2::new(12.0, 0.3))).collect();
        let together: BTreeMap<u32, Point2<f64>> = moved(&before);
        // Each goes to where its neighbour was: no swap.
        assert!(swapped(&before, &together).is_empty());
        let mut exchanged = together.clone();
        exchanged.insert(1, together[&2]);
        exchanged.insert(2, together[&1]);
        assert_eq!(swapped(&before, &exchanged), [(1, 2)]);
        // One that jumps to where another was, which is not seen any more.
        let mut jumped = together.clone();
        jumped.insert(1, together[&2]);
        jumped.remove(&2);
        assert!(swapped(&before, &jumped).is_empty());
    }

    #[test]
    fn gaps_are_between_sightings_and_up_to_the_end() {
        let at = |frame: u64, labels: &[u32]| Seen {
            frame,
            time: Time(frame as i64),
            marks: labels.iter().map(|it| (*it, Point2::origin())).collect(),
        };
        let seen = [at(0, &[1, 2]), at(1, &[1]), at(2, &[1, 2]), at(3, &[2]), at(4, &[2, 5])];
        assert_eq!(missing(&seen), [(2, 1, 1, Some(Time(2))), (1, 3, 2, None)]);
        assert!(missing(&[]).is_empty());
    }

    #[test]
    fn a_row_takes_the_place_of_the_one_before_and_can_be_taken_away() {
        let read = |text: &str| Row::read(3, &serde_json::from_str(text).unwrap(), 5);
        let (row, is_removed) = read(r#"{"camera":4,"mark":7,"frame":12,"u":1.5,"v":2}"#).unwrap();
        assert_eq!((row.pixel, is_removed), (Some([1.5, 2.0]), false));
        for wrong in [
            r#"{"camera":5,"mark":7,"frame":12,"u":1.5,"v":2}"#,
            r#"{"camera":4,"mark":-7,"frame":12,"u":1.5,"v":2}"#,
            r#"{"camera":4,"mark":7,"frame":12,"u":1.5}"#,
            r#"{"camera":4,"mark":7,"frame":12,"u":"x","v":1}"#,
            r#"{"camera":4,"mark":7}"#,
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        let mut rows = Rows { list: Vec::new(), cameras: ["a", "b", "c", "d", "e, f"].map(str::to_owned).to_vec() };
        rows.put(row.clone(), false);
        rows.put(Row { pixel: None, ..row.clone() }, false);
        rows.put(Row { frame: 2, ..row.clone() }, false);
        assert_eq!(
            rows.list.iter().map(|it| (it.frame, it.pixel.is_some())).collect::<Vec<_>>(),
            [(2, true), (12, false)]
        );
        assert_eq!(Rows { list: vec![rows.given(3, &first(&rows)).unwrap()], ..rows.clone() }.list, rows.list[..1]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        rows.write(&path).unwrap();
        let expected = "camera,mark,frame,u_px,v_px\n\"e, f\",7,2,1.5,2\n\"e, f\",7,12,,\n";
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
        rows.put(row, true);
        assert_eq!((rows.list.len(), rows.nodes()), (1, vec![3]));
    }

    fn first(rows: &Rows) -> Given {
        let Some(Given::List(list)) = rows.setting(3).remove(SETTING) else { panic!() };
        list[0].clone()
    }
}
