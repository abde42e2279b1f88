//! What re-projection cannot see, and a verdict in words.
