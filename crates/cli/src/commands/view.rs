//! `mapwright view`

use crate::args::ViewResultsArgs;
use crate::failure::{Failure, Outcome};

/// Plays a finished run in a browser, until Ctrl-C.
#[cfg(feature = "view")]
pub(super) fn run(args: &ViewResultsArgs) -> Result<Outcome, Failure> {
    use super::live::{access, pen};
    use crate::events::Interrupt;
    use crate::session::{AnySession, read_any_session, read_bytes};
    use crate::settings;
    use crate::terminal::say;
    use mapwright::{SpaceSweep, Sweep};
    use mapwright_viewer::Viewer;
    use std::thread;
    use std::time::Duration;

    let settings = settings::load(&args.settings)?;
    let interrupt = Interrupt::watch()?;
    let (session, losses) = read_any_session(&args.results)?;
    let (_, bytes) = read_bytes(&args.results)?;
    let replay = match session {
        AnySession::Plane(_) => replayed::<Sweep>(&bytes, &args.results)?,
        AnySession::Space(_) => replayed::<SpaceSweep>(&bytes, &args.results)?,
    };
    let viewer = Viewer::replay(access(&args.view, false), pen(&settings), replay)?;
    say(&format!("view     {}\n", viewer.url()))?;
    while !interrupt.came() {
        thread::sleep(Duration::from_millis(50));
    }
    Ok(Outcome::of_losses(&losses))
}

#[cfg(feature = "view")]
use mapwright_record::read_entries;

#[cfg(feature = "view")]
fn replayed<M: mapwright_viewer::View>(
    bytes: &[u8],
    path: &std::path::Path,
) -> Result<mapwright_viewer::Replay, Failure> {
    let mut maker = mapwright_viewer::ReplayMaker::default();
    let wrong = |cause: String| Failure::Session { path: path.to_owned(), cause };
    let (entries, _) = read_entries::<M>(bytes).map_err(|error| wrong(error.to_string()))?;
    for entry in entries {
        maker.add(entry).map_err(|error| wrong(error.to_string()))?;
    }
    let replay = maker.finish();
    if replay.is_empty() { Err(wrong("expected a run, found no scan".to_owned())) } else { Ok(replay) }
}

/// There is no page in this build.
#[cfg(not(feature = "view"))]
pub(super) fn run(_args: &ViewResultsArgs) -> Result<Outcome, Failure> {
    Err(Failure::Usage(
        "this mapwright was built without the view; build it with `cargo build --release --features view`, or use a package"
            .to_owned(),
    ))
}
