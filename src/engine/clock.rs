//! Time for people: run names and records. No result depends on it.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A moment as `2026-11-23T13:50:07Z`.
pub fn iso_utc(time: SystemTime) -> String {
    let [year, month, day, hour, minute, second] = civil(time);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// A moment as `20261123-135007`: sorts by time, and fits into a file name.
pub fn compact_utc(time: SystemTime) -> String {
    let [year, month, day, hour, minute, second] = civil(time);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

/// A duration as a person would say it: `12 ms`, `3.42 s`, `2m 31s`, `1h 04m`.
pub fn show_duration(duration: Duration) -> String {
    let secs = duration.as_secs_f64();
    let whole = duration.as_secs();
    match secs {
        s if s < 0.0995 => format!("{:.0} ms", s * 1e3),
        s if s < 60.0 => format!("{s:.2} s"),
        s if s < 3600.0 => format!("{}m {:02}s", whole / 60, whole % 60),
        _ => format!("{}h {:02}m", whole / 3600, whole / 60 % 60),
    }
}

/// Seconds that were written down as a person would say them. A damaged file may say anything.
pub fn show_secs(secs: f64) -> String {
    show_duration(Duration::try_from_secs_f64(secs).unwrap_or_default())
}

/// A number of bytes as a person would say it: `812 B`, `1.4 MB`.
pub fn show_bytes(bytes: u64) -> String {
    const UNITS: [&str; 4] = ["kB", "MB", "GB", "TB"];
    if bytes < 1000 {
        return format!("{bytes} B");
    }
    let mut value = bytes as f64 / 1000.0;
    let mut unit = 0;
    while value >= 999.5 && unit + 1 < UNITS.len() {
        value /= 1000.0;
        unit += 1;
    }
    let digits = if value < 9.95 { 1 } else { 0 };
    format!("{value:.digits$} {}", UNITS[unit])
}

/// Year, month, day, hour, minute, second in UTC.
fn civil(time: SystemTime) -> [i64; 6] {
    let secs = time.duration_since(UNIX_EPOCH).map_or(0, |it| it.as_secs() as i64);
    let (days, second_of_day) = (secs.div_euclid(86_400), secs.rem_euclid(86_400));
    // Days are counted from 1 March of year 0, so that leap days end a year; 400 years are an era.
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    [year, month, day, second_of_day / 3600, second_of_day / 60 % 60, second_of_day % 60]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments() {
        let at = |secs: u64| iso_utc(UNIX_EPOCH + Duration::from_secs(secs));
        assert_eq!(at(0), "1970-01-01T00:00:00Z");
        assert_eq!(at(951_827_696), "2000-02-29T12:34:56Z");
        assert_eq!(at(4_107_542_399), "2100-02-28T23:59:59Z");
        assert_eq!(compact_utc(UNIX_EPOCH + Duration::from_secs(86_400)), "19700102-000000");
    }

    #[test]
    fn amounts() {
        let durations = [(0.0123, "12 ms"), (0.5, "0.50 s"), (151.0, "2m 31s"), (3900.0, "1h 05m")];
        for (secs, text) in durations {
            assert_eq!(show_secs(secs), text);
        }
        assert_eq!([f64::NAN, -1.0, 1e300].map(show_secs), ["0 ms"; 3]);
        for (bytes, text) in [(812, "812 B"), (1_449_000, "1.4 MB"), (999_900, "1.0 MB")] {
            assert_eq!(show_bytes(bytes), text);
        }
    }
}
