//! Reading CARMEN logs.
fn main() {}
