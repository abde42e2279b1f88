//! How a surface moves through the stripes, from known boundaries: predicts where they are next.
//!
//! In a row of the picture a boundary of number ν stands at X(ν). A surface that moves without turning moves all of that by `pixels`, and as it goes through the light, by `stripes`: the place that boundary
//! ν − stripes lit is lit by boundary ν a picture later, X′(ν) = X(ν − stripes) + pixels. Two numbers for all of the surface, found from where thousands of boundaries were and are; what lies flat to its own
//! motion, also what rests, agrees with any such pair. On a curved surface boundaries speed up and slow down: where boundary ν goes next, less where it has just gone, is
//! X(ν − stripes) − 2 X(ν) + X(ν + stripes).

use super::design::BoundaryCode;
use super::track::Track;

/// How far the surface goes from picture to picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sliding {
    /// Through the light, towards higher numbers where positive [stripes].
    pub stripes: f32,
    /// In the camera's picture, less the caller's prediction [px].
    pub pixels: f32,
}

/// Where the known boundaries of a row are: numbers, counted on beyond the end of the code, and columns [px], both ascending.
pub(super) type Profile = Vec<(f32, f32)>;

/// Boundaries that are so far apart in number do not say what is between them.
const WIDEST: f32 = 3.0;
/// One stripe is wider than the next by no more than this, or another surface begins there [–].
const STEEPER: f32 = 1.6;
/// From one surface to the next numbers are counted on by this.
const APART: f32 = 1000.0;
/// A surface goes no farther through the light from picture to picture [stripes].
const FARTHEST: f32 = 2.0;
/// Steps of the search, first and then [stripes].
const STEPS: [f32; 3] = [0.25, 0.06, 0.015];
/// Rows that are asked, at most, …
const ROWS: usize = 48;
/// … and boundaries, at most and at least.
const MOST: usize = 600;
const LEAST: usize = 100;
/// What a boundary is off more than this by counts as this: it is on another surface [px].
const CUT: f32 = 1.5;
/// Where boundaries are off no more than this on average, a surface that rests explains them well enough [px].
const LEAST_OFF: f32 = 0.1;
/// A surface that goes through the light explains where boundaries are so much better than one that rests [–].
const BETTER: f32 = 0.8;

/// Whether a track is in the profile of its row.
pub(super) fn is_in_profile(track: &Track) -> bool {
    track.number().is_some() && track.fits_all()
}

/// The known boundaries of a row.
pub(super) fn profile(row: &[Track]) -> Profile {
    let n = BoundaryCode::get().len();
    let mut found: Profile = Vec::with_capacity(row.len());
    let mut last: Option<usize> = None;
    for track in row {
        let Some(number) = track.number().filter(|_| is_in_profile(track)) else { continue };
        let place = match (last, found.last()) {
            (Some(last), Some((place, _))) => {
                let on = (number + n - last) % n;
                place + if on == 0 || on as f32 > 2.0 * WIDEST { APART } else { on as f32 }
            }
            _ => 0.0,
        };
        found.push((place, track.now.x));
        last = Some(number);
    }
    found
}

/// How many are before something, as `is_before` says; they are `near` about.
fn after(profile: &[(f32, f32)], near: usize, is_before: impl Fn(&(f32, f32)) -> bool) -> usize {
    let mut at = near.min(profile.len());
    while at > 0 && !is_before(&profile[at - 1]) {
        at -= 1;
    }
    while at < profile.len() && is_before(&profile[at]) {
        at += 1;
    }
    at
}

/// The boundaries of a profile that are left of `x`, which are `near` about.
pub(super) fn left_of(profile: &[(f32, f32)], near: usize, x: f32) -> usize {
    after(profile, near, |it| it.1 < x)
}

/// The column of a place between known boundaries, on the parabola through the three that are nearest; `None` beyond them [px].
fn column(profile: &[(f32, f32)], near: usize, place: f32) -> Option<f32> {
    let after = after(profile, near, |it| it.0 < place);
    let nearer_left = after > 0 && profile.get(after).is_none_or(|it| place - profile[after - 1].0 < it.0 - place);
    let middle = if nearer_left { after - 1 } else { after };
    let [a, b, c] = [*profile.get(middle.checked_sub(1)?)?, *profile.get(middle)?, *profile.get(middle + 1)?];
    let (left, right, at) = (b.0 - a.0, c.0 - b.0, place - b.0);
    if left > WIDEST || right > WIDEST || at < -left || at > right {
        return None;
    }
    let (slope_left, slope_right) = ((b.1 - a.1) / left, (c.1 - b.1) / right);
    if slope_left > STEEPER * slope_right || slope_right > STEEPER * slope_left {
        return None;
    }
    let bend = (slope_right - slope_left) / (left + right);
    Some(b.1 + at * (slope_left + bend * (at + left)))
}

