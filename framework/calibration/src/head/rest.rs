//! Periods in which a head was at rest, from its reported positions.
//!
//! Two successive reports of one position mean that it stayed there: a head that gets a command does not come back before the next
//! report. What it carries may swing for a while after it stopped.

/// A position that a head reported.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionReport {
    /// The position was read after this moment … [s].
    pub earliest_s: f64,
    /// … and before this one [s].
    pub latest_s: f64,
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
}

/// A period in which a head was at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestPeriod {
    /// Start [s].
    pub from_s: f64,
    /// End, at the earliest [s].
    pub until_s: f64,
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
}

/// Reports further apart than this say nothing of what was between [s].
const LONGEST_GAP_S: f64 = 1.5;

/// The periods of rest in the order of time: all reports agree within `tolerance` [rad]. Each period is without its first `settle_s`
/// [s]. `reports` are in the order of time.
pub fn rest_periods(reports: &[PositionReport], tolerance: f64, settle_s: f64) -> Vec<RestPeriod> {
    let mut stands = Vec::new();
    let mut open: Option<RestPeriod> = None;
    let mut close = |stand: Option<RestPeriod>| stands.extend(stand.filter(|it| it.until_s > it.from_s));
    for report in reports {
        let same = |it: &RestPeriod| {
            let off = [0, 1].map(|axis| (it.angles[axis] - report.angles[axis]).abs());
            off[0].max(off[1]) <= tolerance && report.earliest_s - it.until_s <= LONGEST_GAP_S
        };
        match &mut open {
            Some(stand) if same(stand) => stand.until_s = stand.until_s.max(report.earliest_s),
            _ => {
                let from_s = report.latest_s + settle_s;
                // Nothing yet: the first report of a place ends where it begins.
                let begun = RestPeriod { from_s, until_s: report.earliest_s, angles: report.angles };
                close(open.replace(begun));
            }
        }
    }
    close(open);
    stands
}

/// The period of rest at `time_s`; `stands` are in the order of time.
pub fn rest_period_at(stands: &[RestPeriod], time_s: f64) -> Option<&RestPeriod> {
    let next = stands.partition_point(|it| it.from_s <= time_s);
    next.checked_sub(1).map(|it| &stands[it]).filter(|it| time_s <= it.until_s)
}
