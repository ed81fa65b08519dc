//! A recorded flight: a camera's keys over time, and the cameras between them.
//!
//! The file is JSON:
//!
//! ```json
//! {"up": "y", "fov": 45, "frames_per_second": 60,
//!  "keys": [{"seconds": 0, "eye": [0, 10, 0], "target": [5, 0, 0]}, {"seconds": 2, "eye": [20, 10, 0], "target": [25, 0, 0]}]}
//! ```
//!
//! `up` (y where it is left out), `fov` (vertical, degrees; 45) and `frames_per_second` (60) hold for all of it. Eyes and targets,
//! world units, pass through their keys on Catmull-Rom curves, so that speed does not jump.

use serde_json::Value;
use thiserror::Error;

use super::camera::{Camera, CameraError, UpAxis};

/// Most frames of a flight: an hour at 120 a second.
const MOST_FRAMES: f64 = 432_000.0;

/// Why a flight can't be read.
#[derive(Debug, Error)]
pub enum FlightError {
    /// Not JSON.
    #[error("flight: {0}")]
    Json(#[from] serde_json::Error),
    /// A value is missing or out of place.
    #[error("flight: {place}: expected {expected}, found {found}")]
    Value {
        /// Where in the file.
        place: String,
        /// What should stand there.
        expected: &'static str,
        /// What does.
        found: String,
    },
    /// A camera between the keys that can't be.
    #[error("flight: frame {frame}: {error}")]
    Camera {
        /// Frame, from 0.
        frame: u32,
        /// Why not.
        error: CameraError,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    seconds: f64,
    /// Eye, then target.
    places: [[f64; 3]; 2],
}

/// A camera that moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    up: UpAxis,
    fov: f64,
    rate: f64,
    keys: Vec<Key>,
}

fn wrong(place: impl Into<String>, expected: &'static str, found: Option<&Value>) -> FlightError {
    let found = found.map_or("nothing".to_string(), |v| v.to_string().chars().take(60).collect());
    FlightError::Value { place: place.into(), expected, found }
}

fn number(of: &Value, name: &str, place: &str, usual: Option<f64>) -> Result<f64, FlightError> {
    let value = of.get(name);
    let read = value.and_then(Value::as_f64).filter(|v| v.is_finite());
    match (read, value, usual) {
        (Some(v), ..) => Ok(v),
        (None, None, Some(usual)) => Ok(usual),
        _ => Err(wrong(format!("{place}{name}"), "a number", value)),
    }
}

fn point(of: &Value, name: &str, place: &str) -> Result<[f64; 3], FlightError> {
    let value = of.get(name);
    let numbers: Option<Vec<f64>> =
        value.and_then(Value::as_array).map(|a| a.iter().filter_map(Value::as_f64).collect());
    let read = numbers.and_then(|n| <[f64; 3]>::try_from(n).ok()).filter(|p| p.iter().all(|v| v.is_finite()));
    let whole = value.and_then(Value::as_array).is_some_and(|a| a.len() == 3);
    read.filter(|_| whole).ok_or_else(|| wrong(format!("{place}{name}"), "three numbers, [x, y, z]", value))
}

impl Flight {
    /// Reads a flight from JSON.
    ///
    /// # Errors
    /// What is wrong and where: not JSON, no keys, times that don't rise, numbers out of range, a camera that can't be.
    pub fn parse(json: &str) -> Result<Self, FlightError> {
        let value: Value = serde_json::from_str(json)?;
        let up = match value.get("up").map(|u| u.as_str()) {
            None | Some(Some("y")) => UpAxis::Y,
            Some(Some("z")) => UpAxis::Z,
            Some(_) => return Err(wrong("up", "\"y\" or \"z\"", value.get("up"))),
        };
        let fov = number(&value, "fov", "", Some(45.0))?;
        let rate = number(&value, "frames_per_second", "", Some(60.0))?;
        if !(1.0..=1000.0).contains(&rate) {
            return Err(wrong("frames_per_second", "from 1 to 1000", value.get("frames_per_second")));
        }
        let list = value.get("keys").and_then(Value::as_array).filter(|k| !k.is_empty());
        let list = list.ok_or_else(|| wrong("keys", "a list of at least one key", value.get("keys")))?;
        let mut keys: Vec<Key> = Vec::with_capacity(list.len());
        for (i, key) in list.iter().enumerate() {
            let place = format!("keys[{i}].");
            let seconds = number(key, "seconds", &place, None)?;
            let places = [point(key, "eye", &place)?, point(key, "target", &place)?];
            let least = keys.last().map_or(0.0, |k| k.seconds);
            let rises = if keys.is_empty() { seconds == 0.0 } else { seconds > least };
            if !rises || seconds * rate > MOST_FRAMES {
                let expected = "times in seconds that rise from 0, of at most 432,000 frames";
                return Err(wrong(format!("{place}seconds"), expected, key.get("seconds")));
            }
            keys.push(Key { seconds, places });
        }
        let flight = Flight { up, fov, rate, keys };
        // A camera may also fail between its keys; the whole way is looked at before anybody starts.
        for frame in 0..flight.frames() {
            flight.camera(frame)?;
        }
        Ok(flight)
    }

