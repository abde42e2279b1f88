//! The server as a run sees it.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use foveate_node::page::{Client, Page, PageEvent, PageLink, PageServer};

use crate::admission::Admission;
use crate::board::{Board, Counts};
use crate::listen::{Listen, token};
use crate::turns::Turns;

/// A thread that does not end in this time is left behind: a page's file may be made by code of others.
const LONGEST_END: Duration = Duration::from_secs(2);

/// Serves the pages of a run. It listens from the first page on; a run without pages opens no port.
pub struct Server {
    listen: Listen,
    on_page: Box<OnPage>,
    running: Mutex<Option<Running>>,
}

/// Callback for each page that is served: its node, and the address for people, with the token where one is needed.
type OnPage = dyn Fn(&str, &str) + Send + Sync;

struct Running {
    board: Arc<Board>,
    base: String,
    token: Option<String>,
    thread: Option<JoinHandle<()>>,
    done: Receiver<()>,
}

impl Server {
    /// A server that will listen at `listen`; `on_page` is called for each page that is served, with its node and its address.
    pub fn new(listen: Listen, on_page: impl Fn(&str, &str) + Send + Sync + 'static) -> Server {
        Server { listen, on_page: Box::new(on_page), running: Mutex::new(None) }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Running>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether any page was put up.
    pub fn is_serving(&self) -> bool {
        self.lock().is_some()
    }

    /// What was refused, skipped or dropped so far.
    pub fn counts(&self) -> Counts {
        self.lock().as_ref().map(|it| it.board.counts()).unwrap_or_default()
    }

    /// Closes all windows and the port; gives what was counted. Ends within two seconds whatever a page does.
    pub fn end(&self) -> Counts {
        let Some(mut running) = self.lock().take() else { return Counts::default() };
        running.board.end();
        if running.done.recv_timeout(LONGEST_END).is_ok()
            && let Some(thread) = running.thread.take()
        {
            drop(thread.join());
        }
        running.board.counts()
    }

    fn start(&self) -> Result<Running, String> {
        let (listener, address) = self.listen.bind()?;
        let token = if address.ip().is_loopback() { None } else { Some(token()?) };
        let admission = Admission::new(address, self.listen.host(), token.clone());
        let fault = |error: std::io::Error| format!("pages cannot be served at `{}`: {error}", self.listen);
        let (turns, waker) = Turns::new(listener, admission).map_err(fault)?;
        let board = Arc::new(Board::new());
        board.wakes(waker);
        let (is_done, done) = sync_channel(1);
        let shared = Arc::clone(&board);
        let thread = std::thread::Builder::new().name("web".to_owned()).spawn(move || {
            turns.run(&shared);
            let _ = is_done.try_send(());
        });
        let base = format!("http://{}", reachable(address));
        Ok(Running { board, base, token, thread: Some(thread.map_err(fault)?), done })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

impl PageServer for Server {
    fn open(&self, instance: &str, page: Page) -> Result<Box<dyn PageLink>, String> {
        let mut running = self.lock();
        if running.is_none() {
            *running = Some(self.start()?);
        }
        let Some(Running { board, base, token, .. }) = &*running else { unreachable!("it was started") };
        let name = page_name(instance);
        let number = board.open(&name, instance, page)?;
        let address = format!("{base}/{name}/");
        let secret = token.as_ref().map_or(String::new(), |it| format!("?token={it}"));
        (self.on_page)(instance, &format!("{address}{secret}"));
        Ok(Box::new(Link { board: Arc::clone(board), name, number, address }))
    }
}

/// The address of a server under which another computer finds it.
fn reachable(address: SocketAddr) -> SocketAddr {
    if !address.ip().is_unspecified() {
        return address;
    }
    // The address that this machine would send from; nothing is sent.
    let own = UdpSocket::bind("0.0.0.0:0").and_then(|it| {
        it.connect("192.0.2.1:9")?;
        it.local_addr()
    });
    SocketAddr::new(own.map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |it| it.ip()), address.port())
}

/// The name of a node's page in addresses: `room.show[left]` becomes `room.show-left`.
fn page_name(instance: &str) -> String {
    let allowed = |it: char| if it.is_ascii_alphanumeric() || "._-".contains(it) { it } else { '-' };
    instance.chars().map(allowed).collect::<String>().trim_matches('-').to_owned()
}

/// A node's end of its page.
struct Link {
    board: Arc<Board>,
    name: String,
    number: u64,
    address: String,
}

impl PageLink for Link {
    fn address(&self) -> String {
        self.address.clone()
    }

    fn now(&self) -> i64 {
        self.board.now()
    }

    fn take(&mut self) -> Option<PageEvent> {
        self.board.take(&self.name, self.number)
    }

    fn send(&mut self, client: Client, text: &str) -> bool {
        self.board.send(&self.name, client, text)
    }

    fn send_latest(&mut self, client: Client, messages: Vec<(u64, Vec<u8>)>) -> bool {
        self.board.send_latest(&self.name, client, messages)
    }

    fn greet(&mut self, text: &str) {
        self.board.greet(&self.name, self.number, text);
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.board.leave(&self.name, self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instances_become_names_that_addresses_can_hold() {
        assert_eq!(page_name("room.show[left]"), "room.show-left");
        assert_eq!(page_name("room.a b"), "room.a-b");
    }

    #[test]
    fn an_address_that_means_all_is_reported_as_one_that_can_be_opened() {
        assert_eq!(reachable("127.0.0.1:5".parse().unwrap()).to_string(), "127.0.0.1:5");
        let found = reachable("0.0.0.0:5".parse().unwrap());
        assert!(!found.ip().is_unspecified() && found.port() == 5);
    }
}
