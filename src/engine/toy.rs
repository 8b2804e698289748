//! A library without geometry: kinds that add numbers, for the tests and benchmarks of the engine.

use std::{
    io::Write,
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
    time::Duration,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    artifact::{Artifact, ArtifactKind, ArtifactType, DecodeError, Decoder, Encoder, Format},
    library::Library,
    node::{
        Input, InputFile, Inputs, Labelled, LabelledInputs, Node, NodeError, NodeIo, NodeKind,
        OptionalInput, OptionalInputs, OptionalOutput, Output, Spec,
    },
};

/// The toy kinds and their two types.
pub static TOY: Library = Library {
    kinds: &[
        NodeKind::of::<AddNode>(),
        NodeKind::of::<CountNode>(),
        NodeKind::of::<DivideNode>(),
        NodeKind::of::<DriftNode>(),
        NodeKind::of::<FailNode>(),
        NodeKind::of::<GatherNode>(),
        NodeKind::of::<MisbehaveNode>(),
        NodeKind::of::<NumberNode>(),
        NodeKind::of::<OptionalNode>(),
        NodeKind::of::<PanicNode>(),
        NodeKind::of::<ReciprocalNode>(),
        NodeKind::of::<ScaleNode>(),
        NodeKind::of::<SleepNode>(),
        NodeKind::of::<TextFileNode>(),
        NodeKind::of::<WaitNode>(),
    ],
    types: &[ArtifactKind::of::<Number>(), ArtifactKind::of::<Text>()],
    common_formats: &[],
};

/// A whole number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Number(pub i64);

impl Artifact for Number {
    const TYPE: ArtifactType =
        ArtifactType { name: "number", version: 1, doc: "a whole number of 64 bits" };
    const FORMATS: &'static [Format] = &[Format { extension: "txt", doc: "decimal digits" }];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("value", &[1], std::slice::from_ref(&self.0));
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        match from.vector::<i64>("value")?[..] {
            [value] => Ok(Self(value)),
            ref values => Err(DecodeError(format!("{} numbers instead of one", values.len()))),
        }
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![("value".to_owned(), self.0.to_string())]
    }

    fn export(&self, _extension: &str) -> Result<Vec<u8>, String> {
        Ok(format!("{}\n", self.0).into_bytes())
    }
}

/// A text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Text(pub String);

impl Artifact for Text {
    const TYPE: ArtifactType = ArtifactType { name: "text", version: 1, doc: "a text" };
    const FORMATS: &'static [Format] = &[Format { extension: "txt", doc: "the text itself" }];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.text("text", self.0.clone());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self(from.text("text")?.to_owned()))
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![("characters".to_owned(), self.0.chars().count().to_string())]
    }

    fn export(&self, _extension: &str) -> Result<Vec<u8>, String> {
        Ok(self.0.clone().into_bytes())
    }
}

const NUMBER: Output<Number> = Output::new("number", "the result");

/// Adds numbers.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct AddNode {
    /// A factor for every term; 1 for all if it is empty.
    #[serde(default)]
    weights: Vec<i64>,
}

impl AddNode {
    const TERMS: Inputs<Number> = Inputs::new("terms", "what is added");
}

impl Node for AddNode {
    const SPEC: Spec = Spec {
        kind: "add",
        version: 1,
        inputs: &[Self::TERMS.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.two]\nkind = \"number\"\nvalue = 2\n\n\
                  [nodes.four]\nkind = \"add\"\nterms = [\"@two\", \"@two\"]\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let terms = io.get_all(Self::TERMS);
        if !self.weights.is_empty() && self.weights.len() != terms.len() {
            let (n_weights, n_terms) = (self.weights.len(), terms.len());
            return Err(NodeError::failed(format!("{n_weights} weights for {n_terms} terms")));
        }
        let weights = self.weights.iter().copied().chain(std::iter::repeat(1));
        let sum = terms.iter().zip(weights).map(|(term, weight)| term.0 * weight).sum();
        io.put(NUMBER, Number(sum));
        Ok(())
    }
}

/// Counts the characters of a text.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct CountNode {}

impl CountNode {
    const TEXT: Input<Text> = Input::new("text", "what is counted");
}

impl Node for CountNode {
    const SPEC: Spec = Spec {
        kind: "count",
        version: 1,
        inputs: &[Self::TEXT.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.note]\nkind = \"text_file\"\npath = \"note.txt\"\n\n\
                  [nodes.length]\nkind = \"count\"\ntext = \"@note\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let n_characters = io.get(Self::TEXT).0.chars().count();
        io.put(NUMBER, Number(n_characters as i64));
        Ok(())
    }
}

