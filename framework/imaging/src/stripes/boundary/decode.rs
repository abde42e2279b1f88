//! Boundaries that their neighbours confirm, and their places in the picture before the newest.
//!
//! The number of a boundary comes from its own track alone. Its neighbours confirm it: on the same surface the next boundary in the row has the next number, and the rows above and below have
//! the same boundary nearly at the same place. A boundary that too few neighbours confirm is left out.
//!
//! The end of the light, as at the border of a shadow, looks like a boundary, too, but on one side of it there is no light in any picture. A boundary that is the last one, and beyond which no light was seen in four pictures, may be that ([`Line::may_be_end`]).
//!
//! A ghost's place is between those of the pictures before and after, less the prediction: so it is one picture late, and so are all.

use super::design::BoundaryCode;
use super::track::{Track, Tracker};

/// A boundary in one row of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Number of the boundary in the code.
    pub number: u16,
    /// Column [px].
    pub x: f32,
    /// Standard deviation of the column [px].
    pub sigma: f32,
    /// Stripes for each pixel along the row, from the boundaries to the left and right; NaN without either [1/px].
    pub slope: f32,
    /// Part of its neighbours in this row and in those above and below that confirm it, 0 to 1 [–].
    pub confidence: f32,
    /// Whether the next boundary is not known on its left, and on its right: there the surface may end, or turn out of the light.
    pub is_last: [bool; 2],
    /// Whether light was seen on its left, and on its right, in the last four pictures: where there was none it may be the end of the light.
    pub is_lit: [bool; 2],
    /// Whether it did not show, and lies between its places in the pictures before and after.
    pub is_ghost: bool,
}

impl Line {
    /// Whether it may be the end of the light rather than a boundary: the last one in its row, beyond which no light was seen in four pictures, or one without a neighbour on either side to confirm it.
    pub fn may_be_end(&self) -> bool {
        let is_dark_beyond = self.is_last.iter().zip(self.is_lit).any(|(is_last, is_lit)| *is_last && !is_lit);
        is_dark_beyond || self.is_last == [true; 2]
    }
}

/// Rows above and below that are asked, each way, and that smooth a boundary.
const ROWS: usize = 2;
/// Neighbours that are asked: two in the row, [`ROWS`] each way.
const ASKED: f32 = 2.0 + 2.0 * ROWS as f32;
/// Pictures that must fit, one after the other: four say which boundary it is, one more that this was no accident.
const LEAST_RUN: u32 = 5;
/// Neighbours that must confirm a boundary.
const LEAST: usize = 3;
/// The same of the last one of a row, more than contradict it, where the surface goes through the stripes fast: there it was mostly given its number by those beside it a picture or two ago, and another surface may begin there.
/// Of the simulated bust at 20 cm/s nine in ten wrong points lie on such boundaries.
const LEAST_LAST: usize = 4;
/// The next boundary is no farther away than this, and no nearer, in stripes.
const NEXT: std::ops::RangeInclusive<f32> = 0.25..=4.0;
/// The same boundary is no farther off in the next row than this, in stripes.
const BESIDE: f32 = 0.35;
/// What a ghost's place may be off because its motion is not even, for each pixel by which that has changed [–].
const UNEVEN: f32 = 0.25;

/// What rows that are smoothed have in common and does not average out, standard deviation: what the pixels' grid and shades do to an edge [px].
const SHARED_SIGMA: f32 = 0.05;
/// The same as a part of what one row's edge is off: edges are found in several rows at once, and light falls off alike in all [–].
const SHARED_PART: f32 = 0.7;

/// From so many stripes on that face the camera the last one on a surface is that where it turns out of the light …
const WIDE: f32 = 1.5;
/// … and the boundary that seems to be its end is known no better than by this part of it: of the simulated bust (seeds 301 and 302, 5 cm/s) such boundaries are off by 0.08 of a stripe in the middle, in single pictures by 0.2 [–].
const FADING: f32 = 0.1;

/// The boundaries of the picture before the newest, by row, ascending by column.
pub fn lines(tracker: &Tracker) -> Vec<Vec<Line>> {
    let (pitch, down) = (tracker.options().pitch, tracker.down());
    let mut found: Vec<Vec<Line>> =
        tracker.rows().iter().map(|tracks| tracks.iter().filter_map(line).collect()).collect();
    found.iter_mut().for_each(|it| it.sort_by(|a, b| a.x.total_cmp(&b.x)));
    let height = found.len() as i32;
    // Rows have moved with their tracks.
    let mut found: Vec<Vec<Line>> =
        (0..height).map(|y| found.get_mut((y + down) as usize).map(std::mem::take).unwrap_or_default()).collect();
    let judged: Vec<Vec<Line>> = (0..found.len()).map(|y| judge_row(&found, y, pitch, tracker.is_fast())).collect();
    for (row, judged) in found.iter_mut().zip(judged) {
        *row = judged;
    }
    found
}

