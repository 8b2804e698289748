//! From values to places, and the numbers at an axis.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How values are spread over an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Equal differences are equally long.
    #[default]
    Linear,
    /// Equal ratios are equally long. Values of zero and less are left out.
    Log,
}

/// The part of a scale that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    pub scale: Scale,
    pub low: f64,
    pub high: f64,
}

/// A labelled place on an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    pub value: f64,
    pub label: String,
}

/// The labelled places of an axis, and a factor that belongs to all labels (`×10⁶`), if there is one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ticks {
    pub list: Vec<Tick>,
    pub factor: String,
    /// Places of small ticks without labels.
    pub minor: Vec<f64>,
}

impl Scale {
    /// Whether a value has a place.
    pub fn shows(self, value: f64) -> bool {
        value.is_finite() && (self == Self::Linear || value > 0.0)
    }

    /// Where values are evenly spread.
    pub fn forward(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Log => value.max(f64::MIN_POSITIVE).log10(),
        }
    }

    pub fn backward(self, place: f64) -> f64 {
        match self {
            Self::Linear => place,
            Self::Log => 10f64.powf(place),
        }
    }
}

impl Axis {
    /// Shows all values with a small margin. A range that almost reaches zero starts there; `fixed` stays
    /// as it is.
    pub fn of(scale: Scale, values: impl Iterator<Item = f64>, fixed: Option<[f64; 2]>) -> Self {
        if let Some([low, high]) = fixed {
            return Self { scale, low, high };
        }
        let shown = values.filter(|&it| scale.shows(it)).map(|it| scale.forward(it));
        let (low, high) = shown
            .fold((f64::INFINITY, f64::NEG_INFINITY), |res, it| (res.0.min(it), res.1.max(it)));
        let (low, high) = match (scale, low.partial_cmp(&high)) {
            // Nothing is shown.
            (_, None | Some(std::cmp::Ordering::Greater)) => (0.0, 1.0),
            (Scale::Linear, Some(std::cmp::Ordering::Equal)) if low == 0.0 => (-1.0, 1.0),
            (Scale::Linear, Some(std::cmp::Ordering::Equal)) => {
                let (a, b) = (low * 0.5, low * 1.5);
                (a.min(b), a.max(b))
            }
            (Scale::Log, Some(std::cmp::Ordering::Equal)) => (low - 0.5, high + 0.5),
            _ => (low, high),
        };
        let margin = 0.04 * (high - low);
        let is_near_zero = scale == Scale::Linear && low >= 0.0 && low <= 0.3 * high;
        let is_near_zero_below = scale == Scale::Linear && high <= 0.0 && high >= 0.3 * low;
        let low = if is_near_zero { 0.0 } else { low - margin };
        let high = if is_near_zero_below { 0.0 } else { high + margin };
        Self { scale, low: scale.backward(low), high: scale.backward(high) }
    }

    /// 0 at the low end, 1 at the high one.
    pub fn place(&self, value: f64) -> f64 {
        let [low, high, value] = [self.low, self.high, value].map(|it| self.scale.forward(it));
        (value - low) / (high - low)
    }

    /// Round numbers within the range: at most about so many.
    pub fn ticks(&self, most: usize) -> Ticks {
        match self.scale {
            Scale::Linear => linear_ticks(self.low, self.high, most),
            Scale::Log => log_ticks(self.low, self.high, most),
        }
    }
}

/// Multiples of 1, 2 or 5 times a power of ten: as many as fit, but never more than `most` (of at least
/// two).
fn linear_ticks(low: f64, high: f64, most: usize) -> Ticks {
    let most = most.max(2) as f64;
    let mut exponent = ((high - low) / most).log10().floor() as i32 - 1;
    let (step, first, last) = loop {
        let step = [1, 2, 5].into_iter().find_map(|digit| {
            let step = Step { digit, exponent };
            // A range's ends are sums with rounding errors: a tick on an end belongs to it.
            let slack = 1e-9 * (high - low);
            let first = ((low - slack) / step.value()).ceil();
            let last = ((high + slack) / step.value()).floor();
            (last - first < most).then_some((step, first, last))
        });
        match step {
            Some(found) => break found,
            None => exponent += 1,
        }
    };
    let size = low.abs().max(high.abs());
    let power = if (1e-3..1e6).contains(&size) { 0 } else { size.log10().floor() as i32 };
    let decimals = (power - step.exponent).max(0) as usize;
    let n_ticks = (last - first) as usize + 1;
    let tick = |index: usize| {
        let count = first + index as f64;
        let label = format!("{:.decimals$}", step.times(count, power));
        Tick { value: step.times(count, 0), label: minus(&label) }
    };
    let factor = if power == 0 { String::new() } else { format!("×{}", power_of_ten(power)) };
    Ticks { list: (0..n_ticks).map(tick).collect(), factor, minor: Vec::new() }
}

