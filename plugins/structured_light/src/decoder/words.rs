//! Messages about decoded sets of pictures.

use foveate::imaging::stripes::code::{Axis, StripeCode};
use foveate::imaging::stripes::drift::Pace;
use foveate::imaging::stripes::finest::TooFine;
use foveate::imaging::stripes::phase::Steps;
use foveate::imaging::stripes::steady::Steadied;

/// Stripes that are too fine are reported from this part of the lit pixels on [–].
const TOLD_SHARE: f64 = 0.5;
/// … and where coarser stripes determined more than this part of the lit pixels [–].
const TOLD_FILLED: f64 = 0.15;
/// Coordinates that run backwards are reported where they are more than this part of all [–].
const TOLD_BACKWARDS: f64 = 1e-3;
/// A camera that blurs by more than this is reported as out of focus, standard deviation [px].
const OUT_OF_FOCUS: f64 = 1.2;
/// And a projector whose light fades at the ends of its picture by more than this [projector px].
const SOFT: f64 = 1.5;
/// Light fades at the ends of a projector's picture by no more than so many times what blurs its stripes [–].
const SOFTER: f64 = 1.4;

/// The finest of so many bits, by their numbers.
fn finest(bits: u32, n: u32) -> String {
    let planes: Vec<String> = (bits - n..bits).map(|it| it.to_string()).collect();
    format!("{} {}", if n == 1 { "bit" } else { "bits" }, planes.join(" and "))
}

/// Which bits are finer than the camera resolves, and where.
pub(super) fn too_fine_in_words(
    code: &StripeCode,
    whole: &TooFine,
    in_parts: &TooFine,
    filled: [f64; 2],
) -> Vec<String> {
    let axes = || Axis::BOTH.into_iter().filter(|it| code.has(*it));
    let dropped = |axis: Axis| whole.overall()[axis.index()];
    let everywhere = axes().filter(|it| dropped(*it) > 0).map(|axis| {
        format!("stripes of {} of the {}", finest(code.bits[axis.index()], dropped(axis)), axis.in_words())
    });
    let in_parts = axes().filter(|it| dropped(*it) == 0).filter_map(|axis| {
        let filled = filled[axis.index()];
        let share = if in_parts.share(axis) > TOLD_SHARE { in_parts.share(axis) } else { filled };
        (share > TOLD_FILLED).then(|| {
            format!("in {:.0} % of the lit pixels the finest stripes of the {}", 100.0 * share, axis.in_words())
        })
    });
    let [everywhere, in_parts] = [everywhere.collect::<Vec<_>>(), in_parts.collect()].map(|it| it.join(", and "));
    let instead = [
        (everywhere, "the coarser ones are used, and places between their boundaries are interpolated"),
        (in_parts, "coarser ones are used there"),
    ];
    let help = "for more detail use a sharper or closer camera or one with more pixels, and focus the projector";
    let told = instead.into_iter().filter(|it| !it.0.is_empty());
    told.map(|(which, instead)| format!("{which} are finer than the camera resolves: {instead}; {help}")).collect()
}

/// What is said where part of the coordinates of an axis ran backwards.
pub(super) fn backwards_in_words(axis: Axis, part: f64) -> Option<String> {
    (part > TOLD_BACKWARDS).then(|| {
        format!(
            "{:.1} % of the decoded pixels are left out: in or beside these places the {} run backwards, as they do on no surface. Something moved during the set, or a mirror shows the stripes again; motion that keeps \
             their order is decoded wrongly",
            100.0 * part,
            axis.in_words()
        )
    })
}

/// What is said of an axis of `bits` bits whose finest ones, so many, are not there.
pub(super) fn lacking_finest_in_words(axis: Axis, bits: u32, lacking: u32) -> Option<String> {
    (lacking > 0).then(|| {
        format!(
            "the {} are decoded without {}, whose pictures are missing: stripes are {} times as wide, and places between their boundaries are interpolated",
            axis.in_words(),
            finest(bits, lacking),
            1 << lacking
        )
    })
}

/// What is said of a scene that lies elsewhere by `px` from the second of two pictures on.
pub(super) fn moved_a_little_in_words([last, first]: &[String; 2], px: f64) -> String {
    format!(
        "between {last} and {first}, or near there, the camera or the scene moved by {px:.2} px in the picture. The standard deviations of coordinates include that; keep both still for better ones"
    )
}

