//! What the figures of `export.pictures` show: paths in space, positions and cameras over time.
//!
//! | module | what it draws |
//! |---|---|
//! | `space` | paths from above and from the side, to scale |
//! | `time` | position over time |
//! | `cameras` | cameras over time |

pub(crate) mod cameras;
pub(crate) mod space;
pub(crate) mod time;

use foveate::geometry::Camera;
use foveate::plot::colours::{COLOURS, OTHERS, PAPER, REFERENCE};
use foveate::plot::svg::Pen;
use foveate::prelude::TargetId;

use crate::track_history::{History, Track};

/// Colour of everything but targets.
pub(crate) const INK: &str = PAPER.ink;
/// Truth, behind all else.
pub(crate) const TRUTH: Pen<'static> = Pen::new(REFERENCE, 2.6);
/// Width of a measured stretch [px].
pub(crate) const MEASURED: f64 = 1.4;
/// Dashes of a predicted stretch.
pub(crate) const PREDICTED: &str = "3 2.4";

/// Everything that the figures show.
pub(crate) struct Subject<'a> {
    /// The scale's name.
    pub(crate) name: &'a str,
    /// Unit of length as axes write it.
    pub(crate) unit: &'a str,
    pub(crate) cameras: Vec<(&'a str, &'a Camera)>,
    /// Opposite corners of the working volume.
    pub(crate) volume: Option<[[f64; 3]; 2]>,
    /// The longest ones, ascending by identity, each with a colour of its own.
    pub(crate) tracks: Vec<Coloured<'a>>,
    /// All others.
    pub(crate) others: Vec<Coloured<'a>>,
    /// Tracks that were dropped to limit memory.
    pub(crate) n_left_out: u64,
    pub(crate) truth: Vec<&'a Track>,
}

/// A track and the colour in which it is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Coloured<'a> {
    pub(crate) id: TargetId,
    pub(crate) colour: &'static str,
    pub(crate) track: &'a Track,
}

impl<'a> Subject<'a> {
    /// Picks the longest tracks of `history` for colours of their own.
    pub(crate) fn with_tracks(mut self, history: &'a History, truth: &'a History) -> Self {
        let mut all: Vec<Coloured<'a>> = history
            .tracks
            .iter()
            .filter(|(_, track)| track.samples.len() > 1)
            .map(|(&id, track)| Coloured { id, colour: OTHERS, track })
            .collect();
        let duration = |it: &Coloured<'_>| match (it.track.samples.first(), it.track.samples.last()) {
            (Some(first), Some(last)) => last.time_s - first.time_s,
            _ => 0.0,
        };
        all.sort_by(|a, b| duration(b).total_cmp(&duration(a)).then(a.id.cmp(&b.id)));
        self.others = all.split_off(all.len().min(COLOURS.len()));
        all.sort_by_key(|it| it.id);
        all.iter_mut().zip(COLOURS).for_each(|(it, colour)| it.colour = colour);
        self.tracks = all;
        self.n_left_out = history.n_left_out;
        self.truth = truth.tracks.values().filter(|it| it.samples.len() > 1).collect();
        self
    }

    /// Tracks without a colour of their own first, so that the others are drawn over them.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Coloured<'a>> {
        self.others.iter().chain(&self.tracks)
    }
}
