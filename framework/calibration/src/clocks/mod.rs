//! Cameras that share no clock: their offsets from the continuity of the light's path.
