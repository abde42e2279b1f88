//! Carving against its definition, voxel by voxel, and against bodies of known volume.

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::{Camera, Distortion};

/// Where pixels of a view are body, by their rays: those that come closer than `radius` to the segment `axis`.
fn silhouette(camera: &Camera, [width, height]: [u32; 2], axis: [Point3<f64>; 2], radius: f64) -> Vec<u8> {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| Point2::new(f64::from(x), f64::from(y))));
    let is_body = |pixel: Point2<f64>| {
        let ray = camera.ray(&pixel)?;
        let along = axis[1] - axis[0];
        let nearest = (0..=40).map(|it| axis[0] + along * (f64::from(it) / 40.0)).map(|it| ray.distance_to(&it));
        (nearest.fold(f64::INFINITY, f64::min) < radius).then_some(255)
    };
    pixels.map(|it| is_body(it).unwrap_or(0)).collect()
}

fn ring(n: usize, size: [u32; 2], focal: f64, distortion: Distortion) -> Vec<Camera> {
    let camera = |at: usize| {
        let angle = (at as f64 + 0.13) * std::f64::consts::TAU / n as f64;
        let height = if at.is_multiple_of(2) { 1.4 } else { 0.4 };
        let eye = Point3::new(2.5 * angle.cos(), 2.5 * angle.sin(), height);
        Camera { distortion, ..Camera::look_at(eye, Point3::new(0.0, 0.0, 0.5), size, focal) }
    };
    (0..n).map(camera).collect()
}

fn view<'a>(camera: &'a Camera, confidence: &'a [u8]) -> SilhouetteView<'a> {
    let [width, height] = camera.image_size;
    SilhouetteView { camera, left: 0, top: 0, shrink: 1, width, height, confidence }
}

/// How close a voxel's centre comes to the border of a pixel in any view [px].
fn to_border(centre: &Point3<f64>, views: &[SilhouetteView]) -> f64 {
    let gap = |at: f64, start: u32, shrink: u32| {
        let at = (at + 0.5 - f64::from(start)) / f64::from(shrink);
        (at - at.round()).abs()
    };
    let of = |view: &SilhouetteView| {
        let pixel = view.camera.project(centre)?;
        Some(gap(pixel.x, view.left, view.shrink).min(gap(pixel.y, view.top, view.shrink)))
    };
    views.iter().filter_map(of).fold(f64::INFINITY, f64::min)
}

#[track_caller]
fn check(grid: &VoxelGrid, views: &[SilhouetteView], options: &CarveOptions) -> usize {
    let mut carver = Carver::default();
    // Memory of another carving must leave no trace.
    let other = VoxelGrid { cells: [70, 5, 9], ..*grid };
    carver.carve(&other, views, options).unwrap();
    let hull = carver.carve(grid, views, options).unwrap().clone();
    let [nx, ny, nz] = grid.cells;
    for index in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))) {
        let centre = grid.centre(index);
        let expected = keeps(&centre, views, options);
        let found =
            hull.get(index).then(|| carver.counts(index).map(usize::from)).map(|[seen, dissent]| (seen, dissent));
        if found != expected {
            let border = to_border(&centre, views);
            assert!(border < 2e-3, "{index:?}: {found:?}, by definition {expected:?}, {border} px from a border");
        }
    }
    let bounds = carver.bounds(grid, views, options).unwrap();
    for index in hull.iter() {
        let [low, high] = bounds.unwrap();
        assert!((0..3).all(|axis| (low[axis]..=high[axis]).contains(&index[axis])), "{index:?} beyond {bounds:?}");
    }
    hull.count()
}

/// Blots at random places: body and background meet in every cube.
fn blots(size: [u32; 2], seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let [width, height] = size.map(f64::from);
    let discs: Vec<[f64; 3]> =
        (0..6).map(|_| [next() * width, next() * height, next().powi(2) * width / 2.0]).collect();
    let level = |x: f64, y: f64| {
        let n_in = discs.iter().filter(|[a, b, r]| (x - a).hypot(y - b) < *r).count();
        if n_in % 2 == 1 { 128 + n_in as u8 } else { 127 - n_in as u8 }
    };
    (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| level(x.into(), y.into())).collect()
}

