//! What a camera offers in layouts, sizes and rates, and which of them a rig selects.

use std::fmt::Write;

use foveate::prelude::ConfigError;

use super::device::FourCc;
use super::pixels::in_letters;

/// A rate within this of the requested one counts as equal, relative.
const SAME_RATE: f64 = 0.01;

/// One pixel layout of a camera.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Offer {
    pub(crate) fourcc: FourCc,
    /// The driver's name for it.
    pub(crate) description: String,
    pub(crate) sizes: Vec<Sizes>,
}

/// One size, or a range of sizes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sizes {
    /// Columns, rows [px]: smallest, largest, step. One size: smallest = largest.
    pub(crate) min: [u32; 2],
    pub(crate) max: [u32; 2],
    pub(crate) step: [u32; 2],
    pub(crate) rates: Rates,
}

/// Times between two frames [s], as fractions.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Rates {
    /// These.
    Only(Vec<[u32; 2]>),
    /// All between shortest and longest.
    Between([u32; 2], [u32; 2]),
    /// The driver does not say.
    Unknown,
}

/// The requested format of a camera.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Wanted {
    /// Layouts that will do, the best first.
    pub(crate) layouts: Vec<FourCc>,
    /// Columns, rows [px].
    pub(crate) size: [u32; 2],
    pub(crate) rate_hz: Option<f64>,
}

fn rate(interval: [u32; 2]) -> f64 {
    f64::from(interval[1]) / f64::from(interval[0].max(1))
}

/// Whether the given rate equals the requested one.
pub(crate) fn is_same_rate(asked_hz: f64, given_hz: f64) -> bool {
    (given_hz - asked_hz).abs() <= SAME_RATE * asked_hz
}

impl Sizes {
    pub(crate) fn holds(&self, size: [u32; 2]) -> bool {
        (0..2).all(|side| {
            (self.min[side]..=self.max[side]).contains(&size[side])
                && (size[side] - self.min[side]).is_multiple_of(self.step[side].max(1))
        })
    }

    fn in_words(&self) -> String {
        let [width, height] = self.max;
        if self.min == self.max {
            return format!("{width} x {height}");
        }
        let [least_width, least_height] = self.min;
        let [wide, high] = self.step;
        let steps = if wide <= 1 && high <= 1 { String::new() } else { format!(" in steps of {wide} x {high}") };
        format!("{least_width} x {least_height} to {width} x {height}{steps}")
    }
}

impl Rates {
    /// The interval to ask for, where the rate is offered.
    pub(crate) fn interval(&self, rate_hz: f64) -> Option<[u32; 2]> {
        let of_its_own = [1000, (rate_hz * 1000.0).round() as u32];
        match self {
            Rates::Only(list) => list.iter().copied().find(|&it| is_same_rate(rate_hz, rate(it))),
            Rates::Between(short, long) => {
                let fits = rate_hz <= rate(*short) * (1.0 + SAME_RATE) && rate_hz >= rate(*long) * (1.0 - SAME_RATE);
                fits.then_some(of_its_own)
            }
            Rates::Unknown => Some(of_its_own),
        }
    }

    fn in_words(&self) -> String {
        let hz = |interval: [u32; 2]| {
            let text = format!("{:.3}", rate(interval));
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        };
        match self {
            Rates::Only(list) => format!("{} Hz", list.iter().map(|&it| hz(it)).collect::<Vec<_>>().join(", ")),
            Rates::Between(short, long) => format!("{} to {} Hz", hz(*long), hz(*short)),
            Rates::Unknown => "rates not reported".to_owned(),
        }
    }
}

/// Picks the layout, and the interval where a rate is wanted.
///
/// # Errors
/// The setting that the camera cannot keep, and what it offers instead.
pub(crate) fn choose(offers: &[Offer], wanted: &Wanted) -> Result<(FourCc, Option<[u32; 2]>), ConfigError> {
    let in_layout: Vec<&Offer> =
        wanted.layouts.iter().filter_map(|layout| offers.iter().find(|it| it.fourcc == *layout)).collect();
    if in_layout.is_empty() {
        let names =
            |list: &[FourCc]| list.iter().map(|it| format!("`{}`", in_letters(*it))).collect::<Vec<_>>().join(", ");
        let offered = offers.iter().map(|it| it.fourcc).collect::<Vec<_>>();
        let expected = if offered.is_empty() { "no layout at all".to_owned() } else { names(&offered) };
        let message = format!("the device has none of {}; it offers {expected}", names(&wanted.layouts));
        return Err(ConfigError::at("device_format", message));
    }
    let [width, height] = wanted.size;
    let in_size: Vec<(&Offer, &Sizes)> = in_layout
        .iter()
        .filter_map(|offer| Some((*offer, offer.sizes.iter().find(|it| it.holds(wanted.size))?)))
        .collect();
    if in_size.is_empty() {
        let mut message = format!("the device does not give {width} x {height} px; it offers");
        for offer in in_layout {
            let sizes = offer.sizes.iter().map(Sizes::in_words).collect::<Vec<_>>().join(", ");
            let _ = write!(message, " `{}`: {sizes};", in_letters(offer.fourcc));
        }
        return Err(ConfigError::at("width", message.trim_end_matches(';')));
    }
    let Some(rate_hz) = wanted.rate_hz else { return Ok((in_size[0].0.fourcc, None)) };
    let found = in_size.iter().find_map(|(offer, sizes)| Some((offer.fourcc, sizes.rates.interval(rate_hz)?)));
    found.map(|(fourcc, interval)| (fourcc, Some(interval))).ok_or_else(|| {
        let mut message = format!("the device does not give {rate_hz} Hz at {width} x {height} px; it offers");
        for (offer, sizes) in in_size {
            let _ = write!(message, " `{}`: {};", in_letters(offer.fourcc), sizes.rates.in_words());
        }
        ConfigError::at("rate_hz", message.trim_end_matches(';'))
    })
}

