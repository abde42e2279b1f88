//! What a display shows to a moving viewer: a view for each eye on each tile.

use nalgebra::{Matrix4, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::Numbers;
use crate::wire::portable;
use crate::{Message, Quality, Space, Time, Wire};

/// The view of one eye on one tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EyeView {
    /// Where the eye will be [m].
    #[schemars(with = "Numbers<3>")]
    pub eye: Point3<f64>,
    /// From a point of the space to the clip space of OpenGL: −w ≤ x, y, z ≤ w.
    #[schemars(with = "Numbers<16>")]
    pub clip_from_space: Matrix4<f64>,
}

/// One tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TileView {
    /// Its name.
    pub name: String,
    /// Its width and height [px].
    pub size_px: [u32; 2],
    /// Lower left, lower right and upper left corner, as seen by who looks at it [m].
    #[schemars(with = "[Numbers<3>; 3]")]
    pub corners: [Point3<f64>; 3],
    /// Of the left and the right eye; none for an eye that is not before the tile.
    pub eyes: [Option<EyeView>; 2],
}

/// All tiles at one moment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Views {
    /// When the head was seen.
    pub time: Time,
    /// When people will see what is shown for this message: the eyes are where they will be then.
    pub shown_at: Time,
    /// The tiles.
    pub tiles: Vec<TileView>,
}

impl Message for Views {
    const NAME: &'static str = "views";
    const SPACE: Space = Space::POINTS;
    const WIRE: Wire = portable!(Views);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.tiles.len() as u32), sigma: None }
    }
}
