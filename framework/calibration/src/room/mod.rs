//! From a recording of one waved light to a solved room.
