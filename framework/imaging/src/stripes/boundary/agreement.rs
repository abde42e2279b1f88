//! What known tracks say of a picture: which of the four it is, or that it is none of them.
//!
//! A boundary that is known looks as its code says in the picture that is shown. Of neighbouring pictures of the code it looks otherwise, but for boundaries that look alike in both: of a wrong one two in five
//! fit all the same, and of a right one not all do where things move fast. So the test is not how many fit, but how many more fit one picture than any other: where tracks lie on the wrong edges, as after a cut or a jump, all
//! four fit about alike.

use super::design::{BoundaryCode, FRAMES};
use super::detect::Edges;
use super::track::{Tracker, look_of};

/// Known tracks from which on they say which picture is shown.
const LEAST_KNOWN: usize = 50;
/// A picture is the expected one if so many more of the known tracks fit it than any other, of all of them: in recordings of a renderer 0.24 and more did where tracks were right, 0.12 at most where they had been
/// given to wrong edges [–] …
const CLEARER: f64 = 0.05;
/// … and another one if so many more do [–] …
const OTHER: f64 = 0.15;
/// … where few tracks tell it, by so many standard deviations of their number more [–].
const SIGMAS: f64 = 1.0;
/// No picture is the one that is shown where fewer fit it, of all known tracks [–].
const LEAST: f64 = 0.4;

/// How known tracks agree with a picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// Known tracks that could be compared.
    pub n: usize,
    /// By picture of the code: how many of them look as they would in it.
    pub fits: [usize; FRAMES],
}

/// Which picture of the code is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shows {
    /// The expected one, or too few tracks are known to say otherwise.
    AsTold,
    /// Another one.
    Instead(usize),
    /// Known tracks agree on no picture: they are not where they were predicted.
    Unclear,
}

impl Shows {
    /// The picture that is shown, where `told` was expected; `None` where that is unclear.
    pub fn picture(self, told: usize) -> Option<usize> {
        match self {
            Shows::AsTold => Some(told % FRAMES),
            Shows::Instead(picture) => Some(picture),
            Shows::Unclear => None,
        }
    }
}

impl Agreement {
    /// Which picture is shown, where `told` was expected.
    pub fn shows(&self, told: usize) -> Shows {
        if self.n < LEAST_KNOWN {
            return Shows::AsTold;
        }
        let told = told % FRAMES;
        let share = |frame: usize| self.fits[frame] as f64 / self.n as f64;
        // Of those that are alike, the one that was told.
        let best = (0..FRAMES).max_by_key(|it| (self.fits[*it], *it == told)).unwrap_or(told);
        let second = (0..FRAMES).filter(|it| *it != best).map(share).fold(0.0, f64::max);
        let needed = if best == told { CLEARER } else { OTHER } + SIGMAS / (self.n as f64).sqrt();
        match share(best) >= LEAST && share(best) - second >= needed {
            true if best == told => Shows::AsTold,
            true => Shows::Instead(best),
            false => Shows::Unclear,
        }
    }
}

impl Tracker {
    /// How the edges of a picture agree with what tracks that are known look like in each picture of the code; between [`Self::predict`] and [`Self::update`].
    pub fn agreement(&self, edges: &Edges) -> Agreement {
        let code = BoundaryCode::get();
        let reach = self.options().known_reach * self.options().pitch;
        let mut found = Agreement::default();
        for (tracks, edges) in self.rows().iter().zip(&edges.rows) {
            for track in tracks {
                let Some(number) = track.number() else { continue };
                let after = edges.partition_point(|it| it.x < track.now.x);
                let near = edges[after.saturating_sub(1)..(after + 1).min(edges.len())].iter();
                let near = near.filter(|it| (it.x - track.now.x).abs() <= reach);
                let nearest = near.min_by(|a, b| (a.x - track.now.x).abs().total_cmp(&(b.x - track.now.x).abs()));
                let look = nearest.map(look_of);
                found.n += 1;
                for (frame, fits) in found.fits.iter_mut().enumerate() {
                    let expected = code.look(number, frame);
                    *fits += usize::from(look.map_or(!expected.shows(), |it| it == expected));
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shows(n: usize, fits: [usize; FRAMES], told: usize) -> Shows {
        Agreement { n, fits }.shows(told)
    }

    #[test]
    fn a_picture_is_told_by_how_many_more_fit_it_than_any_other() {
        // All are right, and where things move fast two in three.
        assert_eq!(shows(3000, [2950, 160, 1300, 150], 4), Shows::AsTold);
        assert_eq!(shows(4037, [2774, 914, 1681, 768], 0), Shows::AsTold);
        assert_eq!(shows(4037, [2774, 914, 1681, 768], 2), Shows::Instead(0));
        assert_eq!(Shows::Instead(0).picture(2), Some(0));
        assert_eq!(Shows::AsTold.picture(7), Some(3));
    }

    #[test]
    fn tracks_on_wrong_edges_agree_on_no_picture() {
        assert_eq!(shows(2913, [820, 936, 1039, 928], 2), Shows::Unclear);
        assert_eq!(shows(3469, [1883, 809, 2116, 523], 0), Shows::Unclear);
        assert_eq!(shows(60, [30, 10, 24, 10], 0), Shows::Unclear);
        assert_eq!(Shows::Unclear.picture(1), None);
    }

    #[test]
    fn few_tracks_say_nothing() {
        assert_eq!(shows(LEAST_KNOWN - 1, [0, 40, 0, 0], 0), Shows::AsTold);
    }
}
