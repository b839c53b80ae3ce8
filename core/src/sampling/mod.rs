//! Which rays a pixel asks for.
