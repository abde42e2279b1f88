//! Scale and axes as text on a command line.
//!
//! | place | means |
//! |---|---|
//! | `wide-1` | the camera of that name |
//! | `@2` | where the light stood still for the second time |
//! | `@12.5..13.1` | where the light was on average from 12.5 s to 13.1 s |
//! | `@2/1`, `@12.5..13.1/1` | the same of light 1 instead of light 0 |

use std::fmt;
use std::str::FromStr;

use nalgebra::Point3;

use super::{Given, Place};

/// Lengths that a person measures are taken as right to this [m], where they do not say otherwise.
const TAPE_SIGMA_M: f64 = 2e-3;
/// Wands are taken as right to this [m].
const WAND_SIGMA_M: f64 = 2e-4;
/// L-frames and lights laid on a floor are taken as right to this [m].
const FRAME_SIGMA_M: f64 = 1e-3;
/// Lights on a plumb line are taken as within this part of their distance of it [–].
const PLUMB_SIGMA: f64 = 3e-3;

/// Command-line arguments that fix scale and axes, one field a flag; [`Self::givens`] parses them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AxesArgs {
    /// Length of the wand, whose ends are lights 0 and 1 [mm].
    pub wand_mm: Option<f64>,
    /// Each `PLACE:PLACE=LENGTH`, such as `wide-1:wide-2=3.2m`, with `m`, `cm` or `mm`.
    pub distances: Vec<String>,
    /// Whether the first three or more stops are places on the floor: the origin, on the X axis, elsewhere.
    pub floor_stops: bool,
    /// How many stops lie on the floor [–]; 3 when not said.
    pub n_floor_stops: Option<usize>,
    /// Height of the light's centre above the floor at those stops [mm].
    pub floor_height_mm: Option<f64>,
    /// Each `PLACE=X,Y,Z` in metres, such as `@1=0,0,0`.
    pub l_frame: Vec<String>,
    /// A span such as `12.5..13.1` [s].
    pub falling: Vec<String>,
    /// `TOP:BOTTOM`, two places.
    pub plumb: Option<String>,
    /// Whether to assume that cameras are mounted without roll.
    pub upright: bool,
}

/// An argument that cannot be parsed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} is {found:?}, expected {expected}")]
pub struct AxesArgError {
    /// Which flag or part of it.
    pub what: &'static str,
    /// What was typed.
    pub found: String,
    /// What may be typed.
    pub expected: &'static str,
}

impl AxesArgs {
    /// The parsed sources, in the order of the fields.
    ///
    /// # Errors
    /// See [`AxesArgError`].
    pub fn givens(&self) -> Result<Vec<Given>, AxesArgError> {
        let mut givens = Vec::new();
        if let Some(length_mm) = self.wand_mm {
            givens.push(Given::WandLength { ends: [0, 1], metres: length_mm / 1e3, sigma_m: WAND_SIGMA_M });
        }
        for text in &self.distances {
            givens.push(distance(text)?);
        }
        if !self.l_frame.is_empty() {
            let known = self.l_frame.iter().map(|it| known_point(it)).collect::<Result<_, _>>()?;
            givens.push(Given::Points { known, sigma_m: FRAME_SIGMA_M });
        }
        if self.floor_stops || self.n_floor_stops.is_some() {
            let places = (1..=self.n_floor_stops.unwrap_or(3)).map(|number| Place::Stop { label: 0, number }).collect();
            let height_m = self.floor_height_mm.unwrap_or(0.0) / 1e3;
            givens.push(Given::Floor { places, height_m, sigma_m: FRAME_SIGMA_M });
        }
        for text in &self.falling {
            let (from_s, until_s) = span("a fall", text)?;
            givens.push(Given::Falling { label: 0, from_s, until_s });
        }
        if let Some(text) = &self.plumb {
            let expected = "TOP:BOTTOM, such as @1:@2";
            let fault = || AxesArgError { what: "a plumb line", found: text.clone(), expected };
            let (top, bottom) = text.split_once(':').ok_or_else(fault)?;
            givens.push(Given::Plumb { top: top.parse()?, bottom: bottom.parse()?, sigma: PLUMB_SIGMA });
        }
        if self.upright {
            givens.push(Given::CamerasUpright);
        }
        Ok(givens)
    }
}

fn distance(text: &str) -> Result<Given, AxesArgError> {
    let expected = "PLACE:PLACE=LENGTH, such as wide-1:wide-2=3.2m";
    let fault = || AxesArgError { what: "a distance", found: text.to_owned(), expected };
    let (places, length) = text.split_once('=').ok_or_else(fault)?;
    let (a, b) = places.split_once(':').ok_or_else(fault)?;
    Ok(Given::Distance { a: a.parse()?, b: b.parse()?, metres: metres(length)?, sigma_m: TAPE_SIGMA_M })
}

fn metres(text: &str) -> Result<f64, AxesArgError> {
    let trimmed = text.trim();
    let (number, factor) = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)]
        .into_iter()
        .find_map(|(unit, factor)| Some((trimmed.strip_suffix(unit)?, factor)))
        .unwrap_or(("", 1.0));
    let expected = "a number with its unit, such as 3.2m, 320cm or 3200mm";
    let fault = |_| AxesArgError { what: "a length", found: text.to_owned(), expected };
    number.trim().parse::<f64>().map(|it| it * factor).map_err(fault)
}

