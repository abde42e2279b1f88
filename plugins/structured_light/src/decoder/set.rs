//! One set of pictures: it is examined, equalised where possible, decoded, and its faults are reported with the names of its pictures.

use std::borrow::Cow;

use foveate::imaging::ImageView;
use foveate::imaging::stripes::code::{Axis, Group, Shown};
use foveate::imaging::stripes::drift::drift;
use foveate::imaging::stripes::ends::leave_out_soft_ends;
use foveate::imaging::stripes::finest::{TooFine, unresolved_periods};
use foveate::imaging::stripes::gray::DecodeOptions;
use foveate::imaging::stripes::ordering::leave_out_backwards;
use foveate::imaging::stripes::steady::Steadied;
use foveate::imaging::stripes::{Prepared, SetFault, edges, examine, response};
use foveate::prelude::*;

use super::Decoder;
use super::creep::{crept, has_moved};
use super::levels::coarser;
use super::words::{
    backwards_in_words, crept_in_words, exchanged_in_words, lacking_finest_in_words, moved_a_little_in_words,
    out_of_focus_in_words, soft_in_words, steps_in_words, too_fine_in_words, unresolved_in_words,
};
use crate::moved::Blocks;

/// What a set is taken to have changed by in a block of the picture: more than this [gray level], and this part of white and black together. More than the collector allows: cameras of others are
/// not linear, and pack pictures.
const CHANGE: [f32; 2] = [6.0, 0.04];
/// Changed blocks over lit ones that are worth a remark.
const CHANGED_SHARE: f64 = 0.005;
/// Pictures that are named one by one.
const NAMED: usize = 6;
/// Where nothing else is said of a set, fewer known pixels over lit ones than this are worth a remark [–].
const SCARCE: f64 = 0.25;
/// Phase steps that fit no wave are reported from this part of the pixels on [–].
const OFF_WAVE: f64 = 0.2;
/// Where noise decides, fewer known pixels over lit ones than this are worth a remark [–].
const NOISY: f64 = 0.6;

/// What is decoded of a set.
pub(super) struct Map {
    pub map: ProjectorMap,
    pub white: Vec<u8>,
    /// Pixels that the projector lights.
    pub lit: u64,
    pub faults: Vec<String>,
}

