//! Recognising places seen before, and refusing what only looks like them.