    /// Frames, from the first key to the last.
    pub fn frames(&self) -> u32 {
        let last = self.keys.last().map_or(0.0, |k| k.seconds);
        // In range by MOST_FRAMES.
        (last * self.rate).floor() as u32 + 1
    }

    /// Vertical field of view, degrees.
    pub fn fov(&self) -> f64 {
        self.fov
    }

    /// Frames a second.
    pub fn frames_per_second(&self) -> f64 {
        self.rate
    }

    /// The camera of a frame; behind the last it stays there.
    ///
    /// # Errors
    /// Eye and target meet, or are beyond what a camera can have.
    pub fn camera(&self, frame: u32) -> Result<Camera, FlightError> {
        let [eye, target] = self.places(f64::from(frame) / self.rate);
        Camera::new(eye, target, self.up, self.fov).map_err(|error| FlightError::Camera { frame, error })
    }

    fn places(&self, seconds: f64) -> [[f64; 3]; 2] {
        let last = self.keys.len() - 1;
        let next = self.keys.partition_point(|k| k.seconds <= seconds).max(1).min(last);
        let at = |i: usize| self.keys[i.min(last)];
        if last == 0 || seconds >= self.keys[last].seconds {
            return self.keys[last].places;
        }
        let (from, to) = (at(next - 1), at(next));
        let span = to.seconds - from.seconds;
        let t = ((seconds - from.seconds) / span).clamp(0.0, 1.0);
        // Speed at a key: the mean over the keys beside it; at the ends that of the one way.
        let speed = |i: usize, p: usize, k: usize| {
            let (a, b) = (at(i.saturating_sub(1)), at(i + 1));
            (b.places[p][k] - a.places[p][k]) / (b.seconds - a.seconds)
        };
        let (t2, t3) = (t * t, t * t * t);
        let between = |p: usize, k: usize| {
            (2.0 * t3 - 3.0 * t2 + 1.0) * from.places[p][k]
                + (t3 - 2.0 * t2 + t) * span * speed(next - 1, p, k)
                + (3.0 * t2 - 2.0 * t3) * to.places[p][k]
                + (t3 - t2) * span * speed(next, p, k)
        };
        [0, 1].map(|p| [0, 1, 2].map(|k| between(p, k)))
    }
}

/// A flight while it is flown: keys that are added one behind the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    up: UpAxis,
    fov: f64,
    keys: Vec<Key>,
}

impl Recording {
    /// Without keys; `fov` is the vertical field of view in degrees.
    pub const fn new(up: UpAxis, fov: f64) -> Self {
        Self { up, fov, keys: Vec::new() }
    }

    /// A key, at seconds from any beginning; the first one begins the flight. One that is not behind the last is left out.
    pub fn add(&mut self, seconds: f64, eye: [f64; 3], target: [f64; 3]) {
        if self.keys.last().is_none_or(|k| k.seconds < seconds) {
            self.keys.push(Key { seconds, places: [eye, target] });
        }
    }

