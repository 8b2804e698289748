//! Whole figures.

use super::clip::Rect;
use super::measure::text_width;
use super::scene::Anchor;
use super::*;
use crate::kernels::numerics::random::Random;
use crate::kernels::table::Column;

/// Rows of two methods over four sizes, each with three repetitions.
fn measured() -> Table {
    let (mut methods, mut sizes, mut times) = (Vec::new(), Vec::new(), Vec::new());
    for (method, factor, exponent) in [("ours", 1e-4, 1.1), ("theirs", 2e-5, 1.6)] {
        for size in [1000.0, 2000.0, 5000.0, 20_000.0] {
            for noise in [0.9, 1.0, 1.1] {
                methods.push(method.to_owned());
                sizes.push(size);
                times.push(factor * f64::powf(size, exponent) * noise);
            }
        }
    }
    Table::new(vec![
        Column::texts("method", methods),
        Column::numbers("vertices", "", sizes),
        Column::numbers("time", "s", times),
    ])
}

fn options(style: Style) -> FigureOptions {
    let y = if style == Style::Cdf { Vec::new() } else { vec!["time".to_owned()] };
    let x = match style {
        Style::Cdf => "time",
        Style::Bars | Style::Box => "method",
        _ => "vertices",
    };
    FigureOptions {
        x: Some(x.to_owned()),
        y,
        group: Some("method".to_owned()),
        title: "a title".to_owned(),
        ..FigureOptions::new(style)
    }
}

const STYLES: [Style; 5] = [Style::Curve, Style::Cdf, Style::Bars, Style::Scatter, Style::Box];

/// Where a level text is.
fn text_box(mark: &Mark) -> Option<Rect> {
    let Look::Text { text, size, anchor, angle_deg: 0.0, .. } = &mark.look else { return None };
    let width = text_width(text, *size);
    let [x, y] = mark.points[0];
    let start = match anchor {
        Anchor::Start => x,
        Anchor::Middle => x - width / 2.0,
        Anchor::End => x - width,
    };
    Some(Rect { low: [start, y - 0.72 * size], high: [start + width, y] })
}

/// Level texts lie within the figure and apart from each other, and the scene can be stored.
fn assert_sound(figure: &Figure) {
    figure.check().unwrap();
    let boxes: Vec<(Rect, &str)> = figure
        .marks
        .iter()
        .filter(|it| text_box(it).is_some())
        .zip(0..)
        .map(|(it, _)| {
            let Look::Text { text, .. } = &it.look else { unreachable!() };
            (text_box(it).unwrap(), text.as_str())
        })
        .collect();
    let page = [figure.width as f64, figure.height as f64];
    for (index, (a, text)) in boxes.iter().enumerate() {
        let inside = (0..2).all(|it| a.low[it] >= -0.5 && a.high[it] <= page[it] + 0.5);
        assert!(inside, "`{text}` at {a:?} on {page:?}");
        for (b, other) in &boxes[index + 1..] {
            let overlap = (0..2).all(|it| a.low[it] < b.high[it] && b.low[it] < a.high[it]);
            assert!(!overlap, "`{text}` and `{other}` overlap: {a:?}, {b:?}");
        }
    }
}

#[test]
fn every_style_is_drawn_the_same_twice_with_its_labels() {
    for style in STYLES {
        let options = options(style);
        options.check().unwrap();
        let drawn = draw_figure(&measured(), &options).unwrap();
        assert_eq!(drawn, draw_figure(&measured(), &options).unwrap());
        assert_sound(&drawn.figure);
        let texts: Vec<&str> = drawn.figure.texts().collect();
        for text in ["a title", "ours", "theirs", "time [s]"] {
            assert!(texts.contains(&text), "{style:?}: {text} in {texts:?}");
        }
        let (svg, png) = (write_svg(&drawn.figure), draw_png(&drawn.figure));
        assert!(texts.iter().all(|it| svg.contains(&format!(">{it}</text>"))), "{svg}");
        assert_eq!((png.width, png.height), (960, 640));
        let n_dark = png.pixels.iter().filter(|it| it.iter().all(|&c| c < 120)).count();
        assert!(n_dark > 500, "{style:?}: {n_dark} dark pixels");
    }
}

#[test]
fn a_fit_on_logarithmic_axes_finds_the_exponents() {
    let mut options = options(Style::Scatter);
    (options.x_scale, options.y_scale, options.fit) = (Scale::Log, Scale::Log, true);
    let drawn = draw_figure(&measured(), &options).unwrap();
    let texts: Vec<&str> = drawn.figure.texts().collect();
    assert!(texts.iter().any(|it| it.starts_with("ours: exponent 1.10, R² = 0.99")), "{texts:?}");
    assert!(texts.iter().any(|it| it.starts_with("theirs: exponent 1.60, R²")), "{texts:?}");
    assert!(drawn.notes[1].starts_with("theirs: time = "), "{:?}", drawn.notes);
}

