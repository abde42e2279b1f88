//! The one web server of the program: pages of nodes, files for them, messages both ways over a WebSocket.
//!
//! | module | what it holds |
//! |---|---|
//! | [`listen`] | where to listen, and the token that it takes from elsewhere |
//! | [`server`] | the server as a run sees it: a page for each node that puts one up; counts; the end |
//! | `admission` | which requests are accepted: `Host`, `Origin`, token |
//! | `http` | a request read, an answer written |
//! | `board` | what the server's thread and the nodes share: pages, their events, what is to be sent |
//! | `connection` | one connection, from its request to the end of its socket |
//! | `turns` | the server's thread: one, for all connections, none of which it ever waits for |
//!
//! Without another address the server listens on this machine's loopback alone. Every limit is a constant with its reason; what is refused, skipped or
//! dropped is counted and reported at the end of the run ([`Counts`]).

mod admission;
mod board;
mod connection;
mod http;
pub mod listen;
pub mod server;
mod turns;

pub use board::Counts;
pub use listen::Listen;
pub use server::Server;
