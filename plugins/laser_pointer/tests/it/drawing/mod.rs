//! Four people draw on a wall: what windows of the page show, what TUIO clients receive, and what becomes of clients that stall, flood or are forged.
//!
//! Where there is no browser, the test that needs one says on one line that it was skipped. `FOVEATE_SHOTS` names a folder for pictures of the page, for people to
//! look at.

mod room;

use std::net::UdpSocket;
use std::path::Path;
use std::time::{Duration, Instant};

use foveate_testkit::chromium::{Chromium, Tab};
use rosc::{OscMessage, OscPacket, OscType, decoder};
use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use self::room::{CENTRES, RADIUS, WALL, place, run};

/// An address without a listener.
const NOBODY: &str = "127.0.0.1:9";

/// A picture of the page for people, where they want one.
fn keep_shot(name: &str, tab: &mut Tab) {
    if let Ok(folder) = std::env::var("FOVEATE_SHOTS") {
        std::fs::write(Path::new(&folder).join(name), tab.screenshot()).unwrap();
    }
}

/// The colour of the canvas at a place of the wall, as the page draws it.
fn colour_at(tab: &mut Tab, [x, y]: [f64; 2]) -> Vec<u64> {
    let pixel = tab.evaluate(&format!("[...pen.getImageData({x} * scale, {y} * scale, 1, 1).data]"));
    pixel.as_array().unwrap().iter().take(3).map(|it| it.as_u64().unwrap()).collect()
}

/// The colour of a pointer, as the page makes it.
fn colour_of(tab: &mut Tab, id: usize) -> Vec<u64> {
    let text = format!(
        "(() => {{ const it = new OffscreenCanvas(1, 1).getContext('2d'); it.fillStyle = colour({id}); it.fillRect(0, 0, 1, 1); \
         return [...it.getImageData(0, 0, 1, 1).data]; }})()"
    );
    tab.evaluate(&text).as_array().unwrap().iter().take(3).map(|it| it.as_u64().unwrap()).collect()
}

/// Every window shows every circle in its own colour, and its middle blank; a window that loses the program finds it again.
#[test]
fn windows_show_what_four_people_draw_each_in_a_colour_and_come_back_by_themselves() {
    let Some(browser) = Chromium::start_or_skip(1) else { return };
    let running = run(NOBODY, "0");
    let mut tabs = [browser.tab(), browser.tab()];
    for (tab, size) in tabs.iter_mut().zip([[1000, 600], [500, 400]]) {
        tab.resize(size);
        tab.open(&running.address);
    }
    for (number, tab) in tabs.iter_mut().enumerate() {
        // More than a whole round of all four.
        tab.wait_for("newest && newest.time > 2.6 && newest.pointers.length === 4 && ink.length > 400");
        tab.wait_for("document.body.innerText.includes('capture to event 0.0 ms, event to picture')");
        keep_shot(&format!("drawing_{number}.png"), tab);
        let colours: Vec<Vec<u64>> = (1..=4).map(|id| colour_of(tab, id)).collect();
        assert_eq!(colours.iter().collect::<std::collections::BTreeSet<_>>().len(), 4, "{colours:?}");
        for (index, colour) in colours.iter().enumerate() {
            // The first press begins where the pointer appeared.
            for round in 0..16 {
                let found = colour_at(tab, place(index, f64::from(round) / 8.0));
                let distance: u64 = found.iter().zip(colour).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
                assert!(distance < 40, "person {index}, place {round}: found {found:?}, expected {colour:?}");
            }
            let [x, y] = CENTRES[index];
            assert_eq!(colour_at(tab, [x, y]), [244, 245, 242], "nothing was drawn in the middle");
            assert_eq!(colour_at(tab, [x + RADIUS / 2.0, y]), [244, 245, 242]);
        }
    }
    // Cleared in one window, it is clear in both.
    tabs[0].evaluate("document.getElementById('clear').click()");
    for tab in &mut tabs {
        tab.wait_for("epoch === 1 && ink.length < 400");
    }
    let port = running.address.split(':').nth(2).unwrap().split('/').next().unwrap().to_owned();
    let (outcome, _) = running.end();
    for tab in &mut tabs {
        tab.wait_for("document.body.innerText.includes('Not connected')");
    }
    let figures = outcome.report.figures;
    assert_eq!((figures["page.windows"], figures["page.refused"]), (2.0, 0.0));
    println!(
        "event to picture: p50 {:.1} ms, p99 {:.1} ms",
        figures["page.drawn_ms.p50"], figures["page.drawn_ms.p99"]
    );
    assert!(figures["page.drawn_ms.p50"] < 1000.0, "{figures:?}");
    // The next run, at the same place.
    let running = run(NOBODY, &port);
    for tab in &mut tabs {
        tab.wait_for("newest && newest.time < 60 && ink.length > 20");
    }
    keep_shot("drawing_again.png", &mut tabs[1]);
    running.end();
}

/// What a TUIO client knows: the number of the newest frame, and its cursors, each with its session and place.
type Known = (i32, Vec<(i32, [f32; 2])>);

