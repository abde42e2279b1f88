//! `foveate sim head` as another program sees it, and a rig that drives it over UDP.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::the_program::{foveate, program, root};

/// Ends the process also when a test fails.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It has ended by itself where the test went well.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a head and gives what it says first.
fn start(arguments: &[&str]) -> (Running, String) {
    let started = Command::new(program()).args(["sim", "head"]).args(arguments).stdout(Stdio::piped()).spawn();
    let mut child = started.unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    (Running(child), line)
}

#[test]
fn a_head_on_udp_answers_a_stranger_and_a_rig_and_ends_with_ctrl_c() {
    let (mut head, line) = start(&["--udp", "0"]);
    let address = line.split_once("UDP ").and_then(|it| it.1.split_once(',')).unwrap().0.to_owned();

    // Who are you: Sony, EVI-D30, two sockets.
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    socket.send_to(&[0x01, 0x10, 0, 5, 0, 0, 0, 0, 0x81, 0x09, 0x00, 0x02, 0xFF], &address).unwrap();
    let mut buffer = [0; 64];
    let length = socket.recv(&mut buffer).unwrap();
    let expected = [0x01, 0x11, 0, 10, 0, 0, 0, 0, 0x90, 0x50, 0x00, 0x20, 0x04, 0x02, 0x01, 0x21, 0x02, 0xFF];
    assert_eq!(buffer[..length], expected);

    let folder = tempfile::tempdir().unwrap();
    fs::copy(root().join("graphs/ideal_lab.calibration.toml"), folder.path().join("ideal_lab.calibration.toml"))
        .unwrap();
    let rig = format!(
        r#"
        [rig]
        name = "head"
        calibration = "ideal_lab.calibration.toml"
        duration_s = 2

        [scale.room.node.head]
        type = "pan_tilt.head"
        camera = "wide-1"
        port = "udp://{address}"
        "#
    );
    fs::write(folder.path().join("head.toml"), rig).unwrap();
    let (code, said, complaint) = foveate(folder.path(), &["run", "head.toml", "--quiet", "--out", "out"]);
    assert_eq!(code, 0, "{said}{complaint}");
    let summary: Value = serde_json::from_slice(&fs::read(folder.path().join("out/summary.json")).unwrap()).unwrap();
    let text = summary.to_string();
    let figure =
        |name: &str| find(&summary, &format!("heads.wide-1.{name}")).unwrap_or_else(|| panic!("{name}: {text}"));
    assert_eq!(figure("lost"), 0.0);
    assert!(figure("away_s") < 1.9, "{text}");

    let asked = Command::new("kill").args(["-INT", &head.0.id().to_string()]).status().unwrap();
    assert!(asked.success());
    assert_eq!(head.0.wait().unwrap().code(), Some(0));
}

/// A number anywhere in `value` under this key.
fn find(value: &Value, key: &str) -> Option<f64> {
    match value {
        Value::Object(map) => {
            map.get(key).and_then(Value::as_f64).or_else(|| map.values().find_map(|it| find(it, key)))
        }
        _ => None,
    }
}

#[test]
fn a_head_on_a_terminal_says_where_it_is() {
    let (_head, line) = start(&[]);
    let path = line.split_once("EVI-D30 at ").and_then(|it| it.1.split_once(',')).unwrap().0;
    assert!(path.starts_with("/dev/") && std::path::Path::new(path).exists(), "{line}");
}

#[test]
fn a_head_answers_where_it_is_bound_and_nowhere_twice() {
    let (_head, line) = start(&["--bind", "127.0.0.2", "--udp", "0"]);
    let address = line.split_once("UDP ").and_then(|it| it.1.split_once(',')).unwrap().0.to_owned();
    let port = address.strip_prefix("127.0.0.2:").unwrap_or_else(|| panic!("{line}"));
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    socket.send_to(&[0x01, 0x10, 0, 5, 0, 0, 0, 9, 0x81, 0x09, 0x04, 0x00, 0xFF], &address).unwrap();
    let mut buffer = [0; 64];
    let length = socket.recv(&mut buffer).unwrap();
    assert_eq!(buffer[..length], [0x01, 0x11, 0, 4, 0, 0, 0, 9, 0x90, 0x50, 0x02, 0xFF]);

    let at = std::path::Path::new(".");
    let (code, _, complaint) = foveate(at, &["sim", "head", "--bind", "127.0.0.2", "--udp", port]);
    assert_eq!(code, 2);
    assert!(complaint.contains(&format!("UDP {address}: ")), "{complaint}");
    let (code, _, complaint) = foveate(at, &["sim", "head", "--bind", "127.0.0.2:7000"]);
    assert_eq!(code, 2);
    assert!(complaint.contains("expected an address of this host"), "{complaint}");
}
