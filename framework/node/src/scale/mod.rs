//! Scales at run time: who carries a scale's space, where that space is, and which scales there are.
//!
//! The space of a scale with `anchor` moves with a target of its parent. The loader gives each such scale a node `anchor`
//! ([`ScaleAnchor`]) that says where the space is ([`ScaleSpace`](foveate_messages::ScaleSpace)); a node that transforms points between
//! scales keeps [`Spaces`] of these messages. A scale without an anchor has its parent's space.

mod anchor;
mod spaces;

use std::sync::Arc;

use foveate_messages::ScaleId;

pub use anchor::{ScaleAnchor, ScaleAnchorSettings};
pub use spaces::Spaces;

/// One scale of a rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScalePlace {
    /// Its name.
    pub name: String,
    /// The scale that it nests in; `None`: its space is a world of its own.
    pub parent: Option<ScaleId>,
    /// Whether its space moves with a target of the parent.
    pub is_anchored: bool,
}

/// The scales of a rig, parents before children, as one of them sees them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScaleTree {
    /// The scale that looks.
    pub own: ScaleId,
    /// All scales by number.
    pub places: Arc<[ScalePlace]>,
}

impl ScaleTree {
    /// A rig with one scale.
    pub fn of_one(name: &str) -> Self {
        let place = ScalePlace { name: name.to_owned(), parent: None, is_anchored: false };
        Self { own: ScaleId(0), places: Arc::new([place]) }
    }

    /// A scale by its number.
    pub fn place(&self, scale: ScaleId) -> Option<&ScalePlace> {
        self.places.get(scale.0 as usize)
    }

    /// `scale`, then the scale that it nests in, and so on.
    pub fn around(&self, scale: ScaleId) -> impl Iterator<Item = ScaleId> + '_ {
        // Parents have smaller numbers: this ends.
        std::iter::successors(Some(scale), |&it| self.place(it)?.parent.filter(|parent| *parent < it))
    }

    /// The outermost scale around `scale`, itself where it nests in none: whose space is their world.
    pub fn root_of(&self, scale: ScaleId) -> ScaleId {
        self.around(scale).last().unwrap_or(scale)
    }
}
