//! Targets of numbered columns, found in pictures that were rendered.

use super::*;

/// As printed for cameras around a cylinder [mm].
const RADIUS: f64 = 57.0;
const STEP: f64 = 12.0;
const SIDE: f64 = 4.3;
const LOWEST: f64 = 10.0;
const SIZE: [usize; 2] = [900, 1200];
const FOCAL: f64 = 950.0;
const PATTERN: TargetPattern = TargetPattern { rows: 20, columns: 14 };

/// 5 × 7 figures, a row a number of five bits.
const FONT: [[u8; 7]; 10] = [
    [0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110],
    [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
    [0b01110, 0b10001, 0b00001, 0b00010, 0b00100, 0b01000, 0b11111],
    [0b11110, 0b00001, 0b00001, 0b01110, 0b00001, 0b00001, 0b11110],
    [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
    [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
    [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110],
    [0b11111, 0b00001, 0b00010, 0b00010, 0b00100, 0b00100, 0b00100],
    [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110],
    [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100],
];

/// What is shown.
#[derive(Clone, Copy)]
struct Scene {
    /// Direction of the camera from the axis [rad].
    azimuth: f64,
    numbers: bool,
    /// Column and row (from the top) of a rectangle that shines as bright as the paper.
    glare: Option<[usize; 2]>,
    noise: f64,
}

impl Scene {
    fn of(azimuth: f64) -> Self {
        Self { azimuth, numbers: true, glare: None, noise: 2.0 }
    }

    /// Distance of the camera from the axis, and its height, looking level [mm].
    const EYE: [f64; 2] = [330.0, 125.0];

    /// Where the middle of a rectangle is seen, row 0 the highest.
    fn pixel(&self, column: usize, row: usize) -> [f64; 2] {
        let angle = STEP / RADIUS * (column as f64 - 1.0) - self.azimuth;
        let height = LOWEST + STEP * (PATTERN.rows - 1 - row) as f64;
        let (sin, cos) = angle.sin_cos();
        // Seen from outside angles grow to the right.
        let depth = Self::EYE[0] - RADIUS * cos;
        let [width, rows] = SIZE.map(|it| it as f64 / 2.0);
        [width + FOCAL * RADIUS * sin / depth, rows + FOCAL * (Self::EYE[1] - height) / depth]
    }

    /// Gray level along one line of sight.
    fn level(&self, x: f64, y: f64) -> f64 {
        let [width, rows] = SIZE.map(|it| it as f64 / 2.0);
        let (right, down) = ((x - width) / FOCAL, (y - rows) / FOCAL);
        // From (EYE, 0) towards the axis: (EYE − t)² + (right t)² = r².
        let a = 1.0 + right * right;
        let discriminant = Self::EYE[0].powi(2) - a * (Self::EYE[0].powi(2) - RADIUS * RADIUS);
        if discriminant < 0.0 {
            // Lamps behind it in rows, on black.
            return if y.rem_euclid(210.0) < 14.0 && x.rem_euclid(17.0) < 9.0 { 250.0 } else { 25.0 };
        }
        let depth = (Self::EYE[0] - discriminant.sqrt()) / a;
        let (along, side) = (Self::EYE[0] - depth, right * depth);
        let height = Self::EYE[1] - down * depth;
        let shade = 1.0 - 0.25 * (side / RADIUS).powi(2);
        if !(0.0..=256.0).contains(&height) {
            return 20.0;
        }
        let arc = (side.atan2(along) + self.azimuth).rem_euclid(std::f64::consts::TAU) * RADIUS / STEP;
        let around = std::f64::consts::TAU * RADIUS / STEP;
        // The last piece before a whole turn is the left half of the first column.
        let arc = if arc > around - 0.5 { arc - around } else { arc };
        let column = arc.round();
        let inside = (arc - column) * STEP;
        let row = ((height - LOWEST) / STEP).round();
        let up = height - LOWEST - row * STEP;
        let printed = (0.0..14.0).contains(&column);
        let number = column as usize + 1;
        if printed && (0.0..20.0).contains(&row) && inside.abs() < SIDE / 2.0 && up.abs() < SIDE / 2.0 {
            let shines = self.glare == Some([number, 19 - row as usize]);
            return if shines { 205.0 * shade } else { 35.0 };
        }
        let base = LOWEST + 19.0 * STEP + 7.0;
        if self.numbers && printed && Self::is_figure(number, inside, height - base) {
            return 30.0;
        }
        215.0 * shade
    }

    /// Figures 5 mm high, from the middle of the number and its lower edge.
    fn is_figure(number: usize, across: f64, up: f64) -> bool {
        let digits: Vec<usize> = number.to_string().bytes().map(|it| usize::from(it - b'0')).collect();
        let cell = 5.0 / 7.0;
        let (width, gap) = (5.0 * cell, 1.2 * cell);
        let whole = digits.len() as f64 * (width + gap) - gap;
        let left = across + whole / 2.0;
        let is_set = |left: f64, up: f64| {
            let digit = (left / (width + gap)).floor();
            let inside = left - digit * (width + gap);
            let (column, row) = ((inside / cell).floor(), 6.0 - (up / cell).floor());
            let fits = digit >= 0.0
                && (digit as usize) < digits.len()
                && (0.0..5.0).contains(&column)
                && (0.0..7.0).contains(&row);
            fits && FONT[digits[digit as usize]][row as usize] >> (4 - column as usize) & 1 == 1
        };
        // Strokes a little wider than their cells, so that slanted ones hang together.
        let wide = 0.22 * cell;
        [(-wide, -wide), (-wide, wide), (wide, -wide), (wide, wide)].iter().any(|(dx, dy)| is_set(left + dx, up + dy))
    }

    fn picture(&self) -> Vec<u8> {
        let mut chance = foveate_laws::texture::Chance::of([7, 7, 7, self.azimuth.to_bits()]);
        let mut pixels = Vec::with_capacity(SIZE[0] * SIZE[1]);
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let part = |at: usize, half: usize| at as f64 + half as f64 * 0.5 - 0.25;
                let sum: f64 = (0..4).map(|it| self.level(part(x, it % 2), part(y, it / 2))).sum();
                pixels.push((sum / 4.0 + self.noise * chance.normal()).round().clamp(0.0, 255.0) as u8);
            }
        }
        pixels
    }

    fn find(&self, leftmost: Option<usize>) -> Result<TargetFound, NoTarget> {
        let pixels = self.picture();
        find_target(&ImageView::new(&pixels, SIZE[0], SIZE[1]).unwrap(), PATTERN, leftmost)
    }

    #[track_caller]
    fn check(&self, found: &TargetFound, least: usize) {
        assert!(found.columns.len() >= least, "{:?}", found.columns);
        assert_eq!(found.labelled.len(), found.columns.len() * PATTERN.rows);
        for it in &found.labelled {
            let [x, y] = self.pixel(it.column, it.row);
            let off = (it.patch.centre - Point2::new(x, y)).norm();
            // Perspective and the bend of the paper put the middle of what is seen beside the middle of what is printed, at the sides most.
            assert!(off < 0.5, "column {} row {}: {off} px", it.column, it.row);
        }
    }
}

#[test]
fn columns_are_found_and_named_from_any_side() {
    for (azimuth, least) in [(0.9, 6), (1.7, 6)] {
        let scene = Scene::of(azimuth);
        scene.check(&scene.find(None).unwrap(), least);
    }
}

#[test]
fn a_column_in_glare_is_left_out_and_its_rectangles_are_given_without_a_name() {
    // Column 6 is in the middle.
    let scene = Scene { glare: Some([6, 8]), ..Scene::of(1.05) };
    let found = scene.find(None).unwrap();
    scene.check(&found, 5);
    assert!(
        !found.columns.contains(&6) && found.columns.contains(&5) && found.columns.contains(&7),
        "{:?}",
        found.columns
    );
    let [x, y] = scene.pixel(6, 3);
    assert!(found.others.iter().any(|it| (it.centre - Point2::new(x, y)).norm() < 0.4));
}

#[test]
fn without_numbers_the_leftmost_column_has_to_be_stated() {
    let scene = Scene { numbers: false, ..Scene::of(1.3) };
    let refused = scene.find(None);
    assert!(matches!(refused, Err(NoTarget::Numbers { .. })), "{refused:?}");
    // The columns that this camera sees, by where they lie.
    let named = Scene::of(1.3).find(None).unwrap();
    let first = named.columns[0];
    let pixels = scene.picture();
    let view = ImageView::new(&pixels, SIZE[0], SIZE[1]).unwrap();
    let dark = patches::Dark::of(&view);
    let patches = dark.rectangles();
    let whole_from = lattice::columns(&patches, 20).iter().position(|it| it.len() == 20).unwrap();
    let found = scene.find(Some((first + 14 - whole_from - 1) % 14 + 1)).unwrap();
    scene.check(&found, 6);
    assert_eq!(found.votes, [0.0, 0.0]);
}

#[test]
fn a_picture_that_is_five_times_darker_shows_the_same() {
    let scene = Scene::of(1.05);
    let pixels: Vec<u8> = scene.picture().iter().map(|it| it / 5).collect();
    let view = ImageView::new(&pixels, SIZE[0], SIZE[1]).unwrap();
    let (found, bright) = (find_target(&view, PATTERN, None).unwrap(), scene.find(None).unwrap());
    assert_eq!(found.columns, bright.columns);
}

#[test]
fn pictures_without_a_target_are_refused() {
    let view = |pixels: &[u8]| find_target(&ImageView::new(pixels, 64, 48).unwrap(), PATTERN, None);
    assert!(matches!(view(&[128; 64 * 48]), Err(NoTarget::Columns { patches: 0, .. })));
    let stripes: Vec<u8> = (0..64 * 48).map(|it| if it % 8 < 4 { 30 } else { 220 }).collect();
    assert!(view(&stripes).is_err());
    let nothing = find_target(&ImageView::new(&[], 0, 0).unwrap(), PATTERN, None);
    assert!(nothing.is_err());
}
