//! The page of the console in a browser without a window: a person goes through it with mouse and keys.
//!
//! Where there is no browser, each test says on one line that it was skipped. `FOVEATE_SHOTS` names a folder for pictures of the page, for people to look at.

use std::fs;
use std::path::Path;

use foveate_testkit::chromium::{Chromium, Tab};
use serde_json::{Value, json};

use crate::console::{Shown, dots};
use crate::sessions::must;
use crate::the_program::new_room;

/// Boxes with text or controls that lie over each other, and what sticks out of the window.
const OVERLAPS: &str = r##"(() => {
  const kinds = ["BUTTON", "INPUT", "SELECT", "CANVAS"];
  const seen = [...document.querySelectorAll("#top *, #bottom *, #view *, #notice")].filter((it) => it.checkVisibility() && !it.closest("svg, [data-over], .room-stage, .stage") &&
    (it.childElementCount === 0 || kinds.includes(it.tagName)) && (it.textContent.trim() || kinds.includes(it.tagName)));
  const box = (it) => {
    let { left, top, right, bottom } = it.getBoundingClientRect();
    for (let at = it.parentElement; at; at = at.parentElement) {
      if (getComputedStyle(at).overflow === "visible") continue;
      const around = at.getBoundingClientRect();
      [left, top, right, bottom] = [Math.max(left, around.left), Math.max(top, around.top), Math.min(right, around.right), Math.min(bottom, around.bottom)];
    }
    return [left, top, right, bottom];
  };
  const boxes = seen.map((it) => [it, box(it)]).filter(([, [l, t, r, b]]) => r - l > 1 && b - t > 1), found = [];
  boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
    if (a.contains(b) || b.contains(a)) return;
    const wide = Math.min(p[2], q[2]) - Math.max(p[0], q[0]), high = Math.min(p[3], q[3]) - Math.max(p[1], q[1]);
    if (wide > 1.5 && high > 1.5) found.push(`${a.tagName} ${a.textContent.slice(0, 20)} over ${b.tagName} ${b.textContent.slice(0, 20)}`);
  }));
  if (document.documentElement.scrollWidth > innerWidth) found.push(`it is ${document.documentElement.scrollWidth} px wide`);
  return found.slice(0, 10);
})()"##;

/// A page and what it has complained of.
struct Page {
    tab: Tab,
}

impl Page {
    fn open(browser: &Chromium, address: &str, size: [u32; 2], theme: &str) -> Page {
        let mut tab = browser.tab();
        tab.resize(size);
        tab.call("Page.enable", json!({}));
        let features = json!([{ "name": "prefers-color-scheme", "value": theme }]);
        tab.call("Emulation.setEmulatedMedia", json!({ "features": features }));
        let script = "window.faults = []; addEventListener('error', (it) => faults.push(it.message)); \
                      addEventListener('unhandledrejection', (it) => faults.push(String(it.reason)));";
        tab.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": script }));
        tab.open(address);
        let mut page = Page { tab };
        page.wait_for("document.body?.dataset.phase === 'running'");
        page
    }

    fn wait_for(&mut self, expression: &str) {
        self.tab.wait_for(expression);
    }

    fn is(&mut self, expression: &str) -> Value {
        self.tab.evaluate(expression)
    }

    /// Presses a key that has a name, or a letter.
    fn press(&mut self, key: &str) {
        let text = if key.chars().count() == 1 { key } else { "" };
        let code = match key {
            "Enter" => 13,
            "Escape" => 27,
            "ArrowRight" => 39,
            _ => 0,
        };
        let text = if key == "Enter" { "\r" } else { text };
        self.tab.call(
            "Input.dispatchKeyEvent",
            json!({ "type": if text.is_empty() { "rawKeyDown" } else { "keyDown" }, "key": key, "text": text, "windowsVirtualKeyCode": code }),
        );
        self.tab.call("Input.dispatchKeyEvent", json!({ "type": "keyUp", "key": key, "windowsVirtualKeyCode": code }));
    }

    fn mouse(&mut self, what: &str, [x, y]: [f64; 2]) {
        let button = if what == "mouseMoved" { "none" } else { "left" };
        let event = json!({ "type": what, "x": x, "y": y, "button": button, "clickCount": 1 });
        self.tab.call("Input.dispatchMouseEvent", event);
    }

    fn click(&mut self, at: [f64; 2]) {
        ["mouseMoved", "mousePressed", "mouseReleased"].iter().for_each(|it| self.mouse(it, at));
    }

    /// Left, top, width and height of an element.
    fn place(&mut self, selector: &str) -> [f64; 4] {
        let it = self.is(&format!(
            "(() => {{ const it = document.querySelector({}).getBoundingClientRect(); return [it.x, it.y, it.width, it.height]; }})()",
            json!(selector)
        ));
        [0, 1, 2, 3].map(|at| it[at].as_f64().unwrap())
    }

