//! How what is wrong with a set of pictures is said.

use super::super::code::{Axis, Inverse, Shown, StripeCode};
use super::SetFault;

/// What is said of a light that made all so much brighter.
fn switched(by: f64) -> String {
    let (way, than) = if by > 0.0 { ("on", "brighter") } else { ("off", "darker") };
    format!("a light was switched {way}, or the exposure changed: all is {:.0} gray levels {than}", by.abs())
}

impl SetFault {
    /// For people; `name` says how a picture is called.
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
                let start = format!("found {found} {noun}, expected {expected} of this code for {columns} x {rows}");
                match unpaired {
                    Some(at) => format!(
                        "{start}; {} is the first that is not the inverse of its neighbour: a picture is missing or doubled there",
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
                let or = if *or_inverse { " or no other its inverse" } else { "" };
                format!("no picture shows {shown}{or}, expected {place}: a picture is missing")
            }
            SetFault::ByWay { axis, plane } => format!(
                "bit {plane} of the {} is told from its inverse by the way in which columns and rows run in the picture: of pictures that are mirrored it would be the other one",
                axis.in_words()
            ),
            SetFault::ByWidth { axis, plane } => format!(
                "that bit {plane} of the {} lacks, the finest one, and no other is told by how wide columns and rows are in the picture",
                axis.in_words()
            ),
            SetFault::Unfolded { axis, plane } => format!(
                "bit {plane} of the {} is told by the other bits and by the way in which columns and rows run in the picture: of pictures that are mirrored it would be the other one",
                axis.in_words()
            ),
            SetFault::MissingSteps { axis, pictures } => format!(
                "{pictures} of the {} phase steps of the {} missing, nothing tells which",
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
                format!("{lack} of bit {} of the {words}, nothing tells of which{smaller}", any.join(" or "))
            }
            SetFault::NoAxis { axis, pictures } => {
                let other = Axis::BOTH[1 - axis.index()].in_words();
                format!(
                    "no picture shows all stripes of the {}, of which there should be {pictures} pictures: if the {other} alone were shown, `pattern.order` says so",
                    axis.in_words()
                )
            }
            SetFault::Extra { picture, shown } => {
                let what = shown.map_or(String::new(), |it| format!(" shows {it} once more and"));
                format!("{}{what} has no place in the set: a picture too many, or a frame taken twice", name(*picture))
            }
            SetFault::Shows { picture, found, expected } => {
                format!("{} shows {found}, expected {expected}", name(*picture))
            }
            SetFault::Exchanged { pictures: [a, b], expected: [of_a, of_b], mended } => {
                let taken = if *mended { ": taken for each other" } else { "" };
                format!("{} and {} stand in each other's places, expected {of_a} and {of_b}{taken}", name(*a), name(*b))
            }
            SetFault::OtherOrder { code: other } if other.offset != code.offset && other.order == code.order => {
                let [now, there] = [code, other.as_ref()].map(|it| it.offset != [0, 0]);
                format!(
                    "columns or rows lie beyond the projector's with `centred = {now}`; all fit `centred = {there}`"
                )
            }
            SetFault::OtherOrder { code } => {
                format!(
                    "the pictures stand in another order, expected that of the settings; they fit {}",
                    code.order_in_words()
                )
            }
            SetFault::Negative { picture, shown, mended } => {
                let turned = if *mended { ": it is turned back by calculation" } else { "" };
                format!(
                    "{} is a negative, expected {shown} as bright as the other pictures have it{turned}",
                    name(*picture)
                )
            }
            SetFault::Exposed { picture, shown, factor } => format!(
                "{} is {factor:.2} times as bright as the other pictures, expected {shown} with their exposure",
                name(*picture)
            ),
            SetFault::Uneven { pictures } => {
                const NAMED: usize = 6;
                // Of a camera that sets its exposure by itself, white is another one, and pictures whose stripes light more of the scene or less.
                const BY_ITSELF: usize = 3;
                let one = |it: &(usize, f64)| format!("{} is {:.2}", name(it.0), it.1);
                let list: Vec<String> = pictures.iter().take(NAMED).map(one).collect();
                let more = match pictures.len().saturating_sub(NAMED) {
                    0 => String::new(),
                    n => format!(", and {n} more are of another exposure"),
                };
                let why =
                    if pictures.len() >= BY_ITSELF { "; does the camera set its exposure by itself?" } else { "" };
                format!(
                    "{} times as bright as most pictures{more}, expected one exposure and one light for the whole set: they are evened out by calculation{why}",
                    list.join(", ")
                )
            }
            SetFault::Faded { ends: [first, last], factor } => format!(
                "the light or the exposure {} evenly, by {:.0} % from {} to {}, expected one exposure and one light for the whole set: pictures are evened out by calculation",
                if *factor < 1.0 { "faded" } else { "grew" },
                100.0 * (factor - 1.0).abs(),
                name(*first),
                name(*last)
            ),
            SetFault::Relit { last, first, by } => format!(
                "between {} and {} {}, expected one light for the whole set: the difference is taken off by calculation",
                name(*last),
                name(*first),
                switched(*by)
            ),
            SetFault::Unsteady { by } => format!(
                "the light of the room differs from picture to picture, by up to {by:.0} gray levels from their mean, expected one light for the whole set: the difference is taken off by calculation"
            ),
            SetFault::Moved { last, first, used: [from, until], but, light } => {
                let what = light
                    .map_or_else(|| "something moved, what is seen, the camera or the projector, or one of the pictures is a negative, of another exposure or of another light".to_owned(), switched);
                let after = if light.is_none() && from >= first {
                    "; if it was the camera or the projector, it no longer stands as it was calibrated, and all depths are off"
                } else {
                    ""
                };
                let but = match but {
                    Some([a, b]) if a == b => format!(" but for {}", name(*a)),
                    Some([a, b]) => format!(" but for some from {} to {}", name(*a), name(*b)),
                    None => String::new(),
                };
                format!(
                    "between {} and {} {what}. {} to {} are used{but}, which show one scene, and no other picture{after}",
                    name(*last),
                    name(*first),
                    name(*from),
                    name(*until)
                )
            }
            SetFault::OtherScene { picture, shown } => format!(
                "{} shows {shown} on another scene than the other pictures: something moved before it and back after it, or it is of another set. It is not used",
                name(*picture)
            ),
            SetFault::OtherSize { bits: [columns, rows], found } => {
                let [width, height] = code.projector;
                let [of_columns, of_rows] = code.bits;
                // Of a phase shift each bit is a half period wide.
                let stripe = if code.steps > 0 { code.stripe } else { [1; 2] };
                let range = |bits: u32, of: usize| {
                    format!("{} to {}", (stripe[of] << bits.saturating_sub(1)) + 1, stripe[of] << bits)
                };
                format!(
                    "the {found} pictures are a whole set of {columns} bits for columns and {rows} for rows, for a projector of {} x {} px; expected {of_columns} and {of_rows} bits for {width} x {height} px: \
                     is that the projector's size in the calibration{}?",
                    range(*columns, 0),
                    range(*rows, 1),
                    if code.steps > 0 { "" } else { ", or does `pattern.bits` say fewer" }
                )
            }
            SetFault::OtherWaves { steps, period, found } => format!(
                "the {found} pictures are a whole set with `pattern.steps = {steps}` and `pattern.period_px = {period}`, expected {} steps with a period of {} px",
                code.steps, code.period
            ),
            SetFault::Dim { lit, reached, needed } => format!(
                "of the {:.0} % of the pixels that the projector reaches, it lights only {:.1} % of the picture by the {needed} gray levels that are needed: too dark: a longer exposure, a wider aperture, more gain or less \
                 other light would help",
                100.0 * reached,
                100.0 * lit
            ),
            SetFault::Doubled { picture, same_as, expected } => {
                let expected = expected.map_or("other ones".to_owned(), |it| it.to_string());
                format!(
                    "{} shows the same stripes as {}, expected {expected}: a frame was taken twice",
                    name(*picture),
                    name(*same_as)
                )
            }
            SetFault::WhiteIsBlack { white, black } => {
                format!(
                    "{} is darker than {}, expected white and black: each is taken for the other",
                    name(*white),
                    name(*black)
                )
            }
            SetFault::NotWhite { picture, shown, share } => {
                let than = if *shown == Shown::White { "brightest" } else { "darkest" };
                let use_of_it = if code.inverse == Inverse::None { "" } else { "; it is not used" };
                format!(
                    "{} is not the {than} picture in {:.0} % of the pixels, expected the {shown} one{use_of_it}",
                    name(*picture),
                    100.0 * share
                )
            }
            SetFault::NotInverse { shown, pictures: [a, b], share } => format!(
                "{} and {} do not make white together in {:.0} % of the pixels, expected {shown} and its inverse",
                name(*a),
                name(*b),
                100.0 * share
            ),
            SetFault::Inverted { axis, planes, all, mended } => {
                let which = bits(axis, planes);
                let help = match (all, mended) {
                    (true, _) => ": do inverse pictures come first?",
                    (false, true) => ", and taken for each other",
                    (false, false) => "",
                };
                format!("{} of the {}: picture and inverse are exchanged{help}", which, axis.in_words())
            }
            SetFault::OutOfPlace { axis, planes } => {
                format!(
                    "{} of the {} fit no Gray code where they stand: pictures out of order, or a frame that was dropped",
                    bits(axis, planes),
                    axis.in_words()
                )
            }
            SetFault::OutOfRange { axis, share, side } => format!(
                "{:.0} % of the pixels show {} beyond the projector's {side}: another projector, offset or order, or the coarsest bit inverted",
                100.0 * share,
                axis.in_words()
            ),
            SetFault::TooDark { lit, contrast, needed } => format!(
                "the projector lights {:.1} % of the pixels, white - black being {contrast} gray levels at most, expected {needed} at least: too dark",
                100.0 * lit
            ),
            SetFault::Alike { saturated, .. } if *saturated > 0.0 => format!(
                "{:.0} % of the pixels are saturated in all pictures: too bright: a shorter exposure, a smaller aperture or less gain would help",
                100.0 * saturated
            ),
            SetFault::Alike { level, contrast, noise, .. } => format!(
                "no picture shows stripes: pixels are up to {level} gray levels bright, and from picture to picture they differ by {contrast} at most, where noise of {noise:.1} makes up to {:.0}. Is the projector on, does \
                 its light reach what the camera sees, and does nothing outshine it?",
                (6.0 * noise).min(255.0)
            ),
            SetFault::TooBright { saturated } => {
                format!(
                    "{:.0} % of the lit pixels are saturated, expected less than half: too bright",
                    100.0 * saturated
                )
            }
        }
    }
}
