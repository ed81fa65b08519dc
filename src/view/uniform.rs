//! What a frame tells the device: the camera on the lattice, the light, how to look the map up.

use umbrage_format::projection::Lattice;

use super::{Overlay, Style};
use crate::render::{Camera, Filter, Look, STEEPEST, cross, dot, normalised};

/// Twin of `Picture` in picture.wgsl.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Uniform {
    eye: [u32; 3],
    subtexel_bits: u32,
    rest: [f32; 3],
    near: f32,
    clip: [[f32; 4]; 3],
    ray: [[f32; 4]; 3],
    sky: [[f32; 4]; 3],
    world: [[f32; 4]; 3],
    light: [f32; 4],
    up: [f32; 4],
    look: [u32; 4],
    triangles: u32,
    log2_resolution: u32,
    unused: [u32; 2],
}

/// What stays from frame to frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub lattice: Lattice,
    /// Word of the mesh at which triangles begin.
    pub triangles_at: u32,
    /// World length of the map's diagonal.
    pub extent: f64,
}

/// Part of the map's diagonal at which the near plane stands.
const NEAR: f64 = 1e-5;

/// Names of the ways to look the map up, as the shader has them.
pub(super) const LOOKS: [&str; 5] = ["HARD", "PLACE", "PCF", "HPCF", "TRILINEAR"];

fn code(look: Look) -> [u32; 2] {
    match look {
        Look::Texel => [0, 1],
        Look::Place => [1, 1],
        Look::Filtered(Filter::Pcf(side)) => [2, side],
        Look::Filtered(Filter::Hierarchical(side)) => [3, side],
        Look::Filtered(Filter::Trilinear(side)) => [4, side],
    }
}

/// The number of what is laid over the picture, as the shader has it.
pub(super) fn overlay_code(overlay: Option<Overlay>) -> u32 {
    overlay.map_or(0, |o| 1 + Overlay::ALL.iter().position(|a| *a == o).unwrap_or(0) as u32)
}

fn single<const N: usize>(v: [f64; N]) -> [f32; N] {
    v.map(|v| v as f32)
}

impl Frame {
    /// Of a map and the mesh that was baked into it.
    pub fn new(lattice: Lattice, triangles_at: u32) -> Self {
        let steps = lattice_steps(&lattice);
        let [x, y] = [0, 1].map(|k| dot(steps[k], steps[k]).sqrt() * lattice.side() as f64);
        Self { lattice, triangles_at, extent: x.hypot(y) }
    }

    /// The words of a frame of `size` pixels.
    pub fn uniform(&self, camera: &Camera, size: [u32; 2], style: &Style, structure: u32) -> Uniform {
        let lattice = &self.lattice;
        let m = lattice.world_to_lattice.map(|r| [r[0], r[1], r[2]]);
        let steps = lattice_steps(lattice);
        let at = lattice.to_lattice(camera.eye());
        // An eye beyond the lattice has the rest in f32.
        let eye = at.map(|v| v.floor().clamp(0.0, f64::from(u32::MAX)) as u32);
        let rest = [0, 1, 2].map(|k| at[k] - f64::from(eye[k]));
        let [right, up, forward] = camera.axes();
        let half = camera.half(size[0], size[1]);
        let row = |axis: [f64; 3], scale: f64| steps.map(|s| dot(axis, s) / scale);
        let clip = [row(right, half[0]), row(up, half[1]), row(forward, 1.0)];
        // The ray of the upper left corner, and what a pixel adds.
        let [w, h] = size.map(f64::from);
        let corner = [0, 1, 2].map(|k| forward[k] - half[0] * right[k] + half[1] * up[k]);
        let across = right.map(|v| v * 2.0 * half[0] / w);
        let down = up.map(|v| -v * 2.0 * half[1] / h);
        let sky = [corner, across, down];
        // Of any length, all of one: lattice steps are powers of many ten.
        let ray = sky.map(|way| m.map(|r| dot(r, way)));
        let longest = ray.iter().flatten().fold(0.0f64, |most, v| most.max(v.abs()));
        let ray = ray.map(|r| r.map(|v| v / longest));
        let lengths = steps.map(|s| dot(s, s).sqrt());
        let handed = if dot(cross(m[0], m[1]), m[2]) < 0.0 { -1.0 } else { 1.0 };
        let light = normalised(cross(m[0], m[1]).map(|v| v * handed)).unwrap_or([0.0; 3]);
        // A normal is a covector: it goes back by the transposed matrix; its length says nothing.
        let largest = m.iter().flatten().fold(0.0f64, |most, v| most.max(v.abs()));
        let world = [0, 1, 2].map(|k| single([m[k][0] / largest, m[k][1] / largest, m[k][2] / largest, lengths[k]]));
        let steepest = STEEPEST * lengths[0] / lengths[2];
        let [mode, side] = code(style.look);
        let four = |v: [f64; 3]| single([v[0], v[1], v[2], 0.0]);
        let [lx, ly, lz] = light;
        Uniform {
            eye,
            subtexel_bits: lattice.subtexel_bits.into(),
            rest: single(rest),
            near: (self.extent * NEAR) as f32,
            clip: clip.map(four),
            ray: ray.map(four),
            sky: sky.map(four),
            world,
            light: single([lx, ly, lz, steepest]),
            up: four(camera.up_axis().vector()),
            look: [mode, side, overlay_code(style.overlay), structure],
            triangles: self.triangles_at,
            log2_resolution: lattice.log2_resolution.into(),
            unused: [0; 2],
        }
    }
}

