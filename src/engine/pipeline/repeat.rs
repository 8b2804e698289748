//! How often a node is there: the axes of every draft, and which items its wires lead to.
//!
//! A draft has the axes that its parameters name and those of what it reads, less those that it
//! gathers. Wires join on the axes that both ends have; over all others they broadcast.

use std::collections::BTreeSet;

use super::{
    axes::{Axis, Base, Point, Side},
    diagnostic::{Diagnostic, Problems},
    expand::{Draft, Expansion, Scope},
    nearest::{one_of, suggest},
    value::{AxisId, Key},
    wires::{Selection, WireEnd},
};
use crate::engine::labels::{Labels, no_labels};

/// The position along one axis of the instance that a wire leads to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pick {
    /// The item of the same axis.
    Same(AxisId),
    /// The item that this axis, a copy, is at.
    Copy(AxisId),
    /// One side of the pair that this axis is at.
    Side(AxisId, Side),
    Item(usize),
}

impl Pick {
    /// The axis that the position depends on.
    pub fn axis(self) -> Option<AxisId> {
        match self {
            Self::Same(axis) | Self::Copy(axis) | Self::Side(axis, _) => Some(axis),
            Self::Item(_) => None,
        }
    }

    fn position(self, axes: &[Axis], point: &Point) -> usize {
        let at = |axis: AxisId| {
            let found = point.iter().find(|it| it.0 == axis);
            found.expect("a point has all axes of its wires").1
        };
        match self {
            Self::Same(axis) => at(axis),
            Self::Copy(axis) => axes[axis.0].items[at(axis)].base[0],
            Self::Side(axis, side) => axes[axis.0].items[at(axis)].base[side as usize],
            Self::Item(index) => index,
        }
    }
}

/// The axes of a draft, and the numbers of its instances.
#[derive(Debug, Clone, Default)]
pub struct Repeat {
    /// Ascending.
    pub axes: Vec<AxisId>,
    /// The number of its first instance.
    pub first: usize,
    pub count: usize,
}

impl Repeat {
    /// All its points, the last axis running fastest.
    pub fn points<'a>(
        &'a self,
        axes: &'a [Axis],
    ) -> impl Iterator<Item = Vec<(AxisId, usize)>> + 'a {
        points(&self.axes, axes)
    }

    pub fn labels(&self, axes: &[Axis], point: &Point) -> Labels {
        if point.is_empty() {
            return no_labels();
        }
        let label = |&(axis, at): &(AxisId, usize)| {
            let axis = &axes[axis.0];
            (axis.name.clone(), axis.items[at].label.clone())
        };
        point.iter().map(label).collect()
    }

    /// The number of the instance that a wire leads to from a point.
    pub fn instance(&self, picks: &[Pick], axes: &[Axis], point: &Point) -> usize {
        let positions = self.axes.iter().zip(picks);
        self.first
            + positions.fold(0, |at, (axis, pick)| {
                at * axes[axis.0].items.len() + pick.position(axes, point)
            })
    }
}

/// All combinations of the items of some axes, the last axis running fastest.
pub fn points<'a>(
    over: &'a [AxisId],
    axes: &'a [Axis],
) -> impl Iterator<Item = Vec<(AxisId, usize)>> + 'a {
    let sizes: Vec<usize> = over.iter().map(|it| axes[it.0].items.len()).collect();
    let count: usize = sizes.iter().product();
    (0..count).map(move |mut number| {
        let mut point: Vec<(AxisId, usize)> = over.iter().map(|&it| (it, 0)).collect();
        for (entry, size) in point.iter_mut().zip(&sizes).rev() {
            entry.1 = number % size;
            number /= size;
        }
        point
    })
}

/// A wire whose ends are known: by axis of its producer, where it leads.
#[derive(Debug, Clone)]
pub struct Joined {
    pub picks: Vec<Pick>,
    /// The axes that these depend on, ascending.
    pub axes: Vec<AxisId>,
}

/// Applies the selections of a wire to the axes of the draft that it leads to.
pub fn join(
    expansion: &Expansion,
    end: &WireEnd,
    producer: &Repeat,
    problems: &mut Problems,
) -> Option<Joined> {
    let mut picks: Vec<Pick> = producer.axes.iter().map(|&it| Pick::Same(it)).collect();
    for selection in &end.selections {
        select(expansion, end, producer, selection, &mut picks, problems)?;
    }
    let axes: BTreeSet<AxisId> = picks.iter().filter_map(|it| it.axis()).collect();
    Some(Joined { picks, axes: axes.into_iter().collect() })
}