/// Boundaries of the picture before the newest that their own tracks know, before they are compared with their neighbours.
pub(super) fn known(tracker: &Tracker) -> usize {
    tracker.rows().iter().flatten().filter(|it| line(it).is_some()).count()
}

/// Where a track was in the picture before the newest, if it is known, and more pictures have borne it out.
fn line(track: &Track) -> Option<Line> {
    let number = track.number().filter(|_| track.run() >= LEAST_RUN && track.fits_all())? as u16;
    let before = track.before?;
    let known = |x: f32, sigma: f32, is_ghost: bool| Line {
        number,
        x,
        sigma,
        slope: f32::NAN,
        confidence: 0.0,
        is_last: [true; 2],
        is_lit: track.is_lit(),
        is_ghost,
    };
    if before.is_seen {
        return Some(known(before.x, before.sigma, false));
    }
    let (earlier, now) = (track.earlier?, track.now);
    if !earlier.is_seen || !now.is_seen {
        return None;
    }
    let (ahead, behind) = (earlier.x + before.shift, now.x - now.shift);
    let uneven = UNEVEN * (before.x - 0.5 * (ahead + behind)).abs();
    Some(known(0.5 * (ahead + behind), (0.5 * earlier.sigma.hypot(now.sigma)).hypot(uneven), true))
}

/// The boundaries of a row that neighbours confirm, smoothed along the boundary; `fast` says that the surface goes through the stripes fast.
fn judge_row(rows: &[Vec<Line>], y: usize, pitch: f32, fast: bool) -> Vec<Line> {
    let n = BoundaryCode::get().len() as u16;
    let row = &rows[y];
    let beside: Vec<(f32, &[Line])> = (y.saturating_sub(ROWS)..(y + ROWS + 1).min(rows.len()))
        .filter(|it| *it != y)
        .map(|it| (it as f32 - y as f32, rows[it].as_slice()))
        .collect();
    let mut judged = Vec::with_capacity(row.len());
    for (at, one) in row.iter().enumerate() {
        let (mut confirmed, mut contradicted) = (0, 0);
        let mut next = [None; 2];
        let neighbours = [at.checked_sub(1).map(|it| &row[it]), row.get(at + 1)];
        for (side, other) in neighbours.into_iter().enumerate() {
            let Some(other) = other else { continue };
            let away = (other.x - one.x).abs() / pitch;
            let expected = if side == 0 { (one.number + n - 1) % n } else { (one.number + 1) % n };
            if other.number == expected && NEXT.contains(&away) {
                confirmed += 1;
                next[side] = Some(1.0 / (other.x - one.x).abs());
            } else if away < 0.7 {
                contradicted += 1;
            }
        }
        // x = x0 + slant · dy, weighted, through this row and those beside.
        let weight = 1.0 / (one.sigma * one.sigma);
        let (mut s, mut sx, mut sy, mut sxy, mut syy) = (weight, 0.0, 0.0, 0.0, 0.0);
        let mut beside_xs = [(0.0_f32, 0.0_f32); 2 * ROWS];
        let mut n_beside = 0;
        for (dy, other) in &beside {
            let reach = BESIDE * pitch * dy.abs();
            let first = other.partition_point(|it| it.x < one.x - reach);
            for it in other[first..].iter().take_while(|it| it.x <= one.x + reach) {
                if it.number == one.number {
                    confirmed += 1;
                    let (weight, dx) = (1.0 / (it.sigma * it.sigma), it.x - one.x);
                    s += weight;
                    sx += weight * dx;
                    sy += weight * dy;
                    sxy += weight * dx * dy;
                    syy += weight * dy * dy;
                    beside_xs[n_beside.min(2 * ROWS - 1)] = (*dy, dx);
                    n_beside += 1;
                } else if (it.x - one.x).abs() < 0.2 * pitch {
                    contradicted += 1;
                }
            }
        }
        let (in_order, out_of_order) = order(row, at, pitch);
        if confirmed < LEAST || 2 * contradicted > confirmed || in_order == 0 || out_of_order > in_order {
            continue;
        }
        let is_last = next.map(|it| it.is_none());
        if fast && is_last.contains(&true) && confirmed < LEAST_LAST + contradicted {
            continue;
        }
        let mut line = *one;
        line.confidence = ((confirmed as f32 - contradicted as f32) / ASKED).clamp(0.0, 1.0);
        line.slope = match next {
            [Some(a), Some(b)] => 0.5 * (a + b),
            [a, b] => a.or(b).unwrap_or(f32::NAN),
        };
        line.is_last = is_last;
        let determinant = s * syy - sy * sy;
        if n_beside >= 2 && determinant > 1e-3 * s * syy {
            let off = (syy * sx - sy * sxy) / determinant;
            let slant = (s * sxy - sy * sx) / determinant;
            let square: f32 =
                beside_xs[..n_beside.min(2 * ROWS)].iter().map(|(dy, dx)| (dx - off - slant * dy).powi(2)).sum();
            let spread = ((square + off * off) / n_beside as f32).sqrt();
            line.x += off;
            // As far off as the others are from their line, less what averages out; never better than what does not.
            let alike = (syy / determinant).sqrt().max(spread * (syy * s / determinant / (n_beside + 1) as f32).sqrt());
            line.sigma = alike.hypot(SHARED_SIGMA.max(SHARED_PART * one.sigma));
        }
        // Where light fades out, its end is as likely to be taken for the last boundary as that itself.
        let wide = line.slope.recip();
        if line.is_last.contains(&true) && wide > WIDE * pitch {
            line.sigma = line.sigma.hypot(FADING * wide);
        }
        judged.push(line);
    }
    judged
}

