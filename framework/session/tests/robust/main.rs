//! Sessions survive what happens to files: kills, power cuts, flipped bits, lengths that lie, readers of others.
//! What no edge carries is in `unwired`.

mod changes;
mod damage;
mod kills;
mod lengths;
mod mutations;
mod parts;
mod pictures;
mod readers;
mod unwired;
