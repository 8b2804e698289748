//! What the parameters of a kind may be: its JSON schema, read once into a small table.

use std::collections::HashMap;

use serde_json::{Map, Value as Json};

use super::node::NodeKind;

/// The fields of a table: of a kind's parameters, or of a table within them.
#[derive(Debug, Clone, Default)]
pub struct Fields {
    pub list: Vec<Field>,
    by_name: HashMap<String, usize>,
    /// Names that the schema does not list are allowed.
    pub open: bool,
}

#[derive(Debug, Clone)]
pub struct Field {
    pub name: String,
    /// Its doc comment.
    pub doc: String,
    pub shape: Shape,
    pub required: bool,
    /// What it is if it is not given; `null` if it is then nothing at all.
    pub default: Option<Json>,
}

/// The values that a field takes.
#[derive(Debug, Clone)]
pub enum Shape {
    Any,
    Bool,
    Integer(Range),
    Number(Range),
    Text,
    /// A path of a file that is read.
    File,
    /// A name of a program, or a path to it.
    Program,
    /// Names and their docs.
    Choice(Vec<(String, String)>),
    List {
        item: Box<Shape>,
        min: usize,
        max: usize,
    },
    /// One shape for each item.
    Tuple(Vec<Shape>),
    Table(Fields),
    /// Any names, values of one shape.
    Map(Box<Shape>),
    OneOf(Vec<Shape>),
}

/// Bounds of a number.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Range {
    pub min: Option<f64>,
    pub max: Option<f64>,
    /// The bound itself is not allowed.
    pub min_excluded: bool,
    pub max_excluded: bool,
}

impl Fields {
    /// The parameters of a kind.
    pub fn of(kind: &NodeKind) -> Self {
        let schema = (kind.schema)();
        let root = schema.as_object().expect("the schema of a struct is an object");
        let definitions = root.get("$defs").and_then(Json::as_object);
        Reader { definitions, depth: 0 }.fields(root)
    }

    pub fn get(&self, name: &str) -> Option<&Field> {
        self.by_name.get(name).map(|&it| &self.list[it])
    }

    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.list.iter().map(|it| it.name.as_str())
    }
}

impl Shape {
    /// With its article: `an integer of at least 1`.
    pub fn describe(&self) -> String {
        match self {
            Self::Any => "any value".to_owned(),
            Self::Bool => "`true` or `false`".to_owned(),
            Self::Integer(range) => format!("an integer{}", range.describe_after(" ")),
            Self::Number(range) => format!("a number{}", range.describe_after(" ")),
            Self::Text => "a text".to_owned(),
            Self::File => "the path of a file".to_owned(),
            Self::Program => "the name or the path of a program".to_owned(),
            Self::Choice(names) => {
                let names: Vec<String> = names.iter().map(|it| format!("\"{}\"", it.0)).collect();
                names.join(" or ")
            }
            Self::List { item, .. } => format!("a list of: {}", item.describe()),
            Self::Tuple(items) => format!("a list of {}", items.len()),
            Self::Table(_) | Self::Map(_) => "a table".to_owned(),
            Self::OneOf(shapes) => {
                let shapes: Vec<String> = shapes.iter().map(Self::describe).collect();
                shapes.join(", or ")
            }
        }
    }
}

impl Range {
    pub fn contains(&self, value: f64) -> bool {
        let above = |min| if self.min_excluded { value > min } else { value >= min };
        let below = |max| if self.max_excluded { value < max } else { value <= max };
        self.min.is_none_or(above) && self.max.is_none_or(below)
    }

    /// `from 1 to 10`, `of at least 1`, `above 0`; nothing if there are no bounds.
    pub fn describe(&self) -> String {
        let min = self.min.map(|it| match self.min_excluded {
            true => format!("above {it}"),
            false => format!("of at least {it}"),
        });
        let max = self.max.map(|it| match self.max_excluded {
            true => format!("below {it}"),
            false => format!("of at most {it}"),
        });
        match (self.min, self.max, min, max) {
            (Some(a), Some(b), ..) if !self.min_excluded && !self.max_excluded => {
                format!("from {a} to {b}")
            }
            (_, _, Some(min), Some(max)) => format!("{min} and {max}"),
            (_, _, min, max) => min.or(max).unwrap_or_default(),
        }
    }

    fn describe_after(&self, space: &str) -> String {
        match self.describe() {
            text if text.is_empty() => text,
            text => format!("{space}{text}"),
        }
    }
}

struct Reader<'a> {
    definitions: Option<&'a Map<String, Json>>,
    /// Of references: a type that contains itself ends as [`Shape::Any`].
    depth: usize,
}

