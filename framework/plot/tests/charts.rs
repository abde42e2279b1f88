//! Charts of degenerate, huge and awkward data: whole XML, finite numbers, nothing over anything, the same bytes.

use foveate_plot::colours::PAPER;
use foveate_plot::svg::Pen;
use foveate_plot::{Axis, COLOURS, Chart, Figure, Marks, Series, nothing};
use roxmltree::{Document, Node};

/// Points of any kind, in a figure of one chart.
fn figure(x: Axis, y: Axis, points: Vec<[f64; 2]>) -> Figure<'static> {
    let chart = Chart::new("a <title> & more", [400.0, 200.0], x, y)
        .with(Series::line("line", COLOURS[0], points.clone()))
        .with(Series::dots("dots", COLOURS[1], points));
    Figure { title: "a figure".to_owned(), n_columns: 1, charts: vec![chart] }
}

/// Every attribute that is a number or a path, in order; panics where one is not finite, and where the file is no XML.
#[track_caller]
fn check(svg: &str) -> Document<'_> {
    let xml = Document::parse(svg).unwrap_or_else(|error| panic!("{error}: {svg}"));
    for node in xml.descendants() {
        for attribute in node.attributes().filter(|it| !["font-family", "role"].contains(&it.name())) {
            let value = attribute.value();
            assert!(!value.contains("NaN") && !value.to_lowercase().contains("inf"), "{value}");
        }
    }
    xml
}

fn number(node: &Node<'_, '_>, name: &str) -> f64 {
    node.attribute(name).and_then(|it| it.parse().ok()).unwrap_or(f64::NAN)
}

/// The boxes around all texts that are not turned [px]: left, top, right, bottom, and what is written.
fn texts(xml: &Document<'_>) -> Vec<([f64; 4], String)> {
    let upright = xml.descendants().filter(|it| it.has_tag_name("text") && it.attribute("transform").is_none());
    let place = |node: Node<'_, '_>| {
        let text = node.text().unwrap_or_default().to_owned();
        let (x, y, size) = (number(&node, "x"), number(&node, "y"), number(&node, "font-size"));
        // Letters are narrower than the room that is kept for them.
        let width = 0.5 * size * text.chars().count() as f64;
        let left = match node.attribute("text-anchor") {
            Some("middle") => x - width / 2.0,
            Some("end") => x - width,
            _ => x,
        };
        ([left, y - 0.75 * size, left + width, y], text)
    };
    upright.map(place).collect()
}

#[track_caller]
fn check_texts(xml: &Document<'_>) {
    let root = xml.root_element();
    let [width, height] = [number(&root, "width"), number(&root, "height")];
    for turned in xml.descendants().filter(|it| it.attribute("transform").is_some()) {
        let place: Vec<f64> =
            turned.attribute("transform").unwrap().split(['(', ',', ')']).flat_map(str::parse).collect();
        let (ascent, half) = (0.75 * number(&turned, "font-size"), 0.25 * number(&turned, "font-size"));
        let half = half * turned.text().unwrap_or_default().chars().count() as f64;
        let is_within = place[0] - ascent >= 0.0 && place[1] - half >= 0.0 && place[1] + half <= height;
        assert!(is_within, "{:?} sticks out: {place:?} of {width} {height}", turned.text());
    }
    let texts = texts(xml);
    for (index, (a, text)) in texts.iter().enumerate() {
        assert!(
            a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= width && a[3] <= height,
            "`{text}` sticks out: {a:?} of {width} {height}"
        );
        for (b, other) in &texts[index + 1..] {
            let apart = a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1];
            assert!(apart, "`{text}` and `{other}` overlap: {a:?} {b:?}");
        }
    }
}

/// What people and machines measure: nothing, one datum, constants, huge, tiny, negative, far from zero, not at all.
fn awkward() -> Vec<Vec<[f64; 2]>> {
    let of = |f: fn(f64) -> [f64; 2]| (0..50).map(f64::from).map(f).collect::<Vec<_>>();
    vec![
        Vec::new(),
        vec![[3.0, 4.0]],
        vec![[f64::NAN, 1.0], [f64::INFINITY, f64::NEG_INFINITY]],
        of(|t| [t, 7.0]),
        of(|_| [0.0, 0.0]),
        of(|t| [t, -1e-12 * t]),
        of(|t| [t * 1e298, -1e300 + t * 4e298]),
        of(|t| [1.7e9 + t, 101_325.0 + 0.001 * t]),
        of(|t| [-t, if t as u32 % 7 == 3 { f64::NAN } else { 1e6 * t }]),
        of(|t| [5e-324 * t, 1e17 + t]),
        of(|t| [t, 10_f64.powf(t / 3.0 - 8.0)]),
    ]
}

#[test]
fn awkward_data_make_whole_figures_whose_texts_lie_apart_and_within() {
    for (case, points) in awkward().into_iter().enumerate() {
        for log in [false, true] {
            let axis = |label: &str| if log { Axis::new(label).log() } else { Axis::new(label) };
            for y in [axis("height of it all [m]"), axis("v [px]").down(), axis("marks [–]").from_zero()] {
                let svg = figure(axis("time [s]"), y, points.clone()).svg();
                let xml = check(&svg);
                check_texts(&xml);
                let is_empty = svg.contains(">no data<");
                assert_eq!(is_empty, [0, 2].contains(&case), "case {case}, {log}");
                assert_eq!(svg.contains(">dots<"), !is_empty, "the legend names what is drawn");
            }
        }
    }
}

