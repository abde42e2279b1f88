//! What the server's thread and the nodes share: pages, what happened on them, what is to be sent. Neither side ever waits for a browser here: queues
//! are bounded, and what does not fit is counted.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use foveate_node::page::{Client, Page, PageEvent, PageFile, PageNews};
use mio::Waker;

/// Texts of one window that wait for the node: a second's worth of what a page that follows a mouse sends, and more.
const MOST_IN: usize = 256;
/// Texts that wait to be sent to one window, and their bytes: a page that is so far behind shows nothing of use.
const MOST_OUT: usize = 256;
const MOST_OUT_BYTES: usize = 4 << 20;
/// Longest message of bytes: a picture of 20 million pixels in three colours.
const MOST_LATEST_BYTES: usize = 64 << 20;

/// What was refused, skipped or dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Windows in which pages were opened.
    pub windows: u64,
    /// Requests under a name that is not this server's.
    pub foreign_hosts: u64,
    /// Requests by pages of other sites.
    pub foreign_origins: u64,
    /// Requests without the token, or with another one.
    pub without_token: u64,
    /// Connections that brought no request, or one that is none.
    pub malformed: u64,
    /// Connections closed since there were too many, or too many requests a second.
    pub too_many: u64,
    /// Windows closed since they sent a message longer than is taken.
    pub too_large: u64,
    /// Windows closed since they sent more messages a second than is taken.
    pub flooding: u64,
    /// Windows closed because they did not read, or answered no ping.
    pub stalled: u64,
    /// Messages of pages dropped since their node did not take them in time.
    pub dropped: u64,
    /// Messages to pages skipped since they read slowly.
    pub skipped: u64,
}

impl Counts {
    /// What people should know, a sentence each; nothing where all went well.
    pub fn in_words(&self) -> Vec<String> {
        let told = [
            (self.foreign_hosts, "requests under a name that is not this server's were refused (DNS rebinding)"),
            (self.foreign_origins, "requests by pages of other sites were refused (`Origin`)"),
            (self.without_token, "requests without the right token were refused"),
            (self.malformed, "connections brought no request that can be read"),
            (self.too_many, "connections were closed: too many at once or a second"),
            (self.too_large, "windows were closed: a message was too long"),
            (self.flooding, "windows were closed: too many messages a second"),
            (self.stalled, "windows were closed: they did not read, or answered no ping"),
            (self.dropped, "messages of pages were dropped: their node did not take them in time"),
            (self.skipped, "messages to pages were skipped: they read too slowly"),
        ];
        told.iter().filter(|it| it.0 > 0).map(|(n, words)| format!("web server: {n} {words}")).collect()
    }
}

/// What both sides share.
pub(crate) struct Board {
    inner: Mutex<Inner>,
    waker: OnceLock<Waker>,
    epoch: Instant,
}

#[derive(Default)]
struct Inner {
    pages: BTreeMap<String, Entry>,
    windows: BTreeMap<Client, Window>,
    n_windows: u64,
    n_pages: u64,
    counts: Counts,
    is_ending: bool,
}

/// A page that is up.
struct Entry {
    instance: String,
    page: Arc<Page>,
    /// Tells pages apart that were put up under one name, one after the other.
    number: u64,
    greeting: Option<Arc<str>>,
    events: VecDeque<PageEvent>,
    /// A node takes the events.
    is_held: bool,
}

/// What waits to be sent to a window.
#[derive(Debug, Clone)]
pub(crate) enum Out {
    /// A text.
    Text(Arc<str>),
    /// Bytes; later ones of the same topic take their place.
    Latest(u64, Vec<u8>),
}

impl Out {
    fn len(&self) -> usize {
        match self {
            Out::Text(text) => text.len(),
            Out::Latest(_, bytes) => bytes.len(),
        }
    }
}

/// A window that is open.
struct Window {
    page: String,
    /// Texts from it that wait for the node.
    n_in: usize,
    out: VecDeque<Out>,
    out_bytes: usize,
    /// Why it is to be closed.
    close: Option<&'static str>,
}