fn known_point(text: &str) -> Result<(Place, Point3<f64>), AxesArgError> {
    let expected = "PLACE=X,Y,Z in metres, such as @1=0,0,0";
    let fault = || AxesArgError { what: "a point of the L-frame", found: text.to_owned(), expected };
    let (place, coordinates) = text.split_once('=').ok_or_else(fault)?;
    let numbers: Vec<f64> =
        coordinates.split(',').map(|it| it.trim().parse().map_err(|_| fault())).collect::<Result<_, _>>()?;
    let &[x, y, z] = numbers.as_slice() else { return Err(fault()) };
    Ok((place.parse()?, Point3::new(x, y, z)))
}

fn span(what: &'static str, text: &str) -> Result<(f64, f64), AxesArgError> {
    let fault =
        || AxesArgError { what, found: text.to_owned(), expected: "FROM..UNTIL in seconds, such as 12.5..13.1" };
    let (from, until) = text.split_once("..").ok_or_else(fault)?;
    let number = |it: &str| it.trim().parse::<f64>().ok().filter(|it| it.is_finite());
    number(from).zip(number(until)).filter(|(from, until)| from < until).ok_or_else(fault)
}

impl FromStr for Place {
    type Err = AxesArgError;

    fn from_str(text: &str) -> Result<Self, AxesArgError> {
        let expected = "a camera's name, @2 for the light's second stop, or @12.5..13.1 for a span of time";
        let fault = || AxesArgError { what: "a place", found: text.to_owned(), expected };
        let trimmed = text.trim();
        let Some(light) = trimmed.strip_prefix('@') else {
            return if trimmed.is_empty() { Err(fault()) } else { Ok(Place::Camera(trimmed.to_owned())) };
        };
        let (light, label) = match light.split_once('/') {
            Some((light, label)) => (light, label.parse().map_err(|_| fault())?),
            None => (light, 0),
        };
        if light.contains("..") {
            let (from_s, until_s) = span("a place", light).map_err(|_| fault())?;
            return Ok(Place::Light { label, from_s, until_s });
        }
        let number = light.parse().ok().filter(|it| *it > 0).ok_or_else(fault)?;
        Ok(Place::Stop { label, number })
    }
}

impl fmt::Display for Place {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let label = match self {
            Place::Camera(name) => return to.write_str(name),
            Place::Stop { label, number } => {
                write!(to, "@{number}")?;
                label
            }
            Place::Light { label, from_s, until_s } => {
                write!(to, "@{from_s:?}..{until_s:?}")?;
                label
            }
        };
        if *label > 0 { write!(to, "/{label}") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_parsed() {
        let args = AxesArgs {
            wand_mm: Some(400.0),
            distances: vec!["wide-1: @2/1=320cm".into()],
            floor_stops: true,
            floor_height_mm: Some(20.0),
            l_frame: vec!["@1=0,0,0".into(), "@2=0.6, 0, 0".into()],
            falling: vec!["12.5..13.1".into()],
            plumb: Some("@1.5..2.5:@4".into()),
            upright: true,
            ..AxesArgs::default()
        };
        let stop = |number, label| Place::Stop { label, number };
        let givens = args.givens().unwrap();
        let expected = [
            Given::WandLength { ends: [0, 1], metres: 0.4, sigma_m: WAND_SIGMA_M },
            Given::Distance { a: Place::Camera("wide-1".into()), b: stop(2, 1), metres: 3.2, sigma_m: TAPE_SIGMA_M },
            Given::Points {
                known: vec![(stop(1, 0), Point3::origin()), (stop(2, 0), Point3::new(0.6, 0.0, 0.0))],
                sigma_m: FRAME_SIGMA_M,
            },
            Given::Floor { places: (1..4).map(|it| stop(it, 0)).collect(), height_m: 0.02, sigma_m: FRAME_SIGMA_M },
            Given::Falling { label: 0, from_s: 12.5, until_s: 13.1 },
            Given::Plumb {
                top: Place::Light { label: 0, from_s: 1.5, until_s: 2.5 },
                bottom: stop(4, 0),
                sigma: PLUMB_SIGMA,
            },
            Given::CamerasUpright,
        ];
        assert_eq!(givens, expected);
        assert_eq!(AxesArgs::default().givens(), Ok(vec![]));
    }

    #[test]
    fn places_come_back_from_their_text() {
        for text in ["wide-1", "@2", "@2/3", "@1.5..2.25", "@1.5..2.0/7"] {
            assert_eq!(text.parse::<Place>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn an_argument_that_cannot_be_parsed_is_named() {
        let fails = |args: AxesArgs, what: &str, found: &str| {
            let fault = args.givens().unwrap_err();
            assert_eq!((fault.what, fault.found.as_str()), (what, found), "{fault}");
        };
        let distance = |text: &str| AxesArgs { distances: vec![text.into()], ..AxesArgs::default() };
        fails(distance("wide-1"), "a distance", "wide-1");
        fails(distance("a:b=3"), "a length", "3");
        fails(distance("a:=3m"), "a place", "");
        fails(distance("a:@0=3m"), "a place", "@0");
        fails(distance("a:@3..1=3m"), "a place", "@3..1");
        fails(AxesArgs { l_frame: vec!["@1=0,0".into()], ..AxesArgs::default() }, "a point of the L-frame", "@1=0,0");
        fails(AxesArgs { falling: vec!["3".into()], ..AxesArgs::default() }, "a fall", "3");
        fails(AxesArgs { plumb: Some("@1".into()), ..AxesArgs::default() }, "a plumb line", "@1");
    }
}
