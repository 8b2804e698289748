//! Taking down what the search has found.

use super::search::{Decision, Found, Goal, MatchedWay, Search, State};
use super::second_rating;

impl Search<'_> {
    /// Takes down a match. Returns false if there are enough.
    pub(super) fn record(&mut self, state: &State) -> bool {
        let first_rating = state.cost.max(0.0);
        if let Goal::Least { least } = &mut self.goal {
            *least = least.min(first_rating);
            return true;
        }
        let ways = self.matched_ways();
        let second = second_rating([self.small, self.large], &self.image, &ways, self.options);
        let found = Found { image: self.image.clone(), ways, first_rating, second_rating: second };
        let order = |it: &Found| {
            let ratings = (it.second_rating, it.first_rating);
            let by_rating = ratings.0.total_cmp(&found.second_rating);
            let by_rating = by_rating.then(ratings.1.total_cmp(&found.first_rating));
            by_rating.then_with(|| it.image.cmp(&found.image))
        };
        let Goal::All { best, n_found, .. } = &self.goal else { return true };
        let is_last = n_found + 1 >= self.options.max_matches;
        let place = best.partition_point(|it| order(it).is_lt());
        let Goal::All { best, n_found, .. } = &mut self.goal else { return true };
        *n_found += 1;
        if place < self.options.n_kept {
            best.insert(place, found);
            best.truncate(self.options.n_kept);
        }
        !is_last
    }

    /// The branches of the present match.
    fn matched_ways(&self) -> Vec<MatchedWay> {
        let mut ways = Vec::new();
        for &node in &self.plan.order {
            if self.decisions[node as usize] != Decision::Mapped {
                continue;
            }
            if let Some((anchor, own)) = self.anchor(node).filter(|it| !it.1.is_empty()) {
                let theirs = self.ways[node as usize].branches().to_vec();
                if !theirs.is_empty() {
                    let from = [anchor, self.image[anchor as usize]];
                    ways.push(MatchedWay { from, branches: [own, theirs] });
                }
            }
        }
        let closing = self
            .closing
            .iter()
            .map(|&(from, [own, theirs])| MatchedWay { from, branches: [vec![own], vec![theirs]] });
        ways.extend(closing);
        ways
    }
}
