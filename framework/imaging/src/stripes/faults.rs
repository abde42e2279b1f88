//! What can be wrong with a set of pictures, and how it is said.

use std::fmt;

use super::code::{Axis, Inverse, Shown, StripeCode};

/// So many bits of an axis that fit no Gray code say that the pictures are not those of the stated order: a picture that is missing, wrong or in another's place spoils its own bit and one more, two that are exchanged up to four.
const OTHER_SET: usize = 5;

/// Something that is wrong with a set of pictures. Pictures are numbered in their order, from 0.
#[derive(Debug, Clone, PartialEq)]
pub enum SetFault {
    /// Another number of pictures than the code has.
    Count {
        /// How many there are.
        found: usize,
        /// How many the code has.
        expected: usize,
        /// The first one that is not the inverse that stands before or after it, where nothing else is known.
        unpaired: Option<usize>,
        /// Whether it is known which are missing or too many: each is a fault of its own.
        is_explained: bool,
    },
    /// A picture could not be read.
    Unreadable {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// No picture shows this.
    Missing {
        /// What.
        shown: Shown,
        /// The picture after which it should stand; `None` at the beginning.
        after: Option<usize>,
        /// Whether it may be its inverse instead.
        or_inverse: bool,
    },
    /// Pictures of some of these bits or their inverses lack: nothing tells which.
    MissingBits {
        /// Of which axis.
        axis: Axis,
        /// The bits.
        planes: Vec<u32>,
        /// How many pictures lack.
        pictures: usize,
    },
    /// Phase steps of an axis lack: nothing tells which.
    MissingSteps {
        /// Of which axis.
        axis: Axis,
        /// How many pictures lack.
        pictures: usize,
    },
    /// No picture shows the stripes of an axis.
    NoAxis {
        /// Which axis.
        axis: Axis,
        /// How many pictures it has.
        pictures: usize,
    },
    /// A picture for which there is no place.
    Extra {
        /// Which.
        picture: usize,
        /// What it shows, where that is known.
        shown: Option<Shown>,
    },
    /// A picture shows something else than it should.
    Shows {
        /// Which.
        picture: usize,
        /// What it shows.
        found: Found,
        /// What it should show.
        expected: Shown,
    },
    /// Two pictures stand in each other's places.
    Exchanged {
        /// Which.
        pictures: [usize; 2],
        /// What they should show.
        expected: [Shown; 2],
        /// Whether the set is sound with both in their places, and is decoded so.
        mended: bool,
    },
    /// The set has another order.
    OtherOrder {
        /// A code of that order.
        code: Box<StripeCode>,
    },
    /// A picture is a negative: dark where it should be bright, by all gray levels.
    Negative {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// A picture is brighter or darker than the others all over.
    Exposed {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// How many times as bright [–].
        factor: f64,
    },
    /// Pictures are brighter or darker than most, and are evened out.
    Uneven {
        /// Which, each with how many times as bright [–].
        pictures: Vec<(usize, f64)>,
    },
    /// Something moved between two pictures.
    Moved {
        /// The last picture before it.
        last: usize,
        /// The first one after it.
        first: usize,
        /// The first and the last of those that are used.
        used: [usize; 2],
        /// By how much all grew brighter, or darker where negative, where a light that was switched explains it [gray levels].
        light: Option<f64>,
    },
    /// A light was switched between two pictures, and is taken off by calculation.
    Relit {
        /// The last picture before it.
        last: usize,
        /// The first one after it.
        first: usize,
        /// By how much all grew brighter, or darker where negative [gray levels].
        by: f64,
    },
    /// The light of the room differs from picture to picture, which is taken off by calculation.
    Unsteady {
        /// From the mean of all pictures, at most, in the middle one of the pixels [gray levels].
        by: f64,
    },
    /// A picture shows its stripes on another scene than the others.
    OtherScene {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// The pictures are a whole set for a projector of another size.
    OtherSize {
        /// Bits of columns and rows that they have.
        bits: [u32; 2],
        /// How many pictures there are.
        found: usize,
    },
    /// The projector lights most of what it reaches too weakly.
    Dim {
        /// Part of the pixels that it lights well enough [–].
        lit: f64,
        /// Part of the pixels that it lights at all [–].
        reached: f64,
        /// What is needed [gray levels].
        needed: u8,
    },
    /// A picture of another size than the first.
    Size {
        /// Which.
        picture: usize,
        /// Its columns and rows [px].
        found: (usize, usize),
        /// Those of the first [px].
        expected: (usize, usize),
    },
    /// Two pictures show the same stripes.
    Doubled {
        /// The later one.
        picture: usize,
        /// The earlier one.
        same_as: usize,
        /// What it should show.
        expected: Option<Shown>,
    },
    /// White is darker than black.
    WhiteIsBlack {
        /// The white picture.
        white: usize,
        /// The black one.
        black: usize,
    },
    /// White is not the brightest picture, or black not the darkest.
    NotWhite {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Part of the pixels in which another picture is clearly brighter (darker) [–].
        share: f64,
    },
    /// A picture and its inverse do not make white and black together.
    NotInverse {
        /// The bit.
        shown: Shown,
        /// Its picture and the inverse.
        pictures: [usize; 2],
        /// Part of the pixels in which they do not [–].
        share: f64,
    },
    /// Bits whose picture and inverse are exchanged.
    Inverted {
        /// Which axis.
        axis: Axis,
        /// Which bits.
        planes: Vec<u32>,
        /// Whether that is all that can be told.
        all: bool,
        /// Whether the set is sound with these in their places, and is decoded so.
        mended: bool,
    },
    /// Bits that do not fit those before them.
    OutOfPlace {
        /// Which axis.
        axis: Axis,
        /// Which bits.
        planes: Vec<u32>,
    },
    /// Columns (rows) that the projector does not have.
    OutOfRange {
        /// Which axis.
        axis: Axis,
        /// Part of the pixels that show one [–].
        share: f64,
        /// How many the projector has [px].
        side: u32,
    },
    /// The projector hardly lights anything.
    TooDark {
        /// Part of the pixels that it lights [–].
        lit: f64,
        /// The 95th percentile of white − black [gray levels].
        contrast: u8,
        /// What is needed [gray levels].
        needed: u8,
    },
    /// No picture shows more light anywhere than the others, although they are not dark.
    Alike {
        /// The 95th percentile of the brightest level of a pixel [gray levels].
        level: u8,
        /// That of brightest − darkest [gray levels].
        contrast: u8,
        /// Noise of a pixel, standard deviation [gray levels].
        noise: f64,
        /// Part of the pixels that are saturated in all pictures [–].
        saturated: f64,
    },
    /// Most of what the projector lights is saturated.
    TooBright {
        /// Part of the lit pixels that are [–].
        saturated: f64,
    },
}

/// What a picture was found to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// A bit or its inverse, white or black.
    Shown(Shown),
    /// A bit or its inverse.
    Bit(Axis, u32),
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Found::Shown(shown) => shown.fmt(f),
            Found::Bit(axis, plane) => write!(f, "bit {plane} of the {}", axis.in_words()),
        }
    }
}