/// Divides with remainder.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct DivideNode {
    /// What is divided by.
    by: i64,
}

impl DivideNode {
    const NUMBER: Input<Number> = Input::new("number", "what is divided");
    const QUOTIENT: Output<Number> = Output::new("quotient", "rounded down");
    const REMAINDER: Output<Number> = Output::new("remainder", "never negative");
}

impl Node for DivideNode {
    const SPEC: Spec = Spec {
        kind: "divide",
        version: 1,
        inputs: &[Self::NUMBER.port()],
        outputs: &[Self::QUOTIENT.port(), Self::REMAINDER.port()],
        cites: &[],
        example: "[nodes.seven]\nkind = \"number\"\nvalue = 7\n\n\
                  [nodes.parts]\nkind = \"divide\"\nnumber = \"@seven\"\nby = 2\n",
    };

    fn validate(&self) -> Result<(), String> {
        if self.by == 0 { Err("`by` must not be zero".to_owned()) } else { Ok(()) }
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let number = io.get(Self::NUMBER).0;
        io.put(Self::QUOTIENT, Number(number.div_euclid(self.by)));
        io.put(Self::REMAINDER, Number(number.rem_euclid(self.by)));
        Ok(())
    }
}

const AFTER: OptionalInput<Number> = OptionalInput::new("after", "only waited for");

/// Breaks the rules: gives a longer text every time, from the same key.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct DriftNode {}

impl DriftNode {
    const TEXT: Output<Text> = Output::new("text", "too long for the log");
}

impl Node for DriftNode {
    const SPEC: Spec = Spec {
        kind: "drift",
        version: 1,
        inputs: &[],
        outputs: &[Self::TEXT.port()],
        cites: &[],
        example: "[nodes.text]\nkind = \"drift\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        static RUNS: AtomicUsize = AtomicUsize::new(100_000);
        io.put(Self::TEXT, Text("x".repeat(RUNS.fetch_add(1, Ordering::Relaxed))));
        Ok(())
    }
}

/// Fails.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FailNode {
    /// What it says.
    #[serde(default = "default_message")]
    message: String,
    /// Blames the machine instead of the pipeline.
    #[serde(default)]
    environment: bool,
}

fn default_message() -> String {
    "this node always fails".to_owned()
}

impl Node for FailNode {
    const SPEC: Spec = Spec {
        kind: "fail",
        version: 1,
        inputs: &[AFTER.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.bad]\nkind = \"fail\"\n",
    };

    fn run(&self, _io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let message = self.message.clone();
        Err(if self.environment {
            NodeError::Environment(message)
        } else {
            NodeError::Failed(message)
        })
    }
}

/// Writes down which numbers it gathers, and which are missing.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct GatherNode {}

impl GatherNode {
    const NUMBERS: LabelledInputs<Number> = LabelledInputs::new("numbers", "what is gathered");
    const TEXT: Output<Text> = Output::new("text", "`axis=item: number`, one a line");
}

impl Node for GatherNode {
    const SPEC: Spec = Spec {
        kind: "gather",
        version: 1,
        inputs: &[Self::NUMBERS.port()],
        outputs: &[Self::TEXT.port()],
        cites: &[],
        example: "[axes.n]\nvalues = [1, 2]\n\n[nodes.one]\nkind = \"number\"\nvalue = \"${n}\"\n\n\
                  [nodes.all]\nkind = \"gather\"\nnumbers = \"@one\"\nover = \"n\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mut text = String::new();
        for Labelled { labels, value } in io.get_labelled(Self::NUMBERS) {
            let labels: Vec<String> =
                labels.iter().map(|(a, item)| format!("{a}={item}")).collect();
            let value = value.map_or_else(|why| format!("missing, {why}"), |it| it.0.to_string());
            text += &format!("{}: {value}\n", labels.join(" "));
        }
        io.put(Self::TEXT, Text(text));
        Ok(())
    }
}

/// Misbehaves, or does so the first times that it runs, and adds numbers after that.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct MisbehaveNode {
    /// What it does.
    how: Misbehaviour,
    /// The file in which it counts how often it has run; without it, it misbehaves always.
    #[serde(default)]
    counter: Option<String>,
    /// How often it misbehaves.
    #[serde(default)]
    times: u64,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Misbehaviour {
    /// Returns an error.
    Fail,
    /// Returns an error that blames the machine.
    Blame,
    /// Panics.
    Panic,
    /// Writes to an address that it does not have.
    Crash,
    /// Calls itself until there is no stack left.
    Recurse,
    /// Allocates until there is no memory left.
    Allocate,
    /// Ends the process.
    Exit,
    /// Never comes back.
    Hang,
}

