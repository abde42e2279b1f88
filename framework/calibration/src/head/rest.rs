//! When a head stood still, from where it said that it was.
//!
//! Two reports in a row of one place mean that it was there all the while: a head that is told to go does not come back before it is
//! asked again. What it carries may swing on a while after it stopped.

/// Where a head said that it was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionReport {
    /// It looked at its motors after this moment … [s].
    pub earliest_s: f64,
    /// … and before this one [s].
    pub latest_s: f64,
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
}

/// A stretch of time in which a head stood still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// Since when [s].
    pub from_s: f64,
    /// Until when at least [s].
    pub until_s: f64,
    /// Pan and tilt [rad].
    pub angles: [f64; 2],
}

/// Reports further apart than this say nothing of what was between [s].
const LONGEST_GAP_S: f64 = 1.5;

/// The stretches, in the order of time, in which all reports are of one place within `tolerance` [rad], each without its first `settle_s`
/// [s]. `reports` are in the order of time.
pub fn stands(reports: &[PositionReport], tolerance: f64, settle_s: f64) -> Vec<Stand> {
    let mut stands = Vec::new();
    let mut open: Option<Stand> = None;
    let mut close = |stand: Option<Stand>| stands.extend(stand.filter(|it| it.until_s > it.from_s));
    for report in reports {
        let same = |it: &Stand| {
            let off = [0, 1].map(|axis| (it.angles[axis] - report.angles[axis]).abs());
            off[0].max(off[1]) <= tolerance && report.earliest_s - it.until_s <= LONGEST_GAP_S
        };
        match &mut open {
            Some(stand) if same(stand) => stand.until_s = stand.until_s.max(report.earliest_s),
            _ => {
                let from_s = report.latest_s + settle_s;
                // Nothing yet: the first report of a place ends where it begins.
                let begun = Stand { from_s, until_s: report.earliest_s, angles: report.angles };
                close(open.replace(begun));
            }
        }
    }
    close(open);
    stands
}

/// The stand at `time_s`, of stands in the order of time.
pub fn stand_at(stands: &[Stand], time_s: f64) -> Option<&Stand> {
    let next = stands.partition_point(|it| it.from_s <= time_s);
    next.checked_sub(1).map(|it| &stands[it]).filter(|it| time_s <= it.until_s)
}
