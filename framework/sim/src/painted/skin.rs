//! What a face's skin looks like, apart from its marks: lips, brows, eyes, hair, and the fine texture that real skin has.

use nalgebra::Point3;

use super::head::{HALF_MOUTH, HALF_SLIT, SLIT, smooth};
use super::texture::{freckles, noise};

/// How far the hair line wavers to both sides [mm].
const RAGGED_MM: f64 = 3.5;

/// Where the features lie, in the units and the space of the built-in head [mm].
pub(super) struct Features {
    pub seed: u32,
    /// Whether eyes and the parting of the lips are painted on, and not made of surfaces of their own.
    pub is_built_in: bool,
}

impl Features {
    /// How bright the skin of the built-in head is at `p` [mm].
    pub fn albedo(&self, p: &Point3<f64>) -> f32 {
        let at = p * 1e-3;
        let side = p.y.abs();
        let grain = |size: f64, number: u32| noise(&at, [size * 1e-3; 3], self.seed ^ number);
        let ahead = smooth((p.x - 20.0) / 30.0) as f32;
        let mut skin =
            0.63 + 0.025 * grain(16.0, 11) + 0.022 * grain(5.0, 12) + 0.028 * grain(1.7, 13) + 0.024 * grain(0.9, 14);
        // Redder, hence darker in gray: cheeks, the tip of the nose, around the eyes.
        skin -= 0.05 * near([side, p.z], [44.0, -22.0], [18.0, 15.0]);
        skin -= 0.05 * near([side, p.z], [0.0, -24.0], [11.0, 8.0]) * ahead;
        skin -= 0.06 * near([side, p.z], [30.0, 6.0], [17.0, 10.0]) * ahead;
        // Stubble.
        let beard =
            near([side * 0.8, p.z], [0.0, -88.0], [34.0, 24.0]) + 0.8 * near([side, p.z], [0.0, -46.0], [17.0, 5.0]);
        let chin = smooth((p.x + 5.0) / 30.0) as f32;
        if chin > 0.0 {
            skin -= beard.min(1.0) * (0.06 + 0.055 * grain(1.2, 15)) * chin;
        }
        skin *= 1.0 - 0.22 * freckles(&at, 7e-3, 0.35, 0.75e-3, self.seed ^ 21);
        // A few lines across the forehead, and beside the mouth.
        skin -= 0.03 * crease(p.z - 47.0 - 0.002 * side * side, 0.8) * ahead * smooth((58.0 - side) / 20.0) as f32;
        skin -= 0.025 * crease(p.z - 61.0 - 0.002 * side * side, 0.8) * ahead * smooth((50.0 - side) / 20.0) as f32;
        skin = self.lips(p, side, ahead, skin);
        if self.is_built_in {
            skin = self.eye(p, side, ahead, skin);
        }
        // Nostrils.
        let nostril = ellipse([side - 7.0, p.z + 33.0], [4.6, 2.6]) * smooth((p.x - 84.0) / 6.0) as f32;
        skin += (0.08 - skin) * nostril;
        skin = self.brows(p, side, ahead, skin);
        self.hair(p, side, skin)
    }

    /// How bright a dark shirt is at `p` [m].
    pub fn cloth(&self, p: &Point3<f64>) -> f32 {
        0.12 + 0.02 * noise(p, [1.5e-3; 3], self.seed ^ 71) + 0.02 * noise(p, [25e-3; 3], self.seed ^ 72)
    }

    fn lips(&self, p: &Point3<f64>, side: f64, ahead: f32, skin: f32) -> f32 {
        let along = (1.0 - (side / (HALF_MOUTH + 2.0)).powi(2)).max(0.0).sqrt();
        let bow = 1.0 - 0.25 * (-(side / 4.0).powi(2)).exp();
        let height = if self.is_built_in { 7.5 } else { 11.0 };
        let (upper, lower) = (height * along * bow, 9.0 * along);
        let up = p.z - SLIT;
        let inside = if up > 0.0 { smooth((upper - up) / 1.6 + 0.5) } else { smooth((lower + up) / 1.6 + 0.5) };
        let is_lip = if along > 0.0 { inside as f32 * ahead } else { 0.0 };
        let mut seen = skin;
        if is_lip > 0.0 {
            let lines = noise(&(p * 1e-3), [8e-3, 1.1e-3, 8e-3], self.seed ^ 31);
            seen += (0.40 + 0.035 * lines - skin) * is_lip;
        }
        if self.is_built_in && side < HALF_MOUTH {
            let parting = smooth((HALF_SLIT * 0.95 - up.abs()) / 0.25) as f32 * ahead;
            seen += (0.035 - seen) * parting;
        }
        seen
    }

