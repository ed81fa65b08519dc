//! Colours: a view with its shadows, and where two answers differ. For eyes only: f32, equal from run to run.

use rayon::prelude::*;

use super::image::RgbImage;
use super::scene::View;

/// Colours (linear light) for components, in turn.
const PALETTE: [[f32; 3]; 8] = [
    [0.56, 0.53, 0.46],
    [0.56, 0.30, 0.22],
    [0.30, 0.42, 0.50],
    [0.60, 0.47, 0.25],
    [0.34, 0.44, 0.28],
    [0.50, 0.36, 0.42],
    [0.42, 0.40, 0.55],
    [0.55, 0.52, 0.48],
];
const SUN: [f32; 3] = [1.34, 1.22, 1.02];
const SKY: [f32; 3] = [0.25, 0.33, 0.46];
const GROUND: [f32; 3] = [0.16, 0.14, 0.11];
const HORIZON: [f32; 3] = [0.66, 0.75, 0.86];
const ZENITH: [f32; 3] = [0.16, 0.34, 0.68];

/// The colours for shaders: constants in WGSL under the same names, and the size of the palette.
#[cfg(feature = "gpu")]
pub(crate) fn constants() -> String {
    let vector = |c: [f32; 3]| format!("vec3<f32>({:?}, {:?}, {:?})", c[0], c[1], c[2]);
    let names = [("SUN", SUN), ("SKY", SKY), ("GROUND", GROUND), ("HORIZON", HORIZON), ("ZENITH", ZENITH)];
    let single = names.map(|(name, c)| format!("const {name} = {};\n", vector(c))).concat();
    let palette = PALETTE.map(vector).join(", ");
    let size = PALETTE.len();
    format!("{single}const PALETTE_SIZE = {size}u;\nconst PALETTE = array<vec3<f32>, {size}>({palette});\n")
}

/// What [`shade`] may vary.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shading<'a> {
    /// Number of the connected component of each triangle: one colour for each. Without it, colours follow the normal.
    pub components: Option<&'a [u32]>,
    /// Distance in world units at which half of a colour is lost to the haze; none without it.
    pub haze: Option<f64>,
}

/// Coverage for [`shade`]: 255 where lit, 0 in shadow.
pub fn coverage(lit: &[bool]) -> Vec<u8> {
    lit.iter().map(|&l| if l { 255 } else { 0 }).collect()
}

/// Sun and sky on matt surfaces. `lit` holds for each pixel the share of sunlight that arrives, 0 to 255.
///
/// # Panics
/// If `lit` does not have one entry per pixel.
pub fn shade(view: &View, lit: &[u8], shading: Shading<'_>) -> RgbImage {
    assert_eq!(lit.len(), view.receivers.len(), "one coverage per pixel");
    let pixels = (0..lit.len()).into_par_iter().map(|i| pixel(view, i, f32::from(lit[i]) / 255.0, shading)).collect();
    RgbImage { width: view.width, height: view.height, pixels }
}

fn pixel(view: &View, i: usize, lit: f32, shading: Shading<'_>) -> [u8; 3] {
    let up = view.camera.up_axis().vector().map(|v| v as f32);
    let Some(receiver) = &view.receivers[i] else {
        return encode(sky(dot(view.points[i].map(|v| v as f32), up)));
    };
    let n = view.normals[i];
    let albedo = match shading.components {
        Some(of) => PALETTE[of.get(receiver.triangle as usize).map_or(0, |&c| c as usize % PALETTE.len())],
        // Sides a little apart from each other, tops lightest.
        None => mix([0.46, 0.42, 0.40], [0.60, 0.57, 0.51], 0.5 + 0.5 * dot(n, up)),
    };
    let sun = -dot(n, view.light.map(|v| v as f32));
    let dome = mix(GROUND, SKY, 0.5 + 0.5 * dot(n, up));
    let colour = std::array::from_fn(|k| albedo[k] * (dome[k] + SUN[k] * sun.max(0.0) * lit));
    let haze = shading.haze.map_or(0.0, |half| 1.0 - (-view.distances[i] / half).exp2() as f32);
    encode(mix(colour, HORIZON, haze.clamp(0.0, 1.0)))
}

