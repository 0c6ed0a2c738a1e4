//! Timing from outside: the library reads no clock, whoever wants stage timings hands one in.

/// A stage of the pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Preparing the scan.
    Prepare,
    /// Predicting the pose.
    Predict,
    /// Matching against the local map.
    Match,
    /// Inserting a keyframe, with the local map's changes.
    Insert,
    /// Looking for old places and correcting the past, where that is done inline.
    Close,
}

/// Hears when a stage ends. The time since the previous call belongs to that stage.
pub trait Probe {
    /// A scan begins.
    fn begin(&mut self);
    /// `stage` has ended.
    fn end(&mut self, stage: Stage);
}

/// Hears nothing and costs nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProbe;

impl Probe for NoProbe {
    fn begin(&mut self) {}
    fn end(&mut self, _stage: Stage) {}
}
