//! Model of one motor with limited speed and acceleration.

/// A command to a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Go to a goal, at most at this speed, and stop there.
    Go {
        /// Angle to go to [rad].
        goal: f64,
        /// Highest speed on the way, above 0 [rad/s].
        speed: f64,
    },
    /// Turn at this rate until the next command [rad/s].
    Turn(f64),
}

/// Where a motor is and how it turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motor {
    pub angle: f64,
    pub rate: f64,
    pub order: Order,
}

impl Motor {
    pub fn at_rest(angle: f64) -> Motor {
        Motor { angle, rate: 0.0, order: Order::Turn(0.0) }
    }

    /// `step` seconds on, with `acceleration` either way [rad/s²]. It brakes in time to stop at its goal: v² = 2 a (way − v step).
    #[inline]
    pub fn advance(&mut self, step: f64, acceleration: f64) {
        let change = acceleration * step;
        let wanted = match self.order {
            Order::Turn(rate) => rate,
            Order::Go { goal, speed } => {
                let way = goal - self.angle;
                if way.abs() <= change * step && self.rate.abs() <= 2.0 * change {
                    (self.angle, self.rate) = (goal, 0.0);
                    return;
                }
                let brakes = (change * change + 2.0 * acceleration * way.abs()).sqrt() - change;
                speed.min(brakes).copysign(way)
            }
        };
        self.rate += (wanted - self.rate).clamp(-change, change);
        self.angle += self.rate * step;
    }
}
