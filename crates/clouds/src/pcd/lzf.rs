//! LZF, the compression of binary_compressed PCD files.

/// Three bytes become 264 at most.
const RATIO_MAX: usize = 88;

/// Unpacks to exactly `length` bytes.
///
/// # Errors
/// Where the packed bytes break, and why.
pub(super) fn decompress(packed: &[u8], length: usize) -> Result<Vec<u8>, (usize, String)> {
    if length > packed.len().saturating_mul(RATIO_MAX) {
        return Err((0, format!("{} bytes, which cannot become as many", packed.len())));
    }
    let mut out = Vec::with_capacity(length);
    let mut at = 0;
    while let Some(control) = packed.get(at).map(|byte| usize::from(*byte)) {
        let step =
            if control < 32 { literal(packed, at, control, &mut out) } else { copy(packed, at, control, &mut out) };
        at += step.ok_or_else(|| (at, format!("a broken step after {} bytes", out.len())))?;
        if out.len() > length {
            return Err((at, format!("more than {length} bytes")));
        }
    }
    if out.len() == length { Ok(out) } else { Err((at, format!("{} bytes", out.len()))) }
}

/// `control + 1` bytes as they are; how many packed bytes that took.
fn literal(packed: &[u8], at: usize, control: usize, out: &mut Vec<u8>) -> Option<usize> {
    out.extend_from_slice(packed.get(at + 1..at + 2 + control)?);
    Some(control + 2)
}

/// Bytes that stood there before; they may overlap with what they become.
fn copy(packed: &[u8], at: usize, control: usize, out: &mut Vec<u8>) -> Option<usize> {
    let (mut length, mut used) = (control >> 5, 2);
    if length == 7 {
        length += usize::from(*packed.get(at + 1)?);
        used = 3;
    }
    let back = ((control & 31) << 8) + usize::from(*packed.get(at + used - 1)?) + 1;
    let start = out.len().checked_sub(back)?;
    for from in start..start + length + 2 {
        out.push(out[from]); // one more is pushed for each, so that `from` stays below the length
    }
    Some(used)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn copies_may_overlap() {
        assert_eq!(decompress(&[0, b'a', 0xe0, 1, 0], 11).unwrap(), b"aaaaaaaaaaa");
        assert!(decompress(&[0, b'a', 0x20, 9], 4).is_err());
        assert!(decompress(&[0, b'a'], 1 << 40).is_err());
    }

    proptest! {
        #[test]
        fn any_bytes(packed: Vec<u8>, length in 0..4000_usize) {
            if let Ok(out) = decompress(&packed, length) {
                prop_assert_eq!(out.len(), length);
            }
        }
    }
}
