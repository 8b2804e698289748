//! What a kind reads and writes.

use std::marker::PhantomData;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::artifact::{Artifact, ArtifactType};

/// How many wires a port takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Arity {
    /// Exactly one.
    One,
    /// One or none. An optional output may be left out by a run.
    Optional,
    /// A list, in the order of the pipeline file.
    Many,
    /// A list that may be left out: then it is empty.
    OptionalMany,
}

impl Arity {
    /// Whether a pipeline may wire several artifacts to the port.
    pub fn takes_list(self) -> bool {
        matches!(self, Self::Many | Self::OptionalMany)
    }

    /// Whether a pipeline may leave the port out.
    pub fn may_be_left_out(self) -> bool {
        matches!(self, Self::Optional | Self::OptionalMany)
    }
}

/// What a pipeline sees of a port.
#[derive(Debug, Clone, Copy)]
pub struct Port {
    pub name: &'static str,
    pub doc: &'static str,
    pub ty: ArtifactType,
    pub arity: Arity,
    /// Whether the node is told what the items are called that the port gathers, and which are missing.
    pub labelled: bool,
    /// An output that a wire must name, even where a node has only one other: what a program printed.
    pub aside: bool,
}

impl Port {
    /// The same output, which a wire must name.
    pub const fn aside(self) -> Self {
        Self { aside: true, ..self }
    }
}

macro_rules! port_key {
    ($(#[$doc:meta])* $name:ident, $arity:ident, labelled: $labelled:literal) => {
        $(#[$doc])*
        pub struct $name<T> {
            pub(super) name: &'static str,
            doc: &'static str,
            of: PhantomData<fn() -> T>,
        }

        impl<T> Clone for $name<T> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<T> Copy for $name<T> {}

        impl<T: Artifact> $name<T> {
            pub const fn new(name: &'static str, doc: &'static str) -> Self {
                Self { name, doc, of: PhantomData }
            }

            pub const fn port(&self) -> Port {
                Port {
                    name: self.name,
                    doc: self.doc,
                    ty: T::TYPE,
                    arity: Arity::$arity,
                    labelled: $labelled,
                    aside: false,
                }
            }
        }
    };
}

port_key!(
    /// A typed key for something a node reads.
    Input,
    One,
    labelled: false
);
port_key!(
    /// A typed key for something a node reads if it is wired.
    OptionalInput,
    Optional,
    labelled: false
);
port_key!(
    /// A typed key for any number of artifacts, in the order in which they are listed.
    Inputs,
    Many,
    labelled: false
);
port_key!(
    /// A typed key for a list whose node wants to know what each artifact is called, by the items of
    /// the axes that it gathers. With `missing = "show"`, some of them may be missing.
    LabelledInputs,
    Many,
    labelled: true
);
port_key!(
    /// A typed key for any number of artifacts, or none if it is not wired.
    OptionalInputs,
    OptionalMany,
    labelled: false
);
port_key!(
    /// A typed key for something a node writes.
    Output,
    One,
    labelled: false
);
port_key!(
    /// A typed key for something a node writes if its inputs have it.
    OptionalOutput,
    Optional,
    labelled: false
);
