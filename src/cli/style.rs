//! The few colours of the command line. They go through `anstream`, which drops them where they do
//! not belong (`NO_COLOR`, no terminal, `--color never`).

use anstyle::{AnsiColor, Style};

pub const HEAD: Style = AnsiColor::Cyan.on_default().bold();
pub const GOOD: Style = AnsiColor::Green.on_default().bold();
pub const CACHED: Style = AnsiColor::Blue.on_default();
pub const WARN: Style = AnsiColor::Yellow.on_default().bold();
pub const BAD: Style = AnsiColor::Red.on_default().bold();
pub const NOTE: Style = Style::new().dimmed();
