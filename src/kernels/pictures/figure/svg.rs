//! Figures as SVG, with texts that can be searched and copied.

use std::fmt::Write as _;

use super::scene::{Anchor, Figure, Look, Mark, Point, Rgb, Shape};

/// Writes a figure; the same figure gives the same bytes. It is white whatever page it is on.
pub fn write_svg(figure: &Figure) -> String {
    let (width, height) = (figure.width, figure.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"{width}\" height=\"{height}\" role=\"img\" \
         font-family=\"Helvetica, Arial, 'Liberation Sans', sans-serif\">\n"
    );
    if !figure.title.is_empty() {
        let _ = writeln!(out, "<title>{}</title>", escaped(&figure.title));
    }
    let _ = writeln!(out, "<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>");
    for mark in &figure.marks {
        write_mark(&mut out, mark);
    }
    out + "</svg>\n"
}

fn write_mark(out: &mut String, mark: &Mark) {
    let points = &mark.points;
    let _ = match &mark.look {
        Look::Line { color, width, dash } => {
            let (list, color, width) = (listed(points), hex(*color), number(*width));
            let dashes = dash.map_or(String::new(), |[stroke, gap]| {
                format!(" stroke-dasharray=\"{} {}\"", number(stroke), number(gap))
            });
            writeln!(
                out,
                "<polyline points=\"{list}\" fill=\"none\" stroke=\"{color}\" \
                 stroke-width=\"{width}\" stroke-linecap=\"round\" stroke-linejoin=\"round\"{dashes}/>"
            )
        }
        Look::Area { color, opacity } => {
            let (list, paint) = (listed(points), paint(*color, *opacity));
            writeln!(out, "<polygon points=\"{list}\"{paint}/>")
        }
        Look::Dots { shape, color, opacity, radius } => {
            write_dots(out, points, *shape, &paint(*color, *opacity), *radius)
        }
        Look::Text { text, size, anchor, angle_deg, color } => {
            let [x, y] = points[0].map(number);
            let anchor = match anchor {
                Anchor::Start => "",
                Anchor::Middle => " text-anchor=\"middle\"",
                Anchor::End => " text-anchor=\"end\"",
            };
            let turn = match *angle_deg {
                0.0 => String::new(),
                angle => format!(" transform=\"rotate({} {x} {y})\"", number(-angle)),
            };
            let (size, color, text) = (number(*size), hex(*color), escaped(text));
            writeln!(
                out,
                "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\"{anchor} fill=\"{color}\"{turn}>\
                 {text}</text>"
            )
        }
    };
}

fn write_dots(
    out: &mut String,
    points: &[Point],
    shape: Shape,
    paint: &str,
    radius: f64,
) -> std::fmt::Result {
    writeln!(out, "<g{paint}>")?;
    for &[x, y] in points {
        let corners = shape.corners([x, y], radius);
        if corners.is_empty() {
            let (x, y, radius) = (number(x), number(y), number(radius));
            writeln!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"/>")?;
        } else {
            writeln!(out, "<polygon points=\"{}\"/>", listed(&corners))?;
        }
    }
    writeln!(out, "</g>")
}

fn paint(color: Rgb, opacity: f64) -> String {
    let opacity = match opacity {
        1.0 => String::new(),
        _ => format!(" fill-opacity=\"{}\"", number(opacity)),
    };
    format!(" fill=\"{}\"{opacity}", hex(color))
}

fn listed(points: &[Point]) -> String {
    let points = points.iter().map(|it| format!("{},{}", number(it[0]), number(it[1])));
    points.collect::<Vec<_>>().join(" ")
}

fn hex([red, green, blue]: Rgb) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// Two digits after the point at most.
fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// What XML does not allow becomes a replacement character.
fn escaped(text: &str) -> String {
    let mut res = String::new();
    for letter in text.chars() {
        match letter {
            '&' => res += "&amp;",
            '<' => res += "&lt;",
            '>' => res += "&gt;",
            '"' => res += "&quot;",
            '\n' | '\r' | '\t' => res.push(' '),
            '\u{0}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}' => res.push('\u{fffd}'),
            _ => res.push(letter),
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_written_with_texts_escaped() {
        let look = Look::Text {
            text: "a < b & \"c\"\u{1}".to_owned(),
            size: 10.5,
            anchor: Anchor::End,
            angle_deg: 90.0,
            color: [255, 0, 16],
        };
        let line = Look::Line { color: [0; 3], width: 1.0, dash: Some([4.0, 3.5]) };
        let marks = vec![
            Mark::new(&[[1.0, 2.004]], look),
            Mark::new(&[[0.1 + 0.2, -0.001], [5.0, 6.5]], line),
        ];
        let svg = write_svg(&Figure { title: "x > y".to_owned(), width: 64, height: 65, marks });
        for part in [
            "<title>x &gt; y</title>",
            "<text x=\"1\" y=\"2\" font-size=\"10.5\" text-anchor=\"end\" fill=\"#ff0010\" \
             transform=\"rotate(-90 1 2)\">a &lt; b &amp; &quot;c&quot;\u{fffd}</text>",
            "<polyline points=\"0.3,0 5,6.5\" fill=\"none\" stroke=\"#000000\" stroke-width=\"1\"",
            "stroke-dasharray=\"4 3.5\"/>",
        ] {
            assert!(svg.contains(part), "{part}\n{svg}");
        }
    }
}
