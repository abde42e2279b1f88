//! The user of each target, where something identifies users.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::portable;
use crate::{Message, Quality, Space, TargetId, Time, Wire};

/// The user of one target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TargetUser {
    /// The target.
    pub id: TargetId,
    /// The user's number in the settings.
    pub user: u32,
}

/// Two targets whose identities were exchanged: from this message on each identity is at its own target again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Exchange {
    /// The two.
    pub ids: [TargetId; 2],
    /// Samples of one after this time belong to the other.
    pub since: Time,
}

/// The users of the targets of one message; comes before that message.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Users {
    /// The time of the targets.
    pub time: Time,
    /// Targets whose user is known, ascending by identity.
    pub list: Vec<TargetUser>,
    /// Which identities were exchanged since the message before, in order.
    pub exchanged: Vec<Exchange>,
}

impl Users {
    /// The user of `id`, if known.
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
