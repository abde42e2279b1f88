//! Remarks at the end of a run on how clouds were joined.

use std::fmt;
use std::sync::Arc;

use foveate::estimation::statistics::median;
use foveate::prelude::*;

use super::super::apart::Beside;
use super::{DOUBTS, JoinedSurface, Placed};

/// A remark names so many surfaces that were given up.
const NAMED: usize = 3;

/// A cloud that was nearly refused is named where its residuals are more than twice what the other clouds have in the median, or, of fewer than three others, what errors of decoding make [–].
const FAR_FROM_OTHERS: f64 = 2.0;
const OF_DECODING: f64 = 3.0;

/// Clouds one after the other.
pub(super) struct Span {
    n: u64,
    first: String,
    last: String,
}

impl Span {
    /// Takes clouds in at the end.
    pub(super) fn extend(span: &mut Option<Span>, clouds: &[(Stamped<Arc<PointCloud>>, Placed)]) {
        let Some([first, last]) = clouds.first().zip(clouds.last()).map(|(a, b)| [a, b].map(|it| named(&it.0.value)))
        else {
            return;
        };
        let n = clouds.len() as u64;
        match span {
            Some(span) => (span.n, span.last) = (span.n + n, last),
            None => *span = Some(Span { n, first, last }),
        }
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Span { n: 1, first, .. } => f.write_str(first),
            Span { n, first, last } => write!(f, "{first} to {last} ({n} clouds)"),
        }
    }
}

/// A cloud by its name and time.
pub(super) fn named(cloud: &PointCloud) -> String {
    let name = if cloud.name.is_empty() { "a cloud" } else { &cloud.name };
    format!("{name} at {:.3} s", cloud.time.as_s())
}

impl JoinedSurface {
    /// What is said of clouds that contradict each other where they lie.
    pub(super) fn contradicting(&self) -> Option<String> {
        let (name, Beside { distance_m, stated_m, .. }) = self.worst.as_ref()?;
        let of = self.apart_mm.len();
        Some(format!(
            "{} of the {of} clouds that overlap clouds before them are displaced from these, by {:.2} mm (median): {name} by {:.2} mm, expected {:.2} mm from the stated uncertainty of the points. \
             There the surface has several layers or ends, and its sigmas include that. The poses of the cameras or of the target contradict each other: give better ones, or set `register = true`",
            self.contradicting_mm.len(),
            median(&self.contradicting_mm)?,
            1e3 * distance_m,
            1e3 * stated_m,
        ))
    }

    /// What the surface holds, where it was restarted.
    pub(super) fn begun_anew(&self) -> Option<String> {
        let often = match self.given_up.len() {
            0 => return None,
            1 => "once".to_owned(),
            n => format!("{n} times"),
        };
        let without: Vec<String> = self.given_up.iter().take(NAMED).map(Span::to_string).collect();
        let more = self.given_up.len().saturating_sub(NAMED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let holds = match &self.inside {
            Some(inside) => format!("it holds {inside}, in the space of the first of these"),
            None => "no cloud is in it".to_owned(),
        };
        Some(format!(
            "the surface was restarted {often}, since its first cloud fitted none of the {DOUBTS} after it. Not in it: {}{more}; {holds}. \
             Expected clouds that overlap (`min_overlap`), each turned from the one before by less than `start_sigma_deg` allows for; events.csv says why they were refused",
            without.join(", ")
        ))
    }

    /// What is said of clouds that fit far worse than the others.
    pub(super) fn nearly_refused(&self) -> Option<String> {
        let others = median(&self.misfits).filter(|_| self.misfits.len() > 3);
        let as_what = if others.is_some() { "for the other clouds" } else { "with errors of decoding" };
        let others = others.unwrap_or(OF_DECODING);
        let far = || self.doubtful.iter().filter(|it| it.1 > FAR_FROM_OTHERS * others);
        let (name, misfit) = far().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let more = match far().count() - 1 {
            0 => String::new(),
            n => format!(" (and {n} more, by less)"),
        };
        let limit = self.settings.max_misfit;
        Some(format!(
            "{name}{more} is in the surface with residuals {misfit:.1} times as large as its sigmas, expected about {others:.1} times, as {as_what}: it may be misplaced, or something moved relative to the rest. \
             A `max_misfit` below {misfit:.1} ({limit} now) refuses it"
        ))
    }
}
