//! Advice about missing coverage, the most important first.

use std::fmt;

use nalgebra::{Point2, Point3};

use super::Coverage;
use super::camera::CameraCoverage;

/// Partners of a camera that are asked whether the path is flat: those that saw most together with it.
const PARTNERS: usize = 3;
/// A camera that saw no light for this long tells nothing about where it is now [s].
const RECENT_S: f64 = 2.0;
/// Part of the last pictures in which the light stands that is too much.
const MOSTLY: f64 = 0.6;

/// Whether coverage suffices for a calibration, and what would improve it.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    /// Whether nothing that is needed is missing.
    pub enough: bool,
    /// What is needed, then what would help; the most important first.
    pub missing: Vec<Advice>,
}

/// One gap in coverage; its `Display` is a sentence for the person with the light.
#[derive(Debug, Clone, PartialEq)]
pub enum Advice {
    /// There is one camera, or none.
    TooFewCameras {
        /// Number that was found.
        found: usize,
    },
    /// No camera saw the light.
    NothingSeen,
    /// It does not move.
    LightStill,
    /// Cameras that saw too little.
    TooFewFrames {
        /// Their names, and in how many frames each saw it; the worst first.
        cameras: Vec<(String, u32)>,
        /// Number that is needed.
        needed: u32,
    },
    /// Cameras that are linked with each other, but not with the larger group.
    Apart {
        /// Their names.
        cameras: Vec<String>,
        /// The pair across the gap that saw most together, one of them first.
        between: [String; 2],
        /// Frames that this pair saw together.
        common: u32,
        /// Number that is needed.
        needed: u32,
    },
    /// What cameras saw with their best partners lies in a plane.
    Flat {
        /// Their names.
        cameras: Vec<String>,
    },
    /// A camera saw the light in too little of its image.
    Narrow {
        /// Name of the camera.
        camera: String,
        /// Part of the cells that are full.
        share: f64,
        /// Where it saw least.
        emptiest: Region,
    },
    /// A camera saw the light on a line only.
    OnLine {
        /// Name of the camera.
        camera: String,
    },
    /// More moving lights than expected.
    SeveralLights {
        /// The camera that sees them.
        camera: String,
        /// In this part of its last pictures.
        share: f64,
        /// How many there should be.
        expected: usize,
    },
    /// A lamp, a window, a reflection. Not needed: stationary lights are ignored.
    StandingLight {
        /// The camera that sees it.
        camera: String,
        /// Its place in the picture [px].
        pixel: Point2<f64>,
    },
    /// Cameras that one other camera alone links to the rest. Not needed.
    LinkedByOne {
        /// Their names.
        cameras: Vec<String>,
        /// The one that links them.
        by: String,
        /// Two that would link them without it, and nearly do; `None` where no two ever saw the light together.
        between: Option<[String; 2]>,
    },
    /// A part of an image in which the light never was. Not needed.
    RegionEmpty {
        /// The camera.
        camera: String,
        /// The empty part of the image.
        region: Region,
    },
    /// A part of the working volume in which the light never was. Not needed.
    VolumeEmpty {
        /// Part of the volume that two cameras see in which it was.
        share: f64,
        /// The place that is farthest from where it was [m].
        place: Point3<f64>,
    },
}

/// A ninth of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// 0: left, 1: middle, 2: right.
    pub column: usize,
    /// 0: top, 1: middle, 2: bottom.
    pub row: usize,
}

impl Advice {
    /// Whether it must be followed before coverage suffices.
    pub fn needed(&self) -> bool {
        use Advice::{LinkedByOne, RegionEmpty, StandingLight, VolumeEmpty};
        !matches!(self, StandingLight { .. } | LinkedByOne { .. } | RegionEmpty { .. } | VolumeEmpty { .. })
    }
}

