//! Messages about faults in a set of pictures.

use super::super::code::{Axis, Inverse, Shown, StripeCode};
use super::SetFault;

/// Message about a light that made everything `by` gray levels brighter.
fn switched(by: f64) -> String {
    let (way, than) = if by > 0.0 { ("on", "brighter") } else { ("off", "darker") };
    format!("a light was switched {way}, or the exposure changed: everything is {:.0} gray levels {than}", by.abs())
}

impl SetFault {
    /// One line for a person; `name` gives the name of picture `k` of the set, such as its file.
    pub fn describe(&self, code: &StripeCode, name: &dyn Fn(usize) -> String) -> String {
        let bits = |axis: &Axis, planes: &[u32]| {
            let one = |plane: &u32| {
                let place = |inverse| code.place(Shown::Bit { axis: *axis, plane: *plane, inverse });
                let names: Vec<String> = [false, true].into_iter().filter_map(place).map(name).collect();
                format!("bit {plane} ({})", names.join(", "))
            };
            planes.iter().map(one).collect::<Vec<_>>().join(", ")
        };
        match self {
            SetFault::Count { found, expected, unpaired, .. } => {
                let [columns, rows] = code.projector;
                let noun = if *found == 1 { "picture" } else { "pictures" };
                let start = format!("found {found} {noun}, expected {expected} for this code at {columns} x {rows}");
                match unpaired {
                    Some(at) => format!(
                        "{start}; {} is the first that is not the inverse of its neighbour: a picture is missing or duplicated there",
                        name(*at)
                    ),
                    None => start,
                }
            }
            SetFault::Size { picture, found, expected } => {
                format!(
                    "{} is {} x {} px, expected {} x {} px as the first",
                    name(*picture),
                    found.0,
                    found.1,
                    expected.0,
                    expected.1
                )
            }
            SetFault::Unreadable { picture, shown } => {
                format!("{} could not be read, expected {shown}", name(*picture))
            }
            SetFault::Missing { shown, after, or_inverse } => {
                let place = after.map_or("at the beginning".to_owned(), |it| format!("after {}", name(it)));
                let or = if *or_inverse { " (or its inverse)" } else { "" };
                format!("no picture shows {shown}{or}, expected {place}: a picture is missing")
            }
            SetFault::ByWay { axis, plane } => format!(
                "bit {plane} of the {}: polarity resolved from image orientation, wrong if the pictures are mirrored",
                axis.in_words()
            ),
            SetFault::ByWidth { axis, plane } => {
                format!("bit {plane} of the {} is missing (inferred from stripe width)", axis.in_words())
            }
            SetFault::Unfolded { axis, plane } => format!(
                "bit {plane} of the {}: both pictures are missing and were reconstructed from the other bits and image orientation, wrong if the pictures are mirrored",
                axis.in_words()
            ),
            SetFault::MissingSteps { axis, pictures } => format!(
                "{pictures} of the {} phase steps of the {} missing, which cannot be determined",
                code.steps,
                if *pictures == 1 { format!("{} is", axis.in_words()) } else { format!("{} are", axis.in_words()) }
            ),
            SetFault::MissingBits { axis, planes, pictures } => {
                let words = axis.in_words();
                let any: Vec<String> = planes.iter().map(u32::to_string).collect();
                let lack = if *pictures == 1 {
                    "a picture is missing".to_owned()
                } else {
                    format!("{pictures} pictures are missing")
                };
                let (bits, stripe) = (code.bits[axis.index()], code.stripe[axis.index()]);
                let is_finest = planes.iter().any(|it| it + 1 == bits) && *pictures == 2;
                let smaller = if is_finest {
                    format!(", or the projector has at most {} {words}", stripe << (bits - 1))
                } else {
                    String::new()
                };
                format!("{lack} from bit {} of the {words}, which cannot be determined{smaller}", any.join(" or "))
            }
            SetFault::NoAxis { axis, pictures } => {
                let other = Axis::BOTH[1 - axis.index()].in_words();
                format!(
                    "no picture shows the stripes of the {}, expected {pictures} of them: if only the {other} were shown, set `pattern.order` accordingly",
                    axis.in_words()
                )
            }
            SetFault::Extra { picture, shown } => {
                let what = shown.map_or(String::new(), |it| format!(" shows {it} again and"));
                format!(
                    "{}{what} does not belong to the set: an extra picture, or a frame captured twice",
                    name(*picture)
                )
            }
            SetFault::Shows { picture, found, expected } => {
                format!("{} shows {found}, expected {expected}", name(*picture))
            }
            SetFault::Exchanged { pictures: [a, b], expected: [of_a, of_b], mended } => {
                let taken = if *mended { ": decoded in the right order" } else { "" };
                format!("{} and {} are swapped, expected {of_a} and {of_b}{taken}", name(*a), name(*b))
            }
            SetFault::OtherOrder { code: other } if other.offset != code.offset && other.order == code.order => {
                let [now, there] = [code, other.as_ref()].map(|it| it.offset != [0, 0]);
                format!(
                    "columns or rows lie outside the projector with `centred = {now}`, all are inside with `centred = {there}`"
                )
            }
            SetFault::OtherOrder { code } => {
                format!("the pictures are not in the order of the settings, but fit {}", code.order_in_words())
            }
            SetFault::Negative { picture, shown, mended } => {
                let turned = if *mended { ": it is inverted before decoding" } else { "" };
                format!("{} is a negative, expected {shown} as a positive{turned}", name(*picture))
            }
            SetFault::Exposed { picture, shown, factor } => format!(
                "{} is {factor:.2} times as bright as the other pictures, expected {shown} at the same exposure",
                name(*picture)
            ),
            SetFault::Uneven { pictures } => {
                const NAMED: usize = 6;
                // Automatic exposure changes white, and pictures whose stripes light more or less of the scene.
                const BY_ITSELF: usize = 3;
                let one = |it: &(usize, f64)| format!("{} is {:.2}", name(it.0), it.1);
                let list: Vec<String> = pictures.iter().take(NAMED).map(one).collect();
                let more = match pictures.len().saturating_sub(NAMED) {
                    0 => String::new(),
                    n => format!(", and {n} more have another exposure"),
                };
                let why = if pictures.len() >= BY_ITSELF { "; does the camera use automatic exposure?" } else { "" };
                format!(
                    "{} times as bright as most pictures{more}, expected the same exposure and light for the whole set: brightness is equalised before decoding{why}",
                    list.join(", ")
                )
            }
            SetFault::Faded { ends: [first, last], factor } => format!(
                "the light or the exposure {} evenly, by {:.0} % from {} to {}, expected the same exposure and light for the whole set: brightness is equalised before decoding",
                if *factor < 1.0 { "faded" } else { "grew" },
                100.0 * (factor - 1.0).abs(),
                name(*first),
                name(*last)
            ),
            SetFault::Relit { last, first, by } => format!(
                "between {} and {} {}, expected the same light for the whole set: the difference is subtracted",
                name(*last),
                name(*first),
                switched(*by)
            ),
            SetFault::Unsteady { by } => format!(
                "the ambient light differs from picture to picture, by up to {by:.0} gray levels from the mean, expected the same light for the whole set: the difference is subtracted"
            ),
            SetFault::Moved { last, first, used: [from, until], but, light } => {
                let what = light
                    .map_or_else(|| "something moved (the scene, the camera or the projector), or one of the pictures is a negative or has another exposure or light".to_owned(), switched);
                let after = if light.is_none() && from >= first {
                    "; if the camera or the projector moved, the calibration no longer holds and all depths are off"
                } else {
                    ""
                };
                let but = match but {
                    Some([a, b]) if a == b => format!(" except {}", name(*a)),
                    Some([a, b]) => format!(" except some from {} to {}", name(*a), name(*b)),
                    None => String::new(),
                };
                format!(
                    "between {} and {} {what}. Only {} to {} are used{but}: they show one scene{after}",
                    name(*last),
                    name(*first),
                    name(*from),
                    name(*until)
                )
            }
            SetFault::OtherScene { picture, shown } => format!(
                "{} shows {shown} on another scene than the other pictures: something moved before it and back after it, or it belongs to another set. It is not used",
                name(*picture)
            ),
            SetFault::OtherSize { bits: [columns, rows], found } => {
                let [width, height] = code.projector;
                let [of_columns, of_rows] = code.bits;
                // Under a phase shift each bit is half a period wide.
                let stripe = if code.steps > 0 { code.stripe } else { [1; 2] };
                let range = |bits: u32, of: usize| {
                    format!("{} to {}", (stripe[of] << bits.saturating_sub(1)) + 1, stripe[of] << bits)
                };
                format!(
                    "the {found} pictures are a complete set of {columns} bits for columns and {rows} for rows, for a projector of {} x {} px; expected {of_columns} and {of_rows} bits for {width} x {height} px: \
                     is the projector's size in the calibration right{}?",
                    range(*columns, 0),
                    range(*rows, 1),
                    if code.steps > 0 { "" } else { ", or does `pattern.bits` say fewer" }
                )
            }
            SetFault::OtherWaves { steps, period, found } => format!(
                "the {found} pictures are a complete set with `pattern.steps = {steps}` and `pattern.period_px = {period}`, expected {} steps with a period of {} px",
                code.steps, code.period
            ),
            SetFault::Dim { lit, reached, needed } => format!(
                "too dark: the projector reaches {:.0} % of the pixels but lights only {:.1} % by the required {needed} gray levels: use a longer exposure, a wider aperture, more gain or less \
                 ambient light",
                100.0 * reached,
                100.0 * lit
            ),
            SetFault::Doubled { picture, same_as, expected } => {
                let expected = expected.map_or("other stripes".to_owned(), |it| it.to_string());
                format!(
                    "{} shows the same stripes as {}, expected {expected}: a frame was captured twice",
                    name(*picture),
                    name(*same_as)
                )
            }
            SetFault::WhiteIsBlack { white, black } => {
                format!(
                    "{} is darker than {}, expected white and black: they are swapped before decoding",
                    name(*white),
                    name(*black)
                )
            }
            SetFault::NotWhite { picture, shown, share } => {
                let than = if *shown == Shown::White { "brightest" } else { "darkest" };
                let use_of_it = if code.inverse == Inverse::None { "" } else { "; it is not used" };
                format!(
                    "{} is not the {than} picture in {:.0} % of the pixels, expected the {shown} picture{use_of_it}",
                    name(*picture),
                    100.0 * share
                )
            }
            SetFault::NotInverse { shown, pictures: [a, b], share } => format!(
                "{} and {} do not add up to white in {:.0} % of the pixels, expected {shown} and its inverse",
                name(*a),
                name(*b),
                100.0 * share
            ),
            SetFault::Inverted { axis, planes, all, mended } => {
                let which = bits(axis, planes);
                let help = match (all, mended) {
                    (true, _) => ": do inverse pictures come first?",
                    (false, true) => ", decoded the right way round",
                    (false, false) => "",
                };
                format!("{} of the {}: picture and inverse are swapped{help}", which, axis.in_words())
            }
            SetFault::OutOfPlace { axis, planes } => {
                format!(
                    "{} of the {} do not fit a Gray code in this order: pictures out of order, or a dropped frame",
                    bits(axis, planes),
                    axis.in_words()
                )
            }
            SetFault::OutOfRange { axis, share, side } => format!(
                "{:.0} % of the pixels decode to {} outside the projector's {side}: another projector, offset or order, or an inverted coarsest bit",
                100.0 * share,
                axis.in_words()
            ),
            SetFault::TooDark { lit, contrast, needed } => format!(
                "too dark: the projector lights {:.1} % of the pixels, and white - black is at most {contrast} gray levels, expected at least {needed}",
                100.0 * lit
            ),
            SetFault::Alike { saturated, .. } if *saturated > 0.0 => format!(
                "too bright: {:.0} % of the pixels are saturated in all pictures: use a shorter exposure, a smaller aperture or less gain",
                100.0 * saturated
            ),
            SetFault::Alike { level, contrast, noise, .. } => format!(
                "no picture shows stripes: pixels reach {level} gray levels and differ from picture to picture by at most {contrast}, where noise of {noise:.1} accounts for up to {:.0}. Is the projector on, does \
                 its light reach the camera's view, and is it brighter than the ambient light?",
                (6.0 * noise).min(255.0)
            ),
            SetFault::TooBright { saturated } => {
                format!(
                    "too bright: {:.0} % of the lit pixels are saturated, expected less than half",
                    100.0 * saturated
                )
            }
        }
    }
}