fn lenses() -> impl Strategy<Value = Distortion> {
    prop_oneof![
        Just(Distortion::default()),
        [-0.4..0.4, -0.2..0.2, -0.01..0.01, -0.01..0.01, -0.1..0.1].prop_map(|[k1, k2, p1, p2, k3]| Distortion {
            k1,
            k2,
            p1,
            p2,
            k3
        }),
        // Ends inside the picture.
        (-1.5..-0.3).prop_map(|k1| Distortion { k1, ..Distortion::default() }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn carving_is_its_definition_whatever_the_cameras_and_silhouettes(
        eyes in prop::collection::vec(([-2.0..2.0, -2.0..2.0, -1.0..2.0], lenses(), 30.0..150.0f64, 0..u64::MAX), 1..5),
        cells in [1u32..70, 1u32..24, 1u32..24],
        rules in (0usize..3, 0usize..4),
        window in (0u32..30, 0u32..20, 1u32..4),
        body_share in 0usize..8,
    ) {
        let (left, top, shrink) = window;
        let grid = VoxelGrid { origin: Point3::new(-0.7, -0.4, -0.3), size: 0.02, cells };
        let cameras: Vec<Camera> = eyes.iter().map(|([x, y, z], distortion, focal, _)| {
            let mut camera = Camera::look_at(Point3::new(*x, *y, *z), Point3::new(0.0, 0.1, -0.1), [96, 72], *focal);
            camera.intrinsics.skew = *x;
            Camera { distortion: *distortion, ..camera }
        }).collect();
        let size = [(96 - left) / shrink, (72 - top) / shrink];
        let masks: Vec<Vec<u8>> = eyes.iter().zip(0..).map(|((.., seed), at)| match body_share {
            // Some full and some empty ones.
            0 if at == 0 => vec![255; (size[0] * size[1]) as usize],
            1 if at == 0 => vec![0; (size[0] * size[1]) as usize],
            _ => blots(size, *seed),
        }).collect();
        let views: Vec<SilhouetteView> = cameras.iter().zip(&masks).map(|(camera, confidence)| {
            SilhouetteView { camera, left, top, shrink, width: size[0], height: size[1], confidence }
        }).collect();
        let options = CarveOptions { may_err: rules.0.min(views.len() - 1), min_views: rules.1.min(views.len()) };
        check(&grid, &views, &options);
    }
}

#[test]
fn a_ball_is_as_large_as_it_is_and_more_views_come_closer_to_it() {
    // The hull of a ball has more than the ball, less with every view; voxels of 20 mm add a part of their edge.
    let grid = VoxelGrid::covering(Point3::new(-0.5, -0.5, 0.0), Point3::new(0.5, 0.5, 1.0), 0.02).unwrap();
    let centre = Point3::new(0.03, -0.02, 0.5);
    let truth = 4.0 / 3.0 * std::f64::consts::PI * 0.3f64.powi(3);
    let volume = |n: usize| {
        let lens = Distortion { k1: -0.25, k2: 0.08, p1: 0.001, p2: -0.002, k3: 0.0 };
        let cameras = ring(n, [160, 120], 150.0, lens);
        let masks: Vec<_> = cameras.iter().map(|it| silhouette(it, it.image_size, [centre; 2], 0.3)).collect();
        let views: Vec<_> = cameras.iter().zip(&masks).map(|(camera, mask)| view(camera, mask)).collect();
        let mut carver = Carver::default();
        let hull = carver.carve(&grid, &views, &CarveOptions::default()).unwrap();
        let inside = hull.iter().filter(|it| (grid.centre(*it) - centre).norm() < 0.3 - 0.01).count();
        let all = Vector3::from(grid.cells.map(f64::from)).product() as usize;
        assert!(inside <= hull.count() && hull.count() < all);
        // Nothing that is surely in the ball is carved away (10 mm: less than half a pixel's 8 mm and what its border adds).
        let expected = grid_points(&grid).filter(|it| (it - centre).norm() < 0.3 - 0.01).count();
        assert_eq!(inside, expected, "{n} views");
        hull.count() as f64 * grid.size.powi(3) / truth
    };
    let ratios = [2, 4, 8].map(volume);
    assert!(ratios[0] > ratios[1] && ratios[1] > ratios[2], "{ratios:?}");
    assert!(ratios[1] > 1.05 && ratios[1] < 1.35 && ratios[2] < 1.1, "{ratios:?}");
}

fn grid_points(grid: &VoxelGrid) -> impl Iterator<Item = Point3<f64>> + '_ {
    let [nx, ny, nz] = grid.cells;
    let indices = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    indices.map(|it| grid.centre(it))
}

#[test]
fn a_view_that_errs_is_outvoted_where_one_may_err() {
    let cameras = ring(6, [160, 120], 150.0, Distortion::default());
    let grid = VoxelGrid::covering(Point3::new(-0.5, -0.5, 0.0), Point3::new(0.5, 0.5, 1.0), 0.02).unwrap();
    let axis = [Point3::new(0.0, 0.0, 0.2), Point3::new(0.0, 0.0, 0.8)];
    let mut masks: Vec<_> = cameras.iter().map(|it| silhouette(it, it.image_size, axis, 0.1)).collect();
    masks[2].fill(0); // has lost the body
    let views: Vec<_> = cameras.iter().zip(&masks).map(|(camera, mask)| view(camera, mask)).collect();
    let mut carver = Carver::default();
    assert_eq!(carver.carve(&grid, &views, &CarveOptions::default()).unwrap().count(), 0);
    let options = CarveOptions { may_err: 1, min_views: 6 };
    let hull = carver.carve(&grid, &views, &options).unwrap().clone();
    let on_axis = [25, 25, 25];
    assert!(hull.get(on_axis));
    assert_eq!(carver.counts(on_axis), [6, 1]);
    let truth = std::f64::consts::PI * 0.01 * (0.6 + 0.4 / 3.0);
    let ratio = hull.count() as f64 * 8e-6 / truth;
    assert!((0.95..1.6).contains(&ratio), "{ratio}");
}

#[test]
fn a_hull_covers_the_silhouettes_that_made_it_and_stands_out_of_one_that_did_not() {
    let cameras = ring(5, [160, 120], 150.0, Distortion { k1: -0.1, ..Distortion::default() });
    let grid = VoxelGrid::covering(Point3::new(-0.5, -0.5, 0.0), Point3::new(0.5, 0.5, 1.0), 0.01).unwrap();
    let axis = [Point3::new(0.0, 0.0, 0.3), Point3::new(0.1, 0.0, 0.7)];
    let masks: Vec<_> = cameras.iter().map(|it| silhouette(it, it.image_size, axis, 0.12)).collect();
    let views: Vec<_> = cameras.iter().zip(&masks).map(|(camera, mask)| view(camera, mask)).collect();
    let mut carver = Carver::default();
    let surface = carver.carve(&grid, &views, &CarveOptions::default()).unwrap().surface();
    let mut drawn = Vec::new();
    for view in &views {
        let cover = cover(&grid, &surface, view, &mut drawn);
        // Half a voxel at the rim, 0.4 pixels, is missing or too much: of the 120 pixels of the outline, at most half.
        assert!(cover.completeness() > 0.97 && cover.outside() < 0.12, "{cover:?}");
    }
    let half: Vec<u8> = masks[0].iter().zip(0..).map(|(it, at)| if at % 160 < 80 { *it } else { 0 }).collect();
    let cover = cover(&grid, &surface, &view(&cameras[0], &half), &mut drawn);
    assert!(cover.outside() > 0.2 && cover.completeness() > 0.97, "{cover:?}");
}

#[test]
fn what_is_inside_and_what_hangs_together() {
    let mut grid = BitGrid::new([130, 9, 9]);
    // A box of 100 × 5 × 5, a voxel that touches its corner, one that does not.
    for z in 2..7 {
        for y in 2..7 {
            (10..110).for_each(|x| grid.set([x, y, z]));
        }
    }
    grid.set([110, 7, 7]);
    grid.set([129, 0, 0]);
    let surface = grid.surface();
    assert_eq!(surface.count(), 100 * 25 - 98 * 9 + 2);
    assert!(!surface.get([64, 4, 4]) && surface.get([10, 4, 4]) && surface.get([63, 2, 4]));
    let parts = Parts::of(&grid);
    assert_eq!(parts.list.iter().map(|it| it.n_voxels).collect::<Vec<_>>(), [2501, 1]);
    assert_eq!((parts.list[0].min, parts.list[0].max), ([10, 2, 2], [110, 7, 7]));
    assert_eq!(parts.list[1].centroid, Vector3::new(129.0, 0.0, 0.0));
    assert_eq!((parts.part([110, 7, 7]), parts.part([129, 0, 0]), parts.part([0, 0, 0])), (Some(0), Some(1), None));
    assert!(Parts::of(&BitGrid::new([3, 3, 3])).list.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn parts_are_those_that_flooding_finds(density in 1u64..12, seed in 0..u64::MAX, cells in [1u32..80, 1u32..8, 1u32..8]) {
        let mut grid = BitGrid::new(cells);
        let mut state = seed | 1;
        let [nx, ny, nz] = cells;
        let all: Vec<[u32; 3]> =
            (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))).collect();
        for &index in &all {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if (state >> 33) % 16 < density {
                grid.set(index);
            }
        }
        prop_assert_eq!(grid.iter().count(), grid.count());
        let parts = Parts::of(&grid);
        let mut seen = std::collections::BTreeMap::new();
        for start in grid.iter() {
            if seen.contains_key(&start) {
                continue;
            }
            let part = parts.part(start).unwrap();
            let (mut frontier, mut n) = (vec![start], 0);
            while let Some(at) = frontier.pop() {
                if seen.insert(at, part).is_some() {
                    continue;
                }
                n += 1;
                prop_assert_eq!(parts.part(at), Some(part));
                for by in 0..27 {
                    let to: [u32; 3] = std::array::from_fn(|axis| at[axis].wrapping_add_signed(by / 3i32.pow(axis as u32) % 3 - 1));
                    if grid.get(to) && !seen.contains_key(&to) {
                        frontier.push(to);
                    }
                }
            }
            prop_assert_eq!(parts.list[part as usize].n_voxels, n);
        }
    }
}

