//! Sessions survive what happens to files: kills, power cuts, flipped bits, lengths that lie, readers of others.

mod changes;
mod damage;
mod kills;
mod lengths;
mod mutations;
mod parts;
mod readers;
