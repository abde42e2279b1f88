//! New tracks get their numbers from known ones around them.
//!
//! Four pictures say which boundary a track is. On a surface that is known around it, the rows above and below and the neighbours in the row say it at once, and one look decides whether they are right:
//! neighbours look different from a boundary in each picture. So what a moving surface brings into the light is known as fast as it comes, from the known part on.
//!
//! What one neighbour in the row says counts where those of rows above and below say the same, and only of what was seen twice, with one picture more that confirms it: another surface may begin there.
//!
//! Whether that was right the pictures that follow say, as of any track.

use super::design::BoundaryCode;
use super::track::{Track, widths};

/// Rows above and below that say which boundary a new track is …
const ROWS: usize = 2;
/// … where one of theirs is no farther off, in stripes for each row …
const REACH: f32 = 0.2;
/// … or the next in its row no nearer and no farther, in stripes …
const NEXT: std::ops::RangeInclusive<f32> = 0.4..=1.8;
/// … and so many of them say the same …
const LEAST: usize = 2;
/// … or so many where what one neighbour in the row says of tracks above and below is among it.
const LEAST_VAGUE: usize = 3;

/// Gives tracks numbers that known ones around them agree on, in picture `frame` of the code. `rows` ascend by column; `pitch` is from one stripe to the next [px]; `fast` says that the surface goes through the stripes fast.
pub(super) fn adopt(rows: &mut [Vec<Track>], pitch: f32, frame: usize, fast: bool) {
    let wide: Vec<Vec<f32>> = rows.iter().map(|row| widths(row, pitch)).collect();
    let mut adopted: Vec<(usize, usize, usize, bool)> = Vec::new();
    // By row: columns of tracks that were seen twice, and what known ones to their left or right say. At an upright border of what is known no row has more than that, and rows agree.
    let said: Vec<Vec<(f32, usize)>> = rows
        .iter()
        .zip(&wide)
        .map(|(row, wide)| {
            let open = row.iter().enumerate().filter(|it| it.1.is_open() && it.1.is_seen_twice());
            open.filter_map(|(at, it)| Some((it.now.x, numbers_beside(row, at, wide[at], frame, fast).next()?)))
                .collect()
        })
        .collect();
    for (y, row) in rows.iter().enumerate() {
        for (at, track) in row.iter().enumerate().filter(|it| it.1.is_open()) {
            let x = track.now.x;
            let beside = (y.saturating_sub(ROWS)..(y + ROWS + 1).min(rows.len())).filter(|it| *it != y);
            let beside = beside.map(|it| (it, REACH * wide[y][at] * it.abs_diff(y) as f32));
            let above_and_below = beside.clone().filter_map(|(it, reach)| number_at(&rows[it], x, reach, fast));
            let known = agreed(above_and_below.chain(numbers_beside(row, at, wide[y][at], frame, fast)));
            let vague =
                || beside.filter_map(|(it, reach)| said[it].iter().find(|it| (it.0 - x).abs() <= reach)).map(|it| it.1);
            let found = match known {
                Agreed::Not => None,
                Agreed::On(number, n) if n >= LEAST => Some((number, true)),
                Agreed::On(number, n) if track.is_seen_twice() => match agreed(vague()) {
                    Agreed::On(also, more) if also == number && n + more >= LEAST_VAGUE => Some((number, false)),
                    _ => None,
                },
                Agreed::On(..) => None,
            };
            adopted.extend(found.map(|(number, is_certain)| (y, at, number, is_certain)));
        }
    }
    for (y, at, number, is_certain) in adopted {
        rows[y][at].take_for(number, is_certain);
    }
}

/// The number of the nearest known track within `reach` [px].
fn number_at(row: &[Track], x: f32, reach: f32, fast: bool) -> Option<usize> {
    let first = row.partition_point(|it| it.now.x < x - reach);
    let near = row[first..].iter().take_while(|it| it.now.x <= x + reach).filter(|it| it.vouches(fast));
    near.min_by(|a, b| (a.now.x - x).abs().total_cmp(&(b.now.x - x).abs())).and_then(Track::number)
}

