//! Checks arguments about scale and axes against the rig before anything is captured: names, times and lengths.

use std::collections::BTreeSet;

use foveate_calibration::axes::{Given, Place};
use foveate_diagnostics::names::likely;
use nalgebra::Point3;

/// Longest distance in a room [m].
const LONGEST_M: f64 = 1e5;
/// Points of an L-frame closer to a line than this part of their spread fix no axes [–].
const LINE: f64 = 1e-6;

/// What is known before a capture.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// The rig's cameras.
    pub cameras: &'a [&'a str],
    /// Of these, the ones that are used, where some are left out.
    pub used: &'a [&'a str],
    /// How many lights there are; `None` where their labels are not known beforehand.
    pub lights: Option<u32>,
    /// How long the session lasts at most [s].
    pub duration_s: Option<f64>,
}

/// Refuses arguments that no capture can satisfy.
///
/// # Errors
/// A sentence for the person that says which flag, what was found and what is possible.
pub fn check(givens: &[Given], known: &Known<'_>) -> Result<(), String> {
    for given in givens {
        let flag = match given {
            Given::WandLength { .. } | Given::CamerasUpright => continue,
            Given::Distance { .. } => "--distance",
            Given::Points { .. } => "--l-frame",
            Given::Floor { .. } => "--floor-stops",
            Given::Falling { .. } => "--falling",
            Given::Plumb { .. } => "--plumb",
        };
        one(given, known).map_err(|it| format!("error: {flag}: {it}"))?;
    }
    Ok(())
}

fn one(given: &Given, known: &Known<'_>) -> Result<(), String> {
    match given {
        Given::WandLength { .. } | Given::CamerasUpright => Ok(()),
        Given::Distance { a, b, metres, .. } => {
            if !(*metres > 0.0 && *metres <= LONGEST_M) {
                return Err(format!("the length of {a} to {b} is {metres} m, expected more than 0, to {LONGEST_M} m"));
            }
            two(a, b, known)
        }
        Given::Plumb { top, bottom, .. } => two(top, bottom, known),
        Given::Points { known: points, .. } => {
            points.iter().try_for_each(|it| place(&it.0, known))?;
            for (index, (of, at)) in points.iter().enumerate() {
                if !at.coords.norm().is_finite() || at.coords.amax() > LONGEST_M {
                    return Err(format!("{of} is at {at}, expected coordinates in metres"));
                }
                if let Some(twice) = points[..index].iter().find(|it| it.0 == *of) {
                    return Err(format!("{of} is given twice, at {} and at {at}", twice.1));
                }
            }
            if points.len() < 3 {
                return Err(format!("{} places, expected at least 3", points.len()));
            }
            let coordinates: Vec<Point3<f64>> = points.iter().map(|it| it.1).collect();
            if on_a_line(&coordinates) {
                return Err("all places lie on a line, expected one beside it".to_owned());
            }
            Ok(())
        }
        Given::Floor { places, height_m, .. } => {
            if !height_m.is_finite() {
                return Err(format!("the height of the light is {height_m} m, expected a number"));
            }
            places.iter().try_for_each(|it| place(it, known))
        }
        Given::Falling { label, from_s, until_s } => {
            place(&Place::Light { label: *label, from_s: *from_s, until_s: *until_s }, known)
        }
    }
}

fn two(a: &Place, b: &Place, known: &Known<'_>) -> Result<(), String> {
    place(a, known)?;
    place(b, known)?;
    if a == b { Err(format!("both places are {a}, expected two")) } else { Ok(()) }
}

fn place(place: &Place, known: &Known<'_>) -> Result<(), String> {
    let label = match place {
        Place::Camera(name) => return camera(name, known),
        Place::Stop { label, .. } => label,
        Place::Light { label, from_s, until_s } => {
            if *from_s < 0.0 || !until_s.is_finite() {
                return Err(format!("{place} is not a span of a session, which begins at 0 s"));
            }
            if let Some(duration_s) = known.duration_s.filter(|it| until_s > it) {
                return Err(format!("{place} is after the end of the session, which lasts {duration_s} s"));
            }
            label
        }
    };
    match known.lights {
        Some(lights) if *label >= lights => {
            let them = if lights == 1 {
                "one light, 0 (two with --wand-mm)".to_owned()
            } else {
                format!("lights 0 to {}", lights - 1)
            };
            Err(format!("{place} is of light {label}, expected {them}"))
        }
        _ => Ok(()),
    }
}

