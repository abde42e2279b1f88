//! Colours of series and backgrounds, and colour maps.

/// Ten colours of series that stay apart for most eyes and in gray: the eight of M. Okabe and K. Ito, "Color universal design",
/// 2008, without black and with a darker yellow, and three dark ones of P. Tol, "Colour schemes", SRON/EPS/TN/09-002.
pub const COLOURS: [&str; 10] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#332288", "#56b4e9", "#882255", "#8a8a00", "#8c564b"];
/// Colour of series without one of their own.
pub const OTHERS: &str = "#b3a58f";
/// Colour of a reference, behind all else.
pub const REFERENCE: &str = "#9a9a9a";

/// Colours of everything that is not data. Any colour that SVG knows, or `var(--…)` within a page that declares it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Theme {
    /// Colour of titles and labels.
    pub ink: &'static str,
    /// Colour of numbers at axes.
    pub muted: &'static str,
    /// Colour of grid lines.
    pub grid: &'static str,
    /// Colour of frames.
    pub edge: &'static str,
    /// Colour of the background.
    pub paper: &'static str,
}

/// The default theme: dark on white.
pub const PAPER: Theme = Theme { ink: "#222222", muted: "#333333", grid: "#e4e4e4", edge: "#222222", paper: "#ffffff" };

/// Colour map from pale yellow (0) over green to dark blue (1): ever darker, so that it reads in gray too.
pub fn shade(part: f64) -> String {
    const STOPS: [[f64; 3]; 5] =
        [[253.0, 231.0, 120.0], [122.0, 209.0, 81.0], [34.0, 168.0, 132.0], [42.0, 120.0, 142.0], [65.0, 44.0, 110.0]];
    let part = if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) };
    let place = part * (STOPS.len() - 1) as f64;
    let (low, high) = (STOPS[place.floor() as usize], STOPS[place.ceil() as usize]);
    let [red, green, blue] =
        [0, 1, 2].map(|it| (low[it] * (1.0 - place.fract()) + high[it] * place.fract()).round() as u8);
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// One of `n` levels for a part of the largest value; level 0 only for 0.
pub fn level(part: f64, n: usize) -> usize {
    let most = n.saturating_sub(1);
    if part > 0.0 { ((part * most as f64).ceil() as usize).clamp(1, most.max(1)) } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brightness(colour: &str) -> f64 {
        let part = |at: usize| f64::from(u8::from_str_radix(&colour[at..at + 2], 16).unwrap());
        0.299 * part(1) + 0.587 * part(3) + 0.114 * part(5)
    }

    #[test]
    fn shades_run_from_pale_to_dark() {
        assert!(
            (0..17).all(|it| brightness(&shade(f64::from(it) / 17.0)) > brightness(&shade(f64::from(it + 1) / 17.0)))
        );
        assert_eq!([shade(f64::NAN), shade(2.0)], [shade(0.0), shade(1.0)]);
    }

    #[test]
    fn every_colour_stands_out_from_white_paper() {
        assert!(COLOURS.iter().all(|it| brightness(it) < 180.0));
    }

    #[test]
    fn levels_leave_the_first_to_nothing() {
        assert_eq!([-1.0, 0.0, 1e-9, 0.2, 0.21, 1.0, 7.0, f64::NAN].map(|it| level(it, 6)), [0, 0, 1, 1, 2, 5, 5, 0]);
    }
}
