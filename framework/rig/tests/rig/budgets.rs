//! Budgets: what becomes of them, and every fault of one.

use foveate_rig::graph::{BudgetEnd, BudgetPort, Graph};

use crate::accepted::LAB;
use crate::faults::{expect, whole};
use crate::parts::{bad, good};

/// The laboratory with a budget; its keys stand on the lines 44, 45 and 46.
fn lab(keys: [&str; 3]) -> String {
    format!("{LAB}\n[[budget]]\n{}\n{}\n{}\n", keys[0], keys[1], keys[2])
}

/// A budget from the pictures.
fn from_images(to: &str, age_ms: &str) -> String {
    lab(["from = \"room.video.image\"", &format!("to = \"{to}\""), &format!("age_ms = {age_ms}")])
}

/// One fault, in the end of a path.
#[track_caller]
fn bad_end(to: &str, column: usize, underlined: &str, fragments: &[&str]) {
    whole(&from_images(to, "30"), &format!("45:{column}"), underlined, fragments);
}

fn paths(graph: &Graph, instances: &[usize]) -> Vec<String> {
    instances.iter().map(|&it| graph.instances[it].path.clone()).collect()
}

#[test]
fn a_budget_holds_for_every_camera_at_both_ends() {
    let graph = good(&from_images("face.aim.command", "30"));
    let [budget] = &graph.budgets[..] else { panic!("{:?}", graph.budgets) };
    assert_eq!((budget.from.as_str(), budget.to.as_str()), ("room.video.image", "face.aim.command"));
    assert_eq!((budget.age_s, budget.latency_s, budget.must), (0.030, 0.0, false));
    assert_eq!(paths(&graph, &budget.begins), [1, 2, 3].map(|it| format!("room.video[wide-{it}]")));
    let ends: Vec<usize> = budget.ends.iter().map(|it| it.instance).collect();
    assert_eq!(paths(&graph, &ends), [1, 2].map(|it| format!("face.aim[ptz-{it}]")));
    assert!(budget.ends.iter().all(|it| it.at == BudgetPort::Output(0)));
    // The features keep the stamps of the pictures, the targets get new ones, and the commands too; the table is on no way back.
    let origin = |path: &str| budget.has_origin(graph.instances.iter().position(|it| it.path == path).unwrap());
    assert!(origin("room.video[wide-2]") && origin("room.targets") && origin("face.aim[ptz-1]"));
    let table = graph.instances.iter().position(|it| it.path == "room.table").unwrap();
    assert!(budget.has_origin(table), "messages of the pictures trigger it");
    assert_eq!(budget.origins.len(), 11, "all but the heads: an actuator passes nothing on");
}

#[test]
fn a_budget_may_end_at_an_input_of_an_actuator_or_at_one_that_samples() {
    let graph = good(&from_images("face.heads.command", "30"));
    let edge = |name: &str| graph.edges.iter().position(|it| it.name == name).unwrap();
    let into = |camera: usize| edge(&format!("face.aim[ptz-{camera}].command -> face.heads[ptz-{camera}].command"));
    let ends: Vec<&BudgetPort> = graph.budgets[0].ends.iter().map(|it| &it.at).collect();
    assert_eq!(ends, [&BudgetPort::Input(vec![into(1)]), &BudgetPort::Input(vec![into(2)])]);
    let graph = good(&from_images("room.leds.hints", "30"));
    assert_eq!(graph.budgets[0].ends.len(), 3);
    let one = good(&from_images("room.leds[wide-2].hints", "30"));
    let edge = one.edges.iter().position(|it| it.name == "room.targets.hints -> room.leds[wide-2].hints").unwrap();
    let instance = one.edges[edge].to.0;
    assert_eq!(one.budgets[0].ends, [BudgetEnd { instance, at: BudgetPort::Input(vec![edge]) }]);
}

#[test]
fn a_budget_holds_only_between_instances_that_are_connected() {
    let text = from_images("room.leds.features", "30").replace("room.video.image", "room.video[wide-2].image");
    let graph = good(&text);
    let budget = &graph.budgets[0];
    assert_eq!(paths(&graph, &budget.begins), ["room.video[wide-2]"]);
    let ends: Vec<usize> = budget.ends.iter().map(|it| it.instance).collect();
    assert_eq!(paths(&graph, &ends), ["room.leds[wide-2]"]);
    let other = graph.instances.iter().position(|it| it.path == "room.video[wide-1]").unwrap();
    assert!(!budget.has_origin(other), "its messages are not made of those of wide-2");
    // Stamps that features bring along are those of the pictures.
    let graph = good(&from_images("room.targets.targets", "30").replace("room.video.image", "room.leds.features"));
    assert!(paths(&graph, &graph.budgets[0].origins).contains(&"room.video[wide-1]".to_owned()));
}