/// A step of the lattice along each of its axes, in world units: columns of the inverse.
pub(super) fn lattice_steps(lattice: &Lattice) -> [[f64; 3]; 3] {
    let [a, b, c] = lattice.world_to_lattice.map(|r| [r[0], r[1], r[2]]);
    let volume = dot(cross(a, b), c);
    [cross(b, c), cross(c, a), cross(a, b)].map(|v| v.map(|v| v / volume))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::UpAxis;

    fn lattice() -> Lattice {
        let m = [[1e6, 2e5, 0.0, 5e8], [-2e5, 1e6, 3e4, 7e8], [1e3, -4e6, 2e6, 2e9]];
        Lattice { world_to_lattice: m, log2_resolution: 20, subtexel_bits: 10 }
    }

    #[test]
    fn steps_are_the_inverse() {
        let l = lattice();
        let steps = lattice_steps(&l);
        for (i, row) in l.world_to_lattice.iter().enumerate() {
            for (j, step) in steps.iter().enumerate() {
                let one = dot([row[0], row[1], row[2]], *step);
                assert!((one - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j} {one}");
            }
        }
    }

    /// A point of the world falls on the pixel whose ray meets it, by clip coordinates and by rays.
    #[test]
    fn clip_and_rays_agree_with_the_camera() {
        let camera = Camera::new([3.0, 40.0, -7.0], [30.0, 2.0, 11.0], UpAxis::Y, 50.0).unwrap();
        let style = Style { look: Look::Texel, overlay: None };
        let size = [640, 360];
        let u = Frame::new(lattice(), 0).uniform(&camera, size, &style, 0);
        for [px, py] in [[0.5, 0.5], [639.5, 0.5], [320.0, 180.0], [17.0, 300.0]] {
            let way = camera.ray(px, py, size[0], size[1]);
            let world: [f64; 3] = std::array::from_fn(|k| camera.eye()[k] + 25.0 * way[k]);
            let at = lattice().to_lattice(world);
            let p: [f64; 3] = std::array::from_fn(|k| at[k] - f64::from(u.eye[k]) - f64::from(u.rest[k]));
            let clip = u.clip.map(|r| dot([r[0], r[1], r[2]].map(f64::from), p));
            let [x, y] = [clip[0] / clip[2], clip[1] / clip[2]];
            assert!(((x + 1.0) * 320.0 - px).abs() < 1e-2 && ((1.0 - y) * 180.0 - py).abs() < 1e-2, "{x} {y}");
            let ray: [f64; 3] = std::array::from_fn(|k| {
                let [start, across, down] = [0, 1, 2].map(|i| f64::from(u.ray[i][k]));
                start + px * across + py * down
            });
            let along = p[0] / ray[0];
            assert!((0..3).all(|k| (ray[k] * along - p[k]).abs() < 1e-4 * p[k].abs().max(1.0)), "{ray:?} {p:?}");
        }
    }
}
