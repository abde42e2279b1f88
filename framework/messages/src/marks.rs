//! Painted marks on a surface that moves and deforms: a face, a knee.

use nalgebra::{Isometry3, Matrix2, Matrix3, Matrix6, Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::schema::{Numbers, Pose};
use crate::wire::portable;
use crate::{CameraId, CameraSet, Message, Provenance, Quality, Space, Time, Wire};

/// One mark at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Mark {
    /// Which mark it is: the label of its features.
    pub label: u32,
    /// In the space of its [`Marks`] [m].
    #[schemars(with = "Numbers<3>")]
    pub position: Point3<f64>,
    /// Of the position, in that space [m²].
    #[schemars(with = "Numbers<9>")]
    pub covariance: Matrix3<f64>,
    /// The cameras whose features entered; empty unless `provenance` is measured.
    pub cameras: CameraSet,
    /// Whether this sample was measured, predicted or filled.
    pub provenance: Provenance,
}

impl Mark {
    /// Standard deviation of the position: the root of the mean variance over the three axes [m].
    pub fn sigma(&self) -> f64 {
        (self.covariance.trace() / 3.0).max(0.0).sqrt()
    }
}

/// How well a model of shape describes the marks of one moment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ShapeFit {
    /// Root mean square distance between the measured marks and the model's [m].
    pub rms: f64,
    /// How far the shape lies outside what was captured [–]: 0 inside, 1 where it cannot be trusted any more.
    pub out_of_distribution: f64,
    /// The weights of the bases [–].
    pub weights: Vec<f64>,
}

/// The marks of one surface at one time, in a space of their own whose place in the world is known exactly as far as the two go together:
/// `covariance` is the uncertainty of the whole; each mark has its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Marks {
    /// The time that all samples are of.
    pub time: Time,
    /// Takes points of the marks' space to the world. From a model of shape, the marks' space is that of the head (the knee) itself.
    #[serde(with = "Pose")]
    #[schemars(with = "Pose")]
    pub world_from_marks: Isometry3<f64>,
    /// Of δ in `world_from_marks` ∘ exp(δ), (rotation, translation) [rad², rad m, m²].
    #[schemars(with = "Numbers<36>")]
    pub covariance: Matrix6<f64>,
    /// Ascending by label.
    pub list: Vec<Mark>,
    /// How well a model of shape fits; `None` where none was fitted.
    pub fit: Option<ShapeFit>,
}

impl Default for Marks {
    fn default() -> Self {
        Self {
            time: Time::ZERO,
            world_from_marks: Isometry3::identity(),
            covariance: Matrix6::zeros(),
            list: Vec::new(),
            fit: None,
        }
    }
}

impl Marks {
    /// The mark of this label.
    pub fn get(&self, label: u32) -> Option<&Mark> {
        self.list.binary_search_by_key(&label, |it| it.label).ok().map(|place| &self.list[place])
    }

    /// Where a mark of the list is in the world [m].
    pub fn in_world(&self, mark: &Mark) -> Point3<f64> {
        self.world_from_marks * mark.position
    }
}

impl Message for Marks {
    const NAME: &'static str = "marks";
    const SPACE: Space = Space::WORLD_POINTS;
    const WIRE: Wire = portable!(Marks);

    fn quality(&self) -> Quality {
        let sum: f64 = self.list.iter().map(Mark::sigma).sum();
        Quality {
            count: Some(self.list.len() as u32),
            sigma: (!self.list.is_empty()).then(|| sum / self.list.len() as f64),
        }
    }
}

/// Where one mark should be in one picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GuidedMark {
    /// Which mark.
    pub label: u32,
    /// Where, in raw (distorted) pixels; outside the picture too.
    #[schemars(with = "Numbers<2>")]
    pub pixel: Point2<f64>,
    /// Of that [px²].
    #[schemars(with = "Numbers<4>")]
    pub covariance: Matrix2<f64>,
    /// This camera's reports under the label disagree with the other cameras: it tracks something else.
    pub disputed: bool,
}

/// Where each camera should see each mark, predicted from all cameras: trackers use it to label the marks that they find.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct MarkGuide {
    /// Capture time of the pictures that it is for.
    pub time: Time,
    /// Ascending by camera, its marks ascending by label.
    pub cameras: Vec<(CameraId, Vec<GuidedMark>)>,
}

impl MarkGuide {
    /// The marks in the picture of `camera`, ascending by label.
    pub fn of(&self, camera: CameraId) -> &[GuidedMark] {
        let place = self.cameras.binary_search_by_key(&camera, |it| it.0);
        place.map_or(&[], |place| &self.cameras[place].1)
    }
}

impl Message for MarkGuide {
    const NAME: &'static str = "mark_guide";
    const SPACE: Space = Space::PIXELS_OF_EACH;
    const WIRE: Wire = portable!(MarkGuide);

    fn quality(&self) -> Quality {
        Quality { count: Some(self.cameras.iter().map(|it| it.1.len() as u32).sum()), sigma: None }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn mark(label: u32, x: f64) -> Mark {
        let (position, covariance) = (Point3::new(x, 0.0, 0.0), Matrix3::identity() * 4.0);
        Mark { label, position, covariance, cameras: CameraSet::default(), provenance: Provenance::Filled }
    }

    #[test]
    fn marks_are_found_by_label_and_placed_in_the_world() {
        let marks = Marks {
            world_from_marks: Isometry3::new(Vector3::y(), Vector3::zeros()),
            list: vec![mark(3, 1.0), mark(7, 2.0)],
            ..Marks::default()
        };
        let seven = marks.get(7).unwrap();
        assert_eq!(marks.in_world(seven), Point3::new(2.0, 1.0, 0.0));
        assert_eq!(marks.get(4), None);
        assert_eq!((marks.quality().count, marks.quality().sigma), (Some(2), Some(2.0)));
    }

    #[test]
    fn a_guide_tells_each_camera_its_own() {
        let place = GuidedMark { label: 1, pixel: Point2::origin(), covariance: Matrix2::identity(), disputed: false };
        let guide = MarkGuide { time: Time::ZERO, cameras: vec![(CameraId(2), vec![place]), (CameraId(5), vec![])] };
        assert_eq!(guide.of(CameraId(2)), [place]);
        assert!(guide.of(CameraId(5)).is_empty() && guide.of(CameraId(3)).is_empty());
    }
}