#[test]
fn ten_million_points_are_thinned_to_what_can_be_seen() {
    let points: Vec<[f64; 2]> =
        (0..10_000_000_u32).map(|it| [f64::from(it) * 1e-3, f64::from(it.wrapping_mul(2_654_435_761) >> 8)]).collect();
    let svg = figure(Axis::new("time [s]"), Axis::new("noise [–]"), points).svg();
    check(&svg);
    assert!(svg.len() < 3_000_000, "{}", svg.len());
    // The whole width is covered: some point of each tenth.
    for tenth in 0..10 {
        assert!(svg.matches(&format!("M{}", 100 + 30 * tenth)).count() > 0, "{tenth}");
    }
}

#[test]
fn the_same_data_give_the_same_bytes() {
    let draw = || figure(Axis::new("x [m]"), Axis::new("y [m]"), awkward().concat()).svg();
    assert_eq!(draw(), draw());
}

#[test]
fn a_grid_has_its_frames_apart_and_each_name_once_in_its_legend() {
    let chart = |index: u32| {
        let y = 10_f64.powi(index as i32 * 3);
        Chart::new(format!("chart {index}"), [160.0, 90.0], Axis::new("time [s]"), Axis::new("x [m]"))
            .with(Series::line("measured", COLOURS[0], vec![[0.0, -y], [1.0, y]]))
            .with(
                Series::line(
                    "a name that is a good deal too long for any legend there ever was",
                    COLOURS[1],
                    vec![[0.0, 0.0], [1.0, y]],
                )
                .dashed(),
            )
    };
    let figure = Figure { title: "x".repeat(300), n_columns: 3, charts: (0..7).map(chart).collect() };
    let svg = figure.svg();
    let xml = check(&svg);
    check_texts(&xml);
    assert_eq!(svg.matches(">measured<").count(), 1);
    let frames: Vec<[f64; 4]> = xml
        .descendants()
        .filter(|it| it.has_tag_name("rect") && it.attribute("fill") == Some("none"))
        .map(|it| ["x", "y", "width", "height"].map(|name| number(&it, name)))
        .collect();
    assert_eq!(frames.len(), 7);
    for (index, a) in frames.iter().enumerate() {
        for b in &frames[index + 1..] {
            assert!(a[0] + a[2] < b[0] || b[0] + b[2] < a[0] || a[1] + a[3] < b[1] || b[1] + b[3] < a[1]);
        }
    }
    let legend = texts(&xml).into_iter().find(|it| it.1 == "measured").unwrap().0;
    assert!(frames.iter().all(|it| legend[0] > it[0] + it[2]), "the legend lies beside all frames");
}

#[test]
fn equal_axes_have_one_scale_and_bars_stand_on_zero() {
    let square = vec![[0.0, 0.0], [3.0, 1.0]];
    let chart = Chart::new("", [300.0, 200.0], Axis::new("x [m]"), Axis::new("y [m]")).equal().with(Series::new(
        "",
        Marks::Strokes,
        Pen::new("#123456", 1.0),
        square,
    ));
    let svg = chart.element(PAPER, "plot", "a stroke");
    let path = svg.split("#123456").nth(1).unwrap().split("d=\"").nth(1).unwrap().split('"').next().unwrap();
    let step: Vec<f64> = path.split('l').nth(1).unwrap().split(' ').map(|it| it.parse().unwrap()).collect();
    assert!((step[0] / -step[1] - 3.0).abs() < 0.01, "{step:?}");
    let bars = Series::bars("", "#654321", [[0.0, 1.0, 5.0], [1.0, 2.0, 0.0], [2.0, 3.0, 2.5]]);
    assert_eq!(bars.pieces.len(), 2, "a bar of nothing is none");
    let axes = (Axis::new("error [px]").over(0.0, 3.0), Axis::new("observations [–]").over(0.0, 5.0));
    let svg = Chart::new("", [300.0, 200.0], axes.0, axes.1).with(bars).element(PAPER, "plot", "bars");
    let path = svg.split("#654321").nth(1).unwrap().split("d=\"").nth(1).unwrap().split('"').next().unwrap();
    assert!(path.matches('z').count() == 2 && path.contains("0 -200 ") && path.contains("0 -100 "), "{path}");
}

#[test]
fn named_rows_stand_in_their_order_from_the_top() {
    let names = ["first", "second", "a third of some length, which is cut before it takes all the room there is"];
    let rows = Axis::of_rows(names.map(String::from));
    let dots = (0..3).map(|it| [1.0, Axis::row(it)]).collect();
    let chart = Chart::new("", [200.0, 60.0], Axis::new("depth [m]"), rows).with(Series::dots("", "#123456", dots));
    let svg = Figure { title: String::new(), n_columns: 1, charts: vec![chart] }.svg();
    let xml = check(&svg);
    check_texts(&xml);
    let row = |name: &str| texts(&xml).iter().find(|it| it.1.starts_with(name)).unwrap().0[3];
    assert!(row("first") < row("second") && row("second") < row("a third"));
}

#[test]
fn a_figure_of_nothing_says_why() {
    let svg = nothing("marks of \"no\" face", "no marks were recovered");
    check_texts(&check(&svg));
    assert!(svg.contains("nothing to show: no marks were recovered"));
    let empty = Figure { title: "no charts".to_owned(), n_columns: 0, charts: Vec::new() }.svg();
    check(&empty);
}
