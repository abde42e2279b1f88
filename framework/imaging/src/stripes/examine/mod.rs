//! Finds what is wrong with a set of pictures before it is decoded.
//!
//! The pictures are compared with the rules of a Gray code: a picture and its inverse add up to white and black; white is the brightest and
//! black the darkest; no two pictures of stripes are alike; and where one bit changes, the next finer one is 1 and all finer ones are 0. A bit with
//! swapped pictures, a bit in the wrong place and a frame that the projector dropped break the last rule in different ways. Only the coarsest bit
//! can be inverted without breaking a rule, unless columns outside the projector come out.

mod fold;
mod layouts;
mod level;
mod light;
mod lit;
mod open;
mod prepared;
mod rules;
mod still;

use std::cmp::Reverse;

use self::layouts::Layouts;
use self::lit::{Wild, lattice, lit_of, sampled, spread, unlit};
pub use self::prepared::Prepared;
use self::rules::Set;
use super::code::{Axis, Inverse, Shown, StripeCode};
use super::explain::{self, Explained};
use super::exposure;
use super::fade::{self, Fade};
use super::faults::SetFault;
use super::stretches;
use crate::ImageView;

/// The faults of a set of pictures, and what of it can be decoded ([`Examination::usable`], [`Examination::prepared`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Examination {
    /// All faults, each with the picture, axis or bit concerned.
    pub faults: Vec<SetFault>,
    /// Part of the pixels that the projector lights [–].
    pub lit: f64,
    /// Noise of a pixel, standard deviation [gray levels].
    pub noise: f64,
    /// By place in the set the picture that shows what belongs there.
    places: Vec<Option<usize>>,
    /// Bits of which nothing tells a picture from its inverse but where it stands.
    unsure: Vec<(Axis, u32)>,
    /// Pictures of another exposure, with how many times as bright they are [–].
    uneven: Vec<(usize, f64)>,
    /// Pictures under another light, with that taken off.
    relit: Vec<(usize, Vec<u8>)>,
    /// Bits that are not there, each with its inverse after it, as the other pictures tell them: both alike where these leave it open.
    unfolded: Vec<(Shown, Vec<u8>)>,
}

/// Pixels that are looked at, and those that are where something is wrong.
const SAMPLES: usize = 40_000;
const MANY_SAMPLES: usize = 160_000;
/// Pixels are neighbours over so many: between stripes that are out of focus lie some that are neither lit nor dark [px].
const REACH: usize = 3;
/// Over more than one pixel, changes say something of a bit where fewer than this part of them disagree [–].
const FAR: f64 = 0.1;
/// Changes of a bit that say something.
const MIN_CHANGES: usize = 30;
/// Where a bit changes more often than this from one pixel to the next, its stripes are too narrow for rules that ask of the next pixel [–].
const MOST_CHANGES: f64 = 0.45;
/// A rule is broken in more than this part of the pixels [–].
const BROKEN: f64 = 0.3;
/// A picture is all bright (dark) that is not in less than this part of the pixels: of a wave it is 0.6 [–].
const NO_WAVE: f64 = 0.25;
/// A gray level that is saturated.
const SATURATED: u8 = 254;
/// Part of the picture that the projector has to light at least [–].
const MIN_LIT: f64 = 0.001;
/// Pictures that can be compared with each other.
const FEWEST: usize = 3;
/// What noise makes of bright − dark where nothing is lit, over its standard deviation: third highest of some forty values less third lowest, and as much again.
const NOISE_RANGE: f64 = 5.0;
/// What noise makes of the sum of two pictures, over the standard deviation of one: two of the sum's.
const NOISE_SUM: f64 = 2.83;
/// A picture has another exposure where it is brighter or darker by this part, alike to within that [–].
const OTHER_EXPOSURE: f64 = 0.15;
const ALIKE: f64 = 0.35;

