//! Commands of a camera about its picture: white balance, exposure, gain, effects.
//!
//! The simulated head takes these commands, remembers them, and answers when asked; no picture changes. The list holds what the EVI-D30 and its
//! successors (EVI-D70, EVI-D100) know, in the form of their command lists, so that clients that were written for any of them find what they expect.

use super::words;

/// Numbers on and off, as nearly all switches have them.
const ON_OFF: &[u8] = &[2, 3];

/// One thing that can be set.
struct Setting {
    /// Group and code of the command that sets it, and of the inquiry.
    code: [u8; 2],
    kind: Kind,
    /// Value after the first start.
    start: u16,
}

enum Kind {
    /// `01 GG CC 0p`, followed by so many zeros; these values of p.
    Mode { values: &'static [u8], zeros: usize },
    /// `01 GG CC 0p 0q 0r 0s`, up to this value; with a command of its own to reset it and to go up and down by one.
    Level { most: u16, step: Option<u8> },
}

const fn mode(code: u8, values: &'static [u8], start: u8) -> Setting {
    Setting { code: [0x04, code], kind: Kind::Mode { values, zeros: 0 }, start: start as u16 }
}

const fn level(code: u8, step: u8, most: u16, start: u16) -> Setting {
    Setting { code: [0x04, code], kind: Kind::Level { most, step: Some(step) }, start }
}

const fn number(code: u8, most: u16) -> Setting {
    Setting { code: [0x04, code], kind: Kind::Level { most, step: None }, start: 0 }
}

const SETTINGS: [Setting; 30] = [
    mode(0x06, ON_OFF, 3),                       // digital zoom
    mode(0x11, &[0, 1], 0),                      // infrared correction
    mode(0x17, &[0, 2], 0),                      // key lock
    mode(0x33, ON_OFF, 3),                       // backlight compensation
    mode(0x35, &[0, 1, 2, 3, 4, 5, 0x20], 0),    // white balance
    mode(0x39, &[0, 3, 0x0A, 0x0B, 0x0D], 0),    // automatic exposure
    mode(0x3E, ON_OFF, 3),                       // exposure compensation
    mode(0x57, &[0, 1, 2], 0),                   // automatic focus: normal, at intervals, after zooming
    mode(0x58, ON_OFF, 2),                       // its sensitivity: high, low
    mode(0x5A, ON_OFF, 3),                       // slow shutter
    mode(0x60, &[0, 1, 2], 0),                   // wide screen
    mode(0x61, ON_OFF, 3),                       // left and right exchanged
    mode(0x62, ON_OFF, 3),                       // frozen
    mode(0x63, &[0, 1, 2, 3, 4, 5, 6, 7, 8], 0), // effects
    mode(0x66, ON_OFF, 3),                       // upside down
    mode(0xA4, &[0, 1, 2, 3], 0),                // flips of both kinds
    level(0x42, 0x02, 15, 8),                    // aperture
    level(0x43, 0x03, 255, 128),                 // gain of red
    level(0x44, 0x04, 255, 128),                 // gain of blue
    level(0x4A, 0x0A, 27, 0),                    // shutter
    level(0x4B, 0x0B, 17, 10),                   // iris
    level(0x4C, 0x0C, 15, 1),                    // gain
    level(0x4D, 0x0D, 31, 15),                   // brightness
    level(0x4E, 0x0E, 14, 7),                    // exposure compensation, how much
    number(0x22, 0xFFFF),                        // number of the camera
    number(0x27, 0xFFFF),                        // automatic focus: seconds of moving and of waiting
    number(0x49, 0x6F),                          // colour, and its gain
    Setting { code: [0x04, 0x37], kind: Kind::Mode { values: ON_OFF, zeros: 1 }, start: 3 }, // defogging
    Setting { code: [0x06, 0x06], kind: Kind::Mode { values: ON_OFF, zeros: 0 }, start: 3 }, // data on the screen
    Setting { code: [0x06, 0x08], kind: Kind::Mode { values: ON_OFF, zeros: 0 }, start: 2 }, // remote control is heard
];

/// A command about the picture: which setting, and what becomes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    To(usize, u16),
    Reset(usize),
    Up(usize),
    Down(usize),
    /// White balance and focus, once, now: leaves no value that an inquiry could read.
    Once,
}