fn camera(name: &str, known: &Known<'_>) -> Result<(), String> {
    if known.used.contains(&name) {
        return Ok(());
    }
    if known.cameras.contains(&name) {
        return Err(format!("camera {name} is left out by --cameras"));
    }
    let unique: BTreeSet<&str> = known.used.iter().copied().collect();
    let meant = likely(name, unique.iter().copied()).map_or(String::new(), |it| format!(" (did you mean {it}?)"));
    let list: Vec<&str> = known.used.to_vec();
    Err(format!(
        "there is no camera {name}{meant}; the cameras are {}. A place where the light was begins with @",
        list.join(", ")
    ))
}

fn on_a_line(points: &[Point3<f64>]) -> bool {
    let first = points[0];
    let farthest = points.iter().map(|it| it - first).max_by(|a, b| a.norm().total_cmp(&b.norm()));
    let Some(along) = farthest.filter(|it| it.norm() > 0.0) else { return true };
    points.iter().all(|it| (it - first).cross(&along).norm() <= LINE * along.norm_squared())
}

#[cfg(test)]
mod tests {
    use foveate_calibration::axes::AxesArgs;

    use super::*;

    #[track_caller]
    fn found(change: impl Fn(&mut AxesArgs)) -> Result<(), String> {
        let mut args = AxesArgs::default();
        change(&mut args);
        let cameras = ["wide-1", "wide-2", "wide-3"];
        let known = Known { cameras: &cameras, used: &cameras[..2], lights: Some(1), duration_s: Some(60.0) };
        check(&args.givens().unwrap(), &known)
    }

    #[test]
    fn what_can_be_passes() {
        found(|it| it.distance("wide-1:wide-2=3.2m")).unwrap();
        found(|it| it.distance("@1:@12.5..13.1=3.2m")).unwrap();
        found(|it| it.l_frame = ["@1=0,0,0", "@2=1,0,0.5", "wide-1=0,1,2"].map(str::to_owned).to_vec()).unwrap();
        found(|it| it.plumb = Some("@1:@2".into())).unwrap();
        found(|it| it.floor_stops = true).unwrap();
    }

    #[test]
    fn what_cannot_be_is_named_with_what_was_meant() {
        let frame = |list: &[&str]| -> Vec<String> { list.iter().map(|it| (*it).to_owned()).collect() };
        type Case<'a> = (&'a dyn Fn(&mut AxesArgs), &'a str);
        let cases: [Case<'_>; 13] = [
            (
                &|it| it.distance("wide1:wide-2=3.2m"),
                "--distance: there is no camera wide1 (did you mean wide-1?); the cameras are wide-1, wide-2",
            ),
            (&|it| it.distance("wide-1:wide-3=3.2m"), "wide-3 is left out by --cameras"),
            (&|it| it.distance("wide-1:wide-1=3.2m"), "both places are wide-1"),
            (&|it| it.distance("wide-1:wide-2=-3.2m"), "is -3.2 m"),
            (&|it| it.distance("wide-1:wide-2=0mm"), "is 0 m"),
            (&|it| it.distance("wide-1:wide-2=NaNm"), "is NaN m"),
            (&|it| it.distance("@1:@2/1=1m"), "@2/1 is of light 1, expected one light, 0"),
            (
                &|it| it.plumb = Some("@1:@70..71".into()),
                "--plumb: @70.0..71.0 is after the end of the session, which lasts 60 s",
            ),
            (&|it| it.falling = vec!["-2..1".into()], "--falling: @-2.0..1.0 is "),
            (
                &|it| it.l_frame = frame(&["@1=0,0,0", "@2=1,0,0", "wide-9=0,1,0"]),
                "--l-frame: there is no camera wide-9 (did you mean wide-",
            ),
            (&|it| it.l_frame = frame(&["@1=0,0,0", "@2=1,0,0"]), "2 places, expected at least 3"),
            (&|it| it.l_frame = frame(&["@1=0,0,0", "@2=1,0,0", "@3=2,0,0"]), "lie on a line"),
            (&|it| it.l_frame = frame(&["@1=0,0,0", "@1=1,0,0", "@3=0,2,0"]), "@1 is given twice"),
        ];
        for (change, words) in cases {
            let fault = found(change).unwrap_err();
            assert!(fault.contains(words), "{fault}\n  expected {words}");
        }
    }

    trait Distance {
        fn distance(&mut self, text: &str);
    }

    impl Distance for AxesArgs {
        fn distance(&mut self, text: &str) {
            self.distances.push(text.to_owned());
        }
    }
}
