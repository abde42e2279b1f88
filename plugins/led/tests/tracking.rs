//! The tracker in a small lab with known truth.

mod common;

use common::{Lab, Score, cameras, person, score};
use foveate_led::tracker::{IntegratorSettings, Tracker};

fn tracker(settings: IntegratorSettings, n_cameras: usize) -> Tracker {
    Tracker::new(settings, cameras(n_cameras), Some([[-1.75, -2.5, 0.0], [1.75, 2.5, 2.2]]))
}

fn walk(lab: &Lab, settings: IntegratorSettings, duration: f64) -> (Score, Tracker) {
    let mut tracker = tracker(settings, lab.cameras.len());
    let score = score(&mut tracker, &lab.frames(duration, person), 1.0, person);
    (score, tracker)
}


#[test]
fn sweep() {
    for (name, lab) in [
        ("clutter 2", Lab { clutter: 2.0, ..Lab::new(18) }),
        ("clutter 5", Lab { clutter: 5.0, ..Lab::new(18) }),
        ("clutter 20", Lab { clutter: 20.0, ..Lab::new(18) }),
        ("directional", Lab { directional: true, hidden: 0.2, clutter: 1.0, ..Lab::new(18) }),
        ("directional+", Lab { directional: true, hidden: 0.4, clutter: 2.0, ..Lab::new(18) }),
        ("six", Lab { clutter: 2., noise: 0.5, ..Lab::new(6) }),
        ("four", Lab { clutter: 2., noise: 0.5, hidden: 0.2, ..Lab::new(4) }),
    ] { for seed in 1..=3 {
            let lab = Lab { seed, ..lab.clone() };
            let (s, tracker) = walk(&lab, IntegratorSettings::default(), 20.0);
            println!("{name:12} rms {:.2} mm worst {:.1} mm nees {:.2} ids {} ghosts {} missed {} of {} {}", s.rms*1e3, s.worst*1e3, s.consistency, s.n_identities(), s.ghosts, s.missed, s.samples, format!("{:?}",tracker.tally()).split("unmatched").next().unwrap());
    } }
}