    fn eye(&self, p: &Point3<f64>, side: f64, ahead: f32, skin: f32) -> f32 {
        let (across, up) = (side - 31.0, p.z - 8.5);
        // The opening between the lids: two arcs.
        let along = (1.0 - (across / 14.5).powi(2)).max(0.0);
        let (above, below) = (5.6 * along.powf(0.8), -4.4 * along.powf(0.9));
        let inside = (smooth((above - up) / 0.8 + 0.5) * smooth((up - below) / 0.8 + 0.5)) as f32;
        let is_open = if along > 0.0 { inside * ahead } else { 0.0 };
        let from_middle = across.hypot(up - 0.3);
        let iris = smooth((5.9 - from_middle) / 0.7 + 0.5) as f32;
        let pupil = smooth((2.4 - from_middle) / 0.6 + 0.5) as f32;
        let white = 0.66 - 0.12 * smooth((up - 0.5) / 5.0) as f32 - 0.15 * smooth((across.abs() - 8.0) / 6.0) as f32;
        let mut eye = white + (0.24 + 0.05 * noise(&(p * 1e-3), [0.8e-3; 3], self.seed ^ 41) - white) * iris;
        eye += (0.03 - eye) * pupil;
        let glint = smooth((1.0 - (across - 1.8).hypot(up - 2.4)) / 0.5 + 0.5) as f32;
        eye += (0.95 - eye) * glint;
        let mut seen = skin + (eye - skin) * is_open;
        if along > 0.0 {
            // Lashes, and the fold of the upper lid.
            let lashes = bump(up - above - 0.4, 1.0) * 0.75 + bump(up - below + 0.3, 0.7) * 0.35;
            seen += (0.12 - seen) * (lashes * ahead).min(1.0);
        }
        let wide = (1.0 - (across / 17.0).powi(2)).max(0.0);
        let fold = bump(up - 4.0 - 6.5 * wide.powf(0.6), 0.8) * smooth(wide * 3.0) as f32;
        seen - 0.16 * fold * ahead
    }

    fn brows(&self, p: &Point3<f64>, side: f64, ahead: f32, skin: f32) -> f32 {
        let along = (side - 10.0) / 44.0;
        if !(0.0..1.0).contains(&along) {
            return skin;
        }
        let middle = 24.5 + 9.0 * (along * 2.6).sin() - 4.5 * along;
        let half = 4.6 - 3.0 * along;
        let thick =
            smooth((half - (p.z - middle).abs()) / 2.4 + 0.4) * smooth(along * 9.0) * smooth((1.0 - along) * 5.0);
        if thick == 0.0 {
            return skin;
        }
        let strands = noise(&(p * 1e-3), [3e-3, 0.8e-3, 2.4e-3], self.seed ^ 51);
        let share = (thick as f32 * (0.8 + 0.35 * strands)).clamp(0.0, 1.0) * ahead;
        skin + (0.17 - skin) * share
    }

    fn hair(&self, p: &Point3<f64>, side: f64, skin: f32) -> f32 {
        let at = p * 1e-3;
        // The hair line by how far ahead a point lies.
        let line = if p.x > 40.0 {
            62.0 + (p.x - 40.0) * 0.55 - 0.10 * (side - 30.0).max(0.0)
        } else if p.x > 16.0 {
            62.0 - (40.0 - p.x) * 1.9
        } else if p.x > 4.0 {
            16.4
        } else if p.x > -24.0 {
            33.0 + (p.x - 4.0) * 0.5
        } else {
            19.0 + (p.x + 24.0) * 4.0
        };
        let high = if self.is_built_in || p.x < 30.0 { 0.0 } else { 6.0 };
        let line = line.max(-84.0) + high;
        if p.z - line < -RAGGED_MM - 0.1 {
            return skin;
        }
        let ragged = RAGGED_MM * f64::from(noise(&at, [5e-3, 2.2e-3, 5e-3], self.seed ^ 61));
        // Ears stand out from it.
        let bare = smooth((side - 74.0) / 3.0) * smooth((34.0 - p.z) / 6.0);
        let cover = smooth((p.z - line + ragged) / 7.0) * (1.0 - bare);
        if cover == 0.0 {
            return skin;
        }
        let strands =
            noise(&at, [1.4e-3, 1.1e-3, 9e-3], self.seed ^ 62) + 0.6 * noise(&at, [4e-3, 4e-3, 16e-3], self.seed ^ 63);
        let hair = 0.125 + 0.055 * strands;
        skin + (hair - skin) * cover as f32
    }
}

/// 1 in the middle of a blurred ellipse.
fn near(p: [f64; 2], middle: [f64; 2], sigma: [f64; 2]) -> f32 {
    let [x, y] = [0, 1].map(|i| (p[i] - middle[i]) / sigma[i]);
    (-0.5 * (x * x + y * y)).exp() as f32
}

/// 1 inside an ellipse with a soft edge.
fn ellipse(p: [f64; 2], half: [f64; 2]) -> f32 {
    smooth((1.15 - (p[0] / half[0]).hypot(p[1] / half[1])) / 0.4) as f32
}

/// 1 on a line.
fn bump(d: f64, half: f64) -> f32 {
    (-(d / half).powi(2)).exp() as f32
}

fn crease(d: f64, half: f64) -> f32 {
    bump(d, half)
}
