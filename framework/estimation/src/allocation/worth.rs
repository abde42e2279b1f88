//! What a set of lines of sight tells about the point in which they meet.

use nalgebra::Vector3;

/// What it is worth to see a target from several sides: 0 unseen, 1 at best.
///
/// Two lines that cross at the angle θ fix a point along their common direction to their own error over sin θ: a pair tells `pair` ·
/// min(1, sin θ / sin `best_angle`), most between `best_angle` and its supplement, nothing where the lines are parallel or opposite. Pairs count
/// like independent witnesses: what none of them tells is the product of what each does not. A head alone tells `one`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worth {
    /// Of one head alone, 0 to 1.
    pub one: f64,
    /// What the best pair tells of what one head does not, 0 to 1; below 1, further heads are worth something.
    pub pair: f64,
    /// The least angle between lines of sight that is as good as any, above 0 and at most π/2 [rad].
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
    /// What two lines of sight tell together that one does not, 0 to 1; the vectors point along them, of any length. 0 for a vector
    /// without a direction.
    pub fn of_pair(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let (Some(a), Some(b)) = (a.try_normalize(1e-12), b.try_normalize(1e-12)) else { return 0.0 };
        let across = a.cross(&b).norm() / self.best_angle.sin();
        if across.is_finite() { self.pair * across.min(1.0) } else { 0.0 }
    }

    /// What it is worth to look along all of `lines`.
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
