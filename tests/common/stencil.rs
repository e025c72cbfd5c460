//! A system to solve: springs between the neighbours of a grid, 27 blocks in a row.

/// A symmetric positive definite matrix of 3x3 blocks, and the inverse of its diagonal.
pub struct Stencil {
    pub row_start: Vec<u32>,
    pub columns: Vec<u32>,
    pub blocks: Vec<[f32; 9]>,
    pub inverse: Vec<[f32; 9]>,
}

impl Stencil {
    pub fn rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// `A x` in f64.
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        self.gather(x, |a| a)
    }

    /// `|A| |x|`, the size of the terms that `A x` sums.
    pub fn sizes(&self, x: &[f64]) -> Vec<f64> {
        self.gather(&x.iter().map(|v| v.abs()).collect::<Vec<_>>(), f64::abs)
    }

    fn gather(&self, x: &[f64], entry: fn(f64) -> f64) -> Vec<f64> {
        let mut y = vec![0.0; 3 * self.rows()];
        for row in 0..self.rows() {
            for k in self.row_start[row] as usize..self.row_start[row + 1] as usize {
                apply(&self.blocks[k], entry, &x[3 * self.columns[k] as usize..], &mut y[3 * row..]);
            }
        }
        y
    }

    /// `sqrt(r . M^-1 r)` in f64, the norm in which conjugate gradients stop.
    pub fn norm(&self, r: &[f64]) -> f64 {
        let mut z = vec![0.0; r.len()];
        for row in 0..self.rows() {
            apply(&self.inverse[row], |a| a, &r[3 * row..], &mut z[3 * row..]);
        }
        r.iter().zip(&z).map(|(r, z)| r * z).sum::<f64>().sqrt()
    }
}

fn apply(block: &[f32; 9], entry: fn(f64) -> f64, x: &[f64], y: &mut [f64]) {
    for i in 0..3 {
        y[i] += (0..3).map(|j| entry(f64::from(block[3 * i + j])) * x[j]).sum::<f64>();
    }
}

/// `side`^3 nodes, each tied to its 26 neighbours by `w (0.1 I + d d^T)` along the unit
/// direction `d`, and to the ground by 0.01.
pub fn springs(side: usize) -> Stencil {
    let mut s = Stencil { row_start: vec![0], columns: vec![], blocks: vec![], inverse: vec![] };
    let index = |[x, y, z]: [i64; 3]| ((z * side as i64 + y) * side as i64 + x) as u32;
    let inside = |p: [i64; 3]| p.iter().all(|&c| (0..side as i64).contains(&c));
    for node in 0..side.pow(3) as i64 {
        let at = [node % side as i64, node / side as i64 % side as i64, node / (side * side) as i64];
        let mut diagonal = [0.0; 9];
        (0..3).for_each(|i| diagonal[4 * i] = 0.01);
        let first = s.blocks.len();
        let mut own = first;
        for step in 0..27i64 {
            let d = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
            let to = [at[0] + d[0], at[1] + d[1], at[2] + d[2]];
            if !inside(to) {
                continue;
            }
            s.columns.push(index(to));
            s.blocks.push([0.0; 9]);
            if d == [0; 3] {
                own = s.blocks.len() - 1;
                continue;
            }
            let block = spring(d);
            for e in 0..9 {
                diagonal[e] += block[e];
                s.blocks.last_mut().expect("pushed")[e] = -block[e] as f32;
            }
        }
        s.blocks[own] = diagonal.map(|e| e as f32);
        let inverse = nalgebra::Matrix3::from_row_slice(&diagonal).try_inverse().expect("positive definite");
        s.inverse.push(std::array::from_fn(|e| inverse[(e / 3, e % 3)] as f32));
        s.row_start.push(s.columns.len() as u32);
    }
    s
}

fn spring(d: [i64; 3]) -> [f64; 9] {
    let square = d.iter().map(|c| c * c).sum::<i64>() as f64;
    std::array::from_fn(|e| {
        let identity = if e / 3 == e % 3 { 0.1 } else { 0.0 };
        (identity + (d[e / 3] * d[e % 3]) as f64 / square) / square
    })
}