#[test]
fn a_voxel_has_the_colour_of_the_side_that_a_camera_sees() {
    // A cube; the camera at +x sees red, the one at -x green. The other sides are hidden from both, or nearly so.
    let grid = VoxelGrid { origin: Point3::new(-0.1, -0.1, -0.1), size: 0.02, cells: [10; 3] };
    let mut hull = BitGrid::new(grid.cells);
    grid_indices(10).for_each(|it| hull.set(it));
    let camera = |x: f64| Camera::look_at(Point3::new(x, 0.0, 0.0), Point3::origin(), [64, 64], 100.0);
    let cameras = [camera(2.0), camera(-2.0)];
    let pixels = [[200, 0, 0], [0, 100, 0]].map(|it: [u8; 3]| it.repeat(64 * 64));
    let pictures: Vec<Picture> = cameras
        .iter()
        .zip(&pixels)
        .map(|(camera, pixels)| Picture {
            camera,
            left: 0,
            top: 0,
            shrink: 1,
            width: 64,
            height: 64,
            channels: 3,
            pixels,
        })
        .collect();
    let surface = hull.surface();
    for (index, colour) in surface.iter().zip(colours(&grid, &hull, &surface, &pictures)) {
        match index[0] {
            9 => assert_eq!(colour, [200, 0, 0], "{index:?}"),
            0 => assert_eq!(colour, [0, 100, 0], "{index:?}"),
            _ => {}
        }
    }
    assert!(colours(&grid, &hull, &surface, &[]).iter().all(|it| *it == [0; 3]));
}

