//! The projector's page in a browser without a window: the real server, the real page, the real engine. The "camera" of these tests takes pictures of the screen.
//!
//! Where there is no browser, each test says on one line that it was skipped. `FOVEATE_SHOTS` names a folder for pictures of the page, for people to look at.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foveate::imaging::stripes::pattern::picture;
use foveate::node::Pages;
use foveate::prelude::*;
use foveate_embed::engine::{self, Options, Outcome};
use foveate_embed::rig::{self, Overrides};
use foveate_structured_light::PatternSettings;
use foveate_testkit::chromium::{Chromium, Tab};
use foveate_web::Server;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Of the projector of these tests [px].
const SIZE: [u32; 2] = [320, 200];
/// A picture of the screen shows what was on it at some moment in so long [ms].
const EXPOSURE_MS: f64 = 100.0;
/// From a frame of the page to its light on the screen, generously [ms].
const LATENCY_MS: f64 = 60.0;

/// Pictures of the screen as a camera's.
struct Screen {
    shots: Receiver<(Instant, Image)>,
    pending: Option<(Instant, Image)>,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct Nothing {}

ports! {
    pub(crate) fn ports_of_screen;
    IMAGE: Out<Image> = "image";
}

impl Node for Screen {
    const TYPE: &'static str = "test.screen";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Pictures of the screen";
    const LIVE: bool = true;
    type Settings = Nothing;

    fn ports() -> Ports {
        ports_of_screen()
    }

    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Err(ConfigError::node("made by the test"))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some((begun, image)) = self.pending.take() {
            let begun = io.now() - Interval(begun.elapsed().as_nanos() as i64);
            io.emit_at(&IMAGE, begun + Interval::from_ms(EXPOSURE_MS / 2.0), image);
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        self.pending = self.pending.take().or_else(|| self.shots.try_recv().ok());
        if self.pending.is_some() { Due::At(Time::ZERO) } else { Due::Waiting }
    }
}

/// Keeps all that comes.
struct Keep(Arc<Mutex<Kept>>);

#[derive(Default)]
struct Kept {
    shown: Vec<PatternShown>,
    sets: Vec<PatternPictures>,
}

ports! {
    pub(crate) fn ports_of_keep;
    SHOWN: In<PatternShown> = each("shown");
    SETS: In<PatternPictures> = each("sets").optional();
}

impl Node for Keep {
    const TYPE: &'static str = "test.keep";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Keeps all that comes";
    type Settings = Nothing;

    fn ports() -> Ports {
        ports_of_keep()
    }

    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Keep(Arc::default()))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut kept = self.0.lock().unwrap();
        kept.shown.extend(io.take(&SHOWN).map(|it| (*it.value).clone()));
        kept.sets.extend(io.take(&SETS).map(|it| (*it.value).clone()));
        Ok(())
    }
}

/// A rig that runs, and the address of its page.
struct Running {
    address: String,
    kept: Arc<Mutex<Kept>>,
    options: Options,
    thread: JoinHandle<Outcome>,
}

fn run(text: &str, shots: Option<Receiver<(Instant, Image)>>) -> Running {
    let kept: Arc<Mutex<Kept>> = Arc::default();
    let mut registry = Registry::new();
    foveate_structured_light::register(&mut registry);
    let keep = Arc::clone(&kept);
    registry.add_with::<Keep>(move |_, _| Ok(Keep(Arc::clone(&keep))));
    let shots = Mutex::new(shots);
    registry.add_with::<Screen>(move |_, setup| {
        let none = channel().1;
        let shots = if setup.purpose == Purpose::Run { shots.lock().unwrap().take() } else { None };
        Ok(Screen { shots: shots.unwrap_or(none), pending: None })
    });
    let graph = rig::load(text, Path::new("rig.toml"), &registry, &Overrides::default());
    let mut graph = graph.unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let (tell, told) = channel();
    let tell = Mutex::new(tell);
    let server = Arc::new(Server::new("0".parse().unwrap(), move |_, address| {
        drop(tell.lock().unwrap().send(address.to_owned()));
    }));
    graph.pages = Pages::served_by(Arc::<Server>::clone(&server));
    let options = Options::default();
    let own = options.clone();
    let thread = std::thread::spawn(move || {
        let outcome = engine::live(Arc::new(graph), &own, &mut |_| {}).unwrap();
        server.end();
        outcome
    });
    Running { address: told.recv_timeout(Duration::from_secs(60)).unwrap(), kept, options, thread }
}

