//! From drafts to instances: every node is held against the declaration of its kind ([`ports`],
//! [`node`]), repeated along its axes, and connected.

mod node;
mod ports;

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    path::PathBuf,
    sync::Arc,
};

use petgraph::graph::NodeIndex;

use super::{
    axes::{self, Axis, Point},
    cycles,
    diagnostic::{Diagnostic, Problems},
    expand::{Draft, Expansion},
    outputs,
    repeat::{self, Joined, Repeat},
    sources::Sources,
    value::{AxisId, Entry},
    wires::WireEnd,
};
use crate::engine::{
    graph::{self, Graph, Inputs, Instance, Place, PortRef},
    labels::InputLabels,
    library::Library,
    node::CheckedNode,
    params::Fields,
    port_map::PortMap,
};

/// By port: the wires of a draft.
pub type Wires = PortMap<Vec<WireEnd>>;

/// More instances than any machine plans: two axes that were not meant to be multiplied.
const MOST_INSTANCES: usize = 2_000_000;

/// Checks everything; the graph if all nodes are sound.
pub fn check(
    expansion: &Expansion,
    library: &Library,
    sources: &Sources,
    problems: &mut Problems,
) -> Option<Graph> {
    let mut checker = Checker { expansion, library, sources, problems, fields: HashMap::new() };
    let is_inner = |it: &usize| !expansion.scopes[*it].document.inputs.is_empty() || *it > 0;
    let inner = (0..expansion.scopes.len()).filter(is_inner);
    inner.for_each(|it| checker.check_interface(it));
    let wires: Vec<Wires> = expansion.drafts.iter().map(|it| checker.check_wires(it)).collect();
    let order = cycles::order(&expansion.drafts, &wires, checker.problems);
    // Without its items, nothing true can be said of what uses an axis.
    let has_axes = expansion.axes.iter().all(|it| !it.items.is_empty());
    let repeats = order.filter(|_| has_axes).and_then(|it| checker.repeat(&it, &wires));
    let Some(repeats) = repeats else {
        // Parameters can be checked all the same where they depend on no axis.
        checker.check_constant_drafts();
        return None;
    };
    let mut instances = Vec::with_capacity(repeats.iter().map(|it| it.repeat.count).sum());
    let mut sound = true;
    for (draft, (wires, repeat)) in expansion.drafts.iter().zip(wires.iter().zip(&repeats)) {
        sound &= checker.check_draft(draft, wires, repeat, &repeats, &mut instances);
    }
    let repeats: Vec<Repeat> = repeats.into_iter().map(|it| it.repeat).collect();
    let outputs = outputs::check(expansion, &repeats, library, problems);
    if !sound {
        return None;
    }
    let document = &expansion.scopes[0].document;
    let cites = expansion.scopes.iter().flat_map(|it| &it.document.cites);
    let mut unique_cites: Vec<String> = Vec::new();
    for cite in cites {
        if !unique_cites.contains(cite) {
            unique_cites.push(cite.clone());
        }
    }
    Some(Graph {
        title: document.title.clone(),
        cites: unique_cites,
        instances: graph::connect(instances),
        outputs,
        sources: Vec::new(),
        looks: None,
    })
}

/// How a draft is repeated, and where its wires lead.
struct Repeated {
    repeat: Repeat,
    /// Axes that are gathered, ascending.
    gathered: Vec<AxisId>,
    /// Of every wire, in the order of [`Wires`].
    joined: Vec<Joined>,
}

struct Checker<'a> {
    expansion: &'a Expansion,
    library: &'a Library,
    sources: &'a Sources,
    problems: &'a mut Problems,
    /// Parameters by kind, read from its schema once.
    fields: HashMap<&'static str, Fields>,
}

