//! Symmetric positive definite systems of poses, most pairs of which have nothing to do with each other.
//!
//! A Cholesky factorisation `P H P^T = L L^T` within the envelope of the lower triangle, after the poses were put in
//! an order that keeps the envelope small (Cuthill, McKee, "Reducing the bandwidth of sparse symmetric matrices",
//! 1969; George, Liu, "Computer solution of large sparse positive definite systems", 1981).

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::collections::BTreeMap;

/// A symmetric matrix of 3 x 3 blocks, those that are not zero.
#[derive(Debug, Clone)]
pub struct Blocks {
    /// Number of poses.
    pub n: usize,
    /// By (p, q). Of those above the diagonal the factorisation takes no notice.
    pub at: BTreeMap<(usize, usize), Matrix3<f64>>,
}

impl Blocks {
    /// All zero but for the diagonal, which is there.
    pub fn zeros(n: usize) -> Self {
        Self { n, at: (0..n).map(|k| ((k, k), Matrix3::zeros())).collect() }
    }

    /// Adds to the block (p, q).
    pub fn add(&mut self, p: usize, q: usize, block: &Matrix3<f64>) {
        *self.at.entry((p, q)).or_insert_with(Matrix3::zeros) += block;
    }

    /// All of it.
    pub fn to_dense(&self) -> DMatrix<f64> {
        let mut dense = DMatrix::zeros(3 * self.n, 3 * self.n);
        for ((p, q), block) in &self.at {
            dense.fixed_view_mut::<3, 3>(3 * p, 3 * q).copy_from(block);
        }
        dense
    }

    /// `X^T B X` of this matrix B and a column X of blocks.
    pub fn between(&self, x: &[Matrix3<f64>]) -> Matrix3<f64> {
        self.at.iter().map(|((p, q), block)| x[*p].transpose() * block * x[*q]).sum()
    }

    /// A diagonal block.
    pub fn diagonal(&mut self, k: usize) -> &mut Matrix3<f64> {
        self.at.get_mut(&(k, k)).expect("always there")
    }

    /// Every off-diagonal block of some poses becomes zero, the diagonal ones as given.
    pub fn set_apart(&mut self, poses: &[usize], diagonal: &Matrix3<f64>) {
        self.at.retain(|(p, q), _| p == q || !(poses.contains(p) || poses.contains(q)));
        poses.iter().for_each(|k| *self.diagonal(*k) = *diagonal);
    }

    /// Poses that each pose has a block with.
    fn neighbours(&self) -> Vec<Vec<usize>> {
        let mut found = vec![Vec::new(); self.n];
        for (p, q) in self.at.keys().filter(|(p, q)| p > q) {
            found[*p].push(*q);
            found[*q].push(*p);
        }
        found
    }
}

/// Poses in reverse Cuthill-McKee order: breadth first from the rim, the least connected first, backwards.
fn order(blocks: &Blocks) -> Vec<usize> {
    let neighbours = blocks.neighbours();
    let breadth_first = |start: usize, seen: &mut Vec<bool>| {
        let mut found = vec![start];
        seen[start] = true;
        let mut head = 0;
        while head < found.len() {
            let mut next: Vec<usize> =
                neighbours[found[head]].iter().copied().filter(|k| !seen[*k]).collect();
            next.sort_by_key(|k| (neighbours[*k].len(), *k));
            next.iter().for_each(|k| seen[*k] = true);
            found.extend(next);
            head += 1;
        }
        found
    };
    let mut out = Vec::with_capacity(blocks.n);
    let mut seen = vec![false; blocks.n];
    for k in 0..blocks.n {
        if !seen[k] {
            // What is reached last from anywhere lies on the rim.
            let reached = breadth_first(k, &mut seen.clone());
            let rim = reached.last().copied().unwrap_or(k);
            out.extend(breadth_first(rim, &mut seen));
        }
    }
    out.reverse();
    out
}

/// The factor L of a matrix, by rows, each from its first entry to the diagonal.
pub struct Factor {
    /// Place of each pose in the factor's order.
    place: Vec<usize>,
    rows: Vec<(usize, Vec<f64>)>,
}

