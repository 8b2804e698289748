//! What `@node.port` leads to, through the inputs and outputs of inner pipelines.

use super::{
    diagnostic::{Diagnostic, Problems},
    expand::{Expansion, Scope, Target},
    nearest::suggest,
    value::{Data, Value},
};
use crate::engine::{graph::Place, node::Port};

/// The end of a wire: an output of a draft, at some of its items.
#[derive(Debug, Clone)]
pub struct WireEnd {
    pub draft: usize,
    pub port: &'static Port,
    /// What is written in brackets on the way, the one next to the draft first.
    pub selections: Vec<Selection>,
}

/// `axis=item` in `"@node[axis=item].port"`.
#[derive(Debug, Clone)]
pub struct Selection {
    pub axis: String,
    /// An item's label, or `pair.source`, or an axis whose items are the same.
    pub item: String,
    pub place: Place,
    /// Where names of axes in `item` are looked up.
    pub scope: usize,
}

/// What a wire says: `@name[selections].port`.
struct Written<'a> {
    name: &'a str,
    port: Option<&'a str>,
    selections: &'a str,
}

/// Follows a wire that is written in `scope`. Reports what is wrong with it, unless it has been.
pub fn follow(
    expansion: &Expansion,
    scope: usize,
    wire: &Value,
    problems: &mut Problems,
) -> Option<WireEnd> {
    Follower { expansion, problems, n_steps: 0 }.follow(scope, wire)
}

struct Follower<'a> {
    expansion: &'a Expansion,
    problems: &'a mut Problems,
    n_steps: usize,
}

impl<'a> Follower<'a> {
    fn follow(&mut self, scope: usize, wire: &'a Value) -> Option<WireEnd> {
        let Written { name, port, selections } = self.names(scope, wire)?;
        let selections = self.selections(selections, scope, wire)?;
        let mut end = self.follow_name(scope, name, port, wire)?;
        end.selections.extend(selections);
        Some(end)
    }

    fn follow_name(
        &mut self,
        scope: usize,
        name: &'a str,
        port: Option<&'a str>,
        wire: &'a Value,
    ) -> Option<WireEnd> {
        // Every step enters or leaves a scope by another of its ports; more of them is a circle.
        self.n_steps += 1;
        if self.n_steps > 1000 {
            return self.fail(wire, "the wire leads in a circle", None);
        }
        let scopes = &self.expansion.scopes;
        match scopes[scope].targets.get(name) {
            Some(&Target::Node(draft)) => self.node_output(draft, name, port, wire),
            Some(&Target::Pipeline(inner)) => {
                let output = self.pipeline_output(&scopes[inner], name, port, wire)?;
                self.follow(inner, output)
            }
            Some(Target::Input) if port.is_some() => {
                let message = format!("`{name}` is an input of this pipeline and has no ports");
                self.fail(wire, &message, Some(format!("write \"@{name}\"")))
            }
            Some(Target::Input) => {
                // Nothing is given if that has been reported, or the file is checked on its own.
                let outer = scopes[scope].given.get(name)?;
                self.follow(scopes[scope].parent?, outer)
            }
            Some(Target::Broken) => None,
            None => {
                let hint = suggest(name, names_of(&scopes[scope]));
                self.fail(wire, &format!("there is no node `{name}`"), hint)
            }
        }
    }

    /// Reads `axis=item,axis=item`.
    fn selections(&mut self, text: &'a str, scope: usize, wire: &Value) -> Option<Vec<Selection>> {
        let mut res = Vec::new();
        for part in text.split(',').filter(|_| !text.is_empty()) {
            let Some((axis, item)) = part.split_once('=') else {
                let hint = "write \"@node[axis=item].port\"".to_owned();
                return self.fail(wire, &format!("`[{text}]` selects no items"), Some(hint));
            };
            let (axis, item) = (axis.trim().to_owned(), item.trim().to_owned());
            res.push(Selection { axis, item, place: wire.place.clone(), scope });
        }
        Some(res)
    }

