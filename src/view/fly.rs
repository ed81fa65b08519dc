//! A camera that keys and mouse move: where it is, where it looks, how fast it goes. Knows no window.

use crate::render::{Camera, CameraError, UpAxis, cross, dot, normalised};

/// Steepest look up or down, degrees.
const STEEPEST_LOOK: f64 = 89.0;
/// Degrees that a pixel of mouse turns.
const DEGREES_PER_PIXEL: f64 = 0.12;
/// How much faster it goes while it hurries.
const HURRY: f64 = 6.0;

/// Which ways are asked for; each adds to the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Keys {
    /// Into the picture.
    pub forward: bool,
    /// Out of it.
    pub back: bool,
    /// To the left.
    pub left: bool,
    /// To the right.
    pub right: bool,
    /// Up in the world.
    pub up: bool,
    /// Down.
    pub down: bool,
    /// Faster.
    pub hurry: bool,
}

impl Keys {
    /// Whether it goes anywhere.
    pub fn any(&self) -> bool {
        Keys { hurry: false, ..*self } != Keys::default()
    }
}

/// A flying camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fly {
    eye: [f64; 3],
    /// Degrees around the up axis, and up from the horizon.
    turn: f64,
    rise: f64,
    axis: UpAxis,
    fov: f64,
    /// World units a second.
    pub speed: f64,
}

impl Fly {
    /// From a camera; `fov` is its vertical field of view in degrees, `speed` in world units a second.
    pub fn new(camera: &Camera, fov: f64, speed: f64) -> Self {
        let mut fly = Self { eye: camera.eye(), turn: 0.0, rise: 0.0, axis: camera.up_axis(), fov, speed };
        fly.face(camera.axes()[2]);
        fly
    }

    /// Goes to another camera's place.
    pub fn place(&mut self, camera: &Camera) {
        self.eye = camera.eye();
        self.face(camera.axes()[2]);
    }

    fn face(&mut self, way: [f64; 3]) {
        let [side, ahead, up] = self.base().map(|b| dot(b, way));
        self.turn = side.atan2(ahead).to_degrees();
        self.rise = up.clamp(-1.0, 1.0).asin().to_degrees().clamp(-STEEPEST_LOOK, STEEPEST_LOOK);
    }

    /// Right and ahead on the ground where nothing was turned, and up.
    fn base(&self) -> [[f64; 3]; 3] {
        let up = self.axis.vector();
        let ahead = match self.axis {
            UpAxis::Y => [0.0, 0.0, -1.0],
            UpAxis::Z => [0.0, 1.0, 0.0],
        };
        [cross(ahead, up), ahead, up]
    }

    /// Unit vector of where it looks.
    fn way(&self) -> [f64; 3] {
        let [side, ahead, up] = self.base();
        let ((ts, tc), (rs, rc)) = (self.turn.to_radians().sin_cos(), self.rise.to_radians().sin_cos());
        std::array::from_fn(|k| rc * (ts * side[k] + tc * ahead[k]) + rs * up[k])
    }

    /// Turns by a way of the mouse in pixels: to the right, down.
    pub fn look(&mut self, pixels: [f64; 2]) {
        self.turn = (self.turn + pixels[0] * DEGREES_PER_PIXEL).rem_euclid(360.0);
        self.rise = (self.rise - pixels[1] * DEGREES_PER_PIXEL).clamp(-STEEPEST_LOOK, STEEPEST_LOOK);
    }

