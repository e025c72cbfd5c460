//! Stretch and shear of a triangle: formulas.
//!
//! Baraff-Witkin energies as finite elements [Kim 2020]. The deformation gradient
//! `F = [F_w F_f]` (3x2) maps panel coordinates to space; its columns are the images of unit
//! warp and weft. With the rest area `A` and stiffnesses in N/m
//!
//! ```text
//! psi = A [ k_warp/2 (|F_w| - 1)^2 + k_weft/2 (|F_f| - 1)^2 + k_shear/2 (F_w . F_f)^2 ]
//! ```
//!
//! Compression is resisted as stretch is; cloth escapes it by buckling.
//!
//! # Eigensystem
//! The Hessian of a stretch term in its column has the eigenvalue 1 along `n = F_w / |F_w|`
//! and `1 - 1/|F_w|` across, negative in compression. That of the shear term in
//! `(F_w, F_f)` is `g g^T + I6 X` with `I6 = F_w . F_f`, `g = (F_f, F_w)` and `X` the
//! exchange of the columns. Its eigenvalues are `(I2 +- sqrt(I2^2 + 12 I6^2)) / 2` with
//! eigenvectors `I6 X g + lambda g` (`I2 = |F|^2`), and twice each `I6` and `-I6`, on the
//! part of the eigenspaces `(v, v)` and `(v, -v)` of `X` that is orthogonal to `g`. Negative
//! ones are dropped; what is left is positive semi-definite and exact wherever no
//! eigenvalue was negative.
//!
//! # Differences from a reference
//! In `f32`, `|F_w| - 1` taken from `F_w` would be wrong by 1e-7, a force of about a
//! hundredth of a node's weight. So `|F_w|^2 - 1` and `I6` at the reference come from `f64`,
//! and their changes are formed from the change `D` of `F`:
//! `|F|^2 - |F_r|^2 = D . (2 F_r + D)`.

use nalgebra::{Matrix3, RealField, Vector3};

/// Columns count as this long at least where their curvature across grows without bound.
const SHORTEST: f64 = 0.1;

/// Constants of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct StretchRest<T> {
    /// Gradients of the shape functions of corners 1 and 2 along warp and weft [1/m]; corner
    /// 0 has minus their sum. `F_w = e1 shape[0][0] + e2 shape[1][0]`.
    pub shape: [[T; 2]; 2],
    /// Area times stiffness along the warp, along the weft, in shear [N m].
    pub stiffness: [T; 3],
}

/// A triangle at the reference.
#[derive(Clone, Copy, Debug)]
pub struct StretchReference<T> {
    /// Columns of `F`: images of unit warp and weft.
    pub columns: [Vector3<T>; 2],
    /// `|F_w|^2 - 1`, `|F_f|^2 - 1`, `F_w . F_f`.
    pub invariants: [T; 3],
}

/// A triangle's stretch.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<T: RealField> {
    /// Columns of `F`.
    pub columns: [Vector3<T>; 2],
    /// `|F_w| - 1`, `|F_f| - 1`, `F_w . F_f`.
    pub strain: [T; 3],
    /// Their change from the reference.
    pub change: [T; 3],
}

/// Second derivatives in `(F_w, F_f)`: the blocks `ww`, `wf`, `ff`.
pub type StretchHessian<T> = [Matrix3<T>; 3];

/// A row of shape gradients for each corner.
pub fn shapes<T: RealField + Copy>(rest: &StretchRest<T>) -> [[T; 2]; 3] {
    let [a, b] = rest.shape;
    [[-(a[0] + b[0]), -(a[1] + b[1])], a, b]
}

/// The columns of `F`, or of its change, from the edge vectors at corner 0.
pub fn columns<T: RealField + Copy>(rest: &StretchRest<T>, edges: [Vector3<T>; 2]) -> [Vector3<T>; 2] {
    [0, 1].map(|k| edges[0] * rest.shape[0][k] + edges[1] * rest.shape[1][k])
}

/// The reference that has the columns `F`.
pub fn reference<T: RealField + Copy>(columns: [Vector3<T>; 2]) -> StretchReference<T> {
    let [w, f] = columns;
    let invariants = [w.norm_squared() - T::one(), f.norm_squared() - T::one(), w.dot(&f)];
    StretchReference { columns, invariants }
}

/// The stretch where `F` is `change` away from the reference.
pub fn stretch<T: RealField + Copy>(reference: &StretchReference<T>, change: [Vector3<T>; 2]) -> Stretch<T> {
    let [w, f] = reference.columns;
    let [dw, df] = change;
    let (zero, one) = (T::zero(), T::one());
    let mut strain = [zero; 3];
    let mut delta = [zero; 3];
    for k in 0..2 {
        let (column, d) = (reference.columns[k], change[k]);
        let grown = d.dot(&(column + column + d));
        let now = reference.invariants[k] + grown;
        let length = (one + now).max(zero).sqrt();
        let before = (one + reference.invariants[k]).max(zero).sqrt();
        strain[k] = now / (one + length);
        let sum = length + before;
        delta[k] = if sum > zero { grown / sum } else { zero };
    }
    delta[2] = w.dot(&df) + dw.dot(&f) + dw.dot(&df);
    strain[2] = reference.invariants[2] + delta[2];
    Stretch { columns: [w + dw, f + df], strain, change: delta }
}

