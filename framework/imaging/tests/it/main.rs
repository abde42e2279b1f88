//! What is found in drawn pictures, compared with what was drawn.

mod background;
mod blobs;
mod joined_spots;
mod scene;
mod spot_error;
mod spots;