    /// The flight's file.
    pub fn json(&self) -> String {
        let start = self.keys.first().map_or(0.0, |k| k.seconds);
        let key = |k: &Key| {
            let [eye, target] = k.places;
            // Milliseconds are enough, and rise as the keys do; the first is 0.
            let seconds = ((k.seconds - start) * 1e3).round() / 1e3;
            format!("  {}", serde_json::json!({"seconds": seconds, "eye": eye, "target": target}))
        };
        let keys: Vec<String> = self.keys.iter().map(key).collect();
        let up = if self.up == UpAxis::Y { "y" } else { "z" };
        let head = format!("{{\"up\": \"{up}\", \"fov\": {}, \"frames_per_second\": 60, \"keys\": [", self.fov);
        format!("{head}\n{}]}}\n", keys.join(",\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const THREE: &str = r#"{"fov": 60, "frames_per_second": 10, "keys": [
        {"seconds": 0, "eye": [0, 1, 0], "target": [1, 1, 0]},
        {"seconds": 1, "eye": [10, 1, 0], "target": [11, 1, 0]},
        {"seconds": 3, "eye": [30, 1, 0], "target": [31, 1, 0]}]}"#;

    #[test]
    fn it_passes_through_its_keys_at_an_even_speed() {
        let flight = Flight::parse(THREE).unwrap();
        assert_eq!((flight.frames(), flight.frames_per_second()), (31, 10.0));
        for frame in 0..40 {
            let eye = flight.camera(frame).unwrap().eye();
            let x = f64::from(frame.min(30));
            assert!((eye[0] - x).abs() < 1e-9 && eye[1] == 1.0, "{frame}: {eye:?}");
        }
    }

    #[test]
    fn speed_does_not_jump_at_a_key() {
        let json = THREE.replace("[30, 1, 0]", "[10, 1, 40]").replace("[31, 1, 0]", "[11, 1, 40]");
        let flight = Flight::parse(&json.replace("10, \"keys\"", "1000, \"keys\"")).unwrap();
        let eye = |f| flight.camera(f).unwrap().eye();
        let step = |f: u32| [0, 1, 2].map(|k| eye(f + 1)[k] - eye(f)[k]);
        let (before, after) = (step(999), step(1000));
        assert!((0..3).all(|k| (before[k] - after[k]).abs() < 1e-3), "{before:?} {after:?}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        let said = |from: &str, to: &str| Flight::parse(&THREE.replacen(from, to, 1)).unwrap_err().to_string();
        for (from, to, expected) in [
            ("\"keys\"", "\"kees\"", "flight: keys: expected a list of at least one key, found nothing"),
            ("[0, 1, 0]", "[0, 1]", "flight: keys[0].eye: expected three numbers, [x, y, z], found [0,1]"),
            ("\"seconds\": 3", "\"seconds\": 1", "flight: keys[2].seconds: expected times in seconds that rise from 0"),
            ("\"seconds\": 0", "\"seconds\": 2", "flight: keys[0].seconds: expected times"),
            ("\"seconds\": 3", "\"seconds\": 1e9", "of at most 432,000 frames, found"),
            ("60", "\"wide\"", "flight: fov: expected a number, found \"wide\""),
            ("60", "190", "flight: frame 0: camera: vertical field of view is 190 degrees"),
            ("[1, 1, 0]", "[0, 1, 0]", "flight: frame 0: camera: eye and target are the same point"),
            ("10, \"keys\"", "0, \"keys\"", "flight: frames_per_second: expected from 1 to 1000, found 0"),
            ("{\"fov\"", "{\"up\": \"x\", \"fov\"", "flight: up: expected \"y\" or \"z\", found \"x\""),
            ("]}", "]", "flight: key must be a string at line 3"),
        ] {
            let message = said(from, to);
            assert!(message.contains(expected), "{message}\n{expected}");
        }
        assert!(Flight::parse(&THREE.replace("1, 0]}]}", "1, 0]}, 7]}")).is_err());
    }

    #[test]
    fn what_was_recorded_can_be_flown() {
        let mut recording = Recording::new(UpAxis::Z, 50.0);
        for (seconds, x) in [(7.1, 0.0), (7.35, 1.0), (7.35, 9.0), (7.2, 9.0), (7.6, 2.0)] {
            recording.add(seconds, [x, 0.1, 0.2], [x, 1.0, 0.3]);
        }
        let flight = Flight::parse(&recording.json()).unwrap();
        assert_eq!((flight.frames(), flight.frames_per_second()), (31, 60.0));
        for (frame, x) in [(0, 0.0), (15, 1.0), (30, 2.0)] {
            let camera = flight.camera(frame).unwrap();
            let right = Camera::new([x, 0.1, 0.2], [x, 1.0, 0.3], UpAxis::Z, 50.0).unwrap();
            assert!((0..3).all(|k| (camera.eye()[k] - right.eye()[k]).abs() < 1e-9), "{camera:?}");
            assert_eq!((camera.half(4, 3), camera.up_axis()), (right.half(4, 3), UpAxis::Z));
        }
        assert!(Flight::parse(&Recording::new(UpAxis::Y, 45.0).json()).is_err(), "without keys");
    }

    #[test]
    fn one_key_is_a_still() {
        let json = r#"{"up": "z", "keys": [{"seconds": 0, "eye": [0, -5, 2], "target": [0, 0, 0]}]}"#;
        let flight = Flight::parse(json).unwrap();
        assert_eq!(flight.frames(), 1);
        assert_eq!(flight.camera(7).unwrap().eye(), [0.0, -5.0, 2.0]);
    }
}
