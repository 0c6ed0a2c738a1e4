//! What `merge-maps` is given.

use super::Voice;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(crate) struct MergeMapsArgs {
    /// The map in whose frame and resolution the joined one is: the YAML of a PGM or PNG, or a folder of results, of which `map.yaml` is
    /// read.
    #[arg(value_name = "A.yaml")]
    pub(crate) first: PathBuf,
    /// The map that is looked for in it, at every heading and every shift.
    #[arg(value_name = "B.yaml")]
    pub(crate) second: PathBuf,
    /// Name of the joined map without its endings: NAME.pgm, NAME.yaml and NAME.png, which has a tint for each map. Nothing is written where
    /// the maps are not joined.
    #[arg(short, long, value_name = "NAME")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) voice: Voice,
}