/// All offers, a line for each size.
pub(crate) fn in_lines(offers: &[Offer], indent: &str) -> String {
    let mut text = String::new();
    for offer in offers {
        let _ = writeln!(text, "{indent}{}  {}", in_letters(offer.fourcc), offer.description);
        for sizes in &offer.sizes {
            let _ = writeln!(text, "{indent}  {} px at {}", sizes.in_words(), sizes.rates.in_words());
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(size: [u32; 2], rates: Rates) -> Sizes {
        Sizes { min: size, max: size, step: [1, 1], rates }
    }

    fn offers() -> Vec<Offer> {
        let slow = Rates::Only(vec![[1, 30], [1, 15]]);
        let any = Sizes { min: [16, 16], max: [1920, 1080], step: [8, 2], rates: Rates::Between([1, 60], [1, 5]) };
        vec![
            Offer { fourcc: *b"YUYV", description: "YUYV 4:2:2".to_owned(), sizes: vec![one([640, 480], slow)] },
            Offer { fourcc: *b"MJPG", description: "Motion-JPEG".to_owned(), sizes: vec![any] },
        ]
    }

    #[track_caller]
    fn chosen(
        layouts: &[&FourCc],
        size: [u32; 2],
        rate_hz: Option<f64>,
    ) -> Result<(FourCc, Option<[u32; 2]>), ConfigError> {
        choose(&offers(), &Wanted { layouts: layouts.iter().map(|it| **it).collect(), size, rate_hz })
    }

    #[test]
    fn first_layout_that_has_size_and_rate_is_taken() {
        let both: [&FourCc; 3] = [b"GREY", b"YUYV", b"MJPG"];
        assert_eq!(chosen(&both, [640, 480], None), Ok((*b"YUYV", None)));
        assert_eq!(chosen(&both, [640, 480], Some(29.97)), Ok((*b"YUYV", Some([1, 30]))));
        assert_eq!(chosen(&both, [640, 480], Some(60.0)), Ok((*b"MJPG", Some([1000, 60_000]))));
        assert_eq!(chosen(&both, [1280, 720], None), Ok((*b"MJPG", None)));
    }

    #[test]
    fn refusal_names_the_setting_and_what_is_offered() {
        let refused = |result: Result<_, ConfigError>| {
            let error = result.unwrap_err();
            (error.setting.unwrap(), error.message)
        };
        let (setting, message) = refused(chosen(&[b"GREY"], [640, 480], None));
        assert_eq!(setting, "device_format");
        assert_eq!(message, "the device has none of `GREY`; it offers `YUYV`, `MJPG`");
        let (setting, message) = refused(chosen(&[b"YUYV", b"MJPG"], [641, 480], None));
        assert_eq!(setting, "width");
        assert_eq!(
            message,
            "the device does not give 641 x 480 px; it offers `YUYV`: 640 x 480; `MJPG`: 16 x 16 to 1920 x 1080 in steps of 8 x 2"
        );
        let (setting, message) = refused(chosen(&[b"YUYV", b"MJPG"], [640, 480], Some(90.0)));
        assert_eq!(setting, "rate_hz");
        assert_eq!(
            message,
            "the device does not give 90 Hz at 640 x 480 px; it offers `YUYV`: 30, 15 Hz; `MJPG`: 5 to 60 Hz"
        );
        let nothing = choose(&[], &Wanted { layouts: vec![*b"GREY"], size: [2, 2], rate_hz: None });
        assert!(nothing.unwrap_err().message.ends_with("no layout at all"));
    }

    #[test]
    fn list_names_every_size() {
        let text = in_lines(&offers(), "  ");
        assert_eq!(text.lines().count(), 4);
        assert!(text.contains("    640 x 480 px at 30, 15 Hz"), "{text}");
    }
}
