//! Nodes that wait for each other.

use super::{
    check::Wires,
    diagnostic::{Diagnostic, Problems},
    expand::Draft,
};

#[derive(Clone, Copy, PartialEq)]
enum State {
    New,
    /// On the path that is being followed.
    Open,
    Done,
}

/// All drafts, producers before their readers; or `None`, with every cycle reported that a walk against
/// the wires closes, each with its whole path.
pub fn order(drafts: &[Draft], wires: &[Wires], problems: &mut Problems) -> Option<Vec<usize>> {
    let mut states = vec![State::New; drafts.len()];
    let mut order = Vec::with_capacity(drafts.len());
    let n_problems = problems.len();
    for start in 0..drafts.len() {
        walk(start, wires, &mut states, &mut order, &mut |cycle| {
            problems.push(describe(cycle, drafts));
        });
    }
    (problems.len() == n_problems).then_some(order)
}

/// Follows wires from `start` to their sources. Keeps its own stack, as chains can be long.
fn walk(
    start: usize,
    wires: &[Wires],
    states: &mut [State],
    done: &mut Vec<usize>,
    on_cycle: &mut dyn FnMut(&[usize]),
) {
    if states[start] != State::New {
        return;
    }
    states[start] = State::Open;
    let mut path = vec![(start, sources(&wires[start]))];
    while let Some((node, open)) = path.last_mut() {
        let Some(source) = open.pop() else {
            states[*node] = State::Done;
            done.push(*node);
            path.pop();
            continue;
        };
        match states[source] {
            State::Done => {}
            State::New => {
                states[source] = State::Open;
                path.push((source, sources(&wires[source])));
            }
            State::Open => {
                let first = path.iter().position(|it| it.0 == source).expect("it is on the path");
                let cycle: Vec<usize> = path[first..].iter().map(|it| it.0).collect();
                on_cycle(&cycle);
            }
        }
    }
}

/// What a node reads, last wire first, so that the first is popped first.
fn sources(wires: &Wires) -> Vec<usize> {
    let mut res: Vec<usize> = wires.values().flatten().map(|it| it.draft).collect();
    res.reverse();
    res.dedup();
    res
}

/// `cycle` leads from readers to their sources.
fn describe(cycle: &[usize], drafts: &[Draft]) -> Diagnostic {
    let first = &drafts[cycle[0]];
    let names: Vec<String> =
        cycle.iter().chain([&cycle[0]]).rev().map(|&it| format!("`{}`", drafts[it].name)).collect();
    let message = format!("nodes wait for each other: {}", names.join(" → "));
    let mut res = Diagnostic::error(&first.place, message);
    for pair in cycle.windows(2) {
        let (reader, source) = (&drafts[pair[0]], &drafts[pair[1]]);
        res = res.related(Some(&source.place), format!("`{}` reads it", reader.name));
    }
    res
}
