//! Budgets of a checked rig.

/// A promise on the age of information along a path, `[[budget]]`: the time from the capture of what comes out at one place to the moment at which what was
/// made of it leaves at, or arrives at, another. It holds for each pair of instances between which there is a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// The output at which the path begins, as in the rig: `room.video.image`.
    pub from: String,
    /// The port at which it ends, as in the rig: `face.aim.commands`.
    pub to: String,
    /// Instances at which the path begins, in the order of the graph.
    pub begins: Vec<usize>,
    /// Where it ends, one for each instance, in the order of the graph.
    pub ends: Vec<BudgetEnd>,
    /// Instances whose stamps show that a message was made of what the path begins with, in the order of the graph: those that the path leads through, and
    /// those before it.
    pub origins: Vec<usize>,
    /// Age, 99th percentile, at most [s].
    pub age_s: f64,
    /// From the arrival at an actuator to its motor, as the actuator states it: counts as well [s].
    pub latency_s: f64,
    /// Not meeting it fails the run (exit code 3).
    pub must: bool,
}

/// A port at which a budget ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BudgetEnd {
    /// Its instance.
    pub instance: usize,
    /// Where ages are measured.
    pub at: BudgetPort,
}

/// Where the ages of a budget are measured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BudgetPort {
    /// At this output port, when messages are given out.
    Output(usize),
    /// At an input port, at delivery along these edges.
    Input(Vec<usize>),
}

impl Budget {
    /// Whether a message with a stamp of instance `source` was made of what the path begins with.
    pub fn has_origin(&self, source: usize) -> bool {
        self.origins.binary_search(&source).is_ok()
    }
}