    /// The node and the port that a wire names.
    fn names(&mut self, scope: usize, wire: &'a Value) -> Option<Written<'a>> {
        let Some(text) = wire.as_text() else {
            if !wire.is_broken() {
                let what = match wire.data {
                    Data::List(_) => "a list".to_owned(),
                    Data::Template(_) => {
                        let message = "a wire cannot be named after the item of an axis";
                        let hint = "nodes have the axes of what they read; \
                            `\"@node[axis=item]\"` selects an item"
                            .to_owned();
                        return self.fail(wire, message, Some(hint));
                    }
                    _ => wire.describe(),
                };
                let hint = "a wire is written as \"@node.port\"".to_owned();
                let message = format!("expected a wire, but this is {what}");
                self.fail::<()>(wire, &message, Some(hint));
            }
            return None;
        };
        let Some(path) = text.strip_prefix('@') else {
            let name = text.split('.').next().unwrap_or_default();
            let known = self.expansion.scopes[scope].targets.contains_key(name);
            let hint = if known {
                format!("write \"@{text}\"")
            } else {
                "a wire is written as \"@node.port\"".to_owned()
            };
            let what = wire.describe();
            return self.fail(wire, &format!("expected a wire, but this is {what}"), Some(hint));
        };
        let (name, port, selections) = match path.split_once('[') {
            None => match path.split_once('.') {
                Some((name, port)) => (name, Some(port), ""),
                None => (path, None, ""),
            },
            Some((name, rest)) => {
                let Some((selections, behind)) = rest.split_once(']') else {
                    return self.fail(wire, "`[` is not closed by `]`", None);
                };
                match (behind, behind.strip_prefix('.')) {
                    ("", _) => (name, None, selections),
                    (_, Some(port)) => (name, Some(port), selections),
                    _ => {
                        let hint = "write \"@node[axis=item].port\"".to_owned();
                        let message = format!("`{behind}` is not expected behind `]`");
                        return self.fail(wire, &message, Some(hint));
                    }
                }
            }
        };
        Some(Written { name, port, selections })
    }

    fn node_output(
        &mut self,
        draft: usize,
        name: &str,
        port: Option<&str>,
        wire: &Value,
    ) -> Option<WireEnd> {
        let outputs = self.expansion.drafts[draft].kind.spec.outputs;
        let mut meant = outputs.iter().filter(|it| outputs.len() == 1 || !it.aside);
        let found = match port {
            None => meant.next().filter(|_| meant.next().is_none()),
            Some(port) => outputs.iter().find(|it| it.name == port),
        };
        if found.is_none() {
            self.report_port(name, port, outputs.iter().map(|it| it.name).collect(), wire);
        }
        Some(WireEnd { draft, port: found?, selections: Vec::new() })
    }

    /// The wire behind an output of an inner pipeline.
    fn pipeline_output(
        &mut self,
        inner: &'a Scope,
        name: &str,
        port: Option<&str>,
        wire: &Value,
    ) -> Option<&'a Value> {
        let outputs = &inner.document.outputs;
        let found = match (port, &outputs[..]) {
            (None, [output]) => Some(output),
            (None, _) => None,
            (Some(port), _) => outputs.iter().find(|it| &*it.key.name == port),
        };
        if found.is_none() {
            self.report_port(name, port, outputs.iter().map(|it| &*it.key.name).collect(), wire);
        }
        Some(&found?.value)
    }

    fn report_port(&mut self, name: &str, port: Option<&str>, ports: Vec<&str>, wire: &Value) {
        let (message, hint) = match (port, &ports[..]) {
            (_, []) => (format!("`{name}` has no outputs"), None),
            (Some(port), _) => {
                (format!("`{name}` has no output `{port}`"), suggest(port, ports.iter().copied()))
            }
            (None, _) => {
                let wires: Vec<String> =
                    ports.iter().map(|it| format!("\"@{name}.{it}\"")).collect();
                let message = format!("`{name}` has {} outputs: name one of them", ports.len());
                (message, Some(format!("write {}", wires.join(" or "))))
            }
        };
        self.fail::<()>(wire, &message, hint);
    }

    fn fail<T>(&mut self, wire: &Value, message: &str, hint: Option<String>) -> Option<T> {
        self.problems.push(
            Diagnostic::error(&wire.place, message)
                .hint(hint)
                .related(wire.origin.as_ref(), "it is written here"),
        );
        None
    }
}

/// In the order of the file, so that hints do not depend on hashing.
fn names_of(scope: &Scope) -> impl Iterator<Item = &str> {
    let nodes = scope.document.nodes.iter().map(|it| &*it.name.name);
    nodes.chain(scope.document.inputs.iter().map(|it| &*it.name.name))
}