fn sky(height: f32) -> [f32; 3] {
    mix(HORIZON, ZENITH, height.clamp(0.0, 1.0).sqrt())
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn mix(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
}

/// Linear light to sRGB bytes (IEC 61966-2-1), clipped.
fn encode(colour: [f32; 3]) -> [u8; 3] {
    colour.map(|v| {
        let v = v.clamp(0.0, 1.0);
        let s = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (s * 255.0).round() as u8
    })
}

/// Where two answers differ: black where they agree; on texels that `edge` marks dark blue where only `a` is lit and
/// orange where only `b` is; red everywhere else, which no map may show against the reference.
///
/// # Panics
/// If a slice does not have `width * height` entries.
pub fn difference(width: u32, height: u32, a: &[bool], b: &[bool], edge: &[bool]) -> RgbImage {
    let count = width as usize * height as usize;
    assert!([a, b, edge].iter().all(|s| s.len() == count), "one answer per pixel");
    let pixels = (0..count)
        .map(|i| match (a[i] == b[i], edge[i], a[i]) {
            (true, ..) => [0, 0, 0],
            (false, false, _) => [255, 0, 0],
            (false, true, true) => [24, 48, 140],
            (false, true, false) => [255, 150, 30],
        })
        .collect();
    RgbImage { width, height, pixels }
}

#[cfg(test)]
mod tests {
    use super::super::camera::{Camera, UpAxis};
    use super::super::scene::Scene;
    use super::super::testing::{Rng, boxes};
    use super::*;

    #[test]
    fn shadows_are_darker_and_the_sky_is_left_alone() {
        let mesh = boxes(&mut Rng(41), 12, 20);
        let scene = Scene::new(mesh.surface());
        let camera = Camera::new([1.6, 1.4, 2.2], [0.0, 0.2, 0.0], UpAxis::Y, 60.0).unwrap();
        let view = scene.view(&camera, 60, 40, &|| true).unwrap();
        let all = vec![true; 60 * 40];
        let components: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| t / 12).collect();
        for shading in [Shading::default(), Shading { components: Some(&components), haze: Some(5.0) }] {
            let bright = shade(&view, &coverage(&all), shading);
            let dark = shade(&view, &vec![0; all.len()], shading);
            assert_eq!(bright, shade(&view, &coverage(&all), shading));
            let sum = |p: [u8; 3]| p.iter().map(|&v| u32::from(v)).sum::<u32>();
            let (mut tops, mut skies) = (0, 0);
            for i in 0..all.len() {
                let (b, d) = (sum(bright.pixels[i]), sum(dark.pixels[i]));
                if view.receivers[i].is_none() {
                    assert_eq!(b, d);
                    skies += 1;
                } else if view.normals[i][1] > 0.9 {
                    assert!(b > d + 100, "{b} {d}");
                    tops += 1;
                } else {
                    assert_eq!(b, d, "walls along the light get none of it");
                }
            }
            assert!(tops > 100 && skies > 100, "{tops} {skies}");
        }
    }

    #[test]
    fn differences_have_their_colours() {
        let (t, f) = (true, false);
        let image = difference(3, 2, &[t, f, t, f, t, f], &[t, f, f, t, f, t], &[f, t, f, f, t, t]);
        let red = [255, 0, 0];
        assert_eq!(image.pixels, [[0; 3], [0; 3], red, red, [24, 48, 140], [255, 150, 30]]);
    }

    #[test]
    fn srgb() {
        assert_eq!(encode([0.0, 1.0, 2.0]), [0, 255, 255]);
        assert_eq!(encode([0.002, 0.216, 0.5]), [7, 128, 188]);
    }
}
