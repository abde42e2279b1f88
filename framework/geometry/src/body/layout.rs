//! Layout of a filter's state: its parts, and where their blocks begin.

use super::parts::{N_PARTS, Part};

/// Numbers that are the sizes of all parts.
pub(super) const N_SIZES: usize = 3 * N_PARTS;

/// Presence of a part in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// The part is not in the model.
    Absent,
    /// The part is rigid with its parent: the lower part of a limb that was never seen bent.
    Tied,
    /// The part turns by itself.
    Own,
}

/// Where the blocks of the state begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    slots: [Option<u8>; N_PARTS],
    tied: [bool; N_PARTS],
    n_parts: usize,
}

impl Layout {
    /// A layout with all parts for which `has`, each turning by itself.
    pub fn new(has: impl Fn(Part) -> bool) -> Self {
        Self::of(|it| if has(it) { Presence::Own } else { Presence::Absent })
    }

    /// A layout with parts as `presence` says. A part whose parent is absent cannot be tied to it, and is absent.
    pub fn of(presence: impl Fn(Part) -> Presence) -> Self {
        let mut layout = Layout { slots: [None; N_PARTS], tied: [false; N_PARTS], n_parts: 0 };
        for part in Part::ALL {
            match (presence(part), part.parent()) {
                (Presence::Own, _) => {
                    layout.slots[part.index()] = Some(layout.n_parts as u8);
                    layout.n_parts += 1;
                }
                (Presence::Tied, Some(parent)) => {
                    layout.slots[part.index()] = layout.slots[parent.index()];
                    layout.tied[part.index()] = true;
                }
                _ => {}
            }
        }
        layout
    }

    /// Presence of a part.
    pub fn presence(&self, part: Part) -> Presence {
        match (self.has(part), self.tied[part.index()]) {
            (false, _) => Presence::Absent,
            (true, true) => Presence::Tied,
            (true, false) => Presence::Own,
        }
    }

    pub(super) fn is_own(&self, part: Part) -> bool {
        self.presence(part) == Presence::Own
    }

    /// Whether a part is in the model.
    pub fn has(&self, part: Part) -> bool {
        self.slots[part.index()].is_some()
    }

    /// The parts in the model.
    pub fn parts(&self) -> impl Iterator<Item = Part> + '_ {
        Part::ALL.into_iter().filter(|it| self.has(*it))
    }

    pub(super) fn slot(&self, part: Part) -> Option<usize> {
        self.slots[part.index()].map(usize::from)
    }

    /// First index of a part's turn; `None` without one.
    pub fn turn(&self, part: Part) -> Option<usize> {
        self.slot(part).map(|it| 3 + 3 * it)
    }

    /// First index of a part's sizes.
    pub fn size(&self, part: Part) -> usize {
        3 + 3 * self.n_parts + 3 * part.index()
    }

    /// Number of entries for place, turns and sizes.
    pub fn n_static(&self) -> usize {
        3 + 3 * self.n_parts + N_SIZES
    }

    pub(super) fn velocity(&self) -> usize {
        self.n_static()
    }

    pub(super) fn rate(&self, part: Part) -> Option<usize> {
        self.slot(part).map(|it| self.n_static() + 3 + 3 * it)
    }

    /// Number of all entries.
    pub fn n(&self) -> usize {
        self.n_static() + 3 + 3 * self.n_parts
    }
}
