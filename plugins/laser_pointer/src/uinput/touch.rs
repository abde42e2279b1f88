//! Pointers as fingers: multitouch protocol B (Documentation/input/multi-touch-protocol.rst of the kernel).
//!
//! A finger keeps its slot and its tracking identity while it is down; a slot is reused with a new identity, never in the frame in which it was released: readers treat a frame
//! as one moment. Fingers without a slot wait until one is free. The first finger is also sent as `ABS_X`, `ABS_Y` and `BTN_TOUCH`, for readers of a single finger.

use std::collections::BTreeSet;

use foveate::prelude::TargetId;

use super::{
    ABS_MT_POSITION_X, ABS_MT_POSITION_Y, ABS_MT_SLOT, ABS_MT_TRACKING_ID, ABS_X, ABS_Y, BTN_TOUCH, Contact, Event,
};

/// Largest tracking identity, after which they restart at 0.
pub(super) const LAST_TRACKING: i32 = 65_535;

/// The fingers of a touch screen.
#[derive(Debug)]
pub(super) struct Touch {
    slots: Vec<Option<Finger>>,
    /// Those that wait for a slot.
    waiting: BTreeSet<TargetId>,
    pub(super) n_presses: u64,
    pub(super) n_left_out: u64,
}

#[derive(Debug, Clone, Copy)]
struct Finger {
    id: TargetId,
    /// Number of fingers put down before it.
    number: u64,
    at: [i32; 2],
}

impl Touch {
    pub(super) fn new(slots: usize) -> Touch {
        Touch { slots: vec![None; slots], waiting: BTreeSet::new(), n_presses: 0, n_left_out: 0 }
    }

    /// Whether a finger is put down or lifted.
    pub(super) fn is_urgent(&self, contacts: &[Contact]) -> bool {
        let is_lifted = |finger: &Finger| !contacts.iter().any(|it| it.is_pressed && it.id == finger.id);
        self.slots.iter().flatten().any(is_lifted)
            || self.slots.iter().any(Option::is_none)
                && contacts.iter().any(|it| it.is_pressed && self.slot_of(it.id).is_none())
    }

    pub(super) fn frame(&mut self, contacts: &[Contact]) -> Vec<Event> {
        let mut events = Vec::new();
        let before = self.first();
        let free: Vec<usize> = (0..self.slots.len()).filter(|&it| self.slots[it].is_none()).collect();
        let mut free = free.into_iter();
        for (slot, place) in self.slots.iter_mut().enumerate() {
            if place.is_some_and(|finger| !contacts.iter().any(|it| it.is_pressed && it.id == finger.id)) {
                *place = None;
                events.extend([slot_is(slot), Event::abs(ABS_MT_TRACKING_ID, -1)]);
            }
        }
        self.waiting.retain(|id| contacts.iter().any(|it| it.is_pressed && it.id == *id));
        for contact in contacts.iter().filter(|it| it.is_pressed) {
            let at = contact.at;
            let (slot, was) = if let Some(slot) = self.slot_of(contact.id) {
                (slot, self.slots[slot].map(|it| it.at))
            } else if let Some(slot) = free.next() {
                let tracking = self.n_presses % (LAST_TRACKING as u64 + 1);
                self.slots[slot] = Some(Finger { id: contact.id, number: self.n_presses, at });
                self.n_presses += 1;
                self.waiting.remove(&contact.id);
                events.extend([slot_is(slot), Event::abs(ABS_MT_TRACKING_ID, tracking as i32)]);
                (slot, None)
            } else {
                // One that only has to wait until the next frame is not left out.
                let is_full = self.slots.iter().all(Option::is_some);
                self.n_left_out += u64::from(is_full && self.waiting.insert(contact.id));
                continue;
            };
            if was == Some(at) {
                continue;
            }
            if was.is_some() {
                events.push(slot_is(slot));
            }
            events.extend([Event::abs(ABS_MT_POSITION_X, at[0]), Event::abs(ABS_MT_POSITION_Y, at[1])]);
            self.slots[slot].iter_mut().for_each(|it| it.at = at);
        }
        self.end(before, &mut events);
        events
    }

    /// Sends the first finger once more, and ends the frame.
    fn end(&self, before: Option<Finger>, events: &mut Vec<Event>) {
        if events.is_empty() {
            return;
        }
        let first = self.first();
        if first.is_some() != before.is_some() {
            events.push(Event::key(BTN_TOUCH, first.is_some()));
        }
        if let Some(Finger { at, .. }) = first {
            events.extend([Event::abs(ABS_X, at[0]), Event::abs(ABS_Y, at[1])]);
        }
        events.push(Event::REPORT);
    }

    /// The finger that has been down for the longest time.
    fn first(&self) -> Option<Finger> {
        self.slots.iter().flatten().min_by_key(|it| it.number).copied()
    }

    fn slot_of(&self, id: TargetId) -> Option<usize> {
        self.slots.iter().position(|it| it.is_some_and(|it| it.id == id))
    }
}

fn slot_is(slot: usize) -> Event {
    Event::abs(ABS_MT_SLOT, slot as i32)
}
