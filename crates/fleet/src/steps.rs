//! The steps of a solution, as bytes.

use crate::bytes::Cursor;
use crate::record::ChainId;
use mapwright::Pose2;

/// Where a solution stands: in which chain, and with which record it begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(crate) struct SolutionId {
    pub(crate) chain: ChainId,
    pub(crate) begin: u32,
}

/// How a solution begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Begin {
    pub(crate) term: u64,
    /// The solution that it goes on with, and the first record of that which it does not.
    pub(crate) base: Option<(SolutionId, u32)>,
}

/// A step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Step<'a> {
    Begin(Begin),
    TakeIn(ChainId, Option<Pose2>),
    Found(&'a [u8]),
    /// All that was there is taken in, old places were looked for anew, and poses are where closures have them.
    Settled,
}

impl Step<'_> {
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        let put_chain = |out: &mut Vec<u8>, chain: ChainId| {
            out.extend_from_slice(&chain.rank.to_le_bytes());
            out.extend_from_slice(&chain.session.to_le_bytes());
        };
        match self {
            Self::Begin(Begin { term, base }) => {
                out.push(1);
                out.extend_from_slice(&term.to_le_bytes());
                out.push(u8::from(base.is_some()));
                if let Some((id, end)) = base {
                    put_chain(out, id.chain);
                    out.extend_from_slice(&id.begin.to_le_bytes());
                    out.extend_from_slice(&end.to_le_bytes());
                }
            }
            Self::TakeIn(chain, pose) => {
                out.push(2);
                put_chain(out, *chain);
                out.push(u8::from(pose.is_some()));
                if let Some(Pose2 { x, y, theta }) = pose {
                    [x, y, theta].into_iter().for_each(|number| out.extend_from_slice(&number.to_le_bytes()));
                }
            }
            Self::Found(bytes) => {
                out.push(3);
                out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
                out.extend_from_slice(bytes);
            }
            Self::Settled => out.push(4),
        }
    }

    /// The next step of these bytes, if all of it is there.
    ///
    /// # Errors
    /// They begin with no step.
    pub(crate) fn take<'a>(bytes: &mut &'a [u8]) -> Result<Option<Step<'a>>, NoStep> {
        let mut cursor = Cursor(bytes);
        let step = match cursor.u8() {
            None => None,
            Some(1) => begin(&mut cursor).map(Step::Begin),
            Some(2) => take_in(&mut cursor),
            Some(3) => cursor.u32().and_then(|count| cursor.take(count as usize)).map(Step::Found),
            Some(4) => Some(Step::Settled),
            Some(_) => return Err(NoStep),
        };
        if step.is_some() {
            *bytes = cursor.0;
        }
        Ok(step)
    }
}

/// Bytes that are no step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NoStep;

fn chain(cursor: &mut Cursor<'_>) -> Option<ChainId> {
    Some(ChainId { rank: cursor.u16()?, session: cursor.u32()? })
}

fn begin(cursor: &mut Cursor<'_>) -> Option<Begin> {
    let term = cursor.u64()?;
    let base = match cursor.u8()? {
        0 => None,
        _ => Some((SolutionId { chain: chain(cursor)?, begin: cursor.u32()? }, cursor.u32()?)),
    };
    Some(Begin { term, base })
}

fn take_in<'a>(cursor: &mut Cursor<'_>) -> Option<Step<'a>> {
    let chain = chain(cursor)?;
    let pose = match cursor.u8()? {
        0 => None,
        _ => Some(Pose2 { x: cursor.f64()?, y: cursor.f64()?, theta: cursor.f64()? }),
    };
    Some(Step::TakeIn(chain, pose))
}
