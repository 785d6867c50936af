//! Finds the range in which a lens polynomial is increasing.

/// The smallest root in (0, infinity) at which the polynomial `c[0] + c[1] x + c[2] x^2 + ...` becomes negative or zero,
/// given `c[0] > 0`; `None` when it stays positive.
///
/// Between consecutive roots of the derivative the polynomial is monotone, so each such interval holds at most one root,
/// found by bisection to the last bit. The roots of the derivative are found the same way, degree by degree.
pub(super) fn first_positive_root(coefficients: &[f64]) -> Option<f64> {
    positive_roots(coefficients).into_iter().next()
}

/// Value by Horner's rule.
pub(super) fn evaluate(coefficients: &[f64], x: f64) -> f64 {
    coefficients
        .iter()
        .rev()
        .fold(0.0, |value, &c| value * x + c)
}

/// All simple roots in (0, infinity) in increasing order (a root where the sign does not change may be missed).
fn positive_roots(coefficients: &[f64]) -> Vec<f64> {
    let Some(degree) = coefficients.iter().rposition(|&c| c != 0.0) else {
        return Vec::new();
    };
    if degree == 0 {
        return Vec::new();
    }
    let coefficients = &coefficients[..=degree];
    let derivative: Vec<f64> = coefficients
        .iter()
        .enumerate()
        .skip(1)
        .map(|(power, &c)| c * power as f64)
        .collect();
    // Cauchy's bound: no root lies beyond it.
    let leading = coefficients[degree].abs();
    let bound = 1.0
        + coefficients[..degree]
            .iter()
            .fold(0.0_f64, |largest, &c| largest.max(c.abs() / leading));
    let mut ends = positive_roots(&derivative);
    ends.retain(|&x| x < bound);
    ends.push(bound);
    let mut roots = Vec::new();
    let mut low = 0.0;
    for high in ends {
        if let Some(root) = bisect(coefficients, low, high) {
            roots.push(root);
        }
        low = high;
    }
    roots
}

fn bisect(coefficients: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let sign_low = evaluate(coefficients, low) > 0.0;
    if sign_low == (evaluate(coefficients, high) > 0.0) {
        return None;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return Some(high);
        }
        if (evaluate(coefficients, middle) > 0.0) == sign_low {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_planted_roots() {
        // (1 - x)(2 - x)(3 + x) = 6 - 7x + 0x^2 + x^3
        let roots = positive_roots(&[6.0, -7.0, 0.0, 1.0]);
        assert_eq!(roots.len(), 2);
        assert!((roots[0] - 1.0).abs() < 1e-12 && (roots[1] - 2.0).abs() < 1e-12);
    }

    #[test]
    fn positive_polynomial_has_none() {
        assert_eq!(first_positive_root(&[1.0, 0.1, 0.2]), None);
        assert_eq!(first_positive_root(&[1.0]), None);
        assert_eq!(first_positive_root(&[1.0, 0.0, 0.0]), None);
    }

    #[test]
    fn far_root_is_found() {
        let root = first_positive_root(&[1.0, -1e-9]).unwrap();
        assert!((root - 1e9).abs() < 1.0);
    }
}
