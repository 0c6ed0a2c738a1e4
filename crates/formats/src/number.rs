//! Decimal numbers in and out, fast for the short forms that logs are made of and exact for all.

use mapwright_geom::Stamp;

/// Powers of ten that a double holds exactly.
const POWERS_OF_TEN: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// Digits of a decimal without exponent: the value is `mantissa / 10^decimals`.
#[derive(Debug, Clone, Copy)]
struct Decimal {
    negative: bool,
    mantissa: u64,
    decimals: usize,
}

/// Splits `[sign] digits [. digits]` of at most 19 digits; anything else is left to the slow path.
#[inline]
fn split_decimal(token: &[u8]) -> Option<Decimal> {
    let (negative, digits) = match token {
        [b'-', rest @ ..] => (true, rest),
        rest => (false, rest),
    };
    if digits.len() > 20 {
        return None;
    }
    let (mut mantissa, mut count, mut point) = (0_u64, 0_usize, None);
    for &byte in digits {
        let digit = byte.wrapping_sub(b'0');
        if digit < 10 {
            mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(digit));
            count += 1;
        } else if byte == b'.' && point.is_none() {
            point = Some(count);
        } else {
            return None;
        }
    }
    let valid = (1..=19).contains(&count);
    valid.then(|| Decimal { negative, mantissa, decimals: count - point.unwrap_or(count) })
}

/// The double of a short decimal: mantissa and power of ten are exact, so one division rounds once (Clinger 1990).
#[inline]
fn exact_quotient(decimal: Decimal) -> Option<f64> {
    if decimal.mantissa > 1 << 53 {
        return None;
    }
    let magnitude = decimal.mantissa as f64 / POWERS_OF_TEN[decimal.decimals];
    Some(if decimal.negative { -magnitude } else { magnitude })
}

/// The same value as `str::parse::<f64>`, or none where that fails.
#[inline]
pub(crate) fn parse_f64(token: &[u8]) -> Option<f64> {
    match split_decimal(token).and_then(exact_quotient) {
        Some(value) => Some(value),
        None => parse_with_std(token),
    }
}

/// The same value as `str::parse::<f32>`, or none where that fails.
#[inline]
pub(crate) fn parse_f32(token: &[u8]) -> Option<f32> {
    match split_decimal(token).and_then(exact_quotient).and_then(narrow) {
        Some(value) => Some(value),
        None => parse_with_std(token),
    }
}

#[cold]
fn parse_with_std<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Rounds a correctly rounded double again, unless it lies half-way between two singles: only there could the second
/// rounding go another way than rounding once.
#[inline]
fn narrow(value: f64) -> Option<f32> {
    const HALF_WAY: u64 = 1 << 28;
    let below_single = value.to_bits() & ((1 << 29) - 1);
    let normal = value == 0.0 || (1e-30..1e30).contains(&value.abs());
    (normal && below_single != HALF_WAY).then_some(value as f32)
}

/// A form of short number: which of the first bytes must be digits, point or space.
struct ShortForm {
    /// The bytes of the form with all digits zero.
    zeros: u64,
    /// All ones in the bytes that the form covers.
    covered: u64,
    /// All ones in the bytes that must be as in `zeros`.
    fixed: u64,
    /// 0x76 in each digit's byte: added to a digit it leaves the high bit clear up to nine and sets it from ten on.
    carry: u64,
}

/// `d.dd` and a space.
const FOUR_BYTES: ShortForm =
    ShortForm { zeros: 0x20_3030_2E30, covered: 0xFF_FFFF_FFFF, fixed: 0xFF_0000_FF00, carry: 0x7676_0076 };

/// `dd.dd` and a space.
const FIVE_BYTES: ShortForm =
    ShortForm { zeros: 0x2030_302E_3030, covered: 0xFFFF_FFFF_FFFF, fixed: 0xFF00_00FF_0000, carry: 0x0076_7600_7676 };

impl ShortForm {
    /// The values of the digits, each in its byte, where the bytes have this form.
    #[inline]
    fn digits(&self, word: u64) -> Option<[u8; 8]> {
        const HIGH_BITS: u64 = 0x8080_8080_8080_8080;
        let rest = (word ^ self.zeros) & self.covered;
        let not_digits = ((rest + self.carry) | rest) & HIGH_BITS;
        (not_digits | (rest & self.fixed) == 0).then(|| rest.to_le_bytes())
    }
}

/// A range in hundredths, `d.dd` or `dd.dd` before a space, at the beginning of eight bytes; with its length.
///
/// Integers below 2^24 and 100 are exact singles, so one division rounds once.
#[inline]
pub(crate) fn short_range(bytes: [u8; 8]) -> Option<(f32, usize)> {
    let word = u64::from_le_bytes(bytes);
    if let Some([ones, _, tenths, hundredths, ..]) = FOUR_BYTES.digits(word) {
        return Some((hundredths_to_metres([0, ones, tenths, hundredths]), 4));
    }
    let [tens, ones, _, tenths, hundredths, ..] = FIVE_BYTES.digits(word)?;
    Some((hundredths_to_metres([tens, ones, tenths, hundredths]), 5))
}

