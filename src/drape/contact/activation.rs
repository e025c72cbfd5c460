//! Contact potentials over a gap, and the smoothed friction potential.
//!
//! *Barrier*, for pairs that are on their right sides (two-stage activation of Offset
//! Geometric Contact [Chen et al. 2025]; C2 with `tau = r/2`):
//! ```text
//! e(d) = k/2 (r - d)^2                          tau <= d <= r
//!        k (r - tau)^2 / 2 + k tau^2 ln(tau/d)  floor <= d < tau
//! ```
//! It grows without bound towards contact. Below `floor` we go on with its second-order
//! expansion, so that a start that is almost in contact gives finite numbers.
//!
//! *Spring*, for pairs that start on the wrong side: `k/2 (r - d)^2` for signed `d < r`,
//! linear beyond `d < -2 r`, so that deep starts do not overwhelm the cloth.
//!
//! *Friction* [Li et al. 2020, IPC]: `mu lambda f0(|u_T|)` with the lagged normal force
//! `lambda`, and `f0' = f1(y) = 2y/s - (y/s)^2` up to the sticking distance `s`.

/// Share of the radius below which the barrier is extrapolated.
const FLOOR: f64 = 0.01;
/// Depth, in radii, from which the spring's force is constant.
const DEEPEST: f64 = 2.0;

/// Energy, first and second derivative.
pub type Jet = (f64, f64, f64);

/// The barrier at gap `d` [m], radius `r` [m], stiffness `k` [N/m].
pub fn barrier(d: f64, r: f64, k: f64) -> Jet {
    let tau = 0.5 * r;
    if d >= r {
        return (0.0, 0.0, 0.0);
    }
    if d >= tau {
        return (0.5 * k * (r - d) * (r - d), -k * (r - d), k);
    }
    let log = |d: f64| {
        let scale = k * tau * tau;
        (0.5 * scale + scale * (tau / d).ln(), -scale / d, scale / (d * d))
    };
    let floor = FLOOR * r;
    if d >= floor {
        return log(d);
    }
    let (e, g, h) = log(floor);
    let x = d - floor;
    (e + g * x + 0.5 * h * x * x, g + h * x, h)
}

/// The spring at signed gap `d` [m], radius `r` [m], stiffness `k` [N/m].
pub fn spring(d: f64, r: f64, k: f64) -> Jet {
    if d >= r {
        return (0.0, 0.0, 0.0);
    }
    let reach = (1.0 + DEEPEST) * r;
    let x = r - d;
    if x <= reach {
        return (0.5 * k * x * x, -k * x, k);
    }
    // Constant force; a curvature that keeps the Newton step at the length of the depth.
    (k * reach * (x - 0.5 * reach), -k * reach, k * reach / x)
}

/// `f0(y)`, `f1(y)/y` and `f1'(y)` for the slip `y >= 0` [m] and sticking distance `s` [m].
pub fn friction(y: f64, s: f64) -> Jet {
    if y >= s {
        return (y, 1.0 / y, 0.0);
    }
    let q = y / s;
    (s * (1.0 / 3.0 + q * q - q * q * q / 3.0), (2.0 - q) / s, (2.0 - 2.0 * q) / s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_differences_across_every_joint() {
        let (r, k) = (2e-3, 700.0);
        for f in [barrier, spring] {
            for i in -500..250 {
                let d = f64::from(i) * 1e-5 + 3.3e-6;
                let h = 1e-9;
                let (up, down, mid) = (f(d + h, r, k), f(d - h, r, k), f(d, r, k));
                let scale = mid.1.abs().max(k * r);
                assert!(((up.0 - down.0) / (2.0 * h) - mid.1).abs() < 1e-5 * scale, "{d}");
            }
        }
        for i in 1..300 {
            let (y, s, h) = (f64::from(i) * 1e-7, 1e-5, 1e-11);
            let (up, down, mid) = (friction(y + h, s), friction(y - h, s), friction(y, s));
            assert!(((up.0 - down.0) / (2.0 * h) - mid.1 * y).abs() < 1e-4);
            let force = |j: Jet, y: f64| j.1 * y;
            assert!(((force(up, y + h) - force(down, y - h)) / (2.0 * h) - mid.2).abs() * s < 1e-4);
        }
    }
}
