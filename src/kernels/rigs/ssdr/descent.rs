//! Fitting motions and weights in turn.

use super::additions::{Addition, TAKEN};
use super::smoothing::Smoothing;
use super::weights::{self, Row};
use super::{Motions, Moving, SsdrOptions};

/// Motions and weights that get better step by step.
///
/// Fitting one for the other creeps, so that every step goes further along the way that the motions
/// took since the last one (Nesterov 1983), unless the error grows by that: then it starts anew
/// (O'Donoghue & Candes 2015).
#[derive(Clone)]
pub struct Descent<'a> {
    pub moving: &'a Moving,
    pub motions: Motions,
    pub rows: Vec<Row>,
    /// The summed squared distances of every vertex over all frames.
    pub errors: Vec<f64>,
    smoothing: &'a Smoothing,
    options: &'a SsdrOptions,
    /// What was fitted in the last step, before it went further.
    fitted: Option<Motions>,
    /// Steps since the last new start.
    n_steps: usize,
}

impl<'a> Descent<'a> {
    pub fn new(
        moving: &'a Moving,
        smoothing: &'a Smoothing,
        options: &'a SsdrOptions,
        motions: Motions,
        rows: Vec<Row>,
    ) -> Self {
        let errors = vec![f64::INFINITY; moving.n_vertices()];
        Self { moving, motions, rows, errors, smoothing, options, fitted: None, n_steps: 0 }
    }

    /// The summed squared distances.
    pub fn error(&self) -> f64 {
        self.errors.iter().sum()
    }

    /// The root of the mean squared distance, in the scaled unit.
    pub fn rmse(&self) -> f64 {
        (self.error() / (self.moving.n_vertices() * self.moving.n_frames()) as f64).sqrt()
    }

    /// Fits the motions to the weights, then the weights to the motions.
    pub fn step(&mut self) {
        let mut fitted = self.motions.clone();
        fitted.improve(self.moving, &self.rows, self.options);
        let further = self.fitted.as_ref().filter(|_| self.n_steps > 0).map(|before| {
            let share = self.n_steps as f64 / (self.n_steps + 3) as f64;
            fitted.beyond(before, share)
        });
        let tried = further.map(|motions| {
            let (rows, errors) = self.weights_for(&motions);
            (motions, rows, errors)
        });
        let better = tried.filter(|it| it.2.iter().sum::<f64>() < self.error());
        self.n_steps = if better.is_some() || self.n_steps == 0 { self.n_steps + 1 } else { 0 };
        (self.motions, self.rows, self.errors) = better.unwrap_or_else(|| {
            let (rows, errors) = self.weights_for(&fitted);
            (fitted.clone(), rows, errors)
        });
        self.fitted = Some(fitted);
    }

    fn weights_for(&self, motions: &Motions) -> (Vec<Row>, Vec<f64>) {
        weights::improve(self.moving, motions, &self.rows, self.smoothing, self.options)
    }

    /// Drops bones and adds others, which take the vertices that they move for the most part.
    pub fn replace(&mut self, dropped: &[usize], added: &[Addition]) {
        let kept: Vec<usize> =
            (0..self.motions.n_bones()).filter(|it| !dropped.contains(it)).collect();
        self.motions = self.motions.with(&kept, added);
        for (vertex, row) in self.rows.iter_mut().enumerate() {
            let share = |it: usize| added[it].shares[vertex];
            let first =
                (0..added.len()).max_by(|&a, &b| share(a).total_cmp(&share(b)).then(b.cmp(&a)));
            if let Some(first) = first.filter(|&it| share(it) > TAKEN) {
                *row = vec![((kept.len() + first) as u32, 1.0)];
                continue;
            }
            row.retain_mut(|it| match kept.binary_search(&(it.0 as usize)) {
                Ok(new) => {
                    it.0 = new as u32;
                    true
                }
                Err(_) => false,
            });
            let sum: f64 = row.iter().map(|it| it.1).sum();
            row.iter_mut().for_each(|it| it.1 /= sum);
        }
        weights::fill(self.moving, &self.motions, &mut self.rows);
        (self.rows, self.errors) = self.weights_for(&self.motions);
        (self.fitted, self.n_steps) = (None, 0);
    }
}
