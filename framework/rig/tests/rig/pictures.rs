//! Pictures of graphs: whole, well formed, nothing on top of anything.

use std::time::{Duration, Instant};

use crate::accepted::LAB;
use crate::parts::good;

/// Three nested scales, edges past columns, and a feedback edge in two of them.
const NESTED: &str = r#"
[scale.room.node.smooth]
type = "test.smoother"
in.targets = "targets.targets"
[scale.room.node.second-table]
type = "test.table"
in.targets = ["smooth.targets", "targets.targets"]
[scale.face.node.zoom]
type = "test.camera"
each = "ptz-*"
[scale.face.node.spots]
type = "test.detector"
each = "ptz-*"
in = { image = "zoom.image", hints = "marks.hints" }
[scale.face.node.marks]
type = "test.integrator"
in.features = "spots.features"
[scale.lips]
parent = "face"
anchor = "marks.<lips> & \"teeth\""
[scale.lips.node.closer]
type = "test.aim"
latency_ms = 20
in.target = "face.marks.targets"
[scale.lips.node.mirror]
type = "test.motor"
in.command = "closer.command"
"#;

/// The tags of an XML document; panics where they do not nest.
#[track_caller]
fn tags(xml: &str) -> Vec<&str> {
    let mut open = Vec::new();
    let mut tags = Vec::new();
    for piece in xml.split('<').skip(1) {
        let (tag, text) = piece.split_once('>').expect("every tag ends");
        assert!(!text.contains('>'), "{text}");
        for entity in text.split('&').skip(1) {
            assert!(["amp;", "lt;", "gt;", "quot;"].iter().any(|it| entity.starts_with(it)), "{text}");
        }
        let name = tag.split([' ', '/']).find(|it| !it.is_empty()).unwrap_or_default();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name));
        } else if !tag.ends_with('/') {
            open.push(name);
        }
        tags.push(tag);
    }
    assert!(open.is_empty(), "{open:?}");
    tags
}

fn number(tag: &str, name: &str) -> f64 {
    let value = tag.split(&format!(" {name}=\"")).nth(1).and_then(|it| it.split('"').next());
    value.and_then(|it| it.parse().ok()).unwrap_or(f64::NAN)
}

#[test]
fn drawing_is_well_formed_and_boxes_lie_apart_in_it() {
    let svg = good(&format!("{LAB}{NESTED}")).to_svg();
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    let tags = tags(&svg);
    let (width, height) = (number(tags[0], "width"), number(tags[0], "height"));
    let boxes: Vec<[f64; 4]> = tags
        .iter()
        .filter(|it| it.starts_with("rect") && it.contains("rx=\"6\""))
        .map(|it| ["x", "y", "width", "height"].map(|name| number(it, name)))
        .collect();
    assert_eq!(boxes.len(), 15);
    for (index, [x, y, w, h]) in boxes.iter().copied().enumerate() {
        assert!(x >= 0.0 && y >= 0.0 && x + w <= width && y + h <= height, "{x} {y} {w} {h} in {width} {height}");
        for &[x2, y2, w2, h2] in &boxes[index + 1..] {
            assert!(x + w < x2 || x2 + w2 < x || y + h < y2 || y2 + h2 < y, "{x} {y} meets {x2} {y2}");
        }
    }
    assert_eq!(svg.matches("stroke-dasharray").count(), 2 + 1, "two feedback edges and the legend");
    assert!(svg.contains("&lt;lips&gt; &amp; &quot;teeth&quot;") && svg.contains(">×3<"), "{svg}");
}

#[test]
fn flow_chart_nests_scales_and_dots_feedback() {
    let chart = good(&format!("{LAB}{NESTED}")).to_mermaid();
    let lines: Vec<&str> = chart.lines().map(str::trim).collect();
    assert_eq!(lines[0], "flowchart LR");
    assert_eq!(lines.iter().filter(|it| it.starts_with("subgraph")).count(), 3);
    let last = lines.iter().rposition(|it| it.starts_with("subgraph")).unwrap();
    let ends = lines[last..].iter().filter(|it| **it == "end").count();
    assert_eq!(ends, 3, "each scale lies in the one before\n{chart}");
    assert!(lines.contains(&"n0[\"video ×3<br/><i>test.camera</i>\"]:::source"), "{chart}");
    assert_eq!(lines.iter().filter(|it| it.contains("-.->|hints|")).count(), 2);
}

#[test]
fn large_graph_is_drawn_in_time() {
    let graph = good(&crate::sizes::chain(20_000));
    let begin = Instant::now();
    tags(&graph.to_svg());
    assert!(graph.to_mermaid().lines().count() > 40_000);
    assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", begin.elapsed());
}
