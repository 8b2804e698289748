//! Numbers that stand for a column.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Column, Table, TableError, Values};

/// A number that stands for a column. Missing values are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Statistic {
    Mean,
    Median,
    Min,
    Max,
    /// The standard deviation of a sample (divided by n - 1).
    Std,
    /// The value below which 95 % lie, interpolated between neighbours.
    P95,
    /// The root of the mean square.
    Rms,
    Sum,
    /// How many values there are.
    Count,
    /// How many values are missing.
    Missing,
}

impl Statistic {
    pub fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Median => "median",
            Self::Min => "min",
            Self::Max => "max",
            Self::Std => "std",
            Self::P95 => "p95",
            Self::Rms => "rms",
            Self::Sum => "sum",
            Self::Count => "count",
            Self::Missing => "missing",
        }
    }

    /// Whether it is a number of values, not a value.
    pub fn is_count(self) -> bool {
        matches!(self, Self::Count | Self::Missing)
    }

    /// Of all values but the missing ones; NaN where there are too few.
    pub fn of(self, values: &[f64]) -> f64 {
        let known: Vec<f64> = values.iter().copied().filter(|it| !it.is_nan()).collect();
        let n = known.len() as f64;
        let sum = || known.iter().sum::<f64>();
        let squares = |from: f64| known.iter().map(|it| (it - from).powi(2)).sum::<f64>();
        match self {
            Self::Count => n,
            Self::Missing => values.len() as f64 - n,
            _ if known.is_empty() => f64::NAN,
            Self::Mean => sum() / n,
            Self::Median => percentile(&known, 50.0),
            Self::Min => known.iter().copied().fold(f64::INFINITY, f64::min),
            Self::Max => known.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            Self::Std if known.len() < 2 => f64::NAN,
            Self::Std => (squares(sum() / n) / (n - 1.0)).sqrt(),
            Self::P95 => percentile(&known, 95.0),
            Self::Rms => (squares(0.0) / n).sqrt(),
            Self::Sum => sum(),
        }
    }
}

/// The value below which so many percent lie, interpolated between the two nearest ranks (Hyndman & Fan
/// 1996, definition 7). Missing values are left out; NaN if there is no other.
pub fn percentile(values: &[f64], percent: f64) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|it| !it.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = percent.clamp(0.0, 100.0) / 100.0 * last as f64;
    let below = (place as usize).min(last);
    let (low, high) = (sorted[below], sorted[(below + 1).min(last)]);
    // Two infinities of one sign have no difference.
    if low == high { low } else { low + (place - below as f64) * (high - low) }
}

/// How many values of a column are missing; as a text, a remark for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    pub column: String,
    pub n_missing: usize,
    pub n_rows: usize,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { column, n_missing, n_rows } = self;
        let rest = n_rows - n_missing;
        write!(f, "`{column}` is missing in {n_missing} of {n_rows} rows; {rest} are left")
    }
}

impl Missing {
    /// Of each column of numbers that lacks some.
    pub fn of(table: &Table) -> Vec<Self> {
        let n_rows = table.n_data_rows();
        let missing = |column: &Column| {
            let Values::Numbers(values) = &column.values else { return None };
            let n_missing = values[..n_rows].iter().filter(|it| it.is_nan()).count();
            (n_missing > 0).then(|| Self { column: column.name.clone(), n_missing, n_rows })
        };
        table.columns.iter().filter_map(missing).collect()
    }
}

/// Adds a row for every statistic of the rows above, and one that counts what is missing if anything is.
///
/// Names go into the first column; if that holds numbers, into a column `statistic` before it. Other text
/// columns stay empty, and so do the columns that are left out because they hold labels.
///
/// # Errors
/// If there is a column `statistic` already, but not as the first.
pub fn add_statistics(
    table: Table,
    statistics: &[Statistic],
    without: &[&str],
) -> Result<Table, TableError> {
    if statistics.is_empty() {
        return Ok(table);
    }
    let mut statistics = statistics.to_vec();
    let data = table.data();
    let lacks = |it: &Missing| !without.contains(&it.column.as_str());
    if Missing::of(&data).iter().any(lacks) && !statistics.contains(&Statistic::Missing) {
        statistics.push(Statistic::Missing);
    }
    let first = data.columns.first();
    let mut table = match first.map(|it| &it.values) {
        Some(Values::Numbers(_)) => with_names_in_front(table)?,
        _ => table,
    };
    let n_data = table.n_data_rows();
    for (index, column) in table.columns.iter_mut().enumerate() {
        let is_label = without.contains(&column.name.as_str());
        match &mut column.values {
            Values::Numbers(values) => {
                let of =
                    |it: &Statistic| if is_label { f64::NAN } else { it.of(&values[..n_data]) };
                let more: Vec<f64> = statistics.iter().map(of).collect();
                values.extend(more);
            }
            Values::Texts(texts) if index == 0 => {
                texts.extend(statistics.iter().map(|it| it.name().to_owned()));
            }
            Values::Texts(texts) => texts.resize(texts.len() + statistics.len(), String::new()),
        }
    }
    table.n_statistics += statistics.len();
    Ok(table)
}

