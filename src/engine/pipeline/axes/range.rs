//! `range = { from = 10, to = 50, step = 10 }`: numbers at equal distances, or at equal ratios.

use super::list::{List, Reading};
use crate::engine::pipeline::{
    diagnostic::Diagnostic,
    nearest::suggest,
    parse,
    value::{Data, Entry, Value},
};

/// More items than any machine runs: a slip of the pen.
const MOST_ITEMS: usize = 1_000_000;

/// The bounds are both included; `to` is left out if no whole number of steps leads there.
pub fn read(value: &Value, reading: &mut Reading<'_>) -> Option<List> {
    let fields = parse::table_entries(value.clone(), "`range`", reading.problems);
    let (mut from, mut to, mut step, mut n, mut log) = (None, None, None, None, false);
    for Entry { key, value } in &fields {
        let number = number(value);
        match (&*key.name, &value.data) {
            ("from", _) if number.is_some() => from = number,
            ("to", _) if number.is_some() => to = number,
            ("step", _) if number.is_some() => step = number,
            ("n", Data::Integer(it)) => n = Some(*it),
            ("log", Data::Bool(it)) => log = *it,
            (name @ ("from" | "to" | "step" | "n" | "log"), _) => {
                if !value.is_broken() {
                    let what = match name {
                        "log" => "`true` or `false`",
                        "n" => "an integer",
                        _ => "a number",
                    };
                    let message = format!("`{name}` must be {what}, but is {}", value.describe());
                    reading.problems.push(Diagnostic::error(&value.place, message));
                }
                return None;
            }
            (name, _) => {
                let names = ["from", "to", "step", "n", "log"];
                let message = format!("a range has no key `{name}`");
                let hint = suggest(name, names);
                reading.problems.push(Diagnostic::error(&key.place, message).hint(hint));
                return None;
            }
        }
    }
    let items = match (from, to) {
        (Some(from), Some(to)) => numbers(from, to, step, n, log),
        _ => Err("a range needs `from` and `to`".to_owned()),
    };
    match items {
        Ok(items) => {
            let items = items.into_iter().map(|it| Value { data: it, ..value.clone() });
            Some(List::of_values(items.collect()))
        }
        Err(message) => {
            reading.problems.push(Diagnostic::error(&value.place, message));
            None
        }
    }
}

/// A number, and whether it is an integer.
type Number = (f64, bool);

fn number(value: &Value) -> Option<Number> {
    match value.data {
        Data::Integer(it) => Some((it as f64, true)),
        Data::Float(it) => Some((it, false)),
        _ => None,
    }
}

fn numbers(
    from: Number,
    to: Number,
    step: Option<Number>,
    n: Option<i64>,
    log: bool,
) -> Result<Vec<Data>, String> {
    let ((from, from_is_integer), (to, _)) = (from, to);
    let count = match (step, n) {
        (Some(_), Some(_)) => return Err("a range takes `step` or `n`, not both".to_owned()),
        (None, Some(n)) if n >= 1 => n as usize,
        (None, Some(n)) => return Err(format!("a range of {n} items")),
        (Some(_), None) if log => {
            return Err("with `log = true`, a range takes `n` instead of `step`".to_owned());
        }
        (step, None) => count_of_steps(from, to, step.map_or(1.0, |it| it.0))?,
    };
    if count > MOST_ITEMS {
        return Err(format!("a range of {count} items; at most {MOST_ITEMS} make sense"));
    }
    if log && !(from > 0.0 && to > 0.0) {
        return Err("with `log = true`, `from` and `to` must be above 0".to_owned());
    }
    let is_integer = from_is_integer && n.is_none() && step.is_none_or(|it| it.1);
    let at = |index: usize| {
        let step = step.map_or(1.0, |it| it.0);
        let fraction = if count == 1 { 0.0 } else { index as f64 / (count - 1) as f64 };
        match (n, log) {
            (None, _) => from + index as f64 * step,
            (Some(_), _) if index + 1 == count && count > 1 => to,
            (Some(_), false) => from + fraction * (to - from),
            (Some(_), true) => from * (to / from).powf(fraction),
        }
    };
    Ok((0..count)
        .map(|index| match at(index) {
            it if is_integer => Data::Integer(it as i64),
            it => Data::Float(it),
        })
        .collect())
}

fn count_of_steps(from: f64, to: f64, step: f64) -> Result<usize, String> {
    let steps = (to - from) / step;
    if !steps.is_finite() || steps < 0.0 {
        return Err(format!("steps of {step} do not lead from {from} to {to}"));
    }
    // A little more, so that 0.1 is met in three steps of 0.1 that start at -0.2.
    Ok((steps + 1e-9).floor() as usize + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(from: f64, to: f64, step: Option<f64>, n: Option<i64>, log: bool, expected: &str) {
        let number = |it: f64| (it, it.fract() == 0.0);
        let found = match numbers(number(from), number(to), step.map(number), n, log) {
            Ok(items) => {
                let show = |it: &Data| match it {
                    Data::Integer(it) => it.to_string(),
                    Data::Float(it) => format!("{it:.4?}"),
                    _ => unreachable!(),
                };
                items.iter().map(show).collect::<Vec<_>>().join(" ")
            }
            Err(message) => message,
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn ranges_include_their_bounds() {
        check(1.0, 4.0, None, None, false, "1 2 3 4");
        check(10.0, 50.0, Some(20.0), None, false, "10 30 50");
        check(0.0, 1.0, Some(0.25), None, false, "0.0000 0.2500 0.5000 0.7500 1.0000");
        check(-0.2, 0.1, Some(0.1), None, false, "-0.2000 -0.1000 0.0000 0.1000");
        check(5.0, 1.0, Some(-2.0), None, false, "5 3 1");
        check(0.0, 1.0, None, Some(3), false, "0.0000 0.5000 1.0000");
        check(0.001, 1.0, None, Some(4), true, "0.0010 0.0100 0.1000 1.0000");
        check(3.0, 3.0, None, Some(1), false, "3.0000");
    }

    #[test]
    fn ranges_that_lead_nowhere_are_refused() {
        check(1.0, 4.0, Some(0.0), None, false, "steps of 0 do not lead from 1 to 4");
        check(4.0, 1.0, None, None, false, "steps of 1 do not lead from 4 to 1");
        check(
            0.0,
            1e12,
            None,
            None,
            false,
            "a range of 1000000000001 items; at most 1000000 make sense",
        );
        check(0.0, 1.0, None, Some(3), true, "with `log = true`, `from` and `to` must be above 0");
    }
}
