//! What filters ask of a view: the receiver's plane and the pixel's footprint on the map.

use umbrage_format::projection::Lattice;
use umbrage_reader::query::filter::{self, gradient, level_of_detail};

use super::camera::dot;
use super::scene::{Surface, View};

/// Steepest plane that taps follow, in texel widths of depth for one texel: 86 degrees. Beyond, the light grazes, and a
/// plane says little about what lies beside it.
pub(crate) const STEEPEST: f64 = 16.0;

/// A view's receivers as filters ask about them.
pub struct Footprints<'a> {
    view: &'a View,
    surface: Surface<'a>,
    /// Lattice steps to texels.
    texel: f64,
    /// Steepest rise, in lattice steps of depth for one texel.
    most: f64,
}

impl<'a> Footprints<'a> {
    /// Of a view of these triangles.
    pub fn new(view: &'a View, surface: impl Into<Surface<'a>>) -> Self {
        let surface = surface.into();
        let rows = surface.lattice.world_to_lattice.map(|r| [r[0], r[1], r[2]]);
        let [across, _, along] = rows.map(|r| dot(r, r).sqrt());
        let texel = f64::from(surface.lattice.subtexel_bits).exp2();
        Self { view, surface, texel, most: STEEPEST * texel * along / across }
    }

    /// The receiver of a pixel; `None` for the sky. Where the light sees its triangle edge-on it has no gradient.
    pub fn receiver(&self, pixel: usize) -> Option<filter::Receiver> {
        let r = self.view.receivers.get(pixel)?.as_ref()?;
        let [x, y] = r.texel(self.surface.lattice);
        let rise = self.surface.slope(r.triangle).unwrap_or_default().map(|v| v * self.texel);
        Some(filter::Receiver { x, y, depth: r.depth.query(), gradient: gradient(rise, self.most) })
    }

    /// Level of detail of a pixel: its footprint is that of the pixel on the receiver's plane, from where the rays of the
    /// next pixel across and the next one down meet it. The root's where one of them doesn't.
    pub fn level_of_detail(&self, pixel: usize) -> u32 {
        let (view, lattice) = (self.view, self.surface.lattice);
        let (Some(point), Some(normal)) = (view.points.get(pixel), view.normals.get(pixel)) else { return 0 };
        let normal = normal.map(f64::from);
        let [x, y] = [pixel as u32 % view.width.max(1), pixel as u32 / view.width.max(1)].map(|v| f64::from(v) + 0.5);
        let eye = view.camera.eye();
        let height = dot(std::array::from_fn(|k| point[k] - eye[k]), normal);
        let derivatives = [[1.0, 0.0], [0.0, 1.0]].map(|[dx, dy]| {
            let ray = view.camera.ray(x + dx, y + dy, view.width, view.height);
            let t = height / dot(ray, normal);
            if !(t > 0.0 && t.is_finite()) {
                return [f64::INFINITY; 2];
            }
            self.texels(lattice, std::array::from_fn(|k| eye[k] + t * ray[k] - point[k]))
        });
        level_of_detail(derivatives, lattice.log2_resolution)
    }

    /// A way in the world as one over the map, in texels.
    fn texels(&self, lattice: &Lattice, way: [f64; 3]) -> [f64; 2] {
        let [x, y, _] = lattice.world_to_lattice;
        [x, y].map(|r| dot([r[0], r[1], r[2]], way) / self.texel)
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera::{Camera, UpAxis};
    use super::super::scene::Scene;
    use super::super::testing::{TestMesh, lattice, snap};
    use super::*;

    /// A floor over the whole map, seen from straight above: 45 degrees of a picture 100 pixels high.
    #[test]
    fn a_floor_from_above() {
        let corners = [[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]];
        let mesh = snap(lattice(10), &corners, vec![[0, 1, 2], [1, 3, 2]]);
        let scene = Scene::new(mesh.surface());
        for far in [0.1, 0.5, 0.9] {
            let camera = Camera::new([0.0, far, 0.0], [0.0; 3], UpAxis::Y, 90.0).unwrap();
            let view = scene.view(&camera, 100, 100, &|| true).unwrap();
            let of = Footprints::new(&view, mesh.surface());
            let pixel = 40 * 100 + 60;
            assert_eq!(of.receiver(pixel).unwrap().gradient, [0, 0]);
            // The picture is 2 * far wide, the map of 1024 texels 2.
            let texels = 2.0 * far / 100.0 * 512.0;
            let lod = f64::from(of.level_of_detail(pixel)) / 256.0;
            assert!((lod - texels.log2().max(0.0)).abs() < 0.01, "{lod} for {texels} texels");
        }
    }

    #[test]
    fn slopes_are_those_of_the_plane_and_clamped() {
        let mesh = TestMesh {
            lattice: lattice(10),
            positions: vec![[0, 0, 0], [1000, 0, 3000], [0, 1000, -500], [0, 0, 1 << 40], [5, 5, 0], [9, 9, 0]],
            triangles: vec![[0, 1, 2], [0, 4, 5], [0, 4, 1], [3, 1, 2]],
        };
        assert_eq!(mesh.surface().slope(0), Some([3.0, -0.5]));
        assert_eq!(mesh.surface().slope(1), None);
        assert!(mesh.surface().slope(3).is_some_and(|s| s.iter().all(|v| v.abs() > 1e8)));
    }
}