#[test]
fn resolved_rig_has_its_budgets() {
    let text = from_images("face.heads.command", "30").replace("age_ms = 30", "age_ms = 30\nmust = true");
    let graph = good(&text);
    let written =
        "\n[[budget]]\nfrom = \"room.video.image\"\nto = \"face.heads.command\"\nage_ms = 30.0\nmust = true\n";
    assert!(graph.resolved.contains(written), "{}", graph.resolved);
    let again = good(&graph.resolved);
    assert_eq!((again.resolved, again.budgets), (graph.resolved, graph.budgets));
    assert_eq!(good(LAB).budgets, []);
}

#[test]
fn keys_of_a_budget_are_checked() {
    let age = |age: &str, underlined: &str, fragments: &[&str]| {
        whole(&from_images("face.aim.command", age), "46:10", underlined, fragments);
    };
    age("0", "0", &["found 0, expected more than 0 [ms]"]);
    age("-3", "-3", &["found -3, expected more than 0"]);
    age("nan", "nan", &["found nan"]);
    age("\"30 ms\"", "\"30 ms\"", &["found the text `30 ms`, expected more than 0 [ms]"]);
    whole(&from_images("face.aim.command", "30\nmust = 1"), "47:8", "1", &["expected true or false"]);
    let said = ["unknown key `age` in a budget", "did you mean `age_ms`?"];
    whole(&from_images("face.aim.command", "30\nage = 3"), "47:1", "age", &said);
    let [from, to] = ["from = \"room.video.image\"", "to = \"face.aim.command\""];
    let lacks = |keys: [&str; 3], key: &str| {
        let label = format!("expected `{key} = ");
        whole(&lab(keys), "43:1", "[[budget]]", &[&format!("a budget lacks `{key}`"), &label]);
    };
    lacks([from, to, ""], "age_ms");
    lacks([from, "", "age_ms = 30"], "to");
    lacks(["", to, "age_ms = 30"], "from");
    whole(&lab([from, "to = 3", "age_ms = 30"]), "45:6", "3", &["found 3, expected an output"]);
    let table = lab([from, to, "age_ms = 30"]).replace("[[budget]]", "[budget]");
    whole(&table, "43:1", "[budget]", &["found a table, expected tables `[[budget]]`"]);
    let list = "budget = [{ from = \"room.video.image\", to = \"face.aim.command\" }, 3]\n";
    let faults = bad(&format!("{list}{LAB}"));
    assert_eq!(faults.list.len(), 2, "{faults}");
    expect(&faults, 0, "1:1", "budget", &["a budget lacks `age_ms`"]);
    expect(&faults, 1, "1:67", "3", &["found 3, expected tables"]);
}

#[test]
fn ends_of_a_budget_are_named_with_their_scale() {
    let from = |from: &str, column: usize, underlined: &str, fragments: &[&str]| {
        let text = from_images("face.aim.command", "30").replace("room.video.image", from);
        whole(&text, &format!("44:{column}"), underlined, fragments);
    };
    from("rom.video.image", 9, "rom", &["there is no scale `rom`", "did you mean `room`?"]);
    from("room.vide.image", 14, "vide", &["scale `room` has no node `vide`", "did you mean `video`?"]);
    from("room.video.imag", 20, "imag", &["`video` has no output `imag`", "did you mean `image`?"]);
    from("room.leds.image", 19, "image", &["`leds` has no output `image`", "it has `features`"]);
    from("room.video[wide-9].image", 20, "wide-9", &["`video` does not run for a camera `wide-9`"]);
    let said = ["does not name a port with its scale", "\"SCALE.NODE.OUTPUT\"", "did you mean `room.video.image`?"];
    from("video.image", 8, "\"video.image\"", &said);
    from("room.video", 8, "\"room.video\"", &["the outputs of `room.video`: `room.video.image`"]);
    from("video", 8, "\"video\"", &["does not name a port with its scale"]);
    bad_end(
        "face.aim.comand",
        16,
        "comand",
        &["`aim` has no port `comand`", "did you mean `command`? it has `command` and `target`"],
    );
    bad_end("room.table.x", 18, "x", &["`table` has no port `x`", "it has `targets`"]);
    bad_end("heads.command", 6, "\"heads.command\"", &["\"SCALE.NODE.PORT\"", "did you mean `face.heads.command`?"]);
}

