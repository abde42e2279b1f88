//! Pointers on a wall: where each is, and its latest events.

use nalgebra::{Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::Numbers;
use crate::wire::portable;
use crate::{Exchange, Interval, Message, Quality, Space, SpaceOwner, TargetId, Time, Wire};

/// One pointer at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pointer {
    /// The identity of its target.
    pub id: TargetId,
    /// Its user, by the number in the settings; `None` where unknown (yet).
    pub user: Option<u32>,
    /// On the wall, without jitter, at [`Pointers::time`] [m].
    #[schemars(with = "Numbers<2>")]
    pub position: Point2<f64>,
    /// On the wall [m/s].
    #[schemars(with = "Numbers<2>")]
    pub velocity: Vector2<f64>,
    /// Where it will be at [`Pointers::shown_at`] [m].
    #[schemars(with = "Numbers<2>")]
    pub predicted: Point2<f64>,
    /// Standard deviation of the position as the tracker states it: the root of the mean variance over both axes [m].
    pub sigma: f64,
    /// It is held down: what it does now is drawn.
    pub is_pressed: bool,
    /// It rests: since its last [`PointerChange::Hover`] it has stayed where it was.
    pub is_resting: bool,
    /// It was seen at this very time; otherwise its position is extrapolated.
    pub is_seen: bool,
}

/// What happened to a pointer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum PointerChange {
    /// It is there for the first time; this may still be a flash.
    Appear,
    /// It is held down.
    Press,
    /// It moved while it was held down.
    Move,
    /// It came to rest.
    Hover,
    /// It has rested for long.
    Dwell,
    /// It is not held down any more.
    Release,
    /// A whole stroke, from press to release.
    Stroke,
    /// It is gone.
    Vanish,
}

impl PointerChange {
    /// All, in the order in which they can happen first.
    pub const ALL: [PointerChange; 8] = [
        PointerChange::Appear,
        PointerChange::Press,
        PointerChange::Move,
        PointerChange::Hover,
        PointerChange::Dwell,
        PointerChange::Release,
        PointerChange::Stroke,
        PointerChange::Vanish,
    ];

    /// As it stands in files: `appear`, `press` and so on.
    pub const fn name(self) -> &'static str {
        match self {
            PointerChange::Appear => "appear",
            PointerChange::Press => "press",
            PointerChange::Move => "move",
            PointerChange::Hover => "hover",
            PointerChange::Dwell => "dwell",
            PointerChange::Release => "release",
            PointerChange::Stroke => "stroke",
            PointerChange::Vanish => "vanish",
        }
    }
}

/// One point of a stroke.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StrokePoint {
    /// When the pointer was seen there.
    pub time: Time,
    /// On the wall [m].
    #[schemars(with = "Numbers<2>")]
    pub position: Point2<f64>,
}

/// Something that happened to a pointer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PointerEvent {
    /// Which pointer.
    pub id: TargetId,
    /// Its user, as known when this event was emitted.
    pub user: Option<u32>,
    /// What.
    pub what: PointerChange,
    /// When it was seen: a press is of the moment at which the pointer came, a release of that at which it was seen last.
    pub time: Time,
    /// Delay from `time` until this event was emitted: cameras, tracking, and the time to be sure.
    pub latency: Interval,
    /// Where, on the wall [m].
    #[schemars(with = "Numbers<2>")]
    pub position: Point2<f64>,
    /// Of a stroke: its points, oldest first; empty for all else.
    pub path: Vec<StrokePoint>,
}

/// All pointers on a wall at one time, ascending by identity, and what happened since the message before.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Pointers {
    /// The time that all in `list` are of.
    pub time: Time,
    /// When people will see what is shown for this message: `predicted` is of then.
    pub shown_at: Time,
    /// The pointers.
    pub list: Vec<Pointer>,
    /// Identities that were exchanged: events of one since then belong to the other.
    pub exchanged: Vec<Exchange>,
    /// What happened, in order.
    pub events: Vec<PointerEvent>,
}

impl Message for Pointers {
    const NAME: &'static str = "pointers";
    const VERSION: u32 = 2;
    const SPACE: Space = Space { owner: SpaceOwner::Scale, dimension: 2, unit: "m" };
    const WIRE: Wire = portable!(Pointers);

    fn quality(&self) -> Quality {
        let sum: f64 = self.list.iter().map(|it| it.sigma).sum();
        Quality {
            count: Some(self.list.len() as u32),
            sigma: (!self.list.is_empty()).then(|| sum / self.list.len() as f64),
        }
    }
}
