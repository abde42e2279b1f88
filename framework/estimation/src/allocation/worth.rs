//! The value of a set of lines of sight to one target.

use nalgebra::Vector3;

/// How much it is worth to see a target from several sides: 0 unseen, 1 at best.
///
/// Two lines that cross at the angle θ fix a point along their common direction to their own error over sin θ: a pair
/// is worth `pair` · min(1, sin θ / sin `best_angle`), most between `best_angle` and its supplement, nothing where the
/// lines are parallel or opposite. Pairs count as independent: what is missing of the value is the product of what is
/// missing for each pair. A single head is worth `one`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worth {
    /// Value of a single head, 0 to 1.
    pub one: f64,
    /// Part of the remaining value that the best pair adds, 0 to 1; below 1, further heads add more.
    pub pair: f64,
    /// The least angle between two lines of sight that is as good as any, above 0 and at most π/2 [rad].
    pub best_angle: f64,
}

impl Default for Worth {
    /// A second head that looks well across is worth three times the first, a third one less than the first: two heads for each target
    /// come before three for one.
    fn default() -> Self {
        Self { one: 0.2, pair: 0.75, best_angle: std::f64::consts::FRAC_PI_3 }
    }
}

impl Worth {
    /// Value that two lines of sight add to that of one, 0 to 1. The vectors point along them and have any length; a zero vector gives 0.
    pub fn of_pair(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let (Some(a), Some(b)) = (a.try_normalize(1e-12), b.try_normalize(1e-12)) else { return 0.0 };
        let across = a.cross(&b).norm() / self.best_angle.sin();
        if across.is_finite() { self.pair * across.min(1.0) } else { 0.0 }
    }

    /// Value of looking along all of `lines`, 0 to 1.
    pub fn of_set(&self, lines: &[Vector3<f64>]) -> f64 {
        let mut untold = 1.0;
        for (place, line) in lines.iter().enumerate() {
            untold *= lines[..place].iter().map(|it| 1.0 - self.of_pair(line, it)).product::<f64>();
        }
        self.of_untold(lines.len() as u32, untold)
    }

    /// The same of `count` lines by what none of their pairs tells.
    pub(super) fn of_untold(&self, count: u32, untold: f64) -> f64 {
        if count == 0 { 0.0 } else { self.one + (1.0 - self.one) * (1.0 - untold) }
    }
}
