//! Pinhole camera: pixels to world rays.

use thiserror::Error;

/// Which world axis points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpAxis {
    /// +Y, as in glTF.
    #[default]
    Y,
    /// +Z, as in many CAD and terrain files.
    Z,
}

impl UpAxis {
    /// The axis as a unit vector of the world.
    pub const fn vector(self) -> [f64; 3] {
        match self {
            UpAxis::Y => [0.0, 1.0, 0.0],
            UpAxis::Z => [0.0, 0.0, 1.0],
        }
    }

    /// Where "up" goes on the picture when the camera looks straight along the axis.
    const fn fallback(self) -> [f64; 3] {
        match self {
            UpAxis::Y => [0.0, 0.0, -1.0],
            UpAxis::Z => [0.0, 1.0, 0.0],
        }
    }
}

/// Why a camera cannot be made.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum CameraError {
    /// A coordinate is infinite or not a number.
    #[error("camera: eye {eye:?} and target {target:?} must be finite")]
    NotFinite {
        /// Eye as given.
        eye: [f64; 3],
        /// Target as given.
        target: [f64; 3],
    },
    /// No direction of view.
    #[error("camera: eye and target are the same point {0:?}; move one of them")]
    NoDirection([f64; 3]),
    /// Field of view out of range.
    #[error("camera: vertical field of view is {0} degrees; give more than 0 and less than 180")]
    FieldOfView(f64),
}

/// A pinhole camera in the world (right-handed axes).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: [f64; 3],
    forward: [f64; 3],
    right: [f64; 3],
    up: [f64; 3],
    axis: UpAxis,
    half_height: f64,
}

impl Camera {
    /// A camera at `eye` that looks at `target` (world units); `fov` is the vertical field of view in degrees,
    /// between 0 and 180, both excluded. Looking straight along the up axis is allowed: the picture's up is then
    /// -Z for [`UpAxis::Y`] and +Y for [`UpAxis::Z`].
    ///
    /// # Errors
    /// Coordinates that are not finite, `eye == target`, `fov` out of range.
    pub fn new(eye: [f64; 3], target: [f64; 3], axis: UpAxis, fov: f64) -> Result<Camera, CameraError> {
        if !eye.iter().chain(&target).all(|v| v.is_finite()) {
            return Err(CameraError::NotFinite { eye, target });
        }
        if !(fov > 0.0 && fov < 180.0) {
            return Err(CameraError::FieldOfView(fov));
        }
        let forward = normalised(std::array::from_fn(|k| target[k] - eye[k])).ok_or(CameraError::NoDirection(eye))?;
        let steep = cross(forward, axis.vector());
        let hint = if dot(steep, steep) < 1e-18 { axis.fallback() } else { axis.vector() };
        let right = normalised(cross(forward, hint)).ok_or(CameraError::NoDirection(eye))?;
        let half_height = (fov.to_radians() * 0.5).tan();
        Ok(Camera { eye, forward, right, up: cross(right, forward), axis, half_height })
    }

    /// Where the camera is, in world units.
    pub const fn eye(&self) -> [f64; 3] {
        self.eye
    }

    /// The up axis it was made with.
    pub const fn up_axis(&self) -> UpAxis {
        self.axis
    }

    /// Unit vectors of the world: to the right, up, and into the picture.
    pub const fn axes(&self) -> [[f64; 3]; 3] {
        [self.right, self.up, self.forward]
    }

    /// Tangents of half the field of view of a picture, across and up.
    pub fn half(&self, width: u32, height: u32) -> [f64; 2] {
        [self.half_height * f64::from(width) / f64::from(height), self.half_height]
    }

    /// Unit direction in the world of the ray through (`x`, `y`) of a picture of `width` x `height` pixels.
    /// (0, 0) is the upper left corner; the centre of the first pixel is (0.5, 0.5). Pixels are square.
    pub fn ray(&self, x: f64, y: f64, width: u32, height: u32) -> [f64; 3] {
        let (w, h) = (f64::from(width), f64::from(height));
        let across = (2.0 * x - w) / h * self.half_height;
        let upward = (h - 2.0 * y) / h * self.half_height;
        let d = std::array::from_fn(|k| self.forward[k] + across * self.right[k] + upward * self.up[k]);
        normalised(d).unwrap_or(self.forward)
    }
}

/// Dot product.
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The unit vector along `v`; nothing for a zero vector. Scaled first, so that no square over- or underflows.
pub(crate) fn normalised(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let v = v.map(|c| c / largest);
    let length = dot(v, v).sqrt();
    Some(v.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        (0..3).all(|k| (a[k] - b[k]).abs() < 1e-12)
    }

    #[test]
    fn y_up_from_the_front() {
        let c = Camera::new([0.0, 0.0, 5.0], [0.0; 3], UpAxis::Y, 90.0).unwrap();
        assert!(near(c.ray(50.0, 25.0, 100, 50), [0.0, 0.0, -1.0]));
        // Top edge: 45 degrees up; right end of the picture: +X, twice as wide as high.
        let s = 0.5_f64.sqrt();
        assert!(near(c.ray(50.0, 0.0, 100, 50), [0.0, s, -s]));
        let r = c.ray(100.0, 25.0, 100, 50);
        assert!(near(r, [2.0 / 5.0_f64.sqrt(), 0.0, -1.0 / 5.0_f64.sqrt()]), "{r:?}");
    }

    #[test]
    fn z_up_from_the_south() {
        let c = Camera::new([0.0, -3.0, 0.0], [0.0; 3], UpAxis::Z, 60.0).unwrap();
        let top = c.ray(5.0, 0.0, 10, 10);
        assert!(top[2] > 0.49 && top[0].abs() < 1e-12 && top[1] > 0.0, "{top:?}");
        assert!(c.ray(10.0, 5.0, 10, 10)[0] > 0.49, "right of the picture is east");
    }

    #[test]
    fn straight_down() {
        let c = Camera::new([0.0, 3.0, 0.0], [0.0; 3], UpAxis::Y, 60.0).unwrap();
        assert!(c.ray(5.0, 0.0, 10, 10)[2] < -0.4);
        assert!(c.ray(10.0, 5.0, 10, 10)[0] > 0.4);
        let c = Camera::new([0.0, 0.0, 3.0], [0.0; 3], UpAxis::Z, 60.0).unwrap();
        assert!(c.ray(5.0, 0.0, 10, 10)[1] > 0.4);
    }

    #[test]
    fn refuses() {
        let new = |eye, fov| Camera::new(eye, [0.0; 3], UpAxis::Y, fov);
        assert!(matches!(new([0.0; 3], 60.0), Err(CameraError::NoDirection(_))));
        assert!(matches!(new([f64::NAN, 0.0, 1.0], 60.0), Err(CameraError::NotFinite { .. })));
        for fov in [0.0, 180.0, -1.0, f64::NAN] {
            assert!(matches!(new([0.0, 0.0, 1.0], fov), Err(CameraError::FieldOfView(_))));
        }
    }
}