/// The place of a column between known boundaries; `None` beyond them.
fn place(profile: &[(f32, f32)], near: usize, x: f32) -> Option<f32> {
    let after = after(profile, near, |it| it.1 < x).max(1);
    let (left, right) = (profile.get(after - 1)?, profile.get(after)?);
    let (wide, far) = (right.0 - left.0, right.1 - left.1);
    let part = (x - left.1) / far;
    (wide <= WIDEST && far > 0.0 && (0.0..=1.0).contains(&part)).then_some(left.0 + part * wide)
}

/// How wide stripes are in the known part of a row that is nearest to a column and no farther than a few stripes [px].
pub(super) fn wide_beside(profile: &[(f32, f32)], near: usize, x: f32) -> Option<f32> {
    let after = after(profile, near, |it| it.1 < x);
    let pair = |left: usize| {
        let (a, b) = (profile.get(left)?, profile.get(left + 1)?);
        let wide = (b.1 - a.1) / (b.0 - a.0);
        let away = (a.1 - x).max(x - b.1);
        (b.0 - a.0 <= WIDEST && away <= WIDEST * wide).then_some((away, wide))
    };
    let near = [after.checked_sub(2).and_then(pair), pair(after)];
    near.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0)).map(|it| it.1)
}

/// How far a boundary has gone, which is `near` in the profile of its row.
struct Gone<'a> {
    profile: &'a [(f32, f32)],
    near: usize,
    place: f32,
    /// Beyond the caller's prediction [px].
    by: f32,
}

impl Sliding {
    /// What tracks did from the picture before to this one says; nothing moves where they are too few. `last` is what they said before.
    pub fn of(rows: &[Vec<Track>], last: Sliding) -> Sliding {
        let every = rows.len().div_ceil(ROWS).max(1);
        let rows = rows.iter().step_by(every);
        let profiles: Vec<Profile> = rows.clone().map(|it| profile(it)).collect();
        let mut gone: Vec<Gone> = Vec::new();
        for (row, profile) in rows.zip(&profiles) {
            let mut near = 0;
            for track in row.iter().filter(|it| it.now.is_seen && it.is_proven()) {
                let Some(before) = track.before.filter(|it| it.is_seen) else { continue };
                near = left_of(profile, near, track.now.x);
                if let Some(place) = place(profile, near, track.now.x) {
                    gone.push(Gone { profile, near, place, by: track.now.x - before.x - track.now.shift });
                }
            }
        }
        if gone.len() < LEAST {
            return Sliding::default();
        }
        let every = gone.len().div_ceil(MOST);
        let gone: Vec<Gone> = gone.into_iter().step_by(every).collect();
        let mut off = Vec::with_capacity(gone.len());
        // Where a boundary was before, the surface now has its place `stripes` on.
        let mut judge = |stripes: f32| -> Option<(f32, f32)> {
            off.clear();
            off.extend(gone.iter().filter_map(|it| {
                let [here, on] = [it.place, it.place + stripes].map(|place| column(it.profile, it.near, place));
                Some(it.by - (here? - on?))
            }));
            if 2 * off.len() < gone.len() {
                return None;
            }
            let middle = off.len() / 2;
            let pixels = *off.select_nth_unstable_by(middle, f32::total_cmp).1;
            let cost: f32 = off.iter().map(|it| (it - pixels).abs().min(CUT)).sum();
            Some((cost / off.len() as f32, pixels))
        };
        let Some((at_rest, _)) = judge(0.0) else { return Sliding::default() };
        let mut best = (at_rest, Sliding::default());
        let mut centre = last.stripes;
        let mut reach = FARTHEST;
        for step in STEPS {
            let n = (reach / step).ceil() as i32;
            for at in -n..=n {
                let stripes = (centre + at as f32 * step).clamp(-FARTHEST, FARTHEST);
                if let Some((cost, pixels)) = judge(stripes).filter(|it| it.0 < best.0) {
                    best = (cost, Sliding { stripes, pixels });
                }
            }
            (centre, reach) = (best.1.stripes, step);
        }
        if at_rest > LEAST_OFF && best.0 < BETTER * at_rest { best.1 } else { Sliding::default() }
    }

    /// How much farther a boundary goes next than it has just gone [px a picture]; `None` where its neighbours do not say.
    pub fn faster(&self, profile: &[(f32, f32)], near: usize, x: f32) -> Option<f32> {
        let place = place(profile, near, x)?;
        let [ahead, behind] = [place - self.stripes, place + self.stripes].map(|it| column(profile, near, it));
        Some(ahead? - 2.0 * column(profile, near, place)? + behind?)
    }

