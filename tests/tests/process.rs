//! Nodes that are processes: one that works, and ones that crash, hang and lie. This program is its own child: its first argument says what it does.

#[cfg(target_os = "linux")]
mod linux {
    use std::io::{Read, Write};
    use std::os::unix::fs::FileExt;
    use std::time::{Duration, Instant};

    use foveate_embed::plugin::process::{Filter, LONGEST_FRAME, Pictures, ProcessSettings};
    use foveate_messages::{Image, Targets, Time};
    use foveate_node::{In, Node, NodeBench, Out, Setup};
    use serde_json::{Value, json};

    const TARGETS: In<Targets> = In::each(0, "targets");
    const TARGETS_OUT: Out<Targets> = Out::new(0, "targets");
    const IMAGE: In<Image> = In::each(0, "image");
    const IMAGE_OUT: Out<Image> = Out::new(0, "image");

    fn receive() -> Option<Value> {
        let mut length = [0; 4];
        std::io::stdin().read_exact(&mut length).ok()?;
        let mut text = vec![0; u32::from_le_bytes(length) as usize];
        std::io::stdin().read_exact(&mut text).ok()?;
        serde_json::from_slice(&text).ok()
    }

    fn send(text: &[u8]) {
        let mut out = std::io::stdout();
        let length = u32::try_from(text.len()).unwrap().to_le_bytes();
        out.write_all(&[&length, text].concat()).unwrap();
        out.flush().unwrap();
    }

    fn answer(value: &Value) {
        send(value.to_string().as_bytes());
    }

    /// The child.
    pub fn child(does: &str) {
        let hello = receive().unwrap();
        assert_eq!(hello["hello"], 1);
        assert!(hello["schemas"].as_object().unwrap().values().all(Value::is_object), "{hello}");
        match does {
            "refuse" => return answer(&json!({ "refuse": "no licence" })),
            "no_ready" => return answer(&json!({ "hi": 1 })),
            "late_start" => std::thread::sleep(Duration::from_secs(60)),
            _ => {}
        }
        answer(&json!({ "ready": true }));
        if does == "does_not_read" {
            std::thread::sleep(Duration::from_secs(60));
        }
        for n in 0.. {
            let Some(message) = receive() else { return };
            let port = message["port"].clone();
            let echo = |value: &Value| json!({ "emit": [{ "port": port, "value": value }] });
            let value = &message["value"];
            match (does, n) {
                ("crash", 1) => {
                    eprintln!("first words\nmy last words");
                    std::process::exit(3);
                }
                ("hang", 1) => std::thread::sleep(Duration::from_secs(60)),
                ("half", 1) => {
                    std::io::stdout().write_all(&[200, 0, 0, 0, b'{']).unwrap();
                    std::io::stdout().flush().unwrap();
                    std::thread::sleep(Duration::from_secs(60));
                }
                ("long", 1) => std::io::stdout().write_all(&[255; 4096]).unwrap(),
                ("prints", 1) => println!("hello, I am at work"),
                ("no_json", 1) => send(b"{]"),
                ("other_port", 1) => answer(&json!({ "emit": [{ "port": "nowhere", "value": value }] })),
                ("no_list", 1) => answer(&json!({ "emit": 7 })),
                ("other_value", 1) => answer(&echo(&json!({ "time": "noon" }))),
                ("many", 1) => answer(&json!({ "emit": vec![json!({}); 5000] })),
                ("bulk", 1) => answer(&json!({ "emit": [{ "port": port, "value": value, "bulk": [8, 1u64 << 62] }] })),
                ("error", 1) => answer(&json!({ "error": "this one is odd" })),
                ("gap", 1) => answer(&json!({ "gaps": [{ "port": "targets", "reason": "nothing to see" }] })),
                ("chatty", _) => {
                    // More than a pipe holds.
                    (0..20_000).for_each(|_| eprintln!("what I think of this message is this"));
                    answer(&echo(value));
                }
                _ => match message.get("bulk") {
                    None => answer(&echo(value)),
                    Some(bulk) => {
                        let file = std::fs::File::options().read(true).write(true).open(bulk["path"].as_str().unwrap());
                        let file = file.unwrap();
                        let (start, length) = (bulk["answer"].as_u64().unwrap(), bulk["length"].as_u64().unwrap());
                        let mut pixels = vec![0; length as usize];
                        file.read_exact_at(&mut pixels, bulk["offset"].as_u64().unwrap()).unwrap();
                        pixels.iter_mut().for_each(|it| *it = 255 - *it);
                        file.write_all_at(&pixels, start).unwrap();
                        assert!(file.set_len(1).is_err(), "the memory is sealed");
                        answer(&json!({ "emit": [{ "port": port, "value": value, "bulk": [start, length] }] }));
                    }
                },
            }
        }
    }

    fn settings(does: &str) -> ProcessSettings {
        let program = std::env::current_exe().unwrap().display().to_string();
        ProcessSettings { command: vec![program, does.to_owned()], deadline_ms: 400.0, start_ms: 5000.0 }
    }

    fn bench<N: Node<Settings = ProcessSettings>>(does: &str) -> NodeBench<N> {
        NodeBench::with_setup(settings(does), &Setup::for_tests()).unwrap_or_else(|error| panic!("{does}: {error}"))
    }

    fn targets(n: i64) -> Targets {
        Targets { time: Time(n), list: Vec::new() }
    }

