//! scratch
use crate::accepted::LAB;
#[test]
fn show() {
    let cases = include_str!("/tmp/cases.txt");
    for case in cases.split("\n====\n") {
        let (from, to) = case.split_once("\n->\n").unwrap();
        let to = to.trim_end_matches('\n');
        let text = if from == "ALL" {
            to.to_owned()
        } else {
            assert_eq!(LAB.matches(from).count(), 1, "{from}");
            LAB.replacen(from, to, 1)
        };
        println!("######## {}", to.lines().next().unwrap_or(""));
        match foveate_dataflow::rig::load(
            &text,
            std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/rig/lab.toml")),
            &crate::parts::registry(),
            &Default::default(),
        ) {
            Ok(g) => println!("OK {g:?}\n{}", g.warnings),
            Err(f) => println!("{}", f.render(false).replace("/work/main/framework/dataflow/tests/rig/", "")),
        }
    }
}
