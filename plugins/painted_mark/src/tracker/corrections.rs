//! Corrections by hand: positions of marks in pictures [Davis 2002 §5.1, Fig. 56].
//!
//! A table with the heading `camera,mark,frame,u_px,v_px`. `frame` is the sequence number of the picture; a row without a place says that the mark is not visible
//! from there on, until it is found again.

use foveate::diagnostics::fields::Splitter;
use nalgebra::Point2;

/// One row for this camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// The picture that it is about.
    pub frame: u64,
    /// Which mark.
    pub mark: u32,
    /// Its position in raw pixels of the camera; `None`: not visible from here on.
    pub pixel: Option<Point2<f64>>,
}

const HEADING: [&str; 5] = ["camera", "mark", "frame", "u_px", "v_px"];

/// Reads the rows for `camera`, ascending by frame and mark; all rows where there is no such name. `known` says which names of cameras there are.
///
/// # Errors
/// A sentence that names the line, what was found and what is expected: another heading, a row of another length, an unknown camera, what is not a
/// number or only half a place, two rows for the same mark and picture.
pub fn read(text: &str, camera: Option<&str>, known: impl Fn(&str) -> bool) -> Result<Vec<Correction>, String> {
    let mut rows: Vec<(Correction, usize)> = Vec::new();
    let mut has_heading = false;
    let mut splitter = Splitter::new(',');
    for (line, text) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let fields = splitter.split(text);
        if !has_heading {
            if !fields.iter().eq(HEADING) {
                return Err(format!("line {line}: found `{text}`, expected the heading `{}`", HEADING.join(",")));
            }
            has_heading = true;
            continue;
        }
        if fields.len() != HEADING.len() {
            return Err(format!(
                "line {line}: found {} fields, expected the 5 of `{}`",
                fields.len(),
                HEADING.join(",")
            ));
        }
        let [name, mark, frame, u, v] = [0, 1, 2, 3, 4].map(|it| fields.text(it));
        let whole = |what: &str, text: &str| -> Result<u64, String> {
            text.parse().map_err(|_| format!("line {line}: found `{text}` as {what}, expected a whole number"))
        };
        let number = |what: &str, text: &str| -> Result<f64, String> {
            let value = text.parse().ok().filter(|it: &f64| it.is_finite());
            value
                .ok_or_else(|| format!("line {line}: found `{text}` as {what}, expected a number of pixels or nothing"))
        };
        let mark = u32::try_from(whole("mark", mark)?)
            .map_err(|_| format!("line {line}: found the mark {mark}, expected a number up to {}", u32::MAX))?;
        let frame = whole("frame", frame)?;
        let pixel = match (u, v) {
            ("", "") => None,
            ("", _) | (_, "") => {
                return Err(format!("line {line}: found one coordinate, `{u},{v}`, expected two numbers or none"));
            }
            (u, v) => Some(Point2::new(number("u_px", u)?, number("v_px", v)?)),
        };
        if camera.is_none_or(|it| it == name) {
            rows.push((Correction { frame, mark, pixel }, line));
        } else if !known(name) {
            return Err(format!("line {line}: found the camera `{name}`, expected one of the calibration"));
        }
    }
    if !has_heading {
        return Err(format!("found nothing, expected the heading `{}`", HEADING.join(",")));
    }
    rows.sort_by_key(|(it, line)| (it.frame, it.mark, *line));
    for pair in rows.windows(2) {
        let [(a, first), (b, second)] = [pair[0], pair[1]];
        if (a.frame, a.mark) == (b.frame, b.mark) {
            let (mark, frame) = (a.mark, a.frame);
            return Err(format!(
                "line {second}: found mark {mark} in frame {frame} again after line {first}, expected one place"
            ));
        }
    }
    Ok(rows.into_iter().map(|it| it.0).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> Result<Vec<Correction>, String> {
        read(text, Some("ptz-1"), |it| it.starts_with("ptz-"))
    }

    #[test]
    fn rows_of_this_camera_come_in_the_order_of_pictures() {
        let text = "\u{feff}camera, mark, frame, u_px, v_px\r\n# by hand\r\nptz-1,7,12,,\r\nptz-2,1,0,1,2\r\n\r\nptz-1,7,0,10.5,-2\r\nptz-1,3,0,1,2\r\n";
        let row = |frame, mark, pixel: Option<[f64; 2]>| Correction { frame, mark, pixel: pixel.map(Point2::from) };
        let expected = vec![row(0, 3, Some([1.0, 2.0])), row(0, 7, Some([10.5, -2.0])), row(12, 7, None)];
        assert_eq!(rows(text), Ok(expected));
        assert_eq!(read(text, None, |_| false).map(|it| it.len()), Ok(4), "without a camera, all");
    }

    #[test]
    fn names_in_quotes_hold_commas() {
        let text = "camera,mark,\"frame\",u_px,v_px\r\n\"ptz-1, left\", \"7\",12,1,2\r\n";
        let found = read(text, Some("ptz-1, left"), |_| false).unwrap();
        assert_eq!(found, [Correction { frame: 12, mark: 7, pixel: Some(Point2::new(1.0, 2.0)) }]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let after = |row: &str| rows(&format!("camera,mark,frame,u_px,v_px\n{row}\n")).unwrap_err();
        for (row, part) in [
            ("ptz-1,1,0,2", "4 fields"),
            ("\"ptz-1,1\",0,2", "3 fields"),
            ("ptz-1,x,0,2,3", "`x` as mark"),
            ("ptz-1,1,-1,2,3", "`-1` as frame"),
            ("ptz-1,5000000000,0,2,3", "5000000000"),
            ("ptz-1,1,0,nan,3", "`nan` as u_px"),
            ("ptz-1,1,0,2,", "one coordinate"),
            ("nobody,1,0,2,3", "`nobody`"),
        ] {
            let message = after(row);
            assert!(
                message.contains(part) && message.starts_with("line 2") && message.contains("expected"),
                "{message}"
            );
        }
        assert!(
            after("ptz-1,1,0,2,3\nptz-1,1,0,4,5").starts_with("line 3: found mark 1 in frame 0 again after line 2")
        );
        assert!(rows("").unwrap_err().contains("expected the heading"));
        assert!(rows("mark,frame\n").unwrap_err().contains("line 1"));
    }
}