/// The distance between ticks: a digit times a power of ten.
#[derive(Clone, Copy)]
struct Step {
    digit: i32,
    exponent: i32,
}

impl Step {
    fn value(self) -> f64 {
        self.times(1.0, 0)
    }

    /// So many steps, divided by a power of ten; the nearest number to the true one.
    fn times(self, count: f64, power: i32) -> f64 {
        let (digits, exponent) = (count * f64::from(self.digit), self.exponent - power);
        match exponent {
            0.. => digits * 10f64.powi(exponent),
            -300..0 => digits / 10f64.powi(-exponent),
            _ => digits / 1e300 / 10f64.powi(-exponent - 300),
        }
    }
}

/// Powers of ten; 2 and 5 times them if that leaves few; round numbers if the range has not even these.
fn log_ticks(low: f64, high: f64, most: usize) -> Ticks {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let is_within = |it: &f64| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(it);
    let at = |digits: &[i32], every: i32| -> Vec<(i32, i32)> {
        let exponents = (first..=last).filter(|it| it.rem_euclid(every) == 0);
        let pairs = exponents.flat_map(|e| digits.iter().map(move |&digit| (digit, e)));
        pairs.filter(|&(digit, exponent)| is_within(&Step { digit, exponent }.value())).collect()
    };
    let most = most.max(2);
    let every =
        (1..).find(|&every| at(&[1], every).len() <= most).expect("some step is long enough");
    let finer = [&[1, 2, 5][..], &[1, 3], &[1]].map(|digits| at(digits, every));
    let fitting = finer.into_iter().find(|it| every == 1 && it.len() <= most);
    let chosen = fitting.unwrap_or_else(|| at(&[1], every));
    if chosen.len() < 2 {
        return linear_ticks(low, high, most);
    }
    let is_plain = low >= 0.9e-3 && high <= 1.1e5;
    let label = |(digit, exponent): (i32, i32)| match (is_plain, digit) {
        (true, _) => {
            format!("{:.*}", (-exponent).max(0) as usize, Step { digit, exponent }.value())
        }
        (false, 1) => power_of_ten(exponent),
        (false, _) => format!("{digit}·{}", power_of_ten(exponent)),
    };
    let tick = |it: &(i32, i32)| {
        let value = Step { digit: it.0, exponent: it.1 }.value();
        Tick { value, label: label(*it) }
    };
    let minor = match last - first {
        0..=8 => at(&[2, 3, 4, 5, 6, 7, 8, 9], 1),
        _ => at(&[1], 1),
    };
    let minor = minor.into_iter().filter(|it| !chosen.contains(it));
    let minor = minor.map(|(digit, exponent)| Step { digit, exponent }.value()).collect();
    Ticks { list: chosen.iter().map(tick).collect(), factor: String::new(), minor }
}

fn power_of_ten(exponent: i32) -> String {
    let digits = exponent.to_string();
    let raised = digits.chars().map(|it| match it {
        '-' => '⁻',
        digit => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹']
            [digit.to_digit(10).expect("a number has digits") as usize],
    });
    format!("10{}", raised.collect::<String>())
}

