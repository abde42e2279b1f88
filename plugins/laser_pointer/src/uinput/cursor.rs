//! One pointer as a mouse with absolute positions, as in virtual machines.

use foveate::prelude::TargetId;

use super::{ABS_X, ABS_Y, BTN_LEFT, Contact, Event};

/// The cursor, and the pointer that moves it: the oldest one, until it is gone.
#[derive(Debug, Default)]
pub(super) struct Cursor {
    holder: Option<TargetId>,
    is_down: bool,
    at: Option<[i32; 2]>,
    pub(super) n_presses: u64,
}

impl Cursor {
    /// The pointer that moves the cursor: identities count up, so that the smallest is the oldest.
    fn mover<'a>(&self, contacts: &'a [Contact]) -> Option<&'a Contact> {
        let holder = contacts.iter().find(|it| Some(it.id) == self.holder);
        holder.or_else(|| contacts.iter().min_by_key(|it| it.id))
    }

    /// Whether the button goes down or up, or the pointer changes.
    pub(super) fn is_urgent(&self, contacts: &[Contact]) -> bool {
        let mover = self.mover(contacts);
        mover.is_some_and(|it| it.is_pressed) != self.is_down || mover.map(|it| it.id) != self.holder
    }

    pub(super) fn frame(&mut self, contacts: &[Contact]) -> Vec<Event> {
        let mut events = Vec::new();
        let mover = self.mover(contacts).copied();
        let is_down = mover.is_some_and(|it| it.is_pressed);
        let is_other = mover.map(|it| it.id) != self.holder;
        // The button comes up where it was held, before the cursor leaves for somebody else's place.
        if self.is_down && (is_other || !is_down) {
            events.extend([Event::key(BTN_LEFT, false), Event::REPORT]);
            self.is_down = false;
        }
        let n_before = events.len();
        if let Some(Contact { at, .. }) = mover
            && self.at != Some(at)
        {
            events.extend([Event::abs(ABS_X, at[0]), Event::abs(ABS_Y, at[1])]);
            self.at = Some(at);
        }
        if is_down && !self.is_down {
            // The cursor is there before the button goes down.
            if events.len() > n_before {
                events.push(Event::REPORT);
            }
            events.push(Event::key(BTN_LEFT, true));
            self.is_down = true;
            self.n_presses += 1;
        }
        if events.len() > n_before {
            events.push(Event::REPORT);
        }
        self.holder = mover.map(|it| it.id);
        events
    }
}
