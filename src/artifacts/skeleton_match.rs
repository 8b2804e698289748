use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder};
use crate::kernels::matching::skeleton_match::{MatchedBranch, SkeletonMatch};

impl Artifact for SkeletonMatch {
    const TYPE: ArtifactType = ArtifactType {
        name: "skeleton_match",
        version: 1,
        doc: "Which joints of two skeletons belong together: `nodes` (M x 2, source and target), the \
              joints along matched branches (`source_nodes`, `target_nodes`, those of branch b from \
              `source_starts[b]` to `source_starts[b + 1]`), `ratings` (2), `counts` (joints of both).",
    };

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("nodes", &[self.nodes().len(), 2], self.nodes().as_flattened());
        let source = self.branches().iter().map(|it| &it.source[..]);
        put_lists(to, ["source_starts", "source_nodes"], source);
        let target = self.branches().iter().map(|it| &it.target[..]);
        put_lists(to, ["target_starts", "target_nodes"], target);
        to.owned("ratings", &[2], self.ratings().to_vec());
        to.owned("counts", &[2], vec![self.n_source() as u64, self.n_target() as u64]);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (_, 2, nodes) = from.matrix::<u32>("nodes")? else {
            return Err(DecodeError::new("`nodes` has no two columns"));
        };
        let counts = from.vector::<u64>("counts")?;
        let ratings = from.vector::<f64>("ratings")?;
        let (&[n_source, n_target], &[first, second]) = (&counts[..], &ratings[..]) else {
            return Err(DecodeError::new("`counts` and `ratings` are two numbers each"));
        };
        let count = |it: u64| usize::try_from(it).unwrap_or(0);
        let source = lists(from, ["source_starts", "source_nodes"])?;
        let target = lists(from, ["target_starts", "target_nodes"])?;
        if source.len() != target.len() {
            let (source, target) = (source.len(), target.len());
            return Err(DecodeError(format!(
                "{source} branches of the source, {target} of the target"
            )));
        }
        let branches = source.into_iter().zip(target);
        let branches = branches.map(|(source, target)| MatchedBranch { source, target }).collect();
        let nodes = nodes.chunks_exact(2).map(|it| [it[0], it[1]]).collect();
        Self::new([count(n_source), count(n_target)], nodes, branches, [first, second])
            .map_err(|error| DecodeError(error.to_string()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        let [first, second] = self.ratings();
        vec![
            ("source joints".to_owned(), self.n_source().to_string()),
            ("target joints".to_owned(), self.n_target().to_string()),
            ("matched ends".to_owned(), self.nodes().len().to_string()),
            ("matched branches".to_owned(), self.branches().len().to_string()),
            ("ratings".to_owned(), format!("{first:.6} (branches), {second:.6} (places)")),
        ]
    }
}

/// Writes lists as their starts and all their items.
fn put_lists<'a>(
    to: &mut Encoder<'_>,
    [starts, items]: [&'static str; 2],
    lists: impl Iterator<Item = &'a [u32]>,
) {
    let (mut all, mut ends): (Vec<u32>, Vec<u64>) = (Vec::new(), vec![0]);
    for list in lists {
        all.extend(list);
        ends.push(all.len() as u64);
    }
    to.owned(starts, &[ends.len()], ends);
    to.owned(items, &[all.len()], all);
}

fn lists(from: &Decoder<'_>, [starts, items]: [&str; 2]) -> Result<Vec<Vec<u32>>, DecodeError> {
    let ends = from.vector::<u64>(starts)?;
    let all = from.vector::<u32>(items)?;
    let is_whole = ends.first() == Some(&0) && ends.last() == Some(&(all.len() as u64));
    if !is_whole || ends.windows(2).any(|it| it[0] > it[1]) {
        return Err(DecodeError(format!("`{starts}` does not part `{items}`")));
    }
    let list = |it: &[u64]| all[it[0] as usize..it[1] as usize].to_vec();
    Ok(ends.windows(2).map(list).collect())
}
