//! The end of each node on a thread of its own, so that one that never comes back keeps neither the run nor what the others hold.

use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, bounded};
use foveate_node::error::NodeError;
use foveate_node::guard::guarded;
use foveate_node::registry::ErasedNode;
use foveate_node::report::Report;

/// How long a node may take to finish, and to be let go: files of a long session take their time on a slow disk.
pub(super) const FINISH_PATIENCE: Duration = Duration::from_secs(180);

/// A request to a node at its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Job {
    Finish,
    Drop,
}

type Node = Box<dyn ErasedNode>;
/// The node, if it is still there, what it reports, and whether it failed; the outer error is what a panic said.
type Done = (Option<Node>, Report, Result<Result<(), NodeError>, String>);

/// Where jobs go, and where they come back.
type Thread = (Sender<(Node, Job)>, Receiver<Done>);

/// A thread that ends nodes, one after the other; another one in its place where a node keeps it.
pub(super) struct Finisher {
    patience: Duration,
    thread: Option<Thread>,
}

impl Finisher {
    pub fn new(patience: Duration) -> Self {
        Self { patience, thread: None }
    }

    /// Ends a node; `None` where it does not come back.
    pub fn run(&mut self, node: Node, job: Job) -> Option<Done> {
        let (jobs, done) = self.thread.get_or_insert_with(start);
        let done = jobs.send((node, job)).ok().and_then(|()| done.recv_timeout(self.patience).ok());
        if done.is_none() {
            self.thread = None;
        }
        done
    }
}

fn start() -> Thread {
    let ((jobs, asked), (done, given)) = (bounded::<(Node, Job)>(1), bounded::<Done>(1));
    std::thread::spawn(move || {
        for (mut node, job) in asked {
            let mut report = Report::default();
            let answer = match job {
                Job::Finish => {
                    let result = guarded(|| node.finish(&mut report));
                    (Some(node), report, result)
                }
                Job::Drop => (None, report, guarded(|| drop(node)).map(Ok)),
            };
            if done.send(answer).is_err() {
                return; // the run has gone on without this node
            }
        }
    });
    (jobs, given)
}

#[cfg(test)]
mod tests {
    use foveate_node::setup::Setup;
    use foveate_node::{ConfigError, Io, Ports, Role};
    use schemars::JsonSchema;
    use serde::{Deserialize, Serialize};

    use super::*;

    /// Does not come back from the end that it is told to stay in.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    struct Stays {
        /// `finish`, `drop` or neither [–].
        at: String,
    }

    fn stay() {
        loop {
            std::thread::park();
        }
    }

    impl foveate_node::Node for Stays {
        const TYPE: &'static str = "test.stays";
        const ROLE: Role = Role::Sink;
        const SUMMARY: &'static str = "Stays";
        type Settings = Stays;
        fn ports() -> Ports {
            Ports::new()
        }
        fn new(settings: Stays, _: &Setup) -> Result<Self, ConfigError> {
            Ok(settings)
        }
        fn process(&mut self, _: &mut Io<'_>) -> Result<(), NodeError> {
            Ok(())
        }
        fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
            if self.at == "finish" {
                stay();
            }
            report.figure("finished", 1.0);
            Ok(())
        }
    }

    impl Drop for Stays {
        fn drop(&mut self) {
            if self.at == "drop" {
                stay();
            }
        }
    }

    fn node(at: &str) -> Node {
        Box::new(Stays { at: at.to_owned() })
    }

    #[test]
    fn a_node_that_stays_keeps_neither_the_run_nor_the_others() {
        let mut finisher = Finisher::new(Duration::from_millis(100));
        assert!(finisher.run(node("finish"), Job::Finish).is_none() && finisher.run(node("drop"), Job::Drop).is_none());
        let (node, report, result) = finisher.run(node("neither"), Job::Finish).unwrap();
        assert!(matches!(result, Ok(Ok(()))) && report.figures["finished"] == 1.0);
        assert!(finisher.run(node.unwrap(), Job::Drop).is_some_and(|it| it.0.is_none()));
    }
}
