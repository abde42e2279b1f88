//! Whose targets are, where something tells users apart.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::portable;
use crate::{Message, Quality, Space, TargetId, Time, Wire};

/// Whose a target is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TargetUser {
    /// The target.
    pub id: TargetId,
    /// The number that settings gave the user.
    pub user: u32,
}

/// Two targets that had been taken for each other: from this message on each identity is again where it belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Exchange {
    /// The two.
    pub ids: [TargetId; 2],
    /// What was given out of one after this time belongs to the other.
    pub since: Time,
}

/// Whose the targets of one message are; comes before that message.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Users {
    /// The time of the targets.
    pub time: Time,
    /// Targets whose user is known, ascending by identity; those that are not here have none yet.
    pub list: Vec<TargetUser>,
    /// Which identities were exchanged since the message before, in order.
    pub exchanged: Vec<Exchange>,
}

impl Users {
    /// Whose `id` is, if that is known.
    pub fn of(&self, id: TargetId) -> Option<u32> {
        self.list.iter().find(|it| it.id == id).map(|it| it.user)
    }
}

impl Message for Users {
    const NAME: &'static str = "users";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = portable!(Users);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.list.len() as u32), sigma: None }
    }
}