impl Reader<'_> {
    fn fields(&self, schema: &Map<String, Json>) -> Fields {
        let no_fields = Map::new();
        let properties = schema.get("properties").and_then(Json::as_object).unwrap_or(&no_fields);
        let required = schema.get("required").and_then(Json::as_array);
        let is_required = |name: &str| required.is_some_and(|it| it.iter().any(|it| it == name));
        let list: Vec<Field> = properties
            .iter()
            .map(|(name, schema)| Field {
                name: name.clone(),
                doc: text(schema, "description"),
                shape: self.shape(schema),
                required: is_required(name),
                default: schema.get("default").cloned(),
            })
            .collect();
        let by_name = list.iter().enumerate().map(|(i, it)| (it.name.clone(), i)).collect();
        let open = schema.get("additionalProperties") != Some(&Json::Bool(false));
        Fields { list, by_name, open }
    }

    fn shape(&self, schema: &Json) -> Shape {
        let Some(object) = schema.as_object() else { return Shape::Any };
        if let Some(target) = schema.get("$ref").and_then(Json::as_str) {
            return self.referenced(target);
        }
        for key in ["oneOf", "anyOf", "allOf"] {
            if let Some(options) = schema.get(key).and_then(Json::as_array) {
                return self.one_of(options);
            }
        }
        if let Some(names) = schema.get("enum").and_then(Json::as_array) {
            let names = names.iter().filter_map(Json::as_str);
            return Shape::Choice(names.map(|it| (it.to_owned(), String::new())).collect());
        }
        if let Some(name) = schema.get("const").and_then(Json::as_str) {
            return Shape::Choice(vec![(name.to_owned(), text(schema, "description"))]);
        }
        match type_name(schema) {
            Some("boolean") => Shape::Bool,
            Some("integer") => Shape::Integer(range(schema)),
            Some("number") => Shape::Number(range(schema)),
            Some("string") if text(schema, "format") == "input-file" => Shape::File,
            Some("string") if text(schema, "format") == "program" => Shape::Program,
            Some("string") => Shape::Text,
            Some("array") => self.list(schema),
            Some("object") => self.table(object),
            _ => Shape::Any,
        }
    }

    fn referenced(&self, target: &str) -> Shape {
        let name = target.strip_prefix("#/$defs/").unwrap_or(target);
        match self.definitions.and_then(|it| it.get(name)) {
            Some(schema) if self.depth < 16 => {
                Reader { definitions: self.definitions, depth: self.depth + 1 }.shape(schema)
            }
            _ => Shape::Any,
        }
    }

    /// Alternatives; `null` is none, since TOML has no such value. Choices of one name are joined.
    fn one_of(&self, options: &[Json]) -> Shape {
        let mut choices = Vec::new();
        let mut shapes = Vec::new();
        for option in options.iter().filter(|it| type_name(it) != Some("null")) {
            match self.shape(option) {
                Shape::Choice(names) => choices.extend(names),
                shape => shapes.push(shape),
            }
        }
        if !choices.is_empty() {
            shapes.insert(0, Shape::Choice(choices));
        }
        if shapes.len() == 1 { shapes.remove(0) } else { Shape::OneOf(shapes) }
    }

    fn list(&self, schema: &Json) -> Shape {
        if let Some(items) = schema.get("prefixItems").and_then(Json::as_array) {
            return Shape::Tuple(items.iter().map(|it| self.shape(it)).collect());
        }
        let count = |key: &str| Some(schema.get(key)?.as_u64()? as usize);
        Shape::List {
            item: Box::new(schema.get("items").map_or(Shape::Any, |it| self.shape(it))),
            min: count("minItems").unwrap_or(0),
            max: count("maxItems").unwrap_or(usize::MAX),
        }
    }

    fn table(&self, schema: &Map<String, Json>) -> Shape {
        match schema.get("additionalProperties") {
            Some(values) if values.is_object() => Shape::Map(Box::new(self.shape(values))),
            _ => Shape::Table(self.fields(schema)),
        }
    }
}

/// The type of a schema; of `["integer", "null"]` the one that is not null.
fn type_name(schema: &Json) -> Option<&str> {
    match schema.get("type")? {
        Json::String(name) => Some(name),
        Json::Array(names) => {
            let mut names = names.iter().filter_map(Json::as_str);
            names.clone().find(|&it| it != "null").or_else(|| names.next())
        }
        _ => None,
    }
}

fn range(schema: &Json) -> Range {
    let bound = |key: &str| schema.get(key).and_then(Json::as_f64);
    let (min, max) = (bound("exclusiveMinimum"), bound("exclusiveMaximum"));
    Range {
        min: min.or_else(|| bound("minimum")),
        max: max.or_else(|| bound("maximum")),
        min_excluded: min.is_some(),
        max_excluded: max.is_some(),
    }
}

fn text(schema: &Json, key: &str) -> String {
    schema.get(key).and_then(Json::as_str).unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::toy::TOY;

    fn shape(kind: &str, field: &str) -> String {
        let fields = Fields::of(TOY.kind(kind).unwrap());
        assert!(!fields.open, "{kind}");
        fields.get(field).unwrap().shape.describe()
    }

    #[test]
    fn shapes_are_read_from_schemas() {
        assert_eq!(shape("number", "value"), "an integer");
        assert_eq!(shape("scale", "factor"), "a number from 0 to 1000");
        assert_eq!(shape("scale", "rounding"), "\"nearest\" or \"down\" or \"up\"");
        assert_eq!(shape("scale", "limit"), "an integer of at least 1");
        assert_eq!(shape("add", "weights"), "a list of: an integer");
        assert_eq!(shape("text_file", "path"), "the path of a file");
        assert_eq!(shape("fail", "environment"), "`true` or `false`");
    }

    #[test]
    fn required_fields_and_defaults_are_told_apart() {
        let fields = Fields::of(TOY.kind("scale").unwrap());
        let required: Vec<&str> =
            fields.list.iter().filter(|it| it.required).map(|it| it.name.as_str()).collect();
        assert_eq!(required, ["factor"]);
        assert_eq!(fields.get("rounding").unwrap().default, Some("nearest".into()));
        assert_eq!(fields.get("factor").unwrap().doc, "What it is multiplied by.");
    }
}