impl MisbehaveNode {
    const TERMS: OptionalInputs<Number> = OptionalInputs::new("terms", "what is added");

    /// Whether it has misbehaved often enough.
    fn is_reformed(&self) -> std::io::Result<bool> {
        let Some(path) = &self.counter else { return Ok(false) };
        let mut file = std::fs::File::options().create(true).append(true).open(path)?;
        let n_runs = file.metadata()?.len();
        file.write_all(b".")?;
        Ok(n_runs >= self.times)
    }
}

impl Node for MisbehaveNode {
    const SPEC: Spec = Spec {
        kind: "misbehave",
        version: 1,
        inputs: &[Self::TERMS.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.bad]\nkind = \"misbehave\"\nhow = \"hang\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        if !self.is_reformed()? {
            io.progress(None, "misbehaves");
            self.how.misbehave()?;
        }
        let sum = io.get_all_optional(Self::TERMS).iter().map(|it| it.0).sum();
        io.put(NUMBER, Number(sum));
        Ok(())
    }
}

impl Misbehaviour {
    fn misbehave(self) -> Result<(), NodeError> {
        match self {
            Self::Fail => Err(NodeError::failed("not this time")),
            Self::Blame => Err(NodeError::environment("the machine does not want to")),
            Self::Panic => panic!("not this time"),
            Self::Crash => {
                eprintln!("about to crash");
                let nowhere = std::ptr::without_provenance_mut::<u8>(8);
                // SAFETY: none; that is the point.
                unsafe { nowhere.write_volatile(1) };
                Ok(())
            }
            Self::Recurse => Err(NodeError::failed(format!("came back from {}", recurse(1)))),
            Self::Allocate => allocate(),
            Self::Exit => std::process::exit(7),
            Self::Hang => loop {
                std::thread::sleep(Duration::from_secs(3600));
            },
        }
    }
}

#[expect(unconditional_recursion, reason = "that is the point")]
fn recurse(depth: u64) -> u64 {
    std::hint::black_box(recurse(std::hint::black_box(depth + 1)) + 1)
}

/// Takes 8 GB, so that a test without a limit does not end the machine.
fn allocate() -> Result<(), NodeError> {
    let blocks: Vec<Vec<u8>> = (0..128).map(|it| vec![it; 64 << 20]).collect();
    Err(NodeError::failed(format!("got {} blocks of memory", blocks.len())))
}

/// Makes a number.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct NumberNode {
    /// The number.
    #[serde(default)]
    value: i64,
}

impl Node for NumberNode {
    const SPEC: Spec = Spec {
        kind: "number",
        version: 1,
        inputs: &[],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.one]\nkind = \"number\"\nvalue = 1\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        io.put(NUMBER, Number(self.value));
        Ok(())
    }
}

/// Makes a number, or leaves it out.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct OptionalNode {
    /// The number, if there is one.
    #[serde(default)]
    value: Option<i64>,
}

impl OptionalNode {
    const NUMBER: OptionalOutput<Number> = OptionalOutput::new("number", "if it has a value");
}

impl Node for OptionalNode {
    const SPEC: Spec = Spec {
        kind: "optional",
        version: 1,
        inputs: &[],
        outputs: &[Self::NUMBER.port()],
        cites: &[],
        example: "[nodes.nothing]\nkind = \"optional\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        io.put_optional(Self::NUMBER, self.value.map(Number), "it has no value");
        Ok(())
    }
}

/// Divides a thousand by a number; fails if that is zero.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ReciprocalNode {}

impl ReciprocalNode {
    const OF: Input<Number> = Input::new("of", "what is divided by");
}

impl Node for ReciprocalNode {
    const SPEC: Spec = Spec {
        kind: "reciprocal",
        version: 1,
        inputs: &[Self::OF.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.four]\nkind = \"number\"\nvalue = 4\n\n\
                  [nodes.part]\nkind = \"reciprocal\"\nof = \"@four\"\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let of = io.get(Self::OF).0;
        let number = 1000_i64.checked_div(of).ok_or(NodeError::failed("division by zero"))?;
        io.put(NUMBER, Number(number));
        Ok(())
    }
}

