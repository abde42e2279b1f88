//! Whether scoring has begun: what comes before `start_s` is not scored, and a short run may be over before.

use foveate_messages::Time;

/// What came too early to be scored, and whether anything came later.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Warmup {
    last: Option<Time>,
    is_over: bool,
}

impl Warmup {
    /// Whether something of this time is scored, which begins at `start_s` [s].
    pub fn is_scored(&mut self, time: Time, start_s: f64) -> bool {
        let is_late_enough = time.as_s() >= start_s;
        self.is_over |= is_late_enough;
        if !is_late_enough {
            self.last = self.last.max(Some(time));
        }
        is_late_enough
    }

    /// A sentence for the person where all came too early.
    pub fn remark(&self, start_s: f64) -> Option<String> {
        let last = self.last.filter(|_| !self.is_over)?;
        Some(format!(
            "scoring had not begun: it begins at `start_s` = {start_s} s, and the last of what it judges came at {:.2} s; expected a longer run",
            last.as_s()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_run_that_was_over_before_the_start_is_told() {
        let mut warmup = Warmup::default();
        assert_eq!(warmup.remark(13.0), None, "nothing came at all");
        assert!(!warmup.is_scored(Time::from_s(7.5), 13.0) && !warmup.is_scored(Time::from_s(7.9), 13.0));
        assert!(!warmup.is_scored(Time::from_s(7.7), 13.0), "another camera");
        let said = warmup.remark(13.0).unwrap();
        assert!(said.contains("begins at `start_s` = 13 s") && said.contains("came at 7.90 s"), "{said}");
        assert!(warmup.is_scored(Time::from_s(13.0), 13.0));
        assert_eq!(warmup.remark(13.0), None);
    }
}
