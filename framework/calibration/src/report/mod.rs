//! One HTML page with pictures of a solved room.
