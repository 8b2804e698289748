//! Whether numbers of a table keep to their bounds.

use super::{Condition, Statistic, Table, TableError, Values, select_rows};

/// What numbers are to keep to.
#[derive(Debug, Clone)]
pub struct Bound<'a> {
    pub column: &'a str,
    /// Of all rows together; each row by itself without.
    pub statistic: Option<Statistic>,
    pub conditions: Vec<(&'a String, &'a Condition)>,
    pub min: Option<f64>,
    pub max: Option<f64>,
    pub allow_missing: bool,
}

/// Why a table does not keep to a bound.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoundError {
    #[error(transparent)]
    Table(#[from] TableError),
    #[error("there is no row to check `{column}` in")]
    NoRows { column: String },
    #[error("{what} is {value}, {side} the bound of {bound}")]
    Statistic { what: String, value: String, side: &'static str, bound: String },
    #[error("{n_wrong} of {n_rows} rows break the bound: {facts}")]
    Rows { n_wrong: usize, n_rows: usize, facts: String },
    #[error(
        "`{column}` is missing in {n_missing} of {n_rows} rows ({rows}); `allow_missing` allows it"
    )]
    Missing { column: String, n_missing: usize, n_rows: usize, rows: String },
    #[error("{what} cannot be told: too few of {n_rows} rows have a value")]
    TooFew { what: String, n_rows: usize },
}

/// What was checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// ``mean` of `error` is 0.96 %`, or the range of the rows.
    pub fact: String,
}

/// Rows that are told one by one.
const MOST_ROWS: usize = 10;

/// Checks that the numbers of a column, or a statistic of them, lie within bounds that belong to the good
/// side. Statistics rows of the table do not count.
///
/// # Errors
/// See [`BoundError`]; missing values break any bound unless they are allowed or counted.
pub fn check_bound(table: &Table, bound: &Bound<'_>) -> Result<Checked, BoundError> {
    let data = select_rows(table.data(), bound.conditions.iter().copied())?;
    let values = data.numbers(bound.column, "a bound")?;
    let checked = Data { table: &data, values, bound };
    if values.is_empty() {
        return Err(BoundError::NoRows { column: bound.column.to_owned() });
    }
    checked.check_missing()?;
    match bound.statistic {
        Some(statistic) => checked.check_statistic(statistic),
        None => checked.check_rows(),
    }
}

struct Data<'a> {
    table: &'a Table,
    values: &'a [f64],
    bound: &'a Bound<'a>,
}

impl Data<'_> {
    fn check_missing(&self) -> Result<(), BoundError> {
        let missing: Vec<usize> = self.rows(|it| it.is_nan());
        let is_counted = self.bound.statistic.is_some_and(Statistic::is_count);
        if missing.is_empty() || self.bound.allow_missing || is_counted {
            return Ok(());
        }
        let rows = missing.iter().take(MOST_ROWS).map(|&it| self.row_name(it));
        Err(BoundError::Missing {
            column: self.bound.column.to_owned(),
            n_missing: missing.len(),
            n_rows: self.values.len(),
            rows: and_more(rows.collect(), missing.len()),
        })
    }

    fn check_statistic(&self, statistic: Statistic) -> Result<Checked, BoundError> {
        let value = statistic.of(self.values);
        let what = format!("`{}` of `{}`", statistic.name(), self.bound.column);
        if value.is_nan() {
            return Err(BoundError::TooFew { what, n_rows: self.values.len() });
        }
        let shown = |it| if statistic.is_count() { number(it) } else { self.shown(it) };
        match self.broken_by(value) {
            Some((side, bound)) => {
                Err(BoundError::Statistic { what, value: shown(value), side, bound: shown(bound) })
            }
            None => Ok(Checked { fact: format!("{what} is {}", shown(value)) }),
        }
    }

    fn check_rows(&self) -> Result<Checked, BoundError> {
        let column = self.bound.column;
        let wrong = self.rows(|it| self.broken_by(it).is_some());
        let fact = |&row: &usize| {
            let (side, bound) = self.broken_by(self.values[row]).expect("it was filtered so");
            let (value, bound) = (self.shown(self.values[row]), self.shown(bound));
            format!("`{column}` is {value} in {}, {side} the bound of {bound}", self.row_name(row))
        };
        if !wrong.is_empty() {
            let facts = wrong.iter().take(MOST_ROWS).map(fact).collect();
            let facts = and_more(facts, wrong.len());
            let n_rows = self.values.len();
            return Err(BoundError::Rows { n_wrong: wrong.len(), n_rows, facts });
        }
        let n_known = Statistic::Count.of(self.values);
        if n_known == 0.0 {
            let what = format!("`{column}`");
            return Err(BoundError::TooFew { what, n_rows: self.values.len() });
        }
        let (low, high) = (Statistic::Min.of(self.values), Statistic::Max.of(self.values));
        let (low, high) = (self.shown(low), self.shown(high));
        Ok(Checked { fact: format!("`{column}` is {low} to {high} in {n_known} rows") })
    }

    /// The side and the bound that a value breaks. NaN breaks none: it was judged before.
    fn broken_by(&self, value: f64) -> Option<(&'static str, f64)> {
        let above = self.bound.max.filter(|&it| value > it).map(|it| ("above", it));
        above.or_else(|| self.bound.min.filter(|&it| value < it).map(|it| ("below", it)))
    }

    fn rows(&self, is_wanted: impl Fn(f64) -> bool) -> Vec<usize> {
        (0..self.values.len()).filter(|&row| is_wanted(self.values[row])).collect()
    }

    /// A row by its texts, or by its number.
    fn row_name(&self, row: usize) -> String {
        let texts = self.table.columns.iter().filter_map(|it| match &it.values {
            Values::Texts(texts) if !texts[row].is_empty() => Some(texts[row].as_str()),
            _ => None,
        });
        match texts.collect::<Vec<_>>()[..] {
            [] => format!("row {}", row + 1),
            ref texts => format!("row `{}`", texts.join(", ")),
        }
    }

    fn shown(&self, value: f64) -> String {
        let unit = self.table.column(self.bound.column).map_or("", |it| it.unit.as_str());
        if unit.is_empty() { number(value) } else { format!("{} {unit}", number(value)) }
    }
}