    fn one_that_works_gives_back_what_it_got() {
        let mut filter = bench::<Filter>("echo");
        for n in 0..200 {
            filter.feed(&TARGETS, Time(n), targets(n)).unwrap();
        }
        let given = filter.outputs(&TARGETS_OUT);
        assert_eq!(given.len(), 200);
        assert!(given.iter().zip(0..).all(|(it, n)| it.time() == Time(n) && it.value.time == Time(n)));

        let mut pictures = bench::<Pictures>("echo");
        // The second one needs more memory than the first.
        for [width, height] in [[5, 4], [640, 480], [2, 2]] {
            let pixels: Vec<u8> = (0..width * height).map(|it| (it % 251) as u8).collect();
            let image = Image { width, height, pixels: pixels.clone(), ..Image::default() };
            pictures.feed(&IMAGE, Time(1), image).unwrap();
            let given = pictures.outputs(&IMAGE_OUT);
            let expected: Vec<u8> = pixels.iter().map(|it| 255 - it).collect();
            assert_eq!((given.len(), &given[0].value.pixels), (1, &expected));
        }
    }

    /// The second message fails with all of `words`; the third one is worked on again.
    fn second_fails(does: &str, words: &[&str]) {
        let mut filter = bench::<Filter>(does);
        filter.feed(&TARGETS, Time(1), targets(1)).unwrap();
        let began = Instant::now();
        let error = filter.feed(&TARGETS, Time(2), targets(2)).unwrap_err().message;
        assert!(began.elapsed() < Duration::from_secs(3), "{does} took {:?}", began.elapsed());
        words.iter().for_each(|it| assert!(error.contains(it), "{does}: `{it}` is not in: {error}"));
        filter.feed(&TARGETS, Time(3), targets(3)).unwrap_or_else(|error| panic!("{does}: {error}"));
        assert_eq!(filter.outputs(&TARGETS_OUT).len(), 2, "{does}");
    }

    fn ones_that_crash_hang_and_lie_are_named_and_started_again() {
        second_fails("crash", &["the process `", "crash", "ended (exit status: 3)", "my last words"]);
        second_fails("hang", &["did not answer within 400 ms"]);
        second_fails("half", &["did not answer within 400 ms"]);
        second_fails("long", &["sent a frame of 4294967295 bytes", "expected at most", &LONGEST_FRAME.to_string()]);
        second_fails("prints", &["sent a frame of", "does it print on standard output"]);
        second_fails("no_json", &["sent a frame that is no JSON"]);
        second_fails("other_port", &["a message at the port nowhere, expected `targets`"]);
        second_fails("no_list", &["an `emit` that is no list"]);
        second_fails("other_value", &["a message `targets` that is none"]);
        second_fails("many", &["5000 messages in one answer"]);
        second_fails("bulk", &["which is not in the shared memory"]);
        second_fails("error", &["cannot work on this message: this one is odd"]);
    }

    fn what_goes_on_beside_does_not_hold_it_up() {
        let mut chatty = bench::<Filter>("chatty");
        (0..3).for_each(|n| chatty.feed(&TARGETS, Time(n), targets(n)).unwrap());
        let mut gap = bench::<Filter>("gap");
        (0..3).for_each(|n| gap.feed(&TARGETS, Time(n), targets(n)).unwrap());
        assert_eq!((gap.outputs(&TARGETS_OUT).len(), gap.gaps(&TARGETS_OUT)[0].reason.as_str()), (2, "nothing to see"));
        let mut deaf = bench::<Pictures>("does_not_read");
        let image = Image { width: 2, height: 2, pixels: vec![0; 4], ..Image::default() };
        let error = deaf.feed(&IMAGE, Time(1), image).unwrap_err().message;
        assert!(error.contains("within 400 ms"), "{error}");
    }

    fn one_that_cannot_start_is_refused_at_its_setting() {
        let refused = |settings: ProcessSettings| {
            let error = NodeBench::<Filter>::with_setup(settings, &Setup::for_tests()).err().unwrap();
            assert_eq!(error.setting.as_deref(), Some("command"), "{error}");
            error.message
        };
        let with = |command: &[&str]| ProcessSettings {
            command: command.iter().map(|&it| it.to_owned()).collect(),
            ..settings("echo")
        };
        assert!(refused(settings("refuse")).contains("refuses to work: no licence"));
        assert!(refused(settings("no_ready")).contains("something else than `ready`"));
        let late = ProcessSettings { start_ms: 300.0, ..settings("late_start") };
        assert!(refused(late).contains("did not answer within 300 ms"));
        assert!(refused(with(&[])).contains("found nothing"));
        assert!(refused(with(&["no_such_program_anywhere"])).contains("on the PATH"));
        assert!(refused(with(&["./no/such/file"])).contains("found no file"));
        assert!(refused(with(&["./Cargo.toml"])).contains("cannot be started"));
    }

    /// The tests, one after the other.
    pub fn tests() {
        one_that_works_gives_back_what_it_got();
        ones_that_crash_hang_and_lie_are_named_and_started_again();
        what_goes_on_beside_does_not_hold_it_up();
        one_that_cannot_start_is_refused_at_its_setting();
        println!("processes: 4 tests passed");
    }
}

fn main() {
    #[cfg(target_os = "linux")]
    match std::env::args().nth(1).as_deref() {
        // What the test runner hands over begins with a dash.
        Some(does) if !does.starts_with('-') => linux::child(does),
        _ => linux::tests(),
    }
}
