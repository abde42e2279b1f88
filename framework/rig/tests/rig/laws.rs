//! What holds of every text: no panic, every place inside it, and a resolved rig that is its own resolution.

use proptest::prelude::*;

use crate::accepted::LAB;
use crate::parts::load;

/// Words that rigs are made of, right and wrong ones.
const WORDS: [&str; 75] = [
    "[rig]",
    "[scale.room]",
    "[scale.face]",
    "[scale.room.node.video]",
    "[scale.room.node.leds]",
    "[[scale]]",
    "[[budget]]",
    "from = \"room.video.image\"",
    "to = \"room.targets.hints\"",
    "age_ms = 30",
    "budget",
    "[scale.a.node.b.in]",
    "name",
    "calibration",
    "seed",
    "duration_s",
    "report_speed",
    "paced",
    "folder",
    "parent",
    "anchor",
    "\"targets.head\"",
    "[scale.room.target.head]",
    "pick",
    "offset_m",
    "volume_m",
    "radius_m",
    "type",
    "each",
    "camera",
    "in",
    "in.image",
    "in.features",
    "require.features",
    "on_error",
    "offset",
    "window",
    "mask",
    "corners",
    "=",
    "=",
    "=",
    "=",
    "\n",
    "\n",
    "\n",
    "{",
    "}",
    "[",
    "]",
    ",",
    ".",
    "\"",
    "\"lab\"",
    "\"lab.calibration.toml\"",
    "\"wide-*\"",
    "\"ptz-1\"",
    "\"test.camera\"",
    "\"test.detector\"",
    "\"test.integrator\"",
    "\"test.smoother\"",
    "\"video.image\"",
    "\"room.leds[wide-1].features\"",
    "\"leds.features\"",
    "\"targets.targets\"",
    "1",
    "-1",
    "2.5",
    "nan",
    "1e400",
    "true",
    "1979-05-27",
    "\"é𝄞\"",
    "'''\n'''",
    "# é\n",
];

/// Loads `text` and checks what must hold of the answer.
fn check(text: &str) -> Result<(), TestCaseError> {
    match load(text) {
        Ok(graph) => {
            let again = load(&graph.resolved).map_err(|faults| TestCaseError::fail(format!("{faults}")))?;
            prop_assert_eq!(&again.resolved, &graph.resolved);
            prop_assert_eq!(&again.edges, &graph.edges);
            prop_assert_eq!(&again.budgets, &graph.budgets);
            for edge in &graph.edges {
                prop_assert!(edge.from.0 < graph.instances.len() && edge.to.0 < graph.instances.len());
                prop_assert_eq!(edge.feedback, edge.from.0 >= edge.to.0);
            }
        }
        Err(faults) => {
            prop_assert!(faults.n_errors() > 0);
            for fault in &faults.list {
                for span in fault.others.iter().map(|it| &it.0).chain([&fault.span]) {
                    prop_assert!(text.get(span.clone()).is_some(), "{:?} in {} bytes", span, text.len());
                }
                let (line, column) = fault.line_column();
                let row = text.split('\n').nth(line - 1);
                prop_assert!(row.is_some_and(|it| column <= it.chars().count() + 1), "{}:{}", line, column);
            }
            prop_assert!(faults.render(false).lines().count() >= faults.list.len());
            prop_assert!(!faults.render(true).is_empty());
        }
    }
    Ok(())
}

/// An edit of a text: where, how much goes, what comes.
fn edit() -> impl Strategy<Value = (usize, usize, String)> {
    let word = prop_oneof![
        4 => proptest::sample::select(WORDS.to_vec()).prop_map(str::to_owned),
        1 => "\\PC{0,3}",
        2 => Just(String::new()),
    ];
    (0..LAB.len(), 0..12_usize, word)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_answered(text in "(?s).{0,200}") {
        check(&text)?;
    }

    #[test]
    fn any_row_of_words_is_answered(words in proptest::collection::vec(proptest::sample::select(WORDS.to_vec()), 0..60)) {
        check(&words.join(" "))?;
    }

    #[test]
    fn any_edit_of_a_rig_is_answered(edits in proptest::collection::vec(edit(), 1..4)) {
        let mut text = LAB.to_owned();
        for (start, length, word) in edits {
            let start = (0..=start.min(text.len())).rev().find(|&it| text.is_char_boundary(it)).unwrap_or(0);
            let end = (start + length).min(text.len());
            let end = (end..=text.len()).find(|&it| text.is_char_boundary(it)).unwrap_or(start);
            text.replace_range(start..end, &word);
        }
        check(&text)?;
    }

    #[test]
    fn resolved_rig_is_its_own_resolution(
        offset in 1.0..=255.0_f64,
        areas in (1..1000_u32, 1000..=u32::MAX),
        relearn in proptest::option::of(any::<f64>().prop_filter("a number", |it| !it.is_nan())),
        corners in proptest::collection::vec((any::<f32>(), -1e9..1e9_f64), 0..3),
        radius in proptest::option::of(0.0..1e3_f64),
        seed in 0..=i64::MAX,
        duration in proptest::option::of(1e-9..9e9_f64),
        age_ms in 10.0..1e4_f64,
        capacity in 1..1_000_000_usize,
    ) {
        prop_assume!(corners.iter().all(|it| it.0.is_finite()));
        let mask = radius.map_or("\"open\" }".to_owned(), |it| format!("\"circle\", radius_px = {it:?} }}"));
        let corners: Vec<String> = corners.iter().map(|it| format!("[{:?}, {:?}]", it.0, it.1)).collect();
        let mut settings = format!(
            "offset = {offset:?}\nmin_area = {}\nmax_area = {}\nwindow.corners = [{}]\nmask = {{ kind = {mask}\n",
            areas.0, areas.1, corners.join(", "),
        );
        if let Some(relearn) = relearn {
            settings.push_str(&format!("relearn = {relearn:?}\n"));
        }
        let mut name = format!("name = \"lab\"\nseed = {seed}\n");
        if let Some(duration) = duration {
            name.push_str(&format!("duration_s = {duration:?}\n"));
        }
        let text = LAB
            .replace("offset = 25", &settings)
            .replace("name = \"lab\"", &name)
            .replace("age_ms = 20", &format!("age_ms = {age_ms:?}"))
            .replace("capacity = 64", &format!("capacity = {capacity}"));
        let graph = load(&text).map_err(|faults| TestCaseError::fail(format!("{faults}")))?;
        let again = load(&graph.resolved).map_err(|faults| TestCaseError::fail(format!("{faults}")))?;
        prop_assert_eq!(again.resolved, graph.resolved);
        prop_assert_eq!(again.edges, graph.edges);
        prop_assert_eq!((again.seed, again.duration), (graph.seed, graph.duration));
    }
}