    /// Moves for `seconds`; a long pause counts as a tenth of a second.
    pub fn go(&mut self, keys: Keys, seconds: f64) {
        let way = self.way();
        let up = self.axis.vector();
        let side = normalised(cross(way, up)).unwrap_or([0.0; 3]);
        let both = |plus: bool, minus: bool| f64::from(u8::from(plus)) - f64::from(u8::from(minus));
        let (f, s, u) = (both(keys.forward, keys.back), both(keys.right, keys.left), both(keys.up, keys.down));
        let sum = std::array::from_fn(|k| f * way[k] + s * side[k] + u * up[k]);
        let Some(unit) = normalised(sum) else { return };
        let far = self.speed * if keys.hurry { HURRY } else { 1.0 } * seconds.clamp(0.0, 0.1);
        let eye: [f64; 3] = std::array::from_fn(|k| self.eye[k] + far * unit[k]);
        if eye.iter().all(|v| v.is_finite()) {
            self.eye = eye;
        }
    }

    /// Where it is and a point that it looks at, one second of its way ahead.
    pub fn places(&self) -> [[f64; 3]; 2] {
        let way = self.way();
        [self.eye, std::array::from_fn(|k| self.eye[k] + self.speed.max(1e-3) * way[k])]
    }

    /// The camera.
    ///
    /// # Errors
    /// So far from the origin that eye and target are one point.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        let [eye, target] = self.places();
        Camera::new(eye, target, self.axis, self.fov)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_starts_where_the_camera_was_and_comes_back() {
        for axis in [UpAxis::Y, UpAxis::Z] {
            let camera = Camera::new([3.0, 5.0, -2.0], [10.0, 4.0, 1.0], axis, 40.0).unwrap();
            let mut fly = Fly::new(&camera, 40.0, 2.0);
            let same = |fly: &Fly| {
                let now = fly.camera().unwrap();
                (0..3).all(|i| (0..3).all(|k| (now.axes()[i][k] - camera.axes()[i][k]).abs() < 1e-9))
                    && (0..3).all(|k| (now.eye()[k] - camera.eye()[k]).abs() < 1e-9)
            };
            assert!(same(&fly));
            let start = fly;
            fly.look([40.0, -20.0]);
            assert!(!same(&fly));
            fly.look([-40.0, 20.0]);
            fly.go(Keys { forward: true, up: true, ..Keys::default() }, 0.05);
            fly.go(Keys { back: true, down: true, ..Keys::default() }, 0.05);
            assert!(same(&fly));
            fly.place(&camera);
            assert_eq!(fly.eye, start.eye);
        }
    }

    #[test]
    fn speed_is_that_of_the_keys() {
        let camera = Camera::new([0.0; 3], [1.0, 0.0, 0.0], UpAxis::Y, 40.0).unwrap();
        let go = |keys, seconds| {
            let mut fly = Fly::new(&camera, 40.0, 3.0);
            fly.go(keys, seconds);
            fly.eye
        };
        let forward = Keys { forward: true, ..Keys::default() };
        assert!((go(forward, 0.1)[0] - 0.3).abs() < 1e-12);
        assert!((go(forward, 9.0)[0] - 0.3).abs() < 1e-12, "a pause is no leap");
        assert!((go(Keys { hurry: true, ..forward }, 0.1)[0] - 0.3 * HURRY).abs() < 1e-12);
        assert_eq!(go(Keys { left: true, right: true, ..Keys::default() }, 0.1), [0.0; 3]);
        let [x, y, z] = go(Keys { right: true, ..Keys::default() }, 0.1);
        assert!(x.abs() < 1e-12 && y == 0.0 && (z - 0.3).abs() < 1e-12, "right of +X is +Z where Y is up");
        assert!(go(Keys { up: true, ..Keys::default() }, 0.1)[1] > 0.29);
    }

    #[test]
    fn it_never_looks_over_its_own_head() {
        let camera = Camera::new([0.0; 3], [1.0, 0.0, 0.0], UpAxis::Z, 40.0).unwrap();
        let mut fly = Fly::new(&camera, 40.0, 1.0);
        for _ in 0..50 {
            fly.look([0.0, -500.0]);
        }
        let up = fly.camera().unwrap().axes()[2][2];
        assert!((STEEPEST_LOOK.to_radians().sin() - up).abs() < 1e-9);
    }
}
