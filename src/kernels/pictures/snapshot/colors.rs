//! Colours of surfaces and colour maps.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::maps::functional_map::PointMap;
use crate::kernels::pictures::canvas::color::{linear_from_srgb, mix};
use crate::kernels::rigs::weights::SkinWeights;

pub use crate::kernels::pictures::canvas::color::Color;

/// Surfaces of figures that show no values, one after the other.
pub const BODIES: [Color; 4] =
    [[0.397, 0.539, 0.708], [0.831, 0.558, 0.381], [0.474, 0.631, 0.434], [0.597, 0.497, 0.723]];

/// Viridis (van der Walt & Smith 2015) for `t` from 0 to 1: dark violet to yellow, with even steps
/// for the eye and for colour-blind eyes. A fit of degree 6, off by less than 2 % of a channel.
pub fn viridis(t: f64) -> Color {
    const FIT: [[f64; 3]; 7] = [
        [0.277_727_3, 0.005_407_3, 0.334_099_8],
        [0.105_093_0, 1.404_613_5, 1.384_590_2],
        [-0.330_861_8, 0.214_847_6, 0.095_095_2],
        [-4.634_230_5, -5.799_101_0, -19.332_441],
        [6.228_269_9, 14.179_933, 56.690_553],
        [4.776_385_0, -13.745_145, -65.353_033],
        [-5.435_455_9, 4.645_852_6, 26.312_435],
    ];
    let t = t.clamp(0.0, 1.0);
    [0, 1, 2].map(|channel| {
        let value = FIT.iter().rev().fold(0.0, |res, it| res * t + it[channel]);
        linear_from_srgb(value.clamp(0.0, 1.0) as f32)
    })
}

/// Blue over near white to red for `t` from -1 to 1 (RdBu of Brewer & Harrower, without its ends).
pub fn diverging(t: f64) -> Color {
    const STOPS: [[u8; 3]; 7] = [
        [33, 102, 172],
        [103, 169, 207],
        [209, 229, 240],
        [247, 247, 247],
        [253, 219, 199],
        [239, 138, 98],
        [178, 24, 43],
    ];
    let place = (t.clamp(-1.0, 1.0) + 1.0) / 2.0 * (STOPS.len() - 1) as f64;
    let below = (place as usize).min(STOPS.len() - 2);
    let [from, to] = [below, below + 1].map(|it| STOPS[it].map(|it| f32::from(it) / 255.0));
    mix(from, to, (place - below as f64) as f32).map(linear_from_srgb)
}

/// How values become colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ColorMap {
    /// From the least value to the greatest: violet, green, yellow.
    #[default]
    Viridis,
    /// About zero, as far as the largest magnitude: blue, white, red.
    Diverging,
}

/// Colours of a function on vertices, over its own range; values that are not finite are grey.
pub fn function_colors(values: &[f64], map: ColorMap) -> Vec<Color> {
    let finite = values.iter().copied().filter(|it| it.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), it| (l.min(it), h.max(it)));
    let reach = low.abs().max(high.abs());
    let color = |&value: &f64| match map {
        _ if !value.is_finite() => [0.5; 3],
        ColorMap::Viridis if high > low => viridis((value - low) / (high - low)),
        ColorMap::Viridis => viridis(0.5),
        ColorMap::Diverging if reach > 0.0 => diverging(value / reach),
        ColorMap::Diverging => diverging(0.0),
    };
    values.iter().map(color).collect()
}

/// Colours of skin weights: one hue a joint, mixed by the weights.
pub fn weight_colors(weights: &SkinWeights) -> Vec<Color> {
    (0..weights.n_vertices())
        .map(|vertex| {
            weights.row(vertex).fold([0.0; 3], |sum, (joint, weight)| {
                let color = joint_color(joint as usize);
                [0, 1, 2].map(|it| sum[it] + weight as f32 * color[it])
            })
        })
        .collect()
}

