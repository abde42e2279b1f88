//! What each edge measured.
