//! Two lights a known distance apart.
