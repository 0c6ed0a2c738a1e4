//! Which wire to nodes of ROS 2 there is.

use crate::args::WireKind;
use crate::failure::Failure;
use mapwright_live::node::NodeName;
use mapwright_live::wire::Wire;

/// Joins the system that the environment names, over the wire that is asked for.
pub(super) fn join(asked: Option<WireKind>, node: &NodeName) -> Result<Box<dyn Wire>, Failure> {
    let implementation = std::env::var("RMW_IMPLEMENTATION").unwrap_or_default();
    match asked.unwrap_or_else(|| usual(&implementation)) {
        WireKind::Dds => dds(node),
        WireKind::Zenoh => zenoh(node),
    }
}

/// What a node of ROS 2 would speak here, as far as this build can.
fn usual(implementation: &str) -> WireKind {
    let is_zenoh_alone = cfg!(feature = "zenoh") && !cfg!(feature = "dds");
    if implementation == "rmw_zenoh_cpp" || is_zenoh_alone { WireKind::Zenoh } else { WireKind::Dds }
}

#[cfg(feature = "dds")]
fn dds(node: &NodeName) -> Result<Box<dyn Wire>, Failure> {
    use mapwright_dds::{Configuration, Dds};
    let configuration = Configuration::from_environment().map_err(|error| Failure::Usage(error.to_string()))?;
    Ok(Box::new(Dds::join(&configuration, node.namespace(), node.name())?))
}

#[cfg(not(feature = "dds"))]
fn dds(_node: &NodeName) -> Result<Box<dyn Wire>, Failure> {
    Err(Failure::Usage(
        "this mapwright was built without ROS 2 over DDS; build it with `cargo build --release --features dds` (needs cmake and libclang), or \
         use a package"
            .to_owned(),
    ))
}

#[cfg(feature = "zenoh")]
fn zenoh(node: &NodeName) -> Result<Box<dyn Wire>, Failure> {
    use mapwright_zenoh::{Configuration, Zenoh};
    let configuration = Configuration::from_environment().map_err(|error| Failure::Usage(error.to_string()))?;
    Ok(Box::new(Zenoh::join(&configuration, node.namespace(), node.name())?))
}

#[cfg(not(feature = "zenoh"))]
fn zenoh(_node: &NodeName) -> Result<Box<dyn Wire>, Failure> {
    Err(Failure::Usage(
        "this mapwright was built without ROS 2 over Zenoh; build it with `cargo build --release --features zenoh`, or use a package"
            .to_owned(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_of_zenoh_are_met_over_zenoh() {
        assert_eq!(usual("rmw_zenoh_cpp"), WireKind::Zenoh);
        let else_dds = if cfg!(feature = "dds") || !cfg!(feature = "zenoh") { WireKind::Dds } else { WireKind::Zenoh };
        assert_eq!((usual("rmw_fastrtps_cpp"), usual("")), (else_dds, else_dds));
    }
}
