//! Colours and the sRGB transfer function.

/// Red, green, blue, 0 to 1. In linear light where nothing else is said.
pub type Color = [f32; 3];

/// A colour from its 8-bit sRGB values.
pub fn srgb(red: u8, green: u8, blue: u8) -> Color {
    [red, green, blue].map(|it| linear_from_srgb(f32::from(it) / 255.0))
}

/// The sRGB transfer function, inverted (IEC 61966-2-1).
pub fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB transfer function (IEC 61966-2-1).
pub fn srgb_from_linear(value: f32) -> f32 {
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

pub fn mix(from: Color, to: Color, t: f32) -> Color {
    [0, 1, 2].map(|it| from[it] + (to[it] - from[it]) * t)
}
