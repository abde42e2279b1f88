//! Where the light has been, for those who wave it.
