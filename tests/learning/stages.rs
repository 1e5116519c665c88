//! Stages in turn: bits, checkpoints, and what consolidation does.