impl Running {
    /// Waits until enough was kept.
    fn wait(&self, tab: &mut Tab, is_enough: impl Fn(&Kept) -> bool) {
        let until = Instant::now() + Duration::from_secs(120);
        while !is_enough(&self.kept.lock().unwrap()) {
            let n = self.kept.lock().unwrap().shown.len();
            assert!(Instant::now() < until, "{n} pictures; the page says {}", tab.evaluate("document.body.innerText"));
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn end(self) -> Outcome {
        self.options.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

fn gray(png: &[u8]) -> Image {
    let pixels = image::load_from_memory(png).unwrap().into_luma8();
    Image { width: pixels.width(), height: pixels.height(), pixels: pixels.into_raw(), ..Image::default() }
}

/// A picture of the page for people, where they want one.
fn keep_shot(name: &str, png: &[u8]) {
    if let Ok(folder) = std::env::var("FOVEATE_SHOTS") {
        std::fs::write(Path::new(&folder).join(name), png).unwrap();
    }
}

/// With a camera that takes pictures of the screen, on a screen of two pixels to one of CSS: whole sets of pictures, each pixel that of the pattern.
#[test]
fn with_a_camera_every_pattern_is_shown_pixel_for_pixel() {
    let Some(browser) = Chromium::start_or_skip(2) else { return };
    let mut tab = browser.tab();
    tab.resize([150, 50]);
    let (give, shots) = channel();
    let rig = format!(
        "[rig]\nname = \"page\"\n[scale.room.node]\n\
         screen = {{ type = \"test.screen\" }}\n\
         projector = {{ type = \"structured_light.projector\", in = {{ image = \"screen.image\" }}, advance = \"image\", sets = 2, latency_ms = {LATENCY_MS}, \
         exposure_ms = {EXPOSURE_MS}, pattern = {{ projector_px = {SIZE:?}, code = \"phase\", steps = 3, order = \"white black columns rows\" }} }}\n\
         sets = {{ type = \"structured_light.collector\", in = {{ image = \"screen.image\", shown = \"projector.shown\" }}, latency_ms = {LATENCY_MS}, exposure_ms = {EXPOSURE_MS}, \
         max_change = 255, max_moved = 1 }}\n\
         keep = {{ type = \"test.keep\", in = {{ shown = \"projector.shown\", sets = \"sets.pictures\" }} }}\n"
    );
    let running = run(&rig, Some(shots));
    tab.open(&running.address);
    tab.wait_for("document.body.innerText.includes('300 x 100 px, the projector 320 x 200')");
    keep_shot("wrong_size.png", &tab.screenshot());
    let mut eye = browser.again(&tab);
    tab.resize(SIZE.map(|it| it / 2));
    tab.wait_for("document.body.classList.contains('shows')");
    let camera = std::thread::spawn(move || {
        loop {
            let begun = Instant::now();
            let png = eye.screenshot();
            // An exposure is over when it is over.
            std::thread::sleep(Duration::from_secs_f64(EXPOSURE_MS * 1e-3).saturating_sub(begun.elapsed()));
            if give.send((begun, gray(&png))).is_err() {
                break;
            }
        }
    });
    running.wait(&mut tab, |it| it.sets.len() == 2);
    let kept = Arc::clone(&running.kept);
    let outcome = running.end();
    camera.join().unwrap();
    let kept = kept.lock().unwrap();
    let code = PatternSettings::read(&kept.sets[0].manifest).unwrap().stripe_code(None).unwrap();
    let pictures = code.pictures();
    let shown: Vec<(u64, u32)> = kept.shown.iter().map(|it| (it.set, it.index)).collect();
    let expected: Vec<(u64, u32)> =
        (0..2).flat_map(|set| (0..pictures.len() as u32).map(move |index| (set, index))).collect();
    assert_eq!(shown, expected);
    for set in &kept.sets {
        assert_eq!([set.width, set.height], SIZE);
        for (index, shown) in pictures.iter().enumerate() {
            let found = set.picture(index).unwrap();
            assert!(found == picture(&code, *shown, 1.0), "`{shown}` is not shown as it is");
        }
    }
    let figures = &outcome.report.figures;
    assert_eq!(figures["projector.sets.projector"], 2.0);
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
    assert!(figures["projector.clock_ms.max.projector"] < 50.0, "{figures:?}");
    println!("{} pictures; {figures:?}", expected.len());
}

/// At a rate: all pictures in order, about as far apart as they should be; closed in the middle and opened again.
#[test]
fn at_a_rate_patterns_follow_one_another_and_a_page_that_is_closed_is_named() {
    let Some(browser) = Chromium::start_or_skip(1) else { return };
    let mut tab = browser.tab();
    tab.resize(SIZE);
    let rig = format!(
        "[rig]\nname = \"page\"\n[scale.room.node]\n\
         projector = {{ type = \"structured_light.projector\", rate_hz = 3, sets = 1, pattern = {{ projector_px = {SIZE:?}, order = \"columns\" }} }}\n\
         keep = {{ type = \"test.keep\", in = {{ shown = \"projector.shown\" }} }}\n"
    );
    let running = run(&rig, None);
    let mut other = browser.tab();
    other.resize([200, 100]);
    other.open(&running.address);
    other.wait_for("document.body.innerText.includes('200 x 100 px, the projector')");
    tab.open(&running.address);
    running.wait(&mut tab, |it| it.shown.len() >= 2);
    keep_shot("at_a_rate.png", &tab.screenshot());
    other.resize(SIZE);
    other.wait_for("document.body.innerText.includes('Another window shows the patterns')");
    tab.open("about:blank");
    let n = 18;
    running.wait(&mut other, |it| it.shown.iter().filter(|it| it.set == 1).count() >= n - 1);
    let kept = Arc::clone(&running.kept);
    let outcome = running.thread.join().unwrap();
    other.wait_for(
        "document.body.innerText.includes('The run is over') || document.body.innerText.includes('Not connected')",
    );
    let kept = kept.lock().unwrap();
    let second: Vec<&PatternShown> = kept.shown.iter().filter(|it| it.set == 1).collect();
    assert!(second.iter().zip(second.iter().skip(1)).all(|it| it.0.index < it.1.index && it.0.from < it.1.from));
    let n_gaps: u64 = outcome.gaps.iter().map(|it| it.count).sum();
    assert_eq!(second.len() + n_gaps as usize, n + 1, "dropped pictures and the abandoned set are reported");
    let whole = (second[second.len() - 1].from - second[0].from).as_s();
    let steps = f64::from(second[second.len() - 1].index - second[0].index);
    assert!((0.32..0.5).contains(&(whole / steps)), "{} s a picture", whole / steps);
    assert!(outcome.report.remarks.iter().any(|it| it.contains("set 0: the page")), "{:?}", outcome.report.remarks);
    println!("{} s a picture; {:?}", whole / steps, outcome.report.figures);
}

/// At a key: as fast as a person presses it.
#[test]
fn a_key_on_the_page_shows_the_next_pattern() {
    let Some(browser) = Chromium::start_or_skip(1) else { return };
    let mut tab = browser.tab();
    tab.resize(SIZE);
    let rig = format!(
        "[rig]\nname = \"page\"\n[scale.room.node]\n\
         projector = {{ type = \"structured_light.projector\", advance = \"key\", sets = 1, pattern = {{ projector_px = {SIZE:?}, order = \"white black columns\", bits = [1, 0] }} }}\n\
         keep = {{ type = \"test.keep\", in = {{ shown = \"projector.shown\" }} }}\n"
    );
    let running = run(&rig, None);
    tab.open(&running.address);
    tab.wait_for("document.body.classList.contains('shows')");
    let white = gray(&tab.screenshot());
    assert!(white.pixels.iter().all(|it| *it == 255));
    std::thread::sleep(Duration::from_millis(500));
    tab.press("PageDown");
    running.wait(&mut tab, |it| !it.shown.is_empty());
    let black = gray(&tab.screenshot());
    assert!(black.pixels.iter().all(|it| *it == 0));
    std::thread::sleep(Duration::from_millis(500));
    tab.press(" ");
    running.wait(&mut tab, |it| it.shown.len() == 2);
    let code =
        PatternSettings::read(&running.kept.lock().unwrap().shown[0].manifest).unwrap().stripe_code(None).unwrap();
    assert!(gray(&tab.screenshot()).pixels == picture(&code, code.pictures()[2], 1.0));
    std::thread::sleep(Duration::from_millis(500));
    tab.press("Enter");
    running.wait(&mut tab, |it| it.shown.len() == 3);
    std::thread::sleep(Duration::from_millis(500));
    tab.press("ArrowRight");
    running.wait(&mut tab, |it| it.shown.len() == 4);
    let shown = running.kept.lock().unwrap().shown.clone();
    assert!(shown.iter().all(|it| it.lasts > Interval::from_ms(300.0)), "{shown:?}");
    assert_eq!(running.thread.join().unwrap().report.figures["projector.sets.projector"], 1.0);
}
