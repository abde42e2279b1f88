//! Pages that people open in a browser while a rig runs: what a node serves, and how it talks to its page.
//!
//! The server stands outside the deterministic part of a run (room `web`), as a camera's driver does. A page that only shows what a run does may be part of any
//! run. A node that lets something of its page into the run works on a device ([`Node::LIVE`](crate::Node::LIVE)): what happens on the page carries the time of its arrival on the server's clock, which the node carries to the session's.

use std::fmt::{self, Debug};
use std::sync::Arc;

/// A page to be served.
pub struct Page {
    /// Its HTML. It finds the other side of its [`PageLink`] through `/foveate.js`, which the server has.
    pub html: &'static str,
    /// Its other files. Called on the server's thread: it must not wait for anything.
    pub files: Arc<Files>,
}

/// A file of that name, made on request; `None` where there is no such file.
pub type Files = dyn Fn(&str) -> Option<PageFile> + Send + Sync;

/// A file of a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageFile {
    /// As `application/octet-stream`.
    pub content_type: &'static str,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// One window in which a page is open; a page that is opened again is another one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Client(pub u64);

/// Something that happened on a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageEvent {
    /// In which window.
    pub client: Client,
    /// When the server learnt of it, on its own clock [ns].
    pub arrival: i64,
    /// What.
    pub what: PageNews,
}

/// What happened on a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PageNews {
    /// It was opened.
    Opened,
    /// It sent this text.
    Text(String),
    /// It was closed, by the browser or by the server: why.
    Closed(String),
}

/// A node's end of its page. None of its calls waits for a browser.
pub trait PageLink: Send {
    /// Where people open it, without any secret.
    fn address(&self) -> String;

    /// The server's clock, which runs evenly and never goes back [ns].
    fn now(&self) -> i64;

    /// The oldest event that was not taken yet. The queue is bounded: where a page sends more than is taken, messages are dropped and counted.
    fn take(&mut self) -> Option<PageEvent>;

    /// Sends a text to one window; `false` where that is closed, or reads so slowly that the message is skipped.
    fn send(&mut self, client: Client, text: &str) -> bool;

    /// Sends bytes to one window, each under a topic: what waits there under the same one is replaced, so that a window that reads slowly gets the newest. `false` where
    /// the window is closed, so much waits for it that a message is skipped, or the link carries texts alone.
    fn send_latest(&mut self, _client: Client, _messages: Vec<(u64, Vec<u8>)>) -> bool {
        false
    }

    /// From now on each window that opens the page is sent this first, after the run too.
    fn greet(&mut self, text: &str);
}

/// What serves pages to browsers.
pub trait PageServer: Send + Sync {
    /// Serves `page` for the node `instance`, in place of an earlier page of the same node.
    ///
    /// # Errors
    /// A sentence: no address to serve at, a name that is taken.
    fn open(&self, instance: &str, page: Page) -> Result<Box<dyn PageLink>, String>;
}

/// The server of a run, if it has one.
#[derive(Clone, Default)]
pub struct Pages(Option<Arc<dyn PageServer>>);

impl Pages {
    /// Served by `server`.
    pub fn served_by(server: Arc<dyn PageServer>) -> Pages {
        Pages(Some(server))
    }

    /// [`PageServer::open`]; `None` where the run has no server: nodes then work without a page.
    ///
    /// # Errors
    /// As there.
    pub fn open(&self, instance: &str, page: Page) -> Result<Option<Box<dyn PageLink>>, String> {
        self.0.as_ref().map(|it| it.open(instance, page)).transpose()
    }
}

impl Debug for Pages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Pages(served)" } else { "Pages(none)" })
    }
}
