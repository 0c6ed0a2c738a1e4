//! Statistics of errors.

/// Statistics of a list of errors, in the errors' unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorStats {
    /// How many errors.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the population (divided by `count`).
    pub std: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// Median; the mean of the middle two where `count` is even.
    pub median: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Sum of squares.
    pub sse: f64,
}

impl ErrorStats {
    /// Statistics of `errors`; none of an empty list.
    #[must_use]
    pub fn of(errors: &[f64]) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n;
        let sse = errors.iter().map(|e| e * e).sum::<f64>();
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (low, high) = ((sorted.len() - 1) / 2, sorted.len() / 2);
        Some(Self {
            count: sorted.len(),
            mean,
            std: variance.sqrt(),
            rmse: (sse / n).sqrt(),
            median: 0.5 * (sorted[low] + sorted[high]),
            min: sorted[0],
            max: sorted[sorted.len() - 1],
            sse,
        })
    }

    /// Mean of the squared errors, in the unit's square.
    #[must_use]
    pub fn mean_squared(&self) -> f64 {
        self.sse / self.count as f64
    }
}

/// Statistics of pose errors, translation and rotation apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseErrors {
    /// Length of the translation error, metres.
    pub translation_m: ErrorStats,
    /// Absolute heading error, in space the angle of the rotation error, degrees.
    pub rotation_deg: ErrorStats,
}

impl PoseErrors {
    /// Statistics of `(metres, degrees)`; none of an empty list.
    pub(crate) fn of(errors: &[(f64, f64)]) -> Option<Self> {
        let (metres, degrees): (Vec<_>, Vec<_>) = errors.iter().copied().unzip();
        Some(Self { translation_m: ErrorStats::of(&metres)?, rotation_deg: ErrorStats::of(&degrees)? })
    }
}

/// The value that a share of `values` lies at or below, between two of them by a straight line; none of an empty list.
pub(crate) fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = share * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + at.fract() * (high - low))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_handful_by_hand() {
        let stats = ErrorStats::of(&[4.0, 1.0, 2.0, 1.0]).unwrap();
        assert_eq!((stats.count, stats.min, stats.max), (4, 1.0, 4.0));
        assert_eq!((stats.mean, stats.median, stats.sse), (2.0, 1.5, 22.0));
        assert_eq!((stats.std, stats.mean_squared()), (1.5f64.sqrt(), 5.5));
        assert_eq!(ErrorStats::of(&[]), None);
        assert_eq!(quantile(&[4.0, 1.0, 2.0], 0.75), Some(3.0));
        assert_eq!((quantile(&[7.0], 0.9), quantile(&[], 0.9)), (Some(7.0), None));
    }
}