/// A true minus sign, and none before zero.
fn minus(label: &str) -> String {
    match label.strip_prefix('-') {
        Some(rest) if rest.chars().all(|it| it == '0' || it == '.') => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => label.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    fn labels(scale: Scale, low: f64, high: f64, most: usize) -> String {
        let ticks = Axis { scale, low, high }.ticks(most);
        let labels: Vec<String> = ticks.list.into_iter().map(|it| it.label).collect();
        format!("{} {}", labels.join(" "), ticks.factor).trim_end().to_owned()
    }

    #[test]
    fn labels_are_round_numbers() {
        let linear = |low, high, most| labels(Scale::Linear, low, high, most);
        assert_eq!(linear(0.0, 1.0, 6), "0.0 0.2 0.4 0.6 0.8 1.0");
        assert_eq!(linear(0.0, 1.0, 11), "0.0 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8 0.9 1.0");
        assert_eq!(linear(-7.0, 13.0, 5), "−5 0 5 10");
        assert_eq!(linear(0.0, 30_252.0, 5), "0 10000 20000 30000");
        assert_eq!(linear(0.0, 3e7, 4), "0 1 2 3 ×10⁷");
        assert_eq!(linear(0.0, 4.2e-6, 5), "0 1 2 3 4 ×10⁻⁶");
        let log = |low, high, most| labels(Scale::Log, low, high, most);
        assert_eq!(log(0.8, 120.0, 8), "1 2 5 10 20 50 100");
        assert_eq!(log(0.8, 120.0, 5), "1 3 10 30 100");
        assert_eq!(log(0.8, 120.0, 4), "1 10 100");
        assert_eq!(log(1e-8, 1.0, 5), "10⁻⁸ 10⁻⁶ 10⁻⁴ 10⁻² 10⁰");
        assert_eq!(log(3.2, 3.9, 5), "3.2 3.4 3.6 3.8");
        assert_eq!(log(1e5, 1e6, 3), "10⁵ 3·10⁵ 10⁶");
        assert_eq!(log(1e5, 1e6, 2), "10⁵ 10⁶");
    }

    #[test]
    fn ticks_of_any_range_are_few_distinct_ascending_and_inside() {
        let mut random = Random::new(7);
        let mut uniform = move || random.next_u64() as f64 / u64::MAX as f64;
        for _ in 0..20_000 {
            let scale = if uniform() < 0.5 { Scale::Linear } else { Scale::Log };
            let size = 10f64.powf(uniform() * 40.0 - 20.0);
            let low = if scale == Scale::Linear { (uniform() - 0.5) * size } else { size };
            let high = match scale {
                Scale::Linear => low + 10f64.powf(uniform() * 6.0 - 4.0) * size,
                Scale::Log => low * 10f64.powf(uniform() * 12.0 + 0.01),
            };
            let most = 2 + (uniform() * 10.0) as usize;
            let ticks = Axis { scale, low, high }.ticks(most);
            let place = format!("{scale:?} {low} to {high}, most {most}: {ticks:?}");
            assert!((1..=most).contains(&ticks.list.len()), "{place}");
            assert!(ticks.list.len() >= 2 || most < 5, "{place}");
            for pair in ticks.list.windows(2) {
                assert!(pair[0].value < pair[1].value, "{place}");
                assert_ne!(pair[0].label, pair[1].label, "{place}");
            }
            let slack = 1e-8 * (high - low);
            let inside = low - slack..=high + slack;
            assert!(ticks.list.iter().all(|it| inside.contains(&it.value)), "{place}");
            assert!(ticks.minor.iter().all(|it| inside.contains(it)), "{place}");
        }
    }

    #[test]
    fn a_range_shows_all_values_with_a_margin() {
        let range = |scale, values: &[f64]| {
            let axis = Axis::of(scale, values.iter().copied(), None);
            [axis.low, axis.high]
        };
        assert_eq!(range(Scale::Linear, &[1.0, 10.0]), [0.0, 10.36]);
        assert_eq!(range(Scale::Linear, &[8.0, 10.0, f64::NAN]), [7.92, 10.08]);
        assert_eq!(range(Scale::Linear, &[-10.0, -1.0]), [-10.36, 0.0]);
        assert_eq!(range(Scale::Linear, &[4.0]), [1.84, 6.16]);
        assert_eq!(range(Scale::Linear, &[]), [0.0, 1.04]);
        let [low, high] = range(Scale::Log, &[0.0, 1.0, 100.0]);
        assert!(
            (low - 10f64.powf(-0.08)).abs() < 1e-12
                && (high / 100.0 - 10f64.powf(0.08)).abs() < 1e-12
        );
        let axis = Axis { scale: Scale::Log, low: 1.0, high: 100.0 };
        assert!((axis.place(10.0) - 0.5).abs() < 1e-15);
    }
}