    /// Goes to the view of that key, and checks its boxes.
    fn view(&mut self, key: &str, name: &str, shot: &str) {
        self.press(key);
        self.wait_for(&format!("document.body.dataset.view === '{name}'"));
        std::thread::sleep(std::time::Duration::from_millis(400));
        assert_eq!(self.is(OVERLAPS), json!([]), "{shot}");
        assert_eq!(self.is("window.faults"), json!([]), "{shot}");
        if let Some(folder) = std::env::var_os("FOVEATE_SHOTS") {
            fs::write(Path::new(&folder).join(format!("console_{shot}.png")), self.tab.screenshot()).unwrap();
        }
    }
}

#[test]
fn a_newcomer_looks_around_moves_a_threshold_paints_a_mask_and_saves_the_rig() {
    let Some(browser) = Chromium::start_or_skip(1) else { return };
    let folder = tempfile::tempdir().unwrap();
    new_room(folder.path());
    let run = ["run", "room.toml", "--console", "--stay", "--listen", "0", "--duration", "600", "--out", "run"];
    let shown = Shown::start(folder.path(), &run);
    // Every view at three sizes, dark and light.
    for (size, theme) in [([3840, 2160], "light"), ([390, 844], "dark"), ([1280, 720], "light"), ([1280, 720], "dark")]
    {
        let mut page = Page::open(&browser, &shown.address, size, theme);
        let of = |view: &str| format!("{view}_{}_{theme}", size[0]);
        page.wait_for("document.querySelectorAll('#view canvas').length >= 18");
        for (key, name) in [("2", "room"), ("3", "health"), ("1", "cameras")] {
            page.view(key, name, &of(name));
        }
        page.press("?");
        assert_eq!(page.is(OVERLAPS), json!([]), "the help sheet");
        page.press("Escape");
        if size != [1280, 720] || theme != "dark" {
            continue;
        }
        // The room is drawn as often as something moves in it.
        page.press("2");
        page.wait_for("Number(document.querySelector('.room').dataset.frames) > 3");
        page.press("1");
        // One camera, large.
        page.press("ArrowRight");
        page.press("Enter");
        page.wait_for("document.querySelector('.stage') !== null");
        page.view("t", "cameras", "threshold");
        page.press("t");
        // A slider is put further to the right.
        let [x, y, width, height] = page.place("[data-setting=offset] input[type=range]");
        page.click([x + 0.3 * width, y + height / 2.0]);
        page.wait_for("document.querySelector('#view').innerText.includes('room.leds.offset')");
        // A mask over the middle of the picture: what was found there is gone.
        page.press("p");
        let [x, y, width, height] = page.place(".stage");
        for [u, v] in [[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]] {
            page.click([x + u * width, y + v * height]);
            std::thread::sleep(std::time::Duration::from_millis(500));
        }
        page.press("Enter");
        let save =
            "[...document.querySelectorAll('button')].find((it) => it.textContent.startsWith('Save') && !it.disabled)";
        page.wait_for("document.body.innerText.includes('camera_masks')");
        page.view("p", "cameras", "masked");
        page.is(&format!("{save}.click()"));
        page.wait_for("document.body.innerText.includes('saved 2 settings')");
        let saved = fs::read_to_string(folder.path().join("room.toml")).unwrap();
        assert!(saved.contains("camera_masks = { wide-1 = [[["), "{saved}");
        assert!(saved.lines().any(|it| it.starts_with("offset = ") && it != "offset = 20"), "{saved}");
        // Time stands and goes on.
        page.press("Escape");
        page.press(" ");
        page.wait_for("document.body.dataset.phase === 'paused'");
        page.press(" ");
        page.wait_for("document.body.dataset.phase === 'running'");
    }
    must(folder.path(), &["check", "room.toml"]);
}

#[test]
fn a_mark_of_a_session_is_named_with_mouse_and_keys_and_tracked_again() {
    let Some(browser) = Chromium::start_or_skip(1) else { return };
    let folder = tempfile::tempdir().unwrap();
    dots(folder.path(), 40, 1.0);
    must(folder.path(), &["run", "dots.toml", "--quiet", "--record", "s.mcap", "--out", "run"]);
    let shown = Shown::start(folder.path(), &["view", "s.mcap", "--listen", "0"]);
    let mut page = Page::open(&browser, &shown.address, [1280, 720], "dark");
    page.press(" ");
    page.wait_for("document.body.dataset.phase === 'paused'");
    page.view("5", "marks", "marks");
    // A picture back and on; the first dot without a number is chosen, and is mark 1.
    page.press(",");
    page.press(".");
    std::thread::sleep(std::time::Duration::from_millis(500));
    page.press("u");
    page.press("n");
    page.wait_for("document.activeElement.tagName === 'INPUT'");
    page.press("Enter");
    page.wait_for("document.querySelector('#view').innerText.includes('mark 1')");
    page.press("t");
    page.wait_for("document.querySelector('#view').innerText.includes('tracked again with 1 row')");
    page.view("5", "marks", "marks_again");
    let rows = fs::read_to_string(folder.path().join("s.corrections.csv")).unwrap();
    assert_eq!(rows.lines().count(), 2, "{rows}");
    assert!(rows.lines().nth(1).is_some_and(|it| it.starts_with("left,1,")), "{rows}");
}
