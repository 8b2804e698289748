//! What `@node.port` leads to, through the inputs and outputs of inner pipelines.

use super::{
    diagnostic::{Diagnostic, Problems},
    expand::{Expansion, Scope, Target},
    nearest::suggest,
    value::{Data, Value},
};
use crate::engine::node::Port;

/// The end of a wire: an output of a draft.
#[derive(Debug, Clone, Copy)]
pub struct WireEnd {
    pub draft: usize,
    pub port: &'static Port,
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
        let (name, port) = self.names(scope, wire)?;
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

    /// The node and the port that a wire names.
    fn names(&mut self, scope: usize, wire: &'a Value) -> Option<(&'a str, Option<&'a str>)> {
        let Some(text) = wire.as_text() else {
            if !wire.is_broken() {
                let what = match wire.data {
                    Data::List(_) => "a list".to_owned(),
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
        Some(path.split_once('.').map_or((path, None), |(name, port)| (name, Some(port))))
    }

    fn node_output(
        &mut self,
        draft: usize,
        name: &str,
        port: Option<&str>,
        wire: &Value,
    ) -> Option<WireEnd> {
        let outputs = self.expansion.drafts[draft].kind.spec.outputs;
        let found = match (port, outputs) {
            (None, [output]) => Some(output),
            (None, _) => None,
            (Some(port), _) => outputs.iter().find(|it| it.name == port),
        };
        if found.is_none() {
            self.report_port(name, port, outputs.iter().map(|it| it.name).collect(), wire);
        }
        Some(WireEnd { draft, port: found? })
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