#[inline]
fn hundredths_to_metres(digits: [u8; 4]) -> f32 {
    let [a, b, c, d] = digits.map(u32::from);
    (1000 * a + 100 * b + 10 * c + d) as f32 / 100.0
}

/// A stamp from decimal seconds, exact to the nanosecond; none where it is no number or beyond the year 2262.
#[inline]
pub(crate) fn parse_stamp(token: &[u8]) -> Option<Stamp> {
    match split_decimal(token) {
        Some(decimal) if decimal.decimals <= 9 => stamp_from_decimal(decimal),
        _ => stamp_from_float(token),
    }
}

fn stamp_from_decimal(decimal: Decimal) -> Option<Stamp> {
    let scale = 10_i128.pow(9 - decimal.decimals as u32);
    let magnitude = i128::from(decimal.mantissa) * scale;
    let nanos = if decimal.negative { -magnitude } else { magnitude };
    i64::try_from(nanos).ok().map(Stamp)
}

/// For exponents and more than nine decimals: to the nearest nanosecond that a double can tell.
#[cold]
fn stamp_from_float(token: &[u8]) -> Option<Stamp> {
    let seconds: f64 = parse_with_std(token)?;
    (seconds.abs() < 9.2e9).then(|| Stamp::from_secs_f64(seconds))
}

/// Appends a stamp in seconds with nine decimals, exactly.
pub(crate) fn write_stamp(out: &mut Vec<u8>, stamp: Stamp) {
    const NANOS: u64 = POWERS_OF_TEN_INT[9];
    let nanos = stamp.0.unsigned_abs();
    write_parts(out, stamp.0 < 0, nanos / NANOS, nanos % NANOS, 9);
}

/// Largest magnitude that [`write_fixed`] takes.
pub(crate) const FIXED_LIMIT: f64 = 1e15;

/// Powers of ten by which decimals are scaled.
const POWERS_OF_TEN_INT: [u64; 10] =
    [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000, 1_000_000_000];

/// Appends `value` with exactly `decimals` (at most 9) decimals, correctly rounded, ties to even, like `{:.9}`.
///
/// The caller makes sure that `value` is finite and within [`FIXED_LIMIT`]; others are clamped there.
pub(crate) fn write_fixed(out: &mut Vec<u8>, value: f64, decimals: usize) {
    let decimals = decimals.min(9);
    let power = POWERS_OF_TEN_INT[decimals];
    if value == 0.0 {
        // Planar poses are full of zeros.
        return write_parts(out, value.is_sign_negative(), 0, 0, decimals);
    }
    let scaled = scaled_integer(value.abs().min(FIXED_LIMIT), power);
    // Up to 10^15 with nine decimals needs 80 bits; whole and fraction fit 64 each.
    let (whole, fraction) = match u64::try_from(scaled) {
        Ok(small) => (small / power, small % power),
        Err(_) => ((scaled / u128::from(power)) as u64, (scaled % u128::from(power)) as u64),
    };
    write_parts(out, value.is_sign_negative(), whole, fraction, decimals);
}

/// `round(magnitude * power)` in integers: `mantissa * power` has at most 83 bits, the power of two is a shift.
fn scaled_integer(magnitude: f64, power: u64) -> u128 {
    let bits = magnitude.to_bits();
    let (exponent, fraction) = ((bits >> 52) as i32, bits & ((1 << 52) - 1));
    let (mantissa, exponent) = if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent - 1075) };
    let product = u128::from(mantissa) * u128::from(power);
    if exponent >= 0 {
        return product << exponent.min(40);
    }
    let shift = exponent.unsigned_abs();
    if shift > 100 {
        return 0;
    }
    let (whole, rest, half) = (product >> shift, product & ((1 << shift) - 1), 1_u128 << (shift - 1));
    whole + u128::from(rest > half || (rest == half && whole & 1 == 1))
}

/// Appends sign, whole and, where there are decimals, point and fraction.
fn write_parts(out: &mut Vec<u8>, negative: bool, whole: u64, fraction: u64, decimals: usize) {
    let mut text = [b'0'; 32];
    let mut at = text.len();
    if decimals > 0 {
        at = put_digits(&mut text, at, fraction).min(text.len() - decimals) - 1;
        text[at] = b'.';
    }
    at = put_digits(&mut text, at, whole).min(at - 1);
    if negative {
        at -= 1;
        text[at] = b'-';
    }
    out.extend_from_slice(&text[at..]);
}

/// The two digits of every number below a hundred.
const PAIRS: [[u8; 2]; 100] = {
    let mut pairs = [[b'0'; 2]; 100];
    let mut number = 0;
    while number < 100 {
        pairs[number] = [b'0' + (number / 10) as u8, b'0' + (number % 10) as u8];
        number += 1;
    }
    pairs
};