/// Panics.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PanicNode {}

impl Node for PanicNode {
    const SPEC: Spec = Spec {
        kind: "panic",
        version: 1,
        inputs: &[AFTER.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.bad]\nkind = \"panic\"\n",
    };

    fn run(&self, _io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        panic!("this node always panics")
    }
}

/// Multiplies a number.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ScaleNode {
    /// What it is multiplied by.
    #[schemars(range(min = 0.0, max = 1000.0))]
    factor: f64,
    /// How the product is made whole.
    #[serde(default)]
    rounding: Rounding,
    /// No result is larger.
    #[serde(default)]
    #[schemars(range(min = 1))]
    limit: Option<u32>,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Rounding {
    /// To the nearest whole number.
    #[default]
    Nearest,
    /// Towards minus infinity.
    Down,
    /// Towards plus infinity.
    Up,
}

impl ScaleNode {
    const NUMBER: Input<Number> = Input::new("number", "what is multiplied");
}

impl Node for ScaleNode {
    const SPEC: Spec = Spec {
        kind: "scale",
        version: 1,
        inputs: &[Self::NUMBER.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.one]\nkind = \"number\"\nvalue = 1\n\n\
                  [nodes.two]\nkind = \"scale\"\nnumber = \"@one\"\nfactor = 2.0\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let product = io.get(Self::NUMBER).0 as f64 * self.factor;
        let whole = match self.rounding {
            Rounding::Nearest => product.round(),
            Rounding::Down => product.floor(),
            Rounding::Up => product.ceil(),
        };
        let limit = self.limit.map_or(i64::MAX, i64::from);
        io.put(NUMBER, Number((whole as i64).min(limit)));
        Ok(())
    }
}

/// Takes its time.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SleepNode {
    /// How long, in milliseconds.
    #[serde(default)]
    #[schemars(range(max = 60_000))]
    duration_ms: u64,
    /// The number that it makes.
    #[serde(default)]
    value: i64,
}

impl Node for SleepNode {
    const SPEC: Spec = Spec {
        kind: "sleep",
        version: 1,
        inputs: &[AFTER.port()],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.nap]\nkind = \"sleep\"\nduration_ms = 1\n",
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        std::thread::sleep(Duration::from_millis(self.duration_ms));
        io.progress(Some(1.0), "awake");
        io.put(NUMBER, Number(self.value));
        Ok(())
    }
}

/// Reads a text from a file and from the files that it includes.
///
/// A line `include other.txt` stands for the file of this name in the same folder.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct TextFileNode {
    /// The file.
    path: InputFile,
}

impl TextFileNode {
    const TEXT: Output<Text> = Output::new("text", "what the file holds");
}

impl Node for TextFileNode {
    const SPEC: Spec = Spec {
        kind: "text_file",
        version: 1,
        inputs: &[],
        outputs: &[Self::TEXT.port()],
        cites: &[],
        example: "[nodes.note]\nkind = \"text_file\"\npath = \"note.txt\"\n",
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        vec![("path", &self.path)]
    }

    fn side_files(&self, path: &Path) -> Vec<PathBuf> {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        text.lines()
            .filter_map(|it| it.strip_prefix("include "))
            .map(|it| path.with_file_name(it))
            .collect()
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let path = &self.path.0;
        let mut text = String::new();
        for line in String::from_utf8(io.read(path)?)?.split_inclusive('\n') {
            match line.strip_prefix("include ") {
                Some(name) => {
                    let included = io.read(&io.path(path).with_file_name(name.trim_end()))?;
                    text.push_str(&String::from_utf8(included)?);
                }
                None => text.push_str(line),
            }
        }
        io.put(Self::TEXT, Text(text));
        Ok(())
    }
}

/// Takes its time as a kind does that waits for a program: it ends when it is told to.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct WaitNode {
    /// How long, in milliseconds.
    duration_ms: u64,
}

impl Node for WaitNode {
    const SPEC: Spec = Spec {
        kind: "wait",
        version: 1,
        inputs: &[],
        outputs: &[NUMBER.port()],
        cites: &[],
        example: "[nodes.nap]\nkind = \"wait\"\nduration_ms = 1\n",
    };
    const HANDLES_LIMITS: bool = true;

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        io.progress(None, "waits");
        if io.cancel().sleep(Duration::from_millis(self.duration_ms)) {
            return Err(NodeError::failed("was told to end"));
        }
        io.put(NUMBER, Number(1));
        Ok(())
    }
}