impl Decoder {
    /// Decodes a set; without an axis that can be decoded, what is wrong with it.
    pub(super) fn decode(&mut self, set: &PatternPictures) -> Result<Map, Vec<String>> {
        let one = |fault: String| vec![fault];
        let code = self.code_of(set).map_err(one)?;
        let (width, height) = (set.width as usize, set.height as usize);
        if let Some([columns, rows]) = self.camera_size.filter(|it| *it != [set.width, set.height]) {
            let fault = format!(
                "the pictures are {width} x {height} px, expected {columns} x {rows} px as the camera in the calibration"
            );
            return Err(one(fault));
        }
        let views: Vec<ImageView<'_>> = (0..set.names.len())
            .map(|it| ImageView::new(set.picture(it).unwrap_or_default(), width, height))
            .collect::<Result<_, _>>()
            .map_err(|fault| one(fault.to_string()))?;
        let exponent = response::exponent(&code, &views);
        let straight: Vec<Vec<u8>> = exponent
            .map(|it| views.iter().map(|view| response::straightened(view.pixels(), it)).collect())
            .unwrap_or_default();
        let views = if straight.is_empty() {
            views
        } else {
            let views = straight.iter().map(|it| ImageView::new(it, width, height));
            views.collect::<Result<_, _>>().map_err(|fault| one(fault.to_string()))?
        };
        // What nobody resolves is no part of the set: it would look like pictures that lack.
        let whole = TooFine::of(&code, &views, self.settings.min_contrast);
        let (told, told_code) = (code.pictures(), code.clone());
        let unresolved = unresolved_periods(&code, &views, self.settings.min_contrast);
        let is_resolved = |it: &Group| !matches!(it, Group::Stripes(axis) if unresolved[axis.index()].is_some());
        let coarse: Vec<String> = Axis::BOTH
            .into_iter()
            .filter_map(|axis| Some(unresolved_in_words(axis, unresolved[axis.index()]?, code.period)))
            .collect();
        let mut code = code.without_finest(whole.overall());
        code.order.retain(is_resolved);
        if !Axis::BOTH.into_iter().any(|it| code.has(it)) {
            return Err(coarse);
        }
        let left = code.pictures();
        let is_left = |it: usize| told.len() != views.len() || left.contains(&told[it]);
        let kept: Vec<usize> = (0..views.len()).filter(|it| is_left(*it)).collect();
        let all_views = views;
        let views: Vec<ImageView<'_>> = kept.iter().map(|it| all_views[*it]).collect();
        let is_unreadable = |it: &usize| set.unreadable.iter().any(|at| *at as usize == *it);
        let unreadable: Vec<usize> = (0..kept.len()).filter(|it| is_unreadable(&kept[*it])).collect();
        let min_contrast = self.settings.min_contrast;
        let found = examine(&code, &views, &unreadable, min_contrast);
        // Of a set in another order these are others of its pictures than the finest.
        if kept.len() < all_views.len() && !found.faults.is_empty() {
            let unreadable: Vec<usize> = (0..all_views.len()).filter(is_unreadable).collect();
            let whole = examine(&told_code, &all_views, &unreadable, min_contrast);
            let is_other = |it: &&SetFault| matches!(it, SetFault::OtherOrder { .. });
            if let Some(other) = whole.faults.iter().find(is_other) {
                return Err(one(other.describe(&told_code, &|it| format!("`{}`", set.names[it]))));
            }
        }
        // What crept far looks like a scene that changed.
        let early = if has_moved(&found) { crept(&code, &views, min_contrast) } else { None };
        let (views, found) = match &early {
            Some((_, steadied)) => {
                let steady = views_of(&steadied.pictures, [width, height]).map_err(one)?;
                let found = examine(&code, &steady, &unreadable, min_contrast);
                (steady, found)
            }
            None => (views, found),
        };
        let name = |it: usize| {
            let name = kept.get(it).and_then(|it| set.names.get(*it));
            name.map_or_else(|| format!("picture {it}"), |it| format!("`{it}`"))
        };
        let mut faults = coarse;
        faults.extend(found.faults.iter().map(|it| it.describe(&code, &name)));
        if let Some(exponent) = exponent {
            faults.push(format!(
                "gray levels are not proportional to light: the camera's response was linearised with the exponent {exponent:.2}"
            ));
        }
        let axes = found.usable(&code);
        let for_want = |axis: Axis| {
            let lacking: Vec<String> = found.lacking(&code, axis).iter().map(Shown::to_string).collect();
            match lacking.len() {
                0 => String::new(),
                1..=NAMED => format!(" for lack of {}", lacking.join(" and of ")),
                n => format!(" for lack of {n} pictures"),
            }
        };
        if axes.is_empty() {
            // No particular picture is missing from a set that could not be identified at all.
            let moved = has_moved(&found);
            let left_out =
                Axis::BOTH.into_iter().filter(|it| moved && code.has(*it)).map(|axis| (axis, for_want(axis)));
            let words = left_out.filter(|it| !it.1.is_empty());
            faults.extend(words.map(|(axis, help)| format!("the {} cannot be decoded{help}", axis.in_words())));
            return Err(faults);
        }
        for axis in Axis::BOTH.into_iter().filter(|it| code.has(*it) && !axes.contains(it)) {
            let other = Axis::BOTH[1 - axis.index()].in_words();
            let help = for_want(axis);
            faults.push(format!(
                "the {} are left out{help}, and points come from the {other} alone: where these determine depth poorly, errors of the calibration between camera and projector are not in their sigma, and \
                 cannot be detected",
                axis.in_words()
            ));
        }
        let all_shown = code.pictures();
        faults.extend(Axis::BOTH.into_iter().filter(|it| axes.contains(it)).filter_map(|axis| {
            lacking_finest_in_words(axis, code.bits[axis.index()], found.finest_left_out(&code)[axis.index()])
        }));
        let undecoded = Axis::BOTH.into_iter().find(|it| code.has(*it) && !axes.contains(it));
        let in_shadow = undecoded.map_or(Vec::new(), |axis| found.dark_in(&code, &views, axis));
        let Prepared { code, pictures, worked_out } = found.prepared(&code, &views);
        let (steps, bits): (Vec<&Shown>, Vec<&Shown>) =
            worked_out.iter().partition(|it| matches!(it, Shown::Phase { .. }));
        for (list, others) in
            [(bits, "the other picture of its bit, white and black"), (steps, "the other steps of its wave")]
        {
            let list: Vec<String> = list.iter().map(ToString::to_string).collect();
            if !list.is_empty() {
                faults.push(format!("reconstructed from {others}: {}", list.join(" and ")));
            }
        }
        self.worked_out = worked_out;
        let seen = views_of(&pictures, [width, height]).map_err(one)?;
        let is_early = early.is_some();
        let (drift, steadied) = match &early {
            Some((drift, steadied)) => (Some(drift.clone()), Some(Cow::Borrowed(steadied))),
            None => {
                let drift = drift(&code, &seen, min_contrast);
                let crept = drift.as_ref().filter(|it| it.creeps());
                let steadied = crept.and_then(|it| Steadied::of(&code, &seen, it, min_contrast));
                (drift, steadied.map(Cow::Owned))
            }
        };
        let pictures: Vec<Cow<'_, [u8]>> = match &steadied {
            Some(steadied) if !is_early => steadied.pictures.iter().map(|it| Cow::Borrowed(it.as_slice())).collect(),
            _ => pictures,
        };
        let views = views_of(&pictures, [width, height]).map_err(one)?;
        let changed = Some(Blocks::of(&code, &views, CHANGE)).filter(|it| it.share() > 0.0);
        let noise = self.settings.noise.max(found.noise);
        // Three standard deviations of a difference of two pixels.
        let by_noise = (3.0 * std::f64::consts::SQRT_2 * found.noise + 0.5).min(127.0) as u8;
        let options = DecodeOptions {
            min_contrast: self.settings.min_contrast.max(by_noise),
            min_difference: self.settings.min_difference.max(by_noise),
            min_direct: self.settings.min_direct,
            threads: self.settings.threads,
            ..DecodeOptions::default()
        };
        let in_parts = TooFine::of(&code, &views, self.settings.min_contrast);
        let (mut coordinates, filled) =
            self.coordinates(&code, &views, &axes, &options, &in_parts, noise).map_err(one)?;
        let soft = leave_out_soft_ends(&mut coordinates, &self.decoded.contrast, code.projector);
        faults.extend(Axis::BOTH.into_iter().filter(|it| soft[it.index()] > 0.0).filter_map(|axis| {
            let values = &coordinates.values[axis.index()];
            // What is decoded are the stripes of the last of the codes that were tried.
            let (code, views) = coarser(&code, &views, self.level);
            let of_stripes = edges::stripe_blur(&code, &views, &self.decoded, axis, values).ok().flatten();
            soft_in_words(axis, soft[axis.index()], of_stripes)
        }));
        let backwards = leave_out_backwards(&mut coordinates);
        faults.extend(Axis::BOTH.into_iter().filter_map(|it| backwards_in_words(it, backwards[it.index()])));
        faults.extend(too_fine_in_words(&told_code, &whole, &in_parts, filled));
        faults.extend(out_of_focus_in_words(coordinates.blur));
        if let Some(drift) = &drift {
            match &steadied {
                Some(steadied) => steadied.widen(&mut coordinates),
                None => drift.widen(&mut coordinates),
            }
            let told = code.pictures();
            let place = |it: usize| all_shown.iter().position(|shown| *shown == told[it]);
            let names = [drift.last, drift.first]
                .map(|it| place(it).and_then(|it| found.picture_at(it)).map_or_else(|| told[it].to_string(), name));
            faults.push(match &steadied {
                Some(steadied) => crept_in_words(&names, steadied),
                None => moved_a_little_in_words(&names, drift.by.norm()),
            });
        }
        let white = match code.place(Shown::White) {
            Some(it) => views[it].pixels().to_vec(),
            None => brightest(&views),
        };
        let mut map = ProjectorMap {
            camera: set.camera,
            name: set.name.clone(),
            projector_size: code.projector,
            width: set.width,
            height: set.height,
            ..ProjectorMap::default()
        };
        map.samples.reserve_exact(16 * white.len());
        let of = |list: &[Vec<f32>; 2], at: usize| {
            Axis::BOTH.map(|it| list[it.index()].get(at).copied().unwrap_or(f32::NAN))
        };
        let mut is_left_out = if in_shadow.is_empty() { vec![false; white.len()] } else { in_shadow };
        let is_changed = changed.as_ref().is_some_and(|it| it.share() > CHANGED_SHARE);
        if let Some(changed) = &changed {
            changed.each_row([width, height], |row, from, to| is_left_out[row * width..][from..to].fill(true));
            if is_changed {
                // Where these pictures stand in the set.
                let told = code.pictures();
                let all = all_shown.iter().zip(0..);
                let places: Vec<usize> = changed
                    .pictures()
                    .iter()
                    .filter_map(|it| all.clone().find(|(shown, _)| **shown == told[*it]).map(|it| it.1))
                    .filter_map(|it: usize| found.picture_at(it))
                    .collect();
                let mut names: Vec<String> = places.iter().take(NAMED).map(|it| name(*it)).collect();
                if places.len() > NAMED {
                    names.push(format!("{} more", places.len() - NAMED));
                }
                faults.push(format!(
                    "bits and their inverses do not add up to white and black in {:.0} % of the lit pixels, which are left out: something moved during the set, or a lamp or the \
                     camera's exposure changed, most in {}; motion that leaves no such trace is decoded wrongly",
                    100.0 * changed.share(),
                    names.join(", ")
                ));
            }
        }
        for (at, is_left_out) in is_left_out.into_iter().enumerate() {
            if is_left_out {
                map.push(ProjectorSample::NONE);
                continue;
            }
            let (coordinate, sigma) = (of(&coordinates.values, at), of(&coordinates.sigmas, at));
            map.push(ProjectorSample { coordinate, sigma });
        }
        let n_told = faults.len();
        let exchanged = |axis: Axis| Some(exchanged_in_words(axis, self.exchanged[axis.index()]?));
        faults.extend(Axis::BOTH.into_iter().filter_map(exchanged));
        faults.extend(Axis::BOTH.into_iter().filter_map(|axis| steps_in_words(axis, self.steps[axis.index()])));
        let least = self.settings.min_contrast;
        let lit = self.decoded.contrast.iter().filter(|it| **it >= least).count() as u64;
        if self.off_wave > OFF_WAVE {
            faults.push(format!(
                "at {:.0} % of the pixels the phase steps fit no wave, and these are left out: something moved during them, light arrives over other surfaces, or the steps are in another order",
                100.0 * self.off_wave
            ));
        } else if u32::from(by_noise) > u32::from(self.settings.min_difference)
            && (map.n_known as f64) < NOISY * lit as f64
        {
            faults.push(format!(
                "noise of {:.1} gray levels leaves {:.0} % of the pixels with {least} or more between white and black: only differences above {by_noise} are certain. Use more light, less gain, or means of several \
                 pictures of each pattern",
                found.noise,
                100.0 * map.n_known as f64 / lit.max(1) as f64
            ));
        }
        if faults.len() == n_told && !is_changed && (map.n_known as f64) < SCARCE * lit as f64 {
            faults.push(format!(
                "{:.1} % of the pixels lit by {least} gray levels or more could be decoded, expected most: the stripes are weak against ambient light or out of focus, or the code is another one",
                100.0 * map.n_known as f64 / lit as f64
            ));
        }
        Ok(Map { map, white, lit, faults })
    }
}

/// Views of pictures of one size.
fn views_of<T: AsRef<[u8]>>(pictures: &[T], [width, height]: [usize; 2]) -> Result<Vec<ImageView<'_>>, String> {
    pictures.iter().map(|it| ImageView::new(it.as_ref(), width, height).map_err(|fault| fault.to_string())).collect()
}

/// By pixel the brightest of all pictures.
fn brightest(views: &[ImageView<'_>]) -> Vec<u8> {
    let mut all = views.first().map(|it| it.pixels().to_vec()).unwrap_or_default();
    for view in views {
        all.iter_mut().zip(view.pixels()).for_each(|(to, it)| *to = (*to).max(*it));
    }
    all
}