/// How many of the two nearest boundaries on each side have a number that fits their distance, and how many have not.
fn order(row: &[Line], at: usize, pitch: f32) -> (usize, usize) {
    let n = BoundaryCode::get().len() as i32;
    let one = &row[at];
    let near = (at.saturating_sub(2)..(at + 3).min(row.len())).filter(|it| *it != at);
    let fits = |it: usize| {
        let (other, side) = (&row[it], if it > at { 1 } else { -1 });
        let steps = (side * (i32::from(other.number) - i32::from(one.number))).rem_euclid(n);
        steps > 0 && NEXT.contains(&((other.x - one.x).abs() / (pitch * steps as f32)))
    };
    let (good, bad): (Vec<usize>, Vec<usize>) = near.partition(|it| fits(*it));
    (good.len(), bad.len())
}

#[cfg(test)]
mod tests {
    use super::super::agreement::Shows;
    use super::super::design::FRAMES;
    use super::super::detect::{DetectOptions, detect};
    use super::super::scene::{STRIPE, Scene};
    use super::super::track::TrackOptions;
    use super::*;
    use crate::ImageView;

    /// Columns of the projector for each pixel on what faces the camera.
    const FACING: f64 = 0.5;

    /// What came of all pictures but the first few.
    #[derive(Debug, Default)]
    struct Judged {
        found: usize,
        /// Boundaries on surfaces that lit pixels see.
        there: usize,
        ghosts: usize,
        wrong: usize,
        squares: f64,
        normalised: f64,
        worst_share: f64,
    }

    impl Judged {
        fn rms(&self) -> f64 {
            (self.squares / (self.found - self.wrong) as f64).sqrt()
        }
        fn share(&self) -> f64 {
            (self.found - self.wrong) as f64 / self.there as f64
        }
    }

    /// `shows` says what the projector shows in picture `k`; `camera` whether the camera has it.
    fn run(scene: &Scene, n: usize, shows: impl Fn(usize) -> usize, has: impl Fn(usize) -> bool) -> (Judged, usize) {
        run_foretold(scene, n, shows, has, |_| 0.0)
    }