/// What the neighbours of a track in its row say of its number: that on its left, that on its right. Between them and the track there may be a boundary that does not show in picture `frame`.
fn numbers_beside(row: &[Track], at: usize, wide: f32, frame: usize, fast: bool) -> impl Iterator<Item = usize> {
    let n = BoundaryCode::get().len();
    // The nearest that is known or seen; of what is not seen and not known the picture says nothing.
    let says = |it: &&Track| it.now.is_seen || it.vouches(fast);
    let left = row[..at].iter().rev().find(says);
    let right = row[at + 1..].iter().find(says);
    let of = |other: Option<&Track>, step: usize| {
        let track = other.filter(|it| it.vouches(fast))?;
        let (from, away) = (track.number()?, (track.now.x - row[at].now.x).abs() / wide);
        // The next one, or the one after it where the next does not show.
        let next = (from + step) % n;
        let (number, steps) = match BoundaryCode::get().look(next, frame).shows() {
            true => (next, 1.0),
            false => ((next + step) % n, 2.0),
        };
        NEXT.contains(&(away / steps)).then_some(number)
    };
    [of(left, 1), of(right, n - 1)].into_iter().flatten()
}

/// What some say.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Agreed {
    /// Nothing, or not the same.
    Not,
    /// One number; how many say so.
    On(usize, usize),
}

fn agreed(mut said: impl Iterator<Item = usize>) -> Agreed {
    let Some(first) = said.next() else { return Agreed::Not };
    let mut n = 1;
    for it in said {
        if it != first {
            return Agreed::Not;
        }
        n += 1;
    }
    Agreed::On(first, n)
}

#[cfg(test)]
mod tests {
    use super::super::design::FRAMES;
    use super::super::detect::{DetectOptions, Edge, Edges, detect};
    use super::super::scene::Scene;
    use super::super::track::{TrackOptions, Tracker};
    use super::*;
    use crate::ImageView;

    /// Pictures until a scene at rest is known well.
    const KNOWN: usize = 16;

    /// Edges of a scene at rest, those that `hide` says left out.
    fn edges(scene: &Scene, picture: usize, hide: &dyn Fn(usize, &Edge) -> bool) -> Edges {
        let pixels = scene.picture(picture, picture % FRAMES);
        let view = ImageView::new(&pixels, scene.size[0], scene.size[1]).unwrap();
        let mut edges = detect(&view, &DetectOptions::default()).unwrap();
        for (y, row) in edges.rows.iter_mut().enumerate() {
            row.retain(|it| !hide(y, it));
        }
        edges
    }

    /// Known tracks in rows `stretch` and columns 200 to 280, the tracker having seen that part in the last `n` pictures only, and how many of them are true.
    fn known_after(n: usize, stretch: std::ops::Range<usize>) -> (usize, usize) {
        let scene = Scene::new(0.0, 0.0, 7);
        let mut tracker = Tracker::new(scene.size[1], TrackOptions::default()).unwrap();
        let part = |y: usize, x: f32| stretch.contains(&y) && (200.0..280.0).contains(&x);
        for picture in 0..KNOWN + n {
            let edges = edges(&scene, picture, &|y, it| picture < KNOWN && part(y, it.x));
            tracker.predict(1, &|_, _| [0.0; 2]);
            tracker.update(&edges, picture % FRAMES);
        }
        let code = BoundaryCode::get().len() as f64;
        let (mut n, mut n_true) = (0, 0);
        for (y, row) in tracker.rows().iter().enumerate() {
            for track in row.iter().filter(|it| part(y, it.now.x)) {
                let Some(number) = track.number() else { continue };
                let column = (scene.column(f64::from(track.now.x), y as f64, 0.0) + 0.5) / super::super::scene::STRIPE;
                let off = (column - number as f64 + code / 2.0).rem_euclid(code) - code / 2.0;
                n += 1;
                n_true += usize::from(off.abs() < 0.3);
            }
        }
        (n, n_true)
    }

    #[test]
    fn what_comes_into_sight_beside_what_is_known_is_known_at_once() {
        // A hole of three rows is closed from above and below in one picture, …
        let (n, n_true) = known_after(1, 20..23);
        assert!(n >= 10 && n_true * 100 >= 97 * n, "{n_true} of {n}");
        // … and one that is high and wide from its border on: four pictures would be needed without.
        let (n, n_true) = known_after(3, 10..38);
        assert!(n >= 60 && n_true * 100 >= 97 * n, "{n_true} of {n}");
    }

    #[test]
    fn neighbours_that_contradict_each_other_say_nothing() {
        assert_eq!(agreed([5, 5].into_iter()), Agreed::On(5, 2));
        assert_eq!(agreed([5, 5, 6].into_iter()), Agreed::Not);
        assert_eq!(agreed([].into_iter()), Agreed::Not);
    }
}