impl Window {
    /// Lets bytes wait in the place of earlier ones of their topic; gives them back where too much waits.
    fn put(&mut self, topic: u64, bytes: Vec<u8>) -> Option<Vec<u8>> {
        let waiting = self.out.iter().position(|it| matches!(it, Out::Latest(other, _) if *other == topic));
        let freed = waiting.map_or(0, |it| self.out[it].len());
        let is_full = waiting.is_none() && self.out.len() >= MOST_OUT;
        // A single message may be larger than all that otherwise waits: a picture as it is.
        let is_heavy = self.out_bytes > freed && self.out_bytes - freed + bytes.len() > MOST_OUT_BYTES;
        if is_full || is_heavy || bytes.len() > MOST_LATEST_BYTES {
            return Some(bytes);
        }
        self.out_bytes = self.out_bytes - freed + bytes.len();
        match waiting {
            Some(place) => self.out[place] = Out::Latest(topic, bytes),
            None => self.out.push_back(Out::Latest(topic, bytes)),
        }
        None
    }
}

impl Board {
    pub(crate) fn new() -> Board {
        Board { inner: Mutex::default(), waker: OnceLock::new(), epoch: Instant::now() }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Who wakes the server's thread.
    pub(crate) fn wakes(&self, waker: Waker) {
        drop(self.waker.set(waker));
    }

    fn wake(&self) {
        // Where that fails the thread looks by itself a little later.
        drop(self.waker.get().map(Waker::wake));
    }

    /// The server's clock [ns].
    pub(crate) fn now(&self) -> i64 {
        self.epoch.elapsed().as_nanos() as i64
    }

    pub(crate) fn counts(&self) -> Counts {
        self.lock().counts
    }

    pub(crate) fn count(&self, what: impl FnOnce(&mut Counts)) {
        what(&mut self.lock().counts);
    }

    pub(crate) fn end(&self) {
        self.lock().is_ending = true;
        self.wake();
    }

    pub(crate) fn is_ending(&self) -> bool {
        self.lock().is_ending
    }

    // The node's side.

    /// Puts a page up under `name`; its number.
    pub(crate) fn open(&self, name: &str, instance: &str, page: Page) -> Result<u64, String> {
        let mut inner = self.lock();
        if let Some(other) = inner.pages.get(name).filter(|it| it.instance != instance) {
            return Err(format!("found the page `/{name}/` of `{}` already, expected another name", other.instance));
        }
        let before = inner.windows.values_mut().filter(|it| it.page == name);
        before.for_each(|it| it.close = Some("the page was replaced"));
        inner.n_pages += 1;
        let number = inner.n_pages;
        let events = VecDeque::new();
        let instance = instance.to_owned();
        let entry = Entry { instance, page: Arc::new(page), number, greeting: None, events, is_held: true };
        inner.pages.insert(name.to_owned(), entry);
        drop(inner);
        self.wake();
        Ok(number)
    }

    /// The node of page `number` is gone: the page stays, and its events are dropped.
    pub(crate) fn leave(&self, name: &str, number: u64) {
        if let Some(entry) = self.lock().pages.get_mut(name).filter(|it| it.number == number) {
            entry.is_held = false;
            entry.events.clear();
        }
    }

    pub(crate) fn take(&self, name: &str, number: u64) -> Option<PageEvent> {
        let mut inner = self.lock();
        let entry = inner.pages.get_mut(name).filter(|it| it.number == number)?;
        let event = entry.events.pop_front()?;
        if let (PageNews::Text(_), Some(window)) = (&event.what, inner.windows.get_mut(&event.client)) {
            window.n_in -= 1;
        }
        Some(event)
    }

    pub(crate) fn send(&self, name: &str, client: Client, text: &str) -> bool {
        let mut inner = self.lock();
        let Some(window) = inner.windows.get_mut(&client).filter(|it| it.page == name && it.close.is_none()) else {
            return false;
        };
        if window.out.len() >= MOST_OUT || window.out_bytes + text.len() > MOST_OUT_BYTES {
            inner.counts.skipped += 1;
            return false;
        }
        window.out_bytes += text.len();
        window.out.push_back(Out::Text(Arc::from(text)));
        drop(inner);
        self.wake();
        true
    }

    /// Bytes for a window, each in the place of what waits there under the same topic.
    pub(crate) fn send_latest(&self, name: &str, client: Client, messages: Vec<(u64, Vec<u8>)>) -> bool {
        let mut inner = self.lock();
        let Some(window) = inner.windows.get_mut(&client).filter(|it| it.page == name && it.close.is_none()) else {
            return false;
        };
        let n_skipped = messages.into_iter().filter_map(|(topic, bytes)| window.put(topic, bytes)).count() as u64;
        inner.counts.skipped += n_skipped;
        drop(inner);
        self.wake();
        n_skipped == 0
    }

    pub(crate) fn greet(&self, name: &str, number: u64, text: &str) {
        if let Some(entry) = self.lock().pages.get_mut(name).filter(|it| it.number == number) {
            entry.greeting = Some(Arc::from(text));
        }
    }

    // The thread's side.

    /// Names and instances of all pages.
    pub(crate) fn pages(&self) -> Vec<(String, String)> {
        self.lock().pages.iter().map(|(name, it)| (name.clone(), it.instance.clone())).collect()
    }

    pub(crate) fn html(&self, name: &str) -> Option<&'static str> {
        self.lock().pages.get(name).map(|it| it.page.html)
    }