    /// `foretold` is the error of the prediction of picture `k` [px].
    fn run_foretold(
        scene: &Scene,
        n: usize,
        shows: impl Fn(usize) -> usize,
        has: impl Fn(usize) -> bool,
        foretold: impl Fn(usize) -> f32,
    ) -> (Judged, usize) {
        let [width, height] = scene.size;
        let options = TrackOptions { threads: 2, ..TrackOptions::default() };
        let mut tracker = Tracker::new(height, options).unwrap();
        let mut judged = Judged { worst_share: 1.0, ..Judged::default() };
        let (mut last, mut n_instead) = (None, 0);
        for picture in 0..n {
            if !has(picture) {
                continue;
            }
            let told = picture % FRAMES;
            let pixels = scene.picture(picture, shows(picture));
            let edges = detect(&ImageView::new(&pixels, width, height).unwrap(), &DetectOptions::default()).unwrap();
            let passed = last.map_or(1, |last| picture - last) as u32;
            let off = foretold(picture);
            tracker.predict(passed, &|_, _| [off, 0.0]);
            tracker.align(&edges, told);
            let shows = tracker.agreement(&edges).shows(told);
            n_instead += usize::from(matches!(shows, Shows::Instead(_)));
            let Some(shown) = shows.picture(told) else {
                tracker.reset();
                last = None;
                continue;
            };
            tracker.update(&edges, shown);
            let lines = lines(&tracker);
            if picture > 8 && last == Some(picture - 1) {
                let before = judged.found - judged.wrong;
                let there = judged.there;
                judge(scene, picture as f64 - 1.0, &lines, &mut judged);
                let share = (judged.found - judged.wrong - before) as f64 / (judged.there - there) as f64;
                judged.worst_share = judged.worst_share.min(share);
            }
            last = Some(picture);
        }
        (judged, n_instead)
    }

    fn judge(scene: &Scene, picture: f64, lines: &[Vec<Line>], judged: &mut Judged) {
        let period = STRIPE * BoundaryCode::get().len() as f64;
        for (y, row) in lines.iter().enumerate() {
            let of = |x: f64| scene.column(x, y as f64, picture);
            let stripes = |x: usize| ((of(x as f64) + 0.5) / STRIPE).floor();
            let is_lit = |x: &usize| (0..2).all(|it| !scene.is_dark((x + it) as f64, y as f64, picture));
            let is_there = |x: &usize| (stripes(x + 1) - stripes(*x)).abs() == 1.0 && is_lit(x);
            judged.there += (0..scene.size[0] - 1).filter(is_there).count();
            for line in row {
                let x = f64::from(line.x);
                let column = f64::from(line.number) * STRIPE - 0.5;
                let off = (of(x) - column + period / 2.0).rem_euclid(period) - period / 2.0;
                let slope = of(x + 0.5) - of(x - 0.5);
                judged.found += 1;
                judged.ghosts += usize::from(line.is_ghost);
                if off.abs() > 1.0 {
                    judged.wrong += 1;
                } else {
                    // Half a column of the projector is a pixel of what faces the camera; where stripes are wider it is as far in space all the same.
                    judged.squares += (off / slope.max(FACING)).powi(2);
                    judged.normalised += (off / slope / f64::from(line.sigma)).powi(2);
                }
            }
        }
    }

    #[track_caller]
    fn check(make: impl Fn(u64) -> Scene, share: f64, rms_px: f64, wrong_per_1000: usize) {
        for seed in 1..=3 {
            let (judged, _) = run(&make(seed), 20, |it| it % FRAMES, |_| true);
            assert!(judged.share() >= share, "seed {seed}: {} {judged:?}", judged.share());
            assert!(judged.rms() <= rms_px, "seed {seed}: {} px {judged:?}", judged.rms());
            assert!(judged.wrong * 1000 <= wrong_per_1000 * judged.found, "seed {seed}: {judged:?}");
        }
    }

    /// A boundary of rows in which they are eight pixels apart, before it is judged.
    fn known(number: u16) -> Line {
        Line {
            number,
            x: 8.0 * f32::from(number),
            sigma: 0.1,
            slope: f32::NAN,
            confidence: 0.0,
            is_last: [true; 2],
            is_lit: [true; 2],
            is_ghost: false,
        }
    }

    /// Numbers of boundaries in the middle of five rows that may be the end of the light; `is_lit` says where there is light beside the last of them.
    fn ends(numbers: std::ops::RangeInclusive<u16>, is_lit: [bool; 2]) -> Vec<u16> {
        let last = *numbers.end();
        let of = |number: u16| Line { is_lit: if number == last { is_lit } else { [true; 2] }, ..known(number) };
        let rows = vec![numbers.map(of).collect::<Vec<Line>>(); 5];
        let judged = judge_row(&rows, 2, 8.0, false);
        judged.iter().filter(|it| it.may_be_end()).map(|it| it.number).collect()
    }