impl fmt::Display for Region {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(match (self.row, self.column) {
            (0, 0) => "upper left",
            (0, 1) => "upper middle",
            (0, _) => "upper right",
            (1, 0) => "middle left",
            (1, 1) => "middle",
            (1, _) => "middle right",
            (_, 0) => "lower left",
            (_, 1) => "lower middle",
            _ => "lower right",
        })
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Advice::TooFewCameras { found } => {
                write!(to, "{found} cameras cannot be calibrated, at least 2 are needed")
            }
            Advice::NothingSeen => write!(to, "no camera has seen the light: switch it on, and darken the room"),
            Advice::LightStill => write!(to, "the light does not move: walk with it"),
            Advice::TooFewFrames { cameras, needed } => match cameras.as_slice() {
                [(name, 0)] => write!(to, "camera {name} has not seen the light: wave in front of it"),
                [(name, frames)] => {
                    write!(to, "camera {name} has seen the light in {frames} of {needed} frames: wave in front of it")
                }
                _ => {
                    let counts: Vec<String> =
                        cameras.iter().map(|(name, frames)| format!("{name} ({frames})")).collect();
                    write!(to, "cameras {} have seen the light in fewer than {needed} frames", listed(&counts, 4))
                }
            },
            Advice::Apart { cameras, between: [own, other], common, needed } => write!(
                to,
                "{} {} not linked to the others: {own} and {other} have seen the light together in {common} of {needed} frames: \
                 wave where both see",
                listed(cameras, 4),
                is(cameras),
            ),
            Advice::Flat { cameras } => {
                write!(to, "what {} saw lies in a plane: wave nearer and farther, higher and lower", listed(cameras, 4),)
            }
            Advice::Narrow { camera, share, emptiest } => write!(
                to,
                "camera {camera} has seen the light in {:.0} % of its image: wave in its {emptiest}",
                100.0 * share
            ),
            Advice::OnLine { camera } => {
                write!(to, "camera {camera} has seen the light on a line only: wave across it")
            }
            Advice::SeveralLights { camera, share, expected } => write!(
                to,
                "more than {expected} moving at once in camera {camera}, in {:.0} % of its last frames: cover other lights and reflections",
                100.0 * share
            ),
            Advice::StandingLight { camera, pixel } => write!(
                to,
                "camera {camera} sees a second light that does not move: cover it (at {:.0}, {:.0} px)",
                pixel.x, pixel.y
            ),
            Advice::LinkedByOne { cameras, by, between } => {
                write!(to, "{} {} linked to the others only through {by}", listed(cameras, 4), is(cameras))?;
                match between {
                    Some([own, other]) => write!(to, ": wave where {own} and {other} both see"),
                    None => Ok(()),
                }
            }
            Advice::RegionEmpty { camera, region } => write!(to, "{region} of camera {camera} is empty"),
            Advice::VolumeEmpty { share, place } => write!(
                to,
                "the light has been in {:.0} % of the volume: not near ({:.1}, {:.1}, {:.1}) m",
                100.0 * share,
                place.x,
                place.y,
                place.z
            ),
        }
    }
}

fn is(names: &[String]) -> &'static str {
    if names.len() == 1 { "is" } else { "are" }
}

/// `a, b and c`; beyond `most` names, `a, b and 7 others`.
fn listed(names: &[String], most: usize) -> String {
    let shown = if names.len() > most { most - 1 } else { names.len().saturating_sub(1) };
    let last = match &names[shown..] {
        [] => String::new(),
        [one] => one.clone(),
        rest => format!("{} others", rest.len()),
    };
    if shown == 0 { last } else { format!("{} and {last}", names[..shown].join(", ")) }
}

pub(super) fn guidance(coverage: &Coverage) -> Guidance {
    let mut missing = needed(coverage);
    missing.extend(helpful(coverage));
    Guidance { enough: !missing.iter().any(Advice::needed), missing }
}

