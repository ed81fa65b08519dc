//! Where a cubic changes sign.

/// Coefficients, constant first.
pub type Cubic = [f64; 4];

pub fn value(c: &Cubic, s: f64) -> f64 {
    ((c[3] * s + c[2]) * s + c[1]) * s + c[0]
}

/// The places in 0..=1, rising, where `c` changes between negative and not. Which it is at the ends is given: there may
/// be rounding in what decided it, and the number of places must fit it.
pub fn roots(c: &Cubic, ends: [bool; 2]) -> impl Iterator<Item = f64> + use<> {
    let [low, high] = extremes(c);
    let breaks = [0.0, low, high, 1.0];
    let solid = [ends[0], value(c, low) >= 0.0, value(c, high) >= 0.0, ends[1]];
    let c = *c;
    let inner = |s: f64| s > 0.0 && s < 1.0;
    // An extreme that isn't within says what the end before it says.
    let mut from = (0.0, ends[0]);
    let mut found = [None; 3];
    for k in 1..4 {
        if k < 3 && !inner(breaks[k]) {
            continue;
        }
        if solid[k] != from.1 {
            found[k - 1] = Some(bisect(&c, from.0, breaks[k], from.1));
        }
        from = (breaks[k], solid[k]);
    }
    found.into_iter().flatten()
}

/// Where the derivative vanishes, the smaller first; 0 where it doesn't.
fn extremes(c: &Cubic) -> [f64; 2] {
    let (q, h, l) = (3.0 * c[3], c[2], c[1]);
    // q s^2 + 2 h s + l
    let d = h * h - q * l;
    if d < 0.0 {
        return [0.0; 2];
    }
    let sum = if h < 0.0 { h - d.sqrt() } else { h + d.sqrt() };
    if sum == 0.0 {
        return [0.0; 2];
    }
    let [a, b] = [if q == 0.0 { 0.0 } else { -sum / q }, -l / sum];
    if a < b { [a, b] } else { [b, a] }
}

fn bisect(c: &Cubic, mut low: f64, mut high: f64, solid: bool) -> f64 {
    // 2^-40 of a cell's side is far below a step.
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if (value(c, middle) >= 0.0) == solid { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_of_known_roots() {
        for known in [[0.1, 0.5, 0.9], [0.2, 0.25, 7.0], [-3.0, 0.7, 2.0], [-1.0, -2.0, 5.0]] {
            let [a, b, d] = known;
            let c = [-a * b * d, a * b + a * d + b * d, -(a + b + d), 1.0];
            let ends = [value(&c, 0.0) >= 0.0, value(&c, 1.0) >= 0.0];
            let within: Vec<f64> = known.into_iter().filter(|r| (0.0..=1.0).contains(r)).collect();
            let found: Vec<f64> = roots(&c, ends).collect();
            assert_eq!(found.len(), within.len(), "{known:?} {found:?}");
            assert!(found.iter().zip(&within).all(|(f, k)| (f - k).abs() < 1e-9), "{known:?} {found:?}");
        }
        // a line, a parabola, a constant; ends that rounding set otherwise
        assert!((roots(&[-1.0, 4.0, 0.0, 0.0], [false, true]).next().unwrap() - 0.25).abs() < 1e-9);
        assert_eq!(roots(&[-0.21, 1.0, -1.0, 0.0], [false, false]).count(), 2);
        assert_eq!(roots(&[1.0, 0.0, 0.0, 0.0], [true, true]).count(), 0);
        assert_eq!(roots(&[1e-18, 0.0, 0.0, 0.0], [true, false]).count(), 1);
    }
}