fn with_names_in_front(table: Table) -> Result<Table, TableError> {
    let n_statistics = table.n_statistics;
    let names = Column::texts("statistic", vec![String::new(); table.n_rows()]);
    let columns = std::iter::once(names).chain(table.columns).collect();
    Table { columns, n_statistics }.with_distinct_names()
}

/// The table and one more column of texts, behind the others.
pub(super) fn with_text_column(
    mut table: Table,
    name: &str,
    texts: Vec<String>,
) -> Result<Table, TableError> {
    table.columns.push(Column::texts(name, texts));
    table.with_distinct_names()
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{names, numbers_of, table, texts, texts_of};
    use super::*;

    /// What numpy and pandas give for `[2, nan, 4, 2, -1, 7.5]`.
    #[test]
    fn statistics_have_their_known_values() {
        let values = [2.0, f64::NAN, 4.0, 2.0, -1.0, 7.5];
        let expected = [
            (Statistic::Mean, 2.9),
            (Statistic::Median, 2.0),
            (Statistic::Min, -1.0),
            (Statistic::Max, 7.5),
            (Statistic::Std, 3.130_495_168_499_705_5),
            (Statistic::P95, 6.8),
            (Statistic::Rms, 4.031_128_874_149_275),
            (Statistic::Sum, 14.5),
            (Statistic::Count, 5.0),
            (Statistic::Missing, 1.0),
        ];
        for (statistic, expected) in expected {
            let found = statistic.of(&values);
            assert!((found - expected).abs() < 1e-14, "{statistic:?}: {found}");
        }
        for (percent, expected) in
            [(0.0, -1.0), (25.0, 2.0), (75.0, 4.0), (90.0, 6.1), (100.0, 7.5)]
        {
            assert!((percentile(&values, percent) - expected).abs() < 1e-14, "{percent}");
        }
    }

    #[test]
    fn too_few_values_have_no_statistics() {
        for statistic in [Statistic::Mean, Statistic::Min, Statistic::P95, Statistic::Sum] {
            assert!(statistic.of(&[f64::NAN]).is_nan(), "{statistic:?}");
        }
        assert!(Statistic::Std.of(&[1.0]).is_nan());
        assert_eq!(Statistic::Count.of(&[]), 0.0);
        assert_eq!(percentile(&[f64::INFINITY, f64::INFINITY], 50.0), f64::INFINITY);
    }

    #[test]
    fn missing_values_are_counted_in_a_row_of_their_own() {
        let mut data = table(&[("a", &[1.0, f64::NAN, 3.0]), ("b", &[1.0, 2.0, 3.0])]);
        data.columns.insert(0, texts("shape", &["x", "y", "z"]));
        let res = add_statistics(data, &[Statistic::Mean], &[]).unwrap();
        assert_eq!(texts_of(&res, "shape"), ["x", "y", "z", "mean", "missing"]);
        assert_eq!(numbers_of(&res, "a")[3..], [2.0, 1.0]);
        assert_eq!(numbers_of(&res, "b")[3..], [2.0, 0.0]);
        assert_eq!((res.n_statistics, res.n_data_rows()), (2, 3));
    }

    #[test]
    fn names_of_statistics_find_a_place_beside_numbers() {
        let data = table(&[("k", &[20.0, 40.0]), ("a", &[1.0, 3.0])]);
        let res = add_statistics(data, &[Statistic::Mean, Statistic::Max], &["k"]).unwrap();
        assert_eq!(names(&res), ["statistic", "k", "a"]);
        assert_eq!(texts_of(&res, "statistic"), ["", "", "mean", "max"]);
        assert!(numbers_of(&res, "k")[2..].iter().all(|it| it.is_nan()), "no mean of labels");
        assert_eq!(numbers_of(&res, "a"), [1.0, 3.0, 2.0, 3.0]);
    }
}
