//! The page of a tile in a browser without a window: the middle of the box's back wall is drawn where the line from the eye to it goes through the tile.
//!
//! Where there is no browser, the test says on one line that it was skipped. `FOVEATE_SHOTS` names a folder for pictures of the page, for people to look at.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use foveate::geometry::Screen;
use foveate::node::Pages;
use foveate::prelude::*;
use foveate_embed::engine::{self, Options};
use foveate_embed::rig::{self, Overrides};
use foveate_testkit::chromium::{Chromium, Tab};
use foveate_web::Server;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Of each tile of these tests [px].
const SIZE: [u32; 2] = [480, 320];
/// Two tiles side by side, 1.2 m by 0.8 m each, in the plane y = 0; people stand at negative y.
const LEFT: [[f64; 3]; 3] = [[-1.2, 0.0, 1.0], [0.0, 0.0, 1.0], [-1.2, 0.0, 1.8]];
const RIGHT: [[f64; 3]; 3] = [[0.0, 0.0, 1.0], [1.2, 0.0, 1.0], [0.0, 0.0, 1.8]];
const DEPTH: f64 = 1.0;

fn screen(corners: [[f64; 3]; 3]) -> Screen {
    let [a, b, c] = corners.map(Point3::from);
    Screen::from_corners(a, b, c).unwrap()
}

/// An eye that stands still at one of three places for two seconds each, in turn.
fn eye(time: Time) -> Point3<f64> {
    let places = [[-0.9, -1.0, 1.3], [0.2, -1.5, 1.7], [0.9, -0.8, 1.5]];
    Point3::from(places[(time.as_s() / 2.0) as usize % 3])
}

struct Eyes {
    next: i64,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct Nothing {}

ports! {
    pub(crate) fn ports_of_eyes;
    VIEWS: Out<Views> = "views";
}

impl Node for Eyes {
    const TYPE: &'static str = "test.eyes";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Eyes that stand still now here, now there";
    type Settings = Nothing;

