//! What wheels always get wrong in heading: a drift with the way, and a share of turns.

/// Standard deviations before anything is known: radians a metre, and the share.
const DRIFT_SIGMA: f64 = 0.01;
const TURN_SIGMA: f64 = 0.03;

/// By least squares over what headings were corrected by.
#[derive(Debug, Clone, Default)]
pub(super) struct Faults {
    /// Sums of weighted products: way by way, way by turn, turn by turn, way by correction, turn by correction.
    sums: [f64; 5],
    drift: f64,
    turn: f64,
}

impl Faults {
    /// What is to be added to a step's turn, radians.
    pub(super) fn correction_rad(&self, driven_m: f64, turned_rad: f64) -> f64 {
        self.drift * driven_m + self.turn * turned_rad
    }

    /// On a piece of way and turn the heading had to be corrected by so much more than these faults say, known with this weight.
    pub(super) fn learn(&mut self, [driven_m, turned_rad]: [f64; 2], growth_rad: f64, weight: f64) {
        let wrong_rad = growth_rad + self.correction_rad(driven_m, turned_rad);
        let products = [
            driven_m * driven_m,
            driven_m * turned_rad,
            turned_rad * turned_rad,
            driven_m * wrong_rad,
            turned_rad * wrong_rad,
        ];
        self.sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
        let [ww, wt, tt, wc, tc] = self.sums;
        let (ww, tt) = (ww + DRIFT_SIGMA.powi(-2), tt + TURN_SIGMA.powi(-2));
        let determinant = ww * tt - wt * wt;
        if determinant > 0.0 && determinant.is_finite() {
            self.drift = (tt * wc - wt * tc) / determinant;
            self.turn = (ww * tc - wt * wc) / determinant;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drift_and_a_share_of_turns_are_told_apart() {
        let mut faults = Faults::default();
        for k in 0..400 {
            let (driven_m, turned_rad) = (0.3, if k % 7 == 0 { 0.5 } else { 0.0 });
            let growth_rad = 0.01 * driven_m - 0.03 * turned_rad - faults.correction_rad(driven_m, turned_rad);
            faults.learn([driven_m, turned_rad], growth_rad, 1e5);
        }
        assert!((faults.drift - 0.01).abs() < 0.001 && (faults.turn + 0.03).abs() < 0.005, "{faults:?}");
    }
}