fn receive(socket: &UdpSocket) -> Option<Known> {
    let mut buffer = [0; 2048];
    let n = socket.recv(&mut buffer).ok()?;
    let (_, packet) = decoder::decode_udp(&buffer[..n]).unwrap();
    let OscPacket::Bundle(bundle) = packet else { panic!("found {packet:?}, expected a bundle") };
    let (mut frame, mut cursors) = (0, Vec::new());
    for packet in bundle.content {
        let OscPacket::Message(OscMessage { args, .. }) = packet else { panic!("a bundle within") };
        match &args[..] {
            [OscType::String(word), OscType::Int(session), OscType::Float(x), OscType::Float(y), ..]
                if word == "set" =>
            {
                cursors.push((*session, [*x, *y]));
            }
            [OscType::String(word), OscType::Int(number)] if word == "fseq" => frame = *number,
            _ => {}
        }
    }
    Some((frame, cursors))
}

/// A client on the same machine receives four strokes, in order, at no more than 60 frames a second, on the circles that are drawn.
#[test]
fn a_tuio_client_receives_the_strokes_of_four_people() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let running = run(&socket.local_addr().unwrap().to_string(), "0");
    let mut last = 0;
    let mut n_full = 0;
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(3) {
        let (frame, cursors) = receive(&socket).expect("a frame");
        assert_eq!(frame, last + 1, "frames come in order and none is lost on one machine");
        last = frame;
        for (session, [x, y]) in &cursors {
            let [u, v] = CENTRES[*session as usize - 1];
            let [x, y] = [f64::from(*x) * WALL[0] - u, f64::from(*y) * WALL[1] - v];
            assert!((x.hypot(y) - RADIUS).abs() < 0.03, "session {session}: {} m off its circle", x.hypot(y) - RADIUS);
        }
        n_full += u32::from(cursors.len() == 4);
    }
    assert!((100..=200).contains(&last), "{last} frames in three seconds");
    assert!(n_full > 90, "{n_full} frames with all four");
    let (outcome, _) = running.end();
    assert_eq!(outcome.report.figures["tuio.cursors"], 4.0);
    // A cursor that was held down at the end is not left behind.
    socket.set_nonblocking(true).unwrap();
    let mut known = None;
    while let Some(newest) = receive(&socket) {
        known = Some(newest);
    }
    assert_eq!(known.map(|it| it.1.len()), Some(0));
}

type Socket = WebSocket<tungstenite::stream::MaybeTlsStream<std::net::TcpStream>>;

fn connect(address: &str, origin: Option<&str>) -> Result<Socket, tungstenite::Error> {
    let mut request = format!("{}socket", address.replace("http", "ws")).into_client_request()?;
    if let Some(origin) = origin {
        request.headers_mut().insert("Origin", origin.parse().unwrap());
    }
    tungstenite::connect(request).map(|it| it.0)
}

/// One that never reads, one that floods, one that talks nonsense and one with a forged origin: each is named and counted, and who behaves gets everything.
#[test]
fn clients_that_stall_flood_or_are_forged_are_counted_and_the_others_go_on() {
    let running = run(NOBODY, "0");
    let address = running.address.clone();
    let forged = connect(&address, Some("http://evil.example"));
    assert!(matches!(forged, Err(tungstenite::Error::Http(answer)) if answer.status() == 403), "a forged origin");
    let stalled = connect(&address, None).unwrap();
    let mut nonsense = connect(&address, None).unwrap();
    nonsense.send(Message::text("all your base")).unwrap();
    let flood = std::thread::spawn({
        let mut socket = connect(&address, None).unwrap();
        move || {
            let mut n = 0;
            // Until it is closed.
            while n < 2_000_000 && socket.send(Message::text("{\"seen\":[0,null]}")).is_ok() {
                n += 1;
            }
            n
        }
    });
    let mut good = connect(&address, None).unwrap();
    let begun = Instant::now();
    let (mut last, mut n_ink, mut worst_gap) = (0, 0, Duration::ZERO);
    let mut heard = Instant::now();
    while begun.elapsed() < Duration::from_secs(5) {
        let Message::Text(text) = good.read().unwrap() else { continue };
        let message: Value = serde_json::from_str(&text).unwrap();
        let Some(number) = message["seq"].as_u64() else { continue };
        assert_eq!(number, last + 1);
        last = number;
        n_ink += message["ink"].as_array().unwrap().len();
        good.send(Message::text(format!("{{\"seen\":[{number},null]}}"))).unwrap();
        worst_gap = worst_gap.max(heard.elapsed());
        heard = Instant::now();
    }
    let n_flooded = flood.join().unwrap();
    assert!(n_flooded < 2_000_000, "the flood was let in");
    assert!(last > 100 && n_ink > 1000, "{last} messages with {n_ink} points in five seconds");
    assert!(worst_gap < Duration::from_secs(2), "{worst_gap:?} of silence");
    let (outcome, counts) = running.end();
    drop(stalled);
    assert_eq!((counts.foreign_origins, counts.flooding), (1, 1), "{counts:?}");
    assert!(outcome.report.figures["page.refused"] >= 1.0);
    let reported = outcome.report.remarks.iter().any(|it| it.contains("`all your base`"));
    assert!(reported, "{:?}", outcome.report.remarks);
    println!("{last} messages, longest silence {worst_gap:?}; {counts:?}");
}