/// What is said of a light that made all so much brighter.
fn switched(by: f64) -> String {
    let (way, than) = if by > 0.0 { ("on", "brighter") } else { ("off", "darker") };
    format!("a light was switched {way}, or the exposure changed: all is {:.0} gray levels {than}", by.abs())
}

impl SetFault {
    /// Whether this axis cannot be decoded because of it; `needs_white` where nothing but white and black says what is lit.
    pub fn spoils(&self, axis: Axis, needs_white: bool) -> bool {
        let is_of = |shown: &Shown| shown.axis() == Some(axis);
        match self {
            SetFault::Count { is_explained, .. } => !is_explained,
            // What is not there may be worked out from the rest, and what lacks is known.
            SetFault::Missing { .. }
            | SetFault::MissingBits { .. }
            | SetFault::MissingSteps { .. }
            | SetFault::NoAxis { .. }
            | SetFault::Unreadable { .. }
            | SetFault::Doubled { .. }
            | SetFault::OtherScene { .. }
            | SetFault::Moved { .. }
            | SetFault::Relit { .. }
            | SetFault::Unsteady { .. }
            | SetFault::Uneven { .. }
            | SetFault::WhiteIsBlack { .. }
            | SetFault::Dim { .. } => false,
            SetFault::Shows { expected: shown, .. } | SetFault::Negative { shown, .. } => {
                needs_white && matches!(shown, Shown::White | Shown::Black)
            }
            SetFault::NotWhite { .. } => needs_white,
            SetFault::Exposed { shown, .. } => is_of(shown) || matches!(shown, Shown::White | Shown::Black),
            SetFault::Exchanged { mended: true, .. } | SetFault::Inverted { mended: true, .. } => false,
            SetFault::Exchanged { expected, .. } => {
                expected.iter().any(is_of) || !expected.iter().all(|it| matches!(it, Shown::Bit { .. }))
            }
            SetFault::Extra { .. } | SetFault::TooBright { .. } => false,
            SetFault::NotInverse { shown, .. } => is_of(shown),
            // So many bits are not one picture: what is stated of the set is wrong, of the other axis too.
            SetFault::OutOfPlace { axis: of, planes } => *of == axis || planes.len() >= OTHER_SET,
            SetFault::Inverted { axis: of, .. } | SetFault::OutOfRange { axis: of, .. } => *of == axis,
            SetFault::Size { .. }
            | SetFault::OtherOrder { .. }
            | SetFault::OtherSize { .. }
            | SetFault::TooDark { .. }
            | SetFault::Alike { .. } => true,
        }
    }

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
            SetFault::Negative { picture, shown } => {
                format!("{} is a negative, expected {shown} as bright as the other pictures have it", name(*picture))
            }
            SetFault::Exposed { picture, shown, factor } => format!(
                "{} is {factor:.2} times as bright as the other pictures, expected {shown} with their exposure",
                name(*picture)
            ),
            SetFault::Uneven { pictures } => {
                const NAMED: usize = 6;
                let one = |it: &(usize, f64)| format!("{} is {:.2}", name(it.0), it.1);
                let mut list: Vec<String> = pictures.iter().take(NAMED).map(one).collect();
                if pictures.len() > NAMED {
                    list.push(format!("{} more are otherwise", pictures.len() - NAMED));
                }
                format!(
                    "{} times as bright as most pictures, expected one exposure and one light for the whole set: they are evened out by calculation",
                    list.join(", ")
                )
            }
            SetFault::Relit { last, first, by } => format!(
                "between {} and {} {}, expected one light for the whole set: the difference is taken off by calculation",
                name(*last),
                name(*first),
                switched(*by)
            ),
            SetFault::Unsteady { by } => format!(
                "the light of the room differs from picture to picture, by up to {by:.0} gray levels from their mean, expected one light for the whole set: the difference is taken off by calculation"
            ),
            SetFault::Moved { last, first, used: [from, until], light } => {
                let what = light
                    .map_or_else(|| "something moved: what is seen, the camera or the projector".to_owned(), switched);
                format!(
                    "between {} and {} {what}. {} to {} are used, which show one scene, and no other picture",
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
                let range = |bits: u32| format!("{} to {}", (1_u32 << (bits - 1)) + 1, 1_u32 << bits);
                format!(
                    "the {found} pictures are a whole set of {columns} bits for columns and {rows} for rows, for a projector of {} x {} px; expected {of_columns} and {of_rows} bits for {width} x {height} px: \
                     is that the projector's size, or does `pattern.bits` say fewer?",
                    range(*columns),
                    range(*rows)
                )
            }
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
