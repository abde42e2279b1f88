//! What a simulated wall shows: windows that move, displays that shine and fade, red spots.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point2, Vector2};

use super::{RED, WallLight, WallSettings};
use crate::chance::stream;

const JUMPS: u64 = 20;
const WINDOWS: u64 = 21;
const TILES: u64 = 22;
/// How often a spot of the third that jumps does [s].
const JUMP_S: f64 = 0.7;

#[derive(Debug)]
pub(super) struct Contents {
    seed: u64,
    windows: Vec<Drifting>,
    window_size: Vector2<f64>,
    spots: Vec<Spot>,
    size: [f64; 2],
}

/// Something that moves to and fro.
#[derive(Debug)]
struct Drifting {
    middle: Point2<f64>,
    swing: Vector2<f64>,
    per_s: Vector2<f64>,
    phase: Vector2<f64>,
}

#[derive(Debug)]
struct Spot {
    moves: Moves,
    sigma: f64,
    peak: f64,
}

#[derive(Debug)]
enum Moves {
    Not(Point2<f64>),
    Drifts(Drifting),
    Jumps,
}

/// A bright rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window {
    /// Top left and bottom right corner [m].
    pub corners: [Point2<f64>; 2],
    /// What it reads in a camera of gain 1 [gray level].
    pub level: f64,
    /// What the planes of a colour camera read, relative to that.
    pub colour: [f64; 3],
}

impl Drifting {
    fn draw(size: [f64; 2], random: &mut Random) -> Drifting {
        let mut pair = |low: f64, high: f64| Vector2::new(random.uniform_in(low, high), random.uniform_in(low, high));
        let middle = pair(0.2, 0.8).component_mul(&Vector2::from(size));
        let swing = pair(0.05, 0.2).component_mul(&Vector2::from(size));
        Drifting { middle: Point2::from(middle), swing, per_s: pair(0.2, 1.2), phase: pair(0.0, TAU) }
    }

    fn at(&self, time_s: f64) -> Point2<f64> {
        self.middle + self.swing.zip_map(&(self.per_s * time_s + self.phase), |swing, angle| swing * angle.sin())
    }
}

impl Contents {
    pub fn new(settings: &WallSettings, size: [f64; 2], random: &Random) -> Contents {
        let mut random = random.fork("contents");
        let windows = (0..settings.windows).map(|_| Drifting::draw(size, &mut random)).collect();
        let spots = (0..settings.red_spots)
            .map(|number| {
                let moves = match number % 3 {
                    0 => Moves::Not(Point2::new(size[0] * random.uniform(), size[1] * random.uniform())),
                    1 => Moves::Drifts(Drifting::draw(size, &mut random)),
                    _ => Moves::Jumps,
                };
                let sigma = random.uniform_in(1.5e-3, 5e-3);
                Spot { moves, sigma, peak: settings.red_peak * random.uniform_in(0.6, 1.0) }
            })
            .collect();
        let window_size = Vector2::new(size[0] / 9.0, size[1] / 4.0);
        Contents { seed: random.next_u64(), windows, window_size, spots, size }
    }

    pub fn windows(&self, time_s: f64) -> impl Iterator<Item = Window> + '_ {
        self.windows.iter().zip(1_u32..).map(move |(it, number)| {
            let middle = it.at(time_s);
            // They shine as videos do.
            let level = 60.0 + 40.0 * (TAU * 0.7 * time_s * f64::from(number)).sin();
            let corners = [middle - self.window_size / 2.0, middle + self.window_size / 2.0];
            Window { corners, level, colour: self.colour(WINDOWS, i64::from(number)) }
        })
    }

    pub fn spots(&self, time_s: f64) -> impl Iterator<Item = (u32, WallLight)> + '_ {
        self.spots.iter().zip(0..).filter(move |_| time_s >= 0.0).map(move |(it, number)| {
            let point = match &it.moves {
                Moves::Not(point) => *point,
                Moves::Drifts(drifting) => drifting.at(time_s),
                Moves::Jumps => {
                    let jump = (time_s / JUMP_S).floor() as i64;
                    let mut random = stream(self.seed ^ u64::from(number), JUMPS, jump);
                    Point2::new(self.size[0] * random.uniform(), self.size[1] * random.uniform())
                }
            };
            (number, WallLight { point, sigma: it.sigma, peak: it.peak, colour: RED })
        })
    }

    pub fn tint(&self, [column, row]: [u32; 2]) -> [f64; 3] {
        self.colour(TILES, i64::from(column) + 1000 * i64::from(row))
    }

    /// A colour, pale or not: one plane is full, the others are drawn.
    fn colour(&self, of: u64, number: i64) -> [f64; 3] {
        let mut random = stream(self.seed, of, number);
        let full = random.below(3) as usize;
        std::array::from_fn(|plane| if plane == full { 1.0 } else { random.uniform_in(0.15, 1.0) })
    }

    pub fn shine(&self, [column, row]: [u32; 2], time_s: f64) -> f64 {
        let number = f64::from(column + 5 * row);
        0.7 + 0.3 * (TAU * (0.11 + 0.07 * number) * time_s + number).sin()
    }
}