/// What follows the 0x01 of a command, where it is about the picture and as the lists have it.
pub(super) fn change(group: u8, code: u8, rest: &[u8]) -> Option<Change> {
    if (group, code, rest) == (0x04, 0x10, &[0x05]) || (group, code, rest) == (0x04, 0x18, &[0x01]) {
        return Some(Change::Once);
    }
    SETTINGS.iter().enumerate().find_map(|(index, setting)| match setting.kind {
        Kind::Mode { values, zeros } if setting.code == [group, code] => {
            let (&value, tail) = rest.split_first()?;
            let is_legal = values.contains(&value) && tail.len() == zeros && tail.iter().all(|&it| it == 0);
            is_legal.then_some(Change::To(index, u16::from(value)))
        }
        Kind::Level { most, .. } if setting.code == [group, code] => {
            let value = words::word(rest)? as u16;
            (value <= most).then_some(Change::To(index, value))
        }
        Kind::Level { step: Some(step), .. } if [0x04, step] == [group, code] => match rest {
            [0x00] => Some(Change::Reset(index)),
            [0x02] => Some(Change::Up(index)),
            [0x03] => Some(Change::Down(index)),
            _ => None,
        },
        _ => None,
    })
}

/// The setting that an inquiry with this group and code is about.
pub(super) fn asked(group: u8, code: u8) -> Option<usize> {
    SETTINGS.iter().position(|it| it.code == [group, code])
}

/// The values of all settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Picture([u16; SETTINGS.len()]);

impl Default for Picture {
    fn default() -> Self {
        Self(SETTINGS.map(|it| it.start))
    }
}

impl Picture {
    pub(super) fn apply(&mut self, change: Change) {
        let most = |index: usize| match SETTINGS[index].kind {
            Kind::Level { most, .. } => most,
            Kind::Mode { .. } => u16::MAX,
        };
        match change {
            Change::To(index, value) => self.0[index] = value,
            Change::Reset(index) => self.0[index] = SETTINGS[index].start,
            Change::Up(index) => self.0[index] = (self.0[index] + 1).min(most(index)),
            Change::Down(index) => self.0[index] = self.0[index].saturating_sub(1),
            Change::Once => {}
        }
    }

    /// What an inquiry about the setting at `index` is answered.
    pub(super) fn answer(&self, index: usize) -> Vec<u8> {
        let value = self.0[index];
        match SETTINGS[index].kind {
            Kind::Mode { zeros, .. } => [vec![value as u8], vec![0; zeros]].concat(),
            Kind::Level { .. } => words::digits(i32::from(value)).to_vec(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_commands_share_their_bytes() {
        let steps = SETTINGS.iter().filter_map(|it| match it.kind {
            Kind::Level { step: Some(step), .. } => Some([0x04, step]),
            _ => None,
        });
        let mut codes: Vec<[u8; 2]> = SETTINGS.iter().map(|it| it.code).chain(steps).collect();
        let n_codes = codes.len();
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes.len(), n_codes);
    }

    #[test]
    fn every_setting_takes_its_start_value_and_levels_stay_within_their_ends() {
        let mut picture = Picture::default();
        for (index, setting) in SETTINGS.iter().enumerate() {
            let [group, code] = setting.code;
            let answer = picture.answer(index);
            assert_eq!(change(group, code, &answer), Some(Change::To(index, setting.start)), "{group:02X} {code:02X}");
            if let Kind::Level { most, step: Some(step) } = setting.kind {
                for (byte, end) in [(0x02, most), (0x03, 0)] {
                    (0..300).for_each(|_| picture.apply(change(0x04, step, &[byte]).unwrap()));
                    assert_eq!(picture.0[index], end);
                }
                picture.apply(change(0x04, step, &[0x00]).unwrap());
            }
        }
        assert_eq!(picture, Picture::default());
        assert_eq!(change(0x04, 0x43, &[0, 0, 0x80]), None, "a byte for two digits");
        assert_eq!(change(0x04, 0x4B, &[0, 0, 1, 2]), None, "18 of 17");
        assert_eq!(change(0x04, 0x37, &[2]), None);
    }
}