#[test]
fn path_that_does_not_exist_names_what_each_end_reaches() {
    let text = from_images("room.leds.features", "30").replace("room.video.image", "face.aim.command");
    let said = [
        "`face.aim.command` does not lead to `room.leds.features`",
        "`face.aim.command` leads to `face.heads`; `room.leds.features` gets what is made by `room.video`",
        "the path begins here",
    ];
    whole(&text, "45:6", "\"room.leds.features\"", &said);
    let text = from_images("room.leds.image", "30").replace("room.video.image", "room.targets.targets");
    whole(&text, "45:6", "\"room.leds.image\"", &["`room.leds.image` gets what is made by `room.video`"]);
    let text = from_images("room.video.image", "30").replacen("\"room.video.image", "\"face.aim.command", 1);
    whole(&text, "45:6", "\"room.video.image\"", &["gets what is made by no other node"]);
    // Of the two cameras of one node neither leads to the other, but by the hints.
    let text = from_images("room.leds[wide-1].features", "30").replace("room.video.image", "room.video[wide-2].image");
    whole(&text, "45:6", "\"room.leds[wide-1].features\"", &["only by way of `room.leds.hints`"]);
}

#[test]
fn path_does_not_go_through_an_actuator() {
    let slow = |to: &str| from_images(to, "60").replace("test.motor", "test.slow_motor");
    let said = [
        "`room.video.image` does not lead to `face.heads.report`",
        "`room.table`, `face.anchor`, `face.aim` and `face.heads`",
        "what an actuator gives out is observed again",
    ];
    whole(&slow("face.heads.report"), "45:6", "\"face.heads.report\"", &said);
    good(&slow("face.heads.report").replace("room.video.image", "face.heads.report"));
    good(&slow("face.heads.command"));
}

#[test]
fn path_through_an_input_that_samples_ends_there() {
    // Hints are sampled: features have the time of the picture that triggered them, whatever the hints were made of.
    let text = from_images("room.leds.features", "30").replace("room.video.image", "room.targets.hints");
    let said = [
        "`room.targets.hints` leads to `room.leds.features` only by way of `room.leds.hints`, which samples",
        "end the budget at `room.leds.hints`",
    ];
    whole(&text, "45:6", "\"room.leds.features\"", &said);
    good(&from_images("room.leds.hints", "30").replace("room.video.image", "room.targets.hints"));
}

#[test]
fn budget_that_the_plan_cannot_meet_gives_both_numbers_and_the_longest_part() {
    // Pictures come after 5 ms, and detectors take 2 ms.
    let unmet = |to: &str, age: &str, least: &str, part: &str| {
        let label = format!("found {age} ms, expected at least {least} ms");
        whole(&from_images(to, age), "46:10", age, &[&format!("at `{to}` as promised"), &label, part]);
    };
    unmet("face.aim.command", "6.9", "7", "most of it, 5 ms, is the latency of `room.video`");
    unmet("room.video.image", "4", "5", "most of it, 5 ms, is the latency of `room.video`");
    unmet("room.leds.image", "4", "5", "latency of `room.video`");
    for to in ["face.aim.command", "face.heads.command", "room.leds.hints"] {
        good(&from_images(to, "7"));
    }
    // What comes out of the detectors is 7 ms old by then.
    let text = from_images("room.targets.targets", "6").replace("room.video.image", "room.leds.features");
    whole(&text, "46:10", "6", &["expected at least 7 ms", "most of it, 5 ms, is the latency of `room.video`"]);
    // A stated delay of the last edge counts, and so does the time from the command to the motor.
    let delayed = from_images("room.leds.hints", "15.5")
        .replace("\"targets.hints\"", "{ from = \"targets.hints\", delay_ms = 9 }");
    whole(
        &delayed,
        "46:10",
        "15.5",
        &["expected at least 16 ms", "most of it, 9 ms, is the `delay_ms` of `room.leds.hints`"],
    );
    let slow = from_images("face.heads.command", "46").replace("test.motor", "test.slow_motor");
    whole(&slow, "46:10", "46", &["expected at least 47 ms", "most of it, 40 ms, is the latency of `face.heads`"]);
    let graph = good(&slow.replace("= 46", "= 47"));
    assert_eq!((graph.budgets[0].latency_s, graph.budgets[0].age_s), (0.040, 0.047));
}

#[test]
fn all_faults_of_budgets_come_in_one_run() {
    let second = "[[budget]]\nfrom = \"room.leds.features\"\nto = \"face.aim.command\"\nage_ms = 30\n";
    let text = format!(
        "{}{second}[[budget]]\nto = \"face.aim.comand\"\nage_ms = 0\n{second}",
        from_images("face.aim.command", "3")
    );
    let faults = bad(&text);
    let places: Vec<(usize, usize)> = faults.list.iter().map(|it| it.line_column()).collect();
    assert_eq!(places, [(46, 10), (51, 1), (52, 16), (53, 10), (54, 1)], "{faults}");
    expect(&faults, 4, "54:1", "[[budget]]", &["stands here twice", "they stand here already"]);
    let many = format!("{LAB}\n{}", second.repeat(1001));
    assert!(bad(&many).to_string().contains("found 1001, expected at most 1000"));
}
