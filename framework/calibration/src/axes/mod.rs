//! Metres, the vertical and the origin, and what fixes each how well.
