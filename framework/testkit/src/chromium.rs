//! A browser without a window, driven over its DevTools protocol (JSON over a WebSocket).

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser that ends with this.
pub struct Chromium {
    child: Child,
    address: String,
    _profile: tempfile::TempDir,
}

impl Chromium {
    /// A browser on a screen of which `ratio` pixels make one of CSS, or why there is none.
    pub fn start(ratio: u32) -> Result<Chromium, String> {
        let runs = |name: &&str| Command::new(name).arg("--version").stdout(Stdio::null()).status().is_ok();
        let own = std::env::var("FOVEATE_CHROMIUM").ok();
        let name = own.as_deref().or_else(|| NAMES.iter().find(|it| runs(it)).copied());
        let name =
            name.ok_or_else(|| format!("found none of {} (FOVEATE_CHROMIUM names another)", NAMES.join(", ")))?;
        let profile = tempfile::tempdir().map_err(|error| error.to_string())?;
        let data = format!("--user-data-dir={}", profile.path().display());
        let ratio = format!("--force-device-scale-factor={ratio}");
        let fixed = [
            "--headless=new",
            "--no-sandbox",
            "--no-first-run",
            "--disable-backgrounding-occluded-windows",
            "--remote-debugging-port=0",
            "--enable-unsafe-swiftshader",
            "--force-color-profile=srgb",
        ];
        let mut command = Command::new(name);
        command.args(fixed).args([data.as_str(), &ratio, "about:blank"]).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| format!("`{name}` does not start: {error}"))?;
        let stderr = child.stderr.take().ok_or("no standard error")?;
        let (tell, told) = mpsc::channel();
        // Read to its end, so that the browser never waits for a full pipe.
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if let Some(address) = line.strip_prefix("DevTools listening on ") {
                    drop(tell.send(address.trim().to_owned()));
                }
            }
        });
        match told.recv_timeout(PATIENCE) {
            Ok(address) => Ok(Chromium { child, address, _profile: profile }),
            Err(_) => {
                drop(child.kill());
                drop(child.wait());
                Err(format!("`{name}` did not say where its DevTools listen"))
            }
        }
    }

    /// As [`Chromium::start`], or nothing, and a line that says that a test is skipped and why.
    pub fn start_or_skip(ratio: u32) -> Option<Chromium> {
        let found = Chromium::start(ratio);
        found.map_err(|why| println!("skipped: no browser: {why}")).ok()
    }

    /// A new tab.
    pub fn tab(&self) -> Tab {
        let mut tab = Tab::connect(&self.address, "");
        let target =
            tab.call("Target.createTarget", json!({ "url": "about:blank", "newWindow": true }))["targetId"].clone();
        tab.attach(target.as_str().unwrap());
        tab
    }

    /// A second connection to a tab, for another thread.
    pub fn again(&self, tab: &Tab) -> Tab {
        let mut again = Tab::connect(&self.address, "");
        again.attach(&tab.target);
        again
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// A tab.
pub struct Tab {
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    target: String,
    session: Option<String>,
    next: u64,
}

impl Tab {
    fn connect(address: &str, target: &str) -> Tab {
        let (socket, _) = tungstenite::connect(address).unwrap();
        Tab { socket, target: target.to_owned(), session: None, next: 0 }
    }

    fn attach(&mut self, target: &str) {
        target.clone_into(&mut self.target);
        let session = self.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        self.session = session["sessionId"].as_str().map(str::to_owned);
    }

    /// Calls a method of the protocol; its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.next += 1;
        let mut message = json!({ "id": self.next, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(message.to_string())).unwrap();
        let until = Instant::now() + PATIENCE;
        loop {
            assert!(Instant::now() < until, "no answer to {method}");
            let Ok(text) = self.socket.read().unwrap().into_text() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap_or_default();
            if answer["id"] == self.next {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Makes the window so large [px of CSS].
    pub fn resize(&mut self, [width, height]: [u32; 2]) {
        // Without a factor of its own: the screen's stays.
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 0, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Opens an address.
    pub fn open(&mut self, address: &str) {
        self.call("Page.navigate", json!({ "url": address }));
    }

    /// What an expression is.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let result = self.call("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn wait_for(&mut self, expression: &str) {
        let until = Instant::now() + PATIENCE;
        while self.evaluate(expression) != true {
            let text = self.evaluate("document.body.innerText");
            assert!(Instant::now() < until, "never: {expression}; the page says {text}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Presses a key.
    pub fn press(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", json!({ "type": kind, "key": key }));
        }
    }

    /// What the tab shows, as PNG.
    pub fn screenshot(&mut self) -> Vec<u8> {
        let picture = self.call("Page.captureScreenshot", json!({ "format": "png", "optimizeForSpeed": true }));
        from_base64(picture["data"].as_str().unwrap())
    }
}

fn from_base64(text: &str) -> Vec<u8> {
    let value = |it: u8| match it {
        b'A'..=b'Z' => it - b'A',
        b'a'..=b'z' => it - b'a' + 26,
        b'0'..=b'9' => it - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits: Vec<u8> = text.bytes().filter(|it| *it != b'=').map(value).collect();
    let four = |it: &[u8]| {
        let bits = it.iter().fold(0_u32, |bits, digit| bits << 6 | u32::from(*digit)) << (6 * (4 - it.len()));
        bits.to_be_bytes()[1..it.len()].to_vec()
    };
    digits.chunks(4).flat_map(four).collect()
}