    /// A file of a page, made now, without holding anything.
    pub(crate) fn file(&self, name: &str, file: &str) -> Option<Result<PageFile, String>> {
        let page = Arc::clone(&self.lock().pages.get(name)?.page);
        foveate_node::guard::guarded(|| (page.files)(file)).transpose()
    }

    /// A window has opened page `name`.
    pub(crate) fn opened(&self, name: &str) -> Option<Client> {
        let arrival = self.now();
        let mut guard = self.lock();
        let inner = &mut *guard;
        let entry = inner.pages.get_mut(name)?;
        inner.n_windows += 1;
        inner.counts.windows += 1;
        let client = Client(inner.n_windows);
        let out: VecDeque<_> = entry.greeting.iter().cloned().map(Out::Text).collect();
        let out_bytes = out.iter().map(Out::len).sum();
        inner.windows.insert(client, Window { page: name.to_owned(), n_in: 0, out, out_bytes, close: None });
        if entry.is_held {
            entry.events.push_back(PageEvent { client, arrival, what: PageNews::Opened });
        }
        Some(client)
    }

    /// A window has sent `text`.
    pub(crate) fn heard(&self, client: Client, text: String) {
        let arrival = self.now();
        let mut guard = self.lock();
        let inner = &mut *guard;
        let Some(window) = inner.windows.get_mut(&client) else { return };
        let Some(entry) = inner.pages.get_mut(&window.page).filter(|it| it.is_held) else { return };
        if window.n_in >= MOST_IN {
            inner.counts.dropped += 1;
            return;
        }
        window.n_in += 1;
        entry.events.push_back(PageEvent { client, arrival, what: PageNews::Text(text) });
    }

    /// A window is closed.
    pub(crate) fn closed(&self, client: Client, why: String) {
        let arrival = self.now();
        let mut guard = self.lock();
        let inner = &mut *guard;
        let Some(window) = inner.windows.remove(&client) else { return };
        let Some(entry) = inner.pages.get_mut(&window.page).filter(|it| it.is_held) else { return };
        // Who opens and closes for ever leaves nothing behind.
        let is_known = !entry.events.iter().any(|it| it.client == client && it.what == PageNews::Opened);
        if is_known {
            entry.events.push_back(PageEvent { client, arrival, what: PageNews::Closed(why) });
        } else {
            entry.events.retain(|it| it.client != client);
        }
    }

    /// What is to be sent to a window next.
    pub(crate) fn next_out(&self, client: Client) -> Option<Out> {
        let mut inner = self.lock();
        let window = inner.windows.get_mut(&client)?;
        let next = window.out.pop_front()?;
        window.out_bytes -= next.len();
        Some(next)
    }

    /// Why a window is to be closed, if it is.
    pub(crate) fn must_close(&self, client: Client) -> Option<&'static str> {
        self.lock().windows.get(&client)?.close
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> Page {
        Page { html: "<p>", files: Arc::new(|name| (name == "boom").then(|| panic!("no such luck"))) }
    }