fn grid_indices(n: u32) -> impl Iterator<Item = [u32; 3]> {
    (0..n * n * n).map(move |it| [it % n, it / n % n, it / n / n])
}

#[test]
fn what_cannot_be_carved_is_named() {
    let camera = &ring(1, [8, 6], 10.0, Distortion::default())[0];
    let grid = VoxelGrid { origin: Point3::origin(), size: 0.1, cells: [2; 3] };
    let mut carver = Carver::default();
    let mut refused = |views: &[SilhouetteView], may_err| {
        carver.carve(&grid, views, &CarveOptions { may_err, min_views: 0 }).unwrap_err().to_string()
    };
    assert_eq!(refused(&[], 0), "0 views, expected 1 to 255");
    assert_eq!(refused(&[view(camera, &[0; 47])], 0), "view 0 has 47 bytes, expected 48 for its 8 x 6 px");
    assert_eq!(refused(&[view(camera, &[0; 48])], 1), "1 of 1 views may err, expected fewer than there are");
    let covering = |max: f64, size| VoxelGrid::covering(Point3::origin(), Point3::new(1.0, 1.0, max), size);
    assert!(covering(-1.0, 0.1).unwrap_err().to_string().contains("expected the smaller corner first"));
    assert_eq!(covering(1.0, 0.0).unwrap_err().to_string(), "a voxel of 0 m, expected more than 0 m");
    assert!(covering(1.0, 1e-5).unwrap_err().to_string().starts_with("100000 x 100000 x 100000 voxels"));
    assert_eq!(covering(0.35, 0.1).unwrap().cells, [10, 10, 4]);
}

