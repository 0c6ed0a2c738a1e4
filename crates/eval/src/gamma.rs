//! The incomplete gamma function.

/// Below this the recurrence leads to where Stirling's series holds to 1e-16.
const STIRLING_FROM: f64 = 16.0;
/// Terms below this share of the sum change nothing.
const NEGLIGIBLE: f64 = 1e-17;
/// Terms at most; a few times the root of `a` are needed.
const TERMS_MOST: f64 = 1e6;
/// A continued fraction's denominators are kept from zero by this (Lentz).
const TINY: f64 = 1e-300;

/// The regularised lower incomplete gamma function `P(a, x)` of `a > 0` and `x >= 0` (Abramowitz and Stegun 1964, 6.5.1).
pub(crate) fn regularised_lower_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let factor = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 { factor * series(a, x) } else { 1.0 - factor * continued_fraction(a, x) }
}

/// `sum x^n / (a (a + 1) .. (a + n))` (6.5.29), which converges fast for `x < a + 1`.
fn series(a: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, 1.0);
    while term > NEGLIGIBLE * sum && n < TERMS_MOST {
        term *= x / (a + n);
        sum += term;
        n += 1.0;
    }
    sum
}

/// `1 / (x + 1 - a - 1 (1 - a) / (x + 3 - a - ..))` (6.5.31, its even part), by Lentz's method.
fn continued_fraction(a: f64, x: f64) -> f64 {
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1.0 / TINY, 1.0 / away_from_zero(b));
    let (mut value, mut n) = (d, 1.0);
    loop {
        let numerator = -n * (n - a);
        b += 2.0;
        d = 1.0 / away_from_zero(numerator * d + b);
        c = away_from_zero(b + numerator / c);
        value *= c * d;
        if (c * d - 1.0).abs() <= f64::EPSILON || n >= TERMS_MOST {
            return value;
        }
        n += 1.0;
    }
}

fn away_from_zero(value: f64) -> f64 {
    if value.abs() < TINY { TINY } else { value }
}

/// `ln Gamma(x)` of `x > 0` by Stirling's series (6.1.41).
fn ln_gamma(x: f64) -> f64 {
    let (mut x, mut shift) = (x, 0.0);
    while x < STIRLING_FROM {
        shift += x.ln();
        x += 1.0;
    }
    let inverse = 1.0 / x;
    let square = inverse * inverse;
    let terms = [1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0, 1.0 / 1188.0, -691.0 / 360_360.0];
    let correction = terms.iter().rev().fold(0.0, |sum, term| sum * square + term) * inverse;
    (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + correction - shift
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_agree_with_closed_forms() {
        // P(1, x) = 1 - e^-x; P(2, x) = 1 - (1 + x) e^-x; Gamma(1/2)^2 = pi, Gamma(11) = 10!
        for x in [1e-6, 0.3, 1.0, 2.5, 10.0, 50.0_f64] {
            assert!((regularised_lower_gamma(1.0, x) - (1.0 - (-x).exp())).abs() < 1e-14, "{x}");
            assert!((regularised_lower_gamma(2.0, x) - (1.0 - (1.0 + x) * (-x).exp())).abs() < 1e-14, "{x}");
        }
        assert!((ln_gamma(0.5) - 0.5 * std::f64::consts::PI.ln()).abs() < 1e-14);
        assert!((ln_gamma(11.0) - 3_628_800.0_f64.ln()).abs() < 1e-13);
        assert_eq!(regularised_lower_gamma(3.0, 0.0), 0.0);
    }
}