    #[test]
    fn queues_are_bounded_both_ways_and_what_is_lost_is_counted() {
        let board = Board::new();
        let number = board.open("a", "room.a", page()).unwrap();
        let client = board.opened("a").unwrap();
        assert_eq!(board.take("a", number).unwrap().what, PageNews::Opened);
        for n in 0..MOST_IN + 7 {
            board.heard(client, n.to_string());
        }
        assert_eq!(board.counts().dropped, 7);
        assert_eq!(board.take("a", number).unwrap().what, PageNews::Text("0".to_owned()));
        board.heard(client, "again".to_owned());
        assert_eq!(board.counts().dropped, 7, "there is room for one");
        let sent = (0..MOST_OUT + 3).filter(|_| board.send("a", client, "x")).count();
        assert_eq!((sent, board.counts().skipped), (MOST_OUT, 3));
        let big = "x".repeat(MOST_OUT_BYTES);
        assert!(board.next_out(client).is_some() && !board.send("a", client, &big), "bytes count, too");
    }

    #[test]
    fn a_window_that_reads_slowly_gets_the_newest_bytes_of_each_topic() {
        let board = Board::new();
        board.open("a", "room.a", page()).unwrap();
        let client = board.opened("a").unwrap();
        for n in 0..3_u8 {
            assert!(board.send_latest("a", client, vec![(7, vec![n; 1000]), (8, vec![n])]));
        }
        let taken: Vec<_> = std::iter::from_fn(|| board.next_out(client)).collect();
        assert!(matches!(&taken[..], [Out::Latest(7, a), Out::Latest(8, b)] if a[..] == [2; 1000] && b[..] == [2]));
        assert_eq!(board.counts().skipped, 0);
        // One large picture is taken, and a second one beside it is not.
        let large = vec![0; MOST_OUT_BYTES + 1];
        assert!(
            board.send_latest("a", client, vec![(1, large.clone())])
                && board.send_latest("a", client, vec![(1, large.clone())])
        );
        assert!(!board.send_latest("a", client, vec![(2, large)]) && board.counts().skipped == 1);
        assert!(board.next_out(client).is_some() && board.next_out(client).is_none());
        assert!(!board.send_latest("b", client, vec![(1, vec![0])]), "another page's window");
    }

    #[test]
    fn who_opens_and_closes_for_ever_leaves_nothing_behind() {
        let board = Board::new();
        let number = board.open("a", "room.a", page()).unwrap();
        for _ in 0..1000 {
            let client = board.opened("a").unwrap();
            board.heard(client, "hello".to_owned());
            board.closed(client, "gone".to_owned());
        }
        assert_eq!(board.take("a", number), None);
        let client = board.opened("a").unwrap();
        assert_eq!(board.take("a", number).unwrap().what, PageNews::Opened);
        board.closed(client, "gone".to_owned());
        assert_eq!(board.take("a", number).unwrap().what, PageNews::Closed("gone".to_owned()));
        assert!(!board.send("a", client, "x"), "a closed window gets nothing");
    }

    #[test]
    fn a_page_of_another_node_is_not_written_over_and_ones_own_is() {
        let board = Board::new();
        let first = board.open("a", "room.a", page()).unwrap();
        let client = board.opened("a").unwrap();
        assert!(board.open("a", "hall.a", page()).unwrap_err().contains("`/a/` of `room.a`"));
        let second = board.open("a", "room.a", page()).unwrap();
        assert!(board.must_close(client).is_some() && board.take("a", first).is_none());
        board.leave("a", first);
        board.opened("a").unwrap();
        assert!(board.take("a", second).is_some(), "the first one's end is not the second one's");
    }

    #[test]
    fn a_file_that_fails_is_told_and_the_greeting_stays() {
        let board = Board::new();
        let number = board.open("a", "room.a", page()).unwrap();
        assert!(board.file("a", "boom").unwrap().unwrap_err().contains("no such luck"));
        assert!(board.file("a", "other").is_none() && board.file("b", "boom").is_none());
        board.greet("a", number, "over");
        board.leave("a", number);
        let client = board.opened("a").unwrap();
        board.heard(client, "anybody there?".to_owned());
        assert!(matches!(board.next_out(client), Some(Out::Text(text)) if &*text == "over"));
        assert_eq!(board.counts().dropped, 0);
    }
}