#[test]
fn what_lies_behind_a_camera_is_not_seen_by_it() {
    let camera = Camera {
        camera_from_world: Isometry3::identity(),
        ..Camera::look_at(Point3::origin(), Point3::new(0.0, 1.0, 0.0), [40, 30], 20.0)
    };
    let full = vec![255; 1200];
    // The grid reaches from 1 m behind to 1 m before it.
    let grid = VoxelGrid { origin: Point3::new(-0.25, -0.25, -1.0), size: 0.05, cells: [10, 10, 40] };
    let n = check(&grid, &[view(&camera, &full)], &CarveOptions::default());
    assert!(n > 0 && n <= 10 * 10 * 20, "{n}");
}

/// Of a leg that stands and a shadow that lies beside it, both seen with the confidence `doubt` by all views: what is kept of each [l].
fn possible(doubt: u8, options: &DoubtOptions) -> (f64, f64) {
    let size = [160, 120];
    let cameras = ring(6, size, 120.0, Distortion::default());
    let leg = [Point3::new(-0.2, 0.0, 0.1), Point3::new(-0.2, 0.0, 0.9)];
    let shadow = [Point3::new(0.1, 0.0, 0.03), Point3::new(0.5, 0.0, 0.03)];
    let seen: Vec<Vec<u8>> = cameras
        .iter()
        .map(|it| {
            let [leg, shadow] = [silhouette(it, size, leg, 0.08), silhouette(it, size, shadow, 0.03)];
            leg.iter().zip(&shadow).map(|(leg, shadow)| (*leg).max(*shadow).min(doubt)).collect()
        })
        .collect();
    let views: Vec<SilhouetteView> = cameras.iter().zip(&seen).map(|(camera, it)| view(camera, it)).collect();
    let grid = VoxelGrid::covering(Point3::new(-0.6, -0.4, 0.0), Point3::new(0.8, 0.4, 1.2), 0.02).unwrap();
    let carve = CarveOptions::default();
    let mut hull = Carver::default().carve(&grid, &views, &carve).unwrap().clone();
    let mut it = Doubt::default();
    assert_eq!(it.look(&views, options), (options.from..BODY).contains(&doubt));
    it.add(&mut hull, &grid, &views, &carve, options).unwrap();
    for index in hull.iter() {
        let [low, high] = it.bounds(&grid, &views, &carve).unwrap().unwrap();
        assert!((0..3).all(|axis| (low[axis]..=high[axis]).contains(&index[axis])));
    }
    let litres = |is_left: bool| {
        let n = hull.iter().filter(|it| (grid.centre(*it).x < -0.05) == is_left).count();
        n as f64 * grid.size.powi(3) * 1e3
    };
    (litres(true), litres(false))
}