impl Factor {
    /// None when the matrix is not positive definite.
    pub fn of(blocks: &Blocks) -> Option<Self> {
        let mut place = vec![0; blocks.n];
        order(blocks).into_iter().enumerate().for_each(|(at, pose)| place[pose] = at);
        let mut first: Vec<usize> = (0..blocks.n).collect();
        for (p, q) in blocks.at.keys().filter(|(p, q)| p > q) {
            let (low, high) = (place[*p].min(place[*q]), place[*p].max(place[*q]));
            first[high] = first[high].min(low);
        }
        let mut rows: Vec<(usize, Vec<f64>)> = (0..3 * blocks.n)
            .map(|r| (3 * first[r / 3], vec![0.0; r - 3 * first[r / 3] + 1]))
            .collect();
        for ((p, q), block) in blocks.at.iter().filter(|((p, q), _)| p >= q) {
            for (a, b) in (0..9).map(|k| (k / 3, k % 3)) {
                let (i, j) = (3 * place[*p] + a, 3 * place[*q] + b);
                let (row, col) = (i.max(j), i.min(j));
                let begin = rows[row].0;
                rows[row].1[col - begin] = block[(a, b)];
            }
        }
        for r in 0..rows.len() {
            let (done, rest) = rows.split_at_mut(r);
            let (begin, row) = &mut rest[0];
            for c in *begin..r {
                let (other, of_other) = &done[c];
                let from = (*begin).max(*other);
                let sum = dot(&row[from - *begin..c - *begin], &of_other[from - other..c - other]);
                row[c - *begin] = (row[c - *begin] - sum) / of_other[c - other];
            }
            let last = r - *begin;
            let pivot = row[last] - dot(&row[..last], &row[..last]);
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            row[last] = pivot.sqrt();
        }
        Some(Self { place, rows })
    }

    /// The solution of `H x = b`.
    pub fn solve(&self, b: &DVector<f64>) -> DVector<f64> {
        let at = |k: usize| 3 * self.place[k / 3] + k % 3;
        let mut x = vec![0.0; b.len()];
        b.iter().enumerate().for_each(|(k, v)| x[at(k)] = *v);
        self.solve_in_place(&mut x, 0);
        DVector::from_iterator(b.len(), (0..b.len()).map(|k| x[at(k)]))
    }

    /// The three columns of the inverse that belong to a pose: for each pose, its rows of them.
    pub fn columns(&self, pose: usize) -> Vec<Matrix3<f64>> {
        let n = self.place.len();
        let mut out = vec![Matrix3::zeros(); n];
        for axis in 0..3 {
            let mut x = vec![0.0; 3 * n];
            let first = 3 * self.place[pose];
            x[first + axis] = 1.0;
            self.solve_in_place(&mut x, first);
            for (block, at) in out.iter_mut().zip(&self.place) {
                let part = Vector3::new(x[3 * at], x[3 * at + 1], x[3 * at + 2]);
                block.set_column(axis, &part);
            }
        }
        out
    }

    /// Forward and backward substitution; `x` is zero before `first`.
    fn solve_in_place(&self, x: &mut [f64], first: usize) {
        for r in first..x.len() {
            let (begin, row) = &self.rows[r];
            let last = r - begin;
            let from = (*begin).max(first).min(r);
            let sum = dot(&row[from - begin..last], &x[from..r]);
            x[r] = (x[r] - sum) / row[last];
        }
        for r in (0..x.len()).rev() {
            let (begin, row) = &self.rows[r];
            let last = r - begin;
            x[r] /= row[last];
            let v = x[r];
            x[*begin..r].iter_mut().zip(&row[..last]).for_each(|(x, l)| *x -= l * v);
        }
    }
}

/// The sum of products, in four sums that the processor adds side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    sums[0] + sums[1] + sums[2] + sums[3] + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix6;
    use rand::{Rng, SeedableRng};

    /// A random positive definite matrix of poses in a grid of streets, sparse and dense.
    fn example(n: usize) -> (Blocks, DMatrix<f64>) {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let (mut sparse, mut dense) = (Blocks::zeros(n), DMatrix::<f64>::identity(3 * n, 3 * n));
        (0..n).for_each(|k| *sparse.diagonal(k) += Matrix3::identity());
        for p in 0..n {
            for q in (0..p).filter(|q| p - q == 1 || p - q == 7) {
                let m = Matrix6::from_fn(|_, _| rng.random_range(-1.0..1.0));
                let m = m * m.transpose();
                for (a, x) in [(p, 0), (q, 3)] {
                    for (b, y) in [(p, 0), (q, 3)] {
                        let block = m.fixed_view::<3, 3>(x, y).into_owned();
                        let mut part = dense.fixed_view_mut::<3, 3>(3 * a, 3 * b);
                        part += block;
                        sparse.add(a, b, &block);
                    }
                }
            }
        }
        (sparse, dense)
    }

    #[test]
    fn solves_and_inverts_as_a_dense_factorisation_does() {
        let (sparse, dense) = example(40);
        let factor = Factor::of(&sparse).unwrap();
        let b = DVector::from_fn(120, |k, _| (k as f64).sin());
        let cholesky = dense.clone().cholesky().unwrap();
        assert!((factor.solve(&b) - cholesky.solve(&b)).amax() < 1e-9);
        let inverse = cholesky.inverse();
        for pose in [0, 17, 39] {
            for (k, block) in factor.columns(pose).iter().enumerate() {
                let expected = inverse.fixed_view::<3, 3>(3 * k, 3 * pose);
                assert!((block - expected).amax() < 1e-9, "{pose} {k}");
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let (mut sparse, _) = example(5);
        *sparse.diagonal(3) = -Matrix3::identity();
        assert!(Factor::of(&sparse).is_none());
    }
}
