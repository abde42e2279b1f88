//! Tracks and edges of a row, which stand in the same order, matched in order: the matching of least cost, found by dynamic programming, and what it says of each track.

use super::super::design::{BoundaryCode, FRAMES, Look};
use super::super::detect::Edge;
use super::super::sliding::{Profile, left_of, profile};
use super::{PROVEN, Place, Track, TrackOptions, look_of, wide_here};

/// How much farther a track may be from its predicted place on a surface that goes a stripe on from picture to picture: one that was seen twice or three times, whose velocity has hardly been borne out [–] …
const YOUNG: f32 = 0.75;
/// … and one for each picture that it was not seen in [–].
const UNSEEN: f32 = 0.5;
/// Cost of an edge without a track.
const NEW: f32 = 3.0;
/// Cost of a track that is not seen and may be a ghost.
const MAYBE_GHOST: f32 = 2.5;
/// Cost of a track that should be seen and is not.
const MISSED: f32 = 6.0;
/// Two pictures without it, where it should be seen, end a track that is known.
const MAX_MISSED: u32 = 2;
/// A boundary shows in every other picture; a missed one in three.
const MAX_UNSEEN: u32 = 3;
/// How much of what a track is off goes into its velocity.
const GAIN: f32 = 0.6;
/// On both sides of a ghost there are boundaries that show, no farther than so many stripes; slanted surfaces make stripes wider.
const GAP: f32 = 6.0;

/// What was chosen for a track and an edge in a table of partial matchings.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Choice {
    Match,
    SkipTrack,
    SkipEdge,
}

/// Matches the tracks of a row with its edges.
#[derive(Default)]
pub(super) struct Matcher {
    costs: Vec<f32>,
    choices: Vec<Choice>,
    /// How far the surface goes through the stripes from picture to picture, one at most [stripes].
    lively: f32,
    /// By track: its edge.
    edge_of: Vec<Option<usize>>,
    is_taken: Vec<bool>,
    /// Boundaries of the row that are known, at their predicted places.
    profile: Profile,
    new: Vec<Track>,
}

impl Matcher {
    /// Of a surface that goes so far through the stripes from picture to picture, one at most [stripes].
    pub(super) fn new(lively: f32) -> Matcher {
        Matcher { lively, ..Matcher::default() }
    }

    /// Matches the tracks of a row with its edges, which are of picture `frame` of the code.
    pub(super) fn row(&mut self, tracks: &mut Vec<Track>, edges: &[Edge], frame: usize, options: &TrackOptions) {
        self.assign(tracks, edges, frame, options);
        let code = BoundaryCode::get();
        for (track, edge) in tracks.iter_mut().zip(&self.edge_of) {
            match edge {
                Some(at) => see(track, &edges[*at], frame),
                None => {
                    // An edge of the wrong look that no other track wants, right where a ghost is: it is no ghost.
                    let reach = options.known_reach * options.pitch;
                    let is_near = |it: &Edge| (it.x - track.now.x).abs() <= reach;
                    let mut free = edges.iter().zip(&self.is_taken).filter(|it| !it.1);
                    let is_contradicted = track.number().is_some() && free.any(|it| is_near(it.0));
                    track.unseen += 1;
                    let level = level(edges, track.now.x, options.pitch);
                    track.light([level == Some(true) && !is_contradicted; 2]);
                    let hidden = match level {
                        Some(is_lit) => code.that_look(if is_lit { Look::Lit } else { Look::Dark }, frame),
                        None => code.hidden(frame),
                    };
                    let left = track.possible & hidden;
                    if left != 0 && !is_contradicted {
                        // Where its sides are not known a ghost says little: it counts for nothing until its boundary is known.
                        let is_certain = track.number().is_some() || hidden != code.hidden(frame);
                        track.run += u32::from(is_certain);
                        track.possible = left;
                        track.missed = 0;
                        track.owed &= !bit(frame);
                    } else {
                        miss(track, frame);
                    }
                }
            }
        }
        self.new.clear();
        for (edge, is_taken) in edges.iter().zip(&self.is_taken) {
            if !is_taken {
                let near = nearest_velocity(tracks, edge.x, 3.0 * options.pitch);
                self.new.push(begin(edge, near, frame));
            }
        }
        tracks.retain(|it| it.missed < MAX_MISSED && it.unseen <= MAX_UNSEEN && it.now.x.is_finite());
        tracks.append(&mut self.new);
        tracks.sort_by(|a, b| a.now.x.total_cmp(&b.now.x));
    }

