//! The previous and the present picture, and the search of one track in the present one.

use foveate::imaging::{Dot, DotFinder, ImageView, ImagingError, LucasKanade, Pyramid, Stabiliser, Template};
use nalgebra::{Point2, Vector2};

use super::settings::TrackerSettings;
use super::track::{Found, Track};

/// Largest distance between the centre of a dot and the place where its patch was found [px].
const DOT_PX: f64 = 1.5;
/// Smallest remaining contrast of a dot, and bounds of its area, as parts of the usual values.
const CONTRAST_KEPT: f64 = 0.5;
const AREA_KEPT: [f64; 2] = [0.5, 2.0];
/// Part of the required correlation that suffices for the older reference patch.
const REFERENCE_PART: f64 = 0.8;

/// Two pictures and their search structures.
pub(super) struct Eye {
    pub flow: LucasKanade,
    pub finder: DotFinder,
    stabiliser: Option<Stabiliser>,
    pub previous: Pyramid,
    pub current: Pyramid,
    /// The patch for the backward search.
    back: Template,
}

impl Eye {
    pub fn new(settings: &TrackerSettings) -> Result<Self, ImagingError> {
        let stabiliser = (settings.reach_px > 0).then(|| Stabiliser::new(settings.stabiliser()));
        Ok(Self {
            flow: LucasKanade::new(settings.flow())?,
            finder: DotFinder::new(settings.dots())?,
            stabiliser: stabiliser.transpose()?,
            previous: Pyramid::default(),
            current: Pyramid::default(),
            back: Template::default(),
        })
    }

    /// Takes the next picture; the present one becomes the one before.
    pub fn take(&mut self, view: &ImageView<'_>, levels: usize) {
        std::mem::swap(&mut self.previous, &mut self.current);
        self.current.build(view, levels);
    }

    /// Dominant motion since the picture before; zero where it cannot be estimated.
    pub fn dominant_motion(&mut self) -> Vector2<f64> {
        let shift = self.stabiliser.as_mut().and_then(|it| it.shift(&self.previous, &self.current));
        shift.map_or(Vector2::zeros(), |it| it.translation)
    }

    /// The dot at `pixel` of the present picture.
    pub fn dot(&self, pixel: Point2<f64>, reach_px: f64) -> Option<Dot> {
        self.finder.measure(&self.current.level(0), pixel, reach_px)
    }

    /// Searches `track` near `guess`; `shift` is the dominant motion.
    pub fn look(
        &mut self,
        settings: &TrackerSettings,
        track: &Track,
        guess: Point2<f64>,
        shift: Vector2<f64>,
    ) -> Option<Found> {
        let flow = self.flow.find(&track.template, &self.current, guess).ok()?;
        let wants_dot = settings.checks || settings.reanchor;
        let dot = track.look.filter(|_| wants_dot).and_then(|look| {
            let dot = self.dot(flow.pixel, DOT_PX)?;
            let area = f64::from(dot.area) / look[1];
            (dot.contrast >= CONTRAST_KEPT * look[0] && (AREA_KEPT[0]..=AREA_KEPT[1]).contains(&area)).then_some(dot)
        });
        if settings.checks {
            let is_like_before = flow.correlation >= settings.min_correlation
                && (track.look.is_none() || dot.is_some())
                && (!track.has_reference || self.is_like_reference(settings, track, flow.pixel))
                // The patch of a track that was lost is not of the picture before.
                && (!track.is_seen() || self.comes_back(settings, track, flow.pixel, shift));
            if !is_like_before {
                return None;
            }
        }
        let mut found = Found { pixel: flow.pixel, covariance: track.covariance + flow.covariance, dot };
        if settings.reanchor {
            if let Some(dot) = dot {
                (found.pixel, found.covariance) = (dot.centre, dot.covariance);
            } else if track.has_reference
                && let Ok(anchor) = self.flow.find_from(&track.reference, &self.current, flow.pixel, 1)
                && anchor.correlation >= settings.min_correlation
                && (anchor.pixel - flow.pixel).norm() <= DOT_PX
            {
                found.pixel = anchor.pixel;
                found.covariance = track.reference_covariance + anchor.covariance;
            }
        }
        Some(found)
    }

    fn is_like_reference(&mut self, settings: &TrackerSettings, track: &Track, pixel: Point2<f64>) -> bool {
        let correlation = self.flow.correlation(&track.reference, &self.current, pixel);
        correlation >= REFERENCE_PART * settings.min_correlation
    }

    /// Whether a backward search from `pixel` leads back to the track.
    fn comes_back(
        &mut self,
        settings: &TrackerSettings,
        track: &Track,
        pixel: Point2<f64>,
        shift: Vector2<f64>,
    ) -> bool {
        if self.flow.learn(&self.current, pixel, &mut self.back).is_err() {
            return false;
        }
        let back = self.flow.find(&self.back, &self.previous, pixel - shift);
        back.is_ok_and(|it| (it.pixel - track.pixel).norm() <= settings.back_px)
    }
}