    fn ports() -> Ports {
        ports_of_eyes()
    }

    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Eyes { next: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = Time(self.next * 1_000_000_000 / 60);
        self.next += 1;
        let eye = eye(time);
        let tile = |(name, corners): (&str, [[f64; 3]; 3])| {
            let found = screen(corners).off_axis(&eye, [0.05, 50.0]).unwrap();
            let view = EyeView { eye, clip_from_space: found.clip_from_world };
            TileView {
                name: name.into(),
                size_px: SIZE,
                corners: corners.map(Point3::from),
                eyes: [Some(view.clone()), Some(view)],
            }
        };
        let tiles = [("left", LEFT), ("right", RIGHT)].map(tile).into();
        io.emit_at(&VIEWS, time, Views { time, shown_at: time + Interval::from_ms(30.0), tiles });
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(Time(self.next * 1_000_000_000 / 60))
    }
}

/// The middle of all red pixels, from the lower left corner [px]; None where there is none.
fn red(tab: &mut Tab) -> Option<[f64; 2]> {
    let text = "(() => { const [w, h] = [canvas.width, canvas.height]; const it = new Uint8Array(4 * w * h); gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, it); \
        let [n, x, y] = [0, 0, 0]; for (let i = 0; i < w * h; i++) if (it[4 * i] > 200 && it[4 * i + 1] < 40 && it[4 * i + 2] < 40) { n++; x += i % w + 0.5; y += (i / w | 0) + 0.5; } \
        return n > 20 ? [x / n, y / n] : null; })()";
    let found = tab.evaluate(text);
    found.as_array().map(|it| [0, 1].map(|axis| it[axis].as_f64().unwrap()))
}

#[test]
fn each_tile_draws_the_box_where_the_eye_sees_it_and_all_show_one_moment() {
    let Some(browser) = Chromium::start_or_skip(1) else { return };
    let mut registry = Registry::new();
    foveate_display::register(&mut registry);
    registry.add::<Eyes>();
    let text = format!(
        "[rig]\nname = \"box\"\n[scale.room.node]\neyes = {{ type = \"test.eyes\" }}\n\
         left = {{ type = \"display.page\", tile = \"left\", depth_m = {DEPTH}, in = {{ views = \"eyes.views\" }} }}\n\
         right = {{ type = \"display.page\", tile = \"right\", depth_m = {DEPTH}, in = {{ views = \"eyes.views\" }} }}\n\
         none = {{ type = \"display.page\", tile = \"third\", in = {{ views = \"eyes.views\" }} }}\n"
    );
    let graph = rig::load(&text, Path::new("rig.toml"), &registry, &Overrides::default());
    let mut graph = graph.unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let (tell, told) = channel();
    let tell = Mutex::new(tell);
    let server = Arc::new(Server::new("0".parse().unwrap(), move |_, address| {
        drop(tell.lock().unwrap().send(address.to_owned()));
    }));
    graph.pages = Pages::served_by(Arc::<Server>::clone(&server));
    let options = Options { paced: true, ..Options::default() };
    let own = options.clone();
    let thread = std::thread::spawn(move || engine::deterministic(Arc::new(graph), &own, &mut |_| {}).unwrap());
    let addresses: Vec<String> = (0..3).map(|_| told.recv_timeout(Duration::from_secs(60)).unwrap()).collect();
    let mut tabs: Vec<Tab> = ["left", "right"]
        .map(|name| {
            let mut tab = browser.tab();
            tab.resize(SIZE);
            tab.open(addresses.iter().find(|it| it.ends_with(&format!("{name}/"))).unwrap());
            tab.wait_for("shown !== null && gl !== null");
            // What is known is drawn with the page's next frame, which a busy machine is late with.
            (0..1000).any(|_| {
                std::thread::sleep(Duration::from_millis(20));
                red(&mut tab).is_some()
            });
            tab
        })
        .into();
    let middle = Point3::new(0.0, DEPTH, 1.4);
    let mut seen = std::collections::BTreeSet::new();
    for round in 0..120 {
        let moments: Vec<f64> = tabs.iter_mut().map(|tab| tab.evaluate("shown.shown").as_f64().unwrap()).collect();
        for (tab, corners) in tabs.iter_mut().zip([LEFT, RIGHT]) {
            // One look: what is shown, and what is drawn of it.
            let eye = tab.evaluate("shown.eyes[0].eye");
            let eye = Point3::from([0, 1, 2].map(|axis| eye[axis].as_f64().unwrap()));
            let found = red(tab);
            if tab.evaluate("shown.eyes[0].eye")[0].as_f64() != Some(eye.x) {
                continue;
            }
            let screen = screen(corners);
            let at = screen.through(&eye, &middle).unwrap();
            let expected = [at.x / screen.size()[0] * f64::from(SIZE[0]), at.y / screen.size()[1] * f64::from(SIZE[1])];
            let margin = |axis: usize| expected[axis] > 30.0 && expected[axis] < f64::from(SIZE[axis]) - 30.0;
            // A page that a busy machine has not drawn anew shows nothing yet; that something is drawn is asked at the end.
            if let Some(found) = found.filter(|_| margin(0) && margin(1)) {
                let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
                assert!(off < 2.0, "eye {eye}: drawn at {found:?}, expected at {expected:?} px");
                if seen.insert((eye.x * 10.0) as i64)
                    && let Ok(folder) = std::env::var("FOVEATE_SHOTS")
                {
                    std::fs::write(Path::new(&folder).join(format!("box_{}.png", seen.len())), tab.screenshot())
                        .unwrap();
                }
            }
        }
        // Two looks, one after the other, of two pages.
        assert!((moments[0] - moments[1]).abs() < 1000.0, "round {round}: {moments:?}");
        std::thread::sleep(Duration::from_millis(60));
    }
    assert!(seen.len() >= 2, "the middle of the back wall was seen from {seen:?}");
    options.stop.store(true, Ordering::Relaxed);
    let outcome = thread.join().unwrap();
    let told =
        outcome.report.remarks.iter().any(|it| it == "found no tile `third` among those of the viewer: left, right");
    assert!(told, "{:?}", outcome.report.remarks);
    assert_eq!(outcome.report.figures["tile.windows.left"], 1.0);
    server.end();
}