#[test]
fn a_leg_in_doubt_stands_and_a_shadow_in_doubt_lies() {
    let options = DoubtOptions { from: 64, height: 0.15 };
    let (leg, shadow) = possible(100, &options);
    let true_leg = std::f64::consts::PI * 6.4 * 0.8 + 4.0 / 3.0 * std::f64::consts::PI * 0.512;
    assert!((0.85..1.4).contains(&(leg / true_leg)) && shadow == 0.0, "{leg} of {true_leg} l, {shadow} l");
    // A shadow that lies higher than shadows do is body; what no view doubts is as before; what is surely background stays it.
    let flat = DoubtOptions { height: 0.0, ..options };
    assert!(possible(100, &flat).1 > 0.3, "{:?}", possible(100, &flat));
    let certain = possible(200, &options);
    assert!((certain.0 - leg).abs() < 0.05 * leg && certain.1 > 0.3, "{certain:?}");
    assert_eq!(possible(63, &options), (0.0, 0.0));
}

#[test]
fn where_most_views_are_sure_one_in_doubt_changes_nothing() {
    let size = [160, 120];
    let cameras = ring(6, size, 120.0, Distortion::default());
    // An arm that lies level: lower than a shadow may be.
    let arm = [Point3::new(-0.3, 0.0, 0.5), Point3::new(0.3, 0.0, 0.5)];
    let seen: Vec<Vec<u8>> = cameras.iter().map(|it| silhouette(it, size, arm, 0.05)).collect();
    let litres = |n_in_doubt: usize| {
        let seen: Vec<Vec<u8>> = seen
            .iter()
            .enumerate()
            .map(|(at, it)| it.iter().map(|it| if at < n_in_doubt { *it / 3 } else { *it }).collect())
            .collect();
        let views: Vec<SilhouetteView> = cameras.iter().zip(&seen).map(|(camera, it)| view(camera, it)).collect();
        let grid = VoxelGrid::covering(Point3::new(-0.6, -0.4, 0.0), Point3::new(0.6, 0.4, 1.0), 0.02).unwrap();
        let mut hull = Carver::default().carve(&grid, &views, &CarveOptions::default()).unwrap().clone();
        let (mut it, options) = (Doubt::default(), DoubtOptions { from: 64, height: 0.15 });
        it.look(&views, &options);
        it.add(&mut hull, &grid, &views, &CarveOptions::default(), &options).unwrap();
        hull.count()
    };
    let sure = litres(0);
    assert!(sure > 100);
    assert_eq!((litres(1), litres(3), litres(4)), (sure, sure, 0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn upright_is_what_hangs_together_along_z(
        cells in [1u32..80, 1u32..5, 1u32..14], least in 0u32..16, seed in 0..u64::MAX,
    ) {
        let [nx, ny, nz] = cells;
        let mut grid = BitGrid::new(cells);
        let all: Vec<[u32; 3]> =
            (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))).collect();
        let set = blots([nx, ny * nz], seed);
        all.iter().zip(&set).filter(|(_, it)| **it >= BODY).for_each(|(index, _)| grid.set(*index));
        let upright = grid.upright(least);
        for [x, y, z] in all {
            let below = (0..z).rev().take_while(|z| grid.get([x, y, *z])).count() as u32;
            let above = (z + 1..nz).take_while(|z| grid.get([x, y, *z])).count() as u32;
            let expected = grid.get([x, y, z]) && below + 1 + above >= least;
            prop_assert_eq!(upright.get([x, y, z]), expected);
        }
    }
}