#[test]
fn what_has_no_place_is_left_out_and_counted() {
    let mut table = measured();
    let mut times = table.numbers("time", "a test").unwrap().to_vec();
    (times[0], times[1], times[2]) = (f64::NAN, f64::INFINITY, -1.0);
    table.columns[2] = Column::numbers("time", "s", times);
    let mut options = options(Style::Scatter);
    let note = |n: usize| {
        format!(
            "{n} of 24 rows of `time` are not drawn: a number is missing or has no place on its axis"
        )
    };
    assert_eq!(draw_figure(&table, &options).unwrap().notes, [note(2)]);
    options.y_scale = Scale::Log;
    assert_eq!(draw_figure(&table, &options).unwrap().notes, [note(3)]);
    let nothing = table.rows(&[0, 1]);
    let error = draw_figure(&nothing, &options).unwrap_err().to_string();
    assert_eq!(error, "there is nothing to draw: no row has numbers in `vertices` and `time`");
}

#[test]
fn reference_lines_are_labelled_or_told() {
    let line = |y: f64| ReferenceLine { x: None, y: Some(y), label: "paper".to_owned() };
    let mut options = options(Style::Bars);
    options.lines = vec![line(1.0)];
    let drawn = draw_figure(&measured(), &options).unwrap();
    assert!(drawn.figure.texts().any(|it| it == "paper"));
    (options.lines, options.y_range) = (vec![line(5.0)], Some([0.0, 4.0]));
    let drawn = draw_figure(&measured(), &options).unwrap();
    assert_eq!(drawn.notes, ["the line at y = 5 lies outside of the axes"]);
}

#[test]
fn parameters_of_another_style_are_refused() {
    let check = |change: &dyn Fn(&mut FigureOptions), style: Style, expected: &str| {
        let mut options = options(style);
        change(&mut options);
        assert_eq!(options.check().unwrap_err(), expected);
    };
    check(&|it| it.fit = true, Style::Curve, "`fit` does not belong to the figure \"curve\"");
    check(&|it| it.x = None, Style::Scatter, "figure \"scatter\" needs `x`, the name of a column");
    check(&|it| it.y.clear(), Style::Box, "figure \"box\" needs `y`, the name of a column");
    check(&|it| it.x_range = Some([2.0, 1.0]), Style::Curve, "`x_range` goes from 2 to 1");
    let log = |it: &mut FigureOptions| {
        it.y_scale = Scale::Log;
        it.y_range = Some([0.0, 1.0]);
    };
    check(&log, Style::Curve, "`y_range` begins at 0, which a logarithmic axis cannot show");
    let rule = |it: &mut FigureOptions| {
        it.lines = vec![ReferenceLine { x: Some(1.0), y: None, label: String::new() }];
    };
    check(&rule, Style::Bars, "`lines[0].x`: figure \"bars\" has no numbers at x");
}

#[test]
fn columns_of_one_axis_have_one_unit() {
    let mut options = options(Style::Curve);
    options.y = vec!["time".to_owned(), "vertices".to_owned()];
    let error = draw_figure(&measured(), &options).unwrap_err().to_string();
    assert_eq!(error, "`time` is in `s`, but `vertices` in ``: one axis cannot show both");
}

/// Random tables, styles and sizes: whatever is drawn is sound, or the error says why not.
#[test]
fn labels_never_overlap_in_random_figures() {
    let mut random = Random::new(5);
    let mut below = move |n: usize| random.next_u64() as usize % n;
    let words = ["horse", "functional maps", "a", "ours (with landmarks)", "wolf to fox"];
    let mut n_drawn = 0;
    for _ in 0..400 {
        let n_rows = 1 + below(40);
        let size = 10f64.powi(below(16) as i32 - 8);
        let mut value = |n: usize| below(n) as f64 / n as f64 * size;
        let x = (0..n_rows).map(|_| value(10)).collect();
        let y = (0..n_rows).map(|_| value(1000)).collect();
        let mut word = |n: usize| format!("{}{}", words[below(5)], below(n));
        let names = (0..n_rows).map(|_| word(3)).collect();
        let groups = (0..n_rows).map(|_| word(2)).collect();
        let table = Table::new(vec![
            Column::numbers("vertices", "", x),
            Column::numbers("time", "s", y),
            Column::texts("method", names),
            Column::texts("group", groups),
        ]);
        let mut options = options(STYLES[below(5)]);
        options.group = Some("group".to_owned()).filter(|_| below(2) == 0);
        (options.width, options.height) = (160 + below(600), 160 + below(400));
        let is_by_number = !matches!(options.style, Style::Bars | Style::Box);
        if below(3) == 0 && options.style != Style::Cdf {
            options.y_scale = Scale::Log;
        }
        if below(3) == 0 && is_by_number {
            options.x_scale = Scale::Log;
        }
        options.check().unwrap();
        match draw_figure(&table, &options) {
            Ok(drawn) => {
                assert_sound(&drawn.figure);
                n_drawn += 1;
            }
            Err(FigureError::TooSmall { .. } | FigureError::Nothing { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    assert!(n_drawn > 250, "{n_drawn} of 400");
}
