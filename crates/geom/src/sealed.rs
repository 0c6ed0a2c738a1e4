//! Nobody else implements what is sealed by it.

/// See the module.
pub trait Sealed {}
impl Sealed for crate::Pose2 {}
impl Sealed for crate::Pose3 {}