    /// Where the boundary at a place of a profile is next, less the caller's prediction; `None` where its neighbours do not say [px].
    pub fn column(&self, profile: &[(f32, f32)], place: f32) -> Option<f32> {
        let at = place - self.stripes;
        let near = profile.partition_point(|it| it.0 < at);
        Some(column(profile, near, at)? + self.pixels)
    }

    /// How far a boundary goes next of which nothing is known but where it is [px a picture]; `None` where its neighbours do not say.
    pub fn velocity(&self, profile: &[(f32, f32)], near: usize, x: f32) -> Option<f32> {
        let next = place(profile, near, x)
            .and_then(|it| Some(column(profile, near, it - self.stripes)? - column(profile, near, it)?));
        Some(next.or_else(|| Some(-self.stripes * wide_beside(profile, near, x)?))? + self.pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::super::design::FRAMES;
    use super::super::detect::{DetectOptions, detect};
    use super::super::scene::Scene;
    use super::super::track::{TrackOptions, Tracker};
    use super::*;
    use crate::ImageView;

    /// Where boundaries of a rounded surface are that has gone through the light by `gone` stripes and `gone` · 8 px: X(ν − gone) + 8 gone.
    fn curved(gone: f32) -> Profile {
        (0..40).map(|it| it as f32).map(|it| (it, shape(it - gone) + 8.0 * gone)).collect()
    }

    fn shape(place: f32) -> f32 {
        8.0 * place + 0.06 * (place - 20.0).powi(2) * if place < 20.0 { -1.0 } else { 1.0 }
    }

    #[test]
    fn boundaries_go_on_as_the_surface_does() {
        for stripes in [0.13, -0.4, 0.9] {
            let sliding = Sliding { stripes, pixels: 8.0 * stripes };
            let [before, now, next] = [0.0, 1.0, 2.0].map(|it| curved(it * stripes));
            for at in 4..36 {
                let (next_gone, gone) = (next[at].1 - now[at].1, now[at].1 - before[at].1);
                let velocity = sliding.velocity(&now, at, now[at].1).unwrap();
                assert!((velocity - next_gone).abs() < 0.06, "{stripes}, {at}: {velocity} for {next_gone}");
                let foretold = sliding.column(&now, now[at].0).unwrap();
                assert!((foretold - next[at].1).abs() < 0.06, "{stripes}, {at}: {foretold} for {}", next[at].1);
                let faster = sliding.faster(&now, 0, now[at].1).unwrap();
                assert!(
                    (faster - (next_gone - gone)).abs() < 0.06,
                    "{stripes}, {at}: {faster} for {}",
                    next_gone - gone
                );
            }
        }
    }

    #[test]
    fn nothing_is_said_across_a_step_or_far_from_what_is_known() {
        let mut profile = curved(0.0);
        profile[20..].iter_mut().for_each(|it| it.1 += 30.0);
        assert_eq!(column(&profile, 0, 19.5), None);
        assert!(column(&profile, 40, 10.5).is_some() && column(&profile, 30, 30.5).is_some());
        assert_eq!(column(&profile, 7, -1.0), None);
        assert_eq!(column(&[], 3, 0.0), None);
        let sliding = Sliding { stripes: 0.5, pixels: 4.0 };
        assert_eq!(sliding.velocity(&profile, 9, profile[39].1 + 60.0), None);
        assert_eq!(sliding.faster(&profile, 9, profile[39].1 + 2.0), None);
    }

    #[test]
    fn a_surface_that_moves_is_told_from_one_that_rests() {
        for (speed, seed) in [(0.0, 1), (1.0, 2), (3.0, 3), (-3.0, 4)] {
            let scene = Scene::new(speed, 0.0, seed);
            let mut tracker = Tracker::new(scene.size[1], TrackOptions::default()).unwrap();
            for picture in 0..16 {
                let pixels = scene.picture(picture, picture % FRAMES);
                let view = ImageView::new(&pixels, scene.size[0], scene.size[1]).unwrap();
                tracker.predict(1, &|_, _| [0.0; 2]);
                tracker.update(&detect(&view, &DetectOptions::default()).unwrap(), picture % FRAMES);
            }
            tracker.predict(1, &|_, _| [0.0; 2]);
            // Half a projector pixel for each of the camera, four to a stripe.
            let (found, stripes) = (tracker.sliding(), speed as f32 * 0.5 / 4.0);
            assert!((found.stripes - stripes).abs() < 0.04, "{speed} px a picture: {found:?}");
            assert!((found.pixels - speed as f32).abs() < 0.3, "{speed} px a picture: {found:?}");
        }
    }
}