/// Puts the digits of `value` (none for zero) before `end`, two at a time; returns where they begin. What lies before
/// them stays zeros.
fn put_digits(text: &mut [u8; 32], end: usize, mut value: u64) -> usize {
    let mut at = end;
    while value >= 10 {
        at -= 2;
        text[at..at + 2].copy_from_slice(&PAIRS[(value % 100) as usize]);
        value /= 100;
    }
    if value > 0 {
        at -= 1;
        text[at] = b'0' + value as u8;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn same_f64(text: &str) {
        let expected = text.parse::<f64>().ok().map(f64::to_bits);
        assert_eq!(parse_f64(text.as_bytes()).map(f64::to_bits), expected, "{text}");
    }

    fn same_f32(text: &str) {
        let expected = text.parse::<f32>().ok().map(f32::to_bits);
        assert_eq!(parse_f32(text.as_bytes()).map(f32::to_bits), expected, "{text}");
    }

    #[test]
    fn odd_forms_read_as_the_standard_library_reads_them() {
        let forms = [
            "",
            "-",
            "+",
            ".",
            "-.",
            "1.",
            ".5",
            "-.5",
            "+1.5",
            "1e5",
            "1E-5",
            "nan",
            "NaN",
            "inf",
            "-inf",
            "1..2",
            "1.2.3",
            "0x1",
            "1_0",
            "-0",
            "-0.0",
            "00012.500",
            "9007199254740993",
            "9007199254740992",
            "1e300",
            "1e-320",
            "123456789012345678901234567890",
            "0.1234567890123456789",
            "976052857.337530",
            " 1",
            "1 ",
            "--1",
            "\u{fc}",
            "16777217",
            "16777219.0",
            "3.4028236e38",
            "1.17549435e-38",
            "81.830002",
        ];
        for text in forms {
            same_f64(text);
            same_f32(text);
        }
    }

    #[test]
    fn every_short_range_is_exact() {
        for hundredths in 0..10_000_u32 {
            let text = format!("{}.{:02} 1234", hundredths / 100, hundredths % 100);
            let expected = text[..text.find(' ').unwrap()].parse::<f32>().unwrap();
            let (value, length) = short_range(text.as_bytes()[..8].try_into().unwrap()).unwrap();
            assert_eq!((value, length), (expected, text.find(' ').unwrap()));
        }
    }

    #[test]
    fn the_short_range_takes_nothing_but_digits() {
        for at in 0..6 {
            for byte in 0..=255_u8 {
                for form in [*b"1.23 456", *b"12.34 56"] {
                    let mut bytes = form;
                    bytes[at] = byte;
                    if let Some((value, length)) = short_range(bytes) {
                        let text = std::str::from_utf8(&bytes[..length]).unwrap();
                        assert_eq!((Ok(value), bytes[length]), (text.parse(), b' '));
                        assert!(text.bytes().all(|b| b.is_ascii_digit() || b == b'.'));
                    }
                }
            }
        }
    }

    #[test]
    fn stamps_are_exact_to_the_nanosecond() {
        let cases = [
            ("976052857.337530", 976_052_857_337_530_000),
            ("-1.000000001", -1_000_000_001),
            ("0", 0),
            ("1071078718.462310", 1_071_078_718_462_310_000),
            ("9223372036.854775807", i64::MAX),
            ("1.0000000015", 1_000_000_001),
        ];
        for (text, nanos) in cases {
            let found = parse_stamp(text.as_bytes()).unwrap().0;
            assert!((found - nanos).abs() <= i64::from(text.len() > 11 && text.ends_with("15")), "{text}");
        }
        for text in ["", "nan", "inf", "1e30", "9999999999999", "host", "-"] {
            assert_eq!(parse_stamp(text.as_bytes()), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn decimals_read_as_the_standard_library_reads_them(whole in 0_u64..1_000_000_000_000, fraction in 0_u64..1_000_000_000, decimals in 0_usize..12, negative: bool) {
            let sign = if negative { "-" } else { "" };
            let text = format!("{sign}{whole}.{fraction:0decimals$}");
            same_f64(&text);
            same_f32(&text);
        }

        #[test]
        fn any_float_reads_back(value: f64, single: f32) {
            same_f64(&format!("{value}"));
            same_f64(&format!("{value:e}"));
            same_f32(&format!("{single}"));
            same_f32(&format!("{value}"));
        }

        #[test]
        fn garbage_reads_as_the_standard_library_reads_it(text in "[-+.0-9eEnaif]{0,24}") {
            same_f64(&text);
            same_f32(&text);
        }

        #[test]
        fn fixed_decimals_round_as_the_standard_library_rounds(value in -1e15_f64..1e15, small in -10.0_f64..10.0, decimals in 0_usize..=9) {
            for v in [value, small, small * 1e-6, (small * 512.0).round() / 1024.0, 0.0, -0.0] {
                let mut out = Vec::new();
                write_fixed(&mut out, v, decimals);
                prop_assert_eq!(String::from_utf8(out).unwrap(), format!("{v:.decimals$}"));
            }
        }

        #[test]
        fn stamps_read_back(nanos: i64) {
            let mut out = Vec::new();
            write_stamp(&mut out, Stamp(nanos));
            prop_assert_eq!(parse_stamp(&out), Some(Stamp(nanos)));
        }
    }
}
