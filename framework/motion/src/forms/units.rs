//! Units of length by name.

use crate::motion::Motion;

/// Length of the unit of this name [m]; `None`: unknown.
pub fn unit_length(name: &str) -> Option<f64> {
    let name = name.trim().to_lowercase().replace("metre", "meter");
    let singular = name.strip_suffix('s').filter(|it| it.len() > 2).unwrap_or(&name);
    Some(match singular {
        "m" | "meter" => 1.0,
        "dm" | "decimeter" => 0.1,
        "cm" | "centimeter" => 0.01,
        "mm" | "millimeter" => 0.001,
        "um" | "µm" | "μm" | "micrometer" => 1e-6,
        "in" | "inch" | "inche" => 0.0254,
        "ft" | "foot" | "feet" => 0.3048,
        _ => return None,
    })
}

/// Coordinates that stay below this are metres where a file has no unit: a room of 20 mm is none.
const MOST_METRES: f64 = 20.0;

/// The unit of a file that calls it `name`: what the user says, what the name says, or a guess by the largest coordinate, with a remark.
pub(super) fn unit(name: &str, stated: Option<f64>, largest: f64, remarks: &mut Vec<String>) -> (String, f64) {
    let by_name = unit_length(name);
    match (stated, by_name) {
        (Some(stated), _) => {
            let known = [("mm", 0.001), ("cm", 0.01), ("m", 1.0)].into_iter().find(|it| it.1 == stated);
            (known.map_or(name, |it| it.0).to_owned(), stated)
        }
        (None, Some(length)) => (name.trim().to_owned(), length),
        (None, None) => {
            let (guess, length) = if largest < MOST_METRES { ("m", 1.0) } else { ("mm", 0.001) };
            let found = if name.is_empty() { "no unit".to_owned() } else { format!("the unit `{name}`") };
            remarks.push(format!(
                "found {found} and coordinates up to {largest:.3}, expected mm, cm or m; taken: {guess} (another: --metres-per-unit)"
            ));
            (guess.to_owned(), length)
        }
    }
}

/// The unit in which a motion is written: the requested one, its own, or millimetres.
pub(super) fn unit_to_write(motion: &Motion, asked: Option<&str>) -> (String, f64) {
    let asked = asked.and_then(|it| Some((it.to_owned(), unit_length(it)?)));
    let own = || motion.unit.clone().filter(|it| unit_length(&it.0) == Some(it.1));
    asked.or_else(own).unwrap_or_else(|| ("mm".to_owned(), 0.001))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_go_by_many_names() {
        for (name, length) in
            [("mm", 0.001), ("MM", 0.001), (" cm ", 0.01), ("meters", 1.0), ("Millimetres", 0.001), ("inches", 0.0254)]
        {
            assert_eq!(unit_length(name), Some(length), "{name}");
        }
        assert_eq!((unit_length(""), unit_length("px"), unit_length("s")), (None, None, None));
    }

    #[test]
    fn a_missing_unit_is_guessed_and_said() {
        let mut remarks = Vec::new();
        assert_eq!(unit("", None, 1.8, &mut remarks), ("m".to_owned(), 1.0));
        assert_eq!(unit("furlong", None, 1800.0, &mut remarks), ("mm".to_owned(), 0.001));
        assert!(remarks[0].contains("no unit") && remarks[1].contains("`furlong`"), "{remarks:?}");
        assert_eq!(unit("", Some(0.01), 1800.0, &mut remarks), ("cm".to_owned(), 0.01));
        assert_eq!(remarks.len(), 2);
    }
}
