//! Laser pointers on a simulated wall.

mod drawing;
mod wall;