fn select(
    expansion: &Expansion,
    end: &WireEnd,
    producer: &Repeat,
    selection: &Selection,
    picks: &mut [Pick],
    problems: &mut Problems,
) -> Option<()> {
    let axes = &expansion.axes;
    let is_meant = |it: &Pick| it.axis().is_some_and(|it| *axes[it.0].name == *selection.axis);
    let Some(at) = picks.iter().position(is_meant) else {
        let node = expansion.drafts[end.draft].local_name();
        let message = format!("`{node}` has no axis `{}`", selection.axis);
        let names: Vec<&str> =
            picks.iter().filter_map(|it| it.axis()).map(|it| &*axes[it.0].name).collect();
        let hint = suggest(&selection.axis, names)
            .unwrap_or_else(|| "it is there once for all items".to_owned());
        problems.push(Diagnostic::error(&selection.place, message).hint(hint));
        return None;
    };
    let scope = &expansion.scopes[selection.scope];
    let axis = picks[at].axis().expect("it has the axis that is meant");
    let Some(found) = reference(&selection.item, axis, scope, axes) else {
        report_reference(selection, axis, scope, axes, problems);
        return None;
    };
    // An item of a pair or of a copy is an item of what they are made from.
    picks[at] = match (picks[at], found) {
        (Pick::Same(_), found) => found,
        (Pick::Copy(copy), Pick::Item(item)) => Pick::Item(axes[copy.0].items[item].base[0]),
        (Pick::Side(pair, side), Pick::Item(item)) => {
            Pick::Item(axes[pair.0].items[item].base[side as usize])
        }
        _ => {
            let message =
                format!("items of `{}` are selected already", axes[producer.axes[at].0].name);
            problems.push(Diagnostic::error(&selection.place, message));
            return None;
        }
    };
    Some(())
}

/// What `item` in `[axis=item]` means.
fn reference(item: &str, axis: AxisId, scope: &Scope, axes: &[Axis]) -> Option<Pick> {
    if let Some((pair, side)) = item.split_once('.')
        && let Some(&pair) = scope.names.axes.get(pair)
        && axes[pair.0].base == Base::PairsOf(axis)
        && let Some(side) = Side::ALL.into_iter().find(|it| it.name() == side)
    {
        return Some(Pick::Side(pair, side));
    }
    if let Some(&other) = scope.names.axes.get(item) {
        if other == axis {
            return Some(Pick::Same(axis));
        }
        if axes[other.0].base == Base::CopyOf(axis) {
            return Some(Pick::Copy(other));
        }
    }
    axes[axis.0].item(item).map(Pick::Item)
}

fn report_reference(
    selection: &Selection,
    axis: AxisId,
    scope: &Scope,
    axes: &[Axis],
    problems: &mut Problems,
) {
    let mut known: Vec<String> = Vec::new();
    for (name, other) in &scope.names.axes {
        match axes[other.0].base {
            Base::PairsOf(it) if it == axis => {
                known.extend(Side::ALL.map(|side| format!("{name}.{}", side.name())));
            }
            Base::CopyOf(it) if it == axis => known.push(name.to_string()),
            _ => {}
        }
    }
    known.sort_unstable();
    known.extend(axes[axis.0].items.iter().map(|it| it.label.to_string()));
    let message = format!("`{}` is no item of axis `{}`", selection.item, selection.axis);
    let hint = suggest(&selection.item, known.iter().map(String::as_str));
    problems.push(Diagnostic::error(&selection.place, message).hint(hint));
}

/// The axes that a draft's own parameters name.
pub fn own_axes(draft: &Draft) -> BTreeSet<AxisId> {
    let mut res = BTreeSet::new();
    for field in &draft.fields {
        field.value.axis_fields(&mut |it| {
            res.insert(it.axis);
        });
    }
    res
}

/// What a draft gathers of the axes of its wires. Reports names that none of them has.
pub fn gathered(
    draft: &Draft,
    of_wires: &BTreeSet<AxisId>,
    axes: &[Axis],
    problems: &mut Problems,
) -> BTreeSet<AxisId> {
    let names: Vec<&str> = of_wires.iter().map(|it| &*axes[it.0].name).collect();
    for Key { name, place } in draft.gather.over.iter().filter(|it| &*it.name != "*") {
        if !names.contains(&&**name) {
            let message = format!("no input of `{}` has the axis `{name}`", draft.local_name());
            let hint = match names.is_empty() {
                true => "its inputs are there once".to_owned(),
                false => format!("they have {}", one_of(names.iter().copied())),
            };
            problems.push(Diagnostic::error(place, message).hint(hint));
        }
    }
    of_wires.iter().copied().filter(|it| draft.gather.takes(&axes[it.0].name)).collect()
}