/// What is said of a scene that creeps from the first of two pictures to the second, which is taken off but for a standard deviation.
pub(super) fn crept_in_words([first, last]: &[String; 2], steadied: &Steadied) -> String {
    let (px, sigma) = (steadied.reach().norm(), steadied.sigma.norm());
    let how = if steadied.pace == Pace::Uneven { "unevenly, within" } else { "by" };
    format!(
        "from {first} to {last} the camera or the scene drifted {how} {px:.2} px in the picture. The drift is corrected to {sigma:.2} px, relative to {first}; keep both still for better coordinates"
    )
}

/// What is said of a camera that blurs by a standard deviation of `sigma` px.
pub(super) fn out_of_focus_in_words(sigma: f64) -> Option<String> {
    (sigma > OUT_OF_FOCUS).then(|| {
        format!(
            "the camera is out of focus: edges of the surface's colours are blurred by a standard deviation of {sigma:.1} px, expected below 1: places near such edges are corrected as far as possible, and rims \
             of surfaces and of shadows are left out"
        )
    })
}

/// What is said of a projector whose light fades at the ends of its picture by `sigma` px, while boundaries of stripes are blurred by `of_stripes` px, where that is known.
pub(super) fn soft_in_words(axis: Axis, sigma: f64, of_stripes: Option<f64>) -> Option<String> {
    // Light that fades where stripes are sharp fades by the surface.
    let is_blur = of_stripes.is_none_or(|it| sigma <= SOFTER * it);
    (sigma > SOFT && is_blur).then(|| {
        format!(
            "the projector is out of focus: its light fades at the first or the last of the {} by a standard deviation of {sigma:.1} of its pixels, expected below {SOFT}: places near there are biased inwards, and are left out",
            axis.in_words()
        )
    })
}

/// What is said of phase steps whose period is so many pixels wide in the picture, and `period` in the projector's.
pub(super) fn unresolved_in_words(axis: Axis, px: f64, period: u32) -> String {
    format!(
        "a period of the waves of the {axis} is {px:.1} px wide in the picture, expected 2 or more: the camera does not resolve their stripes, and the {axis} are left out. Use a period longer than {period} px of the projector, or a camera \
         that is closer or has more pixels",
        axis = axis.in_words()
    )
}

/// What is said of two phase steps that are exchanged.
pub(super) fn exchanged_in_words(axis: Axis, [a, b]: [u32; 2]) -> String {
    format!(
        "phase steps {a} and {b} of the {} are swapped (counted from 0): decoded in the right order",
        axis.in_words()
    )
}

/// Of quarters of a period, what is a whole one [–].
const WHOLE: f64 = 0.01;

/// What is said of phase steps that do not stand as stated.
pub(super) fn steps_in_words(axis: Axis, steps: Steps) -> Option<String> {
    let axis = axis.in_words();
    match steps {
        Steps::AsStated => None,
        // By no more than waves are known to: as stated.
        Steps::Otherwise { is_reversed: false, ahead } if (4.0 * (ahead - ahead.round())).abs() <= WHOLE => None,
        Steps::Otherwise { is_reversed: false, ahead } if (4.0 * ahead - (4.0 * ahead).round()).abs() > WHOLE => {
            Some(format!(
                "the waves of the {axis} begin {:.3} of a period elsewhere, expected a cosine from the projector's edge on (or half a pixel from it, where pixels are counted by their middles): coordinates \
                 are corrected for it by the Gray code",
                ahead - ahead.round()
            ))
        }
        Steps::Otherwise { is_reversed, ahead } => {
            let way = if is_reversed { "run backwards" } else { "run as expected" };
            Some(format!(
                "the phase steps of the {axis} {way} and begin {:.2} of a period elsewhere, expected step k of n ahead by k / n of a period, or two of them are swapped: coordinates are corrected for it by the Gray \
                 code",
                ((100.0 * ahead).round() / 100.0).rem_euclid(1.0) + 0.0
            ))
        }
        Steps::NoWay => Some(format!(
            "the phase steps of the {axis} contradict their Gray code in both directions: the {axis} are left out. Are the steps in order, and is `period_px` that of the pictures?"
        )),
    }
}