/// Hues a golden angle apart, in three tiers of lightness, so that neighbours in the tree differ.
pub fn joint_color(joint: usize) -> Color {
    let hue_rad = (joint as f32 * 137.507_76 + 20.0).to_radians();
    let lightness = [0.74, 0.64, 0.82][joint % 3];
    oklab(lightness, 0.115 * hue_rad.cos(), 0.115 * hue_rad.sin())
}

/// Colours by place in the bounding box, each of the three directions another change of colour.
pub fn position_colors(mesh: &TriMesh) -> Vec<Color> {
    let (low, high) = mesh.bounds();
    let extent = high - low;
    let unit = |point: &Vec3, axis: usize| {
        let extent = if extent[axis] > 0.0 { extent[axis] } else { 1.0 };
        ((point[axis] - low[axis]) / extent) as f32
    };
    mesh.vertices()
        .iter()
        .map(|it| {
            let [x, y, z] = [0, 1, 2].map(|axis| 2.0 * unit(it, axis) - 1.0);
            // Hue turns with the height and leans to the sides; lightness tells front from back.
            let hue_rad = 2.4 * y + 1.2;
            oklab(
                0.70 + 0.08 * z + 0.04 * x,
                0.11 * hue_rad.cos() + 0.07 * x,
                0.11 * hue_rad.sin() - 0.05 * x,
            )
        })
        .collect()
}

/// The colours of a target, brought to the source by a map of points.
pub fn matched_colors(map: &PointMap, target: &[Color]) -> Vec<Color> {
    map.target_of_source.iter().map(|&it| target[it as usize]).collect()
}

/// Oklab (Ottosson 2020) to linear sRGB, clipped.
fn oklab(lightness: f32, a: f32, b: f32) -> Color {
    let l = (lightness + 0.396_337_78 * a + 0.215_803_76 * b).powi(3);
    let m = (lightness - 0.105_561_346 * a - 0.063_854_17 * b).powi(3);
    let s = (lightness - 0.089_484_18 * a - 1.291_485_5 * b).powi(3);
    [
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_93 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_4 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    ]
    .map(|it| it.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::pictures::canvas::color::{srgb, srgb_from_linear};

    fn bytes(color: Color) -> [i32; 3] {
        color.map(|it| (srgb_from_linear(it) * 255.0).round() as i32)
    }

    #[track_caller]
    fn assert_near(color: Color, expected: [i32; 3]) {
        let found = bytes(color);
        let off = (0..3).map(|it| (found[it] - expected[it]).abs()).max().unwrap();
        assert!(off <= 8, "{found:?} is not {expected:?}");
    }

    #[test]
    fn viridis_has_its_published_colours() {
        assert_near(viridis(0.0), [68, 1, 84]);
        assert_near(viridis(0.25), [59, 82, 139]);
        assert_near(viridis(0.5), [33, 145, 140]);
        assert_near(viridis(0.75), [94, 201, 98]);
        assert_near(viridis(1.0), [253, 231, 37]);
    }

    #[test]
    fn zero_is_white_in_the_diverging_map_whatever_the_range() {
        let colors = function_colors(&[-1.0, 0.0, 10.0, f64::NAN], ColorMap::Diverging);
        assert_near(colors[1], [247, 247, 247]);
        assert_near(colors[2], [178, 24, 43]);
        assert_eq!(colors[3], [0.5; 3]);
    }

    #[test]
    fn srgb_and_linear_are_inverse() {
        for value in 0..=255u8 {
            assert_eq!(bytes(srgb(value, 0, 255)), [i32::from(value), 0, 255]);
        }
    }

    #[test]
    fn oklab_without_colour_is_grey() {
        let grey = oklab(0.5, 0.0, 0.0);
        assert!((grey[0] - grey[1]).abs() < 1e-4 && (grey[1] - grey[2]).abs() < 1e-4);
    }
}
