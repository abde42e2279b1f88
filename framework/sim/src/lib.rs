//! Simulated worlds, cameras that look at them, and the score of what was recovered.
//!
//! | module | what it holds |
//! |---|---|
//! | [`lab`] | the room and its eighteen wide cameras |
//! | [`person`] | a walking person with eight LEDs: a pure function of time |
//! | [`painted`] | the actor's painted face: how it deforms, where its marks are, how it looks |
//! | [`truth`] | cameras, lenses and heads as they truly are, apart from what calibrations say |
//! | [`world`] | people and clutter together, as a message |
//! | [`camera`] | from the world to the pixels of one field |
//! | [`projector`] | a projector: what it shows when, and where its light falls |
//! | [`observer`] | from the world to features, without a picture |
//! | [`studio`] | people in clothes, furniture and lamps: textured surfaces in colour |
//! | [`timing`] | a camera's clock, its delivery, its failures |
//! | [`head`] | a pan-tilt head with mechanics and a line, byte by byte |
//! | [`score`] | recovered targets against the truth |
//! | [`wall`] | a wall of displays, what it shows, and people with laser pointers |
//! | [`nodes`] | `sim.lab`, `sim.camera`, `sim.observer`, `sim.rider`, `sim.head`, `sim.score`, `sim.head_score`, `sim.mark_observer`, `sim.mark_score`, `sim.projector`, `sim.cloud_score`, `sim.surface_score`, `sim.tracked_score`, `sim.silhouettes`, `sim.silhouette_score`, `sim.body_score`, `sim.wall`, `sim.wall_camera`, `sim.wall_observer`, `sim.wall_score`, `sim.display_score` |

pub mod bump;
pub mod camera;
mod chance;
pub mod head;
pub mod lab;
mod nearest;
pub mod nodes;
pub mod observer;
pub mod painted;
pub mod person;
pub mod projector;
mod rounding;
pub mod score;
mod sight;
pub mod studio;
pub mod timing;
pub mod truth;
pub mod wall;
pub mod world;

use foveate_node::Registry;

/// Registers the nodes of this room.
pub fn register(registry: &mut Registry) {
    registry.add::<nodes::lab::Lab>();
    registry.add::<nodes::camera::SimCamera>();
    registry.add::<nodes::observer::SimObserver>();
    registry.add::<nodes::head::SimHead>();
    registry.add::<nodes::rider::SimRider>();
    registry.add::<nodes::score::Score>();
    registry.add::<nodes::head_score::HeadScore>();
    registry.add::<nodes::mark_observer::SimMarkObserver>();
    registry.add::<nodes::mark_score::MarkScore>();
    registry.add::<nodes::projector::SimProjector>();
    registry.add::<nodes::cloud_score::CloudScore>();
    registry.add::<nodes::surface_score::SurfaceScore>();
    registry.add::<nodes::tracked_score::TrackedScore>();
    registry.add::<nodes::silhouettes::SimSilhouettes>();
    registry.add::<nodes::silhouette_score::SilhouetteScore>();
    registry.add::<nodes::body_score::BodyScore>();
    registry.add::<nodes::posture_score::PostureScore>();
    registry.add::<nodes::true_surface::TrueSurface>();
    registry.add::<nodes::wall::SimWall>();
    registry.add::<nodes::wall_camera::SimWallCamera>();
    registry.add::<nodes::wall_observer::SimWallObserver>();
    registry.add::<nodes::wall_score::WallScore>();
    registry.add::<nodes::display_score::DisplayScore>();
}