fn needed(coverage: &Coverage) -> Vec<Advice> {
    let Coverage { options, cameras, links, .. } = coverage;
    let n = cameras.len();
    if n < 2 {
        return vec![Advice::TooFewCameras { found: n }];
    }
    let mut missing = Vec::new();
    let still = light_still(coverage);
    if still {
        missing.push(Advice::LightStill);
        // Frames count where the light moved: what else is missing follows from that.
        if cameras.iter().all(|it| it.frames < options.min_frames) {
            return missing;
        }
    } else if cameras.iter().all(|it| it.frames == 0) {
        return vec![Advice::NothingSeen];
    }
    let mut few: Vec<(String, u32)> =
        cameras.iter().filter(|it| it.frames < options.min_frames).map(|it| (it.name.clone(), it.frames)).collect();
    if !few.is_empty() {
        few.sort_by_key(|it| it.1);
        missing.push(Advice::TooFewFrames { cameras: few, needed: options.min_frames });
    }
    let name = |it: usize| cameras[it].name.clone();
    let groups = groups(n, |a, b| links.common(a, b) >= options.min_common, None);
    if let Some((largest, others)) = groups.split_first() {
        for group in others {
            let rest: Vec<usize> = (0..n).filter(|it| !group.contains(it)).collect();
            let across = group.iter().flat_map(|own| rest.iter().map(move |other| (*own, *other)));
            // The first of the pairs that saw most: the same names from one moment to the next.
            let best = across.first_largest(|&(own, other)| links.common(own, other));
            let (own, other) = best.unwrap_or((group[0], largest[0]));
            missing.push(Advice::Apart {
                cameras: group.iter().map(|it| name(*it)).collect(),
                between: [name(own), name(other)],
                common: links.common(own, other),
                needed: options.min_common,
            });
        }
    }
    let flat: Vec<String> = (0..n).filter(|it| flat(coverage, *it)).map(name).collect();
    if !flat.is_empty() {
        missing.push(Advice::Flat { cameras: flat });
    }
    for camera in cameras.iter().filter(|it| it.frames > 0) {
        let share = camera.share(options);
        let saturated = share >= options.least_cells && camera.since_full >= options.saturated_frames;
        if share < options.min_cells && !saturated {
            let emptiest = emptiest(camera, options.grid);
            missing.push(Advice::Narrow { camera: camera.name.clone(), share, emptiest });
        } else if camera.spread() < options.min_spread {
            missing.push(Advice::OnLine { camera: camera.name.clone() });
        }
    }
    for camera in cameras.iter().filter(|it| it.several > options.max_several) {
        let (camera, share) = (camera.name.clone(), camera.several);
        missing.push(Advice::SeveralLights { camera, share, expected: options.lights });
    }
    missing
}

fn helpful(coverage: &Coverage) -> Vec<Advice> {
    let Coverage { options, cameras, links, volume, .. } = coverage;
    let mut missing = Vec::new();
    if !light_still(coverage) {
        for camera in cameras {
            let standing = camera.standing(options);
            missing.extend(standing.map(|pixel| Advice::StandingLight { camera: camera.name.clone(), pixel }));
        }
    }
    let n = cameras.len();
    let name = |it: usize| cameras[it].name.clone();
    let partners = |a, b| links.common(a, b) >= options.min_common;
    if n > 2 && groups(n, partners, None).len() == 1 {
        for by in 0..n {
            for group in groups(n, partners, Some(by)).iter().skip(1) {
                let rest = |it: &usize| *it != by && !group.contains(it);
                let across = group.iter().flat_map(|own| (0..n).filter(rest).map(move |other| (*own, other)));
                let best = across.first_largest(|&(own, other)| links.common(own, other));
                let between = best.filter(|&(own, other)| links.common(own, other) > 0);
                missing.push(Advice::LinkedByOne {
                    cameras: group.iter().map(|it| name(*it)).collect(),
                    by: name(by),
                    between: between.map(|(own, other)| [name(own), name(other)]),
                });
            }
        }
    }
    if let Some((share, place)) = volume.as_ref().and_then(|it| it.share().zip(it.emptiest())) {
        missing.push(Advice::VolumeEmpty { share, place });
    }
    for camera in cameras.iter().filter(|it| it.frames >= options.min_frames) {
        let empty = regions(&camera.cells, options.grid).filter(|it| it.1 == 0);
        missing.extend(empty.map(|(region, _)| Advice::RegionEmpty { camera: camera.name.clone(), region }));
    }
    missing
}

