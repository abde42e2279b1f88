//! Pending commands: the newest of each kind.

use foveate::prelude::Time;

use super::events::CommandId;
use crate::visca::{Command, Corner, PanDrive, TiltDrive, ZoomDrive};

/// A command that was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PendingCommand {
    pub id: CommandId,
    pub command: Command,
    /// When it was given.
    pub since: Time,
}

/// Commands of one kind replace each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Power,
    Limit(Corner),
    Motors,
    Zoom,
    Focus,
    FocusMode,
}

impl Part {
    /// In the order in which they are sent: what others depend on comes first.
    pub(super) const ALL: [Part; 7] = [
        Part::Power,
        Part::Limit(Corner::DownLeft),
        Part::Limit(Corner::UpRight),
        Part::Motors,
        Part::Zoom,
        Part::FocusMode,
        Part::Focus,
    ];

    pub(super) fn of(command: &Command) -> Part {
        match *command {
            Command::Absolute { .. }
            | Command::Relative { .. }
            | Command::Drive { .. }
            | Command::Home
            | Command::Reset => Part::Motors,
            Command::LimitSet { corner, .. } | Command::LimitClear { corner } => Part::Limit(corner),
            Command::ZoomDirect(_) | Command::Zoom(_) => Part::Zoom,
            Command::FocusAuto(_) => Part::FocusMode,
            Command::FocusDirect(_) => Part::Focus,
            Command::Power(_) => Part::Power,
        }
    }

    fn index(self) -> usize {
        Part::ALL.iter().position(|&it| it == self).unwrap_or(0)
    }
}

/// At most one pending command per part.
#[derive(Debug, Clone, Default)]
pub(super) struct PendingCommands([Option<PendingCommand>; Part::ALL.len()]);

impl PendingCommands {
    /// Stores a command; returns the one that it replaces.
    pub(super) fn put(&mut self, pending: PendingCommand) -> Option<PendingCommand> {
        self.0[Part::of(&pending.command).index()].replace(pending)
    }

    pub(super) fn get(&self, part: Part) -> Option<PendingCommand> {
        self.0[part.index()]
    }

    pub(super) fn take(&mut self, part: Part) -> Option<PendingCommand> {
        self.0[part.index()].take()
    }

    /// The next command to be sent.
    pub(super) fn first(&self) -> Option<PendingCommand> {
        self.0.iter().copied().flatten().next()
    }

    pub(super) fn all(&self) -> impl Iterator<Item = PendingCommand> + '_ {
        self.0.iter().copied().flatten()
    }
}

/// Whether executing a command twice has the same effect as once.
pub(super) fn is_repeatable(command: &Command) -> bool {
    !matches!(command, Command::Relative { .. })
}

/// The target position of a command, where known [units]: pan and tilt, or zoom and 0.
pub(super) fn destination(command: &Command) -> Option<[i32; 2]> {
    match *command {
        Command::Absolute { pan, tilt, .. } => Some([pan, tilt]),
        Command::Home | Command::Reset => Some([0, 0]),
        Command::ZoomDirect(units) => Some([i32::from(units), 0]),
        _ => None,
    }
}

/// Whether a command starts a motion that continues when the line is cut.
pub(super) fn is_drive(command: &Command) -> bool {
    match *command {
        Command::Drive { pan, tilt, .. } => pan != PanDrive::Stop || tilt != TiltDrive::Stop,
        Command::Zoom(drive) => drive != ZoomDrive::Stop,
        _ => false,
    }
}
