//! Ready worlds in space, each a function of a seed.

mod buildings;
mod courtyard;
mod halls;
mod rings;

pub use buildings::{look_alike_storeys, loops_1km, two_storey};
pub use courtyard::courtyard;
pub use halls::growing_halls;