/// Six significant digits where that many are needed, so that a value never looks like the bound it breaks
/// by a little more than that.
fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let size = value.abs().log10().floor();
    if !(-5.0..15.0).contains(&size) {
        return format!("{value:.5e}");
    }
    let decimals = (5.0 - size).max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

fn and_more(mut listed: Vec<String>, n: usize) -> String {
    if n > listed.len() {
        listed.push(format!("and {} more", n - listed.len()));
    }
    listed.join("; ")
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{table, texts};
    use super::super::{Column, Wanted};
    use super::*;

    fn measured(values: &[f64]) -> Table {
        let names = ["horse", "cow", "fox", "wolf"];
        let mut res = table(&[]);
        res.columns.push(texts("shape", &names[..values.len()]));
        res.columns.push(Column::numbers("error", "%", values.to_vec()));
        res
    }

    fn bound(max: f64, statistic: Option<Statistic>) -> Bound<'static> {
        let conditions = Vec::new();
        let (min, max, allow_missing) = (None, Some(max), false);
        Bound { column: "error", statistic, conditions, min, max, allow_missing }
    }

    fn check(values: &[f64], bound: &Bound<'_>) -> String {
        match check_bound(&measured(values), bound) {
            Ok(checked) => checked.fact,
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn every_row_that_breaks_a_bound_is_named() {
        let values = [5.0, 1.0, 4.25, 4.0];
        assert_eq!(
            check(&values, &bound(4.0, None)),
            "2 of 4 rows break the bound: `error` is 5 % in row `horse`, above the bound of 4 %; \
             `error` is 4.25 % in row `fox`, above the bound of 4 %"
        );
        assert_eq!(check(&values, &bound(5.0, None)), "`error` is 1 % to 5 % in 4 rows");
        let at_least = Bound { min: Some(2.0), max: None, ..bound(0.0, None) };
        assert_eq!(
            check(&values, &at_least),
            "1 of 4 rows break the bound: `error` is 1 % in row `cow`, below the bound of 2 %"
        );
    }

    #[test]
    fn a_statistic_is_bounded_as_a_whole() {
        let values = [5.0, 1.0, 4.25, 4.0];
        let mean = Some(Statistic::Mean);
        assert_eq!(check(&values, &bound(3.6, mean)), "`mean` of `error` is 3.5625 %");
        assert_eq!(
            check(&values, &bound(3.5, mean)),
            "`mean` of `error` is 3.5625 %, above the bound of 3.5 %"
        );
        assert_eq!(
            check(&[1.0], &bound(3.5, Some(Statistic::Std))),
            "`std` of `error` cannot be told: too few of 1 rows have a value"
        );
    }

    #[test]
    fn missing_values_fail_unless_they_are_allowed() {
        let values = [1.0, f64::NAN];
        assert_eq!(
            check(&values, &bound(4.0, None)),
            "`error` is missing in 1 of 2 rows (row `cow`); `allow_missing` allows it"
        );
        let allowed = Bound { allow_missing: true, ..bound(4.0, None) };
        assert_eq!(check(&values, &allowed), "`error` is 1 % to 1 % in 1 rows");
        assert_eq!(
            check(&[f64::NAN], &allowed),
            "`error` cannot be told: too few of 1 rows have a value"
        );
        let counted = bound(0.0, Some(Statistic::Missing));
        assert_eq!(check(&values, &counted), "`missing` of `error` is 1, above the bound of 0");
    }

    #[test]
    fn conditions_choose_rows_and_statistics_never_count() {
        let mut data = measured(&[5.0, 1.0, 9.0]);
        data.n_statistics = 1;
        let name = "shape".to_owned();
        let cow = Condition::One(Wanted::Text("cow".to_owned()));
        let chosen = Bound { conditions: vec![(&name, &cow)], ..bound(4.0, None) };
        assert!(check_bound(&data, &chosen).is_ok());
        assert!(check_bound(&data, &bound(5.0, None)).is_ok());
        assert_eq!(check(&[], &bound(1.0, None)), "there is no row to check `error` in");
    }

    #[test]
    fn many_rows_are_cut_short() {
        let error = check_bound(&table(&[("error", &[9.0; 14])]), &bound(1.0, None)).unwrap_err();
        let text = error.to_string();
        assert!(
            text.starts_with("14 of 14 rows break the bound: `error` is 9 in row 1,"),
            "{text}"
        );
        assert!(
            text.ends_with("`error` is 9 in row 10, above the bound of 1; and 4 more"),
            "{text}"
        );
    }
}