/// Part of the pixels that the projector reaches, of which it has to light so many well enough; reached is what is brighter under its light by so many gray levels [–].
const DIM: f64 = 0.5;
const REACHED: f64 = 4.0;
/// Of the pictures of a dim set, that part may be wrong for it to be believed: a sound one of 8 % of the light seemed to have 30 % out of place [–].
const DIM_WRONG: f64 = 0.1;
/// Where exposures are evened out, pictures are named that are off by more than this [–].
const TOLD: f64 = 0.05;
/// Of a pair that does not belong together, the picture of another scene is beyond the range of the others in this part of the pixels at least, and so many times as many as the other one.
const BEYOND: f64 = 0.04;
const CLEARLY: f64 = 3.0;

/// Checks a set of pictures against the rules of `code`. A pixel is lit where white − black is at least `min_contrast` [gray levels] and more than noise. The pictures with the numbers
/// `absent` could not be read; what is in their places is ignored.
pub fn examine(code: &StripeCode, pictures: &[ImageView<'_>], absent: &[usize], min_contrast: u8) -> Examination {
    let negatives = negative_steps(code, pictures, absent, min_contrast);
    let turned = |it: &usize| (*it, pictures[*it].pixels().iter().map(|it| u8::MAX - it).collect());
    let mut turned: Vec<(usize, Vec<u8>)> = negatives.iter().map(turned).collect();
    let views = light::replaced(pictures, &turned).filter(|_| !turned.is_empty());
    let mut found = positives_examined(code, views.as_deref().unwrap_or(pictures), absent, min_contrast);
    // What is decoded is what was looked at.
    let relit: Vec<usize> = found.relit.iter().map(|it| it.0).collect();
    for (picture, pixels) in turned.iter_mut().filter(|it| !relit.contains(&it.0)) {
        if let Some(at) = found.uneven.iter().position(|it| it.0 == *picture) {
            *pixels = exposure::evened(pixels, found.uneven.remove(at).1);
        }
        found.relit.push((*picture, std::mem::take(pixels)));
    }
    for axis in Axis::BOTH {
        if let Some(plane) = fold::lone_gap(code, &found, axis)
            && let Some(pair) = fold::unfolded(code, &found, pictures, axis, plane)
        {
            let shown = [false, true].map(|inverse| Shown::Bit { axis, plane, inverse });
            found.unfolded.extend(shown.into_iter().zip(pair));
            found.faults.push(SetFault::Unfolded { axis, plane });
        }
    }
    let shown = code.pictures();
    let named = negatives.iter().map(|it| SetFault::Negative { picture: *it, shown: shown[*it], mended: true });
    found.faults.splice(0..0, named);
    found
}

/// Phase steps that are negatives, in a set with all its pictures. Bits, white and black say what is bright and dark there, for all steps may be negatives.
fn negative_steps(code: &StripeCode, pictures: &[ImageView<'_>], absent: &[usize], min_contrast: u8) -> Vec<usize> {
    let shown = code.pictures();
    let (steps, others): (Vec<usize>, Vec<usize>) = (0..pictures.len().min(shown.len()))
        .filter(|it| !absent.contains(it))
        .partition(|it| matches!(shown[*it], Shown::Phase { .. }));
    let Some(size) = others.first().map(|it| pictures[*it].size()) else { return Vec::new() };
    let is_alike = pictures.len() == shown.len() && steps.iter().chain(&others).all(|it| pictures[*it].size() == size);
    if !is_alike || steps.is_empty() || others.len() < FEWEST {
        return Vec::new();
    }
    let samples = sampled(size, SAMPLES);
    let lit = lit_of(&samples, &Wild::of(code, &others).ranges(pictures, &samples), f64::from(min_contrast.max(1)));
    let set = Set { code, pictures, shown: &shown, lit: &lit, width: size.0, noise: 0.0, skipped: absent.to_vec() };
    steps.into_iter().filter(|it| set.is_negative(*it)).collect()
}

/// As [`examine`], of a set whose phase steps are no negatives.
fn positives_examined(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    absent: &[usize],
    min_contrast: u8,
) -> Examination {
    let as_they_are = || {
        let (found, lit) = look(code, pictures, absent, min_contrast);
        settled(code, pictures, absent, min_contrast, found, &lit)
    };
    let broken = |pictures: &[ImageView<'_>]| at_first_sight(code, pictures, absent, min_contrast, Asked::Rules).0;
    let found = broken(pictures);
    // A light that differs looks like other stripes.
    if code.inverse == Inverse::None || found.n_accused() == 0 {
        return as_they_are();
    }
    // A light that was switched is told from its two sides, and is all that differs then.
    let is_switch = |it: &SetFault| matches!(it, SetFault::Moved { light: Some(_), .. });
    if found.faults.iter().filter(|it| is_switch(it)).count() == found.n_accused() {
        let found = as_they_are();
        if found.n_accused() == 0 {
            return found;
        }
    }
    let is_whole = pictures.len() == code.pictures().len();
    let is_all_usable = |it: &Examination| Axis::BOTH.into_iter().filter(|it| code.has(*it)).eq(it.usable(code));
    // With pictures that lack or are too many only why that is so says anything.
    let unlevelled = (!is_whole).then(as_they_are);
    if let Some(it) = unlevelled.as_ref().filter(|it| is_all_usable(it)) {
        return it.clone();
    }
    let as_they_are = || unlevelled.unwrap_or_else(as_they_are);
    let present: Vec<usize> = (0..pictures.len()).filter(|it| !absent.contains(it)).collect();
    let Some(levelled) = level::levelled(pictures, &present, found.noise) else { return as_they_are() };
    let Some(views) = light::replaced(pictures, &levelled.pictures) else { return as_they_are() };
    let n_left = broken(&views).n_accused();
    if is_whole && n_left > found.n_accused() {
        return as_they_are();
    }
    let (mut judged, lit) = look(code, &views, absent, min_contrast);
    // Pairs tell lights and exposures better, where all of them are there and nothing else comes of it.
    let settled = is_whole.then(|| settled(code, pictures, absent, min_contrast, judged.clone(), &lit));
    let settled = settled.filter(|it| it.is_evened() && it.accuses_no_more_than(&judged));
    drop(views);
    let levelled = settled.unwrap_or_else(|| {
        judged.faults.insert(0, levelled.fault);
        judged.relit = levelled.pictures;
        judged
    });
    // Of a set with all its pictures fewer broken rules say that it is so; with others, that all of it can be decoded. Lights of phase steps are known less well: with anything else wrong they are not relied on.
    let is_better = if is_whole { n_left < found.n_accused() } else { is_all_usable(&levelled) };
    if levelled.n_accused() == 0 || is_better && code.steps == 0 {
        return levelled;
    }
    let as_they_are = as_they_are();
    if code.steps > 0 {
        return as_they_are;
    }
    if as_they_are.soundness(code) >= levelled.soundness(code) { as_they_are } else { levelled }
}

/// What is found of a set once pairs tell its light and exposures; `found` is what was found without, and `lit` the pixels that the projector lights.
fn settled(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    absent: &[usize],
    min_contrast: u8,
    found: Examination,
    lit: &[(usize, u8, u8)],
) -> Examination {
    let n = code.pictures().len();
    // Where something is wrong with a whole set, its pictures may well stand in their places.
    let natural = || (0..n).map(|it| Some(it).filter(|it| !absent.contains(it))).collect();
    let is_whole = pictures.len() == n;
    // Pictures that are taken for each other are of no other exposure: a step is brighter than a bit's inverse.
    let is_put_right = found.faults.iter().any(|it| matches!(it, SetFault::Exchanged { mended: true, .. }));
    let places: Vec<Option<usize>> = if is_whole && !is_put_right { natural() } else { found.places.clone() };
    let pairs = exposure::factors_of_pairs(code, pictures, &places, lit);
    let fade = if is_whole { fade::faded(&pairs, code, &places) } else { None };
    if fade.is_none()
        && is_whole
        && let Some(without) = light::in_one_light(code, pictures, absent, min_contrast, &found, lit, &places)
    {
        return without;
    }
    let evened = |uneven: &[(usize, f64)]| -> Vec<(usize, Vec<u8>)> {
        uneven.iter().map(|(at, factor)| (*at, exposure::evened(pictures[*at].pixels(), *factor))).collect()
    };
    let uneven = match &fade {
        Some(fade) => {
            let all = evened(&fade.factors);
            let Some(views) = light::replaced(pictures, &all) else { return found };
            // What is left, as in phase steps.
            let left = exposure::uneven(code, &views, &places, lit);
            let more = |at: usize| left.iter().find(|it| it.0 == at).map_or(1.0, |it| it.1);
            fade.factors.iter().map(|(at, factor)| (*at, factor * more(*at))).collect()
        }
        None => exposure::uneven_by(&pairs, code, pictures, &places, lit),
    };
    if uneven.is_empty() {
        return found;
    }
    let all = evened(&uneven);
    let Some(views) = light::replaced(pictures, &all) else { return found };
    let (mut found, _) = look(code, &views, absent, min_contrast);
    match fade.as_ref().and_then(Fade::ends) {
        Some((ends, factor)) => {
            let is_told = (factor - 1.0).abs() > TOLD;
            found.faults.splice(0..0, is_told.then_some(SetFault::Faded { ends, factor }));
        }
        None => {
            let told: Vec<(usize, f64)> = uneven.iter().copied().filter(|it| (it.1 - 1.0).abs() > TOLD).collect();
            if !told.is_empty() {
                found.faults.insert(0, SetFault::Uneven { pictures: told });
            }
        }
    }
    found.uneven = uneven;
    found
}

/// The same, with the exposures that pictures have, and the pixels that are lit.
fn look(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    absent: &[usize],
    min_contrast: u8,
) -> (Examination, Vec<(usize, u8, u8)>) {
    let (mut found, lit) = at_first_sight(code, pictures, absent, min_contrast, Asked::Why);
    if open::is_open(code, &found)
        && let Some((width, height)) = pictures.first().map(|it| it.size())
    {
        let present: Vec<usize> = (0..pictures.len()).filter(|it| !absent.contains(it)).collect();
        let step = ((width * height) as f64 / SAMPLES as f64).sqrt().ceil() as usize;
        let samples = spread((width, height), step);
        let least = (NOISE_RANGE * found.noise).max(f64::from(min_contrast.max(1)));
        let even = lit_of(&samples, &Wild::of(code, &present).ranges(pictures, &samples), least);
        let (shown, skipped) = (code.pictures(), absent.to_vec());
        let set = Set { code, pictures, shown: &shown, lit: &even, width, noise: found.noise, skipped };
        open::settle(&set, &mut found);
    }
    (found, lit)
}

/// What is asked of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    /// Which rules it breaks.
    Rules,
    /// And why: which pictures lack, or stand elsewhere. Of a set that breaks many rules this takes much longer.
    Why,
}

/// As [`look`], with what the rules of a Gray code leave open.
fn at_first_sight(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    absent: &[usize],
    min_contrast: u8,
    asked: Asked,
) -> (Examination, Vec<(usize, u8, u8)>) {
    let shown = code.pictures();
    let mut found = Examination { places: vec![None; shown.len()], ..Examination::default() };
    let present: Vec<usize> = (0..pictures.len()).filter(|it| !absent.contains(it)).collect();
    let sound = |picture: usize| pictures[picture].size();
    let Some(first) = present.first().map(|it| &pictures[*it]).filter(|it| !it.pixels().is_empty()) else {
        let (found_pictures, expected) = (present.len(), shown.len());
        found.faults.push(SetFault::Count { found: found_pictures, expected, unpaired: None, is_explained: false });
        return (found, Vec::new());
    };
    if let Some(at) = present.iter().copied().find(|it| sound(*it) != first.size()) {
        found.faults.push(SetFault::Size { picture: at, found: sound(at), expected: first.size() });
        return (found, Vec::new());
    }
    // The noise of the least noisy half: stripes as fine as pixels look like noise.
    let mut noises: Vec<f64> = present.iter().map(|it| super::noise::noise(&pictures[*it])).collect();
    noises.sort_by(f64::total_cmp);
    found.noise = noises[noises.len() / 4];
    let samples = sampled(first.size(), SAMPLES);
    let wild = Wild::of(code, &present);
    let ranges: Vec<(u8, u8)> = wild.ranges(pictures, &samples);
    let least = (NOISE_RANGE * found.noise).max(f64::from(min_contrast.max(1)));
    let mut lit = lit_of(&samples, &ranges, least);
    found.lit = lit.len() as f64 / samples.len() as f64;
    let needed = least.round().min(255.0) as u8;
    if found.lit < MIN_LIT {
        found.faults = unlit(code, &found, pictures.len(), present.len(), &ranges, needed);
        return (found, lit);
    }
    let reached = (NOISE_RANGE * found.noise).max(REACHED);
    let by_all = lit_of(&samples, &ranges, reached).len() as f64 / samples.len() as f64;
    // A light of the room that changes reaches more than the projector does, but not between white and black.
    let reached =
        by_white(code, pictures, absent, &samples, reached).map_or(by_all, |it| it.max(found.lit).min(by_all));
    let is_dim = found.lit < DIM * reached;
    if is_dim {
        found.faults.push(SetFault::Dim { lit: found.lit, reached, needed });
    }
    let saturated = lit.iter().filter(|it| it.2 >= SATURATED).count() as f64 / lit.len() as f64;
    if saturated > 0.5 {
        found.faults.push(SetFault::TooBright { saturated });
    }
    let width = first.size().0;
    let noise = found.noise;
    let set = |lit, skipped| Set { code, pictures, shown: &shown, lit, width, noise, skipped };
    let mut skipped = absent.to_vec();
    if pictures.len() != shown.len() {
        if asked == Asked::Rules {
            let (n, expected) = (pictures.len(), shown.len());
            found.faults.push(SetFault::Count { found: n, expected, unpaired: None, is_explained: false });
            return (found, lit);
        }
        let samples = lattice(first.size(), MANY_SAMPLES);
        let many = lit_of(&samples, &wild.ranges(pictures, &samples), least);
        let all = set(&many, skipped);
        let signs = all.signs();
        let n = pictures.len();
        let count =
            |unpaired, is_explained| SetFault::Count { found: n, expected: shown.len(), unpaired, is_explained };
        let layouts = Layouts::of(&all);
        // A bit more with its inverse, all in their places, is no pair of pictures too many; another period may have more bits, too.
        if n > shown.len() + 1
            && let Some(bits) = layouts.other_size()
            && layouts.other_waves().is_none()
        {
            found.faults.push(SetFault::OtherSize { bits, found: n });
            return (found, lit);
        }
        if let Some(explained) = layouts.few_lack() {
            // What more pixels tell of them.
            let other = explain::explain(code, n, &all.skipped, &signs).filter(|it| it.says_the_same(&explained));
            let explained = other.unwrap_or(explained);
            found.faults.push(count(None, true));
            found.take(explained, &all.skipped);
            return (found, lit);
        }
        if let Some(slip) = layouts.one_slip() {
            found.faults.push(count(None, true));
            found.take(slip, &all.skipped);
            return (found, lit);
        }
        if let Some(part) = layouts.part(&signs) {
            found.faults.push(count(None, true));
            found.take(part, &all.skipped);
            return (found, lit);
        }
        if let Some(other) = layouts.whole(&signs) {
            found.faults.push(SetFault::OtherOrder { code: Box::new(other) });
            return (found, lit);
        }
        if let Some(other) = layouts.other_waves() {
            found.faults.push(SetFault::OtherWaves { steps: other.steps, period: other.period, found: n });
            return (found, lit);
        }
        if let Some(bits) = explain::other_bits(code, n, &all.skipped, &signs) {
            found.faults.push(SetFault::OtherSize { bits, found: n });
            return (found, lit);
        }
        let one_axis = || explain::one_axis(code, n, &all.skipped, &signs);
        let explained = explain::explain(code, n, &all.skipped, &signs).or_else(one_axis);
        let explained = explained.filter(|it| !is_dim || is_plain(&it.faults, n));
        match explained {
            Some(explained) => {
                found.faults.push(count(None, true));
                found.take(explained, &all.skipped);
            }
            None => {
                let few = set(&lit, all.skipped.clone());
                found.faults.push(count(few.first_unpaired(), false));
                found.faults.extend(few.doubled());
            }
        }
        return (found, lit);
    }
    found.faults.extend(absent.iter().map(|it| SetFault::Unreadable { picture: *it, shown: shown[*it] }));
    found.places = (0..shown.len()).map(|it| Some(it).filter(|it| !absent.contains(it))).collect();
    let scenes = stretches::scenes(code, pictures, &found.places, &lit, noise);
    if let Some(it) = &scenes.stretches {
        let used = &it.pictures[it.kept];
        let ends = [used[0], used[used.len() - 1]];
        let between = it.pictures.windows(2).map(|it| (it[0][it[0].len() - 1], it[1][0]));
        let between = between.zip(&it.light);
        found.faults.extend(between.map(|((last, first), light)| SetFault::Moved {
            last,
            first,
            used: ends,
            but: None,
            light: *light,
        }));
        skipped.extend((0..pictures.len()).filter(|it| !used.contains(it) && !absent.contains(it)));
        found.places.iter_mut().for_each(|it| *it = it.filter(|it| used.contains(it)));
        let wild = Wild::of(code, used);
        lit = lit_of(&samples, &wild.ranges(pictures, &samples), least);
    }
    if let Some((used, faults)) =
        still::of_one_scene(&Set { code, pictures, shown: &shown, lit: &lit, width, noise, skipped: skipped.clone() })
    {
        found.faults.extend(faults);
        skipped.extend((0..pictures.len()).filter(|it| !used.contains(it) && !absent.contains(it)));
        found.places.iter_mut().for_each(|it| *it = it.filter(|it| used.contains(it)));
        lit = lit_of(&samples, &Wild::of(code, &used).ranges(pictures, &samples), least);
    }
    let odd = set(&lit, skipped.clone()).odd();
    for (picture, fault) in odd {
        skipped.push(picture);
        found.places[picture] = None;
        found.faults.push(fault);
    }
    let set = |lit| set(lit, skipped.clone());
    let mut faults = set(&lit).broken_rules();
    let is_sound = faults.is_empty();
    if is_sound {
        let is_there = |it: &&(Shown, [usize; 2])| !it.1.iter().any(|it| skipped.contains(it));
        let odd = scenes.odd.iter().filter(|it| matches!(it.0, Shown::Bit { .. })).filter(is_there);
        faults.extend(odd.map(|(shown, pictures)| SetFault::NotInverse {
            shown: *shown,
            pictures: *pictures,
            share: 0.0,
        }));
    }
    set(&lit).tell_other_scenes(&mut faults);
    if faults.is_empty() && code.steps > 0 {
        let few = set(&lit);
        let layouts = Layouts::of(&few);
        if layouts.has_bits_for_steps(code)
            && let Some(other) = layouts.other_waves()
        {
            let n = pictures.len();
            found.faults.push(SetFault::OtherWaves { steps: other.steps, period: other.period, found: n });
            return (found, lit);
        }
    }
    if faults.is_empty()
        && let Some([a, b]) = set(&lit).steps_exchanged_across()
    {
        found.places.swap(a, b);
        found.faults.push(SetFault::Exchanged { pictures: [a, b], expected: [shown[a], shown[b]], mended: true });
    }
    // What moved in a part of the picture alone spoils that part and not the set.
    faults.retain(|it| !is_sound || matches!(it, SetFault::OtherScene { .. }));
    if faults.is_empty() {
        return (found, lit);
    }
    if faults.iter().all(|it| matches!(it, SetFault::OtherScene { .. })) {
        for it in &faults {
            if let SetFault::OtherScene { picture, .. } = it {
                found.places[*picture] = None;
            }
        }
        found.faults.extend(faults);
        return (found, lit);
    }
    if asked == Asked::Rules {
        found.faults.extend(faults);
        return (found, lit);
    }
    let kept: Vec<usize> = (0..pictures.len()).filter(|it| !skipped.contains(it)).collect();
    let samples = lattice(first.size(), MANY_SAMPLES);
    let many = lit_of(&samples, &Wild::of(code, &kept).ranges(pictures, &samples), least);
    let all = set(&many);
    let n = pictures.len();
    let signs = all.signs();
    let few = set(&lit);
    let layouts = Layouts::of(&few);
    let is_beyond = |it: &SetFault| matches!(it, SetFault::OutOfRange { .. });
    // What keeps the code's promises is not what is wrong.
    let sound = all.sound_axes(&faults);
    let is_accused = |it: &SetFault| it.axes().is_some_and(|axes| axes.iter().any(|it| sound.contains(it)));
    if !faults.iter().any(is_beyond)
        && let Some(slip) = layouts.one_slip().filter(|it| !it.faults.iter().any(is_accused))
    {
        found.take(slip, &all.skipped);
        return (found, lit);
    }
    if let Some(other) = layouts.whole(&signs) {
        found.faults.push(SetFault::OtherOrder { code: Box::new(other) });
        return (found, lit);
    }
    if let Some(other) = layouts.other_waves() {
        found.faults.push(SetFault::OtherWaves { steps: other.steps, period: other.period, found: n });
        return (found, lit);
    }
    if let Some(bits) = explain::other_bits(code, n, &all.skipped, &signs) {
        found.faults.push(SetFault::OtherSize { bits, found: n });
        return (found, lit);
    }
    if faults.iter().all(is_beyond)
        && let Some(other) = code.with_other_centre()
        && (Set { code: &other, ..set(&lit) }).broken_rules().is_empty()
    {
        found.faults.push(SetFault::OtherOrder { code: Box::new(other) });
        return (found, lit);
    }
    if faults.iter().any(is_beyond)
        && let Some(other) = explain::with_axes_exchanged(code, &signs)
    {
        found.faults.push(SetFault::OtherOrder { code: Box::new(other) });
        return (found, lit);
    }
    let explained = explain::explain(code, n, &all.skipped, &signs);
    if is_dim && explained.as_ref().is_none_or(|it| !is_plain(&it.faults, n)) {
        // Too little is lit to tell what is wrong beside.
        found.places.fill(None);
        return (found, lit);
    }
    match explained {
        Some(mut explained) => {
            sound.iter().for_each(|it| explained.clear(*it, &shown));
            // Pictures in each other's places are taken for each other where the set is sound so.
            let put_right: Option<Vec<ImageView<'_>>> =
                explained.places.iter().map(|it| Some(pictures[(*it)?])).collect();
            let is_sound = put_right.is_some_and(|it| (Set { pictures: &it, ..set(&lit) }).broken_rules().is_empty());
            for it in &mut explained.faults {
                match it {
                    SetFault::Exchanged { mended, .. } | SetFault::Inverted { mended, all: false, .. } => {
                        *mended = is_sound;
                    }
                    _ => {}
                }
            }
            found.take(explained, &all.skipped);
        }
        None => {
            for it in &faults {
                match it {
                    SetFault::OtherScene { picture, .. } | SetFault::NotWhite { picture, .. } => {
                        found.places[*picture] = None;
                    }
                    SetFault::WhiteIsBlack { white, black } => found.places.swap(*white, *black),
                    SetFault::Doubled { picture, same_as, .. } => {
                        // Which of the two is the one that was taken twice, nothing tells.
                        for picture in [*picture, *same_as] {
                            found.unsure.extend(explain::bit_at(&shown, picture));
                        }
                        found.places[*picture] = None;
                    }
                    _ => {}
                }
            }
            // A picture that is there twice is not the inverse of another, and that is said.
            let doubled: Vec<usize> = faults
                .iter()
                .filter_map(|it| if let SetFault::Doubled { picture, .. } = it { Some(*picture) } else { None })
                .collect();
            let is_said = |it: &SetFault| matches!(it, SetFault::NotInverse { pictures, .. } if pictures.iter().any(|it| doubled.contains(it)));
            found.faults.extend(faults.into_iter().filter(|it| !is_said(it)));
        }
    }
    (found, lit)
}

/// Part of the pixels in which white is brighter than black by this and more [gray levels], in a set with all its pictures.
fn by_white(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    absent: &[usize],
    samples: &[usize],
    least: f64,
) -> Option<f64> {
    let place = |shown| code.place(shown).filter(|it| !absent.contains(it) && pictures.len() == code.pictures().len());
    let [white, black] = [place(Shown::White)?, place(Shown::Black)?].map(|it| pictures[it].pixels());
    let n = samples.iter().filter(|it| f64::from(white[**it]) - f64::from(black[**it]) >= least).count();
    Some(n as f64 / samples.len().max(1) as f64)
}

impl Examination {
    /// Whether anything can be decoded, how little is wrong with pictures beside their light, and how many axes can be decoded: of two sets the sounder one has more.
    fn soundness(&self, code: &StripeCode) -> (bool, Reverse<usize>, usize) {
        let usable = self.usable(code).len();
        (usable > 0, Reverse(self.n_accused()), usable)
    }

    /// Whether all that is wrong with its pictures beside their light is wrong with those of another one, too.
    fn accuses_no_more_than(&self, other: &Examination) -> bool {
        let kinds = |of: &Examination| of.accused().map(std::mem::discriminant).collect::<Vec<_>>();
        let others = kinds(other);
        self.n_accused() <= other.n_accused() && kinds(self).iter().all(|it| others.contains(it))
    }

    fn n_accused(&self) -> usize {
        self.accused().count()
    }

    /// What is wrong with pictures beside their light.
    fn accused(&self) -> impl Iterator<Item = &SetFault> {
        let is_light = |it: &SetFault| {
            matches!(
                it,
                SetFault::Dim { .. }
                    | SetFault::TooBright { .. }
                    | SetFault::Unreadable { .. }
                    | SetFault::Uneven { .. }
                    | SetFault::Faded { .. }
                    | SetFault::Relit { .. }
                    | SetFault::Unsteady { .. }
            )
        };
        self.faults.iter().filter(move |it| !is_light(it))
    }

    /// Whether its pictures were brought into one light or one exposure.
    fn is_evened(&self) -> bool {
        !self.relit.is_empty() || !self.uneven.is_empty()
    }

    /// Takes what was found, of pictures of which none of `skipped` shows anything.
    fn take(&mut self, explained: Explained, skipped: &[usize]) {
        self.faults.extend(explained.faults);
        self.places = explained.places.into_iter().map(|it| it.filter(|it| !skipped.contains(it))).collect();
        self.unsure = explained.unsure;
    }
}

/// Whether what is said to be wrong concerns few of `n` pictures: where little is lit, more of it is noise.
fn is_plain(faults: &[SetFault], n: usize) -> bool {
    faults.len() as f64 <= DIM_WRONG * n as f64
}

#[cfg(test)]
mod tests;