/// The energy [J].
pub fn energy<T: RealField + Copy>(rest: &StretchRest<T>, s: &Stretch<T>) -> T {
    let half: T = nalgebra::convert(0.5);
    let k = &rest.stiffness;
    half * (k[0] * s.strain[0] * s.strain[0]
        + k[1] * s.strain[1] * s.strain[1]
        + k[2] * s.strain[2] * s.strain[2])
}

/// The energy less that of the reference [J], without cancellation.
pub fn energy_change<T: RealField + Copy>(rest: &StretchRest<T>, s: &Stretch<T>) -> T {
    let half: T = nalgebra::convert(0.5);
    let term = |i: usize| rest.stiffness[i] * s.change[i] * (s.strain[i] - half * s.change[i]);
    term(0) + term(1) + term(2)
}

/// A column over its length; 0 where it has none.
fn direction<T: RealField + Copy>(column: &Vector3<T>) -> (Vector3<T>, T) {
    let length = column.norm();
    if length > T::zero() { (column / length, length) } else { (Vector3::zeros(), T::zero()) }
}

/// The derivatives of the energy in `F_w` and `F_f` [N m].
pub fn gradient<T: RealField + Copy>(rest: &StretchRest<T>, s: &Stretch<T>) -> [Vector3<T>; 2] {
    let shear = rest.stiffness[2] * s.strain[2];
    [0, 1].map(|k| {
        let (n, _) = direction(&s.columns[k]);
        n * (rest.stiffness[k] * s.strain[k]) + s.columns[1 - k] * shear
    })
}

/// The second derivatives of the energy in `(F_w, F_f)`, negative eigenvalues dropped [N m].
pub fn hessian<T: RealField + Copy>(rest: &StretchRest<T>, s: &Stretch<T>) -> StretchHessian<T> {
    let (zero, one) = (T::zero(), T::one());
    let half: T = nalgebra::convert(0.5);
    let [mut ww, mut ff] = [0, 1].map(|k| {
        let (n, length) = direction(&s.columns[k]);
        let across = if length > one { one - one / length } else { zero };
        let along = n * n.transpose() * (one - across);
        (along + Matrix3::identity() * across) * rest.stiffness[k]
    });
    let [w, f] = s.columns;
    let i2 = w.norm_squared() + f.norm_squared();
    if i2 <= zero {
        return [ww, Matrix3::zeros(), ff];
    }
    let i6 = s.strain[2];
    let largest = half * (i2 + (i2 * i2 + nalgebra::convert::<f64, T>(12.0) * i6 * i6).sqrt());
    let (qw, qf) = (w * i6 + f * largest, f * i6 + w * largest);
    let scale = rest.stiffness[2] * largest / (qw.norm_squared() + qf.norm_squared());
    let side = if i6 >= zero { w + f } else { w - f };
    let (v, _) = direction(&side);
    let twice = (Matrix3::identity() - v * v.transpose()) * (half * i6 * rest.stiffness[2]);
    let sign = if i6 >= zero { one } else { -one };
    ww += qw * qw.transpose() * scale + twice * sign;
    ff += qf * qf.transpose() * scale + twice * sign;
    [ww, qw * qf.transpose() * scale + twice, ff]
}

/// What [`hessian`] drops: the second derivatives less it, negative semi-definite [N m].
pub fn dropped<T: RealField + Copy>(rest: &StretchRest<T>, s: &Stretch<T>) -> StretchHessian<T> {
    let one = T::one();
    let shortest: T = nalgebra::convert(SHORTEST);
    let [ww, ff] = [0, 1].map(|k| {
        let (n, length) = direction(&s.columns[k]);
        let across = (one - one / length.max(shortest)).min(T::zero());
        (Matrix3::identity() - n * n.transpose()) * (across * rest.stiffness[k])
    });
    let ([w, f], k) = (s.columns, rest.stiffness[2]);
    let shear = StretchRest { stiffness: [T::zero(), T::zero(), k], ..*rest };
    let [kept_ww, kept_wf, kept_ff] = hessian(&shear, s);
    let exchange = Matrix3::identity() * s.strain[2];
    [
        ww + f * f.transpose() * k - kept_ww,
        (f * w.transpose() + exchange) * k - kept_wf,
        ff + w * w.transpose() * k - kept_ff,
    ]
}