impl Checker<'_> {
    /// The axes of all drafts, `None` if one of them is wrong. `order`: producers first.
    fn repeat(&mut self, order: &[usize], wires: &[Wires]) -> Option<Vec<Repeated>> {
        let mut res: Vec<Option<Repeated>> = Vec::new();
        res.resize_with(wires.len(), || None);
        let mut sound = true;
        for &index in order {
            let repeated = self.repeat_draft(&self.expansion.drafts[index], &wires[index], &res);
            sound &= repeated.is_some();
            res[index] = repeated;
        }
        let mut res = res.into_iter().collect::<Option<Vec<Repeated>>>()?;
        let mut first = 0;
        for it in &mut res {
            it.repeat.first = first;
            first += it.repeat.count;
        }
        if first > MOST_INSTANCES {
            let n_nodes = self.expansion.drafts.len();
            let message = format!("axes multiply {n_nodes} nodes to {first} instances");
            let hint = format!("at most {MOST_INSTANCES} can be planned");
            self.problems.push(Diagnostic::without_place(message).hint(hint));
            return None;
        }
        sound.then_some(res)
    }

    fn repeat_draft(
        &mut self,
        draft: &Draft,
        wires: &Wires,
        done: &[Option<Repeated>],
    ) -> Option<Repeated> {
        let axes = &self.expansion.axes;
        let mut joined = Vec::with_capacity(wires.values().map(Vec::len).sum());
        let mut of_wires = BTreeSet::new();
        for end in wires.values().flatten() {
            let producer = &done[end.draft].as_ref()?.repeat;
            let it = repeat::join(self.expansion, end, producer, self.problems)?;
            of_wires.extend(it.axes.iter().copied());
            joined.push(it);
        }
        let n_problems = self.problems.len();
        let gathered = repeat::gathered(draft, &of_wires, axes, self.problems);
        let own = repeat::own_axes(draft);
        for axis in own.intersection(&gathered) {
            let name = &axes[axis.0].name;
            let node = draft.local_name();
            let message = format!("`{node}` gathers the items of `{name}` and cannot name one");
            self.problems.push(Diagnostic::error(&draft.place, message));
        }
        for port in draft.kind.spec.inputs.iter().filter(|it| !it.arity.takes_list()) {
            let all = wires.iter().flat_map(|(name, ends)| ends.iter().map(move |_| name));
            let of_port = all.zip(&joined).filter(|it| it.0 == port.name);
            let mut its_axes = of_port.flat_map(|it| &it.1.axes);
            if let Some(axis) = its_axes.find(|it| gathered.contains(it)) {
                let name = &axes[axis.0].name;
                let message = format!("`{}` takes one wire, not all items of `{name}`", port.name);
                let place = draft.fields.iter().find(|it| *it.key.name == *port.name);
                let place = place.map_or(&draft.place, |it| &it.value.place);
                self.problems.push(Diagnostic::error(place, message));
            }
        }
        if self.problems.len() > n_problems {
            return None;
        }
        let all = own.union(&of_wires).copied().filter(|it| !gathered.contains(it));
        let all: Vec<AxisId> = all.collect();
        let sizes = all.iter().map(|it| axes[it.0].items.len());
        let count = sizes.fold(1, usize::saturating_mul);
        let repeat = Repeat { axes: all, first: 0, count };
        Some(Repeated { repeat, gathered: gathered.into_iter().collect(), joined })
    }

    /// Checks the parameters of drafts although the graph cannot be made.
    fn check_constant_drafts(&mut self) {
        for draft in &self.expansion.drafts {
            if draft.fields.iter().all(|it| it.value.is_constant()) {
                self.check_node(draft, &draft.fields, None);
            }
        }
    }

    /// Adds the instances of a draft; false if one of them is wrong.
    fn check_draft(
        &mut self,
        draft: &Draft,
        wires: &Wires,
        repeated: &Repeated,
        all: &[Repeated],
        instances: &mut Vec<Instance>,
    ) -> bool {
        let axes = &self.expansion.axes;
        let field_place = |it: &Entry| {
            let written = it.value.origin.as_ref().unwrap_or(&it.value.place);
            (Arc::clone(&it.key.name), written.clone())
        };
        let field_places: Arc<[(Arc<str>, Place)]> = draft.fields.iter().map(field_place).collect();
        let is_constant = draft.fields.iter().all(|it| it.value.is_constant());
        let shared = if is_constant {
            match self.check_node(draft, &draft.fields, Some(wires)) {
                Some(node) => Some(node),
                None => return false,
            }
        } else {
            None
        };
        let settings = draft.settings.clone().complete();
        let (n_problems, n_before) = (self.problems.len(), instances.len());
        for point in repeated.repeat.points(axes) {
            let node = match &shared {
                Some(node) => Some(node.clone()),
                None => self.check_item(draft, wires, &point),
            };
            // The same mistake at thousands of items is told a few times.
            if self.problems.len() > n_problems + 5 {
                return false;
            }
            let Some((node, files)) = node else { continue };
            let (inputs, input_labels) = inputs(draft, wires, repeated, all, axes, &point);
            instances.push(Instance {
                name: draft.name.clone(),
                labels: repeated.repeat.labels(axes, &point),
                kind: draft.kind,
                node,
                inputs,
                input_labels,
                shows_missing: draft.gather.shows_missing,
                files,
                settings: settings.clone(),
                place: draft.place.clone(),
                field_places: Arc::clone(&field_places),
            });
        }
        // A value that is broken has been reported where it is written.
        instances.len() - n_before == repeated.repeat.count
    }

    /// The node at one item of its axes.
    fn check_item(
        &mut self,
        draft: &Draft,
        wires: &Wires,
        point: &Point,
    ) -> Option<(Arc<CheckedNode>, BTreeMap<PathBuf, PathBuf>)> {
        let axes = &self.expansion.axes;
        let fields: Vec<Entry> = draft
            .fields
            .iter()
            .map(|Entry { key, value }| Entry {
                key: key.clone(),
                value: axes::fill(value, axes, point),
            })
            .collect();
        self.check_node(draft, &fields, Some(wires))
    }
}

/// Where the wires of an instance lead, and what the items are called that labelled ports gather.
fn inputs(
    draft: &Draft,
    wires: &Wires,
    repeated: &Repeated,
    all: &[Repeated],
    axes: &[Axis],
    point: &Point,
) -> (Inputs, InputLabels) {
    let (mut inputs, mut labels) = (Inputs::new(), InputLabels::new());
    let mut all_joined = repeated.joined.iter();
    for (name, ends) in wires {
        let port = draft.kind.spec.inputs.iter().find(|it| it.name == name);
        let is_labelled = port.is_some_and(|it| it.labelled);
        let (mut refs, mut port_labels) = (Vec::with_capacity(ends.len()), Vec::new());
        for (end, joined) in ends.iter().zip(&mut all_joined) {
            let producer = &all[end.draft].repeat;
            let over: Vec<AxisId> =
                joined.axes.iter().copied().filter(|it| repeated.gathered.contains(it)).collect();
            for gathered in repeat::points(&over, axes) {
                let whole: Vec<(AxisId, usize)> = point.iter().chain(&gathered).copied().collect();
                let instance = producer.instance(&joined.picks, axes, &whole);
                refs.push(PortRef { instance: NodeIndex::new(instance), port: end.port.name });
                if is_labelled {
                    port_labels.push(repeated.repeat.labels(axes, &gathered));
                }
            }
        }
        inputs.insert(name, refs);
        if is_labelled {
            labels.insert(name, port_labels);
        }
    }
    (inputs, labels)
}
