//! What is wrong with a pipeline, for people and for machines.

use std::{fmt, ops::Range};

use annotate_snippets::{Annotation, AnnotationKind, Group, Level, Renderer, Snippet};

use crate::engine::graph::{Place, Source};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    Error,
    Warning,
}

/// One mistake.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnostic {
    pub severity: Severity,
    /// Lower case, no final period, names in backticks.
    pub message: String,
    /// Where it is; `None` if a whole file cannot be read.
    pub place: Option<Place>,
    /// What to say at the place itself; may be empty.
    pub label: String,
    /// Other places that explain it, and what to say there.
    pub related: Vec<(Place, String)>,
    /// What to do.
    pub hint: Option<String>,
}

impl Diagnostic {
    pub fn error(place: &Place, message: impl Into<String>) -> Self {
        Self { place: Some(place.clone()), ..Self::without_place(message) }
    }

    pub fn without_place(message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            message: message.into(),
            place: None,
            label: String::new(),
            related: Vec::new(),
            hint: None,
        }
    }

    pub fn label(self, label: impl Into<String>) -> Self {
        Self { label: label.into(), ..self }
    }

    pub fn hint(self, hint: impl Into<Option<String>>) -> Self {
        Self { hint: hint.into(), ..self }
    }

    /// Also points at another place, if there is one.
    pub fn related(mut self, place: Option<&Place>, label: impl Into<String>) -> Self {
        self.related.extend(place.map(|it| (it.clone(), label.into())));
        self
    }
}

/// Collects mistakes while a pipeline is read.
pub type Problems = Vec<Diagnostic>;

/// Everything that is wrong with a pipeline, sorted by file and position.
#[derive(Debug, Clone)]
pub struct Diagnostics {
    pub list: Vec<Diagnostic>,
    pub sources: Vec<Source>,
}

impl Diagnostics {
    /// Sorts; says the same thing about the same place once (an inner pipeline is used twice).
    pub fn new(mut list: Problems, sources: Vec<Source>) -> Self {
        let position = |it: &Diagnostic| it.place.as_ref().map(|it| (it.source(), it.start()));
        list.sort_by(|a, b| position(a).cmp(&position(b)).then_with(|| a.message.cmp(&b.message)));
        list.dedup_by(|a, b| a.place == b.place && a.message == b.message);
        Self { list, sources }
    }

    /// Source lines with carets, as rustc shows them; `styled` with colours.
    pub fn render(&self, styled: bool) -> String {
        let renderer = if styled { Renderer::styled() } else { Renderer::plain() };
        let mut res = String::new();
        for diagnostic in &self.list {
            res.push_str(&renderer.render(&[self.group(diagnostic)]));
            res.push_str("\n\n");
        }
        res
    }

    /// One JSON object a diagnostic.
    pub fn to_json(&self) -> Vec<serde_json::Value> {
        self.list.iter().map(|it| self.diagnostic_to_json(it)).collect()
    }

    /// Line and column of a place, both counted from 1, the column in characters.
    pub fn line_and_column(&self, place: &Place) -> (usize, usize) {
        let before = &self.sources[place.source()].text[..place.start()];
        let line_start = before.rfind('\n').map_or(0, |it| it + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    fn group<'a>(&'a self, diagnostic: &'a Diagnostic) -> Group<'a> {
        let level = match diagnostic.severity {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
        };
        let mut group = Group::with_title(level.primary_title(&diagnostic.message));
        for (source, annotations) in self.annotations(diagnostic) {
            let source = &self.sources[source];
            let snippet = Snippet::source(&*source.text)
                .path(source.path.display().to_string())
                .annotations(annotations);
            group = group.element(snippet);
        }
        match &diagnostic.hint {
            Some(hint) => group.element(Level::HELP.message(hint)),
            None => group,
        }
    }

    /// By source, the one of the mistake itself first.
    fn annotations<'a>(&self, diagnostic: &'a Diagnostic) -> Vec<(usize, Vec<Annotation<'a>>)> {
        let mut res: Vec<(usize, Vec<Annotation<'a>>)> = Vec::new();
        let primary = diagnostic.place.iter().map(|it| (AnnotationKind::Primary, it));
        let labelled = primary.map(|it| (it, diagnostic.label.as_str()));
        let related = diagnostic.related.iter();
        let related = related.map(|(place, label)| ((AnnotationKind::Context, place), &**label));
        for ((kind, place), label) in labelled.chain(related) {
            let label = Some(label).filter(|it| !it.is_empty());
            let annotation = kind.span(self.visible_span(place)).label(label);
            match res.iter_mut().find(|it| it.0 == place.source()) {
                Some((_, annotations)) => annotations.push(annotation),
                None => res.push((place.source(), vec![annotation])),
            }
        }
        res
    }

    /// A span of several lines is shown by its first one.
    fn visible_span(&self, place: &Place) -> Range<usize> {
        let span = place.span();
        let line_end = self.sources[place.source()].text[span.clone()].find('\n');
        span.start..line_end.map_or(span.end, |it| span.start + it)
    }

    fn diagnostic_to_json(&self, diagnostic: &Diagnostic) -> serde_json::Value {
        let mut res = serde_json::json!({
            "severity": match diagnostic.severity {
                Severity::Error => "error",
                Severity::Warning => "warning",
            },
            "message": diagnostic.message,
        });
        if let Some(place) = &diagnostic.place {
            self.place_to_json(place, &mut res);
        }
        if !diagnostic.label.is_empty() {
            res["label"] = diagnostic.label.as_str().into();
        }
        if let Some(hint) = &diagnostic.hint {
            res["hint"] = hint.as_str().into();
        }
        let related = diagnostic.related.iter().map(|(place, label)| {
            let mut res = serde_json::json!({ "message": label });
            self.place_to_json(place, &mut res);
            res
        });
        res["related"] = related.collect();
        res
    }

    fn place_to_json(&self, place: &Place, to: &mut serde_json::Value) {
        let (line, column) = self.line_and_column(place);
        to["file"] = self.sources[place.source()].path.display().to_string().into();
        to["line"] = line.into();
        to["column"] = column.into();
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Diagnostics {}