    /// The matching of least cost that keeps the order.
    fn assign(&mut self, tracks: &[Track], edges: &[Edge], frame: usize, options: &TrackOptions) {
        let code = BoundaryCode::get();
        let (n, m) = (tracks.len(), edges.len());
        self.edge_of.clear();
        self.edge_of.resize(n, None);
        self.is_taken.clear();
        self.is_taken.resize(m, false);
        if n == 0 || m == 0 {
            return;
        }
        let masks = [Look::Rising, Look::Falling].map(|it| code.that_look(it, frame));
        let hidden = code.hidden(frame);
        let wide = m + 1;
        self.costs.clear();
        self.costs.resize((n + 1) * wide, 0.0);
        self.choices.clear();
        self.choices.resize((n + 1) * wide, Choice::SkipEdge);
        for j in 1..=m {
            self.costs[j] = j as f32 * NEW;
        }
        // Edges outside of a track's reach cannot be matched with it: their columns of the table only pass costs on.
        self.profile = profile(tracks);
        let mut near = 0;
        for (i, track) in tracks.iter().enumerate() {
            let skip = match (track.possible & hidden, track.possible & !hidden) {
                (0, _) => MISSED,
                (_, 0) => 0.0,
                _ => MAYBE_GHOST,
            };
            // Only the second picture may find a track far from where it is foretold: it says how fast it is.
            let reach = match track.seen {
                0 | 1 => options.new_reach,
                2 | 3 => options.known_reach * (1.0 + YOUNG * self.lively),
                _ => options.known_reach,
            };
            let reach = (reach * (1.0 + UNSEEN * self.lively * track.unseen as f32)).min(options.new_reach);
            near = left_of(&self.profile, near, track.now.x);
            let reach = reach * wide_here(&self.profile, near, track.now.x, options.pitch);
            let scale = 0.5 * reach;
            let (above, row) = self.costs[i * wide..].split_at_mut(wide);
            let choices = &mut self.choices[(i + 1) * wide..(i + 2) * wide];
            row[0] = above[0] + skip;
            choices[0] = Choice::SkipTrack;
            for (j, edge) in edges.iter().enumerate() {
                let mut best = (above[j + 1] + skip, Choice::SkipTrack);
                let without = row[j] + NEW;
                if without < best.0 {
                    best = (without, Choice::SkipEdge);
                }
                let off = (edge.x - track.now.x).abs();
                if off <= reach && track.possible & masks[usize::from(!edge.is_rising)] != 0 {
                    let with = above[j] + (off / scale).powi(2);
                    if with < best.0 {
                        best = (with, Choice::Match);
                    }
                }
                (row[j + 1], choices[j + 1]) = best;
            }
        }
        let (mut i, mut j) = (n, m);
        while i > 0 || j > 0 {
            match if i == 0 { Choice::SkipEdge } else { self.choices[i * wide + j] } {
                Choice::Match => {
                    (i, j) = (i - 1, j - 1);
                    self.edge_of[i] = Some(j);
                    self.is_taken[j] = true;
                }
                Choice::SkipTrack => i -= 1,
                Choice::SkipEdge => j -= 1,
            }
        }
    }
}

/// A track that begins.
pub(super) fn begin(edge: &Edge, velocity: f32, frame: usize) -> Track {
    Track {
        now: Place { x: edge.x, sigma: edge.sigma, is_seen: true, shift: 0.0 },
        before: None,
        earlier: None,
        velocity,
        possible: BoundaryCode::get().that_look(look_of(edge), frame),
        run: 1,
        seen: 1,
        unseen: 0,
        missed: 0,
        owed: 0,
        since_lit: [edge.is_rising, !edge.is_rising].map(|is_dark| if is_dark { u8::MAX } else { 0 }),
    }
}

/// A track is seen where `edge` is.
pub(super) fn see(track: &mut Track, edge: &Edge, frame: usize) {
    let since = (track.unseen + 1) as f32;
    let gain = if track.seen > 1 { GAIN } else { 1.0 };
    track.velocity += gain * (edge.x - track.now.x) / since;
    track.seen += 1;
    track.now = Place { x: edge.x, sigma: edge.sigma, is_seen: true, ..track.now };
    track.possible &= BoundaryCode::get().that_look(look_of(edge), frame);
    track.light([!edge.is_rising, edge.is_rising]);
    track.run += 1;
    track.owed &= !bit(frame);
    (track.unseen, track.missed) = (0, 0);
}

fn bit(frame: usize) -> u8 {
    1 << (frame % FRAMES)
}

/// A track should be seen and is not.
fn miss(track: &mut Track, frame: usize) {
    track.missed += 1;
    if track.number().is_none() || track.run < PROVEN || track.owed & bit(frame) != 0 {
        track.missed = MAX_MISSED;
    }
    track.owed |= bit(frame);
}

/// Velocity of the nearest track that has been seen twice at least, within `reach`; 0 without one [px a picture].
fn nearest_velocity(tracks: &[Track], x: f32, reach: f32) -> f32 {
    let after = tracks.partition_point(|it| it.now.x < x);
    let near = tracks[after.saturating_sub(3)..(after + 3).min(tracks.len())].iter();
    near.filter(|it| it.seen >= 3 && (it.now.x - x).abs() <= reach)
        .min_by(|a, b| (a.now.x - x).abs().total_cmp(&(b.now.x - x).abs()))
        .map_or(0.0, |it| it.velocity)
}

/// Whether column `x` is lit, by the edges on both sides of it; `None` where they do not say or contradict one another.
fn level(edges: &[Edge], x: f32, pitch: f32) -> Option<bool> {
    let after = edges.partition_point(|it| it.x < x);
    let is_near = |it: &&Edge| (it.x - x).abs() <= GAP * pitch;
    let left = after.checked_sub(1).map(|it| &edges[it]).filter(is_near);
    let right = edges.get(after).filter(is_near);
    match (left.map(|it| it.is_rising), right.map(|it| !it.is_rising)) {
        (Some(a), Some(b)) => (a == b).then_some(a),
        (one, other) => one.or(other),
    }
}
