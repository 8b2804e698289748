//! Holds the wires of a node against the ports of its kind, and those of an inner pipeline against its
//! interface.

use super::{
    Checker, Wires,
    node::{fields_of, is_given},
};
use crate::engine::{
    artifact::{ANY, ArtifactType},
    graph::Place,
    node::Port,
    pipeline::{
        diagnostic::Diagnostic,
        expand::Draft,
        nearest::suggest,
        parse,
        value::{Data, Value},
        wires::{self, WireEnd},
    },
};

impl Checker<'_> {
    /// Checks what enters an inner pipeline and what leaves it.
    pub(super) fn check_interface(&mut self, scope_index: usize) {
        let scope = &self.expansion.scopes[scope_index];
        for input in &scope.document.inputs {
            let Some(ty) = self.input_type(&input.ty) else { continue };
            let wire = scope.given.get(&input.name.name);
            let (Some(wire), Some(parent)) = (wire, scope.parent) else { continue };
            if let Some(end) = wires::follow(self.expansion, parent, wire, self.problems)
                && end.port.ty.name != ty.name
            {
                let declared = (&input.name.place, "the input is declared here");
                self.report_wire_type(&input.name.name, ty, &end, wire, Some(declared));
            }
        }
        for output in &scope.document.outputs {
            parse::check_name(&output.key, self.problems);
            wires::follow(self.expansion, scope_index, &output.value, self.problems);
        }
    }

    fn input_type(&mut self, ty: &Value) -> Option<ArtifactType> {
        let name = parse::text(ty, "the type of an input", self.problems)?;
        let found = self.library.artifact_kind(name);
        if found.is_none() {
            let names = self.library.types.iter().map(|it| it.ty.name);
            let message = format!("there is no type `{name}`");
            self.problems.push(Diagnostic::error(&ty.place, message).hint(suggest(name, names)));
        }
        Some(found?.ty)
    }

    pub(super) fn check_wires(&mut self, draft: &Draft) -> Wires {
        let mut res = Wires::new();
        for port in draft.kind.spec.inputs {
            match draft.fields.iter().find(|it| *it.key.name == *port.name) {
                Some(field) => {
                    res.insert(port.name, self.check_port(draft, port, &field.value));
                }
                None if port.arity.may_be_left_out() => {}
                // A misspelt key is reported as such.
                None if is_given(draft, port.name, fields_of(&mut self.fields, draft.kind)) => {}
                None => self.report_missing_wire(draft, port),
            }
        }
        res
    }

    fn check_port(&mut self, draft: &Draft, port: &Port, value: &Value) -> Vec<WireEnd> {
        let wires = match &value.data {
            Data::List(_) if !port.arity.takes_list() => {
                let message = format!("`{}` takes one wire, not a list", port.name);
                self.problems.push(Diagnostic::error(&value.place, message));
                return Vec::new();
            }
            Data::List(wires) => wires,
            _ => std::slice::from_ref(value),
        };
        wires.iter().filter_map(|wire| self.check_wire(draft, port, wire)).collect()
    }

    fn check_wire(&mut self, draft: &Draft, port: &Port, wire: &Value) -> Option<WireEnd> {
        let end = wires::follow(self.expansion, draft.scope, wire, self.problems)?;
        if end.port.ty.name != port.ty.name && port.ty != ANY {
            self.report_wire_type(port.name, port.ty, &end, wire, None);
            return None;
        }
        Some(end)
    }

    fn report_missing_wire(&mut self, draft: &Draft, port: &Port) {
        let name = draft.local_name();
        let list = match port.arity {
            it if it.takes_list() => format!("; `{} = []` if there are none", port.name),
            _ => String::new(),
        };
        self.problems.push(
            Diagnostic::error(&draft.place, format!("`{name}.{}` is not wired", port.name))
                .hint(format!("it takes `{}`: {}{list}", port.ty.name, port.doc)),
        );
    }

    fn report_wire_type(
        &mut self,
        input: &str,
        wanted: ArtifactType,
        end: &WireEnd,
        wire: &Value,
        declared: Option<(&Place, &str)>,
    ) {
        let source = &self.expansion.drafts[end.draft];
        let message =
            format!("`{input}` takes `{}`, but this is `{}`", wanted.name, end.port.ty.name);
        let hint = other_output(source, wanted).or_else(|| self.converting_kind(end, wanted));
        let mut problem = Diagnostic::error(&wire.place, message)
            .label(format!("`{}` of `{}`", end.port.name, source.kind.spec.kind))
            .hint(hint);
        if let Some((place, label)) = declared {
            problem = problem.related(Some(place), label);
        }
        self.problems.push(problem);
    }

    /// The kind that makes the wanted type from what the wire carries, with fewest other inputs.
    fn converting_kind(&self, end: &WireEnd, wanted: ArtifactType) -> Option<String> {
        let has = |ports: &[Port], ty: ArtifactType| ports.iter().any(|it| it.ty.name == ty.name);
        let kinds = self.library.kinds.iter().map(|it| &it.spec);
        let kind = kinds
            .filter(|it| has(it.inputs, end.port.ty) && has(it.outputs, wanted))
            .min_by_key(|it| it.inputs.iter().filter(|it| !it.arity.may_be_left_out()).count())?;
        let (kind, wanted, given) = (kind.kind, wanted.name, end.port.ty.name);
        Some(format!("a `{kind}` node makes `{wanted}` from `{given}`"))
    }
}

fn other_output(source: &Draft, wanted: ArtifactType) -> Option<String> {
    let outputs = source.kind.spec.outputs;
    let output = outputs.iter().find(|it| it.ty.name == wanted.name)?;
    Some(format!("\"@{}.{}\" is `{}`", source.local_name(), output.name, wanted.name))
}