    #[test]
    fn the_last_boundary_needs_a_neighbour_more_where_the_surface_is_fast() {
        // Boundary 14 is known in so many of the rows above and below.
        for (n_beside, kept_by_pace) in [(1, [false, false]), (2, [true, false]), (3, [true, true])] {
            let row = |y: usize| (10..=14).filter(move |it| *it < 14 || y >= 4 - n_beside).map(known).collect();
            let mut rows: Vec<Vec<Line>> = (0..4).map(row).collect();
            rows.insert(2, (10..=14).map(known).collect());
            for (fast, kept) in [false, true].into_iter().zip(kept_by_pace) {
                let numbers: Vec<u16> = judge_row(&rows, 2, 8.0, fast).iter().map(|it| it.number).collect();
                let expected: Vec<u16> = (10..=if kept { 14 } else { 13 }).collect();
                assert_eq!(numbers, expected, "{n_beside} rows beside, fast {fast}");
            }
        }
    }

    #[test]
    fn a_last_boundary_beyond_which_there_is_never_light_may_be_the_end_of_the_light() {
        assert_eq!(ends(10..=14, [true, false]), [14]);
        assert_eq!(ends(10..=14, [false, true]), [], "its neighbour is known where it was not lit");
        assert_eq!(ends(10..=14, [true, true]), []);
    }

    #[test]
    fn boundaries_at_rest_are_found_with_their_ghosts() {
        check(|seed| Scene::new(0.0, 0.0, seed), 0.85, 0.15, 6);
        let faint = |seed| Scene { light: 70.0, ..Scene::new(0.0, 0.0, seed) };
        check(faint, 0.8, 0.15, 6);
    }

    #[test]
    fn boundaries_on_what_moves_are_where_they_are() {
        check(|seed| Scene::new(3.0, 0.0, seed), 0.75, 0.17, 7);
        check(|seed| Scene::new(-6.0, 0.0, seed), 0.65, 0.15, 12);
        check(|seed| Scene::new(2.0, 0.6, seed), 0.65, 0.18, 12);
    }

    #[test]
    fn edges_of_the_surface_s_own_colour_are_no_boundaries() {
        let patched = |seed| Scene { patch: 0.3, ..Scene::new(1.0, 0.0, seed) };
        check(patched, 0.8, 0.18, 8);
    }

    #[test]
    fn a_picture_that_the_projector_dropped_is_told_and_one_that_the_camera_lost_costs_little() {
        let scene = Scene::new(1.0, 0.0, 4);
        let (judged, n_instead) = run(&scene, 24, |it| if it == 14 { 1 } else { it % FRAMES }, |_| true);
        assert!(n_instead == 1 && judged.wrong * 100 <= judged.found, "{n_instead} {judged:?}");
        let (judged, n_instead) = run(&scene, 24, |it| it % FRAMES, |it| it != 14);
        assert!(n_instead == 0 && judged.wrong * 100 <= judged.found && judged.share() > 0.6, "{n_instead} {judged:?}");
    }

    #[test]
    fn what_a_head_s_pose_is_off_costs_little() {
        for seed in 1..=3 {
            let scene = Scene::new(0.0, 0.0, seed);
            // To and fro by up to a stripe, once tracks are known.
            let off = |it: usize| if it < 10 { 0.0 } else { [7.0, -3.0, 5.0, -8.0, 2.0][it % 5] };
            let (judged, n_instead) = run_foretold(&scene, 24, |it| it % FRAMES, |_| true, off);
            assert!(judged.share() > 0.8 && n_instead == 0, "seed {seed}: {} {judged:?}", judged.share());
            assert!(judged.wrong * 1000 <= 6 * judged.found, "seed {seed}: {judged:?}");
        }
    }

    #[test]
    fn a_picture_that_went_to_the_neighbours_before_tracks_were_known_makes_no_numbers() {
        // To the neighbours and back.
        for (seed, first) in [(1, 1), (2, 2), (3, 3)] {
            let off = |it: usize| {
                if it == first {
                    5.0
                } else if it == first + 1 {
                    -5.0
                } else {
                    0.0
                }
            };
            let (judged, _) = run_foretold(&Scene::new(0.0, 0.0, seed), 24, |it| it % FRAMES, |_| true, off);
            assert!(judged.share() > 0.5, "seed {seed}: {} {judged:?}", judged.share());
            assert!(judged.wrong * 50 <= judged.found, "seed {seed}: {judged:?}");
        }
    }

    #[test]
    fn a_light_that_stays_is_no_boundary() {
        for frame in 0..FRAMES {
            let (judged, _) = run(&Scene::new(0.5, 0.0, 5), 20, |_| frame, |_| true);
            assert!(judged.found * 200 < judged.there, "{judged:?}");
        }
    }
}