/// Whether the light that is seen now stands, by the cameras that see any.
fn light_still(coverage: &Coverage) -> bool {
    let recent = |lit_s: f64| coverage.newest_s - lit_s <= RECENT_S;
    let (sum, n) =
        coverage.cameras.iter().filter(|it| recent(it.lit_s)).fold((0.0, 0), |(sum, n), it| (sum + it.still, n + 1));
    n > 0 && sum / f64::from(n) > MOSTLY
}

/// Whether the camera has partners, and what it saw with the best of them lies in a plane.
fn flat(coverage: &Coverage, camera: usize) -> bool {
    let Coverage { options, cameras, links, .. } = coverage;
    let others = (0..cameras.len()).filter(|it| *it != camera);
    let mut partners: Vec<usize> = others.filter(|it| links.common(camera, *it) >= options.min_common).collect();
    partners.sort_by_key(|it| std::cmp::Reverse(links.common(camera, *it)));
    partners.truncate(PARTNERS);
    let planar = |other: &usize| links.planar_share(camera, *other, options.flat_px) > options.flat_share;
    !partners.is_empty() && partners.iter().all(planar)
}

/// Connected parts of the view graph, without the camera `without`; the largest first, then by their first camera.
pub(super) fn groups(n: usize, linked: impl Fn(usize, usize) -> bool, without: Option<usize>) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut open: Vec<usize> = (0..n).filter(|it| Some(*it) != without).collect();
    while !open.is_empty() {
        let mut group = vec![open.remove(0)];
        let mut next = 0;
        while next < group.len() {
            let here = group[next];
            next += 1;
            open.retain(|it| {
                let joins = linked(here, *it);
                if joins {
                    group.push(*it);
                }
                !joins
            });
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups.sort_by_key(|it| std::cmp::Reverse(it.len()));
    groups
}

/// The ninth with the fewest frames; of several the one nearest to where the light was, which is most easily reached.
fn emptiest(camera: &CameraCoverage, grid: [usize; 2]) -> Region {
    let [x, y] = camera.middle();
    let away = |it: &Region| (it.column as f64 - 3.0 * x + 0.5).hypot(it.row as f64 - 3.0 * y + 0.5);
    let order = |a: &(Region, u32), b: &(Region, u32)| a.1.cmp(&b.1).then(away(&a.0).total_cmp(&away(&b.0)));
    regions(&camera.cells, grid).min_by(order).map_or(Region { column: 1, row: 1 }, |it| it.0)
}

/// The ninths of an image that have cells, with the frames in each.
fn regions(cells: &[u16], grid: [usize; 2]) -> impl Iterator<Item = (Region, u32)> {
    let [columns, rows] = grid;
    let of = move |region: Region| {
        let within = |it: &usize| it % columns * 3 / columns == region.column && it / columns * 3 / rows == region.row;
        let inside: Vec<u32> = (0..cells.len()).filter(within).map(|it| u32::from(cells[it])).collect();
        (!inside.is_empty()).then(|| (region, inside.iter().sum()))
    };
    (0..9).filter_map(move |it| of(Region { column: it % 3, row: it / 3 }))
}

/// The first of the largest, where `max_by_key` gives the last.
trait FirstLargest: Iterator + Sized {
    fn first_largest(self, key: impl Fn(&Self::Item) -> u32) -> Option<Self::Item> {
        let mut best: Option<(u32, Self::Item)> = None;
        for item in self {
            let found = key(&item);
            if best.as_ref().is_none_or(|it| found > it.0) {
                best = Some((found, item));
            }
        }
        best.map(|it| it.1)
    }
}

impl<I: Iterator> FirstLargest for I {}
